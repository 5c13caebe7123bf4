//! What is worth remembering of this visit?
//!
//! A [`Learner`] takes one [`Observation`] after another (an image's features with their place and
//! time) and keeps a map: the features of each place, the log of which was seen when, and the
//! appearances the experience methods need. [`Learner::snapshot`] gives an immutable state to localise
//! with. Two recipes ([`Recipe`]):
//!
//! - `online` (preset `default`): each feature of the place takes its nearest live feature; the pairs
//!   that agree on one displacement were seen, live features that were not matched are born. A visit
//!   costs O(features of the place), whatever its history.
//! - `reference` (preset `lttl`): a live feature is born if the ratio test fails both ways; visibility
//!   is found afterwards by looking for every feature of the place in every image of it. Every image is
//!   kept, and the log is written when a snapshot is asked for.
//!
//! `Deviation:` the reference's pruning is left out, because it hands descriptors of removed features
//! to others.
//!
//! Experiences (T-RO 2017 VII-A after Churchill & Newman): an appearance becomes an experience of its
//! place if the experiences so far, of all places, do not locate it there. For FreEx, each visit also
//! logs which experiences of its place would have located it by themselves.
//!
//! Not for: deciding whether a visit should be believed, or what to forget.

mod config;
mod merge;
mod online;
mod reference;

use std::sync::Arc;

pub use config::{KeepAppearances, LearnConfig, Recipe};
pub use merge::{merge, relearn};

use crate::error::{Error, ErrorKind, Result};
use crate::feature::{Features, FeaturesView, GrayImage};
use crate::localize::Score;
use crate::map::{
    AppearanceUse, MapMeta, Node, PlaceKey, Reobservation, SessionId, Snapshot, Visit, VisitId,
    features_digest,
};
use crate::matching::{
    Displacement, Match, MatchScratch, Matcher, VoteScratch, displacements_into, vote_displacement,
};
use crate::time::Time;
use crate::visibility::BitRow;

/// One image of a known place.
#[derive(Clone, Debug)]
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

/// What a visit changed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Learnt {
    /// Features of the place that were seen again.
    pub num_seen: usize,
    /// Features that were born.
    pub num_born: usize,
    /// Whether its appearance became an experience.
    pub experience: bool,
}

/// Learns a map, visit by visit.
#[derive(Debug)]
pub struct Learner {
    cfg: LearnConfig,
    snapshot: Snapshot,
    /// Places of the reference recipe whose log is older than their visits.
    stale: Vec<bool>,
    reobserve: Matcher,
    experience: Matcher,
    reobservation: Reobservation,
    scratch: Scratch,
}

/// What one image says about the features of its place.
struct Found {
    /// Live features that the place did not have, in its frame.
    born: Features,
    /// One bit for each feature known before, then one for each born now.
    seen: BitRow,
    /// As long, where something could not be observed.
    hidden: Option<BitRow>,
    /// How the camera moved against the place's frame, where that was recognised.
    displacement: Option<Displacement>,
    /// Of each feature that was seen again: the distance between its descriptor and the live one, bits.
    distances: Vec<u16>,
}

/// Memory to work in.
#[derive(Debug, Default)]
struct Scratch {
    matching: MatchScratch,
    matches: Vec<Match>,
    displacements: Vec<Displacement>,
    vote: VoteScratch,
}

impl Learner {
    /// Starts an empty map.
    pub fn new(cfg: LearnConfig, meta: MapMeta) -> Self {
        Self::with(cfg, Snapshot::empty(meta), Reobservation::default())
    }

    /// Goes on with a map that was learnt with the same configuration.
    ///
    /// Fails with [`ErrorKind::Format`] if what the map knows of features seen again cannot be read.
    pub fn resume(cfg: LearnConfig, snapshot: Snapshot) -> Result<Self> {
        let reobservation = Reobservation::of(&snapshot)?;
        Ok(Self::with(cfg, snapshot, reobservation))
    }

    fn with(cfg: LearnConfig, snapshot: Snapshot, reobservation: Reobservation) -> Self {
        Self {
            reobservation,
            stale: vec![false; snapshot.nodes.len()],
            reobserve: Matcher::new(cfg.reobserve().clone()),
            experience: Matcher::new(cfg.experience().matching().clone()),
            cfg,
            snapshot,
            scratch: Scratch::default(),
        }
    }

    /// The configuration.
    pub fn cfg(&self) -> &LearnConfig {
        &self.cfg
    }

    /// Learns one visit.
    ///
    /// Fails, and changes nothing, with [`ErrorKind::Shape`] if the image or its mask has another size
    /// than the map's images, and with [`ErrorKind::Config`] if the very same visit was learnt before.
    pub fn observe(&mut self, observation: &Observation<'_>) -> Result<Learnt> {
        let visit = self.check(observation)?;
        let mut features = observation.features.clone();
        features.truncate(self.cfg.features_per_visit());
        let index = self.node_index(&observation.place);
        let (located_by, is_experience) = self.recall(index, features.view());
        let node = Arc::make_mut(&mut self.snapshot.nodes[index]);
        let found = match self.cfg.recipe() {
            Recipe::Online => online::find(
                &self.cfg,
                &self.reobserve,
                &mut self.scratch,
                node.features.view(),
                observation,
                &features,
            ),
            Recipe::Reference => {
                self.stale[index] = true;
                reference::find(&self.cfg, node.features.view(), &features)
            }
        };
        let learnt = Learnt {
            num_seen: found.seen.count_ones() - found.born.len(),
            num_born: found.born.len(),
            experience: is_experience,
        };
        let keep = match (self.cfg.recipe(), self.cfg.keep_appearances()) {
            // The reference recipe looks at every image again.
            (Recipe::Reference, _) | (_, KeepAppearances::All) => true,
            (_, KeepAppearances::Experiences) => is_experience,
            (_, KeepAppearances::None) => false,
        };
        let visit = Visit {
            appearance: keep.then(|| Arc::new(features)),
            appearance_use: if is_experience {
                AppearanceUse::Experience
            } else {
                AppearanceUse::Recognised
            },
            ..visit
        };
        node.push_visit(visit, &found.born, found.seen, found.hidden, located_by)?;
        if let Some(displacement) = found.displacement {
            (self.reobservation).count_displacement(displacement.dx_px, displacement.dy_px);
            for distance_bits in found.distances {
                self.reobservation.count_distance(distance_bits);
            }
        }
        self.snapshot.meta.image_size = Some(observation.image_size);
        Ok(learnt)
    }

    /// The map as learnt so far.
    pub fn snapshot(&mut self) -> Result<Arc<Snapshot>> {
        for (node, stale) in self.snapshot.nodes.iter_mut().zip(&mut self.stale) {
            if std::mem::take(stale) {
                reference::write_log(&self.cfg, Arc::make_mut(node))?;
            }
        }
        if self.reobservation != Reobservation::default() {
            self.reobservation.attach(&mut self.snapshot);
        }
        Ok(Arc::new(self.snapshot.clone()))
    }

    /// The visit without its appearance, if it fits the map.
    fn check(&self, observation: &Observation<'_>) -> Result<Visit> {
        let (width, height) = observation.image_size;
        if let Some(map) = self.snapshot.meta.image_size
            && map != observation.image_size
        {
            return Err(Error::new(
                ErrorKind::Shape,
                format!(
                    "the image has {width} x {height} px, but the map is learnt from {} x {} px",
                    map.0, map.1
                ),
            )
            .with_path(&observation.source)
            .with_help("crop or scale all images of a map to one size"));
        }
        if let Some(mask) = observation.mask
            && (mask.width(), mask.height()) != (width as usize, height as usize)
        {
            return Err(Error::new(
                ErrorKind::Shape,
                format!(
                    "a mask of {} x {} px does not cover an image of {width} x {height} px",
                    mask.width(),
                    mask.height()
                ),
            )
            .with_path(&observation.source));
        }
        let id = VisitId::derive(
            observation.session,
            &observation.place,
            observation.time,
            &features_digest(observation.features),
        );
        let known = self
            .snapshot
            .find(&observation.place)
            .is_some_and(|node| self.snapshot.node(node).visits.iter().any(|v| v.id == id));
        if known {
            return Err(Error::new(
                ErrorKind::Config,
                format!(
                    "place `{}` has learnt this visit at {} before",
                    observation.place, observation.time
                ),
            )
            .with_path(&observation.source)
            .with_help("leave the image out, or give it the time it was really taken at"));
        }
        Ok(Visit {
            id,
            session: observation.session,
            time: observation.time,
            source: observation.source.clone(),
            appearance: None,
            appearance_use: AppearanceUse::Recognised,
        })
    }

    /// The position of a place, which is made if it is new.
    fn node_index(&mut self, place: &PlaceKey) -> usize {
        if let Some(id) = self.snapshot.find(place) {
            return id.0 as usize;
        }
        self.snapshot.nodes.push(Arc::new(Node::new(place.clone())));
        self.stale.push(false);
        self.snapshot.nodes.len() - 1
    }

    /// Localises an image by the experiences so far: a bit for each experience of its own place, one
    /// if it scores higher than every experience of the other places, and a last bit for the image
    /// itself where none does and it becomes one.
    fn recall(&mut self, own: usize, live: FeaturesView<'_>) -> (BitRow, bool) {
        let remembers = self.cfg.keep_appearances() != KeepAppearances::None
            || self.cfg.recipe() == Recipe::Reference;
        if !remembers {
            let row = self.snapshot.nodes[own].unlocated(AppearanceUse::Recognised);
            return (row, false);
        }
        let mut best_other = self.cfg.experience().min_score().max(1) - 1;
        let mut own_scores = Vec::new();
        for (index, node) in self.snapshot.nodes.iter().enumerate() {
            let experiences = (node.visits.iter())
                .filter(|visit| visit.appearance_use == AppearanceUse::Experience);
            for visit in experiences {
                // An experience whose appearance was dropped locates nothing.
                let score = visit.appearance.as_ref().map_or(0, |appearance| {
                    let view = appearance.view().prefix(self.cfg.experience_features());
                    (self.scratch).score(&self.experience, &self.cfg, view, live)
                });
                if index == own {
                    own_scores.push(score);
                } else {
                    best_other = best_other.max(score);
                }
            }
        }
        let located = own_scores.iter().any(|&score| score > best_other);
        let mut row = BitRow::zeros(own_scores.len() + usize::from(!located));
        for (experience, &score) in own_scores.iter().enumerate() {
            if score > best_other {
                row.set(experience);
            }
        }
        if !located {
            row.set(own_scores.len());
        }
        (row, !located)
    }
}

impl Scratch {
    /// What one appearance scores for a live image.
    fn score(
        &mut self,
        matcher: &Matcher,
        cfg: &LearnConfig,
        map: FeaturesView<'_>,
        live: FeaturesView<'_>,
    ) -> u32 {
        matcher.matches_into(&mut self.matching, map, live, &mut self.matches);
        match cfg.experience().score() {
            Score::Count => self.matches.len() as u32,
            // Refused by the configuration: there is nothing to calibrate with while the map is made.
            Score::Inliers | Score::Likelihood => {
                displacements_into(
                    &self.matches,
                    map.keypoints,
                    live.keypoints,
                    &mut self.displacements,
                );
                vote_displacement(cfg.experience().vote(), &mut self.vote, &self.displacements)
                    .num_inliers
            }
        }
    }
}
