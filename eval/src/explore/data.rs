//! What did every place of a world show, minute by minute?

use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use chronotope::Time;
use fremen_explore::{Recording, Roads};
use sha2::{Digest, Sha256};

use crate::provenance::hex;
use crate::suite::World;

/// A world to explore.
pub(super) struct Dataset {
    pub(super) recording: Recording,
    /// How many slots a day has.
    pub(super) slots_a_day: usize,
    /// How often states are known, in words.
    pub(super) moments: &'static str,
    /// Where driving takes time.
    pub(super) roads: Option<Roads>,
    /// Errors of RAS 2016, table 1, symbolic, in percent: strategies by models.
    pub(super) published: Option<&'static [[f64; 4]; 5]>,
    pub(super) sha256: String,
}

/// Round robin, random, greedy, Monte Carlo, novelty; short-term, long-term, FreMEn, mixture.
const PUBLISHED: [[f64; 4]; 5] = [
    [9.3, 9.7, 6.5, 7.5],
    [8.9, 9.5, 9.2, 7.5],
    [8.5, 8.7, 7.0, 9.4],
    [8.5, 8.9, 5.8, 6.4],
    [8.5, 8.9, 5.7, 6.1],
];

/// Reads the series of a world from the folder of all datasets.
pub(super) fn read(world: World, data: &Path) -> Result<Dataset> {
    let (rooms, names) = match world {
        World::Aruba | World::ArubaTravel => ("aruba/location.min", "aruba/location.names"),
        World::Witham => ("people/witham_location.min", "people/witham_location.names"),
        World::LasVegas => bail!("the views of a camera are no series"),
    };
    let mut digest = Sha256::new();
    let recording = people(data, rooms, names, &mut digest)?;
    let roads = match world {
        World::ArubaTravel => Some(topology(data, &recording, &mut digest)?),
        World::Aruba | World::Witham | World::LasVegas => None,
    };
    Ok(Dataset {
        recording,
        slots_a_day: 144,
        moments: "one moment a minute",
        roads,
        published: (world == World::Aruba).then_some(&PUBLISHED),
        sha256: hex(&digest.finalize()),
    })
}

fn text(data: &Path, name: &str, digest: &mut Sha256) -> Result<String> {
    let path = data.join("series").join(name);
    let unreadable = || format!("cannot read {}", path.display());
    let bytes = std::fs::read(&path).with_context(unreadable)?;
    digest.update(&bytes);
    String::from_utf8(bytes).with_context(unreadable)
}

/// Where somebody is in each minute, as a place with one state for each name; ids count from 1.
fn people(data: &Path, rooms: &str, names: &str, digest: &mut Sha256) -> Result<Recording> {
    let ids = text(data, rooms, digest)?;
    let ids = ids.lines().enumerate().map(|(row, line)| {
        let bad = || format!("{rooms}, line {}: `{line}` is no number", row + 1);
        line.trim().parse::<usize>().with_context(bad)
    });
    let ids: Vec<usize> = ids.collect::<Result<_>>()?;
    let names = text(data, names, digest)?;
    let num_places = names.lines().count();
    ensure!(
        ids.iter().all(|id| (1..=num_places).contains(id)),
        "{rooms}: a room is not one of {num_places}"
    );
    let minutes = (0..ids.len()).map(|minute| Time::from_s(minute as i64 * 60));
    let mut recording = Recording::new(minutes.collect())?;
    for (place, name) in names.lines().enumerate() {
        let states = ids.iter().map(|&id| id == place + 1).collect();
        recording.push(name.trim(), 1, states)?;
    }
    Ok(recording)
}

/// Travel times between the rooms of Aruba, one of which has another name there.
fn topology(data: &Path, recording: &Recording, digest: &mut Sha256) -> Result<Roads> {
    let names: Vec<&str> = (recording.places())
        .map(|(name, _)| if name == "Junction" { "Center" } else { name })
        .collect();
    let text = text(data, "people/aruba_topology.txt", digest)?;
    Ok(Roads::parse(&text, &names)?)
}
