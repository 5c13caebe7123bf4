//! How does every method answer every query of a dataset, or of worlds one after the other?

use std::collections::BTreeMap;

use anyhow::Result;
use chronotope::dataset::Clock;
use chronotope::learn::LearnConfig;
use chronotope::localize;
use chronotope::predict::Selection;
use rayon::prelude::*;

use super::answer::RunAnswers;
use super::fold::{learn, live, localizers, run_fold, times};
use super::options::RunOptions;
use super::showcase::{Showcase, Shown, SuiteRun};
use super::tallies::{NamedQuery, Tallies};
use super::timing::time;
use crate::data::{
    ExtractedDataset, Fold, Images, Nearness, images, photograph, without_duplicates,
};
use crate::judge::statistics::p50_p99;
use crate::progress::Progress;
use crate::results::{LeakCheck, Query, StageLatency, SuiteResults};
use crate::suite::{Arm, Home, Ranking, Suite, shipped};

/// So many queries of the first fold are answered once more, one at a time, with the clock running.
const NUM_TIMED: usize = 16;

/// From so many places on, a run without a tolerance mentions that there are tolerances.
const MANY_PLACES: u32 = 30;

/// Answers, sizes and times over folds and worlds.
pub(super) struct DatasetRun<'s> {
    suite: &'s Suite,
    tallies: Tallies<'s>,
    num_learnt: Vec<usize>,
    leaks: LeakCheck,
    num_broken: usize,
    num_places: usize,
    extraction_ms: Vec<f64>,
    has_clock: bool,
    is_timed: bool,
    showcase: Option<Showcase>,
}

impl<'s> DatasetRun<'s> {
    /// Nothing was answered yet.
    pub(super) fn new(suite: &'s Suite) -> Self {
        Self {
            suite,
            tallies: Tallies::new(suite, true),
            num_learnt: Vec::new(),
            leaks: LeakCheck::default(),
            num_broken: 0,
            num_places: 0,
            extraction_ms: Vec::new(),
            has_clock: true,
            is_timed: false,
            showcase: None,
        }
    }

    /// Runs every arm on every fold of one dataset.
    ///
    /// `prefix` makes the ids of queries unique over several datasets and groups them; `progress`
    /// is called once per fold and arm.
    pub(super) fn add(
        &mut self,
        data: &ExtractedDataset,
        folds: &[Fold],
        prefix: Option<&str>,
        progress: &(impl Fn() + Sync),
    ) -> Result<()> {
        self.has_clock = data.dataset.clock == Clock::Real;
        self.leaks.num_checked += data.extracted.len() as u32;
        self.num_broken += data.dataset.problems.len();
        self.num_places = self.num_places.max(data.dataset.places().len());
        self.extraction_ms.extend_from_slice(&data.extraction_ms);
        let mut checked = Vec::with_capacity(folds.len());
        for fold in folds {
            let (fold, removed) = without_duplicates(data, fold);
            self.leaks.num_removed += removed;
            self.num_learnt.push(fold.learn.len());
            checked.push(fold);
        }
        let nearness: Vec<Nearness<'_>> = (checked.iter())
            .map(|fold| Nearness::new(&data.dataset, &fold.learn, self.suite.tolerance))
            .collect::<Result<_>>()?;
        let mut first_run = 0;
        for arm in &self.suite.arms {
            let mut runs = arm.runs(self.has_clock)?;
            for run in &mut runs {
                run.follows &= self.suite.protocol.queries_ways();
            }
            let num_runs = runs.len();
            let answers: Vec<Vec<(usize, Vec<RunAnswers>)>> = (checked.par_iter())
                .map(|fold| {
                    let answers = run_fold(data, fold, arm, &runs, &self.suite.sizes);
                    progress();
                    answers
                })
                .collect::<Result<_>>()?;
            let default = shipped(self.has_clock);
            self.tallies.register(arm, runs, first_run, &default);
            for ((fold, nearness), answers) in checked.iter().zip(&nearness).zip(answers) {
                for (entry, answers) in answers {
                    let query = named(data, fold, nearness, entry, prefix);
                    self.tallies.collect(&query, first_run, answers);
                }
            }
            if !self.is_timed
                && let Some(fold) = checked.first()
            {
                self.time(data, fold, arm, first_run)?;
            }
            first_run += num_runs;
        }
        self.is_timed = true;
        Ok(())
    }

    /// Times single answers of every run of the arm, and chooses what is shown.
    fn time(
        &mut self,
        data: &ExtractedDataset,
        fold: &Fold,
        arm: &Arm,
        first_run: usize,
    ) -> Result<()> {
        let times = times(&data.dataset, arm)?;
        let snapshot = learn(data, fold, arm, &times)?;
        let num_live = LearnConfig::preset(arm.preset).features_per_visit();
        let step = fold.query.len().div_ceil(NUM_TIMED).max(1);
        let timed: Vec<_> = (fold.query.iter().step_by(step))
            .map(|&entry| (entry, live(data, entry, num_live)))
            .collect();
        let queries: Vec<localize::Query<'_>> = (timed.iter())
            .map(|(entry, features)| {
                localize::Query::new(features)
                    .at(times[*entry])
                    .with_image_size(data.extracted[*entry].image_size)
            })
            .collect();
        let runs = arm.runs(self.has_clock)?;
        for (index, (localizer, run)) in localizers(&snapshot, &runs)?
            .into_iter()
            .zip(&runs)
            .enumerate()
        {
            let (localizer, ms) = time(localizer, &queries, &self.suite.sizes)?;
            self.tallies.add_times(first_run + index, ms);
            let is_default = self.tallies.is_default(first_run + index);
            let known = self.showcase.as_ref();
            if known.is_none_or(|known| known.is_less_than(&localizer, is_default)) {
                self.showcase = Some(Showcase {
                    variant: run.variant(arm.preset, Ranking::Image(localizer.cfg().score())),
                    localizer,
                    fold: fold.clone(),
                    times: times.clone(),
                    num_live,
                });
            }
        }
        Ok(())
    }

    /// The rows, queries and header numbers of everything added so far, and what can be shown.
    pub(super) fn finish(self, results: &mut SuiteResults) -> Option<Showcase> {
        results.tolerance = self.suite.tolerance;
        self.tallies.finish(results);
        results.latency = latency(results, &self.extraction_ms);
        results.num_places = Some(self.num_places as u32);
        let folds = self.num_learnt.len().max(1);
        results.num_learnt_images = Some((self.num_learnt.iter().sum::<usize>() / folds) as u32);
        results.num_broken_images = Some(self.num_broken as u32);
        results.leak_check = Some(self.leaks);
        results.clock = if self.has_clock {
            "the dataset's times are a clock".into()
        } else {
            "none: the dataset's times only number its visits, so no temporal model was run".into()
        };
        self.showcase
    }
}

/// The query of an entry; cut-outs of one photograph, all images of one world, and one image in
/// several folds are alike.
fn named(
    data: &ExtractedDataset,
    fold: &Fold,
    nearness: &Nearness<'_>,
    entry: usize,
    prefix: Option<&str>,
) -> NamedQuery {
    let entry = &data.dataset.entries[entry];
    let id = fold.query_id(entry);
    let (id, group) = if let Some(prefix) = prefix {
        (format!("{prefix}/{id}"), Some(prefix))
    } else {
        let same_image = fold.name.as_ref().map(|_| entry.id.as_str());
        (id, photograph(&entry.id).or(same_image))
    };
    NamedQuery {
        id,
        group: group.map(str::to_owned),
        truth: nearness.truth(&entry.place).map(ToString::to_string),
        near: nearness.near(&entry.place),
    }
}

/// The stages of one image: its features, where they were not cached, and the default's answer.
fn latency(results: &SuiteResults, extraction_ms: &[f64]) -> Vec<StageLatency> {
    let located = (results.default_variant())
        .zip(results.detail_n())
        .and_then(|(variant, n)| results.row(&variant.at(n)))
        .filter(|row| row.ms_p50 > 0.0);
    let of = located.map_or("all methods".into(), |row| {
        format!("default, n = {}", row.n)
    });
    let stages = [
        (
            "decode and extract, two at a time",
            (!extraction_ms.is_empty()).then(|| p50_p99(extraction_ms)),
        ),
        (
            "predict, match, decide",
            located.map(|row| (row.ms_p50, row.ms_p99)),
        ),
    ];
    (stages.into_iter())
        .filter_map(|(stage, ms)| {
            let (ms_p50, ms_p99) = ms?;
            Some(StageLatency {
                of: of.clone(),
                stage: stage.into(),
                ms_p50,
                ms_p99,
            })
        })
        .collect()
}

/// Runs a suite of one dataset of images.
pub(super) fn run_images(suite: &Suite, options: &RunOptions) -> Result<SuiteRun> {
    let Images { data, folds, split } = images(
        suite,
        options.data.as_deref(),
        &options.cache,
        &*options.extractor()?,
    )?;
    let mut results = SuiteResults::new(&suite.name, &data.dataset.name);
    results.dataset_sha256 = data.dataset.sha256();
    results.split = split;
    if let (Home::Own, Selection::Top(n)) = (&suite.home, shipped(true).selection()) {
        results.shown_n = Some(n.get() as u32);
    }
    let mut run = DatasetRun::new(suite);
    let bar = Progress::new(folds.len() * suite.arms.len(), "folds");
    run.add(&data, &folds, None, &|| bar.inc())?;
    drop(bar);
    let showcase = run.finish(&mut results);
    results.notes.extend(hints(&results));
    if suite.by_day {
        results.notes.extend(by_day(&results, &data, &folds));
    }
    results
        .notes
        .extend(data.dataset.problems.iter().map(ToString::to_string));
    Ok(SuiteRun {
        results,
        shown: showcase.map(|showcase| Shown {
            showcase,
            data,
            prefix: None,
        }),
    })
}

/// The errors of every variant at the n shown in detail, day by day of the queries.
fn by_day(results: &SuiteResults, data: &ExtractedDataset, folds: &[Fold]) -> Vec<String> {
    let entries = &data.dataset.entries;
    let dates: BTreeMap<String, String> = (folds.iter())
        .flat_map(|fold| fold.query.iter().map(move |&entry| (fold, &entries[entry])))
        .map(|(fold, entry)| {
            let date = entry.time.to_string().chars().take(10).collect();
            (fold.query_id(entry), date)
        })
        .collect();
    let mut days: BTreeMap<&str, Vec<&Query>> = BTreeMap::new();
    for query in &results.queries {
        if let Some(date) = dates.get(&query.id) {
            days.entry(date).or_default().push(query);
        }
    }
    let Some(n) = results.detail_n() else {
        return Vec::new();
    };
    (days.into_iter())
        .map(|(date, queries)| {
            let wrong = results.variants().into_iter().map(|variant| {
                let key = variant.at(n).to_string();
                let errors = queries.iter().filter_map(|query| {
                    Some(query.answers.get(&key)?.wrong(query.truth.as_deref()))
                });
                let percent = 100.0 * errors.sum::<f64>() / queries.len() as f64;
                format!("{variant} {percent:.1} %")
            });
            let wrong: Vec<_> = wrong.collect();
            let count = queries.len();
            format!(
                "on {date}, {count} queries, wrong at n = {n}: {}",
                wrong.join(", ")
            )
        })
        .collect()
}

/// What a reader should know of the queries of a run before believing its numbers.
fn hints(results: &SuiteResults) -> Vec<String> {
    let mut hints = Vec::new();
    let num_out_of_map = (results.queries.iter()).filter(|query| query.truth.is_none());
    let num_out_of_map = num_out_of_map.count();
    if num_out_of_map > 0 {
        hints.push(format!(
            "{num_out_of_map} queries show places that were not learnt: they are in no rate of \
             first choices, and whatever locates them is counted as a false accept"
        ));
    }
    if results.tolerance.is_none() && results.num_places.unwrap_or(0) >= MANY_PLACES {
        hints.push(
            "with so many places, neighbours may show the same: --tolerance places:1, edges:1 or \
             metres:5 also counts what is near enough"
                .into(),
        );
    }
    hints
}
