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
//!
//! Defined answers: a feature without any observation has p = 1/2 (RAS 4.1.2 starts there), one visit
//! or an unchanging history gives the mean at every order, and any [`Time`](crate::Time), however
//! far, has a p in [0, 1], never NaN.

mod config;
mod fit;
mod fremen;
mod history;
mod mean;
mod model;

pub use config::{BeforeBirth, Guards, HeldOut, ModelConfig, Order, Split, VisibilityConfig};
pub use fit::{Visits, fit};
pub use fremen::Fremen;
pub use history::{BitRow, HistoryLog, Observation};
pub use mean::Mean;
pub use model::{Component, VisibilityModel};
