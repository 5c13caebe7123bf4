//! How well is one state foretold, and from which samples?
//!
//! A series' suite learns 0/1 series (a door, a person in a room, an edge that can be traversed) and asks for
//! a stretch of time that no model has seen. What may be learnt is thinned in three ways
//! ([`Sampling`]); every model is judged by the share of wrong states at p >= 1/2, by the Brier score
//! and by the log loss. Intervals are bootstraps over blocks of time, because a door that is open stays open;
//! the difference to the mean is paired block by block.

pub mod data;
pub mod models;
pub mod sampling;
mod spectrum;

use std::path::Path;

use anyhow::{Context, Result, bail};
use chronotope::{Period, Time};
use rayon::prelude::*;
use serde::Serialize;

use crate::judge::statistics::{Estimate, Sample};
use crate::provenance::{commit, machine};
use crate::results::{Order, write_atomically};
use crate::run::RunOptions;
use crate::suite::{Protocol, Suite};
use data::{Material, Series, State};
use models::{BASELINE, DEFAULT, Forecast, Instant, LITERAL, forecasts};
use sampling::Sampling;
pub use spectrum::{Line, Spectrum};

/// Log loss takes p no closer to 0 or 1 than this, since one certain mistake would be infinite.
const LEAST_P: f64 = 1e-3;

/// With fewer days than this among what is asked for, blocks are hours.
const MIN_DAYS: usize = 5;

/// Points of a drawn p(t).
const NUM_DRAWN: usize = 700;

/// Series that are drawn.
const MAX_DRAWN: usize = 4;

/// The version of the file.
const SCHEMA_VERSION: u32 = 1;

/// A number with its 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Measured {
    /// The value.
    pub value: f64,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
}

impl From<Estimate> for Measured {
    fn from(estimate: Estimate) -> Self {
        Self {
            value: estimate.mean,
            low: estimate.interval.low,
            high: estimate.interval.high,
        }
    }
}

/// One model, at one order, learnt from one sampling of all series of the suite.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// The model that the documentation recommends.
    pub is_default: bool,
    /// What it was learnt from.
    pub sampling: Sampling,
    /// Its name.
    pub model: String,
    /// How many rhythms it has, or that it chooses.
    pub order: Order,
    /// Samples learnt, mean over draws.
    pub num_learnt: f64,
    /// Share of wrong states at p >= 1/2 among the samples it was learnt from.
    pub estimation_error: f64,
    /// The same among the unseen ones.
    pub state_error: Measured,
    /// Mean squared difference of p and state.
    pub brier: Measured,
    /// Mean of -ln of the probability given to what came.
    pub log_loss: Measured,
    /// Brier score minus that of the mean, block by block: negative is better.
    pub brier_against_mean: Measured,
    /// State error of each unseen part.
    pub parts: Vec<(String, f64)>,
}

impl Row {
    /// Worse than the mean beyond the interval.
    pub fn is_worse_than_mean(&self) -> bool {
        self.brier_against_mean.low > 0.0
    }
}

/// One series over time, for the report.
#[derive(Clone, Debug)]
pub struct Drawing {
    /// Which series, learnt from what.
    pub title: String,
    /// Stretches of time, in seconds, in which the state was 1.
    pub is_one: Vec<(f64, f64)>,
    /// Times in seconds.
    pub times_s: Vec<f64>,
    /// Names of models with p at these times.
    pub curves: Vec<(String, Vec<f64>)>,
}

/// The file `SUITE.json` of a series' suite, and what its report draws.
#[derive(Clone, Debug, Serialize)]
pub struct SeriesResults {
    schema_version: u32,
    /// The suite's name.
    pub suite: String,
    /// What it asks.
    pub title: String,
    /// Of all files.
    pub dataset_sha256: String,
    /// The revision that was measured.
    pub commit: String,
    /// What it ran on.
    pub machine: String,
    /// The line that produces the file again.
    pub command: String,
    /// What was learnt, what was asked for.
    pub split: String,
    /// What the intervals resample.
    pub blocks: String,
    /// The share of samples that thinning keeps.
    pub share: f64,
    /// Anything else.
    pub notes: Vec<String>,
    /// How many series.
    pub num_series: usize,
    /// Unseen samples.
    pub num_asked: usize,
    /// Every sampling, model and order.
    pub rows: Vec<Row>,
    /// p(t) over the data.
    #[serde(skip)]
    pub drawings: Vec<Drawing>,
    /// What was learnt, as a spectrum over that of its sampling.
    #[serde(skip)]
    pub spectra: Vec<Spectrum>,
}

impl SeriesResults {
    /// The row of a sampling, model and order.
    pub fn row(&self, sampling: Sampling, model: &str, order: Order) -> Option<&Row> {
        let mut rows = self.rows.iter();
        rows.find(|row| row.sampling == sampling && row.model == model && row.order == order)
    }

    /// The recommended model.
    pub fn default_row(&self, sampling: Sampling) -> Option<&Row> {
        let mut rows = self.rows.iter();
        rows.find(|row| row.sampling == sampling && row.is_default)
    }

    /// FreMEn as the papers print it, its order chosen on held-out samples as they do; of the two papers the
    /// one that comes out better.
    pub fn literal(&self, sampling: Sampling) -> Option<&Row> {
        let rows = (LITERAL.iter()).filter_map(|model| self.row(sampling, model, Order::Auto));
        rows.min_by(|a, b| a.brier.value.total_cmp(&b.brier.value))
    }

    /// Writes the file.
    pub fn write(&self, path: &Path) -> Result<()> {
        let mut bytes = serde_json::to_vec_pretty(self)?;
        bytes.push(b'\n');
        Ok(write_atomically(path, &bytes)?)
    }
}

/// Runs a suite of series; `None` if it is none.
pub fn run(suite: &Suite, options: &RunOptions) -> Result<Option<SeriesResults>> {
    let Protocol::Series { form, share } = suite.protocol else {
        return Ok(None);
    };
    let data = options.data.as_deref().with_context(|| {
        format!(
            "suite `{}` needs its series: name their folder with --data DIR or the variable \
             CHRONOTOPE_DATA",
            suite.name
        )
    })?;
    let material = data::read(form, data)?;
    let share = options.share.unwrap_or(share);
    if !(share > 0.0 && share <= 1.0) {
        bail!("--share must be above 0 and at most 1, not {share}");
    }
    let mut results = judge(suite, &material, share)?;
    results.commit = commit();
    results.machine = machine();
    results.command.clone_from(&options.command);
    Ok(Some(results))
}

/// Sums over one block of time: wrong states, squared differences, log losses, samples.
#[derive(Clone, Copy, Default)]
struct Block([f64; 4]);

impl Block {
    fn add(&mut self, p: f64, state: bool) {
        let truth = f64::from(u8::from(state));
        let p_of_truth = if state { p } else { 1.0 - p };
        let [wrong, squares, losses, count] = &mut self.0;
        *wrong += f64::from(u8::from((p >= 0.5) != state));
        *squares += (p - truth).powi(2);
        *losses -= p_of_truth.clamp(LEAST_P, 1.0 - LEAST_P).ln();
        *count += 1.0;
    }
}

/// What one forecast is worth, in sums that draws and series add up to.
struct Score {
    model: &'static str,
    order: Order,
    num_learnt: f64,
    /// Wrong states and samples among what was learnt.
    learnt: [f64; 2],
    blocks: Vec<Block>,
    /// Wrong states and samples of each part.
    parts: Vec<[f64; 2]>,
}

impl Score {
    /// What is known of a forecast before it is asked anything.
    fn new(forecast: &Forecast, num_learnt: usize) -> Self {
        Self {
            model: forecast.model,
            order: forecast.order,
            num_learnt: num_learnt as f64,
            learnt: [0.0; 2],
            blocks: Vec::new(),
            parts: Vec::new(),
        }
    }

    /// Asks all forecasts at each time together, since what depends on the time alone is half of the cost.
    fn of_all(
        forecasts: &[Forecast],
        learnt: &[State],
        series: &Series,
        block: Period,
    ) -> Result<Vec<Self>> {
        let mut scores: Vec<Self> = (forecasts.iter())
            .map(|forecast| Self::new(forecast, learnt.len()))
            .collect();
        let mut at = Instant::new()?;
        for &(time, state) in learnt {
            at.set(time);
            for (score, forecast) in scores.iter_mut().zip(forecasts) {
                let is_wrong = (forecast.p(&at) >= 0.5) != state;
                add(&mut score.learnt, &[f64::from(u8::from(is_wrong)), 1.0]);
            }
        }
        for part in &series.parts {
            for score in &mut scores {
                score.parts.push([0.0; 2]);
            }
            let mut last = None;
            for &(time, state) in &part.states {
                at.set(time);
                let number = time.as_us().div_euclid(block.as_us());
                let is_new = last.replace(number) != Some(number);
                for (score, forecast) in scores.iter_mut().zip(forecasts) {
                    if is_new {
                        score.blocks.push(Block::default());
                    }
                    score.add_answer(forecast.p(&at), state);
                }
            }
        }
        Ok(scores)
    }

    /// Adds an answer to the last block and the last part.
    fn add_answer(&mut self, p: f64, state: bool) {
        if let Some(block) = self.blocks.last_mut() {
            block.add(p, state);
        }
        if let Some(part) = self.parts.last_mut() {
            add(part, &[f64::from(u8::from((p >= 0.5) != state)), 1.0]);
        }
    }

    /// Adds another draw of the same series.
    fn add_draw(&mut self, other: &Self) {
        self.num_learnt += other.num_learnt;
        add(&mut self.learnt, &other.learnt);
        for (block, other) in self.blocks.iter_mut().zip(&other.blocks) {
            add(&mut block.0, &other.0);
        }
        for (part, other) in self.parts.iter_mut().zip(&other.parts) {
            add(part, other);
        }
    }

    /// Adds another series: its blocks are other blocks.
    fn add_series(&mut self, other: &Self) {
        self.num_learnt += other.num_learnt;
        add(&mut self.learnt, &other.learnt);
        self.blocks.extend(&other.blocks);
        for (part, other) in self.parts.iter_mut().zip(&other.parts) {
            add(part, other);
        }
    }

    fn measure(&self, metric: usize) -> Measured {
        let blocks = self
            .blocks
            .iter()
            .map(|Block(sums)| (sums[metric], sums[3]));
        Sample::of_blocks(blocks).estimate().into()
    }

    /// The difference of Brier scores; blocks of draws that one of the two lacks do not exist.
    fn against(&self, other: &Self) -> Measured {
        let blocks = self.blocks.iter().zip(&other.blocks);
        let blocks = blocks.map(|(a, b)| (a.0[1] - b.0[1], a.0[3]));
        Sample::of_blocks(blocks).estimate().into()
    }
}

fn add<const N: usize>(sums: &mut [f64; N], others: &[f64; N]) {
    for (sum, other) in sums.iter_mut().zip(others) {
        *sum += other;
    }
}

fn judge(suite: &Suite, material: &Material, share: f64) -> Result<SeriesResults> {
    let block = block(&material.series);
    let tasks: Vec<(Sampling, &Series, u64)> = (Sampling::ALL.into_iter())
        .flat_map(|sampling| {
            let series = material.series.iter();
            series.flat_map(move |series| {
                (0..sampling.num_draws()).map(move |draw| (sampling, series, draw))
            })
        })
        .collect();
    let bar = crate::progress::progress(tasks.len(), "series");
    // Collected in the order of tasks, whoever finishes first.
    let scores: Vec<Vec<Score>> = (tasks.par_iter())
        .map(|&(sampling, series, draw)| {
            let learnt = sampling.draw(&series.learn, share, draw);
            let forecasts = forecasts(&learnt, |_| true)?;
            let scores = Score::of_all(&forecasts, &learnt, series, block);
            bar.inc(1);
            scores
        })
        .collect::<Result<_>>()?;
    bar.finish_and_clear();
    let mut rows = Vec::new();
    for sampling in Sampling::ALL {
        // First draws of a series, then series of the suite.
        let mut of_series: Vec<(&str, Vec<Score>)> = Vec::new();
        for (&(_, series, _), scores) in tasks.iter().zip(&scores).filter(|(t, _)| t.0 == sampling)
        {
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
        let is_complete = |num: &usize| *num == material.series.len();
        let complete: Vec<&Score> = (total.iter().zip(&num_series))
            .filter(|(_, num)| is_complete(num))
            .map(|(score, _)| score)
            .collect();
        let Some(mean) = complete.iter().find(|score| score.model == BASELINE) else {
            continue;
        };
        let parts = material
            .series
            .first()
            .map_or(&[][..], |series| &series.parts);
        rows.extend(
            complete
                .iter()
                .map(|score| row(score, mean, sampling, parts)),
        );
    }
    let first = material.series.iter().flat_map(|series| &series.parts);
    let mut results = SeriesResults {
        schema_version: SCHEMA_VERSION,
        suite: suite.name.clone(),
        title: suite.title.clone(),
        dataset_sha256: material.sha256.clone(),
        commit: String::new(),
        machine: String::new(),
        command: String::new(),
        split: material.split.clone(),
        blocks: format!("{block} of each series, 95 %, 2,000 draws"),
        share,
        notes: material.notes.clone(),
        num_series: material.series.len(),
        num_asked: first.map(|part| part.states.len()).sum(),
        rows,
        drawings: drawings(material, share)?,
        spectra: spectrum::spectra(material, share)?,
    };
    results.notes.extend(in_words(&results));
    Ok(results)
}

impl Score {
    fn copy(&self) -> Self {
        Self {
            blocks: self.blocks.clone(),
            parts: self.parts.clone(),
            ..*self
        }
    }
}

fn same<'a>(scores: &'a mut [Score], like: &Score) -> Option<&'a mut Score> {
    let mut scores = scores.iter_mut();
    scores.find(|score| score.model == like.model && score.order == like.order)
}

fn row(score: &Score, mean: &Score, sampling: Sampling, parts: &[data::Part]) -> Row {
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
        let mean = results.row(sampling, BASELINE, Order::Fixed(0))?;
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

/// p(t) of three models over what was asked for, learnt from everything and from office hours.
fn drawings(material: &Material, share: f64) -> Result<Vec<Drawing>> {
    const DRAWN: [(&str, Order); 3] = [
        (BASELINE, Order::Fixed(0)),
        ("fremen-running-mean", Order::Fixed(2)),
        (DEFAULT, Order::Auto),
    ];
    // The liveliest series, since one that never changes shows nothing.
    let mut series: Vec<&Series> = material.series.iter().collect();
    let variance = |series: &Series| {
        let ones = series.learn.iter().filter(|state| state.1).count();
        let share = ones as f64 / series.learn.len().max(1) as f64;
        share * (1.0 - share)
    };
    series.sort_by(|a, b| variance(b).total_cmp(&variance(a)));
    let mut drawings = Vec::new();
    for series in series.into_iter().take(MAX_DRAWN) {
        for (sampling, words) in [
            (Sampling::All, "all samples"),
            (Sampling::OfficeHours, "office hours alone"),
        ] {
            let learnt = sampling.draw(&series.learn, share, 0);
            let is_drawn = |model: &str| DRAWN.iter().any(|(drawn, _)| *drawn == model);
            let forecasts = forecasts(&learnt, is_drawn)?;
            let Some(part) = series.parts.last() else {
                continue;
            };
            let (Some(first), Some(last)) = (part.states.first(), part.states.last()) else {
                continue;
            };
            // A week is what a picture can show.
            let week = first.0.plus_us(Period::WEEK.as_us());
            let end = last.0.min(week);
            let span_us = end.as_us() - first.0.as_us();
            let time = |i: usize| first.0.plus_us(span_us / NUM_DRAWN as i64 * i as i64);
            let times: Vec<Time> = (0..=NUM_DRAWN).map(time).collect();
            let mut at = Instant::new()?;
            let shown = DRAWN.iter().filter_map(|(model, order)| {
                let found = forecasts
                    .iter()
                    .find(|f| f.model == *model && f.order == *order)?;
                let name = match order {
                    Order::Fixed(order @ 1..) => format!("{model}, order {order}"),
                    _ => (*model).to_owned(),
                };
                let p = times.iter().map(|&time| {
                    at.set(time);
                    found.p(&at)
                });
                Some((name, p.collect()))
            });
            let curves = shown.collect();
            drawings.push(Drawing {
                title: format!("{}, {}, learnt from {words}", series.name, part.name),
                is_one: stretches(&part.states, end),
                curves,
                times_s: times.iter().map(|time| time.as_s()).collect(),
            });
        }
    }
    Ok(drawings)
}

/// From when to when the state was 1, in seconds, up to `end`.
fn stretches(states: &[State], end: Time) -> Vec<(f64, f64)> {
    let mut stretches: Vec<(f64, f64)> = Vec::new();
    for pair in states
        .windows(2)
        .filter(|pair| pair[0].1 && pair[1].0 <= end)
    {
        let (from, to) = (pair[0].0.as_s(), pair[1].0.as_s());
        match stretches.last_mut() {
            Some((_, last)) if *last >= from => *last = to,
            _ => stretches.push((from, to)),
        }
    }
    stretches
}

/// The results as a table of 100 columns.
pub fn table(results: &SeriesResults) -> String {
    use std::fmt::Write as _;
    let mut text = format!("Suite {}: {}\n", results.suite, results.title);
    for (name, value) in facts(results) {
        let _ = writeln!(text, "  {name:<11}{value}");
    }
    for sampling in Sampling::ALL {
        let rows: Vec<&Row> = (results.rows.iter())
            .filter(|row| row.sampling == sampling && is_in_table(row))
            .collect();
        let Some(first) = rows.first() else { continue };
        let _ = writeln!(
            text,
            "\nLearnt from {} samples ({:.0} of them)\n{:<24}{:>6}{:>8}{:>6} {:>15} {:>17} {:>6}  parts, wrong %",
            sampling.name(),
            first.num_learnt,
            "model",
            "order",
            "wrong %",
            "Brier",
            "interval",
            "against the mean",
            "log l."
        );
        for row in rows {
            let interval = |m: Measured| format!("[{:.3}, {:.3}]", m.low, m.high);
            let signed = |m: Measured| format!("[{:+.3}, {:+.3}]", m.low, m.high);
            let parts = row
                .parts
                .iter()
                .map(|(_, error)| format!("{:.1}", 100.0 * error));
            let _ = writeln!(
                text,
                "{} {:<22}{:>6}{:>8.1}{:>6.3} {:>15} {:>17} {:>6.3}  {}",
                if row.is_default { '*' } else { ' ' },
                row.model,
                row.order.to_string(),
                100.0 * row.state_error.value,
                row.brier.value,
                interval(row.brier),
                signed(row.brier_against_mean),
                row.log_loss.value,
                parts.collect::<Vec<_>>().join(" ")
            );
        }
    }
    text.push_str("\n* the model that the documentation recommends\n");
    text
}

/// Tables show the orders of the papers' tables; the file and the plots all.
pub(crate) fn is_in_table(row: &Row) -> bool {
    matches!(row.order, Order::Auto | Order::Fixed(0..=3 | 5))
}

/// What was measured on what, and how to measure it again.
pub(crate) fn facts(results: &SeriesResults) -> Vec<(&'static str, String)> {
    let mut facts = vec![
        ("Split", results.split.clone()),
        (
            "Size",
            format!(
                "{} series, {} unseen samples; thinned to {} %",
                results.num_series,
                results.num_asked,
                100.0 * results.share
            ),
        ),
        ("Intervals", format!("bootstrap over {}", results.blocks)),
        ("Digest", results.dataset_sha256.clone()),
        ("Commit", results.commit.clone()),
        ("Machine", results.machine.clone()),
        ("Command", results.command.clone()),
    ];
    facts.extend(results.notes.iter().map(|note| ("Note", note.clone())));
    facts
}
