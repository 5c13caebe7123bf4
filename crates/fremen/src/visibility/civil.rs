//! What will be visible by the clocks of people?
//!
//! People keep office hours by the clocks on their walls, not by UTC: when summer time begins or
//! ends, the rhythms of a place shift by an hour. A [`Civil`] model was learnt from the times that
//! clocks in a zone showed ([`Zone::wall`]), and predicts for what they show then.

use super::VisibilityModel;
use super::codec;
use super::model::Estimate;
use crate::error::Result;
use crate::spectrum::{Component, Reader};
use crate::time::{Time, Zone};

/// A model of civil time round another one: `p(t) = p_of(wall(t))`. One look-up in the zone's rules
/// a prediction.
///
/// Phases of its [`components`](VisibilityModel::components) count from the epoch by those clocks.
#[derive(Debug)]
pub struct Civil {
    of: Box<dyn VisibilityModel>,
    zone: Zone,
}

impl Civil {
    /// `of` was learnt from what clocks in `zone` showed.
    pub(super) fn new(of: Box<dyn VisibilityModel>, zone: Zone) -> Self {
        Self { of, zone }
    }

    pub(super) fn read(reader: &mut Reader<'_>, of: Box<dyn VisibilityModel>) -> Result<Self> {
        let name = std::str::from_utf8(reader.bytes()?).ok();
        match name.map(Zone::new) {
            Some(Ok(zone)) => Ok(Self { of, zone }),
            _ => Err(reader.impossible("this is no time zone")),
        }
    }

    /// The zone whose clocks count.
    pub fn zone(&self) -> &Zone {
        &self.zone
    }
}

impl VisibilityModel for Civil {
    fn num_features(&self) -> usize {
        self.of.num_features()
    }

    fn predict_into(&self, time: Time, out: &mut [f64]) {
        self.of.predict_into(self.zone.wall(time), out);
    }

    fn predict_one(&self, feature: usize, time: Time) -> f64 {
        self.of.predict_one(feature, self.zone.wall(time))
    }

    fn score_into(&self, time: Time, out: &mut [f64]) {
        self.of.score_into(self.zone.wall(time), out);
    }

    fn estimate(&self, feature: usize, time: Time) -> Estimate {
        self.of.estimate(feature, self.zone.wall(time))
    }

    fn mean(&self, feature: usize) -> Option<f64> {
        self.of.mean(feature)
    }

    fn order(&self) -> usize {
        self.of.order()
    }

    fn level(&self, feature: usize) -> Option<f64> {
        self.of.level(feature)
    }

    fn components(&self, feature: usize) -> Vec<Component> {
        self.of.components(feature)
    }

    /// `None` if the model of the clocks has no such form.
    fn encode(&self) -> Option<Vec<u8>> {
        let of = self.of.encode()?;
        Some(codec::encode(codec::Kind::Civil, |writer| {
            writer.bytes(&of);
            writer.bytes(self.zone.name().as_bytes());
        }))
    }
}
