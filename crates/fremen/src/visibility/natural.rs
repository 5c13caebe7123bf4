//! Which rhythms of the year, the week and the day does a place follow, learnt from a few odd
//! hours?
//!
//! `p(t) = clamp(b x(t))`, `x(t) = (1, cos w_a t, sin w_a t, ...)` with rhythms that all features
//! of a place share, taken in order from three cycles: a year; a week and its half; a day and its
//! half, third and quarter. One mean and all rhythms are solved for together, because visits at
//! certain hours only make them look alike, one at a time.
//!
//! # What keeps it from dreaming
//!
//! Visits at office hours say little of the night, and visits of one hour are nearly one
//! observation. So the days are what counts:
//!
//! 1. *Dispersion.* `phi = sum over days of (sum of residuals of the mean)^2 / sum of residuals^2`,
//!    over all features, at least 1: by how much the visits of a day repeat each other (a
//!    cluster-robust variance over that of independent visits).
//! 2. *Ridge.* b minimises `sum (s - b x)^2 + ridge phi (b_1^2 + b_2^2 + ...)`: a normal prior
//!    whose variance is the noise's over `ridge`. The default 3 is the noise of a coin (1/4) over
//!    the variance of a number that may be anything within half of the mean (1/12). Where few
//!    independent days speak, p stays near the mean, and what was never observed is extrapolated by
//!    the slowest rhythms only.
//! 3. *Held-out days.* For each of the 30 choices of cycles and their harmonics, whole days are
//!    left out, ten runs of consecutive ones in turn, and predicted by the others. The choice with
//!    the lowest squared error is taken if it beats the mean by more than the standard error of the
//!    difference over the runs; otherwise it is the mean. Random visits left out instead would be
//!    predicted by their neighbours.
//!
//! 4. *Bursts.* Visits far closer than usual count one together
//!    ([`independence`](super::independence)), in every sum here.
//! 5. *Reach.* What comes out is believed as far as visits reach, and the mean beyond
//!    ([`Cautious`](super::Cautious)).
//!
//! A day is 24 h from the earliest visit on, so that no zone is preferred and shifted times shift
//! p. Fewer than 8 visits or 3 days give the mean.
//!
//! # Cost
//!
//! Everything is computed from sums of products of x and of states, rounded to whole numbers of
//! 2^-40 as in [`SpectralSums`](crate::spectrum::SpectralSums): O(visits x 120) for a place, O(one
//! bits x 15) for its features, and 300 systems of at most 15 unknowns for each birth cohort of the
//! at most 256 features that choose. The model is a [`Fremen`] in form and as small.
//!
//! Sources: harmonic regression with a floating mean as in Zechmeister and Kuerster 2009
//! (generalised Lomb-Scargle); the order on held-out data as in T-RO 2017 IV-B. Not for rhythms of
//! other lengths, such as a machine's or a shift plan's: let [`Fremen`] look for them.

use super::Fremen;
use super::evidence::Evidence;
use super::fremen::{lowest, supported};
use super::independence::weights;
use super::{Guards, HistoryLog};
use crate::error::Result;
use crate::spectrum::{
    CandidatePeriods, Cholesky, MAX_OBSERVATIONS, P_UNKNOWN, from_fixed, to_fixed, too_many,
};
use crate::time::Period;

/// Rhythms of each cycle, slowest first: year, week, day.
const NUM_HARMONICS: [usize; 3] = [1, 2, 4];
/// Mean, then cosine and sine of every rhythm.
const SIZE: usize = 1 + 2 * 7;
/// Products of two columns, the lower triangle.
const NUM_PRODUCTS: usize = SIZE * (SIZE + 1) / 2;
/// How often each cycle must fit into the span of the visits. One year is enough to be looked at,
/// since that is what outdoor maps begin with.
const MIN_CYCLES: [f64; 3] = [0.9, 1.5, 1.5];
/// Features that choose the rhythms.
const MAX_VOTERS: usize = 256;
/// Fewer visits than this, or days, give the mean.
const MIN_VISITS: f64 = 8.0;
const MIN_DAYS: usize = 3;
/// Runs of days that are left out in turn.
const MAX_RUNS: usize = 10;

/// Sums of the products of columns, in fixed point.
type Gram = [i64; NUM_PRODUCTS];

fn candidates() -> Result<CandidatePeriods> {
    let cycles = [Period::YEAR, Period::WEEK, Period::DAY];
    let rhythms = cycles.into_iter().zip(NUM_HARMONICS);
    CandidatePeriods::list(
        rhythms
            .flat_map(|(cycle, count)| (1..=count as u32).map(move |part| cycle.fraction(part)))
            .collect(),
    )
}

/// Every choice of so many rhythms of each cycle, as indices of candidates; those with fewer first.
fn choices(allowed: &[bool]) -> Vec<Vec<usize>> {
    let [years, weeks, days] = NUM_HARMONICS;
    let mut choices = Vec::new();
    for year in 0..=years {
        for week in 0..=weeks {
            for day in 0..=days {
                let rhythms = (0..year)
                    .chain(years..years + week)
                    .chain(years + weeks..years + weeks + day);
                choices.push(rhythms.collect::<Vec<_>>());
            }
        }
    }
    choices.retain(|choice| choice.iter().all(|&k| allowed[k]));
    choices.sort_by_key(Vec::len);
    choices
}

/// Columns of the mean and of some rhythms.
fn columns(rhythms: &[usize]) -> Vec<usize> {
    let both = rhythms.iter().flat_map(|&k| [1 + 2 * k, 2 + 2 * k]);
    std::iter::once(0).chain(both).collect()
}

fn product_at(row: usize, column: usize) -> usize {
    let (low, high) = (row.min(column), row.max(column));
    high * (high + 1) / 2 + low
}

/// The visits as rows of x, and what each counts.
struct Design {
    rows: Vec<[f64; SIZE]>,
    weights: Vec<f64>,
}

impl Design {
    fn new(evidence: &Evidence<'_>, candidates: &CandidatePeriods, weights: Vec<f64>) -> Self {
        let count = candidates.len();
        let mut phasors = vec![0.0; 2 * count];
        let rows = evidence.times().map(|time| {
            candidates.phasors_into(time, &mut phasors);
            let mut row = [1.0; SIZE];
            for k in 0..count {
                (row[1 + 2 * k], row[2 + 2 * k]) = (phasors[k], phasors[count + k]);
            }
            row
        });
        let rows = rows.collect();
        Self { rows, weights }
    }

    /// Adds the products of visit `index` to `gram`, or takes them away.
    fn add(&self, index: usize, sign: i64, gram: &mut Gram) {
        let (x, weight) = (&self.rows[index], self.weights[index]);
        let mut at = 0;
        for (i, a) in x.iter().enumerate() {
            for b in &x[..=i] {
                gram[at] += sign * to_fixed(weight * (a * b));
                at += 1;
            }
        }
    }
}

/// Runs of consecutive days.
struct Days {
    /// For each visit, by its index: the run that its day is in.
    run_of: Vec<usize>,
    num_runs: usize,
    /// The indices of each day's visits.
    visits: Vec<Vec<usize>>,
}

impl Days {
    fn new(evidence: &Evidence<'_>) -> Self {
        let times: Vec<i128> = evidence.times().map(|t| i128::from(t.as_us())).collect();
        let first = times.iter().copied().min().unwrap_or_default();
        let day = |index: usize| (times[index] - first) / i128::from(Period::DAY.as_us());
        let mut by_time: Vec<usize> = (0..times.len()).collect();
        by_time.sort_by_key(|&index| (times[index], index));
        let days: Vec<Vec<usize>> = by_time
            .chunk_by(|&a, &b| day(a) == day(b))
            .map(<[usize]>::to_vec)
            .collect();
        let num_runs = days.len().min(MAX_RUNS);
        let mut run_of = vec![0; times.len()];
        for (i, visits) in days.iter().enumerate() {
            for &index in visits {
                run_of[index] = i * num_runs / days.len();
            }
        }
        Self {
            run_of,
            num_runs,
            visits: days,
        }
    }
}

/// The sums of products for one feature after the other, in order of birth.
struct Cohorts<'a> {
    evidence: &'a Evidence<'a>,
    design: &'a Design,
    run_of: &'a [usize],
    /// Of each run, over the visits from index `from` on.
    grams: Vec<Gram>,
    from: usize,
    any_hidden: bool,
}

impl<'a> Cohorts<'a> {
    fn new(
        evidence: &'a Evidence<'a>,
        design: &'a Design,
        run_of: &'a [usize],
        num_runs: usize,
    ) -> Self {
        let mut grams = vec![[0; NUM_PRODUCTS]; num_runs];
        for (index, &run) in run_of.iter().enumerate() {
            design.add(index, 1, &mut grams[run]);
        }
        Self {
            evidence,
            design,
            run_of,
            grams,
            from: 0,
            any_hidden: evidence.any_hidden(),
        }
    }

    /// The sums of each run for `feature`, which is not born before the one requested last; `None`
    /// if they are those of that one.
    fn next(&mut self, feature: usize, is_first: bool) -> Option<Vec<Gram>> {
        let from = self.evidence.first_visit(feature);
        let is_same = from == self.from && !is_first && !self.any_hidden;
        for index in self.from..from {
            self.design
                .add(index, -1, &mut self.grams[self.run_of[index]]);
        }
        self.from = from;
        if is_same {
            return None;
        }
        let mut grams = self.grams.clone();
        if self.any_hidden {
            for index in from..self.run_of.len() {
                if is_hidden(self.evidence.log, self.evidence.visits[index], feature) {
                    self.design.add(index, -1, &mut grams[self.run_of[index]]);
                }
            }
        }
        Some(grams)
    }
}

fn is_hidden(log: &HistoryLog, visit: usize, feature: usize) -> bool {
    log.hidden_row(visit).is_some_and(|row| row.get(feature))
}

fn total(grams: &[Gram]) -> Gram {
    let mut sum = [0; NUM_PRODUCTS];
    for gram in grams {
        for (sum, value) in sum.iter_mut().zip(gram) {
            *sum += value;
        }
    }
    sum
}

/// The normal equations of some columns; `None` without observations.
fn equations(gram: &Gram, columns: &[usize], ridge: f64) -> Option<Cholesky> {
    let size = columns.len();
    let mut matrix = vec![0.0; size * size];
    for (i, &a) in columns.iter().enumerate() {
        for (j, &b) in columns.iter().enumerate() {
            matrix[i * size + j] = from_fixed(gram[product_at(a, b)]);
        }
        matrix[i * size + i] += if i == 0 { 0.0 } else { ridge };
    }
    Cholesky::new(matrix, size)
}

/// What is needed to learn a place's natural rhythms.
pub(super) struct Natural {
    /// Penalty on a rhythm, in independent observations.
    pub(super) ridge: f64,
    pub(super) guards: Option<Guards>,
}

impl Natural {
    pub(super) fn fit(&self, evidence: &Evidence<'_>) -> Result<Fremen> {
        let num_visits = evidence.visits.len();
        if num_visits > MAX_OBSERVATIONS {
            return Err(too_many(num_visits));
        }
        let candidates = candidates()?;
        let counts = evidence.counts();
        let times: Vec<_> = evidence.times().collect();
        let weights = weights(&times);
        let means = weighted_means(evidence, &weights);
        let days = Days::new(evidence);
        let changes = |&f: &usize| counts.seen[f] > 0 && counts.seen[f] < counts.observed[f];
        let changing: Vec<usize> = (0..evidence.num_features()).filter(changes).collect();
        if weights.iter().sum::<f64>() < MIN_VISITS
            || days.visits.len() < MIN_DAYS
            || changing.is_empty()
        {
            return Ok(Fremen::of_means(candidates, 0, means));
        }
        let step = changing.len().div_ceil(MAX_VOTERS);
        let voters: Vec<usize> = changing.iter().copied().step_by(step).collect();
        let ridge = self.ridge * dispersion(evidence, &days, &voters, &means, &weights);
        let design = Design::new(evidence, &candidates, weights);
        let allowed = self.allowed(evidence, &candidates);
        let rhythms = choose(evidence, &design, &days, &voters, ridge, &choices(&allowed));
        let mut model = Fremen::of_means(candidates, rhythms.len(), means);
        if rhythms.is_empty() {
            return Ok(model);
        }
        let columns = columns(&rhythms);
        let one_run = vec![0; num_visits];
        let seen = seen_sums(evidence, &design, &one_run, 1, &changing);
        let mut cohorts = Cohorts::new(evidence, &design, &one_run, 1);
        let mut factor = None;
        for (i, &feature) in changing.iter().enumerate() {
            if let Some(grams) = cohorts.next(feature, i == 0) {
                factor = equations(&grams[0], &columns, ridge);
            }
            let Some(factor) = &factor else { continue };
            let mut solution: Vec<f64> = columns.iter().map(|&c| from_fixed(seen[i][c])).collect();
            factor.solve(&mut solution);
            // Strongest first, as everywhere.
            let mut pairs: Vec<_> = rhythms.iter().zip(solution[1..].chunks_exact(2)).collect();
            pairs.sort_by(|a, b| b.1[0].hypot(b.1[1]).total_cmp(&a.1[0].hypot(a.1[1])));
            let harmonics: Vec<u16> = pairs.iter().map(|(k, _)| **k as u16 + 1).collect();
            let factors: Vec<f64> = pairs.iter().flat_map(|(_, f)| [f[0], f[1]]).collect();
            model.set(feature, solution[0], &harmonics, &factors);
        }
        Ok(model)
    }

    fn allowed(&self, evidence: &Evidence<'_>, candidates: &CandidatePeriods) -> Vec<bool> {
        let first = evidence.times().min().unwrap_or_default();
        let last = evidence.times().max().unwrap_or_default();
        let span_s = last.since_s(first);
        let cycles = MIN_CYCLES.into_iter().zip(NUM_HARMONICS);
        let min_cycles = cycles.flat_map(|(min, count)| std::iter::repeat_n(min, count));
        let mut allowed: Vec<bool> = (min_cycles.enumerate())
            .map(|(k, min)| min * candidates.period_s(k) <= span_s)
            .collect();
        if let Some(guards) = self.guards {
            let supported = supported(evidence, candidates, guards);
            for (allowed, supported) in allowed.iter_mut().zip(supported) {
                *allowed &= supported;
            }
        }
        allowed
    }
}

/// The share of what visits count at which each feature was seen; 1/2 without any.
fn weighted_means(evidence: &Evidence<'_>, weights: &[f64]) -> Vec<f64> {
    let mut sums = vec![(0_i64, 0_i64); evidence.num_features()];
    for (&visit, &weight) in evidence.visits.iter().zip(weights) {
        let weight = to_fixed(weight);
        evidence.for_each_state(visit, |feature, state| {
            let (seen, observed) = &mut sums[feature];
            *observed += weight;
            *seen += i64::from(state) * weight;
        });
    }
    (sums.into_iter())
        .map(|(seen, observed)| match observed {
            0 => P_UNKNOWN,
            observed => from_fixed(seen) / from_fixed(observed),
        })
        .collect()
}

/// By how much the visits of a day repeat each other: 1 if they are independent.
fn dispersion(
    evidence: &Evidence<'_>,
    days: &Days,
    voters: &[usize],
    means: &[f64],
    weights: &[f64],
) -> f64 {
    // For each voter: the squared sums of days, the sum of squares, days with observations.
    let mut of_days = vec![0.0; voters.len()];
    let mut of_visits = vec![0.0; voters.len()];
    let mut num_days = vec![0.0; voters.len()];
    for day in &days.visits {
        let mut counts = vec![(0.0, 0.0); voters.len()];
        for &index in day {
            let visit = evidence.visits[index];
            let num_known = evidence.num_known(visit);
            let seen = evidence.log.seen_row(visit);
            for (&feature, (num_seen, num_observed)) in voters.iter().zip(&mut counts) {
                if feature < num_known && !is_hidden(evidence.log, visit, feature) {
                    *num_observed += weights[index];
                    *num_seen += weights[index] * f64::from(u8::from(seen.get(feature)));
                }
            }
        }
        for (i, (seen, observed)) in counts.into_iter().enumerate() {
            let mean = means[voters[i]];
            of_days[i] += (seen - mean * observed).powi(2);
            of_visits[i] += seen * (1.0 - mean).powi(2) + (observed - seen) * mean * mean;
            num_days[i] += f64::from(u8::from(observed > 0.0));
        }
    }
    // One mean was taken off of the days.
    let between: f64 = (of_days.iter().zip(&num_days))
        .map(|(squares, days)| squares * days / f64::max(days - 1.0, 1.0))
        .sum();
    let within: f64 = of_visits.iter().sum();
    if within > 0.0 {
        (between / within).max(1.0)
    } else {
        1.0
    }
}

/// For each of `features`, for each run: the sum of x over the visits at which it was seen.
fn seen_sums(
    evidence: &Evidence<'_>,
    design: &Design,
    run_of: &[usize],
    num_runs: usize,
    features: &[usize],
) -> Vec<[i64; SIZE]> {
    let mut sums = vec![[0; SIZE]; features.len() * num_runs];
    for (index, &visit) in evidence.visits.iter().enumerate() {
        let seen = evidence.log.seen_row(visit);
        let weight = design.weights[index];
        let row = design.rows[index].map(|x| to_fixed(weight * x));
        for (i, _) in features.iter().enumerate().filter(|(_, f)| seen.get(**f)) {
            for (sum, value) in sums[i * num_runs + run_of[index]].iter_mut().zip(row) {
                *sum += value;
            }
        }
    }
    sums
}

/// The rhythms that predict left-out days best; none if they are not clearly better than the mean.
fn choose(
    evidence: &Evidence<'_>,
    design: &Design,
    days: &Days,
    voters: &[usize],
    ridge: f64,
    choices: &[Vec<usize>],
) -> Vec<usize> {
    let num_runs = days.num_runs;
    let seen = seen_sums(evidence, design, &days.run_of, num_runs, voters);
    let all_columns: Vec<_> = choices.iter().map(|choice| columns(choice)).collect();
    // For each choice, for each run that is left out.
    let mut errors = vec![vec![0.0; num_runs]; choices.len()];
    let mut cohorts = Cohorts::new(evidence, design, &days.run_of, num_runs);
    let mut grams = Vec::new();
    let mut factors = Vec::new();
    for (i, &voter) in voters.iter().enumerate() {
        if let Some(next) = cohorts.next(voter, i == 0) {
            let all = total(&next);
            let of_run = |run: &Gram| -> Vec<_> {
                let learnt = std::array::from_fn(|at| all[at] - run[at]);
                let of_choice = all_columns.iter();
                of_choice
                    .map(|columns| equations(&learnt, columns, ridge))
                    .collect()
            };
            factors = next.iter().map(of_run).collect::<Vec<_>>();
            grams = next;
        }
        let seen = &seen[i * num_runs..(i + 1) * num_runs];
        let mut all = [0; SIZE];
        for run in seen {
            for (sum, value) in all.iter_mut().zip(run) {
                *sum += value;
            }
        }
        for run in 0..num_runs {
            for (choice, columns) in all_columns.iter().enumerate() {
                // Without observations in the other runs no choice predicts anything.
                let Some(factor) = &factors[run][choice] else {
                    continue;
                };
                let mut b: Vec<f64> = (columns.iter())
                    .map(|&c| from_fixed(all[c] - seen[run][c]))
                    .collect();
                factor.solve(&mut b);
                errors[choice][run] += squared_error(&grams[run], &seen[run], columns, &b);
            }
        }
    }
    let totals: Vec<f64> = errors.iter().map(|runs| runs.iter().sum()).collect();
    // The first of equals has fewest rhythms; sums of one value must not choose by their last bits.
    let scale = 1e9 / totals[0].max(1e-9);
    let rounded: Vec<f64> = totals.iter().map(|total| (total * scale).round()).collect();
    let best = lowest(&rounded);
    let gains: Vec<f64> = (errors[0].iter().zip(&errors[best]))
        .map(|(mean, best)| mean - best)
        .collect();
    let gain: f64 = gains.iter().sum();
    let count = num_runs as f64;
    let variance = gains
        .iter()
        .map(|g| (g - gain / count).powi(2))
        .sum::<f64>()
        / (count - 1.0);
    if gain > (count * variance).sqrt() {
        choices[best].clone()
    } else {
        Vec::new()
    }
}

/// `sum (s - b x)^2` over the visits of one run, from its sums.
fn squared_error(gram: &Gram, seen: &[i64; SIZE], columns: &[usize], b: &[f64]) -> f64 {
    let mut error = from_fixed(seen[0]);
    for (i, &row) in columns.iter().enumerate() {
        error -= 2.0 * b[i] * from_fixed(seen[row]);
        error += b[i] * b[i] * from_fixed(gram[product_at(row, row)]);
        for (j, &column) in columns[..i].iter().enumerate() {
            error += 2.0 * b[i] * b[j] * from_fixed(gram[product_at(row, column)]);
        }
    }
    error
}
