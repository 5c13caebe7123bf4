//! Do map, memory and answers hold out when a robot drives for long?

pub mod live;
mod street;
pub mod visits;

pub use street::StreetOptions;
