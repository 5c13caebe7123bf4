//! Which places have the binary words of the live image?

use std::fmt::Debug;

use hnsw_rs::prelude::{Distance, Hnsw};

use super::shortlist::{Shortlist, ShortlistScratch};
use super::words::learn_words;
use crate::feature::FeaturesView;
use crate::map::{Node, Snapshot};
use crate::matching::{BinaryWords, SearchScratch};

/// Words of a signature, features of a place in it, connections and candidates of a point in the
/// graph.
const NUM_WORDS: usize = 512;
const MAX_FEATURES: usize = 200;
const CONNECTIONS: usize = 24;
const BUILD_CANDIDATES: usize = 200;

/// 1 - cosine of two vectors of length 1.
struct OneMinusDot;

impl Distance<f32> for OneMinusDot {
    fn eval(&self, a: &[f32], b: &[f32]) -> f32 {
        // Eight sums side by side: the order is fixed, and the compiler may use vectors.
        let mut sums = [0.0; 8];
        for (a, b) in a.as_chunks::<8>().0.iter().zip(b.as_chunks::<8>().0) {
            for lane in 0..8 {
                sums[lane] += a[lane] * b[lane];
            }
        }
        (1.0 - sums.iter().sum::<f32>()).max(0.0)
    }
}

/// One vector a place, in a graph.
pub(in crate::localize) struct Signatures {
    words: BinaryWords,
    /// ln(places / places that have the word), for each word.
    rarity: Vec<f32>,
    graph: Hnsw<'static, f32, OneMinusDot>,
    num_places: usize,
}

impl Debug for Signatures {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Signatures({} places)", self.num_places)
    }
}

impl Signatures {
    pub(super) fn of(snapshot: &Snapshot) -> Self {
        let words = learn_words(snapshot, NUM_WORDS);
        let num_places = snapshot.nodes().len();
        let mut scratch = SearchScratch::default();
        let histograms: Vec<Vec<f32>> = (snapshot.nodes().iter())
            .map(|node| histogram(node, &words, &mut scratch))
            .collect();
        let rarity: Vec<f32> = (0..NUM_WORDS)
            .map(|word| {
                let having = histograms.iter().filter(|it| it[word] > 0.0).count();
                (num_places as f32 / having.max(1) as f32).ln().max(0.01)
            })
            .collect();
        let graph = Hnsw::new(CONNECTIONS, num_places, 16, BUILD_CANDIDATES, OneMinusDot);
        for (place, mut signature) in histograms.into_iter().enumerate() {
            normalize(&mut signature, &rarity);
            graph.insert((&signature, place));
        }
        Self {
            words,
            rarity,
            graph,
            num_places,
        }
    }
}

/// How much of a place each word is: its features by how often they were seen, the most often seen
/// first.
fn histogram(node: &Node, words: &BinaryWords, scratch: &mut SearchScratch) -> Vec<f32> {
    let mut seen = vec![0_u32; node.features().len()];
    for visit in 0..node.log().num_visits() {
        for feature in node.log().seen_row(visit).ones() {
            seen[feature] += 1;
        }
    }
    let mut ids: Vec<u32> = (0..seen.len() as u32).collect();
    ids.sort_unstable_by_key(|&id| (std::cmp::Reverse(seen[id as usize]), id));
    ids.truncate(MAX_FEATURES);
    let mut words_of = Vec::new();
    let chosen = node.features().select(&ids);
    words.words_into(scratch, chosen.descriptors(), &mut words_of);
    let mut histogram = Vec::new();
    let weights = ids.into_iter().map(|id| seen[id as usize] as f32);
    count_words(&words_of, weights, &mut histogram);
    histogram
}

/// Adds each weight to that of its word, from nothing on.
fn count_words(words: &[u32], weights: impl Iterator<Item = f32>, out: &mut Vec<f32>) {
    out.clear();
    out.resize(NUM_WORDS, 0.0);
    for (&word, weight) in words.iter().zip(weights) {
        if let Some(sum) = out.get_mut(word as usize) {
            *sum += weight;
        }
    }
}

/// Weighs words by their rarity and gives the vector the length 1.
fn normalize(signature: &mut [f32], rarity: &[f32]) {
    for (weight, rarity) in signature.iter_mut().zip(rarity) {
        *weight = weight.sqrt() * rarity;
    }
    let length = signature.iter().map(|w| w * w).sum::<f32>().sqrt();
    if length > 0.0 {
        for weight in signature {
            *weight /= length;
        }
    }
}

impl Shortlist for Signatures {
    fn shortlist_into(
        &self,
        scratch: &mut ShortlistScratch,
        live: FeaturesView<'_>,
        count: usize,
        out: &mut Vec<u32>,
    ) {
        let ShortlistScratch {
            search,
            words,
            signature,
            ..
        } = scratch;
        words.clear();
        self.words.words_into(search, live.descriptors, words);
        count_words(words, std::iter::repeat(1.0), signature);
        normalize(signature, &self.rarity);
        out.clear();
        let found = self.graph.search(signature, count, 2 * count);
        out.extend(found.iter().map(|near| near.d_id as u32));
        out.sort_unstable();
        out.dedup();
    }
}
