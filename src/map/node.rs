//! What is remembered of one place, and how does that grow without breaking its invariants?
//!
//! [`Node::push_visit`] keeps features, visits and logs of a place in step, and
//! [`Node::from_parts`] takes only what is; [`Node::check`] says whether a store may hold it. What is worth adding is decided by `learn`.

use std::ops::Range;

use super::limits::{DESCRIPTOR_BYTES, KEYPOINT_BYTES, MAX_FEATURES, MAX_TEXT_BYTES};
use super::types::{AppearanceUse, PlaceKey, Visit};
use crate::feature::Features;
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::Time;
use fremen::visibility::{BitRow, HistoryLog};

/// Bytes of a keypoint and its descriptor.
const FEATURE_BYTES: usize = KEYPOINT_BYTES + DESCRIPTOR_BYTES;

/// One place.
///
/// Features, visits and logs grow together ([`push_visit`](Self::push_visit)); what comes from
/// elsewhere is checked as a whole ([`from_parts`](Self::from_parts)).
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    key: PlaceKey,
    features: Features,
    log: HistoryLog,
    visits: Vec<Visit>,
    experience_log: HistoryLog,
    pose: Option<[f64; 3]>,
}

/// What a [`Node`] is made of, in step or not: [`Node::from_parts`] says which.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeParts {
    /// [`Node::key`].
    pub key: PlaceKey,
    /// [`Node::features`].
    pub features: Features,
    /// [`Node::log`]; `log.num_features() == features.len()`.
    pub log: HistoryLog,
    /// [`Node::visits`]; `log.num_visits() == visits.len()` and times agree.
    pub visits: Vec<Visit>,
    /// [`Node::experience_log`]; it has a row for every visit, which ends with the last experience
    /// so far, and hides nothing.
    pub experience_log: HistoryLog,
    /// [`Node::pose`], finite.
    pub pose: Option<[f64; 3]>,
}

impl Node {
    /// A place that was never visited.
    pub fn new(key: PlaceKey) -> Self {
        Self {
            key,
            features: Features::new(),
            log: HistoryLog::new(),
            experience_log: HistoryLog::new(),
            visits: Vec::new(),
            pose: None,
        }
    }

    /// The place that these parts make; an error that names the place and what is not in step, or
    /// what a store cannot hold ([`check`](Self::check)). O(visits + keypoints).
    pub fn from_parts(parts: NodeParts) -> Result<Self> {
        let NodeParts {
            key,
            features,
            log,
            visits,
            experience_log,
            pose,
        } = parts;
        let node = Self {
            key,
            features,
            log,
            visits,
            experience_log,
            pose,
        };
        node.check().map(|()| node)
    }

    /// The inverse of [`from_parts`](Self::from_parts).
    pub fn into_parts(self) -> NodeParts {
        NodeParts {
            key: self.key,
            features: self.features,
            log: self.log,
            visits: self.visits,
            experience_log: self.experience_log,
            pose: self.pose,
        }
    }

    /// Its name.
    pub fn key(&self) -> &PlaceKey {
        &self.key
    }

    /// The features of the place, in order of birth; positions are those of the birth visit moved
    /// by the displacement found there, so that all share the first visit's frame.
    pub fn features(&self) -> &Features {
        &self.features
    }

    /// What was seen when: a column for each of [`features`](Self::features), a row for each of
    /// [`visits`](Self::visits).
    pub fn log(&self) -> &HistoryLog {
        &self.log
    }

    /// The visits, in order of arrival.
    pub fn visits(&self) -> &[Visit] {
        &self.visits
    }

    /// Which experience of the place would by itself have located which visit. Its "features" are
    /// the visits with [`AppearanceUse::Experience`], in their order, each born at itself, whether
    /// or not its appearance was kept; it has a row for every visit, and none of them has hidden
    /// bits.
    pub fn experience_log(&self) -> &HistoryLog {
        &self.experience_log
    }

    /// Position in metres in a frame of the user's, where known.
    pub fn pose(&self) -> Option<[f64; 3]> {
        self.pose
    }

    /// Sets [`pose`](Self::pose); an error if it is not finite, which changes nothing.
    pub fn set_pose(&mut self, pose: Option<[f64; 3]>) -> Result<()> {
        check_pose(pose).map_err(|message| self.fault(message))?;
        self.pose = pose;
        Ok(())
    }
}

/// For the rooms that learn and correct.
impl Node {
    /// Gives the place another name. Whoever does it also sees to edges, and that no other place of
    /// the map has it.
    pub(crate) fn set_key(&mut self, key: PlaceKey) {
        self.key = key;
    }

    /// Puts another log of the same features and visits in the place of [`log`](Self::log).
    pub(crate) fn set_log(&mut self, log: HistoryLog) -> Result<()> {
        let before = std::mem::replace(&mut self.log, log);
        if let Err(message) = self.check_log() {
            self.log = before;
            return Err(self.fault(message));
        }
        Ok(())
    }

    /// The place as it was before the first visit.
    pub(super) fn unvisited(&self) -> Self {
        Self {
            pose: self.pose,
            ..Self::new(self.key.clone())
        }
    }
}

impl Node {
    /// Appends one visit with the features `born` at it.
    ///
    /// `seen` has a bit for each feature known before, then one for each born now; `hidden`, where
    /// given, is as long and marks what could not be observed. A feature born now need not be seen:
    /// a builder that looks at all images first enters its features with the first visit.
    ///
    /// `located_by` has a bit for each experience known before, then one for this visit if it is
    /// itself an experience ([`unlocated`](Self::unlocated) gives the row of a visit that none of
    /// them located). On error nothing has changed. O(born + bits).
    pub fn push_visit(
        &mut self,
        visit: Visit,
        born: &Features,
        seen: BitRow,
        hidden: Option<BitRow>,
        located_by: BitRow,
    ) -> Result<()> {
        let num_features = self.features.len() + born.len();
        if seen.len() != num_features {
            return Err(Error::new(
                ErrorKind::Shape,
                format!(
                    "place `{}`: {} seen bits do not cover {} known and {} new features",
                    self.key,
                    seen.len(),
                    self.features.len(),
                    born.len()
                ),
            ));
        }
        let num_experiences = self.num_experiences_after(visit.appearance_use);
        if located_by.len() != num_experiences {
            return Err(Error::new(
                ErrorKind::Shape,
                format!(
                    "place `{}`: {} bits do not cover its {num_experiences} experiences",
                    self.key,
                    located_by.len()
                ),
            ));
        }
        self.log.push_visit(visit.time, seen, hidden)?;
        self.experience_log
            .push_visit(visit.time, located_by, None)?;
        self.visits.push(visit);
        for (&keypoint, &descriptor) in born.keypoints().iter().zip(born.descriptors()) {
            self.features.push(keypoint, descriptor);
        }
        Ok(())
    }

    /// The row for [`push_visit`](Self::push_visit) of a visit that no experience known before
    /// would have located: only its own bit is one, if it is an experience itself.
    pub fn unlocated(&self, appearance_use: AppearanceUse) -> BitRow {
        let num_known = self.experience_log.num_features();
        let mut row = BitRow::zeros(self.num_experiences_after(appearance_use));
        if row.len() > num_known {
            row.set(num_known);
        }
        row
    }

    /// The experiences known after one more visit of this use.
    pub(super) fn num_experiences_after(&self, appearance_use: AppearanceUse) -> usize {
        let is_experience = appearance_use == AppearanceUse::Experience;
        self.experience_log.num_features() + usize::from(is_experience)
    }

    /// The place with only these visits and features, in the same order of arrival: one bool each.
    /// Also which feature of this place each of its features is.
    ///
    /// A feature whose birth is gone is born at the first visit that is left and could have seen
    /// it; if there is none, it goes too. O(visits * features).
    pub fn retained(&self, visits: &[bool], features: &[bool]) -> Result<(Self, Vec<u32>)> {
        let kept: Vec<usize> = (0..self.visits.len())
            .filter(|&visit| visits.get(visit) == Some(&true))
            .collect();
        // Features in order of their new birth.
        let is_kept = |id: usize| features.get(id) == Some(&true);
        let mut births: Vec<(usize, usize)> = Vec::new();
        let mut waiting: Vec<usize> = Vec::new();
        let mut num_known = 0;
        for (at, &visit) in kept.iter().enumerate() {
            let seen = self.log.seen_row(visit);
            waiting.extend((num_known..seen.len()).filter(|&id| is_kept(id)));
            num_known = seen.len().max(num_known);
            let hidden = self.log.hidden_row(visit);
            // Those born at a visit may be hidden there, as a builder may have it.
            let born_here = self.born_at(visit);
            waiting.retain(|&id| {
                let can_be_born =
                    born_here.contains(&id) || !hidden.is_some_and(|hidden| hidden.get(id));
                if can_be_born {
                    births.push((at, id));
                }
                !can_be_born
            });
        }
        let experience = |visit: usize| {
            (self.visits[visit].appearance_use == AppearanceUse::Experience)
                .then(|| self.experience_log.seen_row(visit).len() - 1)
        };
        let mut node = self.unvisited();
        let mut experiences: Vec<usize> = Vec::new();
        for (at, &visit) in kept.iter().enumerate() {
            let len = births.partition_point(|&(birth, _)| birth <= at);
            let ids: Vec<u32> = (births[node.features.len()..len].iter())
                .map(|&(_, id)| id as u32)
                .collect();
            let born = self.features.select(&ids);
            let rearranged = |row: &BitRow| {
                let mut to = BitRow::zeros(len);
                let ones = (births[..len].iter().enumerate()).filter(|(_, (_, id))| row.get(*id));
                ones.for_each(|(new, _)| to.set(new));
                to
            };
            experiences.extend(experience(visit));
            let located = self.experience_log.seen_row(visit);
            let mut located_by = BitRow::zeros(experiences.len());
            let ones = (experiences.iter().enumerate()).filter(|(_, old)| located.get(**old));
            ones.for_each(|(new, _)| located_by.set(new));
            node.push_visit(
                self.visits[visit].clone(),
                &born,
                rearranged(self.log.seen_row(visit)),
                (self.log.hidden_row(visit).map(rearranged)).filter(|row| row.count_ones() > 0),
                located_by,
            )?;
        }
        let was = births.iter().map(|&(_, id)| id as u32).collect();
        Ok((node, was))
    }

    /// The ids of the features born at `visit`.
    ///
    /// # Panics
    /// If there is no such visit.
    pub fn born_at(&self, visit: usize) -> Range<usize> {
        let before = match visit.checked_sub(1) {
            Some(previous) => self.log.seen_row(previous).len(),
            None => 0,
        };
        before..self.log.seen_row(visit).len()
    }

    /// Bytes of its features, logs and appearances. O(visits).
    pub fn num_bytes(&self) -> usize {
        let rows = |visit: usize| {
            let num_rows = 1 + usize::from(self.log.hidden_row(visit).is_some());
            num_rows * self.log.seen_row(visit).words().len()
                + self.experience_log.seen_row(visit).words().len()
        };
        let num_words: usize = (0..self.visits.len()).map(rows).sum();
        let appearances = self.visits.iter().filter_map(|it| it.appearance.as_ref());
        let num_kept: usize = appearances.map(|appearance| appearance.len()).sum();
        8 * num_words + FEATURE_BYTES * (self.features.len() + num_kept)
    }

    /// The earliest and the latest time of its visits.
    pub fn time_span(&self) -> Option<(Time, Time)> {
        let times = self.log.times();
        Some((*times.iter().min()?, *times.iter().max()?))
    }

    /// Whether features, visits and logs are in step and everything can be stored.
    pub fn check(&self) -> Result<()> {
        let shape = |message: String| Err(self.fault(message));
        self.check_log().or_else(shape)?;
        self.check_experiences().or_else(shape)?;
        check_pose(self.pose).or_else(shape)?;
        if let Some(id) = first_not_finite(&self.features) {
            return shape(format!("keypoint {id} is not finite"));
        }
        for (at, visit) in self.visits.iter().enumerate() {
            if visit.source.len() > MAX_TEXT_BYTES {
                return shape(format!(
                    "the source of visit {at} is longer than {MAX_TEXT_BYTES} bytes"
                ));
            }
            if let Some(appearance) = &visit.appearance {
                if appearance.len() > MAX_FEATURES {
                    return shape(format!(
                        "the appearance of visit {at} has more than {MAX_FEATURES} features"
                    ));
                }
                if let Some(id) = first_not_finite(appearance) {
                    return shape(format!(
                        "keypoint {id} of the appearance of visit {at} is not finite"
                    ));
                }
            }
        }
        Ok(())
    }

    fn fault(&self, message: String) -> Error {
        Error::new(ErrorKind::Shape, message).with_place(format!("place `{}`", self.key))
    }

    /// Whether the log is in step with features and visits; what is wrong, if not.
    fn check_log(&self) -> Result<(), String> {
        let (features, visits) = (self.features.len(), self.visits.len());
        if self.log.num_features() != features || self.log.num_visits() != visits {
            return Err(format!(
                "{features} features and {visits} visits do not pair with a log of {} and {}",
                self.log.num_features(),
                self.log.num_visits()
            ));
        }
        if features > MAX_FEATURES {
            return Err(format!(
                "{features} features, where a place holds at most {MAX_FEATURES}"
            ));
        }
        let mut times = self.visits.iter().zip(self.log.times());
        match times.position(|(visit, &time)| visit.time != time) {
            Some(at) => Err(format!("visit {at} and the log differ in time")),
            None => Ok(()),
        }
    }

    /// Whether the log of experiences is in step with the visits; what is wrong, if not.
    fn check_experiences(&self) -> Result<(), String> {
        let log = &self.experience_log;
        if log.num_visits() != self.visits.len() {
            return Err(format!(
                "{} visits do not pair with a log of experiences at {}",
                self.visits.len(),
                log.num_visits()
            ));
        }
        let mut num_experiences = 0;
        for (at, (visit, &time)) in self.visits.iter().zip(log.times()).enumerate() {
            if visit.time != time {
                return Err(format!(
                    "visit {at} and the log of experiences differ in time"
                ));
            }
            let is_experience = visit.appearance_use == AppearanceUse::Experience;
            num_experiences += usize::from(is_experience);
            let found = log.seen_row(at).len();
            if found != num_experiences {
                return Err(format!(
                    "{num_experiences} experiences up to visit {at} do not pair with {found} bits \
                     of the log of experiences"
                ));
            }
            if log.hidden_row(at).is_some() {
                return Err(format!("the log of experiences hides some at visit {at}"));
            }
        }
        if num_experiences > MAX_FEATURES {
            return Err(format!(
                "{num_experiences} experiences, where a place holds at most {MAX_FEATURES}"
            ));
        }
        Ok(())
    }
}

fn check_pose(pose: Option<[f64; 3]>) -> Result<(), String> {
    if pose.is_some_and(|pose| pose.iter().any(|x| !x.is_finite())) {
        return Err("its pose is not finite".into());
    }
    Ok(())
}

fn first_not_finite(features: &Features) -> Option<usize> {
    features.keypoints().iter().position(|k| {
        [k.x, k.y, k.size, k.response]
            .iter()
            .any(|number| !number.is_finite())
    })
}
