//! How far from the true place may an answer be, and still count as right?
//!
//! Neighbouring places of a route show nearly the same, and a robot that takes one for the other is
//! still on its way. Visual place recognition therefore counts an answer as right if it is near
//! enough; the exact count stays beside it.

use std::fmt;
use std::str::FromStr;

use chronotope::{Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};

/// What is near enough. As text, in TOML and in JSON: `places:1`, `edges:2`, `metres:5`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Tolerance {
    /// At most so many places further along the route, in the order in which they were learnt.
    Places(u32),
    /// At most so many ways between places (edges.csv) further, in either direction.
    Edges(u32),
    /// At most so many metres away, by the poses of the places.
    Metres(f64),
}

impl Tolerance {
    /// For a sentence: `1 place`, `5 m`.
    pub fn in_words(self) -> String {
        let counted = |count: u32, one: &str| {
            let plural = if count == 1 { "" } else { "s" };
            format!("{count} {one}{plural}")
        };
        match self {
            Self::Places(count) => counted(count, "place"),
            Self::Edges(count) => counted(count, "edge"),
            Self::Metres(distance) => format!("{distance} m"),
        }
    }
}

impl fmt::Display for Tolerance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Places(count) => write!(f, "places:{count}"),
            Self::Edges(count) => write!(f, "edges:{count}"),
            Self::Metres(distance) => write!(f, "metres:{distance}"),
        }
    }
}

impl FromStr for Tolerance {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let bad = || {
            Error::new(ErrorKind::Config, format!("`{text}` is no tolerance"))
                .with_help("write places:K, edges:K (whole numbers) or metres:R")
        };
        let (kind, number) = text.split_once(':').ok_or_else(bad)?;
        match kind {
            "places" => number.parse().map(Self::Places).map_err(|_| bad()),
            "edges" => number.parse().map(Self::Edges).map_err(|_| bad()),
            "metres" => {
                let distance: f64 = number.parse().map_err(|_| bad())?;
                if distance.is_finite() && distance >= 0.0 {
                    Ok(Self::Metres(distance))
                } else {
                    Err(bad())
                }
            }
            _ => Err(bad()),
        }
    }
}

impl TryFrom<String> for Tolerance {
    type Error = Error;

    fn try_from(text: String) -> Result<Self> {
        text.parse()
    }
}

impl From<Tolerance> for String {
    fn from(tolerance: Tolerance) -> Self {
        tolerance.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tolerances_read_back_what_they_print_and_others_are_refused() {
        for text in ["places:0", "edges:2", "metres:2.5"] {
            assert_eq!(text.parse::<Tolerance>().unwrap().to_string(), text);
        }
        for text in [
            "",
            "2",
            "places",
            "places:-1",
            "places:1.5",
            "metres:inf",
            "feet:3",
        ] {
            let error = text.parse::<Tolerance>().unwrap_err().to_string();
            assert!(error.contains("places:K"), "{error}");
        }
        assert_eq!(Tolerance::Places(1).in_words(), "1 place");
        assert_eq!(Tolerance::Edges(2).in_words(), "2 edges");
    }
}
