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
//! A filter of size `s` (2, 4, 6, 8, 12, 16, 22, 32, 46, 64, 90, 128) compares the mean of the star
//! of radius `s / 2` with the mean of the ring around it, up to the star of radius `s`:
//!
//! ```text
//! response_s = star_{s/2} / area_{s/2} - (star_s - star_{s/2}) / (area_s - area_{s/2})
//! ```
//!
//! Each pixel keeps the response of largest magnitude (the smallest size of equal ones) and its
//! size. Sums come from integral images, so that a pixel costs the same for every size: squares
//! from the upright one `S`, rhombi from two sums over cones that open upwards (`-y`), where `A`
//! has one pixel at its tip and `B` has two, `x - 1` and `x`:
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
//! The largest and the smallest response of every tile of `n / 2 + 1` px (`n` =
//! `suppress_nonmax_size`) is a keypoint if it is strictly extreme within `n / 2` px, beyond the
//! threshold, of a size that is neither below 4 nor the largest, and not on a line. Lines are
//! rejected (Agrawal et al., section 3.4: the ratio of principal curvatures) by the second moments
//! of the response's gradient over 9x9 samples that are `size / 4` px apart, `(Lxx + Lyy)^2 >= k
//! (Lxx Lyy - Lxy^2)`, and by the same test on the "is of the same size" map.
//!
//! Deviation from the paper, kept because OpenCV has it and published results rest on it: a minimum
//! (dark blob) carries as its response not its own value but the largest one of its tile, or the
//! threshold, so that over a third of all keypoints share a response.
//!
//! Complexity: O(pixels x sizes); about 12 bytes of integral images and 5 bytes of responses a
//! pixel. Within one and a half times the largest filter size of the image's edge there are no
//! keypoints: 69 px for `max_size` = 45.
//!
//! Not for: subpixel positions, orientations, or images under 140 px a side at the default size.

use super::{GrayView, Keypoint};
use crate::simd::Kernel;
use crate::simd::image::{CentreSurround, ExtremeRule, FilterBank, StarCorners};
use fremen::error::{Error, ErrorKind, Result};

/// Sizes of all filters; each is twice the radius of its centre.
const FILTER_SIZES: [u8; 12] = [2, 4, 6, 8, 12, 16, 22, 32, 46, 64, 90, 128];

/// Columns that are answered from top to bottom before the next ones: what a star of them reaches
/// in the integral images stays in the second-level cache.
const STRIP: usize = 256;

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
        // The window of an extremum must stay inside the image: the smallest border is 9 px, that
        // of the reference recipe 69 px.
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

/// Buffers that grow to the largest image seen and are then reused.
#[derive(Default)]
pub(super) struct StarScratch {
    upright: Vec<u32>,
    one_tip: Vec<u32>,
    two_tips: Vec<u32>,
    zeros: Vec<u32>,
    black: Vec<u8>,
    stars: Vec<StarCorners>,
    filters: Vec<CentreSurround>,
    /// Width, height and border of what `responses` and `sizes` hold; outside the border they are
    /// zero.
    shape: (usize, usize, usize),
    responses: Vec<f32>,
    sizes: Vec<u8>,
    highest: Vec<f32>,
    lowest: Vec<f32>,
    marks: Vec<u8>,
}

/// Replaces `candidates` by all pixels of `image` that are keypoints if they [are not on a
/// line](Field::is_on_line), in no particular order, and returns the responses to look up.
///
/// `params` have passed [`StarParams::check`].
pub(super) fn candidates<'a>(
    image: GrayView<'_>,
    params: StarParams,
    kernel: Kernel,
    scratch: &'a mut StarScratch,
    candidates: &mut Vec<Keypoint>,
) -> Field<'a> {
    candidates.clear();
    let (width, height, border) = (image.width(), image.height(), params.border());
    if width.min(height) > 2 * border {
        integrate(image, kernel, scratch);
        respond(width, height, params, kernel, scratch);
        search(params, kernel, scratch, candidates);
    }
    Field {
        width,
        responses: &scratch.responses,
        sizes: &scratch.sizes,
        params,
    }
}

/// Elements of a row of the three integral images: columns -1 to `width`.
const fn integral_stride(width: usize) -> usize {
    width + 2
}

/// Fills the integral images; row `y + 1` of each belongs to row `y` of the image, row 0 is zero.
///
/// `upright` and `two_tips` store column `x` at `x`, `one_tip` at `x + 1`.
fn integrate(image: GrayView<'_>, kernel: Kernel, scratch: &mut StarScratch) {
    let (width, height) = (image.width(), image.height());
    let stride = integral_stride(width);
    let len = (height + 1) * stride;
    for plane in [
        &mut scratch.upright,
        &mut scratch.one_tip,
        &mut scratch.two_tips,
    ] {
        plane.resize(len, 0);
        plane[..stride].fill(0);
    }
    scratch.zeros.resize(stride, 0);
    scratch.black.resize(width, 0);
    for y in 0..height {
        let pixels = image.row(y);
        let pixels_above = if y == 0 {
            &scratch.black[..width]
        } else {
            image.row(y - 1)
        };
        let this = (y + 1) * stride;

        let (above, row) = scratch.upright.split_at_mut(this);
        kernel.add_prefixes(&above[this - stride..], pixels, &mut row[..=width]);

        let (above, row) = scratch.one_tip.split_at_mut(this);
        let (above_2, above) = two_rows_above(above, stride, &scratch.zeros);
        kernel.add_cones(above, above_2, pixels, pixels_above, &mut row[1..=width]);
        // Beyond the edges, where the image is black, a cone equals its neighbour one row up.
        row[0] = above[1];
        row[width + 1] = above[width];
        let (first, last) = (row[1], row[width]);

        let (above, row) = scratch.two_tips.split_at_mut(this);
        let (above_2, above) = two_rows_above(above, stride, &scratch.zeros);
        kernel.add_cones(above, above_2, &pixels[1..], pixels, &mut row[1..width]);
        // A cone with one of its two tips outside is a cone with one tip.
        row[0] = first;
        row[width] = last;
    }
}

/// The last two rows of a plane; `zeros` where it has only one.
fn two_rows_above<'a>(plane: &'a [u32], stride: usize, zeros: &'a [u32]) -> (&'a [u32], &'a [u32]) {
    let (before, above) = plane.split_at(plane.len() - stride);
    let above_2 = before
        .len()
        .checked_sub(stride)
        .map_or(zeros, |at| &before[at..]);
    (above_2, above)
}

/// The stars and filters in use, for integral images of rows of `stride` elements.
fn fill_bank(
    params: StarParams,
    stride: usize,
    stars: &mut Vec<StarCorners>,
    filters: &mut Vec<CentreSurround>,
) {
    let sizes = params.filters();
    let mut radii = [0; 2 * FILTER_SIZES.len()];
    let radii = &mut radii[..2 * sizes.len()];
    for (pair, &size) in radii.chunks_exact_mut(2).zip(sizes) {
        pair.copy_from_slice(&[usize::from(size) / 2, usize::from(size)]);
    }
    radii.sort_unstable();
    // A radius that occurs twice is summed once: `star_of` finds the first of equal ones.
    let distinct = |at: &usize| *at == 0 || radii[*at] != radii[*at - 1];
    stars.clear();
    stars.extend((0..radii.len()).filter(distinct).map(|at| {
        let stride = stride as isize;
        let r = radii[at] as isize;
        let t = rhombus_radius(radii[at]) as isize;
        StarCorners {
            square: [
                (r + 1) * stride + r + 1,
                (r + 1) * stride - r,
                -r * stride + r + 1,
                -r * stride - r,
            ],
            one_tip: [(t + 1) * stride + 1, -t * stride + 1],
            two_tips: [-t, t + 1],
        }
    }));
    let star_of = |radius: usize| {
        (0..radii.len())
            .filter(distinct)
            .take_while(|&at| radii[at] < radius)
            .count()
    };
    filters.clear();
    filters.extend(sizes.iter().map(|&size| {
        let (inner, outer) = (usize::from(size) / 2, usize::from(size));
        CentreSurround {
            size,
            inner: star_of(inner),
            outer: star_of(outer),
            per_inner: 1.0 / star_area(inner) as f32,
            per_ring: 1.0 / (star_area(outer) - star_area(inner)) as f32,
        }
    }));
}

/// Fills `responses` and `sizes`; both are zero along the border.
fn respond(width: usize, height: usize, params: StarParams, kernel: Kernel, s: &mut StarScratch) {
    let border = params.border();
    if s.shape != (width, height, border) {
        s.responses.clear();
        s.responses.resize(width * height, 0.0);
        s.sizes.clear();
        s.sizes.resize(width * height, 0);
        s.shape = (width, height, border);
    }
    let stride = integral_stride(width);
    fill_bank(params, stride, &mut s.stars, &mut s.filters);
    let bank = FilterBank {
        upright: &s.upright,
        one_tip: &s.one_tip,
        two_tips: &s.two_tips,
        stars: &s.stars,
        filters: &s.filters,
    };
    for x in (border..width - border).step_by(STRIP) {
        let n = STRIP.min(width - border - x);
        for y in border..height - border {
            let at = y * width + x;
            kernel.keep_strongest(
                bank,
                y * stride + x,
                &mut s.responses[at..][..n],
                &mut s.sizes[at..][..n],
            );
        }
    }
}

/// Appends the pixels that are strictly extreme in their window, beyond the threshold and of a size
/// that counts.
///
/// Such a pixel is the only extreme one of its tile, because its window covers the tile.
fn search(params: StarParams, kernel: Kernel, s: &mut StarScratch, candidates: &mut Vec<Keypoint>) {
    let (width, height, border) = s.shape;
    let reach = usize::from(params.suppress_nonmax_size) / 2;
    let n = width - 2 * border;
    let rule = ExtremeRule {
        threshold: f32::from(params.response_threshold),
        min_size: 4,
        end_size: s.filters.last().map_or(0, |filter| filter.size),
    };
    // A ring of the rows of a window, and in front of it a row for their extremes.
    let rows = 2 * reach + 1;
    s.highest.resize((1 + rows) * n, 0.0);
    s.lowest.resize((1 + rows) * n, 0.0);
    s.marks.resize(n, 0);
    let (highest, highest_of_rows) = s.highest.split_at_mut(n);
    let (lowest, lowest_of_rows) = s.lowest.split_at_mut(n);
    let tiles = Tiles {
        width,
        height,
        border,
        side: reach + 1,
        responses: &s.responses,
    };
    for bottom in border - reach..height - border + reach {
        let at = bottom % rows * n;
        kernel.extremes_across(
            &s.responses[bottom * width + border - reach..][..n + 2 * reach],
            reach,
            &mut highest_of_rows[at..][..n],
            &mut lowest_of_rows[at..][..n],
        );
        if bottom < border + reach {
            continue;
        }
        let y = bottom - reach;
        highest.copy_from_slice(&highest_of_rows[..n]);
        lowest.copy_from_slice(&lowest_of_rows[..n]);
        for row in 1..rows {
            let (high, low) = (&highest_of_rows[row * n..], &lowest_of_rows[row * n..]);
            kernel.extremes_along(&high[..n], &low[..n], highest, lowest);
        }
        let first = y * width + border;
        kernel.mark_extremes(
            &s.responses[first..][..n],
            &s.sizes[first..][..n],
            highest,
            lowest,
            rule,
            &mut s.marks[..n],
        );
        for (chunk, marks) in s.marks[..n].chunks(8).enumerate() {
            if marks == [0; 8] {
                continue;
            }
            for (i, _) in marks.iter().enumerate().filter(|&(_, &mark)| mark != 0) {
                let x = border + 8 * chunk + i;
                if is_alone(&s.responses, width, x, y, reach) {
                    let value = s.responses[y * width + x];
                    candidates.push(Keypoint {
                        x: x as f32,
                        y: y as f32,
                        size: f32::from(s.sizes[y * width + x]),
                        response: if value > 0.0 {
                            value
                        } else {
                            tiles.highest(x, y, rule.threshold)
                        },
                    });
                }
            }
        }
    }
}

/// Whether no other response within `reach` px equals the one at (`x`, `y`).
fn is_alone(responses: &[f32], width: usize, x: usize, y: usize, reach: usize) -> bool {
    let value = responses[y * width + x];
    let equal = (y - reach..=y + reach)
        .map(|row| {
            let row = &responses[row * width + x - reach..][..=2 * reach];
            row.iter().filter(|&&other| other == value).count()
        })
        .sum::<usize>();
    equal == 1
}

/// The squares, side by side inside the border, whose highest response a minimum carries.
struct Tiles<'a> {
    width: usize,
    height: usize,
    border: usize,
    side: usize,
    responses: &'a [f32],
}

impl Tiles<'_> {
    /// The highest response of the tile of (`x`, `y`), or `threshold` if none is above.
    fn highest(&self, x: usize, y: usize, threshold: f32) -> f32 {
        let first = |at: usize| at - (at - self.border) % self.side;
        let columns = first(x)..(first(x) + self.side).min(self.width - self.border);
        (first(y)..(first(y) + self.side).min(self.height - self.border))
            .flat_map(|row| &self.responses[row * self.width..][columns.clone()])
            .fold(threshold, |highest, &response| highest.max(response))
    }
}

/// The responses and sizes of an image, to look up whether a candidate is on a line.
pub(super) struct Field<'a> {
    width: usize,
    responses: &'a [f32],
    sizes: &'a [u8],
    params: StarParams,
}

impl Field<'_> {
    /// Whether a candidate is on a line, and so is no keypoint.
    pub(super) fn is_on_line(&self, candidate: &Keypoint) -> bool {
        let (x, y) = (candidate.x as usize, candidate.y as usize);
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
