//! Is what this map's past visits say already known?
//!
//! Calibrating matches past visits, which takes from a tenth of a second to a few seconds. The
//! result can be kept with the map, as the attachment [`ATTACHMENT`]: JSON of the calibration and
//! of a key, a SHA-256 over everything that it was learnt from: the configuration, the identities
//! of all visits (which contain the digests of their images' features), what each saw, the other
//! attachments, and this crate's version. A localizer whose key differs, or whose copy does not
//! hold together, calibrates anew; a stored one is never trusted for its name.
//!
//! The key does not contain itself, so attaching a calibration keeps it valid, while one more visit
//! makes it stale. Cost: one bit a feature and visit to make the key, O(bytes) to read.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::rates::Calibration;
use crate::localize::config::{LocalizerConfig, PlaceSearch, Score};
use crate::map::Snapshot;
use crate::predict::Selection;
use fremen::error::{Error, ErrorKind, Result};

/// The name of the attachment.
pub const ATTACHMENT: &str = "calibration";

/// Grows when what is stored changes its meaning.
pub(in crate::localize) const VERSION: u32 = 5;

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

/// The calibration that is attached to `snapshot`, if it was learnt from just this map by just this
/// configuration.
pub(in crate::localize) fn attached(
    snapshot: &Snapshot,
    cfg: &LocalizerConfig,
) -> Option<Calibration> {
    let bytes = snapshot.attachments().get(ATTACHMENT)?;
    let read: Read = serde_json::from_slice(bytes).ok()?;
    let is_ours = read.version == VERSION
        && key(snapshot, cfg).is_ok_and(|key| key == read.key)
        && read.calibration.holds_together(snapshot);
    is_ours.then_some(read.calibration)
}

/// What a calibration was learnt from.
fn key(snapshot: &Snapshot, cfg: &LocalizerConfig) -> Result<Key> {
    // What is predicted of a place later, and what is made of the answer, is not learnt from.
    let cfg = (cfg.clone())
        .with_selection(Selection::at_least_one(1))
        .with_score(Score::Likelihood)
        .with_off_map(0.5)
        .with_risk(0.5)
        .with_min_score(1)
        .with_time_bucket_s(0)
        .with_place_search(PlaceSearch::Exact);
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
    put(format!("{:?}", snapshot.meta()).as_bytes());
    for node in snapshot.nodes() {
        put(node.key().as_str().as_bytes());
        put(&(node.features().len() as u64).to_le_bytes());
        for (index, visit) in node.visits().iter().enumerate() {
            put(&visit.id.0.to_le_bytes());
            put(&visit.time.as_us().to_le_bytes());
            for word in node.log().seen_row(index).words() {
                put(&word.to_le_bytes());
            }
            let kept = visit.appearance.as_ref().map_or(0, |it| it.len() + 1);
            put(&[visit.appearance_use as u8]);
            put(&(kept as u64).to_le_bytes());
        }
    }
    for (name, value) in snapshot.attachments() {
        if name != ATTACHMENT {
            put(name.as_bytes());
            put(value);
        }
    }
    Ok(sha.finalize().into())
}

/// The attachment that keeps `calibration`, which was learnt from `snapshot` by `cfg`.
///
/// Fails with [`ErrorKind::Format`] if it cannot be written.
pub(in crate::localize) fn to_attachment(
    calibration: &Calibration,
    snapshot: &Snapshot,
    cfg: &LocalizerConfig,
) -> Result<Arc<[u8]>> {
    let written = Written {
        version: VERSION,
        key: key(snapshot, cfg)?,
        calibration,
    };
    let bytes = serde_json::to_vec(&written).map_err(|cause| {
        let message = format!("the calibration cannot be written: {cause}");
        Error::new(ErrorKind::Format, message)
    })?;
    Ok(bytes.into())
}
