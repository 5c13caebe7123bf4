//! Which features does each view of a camera show, image by image?
//!
//! The features of a place are those that a map of all images learns, and whether one is seen in an
//! image is what the learner found: known here to the one who judges, and to the robot only of the
//! views that it visits. This is the stand-in for the features of the eight places of RAS 2016.

use std::collections::BTreeMap;

use anyhow::{Context, Result};
use chronotope::Time;
use chronotope::map::{Node, Snapshot};
use fremen::visibility::FeatureState;
use fremen_explore::Recording;
use sha2::{Digest, Sha256};

use super::data::Dataset;
use crate::data::extracted;
use crate::provenance::hex;
use crate::run::{RunOptions, learn_all};
use crate::suite::Suite;

/// Of each place, so many of the features that are seen most often.
const NUM_FEATURES: usize = 50;

/// Slots of half an hour: images are about twenty minutes apart.
const SLOTS_A_DAY: usize = 48;

/// What every view of the suite's images shows.
pub(super) fn read(suite: &Suite, options: &RunOptions) -> Result<Dataset> {
    let data = extracted(
        suite,
        options.data.as_deref(),
        &options.cache,
        &*options.extractor()?,
    )?;
    let mut digest = Sha256::new();
    for image in &data.extracted {
        digest.update(image.digest);
    }
    let snapshot = learn_all(&data)?;
    Ok(Dataset {
        recording: recording(&snapshot)?,
        slots_a_day: SLOTS_A_DAY,
        moments: "a moment an image",
        roads: None,
        published: None,
        sha256: hex(&digest.finalize()),
    })
}

/// The moments at which every place was seen, with the states of its features.
fn recording(snapshot: &Snapshot) -> Result<Recording> {
    let nodes = snapshot.nodes();
    let mut visits: BTreeMap<Time, Vec<usize>> = BTreeMap::new();
    for node in nodes {
        for (visit, &time) in node.log().times().iter().enumerate() {
            visits.entry(time).or_default().push(visit);
        }
    }
    // A time at which a place was not seen has fewer visits than there are places.
    visits.retain(|_, visits| visits.len() == nodes.len());
    let mut recording = Recording::new(visits.keys().copied().collect())
        .context("the places were never seen at one time")?;
    for (place, node) in nodes.iter().enumerate() {
        let features = often_seen(node);
        let states = visits.values().flat_map(|visits| {
            let visit = visits[place];
            (features.iter()).map(move |&feature| is_seen(node, visit, feature))
        });
        recording.push(node.key().as_str(), features.len(), states.collect())?;
    }
    Ok(recording)
}

fn is_seen(node: &Node, visit: usize, feature: usize) -> bool {
    node.log().state(visit, feature) == Some(FeatureState::Seen)
}

/// The features that were seen most often, and of these the one that was seen in half of the visits
/// first, for pictures.
fn often_seen(node: &Node) -> Vec<usize> {
    let log = node.log();
    let num_visits = log.num_visits();
    let mut counts = vec![0_usize; log.num_features()];
    for visit in 0..num_visits {
        for feature in log.seen_row(visit).ones() {
            counts[feature] += 1;
        }
    }
    let mut features: Vec<usize> = (0..counts.len()).collect();
    features.sort_by_key(|&feature| (std::cmp::Reverse(counts[feature]), feature));
    features.truncate(NUM_FEATURES);
    features.sort_by_key(|&feature| ((2 * counts[feature]).abs_diff(num_visits), feature));
    features
}
