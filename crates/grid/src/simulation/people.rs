//! Where do people walk?

use fremen::Time;

use crate::random::Random;
use crate::simulation::habit::{day_of, hour_of, is_weekend};

/// What the streams of random numbers are for.
const TRIP: u64 = 0x5045_4f50;

/// People who walk along a path, to and fro, on weekdays.
#[derive(Clone, Debug)]
pub(super) struct Walkers {
    pub(super) num_people: u64,
    /// Trips of a person a day.
    pub(super) num_trips: u64,
    pub(super) speed_m_s: f64,
    /// Corners of the path.
    pub(super) path: Vec<[f64; 2]>,
}

impl Walkers {
    /// Who is on the way at `time`.
    pub(super) fn positions(&self, seed: u64, time: Time) -> Vec<[f64; 2]> {
        let (day, hour) = (day_of(time), hour_of(time));
        let mut found = Vec::new();
        if is_weekend(day) || !(7.0..20.0).contains(&hour) {
            return found;
        }
        let length: f64 = self
            .path
            .windows(2)
            .map(|pair| distance(pair[0], pair[1]))
            .sum();
        for person in 0..self.num_people {
            for trip in 0..self.num_trips {
                let mut random = Random::stream(seed, &[TRIP, person, trip, day as u64]);
                let begin = random.between(8.0, 18.0);
                let aside = random.normal(0.25).clamp(-0.45, 0.45);
                let is_back = random.chance(0.5);
                let walked = (hour - begin) * 3_600.0 * self.speed_m_s;
                if (0.0..length).contains(&walked) {
                    let along = if is_back { length - walked } else { walked };
                    found.extend(self.at(along, aside));
                }
            }
        }
        found
    }

    /// The point of the path after `along` metres, moved to its left.
    fn at(&self, mut along: f64, aside: f64) -> Option<[f64; 2]> {
        for pair in self.path.windows(2) {
            let length = distance(pair[0], pair[1]);
            if along <= length && length > 0.0 {
                let d = [0, 1].map(|axis| (pair[1][axis] - pair[0][axis]) / length);
                return Some([
                    pair[0][0] + along * d[0] - aside * d[1],
                    pair[0][1] + along * d[1] + aside * d[0],
                ]);
            }
            along -= length;
        }
        None
    }
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}
