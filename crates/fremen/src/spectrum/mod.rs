//! Which rhythms are in this 0/1 history?
//!
//! Pure mathematics of one binary state observed at known times; nothing here knows what the state
//! means. [`CandidatePeriods`] is the set Omega of rhythms that are looked for; [`SpectralSums`]
//! learn a state from observations at any times ([`VisitSums`] each visit once, whoever brings it),
//! and a [`PhasorTable`] many states that share their times; a [`Periodogram`] shows how strong
//! each rhythm is; [`strongest`] selects the few rhythms that a model of order l keeps, and
//! [`Rhythms`] is p(t). A state that was sampled at a steady rate is a [`UniformSpectrum`]: a few
//! rhythms and an [`OutlierSet`], from which every sample can be given back; a [`UniformLearner`]
//! makes many of them. [`HarmonicRegression`] solves for a mean and rhythms together, from sums
//! alone. [`LiteralFremen`] repeats the papers' own update rules for comparison.
//!
//! # Which form for which data?
//!
//! | form | learns from | state kept | costs | not for |
//! |---|---|---|---|---|
//! | [`UniformSpectrum`] | a steady rate, gaps marked | l triples of 5 bytes, outliers of 1-2 bytes a change | one FFT to learn, O(l) a prediction | irregular times |
//! | [`SpectralSums`] | any times, one at a time | 32 K bytes | O(K) to add, O(K l) a model | knowing which visits are in it |
//! | [`VisitSums`] | the same, from several robots | 40 bytes a visit more | O(log n) more | whole maps |
//! | [`PhasorTable`] | many states with shared times | 16 K bytes a time | additions only | changing times |
//! | [`HarmonicRegression`] | the sums of the others | the sums | O(n^3) once, O(n^2) a state | choosing among hundreds of rhythms |
//! | [`LiteralFremen`] | any times, in order of arrival | 32 K bytes | O(K) to add | anything but parity |
//!
//! # Notation
//!
//! | symbol | meaning |
//! |---|---|
//! | `t_1 ... t_m`, `s_i` | observation times and states, `s_i` in {0, 1} |
//! | `w_k = 2 pi / T_k` | angular frequency of candidate k |
//! | `S_k`, `W_k` | `sum_i s_i e^{-j w_k t_i}`, `sum_i e^{-j w_k t_i}` |
//! | `mu` | `S_0 / m`, the mean |
//! | `g_k` | `(S_k - mu W_k) / m`, the balanced coefficient |
//! | `p(t)` | `clamp(mu + sum over the l largest abs(g_k) of 2 abs(g_k) cos(w_k t + arg g_k))` |
//!
//! # Sources and errata
//!
//! Krajnik et al., *FreMEn*, T-RO 2017, eq. 10-11; Santos et al., RAS 2016, eq. 3-4. T-RO eq. 10
//! prints no factor 2 (RAS eq. 4 has it): with half the amplitude the reconstruction of a uniformly
//! sampled series is not its inverse transform. T-RO eq. 11 has no balance term `mu W_k`; RAS eq. 3
//! balances with the *running* mean, whose value depends on the order of observations. The form
//! above is exact, independent of order and mergeable.

mod candidates;
mod codec;
mod least_squares;
mod literal;
mod outliers;
mod periodogram;
mod phasor;
mod rhythms;
mod select;
mod sums;
mod uniform;
mod visits;

pub use candidates::CandidatePeriods;
pub(crate) use codec::{Reader, Writer};
pub(crate) use least_squares::Cholesky;
pub use least_squares::HarmonicRegression;
pub use literal::{Balance, LiteralFremen};
pub use outliers::OutlierSet;
pub use periodogram::{Periodogram, PeriodogramLine};
pub use rhythms::{Component, Rhythms};
pub use select::{NEGLIGIBLE_AMPLITUDE, strongest};
pub use sums::{MAX_OBSERVATIONS, P_UNKNOWN, PhasorTable, SpectralSums};
pub(crate) use sums::{from_fixed, to_fixed, too_many};
pub use uniform::{Encoding, UniformLearner, UniformSpectrum};
pub use visits::VisitSums;
