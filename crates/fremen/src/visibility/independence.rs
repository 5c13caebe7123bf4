//! How many independent looks are these visits?
//!
//! A camera that stands still, or a log that is played twice, gives hundreds of samples of one
//! moment. They are one look. Visits each within tau of the next are a burst, and the largest burst
//! counts no more than the next largest. So a robot that retries a door whenever it comes by is
//! queried as often as it retries, while one stay at the charger, or one camera that froze, does not
//! outweigh everything else. (Cutting more of the large bursts was tried, with the visits within five
//! minutes of each as its burst, on the first 70 % of each edge of the suite `edges`, learnt from 70
//! % of those: the Brier score of the mean is 0.133 without, 0.147 so, and 0.153 and 0.173 where a
//! hundredth or a twentieth of the bursts is cut.)
//!
//! tau is a tenth of the usual time between visits, and ten minutes at most: doors, people and light
//! change within minutes, and a pause of weeks must not make one look of days. Usual is what most of
//! the *time* is spent in, not most of the visits: the gap for which gaps as long or longer fill
//! half of the span. A burst does not change it, however many samples it has.
//!
//! O(V log V). The same for any order of the visits.

use crate::time::Time;

/// Visits within this share of the usual gap are one look.
const SHARE_OF_GAP: f64 = 0.1;

/// Visits further apart are never one look.
const MOST_S: f64 = 600.0;

/// What each visit counts, in the order of `times`: at most 1.
pub(super) fn weights(times: &[Time]) -> Vec<f64> {
    let mut by_time: Vec<usize> = (0..times.len()).collect();
    by_time.sort_by_key(|&index| (times[index], index));
    let most_s = (SHARE_OF_GAP * usual_gap_s(times, &by_time)).min(MOST_S);
    let bursts: Vec<&[usize]> = by_time
        .chunk_by(|&a, &b| times[b].since_s(times[a]) <= most_s)
        .collect();
    let mut sizes: Vec<usize> = bursts.iter().map(|burst| burst.len()).collect();
    sizes.sort_unstable();
    let next_largest = sizes.iter().rev().nth(1).copied().unwrap_or(1);
    let mut weights = vec![1.0; times.len()];
    for burst in bursts {
        for &index in burst {
            weights[index] = (next_largest as f64 / burst.len() as f64).min(1.0);
        }
    }
    weights
}

/// The gap for which gaps as long or longer fill half of the span; 0 without any.
fn usual_gap_s(times: &[Time], by_time: &[usize]) -> f64 {
    let pairs = by_time.windows(2);
    let mut gaps_s: Vec<f64> = pairs
        .map(|pair| times[pair[1]].since_s(times[pair[0]]))
        .collect();
    gaps_s.sort_unstable_by(f64::total_cmp);
    let half_s = gaps_s.iter().sum::<f64>() / 2.0;
    let mut filled_s = 0.0;
    for &gap_s in gaps_s.iter().rev() {
        filled_s += gap_s;
        if filled_s >= half_s {
            return gap_s;
        }
    }
    0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regular_visits_count_one_each_and_a_burst_about_one_together() {
        let hourly: Vec<Time> = (0..672).map(|hour| Time::from_s(3_600 * hour)).collect();
        assert!(weights(&hourly).iter().all(|weight| *weight == 1.0));
        let burst =
            (0..500).map(|i| Time::from_us(3_600_000_000 * 671 + 1_800_000_000 + 600_000 * i));
        let all: Vec<Time> = hourly.into_iter().chain(burst).collect();
        let weights = weights(&all);
        let sum: f64 = weights[672..].iter().sum();
        assert!((0.99..1.01).contains(&sum), "{sum}");
        assert!(weights[..672].iter().all(|weight| *weight == 1.0));
    }

    #[test]
    fn retries_that_are_usual_keep_their_number() {
        let day = |day: i64| (0..3).map(move |i| Time::from_s(86_400 * day + 7 * i));
        let retries: Vec<Time> = (0..40).flat_map(day).collect();
        assert!(weights(&retries).iter().all(|weight| *weight == 1.0));
        let frozen = (0..1_000).map(|i| Time::from_us(86_400_000_000 * 41 + 100_000 * i));
        let all: Vec<Time> = retries.into_iter().chain(frozen).collect();
        let sum: f64 = weights(&all)[120..].iter().sum();
        assert!((2.0..4.0).contains(&sum), "{sum}");
    }

    #[test]
    fn equal_times_are_one_look_and_nothing_is_none() {
        assert_eq!(weights(&[Time::from_s(5); 4]), [0.25; 4]);
        assert_eq!(weights(&[Time::from_s(5)]), [1.0]);
        assert!(weights(&[]).is_empty());
        assert_eq!(
            weights(&[Time::from_us(i64::MIN), Time::from_us(i64::MAX)]),
            [1.0; 2]
        );
    }
}
