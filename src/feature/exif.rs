//! When does this file say that it was taken?
//!
//! [`exif_stamps`] reads the dates of a photograph's EXIF data as text, because pixels know nothing
//! of time here; `dataset` reads them. EXIF is a TIFF directory (with one of the camera's own and
//! one of GPS) inside JPEG, PNG, WebP, TIFF or `BigTIFF`. Writers take its rules lightly, so this reader is as
//! lenient as others are: a directory that claims more entries than there are has those that are
//! there, an entry that points out of the file is left out, a directory that nothing follows needs
//! not say so, and a tag counts in whichever directory it stands.
//!
//! Not for: other tags, or HEIF.

use std::path::Path;

use super::image_file::{DecodeLimits, read_file};
use fremen::error::Result;

/// What the EXIF data of a file says of its time, as it is written there.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct ExifStamps {
    /// When the picture was taken, digitised, changed: those that are there, in this order.
    pub stamps: Vec<ExifStamp>,
    /// The moment of the position, in UTC: `2024:05:02 09:00:00.000000`.
    pub gps: Option<String>,
}

/// One date.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct ExifStamp {
    /// Usually `2024:05:02 11:00:00`.
    pub civil: String,
    /// Digits of a fraction of a second; may be empty.
    pub fraction: String,
    /// Its distance from UTC, where that is said: `+02:00`.
    pub offset: Option<String>,
}

const EXIF_DIRECTORY: u16 = 0x8769;
const GPS_DIRECTORY: u16 = 0x8825;
/// Date, offset, fraction: of taking, of digitising, of the last change.
const STAMPS: [[u16; 3]; 3] = [
    [0x9003, 0x9011, 0x9291],
    [0x9004, 0x9012, 0x9292],
    [0x0132, 0x9010, 0x9290],
];
const GPS_TIME: u16 = 7;
const GPS_DATE: u16 = 29;
/// No text read here is longer.
const MAX_TEXT_BYTES: usize = 64;

/// The dates in the EXIF data of a file; none if it has no such data.
///
/// Fails only where the file cannot be read.
pub fn exif_stamps(path: impl AsRef<Path>) -> Result<ExifStamps> {
    let path = path.as_ref();
    let bytes = read_file(path, &DecodeLimits::default()).map_err(|error| error.with_path(path))?;
    Ok(stamps_in(&bytes))
}

fn stamps_in(bytes: &[u8]) -> ExifStamps {
    let mut found = ExifStamps::default();
    for tiff in blocks(bytes) {
        let Some(tiff) = Tiff::new(tiff) else {
            continue;
        };
        let read = tiff.stamps();
        if found.stamps.is_empty() {
            found.stamps = read.stamps;
        }
        found.gps = found.gps.or(read.gps);
    }
    found
}

/// The EXIF blocks of a file, from their byte order mark on.
fn blocks(bytes: &[u8]) -> Vec<&[u8]> {
    if bytes.starts_with(&[0xFF, 0xD8]) {
        jpeg_blocks(bytes)
    } else if bytes.starts_with(b"\x89PNG") {
        chunks(bytes, 8, |chunk| {
            let (len, rest) = chunk.split_first_chunk::<4>()?;
            let (kind, rest) = rest.split_first_chunk::<4>()?;
            Some((*kind == *b"eXIf", u32::from_be_bytes(*len), rest, 4))
        })
    } else if bytes.starts_with(b"RIFF") {
        chunks(bytes, 12, |chunk| {
            let (kind, rest) = chunk.split_first_chunk::<4>()?;
            let (len, rest) = rest.split_first_chunk::<4>()?;
            let len = u32::from_le_bytes(*len);
            Some((*kind == *b"EXIF", len, rest, (len % 2) as usize))
        })
    } else {
        vec![bytes]
    }
}

/// The bodies of the chunks that `read` wants; it gives that, the length, what follows the head,
/// and how many bytes follow the body.
fn chunks(
    bytes: &[u8],
    start: usize,
    read: impl Fn(&[u8]) -> Option<(bool, u32, &[u8], usize)>,
) -> Vec<&[u8]> {
    let mut found = Vec::new();
    let mut rest = bytes.get(start..).unwrap_or_default();
    while let Some((is_wanted, len, body, after)) = read(rest) {
        let len = (len as usize).min(body.len());
        if is_wanted {
            found.extend(from_mark(&body[..len]));
        }
        rest = body.get(len + after..).unwrap_or_default();
    }
    found
}

/// The segments APP1 before the first scan that hold EXIF data.
fn jpeg_blocks(bytes: &[u8]) -> Vec<&[u8]> {
    let mut found = Vec::new();
    let mut at = 2;
    while let Some([0xFF, code, high, low]) = bytes.get(at..at + 4) {
        if *code == 0xFF {
            at += 1;
            continue;
        }
        if matches!(code, 0xD9 | 0xDA) {
            break;
        }
        let len = usize::from(*high) << 8 | usize::from(*low);
        let end = (at + 2 + len).min(bytes.len());
        let body = bytes.get(at + 4..end).unwrap_or_default();
        if *code == 0xE1 && body.starts_with(b"Exif") {
            found.extend(from_mark(body));
        }
        at += 2 + len.max(2);
    }
    found
}

/// From the byte order mark on, which some bytes may precede.
fn from_mark(block: &[u8]) -> Option<&[u8]> {
    let at = (0..block.len().min(16)).find(|&at| Tiff::new(&block[at..]).is_some())?;
    Some(&block[at..])
}

/// A TIFF structure, from its byte order mark on.
#[derive(Clone, Copy)]
struct Tiff<'a> {
    bytes: &'a [u8],
    is_big_endian: bool,
    /// Whether counts and offsets have eight bytes (`BigTIFF`).
    is_wide: bool,
}

#[derive(Clone, Copy)]
struct Entry {
    tag: u16,
    kind: u16,
    count: u64,
    /// Where its value stands.
    at: usize,
}

impl<'a> Tiff<'a> {
    fn new(bytes: &'a [u8]) -> Option<Self> {
        let (is_big_endian, is_wide) = match bytes.get(..4)? {
            b"II*\0" => (false, false),
            b"MM\0*" => (true, false),
            b"II+\0" => (false, true),
            b"MM\0+" => (true, true),
            _ => return None,
        };
        Some(Self {
            bytes,
            is_big_endian,
            is_wide,
        })
    }

    fn stamps(&self) -> ExifStamps {
        let main = self.offset(if self.is_wide { 8 } else { 4 });
        let main = main.map(|at| self.directory(at)).unwrap_or_default();
        let below = |tag: u16| {
            let entry = main.iter().find(|entry| entry.tag == tag)?;
            let at = match entry.kind {
                16 | 18 => self.offset(entry.at)?,
                _ => self.long(entry.at)? as usize,
            };
            Some(self.directory(at))
        };
        let camera = below(EXIF_DIRECTORY).unwrap_or_default();
        let gps = below(GPS_DIRECTORY).unwrap_or_default();
        let text = |tag: u16| {
            let entries = camera.iter().chain(&main);
            (entries.filter(|entry| entry.tag == tag)).find_map(|entry| self.text(entry))
        };
        let [taken, digitised, changed] = STAMPS.map(|[date, offset, fraction]| {
            text(date).map(|civil| ExifStamp {
                civil,
                fraction: text(fraction).unwrap_or_default(),
                offset: text(offset),
            })
        });
        let mut stamps: Vec<ExifStamp> =
            [taken, digitised, changed].into_iter().flatten().collect();
        // One camera has one clock: what is said of a date counts for its twins.
        for at in 0..stamps.len() {
            if stamps[at].offset.is_none() {
                let same =
                    |stamp: &&ExifStamp| stamp.civil == stamps[at].civil && stamp.offset.is_some();
                stamps[at].offset = stamps.iter().find(same).and_then(|it| it.offset.clone());
            }
        }
        ExifStamps {
            stamps,
            gps: self.gps(&gps),
        }
    }

    fn gps(&self, entries: &[Entry]) -> Option<String> {
        let find = |tag: u16| entries.iter().find(|entry| entry.tag == tag);
        let date = self.text(find(GPS_DATE)?)?;
        let time =
            find(GPS_TIME).filter(|entry| matches!(entry.kind, 5 | 10) && entry.count >= 3)?;
        let mut parts = [0.0; 3];
        for (number, part) in parts.iter_mut().enumerate() {
            let at = time.at.checked_add(8 * number)?;
            let (above, below) = (self.long(at)?, self.long(at.checked_add(4)?)?);
            *part = f64::from(above) / f64::from(below);
        }
        let [hours, minutes, seconds] = parts;
        let whole = (hours * 3_600.0 + minutes * 60.0 + seconds) * 1e6;
        if !(0.0..86_400e6).contains(&whole) {
            return None;
        }
        let us = whole.round() as u64;
        let (s, us) = (us / 1_000_000, us % 1_000_000);
        Some(format!(
            "{date} {:02}:{:02}:{:02}.{us:06}",
            s / 3_600,
            s / 60 % 60,
            s % 60
        ))
    }

    /// The entries of the directory at `start` that are there.
    fn directory(&self, start: usize) -> Vec<Entry> {
        /// No directory of a photograph has as many entries.
        const MAX_ENTRIES: usize = 1 << 16;
        // Bytes of the count of entries, of an entry, of a count or value in it.
        let (head, step, wide) = if self.is_wide { (8, 20, 8) } else { (2, 12, 4) };
        let count = if self.is_wide {
            self.offset(start).unwrap_or_default().min(MAX_ENTRIES)
        } else {
            usize::from(self.short(start).unwrap_or_default())
        };
        let entry = |number: usize| {
            let at = start.checked_add(head + step * number)?;
            let (tag, kind) = (self.short(at)?, self.short(at + 2)?);
            let (count, value) = (self.offset(at + 4)? as u64, self.offset(at + 4 + wide)?);
            let size = match kind {
                3 | 8 => 2,
                4 | 9 | 11 | 13 => 4,
                5 | 10 | 12 | 16..=18 => 8,
                _ => 1,
            };
            let is_here = count.saturating_mul(size) <= wide as u64;
            Some(Entry {
                tag,
                kind,
                count,
                at: if is_here { at + 4 + wide } else { value },
            })
        };
        (0..count).map_while(entry).collect()
    }

    /// A text, as far as it lies inside of the file; `None` if it says nothing.
    fn text(&self, entry: &Entry) -> Option<String> {
        // ASCII and UTF-8; some write bytes or call it undefined.
        if !matches!(entry.kind, 1 | 2 | 7 | 129) {
            return None;
        }
        let len = entry.count.min(MAX_TEXT_BYTES as u64) as usize;
        let bytes = self.bytes.get(entry.at..)?;
        let bytes = &bytes[..len.min(bytes.len())];
        let text = bytes.split(|&byte| byte == 0).next()?;
        let text = std::str::from_utf8(text).ok()?.trim();
        (!text.is_empty()).then(|| text.to_owned())
    }

    /// A count or an offset.
    fn offset(&self, at: usize) -> Option<usize> {
        if !self.is_wide {
            return Some(self.long(at)? as usize);
        }
        let bytes = *self.bytes.get(at..)?.first_chunk::<8>()?;
        let number = if self.is_big_endian {
            u64::from_be_bytes(bytes)
        } else {
            u64::from_le_bytes(bytes)
        };
        usize::try_from(number).ok()
    }

    fn short(&self, at: usize) -> Option<u16> {
        let bytes = *self.bytes.get(at..)?.first_chunk::<2>()?;
        Some(if self.is_big_endian {
            u16::from_be_bytes(bytes)
        } else {
            u16::from_le_bytes(bytes)
        })
    }

    fn long(&self, at: usize) -> Option<u32> {
        let bytes = *self.bytes.get(at..)?.first_chunk::<4>()?;
        Some(if self.is_big_endian {
            u32::from_be_bytes(bytes)
        } else {
            u32::from_le_bytes(bytes)
        })
    }
}
