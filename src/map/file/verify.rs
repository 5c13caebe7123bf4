//! Is a map file, byte for byte, what was written?

use std::path::Path;

use chronotope_store::{Fault, Faults, Reader, Store, ends};

use super::load;
use super::map::Map;
use super::tables::MAP;
use super::trail::{Trail, check_trail};
use crate::map::digest::ContentDigest;
use fremen::error::Result;

/// Faults listed, at most.
const MAX_FAULTS: usize = 100;

/// What [`Map::verify`] found.
#[derive(Clone, Debug)]
pub struct VerifyReport {
    /// The faults, in order of finding, at most 100; none if the file is as it was written.
    pub faults: Vec<Fault>,
    /// The newest generation whose row can be read.
    pub generation: Option<u64>,
    /// The content's digest as found, where every row could be read.
    pub digest: Option<ContentDigest>,
    /// Places read.
    pub num_places: usize,
    /// Visits read.
    pub num_visits: usize,
    /// Features read.
    pub num_features: usize,
}

impl VerifyReport {
    /// Whether the file is as it was written.
    pub fn is_clean(&self) -> bool {
        self.faults.is_empty()
    }
}

impl Map {
    /// Checks everything about a map file and changes nothing: SQLite's pages, the declaration of
    /// the tables, the checksum of every row, the rows against each other, and the totals and
    /// digest of every generation.
    ///
    /// An error says that the file is no map at all or cannot be read; damage to a map is in the
    /// report.
    pub fn verify(path: impl AsRef<Path>) -> Result<VerifyReport> {
        let path = path.as_ref();
        verify(path).map_err(|error| error.with_path(path))
    }
}

fn verify(path: &Path) -> Result<VerifyReport> {
    let mut trail = Trail::default();
    let (state, faults) = Store::verify(&MAP, path, MAX_FAULTS, load::check, |reader, faults| {
        let state = load::load(reader, None, None, faults, Some(&mut trail));
        if faults.is_clean()
            && let Ok(Some(state)) = &state
        {
            check_trail(&trail, &state.snapshot).or_else(|fault| faults.add(fault))?;
            check_branches(reader, state.snapshot.generation, faults)?;
        }
        state
    })?;
    let last = trail.generations.last();
    let time = last.map_or_else(Default::default, |it| it.time);
    let totals = state.as_ref().map(|state| state.totals(time));
    Ok(VerifyReport {
        generation: totals.as_ref().map(|totals| totals.number),
        digest: (totals.as_ref())
            .filter(|_| faults.is_empty())
            .map(|totals| totals.digest),
        num_places: totals.as_ref().map_or(0, |totals| totals.num_places),
        num_visits: totals.as_ref().map_or(0, |totals| totals.num_visits),
        num_features: totals.as_ref().map_or(0, |totals| totals.num_features),
        faults,
    })
}

/// Whether the generations that do not lead to the newest one are what their rows say.
/// O(branches * bytes).
fn check_branches(reader: &Reader<'_>, newest: u64, faults: &mut Faults) -> Result<()> {
    let generations = reader.generations(None, faults)?;
    for end in ends(&generations) {
        if end == newest || !faults.is_clean() {
            continue;
        }
        let mut trail = Trail::default();
        if let Some(state) = load::load(reader, None, Some(end), faults, Some(&mut trail))?
            && faults.is_clean()
        {
            check_trail(&trail, &state.snapshot).or_else(|fault| faults.add(fault))?;
        }
    }
    Ok(())
}
