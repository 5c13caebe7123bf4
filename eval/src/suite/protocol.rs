//! How are queries kept apart from what is learnt?

use std::path::PathBuf;

use chronotope::Time;
use serde::{Deserialize, Deserializer};

/// How queries are kept apart from what is learnt.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "kind", deny_unknown_fields)]
pub enum Protocol {
    /// For each visit number, learn every other visit of each place and query that one.
    LeaveOneVisitOut,
    /// Learn what is before the manifest's split, query what is after it.
    Split,
    /// Runs along a route: learn those of one time, query those of another.
    #[serde(rename_all = "kebab-case")]
    Route {
        /// Earlier images are not learnt.
        #[serde(default, deserialize_with = "optional_time")]
        learn_from: Option<Time>,
        /// Images from here on are not learnt.
        #[serde(deserialize_with = "time")]
        learn_until: Time,
        /// Images from here on are queries; those from `learn-until` on where left out.
        #[serde(default, deserialize_with = "optional_time")]
        query_from: Option<Time>,
        /// Images from here on are none.
        #[serde(default, deserialize_with = "optional_time")]
        query_until: Option<Time>,
    },
    /// Learn this many successive visits of each place and query all others; each visit is the
    /// first one that is learnt once, the first of all following the last.
    #[serde(rename_all = "kebab-case")]
    FewVisits {
        /// Visits of each place that are learnt.
        num_learn: usize,
    },
    /// Learn and query what a CSV file says: `path,side` with `learn` or `query`.
    #[serde(rename_all = "kebab-case")]
    Listed {
        /// The file; relative to the suite's.
        file: PathBuf,
    },
    /// Learn the dataset, query all of another one.
    #[serde(rename_all = "kebab-case")]
    OtherFolder {
        /// Its folder or manifest; relative to the suite's file.
        query: PathBuf,
    },
    /// What suits the dataset: its manifest's split; else leave one visit out, where places have
    /// few visits; else learn the earlier images and query the latest quarter.
    Auto,
    /// Single states over time instead of images; see [`series`](crate::series).
    Series {
        /// What their files look like.
        form: Form,
        /// The share of samples that is left where they are thinned.
        share: f64,
    },
    /// Occupancy grids; see [`grid`](crate::grid).
    #[serde(rename_all = "kebab-case")]
    Grid {
        /// What is done with them.
        experiment: GridExperiment,
        /// Where worlds are simulated: the first one's seed.
        #[serde(default)]
        first_seed: u64,
        /// How many of them.
        #[serde(default = "one")]
        num_seeds: u64,
    },
    /// Where to look next; see [`explore`](crate::explore).
    #[serde(rename_all = "kebab-case")]
    Explore {
        /// What is explored.
        world: World,
        /// Seeds `0..num-seeds`.
        num_seeds: u64,
    },
    /// Worlds of these seeds, each with and without rhythms.
    #[serde(rename_all = "kebab-case")]
    Synthetic {
        /// Seeds `1..=num-seeds`.
        num_seeds: u64,
        /// Visits of each place that are learnt.
        num_learn: usize,
        /// Visits of each place that are queried.
        num_query: usize,
    },
    /// The datasets of other suites, each by its own protocol, in one run.
    #[serde(rename_all = "kebab-case")]
    #[serde(rename = "several")]
    MultiDataset {
        /// Names of these suites.
        suites: Vec<String>,
        /// Whether each place's queries are also answered by a map without the place.
        #[serde(default)]
        leave_place_out: bool,
        /// Of a synthetic suite among them, so many worlds.
        #[serde(default = "one")]
        num_seeds: u64,
    },
}

impl Protocol {
    /// Whether queries are whole runs of a robot, image after image.
    pub fn queries_ways(&self) -> bool {
        matches!(
            self,
            Self::Route { .. } | Self::OtherFolder { .. } | Self::Listed { .. }
        )
    }
}

const fn one() -> u64 {
    1
}

fn time<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Time, D::Error> {
    let text = String::deserialize(deserializer)?;
    Time::parse(&text).map_err(serde::de::Error::custom)
}

fn optional_time<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Time>, D::Error> {
    time(deserializer).map(Some)
}

/// What is done with grids.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GridExperiment {
    /// A simulated office in 3-D is watched for weeks (T-RO 2017, section VI).
    Office,
    /// Robots patrol simulated offices (IROS 2016).
    Patrol,
    /// A robot drives through boxes that come and go (the thesis).
    Boxes,
    /// Recorded detections of people: one day predicts others.
    Presence,
    /// Recorded laser scans with corrected poses.
    Carmen,
}

/// The world of a suite of exploration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum World {
    /// One person in ten rooms.
    Aruba,
    /// People in eight areas of an office.
    Witham,
    /// The ten rooms, and driving takes time.
    ArubaTravel,
    /// Features of the views of a camera, which are there or not.
    LasVegas,
}

/// The files of a suite of series.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Form {
    /// `week`, `day7`, `day8`: a door, a sample a second.
    Door,
    /// Ten weeks and a later one: a door, a sample a minute.
    Door2016,
    /// The room of one person, minute by minute.
    Aruba,
    /// Traversals of a robot's topological edges: time, duration, success.
    Edges,
}

impl Form {
    /// The name of its folder.
    pub fn name(self) -> &'static str {
        match self {
            Self::Door => "door",
            Self::Door2016 => "door2016",
            Self::Aruba => "aruba",
            Self::Edges => "edges",
        }
    }
}
