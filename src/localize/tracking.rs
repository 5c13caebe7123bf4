//! Where am I, given where I was?
//!
//! A [`Tracker`] is a discrete Bayes filter over the places of a map and "off the map". Between two
//! images its belief moves by a [`Motion`]; then each hypothesis is multiplied by how likely the
//! new image is there:
//!
//! ```text
//! moved(l)  = sum over k of belief(k) * P(l | k)
//! belief(l) ~ moved(l) * P(image | l),    P(image | l) ~ posterior(l) / prior(l)
//! ```
//!
//! with the posterior of the single image ([`Localization`], made with a uniform prior over places
//! and [`LocalizerConfig::off_map`]). The answer's posteriors become the beliefs, and the decision
//! is taken anew at the same risk; scores and matches stay those of the image.
//!
//! Whatever the motion, a robot may be carried away: with probability [`MotionConfig::kidnap`] an
//! image is taken anywhere. That bounds how sure the past can be, so a few images at another place
//! always win: about `ln((1 - kidnap) N / kidnap)` nats of them.
//!
//! Cost: O(places + edges) an image, without allocation once warm.
//!
//! Source: Bayesian filtering on a topological map as in Cummins & Newman 2008 (FAB-MAP), section
//! 5; Thrun, Burgard & Fox 2005, chapter 8 (grid localisation and its kidnapped robot).
//!
//! Not for: images faster than the scene or the robot changes. Two images of a robot that stands
//! still share their noise and are counted as two all the same; take one image in a while.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::config::{LocalizerConfig, Score};
use super::localization::Localization;
use super::localizer::Localizer;
use super::neighbours::Neighbours;
use crate::map::{NodeId, Snapshot};
use fremen::error::{Error, ErrorKind, Result};

/// Where may the robot be at the next image?
///
/// Implemented by [`EdgeMotion`], by [`Transitions`] that a user lists, and by whatever else knows
/// how the robot moves (odometry, a plan).
pub trait Motion: Send + Sync {
    /// Moves `belief`, which has one entry for each place and sums to at most 1, into `moved`,
    /// which has as many entries, all 0. What is not handed on has left the map.
    fn advance(&self, belief: &[f64], moved: &mut [f64]);

    /// How many places it knows.
    fn num_places(&self) -> usize;
}

/// How willing a robot is to move, and to vanish.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "MotionFields", into = "MotionFields")]
pub struct MotionConfig(MotionFields);

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
struct MotionFields {
    stay: f64,
    kidnap: f64,
    leave: f64,
    enter: f64,
}

impl Default for MotionFields {
    fn default() -> Self {
        Self {
            stay: 0.5,
            kidnap: 0.01,
            leave: 0.02,
            enter: 0.1,
        }
    }
}

impl From<MotionConfig> for MotionFields {
    fn from(cfg: MotionConfig) -> Self {
        cfg.0
    }
}

impl TryFrom<MotionFields> for MotionConfig {
    type Error = Error;

    fn try_from(fields: MotionFields) -> Result<Self> {
        Self(fields).checked()
    }
}

impl MotionConfig {
    /// The probability of still being at a place at the next image; the rest goes along its edges,
    /// each alike. In [0, 1], as the others are, which is checked where a [`Tracker`] or
    /// [`EdgeMotion`] is made.
    #[must_use]
    pub fn with_stay(mut self, stay: f64) -> Self {
        self.0.stay = stay;
        self
    }

    /// The probability that the next image is taken anywhere. In (0, 1].
    #[must_use]
    pub fn with_kidnap(mut self, kidnap: f64) -> Self {
        self.0.kidnap = kidnap;
        self
    }

    /// The probability of having left the map at the next image. In [0, 1].
    #[must_use]
    pub fn with_leave(mut self, leave: f64) -> Self {
        self.0.leave = leave;
        self
    }

    /// The probability of having come into the map, anywhere, from off the map. In [0, 1].
    #[must_use]
    pub fn with_enter(mut self, enter: f64) -> Self {
        self.0.enter = enter;
        self
    }

    fn checked(self) -> Result<Self> {
        share("stay", self.0.stay, 0.0)?;
        share("kidnap", self.0.kidnap, f64::MIN_POSITIVE)?;
        share("leave", self.0.leave, 0.0)?;
        share("enter", self.0.enter, 0.0)?;
        Ok(self)
    }

    /// The probability of still being at a place at the next image.
    pub fn stay(&self) -> f64 {
        self.0.stay
    }

    /// The probability that the next image is taken anywhere.
    pub fn kidnap(&self) -> f64 {
        self.0.kidnap
    }

    /// The probability of having left the map.
    pub fn leave(&self) -> f64 {
        self.0.leave
    }

    /// The probability of having come into the map.
    pub fn enter(&self) -> f64 {
        self.0.enter
    }
}

fn share(name: &str, value: f64, least: f64) -> Result<()> {
    if (least..=1.0).contains(&value) {
        return Ok(());
    }
    Err(Error::new(
        ErrorKind::Config,
        format!("{name} is a probability, not {value}"),
    )
    .with_help("give a number between 0 and 1; `kidnap` must be above 0"))
}

/// Motion along the edges of a map, either way; where it has none, along the ways that the robot
/// took when it learnt the map: from a place to those that it saw right before and after it. From a
/// place without either, to any place.
#[derive(Clone, Debug, PartialEq)]
pub struct EdgeMotion {
    stay: f64,
    neighbours: Vec<Vec<NodeId>>,
}

impl EdgeMotion {
    /// Along the edges of `snapshot`.
    ///
    /// Fails with [`ErrorKind::Config`] where a number of `cfg` is no probability.
    pub fn new(snapshot: &Snapshot, cfg: &MotionConfig) -> Result<Self> {
        let cfg = cfg.checked()?;
        let mut neighbours = vec![Vec::new(); snapshot.nodes.len()];
        if snapshot.edges.is_empty() {
            return Self::along(&Neighbours::of(snapshot), snapshot.nodes.len(), &cfg);
        }
        let mut ends: Vec<_> = (snapshot.edges.iter())
            .filter_map(|edge| Some((snapshot.find(&edge.from)?, snapshot.find(&edge.to)?)))
            .filter(|(from, to)| from != to)
            .flat_map(|(from, to)| [(from, to), (to, from)])
            .collect();
        ends.sort_unstable();
        ends.dedup();
        for (from, to) in ends {
            neighbours[from.0 as usize].push(to);
        }
        Ok(Self {
            stay: cfg.stay(),
            neighbours,
        })
    }
}

impl EdgeMotion {
    /// Along the ways that the robot took when it learnt a map of so many places.
    fn along(known: &Neighbours, num_places: usize, cfg: &MotionConfig) -> Result<Self> {
        let cfg = cfg.checked()?;
        let of = |node: u32| {
            known
                .links(NodeId(node))
                .iter()
                .map(|&to| NodeId(to))
                .collect()
        };
        Ok(Self {
            stay: cfg.stay(),
            neighbours: (0..num_places as u32).map(of).collect(),
        })
    }
}

impl Motion for EdgeMotion {
    fn advance(&self, belief: &[f64], moved: &mut [f64]) {
        let mut anywhere = 0.0;
        for (place, (neighbours, &belief)) in self.neighbours.iter().zip(belief).enumerate() {
            moved[place] += self.stay * belief;
            let leaving = (1.0 - self.stay) * belief;
            if neighbours.is_empty() {
                anywhere += leaving;
            }
            for &NodeId(to) in neighbours {
                moved[to as usize] += leaving / neighbours.len() as f64;
            }
        }
        let each = anywhere / moved.len().max(1) as f64;
        for moved in moved {
            *moved += each;
        }
    }

    fn num_places(&self) -> usize {
        self.neighbours.len()
    }
}

/// Motion by probabilities that are given for each pair of places.
#[derive(Clone, Debug, PartialEq)]
pub struct Transitions(Vec<Vec<(NodeId, f64)>>);

impl Transitions {
    /// For each place, where the robot is at the next image, with its probability.
    ///
    /// Fails with [`ErrorKind::Config`] where a probability is outside [0, 1], those of a place sum
    /// to more than 1, or a place is not one of them. Less than 1 is allowed: the rest has left the
    /// map.
    pub fn new(rows: Vec<Vec<(NodeId, f64)>>) -> Result<Self> {
        let num_places = rows.len();
        for (from, row) in rows.iter().enumerate() {
            let total: f64 = row.iter().map(|(_, p)| p).sum();
            let is_valid =
                |&(to, p): &(NodeId, f64)| (to.0 as usize) < num_places && (0.0..=1.0).contains(&p);
            if !row.iter().all(is_valid) || total > 1.0 + 1e-9 {
                return Err(Error::new(
                    ErrorKind::Config,
                    format!(
                        "the motion from node {from} is no distribution over {num_places} places: \
                         {row:?}"
                    ),
                )
                .with_help("give each place probabilities that sum to at most 1"));
            }
        }
        Ok(Self(rows))
    }
}

impl Motion for Transitions {
    fn advance(&self, belief: &[f64], moved: &mut [f64]) {
        for (row, &belief) in self.0.iter().zip(belief) {
            for &(NodeId(to), p) in row {
                moved[to as usize] += p * belief;
            }
        }
    }

    fn num_places(&self) -> usize {
        self.0.len()
    }
}

/// Follows a robot from image to image.
#[derive(Clone)]
pub struct Tracker {
    cfg: MotionConfig,
    motion: Arc<dyn Motion>,
    /// Of each place; nothing before the first image.
    belief: Vec<f64>,
    moved: Vec<f64>,
    /// Of each place: how likely the image is there.
    likelihoods: Vec<f64>,
    off_map: f64,
    /// Which places may share an answer.
    neighbours: Neighbours,
}

impl std::fmt::Debug for Tracker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        (f.debug_struct("Tracker"))
            .field("cfg", &self.cfg)
            .field("belief", &self.belief)
            .field("off_map", &self.off_map)
            .finish_non_exhaustive()
    }
}

impl Tracker {
    /// A robot that may be anywhere and moves along the edges of the map of `localizer`
    /// ([`EdgeMotion`]).
    ///
    /// Fails with [`ErrorKind::Config`] where a number of `cfg` is no probability.
    pub fn new(localizer: &Localizer, cfg: MotionConfig) -> Result<Self> {
        let snapshot = localizer.snapshot();
        let motion = match localizer.calibration() {
            // The calibration has found the ways already.
            Some(known) if snapshot.edges.is_empty() => {
                EdgeMotion::along(&known.neighbours, snapshot.nodes.len(), &cfg)?
            }
            _ => EdgeMotion::new(snapshot, &cfg)?,
        };
        let mut tracker = Self::with_motion(Arc::new(motion), cfg)?;
        if let Some(known) = localizer.calibration() {
            tracker.neighbours = known.neighbours.clone();
        }
        Ok(tracker)
    }

    /// A robot that may be anywhere and moves as `motion` says; of `cfg`, everything but `stay`
    /// holds.
    ///
    /// Fails with [`ErrorKind::Config`] where a number of `cfg` is no probability.
    pub fn with_motion(motion: Arc<dyn Motion>, cfg: MotionConfig) -> Result<Self> {
        Ok(Self {
            cfg: cfg.checked()?,
            motion,
            belief: Vec::new(),
            moved: Vec::new(),
            likelihoods: Vec::new(),
            off_map: 0.0,
            neighbours: Neighbours::default(),
        })
    }

    /// What is believed of each place, by node; empty before the first image.
    pub fn belief(&self) -> &[f64] {
        &self.belief
    }

    /// What is believed of being at none of them.
    pub fn off_map(&self) -> f64 {
        self.off_map
    }

    /// Forgets where the robot was.
    pub fn reset(&mut self) {
        self.belief.clear();
    }

    /// Takes the next image's answer into account: its posteriors, decision and reason become those
    /// of the whole way, and the ranking follows them. `cfg` is that of the localizer that gave it.
    ///
    /// Fails with [`ErrorKind::Config`] if the answer is of a localizer without calibrated
    /// likelihoods, and with [`ErrorKind::Shape`] if it ranks other places than the motion knows.
    pub fn update(&mut self, cfg: &LocalizerConfig, answer: &mut Localization) -> Result<()> {
        if cfg.score() != Score::Likelihood {
            return Err(Error::new(
                ErrorKind::Config,
                format!("a robot cannot be followed by the score `{}`", cfg.score()),
            )
            .with_help("use the score `likelihood`, whose posteriors are probabilities"));
        }
        let num_places = self.motion.num_places();
        let unknown = (answer.ranking.iter()).find(|it| it.node.0 as usize >= num_places);
        if let Some(unknown) = unknown {
            return Err(Error::new(
                ErrorKind::Shape,
                format!(
                    "the answer ranks node {}, the motion knows {num_places} places",
                    unknown.node.0
                ),
            )
            .with_help("make a new tracker when the map has changed"));
        }
        let prior = (1.0 - cfg.off_map()) / num_places.max(1) as f64;
        self.compare(cfg.off_map(), answer);
        if self.belief.is_empty() {
            self.moved.clear();
            self.moved.resize(num_places, prior);
            self.off_map = cfg.off_map();
        } else {
            self.advance(cfg.off_map());
        }
        self.off_map *= answer.off_map / cfg.off_map();
        for (moved, likelihood) in self.moved.iter_mut().zip(&self.likelihoods) {
            *moved *= likelihood;
        }
        let total = self.moved.iter().sum::<f64>() + self.off_map;
        self.belief.clear();
        if total > 0.0 && total.is_finite() {
            self.belief
                .extend(self.moved.iter().map(|belief| belief / total));
            self.off_map /= total;
        } else {
            // What the motion allows, the image denies: believe the image.
            self.belief.resize(num_places, 0.0);
            for candidate in &answer.ranking {
                self.belief[candidate.node.0 as usize] = candidate.posterior;
            }
            self.off_map = answer.off_map;
        }
        let beside = |node| self.neighbours.beside(node);
        answer.follow(cfg, beside, &self.belief, self.off_map);
        Ok(())
    }

    /// What the image alone says of each place, against its prior. In a large map only a short list
    /// of places is ranked; all others fit at most as badly as the worst of these.
    fn compare(&mut self, off_map: f64, answer: &Localization) {
        let prior = (1.0 - off_map) / answer.ranking.len().max(1) as f64;
        let least = (answer.ranking.iter())
            .map(|candidate| candidate.posterior / prior)
            .fold(1.0, f64::min);
        self.likelihoods.clear();
        self.likelihoods.resize(self.motion.num_places(), least);
        for candidate in &answer.ranking {
            self.likelihoods[candidate.node.0 as usize] = candidate.posterior / prior;
        }
    }

    /// Moves the belief on to the next image, into `moved`.
    fn advance(&mut self, prior_off_map: f64) {
        let MotionFields {
            kidnap,
            leave,
            enter,
            ..
        } = self.cfg.0;
        let num_places = self.belief.len().max(1) as f64;
        self.moved.clear();
        self.moved.resize(self.belief.len(), 0.0);
        self.motion.advance(&self.belief, &mut self.moved);
        let kept: f64 = self.moved.iter().sum();
        let was_inside: f64 = self.belief.iter().sum();
        let lost = (was_inside - kept).max(0.0);
        let entered = enter * self.off_map / num_places;
        let anywhere = kidnap * (1.0 - prior_off_map) / num_places;
        for moved in &mut self.moved {
            *moved = (1.0 - kidnap) * ((1.0 - leave) * *moved + entered) + anywhere;
        }
        let outside = (1.0 - enter) * self.off_map + leave * kept + lost;
        self.off_map = (1.0 - kidnap) * outside + kidnap * prior_off_map;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::localize::{Candidate, Decision};

    const OFF_MAP: f64 = 0.1;

    fn cfg() -> LocalizerConfig {
        LocalizerConfig::default().with_off_map(OFF_MAP)
    }

    /// The answer to an image by which each place (and, last, off the map) has this likelihood.
    fn answer(likelihoods: &[f64]) -> Localization {
        let num_places = likelihoods.len() - 1;
        let prior = |at: usize| {
            if at == num_places {
                OFF_MAP
            } else {
                (1.0 - OFF_MAP) / num_places as f64
            }
        };
        let total: f64 = (0..=num_places).map(|at| prior(at) * likelihoods[at]).sum();
        let posterior = |at: usize| prior(at) * likelihoods[at] / total;
        Localization {
            ranking: (0..num_places)
                .map(|at| Candidate {
                    node: NodeId(at as u32),
                    posterior: posterior(at),
                    score: likelihoods[at].ln(),
                    ..Candidate::default()
                })
                .collect(),
            off_map: posterior(num_places),
            ..Localization::default()
        }
    }

    /// A corridor of places, each with the next.
    fn corridor(num_places: usize, stay: f64) -> Arc<dyn Motion> {
        let neighbours = (0..num_places)
            .map(|at| {
                let near = [at.checked_sub(1), (at + 1 < num_places).then_some(at + 1)];
                (near.into_iter().flatten())
                    .map(|at| NodeId(at as u32))
                    .collect()
            })
            .collect();
        Arc::new(EdgeMotion { stay, neighbours })
    }

    /// Likelihoods of an image of `at` that looks like `like` as well.
    fn seen(num_places: usize, at: usize, like: &[usize]) -> Vec<f64> {
        let mut likelihoods = vec![0.05; num_places + 1];
        likelihoods[at] = 3.0;
        for &at in like {
            likelihoods[at] = 3.0;
        }
        likelihoods[num_places] = 0.3;
        likelihoods
    }

    #[test]
    fn the_first_image_speaks_for_itself() {
        let mut tracker =
            Tracker::with_motion(corridor(4, 0.5), MotionConfig::default()).expect("valid");
        let alone = answer(&seen(4, 2, &[0]));
        let mut followed = alone.clone();
        tracker.update(&cfg(), &mut followed).expect("fits");
        for candidate in &followed.ranking {
            let before = alone.ranking[candidate.node.0 as usize].posterior;
            assert!((candidate.posterior - before).abs() < 1e-12);
        }
        assert!((followed.off_map - alone.off_map).abs() < 1e-12);
    }

    #[test]
    fn a_way_tells_look_alike_places_apart() {
        // Places 1 and 4 look alike; the robot comes from 0.
        let mut tracker =
            Tracker::with_motion(corridor(6, 0.2), MotionConfig::default()).expect("valid");
        let mut first = answer(&seen(6, 0, &[]));
        tracker.update(&cfg(), &mut first).expect("fits");
        let mut alike = answer(&seen(6, 4, &[1]));
        tracker.update(&cfg(), &mut alike).expect("fits");
        assert_eq!(alike.ranking[0].node, NodeId(1));
        assert!(alike.ranking[0].posterior > 0.8, "{tracker:?}");
    }

    #[test]
    fn a_kidnapped_robot_is_found_again() {
        let mut tracker =
            Tracker::with_motion(corridor(8, 0.2), MotionConfig::default()).expect("valid");
        for at in [0, 1, 2, 2, 1] {
            tracker
                .update(&cfg(), &mut answer(&seen(8, at, &[])))
                .expect("fits");
        }
        assert!(tracker.belief()[1] > 0.9);
        let mut images = 0;
        while tracker.belief()[6] < 0.8 {
            tracker
                .update(&cfg(), &mut answer(&seen(8, 6, &[])))
                .expect("fits");
            images += 1;
            assert!(images < 5, "{tracker:?}");
        }
        assert!(images > 1, "one image should not outweigh a way");
    }

    #[test]
    fn what_is_not_in_the_map_stays_unknown() {
        let mut tracker =
            Tracker::with_motion(corridor(5, 0.5), MotionConfig::default()).expect("valid");
        let nowhere = [0.1, 0.2, 0.1, 0.1, 0.1, 1.0];
        for _ in 0..6 {
            let mut answer = answer(&nowhere);
            tracker.update(&cfg(), &mut answer).expect("fits");
            assert_eq!(answer.decision, Decision::Unknown);
        }
        assert!(tracker.off_map() > 0.9);
    }

    #[test]
    fn other_maps_and_scores_are_refused() {
        let mut tracker =
            Tracker::with_motion(corridor(3, 0.5), MotionConfig::default()).expect("valid");
        let refused = tracker.update(&cfg(), &mut answer(&seen(4, 0, &[])));
        assert_eq!(refused.expect_err("four places").kind(), ErrorKind::Shape);
        let counts = cfg().with_score(crate::localize::Score::Count);
        let refused = tracker.update(&counts, &mut answer(&seen(3, 0, &[])));
        assert_eq!(refused.expect_err("counts").kind(), ErrorKind::Config);
    }

    #[test]
    fn places_that_a_short_list_leaves_out_fit_badly() {
        let mut tracker =
            Tracker::with_motion(corridor(4, 0.5), MotionConfig::default()).expect("valid");
        let mut listed = answer(&[5.0, 0.1, 0.3]);
        tracker.update(&cfg(), &mut listed).expect("fits");
        assert!(tracker.belief()[0] > 0.8, "{tracker:?}");
        assert_eq!(tracker.belief()[2], tracker.belief()[1]);
        assert_eq!(listed.ranking.len(), 2);
    }

    #[test]
    fn bad_numbers_are_refused_by_name() {
        for text in ["kidnap = 0.0", "stay = 1.5", "leave = nan", "enter = -1.0"] {
            let error = toml::from_str::<MotionConfig>(text).expect_err(text);
            let name = text.split(' ').next().expect("a name");
            assert!(error.to_string().contains(name), "{error}");
        }
        for rows in [
            vec![vec![(NodeId(1), 0.5)]],
            vec![vec![(NodeId(0), 0.7), (NodeId(0), 0.7)]],
            vec![vec![(NodeId(0), f64::NAN)]],
        ] {
            assert!(Transitions::new(rows.clone()).is_err(), "{rows:?}");
        }
    }

    #[test]
    fn listed_transitions_are_those_of_the_edges() {
        let rows = vec![
            vec![(NodeId(0), 0.4), (NodeId(1), 0.6)],
            vec![(NodeId(0), 0.3), (NodeId(1), 0.4), (NodeId(2), 0.3)],
            vec![(NodeId(1), 0.6), (NodeId(2), 0.4)],
        ];
        let listed = Transitions::new(rows).expect("valid");
        let belief = [0.2, 0.5, 0.1];
        let (mut a, mut b) = ([0.0; 3], [0.0; 3]);
        listed.advance(&belief, &mut a);
        corridor(3, 0.4).advance(&belief, &mut b);
        assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-15));
    }

    proptest! {
        /// The filter against the sum over all ways through the hypotheses.
        #[test]
        fn beliefs_are_those_of_all_ways(
            images in prop::collection::vec(prop::collection::vec(0.01..5.0_f64, 4), 1..4),
            stay in 0.0..1.0_f64,
            kidnap in 0.001..0.5_f64,
            leave in 0.0..0.5_f64,
            enter in 0.0..1.0_f64,
        ) {
            let motion_cfg = MotionConfig::default()
                .with_stay(stay).with_kidnap(kidnap).with_leave(leave).with_enter(enter);
            let mut tracker = Tracker::with_motion(corridor(3, stay), motion_cfg).expect("valid");
            // Hypotheses 0 to 2 are places, 3 is off the map.
            let prior = |to: usize| if to == 3 { OFF_MAP } else { (1.0 - OFF_MAP) / 3.0 };
            let along = |from: usize, to: usize| match (from, to) {
                (from, to) if from == to => stay,
                (1, _) => (1.0 - stay) / 2.0,
                (_, 1) => 1.0 - stay,
                _ => 0.0,
            };
            let step = |from: usize, to: usize| {
                let by_motion = match (from, to) {
                    (3, 3) => 1.0 - enter,
                    (3, _) => enter / 3.0,
                    (_, 3) => leave,
                    _ => (1.0 - leave) * along(from, to),
                };
                (1.0 - kidnap) * by_motion + kidnap * prior(to)
            };
            let mut weights = [0.0; 4];
            let num_ways = 4_usize.pow(images.len() as u32);
            for way in 0..num_ways {
                let at = |image: usize| way / 4_usize.pow(image as u32) % 4;
                let mut weight = prior(at(0));
                for (image, likelihoods) in images.iter().enumerate() {
                    if image > 0 {
                        weight *= step(at(image - 1), at(image));
                    }
                    weight *= likelihoods[at(image)];
                }
                weights[at(images.len() - 1)] += weight;
            }
            let total: f64 = weights.iter().sum();
            for likelihoods in &images {
                tracker.update(&cfg(), &mut answer(likelihoods)).expect("fits");
            }
            for (place, weight) in weights[..3].iter().enumerate() {
                prop_assert!((tracker.belief()[place] - weight / total).abs() < 1e-9);
            }
            prop_assert!((tracker.off_map() - weights[3] / total).abs() < 1e-9);
        }
    }
}
