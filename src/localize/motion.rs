//! Where may the robot be at the next image?
//!
//! A [`Motion`] moves a belief over *states* on to the next image. A state is a place, or more: of
//! [`EdgeMotion`] it is the link that the robot came by, which is a place and a direction, and the
//! pace at which it goes:
//!
//! ```text
//! M(from -> at, at -> to) = turn              where `to` is `from`
//!                           (1 - turn)/(d-1)  along the d - 1 other links of `at`
//! next = stay b + step M b + skip M M b       for each pace (stay, step, skip)
//! ```
//!
//! Robots go on rather than turn round, and take an image wherever they are, so that one sees each
//! place several times and another only every second place. Which pace it is comes out of the
//! images, as the direction does.
//!
//! Cost: O(links) a pace and image.
//!
//! Source: Thrun, Burgard & Fox 2005, chapter 8 (grid localisation); direction and pace as states
//! are those of a semi-Markov walk of second order.

use serde::{Deserialize, Serialize};

use super::neighbours::Neighbours;
use crate::map::{NodeId, Snapshot};
use fremen::error::{Error, ErrorKind, Result};

/// Where may the robot be at the next image?
///
/// Implemented by [`EdgeMotion`], by [`Transitions`] that a user lists, and by whatever else knows
/// how the robot moves (odometry, a plan).
pub trait Motion: Send + Sync {
    /// Moves `belief`, which has one entry for each state and sums to at most 1, into `moved`,
    /// which has as many entries, all 0. What is not handed on has left the map.
    fn advance(&self, belief: &[f64], moved: &mut [f64]);

    /// How many places it knows.
    fn num_places(&self) -> usize;

    /// How many states it tells apart: as many as places, unless it knows more of a robot than
    /// where it is.
    fn num_states(&self) -> usize {
        self.num_places()
    }

    /// The place of a state; every place has one at least.
    fn place_of(&self, state: usize) -> usize {
        state
    }
}

/// How willing a robot is to move, and to vanish.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "MotionFields", into = "MotionFields")]
pub struct MotionConfig(pub(super) MotionFields);

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub(super) struct MotionFields {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) stay: Option<f64>,
    pub(super) turn: f64,
    pub(super) kidnap: f64,
    pub(super) leave: f64,
    pub(super) enter: f64,
    pub(super) resume: f64,
}

impl Default for MotionFields {
    fn default() -> Self {
        Self {
            stay: None,
            turn: 0.02,
            kidnap: 0.01,
            leave: 0.02,
            enter: 0.1,
            resume: 0.9,
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
    /// The probability of still being at a place at the next image, where it is known; the robot is
    /// at the next place otherwise. By default, slow, even and fast paces are told apart by the
    /// images. In [0, 1], as the others are, which is checked where a [`Tracker`](super::Tracker)
    /// or [`EdgeMotion`] is made.
    #[must_use]
    pub fn with_stay(mut self, stay: f64) -> Self {
        self.0.stay = Some(stay);
        self
    }

    /// The probability that a robot which goes to another place turns round. In [0, 1].
    #[must_use]
    pub fn with_turn(mut self, turn: f64) -> Self {
        self.0.turn = turn;
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

    /// What share of the robots that come into the map are where they would be had they gone on
    /// along it: images often show nothing of the map although the robot has not left it. The rest
    /// may be anywhere. In [0, 1].
    #[must_use]
    pub fn with_resume(mut self, resume: f64) -> Self {
        self.0.resume = resume;
        self
    }

    pub(super) fn checked(self) -> Result<Self> {
        share("stay", self.0.stay.unwrap_or(0.0), 0.0)?;
        share("turn", self.0.turn, 0.0)?;
        share("resume", self.0.resume, 0.0)?;
        share("kidnap", self.0.kidnap, f64::MIN_POSITIVE)?;
        share("leave", self.0.leave, 0.0)?;
        share("enter", self.0.enter, 0.0)?;
        Ok(self)
    }

    /// The probability of still being at a place at the next image, where it is known.
    pub fn stay(&self) -> Option<f64> {
        self.0.stay
    }

    /// The probability of turning round.
    pub fn turn(&self) -> f64 {
        self.0.turn
    }

    /// What share comes back where the way would have led.
    pub fn resume(&self) -> f64 {
        self.0.resume
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

/// What of the images a robot takes at the place where it took the last one, and where it goes on by
/// two places at once; it goes to the next place otherwise.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Pace {
    stay: f64,
    skip: f64,
}

/// Slow, as fast as when it learnt the map, and fast: chosen on the routes among the datasets,
/// walked as they are, with every image three times, with every second image and backwards
/// (eval/METHODOLOGY.md).
const PACES: [Pace; 3] = [
    Pace {
        stay: 0.7,
        skip: 0.0,
    },
    Pace {
        stay: 0.1,
        skip: 0.1,
    },
    Pace {
        stay: 0.0,
        skip: 0.8,
    },
];
/// How likely a robot changes its pace between two images.
const PACE_CHANGE: f64 = 0.01;

/// Motion along the edges of a map, either way; where it has none, along the ways that the robot
/// took when it learnt the map: from a place to those that it saw right before and after it. From a
/// place without either, to any place. A robot goes on in its direction and at its pace.
#[derive(Clone, Debug, PartialEq)]
pub struct EdgeMotion {
    num_places: usize,
    turn: f64,
    paces: Vec<Pace>,
    links: Vec<Link>,
    /// Of each place, where its outgoing links begin in `links`; one more at the end.
    first: Vec<usize>,
}

/// A way from a place to the next; a place that has none is linked with itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Link {
    from: u32,
    to: u32,
    /// The same way in the other direction.
    reverse: usize,
}

impl EdgeMotion {
    /// Along the edges of `snapshot`.
    ///
    /// Fails with [`ErrorKind::Config`] where a number of `cfg` is no probability.
    pub fn new(snapshot: &Snapshot, cfg: &MotionConfig) -> Result<Self> {
        if snapshot.edges().is_empty() {
            return Self::along(&Neighbours::of(snapshot), snapshot.nodes().len(), cfg);
        }
        let ends = (snapshot.edges().iter())
            .filter_map(|edge| Some((snapshot.find(&edge.from)?.0, snapshot.find(&edge.to)?.0)));
        Self::over(snapshot.nodes().len(), ends, cfg)
    }

    /// Along the ways that the robot took when it learnt a map of so many places.
    pub(super) fn along(known: &Neighbours, num_places: usize, cfg: &MotionConfig) -> Result<Self> {
        let of = |from: u32| known.links(NodeId(from)).iter().map(move |&to| (from, to));
        Self::over(num_places, (0..num_places as u32).flat_map(of), cfg)
    }

    /// Along these ways, in either direction.
    pub(super) fn over(
        num_places: usize,
        ends: impl Iterator<Item = (u32, u32)>,
        cfg: &MotionConfig,
    ) -> Result<Self> {
        let cfg = cfg.checked()?;
        let mut ends: Vec<(u32, u32)> = ends
            .filter(|(from, to)| from != to)
            .flat_map(|(from, to)| [(from, to), (to, from)])
            .collect();
        let mut is_linked = vec![false; num_places];
        for &(from, _) in &ends {
            is_linked[from as usize] = true;
        }
        let alone = (0..num_places as u32).filter(|&place| !is_linked[place as usize]);
        ends.extend(alone.map(|place| (place, place)));
        ends.sort_unstable();
        ends.dedup();
        let links = (ends.iter())
            .map(|&(from, to)| Link {
                from,
                to,
                // Every way is there in both directions.
                reverse: ends.partition_point(|&link| link < (to, from)),
            })
            .collect();
        let first = (0..=num_places as u32)
            .map(|place| ends.partition_point(|&(from, _)| from < place))
            .collect();
        let paces = match cfg.stay() {
            Some(stay) => vec![Pace { stay, skip: 0.0 }],
            None => PACES.to_vec(),
        };
        Ok(Self {
            num_places,
            turn: cfg.turn(),
            paces,
            links,
            first,
        })
    }

    /// One place further: adds `weight` times the belief over links after that to `moved`.
    fn step(&self, weight: f64, belief: &[f64], moved: &mut [f64]) {
        let mut anywhere = 0.0;
        for place in 0..self.num_places {
            let out = self.first[place]..self.first[place + 1];
            let num_out = out.len();
            // Those who are here came by the reverse of its outgoing links.
            let here: f64 = (self.links[out.clone()].iter())
                .map(|link| belief[link.reverse])
                .sum();
            for at in out {
                let link = self.links[at];
                let back = belief[link.reverse];
                if link.from == link.to {
                    anywhere += here;
                } else if num_out == 1 {
                    moved[at] += weight * here;
                } else {
                    let on = (1.0 - self.turn) / (num_out - 1) as f64;
                    moved[at] += weight * (self.turn * back + on * (here - back));
                }
            }
        }
        if anywhere > 0.0 {
            // To each place by all of its incoming links alike.
            let each = weight * anywhere / self.num_places as f64;
            for place in 0..self.num_places {
                let out = self.first[place]..self.first[place + 1];
                let share = each / out.len() as f64;
                for link in &self.links[out] {
                    moved[link.reverse] += share;
                }
            }
        }
    }
}

impl Motion for EdgeMotion {
    fn advance(&self, belief: &[f64], moved: &mut [f64]) {
        let num_links = self.links.len();
        let num_paces = self.paces.len() as f64;
        let mut before = vec![0.0; num_links];
        let mut further = vec![0.0; num_links];
        for (pace, (own, moved)) in
            (self.paces.iter()).zip(belief.chunks(num_links).zip(moved.chunks_mut(num_links)))
        {
            for (link, before) in before.iter_mut().enumerate() {
                let of_paces = belief[link..].iter().step_by(num_links).sum::<f64>();
                *before = (1.0 - PACE_CHANGE) * own[link] + PACE_CHANGE * of_paces / num_paces;
            }
            for (moved, before) in moved.iter_mut().zip(&before) {
                *moved += pace.stay * before;
            }
            self.step(1.0 - pace.stay - pace.skip, &before, moved);
            if pace.skip > 0.0 {
                further.fill(0.0);
                self.step(1.0, &before, &mut further);
                self.step(pace.skip, &further, moved);
            }
        }
    }

    fn num_places(&self) -> usize {
        self.num_places
    }

    fn num_states(&self) -> usize {
        self.paces.len() * self.links.len()
    }

    fn place_of(&self, state: usize) -> usize {
        self.links[state % self.links.len()].to as usize
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
