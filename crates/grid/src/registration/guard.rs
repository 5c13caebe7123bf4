//! Is a new map believed?
//!
//! Mapping may fail, and one wrong map can destroy a grid for good (IROS 2016, sections III-C and
//! V-C). Nothing is known beforehand of how much changes in a building from patrol to patrol, so the
//! limit follows from the grid's own past: the median of past disagreements and k of their
//! median absolute deviations (MAD).

use fremen::{Result, Time};

use crate::cells::OccupancyMap;
use crate::localize::DistanceField;
use crate::pose::Pose2;
use crate::registration::align::{Registration, Search, register};
use crate::registration::compare::{Comparison, compare};
use crate::registration::resample::resampled;

/// How a [`Guard`] judges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GuardConfig {
    /// How many MADs above the median a map is still usual.
    pub k: f64,
    /// How many maps are integrated before any is judged: nothing is known of what is usual yet, so
    /// somebody should have a look at these.
    pub num_trusted: usize,
    /// How many of the last maps are the past.
    pub num_past: usize,
    /// How often a quarantined map must have come, one after another, to be a rearrangement.
    pub num_repeats: usize,
    /// How many quarantined maps are kept; the oldest are forgotten.
    pub num_kept: usize,
    /// Which motions are tried to lay a map onto the predicted one.
    pub search: Search,
}

impl Default for GuardConfig {
    fn default() -> Self {
        Self {
            k: 10.0,
            num_trusted: 10,
            num_past: 50,
            num_repeats: 3,
            num_kept: 20,
            search: Search::default(),
        }
    }
}

/// Why a map is not believed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reason {
    /// Too much contradicts the prediction.
    Contradiction,
    /// It has to be moved further than maps usually have to.
    Shift,
    /// It has no surface, or cannot be compared.
    Nothing,
}

/// What was found of one map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Judgement {
    /// When the map was made.
    pub time: Time,
    /// How it lies on the prediction; none where that has no surfaces yet.
    pub registration: Option<Registration>,
    /// Share of wrongly predicted cells, after it was moved.
    pub disagreement: f64,
    /// The largest share that is usual; infinite as long as maps are trusted.
    pub limit: f64,
    /// The largest shift that is usual; infinite likewise.
    pub shift_limit_m: f64,
    /// Why it is not believed; none where it is.
    pub reason: Option<Reason>,
}

/// A map that is not believed.
#[derive(Clone, Debug)]
pub struct Quarantined {
    /// The map, laid onto the prediction of its time.
    pub map: OccupancyMap,
    /// What was found.
    pub judgement: Judgement,
    comparison: Comparison,
}

/// What is to be done with a map.
#[derive(Clone, Debug)]
pub enum Decision {
    /// Observe this map, which was laid onto the prediction.
    Integrate(OccupancyMap, Judgement),
    /// Leave the grid as it is; the guard keeps the map.
    Quarantine(Judgement),
    /// The same change has come again: observe these maps at their times, oldest first.
    Adopt(Vec<(Time, OccupancyMap)>, Judgement),
}

impl Decision {
    /// What was found of the map.
    pub const fn judgement(&self) -> &Judgement {
        match self {
            Self::Integrate(_, judgement)
            | Self::Quarantine(judgement)
            | Self::Adopt(_, judgement) => judgement,
        }
    }
}

/// Judges maps one after another.
#[derive(Clone, Debug)]
pub struct Guard {
    config: GuardConfig,
    /// Of believed maps, oldest first.
    disagreements: Vec<f64>,
    shifts_m: Vec<f64>,
    quarantined: Vec<Quarantined>,
    /// How many of the last maps were quarantined one after another.
    num_in_row: usize,
}

impl Guard {
    /// A guard that has seen nothing yet.
    pub const fn new(config: GuardConfig) -> Self {
        Self {
            config,
            disagreements: Vec::new(),
            shifts_m: Vec::new(),
            quarantined: Vec::new(),
            num_in_row: 0,
        }
    }

    /// Maps that are not believed, oldest first.
    pub fn quarantined(&self) -> &[Quarantined] {
        &self.quarantined
    }

    /// Gives a quarantined map to somebody who believes it.
    pub fn accept(&mut self, time: Time) -> Option<OccupancyMap> {
        let at = self
            .quarantined
            .iter()
            .position(|held| held.judgement.time == time)?;
        let held = self.quarantined.remove(at);
        self.remember(&held.judgement);
        Some(held.map)
    }

    /// Forgets a quarantined map; false where there is none of that time.
    pub fn discard(&mut self, time: Time) -> bool {
        let before = self.quarantined.len();
        self.quarantined.retain(|held| held.judgement.time != time);
        self.quarantined.len() < before
    }

    /// Judges a map against the prediction of its time.
    ///
    /// # Errors
    /// Never by what the maps hold; as [`register`] where the search is none.
    pub fn judge(
        &mut self,
        predicted: &OccupancyMap,
        observed: &OccupancyMap,
        time: Time,
    ) -> Result<Decision> {
        let registration = register(predicted, observed, &self.config.search).ok();
        let motion = registration.map_or_else(Pose2::default, |found| {
            // What moves no cell to another one leaves the map as it is.
            let is_small = found.shift_m < 0.5 * predicted.spec().resolution_m();
            if is_small {
                Pose2::default()
            } else {
                found.motion
            }
        });
        let map = resampled(observed, &motion, *predicted.spec());
        let comparison = compare(predicted, &map, self.config.search.thresholds);
        let judgement = self.weigh(
            registration,
            &comparison,
            predicted.spec().resolution_m(),
            time,
        );
        if judgement.reason.is_none() {
            self.remember(&judgement);
            // What agrees with the prediction speaks against a rearrangement.
            self.num_in_row = 0;
            return Ok(Decision::Integrate(map, judgement));
        }
        self.quarantined.push(Quarantined {
            map,
            judgement,
            comparison,
        });
        self.num_in_row += 1;
        if self.quarantined.len() > self.config.num_kept.max(self.config.num_repeats) {
            self.quarantined.remove(0);
        }
        Ok(self
            .adopt(judgement)
            .unwrap_or(Decision::Quarantine(judgement)))
    }

    fn weigh(
        &self,
        registration: Option<Registration>,
        comparison: &Comparison,
        cell_m: f64,
        time: Time,
    ) -> Judgement {
        let is_trusted = self.disagreements.len() < self.config.num_trusted;
        let mut judgement = Judgement {
            time,
            registration,
            disagreement: comparison.disagreement,
            limit: f64::INFINITY,
            shift_limit_m: f64::INFINITY,
            reason: None,
        };
        if is_trusted {
            return judgement;
        }
        // One cell among those that are compared is the smallest difference there is.
        let one = 1.0 / comparison.num_compared.max(1) as f64;
        judgement.limit = limit(&self.disagreements, self.config.k, one);
        judgement.shift_limit_m = limit(&self.shifts_m, self.config.k, SMALLEST_CELLS * cell_m);
        judgement.reason = match registration {
            None => Some(Reason::Nothing),
            _ if comparison.num_compared == 0 => Some(Reason::Nothing),
            _ if comparison.disagreement > judgement.limit => Some(Reason::Contradiction),
            Some(found) if found.shift_m > judgement.shift_limit_m => Some(Reason::Shift),
            Some(_) => None,
        };
        judgement
    }

    fn remember(&mut self, judgement: &Judgement) {
        for (past, value) in [
            (&mut self.disagreements, Some(judgement.disagreement)),
            (
                &mut self.shifts_m,
                judgement.registration.map(|found| found.shift_m),
            ),
        ] {
            past.extend(value);
            if past.len() > self.config.num_past {
                past.remove(0);
            }
        }
    }

    /// Whether the newest quarantined map shows the same change as enough of those right before it.
    fn adopt(&mut self, judgement: Judgement) -> Option<Decision> {
        let first = self.quarantined.len().saturating_sub(self.num_in_row);
        let row = &self.quarantined[first..];
        let newest = row.last()?;
        let again: Vec<Time> = (row.iter())
            .filter(|held| is_same_change(newest, held))
            .map(|held| held.judgement.time)
            .collect();
        if again.len() < self.config.num_repeats.max(2) {
            return None;
        }
        let mut adopted = Vec::new();
        self.quarantined.retain(|held| {
            let is_adopted = again.contains(&held.judgement.time);
            if is_adopted {
                adopted.push((held.judgement.time, held.map.clone()));
            }
            !is_adopted
        });
        self.num_in_row = 0;
        Some(Decision::Adopt(adopted, judgement))
    }
}

/// Shifts are told from each other from this part of a cell on.
const SMALLEST_CELLS: f64 = 0.25;
/// A surface in the next cell, straight or diagonal, is the same surface.
const SAME_CELLS: f64 = 1.5;

/// The median of `past` and k median absolute deviations, each at least `smallest`.
fn limit(past: &[f64], k: f64, smallest: f64) -> f64 {
    let median = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(0.0)
    };
    let middle = median(past.to_vec());
    let deviation = median(past.iter().map(|value| (value - middle).abs()).collect());
    middle + k * deviation.max(smallest)
}

/// Whether two maps contradict their predictions by the same surfaces, most of them.
///
/// A failure of mapping is not repeated by chance: its wrong surfaces lie elsewhere the next time.
fn is_same_change(a: &Quarantined, b: &Quarantined) -> bool {
    if a.map.spec() != b.map.spec() {
        return false;
    }
    let spec = *a.map.spec();
    let same_m = SAME_CELLS * spec.resolution_m();
    let (mut num_same, mut num_all) = (0_usize, 0_usize);
    for (from, to) in [(a, b), (b, a)] {
        for (mine, theirs) in [
            (&from.comparison.appeared, &to.comparison.appeared),
            (&from.comparison.vanished, &to.comparison.vanished),
        ] {
            let mut is_theirs = vec![false; spec.num_cells()];
            for &index in theirs {
                is_theirs[index] = true;
            }
            let field = DistanceField::to_cells(spec, 2.0 * same_m, |index| is_theirs[index]);
            for &index in mine {
                // What the other one did not see says nothing.
                if to.map.get(index).is_some() {
                    num_all += 1;
                    num_same += usize::from(field.of_cell(index) < same_m);
                }
            }
        }
    }
    2 * num_same > num_all
}
