//! How is a map corrected, merged and taken back to what it was?
//!
//! The sentences of the commands `map merge`, `accept`, `drop`, `forget`, `edge`, `place` and
//! `calibrate`, for the methods of `Map`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

use chronotope::learn::{self, LearnConfig, forget_session};
use chronotope::localize::{ATTACHMENT, Localizer, LocalizerConfig};
use chronotope::map::{Edge, Generation, Map, PlaceKey, Quarantine, SessionId, Snapshot, VisitId};
use chronotope::time::Period;
use chronotope::{Error, ErrorKind, Result};

/// The place that is called so, however its letters are composed.
pub(crate) fn known_or_written(map: &Snapshot, text: &str) -> Result<PlaceKey> {
    let as_it_is = PlaceKey::new(text)?;
    match map.find(&as_it_is) {
        Some(_) => Ok(as_it_is),
        None => PlaceKey::written(text),
    }
}

/// Merges maps and writes the result as a new one.
pub(crate) fn merge(
    maps: &[(std::path::PathBuf, Arc<Snapshot>)],
    out: &Path,
    is_disjoint: bool,
    relearn: Option<LearnConfig>,
) -> Result<Map> {
    Map::refuse_existing(out)?;
    let snapshots: Vec<&Snapshot> = maps.iter().map(|(_, map)| &**map).collect();
    if !is_disjoint {
        refuse_strangers(maps, &snapshots)?;
    }
    let mut merged = learn::merge(&snapshots)?;
    if let Some(cfg) = relearn {
        merged = learn::relearn(cfg, &merged)?;
    }
    Map::create_from(out, &merged)
}

/// Maps that have nothing in common, along any chain, are of different places or a mistake.
fn refuse_strangers(
    maps: &[(std::path::PathBuf, Arc<Snapshot>)],
    snapshots: &[&Snapshot],
) -> Result<()> {
    let Some(stranger) = learn::stranger_among(&LearnConfig::default(), snapshots) else {
        return Ok(());
    };
    let message = format!(
        "this map has nothing in common with {}: no visit, and no place of one name that looks \
         alike",
        maps[0].0.display()
    );
    Err(Error::new(ErrorKind::Config, message)
        .with_path(&maps[stranger].0)
        .with_help("disjoint=True merges maps of different places"))
}

/// The visits that are held and meant; all of them if none is named. `with_given_up`: also those that
/// cannot be accepted any more.
pub(crate) fn held_ids(
    map: &Map,
    ids: Option<&[String]>,
    with_given_up: bool,
) -> Result<Vec<VisitId>> {
    let held = Quarantine::of(&map.snapshot()).map_err(|error| error.with_path(map.path()))?;
    let Some(ids) = ids else {
        return Ok(held.ids(with_given_up));
    };
    held.choose(ids, with_given_up).map_err(|error| {
        error
            .with_path(map.path())
            .with_help("map.held() lists the visits")
    })
}

/// Takes back all visits of a run, and says how many.
pub(crate) fn forget(map: &Map, session: &str) -> Result<usize> {
    let session = session_of(&map.snapshot(), session);
    let mut num_visits = 0;
    map.update(|snapshot| {
        let (forgotten, num_forgotten) = forget_session(snapshot, session)?;
        num_visits = num_forgotten;
        Ok(forgotten)
    })
    .map_err(|error| error.with_path(map.path()))?;
    Ok(num_visits)
}

/// The session with this UUID, if the map has one, else the one derived from this name.
fn session_of(snapshot: &Snapshot, text: &str) -> SessionId {
    let digits: String = text.chars().filter(|&c| c != '-').collect();
    let named = SessionId::derive(text);
    let uuid = (digits.len() == 32)
        .then(|| u128::from_str_radix(&digits, 16).ok())
        .flatten();
    let is_known = |session: SessionId| {
        let mut visits = snapshot.nodes().iter().flat_map(|node| node.visits());
        visits.any(|visit| visit.session == session)
    };
    match uuid.map(SessionId) {
        Some(session) if !is_known(named) => session,
        _ => named,
    }
}

pub(crate) fn add_edge(map: &Map, from: &str, to: &str, name: &str) -> Result<u64> {
    map.update(|snapshot| {
        let mut snapshot = snapshot.clone();
        snapshot.add_edge(Edge {
            from: PlaceKey::written(from)?,
            to: PlaceKey::written(to)?,
            name: name.to_owned(),
        })?;
        Ok(snapshot)
    })
    .map_err(|error| error.with_path(map.path()))
}

pub(crate) fn remove_edge(map: &Map, from: &str, to: &str, name: Option<&str>) -> Result<u64> {
    map.update(|snapshot| {
        let mut snapshot = snapshot.clone();
        let (from, to) = (PlaceKey::written(from)?, PlaceKey::written(to)?);
        let num_before = snapshot.edges().len();
        snapshot.retain_edges(|edge| {
            let is_meant = (&edge.from, &edge.to) == (&from, &to);
            !(is_meant && name.is_none_or(|name| name == edge.name))
        });
        if snapshot.edges().len() == num_before {
            let what = format!("there is no such edge from `{from}` to `{to}`");
            return Err(Error::new(ErrorKind::NotFound, what).with_help("map.edges shows all"));
        }
        Ok(snapshot)
    })
    .map_err(|error| error.with_path(map.path()))
}

/// What is done to a place by hand.
pub(crate) enum Correction<'a> {
    Rename {
        to: &'a str,
    },
    Remove,
    /// The visits of the other become visits of this one.
    Join {
        other: &'a str,
    },
}

pub(crate) fn correct(map: &Map, place: &str, correction: &Correction<'_>) -> Result<u64> {
    map.update(|snapshot| {
        let place = known_or_written(snapshot, place)?;
        match correction {
            Correction::Rename { to } => {
                learn::rename_place(snapshot, &place, &PlaceKey::written(to)?)
            }
            Correction::Remove => learn::remove_place(snapshot, &place),
            Correction::Join { other } => {
                learn::join_places(snapshot, &place, &known_or_written(snapshot, other)?)
            }
        }
    })
    .map_err(|error| error.with_path(map.path()))
}

/// Keeps with the map what matches in it are worth; says on how many images, or nothing if it was
/// known.
pub(crate) fn calibrate(map: &Map, cfg: LocalizerConfig) -> Result<Option<usize>> {
    let snapshot = map.snapshot();
    let localizer =
        Localizer::new(Arc::clone(&snapshot), cfg).map_err(|error| error.with_path(map.path()))?;
    let (Some(calibration), Some(bytes)) = (localizer.calibration(), localizer.to_attachment()?)
    else {
        let error = Error::new(ErrorKind::Config, "this configuration calibrates nothing");
        return Err(error
            .with_path(map.path())
            .with_help("set config={\"calibrated\": True}"));
    };
    if snapshot.attachments().get(ATTACHMENT) == Some(&bytes) {
        return Ok(None);
    }
    map.update(|snapshot| {
        let mut next = Snapshot::clone(snapshot);
        next.attach(ATTACHMENT, Arc::clone(&bytes))?;
        Ok(next)
    })?;
    Ok(Some(calibration.num_images()))
}

/// The generations that stay when a map is pruned.
pub(crate) fn kept(
    generations: &[Generation],
    keep_last: usize,
    keep_daily: bool,
    keep: &[u64],
) -> BTreeSet<u64> {
    let mut kept: BTreeSet<u64> = keep.iter().copied().collect();
    kept.extend(generations.first().map(|it| it.number));
    let last = generations.iter().rev().take(keep_last.max(1));
    kept.extend(last.map(|it| it.number));
    if keep_daily {
        let day = |it: &Generation| it.time.as_us().div_euclid(Period::DAY.as_us());
        // The last one of a day replaces those before it.
        let last_of_day: BTreeMap<i64, u64> =
            generations.iter().map(|it| (day(it), it.number)).collect();
        kept.extend(last_of_day.into_values());
    }
    kept
}
