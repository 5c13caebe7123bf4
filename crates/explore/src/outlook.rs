//! What will be known of each place in each slot, and what would a look add to that?
//!
//! Not the uncertainty of the moment counts (a coin that is tossed has one bit at every look and
//! teaches nothing), but what a look leaves behind:
//!
//! - *of the states*: with `kept(a)` the share of a surprise that is still there after a time a, a
//!   look at time s takes `p(s) (1 - p(s)) kept(t - s)^2` off the expected squared error of each
//!   state at every later time t (law of total variance). Summed over the slots until the next
//!   look, and at most a day;
//! - *of the model*: one look at a state whose p rests on n independent looks takes
//!   `p (1 - p) / ((n + 1) (n + 2))` off the variance of p (that of a beta distribution), which counts
//!   in the slots of about this hour on each of the coming days.
//!
//! Neither the share that is kept nor the looks that p rests on are taken for known: the expectation
//! of `kept^2` has the variance of what was measured in it, and p has half a look at each value
//! added. A place is so given up only when enough was seen of it, however its first looks were.
//!
//! `4 p (1 - p)` stands for the uncertainty of a state: 0 to 1 as bits are, and what the squared
//! error counts.

use fremen::{Error, ErrorKind, Result, Time};

use crate::explored::{Explored, check_p};
use crate::plan::Reason;
use crate::roads::Roads;
use crate::slots::Slots;
use crate::tour::{Tour, TourConfig, tour};
use crate::worth::entropy_bits;

/// What the model knows better counts for so many days. On eight weeks of Aruba 7 and 90 give the same
/// error within the spread of seeds.
const MODEL_DAYS: f64 = 28.0;

/// Looks at about the same hour: within this time.
const SAME_HOUR_S: f64 = 3_600.0;

/// What a look leaves behind is counted for so long.
const HORIZON_S: f64 = 86_400.0;

/// The future of all places, slot by slot, with what is known now.
#[derive(Clone, Debug)]
pub(crate) struct Outlook {
    slots: Slots,
    places: Vec<PlaceOutlook>,
    /// Slots that are about the same hour.
    same_hour: usize,
}

/// The future of one place.
#[derive(Clone, Debug)]
struct PlaceOutlook {
    num_states: f64,
    /// `sum of 4 p (1 - p)` in each slot, the last look counted.
    now: Vec<f64>,
    /// The same as if nobody had looked lately; `None` if it is the same.
    usual: Option<Vec<f64>>,
    /// Looks that the model rests on.
    looks: Vec<f64>,
    /// `kept^2` after so many slots, and the sum of what is expected of it over 1 to so many slots.
    kept: Vec<f64>,
    stays: Vec<f64>,
    /// Slots of visits that were made already, ascending.
    done: Vec<usize>,
}

/// What a look leaves behind.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Gain {
    /// `sum of 4 p (1 - p)` at the look.
    uncertainty: f64,
    /// For so many slots.
    slots: f64,
    /// What is known better of the model, as `sum of 4 p (1 - p)` and slots in one.
    model: f64,
}

impl Gain {
    fn value(self) -> f64 {
        self.uncertainty * self.slots + self.model
    }
}

impl Outlook {
    /// Fails where a model gives no probability.
    pub(crate) fn new(explored: &dyn Explored, slots: &Slots) -> Result<Self> {
        let places = (0..explored.num_places())
            .map(|place| PlaceOutlook::new(explored, slots, place))
            .collect::<Result<_>>()?;
        Ok(Self {
            slots: *slots,
            places,
            same_hour: (SAME_HOUR_S / slots.length().as_s()) as usize,
        })
    }

    /// Takes up that `place` was looked at in `slot`, for the slots that come after.
    pub(crate) fn visited(
        &mut self,
        explored: &dyn Explored,
        place: usize,
        slot: usize,
    ) -> Result<()> {
        let outlook = &mut self.places[place];
        outlook.done.push(slot);
        let mut p = vec![0.0; explored.num_states(place)];
        for later in slot + 1..self.slots.len() {
            let time = self.slots.middle(later);
            outlook.now[later] = uncertainty(explored, place, time, &mut p, Which::Now)?;
        }
        Ok(())
    }

    /// Takes up that `place` was looked at in `slot`, after all slots of earlier calls, where what is
    /// believed already knows what was seen.
    pub(crate) fn made(&mut self, place: usize, slot: usize) {
        self.places[place].done.push(slot);
    }

    /// What a look in `slot` adds, given other looks that are planned (ascending).
    fn gain(&self, place: usize, slot: usize, planned: &[usize]) -> Gain {
        let outlook = &self.places[place];
        let next = planned.partition_point(|&other| other < slot);
        let uncertainty = match next.checked_sub(1) {
            Some(before) => {
                let usual = outlook.usual.as_ref().unwrap_or(&outlook.now);
                let age = slot - planned[before];
                usual[slot] * (1.0 - outlook.kept.get(age).copied().unwrap_or(0.0))
            }
            None => outlook.now[slot],
        };
        let horizon = outlook.stays.len() - 1;
        let until = planned.get(next).map_or(horizon, |&other| other - slot);
        let near = |slots: &[usize]| {
            let end = slots.partition_point(|&other| other <= slot + self.same_hour);
            end - slots.partition_point(|&other| other + self.same_hour < slot)
        };
        let looks = outlook.looks[slot] + (near(planned) + near(&outlook.done)) as f64;
        // With half a look at each value.
        let usual = outlook.usual.as_ref().unwrap_or(&outlook.now)[slot];
        let unknown = outlook.num_states * (2.0 * looks + 1.0);
        let usual = (usual * looks * looks + unknown) / (looks + 1.0).powi(2);
        let counts = MODEL_DAYS * (2 * self.same_hour + 1) as f64;
        Gain {
            uncertainty,
            slots: outlook.stays[until.min(horizon)],
            model: counts * usual / ((looks + 1.0) * (looks + 2.0)),
        }
    }

    /// At most `budget` looks in the slots from `from` on, at most one a slot: the look that adds
    /// most first, then the one that adds most to it, and so on. As what a look adds only falls by
    /// others, this is within 1 - 1/e of the best, and in practice far nearer.
    ///
    /// `nudge` is added to 1 and multiplies what a look at a place in a slot adds, to break ties.
    /// O(places x slots), and O(slots) for each visit and each look whose worth has fallen.
    pub(crate) fn choose(
        &self,
        from: usize,
        budget: usize,
        nudge: impl Fn(usize, usize) -> f64,
    ) -> Vec<Chosen> {
        let value = |place: usize, slot: usize, planned: &[usize]| {
            let gain = self.gain(place, slot, planned);
            (gain, gain.value() * (1.0 + nudge(place, slot)))
        };
        let num_places = self.places.len();
        let mut planned: Vec<Vec<usize>> = vec![Vec::new(); num_places];
        let mut open = Open::new(self.slots.len(), num_places);
        for place in 0..num_places {
            for slot in from..self.slots.len() {
                open.offer(slot, place, value(place, slot, &[]).1);
            }
        }
        let mut chosen = Vec::new();
        while chosen.len() < budget {
            let Some((slot, place)) = open.best() else {
                break;
            };
            let (gain, value) = value(place, slot, &planned[place]);
            if open.is_older(slot, place, planned[place].len()) {
                // It was worth that much before other looks were planned.
                open.change(slot, place, value, planned[place].len());
                continue;
            }
            open.take(slot);
            let at = planned[place].partition_point(|&other| other < slot);
            planned[place].insert(at, slot);
            chosen.push(Chosen { slot, place, gain });
        }
        chosen
    }

    /// Why a look was chosen, in bits: the entropy of the states for as long as it counts, and what
    /// it tells of the model.
    pub(crate) fn reason(&self, explored: &dyn Explored, chosen: &Chosen) -> Reason {
        let time = self.slots.middle(chosen.slot);
        let mut p = vec![0.0; explored.num_states(chosen.place)];
        explored.predict_into(chosen.place, time, &mut p);
        let entropy: f64 = p.iter().map(|&p| entropy_bits(p)).sum();
        let full: f64 = p.iter().map(|&p| 4.0 * p * (1.0 - p)).sum();
        // Of what is left of the uncertainty when other looks come first.
        let share = if full > 0.0 {
            (chosen.gain.uncertainty / full).min(1.0)
        } else {
            0.0
        };
        Reason::Teaches {
            state_bits: entropy * share,
            slots: chosen.gain.slots,
            model_bits: chosen.gain.model,
        }
    }
}

/// What a look at one place in one slot would be worth, if nothing else were planned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prospect {
    /// The place.
    pub place: usize,
    /// The mean over its states of p.
    pub p: f64,
    /// Uncertainty of its states at the look, in bits.
    pub state_bits: f64,
    /// For so many slots what is seen stays true.
    pub slots: f64,
    /// Looks that the model of this hour rests on.
    pub looks: f64,
    /// What a look tells of the model, in bits of a state that is known for one slot.
    pub model_bits: f64,
    /// What places are ranked by.
    pub value: f64,
}

/// What a look in `slot` would be worth at each place, the best first: why a slot goes to a place.
///
/// Fails where a model gives no probability, or if there is no such slot.
pub fn prospects(explored: &dyn Explored, slots: &Slots, slot: usize) -> Result<Vec<Prospect>> {
    if slot >= slots.len() {
        return Err(Error::new(
            ErrorKind::NotFound,
            format!("there is no slot {slot} of {}", slots.len()),
        ));
    }
    let outlook = Outlook::new(explored, slots)?;
    let mut prospects: Vec<Prospect> = (0..outlook.places.len())
        .map(|place| {
            let mut p = vec![0.0; explored.num_states(place)];
            explored.predict_into(place, slots.middle(slot), &mut p);
            let gain = outlook.gain(place, slot, &[]);
            Prospect {
                place,
                p: p.iter().sum::<f64>() / p.len().max(1) as f64,
                state_bits: p.iter().map(|&p| entropy_bits(p)).sum(),
                slots: gain.slots,
                looks: outlook.places[place].looks[slot],
                model_bits: gain.model,
                value: gain.value(),
            }
        })
        .collect();
    prospects.sort_by(|a, b| b.value.total_cmp(&a.value).then(a.place.cmp(&b.place)));
    Ok(prospects)
}

/// What each further look of `slots` is expected to add, in the order in which
/// [`Strategy::Information`](crate::Strategy::Information) plans them: what the time for exploration is
/// worth, to be spent until other work is worth more.
///
/// Fails where a model gives no probability.
pub fn next_look_bits(explored: &dyn Explored, slots: &Slots) -> Result<Vec<f64>> {
    let outlook = Outlook::new(explored, slots)?;
    let chosen = outlook.choose(0, slots.len(), |_, _| 0.0);
    Ok(chosen.iter().map(|chosen| chosen.gain.value()).collect())
}

/// The tour that teaches most: places and times by what a look leaves behind, with driving,
/// opening times and charging. Visits are counted by the slots in which they begin, and nothing
/// after the last slot is worth anything.
///
/// Fails as [`tour`] does, and where a model gives no probability.
pub fn plan_tour(
    explored: &dyn Explored,
    slots: &Slots,
    roads: &Roads,
    cfg: &TourConfig,
) -> Result<Tour> {
    let outlook = Outlook::new(explored, slots)?;
    let value = |place: usize, start: Time, earlier: &[Time]| {
        let Some(slot) = slots.slot_of(start) else {
            return 0.0;
        };
        let planned: Vec<usize> = (earlier.iter())
            .filter_map(|&time| slots.slot_of(time))
            .filter(|&other| other < slot)
            .collect();
        // A second look in the same slot adds nothing.
        if planned.len() < earlier.len() {
            return 0.0;
        }
        outlook.gain(place, slot, &planned).value()
    };
    tour(&value, roads, cfg)
}

/// A look that was chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Chosen {
    pub(crate) slot: usize,
    pub(crate) place: usize,
    gain: Gain,
}

/// The looks that may still be chosen: what each place in each slot adds as far as it was worked out,
/// and the best place of each slot. 12 bytes a look.
#[derive(Debug)]
struct Open {
    num_places: usize,
    /// Slot by slot.
    values: Vec<f64>,
    /// Visits to the place that were planned when its value was worked out.
    num_planned: Vec<u32>,
    /// The first of the best places of each slot and what it adds; nothing where the slot is taken.
    best: Vec<Option<(f64, usize)>>,
}

impl Open {
    /// Without any look.
    fn new(num_slots: usize, num_places: usize) -> Self {
        Self {
            num_places,
            values: vec![0.0; num_slots * num_places],
            num_planned: vec![0; num_slots * num_places],
            best: vec![None; num_slots],
        }
    }

    /// Adds a look; those of a slot in the order of places.
    fn offer(&mut self, slot: usize, place: usize, value: f64) {
        self.values[slot * self.num_places + place] = value;
        if self.best[slot].is_none_or(|(best, _)| value > best) {
            self.best[slot] = Some((value, place));
        }
    }

    /// Slot and place of the look that adds most: the first slot of equals.
    fn best(&self) -> Option<(usize, usize)> {
        let mut most: Option<(f64, usize, usize)> = None;
        for (slot, best) in self.best.iter().enumerate() {
            if let &Some((value, place)) = best
                && most.is_none_or(|(most, ..)| value > most)
            {
                most = Some((value, slot, place));
            }
        }
        most.map(|(_, slot, place)| (slot, place))
    }

    /// Whether the value of a look was worked out before the last of so many visits was planned.
    fn is_older(&self, slot: usize, place: usize, num_planned: usize) -> bool {
        (self.num_planned[slot * self.num_places + place] as usize) < num_planned
    }

    fn change(&mut self, slot: usize, place: usize, value: f64, num_planned: usize) {
        let row = slot * self.num_places..(slot + 1) * self.num_places;
        self.values[row.start + place] = value;
        self.num_planned[row.start + place] = num_planned as u32;
        let mut best = (f64::NEG_INFINITY, 0);
        for (place, &value) in self.values[row].iter().enumerate() {
            if value > best.0 {
                best = (value, place);
            }
        }
        self.best[slot] = Some(best);
    }

    /// The slot is given away.
    fn take(&mut self, slot: usize) {
        self.best[slot] = None;
    }
}

impl PlaceOutlook {
    fn new(explored: &dyn Explored, slots: &Slots, place: usize) -> Result<Self> {
        let num_states = explored.num_states(place);
        let mut p = vec![0.0; num_states];
        let times = || (0..slots.len()).map(|slot| slots.middle(slot));
        let now = times()
            .map(|time| uncertainty(explored, place, time, &mut p, Which::Now))
            .collect::<Result<_>>()?;
        let usual = match explored.last_look(place) {
            None => None,
            Some(_) => Some(
                times()
                    .map(|time| uncertainty(explored, place, time, &mut p, Which::Usual))
                    .collect::<Result<_>>()?,
            ),
        };
        let looks = times()
            .map(|time| explored.looks(place, time).max(0.0))
            .collect();
        let slot_s = slots.length().as_s();
        let horizon = ((HORIZON_S / slot_s) as usize).clamp(1, slots.len().max(144));
        let kept: Vec<f64> = (0..=horizon)
            .map(|age| {
                explored
                    .kept(place, age as f64 * slot_s)
                    .clamp(0.0, 1.0)
                    .powi(2)
            })
            .collect();
        let mut stays = vec![0.0; horizon + 1];
        for age in 1..=horizon {
            let expected = explored.kept_squared(place, age as f64 * slot_s);
            stays[age] = stays[age - 1] + expected.clamp(0.0, 1.0);
        }
        Ok(Self {
            num_states: num_states as f64,
            now,
            usual,
            looks,
            kept,
            stays,
            done: Vec::new(),
        })
    }
}

/// With the last look or without.
#[derive(Clone, Copy, Debug)]
enum Which {
    Now,
    Usual,
}

/// `sum of 4 p (1 - p)` by one of the two predictions.
fn uncertainty(
    explored: &dyn Explored,
    place: usize,
    time: Time,
    p: &mut [f64],
    which: Which,
) -> Result<f64> {
    match which {
        Which::Now => explored.predict_into(place, time, p),
        Which::Usual => explored.usual_into(place, time, p),
    }
    let Some(sum) = sum_of_uncertainty(p) else {
        return check_p(explored, place, time, p).map(|()| 0.0);
    };
    Ok(sum)
}

/// `sum of 4 p (1 - p)`, eight at a time; `None` if one of them is no probability.
fn sum_of_uncertainty(p: &[f64]) -> Option<f64> {
    const LANES: usize = 8;
    let mut sums = [0.0; LANES];
    let mut are_all = true;
    let (whole, rest) = p.as_chunks::<LANES>();
    for p in whole {
        for (sum, &p) in sums.iter_mut().zip(p) {
            are_all &= (0.0..=1.0).contains(&p);
            *sum += p * (1.0 - p);
        }
    }
    for &p in rest {
        are_all &= (0.0..=1.0).contains(&p);
        sums[0] += p * (1.0 - p);
    }
    are_all.then_some(4.0 * sums.iter().sum::<f64>())
}
