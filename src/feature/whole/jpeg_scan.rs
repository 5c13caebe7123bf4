//! Is every block of this JPEG scan there?
//!
//! The blocks of a scan are read one after another as ITU-T T.81 codes them (F.2.2 sequential, G.2
//! progressive), without their values. A progressive scan that refines needs to know which
//! coefficients are not zero so far: one bit each.

use super::huffman::{Bits, Fault, Huffman};

/// So many bytes of zeros or ones between the last block and the next marker are padding, with which
/// some cameras fill up the data. Data that was damaged leaves others, or ends too early.
const MAX_PADDING_BYTES: usize = 16;

/// First coefficients are eight times a mean level of -128 to 127; rounding to steps may exceed that.
/// In damaged data they run away, because each is coded as the difference to the one before.
const MAX_FIRST: i64 = 1_280;

/// One component of the frame.
pub(super) struct Component {
    pub(super) id: u8,
    /// Sampling factors, across and down.
    pub(super) sampling: (usize, usize),
    /// Blocks across and down that a scan of this component alone has.
    pub(super) blocks: (usize, usize),
    /// Blocks in a row of its picture filled up to whole units.
    pub(super) stride: usize,
    /// Of each block, the coefficients that are not zero so far; empty unless progressive.
    pub(super) nonzero: Vec<u64>,
    /// Of each coefficient, the lowest bit that was coded so far.
    pub(super) lowest: [Option<u8>; 64],
    /// The quantisation step of its first coefficients; 0 if its table was never given.
    pub(super) step: i64,
    /// The first coefficient of the block before, in steps.
    pub(super) before: i64,
}

/// What one scan codes.
pub(super) struct Scan<'t> {
    /// Positions of its components, with their tables for the first and the other coefficients.
    pub(super) parts: Vec<(usize, Option<&'t Huffman>, Option<&'t Huffman>)>,
    pub(super) is_progressive: bool,
    /// First and last coefficient.
    pub(super) band: (u32, u32),
    /// The bit down to which the coefficients were coded before; 0: not at all.
    pub(super) high: u8,
    /// And the one down to which they are coded here.
    pub(super) low: u8,
    /// Units (blocks, if of one component) between two restart markers; 0: there are none.
    pub(super) restart: usize,
    /// Units across and down of a scan of several components.
    pub(super) units: (usize, usize),
}

/// Why a scan is not whole.
pub(super) enum Broken {
    /// It ends at the byte given, in this one of so many units.
    Short(usize, usize, usize),
    /// Its code makes no sense, in this one of so many units.
    Code(usize, usize),
    /// So many bytes follow the last unit.
    Surplus(usize),
    /// A table is missing.
    NoTable,
    /// Another marker than the restart that was due.
    Restart,
}

impl Scan<'_> {
    /// Reads all of it; gives the position of the marker behind it.
    pub(super) fn walk(
        &self,
        bytes: &[u8],
        start: usize,
        components: &mut [Component],
    ) -> Result<usize, Broken> {
        let (across, down) = match &self.parts[..] {
            [(only, ..)] => components[*only].blocks,
            _ => self.units,
        };
        let total = across.saturating_mul(down);
        let mut bits = Bits::new(bytes, start);
        let mut band_end = 0;
        self.forget_before(components);
        for unit in 0..total {
            if self.restart > 0 && unit > 0 && unit % self.restart == 0 {
                bits = Bits::new(bytes, self.pass_restart(&bits, bytes, unit)?);
                band_end = 0;
                self.forget_before(components);
            }
            let done = self.unit(
                &mut bits,
                components,
                (unit % across, unit / across),
                &mut band_end,
            );
            match done {
                Ok(()) => {}
                Err(Fault::Short) => {
                    return Err(Broken::Short(bits.finish().0, unit, total));
                }
                Err(Fault::Code) => return Err(Broken::Code(unit, total)),
                Err(Fault::NoTable) => return Err(Broken::NoTable),
            }
        }
        let mut at = pass_padding(&bits)?;
        // A restart marker may stand behind the last interval, too.
        while self.restart > 0
            && (bytes.get(at + 1)).is_some_and(|code| (0xD0..0xD8).contains(code))
        {
            at += 2;
        }
        Ok(at)
    }

    fn forget_before(&self, components: &mut [Component]) {
        self.parts
            .iter()
            .for_each(|part| components[part.0].before = 0);
    }

    /// The position behind the restart marker that is due before `unit`.
    fn pass_restart(&self, bits: &Bits<'_>, bytes: &[u8], unit: usize) -> Result<usize, Broken> {
        let mut at = pass_padding(bits)?;
        while bytes.get(at + 1) == Some(&0xFF) {
            at += 1;
        }
        let due = 0xD0 + ((unit / self.restart - 1) % 8) as u8;
        match bytes.get(at + 1) {
            Some(&code) if code == due => Ok(at + 2),
            Some(_) => Err(Broken::Restart),
            None => Err(Broken::Short(at, unit, unit)),
        }
    }

    fn unit(
        &self,
        bits: &mut Bits<'_>,
        components: &mut [Component],
        (x, y): (usize, usize),
        band_end: &mut u32,
    ) -> Result<(), Fault> {
        if let [(only, first, others)] = self.parts[..] {
            let component = &mut components[only];
            let at = y * component.stride + x;
            return self.block(bits, component, at, (first, others), band_end);
        }
        for &(position, first, others) in &self.parts {
            let component = &mut components[position];
            let (across, down) = component.sampling;
            for block in 0..across * down {
                let (x, y) = (x * across + block % across, y * down + block / across);
                let at = y * component.stride + x;
                self.block(bits, component, at, (first, others), band_end)?;
            }
        }
        Ok(())
    }

    fn block(
        &self,
        bits: &mut Bits<'_>,
        component: &mut Component,
        at: usize,
        (first, others): (Option<&Huffman>, Option<&Huffman>),
        band_end: &mut u32,
    ) -> Result<(), Fault> {
        if !self.is_progressive {
            self.first(bits, component, first.ok_or(Fault::NoTable)?)?;
            return sequential(bits, others.ok_or(Fault::NoTable)?);
        }
        match (self.band.0, self.high) {
            (0, 0) => self.first(bits, component, first.ok_or(Fault::NoTable)?),
            (0, _) => bits.take(1).map(drop),
            (_, high) => {
                let mut nothing = 0;
                let nonzero = component.nonzero.get_mut(at).unwrap_or(&mut nothing);
                let table = others.ok_or(Fault::NoTable)?;
                let band = Band {
                    from: self.band.0,
                    to: self.band.1,
                };
                if high == 0 {
                    band.first(bits, table, nonzero, band_end)
                } else {
                    band.refine(bits, table, nonzero, band_end)
                }
            }
        }
    }

    /// Reads a first coefficient: the difference to that of the block before.
    fn first(
        &self,
        bits: &mut Bits<'_>,
        component: &mut Component,
        table: &Huffman,
    ) -> Result<(), Fault> {
        let size = u32::from(bits.symbol(table)?);
        if size > 16 {
            return Err(Fault::Code);
        }
        let value = i64::from(bits.take(size)?);
        let is_negative = size > 0 && value < 1 << (size - 1);
        component.before += if is_negative {
            value - (1 << size) + 1
        } else {
            value
        };
        let level = (component.before << self.low) * component.step;
        if level.abs() > MAX_FIRST + component.step {
            return Err(Fault::Code);
        }
        Ok(())
    }
}

/// The position of the marker behind the data, if nothing but padding is between.
fn pass_padding(bits: &Bits<'_>) -> Result<usize, Broken> {
    let (at, left, is_padding) = bits.finish();
    if left > MAX_PADDING_BYTES || !is_padding {
        return Err(Broken::Surplus(left));
    }
    Ok(at)
}

/// Passes the other 63 coefficients of a sequential block.
fn sequential(bits: &mut Bits<'_>, table: &Huffman) -> Result<(), Fault> {
    let mut k = 1;
    while k < 64 {
        let symbol = bits.symbol(table)?;
        let (run, size) = (u32::from(symbol >> 4), u32::from(symbol & 15));
        match (run, size) {
            (15, 0) => k += 16,
            (_, 0) => return Ok(()),
            _ => {
                k += run + 1;
                bits.take(size)?;
            }
        }
        if k > 64 {
            return Err(Fault::Code);
        }
    }
    Ok(())
}

/// The coefficients that a progressive scan codes.
#[derive(Clone, Copy)]
struct Band {
    from: u32,
    to: u32,
}

impl Band {
    /// Passes their upper bits. `band_end`: so many blocks have no more of them.
    fn first(
        self,
        bits: &mut Bits<'_>,
        table: &Huffman,
        nonzero: &mut u64,
        band_end: &mut u32,
    ) -> Result<(), Fault> {
        if *band_end > 0 {
            *band_end -= 1;
            return Ok(());
        }
        let mut k = self.from;
        while k <= self.to {
            let symbol = bits.symbol(table)?;
            let (run, size) = (u32::from(symbol >> 4), u32::from(symbol & 15));
            match (run, size) {
                (15, 0) => k += 16,
                (_, 0) => {
                    *band_end = (1 << run) - 1 + bits.take(run)?;
                    return Ok(());
                }
                _ => {
                    k += run;
                    if k > self.to {
                        return Err(Fault::Code);
                    }
                    bits.take(size)?;
                    *nonzero |= 1 << k;
                    k += 1;
                }
            }
        }
        Ok(())
    }

    /// Passes one more bit of each.
    fn refine(
        self,
        bits: &mut Bits<'_>,
        table: &Huffman,
        nonzero: &mut u64,
        band_end: &mut u32,
    ) -> Result<(), Fault> {
        let mut k = self.from;
        while *band_end == 0 && k <= self.to {
            let symbol = bits.symbol(table)?;
            let (mut zeros, size) = (u32::from(symbol >> 4), symbol & 15);
            match size {
                0 if zeros < 15 => {
                    *band_end = (1 << zeros) + bits.take(zeros)?;
                    break;
                }
                0 => {}
                1 => {
                    bits.take(1)?;
                }
                _ => return Err(Fault::Code),
            }
            while k <= self.to {
                if *nonzero >> k & 1 == 1 {
                    bits.take(1)?;
                } else if zeros == 0 {
                    break;
                } else {
                    zeros -= 1;
                }
                k += 1;
            }
            if size == 1 {
                if k > self.to {
                    return Err(Fault::Code);
                }
                *nonzero |= 1 << k;
            }
            k += 1;
        }
        if *band_end > 0 {
            while k <= self.to {
                if *nonzero >> k & 1 == 1 {
                    bits.take(1)?;
                }
                k += 1;
            }
            *band_end -= 1;
        }
        Ok(())
    }
}
