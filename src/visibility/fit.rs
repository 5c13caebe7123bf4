//! How is a model of a place learnt from its log?
//!
//! With V visits, K candidates and B one bits in the log: `S_k` of all features costs O(B K) additions
//! (a visit at which a feature was not seen costs nothing), `W_k` is shared by all features of a birth
//! cohort and costs O(V K), selection O(F K l). Features are taken in blocks whose sums stay in the
//! cache, so memory is O(V K) beyond the model. Hidden bits are exact: a feature that was not
//! observable at a visit has that visit's phasors taken out of its own `W_k`.

use super::config::{BeforeBirth, Guards, HeldOut, ModelConfig, Order, Split, VisibilityConfig};
use super::{BitRow, Fremen, HistoryLog, Mean, VisibilityModel};
use crate::error::{Error, ErrorKind, Result};
use crate::spectrum::{CandidatePeriods, strongest};

/// p of a feature without any observation (RAS 4.1.2: "a completely unknown state").
const P_UNKNOWN: f64 = 0.5;

/// The sums of one block of features should fit into half of a usual second-level cache.
const BLOCK_BYTES: usize = 128 * 1024;

/// The visits that a model is fitted from.
#[derive(Clone, Copy, Debug)]
pub enum Visits<'a> {
    /// Every visit of the log.
    All,
    /// The visits whose bit is one; one bit a visit.
    Only(&'a BitRow),
}

impl Visits<'_> {
    /// Indices of the visits in order of arrival.
    fn of(self, log: &HistoryLog) -> Result<Vec<usize>> {
        match self {
            Self::All => Ok((0..log.num_visits()).collect()),
            Self::Only(mask) if mask.len() == log.num_visits() => Ok(mask.ones().collect()),
            Self::Only(mask) => Err(Error::new(
                ErrorKind::Shape,
                format!(
                    "{} bits do not select among {} visits",
                    mask.len(),
                    log.num_visits()
                ),
            )),
        }
    }
}

/// Fits the model that `cfg` names to `visits` of a place's `log`.
///
/// The same as fitting a log that has no other visits. Fails only if the selection does not have one
/// bit a visit.
pub fn fit(
    log: &HistoryLog,
    cfg: &VisibilityConfig,
    visits: Visits<'_>,
) -> Result<Box<dyn VisibilityModel>> {
    let fit = Fit {
        log,
        visits: visits.of(log)?,
        before_birth: cfg.before_birth(),
    };
    Ok(match cfg.model() {
        ModelConfig::Mean {} => Box::new(Mean::new(fit.counts().means())),
        ModelConfig::Fremen { candidates, order } => {
            let allowed = cfg.guards().map(|guards| fit.supported(candidates, guards));
            let order = match order {
                Order::Fixed(order) => *order,
                Order::HeldOut(held_out) => {
                    fit.best_order(candidates, held_out, allowed.as_deref())
                }
            };
            Box::new(fit.fremen(candidates, order, allowed.as_deref()))
        }
    })
}

/// Some visits of a log, read one way.
struct Fit<'a> {
    log: &'a HistoryLog,
    /// Ascending.
    visits: Vec<usize>,
    before_birth: BeforeBirth,
}

/// How often each feature was seen and could have been seen.
struct Counts {
    seen: Vec<u32>,
    observed: Vec<u32>,
}

impl Counts {
    fn means(&self) -> Vec<f64> {
        let counts = self.seen.iter().zip(&self.observed);
        counts
            .map(|(&seen, &observed)| match observed {
                0 => P_UNKNOWN,
                _ => f64::from(seen) / f64::from(observed),
            })
            .collect()
    }
}

impl Fit<'_> {
    /// Index into `visits` of the first at which `feature` counts.
    fn first_visit(&self, feature: usize) -> usize {
        match self.before_birth {
            BeforeBirth::NotSeen => 0,
            BeforeBirth::NotObservable => {
                let birth = self.log.birth(feature);
                self.visits.partition_point(|&visit| visit < birth)
            }
        }
    }

    fn counts(&self) -> Counts {
        let num_features = self.log.num_features();
        let mut counts = Counts {
            seen: vec![0; num_features],
            observed: (0..num_features)
                .map(|feature| (self.visits.len() - self.first_visit(feature)) as u32)
                .collect(),
        };
        for &visit in &self.visits {
            for feature in self.log.seen_row(visit).ones() {
                counts.seen[feature] += 1;
            }
            if let Some(hidden) = self.log.hidden_row(visit) {
                for feature in hidden.ones() {
                    counts.observed[feature] -= 1;
                }
            }
        }
        counts
    }

    /// Which candidates the times of the visits support.
    fn supported(&self, candidates: &CandidatePeriods, guards: Guards) -> Vec<bool> {
        let mut times: Vec<_> = self.visits.iter().map(|&v| self.log.times()[v]).collect();
        times.sort_unstable();
        let mut gaps_s: Vec<_> = times.windows(2).map(|w| w[1].since_s(w[0])).collect();
        let (Some(first), Some(last)) = (times.first(), times.last()) else {
            return vec![false; candidates.len()];
        };
        let span_s = last.since_s(*first);
        gaps_s.sort_unstable_by(f64::total_cmp);
        let median_gap_s = gaps_s.get(gaps_s.len() / 2).copied().unwrap_or(0.0);
        (0..candidates.len())
            .map(|k| {
                let period_s = candidates.period_s(k);
                guards.min_cycles() * period_s <= span_s
                    && period_s >= guards.min_gaps() * median_gap_s
            })
            .collect()
    }

    /// FreMEn of a given order, with `allowed` candidates only.
    fn fremen(
        &self,
        candidates: &CandidatePeriods,
        order: usize,
        allowed: Option<&[bool]>,
    ) -> Fremen {
        let order = order.min(candidates.len());
        let num_features = self.log.num_features();
        let counts = self.counts();
        let mut model = Fremen::of_means(candidates.clone(), order, counts.means());
        if order == 0 || self.visits.is_empty() {
            return model;
        }
        let width = 2 * candidates.len();
        let phasors = self.phasors(candidates);
        let shared = self.shared_sums(&phasors, width);
        let any_hidden = self
            .visits
            .iter()
            .any(|&v| self.log.hidden_row(v).is_some());

        let words_per_block = (BLOCK_BYTES / (8 * width * 64)).max(1);
        let block = words_per_block * 64;
        let mut sums = vec![0.0; block.min(num_features) * width];
        let mut hidden_sums = vec![0.0; if any_hidden { sums.len() } else { 0 }];
        let mut powers = vec![0.0; candidates.len()];
        let mut coefficients = vec![0.0; width];
        let mut selected = vec![0; order];
        for first in (0..num_features).step_by(block) {
            let last = (first + block).min(num_features);
            sums.fill(0.0);
            hidden_sums.fill(0.0);
            let words = first / 64..last.div_ceil(64);
            for (&visit, phasors) in self.visits.iter().zip(phasors.chunks_exact(width)) {
                let seen = self.log.seen_row(visit);
                add_where_one(seen, words.clone(), phasors, &mut sums);
                if let Some(hidden) = self.log.hidden_row(visit) {
                    add_where_one(hidden, words.clone(), phasors, &mut hidden_sums);
                }
            }
            for feature in first..last {
                let mu = model.mean[feature];
                if mu <= 0.0 || mu >= 1.0 {
                    continue; // An unchanging history has no rhythm.
                }
                let from = self.first_visit(feature);
                let row = (feature - first) * width..(feature - first + 1) * width;
                let shared = &shared[from * width..(from + 1) * width];
                let hidden = hidden_sums.get(row.clone());
                let scale = 1.0 / f64::from(counts.observed[feature]);
                for (i, (g, &s)) in coefficients.iter_mut().zip(&sums[row]).enumerate() {
                    let w = shared[i] - hidden.map_or(0.0, |h| h[i]);
                    *g = (s - mu * w) * scale;
                }
                let (cos, sin) = coefficients.split_at(candidates.len());
                for (k, power) in powers.iter_mut().enumerate() {
                    let is_allowed = allowed.is_none_or(|allowed| allowed[k]);
                    *power = if is_allowed {
                        cos[k] * cos[k] + sin[k] * sin[k]
                    } else {
                        0.0
                    };
                }
                let count = strongest(&mut powers, &mut selected);
                for (slot, &k) in selected[..count].iter().enumerate() {
                    let at = slot * num_features + feature;
                    model.candidate[at] = k;
                    model.terms[at] = (2.0 * cos[usize::from(k)], 2.0 * sin[usize::from(k)]);
                }
            }
        }
        model
    }

    /// The phasors of every visit, `2 K` values a visit.
    fn phasors(&self, candidates: &CandidatePeriods) -> Vec<f64> {
        let width = 2 * candidates.len();
        let mut phasors = vec![0.0; self.visits.len() * width];
        for (&visit, row) in self.visits.iter().zip(phasors.chunks_exact_mut(width)) {
            candidates.phasors_into(self.log.times()[visit], row);
        }
        phasors
    }

    /// Row i: `W_k` over the visits from index i on. Only row 0 if every feature counts from there.
    fn shared_sums(&self, phasors: &[f64], width: usize) -> Vec<f64> {
        let num_rows = match self.before_birth {
            BeforeBirth::NotSeen => 1,
            BeforeBirth::NotObservable => self.visits.len() + 1,
        };
        let mut shared = vec![0.0; num_rows * width];
        let mut sum = vec![0.0; width];
        for (i, phasors) in phasors.chunks_exact(width).enumerate().rev() {
            add(&mut sum, phasors);
            if let Some(row) = shared.get_mut(i * width..(i + 1) * width) {
                row.copy_from_slice(&sum);
            }
        }
        shared
    }

    /// The order with the lowest squared error on held-out visits; the lower one of equals.
    fn best_order(
        &self,
        candidates: &CandidatePeriods,
        held_out: &HeldOut,
        allowed: Option<&[bool]>,
    ) -> usize {
        if self.visits.len() < held_out.min_visits() {
            return 0;
        }
        let mut by_time = self.visits.clone();
        by_time.sort_by_key(|&visit| (self.log.times()[visit], visit));
        let count = by_time.len();
        let parts: Vec<_> = match held_out.split() {
            Split::LastVisits(last) => vec![(count.saturating_sub(last), count)],
            Split::Folds(folds) => {
                let folds = folds.min(count / 2);
                (0..folds)
                    .map(|i| (count * i / folds, count * (i + 1) / folds))
                    .collect()
            }
        };
        let mut errors = vec![0.0; held_out.max_order().min(candidates.len()) + 1];
        for (start, end) in parts {
            let tested = &by_time[start..end];
            let mut learnt = [&by_time[..start], &by_time[end..]].concat();
            if learnt.is_empty() {
                return 0;
            }
            learnt.sort_unstable();
            let fit = Fit {
                visits: learnt,
                ..*self
            };
            let model = fit.fremen(candidates, errors.len() - 1, allowed);
            for &visit in tested {
                self.add_squared_errors(&model, visit, &mut errors);
            }
        }
        let mut best = 0;
        for order in 1..errors.len() {
            if errors[order] < errors[best] {
                best = order;
            }
        }
        best
    }

    /// Adds the squared errors of orders 0, 1, ... at one visit.
    fn add_squared_errors(&self, model: &Fremen, visit: usize, errors: &mut [f64]) {
        let seen = self.log.seen_row(visit);
        let hidden = self.log.hidden_row(visit);
        let num_features = match self.before_birth {
            BeforeBirth::NotSeen => model.mean.len(),
            BeforeBirth::NotObservable => seen.len(),
        };
        model.with_phasors(self.log.times()[visit], |cos, sin| {
            for feature in 0..num_features {
                if hidden.is_some_and(|row| row.get(feature)) {
                    continue;
                }
                let state = f64::from(u8::from(seen.get(feature)));
                let mut p = model.mean[feature];
                for (order, error) in errors.iter_mut().enumerate() {
                    if order > 0 {
                        let slot = (order - 1) * model.mean.len() + feature;
                        let k = usize::from(model.candidate[slot]);
                        let (re, im) = model.terms[slot];
                        p += re * cos[k] + im * sin[k];
                    }
                    *error += (p.clamp(0.0, 1.0) - state).powi(2);
                }
            }
        });
    }
}

/// Adds `phasors` to the row of `sums` of every one bit in `words`; row 0 belongs to the first bit.
fn add_where_one(row: &BitRow, words: std::ops::Range<usize>, phasors: &[f64], sums: &mut [f64]) {
    let end = words.end.min(row.words().len());
    let words = row.words().get(words.start..end).unwrap_or_default();
    for (w, &word) in words.iter().enumerate() {
        let mut rest = word;
        while rest != 0 {
            let feature = w * 64 + rest.trailing_zeros() as usize;
            rest &= rest - 1;
            add(
                &mut sums[feature * phasors.len()..][..phasors.len()],
                phasors,
            );
        }
    }
}

fn add(sums: &mut [f64], terms: &[f64]) {
    for (sum, term) in sums.iter_mut().zip(terms) {
        *sum += term;
    }
}
