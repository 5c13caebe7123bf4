//! What is measured on what?
//!
//! A suite is a TOML file in `eval/suites/` (embedded here): a dataset, a protocol that keeps queries
//! apart from what is learnt, the numbers of features n, and *arms*: a preset with the methods, models
//! and scores to run it with. Suites hold no results and no thresholds.

use chronotope::localize::{EvidencePart, LocalizerConfig, Method, Preset, Score};
use chronotope::predict::Choice;
use chronotope::visibility::VisibilityConfig;
use chronotope::{Error, ErrorKind, Period, Result};
use serde::Deserialize;

use crate::results::{Order, Variant};

/// The numbers of features a place that every suite runs unless it says otherwise.
const SIZES: [usize; 13] = [5, 10, 15, 20, 25, 30, 40, 50, 75, 100, 150, 200, 300];

const BUILTIN: &[(&str, &str)] = &[
    (
        "stromovka-loo",
        include_str!("../suites/stromovka-loo.toml"),
    ),
    (
        "stromovka-split",
        include_str!("../suites/stromovka-split.toml"),
    ),
    ("michigan-loo", include_str!("../suites/michigan-loo.toml")),
    ("lasvegas", include_str!("../suites/lasvegas.toml")),
    ("tilde", include_str!("../suites/tilde.toml")),
    ("door", include_str!("../suites/door.toml")),
    ("door2016", include_str!("../suites/door2016.toml")),
    ("aruba", include_str!("../suites/aruba.toml")),
    ("edges", include_str!("../suites/edges.toml")),
    ("synthetic", include_str!("../suites/synthetic.toml")),
    ("foreign", include_str!("../suites/foreign.toml")),
    ("ablation", include_str!("../suites/ablation.toml")),
];

/// One suite.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Suite {
    /// Its name in commands and files.
    #[serde(skip)]
    pub name: String,
    /// What it asks, in one line.
    pub title: String,
    /// A manifest in `datasets/`, or `synthetic`.
    pub dataset: String,
    /// How queries are kept apart from what is learnt.
    pub protocol: Protocol,
    /// Numbers of features a place, ascending.
    #[serde(default = "default_sizes")]
    pub sizes: Vec<usize>,
    /// Whether only re-observation is judged, because telling the places apart is too easy.
    #[serde(default)]
    pub visibility_only: bool,
    /// What is run; nothing in a suite of series, which runs every temporal model.
    #[serde(default)]
    pub arms: Vec<Arm>,
}

fn default_sizes() -> Vec<usize> {
    SIZES.to_vec()
}

/// How queries are kept apart from what is learnt.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "kind", deny_unknown_fields)]
pub enum Protocol {
    /// For each visit number, learn every other visit of each place and ask for that one.
    LeaveOneVisitOut,
    /// Learn what is before the manifest's split, ask for what is after it.
    Split,
    /// Single states over time instead of images; see [`series`](crate::series).
    Series {
        /// What their files look like.
        form: Form,
        /// The share of samples that is left where they are thinned.
        share: f64,
    },
    /// Worlds of these seeds, each with and without rhythms.
    #[serde(rename_all = "kebab-case")]
    Synthetic {
        /// Seeds `1..=num-seeds`.
        num_seeds: u64,
        /// Visits of each place that are learnt.
        num_learn: usize,
        /// Visits of each place that are asked for.
        num_query: usize,
    },
    /// The datasets of other suites, each by its own protocol, in one run.
    #[serde(rename_all = "kebab-case")]
    Several {
        /// Names of these suites.
        suites: Vec<String>,
        /// Whether each place's queries are also asked with the place left out of the map.
        #[serde(default)]
        leave_place_out: bool,
        /// Of a synthetic suite among them, so many worlds.
        #[serde(default = "one")]
        num_seeds: u64,
    },
}

const fn one() -> u64 {
    1
}

/// The files of a suite of series.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Form {
    /// `week`, `day7`, `day8`: a door, a sample a second.
    Door,
    /// Ten weeks and a later one: a door, a sample a minute.
    Door2016,
    /// The room of one person, minute by minute.
    Aruba,
    /// Traversals of a robot's topological edges: time, duration, success.
    Edges,
}

impl Form {
    /// The name of its folder.
    pub fn name(self) -> &'static str {
        match self {
            Self::Door => "door",
            Self::Door2016 => "door2016",
            Self::Aruba => "aruba",
            Self::Edges => "edges",
        }
    }
}

/// One preset with what it is run with.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Arm {
    /// The configuration of learning and localising.
    pub preset: Preset,
    /// The methods; those that need a time are left out where the dataset has no clock.
    #[serde(default = "all_methods")]
    pub methods: Vec<Method>,
    /// What places are ranked by.
    pub scores: Vec<Score>,
    /// The models of `fremen`; the first one, at its first order, also serves `fused` and `freex`.
    #[serde(default)]
    pub models: Vec<Model>,
    /// Where given, the time of a place's i-th visit is i times this many seconds, as in the reference
    /// benchmark, which knows the month of a visit only.
    pub visit_clock_s: Option<f64>,
    /// How features are chosen, where not as the preset does.
    pub choice: Option<Choice>,
    /// Parts of the likelihood that are left out.
    #[serde(default)]
    pub without: Vec<EvidencePart>,
    /// Added to the names of models, to tell the arms of an ablation apart.
    pub label: Option<String>,
    /// Whether runs that count matches learn what a count is worth, for the judgement of posteriors;
    /// in suites of many maps that is half of the time.
    #[serde(default = "yes")]
    pub calibrate_counts: bool,
}

const fn yes() -> bool {
    true
}

fn all_methods() -> Vec<Method> {
    Method::ALL.to_vec()
}

/// A visibility model at several orders.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Model {
    /// Its name in tables.
    pub name: String,
    /// The candidate periods; those of the preset where left out, with the preset's guards.
    pub candidates: Option<chronotope::spectrum::CandidatePeriods>,
    /// How many of them a feature may follow.
    pub orders: Vec<usize>,
}

/// One thing to run, for all scores and all n.
#[derive(Clone, Debug)]
pub struct Run {
    /// How to localise; its score is the first of `scores`.
    pub localizer: LocalizerConfig,
    /// What places are ranked by, all from one pass.
    pub scores: Vec<Score>,
    /// Its name in tables, without score.
    pub model: String,
    /// Components of the model.
    pub order: u32,
}

impl Run {
    /// The name of this run's rows for one score.
    pub fn variant(&self, preset: Preset, score: Score) -> Variant {
        Variant {
            preset: preset.name().into(),
            method: self.localizer.method().name().into(),
            model: self.model.clone(),
            score: score.name().into(),
            order: Order::Fixed(self.order),
        }
    }
}

impl Suite {
    /// The suites that come with this program: name and text.
    pub fn builtin() -> impl Iterator<Item = Result<Self>> {
        BUILTIN.iter().map(|(name, text)| Self::parse(name, text))
    }

    /// The suite called `name`.
    pub fn find(name: &str) -> Result<Self> {
        match BUILTIN.iter().find(|(known, _)| *known == name) {
            Some((name, text)) => Self::parse(name, text),
            None => Err(
                Error::new(ErrorKind::Config, format!("there is no suite `{name}`"))
                    .with_help("`chronotope-eval list` shows all"),
            ),
        }
    }

    fn parse(name: &str, text: &str) -> Result<Self> {
        let mut suite: Self = toml::from_str(text).map_err(|cause| {
            Error::new(ErrorKind::Config, cause.to_string()).with_path(format!("{name}.toml"))
        })?;
        name.clone_into(&mut suite.name);
        Ok(suite)
    }
}

/// What the shipped default does: without a clock, its static self.
pub fn shipped(has_clock: bool) -> LocalizerConfig {
    let cfg = LocalizerConfig::default();
    if has_clock { cfg } else { timeless(cfg) }
}

/// `cfg` with a method that needs no time.
fn timeless(cfg: LocalizerConfig) -> LocalizerConfig {
    if cfg.method().needs_time() {
        cfg.with_method(Method::Static)
            .with_visibility(VisibilityConfig::mean())
    } else {
        cfg
    }
}

impl Arm {
    /// The runs where times are no clock: a run that needs one is replaced by `static` and keeps its name,
    /// as the default configuration does without a time that it can use.
    pub fn runs_without_clock(&self) -> Vec<Run> {
        let mut runs = self.runs(true);
        for run in &mut runs {
            run.localizer = timeless(run.localizer.clone());
        }
        runs
    }

    /// The time between visits, where visits are numbered instead of dated.
    pub fn visit_clock(&self) -> Result<Option<Period>> {
        self.visit_clock_s.map(Period::from_s).transpose()
    }

    /// Everything to run, in the order of tables; without a clock, only what needs no time.
    ///
    /// Methods that predict features are run twice where the arm asks for likelihoods too: those go with
    /// the preset's choice of features, matches are counted on the most likely ones, as in the papers.
    pub fn runs(&self, has_clock: bool) -> Vec<Run> {
        let mut runs = Vec::new();
        for &method in &self.methods {
            if method.needs_time() && !has_clock {
                continue;
            }
            let base = LocalizerConfig::preset(self.preset)
                .with_method(method)
                .with_less_evidence(self.without.clone());
            let base = match self.choice {
                Some(choice) => base.with_choice(choice),
                None => base,
            };
            match method {
                Method::Static => {
                    self.predicting(
                        &mut runs,
                        &base.with_visibility(VisibilityConfig::mean()),
                        "mean",
                        0,
                    );
                }
                Method::Experience | Method::ExperienceAll => runs.push(Run {
                    localizer: scored(&base, &self.scores),
                    scores: self.scores.clone(),
                    model: "none".into(),
                    order: 0,
                }),
                Method::Fremen => {
                    for (model, order) in self.models_and_orders() {
                        let cfg = base.clone().with_visibility(model.visibility(&base, order));
                        self.predicting(&mut runs, &cfg, &model.name, order as u32);
                    }
                }
                // Fused and freex.
                _ => {
                    runs.extend(self.models_and_orders().take(1).map(|(model, order)| {
                        let cfg = base.clone().with_visibility(model.visibility(&base, order));
                        Run {
                            localizer: scored(&cfg, &self.scores),
                            scores: self.scores.clone(),
                            model: model.name.clone(),
                            order: order as u32,
                        }
                    }));
                }
            }
        }
        if let Some(label) = &self.label {
            for run in &mut runs {
                run.model = format!("{} {label}", run.model);
            }
        }
        runs
    }

    fn models_and_orders(&self) -> impl Iterator<Item = (&Model, usize)> {
        self.models
            .iter()
            .flat_map(|model| model.orders.iter().map(move |&order| (model, order)))
    }

    /// The runs of one model of features.
    fn predicting(&self, runs: &mut Vec<Run>, cfg: &LocalizerConfig, model: &str, order: u32) {
        if self.choice.is_some() {
            runs.push(Run {
                localizer: scored(cfg, &self.scores),
                scores: self.scores.clone(),
                model: model.into(),
                order,
            });
            return;
        }
        let (likelihood, counting): (Vec<Score>, Vec<Score>) =
            (self.scores.iter()).partition(|score| **score == Score::Likelihood);
        let as_in_papers = cfg.clone().with_choice(Choice::Likeliest);
        for (scores, cfg) in [(likelihood, cfg), (counting, &as_in_papers)] {
            if !scores.is_empty() {
                let weighs = scores.contains(&Score::Likelihood) || self.calibrate_counts;
                let calibrated = cfg.calibrated() && weighs;
                runs.push(Run {
                    localizer: scored(cfg, &scores).with_calibrated(calibrated),
                    scores,
                    model: model.into(),
                    order,
                });
            }
        }
    }
}

fn scored(cfg: &LocalizerConfig, scores: &[Score]) -> LocalizerConfig {
    match scores.first() {
        Some(&score) => cfg.clone().with_score(score),
        None => cfg.clone(),
    }
}

impl Model {
    fn visibility(&self, base: &LocalizerConfig, order: usize) -> VisibilityConfig {
        match &self.candidates {
            Some(candidates) => VisibilityConfig::fremen(
                candidates.clone(),
                chronotope::visibility::Order::Fixed(order),
            ),
            None => base.visibility().clone().with_order(order),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_suite_that_comes_with_the_program_reads_and_runs_something() {
        for suite in Suite::builtin() {
            let suite = suite.unwrap();
            for arm in &suite.arms {
                assert!(!arm.runs(true).is_empty(), "{}", suite.name);
                assert!(!arm.scores.is_empty(), "{}", suite.name);
            }
            assert!(suite.sizes.is_sorted(), "{}", suite.name);
        }
    }

    #[test]
    fn the_arms_of_an_ablation_differ_from_the_default_and_in_name() {
        let suite = Suite::find("ablation").unwrap();
        let mut names = std::collections::BTreeSet::new();
        let mut num_defaults = 0;
        for arm in &suite.arms {
            for run in arm.runs(true) {
                num_defaults += usize::from(run.localizer == LocalizerConfig::default());
                for &score in &run.scores {
                    let name = run.variant(arm.preset, score).to_string();
                    assert!(names.insert(name.clone()), "{name} is there twice");
                }
            }
        }
        assert_eq!(num_defaults, 1);
        assert!(names.iter().any(|name| name.contains("likeliest")));
    }

    #[test]
    fn without_a_clock_no_method_asks_for_the_time() {
        let suite = Suite::find("stromovka-loo").unwrap();
        let runs = suite.arms[0].runs(false);
        assert!(runs.iter().all(|run| !run.localizer.method().needs_time()));
        assert!(runs.len() >= 3);
        for (has_clock, method) in [(true, Method::Fremen), (false, Method::Static)] {
            let arms = suite
                .arms
                .iter()
                .filter(|arm| arm.preset == Preset::Default);
            let runs: Vec<Run> = arms.flat_map(|arm| arm.runs(has_clock)).collect();
            let is_shipped = |run: &&Run| run.localizer == shipped(has_clock);
            let ours: Vec<&Run> = runs.iter().filter(is_shipped).collect();
            assert_eq!(ours.len(), 1, "clock: {has_clock}");
            assert_eq!(ours[0].localizer.method(), method);
        }
    }
}
