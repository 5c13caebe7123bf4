//! Which way is short, and free at the time at which the robot comes there?
//!
//! [`Planner::plan`] searches a path through a [`Forecast`]: each cell counts as occupied as it is
//! predicted for the time of arrival at it. The [`Plan`] says how likely all of it is free.

mod inflate;
mod search;

pub use search::{Forecast, Plan, Planner};
