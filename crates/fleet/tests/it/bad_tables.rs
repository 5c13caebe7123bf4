//! Is whatever does not fit named by file, row group and column?

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow_array::builder::BinaryBuilder;
use arrow_array::{
    ArrayRef, BooleanArray, Float64Array, Int32Array, Int64Array, RecordBatch, StringArray,
    TimestampMicrosecondArray, TimestampMillisecondArray, TimestampNanosecondArray,
};
use chronotope_fleet::table::{ModelWriter, ReadConfig, read_models, read_observations};
use chronotope_fleet::{FleetConfig, learn};
use fremen::ErrorKind;
use parquet::arrow::ArrowWriter;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;

use crate::fixture::{log_of, observations};

/// Two rows of a table, whose columns tests replace.
fn columns() -> Vec<(&'static str, ArrayRef)> {
    let times = TimestampMicrosecondArray::from(vec![1_000_000, 2_000_000]);
    vec![
        ("place", Arc::new(StringArray::from(vec!["hall", "hall"]))),
        ("visit", ids(&[Some(&[1; 16]), Some(&[2; 16])])),
        ("time", Arc::new(times.with_timezone("UTC"))),
        ("feature", Arc::new(Int32Array::from(vec![0, 1]))),
        ("state", Arc::new(BooleanArray::from(vec![true, false]))),
    ]
}

fn ids(values: &[Option<&[u8]>]) -> ArrayRef {
    let mut builder = BinaryBuilder::new();
    for value in values {
        builder.append_option(*value);
    }
    Arc::new(builder.finish())
}

/// Writes row groups as some other program might have.
fn write(path: &Path, groups: &[Vec<(&'static str, ArrayRef)>], mark: Option<&str>) {
    let marks = mark.map(|mark| vec![KeyValue::new("chronotope.table".into(), mark.to_owned())]);
    let properties = WriterProperties::builder().set_key_value_metadata(marks);
    let batch = |columns: &[(&'static str, ArrayRef)]| {
        let columns = columns
            .iter()
            .map(|(name, array)| (*name, Arc::clone(array), true));
        RecordBatch::try_from_iter_with_nullable(columns).expect("columns")
    };
    let file = File::create(path).expect("a new file");
    let schema = batch(&groups[0]).schema();
    let mut writer = ArrowWriter::try_new(file, schema, Some(properties.build())).expect("schema");
    for group in groups {
        writer.write(&batch(group)).expect("written");
        writer.flush().expect("a row group");
    }
    writer.close().expect("closed");
}

fn replaced(name: &'static str, array: ArrayRef) -> Vec<(&'static str, ArrayRef)> {
    let mut columns = columns();
    let column = columns.iter_mut().find(|it| it.0 == name);
    column.expect("known").1 = array;
    columns
}

fn refused(path: &Path) -> String {
    let files = [path.to_owned()];
    let error = read_observations(&files, &ReadConfig::default()).expect_err("a bad table");
    error.to_string()
}

/// What the error says beside the file and what helps.
fn is_named(text: &str, path: &Path, parts: &[&str]) {
    let parts = parts.iter().copied().chain(["(help: "]);
    for part in parts.chain([&*path.to_string_lossy()]) {
        assert!(text.contains(part), "`{part}` is missing in: {text}");
    }
}

#[test]
fn a_table_of_another_program_is_read() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("sound.parquet");
    write(&path, &[columns()], None);
    let (log, report) = read_observations(&[path], &ReadConfig::default()).expect("sound");
    assert_eq!((log.num_observations(), report.num_duplicates), (2, 0));
}

#[test]
fn a_wrong_type_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let seconds: ArrayRef = Arc::new(Int64Array::from(vec![1, 2]));
    let local: ArrayRef = Arc::new(TimestampMicrosecondArray::from(vec![1, 2]));
    let millis = TimestampMillisecondArray::from(vec![1, 2]).with_timezone("UTC");
    let nanos: ArrayRef = Arc::new(TimestampNanosecondArray::from(vec![1, 2]));
    let floats: ArrayRef = Arc::new(Float64Array::from(vec![1.0, f64::NAN]));
    let wide: ArrayRef = Arc::new(Int64Array::from(vec![1, 2]));
    for (column, array, says) in [
        ("time", seconds, "no unit and no zone"),
        ("time", local, "without a zone"),
        ("time", Arc::new(millis) as ArrayRef, "Millisecond"),
        ("time", nanos, "TIMESTAMP_MICROS"),
        ("state", floats, "Float64"),
        ("feature", wide, "Int64"),
        ("place", ids(&[Some(b"hall"), Some(b"hall")]), "STRING"),
    ] {
        let path = folder
            .path()
            .join(format!("{column} {}.parquet", says.replace(' ', "-")));
        write(&path, &[replaced(column, array)], None);
        let column = format!("all row groups, column `{column}`");
        is_named(&refused(&path), &path, &[&column, says]);
    }
}

#[test]
fn the_file_with_another_unit_than_the_others_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let (sound, other) = (
        folder.path().join("a.parquet"),
        folder.path().join("b.parquet"),
    );
    write(&sound, &[columns()], None);
    let millis = TimestampMillisecondArray::from(vec![1, 2]).with_timezone("UTC");
    write(&other, &[replaced("time", Arc::new(millis))], None);
    let files = [sound, other.clone()];
    let error = read_observations(&files, &ReadConfig::default()).expect_err("two units");
    is_named(
        &error.to_string(),
        &other,
        &["column `time`", "Millisecond"],
    );
}

#[test]
fn missing_columns_and_other_tables_are_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("no state.parquet");
    write(&path, &[columns()[..4].to_vec()], None);
    is_named(
        &refused(&path),
        &path,
        &["column `state`", "place, visit, time, feature"],
    );
    for (mark, help) in [
        ("models/1", "a file of that table"),
        ("observations/2", "newer"),
    ] {
        let path = folder.path().join(mark.replace('/', " "));
        write(&path, &[columns()], Some(mark));
        is_named(&refused(&path), &path, &["chronotope.table", mark, help]);
    }
    let path = folder.path().join("text.parquet");
    std::fs::write(&path, "place,visit,time\n").expect("written");
    is_named(&refused(&path), &path, &["footer", "no Parquet"]);
}

#[test]
fn a_bad_cell_is_named_with_its_row_group_and_row() {
    let folder = tempfile::tempdir().expect("a folder");
    let null: ArrayRef = Arc::new(BooleanArray::from(vec![Some(true), None]));
    let negative: ArrayRef = Arc::new(Int32Array::from(vec![0, -1]));
    let nameless: ArrayRef = Arc::new(StringArray::from(vec!["hall", ""]));
    let placeless: ArrayRef = Arc::new(StringArray::from(vec![Some("hall"), None]));
    for (column, array, says) in [
        ("state", null, "null"),
        ("place", placeless, "null"),
        ("feature", negative, "-1 is negative"),
        ("place", nameless, "empty"),
        (
            "visit",
            ids(&[Some(&[1; 16]), Some(&[2; 15])]),
            "16 bytes, not 15",
        ),
        ("visit", ids(&[Some(&[1; 16]), None]), "null"),
    ] {
        let path = folder
            .path()
            .join(format!("{column} {}.parquet", says.replace(' ', "-")));
        write(&path, &[columns(), replaced(column, array)], None);
        let place = format!("row group 1, column `{column}`, row 1");
        is_named(&refused(&path), &path, &[&place, says]);
    }
}

#[test]
fn contradicting_rows_are_named_with_both_places() {
    let folder = tempfile::tempdir().expect("a folder");
    let (first, second) = (
        folder.path().join("a.parquet"),
        folder.path().join("b.parquet"),
    );
    let first_in = format!("first said in {}, row group 0", first.display());
    write(&first, &[columns()], None);
    let other: ArrayRef = Arc::new(BooleanArray::from(vec![false, false]));
    write(&second, &[columns(), replaced("state", other)], None);
    let files: [PathBuf; 2] = [first.clone(), second.clone()];
    for num_threads in [1, 2] {
        let cfg = ReadConfig::default().with_num_threads(num_threads);
        let error = read_observations(&files, &cfg).expect_err("a contradiction");
        let place = "row group 1, column `state`";
        let said = "feature 0 of place `hall` is said to be both";
        is_named(&error.to_string(), &second, &[place, said, &first_in]);
    }
    std::fs::remove_file(&second).expect("there");
    let times = TimestampMicrosecondArray::from(vec![1_000_001, 2_000_000]);
    write(
        &second,
        &[replaced("time", Arc::new(times.with_timezone("UTC")))],
        None,
    );
    let error = read_observations(&files, &ReadConfig::default()).expect_err("two times");
    let parts = ["row group 0, column `time`", "two times", &first_in];
    is_named(&error.to_string(), &second, &parts);
}

#[test]
fn a_model_that_is_not_one_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("models.parquet");
    let models = learn(&log_of(&observations()[..2]), &FleetConfig::default()).expect("few");
    let (sums, model) = (models[0].sums.to_bytes(), &models[0].model[..]);
    let mut flipped = sums.clone();
    flipped[20] ^= 1;
    for (second, second_sums, model, kind, says) in [
        (
            f64::NAN,
            &sums,
            model,
            ErrorKind::Format,
            "column `mean`, row 1: NaN",
        ),
        (
            0.5,
            &sums,
            &b"model"[..],
            ErrorKind::Format,
            "column `model`, row 0",
        ),
        (
            0.5,
            &flipped,
            model,
            ErrorKind::Checksum,
            "column `sums`, row 1",
        ),
    ] {
        let table: Vec<(&str, ArrayRef)> = vec![
            ("place", Arc::new(StringArray::from(vec!["hall", "hall"]))),
            ("feature", Arc::new(Int32Array::from(vec![0, 1]))),
            ("mean", Arc::new(Float64Array::from(vec![0.5, second]))),
            ("sums", ids(&[Some(&sums), Some(second_sums)])),
            ("model", ids(&[Some(model), Some(model)])),
        ];
        write(&path, &[table], None);
        let error = read_models(std::slice::from_ref(&path)).expect_err(says);
        assert_eq!(error.kind(), kind, "{error}");
        is_named(
            &error.to_string(),
            &path,
            &[&format!("row group 0, {says}")],
        );
        std::fs::remove_file(&path).expect("there");
    }
}

/// The reader of the format believes much of what a file says of itself.
#[test]
fn damaged_bytes_give_rows_or_an_error_that_names_the_file() {
    let folder = tempfile::tempdir().expect("temporary");
    let foreign = folder.path().join("observations.parquet");
    write(&foreign, &[columns(), columns()], None);
    let models = folder.path().join("models.parquet");
    let log = log_of(&observations()[..300]);
    let mut table = ModelWriter::begin(&models).expect("new");
    (table.write(&learn(&log, &FleetConfig::default()).expect("learnt"))).expect("written");
    table.finish().expect("whole");
    let read = |path: &PathBuf| {
        let files = [path.clone()];
        if *path == models {
            read_models(&files).map(drop)
        } else {
            read_observations(&files, &ReadConfig::default()).map(drop)
        }
    };
    let mut num_refused = 0;
    for path in [&foreign, &models] {
        let good = std::fs::read(path).expect("there");
        read(path).expect("a table");
        // Some of all of it.
        for at in (0..good.len()).step_by(1 + good.len() / 1_000) {
            let byte = [0x00, 0x7f, 0xff, good[at] ^ 1, good[at] ^ 0x80][at % 5];
            let mut changed = good.clone();
            changed[at] = byte;
            std::fs::write(path, &changed).expect("written");
            if let Err(error) = read(path) {
                num_refused += 1;
                let text = error.to_string();
                assert!(text.contains(&*path.to_string_lossy()), "byte {at}: {text}");
                assert!(error.help().is_some(), "byte {at}: {text}");
            }
        }
    }
    assert!(num_refused > 200, "{num_refused}");
}
