//! What do the answers of all arms add up to?
//!
//! Answers are collected query by query, over folds, worlds and datasets, and become rows at the
//! end.

use std::collections::BTreeMap;

use chronotope::localize::{LocalizerConfig, Preset};

use super::answer::RunAnswers;
use super::fold::TOP;
use crate::judge::rates::{Tally, within};
use crate::judge::statistics::{Sample, p50_p99};
use crate::results::{Query, Reobservation, SuiteResults, Variant};
use crate::suite::{Arm, Ranking, Run, Suite};

/// A query as results name it.
#[derive(Clone, Debug)]
pub(crate) struct NamedQuery {
    /// Unique within the suite.
    pub(crate) id: String,
    /// Queries of one group are alike.
    pub(crate) group: Option<String>,
    /// The true place, where the map has it.
    pub(crate) truth: Option<String>,
    /// The other places that count as right within the tolerance.
    pub(crate) near: Vec<String>,
}

/// Answers by query, and what is summed up for each run.
#[derive(Debug)]
pub(crate) struct Tallies<'s> {
    suite: &'s Suite,
    keeps_reobservation: bool,
    queries: BTreeMap<String, Query>,
    runs: Vec<RunTally>,
}

/// What is summed up for one run: its rows share all but the answers.
#[derive(Debug)]
struct RunTally {
    preset: Preset,
    run: Run,
    is_default: bool,
    /// For each n, over the queries whose place is in the map.
    pairs_compared: Vec<u64>,
    num_queries: u64,
    reobserved: Vec<(Option<String>, f64)>,
    /// For each n, where single answers were timed.
    ms: Vec<Vec<f64>>,
}

impl<'s> Tallies<'s> {
    /// Nothing was answered yet.
    pub(crate) fn new(suite: &'s Suite, keeps_reobservation: bool) -> Self {
        Self {
            suite,
            keeps_reobservation,
            queries: BTreeMap::new(),
            runs: Vec::new(),
        }
    }

    /// Makes room for the runs of an arm, of which the first is the `first_run`-th of the suite;
    /// does nothing where they are known. `default` is what the shipped default does.
    pub(crate) fn register(
        &mut self,
        arm: &Arm,
        runs: Vec<Run>,
        first_run: usize,
        default: &LocalizerConfig,
    ) {
        if self.runs.len() > first_run {
            return;
        }
        let num_sizes = self.suite.sizes.len();
        self.runs.extend(runs.into_iter().map(|run| RunTally {
            preset: arm.preset,
            is_default: arm.preset == Preset::Default && run.localizer == *default,
            run,
            pairs_compared: vec![0; num_sizes],
            num_queries: 0,
            reobserved: Vec::new(),
            ms: vec![Vec::new(); num_sizes],
        }));
    }

    /// Takes in what the runs from `first_run` on answered to a query.
    pub(crate) fn collect(
        &mut self,
        query: &NamedQuery,
        first_run: usize,
        answers: impl IntoIterator<Item = RunAnswers>,
    ) {
        let known = (self.queries.entry(query.id.clone())).or_insert_with(|| Query {
            id: query.id.clone(),
            truth: query.truth.clone(),
            near: query.near.clone(),
            group: query.group.clone(),
            answers: BTreeMap::new(),
        });
        for (tally, said) in self.runs[first_run..].iter_mut().zip(answers) {
            if query.truth.is_some() {
                tally.num_queries += 1;
                for (sum, pairs) in tally.pairs_compared.iter_mut().zip(said.pairs_compared) {
                    *sum += pairs;
                }
            }
            if self.keeps_reobservation
                && let Some((seen, selected)) = said.reobserved
                && selected > 0
            {
                let share = f64::from(seen) / f64::from(selected);
                tally.reobserved.push((query.group.clone(), share));
            }
            if self.suite.visibility_only {
                continue;
            }
            for (ranking, answers) in tally.run.rankings().into_iter().zip(said.answers) {
                let name = tally.run.variant(tally.preset, ranking);
                for (&n, answer) in self.suite.sizes.iter().zip(answers) {
                    known.answers.insert(name.at(n as u32).to_string(), answer);
                }
            }
        }
    }

    /// Adds the times of single answers, for each n.
    pub(crate) fn add_times(&mut self, run: usize, ms: Vec<Vec<f64>>) {
        for (all, ms) in self.runs[run].ms.iter_mut().zip(ms) {
            all.extend(ms);
        }
    }

    /// Whether the shipped default gives this run.
    pub(crate) fn is_default(&self, run: usize) -> bool {
        self.runs[run].is_default
    }

    /// The queries, rows and re-observation of everything collected so far.
    pub(crate) fn finish(self, results: &mut SuiteResults) {
        results.queries = self.queries.into_values().collect();
        for tally in &self.runs {
            let reobserved = tally.reobservation();
            for ranking in tally.run.rankings() {
                let name = tally.run.variant(tally.preset, ranking);
                for (size, &n) in self.suite.sizes.iter().enumerate() {
                    let key = name.at(n as u32);
                    let is_default =
                        tally.is_default && ranking == Ranking::Image(tally.run.localizer.score());
                    let mut row = Tally::of(&results.queries, &key, ranking.has_rule())
                        .into_row(&key, is_default);
                    row.reobserved = reobserved.as_ref().map(|reobserved| reobserved.percent);
                    row.pairs_compared =
                        tally.pairs_compared[size] as f64 / tally.num_queries.max(1) as f64;
                    (row.ms_p50, row.ms_p99) = p50_p99(&tally.ms[size]);
                    row.within = (results.tolerance).map(|_| within(&results.queries, &key));
                    if !self.suite.visibility_only {
                        results.rows.push(row);
                    }
                }
            }
            results.reobservation.extend(reobserved);
        }
    }
}

impl RunTally {
    /// The share of its most likely features that were seen again.
    fn reobservation(&self) -> Option<Reobservation> {
        if self.reobserved.is_empty() {
            return None;
        }
        let values = self.reobserved.iter();
        let sample = Sample::grouped(values.map(|(group, share)| (group.as_deref(), *share)));
        let percent = sample.rate().scaled(100.0);
        Some(Reobservation {
            variant: Variant {
                score: String::new(),
                ..(self.run).variant(self.preset, Ranking::Image(self.run.localizer.score()))
            },
            top: TOP as u32,
            percent: percent.mean,
            ci_low: percent.interval.low,
            ci_high: percent.interval.high,
        })
    }
}
