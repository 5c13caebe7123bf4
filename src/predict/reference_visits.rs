//! Which past visits can vouch for a feature?
//!
//! Features of a place do not appear independently: those of its snowy visits come together, those
//! of its nights do. [`ReferenceVisits`] keeps, for at most 64 visits of a place, which features
//! each saw, as one word a feature; that is what a covering choice and a mixture over past
//! appearances need to know of the log.
//!
//! The visits are spread evenly over the place's visits in order of arrival, the middle one of each
//! of up to 64 equal runs. Cost: O(features + visits x features / 64), 8 bytes a feature.
//!
//! Not for histories: times are not kept.

use fremen::error::Result;
use fremen::visibility::{BitRow, HistoryLog, Visits};

/// No visit counts less than this share of the likeliest, so that none is ruled out.
const MIN_SIMILARITY: f64 = 1e-3;

/// What some visits of one place saw.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ReferenceVisits {
    seen: Vec<u64>,
    num_visits: usize,
    /// Features that may not be chosen; none where empty.
    left_out: BitRow,
}

impl ReferenceVisits {
    /// No place has more.
    pub const MAX_VISITS: usize = 64;

    /// Of the given visits of `log`; fails if their mask does not fit.
    pub fn of(log: &HistoryLog, visits: Visits<'_>) -> Result<Self> {
        let visits = visits.of(log)?;
        let count = visits.len().min(Self::MAX_VISITS);
        let mut seen = vec![0; log.num_features()];
        for bit in 0..count {
            let visit = visits[(2 * bit + 1) * visits.len() / (2 * count)];
            for feature in log.seen_row(visit).ones() {
                seen[feature] |= 1 << bit;
            }
        }
        Ok(Self {
            seen,
            num_visits: count,
            left_out: BitRow::default(),
        })
    }

    /// A covering choice may not take these features, as the weak ones of a place
    /// ([`weak_features`]); one bit a feature, or no bits for none.
    #[must_use]
    pub fn leaving_out(mut self, weak: BitRow) -> Self {
        self.left_out = weak;
        self
    }

    /// Whether a covering choice may take a feature of the place.
    pub fn may_be_chosen(&self, feature: usize) -> bool {
        self.left_out.is_empty() || !self.left_out.get(feature)
    }

    /// How likely each visit's appearance is now, against the likeliest: `(m_v / max m)^2`, where
    /// `m_v` is the mean of `scores` (p of every feature at the time), within [0, 1], over the
    /// features that v saw.
    ///
    /// The idea of FreEx (T-RO 2017 VII-A), with a place's features to say which visits are like
    /// now instead of a spectrum for each experience. Cost: O(features x visits).
    ///
    /// # Panics
    /// If there is not one score for each feature.
    pub fn similarity_into(&self, scores: &[f64], out: &mut Vec<f64>) {
        assert_eq!(scores.len(), self.seen.len());
        let mut sums = [0.0; Self::MAX_VISITS];
        let mut counts = [0.0; Self::MAX_VISITS];
        for (&word, &score) in self.seen.iter().zip(scores) {
            let p = score.clamp(0.0, 1.0);
            for (visit, (sum, count)) in sums.iter_mut().zip(&mut counts).enumerate() {
                let is_seen = (word >> visit & 1) as f64;
                *sum += p * is_seen;
                *count += is_seen;
            }
        }
        out.clear();
        let means = sums.iter().zip(&counts).take(self.num_visits);
        out.extend(means.map(|(sum, count)| sum / f64::max(*count, 1.0)));
        let most = out.iter().copied().fold(MIN_SIMILARITY, f64::max);
        for similarity in out.iter_mut() {
            *similarity = (*similarity / most).powi(2).max(MIN_SIMILARITY);
        }
    }

    /// How many visits testify.
    pub fn num_visits(&self) -> usize {
        self.num_visits
    }

    /// For each feature of the place, one bit a visit: whether it was seen there.
    pub fn seen(&self) -> &[u64] {
        &self.seen
    }
}

/// The features of a place that were not among the `per_visit` strongest of the image that they were
/// born of, at one of the first `num_visits` visits; of each feature, one bit.
///
/// Features are born in the order of their strength, those of one visit together. How many features
/// the image had is not kept, but those that it showed are: with `b` born of `s` seen, the strongest
/// `b * per_visit / s` (rounded up) of them are taken for strong. So an image of few features has no
/// weak ones. Cost: O(features).
pub fn weak_features(log: &HistoryLog, num_visits: usize, per_visit: usize) -> BitRow {
    let mut weak = BitRow::zeros(log.num_features());
    let mut first = 0;
    for visit in 0..log.num_visits().min(num_visits) {
        let seen = log.seen_row(visit);
        let num_born = seen.len() - first;
        let num_strong = (num_born * per_visit).div_ceil(seen.count_ones().max(1));
        for feature in (first + num_strong.min(num_born))..seen.len() {
            weak.set(feature);
        }
        first = seen.len();
    }
    weak
}

#[cfg(test)]
mod tests {
    use super::*;
    use fremen::time::Time;

    fn log(num_visits: usize) -> HistoryLog {
        let mut log = HistoryLog::new();
        for visit in 0..num_visits {
            // Feature f is seen at visit f only.
            let mut seen = BitRow::zeros(visit + 1);
            seen.set(visit);
            log.push_visit(Time::from_s(visit as i64), seen, None)
                .expect("fits");
        }
        log
    }

    #[test]
    fn few_visits_all_testify() {
        let references = ReferenceVisits::of(&log(3), Visits::All).expect("fits");
        assert_eq!(references.num_visits(), 3);
        assert_eq!(references.seen(), [0b001, 0b010, 0b100]);
    }

    #[test]
    fn of_many_visits_64_testify_evenly_spread() {
        let references = ReferenceVisits::of(&log(640), Visits::All).expect("fits");
        assert_eq!(references.num_visits(), 64);
        let chosen: Vec<usize> = (0..640).filter(|&f| references.seen()[f] != 0).collect();
        assert_eq!(chosen.len(), 64);
        assert!(chosen.windows(2).all(|pair| pair[1] - pair[0] == 10));
    }

    #[test]
    fn visits_whose_features_are_likely_now_are_like_now() {
        let references = ReferenceVisits::of(&log(3), Visits::All).expect("fits");
        let mut similarity = Vec::new();
        // Each visit saw one feature.
        references.similarity_into(&[0.4, 0.8, -0.2], &mut similarity);
        assert_eq!(similarity, [0.25, 1.0, MIN_SIMILARITY]);
        references.similarity_into(&[0.0, 0.0, 0.0], &mut similarity);
        assert_eq!(similarity, [MIN_SIMILARITY; 3]);
    }

    #[test]
    fn visits_left_out_do_not_testify() {
        let mut mask = BitRow::zeros(3);
        mask.set(2);
        let references = ReferenceVisits::of(&log(3), Visits::Only(&mask)).expect("fits");
        assert_eq!(references.seen(), [0, 0, 1]);
    }
    /// Of the features born at each visit, as many as `born` says, all are seen there; of older ones
    /// the first `again`.
    fn births(visits: &[(usize, usize)]) -> HistoryLog {
        let mut log = HistoryLog::new();
        for (visit, &(born, again)) in visits.iter().enumerate() {
            let known = log.num_features();
            let mut seen = BitRow::zeros(known + born);
            (0..again)
                .chain(known..known + born)
                .for_each(|f| seen.set(f));
            log.push_visit(Time::from_s(visit as i64), seen, None)
                .expect("fits");
        }
        log
    }

    #[test]
    fn features_below_the_strongest_of_their_image_are_weak() {
        // 6 of 6, then 3 born of an image of 6, then 2 born of 2, then after the visits that count.
        let log = births(&[(6, 0), (3, 3), (2, 0), (4, 0)]);
        let weak: Vec<usize> = weak_features(&log, 3, 2).ones().collect();
        assert_eq!(weak, [2, 3, 4, 5, 7, 8]);
        assert_eq!(weak_features(&log, 4, 2).ones().last(), Some(14));
        assert_eq!(weak_features(&log, 3, 6).count_ones(), 0);
    }

    #[test]
    fn what_is_left_out_may_not_be_chosen() {
        let log = births(&[(3, 0)]);
        let references = ReferenceVisits::of(&log, Visits::All).expect("fits");
        assert!((0..3).all(|f| references.may_be_chosen(f)));
        let references = references.leaving_out(weak_features(&log, 1, 2));
        assert!(references.may_be_chosen(1) && !references.may_be_chosen(2));
    }
}
