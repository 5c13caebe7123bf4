//! A grid of cells with counts: what a user of the store writes for itself.

use std::collections::BTreeMap;
use std::path::Path;

use chronotope_store::{
    Access, Fault, Faults, Generation, Holds, Kind, Lineage, Reader, Store, Table, Tip, ValueRef,
    put_value,
};
use fremen::error::Result;
use sha2::{Digest, Sha256};

pub(crate) fn folder() -> tempfile::TempDir {
    tempfile::tempdir_in("/dev/shm")
        .or_else(|_| tempfile::tempdir())
        .expect("temporary folder")
}

pub(crate) const GENERATION: Table = Table {
    name: "generation",
    create: "CREATE TABLE generation (number INTEGER PRIMARY KEY, parent INTEGER, \
             prunes INTEGER NOT NULL, time_us INTEGER NOT NULL, num_cells INTEGER NOT NULL, \
             digest BLOB NOT NULL, crc INTEGER NOT NULL) STRICT",
    columns: &[
        "number",
        "parent",
        "prunes",
        "time_us",
        "num_cells",
        "digest",
    ],
    limits: &[("digest", 32)],
    holds: Holds::All,
};

/// Without branches, as the first version had it.
const GENERATION_1: Table = Table {
    create: "CREATE TABLE generation (number INTEGER PRIMARY KEY, time_us INTEGER NOT NULL, \
             num_cells INTEGER NOT NULL, digest BLOB NOT NULL, crc INTEGER NOT NULL) STRICT",
    columns: &["number", "time_us", "num_cells", "digest"],
    ..GENERATION
};

/// The count of a cell is that of its newest row.
pub(crate) const CELL: Table = Table {
    name: "cell",
    create: "CREATE TABLE cell (id INTEGER PRIMARY KEY, generation INTEGER NOT NULL, \
             cell INTEGER NOT NULL, count INTEGER NOT NULL, crc INTEGER NOT NULL) STRICT",
    columns: &["id", "generation", "cell", "count"],
    limits: &[],
    holds: Holds::NewestOf("cell"),
};

/// Raw samples of a region, and what begins those of a region anew.
pub(crate) const SAMPLE: Table = Table {
    name: "sample",
    create: "CREATE TABLE sample (id INTEGER PRIMARY KEY, generation INTEGER NOT NULL, \
             region INTEGER NOT NULL, value INTEGER NOT NULL, crc INTEGER NOT NULL) STRICT",
    columns: &["id", "generation", "region", "value"],
    limits: &[],
    holds: Holds::Since(&RESET, "region"),
};
pub(crate) const RESET: Table = Table {
    name: "reset",
    create: "CREATE TABLE reset (id INTEGER PRIMARY KEY, generation INTEGER NOT NULL, \
             region INTEGER NOT NULL, crc INTEGER NOT NULL) STRICT",
    columns: &["id", "generation", "region"],
    limits: &[],
    holds: Holds::NewestOf("region"),
};

/// Remarks on samples, by their ids.
pub(crate) const REMARK: Table = Table {
    name: "remark",
    create: "CREATE TABLE remark (sample INTEGER PRIMARY KEY, generation INTEGER NOT NULL, \
             text TEXT NOT NULL, crc INTEGER NOT NULL) STRICT",
    columns: &["sample", "generation", "text"],
    limits: &[("text", 100)],
    holds: Holds::With(&SAMPLE),
};

/// What the second version has beside the cells.
const NOTE: Table = Table {
    name: "note",
    create: "CREATE TABLE note (id INTEGER PRIMARY KEY, generation INTEGER NOT NULL, \
             text TEXT NOT NULL, crc INTEGER NOT NULL) STRICT",
    columns: &["id", "generation", "text"],
    limits: &[("text", 100)],
    holds: Holds::Newest,
};

pub(crate) static FIRST: Kind = Kind {
    noun: "grid",
    application_id: 0x4772_6964,
    version: 1,
    tables: |_| &[&GENERATION_1, &CELL],
    references: &[],
    program: "gridder",
    tool: "gridder grid",
    maker: "gridder grid make",
    help_for_folder: "a grid is one file",
};

pub(crate) static GRID: Kind = Kind {
    version: 2,
    tables: |version| match version {
        1 => &[&GENERATION_1, &CELL],
        _ => &[&GENERATION, &CELL, &NOTE, &SAMPLE, &RESET, &REMARK],
    },
    noun: "grid",
    application_id: 0x4772_6964,
    references: &[],
    program: "gridder",
    tool: "gridder grid",
    maker: "gridder grid make",
    help_for_folder: "a grid is one file",
};

/// The content at a generation.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Counts(pub(crate) BTreeMap<i64, i64>);

impl Counts {
    pub(crate) fn digest(&self) -> [u8; 32] {
        let mut sha = Sha256::new();
        for (&cell, &count) in &self.0 {
            put_value(&mut sha, ValueRef::Integer(cell));
            put_value(&mut sha, ValueRef::Integer(count));
        }
        sha.finalize().into()
    }

    fn generation(&self, number: u64, parent: Option<u64>, prunes: u64) -> Generation {
        Generation {
            number,
            parent,
            prunes,
            time_us: number as i64,
            notes: vec![self.0.len() as u64],
            digest: self.digest(),
        }
    }
}

/// What was read: the content, where the file stands, and its last row.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Known {
    pub(crate) counts: Counts,
    pub(crate) tip: Tip,
    last_row: i64,
}

fn read(
    reader: &Reader<'_>,
    kind: &'static Kind,
    at: Option<u64>,
    faults: &mut Faults,
) -> Result<Option<Known>> {
    let generations = reader.generations(None, faults)?;
    let Some((lineage, line)) = Lineage::trace(&generations, None, at) else {
        return Ok(None);
    };
    let mut counts = Counts::default();
    let mut last_row = 0;
    reader.scan(&CELL, 0, faults, |row, _| {
        last_row = row.id();
        if lineage.holds(row, 1)? {
            counts.0.insert(row.integer(2)?, row.integer(3)?);
        }
        Ok(())
    })?;
    if let Some(last) = line.last().filter(|_| faults.is_clean()) {
        let notes = [("num_cells", counts.0.len() as u64)];
        (last.compare(kind, &notes, &counts.digest())).or_else(|fault: Fault| faults.add(fault))?;
    }
    let tip = reader.tip()?;
    Ok(Some(Known {
        counts,
        tip,
        last_row,
    }))
}

/// Whether the newest counts are what was written.
pub(crate) fn check(reader: &Reader<'_>) -> Result<()> {
    read(reader, &GRID, None, &mut Faults::strict(&GRID)).map(drop)
}

/// A file of counts.
#[derive(Debug)]
pub(crate) struct Grid {
    kind: &'static Kind,
    pub(crate) store: Store,
    pub(crate) known: Known,
}

impl Grid {
    pub(crate) fn create(kind: &'static Kind, path: &Path) -> Result<Self> {
        let known = Known {
            counts: Counts::default(),
            tip: Tip {
                number: 0,
                prunes: 0,
            },
            last_row: 0,
        };
        let first = known.counts.generation(0, None, 0);
        let store = Store::create(kind, path, 512, check, |writer| {
            writer.insert_generation(&first)
        })?;
        Ok(Self { kind, store, known })
    }

    pub(crate) fn open(kind: &'static Kind, path: &Path, access: Access) -> Result<Self> {
        let (store, known) = Store::open(kind, path, access, check, |reader| {
            read(reader, kind, None, &mut Faults::strict(kind))?
                .ok_or_else(|| kind.no_generations())
        })?;
        Ok(Self { kind, store, known })
    }

    pub(crate) fn at(&mut self, number: u64) -> Result<Known> {
        let kind = self.kind;
        (self.store).read(|reader| {
            read(reader, kind, Some(number), &mut Faults::strict(kind))?
                .ok_or_else(|| kind.no_generation(number))
        })
    }

    /// Commits new counts of these cells, and gives the generation.
    pub(crate) fn commit(&mut self, changes: &[(i64, i64)]) -> Result<u64> {
        self.commit_with(changes, || ())
    }

    /// [`commit`](Self::commit), with something to do before it ends.
    pub(crate) fn commit_with(
        &mut self,
        changes: &[(i64, i64)],
        meanwhile: impl FnOnce(),
    ) -> Result<u64> {
        let mut next = self.known.clone();
        next.counts.0.extend(changes.iter().copied());
        next.tip.number += 1;
        let tip = self.known.tip;
        let generation = (next.counts).generation(next.tip.number, Some(tip.number), tip.prunes);
        self.store.write(tip, |writer| {
            for &(cell, count) in changes {
                next.last_row += 1;
                let number = ValueRef::Integer(generation.number as i64);
                let [id, cell, count] = [next.last_row, cell, count].map(ValueRef::Integer);
                writer.insert(&CELL, &[id, number, cell, count])?;
            }
            writer.insert_generation(&generation)?;
            meanwhile();
            Ok(())
        })?;
        self.known = next;
        Ok(generation.number)
    }

    pub(crate) fn rollback(&mut self, to: u64) -> Result<u64> {
        let past = self.at(to)?;
        let tip = self.known.tip;
        let number = tip.number + 1;
        let generation = past.counts.generation(number, Some(to), tip.prunes);
        (self.store).write(tip, |writer| writer.insert_generation(&generation))?;
        self.known = Known {
            tip: Tip { number, ..tip },
            ..past
        };
        Ok(number)
    }

    /// Commits samples of a region, each with a remark; `anew`: those before no longer hold.
    pub(crate) fn sample(&mut self, region: i64, values: &[i64], anew: bool) -> Result<u64> {
        let tip = self.known.tip;
        let number = tip.number + 1;
        let generation = (self.known.counts).generation(number, Some(tip.number), tip.prunes);
        self.store.write(tip, |writer| {
            let [number, region] = [number as i64, region].map(ValueRef::Integer);
            if anew {
                writer.insert(&RESET, &[number, number, region])?;
            }
            for (at, &value) in values.iter().enumerate() {
                let id = ValueRef::Integer(100 * generation.number as i64 + at as i64);
                writer.insert(&SAMPLE, &[id, number, region, ValueRef::Integer(value)])?;
                writer.insert(&REMARK, &[id, number, ValueRef::Text(b"fine")])?;
            }
            writer.insert_generation(&generation)
        })?;
        self.known.tip.number = generation.number;
        Ok(generation.number)
    }

    /// The ids in a table.
    pub(crate) fn ids(&self, table: &Table) -> Vec<i64> {
        let sql = format!(
            "SELECT {0} FROM {1} ORDER BY {0}",
            table.columns[0], table.name
        );
        let mut statement = self.store.connection().prepare(&sql).expect("sound");
        let ids = statement.query_map([], |row| row.get(0)).expect("sound");
        ids.collect::<rusqlite::Result<_>>().expect("sound")
    }

    /// Keeps these generations; gives how many went.
    pub(crate) fn prune(&mut self, keep: &[u64]) -> Result<usize> {
        let kind = self.kind;
        let keep = keep.iter().copied().collect();
        let pruned = self.store.prune(
            self.known.tip,
            &keep,
            |reader| {
                read(reader, kind, None, &mut Faults::strict(kind))?
                    .ok_or_else(|| kind.no_generations())
            },
            |before, after| before.counts == after.counts,
        )?;
        let Some((known, num_dropped)) = pruned else {
            return Ok(0);
        };
        self.known = known;
        self.store.vacuum()?;
        Ok(num_dropped)
    }

    pub(crate) fn verify(kind: &'static Kind, path: &Path) -> Result<Vec<Fault>> {
        let read = |reader: &Reader<'_>, faults: &mut Faults| read(reader, kind, None, faults);
        Ok(Store::verify(kind, path, 100, check, read)?.1)
    }
}
