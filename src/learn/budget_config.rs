//! How large may a map become?

use serde::{Deserialize, Serialize};

use fremen::error::{Error, ErrorKind, Result};

/// How large a map may become; without a number there is no bound.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct BudgetConfig {
    #[serde(skip_serializing_if = "Option::is_none")]
    features_per_place: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    visits_per_place: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    bytes_per_place: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    bytes: Option<usize>,
}

impl BudgetConfig {
    pub(super) fn check(&self) -> Result<()> {
        let least = [
            ("features-per-place", self.features_per_place, 4),
            ("visits-per-place", self.visits_per_place, 4),
            ("bytes-per-place", self.bytes_per_place, 1 << 16),
            ("bytes", self.bytes, 1 << 16),
        ];
        match least
            .iter()
            .find(|(_, most, least)| most.is_some_and(|most| most < *least))
        {
            Some((name, _, least)) => Err(Error::new(
                ErrorKind::Config,
                format!("budget: {name} must be at least {least}"),
            )),
            None => Ok(()),
        }
    }

    /// A place has at most so many features.
    #[must_use]
    pub fn with_features_per_place(mut self, most: usize) -> Self {
        self.features_per_place = Some(most);
        self
    }

    /// A place remembers at most so many visits.
    #[must_use]
    pub fn with_visits_per_place(mut self, most: usize) -> Self {
        self.visits_per_place = Some(most);
        self
    }

    /// A place takes at most so many bytes.
    #[must_use]
    pub fn with_bytes_per_place(mut self, most: usize) -> Self {
        self.bytes_per_place = Some(most);
        self
    }

    /// All places together take at most so many bytes.
    #[must_use]
    pub fn with_bytes(mut self, most: usize) -> Self {
        self.bytes = Some(most);
        self
    }

    /// Whether anything is bounded.
    pub fn is_bounded(&self) -> bool {
        *self != Self::default()
    }

    /// The features of a place, at most.
    pub fn features_per_place(&self) -> Option<usize> {
        self.features_per_place
    }

    /// The visits of a place, at most.
    pub fn visits_per_place(&self) -> Option<usize> {
        self.visits_per_place
    }

    /// The bytes of a place, at most.
    pub fn bytes_per_place(&self) -> Option<usize> {
        self.bytes_per_place
    }

    /// The bytes of all places together, at most.
    pub fn bytes(&self) -> Option<usize> {
        self.bytes
    }
}
