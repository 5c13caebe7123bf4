//! What do the shades of a `map_server` picture mean?

/// What shades mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum MapMode {
    /// Free, occupied or unknown.
    #[default]
    Trinary,
    /// Probabilities as shades.
    Scale,
    /// Values themselves as shades.
    Raw,
}

impl MapMode {
    /// Its name in the YAML file.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Trinary => "trinary",
            Self::Scale => "scale",
            Self::Raw => "raw",
        }
    }

    /// The mode of a name.
    pub fn parse(name: &str) -> Option<Self> {
        [Self::Trinary, Self::Scale, Self::Raw]
            .into_iter()
            .find(|it| it.name() == name)
    }

    /// Below which occupancy a cell is free and above which occupied, so that what is written
    /// comes back.
    pub(super) const fn safe_thresholds(self) -> (f64, f64) {
        match self {
            // 205, "unknown", is 0.19608.
            Self::Trinary | Self::Raw => (0.196, 0.65),
            // The whole range is scaled.
            Self::Scale => (0.0, 1.0),
        }
    }
}
