//! Which online model?

use std::fmt;
use std::str::FromStr;

use super::gaussians::Gaussians;
use super::histogram::{Histogram, Smoothing};
use super::long_term::LongTerm;
use super::model::OnlineModel;
use super::persistent::Persistent;
use super::refitted::Refitted;
use super::short_term::ShortTerm;
use super::spectral::Spectral;
use crate::error::{Error, ErrorKind, Result};
use crate::spectrum::CandidatePeriods;
use crate::time::Period;
use crate::visibility::VisibilityConfig;

/// A kind of [`OnlineModel`] with its options.
#[derive(Clone, Debug, PartialEq)]
pub struct OnlineConfig(Kind);

#[derive(Clone, Debug, PartialEq)]
enum Kind {
    ShortTerm,
    LongTerm,
    Spectral {
        candidates: CandidatePeriods,
        max_order: usize,
    },
    Gaussians {
        period: Period,
        num_bins: usize,
        order: usize,
    },
    Refitted(VisibilityConfig),
    Histogram {
        period: Period,
        num_bins: usize,
        smoothing: Smoothing,
    },
    Persistent(Box<Kind>),
}

/// Names, in the order in which they are listed.
const NAMES: [&str; 7] = [
    "short-term",
    "long-term",
    "fremen",
    "gaussians",
    "natural",
    "histogram",
    "histogram-persistent",
];

impl OnlineConfig {
    /// Short-term memory: the last look, and the rates of change.
    pub fn short_term() -> Self {
        Self(Kind::ShortTerm)
    }

    /// Long-term memory: the mean of all looks.
    pub fn long_term() -> Self {
        Self(Kind::LongTerm)
    }

    /// FreMEn with at most `max_order` rhythms of `candidates`.
    pub fn fremen(candidates: CandidatePeriods, max_order: usize) -> Self {
        Self(Kind::Spectral {
            candidates,
            max_order,
        })
    }

    /// FreMEn as RAS 2016 uses it: four weeks and their fractions down to two hours.
    pub fn fremen_of_four_weeks() -> Result<Self> {
        let four_weeks = Period::from_us(4 * Period::WEEK.as_us())?;
        Ok(Self::fremen(
            CandidatePeriods::harmonic(four_weeks, 336)?,
            MAX_ORDER,
        ))
    }

    /// `order` Gaussians round `period`, whose profile is kept in `num_bins` parts; both at least 1.
    pub fn gaussians(period: Period, num_bins: usize, order: usize) -> Result<Self> {
        at_least_one("parts", num_bins)?;
        at_least_one("Gaussians", order)?;
        Ok(Self(Kind::Gaussians {
            period,
            num_bins,
            order,
        }))
    }

    /// Any model of [`visibility`](crate::visibility), fitted anew whenever conclusions are drawn.
    pub fn refitted(cfg: VisibilityConfig) -> Self {
        Self(Kind::Refitted(cfg))
    }

    /// A smooth profile of `period` in `num_bins` parts, at least 1: looks count by a Gaussian of
    /// `width_s` seconds round the cycle and half after `half_life_s`; `prior` stays at the mean are
    /// added.
    pub fn histogram(
        period: Period,
        num_bins: usize,
        width_s: f64,
        half_life_s: f64,
        prior: f64,
    ) -> Result<Self> {
        at_least_one("parts", num_bins)?;
        for (name, value) in [
            ("width", width_s),
            ("half-life", half_life_s),
            ("prior", prior),
        ] {
            if value.is_nan() || value <= 0.0 {
                return Err(config(format!("the {name} must be above 0, not {value}")));
            }
        }
        Ok(Self(Kind::Histogram {
            period,
            num_bins,
            smoothing: Smoothing {
                width_s,
                half_life_s,
                prior,
            },
        }))
    }

    /// The last look first, this model later.
    #[must_use]
    pub fn persistent(self) -> Self {
        match self.0 {
            Kind::Persistent(_) => self,
            kind => Self(Kind::Persistent(Box::new(kind))),
        }
    }

    /// The names that [`from_str`](Self::from_str) knows.
    pub const fn names() -> &'static [&'static str] {
        &NAMES
    }

    /// Of `num_states` states of which nothing is known.
    pub fn build(&self, num_states: usize) -> Box<dyn OnlineModel> {
        self.0.build(num_states)
    }
}

/// Rhythms that FreMEn may have.
const MAX_ORDER: usize = 4;

impl Kind {
    fn build(&self, num_states: usize) -> Box<dyn OnlineModel> {
        match self {
            Self::ShortTerm => Box::new(ShortTerm::new(num_states)),
            Self::LongTerm => Box::new(LongTerm::new(num_states)),
            Self::Spectral {
                candidates,
                max_order,
            } => Box::new(Spectral::new(num_states, candidates.clone(), *max_order)),
            Self::Gaussians {
                period,
                num_bins,
                order,
            } => Box::new(Gaussians::new(num_states, *period, *num_bins, *order)),
            Self::Refitted(cfg) => Box::new(Refitted::new(num_states, cfg.clone())),
            Self::Histogram {
                period,
                num_bins,
                smoothing,
            } => Box::new(Histogram::new(num_states, *period, *num_bins, *smoothing)),
            Self::Persistent(of) => Box::new(Persistent::new(of.build(num_states))),
        }
    }
}

/// The histogram of the day with the last look first: what a robot begins with that knows nothing of
/// the world's rhythms.
impl Default for OnlineConfig {
    fn default() -> Self {
        Self(Kind::Persistent(Box::new(Kind::Histogram {
            period: Period::DAY,
            num_bins: 96,
            smoothing: Smoothing::DEFAULT,
        })))
    }
}

impl FromStr for OnlineConfig {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        if let Some(of) = name.strip_suffix("-persistent") {
            return Ok(of.parse::<Self>()?.persistent());
        }
        match name {
            "short-term" => Ok(Self::short_term()),
            "long-term" => Ok(Self::long_term()),
            "fremen" => Self::fremen_of_four_weeks(),
            "gaussians" => Self::gaussians(Period::DAY, 96, 6),
            "natural" => Ok(Self::refitted(VisibilityConfig::natural())),
            "histogram" => {
                let Smoothing {
                    width_s,
                    half_life_s,
                    prior,
                } = Smoothing::DEFAULT;
                Self::histogram(Period::DAY, 96, width_s, half_life_s, prior)
            }
            _ => Err(
                config(format!("there is no model `{name}`")).with_help(format!(
                    "models are {}; each may end in `-persistent`",
                    NAMES.join(", ")
                )),
            ),
        }
    }
}

impl fmt::Display for OnlineConfig {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fn name(kind: &Kind) -> String {
            match kind {
                Kind::ShortTerm => "short-term".to_owned(),
                Kind::LongTerm => "long-term".to_owned(),
                Kind::Spectral { .. } => "fremen".to_owned(),
                Kind::Gaussians { .. } => "gaussians".to_owned(),
                Kind::Refitted(cfg) if *cfg == VisibilityConfig::natural() => "natural".to_owned(),
                Kind::Refitted(_) => "refitted".to_owned(),
                Kind::Histogram { .. } => "histogram".to_owned(),
                Kind::Persistent(of) => format!("{}-persistent", name(of)),
            }
        }
        f.pad(&name(&self.0))
    }
}

fn at_least_one(name: &str, count: usize) -> Result<()> {
    if count > 0 {
        return Ok(());
    }
    Err(config(format!("there must be at least one of the {name}")))
}

fn config(message: String) -> Error {
    Error::new(ErrorKind::Config, message)
}
