//! Which images and descriptors are the measurements made on?
//!
//! Real ones where a dataset is named: every third visit of each place is queried, counted from the
//! last, and the others are learnt. Larger sets are made of them by flipping bits: as many as
//! differ between two sightings of one feature, a number drawn from what was counted between
//! consecutive visits.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use chronotope::Time;
use chronotope::dataset::Dataset;
use chronotope::dataset::synthetic::{Schedule, World, WorldConfig};
use chronotope::feature::{Descriptor, Extractor, Features, GrayImage, StarBrief};
use chronotope::matching::{
    MatchConfig, MatchScratch, Matcher, VoteConfig, VoteScratch, displacements_into,
    vote_displacement,
};

/// Visits taken of a place at most: enough to be varied, few enough to wait for.
const MAX_VISITS: usize = 60;
/// One visit in so many is queried, the last one of a place always.
const QUERY_EVERY: usize = 3;
/// Images that extraction is timed on at most.
const MAX_IMAGES: usize = 12;

/// Images, features and how much descriptors change.
#[derive(Debug, Default)]
pub struct Workload {
    name: String,
    /// Some images of one size.
    pub images: Vec<GrayImage>,
    /// Features of learnt images.
    pub learnt: Vec<Features>,
    /// Features of the query images.
    pub queries: Vec<Features>,
    /// When those were taken.
    pub times: Vec<Time>,
    /// Which place each learnt image shows.
    pub learnt_places: Vec<usize>,
    /// Which place each query image shows.
    pub query_places: Vec<usize>,
    /// Bits that differ between two sightings of a feature, one entry a pair of sightings.
    flips: Vec<u16>,
}

impl Workload {
    /// From the dataset at `data`, or from a rendered street.
    pub fn new(data: Option<&Path>) -> Result<Self> {
        let dataset = if let Some(path) = data {
            Dataset::open(path)?
        } else {
            let world = World::new(&WorldConfig::new(17).with_num_places(4))?;
            let schedule = Schedule::standard(17, 6, 1);
            let times: Vec<Time> = schedule
                .learn
                .iter()
                .chain(&schedule.query)
                .copied()
                .collect();
            world.dataset("rendered street", &times)
        };
        let mut places: BTreeMap<_, Vec<_>> = BTreeMap::new();
        for entry in &dataset.entries {
            places.entry(entry.place.clone()).or_default().push(entry);
        }
        let extractor = StarBrief::default();
        let mut workload = Self {
            name: dataset.name.clone(),
            ..Self::default()
        };
        for (place, visits) in places.values().enumerate() {
            let visits = &visits[visits.len().saturating_sub(MAX_VISITS)..];
            let mut before: Option<Features> = None;
            for (index, entry) in visits.iter().enumerate() {
                let image = entry
                    .source
                    .load()
                    .with_context(|| format!("image {}", entry.id))?;
                let features = extractor.extract(&image, None)?;
                if let Some(before) = &before {
                    workload.count_flips(before, &features);
                }
                before = Some(features.clone());
                if features.is_empty() {
                    continue;
                }
                if (visits.len() - 1 - index).is_multiple_of(QUERY_EVERY) {
                    workload.queries.push(features);
                    workload.query_places.push(place);
                    workload.times.push(entry.time);
                    let fits = |first: &GrayImage| {
                        (first.width(), first.height()) == (image.width(), image.height())
                    };
                    if workload.images.len() < MAX_IMAGES
                        && workload.images.first().is_none_or(fits)
                    {
                        workload.images.push(image);
                    }
                } else {
                    workload.learnt.push(features);
                    workload.learnt_places.push(place);
                }
            }
        }
        workload.interleave();
        ensure!(
            !workload.learnt.is_empty()
                && !workload.queries.is_empty()
                && !workload.flips.is_empty(),
            "dataset `{}` has no place with two visits that show the same features",
            workload.name
        );
        Ok(workload)
    }

    /// Orders learnt images by visit and then by place, so that the first ones show different
    /// places.
    fn interleave(&mut self) {
        let mut seen: BTreeMap<usize, usize> = BTreeMap::new();
        let visit_of = |&place: &usize| {
            let visit = seen.entry(place).or_default();
            *visit += 1;
            (*visit, place)
        };
        let keys: Vec<(usize, usize)> = self.learnt_places.iter().map(visit_of).collect();
        let learnt = std::mem::take(&mut self.learnt);
        let mut learnt: Vec<_> = keys.into_iter().zip(learnt).collect();
        learnt.sort_by_key(|&(key, _)| key);
        self.learnt_places = learnt.iter().map(|&((_, place), _)| place).collect();
        self.learnt = learnt.into_iter().map(|(_, features)| features).collect();
    }

    /// Takes in how many bits differ between mutual nearest features that agree on one
    /// displacement.
    fn count_flips(&mut self, before: &Features, after: &Features) {
        let Ok(cfg) = MatchConfig::builder()
            .with_max_bits(256)
            .with_mutual(true)
            .build()
        else {
            return;
        };
        let (mut matches, mut displacements) = (Vec::new(), Vec::new());
        let mut vote = VoteScratch::default();
        Matcher::new(cfg).matches_into(
            &mut MatchScratch::default(),
            before.view(),
            after.view(),
            &mut matches,
        );
        displacements_into(
            &matches,
            before.keypoints(),
            after.keypoints(),
            &mut displacements,
        );
        vote_displacement(&VoteConfig::default(), &mut vote, &displacements);
        let agreeing = matches
            .iter()
            .zip(vote.inliers())
            .filter(|(_, inlier)| **inlier);
        self.flips
            .extend(agreeing.map(|(found, _)| found.distance_bits));
    }

    /// In words, for the table.
    pub fn describe(&self) -> String {
        let mut flips = self.flips.clone();
        flips.sort_unstable();
        format!(
            "{}: {} learnt images, {} queried; {} pairs of sightings differ in {} bits at the median",
            self.name,
            self.learnt.len(),
            self.queries.len(),
            flips.len(),
            flips[flips.len() / 2]
        )
    }

    /// The place that the `node`-th place of a grown map is a copy of.
    pub fn place_of(&self, node: usize) -> usize {
        self.learnt_places[node % self.learnt_places.len()]
    }

    /// `count` descriptors of query images.
    pub fn query_descriptors(&self, count: usize) -> Vec<Descriptor> {
        let all = self.queries.iter().flat_map(Features::descriptors);
        all.copied().cycle().take(count).collect()
    }

    /// `count` descriptors: those of the learnt images over and over, each seen anew.
    pub fn grown(&self, count: usize, seed: u64) -> Vec<Descriptor> {
        let mut random = SplitMix(seed);
        let all = self.learnt.iter().flat_map(Features::descriptors);
        all.cycle()
            .take(count)
            .map(|descriptor| self.seen_anew(descriptor, &mut random))
            .collect()
    }

    /// The descriptor with as many flipped bits as some pair of sightings had.
    pub fn seen_anew(&self, descriptor: &Descriptor, random: &mut SplitMix) -> Descriptor {
        let flips = self.flips[random.below(self.flips.len())];
        let mut changed = *descriptor;
        let mut flipped = 0;
        while flipped < flips {
            let bit = random.below(256);
            let mask = 1 << (bit % 64);
            // A bit that is flipped already would be flipped back.
            if (changed.0[bit / 64] ^ descriptor.0[bit / 64]) & mask == 0 {
                changed.0[bit / 64] ^= mask;
                flipped += 1;
            }
        }
        changed
    }
}

/// Steele, Lea and Flood's `SplitMix64`: the same numbers in every run.
#[derive(Debug)]
pub struct SplitMix(pub u64);

impl SplitMix {
    /// The next 64 random bits.
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// A number below `limit`.
    pub fn below(&mut self, limit: usize) -> usize {
        (self.next() >> 11) as usize % limit
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_descriptor_seen_anew_differs_in_as_many_bits_as_were_drawn() {
        let workload = Workload {
            flips: vec![0, 256, 17],
            ..Workload::default()
        };
        let mut random = SplitMix(3);
        for _ in 0..30 {
            let anew = workload.seen_anew(&Descriptor([5, 6, 7, 8]), &mut random);
            let bits = anew.distance_bits(&Descriptor([5, 6, 7, 8]));
            assert!([0, 17, 256].contains(&bits), "{bits}");
        }
    }
}
