//! Which generations has a grid's file, and what does each hold?

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use chronotope_store::{
    Access, Fault, Faults, Generation, Lineage, Reader, Row, Store, Tip, ValueRef, Writer,
    put_value,
};
use fremen::{Error, ErrorKind, Result, Time};
use sha2::{Digest, Sha256};

use super::codec::{decode_observations, decode_tile, encode_observations, encode_tile};
use super::tables::{ATTACHMENT, BATCH, GRID, RESET, SPEC, TILE};
use crate::cells::GridSpec;
use crate::history::{History, Observations, Tile};
use crate::tiles::Tiling;

/// Bytes of a page.
const PAGE_BYTES: u32 = 4096;
/// How many faults [`GridFile::verify`] lists at most.
const MAX_FAULTS: usize = 100;
/// There is one line of observations; the tables could hold more.
const LINE: i64 = 0;

/// What is kept beside the observations, by name.
pub type Attachments = BTreeMap<String, Vec<u8>>;
/// The attachments of this name and of names that begin so are no part of a generation's digest: they
/// depend on the order in which maps came, which what was seen does not.
pub const UNDIGESTED: &str = "past";

/// A grid in a file.
#[derive(Debug)]
pub struct GridFile {
    store: Store,
    known: Known,
}

/// What was read of a file.
#[derive(Clone, Debug)]
struct Known {
    history: History,
    attachments: Attachments,
    tip: Tip,
    last: LastRows,
}

/// The ids of the last rows.
#[derive(Clone, Copy, Debug, Default)]
struct LastRows {
    batch: i64,
    tile: i64,
    attachment: i64,
}

/// What [`GridFile::verify`] found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Verified {
    /// The newest generation, where it could be read.
    pub generation: Option<u64>,
    /// What is not as it was written; empty for a sound file.
    pub faults: Vec<Fault>,
}

impl GridFile {
    /// Makes a new file that holds a history; one that exists is never overwritten.
    ///
    /// Generation 0 is an empty grid, generation 1 has the history. Both are there once this
    /// returns, or no file at all.
    pub fn create(path: impl AsRef<Path>, history: History) -> Result<Self> {
        Self::create_with(path, history, Attachments::new())
    }

    /// The same with attachments; those without a value are left out.
    pub fn create_with(
        path: impl AsRef<Path>,
        history: History,
        mut attachments: Attachments,
    ) -> Result<Self> {
        attachments.retain(|_, value| !value.is_empty());
        let nothing = (History::new(*history.spec()), Attachments::new());
        let first = generation(&nothing.0, &nothing.1, 0, None, 0);
        let second = generation(&history, &attachments, 1, Some(0), 0);
        let mut known = Known {
            tip: Tip {
                number: 1,
                prunes: 0,
            },
            last: LastRows::default(),
            history,
            attachments,
        };
        let store = Store::create(&GRID, path.as_ref(), PAGE_BYTES, check, |writer| {
            write_spec(writer, known.history.spec())?;
            writer.insert_generation(&first)?;
            known.last = write_batch(writer, &known.history, known.last, 1)?;
            known.last = write_attachments(writer, &known.attachments, known.last, 1)?;
            writer.insert_generation(&second)
        })?;
        Ok(Self { store, known })
    }

    /// Opens a file and reads its newest generation.
    pub fn open(path: impl AsRef<Path>, access: Access) -> Result<Self> {
        let (store, known) = Store::open(&GRID, path.as_ref(), access, check, read_newest)?;
        Ok(Self { store, known })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        self.store.path()
    }

    /// Whether a change is known to fail: it was opened to be read, or may not be written.
    pub fn is_read_only(&self) -> bool {
        self.store.is_read_only()
    }

    /// What the newest generation holds.
    pub const fn history(&self) -> &History {
        &self.known.history
    }

    /// What the newest generation keeps beside it.
    pub const fn attachments(&self) -> &Attachments {
        &self.known.attachments
    }

    /// Gives the history away.
    pub fn into_history(self) -> History {
        self.known.history
    }

    /// The number of the newest generation.
    pub const fn generation(&self) -> u64 {
        self.known.tip.number
    }

    /// Bytes of the file.
    pub fn num_bytes(&self) -> Result<u64> {
        self.store.num_bytes()
    }

    /// All generations, oldest first.
    pub fn generations(&mut self) -> Result<Vec<Generation>> {
        self.store
            .read(|reader| reader.generations(None, &mut Faults::strict(&GRID)))
    }

    /// What a generation held.
    pub fn at(&mut self, number: u64) -> Result<History> {
        self.read_at(number).map(|known| known.history)
    }

    fn read_at(&mut self, number: u64) -> Result<Known> {
        self.store.read(|reader| {
            let found = read(reader, Some(number), &mut Faults::strict(&GRID))?;
            found.ok_or_else(|| GRID.no_generation(number))
        })
    }

    /// Commits the observations of another history that this one does not have; gives how many
    /// they are. Without any, no generation is made.
    ///
    /// # Errors
    /// As for [`History::merge`]; [`ErrorKind::Conflict`] where another process has committed
    /// meanwhile. The file and what was read of it stay as they were.
    pub fn add(&mut self, other: &History) -> Result<usize> {
        self.add_with(other, &Attachments::new())
    }

    /// The same, and these attachments instead of those of the same names; an empty value takes one
    /// away. Without any change no generation is made.
    pub fn add_with(&mut self, other: &History, attachments: &Attachments) -> Result<usize> {
        let mut next = self.known.clone();
        let num_new = next.history.merge(other)?;
        let mut changed = attachments.clone();
        changed.retain(|name, value| {
            let known = next.attachments.get(name);
            known.map_or(!value.is_empty(), |known| known != value)
        });
        if num_new == 0 && changed.is_empty() {
            return Ok(0);
        }
        for (name, value) in &changed {
            if value.is_empty() {
                next.attachments.remove(name);
            } else {
                next.attachments.insert(name.clone(), value.clone());
            }
        }
        let nothing = History::new(*other.spec());
        let new = if num_new == 0 { &nothing } else { other };
        self.commit(next, new, &changed, false)?;
        Ok(num_new)
    }

    /// Forgets all observations before a time, from the next generation on; gives how many.
    ///
    /// Earlier generations still have them until the file is [pruned](Self::prune).
    pub fn forget_before(&mut self, time: Time) -> Result<usize> {
        let mut next = self.known.clone();
        let forgotten = next.history.forget_before(time);
        if forgotten.num_observations == 0 {
            return Ok(0);
        }
        let rest = next.history.clone();
        self.commit(next, &rest, &Attachments::new(), true)?;
        Ok(forgotten.num_observations)
    }

    /// Makes the content of an earlier generation the newest; gives the number of that one.
    pub fn rollback(&mut self, to: u64) -> Result<u64> {
        let mut past = self.read_at(to)?;
        let tip = self.known.tip;
        past.tip = Tip {
            number: tip.number + 1,
            ..tip
        };
        let generation = generation(
            &past.history,
            &past.attachments,
            past.tip.number,
            Some(to),
            tip.prunes,
        );
        self.store
            .write(tip, |writer| writer.insert_generation(&generation))?;
        self.known = past;
        Ok(generation.number)
    }

    /// Forgets all generations but the newest and those in `keep`, and frees their room; gives
    /// how many went.
    pub fn prune(&mut self, keep: &[u64]) -> Result<usize> {
        let keep: BTreeSet<u64> = keep.iter().copied().collect();
        let same = |a: &Known, b: &Known| a.history == b.history && a.attachments == b.attachments;
        let pruned = self.store.prune(self.known.tip, &keep, read_newest, same)?;
        let Some((known, num_dropped)) = pruned else {
            return Ok(0);
        };
        self.known = known;
        self.store.vacuum()?;
        Ok(num_dropped)
    }

    /// Checks a file and changes nothing: `SQLite`'s pages, every row's checksum, the digest of
    /// the newest generation.
    pub fn verify(path: impl AsRef<Path>) -> Result<Verified> {
        let (found, faults) =
            Store::verify(&GRID, path.as_ref(), MAX_FAULTS, check, |reader, faults| {
                read(reader, None, faults)
            })?;
        Ok(Verified {
            generation: found.map(|it| it.tip.number),
            faults,
        })
    }

    fn commit(
        &mut self,
        mut next: Known,
        new: &History,
        changed: &Attachments,
        anew: bool,
    ) -> Result<()> {
        let tip = self.known.tip;
        next.tip.number = tip.number + 1;
        let number = next.tip.number;
        let generation = generation(
            &next.history,
            &next.attachments,
            number,
            Some(tip.number),
            tip.prunes,
        );
        self.store.write(tip, |writer| {
            if anew {
                let number = ValueRef::Integer(number as i64);
                writer.insert(&RESET, &[number, number, ValueRef::Integer(LINE)])?;
            }
            if anew || new.num_observations() > 0 {
                next.last = write_batch(writer, new, next.last, number)?;
            }
            next.last = write_attachments(writer, changed, next.last, number)?;
            writer.insert_generation(&generation)
        })?;
        self.known = next;
        Ok(())
    }
}

fn generation(
    history: &History,
    attachments: &Attachments,
    number: u64,
    parent: Option<u64>,
    prunes: u64,
) -> Generation {
    Generation {
        number,
        parent,
        prunes,
        time_us: Time::now().as_us(),
        notes: vec![
            history.num_observations() as u64,
            history.tiles().len() as u64,
        ],
        digest: digest(history, attachments),
    }
}

/// Of the content, in whatever order it came.
fn digest(history: &History, attachments: &Attachments) -> [u8; 32] {
    let mut sha = Sha256::new();
    for value in spec_values(history.spec()) {
        put_value(&mut sha, value);
    }
    put_value(
        &mut sha,
        ValueRef::Blob(&encode_observations(history.observations())),
    );
    for tile in history.sorted_tiles() {
        put_value(&mut sha, ValueRef::Integer(tile.key().into()));
        put_value(&mut sha, ValueRef::Blob(&encode_tile(tile)));
    }
    for (name, value) in attachments {
        if !name.starts_with(UNDIGESTED) {
            put_value(&mut sha, ValueRef::Text(name.as_bytes()));
            put_value(&mut sha, ValueRef::Blob(value));
        }
    }
    sha.finalize().into()
}

fn spec_values(spec: &GridSpec) -> [ValueRef<'static>; 8] {
    let [x, y, z] = spec.origin_m().map(ValueRef::Real);
    let [w, h, d] = spec.dims().map(|n| ValueRef::Integer(n.into()));
    let is_2d = ValueRef::Integer(spec.is_2d().into());
    [is_2d, x, y, z, ValueRef::Real(spec.resolution_m()), w, h, d]
}

fn write_spec(writer: &Writer<'_>, spec: &GridSpec) -> Result<()> {
    let mut values = vec![ValueRef::Integer(1), ValueRef::Integer(0)];
    values.extend(spec_values(spec));
    writer.insert(&SPEC, &values)
}

/// Writes observations; gives the ids of the last rows.
fn write_batch(
    writer: &Writer<'_>,
    history: &History,
    mut last: LastRows,
    number: u64,
) -> Result<LastRows> {
    let [generation, line] = [number as i64, LINE].map(ValueRef::Integer);
    last.batch += 1;
    let id = ValueRef::Integer(last.batch);
    let observations = encode_observations(history.observations());
    writer.insert(
        &BATCH,
        &[id, generation, line, ValueRef::Blob(&observations)],
    )?;
    for tile in history.sorted_tiles() {
        last.tile += 1;
        let [row, key] = [last.tile, tile.key().into()].map(ValueRef::Integer);
        let bytes = encode_tile(tile);
        writer.insert(
            &TILE,
            &[row, generation, line, id, key, ValueRef::Blob(&bytes)],
        )?;
    }
    Ok(last)
}

/// Writes what is kept beside them, likewise.
fn write_attachments(
    writer: &Writer<'_>,
    attachments: &Attachments,
    mut last: LastRows,
    number: u64,
) -> Result<LastRows> {
    for (name, value) in attachments {
        last.attachment += 1;
        let [id, generation] = [last.attachment, number as i64].map(ValueRef::Integer);
        let (name, value) = (ValueRef::Text(name.as_bytes()), ValueRef::Blob(value));
        writer.insert(&ATTACHMENT, &[id, generation, name, value])?;
    }
    Ok(last)
}

/// Whether the newest content is what was written.
fn check(reader: &Reader<'_>) -> Result<()> {
    read(reader, None, &mut Faults::strict(&GRID)).map(drop)
}

fn read_newest(reader: &Reader<'_>) -> Result<Known> {
    let found = read(reader, None, &mut Faults::strict(&GRID))?;
    found.ok_or_else(|| GRID.no_generations())
}

/// Reads a generation, the newest where none is given.
fn read(reader: &Reader<'_>, at: Option<u64>, faults: &mut Faults) -> Result<Option<Known>> {
    let generations = reader.generations(None, faults)?;
    let Some((lineage, line)) = Lineage::trace(&generations, None, at) else {
        return Ok(None);
    };
    let mut spec = None;
    reader.scan(&SPEC, 0, faults, |row, _| {
        if lineage.holds(row, 1)? {
            spec = Some(spec_of(row)?);
        }
        Ok(())
    })?;
    let Some(spec) = spec else {
        let fault = Fault::new(SPEC.name, ErrorKind::Format, "there is no row of the cells");
        return faults.add(fault).map(|()| None);
    };
    let mut begins = 0;
    reader.scan(&RESET, 0, faults, |row, _| {
        if lineage.holds(row, 1)? {
            begins = row.count(1)?;
        }
        Ok(())
    })?;
    let mut batches = Batches::new(spec, begins);
    let mut last_rows = LastRows {
        batch: batches.read_observations(reader, &lineage, faults)?,
        tile: batches.read_tiles(reader, &lineage, faults)?,
        attachment: 0,
    };
    let history = batches.join(faults)?;
    let attachments = read_attachments(reader, &lineage, &mut last_rows, faults)?;
    if let Some(last) = line.last().filter(|_| faults.is_clean()) {
        let notes = [
            ("num_observations", history.num_observations() as u64),
            ("num_tiles", history.tiles().len() as u64),
        ];
        (last.compare(&GRID, &notes, &digest(&history, &attachments)))
            .or_else(|fault: Fault| faults.add(fault))?;
    }
    Ok(Some(Known {
        history,
        attachments,
        tip: reader.tip()?,
        last: last_rows,
    }))
}

/// The newest value of each name.
fn read_attachments(
    reader: &Reader<'_>,
    lineage: &Lineage,
    last: &mut LastRows,
    faults: &mut Faults,
) -> Result<Attachments> {
    let mut attachments = Attachments::new();
    if reader.version() < 2 {
        return Ok(attachments);
    }
    reader.scan(&ATTACHMENT, 0, faults, |row, _| {
        last.attachment = row.id();
        if lineage.holds(row, 1)? {
            attachments.insert(row.text(2)?.to_owned(), row.blob(3)?.to_vec());
        }
        Ok(())
    })?;
    attachments.retain(|_, value| !value.is_empty());
    Ok(attachments)
}

fn spec_of(row: &Row<'_>) -> Result<GridSpec, Fault> {
    let origin = [row.real(3)?, row.real(4)?, row.real(5)?];
    let resolution = row.real(6)?;
    let mut dims = [0; 3];
    for (axis, dim) in dims.iter_mut().enumerate() {
        let cells = row.count(7 + axis)?;
        *dim = u32::try_from(cells).map_err(|_| row.misfit(7 + axis, "too many cells"))?;
    }
    let spec = if row.integer(2)? == 1 {
        GridSpec::new_2d([origin[0], origin[1]], resolution, [dims[0], dims[1]])
    } else {
        GridSpec::new_3d(origin, resolution, dims)
    };
    spec.map_err(|error| row.misfit(6, error.message()))
}

/// The batches of a line of generations on the way to a history.
struct Batches {
    tiling: Tiling,
    /// Rows of older generations do not hold.
    begins: usize,
    /// The id, the observations and the tiles of each.
    all: Vec<(i64, Observations, Vec<Tile>)>,
}

impl Batches {
    fn new(spec: GridSpec, begins: usize) -> Self {
        Self {
            tiling: Tiling::new(spec),
            begins,
            all: Vec::new(),
        }
    }

    /// Gives the id of the last row.
    fn read_observations(
        &mut self,
        reader: &Reader<'_>,
        lineage: &Lineage,
        faults: &mut Faults,
    ) -> Result<i64> {
        let mut last = 0;
        reader.scan(&BATCH, 0, faults, |row, _| {
            last = row.id();
            if lineage.holds(row, 1)? && row.count(1)? >= self.begins {
                let observations = decode_observations(row.blob(3)?)
                    .ok_or_else(|| row.misfit(3, "these are no observations"))?;
                self.all.push((row.id(), observations, Vec::new()));
            }
            Ok(())
        })?;
        Ok(last)
    }

    /// Gives the id of the last row.
    fn read_tiles(
        &mut self,
        reader: &Reader<'_>,
        lineage: &Lineage,
        faults: &mut Faults,
    ) -> Result<i64> {
        let mut last = 0;
        reader.scan(&TILE, 0, faults, |row, _| {
            last = row.id();
            if !lineage.holds(row, 1)? || row.count(1)? < self.begins {
                return Ok(());
            }
            let batch = row.integer(3)?;
            let found = self.all.binary_search_by_key(&batch, |it| it.0);
            let Some((_, observations, tiles)) = found.ok().and_then(|at| self.all.get_mut(at))
            else {
                return Err(row.misfit(3, format!("there is no batch {batch}")));
            };
            let key =
                u32::try_from(row.count(4)?).map_err(|_| row.misfit(4, "there is no such tile"))?;
            let tile = decode_tile(&self.tiling, key, observations.len(), row.blob(5)?)
                .ok_or_else(|| row.misfit(5, "this is no tile of the grid"))?;
            if tiles.last().is_some_and(|last: &Tile| last.key() >= key) {
                return Err(row.misfit(4, "the tiles of a batch are not ascending"));
            }
            tiles.push(tile);
            Ok(())
        })?;
        Ok(last)
    }

    fn join(self, faults: &mut Faults) -> Result<History> {
        let mut history: Option<History> = None;
        for (id, observations, tiles) in self.all {
            let batch = History::from_parts(self.tiling, observations, tiles);
            match &mut history {
                None => history = Some(batch),
                Some(history) => {
                    if let Err(error) = history.merge(&batch) {
                        let fault = Fault::new(BATCH.name, ErrorKind::Format, error.message());
                        faults.add(fault.at(Some(id), None, None))?;
                    }
                }
            }
        }
        Ok(history.unwrap_or_else(|| History::new(*self.tiling.spec())))
    }
}

/// A grid that several files hold together.
impl GridFile {
    /// Makes a new file of the union of others, in whatever order they are given: of what was
    /// observed, and of what is kept beside it but for what is [`UNDIGESTED`].
    ///
    /// # Errors
    /// As for [`History::merge`] and [`Self::create`].
    pub fn merge_into<P: AsRef<Path>>(path: impl AsRef<Path>, others: &[P]) -> Result<Self> {
        let mut union: Option<History> = None;
        let mut attachments = Attachments::new();
        for other in others {
            let file = Self::open(other, Access::ReadOnly)?;
            for (name, value) in file.attachments() {
                // Of two values the smaller one, in whatever order they come.
                if !name.starts_with(UNDIGESTED)
                    && attachments.get(name).is_none_or(|known| value < known)
                {
                    attachments.insert(name.clone(), value.clone());
                }
            }
            let history = file.into_history();
            match &mut union {
                None => union = Some(history),
                Some(union) => {
                    union
                        .merge(&history)
                        .map_err(|error| error.with_path(other))?;
                }
            }
        }
        let union = union.ok_or_else(|| {
            Error::new(ErrorKind::Config, "no grid to merge").with_help("name at least one")
        })?;
        Self::create_with(path, union, attachments)
    }
}
