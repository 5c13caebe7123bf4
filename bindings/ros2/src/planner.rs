//! What does a planner hear of an answer?
//!
//! The topics of LCAS `topological_navigation`: `current_node` is the place where the robot surely
//! is, `closest_node` the most probable one, `closest_node_distance` how far from it the robot is
//! believed to be, and `closest_edges` the two ways nearest to that. A camera measures no metres: the
//! position is the mean of the places' poses, weighted by how probable each of them is. Where
//! nothing is known, names are `none` and distances not a number.

use chronotope::localize::{Decision, Localization};
use chronotope::map::{NodeId, Snapshot};

/// The name of no place.
pub(crate) const NOWHERE: &str = "none";
/// So many edges are published.
const NUM_EDGES: usize = 2;

/// What is published, as names.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct PlannerView {
    pub(crate) current: String,
    pub(crate) closest: String,
    /// Metres.
    pub(crate) closest_m: f32,
    /// `FROM_TO`, as `chronotope map export --format tmap2` names them.
    pub(crate) edges: Vec<String>,
    /// Metres from each of them.
    pub(crate) edges_m: Vec<f32>,
}

impl PlannerView {
    /// Of a robot that may be anywhere.
    pub(crate) fn nowhere() -> Self {
        Self {
            current: NOWHERE.to_owned(),
            closest: NOWHERE.to_owned(),
            closest_m: f32::NAN,
            edges: Vec::new(),
            edges_m: Vec::new(),
        }
    }

    pub(crate) fn of(snapshot: &Snapshot, answer: &Localization) -> Self {
        let key = |id: NodeId| snapshot.node(id).key().to_string();
        let Some(first) = answer.first() else {
            return Self::nowhere();
        };
        if answer.decision == Decision::Unknown {
            return Self::nowhere();
        }
        let position = mean_position(snapshot, answer);
        let pose = |id: NodeId| snapshot.node(id).pose().map(|[x, y, _]| [x, y]);
        let closest_m = (position.zip(pose(first.node)))
            .map_or(f64::NAN, |(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]));
        let mut edges = Vec::new();
        for edge in snapshot.edges() {
            let ends = [&edge.from, &edge.to].map(|it| snapshot.find(it));
            let [Some(from), Some(to)] = ends else {
                continue;
            };
            let name = format!("{}_{}", edge.from, edge.to);
            match (position, pose(from), pose(to)) {
                (Some(position), Some(from), Some(to)) => {
                    edges.push((distance_to(position, from, to), name));
                }
                _ if from == first.node || to == first.node => edges.push((f64::NAN, name)),
                _ => {}
            }
        }
        edges.sort_by(|a, b| a.0.total_cmp(&b.0).then_with(|| a.1.cmp(&b.1)));
        edges.truncate(NUM_EDGES);
        let (edges_m, edges) = edges.into_iter().map(|it| (it.0 as f32, it.1)).unzip();
        Self {
            current: match answer.decision {
                Decision::At(node) => key(node),
                _ => NOWHERE.to_owned(),
            },
            closest: key(first.node),
            closest_m: closest_m as f32,
            edges,
            edges_m,
        }
    }
}

/// The mean of the poses, weighted by the posterior, m.
fn mean_position(snapshot: &Snapshot, answer: &Localization) -> Option<[f64; 2]> {
    let (mut sum, mut total) = ([0.0; 2], 0.0);
    for candidate in &answer.ranking {
        if let Some([x, y, _]) = snapshot.node(candidate.node).pose() {
            sum[0] += candidate.posterior * x;
            sum[1] += candidate.posterior * y;
            total += candidate.posterior;
        }
    }
    (total > 0.0).then(|| sum.map(|it| it / total))
}

/// From a point to the nearest one between two others.
fn distance_to(point: [f64; 2], from: [f64; 2], to: [f64; 2]) -> f64 {
    let along = [to[0] - from[0], to[1] - from[1]];
    let offset = [point[0] - from[0], point[1] - from[1]];
    let length = along[0] * along[0] + along[1] * along[1];
    let share = if length > 0.0 {
        ((offset[0] * along[0] + offset[1] * along[1]) / length).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (offset[0] - share * along[0]).hypot(offset[1] - share * along[1])
}

#[cfg(test)]
mod tests {
    use chronotope::localize::Candidate;
    use chronotope::map::{Edge, MapMeta, Node, PlaceKey};

    use super::*;

    fn street(has_poses: bool) -> Snapshot {
        let mut snapshot = Snapshot::empty(MapMeta::new(1, "star+brief", "default"));
        for (number, name) in ["door", "hall", "yard"].into_iter().enumerate() {
            let mut node = Node::new(PlaceKey::new(name).expect("a name"));
            node.set_pose(has_poses.then_some([10.0 * number as f64, 0.0, 0.0]))
                .expect("finite");
            snapshot.push_node(node).expect("a new name");
        }
        for (from, to) in [("door", "hall"), ("hall", "door"), ("hall", "yard")] {
            let key = |name: &str| PlaceKey::new(name).expect("a name");
            let edge = Edge {
                from: key(from),
                to: key(to),
                name: String::new(),
            };
            snapshot.add_edge(edge).expect("both ends are there");
        }
        snapshot
    }

    fn answer(decision: Decision, posteriors: &[f64]) -> Localization {
        let mut answer = Localization::default();
        answer.ranking = (0..)
            .zip(posteriors)
            .map(|(node, &posterior)| Candidate {
                node: NodeId(node),
                posterior,
                ..Candidate::default()
            })
            .collect();
        answer.decision = decision;
        answer
    }

    #[test]
    fn the_robot_is_between_places_as_the_posterior_says() {
        let at = answer(Decision::At(NodeId(0)), &[0.75, 0.25, 0.0]);
        let view = PlannerView::of(&street(true), &at);
        assert_eq!(
            (view.current.as_str(), view.closest.as_str()),
            ("door", "door")
        );
        assert!((view.closest_m - 2.5).abs() < 1e-6);
        assert_eq!(view.edges, ["door_hall", "hall_door"]);
        assert_eq!(view.edges_m, [0.0, 0.0]);
        let near = answer(Decision::Near(NodeId(0)), &[0.5, 0.5, 0.0]);
        let view = PlannerView::of(&street(true), &near);
        assert_eq!(
            (view.current.as_str(), view.closest.as_str()),
            ("none", "door")
        );
    }

    #[test]
    fn without_poses_there_are_no_metres_and_off_the_map_no_names() {
        let at = answer(Decision::At(NodeId(0)), &[0.9, 0.1, 0.0]);
        let view = PlannerView::of(&street(false), &at);
        assert!(view.closest_m.is_nan() && view.edges_m.iter().all(|it| it.is_nan()));
        assert_eq!(view.edges, ["door_hall", "hall_door"]);
        let unknown = answer(Decision::Unknown, &[0.1, 0.1, 0.1]);
        let view = PlannerView::of(&street(true), &unknown);
        assert_eq!(
            (view.current.as_str(), view.closest.as_str()),
            ("none", "none")
        );
    }

    #[test]
    fn distances_to_ways_end_at_their_ends() {
        assert_eq!(distance_to([-3.0, 4.0], [0.0, 0.0], [10.0, 0.0]), 5.0);
        assert_eq!(distance_to([4.0, 2.0], [0.0, 0.0], [10.0, 0.0]), 2.0);
        assert_eq!(distance_to([3.0, 4.0], [0.0, 0.0], [0.0, 0.0]), 5.0);
    }
}
