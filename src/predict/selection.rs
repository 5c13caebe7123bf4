//! How many features of a place are predicted, and which first?

use std::num::NonZeroUsize;

use serde::{Deserialize, Serialize};

use fremen::error::{Error, ErrorKind, Result};

/// How many features of a place are predicted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", try_from = "SelectionText")]
pub enum Selection {
    /// The n most likely ([`Selection::top`]); all, if the place has fewer.
    Top(NonZeroUsize),
    /// Every feature with p(t) at or above this.
    Threshold(f64),
}

#[derive(Deserialize)]
#[serde(rename_all = "kebab-case")]
enum SelectionText {
    Top(usize),
    Threshold(f64),
}

impl TryFrom<SelectionText> for Selection {
    type Error = Error;

    fn try_from(text: SelectionText) -> Result<Self> {
        match text {
            SelectionText::Top(n) => Self::top(n),
            SelectionText::Threshold(p) => Self::threshold(p),
        }
    }
}

impl Selection {
    /// The `n` most likely; `n` must be positive.
    pub fn top(n: usize) -> Result<Self> {
        NonZeroUsize::new(n).map(Self::Top).ok_or_else(|| {
            Error::new(ErrorKind::Config, "cannot predict 0 features a place")
                .with_help("choose n from 1; 50 is a good start")
        })
    }

    /// The `n` most likely of which the caller knows that there is at least one; 0 counts as 1.
    pub(crate) fn at_least_one(n: usize) -> Self {
        Self::Top(NonZeroUsize::new(n).unwrap_or(NonZeroUsize::MIN))
    }

    /// Every feature with p(t) >= `p`; `p` must be in [0, 1].
    pub fn threshold(p: f64) -> Result<Self> {
        if !(0.0..=1.0).contains(&p) {
            return Err(Error::new(
                ErrorKind::Config,
                format!("a threshold of probability lies in [0, 1], not at {p}"),
            ));
        }
        Ok(Self::Threshold(p))
    }
}

/// Which features are kept first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Choice {
    /// The most likely (T-RO 2017 VII).
    Likeliest,
    /// Likely ones that together cover the appearances of the place.
    Covering,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn selections_that_make_no_sense_are_refused() {
        assert!(Selection::top(0).is_err());
        assert!(Selection::threshold(f64::NAN).is_err());
        assert!(Selection::threshold(1.5).is_err());
    }
}
