//! Which features are worth showing?

use crate::localize::Localizer;
use crate::map::{Node, NodeId};
use fremen::visibility::FeatureState;

/// The most informative feature of each place, the most informative of all first: the one whose
/// p(t) swings furthest; where too few swing, the one whose history is split most evenly between
/// seen and not seen.
///
/// At most `num`; places without a model of time have none. O(features of the map), and no more
/// than `num` histories of places that do not swing.
pub fn most_informative(localizer: &Localizer, num: usize) -> Vec<(NodeId, usize)> {
    let snapshot = localizer.snapshot();
    let nodes = (0..snapshot.nodes().len() as u32).map(NodeId);
    let (mut swinging, mut still) = (Vec::new(), Vec::new());
    for id in nodes {
        let Some(model) = localizer.model(id) else {
            continue;
        };
        let swing = |feature| model.components(feature).iter().map(|c| c.amplitude).sum();
        let best = (0..model.num_features())
            .map(|feature| (swing(feature), feature))
            .max_by(|a: &(f64, usize), b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
        match best {
            Some((swing, feature)) if swing > 0.0 => swinging.push((swing, id, feature)),
            Some(_) => still.push(id),
            None => {}
        }
    }
    let most_first = |found: &mut Vec<(f64, NodeId, usize)>| {
        found.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    };
    most_first(&mut swinging);
    swinging.truncate(num);
    let mut split: Vec<(f64, NodeId, usize)> = (still.into_iter())
        .take(num - swinging.len())
        .filter_map(|id| {
            let (split, feature) = most_split(snapshot.node(id))?;
            Some((split, id, feature))
        })
        .collect();
    most_first(&mut split);
    (swinging.into_iter().chain(split))
        .map(|(_, id, feature)| (id, feature))
        .collect()
}

/// The feature of a place whose history is split most evenly: with a visits at which it was seen
/// and b at which it was not, a b / (a + b) is the largest. O(features x visits).
fn most_split(node: &Node) -> Option<(f64, usize)> {
    (0..node.features().len())
        .map(|feature| {
            let (mut seen, mut missed) = (0.0, 0.0);
            for visit in node.log().birth(feature)..node.log().num_visits() {
                match node.log().state(visit, feature) {
                    Some(FeatureState::Seen) => seen += 1.0,
                    Some(FeatureState::NotSeen) => missed += 1.0,
                    Some(FeatureState::NotObservable) | None => {}
                }
            }
            (seen * missed / f64::max(seen + missed, 1.0), feature)
        })
        .max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)))
}
