//! How is a run of exploration shown in a terminal?

use std::fmt::Write as _;

use super::results::ExploreResults;

/// All rows, a line each.
pub fn table(results: &ExploreResults) -> String {
    let mut text = String::new();
    let _ = writeln!(text, "{}: {}", results.suite, results.protocol);
    if results.majority > 0.0 {
        let _ = writeln!(
            text,
            "static (majority of each state) {:.2} %, oracle {:.2} %",
            100.0 * results.majority,
            100.0 * results.oracle
        );
    }
    for row in &results.rows {
        let _ = write!(
            text,
            "{}{:13} {:21} {:5.2} % ({:.2} to {:.2}, worst {:.2})",
            if row.is_default { "* " } else { "  " },
            row.strategy,
            row.model,
            100.0 * row.error.value,
            100.0 * row.error.low,
            100.0 * row.error.high,
            100.0 * row.worst
        );
        if let Some(published) = row.published {
            let _ = write!(text, ", published {:.1} %", 100.0 * published);
        }
        let _ = match row.bits_an_hour {
            None => writeln!(text, ", {:.2} bits a visit", row.bits_a_visit),
            Some(bits) => writeln!(
                text,
                ", {:.1} ({:.1} to {:.1}) bits an hour, {:.0} s of driving a day, {} late",
                bits.value, bits.low, bits.high, row.travel_s_a_day, row.num_late
            ),
        };
    }
    for note in &results.notes {
        let _ = writeln!(text, "{note}");
    }
    text
}
