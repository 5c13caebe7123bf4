//! Whose visits are judged before they are learnt, and how strictly?

use serde::{Deserialize, Serialize};

use fremen::error::{Error, ErrorKind, Result};

/// With fewer features checked, an agreement says nothing.
pub(super) const MIN_CHECKED: usize = 10;

/// Whose visits are judged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Judge {
    /// Nobody's.
    Never,
    /// Those that are added to a map by a robot or an update, not those that a map is built from.
    Updates,
    /// All.
    Always,
}

/// What becomes of a visit whose time cannot be right.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ClockPolicy {
    /// It is learnt like any other.
    Ignore,
    /// It is held, with the fault as the reason.
    Hold,
    /// It is refused: an error of kind [`ErrorKind::Time`].
    Refuse,
}

/// How visits are judged before they are learnt.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct GuardConfig {
    judge: Judge,
    clock: ClockPolicy,
    min_visits: usize,
    num_predicted: usize,
    tolerance: f64,
    min_features: usize,
}

impl Default for GuardConfig {
    /// Updates are judged, from the fifth visit of a place on.
    fn default() -> Self {
        Self {
            judge: Judge::Updates,
            clock: ClockPolicy::Hold,
            min_visits: 5,
            num_predicted: 50,
            tolerance: 0.5,
            min_features: 10,
        }
    }
}

impl GuardConfig {
    pub(super) fn check(&self) -> Result<()> {
        let message = if !(0.0..=1.0).contains(&self.tolerance) {
            format!(
                "guard: tolerance lies between 0 and 1, not at {}",
                self.tolerance
            )
        } else if self.num_predicted < MIN_CHECKED {
            format!(
                "guard: num-predicted must be at least {MIN_CHECKED}, not {}",
                self.num_predicted
            )
        } else if self.min_visits < 2 {
            "guard: min-visits must be at least 2: one visit has no past".into()
        } else {
            return Ok(());
        };
        Err(Error::new(ErrorKind::Config, message))
    }

    /// Judges these visits.
    #[must_use]
    pub fn with_judge(mut self, judge: Judge) -> Self {
        self.judge = judge;
        self
    }

    /// Does this with visits whose time cannot be right.
    #[must_use]
    pub fn with_clock(mut self, clock: ClockPolicy) -> Self {
        self.clock = clock;
        self
    }

    /// Whose visits are judged.
    pub fn judge(&self) -> Judge {
        self.judge
    }

    /// What becomes of a visit whose time cannot be right.
    pub fn clock(&self) -> ClockPolicy {
        self.clock
    }

    /// Visits of a place with fewer visits than this are not checked for agreement.
    pub fn min_visits(&self) -> usize {
        self.min_visits
    }

    /// How many features are predicted.
    pub fn num_predicted(&self) -> usize {
        self.num_predicted
    }

    /// The share of a low past agreement that a new one must reach.
    pub fn tolerance(&self) -> f64 {
        self.tolerance
    }

    /// An image with fewer features is blind.
    pub fn min_features(&self) -> usize {
        self.min_features
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn senseless_numbers_are_refused() {
        for text in [
            "tolerance = 1.5",
            "num-predicted = 3",
            "min-visits = 1",
            "tolerance = nan",
        ] {
            let cfg: GuardConfig = toml::from_str(text).expect("well-formed");
            assert!(cfg.check().is_err(), "{text}");
        }
        assert!(GuardConfig::default().check().is_ok());
    }
}
