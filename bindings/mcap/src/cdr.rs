//! Which numbers and texts are in these CDR bytes?
//!
//! ROS 2 messages are Common Data Representation (OMG formal/2002-06-51, 15.3; DDS-XTypes 1.3,
//! 7.4): four bytes say which variant follows, then values follow each other in either byte order,
//! each aligned to its own size, counted from behind the four bytes. The second version of the
//! encoding aligns to at most four. Sequences and texts begin with their length; a text ends in a
//! zero, which its length counts.
//!
//! A [`Cursor`] borrows: an image's pixels are not copied, and nothing is allocated for a length
//! that the bytes do not have.

use chronotope::error::{Error, ErrorKind, Result};

/// Bytes that say which variant of CDR follows.
const HEADER_BYTES: usize = 4;

/// What is left to be read of a message.
#[derive(Clone, Debug)]
pub(crate) struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
    is_big_endian: bool,
    max_align: usize,
}

macro_rules! number {
    ($name:ident, $type:ty) => {
        pub(crate) fn $name(&mut self) -> Result<$type> {
            const BYTES: usize = size_of::<$type>();
            self.align(BYTES)?;
            let mut bytes = [0; BYTES];
            bytes.copy_from_slice(self.take(BYTES, stringify!($type))?);
            Ok(if self.is_big_endian {
                <$type>::from_be_bytes(bytes)
            } else {
                <$type>::from_le_bytes(bytes)
            })
        }
    };
}

impl<'a> Cursor<'a> {
    /// Behind the four bytes at the beginning of a message.
    ///
    /// Fails if they name no plain CDR.
    pub(crate) fn new(message: &'a [u8]) -> Result<Self> {
        let Some((header, bytes)) = message.split_at_checked(HEADER_BYTES) else {
            return Err(ended("its header", message.len()));
        };
        let (is_big_endian, max_align) = match header[..2] {
            [0, 0] => (true, 8),
            [0, 1] => (false, 8),
            [0, 6] => (true, 4),
            [0, 7] => (false, 4),
            _ => {
                let message = format!(
                    "the message is no plain CDR: it begins with {:02x} {:02x}",
                    header[0], header[1]
                );
                return Err(Error::new(ErrorKind::Format, message)
                    .with_place("byte 0")
                    .with_help(
                        "was it written by ROS 2? convert the bag with `ros2 bag convert`",
                    ));
            }
        };
        Ok(Self {
            bytes,
            at: 0,
            is_big_endian,
            max_align,
        })
    }

    number!(u16, u16);
    number!(u32, u32);
    number!(i32, i32);
    number!(f64, f64);

    pub(crate) fn u8(&mut self) -> Result<u8> {
        Ok(self.take(1, "u8")?[0])
    }

    /// A text without the zero that ends it; what is no UTF-8 in it is replaced, as these are names
    /// that people see.
    pub(crate) fn text(&mut self) -> Result<String> {
        let bytes = self.byte_sequence()?;
        let bytes = bytes.strip_suffix(&[0]).unwrap_or(bytes);
        Ok(String::from_utf8_lossy(bytes).into_owned())
    }

    /// A sequence of bytes, where it lies.
    pub(crate) fn byte_sequence(&mut self) -> Result<&'a [u8]> {
        let len = self.u32()? as usize;
        self.take(len, "a sequence of bytes")
    }

    /// How many elements follow, of at least so many bytes each.
    pub(crate) fn sequence_len(&mut self, min_bytes: usize) -> Result<usize> {
        let len = self.u32()? as usize;
        if len.saturating_mul(min_bytes) > self.bytes.len() - self.at {
            return Err(ended(
                &format!("a sequence of {len} elements"),
                self.at + HEADER_BYTES,
            ));
        }
        Ok(len)
    }

    fn align(&mut self, size: usize) -> Result<()> {
        let align = size.min(self.max_align);
        let padding = self.at.next_multiple_of(align) - self.at;
        self.take(padding, "padding").map(|_| ())
    }

    fn take(&mut self, len: usize, what: &str) -> Result<&'a [u8]> {
        let rest = &self.bytes[self.at..];
        let Some(taken) = rest.get(..len) else {
            return Err(ended(what, self.at + HEADER_BYTES));
        };
        self.at += len;
        Ok(taken)
    }
}

fn ended(what: &str, at: usize) -> Error {
    let message = format!("the message ends inside {what}");
    Error::new(ErrorKind::Format, message).with_place(format!("byte {at}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_byte_orders_and_both_versions_are_read() -> Result<()> {
        // u8, text, f64.
        let little = [
            &[0, 1, 0, 0, 7, 0, 0, 0, 3, 0, 0, 0][..],
            b"ab\0\0",
            &[0, 0, 0, 0],
            &1.5_f64.to_le_bytes(),
        ]
        .concat();
        let big = [
            &[0, 0, 0, 0, 7, 0, 0, 0, 0, 0, 0, 3][..],
            b"ab\0\0",
            &[0, 0, 0, 0],
            &1.5_f64.to_be_bytes(),
        ]
        .concat();
        // The second version aligns to four.
        let second = [
            &[0, 7, 0, 0, 7, 0, 0, 0, 3, 0, 0, 0][..],
            b"ab\0\0",
            &1.5_f64.to_le_bytes(),
        ]
        .concat();
        for bytes in [little, big, second] {
            let mut cursor = Cursor::new(&bytes)?;
            assert_eq!(cursor.u8()?, 7);
            assert_eq!(cursor.text()?, "ab");
            assert_eq!(cursor.f64()?, 1.5);
            assert!(cursor.u8().is_err());
        }
        Ok(())
    }

    #[test]
    fn what_is_not_there_is_an_error_and_takes_no_memory() -> Result<()> {
        for bytes in [&[][..], &[0, 1], &[0, 3, 0, 0], &[1, 1, 0, 0]] {
            assert!(Cursor::new(bytes).is_err(), "{bytes:?}");
        }
        let bytes = [0, 1, 0, 0, 0xff, 0xff, 0xff, 0xff, 1, 2];
        let error = Cursor::new(&bytes)?.byte_sequence().expect_err("too long");
        assert_eq!(error.place(), Some("byte 8"));
        assert!(Cursor::new(&bytes)?.sequence_len(48).is_err());
        Ok(())
    }
}
