//! Which place is visited in which slot, and why?

use std::fmt;

use fremen::{Error, ErrorKind, Period, Result, Time};

use crate::slots::Slots;

/// Why a slot went to a place.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Reason {
    /// Its states are the least certain of all at that time (greedy).
    LeastCertain,
    /// It was drawn with this probability, which grows with its uncertainty (Monte Carlo).
    Drawn {
        /// Of this place in this slot.
        probability: f64,
    },
    /// What was seen there lately was not expected: this many bits more than usual (novelty).
    Surprise {
        /// Bits above the expectation.
        bits: f64,
    },
    /// It was its turn (round robin).
    Turn,
    /// By lot (random).
    Lot,
    /// A look leaves more behind than any other that there is time for (information).
    Teaches {
        /// Uncertainty of the states at the look, in bits.
        state_bits: f64,
        /// For so many slots what is seen stays true.
        slots: f64,
        /// What it tells of the model, in bits of a state that is known for one slot.
        model_bits: f64,
    },
}

impl Reason {
    /// Bits that a visit leaves behind: those of its states for as many slots as they count, and
    /// those of the model; `None` where nobody has worked them out.
    pub(crate) fn bits_left(self) -> Option<f64> {
        match self {
            Self::Teaches {
                state_bits,
                slots,
                model_bits,
            } => Some(state_bits * slots + model_bits),
            _ => None,
        }
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::LeastCertain => f.write_str("least certain of all places then"),
            Self::Drawn { probability } => {
                write!(f, "drawn by its uncertainty, probability {probability:.3}")
            }
            Self::Surprise { bits } => write!(f, "surprise: {bits:.1} bits more than usual"),
            Self::Turn => f.write_str("its turn"),
            Self::Lot => f.write_str("by lot"),
            Self::Teaches {
                state_bits,
                slots,
                model_bits,
            } => write!(
                f,
                "{state_bits:.2} bits of its states, true for {slots:.1} slots; {model_bits:.2} bits of its model"
            ),
        }
    }
}

/// One visit of a plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Visit {
    /// The slot that it fills.
    pub slot: usize,
    /// When the robot is to be there.
    pub start: Time,
    /// When it may leave.
    pub end: Time,
    /// Where.
    pub place: usize,
    /// What the visit is expected to teach, in the bits of the strategy.
    pub info_bits: f64,
    /// Why.
    pub reason: Reason,
}

/// Visits in order of time, at most one a slot; slots without are for other tasks.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    slots: Slots,
    visits: Vec<Option<Visit>>,
}

impl Plan {
    /// Without any visit.
    pub(crate) fn empty(slots: Slots) -> Self {
        Self {
            visits: vec![None; slots.len()],
            slots,
        }
    }

    /// Gives `slot` to `place`.
    pub(crate) fn set(&mut self, slot: usize, place: usize, info_bits: f64, reason: Reason) {
        self.visits[slot] = Some(Visit {
            slot,
            start: self.slots.begin(slot),
            end: self.slots.begin(slot + 1),
            place,
            info_bits,
            reason,
        });
    }

    /// Gives `slot` back to other tasks.
    pub(crate) fn clear(&mut self, slot: usize) {
        self.visits[slot] = None;
    }

    /// The slots that it fills in part.
    pub fn slots(&self) -> &Slots {
        &self.slots
    }

    /// The visit of a slot; `None` also beyond the last.
    pub fn visit(&self, slot: usize) -> Option<&Visit> {
        self.visits.get(slot)?.as_ref()
    }

    /// All visits in order of time.
    pub fn visits(&self) -> impl Iterator<Item = &Visit> {
        self.visits.iter().flatten()
    }

    /// How many there are.
    pub fn num_visits(&self) -> usize {
        self.visits().count()
    }
}

/// How much of which time may be spent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Share(f64);

impl Share {
    /// Fails outside of 0 to 1. With 0 a plan has no visits, with 1 every slot may have one.
    pub fn new(share: f64) -> Result<Self> {
        if (0.0..=1.0).contains(&share) {
            return Ok(Self(share));
        }
        Err(Error::new(
            ErrorKind::Config,
            format!("the share of time for exploration must be 0 to 1, not {share}"),
        ))
    }

    /// As a number from 0 to 1.
    pub fn get(self) -> f64 {
        self.0
    }

    /// Visits that `slots` have room for.
    pub fn budget(self, slots: &Slots) -> usize {
        slots.budget(self.0)
    }
}

/// The length of a slot where nothing else is said (RAS 2016, 7).
pub(crate) fn usual_slot() -> Result<Period> {
    Period::from_us(600_000_000)
}
