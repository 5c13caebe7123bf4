//! How good is a method, and how sure can we be of that from so few queries?
//!
//! A rate over q queries is a mean of q values in 0..=1 (an error is 0, 1 or the split of a tie).
//! Its 95 % interval is the percentile bootstrap (Efron 1979): draw q queries with replacement
//! 2,000 times, take the mean of each draw, and report the 2.5 % and 97.5 % quantiles of these
//! means. Where queries come in groups that are alike (images of one hour), whole groups are drawn
//! instead. Two methods are compared on the *same* draws of queries, so that hard queries cancel
//! out: the interval of a difference is that of the mean of per-query differences.
//!
//! `Deviation:` where every query has the same value (nobody was wrong), no draw can differ and the
//! bootstrap would claim certainty; [`Sample::rate_interval`] then gives the Wilson interval
//! (Wilson 1927), which for 0 wrong of 60 still allows 6 %. Groups without spread do not show how
//! alike their queries are, so that an intraclass correlation of [`GROUP_CORRELATION`] is taken for
//! it: q queries in groups of m count as q / (1 + (m - 1) 0.2) independent ones (Kish 1965), never
//! fewer than the groups.
//!
//! Draws come from a fixed seed: the same answers give the same interval on every machine.
//! Cost: O(resamples x queries) per interval. Not for: times of several machines in one mean.

use std::collections::BTreeMap;

use crate::results::Measured;

/// Draws per interval.
pub const NUM_RESAMPLES: usize = 2_000;

/// Seed of every draw.
const SEED: u64 = 0x43_68_72_6f_6e_6f;

/// Share of draws left out at each end: 95 % intervals.
const TAIL: f64 = 0.025;

/// Intraclass correlation of mistakes where nothing shows it. Measured over all rows with mistakes:
/// at most 0.08 in worlds of 96 queries (0.03 where fewer than 5 % are wrong), 0.21 in hours of Las
/// Vegas.
pub const GROUP_CORRELATION: f64 = 0.2;

/// The normal quantile at `1 - TAIL`.
const Z: f64 = 1.959_963_984_540_054;

/// A 95 % interval in the unit of the value it belongs to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
}

impl Interval {
    /// Whether `value` lies inside, ends included.
    pub fn contains(&self, value: f64) -> bool {
        (self.low..=self.high).contains(&value)
    }

    /// Both ends times `factor`, which is not negative.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        Self {
            low: self.low * factor,
            high: self.high * factor,
        }
    }
}

/// A mean with its interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The mean of the values.
    pub mean: f64,
    /// Its 95 % interval.
    pub interval: Interval,
}

impl Estimate {
    /// Whether the interval lies on one side of zero.
    pub fn excludes_zero(&self) -> bool {
        self.interval.low > 0.0 || self.interval.high < 0.0
    }

    /// Everything times `factor`, which is not negative.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        Self {
            mean: self.mean * factor,
            interval: self.interval.scaled(factor),
        }
    }
}

/// `SplitMix64` (Steele, Lea and Flood 2014): 64 bits of state, the same on every machine.
#[derive(Clone, Debug)]
pub(crate) struct SplitMix64(u64);

impl SplitMix64 {
    /// The draws of every interval: from the same seed, so that intervals of one set of queries
    /// agree.
    pub(crate) fn of_intervals() -> Self {
        Self(SEED)
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in `0..bound` (multiply-shift; its bias is below `bound / 2^64`).
    pub(crate) fn below(&mut self, bound: usize) -> usize {
        ((u128::from(self.next()) * bound as u128) >> 64) as usize
    }
}

/// One value per query, and which queries are alike.
#[derive(Clone, Debug, Default)]
pub struct Sample {
    /// Weighted sum of values and sum of weights of each group.
    groups: Vec<(f64, f64)>,
    num: usize,
    weight: f64,
    sum: f64,
    smallest: f64,
    largest: f64,
}

impl Sample {
    /// Values of queries that are independent of each other.
    pub fn new(values: impl IntoIterator<Item = f64>) -> Self {
        let mut sample = Self::default();
        for value in values {
            sample.groups.push((value, 1.0));
            sample.count(value, 1.0);
        }
        sample
    }

    /// Blocks of like queries as sums and numbers of queries; empty blocks count for nothing.
    pub fn of_blocks(blocks: impl IntoIterator<Item = (f64, f64)>) -> Self {
        let mut sample = Self::default();
        for (sum, num) in blocks.into_iter().filter(|(_, num)| *num > 0.0) {
            sample.groups.push((sum, num));
            sample.widen(sum / num);
            sample.num += num as usize;
            sample.weight += num;
            sample.sum += sum;
        }
        sample
    }

    /// Values with the name of each query's group, where it has one.
    pub fn grouped<'a>(values: impl IntoIterator<Item = (Option<&'a str>, f64)>) -> Self {
        Self::weighted((values.into_iter()).map(|(group, value)| (group, value, 1.0)))
    }

    /// `(group, value, weight)` per query: a mean for queries that come more or less often than
    /// here.
    pub fn weighted<'a>(values: impl IntoIterator<Item = (Option<&'a str>, f64, f64)>) -> Self {
        let mut sample = Self::default();
        let mut places: BTreeMap<&str, usize> = BTreeMap::new();
        for (group, value, weight) in values {
            let next = sample.groups.len();
            let at = group.map_or(next, |group| *places.entry(group).or_insert(next));
            if at == next {
                sample.groups.push((0.0, 0.0));
            }
            sample.groups[at].0 += weight * value;
            sample.groups[at].1 += weight;
            sample.count(value, weight);
        }
        sample
    }

    fn count(&mut self, value: f64, weight: f64) {
        self.widen(value);
        self.num += 1;
        self.weight += weight;
        self.sum += weight * value;
    }

    fn widen(&mut self, value: f64) {
        (self.smallest, self.largest) = if self.num == 0 {
            (value, value)
        } else {
            (self.smallest.min(value), self.largest.max(value))
        };
    }

    /// Number of queries.
    pub fn len(&self) -> usize {
        self.num
    }

    /// Whether there is no query.
    pub fn is_empty(&self) -> bool {
        self.num == 0
    }

    /// The weighted sum of all values.
    pub fn sum(&self) -> f64 {
        self.sum
    }

    /// The mean; 0 without queries.
    pub fn mean(&self) -> f64 {
        if self.is_empty() {
            0.0
        } else {
            self.sum / self.weight
        }
    }

    /// The percentile bootstrap interval of the mean. It contains the mean of the values, and
    /// shrinks to one point where all values are equal.
    pub fn interval(&self) -> Interval {
        let mean = self.mean();
        if self.is_empty() || self.smallest == self.largest {
            return Interval {
                low: mean,
                high: mean,
            };
        }
        let mut random = SplitMix64(SEED);
        let means = (0..NUM_RESAMPLES)
            .map(|_| {
                let (mut sum, mut num) = (0.0, 0.0);
                for _ in 0..self.groups.len() {
                    let (group_sum, group_num) = self.groups[random.below(self.groups.len())];
                    sum += group_sum;
                    num += group_num;
                }
                sum / num
            })
            .collect();
        interval_of_draws(means, mean)
    }

    /// The interval of a rate, whose values lie in 0..=1; see the module's deviation.
    pub fn rate_interval(&self) -> Interval {
        if self.smallest == self.largest {
            let num = self.num_independent();
            wilson_of(self.mean() * num, num)
        } else {
            self.interval()
        }
    }

    /// How many independent queries are worth as much as these, if mistakes within a group have the
    /// correlation [`GROUP_CORRELATION`].
    fn num_independent(&self) -> f64 {
        let num = self.num as f64;
        if self.weight <= 0.0 {
            return num;
        }
        // The size of the group that a query finds itself in, on average.
        let squares: f64 = (self.groups.iter())
            .map(|(_, weight)| weight * weight)
            .sum();
        let size = (squares / (self.weight * self.weight) * num).max(1.0);
        (num / (1.0 + (size - 1.0) * GROUP_CORRELATION))
            .clamp(self.groups.len().min(self.num) as f64, num)
    }

    /// Mean and [`interval`](Self::interval).
    pub fn estimate(&self) -> Estimate {
        Estimate {
            mean: self.mean(),
            interval: self.interval(),
        }
    }

    /// Mean and [`rate_interval`](Self::rate_interval).
    pub fn rate(&self) -> Estimate {
        Estimate {
            mean: self.mean(),
            interval: self.rate_interval(),
        }
    }
}

/// The percentile interval of a number whose `draws` these are; it contains `value`, which a few
/// odd groups can leave outside.
pub(crate) fn interval_of_draws(mut draws: Vec<f64>, value: f64) -> Interval {
    draws.sort_by(f64::total_cmp);
    Interval {
        low: quantile_of_sorted(&draws, TAIL).min(value),
        high: quantile_of_sorted(&draws, 1.0 - TAIL).max(value),
    }
}

/// The Wilson score interval of `successes` among `num` trials; 0 to 1 without trials.
pub fn wilson(successes: f64, num: usize) -> Interval {
    wilson_of(successes, num as f64)
}

/// [`wilson`] with a number of trials that need not be whole.
fn wilson_of(successes: f64, num: f64) -> Interval {
    if num <= 0.0 {
        return Interval {
            low: 0.0,
            high: 1.0,
        };
    }
    let p = successes / num;
    let z2 = Z * Z;
    let centre = (p + z2 / (2.0 * num)) / (1.0 + z2 / num);
    let half = Z / (1.0 + z2 / num) * (p * (1.0 - p) / num + z2 / (4.0 * num * num)).sqrt();
    Interval {
        low: (centre - half).clamp(0.0, p),
        high: (centre + half).clamp(p, 1.0),
    }
}

/// The `q`-quantile (0..=1) of `values`, linear between neighbours; `None` without values.
pub fn quantile(values: &[f64], q: f64) -> Option<f64> {
    if values.is_empty() {
        return None;
    }
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    Some(quantile_of_sorted(&sorted, q))
}

fn quantile_of_sorted(sorted: &[f64], q: f64) -> f64 {
    let at = q.clamp(0.0, 1.0) * (sorted.len() - 1) as f64;
    let below = at.floor() as usize;
    let above = (below + 1).min(sorted.len() - 1);
    sorted[below] + (at - below as f64) * (sorted[above] - sorted[below])
}

/// Median and 99th percentile of durations in ms; zeros without durations.
pub fn p50_p99(durations_ms: &[f64]) -> (f64, f64) {
    (
        quantile(durations_ms, 0.5).unwrap_or(0.0),
        quantile(durations_ms, 0.99).unwrap_or(0.0),
    )
}

impl From<Estimate> for Measured {
    fn from(estimate: Estimate) -> Self {
        Self {
            value: estimate.mean,
            ci_low: estimate.interval.low,
            ci_high: estimate.interval.high,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn near(a: f64, b: f64, tolerance: f64) -> bool {
        (a - b).abs() <= tolerance
    }

    #[test]
    fn wilson_has_its_known_values() {
        // Worked out by hand: none of n gives z^2 / (n + z^2), half of n is symmetric around 0.5.
        for (x, n, low, high) in [
            (0.0, 60, 0.0, 0.060_17),
            (3.0, 60, 0.017_14, 0.137_00),
            (5.0, 10, 0.236_59, 0.763_41),
            (10.0, 10, 0.722_47, 1.0),
        ] {
            let interval = wilson(x, n);
            assert!(near(interval.low, low, 1e-4), "{x}/{n}: {interval:?}");
            assert!(near(interval.high, high, 1e-4), "{x}/{n}: {interval:?}");
        }
    }

    #[test]
    fn bootstrap_is_near_the_binomial_and_near_wilson() {
        let sample = Sample::new((0..400).map(|i| f64::from(i % 4 == 0)));
        let interval = sample.interval();
        let half = Z * (0.25 * 0.75 / 400.0_f64).sqrt();
        assert!(near(interval.low, 0.25 - half, 0.006), "{interval:?}");
        assert!(near(interval.high, 0.25 + half, 0.006), "{interval:?}");
        let check = wilson(100.0, 400);
        assert!(near(interval.low, check.low, 0.01) && near(interval.high, check.high, 0.01));
    }

    #[test]
    fn the_interval_covers_the_truth_as_often_as_it_says() {
        let (p, trials) = (0.2, 300);
        let mut random = SplitMix64(7);
        let covered = (0..trials)
            .filter(|_| {
                let draw = |_| f64::from((random.next() >> 11) as f64 / (1_u64 << 53) as f64 <= p);
                let sample = Sample::new((0..120).map(draw));
                sample.rate_interval().contains(p)
            })
            .count();
        let share = covered as f64 / f64::from(trials);
        assert!((0.90..=0.985).contains(&share), "{share}");
    }

    #[test]
    fn never_wrong_is_no_certainty() {
        let interval = Sample::new([0.0; 60]).rate_interval();
        assert_eq!(interval.low, 0.0);
        assert!(near(interval.high, 0.0602, 1e-3));
        let interval = Sample::grouped((0..60).map(|_| (Some("one hour"), 0.0))).rate_interval();
        assert!(
            near(interval.high, 0.45, 0.01),
            "60 images of one hour are worth five"
        );
    }

    #[test]
    fn groups_without_spread_lie_between_certainty_and_one_query_each() {
        let names: Vec<String> = (0..30).map(|i| i.to_string()).collect();
        let of = |size: usize| {
            let values = (0..30 * size).map(|i| (Some(names[i % 30].as_str()), 0.0));
            Sample::grouped(values).rate_interval().high
        };
        assert!(near(of(1), wilson(0.0, 30).high, 1e-12), "no group at all");
        // 2,880 queries in 30 groups of 96 count as 2,880 / (1 + 95 * 0.2) = 144.
        assert!(near(of(96), wilson(0.0, 144).high, 1e-12), "{}", of(96));
        assert!(of(96) > 10.0 * wilson(0.0, 2_880).high);
        // However large they are, 30 groups say no more than 30 / 0.2 queries.
        assert!(of(5_000) > wilson(0.0, 150).high && of(5_000) < of(96));
    }

    #[test]
    fn groups_that_are_alike_widen_the_interval() {
        let names: Vec<String> = (0..20).map(|i| i.to_string()).collect();
        let values = || (0..400).map(|i| (i / 20, f64::from(i / 20 % 2)));
        let alone = Sample::new(values().map(|(_, value)| value)).interval();
        let grouped = Sample::grouped(values().map(|(i, v)| (Some(names[i as usize].as_str()), v)))
            .interval();
        assert!(grouped.high - grouped.low > 3.0 * (alone.high - alone.low));
    }

    #[test]
    fn quantiles_interpolate() {
        assert_eq!(quantile(&[], 0.5), None);
        assert_eq!(quantile(&[3.0, 1.0, 2.0], 0.5), Some(2.0));
        assert_eq!(quantile(&[4.0, 1.0, 2.0, 3.0], 0.5), Some(2.5));
        let (p50, p99) = p50_p99(&(0..=100).map(f64::from).collect::<Vec<_>>());
        assert_eq!((p50, p99), (50.0, 99.0));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        #[test]
        fn an_interval_contains_its_mean_and_stays_in_range(
            values in prop::collection::vec(0.0..=1.0_f64, 1..80)
        ) {
            let sample = Sample::new(values.iter().copied());
            let rate = sample.rate();
            prop_assert!(rate.interval.contains(rate.mean));
            prop_assert!(rate.interval.low >= 0.0 && rate.interval.high <= 1.0);
            prop_assert_eq!(sample.interval(), Sample::new(values).interval(), "same draws");
        }

        #[test]
        fn wilson_is_symmetric_and_contains_the_share(num in 1_usize..500, share in 0.0..=1.0_f64) {
            let successes = (share * num as f64).round();
            let interval = wilson(successes, num);
            let mirrored = wilson(num as f64 - successes, num);
            prop_assert!(interval.contains(successes / num as f64));
            prop_assert!(near(interval.low, 1.0 - mirrored.high, 1e-12));
        }

        #[test]
        fn a_group_per_query_is_no_group(values in prop::collection::vec(0.0..=1.0_f64, 1..40)) {
            let names: Vec<String> = (0..values.len()).map(|i| i.to_string()).collect();
            let grouped = Sample::grouped(
                names.iter().map(String::as_str).map(Some).zip(values.iter().copied()),
            );
            prop_assert_eq!(grouped.interval(), Sample::new(values).interval());
        }

        #[test]
        fn quantiles_lie_between_the_ends(values in prop::collection::vec(-9.0..9.0_f64, 1..40), q in 0.0..=1.0_f64) {
            let value = quantile(&values, q).unwrap();
            let low = values.iter().copied().fold(f64::INFINITY, f64::min);
            let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            prop_assert!((low..=high).contains(&value));
        }
    }
}
