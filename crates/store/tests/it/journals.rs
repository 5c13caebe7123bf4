//! What becomes of a commit that did not end, and of a journal that is not the file's?

use std::fs;
use std::path::{Path, PathBuf};

use chronotope_store::Access;
use fremen::error::ErrorKind;

use crate::counts::{Counts, GRID, Grid};

fn journal_of(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push("-journal");
    name.into()
}

/// A grid of so many commits, and what is in it.
fn grid(path: &Path, num_commits: i64) -> Counts {
    let mut grid = Grid::create(&GRID, path).expect("new");
    for number in 0..num_commits {
        let changes: Vec<(i64, i64)> = (0..20).map(|cell| (cell, 100 * number + cell)).collect();
        grid.commit(&changes).expect("extends");
    }
    grid.known.counts.clone()
}

/// The bytes of file and journal while a commit is under way that has already written to the file.
fn interrupted(path: &Path) -> (Vec<u8>, Vec<u8>) {
    let connection = rusqlite::Connection::open(path).expect("a grid");
    connection
        .execute_batch(
            "PRAGMA cache_size = 1; BEGIN IMMEDIATE; \
             UPDATE cell SET count = count + 1; \
             WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < 4000) \
             INSERT INTO cell SELECT 10000 + i, 1, i, i, 0 FROM n;",
        )
        .expect("sound");
    let found = (
        fs::read(path).expect("there"),
        fs::read(journal_of(path)).expect("there"),
    );
    connection.execute_batch("ROLLBACK").expect("sound");
    found
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = (fs::read_dir(folder).expect("a folder"))
        .map(|it| {
            it.expect("there")
                .file_name()
                .to_string_lossy()
                .into_owned()
        })
        .collect();
    names.sort();
    names
}

#[test]
fn an_interrupted_commit_is_undone_by_whoever_reads_first() {
    for verifies in [false, true] {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.grid");
        let before = grid(&path, 5);
        let (file, journal) = interrupted(&path);
        assert_ne!(
            file,
            fs::read(&path).expect("there"),
            "nothing was written yet"
        );
        fs::write(&path, file).expect("writable");
        fs::write(journal_of(&path), journal).expect("writable");
        if verifies {
            assert_eq!(Grid::verify(&GRID, &path).expect("a grid"), []);
        }
        let healed = Grid::open(&GRID, &path, Access::ReadOnly).expect("healed");
        assert_eq!(healed.known.counts, before);
        assert_eq!(names(folder.path()), ["a.grid"]);
    }
}

/// Another process heals the file: that is waited for.
#[test]
fn two_do_not_undo_a_commit_at_once() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.grid");
    let before = grid(&path, 5);
    let (file, journal) = interrupted(&path);
    fs::write(&path, file).expect("writable");
    fs::write(journal_of(&path), journal).expect("writable");
    let other = fs::File::open(&path).expect("there");
    other.lock().expect("nobody else");
    let reader = std::thread::spawn({
        let path = path.clone();
        move || Grid::open(&GRID, &path, Access::ReadOnly)
    });
    std::thread::sleep(std::time::Duration::from_millis(200));
    assert!(!reader.is_finished(), "it did not wait");
    drop(other);
    let healed = reader.join().expect("no panic").expect("healed");
    assert_eq!(healed.known.counts, before);
}

#[test]
fn another_files_journal_without_a_first_page_is_put_aside_and_not_lost() {
    let folder = tempfile::tempdir().expect("a folder");
    let (other, path) = (
        folder.path().join("other.grid"),
        folder.path().join("a.grid"),
    );
    grid(&other, 9);
    let (_, journal) = interrupted(&other);
    fs::remove_file(&other).expect("ours");
    let expected = grid(&path, 4);
    fs::write(journal_of(&path), &journal).expect("writable");
    let opened = Grid::open(&GRID, &path, Access::ReadWrite).expect("whole as it is");
    assert_eq!(opened.known.counts, expected);
    assert_eq!(names(folder.path()), ["a.grid", "a.grid.stray-journal"]);
    let aside = fs::read(folder.path().join("a.grid.stray-journal")).expect("there");
    assert_eq!(aside, journal);
}

#[test]
fn a_journal_that_lies_where_a_file_is_made_is_put_aside() {
    let folder = tempfile::tempdir().expect("a folder");
    let (old, path) = (folder.path().join("old.grid"), folder.path().join("a.grid"));
    grid(&old, 5);
    let (_, journal) = interrupted(&old);
    fs::remove_file(&old).expect("ours");
    fs::write(journal_of(&path), &journal).expect("writable");
    let expected = grid(&path, 2);
    let again = Grid::open(&GRID, &path, Access::ReadWrite).expect("a grid");
    assert_eq!(again.known.counts, expected);
    assert_eq!(names(folder.path()), ["a.grid", "a.grid.stray-journal"]);
    let aside = fs::read(folder.path().join("a.grid.stray-journal")).expect("there");
    assert_eq!(aside, journal);
    // And one more, under a name of its own.
    fs::remove_file(&path).expect("ours");
    fs::write(journal_of(&path), &journal[1..]).expect("writable");
    grid(&path, 1);
    let second = "a.grid.stray-journal2";
    assert_eq!(
        names(folder.path()),
        ["a.grid", "a.grid.stray-journal", second]
    );
    let both = ["a.grid.stray-journal", second].map(|name| fs::read(folder.path().join(name)));
    let [first, second] = both.map(|it| it.expect("there"));
    assert!(first == journal && second == journal[1..]);
}

#[test]
fn the_journal_of_another_file_is_never_played() {
    let folder = tempfile::tempdir().expect("a folder");
    let (path, other) = (folder.path().join("a.grid"), folder.path().join("b.grid"));
    // As many commits as the file, more, and fewer: the counters of pages may well agree.
    for num_others in [3, 4, 5, 9] {
        let expected = grid(&path, 4);
        grid(&other, num_others);
        let (_, journal) = interrupted(&other);
        for access in [Access::ReadOnly, Access::ReadWrite] {
            fs::write(journal_of(&path), &journal).expect("writable");
            let opened = Grid::open(&GRID, &path, access).expect("whole");
            assert_eq!(opened.known.counts, expected, "{num_others}, {access:?}");
            assert!(!journal_of(&path).exists());
            assert_eq!(Grid::verify(&GRID, &path).expect("a grid"), []);
        }
        // Nor by one that has the file open already.
        let mut open = Grid::open(&GRID, &path, Access::ReadWrite).expect("whole");
        fs::write(journal_of(&path), &journal).expect("writable");
        open.commit(&[(1, 1)]).expect("extends");
        assert_eq!(Grid::verify(&GRID, &path).expect("a grid"), []);
        for name in names(folder.path()) {
            fs::remove_file(folder.path().join(name)).expect("ours");
        }
    }
}

#[test]
fn a_backup_over_an_interrupted_file_stays_what_it_was() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.grid");
    grid(&path, 3);
    let backup = fs::read(&path).expect("there");
    let expected = Grid::open(&GRID, &path, Access::ReadWrite).expect("whole");
    let expected_counts = expected.known.counts.clone();
    let mut grid = expected;
    for number in 0..3 {
        grid.commit(&[(number, 7)]).expect("extends");
    }
    drop(grid);
    let (_, journal) = interrupted(&path);
    fs::write(&path, backup).expect("writable");
    fs::write(journal_of(&path), journal).expect("writable");
    let opened = Grid::open(&GRID, &path, Access::ReadWrite).expect("whole");
    assert_eq!(opened.known.counts, expected_counts);
}

/// All of a commit reached the disk, but that its journal is gone did not.
#[test]
fn a_commit_that_lacks_only_the_end_of_its_journal_stands() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.grid");
    grid(&path, 3);
    let mut grid = Grid::open(&GRID, &path, Access::ReadWrite).expect("whole");
    let (tip, before) = (grid.known.tip, fs::read(&path).expect("there"));
    let many: Vec<_> = (0..200).map(|cell| (cell, 1)).collect();
    let mut journal = Vec::new();
    grid.commit_with(&many, || {
        journal = fs::read(journal_of(&path)).expect("there");
    })
    .expect("extends");
    let expected = grid.known.counts.clone();
    drop(grid);
    // As it is once it was synced: with a magic number, and records up to its end.
    journal[..8].copy_from_slice(&[0xd9, 0xd5, 0x05, 0xf9, 0x20, 0xa1, 0x63, 0xd7]);
    journal[8..12].copy_from_slice(&u32::MAX.to_be_bytes());
    let file = fs::read(&path).expect("there");
    for access in [Access::ReadOnly, Access::ReadWrite] {
        fs::write(journal_of(&path), &journal).expect("writable");
        let opened = Grid::open(&GRID, &path, access).expect("whole");
        assert_eq!(opened.known.counts, expected);
        assert_eq!(opened.known.tip.number, tip.number + 1);
        assert_eq!(names(folder.path()), ["a.grid"]);
        assert!(fs::read(&path).expect("there") == file);
    }
    // A file that is damaged, or whose new pages never reached the disk, is as before the commit.
    let mut damaged = file.clone();
    let at = damaged.len() - 9;
    damaged[at] ^= 0xff;
    let cut = file[..before.len()].to_vec();
    assert!(cut.len() < file.len());
    // But not where the file has been committed to since.
    let mut newer = damaged.clone();
    newer[27] += 3;
    fs::write(&path, &newer).expect("writable");
    fs::write(journal_of(&path), &journal).expect("writable");
    Grid::open(&GRID, &path, Access::ReadOnly).expect_err("damaged");
    assert!(fs::read(&path).expect("there") == newer);
    // Beside a whole file that it is not of it is not played, and kept for whoever misses it.
    let other = folder.path().join("b.grid");
    let of_other = self::grid(&other, 9);
    fs::write(journal_of(&other), &journal).expect("writable");
    let opened = Grid::open(&GRID, &other, Access::ReadOnly).expect("whole");
    assert_eq!(opened.known.counts, of_other);
    let aside = folder.path().join("b.grid.stray-journal");
    assert!(fs::read(&aside).expect("kept") == journal);
    for ours in [other, aside] {
        fs::remove_file(ours).expect("ours");
    }
    for broken in [damaged, cut] {
        fs::write(&path, broken).expect("writable");
        fs::write(journal_of(&path), &journal).expect("writable");
        let opened = Grid::open(&GRID, &path, Access::ReadOnly).expect("undone");
        assert_eq!(opened.known.tip, tip);
        assert!(fs::read(&path).expect("there") == before);
        assert_eq!(names(folder.path()), ["a.grid"]);
    }
}

#[test]
fn what_is_whole_neither_with_its_journal_nor_without_stays_as_it_is() {
    let folder = tempfile::tempdir().expect("a folder");
    let (path, other) = (folder.path().join("a.grid"), folder.path().join("b.grid"));
    grid(&path, 4);
    grid(&other, 4);
    let (_, journal) = interrupted(&other);
    let mut damaged = fs::read(&path).expect("there");
    let at = damaged.len() - 9;
    damaged[at] ^= 0xff;
    fs::write(&path, &damaged).expect("writable");
    fs::write(journal_of(&path), &journal[..600]).expect("writable");
    let error = Grid::open(&GRID, &path, Access::ReadWrite).expect_err("damaged");
    assert_eq!(error.kind(), ErrorKind::Format);
    assert!(error.to_string().contains("a.grid-journal"), "{error}");
    assert_eq!(fs::read(&path).expect("there"), damaged);
    assert!(journal_of(&path).exists());
}

#[test]
fn what_a_killed_creation_left_is_not_in_the_way() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.grid");
    grid(&path, 2);
    let (file, journal) = interrupted(&path);
    fs::remove_file(&path).expect("ours");
    fs::write(folder.path().join(".a.grid.unfinished"), file).expect("writable");
    fs::write(folder.path().join(".a.grid.unfinished-journal"), journal).expect("writable");
    let expected = grid(&path, 1);
    let opened = Grid::open(&GRID, &path, Access::ReadOnly).expect("whole");
    assert_eq!(opened.known.counts, expected);
    assert_eq!(names(folder.path()), ["a.grid"]);
}

#[test]
fn a_file_in_wal_mode_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.grid");
    grid(&path, 1);
    let connection = rusqlite::Connection::open(&path).expect("a grid");
    connection
        .pragma_update(None, "journal_mode", "WAL")
        .expect("sound");
    drop(connection);
    let error = Grid::open(&GRID, &path, Access::ReadOnly).expect_err("WAL");
    assert!(error.to_string().contains("WAL mode"), "{error}");
}
