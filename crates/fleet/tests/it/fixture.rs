//! A few places with a few hundred observations, and files of them.

use std::path::Path;

use chronotope_fleet::FleetLog;
use chronotope_fleet::table::ObservationWriter;
use fremen::Time;

/// One observation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Row {
    pub(crate) place: &'static str,
    pub(crate) visit: u128,
    pub(crate) time: Time,
    pub(crate) feature: u32,
    pub(crate) state: bool,
}

/// Numbers that look random and are the same in every run.
pub(crate) fn noise(seed: u64) -> u64 {
    let mut x = seed.wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    x = (x ^ x >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ x >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    x ^ x >> 31
}

/// Half of all visits are of the hall; not every feature is observed at every visit.
pub(crate) fn observations() -> Vec<Row> {
    let mut rows = Vec::new();
    for visit in 0..240_u64 {
        let place = ["hall", "lab", "hall", "gate"][visit as usize % 4];
        let time = Time::from_us(1_767_225_600_000_000 + visit as i64 * 7_321_000_123);
        for feature in 0..90 {
            let draw = noise(visit * 1_000 + u64::from(feature));
            if draw.is_multiple_of(7) {
                continue;
            }
            let by_day = (time.as_us() / 3_600_000_000) % 24 < 12;
            rows.push(Row {
                place,
                visit: u128::from(noise(visit)) << 64 | u128::from(visit),
                time,
                feature,
                state: (draw / 7 % 10 < 8) == (by_day ^ feature.is_multiple_of(3)),
            });
        }
    }
    rows
}

pub(crate) fn log_of(rows: &[Row]) -> FleetLog {
    let mut log = FleetLog::new();
    for row in rows {
        log.add(row.place, row.visit, row.time, row.feature, row.state)
            .expect("no contradiction");
    }
    log
}

/// Writes rows in this order.
pub(crate) fn write(path: &Path, rows: &[Row]) {
    let mut table = ObservationWriter::begin(path).expect("a new file");
    for row in rows {
        let log = log_of(&[*row]);
        let visit = &log.places()[0].visits()[0];
        table
            .visit(row.place, row.visit, row.time, &visit.states)
            .expect("written");
    }
    table.finish().expect("finished");
}

/// The same rows in another order.
pub(crate) fn shuffled(mut rows: Vec<Row>, seed: u64) -> Vec<Row> {
    for at in (1..rows.len()).rev() {
        rows.swap(at, (noise(seed + at as u64) % (at as u64 + 1)) as usize);
    }
    rows
}
