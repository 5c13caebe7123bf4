//! Which rhythms does a place follow?
//!
//! One feature of a place has too few visits to choose among many periods; all features together have
//! enough. The rhythms are therefore chosen once per place, on the sum over features of the squares that
//! harmonic least squares explains ([`HarmonicRegression`]), one after the other:
//!
//! 1. Guards drop what the visit times cannot support.
//! 2. Each step adds the candidate that explains most beyond those already chosen.
//! 3. False alarms: the visit times are shuffled 19 times against the rows of the log, which keeps
//!    everything but the rhythms; a step that explains no more than the best candidate of the best
//!    shuffle ends the choice (a chance of 1 in 20 that pure noise gets a rhythm at all).
//! 4. How many are kept is decided on held-out visits, with the choice repeated without them.
//!
//! At most 2,048 features, evenly spread, are asked.

use super::config::{Guards, HeldOut};
use super::evidence::Evidence;
use super::fremen::{BlockSums, lowest, splits, supported};
use super::{Fremen, VisibilityModel};
use crate::error::{Error, ErrorKind, Result};
use crate::spectrum::{CandidatePeriods, HarmonicRegression, PhasorTable, from_fixed};
use crate::time::Time;

/// Features that choose the rhythms.
const MAX_VOTERS: usize = 2_048;
/// Shuffles of the visit times: one in 20 for a false alarm.
const NUM_SHUFFLES: u64 = 19;

/// What is needed to learn a place's rhythms.
pub(super) struct SharedRhythms<'a> {
    pub(super) candidates: &'a CandidatePeriods,
    /// How many rhythms at most, and how their number is judged.
    pub(super) held_out: HeldOut,
    /// Penalty, in visits.
    pub(super) ridge: f64,
    pub(super) guards: Option<Guards>,
}

/// Sums of all voters.
struct Voters {
    /// Width of a row of `seen`.
    width: usize,
    num_seen: Vec<usize>,
    seen: Vec<f64>,
    /// Features with the same observations: how many observations, `W_m`, and the voters.
    cohorts: Vec<(usize, Vec<f64>, Vec<usize>)>,
}

impl SharedRhythms<'_> {
    /// The candidates to twice the highest harmonic, as the normal equations need.
    fn doubled(&self) -> Result<CandidatePeriods> {
        let Some((base, count)) = self.candidates.as_harmonic() else {
            return Err(Error::new(
                ErrorKind::Config,
                "rhythms shared by a place need harmonic candidate periods",
            )
            .with_help("give `base-s` and `count` instead of a list"));
        };
        CandidatePeriods::harmonic(base, 2 * count)
    }

    /// The harmonics that the place follows, strongest first.
    pub(super) fn choose(&self, evidence: &Evidence<'_>) -> Result<Vec<u16>> {
        let doubled = self.doubled()?;
        if evidence.visits.len() < self.held_out.min_visits() || self.held_out.max_order() == 0 {
            return Ok(Vec::new());
        }
        let allowed = self.allowed(evidence);
        let by_chance = self.explained_by_chance(evidence, &doubled, &allowed)?;
        let voters = voters(evidence, &doubled, None)?;
        let mut path = self.path(&voters, &allowed, by_chance);
        if path.is_empty() {
            return Ok(path);
        }
        let mut errors = vec![0.0; path.len() + 1];
        for (learnt, judged) in splits(evidence, self.held_out.split()) {
            if learnt.is_empty() {
                return Ok(Vec::new());
            }
            let learnt = evidence.of_visits(learnt);
            let table_voters = self::voters(&learnt, &doubled, None)?;
            let fold_path = self.path(&table_voters, &allowed, 0.0);
            for (order, error) in errors.iter_mut().enumerate() {
                let harmonics = &fold_path[..order.min(fold_path.len())];
                let model = self.regress(&learnt, harmonics)?;
                let mut p = vec![0.0; model.num_features()];
                for &visit in &judged {
                    model.predict_into(evidence.log.times()[visit], &mut p);
                    evidence.for_each_state(visit, |feature, state| {
                        *error += (p[feature] - f64::from(u8::from(state))).powi(2);
                    });
                }
            }
        }
        path.truncate(lowest(&errors));
        Ok(path)
    }

    fn allowed(&self, evidence: &Evidence<'_>) -> Vec<bool> {
        match self.guards {
            Some(guards) => supported(evidence, self.candidates, guards),
            None => vec![true; self.candidates.len()],
        }
    }

    /// The most that one candidate explains when the visit times are shuffled.
    fn explained_by_chance(
        &self,
        evidence: &Evidence<'_>,
        doubled: &CandidatePeriods,
        allowed: &[bool],
    ) -> Result<f64> {
        // In order of time, so that the order of arrival is of no importance.
        let mut by_time: Vec<usize> = (0..evidence.visits.len()).collect();
        let visit_times: Vec<_> = evidence.times().collect();
        by_time.sort_by_key(|&index| (visit_times[index], index));
        let mut most = 0.0_f64;
        let mut random = 0_u64;
        for _ in 0..NUM_SHUFFLES {
            let mut drawn = by_time.clone();
            for i in (1..drawn.len()).rev() {
                random = random.wrapping_add(0x9E37_79B9_7F4A_7C15);
                drawn.swap(i, (mixed(random) % (i as u64 + 1)) as usize);
            }
            let mut times = visit_times.clone();
            for (&index, &other) in by_time.iter().zip(&drawn) {
                times[index] = visit_times[other];
            }
            let voters = voters(evidence, doubled, Some(&times))?;
            let flat = voters.explained(&[], self.ridge);
            for (k, _) in allowed.iter().enumerate().filter(|(_, allowed)| **allowed) {
                most = most.max(voters.explained(&[k as u16 + 1], self.ridge) - flat);
            }
        }
        Ok(most)
    }

    /// Up to the greatest number of harmonics, each the one that explains most beyond those before it
    /// and more than `by_chance`.
    fn path(&self, voters: &Voters, allowed: &[bool], by_chance: f64) -> Vec<u16> {
        let mut path = Vec::new();
        let mut explained = voters.explained(&path, self.ridge);
        while path.len() < self.held_out.max_order() {
            let mut best = (by_chance, None);
            for (k, _) in allowed.iter().enumerate().filter(|(_, allowed)| **allowed) {
                let harmonic = k as u16 + 1;
                if path.contains(&harmonic) {
                    continue;
                }
                path.push(harmonic);
                let gain = voters.explained(&path, self.ridge) - explained;
                path.pop();
                if gain > best.0 * (1.0 + 1e-9) {
                    best = (gain, Some(harmonic));
                }
            }
            let (gain, Some(harmonic)) = best else { break };
            path.push(harmonic);
            explained += gain;
        }
        path
    }

    /// Least squares of every feature on the given harmonics.
    pub(super) fn regress(&self, evidence: &Evidence<'_>, harmonics: &[u16]) -> Result<Fremen> {
        let counts = evidence.counts();
        let mut model = Fremen::of_means(self.candidates.clone(), harmonics.len(), counts.means());
        let Some(&highest) = harmonics.iter().max() else {
            return Ok(model);
        };
        // Only twice the highest harmonic in use is needed.
        let needed = match self.doubled()?.as_harmonic() {
            Some((base, _)) => CandidatePeriods::harmonic(base, 2 * usize::from(highest))?,
            None => return Ok(model),
        };
        let table = PhasorTable::new(&needed, evidence.times())?;
        let sums = BlockSums::new(evidence, &table);
        let width = table.width();
        let num_features = evidence.num_features();
        let mut last_cohort: Option<(usize, Vec<i64>, Option<HarmonicRegression>)> = None;
        for first in (0..num_features).step_by(BLOCK) {
            let last = (first + BLOCK).min(num_features);
            let (seen, observed) = sums.sums(first, last);
            for (i, feature) in (first..last).enumerate() {
                let row = i * width..(i + 1) * width;
                let count = counts.observed[feature] as usize;
                let is_same = last_cohort
                    .as_ref()
                    .is_some_and(|(of, sums, _)| *of == count && sums[..] == observed[row.clone()]);
                if !is_same {
                    let sums: Vec<_> = observed[row.clone()]
                        .iter()
                        .map(|&w| from_fixed(w))
                        .collect();
                    let regression = HarmonicRegression::new(count, &sums, harmonics, self.ridge);
                    last_cohort = Some((count, observed[row.clone()].to_vec(), regression));
                }
                let Some((_, _, Some(regression))) = &last_cohort else {
                    continue;
                };
                let seen: Vec<_> = seen[row].iter().map(|&s| from_fixed(s)).collect();
                let (solution, _) = regression.solve(counts.seen[feature] as usize, &seen);
                model.set(feature, solution[0], harmonics, &solution[1..]);
            }
        }
        Ok(model)
    }
}

/// Features whose sums are held at once.
const BLOCK: usize = 1_024;

/// Sums of up to [`MAX_VOTERS`] evenly spread features, with the visits at their own times or others.
fn voters(
    evidence: &Evidence<'_>,
    candidates: &CandidatePeriods,
    times: Option<&[Time]>,
) -> Result<Voters> {
    let table = match times {
        Some(times) => PhasorTable::new(candidates, times.iter().copied()),
        None => PhasorTable::new(candidates, evidence.times()),
    }?;
    let width = table.width();
    let sums = BlockSums::new(evidence, &table);
    let counts = evidence.counts();
    let num_features = evidence.num_features();
    let mut voters = Voters {
        width,
        num_seen: Vec::new(),
        seen: Vec::new(),
        cohorts: Vec::new(),
    };
    // Whole words of the log's rows are read, so voters come in groups of 64.
    let num_groups = num_features.div_ceil(64);
    let step = num_groups.div_ceil(MAX_VOTERS / 64).max(1);
    let mut last_sums: Vec<i64> = Vec::new();
    for group in (0..num_groups).step_by(step) {
        let (first, last) = (group * 64, (group * 64 + 64).min(num_features));
        let (seen, observed) = sums.sums(first, last);
        for (i, feature) in (first..last).enumerate() {
            let row = i * width..(i + 1) * width;
            let (num_seen, count) = (counts.seen[feature], counts.observed[feature]);
            if num_seen == 0 || num_seen == count {
                continue; // Nothing to explain.
            }
            let voter = voters.num_seen.len();
            voters.num_seen.push(num_seen as usize);
            voters
                .seen
                .extend(seen[row.clone()].iter().map(|&s| from_fixed(s)));
            let count = count as usize;
            match voters.cohorts.last_mut() {
                Some((of, _, members)) if *of == count && last_sums == observed[row.clone()] => {
                    members.push(voter);
                }
                _ => {
                    last_sums = observed[row].to_vec();
                    let sums = last_sums.iter().map(|&w| from_fixed(w)).collect();
                    voters.cohorts.push((count, sums, vec![voter]));
                }
            }
        }
    }
    Ok(voters)
}

impl Voters {
    /// The squares that mean and harmonics explain, over all voters.
    fn explained(&self, harmonics: &[u16], ridge: f64) -> f64 {
        let mut total = 0.0;
        for (count, observed, members) in &self.cohorts {
            let Some(regression) = HarmonicRegression::new(*count, observed, harmonics, ridge)
            else {
                continue;
            };
            for &voter in members {
                let seen = &self.seen[voter * self.width..(voter + 1) * self.width];
                total += regression.solve(self.num_seen[voter], seen).1;
            }
        }
        total
    }
}

/// The finaliser of `SplitMix64`: every bit of the state reaches every bit of the result.
fn mixed(state: u64) -> u64 {
    let state = (state ^ (state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let state = (state ^ (state >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    state ^ (state >> 31)
}
