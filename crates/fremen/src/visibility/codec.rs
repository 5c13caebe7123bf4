//! How is a fitted model kept as bytes?
//!
//! A tag of four bytes (`CVM` and a version), a byte that names the kind, what the kind needs (written and
//! read beside each model), and a CRC-32. Probabilities and factors are little-endian `f64` as they are in
//! memory, so a decoded model predicts the same bits. A model is a cache of a log: its bytes are for what
//! must start at once (an index beside a map, a worker of a cluster), not for archives.

use super::{Fremen, Histogram, Logistic, Markov, Mean, Pergam, Persistent, VisibilityModel};
use crate::error::Result;
use crate::spectrum::{Reader, Writer};

const TAG: [u8; 4] = *b"CVM\x01";

/// Models round models round models: one is of use, and bytes from outside may hold thousands.
const MAX_DEPTH: usize = 8;

/// The kinds of models in their order of bytes.
#[derive(Clone, Copy)]
pub(super) enum Kind {
    Mean,
    Fremen,
    Logistic,
    Histogram,
    Pergam,
    Markov,
    Persistent,
}

/// The bytes of a model of `kind`, whose own part `write` writes.
pub(super) fn encode(kind: Kind, write: impl FnOnce(&mut Writer)) -> Vec<u8> {
    let mut writer = Writer::new(TAG);
    writer.byte(kind as u8);
    write(&mut writer);
    writer.finish()
}

/// The model that [`VisibilityModel::encode`] wrote.
///
/// Fails with [`ErrorKind::Checksum`](crate::ErrorKind::Checksum) if the bytes are damaged and with
/// [`ErrorKind::Format`](crate::ErrorKind::Format) if they are no model: never a panic, and no more memory
/// than a small multiple of the bytes.
pub fn decode(bytes: &[u8]) -> Result<Box<dyn VisibilityModel>> {
    decode_nested(bytes, 0)
}

pub(super) fn decode_nested(bytes: &[u8], depth: usize) -> Result<Box<dyn VisibilityModel>> {
    let mut reader = Reader::new(bytes, TAG, "a model of visibility")?;
    let model: Box<dyn VisibilityModel> = match reader.byte()? {
        0 => Box::new(Mean::read(&mut reader)?),
        1 => Box::new(Fremen::read(&mut reader)?),
        2 => Box::new(Logistic::read(&mut reader)?),
        3 => Box::new(Histogram::read(&mut reader)?),
        4 => Box::new(Pergam::read(&mut reader)?),
        5 => Box::new(Markov::read(&mut reader)?),
        6 if depth < MAX_DEPTH => Box::new(Persistent::read(&mut reader, depth + 1)?),
        kind => return Err(reader.impossible(&format!("there is no kind {kind} of models"))),
    };
    reader.finish()?;
    Ok(model)
}
