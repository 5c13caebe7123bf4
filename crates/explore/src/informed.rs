//! Which visits are worth the most bits of uncertainty? (RAS 2016, 5.1)

use crate::plan::{Plan, Reason};
use crate::random::Random;
use crate::slots::Slots;
use crate::worth::Worth;

/// The least certain place of each slot, in the slots where that is least certain. Among equals the
/// place with fewer visits comes first, and slots come by lot.
pub(crate) fn greedy(slots: Slots, budget: usize, worth: &Worth, random: &mut Random) -> Plan {
    let mut plan = Plan::empty(slots);
    let mut num_visits = vec![0_usize; worth.num_places()];
    let best: Vec<f64> = (0..slots.len())
        .map(|slot| {
            let bits = (0..worth.num_places()).map(|place| worth.bits(place, slot));
            bits.fold(0.0, f64::max)
        })
        .collect();
    let mut order = random.order(slots.len());
    order.sort_by(|&a, &b| best[b].total_cmp(&best[a]));
    order.truncate(budget);
    order.sort_unstable();
    for slot in order {
        let is_best = |&place: &usize| worth.bits(place, slot) >= best[slot];
        let candidates = (0..worth.num_places()).filter(is_best);
        if let Some(place) = candidates.min_by_key(|&place| num_visits[place]) {
            num_visits[place] += 1;
            plan.set(slot, place, best[slot], Reason::LeastCertain);
        }
    }
    plan
}

/// Slots are drawn, and a place for each, by the bits of the places and a little.
///
/// The weight of no visit is the same in every slot, `(1 - e) / e` times the mean over the slots of
/// the sum over places. Erratum: RAS 2016 prints `I' (1 - e) / (n e)` with n the number of
/// locations, and eq. 11 without the brackets round `I + iota`. `Deviation:` the draws of eq. 11
/// give the share on average and less than it where slots differ; slots that are missing are drawn
/// from the others by the same weights, and those that are too many are given back by lot, so that
/// a plan has as many visits as the share allows.
pub(crate) fn monte_carlo(
    slots: Slots,
    budget: usize,
    worth: &Worth,
    floor_bits: f64,
    random: &mut Random,
) -> Plan {
    let mut plan = Plan::empty(slots);
    let share = budget as f64 / slots.len() as f64;
    if budget == 0 || worth.num_places() == 0 {
        return plan; // Nothing to draw.
    }
    let weight = |place: usize, slot: usize| worth.bits(place, slot) + floor_bits;
    let sums: Vec<f64> = (0..slots.len())
        .map(|slot| {
            (0..worth.num_places())
                .map(|place| weight(place, slot))
                .sum()
        })
        .collect();
    let idle = sums.iter().sum::<f64>() / slots.len() as f64 * (1.0 - share) / share;
    let (mut drawn, mut others): (Vec<usize>, Vec<usize>) =
        (0..slots.len()).partition(|&slot| random.unit() * (sums[slot] + idle) >= idle);
    while drawn.len() > budget {
        drawn.swap_remove(random.below(drawn.len()));
    }
    // Without replacement by weights: the largest of u^(1/w) (Efraimidis and Spirakis 2006).
    let mut keys = vec![0.0; slots.len()];
    for &slot in &others {
        keys[slot] = (1.0 - random.unit()).ln() / sums[slot];
    }
    others.sort_by(|&a, &b| keys[b].total_cmp(&keys[a]));
    drawn.extend(others.into_iter().take(budget - drawn.len()));
    drawn.sort_unstable();
    for slot in drawn {
        let mut left = random.unit() * sums[slot];
        let place = (0..worth.num_places()).find(|&place| {
            left -= weight(place, slot);
            left < 0.0
        });
        let place = place.unwrap_or(worth.num_places() - 1);
        let probability = weight(place, slot) / sums[slot];
        let bits = worth.bits(place, slot);
        plan.set(slot, place, bits, Reason::Drawn { probability });
    }
    plan
}
