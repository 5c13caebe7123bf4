//! What is believed of places whose rhythms follow the clocks of a zone?

use fremen::Time;
use fremen::time::Zone;

use crate::explored::Explored;

/// Places that were learnt by the clocks of a zone, asked by the world's time.
pub struct InZone {
    explored: Box<dyn Explored>,
    zone: Option<Zone>,
}

impl InZone {
    /// `explored` was learnt from times as the clocks of `zone` show them; without a zone times stay
    /// what they are.
    pub fn new(explored: impl Explored + 'static, zone: Option<Zone>) -> Self {
        let explored = Box::new(explored);
        Self { explored, zone }
    }

    fn wall(&self, time: Time) -> Time {
        self.zone.as_ref().map_or(time, |zone| zone.wall(time))
    }
}

impl Explored for InZone {
    fn num_places(&self) -> usize {
        self.explored.num_places()
    }

    fn name(&self, place: usize) -> &str {
        self.explored.name(place)
    }

    fn num_states(&self, place: usize) -> usize {
        self.explored.num_states(place)
    }

    fn predict_into(&self, place: usize, time: Time, out: &mut [f64]) {
        self.explored.predict_into(place, self.wall(time), out);
    }

    fn usual_into(&self, place: usize, time: Time, out: &mut [f64]) {
        self.explored.usual_into(place, self.wall(time), out);
    }

    fn looks(&self, place: usize, time: Time) -> f64 {
        self.explored.looks(place, self.wall(time))
    }

    fn kept(&self, place: usize, age_s: f64) -> f64 {
        self.explored.kept(place, age_s)
    }

    fn kept_squared(&self, place: usize, age_s: f64) -> f64 {
        self.explored.kept_squared(place, age_s)
    }

    fn last_look(&self, place: usize) -> Option<Time> {
        self.explored.last_look(place)
    }
}
