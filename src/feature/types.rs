//! Images, keypoints, descriptors and features as plain data.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use fremen::error::{Error, ErrorKind, Result};

/// A point that stands out.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Keypoint {
    /// Column of the centre, px.
    pub x: f32,
    /// Row of the centre, px.
    pub y: f32,
    /// Diameter of the neighbourhood, px.
    pub size: f32,
    /// Strength; its unit is the detector's.
    pub response: f32,
}

/// 256 bits that describe a keypoint's neighbourhood; compared by
/// [`distance_bits`](Self::distance_bits).
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
#[repr(transparent)]
pub struct Descriptor(pub [u64; 4]);

impl Descriptor {
    /// From OpenCV's 32 bytes.
    pub fn from_bytes(bytes: [u8; 32]) -> Self {
        let mut words = [0_u64; 4];
        for (word, chunk) in words.iter_mut().zip(bytes.as_chunks::<8>().0) {
            *word = u64::from_le_bytes(*chunk);
        }
        Self(words)
    }

    /// OpenCV's 32 bytes.
    pub fn to_bytes(self) -> [u8; 32] {
        let mut bytes = [0; 32];
        for (chunk, word) in bytes.as_chunks_mut::<8>().0.iter_mut().zip(self.0) {
            *chunk = word.to_le_bytes();
        }
        bytes
    }

    /// The Hamming distance to `other`, in bits: a metric, 0 to 256.
    pub fn distance_bits(&self, other: &Self) -> u32 {
        self.0
            .iter()
            .zip(&other.0)
            .map(|(a, b)| (a ^ b).count_ones())
            .sum()
    }
}

impl std::fmt::Debug for Descriptor {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for byte in self.to_bytes() {
            write!(f, "{byte:02x}")?;
        }
        Ok(())
    }
}

/// Features (keypoint + descriptor) as a struct of arrays of one length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Features {
    keypoints: Vec<Keypoint>,
    descriptors: Vec<Descriptor>,
}

impl Features {
    /// No features.
    pub fn new() -> Self {
        Self::default()
    }

    /// Pairs `keypoints[i]` with `descriptors[i]`; lengths that differ are a
    /// [`ErrorKind::Shape`] error.
    pub fn from_parts(keypoints: Vec<Keypoint>, descriptors: Vec<Descriptor>) -> Result<Self> {
        if keypoints.len() == descriptors.len() {
            Ok(Self {
                keypoints,
                descriptors,
            })
        } else {
            Err(Error::new(
                ErrorKind::Shape,
                format!(
                    "{} keypoints do not pair with {} descriptors",
                    keypoints.len(),
                    descriptors.len()
                ),
            ))
        }
    }

    /// How many.
    pub fn len(&self) -> usize {
        self.keypoints.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.keypoints.is_empty()
    }

    /// All keypoints, in order of id.
    pub fn keypoints(&self) -> &[Keypoint] {
        &self.keypoints
    }

    /// All descriptors, in order of id.
    pub fn descriptors(&self) -> &[Descriptor] {
        &self.descriptors
    }

    /// Appends one feature.
    pub fn push(&mut self, keypoint: Keypoint, descriptor: Descriptor) {
        self.keypoints.push(keypoint);
        self.descriptors.push(descriptor);
    }

    /// Both arrays, to be filled by an extractor, which gives them one length.
    pub(super) fn parts_mut(&mut self) -> (&mut Vec<Keypoint>, &mut Vec<Descriptor>) {
        (&mut self.keypoints, &mut self.descriptors)
    }

    /// Keeps the first `len` features.
    pub fn truncate(&mut self, len: usize) {
        self.keypoints.truncate(len);
        self.descriptors.truncate(len);
    }

    /// The features with the given ids, in that order.
    ///
    /// # Panics
    /// If an id is not below [`len`](Self::len).
    #[must_use]
    pub fn select(&self, ids: &[u32]) -> Self {
        let mut selected = Self::new();
        selected.gather(self, ids);
        selected
    }

    /// Replaces the content by the features of `other` with the given ids, in that order.
    ///
    /// # Panics
    /// If an id is not below `other.len()`.
    pub fn gather(&mut self, other: &Self, ids: &[u32]) {
        self.truncate(0);
        self.append(other, ids);
    }

    /// Appends the features of `other` with the given ids, in that order.
    ///
    /// # Panics
    /// If an id is not below `other.len()`.
    pub fn append(&mut self, other: &Self, ids: &[u32]) {
        self.keypoints
            .extend(ids.iter().map(|&id| other.keypoints[id as usize]));
        self.descriptors
            .extend(ids.iter().map(|&id| other.descriptors[id as usize]));
    }

    /// Appends all features of `other`.
    pub fn append_view(&mut self, other: FeaturesView<'_>) {
        self.keypoints.extend_from_slice(other.keypoints);
        self.descriptors.extend_from_slice(other.descriptors);
    }

    /// All of them, borrowed.
    pub fn view(&self) -> FeaturesView<'_> {
        FeaturesView {
            keypoints: &self.keypoints,
            descriptors: &self.descriptors,
        }
    }
}

/// Borrowed [`Features`]: two slices of one length.
#[derive(Clone, Copy, Debug)]
pub struct FeaturesView<'a> {
    /// Where.
    pub keypoints: &'a [Keypoint],
    /// What it looks like.
    pub descriptors: &'a [Descriptor],
}

impl<'a> FeaturesView<'a> {
    /// No features.
    pub const EMPTY: Self = Self {
        keypoints: &[],
        descriptors: &[],
    };

    /// The first `len`; all, if there are fewer.
    #[must_use]
    pub fn prefix(self, len: usize) -> FeaturesView<'a> {
        self.rows(0..len.min(self.len()))
    }

    /// Some that follow each other.
    ///
    /// # Panics
    /// If there are no such rows.
    #[must_use]
    pub fn rows(self, rows: Range<usize>) -> FeaturesView<'a> {
        FeaturesView {
            keypoints: &self.keypoints[rows.clone()],
            descriptors: &self.descriptors[rows],
        }
    }

    /// How many.
    pub fn len(&self) -> usize {
        self.keypoints.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.keypoints.is_empty()
    }
}
