//! What can be explored?

use fremen::time::Zone;
use fremen::visibility::{HistoryLog, VisibilityConfig, VisibilityModel, Visits, fit};
use fremen::{Error, ErrorKind, Result, Time};

/// Places that a robot can look at, and what is believed of the states that it would see there.
///
/// A room with a person or without, a view with its features, a tile of cells: whatever is 0 or 1
/// and is observed together. [`Beliefs`](crate::Beliefs) learns while a robot explores,
/// [`Fitted`] has models that are fitted already.
pub trait Explored: Sync {
    /// Places.
    fn num_places(&self) -> usize;

    /// The name of a place.
    fn name(&self, place: usize) -> &str;

    /// States that are seen together at a place.
    fn num_states(&self, place: usize) -> usize;

    /// Writes p(`time`) of each state of `place`.
    fn predict_into(&self, place: usize, time: Time, out: &mut [f64]);

    /// Writes what each state usually is at this hour, as if nobody had looked lately.
    fn usual_into(&self, place: usize, time: Time, out: &mut [f64]) {
        self.predict_into(place, time, out);
    }

    /// Independent looks that what is said of `time` rests on: how sure the model is of itself,
    /// which is not how sure it is of the state.
    fn looks(&self, place: usize, time: Time) -> f64;

    /// The share of a state's surprise that is still there `age_s` seconds after it was seen.
    fn kept(&self, place: usize, age_s: f64) -> f64 {
        let _ = (place, age_s);
        0.0
    }

    /// The expectation of the square of that share: more than the square of [`kept`](Self::kept) where
    /// it is not known well.
    fn kept_squared(&self, place: usize, age_s: f64) -> f64 {
        self.kept(place, age_s).powi(2)
    }

    /// When the place was looked at last.
    fn last_look(&self, place: usize) -> Option<Time> {
        let _ = place;
        None
    }
}

/// A name and a fitted model for each place.
///
/// How sure a model is of itself is read from the [intervals](VisibilityModel::estimate) of a few
/// of its states: models fitted by [`fit_cautious`](fremen::visibility::fit_cautious) have them,
/// and `natural` does. For any other it is what the caller says.
#[derive(Debug, Default)]
pub struct Fitted {
    places: Vec<FittedPlace>,
}

#[derive(Debug)]
struct FittedPlace {
    name: String,
    model: Box<dyn VisibilityModel>,
    looks: f64,
    last_look: Option<Time>,
    /// Whether the model has intervals.
    knows_itself: bool,
}

impl Fitted {
    /// No places.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a place whose model was fitted from `looks` independent looks (0 or more), the last of
    /// them at `last_look`.
    ///
    /// Fails if `looks` is no such number, or if the name is taken.
    pub fn push(
        &mut self,
        name: impl Into<String>,
        model: Box<dyn VisibilityModel>,
        looks: f64,
        last_look: Option<Time>,
    ) -> Result<()> {
        let name = name.into();
        if !(looks.is_finite() && looks >= 0.0) {
            return Err(
                Error::new(ErrorKind::Config, format!("{looks} is no number of looks"))
                    .with_place(format!("place `{name}`")),
            );
        }
        if self.places.iter().any(|place| place.name == name) {
            return Err(Error::new(
                ErrorKind::AlreadyExists,
                format!("there are two places `{name}`"),
            ));
        }
        // A model without intervals says from 0 to 1 at any time.
        let knows_itself = model.num_features() > 0 && {
            let estimate = model.estimate(0, Time::default());
            estimate.low > 0.0 || estimate.high < 1.0
        };
        self.places.push(FittedPlace {
            name,
            model,
            looks,
            last_look,
            knows_itself,
        });
        Ok(())
    }

    /// Adds a place with the visits of `log` that were before `before`, learnt by their natural rhythms
    /// and the clocks of `zone`; gives how many visits were later.
    ///
    /// Fails if the name is taken, and if no model can be learnt.
    pub fn push_log(
        &mut self,
        name: impl Into<String>,
        log: &HistoryLog,
        before: Time,
        zone: Option<&Zone>,
    ) -> Result<usize> {
        let mut known = HistoryLog::new();
        for (visit, &time) in log.times().iter().enumerate() {
            if time < before {
                let wall = zone.map_or(time, |zone| zone.wall(time));
                let hidden = log.hidden_row(visit).cloned();
                known.push_visit(wall, log.seen_row(visit).clone(), hidden)?;
            }
        }
        let model = fit(&known, &VisibilityConfig::natural(), Visits::All)?;
        let (looks, last) = (known.num_visits(), known.times().iter().max().copied());
        self.push(name, model, looks as f64, last)?;
        Ok(log.num_visits() - looks)
    }
}

/// The normal distribution has 95 % within so many standard deviations.
const SIGMAS_OF_95: f64 = 1.96;

/// States whose intervals are read.
const NUM_READ: usize = 4;

impl Explored for Fitted {
    fn num_places(&self) -> usize {
        self.places.len()
    }

    fn name(&self, place: usize) -> &str {
        &self.places[place].name
    }

    fn num_states(&self, place: usize) -> usize {
        self.places[place].model.num_features()
    }

    fn predict_into(&self, place: usize, time: Time, out: &mut [f64]) {
        self.places[place].model.predict_into(time, out);
    }

    fn looks(&self, place: usize, time: Time) -> f64 {
        let place = &self.places[place];
        if !place.knows_itself {
            return place.looks;
        }
        let num_states = place.model.num_features();
        let step = num_states.div_ceil(NUM_READ).max(1);
        let (mut sum, mut count) = (0.0, 0.0);
        for state in (0..num_states).step_by(step) {
            let estimate = place.model.estimate(state, time);
            let width = estimate.high - estimate.low;
            let sigma = (width / (2.0 * SIGMAS_OF_95)).max(1e-3);
            let p = estimate.p.clamp(0.01, 0.99);
            sum += (p * (1.0 - p) / (sigma * sigma) - 1.0).max(0.0);
            count += 1.0;
        }
        if count > 0.0 {
            sum / count
        } else {
            place.looks
        }
    }

    fn last_look(&self, place: usize) -> Option<Time> {
        self.places[place].last_look
    }
}

/// Fails where a model says something that is no probability, and names the place.
pub(crate) fn check_p(explored: &dyn Explored, place: usize, time: Time, p: &[f64]) -> Result<()> {
    match p.iter().position(|p| !(0.0..=1.0).contains(p)) {
        None => Ok(()),
        Some(state) => Err(Error::new(
            ErrorKind::Format,
            format!(
                "the model says p = {} of state {state} at {time}, which is no probability",
                p[state]
            ),
        )
        .with_place(format!("place `{}`", explored.name(place)))
        .with_help("a model must give a number from 0 to 1 for every time")),
    }
}
