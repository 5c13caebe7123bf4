//! How do planners and other programs read the places of a map and the ways between them?
//!
//! Three formats of a map's topology, without what its places look like:
//!
//! - `tmap2`: the YAML of LCAS `topological_navigation`; a place is a node with its position (looking
//!   along the x axis: a map does not keep headings), a way an edge with the action `NavigateToPose`;
//! - `geojson` (RFC 7946): places as points, ways as lines, in degrees around an origin;
//! - `dot`: a graph for Graphviz.

use std::f64::consts::PI;
use std::fmt::Write as _;

use clap::ValueEnum;
use serde_json::{Value, json};

use chronotope::error::{Error, ErrorKind, Result};
use chronotope::map::{Node, PlaceKey, Snapshot};

/// WGS 84, m.
const EQUATOR_RADIUS_M: f64 = 6_378_137.0;
/// How far from a node its area reaches, m: the influence zone that LCAS tools draw by default.
const AREA_RADIUS_M: f64 = 1.0;
const AREA_CORNERS: u32 = 8;

/// What a map is exported as.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(super) enum ExportFormat {
    /// A folder of plain files with all of it.
    #[default]
    Folder,
    /// Places and ways for `topological_navigation` of LCAS.
    Tmap2,
    /// Places and ways in degrees, as geographic tools read them; needs --origin.
    Geojson,
    /// Places and ways for Graphviz.
    Dot,
}

/// Latitude and longitude of what is zero metres, degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Origin {
    latitude: f64,
    longitude: f64,
}

impl std::str::FromStr for Origin {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let numbers: Option<Vec<f64>> = text
            .split(',')
            .map(|part| part.trim().parse().ok())
            .collect();
        match numbers.as_deref() {
            // Nearer to a pole than that, metres are no degrees.
            Some(&[latitude, longitude]) if latitude.abs() < 89.0 && longitude.abs() <= 180.0 => {
                Ok(Self {
                    latitude,
                    longitude,
                })
            }
            _ => Err(Error::new(
                ErrorKind::Config,
                format!("`{text}` is no point on the Earth"),
            )
            .with_help("write latitude and longitude in degrees, such as 50.0755,14.4378")),
        }
    }
}

/// The text of a YAML file for LCAS `topological_navigation`; every place needs a pose.
pub(super) fn to_tmap2(snapshot: &Snapshot, name: &str) -> Result<String> {
    let nodes: Vec<(&Node, [f64; 3])> = with_poses(snapshot)?;
    let name = quoted(name);
    let mut text = format!(
        "meta:\n  last_updated: {}\nmetric_map: {name}\nname: {name}\npointset: {name}\n\
         transformation:\n  child: topo_map\n  parent: map\n  rotation: {{w: 1.0, x: 0.0, y: 0.0, z: \
         0.0}}\n  translation: {{x: 0.0, y: 0.0, z: 0.0}}\nnodes:\n",
        quoted(&last_visit(snapshot)),
    );
    for (node, [x, y, z]) in nodes {
        let key = quoted(node.key().as_str());
        let _ = write!(
            text,
            "- meta:\n    map: {name}\n    node: {key}\n    pointset: {name}\n  node:\n    edges:"
        );
        let ways: Vec<_> = (snapshot.edges().iter())
            .filter(|edge| edge.from == *node.key())
            .collect();
        text += if ways.is_empty() { " []\n" } else { "\n" };
        for edge in ways {
            let id = quoted(&format!("{}_{}", edge.from, edge.to));
            let to = quoted(edge.to.as_str());
            let _ = write!(
                text,
                "    - action: NavigateToPose\n      action_type: geometry_msgs/PoseStamped\n      config: []\n      \
                 edge_id: {id}\n      fail_policy: fail\n      fluid_navigation: true\n      goal:\n        \
                 target_pose:\n          header:\n            frame_id: $node.parent_frame\n          pose: \
                 $node.pose\n      node: {to}\n      recovery_behaviours_config: ''\n      \
                 restrictions_planning: 'True'\n      restrictions_runtime: 'True'\n"
            );
        }
        let _ = write!(
            text,
            "    localise_by_topic: ''\n    name: {key}\n    parent_frame: map\n    pose:\n      orientation: \
             {{w: 1.0, x: 0.0, y: 0.0, z: 0.0}}\n      position: {{x: {x:.6}, y: {y:.6}, z: {z:.6}}}\n    \
             properties:\n      xy_goal_tolerance: 0.3\n      yaw_goal_tolerance: 0.1\n    \
             restrictions_planning: 'True'\n    restrictions_runtime: 'True'\n    verts:\n"
        );
        for corner in 0..AREA_CORNERS {
            let angle = 2.0 * PI * (f64::from(corner) + 0.5) / f64::from(AREA_CORNERS);
            let (dy, dx) = angle.sin_cos();
            let _ = writeln!(
                text,
                "    - {{x: {:.3}, y: {:.3}}}",
                AREA_RADIUS_M * dx,
                AREA_RADIUS_M * dy
            );
        }
    }
    Ok(text)
}

/// The text of a `GeoJSON` file, its poses taken as metres east and north of `origin`.
pub(super) fn to_geojson(snapshot: &Snapshot, origin: Origin) -> Result<String> {
    let nodes = with_poses(snapshot)?;
    let point = |[x, y, z]: [f64; 3]| -> [f64; 3] {
        let scale_east = origin.latitude.to_radians().cos();
        let longitude = origin.longitude + (x / (EQUATOR_RADIUS_M * scale_east)).to_degrees();
        [
            longitude,
            origin.latitude + (y / EQUATOR_RADIUS_M).to_degrees(),
            z,
        ]
    };
    let mut features: Vec<Value> = (nodes.iter())
        .map(|(node, pose)| {
            json!({
                "type": "Feature",
                "id": node.key().as_str(),
                "geometry": { "type": "Point", "coordinates": point(*pose) },
                "properties": { "place": node.key().as_str(), "visits": node.visits().len() },
            })
        })
        .collect();
    let pose_of = |key: &PlaceKey| {
        let found = nodes.iter().find(|(node, _)| *node.key() == *key);
        found.map(|(_, pose)| point(*pose))
    };
    for edge in snapshot.edges() {
        if let (Some(from), Some(to)) = (pose_of(&edge.from), pose_of(&edge.to)) {
            features.push(json!({
                "type": "Feature",
                "geometry": { "type": "LineString", "coordinates": [from, to] },
                "properties": {
                    "from": edge.from.as_str(), "to": edge.to.as_str(), "name": edge.name,
                },
            }));
        }
    }
    let collection = json!({ "type": "FeatureCollection", "features": features });
    Ok(format!("{collection:#}\n"))
}

/// The text of a graph for Graphviz; places that have poses are pinned there (`neato -n`, in
/// points of 1/72 inch a metre).
pub(super) fn to_dot(snapshot: &Snapshot, name: &str) -> String {
    let mut text = format!("digraph {} {{\n  node [shape=box];\n", dot_quoted(name));
    for node in snapshot.nodes() {
        let key = dot_quoted(node.key().as_str());
        let _ = match node.pose() {
            Some([x, y, _]) => {
                writeln!(text, "  {key} [pos=\"{:.3},{:.3}!\"];", 72.0 * x, 72.0 * y)
            }
            None => writeln!(text, "  {key};"),
        };
    }
    for edge in snapshot.edges() {
        let (from, to) = (dot_quoted(edge.from.as_str()), dot_quoted(edge.to.as_str()));
        let _ = match edge.name.as_str() {
            "" => writeln!(text, "  {from} -> {to};"),
            name => writeln!(text, "  {from} -> {to} [label={}];", dot_quoted(name)),
        };
    }
    text += "}\n";
    text
}

fn with_poses(snapshot: &Snapshot) -> Result<Vec<(&Node, [f64; 3])>> {
    (snapshot.nodes().iter())
        .map(|node| match node.pose() {
            Some(pose) => Ok((&**node, pose)),
            None => Err(Error::new(
                ErrorKind::Config,
                format!("the place `{}` has no position", node.key()),
            )
            .with_help(
                "build the map with a poses.csv or from a bag, or export as dot, which needs none",
            )),
        })
        .collect()
}

fn last_visit(snapshot: &Snapshot) -> String {
    (snapshot.summary().last).map_or_else(|| "never".into(), |last| last.to_string())
}

/// As YAML takes it: JSON's strings are strings of YAML.
fn quoted(text: &str) -> String {
    Value::from(text).to_string()
}

/// As Graphviz takes it: only quotes are escaped, a backslash before one is doubled.
fn dot_quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
}

#[cfg(test)]
mod tests {
    use super::*;
    use chronotope::map::{Edge, MapMeta};

    fn street() -> Snapshot {
        let mut snapshot = Snapshot::empty(MapMeta::new(7, "none", "default"));
        let keys = ["gate \"north\"", "door"].map(|name| PlaceKey::new(name).expect("a name"));
        for (key, pose) in keys.iter().zip([[0.0, 0.0, 0.0], [0.0, 111.319_49, 0.0]]) {
            let mut node = Node::new(key.clone());
            node.set_pose(Some(pose)).expect("finite");
            snapshot.push_node(node).expect("a new place");
        }
        let edge = Edge {
            from: keys[0].clone(),
            to: keys[1].clone(),
            name: String::new(),
        };
        snapshot.add_edge(edge).expect("both are there");
        snapshot
    }

    #[test]
    fn geojson_is_in_degrees_around_the_origin() {
        let origin = "50,14".parse().expect("a point");
        let text = to_geojson(&street(), origin).expect("all have poses");
        let found: Value = serde_json::from_str(&text).expect("JSON");
        let features = found["features"].as_array().expect("a list");
        assert_eq!(features.len(), 3);
        let door = features
            .iter()
            .find(|it| it["id"] == "door")
            .expect("there");
        let latitude = door["geometry"]["coordinates"][1]
            .as_f64()
            .expect("a number");
        assert!((latitude - 50.001).abs() < 1e-7, "{latitude}");
        assert!("91,0".parse::<Origin>().is_err() && "nan,0".parse::<Origin>().is_err());
    }

    #[test]
    fn names_are_quoted_and_ways_are_there() {
        let snapshot = street();
        let tmap = to_tmap2(&snapshot, "street").expect("all have poses");
        assert!(
            tmap.contains("edge_id: \"gate \\\"north\\\"_door\""),
            "{tmap}"
        );
        assert_eq!(tmap.matches("    edges: []\n").count(), 1, "{tmap}");
        let dot = to_dot(&snapshot, "street");
        assert!(dot.contains("\"gate \\\"north\\\"\" -> \"door\";"), "{dot}");
    }

    #[test]
    fn a_place_without_a_position_is_named() {
        let mut snapshot = Snapshot::empty(MapMeta::new(7, "none", "default"));
        let key = PlaceKey::new("door").expect("a name");
        snapshot.push_node(Node::new(key)).expect("a new place");
        let error = to_tmap2(&snapshot, "street").expect_err("no position");
        assert!(error.to_string().contains("`door`"), "{error}");
        assert!(to_dot(&snapshot, "street").contains("\"door\";"));
    }
}
