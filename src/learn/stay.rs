//! Is this image one more of a visit that is under way?
//!
//! A robot that stands still at ten images a second sees one thing three thousand times, and has
//! seen it once. Were each image a visit of its own, five minutes at a charger by night would
//! outweigh a fortnight of days. So images of one place that follow each other in less than
//! [`LearnConfig::stay_gap_s`](super::LearnConfig::stay_gap_s) are one *stay*, however long it is,
//! and a stay adds a visit only now and then, by the place's own rhythm:
//!
//! ```text
//! spacing = max(10 min, usual gap / 6)
//! ```
//!
//! The usual gap is that of the visits before the stay in which the median moment lies: half of the
//! time passes in gaps at least as long. Short gaps, of which earlier stays may have left many,
//! take little time and so do not shrink it. Where a place has no past, a stay adds a visit every
//! ten minutes.
//!
//! What shows the place in no way that it is known by, as when a robot turns on the spot, is learnt
//! within the spacing, too, but at most [`MAX_VIEWS`] visits are: sensor noise looks new each time.
//!
//! It does not matter whether other places lie between. Where two places flicker, both are stays;
//! and whoever is back within a minute finds what he left.
//!
//! Stays are not stored. They are found again from the visits of the log, one by one, as the images
//! of an interrupted build come a second time: what was left out the first time is left out again.

use std::collections::BTreeMap;

use crate::map::{Node, PlaceKey};
use fremen::time::Time;

/// Visits that differ within one spacing, at most.
const MAX_VIEWS: usize = 4;
/// A stay adds so many visits in the place's usual gap, at most.
const VISITS_PER_GAP: i64 = 6;
/// And at most one in this time, us.
const MIN_SPACING_US: i64 = 600_000_000;

/// What an image is to the stay it belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    /// A visit: the first image, or the first in a while.
    Visit,
    /// A visit if it shows something else than the place is known by.
    VisitIfNew,
    /// No visit of its own.
    Same,
}

/// The latest stay at one place.
#[derive(Clone, Debug)]
struct Stay {
    since: Time,
    until: Time,
    spacing_us: i64,
    /// What it has added lately; a budget may have forgotten that meanwhile.
    learnt: Vec<Time>,
}

/// The stays at all places.
#[derive(Debug, Default)]
pub(super) struct Stays {
    gap_us: i64,
    places: BTreeMap<PlaceKey, Stay>,
}

impl Stays {
    /// Images of one place that are less than `gap_s` apart are one stay; with 0 there are no stays.
    pub(super) fn new(gap_s: u32) -> Self {
        Self {
            gap_us: i64::from(gap_s) * 1_000_000,
            places: BTreeMap::new(),
        }
    }

    /// Goes on with the stays that another learner has followed, whatever it learnt of them.
    pub(super) fn follow(&mut self, other: &Self) {
        self.places.clone_from(&other.places);
        for stay in self.places.values_mut() {
            stay.learnt.clear();
        }
    }

    /// An image of a place has come; `node` is what was learnt of it. O(visits).
    pub(super) fn arrive(&mut self, place: &PlaceKey, node: Option<&Node>, time: Time) -> Part {
        if self.gap_us == 0 {
            return Part::Visit;
        }
        let times = node.map_or(&[][..], |node| node.log().times());
        let us = time.as_us();
        let is_near = |from: Time, to: Time| {
            (from.as_us() - self.gap_us < us) && (us < to.as_us() + self.gap_us)
        };
        let known = (self.places.get_mut(place)).filter(|stay| is_near(stay.since, stay.until));
        if let Some(stay) = known {
            stay.since = stay.since.min(time);
            stay.until = stay.until.max(time);
        } else {
            // A visit of before, if one is near: nobody followed the images since.
            let near = (times.iter().copied())
                .filter(|&visit| is_near(visit, visit))
                .min();
            let since = near.map_or(time, |near| near.min(time));
            let stay = Stay {
                since,
                until: near.map_or(time, |near| near.max(time)),
                spacing_us: spacing_us(times, since),
                learnt: Vec::new(),
            };
            self.places.insert(place.clone(), stay);
        }
        match self.num_near(place, time, times.iter().copied()) {
            0 => Part::Visit,
            1..MAX_VIEWS => Part::VisitIfNew,
            _ => Part::Same,
        }
    }

    /// Whether so many visits of the stay are held that one more says nothing new.
    pub(super) fn is_held(
        &self,
        place: &PlaceKey,
        time: Time,
        held: impl Iterator<Item = Time>,
    ) -> bool {
        self.places.contains_key(place) && self.num_near(place, time, held) >= MAX_VIEWS
    }

    /// The latest image was learnt as a visit.
    pub(super) fn count_visit(&mut self, place: &PlaceKey, time: Time) {
        if let Some(stay) = self.places.get_mut(place) {
            let first_us = time.as_us() - stay.spacing_us;
            stay.learnt.retain(|learnt| learnt.as_us() > first_us);
            stay.learnt.push(time);
        }
    }

    /// How many visits the stay at a place has added within its spacing, of those in its log.
    fn num_near(&self, place: &PlaceKey, time: Time, log: impl Iterator<Item = Time>) -> usize {
        let Some(stay) = self.places.get(place) else {
            return 0;
        };
        let us = time.as_us();
        let is_near = |visit: Time| {
            visit >= stay.since
                && (us - stay.spacing_us < visit.as_us())
                && (visit.as_us() < us + self.gap_us)
        };
        let num_learnt = stay.learnt.iter().filter(|&&visit| is_near(visit)).count();
        log.filter(|&visit| is_near(visit)).count().max(num_learnt)
    }
}

/// How far apart the visits of a stay are that began at `since`.
fn spacing_us(times: &[Time], since: Time) -> i64 {
    let mut before: Vec<i64> = (times.iter().filter(|&&time| time <= since))
        .map(|time| time.as_us())
        .collect();
    before.sort_unstable();
    let mut gaps: Vec<i64> = before.windows(2).map(|pair| pair[1] - pair[0]).collect();
    gaps.sort_unstable();
    let half = gaps.iter().sum::<i64>() / 2;
    let mut passed = 0;
    let usual = gaps.into_iter().find(|gap| {
        passed += gap;
        passed > half
    });
    (usual.unwrap_or_default() / VISITS_PER_GAP).max(MIN_SPACING_US)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::{AppearanceUse, SessionId, Visit, VisitId};
    use fremen::visibility::BitRow;

    const DAY_S: i64 = 86_400;

    fn here() -> PlaceKey {
        PlaceKey::new("here").expect("valid")
    }

    fn learn(node: &mut Node, time: Time) {
        let visit = Visit {
            id: VisitId(time.as_us() as u128),
            session: SessionId(1),
            time,
            source: String::new(),
            appearance: None,
            appearance_use: AppearanceUse::Recognised,
        };
        let (seen, located) = (BitRow::zeros(0), BitRow::zeros(0));
        let born = crate::feature::Features::new();
        (node.push_visit(visit, &born, seen, None, located)).expect("fits");
    }

    /// The times, of those in s, that become visits; every image is like the others.
    fn visits(stays: &mut Stays, node: &mut Node, times_s: impl Iterator<Item = f64>) -> Vec<f64> {
        let mut added = Vec::new();
        for time_s in times_s {
            let time = Time::from_us((time_s * 1e6) as i64);
            if stays.arrive(&here(), Some(node), time) == Part::Visit {
                learn(node, time);
                stays.count_visit(&here(), time);
                added.push(time_s);
            }
        }
        added
    }

    fn ten_a_second(from_s: i64, minutes: i64) -> impl Iterator<Item = f64> {
        (0..minutes * 600).map(move |i| from_s as f64 + i as f64 / 10.0)
    }

    #[test]
    fn a_stay_adds_a_visit_every_ten_minutes_or_by_the_rhythm_of_its_place() {
        let mut node = Node::new(here());
        let mut stays = Stays::new(60);
        let first = visits(&mut stays, &mut node, ten_a_second(0, 25));
        assert_eq!(first, [0.0, 600.0, 1_200.0]);
        // Four visits a day for a week: the longest gap takes most of the time.
        let days = (1..8).flat_map(|day| [8, 10, 12, 14].map(|h| (day * DAY_S + h * 3_600) as f64));
        assert_eq!(visits(&mut stays, &mut node, days).len(), 28);
        let night = visits(&mut stays, &mut node, ten_a_second(8 * DAY_S, 8 * 60));
        assert_eq!(night.len(), 3, "{night:?}");
        // Nights as long as these do not make the next one count for more.
        for day in 9..13 {
            let next = visits(&mut stays, &mut node, ten_a_second(day * DAY_S, 8 * 60));
            assert!(next.len() <= 6, "{next:?}");
        }
    }

    #[test]
    fn images_that_come_again_are_left_out_again() {
        let mut node = Node::new(here());
        let times = || (ten_a_second(0, 25)).chain(ten_a_second(7_200, 15));
        let first = visits(&mut Stays::new(60), &mut node, times());
        let again = times().filter(|time_s| !first.contains(time_s));
        assert!(visits(&mut Stays::new(60), &mut node, again).is_empty());
        // And where a budget forgets each visit at once, it is not learnt over and over.
        let mut stays = Stays::new(60);
        let num_visits = (ten_a_second(0, 5))
            .filter(|time_s| {
                let time = Time::from_us((time_s * 1e6) as i64);
                let is_visit = stays.arrive(&here(), None, time) == Part::Visit;
                if is_visit {
                    stays.count_visit(&here(), time);
                }
                is_visit
            })
            .count();
        assert_eq!(num_visits, 1);
    }

    #[test]
    fn what_looks_new_all_the_time_is_bounded_and_visits_apart_are_no_stay() {
        let mut node = Node::new(here());
        let mut stays = Stays::new(60);
        let mut num_visits = 0;
        for i in 0..300 {
            let time = Time::from_us(i * 100_000);
            if stays.arrive(&here(), Some(&node), time) != Part::Same {
                learn(&mut node, time);
                stays.count_visit(&here(), time);
                num_visits += 1;
            }
        }
        assert_eq!(num_visits, MAX_VIEWS);
        let apart = (1..50).map(|i| f64::from(1_000 + i * 60));
        assert_eq!(visits(&mut stays, &mut node, apart).len(), 49);
        let mut none = Stays::new(0);
        assert_eq!(
            visits(&mut none, &mut node, ten_a_second(DAY_S, 1)).len(),
            600
        );
    }
}
