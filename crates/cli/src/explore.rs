//! When and where should a robot look next?

use std::path::PathBuf;

use anyhow::Result;
use clap::{Args, Subcommand};
use fremen::online::OnlineConfig;
use fremen::time::{TimeUnit, Zone};
use fremen::{Error, ErrorKind, Period, Time};
use fremen_explore::{
    Charger, ExploreConfig, Explored, MadeVisits, Opening, Plan, Roads, Share, Slots, Stop,
    Strategy, TourConfig, plan, plan_rest, plan_tour, prospects, simulate,
};
use serde_json::json;

use super::explore_data::{Known, Reading, known, recording};
use super::explore_output::{Form, PlannedVisit, show};
use super::unpacked::unpacked;
use chronotope_terminal::arguments::named;
use chronotope_terminal::{Outcome, Output};

/// Plan where to look when, so that what is known of places stays true.
///
/// DATA is a map, whose places show their features, or CSV files of a 0/1 series each (rows are
/// TIME,STATE as for `spectrum`), whose places are named as the files.
#[derive(Debug, Subcommand)]
#[command(after_help = "\
Examples:
  chronotope explore plan kitchen.csv office.csv --from 2024-05-02T00:00:00Z
  chronotope explore next kitchen.csv office.csv --now 2024-05-02T08:30:00Z
  chronotope explore simulate kitchen.csv office.csv --seeds 20
  chronotope explore explain kitchen.csv office.csv --at 2024-05-02T08:30:00Z")]
pub(super) enum ExploreCommand {
    Plan(PlanArgs),
    Next(NextArgs),
    Simulate(SimulateArgs),
    Explain(ExplainArgs),
}

/// What is explored, and how.
#[derive(Debug, Args)]
struct Common {
    /// A map, or CSV files of one place each.
    #[arg(required = true)]
    data: Vec<PathBuf>,
    /// What is believed of a series: how it is learnt.
    #[arg(long, default_value = "histogram-persistent", value_parser = named::<OnlineConfig>(OnlineConfig::names().iter().copied()))]
    model: OnlineConfig,
    /// What times that are numbers count: ns, us, ms, s, min, h, d (since 1970), excel or julian.
    #[arg(long, value_name = "UNIT")]
    time_unit: Option<TimeUnit>,
    /// Rhythms of series follow the clocks of this zone.
    #[arg(long, value_name = "ZONE")]
    zone: Option<Zone>,
    /// How visits are chosen.
    #[arg(long, default_value = "information", value_parser = named::<Strategy>(Strategy::ALL.map(Strategy::name)))]
    strategy: Strategy,
    /// The share of the slots that may be spent on visits, from 0 to 1.
    #[arg(long, default_value_t = 0.5, allow_negative_numbers = true)]
    share: f64,
    /// How long a visit takes, in seconds.
    #[arg(
        long,
        value_name = "SECONDS",
        default_value_t = 600.0,
        allow_negative_numbers = true
    )]
    slot_s: f64,
    /// How many slots are planned.
    #[arg(long, default_value_t = 144)]
    slots: usize,
    /// Whatever is drawn follows from this.
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

/// The visits of a day: which place, from when to when, and why.
#[derive(Debug, Args)]
#[command(after_help = "\
What was seen from --from on is not looked at. With --roads driving takes time: a text of lines
`node NAME` and `link NAME NAME SECONDS`.

Examples:
  chronotope explore plan kitchen.csv office.csv --from 2024-05-02T00:00:00Z
  chronotope explore plan kitchen.csv office.csv --from 2024-05-02T00:00:00Z --ics > looks.ics
  chronotope explore plan street.map --from 2024-05-02T00:00:00Z --strategy monte-carlo --seed 7 --json
  chronotope explore plan *.csv --from 2024-05-02T00:00:00Z --roads house.txt --at kitchen \\
      --charger kitchen --run-s 14400 --charge-s 3600 --open office=2024-05-02T08:00:00Z/2024-05-02T18:00:00Z")]
pub(super) struct PlanArgs {
    #[command(flatten)]
    common: Common,
    /// When the first slot begins, in RFC 3339 with an offset.
    #[arg(long)]
    from: Time,
    #[command(flatten)]
    driving: Driving,
    #[command(flatten)]
    form: FormArgs,
}

#[derive(Debug, Args)]
struct Driving {
    /// Travel times between the places.
    #[arg(long, value_name = "FILE")]
    roads: Option<PathBuf>,
    /// Where the robot is at first; the first place otherwise.
    #[arg(long, value_name = "PLACE", requires = "roads")]
    at: Option<String>,
    /// Where it is charged.
    #[arg(long, value_name = "PLACE", requires_all = ["roads", "run_s", "charge_s"])]
    charger: Option<String>,
    /// How long it can be away from the charger, in seconds.
    #[arg(
        long,
        value_name = "SECONDS",
        requires = "charger",
        allow_negative_numbers = true
    )]
    run_s: Option<f64>,
    /// How long a charging takes, in seconds.
    #[arg(
        long,
        value_name = "SECONDS",
        requires = "charger",
        allow_negative_numbers = true
    )]
    charge_s: Option<f64>,
    /// A place that can be visited from one time to another only (may be given again).
    #[arg(long, value_name = "PLACE=FROM/TO", requires = "roads")]
    open: Vec<String>,
}

#[derive(Debug, Args)]
struct FormArgs {
    /// One JSON object for each visit.
    #[arg(long, group = "form")]
    json: bool,
    /// CSV with a header.
    #[arg(long, group = "form")]
    csv: bool,
    /// A calendar (iCalendar).
    #[arg(long, group = "form")]
    ics: bool,
}

impl FormArgs {
    fn form(&self) -> Form {
        match (self.json, self.csv, self.ics) {
            (true, ..) => Form::Json,
            (_, true, _) => Form::Csv,
            (.., true) => Form::Ics,
            _ => Form::Table,
        }
    }
}

/// Where to go now, given all that was seen until now.
#[derive(Debug, Args)]
#[command(after_help = "\
Plans from now on and shows the first visit. Call it again after each look, with what was seen added
to DATA: what was seen changes where to look next. With --day-from the slots of a day are counted from
there: every slot of it in which DATA has a look is a visit that was made, and is taken off --share.
Visits that DATA does not have are named by --visited. Nothing is printed once the share is spent.

Examples:
  chronotope explore next kitchen.csv office.csv --now 2024-05-02T08:30:00Z --json
  chronotope explore next kitchen.csv office.csv --now 2024-05-02T08:30:00Z \\
      --day-from 2024-05-02T00:00:00Z --visited garage=2024-05-02T07:10:00Z")]
pub(super) struct NextArgs {
    #[command(flatten)]
    common: Common,
    /// The time; that of the system's clock otherwise.
    #[arg(long)]
    now: Option<Time>,
    /// When the day began whose share of time is spent; now otherwise.
    #[arg(long, value_name = "TIME")]
    day_from: Option<Time>,
    /// A visit since then that DATA does not have, to any place (may be given again).
    #[arg(long, value_name = "PLACE=TIME", requires = "day_from")]
    visited: Vec<String>,
    #[command(flatten)]
    form: FormArgs,
}

/// How well a robot would have known these places that had explored them.
#[derive(Debug, Args)]
#[command(after_help = "\
Plays the series through: the robot begins with nothing, plans --slots slots at a time, is shown what
it visits and nothing else, and learns. The error is the share of states that it has wrong.

Examples:
  chronotope explore simulate kitchen.csv office.csv --seeds 20
  chronotope explore simulate kitchen.csv office.csv --strategy monte-carlo --model fremen --json
  chronotope explore simulate kitchen.csv office.csv --share 0.1 --by-day --json")]
pub(super) struct SimulateArgs {
    #[command(flatten)]
    common: Common,
    /// So many times, with seeds from --seed on.
    #[arg(long, default_value_t = 1)]
    seeds: u64,
    /// Also print the error of each planned stretch.
    #[arg(long)]
    by_day: bool,
    /// One JSON object for each seed.
    #[arg(long)]
    json: bool,
}

/// Why a slot goes to a place: what a look would be worth at each of them.
#[derive(Debug, Args)]
#[command(after_help = "\
Places are ranked by `value`: the uncertainty of their states (4 p (1 - p), which is 1 for a coin)
for as many slots as what is seen stays true, and what a look tells of the model.

Example:
  chronotope explore explain kitchen.csv office.csv --at 2024-05-02T08:30:00Z")]
pub(super) struct ExplainArgs {
    #[command(flatten)]
    common: Common,
    /// The time of the look, in RFC 3339 with an offset; what was seen later is not looked at.
    #[arg(long)]
    at: Time,
    /// One JSON object for each place.
    #[arg(long)]
    json: bool,
}

impl Common {
    fn reading(&self) -> Reading<'_> {
        Reading {
            unit: self.time_unit,
            zone: self.zone.as_ref(),
            model: &self.model,
        }
    }

    fn slots(&self, from: Time) -> fremen::Result<Slots> {
        Slots::of_s(from, self.slot_s, self.slots)
    }

    fn cfg(&self, slots: &Slots) -> fremen::Result<ExploreConfig> {
        Ok(ExploreConfig::new(self.strategy)?
            .with_share(Share::new(self.share)?)
            .with_slot(slots.length())
            .with_seed(self.seed))
    }

    fn known(&self, since: Time, before: Time) -> Result<Known> {
        let known = known(&self.data, &self.reading(), since, before)?;
        if known.num_later > 0 {
            note!(
                "note: {} looks from {before} on are left out: a plan knows the past only",
                known.num_later
            );
        }
        Ok(known)
    }
}

pub(super) fn run(command: &ExploreCommand, out: &mut Output) -> Result<Outcome> {
    match command {
        ExploreCommand::Plan(args) => run_plan(args, out),
        ExploreCommand::Next(args) => run_next(args, out),
        ExploreCommand::Simulate(args) => run_simulate(args, out),
        ExploreCommand::Explain(args) => run_explain(args, out),
    }
}

fn run_plan(args: &PlanArgs, out: &mut Output) -> Result<Outcome> {
    let slots = args.common.slots(args.from)?;
    let cfg = args.common.cfg(&slots)?;
    let known = args.common.known(args.from, args.from)?;
    let visits = match &args.driving.roads {
        None => planned(&known.places, &plan(&known.places, slots, &cfg)?),
        Some(roads) => driven(args, roads, &known, &slots)?,
    };
    show(&visits, args.form.form(), args.from, out)?;
    Ok(Outcome::Good)
}

fn planned(places: &dyn Explored, plan: &Plan) -> Vec<PlannedVisit> {
    let visits = plan.visits().map(|visit| PlannedVisit {
        start: visit.start,
        end: visit.end,
        place: places.name(visit.place).to_owned(),
        info_bits: visit.info_bits,
        reason: visit.reason.to_string(),
    });
    visits.collect()
}

/// The visits of a tour, and when it is charged.
fn driven(
    args: &PlanArgs,
    roads: &PathBuf,
    known: &Known,
    slots: &Slots,
) -> Result<Vec<PlannedVisit>> {
    let places = &known.places;
    let names: Vec<&str> = (0..places.num_places())
        .map(|place| places.name(place))
        .collect();
    let place = |name: &str| -> fremen::Result<usize> {
        names.iter().position(|it| *it == name).ok_or_else(|| {
            Error::new(ErrorKind::NotFound, format!("there is no place `{name}`"))
                .with_help(format!("places are {}", names.join(", ")))
        })
    };
    let text = unpacked(roads)?;
    let text = std::str::from_utf8(&text).map_err(|cause| {
        Error::new(ErrorKind::Format, "this is no text")
            .with_path(roads)
            .with_source(cause)
    })?;
    let ways = Roads::parse(text, &names).map_err(|error| error.with_path(roads))?;
    let driving = &args.driving;
    let at = driving.at.as_deref().map_or(Ok(0), place)?;
    let common = &args.common;
    let mut cfg = TourConfig::new(slots.start(), slots.end(), at, names.len(), common.slot_s)?
        .with_budget_s(Share::new(common.share)?.get() * slots.end().since_s(slots.start()))?;
    if let (Some(charger), Some(run_s), Some(charge_s)) =
        (&driving.charger, driving.run_s, driving.charge_s)
    {
        cfg = cfg.with_charger(Charger {
            place: place(charger)?,
            run_s,
            charge_s,
        })?;
    }
    let mut openings: Vec<Vec<Opening>> = vec![Vec::new(); names.len()];
    for text in &driving.open {
        let (name, opening) = opening(text)?;
        openings[place(name)?].push(opening);
    }
    for (place, openings) in openings.into_iter().enumerate() {
        cfg = cfg.with_openings(place, openings)?;
    }
    for (place, name) in names.iter().enumerate() {
        if ways.travel_s(at, place).is_none() {
            note!("note: there is no way from `{}` to `{name}`", names[at]);
        }
    }
    let tour = plan_tour(places, slots, &ways, &cfg)?;
    let stops = tour.stops.iter().map(|stop| {
        let (info_bits, reason) = match stop.stop {
            Stop::Visit { value } => (value, "teaches most for the time that it takes".to_owned()),
            Stop::Charge => (0.0, "charging".to_owned()),
        };
        PlannedVisit {
            start: stop.start,
            end: stop.end,
            place: names[stop.place].to_owned(),
            info_bits,
            reason,
        }
    });
    Ok(stops.collect())
}

/// `PLACE=FROM/TO`.
fn opening(text: &str) -> fremen::Result<(&str, Opening)> {
    let parts = text.rsplit_once('=').and_then(|(name, times)| {
        let (from, to) = times.split_once('/')?;
        Some((name, Time::parse(from).ok()?, Time::parse(to).ok()?))
    });
    match parts {
        Some((name, from, to)) if from < to => Ok((name, Opening { from, to })),
        _ => Err(Error::new(
            ErrorKind::Config,
            format!("`{text}` does not say when a place is open"),
        )
        .with_help("write PLACE=FROM/TO with times in RFC 3339, the earlier one first")),
    }
}

fn run_next(args: &NextArgs, out: &mut Output) -> Result<Outcome> {
    let now = args.now.unwrap_or_else(Time::now);
    let day_from = args.day_from.unwrap_or(now);
    if day_from > now {
        return Err(Error::new(
            ErrorKind::Config,
            format!("a day that begins at {day_from} is not under way at {now}"),
        )
        .with_help("give --day-from a time before --now")
        .into());
    }
    let slots = args.common.slots(day_from)?;
    let cfg = args.common.cfg(&slots)?;
    let known = args.common.known(day_from, now)?;
    let made = made(args, &known, &slots, now)?;
    // The slot under way belongs to what is done already, unless it begins now.
    let passed = |slot: &usize| slots.begin(*slot) < now;
    let from = (0..slots.len()).take_while(passed).count();
    let plan = plan_rest(&known.places, slots, &cfg, from, &made)?;
    let mut visits = planned(&known.places, &plan);
    visits.truncate(1);
    show(&visits, args.form.form(), now, out)?;
    Ok(Outcome::Good)
}

/// The visits of the day: those that the data has, and those that it is told.
fn made(args: &NextArgs, known: &Known, slots: &Slots, now: Time) -> fremen::Result<MadeVisits> {
    let (mut made, places) = (MadeVisits::default(), &known.places);
    let looks = known.lately.iter();
    made.at
        .extend(looks.filter_map(|&(time, place)| Some((slots.slot_of(time)?, place))));
    for text in &args.visited {
        let parts = text.rsplit_once('=');
        let Some((name, time)) =
            parts.and_then(|(name, time)| Some((name, Time::parse(time).ok()?)))
        else {
            return Err(Error::new(
                ErrorKind::Config,
                format!("`{text}` does not say which place was visited when"),
            )
            .with_help("write PLACE=TIME with a time in RFC 3339"));
        };
        let Some(slot) = slots.slot_of(time).filter(|_| time < now) else {
            return Err(Error::new(
                ErrorKind::Config,
                format!(
                    "a visit at {time} is not between {} and {now}",
                    slots.start()
                ),
            )
            .with_help("visits that were made are from --day-from to --now"));
        };
        match (0..places.num_places()).find(|&place| places.name(place) == name) {
            Some(place) => made.at.push((slot, place)),
            None => made.elsewhere += 1,
        }
    }
    made.at.sort_unstable();
    made.at.dedup();
    Ok(made)
}

fn run_simulate(args: &SimulateArgs, out: &mut Output) -> Result<Outcome> {
    let common = &args.common;
    if common
        .data
        .iter()
        .any(|file| file.extension().is_some_and(|it| it == "map"))
    {
        return Err(Error::new(
            ErrorKind::Config,
            "a map holds what was seen, and a simulation needs what could have been seen",
        )
        .with_help("give series of all places at the same times")
        .into());
    }
    let (recording, num_others) = recording(&common.data, &common.reading())?;
    if num_others > 0 {
        note!("note: {num_others} times at which not every state is known are left out");
    }
    let slots = common.slots(recording.times()[0])?;
    let mut errors = Vec::new();
    for seed in common.seed..common.seed.saturating_add(args.seeds.max(1)) {
        let cfg = common.cfg(&slots)?.with_seed(seed);
        let outcome = simulate(&recording, &common.model, &cfg, slots.len())?;
        let bits: f64 = outcome.visits.iter().map(|visit| visit.info_bits).sum();
        let num_visits = outcome.visits.len();
        errors.push(outcome.error);
        if args.json {
            let mut row = json!({
                "strategy": common.strategy.name(),
                "model": common.model.to_string(),
                "share": common.share,
                "seed": seed,
                "error": outcome.error,
                "num_visits": num_visits,
                "num_rerouted": outcome.num_rerouted,
                "bits_a_visit": bits / num_visits.max(1) as f64,
            });
            if args.by_day {
                row["by_day"] = json!(outcome.by_day);
            }
            out.json(&row)?;
            continue;
        }
        out.line(format_args!(
            "{} with {}, seed {seed}: {:.2} % of states wrong, {num_visits} visits",
            common.strategy,
            common.model,
            100.0 * outcome.error
        ))?;
        if args.by_day {
            for (day, error) in outcome.by_day.iter().enumerate() {
                out.line(format_args!("  {day:4}  {:6.2} %", 100.0 * error))?;
            }
        }
    }
    if !args.json && errors.len() > 1 {
        let count = errors.len() as f64;
        let mean = errors.iter().sum::<f64>() / count;
        let squares: f64 = errors.iter().map(|error| (error - mean).powi(2)).sum();
        let half = 1.96 * (squares / (count - 1.0) / count).sqrt();
        out.line(format_args!(
            "mean {:.2} % (95 % interval {:.2} to {:.2} over seeds)",
            100.0 * mean,
            100.0 * (mean - half),
            100.0 * (mean + half)
        ))?;
    }
    Ok(Outcome::Good)
}

fn run_explain(args: &ExplainArgs, out: &mut Output) -> Result<Outcome> {
    let length = Period::from_s(args.common.slot_s).map_err(|_| {
        Error::new(
            ErrorKind::Config,
            format!(
                "a slot must be longer than 0 s, not {} s",
                args.common.slot_s
            ),
        )
    })?;
    let slots = Slots::new(args.at, length, args.common.slots)?;
    let known = args.common.known(args.at, args.at)?;
    let prospects = prospects(&known.places, &slots, 0)?;
    if !args.json {
        out.line(format_args!(
            "{:20}  {:>5}  {:>6}  {:>10}  {:>6}  {:>10}  {:>6}",
            "place", "p", "bits", "for slots", "looks", "model bits", "value"
        ))?;
    }
    for it in prospects {
        let name = known.places.name(it.place);
        if args.json {
            out.json(&json!({
                "place": name,
                "p": it.p,
                "state_bits": it.state_bits,
                "slots": it.slots,
                "looks": it.looks,
                "model_bits": it.model_bits,
                "value": it.value,
            }))?;
            continue;
        }
        out.line(format_args!(
            "{name:20}  {:5.3}  {:6.2}  {:10.1}  {:6.1}  {:10.3}  {:6.2}",
            it.p, it.state_bits, it.slots, it.looks, it.model_bits, it.value
        ))?;
    }
    Ok(Outcome::Good)
}
