//! What can every online model do?

use std::fmt::Debug;

use crate::error::Result;
use crate::time::Time;

/// What is believed of the states of one place, which are looked at together.
pub trait OnlineModel: Debug + Send + Sync {
    /// States of the place.
    fn num_states(&self) -> usize;

    /// Takes one look at all states.
    ///
    /// # Panics
    /// If there are not [`num_states`](Self::num_states) of them.
    fn observe(&mut self, time: Time, states: &[bool]);

    /// Draws conclusions from all looks so far; to be called once a day or so.
    ///
    /// Fails only beyond [`MAX_OBSERVATIONS`](crate::spectrum::MAX_OBSERVATIONS) looks.
    fn learn(&mut self) -> Result<()>;

    /// Writes p(`time`) of each state, in [0, 1].
    ///
    /// # Panics
    /// If `out` is not [`num_states`](Self::num_states) long.
    fn predict_into(&self, time: Time, out: &mut [f64]);

    /// Writes what each state usually is at this hour: p(`time`) as it would be if the last look had
    /// been long ago.
    ///
    /// # Panics
    /// If `out` is not [`num_states`](Self::num_states) long.
    fn usual_into(&self, time: Time, out: &mut [f64]) {
        self.predict_into(time, out);
    }

    /// Independent looks that what is said of `time` rests on: the variance of p(`time`) as a
    /// parameter is about `p (1 - p) / (looks + 1)`.
    fn looks(&self, time: Time) -> f64;

    /// The share of a state's surprise that is still there `age_s` seconds after it was seen, in
    /// [0, 1] and not rising: 1 if a state stays for ever, 0 if the last look says nothing.
    fn kept(&self, age_s: f64) -> f64 {
        let _ = age_s;
        0.0
    }

    /// The expectation of the square of that share: more than the square of [`kept`](Self::kept) where
    /// it is not known well, because what is not known yet may turn out to be much.
    fn kept_squared(&self, age_s: f64) -> f64 {
        self.kept(age_s).powi(2)
    }

    /// When the place was looked at last.
    fn last_look(&self) -> Option<Time>;
}
