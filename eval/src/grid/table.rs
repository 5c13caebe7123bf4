//! What does a run over grids say at a glance, in a terminal?

use std::fmt::Write as _;

use super::results::{Cell, Column, GridResults, facts};

/// All tables and targets as text.
pub fn table(results: &GridResults) -> String {
    let mut text = format!("Suite {}: {}\n", results.suite, results.title);
    for (name, value) in facts(results) {
        let _ = writeln!(text, "  {name:<11}{value}");
    }
    for table in &results.tables {
        let _ = writeln!(text, "\n{}", table.title);
        let names = table.rows.iter().map(|row| row.name.chars().count());
        let width = names.chain([table.of.chars().count()]).max().unwrap_or(0);
        let columns: Vec<(&Column, Vec<String>, usize)> = (table.columns.iter())
            .map(|column| {
                let shown = table.rows.iter().map(|row| {
                    let value = row.values.get(&column.key);
                    value.map_or_else(|| "-".to_owned(), |it| show(*it, column.decimals))
                });
                let shown: Vec<String> = shown.collect();
                let widths = shown.iter().map(|it| it.chars().count());
                let width = widths.chain([column.heading.chars().count()]).max();
                (column, shown, width.unwrap_or(0))
            })
            .collect();
        let _ = write!(text, "  {:<width$}", table.of);
        for (column, _, width) in &columns {
            let _ = write!(text, "  {:>width$}", column.heading);
        }
        for (number, row) in table.rows.iter().enumerate() {
            let mark = if row.is_default { '*' } else { ' ' };
            let _ = write!(text, "\n{mark} {:<width$}", row.name);
            for (_, shown, width) in &columns {
                let _ = write!(text, "  {:>width$}", shown[number]);
            }
        }
        text.push('\n');
    }
    if !results.targets.is_empty() {
        text.push_str("\nWhat is wanted\n");
    }
    for target in &results.targets {
        let verdict = if target.is_met { "met   " } else { "MISSED" };
        let _ = writeln!(text, "  {verdict}  {}: {}", target.wanted, target.measured);
    }
    text.push_str("\n* what this project ships\n");
    text
}

/// A number with its interval.
pub(crate) fn show(cell: Cell, decimals: usize) -> String {
    match (cell.low, cell.high) {
        (Some(low), Some(high)) => {
            format!(
                "{:.decimals$} [{low:.decimals$}, {high:.decimals$}]",
                cell.value
            )
        }
        _ => format!("{:.decimals$}", cell.value),
    }
}
