//! Which generations has a file, and which of them lead to one of them?
//!
//! Generations are a tree: each but 0 extends one with a smaller number, its parent, and its
//! content is that of its parent and the rows that it came with. The generation with the highest
//! number holds.

use std::collections::BTreeSet;

use fremen::error::{ErrorKind, Result};
use rusqlite::Connection;
use rusqlite::types::ValueRef;

use crate::fault::{Fault, Faults};
use crate::kind::Kind;
use crate::row::{Row, scan};
use crate::table::Table;

/// Columns that every table of generations has, whatever else its user notes there. `parent` and
/// `prunes` may be missing in versions without branches: there a parent is the generation before.
const OWN: [&str; 5] = ["number", "parent", "prunes", "time_us", "digest"];

/// One row of the table of generations.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Generation {
    /// Counted from 0, the empty file.
    pub number: u64,
    /// The generation that this one extends; `None` for 0.
    pub parent: Option<u64>,
    /// How often the file was pruned.
    pub prunes: u64,
    /// When it was committed, microseconds since 1970.
    pub time_us: i64,
    /// What its user notes of it: the other columns, in their order.
    pub notes: Vec<u64>,
    /// The digest of the content after it.
    pub digest: [u8; 32],
}

/// The columns that a user has added to the table of generations.
pub(crate) fn note_columns(table: &Table) -> impl Iterator<Item = &'static str> + use<> {
    let columns = table.columns.iter().copied();
    columns.filter(|column| !OWN.contains(column))
}

impl Generation {
    /// Whether the rows give what was written down at the commit: the digest, and those notes that
    /// are given here by their columns.
    pub fn compare(
        &self,
        kind: &Kind,
        notes: &[(&'static str, u64)],
        digest: &[u8; 32],
    ) -> Result<(), Fault> {
        let table = kind.tables_now()[0];
        let row = self.number as i64;
        let fault = |column, kind, message: String| {
            Fault::new(table.name, kind, message).at(Some(row), Some(column), None)
        };
        for (column, written) in note_columns(table).zip(&self.notes) {
            let found = notes.iter().find(|(name, _)| *name == column);
            if let Some((_, found)) = found.filter(|(_, found)| found != written) {
                let message = format!("{written} were written, {found} are found");
                return Err(fault(column, ErrorKind::Format, message));
            }
        }
        if self.digest == *digest || cfg!(fuzzing) {
            Ok(())
        } else {
            let message = "the rows are not those that were committed".to_string();
            Err(fault("digest", ErrorKind::Checksum, message))
        }
    }

    /// The values of its row in today's table.
    pub(crate) fn values(&self, table: &Table) -> Vec<ValueRef<'_>> {
        let mut notes = self.notes.iter();
        let integer = |number: u64| ValueRef::Integer(number as i64);
        (table.columns.iter())
            .map(|column| match *column {
                "number" => integer(self.number),
                "parent" => self.parent.map_or(ValueRef::Null, integer),
                "prunes" => integer(self.prunes),
                "time_us" => ValueRef::Integer(self.time_us),
                "digest" => ValueRef::Blob(&self.digest),
                _ => notes.next().copied().map_or(ValueRef::Null, integer),
            })
            .collect()
    }
}

/// The generations that no other one extends, ascending.
pub fn ends(generations: &[Generation]) -> Vec<u64> {
    let parents: BTreeSet<u64> = generations.iter().filter_map(|it| it.parent).collect();
    (generations.iter().map(|it| it.number))
        .filter(|number| !parents.contains(number))
        .collect()
}

/// The generations after `known`, ascending.
pub(crate) fn read_generations(
    connection: &Connection,
    kind: &Kind,
    version: u32,
    known: Option<u64>,
    faults: &mut Faults,
) -> Result<Vec<Generation>> {
    let mut generations: Vec<Generation> = Vec::new();
    let after = known.map_or(-1, |known| known as i64);
    let table = (kind.tables)(version)[0];
    let column = |name| table.position(name).unwrap_or_default();
    let (time, digest) = (column("time_us"), column("digest"));
    let branches = table.position("parent").zip(table.position("prunes"));
    let notes: Vec<usize> = note_columns(table).map(column).collect();
    scan(connection, kind, table, after, faults, |row, faults| {
        let number = row.count(0)? as u64;
        let (parent, prunes) = match branches {
            None => (number.checked_sub(1), 0),
            Some((parent, prunes)) if row.is_null(parent) => (None, row.count(prunes)? as u64),
            Some((parent, prunes)) => (Some(row.count(parent)? as u64), row.count(prunes)? as u64),
        };
        let is_there = match parent {
            None => number == 0,
            // What lies before `known` is not read here.
            Some(parent) if known.is_some_and(|known| parent <= known) => true,
            Some(parent) => {
                parent < number
                    && (generations.binary_search_by_key(&parent, |it| it.number)).is_ok()
            }
        };
        if !is_there && faults.is_clean() {
            let message = match parent {
                Some(parent) if parent < number => format!("generation {parent} is missing"),
                _ => "no generation but 0 is without one before it".into(),
            };
            return Err(row.misfit(branches.map_or(0, |(parent, _)| parent), message));
        }
        let bytes = row.blob(digest)?;
        generations.push(Generation {
            number,
            parent,
            prunes,
            time_us: row.integer(time)?,
            notes: (notes.iter())
                .map(|&column| row.count(column).map(|count| count as u64))
                .collect::<Result<_, Fault>>()?,
            digest: bytes.try_into().map_err(|_| {
                let message = format!("{} bytes, where a digest has 32", bytes.len());
                row.fault(digest, Some(bytes.len()), message)
            })?,
        });
        Ok(())
    })?;
    Ok(generations)
}

/// Where a file stands: its newest generation, and how often it was pruned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tip {
    /// The number of the newest generation.
    pub number: u64,
    /// How often the file was pruned.
    pub prunes: u64,
}

impl Tip {
    pub(crate) fn read(
        connection: &Connection,
        kind: &Kind,
        version: u32,
    ) -> rusqlite::Result<Self> {
        let table = (kind.tables)(version)[0];
        let prunes = table.position("prunes").map_or("0", |_| "prunes");
        let newest = format!(
            "SELECT number, {prunes} FROM {} ORDER BY number DESC LIMIT 1",
            table.name
        );
        connection.query_row(&newest, [], |row| {
            Ok(Self {
                number: row.get::<_, i64>(0)? as u64,
                prunes: row.get::<_, i64>(1)? as u64,
            })
        })
    }
}

/// Which rows belong to the generation that is read: those of its line, from the oldest ancestor
/// on.
#[derive(Debug)]
pub struct Lineage {
    /// Every new generation of the file.
    all: BTreeSet<u64>,
    /// Those of the line.
    line: BTreeSet<u64>,
}

impl Lineage {
    /// The new generations that lead to `at` (the newest where not given), ascending; `None` if
    /// they do not start from `known`.
    pub fn trace(
        generations: &[Generation],
        known: Option<u64>,
        at: Option<u64>,
    ) -> Option<(Self, Vec<Generation>)> {
        let all = generations.iter().map(|it| it.number).collect();
        let mut next = at.or(generations.last().map(|it| it.number));
        let mut line = Vec::new();
        while next != known {
            // A parent is always the smaller number, so this ends.
            let found = generations.binary_search_by_key(&next?, |it| it.number);
            let generation = generations[found.ok()?].clone();
            next = generation.parent;
            line.push(generation);
        }
        line.reverse();
        let numbers = line.iter().map(|it| it.number).collect();
        Some((Self { all, line: numbers }, line))
    }

    /// All of them taken for one line: what is left to do where a row is missing.
    pub fn unbranched(generations: &[Generation]) -> Self {
        let all: BTreeSet<u64> = generations.iter().map(|it| it.number).collect();
        let line = all.clone();
        Self { all, line }
    }

    /// Whether the row, whose generation stands in `column`, belongs to the line.
    pub fn holds(&self, row: &Row<'_>, column: usize) -> Result<bool, Fault> {
        let generation = row.count(column)? as u64;
        if self.all.contains(&generation) {
            Ok(self.line.contains(&generation))
        } else {
            Err(row.misfit(column, format!("there is no generation {generation}")))
        }
    }
}
