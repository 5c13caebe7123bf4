//! How far does a live keypoint lie from the map's?

use serde::{Deserialize, Serialize};

use crate::feature::Keypoint;

/// How far a live keypoint lies from its map keypoint: live - map, px; `dx` to the right, `dy`
/// down.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Displacement {
    /// Columns to the right, px.
    pub dx_px: f64,
    /// Rows down, px.
    pub dy_px: f64,
}

impl Displacement {
    /// From `map` to `live`.
    #[inline]
    pub fn between(map: &Keypoint, live: &Keypoint) -> Self {
        Self {
            dx_px: f64::from(live.x) - f64::from(map.x),
            dy_px: f64::from(live.y) - f64::from(map.y),
        }
    }
}
