//! What are answers worth, and how sure can we be of that?

pub mod compare;
mod decisions;
pub mod exact;
mod judged;
pub mod pooled;
mod posteriors;
pub mod rates;
mod reliability;
mod retrieval;
mod scoring;
pub mod statistics;

pub use posteriors::{decides, judge_all};
