//! What makes two maps, runs or visits the same?
//!
//! Identities are 128 bits, so that maps of several robots can be merged without any agreement
//! between them. Derived ones are the first 128 bits of a SHA-256 over a label and length-prefixed
//! parts: the same input gives the same identity on every machine. Not for secrets.

use std::hash::{BuildHasher, RandomState};

use chronotope_store::{ValueRef, put_value};
use sha2::{Digest, Sha256};

use super::codec::{encode_descriptors, encode_keypoints};
use super::types::{PlaceKey, SessionId, VisitId};
use crate::feature::Features;
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::Time;

/// The SHA-256 of `features`: their keypoints (four little-endian 32-bit floats each), then their
/// descriptors (32 bytes each), each with its length before it.
pub fn features_digest(features: &Features) -> [u8; 32] {
    hash(
        "chronotope features 1",
        &[
            ValueRef::Blob(&encode_keypoints(features.keypoints())),
            ValueRef::Blob(&encode_descriptors(features.descriptors())),
        ],
    )
}

impl VisitId {
    /// The one of the visits that are held, `ids`, that is written with `text` at its beginning.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::NotFound`] if there is none, [`ErrorKind::Config`] if there are several.
    pub fn find(ids: &[Self], text: &str) -> Result<Self> {
        let text = text.to_lowercase();
        let mut found = (ids.iter()).filter(|id| id.to_string().starts_with(&text));
        match (found.next(), found.next()) {
            (Some(id), None) => Ok(*id),
            (Some(_), Some(_)) => Err(Error::new(
                ErrorKind::Config,
                format!("several visits begin with `{text}`"),
            )),
            (None, _) => Err(Error::new(
                ErrorKind::NotFound,
                format!("no visit that is held begins with `{text}`"),
            )),
        }
    }

    /// The identity of the visit of `key` at `time` that saw features of this digest
    /// ([`features_digest`]). An image is the same whichever run brings it, so `session` is the
    /// default one, but for visits that were learnt before this rule.
    pub fn derive(
        session: SessionId,
        key: &PlaceKey,
        time: Time,
        features_digest: &[u8; 32],
    ) -> Self {
        Self(first_128(&hash(
            "chronotope visit 1",
            &[
                ValueRef::Blob(&session.0.to_be_bytes()),
                ValueRef::Text(key.as_str().as_bytes()),
                ValueRef::Integer(time.as_us()),
                ValueRef::Blob(features_digest),
            ],
        )))
    }
}

impl SessionId {
    /// The session that everybody calls `name`: for runs of a dataset.
    pub fn derive(name: &str) -> Self {
        Self(first_128(&hash(
            "chronotope session 1",
            &[ValueRef::Text(name.as_bytes())],
        )))
    }

    /// A session like no other: for runs of a robot.
    pub fn random() -> Self {
        Self(random_uuid())
    }
}

/// A random UUID (version 4), from the keys that the standard library draws from the operating
/// system.
pub fn random_uuid() -> u128 {
    let half = |salt: u8| u128::from(RandomState::new().hash_one(salt));
    as_uuid(half(0) << 64 | half(1), 4)
}

/// The UUID (version 8) that everybody derives from `seed`.
pub fn derived_uuid(seed: &str) -> u128 {
    let digest = hash("chronotope map 1", &[ValueRef::Text(seed.as_bytes())]);
    as_uuid(first_128(&digest), 8)
}

/// Sets the version and the variant of RFC 9562.
fn as_uuid(bits: u128, version: u128) -> u128 {
    bits & !(0xf << 76) & !(0b11 << 62) | version << 76 | 0b10 << 62
}

fn hash(label: &str, parts: &[ValueRef<'_>]) -> [u8; 32] {
    let mut sha = Sha256::new();
    put_value(&mut sha, ValueRef::Text(label.as_bytes()));
    for &part in parts {
        put_value(&mut sha, part);
    }
    sha.finalize().into()
}

fn first_128(digest: &[u8; 32]) -> u128 {
    digest[..16]
        .iter()
        .fold(0, |bits, &byte| bits << 8 | u128::from(byte))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feature::{Descriptor, Keypoint};

    #[test]
    fn every_part_of_a_visit_is_part_of_its_identity() {
        let key = |text| PlaceKey::new(text).expect("valid");
        let session = SessionId::derive("monday");
        let base = VisitId::derive(session, &key("a"), Time::from_s(5), &[7; 32]);
        assert_eq!(
            base,
            VisitId::derive(session, &key("a"), Time::from_s(5), &[7; 32])
        );
        let tuesday = SessionId::derive("tuesday");
        for other in [
            VisitId::derive(tuesday, &key("a"), Time::from_s(5), &[7; 32]),
            VisitId::derive(session, &key("b"), Time::from_s(5), &[7; 32]),
            VisitId::derive(session, &key("a"), Time::from_us(5_000_001), &[7; 32]),
            VisitId::derive(session, &key("a"), Time::from_s(5), &[8; 32]),
        ] {
            assert_ne!(base, other);
        }
    }

    #[test]
    fn identities_stay_what_they_are() {
        // Stored maps hold these: a change here needs a new format version.
        let mut features = Features::new();
        let keypoint = Keypoint {
            x: 1.0,
            y: 2.0,
            size: 3.0,
            response: 4.0,
        };
        features.push(keypoint, Descriptor([1, 2, 3, 4]));
        let session = SessionId::derive("monday");
        let key = PlaceKey::new("door").expect("valid");
        let id = VisitId::derive(session, &key, Time::from_s(1), &features_digest(&features));
        assert_eq!(
            format!("{session} {id} {:032x}", derived_uuid("golden")),
            "a8288f34900a84daf29e082e068f2780 d2b6946d8aa14d8fa5f38e82ef31009f \
             4b3236542cc28731962782dd4dcef005"
        );
    }

    #[test]
    fn random_uuids_differ_and_say_their_version() {
        let uuids: Vec<u128> = (0..8).map(|_| random_uuid()).collect();
        for (i, uuid) in uuids.iter().enumerate() {
            assert_eq!(uuid >> 76 & 0xf, 4);
            assert_eq!(uuid >> 62 & 0b11, 0b10);
            assert!(!uuids[..i].contains(uuid));
        }
        assert_eq!(derived_uuid("x") >> 76 & 0xf, 8);
    }
}
