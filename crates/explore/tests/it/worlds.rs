//! Worlds to explore that are made up.

use fremen::Time;
use fremen_explore::Recording;

/// Numbers from a seed.
pub(crate) struct Numbers(u64);

impl Numbers {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1)
    }

    /// Uniform in [0, 1).
    pub(crate) fn unit(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// Places that are 1 for three to four hours of each day, each at its own hour, and change within
/// an hour of it; and `coins` places that are tossed anew every `toss` moments. A moment every
/// `every_s` seconds.
pub(crate) fn rhythms_and_coins(
    rhythms: usize,
    coins: usize,
    days: usize,
    every_s: usize,
    toss: usize,
) -> Recording {
    let mut numbers = Numbers::new(7);
    let per_day = 86_400 / every_s;
    let moments = (0..days * per_day).map(|i| Time::from_s((i * every_s) as i64));
    let mut recording = Recording::new(moments.collect()).unwrap();
    for place in 0..rhythms {
        let mut states = Vec::new();
        for _ in 0..days {
            let from_s = 7_200.0 * place as f64 + 3_600.0 * numbers.unit();
            let to_s = from_s + 12_000.0 + 3_600.0 * numbers.unit();
            states.extend((0..per_day).map(|i| {
                let at_s = (i * every_s) as f64;
                from_s <= at_s && at_s < to_s
            }));
        }
        recording
            .push(format!("rhythm {place}"), 1, states)
            .unwrap();
    }
    for place in 0..coins {
        let mut side = false;
        let states = (0..days * per_day)
            .map(|i| {
                if i % toss == 0 {
                    side = numbers.unit() < 0.5;
                }
                side
            })
            .collect();
        recording.push(format!("coin {place}"), 1, states).unwrap();
    }
    recording
}
