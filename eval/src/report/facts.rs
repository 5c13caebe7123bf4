//! How are numbers and facts of a run written, in a terminal and in a page?

use std::fmt::Write as _;

use crate::results::{SuiteResults, Variant};

/// A count with few digits: `987`, `12.3k`, `4.5M`.
pub(super) fn short_count(count: f64) -> String {
    match count {
        c if c < 9_999.5 => format!("{c:.0}"),
        c if c < 999_950.0 => format!("{:.1}k", c / 1e3),
        c => format!("{:.1}M", c / 1e6),
    }
}

/// Milliseconds with three digits or fewer; a dash where nothing was timed.
pub(super) fn short_ms(ms: f64) -> String {
    match ms {
        ms if ms <= 0.0 => "-".into(),
        ms if ms < 0.0995 => format!("{ms:.3}"),
        ms if ms < 9.95 => format!("{ms:.2}"),
        ms if ms < 99.5 => format!("{ms:.1}"),
        ms => format!("{ms:.0}"),
    }
}

/// The header of a run: what was measured on what, and how to measure it again.
pub(super) fn header_lines(results: &SuiteResults) -> Vec<(&'static str, String)> {
    let count = |num: Option<u32>, what: &str| num.map(|num| format!("{num} {what}"));
    let size = [
        Some(format!("{} queries", results.queries.len())),
        count(results.num_places, "places"),
        count(results.num_learnt_images, "images learnt"),
        count(results.num_broken_images, "unusable images left out"),
    ];
    let leak = results
        .leak_check
        .as_ref()
        .map_or_else(String::new, |check| {
            let mut text = format!(
                "{} images digested, {} duplicates of queries removed from learning",
                check.num_checked, check.num_removed
            );
            if !check.note.is_empty() {
                let _ = write!(text, "; {}", check.note);
            }
            text
        });
    let lines = [
        ("Dataset", results.dataset.clone()),
        (
            "Size",
            size.into_iter().flatten().collect::<Vec<_>>().join(", "),
        ),
        ("Split", results.split.clone()),
        (
            "Tolerance",
            (results.tolerance).map_or_else(String::new, |tolerance| {
                format!(
                    "an answer within {} also counts as right",
                    tolerance.in_words()
                )
            }),
        ),
        ("Leak check", leak),
        ("Clock", results.clock.clone()),
        ("Digest", results.dataset_sha256.clone()),
        ("Commit", results.commit.clone()),
        ("Machine", results.machine.clone()),
        ("Command", results.command.clone()),
    ];
    lines
        .into_iter()
        .filter(|(_, text)| !text.is_empty())
        .collect()
}

/// Method, model and order.
pub(super) fn short_name(variant: &Variant) -> String {
    format!("{} {} {}", variant.method, variant.model, variant.order)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_numbers_stay_short() {
        for (count, text) in [
            (7.0, "7"),
            (9_999.0, "9999"),
            (12_345.0, "12.3k"),
            (2.5e6, "2.5M"),
        ] {
            assert_eq!(short_count(count), text);
        }
        for (ms, text) in [
            (0.0123, "0.012"),
            (1.234, "1.23"),
            (45.67, "45.7"),
            (1234.0, "1234"),
        ] {
            assert_eq!(short_ms(ms), text);
        }
    }
}
