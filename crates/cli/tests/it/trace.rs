//! The evidence that `chronotope localize --trace` writes.

use std::fs;

use crate::fixture::{Fixture, NUM_PLACES, QUERY_TIME};
use serde_json::Value;

#[test]
fn a_trace_is_complete_in_itself() {
    let fixture = Fixture::with_map();
    let query = format!("localize street.map query1.png query2.png --time {QUERY_TIME}");
    for method in ["fremen", "experience"] {
        let ran = fixture.succeeds(&format!("{query} --method {method} --trace -"));
        ran.notes(&["query1.png  place-01"]);
        let lines = ran.lines();
        assert_eq!(lines.len(), 2);
        for line in &lines {
            let length = |value: &Value| value.as_array().expect("an array").len();
            let ranking = &line["localization"]["ranking"];
            assert_eq!(length(ranking), NUM_PLACES);
            assert_eq!(length(&line["places"]), NUM_PLACES);
            for (candidate, predicted) in ranking
                .as_array()
                .expect("an array")
                .iter()
                .zip(line["predicted"].as_array().expect("an array"))
            {
                if method == "fremen" {
                    assert_eq!(length(&candidate["predicted"]), length(predicted));
                }
                for found in candidate["matches"].as_array().expect("an array") {
                    assert!(
                        (found["rank"].as_u64().expect("a number") as usize) < length(predicted)
                    );
                    assert!(
                        (found["live"].as_u64().expect("a number") as usize)
                            < length(&line["live"])
                    );
                }
            }
            assert!(length(&line["localization"]["ranking"][0]["matches"]) > 0);
        }
    }
    let ran = fixture.run(&format!("{query} --trace trace.jsonl --json"));
    assert_eq!(ran.lines().len(), 2);
    let trace = fs::read_to_string(fixture.path("trace.jsonl")).expect("written");
    assert_eq!(trace.lines().count(), 2);
    let both = format!("{query} --trace - --json");
    fixture.fails(&both, &["--json", "--trace -"]);
}
