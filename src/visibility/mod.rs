//! Will it be visible at time t?
//!
//! A [`VisibilityModel`] gives p(t) for every feature of one place. [`fit`] makes one from the place's
//! [`HistoryLog`], which is the source of truth: a model is a cache and can be fitted again from all
//! visits or from some of them ([`Visits`]). [`VisibilityConfig`] says which model, in code or in TOML.
//!
//! | model | p(t) | for |
//! |---|---|---|
//! | [`Mean`] | the share of visits at which it was seen | baseline; few visits; no clock |
//! | [`Fremen`] | mean plus the l strongest of given rhythms (T-RO eq. 10-11) | the papers' method |
//! | least squares | a few rhythms shared by the place, solved together | irregular visits |
//! | [`Logistic`] | the same in log odds, with priors learnt from the place | calibrated p; few visits |
//! | [`Histogram`] | the share seen in the same part of the day, week, ... | rhythms of any shape and known period |
//! | [`Pergam`] | a few Gaussians round the day, week, ... (RAS 4.3.2) | short events at fixed times |
//! | [`Markov`] | relaxes from the last state to the share of time seen (RAS eq. 5-6) | short term |
//! | [`Persistent`] | last state first, any other model later (T-RO eq. 12-13) | short and long term |
//!
//! Defined answers: a feature without any observation has p = 1/2 (RAS 4.1.2 starts there), one visit
//! or an unchanging history gives the mean at every order, and any [`Time`](crate::Time), however
//! far, has a p in [0, 1], never NaN.

mod chance;
mod config;
mod evidence;
mod fit;
mod fremen;
mod histogram;
mod history;
mod logistic;
mod markov;
mod mean;
mod model;
mod natural;
mod pergam;
mod persistent;
mod shared_rhythms;

pub use config::{BeforeBirth, Guards, HeldOut, ModelConfig, Order, Split, VisibilityConfig};
pub use fit::{Visits, fit};
pub use fremen::Fremen;
pub use histogram::Histogram;
pub use history::{BitRow, HistoryLog, Observation};
pub use logistic::Logistic;
pub use markov::Markov;
pub use mean::Mean;
pub use model::VisibilityModel;
pub use pergam::Pergam;
pub use persistent::Persistent;
