//! What do the rows of a map file say, and is it what was written?
//!
//! Reading a whole file and reading what was committed since are the same function from different
//! starts. Every row is checked against its checksum, then the rows against each other, then all of
//! them against the digest of the last generation. [`Faults`] decides whether the first fault ends
//! the reading (opening) or is listed (verifying).

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use chronotope_store::{Fault, Faults, Lineage, Reader, Row, Table};

use super::generation::Generation;
use super::state::State;
use super::tables::{self, MAP};
use super::trail::Trail;
use crate::feature::{Features, Rect};
use crate::map::codec::{self, Malformed};
use crate::map::digest;
use crate::map::limits::MAX_FEATURES;
use crate::map::node::Node;
use crate::map::snapshot::check_attachment;
use crate::map::types::{AppearanceUse, Edge, MapMeta, PlaceKey, SessionId, Visit, VisitId};
use fremen::error::{ErrorKind, Result};
use fremen::time::Time;
use fremen::visibility::BitRow;

/// Appends to `state` (`None`: nothing is known yet) what the file holds beyond it, or reads
/// everything anew if what the file holds now does not follow from it.
pub(super) fn catch_up(reader: &Reader<'_>, state: State) -> Result<Option<State>> {
    let known = state.snapshot.generation;
    let newer = reader.generations(Some(known), &mut Faults::strict(&MAP))?;
    let follows = newer.iter().all(|it| it.prunes == state.prunes)
        && Lineage::trace(&newer, Some(known), None).is_some();
    let state = follows.then_some(state);
    load(reader, state, None, &mut Faults::strict(&MAP), None)
}

/// Appends to `state` (`None`: nothing is known yet) what the file holds beyond it, up to the
/// generation `at` (the newest where not given). The connection must be in a transaction. `trail`,
/// where given, takes down what each generation of the line added.
///
/// `Ok(None)`: the rows do not even name the map; the faults say why.
pub(super) fn load(
    reader: &Reader<'_>,
    state: Option<State>,
    at: Option<u64>,
    faults: &mut Faults,
    mut trail: Option<&mut Trail>,
) -> Result<Option<State>> {
    let known = state.as_ref().map(|state| state.snapshot.generation);
    let generations = reader.generations(known, faults)?;
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
        None if faults.is_clean() => return Err(MAP.no_generation(at.unwrap_or_default())),
        // A row is missing, which is listed already; all that is left is taken for one line.
        None => (Lineage::unbranched(&generations), generations),
    };
    let generations: Vec<Generation> = generations.iter().map(Generation::of).collect();
    let Some(last) = generations.last().cloned() else {
        return Ok(state);
    };
    let metas = read_metas(reader, known, &lineage, faults)?;
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
        reader,
        lineage: &lineage,
        faults,
        trail: trail.as_deref_mut(),
    };
    reading.read_places(&mut state)?;
    reading.read_poses(&mut state)?;
    let renewals = reading.read_renewals(&mut state)?;
    reading.read_visits(&mut state, &renewals)?;
    reading.read_edges(&mut state, &last)?;
    if reader.version() > 1 {
        reading.read_attachments(&mut state)?;
    }
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

/// All that the file holds at its newest generation; an error if anything is not as it was written.
pub(super) fn whole(reader: &Reader<'_>) -> Result<State> {
    let state = load(reader, None, None, &mut Faults::strict(&MAP), None)?;
    state.ok_or_else(|| MAP.no_generations())
}

/// Whether [`whole`] finds nothing amiss.
pub(super) fn check(reader: &Reader<'_>) -> Result<()> {
    whole(reader).map(drop)
}

/// What holds for the whole map at its newest generation; `None` where there is none.
pub(super) fn read_newest_meta(reader: &Reader<'_>) -> Result<Option<MapMeta>> {
    let faults = &mut Faults::strict(&MAP);
    let generations = reader.generations(None, faults)?;
    let Some((lineage, _)) = Lineage::trace(&generations, None, None) else {
        return Ok(None);
    };
    let metas = read_metas(reader, None, &lineage, faults)?;
    Ok(metas.into_iter().last().map(|(_, meta)| meta))
}

fn read_metas(
    reader: &Reader<'_>,
    known: Option<u64>,
    lineage: &Lineage,
    faults: &mut Faults,
) -> Result<Vec<(u64, MapMeta)>> {
    let mut metas = Vec::new();
    let after = known.map_or(-1, |known| known as i64);
    reader.scan(&tables::META, after, faults, |row, _| {
        if !lineage.holds(row, 0)? {
            return Ok(());
        }
        let number = |column| {
            if row.is_null(column) {
                return Ok(None);
            }
            u32::try_from(row.integer(column)?)
                .map(Some)
                .map_err(|_| row.misfit(column, "this is no number of pixels"))
        };
        let image_size = match (number(3)?, number(4)?) {
            (Some(width), Some(height)) => Some((width, height)),
            (None, None) => None,
            _ => return Err(row.misfit(3, "an image has both a width and a height")),
        };
        let crop = match (number(5)?, number(6)?, number(7)?, number(8)?) {
            (Some(x), Some(y), Some(width), Some(height)) => Some(Rect {
                x,
                y,
                width,
                height,
            }),
            (None, None, None, None) => None,
            _ => return Err(row.misfit(5, "a crop has four numbers or none")),
        };
        metas.push((
            row.count(0)? as u64,
            MapMeta {
                uuid: row.bits_128(1)?,
                extractor: row.text(2)?.into(),
                image_size,
                crop,
                preset: row.text(9)?.into(),
                zone: if row.is_null(10) {
                    None
                } else {
                    Some(row.text(10)?.into())
                },
            },
        ));
        Ok(())
    })?;
    Ok(metas)
}

/// What a row of table `visit` says.
struct VisitRow<'a> {
    number: usize,
    visit: Visit,
    seen: BitRow,
    hidden: Option<BitRow>,
    /// Bits of the experiences so far, which the row does not count.
    located_by: &'a [u8],
}

impl<'a> VisitRow<'a> {
    fn decode(row: &Row<'a>, appearance: Option<Features>) -> Result<Self, Fault> {
        let num_features = row.count(9)?;
        if num_features > MAX_FEATURES {
            let message = format!("a place holds at most {MAX_FEATURES} features");
            return Err(row.misfit(9, message));
        }
        let bits = |column| {
            codec::decode_bits(row.blob(column)?, num_features).map_err(malformed(row, column))
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
            appearance: appearance.map(Arc::new),
            appearance_use: AppearanceUse::named(row.text(8)?)
                .ok_or_else(|| row.misfit(8, "neither `experience` nor `recognised`"))?,
        };
        Ok(Self {
            visit,
            seen,
            hidden,
            located_by: row.blob(12)?,
            number: row.count(3)?,
        })
    }

    /// Appends the visit to a place, if it follows what is there.
    fn append(
        self,
        row: &Row<'_>,
        state: &mut State,
        at: usize,
        born: &Features,
    ) -> Result<(), Fault> {
        let node = &mut state.snapshot.nodes[at];
        let expected = node.visits().len();
        if self.number != expected {
            let place = row.count(2)?;
            let message = format!("visit {expected} of place {place} is missing");
            return Err(row.misfit(3, message));
        }
        if !state.visit_ids.insert(self.visit.id) {
            let message = format!("visit {} is in the map twice", self.visit.id);
            return Err(row.misfit(4, message));
        }
        let node = Arc::make_mut(node);
        let num_experiences = node.num_experiences_after(self.visit.appearance_use);
        let located_by =
            codec::decode_bits(self.located_by, num_experiences).map_err(malformed(row, 12))?;
        node.push_visit(self.visit, born, self.seen, self.hidden, located_by)
            .map_err(|error| row.misfit(9, error.to_string()))?;
        state.chains[at] = digest::next_link(&state.chains[at], node, self.number);
        Ok(())
    }
}

/// One reading of a file's rows.
struct Reading<'a> {
    reader: &'a Reader<'a>,
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
            reader,
            lineage,
            faults,
            trail,
        } = self;
        reader.scan(table, after, faults, |row, faults| {
            let is_of_line = lineage.holds(row, 1)?;
            each(row, is_of_line, faults, trail.as_deref_mut())
        })
    }

    fn read_places(&mut self, state: &mut State) -> Result<()> {
        let mut keys: BTreeSet<PlaceKey> = state
            .snapshot
            .nodes
            .iter()
            .map(|n| n.key().clone())
            .collect();
        let after = state.last_place;
        self.scan(&tables::PLACE, after, |row, is_of_line, faults, trail| {
            let key = key_of(row, 2)?;
            if !faults.is_clean() {
                return Ok(());
            }
            state.last_place = row.id();
            if !is_of_line {
                return Ok(());
            }
            if !keys.insert(key.clone()) {
                return Err(row.misfit(2, format!("there are two places `{key}`")));
            }
            let node = Node::new(key);
            state.chains.push(digest::first_link(&node));
            state.place_rows.push(row.id());
            state.snapshot.nodes.push(Arc::new(node));
            if let Some(trail) = trail {
                trail.places.push(row.count(1)? as u64);
            }
            Ok(())
        })
    }

    fn read_poses(&mut self, state: &mut State) -> Result<()> {
        let after = state.last_pose;
        self.scan(&tables::POSE, after, |row, is_of_line, faults, trail| {
            let pose = if (3..6).all(|column| row.is_null(column)) {
                None
            } else {
                Some([row.real(3)?, row.real(4)?, row.real(5)?])
            };
            state.last_pose = row.id();
            if !faults.is_clean() || !is_of_line {
                return Ok(());
            }
            let at = state.place_at(row, 2)?;
            (Arc::make_mut(&mut state.snapshot.nodes[at]).set_pose(pose))
                .map_err(|error| row.misfit(3, error.to_string()))?;
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
            let features = features_of(row, 2, 3)?;
            if is_of_line {
                all.insert(row.id(), features);
            }
            Ok(())
        })?;
        Ok(all)
    }

    /// The generations of the line that write a place anew, with its position; ascending.
    fn read_renewals(&mut self, state: &mut State) -> Result<Vec<(u64, usize)>> {
        let mut renewals = Vec::new();
        if self.reader.version() < 3 {
            return Ok(renewals);
        }
        let after = state.last_renewal;
        self.scan(&tables::RENEWAL, after, |row, is_of_line, faults, trail| {
            row.integer(2)?;
            state.last_renewal = row.id();
            if !faults.is_clean() || !is_of_line {
                return Ok(());
            }
            let renewal = (row.count(1)? as u64, state.place_at(row, 2)?);
            renewals.push(renewal);
            if let Some(trail) = trail {
                trail.renewals.push(renewal);
            }
            Ok(())
        })?;
        Ok(renewals)
    }

    fn read_visits(&mut self, state: &mut State, renewals: &[(u64, usize)]) -> Result<()> {
        let after = state.last_visit;
        // The last renewal of each place: what is older matters only to those who follow the trail.
        let newest: BTreeMap<usize, u64> =
            renewals.iter().map(|&(number, at)| (at, number)).collect();
        let mut pending = renewals.iter().peekable();
        let mut born = self.read_features(&tables::FEATURE, after)?;
        let mut appearances = self.read_features(&tables::APPEARANCE, after)?;
        self.scan(&tables::VISIT, after, |row, is_of_line, faults, trail| {
            let visit = VisitRow::decode(row, appearances.remove(&row.id()))?;
            let born = born.remove(&row.id()).unwrap_or_default();
            state.last_visit = row.id();
            if !faults.is_clean() || !is_of_line {
                return Ok(());
            }
            let at = state.place_at(row, 2)?;
            let generation = row.count(1)? as u64;
            while let Some(&(_, at)) = pending.next_if(|&&(number, _)| number <= generation) {
                state.renew(at);
            }
            let is_outdated = newest.get(&at).is_some_and(|&newest| generation < newest);
            if is_outdated && trail.is_none() {
                return Ok(());
            }
            visit.append(row, state, at, &born)?;
            if let Some(trail) = trail {
                trail
                    .links
                    .push((generation, at, state.chains[at], born.len()));
            }
            Ok(())
        })?;
        for &(_, at) in pending {
            state.renew(at);
        }
        for (table, left) in [
            (&tables::FEATURE, born.keys().next()),
            (&tables::APPEARANCE, appearances.keys().next()),
        ] {
            if let Some(&row) = left
                && self.faults.is_clean()
            {
                let message = "there is no such visit";
                let fault = Fault::new(table.name, ErrorKind::Format, message);
                self.faults.add(fault.at(Some(row), Some("visit"), None))?;
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
        self.scan(&tables::EDGE, after, |row, is_of_line, _, trail| {
            let edge = Edge {
                from: key_of(row, 2)?,
                to: key_of(row, 3)?,
                name: row.text(4)?.into(),
            };
            state.last_edge = row.id();
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
            &tables::ATTACHMENT,
            after,
            |row, is_of_line, faults, trail| {
                let (name, value) = (row.text(2)?, row.blob(3)?);
                check_attachment(name, value).map_err(|error| row.misfit(2, error.to_string()))?;
                state.last_attachment = row.id();
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

fn malformed(row: &Row<'_>, column: usize) -> impl FnOnce(Malformed) -> Fault {
    move |it| row.fault(column, Some(it.byte), it.message)
}

fn key_of(row: &Row<'_>, column: usize) -> Result<PlaceKey, Fault> {
    PlaceKey::new(row.text(column)?).map_err(|error| row.misfit(column, error.to_string()))
}

fn features_of(row: &Row<'_>, keypoints: usize, descriptors: usize) -> Result<Features, Fault> {
    let decoded_keypoints =
        codec::decode_keypoints(row.blob(keypoints)?).map_err(malformed(row, keypoints))?;
    let decoded_descriptors =
        codec::decode_descriptors(row.blob(descriptors)?).map_err(malformed(row, descriptors))?;
    codec::pair(decoded_keypoints, decoded_descriptors).map_err(malformed(row, descriptors))
}
