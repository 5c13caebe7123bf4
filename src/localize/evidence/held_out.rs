//! What would past visits have matched, had they been live?
//!
//! Past visits are held out, one or a run of them at a time, and matched as if they were live:
//! their own place is predicted by a model that was fitted without them, and features born in them
//! do not take part, since a birth is no evidence. By the same procedure every other place is
//! matched with them.
//!
//! The image of a past visit is its appearance, where that was kept; otherwise it is put together
//! again from the features that the log says were seen then, with the descriptors they were born
//! with.
//!
//! Cost: a few fits of each held-out place's model, and (images x places) matches of up to 300
//! features; both are bounded ([`MAX_PLACES`], [`MAX_TRIALS`]) however large the map is.

use std::sync::Arc;

use rayon::prelude::*;

use super::expectation::strength_score;
use super::rates::SIZES;
use crate::feature::{Features, FeaturesView};
use crate::localize::plan::{Plan, PlannedMap};
use crate::localize::scratch::Scratch;
use crate::map::{Node, NodeId};
use crate::matching::{Displacement, Match};
use crate::predict::Selection;
use fremen::error::Result;
use fremen::time::Time;
use fremen::visibility::BitRow;

/// Visits of at most so many places are held out, evenly spread over the map.
const MAX_PLACES: usize = 32;
/// With so many visits or fewer, each is taken out by itself; otherwise runs of them, so that what
/// is near in time does not vouch for itself.
const MAX_SINGLE_FOLDS: usize = 16;
const NUM_RUNS: usize = 8;
/// Visits of each run that are matched.
const IMAGES_PER_RUN: usize = 3;
/// Images x places that are matched, about.
const MAX_TRIALS: usize = 1000;
/// An image is matched with at most so many other places, evenly spread over the map.
const MAX_OTHERS: usize = 256;
/// Appearances of a place that are matched with one image, at most.
const MAX_APPEARANCES: usize = 6;
/// Position in [`SIZES`] of the number of features that rates are learnt with.
pub(super) const RATE_SIZE: usize = 4;

/// One past visit, matched as if it were live.
pub(super) struct HeldOutVisit {
    pub(super) node: usize,
    fold: usize,
    time: Time,
    features: Features,
}

/// One predicted map or appearance of a place, matched with one image.
pub(super) struct Record {
    pub(super) hypothesis: usize,
    /// Index of each feature's trials, and what the model says of it.
    pub(super) features: Vec<(u32, f64)>,
    /// The reference visits that saw each feature; empty for an appearance.
    pub(super) references: Vec<u64>,
    pub(super) num_references: usize,
    /// How much each of them counts; nothing where all count alike.
    pub(super) similarity: Vec<f64>,
    /// At each of [`SIZES`].
    pub(super) found: [Found; SIZES.len()],
}

/// What matched at one number of features.
#[derive(Clone, Default)]
pub(super) struct Found {
    pub(super) num_matches: u32,
    pub(super) inliers: Vec<Match>,
    pub(super) displacement: Displacement,
}

impl Found {
    /// Matches that did not agree with the others.
    pub(super) fn num_outliers(&self) -> usize {
        (self.num_matches as usize).saturating_sub(self.inliers.len())
    }
}

/// Features that were not found, and those among them with an outlier match.
#[derive(Clone, Copy, Default)]
pub(super) struct OutlierCounts {
    num_unmatched: usize,
    num_outliers: usize,
}

impl std::ops::AddAssign for OutlierCounts {
    fn add_assign(&mut self, other: Self) {
        self.num_unmatched += other.num_unmatched;
        self.num_outliers += other.num_outliers;
    }
}

impl OutlierCounts {
    /// Their share, with `prior` more features at the `usual` rate.
    pub(super) fn rate(self, usual: f64, prior: f64) -> f64 {
        (self.num_outliers as f64 + prior * usual) / (self.num_unmatched as f64 + prior)
    }
}

/// A place matched with an image.
pub(super) struct Trial {
    pub(super) visit: usize,
    pub(super) node: usize,
    pub(super) records: Vec<Record>,
}

/// The models of one place without each of its folds.
struct HeldOutPlace {
    node: usize,
    folds: Vec<BitRow>,
    /// `None` where no visit of the fold is matched.
    plans: Vec<Option<Plan>>,
}

/// Of `count` things, at most `limit`, evenly spread.
fn spread(count: usize, limit: usize) -> impl Iterator<Item = usize> {
    let taken = count.min(limit);
    (0..taken).map(move |i| (2 * i + 1) * count / (2 * taken))
}

/// Matches past visits with the places of `plans`.
pub(super) fn match_held_out(
    map: &PlannedMap,
    plans: &[Arc<Plan>],
) -> Result<(Vec<HeldOutVisit>, Vec<Trial>)> {
    let nodes = &map.snapshot.nodes;
    let mut places: Vec<HeldOutPlace> = spread(nodes.len(), MAX_PLACES)
        .map(|node| HeldOutPlace::new(&nodes[node], node))
        .collect();
    let held_out = held_out_visits(nodes, &places);
    places.par_iter_mut().try_for_each(|place| {
        let is_needed = |fold| (held_out.iter()).any(|it| it.node == place.node && it.fold == fold);
        let needed: Vec<bool> = (0..place.folds.len()).map(is_needed).collect();
        place.fit(map, &plans[place.node], &needed)
    })?;
    let others: Vec<usize> = spread(nodes.len(), MAX_OTHERS).collect();
    let trials = (held_out.par_iter().enumerate())
        .map_init(Scratch::default, |scratch, (index, visit)| {
            (plans.iter().enumerate())
                .filter(|(node, _)| visit.node == *node || others.binary_search(node).is_ok())
                .filter_map(|(node, plan)| {
                    let own = places
                        .iter()
                        .find(|place| place.node == visit.node && visit.node == node);
                    let plan = match own {
                        Some(own) => own.plans[visit.fold].as_ref()?,
                        None => plan,
                    };
                    map.attempt(scratch, (index, visit), node, plan, own)
                })
                .collect::<Vec<_>>()
        })
        .flatten_iter()
        .collect();
    Ok((held_out, trials))
}

/// The visits that are held out.
fn held_out_visits(nodes: &[Arc<Node>], places: &[HeldOutPlace]) -> Vec<HeldOutVisit> {
    let mut chosen = Vec::new();
    for place in places {
        for (fold, mask) in place.folds.iter().enumerate() {
            let visits: Vec<usize> = mask.ones().collect();
            let few = spread(visits.len(), IMAGES_PER_RUN);
            chosen.extend(few.map(|index| (place.node, fold, visits[index])));
        }
    }
    let limit = (MAX_TRIALS / nodes.len()).max(MAX_SINGLE_FOLDS);
    spread(chosen.len(), limit)
        .map(|index| chosen[index])
        .filter_map(|(node, fold, visit)| {
            let features = image_of(&nodes[node], visit);
            (!features.is_empty()).then(|| HeldOutVisit {
                node,
                fold,
                time: nodes[node].visits[visit].time,
                features,
            })
        })
        .collect()
}

/// What the camera saw at a past visit, as far as the map remembers.
fn image_of(node: &Node, visit: usize) -> Features {
    if let Some(appearance) = &node.visits[visit].appearance {
        return (**appearance).clone();
    }
    let seen: Vec<u32> = (node.log.seen_row(visit).ones())
        .map(|feature| feature as u32)
        .collect();
    let mut features = Features::new();
    features.gather(&node.features, &seen);
    features
}

impl HeldOutPlace {
    fn new(place: &Node, node: usize) -> Self {
        let num_visits = place.log.num_visits();
        let num_folds = match num_visits {
            0 | 1 => 0,
            few if few <= MAX_SINGLE_FOLDS => few,
            _ => NUM_RUNS,
        };
        let mut folds = vec![BitRow::zeros(num_visits); num_folds];
        if num_folds > 0 {
            for visit in 0..num_visits {
                folds[visit * num_folds / num_visits].set(visit);
            }
        }
        Self {
            node,
            folds,
            plans: Vec::new(),
        }
    }

    /// Fits the place without each fold that is needed.
    fn fit(&mut self, map: &PlannedMap, plan: &Plan, needed: &[bool]) -> Result<()> {
        let place = &map.snapshot.nodes[self.node];
        for (fold, &is_needed) in self.folds.iter().zip(needed) {
            let mut rest = BitRow::zeros(fold.len());
            (0..fold.len())
                .filter(|&visit| !fold.get(visit))
                .for_each(|visit| rest.set(visit));
            self.plans.push(if is_needed {
                Some(plan.without(place, &map.cfg, fold, &rest)?)
            } else {
                None
            });
        }
        Ok(())
    }
}

impl PlannedMap {
    /// Matches a place with a past visit; `None` if nothing of the place is known without that
    /// visit.
    fn attempt(
        &self,
        scratch: &mut Scratch,
        (index, held_out): (usize, &HeldOutVisit),
        node: usize,
        plan: &Plan,
        own: Option<&HeldOutPlace>,
    ) -> Option<Trial> {
        let id = NodeId(node as u32);
        let place = self.snapshot.node(id);
        let most = SIZES[SIZES.len() - 1];
        let mut records = Vec::new();
        match plan {
            Plan::Predicted { model, references } => {
                // What was born in the held-out visits is left out, so more has to be predicted.
                let selection =
                    Selection::at_least_one(if own.is_some() { 2 * most } else { most });
                let predicted = &mut scratch.predicted;
                self.choose(
                    predicted,
                    model.as_ref(),
                    references,
                    held_out.time,
                    selection,
                );
                let predicted = &scratch.predicted;
                let is_known = |feature: u32| {
                    own.is_none_or(|own| {
                        !own.folds[held_out.fold].get(place.log.birth(feature as usize))
                    })
                };
                let ids: Vec<u32> = (predicted.features().iter().copied())
                    .filter(|&feature| is_known(feature))
                    .take(most)
                    .collect();
                let features = (ids.iter())
                    .map(|&id| (id, predicted.scores()[id as usize]))
                    .collect();
                let words = ids
                    .iter()
                    .map(|&id| references.seen()[id as usize])
                    .collect();
                scratch.ranked.gather(&place.features, &ids);
                let ranked = std::mem::take(&mut scratch.ranked);
                records.push(Record {
                    hypothesis: 0,
                    features,
                    references: words,
                    num_references: references.num_visits(),
                    similarity: predicted.similarity().to_vec(),
                    found: self.find(scratch, ranked.view(), held_out),
                });
                scratch.ranked = ranked;
            }
            plan @ Plan::Appearances { .. } => {
                plan.visits_into(held_out.time, &mut scratch.likely, &mut scratch.visits);
                let visits = std::mem::take(&mut scratch.visits);
                for at in spread(visits.len(), MAX_APPEARANCES) {
                    let ranked = self.appearance(id, visits[at], most);
                    records.push(Record {
                        hypothesis: visits[at] as usize,
                        features: (0..ranked.len())
                            .map(|rank| (rank as u32, strength_score(rank)))
                            .collect(),
                        references: Vec::new(),
                        num_references: 0,
                        similarity: Vec::new(),
                        found: self.find(scratch, ranked, held_out),
                    });
                }
                scratch.visits = visits;
            }
        }
        records.retain(|record| !record.features.is_empty());
        (!records.is_empty()).then_some(Trial {
            visit: index,
            node,
            records,
        })
    }

    /// What matches between a predicted map or appearance and a past visit, at each of [`SIZES`].
    fn find(
        &self,
        scratch: &mut Scratch,
        ranked: FeaturesView<'_>,
        held_out: &HeldOutVisit,
    ) -> [Found; SIZES.len()] {
        let mut all: [Found; SIZES.len()] = Default::default();
        let live = held_out.features.view();
        let Scratch {
            matching, verifier, ..
        } = scratch;
        (self.matcher).prefixes_into(matching, ranked, live, &SIZES, |size, matches| {
            let verified = verifier.verify(self.cfg.vote(), matches, ranked, live);
            let inliers = matches.iter().zip(verified.inliers);
            all[size] = Found {
                num_matches: matches.len() as u32,
                inliers: (inliers.filter(|(_, is_inlier)| **is_inlier))
                    .map(|(found, _)| *found)
                    .collect(),
                displacement: verified.vote.median,
            };
        });
        all
    }
}

impl Record {
    /// How many features were not found, and how many of those have an outlier match.
    pub(super) fn outliers(&self) -> OutlierCounts {
        let found = &self.found[RATE_SIZE];
        let num_features = self.features.len().min(SIZES[RATE_SIZE]);
        let num_unmatched = num_features.saturating_sub(found.inliers.len());
        OutlierCounts {
            num_unmatched,
            num_outliers: found.num_outliers().min(num_unmatched),
        }
    }

    /// Whether each of the first features was found, at one of [`SIZES`].
    pub(super) fn found_at(&self, size: usize) -> impl Iterator<Item = bool> + use<> {
        let mut found = vec![false; self.features.len().min(SIZES[size])];
        for inlier in &self.found[size].inliers {
            if let Some(found) = found.get_mut(inlier.map as usize) {
                *found = true;
            }
        }
        found.into_iter()
    }
}
