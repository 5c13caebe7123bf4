//! What did a robot do beside its answers?

use std::time::Duration;

use crate::learn::Learnt;
use crate::map::PlaceKey;
use fremen::error::Error;

/// What happened beside the answers.
#[derive(Debug)]
#[non_exhaustive]
pub enum Event {
    /// An image was learnt, or quarantined if [`Learnt::doubt`] says why, unless
    /// [`Learnt::is_same_visit`] says that it adds nothing.
    Learnt {
        /// The place it was located at.
        place: PlaceKey,
        /// The image, as [`Frame::with_source`](super::Frame::with_source) named it.
        source: String,
        /// What it changed.
        learnt: Learnt,
        /// How long that took.
        took: Duration,
    },
    /// An image was located but could not be learnt.
    NotLearnt {
        /// The image, as [`Frame::with_source`](super::Frame::with_source) named it.
        source: String,
        /// Why.
        error: Error,
    },
    /// An image was located but found the learner busy.
    Missed {
        /// The image, as [`Frame::with_source`](super::Frame::with_source) named it.
        source: String,
    },
    /// What was learnt could not be written; it is tried again when the next commit is due.
    NotCommitted {
        /// Why.
        error: Error,
    },
    /// What was learnt is in the file.
    Committed {
        /// The generation of the file.
        generation: u64,
        /// How long that took.
        took: Duration,
    },
}

/// What a robot has done so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Totals {
    /// Images that were answered.
    pub num_images: usize,
    /// Images that were located at a place.
    pub num_located: usize,
    /// Visits that were learnt.
    pub num_learnt: usize,
    /// Images that belong to a visit that was learnt or quarantined already.
    pub num_same_visit: usize,
    /// Visits that were quarantined.
    pub num_quarantined: usize,
    /// Located images that could not be learnt.
    pub num_not_learnt: usize,
    /// Located images that found the learner busy.
    pub num_missed: usize,
}

/// How long the last image took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Timing {
    /// To find its features.
    pub extract: Duration,
    /// To localise them.
    pub localize: Duration,
}

impl Totals {
    pub(super) fn count(&mut self, event: &Event) {
        match event {
            Event::Learnt { learnt, .. } if learnt.is_same_visit => self.num_same_visit += 1,
            Event::Learnt { learnt, .. } if learnt.doubt.is_some() => self.num_quarantined += 1,
            Event::Learnt { .. } => self.num_learnt += 1,
            Event::NotLearnt { .. } => self.num_not_learnt += 1,
            Event::Missed { .. } => self.num_missed += 1,
            Event::NotCommitted { .. } | Event::Committed { .. } => {}
        }
    }
}
