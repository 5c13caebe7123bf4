//! Which binary words do the features of a map fall into?

use crate::feature::Descriptor;
use crate::map::Snapshot;
use crate::matching::BinaryWords;

/// Features that a word is learnt from.
const SAMPLES_PER_WORD: usize = 32;

/// Words learnt from features of all places, the earliest born of each.
pub(super) fn learn_words(snapshot: &Snapshot, num_words: usize) -> BinaryWords {
    let num_nodes = snapshot.nodes().len().max(1);
    let a_place = (num_words * SAMPLES_PER_WORD).div_ceil(num_nodes);
    let samples: Vec<Descriptor> = (snapshot.nodes().iter())
        .flat_map(|node| node.features().descriptors().iter().take(a_place))
        .copied()
        .collect();
    BinaryWords::learn(&samples, num_words)
}
