//! What is one visit: an image of a known place, and what it says of the features there?

use crate::feature::{Features, GrayImage};
use crate::map::{PlaceKey, QuarantineReason, SessionId};
use crate::matching::{Displacement, Match, MatchScratch, VoteScratch};
use fremen::time::Time;
use fremen::visibility::BitRow;

/// One image of a known place.
///
/// More may be said of an image one day, so others make one by [`new`](Self::new).
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Observation<'a> {
    /// Where it was taken.
    pub place: PlaceKey,
    /// The run it belongs to.
    pub session: SessionId,
    /// When it was taken.
    pub time: Time,
    /// Its features, strongest first.
    pub features: &'a Features,
    /// Width and height of the image, px.
    pub image_size: (u32, u32),
    /// Zero where nothing could be observed; of the image's size.
    pub mask: Option<&'a GrayImage>,
    /// Where the image came from, for people.
    pub source: String,
}

impl<'a> Observation<'a> {
    /// An image of `image_size` (width, height; px) that shows these features, strongest first:
    /// without a mask, from nowhere in particular.
    pub fn new(
        place: PlaceKey,
        session: SessionId,
        time: Time,
        features: &'a Features,
        image_size: (u32, u32),
    ) -> Self {
        Self {
            place,
            session,
            time,
            features,
            image_size,
            mask: None,
            source: String::new(),
        }
    }

    /// Where something could be observed: zero where nothing could; of the image's size.
    #[must_use]
    pub fn with_mask(mut self, mask: &'a GrayImage) -> Self {
        self.mask = Some(mask);
        self
    }

    /// Where the image came from, for people.
    #[must_use]
    pub fn with_source(mut self, source: impl Into<String>) -> Self {
        self.source = source.into();
        self
    }
}

/// What a visit changed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Learnt {
    /// Features of the place that were seen again.
    pub num_seen: usize,
    /// Features that were born.
    pub num_born: usize,
    /// Whether its appearance became an experience.
    pub experience: bool,
    /// Why it was held instead; nothing else changed then.
    pub doubt: Option<QuarantineReason>,
    /// Whether it belongs to a visit that was learnt, or is held, already: nothing has changed.
    pub is_same_visit: bool,
    /// Features and visits that were forgotten to keep to the budget: the map does not extend its
    /// past then, and is stored by [`Map::replace`](crate::map::Map::replace).
    pub num_forgotten: usize,
    /// Visits held longer ago whose features had to go for this one: they cannot be accepted any
    /// more ([`Quarantine::given_up`](crate::map::Quarantine::given_up)).
    pub num_given_up: usize,
}

/// What one image says about the features of its place.
pub(super) struct Found {
    /// Live features that the place did not have, in its frame.
    pub(super) born: Features,
    /// One bit for each feature known before, then one for each born now.
    pub(super) seen: BitRow,
    /// As long, where something could not be observed.
    pub(super) hidden: Option<BitRow>,
    /// How the camera moved against the place's frame, where that was recognised.
    pub(super) displacement: Option<Displacement>,
    /// Of each feature that was seen again: the distance between its descriptor and the live one,
    /// bits.
    pub(super) distances: Vec<u16>,
}

/// Memory to work in.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    pub(super) matching: MatchScratch,
    pub(super) matches: Vec<Match>,
    pub(super) displacements: Vec<Displacement>,
    pub(super) vote: VoteScratch,
    pub(super) p: Vec<f64>,
}
