//! A history is the set of its observations, whatever way they came.

use fremen_grid::{CellState, ErrorKind, GridSpec, History, Outcome, Patch, Time};
use proptest::prelude::*;

use crate::twin::{Seen, arb_patch, arb_seen, series};

fn history(spec: GridSpec, seen: &[Seen]) -> History {
    let mut history = History::new(spec);
    for it in seen {
        history
            .observe_as(it.observer, &it.patch, Time::from_us(it.us))
            .unwrap();
    }
    history
}

/// Every observation that saw a cell, from its runs.
fn from_runs(history: &History, cell: [u32; 3]) -> (u32, u32) {
    let runs = history.runs(cell);
    let sum = |state| runs.iter().filter(|it| it.2 == state).map(|it| it.1).sum();
    (sum(CellState::Free), sum(CellState::Occupied))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn nothing_is_lost((spec, seen) in arb_seen(20)) {
        let history = history(spec, &seen);
        prop_assert_eq!(history.num_observations(), seen.len());
        for index in 0..spec.num_cells() {
            let cell = spec.cell(index);
            let expected = series(&seen, cell);
            let occupied = expected.iter().filter(|it| it.1).count() as u32;
            let (num_free, num_occupied) = from_runs(&history, cell);
            prop_assert_eq!((num_free, num_occupied), (expected.len() as u32 - occupied, occupied));
            let last = expected.last().map(|&(time, it)| {
                (time, if it { CellState::Occupied } else { CellState::Free })
            });
            prop_assert_eq!(history.last_seen(cell), last);
        }
    }

    #[test]
    fn the_order_of_observations_does_not_show(
        (spec, seen, shuffled) in arb_seen(12).prop_flat_map(|(spec, seen)| {
            (Just(spec), Just(seen.clone()), Just(seen).prop_shuffle())
        }),
    ) {
        prop_assert_eq!(history(spec, &seen), history(spec, &shuffled));
    }

    #[test]
    fn merging_is_commutative_associative_and_idempotent(
        (spec, seen, parts) in arb_seen(16).prop_flat_map(|(spec, seen)| {
            let num = seen.len();
            (Just(spec), Just(seen), prop::collection::vec(1_u8..8, num))
        }),
    ) {
        // Each observation is in one, two or all of the three.
        let part = |bit: u8| {
            let mine: Vec<Seen> = (seen.iter().zip(&parts))
                .filter(|(_, part)| *part & bit != 0)
                .map(|(seen, _)| seen.clone())
                .collect();
            history(spec, &mine)
        };
        let (a, b, c) = (part(1), part(2), part(4));
        let merge = |a: &History, b: &History| {
            let mut merged = a.clone();
            merged.merge(b).unwrap();
            merged
        };
        let all = history(spec, &seen);
        prop_assert_eq!(merge(&a, &b), merge(&b, &a));
        prop_assert_eq!(&merge(&merge(&a, &b), &c), &all);
        prop_assert_eq!(&merge(&a, &merge(&b, &c)), &all);
        prop_assert_eq!(&merge(&all, &b), &all);
        prop_assert_eq!(merge(&a, &a), a);
    }

    #[test]
    fn what_was_seen_before_is_known_and_what_differs_is_a_conflict(
        (spec, seen, at, other) in arb_seen(8).prop_flat_map(|(spec, seen)| {
            let num = seen.len();
            (Just(spec), Just(seen), 0..num, arb_patch(spec))
        }),
    ) {
        let mut grown = history(spec, &seen);
        let before = grown.clone();
        let again = &seen[at];
        let time = Time::from_us(again.us);
        let verdict = grown.observe_as(again.observer, &again.patch, time).unwrap();
        prop_assert_eq!(verdict.outcome, Outcome::AlreadyKnown);
        prop_assert_eq!(&grown, &before);
        let differs = (0..spec.num_cells())
            .any(|index| other.get(spec.cell(index)) != again.patch.get(spec.cell(index)));
        let result = grown.observe_as(again.observer, &other, time);
        if differs {
            prop_assert_eq!(result.unwrap_err().kind(), ErrorKind::Conflict);
        } else {
            prop_assert_eq!(result.unwrap().outcome, Outcome::AlreadyKnown);
        }
        prop_assert_eq!(&grown, &before);
    }

    #[test]
    fn what_is_forgotten_was_never_there((spec, seen) in arb_seen(16), hour in 0_i64..60) {
        let time = Time::from_us(hour * 3_600_000_000);
        let mut forgetful = history(spec, &seen);
        forgetful.forget_before(time);
        let kept: Vec<Seen> = seen.into_iter().filter(|it| it.us >= time.as_us()).collect();
        prop_assert_eq!(forgetful, history(spec, &kept));
    }

    #[test]
    fn a_stream_of_frames_is_its_observations(
        (spec, view, frames) in arb_seen(2).prop_flat_map(|(spec, _)| {
            let num = spec.num_cells() as u32;
            let changes = prop::collection::vec((0..num, any::<bool>()), 0..6);
            (Just(spec), arb_patch(spec), prop::collection::vec(changes, 0..30))
        }),
    ) {
        let state = |is_occupied| if is_occupied { CellState::Occupied } else { CellState::Free };
        let mut patch = view.clone();
        let mut single = History::new(spec);
        let mut streamed = History::new(spec);
        single.observe_as("camera", &patch, Time::from_s(0)).unwrap();
        let (_, mut stream) = streamed.frames("camera", &view, Time::from_s(0)).unwrap();
        for (i, changes) in frames.iter().enumerate() {
            // Only cells that the first frame knows.
            let changes: Vec<_> = (changes.iter())
                .filter(|(index, _)| view.get(spec.cell(*index as usize)).is_known())
                .map(|&(index, is_occupied)| (index, state(is_occupied)))
                .collect();
            for &(index, state) in &changes {
                patch.set(spec.cell(index as usize), state);
            }
            let time = Time::from_s(5 * (i as i64 + 1));
            single.observe_as("camera", &patch, time).unwrap();
            stream.push(time, &changes).unwrap();
        }
        drop(stream);
        prop_assert_eq!(single, streamed);
    }
}

fn plain(spec: &GridSpec, state: CellState) -> Patch {
    Patch::new([0; 3], spec.dims(), vec![state; spec.num_cells()]).unwrap()
}

#[test]
fn a_frame_that_comes_late_or_names_a_cell_out_of_view_changes_nothing() {
    let spec = GridSpec::new_2d([0.0; 2], 1.0, [40, 40]).unwrap();
    let mut history = History::new(spec);
    let view = Patch::new([0; 3], [16, 16, 1], vec![CellState::Free; 256]).unwrap();
    let (_, mut stream) = history.frames("camera", &view, Time::from_s(10)).unwrap();
    let occupied = CellState::Occupied;
    let error = stream.push(Time::from_s(10), &[]).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Time);
    let error = stream
        .push(Time::from_s(11), &[(0, occupied), (20, occupied)])
        .unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Shape);
    assert!(
        stream
            .push(Time::from_s(11), &[(u32::MAX, occupied)])
            .is_err()
    );
    stream.push(Time::from_s(12), &[(1, occupied)]).unwrap();
    drop(stream);
    assert_eq!(history.num_observations(), 2);
    assert_eq!(
        history.last_seen([0, 0, 0]),
        Some((Time::from_s(12), CellState::Free))
    );
    assert_eq!(
        history.last_seen([1, 0, 0]),
        Some((Time::from_s(12), occupied))
    );
    assert!(history.frames("camera", &view, Time::from_s(12)).is_err());
}

#[test]
fn far_and_equal_times_are_kept_apart() {
    let spec = GridSpec::new_2d([0.0; 2], 1.0, [3, 3]).unwrap();
    let mut history = History::new(spec);
    let (free, occupied) = (
        plain(&spec, CellState::Free),
        plain(&spec, CellState::Occupied),
    );
    for us in [i64::MIN, 0, i64::MAX] {
        history.observe_as("a", &free, Time::from_us(us)).unwrap();
        history
            .observe_as("b", &occupied, Time::from_us(us))
            .unwrap();
    }
    assert_eq!(history.num_observations(), 6);
    assert_eq!(from_runs(&history, [1, 1, 0]), (3, 3));
    let names: Vec<_> = history
        .observation_names()
        .map(|it| it.1.to_owned())
        .collect();
    assert_eq!(names, ["a", "b", "a", "b", "a", "b"]);
}

#[test]
fn a_patch_outside_and_a_grid_of_other_cells_are_refused() {
    let spec = GridSpec::new_2d([0.0; 2], 1.0, [3, 3]).unwrap();
    let other = GridSpec::new_2d([0.5, 0.0], 1.0, [3, 3]).unwrap();
    let mut history = History::new(spec);
    let outside = Patch::new([1, 0, 0], [3, 1, 1], vec![CellState::Free; 3]).unwrap();
    let error = history.observe(&outside, Time::from_s(0)).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Shape);
    let huge = Patch::new([u32::MAX, 0, 0], [1, 1, 1], vec![CellState::Free]).unwrap();
    assert!(history.observe(&huge, Time::from_s(0)).is_err());
    assert_eq!(
        history.merge(&History::new(other)).unwrap_err().kind(),
        ErrorKind::Shape
    );
    assert_eq!(history.num_observations(), 0);
}

/// An observation of which every cell is unknown still is one, of nothing.
#[test]
fn an_observation_that_sees_nothing_is_remembered() {
    let spec = GridSpec::new_2d([0.0; 2], 1.0, [3, 3]).unwrap();
    let mut history = History::new(spec);
    let nothing = Patch::new_whole(&spec);
    history.observe(&nothing, Time::from_s(1)).unwrap();
    assert_eq!(history.num_observations(), 1);
    assert_eq!(history.memory().num_tiles, 0);
    assert_eq!(history.last_seen([0, 0, 0]), None);
    let again = history.observe(&nothing, Time::from_s(1)).unwrap();
    assert_eq!(again.outcome, Outcome::AlreadyKnown);
}

#[test]
fn a_cell_that_never_changes_costs_less_than_a_byte_and_forgetting_frees_memory() {
    let spec = GridSpec::new_2d([0.0; 2], 0.05, [1_000, 1_000]).unwrap();
    let mut history = History::new(spec);
    let free = plain(&spec, CellState::Free);
    for hour in 0..5 {
        history.observe(&free, Time::from_s(hour * 3600)).unwrap();
    }
    let bytes = history.memory().total_bytes();
    assert!(bytes < spec.num_cells(), "{bytes} bytes");
    let mut changed = free.clone();
    for x in 0..1_000 {
        changed.set([x, 500, 0], CellState::Occupied);
    }
    let verdict = history.observe(&changed, Time::from_s(90_000)).unwrap();
    assert_eq!(verdict.num_changed, 1_000);
    let forgotten = history.forget_before(Time::from_s(90_000));
    assert_eq!(forgotten.num_observations, 5);
    assert!(forgotten.num_bytes >= 1_000 * 32, "{forgotten:?}");
    assert_eq!(history.memory().num_changing_cells, 0);
}
