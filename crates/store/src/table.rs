//! What does the store have to know of a table, and what is the checksum of a row?
//!
//! Nothing of what a row means: only its columns, how large they may be, and which of the rows that
//! a line of generations has written still hold ([`Holds`]).

use rusqlite::types::ValueRef;

use crate::value::{Sink, put_value};

/// One table: its first column is the row id, its last the checksum `crc`.
///
/// Each row belongs to the generation that stands in its column `generation` (its first or second).
#[derive(Debug)]
pub struct Table {
    /// Its name.
    pub name: &'static str,
    /// The statement that makes it, as `SQLite` keeps it.
    pub create: &'static str,
    /// Columns without the checksum.
    pub columns: &'static [&'static str],
    /// Columns of varying length with the most bytes each may have.
    pub limits: &'static [(&'static str, usize)],
    /// Which rows of a line of generations hold at its end.
    pub holds: Holds,
}

/// Which of the rows that a line of generations has written hold at its end. Pruning drops the
/// others.
#[derive(Debug)]
pub enum Holds {
    /// All of them.
    All,
    /// The newest one.
    Newest,
    /// The newest one of each value in this column.
    NewestOf(&'static str),
    /// Those of the generation that stands in this column of the table of generations.
    Listed(&'static str),
    /// Those that are not of an older generation than the newest row of another table with the same
    /// value in this column: such a row begins them anew.
    Since(&'static Table, &'static str),
    /// Those whose row in another table, with the same id, holds.
    With(&'static Table),
}

impl Table {
    /// The position of a column.
    pub fn position(&self, column: &str) -> Option<usize> {
        self.columns.iter().position(|it| *it == column)
    }
}

/// The checksum of a row: CRC-32 over the table's name and every column before `crc`.
pub fn row_crc(table: &Table, values: &[ValueRef<'_>]) -> u32 {
    let mut crc = crc32fast::Hasher::new();
    crc.put(table.name.as_bytes());
    for &value in values {
        put_value(&mut crc, value);
    }
    crc.finalize()
}

/// Where in a row its single flipped bit is: the column (`None`: the checksum itself) and the byte
/// in it; `None` if more than one bit of the row differs from what was written.
///
/// CRC-32 is linear and its polynomial primitive, so each single flip within 2^32 bits has a
/// syndrome of its own: step it backwards from the end until it meets the observed one. O(bytes).
pub(crate) fn locate_flip(
    table: &Table,
    values: &[ValueRef<'_>],
    stored: u32,
) -> Option<(Option<&'static str>, usize)> {
    let mut record = table.name.as_bytes().to_vec();
    let mut ends = Vec::with_capacity(values.len());
    for &value in values {
        put_value(&mut record, value);
        ends.push(record.len());
    }
    let syndrome = crc32fast::hash(&record) ^ stored;
    if syndrome.is_power_of_two() {
        return Some((None, syndrome.trailing_zeros() as usize / 8));
    }
    let step = |state: u32| {
        (0..8).fold(state, |s, _| {
            if s & 1 == 1 {
                s >> 1 ^ 0xedb8_8320
            } else {
                s >> 1
            }
        })
    };
    let mut flips: [u32; 8] = std::array::from_fn(|bit| step(1 << bit));
    let from_end = (0..record.len()).find(|_| {
        let found = flips.contains(&syndrome);
        if !found {
            flips = flips.map(step);
        }
        found
    })?;
    let at = record.len() - 1 - from_end;
    let column = ends.iter().position(|&end| at < end)?;
    let content = match values[column] {
        ValueRef::Text(content) | ValueRef::Blob(content) => content.len(),
        ValueRef::Integer(_) | ValueRef::Real(_) => 8,
        ValueRef::Null => 0,
    };
    let start = ends[column] - content;
    (at >= start).then(|| (Some(table.columns[column]), at - start))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const NAMES: Table = Table {
        name: "names",
        create: "CREATE TABLE names (id INTEGER PRIMARY KEY, generation INTEGER NOT NULL, \
                 name BLOB NOT NULL, crc INTEGER NOT NULL) STRICT",
        columns: &["id", "generation", "name"],
        limits: &[],
        holds: Holds::All,
    };

    proptest! {
        #[test]
        fn a_single_flip_is_located(
            blob in proptest::collection::vec(any::<u8>(), 1..300),
            at in any::<prop::sample::Index>(),
            bit in 0..8_u8,
        ) {
            let row = |blob| [ValueRef::Integer(7), ValueRef::Integer(1), ValueRef::Blob(blob)];
            let stored = row_crc(&NAMES, &row(&blob));
            let at = at.index(blob.len());
            let mut damaged = blob.clone();
            damaged[at] ^= 1_u8 << bit;
            let found = locate_flip(&NAMES, &row(&damaged), stored);
            prop_assert_eq!(found, Some((Some("name"), at)));
            let found = locate_flip(&NAMES, &row(&blob), stored ^ 0x100);
            prop_assert_eq!(found, Some((None, 1)));
        }
    }
}
