//! Which rhythms does a series of 0 and 1 have, and how well do they predict it?

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::Args;
use serde_json::{Value, json};

use super::spectrum_svg::{Picture, SVG, times};
use super::unpacked::unpacked;
use chronotope_terminal::{Outcome, Output};
use fremen::file::OutputFile;
use fremen::series::Columns;
use fremen::spectrum::{CandidatePeriods, Component, SpectralSums};
use fremen::time::{TimeUnit, Zone};
use fremen::visibility::{Estimate, Order, VisibilityConfig};
use fremen::{Error, ErrorKind, Period, Time};
use fremen::{Series, SeriesModel};

/// Fewer samples than this are not split: every order would be chosen by chance.
const MIN_SAMPLES: usize = 16;

/// Find the rhythms of any 0/1 series over time: a door, a person in a room, a passable edge.
///
/// Learns from the earlier samples, judges every model on the latest ones, then learns the chosen
/// ones again from all. `natural` is the model to use; `fremen` is the papers', with the order that
/// predicted the latest samples best. Predictions of either are believed as far as the samples
/// reach, and come with a 95 % interval: at hours that were never sampled p is near the mean, and
/// the interval wide.
#[derive(Debug, Args)]
#[command(after_help = "\
Rows are TIME,STATE: time in RFC 3339 with an offset or in seconds since 1970, state 0, 1, true or false
(empty, NaN: missing). A header and further columns may be there; cells are separated by commas, semicolons,
tabs or spaces; the file may be packed (gzip).

Examples:
  chronotope spectrum door.csv
  chronotope spectrum door.csv --predict-at 2024-05-06T08:30:00Z --predict-at 2024-05-06T20:00:00Z
  chronotope spectrum door.csv --svg door.svg
  chronotope spectrum office.csv --zone Europe/Prague
  zcat log.gz | chronotope spectrum - --time-unit ms
  chronotope spectrum visits.csv --events 600
  chronotope spectrum observations.parquet --place hall --feature 17
  chronotope spectrum edges.csv --state-column success --base-s 86400 --count 24 --json")]
pub(super) struct SpectrumArgs {
    /// The CSV file; `-` reads stdin. Or a table of observations, `.parquet` (docs/fleet.md).
    file: PathBuf,
    /// Of a table of observations: the place; the only one otherwise.
    #[arg(long, value_name = "NAME")]
    place: Option<String>,
    /// Of a table of observations: the number of the feature in the place; the only one otherwise.
    #[arg(long, value_name = "NUMBER")]
    feature: Option<u32>,
    /// What times that are numbers count: ns, us, ms, s, min, h, d (since 1970), excel or julian.
    #[arg(long, value_name = "UNIT")]
    time_unit: Option<TimeUnit>,
    /// Rhythms follow the clocks of this zone, as people do, and dates without an offset are of it.
    #[arg(long, value_name = "ZONE")]
    zone: Option<Zone>,
    /// The file is one column of times at which something happened: the state of each so many seconds
    /// is whether it did.
    #[arg(long, value_name = "SECONDS")]
    events: Option<f64>,
    /// The name of the column of times; the first column otherwise.
    #[arg(long, value_name = "NAME")]
    time_column: Option<String>,
    /// The name of the column of states; the second column otherwise.
    #[arg(long, value_name = "NAME")]
    state_column: Option<String>,
    /// The share of samples, the latest, that models are judged by.
    #[arg(
        long,
        value_name = "SHARE",
        default_value_t = 0.25,
        allow_negative_numbers = true
    )]
    held_out: f64,
    /// The longest period that `fremen` looks for, in seconds; a week by default.
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
    base_s: Option<f64>,
    /// Fractions of it that `fremen` looks for, from 1 to this.
    #[arg(long, default_value_t = 168)]
    count: usize,
    /// The highest order of `fremen` that is tried.
    #[arg(long, default_value_t = 5)]
    max_order: usize,
    /// Also print p at this time (may be given again); read as those of the file are.
    #[arg(long, value_name = "TIME", allow_negative_numbers = true)]
    predict_at: Vec<String>,
    /// Also draw p(t) over the data, and the spectrum over that of the sampling, into this file.
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
    /// One JSON object.
    #[arg(long)]
    json: bool,
}

impl SpectrumArgs {
    /// Where the columns are, and what times mean, in the file and in the arguments.
    fn columns(&self) -> Columns<'_> {
        Columns {
            time: self.time_column.as_deref(),
            state: self.state_column.as_deref(),
            unit: self.time_unit,
            zone: self.zone.as_ref(),
        }
    }

    fn predict_at(&self) -> Result<Vec<Time>> {
        let read = |text: &String| self.columns().time_of(text);
        let times: fremen::Result<_> = self.predict_at.iter().map(read).collect();
        Ok(times.map_err(|error| error.with_place("--predict-at"))?)
    }

    /// The moment at which clocks show this time.
    fn moment(&self, shown: Time) -> Time {
        self.zone
            .as_ref()
            .map_or(shown, |zone| zone.moment_shown(shown))
    }
}

/// A model's errors on the samples that it did not learn from.
struct Judged {
    model: &'static str,
    order: usize,
    brier: f64,
    wrong: f64,
    is_chosen: bool,
}

/// A model learnt from all samples.
struct Learnt {
    model: &'static str,
    mean: f64,
    components: Vec<Component>,
    /// At all times that were asked for.
    estimates: Vec<Estimate>,
    /// Of these the ones to print, with the moments that were given.
    predicted: Vec<(Time, Estimate)>,
}

pub(super) fn run(args: &SpectrumArgs, out: &mut Output) -> Result<Outcome> {
    if !(0.0..=0.9).contains(&args.held_out) {
        return Err(Error::new(
            ErrorKind::Config,
            format!("--held-out must be 0 to 0.9, not {}", args.held_out),
        )
        .into());
    }
    // Refused before anything is worked out.
    let predict_at = args.predict_at()?;
    let svg = (args.svg.as_ref())
        .map(|path| OutputFile::replace(path, SVG, &[&args.file]))
        .transpose()?;
    let series = if is_table(&args.file) {
        read_table(args)?
    } else {
        read_text(args)?
    };
    let by_clocks = match &args.zone {
        Some(zone) => series.in_zone(zone),
        None => series,
    };
    if args.zone.is_none() {
        note_daylight_saving(&by_clocks)?;
    }
    analyse(args, &by_clocks, &predict_at, svg, out)
}

/// Whether a file is a Parquet table: by its name, as Spark and pandas have it.
fn is_table(path: &Path) -> bool {
    let is_parquet = path.extension().is_some_and(|it| it == "parquet");
    is_parquet || path.join("_SUCCESS").exists()
}

fn read_text(args: &SpectrumArgs) -> Result<Series> {
    if args.place.is_some() || args.feature.is_some() {
        return Err(
            Error::new(ErrorKind::Config, "this is no table of observations")
                .with_path(&args.file)
                .with_help("--place and --feature are for .parquet; leave them out")
                .into(),
        );
    }
    let columns = args.columns();
    let bytes = unpacked(&args.file)?;
    let series = match args.events {
        Some(step_s) => Series::parse_events(&bytes, columns, step_s),
        None => Series::parse_csv(&bytes, columns),
    };
    Ok(series.map_err(|error| error.with_path(&args.file))?)
}

#[cfg(feature = "parquet")]
fn read_table(args: &SpectrumArgs) -> Result<Series> {
    let series = super::tables::series(&args.file, args.place.as_deref(), args.feature)?;
    if series.is_empty() {
        let error = Error::new(ErrorKind::Format, "the table has no rows");
        return Err(error
            .with_path(&args.file)
            .with_help("write it again")
            .into());
    }
    Ok(series)
}

#[cfg(not(feature = "parquet"))]
fn read_table(args: &SpectrumArgs) -> Result<Series> {
    Err(super::without_parquet(&args.file))
}

/// Says so if the rhythms move with the clocks of a region.
fn note_daylight_saving(series: &Series) -> Result<()> {
    /// A model by the clocks must be better than one by UTC by this much.
    const CLEARLY: f64 = 0.8;
    /// One for each of the common rules of summer time.
    const REGIONS: [(&str, &str); 3] = [
        ("Europe", "Europe/Berlin"),
        ("North America", "America/New_York"),
        ("south-eastern Australia", "Australia/Sydney"),
    ];
    let states = series.states();
    let (Some(first), Some(last)) = (states.first(), states.last()) else {
        return Ok(());
    };
    let error =
        |series: &Series| -> Result<f64> { Ok(series.learn()?.brier(series).unwrap_or_default()) };
    let mut by_utc = None;
    for (region, name) in REGIONS {
        let zone = Zone::new(name)?;
        let offset_s = |time: Time| zone.wall(time).since_s(time);
        if states
            .iter()
            .all(|&(time, _)| offset_s(time) == offset_s(first.0))
        {
            continue;
        }
        let limit = CLEARLY
            * match by_utc {
                Some(known) => known,
                None => *by_utc.insert(error(series)?),
            };
        if error(&series.in_zone(&zone))? < limit {
            note!(
                "note: between {} and {} the rhythms move when the clocks of {region} change; name \
                 the zone, such as --zone {name}, so that predictions move with them",
                to_the_second(first.0),
                to_the_second(last.0)
            );
            break;
        }
    }
    Ok(())
}

/// Judges the models, learns and shows; `series` is by the clocks of the zone, if there is one.
fn analyse(
    args: &SpectrumArgs,
    series: &Series,
    predict_at: &[Time],
    svg: Option<OutputFile>,
    out: &mut Output,
) -> Result<Outcome> {
    let base = args.base_s.map_or(Ok(Period::WEEK), Period::from_s)?;
    let candidates = CandidatePeriods::harmonic(base, args.count)?;
    let num_held_out = match series.len() {
        0..MIN_SAMPLES => 0,
        count => (count as f64 * args.held_out).round() as usize,
    };
    let (earlier, latest) = series.states().split_at(series.len() - num_held_out);
    let judged = judge(earlier, latest, &candidates, args.max_order)?;
    let order = (judged.iter())
        .find(|row| row.model == "fremen" && row.is_chosen)
        .map_or(0, |row| row.order);
    let drawn = match svg {
        Some(_) => times(series.states()),
        None => Vec::new(),
    };
    let mut at: Vec<Time> = (predict_at.iter())
        .map(|&time| args.zone.as_ref().map_or(time, |zone| zone.wall(time)))
        .collect();
    at.extend(&drawn);
    let mut learnt = learn(series, &candidates, order, &at)?;
    let curves: Vec<_> = (learnt.iter_mut())
        .map(|model| (model.model, model.estimates.split_off(predict_at.len())))
        .collect();
    if let Some(mut file) = svg {
        let picture = Picture {
            title: args.file.display().to_string(),
            states: series.states(),
            times: &drawn,
            curves: curves.iter().map(|(name, at)| (*name, &at[..])).collect(),
            periodogram: &series.periodogram(&candidates)?,
        };
        file.write_all(picture.svg().as_bytes())
            .map_err(|cause| Error::io(file.path(), cause))?;
        file.finish()?;
    }
    for model in &mut learnt {
        let predicted = predict_at.iter().copied().zip(model.estimates.drain(..));
        model.predicted = predicted.collect();
    }
    if args.json {
        out.json(&as_json(args, series, latest.len(), &judged, &learnt))?;
    } else {
        show(args, series, latest.len(), &judged, &learnt, out)?;
    }
    Ok(Outcome::Good)
}

fn sums(states: &[(Time, bool)], candidates: &CandidatePeriods) -> fremen::Result<SpectralSums> {
    let mut sums = SpectralSums::new(candidates.clone());
    for &(time, state) in states {
        sums.add(time, state)?;
    }
    Ok(sums)
}

fn judge(
    earlier: &[(Time, bool)],
    latest: &[(Time, bool)],
    candidates: &CandidatePeriods,
    max_order: usize,
) -> fremen::Result<Vec<Judged>> {
    if latest.is_empty() {
        return Ok(Vec::new());
    }
    let judged = |model, order, p: &dyn Fn(Time) -> f64| {
        let (mut squares, mut wrong) = (0.0, 0.0);
        for &(time, state) in latest {
            let p = p(time);
            squares += (p - f64::from(u8::from(state))).powi(2);
            wrong += f64::from(u8::from((p >= 0.5) != state));
        }
        let count = latest.len() as f64;
        Judged {
            model,
            order,
            brier: squares / count,
            wrong: wrong / count,
            is_chosen: false,
        }
    };
    let natural = earlier.iter().copied().collect::<Series>().learn()?;
    let mut rows = vec![judged("natural", natural.order(), &|time| natural.p(time))];
    rows[0].is_chosen = true;
    let sums = sums(earlier, candidates)?;
    let mut best = 1;
    for order in 0..=max_order {
        let rhythms = sums.rhythms(order);
        if rhythms.order() < order {
            break; // There are no more.
        }
        rows.push(judged("fremen", order, &|time| rhythms.p(time)));
        // The lower order of equals.
        if rows[order + 1].brier < rows[best].brier {
            best = order + 1;
        }
    }
    rows[best].is_chosen = true;
    Ok(rows)
}

fn learn(
    series: &Series,
    candidates: &CandidatePeriods,
    order: usize,
    times: &[Time],
) -> fremen::Result<Vec<Learnt>> {
    let fremen = VisibilityConfig::fremen(candidates.clone(), Order::Fixed(order));
    let learnt = |name, model: SeriesModel| Learnt {
        model: name,
        mean: model.mean().or(series.mean()).unwrap_or_default(),
        components: model.components(),
        estimates: times.iter().map(|&time| model.estimate(time)).collect(),
        predicted: Vec::new(),
    };
    Ok(vec![
        learnt("natural", series.learn()?),
        learnt("fremen", series.learn_with(&fremen)?),
    ])
}

/// When the rhythm is first at its highest, not before `from`.
fn first_peak(component: &Component, from: Time) -> Time {
    let cycle_us = component.period_s * 1e6;
    let peak_us = -component.phase_rad / std::f64::consts::TAU * cycle_us;
    let since = (peak_us - from.as_us() as f64).rem_euclid(cycle_us);
    from.plus_us(since as i64)
}

fn as_json(
    args: &SpectrumArgs,
    series: &Series,
    num_held_out: usize,
    judged: &[Judged],
    learnt: &[Learnt],
) -> Value {
    let first = series.states()[0].0;
    let models = judged.iter().map(|row| {
        json!({
            "model": row.model,
            "order": row.order,
            "brier": row.brier,
            "wrong": row.wrong,
            "chosen": row.is_chosen,
        })
    });
    let learnt = learnt.iter().map(|model| {
        let components = model.components.iter().map(|component| {
            json!({
                "period_s": component.period_s,
                "amplitude": component.amplitude,
                "phase_rad": component.phase_rad,
                "first_peak": args.moment(first_peak(component, first)).to_string(),
            })
        });
        let predicted = model.predicted.iter().map(|(time, at)| {
            json!({"time": time.to_string(), "p": at.p, "low": at.low, "high": at.high})
        });
        json!({
            "model": model.model,
            "mean": model.mean,
            "components": components.collect::<Vec<_>>(),
            "predicted": predicted.collect::<Vec<_>>(),
        })
    });
    json!({
        "file": args.file,
        "num_samples": series.len(),
        "num_missing": series.missing().len(),
        "num_held_out": num_held_out,
        "first": args.moment(first).to_string(),
        "zone": args.zone.as_ref().map(Zone::name),
        "span_s": series.span_s(),
        "held_out": models.collect::<Vec<_>>(),
        "learnt": learnt.collect::<Vec<_>>(),
    })
}

fn show(
    args: &SpectrumArgs,
    series: &Series,
    num_held_out: usize,
    judged: &[Judged],
    learnt: &[Learnt],
    out: &mut Output,
) -> Result<()> {
    let count = series.len();
    let first = series.states()[0].0;
    let span = Period::from_s(series.span_s()).map_or_else(|_| "no time".into(), |s| s.to_string());
    out.line(format_args!(
        "{}: {count} samples over {span} from {}, {} missing; 1 in {:.1} % of them",
        args.file.display(),
        args.moment(first),
        series.missing().len(),
        100.0 * series.mean().unwrap_or_default()
    ))?;
    if judged.is_empty() {
        out.line("no sample is held out: orders are not compared, and fremen is the mean")?;
    } else {
        out.line(format_args!(
            "\non the latest {num_held_out} samples, learnt from the {} before\nmodel     order  wrong %   Brier",
            count - num_held_out
        ))?;
        for row in judged {
            out.line(format_args!(
                "{:<9} {:>5}  {:>7.1}  {:>6.4}{}",
                row.model,
                row.order,
                100.0 * row.wrong,
                row.brier,
                if row.is_chosen { "  *" } else { "" }
            ))?;
        }
        out.line("* natural chooses by itself; of fremen the order with the lowest Brier score")?;
    }
    for model in learnt {
        out.line(format_args!(
            "\n{}, learnt from all: mean {:.3}",
            model.model, model.mean
        ))?;
        if model.components.is_empty() {
            out.line("  no rhythm")?;
        } else {
            out.line("      period  amplitude  phase rad  first at its highest")?;
        }
        for component in &model.components {
            let period = Period::from_s(component.period_s)
                .map_or_else(|_| format!("{} s", component.period_s), |p| p.to_string());
            out.line(format_args!(
                "{period:>12}  {:>9.3}  {:>9.3}  {}",
                component.amplitude,
                component.phase_rad,
                to_the_second(args.moment(first_peak(component, first)))
            ))?;
        }
        for (time, at) in &model.predicted {
            let Estimate { p, low, high } = at;
            out.line(format_args!(
                "  p({time}) = {p:.3} (95 % interval {low:.3} to {high:.3})"
            ))?;
        }
    }
    Ok(())
}

fn to_the_second(time: Time) -> Time {
    Time::from_s(time.as_us().div_euclid(1_000_000))
}
