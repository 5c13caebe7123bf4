//! How much does one match of features say for a place?
//!
//! With `p_f` the probability that predicted feature f is matched at its place, `q_f` the
//! probability that it is matched in an image of another place, d its matching distance and D the
//! displacement that the matches agree on, the log odds of "this place" against "another place" are
//!
//! ```text
//! ln( P(D | here) / P(D | another place) )
//!   + ln mean over conditions rho of mean over reference visits v of product over f of
//!         (1 - (1 - p_fv) (1 - q_f)) / q_f * g1(d) / g0(d)  f matched, seen or by chance
//!         (1 - p_fv) * a / b                                f has an outlier match
//!         (1 - p_fv) * (1 - a) / (1 - b)                    f not matched
//!   p_fv = rho (p_f + r s_fv) / 2
//! ```
//!
//! A feature is matched if its match agrees with D, and has an outlier match if its match does not:
//! a and b are the probabilities of that, of a feature that is not matched, at the place and in
//! images of others. Matched and missing features both count. The mixture over reference visits
//! (past visits of the place, `s_fv` whether v saw f,
//! [`ReferenceVisits`](crate::predict::ReferenceVisits)) is what makes features that appear
//! together speak as one: an image like those of the snowy visits is not held against the place
//! because all summer features are missing. r = 0.8 is the rate at which a feature is detected
//! again under the same conditions; an appearance of one visit has no reference visits, and its
//! `p_f` stands for itself.
//!
//! The mixture over conditions (`conditions.rs`) allows for images that show less of a place than
//! was expected, for reasons that nobody foretold; it matters in maps of few visits.
//!
//! The rates are those of a [`Calibration`] (`rates.rs`), which is learnt from past visits that are
//! held out, a whole run of the robot at once (`held_out.rs`, `learn.rs`), from what is usual where
//! nothing can be, and may be attached to the map (`attachment.rs`). What
//! comes of an image is summed in `expectation.rs` and turned into a posterior in `posterior.rs`.
//!
//! Source: the likelihood ratio over matched and missing features goes beyond T-RO 2017 VII, which
//! counts matches; a mixture over remembered appearances is the idea of experience-based navigation
//! (Churchill & Newman 2013) and of FAB-MAP's place models (Cummins & Newman 2008).

mod attachment;
mod conditions;
mod curve;
mod expectation;
mod held_out;
mod learn;
mod posterior;
mod rates;

pub use attachment::ATTACHMENT;
pub(super) use attachment::{VERSION, attached, to_attachment};
pub use curve::Curve;
pub(super) use expectation::{Expectation, Hits, LogMean};
pub use posterior::PosteriorCalibration;
pub(super) use posterior::{PlaceEvidence, as_evidence};
pub use rates::Calibration;
