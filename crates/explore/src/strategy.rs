//! How are the slots of a day given to places?

use std::fmt;
use std::str::FromStr;

use fremen::{Error, ErrorKind, Result};

/// How visits are chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Strategy {
    /// The least certain place in each of the slots with the least certain places.
    Greedy,
    /// Places are drawn with probabilities that grow with their uncertainty (RAS 2016 eq. 11).
    MonteCarlo,
    /// As Monte Carlo, and goes back to a place that was not as expected (RAS eq. 12).
    Novelty,
    /// One place after the other, at equal distances.
    RoundRobin,
    /// Any place at any time.
    Random,
    /// What a look leaves behind: states that stay as they were seen, and a better model. Goes on
    /// from what is seen. The default.
    #[default]
    Information,
}

impl Strategy {
    /// Every strategy, in the order in which they are listed.
    pub const ALL: [Self; 6] = [
        Self::RoundRobin,
        Self::Random,
        Self::Greedy,
        Self::MonteCarlo,
        Self::Novelty,
        Self::Information,
    ];

    /// Its name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Greedy => "greedy",
            Self::MonteCarlo => "monte-carlo",
            Self::Novelty => "novelty",
            Self::RoundRobin => "round-robin",
            Self::Random => "random",
            Self::Information => "information",
        }
    }
}

impl fmt::Display for Strategy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Strategy {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        (Self::ALL.into_iter().find(|it| it.name() == name)).ok_or_else(|| {
            Error::new(ErrorKind::Config, format!("there is no strategy `{name}`")).with_help(
                format!("strategies are {}", Self::ALL.map(Self::name).join(", ")),
            )
        })
    }
}
