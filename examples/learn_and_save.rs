//! Learns a street from rendered images, keeps the map in a file, opens it again and localises
//! a later image.
//!
//! `cargo run --release --example learn_and_save -- [MAP]`; without a name the map goes to a
//! temporary folder and is removed at the end. `chronotope map inspect MAP` shows what it
//! remembers.
#![allow(clippy::print_stdout)] // reason: an example shows what it does.

use std::error::Error;
use std::path::PathBuf;

use chronotope::dataset::synthetic::{Schedule, World, WorldConfig};
use chronotope::feature::{Extractor, StarBrief, StarBriefConfig};
use chronotope::learn::{LearnConfig, Learner, Observation};
use chronotope::localize::{Decision, Localizer, LocalizerConfig, Query};
use chronotope::map::{Map, MapMeta, SessionId, random_uuid};

fn main() -> Result<(), Box<dyn Error>> {
    let temporary = tempfile::tempdir()?;
    let path = std::env::args_os()
        .nth(1)
        .map_or_else(|| temporary.path().join("street.map"), PathBuf::from);

    // Any source of grey images with places and times would do: `Dataset::open` reads folders.
    let world = World::new(&WorldConfig::new(3).with_num_places(3))?;
    let schedule = Schedule::standard(3, 12, 1);
    let extractor = StarBrief::new(StarBriefConfig::default())?;

    // Learn one visit after another and commit each round: what is committed survives a power cut.
    let meta = MapMeta::new(random_uuid(), extractor.id(), "default");
    let map = Map::create(&path, meta)?;
    let mut learner = Learner::resume(LearnConfig::default(), map.snapshot().as_ref().clone())?;
    for &round in &schedule.learn {
        let session = SessionId::random();
        for entry in world.dataset("street", &[round]).entries {
            let image = entry.source.load()?;
            let features = extractor.extract(&image, None)?;
            learner.observe(
                &Observation::new(entry.place, session, entry.time, &features, image.size())
                    .with_source(entry.id),
            )?;
        }
        map.commit(learner.snapshot()?.as_ref())?;
    }
    drop(map);

    // Another program, another day: the file is all there is.
    let map = Map::open_read_only(&path)?;
    let snapshot = map.snapshot();
    println!(
        "{}: generation {}, {} places",
        path.display(),
        snapshot.generation(),
        snapshot.nodes().len()
    );
    let localizer = Localizer::new(snapshot, LocalizerConfig::default())?;
    let mut scratch = localizer.scratch();
    for entry in world.dataset("later", &schedule.query).entries {
        let features = extractor.extract(&entry.source.load()?, None)?;
        let query = Query::new(&features).at(entry.time);
        let answer = localizer.localize(&mut scratch, &query)?;
        let belief = match answer.decision {
            Decision::At(node) => localizer.snapshot().node(node).key().to_string(),
            Decision::Ambiguous => "one of several".into(),
            _ => "unknown".into(),
        };
        println!("{}: {belief} ({})", entry.id, answer.reason);
    }
    Ok(())
}
