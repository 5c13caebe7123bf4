//! Learns when a door is open: `cargo run --example door -- [FILE.csv] [FILE.svg]`.
//!
//! The file has a time and a state on every line. Without one, four weeks of an office door are
//! made up. Prints the rhythms, the coming day, and what was unusual; draws p(t) into the second
//! file.

#![allow(clippy::print_stdout, reason = "an example shows its answers")]

use std::fmt::Write as _;

use fremen::series::Columns;
use fremen::{Period, Result, Series, SeriesModel, Time};

const HOUR_US: i64 = Period::HOUR.as_us();

fn main() -> Result<()> {
    let mut args = std::env::args().skip(1);
    let door = match args.next() {
        Some(path) => Series::read_csv(path, Columns::default())?,
        None => office_door(),
    };
    let model = door.learn()?;

    println!(
        "{} samples, open in {:.0} % of them",
        door.len(),
        100.0 * door.mean().unwrap_or(0.5)
    );
    for rhythm in model.components() {
        let period = Period::from_s(rhythm.period_s)?;
        println!(
            "  a rhythm of {period}: p swings by {:.2} to either side",
            rhythm.amplitude
        );
    }

    let last = door.states().last().map_or_else(Time::now, |state| state.0);
    println!("the coming day:");
    for hours in (0..24).step_by(3) {
        let time = last.plus_us(hours * HOUR_US);
        println!("  {time}  p = {:.2}", model.p(time));
    }

    let unusual = model.anomalies(&door, 0.9)?;
    println!("{} samples are unusual", unusual.len());
    for it in unusual.iter().take(5) {
        println!("  {}: {} at p = {:.2}", it.time, u8::from(it.state), it.p);
    }

    if let Some(path) = args.next() {
        let drawn = svg(&model, last);
        std::fs::write(&path, drawn).map_err(|cause| fremen::Error::io(&path, cause))?;
    }
    Ok(())
}

/// p(t) of the coming week.
fn svg(model: &SeriesModel, from: Time) -> String {
    let mut path = String::new();
    for hour in 0..=7 * 24 {
        let p = model.p(from.plus_us(hour * HOUR_US));
        let command = if hour == 0 { 'M' } else { 'L' };
        // Writing to a string cannot fail.
        let _ = write!(path, "{command}{},{:.1}", 10 + 4 * hour, 110.0 - 100.0 * p);
    }
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 692 120\">\
         <rect width=\"692\" height=\"120\" fill=\"#fff\"/>\
         <path d=\"{path}\" fill=\"none\" stroke=\"#0072b2\" stroke-width=\"2\"/></svg>\n"
    )
}

/// Open in office hours of working days, and once in the night before a Monday.
fn office_door() -> Series {
    let is_open = |hour: i64| {
        // The first of January 1970 was a Thursday.
        let (weekday, hour_of_day) = ((hour.div_euclid(24) + 3) % 7, hour.rem_euclid(24));
        weekday < 5 && (8..18).contains(&hour_of_day)
    };
    (0..28 * 24)
        .map(|hour| (Time::from_us(hour * HOUR_US), is_open(hour) || hour == 100))
        .collect()
}
