//! How is a map corrected by hand?
//!
//! Somebody knows better: a place has another name, two are one, one is no more, a visit was a
//! mistake. Each function gives the map as it would be; to be written with
//! [`Map::replace`](crate::map::Map::replace), which keeps the generation before.
//!
//! The identity of a visit stays what it was, also where its place has another name by now.

use std::sync::Arc;

use super::forget::without;
use super::merge::merge;
use crate::map::{Node, NodeId, PlaceKey, Quarantine, Snapshot, VisitId};
use fremen::error::{Error, ErrorKind, Result};

/// The map with another name for a place.
///
/// Fails with [`ErrorKind::NotFound`] if there is no such place, and with
/// [`ErrorKind::AlreadyExists`] if there is one of the new name.
pub fn rename_place(map: &Snapshot, from: &PlaceKey, to: &PlaceKey) -> Result<Snapshot> {
    let id = place(map, from)?;
    if map.find(to).is_some() {
        return Err(Error::new(
            ErrorKind::AlreadyExists,
            format!("the map has a place `{to}` already"),
        )
        .with_help("`map place join` makes one place of two"));
    }
    let mut renamed = map.clone();
    renamed.node_mut(id).set_key(to.clone());
    move_names(&mut renamed, from, to)?;
    Ok(renamed)
}

/// The map without a place, its edges and what is held of it.
///
/// Fails with [`ErrorKind::NotFound`] if there is no such place.
pub fn remove_place(map: &Snapshot, key: &PlaceKey) -> Result<Snapshot> {
    let id = place(map, key)?;
    let mut left = map.clone();
    left.nodes_mut().remove(id.0 as usize);
    left.retain_edges(|edge| edge.from != *key && edge.to != *key);
    let mut held = Quarantine::of(map)?;
    held.retain(|visit| visit.place != *key);
    held.attach(&mut left)?;
    Ok(left)
}

/// The map with the visits of `other` as visits of `key`, as merging two maps would have it; the
/// pose of `key` counts.
///
/// Fails with [`ErrorKind::NotFound`] if one of them is not there, and with [`ErrorKind::Config`]
/// if they are the same.
pub fn join_places(map: &Snapshot, key: &PlaceKey, other: &PlaceKey) -> Result<Snapshot> {
    let (id, other_id) = (place(map, key)?, place(map, other)?);
    if key == other {
        return Err(Error::new(
            ErrorKind::Config,
            format!("`{key}` cannot be joined with itself"),
        ));
    }
    let alone = |node: Node| {
        let mut part = Snapshot::empty(map.meta().clone());
        part.push_node(node).map(|_| part)
    };
    let mut moved = map.node(other_id).clone();
    moved.set_key(key.clone());
    moved.set_pose(map.node(id).pose().or(moved.pose()))?;
    let mut kept = map.node(id).clone();
    kept.set_pose(moved.pose())?;
    let joined = merge(&[&alone(kept)?, &alone(moved)?])?;
    let mut result = map.clone();
    result.replace_node(id, Arc::clone(&joined.nodes()[0]))?;
    result.nodes_mut().remove(other_id.0 as usize);
    move_names(&mut result, other, key)?;
    // An edge between the two leads nowhere now.
    result.retain_edges(|edge| edge.from != edge.to);
    Ok(result)
}

/// The map without one visit, and the place that it was of.
///
/// Fails with [`ErrorKind::NotFound`] if the map has not learnt it.
pub fn drop_visit(map: &Snapshot, id: VisitId) -> Result<(Snapshot, PlaceKey)> {
    let mut left = map.clone();
    for node in left.nodes_mut() {
        let kept: Vec<bool> = node.visits().iter().map(|visit| visit.id != id).collect();
        if kept.contains(&false) {
            *node = Arc::new(without(node, &kept)?);
            let key = node.key().clone();
            return Ok((left, key));
        }
    }
    Err(
        Error::new(ErrorKind::NotFound, format!("the map has no visit {id}"))
            .with_help("`chronotope map visit MAP list` shows all"),
    )
}

fn place(map: &Snapshot, key: &PlaceKey) -> Result<NodeId> {
    map.find(key).ok_or_else(|| {
        Error::new(ErrorKind::NotFound, format!("the map has no place `{key}`"))
            .with_help("`chronotope map inspect` lists the places")
    })
}

/// Gives edges and visits that are held the new name of their place.
fn move_names(map: &mut Snapshot, from: &PlaceKey, to: &PlaceKey) -> Result<()> {
    for edge in map.edges_mut() {
        for end in [&mut edge.from, &mut edge.to] {
            if end == from {
                *end = to.clone();
            }
        }
    }
    let mut edges = Vec::new();
    for edge in std::mem::take(map.edges_mut()) {
        if !edges.contains(&edge) {
            edges.push(edge);
        }
    }
    *map.edges_mut() = edges;
    let mut held = Quarantine::of(map)?;
    held.rename_place(from, to);
    held.attach(map)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feature::{Descriptor, Features, Keypoint};
    use crate::learn::{LearnConfig, Learner, Observation};
    use crate::map::{Edge, MapMeta, SessionId, derived_uuid};
    use fremen::Time;

    fn key(text: &str) -> PlaceKey {
        PlaceKey::new(text).expect("valid")
    }

    /// Three places with two visits each, in a row.
    fn map() -> Result<Snapshot> {
        let meta = MapMeta::new(derived_uuid("corrected"), "none", "default");
        let mut learner = Learner::new(LearnConfig::default(), meta);
        for number in 0..6_u64 {
            let mut features = Features::new();
            for i in 0..40_u64 {
                let word = (number % 3 * 100 + i + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
                let keypoint = Keypoint {
                    x: 20.0 + (i * 37 % 600) as f32,
                    y: 20.0 + (i * 53 % 440) as f32,
                    size: 9.0,
                    response: 1.0,
                };
                features.push(
                    keypoint,
                    Descriptor([word, !word, word << 17 | i, word >> 9 ^ i]),
                );
            }
            learner.observe(&Observation {
                place: key(["a", "b", "c"][number as usize % 3]),
                session: SessionId::derive("run"),
                time: Time::from_s(1_700_000_000 + number as i64 * 3_600),
                features: &features,
                image_size: (640, 480),
                mask: None,
                source: String::new(),
            })?;
        }
        let mut map = Snapshot::clone(&*learner.snapshot()?);
        for (from, to) in [("a", "b"), ("b", "c")] {
            map.add_edge(Edge {
                from: key(from),
                to: key(to),
                name: String::new(),
            })?;
        }
        Ok(map)
    }

    #[test]
    fn places_are_renamed_removed_and_joined_with_their_edges() -> Result<()> {
        let map = map()?;
        let renamed = rename_place(&map, &key("b"), &key("hall"))?;
        renamed.check()?;
        assert_eq!(renamed.edges()[0].to, key("hall"));
        assert_eq!(rename_place(&renamed, &key("hall"), &key("b"))?, map);
        assert!(rename_place(&map, &key("b"), &key("c")).is_err());
        assert!(rename_place(&map, &key("x"), &key("y")).is_err());

        let left = remove_place(&map, &key("b"))?;
        left.check()?;
        assert_eq!((left.nodes().len(), left.edges().len()), (2, 0));

        let joined = join_places(&map, &key("a"), &key("b"))?;
        joined.check()?;
        assert_eq!(joined.nodes().len(), 2);
        assert_eq!(joined.nodes()[0].visits().len(), 4);
        assert_eq!(
            (&joined.edges()[0].from, &joined.edges()[0].to),
            (&key("a"), &key("c"))
        );
        assert!(join_places(&map, &key("a"), &key("a")).is_err());
        Ok(())
    }

    #[test]
    fn one_visit_is_dropped_and_its_place_stays() -> Result<()> {
        let map = map()?;
        let id = map.nodes()[1].visits()[0].id;
        let (left, place) = drop_visit(&map, id)?;
        left.check()?;
        assert_eq!(place, key("b"));
        assert_eq!(left.nodes()[1].visits().len(), 1);
        assert_eq!(left.nodes()[0], map.nodes()[0]);
        assert!(drop_visit(&left, id).is_err());
        Ok(())
    }
}
