//! Do two maps remember the same?
//!
//! [`Snapshot::digest`] is a SHA-256 over the content of a map in canonical bytes, whatever commits
//! it came by: each place has a chain, one link per visit, so that a store extends the digest by
//! hashing only what is new; the map's digest is taken over its head, the chains, the edges and the
//! attachments.

use std::collections::BTreeMap;

use chronotope_store::{ValueRef, put_value};
use sha2::{Digest, Sha256};

use super::codec::{encode_bits, encode_descriptors, encode_keypoints};
use super::node::Node;
use super::snapshot::Snapshot;
use super::types::MapMeta;
use crate::feature::FeaturesView;

/// A SHA-256.
pub type ContentDigest = [u8; 32];

/// The chain of a place without visits.
pub(super) fn first_link(node: &Node) -> ContentDigest {
    let mut sha = labelled("chronotope place 1");
    put_value(&mut sha, ValueRef::Text(node.key().as_str().as_bytes()));
    sha.finalize().into()
}

/// The chain after one more visit.
pub(super) fn next_link(before: &ContentDigest, node: &Node, visit: usize) -> ContentDigest {
    let mut sha = labelled("chronotope link 1");
    put_value(&mut sha, ValueRef::Blob(before));
    let it = &node.visits()[visit];
    put_value(&mut sha, ValueRef::Blob(&it.id.0.to_be_bytes()));
    put_value(&mut sha, ValueRef::Blob(&it.session.0.to_be_bytes()));
    put_value(&mut sha, ValueRef::Integer(it.time.as_us()));
    put_value(&mut sha, ValueRef::Text(it.source.as_bytes()));
    put_value(
        &mut sha,
        ValueRef::Text(it.appearance_use.name().as_bytes()),
    );
    let seen = node.log().seen_row(visit);
    put_value(&mut sha, ValueRef::Integer(seen.len() as i64));
    put_value(&mut sha, ValueRef::Blob(&encode_bits(seen)));
    match node.log().hidden_row(visit) {
        Some(hidden) => put_value(&mut sha, ValueRef::Blob(&encode_bits(hidden))),
        None => put_value(&mut sha, ValueRef::Null),
    }
    let located_by = node.experience_log().seen_row(visit);
    put_value(&mut sha, ValueRef::Blob(&encode_bits(located_by)));
    let born = node.born_at(visit);
    put_features(
        &mut sha,
        Some(FeaturesView {
            keypoints: &node.features().keypoints()[born.clone()],
            descriptors: &node.features().descriptors()[born],
        }),
    );
    put_features(&mut sha, it.appearance.as_deref().map(|it| it.view()));
    sha.finalize().into()
}

/// The chain of a place with all its visits.
pub(super) fn chain(node: &Node) -> ContentDigest {
    (0..node.visits().len()).fold(first_link(node), |before, visit| {
        next_link(&before, node, visit)
    })
}

/// The SHA-256 of an attachment.
pub(super) fn of_attachment(value: &[u8]) -> ContentDigest {
    Sha256::digest(value).into()
}

/// The digest of a map whose places have these chains and whose attachments these digests.
pub(super) fn of_chains(
    snapshot: &Snapshot,
    chains: &[ContentDigest],
    attachments: &BTreeMap<String, ContentDigest>,
) -> ContentDigest {
    let mut sha = labelled("chronotope map 1");
    for value in meta_values(&snapshot.meta, &snapshot.meta.uuid.to_be_bytes()) {
        put_value(&mut sha, value);
    }
    put_value(&mut sha, ValueRef::Integer(chains.len() as i64));
    for (node, chain) in snapshot.nodes.iter().zip(chains) {
        put_value(&mut sha, ValueRef::Blob(chain));
        for value in pose_values(node.pose()) {
            put_value(&mut sha, value);
        }
    }
    put_value(&mut sha, ValueRef::Integer(snapshot.edges.len() as i64));
    for edge in &snapshot.edges {
        for text in [edge.from.as_str(), edge.to.as_str(), &edge.name] {
            put_value(&mut sha, ValueRef::Text(text.as_bytes()));
        }
    }
    // A map without attachments has the digest that it had in format 1.
    if !attachments.is_empty() {
        put_value(&mut sha, ValueRef::Integer(attachments.len() as i64));
    }
    for (name, digest) in attachments {
        put_value(&mut sha, ValueRef::Text(name.as_bytes()));
        put_value(&mut sha, ValueRef::Blob(digest));
    }
    sha.finalize().into()
}

/// The columns of table `meta` from `uuid` on.
pub(super) fn meta_values<'a>(meta: &'a MapMeta, uuid: &'a [u8; 16]) -> [ValueRef<'a>; 10] {
    let number = |number: Option<u32>| match number {
        Some(number) => ValueRef::Integer(number.into()),
        None => ValueRef::Null,
    };
    [
        ValueRef::Blob(uuid),
        ValueRef::Text(meta.extractor.as_bytes()),
        number(meta.image_size.map(|size| size.0)),
        number(meta.image_size.map(|size| size.1)),
        number(meta.crop.map(|crop| crop.x)),
        number(meta.crop.map(|crop| crop.y)),
        number(meta.crop.map(|crop| crop.width)),
        number(meta.crop.map(|crop| crop.height)),
        ValueRef::Text(meta.preset.as_bytes()),
        match &meta.zone {
            Some(zone) => ValueRef::Text(zone.as_bytes()),
            None => ValueRef::Null,
        },
    ]
}

/// The columns `x`, `y`, `z` of table `pose`. `SQLite` keeps whole reals as
/// integers, which know no -0: it becomes 0, its equal.
pub(super) fn pose_values(pose: Option<[f64; 3]>) -> [ValueRef<'static>; 3] {
    pose.map_or([ValueRef::Null; 3], |pose| {
        pose.map(|x| ValueRef::Real(x + 0.0))
    })
}

fn put_features(sha: &mut Sha256, features: Option<FeaturesView<'_>>) {
    match features {
        Some(features) => {
            put_value(sha, ValueRef::Blob(&encode_keypoints(features.keypoints)));
            put_value(
                sha,
                ValueRef::Blob(&encode_descriptors(features.descriptors)),
            );
        }
        None => put_value(sha, ValueRef::Null),
    }
}

fn labelled(label: &str) -> Sha256 {
    let mut sha = Sha256::new();
    put_value(&mut sha, ValueRef::Text(label.as_bytes()));
    sha
}

impl Snapshot {
    /// A SHA-256 of everything it holds, except by which commits
    /// ([`generation`](Self::generation)) it came about. O(bytes).
    pub fn digest(&self) -> ContentDigest {
        let chains: Vec<ContentDigest> = self.nodes.iter().map(|node| chain(node)).collect();
        let attachments = (self.attachments.iter())
            .filter(|(_, value)| !value.is_empty())
            .map(|(name, value)| (name.clone(), of_attachment(value)))
            .collect();
        of_chains(self, &chains, &attachments)
    }
}
