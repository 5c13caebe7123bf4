//! Which visits wait until somebody says whether they are what they seem?
//!
//! A visit that does not look like its place, or whose time cannot be right, is not learnt: it is
//! kept in quarantine with the reason, and can be learnt or dropped later. Whether to believe a
//! visit is decided by `learn`; quarantined visits are part of a snapshot, each as an attachment of
//! its own (`held-` and its identity), so that they are committed, rolled back and checked
//! as everything else is, and one more costs its own bytes.
//!
//! At most [`MAX_VISITS`] visits and [`MAX_BYTES`] are kept whole. Beyond that the features of the
//! oldest are *given up*: the visit is still known, with its reason, so that nobody learns it
//! unawares, but cannot be accepted any more. Beyond [`MAX_GIVEN_UP`] of these the oldest are
//! forgotten and counted. A mask is kept as the lengths of its runs ([`MaskRuns`](super::MaskRuns)).

use std::cmp::Reverse;
use std::sync::Arc;

use super::quarantine_row as row;
use super::quarantined::QuarantinedVisit;
use super::snapshot::Snapshot;
use super::types::{PlaceKey, SessionId, VisitId};
use fremen::error::{Error, ErrorKind, Result};

/// The attachment of all of them that earlier versions wrote.
const LIST_NAME: &str = "held";
/// The attachment of how many were forgotten.
const FORGOTTEN_NAME: &str = "held-forgotten";
/// Visits that are kept whole, at most.
const MAX_VISITS: usize = 512;
/// Bytes of all their features and texts, at most.
const MAX_BYTES: usize = 8 << 20;
/// Visits whose features were given up, at most.
const MAX_GIVEN_UP: usize = 4_096;

/// A visit in quarantine, and where it stands.
#[derive(Clone, Debug)]
struct Held {
    /// Numbers them in order of arrival.
    order: u64,
    /// Its bytes in a snapshot, where they are known.
    bytes: Option<Arc<[u8]>>,
}

/// The visits that a map keeps without having learnt them, in order of arrival.
#[derive(Clone, Debug, Default)]
pub struct Quarantine {
    visits: Vec<QuarantinedVisit>,
    /// Of each visit.
    held: Vec<Held>,
    /// Those whose features are gone, in order of arrival.
    given_up: Vec<QuarantinedVisit>,
    given_up_held: Vec<Held>,
    num_forgotten: u64,
}

impl PartialEq for Quarantine {
    fn eq(&self, other: &Self) -> bool {
        (self.num_forgotten, &self.visits, &self.given_up)
            == (other.num_forgotten, &other.visits, &other.given_up)
    }
}

impl Quarantine {
    /// The quarantined visits of `snapshot`.
    ///
    /// Fails with [`ErrorKind::Format`] if an attachment is not as it is written.
    pub fn of(snapshot: &Snapshot) -> Result<Self> {
        let fault = |name: &str, message: String| {
            Error::new(
                ErrorKind::Format,
                format!("the attachment `{name}` cannot be read: {message}"),
            )
            .with_help("return to an earlier generation with `chronotope map rollback`")
        };
        let mut all = Vec::new();
        if let Some(bytes) = snapshot.attachments.get(LIST_NAME) {
            let visits = row::decode_list(bytes).map_err(|message| fault(LIST_NAME, message))?;
            all.extend((0..).zip(visits).map(|(order, visit)| {
                let (bytes, is_whole) = (None, true);
                (Held { order, bytes }, visit, is_whole)
            }));
        }
        let mut held = Self::default();
        let num_listed = all.len() as u64;
        for (name, bytes) in &snapshot.attachments {
            if name == FORGOTTEN_NAME {
                let number = row::decode_number(bytes);
                held.num_forgotten = number.map_err(|message| fault(name, message))?;
                continue;
            }
            let Some(id) = row::id_of(name) else {
                continue;
            };
            let read = row::decode(bytes).map_err(|message| fault(name, message))?;
            if read.visit.id != id {
                let message = format!("it is visit {}", read.visit.id);
                return Err(fault(name, message));
            }
            if all.iter().take(num_listed as usize).any(|it| it.1.id == id) {
                return Err(fault(name, format!("visit {id} is held twice")));
            }
            let order = num_listed.saturating_add(read.order);
            let bytes = (num_listed == 0).then(|| Arc::clone(bytes));
            all.push((Held { order, bytes }, read.visit, read.is_whole));
        }
        all.sort_by_key(|(held, visit, _)| (held.order, visit.id));
        for (known, visit, is_whole) in all {
            let (visits, helds) = if is_whole {
                (&mut held.visits, &mut held.held)
            } else {
                (&mut held.given_up, &mut held.given_up_held)
            };
            visits.push(visit);
            helds.push(known);
        }
        Ok(held)
    }

    /// Whether an attachment of this name is one of these.
    pub fn is_named(name: &str) -> bool {
        name == LIST_NAME || name == FORGOTTEN_NAME || row::id_of(name).is_some()
    }

    /// Makes them part of `snapshot`.
    pub fn attach(&self, snapshot: &mut Snapshot) -> Result<()> {
        let mut attachments = std::mem::take(&mut snapshot.attachments);
        attachments.retain(|name, _| !Self::is_named(name));
        let whole = self.visits.iter().zip(&self.held).map(|it| (it, true));
        let given_up = self.given_up.iter().zip(&self.given_up_held);
        for ((visit, held), is_whole) in whole.chain(given_up.map(|it| (it, false))) {
            let bytes = match &held.bytes {
                Some(bytes) => Arc::clone(bytes),
                None => row::encode(visit, held.order, is_whole)?.into(),
            };
            attachments.insert(row::name_of(visit.id), bytes);
        }
        if self.num_forgotten > 0 {
            let bytes = row::encode_number(self.num_forgotten);
            attachments.insert(FORGOTTEN_NAME.into(), bytes.into());
        }
        snapshot.attachments = attachments;
        Ok(())
    }

    /// Keeps the bytes of visits that `snapshot` has been given by [`attach`](Self::attach), so
    /// that they are not made again.
    pub(crate) fn remember(&mut self, snapshot: &Snapshot) {
        let whole = self.visits.iter().zip(&mut self.held);
        let given_up = self.given_up.iter().zip(&mut self.given_up_held);
        for (visit, held) in whole.chain(given_up).filter(|(_, it)| it.bytes.is_none()) {
            held.bytes = snapshot.attachments.get(&row::name_of(visit.id)).cloned();
        }
    }

    /// The visits that can be accepted, oldest first.
    pub fn visits(&self) -> &[QuarantinedVisit] {
        &self.visits
    }

    /// The visits whose features were given up for want of room, oldest first: they are known not
    /// to have been believed, and have no features and no mask.
    pub fn given_up(&self) -> &[QuarantinedVisit] {
        &self.given_up
    }

    /// How many more there were, of which nothing is left.
    pub fn num_forgotten(&self) -> u64 {
        self.num_forgotten
    }

    /// The visit of this identity, with its features or without.
    pub fn find(&self, id: VisitId) -> Option<&QuarantinedVisit> {
        let mut all = self.visits.iter().chain(&self.given_up);
        all.find(|it| it.id == id)
    }

    /// The identities of all visits that can be accepted, and with `with_given_up` of those, too, whose
    /// features were given up: they can be dropped.
    pub fn ids(&self, with_given_up: bool) -> Vec<VisitId> {
        let given_up = self.given_up.iter().filter(|_| with_given_up);
        self.visits.iter().chain(given_up).map(|it| it.id).collect()
    }

    /// The visits that are named, each once: a name is an identity or its first digits.
    ///
    /// Fails as [`VisitId::find`] does if a name means none of [`ids`](Self::ids), or several.
    pub fn choose(&self, names: &[String], with_given_up: bool) -> Result<Vec<VisitId>> {
        let known = self.ids(with_given_up);
        let mut chosen = Vec::new();
        for name in names {
            let id = VisitId::find(&known, name)?;
            if !chosen.contains(&id) {
                chosen.push(id);
            }
        }
        Ok(chosen)
    }

    /// Adds a visit; one that is there already changes nothing. Gives of how many of the oldest the
    /// features had to go for it.
    pub fn push(&mut self, visit: QuarantinedVisit) -> usize {
        if self.find(visit.id).is_some() {
            return 0;
        }
        let last = (self
            .held
            .last()
            .into_iter()
            .chain(self.given_up_held.last()))
        .map(|it| it.order)
        .max();
        let order = last.map_or(0, |last| last.saturating_add(1));
        self.visits.push(visit);
        self.held.push(Held { order, bytes: None });
        self.bound()
    }

    /// Takes a visit out, also one whose features were given up: that has none.
    pub fn take(&mut self, id: VisitId) -> Option<QuarantinedVisit> {
        if let Some(at) = self.visits.iter().position(|it| it.id == id) {
            self.held.remove(at);
            return Some(self.visits.remove(at));
        }
        let at = self.given_up.iter().position(|it| it.id == id)?;
        self.given_up_held.remove(at);
        Some(self.given_up.remove(at))
    }

    /// [`take`](Self::take) of a visit that has to be there.
    ///
    /// Fails with [`ErrorKind::NotFound`] if it is not.
    pub fn take_known(&mut self, id: VisitId) -> Result<QuarantinedVisit> {
        self.take(id).ok_or_else(|| Self::not_held(id))
    }

    pub(crate) fn not_held(id: VisitId) -> Error {
        Error::new(ErrorKind::NotFound, format!("no visit {id} is held"))
            .with_help("`chronotope map held` lists them")
    }

    /// Takes out the visits of one session, and gives how many there were.
    pub fn forget(&mut self, session: SessionId) -> usize {
        self.retain(|it| it.session != session)
    }

    /// Takes out all visits but those that `keeps` wants, and gives how many there were.
    pub fn retain(&mut self, keeps: impl Fn(&QuarantinedVisit) -> bool) -> usize {
        let before = self.visits.len() + self.given_up.len();
        let all = self.visits.iter().chain(&self.given_up);
        let gone: Vec<VisitId> = all.filter(|it| !keeps(it)).map(|it| it.id).collect();
        for id in gone {
            self.take(id);
        }
        before - self.visits.len() - self.given_up.len()
    }

    /// Gives the visits of a place another one.
    pub fn rename_place(&mut self, from: &PlaceKey, to: &PlaceKey) {
        let whole = self.visits.iter_mut().zip(&mut self.held);
        let given_up = self.given_up.iter_mut().zip(&mut self.given_up_held);
        for (visit, held) in whole.chain(given_up).filter(|(it, _)| it.place == *from) {
            visit.place = to.clone();
            held.bytes = None;
        }
    }

    /// Adds the visits of `other`, in order of time and identity: the union, whatever the order. Of
    /// two accounts of one visit the larger holds.
    pub fn merge(&mut self, other: &Self) {
        for (own, others) in [
            (&mut self.visits, &other.visits),
            (&mut self.given_up, &other.given_up),
        ] {
            own.extend_from_slice(others);
            own.sort_by_cached_key(|it| {
                let account = format!("{it:?}");
                (it.time, it.id, Reverse((it.features.len(), account)))
            });
            own.dedup_by_key(|it| it.id);
        }
        let visits = &self.visits;
        (self.given_up).retain(|it| visits.iter().all(|whole| whole.id != it.id));
        let fresh = |first: usize, num: usize| {
            let orders = first as u64..(first + num) as u64;
            orders.map(|order| Held { order, bytes: None }).collect()
        };
        self.given_up_held = fresh(0, self.given_up.len());
        self.held = fresh(self.given_up.len(), self.visits.len());
        self.num_forgotten = self.num_forgotten.max(other.num_forgotten);
        self.bound();
    }

    /// Gives up the features of the oldest where there are too many, and forgets the oldest of
    /// those; gives how many were given up.
    fn bound(&mut self) -> usize {
        let mut num_bytes: usize = self.visits.iter().map(QuarantinedVisit::num_bytes).sum();
        let mut num_given_up = 0;
        while num_given_up < self.visits.len()
            && (self.visits.len() - num_given_up > MAX_VISITS || num_bytes > MAX_BYTES)
        {
            num_bytes -= self.visits[num_given_up].num_bytes();
            num_given_up += 1;
        }
        let orders = self.held.drain(..num_given_up).map(|it| it.order);
        for (order, visit) in orders.zip(self.visits.drain(..num_given_up)) {
            let at = self.given_up_held.partition_point(|it| it.order < order);
            self.given_up_held.insert(at, Held { order, bytes: None });
            let bare = QuarantinedVisit {
                mask: None,
                features: Arc::default(),
                ..visit
            };
            self.given_up.insert(at, bare);
        }
        let num_forgotten = self.given_up.len().saturating_sub(MAX_GIVEN_UP);
        self.given_up.drain(..num_forgotten);
        self.given_up_held.drain(..num_forgotten);
        self.num_forgotten = self.num_forgotten.saturating_add(num_forgotten as u64);
        num_given_up
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feature::{Descriptor, Features, Keypoint};
    use crate::map::quarantined::{MaskRuns, QuarantineReason};
    use crate::map::types::MapMeta;
    use fremen::time::Time;

    fn visit(number: u128, num_features: usize) -> QuarantinedVisit {
        let mut features = Features::new();
        for i in 0..num_features {
            let keypoint = Keypoint {
                x: i as f32,
                y: 0.1,
                size: 9.0,
                response: -1.5,
            };
            features.push(keypoint, Descriptor([number as u64, i as u64, 3, 4]));
        }
        QuarantinedVisit {
            place: PlaceKey::new("door").expect("valid"),
            id: VisitId(number),
            session: SessionId(number % 2),
            time: Time::from_s(number as i64),
            source: "a \"quoted\" name".into(),
            image_size: (640, 480),
            mask: number
                .is_multiple_of(2)
                .then(|| Arc::new(MaskRuns(vec![0, 640 * 479, 640]))),
            is_labelled: number.is_multiple_of(3),
            reason: QuarantineReason::Disagreement {
                agreement: 0.1,
                threshold: 1.0 / 3.0,
                expected: 0.7,
                num_predicted: 50,
                looks_like: PlaceKey::new("gate").ok(),
            },
            features: Arc::new(features),
        }
    }

    fn map() -> Snapshot {
        Snapshot::empty(MapMeta::new(1, "star+brief", "default"))
    }

    #[test]
    fn held_visits_survive_the_map_and_damage_is_named() {
        let mut quarantine = Quarantine::default();
        for number in (0..5).rev() {
            assert_eq!(quarantine.push(visit(number, number as usize)), 0);
        }
        assert_eq!(quarantine.push(visit(3, 9)), 0);
        let mut snapshot = map();
        quarantine.attach(&mut snapshot).expect("fits");
        assert_eq!(Quarantine::of(&snapshot).expect("ours"), quarantine);
        let (name, bytes) = snapshot.attachments.first_key_value().expect("five");
        let (name, bytes) = (name.clone(), Arc::clone(bytes));
        let mut with = |bytes: &[u8]| {
            (snapshot.attachments).insert(name.clone(), bytes.into());
            Quarantine::of(&snapshot)
        };
        for len in 0..bytes.len() {
            let error = with(&bytes[..len]).expect_err("damaged");
            assert!(error.to_string().contains(&name), "{len} bytes: {error}");
        }
        assert!(with(&[&bytes[..], &[0]].concat()).is_err());
        // Under the name of another visit.
        with(&bytes).expect("as it was");
        (snapshot.attachments).insert(row::name_of(VisitId(77)), bytes);
        assert!(Quarantine::of(&snapshot).is_err());
        assert_eq!(quarantine.forget(SessionId(1)), 2);
        assert!(quarantine.take(VisitId(2)).is_some() && quarantine.take(VisitId(2)).is_none());
        assert_eq!(quarantine.visits().len(), 2);
    }

    #[test]
    fn the_list_of_earlier_versions_is_read() {
        let visits: Vec<_> = (0..4).map(|number| visit(9 - number, 3)).collect();
        let mut snapshot = map();
        let bytes = row::encode_list(&visits).expect("serialises");
        (snapshot.attachments).insert(LIST_NAME.into(), bytes.into());
        let mut held = Quarantine::of(&snapshot).expect("readable");
        assert_eq!(held.visits(), visits);
        held.push(visit(1, 2));
        held.attach(&mut snapshot).expect("fits");
        assert!(!snapshot.attachments.contains_key(LIST_NAME));
        assert_eq!(Quarantine::of(&snapshot).expect("ours"), held);
    }

    /// A visit more does not write the others again.
    #[test]
    fn a_visit_that_is_held_costs_its_own_bytes() {
        let (mut quarantine, mut snapshot) = (Quarantine::default(), map());
        let mut before = snapshot.attachments.clone();
        for number in 0..20 {
            quarantine.push(visit(number, 100));
            quarantine.attach(&mut snapshot).expect("fits");
            quarantine.remember(&snapshot);
            let is_new = |(name, value): &(&String, &Arc<[u8]>)| {
                !before.get(*name).is_some_and(|it| Arc::ptr_eq(it, value))
            };
            let new: Vec<_> = snapshot.attachments.iter().filter(is_new).collect();
            assert_eq!(new.len(), 1, "{number}");
            assert!(new[0].1.len() < 100 * 48 + 1_000);
            before = snapshot.attachments.clone();
        }
    }

    #[test]
    fn the_oldest_are_given_up_where_there_are_too_many_and_nothing_goes_unseen() {
        let mut quarantine = Quarantine::default();
        let num_given_up: usize = (0..600)
            .map(|number| quarantine.push(visit(number, 1)))
            .sum();
        assert_eq!(
            (num_given_up, quarantine.visits().len()),
            (600 - MAX_VISITS, MAX_VISITS)
        );
        assert_eq!(quarantine.visits()[0].id, VisitId(600 - MAX_VISITS as u128));
        let oldest = &quarantine.given_up()[0];
        assert_eq!((oldest.id, oldest.features.len()), (VisitId(0), 0));
        assert!(quarantine.find(VisitId(0)).is_some());
        // It is still held when its image comes again.
        assert_eq!(quarantine.push(visit(0, 1)), 0);
        let mut snapshot = map();
        quarantine.attach(&mut snapshot).expect("fits");
        assert_eq!(Quarantine::of(&snapshot).expect("ours"), quarantine);
        // A single one that is too large keeps its place, not its features.
        let mut large = Quarantine::default();
        assert_eq!(large.push(visit(1, MAX_BYTES / 48)), 1);
        assert_eq!((large.visits().len(), large.given_up().len()), (0, 1));
        for number in 600..5_000 {
            quarantine.push(visit(number, 0));
        }
        let num_known = (quarantine.visits().len() + quarantine.given_up().len()) as u64;
        assert_eq!(num_known + quarantine.num_forgotten(), 5_000);
        assert_eq!(quarantine.given_up().len(), MAX_GIVEN_UP);
    }

    #[test]
    fn merging_is_the_union_of_whole_and_given_up_visits() {
        let (mut a, mut b) = (Quarantine::default(), Quarantine::default());
        for number in 0..600 {
            a.push(visit(number, 1));
            b.push(visit(599 - number, 1));
        }
        let mut merged = a.clone();
        merged.merge(&b);
        let mut other = b.clone();
        other.merge(&a);
        assert_eq!(merged, other);
        let (mut first, mut second) = (map(), map());
        merged.attach(&mut first).expect("fits");
        other.attach(&mut second).expect("fits");
        assert_eq!(first, second, "byte for byte");
        let num_known = merged.visits().len() + merged.given_up().len();
        assert_eq!(num_known, 600);
    }
}
