//! How do features and rows of bits become bytes, and back?
//!
//! `maps/README.md` states the same for people ("Blobs").

use super::limits::{DESCRIPTOR_BYTES, KEYPOINT_BYTES};
use crate::feature::{Descriptor, Features, Keypoint};
use fremen::visibility::BitRow;

/// A blob or text that cannot be what was written: at which byte and why.
#[derive(Debug, PartialEq)]
pub(super) struct Malformed {
    pub(super) byte: usize,
    pub(super) message: String,
}

/// Bit `i` at bit `i % 8` of byte `i / 8`.
pub(super) fn encode_bits(row: &BitRow) -> Vec<u8> {
    let mut bytes: Vec<u8> = row.words().iter().flat_map(|w| w.to_le_bytes()).collect();
    bytes.truncate(row.len().div_ceil(8));
    bytes
}

pub(super) fn decode_bits(bytes: &[u8], len: usize) -> Result<BitRow, Malformed> {
    if bytes.len() != len.div_ceil(8) {
        return Err(Malformed {
            byte: bytes.len().min(len.div_ceil(8)),
            message: format!(
                "{} bytes, where {len} bits need {}",
                bytes.len(),
                len.div_ceil(8)
            ),
        });
    }
    let words = bytes
        .chunks(8)
        .map(|chunk| {
            let mut word = [0; 8];
            word[..chunk.len()].copy_from_slice(chunk);
            u64::from_le_bytes(word)
        })
        .collect();
    BitRow::from_words(words, len).map_err(|_| Malformed {
        byte: bytes.len() - 1,
        message: format!("a bit past the end of {len} is one"),
    })
}

/// 16 bytes each: x, y, size, response as 32-bit floats.
pub(super) fn encode_keypoints(keypoints: &[Keypoint]) -> Vec<u8> {
    keypoints
        .iter()
        .flat_map(|k| [k.x, k.y, k.size, k.response])
        .flat_map(f32::to_le_bytes)
        .collect()
}

/// 32 bytes each, in OpenCV's order.
pub(super) fn encode_descriptors(descriptors: &[Descriptor]) -> Vec<u8> {
    descriptors.iter().flat_map(|d| d.to_bytes()).collect()
}

pub(super) fn decode_keypoints(bytes: &[u8]) -> Result<Vec<Keypoint>, Malformed> {
    whole(bytes, KEYPOINT_BYTES, "keypoints")?;
    let (floats, _) = bytes.as_chunks::<4>();
    if let Some(at) = floats
        .iter()
        .position(|&float| !f32::from_le_bytes(float).is_finite())
    {
        return Err(Malformed {
            byte: at * 4,
            message: "a keypoint's number is not finite".into(),
        });
    }
    let (keypoints, _) = floats.as_chunks::<4>();
    Ok(keypoints
        .iter()
        .map(|&[x, y, size, response]| Keypoint {
            x: f32::from_le_bytes(x),
            y: f32::from_le_bytes(y),
            size: f32::from_le_bytes(size),
            response: f32::from_le_bytes(response),
        })
        .collect())
}

pub(super) fn decode_descriptors(bytes: &[u8]) -> Result<Vec<Descriptor>, Malformed> {
    whole(bytes, DESCRIPTOR_BYTES, "descriptors")?;
    let (descriptors, _) = bytes.as_chunks::<DESCRIPTOR_BYTES>();
    Ok(descriptors
        .iter()
        .map(|&bytes| Descriptor::from_bytes(bytes))
        .collect())
}

fn whole(bytes: &[u8], unit: usize, what: &str) -> Result<(), Malformed> {
    if bytes.len().is_multiple_of(unit) {
        Ok(())
    } else {
        Err(Malformed {
            byte: bytes.len() / unit * unit,
            message: format!("{} bytes are no whole number of {what}", bytes.len()),
        })
    }
}

pub(super) fn pair(
    keypoints: Vec<Keypoint>,
    descriptors: Vec<Descriptor>,
) -> Result<Features, Malformed> {
    let byte = descriptors.len().min(keypoints.len()) * DESCRIPTOR_BYTES;
    Features::from_parts(keypoints, descriptors).map_err(|error| Malformed {
        byte,
        message: error.to_string(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn bits_survive(bits in proptest::collection::vec(any::<bool>(), 0..200)) {
            let mut row = BitRow::zeros(bits.len());
            for (i, _) in bits.iter().enumerate().filter(|(_, bit)| **bit) {
                row.set(i);
            }
            prop_assert_eq!(decode_bits(&encode_bits(&row), bits.len()), Ok(row));
        }
    }

    #[test]
    fn what_does_not_fit_is_named_by_byte() {
        assert_eq!(decode_bits(&[0xff, 0x08], 11).expect_err("surplus").byte, 1);
        assert_eq!(decode_bits(&[0xff], 11).expect_err("short").byte, 1);
        assert_eq!(decode_keypoints(&[0; 17]).expect_err("odd").byte, 16);
        let mut infinite = [0; 32];
        infinite[20..24].copy_from_slice(&f32::INFINITY.to_le_bytes());
        assert_eq!(decode_keypoints(&infinite).expect_err("infinite").byte, 20);
    }
}
