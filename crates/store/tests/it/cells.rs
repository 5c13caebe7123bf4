//! Does the store keep something that is no map?

use std::fs;

use chronotope_store::{Access, Faults, Reader, Store, ends};
use fremen::error::ErrorKind;

use crate::counts::{Counts, FIRST, GRID, Grid, REMARK, RESET, SAMPLE, folder};

fn counts(cells: &[(i64, i64)]) -> Counts {
    Counts(cells.iter().copied().collect())
}

#[test]
fn what_is_committed_is_read_and_returned_to() {
    let folder = folder();
    let path = folder.path().join("a.grid");
    let mut grid = Grid::create(&GRID, &path).expect("new");
    assert_eq!(grid.commit(&[(1, 5), (2, 1)]).expect("extends"), 1);
    assert_eq!(grid.commit(&[(1, 6)]).expect("extends"), 2);
    assert_eq!(grid.rollback(1).expect("there"), 3);
    assert_eq!(grid.known.counts, counts(&[(1, 5), (2, 1)]));
    assert_eq!(grid.commit(&[(3, 9)]).expect("extends"), 4);
    let expected = counts(&[(1, 5), (2, 1), (3, 9)]);
    let mut reopened = Grid::open(&GRID, &path, Access::ReadOnly).expect("a grid");
    assert_eq!(reopened.known.counts, expected);
    assert_eq!(
        reopened.at(2).expect("there").counts,
        counts(&[(1, 6), (2, 1)])
    );
    assert!(reopened.store.is_read_only() && !grid.store.is_read_only());
    let error = reopened.commit(&[(1, 1)]).expect_err("read-only");
    assert!(
        error.to_string().contains("this grid is open read-only"),
        "{error}"
    );
    let error = reopened.at(7).expect_err("never was").to_string();
    assert!(error.contains("`gridder grid log`"), "{error}");
    assert_eq!(Grid::verify(&GRID, &path).expect("a grid"), []);
    let error = Grid::create(&GRID, &path).expect_err("exists").to_string();
    assert!(error.contains("a grid is never overwritten"), "{error}");
}

#[test]
fn generations_are_listed_with_the_ends_of_their_branches() {
    let folder = folder();
    let path = folder.path().join("a.grid");
    let mut grid = Grid::create(&GRID, &path).expect("new");
    for number in 1..=2 {
        grid.commit(&[(number, 1)]).expect("extends");
    }
    grid.rollback(1).expect("there");
    grid.commit(&[(3, 1)]).expect("extends");
    let mut after = |known| {
        let read = |reader: &Reader<'_>| reader.generations(known, &mut Faults::strict(&GRID));
        grid.store.read(read).expect("whole")
    };
    let all = after(None);
    assert_eq!(ends(&all), [2, 4]);
    assert_eq!(after(Some(1)), all[2..]);
    assert_eq!(after(Some(3)), all[4..]);
}

#[test]
fn two_writers_do_not_overwrite_each_other() {
    let folder = folder();
    let path = folder.path().join("a.grid");
    let mut first = Grid::create(&GRID, &path).expect("new");
    let mut second = Grid::open(&GRID, &path, Access::ReadWrite).expect("a grid");
    first.commit(&[(1, 1)]).expect("extends");
    let error = second.commit(&[(2, 2)]).expect_err("not the newest");
    assert!(error.to_string().contains("refresh the grid"), "{error}");
    first.commit(&[(1, 2)]).expect("extends");
    first.prune(&[]).expect("sound");
    let error = second.rollback(0).expect_err("pruned").to_string();
    assert!(error.contains("has pruned the grid"), "{error}");
}

#[test]
fn a_file_that_was_moved_away_or_replaced_is_neither_written_to_nor_read_on() {
    let folder = folder();
    let (path, aside) = (folder.path().join("a.grid"), folder.path().join("b.grid"));
    let mut grid = Grid::create(&GRID, &path).expect("new");
    grid.commit(&[(1, 1)]).expect("extends");
    fs::copy(&path, &aside).expect("copied");
    let all_fails = |grid: &mut Grid| {
        let errors = [
            grid.commit(&[(2, 2)]).expect_err("no longer there"),
            grid.at(1).map(drop).expect_err("no longer there"),
        ];
        for error in errors {
            assert_eq!(error.kind(), ErrorKind::Io);
            assert_eq!(error.path(), Some(path.as_path()));
            let text = error.to_string();
            assert!(
                text.contains("replaced since it was opened")
                    && text.contains("open the grid again"),
                "{text}"
            );
        }
    };
    // A copy of the very same bytes.
    let copy = fs::read(&aside).expect("there");
    fs::rename(&aside, &path).expect("replaced");
    all_fails(&mut grid);
    assert_eq!(fs::read(&path).expect("there"), copy);
    fs::rename(&path, &aside).expect("moved");
    all_fails(&mut grid);
    assert!(!path.exists());
    // What was meant can be done where it is now.
    let mut moved = Grid::open(&GRID, &aside, Access::ReadWrite).expect("a grid");
    moved.commit(&[(2, 2)]).expect("extends");
    assert_eq!(moved.known.counts, counts(&[(1, 1), (2, 2)]));
}

#[test]
fn what_stays_after_pruning_is_what_it_was() {
    let folder = folder();
    let path = folder.path().join("a.grid");
    let mut grid = Grid::create(&GRID, &path).expect("new");
    for number in 0..9 {
        grid.commit(&[(number % 3, number), (100 + number, 1)])
            .expect("extends");
        if number == 4 {
            grid.rollback(2).expect("there");
        }
    }
    let known: Vec<_> = (0..=grid.known.tip.number)
        .map(|number| grid.at(number).expect("there").counts)
        .collect();
    assert_eq!(grid.prune(&[5]).expect("sound"), 7);
    assert_eq!(Grid::verify(&GRID, &path).expect("a grid"), []);
    for number in [0, 2, 5, grid.known.tip.number] {
        let found = grid.at(number).expect("kept").counts;
        assert_eq!(found, known[number as usize], "{number}");
    }
    assert!(grid.at(4).is_err());
    let error = grid.prune(&[5, 77]).expect_err("never was");
    assert_eq!(error.kind(), ErrorKind::NotFound);
    assert!(error.to_string().contains("no generation 77"), "{error}");
    let num_bytes = grid.store.num_bytes().expect("there");
    assert!(grid.prune(&[]).expect("sound") > 0);
    assert!(grid.store.num_bytes().expect("there") <= num_bytes);
    let len = fs::metadata(&path).expect("there").len();
    assert_eq!(grid.store.num_bytes().expect("there"), len);
    assert_eq!(Some(&grid.known.counts), known.last());
}

#[test]
fn a_pruned_file_is_as_small_as_what_is_left() {
    let folder = folder();
    let path = folder.path().join("a.grid");
    let mut grid = Grid::create(&GRID, &path).expect("new");
    for round in 0..20 {
        let many: Vec<_> = (0..50).map(|cell| (cell, round)).collect();
        grid.commit(&many).expect("extends");
    }
    let before = grid.store.num_bytes().expect("there");
    grid.prune(&[]).expect("sound");
    assert!(grid.store.num_bytes().expect("there") < before / 2);
}

#[test]
fn a_file_is_renamed_over_nothing() {
    let folder = folder();
    let [from, to] = ["a.grid", "b.grid"].map(|name| folder.path().join(name));
    let mut grid = Grid::create(&GRID, &from).expect("new");
    grid.commit(&[(1, 5)]).expect("extends");
    drop(grid);
    Grid::create(&GRID, &to).expect("new");
    let error = Store::rename(&GRID, &from, &to).expect_err("there is another");
    assert_eq!(error.kind(), ErrorKind::AlreadyExists);
    fs::remove_file(&to).expect("ours");
    Store::rename(&GRID, &from, &to).expect("free now");
    let grid = Grid::open(&GRID, &to, Access::ReadOnly).expect("a grid");
    assert_eq!(grid.known.counts, counts(&[(1, 5)]));
    assert!(!from.exists());
}

#[test]
fn what_was_begun_anew_is_pruned_with_all_that_hangs_on_it() {
    let folder = folder();
    let path = folder.path().join("a.grid");
    let mut grid = Grid::create(&GRID, &path).expect("new");
    grid.sample(1, &[5, 6], false).expect("extends");
    grid.sample(2, &[7], false).expect("extends");
    grid.sample(1, &[8], true).expect("extends");
    grid.sample(1, &[9], false).expect("extends");
    let all = [100, 101, 200, 300, 400];
    assert_eq!(
        (grid.ids(&SAMPLE), grid.ids(&RESET)),
        (all.to_vec(), vec![3])
    );
    // As long as somebody may return to what was, it stays.
    assert_eq!(grid.prune(&[2, 3]).expect("sound"), 1);
    assert_eq!(
        (grid.ids(&SAMPLE), grid.ids(&REMARK)),
        (all.to_vec(), all.to_vec())
    );
    assert_eq!(grid.prune(&[]).expect("sound"), 2);
    let left = vec![200, 300, 400];
    assert_eq!((grid.ids(&SAMPLE), grid.ids(&REMARK)), (left.clone(), left));
    assert_eq!(Grid::verify(&GRID, &path).expect("a grid"), []);
    // Another branch has what it had.
    grid.sample(2, &[1], true).expect("extends");
    grid.rollback(4).expect("there");
    grid.sample(2, &[2], false).expect("extends");
    grid.prune(&[]).expect("sound");
    assert_eq!(grid.ids(&SAMPLE), [200, 300, 400, 700]);
}

#[test]
fn every_flipped_byte_is_noticed_or_harmless() {
    let folder = folder();
    let path = folder.path().join("whole.grid");
    let mut grid = Grid::create(&GRID, &path).expect("new");
    grid.commit(&[(1, 5), (2, 1)]).expect("extends");
    grid.commit(&[(1, 6)]).expect("extends");
    let whole = fs::read(&path).expect("there");
    let damaged_path = folder.path().join("damaged.grid");
    let mut num_refused = 0;
    for at in 0..whole.len() {
        let mut damaged = whole.clone();
        damaged[at] ^= 1 << (at * 5 % 8);
        fs::write(&damaged_path, &damaged).expect("writable");
        match Grid::open(&GRID, &damaged_path, Access::ReadOnly) {
            Ok(opened) => assert_eq!(opened.known.counts, grid.known.counts, "byte {at}"),
            Err(error) => {
                assert!(error.path().is_some(), "byte {at}: {error}");
                let faults = Grid::verify(&GRID, &damaged_path);
                assert!(faults.map_or(true, |it| !it.is_empty()), "byte {at}");
                num_refused += 1;
            }
        }
    }
    assert!(num_refused > whole.len() / 10, "{num_refused}");
}

#[test]
fn a_flipped_bit_is_named() {
    let folder = folder();
    let path = folder.path().join("a.grid");
    let mut grid = Grid::create(&GRID, &path).expect("new");
    grid.commit(&[(1, 5), (2, 1)]).expect("extends");
    (grid.store.connection())
        .execute_batch("UPDATE cell SET count = count + 2 WHERE id = 1")
        .expect("sound");
    drop(grid);
    let error = Grid::open(&GRID, &path, Access::ReadOnly).expect_err("damaged");
    assert_eq!(error.kind(), ErrorKind::Checksum);
    let message = error.to_string();
    assert!(
        message.contains("table cell, row 1, column count, byte 0"),
        "{message}"
    );
    assert!(message.contains("`gridder grid verify`"), "{message}");
    // That the digest is another one follows, and is not listed.
    assert_eq!(Grid::verify(&GRID, &path).expect("a grid").len(), 1);
}

/// The files as a power loss in the middle of a commit leaves them.
#[test]
fn an_interrupted_commit_is_undone() {
    let folder = folder();
    let path = folder.path().join("a.grid");
    let mut grid = Grid::create(&GRID, &path).expect("new");
    let many: Vec<_> = (0..200).map(|cell| (cell, 1)).collect();
    grid.commit(&many).expect("extends");
    let torn = folder.path().join("torn.grid");
    let torn_journal = folder.path().join("torn.grid-journal");
    let connection = grid.store.connection();
    connection
        .execute_batch("PRAGMA cache_size = 1; BEGIN IMMEDIATE; UPDATE cell SET count = 7, crc = 0")
        .expect("sound");
    connection.cache_flush().expect("sound");
    fs::copy(&path, &torn).expect("writable");
    fs::copy(folder.path().join("a.grid-journal"), &torn_journal).expect("there");
    connection.execute_batch("ROLLBACK").expect("sound");
    let healed = Grid::open(&GRID, &torn, Access::ReadOnly).expect("undone");
    assert_eq!(healed.known, grid.known);
    assert!(!torn_journal.exists());
    assert_eq!(Grid::verify(&GRID, &torn).expect("a grid"), []);
}

#[test]
fn a_file_of_an_older_version_becomes_one_of_today_at_its_first_commit() {
    let folder = folder();
    let path = folder.path().join("a.grid");
    let mut old = Grid::create(&FIRST, &path).expect("new");
    old.commit(&[(1, 5)]).expect("extends");
    old.commit(&[(2, 6)]).expect("extends");
    let before = fs::read(&path).expect("there");
    let mut grid = Grid::open(&GRID, &path, Access::ReadWrite).expect("a grid");
    assert_eq!(grid.known.counts, old.known.counts);
    assert_eq!(fs::read(&path).expect("there"), before);
    assert_eq!(grid.rollback(1).expect("there"), 3);
    assert_eq!(Grid::verify(&GRID, &path).expect("a grid"), []);
    assert_eq!(grid.at(2).expect("there").counts, old.known.counts);
    // The older program says what it is.
    let error = Grid::open(&FIRST, &path, Access::ReadOnly).expect_err("newer");
    assert!(error.to_string().contains("use a newer gridder"), "{error}");
}

#[test]
fn what_is_no_such_file_is_named() {
    let folder = folder();
    let path = folder.path().join("a.grid");
    let open = || {
        Grid::open(&GRID, &path, Access::ReadOnly)
            .expect_err("no grid")
            .to_string()
    };
    assert!(open().contains("make a grid with `gridder grid make`"));
    fs::write(&path, b"").expect("writable");
    assert!(open().contains("the file is empty"));
    fs::write(&path, b"x,y\n").expect("writable");
    assert!(open().contains("this is a text, not a grid file"));
    fs::remove_file(&path).expect("ours");
    rusqlite::Connection::open(&path)
        .expect("new")
        .execute_batch("PRAGMA application_id = 7; CREATE TABLE t (x)")
        .expect("sound");
    assert!(open().contains("application id 0x00000007), not a grid"));
    fs::remove_file(&path).expect("ours");
    fs::create_dir(&path).expect("writable");
    assert!(open().contains("a grid is one file"));
    #[cfg(unix)]
    {
        fs::remove_dir(&path).expect("ours");
        let made = std::process::Command::new("mkfifo").arg(&path).status();
        assert!(made.expect("mkfifo").success());
        assert!(open().contains("this is no regular file"));
    }
}

/// What an opened file is guarded by: read back from the connection, because a file that would get
/// past one of them alone is hard to make.
#[test]
fn a_file_from_elsewhere_runs_nothing_and_a_commit_outlives_a_power_loss() {
    let folder = folder();
    let path = folder.path().join("a.grid");
    Grid::create(&GRID, &path).expect("new");
    for access in [Access::ReadOnly, Access::ReadWrite] {
        let grid = Grid::open(&GRID, &path, access).expect("a grid");
        for (pragma, expected) in [
            ("trusted_schema", 0),
            ("cell_size_check", 1),
            ("synchronous", 3),
        ] {
            let found: i64 = (grid.store.connection())
                .query_row(&format!("PRAGMA {pragma}"), [], |row| row.get(0))
                .expect("sound");
            assert_eq!(found, expected, "{pragma}");
        }
    }
}

#[test]
fn a_file_that_was_cut_off_is_refused() {
    let folder = folder();
    let path = folder.path().join("a.grid");
    let mut grid = Grid::create(&GRID, &path).expect("new");
    let many: Vec<_> = (0..200).map(|cell| (cell, 1)).collect();
    grid.commit(&many).expect("extends");
    drop(grid);
    let whole = fs::read(&path).expect("there");
    for len in [whole.len() - 1, whole.len() - 512, 700] {
        fs::write(&path, &whole[..len]).expect("writable");
        let error = Grid::open(&GRID, &path, Access::ReadOnly).expect_err("cut off");
        let expected = format!("{len} of {} bytes", whole.len());
        assert!(error.to_string().contains(&expected), "{error}");
        // A journal without anything in it excuses nothing.
        let journal = folder.path().join("a.grid-journal");
        fs::write(&journal, "").expect("writable");
        let again = Grid::open(&GRID, &path, Access::ReadOnly).expect_err("cut off");
        assert_eq!(again.to_string(), error.to_string());
        fs::remove_file(journal).expect("ours");
    }
}

/// Programs of before 2010 did not keep the number of pages in the header, and left there what was.
#[test]
fn a_number_of_pages_that_is_not_of_the_last_commit_does_not_count() {
    let folder = folder();
    let path = folder.path().join("a.grid");
    let mut grid = Grid::create(&GRID, &path).expect("new");
    grid.commit(&[(1, 1)]).expect("extends");
    let expected = grid.known.counts.clone();
    drop(grid);
    let mut bytes = fs::read(&path).expect("there");
    bytes[28..32].copy_from_slice(&9_999_u32.to_be_bytes());
    // The commit that it is of.
    bytes[95] ^= 1;
    fs::write(&path, &bytes).expect("writable");
    let grid = Grid::open(&GRID, &path, Access::ReadOnly).expect("whole");
    assert_eq!(grid.known.counts, expected);
}

/// Rows that read well may lie in pages that a writer would spoil.
#[test]
fn a_file_of_broken_structure_is_not_opened_to_be_written() {
    let folder = folder();
    let path = folder.path().join("a.grid");
    let mut grid = Grid::create(&GRID, &path).expect("new");
    grid.commit(&[(1, 1)]).expect("extends");
    drop(grid);
    let mut bytes = fs::read(&path).expect("there");
    // The count of free pages.
    bytes[39] = 3;
    fs::write(&path, &bytes).expect("writable");
    Grid::open(&GRID, &path, Access::ReadOnly).expect("its rows are whole");
    let error = Grid::open(&GRID, &path, Access::ReadWrite).expect_err("broken");
    assert_eq!(error.kind(), ErrorKind::Format, "{error}");
    let faults = Grid::verify(&GRID, &path).expect("a grid");
    assert!(faults[0].to_string().starts_with("file: "), "{faults:?}");
}

/// Closing a file drops all locks that a process has on it, so it is not even looked at meanwhile.
#[test]
fn a_file_is_not_opened_otherwise_while_this_process_commits_to_it() {
    use std::sync::mpsc::channel;
    use std::time::Duration;
    let folder = folder();
    let path = folder.path().join("a.grid");
    let mut grid = Grid::create(&GRID, &path).expect("new");
    let (begin, begun) = channel();
    let (see, seen) = channel();
    std::thread::scope(|scope| {
        let writer = scope.spawn(move || {
            let tip = grid.known.tip;
            let written = grid.store.write(tip, |_| {
                begin.send(()).expect("somebody waits");
                let early = seen.recv_timeout(Duration::from_millis(700));
                assert!(early.is_err(), "the file was opened meanwhile");
                Err(fremen::error::Error::new(ErrorKind::Config, "enough"))
            });
            assert!(written.is_err());
        });
        begun.recv().expect("a writer");
        let read = Grid::open(&GRID, &path, Access::ReadOnly).expect("a grid");
        assert_eq!(read.known.tip.number, 0);
        // The writer has given up waiting long ago.
        let _ = see.send(());
        writer.join().expect("the writer saw nobody");
    });
}
