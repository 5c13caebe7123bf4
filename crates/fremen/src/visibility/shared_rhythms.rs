//! Which rhythms does a place follow?
//!
//! One feature of a place has too few visits to choose among many periods; all features together
//! have enough. The rhythms are therefore chosen once per place, on the sum over features of the
//! squares that harmonic least squares explains ([`HarmonicRegression`]), one after the other:
//!
//! 1. Guards drop what the visit times cannot support.
//! 2. A rhythm may be chosen if it is one of the natural cycles (a day, a week, a year, or the base
//!    period itself), or the next harmonic of a natural cycle whose harmonics before it have been
//!    chosen. Visits at certain hours only make many rhythms fit alike where there are visits;
//!    natural ones also hold where there are none.
//! 3. Each step adds the one that explains most beyond those already chosen.
//! 4. False alarms: the visit times are shuffled 19 times against the rows of the log, which keeps
//!    everything but the rhythms. The longest choice that explains more than every shuffle's choice
//!    of the same length is kept (a chance of 1 in 20 for each length that pure noise gets
//!    through).
//! 5. How many of those are kept is decided on held-out visits, with the choice repeated without
//!    them.
//!
//! Not for rhythms of unnatural length, such as a machine's: let FreMEn look for them.
//!
//! At most 2,048 features, evenly spread, take part.

use super::chance::Shuffles;
use super::config::{Guards, HeldOut};
use super::evidence::Evidence;
use super::fremen::{BlockSums, lowest, splits, supported};
use super::{Fremen, VisibilityModel};
use crate::error::{Error, ErrorKind, Result};
use crate::spectrum::{CandidatePeriods, HarmonicRegression, PhasorTable, from_fixed};
use crate::time::{Period, Time};

/// Features that choose the rhythms.
const MAX_VOTERS: usize = 2_048;
/// Shuffles of the visit times: one in 20 for a false alarm.
const NUM_SHUFFLES: u64 = 19;

/// What is needed to learn a place's rhythms.
pub(super) struct SharedRhythms<'a> {
    pub(super) candidates: &'a CandidatePeriods,
    /// Used without choosing, where given.
    pub(super) harmonics: Option<&'a [u16]>,
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
        if let Some(harmonics) = self.harmonics {
            return Ok(harmonics.to_vec());
        }
        if evidence.visits.len() < self.held_out.min_visits() || self.held_out.max_order() == 0 {
            return Ok(Vec::new());
        }
        let allowed = self.allowed(evidence);
        let (mut path, explained) = self.path(&voters(evidence, &doubled, None)?, &allowed);
        let by_chance = self.explained_by_chance(evidence, &doubled, &allowed)?;
        let is_signal = |&order: &usize| {
            // A shuffle's choice may be shorter; what it explains then is as much as it can.
            let last = by_chance.len() - 1;
            explained[order] > by_chance[order.min(last)]
        };
        path.truncate((1..explained.len()).rev().find(is_signal).unwrap_or(0));
        if path.is_empty() {
            return Ok(path);
        }
        let mut errors = vec![0.0; path.len() + 1];
        for (learnt, judged) in splits(evidence, self.held_out.split()) {
            if learnt.is_empty() {
                return Ok(Vec::new());
            }
            let learnt = evidence.of_visits(learnt);
            let (fold_path, _) = self.path(&voters(&learnt, &doubled, None)?, &allowed);
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

    /// For each order, the most that a choice of that many rhythms explains when the visit times
    /// are shuffled.
    fn explained_by_chance(
        &self,
        evidence: &Evidence<'_>,
        doubled: &CandidatePeriods,
        allowed: &[bool],
    ) -> Result<Vec<f64>> {
        let mut shuffles = Shuffles::new(evidence);
        let mut most: Vec<f64> = Vec::new();
        for _ in 0..NUM_SHUFFLES {
            let times = shuffles.draw();
            let voters = voters(evidence, doubled, Some(&times))?;
            let (_, explained) = self.path(&voters, allowed);
            most.resize(most.len().max(explained.len()), 0.0);
            for (most, explained) in most.iter_mut().zip(explained) {
                *most = most.max(explained);
            }
        }
        Ok(most)
    }

    /// Up to the greatest number of harmonics, each the one that explains most beyond those before
    /// it, and the squares that 0, 1, 2, ... of them explain beyond the mean.
    fn path(&self, voters: &Voters, allowed: &[bool]) -> (Vec<u16>, Vec<f64>) {
        let natural = self.natural_cycles();
        let mut path: Vec<u16> = Vec::new();
        let by_mean = voters.explained(&path, self.ridge);
        let mut explained = vec![0.0];
        while path.len() < self.held_out.max_order() {
            let mut next: Vec<u16> = natural
                .iter()
                .filter_map(|&cycle| {
                    let mut multiples = (1..).map(|i| cycle * i);
                    multiples.find(|harmonic| !path.contains(&(*harmonic as u16)))
                })
                .filter(|&harmonic| allowed.get(harmonic - 1) == Some(&true))
                .map(|harmonic| harmonic as u16)
                .collect();
            next.sort_unstable();
            next.dedup();
            let mut best: Option<(f64, u16)> = None;
            for harmonic in next {
                path.push(harmonic);
                let total = voters.explained(&path, self.ridge) - by_mean;
                path.pop();
                if best.is_none_or(|(most, _)| total > most * (1.0 + 1e-9)) {
                    best = Some((total, harmonic));
                }
            }
            let Some((total, harmonic)) = best else { break };
            path.push(harmonic);
            explained.push(total);
        }
        (path, explained)
    }

    /// The harmonics that are a day, a week, a year, or the base period.
    fn natural_cycles(&self) -> Vec<usize> {
        let base_us = self
            .candidates
            .as_harmonic()
            .map_or(1, |(base, _)| base.as_us());
        let natural = [Period::YEAR, Period::WEEK, Period::DAY].map(Period::as_us);
        let mut cycles = vec![1];
        cycles.extend(
            (natural.into_iter())
                .filter(|cycle_us| base_us % cycle_us == 0)
                .map(|cycle_us| (base_us / cycle_us) as usize),
        );
        cycles.sort_unstable();
        cycles.dedup();
        cycles
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

/// Sums of up to [`MAX_VOTERS`] evenly spread features, with the visits at their own times or
/// others.
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
