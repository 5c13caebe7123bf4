//! A robot's loop on a rendered street: a year of rounds to learn from, then images of the next year
//! that it has never seen, each located with the same scratch and output, so that nothing is
//! allocated once both are warm.
//!
//! `cargo run --release --example robot_loop -- [SEED]`
#![allow(clippy::print_stdout)] // reason: an example shows what it does.

use std::error::Error;
use std::time::{Duration, Instant};

use chronotope::dataset::Entry;
use chronotope::dataset::synthetic::{Schedule, World, WorldConfig};
use chronotope::feature::{Extractor, Features, StarBrief, StarBriefConfig};
use chronotope::learn::{LearnConfig, Learner, Observation};
use chronotope::localize::{Decision, Localization, Localizer, LocalizerConfig, Query};
use chronotope::map::{MapMeta, SessionId, derived_uuid};

/// What the robot's driver would hand over: a grey image's features, and its size in px.
fn look(extractor: &StarBrief, entry: &Entry) -> chronotope::Result<(Features, (u32, u32))> {
    let image = entry.source.load()?;
    let size = (image.width() as u32, image.height() as u32);
    Ok((extractor.extract(&image, None)?, size))
}

fn main() -> Result<(), Box<dyn Error>> {
    let seed = std::env::args().nth(1).map_or(Ok(1), |seed| seed.parse())?;
    let world = World::new(&WorldConfig::new(seed).num_places(4))?;
    let schedule = Schedule::standard(seed, 24, 4);
    let extractor = StarBrief::new(StarBriefConfig::default())?;

    // Learn a year.
    let meta = MapMeta::new(derived_uuid("robot loop"), extractor.id(), "default");
    let mut learner = Learner::new(LearnConfig::default(), meta);
    let mut num_born = 0;
    for entry in world.dataset("2023", &schedule.learn).entries {
        let (features, image_size) = look(&extractor, &entry)?;
        let learnt = learner.observe(&Observation {
            session: SessionId::derive(&entry.time.to_string()),
            place: entry.place,
            time: entry.time,
            features: &features,
            image_size,
            mask: None,
            source: entry.id,
        })?;
        num_born += learnt.num_born;
    }
    let snapshot = learner.snapshot()?;
    println!(
        "learnt {num_born} features of {} places in {} rounds",
        snapshot.nodes.len(),
        schedule.learn.len()
    );

    // Localise the next year. The localiser is shared between threads, scratch and output are not.
    let localizer = Localizer::new(snapshot, LocalizerConfig::default())?;
    let mut scratch = localizer.scratch();
    let mut answer = Localization::default();
    let (mut num_right, mut num_wrong, mut num_undecided) = (0, 0, 0);
    let mut busy = Duration::ZERO;
    for entry in world.dataset("2024", &schedule.query).entries {
        let (features, image_size) = look(&extractor, &entry)?;
        let query = Query::new(&features)
            .at(entry.time)
            .with_image_size(image_size);
        let started = Instant::now();
        localizer.localize_into(&mut scratch, &query, &mut answer)?;
        busy += started.elapsed();
        let belief = match answer.decision {
            Decision::At(node) => localizer.snapshot().node(node).key.as_str(),
            Decision::Ambiguous => "ambiguous",
            _ => "unknown",
        };
        match answer.decision {
            Decision::At(_) if belief == entry.place.as_str() => num_right += 1,
            Decision::At(_) => num_wrong += 1,
            _ => num_undecided += 1,
        }
        println!(
            "{} at {}: {belief} ({})",
            entry.place, entry.time, answer.reason
        );
    }
    let num_queries = num_right + num_wrong + num_undecided;
    println!(
        "{num_right} right, {num_wrong} wrong, {num_undecided} undecided; {:.2} ms an image to locate",
        busy.as_secs_f64() * 1e3 / f64::from(num_queries.max(1))
    );
    Ok(())
}
