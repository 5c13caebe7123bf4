//! `chronotope map held`, `map accept`, `map drop` and `map forget`.

use std::fs;

use crate::fixture::{Fixture, plain, png, query_time};
use chronotope::Period;
use serde_json::Value;

#[test]
fn doubtful_visits_are_held_until_they_are_accepted_or_dropped() {
    let fixture = Fixture::with_map();
    let later = query_time().plus_us(Period::DAY.as_us());
    let index = format!(
        "place,time,path\nplace-00,{},black.png\nplace-00,{later},other.png\nplace-01,{later},own.png\n",
        query_time()
    );
    fs::create_dir(fixture.path("odd")).expect("writable");
    fixture.write("odd/index.csv", index);
    fixture.write("odd/black.png", plain((320, 240), 3));
    fixture.write("odd/other.png", png(1, later, 7));
    fixture.write("odd/own.png", png(1, later, 7));
    let update = || fixture.run("map update street.map --data odd");
    let updated = update();
    assert_eq!(updated.code, 1, "{updated:?}");
    updated.prints(&["(1 learnt now)"]);
    updated.notes(&[
        "the image is black",
        "it looks like place `place-01`",
        "2 visits are held",
        "chronotope map accept street.map --all",
    ]);
    let again = update();
    again.prints(&["(0 learnt now)"]);
    assert_eq!(again.code, 0, "nothing more is held: {again:?}");

    let held = || fixture.run("map held street.map --json").lines();
    let listed = held();
    assert_eq!(listed.len(), 2);
    assert_eq!(listed[0]["doubt"]["kind"], "blind");
    assert_eq!(listed[0]["doubt"]["gray-range"][1], 3);
    assert_eq!(listed[1]["doubt"]["kind"], "disagreement");
    let id = |visit: &Value| visit["visit"].as_str().expect("a text")[..9].to_owned();
    fixture.succeeds(&format!("map drop street.map {}", id(&listed[0])));
    let accept = format!("map accept street.map {}", id(&listed[1]));
    fixture.succeeds(&accept);
    assert!(held().is_empty());
    fixture.fails(&accept, &["no visit that is held"]);
    fixture.succeeds("map verify street.map");

    let num_visits = || fixture.open("street.map").summary().num_visits;
    assert_eq!(num_visits(), 26);
    let forgotten = fixture.run("map forget street.map --session odd");
    forgotten.prints(&["2 visits forgotten"]);
    assert_eq!(num_visits(), 24);
    fixture.fails(
        "map forget street.map --session odd",
        &["no visits of session"],
    );
    fixture.succeeds("map verify street.map");
}
