//! What does one snapshot add to another?
//!
//! A commit writes only what is new, so first it is established that all the rest is as stored.
//! Places that are shared between the snapshots ([`Arc::ptr_eq`]) are not looked at. A place whose
//! past has changed is written anew, alone, where the caller wishes so ([`Rewritten`]).

use std::collections::{BTreeSet, HashSet};
use std::sync::Arc;

use chronotope_store::{ValueRef, Writer};

use super::state::State;
use super::tables;
use crate::feature::{Features, FeaturesView};
use crate::map::codec::{encode_bits, encode_descriptors, encode_keypoints};
use crate::map::digest;
use crate::map::node::Node;
use crate::map::snapshot::Snapshot;
use crate::map::types::{MapMeta, VisitId};
use fremen::error::{Error, ErrorKind, Result};

/// What a commit has to write.
#[derive(Debug)]
pub(super) struct Change {
    meta: bool,
    edges: bool,
    /// Places that are written anew, ascending.
    renewed: Vec<usize>,
    /// Visits that these have stored.
    outdated: BTreeSet<VisitId>,
    /// Places with something new, ascending, each with the number of its visits that are stored and
    /// stay.
    nodes: Vec<(usize, usize)>,
    /// Those among them whose pose is new, ascending.
    poses: Vec<usize>,
    /// Names of attachments that are new, changed or gone, ascending.
    attachments: Vec<String>,
}

/// What to do with places that do not extend what is stored of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Rewritten {
    /// That is an error.
    Refused,
    /// They are written anew, the others are not.
    Renewed,
}

impl Change {
    /// What `next` adds to `state`; an error if it does not extend it or cannot be stored.
    pub(super) fn between(state: &State, next: &Snapshot, rewritten: Rewritten) -> Result<Self> {
        let stored = &state.snapshot;
        let meta = next.meta != stored.meta;
        if meta {
            check_meta(stored, next)?;
        }
        next.check_frame()?;
        if next.nodes.len() < stored.nodes.len() {
            return Err(does_not_extend(&format!(
                "it has {} places where {} are stored",
                next.nodes.len(),
                stored.nodes.len()
            )));
        }
        let mut change = Self {
            meta,
            edges: next.edges != stored.edges,
            renewed: Vec::new(),
            outdated: BTreeSet::new(),
            nodes: Vec::new(),
            poses: Vec::new(),
            attachments: changed_attachments(stored, next),
        };
        for (at, node) in next.nodes.iter().enumerate() {
            let before = stored.nodes.get(at);
            if !before.is_some_and(|before| Arc::ptr_eq(before, node)) {
                change.add_node(at, before.map(Arc::as_ref), node, rewritten)?;
            }
        }
        change.check_new_visits(state, next)?;
        Ok(change)
    }

    /// Takes down what is new in one place.
    fn add_node(
        &mut self,
        at: usize,
        before: Option<&Node>,
        node: &Node,
        rewritten: Rewritten,
    ) -> Result<()> {
        node.check()?;
        let mut num_stored = before.map_or(0, |before| before.visits().len());
        let mut is_new = before.is_none();
        if let Some(before) = before {
            let fault =
                |what: &str| does_not_extend(what).with_place(format!("place `{}`", before.key()));
            if before.key() != node.key() {
                return Err(fault(&format!("it has `{}` instead", node.key())));
            }
            match difference(before, node) {
                None => {}
                Some(what) if rewritten == Rewritten::Refused => return Err(fault(&what)),
                Some(_) => {
                    self.renewed.push(at);
                    self.outdated
                        .extend(before.visits().iter().map(|visit| visit.id));
                    num_stored = 0;
                    is_new = true;
                }
            }
        }
        if before.and_then(Node::pose) != node.pose() {
            self.poses.push(at);
            is_new = true;
        }
        if is_new || node.visits().len() > num_stored {
            self.nodes.push((at, num_stored));
        }
        Ok(())
    }

    /// Whether no visit is there twice.
    fn check_new_visits(&self, state: &State, next: &Snapshot) -> Result<()> {
        let mut new_ids = HashSet::new();
        for &(at, num_stored) in &self.nodes {
            let node = &next.nodes[at];
            for visit in &node.visits()[num_stored..] {
                let is_stored =
                    state.visit_ids.contains(&visit.id) && !self.outdated.contains(&visit.id);
                if is_stored || !new_ids.insert(visit.id) {
                    return Err(Error::new(
                        ErrorKind::AlreadyExists,
                        format!("visit {} is in the map already", visit.id),
                    )
                    .with_place(format!("place `{}`", node.key())));
                }
            }
        }
        Ok(())
    }

    /// The identities of all visits after the change, of those before it and those that are new.
    pub(super) fn visit_ids(
        &self,
        mut before: HashSet<VisitId>,
        new: HashSet<VisitId>,
    ) -> HashSet<VisitId> {
        for id in &self.outdated {
            before.remove(id);
        }
        before.extend(new);
        before
    }

    /// Whether there is nothing to write.
    pub(super) fn is_nothing(&self) -> bool {
        !self.meta && !self.edges && self.nodes.is_empty() && self.attachments.is_empty()
    }

    /// The state after the commit of `generation`, but with the ids of the new visits only; row
    /// numbers are those that [`write`](Self::write) uses.
    pub(super) fn apply(&self, state: &State, next: &Snapshot, generation: u64) -> State {
        let mut after = State {
            snapshot: next.clone(),
            chains: state.chains.clone(),
            place_rows: state.place_rows.clone(),
            visit_ids: HashSet::new(),
            attachments: state.attachments.clone(),
            parent: Some(state.snapshot.generation),
            ..*state
        };
        after.snapshot.generation = generation;
        after.snapshot.attachments.retain(|_, it| !it.is_empty());
        for &at in &self.renewed {
            after.chains[at] = digest::first_link(&next.nodes[at]);
        }
        after.last_renewal += self.renewed.len() as i64;
        for &(at, num_stored) in &self.nodes {
            let node = &next.nodes[at];
            if at == after.chains.len() {
                after.chains.push(digest::first_link(node));
                after.last_place += 1;
                after.place_rows.push(after.last_place);
            }
            for visit in num_stored..node.visits().len() {
                after.chains[at] = digest::next_link(&after.chains[at], node, visit);
                after.visit_ids.insert(node.visits()[visit].id);
                after.last_visit += 1;
            }
        }
        after.last_pose += self.poses.len() as i64;
        if self.meta {
            after.meta_generation = generation;
        }
        if self.edges {
            after.edge_generation = generation;
            after.last_edge += next.edges.len() as i64;
        }
        for name in &self.attachments {
            match after.snapshot.attachments.get(name) {
                Some(value) => {
                    let digest = digest::of_attachment(value);
                    after.attachments.insert(name.clone(), digest);
                }
                None => drop(after.attachments.remove(name)),
            }
        }
        after.last_attachment += self.attachments.len() as i64;
        after
    }

    /// Writes the rows that lead from `before` to `after`, except that of the generation.
    pub(super) fn write(&self, writer: &Writer<'_>, before: &State, after: &State) -> Result<()> {
        let next = &after.snapshot;
        let generation = ValueRef::Integer(next.generation as i64);
        if self.meta {
            insert_meta(writer, next.generation, &next.meta)?;
        }
        if self.edges {
            for (id, edge) in (before.last_edge + 1..).zip(&next.edges) {
                let values = [
                    ValueRef::Integer(id),
                    generation,
                    ValueRef::Text(edge.from.as_str().as_bytes()),
                    ValueRef::Text(edge.to.as_str().as_bytes()),
                    ValueRef::Text(edge.name.as_bytes()),
                ];
                writer.insert(&tables::EDGE, &values)?;
            }
        }
        for (id, &at) in (before.last_renewal + 1..).zip(&self.renewed) {
            let place = ValueRef::Integer(after.place_rows[at]);
            writer.insert(
                &tables::RENEWAL,
                &[ValueRef::Integer(id), generation, place],
            )?;
        }
        let mut visit_row = before.last_visit;
        for &(at, num_stored) in &self.nodes {
            let node = &next.nodes[at];
            let place = after.place_rows[at];
            if at >= before.snapshot.nodes.len() {
                let key = ValueRef::Text(node.key().as_str().as_bytes());
                writer.insert(&tables::PLACE, &[ValueRef::Integer(place), generation, key])?;
            }
            for visit in num_stored..node.visits().len() {
                visit_row += 1;
                insert_visit(writer, visit_row, generation, place, node, visit)?;
            }
        }
        for (id, &at) in (before.last_pose + 1..).zip(&self.poses) {
            let mut values = vec![
                ValueRef::Integer(id),
                generation,
                ValueRef::Integer(after.place_rows[at]),
            ];
            values.extend(digest::pose_values(next.nodes[at].pose()));
            writer.insert(&tables::POSE, &values)?;
        }
        for (id, name) in (before.last_attachment + 1..).zip(&self.attachments) {
            let value = next.attachments.get(name).map_or(&[][..], |value| value);
            let values = [
                ValueRef::Integer(id),
                generation,
                ValueRef::Text(name.as_bytes()),
                ValueRef::Blob(value),
            ];
            writer.insert(&tables::ATTACHMENT, &values)?;
        }
        Ok(())
    }
}

pub(super) fn insert_meta(writer: &Writer<'_>, generation: u64, meta: &MapMeta) -> Result<()> {
    let uuid = meta.uuid.to_be_bytes();
    let mut values = vec![ValueRef::Integer(generation as i64)];
    values.extend(digest::meta_values(meta, &uuid));
    writer.insert(&tables::META, &values)
}

/// The names of attachments that differ, ascending.
fn changed_attachments(stored: &Snapshot, next: &Snapshot) -> Vec<String> {
    let value = |of: &Snapshot, name: &str| {
        let value = of.attachments.get(name);
        value.filter(|value| !value.is_empty()).cloned()
    };
    let names: BTreeSet<&String> = (stored.attachments.keys())
        .chain(next.attachments.keys())
        .collect();
    let differs = |name: &&&String| match (value(stored, name), value(next, name)) {
        // A shared value is not compared again.
        (Some(old), Some(new)) => !Arc::ptr_eq(&old, &new) && old != new,
        (old, new) => old.is_some() || new.is_some(),
    };
    names.iter().filter(differs).map(|&it| it.clone()).collect()
}

fn insert_visit(
    writer: &Writer<'_>,
    row: i64,
    generation: ValueRef<'_>,
    place: i64,
    node: &Node,
    number: usize,
) -> Result<()> {
    let visit = &node.visits()[number];
    let seen = node.log().seen_row(number);
    let hidden = node.log().hidden_row(number).map(encode_bits);
    let values = [
        ValueRef::Integer(row),
        generation,
        ValueRef::Integer(place),
        ValueRef::Integer(number as i64),
        ValueRef::Blob(&visit.id.0.to_be_bytes()),
        ValueRef::Blob(&visit.session.0.to_be_bytes()),
        ValueRef::Integer(visit.time.as_us()),
        ValueRef::Text(visit.source.as_bytes()),
        ValueRef::Text(visit.appearance_use.name().as_bytes()),
        ValueRef::Integer(seen.len() as i64),
        ValueRef::Blob(&encode_bits(seen)),
        hidden.as_deref().map_or(ValueRef::Null, ValueRef::Blob),
        ValueRef::Blob(&encode_bits(node.experience_log().seen_row(number))),
    ];
    writer.insert(&tables::VISIT, &values)?;
    let insert_features = |table, features: FeaturesView<'_>| {
        let values = [
            ValueRef::Integer(row),
            generation,
            ValueRef::Blob(&encode_keypoints(features.keypoints)),
            ValueRef::Blob(&encode_descriptors(features.descriptors)),
        ];
        writer.insert(table, &values)
    };
    let born = node.born_at(number);
    if !born.is_empty() {
        let born = FeaturesView {
            keypoints: &node.features().keypoints()[born.clone()],
            descriptors: &node.features().descriptors()[born],
        };
        insert_features(&tables::FEATURE, born)?;
    }
    match visit.appearance.as_deref().map(Features::view) {
        Some(appearance) => insert_features(&tables::APPEARANCE, appearance),
        None => Ok(()),
    }
}

fn check_meta(stored: &Snapshot, next: &Snapshot) -> Result<()> {
    let (before, after) = (&stored.meta, &next.meta);
    let has_visits = stored.nodes.iter().any(|node| !node.visits().is_empty());
    let fixed = [
        ("uuid", before.uuid != after.uuid),
        ("extractor", before.extractor != after.extractor),
        (
            "image size",
            has_visits && before.image_size.is_some() && before.image_size != after.image_size,
        ),
        ("crop", has_visits && before.crop != after.crop),
    ];
    match fixed.iter().find(|(_, differs)| *differs) {
        Some((what, _)) => Err(does_not_extend(&format!("its {what} is another"))),
        None => Ok(()),
    }
}

/// In what `after` does not extend `before`, a place of the same name; `None` if it does.
fn difference(before: &Node, after: &Node) -> Option<String> {
    let visits = before.visits().len();
    if after.visits().len() < visits {
        return Some(format!(
            "it has {} visits where {visits} are stored",
            after.visits().len()
        ));
    }
    for at in 0..visits {
        // A shared appearance is not compared again.
        let (old, new) = (&before.visits()[at], &after.visits()[at]);
        let same_appearance = match (&old.appearance, &new.appearance) {
            (Some(old), Some(new)) => Arc::ptr_eq(old, new) || old == new,
            (old, new) => old.is_none() && new.is_none(),
        };
        let same = (old.id, old.session, old.time, old.appearance_use)
            == (new.id, new.session, new.time, new.appearance_use)
            && old.source == new.source
            && same_appearance
            && before.log().seen_row(at) == after.log().seen_row(at)
            && before.log().hidden_row(at) == after.log().hidden_row(at)
            && before.experience_log().seen_row(at) == after.experience_log().seen_row(at);
        if !same {
            return Some(format!("its visit {at} is another"));
        }
    }
    let features = before.features().len();
    let same_features = after.features().keypoints().get(..features)
        == Some(before.features().keypoints())
        && after.features().descriptors().get(..features) == Some(before.features().descriptors());
    (!same_features).then(|| "its features are others".into())
}

fn does_not_extend(what: &str) -> Error {
    Error::new(
        ErrorKind::Conflict,
        format!("this snapshot does not extend the stored map: {what}"),
    )
    .with_help("start from the map's own snapshot and only append")
}
