//! Was what was seen there a surprise that is worth another look? (RAS 2016 eq. 12)

use fremen::{Result, Time};

use crate::beliefs::Beliefs;
use crate::explored::{Explored, check_p};
use crate::worth::entropy_bits;

/// A surprise is acted upon from so many bits on.
pub(crate) const NOVEL_BITS: f64 = 3.0;

/// And while the look is not older than this.
const RECENT_S: f64 = 5_400.0;

/// No expectation is surer than this, so that one surprise is finite.
const LEAST_P: f64 = 1e-3;

/// `X - I`: the cross entropy of what the short-term memory expects of `place` at `time` to what
/// the model says, less the model's entropy, in bits; 0 if nobody was there lately.
pub(crate) fn surprise_bits(
    beliefs: &Beliefs,
    expected: &Beliefs,
    place: usize,
    time: Time,
) -> Result<f64> {
    let is_recent = (expected.last_look(place)).is_some_and(|last| time.since_s(last) < RECENT_S);
    if !is_recent {
        return Ok(0.0);
    }
    let mut informed = vec![0.0; beliefs.num_states(place)];
    let mut expectation = informed.clone();
    beliefs.usual_into(place, time, &mut informed);
    check_p(beliefs, place, time, &informed)?;
    expected.predict_into(place, time, &mut expectation);
    let bits = informed.iter().zip(&expectation).map(|(&p, &expected)| {
        let p = p.clamp(LEAST_P, 1.0 - LEAST_P);
        -expected * p.log2() - (1.0 - expected) * (1.0 - p).log2() - entropy_bits(p)
    });
    Ok(bits.sum())
}
