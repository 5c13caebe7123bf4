//! Is a row whose checksum holds still refused where it cannot be right?

use std::path::Path;

use chronotope_store::{Access, Fault, Faults, Store, Table, ValueRef, row_crc};
use fremen::error::{Error, ErrorKind, Result};

use crate::counts::{CELL, GENERATION, GRID, Grid, REMARK, check, folder};

/// Changes rows by hand, and gives them the checksums that they should have then.
fn change(path: &Path, table: &'static Table, sql: &str) {
    let connection = rusqlite::Connection::open(path).expect("a grid");
    connection.execute_batch(sql).expect(sql);
    let columns = table.columns;
    let mut select = connection
        .prepare(&format!(
            "SELECT {} FROM {}",
            columns.join(", "),
            table.name
        ))
        .expect("sound");
    let crcs: Vec<(i64, u32)> = select
        .query_map([], |row| {
            let values: Vec<ValueRef<'_>> = (0..columns.len())
                .map(|column| row.get_ref(column))
                .collect::<rusqlite::Result<_>>()?;
            Ok((row.get(0)?, row_crc(table, &values)))
        })
        .expect("sound")
        .collect::<rusqlite::Result<_>>()
        .expect("sound");
    for crc in crcs {
        let sql = format!(
            "UPDATE {} SET crc = ?2 WHERE {} = ?1",
            table.name, columns[0]
        );
        connection.execute(&sql, crc).expect("sound");
    }
}

/// Two generations, and what is found once the row of the second one is changed.
fn changed_generation(sql: &str) -> Vec<String> {
    let folder = folder();
    let path = folder.path().join("a.grid");
    let mut grid = Grid::create(&GRID, &path).expect("new");
    grid.commit(&[(1, 5)]).expect("extends");
    grid.commit(&[(2, 6), (3, 7)]).expect("extends");
    drop(grid);
    change(&path, &GENERATION, sql);
    let error = Grid::open(&GRID, &path, Access::ReadOnly).expect_err(sql);
    assert_ne!(error.kind(), ErrorKind::Io, "{error}");
    let faults = Grid::verify(&GRID, &path).expect("a grid");
    assert!(error.to_string().contains(&faults[0].message), "{error}");
    faults.iter().map(Fault::to_string).collect()
}

#[test]
fn a_generation_that_cannot_be_is_named() {
    for (set, expected) in [
        (
            "num_cells = 2",
            "row 2, column num_cells: 2 were written, 3 are found",
        ),
        (
            "digest = zeroblob(32)",
            "row 2, column digest: the rows are not those that were committed",
        ),
        (
            "digest = zeroblob(31)",
            "row 2, column digest, byte 31: 31 bytes, where a digest has 32",
        ),
        (
            "digest = zeroblob(33)",
            "row 2, column digest, byte 32: more than 32 bytes",
        ),
        (
            "parent = 2",
            "row 2, column parent: no generation but 0 is without one before it",
        ),
        (
            "parent = 7",
            "row 2, column parent: no generation but 0 is without one before it",
        ),
        (
            "parent = NULL",
            "row 2, column parent: no generation but 0 is without one before it",
        ),
        (
            "parent = -1",
            "row 2, column parent: a count cannot be negative (-1)",
        ),
        (
            "prunes = -3",
            "row 2, column prunes: a count cannot be negative (-3)",
        ),
    ] {
        let sql = format!("UPDATE generation SET {set} WHERE number = 2");
        let faults = changed_generation(&sql);
        assert_eq!(faults[0], format!("table generation, {expected}"));
    }
    let faults = changed_generation("DELETE FROM generation WHERE number = 1");
    assert!(faults[0].contains("row 2, column parent: generation 1 is missing"));
}

#[test]
fn a_hundred_faults_are_listed_and_no_more() {
    let folder = folder();
    let path = folder.path().join("a.grid");
    let mut grid = Grid::create(&GRID, &path).expect("new");
    let many: Vec<_> = (0..100).map(|cell| (cell, 1)).collect();
    grid.commit(&many).expect("extends");
    (grid.store.connection())
        .execute_batch("UPDATE cell SET count = 2")
        .expect("sound");
    let faults = Grid::verify(&GRID, &path).expect("a grid");
    assert_eq!(faults.len(), 100);
    assert_eq!(faults[99].row, Some(100));
    drop(grid);
    change(&path, &CELL, "INSERT INTO cell VALUES (101, 1, 100, 1, 0)");
    let connection = rusqlite::Connection::open(&path).expect("a grid");
    connection
        .execute_batch("UPDATE cell SET count = 3")
        .expect("sound");
    let faults = Grid::verify(&GRID, &path).expect("a grid");
    assert_eq!(faults.len(), 100);
}

/// Values of the wrong type, too large, or no text at all.
#[test]
fn a_value_that_is_not_what_its_column_holds_is_named() {
    let folder = folder();
    let path = folder.path().join("a.grid");
    let mut grid = Grid::create(&GRID, &path).expect("new");
    grid.sample(1, &[5], false).expect("extends");
    drop(grid);
    let read = |column: usize, what: &str| -> Result<()> {
        let read = |reader: &chronotope_store::Reader<'_>| {
            reader.scan(&REMARK, 0, &mut Faults::strict(&GRID), |row, _| {
                assert_eq!(row.id(), 100);
                match what {
                    "real" => row.real(column).map(drop),
                    "text" => row.text(column).map(drop),
                    "blob" => row.blob(column).map(drop),
                    "bits" => row.bits_128(column).map(drop),
                    "count" => row.count(column).map(drop),
                    _ => row.integer(column).map(drop),
                }
            })
        };
        Store::open(&GRID, &path, Access::ReadOnly, check, read).map(drop)
    };
    read(0, "integer").expect("an integer");
    read(1, "count").expect("an integer");
    read(2, "text").expect("a text");
    for (column, what, expected) in [
        (
            1,
            "real",
            "column generation: a finite real expected, Integer found",
        ),
        (
            1,
            "text",
            "column generation: a text expected, Integer found",
        ),
        (2, "integer", "column text: an integer expected, Text found"),
        (2, "blob", "column text: a blob expected, Text found"),
        (2, "bits", "column text: a blob expected, Text found"),
    ] {
        let error = read(column, what).expect_err(expected).to_string();
        assert!(error.contains(expected), "{error}");
    }
    for (text, expected) in [
        (
            "CAST(x'61ff62' AS TEXT)",
            "column text, byte 1: this is no UTF-8",
        ),
        (
            "printf('%0101d', 0)",
            "column text, byte 100: more than 100 bytes",
        ),
    ] {
        change(&path, &REMARK, &format!("UPDATE remark SET text = {text}"));
        let error = read(2, "text").expect_err(expected).to_string();
        assert!(error.contains(expected), "{error}");
    }
    change(
        &path,
        &REMARK,
        "UPDATE remark SET text = printf('%0100d', 0)",
    );
    read(2, "text").expect("as long as it may be");
}

/// What goes wrong while a file is checked is no fault of the file.
#[test]
fn an_error_of_the_reader_is_not_taken_for_a_fault() {
    let folder = folder();
    let path = folder.path().join("a.grid");
    Grid::create(&GRID, &path).expect("new");
    let error = Store::verify::<()>(&GRID, &path, 9, check, |_, _| {
        Err(Error::new(ErrorKind::Config, "enough"))
    });
    assert_eq!(error.expect_err("an error").kind(), ErrorKind::Config);
}
