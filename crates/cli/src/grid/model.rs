//! By which model does a command predict?

use anyhow::Result;
use clap::{Args, ValueEnum};

use fremen_grid::model::{BasePeriod, ModelChoice, ModelKind};
use fremen_grid::{GridConfig, Persistence};

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
        let persistence = match (self.no_persistence, self.surprise) {
            (true, _) => Persistence::None,
            (_, true) => Persistence::Surprise,
            _ => Persistence::State,
        };
        let choice = ModelChoice {
            kind: match self.model {
                Kind::Fremen => ModelKind::Fremen,
                Kind::Histogram => ModelKind::Histogram,
                Kind::Folded => ModelKind::Folded,
                Kind::Mean => ModelKind::Mean,
                Kind::Last => ModelKind::Last,
            },
            base: match self.base {
                Base::Day => BasePeriod::Day,
                Base::Week => BasePeriod::Week,
                Base::Year => BasePeriod::Year,
            },
            num_parts: self.parts,
            order: self.order,
            persistence,
            share: self.persistence,
        };
        Ok(choice.config()?)
    }
}
