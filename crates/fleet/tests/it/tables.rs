//! Do tables come back as they were, whole or not at all?

use std::fs;
use std::path::PathBuf;

use chronotope_fleet::table::{
    FeatureRow, FeatureWriter, ModelWriter, ObservationWriter, ReadConfig, TableFolder, files_of,
    read_extractor, read_features, read_models, read_observations, read_series,
};
use chronotope_fleet::{FleetConfig, learn};
use fremen::ErrorKind;

use crate::fixture::{log_of, observations, write};

#[test]
fn models_come_back_bit_for_bit() {
    let folder = tempfile::tempdir().expect("a folder");
    let models = learn(&log_of(&observations()), &FleetConfig::default()).expect("few");
    let path = folder.path().join("models.parquet");
    let mut table = ModelWriter::begin(&path).expect("new");
    table.write(&models).expect("written");
    table.finish().expect("finished");
    assert_eq!(read_models(&[path]).expect("own table"), models);
}

#[test]
fn features_come_back_bit_for_bit() {
    let folder = tempfile::tempdir().expect("a folder");
    let rows: Vec<FeatureRow> = (0..300_u32)
        .map(|feature| FeatureRow {
            place: "hall".into(),
            feature,
            x: feature as f32 * 1.25,
            y: 0.1,
            size: 45.0,
            response: -3.5,
            descriptor: std::array::from_fn(|i| (i as u32 * feature) as u8),
            born: u128::from(feature / 10) << 70,
        })
        .collect();
    let path = folder.path().join("features.parquet");
    let mut table = FeatureWriter::begin(&path, "star-brief").expect("new");
    table.write(&rows).expect("written");
    table.finish().expect("finished");
    let again = read_features(std::slice::from_ref(&path));
    assert_eq!(again.expect("own table"), rows);
    // Whose they are stands beside them, and is the same in all files.
    let other = folder.path().join("other.parquet");
    let table = FeatureWriter::begin(&other, "orb").expect("new");
    table.finish().expect("finished");
    let found = read_extractor(&[path.clone(), path.clone()]);
    assert_eq!(found.expect("one"), Some("star-brief".into()));
    let error = read_extractor(&[path, other]).expect_err("two").to_string();
    for word in [
        "other.parquet",
        "chronotope.extractor",
        "`orb`",
        "`star-brief`",
    ] {
        assert!(error.contains(word), "{error}");
    }
}

#[test]
fn the_history_of_one_feature_is_a_series() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("observations.parquet");
    let rows = observations();
    write(&path, &rows);
    let files = [path];
    let series = read_series(&files, Some("lab"), Some(4)).expect("known");
    let expected: Vec<_> = (rows.iter())
        .filter(|row| row.place == "lab" && row.feature == 4)
        .map(|row| (row.time, row.state))
        .collect();
    assert_eq!(series.states(), expected);
    for (place, feature, kind, says) in [
        (None, None, ErrorKind::Config, "3 places"),
        (Some("lab"), None, ErrorKind::Config, "90 features"),
        (Some("attic"), None, ErrorKind::NotFound, "no place `attic`"),
        (Some("lab"), Some(90), ErrorKind::NotFound, "no feature 90"),
    ] {
        let error = read_series(&files, place, feature).expect_err("not one feature");
        assert_eq!(error.kind(), kind);
        assert!(error.to_string().contains(says), "{error}");
    }
}

#[test]
fn what_is_not_finished_leaves_nothing_and_is_not_read() {
    let folder = tempfile::tempdir().expect("a folder");
    let names = || {
        let mut names: Vec<String> = fs::read_dir(folder.path())
            .expect("there")
            .map(|it| {
                it.expect("there")
                    .file_name()
                    .to_string_lossy()
                    .into_owned()
            })
            .collect();
        names.sort();
        names
    };
    let path = folder.path().join("table");
    let output = TableFolder::begin(&path).expect("new");
    let mut table = ObservationWriter::begin(output.file("part-0.parquet")).expect("new");
    let log = log_of(&observations()[..50]);
    let visit = &log.places()[0].visits()[0];
    (table.visit("hall", visit.id, visit.time, &visit.states)).expect("written");
    assert_eq!(names(), [".table.unfinished"]);
    drop(table);
    drop(output);
    assert!(names().is_empty());

    // A folder of which only some files are there: what a killed engine leaves.
    fs::create_dir(&path).expect("new");
    write(&path.join("part-0.parquet"), &observations()[..50]);
    let inputs = [path.clone()];
    let error = files_of(&inputs).expect_err("not finished");
    assert!(error.to_string().contains("_SUCCESS"), "{error}");
    fs::write(path.join("_SUCCESS"), "").expect("written");
    let files = files_of(&inputs).expect("finished");
    assert_eq!(files, [path.join("part-0.parquet")]);
    let (log, _) = read_observations(&files, &ReadConfig::default()).expect("sound");
    assert_eq!(log.num_observations(), 50);
    assert_eq!(
        TableFolder::begin(&path).expect_err("it is there").kind(),
        ErrorKind::AlreadyExists
    );
}

#[test]
fn visits_that_do_not_fit_into_the_memory_are_an_error() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("observations.parquet");
    write(&path, &observations());
    let cfg = ReadConfig::default().with_max_bytes(1_000);
    let files: [PathBuf; 1] = [path];
    let error = read_observations(&files, &cfg).expect_err("too large");
    assert_eq!(error.kind(), ErrorKind::Shape);
}
