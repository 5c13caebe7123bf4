//! How does p(t) of some models run over what came?

use anyhow::Result;
use chronotope::{Period, Time};

use super::data::{Series, SeriesDataset, State};
use super::models::{BASELINE, DEFAULT, Instant, forecasts};
use super::results::Drawing;
use super::sampling::Sampling;
use crate::results::RowOrder;

/// Points of a drawn p(t).
const NUM_DRAWN: usize = 700;

/// Series that are drawn.
const MAX_DRAWN: usize = 4;

/// p(t) of three models over the query time, learnt from everything and from office hours.
pub(super) fn drawings(dataset: &SeriesDataset, share: f64) -> Result<Vec<Drawing>> {
    const DRAWN: [(&str, RowOrder); 3] = [
        (BASELINE, RowOrder::Fixed(0)),
        ("fremen-running-mean", RowOrder::Fixed(2)),
        (DEFAULT, RowOrder::Auto),
    ];
    // The liveliest series, since one that never changes shows nothing.
    let mut series: Vec<&Series> = dataset.series.iter().collect();
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
                    RowOrder::Fixed(order @ 1..) => format!("{model}, order {order}"),
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
