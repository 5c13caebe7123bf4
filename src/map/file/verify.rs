//! Is a map file, byte for byte, what was written?

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

use rusqlite::{Connection, OpenFlags};

use super::digest::{self, ContentDigest};
use super::load::{self, Fault, Faults, Generation, State, Trail};
use super::store::{Map, check_schema, check_structure, connect, peek, reading, sqlite_error};
use crate::map::types::{Node, Snapshot};
use fremen::error::{ErrorKind, Result};

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
    /// Checks everything about a map file and changes nothing: SQLite's pages, the declaration of the
    /// tables, the checksum of every row, the rows against each other, and the totals and digest of
    /// every generation.
    ///
    /// An error says that the file is no map at all or cannot be read; damage to a map is in the
    /// report.
    pub fn verify(path: impl AsRef<Path>) -> Result<VerifyReport> {
        let path = path.as_ref();
        verify(path).map_err(|error| error.with_path(path))
    }
}

fn verify(path: &Path) -> Result<VerifyReport> {
    peek(path)?;
    let mut faults = Faults::listing(MAX_FAULTS);
    let mut trail = Trail::default();
    let mut connection = connect(path, OpenFlags::SQLITE_OPEN_READ_ONLY)?;
    let state = reading(&mut connection, |connection| {
        check_schema(connection, &mut faults)?;
        if !faults.is_clean() {
            return Ok(None);
        }
        check_structure(connection, "integrity_check", &mut faults)?;
        let pages: u64 = connection
            .query_row(
                "SELECT page_count * page_size FROM pragma_page_count, pragma_page_size",
                [],
                |row| row.get::<_, i64>(0).map(|bytes| bytes as u64),
            )
            .map_err(|error| sqlite_error(&error))?;
        let found = std::fs::metadata(path).map_or(pages, |metadata| metadata.len());
        if found != pages {
            let message = format!("the file has {found} bytes, its pages {pages}");
            faults.add(Fault::new("file", ErrorKind::Format, message))?;
        }
        let state = load::load(connection, None, None, &mut faults, Some(&mut trail));
        if faults.is_clean()
            && let Ok(Some(state)) = &state
        {
            check_trail(&trail, &state.snapshot).or_else(|fault| faults.add(fault))?;
            check_branches(connection, state.snapshot.generation, &mut faults)?;
        }
        state
    });
    // One fault too many ends the reading; the list is full then.
    let state = match state {
        Err(error) if faults.list.len() < MAX_FAULTS => return Err(error),
        state => state.ok().flatten(),
    };
    let totals = state.as_ref().map(|state: &State| {
        state.totals(
            trail
                .generations
                .last()
                .map_or_else(Default::default, |g| g.time),
        )
    });
    Ok(VerifyReport {
        generation: totals.as_ref().map(|totals| totals.number),
        digest: totals
            .as_ref()
            .filter(|_| faults.is_clean())
            .map(|totals| totals.digest),
        num_places: totals.as_ref().map_or(0, |totals| totals.num_places),
        num_visits: totals.as_ref().map_or(0, |totals| totals.num_visits),
        num_features: totals.as_ref().map_or(0, |totals| totals.num_features),
        faults: faults.list,
    })
}

/// Whether the generations that do not lead to the newest one are what their rows say.
/// O(branches * bytes).
fn check_branches(connection: &Connection, newest: u64, faults: &mut Faults) -> Result<()> {
    let version = load::format_version(connection)?;
    let generations = load::read_generations(connection, version, None, faults)?;
    let parents: BTreeSet<u64> = generations.iter().filter_map(|it| it.parent).collect();
    for end in generations.iter().map(|it| it.number) {
        if end == newest || parents.contains(&end) || !faults.is_clean() {
            continue;
        }
        let mut trail = Trail::default();
        if let Some(state) = load::load(connection, None, Some(end), faults, Some(&mut trail))?
            && faults.is_clean()
        {
            check_trail(&trail, &state.snapshot).or_else(|fault| faults.add(fault))?;
        }
    }
    Ok(())
}

/// Whether every generation of a line, not only the last, was what its row says: the commits are made again,
/// with the chains in place of the visits. O(generations * places + visits).
fn check_trail(trail: &Trail, whole: &Snapshot) -> Result<(), Fault> {
    let Some((_, meta)) = trail.metas.first() else {
        return Ok(());
    };
    let mut replay = State::empty(meta.clone());
    let (mut num_visits, mut num_features) = (0, 0);
    let mut poses = trail.poses.iter().peekable();
    let mut links = trail.links.iter().peekable();
    let mut attachments = trail.attachments.iter().peekable();
    for written in &trail.generations {
        let number = written.number;
        replay.snapshot.generation = number;
        replay.meta_generation = written.meta;
        if let Ok(at) = trail
            .metas
            .binary_search_by_key(&written.meta, |meta| meta.0)
        {
            replay.snapshot.meta = trail.metas[at].1.clone();
        }
        if replay.edge_generation != written.edges {
            replay.edge_generation = written.edges;
            let edges = trail.edges.iter().filter(|edge| edge.0 == written.edges);
            replay.snapshot.edges = edges.map(|edge| edge.1.clone()).collect();
        }
        let known = replay.chains.len();
        let new = trail.places[known..].iter().take_while(|&&it| it <= number);
        for node in &whole.nodes[known..known + new.count()] {
            let node = Node::new(node.key.clone());
            replay.chains.push(digest::first_link(&node));
            replay.snapshot.nodes.push(Arc::new(node));
        }
        while let Some((_, place, pose)) = poses.next_if(|pose| pose.0 <= number) {
            if let Some(node) = replay.snapshot.nodes.get_mut(*place) {
                Arc::make_mut(node).pose = *pose;
            }
        }
        while let Some((_, name, digest)) = attachments.next_if(|it| it.0 <= number) {
            match digest {
                Some(digest) => drop(replay.attachments.insert(name.clone(), *digest)),
                None => drop(replay.attachments.remove(name)),
            }
        }
        while let Some((_, place, link, born)) = links.next_if(|link| link.0 <= number) {
            if let Some(chain) = replay.chains.get_mut(*place) {
                *chain = *link;
            }
            num_visits += 1;
            num_features += born;
        }
        written.compare(&Generation {
            num_visits,
            num_features,
            ..replay.totals(written.time)
        })?;
    }
    Ok(())
}
