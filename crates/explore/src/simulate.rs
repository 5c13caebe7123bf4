//! How well would a robot have known the world that explored it like this?
//!
//! The protocol of RAS 2016, section 7: the robot begins with nothing, plans a day at a time, is
//! shown the states of the place that it visits in a slot and of no other, and learns at the end of
//! the day. Its model's error is the share of states, over all places and moments, that it has wrong
//! when it takes each state to be 1 if p > 1/2; what it is looking at it knows (eq. 1-2).
//!
//! Erratum: eq. 1 prints p >= 1/2; with it a robot that knows nothing believes a person in every
//! room.

use fremen::online::OnlineConfig;
use fremen::{Error, ErrorKind, Result};

use crate::explored::{Explored, check_p};
use crate::explorer::{ExploreConfig, Explorer};
use crate::plan::Visit;
use crate::recording::Recording;
use crate::slots::Slots;

/// What a simulation gave.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// The share of states that the model had wrong on each planned stretch (a day).
    pub by_day: Vec<f64>,
    /// The same over all of them.
    pub error: f64,
    /// Every visit that was made.
    pub visits: Vec<Visit>,
    /// How often a visit was not the one that had been planned.
    pub num_rerouted: usize,
}

/// Explores `recording` by plans of `num_slots` slots each, from its first moment on.
///
/// Whole stretches of plans only: what is left at the end is not used. Fails if there is not even
/// one, or if a model fails.
pub fn simulate(
    recording: &Recording,
    model: &OnlineConfig,
    cfg: &ExploreConfig,
    num_slots: usize,
) -> Result<Outcome> {
    let mut explorer = Explorer::new(recording.places(), model, cfg.clone());
    let mut outcome = Outcome {
        by_day: Vec::new(),
        error: 0.0,
        visits: Vec::new(),
        num_rerouted: 0,
    };
    if recording.num_places() == 0 {
        return Err(Error::new(ErrorKind::Shape, "there is no place to explore")
            .with_help("a recording needs at least one place with its states"));
    }
    let end = recording.times()[recording.times().len() - 1];
    let mut start = recording.times()[0];
    let mut total = Tally::default();
    loop {
        let slots = Slots::new(start, cfg.slot(), num_slots)?;
        if slots.begin(slots.len() - 1) > end {
            break;
        }
        explorer.plan(start, num_slots)?;
        let mut day = Tally::default();
        for slot in 0..num_slots {
            let visit = explorer.next(slot)?;
            outcome.visits.extend(visit);
            let moments = recording.between(slots.begin(slot), slots.begin(slot + 1));
            let place = visit.map(|visit| visit.place);
            for moment in moments {
                let time = recording.times()[moment];
                day.add_moment(recording, explorer.beliefs(), moment, place)?;
                if let Some(place) = place {
                    explorer.observe(place, time, recording.states(place, moment))?;
                }
            }
        }
        outcome.by_day.push(day.share());
        total.wrong += day.wrong;
        total.states += day.states;
        start = slots.end();
    }
    if outcome.by_day.is_empty() {
        return Err(Error::new(
            ErrorKind::Shape,
            format!("the recording is shorter than one plan of {num_slots} slots"),
        )
        .with_help("plan fewer slots at a time"));
    }
    outcome.error = total.share();
    outcome.num_rerouted = explorer.num_rerouted();
    Ok(outcome)
}

/// States, and those that a model has wrong.
#[derive(Clone, Copy, Debug, Default)]
struct Tally {
    wrong: usize,
    states: usize,
}

impl Tally {
    fn share(self) -> f64 {
        self.wrong as f64 / self.states.max(1) as f64
    }

    fn add_moment(
        &mut self,
        recording: &Recording,
        explored: &dyn Explored,
        moment: usize,
        known: Option<usize>,
    ) -> Result<()> {
        let time = recording.times()[moment];
        for place in 0..recording.num_places() {
            let states = recording.states(place, moment);
            self.states += states.len();
            if known == Some(place) {
                continue;
            }
            let mut p = vec![0.0; states.len()];
            explored.predict_into(place, time, &mut p);
            check_p(explored, place, time, &p)?;
            let wrong = p
                .iter()
                .zip(states)
                .filter(|(p, state)| (**p > 0.5) != **state);
            self.wrong += wrong.count();
        }
        Ok(())
    }
}
