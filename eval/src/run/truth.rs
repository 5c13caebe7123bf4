//! How far is predicted visibility from the truth?
//!
//! In the rendered street the probability p(t) with which each element is drawn is known. Here
//! every element is a feature that the camera never misses and never mistakes: it is born when it
//! is first drawn, its history over the learnt rounds is fitted by each model, and its predicted
//! p(t) is held against the true one at the query rounds. So this judges temporal models alone,
//! without extraction and matching. Elements that no learnt round shows are not features.
//!
//! The error is `mean |p - truth|` over elements and rounds. A model that knew the truth would
//! score 0; no model can, because a history of a few dozen rounds of 0 and 1 does not determine p
//! exactly.

use anyhow::Result;
use chronotope::Time;
use chronotope::dataset::synthetic::{Schedule, World, WorldConfig};
use chronotope::visibility::{BitRow, HistoryLog, VisibilityConfig, Visits, fit};
use rayon::prelude::*;

use crate::judge::statistics::Sample;
use crate::results::VisibilityError;

/// What is compared: its name, and the model in TOML.
const MODELS: [(&str, &str); 9] = [
    ("mean", "model = { kind = 'mean' }"),
    (
        "year/1..12, order 1 (unguarded)",
        "model = { kind = 'fremen', candidates = { base-s = 31556952.0, count = 12 }, order = 1 }",
    ),
    (
        "year/1..12, order 2 (unguarded)",
        "model = { kind = 'fremen', candidates = { base-s = 31556952.0, count = 12 }, order = 2 }",
    ),
    (
        "year and day, order 2",
        "model = { kind = 'fremen', candidates = { periods-s = [31556952.0, 86400.0] }, order = 2 }",
    ),
    ("natural", "model = { kind = 'natural' }"),
    (
        "histogram of the year, 12 bins",
        "model = { kind = 'histogram', period-s = 31556952.0, num-bins = 12 }",
    ),
    (
        "histogram of the day, 24 bins",
        "model = { kind = 'histogram', period-s = 86400.0, num-bins = 24 }",
    ),
    ("markov", "model = { kind = 'markov' }"),
    (
        "persistent mean",
        "model = { kind = 'persistent', of = { kind = 'mean' } }",
    ),
];

/// The name of the model that the default configuration uses.
const DEFAULT: &str = "rhythms";

/// Errors of each model over the worlds `1..=num_seeds`, whose rounds are the schedule's; one group
/// of the interval is one world.
pub(super) fn visibility_errors(
    num_seeds: u64,
    num_learn: usize,
    num_query: usize,
    rhythms: bool,
) -> Result<Vec<VisibilityError>> {
    let mut models = vec![(DEFAULT, VisibilityConfig::rhythms())];
    for (name, text) in MODELS {
        models.push((name, VisibilityConfig::from_toml(text)?));
    }
    let worlds: Vec<Vec<f64>> = (1..=num_seeds)
        .into_par_iter()
        .map(|seed| {
            let world = World::new(&WorldConfig::new(seed).with_rhythms(rhythms))?;
            let schedule = Schedule::standard(seed, num_learn, num_query);
            (models.iter())
                .map(|(_, cfg)| error_in(&world, &schedule, cfg))
                .collect()
        })
        .collect::<Result<_>>()?;
    let errors = models.iter().enumerate().map(|(at, (name, _))| {
        let of_worlds = worlds.iter().map(|errors| (None, errors[at]));
        let error = Sample::grouped(of_worlds).estimate();
        VisibilityError {
            model: (*name).into(),
            is_default: *name == DEFAULT,
            mean: error.mean,
            ci_low: error.interval.low,
            ci_high: error.interval.high,
        }
    });
    Ok(errors.collect())
}

/// The mean error of one model in one world.
fn error_in(world: &World, schedule: &Schedule, cfg: &VisibilityConfig) -> Result<f64> {
    let (mut sum, mut count) = (0.0, 0_u64);
    for place in 0..world.places().len() {
        let (log, elements) = history(world, place, &schedule.learn)?;
        let model = fit(&log, cfg, Visits::All)?;
        let mut predicted = vec![0.0; elements.len()];
        for &time in &schedule.query {
            model.predict_into(time, &mut predicted);
            for (&element, p) in elements.iter().zip(&predicted) {
                let truth = world.truth(place)[element as usize].visibility(time);
                sum += (p - truth).abs();
                count += 1;
            }
        }
    }
    Ok(sum / count.max(1) as f64)
}

/// Which elements were drawn at `times`, and the element that each feature of the log is.
fn history(world: &World, place: usize, times: &[Time]) -> Result<(HistoryLog, Vec<u32>)> {
    let mut log = HistoryLog::new();
    let mut elements: Vec<u32> = Vec::new();
    for &time in times {
        let shown = world.shown(place, time, 0);
        let known = elements.len();
        elements.extend(
            (shown.iter())
                .filter(|element| !elements[..known].contains(element))
                .copied()
                .collect::<Vec<_>>(),
        );
        let mut seen = BitRow::zeros(elements.len());
        (elements.iter().enumerate())
            .filter(|(_, element)| shown.binary_search(element).is_ok())
            .for_each(|(feature, _)| seen.set(feature));
        log.push_visit(time, seen, None)?;
    }
    Ok((log, elements))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn features_are_the_elements_from_the_first_time_they_are_drawn() {
        let world = World::new(&WorldConfig::new(1)).unwrap();
        let times = Schedule::standard(1, 12, 1).learn;
        let (log, elements) = history(&world, 2, &times).unwrap();
        assert_eq!(log.num_features(), elements.len());
        for (feature, &element) in elements.iter().enumerate() {
            let drawn: Vec<bool> = (times.iter())
                .map(|&time| world.shown(2, time, 0).contains(&element))
                .collect();
            assert_eq!(log.birth(feature), drawn.iter().position(|&is| is).unwrap());
            for (visit, &is_drawn) in drawn.iter().enumerate().skip(log.birth(feature)) {
                assert_eq!(log.seen_row(visit).get(feature), is_drawn);
            }
        }
    }

    #[test]
    fn a_model_that_knows_the_rhythm_is_nearer_to_the_truth_and_no_model_invents_one() {
        let error = |rhythms: bool, name: &str| {
            let errors = visibility_errors(2, 30, 6, rhythms).unwrap();
            assert_eq!(errors.iter().filter(|it| it.is_default).count(), 1);
            let of_name = errors.iter().find(|it| it.model == name).unwrap();
            assert!(of_name.ci_low <= of_name.mean && of_name.mean <= of_name.ci_high);
            of_name.mean
        };
        assert!(error(true, DEFAULT) < error(true, "mean") - 0.01);
        assert!(error(false, DEFAULT) < error(false, "mean") + 0.01);
        assert!(error(false, "year/1..12, order 2 (unguarded)") > error(false, "mean"));
    }
}
