//! Will it be visible at time t?
//!
//! A [`VisibilityModel`] gives p(t) for every feature of one place. [`fit`] makes one from the
//! place's [`HistoryLog`], which is the source of truth: a model is a cache and can be fitted again
//! from all visits or from some of them ([`Visits`]). [`VisibilityConfig`] says which model, in
//! code or in TOML.
//!
//! | model | p(t) | for | not for |
//! |---|---|---|---|
//! | [`Mean`] | the share of visits at which it was seen | baseline; few visits; no clock | anything that follows the clock |
//! | [`Fremen`] | mean plus the l strongest of given rhythms (T-RO eq. 10-11) | the papers' method; rhythms of any length | visits at certain hours only; many candidates and few visits |
//! | natural | mean and rhythms of year, week and day, solved together, judged by held-out days | any sampling; the one to begin with ([`VisibilityConfig::natural`]) | a machine's rhythms |
//! | least squares | given or chosen harmonics shared by the place, solved together | rhythms that are known | hundreds of rhythms |
//! | [`Logistic`] | the same in log odds, with priors learnt from the place | calibrated p; few visits | maps refitted at every visit |
//! | [`Histogram`] | the share seen in the same part of the day, week, ... | rhythms of any shape and known period | hours that were never visited |
//! | [`Pergam`] | a few Gaussians round the day, week, ... (RAS 4.3.2) | short events at fixed times | states that are mostly 1 |
//! | [`Markov`] | relaxes from the last state to the share of time seen (RAS eq. 5-6) | short term | tomorrow |
//! | [`Cautious`] | any other model, believed as far as its visits reach; p with an interval ([`fit_cautious`]; natural is so by itself) | hours nobody has seen, few visits, bursts | the papers' own numbers |
//! | [`Persistent`] | last state first, any other model later (T-RO eq. 12-13) | short and long term | judging a model by the visits it learnt |
//!
//! # One state is a place with one feature
//!
//! A door, a person in a room, an edge that can be passed: a log of one feature. A visit that says
//! nothing of it marks it as hidden.
//!
//! ```
//! use fremen::visibility::{BitRow, HistoryLog, VisibilityConfig, Visits, fit};
//! use fremen::{Period, Time};
//!
//! let mut log = HistoryLog::new();
//! for hour in 0..28 * 24 {
//!     let mut open = BitRow::zeros(1);
//!     if (6..18).contains(&(hour % 24)) {
//!         open.set(0);
//!     }
//!     log.push_visit(Time::from_s(hour * 3_600), open, None)?;
//! }
//! let door = fit(&log, &VisibilityConfig::natural(), Visits::All)?;
//! let p = |hour: i64| door.predict_one(0, Time::from_s(hour * 3_600));
//! assert!(p(100 * 24 + 12) > 0.9 && p(100 * 24) < 0.1);
//! assert_eq!(door.components(0)[0].period_s, Period::DAY.as_s());
//! # Ok::<(), fremen::Error>(())
//! ```
//!
//! # What was measured
//!
//! A door, ten weeks of minutes, learnt from 2 % of the office hours alone, five draws, and
//! evaluated on a whole later week (`chronotope-eval run door2016`, Brier score): the mean 0.18,
//! FreMEn as the papers print it 0.19 to 0.26 at orders 1 to 5, natural 0.16. FreMEn measures one
//! rhythm at a time, so that in such samples every rhythm borrows from every other; natural solves
//! for all together. Where samples are spread evenly, all of them agree.
//!
//! Its limit: nights that nobody saw are given the mean of the office hours, with an interval that
//! says so. Going on with the rhythms instead happens to suit doors that are shut at night (0.10
//! there, 0.30 instead of 0.33 for `chronotope-eval run door`, where the mean has 0.39), and gave
//! certain answers of either kind for others. Where samples cover the whole day it costs nothing.
//!
//! # Defined answers
//!
//! A feature without any observation has p = 1/2 (RAS 4.1.2 starts there), one visit or an
//! unchanging history gives the mean at every order (natural: the mean with half a look at each
//! state added), and any [`Time`](crate::Time), however far,
//! has a p in [0, 1], never NaN. Times may come in any order and be equal, negative or far.
//! Candidates may be more than visits.

mod cautious;
mod chance;
mod civil;
mod codec;
mod config;
mod coverage;
mod decode;
mod evidence;
mod fit;
mod fremen;
mod histogram;
mod history;
mod independence;
mod logistic;
mod markov;
mod mean;
mod model;
mod natural;
mod pergam;
mod persistent;
mod shared_rhythms;

pub use cautious::Cautious;
pub use civil::Civil;
pub use config::{BeforeBirth, Guards, HeldOut, ModelConfig, Order, Split, VisibilityConfig};
pub use decode::decode;
pub use fit::{Visits, fit, fit_cautious, in_zone};
pub use fremen::Fremen;
pub use histogram::Histogram;
pub use history::{BitRow, FeatureState, HistoryLog};
pub use logistic::Logistic;
pub use markov::Markov;
pub use mean::Mean;
pub use model::{Estimate, VisibilityModel};
pub use pergam::Pergam;
pub use persistent::Persistent;
