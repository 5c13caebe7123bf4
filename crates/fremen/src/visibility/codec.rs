//! How is a fitted model kept as bytes?
//!
//! A tag of four bytes (`CVM` and a version), a byte that names the kind, what the kind needs
//! (written and read beside each model), and a CRC-32. Probabilities and factors are little-endian
//! `f64` as they are in memory, so a decoded model predicts the same bits. A model is a cache of a
//! log: its bytes are for what must start at once (an index beside a map, a worker of a cluster),
//! not for archives.

use crate::spectrum::Writer;

pub(super) const TAG: [u8; 4] = *b"CVM\x01";

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
    Cautious,
    Civil,
}

/// The bytes of a model of `kind`, whose own part `write` writes.
pub(super) fn encode(kind: Kind, write: impl FnOnce(&mut Writer)) -> Vec<u8> {
    let mut writer = Writer::new(TAG);
    writer.byte(kind as u8);
    write(&mut writer);
    writer.finish()
}
