//! On which displacement do most matches agree?
//!
//! A camera that passes a place again sees it shifted as a whole, so true matches share a
//! displacement `(dx, dy) = live - map` up to parallax, while false ones scatter. Of all closed
//! windows of `width x height` px in the plane of displacements, [`vote_displacement`] finds one
//! that holds most matches, exactly: no grid, no cells that split a cluster.
//!
//! Method: every window can be moved, without losing a match, until its left and upper edges touch
//! one; so it suffices to slide the left edge over the sorted `dx` while the matches inside are
//! kept sorted by `dy`, and the upper edge over those. `O(m k)` time for `m` matches of which `k`
//! share a window's width; left edges that cannot win are passed over.
//!
//! Invariants: the inliers are all matches within the smallest rectangle around them; adding one
//! constant to all displacements changes no count; among windows of equal count the one whose
//! rectangle's centre has the smallest `|dx| + |dy|` wins, then the lowest `dx`, then the lowest
//! `dy`. (Two different sets of equal, largest count never share a centre: one window would hold
//! both.)
//!
//! Not for: rotation, scale, more than one displacement.

use serde::{Deserialize, Serialize};

use crate::feature::Keypoint;
use fremen::error::{Error, Result};

use super::config::{Window, require};
use super::displacement::Displacement;
use super::matcher::Match;

/// Writes the displacement of every match, in their order.
///
/// # Panics
/// If a match names a keypoint that is not there.
pub fn displacements_into(
    matches: &[Match],
    map: &[Keypoint],
    live: &[Keypoint],
    out: &mut Vec<Displacement>,
) {
    out.clear();
    out.extend(
        matches.iter().map(|found| {
            Displacement::between(&map[found.map as usize], &live[found.live as usize])
        }),
    );
}

/// The window that displacements of one camera movement fit into.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "VoteConfigBuilder", into = "VoteConfigBuilder")]
pub struct VoteConfig(VoteConfigBuilder);

/// Collects the values of a [`VoteConfig`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct VoteConfigBuilder {
    width_px: f64,
    height_px: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    limit: Option<Window>,
}

impl Default for VoteConfigBuilder {
    fn default() -> Self {
        Self {
            width_px: 40.0,
            height_px: 20.0,
            limit: None,
        }
    }
}

impl VoteConfigBuilder {
    /// Width and height of the closed window, px.
    #[must_use]
    pub fn with_window_px(mut self, width_px: f64, height_px: f64) -> Self {
        self.width_px = width_px;
        self.height_px = height_px;
        self
    }

    /// Matches displaced beyond this are never inliers.
    #[must_use]
    pub fn with_limit(mut self, limit: Option<Window>) -> Self {
        self.limit = limit;
        self
    }

    /// The configuration, if width and height are numbers from 0 on; otherwise an
    /// [`ErrorKind::Config`](fremen::ErrorKind::Config) error.
    pub fn build(self) -> Result<VoteConfig> {
        for (name, value) in [("width-px", self.width_px), ("height-px", self.height_px)] {
            require(value >= 0.0, name, value, "a number of pixels from 0 on")?;
        }
        Ok(VoteConfig(self))
    }
}

impl TryFrom<VoteConfigBuilder> for VoteConfig {
    type Error = Error;

    fn try_from(builder: VoteConfigBuilder) -> Result<Self> {
        builder.build()
    }
}

impl From<VoteConfig> for VoteConfigBuilder {
    fn from(cfg: VoteConfig) -> Self {
        cfg.0
    }
}

impl Default for VoteConfig {
    /// 40 x 20 px, no limit.
    fn default() -> Self {
        Self(VoteConfigBuilder::default())
    }
}

impl VoteConfig {
    /// Starts from 40 x 20 px without a limit.
    pub fn builder() -> VoteConfigBuilder {
        VoteConfigBuilder::default()
    }

    /// Width of the closed window, px.
    pub fn width_px(&self) -> f64 {
        self.0.width_px
    }

    /// Height of the closed window, px.
    pub fn height_px(&self) -> f64 {
        self.0.height_px
    }

    /// The limit of displacements.
    pub fn limit(&self) -> Option<Window> {
        self.0.limit
    }
}

/// The displacement that most matches agree on; all zeros where there is no match.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Vote {
    /// Matches in the winning window.
    pub num_inliers: u32,
    /// The mean displacement of the inliers.
    pub mean: Displacement,
    /// Their median `dx` and median `dy` (mean of the middle two for an even number).
    pub median: Displacement,
    /// Standard deviations of `dx` and `dy` around the mean, with divisor `num_inliers`.
    pub spread: Displacement,
}

/// Memory that a vote works in, and its inliers.
#[derive(Clone, Debug, Default)]
pub struct VoteScratch {
    /// Displacements within the limit, by (`dx`, `dy`, index).
    points: Vec<Point>,
    /// (`dy`, index into `points`) of those under the sliding window's width, ascending.
    column: Vec<(f64, u32)>,
    inliers: Vec<bool>,
    values: Vec<f64>,
}

impl VoteScratch {
    /// For the last vote, whether each match agreed; in the order of its input.
    pub fn inliers(&self) -> &[bool] {
        &self.inliers
    }
}

#[derive(Clone, Copy, Debug)]
struct Point {
    at: Displacement,
    index: u32,
}

/// The smallest rectangle around the inliers.
#[derive(Clone, Copy)]
struct Bounds {
    min: Displacement,
    max: Displacement,
}

impl Bounds {
    fn contains(&self, at: Displacement) -> bool {
        (self.min.dx_px..=self.max.dx_px).contains(&at.dx_px)
            && (self.min.dy_px..=self.max.dy_px).contains(&at.dy_px)
    }

    /// The smaller, the sooner it wins a tie.
    fn rank(&self) -> [f64; 3] {
        let dx_px = f64::midpoint(self.min.dx_px, self.max.dx_px);
        let dy_px = f64::midpoint(self.min.dy_px, self.max.dy_px);
        [dx_px.abs() + dy_px.abs(), dx_px, dy_px]
    }
}

/// Finds the window that most `displacements` fit into; [`VoteScratch::inliers`] then tells which.
///
/// Displacements beyond the limit, or that are no finite numbers, are no inliers of anything.
pub fn vote_displacement(
    cfg: &VoteConfig,
    scratch: &mut VoteScratch,
    displacements: &[Displacement],
) -> Vote {
    vote(cfg, scratch, displacements.iter().copied())
}

/// As [`vote_displacement`], for `displacements[ids[0]]`, `displacements[ids[1]]`, ... only; the
/// inliers are in the order of `ids`. So the displacements of one place can be computed once and
/// voted on for every selection of its features.
///
/// # Panics
/// If an id is not below the number of displacements.
pub fn vote_subset(
    cfg: &VoteConfig,
    scratch: &mut VoteScratch,
    displacements: &[Displacement],
    ids: &[u32],
) -> Vote {
    vote(
        cfg,
        scratch,
        ids.iter().map(|&id| displacements[id as usize]),
    )
}

fn vote(
    cfg: &VoteConfig,
    scratch: &mut VoteScratch,
    displacements: impl Iterator<Item = Displacement> + Clone,
) -> Vote {
    let VoteScratch {
        points,
        column,
        inliers,
        values,
    } = scratch;
    let eligible = |at: &Displacement| {
        at.dx_px.is_finite()
            && at.dy_px.is_finite()
            && cfg
                .limit()
                .is_none_or(|limit| limit.contains_displacement(*at))
    };
    points.clear();
    points.extend(
        displacements
            .clone()
            .zip(0..)
            .filter(|(at, _)| eligible(at))
            .map(|(at, index)| Point { at, index }),
    );
    points.sort_unstable_by(|a, b| {
        (a.at.dx_px.total_cmp(&b.at.dx_px))
            .then(a.at.dy_px.total_cmp(&b.at.dy_px))
            .then(a.index.cmp(&b.index))
    });
    let bounds = fullest_window(cfg, points, column);
    inliers.clear();
    inliers.extend(
        displacements
            .clone()
            .map(|at| bounds.is_some_and(|bounds| bounds.contains(at))),
    );
    let agreeing = displacements
        .zip(inliers.iter())
        .filter_map(|(at, &inlier)| inlier.then_some(at));
    summarise(&agreeing, values)
}

/// The smallest rectangle around the matches of the fullest window.
fn fullest_window(
    cfg: &VoteConfig,
    points: &[Point],
    column: &mut Vec<(f64, u32)>,
) -> Option<Bounds> {
    column.clear();
    let mut fullest: Option<(usize, [f64; 3], Bounds)> = None;
    let mut right = 0;
    for (left, leftmost) in points.iter().enumerate() {
        while right < points.len() && points[right].at.dx_px - leftmost.at.dx_px <= cfg.width_px() {
            let entry = (points[right].at.dy_px, right as u32);
            let position = column.partition_point(|&other| precedes(other, entry));
            column.insert(position, entry);
            right += 1;
        }
        if fullest.is_none_or(|(count, ..)| column.len() >= count) {
            let mut bottom = 0;
            for top in 0..column.len() {
                while bottom < column.len() && column[bottom].0 - column[top].0 <= cfg.height_px() {
                    bottom += 1;
                }
                let count = bottom - top;
                if fullest.is_some_and(|(fullest, ..)| count < fullest) {
                    continue;
                }
                let bounds = bounds_of(points, &column[top..bottom]);
                let rank = bounds.rank();
                if fullest
                    .is_none_or(|(fullest, fullest_rank, _)| count > fullest || rank < fullest_rank)
                {
                    fullest = Some((count, rank, bounds));
                }
            }
        }
        let entry = (leftmost.at.dy_px, left as u32);
        let position = column.partition_point(|&other| precedes(other, entry));
        column.remove(position);
    }
    fullest.map(|(.., bounds)| bounds)
}

fn precedes(a: (f64, u32), b: (f64, u32)) -> bool {
    a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)).is_lt()
}

/// The rectangle around `inside`, which is sorted by `dy`; the index into `points` follows `dx`.
fn bounds_of(points: &[Point], inside: &[(f64, u32)]) -> Bounds {
    let (mut first, mut last) = (u32::MAX, 0);
    for &(_, point) in inside {
        first = first.min(point);
        last = last.max(point);
    }
    Bounds {
        min: Displacement {
            dx_px: points[first as usize].at.dx_px,
            dy_px: inside[0].0,
        },
        max: Displacement {
            dx_px: points[last as usize].at.dx_px,
            dy_px: inside[inside.len() - 1].0,
        },
    }
}

fn summarise(
    agreeing: &(impl Iterator<Item = Displacement> + Clone),
    values: &mut Vec<f64>,
) -> Vote {
    let mut num_inliers = 0;
    let mut axis = |of: fn(Displacement) -> f64| {
        values.clear();
        values.extend(agreeing.clone().map(of));
        num_inliers = values.len() as u32;
        mean_median_spread(values)
    };
    let (mean_dx, median_dx, spread_dx) = axis(|at| at.dx_px);
    let (mean_dy, median_dy, spread_dy) = axis(|at| at.dy_px);
    let displacement = |dx_px, dy_px| Displacement { dx_px, dy_px };
    Vote {
        num_inliers,
        mean: displacement(mean_dx, mean_dy),
        median: displacement(median_dx, median_dy),
        spread: displacement(spread_dx, spread_dy),
    }
}

fn mean_median_spread(values: &mut [f64]) -> (f64, f64, f64) {
    if values.is_empty() {
        return (0.0, 0.0, 0.0);
    }
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / count;
    values.sort_unstable_by(f64::total_cmp);
    let median = f64::midpoint(values[(values.len() - 1) / 2], values[values.len() / 2]);
    (mean, median, variance.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(points: &[(f64, f64)]) -> Vec<Displacement> {
        let displacement = |&(dx_px, dy_px): &(f64, f64)| Displacement { dx_px, dy_px };
        points.iter().map(displacement).collect()
    }

    #[test]
    fn a_cluster_wins_wherever_a_grid_would_cut_it() {
        let displacements = at(&[(300.0, 0.0), (39.0, 19.0), (41.0, 21.0), (45.0, 25.0)]);
        let mut scratch = VoteScratch::default();
        let vote = vote_displacement(&VoteConfig::default(), &mut scratch, &displacements);
        assert_eq!(vote.num_inliers, 3);
        assert_eq!(scratch.inliers(), [false, true, true, true]);
        assert_eq!(vote.median, at(&[(41.0, 21.0)])[0]);
        assert!((vote.mean.dx_px - 125.0 / 3.0).abs() < 1e-12);
        assert!((vote.spread.dx_px - (56.0_f64 / 9.0).sqrt()).abs() < 1e-12);
    }

    #[test]
    fn the_window_is_closed_and_ties_go_to_the_smallest_displacement() {
        let displacements = at(&[(-100.0, 0.0), (-60.0, 20.0), (10.0, 0.0), (50.0, -20.0)]);
        let mut scratch = VoteScratch::default();
        let vote = vote_displacement(&VoteConfig::default(), &mut scratch, &displacements);
        assert_eq!(vote.num_inliers, 2);
        assert_eq!(scratch.inliers(), [false, false, true, true]);
    }

    #[test]
    fn nothing_and_no_numbers_give_no_inliers() {
        let mut scratch = VoteScratch::default();
        let cfg = VoteConfig::default();
        assert_eq!(vote_displacement(&cfg, &mut scratch, &[]), Vote::default());
        let strange = at(&[(f64::NAN, 0.0), (0.0, f64::INFINITY)]);
        assert_eq!(
            vote_displacement(&cfg, &mut scratch, &strange).num_inliers,
            0
        );
        assert_eq!(scratch.inliers(), [false, false]);
    }

    #[test]
    fn the_limit_excludes_and_a_subset_is_its_own_vote() {
        let displacements = at(&[
            (500.0, 0.0),
            (501.0, 1.0),
            (502.0, 1.0),
            (5.0, 0.0),
            (6.0, 1.0),
        ]);
        let mut scratch = VoteScratch::default();
        let limit = Some(Window::new(400.0, 50.0).unwrap());
        let cfg = VoteConfig::builder().with_limit(limit).build().unwrap();
        assert_eq!(
            vote_displacement(&cfg, &mut scratch, &displacements).num_inliers,
            2
        );
        let all = VoteConfig::default();
        assert_eq!(
            vote_displacement(&all, &mut scratch, &displacements).num_inliers,
            3
        );
        let vote = vote_subset(&all, &mut scratch, &displacements, &[4, 0, 3]);
        assert_eq!(vote.num_inliers, 2);
        assert_eq!(scratch.inliers(), [true, false, true]);
    }

    #[test]
    fn negative_sizes_are_refused() {
        assert!(
            VoteConfig::builder()
                .with_window_px(-1.0, 20.0)
                .build()
                .is_err()
        );
        assert!(toml::from_str::<VoteConfig>("height-px = nan").is_err());
        let cfg = VoteConfig::default();
        let text = toml::to_string(&cfg).unwrap();
        assert_eq!(toml::from_str::<VoteConfig>(&text).unwrap(), cfg);
    }
}
