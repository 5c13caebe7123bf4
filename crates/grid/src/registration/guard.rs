//! Is a new map believed?
//!
//! Mapping may fail, and one wrong map can destroy a grid for good (IROS 2016, sections III-C and
//! V-C). Nothing is known beforehand of how much changes in a building from patrol to patrol, so the
//! limit follows from the grid's own past and from the prediction itself:
//!
//! `limit = median(D_h) + k max(MAD(D_h), E)`
//!
//! `D_h` are the disagreements of believed maps at similar hours of the day: a night in which nothing
//! moves says nothing of what is usual at noon. E is the disagreement that the predicted map expects
//! of itself ([`Comparison::expected`]): where many cells are uncertain, much may be otherwise, and
//! a single door that was forgotten open in a quiet night is no failure of mapping. Shifts are judged
//! by the median and the median absolute deviation (MAD) of all hours, as they depend on none.

use fremen::{Period, Result, Time};

use crate::cells::OccupancyMap;
use crate::localize::DistanceField;
use crate::pose::Pose2;
use crate::registration::align::{Registration, Search, register};
use crate::registration::compare::{Comparison, compare};
use crate::registration::resample::resampled;

/// How a [`Guard`] judges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GuardConfig {
    /// How many deviations above the median of similar hours a disagreement is still usual.
    pub k: f64,
    /// How many MADs above the median a shift is still usual.
    pub k_shift: f64,
    /// How many maps of similar hours are compared with.
    pub num_similar: usize,
    /// How many maps are integrated before any is judged: nothing is known of what is usual yet, so
    /// somebody should have a look at these. They should come from all hours of a few days: what is
    /// usual at night is too little by day.
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
            k: 3.0,
            k_shift: 7.0,
            num_similar: 16,
            num_trusted: 24,
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

impl Reason {
    /// `contradiction`, `shift` or `nothing`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Contradiction => "contradiction",
            Self::Shift => "shift",
            Self::Nothing => "nothing",
        }
    }
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
    /// The share that the prediction itself expects to be wrong.
    pub expected: f64,
    /// The largest share that is usual; infinite as long as maps are trusted.
    pub limit: f64,
    /// The largest shift that is usual; infinite likewise.
    pub shift_limit_m: f64,
    /// Why it is not believed; none where it is.
    pub reason: Option<Reason>,
}

impl Judgement {
    /// Why the map is not believed, with the numbers, or that it is.
    pub fn why(&self) -> String {
        let shift_m = self.registration.map_or(0.0, |it| it.shift_m);
        match self.reason {
            Some(Reason::Contradiction) => format!(
                "{:.1} % of its surfaces contradict the prediction, up to {:.1} % are usual",
                100.0 * self.disagreement,
                100.0 * self.limit
            ),
            Some(Reason::Shift) => format!(
                "it would have to be moved by {shift_m:.2} m, up to {:.2} m are usual",
                self.shift_limit_m
            ),
            Some(Reason::Nothing) => "nothing of it can be compared with the prediction".to_owned(),
            None => "it is believed".to_owned(),
        }
    }

    /// Whether the map was moved on a grid with such cells: less than half a cell leaves it as it is.
    pub fn is_moved(&self, cell_m: f64) -> bool {
        self.registration
            .is_some_and(|found| found.shift_m >= 0.5 * cell_m)
    }
}

/// A map that is not believed.
#[derive(Clone, Debug)]
pub struct Quarantined {
    /// The map, laid onto the prediction of its time.
    pub map: OccupancyMap,
    /// What was found.
    pub judgement: Judgement,
    /// Who made it.
    pub observer: String,
    /// Surfaces that contradict the prediction: new ones, and lost ones.
    pub contradictions: [Vec<usize>; 2],
}

/// What is remembered of a believed map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Believed {
    /// When it was made.
    pub time: Time,
    /// Its share of wrongly predicted cells.
    pub disagreement: f64,
    /// How far it had to be moved; none where nothing was predicted yet.
    pub shift_m: Option<f64>,
}

/// What is to be done with a map.
#[derive(Clone, Debug)]
pub enum Decision {
    /// Observe this map, which was laid onto the prediction.
    Integrate(OccupancyMap, Judgement),
    /// Leave the grid as it is; the guard keeps the map.
    Quarantine(Judgement),
    /// The same change has come again: observe these maps at their times, oldest first.
    Adopt(Vec<Quarantined>, Judgement),
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
    /// Oldest first.
    past: Vec<Believed>,
    quarantined: Vec<Quarantined>,
    /// How many of the last maps were quarantined one after another.
    num_in_row: usize,
    num_dropped: usize,
}

impl Guard {
    /// A guard that has seen nothing yet.
    pub const fn new(config: GuardConfig) -> Self {
        Self::resume(config, Vec::new(), Vec::new(), 0)
    }

    /// A guard that goes on where another one ended, by what that one gave of itself.
    pub const fn resume(
        config: GuardConfig,
        past: Vec<Believed>,
        quarantined: Vec<Quarantined>,
        num_in_row: usize,
    ) -> Self {
        Self {
            config,
            past,
            quarantined,
            num_in_row,
            num_dropped: 0,
        }
    }

    /// What it remembers of believed maps, oldest first.
    pub fn past(&self) -> &[Believed] {
        &self.past
    }

    /// Maps that are not believed, oldest first.
    pub fn quarantined(&self) -> &[Quarantined] {
        &self.quarantined
    }

    /// How many of the last maps were quarantined one after another.
    pub const fn num_in_row(&self) -> usize {
        self.num_in_row
    }

    /// How many quarantined maps were dropped for want of room since it was made.
    pub const fn num_dropped(&self) -> usize {
        self.num_dropped
    }

    /// Gives a quarantined map to somebody who believes it.
    pub fn accept(&mut self, observer: &str, time: Time) -> Option<Quarantined> {
        let held = self.discard(observer, time)?;
        self.remember(&held.judgement);
        Some(held)
    }

    /// Forgets a quarantined map; none where there is none of that time.
    pub fn discard(&mut self, observer: &str, time: Time) -> Option<Quarantined> {
        let is_meant =
            |held: &Quarantined| held.judgement.time == time && held.observer == observer;
        let at = self.quarantined.iter().position(is_meant)?;
        if at + self.num_in_row >= self.quarantined.len() {
            self.num_in_row -= 1;
        }
        Some(self.quarantined.remove(at))
    }

    /// Judges a map, which `observer` has made, against the prediction of its time.
    ///
    /// # Errors
    /// Never by what the maps hold; as [`register`] where the search is none.
    pub fn judge(
        &mut self,
        observer: &str,
        predicted: &OccupancyMap,
        observed: &OccupancyMap,
        time: Time,
    ) -> Result<Decision> {
        let (map, judgement, comparison) = self.look(predicted, observed, time);
        if judgement.reason.is_none() {
            self.remember(&judgement);
            // What agrees with the prediction speaks against a rearrangement.
            self.num_in_row = 0;
            return Ok(Decision::Integrate(map, judgement));
        }
        self.quarantined.push(Quarantined {
            map,
            judgement,
            observer: observer.to_owned(),
            contradictions: [comparison.appeared, comparison.vanished],
        });
        self.num_in_row += 1;
        if self.quarantined.len() > self.config.num_kept.max(self.config.num_repeats) {
            self.quarantined.remove(0);
            self.num_dropped += 1;
        }
        Ok(self
            .adopt(judgement)
            .unwrap_or(Decision::Quarantine(judgement)))
    }

    /// Remembers a map that somebody else believes, and gives it as it lies on the prediction.
    pub fn trust(
        &mut self,
        predicted: &OccupancyMap,
        observed: &OccupancyMap,
        time: Time,
    ) -> (OccupancyMap, Judgement) {
        let (map, mut judgement, _) = self.look(predicted, observed, time);
        judgement.reason = None;
        self.remember(&judgement);
        (map, judgement)
    }

    fn look(
        &self,
        predicted: &OccupancyMap,
        observed: &OccupancyMap,
        time: Time,
    ) -> (OccupancyMap, Judgement, Comparison) {
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
        (map, judgement, comparison)
    }

    fn weigh(
        &self,
        registration: Option<Registration>,
        comparison: &Comparison,
        cell_m: f64,
        time: Time,
    ) -> Judgement {
        let mut judgement = Judgement {
            time,
            registration,
            disagreement: comparison.disagreement,
            expected: comparison.expected,
            limit: f64::INFINITY,
            shift_limit_m: f64::INFINITY,
            reason: None,
        };
        if self.past.len() < self.config.num_trusted {
            return judgement;
        }
        // One cell among those that are compared is the smallest difference there is.
        let one = 1.0 / comparison.num_compared.max(1) as f64;
        let least = comparison.expected.max(one);
        judgement.limit = limit(&self.similar(time), self.config.k, least);
        let shifts: Vec<f64> = self.past.iter().filter_map(|it| it.shift_m).collect();
        judgement.shift_limit_m = limit(&shifts, self.config.k_shift, SMALLEST_CELLS * cell_m);
        judgement.reason = match registration {
            None => Some(Reason::Nothing),
            _ if comparison.num_compared == 0 => Some(Reason::Nothing),
            _ if comparison.disagreement > judgement.limit => Some(Reason::Contradiction),
            Some(found) if found.shift_m > judgement.shift_limit_m => Some(Reason::Shift),
            Some(_) => None,
        };
        judgement
    }

    /// The disagreements of maps that were made at similar hours; of equally similar ones the newer.
    fn similar(&self, time: Time) -> Vec<f64> {
        let day = Period::DAY.as_us();
        let apart = |other: &Believed| {
            let apart = (other.time.as_us().wrapping_sub(time.as_us())).rem_euclid(day);
            apart.min(day - apart)
        };
        let mut similar: Vec<&Believed> = self.past.iter().rev().collect();
        similar.sort_by_key(|it| apart(it));
        let nearest = similar.iter().take(self.config.num_similar.max(1));
        nearest.map(|it| it.disagreement).collect()
    }

    fn remember(&mut self, judgement: &Judgement) {
        self.past.push(Believed {
            time: judgement.time,
            disagreement: judgement.disagreement,
            shift_m: judgement.registration.map(|found| found.shift_m),
        });
        if self.past.len() > self.config.num_past {
            self.past.remove(0);
        }
    }

    /// Whether the newest quarantined map shows the same change as enough of those right before it.
    fn adopt(&mut self, judgement: Judgement) -> Option<Decision> {
        let first = self.quarantined.len().saturating_sub(self.num_in_row);
        let row = &self.quarantined[first..];
        let newest = row.last()?;
        let is_again: Vec<bool> = row
            .iter()
            .map(|held| is_same_change(newest, held))
            .collect();
        if is_again.iter().filter(|it| **it).count() < self.config.num_repeats.max(2) {
            return None;
        }
        let mut adopted = Vec::new();
        let row = self.quarantined.split_off(first);
        for (held, is_again) in row.into_iter().zip(is_again) {
            if is_again {
                adopted.push(held);
            } else {
                self.quarantined.push(held);
            }
        }
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
            (&from.contradictions[0], &to.contradictions[0]),
            (&from.contradictions[1], &to.contradictions[1]),
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
