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

/// Slots of ten minutes in a day.
const SLOTS: usize = 144;

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
    let num_days = recording.times().len() / 1_440;
    let seeds = num_seeds.min(CURVE_SEEDS);
    let curves = CURVES
        .iter()
        .map(|&(strategy, model)| curve(recording, strategy, model, seeds));
    let (over_weeks, over_share) = curves.collect::<Result<Vec<_>>>()?.into_iter().unzip();
    Ok(ExploreResults {
        schema_version: SCHEMA_VERSION,
        protocol: format!(
            "{} places, {num_days} days, one moment a minute; half of the time for visits of ten \
             minutes, planned at midnight; a state is 1 if p > 1/2, those of the place under visit are \
             known (RAS 2016, section 7); {num_seeds} seeds, round robin has none",
            recording.num_places()
        ),
        notes: vec![
            "The default was chosen on Aruba, and on no other set.".into(),
            format!("Curves have {seeds} seeds."),
            "Bits a visit are those that a strategy ranks by: what a look leaves behind for weeks with \
             information, the entropy of the state at that minute with the others; they compare models, \
             not strategies."
                .into(),
        ],
        majority: majority(recording),
        oracle: oracle(recording)?,
        rows,
        over_weeks,
        over_share,
        next_look_bits: gains(recording)?,
        day: Some(day(recording, (num_days / 2).min(20))?),
        ..ExploreResults::default()
    })
}

fn run(
    recording: &Recording,
    strategy: Strategy,
    model: &str,
    share: f64,
    seed: u64,
) -> Result<Outcome> {
    let cfg = ExploreConfig::new(strategy)?
        .with_share(Share::new(share)?)
        .with_seed(seed);
    let model: OnlineConfig = model.parse()?;
    Ok(simulate(recording, &model, &cfg, SLOTS)?)
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
        .map(|seed| run(&dataset.recording, strategy, model, 0.5, seed))
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
fn curve(
    recording: &Recording,
    strategy: Strategy,
    model: &str,
    seeds: u64,
) -> Result<(Curve, Curve)> {
    let name = format!("{strategy}, {model}");
    let is_default =
        strategy == Strategy::default() && model == OnlineConfig::default().to_string();
    let mut over_weeks = Vec::new();
    let mut over_share = Vec::new();
    for share in SHARES {
        let outcomes: Vec<Outcome> = (0..seeds)
            .into_par_iter()
            .map(|seed| run(recording, strategy, model, share, seed))
            .collect::<Result<_>>()?;
        let errors: Vec<f64> = outcomes.iter().map(|outcome| outcome.error).collect();
        over_share.push((share, measured(&errors)));
        if share != 0.5 {
            continue;
        }
        for week in 0..outcomes[0].by_day.len() / 7 {
            let of_week = outcomes
                .iter()
                .map(|outcome| outcome.by_day[week * 7..week * 7 + 7].iter().sum::<f64>() / 7.0);
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
fn majority(recording: &Recording) -> f64 {
    let moments = recording.times().len();
    let wrong: usize = (0..recording.num_places())
        .map(|place| {
            let ones = (0..moments).filter(|&moment| recording.states(place, moment)[0]);
            let ones = ones.count();
            ones.min(moments - ones)
        })
        .sum();
    wrong as f64 / (moments * recording.num_places()) as f64
}

fn slot_length() -> Result<Period> {
    Ok(Period::from_s(600.0)?)
}

/// The default model where each visit goes to the place that it has most wrong, as long as half of the
/// slots last.
fn oracle(recording: &Recording) -> Result<f64> {
    let mut beliefs = Beliefs::new(recording.places(), &OnlineConfig::default());
    let (mut wrong, mut states) = (0_usize, 0_usize);
    for day in 0..recording.times().len() / 1_440 {
        let slots = Slots::new(recording.times()[day * 1_440], slot_length()?, SLOTS)?;
        beliefs.learn()?;
        let mut left = slots.budget(0.5);
        for slot in 0..SLOTS {
            let moments = recording.between(slots.begin(slot), slots.begin(slot + 1));
            let wrong_at = |place: usize| {
                let is_wrong = |moment: &usize| {
                    let mut p = [0.0];
                    beliefs.predict_into(place, recording.times()[*moment], &mut p);
                    (p[0] > 0.5) != recording.states(place, *moment)[0]
                };
                moments.clone().filter(is_wrong).count()
            };
            let all: Vec<usize> = (0..recording.num_places()).map(wrong_at).collect();
            states += moments.len() * all.len();
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

/// What each further look of a day would add, the mean over the days of the third week.
fn gains(recording: &Recording) -> Result<Vec<f64>> {
    let mut robot = default_robot(recording)?;
    let mut sums = vec![0.0; SLOTS];
    let mut days = 0.0;
    for day in 0..(recording.times().len() / 1_440).min(21) {
        let slots = *robot.plan(recording.times()[day * 1_440], SLOTS)?.slots();
        if day >= 14 {
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

fn default_robot(recording: &Recording) -> Result<Explorer> {
    let cfg = ExploreConfig::new(Strategy::default())?;
    Ok(Explorer::new(
        recording.places(),
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

/// Day `number` of the default, at the four places that are visited most.
fn day(recording: &Recording, number: usize) -> Result<Day> {
    let mut robot = default_robot(recording)?;
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
        let slots = *robot.plan(recording.times()[day * 1_440], SLOTS)?.slots();
        live(recording, &mut robot, &slots, |robot, moment, visited| {
            if day < number {
                return;
            }
            let time = recording.times()[moment];
            let hour = time.since_s(slots.start()) / 3_600.0;
            for (place, seen) in places.iter_mut().enumerate() {
                let mut p = [0.0];
                robot.beliefs().predict_into(place, time, &mut p);
                seen.hours.push(hour);
                seen.states.push(recording.states(place, moment)[0]);
                seen.p.push(p[0]);
                seen.bits.push(entropy_bits(p[0]));
                if visited != Some(place) {
                    continue;
                }
                match seen.visits.last_mut() {
                    Some((_, end)) if hour - *end < 0.02 => *end = hour + 1.0 / 60.0,
                    _ => seen.visits.push((hour, hour + 1.0 / 60.0)),
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
