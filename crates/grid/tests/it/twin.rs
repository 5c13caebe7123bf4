//! A dense grid that keeps every observation of every cell: slow, simple, right.

use fremen::spectrum::strongest;
use fremen_grid::{CellModel, CellState, GridConfig, GridSpec, Patch, Persistence, Time};
use proptest::prelude::*;

/// What one observer saw at one time.
#[derive(Clone, Debug)]
pub(crate) struct Seen {
    pub(crate) us: i64,
    pub(crate) observer: &'static str,
    pub(crate) patch: Patch,
}

pub(crate) fn arb_spec() -> impl Strategy<Value = GridSpec> {
    let planar = (1_u32..40, 1_u32..40)
        .prop_map(|(w, h)| GridSpec::new_2d([0.0, -1.0], 0.5, [w, h]).unwrap());
    let solid = prop::array::uniform3(1_u32..20)
        .prop_map(|dims| GridSpec::new_3d([0.0; 3], 0.5, dims).unwrap());
    prop_oneof![planar, solid]
}

fn arb_state() -> impl Strategy<Value = CellState> {
    prop_oneof![
        2 => Just(CellState::Free),
        2 => Just(CellState::Occupied),
        1 => Just(CellState::Unknown),
    ]
}

/// Patches anywhere in the grid; most cells of a patch are alike, some differ.
pub(crate) fn arb_patch(spec: GridSpec) -> impl Strategy<Value = Patch> {
    let dims = spec.dims();
    let axis = move |i: usize| (0..dims[i]).prop_flat_map(move |a| (Just(a), a..dims[i]));
    ([axis(0), axis(1), axis(2)], arb_state())
        .prop_flat_map(|(spans, most)| {
            let min = spans.map(|(from, _)| from);
            let dims = spans.map(|(from, to)| to - from + 1);
            let num: usize = dims.iter().map(|&n| n as usize).product();
            let few = prop::collection::vec((0..num, arb_state()), 0..12);
            (Just((min, dims, most, num)), few)
        })
        .prop_map(|((min, dims, most, num), few)| {
            let mut states = vec![most; num];
            for (at, state) in few {
                states[at] = state;
            }
            Patch::new(min, dims, states).unwrap()
        })
}

/// Observations of a grid with unique identities, in the order of these.
pub(crate) fn arb_seen(most: usize) -> impl Strategy<Value = (GridSpec, Vec<Seen>)> {
    arb_spec().prop_flat_map(move |spec| {
        let one = (
            0_i64..60,
            prop::sample::select(vec!["", "a", "b"]),
            arb_patch(spec),
        );
        let seen = prop::collection::vec(one, 1..most).prop_map(|list| {
            let mut seen: Vec<Seen> = (list.into_iter())
                .map(|(hour, observer, patch)| Seen {
                    us: hour * 3_600_000_000,
                    observer,
                    patch,
                })
                .collect();
            seen.sort_by_key(|it| (it.us, it.observer));
            seen.dedup_by_key(|it| (it.us, it.observer));
            seen
        });
        (Just(spec), seen)
    })
}

/// The states of a cell at its observations that saw it, oldest first.
pub(crate) fn series(seen: &[Seen], cell: [u32; 3]) -> Vec<(Time, bool)> {
    let known = seen
        .iter()
        .map(|it| (Time::from_us(it.us), it.patch.get(cell)));
    known
        .filter(|(_, state)| state.is_known())
        .map(|(time, state)| (time, state == CellState::Occupied))
        .collect()
}

/// p(t) from all observations of a cell, by the definitions.
pub(crate) fn predict(series: &[(Time, bool)], config: &GridConfig, time: Time) -> Option<f64> {
    let (last_time, last) = *series.last()?;
    let last = f64::from(u8::from(last));
    let num = series.len() as f64;
    let mean = series.iter().filter(|it| it.1).count() as f64 / num;
    if mean == 0.0 || mean == 1.0 {
        return Some(last);
    }
    let f = |time| periodic(series, config, mean, time);
    if matches!(config.model(), CellModel::LastObservation) {
        return Some(last);
    }
    if !config.persists() {
        return Some(f(time));
    }
    let speed: f64 = (series.windows(2))
        .filter(|pair| pair[0].1 != pair[1].1)
        .map(|pair| pair[1].0.since_s(pair[0].0))
        .filter(|&dt| dt > 0.0)
        .map(|dt| 1.0 / dt)
        .sum();
    let rate = speed / (num - 1.0);
    let weight = (-time.since_s(last_time).abs() * rate).exp();
    Some(match config.persistence() {
        Persistence::Surprise => (f(time) + weight * (last - f(last_time))).clamp(0.0, 1.0),
        _ => last * weight + f(time) * (1.0 - weight),
    })
}

/// f(t) of a cell that is folded over this period: the histogram with the largest evidence among those
/// of one part and of 6, 12, 24 ... up to `num_bins`.
pub(crate) fn folded(series: &[(Time, bool)], period_s: f64, num_bins: usize, time: Time) -> f64 {
    let part = |time: Time, num: usize| {
        let turns = time.as_s() / period_s;
        ((turns - turns.floor()) * num as f64) as usize
    };
    let counts = |num: usize| {
        let mut counts = vec![[0.0; 2]; num];
        for (time, state) in series {
            counts[part(*time, num)][usize::from(*state)] += 1.0;
        }
        counts
    };
    let ln_factorial = |n: f64| (2..=n as u32).map(|it| f64::from(it).ln()).sum::<f64>();
    let evidence = |num: usize| {
        let parts = counts(num).into_iter();
        let logs = parts.map(|[free, occupied]| {
            ln_factorial(free) + ln_factorial(occupied) - ln_factorial(free + occupied + 1.0)
        });
        logs.sum::<f64>()
    };
    let mut best = (evidence(1), 1);
    let mut num = 6;
    while num <= num_bins {
        let found = evidence(num);
        if found > best.0 + 1e-9 {
            best = (found, num);
        }
        num *= 2;
    }
    let counts = counts(best.1);
    let mean = series.iter().filter(|it| it.1).count() as f64 / series.len() as f64;
    let at = part(time, best.1);
    let around = (1..=best.1 / 2).find_map(|distance| {
        let a = counts[(at + distance) % best.1];
        let b = counts[(at + best.1 - distance) % best.1];
        let known: f64 = a.iter().chain(&b).sum();
        (known > 0.0).then(|| (a[1] + b[1] + mean) / (known + 1.0))
    });
    let [free, occupied] = counts[at];
    (occupied + around.unwrap_or(mean)) / (free + occupied + 1.0)
}

/// f(t) of a cell that was seen in both states, with this mean.
fn periodic(series: &[(Time, bool)], config: &GridConfig, mean: f64, time: Time) -> f64 {
    let num = series.len() as f64;
    match config.model() {
        CellModel::Fremen { candidates, order } => {
            let count = candidates.len();
            let mut g = vec![0.0; 2 * count];
            let mut phasors = vec![0.0; 2 * count];
            for &(time, state) in series {
                candidates.phasors_into(time, &mut phasors);
                for (g, phasor) in g.iter_mut().zip(&phasors) {
                    *g += (f64::from(u8::from(state)) - mean) * phasor / num;
                }
            }
            let mut powers: Vec<f64> = (0..count)
                .map(|k| g[k].powi(2) + g[count + k].powi(2))
                .collect();
            let mut selected = vec![0; (*order).min(count)];
            let num_selected = strongest(&mut powers, &mut selected);
            candidates.phasors_into(time, &mut phasors);
            let rhythms = selected[..num_selected].iter().map(|&k| usize::from(k));
            let sum: f64 = rhythms
                .map(|k| 2.0 * (g[k] * phasors[k] + g[count + k] * phasors[count + k]))
                .sum();
            (mean + sum).clamp(0.0, 1.0)
        }
        CellModel::Histogram { period, num_bins } => {
            let bin = |time: Time| (time.phase(*period) * *num_bins as f64) as usize;
            let same: Vec<bool> = series
                .iter()
                .filter(|it| bin(it.0) == bin(time))
                .map(|it| it.1)
                .collect();
            match same.len() {
                0 => mean,
                n => same.iter().filter(|&&it| it).count() as f64 / n as f64,
            }
        }
        _ => mean,
    }
}
