//! What follows from the history of one state?

use super::Series;
use crate::error::{Error, ErrorKind, Result};
use crate::spectrum::Component;
use crate::time::Time;
use crate::visibility::{
    Estimate, VisibilityConfig, VisibilityModel, Visits, decode, fit_cautious,
};

impl Series {
    /// Learns the model for a series of any sampling: [`VisibilityConfig::natural`].
    pub fn learn(&self) -> Result<SeriesModel> {
        self.learn_with(&VisibilityConfig::natural())
    }

    /// Learns the model that `cfg` names, and believes it as far as the samples reach
    /// ([`Cautious`](crate::visibility::Cautious)): at hours that were never sampled, p is near the
    /// mean and its interval wide, and no number of like samples makes p exactly 0 or 1.
    ///
    /// A series without known states gives p = 1/2 at every time.
    pub fn learn_with(&self, cfg: &VisibilityConfig) -> Result<SeriesModel> {
        let model = fit_cautious(&self.to_log()?, cfg, Visits::All)?;
        Ok(SeriesModel { model })
    }
}

/// A sample that a model would not have expected.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Anomaly {
    /// When.
    pub time: Time,
    /// What was observed.
    pub state: bool,
    /// The probability that the model gave to a state of 1.
    pub p: f64,
}

/// What was learnt of a series.
#[derive(Debug)]
pub struct SeriesModel {
    model: Box<dyn VisibilityModel>,
}

impl SeriesModel {
    /// The probability that the state is 1 at a time, in [0, 1].
    pub fn p(&self, time: Time) -> f64 {
        self.model.predict_one(0, time)
    }

    /// The same with its 95 % interval.
    pub fn estimate(&self, time: Time) -> Estimate {
        self.model.estimate(0, time)
    }

    /// The share of samples that are 1, where a burst of samples counts as one; `None` for a model
    /// that does not keep it.
    pub fn mean(&self) -> Option<f64> {
        self.model.mean(0)
    }

    /// What the rhythms swing about; `None` for a model that is not a level and rhythms.
    pub fn level(&self) -> Option<f64> {
        self.model.level(0)
    }

    /// The rhythms, strongest first; none for a model that has none.
    pub fn components(&self) -> Vec<Component> {
        self.model.components(0)
    }

    /// The most rhythms that the model may have.
    pub fn order(&self) -> usize {
        self.model.order()
    }

    /// The states that were given a probability below `1 - confidence` (T-RO 2017 III-D calls these
    /// the times at which the observed and the predicted state differ; `confidence` is 1/2 there).
    ///
    /// Fails with [`ErrorKind::Config`] unless `confidence` is in [1/2, 1].
    pub fn anomalies(&self, series: &Series, confidence: f64) -> Result<Vec<Anomaly>> {
        if !(0.5..=1.0).contains(&confidence) {
            return Err(Error::new(
                ErrorKind::Config,
                format!("a confidence is 0.5 to 1, not {confidence}"),
            ));
        }
        let judged = series.states().iter().map(|&(time, state)| Anomaly {
            time,
            state,
            p: self.p(time),
        });
        Ok(judged
            .filter(|it| (if it.state { it.p } else { 1.0 - it.p }) < 1.0 - confidence)
            .collect())
    }

    /// The mean squared difference of p and state (Brier score); `None` without known states.
    pub fn brier(&self, series: &Series) -> Option<f64> {
        let error =
            |&(time, state): &(Time, bool)| (self.p(time) - f64::from(u8::from(state))).powi(2);
        let total: f64 = series.states().iter().map(error).sum();
        (!series.is_empty()).then(|| total / series.len() as f64)
    }

    /// The model as one of a place with one feature.
    pub fn as_visibility(&self) -> &dyn VisibilityModel {
        &*self.model
    }

    /// The model as bytes; `None` if it is of a kind that has no such form (none of this crate's).
    pub fn encode(&self) -> Option<Vec<u8>> {
        self.model.encode()
    }

    /// What [`encode`](Self::encode) wrote.
    ///
    /// Fails with [`ErrorKind::Checksum`] or [`ErrorKind::Format`] if these bytes are damaged or no
    /// model, and with [`ErrorKind::Shape`] if they are a model of something other than one state.
    pub fn decode(bytes: &[u8]) -> Result<Self> {
        let model = decode(bytes)?;
        match model.num_features() {
            1 => Ok(Self { model }),
            count => Err(Error::new(
                ErrorKind::Shape,
                format!("this is a model of {count} states, not of one"),
            )),
        }
    }
}
