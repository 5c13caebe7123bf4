//! Which rhythms are looked for?

use serde::{Deserialize, Serialize};

use super::codec::{Reader, Writer};
use super::phasor::unit;
use crate::error::{Error, ErrorKind, Result};
use crate::time::{Period, Time};

/// The set Omega of candidate periods, in a fixed order.
///
/// Either *harmonic*, `T_0 / 1, T_0 / 2, ... T_0 / K`, or an explicit list.
///
/// A phase is taken in integers, `(t mod T) / T`, so it is as exact at `t` = 2^40 s as at 0; a
/// harmonic set needs one sine and cosine per time, the other `K - 1` follow by complex products
/// (`z^(n+i) = z^n z^i`, with n a power of two: the rounding error grows with log K, not with K).
///
/// # Text form
/// `{ base-s = 31556952.0, count = 12 }` or `{ periods-s = [86400.0, 604800.0] }`, in seconds.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "Text", into = "Text")]
pub struct CandidatePeriods(Kind);

#[derive(Clone, Debug, PartialEq, Eq)]
enum Kind {
    Harmonic { base: Period, count: u16 },
    List(Vec<Period>),
}

impl CandidatePeriods {
    /// No set has more candidates than this.
    pub const MAX_COUNT: usize = u16::MAX as usize;

    /// A year and its fractions down to a month: what the reference recipe looks for in monthly
    /// visits.
    pub const MONTHS: Self = Self(Kind::Harmonic {
        base: Period::YEAR,
        count: 12,
    });

    /// The rhythms of sun and people: a year, a week, and a day with its fractions down to 6 h.
    /// Which of them the visits of a place can support is for guards to say.
    pub fn calendar() -> Self {
        let [year, week, day] = [Period::YEAR, Period::WEEK, Period::DAY];
        Self(Kind::List(vec![
            year,
            week,
            day,
            day.fraction(2),
            day.fraction(3),
            day.fraction(4),
        ]))
    }

    /// The periods `base / 1`, `base / 2`, ... `base / count`.
    ///
    /// `count` is in `1..=`[`MAX_COUNT`](Self::MAX_COUNT) and `base / count` at least 2 us.
    pub fn harmonic(base: Period, count: usize) -> Result<Self> {
        if base.as_us() / 2 < count as i64 {
            return Err(config(format!(
                "{count} harmonics of {base} reach below two microseconds"
            )));
        }
        match u16::try_from(count) {
            Ok(count @ 1..) => Ok(Self(Kind::Harmonic { base, count })),
            _ => Err(wrong_count(count)),
        }
    }

    /// Exactly these periods, which must differ from one another.
    pub fn list(periods: Vec<Period>) -> Result<Self> {
        if periods.is_empty() || periods.len() > Self::MAX_COUNT {
            return Err(wrong_count(periods.len()));
        }
        let mut sorted = periods.clone();
        sorted.sort_unstable();
        match sorted.windows(2).find(|pair| pair[0] == pair[1]) {
            Some(pair) => Err(config(format!("the period {} is given twice", pair[0]))),
            None => Ok(Self(Kind::List(periods))),
        }
    }

    /// How many candidates there are: K, at least 1.
    #[expect(clippy::len_without_is_empty, reason = "a set is never empty")]
    pub fn len(&self) -> usize {
        match &self.0 {
            Kind::Harmonic { count, .. } => usize::from(*count),
            Kind::List(periods) => periods.len(),
        }
    }

    /// The length of candidate `index` in seconds.
    ///
    /// # Panics
    /// If there is no such candidate.
    pub fn period_s(&self, index: usize) -> f64 {
        assert!(index < self.len(), "candidate {index} of {}", self.len());
        match &self.0 {
            Kind::Harmonic { base, .. } => base.as_s() / (index + 1) as f64,
            Kind::List(periods) => periods[index].as_s(),
        }
    }

    /// Writes `cos(w_k t)` for every candidate, then `sin(w_k t)` for every candidate.
    ///
    /// O(K); one sine and cosine for a harmonic set, K of them for a list.
    ///
    /// # Panics
    /// If `out` is not twice [`len`](Self::len) long.
    pub fn phasors_into(&self, time: Time, out: &mut [f64]) {
        let count = self.len();
        assert_eq!(out.len(), 2 * count, "two values a candidate");
        let (cos, sin) = out.split_at_mut(count);
        match &self.0 {
            Kind::Harmonic { base, .. } => {
                (cos[0], sin[0]) = unit(time.phase(*base));
                let mut done = 1;
                while done < count {
                    let step = (cos[done - 1], sin[done - 1]);
                    let (cos_done, cos_rest) = cos.split_at_mut(done);
                    let (sin_done, sin_rest) = sin.split_at_mut(done);
                    let next = cos_rest.iter_mut().zip(sin_rest);
                    let known = cos_done.iter().zip(&*sin_done);
                    for ((cos_next, sin_next), (&cos, &sin)) in next.zip(known) {
                        (*cos_next, *sin_next) = product((cos, sin), step);
                    }
                    done *= 2;
                }
            }
            Kind::List(periods) => {
                for ((cos, sin), period) in cos.iter_mut().zip(sin).zip(periods) {
                    (*cos, *sin) = unit(time.phase(*period));
                }
            }
        }
    }

    /// `(cos(w_k t), sin(w_k t))` of one candidate, equal to [`phasors_into`](Self::phasors_into)
    /// bit for bit, in O(log K).
    ///
    /// # Panics
    /// If there is no such candidate.
    pub fn phasor(&self, index: usize, time: Time) -> (f64, f64) {
        assert!(index < self.len(), "candidate {index} of {}", self.len());
        match &self.0 {
            Kind::Harmonic { base, .. } => power(unit(time.phase(*base)), index as u32 + 1),
            Kind::List(periods) => unit(time.phase(periods[index])),
        }
    }

    /// Writes the set as a part of something larger.
    pub(crate) fn write(&self, writer: &mut Writer) {
        match &self.0 {
            Kind::Harmonic { base, count } => {
                writer.byte(0);
                writer.varint(base.as_us() as u64);
                writer.varint((*count).into());
            }
            Kind::List(periods) => {
                writer.byte(1);
                writer.varint(periods.len() as u64);
                for period in periods {
                    writer.varint(period.as_us() as u64);
                }
            }
        }
    }

    /// Reads what [`write`](Self::write) wrote.
    pub(crate) fn read(reader: &mut Reader<'_>) -> Result<Self> {
        let period = |reader: &mut Reader<'_>| Period::from_us(reader.varint()? as i64);
        match reader.byte()? {
            0 => {
                let base = period(reader)?;
                Self::harmonic(base, reader.varint()? as usize)
            }
            1 => {
                let count = reader.count(1)?;
                let periods = (0..count).map(|_| period(reader));
                Self::list(periods.collect::<Result<_>>()?)
            }
            _ => Err(reader.impossible("no such kind of candidate periods")),
        }
    }

    /// Base period and count, if the set is harmonic.
    pub fn as_harmonic(&self) -> Option<(Period, usize)> {
        match self.0 {
            Kind::Harmonic { base, count } => Some((base, count.into())),
            Kind::List(_) => None,
        }
    }

    /// The periods of an explicit list; none of a harmonic set.
    pub fn as_list(&self) -> &[Period] {
        match &self.0 {
            Kind::Harmonic { .. } => &[],
            Kind::List(periods) => periods,
        }
    }
}

fn product((cos_a, sin_a): (f64, f64), (cos_b, sin_b): (f64, f64)) -> (f64, f64) {
    (cos_a * cos_b - sin_a * sin_b, sin_a * cos_b + cos_a * sin_b)
}

/// `z^exponent` by the very products of `phasors_into`, in O(log exponent): the exponent, less one,
/// is gathered from its lowest bit up.
fn power(z: (f64, f64), exponent: u32) -> (f64, f64) {
    let (mut gathered, mut square) = (z, z);
    let mut rest = exponent - 1;
    while rest > 0 {
        if rest & 1 == 1 {
            gathered = product(gathered, square);
        }
        square = product(square, square);
        rest >>= 1;
    }
    gathered
}

fn config(message: String) -> Error {
    Error::new(ErrorKind::Config, message)
}

fn wrong_count(count: usize) -> Error {
    config(format!(
        "a set of candidate periods has 1 to {} of them, not {count}",
        CandidatePeriods::MAX_COUNT
    ))
}

#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Text {
    Harmonic(HarmonicText),
    List(ListText),
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct HarmonicText {
    base_s: f64,
    count: usize,
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct ListText {
    periods_s: Vec<f64>,
}

impl TryFrom<Text> for CandidatePeriods {
    type Error = Error;

    fn try_from(text: Text) -> Result<Self> {
        match text {
            Text::Harmonic(HarmonicText { base_s, count }) => {
                Self::harmonic(Period::from_s(base_s)?, count)
            }
            Text::List(ListText { periods_s }) => Self::list(
                periods_s
                    .into_iter()
                    .map(Period::from_s)
                    .collect::<Result<_>>()?,
            ),
        }
    }
}

impl From<CandidatePeriods> for Text {
    fn from(candidates: CandidatePeriods) -> Self {
        match candidates.0 {
            Kind::Harmonic { base, count } => Self::Harmonic(HarmonicText {
                base_s: base.as_s(),
                count: count.into(),
            }),
            Kind::List(periods) => Self::List(ListText {
                periods_s: periods.into_iter().map(Period::as_s).collect(),
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    #[test]
    fn one_phasor_is_the_table_entry_bit_for_bit() {
        let time = Time::from_us(1_255_608_123_456_789);
        for candidates in [
            CandidatePeriods::harmonic(Period::YEAR, 1_000).expect("valid"),
            CandidatePeriods::list(vec![Period::WEEK, Period::DAY]).expect("valid"),
        ] {
            let count = candidates.len();
            let mut table = vec![0.0; 2 * count];
            candidates.phasors_into(time, &mut table);
            for k in 0..count {
                assert_eq!(
                    candidates.phasor(k, time),
                    (table[k], table[count + k]),
                    "{k}"
                );
            }
        }
    }

    #[test]
    fn harmonics_keep_their_phase_at_the_end_of_time() {
        let base = Period::from_us(86_400_000_001).expect("positive");
        let candidates = CandidatePeriods::harmonic(base, 1_000).expect("valid");
        let mut table = vec![0.0; 2_000];
        for us in [
            i64::MIN,
            -1,
            0,
            1 << 51,
            (1 << 31) * 1_000_000 + 7,
            i64::MAX,
        ] {
            candidates.phasors_into(Time::from_us(us), &mut table);
            for k in 0..1_000 {
                // The exact phase of harmonic k + 1 in integers.
                let phase = (i128::from(us) * (k as i128 + 1)).rem_euclid(i128::from(base.as_us()));
                let (sin, cos) = (TAU * (phase as f64 / base.as_us() as f64)).sin_cos();
                assert!((table[k] - cos).abs() < 1e-12, "cos of {k} at {us}");
                assert!((table[1_000 + k] - sin).abs() < 1e-12, "sin of {k} at {us}");
            }
        }
    }

    #[test]
    fn sets_that_are_none_are_refused() {
        let micro = Period::from_us(10).expect("positive");
        for refused in [
            CandidatePeriods::harmonic(Period::DAY, 0),
            CandidatePeriods::harmonic(Period::YEAR, 70_000),
            CandidatePeriods::harmonic(micro, 6),
            CandidatePeriods::list(vec![]),
            CandidatePeriods::list(vec![Period::DAY, Period::WEEK, Period::DAY]),
        ] {
            assert_eq!(refused.expect_err("no set").kind(), ErrorKind::Config);
        }
        for text in [
            "base-s = -1.0\ncount = 3",
            "base-s = nan\ncount = 3",
            "base-s = 60.0\ncount = -3",
            "periods-s = [0.0]",
            "base-s = 60.0",
            "base-s = 60.0\ncount = 3\nperiods-s = [1.0]",
        ] {
            assert!(toml::from_str::<CandidatePeriods>(text).is_err(), "{text}");
        }
    }

    #[test]
    fn text_gives_back_the_set() {
        for candidates in [
            CandidatePeriods::harmonic(Period::YEAR, 12).expect("valid"),
            CandidatePeriods::list(vec![Period::from_us(1_234_567).expect("positive")])
                .expect("valid"),
        ] {
            let text = toml::to_string(&candidates).expect("serialises");
            assert_eq!(
                toml::from_str::<CandidatePeriods>(&text).expect("own text"),
                candidates
            );
        }
    }
}
