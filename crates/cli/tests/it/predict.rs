//! `chronotope predict`.

use crate::fixture::{Fixture, NUM_PLACES, QUERY_TIME};

#[test]
fn predictions_are_the_most_likely_features() {
    let fixture = Fixture::with_map();
    let ran = fixture.run(&format!(
        "predict street.map --time {QUERY_TIME} --n 5 --json"
    ));
    assert_eq!((ran.code, ran.stderr.as_str()), (0, ""), "{ran:?}");
    assert_eq!(ran.lines().len(), NUM_PLACES);
    for line in ran.lines() {
        let features = line["features"].as_array().expect("an array");
        assert_eq!(features.len(), 5);
        let p: Vec<f64> = features
            .iter()
            .map(|it| it["p"].as_f64().expect("a number"))
            .collect();
        assert!(
            p.iter().all(|p| (0.0..=1.0).contains(p)) && p.is_sorted_by(|a, b| a >= b),
            "{p:?}"
        );
    }
    let ran = fixture.succeeds(&format!(
        "predict street.map --time {QUERY_TIME} --node place-03 --n 100000"
    ));
    assert!(
        ran.stdout.starts_with("place-03 at 2023-11-15T12:00:00Z: "),
        "{ran:?}"
    );
    let time = "predict street.map --time";
    let far = fixture.succeeds(&format!("{time} 1999-01-01T00:00:00Z --n 1"));
    far.notes(&["before the map's first visit"]);
    let far = fixture.succeeds(&format!("{time} 2223-01-01T00:00:00Z --n 1"));
    far.notes(&["after the map's last visit"]);

    fixture.fails(&format!("{time} yesterday"), &["yesterday", "RFC 3339"]);
    fixture.fails(
        &format!("{time} 2023-11-15T12:00:00"),
        &["RFC 3339 with an offset"],
    );
    fixture.fails(
        &format!("{time} {QUERY_TIME} --node moon"),
        &["no place `moon`", "place-00"],
    );
    for n in ["0", "-1", "NaN"] {
        fixture.fails(&format!("{time} {QUERY_TIME} --n={n}"), &[n]);
    }
}
