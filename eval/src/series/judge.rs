//! How good is every model, learnt from every sampling of every series?

use anyhow::Result;
use chronotope::Period;
use rayon::prelude::*;

use super::data::{Part, Series, SeriesDataset};
use super::drawing::drawings;
use super::models::{BASELINE, DEFAULT, forecasts};
use super::results::{Row, SCHEMA_VERSION, SeriesResults};
use super::sampling::Sampling;
use super::score::{Score, same};
use super::spectrum;
use crate::progress::Progress;
use crate::results::RowOrder;
use crate::suite::Suite;

/// With fewer days than this among the queries, blocks are hours.
const MIN_DAYS: usize = 5;

pub(super) fn judge(suite: &Suite, dataset: &SeriesDataset, share: f64) -> Result<SeriesResults> {
    let block = block(&dataset.series);
    let tasks: Vec<(Sampling, &Series, u64)> = (Sampling::ALL.into_iter())
        .flat_map(|sampling| {
            let series = dataset.series.iter();
            series.flat_map(move |series| {
                (0..sampling.num_draws()).map(move |draw| (sampling, series, draw))
            })
        })
        .collect();
    let bar = Progress::new(tasks.len(), "series");
    // Collected in the order of tasks, whoever finishes first.
    let scores: Vec<Vec<Score>> = (tasks.par_iter())
        .map(|&(sampling, series, draw)| {
            let learnt = sampling.draw(&series.learn, share, draw);
            let forecasts = forecasts(&learnt, |_| true)?;
            let scores = Score::of_all(&forecasts, &learnt, series, block);
            bar.inc();
            scores
        })
        .collect::<Result<_>>()?;
    drop(bar);
    let rows = (Sampling::ALL.into_iter())
        .flat_map(|sampling| rows_of(sampling, &tasks, &scores, dataset))
        .collect();
    let first = dataset.series.iter().flat_map(|series| &series.parts);
    let mut results = SeriesResults {
        schema_version: SCHEMA_VERSION,
        suite: suite.name.clone(),
        title: suite.title.clone(),
        dataset_sha256: dataset.sha256.clone(),
        commit: String::new(),
        machine: String::new(),
        command: String::new(),
        split: dataset.split.clone(),
        blocks: format!("{block} of each series, 95 %, 2,000 draws"),
        share,
        notes: dataset.notes.clone(),
        num_series: dataset.series.len(),
        num_queried: first.map(|part| part.states.len()).sum(),
        rows,
        drawings: drawings(dataset, share)?,
        spectra: spectrum::spectra(dataset, share)?,
    };
    results.notes.extend(in_words(&results));
    Ok(results)
}

/// The rows of one sampling: first the draws of each series are added up, then the series.
fn rows_of(
    sampling: Sampling,
    tasks: &[(Sampling, &Series, u64)],
    scores: &[Vec<Score>],
    dataset: &SeriesDataset,
) -> Vec<Row> {
    // First draws of a series, then series of the suite.
    let mut of_series: Vec<(&str, Vec<Score>)> = Vec::new();
    for (&(_, series, _), scores) in tasks.iter().zip(scores).filter(|(t, _)| t.0 == sampling) {
        match of_series.last_mut() {
            Some((name, total)) if *name == series.name => {
                for score in scores {
                    if let Some(total) = same(total, score) {
                        total.add_draw(score);
                    }
                }
            }
            _ => of_series.push((&series.name, scores.iter().map(Score::copy).collect())),
        }
    }
    let mut of_series = of_series.into_iter().map(|(_, scores)| scores);
    let mut total = of_series.next().unwrap_or_default();
    let mut num_series = vec![1; total.len()];
    for scores in of_series {
        for (total, num) in total.iter_mut().zip(&mut num_series) {
            let same = scores
                .iter()
                .find(|s| s.model == total.model && s.order == total.order);
            if let Some(score) = same {
                total.add_series(score);
                *num += 1;
            }
        }
    }
    // A model that some of the series do not allow would be compared on others than the rest.
    let is_complete = |num: &usize| *num == dataset.series.len();
    let complete: Vec<&Score> = (total.iter().zip(&num_series))
        .filter(|(_, num)| is_complete(num))
        .map(|(score, _)| score)
        .collect();
    let Some(mean) = complete.iter().find(|score| score.model == BASELINE) else {
        return Vec::new();
    };
    let parts = dataset
        .series
        .first()
        .map_or(&[][..], |series| &series.parts);
    (complete.iter())
        .map(|score| row(score, mean, sampling, parts))
        .collect()
}

fn row(score: &Score, mean: &Score, sampling: Sampling, parts: &[Part]) -> Row {
    let share = |[wrong, count]: [f64; 2]| wrong / count.max(1.0);
    Row {
        is_default: score.model == DEFAULT,
        sampling,
        model: score.model.into(),
        order: score.order,
        num_learnt: score.num_learnt / sampling.num_draws() as f64,
        estimation_error: share(score.learnt),
        state_error: score.measure(0),
        brier: score.measure(1),
        log_loss: score.measure(2),
        brier_against_mean: score.against(mean),
        parts: (parts.iter().zip(&score.parts))
            .map(|(part, counts)| (part.name.clone(), share(*counts)))
            .collect(),
    }
}

/// A day, or an hour where there are few days.
fn block(series: &[Series]) -> Period {
    let states = series.iter().flat_map(|series| &series.parts);
    let mut days: Vec<i64> = states
        .flat_map(|part| &part.states)
        .map(|(time, _)| time.as_us().div_euclid(Period::DAY.as_us()))
        .collect();
    days.sort_unstable();
    days.dedup();
    if days.len() >= MIN_DAYS {
        Period::DAY
    } else {
        Period::HOUR
    }
}

/// The recommended model against the papers' and the mean, in sentences.
fn in_words(results: &SeriesResults) -> Vec<String> {
    let said = Sampling::ALL.into_iter().filter_map(|sampling| {
        let (ours, literal) = (results.default_row(sampling)?, results.literal(sampling)?);
        let mean = results.row(sampling, BASELINE, RowOrder::Fixed(0))?;
        let difference = ours.brier_against_mean;
        let change = 100.0 * (ours.brier.value / literal.brier.value - 1.0);
        Some(format!(
            "Samples {}: Brier score {:.3} of {DEFAULT}, {change:+.0} % against FreMEn as printed \
             ({}, order held out, {:.3}); mean {:.3}, difference {:+.3} [{:+.3}, {:+.3}]",
            sampling.name(),
            ours.brier.value,
            literal.model,
            literal.brier.value,
            mean.brier.value,
            difference.value,
            difference.low,
            difference.high,
        ))
    });
    said.collect()
}
