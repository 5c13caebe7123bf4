//! What are the sums of every feature of a place?
//!
//! The sums of [`fremen::spectrum`]: whole numbers, so that the sums of parts of the visits, merged in any
//! order, are bit for bit those of all visits. Visits are taken in runs whose phasors stay in the cache;
//! within a run, 64 features at a time. What all 64 were looked at shares one sum over all visits.
//!
//! O(visits x K) phasors and O(ones x K) additions for K candidate periods, a quarter of them where more
//! than a third of the states are 1.

use std::collections::BTreeMap;

use fremen::spectrum::{CandidatePeriods, MAX_OBSERVATIONS, PhasorTable, SpectralSums};
use fremen::{Error, Result};
use rayon::prelude::*;

use crate::log::{PlaceLog, Visit};
use crate::states::BLOCK;

/// Visits whose phasors are held at once.
const RUN: usize = 8_192;

/// The sums of one feature of a place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FeatureSums {
    /// The feature's number in the place.
    pub feature: u32,
    /// Over all visits that looked at it.
    pub sums: SpectralSums,
}

/// A visit of a run by its number there, with 64 features of it.
#[derive(Clone, Copy)]
struct Entry {
    visit: u32,
    observed: u64,
    seen: u64,
}

impl PlaceLog {
    /// The sums of every feature that was looked at, ascending by feature.
    ///
    /// Fails with [`ErrorKind::Shape`](fremen::ErrorKind::Shape) if a feature has more observations than
    /// [`MAX_OBSERVATIONS`].
    pub fn sums(&self, candidates: &CandidatePeriods) -> Result<Vec<FeatureSums>> {
        let mut all = BTreeMap::<u32, Vec<FeatureSums>>::new();
        for run in self.visits().chunks(RUN) {
            let sums = run_sums(run, candidates).map_err(|error| {
                error.with_place(format!("place `{}`", self.key().escape_debug()))
            })?;
            for (block, sums) in sums {
                match all.get_mut(&block) {
                    None => drop(all.insert(block, sums)),
                    Some(known) => merge(self.key(), known, sums)?,
                }
            }
        }
        Ok(all.into_values().flatten().collect())
    }
}

/// Adds sums of features of a place to those of the same features, both ascending by feature.
fn merge(place: &str, known: &mut Vec<FeatureSums>, more: Vec<FeatureSums>) -> Result<()> {
    for new in more {
        match known.binary_search_by_key(&new.feature, |it| it.feature) {
            Ok(at) => {
                let merged = known[at].sums.merge(&new.sums);
                merged.map_err(|error| too_many(error, place, new.feature))?;
            }
            Err(at) => known.insert(at, new),
        }
    }
    Ok(())
}

fn too_many(error: Error, place: &str, feature: u32) -> Error {
    let help = format!(
        "a sum holds {MAX_OBSERVATIONS} observations: learn from a part of the history, or from fewer an hour"
    );
    error
        .with_place(format!(
            "place `{}`, feature {feature}",
            place.escape_debug()
        ))
        .with_help(help)
}

/// The sums over a few visits, block by block.
fn run_sums(
    visits: &[Visit],
    candidates: &CandidatePeriods,
) -> Result<Vec<(u32, Vec<FeatureSums>)>> {
    let table = PhasorTable::new(candidates, visits.iter().map(|visit| visit.time))?;
    let mut total = vec![0; table.width()];
    let mut blocks = BTreeMap::<u32, Vec<Entry>>::new();
    for (at, visit) in visits.iter().enumerate() {
        table.add_to(at, &mut total);
        for block in visit.states.blocks() {
            blocks.entry(block.index).or_default().push(Entry {
                visit: at as u32,
                observed: block.observed,
                seen: block.seen,
            });
        }
    }
    let run = Run {
        table: &table,
        total: &total,
        num_visits: visits.len(),
        candidates,
    };
    (blocks.into_par_iter())
        .map(|(block, entries)| Ok((block, run.block_sums(block, &entries)?)))
        .collect()
}

/// A few visits, ready to be summed over any of them.
struct Run<'a> {
    table: &'a PhasorTable,
    /// Over all visits.
    total: &'a [i64],
    num_visits: usize,
    candidates: &'a CandidatePeriods,
}

impl Run<'_> {
    fn block_sums(&self, block: u32, entries: &[Entry]) -> Result<Vec<FeatureSums>> {
        let width = self.table.width();
        let seen_lists = lists(entries.iter().map(|it| (it.visit, it.seen)));
        let seen = self.sums_of(&seen_lists);
        let (observed_counts, observed) = self.observed(entries);
        let mut all = Vec::new();
        for bit in 0..BLOCK as usize {
            let count = observed_counts[bit];
            if count == 0 {
                continue;
            }
            let row = bit * width..(bit + 1) * width;
            let sums = SpectralSums::of_parts(
                self.candidates.clone(),
                (count, observed[row.clone()].to_vec()),
                (seen_lists[bit].len(), seen[row].to_vec()),
            )?;
            let feature = block * BLOCK + bit as u32;
            all.push(FeatureSums { feature, sums });
        }
        Ok(all)
    }

    /// How often each feature was observed, and the sums over these visits.
    fn observed(&self, entries: &[Entry]) -> (Vec<usize>, Vec<i64>) {
        let num_ones: usize = entries
            .iter()
            .map(|it| it.observed.count_ones() as usize)
            .sum();
        let num_all = self.num_visits * BLOCK as usize;
        if 2 * num_ones <= num_all {
            let lists = lists(entries.iter().map(|it| (it.visit, it.observed)));
            return (lists.iter().map(Vec::len).collect(), self.sums_of(&lists));
        }
        // Most visits looked: what did not is taken away from the sum of all.
        let mut counts = vec![self.num_visits; BLOCK as usize];
        let mut sums = self.total.repeat(BLOCK as usize);
        if num_ones < num_all {
            let mut entries = entries.iter().peekable();
            let missing = (0..self.num_visits as u32).map(|visit| {
                let entry = entries.next_if(|entry| entry.visit == visit);
                (visit, entry.map_or(u64::MAX, |entry| !entry.observed))
            });
            let lists = lists(missing);
            for (count, list) in counts.iter_mut().zip(&lists) {
                *count -= list.len();
            }
            for (sum, missing) in sums.iter_mut().zip(self.sums_of(&lists)) {
                *sum -= missing;
            }
        }
        (counts, sums)
    }

    fn sums_of(&self, lists: &[Vec<u32>]) -> Vec<i64> {
        let rows: Vec<&[u32]> = lists.iter().map(Vec::as_slice).collect();
        let mut sums = vec![0; rows.len() * self.table.width()];
        self.table.sums_into(&rows, &mut sums);
        sums
    }
}

/// For each bit, the visits at which it is one.
fn lists(words: impl Iterator<Item = (u32, u64)>) -> Vec<Vec<u32>> {
    let mut lists = vec![Vec::new(); BLOCK as usize];
    for (visit, mut word) in words {
        while word != 0 {
            lists[word.trailing_zeros() as usize].push(visit);
            word &= word - 1;
        }
    }
    lists
}

#[cfg(test)]
mod tests {
    use fremen::{Period, Time};

    use super::*;

    /// Numbers that look random and are the same in every run.
    fn noise(seed: u64) -> u64 {
        let mut x = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15);
        x = (x ^ x >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        x = (x ^ x >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        x ^ x >> 31
    }

    #[test]
    fn sums_are_those_of_single_observations() {
        let candidates = CandidatePeriods::harmonic(Period::WEEK, 20).expect("valid");
        // Few and many states are known and are 1: every way to sum.
        for (known, ones) in [(9, 10), (9, 2), (10, 10), (2, 5)] {
            let mut log = PlaceLog::new("door");
            let mut expected = BTreeMap::<u32, SpectralSums>::new();
            for visit in 0..300_u64 {
                let time = Time::from_s(visit as i64 * 7_321);
                let at = log.visit(visit.into(), time).expect("one time");
                for feature in 0..150_u32 {
                    let draw = noise(visit * 1_000 + u64::from(feature));
                    if draw % 10 >= known {
                        continue;
                    }
                    let state = draw / 10 % 10 < ones;
                    log.add_run(at, &[feature as i32], &[state])
                        .expect("said once");
                    (expected.entry(feature))
                        .or_insert_with(|| SpectralSums::new(candidates.clone()))
                        .add(time, state)
                        .expect("few");
                }
            }
            let sums = log.sums(&candidates).expect("few");
            assert_eq!(sums.len(), expected.len());
            for (it, (feature, expected)) in sums.iter().zip(expected) {
                assert_eq!((it.feature, &it.sums), (feature, &expected));
            }
        }
    }

    #[test]
    fn more_observations_than_a_sum_holds_are_an_error() {
        let of = |feature, num_observed| {
            let candidates = CandidatePeriods::calendar();
            let zeros = vec![0; 2 * candidates.len()];
            let sums =
                SpectralSums::of_parts(candidates, (num_observed, zeros.clone()), (0, zeros));
            let sums = sums.expect("possible");
            FeatureSums { feature, sums }
        };
        let mut known = vec![of(2, 7), of(5, MAX_OBSERVATIONS - 1)];
        merge("belt", &mut known, vec![of(2, 1), of(5, 1)]).expect("just enough");
        let error = merge("belt", &mut known, vec![of(5, 1)]).expect_err("one too many");
        assert_eq!(error.kind(), fremen::ErrorKind::Shape);
        let text = error.to_string();
        assert!(
            text.contains("place `belt`, feature 5") && text.contains("8388607"),
            "{text}"
        );
    }

    #[test]
    fn more_than_one_run_is_one_sum() {
        let candidates = CandidatePeriods::calendar();
        let mut log = PlaceLog::new("door");
        let mut expected = SpectralSums::new(candidates.clone());
        for visit in 0..2 * RUN as u64 + 17 {
            let (time, state) = (
                Time::from_s(visit as i64 * 61),
                noise(visit).is_multiple_of(3),
            );
            let at = log.visit(visit.into(), time).expect("one time");
            log.add_run(at, &[3], &[state]).expect("said once");
            expected.add(time, state).expect("few");
        }
        let sums = log.sums(&candidates).expect("few");
        assert_eq!(sums.len(), 1);
        assert_eq!((sums[0].feature, &sums[0].sums), (3, &expected));
    }
}
