//! Draws a contact sheet of the synthetic world: a row per place, a column per time.
//!
//! `cargo run --release --example render_world -- SHEET.png [SEED] [control]`

use chronotope::Time;
use chronotope::dataset::synthetic::{World, WorldConfig};

const TIMES: [&str; 6] = [
    "2023-01-18T11:00:00Z",
    "2023-04-22T16:30:00Z",
    "2023-07-12T13:00:00Z",
    "2023-07-15T23:00:00Z",
    "2023-10-24T09:00:00Z",
    "2023-12-20T20:00:00Z",
];
const NUM_PLACES: usize = 4;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments
        .next()
        .ok_or("name a file for the contact sheet")?;
    let seed = arguments.next().map_or(Ok(1000), |seed| seed.parse())?;
    let control = arguments.next().is_some();
    let cfg = WorldConfig::new(seed)
        .with_num_places(NUM_PLACES)
        .with_rhythms(!control);
    let world = World::new(&cfg)?;
    let first = world.render(0, Time::default(), 0);
    let (width, height) = (first.width(), first.height());
    let (columns, gap) = (TIMES.len(), 4);
    let sheet_width = columns * (width + gap);
    let mut sheet = vec![255; sheet_width * NUM_PLACES * (height + gap)];
    for place in 0..NUM_PLACES {
        for (column, text) in TIMES.iter().enumerate() {
            let image = world.render(place, Time::parse(text)?, 0);
            for y in 0..height {
                let from = (place * (height + gap) + y) * sheet_width + column * (width + gap);
                sheet[from..][..width].copy_from_slice(image.row(y));
            }
        }
    }
    let (rows, columns) = (NUM_PLACES * (height + gap), sheet_width);
    image::save_buffer(
        &path,
        &sheet,
        u32::try_from(columns)?,
        u32::try_from(rows)?,
        image::ExtendedColorType::L8,
    )?;
    Ok(())
}
