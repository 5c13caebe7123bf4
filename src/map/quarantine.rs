//! Which visits wait until somebody says whether they are what they seem?
//!
//! A visit that does not look like its place, or whose time cannot be right, is not learnt: it is
//! kept in quarantine with the reason, and can be learnt or dropped later. Whether to believe a
//! visit is decided by `learn`; quarantined visits are part of a snapshot as the attachment `held`,
//! so that they are committed, rolled back and checked as everything else is.
//!
//! Bytes of the attachment: a little-endian `u64`, the length of a JSON array with an object for
//! each visit, oldest first; then for each visit its keypoints and its descriptors, as in table
//! `appearance`. A mask is kept as the lengths of its runs ([`MaskRuns`]). At most [`MAX_VISITS`]
//! visits and [`MAX_BYTES`]: beyond that the oldest go.

use std::collections::BTreeSet;
use std::fmt;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::codec::{
    decode_descriptors, decode_keypoints, encode_descriptors, encode_keypoints, pair,
};
use super::limits::{MAX_ATTACHMENT_BYTES, MAX_TEXT_BYTES};
use super::snapshot::Snapshot;
use super::types::{PlaceKey, SessionId, VisitId};
use crate::feature::{Features, GrayImage};
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::Time;

/// The attachment's name.
const NAME: &str = "held";
/// Visits, at most.
const MAX_VISITS: usize = 512;
/// Bytes of all their features and texts, at most.
const MAX_BYTES: usize = MAX_ATTACHMENT_BYTES / 2;

/// Pixels of a mask, at most: as of an image that is decoded.
const MAX_MASK_PIXELS: u64 = 64_000_000;

/// Why a visit was not learnt.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum QuarantineReason {
    /// Too few of the features that were predicted for that time were seen.
    #[serde(rename_all = "kebab-case")]
    Disagreement {
        /// The share of the predicted features that were seen.
        agreement: f64,
        /// The least share that would have been believed.
        threshold: f64,
        /// The median share at the place's past visits.
        expected: f64,
        /// How many features were predicted and could have been seen.
        num_predicted: usize,
        /// Another place of the map that it looks like.
        looks_like: Option<PlaceKey>,
    },
    /// Next to nothing is to be seen: the camera is covered, blinded, or it is dark.
    #[serde(rename_all = "kebab-case")]
    Blind {
        /// Features of the image.
        num_features: usize,
        /// The grey levels that all but the darkest and the brightest hundredth of its pixels lie
        /// between, where known.
        gray_range: Option<(u8, u8)>,
    },
    /// Its time cannot be right.
    #[serde(rename_all = "kebab-case")]
    Clock {
        /// What is wrong with it.
        fault: ClockFault,
        /// By how many seconds it is off: from the machine's clock (positive: ahead of it), or from
        /// the image before.
        off_s: f64,
    },
}

/// What may be wrong with a clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ClockFault {
    /// It was never set: the time is near 1970.
    Unset,
    /// The time has not come yet.
    Future,
    /// It went back within a session.
    Backwards,
    /// It differs from the machine's clock by a whole number of quarters of an hour, as the clock
    /// of another zone does.
    Zone,
}

/// The darkest image whose brightest parts are still black.
const BLACK: u8 = 40;
/// The brightest image whose darkest parts are already white.
const WHITE: u8 = 215;

impl fmt::Display for QuarantineReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Disagreement {
                agreement,
                threshold,
                expected,
                num_predicted,
                looks_like,
            } => {
                write!(
                    f,
                    "{:.1} % of {num_predicted} predicted features were seen, where at least \
                     {:.1} % were expected and {:.1} % are usual",
                    100.0 * agreement,
                    100.0 * threshold,
                    100.0 * expected
                )?;
                match looks_like {
                    Some(place) => write!(f, "; it looks like place `{place}`"),
                    None => Ok(()),
                }
            }
            Self::Blind {
                num_features,
                gray_range,
            } => {
                let what = match gray_range {
                    Some((_, high)) if *high <= BLACK => "the image is black: a covered camera?",
                    Some((low, _)) if *low >= WHITE => "the image is white: a blinded camera?",
                    Some(_) => "the image is flat: a covered camera?",
                    None => "the image is empty: a covered camera?",
                };
                write!(f, "{what} ({num_features} features")?;
                match gray_range {
                    Some((low, high)) => write!(f, ", grey levels {low} to {high})"),
                    None => write!(f, ")"),
                }
            }
            Self::Clock { fault, off_s } => match fault {
                ClockFault::Unset => write!(f, "the clock was never set"),
                ClockFault::Future => write!(f, "the time lies {off_s:.0} s in the future"),
                ClockFault::Backwards => {
                    write!(f, "the clock went back by {:.0} s", off_s.abs())
                }
                ClockFault::Zone => write!(
                    f,
                    "the time is {:+.2} h off the machine's clock, as that of another zone is",
                    off_s / 3_600.0
                ),
            },
        }
    }
}

/// Which pixels of an image could be observed: the lengths of runs, row by row and across the ends
/// of rows; the first run (it may be empty) is hidden, and from then on they alternate.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct MaskRuns(Vec<u32>);

impl MaskRuns {
    /// The runs of a mask that is zero where nothing could be observed.
    pub fn of(mask: &GrayImage) -> Self {
        let mut runs = vec![0_u32];
        let mut is_hidden = true;
        for &pixel in mask.data() {
            if (pixel == 0) != is_hidden {
                is_hidden = !is_hidden;
                runs.push(0);
            }
            if let Some(run) = runs.last_mut() {
                *run = run.saturating_add(1);
            }
        }
        Self(runs)
    }

    /// The mask of an image of this size.
    ///
    /// Fails with [`ErrorKind::Format`] if the runs do not cover it.
    pub fn to_mask(&self, (width, height): (u32, u32)) -> Result<GrayImage> {
        let num_pixels = u64::from(width) * u64::from(height);
        let covered: u64 = self.0.iter().map(|&run| u64::from(run)).sum();
        if covered != num_pixels || num_pixels > MAX_MASK_PIXELS {
            return Err(Error::new(
                ErrorKind::Format,
                format!("runs of {covered} px are no mask of {width} x {height} px"),
            ));
        }
        let mut pixels = Vec::with_capacity(num_pixels as usize);
        for (at, &run) in self.0.iter().enumerate() {
            let value = if at.is_multiple_of(2) { 0 } else { 255 };
            pixels.resize(pixels.len() + run as usize, value);
        }
        GrayImage::new(width as usize, height as usize, pixels)
    }
}

/// A visit that waits in quarantine, with all that is needed to learn it.
#[derive(Clone, Debug, PartialEq)]
pub struct QuarantinedVisit {
    /// Where it is said to have been.
    pub place: PlaceKey,
    /// Its identity.
    pub id: VisitId,
    /// The run it belongs to.
    pub session: SessionId,
    /// When the image is said to have been taken.
    pub time: Time,
    /// Where the image came from, for people.
    pub source: String,
    /// Width and height of the image, px.
    pub image_size: (u32, u32),
    /// What of it could be observed, if not all.
    pub mask: Option<Arc<MaskRuns>>,
    /// Why it is quarantined.
    pub reason: QuarantineReason,
    /// Its features, strongest first.
    pub features: Arc<Features>,
}

/// What a visit is in the JSON array.
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Entry {
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
    doubt: QuarantineReason,
}

/// The visits that a map keeps without having learnt them, in order of arrival.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Quarantine {
    visits: Vec<QuarantinedVisit>,
}

impl Quarantine {
    /// The quarantined visits of `snapshot`.
    ///
    /// Fails with [`ErrorKind::Format`] if the attachment is not as it is written.
    pub fn of(snapshot: &Snapshot) -> Result<Self> {
        match snapshot.attachments.get(NAME) {
            Some(bytes) => Self::decode(bytes).map_err(|message| {
                Error::new(
                    ErrorKind::Format,
                    format!("the attachment `{NAME}` cannot be read: {message}"),
                )
                .with_help("return to an earlier generation with `chronotope map rollback`")
            }),
            None => Ok(Self::default()),
        }
    }

    /// Makes them part of `snapshot`.
    pub fn attach(&self, snapshot: &mut Snapshot) -> Result<()> {
        if self.visits.is_empty() {
            snapshot.attachments.remove(NAME);
            return Ok(());
        }
        let bytes = Arc::from(self.encode()?);
        snapshot.attachments.insert(NAME.into(), bytes);
        Ok(())
    }

    /// The visits, oldest first.
    pub fn visits(&self) -> &[QuarantinedVisit] {
        &self.visits
    }

    /// Adds a visit; one that is there already changes nothing. Gives how many of the oldest had to
    /// go for it.
    pub fn push(&mut self, visit: QuarantinedVisit) -> usize {
        if self.visits.iter().any(|it| it.id == visit.id) {
            return 0;
        }
        self.visits.push(visit);
        self.bound()
    }

    /// Takes a visit out.
    pub fn take(&mut self, id: VisitId) -> Option<QuarantinedVisit> {
        let at = self.visits.iter().position(|it| it.id == id)?;
        Some(self.visits.remove(at))
    }

    /// Takes out the visits of one session, and gives how many there were.
    pub fn forget(&mut self, session: SessionId) -> usize {
        let before = self.visits.len();
        self.visits.retain(|it| it.session != session);
        before - self.visits.len()
    }

    /// Adds the visits of `other`, in order of time and identity: the union, whatever the order. Of
    /// two accounts of one visit the larger holds.
    pub fn merge(&mut self, other: &Self) {
        self.visits.extend_from_slice(&other.visits);
        self.visits.sort_by_cached_key(|it| {
            let account = format!("{it:?}");
            (
                it.time,
                it.id,
                std::cmp::Reverse((it.features.len(), account)),
            )
        });
        self.visits.dedup_by_key(|it| it.id);
        self.bound();
    }

    /// Drops the oldest where there are too many; gives how many.
    fn bound(&mut self) -> usize {
        let mut num_bytes: usize = self.visits.iter().map(QuarantinedVisit::num_bytes).sum();
        let mut num_dropped = 0;
        while num_dropped < self.visits.len()
            && (self.visits.len() - num_dropped > MAX_VISITS || num_bytes > MAX_BYTES)
        {
            num_bytes -= self.visits[num_dropped].num_bytes();
            num_dropped += 1;
        }
        self.visits.drain(..num_dropped);
        num_dropped
    }

    fn encode(&self) -> Result<Vec<u8>> {
        let entries: Vec<Entry> = (self.visits.iter())
            .map(|it| Entry {
                place: it.place.clone(),
                visit: it.id.to_string(),
                session: it.session.to_string(),
                time_us: it.time.as_us(),
                source: it.source.clone(),
                image_width: it.image_size.0,
                image_height: it.image_size.1,
                mask: it.mask.as_deref().cloned(),
                num_features: it.features.len(),
                doubt: it.reason.clone(),
            })
            .collect();
        let json = serde_json::to_vec(&entries).map_err(|cause| {
            Error::new(
                ErrorKind::Format,
                format!("held visits cannot be written: {cause}"),
            )
        })?;
        let mut bytes = (json.len() as u64).to_le_bytes().to_vec();
        bytes.extend(json);
        for it in &self.visits {
            bytes.extend(encode_keypoints(it.features.keypoints()));
            bytes.extend(encode_descriptors(it.features.descriptors()));
        }
        Ok(bytes)
    }

    fn decode(bytes: &[u8]) -> Result<Self, String> {
        let (length, rest) = bytes.split_first_chunk().ok_or("it is cut off")?;
        let length = usize::try_from(u64::from_le_bytes(*length)).map_err(|_| "it is cut off")?;
        let (json, mut rest) = rest.split_at_checked(length).ok_or("it is cut off")?;
        let entries: Vec<Entry> =
            serde_json::from_slice(json).map_err(|cause| cause.to_string())?;
        let bits = |text: &str| {
            let is_whole = text.len() == 32;
            (is_whole
                .then(|| u128::from_str_radix(text, 16).ok())
                .flatten())
            .ok_or_else(|| format!("`{}` is no identity", text.escape_debug()))
        };
        let mut visits: Vec<QuarantinedVisit> = Vec::with_capacity(entries.len());
        let mut ids = BTreeSet::new();
        for entry in entries {
            if entry.source.len() > MAX_TEXT_BYTES {
                return Err(format!("a source is longer than {MAX_TEXT_BYTES} bytes"));
            }
            let id = VisitId(bits(&entry.visit)?);
            if !ids.insert(id) {
                return Err(format!("visit {id} is held twice"));
            }
            let mut blob = |bytes_each: usize| {
                let len = entry.num_features.checked_mul(bytes_each);
                let parts = len.and_then(|len| rest.split_at_checked(len));
                let (blob, after) = parts.ok_or("its features are cut off")?;
                rest = after;
                Ok::<_, String>(blob)
            };
            let keypoints = decode_keypoints(blob(16)?).map_err(|it| it.message)?;
            let descriptors = decode_descriptors(blob(32)?).map_err(|it| it.message)?;
            visits.push(QuarantinedVisit {
                place: entry.place,
                id,
                session: SessionId(bits(&entry.session)?),
                time: Time::from_us(entry.time_us),
                source: entry.source,
                image_size: (entry.image_width, entry.image_height),
                mask: entry.mask.map(Arc::new),
                reason: entry.doubt,
                features: Arc::new(pair(keypoints, descriptors).map_err(|it| it.message)?),
            });
        }
        if rest.is_empty() {
            Ok(Self { visits })
        } else {
            Err(format!("{} bytes too many", rest.len()))
        }
    }
}

impl QuarantinedVisit {
    /// About how much room it takes.
    fn num_bytes(&self) -> usize {
        let num_runs = self.mask.as_ref().map_or(0, |mask| mask.0.len());
        1_000
            + 11 * num_runs
            + 6 * (self.source.len() + self.place.as_str().len())
            + 48 * self.features.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feature::{Descriptor, Keypoint};

    fn visit(number: u128, num_features: usize) -> QuarantinedVisit {
        let mut features = Features::new();
        for i in 0..num_features {
            let keypoint = Keypoint {
                x: i as f32,
                y: 0.1,
                size: 9.0,
                response: -1.5,
            };
            features.push(keypoint, Descriptor([number as u64, i as u64, 3, 4]));
        }
        QuarantinedVisit {
            place: PlaceKey::new("door").expect("valid"),
            id: VisitId(number),
            session: SessionId(number % 2),
            time: Time::from_s(number as i64),
            source: "a \"quoted\" name".into(),
            image_size: (640, 480),
            mask: number
                .is_multiple_of(2)
                .then(|| Arc::new(MaskRuns(vec![0, 640 * 479, 640]))),
            reason: QuarantineReason::Disagreement {
                agreement: 0.1,
                threshold: 1.0 / 3.0,
                expected: 0.7,
                num_predicted: 50,
                looks_like: PlaceKey::new("gate").ok(),
            },
            features: Arc::new(features),
        }
    }

    #[test]
    fn held_visits_survive_the_attachment_and_damage_is_named() {
        let mut quarantine = Quarantine::default();
        for number in 0..5 {
            assert_eq!(quarantine.push(visit(number, number as usize)), 0);
        }
        assert_eq!(quarantine.push(visit(3, 9)), 0);
        let bytes = quarantine.encode().expect("serialises");
        assert_eq!(Quarantine::decode(&bytes), Ok(quarantine.clone()));
        for len in 0..bytes.len() {
            assert!(Quarantine::decode(&bytes[..len]).is_err(), "{len} bytes");
        }
        assert!(Quarantine::decode(&[&bytes[..], &[0]].concat()).is_err());
        assert_eq!(quarantine.forget(SessionId(1)), 2);
        assert!(quarantine.take(VisitId(2)).is_some() && quarantine.take(VisitId(2)).is_none());
        assert_eq!(quarantine.visits().len(), 2);
    }

    #[test]
    fn a_mask_is_what_its_runs_say() {
        for pixels in [[0, 0, 7, 0, 255, 255], [1, 1, 1, 1, 1, 1], [0; 6]] {
            let mask = GrayImage::new(3, 2, pixels.to_vec()).expect("as many pixels");
            let again = MaskRuns::of(&mask).to_mask((3, 2)).expect("covered");
            let is_hidden: Vec<bool> = again.data().iter().map(|&pixel| pixel == 0).collect();
            assert_eq!(is_hidden, pixels.map(|pixel| pixel == 0));
        }
        for (runs, size) in [(vec![7], (3, 2)), (vec![u32::MAX, u32::MAX], (u32::MAX, 2))] {
            assert!(MaskRuns(runs.clone()).to_mask(size).is_err(), "{runs:?}");
        }
    }

    #[test]
    fn the_oldest_go_where_there_are_too_many() {
        let mut quarantine = Quarantine::default();
        let num_dropped: usize = (0..600)
            .map(|number| quarantine.push(visit(number, 1)))
            .sum();
        assert_eq!(
            (num_dropped, quarantine.visits().len()),
            (600 - MAX_VISITS, MAX_VISITS)
        );
        assert_eq!(quarantine.visits()[0].id, VisitId(600 - MAX_VISITS as u128));
        // A single one that is too large is not kept at all.
        assert_eq!(Quarantine::default().push(visit(1, MAX_BYTES / 48)), 1);
        assert!(quarantine.encode().expect("serialises").len() < MAX_ATTACHMENT_BYTES);
    }
}
