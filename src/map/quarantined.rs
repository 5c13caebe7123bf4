//! What is known of a visit that was not learnt, and why was it not?

use std::fmt;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::types::{PlaceKey, SessionId, VisitId};
use crate::feature::{Features, GrayImage};
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::Time;

/// Pixels of a mask, at most: as of an image that is decoded.
const MAX_MASK_PIXELS: u64 = 64_000_000;

/// Why a visit was not learnt.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum QuarantineReason {
    /// Too few of the features that were predicted for that time were seen.
    #[serde(rename_all = "kebab-case")]
    Disagreement {
        /// The share of the predicted features that were seen.
        agreement: f64,
        /// The least share that would have been believed.
        threshold: f64,
        /// The median share at the place's past visits.
        expected: f64,
        /// How many features were predicted and could have been seen.
        num_predicted: usize,
        /// Another place of the map that it looks like.
        looks_like: Option<PlaceKey>,
    },
    /// Next to nothing is to be seen: the camera is covered, blinded, or it is dark.
    #[serde(rename_all = "kebab-case")]
    Blind {
        /// Features of the image.
        num_features: usize,
        /// The grey levels that all but the darkest and the brightest hundredth of its pixels lie
        /// between, where known.
        gray_range: Option<(u8, u8)>,
    },
    /// Its time cannot be right.
    #[serde(rename_all = "kebab-case")]
    Clock {
        /// What is wrong with it.
        fault: ClockFault,
        /// By how many seconds it is off: from the machine's clock (positive: ahead of it), or from
        /// the image before.
        off_s: f64,
    },
}

/// What may be wrong with a clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ClockFault {
    /// It was never set: the time is near 1970.
    Unset,
    /// The time has not come yet.
    Future,
    /// It went back within a session.
    Backwards,
    /// It differs from the machine's clock by a whole number of quarters of an hour, as the clock
    /// of another zone does.
    Zone,
}

/// The darkest image whose brightest parts are still black.
const BLACK: u8 = 40;
/// The brightest image whose darkest parts are already white.
const WHITE: u8 = 215;

impl fmt::Display for QuarantineReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Disagreement {
                agreement,
                threshold,
                expected,
                num_predicted,
                looks_like,
            } => {
                write!(
                    f,
                    "{:.1} % of {num_predicted} predicted features were seen, where at least \
                     {:.1} % were expected and {:.1} % are usual",
                    100.0 * agreement,
                    100.0 * threshold,
                    100.0 * expected
                )?;
                match looks_like {
                    Some(place) => write!(f, "; it looks like place `{place}`"),
                    None => Ok(()),
                }
            }
            Self::Blind {
                num_features,
                gray_range,
            } => {
                let what = match gray_range {
                    Some((_, high)) if *high <= BLACK => "the image is black: a covered camera?",
                    Some((low, _)) if *low >= WHITE => "the image is white: a blinded camera?",
                    Some(_) => "the image is flat: a covered camera?",
                    None => "the image is empty: a covered camera?",
                };
                write!(f, "{what} ({num_features} features")?;
                match gray_range {
                    Some((low, high)) => write!(f, ", grey levels {low} to {high})"),
                    None => write!(f, ")"),
                }
            }
            Self::Clock { fault, off_s } => match fault {
                ClockFault::Unset => write!(f, "the clock was never set"),
                ClockFault::Future => write!(f, "the time lies {off_s:.0} s in the future"),
                ClockFault::Backwards => {
                    write!(f, "the clock went back by {:.0} s", off_s.abs())
                }
                ClockFault::Zone => write!(
                    f,
                    "the time is {:+.2} h off the machine's clock, as that of another zone is",
                    off_s / 3_600.0
                ),
            },
        }
    }
}

/// Which pixels of an image could be observed: the lengths of runs, row by row and across the ends
/// of rows; the first run (it may be empty) is hidden, and from then on they alternate.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct MaskRuns(pub(super) Vec<u32>);

impl MaskRuns {
    /// The runs of a mask that is zero where nothing could be observed.
    pub fn of(mask: &GrayImage) -> Self {
        let mut runs = vec![0_u32];
        let mut is_hidden = true;
        for &pixel in mask.data() {
            if (pixel == 0) != is_hidden {
                is_hidden = !is_hidden;
                runs.push(0);
            }
            if let Some(run) = runs.last_mut() {
                *run = run.saturating_add(1);
            }
        }
        Self(runs)
    }

    /// The mask of an image of this size.
    ///
    /// Fails with [`ErrorKind::Format`] if the runs do not cover it.
    pub fn to_mask(&self, (width, height): (u32, u32)) -> Result<GrayImage> {
        let num_pixels = u64::from(width) * u64::from(height);
        let covered: u64 = self.0.iter().map(|&run| u64::from(run)).sum();
        if covered != num_pixels || num_pixels > MAX_MASK_PIXELS {
            return Err(Error::new(
                ErrorKind::Format,
                format!("runs of {covered} px are no mask of {width} x {height} px"),
            ));
        }
        let mut pixels = Vec::with_capacity(num_pixels as usize);
        for (at, &run) in self.0.iter().enumerate() {
            let value = if at.is_multiple_of(2) { 0 } else { 255 };
            pixels.resize(pixels.len() + run as usize, value);
        }
        GrayImage::new(width as usize, height as usize, pixels)
    }
}

/// A visit that waits in quarantine, with all that is needed to learn it.
#[derive(Clone, Debug, PartialEq)]
pub struct QuarantinedVisit {
    /// Where it is said to have been.
    pub place: PlaceKey,
    /// Its identity.
    pub id: VisitId,
    /// The run it belongs to.
    pub session: SessionId,
    /// When the image is said to have been taken.
    pub time: Time,
    /// Where the image came from, for people.
    pub source: String,
    /// Width and height of the image, px.
    pub image_size: (u32, u32),
    /// What of it could be observed, if not all.
    pub mask: Option<Arc<MaskRuns>>,
    /// Whether somebody had said which place it shows, and was not believed.
    pub is_labelled: bool,
    /// Why it is quarantined.
    pub reason: QuarantineReason,
    /// Its features, strongest first.
    pub features: Arc<Features>,
}

impl QuarantinedVisit {
    /// About how much room it takes.
    pub(super) fn num_bytes(&self) -> usize {
        let num_runs = self.mask.as_ref().map_or(0, |mask| mask.0.len());
        1_000
            + 11 * num_runs
            + 6 * (self.source.len() + self.place.as_str().len())
            + 48 * self.features.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mask_is_what_its_runs_say() {
        for pixels in [[0, 0, 7, 0, 255, 255], [1, 1, 1, 1, 1, 1], [0; 6]] {
            let mask = GrayImage::new(3, 2, pixels.to_vec()).expect("as many pixels");
            let again = MaskRuns::of(&mask).to_mask((3, 2)).expect("covered");
            let is_hidden: Vec<bool> = again.data().iter().map(|&pixel| pixel == 0).collect();
            assert_eq!(is_hidden, pixels.map(|pixel| pixel == 0));
        }
        for (runs, size) in [(vec![7], (3, 2)), (vec![u32::MAX, u32::MAX], (u32::MAX, 2))] {
            assert!(MaskRuns(runs.clone()).to_mask(size).is_err(), "{runs:?}");
        }
    }
}
