//! What would the answer have been for other n?
//!
//! An evaluation answers every query for many numbers of features n. The features are ranked, so
//! the map for a smaller n is a prefix of the one for a larger n, and one pass over the distances
//! serves all. Appearances do not depend on the method, so what they say of a query is kept for the
//! next localizer. A test holds the scores equal to those of [`Localizer::localize`] for each n.

use super::evidence::LogMean;
use super::localizer::Localizer;
use super::place_scores::PlaceScores;
use super::plan::Plan;
use super::query::Query;
use super::scratch::Scratch;
use crate::feature::FeaturesView;
use crate::map::NodeId;
use crate::matching::{Matcher, Window};
use crate::predict::{ReferenceVisits, Selection};
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::Time;
use fremen::visibility::VisibilityModel;

/// The answers to one query for several n, and what localizers of the same snapshot and matching
/// rules can share about it.
#[derive(Clone, Debug)]
pub struct Sweep {
    sizes: Vec<usize>,
    /// Scores of node and size at `node * sizes.len() + size`.
    scores: Vec<PlaceScores>,
    pairs_compared: Vec<u64>,
    /// For each node and visit, what its appearance says at each size; empty where not yet matched.
    appearances: Vec<Vec<Vec<PlaceScores>>>,
    /// The log odds of a place's appearances, at each size, and those of nothing.
    odds: Vec<[LogMean; 2]>,
}

impl Sweep {
    /// For these numbers of features a place, which must ascend from 1.
    pub fn new(sizes: &[usize]) -> Result<Self> {
        if sizes.is_empty() || sizes[0] == 0 || sizes.windows(2).any(|pair| pair[0] >= pair[1]) {
            return Err(Error::new(
                ErrorKind::Config,
                format!("numbers of features must ascend from 1, not {sizes:?}"),
            ));
        }
        Ok(Self {
            sizes: sizes.to_vec(),
            scores: Vec::new(),
            pairs_compared: Vec::new(),
            appearances: Vec::new(),
            odds: Vec::new(),
        })
    }

    /// Forgets what is known of the last query; to be called before each new one, and when the
    /// snapshot or the matching rules change.
    pub fn restart(&mut self) {
        for visit in self.appearances.iter_mut().flatten() {
            visit.clear();
        }
    }

    /// The numbers of features.
    pub fn sizes(&self) -> &[usize] {
        &self.sizes
    }

    /// What speaks for `node` at the `size`-th number of features, by the last localizer.
    ///
    /// # Panics
    /// If there is no such node or size.
    pub fn scores(&self, node: NodeId, size: usize) -> PlaceScores {
        self.scores[node.0 as usize * self.sizes.len() + size]
    }

    /// Hamming distances that the last localizer needs at each number of features.
    pub fn pairs_compared(&self) -> &[u64] {
        &self.pairs_compared
    }
}

impl Localizer {
    /// What speaks for every place at each of the sweep's numbers of features.
    ///
    /// Errors are those of [`localize_into`](Self::localize_into).
    pub fn sweep(&self, scratch: &mut Scratch, query: &Query<'_>, sweep: &mut Sweep) -> Result<()> {
        let time = self.map.check(query)?;
        let Sweep {
            sizes,
            scores,
            pairs_compared,
            appearances,
            odds,
        } = sweep;
        let largest = sizes.last().copied().unwrap_or_default();
        scores.clear();
        scores.resize(self.map.plans.len() * sizes.len(), PlaceScores::default());
        pairs_compared.clear();
        pairs_compared.resize(sizes.len(), 0);
        appearances.resize_with(self.map.plans.len(), Vec::new);
        let num_live = query.features.len().min(self.map.num_live);
        let mut count_pairs = |sizes: &[usize], num_ranked: usize| {
            for (pairs, &size) in pairs_compared.iter_mut().zip(sizes) {
                *pairs += (size.min(num_ranked) * num_live) as u64;
            }
        };
        let mut grown = Vec::with_capacity(sizes.len());
        for (id, scores) in (0..).map(NodeId).zip(scores.chunks_mut(sizes.len())) {
            match self.map.plans[id.0 as usize].as_ref() {
                Plan::Predicted { model, references } => {
                    let part = Selection::at_least_one(largest);
                    let model = (model.as_ref(), references);
                    self.predict_part(scratch, id, model, time, part);
                    let num_visits = references.num_visits();
                    grown.clear();
                    grown.extend(
                        sizes
                            .iter()
                            .map(|&n| self.cfg().num_predicted(n, num_visits)),
                    );
                    count_pairs(&grown, scratch.ranked.len());
                    let ranked = std::mem::take(&mut scratch.ranked);
                    self.score_into(scratch, ranked.view(), query, &grown, scores);
                    scratch.ranked = ranked;
                }
                plan @ Plan::Appearances { .. } => {
                    plan.visits_into(time, &mut scratch.likely, &mut scratch.visits);
                    let known = &mut appearances[id.0 as usize];
                    known.resize_with(self.snapshot().node(id).visits().len(), Vec::new);
                    let visits = std::mem::take(&mut scratch.visits);
                    odds.clear();
                    odds.resize(sizes.len(), [LogMean::default(); 2]);
                    for &visit in &visits {
                        let ranked = self.map.appearance(id, visit, largest);
                        count_pairs(sizes, ranked.len());
                        let known = &mut known[visit as usize];
                        if known.is_empty() {
                            known.resize(sizes.len(), PlaceScores::default());
                            let expectation = &mut scratch.expectation;
                            self.expect_appearance(expectation, id, visit, ranked.len());
                            self.score_into(scratch, ranked, query, sizes, known);
                        }
                        for ((scores, odds), known) in
                            scores.iter_mut().zip(&mut *odds).zip(known.iter())
                        {
                            scores.count = scores.count.max(known.count);
                            scores.inliers = scores.inliers.max(known.inliers);
                            let [odds, of_nothing] = odds;
                            odds.push(known.log_odds);
                            of_nothing.push(known.log_odds_of_nothing);
                        }
                    }
                    for (scores, [odds, of_nothing]) in scores.iter_mut().zip(&*odds) {
                        scores.log_odds = odds.value();
                        scores.log_odds_of_nothing = of_nothing.value();
                    }
                    scratch.visits = visits;
                }
            }
        }
        Ok(())
    }

    /// How many of the `top` most likely features of a place are found in the live image (T-RO 2017
    /// VII-C, table I), within the displacement of the reference recipe.
    ///
    /// Each is looked for by itself: two that find the same live feature both count, since the
    /// question is whether a predicted feature is visible, not what it says about the place. `None`
    /// for methods that predict no features.
    pub fn reobserved(
        &self,
        scratch: &mut Scratch,
        query: &Query<'_>,
        node: NodeId,
        top: usize,
    ) -> Result<Option<usize>> {
        let time = self.map.check(query)?;
        let Plan::Predicted { model, .. } = self.map.plans[node.0 as usize].as_ref() else {
            return Ok(None);
        };
        let part = Selection::at_least_one(top);
        scratch.predicted.predict(model.as_ref(), time, part);
        let features = self.snapshot().node(node).features();
        scratch
            .ranked
            .gather(features, scratch.predicted.features());
        let (ranked, live) = (scratch.ranked.view(), query.features.view());
        let alone = (self.cfg().matching().to_builder().with_unique(false)).build()?;
        Matcher::new(alone).matches_into(&mut scratch.matching, ranked, live, &mut scratch.matches);
        let window = Window::REFERENCE;
        let found = (scratch.matches.iter()).filter(|found| {
            window.contains(
                &ranked.keypoints[found.map as usize],
                &live.keypoints[found.live as usize],
            )
        });
        scratch.visits.clear();
        scratch.visits.extend(found.map(|found| found.map));
        scratch.visits.sort_unstable();
        scratch.visits.dedup();
        Ok(Some(scratch.visits.len()))
    }

    /// Predicts a part of a place, gathers its features in order and notes what each would say.
    fn predict_part(
        &self,
        scratch: &mut Scratch,
        id: NodeId,
        (model, references): (&dyn VisibilityModel, &ReferenceVisits),
        time: Time,
        selection: Selection,
    ) {
        let Scratch {
            predicted,
            ranked,
            expectation,
            ..
        } = scratch;
        (self.map).choose(predicted, model, references, time, selection);
        ranked.gather(self.snapshot().node(id).features(), predicted.features());
        if let Some(calibration) = &self.calibration {
            expectation.expect_predicted(calibration, id, predicted, references);
        }
    }

    fn score_into(
        &self,
        scratch: &mut Scratch,
        ranked: FeaturesView<'_>,
        query: &Query<'_>,
        sizes: &[usize],
        out: &mut [PlaceScores],
    ) {
        let live = query.features.view().prefix(self.map.num_live);
        let Scratch {
            matching,
            verifier,
            hits,
            expectation,
            ..
        } = scratch;
        (self.map.matcher).prefixes_into(matching, ranked, live, sizes, |size, matches| {
            let verified = verifier.verify(self.cfg().vote(), matches, ranked, live);
            let is_calibrated = self.calibration.is_some();
            if is_calibrated {
                expectation.finalize(sizes[size]);
            }
            out[size] = PlaceScores {
                count: matches.len() as u32,
                inliers: verified.vote.num_inliers,
                log_odds: self.log_odds(hits, Some(expectation), &verified),
                log_odds_of_nothing: if is_calibrated {
                    expectation.of_nothing()
                } else {
                    0.0
                },
            };
        });
    }
}
