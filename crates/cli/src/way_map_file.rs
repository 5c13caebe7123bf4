//! What does a topological map of LCAS (`tmap2`) say of places and ways?
//!
//! Names and positions of nodes, and the nodes that their edges lead to; actions, areas and
//! restrictions are the planner's own. The YAML of `topological_navigation`, as
//! [`to_tmap2`](super::way_maps::to_tmap2) writes it and its own tools do.

use std::collections::BTreeSet;
use std::path::Path;

use yaml_rust2::Yaml;

use chronotope::error::{Error, ErrorKind, Result};
use chronotope::map::{Edge, PlaceKey, Snapshot};
use chronotope_terminal::yaml::document;

/// Bytes of such a file, at most.
const MAX_BYTES: u64 = 64 << 20;

/// The nodes and edges of a topological map.
#[derive(Debug, PartialEq)]
pub(super) struct WayMap {
    nodes: Vec<(PlaceKey, [f64; 3])>,
    /// From and to.
    edges: Vec<(PlaceKey, PlaceKey)>,
}

impl WayMap {
    pub(super) fn read(path: &Path) -> Result<Self> {
        let text = fremen::file::read_text(path, MAX_BYTES)?;
        Self::parse(&text).map_err(|error| error.with_path(path))
    }

    fn parse(text: &str) -> Result<Self> {
        let wrong = |message: String| {
            Error::new(ErrorKind::Format, message)
                .with_help("give a file `*.tmap2.yaml` of topological_navigation")
        };
        let map = document(text).map_err(|cause| wrong(format!("no YAML: {cause}")))?;
        let nodes =
            (map["nodes"].as_vec()).ok_or_else(|| wrong("it has no list `nodes`".into()))?;
        let mut ways = Self {
            nodes: Vec::new(),
            edges: Vec::new(),
        };
        for (number, entry) in nodes.iter().enumerate() {
            let node = &entry["node"];
            let at = |error: Error| error.with_place(format!("node {number}"));
            let key = name(&node["name"])
                .ok_or_else(|| at(wrong("it has no name".into())))
                .and_then(|name| PlaceKey::written(&name).map_err(at))?;
            let position = &node["pose"]["position"];
            let [x, y, z] = ["x", "y", "z"].map(|axis| number_of(&position[axis]));
            let (Some(x), Some(y)) = (x, y) else {
                return Err(at(wrong(format!("`{key}` has no position"))));
            };
            for edge in node["edges"].as_vec().into_iter().flatten() {
                let to = name(&edge["node"])
                    .ok_or_else(|| at(wrong(format!("an edge of `{key}` leads to no node"))))
                    .and_then(|name| PlaceKey::written(&name).map_err(at))?;
                ways.edges.push((key.clone(), to));
            }
            ways.nodes.push((key, [x, y, z.unwrap_or(0.0)]));
        }
        Ok(ways)
    }

    /// The map with what this says of its places, and the names that it does not have.
    pub(super) fn onto(&self, snapshot: &Snapshot) -> Result<(Snapshot, BTreeSet<PlaceKey>)> {
        let mut changed = snapshot.clone();
        let mut unknown = BTreeSet::new();
        for (key, pose) in &self.nodes {
            match changed.find(key) {
                Some(id) => changed.set_pose(id, Some(*pose))?,
                None => _ = unknown.insert(key.clone()),
            }
        }
        for (from, to) in &self.edges {
            let missing = [from, to]
                .into_iter()
                .find(|key| snapshot.find(key).is_none());
            if let Some(missing) = missing {
                unknown.insert(missing.clone());
                continue;
            }
            let is_known = (changed.edges().iter()).any(|it| it.from == *from && it.to == *to);
            if !is_known {
                changed.add_edge(Edge {
                    from: from.clone(),
                    to: to.clone(),
                    name: String::new(),
                })?;
            }
        }
        Ok((changed, unknown))
    }
}

/// A name, which YAML may take for a number.
fn name(value: &Yaml) -> Option<String> {
    match value {
        Yaml::String(text) | Yaml::Real(text) => Some(text.clone()),
        Yaml::Integer(number) => Some(number.to_string()),
        _ => None,
    }
}

fn number_of(value: &Yaml) -> Option<f64> {
    match value {
        Yaml::Real(_) => value.as_f64().filter(|it| it.is_finite()),
        Yaml::Integer(number) => Some(*number as f64),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::way_maps::to_tmap2;
    use chronotope::map::{MapMeta, Node};

    fn key(name: &str) -> PlaceKey {
        PlaceKey::new(name).expect("a name")
    }

    fn street(pose: Option<[f64; 3]>) -> Snapshot {
        let mut snapshot = Snapshot::empty(MapMeta::new(7, "none", "default"));
        for name in ["gate: \"north\"", "0007"] {
            let mut node = Node::new(key(name));
            node.set_pose(pose).expect("finite");
            snapshot.push_node(node).expect("a new place");
        }
        snapshot
    }

    #[test]
    fn what_was_written_is_read_back_onto_a_map_without_it() {
        let mut full = street(Some([1.5, -2.25, 3.0]));
        let edge = Edge {
            from: full.nodes()[0].key().clone(),
            to: full.nodes()[1].key().clone(),
            name: String::new(),
        };
        full.add_edge(edge).expect("both are there");
        let ways = WayMap::parse(&to_tmap2(&full, "street").expect("poses")).expect("our own");
        let (changed, unknown) = ways.onto(&street(None)).expect("fits");
        assert_eq!(changed, full);
        assert!(unknown.is_empty());
    }

    #[test]
    fn places_that_the_map_lacks_are_named() {
        let text = "nodes:\n- node:\n    name: WayPoint1\n    pose: {position: {x: 1, y: 2.5, z: 0}}\n    \
                    edges:\n    - {edge_id: a, node: '0007'}\n";
        let ways = WayMap::parse(text).expect("as LCAS writes it");
        let (changed, unknown) = ways.onto(&street(None)).expect("fits");
        assert_eq!(unknown, [key("WayPoint1")].into());
        assert!(changed.edges().is_empty());
    }

    #[test]
    fn what_is_no_topological_map_is_an_error_that_says_where() {
        for (text, words) in [
            ("", "no list"),
            ("nodes: 3", "no list"),
            ("nodes:\n- node: {name: a}\n", "node 0"),
            ("nodes:\n- {}\n", "no name"),
            ("nodes: [\n", "no YAML"),
            ("a: &x [1]\nnodes: *x\n", "line 2 has an alias"),
            (&format!("nodes: {}", "[".repeat(99_999)), "no YAML"),
        ] {
            let error = WayMap::parse(text).expect_err(text).to_string();
            assert!(
                error.contains(words) && error.contains("help"),
                "{text}: {error}"
            );
        }
    }
}
