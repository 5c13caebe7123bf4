//! Which method, with which numbers?

use serde::{Deserialize, Serialize};

use crate::matching::{Direction, MatchConfig, VoteConfig};
use crate::predict::{Choice, ReferenceVisits, Selection, weak_features};
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::Time;
use fremen::visibility::{HistoryLog, VisibilityConfig, Visits};

/// An answer may be wrong one time in twenty.
const RISK: f64 = 0.05;
/// However few visits a place has, it is not predicted by more features than this for each of them.
const MAX_A_VISIT: usize = 600;

/// The one of `all` that is called `name`; an error that lists them, if none is.
pub(super) fn by_name<T: Copy, const N: usize>(
    what: &str,
    name: &str,
    all: [T; N],
    name_of: fn(T) -> &'static str,
) -> Result<T> {
    let found = all.into_iter().find(|&one| name_of(one) == name);
    found.ok_or_else(|| {
        Error::new(ErrorKind::Config, format!("there is no {what} `{name}`"))
            .with_help(format!("use one of {}", all.map(name_of).join(", ")))
    })
}

/// How a place is turned into what the live image is matched with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Method {
    /// Its most stable features: the n with the highest long-term mean.
    Static,
    /// The n features most likely visible at the query's time (T-RO 2017 VII).
    Fremen,
    /// The n features that are likely at the query's time and cover those past appearances that are
    /// likely then: predicted features of predicted experiences, under one budget.
    Fused,
    /// The n strongest features of each of its experiences: appearances that were added because
    /// localisation with the ones so far had failed (Churchill & Newman as in T-RO 2017 VII-A).
    Experience,
    /// The n strongest features of every kept visit.
    ExperienceAll,
    /// `Experience`, with those experiences only that are likely at the query's time (T-RO 2017
    /// VII-A).
    Freex,
}

impl Method {
    /// Every method, in the order of tables.
    pub const ALL: [Self; 6] = [
        Self::Static,
        Self::Fremen,
        Self::Fused,
        Self::Experience,
        Self::ExperienceAll,
        Self::Freex,
    ];

    /// The name used in configurations, commands and results.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Static => "static",
            Self::Fremen => "fremen",
            Self::Fused => "fused",
            Self::Experience => "experience",
            Self::ExperienceAll => "experience-all",
            Self::Freex => "freex",
        }
    }

    /// Whether the answer depends on the query's time.
    pub const fn needs_time(self) -> bool {
        matches!(self, Self::Fremen | Self::Fused | Self::Freex)
    }

    /// Whether a place is matched by a predicted map, and not by remembered appearances.
    pub const fn predicts(self) -> bool {
        matches!(self, Self::Static | Self::Fremen | Self::Fused)
    }
}

impl std::str::FromStr for Method {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        by_name("method", name, Self::ALL, Self::name)
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
#[non_exhaustive]
pub enum Score {
    /// The number of matches, as in the papers.
    Count,
    /// The number of matches that agree on one displacement.
    Inliers,
    /// The log odds of this place against another one, given which predicted features were matched
    /// and which are missing.
    Likelihood,
}

impl Score {
    /// Every score, in the order of tables.
    pub const ALL: [Self; 3] = [Self::Count, Self::Inliers, Self::Likelihood];

    /// The name used in configurations, commands and results.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Count => "count",
            Self::Inliers => "inliers",
            Self::Likelihood => "likelihood",
        }
    }
}

impl std::str::FromStr for Score {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        by_name("score", name, Self::ALL, Self::name)
    }
}

impl std::fmt::Display for Score {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.name())
    }
}

/// A part of the likelihood that can be left out, to see what it is worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EvidencePart {
    /// That features which were seen together are expected together.
    Appearances,
    /// How near the descriptors of a match are.
    Distances,
    /// How far the camera seems to be displaced.
    Displacement,
    /// That some features are found where they are not more often than others.
    FalseRates,
    /// That features of some places are found again more often than those of others.
    Repeatability,
    /// That matches which do not agree with the others are more frequent at the right place.
    #[serde(rename = "strays")]
    OutlierMatches,
}

/// Which places are matched.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PlaceSearch {
    /// All, up to the size of map from which on `inverted` was measured to be faster.
    Auto,
    /// All, whatever the size: nothing is missed.
    Exact,
    /// In maps of more than 256 places, those whose predicted features find most in the image, by
    /// an inverted file.
    Inverted,
    /// In maps of more than 256 places, those whose binary words are most like the image's, by one
    /// signature a place. Needs the crate's feature `hnsw`.
    Words,
}

/// A named set of defaults, used alike by the command, suites and records.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Preset {
    /// The recipe of the long-term topological localisation benchmark by the authors of FreMEn.
    Lttl,
    /// The recipe of this library, which the command and the README use.
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
        by_name("preset", name, Self::ALL, Self::name)
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
#[serde(
    rename_all = "kebab-case",
    default,
    try_from = "Fields",
    into = "Fields"
)]
pub struct LocalizerConfig(Fields);

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
struct Fields {
    method: Method,
    score: Score,
    selection: Selection,
    many_visits: u32,
    settled_visits: u32,
    settled_live_features: usize,
    settled_features_per_visit: usize,
    choice: Choice,
    calibrated: bool,
    without: Vec<EvidencePart>,
    elsewhere: f64,
    risk: f64,
    min_score: u32,
    time_bucket_s: u32,
    candidates: PlaceSearch,
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

impl Default for Fields {
    fn default() -> Self {
        LocalizerConfig::preset(Preset::Default).0
    }
}

impl TryFrom<Fields> for LocalizerConfig {
    type Error = Error;

    fn try_from(fields: Fields) -> Result<Self> {
        let without = fields.without.clone();
        let cfg = Self(fields).with_less_evidence(without);
        cfg.check()?;
        Ok(cfg)
    }
}

impl From<LocalizerConfig> for Fields {
    fn from(cfg: LocalizerConfig) -> Self {
        cfg.0
    }
}

impl LocalizerConfig {
    /// The numbers of a preset.
    pub fn preset(preset: Preset) -> Self {
        Self(match preset {
            Preset::Lttl => Fields {
                method: Method::Fremen,
                score: Score::Count,
                selection: Selection::at_least_one(50),
                many_visits: 1,
                settled_visits: 20,
                settled_live_features: 0,
                settled_features_per_visit: 0,
                choice: Choice::Likeliest,
                calibrated: false,
                without: Vec::new(),
                elsewhere: 0.1,
                risk: RISK,
                min_score: 1,
                time_bucket_s: 0,
                candidates: PlaceSearch::Exact,
                matching: MatchConfig::lttl(Direction::LiveToMap),
                vote: VoteConfig::default(),
                visibility: VisibilityConfig::lttl(),
            },
            Preset::Default => Fields {
                method: Method::Fremen,
                score: Score::Likelihood,
                selection: Selection::at_least_one(50),
                many_visits: 10,
                settled_visits: 20,
                settled_live_features: 300,
                settled_features_per_visit: 200,
                choice: Choice::Covering,
                calibrated: true,
                without: Vec::new(),
                elsewhere: 0.1,
                risk: RISK,
                min_score: 4,
                time_bucket_s: 600,
                candidates: PlaceSearch::Auto,
                matching: MatchConfig::default(),
                vote: VoteConfig::default(),
                visibility: VisibilityConfig::rhythms(),
            },
        })
    }

    /// Whether every value is in its range; otherwise an [`ErrorKind::Config`] error.
    pub(super) fn check(&self) -> Result<()> {
        for (name, value) in [("elsewhere", self.0.elsewhere), ("risk", self.0.risk)] {
            if !(value > 0.0 && value < 1.0) {
                return Err(Error::new(
                    ErrorKind::Config,
                    format!("{name} is a probability between 0 and 1 (both excluded), not {value}"),
                ));
            }
        }
        if self.0.score == Score::Likelihood && !self.0.calibrated {
            return Err(Error::new(
                ErrorKind::Config,
                "the score `likelihood` is made of calibrated rates",
            )
            .with_help("set `calibrated = true`, or use `score = \"inliers\"`"));
        }
        if self.0.candidates == PlaceSearch::Words && !cfg!(feature = "hnsw") {
            return Err(Error::new(
                ErrorKind::Config,
                "candidates by `words` need the feature `hnsw`, without which this was built",
            )
            .with_help("build it with the feature `hnsw`, or use `candidates = \"inverted\"`"));
        }
        Ok(())
    }

    /// Uses another method.
    #[must_use]
    pub fn with_method(mut self, method: Method) -> Self {
        self.0.method = method;
        self
    }

    /// Ranks places by another score; `likelihood` switches calibration on.
    #[must_use]
    pub fn with_score(mut self, score: Score) -> Self {
        self.0.score = score;
        self.0.calibrated |= score == Score::Likelihood;
        self
    }

    /// Predicts another part of each place. The experience methods take the `n` of
    /// [`Selection::Top`] for each experience, and every feature under [`Selection::Threshold`].
    #[must_use]
    pub fn with_selection(mut self, selection: Selection) -> Self {
        self.0.selection = selection;
        self
    }

    /// A place of fewer visits than this is predicted by more than n features, as long as little is
    /// known of which of them last: by `n * (many_visits / visits)^4` (rounded up), at most 600 for
    /// each visit. With 1, by n.
    #[must_use]
    pub fn with_many_visits(mut self, many_visits: u32) -> Self {
        self.0.many_visits = many_visits;
        self
    }

    /// What lasts of a place that has so many visits is known, and is among the strongest features
    /// of an image: of those born at its first `num_visits` visits, a covering choice takes only the
    /// strongest `per_visit` of each ([`weak_features`](crate::predict::weak_features)); and once
    /// every place of a map is settled, only the strongest `num_live` of a live image take part.
    /// With 0 of either, all do.
    #[must_use]
    pub fn with_settled(mut self, num_visits: u32, per_visit: usize, num_live: usize) -> Self {
        self.0.settled_visits = num_visits;
        self.0.settled_features_per_visit = per_visit;
        self.0.settled_live_features = num_live;
        self
    }

    /// Chooses features of a place by another rule.
    #[must_use]
    pub fn with_choice(mut self, choice: Choice) -> Self {
        self.0.choice = choice;
        self
    }

    /// Whether what matches are worth is learnt from the map's past visits; without, posteriors are
    /// shares of the score. The score `likelihood` is made of it, and has it whatever is said here.
    #[must_use]
    pub fn with_calibrated(mut self, calibrated: bool) -> Self {
        self.0.calibrated = calibrated || self.0.score == Score::Likelihood;
        self
    }

    /// Leaves parts of the likelihood out; in any order, each once.
    #[must_use]
    pub fn with_less_evidence(mut self, mut without: Vec<EvidencePart>) -> Self {
        without.sort_unstable();
        without.dedup();
        self.0.without = without;
        self
    }

    /// The probability, before the image is seen, that the robot is at none of the places; above 0
    /// and below 1, which is checked where a localizer is made.
    #[must_use]
    pub fn with_off_map(mut self, off_map: f64) -> Self {
        self.0.elsewhere = off_map;
        self
    }

    /// The probability of being wrong that an answer may have; above 0 and below 1, which is
    /// checked where a localizer is made.
    #[must_use]
    pub fn with_risk(mut self, risk: f64) -> Self {
        self.0.risk = risk;
        self
    }

    /// Models visibility in another way.
    #[must_use]
    pub fn with_visibility(mut self, visibility: VisibilityConfig) -> Self {
        self.0.visibility = visibility;
        self
    }

    /// A best count, or number of inliers, below this is no answer; with 0, any is one.
    #[must_use]
    pub fn with_min_score(mut self, min_score: u32) -> Self {
        self.0.min_score = min_score;
        self
    }

    /// Predicts once for so many seconds, for their middle, and takes that for all images in them;
    /// 0 predicts for the very time of each image. Ten minutes are the default: 1/36 of the
    /// shortest rhythm that the preset looks for, so p(t) is off by less than a tenth of that
    /// rhythm's amplitude.
    #[must_use]
    pub fn with_time_bucket_s(mut self, time_bucket_s: u32) -> Self {
        self.0.time_bucket_s = time_bucket_s;
        self
    }

    /// Matches other places of a large map. Methods that remember appearances match all.
    #[must_use]
    pub fn with_place_search(mut self, place_search: PlaceSearch) -> Self {
        self.0.candidates = place_search;
        self
    }

    /// How each place is turned into what the live image is matched with.
    pub fn method(&self) -> Method {
        self.0.method
    }

    /// What places are ranked by.
    pub fn score(&self) -> Score {
        self.0.score
    }

    /// How much of each place is predicted.
    pub fn selection(&self) -> Selection {
        self.0.selection
    }

    /// From how many visits on a place is predicted by n features, and not by more.
    pub fn many_visits(&self) -> u32 {
        self.0.many_visits
    }

    /// Who vouches for the features of a place, and which may not be chosen, as far as these visits
    /// tell.
    pub(super) fn references(
        &self,
        log: &HistoryLog,
        visits: Visits<'_>,
    ) -> Result<ReferenceVisits> {
        let settled = self.0.settled_visits as usize;
        let references = ReferenceVisits::of(log, visits)?;
        Ok(match self.0.settled_features_per_visit {
            per_visit if per_visit > 0 && log.num_visits() >= settled => {
                references.leaving_out(weak_features(log, settled, per_visit))
            }
            _ => references,
        })
    }

    /// How many of the strongest features of a live image take part in a map whose places have so
    /// many visits each.
    pub(super) fn num_live(&self, mut num_visits: impl Iterator<Item = usize>) -> usize {
        let settled = self.0.settled_visits as usize;
        match self.0.settled_live_features {
            0 => usize::MAX,
            few if num_visits.all(|num| num >= settled) => few,
            _ => usize::MAX,
        }
    }

    /// How many features a place of so many visits is predicted by, at `n`.
    pub(super) fn num_predicted(&self, n: usize, num_visits: usize) -> usize {
        let many = self.0.many_visits as usize;
        if num_visits >= many {
            return n;
        }
        let num_visits = num_visits.max(1);
        let fourth = |number: usize| (number as u128).pow(4);
        // At most 600 of each of fewer than 2^32 visits: the casts lose nothing.
        let most = (MAX_A_VISIT as u128) * (num_visits as u128);
        let grown = (n as u128)
            .saturating_mul(fourth(many))
            .div_ceil(fourth(num_visits));
        n.max(grown.min(most) as usize)
    }

    /// The selection for a place of so many visits.
    pub(super) fn selection_for(&self, selection: Selection, num_visits: usize) -> Selection {
        match selection {
            Selection::Top(n) => Selection::at_least_one(self.num_predicted(n.get(), num_visits)),
            by_probability @ Selection::Threshold(_) => by_probability,
        }
    }

    /// Which features of a place are predicted first.
    pub fn choice(&self) -> Choice {
        self.0.choice
    }

    /// Whether posteriors are calibrated on past visits.
    pub fn calibrated(&self) -> bool {
        self.0.calibrated
    }

    /// Parts of the likelihood that are left out, ascending.
    pub fn without(&self) -> &[EvidencePart] {
        &self.0.without
    }

    /// The prior probability of being at none of the places.
    pub fn off_map(&self) -> f64 {
        self.0.elsewhere
    }

    /// The probability of being wrong that an answer may have.
    pub fn risk(&self) -> f64 {
        self.0.risk
    }

    /// A best count, or number of inliers, below this is no answer.
    pub fn min_score(&self) -> u32 {
        self.0.min_score
    }

    /// For how many seconds one prediction is used; 0 if for a single moment.
    pub fn time_bucket_s(&self) -> u32 {
        self.0.time_bucket_s
    }

    /// Which places are matched.
    pub fn place_search(&self) -> PlaceSearch {
        self.0.candidates
    }

    /// The middle of the bucket that `time` is in; buckets begin at whole multiples of their length
    /// since the epoch.
    pub fn middle_of_bucket(&self, time: Time) -> Time {
        let length_us = i64::from(self.0.time_bucket_s) * 1_000_000;
        if length_us == 0 {
            return time;
        }
        let start_us = (time.as_us()).saturating_sub(time.as_us().rem_euclid(length_us));
        Time::from_us(start_us.saturating_add(length_us / 2))
    }

    /// The middle of the bucket after that of `time`; `None` where every time is a bucket of its
    /// own.
    pub fn middle_of_next_bucket(&self, time: Time) -> Option<Time> {
        let length_us = i64::from(self.0.time_bucket_s) * 1_000_000;
        (length_us > 0).then(|| self.middle_of_bucket(time).plus_us(length_us))
    }

    /// Which descriptors count as the same.
    pub fn matching(&self) -> &MatchConfig {
        &self.0.matching
    }

    /// Which matches agree on a displacement.
    pub fn vote(&self) -> &VoteConfig {
        &self.0.vote
    }

    /// How visibility is modelled.
    pub fn visibility(&self) -> &VisibilityConfig {
        &self.0.visibility
    }

    /// The model of the method: `static` knows the mean only.
    pub(super) fn model(&self) -> VisibilityConfig {
        match self.0.method {
            Method::Static => VisibilityConfig::mean(),
            _ => self.0.visibility.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fremen::visibility::BitRow;

    #[test]
    fn names_are_read_back() {
        for method in Method::ALL {
            assert_eq!(method.name().parse::<Method>().expect("own name"), method);
        }
        let error = "psychic".parse::<Method>().expect_err("no such method");
        assert!(error.to_string().contains("fremen"), "{error}");
    }

    #[test]
    fn probabilities_and_scores_that_make_no_sense_are_refused() {
        for text in [
            "risk = 1.0",
            "elsewhere = nan",
            "calibrated = false",
            "risk = -0.1",
        ] {
            assert!(toml::from_str::<LocalizerConfig>(text).is_err(), "{text}");
        }
        let cfg = LocalizerConfig::default().with_risk(f64::NAN);
        assert!(cfg.check().is_err());
    }

    #[cfg(not(feature = "hnsw"))]
    #[test]
    fn signatures_need_their_feature() {
        let cfg = LocalizerConfig::default().with_place_search(PlaceSearch::Words);
        let error = cfg.check().expect_err("no graph");
        assert_eq!(error.kind(), ErrorKind::Config);
        assert!(error.to_string().contains("hnsw"), "{error}");
    }

    #[test]
    fn a_bucket_has_one_middle_near_its_times() {
        let cfg = LocalizerConfig::default().with_time_bucket_s(600);
        for s in [-600, 0, 1_700_000_400] {
            let middle = Time::from_s(s + 300);
            for us in [0, 1, 599_999_999] {
                assert_eq!(cfg.middle_of_bucket(Time::from_s(s).plus_us(us)), middle);
            }
            assert_ne!(cfg.middle_of_bucket(Time::from_s(s).plus_us(-1)), middle);
        }
        let now = Time::from_us(-1_234_567);
        assert_eq!(cfg.with_time_bucket_s(0).middle_of_bucket(now), now);
    }

    #[test]
    fn weak_features_may_be_chosen_until_a_place_is_settled() {
        let mut log = HistoryLog::new();
        let mut seen = BitRow::zeros(3);
        (0..3).for_each(|feature| seen.set(feature));
        let cfg = LocalizerConfig::default().with_settled(2, 1, 0);
        let may_be_chosen = |log: &HistoryLog| {
            let references = cfg.references(log, Visits::All).expect("fits");
            [0, 1, 2].map(|feature| references.may_be_chosen(feature))
        };
        let push = |log: &mut HistoryLog, at| {
            log.push_visit(Time::from_s(at), seen.clone(), None)
                .expect("fits");
        };
        push(&mut log, 0);
        assert_eq!(may_be_chosen(&log), [true, true, true]);
        push(&mut log, 1);
        assert_eq!(may_be_chosen(&log), [true, false, false]);
        let cfg = cfg.clone().with_settled(2, 0, 0);
        let references = cfg.references(&log, Visits::All).expect("fits");
        assert!(references.may_be_chosen(2));
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
