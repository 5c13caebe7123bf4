//! What does `SUITE.json` of a suite of exploration hold?

use serde::Serialize;

use crate::series::Measured;

/// The version of the file.
pub(super) const SCHEMA_VERSION: u32 = 1;

/// One way of exploring.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// How visits are chosen.
    pub strategy: String,
    /// What is believed of places.
    pub model: String,
    /// What `chronotope explore` does where nothing else is said.
    pub is_default: bool,
    /// Share of states that are wrong, mean over seeds.
    pub error: Measured,
    /// That of the worst seed.
    pub worst: f64,
    /// What was published, as a share.
    pub published: Option<f64>,
    /// What a visit teaches by its strategy, in bits; with travel times, what a look leaves behind.
    pub bits_a_visit: f64,
    /// The same for an hour of driving and visiting, where driving takes time.
    pub bits_an_hour: Option<Measured>,
    /// Seconds of driving a day.
    pub travel_s_a_day: f64,
    /// Visits that began after their time.
    pub num_late: usize,
    /// Seeds.
    pub num_seeds: u64,
}

/// A line of a plot.
#[derive(Clone, Debug, Serialize)]
pub struct Curve {
    /// Strategy and model.
    pub name: String,
    /// Whether it is the default.
    pub is_default: bool,
    /// Where, and the mean over seeds with its interval.
    pub points: Vec<(f64, Measured)>,
}

/// What the default believed and did on one day, for the report.
#[derive(Clone, Debug)]
pub struct Day {
    /// The number of the day, from 0.
    pub day: usize,
    /// The places that were visited most.
    pub places: Vec<DayPlace>,
}

/// One place on that day.
#[derive(Clone, Debug)]
pub struct DayPlace {
    /// Its name.
    pub name: String,
    /// Hours since midnight.
    pub hours: Vec<f64>,
    /// The state at each of them.
    pub states: Vec<bool>,
    /// p as it was believed then.
    pub p: Vec<f64>,
    /// Its entropy in bits.
    pub bits: Vec<f64>,
    /// From when to when it was visited, in hours.
    pub visits: Vec<(f64, f64)>,
}

/// The file `SUITE.json` of a suite of exploration, and what its report draws.
#[derive(Clone, Debug, Default, Serialize)]
pub struct ExploreResults {
    /// The version of the file format, 1.
    pub schema_version: u32,
    /// The suite's name.
    pub suite: String,
    /// The question of the suite.
    pub title: String,
    /// Of all files.
    pub dataset_sha256: String,
    /// The revision that was measured.
    pub commit: String,
    /// What it ran on.
    pub machine: String,
    /// The line that produces the file again.
    pub command: String,
    /// What is explored, and how, in words.
    pub protocol: String,
    /// Anything else that the reader should know.
    pub notes: Vec<String>,
    /// Each state is always what it is most of the time: share of states that are wrong.
    pub majority: f64,
    /// Each visit goes to the place that the default model has most wrong.
    pub oracle: f64,
    /// Every strategy and model.
    pub rows: Vec<Row>,
    /// Share of wrong states over weeks.
    pub over_weeks: Vec<Curve>,
    /// Of how many days the points over weeks are: 7, or 1 of a short recording.
    pub days_a_point: usize,
    /// Share of wrong states over the share of time for visits; with travel times, bits an hour.
    pub over_share: Vec<Curve>,
    /// What each further look of a day is expected to add, in bits: the mean over days.
    pub next_look_bits: Vec<f64>,
    /// A day of the default.
    #[serde(skip)]
    pub day: Option<Day>,
}

impl ExploreResults {
    /// The default, if it was run.
    pub fn default_row(&self) -> Option<&Row> {
        self.rows.iter().find(|row| row.is_default)
    }
}

/// The mean of some seeds with its 95 % interval (normal).
pub(super) fn measured(values: &[f64]) -> Measured {
    let count = values.len() as f64;
    let value = values.iter().sum::<f64>() / count.max(1.0);
    let squares: f64 = values.iter().map(|it| (it - value).powi(2)).sum();
    let half = 1.96 * (squares / (count - 1.0).max(1.0) / count.max(1.0)).sqrt();
    Measured {
        value,
        low: value - half,
        high: value + half,
    }
}
