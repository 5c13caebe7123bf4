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
use super::types::{Edge, MapMeta, Node, PlaceKey, SessionId, Snapshot, Visit, VisitId};
use crate::error::{Error, ErrorKind, Result};
use crate::feature::{Features, Rect};
use crate::time::Time;

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
    pub(super) chains: Vec<ContentDigest>,
    pub(super) visit_ids: HashSet<VisitId>,
    pub(super) last_visit: i64,
    pub(super) last_pose: i64,
    pub(super) last_edge: i64,
    pub(super) meta_generation: u64,
    pub(super) edge_generation: u64,
}

/// One row of table `generation`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Generation {
    /// Counted from 0, the empty map.
    pub number: u64,
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
    pub(super) generations: Vec<Generation>,
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
        if stored == computed {
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

/// Appends to `state` (`None`: nothing is known yet) what the file holds beyond it. The connection
/// must be in a transaction. `trail`, where given, takes down what each generation added.
///
/// `Ok(None)`: the rows do not even name the map; the faults say why.
pub(super) fn load(
    connection: &Connection,
    state: Option<State>,
    faults: &mut Faults,
    mut trail: Option<&mut Trail>,
) -> Result<Option<State>> {
    let known = state.as_ref().map(|state| state.snapshot.generation);
    let generations = read_generations(connection, known, faults)?;
    let Some(last) = generations.last().cloned() else {
        if known.is_none() {
            faults.add(Fault::new(
                "generation",
                ErrorKind::Format,
                "there is no generation",
            ))?;
        }
        return Ok(state);
    };
    let metas = read_metas(connection, known, faults)?;
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
    read_places(connection, &mut state, faults, trail.as_deref_mut())?;
    read_poses(connection, &mut state, faults, trail.as_deref_mut())?;
    read_visits(connection, &mut state, faults, trail.as_deref_mut())?;
    read_edges(connection, &mut state, &last, faults, trail.as_deref_mut())?;
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

pub(super) fn read_generations(
    connection: &Connection,
    known: Option<u64>,
    faults: &mut Faults,
) -> Result<Vec<Generation>> {
    let mut generations: Vec<Generation> = Vec::new();
    let after = known.map_or(-1, |known| known as i64);
    scan(
        connection,
        &format::GENERATION,
        after,
        faults,
        |row, faults| {
            let expected = after + 1 + generations.len() as i64;
            if row.id != expected && faults.is_clean() {
                return Err(misfit(row, 0, format!("generation {expected} is missing")));
            }
            let digest = row.blob(7)?;
            generations.push(Generation {
                number: row.count(0)? as u64,
                time: Time::from_us(row.integer(1)?),
                meta: row.count(2)? as u64,
                edges: row.count(3)? as u64,
                num_places: row.count(4)?,
                num_visits: row.count(5)?,
                num_features: row.count(6)?,
                digest: digest.try_into().map_err(|_| {
                    let message = format!("{} bytes, where a digest has 32", digest.len());
                    row.fault(7, Some(digest.len()), message)
                })?,
            });
            Ok(())
        },
    )?;
    Ok(generations)
}

fn read_metas(
    connection: &Connection,
    known: Option<u64>,
    faults: &mut Faults,
) -> Result<Vec<(u64, MapMeta)>> {
    let mut metas = Vec::new();
    let after = known.map_or(-1, |known| known as i64);
    scan(connection, &format::META, after, faults, |row, _| {
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

fn read_places(
    connection: &Connection,
    state: &mut State,
    faults: &mut Faults,
    mut trail: Option<&mut Trail>,
) -> Result<()> {
    let mut keys: BTreeSet<PlaceKey> = state.snapshot.nodes.iter().map(|n| n.key.clone()).collect();
    let after = state.snapshot.nodes.len() as i64;
    scan(connection, &format::PLACE, after, faults, |row, faults| {
        let key = row.key(2)?;
        if !faults.is_clean() {
            return Ok(());
        }
        let expected = state.snapshot.nodes.len() as i64 + 1;
        if row.id != expected {
            return Err(misfit(row, 0, format!("place {expected} is missing")));
        }
        if !keys.insert(key.clone()) {
            return Err(misfit(row, 2, format!("there are two places `{key}`")));
        }
        let node = Node::new(key);
        state.chains.push(digest::first_link(&node));
        state.snapshot.nodes.push(Arc::new(node));
        if let Some(trail) = trail.as_deref_mut() {
            trail.places.push(row.count(1)? as u64);
        }
        Ok(())
    })
}

fn read_poses(
    connection: &Connection,
    state: &mut State,
    faults: &mut Faults,
    mut trail: Option<&mut Trail>,
) -> Result<()> {
    scan(
        connection,
        &format::POSE,
        state.last_pose,
        faults,
        |row, faults| {
            let pose = if (3..6).all(|column| row.is_null(column)) {
                None
            } else {
                Some([row.real(3)?, row.real(4)?, row.real(5)?])
            };
            let place = row.count(2)?;
            if !faults.is_clean() {
                return Ok(());
            }
            let Some(node) = place
                .checked_sub(1)
                .and_then(|at| state.snapshot.nodes.get_mut(at))
            else {
                return Err(misfit(row, 2, format!("there is no place {place}")));
            };
            Arc::make_mut(node).pose = pose;
            state.last_pose = row.id;
            if let Some(trail) = trail.as_deref_mut() {
                trail.poses.push((row.count(1)? as u64, place - 1, pose));
            }
            Ok(())
        },
    )
}

/// The rows of `table` (features or appearances), by visit.
fn read_features(
    connection: &Connection,
    table: &'static Table,
    after: i64,
    faults: &mut Faults,
) -> Result<BTreeMap<i64, Features>> {
    let mut all = BTreeMap::new();
    scan(connection, table, after, faults, |row, _| {
        all.insert(row.id, row.features(2, 3)?);
        Ok(())
    })?;
    Ok(all)
}

fn read_visits(
    connection: &Connection,
    state: &mut State,
    faults: &mut Faults,
    mut trail: Option<&mut Trail>,
) -> Result<()> {
    let after = state.last_visit;
    let mut born = read_features(connection, &format::FEATURE, after, faults)?;
    let mut appearances = read_features(connection, &format::APPEARANCE, after, faults)?;
    scan(connection, &format::VISIT, after, faults, |row, faults| {
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
        let place = row.count(2)?;
        let number = row.count(3)?;
        if !faults.is_clean() {
            return Ok(());
        }
        let at = place.wrapping_sub(1);
        let Some(node) = state.snapshot.nodes.get_mut(at) else {
            return Err(misfit(row, 2, format!("there is no place {place}")));
        };
        let expected = node.visits.len();
        if number != expected {
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
        state.last_visit = row.id;
        if let Some(trail) = trail.as_deref_mut() {
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
            && faults.is_clean()
        {
            faults.add(Fault {
                row: Some(row),
                column: Some("visit"),
                ..Fault::new(table.name, ErrorKind::Format, "there is no such visit")
            })?;
        }
    }
    Ok(())
}

fn read_edges(
    connection: &Connection,
    state: &mut State,
    last: &Generation,
    faults: &mut Faults,
    mut trail: Option<&mut Trail>,
) -> Result<()> {
    if state.edge_generation != last.edges {
        state.snapshot.edges.clear();
        state.edge_generation = last.edges;
    }
    let after = state.last_edge;
    scan(connection, &format::EDGE, after, faults, |row, _| {
        let edge = Edge {
            from: row.key(2)?,
            to: row.key(3)?,
            name: row.text(4)?.into(),
        };
        let generation = row.count(1)? as u64;
        if let Some(trail) = trail.as_deref_mut() {
            trail.edges.push((generation, edge.clone()));
        }
        if generation == last.edges {
            state.snapshot.edges.push(edge);
        }
        state.last_edge = row.id;
        Ok(())
    })
}

impl State {
    /// A file of which only the meta row is known.
    pub(super) fn empty(meta: MapMeta) -> Self {
        Self {
            snapshot: Snapshot::empty(meta),
            chains: Vec::new(),
            visit_ids: HashSet::new(),
            last_visit: 0,
            last_pose: 0,
            last_edge: 0,
            meta_generation: 0,
            edge_generation: 0,
        }
    }

    /// What a generation's row says of a map in this state; `time` is the caller's.
    pub(super) fn totals(&self, time: Time) -> Generation {
        let nodes = &self.snapshot.nodes;
        Generation {
            number: self.snapshot.generation,
            time,
            num_places: nodes.len(),
            num_visits: nodes.iter().map(|node| node.visits.len()).sum(),
            num_features: nodes.iter().map(|node| node.features.len()).sum(),
            digest: digest::of_chains(&self.snapshot, &self.chains),
            meta: self.meta_generation,
            edges: self.edge_generation,
        }
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
        if self.digest == found.digest {
            Ok(())
        } else {
            let message = "the rows are not those that were committed".to_string();
            Err(fault("digest", ErrorKind::Checksum, message))
        }
    }
}
