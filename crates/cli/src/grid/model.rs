//! By which model does a command predict?

use anyhow::Result;
use clap::{Args, ValueEnum};

use fremen::{CandidatePeriods, Period};
use fremen_grid::{CellModel, GridConfig, Persistence};

/// The most parts of a folded period.
const FOLDED_BINS: usize = 48;

/// How cells are predicted. The grid keeps what was seen, so that each command may choose anew.
#[derive(Debug, Args)]
pub(super) struct ModelArgs {
    /// By which model.
    #[arg(long, value_enum, default_value_t = Kind::Fremen)]
    model: Kind,
    /// The longest period that is looked for.
    #[arg(long, value_enum, default_value_t = Base::Day)]
    base: Base,
    /// Into how many parts it is divided: FreMEn looks for base/1 to base/PARTS, a histogram has
    /// as many bins; `folded` looks for periods as FreMEn does. An hour is the shortest where it is not
    /// given.
    #[arg(long)]
    parts: Option<usize>,
    /// How many rhythms each cell keeps.
    #[arg(long, default_value_t = 2)]
    order: usize,
    /// Do not take the last observation into account.
    #[arg(long)]
    no_persistence: bool,
    /// How much a fresh observation counts against the rhythms, 0 to 1; less is better where maps
    /// are noisy.
    #[arg(
        long,
        default_value_t = 1.0,
        value_name = "SHARE",
        conflicts_with = "no_persistence"
    )]
    persistence: f32,
    /// Take of the last observation only what the rhythms had not foreseen.
    #[arg(long, conflicts_with = "no_persistence")]
    surprise: bool,
}

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum Kind {
    /// A mean and the strongest rhythms.
    #[default]
    Fremen,
    /// A mean for each part of the base period.
    Histogram,
    /// A mean for each part of the cell's own strongest period, for what comes and goes at once.
    Folded,
    /// The mean of all observations.
    Mean,
    /// The last observation.
    Last,
}

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum Base {
    #[default]
    Day,
    Week,
    Year,
}

impl Default for ModelArgs {
    /// As where no option is given.
    fn default() -> Self {
        Self {
            model: Kind::default(),
            base: Base::default(),
            parts: None,
            order: 2,
            no_persistence: false,
            persistence: 1.0,
            surprise: false,
        }
    }
}

impl ModelArgs {
    pub(super) fn config(&self) -> Result<GridConfig> {
        let (period, hours) = match self.base {
            Base::Day => (Period::DAY, 24),
            Base::Week => (Period::WEEK, 168),
            Base::Year => (Period::YEAR, 8_766),
        };
        let num_parts = self.parts.unwrap_or(hours);
        let model = match self.model {
            Kind::Fremen => CellModel::Fremen {
                candidates: CandidatePeriods::harmonic(period, num_parts)?,
                order: self.order,
            },
            Kind::Histogram => CellModel::Histogram {
                period,
                num_bins: num_parts,
            },
            Kind::Folded => CellModel::Folded {
                candidates: CandidatePeriods::harmonic(period, num_parts)?,
                num_bins: FOLDED_BINS,
            },
            Kind::Mean => CellModel::Mean,
            Kind::Last => CellModel::LastObservation,
        };
        let persistence = match (self.no_persistence, self.surprise) {
            (true, _) => Persistence::None,
            (_, true) => Persistence::Surprise,
            _ => Persistence::State,
        };
        Ok(GridConfig::new(model)?
            .with_persistence_of(persistence)
            .with_persistence_share(self.persistence)?)
    }
}
