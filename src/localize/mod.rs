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
//! Cost: with N places, n features each and m live ones, N (F + n log n) to predict, once a time bucket
//! (`forecast.rs`); N n m Hamming distances to match and at most 64 additions a match to weigh, for each
//! image. In a large map a short list takes the place of all N (`candidates.rs`). The experience methods
//! match E appearances a place, E n m distances. [`Localizer::new`] fits and calibrates, which takes from
//! a tenth of a second to a few seconds.
//!
//! Invariants: localising never changes the map; the answer depends on snapshot, configuration and
//! query alone, not on earlier queries or threads (ties go to the lowest node and are counted); with a
//! warmed-up [`Scratch`] and output, nothing is allocated.
//!
//! Each query stands alone; a [`Tracker`] follows a robot from image to image along the map's edges.
//!
//! Not for: metric poses (a displacement in px is all that one image gives).

mod calibration;
mod candidates;
mod config;
mod evidence;
mod forecast;
mod index_cache;
mod localization;

mod sweep;
mod tracking;

use std::sync::Arc;

use rayon::prelude::*;

pub use calibration::{ATTACHMENT, Calibration, Curve, Temper};
pub use config::{Candidates, Evidence, LocalizerConfig, Method, Preset, Score};
pub use index_cache::QueryForm;
pub use localization::{Candidate, Decision, EvidenceMatch, Localization, Reason};
pub use sweep::{Sweep, Tally};
pub use tracking::{EdgeMotion, Motion, MotionConfig, Tracker, Transitions};

use self::calibration::as_evidence;
use self::candidates::{Finder, ShortlistScratch};
use self::evidence::{Expectation, Hits, LogMean};
use self::forecast::{Forecast, Forecasts};
use crate::feature::{Features, FeaturesView};
use crate::map::{AppearanceUse, Node, NodeId, Snapshot};
use crate::matching::{
    Displacement, Match, MatchScratch, Matcher, Vote, VoteScratch, displacements_into,
    vote_displacement,
};
use crate::predict::{Choice, PredictedMap, Selection, Witnesses};
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::Time;
use fremen::visibility::{self, VisibilityConfig, VisibilityModel, Visits};

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
    /// Shared with the localizers of other generations of the map, where a place is the same in both.
    plans: Vec<Arc<Plan>>,
    calibration: Option<Arc<Calibration>>,
    finder: Finder,
    forecasts: Forecasts,
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
    shortlist: ShortlistScratch,
    /// The places on the short list, and where the features of each end in `ranked`.
    places: Vec<u32>,
    ends: Vec<usize>,
    scores: Vec<f64>,
    posterior: Vec<f64>,
}

/// What verification works in.
#[derive(Clone, Debug, Default)]
struct Verify {
    displacements: Vec<Displacement>,
    vote: VoteScratch,
    hits: Hits,
}

impl Localizer {
    /// Fits the visibility model of every place of `snapshot`, and calibrates what matches are worth on
    /// its past visits (unless [`LocalizerConfig::calibrated`] says no), or takes the calibration that was
    /// attached to the map ([`to_attachment`](Self::to_attachment)) and still fits it. Places are fitted on
    /// the threads of the caller's rayon pool.
    ///
    /// Fails with [`ErrorKind::Config`] if the map has no places, or none of the appearances that the
    /// method needs were kept.
    pub fn new(snapshot: Arc<Snapshot>, cfg: LocalizerConfig) -> Result<Self> {
        let mut localizer = Self::uncalibrated(snapshot, cfg)?;
        if localizer.cfg.calibrated() {
            let attached = Calibration::attached(&localizer.snapshot, &localizer.cfg);
            let known = attached.map_or_else(|| Calibration::learn(&localizer), Ok)?;
            localizer.calibration = Some(Arc::new(known));
        }
        Ok(localizer)
    }

    /// The same on a newer snapshot of its map, for a robot that learns while it localises.
    ///
    /// Only places that have changed are fitted and predicted again, on the threads of the caller's rayon pool;
    /// with places that the snapshots share ([`Arc::ptr_eq`]) nothing is done. What matches are worth and the words that
    /// candidates are found by take many visits to change and are kept.
    ///
    /// Fails as [`new`](Self::new) does.
    pub fn on_newer(&self, snapshot: Arc<Snapshot>) -> Result<Self> {
        let is_same: Vec<bool> = (snapshot.nodes.par_iter().enumerate())
            .map(|(index, node)| {
                let old = self.snapshot.nodes.get(index);
                old.is_some_and(|old| Arc::ptr_eq(old, node) || old == node)
            })
            .collect();
        let plans = (snapshot.nodes.par_iter().zip(&is_same).enumerate())
            .map(|(index, (node, &is_same))| {
                if is_same {
                    Ok(Arc::clone(&self.plans[index]))
                } else {
                    Plan::of(node, &self.cfg).map(Arc::new)
                }
            })
            .collect::<Result<_>>()?;
        let calibration = (self.calibration.as_ref())
            .map(|known| Calibration::on_newer(known, &self.snapshot, &snapshot, &is_same));
        let finder = self.finder.on_newer(&snapshot, &self.cfg);
        let newer = Self {
            calibration,
            ..Self::of_plans(snapshot, self.cfg.clone(), plans, finder)?
        };
        newer.take_over_forecasts(self, &is_same);
        Ok(newer)
    }

    fn uncalibrated(snapshot: Arc<Snapshot>, cfg: LocalizerConfig) -> Result<Self> {
        let plans = (snapshot.nodes.par_iter())
            .map(|node| Plan::of(node, &cfg).map(Arc::new))
            .collect::<Result<_>>()?;
        let finder = Finder::new(&snapshot, &cfg);
        Self::of_plans(snapshot, cfg, plans, finder)
    }

    fn of_plans(
        snapshot: Arc<Snapshot>,
        cfg: LocalizerConfig,
        plans: Vec<Arc<Plan>>,
        finder: Finder,
    ) -> Result<Self> {
        if plans.is_empty() {
            return Err(Error::new(ErrorKind::Config, "the map has no places")
                .with_help("build it from at least one image of each place"));
        }
        let remembers = |plan: &Plan| match plan {
            Plan::Predicted { .. } => true,
            Plan::Appearances { visits, .. } => !visits.is_empty(),
        };
        if !plans.iter().any(|plan| remembers(plan)) {
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
            finder,
            snapshot,
            cfg,
            plans,
            calibration: None,
            forecasts: Forecasts::default(),
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
        self.finder = Finder::new(&self.snapshot, &self.cfg);
        self.forecasts = Forecasts::default();
        self
    }

    /// The same with candidates found in another way; models are not fitted again.
    #[must_use]
    pub fn with_candidates(mut self, candidates: Candidates) -> Self {
        self.cfg = self.cfg.with_candidates(candidates);
        self.finder = Finder::new(&self.snapshot, &self.cfg);
        self.forecasts = Forecasts::default();
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
        match self.plans[node.0 as usize].as_ref() {
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
        let forecast = (self.predicts()).then(|| self.forecast(&mut scratch.predicted, time));
        self.answer(scratch, query, time, forecast.as_deref(), out);
        Ok(())
    }

    /// [`localize`](Self::localize)s many images on the threads of the caller's rayon pool.
    ///
    /// The answers are in the order of the queries, and the same as one by one, for any number of threads.
    /// Images of one time bucket share its prediction, so they need not be sorted. The first query that
    /// does not fit is an error, and then nothing is localised.
    pub fn localize_batch(&self, queries: &[Query<'_>]) -> Result<Vec<Localization>> {
        let times = (queries.iter().map(|query| self.check(query))).collect::<Result<Vec<_>>>()?;
        let mut order: Vec<usize> = (0..queries.len()).collect();
        order.sort_by_key(|&query| times[query]);
        let buckets: Vec<&[usize]> = (order.chunk_by(|&a, &b| times[a] == times[b])).collect();
        let mut answers: Vec<(usize, Localization)> = (buckets.into_par_iter())
            .flat_map(|bucket| {
                let time = times[bucket[0]];
                let forecast = self.predicts().then(|| self.forecast_by_all(time));
                (bucket.into_par_iter()).map_init(Scratch::default, move |scratch, &query| {
                    let mut out = Localization::default();
                    self.answer(
                        scratch,
                        &queries[query],
                        time,
                        forecast.as_deref(),
                        &mut out,
                    );
                    (query, out)
                })
            })
            .collect();
        answers.sort_unstable_by_key(|&(query, _)| query);
        Ok(answers.into_iter().map(|(_, answer)| answer).collect())
    }

    /// Answers a query that fits, at the time to predict for; `forecast` is of that time, where the method
    /// predicts.
    fn answer(
        &self,
        scratch: &mut Scratch,
        query: &Query<'_>,
        time: Time,
        forecast: Option<&Forecast>,
        out: &mut Localization,
    ) {
        let live = query.features.view();
        match forecast {
            Some(forecast) => self.look_for_predicted(scratch, forecast, live, out),
            None => self.look_for_appearances(scratch, time, live, out),
        }
        out.time = query.time;
        self.weigh(scratch, out);
        out.decide(&self.cfg);
    }

    /// Whether places are matched by predicted maps, and not by remembered appearances.
    fn predicts(&self) -> bool {
        self.cfg.method().predicts()
    }

    /// Matches the predicted map of each place, or of each candidate, with the live image.
    fn look_for_predicted(
        &self,
        scratch: &mut Scratch,
        forecast: &Forecast,
        live: FeaturesView<'_>,
        out: &mut Localization,
    ) {
        let Scratch {
            matching,
            verify,
            ranked,
            shortlist,
            places,
            ends,
            ..
        } = scratch;
        let finder = forecast.shortlist(&self.finder);
        if let Some(finder) = finder {
            finder.shortlist_into(shortlist, live.descriptors, candidates::LENGTH, places);
            forecast.gather_into(places, ranked, ends);
        }
        let (all, ends) = match finder {
            Some(_) => (ranked.view(), &ends[..]),
            None => forecast.all_features(),
        };
        out.restart(ends.len());
        out.pairs_compared = (all.len() * live.len()) as u64;
        (self.matcher).parts_into(matching, all, ends, live, |part, matches| {
            let id = finder.map_or(NodeId(part as u32), |_| NodeId(places[part]));
            let candidate = &mut out.ranking[part];
            candidate.restart(id);
            candidate.predict(forecast.ids(id), forecast.probabilities(id));
            let (ranked, expectation) = (forecast.features(id), forecast.expectation(id));
            self.hear(
                candidate,
                verify,
                None,
                (ranked, live),
                matches,
                expectation,
            );
        });
    }

    /// Matches the remembered appearances of each place with the live image.
    fn look_for_appearances(
        &self,
        scratch: &mut Scratch,
        time: Time,
        live: FeaturesView<'_>,
        out: &mut Localization,
    ) {
        out.restart(self.plans.len());
        for (id, candidate) in (0..).map(NodeId).zip(&mut out.ranking) {
            candidate.restart(id);
            let plan = &self.plans[id.0 as usize];
            plan.visits_into(time, &mut scratch.likely, &mut scratch.visits);
            let mut odds = LogMean::default();
            for &visit in &scratch.visits {
                let ranked = self.appearance(id, visit, self.largest_size());
                out.pairs_compared += (ranked.len() * live.len()) as u64;
                let (matching, matches) = (&mut scratch.matching, &mut scratch.matches);
                self.matcher.matches_into(matching, ranked, live, matches);
                let expectation = &mut scratch.expectation;
                self.expect_appearance(expectation, id, visit, ranked.len());
                let (verify, expectation) = (&mut scratch.verify, Some(&*expectation));
                let sides = (ranked, live);
                self.hear(candidate, verify, Some(visit), sides, matches, expectation);
                odds.push(candidate.last_log_odds);
            }
            candidate.settle(self.cfg.score(), odds.value());
        }
    }

    /// Verifies the matches of one predicted map or appearance with the live image, and takes over what
    /// they say.
    fn hear(
        &self,
        candidate: &mut Candidate,
        verify: &mut Verify,
        visit: Option<u32>,
        (ranked, live): (FeaturesView<'_>, FeaturesView<'_>),
        matches: &[Match],
        expectation: Option<&Expectation>,
    ) {
        let vote = verify.vote(&self.cfg, matches, ranked, live);
        let known = self.calibration.as_deref().zip(expectation);
        let log_odds = known.map_or(0.0, |(calibration, expectation)| {
            verify.log_odds(calibration, expectation, matches, &vote)
        });
        let inliers = verify.vote.inliers();
        candidate.hear(&self.cfg, visit, matches, inliers, &vote, log_odds);
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
        // Places that were not worth matching count as the last one that was.
        let least = scratch.scores.iter().copied().fold(f64::INFINITY, f64::min);
        scratch.scores.resize(self.plans.len(), least);
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

    /// The time that is predicted for, if the query fits the map: the middle of its bucket, or the epoch
    /// for methods that do without.
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
            Some(time) => Ok(self.middle_of_bucket(time)),
            None if self.cfg.method().needs_time() => Err(Error::new(
                ErrorKind::Time,
                format!("method `{}` needs the time of the image", self.cfg.method()),
            )
            .with_help("give the time, or use method `static`")),
            None => Ok(Time::default()),
        }
    }

    /// Predicts a part of a place, gathers its features in order and notes what each would say.
    fn predict_part(
        &self,
        scratch: &mut Scratch,
        id: NodeId,
        model: &dyn VisibilityModel,
        witnesses: &Witnesses,
        time: Time,
        selection: Selection,
    ) {
        let predicted = &mut scratch.predicted;
        self.choose(predicted, model, witnesses, time, selection);
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
        predicted: &mut PredictedMap,
        model: &dyn VisibilityModel,
        witnesses: &Witnesses,
        time: Time,
        selection: Selection,
    ) {
        match self.cfg.choice() {
            _ if self.cfg.method() == Method::Fused => {
                predicted.predict_fused(model, time, selection, witnesses);
            }
            Choice::Likeliest => predicted.predict(model, time, selection),
            Choice::Covering => predicted.predict_covering(model, time, selection, witnesses),
        }
    }

    /// Notes what each feature of an appearance would say.
    fn expect_appearance(&self, expectation: &mut Expectation, id: NodeId, visit: u32, len: usize) {
        if let Some(calibration) = &self.calibration {
            calibration.expect_appearance(expectation, id, visit, len);
            expectation.settle(len);
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
    pub(crate) fn largest_size(&self) -> usize {
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
            Method::Static | Method::Fremen | Method::Fused => Self::Predicted {
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
    /// What `matches` say whose displacements were voted on last, with the outcome `vote`.
    fn log_odds(
        &mut self,
        calibration: &Calibration,
        expectation: &Expectation,
        matches: &[Match],
        vote: &Vote,
    ) -> f64 {
        let num_strays = matches.len() - vote.num_inliers as usize;
        let inliers = self.vote.inliers();
        expectation.log_odds(
            calibration,
            &mut self.hits,
            matches,
            inliers,
            vote,
            num_strays,
        )
    }

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
