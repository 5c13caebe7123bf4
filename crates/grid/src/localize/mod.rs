//! Where is the robot in a map, and is the map still right?
//!
//! [`MonteCarlo`] is a particle filter over poses (adaptive Monte Carlo localisation): it moves its
//! particles by the odometry, weighs them by a [`SensorModel`] ([`LikelihoodField`] or
//! [`BeamModel`]), keeps as many as their spread needs and recovers when it was carried elsewhere.
//! [`ScanFit`] counts what contradicts the map, and [`Outdated`] says how unusual that is.

mod beam_model;
mod clusters;
mod distance;
mod filter;
mod health;
mod kld;
mod likelihood_field;
mod motion;
mod sensor;

pub use beam_model::{BeamModel, BeamModelConfig};
pub use clusters::Estimate;
pub use distance::DistanceField;
pub use filter::{FilterConfig, FreeSpace, MonteCarlo, Particle};
pub use health::{Diagnosis, Outdated, PlaceSearch, ScanFit};
pub use likelihood_field::{LikelihoodField, LikelihoodFieldConfig};
pub use motion::MotionModel;
pub use sensor::{Reading, Readings, SensorModel};
