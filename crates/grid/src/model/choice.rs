//! Which model does somebody mean who names it by a few words?

use std::str::FromStr;

use fremen::{CandidatePeriods, Error, ErrorKind, Period, Result};

use super::config::{CellModel, GridConfig, Persistence};

/// The most parts of a folded period.
const FOLDED_BINS: usize = 48;

/// A kind of [`CellModel`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ModelKind {
    /// A mean and the strongest rhythms.
    #[default]
    Fremen,
    /// A mean for each part of the base period.
    Histogram,
    /// A mean for each part of the cell's own strongest period.
    Folded,
    /// The mean of all observations.
    Mean,
    /// The last observation.
    Last,
}

impl ModelKind {
    /// Every kind, in the order in which they are listed.
    pub const ALL: [Self; 5] = [
        Self::Fremen,
        Self::Histogram,
        Self::Folded,
        Self::Mean,
        Self::Last,
    ];

    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Fremen => "fremen",
            Self::Histogram => "histogram",
            Self::Folded => "folded",
            Self::Mean => "mean",
            Self::Last => "last",
        }
    }
}

impl FromStr for ModelKind {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        let found = Self::ALL.into_iter().find(|it| it.name() == name);
        found.ok_or_else(|| no_such("model", name, &Self::ALL.map(Self::name)))
    }
}

/// The longest period that is looked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BasePeriod {
    /// A day.
    #[default]
    Day,
    /// A week.
    Week,
    /// A year.
    Year,
}

impl BasePeriod {
    /// Every one, the shortest first.
    pub const ALL: [Self; 3] = [Self::Day, Self::Week, Self::Year];

    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Day => "day",
            Self::Week => "week",
            Self::Year => "year",
        }
    }

    /// The period, and how many hours it has.
    const fn period(self) -> (Period, usize) {
        match self {
            Self::Day => (Period::DAY, 24),
            Self::Week => (Period::WEEK, 168),
            Self::Year => (Period::YEAR, 8_766),
        }
    }
}

impl FromStr for BasePeriod {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        let found = Self::ALL.into_iter().find(|it| it.name() == name);
        found.ok_or_else(|| no_such("base period", name, &Self::ALL.map(Self::name)))
    }
}

fn no_such(what: &str, name: &str, all: &[&str]) -> Error {
    Error::new(ErrorKind::Config, format!("there is no {what} `{name}`"))
        .with_help(format!("use one of {}", all.join(", ")))
}

/// What makes a [`GridConfig`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModelChoice {
    /// By which model.
    pub kind: ModelKind,
    /// The longest period that is looked for.
    pub base: BasePeriod,
    /// Into how many parts it is divided: `FreMEn` looks for base/1 to base/parts, a histogram has as
    /// many bins; an hour is the shortest where it is not given.
    pub num_parts: Option<usize>,
    /// How many rhythms each cell keeps.
    pub order: usize,
    /// What the last observation says of later times.
    pub persistence: Persistence,
    /// How much a fresh observation counts against the rhythms, 0 to 1.
    pub share: f32,
}

impl Default for ModelChoice {
    fn default() -> Self {
        Self {
            kind: ModelKind::default(),
            base: BasePeriod::default(),
            num_parts: None,
            order: 2,
            persistence: Persistence::State,
            share: 1.0,
        }
    }
}

impl ModelChoice {
    /// The configuration.
    ///
    /// # Errors
    /// [`ErrorKind::Config`] for no parts, and as [`GridConfig::new`] and
    /// [`GridConfig::with_persistence_share`].
    pub fn config(&self) -> Result<GridConfig> {
        let (period, hours) = self.base.period();
        let num_parts = self.num_parts.unwrap_or(hours);
        let candidates = || CandidatePeriods::harmonic(period, num_parts);
        let model = match self.kind {
            ModelKind::Fremen => CellModel::Fremen {
                candidates: candidates()?,
                order: self.order,
            },
            ModelKind::Histogram => CellModel::Histogram {
                period,
                num_bins: num_parts,
            },
            ModelKind::Folded => CellModel::Folded {
                candidates: candidates()?,
                num_bins: FOLDED_BINS,
            },
            ModelKind::Mean => CellModel::Mean,
            ModelKind::Last => CellModel::LastObservation,
        };
        GridConfig::new(model)?
            .with_persistence_of(self.persistence)
            .with_persistence_share(self.share)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_choice_of_nobody_is_the_default_of_grids() -> Result<()> {
        assert_eq!(ModelChoice::default().config()?, GridConfig::default());
        Ok(())
    }

    #[test]
    fn names_are_read_back_and_others_are_refused_with_what_there_is() {
        for kind in ModelKind::ALL {
            assert_eq!(kind.name().parse::<ModelKind>().ok(), Some(kind));
            let choice = ModelChoice {
                kind,
                ..ModelChoice::default()
            };
            assert!(choice.config().is_ok());
        }
        for base in BasePeriod::ALL {
            assert_eq!(base.name().parse::<BasePeriod>().ok(), Some(base));
        }
        let error = "spline".parse::<ModelKind>().expect_err("no model");
        assert!(
            error
                .help()
                .is_some_and(|help| help.contains("fremen, histogram"))
        );
        assert!("month".parse::<BasePeriod>().is_err());
    }
}
