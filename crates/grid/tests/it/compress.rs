//! What is packed comes back bit for bit, and what is lossy is as good as it says.

use fremen::{CandidatePeriods, Period};
use fremen_grid::compress::{LossyGrid, pack, unpack, varint_bytes};
use fremen_grid::simulation::Office3d;
use fremen_grid::{ErrorKind, GridConfig, History, OccupancyMap, TemporalGrid, Time};
use proptest::prelude::*;

use crate::twin::arb_seen;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn every_observation_comes_back((spec, seen) in arb_seen(30)) {
        let mut history = History::new(spec);
        for it in &seen {
            history.observe_as(it.observer, &it.patch, Time::from_us(it.us)).unwrap();
        }
        let packed = pack(&history).unwrap();
        prop_assert_eq!(unpack(&packed).unwrap(), history);
    }

    #[test]
    fn other_bytes_are_an_error(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        prop_assert!(unpack(&bytes).is_err());
        let mut lossy = b"CGRL1\n".to_vec();
        lossy.extend(bytes);
        // Nothing but an error, or a grid that can be asked.
        if let Ok(grid) = LossyGrid::from_bytes(&lossy) {
            let mut map = OccupancyMap::new_unknown(*grid.spec());
            grid.predict_into(Time::from_s(0), &mut map).unwrap();
        }
    }
}

#[test]
fn three_days_of_an_office_are_small() {
    let office = Office3d::new(2, 3).unwrap();
    let candidates = CandidatePeriods::harmonic(Period::DAY, 24).unwrap();
    let config = GridConfig::fremen(candidates, 3).unwrap();
    let mut grid = TemporalGrid::new(*office.spec(), config);
    let (_, mut stream) = grid
        .frames("camera", office.first(), office.time(0))
        .unwrap();
    let mut frames = office.frames();
    while let Some((time, changes)) = frames.advance() {
        stream.push(time, changes).unwrap();
    }
    drop(stream);
    let packed = pack(grid.history()).unwrap();
    assert_eq!(&unpack(&packed).unwrap(), grid.history());
    let varint = varint_bytes(grid.history());
    assert!(
        2 * packed.len() < varint,
        "{} bytes, {varint} as varints",
        packed.len()
    );
    let mut damaged = packed.clone();
    damaged[packed.len() / 2] ^= 1;
    assert_eq!(unpack(&damaged).unwrap_err().kind(), ErrorKind::Checksum);
    let fitted = grid.fitted();
    let lossy = LossyGrid::new(&fitted, Period::DAY, 24, 3).unwrap();
    let bytes = lossy.to_bytes();
    let read = LossyGrid::from_bytes(&bytes).unwrap();
    assert_eq!(read.to_bytes(), bytes);
    let (exact, coarse) = (fitted.errors(97), read.errors(&fitted, 97).unwrap());
    assert_eq!(exact.num_compared, coarse.num_compared);
    assert!(
        coarse.rate() < exact.rate() + 0.01,
        "{} {}",
        coarse.rate(),
        exact.rate()
    );
    assert!(exact.rate() < 0.8 * exact.static_rate());
    let mut map = OccupancyMap::new_unknown(*office.spec());
    read.predict_into(office.time(9_000), &mut map).unwrap();
    for index in (0..map.spec().num_cells()).step_by(11) {
        let p = fitted.p(map.spec().cell(index), office.time(9_000));
        assert_eq!(map.get(index).is_some(), p.is_some());
    }
    assert!(LossyGrid::new(&fitted, Period::DAY, 24, 2).is_err());
}
