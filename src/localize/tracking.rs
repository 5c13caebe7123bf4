//! Where am I, given where I was?
//!
//! A [`Tracker`] is a discrete Bayes filter with two parts: where the robot is if it is on the map,
//! and whether it is. Between two images, the first moves by a [`Motion`] over its states; then both
//! are multiplied by how likely the new image is:
//!
//! ```text
//! moved(s)  = sum over r of belief(r) * P(s | r)
//! belief(s) ~ moved(s) * P(image | l(s)),       P(image | l) ~ posterior(l) / prior(l)
//! odds(off) = moved odds * P(image | off) / sum over s of moved(s) P(image | l(s))
//! ```
//!
//! with the posterior of the single image ([`Localization`], made with a uniform prior over places
//! and [`LocalizerConfig::off_map`]). The answer's posteriors become the beliefs, and the decision
//! is taken anew at the same risk; scores and matches stay those of the image.
//!
//! A robot that seems to be off the map for some images has seldom left it: a season, a crowd or
//! another camera make images unlike the map one after the other. So where it would be is followed
//! on, by what little these images tell the places apart, and most of the robots that come back are
//! there ([`MotionConfig::with_resume`]; with 0 this is the plain filter over places and "off the
//! map").
//!
//! Whatever the motion, a robot may be carried away: with probability [`MotionConfig::kidnap`] an
//! image is taken anywhere. That bounds how sure the past can be, so a few images at another place
//! always win: about `ln((1 - kidnap) N / kidnap)` nats of them.
//!
//! Cost: O(places + edges) an image.
//!
//! Source: Bayesian filtering on a topological map as in Cummins & Newman 2008 (FAB-MAP), section
//! 5; Thrun, Burgard & Fox 2005, chapter 8 (grid localisation and its kidnapped robot).
//!
//! Not for: images faster than the scene or the robot changes. Two images of a robot that stands
//! still share their noise and are counted as two all the same; take one image in a while.

use std::sync::Arc;

use super::config::{LocalizerConfig, Score};
use super::localization::{Decision, Localization};
use super::localizer::Localizer;
use super::motion::{EdgeMotion, Motion, MotionConfig, MotionFields};
use super::neighbours::Neighbours;
use crate::map::NodeId;
use fremen::error::{Error, ErrorKind, Result};

/// A place is plausible if it is so many times as likely as the likeliest: a belief of a
/// ten-thousandth takes an image or two of evidence to become the first.
const LEAST_PLAUSIBLE: f64 = 1e-4;

/// Follows a robot from image to image.
#[derive(Clone)]
pub struct Tracker {
    cfg: MotionConfig,
    motion: Arc<dyn Motion>,
    /// Of each place; nothing before the first image.
    belief: Vec<f64>,
    /// Of each state of the motion, if the robot is on the map: sums to 1.
    along: Vec<f64>,
    moved: Vec<f64>,
    /// Whether `moved` is `along` at the next image.
    is_moved: bool,
    /// Of each state: its share where a place is all that is known.
    uniform: Vec<f64>,
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
            Some(known) if snapshot.edges().is_empty() => {
                EdgeMotion::along(&known.neighbours, snapshot.nodes().len(), &cfg)?
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
        let mut num_states = vec![0_u32; motion.num_places()];
        for state in 0..motion.num_states() {
            num_states[motion.place_of(state)] += 1;
        }
        let share = |state| {
            let of_place = num_states[motion.place_of(state)];
            1.0 / (num_states.len() as f64 * f64::from(of_place))
        };
        let uniform: Vec<f64> = (0..motion.num_states()).map(share).collect();
        Ok(Self {
            cfg: cfg.checked()?,
            belief: Vec::new(),
            along: Vec::new(),
            moved: Vec::new(),
            is_moved: false,
            uniform,
            motion,
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
        self.along.clear();
    }

    /// The places where the next image may be taken, for [`Query::with_prior`](super::Query::with_prior):
    /// those that are at least a ten-thousandth as likely as the likeliest, by the way and by the
    /// images so far. None where that says little: before the first image, for a robot that is
    /// rather off the map, and where it would be more than `most` places.
    pub fn plausible_into(&mut self, most: usize, places: &mut Vec<NodeId>) {
        places.clear();
        if self.along.is_empty() || self.off_map > 0.5 {
            return;
        }
        self.move_along();
        let least = LEAST_PLAUSIBLE * self.moved.iter().copied().fold(0.0, f64::max);
        let likely = (self.moved.iter().enumerate()).filter(|(_, moved)| **moved >= least);
        places.extend(likely.map(|(state, _)| NodeId(self.motion.place_of(state) as u32)));
        places.sort_unstable();
        places.dedup();
        if places.len() > most {
            places.clear();
        }
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
        self.compare(cfg.off_map(), answer);
        if !self.step(cfg.off_map(), answer.off_map) {
            for candidate in &answer.ranking {
                self.belief[candidate.node.0 as usize] = candidate.posterior;
            }
        }
        let beside = |node| self.neighbours.beside(node);
        answer.follow(cfg, beside, &self.belief, self.off_map);
        Ok(())
    }

    /// Takes the posterior of the next image into account: of each place, by node, and of being off
    /// the map, made with a uniform prior over places and `cfg`'s [`LocalizerConfig::off_map`].
    ///
    /// Fails with [`ErrorKind::Shape`] if it is of other places than the motion knows.
    pub fn integrate(
        &mut self,
        cfg: &LocalizerConfig,
        posterior: &[f64],
        off_map: f64,
    ) -> Result<()> {
        let num_places = self.motion.num_places();
        if posterior.len() != num_places {
            return Err(Error::new(
                ErrorKind::Shape,
                format!(
                    "the posterior is of {} places, the motion knows {num_places}",
                    posterior.len()
                ),
            )
            .with_help("make a new tracker when the map has changed"));
        }
        let prior = (1.0 - cfg.off_map()) / num_places.max(1) as f64;
        self.likelihoods.clear();
        (self.likelihoods).extend(posterior.iter().map(|posterior| posterior / prior));
        if !self.step(cfg.off_map(), off_map) {
            self.belief.copy_from_slice(posterior);
        }
        Ok(())
    }

    /// What to believe, if an answer may be wrong with probability `risk`, and the places that hold
    /// the probability for it: see [`Localization::region`]. Unknown before the first image.
    pub fn decide(&self, risk: f64) -> (Decision, Vec<NodeId>) {
        let best =
            (self.belief.iter().enumerate()).max_by(|a, b| a.1.total_cmp(b.1).then(b.0.cmp(&a.0)));
        let Some((best, _)) = best else {
            return (Decision::Unknown, Vec::new());
        };
        let node = NodeId(best as u32);
        let mut region = Vec::new();
        let posterior = |node: NodeId| self.belief[node.0 as usize];
        let beside = self.neighbours.beside(node);
        let decision =
            Decision::by_region(beside, node, posterior, self.off_map, risk, &mut region);
        (decision, region)
    }

    /// Moves the belief and multiplies it by the likelihoods of the image, whose posterior of being
    /// off the map is `off_map`. Where the motion allows nothing that the image does, which is
    /// `false`, the image alone is believed: its posterior of the places is for the caller to set.
    fn step(&mut self, prior_off_map: f64, off_map: f64) -> bool {
        let prior = if self.belief.is_empty() {
            self.moved.clone_from(&self.uniform);
            prior_off_map
        } else {
            self.advance(prior_off_map)
        };
        self.is_moved = false;
        for (state, moved) in self.moved.iter_mut().enumerate() {
            *moved *= self.likelihoods[self.motion.place_of(state)];
        }
        let on_map = (1.0 - prior) * self.moved.iter().sum::<f64>();
        let off = prior * off_map / prior_off_map;
        let total = on_map + off;
        self.belief.clear();
        self.belief.resize(self.motion.num_places(), 0.0);
        self.along.clear();
        if !(on_map > 0.0 && total.is_finite()) {
            self.along.extend_from_slice(&self.uniform);
            self.off_map = off_map;
            return false;
        }
        self.off_map = off / total;
        for (state, moved) in self.moved.iter().enumerate() {
            let share = (1.0 - prior) * moved / on_map;
            self.along.push(share);
            self.belief[self.motion.place_of(state)] += share * on_map / total;
        }
        true
    }

    /// What the image alone says of each place, against its prior. In a large map only a short list
    /// of places is ranked; all others fit at most as badly as the worst of these.
    fn compare(&mut self, off_map: f64, answer: &Localization) {
        let prior = (1.0 - off_map) / self.motion.num_places().max(1) as f64;
        let least = (answer.ranking.iter())
            .map(|candidate| candidate.posterior / prior)
            .fold(1.0, f64::min);
        self.likelihoods.clear();
        self.likelihoods.resize(self.motion.num_places(), least);
        for candidate in &answer.ranking {
            self.likelihoods[candidate.node.0 as usize] = candidate.posterior / prior;
        }
    }

    /// Moves what is believed on the map on to the next image, into `moved`: once for each.
    fn move_along(&mut self) {
        if !self.is_moved {
            self.moved.clear();
            self.moved.resize(self.along.len(), 0.0);
            self.motion.advance(&self.along, &mut self.moved);
            self.is_moved = true;
        }
    }

    /// Moves the belief on to the next image, into `moved`, and gives that of being off the map.
    fn advance(&mut self, prior_off_map: f64) -> f64 {
        let MotionFields {
            kidnap,
            leave,
            enter,
            resume,
            ..
        } = self.cfg.0;
        self.move_along();
        let kept: f64 = self.moved.iter().sum();
        let on_map = 1.0 - self.off_map;
        let entered = enter * self.off_map;
        // Who is on the map goes on along it, as most who come back do; the others are anywhere.
        let on_way = (1.0 - kidnap) * ((1.0 - leave) * kept * on_map + resume * entered);
        let anywhere = (1.0 - kidnap) * (1.0 - resume) * entered + kidnap * (1.0 - prior_off_map);
        let total = on_way + anywhere;
        let of_way = if kept > 0.0 {
            on_way / (kept * total)
        } else {
            0.0
        };
        let of_any = if kept > 0.0 { anywhere / total } else { 1.0 };
        for (moved, uniform) in self.moved.iter_mut().zip(&self.uniform) {
            *moved = of_way * *moved + of_any * uniform;
        }
        (1.0 - total).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::localize::{Candidate, Decision, Transitions};

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

    /// A corridor of places, each with the next, where a robot turns round as it likes.
    fn corridor(num_places: usize, stay: f64) -> Arc<dyn Motion> {
        let cfg = MotionConfig::default().with_stay(stay).with_turn(0.5);
        Arc::new(EdgeMotion::over(num_places, chain(num_places), &cfg).expect("valid"))
    }

    fn chain(num_places: usize) -> impl Iterator<Item = (u32, u32)> {
        (1..num_places as u32).map(|place| (place - 1, place))
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
    fn a_short_list_says_what_the_whole_ranking_says() {
        let motion = || corridor(40, 0.2);
        let mut whole = Tracker::with_motion(motion(), MotionConfig::default()).expect("valid");
        let mut short = whole.clone();
        for at in [9, 10, 11, 12] {
            let mut of_all = answer(&seen(40, at, &[30]));
            let mut of_some = of_all.clone();
            // All others are like place 20.
            of_some
                .ranking
                .retain(|it| [at as u32, 20, 30].contains(&it.node.0));
            whole.update(&cfg(), &mut of_all).expect("fits");
            short.update(&cfg(), &mut of_some).expect("fits");
            assert_eq!(of_some.decision, of_all.decision);
            assert!((whole.off_map() - short.off_map()).abs() < 1e-9);
            for (a, b) in whole.belief().iter().zip(short.belief()) {
                assert!((a - b).abs() < 1e-9, "{whole:?}\n{short:?}");
            }
        }
    }

    #[test]
    fn where_it_may_be_next_is_near_where_it_was() {
        let mut tracker =
            Tracker::with_motion(corridor(40, 0.2), MotionConfig::default()).expect("valid");
        let mut places = vec![NodeId(7)];
        tracker.plausible_into(40, &mut places);
        assert_eq!(places, [], "before the first image");
        for at in [9, 10, 11, 12, 13] {
            let mut answer = answer(&seen(40, at, &[30]));
            tracker.update(&cfg(), &mut answer).expect("fits");
        }
        tracker.plausible_into(20, &mut places);
        assert!(places.is_sorted() && places.len() < 20, "{places:?}");
        for at in 12..=14 {
            assert!(places.contains(&NodeId(at)), "{places:?}");
        }
        tracker.plausible_into(places.len() - 1, &mut places);
        assert_eq!(places, [], "more than wanted");
        let mut nowhere = vec![0.05; 41];
        nowhere[40] = 1.0;
        for _ in 0..6 {
            let mut answer = answer(&nowhere);
            tracker.update(&cfg(), &mut answer).expect("fits");
        }
        tracker.plausible_into(40, &mut places);
        assert_eq!(places, [], "off the map");
    }

    #[test]
    fn looking_ahead_changes_nothing() {
        let follow = |looks: bool| {
            let mut tracker =
                Tracker::with_motion(corridor(40, 0.2), MotionConfig::default()).expect("valid");
            let mut places = Vec::new();
            for (at, seen_at) in [9, 10, 11, 30, 12, 13].into_iter().enumerate() {
                for _ in 0..usize::from(looks) * at {
                    tracker.plausible_into(40, &mut places);
                }
                let mut answer = answer(&seen(40, seen_at, &[30]));
                tracker.update(&cfg(), &mut answer).expect("fits");
                if at == 3 {
                    tracker.plausible_into(40, &mut places);
                    tracker.reset();
                }
            }
            (tracker.belief().to_vec(), tracker.off_map())
        };
        assert_eq!(follow(true), follow(false));
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
        for text in [
            "kidnap = 0.0",
            "stay = 1.5",
            "leave = nan",
            "enter = -1.0",
            "turn = 2.0",
            "resume = -0.1",
        ] {
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
    fn a_direction_tells_more_than_a_place_does() {
        // Ahead and behind look alike; only where the robot came from says which it is.
        let cfg = MotionConfig::default();
        let motion = EdgeMotion::over(9, chain(9), &cfg).expect("valid");
        let mut tracker = Tracker::with_motion(Arc::new(motion), cfg).expect("valid");
        for at in [1, 2, 3, 4] {
            tracker
                .update(&self::cfg(), &mut answer(&seen(9, at, &[])))
                .expect("fits");
        }
        let mut alike = answer(&seen(9, 5, &[3]));
        tracker.update(&self::cfg(), &mut alike).expect("fits");
        assert_eq!(alike.ranking[0].node, NodeId(5));
        assert!(alike.ranking[0].posterior > 0.8, "{tracker:?}");
    }

    #[test]
    fn a_way_is_resumed_after_images_that_show_nothing_of_the_map() {
        let cfg = MotionConfig::default();
        let follow = |cfg: MotionConfig| {
            let motion = EdgeMotion::over(30, chain(30), &cfg).expect("valid");
            let mut tracker = Tracker::with_motion(Arc::new(motion), cfg).expect("valid");
            for at in 0..4 {
                tracker
                    .update(&self::cfg(), &mut answer(&seen(30, at, &[])))
                    .expect("fits");
            }
            for _ in 0..6 {
                let mut covered = vec![0.01; 31];
                covered[30] = 3.0;
                let mut covered = answer(&covered);
                tracker.update(&self::cfg(), &mut covered).expect("fits");
            }
            assert!(tracker.off_map() > 0.9, "{tracker:?}");
            // What comes then is also to be seen at the other end.
            let mut again = answer(&seen(30, 10, &[27]));
            tracker.update(&self::cfg(), &mut again).expect("fits");
            tracker.belief()[10] / tracker.belief()[27]
        };
        assert!(follow(cfg) > 3.0);
        assert!((follow(cfg.with_resume(0.0)) - 1.0).abs() < 0.2);
    }

    #[test]
    fn slow_and_fast_robots_are_followed_alike() {
        // Every image fits a place far away as well, which does not move as a robot does.
        for (images_a_place, places_an_image) in [(4, 1), (1, 1), (1, 2)] {
            let cfg = MotionConfig::default();
            let motion = EdgeMotion::over(60, chain(60), &cfg).expect("valid");
            let mut tracker = Tracker::with_motion(Arc::new(motion), cfg).expect("valid");
            let mut num_right = 0;
            for image in 0..24 {
                let at = 2 + image / images_a_place * places_an_image;
                let like = 53 - 7 * (image % 5);
                let mut seen = answer(&seen(60, at, &[like]));
                tracker.update(&self::cfg(), &mut seen).expect("fits");
                num_right += usize::from(seen.ranking[0].node == NodeId(at as u32));
            }
            assert!(
                num_right >= 20,
                "{images_a_place} {places_an_image}: {num_right}"
            );
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
        let mut by_list = [0.0; 3];
        listed.advance(&belief, &mut by_list);
        // Place 1 is reached by two links, from either side.
        let motion = corridor(3, 0.4);
        let states: Vec<usize> = (0..4).map(|state| motion.place_of(state)).collect();
        let of_state = |&place: &usize| belief[place] / [1.0, 2.0, 1.0][place];
        let mut moved = [0.0; 4];
        motion.advance(&states.iter().map(of_state).collect::<Vec<_>>(), &mut moved);
        let mut by_edges = [0.0; 3];
        for (place, moved) in states.into_iter().zip(moved) {
            by_edges[place] += moved;
        }
        assert!(
            by_list
                .iter()
                .zip(&by_edges)
                .all(|(a, b)| (a - b).abs() < 1e-15)
        );
    }

    #[test]
    fn nothing_is_lost_on_any_graph_and_islands_lead_anywhere() {
        let graphs: [(usize, &[(u32, u32)]); 4] = [
            (1, &[]),
            (4, &[(0, 1)]),
            (5, &[(0, 1), (1, 2), (2, 0), (2, 3), (3, 4), (1, 1)]),
            (6, &[(0, 1), (0, 2), (0, 3), (0, 4), (0, 5), (1, 0)]),
        ];
        for (num_places, ends) in graphs {
            let cfg = MotionConfig::default();
            let motion = EdgeMotion::over(num_places, ends.iter().copied(), &cfg).expect("valid");
            for state in 0..motion.num_states() {
                let mut belief = vec![0.0; motion.num_states()];
                belief[state] = 1.0;
                let mut moved = vec![0.0; motion.num_states()];
                motion.advance(&belief, &mut moved);
                let total: f64 = moved.iter().sum();
                assert!((total - 1.0).abs() < 1e-12, "{num_places} {state}: {total}");
                assert!(motion.place_of(state) < num_places);
            }
        }
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
                .with_kidnap(kidnap).with_leave(leave).with_enter(enter).with_resume(0.0);
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
