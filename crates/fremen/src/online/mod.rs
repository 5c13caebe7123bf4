//! What is believed of states that are looked at now and then, one look after the other?
//!
//! A robot that drives from place to place sees the states of a place all at once, at odd hours,
//! and never all of the time. An [`OnlineModel`] takes one look after the other
//! ([`observe`](OnlineModel::observe)), draws its conclusions when it is told to
//! ([`learn`](OnlineModel::learn), once a day), and says at any time how probable each state is,
//! how sure it is of that, and for how long the last look counts. [`visibility`](crate::visibility)
//! instead fits a model to a log that is complete.
//!
//! | [`OnlineConfig`] | p(t) | takes up |
//! |---|---|---|
//! | short-term memory | from the last state to the share of time in state 1 (RAS 2016 eq. 5-6) | at each look |
//! | long-term memory | the share of looks (RAS 4.3.1) | at `learn` |
//! | FreMEn | mean and the strongest rhythms, their number by looks that were predicted before they were made (RAS eq. 3-4, exact balance) | at `learn` |
//! | periodic Gaussian mixture | a few Gaussians round the day (RAS 4.3.2) | at `learn` |
//! | natural | [`VisibilityConfig::natural`](crate::visibility::VisibilityConfig::natural) | at `learn` |
//! | histogram | the share of looks at about this time of day, recent ones first | at `learn` |
//! | persistent | the last look first, any of the others later; for how long is measured | at each look and at `learn` |
//!
//! Looks should come in order of time. One that does not is learnt from, and is not taken for the
//! last look. All states are at p = 1/2 until something is known of them.

mod config;
mod counts;
mod gaussians;
mod histogram;
mod long_term;
mod model;
mod persistent;
mod refitted;
mod short_term;
mod spectral;

pub use config::OnlineConfig;
pub use model::OnlineModel;
