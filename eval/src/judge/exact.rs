//! Are two runs the same, number by number?
//!
//! Any two `SUITE.json` are compared, of images or of series: every field of the one must be in the
//! other with the same value. Only what differs from run to run by its nature is left out: commit,
//! machine, command, and times in ms.

use std::fmt;
use std::path::Path;

use chronotope::{Error, ErrorKind, Result};
use serde_json::Value;

/// Fields that say where and how fast a run was, not what came of it.
const LEFT_OUT: [&str; 5] = ["commit", "machine", "command", "ms_p50", "ms_p99"];

/// So many differences are listed.
const MAX_LISTED: usize = 20;

/// What differs between two files.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Differences {
    /// How many fields.
    pub num: usize,
    /// The first of them, in words.
    pub listed: Vec<String>,
}

impl fmt::Display for Differences {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for text in &self.listed {
            writeln!(f, "{text}")?;
        }
        let more = self.num - self.listed.len();
        if more > 0 {
            writeln!(f, "and {more} more")?;
        }
        writeln!(f, "{} differences", self.num)
    }
}

/// Compares two files.
pub fn compare_files(a: &Path, b: &Path) -> Result<Differences> {
    Ok(compare_values(&read(a)?, &read(b)?))
}

fn read(path: &Path) -> Result<Value> {
    let bytes = std::fs::read(path).map_err(|error| Error::io(path, error))?;
    serde_json::from_slice(&bytes)
        .map_err(|error| Error::new(ErrorKind::Format, error.to_string()).with_path(path))
}

/// Compares two values field by field.
pub fn compare_values(a: &Value, b: &Value) -> Differences {
    let mut differences = Differences::default();
    differences.walk("", a, b);
    differences
}

impl Differences {
    fn walk(&mut self, at: &str, a: &Value, b: &Value) {
        match (a, b) {
            (Value::Object(a), Value::Object(b)) => {
                for (name, value) in a.iter().filter(|(name, _)| is_compared(name)) {
                    let at = format!("{at}.{name}");
                    match b.get(name) {
                        Some(other) => self.walk(&at, value, other),
                        None => self.add(format!("{at}: only in A")),
                    }
                }
                for name in b
                    .keys()
                    .filter(|name| is_compared(name) && !a.contains_key(*name))
                {
                    self.add(format!("{at}.{name}: only in B"));
                }
            }
            (Value::Array(a), Value::Array(b)) => {
                if a.len() != b.len() {
                    self.add(format!("{at}: {} entries in A, {} in B", a.len(), b.len()));
                }
                for (index, (a, b)) in a.iter().zip(b).enumerate() {
                    self.walk(&format!("{at}[{index}]"), a, b);
                }
            }
            _ if a != b => self.add(format!("{at}: {a} in A, {b} in B")),
            _ => {}
        }
    }

    fn add(&mut self, text: String) {
        self.num += 1;
        if self.listed.len() < MAX_LISTED {
            self.listed.push(text);
        }
    }
}

fn is_compared(name: &str) -> bool {
    !LEFT_OUT.contains(&name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn runs_that_differ_in_place_and_speed_alone_are_the_same() {
        let run =
            |commit: &str, ms: f64| json!({"commit": commit, "rows": [{"n": 5, "ms_p50": ms}]});
        let differences = compare_values(&run("a", 1.0), &run("b", 2.0));
        assert_eq!(differences.to_string(), "0 differences\n");
    }

    #[test]
    fn every_other_difference_is_named_by_its_place() {
        let a = json!({"rows": [{"n": 5, "wrong": 1.0, "old": 1}], "queries": [1, 2]});
        let b = json!({"rows": [{"n": 5, "wrong": 1.5, "new": 1}], "queries": [1]});
        let text = compare_values(&a, &b).to_string();
        for line in [
            ".rows[0].wrong: 1.0 in A, 1.5 in B",
            ".rows[0].old: only in A",
            ".rows[0].new: only in B",
            ".queries: 2 entries in A, 1 in B",
            "4 differences",
        ] {
            assert!(text.contains(line), "{text}");
        }
    }

    #[test]
    fn a_long_list_is_cut_and_counted() {
        let many = |from: usize| Value::from((from..from + 50).collect::<Vec<_>>());
        let differences = compare_values(&many(0), &many(1));
        assert_eq!(
            (differences.num, differences.listed.len()),
            (50, MAX_LISTED)
        );
        assert!(differences.to_string().contains("and 30 more"));
    }
}
