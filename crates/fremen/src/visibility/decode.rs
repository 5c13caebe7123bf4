//! Which model do these bytes hold?

use super::codec::TAG;
use super::{
    Cautious, Civil, Fremen, Histogram, Logistic, Markov, Mean, Pergam, Persistent, VisibilityModel,
};
use crate::error::Result;
use crate::spectrum::Reader;

/// Models round models round models: one is of use, and bytes from outside may hold thousands.
const MAX_DEPTH: usize = 8;

/// The model that [`VisibilityModel::encode`] wrote.
///
/// Fails with [`ErrorKind::Checksum`](crate::ErrorKind::Checksum) if the bytes are damaged and with
/// [`ErrorKind::Format`](crate::ErrorKind::Format) if they are no model: never a panic, and no more
/// memory than a small multiple of the bytes.
pub fn decode(bytes: &[u8]) -> Result<Box<dyn VisibilityModel>> {
    decode_nested(bytes, 0)
}

fn decode_nested(bytes: &[u8], depth: usize) -> Result<Box<dyn VisibilityModel>> {
    let mut reader = Reader::new(bytes, TAG, "a model of visibility")?;
    let model: Box<dyn VisibilityModel> = match reader.byte()? {
        0 => Box::new(Mean::read(&mut reader)?),
        1 => Box::new(Fremen::read(&mut reader)?),
        2 => Box::new(Logistic::read(&mut reader)?),
        3 => Box::new(Histogram::read(&mut reader)?),
        4 => Box::new(Pergam::read(&mut reader)?),
        5 => Box::new(Markov::read(&mut reader)?),
        6 if depth < MAX_DEPTH => {
            let of = decode_nested(reader.bytes()?, depth + 1)?;
            Box::new(Persistent::read(&mut reader, of)?)
        }
        7 if depth < MAX_DEPTH => {
            let of = decode_nested(reader.bytes()?, depth + 1)?;
            Box::new(Cautious::read(&mut reader, of)?)
        }
        8 if depth < MAX_DEPTH => {
            let of = decode_nested(reader.bytes()?, depth + 1)?;
            Box::new(Civil::read(&mut reader, of)?)
        }
        kind => return Err(reader.impossible(&format!("there is no kind {kind} of models"))),
    };
    reader.finish()?;
    Ok(model)
}
