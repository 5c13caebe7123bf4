//! Where does the robot stand in the plane, and where does it look?

use std::f64::consts::{PI, TAU};

/// A position and a heading in the plane.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose2 {
    /// Along the map's x.
    pub x_m: f64,
    /// Along the map's y.
    pub y_m: f64,
    /// From x towards y.
    pub heading_rad: f64,
}

impl Pose2 {
    /// A pose; the heading may be any number of turns.
    pub const fn new(x_m: f64, y_m: f64, heading_rad: f64) -> Self {
        Self {
            x_m,
            y_m,
            heading_rad,
        }
    }

    /// Whether all three numbers are finite.
    pub const fn is_finite(&self) -> bool {
        self.x_m.is_finite() && self.y_m.is_finite() && self.heading_rad.is_finite()
    }

    /// The pose that `relative` is, seen from here: first this motion, then that one.
    #[must_use]
    pub fn then(&self, relative: &Self) -> Self {
        let [x_m, y_m] = self.place([relative.x_m, relative.y_m]);
        Self::new(x_m, y_m, wrap(self.heading_rad + relative.heading_rad))
    }

    /// `other` as seen from here: `self.then(&self.to(other))` is `other`.
    #[must_use]
    pub fn to(&self, other: &Self) -> Self {
        let (sin, cos) = self.heading_rad.sin_cos();
        let (dx, dy) = (other.x_m - self.x_m, other.y_m - self.y_m);
        let heading = wrap(other.heading_rad - self.heading_rad);
        Self::new(cos * dx + sin * dy, cos * dy - sin * dx, heading)
    }

    /// Where a point of the robot's frame is in the map.
    pub fn place(&self, point_m: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = self.heading_rad.sin_cos();
        let [x, y] = point_m;
        [self.x_m + cos * x - sin * y, self.y_m + sin * x + cos * y]
    }

    /// Distance between the positions of two poses.
    pub fn distance_m(&self, other: &Self) -> f64 {
        (self.x_m - other.x_m).hypot(self.y_m - other.y_m)
    }
}

/// An angle moved to `[-pi, pi)`.
pub fn wrap(angle_rad: f64) -> f64 {
    (angle_rad + PI).rem_euclid(TAU) - PI
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motions_compose_and_are_undone() {
        let (a, b) = (Pose2::new(1.0, -2.0, 2.5), Pose2::new(-0.3, 4.0, -3.0));
        let back = a.then(&a.to(&b));
        assert!(back.distance_m(&b) < 1e-12);
        assert!(wrap(back.heading_rad - b.heading_rad).abs() < 1e-12);
        let quarter = Pose2::new(0.0, 0.0, PI / 2.0).place([1.0, 0.0]);
        assert!((quarter[0]).abs() < 1e-12 && (quarter[1] - 1.0).abs() < 1e-12);
    }

    #[test]
    fn angles_wrap_to_one_turn() {
        for turns in -3..4 {
            assert!((wrap(1.0 + f64::from(turns) * TAU) - 1.0).abs() < 1e-12);
        }
        assert_eq!(wrap(PI), -PI);
    }
}
