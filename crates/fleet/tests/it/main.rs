//! Is what a fleet learns exact, and is every bad table named?

mod bad_tables;
mod fixture;
mod learning;
mod tables;
