//! Where was the robot at this time?
//!
//! A [`Track`] is a row of poses in time, from whichever messages say them. Between two poses the
//! position is interpolated linearly and the heading along the shorter arc; where poses are further
//! apart than [`MAX_GAP_S`], nobody knows.
//!
//! Satellite fixes become metres east and north of an origin (equirectangular, good to a
//! thousandth within 100 km); they have no heading, so the direction of travel is taken
//! for it, and their heights, which drift, are not used.
//! Transforms are chained from the child frame up to the fixed one, each at the time of the
//! transform that changes most recently; where no chain leads there, the error names both frames.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

use chronotope::error::{Error, ErrorKind, Result};

use crate::message::{Fix, Pose, Stamp, Transform};

/// Poses further apart than this say nothing of the time between, s.
pub(crate) const MAX_GAP_S: f64 = 2.0;
/// WGS 84, m.
const EQUATOR_RADIUS_M: f64 = 6_378_137.0;
/// A robot that moved less has not changed its direction of travel, m.
const LEAST_STEP_M: f64 = 0.5;

/// A position in the plane and on it, and the heading there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Placement {
    /// Metres.
    pub(crate) position: [f64; 3],
    /// Anticlockwise from the x axis, in (-π, π]; `None` where nobody knows.
    pub(crate) heading: Option<f64>,
}

/// Poses by time.
#[derive(Clone, Debug, Default)]
pub(crate) struct Track(BTreeMap<Stamp, Placement>);

impl Track {
    pub(crate) fn add(&mut self, stamp: Stamp, pose: &Pose) {
        self.0.insert(
            stamp,
            Placement {
                position: pose.position,
                heading: Some(heading(pose.orientation)),
            },
        );
    }

    /// Of satellite fixes in the order of time, in metres from a latitude and longitude.
    pub(crate) fn of_fixes(fixes: &BTreeMap<Stamp, Fix>, [latitude, longitude]: [f64; 2]) -> Self {
        let mut track = Self::default();
        let scale_east = latitude.to_radians().cos();
        let mut last: Option<[f64; 3]> = None;
        let mut heading = None;
        for (&stamp, fix) in fixes {
            let angle_east = wrapped((fix.longitude - longitude).to_radians());
            let east = angle_east * EQUATOR_RADIUS_M * scale_east;
            let north = (fix.latitude - latitude).to_radians() * EQUATOR_RADIUS_M;
            // Heights of fixes drift by more than places are apart.
            let position = [east, north, 0.0];
            let step = last.map(|last| [position[0] - last[0], position[1] - last[1]]);
            match step {
                Some([dx, dy]) if dx.hypot(dy) >= LEAST_STEP_M => {
                    heading = Some(dy.atan2(dx));
                    last = Some(position);
                }
                None => last = Some(position),
                Some(_) => {}
            }
            track.0.insert(stamp, Placement { position, heading });
        }
        // Before its first step it looked where that led.
        let first = track.0.values().find_map(|it| it.heading);
        for placement in track.0.values_mut().take_while(|it| it.heading.is_none()) {
            placement.heading = first;
        }
        track
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Where it was then, if that is known.
    pub(crate) fn at(&self, stamp: Stamp) -> Option<Placement> {
        let before = self.0.range(..=stamp).next_back();
        let after = self.0.range(stamp..).next();
        let gap_s = |a: Stamp, b: Stamp| (b.as_ns() - a.as_ns()) as f64 / 1e9;
        match (before, after) {
            (Some((&a, from)), Some((&b, to))) => {
                let gap = gap_s(a, b);
                if gap > MAX_GAP_S {
                    return None;
                }
                let share = if gap > 0.0 {
                    gap_s(a, stamp) / gap
                } else {
                    0.0
                };
                Some(between(from, to, share))
            }
            // A little before the first or after the last it was there.
            (Some((&a, there)), None) => (gap_s(a, stamp) <= MAX_GAP_S / 2.0).then_some(*there),
            (None, Some((&b, there))) => (gap_s(stamp, b) <= MAX_GAP_S / 2.0).then_some(*there),
            (None, None) => None,
        }
    }
}

fn between(from: &Placement, to: &Placement, share: f64) -> Placement {
    let position =
        std::array::from_fn(|i| from.position[i] + share * (to.position[i] - from.position[i]));
    let heading = match (from.heading, to.heading) {
        (Some(a), Some(b)) => Some(wrapped(a + share * wrapped(b - a))),
        (a, b) => a.or(b),
    };
    Placement { position, heading }
}

/// An angle in (-π, π].
pub(crate) fn wrapped(angle: f64) -> f64 {
    let turned = angle.rem_euclid(TAU);
    if turned > PI { turned - TAU } else { turned }
}

/// The direction of the x axis of a frame, seen from above.
fn heading([x, y, z, w]: [f64; 4]) -> f64 {
    (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z))
}

/// Transforms by child frame, as far as they lead somewhere.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tree {
    /// The parent that was named last, and the poses in it.
    children: BTreeMap<String, (String, BTreeMap<Stamp, Pose>)>,
}

impl Tree {
    pub(crate) fn add(&mut self, transform: &Transform, logged: Stamp) {
        let trim = |frame: &str| frame.trim_start_matches('/').to_owned();
        let stamp = transform.header.stamp.unwrap_or(logged);
        let (parent, poses) = (self.children).entry(trim(&transform.child)).or_default();
        *parent = trim(&transform.header.frame);
        poses.insert(stamp, transform.pose);
    }

    /// Where `child` was in `fixed` whenever one of the transforms between them changed.
    pub(crate) fn track(&self, fixed: &str, child: &str) -> Result<Track> {
        let mut chain = Vec::new();
        let mut frame = child;
        while frame != fixed {
            let Some((parent, poses)) = self.children.get(frame) else {
                return Err(self.no_chain(fixed, child));
            };
            chain.push(poses);
            frame = parent;
            if chain.len() > self.children.len() {
                return Err(self.no_chain(fixed, child));
            }
        }
        let stamps: std::collections::BTreeSet<Stamp> = chain
            .iter()
            .flat_map(|poses| poses.keys().copied())
            .collect();
        let mut track = Track::default();
        for stamp in stamps {
            let steps = chain.iter().map(|poses| latest(poses, stamp));
            let pose = steps.reduce(|inner, outer| composed(&outer, &inner));
            // A chain of none: a frame is where it is.
            let pose = pose.unwrap_or(NOWHERE);
            track.add(stamp, &pose);
        }
        Ok(track)
    }

    fn no_chain(&self, fixed: &str, child: &str) -> Error {
        let known: Vec<String> = (self.children.iter())
            .map(|(child, (parent, _))| format!("{parent} -> {child}"))
            .collect();
        Error::new(
            ErrorKind::NotFound,
            format!("no transforms lead from `{fixed}` to `{child}`"),
        )
        .with_help(format!("the bag has {}", known.join(", ")))
    }
}

const NOWHERE: Pose = Pose {
    position: [0.0; 3],
    orientation: [0.0, 0.0, 0.0, 1.0],
};

/// The pose that held then: the last one before, or the first one.
fn latest(poses: &BTreeMap<Stamp, Pose>, stamp: Stamp) -> Pose {
    let before = poses.range(..=stamp).next_back();
    let (_, &pose) = before
        .or_else(|| poses.iter().next())
        .unwrap_or((&stamp, &NOWHERE));
    pose
}

/// `inner`, which is given in the frame `outer`, in the frame that `outer` is given in.
fn composed(outer: &Pose, inner: &Pose) -> Pose {
    let [x, y, z, w] = outer.orientation;
    let [a, b, c] = inner.position;
    // v + 2 w (q x v) + 2 q x (q x v).
    let cross = [y * c - z * b, z * a - x * c, x * b - y * a];
    let twice = [
        y * cross[2] - z * cross[1],
        z * cross[0] - x * cross[2],
        x * cross[1] - y * cross[0],
    ];
    let position = std::array::from_fn(|i| {
        outer.position[i] + inner.position[i] + 2.0 * (w * cross[i] + twice[i])
    });
    let [p, q, r, s] = inner.orientation;
    Pose {
        position,
        orientation: [
            w * p + x * s + y * r - z * q,
            w * q - x * r + y * s + z * p,
            w * r + x * q - y * p + z * s,
            w * s - x * p - y * q - z * r,
        ],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::Header;

    fn turned(position: [f64; 3], angle: f64) -> Pose {
        Pose {
            position,
            orientation: [0.0, 0.0, (angle / 2.0).sin(), (angle / 2.0).cos()],
        }
    }

    fn at(s: f64) -> Stamp {
        Stamp::from_ns((s * 1e9) as i64)
    }

    #[test]
    fn poses_are_interpolated_along_the_shorter_arc_and_not_across_gaps() {
        let mut track = Track::default();
        track.add(at(10.0), &turned([0.0, 0.0, 0.0], 3.0));
        track.add(at(11.0), &turned([2.0, 0.0, 0.0], -3.0));
        track.add(at(20.0), &turned([9.0, 0.0, 0.0], 0.0));
        let middle = track.at(at(10.5)).expect("known");
        assert_eq!(middle.position, [1.0, 0.0, 0.0]);
        assert!((middle.heading.expect("known").abs() - PI).abs() < 1e-9);
        assert!(track.at(at(15.0)).is_none() && track.at(at(20.5)).is_some());
        assert!(track.at(at(8.0)).is_none());
    }

    #[test]
    fn transforms_are_chained() -> Result<()> {
        let mut tree = Tree::default();
        let mut add = |parent: &str, child: &str, s: f64, pose: Pose| {
            let header = Header {
                stamp: Some(at(s)),
                frame: parent.into(),
            };
            let child = child.to_owned();
            tree.add(
                &Transform {
                    header,
                    child,
                    pose,
                },
                at(0.0),
            );
        };
        add("map", "odom", 5.0, turned([10.0, 0.0, 0.0], PI / 2.0));
        add("/odom", "base", 5.0, turned([1.0, 0.0, 0.0], 0.0));
        add("odom", "base", 6.0, turned([2.0, 1.0, 0.0], PI / 2.0));
        let track = tree.track("map", "base")?;
        let first = track.at(at(5.0)).expect("known");
        assert!((first.position[0] - 10.0).abs() < 1e-9 && (first.position[1] - 1.0).abs() < 1e-9);
        let second = track.at(at(6.0)).expect("known");
        assert!((second.position[0] - 9.0).abs() < 1e-9, "{second:?}");
        assert!((second.position[1] - 2.0).abs() < 1e-9);
        assert!((second.heading.expect("known").abs() - PI).abs() < 1e-9);
        let error = tree
            .track("world", "base")
            .expect_err("no chain")
            .to_string();
        assert!(error.contains("map -> odom"), "{error}");
        Ok(())
    }

    #[test]
    fn fixes_become_metres_and_a_direction_of_travel() {
        let fix = |latitude: f64, longitude: f64| Fix {
            header: Header {
                stamp: None,
                frame: String::new(),
            },
            is_fixed: true,
            latitude,
            longitude,
        };
        let fixes = [
            (at(0.0), fix(50.0, 14.0)),
            (at(1.0), fix(50.000_01, 14.0)),
            (at(2.0), fix(50.000_01, 14.000_1)),
        ];
        let track = Track::of_fixes(&fixes.into(), [50.0, 14.0]);
        let north = track.at(at(1.0)).expect("known");
        assert!((north.position[1] - 1.113).abs() < 0.01, "{north:?}");
        assert!((north.heading.expect("known") - PI / 2.0).abs() < 1e-6);
        assert_eq!(track.at(at(0.0)).expect("known").heading, north.heading);
        let east = track.at(at(2.0)).expect("known");
        assert!((east.position[0] - 7.155).abs() < 0.02, "{east:?}");
    }
}
