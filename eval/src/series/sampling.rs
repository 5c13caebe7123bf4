//! Which of the samples does a model get to see?

use chronotope::{Period, Time};
use serde::Serialize;

use super::data::State;

/// A way to thin a series before it is learnt; what is queried is never thinned.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sampling {
    /// Everything, as recorded.
    All,
    /// A share of the samples, each as likely as any other.
    Random,
    /// The same share of those taken Monday to Friday from 8 to 18 h.
    OfficeHours,
}

impl Sampling {
    /// In the order of tables.
    pub const ALL: [Self; 3] = [Self::All, Self::Random, Self::OfficeHours];

    /// Its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::All => "all",
            Self::Random => "random",
            Self::OfficeHours => "office-hours",
        }
    }

    /// How often it is drawn.
    pub fn num_draws(self) -> u64 {
        match self {
            Self::All => 1,
            Self::Random | Self::OfficeHours => 5,
        }
    }

    /// The samples of one draw; the same for every run.
    pub fn draw(self, states: &[State], share: f64, draw: u64) -> Vec<State> {
        let is_kept = |(index, (time, _)): &(usize, &State)| match self {
            Self::All => true,
            Self::Random => is_drawn(*index, share, draw),
            Self::OfficeHours => is_office_hour(*time) && is_drawn(*index, share, draw),
        };
        let kept = states.iter().enumerate().filter(is_kept);
        kept.map(|(_, state)| *state).collect()
    }
}

/// Monday to Friday, 8 to 18 h, on the clock that the series is recorded in.
fn is_office_hour(time: Time) -> bool {
    const HOURS: f64 = 24.0;
    // The epoch was a Thursday.
    let since_monday = time.plus_us(3 * Period::DAY.as_us());
    let day = since_monday.phase(Period::WEEK) * 7.0;
    let hour = time.phase(Period::DAY) * HOURS;
    day < 5.0 && (8.0..18.0).contains(&hour)
}

/// A coin that depends on index and draw alone (`SplitMix64`, Steele, Lea and Flood 2014).
fn is_drawn(index: usize, share: f64, draw: u64) -> bool {
    let mut z = (index as u64 + 1)
        .wrapping_mul(0x9E37_79B9_7F4A_7C15)
        .wrapping_add((draw + 1).wrapping_mul(0xD1B5_4A32_D192_ED03));
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64 <= share
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four weeks of minutes from a Monday.
    fn minutes() -> Vec<State> {
        (0..4 * 7 * 1440)
            .map(|i| (Time::from_s(4 * 86_400 + i * 60), i % 3 == 0))
            .collect()
    }

    #[test]
    fn office_hours_are_fifty_a_week() {
        let all = Sampling::OfficeHours.draw(&minutes(), 1.0, 0);
        assert_eq!(all.len(), 4 * 50 * 60);
        let monday_8 = Time::from_s(4 * 86_400 + 8 * 3_600);
        assert_eq!(all[0].0, monday_8);
    }

    #[test]
    fn draws_differ_and_repeat() {
        let minutes = minutes();
        let draw = |i| Sampling::Random.draw(&minutes, 0.02, i);
        assert_eq!(draw(1), draw(1));
        assert_ne!(draw(1), draw(2));
        let share = draw(1).len() as f64 / minutes.len() as f64;
        assert!((0.015..0.025).contains(&share), "{share}");
    }
}
