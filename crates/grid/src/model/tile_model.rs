//! What is p(t) of the cells of a tile?

use fremen::{CandidatePeriods, Period, Time};

use super::columns::{bin, bin_of_phase, phase};
use super::config::{CellModel, GridConfig, Persistence};
use crate::cells::CellState;

/// A rhythm of a cell: the factors of `cos(w_k t)` and `sin(w_k t)`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Term {
    pub(crate) cos: f32,
    pub(crate) sin: f32,
    pub(crate) k: u16,
}

/// What one cell's prediction is made of.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct CellRecord {
    pub(crate) at: u16,
    pub(crate) mean: f32,
    /// 1 / tau in 1/s.
    pub(crate) rate: f32,
    /// By how much the cell was last seen before its tile was, in seconds.
    pub(crate) age_s: f32,
    /// Whether it was occupied then.
    pub(crate) is_occupied: bool,
    /// Where surprises persist: its state then (0 or 1) less f(t) then.
    pub(crate) surprise: f32,
    /// Strongest first.
    pub(crate) terms: Vec<Term>,
    pub(crate) bins: Vec<f32>,
}

/// The cells of a tile whose prediction is not the state of the last visit.
///
/// Columns instead of records, so that all cells are predicted in a few passes without branches.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct TileModel {
    /// When the tile was last visited.
    last: Option<Time>,
    /// Cells of one known state, which the last visit did not see, and whether it is occupied.
    constants: Vec<(u16, bool)>,
    cells: Vec<u16>,
    mean: Vec<f32>,
    rate: Vec<f32>,
    age_s: Vec<f32>,
    occupied: Vec<f32>,
    /// Empty where surprises do not persist.
    surprise: Vec<f32>,
    /// The strongest rhythm of all cells, then the second of all, ...
    terms: Vec<Term>,
    /// The bins of one cell after another.
    bins: Vec<f32>,
}

/// What all cells share at the time of a prediction.
#[derive(Clone, Debug)]
pub(crate) struct Moment {
    pub(crate) time: Time,
    /// `[cos(w_k t), sin(w_k t)]` of each candidate.
    phasors: Vec<[f32; 2]>,
    /// The bin of the time, and how many there are.
    bin: Option<(usize, usize)>,
    /// The same of each candidate.
    folded: Option<(Vec<usize>, usize)>,
    persistence: Persistence,
    share: f32,
    only_last: bool,
}

impl CellRecord {
    /// f(t) in [0, 1]: the same as [`TileModel::periodic`] of one cell.
    pub(crate) fn periodic(&self, moment: &Moment) -> f32 {
        if let Some((bin, _)) = moment.bin {
            return self.bins.get(bin).copied().unwrap_or(self.mean);
        }
        if let Some((bins, _)) = &moment.folded {
            let k = self.terms.first().map_or(0, |term| usize::from(term.k));
            return self.bins.get(bins[k]).copied().unwrap_or(self.mean);
        }
        let mut p = self.mean;
        for term in &self.terms {
            let [cos, sin] = moment.phasors[usize::from(term.k)];
            p += term.cos * cos + term.sin * sin;
        }
        p.clamp(0.0, 1.0)
    }
}

impl Moment {
    pub(crate) fn new(config: &GridConfig, time: Time) -> Self {
        let mut moment = Self {
            time,
            phasors: Vec::new(),
            bin: None,
            folded: None,
            persistence: config.persistence(),
            share: config.persistence_share(),
            only_last: matches!(config.model(), CellModel::LastObservation),
        };
        match config.model() {
            CellModel::Fremen { candidates, .. } => moment.phasors = phasors(candidates, time),
            CellModel::Histogram { period, num_bins } => {
                moment.bin = Some((bin_of(time, *period, *num_bins), *num_bins));
            }
            CellModel::Folded {
                candidates,
                num_bins,
            } => {
                let bins = (0..candidates.len())
                    .map(|k| bin_of_phase(phase(candidates, k, time), *num_bins));
                moment.folded = Some((bins.collect(), *num_bins));
            }
            CellModel::Mean | CellModel::LastObservation => {}
        }
        moment
    }
}

fn bin_of(time: Time, period: Period, num_bins: usize) -> usize {
    bin(time, period, num_bins)
}

fn phasors(candidates: &CandidatePeriods, time: Time) -> Vec<[f32; 2]> {
    let count = candidates.len();
    let mut columns = vec![0.0; 2 * count];
    candidates.phasors_into(time, &mut columns);
    (0..count)
        .map(|k| [columns[k] as f32, columns[count + k] as f32])
        .collect()
}

impl TileModel {
    pub(crate) fn new(
        last: Option<Time>,
        constants: Vec<(u16, bool)>,
        records: &[CellRecord],
    ) -> Self {
        let order = records.iter().map(|it| it.terms.len()).max().unwrap_or(0);
        let term = |o: usize, it: &CellRecord| it.terms.get(o).copied().unwrap_or_default();
        Self {
            last,
            constants,
            cells: records.iter().map(|it| it.at).collect(),
            mean: records.iter().map(|it| it.mean).collect(),
            rate: records.iter().map(|it| it.rate).collect(),
            age_s: records.iter().map(|it| it.age_s).collect(),
            occupied: records
                .iter()
                .map(|it| f32::from(u8::from(it.is_occupied)))
                .collect(),
            surprise: if records.iter().any(|it| it.surprise != 0.0) {
                records.iter().map(|it| it.surprise).collect()
            } else {
                Vec::new()
            },
            terms: (0..order)
                .flat_map(|o| records.iter().map(move |it| term(o, it)))
                .collect(),
            bins: records
                .iter()
                .flat_map(|it| it.bins.iter().copied())
                .collect(),
        }
    }

    /// The known state of a cell of one state, which the last visit did not see.
    pub(crate) fn constant(&self, at: usize) -> Option<CellState> {
        let found = self.constants.iter().find(|it| usize::from(it.0) == at)?;
        Some(if found.1 {
            CellState::Occupied
        } else {
            CellState::Free
        })
    }

    /// What the cells that vary are predicted by.
    pub(crate) fn records(&self) -> Vec<CellRecord> {
        let num_bins = self.bins.len() / self.cells.len().max(1);
        let record = |i: usize| CellRecord {
            at: self.cells[i],
            mean: self.mean[i],
            rate: self.rate[i],
            age_s: self.age_s[i],
            is_occupied: self.occupied[i] > 0.5,
            surprise: self.surprise.get(i).copied().unwrap_or(0.0),
            terms: self.terms(self.cells[i].into()),
            bins: self.bins[i * num_bins..(i + 1) * num_bins].to_vec(),
        };
        (0..self.cells.len()).map(record).collect()
    }

    /// Cells that were seen free and occupied.
    pub(crate) const fn num_varying(&self) -> usize {
        self.cells.len()
    }

    /// The rhythms of a cell, strongest first.
    pub(crate) fn terms(&self, at: usize) -> Vec<Term> {
        let num = self.cells.len();
        let Ok(i) = self.cells.binary_search(&(at as u16)) else {
            return Vec::new();
        };
        let terms = self.terms.iter().skip(i).step_by(num.max(1));
        terms
            .copied()
            .filter(|it| it.cos != 0.0 || it.sin != 0.0)
            .collect()
    }

    /// The model's probability for a cell; none where the state of the last visit holds.
    pub(crate) fn p(&self, at: usize, moment: &Moment) -> Option<f32> {
        let at = at as u16;
        if let Some((_, is_occupied)) = self.constants.iter().find(|it| it.0 == at) {
            return Some(f32::from(u8::from(*is_occupied)));
        }
        let i = self.cells.binary_search(&at).ok()?;
        let mut all = Vec::new();
        self.evaluate(moment, &mut all);
        all.get(i).copied()
    }

    /// The periodic part of a cell's prediction, and the weight of the last observation.
    pub(crate) fn parts(&self, at: usize, moment: &Moment) -> Option<(f32, f32)> {
        let i = self.cells.binary_search(&(at as u16)).ok()?;
        let mut all = Vec::new();
        self.periodic(moment, &mut all);
        let weight = if moment.only_last {
            1.0
        } else if moment.persistence != Persistence::None {
            moment.share * exp_of_negative(self.age_s[i] + self.elapsed_s(moment), self.rate[i])
        } else {
            0.0
        };
        Some((all[i], weight))
    }

    /// Writes the predictions of those cells for which they are not the state of the last visit.
    pub(crate) fn write(&self, moment: &Moment, scratch: &mut Vec<f32>, cells: &mut [f32]) {
        for &(at, is_occupied) in &self.constants {
            cells[usize::from(at)] = f32::from(u8::from(is_occupied));
        }
        self.evaluate(moment, scratch);
        for (&at, &p) in self.cells.iter().zip(&*scratch) {
            cells[usize::from(at)] = p;
        }
    }

    fn elapsed_s(&self, moment: &Moment) -> f32 {
        self.last
            .map_or(0.0, |last| moment.time.since_s(last) as f32)
    }

    /// `p(t) = s e^(-abs(t - t_l) / tau) + f(t) (1 - e^(-abs(t - t_l) / tau))`, IROS 2016 eq. 2, or
    /// what [`Persistence::Surprise`] says; the distance in time counts on both sides, so that the
    /// past can be predicted, too.
    fn evaluate(&self, moment: &Moment, out: &mut Vec<f32>) {
        if moment.only_last {
            out.clear();
            out.extend_from_slice(&self.occupied);
            return;
        }
        self.periodic(moment, out);
        let elapsed_s = self.elapsed_s(moment);
        match moment.persistence {
            Persistence::None => return,
            Persistence::Surprise => {
                let cells = out.iter_mut().zip(&self.rate).zip(&self.age_s);
                for (((p, &rate), &age_s), &surprise) in cells.zip(&self.surprise) {
                    let weight = moment.share * exp_of_negative(elapsed_s + age_s, rate);
                    *p = (*p + surprise * weight).clamp(0.0, 1.0);
                }
                return;
            }
            Persistence::State => {}
        }
        let cells = out
            .iter_mut()
            .zip(&self.rate)
            .zip(&self.age_s)
            .zip(&self.occupied);
        for (((p, &rate), &age_s), &occupied) in cells {
            let weight = moment.share * exp_of_negative(elapsed_s + age_s, rate);
            *p += (occupied - *p) * weight;
        }
    }

    /// The cells that were seen free and occupied, ascending.
    pub(crate) fn cells(&self) -> impl Iterator<Item = usize> + '_ {
        self.cells.iter().map(|&at| at.into())
    }

    /// Their means.
    pub(crate) fn means(&self) -> impl Iterator<Item = f32> + '_ {
        self.mean.iter().copied()
    }

    /// f(t) in [0, 1] of these cells.
    pub(crate) fn periodic(&self, moment: &Moment, out: &mut Vec<f32>) {
        out.clear();
        if let Some((bin, num_bins)) = moment.bin {
            out.extend(self.bins.iter().skip(bin).step_by(num_bins));
            return;
        }
        if let Some((bins, num_bins)) = &moment.folded {
            let cells = self.bins.chunks_exact(*num_bins).enumerate();
            out.extend(cells.map(|(cell, of_cell)| {
                let k = self.terms.get(cell).map_or(0, |term| usize::from(term.k));
                of_cell[bins[k]]
            }));
            return;
        }
        out.extend_from_slice(&self.mean);
        if self.cells.is_empty() {
            return;
        }
        for terms in self.terms.chunks_exact(self.cells.len()) {
            for (p, term) in out.iter_mut().zip(terms) {
                let [cos, sin] = moment.phasors[usize::from(term.k)];
                *p += term.cos * cos + term.sin * sin;
            }
        }
        for p in out {
            *p = p.clamp(0.0, 1.0);
        }
    }

    pub(crate) fn heap_bytes(&self) -> usize {
        self.constants.capacity() * size_of::<(u16, bool)>()
            + self.cells.capacity() * 2
            + (self.mean.capacity()
                + self.rate.capacity()
                + self.age_s.capacity()
                + self.occupied.capacity()
                + self.surprise.capacity()
                + self.bins.capacity())
                * 4
            + self.terms.capacity() * size_of::<Term>()
    }
}

/// `e^(-abs(elapsed) rate)`, within 1e-6, by additions and products alone: every machine gets the
/// same bits, and the loop over cells has no branch.
#[inline]
fn exp_of_negative(elapsed_s: f32, rate: f32) -> f32 {
    // Adding 1.5 * 2^23 rounds to the nearest integer.
    const MAGIC: f32 = 12_582_912.0;
    // 2^-125 is as good as 0. The order of `max` makes NaN (0 * inf) that, too.
    let exponent = (-(elapsed_s.abs() * rate) * std::f32::consts::LOG2_E).max(-125.0);
    let whole = (exponent + MAGIC) - MAGIC;
    let x = exponent - whole;
    let fraction = 1.0
        + x * (std::f32::consts::LN_2
            + x * (0.240_226_5
                + x * (0.055_504_1
                    + x * (0.009_618_13 + x * (0.001_333_355_8 + x * 0.000_154_035_3)))));
    f32::from_bits(((whole as i32 + 127) as u32) << 23) * fraction
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponential_is_one() {
        for i in 0..20_000 {
            let x = f64::from(i) * 0.004;
            let found = exp_of_negative(x as f32, 1.0);
            assert!(
                (f64::from(found) - (-x).exp()).abs() < 1e-6,
                "e^-{x} = {found}"
            );
        }
        assert_eq!(exp_of_negative(0.0, 7.0), 1.0);
        assert!(exp_of_negative(f32::INFINITY, 1.0) < 1e-30);
        assert!(exp_of_negative(1e30, 1e30) < 1e-30);
        assert_eq!(exp_of_negative(-3.0, 0.5), exp_of_negative(3.0, 0.5));
    }
}
