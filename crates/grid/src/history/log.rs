//! At which observations did a cell change, and which were they?
//!
//! Positions are counted in the observations of the cell's tile (*visits*): 0 is the first.

use crate::cells::CellState;

/// The changes of one cell as variable-length integers: about one byte for one that follows the
/// last within 64 visits, two within 8,192.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct CellLog {
    bytes: Vec<u8>,
    /// The visit of the last change.
    last: u32,
    /// The state at visit 0.
    first: CellState,
    /// Whether it was ever unknown since visit 0.
    hides: bool,
}

/// One change of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Change {
    /// The first visit with the new state.
    pub(crate) visit: u32,
    /// The state from then on.
    pub(crate) state: CellState,
}

/// The other two states, in the order in which a log numbers them.
const fn others(state: CellState) -> [CellState; 2] {
    match state {
        CellState::Free => [CellState::Occupied, CellState::Unknown],
        CellState::Occupied => [CellState::Free, CellState::Unknown],
        CellState::Unknown => [CellState::Free, CellState::Occupied],
    }
}

impl CellLog {
    pub(crate) const fn new(first: CellState) -> Self {
        Self {
            bytes: Vec::new(),
            last: 0,
            first,
            hides: matches!(first, CellState::Unknown),
        }
    }

    /// Appends the change from state `from`, the present one, to `to`, at a later visit than all
    /// before.
    pub(crate) fn push(&mut self, visit: u32, from: CellState, to: CellState) {
        let which = u64::from(others(from)[1] == to);
        let delta = u64::from(visit - self.last);
        put_varint(&mut self.bytes, delta << 1 | which);
        self.last = visit;
        self.hides |= to == CellState::Unknown;
    }

    pub(crate) const fn first(&self) -> CellState {
        self.first
    }

    /// Whether some visit did not see the cell.
    pub(crate) const fn hides(&self) -> bool {
        self.hides
    }

    pub(crate) fn changes(&self) -> Changes<'_> {
        Changes {
            bytes: &self.bytes,
            visit: 0,
            state: self.first,
        }
    }

    pub(crate) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// What [`Self::bytes`] gave; none if they are no log of changes at visits below `num_visits`.
    pub(crate) fn from_bytes(first: CellState, bytes: &[u8], num_visits: u32) -> Option<Self> {
        let mut log = Self::new(first);
        let mut state = first;
        let mut rest = bytes;
        let mut visit = 0_u64;
        while !rest.is_empty() {
            let value = take_varint(&mut rest)?;
            visit = visit.checked_add(value >> 1)?;
            if value >> 1 == 0 || visit >= u64::from(num_visits) {
                return None;
            }
            state = others(state)[(value & 1) as usize];
            log.hides |= state == CellState::Unknown;
        }
        log.bytes = bytes.to_vec();
        log.last = visit as u32;
        Some(log)
    }

    pub(crate) fn shrink(&mut self) {
        self.bytes.shrink_to_fit();
    }

    /// Bytes on the heap.
    pub(crate) const fn heap_bytes(&self) -> usize {
        self.bytes.capacity()
    }
}

/// Iterates over the changes of a cell, oldest first.
#[derive(Clone, Debug)]
pub(crate) struct Changes<'a> {
    bytes: &'a [u8],
    visit: u32,
    state: CellState,
}

impl Iterator for Changes<'_> {
    type Item = Change;

    #[inline]
    fn next(&mut self) -> Option<Change> {
        let value = take_varint(&mut self.bytes)?;
        self.visit += (value >> 1) as u32;
        self.state = others(self.state)[(value & 1) as usize];
        Some(Change {
            visit: self.visit,
            state: self.state,
        })
    }
}

/// Appends an integer, seven bits a byte, least significant first.
#[inline]
pub(crate) fn put_varint(bytes: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
}

/// Takes an integer from the front; none where the bytes end or it has more than 64 bits.
#[inline]
pub(crate) fn take_varint(bytes: &mut &[u8]) -> Option<u64> {
    let mut value = 0;
    for shift in (0..64).step_by(7) {
        let (&byte, rest) = bytes.split_first()?;
        *bytes = rest;
        value |= u64::from(byte & 0x7f) << shift;
        if byte < 0x80 {
            return Some(value);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_come_back_as_they_were_pushed() {
        use CellState::{Free, Occupied, Unknown};
        let states = [Unknown, Free, Occupied, Unknown, Occupied, Free, Unknown];
        let visits = [1, 2, 65, 66, 10_000, 4_000_000_000];
        let mut log = CellLog::new(states[0]);
        for (i, &visit) in visits.iter().enumerate() {
            log.push(visit, states[i], states[i + 1]);
        }
        let found: Vec<_> = log.changes().map(|it| (it.visit, it.state)).collect();
        let expected: Vec<_> = visits
            .iter()
            .copied()
            .zip(states[1..].iter().copied())
            .collect();
        assert_eq!(found, expected);
        let read = CellLog::from_bytes(states[0], log.bytes(), u32::MAX);
        assert_eq!(read, Some(log.clone()));
        assert_eq!(CellLog::from_bytes(states[0], log.bytes(), 10_001), None);
        assert_eq!(CellLog::from_bytes(states[0], &[0x80], 9), None);
        assert_eq!(CellLog::from_bytes(states[0], &[0x01], 9), None);
    }
}
