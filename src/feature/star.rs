//! Where are the centres of bright and dark blobs, and how large are they (STAR)?
//!
//! STAR is the centre-surround detector CenSurE (Agrawal, Konolige, Blas: *CenSurE: Center Surround
//! Extremas for Realtime Feature Detection and Matching*, ECCV 2008) with the star-shaped two-level
//! filter of OpenCV. The same grey bytes give the keypoints, sizes and responses of OpenCV's
//! `StarDetector`, bit for bit.
//!
//! # Filter
//! The star of radius `r` sums a square and a rhombus, the overlap twice:
//!
//! ```text
//! star_r(x, y) = sum of I over max(|dx|, |dy|) <= r  +  sum of I over |dx| + |dy| <= t,   t = r + r / 2
//! area_r       = (2 r + 1)^2                         +  t^2 + (t + 1)^2
//! ```
//!
//! A filter of size `s` (2, 4, 6, 8, 12, 16, 22, 32, 46, 64, 90, 128) compares the mean of the star of
//! radius `s / 2` with the mean of the ring around it, up to the star of radius `s`:
//!
//! ```text
//! response_s = star_{s/2} / area_{s/2} - (star_s - star_{s/2}) / (area_s - area_{s/2})
//! ```
//!
//! Each pixel keeps the response of largest magnitude (the smallest size of equal ones) and its size.
//! Sums come from integral images, so that a pixel costs the same for every size: squares from the
//! upright one `S`, rhombi from two sums over cones that open upwards (`-y`), where `A` has one pixel
//! at its tip and `B` has two, `x - 1` and `x`:
//!
//! ```text
//! A(x, y) = A(x-1, y-1) + A(x+1, y-1) - A(x, y-2) + I(x, y) + I(x, y-1)
//! B(x, y) = B(x-1, y-1) + B(x+1, y-1) - B(x, y-2) + I(x, y) + I(x-1, y)
//! rhombus_t(x, y) = A(x, y+t) - B(x-t, y-1) - B(x+t+1, y-1) + A(x, y-1-t)
//! ```
//!
//! The sums are modulo 2^32, and a difference of four of them is exact however large the image is.
//!
//! # Keypoints
//! The largest and the smallest response of every tile of `n / 2 + 1` px (`n` = `suppress_nonmax_size`)
//! is a keypoint if it is strictly extreme within `n / 2` px, beyond the threshold, of a size that is
//! neither below 4 nor the largest, and not on a line. Lines are rejected (Agrawal et al., section
//! 3.4: the ratio of principal curvatures) by the second moments of the response's gradient over 9x9
//! samples that are `size / 4` px apart, `(Lxx + Lyy)^2 >= k (Lxx Lyy - Lxy^2)`, and by the same test
//! on the "is of the same size" map.
//!
//! Deviation from the paper, kept because OpenCV has it and published results rest on it: a minimum
//! (dark blob) carries as its response not its own value but the largest one of its tile, or the
//! threshold, so that over a third of all keypoints share a response.
//!
//! Complexity: O(pixels x sizes); about 12 bytes of integral images and 5 bytes of responses a pixel.
//! Within one and a half times the largest filter size of the image's edge there are no keypoints:
//! 69 px for `max_size` = 45.
//!
//! Not for: subpixel positions, orientations, or images under 140 px a side at the default size.

use super::{GrayImage, Keypoint};
use crate::error::{Error, ErrorKind, Result};

/// Sizes of all filters; each is twice the radius of its centre.
const FILTER_SIZES: [u8; 12] = [2, 4, 6, 8, 12, 16, 22, 32, 46, 64, 90, 128];

/// Columns whose sums are made together: small enough for 14 rows of them to stay in the L1 cache.
const CHUNK: usize = 128;

/// The parameters of STAR, as in [`StarBriefConfig`](super::StarBriefConfig).
#[derive(Clone, Copy, Debug)]
pub(super) struct StarParams {
    pub(super) max_size: u8,
    pub(super) response_threshold: u16,
    pub(super) line_threshold_projected: u16,
    pub(super) line_threshold_binarized: u16,
    pub(super) suppress_nonmax_size: u8,
}

impl StarParams {
    /// Whether a detector can work with these values.
    pub(super) fn check(self) -> Result<()> {
        if !(5..=128).contains(&self.max_size) {
            return Err(Error::new(
                ErrorKind::Config,
                format!("STAR's max_size is 5 to 128 px, not {}", self.max_size),
            ));
        }
        // The window of an extremum must stay inside the image: the smallest border is 9 px, that of
        // the reference recipe 69 px.
        let border = self.border();
        if usize::from(self.suppress_nonmax_size) / 2 > border {
            return Err(Error::new(
                ErrorKind::Config,
                format!(
                    "STAR's suppress_nonmax_size is at most {} px with max_size {}, not {}",
                    2 * border + 1,
                    self.max_size,
                    self.suppress_nonmax_size
                ),
            ));
        }
        Ok(())
    }

    /// Filters in use, from the smallest to the first that is not below `max_size`.
    fn filters(self) -> &'static [u8] {
        let below = FILTER_SIZES
            .iter()
            .take_while(|&&size| size < self.max_size)
            .count();
        &FILTER_SIZES[..(below + 1).min(FILTER_SIZES.len())]
    }

    /// Pixels along each edge that no filter can be centred on.
    fn border(self) -> usize {
        self.filters()
            .last()
            .map_or(0, |&size| rhombus_radius(usize::from(size)))
    }
}

const fn rhombus_radius(radius: usize) -> usize {
    radius + radius / 2
}

const fn star_area(radius: usize) -> usize {
    let t = rhombus_radius(radius);
    (2 * radius + 1) * (2 * radius + 1) + t * t + (t + 1) * (t + 1)
}

/// One filter: which stars it subtracts and by what it divides.
struct Filter {
    size: u8,
    inner: usize,
    outer: usize,
    per_inner: f32,
    per_ring: f32,
}

/// The filters in use and the radii of all their stars, ascending.
struct FilterBank {
    radii: Vec<usize>,
    filters: Vec<Filter>,
}

impl FilterBank {
    fn new(params: StarParams) -> Self {
        let sizes = params.filters();
        let mut radii: Vec<usize> = sizes
            .iter()
            .flat_map(|&size| [usize::from(size) / 2, usize::from(size)])
            .collect();
        radii.sort_unstable();
        radii.dedup();
        let filters = sizes
            .iter()
            .map(|&size| {
                let (inner, outer) = (usize::from(size) / 2, usize::from(size));
                Filter {
                    size,
                    inner: radii.partition_point(|&radius| radius < inner),
                    outer: radii.partition_point(|&radius| radius < outer),
                    per_inner: 1.0 / star_area(inner) as f32,
                    per_ring: 1.0 / (star_area(outer) - star_area(inner)) as f32,
                }
            })
            .collect();
        Self { radii, filters }
    }
}

/// Buffers that grow to the largest image seen and are then reused.
#[derive(Default)]
pub(super) struct StarScratch {
    upright: Vec<u32>,
    cone_one: Vec<u32>,
    cone_two: Vec<u32>,
    zeros: Vec<u32>,
    stars: Vec<i32>,
    sizes_of_chunk: Vec<u32>,
    responses: Vec<f32>,
    sizes: Vec<u8>,
    column_max: Vec<f32>,
    column_min: Vec<f32>,
}

/// Appends the keypoints of `image` to `keypoints`, in no particular order.
///
/// `params` have passed [`StarParams::check`].
pub(super) fn detect(
    image: &GrayImage,
    params: StarParams,
    scratch: &mut StarScratch,
    keypoints: &mut Vec<Keypoint>,
) {
    let border = params.border();
    if image.width().min(image.height()) <= 2 * border {
        return;
    }
    integrate(image, scratch);
    let bank = FilterBank::new(params);
    respond(image.width(), image.height(), border, &bank, scratch);
    let field = Field {
        width: image.width(),
        height: image.height(),
        border,
        responses: &scratch.responses,
        sizes: &scratch.sizes,
        largest: bank.filters.last().map_or(0, |filter| filter.size),
        params,
    };
    field.extrema(&mut scratch.column_max, &mut scratch.column_min, keypoints);
}

/// Elements of a row of the three integral images: columns -1 to `width`.
const fn integral_stride(width: usize) -> usize {
    width + 2
}

/// Fills the integral images; row `y + 1` of each belongs to row `y` of the image, row 0 is zero.
///
/// `upright` and `cone_two` store column `x` at `x`, `cone_one` at `x + 1`.
fn integrate(image: &GrayImage, scratch: &mut StarScratch) {
    let (width, height) = (image.width(), image.height());
    let stride = integral_stride(width);
    let len = (height + 1) * stride;
    for plane in [
        &mut scratch.upright,
        &mut scratch.cone_one,
        &mut scratch.cone_two,
    ] {
        plane.resize(len, 0);
        plane[..stride].fill(0);
    }
    scratch.zeros.clear();
    scratch.zeros.resize(stride, 0);
    let no_pixels = vec![0_u8; width];
    for y in 0..height {
        let pixels = image.row(y);
        let pixels_above = if y == 0 {
            &no_pixels[..]
        } else {
            image.row(y - 1)
        };
        let this = (y + 1) * stride;

        let (above, row) = scratch.upright.split_at_mut(this);
        prefix_row(&above[this - stride..], pixels, &mut row[..=width]);

        let (above, row) = scratch.cone_one.split_at_mut(this);
        let above_2 = if y == 0 {
            &scratch.zeros
        } else {
            &above[this - 2 * stride..]
        };
        let above = &above[this - stride..];
        cone_row(above, above_2, pixels, pixels_above, &mut row[1..=width]);
        // Beyond the edges, where the image is black, a cone equals its neighbour one row up.
        row[0] = above[1];
        row[width + 1] = above[width];
        let (first, last) = (row[1], row[width]);

        let (above, row) = scratch.cone_two.split_at_mut(this);
        let above_2 = if y == 0 {
            &scratch.zeros
        } else {
            &above[this - 2 * stride..]
        };
        let above = &above[this - stride..];
        cone_row(above, above_2, &pixels[1..], pixels, &mut row[1..width]);
        // A cone with one of its two tips outside is a cone with one tip.
        row[0] = first;
        row[width] = last;
    }
}

/// `row[x]` = sum of all pixels above and of those left of `x`.
fn prefix_row(above: &[u32], pixels: &[u8], row: &mut [u32]) {
    let mut sum = 0_u32;
    row[0] = 0;
    for ((out, &up), &pixel) in row[1..].iter_mut().zip(&above[1..]).zip(pixels) {
        sum = sum.wrapping_add(u32::from(pixel));
        *out = up.wrapping_add(sum);
    }
}

/// `row[i] = above[i] + above[i + 2] - above_2[i + 1] + a[i] + b[i]`, modulo 2^32.
#[inline(never)] // inlined, the slices may alias for all the compiler knows: no vectors
fn cone_row(above: &[u32], above_2: &[u32], a: &[u8], b: &[u8], row: &mut [u32]) {
    let n = row.len();
    let (left, right) = (&above[..n], &above[2..n + 2]);
    let (twice, a, b) = (&above_2[1..=n], &a[..n], &b[..n]);
    for i in 0..n {
        row[i] = left[i]
            .wrapping_add(right[i])
            .wrapping_sub(twice[i])
            .wrapping_add(u32::from(a[i]))
            .wrapping_add(u32::from(b[i]));
    }
}

/// Fills `responses` and `sizes`; both are zero along the border.
fn respond(width: usize, height: usize, border: usize, bank: &FilterBank, s: &mut StarScratch) {
    s.responses.clear();
    s.responses.resize(width * height, 0.0);
    s.sizes.clear();
    s.sizes.resize(width * height, 0);
    s.stars.resize(bank.radii.len() * CHUNK, 0);
    s.sizes_of_chunk.resize(CHUNK, 0);
    let stride = integral_stride(width);
    for y in border..height - border {
        for x in (border..width - border).step_by(CHUNK) {
            let n = CHUNK.min(width - border - x);
            for (&radius, out) in bank.radii.iter().zip(s.stars.chunks_exact_mut(CHUNK)) {
                let upright = s.upright.as_slice();
                let corner = |row: usize, column: usize| &upright[row * stride + column..][..n];
                let square = [
                    corner(y + radius + 1, x + radius + 1),
                    corner(y + radius + 1, x - radius),
                    corner(y - radius, x + radius + 1),
                    corner(y - radius, x - radius),
                ];
                let t = rhombus_radius(radius);
                let rhombus = [
                    &s.cone_one[(y + t + 1) * stride + x + 1..][..n],
                    &s.cone_two[y * stride + x - t..][..n],
                    &s.cone_two[y * stride + x + t + 1..][..n],
                    &s.cone_one[(y - t) * stride + x + 1..][..n],
                ];
                add_stars(square, rhombus, &mut out[..n]);
            }
            let at = y * width + x;
            let best = &mut s.responses[at..][..n];
            let sizes = &mut s.sizes_of_chunk[..n];
            sizes.fill(0);
            for filter in &bank.filters {
                keep_strongest(
                    filter,
                    &s.stars[filter.inner * CHUNK..][..n],
                    &s.stars[filter.outer * CHUNK..][..n],
                    best,
                    sizes,
                );
            }
            for (narrow, &wide) in s.sizes[at..][..n].iter_mut().zip(&*sizes) {
                *narrow = wide as u8;
            }
        }
    }
}

/// Sums of stars from the corners of their square and their rhombus.
#[inline(never)] // inlined, the slices may alias for all the compiler knows: no vectors
fn add_stars(square: [&[u32]; 4], rhombus: [&[u32]; 4], out: &mut [i32]) {
    let n = out.len();
    let [s0, s1, s2, s3] = square.map(|row| &row[..n]);
    let [r0, r1, r2, r3] = rhombus.map(|row| &row[..n]);
    for i in 0..n {
        let square = s0[i]
            .wrapping_sub(s1[i])
            .wrapping_sub(s2[i])
            .wrapping_add(s3[i]);
        let rhombus = r0[i]
            .wrapping_sub(r1[i])
            .wrapping_sub(r2[i])
            .wrapping_add(r3[i]);
        out[i] = square.wrapping_add(rhombus).cast_signed();
    }
}

/// The bits of the magnitude of a finite `f32`; ordered like the magnitudes.
const fn magnitude(bits: u32) -> i32 {
    (bits & 0x7FFF_FFFF).cast_signed()
}

/// Replaces the responses (and sizes) whose magnitude `filter` exceeds.
#[inline(never)] // inlined, the slices may alias for all the compiler knows: no vectors
fn keep_strongest(
    filter: &Filter,
    inner: &[i32],
    outer: &[i32],
    best: &mut [f32],
    sizes: &mut [u32],
) {
    let n = best.len();
    let (inner, outer, sizes) = (&inner[..n], &outer[..n], &mut sizes[..n]);
    let size = u32::from(filter.size);
    for i in 0..n {
        let ring = outer[i].wrapping_sub(inner[i]);
        let response = inner[i] as f32 * filter.per_inner - ring as f32 * filter.per_ring;
        // Magnitudes compare as their bits do, and a choice by mask needs no branch: this is what makes
        // the loop a vector loop.
        let (new, old) = (response.to_bits(), best[i].to_bits());
        let stronger = magnitude(new) > magnitude(old);
        let mask = u32::from(stronger).wrapping_neg();
        best[i] = f32::from_bits(new & mask | old & !mask);
        sizes[i] = size & mask | sizes[i] & !mask;
    }
}

/// The responses and sizes of an image, to be searched for keypoints.
struct Field<'a> {
    width: usize,
    height: usize,
    border: usize,
    responses: &'a [f32],
    sizes: &'a [u8],
    largest: u8,
    params: StarParams,
}

impl Field<'_> {
    /// Appends every keypoint, tile by tile.
    fn extrema(
        &self,
        column_max: &mut Vec<f32>,
        column_min: &mut Vec<f32>,
        keypoints: &mut Vec<Keypoint>,
    ) {
        let reach = usize::from(self.params.suppress_nonmax_size) / 2;
        let threshold = f32::from(self.params.response_threshold);
        let (left, right) = (self.border, self.width - self.border);
        let bottom = self.height - self.border;
        for top in (self.border..bottom).step_by(reach + 1) {
            let rows = top..(top + reach + 1).min(bottom);
            self.column_extremes(rows.clone(), column_max, column_min);
            for first in (left..right).step_by(reach + 1) {
                let columns = first..(first + reach + 1).min(right);
                let within = columns.start - left..columns.end - left;
                let highest = column_max[within.clone()]
                    .iter()
                    .copied()
                    .fold(threshold, f32::max);
                let lowest = column_min[within]
                    .iter()
                    .copied()
                    .fold(-threshold, f32::min);
                for (value, bright) in [(highest, true), (lowest, false)] {
                    if value.abs() <= threshold {
                        continue;
                    }
                    // The cheapest question first: most extrema are of the smallest size.
                    if let Some((x, y)) = self.find(value, columns.clone(), rows.clone())
                        && self.has_size_that_counts(x, y)
                        && self.is_alone(x, y, reach, bright)
                        && !self.is_on_line(x, y)
                    {
                        keypoints.push(Keypoint {
                            x: x as f32,
                            y: y as f32,
                            size: f32::from(self.sizes[y * self.width + x]),
                            response: highest,
                        });
                    }
                }
            }
        }
    }

    /// The largest and smallest response of each column inside the border, over `rows`.
    fn column_extremes(
        &self,
        rows: std::ops::Range<usize>,
        column_max: &mut Vec<f32>,
        column_min: &mut Vec<f32>,
    ) {
        let n = self.width - 2 * self.border;
        column_max.clear();
        column_max.resize(n, f32::NEG_INFINITY);
        column_min.clear();
        column_min.resize(n, f32::INFINITY);
        for y in rows {
            let row = &self.responses[y * self.width + self.border..][..n];
            for i in 0..n {
                let value = row[i];
                column_max[i] = if value > column_max[i] {
                    value
                } else {
                    column_max[i]
                };
                column_min[i] = if value < column_min[i] {
                    value
                } else {
                    column_min[i]
                };
            }
        }
    }

    /// The first pixel with this response, row by row.
    fn find(
        &self,
        value: f32,
        columns: std::ops::Range<usize>,
        rows: std::ops::Range<usize>,
    ) -> Option<(usize, usize)> {
        for y in rows {
            let row = &self.responses[y * self.width..][columns.clone()];
            if let Some(i) = row.iter().position(|&response| response == value) {
                return Some((columns.start + i, y));
            }
        }
        None
    }

    /// Whether no other response within `reach` px is as extreme as the one at (`x`, `y`).
    fn is_alone(&self, x: usize, y: usize, reach: usize, bright: bool) -> bool {
        let value = self.responses[y * self.width + x];
        let mut as_extreme = 0;
        for row in y - reach..=y + reach {
            let row = &self.responses[row * self.width + x - reach..][..=2 * reach];
            as_extreme += row
                .iter()
                .filter(|&&other| {
                    if bright {
                        other >= value
                    } else {
                        other <= value
                    }
                })
                .count();
            if as_extreme > 1 {
                return false;
            }
        }
        true
    }

    /// Whether keypoints may have the size of (`x`, `y`).
    fn has_size_that_counts(&self, x: usize, y: usize) -> bool {
        let size = self.sizes[y * self.width + x];
        size >= 4 && size < self.largest
    }

    fn is_on_line(&self, x: usize, y: usize) -> bool {
        let size = self.sizes[y * self.width + x];
        self.is_on_line_of_sizes(x, y, size) || self.is_on_line_of_responses(x, y, size)
    }

    /// Index of the upper-left of the 9x9 samples around (`x`, `y`), and their spacing.
    fn samples(&self, x: usize, y: usize, size: u8) -> (usize, usize) {
        let spacing = usize::from(size / 4);
        ((y - 4 * spacing) * self.width + x - 4 * spacing, spacing)
    }

    /// The line test on the gradient of the responses. The sums are taken row by row from left to
    /// right, since another order would round differently.
    fn is_on_line_of_responses(&self, x: usize, y: usize, size: u8) -> bool {
        let (first, spacing) = self.samples(x, y, size);
        let (mut lxx, mut lyy, mut lxy) = (0.0_f32, 0.0_f32, 0.0_f32);
        for row in 0..9 {
            let at = first + row * spacing * self.width;
            let here = &self.responses[at - 1..][..8 * spacing + 3];
            let above = &self.responses[at - self.width..][..=8 * spacing];
            let below = &self.responses[at + self.width..][..=8 * spacing];
            for i in (0..=8 * spacing).step_by(spacing) {
                let lx = here[i + 2] - here[i];
                let ly = below[i] - above[i];
                lxx += lx * lx;
                lyy += ly * ly;
                lxy += lx * ly;
            }
        }
        let trace = lxx + lyy;
        let ratio = f32::from(self.params.line_threshold_projected);
        trace * trace >= ratio * (lxx * lyy - lxy * lxy)
    }

    /// The line test on the map of pixels whose strongest filter has the same size.
    fn is_on_line_of_sizes(&self, x: usize, y: usize, size: u8) -> bool {
        let (first, spacing) = self.samples(x, y, size);
        let same = |value: u8| i32::from(value == size);
        let (mut lxx, mut lyy, mut lxy) = (0_i32, 0_i32, 0_i32);
        for row in 0..9 {
            let at = first + row * spacing * self.width;
            let here = &self.sizes[at - 1..][..8 * spacing + 3];
            let above = &self.sizes[at - self.width..][..=8 * spacing];
            let below = &self.sizes[at + self.width..][..=8 * spacing];
            for i in (0..=8 * spacing).step_by(spacing) {
                let lx = same(here[i + 2]) - same(here[i]);
                let ly = same(below[i]) - same(above[i]);
                lxx += lx * lx;
                lyy += ly * ly;
                lxy += lx * ly;
            }
        }
        let trace = lxx + lyy;
        let ratio = i32::from(self.params.line_threshold_binarized);
        trace * trace >= ratio * (lxx * lyy - lxy * lxy)
    }
}
