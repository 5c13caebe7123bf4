//! How is a map learnt?

use serde::{Deserialize, Serialize};

use super::budget_config::BudgetConfig;
use super::guard_config::{GuardConfig, Judge};
use crate::localize::{LocalizerConfig, Method, Preset, Score};
use crate::matching::{MatchConfig, TwoWayConfig, VoteConfig};
use fremen::error::{Error, ErrorKind, Result};

/// How features are recognised and born.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Recipe {
    /// By nearest live feature and displacement, one visit at a time.
    Online,
    /// By the ratio test both ways, visibility looked up afterwards in every image.
    Reference,
}

/// Which visits keep their own features.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum KeepAppearances {
    /// None: the experience methods cannot be used.
    None,
    /// Those that became experiences.
    Experiences,
    /// All.
    All,
}

/// How a [`Learner`](super::Learner) works.
///
/// As TOML, keys are in kebab case and those left out have the values of the preset `default`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(
    rename_all = "kebab-case",
    default,
    try_from = "Fields",
    into = "Fields"
)]
pub struct LearnConfig(Fields);

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
struct Fields {
    recipe: Recipe,
    features_per_visit: usize,
    settled_visits: usize,
    births_of_settled: usize,
    keep_appearances: KeepAppearances,
    experience_features: usize,
    min_inliers: u32,
    stay_gap_s: u32,
    reobserve: MatchConfig,
    vote: VoteConfig,
    two_way: TwoWayConfig,
    experience: LocalizerConfig,
    guard: GuardConfig,
    budget: BudgetConfig,
}

impl Default for Fields {
    fn default() -> Self {
        LearnConfig::preset(Preset::Default).0
    }
}

impl Default for LearnConfig {
    /// The preset `default`.
    fn default() -> Self {
        Self::preset(Preset::Default)
    }
}

impl TryFrom<Fields> for LearnConfig {
    type Error = Error;

    fn try_from(fields: Fields) -> Result<Self> {
        for (name, value) in [
            ("features-per-visit", fields.features_per_visit),
            ("births-of-settled", fields.births_of_settled),
            ("experience-features", fields.experience_features),
        ] {
            if value == 0 {
                return Err(Error::new(
                    ErrorKind::Config,
                    format!("{name} must be at least 1"),
                ));
            }
        }
        if fields.experience.score() == Score::Likelihood {
            return Err(Error::new(
                ErrorKind::Config,
                "while a map is learnt, experiences cannot be ranked by likelihood",
            )
            .with_help("use `score = \"inliers\"` or `\"count\"` under `experience`"));
        }
        fields.guard.check()?;
        fields.budget.check()?;
        if fields.recipe == Recipe::Reference && fields.budget.is_bounded() {
            return Err(Error::new(
                ErrorKind::Config,
                "the reference recipe keeps every image, so it cannot keep to a budget",
            )
            .with_help("leave out `budget`, or use `recipe = \"online\"`"));
        }
        if fields.recipe == Recipe::Reference && fields.guard.judge() != Judge::Never {
            return Err(Error::new(
                ErrorKind::Config,
                "the reference recipe learns all visits at once, so it cannot judge them",
            )
            .with_help("use `judge = \"never\"` under `guard`, or `recipe = \"online\"`"));
        }
        Ok(Self(fields))
    }
}

impl From<LearnConfig> for Fields {
    fn from(cfg: LearnConfig) -> Self {
        cfg.0
    }
}

impl LearnConfig {
    /// The numbers of a preset.
    pub fn preset(preset: Preset) -> Self {
        let fields = Fields {
            recipe: Recipe::Online,
            features_per_visit: 600,
            settled_visits: 20,
            births_of_settled: 300,
            keep_appearances: KeepAppearances::Experiences,
            experience_features: 50,
            min_inliers: 8,
            stay_gap_s: 60,
            reobserve: MatchConfig::default(),
            vote: VoteConfig::default(),
            two_way: TwoWayConfig::default(),
            experience: (LocalizerConfig::preset(preset).with_method(Method::Experience))
                .with_score(Score::Inliers),
            guard: GuardConfig::default(),
            budget: BudgetConfig::default(),
        };
        Self(match preset {
            Preset::Default => fields,
            Preset::Lttl => Fields {
                recipe: Recipe::Reference,
                features_per_visit: 500,
                births_of_settled: 500,
                keep_appearances: KeepAppearances::All,
                reobserve: MatchConfig::lttl(crate::matching::Direction::MapToLive),
                experience: fields.experience.clone().with_score(Score::Count),
                guard: fields.guard.clone().with_judge(Judge::Never),
                stay_gap_s: 0,
                ..fields
            },
        })
    }

    /// Keeps other appearances.
    #[must_use]
    pub fn with_keep_appearances(mut self, keep: KeepAppearances) -> Self {
        self.0.keep_appearances = keep;
        self
    }

    /// Judges visits in another way.
    #[must_use]
    pub fn with_guard(mut self, guard: GuardConfig) -> Self {
        self.0.guard = guard;
        self
    }

    /// Keeps the map within this size.
    ///
    /// Fails with [`ErrorKind::Config`] if nothing fits into it, or with the reference recipe.
    pub fn with_budget(mut self, budget: BudgetConfig) -> Result<Self> {
        self.0.budget = budget;
        Self::try_from(self.0)
    }

    /// Takes images of one place that are less than `gap_s` apart for one visit; with 0 each image is
    /// a visit of its own.
    #[must_use]
    pub fn with_stay_gap_s(mut self, gap_s: u32) -> Self {
        self.0.stay_gap_s = gap_s;
        self
    }

    /// For a map that is built from visits whose places somebody has vouched for: only with
    /// [`Judge::Always`] are they judged.
    #[must_use]
    pub fn for_building(self) -> Self {
        if self.guard().judge() == Judge::Updates {
            let guard = self.guard().clone().with_judge(Judge::Never);
            return self.with_guard(guard);
        }
        self
    }

    /// How features are recognised and born.
    pub fn recipe(&self) -> Recipe {
        self.0.recipe
    }

    /// The strongest features of an image that are learnt from.
    pub fn features_per_visit(&self) -> usize {
        self.0.features_per_visit
    }

    /// From how many visits on a place is settled (online recipe).
    pub fn settled_visits(&self) -> usize {
        self.0.settled_visits
    }

    /// At a settled place only the strongest features of an image, so many, can be born: what lasts
    /// is known by then, and more would make the map larger and not better.
    pub fn births_of_settled(&self) -> usize {
        self.0.births_of_settled
    }

    /// Which visits keep their own features.
    pub fn keep_appearances(&self) -> KeepAppearances {
        self.0.keep_appearances
    }

    /// The strongest features of an appearance that decide whether it locates a later image.
    pub fn experience_features(&self) -> usize {
        self.0.experience_features
    }

    /// With fewer matches in agreement, an image is taken to lie where the place's first one did.
    pub fn min_inliers(&self) -> u32 {
        self.0.min_inliers
    }

    /// When a feature of the place is one of the image (both recipes).
    pub fn reobserve(&self) -> &MatchConfig {
        &self.0.reobserve
    }

    /// Which of these pairs agree on a displacement (online recipe).
    pub fn vote(&self) -> &VoteConfig {
        &self.0.vote
    }

    /// When a feature is born (reference recipe).
    pub fn two_way(&self) -> &TwoWayConfig {
        &self.0.two_way
    }

    /// How images are located by experiences while learning.
    pub fn experience(&self) -> &LocalizerConfig {
        &self.0.experience
    }

    /// How visits are judged before they are learnt (online recipe).
    pub fn guard(&self) -> &GuardConfig {
        &self.0.guard
    }

    /// Images of one place that are less than this apart are one stay, s (online recipe).
    pub fn stay_gap_s(&self) -> u32 {
        self.0.stay_gap_s
    }

    /// How large the map may become (online recipe).
    pub fn budget(&self) -> &BudgetConfig {
        &self.0.budget
    }
}
