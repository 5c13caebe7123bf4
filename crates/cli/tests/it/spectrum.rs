//! `chronotope spectrum` as its users run it: a real process and files.

use std::fmt::Write as _;
use std::process::{Command, Output};

use chronotope::{Period, Time};
use serde_json::Value;

fn spectrum(text: &str, args: &[&str]) -> Output {
    let dir = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(dir.path().join("door.csv"), text).expect("writable");
    Command::new(env!("CARGO_BIN_EXE_chronotope"))
        .current_dir(dir.path())
        .args(["spectrum", "door.csv"])
        .args(args)
        .output()
        .expect("the command starts")
}

fn stdout(output: &Output) -> String {
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert!(output.stderr.is_empty(), "{output:?}");
    String::from_utf8(output.stdout.clone()).expect("text")
}

/// A door that is open from 6 to 18 h of every day, looked at every hour for so many days.
fn door(num_days: i64, time: impl Fn(Time) -> String) -> String {
    let mut text = String::from("when,open\n");
    for hour in 0..24 * num_days {
        let when = Time::parse("2024-05-01T00:00:00Z")
            .expect("valid")
            .plus_us(hour * Period::HOUR.as_us());
        let open = u8::from((6..18).contains(&(hour % 24)));
        writeln!(text, "{},{open}", time(when)).expect("memory");
    }
    text
}

#[test]
fn a_daily_rhythm_is_found_with_its_peak_and_foretold() {
    let text = door(28, |time| time.to_string());
    let args = [
        "--json",
        "--predict-at",
        "2024-06-10T12:00:00Z",
        "--predict-at",
        "2024-06-10T00:00:00Z",
    ];
    let line = stdout(&spectrum(&text, &args));
    assert_eq!(line.lines().count(), 1, "{line}");
    let found: Value = serde_json::from_str(&line).expect("JSON");
    assert_eq!(found["num_samples"], 28 * 24);
    assert_eq!(found["num_held_out"], 7 * 24);
    for model in found["learnt"].as_array().expect("a list") {
        let strongest = &model["components"][0];
        assert_eq!(strongest["period_s"], 86_400.0, "{model}");
        let peak = strongest["first_peak"].as_str().expect("a time");
        // Samples stand for the hour after them, so the middle of the open ones is half past
        // eleven.
        assert!(peak.starts_with("2024-05-01T11:"), "{model}");
        assert!(
            model["predicted"][0]["p"].as_f64().expect("a number") > 0.9,
            "{model}"
        );
        assert!(
            model["predicted"][1]["p"].as_f64().expect("a number") < 0.1,
            "{model}"
        );
    }
    let held_out = found["held_out"].as_array().expect("a list");
    let mean = (held_out.iter()).find(|row| row["model"] == "fremen" && row["order"] == 0);
    let brier = |row: &Value| row["brier"].as_f64().expect("a number");
    let mean = brier(mean.expect("order 0"));
    assert!((mean - 0.25).abs() < 1e-9, "{mean}");
    for row in held_out.iter().filter(|row| row["chosen"] == true) {
        assert!(brier(row) < 0.1 * mean, "{row}");
    }
}

#[test]
fn seconds_and_a_table_for_people_say_the_same() {
    let seconds = door(28, |time| time.as_us().div_euclid(1_000_000).to_string());
    let shown = stdout(&spectrum(&seconds, &[]));
    assert_eq!(
        shown,
        stdout(&spectrum(&door(28, |time| time.to_string()), &[]))
    );
    for words in [
        "672 samples over",
        "1 in 50.0 % of them",
        "natural",
        "fremen",
        "1 d",
        "2024-05-01T11:30:00Z",
    ] {
        assert!(shown.contains(words), "no `{words}` in {shown}");
    }
}

#[test]
fn few_samples_and_unchanging_ones_have_an_answer() {
    for text in ["5,1\n", "5,1\n5,0\n5,1\n", &"7,1\n".repeat(40)] {
        let shown = stdout(&spectrum(text, &["--predict-at", "9e9"]));
        assert!(
            shown.contains("no rhythm") && !shown.contains("NaN"),
            "{shown}"
        );
    }
}

#[test]
fn what_is_no_series_fails_with_file_and_line() {
    for (text, args, words) in [
        (
            "5,1\n6,open\n",
            &[][..],
            ["door.csv: line 2", "`open` is no state"],
        ),
        ("5,1\ninf,1\n", &[], ["line 2", "is no time"]),
        ("", &[], ["door.csv", "no rows"]),
        (
            "t,a\n5,1\n",
            &["--state-column", "b"],
            ["no column `b`", "t, a"],
        ),
        ("5,1\n", &["--base-s", "-3"], ["period", "-3"]),
        ("5,1\n", &["--count", "0"], ["candidate periods", "not 0"]),
        ("5,1\n", &["--held-out", "2"], ["--held-out", "0.9"]),
    ] {
        let output = spectrum(text, args);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{stderr}");
        for word in words {
            assert!(stderr.contains(word), "no `{word}` in {stderr}");
        }
        assert!(output.stdout.is_empty());
    }
}

#[test]
fn a_picture_shows_data_models_spectrum_and_sampling() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("door.svg");
    let file = path.to_str().expect("text");
    let told = spectrum(&door(21, |time| time.to_string()), &["--svg", file]);
    assert_eq!(
        stdout(&told),
        stdout(&spectrum(&door(21, |time| time.to_string()), &[])),
        "drawing changes no answer"
    );
    let svg = std::fs::read_to_string(&path).expect("was written");
    assert!(
        svg.starts_with("<svg") && svg.ends_with("</svg>\n"),
        "{svg}"
    );
    for part in ["state", "amplitude", "window"] {
        assert_eq!(
            svg.matches(&format!("class=\"{part}\"")).count(),
            1,
            "{part}"
        );
    }
    assert_eq!(svg.matches("<polyline class=\"p\"").count(), 2);
    // The latest two weeks: 14 days of which each has one stretch of 12 samples.
    let state = svg.split("class=\"state\"").nth(1).expect("drawn");
    assert_eq!(
        state
            .split("/>")
            .next()
            .map(|path| path.matches('M').count()),
        Some(14 * 12)
    );
    let nowhere = spectrum(
        &door(21, |time| time.to_string()),
        &["--svg", "no/such/folder.svg"],
    );
    assert_eq!(nowhere.status.code(), Some(2), "{nowhere:?}");
    assert!(String::from_utf8_lossy(&nowhere.stderr).contains("folder.svg"));
}
