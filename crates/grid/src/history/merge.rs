//! How do two histories become one, whoever made which observation?
//!
//! The union of their observations: merging is commutative, associative and, because an
//! observation has an identity (time and observer), idempotent.

use std::collections::BTreeSet;
use std::iter::Peekable;

use fremen::{Error, ErrorKind, Result};
use rayon::prelude::*;

use super::log::{CellLog, Change, Changes};
use super::observations::Observations;
use super::record::History;
use super::tile::{Tile, Visits};
use crate::cells::CellState;

impl History {
    /// Adds all observations of another history; gives how many were new.
    ///
    /// # Errors
    /// [`ErrorKind::Shape`] where the grids differ or the observations are too many,
    /// [`ErrorKind::Conflict`] where one observer saw two things at one time. This history is
    /// unchanged then.
    pub fn merge(&mut self, other: &Self) -> Result<usize> {
        if self.tiling != other.tiling {
            return Err(Error::new(
                ErrorKind::Shape,
                format!("grids {:?} and {:?} differ", self.spec(), other.spec()),
            )
            .with_help("only grids of the same cells can be merged"));
        }
        let (union, mine, others) = self.observations.union(&other.observations)?;
        let num_known = self.observations.len() as u32;
        if others.first().is_none_or(|&first| first >= num_known) {
            self.append_later(union, other, num_known);
            return Ok(others.len());
        }
        let mut in_both = vec![0_u8; union.len()];
        for &at in mine.iter().chain(&others) {
            in_both[at as usize] += 1;
        }
        let both: Vec<bool> = in_both.into_iter().map(|times| times == 2).collect();
        let keys: BTreeSet<u32> = self
            .tiles
            .iter()
            .chain(&other.tiles)
            .map(Tile::key)
            .collect();
        let keys: Vec<u32> = keys.into_iter().collect();
        let merged: Result<Vec<Tile>> = keys
            .par_iter()
            .map(|&key| {
                let a = self.slot(key).map(|slot| (&self.tiles[slot], &*mine));
                let b = other.slot(key).map(|slot| (&other.tiles[slot], &*others));
                merge_tiles(key, a, b, &both).map_err(|observation| conflict(&union, observation))
            })
            .collect();
        let num_new = union.len() - self.observations.len();
        *self = Self::from_parts(self.tiling, union, merged?);
        Ok(num_new)
    }
}

impl History {
    /// Adds a history whose observations are all later than those of this one, by far the most
    /// frequent case: it costs as much as that one has cells and changes.
    fn append_later(&mut self, union: Observations, other: &Self, num_known: u32) {
        self.observations = union;
        for tile in &other.tiles {
            if let Some(slot) = self.slot(tile.key()) {
                self.tiles[slot].append(tile, num_known);
                continue;
            }
            let mut visits = Visits::default();
            for (start, end) in tile.visits().ranges() {
                visits.extend(num_known + start, num_known + end);
            }
            self.slots.insert(tile.key(), self.tiles.len() as u32);
            self.tiles.push(tile.clone().with_visits(visits));
        }
    }
}

fn conflict(observations: &Observations, observation: u32) -> Error {
    let index = observation as usize;
    let observer = observations.observer(index);
    let observer = if observer.is_empty() {
        "the anonymous observer"
    } else {
        observer
    };
    Error::new(
        ErrorKind::Conflict,
        format!(
            "{observer} saw two different things at {}",
            observations.time(index)
        ),
    )
    .with_help("give each observer a name of its own")
}

/// Visits of the merged tile that come from the same tiles, one after another.
struct Segment {
    /// The first of them in the merged tile, and how many.
    start: u32,
    len: u32,
    /// The first of them in either tile.
    a: Option<u32>,
    b: Option<u32>,
}

type Numbered<'a> = Option<(&'a Tile, &'a [u32])>;

/// The union of the visits of two tiles; else the observation in which they differ.
fn merge_tiles(
    key: u32,
    a: Numbered<'_>,
    b: Numbered<'_>,
    both: &[bool],
) -> std::result::Result<Tile, u32> {
    let visits = |tile: Numbered<'_>| {
        tile.map_or_else(Visits::default, |(tile, numbers)| {
            tile.visits().renumbered(numbers)
        })
    };
    let (visits_a, visits_b) = (visits(a), visits(b));
    let (visits, segments) = union(&visits_a, &visits_b, both)?;
    let (a, b) = match (a, b) {
        (Some((a, _)), Some((b, _))) => (a, b),
        // All of it comes from one of them.
        (Some((tile, _)), None) | (None, Some((tile, _))) => {
            return Ok(tile.clone().with_visits(visits));
        }
        (None, None) => return Ok(Tile::new(key, 0)),
    };
    let num_cells = 64 * a.num_words();
    let mut cells = Vec::with_capacity(num_cells);
    for at in 0..num_cells {
        let cell = merge_cell(
            (a.state(at), a.log(at)),
            (b.state(at), b.log(at)),
            &segments,
        );
        // The merged visit at which they differ.
        cells.push(cell.map_err(|visit| visits.observation(visit))?);
    }
    Ok(Tile::build(key, num_cells, visits, |at| {
        let (first, changes) = &cells[at];
        (*first, changes.iter().copied())
    }))
}

fn union(
    a: &Visits,
    b: &Visits,
    both: &[bool],
) -> std::result::Result<(Visits, Vec<Segment>), u32> {
    let mut visits = Visits::default();
    let mut segments: Vec<Segment> = Vec::new();
    let (mut iter_a, mut iter_b) = (a.observations().peekable(), b.observations().peekable());
    let (mut at_a, mut at_b) = (0, 0);
    loop {
        let (next_a, next_b) = (iter_a.peek().copied(), iter_b.peek().copied());
        let Some(next) = next_a.into_iter().chain(next_b).min() else {
            break;
        };
        let (in_a, in_b) = (next_a == Some(next), next_b == Some(next));
        if both[next as usize] && !(in_a && in_b) {
            return Err(next);
        }
        let continues = segments
            .last()
            .is_some_and(|it| it.a.is_some() == in_a && it.b.is_some() == in_b);
        match segments.last_mut().filter(|_| continues) {
            Some(segment) => segment.len += 1,
            None => segments.push(Segment {
                start: visits.len(),
                len: 1,
                a: in_a.then_some(at_a),
                b: in_b.then_some(at_b),
            }),
        }
        visits.extend(next, next + 1);
        if in_a {
            iter_a.next();
            at_a += 1;
        }
        if in_b {
            iter_b.next();
            at_b += 1;
        }
    }
    Ok((visits, segments))
}

/// Walks along the changes of a cell.
struct Walker<'a> {
    state: CellState,
    changes: Option<Peekable<Changes<'a>>>,
}

impl<'a> Walker<'a> {
    fn new((now, log): (CellState, Option<&'a CellLog>)) -> Self {
        Self {
            state: log.map_or(now, CellLog::first),
            changes: log.map(|log| log.changes().peekable()),
        }
    }

    /// The next change at a visit below `end`.
    fn next_before(&mut self, end: u32) -> Option<Change> {
        let change = self
            .changes
            .as_mut()?
            .next_if(|change| change.visit < end)?;
        self.state = change.state;
        Some(change)
    }

    /// The changes at visits `start..start + len`, as if `start` were visit `to`, the state at
    /// `start` first.
    fn walk(&mut self, start: u32, len: u32, to: u32, changes: &mut Vec<Change>) {
        while self.next_before(start + 1).is_some() {}
        changes.push(Change {
            visit: to,
            state: self.state,
        });
        while let Some(change) = self.next_before(start + len) {
            changes.push(Change {
                visit: to + change.visit - start,
                state: change.state,
            });
        }
    }
}

type Cell<'a> = (CellState, Option<&'a CellLog>);

/// The first state and the changes (some of which change nothing) of a merged cell; else the
/// merged visit at which the two differ.
fn merge_cell(
    a: Cell<'_>,
    b: Cell<'_>,
    segments: &[Segment],
) -> std::result::Result<(CellState, Vec<Change>), u32> {
    if a.1.is_none() && b.1.is_none() && a.0 == b.0 {
        return Ok((a.0, Vec::new()));
    }
    let (mut walk_a, mut walk_b) = (Walker::new(a), Walker::new(b));
    let mut changes = Vec::new();
    let mut other = Vec::new();
    for segment in segments {
        let from = changes.len();
        if let Some(start) = segment.a {
            walk_a.walk(start, segment.len, segment.start, &mut changes);
        }
        if let Some(start) = segment.b {
            other.clear();
            walk_b.walk(start, segment.len, segment.start, &mut other);
            if segment.a.is_none() {
                changes.append(&mut other);
            } else if changes[from..] != other {
                let same = changes[from..]
                    .iter()
                    .zip(&other)
                    .take_while(|(a, b)| a == b)
                    .count();
                let visit = |list: &[Change]| list.get(same).map_or(u32::MAX, |it| it.visit);
                return Err(visit(&changes[from..]).min(visit(&other)));
            }
        }
    }
    let first = changes.first().map_or(CellState::Unknown, |it| it.state);
    Ok((first, changes.into_iter().skip(1).collect()))
}
