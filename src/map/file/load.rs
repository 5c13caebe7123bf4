//! What do the rows of a map file say, and is it what was written?
//!
//! Reading a whole file and reading what was committed since are the same function from different
//! starts. Every row is checked against its checksum, then the rows against each other, then all of
//! them against the digest of the last generation. [`Faults`] decides whether the first fault ends
//! the reading (opening) or is listed (verifying).

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::sync::Arc;

use rusqlite::Connection;
use rusqlite::types::ValueRef;

use super::digest::{self, ContentDigest};
use super::format::{self, Malformed, Table};
use crate::feature::{Features, Rect};
use crate::map::building::check_attachment;
use crate::map::types::{Edge, MapMeta, Node, PlaceKey, SessionId, Snapshot, Visit, VisitId};
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::Time;

/// Something in a map file that is not as it was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// The table, or `file` for what is below the tables.
    pub table: &'static str,
    /// The row's id: its first column.
    pub row: Option<i64>,
    /// The column.
    pub column: Option<&'static str>,
    /// The byte in that column, from 0 (of an integer or real: in its 8 little-endian bytes).
    pub byte: Option<usize>,
    /// What is wrong.
    pub message: String,
    kind: ErrorKind,
}

impl Fault {
    pub(super) fn new(table: &'static str, kind: ErrorKind, message: impl Into<String>) -> Self {
        Self {
            table,
            row: None,
            column: None,
            byte: None,
            message: message.into(),
            kind,
        }
    }

    /// The sort of fault.
    pub fn kind(&self) -> ErrorKind {
        self.kind
    }

    fn place(&self) -> String {
        let table = match self.table {
            "file" => "file".into(),
            table => format!("table {table}"),
        };
        [
            Some(table),
            self.row.map(|row| format!("row {row}")),
            self.column.map(|column| format!("column {column}")),
            self.byte.map(|byte| format!("byte {byte}")),
        ]
        .into_iter()
        .flatten()
        .collect::<Vec<_>>()
        .join(", ")
    }

    pub(super) fn into_error(self) -> Error {
        Error::new(self.kind, self.message.clone())
            .with_place(self.place())
            .with_help(
                "the file is damaged: restore a copy; `chronotope map verify` lists the faults",
            )
    }
}

impl std::fmt::Display for Fault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}", self.place(), self.message)
    }
}

/// The faults found so far.
#[derive(Debug)]
pub(super) struct Faults {
    pub(super) list: Vec<Fault>,
    limit: usize,
}

impl Faults {
    /// The first fault is an error.
    pub(super) fn strict() -> Self {
        Self {
            list: Vec::new(),
            limit: 0,
        }
    }

    /// The first `limit` faults are listed.
    pub(super) fn listing(limit: usize) -> Self {
        Self {
            list: Vec::new(),
            limit,
        }
    }

    pub(super) fn add(&mut self, fault: Fault) -> Result<()> {
        if self.list.len() < self.limit {
            self.list.push(fault);
            Ok(())
        } else {
            Err(fault.into_error())
        }
    }

    /// Whether rows may be held against each other: once one is missing, the rest cannot agree.
    pub(super) fn is_clean(&self) -> bool {
        self.list.is_empty()
    }
}

/// What is known of a map file: its last generation and where its rows end.
#[derive(Clone, Debug)]
pub(super) struct State {
    pub(super) snapshot: Snapshot,
    pub(super) version: u32,
    pub(super) parent: Option<u64>,
    pub(super) prunes: u64,
    pub(super) chains: Vec<ContentDigest>,
    /// The row of each place, ascending.
    pub(super) place_rows: Vec<i64>,
    pub(super) visit_ids: HashSet<VisitId>,
    /// The digest of each attachment.
    pub(super) attachments: BTreeMap<String, ContentDigest>,
    pub(super) last_place: i64,
    pub(super) last_visit: i64,
    pub(super) last_pose: i64,
    pub(super) last_edge: i64,
    pub(super) last_attachment: i64,
    pub(super) meta_generation: u64,
    pub(super) edge_generation: u64,
}

/// One row of table `generation`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Generation {
    /// Counted from 0, the empty map.
    pub number: u64,
    /// The generation that this one extends; `None` for 0.
    pub parent: Option<u64>,
    pub(super) prunes: u64,
    /// When it was committed.
    pub time: Time,
    /// Places after it.
    pub num_places: usize,
    /// Visits after it.
    pub num_visits: usize,
    /// Features after it, without those of appearances.
    pub num_features: usize,
    /// [`Snapshot::digest`] after it.
    pub digest: ContentDigest,
    pub(super) meta: u64,
    pub(super) edges: u64,
}

/// What one generation added, for a later check of every generation's digest.
#[derive(Debug, Default)]
pub(super) struct Trail {
    pub(super) metas: Vec<(u64, MapMeta)>,
    pub(super) edges: Vec<(u64, Edge)>,
    pub(super) places: Vec<u64>,
    pub(super) poses: Vec<(u64, usize, Option<[f64; 3]>)>,
    /// Generation, place, chain after the visit, features born at it.
    pub(super) links: Vec<(u64, usize, ContentDigest, usize)>,
    /// Generation, name, digest of the value; `None` where it went.
    pub(super) attachments: Vec<(u64, String, Option<ContentDigest>)>,
    pub(super) generations: Vec<Generation>,
}

/// Which rows belong to the generation that is read: those of its line, from the oldest ancestor on.
#[derive(Debug)]
struct Lineage {
    /// Every new generation of the file.
    all: BTreeSet<u64>,
    /// Those of the line.
    line: BTreeSet<u64>,
}

impl Lineage {
    /// The new generations that lead to `at` (the newest where not given), ascending; `None` if they
    /// do not start from `known`.
    fn trace(
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

    /// Whether the row, whose generation stands in `column`, belongs to the line.
    fn holds(&self, row: &Row<'_>, column: usize) -> Result<bool, Fault> {
        let generation = row.count(column)? as u64;
        if self.all.contains(&generation) {
            Ok(self.line.contains(&generation))
        } else {
            Err(misfit(
                row,
                column,
                format!("there is no generation {generation}"),
            ))
        }
    }
}

/// One row whose checksum holds.
struct Row<'a> {
    table: &'static Table,
    id: i64,
    values: &'a [ValueRef<'a>],
}

impl<'a> Row<'a> {
    fn check_crc(&self, crc: ValueRef<'_>) -> Result<(), Fault> {
        let computed = format::row_crc(self.table, self.values);
        let fault = |column, byte, message: String| Fault {
            row: Some(self.id),
            column,
            byte,
            ..Fault::new(self.table.name, ErrorKind::Checksum, message)
        };
        let stored = match crc {
            ValueRef::Integer(stored) => u32::try_from(stored).ok(),
            _ => None,
        };
        let Some(stored) = stored else {
            return Err(fault(
                Some("crc"),
                None,
                "a checksum is an integer of 32 bits".into(),
            ));
        };
        // A fuzzer cannot guess checksums, and what lies behind them must be sound as well.
        if stored == computed || cfg!(fuzzing) {
            return Ok(());
        }
        let message = format!("the checksum is {computed:08x}, not {stored:08x} as written");
        Err(match format::locate_flip(self.table, self.values, stored) {
            Some((column, byte)) => fault(
                Some(column.unwrap_or("crc")),
                Some(byte),
                format!("{message}: one bit has flipped"),
            ),
            None => fault(None, None, message),
        })
    }

    fn fault(&self, column: usize, byte: Option<usize>, message: impl Into<String>) -> Fault {
        Fault {
            row: Some(self.id),
            column: Some(self.table.columns[column]),
            byte,
            ..Fault::new(self.table.name, ErrorKind::Format, message)
        }
    }

    fn malformed(&self, column: usize) -> impl FnOnce(Malformed) -> Fault {
        let fault = self.fault(column, None, "");
        move |malformed| Fault {
            byte: Some(malformed.byte),
            message: malformed.message,
            ..fault
        }
    }

    fn wrong(&self, column: usize, wanted: &str) -> Fault {
        let found = self.values[column].data_type();
        self.fault(column, None, format!("{wanted} expected, {found} found"))
    }

    fn integer(&self, column: usize) -> Result<i64, Fault> {
        match self.values[column] {
            ValueRef::Integer(integer) => Ok(integer),
            _ => Err(self.wrong(column, "an integer")),
        }
    }

    fn count(&self, column: usize) -> Result<usize, Fault> {
        let integer = self.integer(column)?;
        usize::try_from(integer).map_err(|_| {
            self.fault(
                column,
                None,
                format!("a count cannot be negative ({integer})"),
            )
        })
    }

    fn real(&self, column: usize) -> Result<f64, Fault> {
        match self.values[column] {
            ValueRef::Real(real) if real.is_finite() => Ok(real),
            _ => Err(self.wrong(column, "a finite real")),
        }
    }

    fn text(&self, column: usize) -> Result<&'a str, Fault> {
        let ValueRef::Text(text) = self.values[column] else {
            return Err(self.wrong(column, "a text"));
        };
        std::str::from_utf8(text)
            .map_err(|error| self.fault(column, Some(error.valid_up_to()), "this is no UTF-8"))
    }

    fn blob(&self, column: usize) -> Result<&'a [u8], Fault> {
        match self.values[column] {
            ValueRef::Blob(blob) => Ok(blob),
            _ => Err(self.wrong(column, "a blob")),
        }
    }

    fn is_null(&self, column: usize) -> bool {
        self.values[column] == ValueRef::Null
    }

    fn bits_128(&self, column: usize) -> Result<u128, Fault> {
        let blob = self.blob(column)?;
        let bytes = blob.try_into().map_err(|_| {
            self.fault(
                column,
                Some(blob.len().min(16)),
                format!("{} bytes, where an identity has 16", blob.len()),
            )
        })?;
        Ok(u128::from_be_bytes(bytes))
    }

    fn key(&self, column: usize) -> Result<PlaceKey, Fault> {
        PlaceKey::new(self.text(column)?)
            .map_err(|error| self.fault(column, None, error.to_string()))
    }

    fn features(&self, keypoints: usize, descriptors: usize) -> Result<Features, Fault> {
        let decoded_keypoints =
            format::decode_keypoints(self.blob(keypoints)?).map_err(self.malformed(keypoints))?;
        let decoded_descriptors = format::decode_descriptors(self.blob(descriptors)?)
            .map_err(self.malformed(descriptors))?;
        format::pair(decoded_keypoints, decoded_descriptors).map_err(self.malformed(descriptors))
    }
}

/// What SQLite says of a table: a fault, or an error if the file is not to blame.
pub(super) fn from_sqlite(
    table: &'static str,
    row: Option<i64>,
    error: &rusqlite::Error,
) -> Result<Fault> {
    use rusqlite::ErrorCode::{DatabaseCorrupt, NotADatabase, OutOfMemory, SchemaChanged, Unknown};
    match error.sqlite_error_code() {
        // `Unknown` are errors of SQL, such as "no such column", which a damaged schema gives.
        None | Some(DatabaseCorrupt | NotADatabase | OutOfMemory | SchemaChanged | Unknown) => {
            Ok(Fault {
                row,
                ..Fault::new(table, ErrorKind::Format, format!("SQLite: {error}"))
            })
        }
        Some(_) => Err(super::store::sqlite_error(error)),
    }
}

/// Hands every sound row of `table` with an id above `after` to `each`, in order of id.
fn scan(
    connection: &Connection,
    table: &'static Table,
    after: i64,
    faults: &mut Faults,
    mut each: impl FnMut(&Row<'_>, &Faults) -> Result<(), Fault>,
) -> Result<()> {
    let mut last = None;
    match scan_rows(connection, table, after, faults, &mut last, &mut each) {
        Ok(stopped) => stopped,
        Err(error) => faults.add(from_sqlite(table.name, last, &error)?),
    }
}

/// The outer error is SQLite's, the inner one that of a fault too many.
fn scan_rows(
    connection: &Connection,
    table: &'static Table,
    after: i64,
    faults: &mut Faults,
    last: &mut Option<i64>,
    each: &mut impl FnMut(&Row<'_>, &Faults) -> Result<(), Fault>,
) -> rusqlite::Result<Result<()>> {
    let id_column = table.columns[0];
    // Sizes are in the head of a row: nothing too large is ever loaded.
    let too_large: Vec<String> = table
        .limits
        .iter()
        .map(|(column, limit)| format!("octet_length({column}) > {limit}"))
        .collect();
    if !too_large.is_empty() {
        let mut statement = connection.prepare(&format!(
            "SELECT {id_column}, {} FROM {} WHERE {id_column} > ?1 AND ({})",
            too_large.join(", "),
            table.name,
            too_large.join(" OR ")
        ))?;
        let mut rows = statement.query([after])?;
        while let Some(row) = rows.next()? {
            for (at, (column, limit)) in table.limits.iter().enumerate() {
                if row.get(at + 1)? {
                    let message = format!("more than {limit} bytes");
                    return Ok(faults.add(Fault {
                        row: Some(row.get(0)?),
                        column: Some(column),
                        byte: Some(*limit),
                        ..Fault::new(table.name, ErrorKind::Format, message)
                    }));
                }
            }
        }
    }
    let mut statement = connection.prepare(&format!(
        "SELECT {}, crc FROM {} WHERE {id_column} > ?1 ORDER BY {id_column}",
        table.columns.join(", "),
        table.name
    ))?;
    let mut rows = statement.query([after])?;
    while let Some(row) = rows.next()? {
        let values = (0..table.columns.len())
            .map(|column| row.get_ref(column))
            .collect::<rusqlite::Result<Vec<_>>>()?;
        let crc = row.get_ref(table.columns.len())?;
        // The first column is SQLite's own row id.
        let id = values[0].as_i64()?;
        *last = Some(id);
        let row = Row {
            table,
            id,
            values: &values,
        };
        if let Err(fault) = row.check_crc(crc).and_then(|()| each(&row, faults))
            && let Err(error) = faults.add(fault)
        {
            return Ok(Err(error));
        }
    }
    Ok(Ok(()))
}

/// Why a row cannot follow the rows before it.
fn misfit(row: &Row<'_>, column: usize, message: impl Into<String>) -> Fault {
    row.fault(column, None, message)
}

/// The format that the file says it has.
pub(super) fn format_version(connection: &Connection) -> Result<u32> {
    let read = connection.query_row("PRAGMA user_version", [], |row| row.get(0));
    let version = read.map_err(|error| super::store::sqlite_error(&error))?;
    if (1..=format::VERSION).contains(&version) {
        Ok(version)
    } else {
        Err(Error::new(
            ErrorKind::Format,
            format!(
                "the map has format {version}; this program reads formats up to {}",
                format::VERSION
            ),
        ))
    }
}

/// Appends to `state` (`None`: nothing is known yet) what the file holds beyond it, or reads
/// everything anew if what the file holds now does not follow from it.
pub(super) fn catch_up(connection: &Connection, state: State) -> Result<Option<State>> {
    let version = format_version(connection)?;
    let known = state.snapshot.generation;
    let newer = read_generations(connection, version, Some(known), &mut Faults::strict())?;
    let follows = newer.iter().all(|it| it.prunes == state.prunes)
        && Lineage::trace(&newer, Some(known), None).is_some();
    let state = follows.then_some(state);
    load(connection, state, None, &mut Faults::strict(), None)
}

/// Appends to `state` (`None`: nothing is known yet) what the file holds beyond it, up to the
/// generation `at` (the newest where not given). The connection must be in a transaction. `trail`,
/// where given, takes down what each generation of the line added.
///
/// `Ok(None)`: the rows do not even name the map; the faults say why.
pub(super) fn load(
    connection: &Connection,
    state: Option<State>,
    at: Option<u64>,
    faults: &mut Faults,
    mut trail: Option<&mut Trail>,
) -> Result<Option<State>> {
    let version = format_version(connection)?;
    let known = state.as_ref().map(|state| state.snapshot.generation);
    let generations = read_generations(connection, version, known, faults)?;
    if generations.is_empty() {
        if known.is_none() {
            faults.add(Fault::new(
                "generation",
                ErrorKind::Format,
                "there is no generation",
            ))?;
        }
        return Ok(state);
    }
    let (lineage, generations) = match Lineage::trace(&generations, known, at) {
        Some(traced) => traced,
        None if faults.is_clean() => return Err(no_generation(at.unwrap_or_default())),
        // A row is missing, which is listed already; all that is left is taken for one line.
        None => {
            let all: BTreeSet<u64> = generations.iter().map(|it| it.number).collect();
            let line = all.clone();
            (Lineage { all, line }, generations)
        }
    };
    let Some(last) = generations.last().cloned() else {
        return Ok(state);
    };
    let metas = read_metas(connection, known, &lineage, faults)?;
    let mut state = match (state, metas.last()) {
        (Some(state), _) => state,
        (None, Some((_, meta))) => State::empty(meta.clone()),
        (None, None) => {
            faults.add(Fault::new("meta", ErrorKind::Format, "there is no row"))?;
            return Ok(None);
        }
    };
    if let Some((generation, meta)) = metas.last() {
        state.snapshot.meta = meta.clone();
        state.meta_generation = *generation;
    }
    let mut reading = Reading {
        connection,
        lineage: &lineage,
        faults,
        trail: trail.as_deref_mut(),
    };
    reading.read_places(&mut state)?;
    reading.read_poses(&mut state)?;
    reading.read_visits(&mut state)?;
    reading.read_edges(&mut state, &last)?;
    if version > 1 {
        reading.read_attachments(&mut state)?;
    }
    state.version = version;
    state.parent = last.parent;
    state.prunes = last.prunes;
    state.snapshot.generation = last.number;
    if faults.is_clean() {
        state
            .check_against(&last)
            .or_else(|fault| faults.add(fault))?;
    }
    if let Some(trail) = trail {
        trail.metas = metas;
        trail.generations = generations;
    }
    Ok(Some(state))
}

/// What holds for the whole map at its newest generation; `None` where there is none.
pub(super) fn read_newest_meta(connection: &Connection) -> Result<Option<MapMeta>> {
    let version = format_version(connection)?;
    let faults = &mut Faults::strict();
    let generations = read_generations(connection, version, None, faults)?;
    let Some((lineage, _)) = Lineage::trace(&generations, None, None) else {
        return Ok(None);
    };
    let metas = read_metas(connection, None, &lineage, faults)?;
    Ok(metas.into_iter().last().map(|(_, meta)| meta))
}

/// What to say where the file has no such generation.
pub(super) fn no_generation(number: u64) -> Error {
    Error::new(
        ErrorKind::Config,
        format!("the map has no generation {number}"),
    )
    .with_help("`chronotope map log` lists the generations that it has")
}

/// The rows of `generation` after `known`, ascending.
pub(super) fn read_generations(
    connection: &Connection,
    version: u32,
    known: Option<u64>,
    faults: &mut Faults,
) -> Result<Vec<Generation>> {
    let mut generations: Vec<Generation> = Vec::new();
    let after = known.map_or(-1, |known| known as i64);
    // Format 1 had no branches: there a parent is the number before, and nothing was pruned.
    let (table, first) = match version {
        1 => (&format::GENERATION_1, 1),
        _ => (&format::GENERATION, 3),
    };
    scan(connection, table, after, faults, |row, faults| {
        let number = row.count(0)? as u64;
        let (parent, prunes) = if version == 1 {
            (number.checked_sub(1), 0)
        } else if row.is_null(1) {
            (None, row.count(2)? as u64)
        } else {
            (Some(row.count(1)? as u64), row.count(2)? as u64)
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
            return Err(misfit(row, usize::from(version > 1), message));
        }
        let digest = row.blob(first + 6)?;
        generations.push(Generation {
            number,
            parent,
            prunes,
            time: Time::from_us(row.integer(first)?),
            meta: row.count(first + 1)? as u64,
            edges: row.count(first + 2)? as u64,
            num_places: row.count(first + 3)?,
            num_visits: row.count(first + 4)?,
            num_features: row.count(first + 5)?,
            digest: digest.try_into().map_err(|_| {
                let message = format!("{} bytes, where a digest has 32", digest.len());
                row.fault(first + 6, Some(digest.len()), message)
            })?,
        });
        Ok(())
    })?;
    Ok(generations)
}

fn read_metas(
    connection: &Connection,
    known: Option<u64>,
    lineage: &Lineage,
    faults: &mut Faults,
) -> Result<Vec<(u64, MapMeta)>> {
    let mut metas = Vec::new();
    let after = known.map_or(-1, |known| known as i64);
    scan(connection, &format::META, after, faults, |row, _| {
        if !lineage.holds(row, 0)? {
            return Ok(());
        }
        let number = |column| match row.values[column] {
            ValueRef::Null => Ok(None),
            _ => u32::try_from(row.integer(column)?)
                .map(Some)
                .map_err(|_| row.fault(column, None, "this is no number of pixels")),
        };
        let image_size = match (number(3)?, number(4)?) {
            (Some(width), Some(height)) => Some((width, height)),
            (None, None) => None,
            _ => return Err(misfit(row, 3, "an image has both a width and a height")),
        };
        let crop = match (number(5)?, number(6)?, number(7)?, number(8)?) {
            (Some(x), Some(y), Some(width), Some(height)) => Some(Rect {
                x,
                y,
                width,
                height,
            }),
            (None, None, None, None) => None,
            _ => return Err(misfit(row, 5, "a crop has four numbers or none")),
        };
        metas.push((
            row.count(0)? as u64,
            MapMeta {
                uuid: row.bits_128(1)?,
                extractor: row.text(2)?.into(),
                image_size,
                crop,
                preset: row.text(9)?.into(),
                zone: match row.values[10] {
                    ValueRef::Null => None,
                    _ => Some(row.text(10)?.into()),
                },
            },
        ));
        Ok(())
    })?;
    Ok(metas)
}

/// One reading of a file's rows.
struct Reading<'a> {
    connection: &'a Connection,
    lineage: &'a Lineage,
    faults: &'a mut Faults,
    trail: Option<&'a mut Trail>,
}

impl Reading<'_> {
    /// Hands every sound row with an id above `after` to `each`, with whether it is of the line.
    fn scan(
        &mut self,
        table: &'static Table,
        after: i64,
        mut each: impl FnMut(&Row<'_>, bool, &Faults, Option<&mut Trail>) -> Result<(), Fault>,
    ) -> Result<()> {
        let Self {
            connection,
            lineage,
            faults,
            trail,
        } = self;
        scan(connection, table, after, faults, |row, faults| {
            let is_of_line = lineage.holds(row, 1)?;
            each(row, is_of_line, faults, trail.as_deref_mut())
        })
    }

    fn read_places(&mut self, state: &mut State) -> Result<()> {
        let mut keys: BTreeSet<PlaceKey> =
            state.snapshot.nodes.iter().map(|n| n.key.clone()).collect();
        let after = state.last_place;
        self.scan(&format::PLACE, after, |row, is_of_line, faults, trail| {
            let key = row.key(2)?;
            if !faults.is_clean() {
                return Ok(());
            }
            state.last_place = row.id;
            if !is_of_line {
                return Ok(());
            }
            if !keys.insert(key.clone()) {
                return Err(misfit(row, 2, format!("there are two places `{key}`")));
            }
            let node = Node::new(key);
            state.chains.push(digest::first_link(&node));
            state.place_rows.push(row.id);
            state.snapshot.nodes.push(Arc::new(node));
            if let Some(trail) = trail {
                trail.places.push(row.count(1)? as u64);
            }
            Ok(())
        })
    }

    fn read_poses(&mut self, state: &mut State) -> Result<()> {
        let after = state.last_pose;
        self.scan(&format::POSE, after, |row, is_of_line, faults, trail| {
            let pose = if (3..6).all(|column| row.is_null(column)) {
                None
            } else {
                Some([row.real(3)?, row.real(4)?, row.real(5)?])
            };
            state.last_pose = row.id;
            if !faults.is_clean() || !is_of_line {
                return Ok(());
            }
            let at = state.place_at(row, 2)?;
            Arc::make_mut(&mut state.snapshot.nodes[at]).pose = pose;
            if let Some(trail) = trail {
                trail.poses.push((row.count(1)? as u64, at, pose));
            }
            Ok(())
        })
    }

    /// The rows of `table` (features or appearances) that are of the line, by visit.
    fn read_features(
        &mut self,
        table: &'static Table,
        after: i64,
    ) -> Result<BTreeMap<i64, Features>> {
        let mut all = BTreeMap::new();
        self.scan(table, after, |row, is_of_line, _, _| {
            let features = row.features(2, 3)?;
            if is_of_line {
                all.insert(row.id, features);
            }
            Ok(())
        })?;
        Ok(all)
    }

    fn read_visits(&mut self, state: &mut State) -> Result<()> {
        let after = state.last_visit;
        let mut born = self.read_features(&format::FEATURE, after)?;
        let mut appearances = self.read_features(&format::APPEARANCE, after)?;
        self.scan(&format::VISIT, after, |row, is_of_line, faults, trail| {
            let num_features = row.count(9)?;
            if num_features > format::MAX_FEATURES {
                let message = format!("a place holds at most {} features", format::MAX_FEATURES);
                return Err(misfit(row, 9, message));
            }
            let bits = |column| {
                format::decode_bits(row.blob(column)?, num_features).map_err(row.malformed(column))
            };
            let seen = bits(10)?;
            let hidden = if row.is_null(11) {
                None
            } else {
                Some(bits(11)?)
            };
            let visit = Visit {
                id: VisitId(row.bits_128(4)?),
                session: SessionId(row.bits_128(5)?),
                time: Time::from_us(row.integer(6)?),
                source: row.text(7)?.into(),
                appearance: appearances.remove(&row.id).map(Arc::new),
                appearance_use: digest::use_named(row.text(8)?)
                    .ok_or_else(|| misfit(row, 8, "neither `experience` nor `recognised`"))?,
            };
            let born = born.remove(&row.id).unwrap_or_default();
            let located_by = row.blob(12)?;
            let number = row.count(3)?;
            state.last_visit = row.id;
            if !faults.is_clean() || !is_of_line {
                return Ok(());
            }
            let at = state.place_at(row, 2)?;
            let node = &mut state.snapshot.nodes[at];
            let expected = node.visits.len();
            if number != expected {
                let place = row.count(2)?;
                let message = format!("visit {expected} of place {place} is missing");
                return Err(misfit(row, 3, message));
            }
            if !state.visit_ids.insert(visit.id) {
                let message = format!("visit {} is in the map twice", visit.id);
                return Err(misfit(row, 4, message));
            }
            let node = Arc::make_mut(node);
            let num_experiences = node.num_experiences_after(visit.appearance_use);
            let located_by =
                format::decode_bits(located_by, num_experiences).map_err(row.malformed(12))?;
            node.push_visit(visit, &born, seen, hidden, located_by)
                .map_err(|error| misfit(row, 9, error.to_string()))?;
            state.chains[at] = digest::next_link(&state.chains[at], node, number);
            if let Some(trail) = trail {
                trail
                    .links
                    .push((row.count(1)? as u64, at, state.chains[at], born.len()));
            }
            Ok(())
        })?;
        for (table, left) in [
            (&format::FEATURE, born.keys().next()),
            (&format::APPEARANCE, appearances.keys().next()),
        ] {
            if let Some(&row) = left
                && self.faults.is_clean()
            {
                self.faults.add(Fault {
                    row: Some(row),
                    column: Some("visit"),
                    ..Fault::new(table.name, ErrorKind::Format, "there is no such visit")
                })?;
            }
        }
        Ok(())
    }

    fn read_edges(&mut self, state: &mut State, last: &Generation) -> Result<()> {
        if state.edge_generation != last.edges {
            state.snapshot.edges.clear();
            state.edge_generation = last.edges;
        }
        let after = state.last_edge;
        self.scan(&format::EDGE, after, |row, is_of_line, _, trail| {
            let edge = Edge {
                from: row.key(2)?,
                to: row.key(3)?,
                name: row.text(4)?.into(),
            };
            state.last_edge = row.id;
            if !is_of_line {
                return Ok(());
            }
            let generation = row.count(1)? as u64;
            if let Some(trail) = trail {
                trail.edges.push((generation, edge.clone()));
            }
            if generation == last.edges {
                state.snapshot.edges.push(edge);
            }
            Ok(())
        })
    }

    fn read_attachments(&mut self, state: &mut State) -> Result<()> {
        let after = state.last_attachment;
        self.scan(
            &format::ATTACHMENT,
            after,
            |row, is_of_line, faults, trail| {
                let (name, value) = (row.text(2)?, row.blob(3)?);
                check_attachment(name, value).map_err(|error| misfit(row, 2, error.to_string()))?;
                state.last_attachment = row.id;
                if !faults.is_clean() || !is_of_line {
                    return Ok(());
                }
                let digest = (!value.is_empty()).then(|| digest::of_attachment(value));
                if let Some(digest) = digest {
                    state.attachments.insert(name.into(), digest);
                    (state.snapshot.attachments).insert(name.into(), value.into());
                } else {
                    state.attachments.remove(name);
                    state.snapshot.attachments.remove(name);
                }
                if let Some(trail) = trail {
                    (trail.attachments).push((row.count(1)? as u64, name.into(), digest));
                }
                Ok(())
            },
        )
    }
}

impl State {
    /// A file of which only the meta row is known.
    pub(super) fn empty(meta: MapMeta) -> Self {
        Self {
            snapshot: Snapshot::empty(meta),
            version: format::VERSION,
            parent: None,
            prunes: 0,
            chains: Vec::new(),
            place_rows: Vec::new(),
            visit_ids: HashSet::new(),
            attachments: BTreeMap::new(),
            last_place: 0,
            last_visit: 0,
            last_pose: 0,
            last_edge: 0,
            last_attachment: 0,
            meta_generation: 0,
            edge_generation: 0,
        }
    }

    /// What a generation's row says of a map in this state; `time` is the caller's.
    pub(super) fn totals(&self, time: Time) -> Generation {
        let nodes = &self.snapshot.nodes;
        Generation {
            number: self.snapshot.generation,
            parent: self.parent,
            prunes: self.prunes,
            time,
            num_places: nodes.len(),
            num_visits: nodes.iter().map(|node| node.visits.len()).sum(),
            num_features: nodes.iter().map(|node| node.features.len()).sum(),
            digest: digest::of_chains(&self.snapshot, &self.chains, &self.attachments),
            meta: self.meta_generation,
            edges: self.edge_generation,
        }
    }

    /// The position of the place whose row stands in `column`.
    fn place_at(&self, row: &Row<'_>, column: usize) -> Result<usize, Fault> {
        let place = row.integer(column)?;
        (self.place_rows.binary_search(&place))
            .map_err(|_| misfit(row, column, format!("there is no place {place}")))
    }

    fn check_against(&self, last: &Generation) -> Result<(), Fault> {
        last.compare(&self.totals(last.time))?;
        self.snapshot
            .check_frame()
            .map_err(|error| Fault::new("edge", ErrorKind::Format, error.to_string()))
    }
}

impl Generation {
    /// Whether the rows give what was written down at the commit.
    pub(super) fn compare(&self, found: &Self) -> Result<(), Fault> {
        let fault = |column, kind, message: String| Fault {
            row: Some(self.number as i64),
            column: Some(column),
            ..Fault::new("generation", kind, message)
        };
        for (column, written, found) in [
            ("meta", self.meta, found.meta),
            (
                "num_places",
                self.num_places as u64,
                found.num_places as u64,
            ),
            (
                "num_visits",
                self.num_visits as u64,
                found.num_visits as u64,
            ),
            (
                "num_features",
                self.num_features as u64,
                found.num_features as u64,
            ),
        ] {
            if written != found {
                let message = format!("{written} were written, {found} are found");
                return Err(fault(column, ErrorKind::Format, message));
            }
        }
        if self.digest == found.digest || cfg!(fuzzing) {
            Ok(())
        } else {
            let message = "the rows are not those that were committed".to_string();
            Err(fault("digest", ErrorKind::Checksum, message))
        }
    }
}
