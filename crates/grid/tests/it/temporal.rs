//! A prediction is what the definitions give from all observations.

use fremen::{CandidatePeriods, Period};
use fremen_grid::{
    CellModel, CellState, ErrorKind, GridConfig, GridSpec, OccupancyMap, Patch, Persistence,
    TemporalGrid, Time,
};
use proptest::prelude::*;

use crate::twin::{Seen, arb_seen, folded, predict, series};

fn arb_config() -> impl Strategy<Value = GridConfig> {
    let day = Period::DAY;
    let fremen = |order| {
        let candidates = CandidatePeriods::harmonic(Period::DAY, 5).unwrap();
        CellModel::Fremen { candidates, order }
    };
    let model = prop_oneof![
        (0_usize..4).prop_map(fremen),
        (1_usize..30).prop_map(move |num_bins| CellModel::Histogram {
            period: day,
            num_bins
        }),
        Just(CellModel::Mean),
        Just(CellModel::LastObservation),
    ];
    let persistence = prop_oneof![
        Just(Persistence::None),
        Just(Persistence::State),
        Just(Persistence::Surprise),
    ];
    (model, persistence).prop_map(|(model, persistence)| {
        GridConfig::new(model)
            .unwrap()
            .with_persistence_of(persistence)
            .with_guards(false)
    })
}

fn grid(spec: GridSpec, seen: &[Seen], config: &GridConfig) -> TemporalGrid {
    let mut grid = TemporalGrid::new(spec, config.clone());
    for it in seen {
        grid.observe_as(it.observer, &it.patch, Time::from_us(it.us))
            .unwrap();
    }
    grid
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn a_folded_cell_is_what_its_observations_say_of_its_strongest_period(
        (spec, seen) in arb_seen(40),
        levels in 0_u32..4,
        hour in -10_i64..200,
    ) {
        let candidates = CandidatePeriods::harmonic(Period::DAY, 5).unwrap();
        let num_bins = 6 << levels;
        let model = CellModel::Folded { candidates, num_bins };
        let config = GridConfig::new(model).unwrap().with_persistence(false).with_guards(false);
        // Full hours are edges of parts, on either side of which rounding may put them.
        let off_us = 433_000_000;
        let seen: Vec<Seen> = seen.into_iter().map(|it| Seen { us: it.us + off_us, ..it }).collect();
        let mut grid = grid(spec, &seen, &config);
        let time = Time::from_us(hour * 3_600_000_000 + off_us);
        let fitted = grid.fitted();
        for index in 0..spec.num_cells() {
            let cell = spec.cell(index);
            let all = series(&seen, cell);
            if let Some((period_s, _)) = fitted.strongest_rhythm(cell) {
                let expected = folded(&all, period_s, num_bins, time);
                let found = fitted.p(cell, time).unwrap();
                prop_assert!((found - expected).abs() < 1e-5, "{:?}: {} {}", cell, found, expected);
            }
        }
    }

    #[test]
    fn a_map_is_what_the_dense_twin_predicts(
        (spec, seen) in arb_seen(20),
        config in arb_config(),
        hour in -10_i64..200,
    ) {
        let mut grid = grid(spec, &seen, &config);
        // Not at an edge of a bin.
        let time = Time::from_us(hour * 3_600_000_000 + 1);
        let mut map = OccupancyMap::new_unknown(spec);
        grid.predict_into(time, &mut map).unwrap();
        let fitted = grid.fitted();
        let mut entropy = 0.0;
        for index in 0..spec.num_cells() {
            let cell = spec.cell(index);
            let expected = predict(&series(&seen, cell), &config, time);
            let found = map.get(index).map(f64::from);
            prop_assert_eq!(found.is_some(), expected.is_some(), "{:?}", cell);
            if let (Some(found), Some(expected)) = (found, expected) {
                prop_assert!((found - expected).abs() < 1e-5, "{:?}: {} {}", cell, found, expected);
            }
            prop_assert_eq!(fitted.p(cell, time), found);
            let explanation = fitted.explain(cell, time).unwrap();
            let all = series(&seen, cell);
            prop_assert_eq!(explanation.num_observed as usize, all.len());
            let occupied = all.iter().filter(|it| it.1).count();
            prop_assert_eq!(explanation.num_occupied as usize, occupied);
            let changes = all.windows(2).filter(|pair| pair[0].1 != pair[1].1).count();
            prop_assert_eq!(explanation.num_changes as usize, changes);
            let bits = |p: f64| if p > 0.0 { -p * p.log2() } else { 0.0 };
            entropy += found.map_or(1.0, |p| bits(p) + bits(1.0 - p));
        }
        let whole = fitted.entropy([0; 3], spec.dims(), time).unwrap();
        prop_assert!((whole - entropy).abs() < 1e-6 * entropy.max(1.0));
    }

    #[test]
    fn models_that_are_brought_up_to_date_are_models_made_anew(
        (spec, seen) in arb_seen(14),
        config in arb_config(),
    ) {
        let time = Time::from_us(77 * 3_600_000_000);
        let mut map = OccupancyMap::new_unknown(spec);
        let mut stepwise = TemporalGrid::new(spec, config.clone());
        // The second half first, so that some come late.
        let (early, late) = seen.split_at(seen.len() / 2);
        for it in late.iter().chain(early) {
            stepwise.observe_as(it.observer, &it.patch, Time::from_us(it.us)).unwrap();
            stepwise.predict_into(time, &mut map).unwrap();
        }
        let mut anew = OccupancyMap::new_unknown(spec);
        grid(spec, &seen, &config).predict_into(time, &mut anew).unwrap();
        prop_assert_eq!(map, anew);
    }

    #[test]
    fn threads_do_not_show((spec, seen) in arb_seen(14), config in arb_config()) {
        let time = Time::from_us(77 * 3_600_000_000);
        let predict = |num_threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(num_threads).build().unwrap();
            pool.install(|| {
                let mut map = OccupancyMap::new_unknown(spec);
                grid(spec, &seen, &config).predict_into(time, &mut map).unwrap();
                map
            })
        };
        prop_assert_eq!(predict(1), predict(3));
    }
}

#[test]
fn a_period_that_the_history_is_too_short_for_is_left_out() {
    let spec = GridSpec::new_2d([0.0; 2], 1.0, [1, 1]).unwrap();
    let candidates = CandidatePeriods::list(vec![Period::DAY, Period::HOUR]).unwrap();
    let config = GridConfig::fremen(candidates, 2).unwrap();
    let mut grid = TemporalGrid::new(spec, config.clone());
    let patch = |is_occupied: bool| {
        let state = if is_occupied {
            CellState::Occupied
        } else {
            CellState::Free
        };
        Patch::new([0; 3], [1, 1, 1], vec![state]).unwrap()
    };
    // Five hours, every ten minutes.
    for i in 0..30 {
        grid.observe(&patch(i % 6 < 2), Time::from_s(i * 600))
            .unwrap();
    }
    let explain = |grid: &mut TemporalGrid| {
        grid.fitted()
            .explain([0; 3], Time::from_s(20_000))
            .unwrap()
            .rhythms
    };
    let periods: Vec<f64> = explain(&mut grid).iter().map(|it| it.period_s).collect();
    assert_eq!(periods, [3600.0]);
    grid.set_config(config.with_guards(false));
    assert_eq!(explain(&mut grid).len(), 2);
}

#[test]
fn maps_and_cells_of_other_grids_are_refused() {
    let spec = GridSpec::new_2d([0.0; 2], 1.0, [5, 5]).unwrap();
    let other = GridSpec::new_2d([0.0; 2], 1.0, [5, 6]).unwrap();
    let mut grid = TemporalGrid::new(spec, GridConfig::default());
    let mut map = OccupancyMap::new_unknown(other);
    let error = grid.predict_into(Time::from_s(0), &mut map).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Shape);
    let fitted = grid.fitted();
    assert_eq!(fitted.p([9, 9, 0], Time::from_s(0)), None);
    assert!(fitted.explain([5, 0, 0], Time::from_s(0)).is_err());
    assert!(fitted.entropy([0; 3], [6, 1, 1], Time::from_s(0)).is_err());
    assert!(GridConfig::fremen(CandidatePeriods::calendar(), 17).is_err());
}
