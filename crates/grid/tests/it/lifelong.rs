//! Maps come into a grid file for years: what is doubtful is kept, known again, and harms nothing.

use std::path::Path;

use fremen_grid::file::Access;
use fremen_grid::lifelong::{LifelongGrid, MapId, TakenIn, choose};
use fremen_grid::registration::{GuardConfig, Reason};
use fremen_grid::{
    CellState, ErrorKind, GridConfig, GridFile, GridSpec, History, OccupancyMap, Patch, Result,
    TemporalGrid, Time,
};

const SIZE: [u32; 2] = [60, 40];

fn spec() -> GridSpec {
    GridSpec::new_2d([0.0; 2], 0.05, SIZE).expect("a grid")
}

fn time(hour: i64) -> Time {
    Time::from_s(3_600 * hour)
}

/// A room with two walls inside; the cupboard is open from 8 to 18 o'clock. `moved`: furniture stands
/// somewhere else.
fn room(hour: i64, moved: bool) -> Patch {
    let mut patch = Patch::new_whole(&spec());
    let is_open = (8..18).contains(&hour.rem_euclid(24));
    let [w, h] = SIZE;
    for y in 0..h {
        for x in 0..w {
            let is_wall = y < 2 || y >= h - 2 || x < 2 || x >= w - 2;
            let is_inner = x == 20 && y < 15 || y == 25 && (30..45).contains(&x);
            let is_door = is_open && (6..9).contains(&y) && (40..46).contains(&x);
            let is_moved = moved && (8..16).contains(&x) && (20..28).contains(&y);
            let is_occupied = is_wall || is_inner || is_door || is_moved;
            let state = if is_occupied {
                CellState::Occupied
            } else {
                CellState::Free
            };
            patch.set([x, y, 0], state);
        }
    }
    patch
}

/// The same, turned by half a turn: walls stand where nothing was ever.
fn wrong(hour: i64) -> Patch {
    let right = room(hour, false);
    let mut patch = Patch::new_whole(&spec());
    let [w, h] = SIZE;
    for y in 0..h {
        for x in 0..w {
            patch.set([x, y, 0], right.get([w - 1 - x, h - 1 - y, 0]));
        }
    }
    patch
}

fn open(path: &Path) -> Result<LifelongGrid> {
    LifelongGrid::open(
        path,
        Access::ReadWrite,
        &GridConfig::default(),
        GuardConfig::default(),
        |_, _| {},
    )
}

/// A file of five days, a map every three hours.
fn five_days(path: &Path) -> Result<()> {
    let mut history = History::new(spec());
    for number in 0..40 {
        history.observe_as("robot", &room(3 * number, false), time(3 * number))?;
    }
    let config = GridConfig::default();
    LifelongGrid::create(path, history, &config, GuardConfig::default(), |_, _| {})?;
    Ok(())
}

fn digest(path: &Path) -> [u8; 32] {
    let mut file = GridFile::open(path, Access::ReadOnly).expect("a grid");
    let generations = file.generations().expect("readable");
    generations.last().expect("at least one").digest
}

#[test]
fn a_wrong_map_is_kept_in_the_file_and_can_be_accepted_or_dropped() -> Result<()> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.grid");
    five_days(&path)?;
    let before = GridFile::open(&path, Access::ReadOnly)?.into_history();
    let mut grid = open(&path)?;
    let good = grid.take_in("robot", &room(120, false), time(120), false)?;
    assert!(matches!(good, TakenIn::Integrated(_)), "{good:?}");
    let TakenIn::Quarantined(judgement) = grid.take_in("robot", &wrong(123), time(123), false)?
    else {
        panic!("a map that is turned by half a turn is believed");
    };
    assert!(judgement.reason.is_some());
    assert_eq!(grid.commit()?, 1);
    // What is in the file is what was in memory.
    let mut again = open(&path)?;
    assert_eq!(again.file().history().num_observations(), 41);
    let [held] = again.quarantined() else {
        panic!("one is held");
    };
    assert_eq!(held.judgement, judgement);
    assert_eq!(held.observer, "robot");
    let with_held = digest(&path);
    // The same once more changes nothing, not even the number of generations.
    let taken = again.take_in("robot", &wrong(123), time(123), false)?;
    assert_eq!(taken, TakenIn::QuarantinedBefore(judgement));
    let taken = again.take_in("robot", &room(120, false), time(120), false)?;
    assert_eq!(taken, TakenIn::Known);
    let generation = again.file().generation();
    assert_eq!(again.commit()?, 0);
    assert_eq!(again.file().generation(), generation);
    assert_eq!(digest(&path), with_held);
    assert!(GridFile::verify(&path)?.faults.is_empty());
    // Dropped, it is as if it had never come; a rollback brings it back; accepted, it is observed.
    let id = MapId::new("robot", time(123));
    assert!(again.discard(id) && !again.discard(id));
    again.commit()?;
    assert!(open(&path)?.quarantined().is_empty());
    GridFile::open(&path, Access::ReadWrite)?.rollback(generation)?;
    assert_eq!(digest(&path), with_held);
    let mut again = open(&path)?;
    assert!(again.accept(id)? && !again.accept(id)?);
    assert_eq!(again.commit()?, 1);
    assert!(open(&path)?.quarantined().is_empty());
    let history = GridFile::open(&path, Access::ReadOnly)?.into_history();
    assert_eq!(history.num_observations(), 42);
    assert_eq!(before.num_observations(), 40);
    Ok(())
}

#[test]
fn moved_furniture_is_adopted_across_runs_of_the_command() -> Result<()> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.grid");
    five_days(&path)?;
    let mut outcomes = Vec::new();
    for number in 40..46 {
        // Each patrol is a run of its own: what came before is known from the file alone.
        let mut grid = open(&path)?;
        let taken = grid.take_in("robot", &room(3 * number, true), time(3 * number), false)?;
        grid.commit()?;
        outcomes.push(taken);
    }
    assert!(
        matches!(outcomes[0], TakenIn::Quarantined(it) if it.reason == Some(Reason::Contradiction)),
        "{outcomes:?}"
    );
    assert!(
        matches!(outcomes[2], TakenIn::Adopted { num_maps: 3, .. }),
        "{outcomes:?}"
    );
    assert!(
        outcomes[3..]
            .iter()
            .all(|it| matches!(it, TakenIn::Integrated(_))),
        "{outcomes:?}"
    );
    let grid = open(&path)?;
    assert!(grid.quarantined().is_empty());
    assert_eq!(grid.file().history().num_observations(), 46);
    Ok(())
}

#[test]
fn quarantine_is_bounded_and_says_what_it_dropped() -> Result<()> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.grid");
    five_days(&path)?;
    let guard = GuardConfig {
        num_kept: 4,
        ..GuardConfig::default()
    };
    let config = GridConfig::default();
    // Three nights, in which nothing changes.
    for hour in [120, 123, 126, 144, 147, 150, 168, 171, 174] {
        let mut grid = LifelongGrid::open(&path, Access::ReadWrite, &config, guard, |_, _| {})?;
        // A good one between two wrong ones: they are no rearrangement.
        grid.take_in("robot", &room(hour, false), time(hour), false)?;
        grid.take_in("robot", &wrong(hour + 1), time(hour + 1), false)?;
        grid.commit()?;
    }
    let grid = LifelongGrid::open(&path, Access::ReadOnly, &config, guard, |_, _| {})?;
    assert_eq!((grid.quarantined().len(), grid.num_dropped()), (4, 5));
    // The newest are left.
    assert_eq!(grid.quarantined()[0].judgement.time, time(151));
    assert_eq!(grid.file().history().num_observations(), 49);
    assert!(GridFile::verify(&path)?.faults.is_empty());
    Ok(())
}

#[test]
fn a_map_that_was_moved_is_known_when_it_comes_again_and_another_one_is_refused() -> Result<()> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.grid");
    five_days(&path)?;
    // By one cell: within what a guard that allows it lays back.
    let right = room(120, false);
    let mut shifted = Patch::new_whole(&spec());
    for y in 0..SIZE[1] {
        for x in 1..SIZE[0] {
            shifted.set([x, y, 0], right.get([x - 1, y, 0]));
        }
    }
    let mut grid = open(&path)?;
    let taken = grid.take_in("robot", &shifted, time(120), true)?;
    assert!(matches!(taken, TakenIn::Integrated(_)), "{taken:?}");
    grid.commit()?;
    let mut grid = open(&path)?;
    let number = grid.file().history().num_observations() - 1;
    assert_ne!(grid.file().history().patch(number), shifted);
    let taken = grid.take_in("robot", &shifted, time(120), false)?;
    assert_eq!(taken, TakenIn::Known);
    let error = grid.take_in("robot", &wrong(120), time(120), false);
    assert_eq!(error.expect_err("two maps").kind(), ErrorKind::Conflict);
    Ok(())
}

#[test]
fn grids_merge_with_their_quarantines_in_any_order() -> Result<()> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    for (name, hour) in [("a.grid", 120), ("b.grid", 123)] {
        five_days(&path(name))?;
        let mut grid = open(&path(name))?;
        grid.take_in(name, &wrong(hour), time(hour), false)?;
        grid.commit()?;
    }
    // What one of them holds, another has accepted.
    std::fs::copy(path("a.grid"), path("c.grid")).expect("a copy");
    let mut grid = open(&path("c.grid"))?;
    assert!(grid.accept(MapId::new("a.grid", time(120)))?);
    grid.commit()?;
    GridFile::merge_into(path("ab.grid"), &[path("a.grid"), path("b.grid")])?;
    GridFile::merge_into(path("ba.grid"), &[path("b.grid"), path("a.grid")])?;
    assert_eq!(digest(&path("ab.grid")), digest(&path("ba.grid")));
    assert_eq!(open(&path("ab.grid"))?.quarantined().len(), 2);
    GridFile::merge_into(path("abc.grid"), &[path("ab.grid"), path("c.grid")])?;
    let merged = open(&path("abc.grid"))?;
    assert_eq!(merged.quarantined().len(), 1);
    assert_eq!(merged.file().history().num_observations(), 41);
    Ok(())
}

#[test]
fn a_history_recalls_each_observation_and_what_was_before_it() -> Result<()> {
    let mut whole = History::new(spec());
    let mut prefixes = vec![whole.clone()];
    let mut patches = Vec::new();
    for number in 0..12 {
        let mut patch = room(5 * number, number % 3 == 0);
        // Each sees another part.
        for x in 0..SIZE[0] {
            patch.set([x, (3 * number as u32) % SIZE[1], 0], CellState::Unknown);
        }
        whole.observe_as(["a", "b"][number as usize % 2], &patch, time(number))?;
        prefixes.push(whole.clone());
        patches.push(patch);
    }
    for (num, prefix) in prefixes.iter().enumerate() {
        assert_eq!(&whole.first(num), prefix, "{num}");
    }
    for (number, patch) in patches.iter().enumerate() {
        assert_eq!(&whole.patch(number), patch, "{number}");
    }
    assert_eq!(whole.patch(12), Patch::new_whole(&spec()));
    // What is recalled predicts as what was kept.
    let predict = |history: History| {
        let mut map = OccupancyMap::new_unknown(spec());
        let mut grid = TemporalGrid::from_history(history, GridConfig::default());
        grid.predict_into(time(30), &mut map)
            .expect("the same cells");
        map
    };
    let bits = |map: &OccupancyMap| -> Vec<u32> {
        map.probabilities().iter().map(|p| p.to_bits()).collect()
    };
    assert_eq!(
        bits(&predict(whole.first(7))),
        bits(&predict(prefixes[7].clone()))
    );
    Ok(())
}

/// What `chronotope grid build` wrote before grids had a quarantine.
#[test]
fn a_grid_of_format_1_is_read_and_becomes_one_of_format_2_by_its_first_change() -> Result<()> {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/format-1.grid");
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.grid");
    std::fs::copy(&golden, &path).expect("a copy");
    let before = digest(&path);
    assert!(GridFile::verify(&path)?.faults.is_empty());
    let mut grid = open(&path)?;
    assert_eq!(grid.file().history().num_observations(), 4);
    assert!(grid.quarantined().is_empty());
    let patch = grid.file().history().patch(0);
    grid.take_in("robot", &patch, time(24), false)?;
    assert_eq!(grid.commit()?, 1);
    assert_eq!(open(&path)?.file().history().num_observations(), 5);
    assert!(GridFile::verify(&path)?.faults.is_empty());
    // What was in it is what it was.
    GridFile::open(&path, Access::ReadWrite)?.rollback(1)?;
    assert_eq!(digest(&path), before);
    assert_eq!(GridFile::open(&path, Access::ReadOnly)?.generation(), 3);
    Ok(())
}

#[test]
fn a_guard_is_put_before_an_open_file_and_taken_away_again() -> Result<()> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.grid");
    five_days(&path)?;
    let file = GridFile::open(&path, Access::ReadWrite)?;
    assert_eq!(file.path(), path);
    assert!(!file.is_read_only());
    let config = GridConfig::default();
    let mut grid = LifelongGrid::of_file(file, &config, GuardConfig::default(), |_, _| {})?;
    let taken = grid.take_in("robot", &wrong(123), time(123), false)?;
    let TakenIn::Quarantined(judgement) = taken else {
        panic!("a map that is turned by half a turn is believed");
    };
    assert!(judgement.why().contains("usual"), "{}", judgement.why());
    // What it predicts is what the file's grid predicts.
    let mut other = TemporalGrid::from_history(grid.file().history().clone(), config);
    let mut maps = [(); 2].map(|()| OccupancyMap::new_unknown(spec()));
    grid.fitted().predict_into(time(130), &mut maps[0])?;
    other.predict_into(time(130), &mut maps[1])?;
    assert_eq!(maps[0], maps[1]);
    // Nothing was committed, and the file goes on without.
    let generation = grid.file().generation();
    assert_eq!(grid.into_file().generation(), generation);
    Ok(())
}

#[test]
fn quarantined_maps_are_chosen_by_their_first_digits() -> Result<()> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.grid");
    five_days(&path)?;
    let mut grid = open(&path)?;
    grid.take_in("robot", &wrong(123), time(123), false)?;
    let held = grid.quarantined();
    let id = MapId::of(&held[0]);
    let name = id.to_string();
    assert_eq!(choose(held, &[&name[..6], &name.to_uppercase()])?, [id]);
    for (digits, kind) in [("", ErrorKind::NotFound), ("xyz", ErrorKind::NotFound)] {
        assert_eq!(choose(held, &[digits]).expect_err("none").kind(), kind);
    }
    let twice = [held[0].clone(), held[0].clone()];
    assert_eq!(
        choose(&twice, &[&name]).expect_err("two").kind(),
        ErrorKind::Config
    );
    Ok(())
}
