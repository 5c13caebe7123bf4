//! Is this visit what it seems to be?
//!
//! A map that learns by itself believes its own mistakes, unless each visit is held against what was
//! expected of it before it is learnt (Krajník et al., IROS 2016, III-C). Three questions, in this order:
//!
//! 1. Can its time be right? ([`ClockFault`])
//! 2. Is anything to be seen? An image with fewer than [`GuardConfig::min_features`] features is *blind*.
//! 3. Does it agree with the prediction? Of the n features most likely at its time, those that could be
//!    seen are asked for: *agreement* = seen / asked. It is compared with the agreements of the place's
//!    own past visits, found in the same way: runs of visits are taken out of the log, and each
//!    visit of a run is predicted by a model of the others, from the features known before the run.
//!
//! ```text
//! threshold = tolerance * low * m / (m + 4)
//! ```
//!
//! with m past agreements and *low* the one that a tenth of them lie below (of fewer than ten, the lowest). The
//! last factor is caution: a few visits do not know how low an honest one may be. An image that agrees less than
//! *low*, and whose features agree with another place of the map better than with its own, is doubted as well.
//!
//! No distribution is assumed: an honest visit is as likely to be the lowest as any other, so with m of them
//! it falls below the lowest once in m + 1 times, and below half of it far less often. A place
//! whose visits were often not recognised (agreement 0) has a threshold of 0 and guards nothing; neither
//! does one of fewer than [`GuardConfig::min_visits`] visits.
//!
//! Cost: O(features) a visit. Models and past agreements are refreshed when a place has an eighth more visits
//! than the last time, which is up to nine fits; spread over these visits that is a constant number of
//! passes over the log. They are refreshed as well when a budget made the place forget: a budget of few more
//! features than a visit brings makes that happen at almost every visit.
//!
//! Not for deciding where an image was taken: that is `localize`. A doubtful visit is not lost
//! ([`Held`](crate::map::Held)): somebody who knows better may accept it.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::LearnConfig;
use crate::error::{Error, ErrorKind, Result};
use crate::map::{ClockFault, Doubt, Node, PlaceKey, SessionId, Snapshot};
use crate::time::Time;
use crate::visibility::{self, BitRow, VisibilityModel, Visits};

/// No camera's clock was right before 2000-01-01: it was never set.
const FIRST_TIME: Time = Time::from_s(946_684_800);
/// Clocks that agree this well are the same, s.
const SAME_CLOCK_S: f64 = 120.0;
/// Zones differ by multiples of this, s, and by at most [`MAX_ZONE_S`].
const ZONE_STEP_S: f64 = 900.0;
const MAX_ZONE_S: f64 = 14.0 * 3_600.0;
/// Runs that past visits are taken out in.
const NUM_RUNS: usize = 8;
/// With fewer features asked for, an agreement says nothing.
const MIN_ASKED: usize = 10;
/// Which of the past agreements is the low one.
const LOW_SHARE: f64 = 0.1;
/// So many past agreements are as good as none.
const DOUBTED_VISITS: f64 = 4.0;

/// Whose visits are judged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Judge {
    /// Nobody's.
    Never,
    /// Those that are added to a map by a robot or an update, not those that a map is built from.
    Updates,
    /// All.
    Always,
}

/// What becomes of a visit whose time cannot be right.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ClockPolicy {
    /// It is learnt like any other.
    Ignore,
    /// It is held, with the fault as the reason.
    Hold,
    /// It is refused: an error of kind [`ErrorKind::Time`].
    Refuse,
}

/// How visits are judged before they are learnt.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct GuardConfig {
    judge: Judge,
    clock: ClockPolicy,
    min_visits: usize,
    num_predicted: usize,
    tolerance: f64,
    min_features: usize,
}

impl Default for GuardConfig {
    /// Updates are judged, from the fifth visit of a place on.
    fn default() -> Self {
        Self {
            judge: Judge::Updates,
            clock: ClockPolicy::Hold,
            min_visits: 5,
            num_predicted: 50,
            tolerance: 0.5,
            min_features: 10,
        }
    }
}

impl GuardConfig {
    pub(super) fn check(&self) -> Result<()> {
        let message = if !(0.0..=1.0).contains(&self.tolerance) {
            format!(
                "guard: tolerance lies between 0 and 1, not at {}",
                self.tolerance
            )
        } else if self.num_predicted < MIN_ASKED {
            format!(
                "guard: num-predicted must be at least {MIN_ASKED}, not {}",
                self.num_predicted
            )
        } else if self.min_visits < 2 {
            "guard: min-visits must be at least 2: one visit has no past".into()
        } else {
            return Ok(());
        };
        Err(Error::new(ErrorKind::Config, message))
    }

    /// Judges these visits.
    #[must_use]
    pub fn with_judge(mut self, judge: Judge) -> Self {
        self.judge = judge;
        self
    }

    /// Does this with visits whose time cannot be right.
    #[must_use]
    pub fn with_clock(mut self, clock: ClockPolicy) -> Self {
        self.clock = clock;
        self
    }

    /// Whose visits are judged.
    pub fn judge(&self) -> Judge {
        self.judge
    }

    /// What becomes of a visit whose time cannot be right.
    pub fn clock(&self) -> ClockPolicy {
        self.clock
    }

    /// A place with fewer visits is not asked whether it agrees.
    pub fn min_visits(&self) -> usize {
        self.min_visits
    }

    /// How many features are predicted.
    pub fn num_predicted(&self) -> usize {
        self.num_predicted
    }

    /// The share of a low past agreement that a new one must reach.
    pub fn tolerance(&self) -> f64 {
        self.tolerance
    }

    /// An image with fewer features is blind.
    pub fn min_features(&self) -> usize {
        self.min_features
    }
}

/// How an image came in, where that is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Circumstances {
    /// What the machine's clock says.
    pub now: Option<Time>,
    /// The image was taken just now, and after those before it.
    pub is_live: bool,
    /// The grey levels that all but the darkest and the brightest hundredth of its pixels lie between.
    pub gray_range: Option<(u8, u8)>,
}

/// What is expected of the visits of one place.
#[derive(Debug)]
struct Expectation {
    /// Visits of the place when this was found out.
    num_visits: usize,
    model: Box<dyn VisibilityModel>,
    /// The agreements of past visits, ascending.
    past: Vec<f64>,
}

/// A visit that agrees less than usual.
#[derive(Clone, Copy, Debug)]
pub(super) struct Disagreement {
    agreement: f64,
    low: f64,
    threshold: f64,
    expected: f64,
    num_asked: usize,
}

impl Disagreement {
    /// Whether that is reason enough to doubt it, if it looks like another place or like none.
    pub(super) fn judged(self, looks_like: Option<PlaceKey>) -> Option<Doubt> {
        let threshold = if looks_like.is_some() {
            self.low
        } else {
            self.threshold
        };
        (self.agreement < threshold).then_some(Doubt::Disagreement {
            agreement: self.agreement,
            threshold,
            expected: self.expected,
            num_predicted: self.num_asked,
            looks_like,
        })
    }
}

/// Judges visits.
#[derive(Debug, Default)]
pub(super) struct Guard {
    /// By position of the place.
    expectations: Vec<Option<Expectation>>,
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
    ) -> Option<Doubt> {
        let newest = (snapshot.nodes.iter())
            .filter_map(|node| node.log.times().last())
            .max();
        if newest.is_some_and(|&newest| newest < FIRST_TIME) {
            return None;
        }
        let fault = |fault, off_s| Some(Doubt::Clock { fault, off_s });
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

    /// How the visit agrees with what was predicted of the place at `index`, if that is less than usual:
    /// `seen` and `hidden` say what was found of the features known so far.
    pub(super) fn doubt_view(
        &mut self,
        cfg: &LearnConfig,
        index: usize,
        node: &Node,
        time: Time,
        seen: &BitRow,
        hidden: Option<&BitRow>,
    ) -> Result<Option<Disagreement>> {
        if node.visits.len() < cfg.guard().min_visits() {
            return Ok(None);
        }
        if self.expectations.len() <= index {
            self.expectations.resize_with(index + 1, || None);
        }
        let known = self.expectations[index].take().filter(|it| {
            let num_new = node.visits.len().checked_sub(it.num_visits);
            num_new.is_some_and(|num_new| num_new <= it.num_visits / NUM_RUNS)
                && it.model.num_features() <= node.features.len()
        });
        let expectation = match known {
            Some(known) => known,
            None => Expectation::of(cfg, node, &mut self.scores)?,
        };
        let asked = ask(
            &*expectation.model,
            time,
            cfg.guard().num_predicted(),
            expectation.model.num_features(),
            (seen, hidden),
            &mut self.scores,
        );
        let low = expectation.low();
        let num_past = expectation.past.len() as f64;
        let caution = num_past / (num_past + DOUBTED_VISITS);
        let doubt =
            asked
                .filter(|&(agreement, _)| agreement < low)
                .map(|(agreement, num_asked)| Disagreement {
                    agreement,
                    low,
                    threshold: cfg.guard().tolerance() * low * caution,
                    expected: expectation.median(),
                    num_asked,
                });
        self.expectations[index] = Some(expectation);
        Ok(doubt)
    }

    /// Forgets what is expected of a place whose features were numbered anew.
    pub(super) fn forget(&mut self, index: usize) {
        if let Some(expectation) = self.expectations.get_mut(index) {
            *expectation = None;
        }
    }
}

impl Expectation {
    /// Takes runs of visits out of the log and asks for them. Nine fits, at most.
    fn of(cfg: &LearnConfig, node: &Node, scores: &mut Vec<f64>) -> Result<Self> {
        let log = &node.log;
        let (num_visits, model_cfg) = (log.num_visits(), cfg.experience().visibility());
        let num_runs = NUM_RUNS.min(num_visits - 1);
        let mut past = Vec::with_capacity(num_visits);
        for run in 0..num_runs {
            // The first visit has nothing before it.
            let end = |share: usize| 1 + share * (num_visits - 1) / num_runs;
            let (start, end) = (end(run), end(run + 1));
            let mut others = BitRow::zeros(num_visits);
            (0..num_visits)
                .filter(|visit| !(start..end).contains(visit))
                .for_each(|visit| others.set(visit));
            let model = visibility::fit(log, model_cfg, Visits::Only(&others))?;
            let num_known = log.seen_row(start - 1).len();
            for visit in start..end {
                let bits = (log.seen_row(visit), log.hidden_row(visit));
                let time = log.times()[visit];
                let asked = ask(
                    &*model,
                    time,
                    cfg.guard().num_predicted(),
                    num_known,
                    bits,
                    scores,
                );
                past.extend(asked.map(|(agreement, _)| agreement));
            }
        }
        past.sort_by(f64::total_cmp);
        Ok(Self {
            num_visits,
            model: visibility::fit(log, model_cfg, Visits::All)?,
            past,
        })
    }

    /// A low past agreement; 0 where none is known.
    fn low(&self) -> f64 {
        let at = (LOW_SHARE * self.past.len() as f64) as usize;
        self.past.get(at).copied().unwrap_or_default()
    }

    fn median(&self) -> f64 {
        (self.past.get(self.past.len() / 2).copied()).unwrap_or_default()
    }
}

/// Which share of the features that are most likely at `time` was seen, and of how many that could be
/// seen; `None` if these are too few. Only the first `num_known` features are asked for.
fn ask(
    model: &dyn VisibilityModel,
    time: Time,
    num_predicted: usize,
    num_known: usize,
    (seen, hidden): (&BitRow, Option<&BitRow>),
    scores: &mut Vec<f64>,
) -> Option<(f64, usize)> {
    scores.clear();
    scores.resize(model.num_features(), 0.0);
    model.score_into(time, scores);
    let is_hidden = |id: usize| hidden.is_some_and(|hidden| hidden.get(id));
    let mut asked: Vec<usize> = (0..num_known.min(scores.len()))
        .filter(|&id| !is_hidden(id))
        .collect();
    let likelier = |a: &usize, b: &usize| scores[*b].total_cmp(&scores[*a]).then(a.cmp(b));
    if asked.len() > num_predicted {
        asked.select_nth_unstable_by(num_predicted, likelier);
        asked.truncate(num_predicted);
    }
    let num_seen = asked.iter().filter(|&&id| seen.get(id)).count();
    (asked.len() >= MIN_ASKED).then(|| (num_seen as f64 / asked.len() as f64, asked.len()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::MapMeta;

    fn fault(guard: &mut Guard, time: Time, circumstances: Circumstances) -> Option<ClockFault> {
        let map = Snapshot::empty(MapMeta::new(1, "star+brief", "default"));
        match guard.doubt_clock(&map, SessionId(1), time, &circumstances) {
            Some(Doubt::Clock { fault, .. }) => Some(fault),
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
            gray_range: None,
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

    #[test]
    fn senseless_numbers_are_refused() {
        for text in [
            "tolerance = 1.5",
            "num-predicted = 3",
            "min-visits = 1",
            "tolerance = nan",
        ] {
            let cfg: GuardConfig = toml::from_str(text).expect("well-formed");
            assert!(cfg.check().is_err(), "{text}");
        }
        assert!(GuardConfig::default().check().is_ok());
    }
}
