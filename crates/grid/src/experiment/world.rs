//! How does a robot learn a simulated office?

use fremen::{Result, Time};

use crate::cells::{GridSpec, OccupancyMap, Patch, Thresholds};
use crate::pose::{Pose2, wrap};
use crate::random::Random;
use crate::scan::{InverseSensorModel, LaserScan, ScanMapper};
use crate::simulation::{Drive, DriveConfig, MONDAY, Office, drive_along};

/// Way between two scans of a patrol.
const PATROL_STEP_M: f64 = 0.5;

/// A moment of the simulated calendar.
pub(super) fn moment(day: i64, hour: f64) -> Time {
    MONDAY.plus_us(day * 86_400_000_000 + (hour * 3.6e9) as i64)
}

/// What is surely free or occupied in a patrol's map; what lies between stays unobserved.
pub(super) fn sure() -> Thresholds {
    Thresholds::new(0.35, 0.65).unwrap_or_default()
}

/// One patrol through an office.
pub(super) fn patrol(office: &Office, time: Time, random: &mut Random) -> Result<Drive> {
    let config = DriveConfig {
        step_m: PATROL_STEP_M,
        ..DriveConfig::default()
    };
    let path = office.patrol(time, config.step_m);
    drive_along(&path, time, &|time| office.scene(time), &config, random)
}

/// The map that scans at these poses make.
pub(super) fn map_at<'a>(
    spec: GridSpec,
    poses: impl IntoIterator<Item = &'a Pose2>,
    scans: &[LaserScan],
) -> Result<OccupancyMap> {
    let mut mapper = ScanMapper::new(spec, InverseSensorModel::reduced());
    for (pose, scan) in poses.into_iter().zip(scans) {
        mapper.add(pose, scan)?;
    }
    Ok(mapper.to_map())
}

/// The map of a patrol whose poses are known but for small errors, as those of a localised robot.
pub(super) fn patrol_map(
    office: &Office,
    spec: GridSpec,
    time: Time,
    random: &mut Random,
) -> Result<OccupancyMap> {
    let drive = patrol(office, time, random)?;
    let poses: Vec<Pose2> = (drive.truth.iter())
        .map(|pose| {
            Pose2::new(
                pose.x_m + random.normal(0.01),
                pose.y_m + random.normal(0.01),
                wrap(pose.heading_rad + random.normal(0.003)),
            )
        })
        .collect();
    map_at(spec, &poses, &drive.scans)
}

/// What a grid observes of a map.
pub(super) fn patch_of(map: &OccupancyMap) -> Patch {
    Patch::from_map(map, sure())
}
