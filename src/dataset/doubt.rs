//! What speaks against an image of a dataset, before it is learnt?
//!
//! A robot's map doubts what it learns ([`Learner`](crate::learn::Learner)); images that somebody
//! has put into a folder are doubted alike, as far as that needs no map:
//!
//! - its time: before 2000, when no camera's clock was right, or after the present. Of a dataset
//!   most of whose times are like that nothing is said: it counts time in its own way, or this
//!   machine's clock is wrong;
//! - its size: one map has images of one size, that of the manifest or else of most images, not
//!   that of the first one; those of its shape are scaled to it, others are left out;
//! - what there is to see: an image with hardly a feature is black, covered or blurred.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::adjusted::{adjusted, scale_between};
use super::types::{Clock, Dataset, Entry, Problem};
use crate::feature::{Extractor, GrayImage, LoadOptions};
use fremen::error::Result;
use fremen::time::Time;

/// No camera's clock was right before 2000-01-01: it was never set.
const FIRST_TIME: Time = Time::from_s(946_684_800);
/// Clocks that agree this well are the same, s.
const SAME_CLOCK_S: f64 = 120.0;
/// Grey levels this near to each other are one.
const FLAT_LEVELS: u8 = 8;
/// All levels of a dark image lie below this.
const DARK_LEVEL: u8 = 32;
/// An image with a side shorter than this has room for hardly a feature, px: STAR finds none within
/// 69 px of its edge.
const SMALL_SIDE: u32 = 160;

/// Such images are enlarged until their shorter side has so many px at least ...
const ENLARGED_SIDE: u32 = 240;
/// ... but no further: what is smaller yet shows nothing.
const MAX_ENLARGEMENT: u32 = 8;

/// Columns and rows, px.
type Size = (u32, u32);

impl Dataset {
    /// Moves the entries whose time (if it is known what time it is) or size cannot be right to the
    /// problems, and has those scaled whose images only have another resolution; `size` is what
    /// images must have, if that is known. Gives the size that is left, and how many are scaled.
    ///
    /// Sizes are read from the files' headers. O(entries).
    pub fn set_aside(
        &mut self,
        now: Option<Time>,
        size: Option<(u32, u32)>,
    ) -> (Option<(u32, u32)>, usize) {
        self.set_aside_growing(now, size, false)
    }

    /// [`set_aside`](Self::set_aside); where no size is known, images that are too small for features
    /// may grow, all alike.
    pub(crate) fn set_aside_growing(
        &mut self,
        now: Option<Time>,
        size: Option<(u32, u32)>,
        may_grow: bool,
    ) -> (Option<(u32, u32)>, usize) {
        let sizes = self.sizes();
        let usual = size.or_else(|| {
            let found = (self.image_size).or_else(|| most_common(sizes.iter().flatten()))?;
            Some(times(found, if may_grow { enlargement(found) } else { 1 }))
        });
        let doubts = self.doubts(now, &sizes, usual);
        let entries = std::mem::take(&mut self.entries);
        let mut num_scaled = 0;
        for ((mut entry, doubt), size) in entries.into_iter().zip(doubts).zip(sizes) {
            if let Some(message) = doubt {
                self.problems.push(problem_of(&entry, message));
                continue;
            }
            let scale = size.zip(usual).filter(|(size, usual)| size != usual);
            if let Some(scale) = scale.and_then(|(size, usual)| scale_between(size, usual)) {
                let options = LoadOptions::default().with_scale(scale);
                entry.source = adjusted(entry.source, options);
                num_scaled += 1;
            }
            self.entries.push(entry);
        }
        (usual, num_scaled)
    }

    /// Of every entry the size that its file's header says, where it can be read.
    pub(super) fn sizes(&self) -> Vec<Option<Size>> {
        (self.entries.par_iter())
            .map(|entry| entry.source.size().ok().flatten())
            .collect()
    }

    /// What speaks against each entry, by its time and its size.
    pub(super) fn doubts(
        &self,
        now: Option<Time>,
        sizes: &[Option<Size>],
        usual: Option<Size>,
    ) -> Vec<Option<String>> {
        let clocks = now.map(|now| Clocks::of(self, now));
        (self.entries.iter().zip(sizes))
            .map(|(entry, size)| {
                let size = size
                    .zip(usual)
                    .and_then(|(size, usual)| size_doubt(size, usual));
                let clock = clocks.as_ref().and_then(|clocks| clocks.doubt(entry.time));
                clock.or(size)
            })
            .collect()
    }
}

/// By which whole number images of this size are enlarged, so that they have room for features.
pub(super) fn enlargement((width, height): Size) -> u32 {
    let side = width.min(height).max(1);
    match ENLARGED_SIDE.div_ceil(side) {
        factor if side < SMALL_SIDE && factor <= MAX_ENLARGEMENT => factor,
        _ => 1,
    }
}

fn times((width, height): Size, factor: u32) -> Size {
    (width.saturating_mul(factor), height.saturating_mul(factor))
}

/// What is said of one entry.
pub(super) fn problem_of(entry: &Entry, message: impl Into<String>) -> Problem {
    let problem = Problem::new(&entry.id, message);
    match entry.source.path() {
        Some(path) => problem.with_file(path),
        None => problem,
    }
}

/// Which times of a dataset can be doubted.
struct Clocks {
    now: Time,
    doubts_early: bool,
    doubts_late: bool,
}

impl Clocks {
    fn of(dataset: &Dataset, now: Time) -> Self {
        let is_most = |test: &dyn Fn(Time) -> bool| {
            let count = dataset.entries.iter().filter(|it| test(it.time)).count();
            2 * count > dataset.entries.len()
        };
        let is_clock = dataset.clock == Clock::Real;
        Self {
            now,
            doubts_early: is_clock && !is_most(&|time| time < FIRST_TIME),
            doubts_late: is_clock
                && now >= FIRST_TIME
                && !is_most(&|time| time.since_s(now) > SAME_CLOCK_S),
        }
    }

    fn doubt(&self, time: Time) -> Option<String> {
        if self.doubts_early && time < FIRST_TIME {
            return Some(format!(
                "its time {time} is before 2000: that clock was never set (help: correct the time, \
                 or remove the image)"
            ));
        }
        (self.doubts_late && time.since_s(self.now) > SAME_CLOCK_S).then(|| {
            format!(
                "its time {time} lies in the future (help: correct the time, or this machine's \
                 clock, which says {})",
                self.now
            )
        })
    }
}

/// What speaks against an image of this size among images of another one.
fn size_doubt(size: Size, usual: Size) -> Option<String> {
    (size != usual && scale_between(size, usual).is_none()).then(|| {
        format!(
            "the image has {} x {} px, but the map's images have {} x {} px (help: turn, crop or \
             scale it to that size, or make a map of its own for this camera)",
            size.0, size.1, usual.0, usual.1
        )
    })
}

/// The size that most images have; of several the one that comes first.
pub(super) fn most_common<'a>(sizes: impl Iterator<Item = &'a Size>) -> Option<Size> {
    let mut counts: BTreeMap<Size, (usize, std::cmp::Reverse<usize>)> = BTreeMap::new();
    for (position, &size) in sizes.enumerate() {
        let first = std::cmp::Reverse(position);
        counts.entry(size).or_insert((0, first)).0 += 1;
    }
    (counts.into_iter())
        .max_by_key(|&(_, rank)| rank)
        .map(|(size, _)| size)
}

/// Why hardly anything can be seen in an image of this size with so few features, and what helps, if
/// it has fewer than wanted.
#[must_use]
pub fn blindness(
    num_features: usize,
    min_features: usize,
    gray_range: Option<(u8, u8)>,
    (width, height): (u32, u32),
) -> Option<String> {
    if num_features >= min_features {
        return None;
    }
    let (looks, help) = match gray_range {
        None => ("it is hidden by its mask", "see what the mask covers"),
        Some((_, high)) if high < DARK_LEVEL => (
            "it is dark, or the lens is covered",
            "remove it, or see what the camera does",
        ),
        Some((low, high)) if high - low < FLAT_LEVELS => (
            "it is of one grey",
            "remove it, or see what the camera does",
        ),
        Some(_) if width.min(height) < SMALL_SIDE => (
            "it is very small",
            "enlarge all images alike, such as with --scale 2, or take larger ones",
        ),
        Some(_) => (
            "it is blurred or covered",
            "remove it, or see what the camera does",
        ),
    };
    Some(format!(
        "{num_features} features, fewer than {min_features}; {looks} (help: {help})"
    ))
}

/// [`blindness`] of an image that was to be learnt.
#[must_use]
pub fn blind_doubt(
    num_features: usize,
    min_features: usize,
    gray_range: Option<(u8, u8)>,
    size: (u32, u32),
) -> Option<String> {
    let blindness = blindness(num_features, min_features, gray_range, size)?;
    Some(format!("nothing to learn: {blindness}"))
}

/// [`blind_doubt`] of an image, which is enlarged as it would be to be learnt.
pub(super) fn look(
    image: &GrayImage,
    mask: Option<&GrayImage>,
    extractor: &dyn Extractor,
    min_features: usize,
) -> Result<Option<String>> {
    let factor = if needs_room(extractor) {
        enlargement(image.size())
    } else {
        1
    };
    let features = if factor > 1 {
        let options = LoadOptions::default().with_scale(f64::from(factor));
        let mask = mask.map(|mask| options.apply_to_mask(mask.clone()));
        let mask = mask.transpose()?;
        extractor.extract(&options.apply(image.clone())?, mask.as_ref())?
    } else {
        extractor.extract(image, mask)?
    };
    let range = image.gray_range(mask);
    let size = times(image.size(), factor);
    Ok(blind_doubt(features.len(), min_features, range, size))
}

/// Whether an extractor finds nothing in small images; a network sees all at one size.
pub(crate) fn needs_room(extractor: &dyn Extractor) -> bool {
    extractor.id().split(':').next() != Some("onnx")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_images_grow_until_there_is_room_for_features() {
        for (size, factor) in [
            ((160, 120), 2),
            ((120, 160), 2),
            ((64, 48), 5),
            ((100, 4_000), 3),
            ((320, 159), 2),
            ((320, 160), 1),
            ((640, 480), 1),
            ((30, 30), 8),
            ((29, 40), 1),
            ((0, 0), 1),
        ] {
            assert_eq!(enlargement(size), factor, "{size:?}");
        }
    }

    #[test]
    fn most_images_decide_and_not_the_first() {
        let (upright, wide) = ((120, 160), (160, 120));
        assert_eq!(most_common([upright, wide, wide].iter()), Some(wide));
        assert_eq!(most_common([upright, wide].iter()), Some(upright));
        assert_eq!(most_common([].iter()), None);
    }

    #[test]
    fn what_cannot_be_seen_says_what_it_looks_like() {
        assert_eq!(blind_doubt(10, 10, Some((0, 255)), (640, 480)), None);
        for (range, size, words) in [
            (Some((0, 9)), (160, 120), "dark"),
            (Some((100, 104)), (640, 480), "one grey"),
            (Some((40, 200)), (640, 480), "blurred"),
            (Some((40, 200)), (160, 120), "--scale 2"),
            (None, (640, 480), "mask"),
        ] {
            let doubt = blind_doubt(3, 10, range, size).expect("too few");
            assert!(doubt.contains(words) && doubt.contains("help:"), "{doubt}");
        }
    }
}
