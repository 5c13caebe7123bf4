//! How are the arrays of an exported folder written, and read part by part?

use std::path::{Path, PathBuf};

use super::folder::{Folder, NewFolder};
use super::layout::format_error;
use super::npy;
use crate::feature::Features;
use crate::map::codec;
use crate::map::limits::{DESCRIPTOR_BYTES, KEYPOINT_BYTES, MAX_FEATURES};
use fremen::error::{Error, Result};
use fremen::visibility::BitRow;

/// Keypoints and descriptors as two arrays.
#[derive(Default)]
pub(super) struct Arrays {
    pub(super) keypoints: Vec<u8>,
    descriptors: Vec<u8>,
    /// The file of the keypoints, for messages.
    pub(super) path: PathBuf,
    num_taken: usize,
}

impl Arrays {
    pub(super) fn push(&mut self, features: &Features) {
        (self.keypoints).extend(codec::encode_keypoints(features.keypoints()));
        (self.descriptors).extend(codec::encode_descriptors(features.descriptors()));
    }

    pub(super) fn write(&self, folder: &mut NewFolder, prefix: &str) -> Result<()> {
        let keypoints = npy::encode(npy::F32, 4, &self.keypoints);
        folder.write(&format!("{prefix}keypoints.npy"), &keypoints)?;
        let descriptors = npy::encode(npy::U8, DESCRIPTOR_BYTES, &self.descriptors);
        folder.write(&format!("{prefix}descriptors.npy"), &descriptors)
    }

    pub(super) fn read(folder: &Folder, prefix: &str) -> Result<Self> {
        let path = |name: &str| folder.path_of(&format!("{prefix}{name}.npy"));
        let read = |name: &str, of, columns| {
            let bytes = folder.read(&format!("{prefix}{name}.npy"))?;
            npy::decode(&path(name), bytes, of, columns)
        };
        let keypoints = read("keypoints", npy::F32, 4)?;
        let descriptors = read("descriptors", npy::U8, DESCRIPTOR_BYTES)?;
        let (points, rows) = (
            keypoints.len() / KEYPOINT_BYTES,
            descriptors.len() / DESCRIPTOR_BYTES,
        );
        if points == rows {
            Ok(Self {
                keypoints,
                descriptors,
                path: path("keypoints"),
                num_taken: 0,
            })
        } else {
            Err(format_error(format!(
                "{rows} descriptors do not pair with {points} keypoints"
            ))
            .with_path(path("descriptors")))
        }
    }

    /// The next `len` features, still as bytes.
    pub(super) fn take(&mut self, len: usize) -> Result<Pending<'_>> {
        let start = self.num_taken;
        let end = start.checked_add(len).filter(|_| len <= MAX_FEATURES);
        let keypoints = end.and_then(|end| {
            (self.keypoints).get(start * KEYPOINT_BYTES..end.checked_mul(KEYPOINT_BYTES)?)
        });
        let (Some(keypoints), Some(end)) = (keypoints, end) else {
            let message = format!("{len} more rows are expected than there are");
            return Err(format_error(message)
                .with_place(format!("row {start}"))
                .with_path(&self.path));
        };
        self.num_taken = end;
        Ok(Pending {
            keypoints,
            descriptors: &self.descriptors[start * DESCRIPTOR_BYTES..end * DESCRIPTOR_BYTES],
            path: &self.path,
            row: start,
        })
    }

    pub(super) fn must_be_empty(&self) -> Result<()> {
        let rows = self.keypoints.len() / KEYPOINT_BYTES;
        if self.num_taken == rows {
            return Ok(());
        }
        let message = format!("{} rows belong to nothing", rows - self.num_taken);
        Err(format_error(message)
            .with_place(format!("row {}", self.num_taken))
            .with_path(&self.path))
    }
}

/// Features that are not decoded yet.
pub(super) struct Pending<'a> {
    pub(super) keypoints: &'a [u8],
    descriptors: &'a [u8],
    pub(super) path: &'a Path,
    row: usize,
}

impl Pending<'_> {
    /// The first `len`, if there are so many and their numbers are finite.
    pub(super) fn split(&mut self, len: usize) -> Option<Features> {
        let (keypoints, left) =
            (self.keypoints).split_at_checked(len.checked_mul(KEYPOINT_BYTES)?)?;
        let (descriptors, others) = self.descriptors.split_at_checked(len * DESCRIPTOR_BYTES)?;
        (self.keypoints, self.descriptors) = (left, others);
        let keypoints = codec::decode_keypoints(keypoints).ok()?;
        codec::pair(keypoints, codec::decode_descriptors(descriptors).ok()?).ok()
    }

    pub(super) fn all(mut self) -> Result<Features> {
        let len = self.keypoints.len() / KEYPOINT_BYTES;
        let (path, row) = (self.path, self.row);
        self.split(len).ok_or_else(|| {
            format_error(format!(
                "a number of the {len} keypoints from here is not finite"
            ))
            .with_place(format!("row {row}"))
            .with_path(path)
        })
    }
}

/// A one-dimensional array that is read from its start.
pub(super) struct Cells<'a> {
    pub(super) path: &'a Path,
    numbers: &'a [u8],
    valid: &'static [u8],
    wanted: &'static str,
    num_taken: usize,
}

impl<'a> Cells<'a> {
    pub(super) fn new(
        path: &'a Path,
        numbers: &'a [u8],
        valid: &'static [u8],
        wanted: &'static str,
    ) -> Self {
        Self {
            path,
            numbers,
            valid,
            wanted,
            num_taken: 0,
        }
    }

    pub(super) fn error(&self, row: usize, message: impl Into<String>) -> Error {
        format_error(message)
            .with_place(format!("row {row}"))
            .with_path(self.path)
    }

    /// The next `len` cells: which are 1, and which are -1.
    pub(super) fn take(&mut self, len: usize) -> Result<(BitRow, BitRow)> {
        let start = self.num_taken;
        let cells = self.numbers[start..].get(..len);
        let Some(cells) = cells.filter(|_| len <= MAX_FEATURES) else {
            let message = format!("{len} more rows are expected than there are");
            return Err(self.error(start, message));
        };
        if let Some(at) = cells.iter().position(|cell| !self.valid.contains(cell)) {
            return Err(self.error(start + at, format!("{} is expected", self.wanted)));
        }
        self.num_taken += len;
        let row = |wanted: u8| {
            let mut row = BitRow::zeros(len);
            let ones = cells
                .iter()
                .enumerate()
                .filter(|&(_, &cell)| cell == wanted);
            ones.for_each(|(i, _)| row.set(i));
            row
        };
        Ok((row(1), row(u8::MAX)))
    }

    pub(super) fn must_be_empty(&self) -> Result<()> {
        match self.numbers.len() - self.num_taken {
            0 => Ok(()),
            rest => Err(self.error(self.num_taken, format!("{rest} rows belong to nothing"))),
        }
    }
}
