//! Does a place follow a rhythm, or is it chance?
//!
//! The power of a period is summed over the features of the place: `P_k = sum over f of
//! abs(g_fk)^2`, with g as in [`Fremen`](super::Fremen). What chance gives is found by shuffling
//! the visit times against the rows of the log, which keeps everything but the rhythms: how often
//! each feature is seen, and which features are seen together. A period is refused unless its power
//! exceeds the mean over shuffles by a given number of their standard deviations z.
//!
//! If all features always came and went together, P would be exponential under chance, and a false
//! alarm have probability `e^-(z + 1)`: 1 in 400 at z = 5. The more independent they are, the fewer
//! false alarms there are.
//!
//! Cost: 64 shuffles x visits x voters x candidates, with at most 256 evenly spread voters. Not for
//! deciding which features follow the rhythm.

use super::evidence::Evidence;
use crate::spectrum::CandidatePeriods;
use crate::time::Time;

/// Features whose power is summed.
const MAX_VOTERS: usize = 256;
/// Shuffles that mean and standard deviation are taken from.
const NUM_SHUFFLES: usize = 64;

/// Visit times in random orders: the same orders every time.
pub(super) struct Shuffles {
    times: Vec<Time>,
    /// Indices into `times`, in order of time, so that the order of arrival is of no importance.
    by_time: Vec<usize>,
    state: u64,
}

impl Shuffles {
    pub(super) fn new(evidence: &Evidence<'_>) -> Self {
        let times: Vec<Time> = evidence.times().collect();
        let mut by_time: Vec<usize> = (0..times.len()).collect();
        by_time.sort_by_key(|&index| (times[index], index));
        Self {
            times,
            by_time,
            state: 0,
        }
    }

    /// The times of the visits in another order, each order equally likely.
    pub(super) fn draw(&mut self) -> Vec<Time> {
        let mut drawn = self.by_time.clone();
        for i in (1..drawn.len()).rev() {
            self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
            drawn.swap(i, (mixed(self.state) % (i as u64 + 1)) as usize);
        }
        let mut times = self.times.clone();
        for (&index, &other) in self.by_time.iter().zip(&drawn) {
            times[index] = self.times[other];
        }
        times
    }
}

/// The output function of `SplitMix64` (Steele, Lea and Flood 2014).
fn mixed(state: u64) -> u64 {
    let state = (state ^ (state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let state = (state ^ (state >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    state ^ (state >> 31)
}

/// Clears `allowed` for every candidate whose power chance explains.
pub(super) fn refuse(
    evidence: &Evidence<'_>,
    candidates: &CandidatePeriods,
    min_sigmas: f64,
    allowed: &mut [bool],
) {
    let deviations = deviations(evidence);
    let powers = |times: &[Time]| powers(candidates, &deviations, times);
    let own: Vec<Time> = evidence.times().collect();
    let own = powers(&own);
    let mut shuffles = Shuffles::new(evidence);
    let mut sum = vec![0.0; own.len()];
    let mut sum_of_squares = vec![0.0; own.len()];
    for _ in 0..NUM_SHUFFLES {
        for (k, power) in powers(&shuffles.draw()).into_iter().enumerate() {
            sum[k] += power;
            sum_of_squares[k] += power * power;
        }
    }
    let count = NUM_SHUFFLES as f64;
    for (k, allowed) in allowed.iter_mut().enumerate() {
        let mean = sum[k] / count;
        let variance = (sum_of_squares[k] / count - mean * mean).max(0.0) * count / (count - 1.0);
        *allowed &= own[k] > mean + min_sigmas * variance.sqrt();
    }
}

/// For each voter, state minus mean at every visit; 0 where it could not be observed.
fn deviations(evidence: &Evidence<'_>) -> Vec<Vec<f64>> {
    let counts = evidence.counts();
    let changing: Vec<usize> = (0..evidence.num_features())
        .filter(|&feature| {
            let (seen, observed) = (counts.seen[feature], counts.observed[feature]);
            // What was seen once, or missed once, fits every rhythm.
            seen >= 2 && seen + 2 <= observed
        })
        .collect();
    let step = changing.len().div_ceil(MAX_VOTERS).max(1);
    let voters: Vec<usize> = changing.into_iter().step_by(step).collect();
    let mut deviations = vec![vec![0.0; evidence.visits.len()]; voters.len()];
    let log = evidence.log;
    for (index, &visit) in evidence.visits.iter().enumerate() {
        let num_known = evidence.num_known(visit);
        for (&feature, row) in voters.iter().zip(&mut deviations) {
            let is_hidden = log
                .hidden_row(visit)
                .is_some_and(|hidden| hidden.get(feature));
            if feature < num_known && !is_hidden {
                let state = f64::from(u8::from(log.seen_row(visit).get(feature)));
                row[index] = state - counts.mean(feature);
            }
        }
    }
    deviations
}

/// Power of each candidate, summed over the voters.
fn powers(candidates: &CandidatePeriods, deviations: &[Vec<f64>], times: &[Time]) -> Vec<f64> {
    let count = candidates.len();
    // Of each voter, the cosine and the sine sums of every candidate: what a visit's phasors are added
    // to as they come, so that memory does not grow with visits times candidates.
    let mut sums = vec![0.0; deviations.len() * 2 * count];
    let mut at_time = vec![0.0; 2 * count];
    for (visit, &time) in times.iter().enumerate() {
        candidates.phasors_into(time, &mut at_time);
        for (row, sums) in deviations.iter().zip(sums.chunks_exact_mut(2 * count)) {
            for (sum, &phasor) in sums.iter_mut().zip(&at_time) {
                *sum += phasor * row[visit];
            }
        }
    }
    (0..count)
        .map(|k| {
            (sums.chunks_exact(2 * count))
                .map(|sums| sums[k].powi(2) + sums[count + k].powi(2))
                .sum()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::Period;
    use crate::visibility::config::BeforeBirth;
    use crate::visibility::{BitRow, HistoryLog};

    /// 60 visits every 31 hours; feature f is seen by `is_seen(f, visit, time)`.
    fn log(is_seen: impl Fn(usize, usize, Time) -> bool) -> HistoryLog {
        let mut log = HistoryLog::new();
        for visit in 0..60 {
            let time = Time::from_s(visit as i64 * 31 * 3600);
            let mut row = BitRow::zeros(40);
            (0..40)
                .filter(|&feature| is_seen(feature, visit, time))
                .for_each(|feature| row.set(feature));
            log.push_visit(time, row, None).expect("fits");
        }
        log
    }

    fn kept(log: &HistoryLog) -> Vec<bool> {
        let evidence = Evidence {
            log,
            visits: (0..log.num_visits()).collect(),
            before_birth: BeforeBirth::NotSeen,
        };
        let candidates = CandidatePeriods::list(vec![Period::WEEK, Period::DAY]).expect("valid");
        let mut allowed = vec![true; 2];
        refuse(&evidence, &candidates, 5.0, &mut allowed);
        allowed
    }

    #[test]
    fn a_daily_rhythm_is_kept_and_the_week_refused() {
        let daily = log(|feature, visit, time| {
            let is_day = time.phase(Period::DAY) < 0.5;
            // One in eight observations is wrong.
            let is_wrong = mixed((feature * 64 + visit) as u64).is_multiple_of(8);
            is_day != is_wrong
        });
        assert_eq!(kept(&daily), [false, true]);
    }

    #[test]
    fn chance_is_refused_even_where_all_features_share_it() {
        let shared = log(|_, visit, _| mixed(visit as u64).is_multiple_of(2));
        assert_eq!(kept(&shared), [false, false]);
        let own =
            log(|feature, visit, _| mixed((feature * 64 + visit) as u64 + 7).is_multiple_of(2));
        assert_eq!(kept(&own), [false, false]);
    }

    #[test]
    fn nothing_to_vote_on_refuses_everything() {
        assert_eq!(kept(&log(|_, _, _| true)), [false, false]);
        assert_eq!(kept(&HistoryLog::new()), [false, false]);
    }
}
