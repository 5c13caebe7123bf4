//! What does a map say of itself, in the words of the command's `--json`?

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use chronotope::localize::Localizer;
use chronotope::map::{
    AppearanceUse, Generation, Map, Node, NodeId, Quarantine, SessionId, Snapshot, VerifyReport,
};
use chronotope::predict::PredictedMap;
use chronotope::{Result, Time};
use serde_json::{Value, json};

pub(crate) fn hex(bytes: &[u8]) -> String {
    use std::fmt::Write as _;
    bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

/// `chronotope map inspect --json`.
pub(crate) fn inspect(path: &Path, snapshot: &Snapshot) -> Value {
    let summary = snapshot.summary();
    let meta = snapshot.meta();
    let num_bytes = std::fs::metadata(path).map_or(0, |file| file.len());
    let text = |time: Option<Time>| time.map(|time| time.to_string());
    let places: Vec<_> = snapshot.nodes().iter().map(|node| place(node)).collect();
    json!({
        "map": path,
        "num_bytes": num_bytes,
        "uuid": format!("{:032x}", meta.uuid),
        "generation": summary.generation,
        "digest": hex(&snapshot.digest()),
        "preset": meta.preset,
        "extractor": meta.extractor,
        "image_size": meta.image_size,
        "crop": meta.crop,
        "zone": meta.zone,
        "num_places": summary.num_places,
        "num_visits": summary.num_visits,
        "num_sessions": summary.num_sessions,
        "num_features": summary.num_features,
        "num_appearances": summary.num_appearances,
        "num_experiences": summary.num_experiences,
        "first": text(summary.first),
        "last": text(summary.last),
        "places": places,
        "edges": snapshot.edges(),
    })
}

fn place(node: &Node) -> Value {
    let (first, last) = node.time_span().unzip();
    let experiences = (node.visits().iter())
        .filter(|visit| visit.appearance_use == AppearanceUse::Experience)
        .count();
    json!({
        "key": node.key(),
        "num_visits": node.visits().len(),
        "num_features": node.features().len(),
        "num_experiences": experiences,
        "first": first.map(|time| time.to_string()),
        "last": last.map(|time| time.to_string()),
        "pose": node.pose(),
    })
}

/// `chronotope map verify --json`.
pub(crate) fn verify(path: &Path, report: &VerifyReport) -> Value {
    let faults: Vec<_> = report.faults.iter().map(ToString::to_string).collect();
    json!({
        "map": path,
        "clean": report.is_clean(),
        "generation": report.generation,
        "digest": report.digest.map(|digest| hex(&digest)),
        "num_places": report.num_places,
        "num_visits": report.num_visits,
        "num_features": report.num_features,
        "faults": faults,
    })
}

/// `chronotope map log --json`, one object a generation.
pub(crate) fn log(generations: &[Generation], newest: &Snapshot) -> Vec<Value> {
    let sessions = sessions_of(newest);
    let parents: BTreeMap<u64, Option<u64>> = generations
        .iter()
        .map(|it| (it.number, it.parent))
        .collect();
    let newest = generations.last().map(|it| it.number);
    let lead_here: BTreeSet<u64> =
        std::iter::successors(newest, |number| parents.get(number).copied().flatten()).collect();
    let by_number: BTreeMap<u64, &Generation> =
        generations.iter().map(|it| (it.number, it)).collect();
    let line = |it: &Generation| {
        let before = it.parent.and_then(|parent| by_number.get(&parent).copied());
        let added = |count: fn(&Generation) -> usize| {
            count(it) as i64 - before.map_or(0, |before| count(before) as i64)
        };
        json!({
            "number": it.number,
            "parent": it.parent,
            "time": it.time.to_string(),
            "is_in_line": lead_here.contains(&it.number),
            "is_rollback": before.is_some_and(|before| before.digest == it.digest),
            "num_places": it.num_places,
            "num_visits": it.num_visits,
            "num_features": it.num_features,
            "added_places": added(|it| it.num_places),
            "added_visits": added(|it| it.num_visits),
            "added_features": added(|it| it.num_features),
            "digest": hex(&it.digest),
            "sessions": if Some(it.number) == newest { sessions.as_slice() } else { &[] },
        })
    };
    generations.iter().map(line).collect()
}

/// The runs whose visits a map holds, in order of their first one.
fn sessions_of(snapshot: &Snapshot) -> Vec<Value> {
    let mut runs: BTreeMap<SessionId, (usize, Time, Time)> = BTreeMap::new();
    for visit in snapshot.nodes().iter().flat_map(|node| node.visits()) {
        let run = runs
            .entry(visit.session)
            .or_insert((0, visit.time, visit.time));
        *run = (run.0 + 1, run.1.min(visit.time), run.2.max(visit.time));
    }
    let mut runs: Vec<_> = runs.into_iter().collect();
    runs.sort_by_key(|(session, run)| (run.1, *session));
    let line = |(session, (num_visits, first, last)): (SessionId, (usize, Time, Time))| {
        json!({
            "session": session.to_string(),
            "num_visits": num_visits,
            "first": first.to_string(),
            "last": last.to_string(),
        })
    };
    runs.into_iter().map(line).collect()
}

/// `chronotope map held --json`, one object a visit.
pub(crate) fn held(map: &Map) -> Result<Vec<Value>> {
    let held = Quarantine::of(&map.snapshot()).map_err(|error| error.with_path(map.path()))?;
    let given_up = held.given_up().iter().map(|it| (it, true));
    let all = given_up.chain(held.visits().iter().map(|it| (it, false)));
    let line = all.map(|(it, is_given_up)| {
        json!({
            "visit": it.id.to_string(),
            "place": it.place,
            "session": it.session.to_string(),
            "time": it.time.to_string(),
            "source": it.source,
            "num_features": it.features.len(),
            "given_up": is_given_up,
            "doubt": it.reason,
            "reason": it.reason.to_string(),
        })
    });
    Ok(line.collect())
}

/// What a place should look like at a time.
pub(crate) struct Predicted {
    pub(crate) place: String,
    pub(crate) time: Time,
    pub(crate) num_features: usize,
    pub(crate) ids: Vec<u32>,
    pub(crate) xy: Vec<f32>,
    /// p with the ends of its 95 % interval, three a feature.
    pub(crate) p: Vec<f64>,
}

impl Predicted {
    /// What `localizer` predicts of a place; `None` for a place without a model.
    pub(crate) fn of(localizer: &Localizer, id: NodeId, time: Time) -> Result<Option<Self>> {
        let Some(model) = localizer.model(id) else {
            return Ok(None);
        };
        let mut predicted = PredictedMap::new();
        predicted.predict(model, time, localizer.cfg().selection());
        let node = localizer.snapshot().node(id);
        let sure = localizer.cautious_model(id)?;
        let mut this = Self {
            place: node.key().as_str().to_owned(),
            time,
            num_features: node.features().len(),
            ids: predicted.features().to_vec(),
            xy: Vec::new(),
            p: Vec::new(),
        };
        for (&id, &p) in predicted.features().iter().zip(predicted.probabilities()) {
            let keypoint = node.features().keypoints()[id as usize];
            let at = sure.estimate(id as usize, time);
            this.xy.extend([keypoint.x, keypoint.y]);
            this.p.extend([p, at.low.min(p), at.high.max(p)]);
        }
        Ok(Some(this))
    }

    /// `chronotope predict --json`.
    pub(crate) fn to_json(&self) -> Value {
        let features: Vec<_> = (0..self.ids.len())
            .map(|at| {
                json!({
                    "id": self.ids[at], "x": self.xy[2 * at], "y": self.xy[2 * at + 1],
                    "p": self.p[3 * at], "low": self.p[3 * at + 1], "high": self.p[3 * at + 2],
                })
            })
            .collect();
        json!({
            "place": self.place,
            "time": self.time.to_string(),
            "num_features": self.num_features,
            "features": features,
        })
    }
}
