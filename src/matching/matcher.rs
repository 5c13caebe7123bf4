//! Which live feature is which map feature?

use serde::{Deserialize, Serialize};

use crate::feature::{Descriptor, FeaturesView};
use crate::simd::{Kernel, NearestTwo, PackedDescriptors};

use super::config::{Direction, MatchConfig};

/// One map feature that is one live feature.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Match {
    /// Id of the map feature.
    pub map: u32,
    /// Id of the live feature.
    pub live: u32,
    /// Hamming distance of their descriptors, bits.
    pub distance_bits: u16,
}

/// Memory that a [`Matcher`] works in; owned by the caller and used again and again.
#[derive(Clone, Debug, Default)]
pub struct MatchScratch {
    train: PackedDescriptors,
    /// For each feature of the querying side, its nearest two of the other side.
    queried: Vec<NearestTwo>,
    /// For each feature of the other side, its nearest two of the querying side.
    answered: Vec<NearestTwo>,
    uniqueness: Uniqueness,
    matches: Vec<Match>,
}

/// Pairs descriptors under the rules of a [`MatchConfig`]; immutable and shared between threads.
#[derive(Clone, Debug)]
pub struct Matcher {
    cfg: MatchConfig,
    kernel: Kernel,
}

impl Matcher {
    /// With the fastest kernel of this CPU.
    pub fn new(cfg: MatchConfig) -> Self {
        Self::with_kernel(cfg, Kernel::best())
    }

    /// With a given kernel; the results are the same for all.
    pub fn with_kernel(cfg: MatchConfig, kernel: Kernel) -> Self {
        Self { cfg, kernel }
    }

    /// The rules that it pairs descriptors by.
    pub fn cfg(&self) -> &MatchConfig {
        &self.cfg
    }

    /// The matches between `map` and `live`, ordered by the querying side's id.
    pub fn matches_into(
        &self,
        scratch: &mut MatchScratch,
        map: FeaturesView<'_>,
        live: FeaturesView<'_>,
        out: &mut Vec<Match>,
    ) {
        let checkpoint = [map.len()];
        self.prefixes_into(scratch, map, live, &checkpoint, |_, matches| {
            out.clear();
            out.extend_from_slice(matches);
        });
    }

    /// The matches between the first `checkpoints[c]` features of `map` and `live`, for every `c`,
    /// with every distance computed once (twice for the mutual check).
    ///
    /// Calls `sink(c, matches)` in ascending order of `c` with what
    /// [`matches_into`](Self::matches_into) gives for that prefix of the map. A checkpoint beyond
    /// the last feature means all.
    ///
    /// # Panics
    /// If `checkpoints` descends somewhere.
    pub fn prefixes_into(
        &self,
        scratch: &mut MatchScratch,
        map: FeaturesView<'_>,
        live: FeaturesView<'_>,
        checkpoints: &[usize],
        mut sink: impl FnMut(usize, &[Match]),
    ) {
        let MatchScratch {
            train,
            queried,
            answered,
            uniqueness,
            matches,
        } = scratch;
        match self.cfg.direction() {
            Direction::MapToLive => {
                let count = checkpoints.last().map_or(0, |&last| last.min(map.len()));
                let descriptors = &map.descriptors[..count];
                self.nearest(train, descriptors, live.descriptors, queried);
                let mut report = |index: usize, answered: Option<&[NearestTwo]>| {
                    let ids = 0..checkpoints[index].min(count) as u32;
                    let queried = ids.map(|id| (id, queried[id as usize]));
                    let direction = Direction::MapToLive;
                    self.choose(direction, queried, answered, map, live, uniqueness, matches);
                    sink(index, matches);
                };
                if self.cfg.mutual() {
                    answered.resize(live.len(), NearestTwo::EMPTY);
                    self.kernel.nearest_two_prefixes(
                        live.descriptors,
                        map.descriptors,
                        checkpoints,
                        answered,
                        |index, answered| report(index, Some(answered)),
                    );
                } else {
                    (0..checkpoints.len()).for_each(|index| report(index, None));
                }
            }
            Direction::LiveToMap => {
                if self.cfg.mutual() {
                    let count = checkpoints.last().map_or(0, |&last| last.min(map.len()));
                    let descriptors = &map.descriptors[..count];
                    self.nearest(train, descriptors, live.descriptors, answered);
                }
                let answered = self.cfg.mutual().then_some(&answered[..]);
                queried.resize(live.len(), NearestTwo::EMPTY);
                self.kernel.nearest_two_prefixes(
                    live.descriptors,
                    map.descriptors,
                    checkpoints,
                    queried,
                    |index, queried| {
                        let queried = (0..).zip(queried.iter().copied());
                        let direction = Direction::LiveToMap;
                        self.choose(direction, queried, answered, map, live, uniqueness, matches);
                        sink(index, matches);
                    },
                );
            }
        }
    }

    /// The matches between each part of `map` and `live`: the first part ends before feature
    /// `ends[0]`, each next one begins where the one before ended. In a large map each part is a
    /// place.
    ///
    /// Calls `sink(part, matches)` in ascending order of parts with what
    /// [`matches_into`](Self::matches_into) gives for the part alone, with features counted from
    /// its first. The live features are laid out for the kernels once, not once a part.
    ///
    /// # Panics
    /// If `ends` descends somewhere or leads beyond the last feature.
    pub fn parts_into(
        &self,
        scratch: &mut MatchScratch,
        map: FeaturesView<'_>,
        ends: &[usize],
        live: FeaturesView<'_>,
        mut sink: impl FnMut(usize, &[Match]),
    ) {
        let MatchScratch {
            train,
            queried,
            answered,
            uniqueness,
            matches,
        } = scratch;
        let direction = self.cfg.direction();
        let is_map_querying = direction == Direction::MapToLive;
        let (of_map, of_live) = if is_map_querying {
            (queried, answered)
        } else {
            (answered, queried)
        };
        train.repack(live.descriptors);
        of_map.clear();
        if is_map_querying || self.cfg.mutual() {
            of_map.resize(map.len(), NearestTwo::EMPTY);
            (self.kernel).nearest_two(map.descriptors, train, of_map);
        }
        let mut start = 0;
        let mut report = |part: usize, of_live: Option<&[NearestTwo]>| {
            let rows = start..ends[part];
            start = ends[part];
            let of_part = of_map.get(rows.clone());
            let (queried, answered) = if is_map_querying {
                (of_part, of_live)
            } else {
                (of_live, of_part)
            };
            let queried = (0..).zip(queried.unwrap_or_default().iter().copied());
            let map = map.rows(rows);
            self.choose(direction, queried, answered, map, live, uniqueness, matches);
            sink(part, matches);
        };
        if is_map_querying && !self.cfg.mutual() {
            (0..ends.len()).for_each(|part| report(part, None));
        } else {
            of_live.resize(live.len(), NearestTwo::EMPTY);
            self.kernel.nearest_two_of_parts(
                train,
                map.descriptors,
                ends,
                of_live,
                |part, of_live| {
                    report(part, Some(of_live));
                },
            );
        }
    }

    /// For each map feature the two nearest live features: the evidence that
    /// [`select_into`](Self::select_into) chooses from.
    pub fn nearest_live_into(
        &self,
        scratch: &mut MatchScratch,
        map: &[Descriptor],
        live: &[Descriptor],
        out: &mut Vec<NearestTwo>,
    ) {
        self.nearest(&mut scratch.train, map, live, out);
    }

    /// The matches if the map consisted of the features `ids` only, from `nearest` computed once by
    /// [`nearest_live_into`](Self::nearest_live_into); ordered as `ids`, in `O(ids)` time.
    ///
    /// The querying side is the map, whatever [`direction`](MatchConfig::direction) says, and the
    /// mutual check is left out: both would need the map's other features to be forgotten. The
    /// rules threshold, ratio, window and unique apply.
    ///
    /// # Panics
    /// If an id is not below the map's number of features.
    pub fn select_into(
        &self,
        scratch: &mut MatchScratch,
        map: FeaturesView<'_>,
        live: FeaturesView<'_>,
        nearest: &[NearestTwo],
        ids: &[u32],
        out: &mut Vec<Match>,
    ) {
        let queried = ids.iter().map(|&id| (id, nearest[id as usize]));
        let uniqueness = &mut scratch.uniqueness;
        self.choose(
            Direction::MapToLive,
            queried,
            None,
            map,
            live,
            uniqueness,
            out,
        );
    }

    /// The nearest two of `train` for each query.
    fn nearest(
        &self,
        packed: &mut PackedDescriptors,
        queries: &[Descriptor],
        train: &[Descriptor],
        out: &mut Vec<NearestTwo>,
    ) {
        packed.repack(train);
        out.resize(queries.len(), NearestTwo::EMPTY);
        self.kernel.nearest_two(queries, packed, out);
    }

    /// Rules 2 to 6 for `queried`: (querying id, its nearest two). `answered`, where the mutual
    /// check is wanted, holds the nearest two of the answering side.
    #[allow(clippy::too_many_arguments)] // reason: the parts of one scratch, borrowed apart.
    fn choose(
        &self,
        direction: Direction,
        queried: impl Iterator<Item = (u32, NearestTwo)>,
        answered: Option<&[NearestTwo]>,
        map: FeaturesView<'_>,
        live: FeaturesView<'_>,
        uniqueness: &mut Uniqueness,
        out: &mut Vec<Match>,
    ) {
        let as_match = |querying, nearest: &NearestTwo| {
            let (map, live) = match direction {
                Direction::MapToLive => (querying, nearest.best),
                Direction::LiveToMap => (nearest.best, querying),
            };
            Match {
                map,
                live,
                distance_bits: nearest.best_bits,
            }
        };
        let is_mutual = |querying, nearest: &NearestTwo| {
            answered.is_none_or(|answered| answered[nearest.best as usize].best == querying)
        };
        let in_window = |found: &Match| {
            self.cfg.window().is_none_or(|window| {
                window.contains(
                    &map.keypoints[found.map as usize],
                    &live.keypoints[found.live as usize],
                )
            })
        };
        out.clear();
        out.extend(
            queried
                .filter(|(_, nearest)| self.cfg.accepts(nearest))
                .filter(|(querying, nearest)| is_mutual(*querying, nearest))
                .map(|(querying, nearest)| as_match(querying, &nearest))
                .filter(in_window),
        );
        if self.cfg.unique() {
            match direction {
                Direction::MapToLive => {
                    uniqueness.retain(out, live.len(), |found| (found.live, found.map));
                }
                Direction::LiveToMap => {
                    uniqueness.retain(out, map.len(), |found| (found.map, found.live));
                }
            }
        }
    }
}

/// Rule 6; remembers for each feature of the answering side who may have it.
#[derive(Clone, Debug, Default)]
struct Uniqueness {
    /// `distance << 32 | querying id` of the best claim to each feature.
    claims: Vec<u64>,
}

impl Uniqueness {
    /// Keeps of the matches that claim one feature the nearest, ties to the lowest querying id.
    /// `sides(match)` is (answering id, querying id), answering ids are below `len`.
    fn retain(
        &mut self,
        matches: &mut Vec<Match>,
        len: usize,
        sides: impl Fn(&Match) -> (u32, u32),
    ) {
        let claim = |found: &Match, querying: u32| {
            (u64::from(found.distance_bits) << 32) | u64::from(querying)
        };
        if self.claims.len() < len {
            self.claims.resize(len, u64::MAX);
        }
        for found in &*matches {
            let (answering, querying) = sides(found);
            let best = &mut self.claims[answering as usize];
            *best = (*best).min(claim(found, querying));
        }
        // The claims are forgotten match by match, so that the cost does not depend on `len`.
        let claims = &mut self.claims;
        matches.retain(|found| {
            let (answering, querying) = sides(found);
            claims[answering as usize] == claim(found, querying)
        });
        for found in &*matches {
            claims[sides(found).0 as usize] = u64::MAX;
        }
    }
}
