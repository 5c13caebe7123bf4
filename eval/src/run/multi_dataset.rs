//! How are many datasets evaluated in one run, with and without the true place in the map?
//!
//! Each part is the dataset of another suite with that suite's protocol. A query is answered
//! *in-map*, by the whole map of its fold; and, where places are left out, once more as an
//! *out-of-map* query, by a map that was learnt without its place, so that every answer but
//! "unknown" is wrong. Both share a group. One map is learnt per fold, and one per fold and place
//! left out.
//!
//! Rows count in-map queries; the answers to out-of-map ones are in the judgement. A part whose
//! times are no clock answers with `static` in the place of methods that need a time: what a user
//! would get. Nothing is timed here.

use std::collections::BTreeSet;

use anyhow::Result;
use chronotope::dataset::Clock;
use chronotope::localize::LocalizerConfig;
use rayon::prelude::*;

use super::answer::RunAnswers;
use super::fold::run_fold;
use super::options::RunOptions;
use super::tallies::{NamedQuery, Tallies};
use crate::data::{
    ExtractedDataset, Fold, Images, Worlds, images, photograph, prefix, split_at,
    without_duplicates,
};
use crate::judge::rates::PairedDifference;
use crate::progress::Progress;
use crate::provenance::sha256;
use crate::results::{LeakCheck, SuiteResults};
use crate::suite::{Protocol, Run, Suite};

/// What the ids of out-of-map queries end with.
pub(super) const OUT_OF_MAP_SUFFIX: &str = " (place left out)";

/// The n at which arms are compared in words.
const COMPARED_N: [u32; 2] = [30, 50];

/// The parts of a suite.
#[derive(Clone, Copy, Debug)]
pub(super) struct MultiDataset<'s> {
    /// Names of suites.
    pub(super) suites: &'s [String],
    /// Whether out-of-map queries are answered too.
    pub(super) leave_place_out: bool,
    /// Of a synthetic part, so many worlds.
    pub(super) num_seeds: u64,
}

/// One dataset (or world) with its folds.
struct Part {
    /// What ids begin with.
    prefix: String,
    /// Whether all of it is one group, as the images of one world are.
    is_group: bool,
    data: ExtractedDataset,
    folds: Vec<Fold>,
}

/// A fold to learn and query; out-of-map queries have no true place there.
struct Case {
    fold: Fold,
    is_out_of_map: bool,
}

impl MultiDataset<'_> {
    /// Runs all arms of `suite` on all parts.
    pub(super) fn run(&self, suite: &Suite, options: &RunOptions) -> Result<SuiteResults> {
        let mut results = SuiteResults::new(&suite.name, self.suites.join(", "));
        let mut tallies = Tallies::new(suite, false);
        let mut digest = String::new();
        let mut leaks = LeakCheck::default();
        let (mut num_places, mut num_broken) = (0, 0);
        let mut without_clock = BTreeSet::new();
        for name in self.suites {
            for part in self.part(name, options)? {
                let dataset = &part.data.dataset;
                digest.push_str(&dataset.sha256());
                leaks.num_checked += dataset.entries.len() as u32;
                num_broken += dataset.problems.len() as u32;
                num_places += dataset.places().len() as u32;
                if dataset.clock == Clock::None {
                    without_clock.insert(name.as_str());
                }
                leaks.num_removed += self.run_part(suite, &part, &mut tallies)?;
            }
        }
        results.dataset_sha256 = sha256(digest.as_bytes());
        results.num_places = Some(num_places);
        results.num_broken_images = Some(num_broken);
        results.leak_check = Some(leaks);
        tallies.finish(&mut results);
        let num_out_of_map = (results.queries.iter()).filter(|query| query.truth.is_none());
        let num_out_of_map = num_out_of_map.count();
        results.split = format!(
            "as in the suites {}; {} queries whose place is in the map{}",
            self.suites.join(", "),
            results.queries.len() - num_out_of_map,
            if self.leave_place_out {
                format!(", and {num_out_of_map} of maps that were learnt without their place")
            } else {
                String::new()
            }
        );
        if !without_clock.is_empty() {
            let names: Vec<_> = without_clock.into_iter().collect();
            results.clock = format!(
                "none in {}: `static` stands in for methods that need a time",
                names.join(", ")
            );
        }
        results
            .notes
            .push("nothing is timed here; the suites of the parts are".into());
        if !self.leave_place_out {
            results.notes.extend(against_default(&results));
        }
        Ok(results)
    }

    fn part(&self, name: &str, options: &RunOptions) -> Result<Vec<Part>> {
        let suite = Suite::find(name)?;
        let extractor = options.extractor()?;
        let Protocol::Synthetic {
            num_learn,
            num_query,
            ..
        } = suite.protocol
        else {
            let Images { data, folds, .. } =
                images(&suite, options.data.as_deref(), &options.cache, &*extractor)?;
            return Ok(vec![Part {
                prefix: name.to_owned(),
                is_group: false,
                data,
                folds,
            }]);
        };
        let worlds = Worlds {
            seeds: self.num_seeds,
            learn: num_learn,
            query: num_query,
        };
        (1..=self.num_seeds)
            .map(|seed| {
                let (dataset, split) = worlds.world(seed, true, name)?;
                let data = ExtractedDataset::new(dataset, &*extractor, None, &|| {})?;
                Ok(Part {
                    prefix: format!("{name}/{}", prefix(seed)),
                    is_group: true,
                    folds: vec![split_at(&data, split)],
                    data,
                })
            })
            .collect()
    }

    /// Answers every query of the part; gives the number of duplicates taken off the learning side.
    fn run_part(&self, suite: &Suite, part: &Part, tallies: &mut Tallies<'_>) -> Result<u32> {
        let (mut cases, mut num_removed) = (Vec::new(), 0);
        for fold in &part.folds {
            let (fold, removed) = without_duplicates(&part.data, fold);
            num_removed += removed;
            if self.leave_place_out {
                cases.extend(places_left_out(&part.data, &fold));
            }
            cases.push(Case {
                fold,
                is_out_of_map: false,
            });
        }
        let bar = Progress::new(cases.len() * suite.arms.len(), "maps");
        let default = LocalizerConfig::default();
        let mut first_run = 0;
        for arm in &suite.arms {
            let runs = match part.data.dataset.clock {
                Clock::Real => arm.runs(true)?,
                Clock::None => arm.runs_without_clock()?,
            };
            let (distinct, of_run) = distinct(&runs);
            let said: Vec<Vec<(usize, Vec<RunAnswers>)>> = (cases.par_iter())
                .map(|case| {
                    let said = run_fold(&part.data, &case.fold, arm, &distinct, &suite.sizes);
                    bar.inc();
                    said
                })
                .collect::<Result<_>>()?;
            // The runs by name: a stand-in answers under the name of what it stands in for.
            tallies.register(arm, arm.runs(true)?, first_run, &default);
            for (case, said) in cases.iter().zip(said) {
                for (entry, said) in said {
                    let said = of_run.iter().map(|&run| said[run].clone());
                    tallies.collect(&named(part, case, entry), first_run, said);
                }
            }
            first_run += runs.len();
        }
        drop(bar);
        Ok(num_removed)
    }
}

/// One case per place of the fold's queries: learnt without it, queried for it.
fn places_left_out(data: &ExtractedDataset, fold: &Fold) -> Vec<Case> {
    let place = |entry: usize| &data.dataset.entries[entry].place;
    let places: BTreeSet<_> = fold.query.iter().map(|&entry| place(entry)).collect();
    (places.into_iter())
        .map(|left_out| {
            let of = |side: &[usize], is_kept: bool| -> Vec<usize> {
                let entries = side.iter().copied();
                entries
                    .filter(|&entry| (place(entry) == left_out) == is_kept)
                    .collect()
            };
            Case {
                fold: Fold {
                    learn: of(&fold.learn, false),
                    query: of(&fold.query, true),
                    name: fold.name.clone(),
                },
                is_out_of_map: true,
            }
        })
        .collect()
}

/// The runs that differ, and for each run which of them it is: stand-ins are often the same.
fn distinct(runs: &[Run]) -> (Vec<Run>, Vec<usize>) {
    let mut distinct: Vec<Run> = Vec::new();
    let of_run = (runs.iter())
        .map(|run| {
            let known = (distinct.iter()).position(|known| known.localizer == run.localizer);
            known.unwrap_or_else(|| {
                distinct.push(run.clone());
                distinct.len() - 1
            })
        })
        .collect();
    (distinct, of_run)
}

/// The query of an entry as the case has it.
fn named(part: &Part, case: &Case, entry: usize) -> NamedQuery {
    let entry = &part.data.dataset.entries[entry];
    let in_map_id = format!("{}/{}", part.prefix, case.fold.query_id(entry));
    let group = if part.is_group {
        part.prefix.clone()
    } else {
        let photograph = photograph(&entry.id).unwrap_or(&entry.id);
        format!("{}/{photograph}", part.prefix)
    };
    NamedQuery {
        id: if case.is_out_of_map {
            format!("{in_map_id}{OUT_OF_MAP_SUFFIX}")
        } else {
            in_map_id
        },
        group: Some(group),
        truth: (!case.is_out_of_map).then(|| entry.place.as_str().to_owned()),
        near: Vec::new(),
    }
}

/// In words: every other variant against the default, on the same queries.
fn against_default(results: &SuiteResults) -> Vec<String> {
    let Some(default) = results.default_variant() else {
        return Vec::new();
    };
    let others = (results.variants().into_iter()).filter(|variant| *variant != default);
    let said = others.flat_map(|other| {
        let default = &default;
        COMPARED_N.into_iter().filter_map(move |n| {
            let paired = PairedDifference::between(&results.queries, &default.at(n), &other.at(n))?;
            Some(format!(
                "{other} instead of the default, n = {n}: {:.1} % wrong against {:.1} %, \
                 {:+.1} points (95 % interval {:+.1} to {:+.1})",
                paired.second_percent,
                paired.first_percent,
                paired.points.mean,
                paired.points.interval.low,
                paired.points.interval.high
            ))
        })
    });
    said.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::OFF_MAP;

    fn suite(leave_place_out: bool) -> Suite {
        let mut suite = Suite::find("foreign").unwrap();
        suite.sizes = vec![30];
        suite.protocol = Protocol::MultiDataset {
            suites: vec!["synthetic".into()],
            leave_place_out,
            num_seeds: 1,
        };
        suite
    }

    /// A part of two queried places and a third one, without images.
    fn part() -> Part {
        let worlds = Worlds {
            seeds: 1,
            learn: 2,
            query: 1,
        };
        let (dataset, split) = worlds.world(1, true, "synthetic").unwrap();
        let extractor = RunOptions::default().extractor().unwrap();
        let data = ExtractedDataset::new(dataset, &*extractor, None, &|| {}).unwrap();
        Part {
            prefix: "synthetic/seed 01".into(),
            is_group: true,
            folds: vec![split_at(&data, split)],
            data,
        }
    }

    #[test]
    fn an_out_of_map_query_meets_a_map_that_never_saw_its_place() {
        let part = part();
        let cases = places_left_out(&part.data, &part.folds[0]);
        let place = |entry: &usize| part.data.dataset.entries[*entry].place.clone();
        assert_eq!(cases.len(), part.data.dataset.places().len());
        let num_queries: usize = cases.iter().map(|case| case.fold.query.len()).sum();
        assert_eq!(num_queries, part.folds[0].query.len());
        for Case {
            fold,
            is_out_of_map,
        } in &cases
        {
            let learnt: BTreeSet<_> = fold.learn.iter().map(place).collect();
            assert!(
                *is_out_of_map
                    && fold
                        .query
                        .iter()
                        .all(|entry| !learnt.contains(&place(entry)))
            );
            assert_eq!(learnt.len() + 1, cases.len());
        }
    }

    #[test]
    fn every_query_is_answered_in_map_and_out_of_map() {
        let suite = suite(true);
        let parts = MultiDataset {
            suites: &["synthetic".into()],
            leave_place_out: true,
            num_seeds: 1,
        };
        let part = part();
        let mut tallies = Tallies::new(&suite, false);
        parts.run_part(&suite, &part, &mut tallies).unwrap();
        let mut results = SuiteResults::new("foreign", "synthetic");
        tallies.finish(&mut results);
        let (in_map, out_of_map): (Vec<_>, Vec<_>) = results
            .queries
            .iter()
            .partition(|query| query.truth.is_some());
        assert_eq!((in_map.len(), out_of_map.len()), (8, 8));
        for query in out_of_map {
            let place = query.id.strip_prefix("synthetic/seed 01/").unwrap();
            for answer in query.answers.values() {
                assert!(answer.posterior.contains_key(OFF_MAP), "{}", query.id);
                assert!(
                    answer
                        .posterior
                        .keys()
                        .all(|key| !place.starts_with(&format!("{key}/")))
                );
            }
        }
        assert_eq!(results.rows.len(), 6);
        assert!(
            results
                .rows
                .iter()
                .all(|row| row.queries == 8 && row.pairs_compared > 0.0)
        );
        assert_eq!(results.rows.iter().filter(|row| row.is_default).count(), 1);
        results.validate().unwrap();
    }

    #[test]
    fn stand_ins_run_once_and_answer_twice() {
        let arm = &suite(true).arms[0];
        let (distinct_runs, of_run) = distinct(&arm.runs_without_clock().unwrap());
        // Each method runs once for its likelihood and once for its counts.
        assert_eq!((distinct_runs.len(), of_run), (2, vec![0, 1, 0, 1]));
        assert_eq!(distinct(&arm.runs(true).unwrap()).1, [0, 1, 2, 3]);
    }
}
