//! Which bytes stand for a map in quarantine, and for what the guard remembers?

use fremen::Time;

use crate::cells::{GridSpec, OccupancyMap, Patch, Thresholds};
use crate::file::{decode_observations, decode_tile, encode_observations, encode_tile};
use crate::history::{History, put_varint, take_varint};
use crate::pose::Pose2;
use crate::registration::{Believed, Judgement, Quarantined, Reason, Registration};
use crate::tiles::Tiling;

/// The first byte of both, to be raised with every change.
const VERSION: u8 = 1;

/// What a guard remembers beside its quarantined maps.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Memory {
    pub(super) past: Vec<Believed>,
    pub(super) num_in_row: usize,
    /// Quarantined maps that were dropped for want of room, ever.
    pub(super) num_dropped: u64,
    /// Digests of maps that were moved before they were integrated, so that they are known when they
    /// come again; the newest last.
    pub(super) moved: Vec<[u8; 16]>,
}

impl Memory {
    pub(super) fn encode(&self) -> Vec<u8> {
        let mut bytes = vec![VERSION];
        put_varint(&mut bytes, self.num_in_row as u64);
        put_varint(&mut bytes, self.num_dropped);
        put_varint(&mut bytes, self.past.len() as u64);
        for it in &self.past {
            bytes.extend(it.time.as_us().to_le_bytes());
            put_f64(&mut bytes, it.disagreement);
            put_f64(&mut bytes, it.shift_m.unwrap_or(f64::NAN));
        }
        put_varint(&mut bytes, self.moved.len() as u64);
        for digest in &self.moved {
            bytes.extend(digest);
        }
        bytes
    }

    pub(super) fn decode(mut bytes: &[u8]) -> Option<Self> {
        let bytes = &mut bytes;
        let mut memory = Self::default();
        if take::<1>(bytes)? != [VERSION] {
            return None;
        }
        memory.num_in_row = usize::try_from(take_varint(bytes)?).ok()?;
        memory.num_dropped = take_varint(bytes)?;
        for _ in 0..take_varint(bytes)? {
            let time = Time::from_us(i64::from_le_bytes(take(bytes)?));
            let disagreement = take_f64(bytes).filter(|it| it.is_finite())?;
            let shift_m = take_f64(bytes)?;
            memory.past.push(Believed {
                time,
                disagreement,
                shift_m: shift_m.is_finite().then_some(shift_m),
            });
        }
        for _ in 0..take_varint(bytes)? {
            memory.moved.push(take(bytes)?);
        }
        bytes.is_empty().then_some(memory)
    }
}

/// A map in quarantine, with the number that says in which order they came.
pub(super) fn encode_held(held: &Quarantined, order: u64) -> Option<Vec<u8>> {
    let mut bytes = vec![VERSION];
    put_varint(&mut bytes, order);
    let judgement = &held.judgement;
    for value in [
        judgement.disagreement,
        judgement.expected,
        judgement.limit,
        judgement.shift_limit_m,
    ] {
        put_f64(&mut bytes, value);
    }
    bytes.push(match judgement.reason {
        None => 0,
        Some(Reason::Contradiction) => 1,
        Some(Reason::Shift) => 2,
        Some(Reason::Nothing) => 3,
    });
    bytes.push(u8::from(judgement.registration.is_some()));
    if let Some(it) = &judgement.registration {
        let Pose2 {
            x_m,
            y_m,
            heading_rad,
        } = it.motion;
        for value in [x_m, y_m, heading_rad, it.shift_m, it.score, it.score_before] {
            put_f64(&mut bytes, value);
        }
    }
    for cells in &held.contradictions {
        put_varint(&mut bytes, cells.len() as u64);
        let mut last = 0;
        for &cell in cells {
            put_varint(&mut bytes, (cell - last) as u64);
            last = cell;
        }
    }
    let history = as_history(held).ok()?;
    put_block(&mut bytes, &encode_observations(history.observations()));
    for tile in history.sorted_tiles() {
        put_varint(&mut bytes, tile.key().into());
        put_block(&mut bytes, &encode_tile(tile));
    }
    Some(bytes)
}

/// None where the bytes are not those of a map of these cells.
pub(super) fn decode_held(spec: &GridSpec, mut bytes: &[u8]) -> Option<(u64, Quarantined)> {
    let bytes = &mut bytes;
    if take::<1>(bytes)? != [VERSION] {
        return None;
    }
    let order = take_varint(bytes)?;
    let mut values = [0.0; 4];
    for value in &mut values {
        *value = take_f64(bytes).filter(|it| !it.is_nan())?;
    }
    let reason = match take::<1>(bytes)? {
        [0] => None,
        [1] => Some(Reason::Contradiction),
        [2] => Some(Reason::Shift),
        [3] => Some(Reason::Nothing),
        _ => return None,
    };
    let mut registration = None;
    take_registration(bytes, &mut registration)?;
    let contradictions = [take_cells(bytes, spec)?, take_cells(bytes, spec)?];
    let observations = decode_observations(take_block(bytes)?)?;
    if observations.len() != 1 {
        return None;
    }
    let tiling = Tiling::new(*spec);
    let mut tiles = Vec::new();
    while !bytes.is_empty() {
        let key = u32::try_from(take_varint(bytes)?).ok()?;
        tiles.push(decode_tile(&tiling, key, 1, take_block(bytes)?)?);
    }
    let history = History::from_parts(tiling, observations, tiles);
    let (time, observer) = history.observation_names().next()?;
    let observer = observer.to_owned();
    let mut map = OccupancyMap::new_unknown(*spec);
    let patch = history.patch(0);
    for (index, &state) in patch.states().iter().enumerate() {
        map.set(index, state.as_probability());
    }
    let [disagreement, expected, limit, shift_limit_m] = values;
    let judgement = Judgement {
        time,
        registration,
        disagreement,
        expected,
        limit,
        shift_limit_m,
        reason,
    };
    Some((
        order,
        Quarantined {
            map,
            judgement,
            observer,
            contradictions,
        },
    ))
}

/// Writes what the bytes say, which may be that there was none; none where they say nothing.
fn take_registration(bytes: &mut &[u8], found: &mut Option<Registration>) -> Option<()> {
    match take::<1>(bytes)? {
        [0] => Some(()),
        [1] => {
            let mut values = [0.0; 6];
            for value in &mut values {
                *value = take_f64(bytes).filter(|it| it.is_finite())?;
            }
            let [x, y, heading, shift_m, score, score_before] = values;
            *found = Some(Registration {
                motion: Pose2::new(x, y, heading),
                shift_m,
                score,
                score_before,
            });
            Some(())
        }
        _ => None,
    }
}

/// Ascending indices of cells.
fn take_cells(bytes: &mut &[u8], spec: &GridSpec) -> Option<Vec<usize>> {
    let (mut cells, mut last) = (Vec::new(), 0_usize);
    for _ in 0..take_varint(bytes)? {
        last = last.checked_add(usize::try_from(take_varint(bytes)?).ok()?)?;
        if last >= spec.num_cells() {
            return None;
        }
        cells.push(last);
    }
    Some(cells)
}

/// The map as the one observation that it would be.
fn as_history(held: &Quarantined) -> fremen::Result<History> {
    let mut history = History::new(*held.map.spec());
    let patch = Patch::from_map(&held.map, Thresholds::default());
    history.observe_as(&held.observer, &patch, held.judgement.time)?;
    Ok(history)
}

fn put_f64(bytes: &mut Vec<u8>, value: f64) {
    bytes.extend(value.to_le_bytes());
}

fn take<const N: usize>(bytes: &mut &[u8]) -> Option<[u8; N]> {
    let (taken, rest) = bytes.split_first_chunk::<N>()?;
    *bytes = rest;
    Some(*taken)
}

fn take_f64(bytes: &mut &[u8]) -> Option<f64> {
    take(bytes).map(f64::from_le_bytes)
}

fn put_block(bytes: &mut Vec<u8>, block: &[u8]) {
    put_varint(bytes, block.len() as u64);
    bytes.extend(block);
}

fn take_block<'a>(bytes: &mut &'a [u8]) -> Option<&'a [u8]> {
    let len = usize::try_from(take_varint(bytes)?).ok()?;
    let (block, rest) = bytes.split_at_checked(len)?;
    *bytes = rest;
    Some(block)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn held() -> Quarantined {
        let spec = GridSpec::new_2d([0.0; 2], 0.1, [30, 20]).expect("a grid");
        let mut map = OccupancyMap::new_unknown(spec);
        for index in 0..400 {
            map.set(index, Some(f32::from(u8::from(index % 7 == 0))));
        }
        Quarantined {
            map,
            judgement: Judgement {
                time: Time::from_s(77),
                registration: Some(Registration {
                    motion: Pose2::new(0.1, -0.2, 0.03),
                    shift_m: 0.2,
                    score: 0.9,
                    score_before: 0.5,
                }),
                disagreement: 0.2,
                expected: 0.01,
                limit: 0.1,
                shift_limit_m: f64::INFINITY,
                reason: Some(Reason::Contradiction),
            },
            observer: "robot".into(),
            contradictions: [vec![3, 4, 599], vec![]],
        }
    }

    #[test]
    fn a_quarantined_map_comes_back_and_other_bytes_are_none() {
        let held = held();
        let bytes = encode_held(&held, 7).expect("fits");
        let (order, back) = decode_held(held.map.spec(), &bytes).expect("ours");
        assert_eq!((order, back.judgement), (7, held.judgement));
        assert_eq!(back.observer, held.observer);
        assert_eq!(back.contradictions, held.contradictions);
        // NaN is unequal to itself.
        let bits = |map: &OccupancyMap| -> Vec<u32> {
            map.probabilities().iter().map(|p| p.to_bits()).collect()
        };
        assert_eq!(bits(&back.map), bits(&held.map));
        for len in 0..bytes.len() {
            // What ends between two tiles is a map with fewer of them; the store's checksums and
            // digests tell that.
            if let Some((_, cut)) = decode_held(held.map.spec(), &bytes[..len]) {
                assert_ne!(bits(&cut.map), bits(&held.map));
            }
        }
        let small = GridSpec::new_2d([0.0; 2], 0.1, [3, 2]).expect("a grid");
        assert!(decode_held(&small, &bytes).is_none());
    }

    #[test]
    fn a_memory_comes_back_and_other_bytes_are_none() {
        let memory = Memory {
            past: vec![
                Believed {
                    time: Time::from_us(-5),
                    disagreement: 0.25,
                    shift_m: None,
                },
                Believed {
                    time: Time::from_us(i64::MAX),
                    disagreement: 0.0,
                    shift_m: Some(0.02),
                },
            ],
            num_in_row: 2,
            num_dropped: 300,
            moved: vec![[7; 16], [9; 16]],
        };
        let bytes = memory.encode();
        assert_eq!(Memory::decode(&bytes), Some(memory));
        for len in 0..bytes.len() {
            assert_eq!(Memory::decode(&bytes[..len]), None, "{len}");
        }
    }
}
