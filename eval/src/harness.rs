//! How does every method answer every query of a suite?
//!
//! For each fold and arm a map is learnt from the learning side in order of time; then every query is
//! asked of every localizer, all n in one pass ([`chronotope::localize::Sweep`]). For some queries the
//! plain [`Localizer::localize_into`] is timed, alone on its core, and must give the same scores as the
//! sweep: a run in which it does not is an error, not a result.
//!
//! Queries and what is learnt are kept apart twice: by the protocol, and by the digest of decoded
//! pixels (an image that equals a query of the fold is taken off the learning side).

use std::collections::{BTreeMap, HashSet};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};
use chronotope::Time;
use chronotope::dataset::{Clock, Dataset, Manifest, Side};
use chronotope::feature::Features;
use chronotope::learn::{KeepAppearances, LearnConfig, Learner, Observation};
use chronotope::localize::{
    Decision, Localization, Localizer, Method, Preset, Query, Score, Scratch, Sweep,
};
use chronotope::map::{MapMeta, NodeId, SessionId, Snapshot, derived_uuid};
use chronotope::predict::{Choice, Selection};
use rayon::prelude::*;

use crate::exhibit::Exhibit;
use crate::judge::rates::Tally;
use crate::judge::statistics::{Sample, p50_p99};
use crate::material::Material;
use crate::results::{self, Answer, LeakCheck, Reobservation, SuiteResults, Variant};
use crate::suite::{Arm, Protocol, Run, Suite, shipped};

/// Re-observation is judged on so many of the most likely features (T-RO 2017, table I).
const TOP: usize = 10;
/// So many queries of the first fold are asked once more, one at a time, with the clock running.
const NUM_TIMED: usize = 16;

/// Smaller shares of a posterior would be written as 0 and are left out of the results.
const LEAST_SHARE: f64 = 5e-5;

/// Entries that are learnt and entries that are asked for; indices into a dataset.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Fold {
    /// Learnt, in order of time.
    pub learn: Vec<usize>,
    /// Asked for.
    pub query: Vec<usize>,
}

/// The folds of a protocol, before the leak check.
pub fn folds(
    protocol: &Protocol,
    dataset: &Dataset,
    manifest: Option<&Manifest>,
) -> Result<Vec<Fold>> {
    let all = 0..dataset.entries.len();
    match protocol {
        Protocol::LeaveOneVisitOut => {
            let visits = visit_numbers(dataset);
            let num_visits = visits.iter().max().map_or(0, |last| last + 1);
            ensure!(
                num_visits >= 2,
                "leaving one visit out takes at least two visits of a place"
            );
            Ok((0..num_visits)
                .map(|left_out| {
                    let (query, learn) = all.clone().partition(|&i| visits[i] == left_out);
                    Fold { learn, query }
                })
                .collect())
        }
        Protocol::Split => {
            let split = manifest
                .and_then(|manifest| manifest.split.as_ref())
                .with_context(|| format!("the manifest of `{}` has no split", dataset.name))?;
            let of = |side| {
                all.clone()
                    .filter(|&i| split.side(&dataset.entries[i]) == Some(side))
                    .collect::<Vec<_>>()
            };
            let fold = Fold {
                learn: of(Side::Learn),
                query: of(Side::Query),
            };
            ensure!(
                !fold.learn.is_empty() && !fold.query.is_empty(),
                "the split of `{}` leaves one side empty",
                dataset.name
            );
            Ok(vec![fold])
        }
        Protocol::Synthetic { .. } | Protocol::Several { .. } => {
            bail!("worlds and parts bring their own folds")
        }
        Protocol::Series { .. } => bail!("a series is no dataset of images"),
    }
}

/// The number of each entry among the visits of its place, from 0 in order of time.
fn visit_numbers(dataset: &Dataset) -> Vec<usize> {
    let mut times: BTreeMap<_, Vec<Time>> = BTreeMap::new();
    for entry in &dataset.entries {
        times.entry(&entry.place).or_default().push(entry.time);
    }
    for times in times.values_mut() {
        times.sort_unstable();
        times.dedup();
    }
    (dataset.entries.iter())
        .map(|entry| times[&entry.place].partition_point(|&time| time < entry.time))
        .collect()
}

/// What one run said about one query.
#[derive(Clone, Debug)]
pub(crate) struct Said {
    /// For each score and n: the answer.
    pub(crate) answers: Vec<Vec<Answer>>,
    pub(crate) pairs_compared: Vec<u64>,
    /// (seen again, selected) of the most likely features, where the method predicts features.
    reobserved: Option<(u32, u32)>,
}

/// Collects answers over folds and worlds, then turns them into rows.
pub struct Tallies<'s> {
    suite: &'s Suite,
    queries: BTreeMap<String, results::Query>,
    variants: Vec<VariantTally>,
    num_learnt: Vec<usize>,
    num_checked: u32,
    num_removed: AtomicU32,
    num_broken: usize,
    num_places: usize,
    extraction_ms: Vec<f64>,
    has_clock: bool,
    is_timed: bool,
    exhibit: Option<Exhibit>,
}

/// What is summed up for one run: the rows of its variants share all but the answers.
#[derive(Clone, Debug)]
struct VariantTally {
    preset: Preset,
    scores: Vec<Score>,
    run: Run,
    is_default: bool,
    pairs_compared: Vec<u64>,
    num_asked: u64,
    reobserved: Vec<(Option<String>, f64)>,
    ms: Vec<Vec<f64>>,
}

impl<'s> Tallies<'s> {
    /// Nothing asked yet.
    pub fn new(suite: &'s Suite) -> Self {
        Self {
            suite,
            queries: BTreeMap::new(),
            variants: Vec::new(),
            num_learnt: Vec::new(),
            num_checked: 0,
            num_removed: AtomicU32::new(0),
            num_broken: 0,
            num_places: 0,
            extraction_ms: Vec::new(),
            has_clock: true,
            is_timed: false,
            exhibit: None,
        }
    }

    /// What pictures can be drawn of, once something was added.
    pub fn take_exhibit(&mut self) -> Option<Exhibit> {
        self.exhibit.take()
    }

    /// Runs every arm on every fold of one dataset.
    ///
    /// `prefix` makes the ids of queries unique over several datasets and groups them; `progress` is
    /// called once per fold and arm.
    pub fn add(
        &mut self,
        material: &Material,
        folds: &[Fold],
        prefix: Option<&str>,
        progress: &(impl Fn() + Sync),
    ) -> Result<()> {
        self.has_clock = material.dataset.clock == Clock::Real;
        self.num_checked += material.extracted.len() as u32;
        self.num_broken += material.dataset.problems.len();
        self.num_places = self.num_places.max(material.dataset.places().len());
        self.extraction_ms
            .extend_from_slice(&material.extraction_ms);
        let folds: Vec<Fold> = folds
            .iter()
            .map(|fold| self.without_twins(material, fold))
            .collect();
        self.num_learnt
            .extend(folds.iter().map(|fold| fold.learn.len()));
        let mut first_variant = 0;
        for arm in &self.suite.arms {
            let said: Vec<Vec<(usize, Vec<Said>)>> = folds
                .par_iter()
                .map(|fold| {
                    let said = self.run_fold(material, fold, arm);
                    progress();
                    said
                })
                .collect::<Result<_>>()?;
            let runs = arm.runs(self.has_clock);
            self.register(arm, &runs, first_variant);
            for (entry, said) in said.into_iter().flatten() {
                self.collect(material, entry, prefix, first_variant, said);
            }
            if !self.is_timed
                && let Some(fold) = folds.first()
            {
                self.time(material, fold, arm, first_variant)?;
            }
            first_variant += runs.len();
        }
        self.is_timed = true;
        Ok(())
    }

    /// The fold without twins, which are counted.
    fn without_twins(&self, material: &Material, fold: &Fold) -> Fold {
        let (fold, removed) = without_twins(material, fold);
        self.num_removed.fetch_add(removed, Ordering::Relaxed);
        fold
    }

    fn run_fold(
        &self,
        material: &Material,
        fold: &Fold,
        arm: &Arm,
    ) -> Result<Vec<(usize, Vec<Said>)>> {
        let runs = arm.runs(self.has_clock);
        run_fold(material, fold, arm, &runs, &self.suite.sizes)
    }

    fn register(&mut self, arm: &Arm, runs: &[Run], first_variant: usize) {
        if self.variants.len() > first_variant {
            return;
        }
        let default = shipped(self.has_clock);
        self.variants.extend(runs.iter().map(|run| VariantTally {
            preset: arm.preset,
            scores: run.scores.clone(),
            run: run.clone(),
            is_default: arm.preset == Preset::Default && run.localizer == default,
            pairs_compared: vec![0; self.suite.sizes.len()],
            num_asked: 0,
            reobserved: Vec::new(),
            ms: vec![Vec::new(); self.suite.sizes.len()],
        }));
    }

    fn collect(
        &mut self,
        material: &Material,
        entry: usize,
        prefix: Option<&str>,
        first_variant: usize,
        said: Vec<Said>,
    ) {
        let entry = &material.dataset.entries[entry];
        let id = match prefix {
            Some(prefix) => format!("{prefix}/{}", entry.id),
            None => entry.id.clone(),
        };
        // Cut-outs of one photograph, and all images of one world, are alike.
        let group = match prefix {
            Some(prefix) => Some(prefix.to_owned()),
            None => photograph(&entry.id).map(str::to_owned),
        };
        let query = (self.queries.entry(id.clone())).or_insert_with(|| results::Query {
            id,
            truth: Some(entry.place.as_str().to_owned()),
            group: group.clone(),
            answers: BTreeMap::new(),
        });
        for (variant, said) in self.variants[first_variant..].iter_mut().zip(said) {
            variant.num_asked += 1;
            for (sum, pairs) in variant.pairs_compared.iter_mut().zip(said.pairs_compared) {
                *sum += pairs;
            }
            if let Some((seen, selected)) = said.reobserved
                && selected > 0
            {
                let share = f64::from(seen) / f64::from(selected);
                variant.reobserved.push((group.clone(), share));
            }
            if self.suite.visibility_only {
                continue;
            }
            for (&score, answers) in variant.scores.iter().zip(said.answers) {
                let name = variant.run.variant(variant.preset, score);
                for (&n, answer) in self.suite.sizes.iter().zip(answers) {
                    query.answers.insert(name.at(n as u32).to_string(), answer);
                }
            }
        }
    }

    /// Times single localisations and holds them against the sweep.
    fn time(
        &mut self,
        material: &Material,
        fold: &Fold,
        arm: &Arm,
        first_variant: usize,
    ) -> Result<()> {
        let times = times(&material.dataset, arm)?;
        let snapshot = learn(material, fold, arm, &times)?;
        let num_live = LearnConfig::preset(arm.preset).features_per_visit();
        let step = fold.query.len().div_ceil(NUM_TIMED).max(1);
        let mut scratch = Scratch::default();
        let mut sweep = Sweep::new(&self.suite.sizes)?;
        let mut out = Localization::default();
        for (index, mut localizer) in localizers(&snapshot, &arm.runs(self.has_clock))?
            .into_iter()
            .enumerate()
        {
            for &entry in fold.query.iter().step_by(step) {
                let live = live(material, entry, num_live);
                let query = Query {
                    features: &live,
                    time: Some(times[entry]),
                    image_size: Some(material.extracted[entry].image_size),
                };
                sweep.restart();
                localizer.sweep(&mut scratch, &query, &mut sweep)?;
                for (size, &n) in self.suite.sizes.iter().enumerate() {
                    localizer = localizer.with_selection(Selection::Top(n));
                    let start = Instant::now();
                    localizer.localize_into(&mut scratch, &query, &mut out)?;
                    let ms = start.elapsed().as_secs_f64() * 1e3;
                    self.variants[first_variant + index].ms[size].push(ms);
                    let score = localizer.cfg().score();
                    for candidate in &out.ranking {
                        let swept = sweep.tally(candidate.node, size).of(score);
                        ensure!(
                            candidate.score == swept,
                            "{} scores {} for node {} at n = {n}, but {swept} in the sweep",
                            localizer.cfg().method(),
                            candidate.score,
                            candidate.node.0
                        );
                    }
                    ensure!(
                        out.pairs_compared == sweep.pairs_compared()[size],
                        "{} compares {} pairs at n = {n}, but {} in the sweep",
                        localizer.cfg().method(),
                        out.pairs_compared,
                        sweep.pairs_compared()[size]
                    );
                }
            }
            let variant = &self.variants[first_variant + index];
            let is_better = match &self.exhibit {
                None => true,
                Some(known) => {
                    variant.is_default
                        || (variant.run.localizer.method() == Method::Fremen
                            && known.localizer.cfg().method() == Method::Static)
                }
            };
            if is_better {
                self.exhibit = Some(Exhibit {
                    variant: variant.run.variant(arm.preset, localizer.cfg().score()),
                    localizer,
                    fold: fold.clone(),
                    times: times.clone(),
                    num_live,
                });
            }
        }
        Ok(())
    }

    /// The rows, queries and header numbers of everything added so far.
    pub fn finish(self, results: &mut SuiteResults) {
        results.queries = self.queries.into_values().collect();
        for variant in &self.variants {
            let reobserved = reobservation(variant);
            for &score in &variant.scores {
                let name = variant.run.variant(variant.preset, score);
                for (size, &n) in self.suite.sizes.iter().enumerate() {
                    let key = name.at(n as u32);
                    let has_rule = score == Score::Likelihood;
                    let tally = Tally::of(&results.queries, &key, has_rule);
                    let is_default = variant.is_default && score == variant.run.localizer.score();
                    let mut row = tally.into_row(&key, is_default);
                    row.reobserved = reobserved.as_ref().map(|reobserved| reobserved.percent);
                    row.pairs_compared =
                        variant.pairs_compared[size] as f64 / variant.num_asked.max(1) as f64;
                    (row.ms_p50, row.ms_p99) = p50_p99(&variant.ms[size]);
                    if !self.suite.visibility_only {
                        results.rows.push(row);
                    }
                }
            }
            results.reobservation.extend(reobserved);
        }
        results.latency = latency(results, &self.extraction_ms);
        results.num_places = Some(self.num_places as u32);
        let folds = self.num_learnt.len().max(1);
        results.num_learnt_images = Some((self.num_learnt.iter().sum::<usize>() / folds) as u32);
        results.num_broken_images = Some(self.num_broken as u32);
        results.leak_check = Some(LeakCheck {
            num_checked: self.num_checked,
            num_removed: self.num_removed.into_inner(),
            note: String::new(),
        });
        results.clock = if self.has_clock {
            "the dataset's times are a clock".into()
        } else {
            "none: the dataset's times only number its visits, so no temporal model was run".into()
        };
    }
}

fn reobservation(variant: &VariantTally) -> Option<Reobservation> {
    if variant.reobserved.is_empty() {
        return None;
    }
    let values = variant.reobserved.iter();
    let sample = Sample::grouped(values.map(|(group, share)| (group.as_deref(), *share)));
    let percent = sample.rate().scaled(100.0);
    let name = variant
        .run
        .variant(variant.preset, variant.run.localizer.score());
    Some(Reobservation {
        variant: Variant {
            score: String::new(),
            ..name
        },
        top: TOP as u32,
        percent: percent.mean,
        ci_low: percent.interval.low,
        ci_high: percent.interval.high,
    })
}

/// The strongest features of an image.
pub fn live(material: &Material, entry: usize, num_live: usize) -> Features {
    let mut features = material.extracted[entry].features.clone();
    features.truncate(num_live);
    features
}

/// When each entry was taken, by the arm's clock.
pub(crate) fn times(dataset: &Dataset, arm: &Arm) -> Result<Vec<Time>> {
    let dated = dataset.entries.iter().map(|entry| entry.time);
    Ok(match arm.visit_clock()? {
        None => dated.collect(),
        Some(quantum) => (visit_numbers(dataset).into_iter())
            .map(|number| Time::from_us(quantum.as_us().saturating_mul(number as i64)))
            .collect(),
    })
}

/// Learns the map of one fold.
pub fn learn(material: &Material, fold: &Fold, arm: &Arm, times: &[Time]) -> Result<Arc<Snapshot>> {
    let meta = MapMeta::new(
        derived_uuid(&material.dataset.name),
        "evaluation",
        arm.preset.name(),
    );
    let cfg = LearnConfig::preset(arm.preset).with_keep_appearances(KeepAppearances::All);
    let mut learner = Learner::new(cfg, meta);
    for &index in &fold.learn {
        let entry = &material.dataset.entries[index];
        learner.observe(&Observation {
            place: entry.place.clone(),
            session: SessionId::derive(&material.dataset.name),
            time: times[index],
            features: &material.extracted[index].features,
            image_size: material.extracted[index].image_size,
            mask: None,
            source: entry.id.clone(),
        })?;
    }
    Ok(learner.snapshot()?)
}

/// The fold without learning images that show the same pixels as one of its queries, and their number.
pub(crate) fn without_twins(material: &Material, fold: &Fold) -> (Fold, u32) {
    let asked: HashSet<&[u8; 32]> = (fold.query.iter())
        .map(|&i| &material.extracted[i].digest)
        .collect();
    let learn: Vec<usize> = (fold.learn.iter().copied())
        .filter(|&i| !asked.contains(&material.extracted[i].digest))
        .collect();
    let removed = (fold.learn.len() - learn.len()) as u32;
    let query = fold.query.clone();
    (Fold { learn, query }, removed)
}

/// Learns the fold's map and asks for every query of the fold: its entry with what each run says.
pub(crate) fn run_fold(
    material: &Material,
    fold: &Fold,
    arm: &Arm,
    runs: &[Run],
    sizes: &[usize],
) -> Result<Vec<(usize, Vec<Said>)>> {
    let times = times(&material.dataset, arm)?;
    let snapshot = learn(material, fold, arm, &times)?;
    let localizers = localizers(&snapshot, runs)?;
    let num_live = LearnConfig::preset(arm.preset).features_per_visit();
    (fold.query.par_iter())
        .map_init(
            || (Scratch::default(), Sweep::new(sizes)),
            |(scratch, sweep), &entry| {
                let sweep = sweep.as_mut().map_err(|error| anyhow::anyhow!("{error}"))?;
                sweep.restart();
                let live = live(material, entry, num_live);
                let query = Query {
                    features: &live,
                    time: Some(times[entry]),
                    image_size: Some(material.extracted[entry].image_size),
                };
                let truth = snapshot.find(&material.dataset.entries[entry].place);
                let said = (localizers.iter())
                    .zip(runs)
                    .map(|(localizer, run)| ask(localizer, run, &query, truth, scratch, sweep))
                    .collect::<Result<_>>()?;
                Ok((entry, said))
            },
        )
        .collect()
}

/// Cut-outs of one photograph are alike: the part of an entry's id that names it.
pub(crate) fn photograph(id: &str) -> Option<&str> {
    id.split_once('@').map(|(photograph, _)| photograph)
}

/// One localizer for each run.
fn localizers(snapshot: &Arc<Snapshot>, runs: &[Run]) -> Result<Vec<Localizer>> {
    (runs.iter())
        .map(|run| Ok(Localizer::new(Arc::clone(snapshot), run.localizer.clone())?))
        .collect()
}

/// Probabilities are written so that `p` and `1 - p` both keep four digits, down to 1e-12: files stay
/// small, and answers that are nearly sure stay in order.
fn rounded(p: f64) -> f64 {
    let rarer = p.min(1.0 - p).max(1e-12);
    let scale = 10_f64.powi(3 - rarer.log10().floor() as i32);
    (p * scale).round() / scale
}

fn ask(
    localizer: &Localizer,
    run: &Run,
    query: &Query<'_>,
    truth: Option<NodeId>,
    scratch: &mut Scratch,
    sweep: &mut Sweep,
) -> Result<Said> {
    localizer.sweep(scratch, query, sweep)?;
    let nodes = &localizer.snapshot().nodes;
    let name = |node: usize| nodes[node].key.as_str().to_owned();
    let answer = |score: Score, size: usize| {
        let scores: Vec<f64> = (0..nodes.len())
            .map(|node| sweep.tally(NodeId(node as u32), size).of(score))
            .collect();
        let best = scores.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let weighed = localizer.posterior(score, sweep.sizes()[size], &scores);
        let posterior = weighed
            .as_ref()
            .map_or_else(BTreeMap::new, |(shares, elsewhere)| {
                let mut named: BTreeMap<String, f64> = (shares.iter().enumerate())
                    .filter(|(_, share)| **share >= LEAST_SHARE)
                    .map(|(node, share)| (name(node), rounded(*share)))
                    .collect();
                named.insert(results::ELSEWHERE.into(), rounded(*elsewhere));
                named
            });
        // Without a single match, a count ranks nothing.
        if best <= 0.0 && score != Score::Likelihood {
            return Answer {
                first: None,
                decision: results::Decision::Unknown,
                posterior,
                ties: Vec::new(),
            };
        }
        let first: Vec<usize> = (scores.iter().enumerate())
            .filter(|&(_, &score)| score == best)
            .map(|(node, _)| node)
            .collect();
        let decision = match (&weighed, score) {
            (Some((shares, elsewhere)), Score::Likelihood) => {
                let node = NodeId(first[0] as u32);
                match Decision::by_risk(node, shares[first[0]], *elsewhere, localizer.cfg().risk())
                {
                    Decision::At(_) => results::Decision::At(name(first[0])),
                    Decision::Ambiguous => results::Decision::Ambiguous,
                    Decision::Unknown => results::Decision::Unknown,
                }
            }
            _ => results::Decision::At(name(first[0])),
        };
        Answer {
            first: Some(name(first[0])),
            decision,
            posterior,
            ties: if first.len() > 1 {
                first.iter().map(|&node| name(node)).collect()
            } else {
                Vec::new()
            },
        }
    };
    let answers = (run.scores.iter())
        .map(|&score| {
            (0..sweep.sizes().len())
                .map(|size| answer(score, size))
                .collect()
        })
        .collect();
    let pairs_compared = sweep.pairs_compared().to_vec();
    let reobserved = match truth {
        // By the most likely features, as in the papers, so once for each model.
        Some(node)
            if localizer.cfg().method().predicts()
                && localizer.cfg().choice() == Choice::Likeliest =>
        {
            let selected = localizer.snapshot().node(node).features.len().min(TOP);
            localizer
                .reobserved(scratch, query, node, TOP)?
                .map(|seen| (seen as u32, selected as u32))
        }
        _ => None,
    };
    Ok(Said {
        answers,
        pairs_compared,
        reobserved,
    })
}

/// The stages of one image: its features, where they were not cached, and the default's answer.
fn latency(results: &SuiteResults, extraction_ms: &[f64]) -> Vec<results::StageLatency> {
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
            Some(results::StageLatency {
                of: of.clone(),
                stage: stage.into(),
                ms_p50,
                ms_p99,
            })
        })
        .collect()
}
