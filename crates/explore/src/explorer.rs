//! Where now? The loop of a robot that explores, day after day.

use fremen::online::OnlineConfig;
use fremen::{Error, ErrorKind, Period, Result, Time};

use crate::beliefs::Beliefs;
use crate::explored::Explored;
use crate::informed::{greedy, monte_carlo};
use crate::novelty::{NOVEL_BITS, surprise_bits};
use crate::outlook::Outlook;
use crate::plan::{Plan, Reason, Share, Visit};
use crate::random::Random;
use crate::slots::Slots;
use crate::strategy::Strategy;
use crate::uninformed::{random, round_robin};
use crate::worth::Worth;

/// How a robot explores.
#[derive(Clone, Debug, PartialEq)]
pub struct ExploreConfig {
    strategy: Strategy,
    share: Share,
    seed: u64,
    slot: Period,
    floor_bits: f64,
}

impl ExploreConfig {
    /// This strategy, half of the time, slots of ten minutes, seed 0.
    pub fn new(strategy: Strategy) -> Result<Self> {
        Ok(Self {
            strategy,
            share: Share::new(0.5)?,
            seed: 0,
            slot: crate::plan::usual_slot()?,
            floor_bits: 0.02,
        })
    }

    /// So much of the slots at most.
    #[must_use]
    pub fn with_share(mut self, share: Share) -> Self {
        self.share = share;
        self
    }

    /// Whatever is drawn follows from this.
    #[must_use]
    pub fn with_seed(mut self, seed: u64) -> Self {
        self.seed = seed;
        self
    }

    /// How long a visit takes.
    #[must_use]
    pub fn with_slot(mut self, slot: Period) -> Self {
        self.slot = slot;
        self
    }

    /// The strategy.
    pub fn strategy(&self) -> Strategy {
        self.strategy
    }

    /// The share of the slots.
    pub fn share(&self) -> Share {
        self.share
    }

    /// The length of a slot.
    pub fn slot(&self) -> Period {
        self.slot
    }
}

/// Plans, goes on from what was seen, and learns.
#[derive(Debug)]
pub struct Explorer {
    cfg: ExploreConfig,
    beliefs: Beliefs,
    /// What is expected of the next minutes, for novelty.
    expected: Option<Beliefs>,
    random: Random,
    turn: usize,
    present: Option<Present>,
    num_rerouted: usize,
}

/// The stretch of time that is planned.
#[derive(Debug)]
struct Present {
    plan: Plan,
    /// For plans that are made anew after every visit.
    outlook: Option<Outlook>,
    /// Visits that are left.
    budget: usize,
    /// Decides between looks that are worth the same.
    nudge_seed: u64,
    /// The visit under way, not yet taken up.
    visited: Option<Visit>,
}

impl Explorer {
    /// A robot that knows the places' names and numbers of states, and nothing else.
    pub fn new<'a>(
        places: impl IntoIterator<Item = (&'a str, usize)>,
        model: &OnlineConfig,
        cfg: ExploreConfig,
    ) -> Self {
        let places: Vec<_> = places.into_iter().collect();
        let expected = (cfg.strategy == Strategy::Novelty)
            .then(|| Beliefs::new(places.iter().copied(), &OnlineConfig::short_term()));
        Self {
            beliefs: Beliefs::new(places, model),
            expected,
            random: Random::new(cfg.seed),
            turn: 0,
            present: None,
            num_rerouted: 0,
            cfg,
        }
    }

    /// What it believes.
    pub fn beliefs(&self) -> &Beliefs {
        &self.beliefs
    }

    /// The plan as it stands.
    pub fn present_plan(&self) -> Option<&Plan> {
        self.present.as_ref().map(|present| &present.plan)
    }

    /// Draws conclusions from what was seen, and plans the `num_slots` slots from `start` on.
    pub fn plan(&mut self, start: Time, num_slots: usize) -> Result<&Plan> {
        self.beliefs.learn()?;
        let slots = Slots::new(start, self.cfg.slot, num_slots)?;
        let made = make(
            &self.beliefs,
            slots,
            &self.cfg,
            &mut self.turn,
            &mut self.random,
        )?;
        let present = self.present.insert(Present {
            plan: made.plan,
            outlook: made.outlook,
            budget: self.cfg.share.budget(&slots),
            nudge_seed: made.nudge_seed,
            visited: None,
        });
        Ok(&present.plan)
    }

    /// Where to be in `slot` of the present plan, which may have changed by what was seen since.
    /// Slots are asked for in order, and each once.
    pub fn next(&mut self, slot: usize) -> Result<Option<Visit>> {
        let Some(present) = &mut self.present else {
            return Ok(None);
        };
        if let (Some(outlook), Some(visit)) = (&mut present.outlook, present.visited.take()) {
            outlook.visited(&self.beliefs, visit.place, visit.slot)?;
            let before = present.plan.visit(slot).map(|visit| visit.place);
            let Present {
                plan,
                budget,
                nudge_seed,
                ..
            } = present;
            choose(plan, outlook, &self.beliefs, *budget, *nudge_seed, slot);
            let after = plan.visit(slot).map(|visit| visit.place);
            self.num_rerouted += usize::from(before != after);
        }
        if let Some(expected) = &self.expected
            && let Some((place, bits)) = most_novel(&self.beliefs, expected, &present.plan, slot)?
        {
            self.num_rerouted += usize::from(go_back(&mut present.plan, slot, place, bits));
        }
        let visit = present.plan.visit(slot).copied();
        present.visited = visit;
        present.budget = present.budget.saturating_sub(usize::from(visit.is_some()));
        Ok(visit)
    }

    /// Takes what was seen.
    pub fn observe(&mut self, place: usize, time: Time, states: &[bool]) -> Result<()> {
        if let Some(expected) = &mut self.expected {
            expected.observe(place, time, states)?;
        }
        self.beliefs.observe(place, time, states)
    }

    /// How often a visit was changed by what was seen since the plan was made.
    pub fn num_rerouted(&self) -> usize {
        self.num_rerouted
    }
}

/// Plans `slots` by what is believed, learnt from now or fitted before.
///
/// Without places a plan has no visits. Fails where a model gives no probability.
pub fn plan(explored: &dyn Explored, slots: Slots, cfg: &ExploreConfig) -> Result<Plan> {
    let mut random = Random::new(cfg.seed);
    Ok(make(explored, slots, cfg, &mut 0, &mut random)?.plan)
}

/// Visits of a stretch of time that were made already.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MadeVisits {
    /// Slots and places; several places of one slot count as one visit.
    pub at: Vec<(usize, usize)>,
    /// Visits to places that are not explored.
    pub elsewhere: usize,
}

impl MadeVisits {
    /// Slots that were spent.
    fn num_slots(&self) -> usize {
        let mut slots: Vec<usize> = self.at.iter().map(|&(slot, _)| slot).collect();
        slots.sort_unstable();
        slots.dedup();
        slots.len() + self.elsewhere
    }
}

/// Plans what is left of `slots` from slot `from` on, after `made`: these are taken off the share of
/// time, and looks at about the same hour count less ([`Strategy::Information`]).
///
/// Fails as [`plan`] does, and for visits that are not in slots before `from` or at no such place.
pub fn plan_rest(
    explored: &dyn Explored,
    slots: Slots,
    cfg: &ExploreConfig,
    from: usize,
    made: &MadeVisits,
) -> Result<Plan> {
    let num_places = explored.num_places();
    if let Some((slot, place)) = (made.at.iter())
        .find(|&&(slot, place)| slot >= from.min(slots.len()) || place >= num_places)
    {
        return Err(Error::new(
            ErrorKind::NotFound,
            format!(
                "no visit to place {place} of {num_places} in slot {slot} was made before slot {from}"
            ),
        ));
    }
    let mut plan = Plan::empty(slots);
    let budget = cfg.share.budget(&slots).saturating_sub(made.num_slots());
    if from >= slots.len() {
        return Ok(plan);
    }
    let mut random = Random::new(cfg.seed);
    let nudge_seed = random.next_u64();
    if cfg.strategy == Strategy::Information {
        let mut outlook = Outlook::new(explored, &slots)?;
        let mut at = made.at.clone();
        at.sort_unstable();
        for (slot, place) in at {
            outlook.made(place, slot);
        }
        choose(&mut plan, &outlook, explored, budget, nudge_seed, from);
        return Ok(plan);
    }
    let rest = Slots::new(slots.begin(from), slots.length(), slots.len() - from)?;
    let worth = Worth::new(explored, &rest)?;
    let last = made.at.iter().max().map(|&(_, place)| place + 1);
    let mut turn = last.unwrap_or_default();
    let budget = budget.min(rest.len());
    let of_rest = by_worth(cfg, rest, budget, &worth, &mut turn, &mut random);
    for visit in of_rest.visits() {
        plan.set(
            from + visit.slot,
            visit.place,
            visit.info_bits,
            visit.reason,
        );
    }
    Ok(plan)
}

/// A plan with what is needed to go on from it.
struct Made {
    plan: Plan,
    outlook: Option<Outlook>,
    nudge_seed: u64,
}

fn make(
    explored: &dyn Explored,
    slots: Slots,
    cfg: &ExploreConfig,
    turn: &mut usize,
    random: &mut Random,
) -> Result<Made> {
    let nudge_seed = random.next_u64();
    if cfg.strategy != Strategy::Information {
        let worth = Worth::new(explored, &slots)?;
        return Ok(Made {
            plan: by_worth(cfg, slots, cfg.share.budget(&slots), &worth, turn, random),
            outlook: None,
            nudge_seed,
        });
    }
    let outlook = Outlook::new(explored, &slots)?;
    let mut plan = Plan::empty(slots);
    let budget = cfg.share.budget(&slots);
    choose(&mut plan, &outlook, explored, budget, nudge_seed, 0);
    Ok(Made {
        plan,
        outlook: Some(outlook),
        nudge_seed,
    })
}

/// Plans of the strategies that look at the uncertainty of states, or at nothing.
fn by_worth(
    cfg: &ExploreConfig,
    slots: Slots,
    budget: usize,
    worth: &Worth,
    turn: &mut usize,
    draw: &mut Random,
) -> Plan {
    match cfg.strategy {
        Strategy::Greedy => greedy(slots, budget, worth, draw),
        Strategy::RoundRobin => round_robin(slots, budget, worth, turn),
        Strategy::Random => random(slots, budget, worth, draw),
        Strategy::MonteCarlo | Strategy::Novelty | Strategy::Information => {
            monte_carlo(slots, budget, worth, cfg.floor_bits, draw)
        }
    }
}

/// Looks that are worth the same to this share are chosen between by the seed.
const NUDGE: f64 = 0.01;

/// Plans the slots from `from` on anew by what a look leaves behind.
fn choose(
    plan: &mut Plan,
    outlook: &Outlook,
    explored: &dyn Explored,
    budget: usize,
    seed: u64,
    from: usize,
) {
    let nudge = |place: usize, slot: usize| {
        let at = ((place as u64) << 32) | slot as u64;
        NUDGE * Random::new(seed ^ at.wrapping_mul(0xD6E8_FEB8_6659_FD93)).unit()
    };
    for slot in from..plan.slots().len() {
        plan.clear(slot);
    }
    for chosen in outlook.choose(from, budget, nudge) {
        let reason = outlook.reason(explored, &chosen);
        let info_bits = reason.bits_left().unwrap_or_default();
        plan.set(chosen.slot, chosen.place, info_bits, reason);
    }
}

/// The place that was the greatest surprise lately, if any was.
fn most_novel(
    beliefs: &Beliefs,
    expected: &Beliefs,
    plan: &Plan,
    slot: usize,
) -> Result<Option<(usize, f64)>> {
    let time = plan.slots().middle(slot);
    let mut novel: Option<(usize, f64)> = None;
    for place in 0..beliefs.num_places() {
        let bits = surprise_bits(beliefs, expected, place, time)?;
        if bits > NOVEL_BITS && novel.is_none_or(|(_, most)| bits > most) {
            novel = Some((place, bits));
        }
    }
    Ok(novel)
}

/// Whether the visit of `slot` was changed to go back to `place`. Where the slot was to be spent on
/// other tasks, the later visit that is worth least makes room, so that the share stays what it is.
fn go_back(plan: &mut Plan, slot: usize, place: usize, bits: f64) -> bool {
    match plan.visit(slot) {
        Some(visit) if visit.place == place => return false,
        Some(_) => {}
        None => {
            let later = plan.visits().filter(|visit| visit.slot > slot);
            let least = later.min_by(|a, b| a.info_bits.total_cmp(&b.info_bits));
            match least.map(|visit| visit.slot) {
                Some(least) => plan.clear(least),
                None => return false,
            }
        }
    }
    plan.set(slot, place, bits, Reason::Surprise { bits });
    true
}
