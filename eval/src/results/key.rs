//! What names a row, and the answers that it sums up?

use std::fmt;
use std::str::FromStr;

use chronotope::{Error, ErrorKind, Result};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// How many periodic components a model may use: a number, or chosen by held-out visits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum RowOrder {
    /// Exactly this many; 0 is the mean alone. In JSON a number.
    Fixed(u32),
    /// Chosen by the model itself. In JSON `"auto"`.
    Auto,
}

impl fmt::Display for RowOrder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Fixed(order) => f.pad(&order.to_string()),
            Self::Auto => f.pad("auto"),
        }
    }
}

impl FromStr for RowOrder {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        if text == "auto" {
            return Ok(Self::Auto);
        }
        text.parse().map(Self::Fixed).map_err(|_| {
            Error::new(
                ErrorKind::Format,
                format!("`{text}` is no order: a number or `auto`"),
            )
        })
    }
}

impl Serialize for RowOrder {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Fixed(order) => serializer.serialize_u32(*order),
            Self::Auto => serializer.serialize_str("auto"),
        }
    }
}

impl<'de> Deserialize<'de> for RowOrder {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged, expecting = "an order is a number or \"auto\"")]
        enum Raw {
            Number(u32),
            Word(String),
        }
        match Raw::deserialize(deserializer)? {
            Raw::Number(order) => Ok(Self::Fixed(order)),
            Raw::Word(word) => word.parse().map_err(serde::de::Error::custom),
        }
    }
}

/// Everything that names a row except n: one line of a plot.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Variant {
    /// Configuration, `lttl` or `default`.
    pub preset: String,
    /// `static`, `fremen`, `experience`, `experience-all`, `freex` or `fused`.
    pub method: String,
    /// The visibility model, by its name in the suite.
    pub model: String,
    /// `count`, `inliers` or `likelihood`; empty for what all scores share.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub score: String,
    /// Components of the model.
    pub order: RowOrder,
}

impl Variant {
    /// The row of this variant at `n` features per node.
    pub fn at(&self, n: u32) -> RowKey {
        RowKey {
            variant: self.clone(),
            n,
        }
    }
}

impl fmt::Display for Variant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            preset,
            method,
            model,
            score,
            order,
        } = self;
        f.pad(&format!("{preset}/{method}/{model}/{score}/{order}"))
    }
}

/// Names a row, and the answers that it sums up: `preset/method/model/score/order/n`.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct RowKey {
    /// All but n.
    pub variant: Variant,
    /// Features per node (per experience for the experience methods).
    pub n: u32,
}

impl fmt::Display for RowKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&format!("{}/{}", self.variant, self.n))
    }
}

impl FromStr for RowKey {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let wrong = || {
            Error::new(
                ErrorKind::Format,
                format!("`{text}` is no key `preset/method/model/score/order/n`"),
            )
        };
        let parts: Vec<&str> = text.split('/').collect();
        let &[preset, method, model, score, order, n] = parts.as_slice() else {
            return Err(wrong());
        };
        if [preset, method, model, score].contains(&"") {
            return Err(wrong());
        }
        Ok(Self {
            variant: Variant {
                preset: preset.to_owned(),
                method: method.to_owned(),
                model: model.to_owned(),
                score: score.to_owned(),
                order: order.parse().map_err(|_| wrong())?,
            },
            n: n.parse().map_err(|_| wrong())?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_read_back_what_they_print() {
        for text in [
            "lttl/static/mean/count/0/5",
            "default/fused/auto/likelihood/auto/300",
        ] {
            assert_eq!(text.parse::<RowKey>().unwrap().to_string(), text);
        }
        for text in ["", "a/b/c/d/0", "a/b/c/d/x/5", "a/b/c/d/0/-1", "a//c/d/0/5"] {
            assert!(text.parse::<RowKey>().is_err(), "{text}");
        }
    }
}
