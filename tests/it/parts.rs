//! Is a place, or a map, made only of parts that are in step, and is the fault named where they are
//! not?
#![allow(
    clippy::expect_used,
    reason = "these functions all belong to tests, which clippy cannot see here"
)]

use std::sync::Arc;

use chronotope::feature::Features;
use chronotope::map::{Edge, Node, NodeParts, SnapshotParts};
use chronotope::visibility::HistoryLog;
use chronotope::{ErrorKind, Time};

use crate::map::{experience_log, folder, place, small, with_first, with_map};

#[test]
fn a_place_is_not_made_of_parts_that_are_not_in_step() {
    let (_folder, path) = folder();
    let (_, good) = small(&path);
    assert_eq!(with_first(&good, |_| {}).expect("in step"), good);
    let refused = |what: &str, change: &dyn Fn(&mut NodeParts)| {
        let error = with_first(&good, change).expect_err(what);
        assert_eq!(error.kind(), ErrorKind::Shape, "{error}");
        let message = error.to_string();
        assert!(
            message.contains("place 0") && message.contains(what),
            "{message}"
        );
    };
    refused("do not pair", &|parts| parts.features.truncate(1));
    refused("do not pair", &|parts| drop(parts.visits.pop()));
    refused("do not pair", &|parts| parts.log = HistoryLog::new());
    refused("visit 1 and the log differ", &|parts| {
        parts.visits[1].time = Time::from_us(5);
    });
    for (rows, expected) in [
        (&[(1, false), (2, false)][..], "log of experiences at 2"),
        (&[(1, false), (3, false), (3, false)], "up to visit 1"),
        (&[(0, false), (1, false), (2, false)], "up to visit 0"),
        (
            &[(1, false), (2, true), (3, false)],
            "hides some at visit 1",
        ),
    ] {
        let log = experience_log(&good, rows);
        refused(expected, &|parts| parts.experience_log = log.clone());
    }
    refused("visit 2 and the log of experiences", &|parts| {
        let mut late = HistoryLog::new();
        for (at, time) in parts.log.times().iter().enumerate() {
            let time = Time::from_us(time.as_us() + i64::from(at == 2));
            let row = parts.experience_log.seen_row(at).clone();
            late.push_visit(time, row, None).expect("fits");
        }
        parts.experience_log = late;
    });
    refused("not finite", &|parts| {
        parts.pose = Some([0.0, f64::NAN, 0.0]);
    });
    refused("keypoint 0 is not finite", &|parts| {
        let mut wild = parts.features.keypoints().to_vec();
        wild[0].size = f32::INFINITY;
        let same = parts.features.descriptors().to_vec();
        parts.features = Features::from_parts(wild, same).expect("as many");
    });
    refused("source of visit 0 is longer", &|parts| {
        parts.visits[0].source = "x".repeat(5000);
    });
    let mut node = good.nodes()[0].as_ref().clone();
    let error = node.set_pose(Some([f64::INFINITY, 0.0, 0.0]));
    assert!(
        error
            .expect_err("not finite")
            .to_string()
            .contains("not finite")
    );
    assert_eq!(node, *good.nodes()[0], "nothing has changed");
}

#[test]
fn a_map_is_not_made_of_parts_that_do_not_fit() {
    let (_folder, path) = folder();
    let (_, good) = small(&path);
    assert_eq!(with_map(&good, |_| {}).expect("sound"), good);
    let refused = |kind: ErrorKind, what: &str, change: &dyn Fn(&mut SnapshotParts)| {
        let error = with_map(&good, change).expect_err(what);
        assert_eq!(error.kind(), kind, "{error}");
        assert!(error.to_string().contains(what), "{error}");
    };
    let node = Arc::clone(&good.nodes()[0]);
    refused(ErrorKind::AlreadyExists, "in the map twice", &|parts| {
        parts.nodes.push(Arc::clone(&node));
    });
    refused(ErrorKind::AlreadyExists, "in the map twice", &|parts| {
        let mut elsewhere = Node::clone(&node).into_parts();
        elsewhere.key = place(77);
        parts
            .nodes
            .push(Arc::new(Node::from_parts(elsewhere).expect("in step")));
    });
    refused(ErrorKind::NotFound, "an edge names the place", &|parts| {
        parts.edges.push(Edge {
            from: place(0),
            to: place(77),
            name: String::new(),
        });
    });
    refused(ErrorKind::Config, "no name", &|parts| {
        parts.attachments.insert("Upper".into(), Arc::default());
    });
    refused(ErrorKind::Config, "preset is longer", &|parts| {
        parts.meta.preset = "x".repeat(5000);
    });
    let mut map = good.clone();
    let first = map.find(&place(0)).expect("there");
    let error = map.replace_node(first, Node::new(place(77)));
    assert_eq!(error.expect_err("another place").kind(), ErrorKind::Config);
    let error = map
        .push_node(Node::new(place(0)))
        .expect_err("there already");
    assert_eq!(error.kind(), ErrorKind::AlreadyExists);
    assert_eq!(map, good, "nothing has changed");
}
