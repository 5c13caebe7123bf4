//! What is run on a dataset: which preset, methods, models and scores?

use chronotope::localize::{EvidencePart, LocalizerConfig, Method, Preset, Score};
use chronotope::predict::Choice;
use chronotope::visibility::VisibilityConfig;
use chronotope::{Period, Result};
use serde::Deserialize;

use crate::results::{RowOrder, Variant};

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
    /// Where given, the time of a place's i-th visit is i times this many seconds, as in the
    /// reference benchmark, which knows the month of a visit only.
    pub visit_clock_s: Option<f64>,
    /// How features are chosen, where not as the preset does.
    pub choice: Option<Choice>,
    /// Parts of the likelihood that are left out.
    #[serde(default)]
    pub without: Vec<EvidencePart>,
    /// Added to the names of models, to distinguish the arms of an ablation.
    pub label: Option<String>,
    /// Whether runs that count matches learn what a count is worth, for the judgement of
    /// posteriors; in suites of many maps that is half of the time.
    #[serde(default = "yes")]
    pub calibrate_counts: bool,
    /// Whether queries are also answered as images that follow each other, where the protocol
    /// queries whole runs.
    #[serde(default)]
    pub routes: bool,
}

/// What places are ranked by in one row: its `score`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ranking {
    /// By what one image scores.
    Image(Score),
    /// By what is believed of the robot after all images of its way so far.
    Tracked,
    /// The same, of a robot that is carried elsewhere again and again.
    Kidnapped,
    /// By the scores of the latest images, added up along the route, as in `SeqSLAM`.
    Sequence,
}

impl Ranking {
    /// Its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Image(score) => score.name(),
            Self::Tracked => "tracked",
            Self::Kidnapped => "kidnapped",
            Self::Sequence => "sequence",
        }
    }

    /// Whether it may call an image unknown.
    pub fn has_rule(self) -> bool {
        match self {
            Self::Image(score) => score == Score::Likelihood,
            Self::Tracked | Self::Kidnapped => true,
            Self::Sequence => false,
        }
    }
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
    /// Whether queries are also answered as images that follow each other.
    pub follows: bool,
}

impl Run {
    /// What places are ranked by: each score, and what comes of images that follow each other.
    pub fn rankings(&self) -> Vec<Ranking> {
        let mut rankings: Vec<_> = self.scores.iter().copied().map(Ranking::Image).collect();
        if self.follows {
            rankings.extend([Ranking::Tracked, Ranking::Kidnapped, Ranking::Sequence]);
        }
        rankings
    }

    /// The name of this run's rows for one ranking.
    pub fn variant(&self, preset: Preset, ranking: Ranking) -> Variant {
        Variant {
            preset: preset.name().into(),
            method: self.localizer.method().name().into(),
            model: self.model.clone(),
            score: ranking.name().into(),
            order: RowOrder::Fixed(self.order),
        }
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
    /// The runs where times are no clock: a run that needs one is replaced by `static` and keeps
    /// its name, as the default configuration does without a time that it can use.
    pub fn runs_without_clock(&self) -> Result<Vec<Run>> {
        let mut runs = self.runs(true)?;
        for run in &mut runs {
            run.localizer = timeless(run.localizer.clone());
        }
        Ok(runs)
    }

    /// The time between visits, where visits are numbered instead of dated.
    pub fn visit_clock(&self) -> Result<Option<Period>> {
        self.visit_clock_s.map(Period::from_s).transpose()
    }

    /// Everything to run, in the order of tables; without a clock, only what needs no time.
    ///
    /// Methods that predict features are run twice where the arm has likelihoods too: those go with
    /// the preset's choice of features, matches are counted on the most likely ones, as in the
    /// papers.
    pub fn runs(&self, has_clock: bool) -> Result<Vec<Run>> {
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
                    follows: false,
                }),
                Method::Fremen => {
                    for (model, order) in self.models_and_orders() {
                        let cfg = base
                            .clone()
                            .with_visibility(model.visibility(&base, order)?);
                        self.predicting(&mut runs, &cfg, &model.name, order as u32);
                    }
                }
                _ => {
                    if let Some((model, order)) = self.models_and_orders().next() {
                        let cfg = base
                            .clone()
                            .with_visibility(model.visibility(&base, order)?);
                        runs.push(Run {
                            localizer: scored(&cfg, &self.scores),
                            scores: self.scores.clone(),
                            model: model.name.clone(),
                            order: order as u32,
                            follows: false,
                        });
                    }
                }
            }
        }
        for run in &mut runs {
            if let Some(label) = &self.label {
                run.model = format!("{} {label}", run.model);
            }
            // A way is followed by posteriors, which need calibrated likelihoods.
            run.follows = self.routes
                && run.localizer.method().predicts()
                && run.localizer.score() == Score::Likelihood;
        }
        Ok(runs)
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
                follows: false,
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
                    follows: false,
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
    fn visibility(&self, base: &LocalizerConfig, order: usize) -> Result<VisibilityConfig> {
        match &self.candidates {
            Some(candidates) => Ok(VisibilityConfig::fremen(
                candidates.clone(),
                chronotope::visibility::Order::Fixed(order),
            )),
            None => base.visibility().clone().with_order(order),
        }
    }
}
