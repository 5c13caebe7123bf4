//! What does every method answer to the queries of one fold?
//!
//! A map is learnt from the learning side in order of time; then every localizer answers every
//! query, all n in one pass ([`chronotope::localize::Sweep`]).

use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::Result;
use chronotope::Time;
use chronotope::dataset::Dataset;
use chronotope::feature::Features;
use chronotope::learn::{KeepAppearances, LearnConfig, Learner, Observation};
use chronotope::localize::{Localizer, PlaceScores, Query, Score, Scratch, Sweep};
use chronotope::map::{MapMeta, NodeId, SessionId, Snapshot, derived_uuid};
use chronotope::predict::Choice;
use rayon::prelude::*;

use super::answer::{ImageAnswer, RunAnswers, decided, named_posterior};
use super::route::follow;
use crate::data::{ExtractedDataset, Fold, visit_numbers};
use crate::results::{self, Answer};
use crate::suite::{Arm, Run};

/// Re-observation is judged on so many of the most likely features (T-RO 2017, table I).
pub(crate) const TOP: usize = 10;

/// The strongest features of an image.
pub(crate) fn live(data: &ExtractedDataset, entry: usize, num_live: usize) -> Features {
    let mut features = data.extracted[entry].features.clone();
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
pub(crate) fn learn(
    data: &ExtractedDataset,
    fold: &Fold,
    arm: &Arm,
    times: &[Time],
) -> Result<Arc<Snapshot>> {
    let meta = MapMeta {
        // Counted visits have no clocks.
        zone: (data.dataset.zone.clone()).filter(|_| arm.visit_clock_s.is_none()),
        ..MapMeta::new(
            derived_uuid(&data.dataset.name),
            &data.extractor,
            arm.preset.name(),
        )
    };
    let cfg = LearnConfig::preset(arm.preset).with_keep_appearances(KeepAppearances::All);
    learn_in_order(data, Learner::new(cfg, meta), &fold.learn, times)
}

/// Learns the map of all images.
pub(crate) fn learn_all(data: &ExtractedDataset) -> Result<Arc<Snapshot>> {
    let name = &data.dataset.name;
    let meta = MapMeta::new(derived_uuid(name), &data.extractor, "default");
    let entries: Vec<usize> = (0..data.dataset.entries.len()).collect();
    let times: Vec<Time> = (data.dataset.entries.iter())
        .map(|entry| entry.time)
        .collect();
    learn_in_order(
        data,
        Learner::new(LearnConfig::default(), meta),
        &entries,
        &times,
    )
}

fn learn_in_order(
    data: &ExtractedDataset,
    mut learner: Learner,
    entries: &[usize],
    times: &[Time],
) -> Result<Arc<Snapshot>> {
    for &index in entries {
        let entry = &data.dataset.entries[index];
        learner.observe(
            &Observation::new(
                entry.place.clone(),
                SessionId::derive(&data.dataset.name),
                times[index],
                &data.extracted[index].features,
                data.extracted[index].image_size,
            )
            .with_source(entry.id.clone()),
        )?;
    }
    Ok(learner.snapshot()?)
}

/// Learns the fold's map and answers every query of the fold: its entry with the answers of each
/// run.
pub(crate) fn run_fold(
    data: &ExtractedDataset,
    fold: &Fold,
    arm: &Arm,
    runs: &[Run],
    sizes: &[usize],
) -> Result<Vec<(usize, Vec<RunAnswers>)>> {
    let times = times(&data.dataset, arm)?;
    let snapshot = learn(data, fold, arm, &times)?;
    let localizers = localizers(&snapshot, runs)?;
    let num_live = LearnConfig::preset(arm.preset).features_per_visit();
    let mut answers: Vec<(usize, Vec<RunAnswers>)> = (fold.query.par_iter())
        .map_init(
            || (Scratch::default(), Sweep::new(sizes)),
            |(scratch, sweep), &entry| {
                let sweep = sweep.as_mut().map_err(|error| anyhow::anyhow!("{error}"))?;
                sweep.restart();
                let live = live(data, entry, num_live);
                let query = Query::new(&live)
                    .at(times[entry])
                    .with_image_size(data.extracted[entry].image_size);
                let truth = snapshot.find(&data.dataset.entries[entry].place);
                let said = (localizers.iter())
                    .zip(runs)
                    .map(|(localizer, run)| {
                        answer_query(localizer, run, &query, truth, scratch, sweep)
                    })
                    .collect::<Result<_>>()?;
                Ok((entry, said))
            },
        )
        .collect::<Result<_>>()?;
    follow(&data.dataset, fold, runs, &localizers, sizes, &mut answers)?;
    Ok(answers)
}

/// One localizer for each run.
pub(crate) fn localizers(snapshot: &Arc<Snapshot>, runs: &[Run]) -> Result<Vec<Localizer>> {
    (runs.iter())
        .map(|run| Ok(Localizer::new(Arc::clone(snapshot), run.localizer.clone())?))
        .collect()
}

/// What one run answers to one query.
fn answer_query(
    localizer: &Localizer,
    run: &Run,
    query: &Query<'_>,
    truth: Option<NodeId>,
    scratch: &mut Scratch,
    sweep: &mut Sweep,
) -> Result<RunAnswers> {
    localizer.sweep(scratch, query, sweep)?;
    let sizes = 0..sweep.sizes().len();
    let answers = (run.scores.iter())
        .map(|&score| {
            (sizes.clone())
                .map(|size| answer(localizer, sweep, score, size))
                .collect()
        })
        .collect();
    let images = if run.follows {
        sizes
            .map(|size| image_answer(localizer, sweep, size))
            .collect()
    } else {
        Vec::new()
    };
    let pairs_compared = sweep.pairs_compared().to_vec();
    let reobserved = match truth {
        // By the most likely features, as in the papers, so once for each model.
        Some(node)
            if localizer.cfg().method().predicts()
                && localizer.cfg().choice() == Choice::Likeliest =>
        {
            let selected = localizer.snapshot().node(node).features().len().min(TOP);
            localizer
                .reobserved(scratch, query, node, TOP)?
                .map(|seen| (seen as u32, selected as u32))
        }
        _ => None,
    };
    Ok(RunAnswers {
        answers,
        images,
        pairs_compared,
        reobserved,
    })
}

/// What the image said of every place at the sweep's `size`-th n.
fn image_answer(localizer: &Localizer, sweep: &Sweep, size: usize) -> ImageAnswer {
    let places = places(localizer, sweep, size);
    let (posterior, off_map) = localizer
        .posterior(Score::Likelihood, sweep.sizes()[size], &places)
        .unwrap_or_else(|| (vec![0.0; places.len()], 1.0));
    ImageAnswer {
        scores: places.iter().map(|it| it.by(Score::Likelihood)).collect(),
        posterior,
        off_map,
    }
}

/// What every place scored, by node, at the sweep's `size`-th n.
fn places(localizer: &Localizer, sweep: &Sweep, size: usize) -> Vec<PlaceScores> {
    (0..localizer.snapshot().nodes().len())
        .map(|node| sweep.scores(NodeId(node as u32), size))
        .collect()
}

/// The answer by one score at the sweep's `size`-th n.
fn answer(localizer: &Localizer, sweep: &Sweep, score: Score, size: usize) -> Answer {
    let nodes = localizer.snapshot().nodes();
    let name = |node: usize| nodes[node].key().as_str().to_owned();
    let places = places(localizer, sweep, size);
    let scores: Vec<f64> = places.iter().map(|it| it.by(score)).collect();
    let best = scores.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let weighed = localizer.posterior(score, sweep.sizes()[size], &places);
    let posterior = weighed
        .as_ref()
        .map_or_else(BTreeMap::new, |(shares, off_map)| {
            named_posterior(shares, *off_map, &name)
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
        (Some((shares, off_map)), Score::Likelihood) => {
            let node = NodeId(first[0] as u32);
            decided(localizer.decide(node, shares, *off_map), &name)
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
}
