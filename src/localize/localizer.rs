//! How does an image become an answer: predict, match, verify, score, decide?

use std::sync::Arc;

use rayon::prelude::*;

use super::candidates::{Finder, LENGTH};
use super::config::{LocalizerConfig, PlaceSearch, Score};
use super::evidence::{
    self, Calibration, Expectation, Hits, LogMean, PlaceEvidence, PosteriorCalibration, as_evidence,
};
use super::forecast::{Forecast, ForecastSource, Forecasts};
use super::localization::{Decision, Localization};
use super::place_scores::PlaceScores;
use super::plan::{Plan, PlannedMap};
use super::query::Query;
use super::scratch::Scratch;
use super::verify::Verified;
use crate::feature::FeaturesView;
use crate::map::{NodeId, Snapshot};
use crate::predict::Selection;
use fremen::error::Result;
use fremen::time::Time;
use fremen::visibility::{self, VisibilityModel, Visits};

/// Answers "where am I?" from one snapshot; immutable and shared between threads.
#[derive(Debug)]
pub struct Localizer {
    pub(super) map: PlannedMap,
    pub(super) calibration: Option<Arc<Calibration>>,
    pub(super) finder: Finder,
    forecasts: Forecasts,
}

impl Localizer {
    /// Fits the visibility model of every place of `snapshot`, and calibrates what matches are
    /// worth on its past visits (unless [`LocalizerConfig::calibrated`] says no), or takes the
    /// calibration that was attached to the map ([`to_attachment`](Self::to_attachment)) and still
    /// fits it. Places are fitted on the threads of the caller's rayon pool.
    ///
    /// Fails with [`ErrorKind::Config`](fremen::ErrorKind::Config) if the map has no places, or
    /// none of the appearances that the method needs were kept.
    pub fn new(snapshot: Arc<Snapshot>, cfg: LocalizerConfig) -> Result<Self> {
        let map = PlannedMap::new(snapshot, cfg)?;
        let mut calibration = None;
        if map.cfg.calibrated() {
            let attached = evidence::attached(&map.snapshot, &map.cfg);
            let known = attached.map_or_else(|| Calibration::learn(&map), Ok)?;
            calibration = Some(Arc::new(known));
        }
        let finder = Finder::new(&map.snapshot, &map.cfg);
        Ok(Self::from_parts(map, calibration, finder))
    }

    /// Of what was worked out before.
    pub(super) fn from_parts(
        map: PlannedMap,
        calibration: Option<Arc<Calibration>>,
        finder: Finder,
    ) -> Self {
        Self {
            map,
            calibration,
            finder,
            forecasts: Forecasts::default(),
        }
    }

    /// The same on a newer snapshot of its map, for a robot that learns while it localises.
    ///
    /// Only places that have changed are fitted and predicted again, on the threads of the caller's
    /// rayon pool; with places that the snapshots share ([`Arc::ptr_eq`]) nothing is done. What
    /// matches are worth and the words that candidates are found by take many visits to change and
    /// are kept.
    ///
    /// Fails as [`new`](Self::new) does.
    pub fn with_snapshot(&self, snapshot: Arc<Snapshot>) -> Result<Self> {
        let older = &self.map;
        let is_same: Vec<bool> = (snapshot.nodes().par_iter().enumerate())
            .map(|(index, node)| {
                let old = older.snapshot.nodes().get(index);
                old.is_some_and(|old| Arc::ptr_eq(old, node) || old == node)
            })
            .collect();
        let map = older.with_snapshot(snapshot, &is_same)?;
        let calibration = (self.calibration.as_ref()).map(|known| {
            Calibration::with_snapshot(known, &older.snapshot, &map.snapshot, &is_same)
        });
        let finder = self.finder.with_snapshot(&map.snapshot, &map.cfg);
        let newer = Self::from_parts(map, calibration, finder);
        if newer.finder.reads_same_words(&self.finder) {
            let num_places = older.plans.len();
            (newer.forecasts).take_over(newer.source(), &self.forecasts, num_places, &is_same);
        }
        Ok(newer)
    }

    /// What is known of the worth of matches; `None` if the configuration wants no calibration.
    pub fn calibration(&self) -> Option<&Calibration> {
        self.calibration.as_deref()
    }

    /// What to attach to the map under the name [`ATTACHMENT`](super::ATTACHMENT), so that a
    /// localizer of this configuration need not calibrate again; `None` without calibration.
    ///
    /// Fails with [`ErrorKind::Format`](fremen::ErrorKind::Format) if it cannot be written.
    pub fn to_attachment(&self) -> Result<Option<Arc<[u8]>>> {
        (self.calibration.as_deref())
            .map(|known| evidence::to_attachment(known, &self.map.snapshot, &self.map.cfg))
            .transpose()
    }

    /// The same with another part of each place predicted; models are not fitted again.
    #[must_use]
    pub fn with_selection(self, selection: Selection) -> Self {
        self.with_cfg(|cfg| cfg.with_selection(selection))
    }

    /// The same with candidates found in another way; models are not fitted again.
    ///
    /// Fails with [`ErrorKind::Config`](fremen::ErrorKind::Config) if this crate was built without
    /// that way.
    pub fn with_place_search(self, place_search: PlaceSearch) -> Result<Self> {
        self.cfg().clone().with_place_search(place_search).check()?;
        Ok(self.with_cfg(|cfg| cfg.with_place_search(place_search)))
    }

    fn with_cfg(mut self, change: impl FnOnce(LocalizerConfig) -> LocalizerConfig) -> Self {
        self.map.cfg = change(self.map.cfg);
        self.finder = Finder::new(&self.map.snapshot, &self.map.cfg);
        self.forecasts = Forecasts::default();
        self
    }

    /// The map it reads.
    pub fn snapshot(&self) -> &Arc<Snapshot> {
        &self.map.snapshot
    }

    /// The configuration that it works by.
    pub fn cfg(&self) -> &LocalizerConfig {
        &self.map.cfg
    }

    /// A model of a place that knows how sure it is, learnt from all visits
    /// ([`fit_cautious`](visibility::fit_cautious)). It is fitted at each call.
    ///
    /// # Errors
    ///
    /// Those of fitting.
    pub fn cautious_model(&self, node: NodeId) -> Result<Box<dyn VisibilityModel>> {
        let log = self.snapshot().node(node).log();
        visibility::in_zone(self.map.zone.as_ref(), log, |log| {
            visibility::fit_cautious(log, self.cfg().visibility(), Visits::All)
        })
    }

    /// The visibility model of a place; `None` where the method remembers appearances instead.
    pub fn model(&self, node: NodeId) -> Option<&dyn VisibilityModel> {
        match self.map.plans[node.0 as usize].as_ref() {
            Plan::Predicted { model, .. } => Some(model.as_ref()),
            Plan::Appearances { .. } => None,
        }
    }

    /// How many features of an appearance the configured selection takes.
    pub fn largest_size(&self) -> usize {
        self.map.largest_size()
    }

    /// Memory to work in.
    pub fn scratch(&self) -> Scratch {
        Scratch::default()
    }

    /// Predicts all places for the time bucket of `time` beforehand, on the threads of the caller's
    /// rayon pool, so that the first image in that bucket need not wait for it.
    ///
    /// Answers are the same without; the last two buckets are kept. A robot that must not miss a
    /// frame calls [`prefetch_next`](Self::prefetch_next) instead.
    pub fn prefetch(&self, time: Time) {
        if self.predicts() {
            self.forecast_by_all(self.map.middle_of_bucket(time));
        }
    }

    /// Has `pool` predict all places for the bucket after that of `time`, and returns at once.
    ///
    /// To be called with every image: only the first call in a bucket orders anything. A pool of
    /// one thread leaves the other processors to the robot. Answers are the same without; with it,
    /// the first image of a bucket finds its prediction made, if the pool had a bucket's time to
    /// make it.
    pub fn prefetch_next(self: &Arc<Self>, pool: &rayon::ThreadPool, time: Time) {
        if !(self.predicts() && self.cfg().method().needs_time()) {
            return;
        }
        let next = self.cfg().middle_of_next_bucket(time);
        if let Some(next) = next
            && self.forecasts.order(next)
        {
            let localizer = Arc::clone(self);
            pool.spawn(move || {
                localizer.forecast_by_all(next);
            });
        }
    }

    /// Whether a query fits the map, whatever its features: to be called before these are looked
    /// for.
    ///
    /// Fails as [`localize_into`](Self::localize_into) does.
    pub fn check(&self, query: &Query<'_>) -> Result<()> {
        self.map.check(query).map(drop)
    }

    /// [`localize_into`](Self::localize_into) a new [`Localization`].
    pub fn localize(&self, scratch: &mut Scratch, query: &Query<'_>) -> Result<Localization> {
        let mut out = Localization::default();
        self.localize_into(scratch, query, &mut out)?;
        Ok(out)
    }

    /// Ranks the places by how well they explain `query`, and decides.
    ///
    /// Fails with [`ErrorKind::Time`](fremen::ErrorKind::Time) if the method needs a time and the
    /// query has none, and with [`ErrorKind::Shape`](fremen::ErrorKind::Shape) if the query's image
    /// has another size than the map's.
    pub fn localize_into(
        &self,
        scratch: &mut Scratch,
        query: &Query<'_>,
        out: &mut Localization,
    ) -> Result<()> {
        let time = self.map.check(query)?;
        let forecast = self.predict(scratch, time);
        self.answer(scratch, query, time, forecast.as_deref(), out);
        Ok(())
    }

    /// [`localize`](Self::localize)s many images on the threads of the caller's rayon pool.
    ///
    /// The answers are in the order of the queries, and the same as one by one, for any number of
    /// threads. Images of one time bucket share its prediction, so they need not be sorted. The
    /// first query that does not fit is an error, and then nothing is localised.
    pub fn localize_batch(&self, queries: &[Query<'_>]) -> Result<Vec<Localization>> {
        let times =
            (queries.iter().map(|query| self.map.check(query))).collect::<Result<Vec<_>>>()?;
        let mut order: Vec<usize> = (0..queries.len()).collect();
        order.sort_by_key(|&query| times[query]);
        let buckets: Vec<&[usize]> = (order.chunk_by(|&a, &b| times[a] == times[b])).collect();
        let mut answers: Vec<(usize, Localization)> = (buckets.into_par_iter())
            .flat_map(|bucket| {
                let time = times[bucket[0]];
                let forecast = self.predicts().then(|| self.forecast_by_all(time));
                (bucket.into_par_iter()).map_init(Scratch::default, move |scratch, &index| {
                    let (query, forecast) = (&queries[index], forecast.as_deref());
                    let mut out = Localization::default();
                    self.answer(scratch, query, time, forecast, &mut out);
                    (index, out)
                })
            })
            .collect();
        answers.sort_unstable_by_key(|&(query, _)| query);
        Ok(answers.into_iter().map(|(_, answer)| answer).collect())
    }

    /// Answers a query that fits, at the time to predict for; `forecast` is of that time, where the
    /// method predicts.
    fn answer(
        &self,
        scratch: &mut Scratch,
        query: &Query<'_>,
        time: Time,
        forecast: Option<&Forecast>,
        out: &mut Localization,
    ) {
        let live = query.features.view().prefix(self.map.num_live);
        let mut pairs_compared = 0;
        let searches = [Among::These(query.prior), Among::All(query.prior)];
        let are_all_matched = query.prior.is_empty() || self.map.plans.len() <= MIN_MATCHED;
        for among in &searches[usize::from(are_all_matched)..] {
            match forecast {
                Some(forecast) => self.match_predicted(scratch, forecast, live, *among, out),
                None => self.match_appearances(scratch, time, live, *among, out),
            }
            pairs_compared += out.pairs_compared;
            out.pairs_compared = pairs_compared;
            out.time = query.time;
            self.compute_posterior(scratch, out);
            out.decide(self.cfg(), |node| self.beside(node));
            if let Decision::At(_) | Decision::Near(_) = out.decision {
                return;
            }
        }
    }

    /// Predicts all places; `None` where the method remembers appearances instead.
    fn predict(&self, scratch: &mut Scratch, time: Time) -> Option<Arc<Forecast>> {
        let predicted = &mut scratch.predicted;
        (self.predicts()).then(|| self.forecasts.at(self.source(), predicted, time))
    }

    /// Matches the predicted maps with the live image; verifies and scores what matches.
    fn match_predicted(
        &self,
        scratch: &mut Scratch,
        forecast: &Forecast,
        live: FeaturesView<'_>,
        among: Among<'_>,
        out: &mut Localization,
    ) {
        let Scratch {
            matching,
            verifier,
            hits,
            ranked,
            shortlist,
            places,
            ends,
            of_nothing,
            ..
        } = scratch;
        of_nothing.clear();
        let are_some = match (among, forecast.shortlist(&self.finder)) {
            (Among::These(prior), _) => {
                self.list_prior(prior, places);
                true
            }
            (Among::All(prior), Some(finder)) => {
                finder.shortlist_into(shortlist, live, LENGTH, places);
                add_places(prior, places);
                true
            }
            (Among::All(_), None) => false,
        };
        let (all, ends) = if are_some {
            forecast.gather_into(places, ranked, ends);
            (ranked.view(), &ends[..])
        } else {
            forecast.all_features()
        };
        out.restart(ends.len());
        out.pairs_compared = (all.len() * live.len()) as u64;
        (self.map.matcher).parts_into(matching, all, ends, live, |part, matches| {
            let id = NodeId(if are_some { places[part] } else { part as u32 });
            let candidate = &mut out.ranking[part];
            candidate.restart(id);
            of_nothing.push((forecast.expectation(id)).map_or(0.0, Expectation::of_nothing));
            candidate.predict(forecast.ids(id), forecast.probabilities(id));
            let ranked = forecast.features(id);
            let verified = verifier.verify(self.cfg().vote(), matches, ranked, live);
            let log_odds = self.log_odds(hits, forecast.expectation(id), &verified);
            candidate.record(self.cfg(), None, &verified, log_odds);
        });
    }

    /// Matches the remembered appearances with the live image; verifies and scores what matches.
    fn match_appearances(
        &self,
        scratch: &mut Scratch,
        time: Time,
        live: FeaturesView<'_>,
        among: Among<'_>,
        out: &mut Localization,
    ) {
        let Scratch {
            matching,
            matches,
            verifier,
            hits,
            expectation,
            likely,
            visits,
            places,
            of_nothing,
            ..
        } = scratch;
        of_nothing.clear();
        match among {
            Among::These(prior) => self.list_prior(prior, places),
            Among::All(_) => {
                places.clear();
                places.extend(0..self.map.plans.len() as u32);
            }
        }
        out.restart(places.len());
        for (&place, candidate) in places.iter().zip(&mut out.ranking) {
            let id = NodeId(place);
            candidate.restart(id);
            let plan = &self.map.plans[id.0 as usize];
            plan.visits_into(time, likely, visits);
            let [mut odds, mut odds_of_nothing] = [LogMean::default(); 2];
            for &visit in &*visits {
                let ranked = self.map.appearance(id, visit, self.largest_size());
                out.pairs_compared += (ranked.len() * live.len()) as u64;
                (self.map.matcher).matches_into(matching, ranked, live, matches);
                let verified = verifier.verify(self.cfg().vote(), matches, ranked, live);
                self.expect_appearance(expectation, id, visit, ranked.len());
                let log_odds = self.log_odds(hits, Some(expectation), &verified);
                candidate.record(self.cfg(), Some(visit), &verified, log_odds);
                odds.push(log_odds);
                odds_of_nothing.push(expectation.of_nothing());
            }
            of_nothing.push(odds_of_nothing.value());
            candidate.finalize(self.cfg().score(), odds.value());
        }
    }

    /// The places of a prior and those that share an answer with them, each once, and where these
    /// are few others from all over the map.
    fn list_prior(&self, prior: &[NodeId], places: &mut Vec<u32>) {
        places.clear();
        add_places(prior, places);
        for &node in prior {
            places.extend_from_slice(self.beside(node));
        }
        if places.len() < MIN_MATCHED {
            let num_places = self.map.plans.len();
            let num_others = MIN_MATCHED.min(num_places);
            places.extend((0..num_others).map(|it| (it * num_places / num_others) as u32));
        }
        places.sort_unstable();
        places.dedup();
    }

    /// The log odds of a place; 0 without calibration.
    pub(super) fn log_odds(
        &self,
        hits: &mut Hits,
        expectation: Option<&Expectation>,
        verified: &Verified<'_>,
    ) -> f64 {
        let known = self.calibration.as_deref().zip(expectation);
        known.map_or(0.0, |(calibration, expectation)| {
            expectation.log_odds(calibration, hits, verified)
        })
    }

    /// Notes what each feature of an appearance would say.
    pub(super) fn expect_appearance(
        &self,
        expectation: &mut Expectation,
        id: NodeId,
        visit: u32,
        len: usize,
    ) {
        if let Some(calibration) = &self.calibration {
            expectation.expect_appearance(calibration, id, visit, len);
            expectation.finalize(len);
        }
    }

    /// Gives every place its posterior.
    fn compute_posterior(&self, scratch: &mut Scratch, out: &mut Localization) {
        let Some(calibration) = &self.calibration else {
            out.share_scores();
            return;
        };
        let score = self.cfg().score();
        scratch.scores.clear();
        let matched = out.ranking.iter().zip(&scratch.of_nothing);
        (scratch.scores)
            .extend(matched.map(|(it, &of_nothing)| as_evidence(score, it.score, of_nothing)));
        let num_others = self.map.plans.len() - out.ranking.len();
        let calibration = calibration.posterior_calibration(score, self.typical_size(out));
        let (scores, posterior) = (&scratch.scores, &mut scratch.posterior);
        let off_map = self.cfg().off_map();
        out.off_map = calibration.posterior_into(scores, num_others, off_map, posterior);
        let node_at = |at: usize| out.ranking[at].node;
        self.share_near(calibration, scores, posterior, out.ranking.len(), node_at);
        for (candidate, &posterior) in out.ranking.iter_mut().zip(&*posterior) {
            candidate.posterior = posterior;
        }
    }

    /// The posterior of each place, and of being off the map, from what a
    /// [`Sweep`](super::Sweep) says of each place, by node, at `n` features; `None` without
    /// calibration.
    pub fn posterior(
        &self,
        score: Score,
        n: usize,
        scores: &[PlaceScores],
    ) -> Option<(Vec<f64>, f64)> {
        let calibration = self.calibration.as_ref()?.posterior_calibration(score, n);
        let evidence: Vec<PlaceEvidence> = (scores.iter())
            .map(|it| as_evidence(score, it.by(score), it.log_odds_of_nothing))
            .collect();
        let mut posterior = Vec::new();
        let off_map =
            calibration.posterior_into(&evidence, 0, self.cfg().off_map(), &mut posterior);
        let node_at = |at: usize| NodeId(at as u32);
        self.share_near(
            calibration,
            &evidence,
            &mut posterior,
            scores.len(),
            node_at,
        );
        Some((posterior, off_map))
    }

    /// Shares the probability of the best place and of those that look like it out anew; `node_at`
    /// says which place the first `num_ranked` scores are of.
    fn share_near(
        &self,
        posterior_calibration: PosteriorCalibration,
        scores: &[PlaceEvidence],
        posterior: &mut [f64],
        num_ranked: usize,
        node_at: impl Fn(usize) -> NodeId,
    ) {
        let Some(known) = &self.calibration else {
            return;
        };
        let better = |a: usize, b: usize| {
            if scores[b].score > scores[a].score {
                b
            } else {
                a
            }
        };
        let Some(best) = (0..num_ranked).reduce(better) else {
            return;
        };
        let alike = known.neighbours.beside(node_at(best));
        if known.neighbours.reach() == 0 || alike.is_empty() {
            return;
        }
        let is_member = |at: &usize| *at == best || alike.binary_search(&node_at(*at).0).is_ok();
        let members = (0..num_ranked).filter(is_member);
        posterior_calibration.share_near(scores, members, posterior);
    }

    /// What to believe of an image, given the posterior of each place by node: the decision, and
    /// the places that it leaves open.
    ///
    /// An evaluation uses this with [`posterior`](Self::posterior).
    pub fn decide(&self, best: NodeId, posterior: &[f64], off_map: f64) -> (Decision, Vec<NodeId>) {
        let mut region = Vec::new();
        let of = |node: NodeId| posterior[node.0 as usize];
        let decision = Decision::by_region(
            self.beside(best),
            best,
            of,
            off_map,
            self.cfg().risk(),
            &mut region,
        );
        (decision, region)
    }

    /// How many steps one place is away from another, if at most `most`: along the map's edges and
    /// the ways that the robot took when it learnt the map. `None` also without calibration.
    pub fn steps_between(&self, from: NodeId, to: NodeId, most: usize) -> Option<usize> {
        if from == to {
            return Some(0);
        }
        let around = self.calibration.as_ref()?.neighbours.around(from, most);
        let found = around.into_iter().find(|(node, _)| *node == to);
        found.map(|(_, steps)| steps)
    }

    /// The places that share an answer with one.
    fn beside(&self, node: NodeId) -> &[u32] {
        (self.calibration.as_ref()).map_or(&[], |known| known.neighbours.beside(node))
    }

    /// The number of features that the scores are made of: n, or what a threshold leaves on
    /// average.
    fn typical_size(&self, out: &Localization) -> usize {
        match self.cfg().selection() {
            Selection::Top(n) => n.get(),
            Selection::Threshold(_) => {
                let total: usize = out.ranking.iter().map(|it| it.predicted.len()).sum();
                total / out.ranking.len().max(1)
            }
        }
    }

    /// Whether only a short list of the places is matched.
    pub(crate) fn lists_candidates(&self) -> bool {
        !matches!(self.finder, Finder::Exact)
    }

    /// Whether places are matched by predicted maps, and not by remembered appearances.
    fn predicts(&self) -> bool {
        self.cfg().method().predicts()
    }

    fn source(&self) -> ForecastSource<'_> {
        ForecastSource {
            map: &self.map,
            calibration: self.calibration.as_deref(),
            finder: &self.finder,
        }
    }

    fn forecast_by_all(&self, time: Time) -> Arc<Forecast> {
        self.forecasts.at_by_all(self.source(), time)
    }
}

/// Where the robot is searched for.
#[derive(Clone, Copy, Debug)]
enum Among<'a> {
    /// At these places, those next to them that look alike, and a few others to compare with.
    These(&'a [NodeId]),
    /// At all of them; where a short list is made, these are on it.
    All(&'a [NodeId]),
}

/// At least so many places are matched: what an image scores where it was not taken says how much
/// its best score is worth.
const MIN_MATCHED: usize = 64;

/// Puts the places of a prior on a list, each once.
fn add_places(prior: &[NodeId], places: &mut Vec<u32>) {
    if !prior.is_empty() {
        places.extend(prior.iter().map(|node| node.0));
        places.sort_unstable();
        places.dedup();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feature::{Descriptor, Features, Keypoint};
    use crate::map::{AppearanceUse, MapMeta, Node, PlaceKey, SessionId, Visit, VisitId};
    use fremen::visibility::BitRow;

    #[test]
    fn the_next_bucket_is_predicted_once_and_only_where_there_are_buckets() {
        let mut node = Node::new(PlaceKey::new("here").expect("a key"));
        let keypoint = Keypoint {
            x: 1.0,
            y: 2.0,
            size: 3.0,
            response: 4.0,
        };
        let mut born = Features::new();
        born.push(keypoint, Descriptor::default());
        let mut seen = BitRow::zeros(1);
        seen.set(0);
        let visit = Visit {
            id: VisitId::default(),
            session: SessionId::default(),
            time: Time::default(),
            source: String::new(),
            appearance: None,
            appearance_use: AppearanceUse::Recognised,
        };
        (node.push_visit(visit, &born, seen, None, BitRow::zeros(0))).expect("fits");
        let mut snapshot = Snapshot::empty(MapMeta::new(1, "none", "default"));
        snapshot.push_node(node).expect("the first");
        let snapshot = Arc::new(snapshot);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
        let pool = pool.expect("a thread");
        for length_s in [600, 0] {
            let cfg = LocalizerConfig::default()
                .with_calibrated(false)
                .with_time_bucket_s(length_s);
            let localizer = Localizer::new(Arc::clone(&snapshot), cfg).expect("fits");
            let localizer = Arc::new(localizer);
            for s in [10, 11, 599] {
                localizer.prefetch_next(&pool, Time::from_s(s));
            }
            // The one thread does what was ordered before.
            pool.install(|| ());
            let times = localizer.forecasts.times();
            let expected = [Time::from_s(900)];
            assert_eq!(times, expected[..usize::from(length_s > 0)]);
        }
    }
}
