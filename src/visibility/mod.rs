//! Will it be visible at time t?

mod history;

pub use history::{BitRow, HistoryLog, Observation};
