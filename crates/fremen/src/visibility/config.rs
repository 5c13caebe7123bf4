//! Which model, fitted how?

use serde::{Deserialize, Serialize};

use crate::error::{Error, ErrorKind, Result};
use crate::spectrum::{Balance, CandidatePeriods};
use crate::time::Period;

/// What a feature was at the visits before the one it was born in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BeforeBirth {
    /// Not seen: every feature has the same number of observations (the reference recipe).
    #[default]
    NotSeen,
    /// Not observable: nobody looked for it, so nothing is known.
    NotObservable,
}

/// Which candidate periods the visit times can support at all, and the place's history bears out.
///
/// Off by default: the papers have no guards. Mind that twelve monthly visits of one year do not
/// support an annual period by the default numbers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
#[allow(clippy::struct_field_names)] // reason: the fields are the keys of the text form.
pub struct Guards {
    min_cycles: f64,
    min_gaps: f64,
    min_sigmas: f64,
}

impl Default for Guards {
    /// A period is kept if it fits 1.5 times into the span of the visits and is at least twice
    /// their median gap.
    fn default() -> Self {
        Self {
            min_cycles: 1.5,
            min_gaps: 2.0,
            min_sigmas: 0.0,
        }
    }
}

impl Guards {
    /// Keeps a period T if `min_cycles T <= span` and `T >= min_gaps x median gap` of the visits.
    ///
    /// Both must be finite and not negative.
    pub fn new(min_cycles: f64, min_gaps: f64) -> Result<Self> {
        let guards = Self {
            min_cycles,
            min_gaps,
            min_sigmas: 0.0,
        };
        guards.validate()?;
        Ok(guards)
    }

    /// How often a period must fit into the span of the visits.
    pub fn min_cycles(&self) -> f64 {
        self.min_cycles
    }

    /// How many median gaps between visits a period must last.
    pub fn min_gaps(&self) -> f64 {
        self.min_gaps
    }

    /// Keeps a period only if its power, summed over the features of the place, exceeds the mean of
    /// what shuffled visit times give by this many of their standard deviations; 0 requires
    /// nothing.
    ///
    /// Must be finite and not negative. Where visits are irregular this takes the place of
    /// `min_gaps`: a rhythm far shorter than the gaps can be learnt from visits at ever other
    /// hours.
    pub fn with_min_sigmas(mut self, min_sigmas: f64) -> Result<Self> {
        self.min_sigmas = min_sigmas;
        self.validate()?;
        Ok(self)
    }

    /// By how many standard deviations a period must stand out from chance.
    pub fn min_sigmas(&self) -> f64 {
        self.min_sigmas
    }

    fn validate(&self) -> Result<()> {
        for (name, value) in [
            ("min-cycles", self.min_cycles),
            ("min-gaps", self.min_gaps),
            ("min-sigmas", self.min_sigmas),
        ] {
            if !(value.is_finite() && value >= 0.0) {
                return Err(Error::new(
                    ErrorKind::Config,
                    format!("{name} must be a finite number from 0, not {value}"),
                ));
            }
        }
        Ok(())
    }
}

/// Which visits are held out to choose an order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Split {
    /// The latest this many visits, as when yesterday judges the models of the days before (T-RO
    /// IV-B).
    LastVisits(usize),
    /// Each of this many runs of consecutive visits in turn, at least two visits a run.
    Folds(usize),
}

/// Chooses the order with the lowest prediction error on held-out visits, for all features of a
/// place together, then fits all visits with it.
///
/// The error is the mean squared difference of p and state (Brier); the lower order wins a tie.
/// `Deviation:` T-RO IV-B counts wrong states at a threshold of 1/2 (eq. 14), which most features
/// of a place never cross.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct HeldOut {
    max_order: usize,
    min_visits: usize,
    split: Split,
}

impl Default for HeldOut {
    /// Orders 0 to 3 by 4 folds, order 0 below 8 visits.
    fn default() -> Self {
        Self {
            max_order: 3,
            min_visits: 8,
            split: Split::Folds(4),
        }
    }
}

impl HeldOut {
    /// As by default, with up to 5 rhythms: all features of a place pay for them together.
    pub fn of_shared_rhythms() -> Self {
        Self {
            max_order: 5,
            ..Self::default()
        }
    }

    /// Orders 0 to `max_order`, judged by `split`.
    pub fn new(max_order: usize, split: Split) -> Result<Self> {
        let held_out = Self {
            max_order,
            split,
            ..Self::default()
        };
        held_out.validate()?;
        Ok(held_out)
    }

    /// With fewer visits than this, the order is 0 without trying.
    #[must_use]
    pub fn with_min_visits(mut self, min_visits: usize) -> Self {
        self.min_visits = min_visits;
        self
    }

    /// The highest order tried.
    pub fn max_order(&self) -> usize {
        self.max_order
    }

    /// Fewer visits than this give order 0.
    pub fn min_visits(&self) -> usize {
        self.min_visits
    }

    /// How visits are held out.
    pub fn split(&self) -> Split {
        self.split
    }

    fn validate(&self) -> Result<()> {
        let (Split::LastVisits(count) | Split::Folds(count)) = self.split;
        let least = match self.split {
            Split::LastVisits(_) => 1,
            Split::Folds(_) => 2,
        };
        if count < least {
            return Err(Error::new(
                ErrorKind::Config,
                format!("cannot hold out {:?}", self.split),
            )
            .with_help("hold out at least one last visit, or use at least two folds"));
        }
        Ok(())
    }
}

/// How many rhythms a feature may have: a number, or chosen on held-out visits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Order {
    /// This many (0 is the mean).
    Fixed(usize),
    /// The best of several.
    HeldOut(HeldOut),
}

/// A model's kind with its own options.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
#[non_exhaustive]
pub enum ModelConfig {
    /// [`Mean`](super::Mean).
    Mean {},
    /// [`Fremen`](super::Fremen).
    Fremen {
        /// The rhythms looked for.
        candidates: CandidatePeriods,
        /// How many of them a feature may have.
        order: Order,
        /// Exact, or as one of the papers prints it.
        #[serde(default)]
        balance: Balance,
    },
    /// Least squares on the rhythms of year, week and day that held-out days bear out, all features
    /// of the place together: a [`Fremen`](super::Fremen) in form; [`VisibilityConfig::natural`].
    Natural {
        /// Penalty on a rhythm, in independent observations.
        #[serde(default = "three")]
        ridge: f64,
    },
    /// Harmonic least squares on rhythms that all features of the place share, a
    /// [`Fremen`](super::Fremen) in form. Needs harmonic candidates.
    LeastSquares {
        /// The rhythms looked for.
        candidates: CandidatePeriods,
        /// How many the place may follow, and how that is judged.
        #[serde(default = "HeldOut::of_shared_rhythms")]
        order: HeldOut,
        /// Instead of choosing: use exactly these harmonics of the base period, from 1.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        harmonics: Option<Vec<u16>>,
        /// Penalty on rhythms, in visits.
        #[serde(default = "a_tenth")]
        ridge: f64,
    },
    /// [`Logistic`](super::Logistic): the same rhythms, in log odds. Needs harmonic candidates.
    Logistic {
        /// The rhythms looked for.
        candidates: CandidatePeriods,
        /// How many the place may follow, and how that is judged.
        #[serde(default = "HeldOut::of_shared_rhythms")]
        order: HeldOut,
        /// Instead of choosing: use exactly these harmonics of the base period, from 1.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        harmonics: Option<Vec<u16>>,
    },
    /// [`Histogram`](super::Histogram).
    #[serde(rename_all = "kebab-case")]
    Histogram {
        /// The cycle: a day for time of day, a week for time of week.
        #[serde(rename = "period-s", with = "period_s")]
        period: Period,
        /// Equal parts of the cycle.
        num_bins: usize,
        /// So many observations at the feature's mean are added to every part.
        #[serde(default = "one")]
        prior: f64,
    },
    /// [`Pergam`](super::Pergam).
    #[serde(rename_all = "kebab-case")]
    Pergam {
        /// The cycle.
        #[serde(rename = "period-s", with = "period_s")]
        period: Period,
        /// Equal parts of the cycle in which the profile is taken.
        num_bins: usize,
        /// Gaussians.
        order: usize,
    },
    /// [`Markov`](super::Markov).
    Markov {},
    /// [`Persistent`](super::Persistent).
    Persistent {
        /// The model that describes the long term.
        of: Box<ModelConfig>,
    },
}

fn three() -> f64 {
    3.0
}

fn a_tenth() -> f64 {
    0.1
}

fn one() -> f64 {
    1.0
}

/// A period as a number of seconds.
mod period_s {
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serializer};

    use crate::time::Period;

    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde's signature")]
    pub(super) fn serialize<S: Serializer>(
        period: &Period,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        serializer.serialize_f64(period.as_s())
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Period, D::Error> {
        Period::from_s(f64::deserialize(deserializer)?).map_err(D::Error::custom)
    }
}

impl ModelConfig {
    /// More parts of a cycle, or Gaussians, than this are refused.
    const MAX_PARTS: usize = 100_000;

    fn fix_order(&mut self, fixed: usize) -> Result<()> {
        match self {
            Self::Fremen { order, .. } => *order = Order::Fixed(fixed),
            Self::Pergam { order, .. } => *order = fixed,
            Self::Persistent { of } => return of.fix_order(fixed),
            Self::Mean {} | Self::Histogram { .. } | Self::Markov {} => {}
            Self::Natural { .. } | Self::LeastSquares { .. } | Self::Logistic { .. } => {
                return Err(Error::new(
                    ErrorKind::Config,
                    "this model chooses its rhythms by itself, so its order cannot be fixed",
                )
                .with_help("use the kind `fremen`, or leave the order out"));
            }
        }
        self.validate()
    }

    fn validate(&self) -> Result<()> {
        let parts = |name: &str, count: usize| {
            if (1..=Self::MAX_PARTS).contains(&count) {
                return Ok(());
            }
            Err(Error::new(
                ErrorKind::Config,
                format!("{name} must be 1 to {}, not {count}", Self::MAX_PARTS),
            ))
        };
        match self {
            Self::Fremen {
                order: Order::HeldOut(held_out),
                ..
            } => held_out.validate(),
            Self::Mean {} | Self::Fremen { .. } | Self::Markov {} => Ok(()),
            Self::Natural { ridge } => positive("ridge", *ridge),
            Self::LeastSquares {
                candidates,
                order,
                harmonics,
                ridge,
            } => {
                positive("ridge", *ridge)?;
                shared_rhythms(candidates, harmonics.as_deref())?;
                order.validate()
            }
            Self::Logistic {
                candidates,
                order,
                harmonics,
            } => {
                shared_rhythms(candidates, harmonics.as_deref())?;
                order.validate()
            }
            Self::Histogram {
                num_bins, prior, ..
            } => {
                parts("num-bins", *num_bins)?;
                not_negative("prior", *prior)
            }
            Self::Pergam {
                num_bins, order, ..
            } => {
                parts("num-bins", *num_bins)?;
                parts("order", *order)
            }
            Self::Persistent { of } => of.validate(),
        }
    }
}

fn shared_rhythms(candidates: &CandidatePeriods, harmonics: Option<&[u16]>) -> Result<()> {
    let config = |message: String| Error::new(ErrorKind::Config, message);
    let count = match candidates.as_harmonic() {
        Some((_, count)) if 2 * count <= CandidatePeriods::MAX_COUNT => count,
        _ => {
            return Err(config(
                "shared rhythms need harmonic candidate periods, at most half as many as other models"
                    .into(),
            )
            .with_help("give `base-s` and `count` instead of a list"));
        }
    };
    let mut sorted = harmonics.unwrap_or_default().to_vec();
    sorted.sort_unstable();
    let is_given_twice = sorted.windows(2).any(|pair| pair[0] == pair[1]);
    if is_given_twice || sorted.iter().any(|&h| h == 0 || usize::from(h) > count) {
        return Err(config(format!(
            "harmonics must differ and be 1 to {count}, not {sorted:?}"
        )));
    }
    Ok(())
}

fn positive(name: &str, value: f64) -> Result<()> {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    Err(Error::new(
        ErrorKind::Config,
        format!("{name} must be a finite number above 0, not {value}"),
    ))
}

fn not_negative(name: &str, value: f64) -> Result<()> {
    if value.is_finite() && value >= 0.0 {
        return Ok(());
    }
    Err(Error::new(
        ErrorKind::Config,
        format!("{name} must be a finite number from 0, not {value}"),
    ))
}

impl Default for ModelConfig {
    fn default() -> Self {
        Self::Mean {}
    }
}

/// Which model is fitted, and how it reads the log.
///
/// # Text form
/// ```
/// # use fremen::visibility::VisibilityConfig;
/// let cfg = VisibilityConfig::from_toml(r#"
/// before-birth = "not-observable"
/// guards = { min-cycles = 1.5, min-gaps = 2.0 }
/// [model]
/// kind = "fremen"
/// candidates = { base-s = 86400.0, count = 12 }
/// order = { max-order = 3, split = { folds = 4 } }
/// "#)?;
/// # assert!(cfg.guards().is_some());
/// # Ok::<(), fremen::Error>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Text", into = "Text")]
pub struct VisibilityConfig {
    model: ModelConfig,
    before_birth: BeforeBirth,
    guards: Option<Guards>,
}

impl VisibilityConfig {
    /// The long-term mean.
    pub fn mean() -> Self {
        Self::default()
    }

    /// FreMEn with these rhythms.
    pub fn fremen(candidates: CandidatePeriods, order: Order) -> Self {
        Self {
            model: ModelConfig::Fremen {
                candidates,
                order,
                balance: Balance::Exact,
            },
            ..Self::default()
        }
    }

    /// Preset `lttl`: the strongest fraction of a year, whatever the visits can support.
    pub fn lttl() -> Self {
        Self::fremen(CandidatePeriods::MONTHS, Order::Fixed(1))
    }

    /// Preset `default`: the two strongest rhythms of the [calendar](CandidatePeriods::calendar)
    /// that fit into the span of the visits and that the place as a whole follows, not by chance.
    /// One cycle is enough to be looked at, since a year of visits is what outdoor maps begin with.
    pub fn rhythms() -> Self {
        let guards = Guards {
            min_cycles: 0.9,
            min_gaps: 0.0,
            min_sigmas: 3.0,
        };
        Self::fremen(CandidatePeriods::calendar(), Order::Fixed(2)).with_guards(Some(guards))
    }

    /// Mean and the natural rhythms (year, week, day and their harmonics) that whole held-out days
    /// bear out, solved for together: the model for a series of any sampling, and the default of
    /// `chronotope spectrum` and of the series' suites. It has no options to tune.
    pub fn natural() -> Self {
        Self {
            model: ModelConfig::Natural { ridge: three() },
            ..Self::default()
        }
    }

    /// Any model, without guards, unborn features not seen.
    pub fn new(model: ModelConfig) -> Result<Self> {
        model.validate()?;
        Ok(Self {
            model,
            ..Self::default()
        })
    }

    /// What a feature was before its birth.
    #[must_use]
    pub fn with_before_birth(mut self, before_birth: BeforeBirth) -> Self {
        self.before_birth = before_birth;
        self
    }

    /// Drops candidate periods that the visits cannot support.
    #[must_use]
    pub fn with_guards(mut self, guards: Option<Guards>) -> Self {
        self.guards = guards;
        self
    }

    /// The same with a fixed order; a model without rhythms stays as it is.
    ///
    /// Fails with [`ErrorKind::Config`] if the model chooses its rhythms by itself.
    pub fn with_order(mut self, fixed: usize) -> Result<Self> {
        self.model.fix_order(fixed)?;
        Ok(self)
    }

    /// The model's kind and options.
    pub fn model(&self) -> &ModelConfig {
        &self.model
    }

    /// What a feature was before its birth.
    pub fn before_birth(&self) -> BeforeBirth {
        self.before_birth
    }

    /// The guards, if any.
    pub fn guards(&self) -> Option<Guards> {
        self.guards
    }

    /// Reads the text form shown above.
    pub fn from_toml(text: &str) -> Result<Self> {
        toml::from_str(text).map_err(|cause| {
            Error::new(
                ErrorKind::Config,
                format!("bad visibility model: {}", cause.message()),
            )
        })
    }
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
#[derive(Default)]
struct Text {
    before_birth: BeforeBirth,
    #[serde(skip_serializing_if = "Option::is_none")]
    guards: Option<Guards>,
    model: ModelConfig,
}

impl TryFrom<Text> for VisibilityConfig {
    type Error = Error;

    fn try_from(text: Text) -> Result<Self> {
        if let Some(guards) = &text.guards {
            guards.validate()?;
        }
        text.model.validate()?;
        Ok(Self {
            model: text.model,
            before_birth: text.before_birth,
            guards: text.guards,
        })
    }
}

impl From<VisibilityConfig> for Text {
    fn from(cfg: VisibilityConfig) -> Self {
        Self {
            before_birth: cfg.before_birth,
            guards: cfg.guards,
            model: cfg.model,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::Period;

    #[test]
    fn text_gives_back_the_config() {
        let candidates = CandidatePeriods::harmonic(Period::YEAR, 12).expect("valid");
        let held_out = HeldOut::new(3, Split::LastVisits(4)).expect("valid");
        for cfg in [
            VisibilityConfig::mean(),
            VisibilityConfig::fremen(candidates.clone(), Order::Fixed(2)),
            VisibilityConfig::fremen(candidates, Order::HeldOut(held_out))
                .with_before_birth(BeforeBirth::NotObservable)
                .with_guards(Some(Guards::default())),
        ] {
            let text = toml::to_string(&cfg).expect("serialises");
            assert_eq!(
                VisibilityConfig::from_toml(&text).expect("own text"),
                cfg,
                "{text}"
            );
        }
    }

    #[test]
    fn an_order_is_fixed_or_refused_never_ignored() {
        let candidates = CandidatePeriods::harmonic(Period::YEAR, 12).expect("valid");
        let fremen = VisibilityConfig::fremen(candidates, Order::HeldOut(HeldOut::default()));
        let fixed = fremen.with_order(2).expect("has an order");
        assert!(matches!(
            fixed.model(),
            ModelConfig::Fremen {
                order: Order::Fixed(2),
                ..
            }
        ));
        let mean = VisibilityConfig::mean();
        assert_eq!(mean.clone().with_order(3).expect("has no rhythms"), mean);
        let error = VisibilityConfig::natural().with_order(1);
        assert_eq!(error.expect_err("chooses").kind(), ErrorKind::Config);
    }

    #[test]
    fn options_that_make_no_sense_are_refused() {
        for text in [
            "guards = { min-cycles = nan }",
            "guards = { min-gaps = -1.0 }",
            "model = { kind = 'mean', order = 1 }",
            "model = { kind = 'psychic' }",
            "model = { kind = 'fremen', candidates = { base-s = 60.0, count = 3 }, order = -1 }",
            "model = { kind = 'fremen', candidates = { base-s = 60.0, count = 3 }, order = { split = { folds = 1 } } }",
            "model = { kind = 'fremen', order = 1 }",
            "colour = 'green'",
        ] {
            let error = VisibilityConfig::from_toml(text).expect_err(text);
            assert_eq!(error.kind(), ErrorKind::Config, "{text}");
        }
    }
}
