//! What does a run look like that is kept with the sources?
//!
//! Markdown, for people, next to the JSON of the same run: the machine, which targets were met, and
//! the whole table as the terminal shows it.

use std::fmt::Write as _;

use super::measurement::SpeedReport;
use super::table;

/// The page that is kept with the sources.
pub(super) fn markdown(report: &SpeedReport) -> String {
    let mut text = String::from(
        "# A run of `make speed`\n\n\
         Ratios hold within this run on this machine. Numbers in full: `speed.json`; growth: `growth.svg`.\n\n",
    );
    // Writing to a string cannot fail.
    let _ = writeln!(text, "- machine: {}", report.machine);
    for line in &report.host {
        let _ = writeln!(text, "- {line}");
    }
    let _ = writeln!(text, "- sources: {}", report.commit);
    let _ = writeln!(text, "- material: {}", report.material);
    for missing in &report.missing {
        let _ = writeln!(text, "- missing: {missing}");
    }
    text.push_str("\n## Targets\n\n| what | wanted | found | |\n|---|---|---|---|\n");
    for target in &report.targets {
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} |",
            target.name,
            target.wanted_text(),
            target.found_text(),
            target.verdict()
        );
    }
    let _ = write!(
        text,
        "\n## Everything\n\n```text\n{}```\n",
        table::render(report)
    );
    text
}

/// What runs beneath: system, caches, memory, and how busy the machine is, where the system reports
/// it.
pub(super) fn host() -> Vec<String> {
    let read = |path: &str| std::fs::read_to_string(path).ok();
    let first_words = |text: &str, count: usize| {
        text.split_whitespace()
            .take(count)
            .collect::<Vec<_>>()
            .join(" ")
    };
    let mut lines = Vec::new();
    if let Some(version) = read("/proc/version") {
        lines.push(format!("system: {}", first_words(&version, 3)));
    }
    let cache = |index: usize| {
        let of = |name: &str| {
            read(&format!(
                "/sys/devices/system/cpu/cpu0/cache/index{index}/{name}"
            ))
            .map(|text| text.trim().to_owned())
        };
        Some(format!(
            "L{} {} {}",
            of("level")?,
            of("type")?.to_lowercase(),
            of("size")?
        ))
    };
    let caches: Vec<String> = (0..4).filter_map(cache).collect();
    if !caches.is_empty() {
        lines.push(format!("caches: {}", caches.join(", ")));
    }
    if let Some(memory) = read("/proc/meminfo") {
        let total = memory
            .lines()
            .find_map(|line| line.strip_prefix("MemTotal:"));
        lines.extend(total.map(|total| format!("memory: {}", total.trim())));
    }
    if let Some(load) = read("/proc/loadavg") {
        let load = first_words(&load, 1);
        lines.push(format!(
            "load: {load} processes wanted to run when it began (itself is 1)"
        ));
    }
    lines
}
