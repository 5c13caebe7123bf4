//! How is a map read or written whose kind its name says?

use std::path::Path;

use fremen::{Error, ErrorKind, Result};

use super::map_server::MapServerMap;
use super::mode::MapMode;
use super::octomap::{read_octomap, write_octomap};
use super::points::{map_of_points, read_points, write_points};
use crate::cells::{OccupancyMap, Thresholds};

/// Reads a map by the ending of its name: `*.bt` is an `OctoMap` tree, `*.ply` and `*.csv` are lists of
/// points, in voxels of `voxel_m`; anything else is the YAML file of a `map_server` map.
///
/// # Errors
/// Those of the readers; [`ErrorKind::Config`] for points without the size of voxels.
pub fn read_map(path: impl AsRef<Path>, voxel_m: Option<f64>) -> Result<OccupancyMap> {
    let path = path.as_ref();
    match ending(path).as_deref() {
        Some("bt") => read_octomap(path),
        Some("ply" | "csv") => {
            let voxel_m = voxel_m.ok_or_else(|| {
                Error::new(ErrorKind::Config, "a list of points has no voxels").with_path(path)
            })?;
            map_of_points(&read_points(path)?, voxel_m).map_err(|error| error.with_path(path))
        }
        _ => Ok(MapServerMap::read(path)?.to_map()),
    }
}

/// Writes a map by the ending of its name, likewise, in place of an earlier one that is none of
/// `inputs`. Of trees and points the most likely state counts; `mode` is that of a picture.
///
/// # Errors
/// Those of the writers; [`ErrorKind::Shape`] for a 3-D map that is to be a picture.
pub fn write_map(
    map: &OccupancyMap,
    path: impl AsRef<Path>,
    mode: MapMode,
    inputs: &[&Path],
) -> Result<()> {
    let path = path.as_ref();
    match ending(path).as_deref() {
        Some("bt") => write_octomap(map, Thresholds::default(), path, inputs),
        Some("ply" | "csv") => write_points(map, Thresholds::default().occupied(), path, inputs),
        _ if !map.spec().is_2d() => Err(Error::new(
            ErrorKind::Shape,
            "a 3-D grid is no map of map_server",
        )
        .with_help("write *.bt, *.ply or *.csv, or a picture with --png")),
        _ => MapServerMap::from_map(map)?.write(path, mode),
    }
}

fn ending(path: &Path) -> Option<String> {
    let ending = path.extension().and_then(|it| it.to_str());
    ending.map(str::to_ascii_lowercase)
}
