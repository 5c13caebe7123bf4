//! What did every place really show, at every moment?

use fremen::{Error, ErrorKind, Result, Time};

/// The states of all places at the same moments: what a simulation hides from the robot.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recording {
    times: Vec<Time>,
    places: Vec<Place>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
struct Place {
    name: String,
    num_states: usize,
    /// The states at the first moment, at the second, ...
    states: Vec<bool>,
}

impl Recording {
    /// Of moments that ascend and of no places yet.
    ///
    /// Fails without moments, and where a moment is not after the one before it.
    pub fn new(times: Vec<Time>) -> Result<Self> {
        if times.is_empty() {
            return Err(shape("a recording without any moment".into()));
        }
        let late = times
            .iter()
            .zip(&times[1..])
            .find(|(before, after)| after <= before);
        if let Some((before, after)) = late {
            return Err(Error::new(
                ErrorKind::Time,
                format!("{after} does not come after {before}"),
            )
            .with_help("sort the rows by time, and keep one of equal times"));
        }
        let places = Vec::new();
        Ok(Self { times, places })
    }

    /// Adds a place: its states at the first moment, then at the second, and so on.
    ///
    /// Fails unless there are `num_states` (at least 1) for each moment, or if the name is taken.
    pub fn push(
        &mut self,
        name: impl Into<String>,
        num_states: usize,
        states: Vec<bool>,
    ) -> Result<()> {
        let name = name.into();
        if num_states == 0 || states.len() != num_states * self.times.len() {
            return Err(shape(format!(
                "{} states are not {num_states} at each of {} moments",
                states.len(),
                self.times.len()
            ))
            .with_place(format!("place `{name}`")));
        }
        if self.places.iter().any(|place| place.name == name) {
            return Err(Error::new(
                ErrorKind::AlreadyExists,
                format!("there are two places `{name}`"),
            ));
        }
        self.places.push(Place {
            name,
            num_states,
            states,
        });
        Ok(())
    }

    /// The moments, ascending.
    pub fn times(&self) -> &[Time] {
        &self.times
    }

    /// Places.
    pub fn num_places(&self) -> usize {
        self.places.len()
    }

    /// The name of a place and the number of its states.
    pub fn place(&self, place: usize) -> (&str, usize) {
        let place = &self.places[place];
        (&place.name, place.num_states)
    }

    /// Names and numbers of states of all places.
    pub fn places(&self) -> impl Iterator<Item = (&str, usize)> {
        (self.places.iter()).map(|place| (place.name.as_str(), place.num_states))
    }

    /// The states of `place` at moment `index`.
    ///
    /// # Panics
    /// If there is no such place or moment.
    pub fn states(&self, place: usize, index: usize) -> &[bool] {
        let place = &self.places[place];
        &place.states[index * place.num_states..(index + 1) * place.num_states]
    }

    /// Indices of the moments in `[from, to)`.
    pub fn between(&self, from: Time, to: Time) -> std::ops::Range<usize> {
        let at = |time: Time| self.times.partition_point(|&moment| moment < time);
        at(from)..at(to)
    }
}

fn shape(message: String) -> Error {
    Error::new(ErrorKind::Shape, message)
}
