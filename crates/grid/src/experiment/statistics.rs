//! How sure is a difference?

use crate::random::Random;

/// The value below which a share of the values lies; NaN without values.
pub(super) fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = (sorted.len().saturating_sub(1)) as f64 * share;
    sorted.get(at.round() as usize).copied().unwrap_or(f64::NAN)
}

/// The mean of groups of values and its 95 % interval, by drawing whole groups again and again
/// (cluster bootstrap): values of one group, such as all passes of one simulated office, are no
/// independent evidence.
pub(super) fn mean_interval(groups: &[Vec<f64>], seed: u64) -> [f64; 3] {
    let mean = |drawn: &mut dyn Iterator<Item = usize>| {
        let (mut sum, mut count) = (0.0, 0_usize);
        for index in drawn {
            sum += groups[index].iter().sum::<f64>();
            count += groups[index].len();
        }
        sum / count.max(1) as f64
    };
    let mut random = Random::new(seed);
    let means: Vec<f64> = (0..NUM_DRAWS)
        .map(|_| mean(&mut (0..groups.len()).map(|_| random.below(groups.len()))))
        .collect();
    let all = mean(&mut (0..groups.len()));
    [all, quantile(&means, 0.025), quantile(&means, 0.975)]
}

const NUM_DRAWS: usize = 2_000;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interval_holds_its_mean_and_widens_with_the_groups_spread() {
        let near: Vec<Vec<f64>> = (0..10).map(|i| vec![f64::from(i % 2); 5]).collect();
        let [mean, low, high] = mean_interval(&near, 1);
        assert!((mean - 0.5).abs() < 1e-12 && low < 0.5 && high > 0.5);
        // The standard error of ten coins is 0.16, whatever the size of a group.
        assert!((high - low - 4.0 * 0.158).abs() < 0.15, "{low} {high}");
        assert_eq!(quantile(&[3.0, 1.0, 2.0], 0.5), 2.0);
        assert!(quantile(&[], 0.5).is_nan());
    }
}
