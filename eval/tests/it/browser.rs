//! Does the report work in a real browser? Where Chromium is missing, the test says so and passes.

#![allow(
    clippy::unwrap_used,
    reason = "a helper of tests; clippy only knows their functions"
)]

use std::path::{Path, PathBuf};
use std::process::Command;

use chronotope_eval::report::{self, ReportInput};

use crate::{pictures, sample};

/// The first Chromium on the search path.
fn chromium() -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path)
        .flat_map(|dir| {
            ["chromium", "chromium-browser", "google-chrome"].map(|name| dir.join(name))
        })
        .find(|program| program.is_file())
}

/// The page's document after its scripts have run, and what the browser said.
fn dump(chromium: &Path, page: &Path, profile: &Path) -> (String, String) {
    let output = Command::new(chromium)
        .args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-quic",
            "--no-first-run",
        ])
        .args([
            "--disable-background-networking",
            "--disable-component-update",
            "--disable-sync",
        ])
        .args([
            "--enable-logging=stderr",
            "--virtual-time-budget=2000",
            "--dump-dom",
        ])
        .arg(format!("--user-data-dir={}", profile.display()))
        .arg(format!("file://{}", page.display()))
        .output()
        .unwrap();
    (
        String::from_utf8_lossy(&output.stdout).into_owned(),
        String::from_utf8_lossy(&output.stderr).into_owned(),
    )
}

#[test]
fn the_report_works_in_a_browser() {
    let Some(chromium) = chromium() else {
        println!("no Chromium on the search path: the report is not opened");
        return;
    };
    let (results, pictures) = (sample::sample_results(), pictures::sample_pictures());
    let input = ReportInput {
        results: &results,
        pictures: &pictures,
    };
    let dir = tempfile::tempdir().unwrap();
    let page = Path::new(env!("CARGO_TARGET_TMPDIR")).join("sample-report.html");
    report::write(&input, &page).unwrap();
    // The script sorts the summary once and hides a line: what a reader would press.
    let html = std::fs::read_to_string(&page).unwrap().replace(
        "</body>",
        "<script>document.querySelectorAll('#rows thead button')[4].click();\
         document.querySelector('.plot .key').click();</script></body>",
    );
    let pressed = dir.path().join("pressed.html");
    std::fs::write(&pressed, html).unwrap();
    let (document, log) = dump(&chromium, &pressed, &dir.path().join("profile"));
    assert!(
        document.contains("data-ready=\"yes\""),
        "the script did not run: {log}"
    );
    assert!(!log.contains("CONSOLE"), "{log}");
    assert!(document.contains("aria-sort=\"ascending\""));
    assert!(document.contains("aria-pressed=\"false\"") && document.contains("off\" data-series"));
    // Six plots (two axes, three groups), one live image, four curves; keys have swatches besides.
    assert_eq!(
        document
            .matches("role=\"img\" aria-label=\"Wrong answers")
            .count(),
        6
    );
    assert_eq!(document.matches("class=\"scene\"").count(), 1);
    assert_eq!(document.matches("<path class=\"pt\"").count(), 4);
    assert_eq!(document.matches("src=\"data:image/jpeg").count(), 8);
}
