//! Which places do the predicted features of one forecast vote for?
//!
//! Each predicted feature that some live feature resembles speaks for its place by what the match of
//! the nearest one is worth. Where places look alike, many have the features but not where the image
//! has them: so of a place only what agrees on one displacement counts, as it will in the exact
//! score (weak geometric consistency: Jegou, Douze & Schmid, ECCV 2008).

use super::shortlist::{Shortlist, ShortlistScratch};
use super::tally::{Cells, Nearest, Shift, Tally, keep_best};
use crate::feature::{FeaturesView, Keypoint};
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
    /// Each predicted feature.
    voters: Vec<Voter>,
    /// What each place scores if nothing is matched.
    nothing: Vec<f32>,
    /// What a matching distance adds.
    of_distance: Vec<f32>,
    max_bits: u16,
    /// Of the window that true matches agree in; `None` where the score does not look.
    cells: Option<Cells>,
}

/// A predicted feature.
#[derive(Clone, Copy, Debug)]
struct Voter {
    place: u32,
    /// What its match is worth at no distance in particular.
    worth: f32,
    x: f32,
    y: f32,
}

/// The predicted features of all places, place by place.
#[derive(Clone, Copy, Debug)]
pub(in crate::localize) struct PredictedPlaces<'a> {
    pub(in crate::localize) features: FeaturesView<'a>,
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
            features,
            ends,
            expectations,
        } = places;
        let max_bits = cfg.matching().max_bits().min(MAX_VOTE_BITS);
        let descriptors = features.descriptors;
        let mut voting = Self {
            file: InvertedFile::of_words(descriptors, words.clone(), lists_of, PROBES),
            voters: Vec::with_capacity(descriptors.len()),
            nothing: Vec::with_capacity(ends.len()),
            of_distance: vec![0.0; usize::from(max_bits) + 1],
            max_bits,
            cells: (cfg.score() != Score::Count).then(|| Cells::of(cfg.vote())),
        };
        let calibration = calibration.filter(|_| cfg.score() == Score::Likelihood);
        if let Some(calibration) = calibration {
            for (bits, value) in (0..).zip(&mut voting.of_distance) {
                *value = calibration.distance_log_ratio(bits) as f32;
            }
        }
        let mut start = 0;
        for (place, &end) in (0..).zip(ends) {
            let expectation = calibration.and_then(|_| expectations.get(place as usize));
            let of_nothing = expectation.map_or(0.0, Expectation::of_nothing);
            voting.nothing.push(of_nothing as f32);
            let keypoints = (0..).zip(&features.keypoints[start..end]);
            voting
                .voters
                .extend(keypoints.map(|(feature, keypoint)| Voter {
                    place,
                    worth: expectation.map_or(1.0, |it| it.worth(feature) as f32),
                    x: keypoint.x,
                    y: keypoint.y,
                }));
            start = end;
        }
        voting
    }

    /// What the match of a predicted feature with its nearest live one is worth.
    fn worth(&self, voter: Voter, nearest: Nearest) -> f32 {
        voter.worth + self.of_distance[usize::from(nearest.bits)]
    }

    /// All votes of each place.
    fn count(&self, tally: &mut Tally) {
        for &row in &tally.rows {
            let voter = self.voters[row as usize];
            let worth = self.worth(voter, tally.nearest[row as usize]);
            tally.votes[voter.place as usize].0 += worth;
        }
    }

    /// The votes of each place that agree on one displacement.
    fn count_agreeing(&self, cells: Cells, live: &[Keypoint], tally: &mut Tally) {
        let Tally {
            nearest,
            rows,
            votes,
            ends,
            shifts,
            plane,
        } = tally;
        // Those of each place together: a counting sort.
        ends.clear();
        ends.resize(votes.len(), 0);
        for &row in &*rows {
            ends[self.voters[row as usize].place as usize] += 1;
        }
        let mut start = 0;
        for end in &mut *ends {
            start += std::mem::replace(end, start);
        }
        shifts.resize(rows.len(), Shift::default());
        for &row in &*rows {
            let (voter, nearest) = (self.voters[row as usize], nearest[row as usize]);
            let live = live[nearest.live as usize];
            let worth = self.worth(voter, nearest);
            // From where they begin to where they end.
            let next = &mut ends[voter.place as usize];
            shifts[*next as usize] = cells.shift(live.x - voter.x, live.y - voter.y, worth);
            *next += 1;
        }
        let mut start = 0;
        for ((vote, _), &end) in votes.iter_mut().zip(&*ends) {
            *vote += plane.most(&shifts[start as usize..end as usize]);
            start = end;
        }
    }
}

impl Shortlist for Voting {
    fn shortlist_into(
        &self,
        scratch: &mut ShortlistScratch,
        live: FeaturesView<'_>,
        count: usize,
        out: &mut Vec<u32>,
    ) {
        let ShortlistScratch { search, tally, .. } = scratch;
        tally.nearest.resize(self.voters.len(), Nearest::NONE);
        tally.rows.clear();
        (self.file).rows_within(
            search,
            live.descriptors,
            self.max_bits,
            |live, row, bits| {
                let nearest = &mut tally.nearest[row as usize];
                if *nearest == Nearest::NONE {
                    tally.rows.push(row);
                }
                *nearest = Nearest { bits, live }.min(*nearest);
            },
        );
        tally.votes.clear();
        (tally.votes).extend(self.nothing.iter().copied().zip(0..));
        match self.cells {
            Some(cells) => self.count_agreeing(cells, live.keypoints, tally),
            None => self.count(tally),
        }
        for &row in &tally.rows {
            tally.nearest[row as usize] = Nearest::NONE;
        }
        keep_best(&mut tally.votes, count);
        out.clear();
        out.extend(tally.votes.iter().map(|&(_, place)| place));
        out.sort_unstable();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feature::{Descriptor, Features};

    /// 40 places that have the same features, and one of them where the image has them.
    #[test]
    fn of_places_that_look_alike_those_are_listed_that_agree_on_a_displacement() {
        let (num_places, num_features, right) = (40, 12, 33);
        let descriptor = |feature: u64| {
            Descriptor([1, 2, 3, 4].map(|word: u64| {
                (feature * 4 + word).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (feature << 17)
            }))
        };
        let mut predicted = Features::new();
        let mut ends = Vec::new();
        for place in 0..num_places {
            for feature in 0..num_features {
                // Elsewhere in every place but one.
                let (x, y) = match place {
                    _ if place == right => (50.0 * feature as f32, 10.0),
                    _ => (
                        (feature * (97 + place) % 600) as f32,
                        (feature * (31 + place) % 200) as f32,
                    ),
                };
                predicted.push(keypoint(x, y), descriptor(feature));
            }
            ends.push(predicted.len());
        }
        let words = BinaryWords::learn(predicted.descriptors(), 8);
        let mut lists_of = Vec::new();
        words.words_into(
            &mut crate::matching::SearchScratch::default(),
            predicted.descriptors(),
            &mut lists_of,
        );
        let places = PredictedPlaces {
            features: predicted.view(),
            ends: &ends,
            expectations: &[],
        };
        let mut live = Features::new();
        for feature in 0..num_features {
            live.push(
                keypoint(50.0 * feature as f32 + 7.0, 12.0),
                descriptor(feature),
            );
        }
        let mut scratch = ShortlistScratch::default();
        let mut listed = |score| {
            let cfg = LocalizerConfig::default().with_score(score);
            let voting = Voting::of(&cfg, None, places, &words, &lists_of);
            let mut out = Vec::new();
            voting.shortlist_into(&mut scratch, live.view(), 5, &mut out);
            out
        };
        assert!(listed(Score::Inliers).contains(&(right as u32)));
        // By the mere number of matches all are equal, and the lowest are listed.
        assert_eq!(listed(Score::Count), [0, 1, 2, 3, 4]);
    }

    fn keypoint(x: f32, y: f32) -> Keypoint {
        Keypoint {
            x,
            y,
            size: 10.0,
            response: 1.0,
        }
    }
}
