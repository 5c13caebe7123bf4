//! What does the robot believe of each place, and what does it learn from a look?

use fremen::online::{OnlineConfig, OnlineModel};
use fremen::{Error, ErrorKind, Period, Result, Time};

use crate::explored::Explored;

/// An online model for each place.
#[derive(Debug)]
pub struct Beliefs {
    names: Vec<String>,
    models: Vec<Box<dyn OnlineModel>>,
}

impl Beliefs {
    /// Of places of which nothing is known: their names and numbers of states.
    pub fn new(
        places: impl IntoIterator<Item = (impl Into<String>, usize)>,
        cfg: &OnlineConfig,
    ) -> Self {
        let (names, models) = (places.into_iter())
            .map(|(name, num_states)| (name.into(), cfg.build(num_states)))
            .unzip();
        Self { names, models }
    }

    /// Of places whose models the caller has made.
    pub fn of_models(models: Vec<(String, Box<dyn OnlineModel>)>) -> Self {
        let (names, models) = models.into_iter().unzip();
        Self { names, models }
    }

    /// Of places with one state each, learnt from looks of which each is a time, a place and what was
    /// seen there, in any order: as a robot would have, conclusions are drawn once a day.
    ///
    /// Fails if there is no such place.
    pub fn of_looks<N: Into<String>>(
        names: impl IntoIterator<Item = N>,
        cfg: &OnlineConfig,
        mut looks: Vec<(Time, usize, bool)>,
    ) -> Result<Self> {
        looks.sort_by_key(|&(time, place, _)| (time, place));
        let mut beliefs = Self::new(names.into_iter().map(|name| (name, 1)), cfg);
        let day = |time: Time| time.as_us().div_euclid(Period::DAY.as_us());
        let mut today = None;
        for (time, place, state) in looks {
            if today.is_some_and(|today| today != day(time)) {
                beliefs.learn()?;
            }
            today = Some(day(time));
            beliefs.observe(place, time, &[state])?;
        }
        beliefs.learn()?;
        Ok(beliefs)
    }

    /// Takes what was seen at a place.
    ///
    /// Fails if there is no such place, or not that many states.
    pub fn observe(&mut self, place: usize, time: Time, states: &[bool]) -> Result<()> {
        let num_places = self.models.len();
        let Some(model) = self.models.get_mut(place) else {
            return Err(Error::new(
                ErrorKind::NotFound,
                format!("there is no place {place} of {num_places}"),
            ));
        };
        if model.num_states() != states.len() {
            return Err(Error::new(
                ErrorKind::Shape,
                format!(
                    "a look at {} states of a place of {}",
                    states.len(),
                    model.num_states()
                ),
            )
            .with_place(format!("place `{}`", self.names[place])));
        }
        model.observe(time, states);
        Ok(())
    }

    /// Draws conclusions from all that was seen; once a day.
    pub fn learn(&mut self) -> Result<()> {
        (self.models.iter_mut()).try_for_each(|model| model.learn())
    }
}

impl Explored for Beliefs {
    fn num_places(&self) -> usize {
        self.models.len()
    }

    fn name(&self, place: usize) -> &str {
        &self.names[place]
    }

    fn num_states(&self, place: usize) -> usize {
        self.models[place].num_states()
    }

    fn predict_into(&self, place: usize, time: Time, out: &mut [f64]) {
        self.models[place].predict_into(time, out);
    }

    fn usual_into(&self, place: usize, time: Time, out: &mut [f64]) {
        self.models[place].usual_into(time, out);
    }

    fn looks(&self, place: usize, time: Time) -> f64 {
        self.models[place].looks(time)
    }

    fn kept(&self, place: usize, age_s: f64) -> f64 {
        self.models[place].kept(age_s)
    }

    fn kept_squared(&self, place: usize, age_s: f64) -> f64 {
        self.models[place].kept_squared(age_s)
    }

    fn last_look(&self, place: usize) -> Option<Time> {
        self.models[place].last_look()
    }
}
