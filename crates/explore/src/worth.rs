//! What is a visit worth, in bits?

use fremen::Result;

use crate::explored::{Explored, check_p};
use crate::slots::Slots;

/// The uncertainty of a state of probability `p`, in bits: 0 if it is known, 1 for a tossed coin.
pub fn entropy_bits(p: f64) -> f64 {
    let term = |p: f64| if p > 0.0 { -p * p.log2() } else { 0.0 };
    term(p) + term(1.0 - p)
}

/// The uncertainty of the states of each place in each slot (RAS 2016 eq. 10, in bits): what one
/// would know after a look at that time that one does not know before.
#[derive(Clone, Debug, PartialEq)]
pub struct Worth {
    num_places: usize,
    num_slots: usize,
    /// Place by place.
    bits: Vec<f64>,
}

impl Worth {
    /// At the middle of each slot. Fails where a model gives no probability.
    pub fn new(explored: &dyn Explored, slots: &Slots) -> Result<Self> {
        let mut bits = Vec::with_capacity(explored.num_places() * slots.len());
        for place in 0..explored.num_places() {
            let mut p = vec![0.0; explored.num_states(place)];
            for slot in 0..slots.len() {
                let time = slots.middle(slot);
                explored.predict_into(place, time, &mut p);
                check_p(explored, place, time, &p)?;
                bits.push(p.iter().map(|&p| entropy_bits(p)).sum());
            }
        }
        Ok(Self {
            num_places: explored.num_places(),
            num_slots: slots.len(),
            bits,
        })
    }

    /// Places.
    pub fn num_places(&self) -> usize {
        self.num_places
    }

    /// Slots.
    pub fn num_slots(&self) -> usize {
        self.num_slots
    }

    /// Bits of a visit to `place` in `slot`.
    ///
    /// # Panics
    /// If there is no such place or slot.
    pub fn bits(&self, place: usize, slot: usize) -> f64 {
        assert!(slot < self.num_slots, "no slot {slot}");
        self.bits[place * self.num_slots + slot]
    }
}
