//! Which method recognises places best, how sure are we of it, and what does it look like?
//!
//! Finished answers become numbers here: [`results`] is the file `SUITE.json` and [`metrics`] turns
//! answers into rates with intervals.

pub mod metrics;
pub mod results;
