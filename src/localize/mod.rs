//! Where am I, how sure?
//!
//! A [`Localizer`] reads one [`Snapshot`] of a map. For each place it predicts what should be visible
//! at the query's time, matches that with the live image, finds the displacement that most matches agree
//! on, and scores the place: by the number of matches, by those that agree ([`Score`]), or by the log
//! odds of "this place" against "somewhere else", to which matched and missing features both contribute
//! (`evidence.rs`). What matches are worth is learnt from the map's own past visits ([`Calibration`]),
//! so that the posterior over places, and over being at none of them, can be taken at its word; the
//! answer is [`Decision::At`] a place only if the probability of being wrong is at most
//! [`LocalizerConfig::risk`]. Everything that led to the answer is part of it ([`Localization`]), so
//! that a dashboard needs nothing else.
//!
//! The experience methods differ in one step only: instead of one predicted map, a place has several
//! remembered appearances. The best of them speaks for the place where matches are counted; their mean
//! likelihood does where evidence is weighed.
//!
//! Cost: with N places, n features each and m live ones, N (F + n log n) to predict, N n m Hamming
//! distances to match and 64 N n additions to weigh; the experience methods match E appearances a
//! place, E n m distances. [`Localizer::new`] fits and calibrates, which takes from a tenth of a second
//! to a few seconds.
//!
//! Invariants: localising never changes the map; the answer depends on snapshot, configuration and
//! query alone (ties go to the lowest node and are counted); with a warmed-up [`Scratch`] and output,
//! nothing is allocated.
//!
//! Not for: following a robot between images (each query stands alone) or metric poses (a displacement
//! in px is all that one image gives).

mod calibration;
mod config;
mod evidence;
mod localization;
mod sweep;
pub mod trace;

use std::sync::Arc;

pub use calibration::{Calibration, Curve, Temper};
pub use config::{LocalizerConfig, Method, Preset, Score};
pub use localization::{Candidate, Decision, EvidenceMatch, Localization, Reason};
pub use sweep::{Sweep, Tally};

use self::calibration::as_evidence;
use self::evidence::{Expectation, LogMean};
use crate::error::{Error, ErrorKind, Result};
use crate::feature::{Features, FeaturesView};
use crate::map::{AppearanceUse, Node, NodeId, Snapshot};
use crate::matching::{
    Displacement, Match, MatchScratch, Matcher, Vote, VoteScratch, displacements_into,
    vote_displacement,
};
use crate::predict::{Choice, PredictedMap, Selection, Witnesses};
use crate::time::Time;
use crate::visibility::{self, VisibilityConfig, VisibilityModel, Visits};

/// Sums in another order differ by less.
const SAME_PROBABILITY: f64 = 1e-9;

/// What the camera sees.
#[derive(Clone, Copy, Debug)]
pub struct Query<'a> {
    /// The features of the live image, by the extractor the map was learnt with.
    pub features: &'a Features,
    /// When it was taken; `static`, `experience` and `experience-all` do without.
    pub time: Option<Time>,
    /// Width and height of the image in px, to be compared with the map's.
    pub image_size: Option<(u32, u32)>,
}

/// What one place is matched by.
#[derive(Debug)]
enum Plan {
    /// Features of the place, chosen by their visibility at the query's time.
    Predicted {
        model: Box<dyn VisibilityModel>,
        witnesses: Witnesses,
    },
    /// The appearances kept at these visits; with a model, those that are likely at the query's time.
    Appearances {
        visits: Vec<u32>,
        likely: Option<Likely>,
    },
}

/// When each experience of a place locates it.
#[derive(Debug)]
struct Likely {
    model: Box<dyn VisibilityModel>,
    /// How often each does at any time.
    means: Vec<f64>,
}

/// Answers "where am I?" from one snapshot; immutable and shared between threads.
#[derive(Debug)]
pub struct Localizer {
    snapshot: Arc<Snapshot>,
    cfg: LocalizerConfig,
    matcher: Matcher,
    plans: Vec<Plan>,
    calibration: Option<Arc<Calibration>>,
}

/// Memory that a [`Localizer`] works in; owned by the caller, one a thread, used again and again.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    predicted: PredictedMap,
    /// The features of the predicted map, most likely first.
    ranked: Features,
    /// p(t) of each experience.
    likely: Vec<f64>,
    /// The visits whose appearances are matched.
    visits: Vec<u32>,
    matching: MatchScratch,
    matches: Vec<Match>,
    verify: Verify,
    expectation: Expectation,
    scores: Vec<f64>,
    posterior: Vec<f64>,
}

/// What verification works in.
#[derive(Clone, Debug, Default)]
struct Verify {
    displacements: Vec<Displacement>,
    vote: VoteScratch,
}

impl Localizer {
    /// Fits the visibility model of every place of `snapshot`, and calibrates what matches are worth on
    /// its past visits (unless [`LocalizerConfig::calibrated`] says no).
    ///
    /// Fails with [`ErrorKind::Config`] if the map has no places, or none of the appearances that the
    /// method needs were kept.
    pub fn new(snapshot: Arc<Snapshot>, cfg: LocalizerConfig) -> Result<Self> {
        let mut localizer = Self::uncalibrated(snapshot, cfg)?;
        if localizer.cfg.calibrated() {
            localizer.calibration = Some(Arc::new(Calibration::learn(&localizer)?));
        }
        Ok(localizer)
    }

    /// The same on a newer snapshot of its map: models are fitted again, while what matches are worth is
    /// kept, which takes many visits to change. For a robot that learns while it localises.
    pub fn on_newer(&self, snapshot: Arc<Snapshot>) -> Result<Self> {
        Ok(Self {
            calibration: self.calibration.clone(),
            ..Self::uncalibrated(snapshot, self.cfg.clone())?
        })
    }

    fn uncalibrated(snapshot: Arc<Snapshot>, cfg: LocalizerConfig) -> Result<Self> {
        if snapshot.nodes.is_empty() {
            return Err(Error::new(ErrorKind::Config, "the map has no places")
                .with_help("build it from at least one image of each place"));
        }
        let plans = (snapshot.nodes.iter())
            .map(|node| Plan::of(node, &cfg))
            .collect::<Result<Vec<_>>>()?;
        let remembers = |plan: &Plan| match plan {
            Plan::Predicted { .. } => true,
            Plan::Appearances { visits, .. } => !visits.is_empty(),
        };
        if !plans.iter().any(remembers) {
            return Err(Error::new(
                ErrorKind::Config,
                format!(
                    "the map kept no appearances, which method `{}` needs",
                    cfg.method()
                ),
            )
            .with_help("build the map with `keep-appearances = \"all\"`, or use method `fremen`"));
        }
        Ok(Self {
            matcher: Matcher::new(cfg.matching().clone()),
            snapshot,
            cfg,
            plans,
            calibration: None,
        })
    }

    /// What is known of the worth of matches; `None` if the configuration asks for no calibration.
    pub fn calibration(&self) -> Option<&Calibration> {
        self.calibration.as_deref()
    }

    /// The same with another part of each place predicted; models are not fitted again.
    #[must_use]
    pub fn with_selection(mut self, selection: Selection) -> Self {
        self.cfg = self.cfg.with_selection(selection);
        self
    }

    /// The map it reads.
    pub fn snapshot(&self) -> &Arc<Snapshot> {
        &self.snapshot
    }

    /// How it works.
    pub fn cfg(&self) -> &LocalizerConfig {
        &self.cfg
    }

    /// The visibility model of a place; `None` where the method remembers appearances instead.
    pub fn model(&self, node: NodeId) -> Option<&dyn VisibilityModel> {
        match &self.plans[node.0 as usize] {
            Plan::Predicted { model, .. } => Some(model.as_ref()),
            Plan::Appearances { .. } => None,
        }
    }

    /// Memory to work in.
    pub fn scratch(&self) -> Scratch {
        Scratch::default()
    }

    /// [`localize_into`](Self::localize_into) a new [`Localization`].
    pub fn localize(&self, scratch: &mut Scratch, query: &Query<'_>) -> Result<Localization> {
        let mut out = Localization::default();
        self.localize_into(scratch, query, &mut out)?;
        Ok(out)
    }

    /// Ranks the places by how well they explain `query`, and decides.
    ///
    /// Fails with [`ErrorKind::Time`] if the method needs a time and the query has none, and with
    /// [`ErrorKind::Shape`] if the query's image has another size than the map's.
    pub fn localize_into(
        &self,
        scratch: &mut Scratch,
        query: &Query<'_>,
        out: &mut Localization,
    ) -> Result<()> {
        let time = self.check(query)?;
        let live = query.features.view();
        out.restart(self.snapshot.nodes.len(), query.time);
        for (id, candidate) in (0..).map(NodeId).zip(&mut out.ranking) {
            candidate.restart(id);
            match &self.plans[id.0 as usize] {
                Plan::Predicted { model, witnesses } => {
                    self.predict(scratch, id, model.as_ref(), witnesses, time);
                    candidate.predict(&scratch.predicted);
                    let ranked = std::mem::take(&mut scratch.ranked);
                    out.pairs_compared +=
                        self.verify(scratch, candidate, None, ranked.view(), live);
                    scratch.ranked = ranked;
                }
                plan @ Plan::Appearances { .. } => {
                    plan.visits_into(time, &mut scratch.likely, &mut scratch.visits);
                    let visits = std::mem::take(&mut scratch.visits);
                    let mut odds = LogMean::default();
                    for &visit in &visits {
                        let ranked = self.appearance(id, visit, self.largest_size());
                        self.expect_appearance(&mut scratch.expectation, id, visit, ranked.len());
                        out.pairs_compared +=
                            self.verify(scratch, candidate, Some(visit), ranked, live);
                        odds.push(candidate.last_log_odds);
                    }
                    candidate.settle(self.cfg.score(), odds.value());
                    scratch.visits = visits;
                }
            }
        }
        self.weigh(scratch, out);
        out.decide(&self.cfg);
        Ok(())
    }

    /// Matches one predicted map or appearance with the live image, and takes over what it says;
    /// returns the number of Hamming distances.
    fn verify(
        &self,
        scratch: &mut Scratch,
        candidate: &mut Candidate,
        visit: Option<u32>,
        ranked: FeaturesView<'_>,
        live: FeaturesView<'_>,
    ) -> u64 {
        let Scratch {
            matching,
            matches,
            verify,
            expectation,
            ..
        } = scratch;
        self.matcher.matches_into(matching, ranked, live, matches);
        let vote = verify.vote(&self.cfg, matches, ranked, live);
        let inliers = verify.vote.inliers();
        let log_odds = self.calibration.as_ref().map_or(0.0, |calibration| {
            expectation.log_odds(calibration, ranked.len(), matches, inliers, &vote)
        });
        candidate.hear(&self.cfg, visit, matches, inliers, &vote, log_odds);
        (ranked.len() * live.len()) as u64
    }

    /// Gives every place its posterior.
    fn weigh(&self, scratch: &mut Scratch, out: &mut Localization) {
        let Some(calibration) = &self.calibration else {
            out.share_scores();
            return;
        };
        let score = self.cfg.score();
        scratch.scores.clear();
        (scratch.scores).extend((out.ranking.iter()).map(|it| as_evidence(score, it.score)));
        let temper = calibration.temper(score, self.typical_size(out));
        out.elsewhere = temper.posterior_into(
            &scratch.scores,
            self.cfg.elsewhere(),
            &mut scratch.posterior,
        );
        for (candidate, &posterior) in out.ranking.iter_mut().zip(&scratch.posterior) {
            candidate.posterior = posterior;
        }
    }

    /// The posterior of each place, and of "elsewhere", from their scores at `n` features; `None`
    /// without calibration.
    ///
    /// An evaluation asks this for scores that it has of a [`Sweep`].
    pub fn posterior(&self, score: Score, n: usize, scores: &[f64]) -> Option<(Vec<f64>, f64)> {
        let calibration = self.calibration.as_ref()?;
        let evidence: Vec<f64> = (scores.iter())
            .map(|&value| as_evidence(score, value))
            .collect();
        let mut posterior = Vec::new();
        let temper = calibration.temper(score, n);
        let elsewhere = temper.posterior_into(&evidence, self.cfg.elsewhere(), &mut posterior);
        Some((posterior, elsewhere))
    }

    /// The number of features that the scores are made of: n, or what a threshold leaves on average.
    fn typical_size(&self, out: &Localization) -> usize {
        match self.cfg.selection() {
            Selection::Top(n) => n,
            Selection::Threshold(_) => {
                let total: usize = out.ranking.iter().map(|it| it.predicted.len()).sum();
                total / out.ranking.len().max(1)
            }
        }
    }

    /// The query's time (or the epoch, for methods that do without), if the query fits the map.
    fn check(&self, query: &Query<'_>) -> Result<Time> {
        if let (Some(live), Some(map)) = (query.image_size, self.snapshot.meta.image_size)
            && live != map
        {
            return Err(Error::new(
                ErrorKind::Shape,
                format!(
                    "the image has {} x {} px, but the map was learnt from {} x {} px",
                    live.0, live.1, map.0, map.1
                ),
            )
            .with_help("crop or scale the image as the map's images were"));
        }
        match query.time {
            Some(time) => Ok(time),
            None if self.cfg.method().needs_time() => Err(Error::new(
                ErrorKind::Time,
                format!("method `{}` needs the time of the image", self.cfg.method()),
            )
            .with_help("give the time, or use method `static`")),
            None => Ok(Time::default()),
        }
    }

    /// Predicts the configured part of a place, gathers its features in order and notes what each
    /// would say.
    fn predict(
        &self,
        scratch: &mut Scratch,
        id: NodeId,
        model: &dyn VisibilityModel,
        witnesses: &Witnesses,
        time: Time,
    ) {
        self.predict_part(scratch, id, model, witnesses, time, self.cfg.selection());
    }

    /// The same for another part.
    fn predict_part(
        &self,
        scratch: &mut Scratch,
        id: NodeId,
        model: &dyn VisibilityModel,
        witnesses: &Witnesses,
        time: Time,
        selection: Selection,
    ) {
        self.choose(scratch, model, witnesses, time, selection);
        let features = &self.snapshot.node(id).features;
        scratch
            .ranked
            .gather(features, scratch.predicted.features());
        if let Some(calibration) = &self.calibration {
            calibration.expect_predicted(
                &mut scratch.expectation,
                id,
                &scratch.predicted,
                witnesses,
            );
        }
    }

    /// Chooses the features of a place that should be visible.
    fn choose(
        &self,
        scratch: &mut Scratch,
        model: &dyn VisibilityModel,
        witnesses: &Witnesses,
        time: Time,
        selection: Selection,
    ) {
        let predicted = &mut scratch.predicted;
        match self.cfg.choice() {
            Choice::Likeliest => predicted.predict(model, time, selection),
            Choice::Covering => predicted.predict_covering(model, time, selection, witnesses),
        }
    }

    /// Notes what each feature of an appearance would say.
    fn expect_appearance(&self, expectation: &mut Expectation, id: NodeId, visit: u32, len: usize) {
        if let Some(calibration) = &self.calibration {
            calibration.expect_appearance(expectation, id, visit, len);
        }
    }

    /// At most the `size` strongest features of an appearance.
    fn appearance(&self, id: NodeId, visit: u32, size: usize) -> FeaturesView<'_> {
        let appearance = &self.snapshot.node(id).visits[visit as usize].appearance;
        appearance
            .as_ref()
            .map_or(FeaturesView::EMPTY, |features| features.view().prefix(size))
    }

    /// How many features of an appearance the configured selection takes.
    fn largest_size(&self) -> usize {
        match self.cfg.selection() {
            Selection::Top(n) => n,
            Selection::Threshold(_) => usize::MAX,
        }
    }
}

impl Plan {
    fn of(node: &Node, cfg: &LocalizerConfig) -> Result<Self> {
        let fit = |cfg: &VisibilityConfig, log| visibility::fit(log, cfg, Visits::All);
        let kept = |only: Option<AppearanceUse>| {
            (0..)
                .zip(&node.visits)
                .filter(|(_, visit)| {
                    visit.appearance.is_some()
                        && only.is_none_or(|only| visit.appearance_use == only)
                })
                .map(|(index, _)| index)
                .collect()
        };
        Ok(match cfg.method() {
            Method::Static | Method::Fremen => Self::Predicted {
                model: fit(&cfg.model(), &node.log)?,
                witnesses: Witnesses::of(&node.log, Visits::All)?,
            },
            Method::ExperienceAll => Self::Appearances {
                visits: kept(None),
                likely: None,
            },
            Method::Experience => Self::Appearances {
                visits: kept(Some(AppearanceUse::Experience)),
                likely: None,
            },
            Method::Freex => Self::Appearances {
                // Also those whose appearance is lost: the log counts them, and they match nothing.
                visits: (0..)
                    .zip(&node.visits)
                    .filter(|(_, visit)| visit.appearance_use == AppearanceUse::Experience)
                    .map(|(index, _)| index)
                    .collect(),
                likely: Some(Likely {
                    model: fit(cfg.visibility(), &node.experience_log)?,
                    means: {
                        let model = fit(&VisibilityConfig::mean(), &node.experience_log)?;
                        let mut means = vec![0.0; model.num_features()];
                        model.predict_into(Time::default(), &mut means);
                        means
                    },
                }),
            },
        })
    }

    /// The visits whose appearances are matched at `time`: all, or with a model those that are at least
    /// as likely then as at any time. (Without a rhythm that is all of them; T-RO 2017 VII-A uses about
    /// 100 of 170 and does not say by which rule.)
    fn visits_into(&self, time: Time, scores: &mut Vec<f64>, out: &mut Vec<u32>) {
        out.clear();
        let Self::Appearances { visits, likely } = self else {
            return;
        };
        let Some(likely) = likely else {
            out.extend_from_slice(visits);
            return;
        };
        scores.clear();
        scores.resize(likely.model.num_features(), 0.0);
        likely.model.score_into(time, scores);
        let judged = visits.iter().zip(scores.iter().zip(&likely.means));
        out.extend(
            judged
                .clone()
                .filter(|(_, (score, mean))| **score >= *mean - SAME_PROBABILITY)
                .map(|(&visit, _)| visit),
        );
        if out.is_empty() {
            // The latest of the most likely: the newest knowledge wins a tie.
            let best = judged.max_by(|a, b| a.1.0.total_cmp(b.1.0));
            out.extend(best.map(|(&visit, _)| visit));
        }
    }
}

impl Verify {
    /// Finds the displacement that most `matches` agree on.
    fn vote(
        &mut self,
        cfg: &LocalizerConfig,
        matches: &[Match],
        map: FeaturesView<'_>,
        live: FeaturesView<'_>,
    ) -> Vote {
        displacements_into(
            matches,
            map.keypoints,
            live.keypoints,
            &mut self.displacements,
        );
        vote_displacement(cfg.vote(), &mut self.vote, &self.displacements)
    }
}
