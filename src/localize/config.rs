//! Which method, with which numbers?

use serde::{Deserialize, Serialize};

use crate::error::{Error, ErrorKind, Result};
use crate::matching::{Direction, MatchConfig, VoteConfig};
use crate::predict::Selection;
use crate::visibility::VisibilityConfig;

/// How a place is turned into what the live image is matched with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Its most stable features: the n with the highest long-term mean.
    Static,
    /// The n features most likely visible at the query's time (T-RO 2017 VII).
    Fremen,
    /// The n strongest features of each of its experiences: appearances that were added because
    /// localisation with the ones so far had failed (Churchill & Newman as in T-RO 2017 VII-A).
    Experience,
    /// The n strongest features of every kept visit.
    ExperienceAll,
    /// `Experience`, with those experiences only that are likely at the query's time (T-RO 2017 VII-A).
    Freex,
}

impl Method {
    /// Every method, in the order of tables.
    pub const ALL: [Self; 5] = [
        Self::Static,
        Self::Fremen,
        Self::Experience,
        Self::ExperienceAll,
        Self::Freex,
    ];

    /// The name used in configurations, commands and results.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Static => "static",
            Self::Fremen => "fremen",
            Self::Experience => "experience",
            Self::ExperienceAll => "experience-all",
            Self::Freex => "freex",
        }
    }

    /// Whether the answer depends on the query's time.
    pub const fn needs_time(self) -> bool {
        matches!(self, Self::Fremen | Self::Freex)
    }
}

impl std::str::FromStr for Method {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        let found = Self::ALL.into_iter().find(|method| method.name() == name);
        found.ok_or_else(|| {
            Error::new(ErrorKind::Config, format!("there is no method `{name}`")).with_help(
                format!("use one of {}", Self::ALL.map(Self::name).join(", ")),
            )
        })
    }
}

impl std::fmt::Display for Method {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.name())
    }
}

/// What the places are ranked by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Score {
    /// The number of matches, as in the papers.
    Count,
    /// The number of matches that agree on one displacement.
    Inliers,
}

impl Score {
    /// Every score, in the order of tables.
    pub const ALL: [Self; 2] = [Self::Count, Self::Inliers];

    /// The name used in configurations, commands and results.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Count => "count",
            Self::Inliers => "inliers",
        }
    }
}

impl std::str::FromStr for Score {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        let found = Self::ALL.into_iter().find(|score| score.name() == name);
        found.ok_or_else(|| {
            Error::new(ErrorKind::Config, format!("there is no score `{name}`")).with_help(format!(
                "use one of {}",
                Self::ALL.map(Self::name).join(", ")
            ))
        })
    }
}

impl std::fmt::Display for Score {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.name())
    }
}

/// A named set of defaults, used alike by the command, suites and records.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Preset {
    /// The recipe of the long-term topological localisation benchmark by the authors of FreMEn.
    Lttl,
    /// Ours.
    Default,
}

impl Preset {
    /// Every preset.
    pub const ALL: [Self; 2] = [Self::Lttl, Self::Default];

    /// The name used in configurations, commands and results.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Lttl => "lttl",
            Self::Default => "default",
        }
    }
}

impl std::str::FromStr for Preset {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        let found = Self::ALL.into_iter().find(|preset| preset.name() == name);
        found.ok_or_else(|| {
            Error::new(ErrorKind::Config, format!("there is no preset `{name}`"))
                .with_help("use one of lttl, default")
        })
    }
}

impl std::fmt::Display for Preset {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.name())
    }
}

/// How a [`Localizer`](super::Localizer) works.
///
/// As TOML, keys are in kebab case and those left out have the values of the preset `default`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct LocalizerConfig {
    method: Method,
    score: Score,
    selection: Selection,
    min_score: u32,
    matching: MatchConfig,
    vote: VoteConfig,
    visibility: VisibilityConfig,
}

impl Default for LocalizerConfig {
    /// The preset `default`.
    fn default() -> Self {
        Self::preset(Preset::Default)
    }
}

impl LocalizerConfig {
    /// The numbers of a preset.
    pub fn preset(preset: Preset) -> Self {
        match preset {
            Preset::Lttl => Self {
                method: Method::Fremen,
                score: Score::Count,
                selection: Selection::Top(50),
                min_score: 1,
                matching: MatchConfig::lttl(Direction::LiveToMap),
                vote: VoteConfig::default(),
                visibility: VisibilityConfig::lttl(),
            },
            Preset::Default => Self {
                method: Method::Fremen,
                score: Score::Inliers,
                selection: Selection::Top(50),
                min_score: 4,
                matching: MatchConfig::default(),
                vote: VoteConfig::default(),
                visibility: VisibilityConfig::rhythms(),
            },
        }
    }

    /// Uses another method.
    #[must_use]
    pub fn with_method(mut self, method: Method) -> Self {
        self.method = method;
        self
    }

    /// Ranks places by another score.
    #[must_use]
    pub fn with_score(mut self, score: Score) -> Self {
        self.score = score;
        self
    }

    /// Predicts another part of each place. The experience methods take the `n` of
    /// [`Selection::Top`] for each experience, and every feature under [`Selection::Threshold`].
    #[must_use]
    pub fn with_selection(mut self, selection: Selection) -> Self {
        self.selection = selection;
        self
    }

    /// Models visibility in another way.
    #[must_use]
    pub fn with_visibility(mut self, visibility: VisibilityConfig) -> Self {
        self.visibility = visibility;
        self
    }

    /// A best score below this is no answer; at least 1.
    #[must_use]
    pub fn with_min_score(mut self, min_score: u32) -> Self {
        self.min_score = min_score.max(1);
        self
    }

    /// The method.
    pub fn method(&self) -> Method {
        self.method
    }

    /// What places are ranked by.
    pub fn score(&self) -> Score {
        self.score
    }

    /// How much of each place is predicted.
    pub fn selection(&self) -> Selection {
        self.selection
    }

    /// A best score below this is no answer.
    pub fn min_score(&self) -> u32 {
        self.min_score
    }

    /// Which descriptors count as the same.
    pub fn matching(&self) -> &MatchConfig {
        &self.matching
    }

    /// Which matches agree on a displacement.
    pub fn vote(&self) -> &VoteConfig {
        &self.vote
    }

    /// How visibility is modelled.
    pub fn visibility(&self) -> &VisibilityConfig {
        &self.visibility
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_back() {
        for method in Method::ALL {
            assert_eq!(method.name().parse::<Method>().expect("own name"), method);
        }
        let error = "psychic".parse::<Method>().expect_err("no such method");
        assert!(error.to_string().contains("fremen"), "{error}");
    }

    #[test]
    fn presets_survive_toml() {
        for preset in Preset::ALL {
            let cfg = LocalizerConfig::preset(preset);
            let text = toml::to_string(&cfg).expect("serialises");
            assert_eq!(
                toml::from_str::<LocalizerConfig>(&text).expect("own text"),
                cfg
            );
        }
    }
}
