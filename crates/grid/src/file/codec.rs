//! Which bytes stand for observations and tiles?
//!
//! Equal histories have equal bytes, so that digests can be compared.

use crate::history::{Observations, Tile, Visits, put_varint, take_varint};
use crate::tiles::Tiling;

/// Appends a signed integer: small ones of either sign take one byte.
fn put_i64(bytes: &mut Vec<u8>, value: i64) {
    put_varint(bytes, (value << 1 ^ value >> 63) as u64);
}

/// Takes what [`put_i64`] has appended.
fn take_i64(bytes: &mut &[u8]) -> Option<i64> {
    let value = take_varint(bytes)?;
    Some((value >> 1) as i64 ^ -((value & 1) as i64))
}

/// Names, then times as differences of differences, then observers as runs.
pub(crate) fn encode_observations(observations: &Observations) -> Vec<u8> {
    let mut bytes = Vec::new();
    put_varint(&mut bytes, observations.names().len() as u64);
    for name in observations.names() {
        put_varint(&mut bytes, name.len() as u64);
        bytes.extend_from_slice(name.as_bytes());
    }
    put_varint(&mut bytes, observations.len() as u64);
    let (mut last, mut step) = (0_i64, 0_i64);
    for &us in observations.times_us() {
        // Wrapping, as far ends of time are taken apart again the same way.
        let next = us.wrapping_sub(last);
        put_i64(&mut bytes, next.wrapping_sub(step));
        (last, step) = (us, next);
    }
    for run in observations.observers().chunk_by(|a, b| a == b) {
        put_varint(&mut bytes, run[0].into());
        put_varint(&mut bytes, run.len() as u64);
    }
    bytes
}

/// None where the bytes are not those of observations.
pub(crate) fn decode_observations(mut bytes: &[u8]) -> Option<Observations> {
    let bytes = &mut bytes;
    let num_names = take_varint(bytes)?;
    let mut names = Vec::new();
    for _ in 0..num_names {
        let len = usize::try_from(take_varint(bytes)?).ok()?;
        let (name, rest) = bytes.split_at_checked(len)?;
        names.push(std::str::from_utf8(name).ok()?.to_owned());
        *bytes = rest;
    }
    let num = usize::try_from(take_varint(bytes)?).ok()?;
    // A time has at least one byte.
    if num > bytes.len() {
        return None;
    }
    let (mut times_us, mut last, mut step) = (Vec::with_capacity(num), 0_i64, 0_i64);
    for _ in 0..num {
        step = step.wrapping_add(take_i64(bytes)?);
        last = last.wrapping_add(step);
        times_us.push(last);
    }
    let mut observers = Vec::with_capacity(num);
    while observers.len() < num {
        let observer = u16::try_from(take_varint(bytes)?).ok()?;
        let len = usize::try_from(take_varint(bytes)?).ok()?;
        if len == 0 || len > num - observers.len() {
            return None;
        }
        observers.resize(observers.len() + len, observer);
    }
    if !bytes.is_empty() {
        return None;
    }
    Observations::from_parts(times_us, observers, names)
}

/// Visits as differences, the first states as bits, then the log of each cell that changed.
pub(crate) fn encode_tile(tile: &Tile) -> Vec<u8> {
    let mut bytes = Vec::new();
    let bounds = tile.visits().bounds();
    put_varint(&mut bytes, bounds.len() as u64);
    let mut last = 0;
    for &bound in bounds {
        put_varint(&mut bytes, (bound - last).into());
        last = bound;
    }
    for (word, plane) in tile.planes_at(0).iter().enumerate() {
        for bits in [plane.known, plane.occupied, tile.logged(word)] {
            bytes.extend_from_slice(&bits.to_le_bytes());
        }
    }
    for (_, log) in tile.logs() {
        put_varint(&mut bytes, log.bytes().len() as u64);
        bytes.extend_from_slice(log.bytes());
    }
    bytes
}

/// None where the bytes are not those of this tile of a grid with `num_observations`.
pub(crate) fn decode_tile(
    tiling: &Tiling,
    key: u32,
    num_observations: usize,
    mut bytes: &[u8],
) -> Option<Tile> {
    let bytes = &mut bytes;
    let num_bounds = usize::try_from(take_varint(bytes)?).ok()?;
    if key >= tiling.num_tiles() || num_bounds > bytes.len() {
        return None;
    }
    let (mut bounds, mut last) = (Vec::with_capacity(num_bounds), 0_u32);
    for _ in 0..num_bounds {
        last = last.checked_add(u32::try_from(take_varint(bytes)?).ok()?)?;
        bounds.push(last);
    }
    let visits = Visits::from_bounds(bounds, num_observations as u32)?;
    if visits.len() == 0 {
        return None;
    }
    let num_cells = tiling.num_cells();
    let mut tile = Tile::new(key, num_cells).with_visits(visits);
    let (planes, mut rest) = bytes.split_at_checked(num_cells / 64 * 24)?;
    for (word, words) in planes.chunks_exact(24).enumerate() {
        let bits = |at: usize| -> Option<u64> {
            Some(u64::from_le_bytes(
                words.get(8 * at..8 * at + 8)?.try_into().ok()?,
            ))
        };
        let (known, occupied, logged) = (bits(0)?, bits(1)?, bits(2)?);
        if occupied & !known != 0 {
            return None;
        }
        for bit in 0..64 {
            let at = word * 64 + bit as usize;
            let log = if logged >> bit & 1 == 1 {
                let len = usize::try_from(take_varint(&mut rest)?).ok()?;
                let (log, behind) = rest.split_at_checked(len)?;
                rest = behind;
                if log.is_empty() {
                    return None;
                }
                log
            } else {
                &[]
            };
            let is_inside = tiling.spec().contains(tiling.cell(key, at));
            if !is_inside && (known >> bit & 1 == 1 || !log.is_empty()) {
                return None;
            }
            tile.restore(at, [known, occupied], log)?;
        }
    }
    rest.is_empty().then_some(tile)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signed_integers_come_back() {
        for value in [0, 1, -1, 63, -64, i64::MAX, i64::MIN] {
            let mut bytes = Vec::new();
            put_i64(&mut bytes, value);
            assert_eq!(take_i64(&mut &*bytes), Some(value));
        }
    }
}
