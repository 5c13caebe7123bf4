//! What do predicted maps of an office look like, hour by hour?

use fremen::Result;

use crate::cells::OccupancyMap;
use crate::experiment::world::{moment, patch_of, patrol_map};
use crate::model::GridConfig;
use crate::picture::{occupancy_png, rhythms_png};
use crate::random::Random;
use crate::simulation::{Layout, Office};
use crate::temporal::TemporalGrid;

/// Pictures of one office, each with its title.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Gallery {
    /// What was predicted for hours of a day that was not seen, and what was true then.
    pub hours: Vec<[(String, Vec<u8>); 2]>,
    /// The cells' strongest rhythms.
    pub rhythms: (String, Vec<u8>),
}

/// The hours that are shown.
const HOURS: [f64; 4] = [3.0, 9.5, 13.0, 19.0];
/// Days of patrols, and hours between them.
const NUM_DAYS: i64 = 14;
const EVERY_H: f64 = 2.0;

/// Learns an office by patrols of two weeks and draws the Tuesday after.
///
/// # Errors
/// As the grid.
pub fn gallery(seed: u64, layout: Layout, resolution_m: f64) -> Result<Gallery> {
    let office = Office::new(seed, layout);
    let spec = office.spec(resolution_m)?;
    let mut random = Random::stream(seed, &[0x4741_4c4c]);
    let mut grid = TemporalGrid::new(spec, GridConfig::default());
    let mut hour = 1.0;
    while hour < 24.0 * NUM_DAYS as f64 {
        let time = moment(0, hour);
        grid.observe(
            &patch_of(&patrol_map(&office, spec, time, &mut random)?),
            time,
        )?;
        hour += EVERY_H;
    }
    let mut map = OccupancyMap::new_unknown(spec);
    let mut hours = Vec::new();
    for hour in HOURS {
        let time = moment(NUM_DAYS + 1, hour);
        grid.predict_into(time, &mut map)?;
        let clock = format!("{:02}:{:02}", hour as u32, (60.0 * hour.fract()) as u32);
        hours.push([
            (format!("{clock}, predicted"), occupancy_png(&map)?),
            (
                format!("{clock}, true"),
                occupancy_png(&office.true_map(time, spec))?,
            ),
        ]);
    }
    let rhythms = rhythms_png(&grid.fitted(), &spec, moment(NUM_DAYS + 1, 13.0))?;
    Ok(Gallery {
        hours,
        rhythms: ("strongest rhythm of each cell".to_owned(), rhythms),
    })
}
