//! Is this JPEG whole, and where does its picture end?
//!
//! The segments are walked through as ITU-T T.81 annex B arranges them; [`Scan`] reads the coded
//! data of each scan. The picture ends at its own end marker, whatever follows: phones append a
//! film, stereo cameras a second picture.
//!
//! A frame of a USB camera (motion JPEG) leaves out the Huffman tables, because they are always the
//! same ones, those of annex K.3. They are put in front of it. What the decoder cannot read at all
//! (12 bits, lossless, arithmetic code, JPEG-LS) is named.

use std::borrow::Cow;

use super::fault::{be16, damaged, truncated};
use super::huffman::{Huffman, is_marker};
use super::jpeg_scan::{Broken, Component, Scan};
use fremen::error::{Error, ErrorKind, Result};

/// Bits of code, as counts by length, and symbols of the four tables of annex K.3, with their class
/// (0: first coefficients) and number.
type Standard = (u8, u8, [u8; 16], &'static [u8]);

#[rustfmt::skip]
const STANDARD: [Standard; 4] = [
    (0, 0, [0, 1, 5, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0], &FIRST_SYMBOLS),
    (1, 0, [0, 2, 1, 3, 3, 2, 4, 3, 5, 5, 4, 4, 0, 0, 1, 0x7d], &LUMINANCE_SYMBOLS),
    (0, 1, [0, 3, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0], &FIRST_SYMBOLS),
    (1, 1, [0, 2, 1, 2, 4, 4, 3, 4, 7, 5, 4, 4, 0, 1, 2, 0x77], &CHROMINANCE_SYMBOLS),
];

const FIRST_SYMBOLS: [u8; 12] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11];

#[rustfmt::skip]
const LUMINANCE_SYMBOLS: [u8; 162] = [
    0x01, 0x02, 0x03, 0x00, 0x04, 0x11, 0x05, 0x12, 0x21, 0x31, 0x41, 0x06, 0x13, 0x51, 0x61, 0x07,
    0x22, 0x71, 0x14, 0x32, 0x81, 0x91, 0xa1, 0x08, 0x23, 0x42, 0xb1, 0xc1, 0x15, 0x52, 0xd1, 0xf0,
    0x24, 0x33, 0x62, 0x72, 0x82, 0x09, 0x0a, 0x16, 0x17, 0x18, 0x19, 0x1a, 0x25, 0x26, 0x27, 0x28,
    0x29, 0x2a, 0x34, 0x35, 0x36, 0x37, 0x38, 0x39, 0x3a, 0x43, 0x44, 0x45, 0x46, 0x47, 0x48, 0x49,
    0x4a, 0x53, 0x54, 0x55, 0x56, 0x57, 0x58, 0x59, 0x5a, 0x63, 0x64, 0x65, 0x66, 0x67, 0x68, 0x69,
    0x6a, 0x73, 0x74, 0x75, 0x76, 0x77, 0x78, 0x79, 0x7a, 0x83, 0x84, 0x85, 0x86, 0x87, 0x88, 0x89,
    0x8a, 0x92, 0x93, 0x94, 0x95, 0x96, 0x97, 0x98, 0x99, 0x9a, 0xa2, 0xa3, 0xa4, 0xa5, 0xa6, 0xa7,
    0xa8, 0xa9, 0xaa, 0xb2, 0xb3, 0xb4, 0xb5, 0xb6, 0xb7, 0xb8, 0xb9, 0xba, 0xc2, 0xc3, 0xc4, 0xc5,
    0xc6, 0xc7, 0xc8, 0xc9, 0xca, 0xd2, 0xd3, 0xd4, 0xd5, 0xd6, 0xd7, 0xd8, 0xd9, 0xda, 0xe1, 0xe2,
    0xe3, 0xe4, 0xe5, 0xe6, 0xe7, 0xe8, 0xe9, 0xea, 0xf1, 0xf2, 0xf3, 0xf4, 0xf5, 0xf6, 0xf7, 0xf8,
    0xf9, 0xfa,
];

#[rustfmt::skip]
const CHROMINANCE_SYMBOLS: [u8; 162] = [
    0x00, 0x01, 0x02, 0x03, 0x11, 0x04, 0x05, 0x21, 0x31, 0x06, 0x12, 0x41, 0x51, 0x07, 0x61, 0x71,
    0x13, 0x22, 0x32, 0x81, 0x08, 0x14, 0x42, 0x91, 0xa1, 0xb1, 0xc1, 0x09, 0x23, 0x33, 0x52, 0xf0,
    0x15, 0x62, 0x72, 0xd1, 0x0a, 0x16, 0x24, 0x34, 0xe1, 0x25, 0xf1, 0x17, 0x18, 0x19, 0x1a, 0x26,
    0x27, 0x28, 0x29, 0x2a, 0x35, 0x36, 0x37, 0x38, 0x39, 0x3a, 0x43, 0x44, 0x45, 0x46, 0x47, 0x48,
    0x49, 0x4a, 0x53, 0x54, 0x55, 0x56, 0x57, 0x58, 0x59, 0x5a, 0x63, 0x64, 0x65, 0x66, 0x67, 0x68,
    0x69, 0x6a, 0x73, 0x74, 0x75, 0x76, 0x77, 0x78, 0x79, 0x7a, 0x82, 0x83, 0x84, 0x85, 0x86, 0x87,
    0x88, 0x89, 0x8a, 0x92, 0x93, 0x94, 0x95, 0x96, 0x97, 0x98, 0x99, 0x9a, 0xa2, 0xa3, 0xa4, 0xa5,
    0xa6, 0xa7, 0xa8, 0xa9, 0xaa, 0xb2, 0xb3, 0xb4, 0xb5, 0xb6, 0xb7, 0xb8, 0xb9, 0xba, 0xc2, 0xc3,
    0xc4, 0xc5, 0xc6, 0xc7, 0xc8, 0xc9, 0xca, 0xd2, 0xd3, 0xd4, 0xd5, 0xd6, 0xd7, 0xd8, 0xd9, 0xda,
    0xe2, 0xe3, 0xe4, 0xe5, 0xe6, 0xe7, 0xe8, 0xe9, 0xea, 0xf2, 0xf3, 0xf4, 0xf5, 0xf6, 0xf7, 0xf8,
    0xf9, 0xfa,
];

/// The picture without what follows it, with Huffman tables.
pub(super) fn picture<'a>(
    bytes: &'a [u8],
    check_size: &dyn Fn(u64, u64) -> Result<()>,
) -> Result<Cow<'a, [u8]>> {
    let mut walk = Walk::new(bytes);
    let end = walk.find_end(check_size)?;
    let picture = &bytes[..end];
    if walk.has_tables {
        return Ok(picture.into());
    }
    let mut whole = picture[..2].to_vec();
    for (class, number, counts, symbols) in STANDARD {
        whole.extend([0xFF, 0xC4, 0, 19 + symbols.len() as u8, class << 4 | number]);
        whole.extend(counts);
        whole.extend(symbols);
    }
    whole.extend(&picture[2..]);
    Ok(whole.into())
}

/// What was read of a JPEG so far.
struct Walk<'a> {
    bytes: &'a [u8],
    at: usize,
    components: Vec<Component>,
    /// Of each, the number of its quantisation table.
    step_numbers: Vec<usize>,
    is_progressive: bool,
    /// Units of a scan of several components.
    units: (usize, usize),
    restart: usize,
    /// Quantisation steps of first coefficients, by number of the table.
    steps: [i64; 4],
    /// Tables by class and number.
    tables: [[Option<Huffman>; 4]; 2],
    /// Whether the file brings its own.
    has_tables: bool,
}

impl<'a> Walk<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        Self {
            bytes,
            at: 2,
            components: Vec::new(),
            step_numbers: Vec::new(),
            is_progressive: false,
            units: (0, 0),
            restart: 0,
            steps: [0; 4],
            tables: Default::default(),
            has_tables: false,
        }
    }

    /// Walks to the byte behind the picture's end marker.
    fn find_end(&mut self, check_size: &dyn Fn(u64, u64) -> Result<()>) -> Result<usize> {
        loop {
            let code = self.next_marker()?;
            if matches!(code, 0x01 | 0xD0..=0xD8) {
                continue;
            }
            if code == 0xD9 {
                self.check_components()?;
                return Ok(self.at);
            }
            let len = be16(self.bytes, self.at).ok_or_else(truncated)?;
            let end = self.at + len.max(2);
            let segment = self.bytes.get(self.at + 2..end).ok_or_else(truncated)?;
            self.at = end;
            match code {
                0xC0..=0xC2 => self.frame(code, segment, check_size)?,
                0xC3 | 0xC5..=0xC7 | 0xC9..=0xCB | 0xCD..=0xCF | 0xF7 => {
                    return Err(unsupported(code));
                }
                0xC4 => self.huffman_tables(segment)?,
                0xDB => self.quantisation_tables(segment)?,
                0xDD => self.restart = be16(segment, 0).ok_or_else(|| cut_short("DRI"))?,
                0xDA => self.scan(segment)?,
                _ => {}
            }
        }
    }

    /// The code of the next marker; the position moves behind it.
    fn next_marker(&mut self) -> Result<u8> {
        // Bytes between two segments mean nothing to any reader.
        let found = (self.at..self.bytes.len())
            .find(|&at| is_marker(self.bytes, at) && self.bytes.get(at + 1) != Some(&0xFF));
        let at = found.ok_or_else(truncated)?;
        self.at = at + 2;
        Ok(self.bytes[at + 1])
    }

    fn frame(
        &mut self,
        code: u8,
        segment: &[u8],
        check_size: &dyn Fn(u64, u64) -> Result<()>,
    ) -> Result<()> {
        let (Some(height), Some(width), [bits, _, _, _, _, count, parts @ ..]) =
            (be16(segment, 1), be16(segment, 3), segment)
        else {
            return Err(cut_short("SOF"));
        };
        if *bits != 8 {
            return Err(not_read(format!("a JPEG of {bits} bits a sample")));
        }
        check_size(width as u64, height as u64)?;
        let parts = parts.as_chunks::<3>().0;
        if !self.components.is_empty() || parts.len() < usize::from(*count) || *count == 0 {
            return Err(damaged("its frame header (SOF) makes no sense"));
        }
        let parts = &parts[..usize::from(*count)];
        let sampling = |part: &[u8; 3]| (usize::from(part[1] >> 4), usize::from(part[1] & 15));
        let most = |of: &dyn Fn((usize, usize)) -> usize| {
            parts
                .iter()
                .map(|part| of(sampling(part)))
                .max()
                .unwrap_or(1)
        };
        let most = (most(&|it| it.0), most(&|it| it.1));
        if parts.iter().any(|part| {
            let (across, down) = sampling(part);
            !(1..=4).contains(&across) || !(1..=4).contains(&down)
        }) {
            return Err(damaged("its frame header (SOF) makes no sense"));
        }
        self.is_progressive = code == 0xC2;
        self.units = (width.div_ceil(8 * most.0), height.div_ceil(8 * most.1));
        for part in parts {
            let (across, down) = sampling(part);
            let stride = self.units.0 * across;
            let num_blocks = stride * self.units.1 * down;
            self.components.push(Component {
                id: part[0],
                sampling: (across, down),
                blocks: (
                    (width * across).div_ceil(most.0).div_ceil(8),
                    (height * down).div_ceil(most.1).div_ceil(8),
                ),
                stride,
                nonzero: vec![0; if self.is_progressive { num_blocks } else { 0 }],
                lowest: [None; 64],
                step: 0,
                before: 0,
            });
            self.step_numbers.push(usize::from(part[2]));
        }
        Ok(())
    }

    fn quantisation_tables(&mut self, mut segment: &[u8]) -> Result<()> {
        while let [id, rest @ ..] = segment {
            let (bytes, first) = match id >> 4 {
                0 => (1, rest.first().map(|&step| i64::from(step))),
                _ => (2, be16(rest, 0).map(|step| step as i64)),
            };
            let step = self.steps.get_mut(usize::from(id & 15));
            let (Some(first), Some(step)) = (first, step) else {
                return Err(damaged("a quantisation table (DQT) makes no sense"));
            };
            *step = first;
            segment = rest.get(64 * bytes..).ok_or_else(|| cut_short("DQT"))?;
        }
        Ok(())
    }

    fn huffman_tables(&mut self, mut segment: &[u8]) -> Result<()> {
        self.has_tables = true;
        while let [id, rest @ ..] = segment {
            let counts = rest.first_chunk::<16>().ok_or_else(|| cut_short("DHT"))?;
            let total: usize = counts.iter().map(|&count| usize::from(count)).sum();
            let symbols = rest.get(16..16 + total).ok_or_else(|| cut_short("DHT"))?;
            let table = self
                .tables
                .get_mut(usize::from(id >> 4))
                .and_then(|class| class.get_mut(usize::from(id & 15)))
                .ok_or_else(|| damaged("a Huffman table (DHT) has no such number"))?;
            *table = Some(
                Huffman::new(counts, symbols)
                    .ok_or_else(|| damaged("a Huffman table (DHT) makes no sense"))?,
            );
            segment = &rest[16 + total..];
        }
        Ok(())
    }

    /// Reads the coded data of a scan.
    fn scan(&mut self, segment: &[u8]) -> Result<()> {
        if !self.has_tables {
            for (class, number, counts, symbols) in STANDARD {
                self.tables[usize::from(class)][usize::from(number)] =
                    Huffman::new(&counts, symbols);
            }
        }
        let no_sense = || damaged("a scan header (SOS) makes no sense");
        let [count, rest @ ..] = segment else {
            return Err(cut_short("SOS"));
        };
        let (parts, rest) = rest
            .split_at_checked(2 * usize::from(*count))
            .ok_or_else(|| cut_short("SOS"))?;
        let &[from, to, bits, ..] = rest else {
            return Err(cut_short("SOS"));
        };
        let mut found = Vec::new();
        for &[id, tables] in parts.as_chunks::<2>().0 {
            let position = (self.components.iter())
                .position(|component| component.id == id)
                .ok_or_else(no_sense)?;
            let table =
                |class: usize, number: u8| self.tables[class].get(usize::from(number))?.as_ref();
            found.push((position, table(0, tables >> 4), table(1, tables & 15)));
        }
        let (high, low) = (bits >> 4, bits & 15);
        let is_sensible = if self.is_progressive {
            to < 64 && from <= to && (from > 0 || to == 0) && (from == 0 || found.len() == 1)
        } else {
            true
        };
        if found.is_empty() || !is_sensible {
            return Err(no_sense());
        }
        let scan = Scan {
            parts: found,
            is_progressive: self.is_progressive,
            band: (u32::from(from), u32::from(to)),
            high,
            low: if self.is_progressive { low } else { 0 },
            restart: self.restart,
            units: self.units,
        };
        for &(position, ..) in &scan.parts {
            let number = self.step_numbers[position];
            self.components[position].step = self.steps.get(number).copied().unwrap_or_default();
        }
        self.at = (scan.walk(self.bytes, self.at, &mut self.components))
            .map_err(|broken| self.broken(&broken))?;
        let band = if self.is_progressive {
            usize::from(from)..=usize::from(to)
        } else {
            0..=63
        };
        let low = if self.is_progressive { low } else { 0 };
        for &(position, ..) in &scan.parts {
            self.components[position].lowest[band.clone()].fill(Some(low));
        }
        Ok(())
    }

    fn broken(&self, broken: &Broken) -> Error {
        match *broken {
            Broken::Short(at, ..) if at >= self.bytes.len() => truncated(),
            Broken::Short(_, unit, total) => damaged(format_args!(
                "its coded data ends after {unit} of {total} blocks"
            )),
            Broken::Code(unit, total) => damaged(format_args!(
                "its coded data makes no sense after {unit} of {total} blocks"
            )),
            Broken::Surplus(left) => damaged(format_args!(
                "{left} bytes of coded data are left over after its last block"
            )),
            Broken::NoTable => damaged("a Huffman table is missing"),
            Broken::Restart => damaged("a restart marker is missing"),
        }
    }

    /// Whether every component was coded, to its lowest bit.
    fn check_components(&self) -> Result<()> {
        if self.components.is_empty() {
            return Err(damaged("it has an end, but no picture"));
        }
        let is_whole = |component: &Component| {
            let is_open = |lowest: &Option<u8>| lowest.is_some_and(|bit| bit > 0);
            component.lowest[0].is_some() && !component.lowest.iter().any(is_open)
        };
        if self.components.iter().all(is_whole) {
            Ok(())
        } else {
            Err(damaged("some of its scans are missing"))
        }
    }
}

fn cut_short(segment: &str) -> Error {
    damaged(format_args!("its segment {segment} is too short"))
}

/// A kind of JPEG by the code of its frame.
fn unsupported(code: u8) -> Error {
    not_read(match code {
        0xC3 => "a lossless JPEG (SOF3)".into(),
        0xF7 => "a JPEG-LS (SOF55)".into(),
        0xC9..=0xCB => "a JPEG in arithmetic code".into(),
        code => format!("a hierarchical JPEG (SOF{})", code - 0xC0),
    })
}

fn not_read(what: impl std::fmt::Display) -> Error {
    Error::new(ErrorKind::Format, format!("{what} is not supported"))
        .with_help("convert it to a baseline JPEG or a PNG of 8 bits")
}
