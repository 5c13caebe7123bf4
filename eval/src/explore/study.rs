//! How much does each strategy with each model have wrong?

use anyhow::{Context, Result};
use chronotope::Period;
use fremen::online::OnlineConfig;
use fremen_explore::{
    Beliefs, ExploreConfig, Explored, Explorer, Outcome, Recording, Share, Slots, Strategy,
    entropy_bits, next_look_bits, simulate,
};
use rayon::prelude::*;

use super::data::Dataset;
use super::results::{Curve, Day, DayPlace, ExploreResults, Row, SCHEMA_VERSION, measured};

/// Seconds of a day.
const DAY_S: f64 = 86_400.0;

/// Shares of time at which the curves are taken.
const SHARES: [f64; 6] = [0.05, 0.1, 0.25, 0.5, 0.75, 1.0];

/// Seeds of the curves, if there are not fewer.
const CURVE_SEEDS: u64 = 5;

/// What is drawn over days and shares: the default, the paper's best, and its baselines.
const CURVES: [(Strategy, &str); 4] = [
    (Strategy::Information, "histogram-persistent"),
    (Strategy::MonteCarlo, "histogram-persistent"),
    (Strategy::MonteCarlo, "fremen"),
    (Strategy::RoundRobin, "long-term"),
];

/// The published models come first in the names of all.
pub(super) fn study(dataset: &Dataset, num_seeds: u64) -> Result<ExploreResults> {
    let recording = &dataset.recording;
    let mut cells: Vec<(Strategy, &str)> = Vec::new();
    for strategy in Strategy::ALL {
        cells.extend(OnlineConfig::names().iter().map(|model| (strategy, *model)));
    }
    let rows = cells
        .iter()
        .map(|&(strategy, model)| row(dataset, strategy, model, num_seeds));
    let rows = rows.collect::<Result<Vec<_>>>()?;
    let num_days = num_days(dataset);
    let seeds = num_seeds.min(CURVE_SEEDS);
    let curves = CURVES
        .iter()
        .map(|&(strategy, model)| curve(dataset, strategy, model, seeds));
    let (over_weeks, over_share) = curves.collect::<Result<Vec<_>>>()?.into_iter().unzip();
    Ok(ExploreResults {
        schema_version: SCHEMA_VERSION,
        protocol: format!(
            "{} places with {} states, {num_days} days, {}; half of the time for visits of {:.0} \
             minutes, planned a day at a time; a state is 1 if p > 1/2, those of the place under visit \
             are known (RAS 2016, section 7); {num_seeds} seeds, round robin has none",
            recording.num_places(),
            recording.places().map(|(_, states)| states).sum::<usize>(),
            dataset.moments,
            DAY_S / 60.0 / dataset.slots_a_day as f64
        ),
        notes: vec![
            "The default was chosen on Aruba, and on no other set.".into(),
            format!("Curves have {seeds} seeds."),
            "Bits a visit are those that a strategy ranks by: what a look leaves behind for weeks with \
             information, the entropy of the state at that minute with the others; they compare models, \
             not strategies."
                .into(),
        ],
        majority: majority(dataset)?,
        oracle: oracle(dataset)?,
        rows,
        over_weeks,
        days_a_point: days_a_point(dataset),
        over_share,
        next_look_bits: gains(dataset)?,
        day: Some(day(dataset, (num_days / 2).min(20))?),
        ..ExploreResults::default()
    })
}

/// Whole days, as [`simulate`] counts them: their last slot begins before the recording ends.
fn num_days(dataset: &Dataset) -> usize {
    let times = dataset.recording.times();
    let slot_s = DAY_S / dataset.slots_a_day as f64;
    ((times[times.len() - 1].since_s(times[0]) + slot_s) / DAY_S) as usize
}

fn days_a_point(dataset: &Dataset) -> usize {
    if num_days(dataset) < 21 { 1 } else { 7 }
}

/// The slots of a day, counted from 0.
fn slots_of(dataset: &Dataset, day: usize) -> Result<Slots> {
    let first = dataset.recording.times()[0];
    let begin = first.plus_us((day as f64 * DAY_S * 1e6) as i64);
    Ok(Slots::new(
        begin,
        slot_length(dataset)?,
        dataset.slots_a_day,
    )?)
}

fn run(
    dataset: &Dataset,
    strategy: Strategy,
    model: &str,
    share: f64,
    seed: u64,
) -> Result<Outcome> {
    let cfg = ExploreConfig::new(strategy)?
        .with_share(Share::new(share)?)
        .with_slot(slot_length(dataset)?)
        .with_seed(seed);
    let model: OnlineConfig = model.parse()?;
    Ok(simulate(
        &dataset.recording,
        &model,
        &cfg,
        dataset.slots_a_day,
    )?)
}

fn row(dataset: &Dataset, strategy: Strategy, model: &str, num_seeds: u64) -> Result<Row> {
    // Nothing is drawn there.
    let num_seeds = if strategy == Strategy::RoundRobin {
        1
    } else {
        num_seeds
    };
    let outcomes: Vec<Outcome> = (0..num_seeds)
        .into_par_iter()
        .map(|seed| run(dataset, strategy, model, 0.5, seed))
        .collect::<Result<_>>()?;
    let errors: Vec<f64> = outcomes.iter().map(|outcome| outcome.error).collect();
    let visits = || outcomes.iter().flat_map(|outcome| &outcome.visits);
    let bits: f64 = visits().map(|visit| visit.info_bits).sum();
    let at = Strategy::ALL.iter().position(|it| *it == strategy);
    let column = OnlineConfig::names().iter().position(|it| *it == model);
    let published = (dataset.published).and_then(|rows| rows.get(at?)?.get(column?).copied());
    Ok(Row {
        strategy: strategy.name().into(),
        model: model.into(),
        is_default: strategy == Strategy::default() && model == OnlineConfig::default().to_string(),
        error: measured(&errors),
        worst: errors.iter().copied().fold(0.0, f64::max),
        published: published.map(|percent| percent / 100.0),
        bits_a_visit: bits / (visits().count() as f64).max(1.0),
        bits_an_hour: None,
        travel_s_a_day: 0.0,
        num_late: 0,
        num_seeds,
    })
}

/// The error over weeks and over shares of time.
fn curve(dataset: &Dataset, strategy: Strategy, model: &str, seeds: u64) -> Result<(Curve, Curve)> {
    let name = format!("{strategy}, {model}");
    let is_default =
        strategy == Strategy::default() && model == OnlineConfig::default().to_string();
    let mut over_weeks = Vec::new();
    let mut over_share = Vec::new();
    for share in SHARES {
        let outcomes: Vec<Outcome> = (0..seeds)
            .into_par_iter()
            .map(|seed| run(dataset, strategy, model, share, seed))
            .collect::<Result<_>>()?;
        let errors: Vec<f64> = outcomes.iter().map(|outcome| outcome.error).collect();
        over_share.push((share, measured(&errors)));
        if share != 0.5 {
            continue;
        }
        let days = days_a_point(dataset);
        for week in 0..outcomes[0].by_day.len() / days {
            let of_week = outcomes.iter().map(|outcome| {
                let of_week = &outcome.by_day[week * days..(week + 1) * days];
                of_week.iter().sum::<f64>() / days as f64
            });
            let of_week: Vec<f64> = of_week.collect();
            over_weeks.push((week as f64 + 1.0, measured(&of_week)));
        }
    }
    let curve = |points| Curve {
        name: name.clone(),
        is_default,
        points,
    };
    Ok((curve(over_weeks), curve(over_share)))
}

/// Always believing of each state what it is most of the time.
fn majority(dataset: &Dataset) -> Result<f64> {
    let recording = &dataset.recording;
    let end = slots_of(dataset, num_days(dataset))?.start();
    let moments = recording.between(recording.times()[0], end).len();
    let (mut wrong, mut states) = (0, 0);
    for (place, (_, num_states)) in recording.places().enumerate() {
        let mut ones = vec![0_usize; num_states];
        for moment in 0..moments {
            for (ones, &state) in ones.iter_mut().zip(recording.states(place, moment)) {
                *ones += usize::from(state);
            }
        }
        wrong += ones
            .iter()
            .map(|&ones| ones.min(moments - ones))
            .sum::<usize>();
        states += moments * num_states;
    }
    Ok(wrong as f64 / states.max(1) as f64)
}

fn slot_length(dataset: &Dataset) -> Result<Period> {
    Ok(Period::from_s(DAY_S / dataset.slots_a_day as f64)?)
}

/// How many states of a place a model has wrong at a moment.
fn num_wrong(beliefs: &Beliefs, recording: &Recording, place: usize, moment: usize) -> usize {
    let states = recording.states(place, moment);
    let mut p = vec![0.0; states.len()];
    beliefs.predict_into(place, recording.times()[moment], &mut p);
    p.iter()
        .zip(states)
        .filter(|(p, state)| (**p > 0.5) != **state)
        .count()
}

/// The default model where each visit goes to the place that it has most wrong, as long as half of the
/// slots last.
fn oracle(dataset: &Dataset) -> Result<f64> {
    let recording = &dataset.recording;
    let mut beliefs = Beliefs::new(recording.places(), &OnlineConfig::default());
    let num_states: usize = recording.places().map(|(_, states)| states).sum();
    let (mut wrong, mut states) = (0_usize, 0_usize);
    for day in 0..num_days(dataset) {
        let slots = slots_of(dataset, day)?;
        beliefs.learn()?;
        let mut left = slots.budget(0.5);
        for slot in 0..slots.len() {
            let moments = recording.between(slots.begin(slot), slots.begin(slot + 1));
            let all: Vec<usize> = (0..recording.num_places())
                .map(|place| {
                    let of = moments.clone();
                    of.map(|moment| num_wrong(&beliefs, recording, place, moment))
                        .sum()
                })
                .collect();
            states += moments.len() * num_states;
            wrong += all.iter().sum::<usize>();
            let worst = (0..all.len())
                .max_by_key(|&place| all[place])
                .context("no place")?;
            if left == 0 || all[worst] == 0 {
                continue;
            }
            left -= 1;
            wrong -= all[worst];
            for moment in moments {
                let time = recording.times()[moment];
                beliefs.observe(worst, time, recording.states(worst, moment))?;
            }
        }
    }
    Ok(wrong as f64 / states.max(1) as f64)
}

/// What each further look of a day would add, the mean over the days of the third week, or of the
/// later half of a shorter recording.
fn gains(dataset: &Dataset) -> Result<Vec<f64>> {
    let recording = &dataset.recording;
    let mut robot = default_robot(dataset)?;
    let mut sums = vec![0.0; dataset.slots_a_day];
    let mut days = 0.0;
    let num_days = num_days(dataset).min(21);
    for day in 0..num_days {
        let begin = slots_of(dataset, day)?.start();
        let slots = *robot.plan(begin, dataset.slots_a_day)?.slots();
        if day >= (num_days / 2).max(num_days.saturating_sub(7)) {
            days += 1.0;
            let bits = next_look_bits(robot.beliefs(), &slots)?;
            for (sum, bits) in sums.iter_mut().zip(bits) {
                *sum += bits;
            }
        }
        live(recording, &mut robot, &slots, |_, _, _| ())?;
    }
    Ok(sums.iter().map(|sum| sum / f64::max(days, 1.0)).collect())
}

fn default_robot(dataset: &Dataset) -> Result<Explorer> {
    let cfg = ExploreConfig::new(Strategy::default())?.with_slot(slot_length(dataset)?);
    Ok(Explorer::new(
        dataset.recording.places(),
        &OnlineConfig::default(),
        cfg,
    ))
}

/// Goes through a day that is planned; `see` is told of every moment before it is looked at, and of the
/// place under visit.
fn live(
    recording: &Recording,
    robot: &mut Explorer,
    slots: &Slots,
    mut see: impl FnMut(&Explorer, usize, Option<usize>),
) -> Result<()> {
    for slot in 0..slots.len() {
        let place = robot.next(slot)?.map(|visit| visit.place);
        for moment in recording.between(slots.begin(slot), slots.begin(slot + 1)) {
            see(robot, moment, place);
            if let Some(place) = place {
                let time = recording.times()[moment];
                robot.observe(place, time, recording.states(place, moment))?;
            }
        }
    }
    Ok(())
}

/// Day `number` of the default, the first state of the four places that are visited most.
fn day(dataset: &Dataset, number: usize) -> Result<Day> {
    let recording = &dataset.recording;
    let mut robot = default_robot(dataset)?;
    let today = slots_of(dataset, number)?;
    let num_moments = recording.between(today.start(), today.end()).len();
    let moment_hours = 24.0 / num_moments.max(1) as f64;
    let mut places: Vec<DayPlace> = (recording.places())
        .map(|(name, _)| DayPlace {
            name: name.into(),
            hours: Vec::new(),
            states: Vec::new(),
            p: Vec::new(),
            bits: Vec::new(),
            visits: Vec::new(),
        })
        .collect();
    for day in 0..=number {
        let begin = slots_of(dataset, day)?.start();
        let slots = *robot.plan(begin, dataset.slots_a_day)?.slots();
        live(recording, &mut robot, &slots, |robot, moment, visited| {
            if day < number {
                return;
            }
            let time = recording.times()[moment];
            let hour = time.since_s(slots.start()) / 3_600.0;
            for (place, seen) in places.iter_mut().enumerate() {
                let mut p = vec![0.0; recording.place(place).1];
                robot.beliefs().predict_into(place, time, &mut p);
                seen.hours.push(hour);
                seen.states.push(recording.states(place, moment)[0]);
                seen.p.push(p[0]);
                seen.bits.push(entropy_bits(p[0]));
                if visited != Some(place) {
                    continue;
                }
                match seen.visits.last_mut() {
                    Some((_, end)) if hour - *end < 0.3 * moment_hours => {
                        *end = hour + moment_hours;
                    }
                    _ => seen.visits.push((hour, hour + moment_hours)),
                }
            }
        })?;
    }
    let hours = |place: &DayPlace| place.visits.iter().map(|(from, to)| to - from).sum::<f64>();
    places.sort_by(|a, b| hours(b).total_cmp(&hours(a)));
    places.truncate(4);
    Ok(Day {
        day: number,
        places,
    })
}
