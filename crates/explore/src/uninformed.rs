//! Which visits need no model?

use crate::plan::{Plan, Reason};
use crate::random::Random;
use crate::slots::Slots;
use crate::worth::Worth;

/// One place after the other from `turn` on, which goes on, at equal distances.
pub(crate) fn round_robin(slots: Slots, budget: usize, worth: &Worth, turn: &mut usize) -> Plan {
    let mut plan = Plan::empty(slots);
    for slot in 0..slots.len() {
        // As many visits up to here as the share allows.
        let is_due = (slot + 1) * budget / slots.len() > slot * budget / slots.len();
        if is_due && worth.num_places() > 0 {
            let place = *turn % worth.num_places();
            *turn = (place + 1) % worth.num_places();
            plan.set(slot, place, worth.bits(place, slot), Reason::Turn);
        }
    }
    plan
}

/// Any place in any of the slots.
pub(crate) fn random(slots: Slots, budget: usize, worth: &Worth, random: &mut Random) -> Plan {
    let mut plan = Plan::empty(slots);
    if worth.num_places() == 0 {
        return plan;
    }
    for slot in random.order(slots.len()).into_iter().take(budget) {
        let place = random.below(worth.num_places());
        plan.set(slot, place, worth.bits(place, slot), Reason::Lot);
    }
    plan
}
