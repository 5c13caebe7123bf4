//! How are variants named and coloured, and which of them is a report about?

use crate::report::headline::BASELINE;
use crate::report::html::put;
use crate::results::{Row, RowOrder, Variant};

/// Index into the colours of the style sheet, the same for a method in all plots.
pub(super) fn colour(method: &str) -> usize {
    const KNOWN: [&str; 6] = [
        BASELINE,
        "fremen",
        "experience",
        "experience-all",
        "freex",
        "fused",
    ];
    KNOWN
        .iter()
        .position(|known| *known == method)
        .unwrap_or_else(|| {
            let sum: usize = method.bytes().map(usize::from).sum();
            KNOWN.len() + sum % 2
        })
}

/// Method with model and order, for people: parts that say nothing are left out.
pub(in crate::report) fn label(variant: &Variant) -> String {
    let mut text = variant.method.clone();
    if !matches!(variant.model.as_str(), "mean" | "none" | "-" | "") {
        put!(text, " {}", variant.model);
    }
    match variant.order {
        RowOrder::Fixed(0) => {}
        RowOrder::Fixed(order) => put!(text, ", order {order}"),
        RowOrder::Auto => text.push_str(", order auto"),
    }
    text
}

pub(super) fn interval_text(row: &Row) -> String {
    format!("{:.1} to {:.1}", row.ci_low, row.ci_high)
}

/// A number of queries, with its split ties where there are some.
pub(super) fn trimmed(count: f64) -> String {
    let text = format!("{count:.1}");
    text.strip_suffix(".0").map_or(text.clone(), str::to_owned)
}
