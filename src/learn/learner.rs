//! How does one visit change what is remembered?

use std::sync::Arc;

use super::budget::{self, Room};
use super::config::{KeepAppearances, LearnConfig, Recipe};
use super::expectation::Expectations;
use super::guard::{Circumstances, Guard, contradicts};
use super::guard_config::{ClockPolicy, Judge};
use super::stay::{Part, Stays};
use super::visit::{Found, Learnt, Observation, Scratch};
use super::{online, reference};
use crate::feature::{Features, FeaturesView, GrayImage};
use crate::localize::Score;
use crate::map::{
    AppearanceUse, MAX_TEXT_BYTES, MapMeta, MaskRuns, Node, PlaceKey, Quarantine, QuarantineReason,
    QuarantinedVisit, Reobservation, SessionId, Snapshot, Visit, VisitId, features_digest,
};
use crate::matching::{Matcher, displacements_into, vote_displacement};
use fremen::error::{Error, ErrorKind, Result};
use fremen::visibility::BitRow;

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
    held: Quarantine,
    /// Whether that is more or less than what the snapshot has of them: it may be megabytes.
    held_has_changed: bool,
    /// `None` where visits are not judged.
    guard: Option<Guard>,
    expectations: Expectations,
    stays: Stays,
    /// Bytes of each place, where they are bounded.
    num_bytes: Vec<usize>,
    scratch: Scratch,
}

impl Learner {
    /// Starts an empty map. Its visits are judged only with [`Judge::Always`].
    pub fn new(cfg: LearnConfig, meta: MapMeta) -> Self {
        let reobservation = Reobservation::new(meta.uuid);
        let snapshot = Snapshot::empty(meta);
        Self::with(
            cfg.for_building(),
            snapshot,
            reobservation,
            Quarantine::default(),
        )
    }

    /// Goes on with a map that was learnt with the same configuration.
    ///
    /// Fails with [`ErrorKind::Format`] if what the map knows of features seen again, or the visits
    /// that it holds, cannot be read.
    pub fn resume(cfg: LearnConfig, snapshot: Snapshot) -> Result<Self> {
        let reobservation = Reobservation::of(&snapshot)?;
        let held = Quarantine::of(&snapshot)?;
        Ok(Self::with(cfg, snapshot, reobservation, held))
    }

    fn with(
        cfg: LearnConfig,
        snapshot: Snapshot,
        reobservation: Reobservation,
        held: Quarantine,
    ) -> Self {
        let num_bytes = if cfg.budget().bytes().is_some() {
            snapshot
                .nodes()
                .iter()
                .map(|node| node.num_bytes())
                .collect()
        } else {
            Vec::new()
        };
        Self {
            num_bytes,
            reobservation,
            held,
            held_has_changed: false,
            guard: (cfg.guard().judge() != Judge::Never).then(Guard::default),
            expectations: Expectations::default(),
            stays: Stays::new(match cfg.recipe() {
                Recipe::Online => cfg.stay_gap_s(),
                Recipe::Reference => 0,
            }),
            stale: vec![false; snapshot.nodes().len()],
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

    /// The visits that wait to be accepted or rejected.
    pub fn held(&self) -> &Quarantine {
        &self.held
    }

    /// Goes on with the stays that another learner of the same places has followed: what comes next
    /// may be of a visit that it has learnt.
    pub fn follow_stays_of(&mut self, other: &Self) {
        self.stays.follow(&other.stays);
    }

    /// Learns one visit, or holds it if it is doubtful ([`GuardConfig`](super::GuardConfig)). An
    /// image of a visit that is under way changes nothing: [`Learnt::is_same_visit`] says so.
    ///
    /// Fails, and changes nothing, with [`ErrorKind::Shape`] if the image or its mask has another
    /// size than the map's images, with [`ErrorKind::AlreadyExists`] if the very same visit was
    /// learnt before, and with [`ErrorKind::Time`] if its time cannot be right and
    /// [`ClockPolicy::Refuse`] is set.
    pub fn observe(&mut self, observation: &Observation<'_>) -> Result<Learnt> {
        self.observe_under(observation, &Circumstances::default())
    }

    /// [`observe`](Self::observe) with what is known of how the image came in.
    pub fn observe_under(
        &mut self,
        observation: &Observation<'_>,
        circumstances: &Circumstances,
    ) -> Result<Learnt> {
        let visit = self.check(observation)?;
        // What was not believed is not judged again, whoever brings it, unless somebody has said
        // since which place it shows.
        let held = self.held.find(visit.id).filter(|_| self.guard.is_some());
        let is_held = held.is_some();
        if let Some(held) = held
            && (held.is_labelled || !circumstances.is_labelled)
        {
            return Ok(Learnt {
                doubt: Some(held.reason.clone()),
                is_same_visit: true,
                ..Learnt::default()
            });
        }
        let mut features = observation.features.clone();
        features.truncate(self.cfg.features_per_visit());
        let (doubt, agreement) = self.judge(observation, &features, circumstances)?;
        let is_same_visit = self.is_same_visit(observation, &features, doubt.is_some());
        if is_same_visit {
            return Ok(Learnt {
                doubt,
                is_same_visit,
                ..Learnt::default()
            });
        }
        if is_held {
            // It is learnt now, or held with what is said of it now.
            self.take_held(visit.id)?;
        }
        let Some(doubt) = doubt else {
            self.stays.count_visit(&observation.place, observation.time);
            return self.integrate(visit, observation, features, agreement);
        };
        let num_given_up = self.hold(visit, observation, features, doubt.clone(), circumstances);
        Ok(Learnt {
            doubt: Some(doubt),
            num_given_up,
            ..Learnt::default()
        })
    }

    /// Whether the image belongs to a visit that was learnt or, if it is doubtful, to visits that
    /// are held.
    fn is_same_visit(
        &mut self,
        observation: &Observation<'_>,
        features: &Features,
        is_doubtful: bool,
    ) -> bool {
        let (place, time) = (&observation.place, observation.time);
        let index = self.snapshot.find(place).map(|id| id.0 as usize);
        let node = index.map(|index| &*self.snapshot.nodes()[index]);
        let part = self.stays.arrive(place, node, time);
        if is_doubtful {
            let held = self.held.visits().iter().filter(|it| it.place == *place);
            return self.stays.is_held(place, time, held.map(|it| it.time));
        }
        match (part, index) {
            (Part::Visit, _) | (_, None) => false,
            (Part::Same, _) => true,
            (Part::VisitIfNew, Some(index)) => {
                let found = self.find(index, observation, features);
                found.displacement.is_some()
            }
        }
    }

    /// Keeps a doubtful visit until somebody says what it is; gives of how many older ones the
    /// features had to go.
    fn hold(
        &mut self,
        visit: Visit,
        observation: &Observation<'_>,
        features: Features,
        reason: QuarantineReason,
        circumstances: &Circumstances,
    ) -> usize {
        self.held_has_changed = true;
        let num_given_up = self.held.push(QuarantinedVisit {
            place: observation.place.clone(),
            id: visit.id,
            session: visit.session,
            time: visit.time,
            source: visit.source,
            image_size: observation.image_size,
            mask: observation.mask.map(|mask| Arc::new(MaskRuns::of(mask))),
            is_labelled: circumstances.is_labelled,
            reason,
            features: Arc::new(features),
        });
        if num_given_up > 0 {
            tracing::info!(
                num_given_up,
                "too many visits are held: the features of the oldest were given up"
            );
        }
        num_given_up
    }

    /// Learns a visit that is held, without judging it again.
    ///
    /// Fails, and changes nothing, with [`ErrorKind::NotFound`] if no such visit is held, with
    /// [`ErrorKind::AlreadyExists`] if the map has learnt it meanwhile, with [`ErrorKind::Shape`]
    /// if the map's images have another size by now, and with [`ErrorKind::Format`] if its mask
    /// does not fit its image.
    pub fn accept(&mut self, id: VisitId) -> Result<Learnt> {
        let Some(waiting) = self.held.visits().iter().find(|it| it.id == id) else {
            return Err(if self.held.find(id).is_some() {
                let message = format!("the features of visit {id} were given up");
                Error::new(ErrorKind::NotFound, message)
                    .with_help("drop it with `chronotope map drop`, and learn its image again")
            } else {
                Quarantine::not_held(id)
            });
        };
        let mask = self.check_held(waiting)?;
        let held = self.take_held(id)?;
        let visit = Visit {
            id,
            session: held.session,
            time: held.time,
            source: held.source.clone(),
            appearance: None,
            appearance_use: AppearanceUse::Recognised,
        };
        let observation = Observation {
            place: held.place,
            session: held.session,
            time: held.time,
            features: &held.features,
            image_size: held.image_size,
            mask: mask.as_ref(),
            source: held.source,
        };
        let features = Features::clone(&held.features);
        // Somebody knows that this was an honest visit: the next one like it is less unusual.
        let agreement = match held.reason {
            QuarantineReason::Disagreement { agreement, .. } => Some(agreement),
            QuarantineReason::Blind { .. } | QuarantineReason::Clock { .. } => None,
        };
        self.integrate(visit, &observation, features, agreement)
    }

    /// Whether a visit that is held can be learnt into the map as it is by now; gives its mask.
    fn check_held(&self, held: &QuarantinedVisit) -> Result<Option<GrayImage>> {
        check_size(self.snapshot.meta(), held.image_size)
            .map_err(|error| error.with_path(&held.source))?;
        let mut learnt = self.snapshot.nodes().iter().flat_map(|node| node.visits());
        if learnt.any(|visit| visit.id == held.id) {
            return Err(Error::new(
                ErrorKind::AlreadyExists,
                format!("the map has learnt the visit {} before", held.id),
            )
            .with_help("drop it with `chronotope map drop`"));
        }
        let mask = held.mask.as_ref();
        mask.map(|runs| runs.to_mask(held.image_size)).transpose()
    }

    /// Drops a visit that is held.
    ///
    /// Fails with [`ErrorKind::NotFound`] if no such visit is held.
    pub fn reject(&mut self, id: VisitId) -> Result<()> {
        self.take_held(id).map(drop)
    }

    fn take_held(&mut self, id: VisitId) -> Result<QuarantinedVisit> {
        let held = self.held.take_known(id)?;
        self.held_has_changed = true;
        Ok(held)
    }

    /// Why a visit should not be learnt, if something speaks against it, and how it agrees with its
    /// place, if that was requested.
    fn judge(
        &mut self,
        observation: &Observation<'_>,
        features: &Features,
        circumstances: &Circumstances,
    ) -> Result<(Option<QuarantineReason>, Option<f64>)> {
        let Some(guard) = &mut self.guard else {
            return Ok((None, None));
        };
        let policy = self.cfg.guard().clock();
        if policy != ClockPolicy::Ignore
            && let Some(doubt) = guard.doubt_clock(
                &self.snapshot,
                observation.session,
                observation.time,
                circumstances,
            )
        {
            if policy == ClockPolicy::Refuse {
                return Err(
                    Error::new(ErrorKind::Time, format!("{}: {doubt}", observation.time))
                        .with_path(&observation.source)
                        .with_help("set the clock, or give the time it was really taken at"),
                );
            }
            return Ok((Some(doubt), None));
        }
        if observation.features.len() < self.cfg.guard().min_features() {
            let doubt = QuarantineReason::Blind {
                num_features: observation.features.len(),
                gray_range: circumstances.gray_range,
            };
            return Ok((Some(doubt), None));
        }
        match self.snapshot.find(&observation.place) {
            Some(id) if self.snapshot.node(id).visits().len() >= self.cfg.guard().min_visits() => {
                self.judge_view(id.0 as usize, observation, features, circumstances)
            }
            _ => Ok((None, None)),
        }
    }

    /// Whether the visit looks as was predicted of the place at `index`, and how well.
    fn judge_view(
        &mut self,
        index: usize,
        observation: &Observation<'_>,
        features: &Features,
        circumstances: &Circumstances,
    ) -> Result<(Option<QuarantineReason>, Option<f64>)> {
        let found = self.find(index, observation, features);
        let node = &*self.snapshot.nodes()[index];
        let Some(guard) = &mut self.guard else {
            return Ok((None, None));
        };
        let model = self.expectations.of(&self.cfg, index, node)?;
        let hidden = found.hidden.as_ref();
        let agreement = guard.agreement(&self.cfg, model, observation.time, &found.seen, hidden);
        let Some(agreement) = agreement else {
            return Ok((None, None));
        };
        let disagreement = guard.disagreement(&self.cfg, index, node, agreement)?;
        let doubt = disagreement.and_then(|disagreement| {
            let num_own = found.distances.len();
            let other = self.match_other_places(index, observation, features, num_own);
            let is_believed = circumstances.is_labelled
                && !(other.as_ref()).is_some_and(|&(_, num_other)| {
                    contradicts(num_own, num_other, self.cfg.min_inliers())
                });
            let looks_like = other.map(|(place, _)| place);
            (disagreement.judged(looks_like)).filter(|_| !is_believed)
        });
        Ok((doubt, Some(agreement.0)))
    }

    /// The other place that most of the image's features agree with, if it is more than do so with
    /// the place at `own`, and how many. O(features of all places).
    fn match_other_places(
        &mut self,
        own: usize,
        observation: &Observation<'_>,
        features: &Features,
        num_own: usize,
    ) -> Option<(PlaceKey, usize)> {
        let mut most = num_own;
        let mut best = None;
        for index in (0..self.snapshot.nodes().len()).filter(|&index| index != own) {
            let num_agreeing = self.find(index, observation, features).distances.len();
            if num_agreeing > most {
                most = num_agreeing;
                best = Some(index);
            }
        }
        best.map(|index| (self.snapshot.nodes()[index].key().clone(), most))
    }

    /// Looks for the features of the place at `index` in an image (online recipe).
    fn find(&mut self, index: usize, observation: &Observation<'_>, features: &Features) -> Found {
        let node = &self.snapshot.nodes()[index];
        online::find(
            &self.cfg,
            &self.reobserve,
            &mut self.scratch,
            node.features().view(),
            observation,
            features,
            node.visits().len(),
        )
    }

    /// Learns a visit, whatever it looks like; `agreement` says how well it looked as predicted, if
    /// that was requested.
    fn integrate(
        &mut self,
        visit: Visit,
        observation: &Observation<'_>,
        features: Features,
        agreement: Option<f64>,
    ) -> Result<Learnt> {
        let index = self.node_index(&observation.place);
        let (located_by, is_experience) = self.recall(index, features.view());
        let found = match self.cfg.recipe() {
            Recipe::Online => self.find(index, observation, &features),
            Recipe::Reference => {
                self.stale[index] = true;
                let known = self.snapshot.nodes()[index].features().view();
                reference::find(&self.cfg, known, &features)
            }
        };
        let mut learnt = Learnt {
            num_seen: found.seen.count_ones() - found.born.len(),
            num_born: found.born.len(),
            experience: is_experience,
            doubt: None,
            is_same_visit: false,
            num_forgotten: 0,
            num_given_up: 0,
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
        let node = Arc::make_mut(&mut self.snapshot.nodes_mut()[index]);
        node.push_visit(visit, &found.born, found.seen, found.hidden, located_by)?;
        self.expectations.count_visit(index);
        if let Some(guard) = &mut self.guard {
            guard.count_visit(index, agreement);
        }
        if let Some(displacement) = found.displacement {
            (self.reobservation).count_displacement(displacement.dx_px, displacement.dy_px);
            for distance_bits in found.distances {
                self.reobservation.count_distance(distance_bits);
            }
        }
        self.snapshot.meta_mut().image_size = Some(observation.image_size);
        learnt.num_forgotten = self.keep_to_budget(index)?;
        Ok(learnt)
    }

    /// Forgets what exceeds the budget after a visit of the place at `index`; gives how much.
    fn keep_to_budget(&mut self, index: usize) -> Result<usize> {
        let mut num_forgotten = 0;
        let node = &self.snapshot.nodes()[index];
        if let Some(room) = Room::within_budget(self.cfg.budget(), node) {
            num_forgotten += self.shrink(index, room)?;
        }
        let Some(most) = self.cfg.budget().bytes() else {
            return Ok(num_forgotten);
        };
        self.num_bytes.resize(self.snapshot.nodes().len(), 0);
        self.num_bytes[index] = self.snapshot.nodes()[index].num_bytes();
        let total: usize = self.num_bytes.iter().sum();
        if total > most {
            for index in 0..self.snapshot.nodes().len() {
                let room = Room::of(&self.snapshot.nodes()[index]).scaled(total, most);
                num_forgotten += self.shrink(index, room)?;
                self.num_bytes[index] = self.snapshot.nodes()[index].num_bytes();
            }
        }
        Ok(num_forgotten)
    }

    fn shrink(&mut self, index: usize, room: Room) -> Result<usize> {
        let node = &self.snapshot.nodes()[index];
        let model = self.expectations.of(&self.cfg, index, node)?;
        let shrunk = budget::shrink(
            model,
            &self.reobserve,
            &mut self.scratch,
            &self.snapshot,
            index,
            room,
        )?;
        let size = |node: &Node| node.features().len() + node.visits().len();
        let num_forgotten = size(node).saturating_sub(size(&shrunk.node));
        self.expectations.renumber(index, &shrunk.was);
        if let Some(guard) = &mut self.guard {
            guard.retain(index, &shrunk.kept);
        }
        self.snapshot.nodes_mut()[index] = Arc::new(shrunk.node);
        Ok(num_forgotten)
    }

    /// The map as learnt so far.
    pub fn snapshot(&mut self) -> Result<Arc<Snapshot>> {
        for (node, stale) in self.snapshot.nodes_mut().iter_mut().zip(&mut self.stale) {
            if std::mem::take(stale) {
                reference::write_log(&self.cfg, Arc::make_mut(node))?;
            }
        }
        self.reobservation.attach(&mut self.snapshot);
        if self.held_has_changed {
            self.held.attach(&mut self.snapshot)?;
            self.held.remember(&self.snapshot);
            self.held_has_changed = false;
        }
        Ok(Arc::new(self.snapshot.clone()))
    }

    /// The visit without its appearance, if it fits the map.
    fn check(&self, observation: &Observation<'_>) -> Result<Visit> {
        let (width, height) = observation.image_size;
        if observation.source.len() > MAX_TEXT_BYTES {
            return Err(Error::new(
                ErrorKind::Shape,
                format!(
                    "the source of a visit has {} bytes, but a map keeps {MAX_TEXT_BYTES}",
                    observation.source.len()
                ),
            )
            .with_help("name the image by a shorter path"));
        }
        check_size(self.snapshot.meta(), observation.image_size)
            .map_err(|error| error.with_path(&observation.source))?;
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
        // An image is known by what is in it, whichever run brings it; maps of earlier versions have
        // identities of their runs.
        let digest = features_digest(observation.features);
        let identity =
            |session| VisitId::derive(session, &observation.place, observation.time, &digest);
        let id = identity(SessionId::default());
        let is_known = |visit: &Visit| {
            visit.id == id || visit.time == observation.time && visit.id == identity(visit.session)
        };
        let place = self.snapshot.find(&observation.place);
        if place.is_some_and(|node| self.snapshot.node(node).visits().iter().any(is_known)) {
            return Err(Error::new(
                ErrorKind::AlreadyExists,
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
        (self.snapshot.nodes_mut()).push(Arc::new(Node::new(place.clone())));
        self.stale.push(false);
        self.snapshot.nodes().len() - 1
    }

    /// Localises an image by the experiences so far: a bit for each experience of its own place,
    /// one if it scores higher than every experience of the other places, and a last bit for the
    /// image itself where none does and it becomes one.
    fn recall(&mut self, own: usize, live: FeaturesView<'_>) -> (BitRow, bool) {
        let remembers = self.cfg.keep_appearances() != KeepAppearances::None
            || self.cfg.recipe() == Recipe::Reference;
        if !remembers {
            let row = self.snapshot.nodes()[own].unlocated(AppearanceUse::Recognised);
            return (row, false);
        }
        let mut best_other = self.cfg.experience().min_score().max(1) - 1;
        let mut own_scores = Vec::new();
        for (index, node) in self.snapshot.nodes().iter().enumerate() {
            let experiences = (node.visits().iter())
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

/// Whether an image has the size of the map's images.
fn check_size(meta: &MapMeta, (width, height): (u32, u32)) -> Result<()> {
    match meta.image_size {
        Some(map) if map != (width, height) => Err(Error::new(
            ErrorKind::Shape,
            format!(
                "the image has {width} x {height} px, but the map is learnt from {} x {} px",
                map.0, map.1
            ),
        )
        .with_help("crop or scale all images of a map to one size")),
        _ => Ok(()),
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
            // Refused by the configuration: there is nothing to calibrate with while the map is
            // made.
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
