//! The made-up run, from answers to files.

mod sample;

use chronotope_eval::results::SuiteResults;
use chronotope_eval::table;

#[test]
fn the_sample_run_survives_its_file() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("sample.json");
    let results = sample::sample_results();
    results.write(&path).unwrap();
    let read = SuiteResults::read(&path).unwrap();
    assert_eq!(read, results);
    println!("{}", table::render(&read, None));
}
