//! A robot that learns while it localises, on a rendered street: a year of rounds that somebody
//! labelled, then a drive through the next one.
//!
//! `cargo run --release --example robot_loop -- [SEED]`
#![allow(clippy::print_stdout)] // reason: an example shows what it does.

use std::error::Error;
use std::path::Path;

use chronotope::dataset::synthetic::{Schedule, World, WorldConfig};
use chronotope::feature::{Extractor, StarBrief, StarBriefConfig};
use chronotope::learn::{LearnConfig, Learner, Observation};
use chronotope::map::{Map, MapMeta, SessionId, derived_uuid};
use chronotope::robot::{Event, Frame, Robot, RobotConfig};

fn main() -> Result<(), Box<dyn Error>> {
    let seed = std::env::args().nth(1).map_or(Ok(1), |seed| seed.parse())?;
    let world = World::new(&WorldConfig::new(seed).with_num_places(4))?;
    let schedule = Schedule::standard(seed, 24, 6);
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("street.map");
    learn_a_year(&world, &schedule, &path)?;

    let cfg = RobotConfig::default().with_learning(LearnConfig::default());
    let mut robot = Robot::open(&path, cfg)?;
    let (mut num_right, mut num_wrong) = (0, 0);
    for entry in world.dataset("2024", &schedule.query).entries {
        let image = entry.source.load()?;
        // On a robot: `robot.see(&image, Time::now())`. Here the clock is that of the street.
        let frame = Frame::new(&image).at(entry.time).with_now(entry.time);
        let reason = robot.see_frame(&frame)?.reason;
        let believed = robot.place().map_or("unknown", |place| place.as_str());
        num_right += u32::from(believed == entry.place.as_str());
        num_wrong += u32::from(robot.place().is_some() && believed != entry.place.as_str());
        println!("{} at {}: {believed} ({reason})", entry.place, entry.time);
        for event in robot.events() {
            if let Event::Committed { generation, .. } = event {
                println!("  the map is at generation {generation}");
            }
        }
    }
    let totals = robot.finish()?;
    println!(
        "{} images: {num_right} right, {num_wrong} wrong; {} learnt, {} quarantined",
        totals.num_images, totals.num_learnt, totals.num_quarantined
    );
    Ok(())
}

/// What a person with labelled images does once: `chronotope map build` does it from a folder.
fn learn_a_year(world: &World, schedule: &Schedule, path: &Path) -> chronotope::Result<()> {
    let extractor = StarBrief::new(StarBriefConfig::default())?;
    let meta = MapMeta::new(derived_uuid("robot loop"), extractor.id(), "default");
    let map = Map::create(path, meta.clone())?;
    let mut learner = Learner::new(LearnConfig::default(), meta);
    for entry in world.dataset("2023", &schedule.learn).entries {
        let image = entry.source.load()?;
        learner.observe(
            &Observation::new(
                entry.place,
                SessionId::derive(&entry.time.to_string()),
                entry.time,
                &extractor.extract(&image, None)?,
                image.size(),
            )
            .with_source(entry.id),
        )?;
    }
    map.commit(&*learner.snapshot()?)?;
    Ok(())
}
