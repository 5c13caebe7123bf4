//! What would past visits have matched, had they been live?
//!
//! Past visits are held out and matched as if they were live. What is held out is a whole *run* of
//! the robot at once, at every place: an image of the field comes at a time at which no place was
//! seen yet, so a place must not be matched with an image of which it, or the place next to it,
//! remembers the same minute. Places are predicted by models that were fitted without the run, and
//! features born in it do not take part, since a birth is no evidence.
//!
//! In a map of a single run nothing can be held out. Its images are matched with the places that
//! they do not show, which says what wrong places look like; what the right one looks like is then
//! taken from what is usual ([`Calibration::uninformed`](super::rates::Calibration::uninformed)).
//!
//! The image of a past visit is its appearance, where that was kept; otherwise it is put together
//! again from the features that the log says were seen then, with the descriptors they were born
//! with.
//!
//! Cost: a few fits of each held-out place's model, and (images x places) matches of up to 600
//! features; both are bounded ([`MAX_PLACES`], [`MAX_TRIALS`]) however large the map is.

use std::sync::Arc;

use rayon::prelude::*;

use super::expectation::strength_score;
use super::rates::SIZES;
use crate::feature::{Features, FeaturesView};
use crate::localize::neighbours::{MAX_REACH, Neighbours, runs};
use crate::localize::plan::{Plan, PlannedMap};
use crate::localize::scratch::Scratch;
use crate::map::{Node, NodeId, Snapshot};
use crate::matching::{Displacement, Match};
use crate::predict::Selection;
use fremen::error::Result;
use fremen::time::Time;
use fremen::visibility::BitRow;

/// Visits of at most so many places are held out, evenly spread over the map.
const MAX_PLACES: usize = 32;
/// With so many runs or fewer, each is taken out by itself; otherwise several in a row, so that
/// what is near in time does not vouch for itself.
const MAX_SINGLE_FOLDS: usize = 16;
const NUM_FOLDS: usize = 8;
/// Visits of a place in one fold that are matched.
const IMAGES_PER_FOLD: usize = 3;
/// Images x places that are matched, about.
const MAX_TRIALS: usize = 4000;
/// Images that are matched: at least, where a map has many places, and at most.
const NUM_IMAGES: std::ops::RangeInclusive<usize> = 16..=125;
/// An image is matched with at most so many other places, evenly spread over the map.
const MAX_OTHERS: usize = 256;
/// Appearances of a place that are matched with one image, at most.
const MAX_APPEARANCES: usize = 6;
/// Position in [`SIZES`] of the number of features that rates are learnt with.
pub(super) const RATE_SIZE: usize = 4;

/// One past visit, matched as if it were live.
pub(super) struct HeldOutVisit {
    pub(super) node: usize,
    /// `None` in a map of one run, of which nothing is held out.
    fold: Option<usize>,
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
    /// So many features are predicted at each of [`SIZES`]: more where a place has few visits.
    pub(super) num_tried: [usize; SIZES.len()],
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
    /// How many links it is away from the image's own place; `None` if it is far.
    pub(super) steps: Option<usize>,
    pub(super) records: Vec<Record>,
}

/// One place without each fold.
struct HeldOutPlace {
    /// Its visits in each fold.
    folds: Vec<BitRow>,
    /// Models of the rest; `None` where the fold has no visit of the place, is not needed, or
    /// leaves nothing.
    plans: Vec<Option<Plan>>,
}

/// The fold of every visit of every place, and their number: 0 in a map of one run.
struct Folds {
    of_visit: Vec<Vec<usize>>,
    count: usize,
}

/// Of `count` things, at most `limit`, evenly spread.
fn spread(count: usize, limit: usize) -> impl Iterator<Item = usize> {
    let taken = count.min(limit);
    (0..taken).map(move |i| (2 * i + 1) * count / (2 * taken))
}

impl Folds {
    fn of(snapshot: &Snapshot) -> Self {
        let runs = runs(snapshot);
        let count = match runs.len() {
            0 | 1 => 0,
            few if few <= MAX_SINGLE_FOLDS => few,
            _ => NUM_FOLDS,
        };
        let mut of_visit: Vec<Vec<usize>> = (snapshot.nodes().iter())
            .map(|node| vec![0; node.visits().len()])
            .collect();
        for (index, run) in runs.iter().enumerate() {
            for stop in run {
                of_visit[stop.node as usize][stop.visit as usize] = index * count / runs.len();
            }
        }
        Self { of_visit, count }
    }

    /// Which visits of a place are in each fold.
    fn masks(&self, node: usize) -> Vec<BitRow> {
        let of_visit = &self.of_visit[node];
        let mut masks = vec![BitRow::zeros(of_visit.len()); self.count];
        if self.count > 0 {
            for (visit, &fold) in of_visit.iter().enumerate() {
                masks[fold].set(visit);
            }
        }
        masks
    }
}

/// Matches past visits with the places of `plans`.
pub(super) fn match_held_out(
    map: &PlannedMap,
    plans: &[Arc<Plan>],
    neighbours: &Neighbours,
) -> Result<(Vec<HeldOutVisit>, Vec<Trial>)> {
    let nodes = map.snapshot.nodes();
    let folds = Folds::of(&map.snapshot);
    let images = held_out_visits(nodes, &folds, map.num_live);
    let spread_others: Vec<usize> = spread(nodes.len(), MAX_OTHERS).collect();
    // What each image is matched with: its own place, those around it, and others.
    let pairs: Vec<Vec<(usize, Option<usize>)>> = (images.iter())
        .map(|image| {
            let around = neighbours.around(NodeId(image.node as u32), MAX_REACH);
            let mut steps: Vec<(usize, Option<usize>)> = (around.into_iter())
                .map(|(node, steps)| (node.0 as usize, Some(steps)))
                .chain(Some((image.node, Some(0))))
                .collect();
            let near: Vec<usize> = steps.iter().map(|(node, _)| *node).collect();
            let far = spread_others.iter().filter(|node| !near.contains(node));
            steps.extend(far.map(|&node| (node, None)));
            steps.sort_unstable();
            steps
        })
        .collect();
    let mut needed = vec![vec![false; folds.count]; nodes.len()];
    for (image, pairs) in images.iter().zip(&pairs) {
        if let Some(fold) = image.fold {
            for &(node, _) in pairs {
                needed[node][fold] = true;
            }
        }
    }
    let places: Vec<HeldOutPlace> = (needed.par_iter().enumerate())
        .map(|(node, needed)| HeldOutPlace::new(map, &plans[node], node, folds.masks(node), needed))
        .collect::<Result<_>>()?;
    let trials = (images.par_iter().zip(&pairs).enumerate())
        .map_init(Scratch::default, |scratch, (index, (image, pairs))| {
            (pairs.iter())
                .filter_map(|&(node, steps)| {
                    let (plan, without) = match image.fold {
                        // Nothing is left of its own place.
                        None if node == image.node => return None,
                        None => (plans[node].as_ref(), None),
                        Some(fold) if places[node].folds[fold].count_ones() == 0 => {
                            (plans[node].as_ref(), None)
                        }
                        Some(fold) => {
                            let place = &places[node];
                            (place.plans[fold].as_ref()?, Some(&place.folds[fold]))
                        }
                    };
                    let records = map.attempt(scratch, image, node, plan, without)?;
                    Some(Trial {
                        visit: index,
                        node,
                        steps,
                        records,
                    })
                })
                .collect::<Vec<_>>()
        })
        .flatten_iter()
        .collect();
    Ok((images, trials))
}

/// The visits that are held out.
fn held_out_visits(nodes: &[Arc<Node>], folds: &Folds, num_live: usize) -> Vec<HeldOutVisit> {
    let mut chosen = Vec::new();
    for node in spread(nodes.len(), MAX_PLACES) {
        for fold in 0..folds.count.max(1) {
            let of_visit = folds.of_visit[node].iter().enumerate();
            let visits: Vec<usize> = (of_visit.filter(|(_, it)| **it == fold))
                .map(|(visit, _)| visit)
                .collect();
            let few = spread(visits.len(), IMAGES_PER_FOLD);
            chosen.extend(few.map(|index| (node, fold, visits[index])));
        }
    }
    let limit = (MAX_TRIALS / nodes.len()).clamp(*NUM_IMAGES.start(), *NUM_IMAGES.end());
    spread(chosen.len(), limit)
        .map(|index| chosen[index])
        .filter_map(|(node, fold, visit)| {
            let mut features = image_of(&nodes[node], visit);
            features.truncate(num_live);
            (!features.is_empty()).then(|| HeldOutVisit {
                node,
                fold: (folds.count > 0).then_some(fold),
                time: nodes[node].visits()[visit].time,
                features,
            })
        })
        .collect()
}

/// What the camera saw at a past visit, as far as the map remembers.
fn image_of(node: &Node, visit: usize) -> Features {
    if let Some(appearance) = &node.visits()[visit].appearance {
        return (**appearance).clone();
    }
    let seen: Vec<u32> = (node.log().seen_row(visit).ones())
        .map(|feature| feature as u32)
        .collect();
    let mut features = Features::new();
    features.gather(node.features(), &seen);
    features
}

impl HeldOutPlace {
    /// Fits the place without each fold that is needed.
    fn new(
        map: &PlannedMap,
        plan: &Plan,
        node: usize,
        folds: Vec<BitRow>,
        needed: &[bool],
    ) -> Result<Self> {
        let place = &map.snapshot.nodes()[node];
        let plans = (folds.iter().zip(needed))
            .map(|(fold, is_needed)| {
                let num_left = fold.len() - fold.count_ones();
                if !is_needed || fold.count_ones() == 0 || num_left == 0 {
                    return Ok(None);
                }
                let mut rest = BitRow::zeros(fold.len());
                (0..fold.len())
                    .filter(|&visit| !fold.get(visit))
                    .for_each(|visit| rest.set(visit));
                plan.without(place, &map.cfg, map.zone.as_ref(), fold, &rest)
                    .map(Some)
            })
            .collect::<Result<_>>()?;
        Ok(Self { folds, plans })
    }
}

impl PlannedMap {
    /// Matches a place with a past visit, leaving out features born in the visits `without`; `None`
    /// if nothing of the place is known then.
    fn attempt(
        &self,
        scratch: &mut Scratch,
        held_out: &HeldOutVisit,
        node: usize,
        plan: &Plan,
        without: Option<&BitRow>,
    ) -> Option<Vec<Record>> {
        let id = NodeId(node as u32);
        let place = self.snapshot.node(id);
        let tried = |num_visits| SIZES.map(|n| self.cfg.num_predicted(n, num_visits));
        let most = SIZES[SIZES.len() - 1];
        let mut records = Vec::new();
        match plan {
            Plan::Predicted { model, references } => {
                // What was born in the held-out visits is left out, so more has to be predicted.
                let selection =
                    Selection::at_least_one(if without.is_some() { 2 * most } else { most });
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
                    without.is_none_or(|fold| !fold.get(place.log().birth(feature as usize)))
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
                scratch.ranked.gather(place.features(), &ids);
                let ranked = std::mem::take(&mut scratch.ranked);
                records.push(Record {
                    hypothesis: 0,
                    features,
                    references: words,
                    num_references: references.num_visits(),
                    similarity: predicted.similarity().to_vec(),
                    num_tried: tried(references.num_visits()),
                    found: self.find(scratch, ranked.view(), held_out, references.num_visits()),
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
                        num_tried: SIZES,
                        found: self.find(scratch, ranked, held_out, usize::MAX),
                    });
                }
                scratch.visits = visits;
            }
        }
        records.retain(|record| !record.features.is_empty());
        (!records.is_empty()).then_some(records)
    }

    /// What matches between a predicted map or appearance and a past visit, at each of [`SIZES`].
    fn find(
        &self,
        scratch: &mut Scratch,
        ranked: FeaturesView<'_>,
        held_out: &HeldOutVisit,
        num_visits: usize,
    ) -> [Found; SIZES.len()] {
        let sizes = SIZES.map(|n| self.cfg.num_predicted(n, num_visits));
        let mut all: [Found; SIZES.len()] = Default::default();
        let live = held_out.features.view();
        let Scratch {
            matching, verifier, ..
        } = scratch;
        (self.matcher).prefixes_into(matching, ranked, live, &sizes, |size, matches| {
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
        let num_features = self.features.len().min(self.num_tried[RATE_SIZE]);
        let num_unmatched = num_features.saturating_sub(found.inliers.len());
        OutlierCounts {
            num_unmatched,
            num_outliers: found.num_outliers().min(num_unmatched),
        }
    }

    /// Whether each of the first features was found, at one of [`SIZES`].
    pub(super) fn found_at(&self, size: usize) -> impl Iterator<Item = bool> + use<> {
        let mut found = vec![false; self.features.len().min(self.num_tried[size])];
        for inlier in &self.found[size].inliers {
            if let Some(found) = found.get_mut(inlier.map as usize) {
                *found = true;
            }
        }
        found.into_iter()
    }
}
