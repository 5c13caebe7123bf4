//! Is what this map's past visits say already known?
//!
//! Calibrating asks past visits, which takes from a tenth of a second to a few seconds. The result can be
//! kept with the map, as the attachment [`ATTACHMENT`]: JSON of the calibration and of a key, a SHA-256
//! over everything that it was learnt from: the configuration, the identities of all visits (which
//! contain the digests of their images' features), what each saw, the other attachments, and this crate's
//! version. A localizer whose key differs, or whose copy does not hold
//! together, calibrates anew; a stored one is never trusted for its name.
//!
//! The key does not contain itself, so attaching a calibration keeps it valid, while one more visit makes
//! it stale. Cost: one bit a feature and visit to make the key, O(bytes) to read.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::{Calibration, SIZES};
use crate::localize::{Candidates, Localizer, LocalizerConfig, Score};
use crate::map::Snapshot;
use crate::predict::Selection;
use fremen::error::{Error, ErrorKind, Result};

/// The name of the attachment.
pub const ATTACHMENT: &str = "calibration";

/// Grows when what is stored changes its meaning.
pub(in crate::localize) const VERSION: u32 = 2;

/// A SHA-256.
type Key = [u8; 32];

#[derive(Serialize)]
struct Written<'a> {
    version: u32,
    key: Key,
    calibration: &'a Calibration,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Read {
    version: u32,
    key: Key,
    calibration: Calibration,
}

impl Calibration {
    /// The calibration that is attached to `snapshot`, if it was learnt from just this map by just this
    /// configuration.
    pub(in crate::localize) fn attached(
        snapshot: &Snapshot,
        cfg: &LocalizerConfig,
    ) -> Option<Self> {
        let bytes = snapshot.attachments.get(ATTACHMENT)?;
        let read: Read = serde_json::from_slice(bytes).ok()?;
        let is_ours = read.version == VERSION
            && key(snapshot, cfg).is_ok_and(|key| key == read.key)
            && read.calibration.holds_together(snapshot);
        is_ours.then_some(read.calibration)
    }

    /// Whether a copy from outside can be used without surprises.
    pub(in crate::localize) fn holds_together(&self, snapshot: &Snapshot) -> bool {
        let num_places = snapshot.nodes.len();
        let is_rate = |rate: &f64| (0.0..=1.0).contains(rate);
        let knots = self.detection.knots();
        let tempers = self.tempers.iter().flatten();
        !knots.is_empty()
            && knots.is_sorted_by(|a, b| a.0 <= b.0 && a.1 <= b.1)
            && knots
                .iter()
                .all(|(score, rate)| score.is_finite() && is_rate(rate))
            && is_rate(&self.false_rate)
            && [0, num_places].contains(&self.repeatability.len())
            && self
                .repeatability
                .iter()
                .all(|it| it.is_finite() && *it >= 0.0)
            && [0, num_places].contains(&self.stray_rates.len())
            && (self.stray_rates.iter()).all(|rate| *rate > 0.0 && *rate < 1.0)
            && self.stray_ratio.is_finite()
            && self.stray_ratio > 0.0
            && [0, num_places].contains(&self.false_counts.len())
            && self.distance_log_ratios.len() == 257
            && self.distance_log_ratios.iter().all(|it| it.is_finite())
            && self.displacement.is_none_or(|it| {
                it.spread_px.0 > 0.0 && it.spread_px.1 > 0.0 && it.area_px2.is_finite()
            })
            && tempers
                .flat_map(|it| [it.scale, it.bias, it.level])
                .all(f64::is_finite)
            && self.tempers.iter().all(|it| it.len() == SIZES.len())
    }
}

/// What a calibration was learnt from.
fn key(snapshot: &Snapshot, cfg: &LocalizerConfig) -> Result<Key> {
    // What a place is asked for later, and what is made of the answer, is not learnt from.
    let cfg = (cfg.clone())
        .with_selection(Selection::Top(1))
        .with_score(Score::Likelihood)
        .with_elsewhere(0.5)
        .with_risk(0.5)
        .with_min_score(1)
        .with_time_bucket_s(0)
        .with_candidates(Candidates::Exact);
    let cfg = serde_json::to_vec(&cfg).map_err(|cause| {
        Error::new(
            ErrorKind::Config,
            format!("the configuration cannot be written: {cause}"),
        )
    })?;
    let mut sha = Sha256::new();
    let mut put = |bytes: &[u8]| {
        sha.update((bytes.len() as u64).to_le_bytes());
        sha.update(bytes);
    };
    put(env!("CARGO_PKG_VERSION").as_bytes());
    put(&cfg);
    put(format!("{:?}", snapshot.meta).as_bytes());
    for node in &snapshot.nodes {
        put(node.key.as_str().as_bytes());
        put(&(node.features.len() as u64).to_le_bytes());
        for (index, visit) in node.visits.iter().enumerate() {
            put(&visit.id.0.to_le_bytes());
            put(&visit.time.as_us().to_le_bytes());
            for word in node.log.seen_row(index).words() {
                put(&word.to_le_bytes());
            }
            let kept = visit.appearance.as_ref().map_or(0, |it| it.len() + 1);
            put(&[visit.appearance_use as u8]);
            put(&(kept as u64).to_le_bytes());
        }
    }
    for (name, value) in &snapshot.attachments {
        if name != ATTACHMENT {
            put(name.as_bytes());
            put(value);
        }
    }
    Ok(sha.finalize().into())
}

impl Localizer {
    /// What to attach to the map under the name [`ATTACHMENT`], so that a localizer of this configuration
    /// need not calibrate again; `None` without calibration.
    ///
    /// Fails with [`ErrorKind::Format`] if it cannot be written.
    pub fn to_attachment(&self) -> Result<Option<Arc<[u8]>>> {
        let Some(calibration) = self.calibration.as_deref() else {
            return Ok(None);
        };
        let key = key(&self.snapshot, &self.cfg)?;
        let written = Written {
            version: VERSION,
            key,
            calibration,
        };
        let bytes = serde_json::to_vec(&written).map_err(|cause| {
            let message = format!("the calibration cannot be written: {cause}");
            Error::new(ErrorKind::Format, message)
        })?;
        Ok(Some(bytes.into()))
    }
}
