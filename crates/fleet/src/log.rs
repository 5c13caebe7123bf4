//! Which visits are known, from whomever and however often they came?
//!
//! A [`FleetLog`] is a set of statements: at this visit, which is known by its 128-bit identity, this
//! feature of this place was seen, or not. The same statement again changes nothing, in whatever order and
//! from whichever file it comes, so logs merge as sets do: commutative, associative, idempotent. A
//! statement that contradicts another (the other state, or another time of the visit) is an error.
//!
//! About 100 bytes a visit and 24 for every 64 features at it.

use std::collections::HashMap;

use fremen::{Error, ErrorKind, Result, Time};

use crate::states::{Added, Block, States};

/// Bytes of a visit in memory beside its blocks, about: its entry and its place in the index.
const VISIT_BYTES: usize = 112;

/// One visit of one place.
#[derive(Clone, Debug)]
pub struct Visit {
    /// What no other visit is called.
    pub id: u128,
    /// When it was.
    pub time: Time,
    /// What was observed.
    pub states: States,
}

/// Two statements that cannot both be true.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Contradiction {
    /// The place's key.
    pub place: String,
    /// The visit's identity.
    pub visit: u128,
    /// The feature that is said to be both seen and not seen; none if the visit has two times.
    pub feature: Option<u32>,
}

impl From<Contradiction> for Error {
    fn from(it: Contradiction) -> Self {
        let (place, visit) = (it.place.escape_debug().to_string(), it.visit);
        let message = match it.feature {
            Some(feature) => format!(
                "feature {feature} of place `{place}` is said to be both seen and not seen at visit {visit:032x}"
            ),
            None => {
                format!("visit {visit:032x} of place `{place}` is said to have been at two times")
            }
        };
        Self::new(ErrorKind::Format, message).with_help(
            "give every visit an identity of its own, or drop the statement that is wrong",
        )
    }
}

/// The visits of one place.
#[derive(Clone, Debug)]
pub struct PlaceLog {
    key: String,
    visits: Vec<Visit>,
    /// Where the visit of an identity is.
    index: HashMap<u128, u32>,
    num_bytes: usize,
}

impl PlaceLog {
    /// No visits.
    pub fn new(key: impl Into<String>) -> Self {
        Self {
            key: key.into(),
            visits: Vec::new(),
            index: HashMap::new(),
            num_bytes: 0,
        }
    }

    /// The place's key.
    pub fn key(&self) -> &str {
        &self.key
    }

    /// Its visits, in order of arrival.
    pub fn visits(&self) -> &[Visit] {
        &self.visits
    }

    /// The number of the visit of this identity, which is added if it is not known.
    pub(crate) fn visit(&mut self, id: u128, time: Time) -> Result<usize, Contradiction> {
        let next = self.visits.len() as u32;
        let at = *self.index.entry(id).or_insert(next) as usize;
        if at == self.visits.len() {
            let states = States::new();
            self.visits.push(Visit { id, time, states });
            self.num_bytes += VISIT_BYTES;
        }
        if self.visits[at].time == time {
            Ok(at)
        } else {
            Err(self.contradiction(id, None))
        }
    }

    /// Adds observations of the visit of a number: features, none of them negative, and their states.
    pub(crate) fn add_run(
        &mut self,
        visit: usize,
        features: &[i32],
        states: &[bool],
    ) -> Result<(), Contradiction> {
        let known = &mut self.visits[visit].states;
        let num_blocks = known.blocks().len();
        let mut near = 0;
        let mut refused = None;
        for (&feature, &state) in features.iter().zip(states) {
            let feature = feature.cast_unsigned();
            if known.add(&mut near, feature, state) == Added::Contradicts {
                refused = Some(feature);
                break;
            }
        }
        self.num_bytes += (known.blocks().len() - num_blocks) * size_of::<Block>();
        match refused {
            None => Ok(()),
            feature => Err(self.contradiction(self.visits[visit].id, feature)),
        }
    }

    /// Adds all that is known of a visit.
    pub fn add_visit(
        &mut self,
        id: u128,
        time: Time,
        states: &States,
    ) -> Result<(), Contradiction> {
        let at = self.visit(id, time)?;
        let known = &mut self.visits[at].states;
        let num_blocks = known.blocks().len();
        let merged = known.merge(states);
        self.num_bytes += (known.blocks().len() - num_blocks) * size_of::<Block>();
        merged.map_err(|feature| self.contradiction(id, Some(feature)))
    }

    /// Adds what `other` knows.
    pub(crate) fn merge(&mut self, other: &Self) -> Result<(), Contradiction> {
        (other.visits.iter()).try_for_each(|it| self.add_visit(it.id, it.time, &it.states))
    }

    fn contradiction(&self, visit: u128, feature: Option<u32>) -> Contradiction {
        Contradiction {
            place: self.key.clone(),
            visit,
            feature,
        }
    }

    /// Observations, each counted once.
    pub fn num_observations(&self) -> u64 {
        let counts = self.visits.iter().map(|it| it.states.num_observed() as u64);
        counts.sum()
    }
}

/// The visits of all places.
#[derive(Clone, Debug, Default)]
pub struct FleetLog {
    places: Vec<PlaceLog>,
    /// Where the place of a key is.
    index: HashMap<String, u32>,
}

impl FleetLog {
    /// No places.
    pub fn new() -> Self {
        Self::default()
    }

    /// The number of the place of this key, which is added if it is not known.
    pub(crate) fn place(&mut self, key: &str) -> usize {
        if let Some(&at) = self.index.get(key) {
            return at as usize;
        }
        let at = self.places.len();
        self.index.insert(key.to_owned(), at as u32);
        self.places.push(PlaceLog::new(key));
        at
    }

    pub(crate) fn place_mut(&mut self, at: usize) -> &mut PlaceLog {
        &mut self.places[at]
    }

    /// Adds one observation; numbers of features are below 2^31.
    pub fn add(
        &mut self,
        place: &str,
        visit: u128,
        time: Time,
        feature: u32,
        state: bool,
    ) -> Result<(), Contradiction> {
        let at = self.place(place);
        let place = self.place_mut(at);
        let visit = place.visit(visit, time)?;
        place.add_run(visit, &[feature.cast_signed()], &[state])
    }

    /// Adds several observations of one visit; numbers of features are below 2^31.
    pub fn add_all(
        &mut self,
        place: &str,
        visit: u128,
        time: Time,
        states: impl IntoIterator<Item = (u32, bool)>,
    ) -> Result<(), Contradiction> {
        let at = self.place(place);
        let place = self.place_mut(at);
        let visit = place.visit(visit, time)?;
        let (features, states): (Vec<_>, Vec<_>) = (states.into_iter())
            .map(|(feature, state)| (feature.cast_signed(), state))
            .unzip();
        place.add_run(visit, &features, &states)
    }

    /// What both know. Fails at the first contradiction.
    pub fn merge(self, other: Self) -> Result<Self, Contradiction> {
        let (mut merged, fewer) = if self.places.len() < other.places.len() {
            (other, self)
        } else {
            (self, other)
        };
        for place in &fewer.places {
            let at = merged.place(&place.key);
            merged.places[at].merge(place)?;
        }
        Ok(merged)
    }

    /// The places in order of their keys.
    pub fn places(&self) -> Vec<&PlaceLog> {
        let mut places: Vec<_> = self.places.iter().collect();
        places.sort_unstable_by(|a, b| a.key.cmp(&b.key));
        places
    }

    /// Observations, each counted once.
    pub fn num_observations(&self) -> u64 {
        self.places.iter().map(PlaceLog::num_observations).sum()
    }

    /// Visits of all places.
    pub fn num_visits(&self) -> usize {
        self.places.iter().map(|place| place.visits.len()).sum()
    }

    /// Memory that the visits take, about.
    pub fn num_bytes(&self) -> usize {
        self.places.iter().map(|place| place.num_bytes).sum()
    }
}
