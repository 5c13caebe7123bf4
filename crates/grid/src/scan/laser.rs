//! What did each beam of a planar laser meet?

use fremen::{Error, ErrorKind, Result};

/// One turn of a planar laser: ranges at equal steps of angle.
#[derive(Clone, Debug, PartialEq)]
pub struct LaserScan {
    first_rad: f64,
    step_rad: f64,
    max_range_m: f64,
    ranges_m: Vec<f32>,
}

/// What one range means.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Beam {
    /// A surface at this distance.
    Hit(f64),
    /// Nothing up to this distance, which is the laser's range.
    Free(f64),
    /// The beam says nothing.
    Invalid,
}

impl LaserScan {
    /// Ranges of beams at `first_rad`, `first_rad + step_rad` ... from the laser's heading on.
    ///
    /// A range is read as ROS does (REP 117): one below `max_range_m` is a surface; plus infinity,
    /// or `max_range_m` and more, means that nothing is nearer; NaN, minus infinity, zero and
    /// negative numbers say nothing.
    ///
    /// # Errors
    /// [`ErrorKind::Config`] where an angle is not finite or the largest range is not positive.
    pub fn new(
        first_rad: f64,
        step_rad: f64,
        max_range_m: f64,
        ranges_m: Vec<f32>,
    ) -> Result<Self> {
        if !(first_rad.is_finite() && step_rad.is_finite()) {
            let message = format!("angles of beams from {first_rad} by {step_rad} are not finite");
            return Err(Error::new(ErrorKind::Config, message));
        }
        check_range(max_range_m)?;
        Ok(Self {
            first_rad,
            step_rad,
            max_range_m,
            ranges_m,
        })
    }

    /// The ranges as they came.
    pub fn ranges_m(&self) -> &[f32] {
        &self.ranges_m
    }

    /// Number of beams.
    pub fn num_beams(&self) -> usize {
        self.ranges_m.len()
    }

    /// How far the laser sees.
    pub const fn max_range_m(&self) -> f64 {
        self.max_range_m
    }

    /// The angle of beam `index` from the laser's heading.
    pub fn angle_rad(&self, index: usize) -> f64 {
        self.first_rad + self.step_rad * index as f64
    }

    /// What beam `index` met; nothing is said by beams that are not there.
    pub fn beam(&self, index: usize) -> Beam {
        let Some(&range) = self.ranges_m.get(index) else {
            return Beam::Invalid;
        };
        let range = f64::from(range);
        if range.is_nan() || range <= 0.0 {
            Beam::Invalid
        } else if range < self.max_range_m {
            Beam::Hit(range)
        } else {
            Beam::Free(self.max_range_m)
        }
    }

    /// Angles and meanings of all beams.
    pub fn beams(&self) -> impl Iterator<Item = (f64, Beam)> + '_ {
        (0..self.num_beams()).map(|index| (self.angle_rad(index), self.beam(index)))
    }

    /// The scan of a laser that sees `max_range_m` only (IROS 2016, section V-A).
    ///
    /// # Errors
    /// [`ErrorKind::Config`] where that is not positive.
    pub fn trimmed(&self, max_range_m: f64) -> Result<Self> {
        check_range(max_range_m)?;
        let mut trimmed = self.clone();
        trimmed.max_range_m = self.max_range_m.min(max_range_m);
        Ok(trimmed)
    }
}

fn check_range(max_range_m: f64) -> Result<()> {
    if max_range_m > 0.0 && max_range_m.is_finite() {
        return Ok(());
    }
    let message = format!("a laser cannot see {max_range_m} m");
    Err(Error::new(ErrorKind::Config, message).with_help("give a positive number of metres"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_read_as_ros_reads_them() -> Result<()> {
        let ranges = vec![
            1.5,
            f32::INFINITY,
            f32::NAN,
            f32::NEG_INFINITY,
            0.0,
            -1.0,
            9.0,
        ];
        let scan = LaserScan::new(-0.3, 0.1, 8.0, ranges)?;
        let beams: Vec<Beam> = scan.beams().map(|(_, beam)| beam).collect();
        let nothing = Beam::Invalid;
        let free = Beam::Free(8.0);
        assert_eq!(
            beams,
            [
                Beam::Hit(1.5),
                free,
                nothing,
                nothing,
                nothing,
                nothing,
                free
            ]
        );
        assert_eq!(scan.beam(7), nothing);
        assert!((scan.angle_rad(3)).abs() < 1e-12);
        assert_eq!(scan.trimmed(1.0)?.beam(0), Beam::Free(1.0));
        assert_eq!(scan.trimmed(100.0)?.max_range_m(), 8.0);
        for wrong in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(scan.trimmed(wrong).is_err());
        }
        assert!(LaserScan::new(f64::NAN, 0.1, 8.0, vec![]).is_err());
        Ok(())
    }
}
