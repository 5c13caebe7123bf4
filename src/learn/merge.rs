//! How do two maps of the same places become one?
//!
//! A map is taken for a set of statements, and merging is the union of such sets:
//!
//! - there is a place (with this pose), an edge, a visit (with this session, time, appearance,
//!   use);
//! - there is a feature: a keypoint with a descriptor, exactly these numbers;
//! - the feature was seen, or not seen, at the visit; *not observable* is no statement;
//! - the experience would by itself have located the later visit.
//!
//! Where two maps differ about a visit that both know, the stronger statement holds (seen over not
//! seen, an appearance over none, the larger over the smaller, an experience over a recognised
//! visit, the smaller session), so every rule is a maximum or a minimum and merging is commutative,
//! associative and idempotent. The result is a function of the union alone: places by key, visits
//! by time and identity, a feature born at the first visit that says anything of it, among those of
//! a visit the strongest first. A map merged with itself is its canonical form.
//!
//! A feature that only one of the maps has was not looked for at the visits of the other, so it was
//! *not observable* there: nothing is invented. The price: what two robots saw of one lamp stays
//! two features, each with its own half of the history, in the frame of its own map's first visit.
//! [`relearn`] avoids that where all images' features were kept: it learns the union's visits again
//! in canonical order, which is a function of their set, too.
//!
//! Of the attachments, what was counted of features seen again ([`Reobservation`]) and the visits
//! that are held ([`Quarantine`], unless one of the maps has learnt them) are merged; others
//! describe one map and are left out.
//!
//! O(places * visits * features / 64 + bytes). Not for: maps with different extractors, image sizes
//! or poses, which are conflicts.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::config::{KeepAppearances, LearnConfig};
use super::guard_config::Judge;
use super::learner::Learner;
use super::visit::Observation;
use crate::feature::{Descriptor, Features, Keypoint};
use crate::map::{
    AppearanceUse, Edge, MapMeta, Node, PlaceKey, Quarantine, Reobservation, Snapshot,
    SnapshotParts, Visit, VisitId,
};
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::Time;
use fremen::visibility::BitRow;

/// Conflicts listed in one message, at most.
const MAX_TOLD: usize = 10;

/// Merges maps, in any order and grouping, into the canonical form of their union.
///
/// The result has the smallest UUID, of the attachments those that can be merged, and is of
/// generation 0. [`ErrorKind::Config`] names the conflicts: maps that differ in extractor, image
/// size, crop, preset or zone, or in the pose of a place, and visits with one identity and two
/// times.
///
/// # Errors
/// Also if there is no map, if a place would have more features than a map may hold, or if an
/// attachment that is merged cannot be read.
pub fn merge(maps: &[&Snapshot]) -> Result<Snapshot> {
    let mut union = Union::default();
    let mut held = Quarantine::default();
    let mut reobservation: Option<Reobservation> = None;
    for map in maps {
        union.add(map);
        held.merge(&Quarantine::of(map)?);
        let counted = Reobservation::of(map)?;
        match &mut reobservation {
            Some(so_far) => so_far.merge(&counted),
            None => reobservation = Some(counted),
        }
    }
    if !union.conflicts.is_empty() {
        let listed: Vec<&str> = (union.conflicts.iter().map(String::as_str))
            .take(MAX_TOLD)
            .collect();
        return Err(Error::new(
            ErrorKind::Config,
            format!(
                "the maps contradict each other in {} points: {}{}",
                union.conflicts.len(),
                listed.join("; "),
                if union.conflicts.len() > MAX_TOLD {
                    "; ..."
                } else {
                    ""
                }
            ),
        )
        .with_help(
            "only maps of the same places, learnt from the same kind of images, can be merged",
        ));
    }
    let meta =
        (union.meta).ok_or_else(|| Error::new(ErrorKind::Config, "there is no map to merge"))?;
    let places = union.places.into_iter();
    let mut snapshot = Snapshot::from_sound_places(SnapshotParts {
        nodes: places
            .map(|(key, place)| place.into_node(key).map(Arc::new))
            .collect::<Result<_>>()?,
        edges: (union.edges.into_iter())
            .map(|(from, to, name)| Edge { from, to, name })
            .collect(),
        ..Snapshot::empty(meta).into_parts()
    })?;
    let visits = snapshot.nodes().iter().flat_map(|node| node.visits());
    visits.for_each(|visit| drop(held.take(visit.id)));
    held.attach(&mut snapshot)?;
    if let Some(reobservation) = reobservation {
        reobservation.attach(&mut snapshot);
    }
    Ok(snapshot)
}

/// Puts the parts of maps together: parts of one map, which were learnt apart from each other (place by place on
/// a cluster), and then these maps, as [`merge`] does.
///
/// Parts of one map have its UUID. A part that is given twice counts once; of others, what was counted of
/// features seen again is added, so that the whole is what one learner of all places would have counted.
pub fn join(parts: &[&Snapshot]) -> Result<Snapshot> {
    let mut maps = BTreeMap::<u128, BTreeMap<_, &Snapshot>>::new();
    for part in parts {
        let map = maps.entry(part.meta().uuid).or_default();
        map.insert(part.digest(), part);
    }
    let whole = maps.into_values().map(|parts| {
        let parts: Vec<&Snapshot> = parts.into_values().collect();
        let mut map = merge(&parts)?;
        let mut counted = Reobservation::new(map.meta().uuid);
        for part in parts {
            counted.add(&Reobservation::of(part)?);
        }
        counted.attach(&mut map);
        Ok(map)
    });
    let whole = whole.collect::<Result<Vec<_>>>()?;
    merge(&whole.iter().collect::<Vec<_>>())
}

/// Learns all visits of a map again, in order of time and identity, from their own features.
///
/// The result is a function of the set of visits and the configuration; what is held stays held.
/// Masks are not kept with a visit that was learnt: what one hid counts as not seen here.
/// [`ErrorKind::NotFound`] if a visit's features were not kept.
pub fn relearn(cfg: LearnConfig, map: &Snapshot) -> Result<Snapshot> {
    let mut visits: Vec<(&Node, &Visit)> = (map.nodes().iter())
        .flat_map(|node| node.visits().iter().map(move |visit| (&**node, visit)))
        .collect();
    visits.sort_by_key(|(_, visit)| (visit.time, visit.id));
    let image_size = map.meta().image_size.unwrap_or_default();
    // A map's visits are believed already.
    let guard = cfg.guard().clone().with_judge(Judge::Never);
    let cfg = (cfg.with_guard(guard)).with_keep_appearances(KeepAppearances::All);
    let cfg = cfg.with_stay_gap_s(0);
    let mut learner = Learner::new(cfg, map.meta().clone());
    for (node, visit) in &visits {
        let Some(features) = &visit.appearance else {
            return Err(Error::new(
                ErrorKind::NotFound,
                format!("the features of the visit at {} were not kept", visit.time),
            )
            .with_place(format!("place `{}`", node.key()))
            .with_help(
                "build the maps with `--keep-appearances all`, or merge without learning again",
            ));
        };
        learner.observe(&Observation {
            place: node.key().clone(),
            session: visit.session,
            time: visit.time,
            features,
            image_size,
            mask: None,
            source: visit.source.clone(),
        })?;
    }
    let learnt = learner.snapshot()?;
    let mut nodes = Vec::with_capacity(map.nodes().len());
    for node in map.nodes() {
        let mut again = (learnt.find(node.key())).map_or_else(
            || Node::new(node.key().clone()),
            |id| learnt.node(id).clone(),
        );
        again.set_pose(node.pose())?;
        // The identity is that of the image, of which only the strongest features may have been
        // kept.
        let ids = visits.iter().filter(|(of, _)| of.key() == node.key());
        let mut parts = again.into_parts();
        for (visit, (_, original)) in parts.visits.iter_mut().zip(ids) {
            visit.id = original.id;
        }
        nodes.push(Arc::new(Node::from_parts(parts)?));
    }
    let mut snapshot = Snapshot::from_sound_places(SnapshotParts {
        nodes,
        edges: map.edges().to_vec(),
        attachments: learnt.attachments().clone(),
        ..Snapshot::empty(map.meta().clone()).into_parts()
    })?;
    Quarantine::of(map)?.attach(&mut snapshot)?;
    Ok(snapshot)
}

/// The statements of all maps so far.
#[derive(Default)]
struct Union {
    meta: Option<MapMeta>,
    places: BTreeMap<PlaceKey, Place>,
    edges: BTreeSet<(PlaceKey, PlaceKey, String)>,
    conflicts: Vec<String>,
}

impl Union {
    fn add(&mut self, map: &Snapshot) {
        match &mut self.meta {
            None => self.meta = Some(map.meta().clone()),
            Some(meta) => merge_meta(meta, map.meta(), &mut self.conflicts),
        }
        for edge in map.edges() {
            self.edges
                .insert((edge.from.clone(), edge.to.clone(), edge.name.clone()));
        }
        for node in map.nodes() {
            let place = self.places.entry(node.key().clone()).or_default();
            place.add(node, &mut self.conflicts);
        }
    }
}

fn merge_meta(meta: &mut MapMeta, other: &MapMeta, conflicts: &mut Vec<String>) {
    let mut differ = |what: &str, a: String, b: String| {
        if a != b {
            conflicts.push(format!(
                "{what} {} or {}",
                a.clone().min(b.clone()),
                a.max(b)
            ));
        }
    };
    differ("extractor", meta.extractor.clone(), other.extractor.clone());
    differ("preset", meta.preset.clone(), other.preset.clone());
    differ(
        "crop",
        format!("{:?}", meta.crop),
        format!("{:?}", other.crop),
    );
    // What one of the maps does not know yet the other may know.
    if let (Some(a), Some(b)) = (meta.image_size, other.image_size) {
        differ(
            "image size",
            format!("{} x {} px", a.0, a.1),
            format!("{} x {} px", b.0, b.1),
        );
    }
    if let (Some(a), Some(b)) = (&meta.zone, &other.zone) {
        differ("zone", a.clone(), b.clone());
    }
    meta.uuid = meta.uuid.min(other.uuid);
    meta.image_size = meta.image_size.max(other.image_size);
    meta.zone = meta.zone.take().max(other.zone.clone());
}

/// The statements about one place.
#[derive(Default)]
struct Place {
    pose: Option<[f64; 3]>,
    visits: BTreeMap<(Time, VisitId), Account>,
    /// The time of each visit, to notice a second one.
    times: BTreeMap<VisitId, Time>,
    /// Position of each feature in the rows of bits.
    features: BTreeMap<FeatureKey, usize>,
}

/// The statements about one visit.
struct Account {
    visit: Visit,
    /// Features that were seen.
    seen: Columns,
    /// Features that were looked for: those seen among them.
    known: Columns,
    /// Experiences that would have located it.
    located_by: BTreeSet<VisitId>,
}

/// A set of features, as bits.
#[derive(Default)]
struct Columns(Vec<u64>);

impl Columns {
    fn insert(&mut self, column: usize) {
        if self.0.len() <= column / 64 {
            self.0.resize(column / 64 + 1, 0);
        }
        self.0[column / 64] |= 1 << (column % 64);
    }

    fn iter(&self) -> impl Iterator<Item = usize> {
        let bits = |word: u64| (0..64).filter(move |bit| word >> bit & 1 == 1);
        (self.0.iter().enumerate())
            .flat_map(move |(at, &word)| bits(word).map(move |bit| at * 64 + bit))
    }
}

/// A feature by its exact numbers; the strongest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct FeatureKey {
    response: std::cmp::Reverse<i32>,
    x: i32,
    y: i32,
    size: i32,
    descriptor: Descriptor,
}

impl FeatureKey {
    fn new(keypoint: &Keypoint, descriptor: Descriptor) -> Self {
        Self {
            response: std::cmp::Reverse(ordered(keypoint.response)),
            x: ordered(keypoint.x),
            y: ordered(keypoint.y),
            size: ordered(keypoint.size),
            descriptor,
        }
    }

    fn keypoint(&self) -> Keypoint {
        Keypoint {
            x: unordered(self.x),
            y: unordered(self.y),
            size: unordered(self.size),
            response: unordered(self.response.0),
        }
    }
}

/// An integer that is ordered as [`f32::total_cmp`] orders.
fn ordered(number: f32) -> i32 {
    let bits = number.to_bits() as i32;
    bits ^ ((bits >> 31) as u32 >> 1) as i32
}

/// The inverse of [`ordered`].
fn unordered(integer: i32) -> f32 {
    f32::from_bits((integer ^ ((integer >> 31) as u32 >> 1) as i32) as u32)
}

impl Place {
    fn add(&mut self, node: &Node, conflicts: &mut Vec<String>) {
        match (self.pose, node.pose()) {
            (Some(a), Some(b)) if a != b => {
                conflicts.push(format!("place `{}` at {a:?} m or at {b:?} m", node.key()));
            }
            (a, b) => self.pose = a.or(b),
        }
        let columns: Vec<usize> = (node.features().keypoints().iter())
            .zip(node.features().descriptors())
            .map(|(keypoint, &descriptor)| {
                let next = self.features.len();
                *(self.features)
                    .entry(FeatureKey::new(keypoint, descriptor))
                    .or_insert(next)
            })
            .collect();
        let experiences: Vec<VisitId> = (node.visits().iter())
            .filter(|visit| visit.appearance_use == AppearanceUse::Experience)
            .map(|visit| visit.id)
            .collect();
        for (at, visit) in node.visits().iter().enumerate() {
            if *self.times.entry(visit.id).or_insert(visit.time) != visit.time {
                conflicts.push(format!("visit {} has two times", visit.id));
            }
            let entry = self
                .visits
                .entry((visit.time, visit.id))
                .or_insert_with(|| Account {
                    visit: visit.clone(),
                    seen: Columns::default(),
                    known: Columns::default(),
                    located_by: BTreeSet::new(),
                });
            merge_visit(&mut entry.visit, visit);
            let row = node.log().seen_row(at);
            let hidden = node.log().hidden_row(at);
            let known = (0..row.len()).filter(|&i| !hidden.is_some_and(|hidden| hidden.get(i)));
            known.for_each(|i| entry.known.insert(columns[i]));
            row.ones().for_each(|i| entry.seen.insert(columns[i]));
            let located_by = node.experience_log().seen_row(at).ones();
            entry.located_by.extend(located_by.map(|i| experiences[i]));
        }
    }

    fn into_node(self, key: PlaceKey) -> Result<Node> {
        let mut node = Node::new(key);
        node.set_pose(self.pose)?;
        // Features in order of birth, which is the first visit that knows of them.
        let mut births = vec![0; self.features.len()];
        for (at, entry) in self.visits.values().enumerate().rev() {
            (entry.known.iter()).for_each(|column| births[column] = at);
        }
        let mut order: Vec<(usize, FeatureKey, usize)> = (self.features.iter())
            .map(|(&key, &column)| (births[column], key, column))
            .collect();
        order.sort_unstable();
        let mut ids = vec![0; order.len()];
        for (id, &(_, _, column)) in order.iter().enumerate() {
            ids[column] = id;
        }
        let mut experiences: BTreeMap<VisitId, usize> = BTreeMap::new();
        for (at, entry) in self.visits.into_values().enumerate() {
            let len = order.partition_point(|&(birth, ..)| birth <= at);
            let mut born = Features::new();
            for (_, key, _) in &order[node.features().len()..len] {
                born.push(key.keypoint(), key.descriptor);
            }
            let mut seen = BitRow::zeros(len);
            for column in entry.seen.iter() {
                seen.set(ids[column]);
            }
            let mut known = BitRow::zeros(len);
            for column in entry.known.iter() {
                known.set(ids[column]);
            }
            let mut hidden = BitRow::zeros(len);
            (0..len)
                .filter(|&id| !known.get(id))
                .for_each(|id| hidden.set(id));
            if entry.visit.appearance_use == AppearanceUse::Experience {
                experiences.insert(entry.visit.id, experiences.len());
            }
            let mut located_by = BitRow::zeros(experiences.len());
            for experience in &entry.located_by {
                // One that was seen later cannot have located this visit.
                if let Some(&bit) = experiences.get(experience) {
                    located_by.set(bit);
                }
            }
            let hidden = (hidden.count_ones() > 0).then_some(hidden);
            node.push_visit(entry.visit, &born, seen, hidden, located_by)?;
        }
        Ok(node)
    }
}

/// The stronger of two accounts of one visit.
fn merge_visit(visit: &mut Visit, other: &Visit) {
    // Two runs learnt one image: a folder by two names, say.
    visit.session = visit.session.min(other.session);
    if other.source > visit.source {
        visit.source.clone_from(&other.source);
    }
    if other.appearance_use == AppearanceUse::Experience {
        visit.appearance_use = AppearanceUse::Experience;
    }
    let rank = |appearance: &Option<Arc<Features>>| {
        appearance.as_ref().map(|features| {
            let keys: Vec<FeatureKey> = (features.keypoints().iter())
                .zip(features.descriptors())
                .map(|(keypoint, &descriptor)| FeatureKey::new(keypoint, descriptor))
                .collect();
            (keys.len(), keys)
        })
    };
    let is_shared = match (&visit.appearance, &other.appearance) {
        (Some(a), Some(b)) => Arc::ptr_eq(a, b),
        (_, None) => true,
        (None, Some(_)) => false,
    };
    if !is_shared && rank(&other.appearance) > rank(&visit.appearance) {
        visit.appearance.clone_from(&other.appearance);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn floats_and_their_integers_are_ordered_alike(a in any::<f32>(), b in any::<f32>()) {
            prop_assert_eq!(a.total_cmp(&b), ordered(a).cmp(&ordered(b)));
            prop_assert_eq!(unordered(ordered(a)).to_bits(), a.to_bits());
        }
    }
}
