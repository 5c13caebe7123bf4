//! Draws a folder of images of the made-up street, called as those of a bag are.
//!
//! `cargo run --example render_street -- FOLDER [VISITS]` writes an `index.csv`, an `edges.csv` of the
//! way, and PGM files without an ending (`camera/image/1700000000.000000000`), so that a bag with the
//! same images on the topic `/camera/image` gives the same entries.

use std::fmt::Write as _;
use std::path::PathBuf;

use chronotope::Time;
use chronotope::dataset::synthetic::{World, WorldConfig};

const NUM_PLACES: usize = 4;
/// The first visit, s since 1970, and how far the visits are apart: each at another hour.
const FIRST_S: i64 = 1_700_000_000;
const BETWEEN_S: i64 = 7 * 86_400 + 5 * 3_600;
/// From one place to the next, s.
const WALK_S: i64 = 10;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().ok_or("name a folder")?);
    let num_visits: i64 = arguments.next().map_or(Ok(6), |number| number.parse())?;
    let world = World::new(&WorldConfig::new(7).with_num_places(NUM_PLACES))?;
    std::fs::create_dir_all(folder.join("camera/image"))?;
    let mut index = String::from("path,place,time\n");
    for visit in 0..num_visits {
        for place in 0..NUM_PLACES {
            let s = FIRST_S + visit * BETWEEN_S + place as i64 * WALK_S;
            let image = world.render(place, Time::from_s(s), visit as u64);
            let path = format!("camera/image/{s}.000000000");
            let head = format!("P5\n{} {}\n255\n", image.width(), image.height());
            std::fs::write(folder.join(&path), [head.as_bytes(), image.data()].concat())?;
            writeln!(index, "{path},place-{place},{}", Time::from_s(s))?;
        }
    }
    std::fs::write(folder.join("index.csv"), index)?;
    let mut edges = String::from("from,to\n");
    for place in 1..NUM_PLACES {
        writeln!(edges, "place-{},place-{place}", place - 1)?;
    }
    std::fs::write(folder.join("edges.csv"), edges)?;
    Ok(())
}
