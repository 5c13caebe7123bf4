//! What is p(t) of one state, given its strongest rhythms?

use super::candidates::CandidatePeriods;
use crate::time::Time;

/// One rhythm: `amplitude cos(2 pi t / period_s + phase_rad)`, with t in seconds since the Unix
/// epoch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Component {
    /// The length of a cycle, in seconds.
    pub period_s: f64,
    /// How far p(t) swings to either side: `2 abs(g_k)`.
    pub amplitude: f64,
    /// `arg g_k`, in (-pi, pi].
    pub phase_rad: f64,
}

impl Component {
    /// From the factors of `cos(w t)` and `sin(w t)`.
    pub(crate) fn of_terms(period_s: f64, cos: f64, sin: f64) -> Self {
        Self {
            period_s,
            amplitude: cos.hypot(sin),
            phase_rad: (-sin).atan2(cos),
        }
    }
}

/// A mean and a few rhythms: `p(t) = clamp(mu + sum of their cosines)` (T-RO eq. 10 with the factor
/// 2).
#[derive(Clone, Debug, PartialEq)]
pub struct Rhythms {
    candidates: CandidatePeriods,
    mean: f64,
    /// Index of the candidate, factors of its cosine and sine; strongest first.
    terms: Vec<(u16, f64, f64)>,
}

impl Rhythms {
    pub(crate) fn new(
        candidates: CandidatePeriods,
        mean: f64,
        terms: Vec<(u16, f64, f64)>,
    ) -> Self {
        Self {
            candidates,
            mean,
            terms,
        }
    }

    /// The long-term mean.
    pub fn mean(&self) -> f64 {
        self.mean
    }

    /// How many rhythms there are.
    pub fn order(&self) -> usize {
        self.terms.len()
    }

    /// Index of the candidate, factors of its cosine and sine; strongest first.
    pub(crate) fn terms(&self) -> &[(u16, f64, f64)] {
        &self.terms
    }

    /// The rhythms, strongest first.
    pub fn components(&self) -> impl Iterator<Item = Component> + '_ {
        self.terms
            .iter()
            .map(|&(k, cos, sin)| Component::of_terms(self.candidates.period_s(k.into()), cos, sin))
    }

    /// p(`time`) in [0, 1]; O(l log K).
    pub fn p(&self, time: Time) -> f64 {
        let mut p = self.mean;
        for &(k, re, im) in &self.terms {
            let (cos, sin) = self.candidates.phasor(k.into(), time);
            p += re * cos + im * sin;
        }
        p.clamp(0.0, 1.0)
    }

    /// [`p`](Self::p), bit for bit, from what [`CandidatePeriods::phasors_into`] wrote for that
    /// time; O(l).
    ///
    /// For many states, or many orders of one, that share their candidates.
    ///
    /// # Panics
    /// If there are not two values a candidate.
    pub fn p_of(&self, phasors: &[f64]) -> f64 {
        let count = self.candidates.len();
        assert_eq!(phasors.len(), 2 * count, "two values a candidate");
        let mut p = self.mean;
        for &(k, re, im) in &self.terms {
            let k = usize::from(k);
            p += re * phasors[k] + im * phasors[count + k];
        }
        p.clamp(0.0, 1.0)
    }

    /// Whether the state is 1 with confidence `c`: `p(time) >= c` (T-RO eq. 9).
    pub fn predict(&self, time: Time, c: f64) -> bool {
        self.p(time) >= c
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::Period;

    #[test]
    fn shared_phasors_give_the_same_bits() {
        let candidates = CandidatePeriods::harmonic(Period::WEEK, 168).expect("valid");
        let terms = vec![(6, 0.21, -0.1), (0, 0.03, 0.07), (167, -0.02, 0.01)];
        let rhythms = Rhythms::new(candidates.clone(), 0.4, terms);
        let mut phasors = vec![0.0; 2 * candidates.len()];
        for us in [i64::MIN, -1, 0, (1 << 51) + 12_345] {
            let time = Time::from_us(us);
            candidates.phasors_into(time, &mut phasors);
            assert_eq!(rhythms.p_of(&phasors), rhythms.p(time), "at {us}");
        }
    }
}
