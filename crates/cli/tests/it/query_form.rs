//! What `chronotope localize` keeps beside a map to open it faster.

use std::fs;
use std::path::PathBuf;

use crate::fixture::{Fixture, QUERIES, QUERY_TIME};
use serde_json::Value;

/// Everything beside the map that is kept to open it faster.
fn query_forms(fixture: &Fixture) -> Vec<PathBuf> {
    let entries = fs::read_dir(fixture.path("")).expect("a folder");
    let mut found: Vec<PathBuf> = (entries.map(|entry| entry.expect("an entry").path()))
        .filter(|path| path.extension().is_some_and(|it| it == "query"))
        .collect();
    found.sort();
    found
}

#[test]
fn a_query_form_changes_no_answer() {
    let fixture = Fixture::with_map();
    let query = |form: &str, more: &str| {
        fixture.succeeds(&format!(
            "localize street.map --json --time {QUERY_TIME} --query-form {form} {QUERIES} {more}"
        ))
    };
    // Everything but how long it took.
    let evidence = || -> Vec<Value> {
        let text = fs::read_to_string(fixture.path("trace.jsonl")).expect("written");
        let mut lines: Vec<Value> = (text.lines())
            .map(|line| serde_json::from_str(line).expect("JSON"))
            .collect();
        for line in &mut lines {
            let line = line.as_object_mut().expect("an object");
            assert!(line.remove("duration_ms").is_some() && line.remove("stages").is_some());
        }
        lines
    };
    for (index, more) in [
        "--method fremen --track",
        "--method static --trace trace.jsonl",
        "--trace trace.jsonl --n 20",
        "--method experience-all --trace trace.jsonl",
    ]
    .into_iter()
    .enumerate()
    {
        let without = query("never", more).stdout;
        let traced = (index > 0).then(evidence);
        assert_eq!(query_forms(&fixture).len(), index, "{more:?}");
        assert_eq!(query("always", more).stdout, without, "{more:?}");
        assert_eq!(query_forms(&fixture).len(), index + 1, "{more:?}");
        let again = query("auto", &format!("{more} -v"));
        again.notes(&["opened by the query form"]);
        assert_eq!(again.stdout, without, "{more:?}");
        assert_eq!((index > 0).then(evidence), traced, "{more:?}");
    }
}

#[test]
fn a_query_form_that_does_not_fit_is_made_anew_and_one_that_cannot_be_kept_is_none() {
    let fixture = Fixture::with_map();
    let query = |form: &str| {
        let line = "localize street.map query1.png --json";
        let form = format!("--time {QUERY_TIME} --query-form {form}");
        fixture.succeeds(&format!("{line} {form}")).stdout
    };
    let expected = query("always");
    let [file] = &query_forms(&fixture)[..] else {
        panic!("one query form");
    };
    let whole = fs::read(file).expect("kept");
    let mut damaged = whole.clone();
    damaged[whole.len() / 2] ^= 4;
    fs::write(file, damaged).expect("writable");
    assert_eq!(query("always"), expected);
    assert_eq!(fs::read(file).expect("kept"), whole);

    fixture.succeeds(&format!(
        "localize street.map query0.png --time {QUERY_TIME} --learn"
    ));
    let newer = query("never");
    assert_eq!(query("always"), newer);
    let [newest] = &query_forms(&fixture)[..] else {
        panic!("that of the generation before is gone");
    };
    assert_ne!(newest, file);

    // A folder in its place can be neither read nor replaced; rights would not stop the superuser.
    fs::remove_file(newest).expect("removed");
    fs::create_dir(newest).expect("made");
    assert_eq!(query("always"), newer);
    assert!(newest.is_dir());
}
