//! How does a map become Parquet tables of observations and features, and how do these become a map?
//!
//! The tables say which feature was seen at which visit, and how features look: what a fleet learns from, and
//! what a robot needs to localise itself. They do not hold the images' own features, positions and ways, what
//! was counted, nor the map's size of images, crop and time zone; the folder of `map export` holds
//! everything.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use anyhow::Result;
use chronotope::error::{Error, ErrorKind};
use chronotope::feature::{Descriptor, ExtractorConfig, Features, Keypoint, StarBriefConfig};
use chronotope::learn::LearnConfig;
use chronotope::localize::Preset;
use chronotope::map::{
    AppearanceUse, MapMeta, Node, PlaceKey, SessionId, Snapshot, Visit, VisitId, derived_uuid,
};
use chronotope_fleet::States;
use chronotope_fleet::table::{
    FeatureRow, FeatureWriter, ObservationWriter, ReadConfig, SUCCESS, TableFolder, read_extractor,
    read_features, read_observations, read_series,
};
use fremen::visibility::{BitRow, FeatureState};
use fremen::{Series, Time};

const OBSERVATIONS: &str = "observations.parquet";
const FEATURES: &str = "features.parquet";

/// The history of one feature in a table of observations.
pub(super) fn series(path: &Path, place: Option<&str>, feature: Option<u32>) -> Result<Series> {
    let files = chronotope_fleet::table::files_of(&[path.to_owned()])?;
    Ok(read_series(&files, place, feature)?)
}

/// Writes both tables of a map into a folder that must not exist yet.
pub(super) fn export(map: &Snapshot, folder: &Path) -> Result<()> {
    let output = TableFolder::begin(folder)?;
    let mut observations = ObservationWriter::begin(output.file(OBSERVATIONS))?;
    let mut features = FeatureWriter::begin(output.file(FEATURES), &map.meta().extractor)?;
    for node in map.nodes() {
        for (at, visit) in node.visits().iter().enumerate() {
            let states = (0..node.log().seen_row(at).len()).filter_map(|feature| {
                match node.log().state(at, feature)? {
                    FeatureState::Seen => Some((feature as u32, true)),
                    FeatureState::NotSeen => Some((feature as u32, false)),
                    FeatureState::NotObservable => None,
                }
            });
            let states: States = states.collect();
            observations.visit(node.key().as_str(), visit.id.0, visit.time, &states)?;
        }
        features.write(&feature_rows(node))?;
    }
    observations.finish()?;
    features.finish()?;
    Ok(output.finish()?)
}

fn feature_rows(node: &Node) -> Vec<FeatureRow> {
    let visits = node.visits().iter().enumerate();
    let born = visits.flat_map(|(at, visit)| node.born_at(at).map(|feature| (feature, visit.id.0)));
    let row = |(feature, born): (usize, u128)| {
        let keypoint = node.features().keypoints()[feature];
        FeatureRow {
            place: node.key().to_string(),
            feature: feature as u32,
            x: keypoint.x,
            y: keypoint.y,
            size: keypoint.size,
            response: keypoint.response,
            descriptor: node.features().descriptors()[feature].to_bytes(),
            born,
        }
    };
    born.map(row).collect()
}

/// The identity of the extractor whose features a table holds; of one that does not say so, the default.
fn extractor_of(features: &Path) -> Result<String> {
    let Some(id) = read_extractor(&[features.to_owned()])? else {
        let num_features = LearnConfig::preset(Preset::Default).features_per_visit();
        let extractor = StarBriefConfig::default().with_num_features(num_features);
        return Ok(ExtractorConfig::StarBrief(extractor).build()?.id());
    };
    ExtractorConfig::from_id(&id).map_err(|error| error.with_path(features))?;
    Ok(id)
}

/// The map of a folder with both tables.
pub(super) fn import(folder: &Path) -> Result<Snapshot> {
    if !folder.join(SUCCESS).exists() {
        let error = Error::new(ErrorKind::Format, format!("this folder has no {SUCCESS}"));
        return Err(error
            .with_path(folder)
            .with_help("whoever writes it is not finished, or has failed: write it again")
            .into());
    }
    let path = |name: &str| -> PathBuf { folder.join(name) };
    let (log, _) = read_observations(&[path(OBSERVATIONS)], &ReadConfig::default())?;
    let mut features = BTreeMap::<String, Vec<FeatureRow>>::new();
    for row in read_features(&[path(FEATURES)])? {
        features.entry(row.place.clone()).or_default().push(row);
    }
    let extractor = extractor_of(&path(FEATURES))?;
    // The same tables give the same map.
    let mut seed = String::new();
    let mut nodes = Vec::new();
    for place in log.places() {
        let refused = |message: String| {
            Error::new(ErrorKind::Format, message)
                .with_path(path(FEATURES))
                .with_place(format!("place `{}`", place.key()))
                .with_help("write both tables of the same places, with features numbered from 0")
        };
        let rows = features.remove(place.key()).unwrap_or_default();
        let visits = place
            .visits()
            .iter()
            .map(|it| (it.id, (it.time, &it.states)));
        let node = node_of(place.key(), rows, &visits.collect()).map_err(refused)??;
        seed.extend(node.visits().iter().map(|visit| format!("{}\n", visit.id)));
        nodes.push(node);
    }
    if let Some(place) = features.keys().next() {
        let message = format!("place `{place}` has features, and no observations");
        let error = Error::new(ErrorKind::Format, message).with_path(path(FEATURES));
        return Err(error
            .with_help("write both tables of the same places")
            .into());
    }
    let uuid = derived_uuid(&seed);
    let mut snapshot = Snapshot::empty(MapMeta::new(uuid, extractor, Preset::Default.name()));
    for node in nodes {
        snapshot.push_node(node)?;
    }
    Ok(snapshot)
}

/// What was observed at each visit of a place.
type Observed<'a> = BTreeMap<u128, (Time, &'a States)>;

/// How many features were known at each visit, its time and identity, in the order of the visits: features
/// are numbered in the order in which they were born. What does not fit is said in words.
fn in_order(
    rows: &[FeatureRow],
    visits: &Observed<'_>,
) -> Result<BTreeSet<(usize, bool, Time, u128)>, String> {
    if let Some(at) = (0..rows.len()).find(|&at| rows[at].feature as usize != at) {
        return Err(format!("feature {at} is missing, or there twice"));
    }
    let mut last_born = BTreeMap::<u128, usize>::new();
    for row in rows {
        if !visits.contains_key(&row.born) {
            let (feature, born) = (row.feature, row.born);
            return Err(format!(
                "feature {feature} was born at visit {born:032x}, which observes nothing"
            ));
        }
        last_born.insert(row.born, row.feature as usize);
    }
    let mut order = BTreeSet::new();
    for (&id, (time, states)) in visits {
        let born = last_born.get(&id).map_or(0, |last| last + 1);
        let observed = states.iter().map(|(feature, _)| feature as usize + 1).max();
        let num_known = born.max(observed.unwrap_or(0));
        if num_known > rows.len() {
            return Err(format!(
                "visit {id:032x} observes feature {}, which is not there",
                num_known - 1
            ));
        }
        order.insert((num_known, born == 0, *time, id));
    }
    Ok(order)
}

/// A place, of its features and of what was observed of them at each visit. What does not fit is said in words.
fn node_of(
    key: &str,
    mut rows: Vec<FeatureRow>,
    visits: &Observed<'_>,
) -> Result<Result<Node>, String> {
    rows.sort_by_key(|row| row.feature);
    let order = in_order(&rows, visits)?;
    let node = PlaceKey::new(key).map(Node::new);
    let mut node = match node {
        Ok(node) => node,
        Err(error) => return Ok(Err(error.into())),
    };
    for (num_known, _is_old, time, id) in order {
        let num_before = node.features().len();
        let mut born = Features::new();
        for row in &rows[num_before..num_known] {
            if row.born != id {
                return Err(format!(
                    "feature {} is born after one with a higher number",
                    row.feature
                ));
            }
            let keypoint = Keypoint {
                x: row.x,
                y: row.y,
                size: row.size,
                response: row.response,
            };
            born.push(keypoint, Descriptor::from_bytes(row.descriptor));
        }
        let (mut seen, mut hidden) = (BitRow::zeros(num_known), BitRow::zeros(num_known));
        let states: BTreeMap<u32, bool> = visits[&id].1.iter().collect();
        for feature in 0..num_known {
            match states.get(&(feature as u32)) {
                Some(true) => seen.set(feature),
                Some(false) => {}
                None => hidden.set(feature),
            }
        }
        let visit = Visit {
            id: VisitId(id),
            session: SessionId::derive("parquet"),
            time,
            source: String::new(),
            appearance: None,
            appearance_use: AppearanceUse::Recognised,
        };
        let located_by = node.unlocated(visit.appearance_use);
        let hidden = (hidden.count_ones() > 0).then_some(hidden);
        if let Err(error) = node.push_visit(visit, &born, seen, hidden, located_by) {
            return Ok(Err(error.into()));
        }
    }
    Ok(Ok(node))
}
