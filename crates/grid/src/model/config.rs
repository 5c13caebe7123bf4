//! By which model is a cell's occupancy predicted?

use fremen::{CandidatePeriods, Error, ErrorKind, Period, Result};

/// No model has more rhythms than this.
pub const MAX_ORDER: usize = 16;
/// No period is folded into more parts than this.
pub const MAX_FOLDED: usize = 960;

/// The periodic part f(t) of a prediction.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum CellModel {
    /// The mean and the strongest few of the candidate rhythms (T-RO 2017 eq. 10 with its factor
    /// 2; IROS 2016 eq. 3).
    Fremen {
        /// The periods that are looked for.
        candidates: CandidatePeriods,
        /// How many rhythms each cell keeps.
        order: usize,
    },
    /// The mean for each part of a period, such as each hour of a day; the overall mean where a
    /// part was never observed.
    Histogram {
        /// What is divided.
        period: Period,
        /// Into how many parts.
        num_bins: usize,
    },
    /// The mean for each part of the cell's own strongest period among the candidates: a histogram
    /// over the phase, which keeps the edges of what comes and goes at once.
    Folded {
        /// The periods that are looked for.
        candidates: CandidatePeriods,
        /// Into how many parts the period is divided at most; halved down to 6, or to one, as long
        /// as that is more likely.
        num_bins: usize,
    },
    /// The mean of all observations: an averaged map.
    Mean,
    /// The state that was observed last, however long ago: an ordinary map.
    LastObservation,
}

impl CellModel {
    /// The periods that are looked for, where there are any.
    pub const fn candidates(&self) -> Option<&CandidatePeriods> {
        match self {
            Self::Fremen { candidates, .. } | Self::Folded { candidates, .. } => Some(candidates),
            _ => None,
        }
    }
}

/// What the last observation of a cell says of later times; w = e^(-dt / tau), dt after it, tau the
/// mean time that a state of the cell lasts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Persistence {
    /// Nothing: p(t) = f(t).
    None,
    /// The state stays for a while: `p(t) = w s + (1 - w) f(t)` (IROS 2016 eq. 2).
    #[default]
    State,
    /// What the rhythms did not foresee stays for a while: `p(t) = f(t) + w (s - f(t_last))`, cut
    /// to 0..=1.
    ///
    /// Deviation: a state that the rhythms had foreseen says nothing new, so it does not outlive the
    /// change that they foresee. Without rhythms, f is constant and this is [`Self::State`].
    Surprise,
}

/// How a grid predicts.
#[derive(Clone, Debug, PartialEq)]
pub struct GridConfig {
    model: CellModel,
    persistence: Persistence,
    share: f32,
    guards: bool,
}

impl Default for GridConfig {
    /// IROS 2016: the two strongest of a day and its fractions down to an hour, persistence on
    /// top, and no period that the history is too short or too coarse for.
    fn default() -> Self {
        let candidates = CandidatePeriods::harmonic(Period::DAY, 24);
        // 24 harmonics of a day are always valid; anything else would be a mean.
        let model = candidates.map_or(CellModel::Mean, |candidates| CellModel::Fremen {
            candidates,
            order: 2,
        });
        Self {
            model,
            persistence: Persistence::State,
            share: 1.0,
            guards: true,
        }
    }
}

impl GridConfig {
    /// A configuration with persistence and guards.
    ///
    /// # Errors
    /// [`ErrorKind::Config`] for an order above [`MAX_ORDER`], a histogram without bins or with more
    /// than 10,000, and a folded period of none or of more than [`MAX_FOLDED`] parts.
    pub fn new(model: CellModel) -> Result<Self> {
        match model {
            CellModel::Fremen { order, .. } if order > MAX_ORDER => Err(Error::new(
                ErrorKind::Config,
                format!("order {order} is above {MAX_ORDER}"),
            )),
            CellModel::Histogram { num_bins, .. } if num_bins == 0 || num_bins > 10_000 => Err(
                Error::new(ErrorKind::Config, format!("a histogram of {num_bins} bins"))
                    .with_help("use 1 to 10000, for instance 24 for the hours of a day"),
            ),
            CellModel::Folded { num_bins, .. } if num_bins == 0 || num_bins > MAX_FOLDED => Err(
                Error::new(ErrorKind::Config, format!("a period of {num_bins} parts"))
                    .with_help("use 1 to 960, for instance 48"),
            ),
            model => Ok(Self {
                model,
                ..Self::default()
            }),
        }
    }

    /// FreMEn with the `order` strongest of `candidates`.
    ///
    /// # Errors
    /// As for [`Self::new`].
    pub fn fremen(candidates: CandidatePeriods, order: usize) -> Result<Self> {
        Self::new(CellModel::Fremen { candidates, order })
    }

    /// Whether the last observation counts more the less time has passed since
    /// (IROS 2016 eq. 2).
    #[must_use]
    pub fn with_persistence(self, persists: bool) -> Self {
        self.with_persistence_of(if persists {
            Persistence::State
        } else {
            Persistence::None
        })
    }

    /// What the last observation says of later times.
    #[must_use]
    pub fn with_persistence_of(mut self, persistence: Persistence) -> Self {
        self.persistence = persistence;
        self
    }

    /// How much a fresh observation counts against the rhythms, in 0..=1: the weight of persistence
    /// is `share e^(-dt / tau)`. 1, as in the papers, believes the last observation all; less is
    /// better where observations are noisy, because noise does not persist.
    ///
    /// # Errors
    /// [`ErrorKind::Config`] where it is not in 0..=1.
    pub fn with_persistence_share(mut self, share: f32) -> Result<Self> {
        if !(0.0..=1.0).contains(&share) {
            let message = format!("a share of {share} of persistence is not in 0..=1");
            return Err(Error::new(ErrorKind::Config, message));
        }
        self.share = share;
        Ok(self)
    }

    /// Whether periods T are left out of which the tile's observations span less than 1.5 T, or
    /// come less often than twice in T.
    #[must_use]
    pub fn with_guards(mut self, guards: bool) -> Self {
        self.guards = guards;
        self
    }

    /// The periodic part.
    pub const fn model(&self) -> &CellModel {
        &self.model
    }

    /// What the last observation says of later times.
    pub const fn persistence(&self) -> Persistence {
        self.persistence
    }

    /// How much a fresh observation counts against the rhythms.
    pub const fn persistence_share(&self) -> f32 {
        self.share
    }

    /// Whether the last observation is taken into account.
    pub fn persists(&self) -> bool {
        self.persistence != Persistence::None
    }

    /// Whether the models of another configuration can be used as they are: what persistence there
    /// is matters to them only where it compares observations with rhythms.
    pub(crate) fn is_fitted_as(&self, other: &Self) -> bool {
        let compares = |it: &Self| it.persistence == Persistence::Surprise;
        self.model == other.model
            && self.guards == other.guards
            && compares(self) == compares(other)
    }

    /// Whether unsupported periods are left out.
    pub const fn guards(&self) -> bool {
        self.guards
    }
}
