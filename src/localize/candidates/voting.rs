//! Which places do the predicted features of one forecast vote for?

use super::shortlist::{Shortlist, ShortlistScratch};
use crate::feature::Descriptor;
use crate::localize::config::{LocalizerConfig, Score};
use crate::localize::evidence::{Calibration, Expectation};
use crate::matching::{BinaryWords, InvertedFile};

/// Lists that a live feature searches.
const PROBES: usize = 24;
/// A farther feature never votes, whatever the matching threshold.
const MAX_VOTE_BITS: u16 = 48;

/// The predicted features of one forecast, by word.
#[derive(Clone, Debug)]
pub(in crate::localize) struct Voting {
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

/// The predicted features of all places, place by place.
#[derive(Clone, Copy, Debug)]
pub(in crate::localize) struct PredictedPlaces<'a> {
    pub(in crate::localize) descriptors: &'a [Descriptor],
    /// Where the features of each place end.
    pub(in crate::localize) ends: &'a [usize],
    /// What those of each place would say; empty without calibration.
    pub(in crate::localize) expectations: &'a [Expectation],
}

impl Voting {
    /// Of predicted features whose words are known.
    pub(in crate::localize) fn of(
        cfg: &LocalizerConfig,
        calibration: Option<&Calibration>,
        places: PredictedPlaces<'_>,
        words: &BinaryWords,
        lists_of: &[u32],
    ) -> Self {
        let PredictedPlaces {
            descriptors,
            ends,
            expectations,
        } = places;
        let max_bits = cfg.matching().max_bits().min(MAX_VOTE_BITS);
        let mut voting = Self {
            file: InvertedFile::of_words(descriptors, words.clone(), lists_of, PROBES),
            places: Vec::with_capacity(descriptors.len()),
            worth: Vec::with_capacity(descriptors.len()),
            nothing: Vec::with_capacity(ends.len()),
            of_distance: vec![0.0; usize::from(max_bits) + 1],
            max_bits,
        };
        let calibration = calibration.filter(|_| cfg.score() == Score::Likelihood);
        if let Some(calibration) = calibration {
            for (bits, value) in (0..).zip(&mut voting.of_distance) {
                *value = calibration.distance_log_ratio(bits) as f32;
            }
        }
        let mut start = 0;
        for (place, &end) in ends.iter().enumerate() {
            (voting.places).extend(std::iter::repeat_n(place as u32, end - start));
            let expectation = calibration.and_then(|_| expectations.get(place));
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
