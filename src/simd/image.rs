//! How fast are the rows of an image summed, filtered and searched on this CPU?
//!
//! Loops over pixels that touch no neighbour of what they write: plain Rust, written once so that
//! the compiler makes vectors of them, and compiled once for every [`Kernel`]. The order of every
//! sum is that of the source, and nothing is contracted, so that all kernels give the same bits.
//!
//! The meaning of the numbers is `feature`'s affair (STAR, BRIEF); here they are rows.
//!
//! Invariants: no allocation; a row of any length, also shorter than a vector; integers wrap.

use super::kernel::Kernel;
#[cfg(target_arch = "x86_64")]
use super::kernel::Kind;

/// Most stars (sums around a pixel) that a bank of filters has.
pub(crate) const MAX_STARS: usize = 17;

/// Pixels whose stars wait on the stack until every filter has seen them.
const PIXELS_PER_CHUNK: usize = 64;

/// Where the corners of a star lie in the three integral images, counted from that of its centre.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct StarCorners {
    /// In the upright one: added, taken off, taken off, added.
    pub(crate) square: [isize; 4],
    /// In that of cones with one tip: both added.
    pub(crate) one_tip: [isize; 2],
    /// In that of cones with two tips: both taken off.
    pub(crate) two_tips: [isize; 2],
}

/// `response = inner * per_inner - (outer - inner) * per_ring`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CentreSurround {
    /// What a pixel remembers of the filter it answers to.
    pub(crate) size: u8,
    /// The star of the centre.
    pub(crate) inner: usize,
    /// The star of centre and surround.
    pub(crate) outer: usize,
    pub(crate) per_inner: f32,
    pub(crate) per_ring: f32,
}

/// Three integral images of one shape, the stars that are summed in them and the filters over
/// those.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FilterBank<'a> {
    pub(crate) upright: &'a [u32],
    pub(crate) one_tip: &'a [u32],
    pub(crate) two_tips: &'a [u32],
    /// At most [`MAX_STARS`].
    pub(crate) stars: &'a [StarCorners],
    /// In the order in which equal magnitudes win.
    pub(crate) filters: &'a [CentreSurround],
}

/// Which pixels can be keypoints at all.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ExtremeRule {
    /// Magnitudes are above this.
    pub(crate) threshold: f32,
    /// Sizes are at least this ...
    pub(crate) min_size: u8,
    /// ... and below this.
    pub(crate) end_size: u8,
}

/// Compiles the functions of [`plain`] for every kernel, and a method of [`Kernel`] that chooses.
macro_rules! for_every_kernel {
    ($($(#[$attribute:meta])* fn $name:ident($($argument:ident: $type:ty),* $(,)?);)*) => {
        impl Kernel {
            $($(#[$attribute])*
            pub(crate) fn $name(self, $($argument: $type),*) {
                match self.0 {
                    #[cfg(target_arch = "x86_64")]
                    // SAFETY: a kernel of this kind exists only after its CPU feature was detected.
                    Kind::Avx2 => unsafe { for_avx2::$name($($argument),*) },
                    #[cfg(target_arch = "x86_64")]
                    // SAFETY: a kernel of this kind exists only after its CPU features were
                    // detected.
                    Kind::Avx512 => unsafe { for_avx512::$name($($argument),*) },
                    // NEON is part of the instructions that aarch64 is always compiled for.
                    _ => plain::$name($($argument),*),
                }
            })*
        }

        #[cfg(target_arch = "x86_64")]
        mod for_avx2 {
            use super::*;
            $(#[target_feature(enable = "avx2")]
            pub(super) fn $name($($argument: $type),*) {
                plain::$name($($argument),*);
            })*
        }

        #[cfg(target_arch = "x86_64")]
        mod for_avx512 {
            use super::*;
            $(#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl")]
            pub(super) fn $name($($argument: $type),*) {
                plain::$name($($argument),*);
            })*
        }
    };
}

for_every_kernel! {
    /// `row[i] = above[i] + above[i + 2] - above_2[i + 1] + a[i] + b[i]`, modulo 2^32.
    fn add_cones(above: &[u32], above_2: &[u32], a: &[u8], b: &[u8], row: &mut [u32]);

    /// `row[0] = 0`, `row[i + 1] = above[i + 1] + pixels[0] + .. + pixels[i]`, modulo 2^32.
    fn add_prefixes(above: &[u32], pixels: &[u8], row: &mut [u32]);

    /// For each pixel from `at` on (in the integral images) the response of largest magnitude, the
    /// first filter's of equal ones, and that filter's size; 0 and 0 where all responses are 0.
    fn keep_strongest(bank: FilterBank<'_>, at: usize, responses: &mut [f32], sizes: &mut [u8]);

    /// `highest[i]` and `lowest[i]`: the extremes of `row[i..=i + 2 * reach]`.
    fn extremes_across(row: &[f32], reach: usize, highest: &mut [f32], lowest: &mut [f32]);

    /// `highest[i]` and `lowest[i]`: the extremes of `other_highest[i]` and `other_lowest[i]` too.
    fn extremes_along(
        other_highest: &[f32],
        other_lowest: &[f32],
        highest: &mut [f32],
        lowest: &mut [f32],
    );

    /// `marks[i]` = 1 where `row[i]` is one of the extremes that surround it and keeps `rule`, else
    /// 0.
    fn mark_extremes(
        row: &[f32],
        sizes: &[u8],
        highest: &[f32],
        lowest: &[f32],
        rule: ExtremeRule,
        marks: &mut [u8],
    );

    /// `sums[i] += plus[i] - minus[i]`, modulo 2^16.
    fn slide(plus: &[u8], minus: &[u8], sums: &mut [u16]);

    /// `boxes[i] = sums[i] + .. + sums[i + 8]`, modulo 2^16.
    fn add_nine(sums: &[u16], boxes: &mut [u16]);
}

/// The loops themselves; compiled as they stand they are the scalar twin.
#[allow(
    clippy::inline_always,
    reason = "only inlined are they compiled with the instructions of the function that calls them"
)]
mod plain {
    use super::{CentreSurround, ExtremeRule, FilterBank, MAX_STARS, PIXELS_PER_CHUNK};

    #[inline(always)]
    pub(super) fn add_cones(above: &[u32], above_2: &[u32], a: &[u8], b: &[u8], row: &mut [u32]) {
        let n = row.len();
        let (left, right) = (&above[..n], &above[2..n + 2]);
        let (twice, a, b) = (&above_2[1..=n], &a[..n], &b[..n]);
        for i in 0..n {
            row[i] = left[i]
                .wrapping_add(right[i])
                .wrapping_sub(twice[i])
                .wrapping_add(u32::from(a[i]) + u32::from(b[i]));
        }
    }

    #[inline(always)]
    pub(super) fn add_prefixes(above: &[u32], pixels: &[u8], row: &mut [u32]) {
        row[0] = 0;
        let mut sum = 0_u32;
        for ((out, &up), &pixel) in row[1..].iter_mut().zip(&above[1..]).zip(pixels) {
            sum = sum.wrapping_add(u32::from(pixel));
            *out = up.wrapping_add(sum);
        }
    }

    #[inline(always)]
    pub(super) fn keep_strongest(
        bank: FilterBank<'_>,
        at: usize,
        responses: &mut [f32],
        sizes: &mut [u8],
    ) {
        let n = responses.len();
        if n < PIXELS_PER_CHUNK {
            let mut sums = [[0; 1]; MAX_STARS];
            for i in 0..n {
                chunk(
                    &bank,
                    at + i,
                    &mut sums,
                    &mut responses[i..],
                    &mut sizes[i..],
                );
            }
            return;
        }
        let mut sums = [[0; PIXELS_PER_CHUNK]; MAX_STARS];
        let mut done = 0;
        while done < n {
            // The last chunk makes some pixels a second time, and the same.
            let i = done.min(n - PIXELS_PER_CHUNK);
            chunk(
                &bank,
                at + i,
                &mut sums,
                &mut responses[i..],
                &mut sizes[i..],
            );
            done = i + PIXELS_PER_CHUNK;
        }
    }

    #[inline(always)]
    fn chunk<const N: usize>(
        bank: &FilterBank<'_>,
        at: usize,
        sums: &mut [[i32; N]; MAX_STARS],
        responses: &mut [f32],
        sizes: &mut [u8],
    ) {
        for (corners, sums) in bank.stars.iter().zip(&mut *sums) {
            let [s0, s1, s2, s3] = corners
                .square
                .map(|offset| &bank.upright[at.wrapping_add_signed(offset)..][..N]);
            let [a0, a1] = corners
                .one_tip
                .map(|offset| &bank.one_tip[at.wrapping_add_signed(offset)..][..N]);
            let [b0, b1] = corners
                .two_tips
                .map(|offset| &bank.two_tips[at.wrapping_add_signed(offset)..][..N]);
            for i in 0..N {
                let square = s0[i]
                    .wrapping_sub(s1[i])
                    .wrapping_sub(s2[i])
                    .wrapping_add(s3[i]);
                let rhombus = a0[i]
                    .wrapping_sub(b0[i])
                    .wrapping_sub(b1[i])
                    .wrapping_add(a1[i]);
                sums[i] = square.wrapping_add(rhombus).cast_signed();
            }
        }
        let mut best = [0_f32; N];
        let mut best_size = [0_u32; N];
        for filter in bank.filters {
            filter_chunk(
                filter,
                &sums[filter.inner],
                &sums[filter.outer],
                &mut best,
                &mut best_size,
            );
        }
        responses[..N].copy_from_slice(&best);
        for (narrow, &wide) in sizes[..N].iter_mut().zip(&best_size) {
            *narrow = wide as u8;
        }
    }

    /// The bits of the magnitude of a finite `f32`; ordered like the magnitudes.
    #[inline(always)]
    const fn magnitude(bits: u32) -> i32 {
        (bits & 0x7FFF_FFFF).cast_signed()
    }

    #[inline(always)]
    fn filter_chunk<const N: usize>(
        filter: &CentreSurround,
        inner: &[i32; N],
        outer: &[i32; N],
        best: &mut [f32; N],
        best_size: &mut [u32; N],
    ) {
        let size = u32::from(filter.size);
        for i in 0..N {
            let ring = outer[i].wrapping_sub(inner[i]);
            let response = inner[i] as f32 * filter.per_inner - ring as f32 * filter.per_ring;
            // Magnitudes compare as their bits do, and a choice by mask needs no branch: this is
            // what makes the loop a vector loop.
            let (new, old) = (response.to_bits(), best[i].to_bits());
            let mask = u32::from(magnitude(new) > magnitude(old)).wrapping_neg();
            best[i] = f32::from_bits(new & mask | old & !mask);
            best_size[i] = size & mask | best_size[i] & !mask;
        }
    }

    #[inline(always)]
    pub(super) fn extremes_across(
        row: &[f32],
        reach: usize,
        highest: &mut [f32],
        lowest: &mut [f32],
    ) {
        let n = highest.len();
        let lowest = &mut lowest[..n];
        highest.copy_from_slice(&row[..n]);
        lowest.copy_from_slice(&row[..n]);
        for shift in 1..=2 * reach {
            let row = &row[shift..][..n];
            extremes_along(row, row, highest, lowest);
        }
    }

    #[inline(always)]
    pub(super) fn extremes_along(
        other_highest: &[f32],
        other_lowest: &[f32],
        highest: &mut [f32],
        lowest: &mut [f32],
    ) {
        let n = highest.len();
        let (other_highest, other_lowest) = (&other_highest[..n], &other_lowest[..n]);
        let lowest = &mut lowest[..n];
        for i in 0..n {
            // Written as a choice this became a masked store, which is slow on some processors.
            highest[i] = highest[i].max(other_highest[i]);
            lowest[i] = lowest[i].min(other_lowest[i]);
        }
    }

    #[inline(always)]
    #[allow(
        clippy::needless_bitwise_bool,
        reason = "branches would keep the loop from becoming a vector loop"
    )]
    pub(super) fn mark_extremes(
        row: &[f32],
        sizes: &[u8],
        highest: &[f32],
        lowest: &[f32],
        rule: ExtremeRule,
        marks: &mut [u8],
    ) {
        let n = marks.len();
        let (row, sizes) = (&row[..n], &sizes[..n]);
        let (highest, lowest) = (&highest[..n], &lowest[..n]);
        for i in 0..n {
            let value = row[i];
            let bright = (value >= highest[i]) & (value > rule.threshold);
            let dark = (value <= lowest[i]) & (value < -rule.threshold);
            let counts = (sizes[i] >= rule.min_size) & (sizes[i] < rule.end_size);
            marks[i] = u8::from((bright | dark) & counts);
        }
    }

    #[inline(always)]
    pub(super) fn slide(plus: &[u8], minus: &[u8], sums: &mut [u16]) {
        let n = sums.len();
        let (plus, minus) = (&plus[..n], &minus[..n]);
        for i in 0..n {
            sums[i] = sums[i]
                .wrapping_add(u16::from(plus[i]))
                .wrapping_sub(u16::from(minus[i]));
        }
    }

    #[inline(always)]
    pub(super) fn add_nine(sums: &[u16], boxes: &mut [u16]) {
        let n = boxes.len();
        let sums: [&[u16]; 9] = std::array::from_fn(|shift| &sums[shift..][..n]);
        for i in 0..n {
            boxes[i] = sums
                .iter()
                .fold(0, |sum: u16, row| sum.wrapping_add(row[i]));
        }
    }
}
