//! Is this visit what it seems to be?
//!
//! A map that learns by itself believes its own mistakes, unless each visit is held against what
//! was expected of it before it is learnt (Krajník et al., IROS 2016, III-C). Three questions, in
//! this order:
//!
//! 1. Can its time be right? ([`ClockFault`])
//! 2. Is anything to be seen? An image with fewer than
//!    [`GuardConfig::min_features`](super::GuardConfig::min_features) features is *blind*.
//! 3. Does it agree with the prediction? Of the n features most likely at its time, those that
//!    could be seen are looked for: *agreement* = seen / checked. It is compared with the
//!    agreements of the place's own past visits: each was checked before it was learnt. Of visits
//!    that were learnt unchecked, runs are taken out of the log, and each visit of a run is
//!    predicted by a model of the others, from the features known before the run.
//!
//! ```text
//! threshold = tolerance * low * m / (m + 4)
//! ```
//!
//! with m past agreements and *low* the one that a tenth of them lie below (of fewer than ten, the
//! lowest). The last factor is caution: a few visits do not know how low an honest one may be. An
//! image that agrees less than *low*, and whose features agree with another place of the map better
//! than with its own, is doubted as well.
//!
//! An image whose place somebody has vouched for ([`Circumstances::is_labelled`]) is believed as it
//! is where a map is built: being unlike the place's past is what a first night is. It is doubted
//! only if it agrees less than *low* and clearly looks like another place.
//!
//! No distribution is assumed: an honest visit is as likely to be the lowest as any other, so with
//! m of them it falls below the lowest once in m + 1 times, and below half of it far less often.
//!
//! A place that was not recognised at all at a tenth of its honest visits (agreement 0) has a *low*
//! and a threshold of 0: an image that shows nothing of it is usual there. It still refuses what
//! looks like another place: for this *low* is taken of those visits that were recognised. A place
//! of fewer than [`GuardConfig::min_visits`](super::GuardConfig::min_visits) visits refuses
//! nothing.
//!
//! Cost: O(features) a visit, and a look at one number for each past visit. The model of a place is
//! refreshed now and then (`expectation`). Past agreements are found by up to eight fits when a
//! place has as many visits as are needed, and at two, four, eight times as many; between these each
//! visit adds its own, and what a budget forgets takes its own along. A process that goes on with a
//! map finds out anew what another had known (some fifteen fits a place), so that a visit is
//! believed or not whatever interrupted the learning before it. So both are a constant number of passes over
//! the features a visit on average, with and without a budget.
//!
//! Not for deciding where an image was taken: that is `localize`. A doubtful visit is not lost
//! ([`Quarantine`](crate::map::Quarantine)): somebody who knows better may accept it.

use std::collections::BTreeMap;

use super::config::LearnConfig;
use super::expectation::{PlaceModel, identity};
use super::guard_config::MIN_CHECKED;
use crate::map::{ClockFault, Node, PlaceKey, QuarantineReason, SessionId, Snapshot};
use fremen::error::Result;
use fremen::time::Time;
use fremen::visibility::{self, BitRow, HistoryLog, VisibilityModel, Visits};

/// No camera's clock was right before 2000-01-01: it was never set.
const FIRST_TIME: Time = Time::from_s(946_684_800);
/// Clocks that agree this well are the same, s.
const SAME_CLOCK_S: f64 = 120.0;
/// Zones differ by multiples of this, s, and by at most [`MAX_ZONE_S`].
const ZONE_STEP_S: f64 = 900.0;
const MAX_ZONE_S: f64 = 14.0 * 3_600.0;
/// Runs that past visits are taken out in.
const NUM_RUNS: usize = 8;
/// Which of the past agreements is the low one.
const LOW_SHARE: f64 = 0.1;
/// A place with so many times the visits finds out its past agreements anew.
const OUTGROWN: usize = 2;
/// So many past agreements are as good as none.
const DOUBTED_VISITS: f64 = 4.0;

/// An image contradicts its label if so many times as many features agree with another place,
const CLEAR_RATIO: usize = 2;
/// and so many times as many as make an image one of a place at all.
const SURE_RATIO: usize = 3;

/// How an image came in, where that is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Circumstances {
    /// What the machine's clock says.
    pub now: Option<Time>,
    /// The image was taken just now, and after those before it.
    pub is_live: bool,
    /// Somebody who knows has said which place it shows.
    pub is_labelled: bool,
    /// The grey levels that all but the darkest and the brightest hundredth of its pixels lie
    /// between.
    pub gray_range: Option<(u8, u8)>,
}

/// How the visits of one place agreed with what was predicted of them.
#[derive(Debug)]
struct Past {
    /// One for each visit of the place; `None` where too little could be checked.
    agreements: Vec<Option<f64>>,
    /// Visits of the place when the first of them were found out.
    num_judged: usize,
}

/// A visit that agrees less than usual.
#[derive(Clone, Copy, Debug)]
pub(super) struct Disagreement {
    agreement: f64,
    usual: Usual,
    threshold: f64,
    num_checked: usize,
}

/// Past agreements in three numbers.
#[derive(Clone, Copy, Debug)]
struct Usual {
    /// A low one.
    low: f64,
    /// A low one of the visits that were recognised at all.
    low_recognised: f64,
    median: f64,
}

impl Usual {
    /// Of agreements, ascending; zeros where there are none.
    fn of(sorted: &[f64]) -> Self {
        let at = |sorted: &[f64], share: f64| {
            let at = (share * sorted.len() as f64) as usize;
            sorted.get(at).copied().unwrap_or_default()
        };
        let recognised = &sorted[sorted.partition_point(|&agreement| agreement <= 0.0)..];
        Self {
            low: at(sorted, LOW_SHARE),
            low_recognised: at(recognised, LOW_SHARE),
            median: at(sorted, 0.5),
        }
    }
}

impl Disagreement {
    /// Whether that is reason enough to doubt it, if it looks like another place or like none.
    pub(super) fn judged(self, looks_like: Option<PlaceKey>) -> Option<QuarantineReason> {
        let threshold = if looks_like.is_some() {
            self.usual.low_recognised
        } else {
            self.threshold
        };
        (self.agreement < threshold).then_some(QuarantineReason::Disagreement {
            agreement: self.agreement,
            threshold,
            expected: self.usual.median,
            num_predicted: self.num_checked,
            looks_like,
        })
    }
}

/// Whether an image speaks so much for another place that whoever labelled it must be wrong.
///
/// To be unlike the own place is not enough: that is what a first night or the first snow is.
pub(super) fn contradicts(num_own: usize, num_other: usize, min_inliers: u32) -> bool {
    num_other >= (CLEAR_RATIO * num_own).max(SURE_RATIO * min_inliers as usize)
}

/// Judges visits.
#[derive(Debug, Default)]
pub(super) struct Guard {
    /// By position of the place.
    pasts: Vec<Option<Past>>,
    /// The latest time of each session of this run.
    latest: BTreeMap<SessionId, Time>,
    scores: Vec<f64>,
}

impl Guard {
    /// Whether the time can be right; called for every visit in order of arrival.
    ///
    /// A map of times before 2000 does not count time as clocks do, so nothing is said of it.
    pub(super) fn doubt_clock(
        &mut self,
        snapshot: &Snapshot,
        session: SessionId,
        time: Time,
        circumstances: &Circumstances,
    ) -> Option<QuarantineReason> {
        let newest = (snapshot.nodes().iter())
            .filter_map(|node| node.log().times().last())
            .max();
        if newest.is_some_and(|&newest| newest < FIRST_TIME) {
            return None;
        }
        let fault = |fault, off_s| Some(QuarantineReason::Clock { fault, off_s });
        // A machine without a clock of its own cannot judge another one.
        let now = circumstances.now.filter(|&now| now >= FIRST_TIME);
        let off_s = now.map(|now| time.since_s(now));
        if time < FIRST_TIME {
            return fault(ClockFault::Unset, off_s.unwrap_or_default());
        }
        if let Some(off_s) = off_s {
            let is_off = off_s > SAME_CLOCK_S || circumstances.is_live && off_s < -SAME_CLOCK_S;
            let steps = (off_s / ZONE_STEP_S).round();
            let is_zone = (off_s - steps * ZONE_STEP_S).abs() <= SAME_CLOCK_S
                && off_s.abs() <= MAX_ZONE_S + SAME_CLOCK_S;
            if is_off && is_zone {
                return fault(ClockFault::Zone, off_s);
            }
            if is_off && off_s > 0.0 {
                return fault(ClockFault::Future, off_s);
            }
        }
        if circumstances.is_live
            && let Some(&latest) = self.latest.get(&session)
        {
            let step_s = time.since_s(latest);
            if step_s < -SAME_CLOCK_S {
                return fault(ClockFault::Backwards, step_s);
            }
        }
        let latest = self.latest.entry(session).or_insert(time);
        *latest = time.max(*latest);
        None
    }

    /// How a visit agrees with what was predicted of its place, and by how many features that was
    /// found; `None` if too few of them could be seen. `seen` and `hidden` say what was found of
    /// the features known so far.
    pub(super) fn agreement(
        &mut self,
        cfg: &LearnConfig,
        model: &PlaceModel,
        time: Time,
        seen: &BitRow,
        hidden: Option<&BitRow>,
    ) -> Option<(f64, usize)> {
        let check = Check {
            model: model.model(),
            pairs: model.pairs(),
            num_predicted: cfg.guard().num_predicted(),
        };
        check.agreement(time, (seen, hidden), &mut self.scores)
    }

    /// What to make of it, if it is less than usual.
    pub(super) fn disagreement(
        &mut self,
        cfg: &LearnConfig,
        index: usize,
        node: &Node,
        (agreement, num_checked): (f64, usize),
    ) -> Result<Option<Disagreement>> {
        if self.pasts.len() <= index {
            self.pasts.resize_with(index + 1, || None);
        }
        let place = &mut self.pasts[index];
        // Of a place that has grown much, early agreements say little: few visits predict badly.
        let num_visits = node.visits().len();
        let known = place.take().filter(|past| {
            past.agreements.len() == num_visits && num_visits < OUTGROWN * past.num_judged
        });
        let past = place.insert(match known {
            Some(known) => known,
            None => Past::of(cfg, node.log(), &mut self.scores)?,
        });
        let mut sorted: Vec<f64> = past.agreements.iter().flatten().copied().collect();
        sorted.sort_by(f64::total_cmp);
        let usual = Usual::of(&sorted);
        let num_past = sorted.len() as f64;
        let caution = num_past / (num_past + DOUBTED_VISITS);
        Ok((agreement < usual.low_recognised).then_some(Disagreement {
            agreement,
            usual,
            threshold: cfg.guard().tolerance() * usual.low * caution,
            num_checked,
        }))
    }

    /// The place at `index` has learnt a visit that agreed like this.
    pub(super) fn count_visit(&mut self, index: usize, agreement: Option<f64>) {
        if let Some(Some(past)) = self.pasts.get_mut(index) {
            past.agreements.push(agreement);
        }
    }

    /// The place at `index` has forgotten all visits but those `kept`.
    pub(super) fn retain(&mut self, index: usize, kept: &[bool]) {
        if let Some(Some(past)) = self.pasts.get_mut(index) {
            let mut kept = kept.iter();
            past.agreements.retain(|_| kept.next() == Some(&true));
        }
    }
}

impl Past {
    /// What a guard would know that has seen all visits come: how those agreed of which half are
    /// there by now, and how each one since did. Some fifteen fits, at most.
    fn of(cfg: &LearnConfig, log: &HistoryLog, scores: &mut Vec<f64>) -> Result<Self> {
        let num_visits = log.num_visits();
        let mut num_judged = cfg.guard().min_visits().clamp(1, num_visits.max(1));
        while num_judged * OUTGROWN <= num_visits {
            num_judged *= OUTGROWN;
        }
        let mut past = Self::found_out(cfg, &log.first(num_judged), scores)?;
        let mut model = None;
        for visit in num_judged..num_visits {
            let known = PlaceModel::at(cfg, log, visit, model.take())?;
            let check = Check {
                model: known.model(),
                pairs: known.pairs(),
                num_predicted: cfg.guard().num_predicted(),
            };
            let bits = (log.seen_row(visit), log.hidden_row(visit));
            let agreement = check.agreement(log.times()[visit], bits, scores);
            past.agreements
                .push(agreement.map(|(agreement, _)| agreement));
            model = Some(known);
        }
        Ok(past)
    }

    /// Takes runs of visits out of the log and checks them. Eight fits, at most.
    fn found_out(cfg: &LearnConfig, log: &HistoryLog, scores: &mut Vec<f64>) -> Result<Self> {
        let (num_visits, model_cfg) = (log.num_visits(), cfg.experience().visibility());
        let num_runs = NUM_RUNS.min(num_visits - 1);
        // The first visit has nothing before it.
        let mut agreements = vec![None];
        for run in 0..num_runs {
            let end = |share: usize| 1 + share * (num_visits - 1) / num_runs;
            let (start, end) = (end(run), end(run + 1));
            let mut others = BitRow::zeros(num_visits);
            (0..num_visits)
                .filter(|visit| !(start..end).contains(visit))
                .for_each(|visit| others.set(visit));
            let model = visibility::fit(log, model_cfg, Visits::Only(&others))?;
            let num_known = log.seen_row(start - 1).len();
            let check = Check {
                model: &*model,
                pairs: &identity(num_known.min(model.num_features())),
                num_predicted: cfg.guard().num_predicted(),
            };
            for visit in start..end {
                let bits = (log.seen_row(visit), log.hidden_row(visit));
                let agreement = check.agreement(log.times()[visit], bits, scores);
                agreements.push(agreement.map(|(agreement, _)| agreement));
            }
        }
        Ok(Self {
            agreements,
            num_judged: num_visits,
        })
    }
}

/// What should be seen, by a model of the place.
#[derive(Clone, Copy)]
struct Check<'a> {
    model: &'a dyn VisibilityModel,
    /// (feature of the place, feature of the model).
    pairs: &'a [(u32, u32)],
    num_predicted: usize,
}

impl Check<'_> {
    /// Which share of the features that are most likely at `time` was seen, and of how many that
    /// could be seen; `None` if these are too few.
    fn agreement(
        self,
        time: Time,
        (seen, hidden): (&BitRow, Option<&BitRow>),
        scores: &mut Vec<f64>,
    ) -> Option<(f64, usize)> {
        scores.clear();
        scores.resize(self.model.num_features(), 0.0);
        self.model.score_into(time, scores);
        let is_hidden = |id: u32| hidden.is_some_and(|hidden| hidden.get(id as usize));
        let mut checked: Vec<(u32, u32)> = (self.pairs.iter().copied())
            .filter(|&(id, _)| !is_hidden(id))
            .collect();
        let likelier = |a: &(u32, u32), b: &(u32, u32)| {
            let (score_a, score_b) = (scores[a.1 as usize], scores[b.1 as usize]);
            score_b.total_cmp(&score_a).then(a.0.cmp(&b.0))
        };
        if checked.len() > self.num_predicted {
            checked.select_nth_unstable_by(self.num_predicted, likelier);
            checked.truncate(self.num_predicted);
        }
        let num_seen = checked.iter().filter(|&&(id, _)| seen.get(id as usize));
        let share = num_seen.count() as f64 / checked.len() as f64;
        (checked.len() >= MIN_CHECKED).then_some((share, checked.len()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::MapMeta;

    fn fault(guard: &mut Guard, time: Time, circumstances: Circumstances) -> Option<ClockFault> {
        let map = Snapshot::empty(MapMeta::new(1, "star+brief", "default"));
        match guard.doubt_clock(&map, SessionId(1), time, &circumstances) {
            Some(QuarantineReason::Clock { fault, .. }) => Some(fault),
            _ => None,
        }
    }

    #[test]
    fn clocks_are_doubted_for_what_they_cannot_show() {
        let now = Time::parse("2026-05-01T12:00:00Z").expect("a time");
        let at = |s: i64| now.plus_us(s * 1_000_000);
        let live = Circumstances {
            now: Some(now),
            is_live: true,
            ..Circumstances::default()
        };
        let old = Circumstances {
            is_live: false,
            ..live
        };
        let mut guard = Guard::default();
        for (time, circumstances, expected) in [
            (Time::from_s(40), live, Some(ClockFault::Unset)),
            (at(0), live, None),
            (at(-60), live, None),
            (at(7_200), live, Some(ClockFault::Zone)),
            (at(-19_800), live, Some(ClockFault::Zone)),
            (at(7_200), old, Some(ClockFault::Zone)),
            (at(1_000_000), old, Some(ClockFault::Future)),
            // Old images may be as old as they like, and come in any order.
            (at(-19_800), old, None),
            (at(-400_000_000), old, None),
        ] {
            let found = fault(&mut guard, time, circumstances);
            assert_eq!(found, expected, "{time}");
        }
        let blind = Circumstances { now: None, ..live };
        let mut guard = Guard::default();
        assert_eq!(fault(&mut guard, at(0), blind), None);
        let back = fault(&mut guard, at(-500), blind);
        assert_eq!(back, Some(ClockFault::Backwards));
        assert_eq!(fault(&mut guard, at(9_000_000), blind), None);
    }
}
