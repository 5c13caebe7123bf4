//! What are the bytes of a visit in quarantine?
//!
//! An attachment for each: a little-endian `u64`, the length of a JSON object; that object; then
//! the visit's keypoints and descriptors, as in table `appearance`. Earlier versions wrote one
//! attachment for all: the object was an array, and the features of all followed.
//!
//! Not for what is kept and what goes: that is `quarantine`.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::codec::{
    decode_descriptors, decode_keypoints, encode_descriptors, encode_keypoints, pair,
};
use super::limits::MAX_TEXT_BYTES;
use super::quarantined::{MaskRuns, QuarantineReason, QuarantinedVisit};
use super::types::{PlaceKey, SessionId, VisitId};
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::Time;

/// What the name of a visit's attachment begins with; its identity follows.
const PREFIX: &str = "held-";

/// What a visit is in JSON.
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Entry {
    /// Numbers the visits in order of arrival.
    #[serde(default)]
    order: u64,
    /// Whether its features were given up.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    given_up: bool,
    place: PlaceKey,
    visit: String,
    session: String,
    time_us: i64,
    source: String,
    image_width: u32,
    image_height: u32,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    mask: Option<MaskRuns>,
    num_features: usize,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    labelled: bool,
    doubt: QuarantineReason,
}

/// A visit as it was read.
#[derive(Debug)]
pub(super) struct Row {
    pub(super) order: u64,
    pub(super) is_whole: bool,
    pub(super) visit: QuarantinedVisit,
}

/// The name of a visit's attachment.
pub(super) fn name_of(id: VisitId) -> String {
    format!("{PREFIX}{id}")
}

/// The visit whose attachment has this name.
pub(super) fn id_of(name: &str) -> Option<VisitId> {
    bits(name.strip_prefix(PREFIX)?).ok().map(VisitId)
}

/// The bytes of one visit.
pub(super) fn encode(visit: &QuarantinedVisit, order: u64, is_whole: bool) -> Result<Vec<u8>> {
    let mut bytes = head(&entry_of(visit, order, is_whole))?;
    put_features(&mut bytes, visit);
    Ok(bytes)
}

/// The visit of these bytes, or what is wrong with them.
pub(super) fn decode(bytes: &[u8]) -> Result<Row, String> {
    let (entry, mut rest) = split::<Entry>(bytes)?;
    let (order, is_whole) = (entry.order, !entry.given_up);
    let visit = visit_of(entry, &mut rest)?;
    match rest {
        [] => Ok(Row {
            order,
            is_whole,
            visit,
        }),
        _ => Err(format!("{} bytes too many", rest.len())),
    }
}

/// The visits of the one attachment of earlier versions, oldest first.
pub(super) fn decode_list(bytes: &[u8]) -> Result<Vec<QuarantinedVisit>, String> {
    let (entries, mut rest) = split::<Vec<Entry>>(bytes)?;
    let mut visits: Vec<QuarantinedVisit> = Vec::with_capacity(entries.len());
    let mut ids = std::collections::BTreeSet::new();
    for entry in entries {
        let visit = visit_of(entry, &mut rest)?;
        if !ids.insert(visit.id) {
            return Err(format!("visit {} is held twice", visit.id));
        }
        visits.push(visit);
    }
    match rest {
        [] => Ok(visits),
        _ => Err(format!("{} bytes too many", rest.len())),
    }
}

/// A number by itself.
pub(super) fn encode_number(number: u64) -> [u8; 8] {
    number.to_le_bytes()
}

/// The number of these bytes.
pub(super) fn decode_number(bytes: &[u8]) -> Result<u64, String> {
    let bytes = bytes.try_into().map_err(|_| "it is no number")?;
    Ok(u64::from_le_bytes(bytes))
}

#[cfg(test)]
pub(super) fn encode_list(visits: &[QuarantinedVisit]) -> Result<Vec<u8>> {
    let entries: Vec<Entry> = (visits.iter()).map(|it| entry_of(it, 0, true)).collect();
    let mut bytes = head(&entries)?;
    for visit in visits {
        put_features(&mut bytes, visit);
    }
    Ok(bytes)
}

fn entry_of(visit: &QuarantinedVisit, order: u64, is_whole: bool) -> Entry {
    Entry {
        order,
        given_up: !is_whole,
        place: visit.place.clone(),
        visit: visit.id.to_string(),
        session: visit.session.to_string(),
        time_us: visit.time.as_us(),
        source: visit.source.clone(),
        image_width: visit.image_size.0,
        image_height: visit.image_size.1,
        mask: visit.mask.as_deref().cloned(),
        num_features: visit.features.len(),
        labelled: visit.is_labelled,
        doubt: visit.reason.clone(),
    }
}

/// The length of some JSON, and the JSON.
fn head(json: &impl Serialize) -> Result<Vec<u8>> {
    let json = serde_json::to_vec(json).map_err(|cause| {
        let message = format!("held visits cannot be written: {cause}");
        Error::new(ErrorKind::Format, message)
    })?;
    let mut bytes = (json.len() as u64).to_le_bytes().to_vec();
    bytes.extend(json);
    Ok(bytes)
}

fn put_features(bytes: &mut Vec<u8>, visit: &QuarantinedVisit) {
    bytes.extend(encode_keypoints(visit.features.keypoints()));
    bytes.extend(encode_descriptors(visit.features.descriptors()));
}

/// The value in JSON that the bytes begin with, and what follows it.
fn split<T: for<'a> Deserialize<'a>>(bytes: &[u8]) -> Result<(T, &[u8]), String> {
    let (length, rest) = bytes.split_first_chunk().ok_or("it is cut off")?;
    let length = usize::try_from(u64::from_le_bytes(*length)).map_err(|_| "it is cut off")?;
    let (json, rest) = rest.split_at_checked(length).ok_or("it is cut off")?;
    let value = serde_json::from_slice(json).map_err(|cause| cause.to_string())?;
    Ok((value, rest))
}

/// The visit of an entry, whose features `rest` begins with; they are taken from it.
fn visit_of(entry: Entry, rest: &mut &[u8]) -> Result<QuarantinedVisit, String> {
    if entry.source.len() > MAX_TEXT_BYTES {
        return Err(format!("a source is longer than {MAX_TEXT_BYTES} bytes"));
    }
    let mut blob = |bytes_each: usize| {
        let len = entry.num_features.checked_mul(bytes_each);
        let parts = len.and_then(|len| rest.split_at_checked(len));
        let (blob, after) = parts.ok_or("its features are cut off")?;
        *rest = after;
        Ok::<_, String>(blob)
    };
    let keypoints = decode_keypoints(blob(16)?).map_err(|it| it.message)?;
    let descriptors = decode_descriptors(blob(32)?).map_err(|it| it.message)?;
    Ok(QuarantinedVisit {
        place: entry.place,
        id: VisitId(bits(&entry.visit)?),
        session: SessionId(bits(&entry.session)?),
        time: Time::from_us(entry.time_us),
        source: entry.source,
        image_size: (entry.image_width, entry.image_height),
        mask: entry.mask.map(Arc::new),
        is_labelled: entry.labelled,
        reason: entry.doubt,
        features: Arc::new(pair(keypoints, descriptors).map_err(|it| it.message)?),
    })
}

/// The 128 bits of an identity.
fn bits(text: &str) -> Result<u128, String> {
    let is_whole = text.len() == 32 && text.bytes().all(|byte| byte.is_ascii_hexdigit());
    (is_whole
        .then(|| u128::from_str_radix(text, 16).ok())
        .flatten())
    .ok_or_else(|| format!("`{}` is no identity", text.escape_debug()))
}
