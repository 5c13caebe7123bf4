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

/// What a reader would do and see, done and measured in the page; the findings go into
/// `data-findings`.
const AUDIT: &str = include_str!("audit.js");

/// The page's document after its scripts have run, and what the browser said.
fn dump(chromium: &Path, page: &Path, profile: &Path, more: &[&str]) -> (String, String) {
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
        .args(more)
        .arg(format!("--user-data-dir={}", profile.display()))
        .arg(format!("file://{}", page.display()))
        .output()
        .unwrap();
    (
        String::from_utf8_lossy(&output.stdout).into_owned(),
        String::from_utf8_lossy(&output.stderr).into_owned(),
    )
}

/// The value of an attribute of the document's root.
fn attribute(document: &str, name: &str) -> String {
    let value = document.split(&format!("{name}=\"")).nth(1);
    let value = value.and_then(|rest| rest.split('"').next());
    value.unwrap_or("missing").replace("&quot;", "'")
}

#[test]
fn the_report_works_in_a_browser() {
    let Some(chromium) = chromium() else {
        println!("skipped: no Chromium on the search path, the report is not opened");
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
    let html = (std::fs::read_to_string(&page).unwrap())
        .replace("</body>", &format!("<script>{AUDIT}</script></body>"));
    let audited = dir.path().join("audited.html");
    std::fs::write(&audited, html).unwrap();
    let phone: &[&str] = &["--window-size=390,844"];
    // 0 is dark, 1 is light.
    let modes: [(&str, &[&str]); 3] = [
        ("light", &["--blink-settings=preferredColorScheme=1"]),
        ("dark", &["--blink-settings=preferredColorScheme=0"]),
        ("phone", phone),
    ];
    for (mode, more) in modes {
        let profile = dir.path().join(mode);
        let (document, log) = dump(&chromium, &audited, &profile, more);
        assert!(
            document.contains("data-ready=\"yes\""),
            "{mode}: the script did not run: {log}"
        );
        assert!(!log.contains("CONSOLE"), "{mode}: {log}");
        assert_eq!(attribute(&document, "data-findings"), "none", "{mode}");
        if mode != "phone" {
            assert_eq!(attribute(&document, "data-mode"), mode);
        }
        let tables: usize = attribute(&document, "data-sorted").parse().unwrap();
        assert!(tables >= 3, "{mode}: {tables} tables were sorted");
        assert!(
            document.contains("aria-pressed=\"false\"") && document.contains("off\" data-series")
        );
        // Six plots (two axes, three groups), one live image, four curves of which three have a
        // spectrum.
        for (what, num) in [
            ("role=\"img\" aria-label=\"Wrong answers", 6),
            ("class=\"scene\"", 1),
            ("<path class=\"pt\"", 4),
            ("<path class=\"stems\"", 3),
            ("<path class=\"seen\"", 1),
            ("src=\"data:image/jpeg", 8),
        ] {
            assert_eq!(document.matches(what).count(), num, "{mode}: {what}");
        }
    }
}
