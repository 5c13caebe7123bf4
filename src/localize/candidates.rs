//! Which places are worth matching exactly?
//!
//! In a map of ten thousand places, matching every predicted feature takes a tenth of a second, and all
//! but a few places have nothing to do with the image. A [`Shortlist`] names those that are worth it,
//! and only these are matched, verified and weighed, by the very path that otherwise serves all places.
//! That path is the oracle: what a short list may lose is the best place itself, and
//! `chronotope-eval speed` reports how often it does. Two kinds are compared there:
//!
//! - [`Voting`]: the features predicted at all places in an inverted file over binary words. Live features
//!   search the lists of their nearest words; each predicted feature that is found within the matching
//!   threshold adds to its place what its match is worth, on top of what the place would score if nothing
//!   matched. So votes are the log odds without displacement and uniqueness, and the list follows the
//!   time of the query. `words + predicted x probes / words` distances a live feature.
//! - [`Signatures`]: one vector a place, its binary words weighted by how often their features were seen
//!   and by how few places have them (tf-idf; Sivic & Zisserman 2003), in a navigable graph (`hnsw_rs`;
//!   Malkov & Yashunin 2018) into which places are inserted one after the other, so that it is the same
//!   in every run. One search an image. The signature knows no time; what is matched afterwards does.
//!
//! Voting is what `auto` uses from [`MIN_PREDICTED`] features on: in a map of 10,000 places grown from real
//! images, the first place was that of the exact answer for all held-out images. With signatures, whose words many
//! look-alike places share, it was so for 65 % in 1,000 places and for none in 10,000 (`eval/record/speed.md`).
//!
//! Invariants: a list depends on map, configuration, time bucket and image alone; ties go to the lowest
//! place. With voting nothing is allocated once warm; the graph allocates in every search.
//!
//! Not for: small maps, where matching all places is as fast and misses nothing.

use std::fmt::Debug;
use std::sync::Arc;

use hnsw_rs::prelude::{Distance, Hnsw};

use super::Localizer;
use super::config::{Candidates, LocalizerConfig, Score};
use super::forecast::Forecast;
use crate::feature::Descriptor;
use crate::map::{Node, NodeId, Snapshot};
use crate::matching::{BinaryWords, InvertedFile, SearchScratch};
use crate::predict::Selection;

/// Places on a short list.
pub(super) const LENGTH: usize = 256;
/// Predicted features from which on places vote: there it was measured to be twice as fast as matching them
/// all. It is faster from about half of them on; below, nothing that an exact answer finds shall be missed for
/// the two milliseconds that are left to win.
const MIN_PREDICTED: usize = 50_000;
/// Lists that a live feature searches.
const PROBES: usize = 24;
/// A farther feature never votes, whatever the matching threshold.
const MAX_VOTE_BITS: u16 = 48;
/// Features that a word is learnt from.
const SAMPLES_PER_WORD: usize = 32;
/// Words of a signature, features of a place in it, connections and candidates of a point in the graph.
const NUM_WORDS: usize = 512;
const MAX_FEATURES: usize = 200;
const CONNECTIONS: usize = 24;
const BUILD_CANDIDATES: usize = 200;

/// Names the places that are worth matching exactly.
pub(super) trait Shortlist: Debug + Send + Sync {
    /// Writes the `count` places that may explain `live` best, ascending; all, if there are fewer.
    fn shortlist_into(
        &self,
        scratch: &mut ShortlistScratch,
        live: &[Descriptor],
        count: usize,
        out: &mut Vec<u32>,
    );
}

/// Memory that a short list is made in.
#[derive(Clone, Debug, Default)]
pub(super) struct ShortlistScratch {
    search: SearchScratch,
    /// Distance of the nearest live feature to each row; all ones between searches.
    nearest: Vec<u16>,
    found: Vec<u32>,
    words: Vec<u32>,
    signature: Vec<f32>,
    /// What speaks for each place.
    votes: Vec<(f32, u32)>,
}

/// What a localizer finds candidates with; made once a map.
#[derive(Clone, Debug)]
pub(super) enum Finder {
    /// Every place is one.
    Exact,
    /// The words of the lists that are made of each forecast.
    Inverted(Arc<BinaryWords>),
    Words(Arc<Signatures>),
}

impl Finder {
    pub(super) fn new(snapshot: &Snapshot, cfg: &LocalizerConfig) -> Self {
        match Self::kind(snapshot, cfg) {
            Candidates::Auto | Candidates::Exact => Self::Exact,
            Candidates::Inverted => {
                let words = learn_words(snapshot, Self::num_words(snapshot, cfg));
                Self::Inverted(Arc::new(words))
            }
            Candidates::Words => Self::Words(Arc::new(Signatures::of(snapshot))),
        }
    }

    /// For a newer snapshot of the same map: words are kept until it needs more than twice as many.
    pub(super) fn on_newer(&self, snapshot: &Snapshot, cfg: &LocalizerConfig) -> Self {
        match self {
            Self::Inverted(words)
                if Self::kind(snapshot, cfg) == Candidates::Inverted
                    && Self::num_words(snapshot, cfg) <= 2 * words.len() =>
            {
                self.clone()
            }
            _ => Self::new(snapshot, cfg),
        }
    }

    /// Whether forecasts that were made for the other hold for this one.
    pub(super) fn reads_same_words(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Inverted(words), Self::Inverted(others)) => Arc::ptr_eq(words, others),
            (Self::Inverted(_), _) | (_, Self::Inverted(_)) => false,
            _ => true,
        }
    }

    /// What candidates are found by in this map.
    fn kind(snapshot: &Snapshot, cfg: &LocalizerConfig) -> Candidates {
        match cfg.candidates() {
            _ if snapshot.nodes.len() <= LENGTH => Candidates::Exact,
            Candidates::Auto if Self::num_predicted(snapshot, cfg) < MIN_PREDICTED => {
                Candidates::Exact
            }
            Candidates::Auto => Candidates::Inverted,
            chosen => chosen,
        }
    }

    /// Features that are predicted of all places, at most.
    fn num_predicted(snapshot: &Snapshot, cfg: &LocalizerConfig) -> usize {
        match cfg.selection() {
            Selection::Top(n) => n.saturating_mul(snapshot.nodes.len()),
            Selection::Threshold(_) => snapshot.nodes.iter().map(|it| it.features.len()).sum(),
        }
    }

    /// The power of two nearest to four times the root of what is predicted.
    fn num_words(snapshot: &Snapshot, cfg: &LocalizerConfig) -> usize {
        let num_predicted = Self::num_predicted(snapshot, cfg) as f64;
        1 << (4.0 * num_predicted.sqrt()).log2().round() as u32
    }
}

/// Words learnt from features of all places, the earliest born of each.
fn learn_words(snapshot: &Snapshot, num_words: usize) -> BinaryWords {
    let num_nodes = snapshot.nodes.len().max(1);
    let a_place = (num_words * SAMPLES_PER_WORD).div_ceil(num_nodes);
    let samples: Vec<Descriptor> = (snapshot.nodes.iter())
        .flat_map(|node| node.features.descriptors().iter().take(a_place))
        .copied()
        .collect();
    BinaryWords::learn(&samples, num_words)
}

/// The predicted features of one forecast, by word.
#[derive(Clone, Debug)]
pub(super) struct Voting {
    file: InvertedFile,
    /// The place of each predicted feature.
    places: Vec<u32>,
    /// What the match of each is worth at no distance in particular.
    worth: Vec<f32>,
    /// What each place scores if nothing is matched.
    nothing: Vec<f32>,
    /// What a matching distance adds.
    of_distance: Vec<f32>,
    max_bits: u16,
}

impl Voting {
    /// Of a forecast whose features have these words.
    pub(super) fn of(
        localizer: &Localizer,
        forecast: &Forecast,
        words: &BinaryWords,
        lists_of: &[u32],
    ) -> Self {
        let (all, ends) = forecast.all_features();
        let max_bits = localizer.cfg.matching().max_bits().min(MAX_VOTE_BITS);
        let mut voting = Self {
            file: InvertedFile::of_words(all.descriptors, words.clone(), lists_of, PROBES),
            places: Vec::with_capacity(all.len()),
            worth: Vec::with_capacity(all.len()),
            nothing: Vec::with_capacity(ends.len()),
            of_distance: vec![0.0; usize::from(max_bits) + 1],
            max_bits,
        };
        let calibration = (localizer.calibration.as_deref())
            .filter(|_| localizer.cfg.score() == Score::Likelihood);
        if let Some(calibration) = calibration {
            for (bits, value) in (0..).zip(&mut voting.of_distance) {
                *value = calibration.distance_log_ratio(bits) as f32;
            }
        }
        let mut start = 0;
        for (place, &end) in (0..).zip(ends) {
            (voting.places).extend(std::iter::repeat_n(place, end - start));
            let expectation = calibration.and_then(|_| forecast.expectation(NodeId(place)));
            if let Some(expectation) = expectation {
                (voting.nothing).push(expectation.of_nothing() as f32);
                let worth = |feature| expectation.worth(feature) as f32;
                (voting.worth).extend((0..end - start).map(worth));
            } else {
                voting.nothing.push(0.0);
                voting.worth.extend(std::iter::repeat_n(1.0, end - start));
            }
            start = end;
        }
        voting
    }
}

impl Shortlist for Voting {
    fn shortlist_into(
        &self,
        scratch: &mut ShortlistScratch,
        live: &[Descriptor],
        count: usize,
        out: &mut Vec<u32>,
    ) {
        let ShortlistScratch {
            search,
            nearest,
            found,
            votes,
            ..
        } = scratch;
        nearest.resize(self.places.len(), u16::MAX);
        found.clear();
        (self.file).rows_within(search, live, self.max_bits, |row, bits| {
            let nearest = &mut nearest[row as usize];
            if *nearest == u16::MAX {
                found.push(row);
            }
            *nearest = bits.min(*nearest);
        });
        votes.clear();
        votes.extend(self.nothing.iter().copied().zip(0..));
        for &row in &*found {
            let row = row as usize;
            let bits = std::mem::replace(&mut nearest[row], u16::MAX);
            votes[self.places[row] as usize].0 +=
                self.worth[row] + self.of_distance[usize::from(bits)];
        }
        if count < votes.len() {
            votes.select_nth_unstable_by(count, |a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            votes.truncate(count);
        }
        out.clear();
        out.extend(votes.iter().map(|&(_, place)| place));
        out.sort_unstable();
    }
}

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
pub(super) struct Signatures {
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
    fn of(snapshot: &Snapshot) -> Self {
        let words = learn_words(snapshot, NUM_WORDS);
        let num_places = snapshot.nodes.len();
        let mut scratch = SearchScratch::default();
        let histograms: Vec<Vec<f32>> = (snapshot.nodes.iter())
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
            weigh(&mut signature, &rarity);
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

/// How much of a place each word is: its features by how often they were seen, the most often seen first.
fn histogram(node: &Node, words: &BinaryWords, scratch: &mut SearchScratch) -> Vec<f32> {
    let mut seen = vec![0_u32; node.features.len()];
    for visit in 0..node.log.num_visits() {
        for feature in node.log.seen_row(visit).ones() {
            seen[feature] += 1;
        }
    }
    let mut ids: Vec<u32> = (0..seen.len() as u32).collect();
    ids.sort_unstable_by_key(|&id| (std::cmp::Reverse(seen[id as usize]), id));
    ids.truncate(MAX_FEATURES);
    let mut words_of = Vec::new();
    let chosen = node.features.select(&ids);
    words.words_into(scratch, chosen.descriptors(), &mut words_of);
    let mut histogram = vec![0.0; NUM_WORDS];
    for (word, id) in words_of.into_iter().zip(ids) {
        if let Some(weight) = histogram.get_mut(word as usize) {
            *weight += seen[id as usize] as f32;
        }
    }
    histogram
}

/// Weighs words by their rarity and gives the vector the length 1.
fn weigh(signature: &mut [f32], rarity: &[f32]) {
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
        live: &[Descriptor],
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
        self.words.words_into(search, live, words);
        signature.clear();
        signature.resize(NUM_WORDS, 0.0);
        for &word in &*words {
            if let Some(weight) = signature.get_mut(word as usize) {
                *weight += 1.0;
            }
        }
        weigh(signature, &self.rarity);
        out.clear();
        let found = self.graph.search(signature, count, 2 * count);
        out.extend(found.iter().map(|near| near.d_id as u32));
        out.sort_unstable();
        out.dedup();
    }
}
