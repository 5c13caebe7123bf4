//! `chronotope map log`, `map rollback` and `map prune`.

use crate::fixture::{Fixture, NUM_PLACES, NUM_VISITS, Ran};
use serde_json::Value;

#[test]
fn a_map_is_rolled_back_and_pruned() {
    let fixture = Fixture::with_map();
    let numbers = |ran: &Ran| -> Vec<u64> {
        let number = |line: &Value| line["number"].as_u64().expect("a number");
        ran.lines().iter().map(number).collect()
    };
    let logged = fixture.succeeds("map log street.map --json");
    let before = numbers(&logged);
    let newest = before.last().copied().expect("some");
    let visits: i64 = (logged.lines().iter())
        .map(|line| line["added_visits"].as_i64().expect("a number"))
        .sum();
    assert_eq!(visits, (NUM_VISITS as usize * NUM_PLACES) as i64);
    // What can be taken back by `map forget` is listed.
    let sessions = &logged.lines().pop().expect("some")["sessions"];
    let session = sessions[0]["session"]
        .as_str()
        .expect("a session")
        .to_owned();
    assert_eq!(sessions[0]["num_visits"], visits);
    fixture
        .succeeds("map log street.map")
        .prints(&[&format!("session {session}  {visits} visits")]);
    let digest = || fixture.digest("street.map");
    let whole = digest();
    let back = fixture.succeeds("map rollback street.map --to 0");
    back.prints(&["0 places"]);
    assert_ne!(digest(), whole);
    let shown = fixture.run("map log street.map");
    shown.prints(&["back to generation 0", "(rolled back)"]);
    fixture.succeeds(&format!("map rollback street.map --to {newest}"));
    assert_eq!(digest(), whole);
    let kept = fixture.succeeds("map prune street.map --keep-last 1 --dry-run");
    kept.prints(&["may go"]);
    fixture.succeeds("map prune street.map --keep-last 1");
    let left = numbers(&fixture.run("map log street.map --json"));
    assert_eq!(left, [0, newest + 2]);
    assert_eq!(digest(), whole);
    fixture.fails(
        "map rollback street.map --to 999",
        &["street.map", "no generation 999", "map log"],
    );
    fixture.fails("map prune street.map", &["--keep-last"]);
}
