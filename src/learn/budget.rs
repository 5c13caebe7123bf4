//! What may be forgotten, so that a map does not grow for ever?
//!
//! A place that exceeds its [`BudgetConfig`] gives up the least useful of its features, down to
//! three quarters of what it may have, so that this happens once in many visits and a visit costs
//! O(features) on average. No model is fitted for it: that of the place is at hand (`expectation`).
//!
//! *Features* go by expected usefulness over the coming year, never by age: the evidence that a
//! feature is expected to give to a query at this place, in nats,
//!
//! ```text
//! U = mean over t of  p(t) ln(p(t) / q) + (1 - p(t)) ln((1 - p(t)) / (1 - q))
//! p(t) = (n p_model(t) + n0 p_place) / (n + n0)
//! q    = (found at other places + 20 * 0.01) / (other places searched + 20)
//! ```
//!
//! which is what `localize` adds up: p(t) is how likely it is seen here, q how likely something
//! like it is seen at another place. t runs over [`NUM_TIMES`] moments of the year after the last
//! visit. n is how often it could have been seen *after* its birth (a birth is no evidence) and
//! `p_place` the rate of all features of the place, so that one that was born yesterday is neither
//! despised nor taken at its only word. Of a feature younger than the model, `p_model` is its plain
//! rate.
//!
//! *Visits* go by lot, not by age: of those before the newest quarter, the ones with the smallest
//! identities stay. An identity is a hash, so what stays is a uniform sample of the past, whatever
//! its rhythms, and the same one wherever it is drawn. The newest quarter weighs more than its
//! share of time.
//!
//! `Deviation:` the history beyond the horizon is thinned, not folded into sums, because here sums
//! are the larger of the two. The default model needs 15 of 8 bytes a feature, as much as its
//! states at 960 visits, and 120 products of 8 bytes for each group of features of one age. A log
//! serves every model, is merged by identity, and can be judged on held-out days. What the sample
//! costs was measured where far more is known (Brier score of `natural`, `chronotope-eval run
//! door2016 --share 0.005` and so on): a door from 96,480 visits .0680, from 496 of them by lot
//! .0680, from 204 .0720; ten rooms from 120,960 visits .0491, from 622 .0497, from 252 .0504; by
//! the mean alone .0899 and .0713.
//!
//! Bytes are those of features, logs and appearances in memory ([`Node::num_bytes`]). Where they
//! are exceeded, features and visits go in the same proportion; where the whole map exceeds its
//! bytes, at every place.

use super::budget_config::BudgetConfig;
use super::expectation::PlaceModel;
use super::visit::Scratch;
use crate::feature::FeaturesView;
use crate::map::{Node, Snapshot};
use crate::matching::Matcher;
use fremen::error::Result;
use fremen::time::Period;
use fremen::visibility::BitRow;

/// Moments of the coming year at which p(t) is evaluated: a prime, so that they fall on all hours
/// and weekdays.
const NUM_TIMES: i64 = 97;
/// n0: so many visits at the rate of the place are added to those of each feature.
const RATE_PRIOR: f64 = 2.0;
/// So many trials at the usual false rate are added to those of each feature.
const FALSE_PRIOR: f64 = 20.0;
const FALSE_RATE: f64 = 0.01;
/// Features are looked for at so many other places, evenly spread over the map.
const MAX_OTHERS: usize = 16;
/// What is left when a budget was exceeded, as a share of it.
const LEFT_NUMERATOR: usize = 3;
const LEFT_DENOMINATOR: usize = 4;

/// What a place may keep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Room {
    num_features: usize,
    num_visits: usize,
}

impl Room {
    pub(super) fn of(node: &Node) -> Self {
        Self {
            num_features: node.features().len(),
            num_visits: node.visits().len(),
        }
    }

    /// How many features and visits the place may keep; `None` if it is within its budget.
    pub(super) fn within_budget(cfg: &BudgetConfig, node: &Node) -> Option<Self> {
        let left = |number: usize, most: Option<usize>| match most {
            Some(most) if number > most => most / LEFT_DENOMINATOR * LEFT_NUMERATOR,
            _ => number,
        };
        let whole = Self::of(node);
        let mut room = Self {
            num_features: left(whole.num_features, cfg.features_per_place()),
            num_visits: left(whole.num_visits, cfg.visits_per_place()),
        };
        if let Some(most) = cfg.bytes_per_place() {
            room = room.within(whole.scaled(node.num_bytes(), most));
        }
        (room != whole).then_some(room)
    }

    /// In proportion, if `num_bytes` exceed `most`.
    pub(super) fn scaled(self, num_bytes: usize, most: usize) -> Self {
        if num_bytes <= most {
            return self;
        }
        let share = |number: usize| {
            let left = most as u128 * LEFT_NUMERATOR as u128 / LEFT_DENOMINATOR as u128;
            (number as u128 * left / num_bytes.max(1) as u128).max(1) as usize
        };
        Self {
            num_features: share(self.num_features),
            num_visits: share(self.num_visits),
        }
    }

    fn within(self, other: Self) -> Self {
        Self {
            num_features: self.num_features.min(other.num_features),
            num_visits: self.num_visits.min(other.num_visits),
        }
    }
}

/// A place that has forgotten.
pub(super) struct Shrunk {
    pub(super) node: Node,
    /// Which feature each of its features was.
    pub(super) was: Vec<u32>,
    /// Which of the visits stayed.
    pub(super) kept: Vec<bool>,
}

/// The place at `index` with the most useful of its features and a fair sample of its visits.
pub(super) fn shrink(
    model: &PlaceModel,
    matcher: &Matcher,
    scratch: &mut Scratch,
    snapshot: &Snapshot,
    index: usize,
    room: Room,
) -> Result<Shrunk> {
    let node = &*snapshot.nodes()[index];
    let features = if room.num_features < node.features().len() {
        let others = others(snapshot, index);
        let usefulness = usefulness(model, matcher, scratch, node, &others);
        let mut ids: Vec<usize> = (0..usefulness.len()).collect();
        ids.sort_by(|&a, &b| usefulness[b].total_cmp(&usefulness[a]).then(a.cmp(&b)));
        let mut kept = vec![false; ids.len()];
        (ids.iter().take(room.num_features)).for_each(|&id| kept[id] = true);
        kept
    } else {
        vec![true; node.features().len()]
    };
    let kept = sample(node, room.num_visits);
    let (node, was) = node.retained(&kept, &features)?;
    Ok(Shrunk { node, was, kept })
}

/// Which visits stay: the newest quarter of `num_visits`, and of the others those with the smallest
/// identities.
fn sample(node: &Node, num_visits: usize) -> Vec<bool> {
    let all = node.visits().len();
    let num_new = num_visits.div_ceil(LEFT_DENOMINATOR).min(all);
    let mut old: Vec<usize> = (0..all - num_new).collect();
    old.sort_by_key(|&visit| node.visits()[visit].id);
    old.truncate(num_visits.saturating_sub(num_new));
    let mut kept = vec![false; all];
    (old.into_iter().chain(all - num_new..all)).for_each(|visit| kept[visit] = true);
    kept
}

/// The features of some other places, evenly spread over the map.
fn others(snapshot: &Snapshot, own: usize) -> Vec<FeaturesView<'_>> {
    let others: Vec<&Node> = (snapshot.nodes().iter().enumerate())
        .filter(|&(index, node)| index != own && !node.features().is_empty())
        .map(|(_, node)| &**node)
        .collect();
    let num = others.len().min(MAX_OTHERS);
    (0..num)
        .map(|at| others[at * others.len() / num].features().view())
        .collect()
}

/// U of every feature of a place. O(features * (times + features of the others) + what was seen).
fn usefulness(
    model: &PlaceModel,
    matcher: &Matcher,
    scratch: &mut Scratch,
    node: &Node,
    others: &[FeaturesView<'_>],
) -> Vec<f64> {
    let len = node.features().len();
    let mut num_found = vec![0_u32; len];
    for &other in others {
        let matches = &mut scratch.matches;
        matcher.matches_into(
            &mut scratch.matching,
            node.features().view(),
            other,
            matches,
        );
        for found in matches.iter() {
            num_found[found.map as usize] += 1;
        }
    }
    let q: Vec<f64> = (num_found.iter())
        .map(|&found| {
            let tried = others.len() as f64 + FALSE_PRIOR;
            (f64::from(found) + FALSE_PRIOR * FALSE_RATE) / tried
        })
        .collect();
    let tried = Trials::of(node);
    let p_place = tried.rate();
    let shrunk = |id: usize, p: f64| {
        let n = f64::from(tried.num_trials[id]);
        (n * p + RATE_PRIOR * p_place) / (n + RATE_PRIOR)
    };
    // Of a feature that the model does not know yet, the plain rate is all there is.
    let mut p: Vec<f64> = (0..len)
        .map(|id| f64::from(tried.num_seen[id]) / f64::from(tried.num_trials[id].max(1)))
        .collect();
    let last = (node.log().times().iter().max().copied()).unwrap_or_default();
    let mut usefulness = vec![0.0; len];
    for number in 0..NUM_TIMES {
        let step_us = Period::YEAR.as_us() / NUM_TIMES;
        let time = last.plus_us((number + 1) * step_us);
        model.predict_into(time, &mut scratch.p, &mut p);
        for (id, sum) in usefulness.iter_mut().enumerate() {
            *sum += evidence(shrunk(id, p[id]), q[id]) / NUM_TIMES as f64;
        }
    }
    usefulness
}

/// How often each feature could have been seen again after its birth, and was.
struct Trials {
    num_trials: Vec<u32>,
    num_seen: Vec<u32>,
}

impl Trials {
    /// O(visits * features / 64 + what was seen or hidden).
    fn of(node: &Node) -> Self {
        let (log, num_visits) = (node.log(), node.visits().len());
        let after_birth = |id: usize| (num_visits - 1 - log.birth(id)) as u32;
        let mut num_trials: Vec<u32> = (0..node.features().len()).map(after_birth).collect();
        let mut num_seen = vec![0; num_trials.len()];
        for visit in 0..num_visits {
            let known = |id: &usize| log.birth(*id) < visit;
            (log.seen_row(visit).ones().filter(known)).for_each(|id| num_seen[id] += 1);
            let hidden = log.hidden_row(visit).into_iter().flat_map(BitRow::ones);
            hidden.filter(known).for_each(|id| num_trials[id] -= 1);
        }
        Self {
            num_trials,
            num_seen,
        }
    }

    /// How often a feature of the place is seen.
    fn rate(&self) -> f64 {
        let sum = |counts: &[u32]| counts.iter().map(|&count| f64::from(count)).sum::<f64>();
        (sum(&self.num_seen) + 0.5) / (sum(&self.num_trials) + 1.0)
    }
}

/// The expected log odds of "here" against "at another place", nats (a Kullback-Leibler
/// divergence): never negative.
fn evidence(p: f64, q: f64) -> f64 {
    let term = |p: f64, q: f64| if p > 0.0 { p * (p / q).ln() } else { 0.0 };
    term(p, q) + term(1.0 - p, 1.0 - q)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn evidence_is_of_what_is_seen_here_and_not_elsewhere() {
        assert!(evidence(0.2, 0.2).abs() < 1e-12);
        assert!(evidence(0.9, 0.01) > evidence(0.5, 0.01));
        assert!(evidence(0.5, 0.01) > evidence(0.5, 0.3));
        assert!((evidence(0.0, 0.01) + 0.99_f64.ln()).abs() < 1e-12);
        assert!(evidence(1.0, 0.5).is_finite());
    }

    #[test]
    fn budgets_that_hold_nothing_are_refused() {
        let few = BudgetConfig::default().with_features_per_place(3);
        assert!(few.check().is_err());
        assert!(BudgetConfig::default().with_bytes(1000).check().is_err());
        assert!(BudgetConfig::default().check().is_ok());
    }
}
