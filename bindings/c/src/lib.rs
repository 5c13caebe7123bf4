//! How is the engine used from C?
//!
//! Opaque handles over the rooms of the engine, and a status from every function. No panic crosses
//! the border: it becomes [`ChronotopeStatus::Panic`](status::ChronotopeStatus). The header
//! `include/chronotope.h` is made of these files by cbindgen; `include/chronotope.hpp` is what C++
//! sees.

pub mod answer;
pub mod image;
pub mod localizer;
pub mod map;
pub mod robot;
pub mod series;
pub mod status;
