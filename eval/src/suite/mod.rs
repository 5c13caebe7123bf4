//! What is measured on what?
//!
//! A suite is a TOML file in `eval/suites/` (embedded here): a dataset, a protocol that keeps
//! queries apart from what is learnt, the numbers of features n, and *arms*: a preset with the
//! methods, models and scores to run it with. Suites hold no results and no thresholds.

mod arm;

use chronotope::{Error, ErrorKind, Result};
use serde::Deserialize;

pub use arm::{Arm, Model, Run, shipped};

/// The numbers of features a place that every suite runs unless it says otherwise.
const SIZES: [usize; 13] = [5, 10, 15, 20, 25, 30, 40, 50, 75, 100, 150, 200, 300];

const BUILTIN: &[(&str, &str)] = &[
    (
        "stromovka-loo",
        include_str!("../../suites/stromovka-loo.toml"),
    ),
    (
        "stromovka-split",
        include_str!("../../suites/stromovka-split.toml"),
    ),
    (
        "michigan-loo",
        include_str!("../../suites/michigan-loo.toml"),
    ),
    ("lasvegas", include_str!("../../suites/lasvegas.toml")),
    ("tilde", include_str!("../../suites/tilde.toml")),
    ("door", include_str!("../../suites/door.toml")),
    ("door2016", include_str!("../../suites/door2016.toml")),
    ("aruba", include_str!("../../suites/aruba.toml")),
    ("edges", include_str!("../../suites/edges.toml")),
    ("synthetic", include_str!("../../suites/synthetic.toml")),
    ("foreign", include_str!("../../suites/foreign.toml")),
    ("ablation", include_str!("../../suites/ablation.toml")),
];

/// One suite: what is measured on what.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Suite {
    /// Its name in commands and files.
    #[serde(skip)]
    pub name: String,
    /// Its question, in one line.
    pub title: String,
    /// A manifest in `datasets/`, or `synthetic`.
    pub dataset: String,
    /// How queries are kept apart from what is learnt.
    pub protocol: Protocol,
    /// Numbers of features a place, ascending.
    #[serde(default = "default_sizes")]
    pub sizes: Vec<usize>,
    /// Whether only re-observation is judged, because distinguishing the places is too easy.
    #[serde(default)]
    pub visibility_only: bool,
    /// What is run; nothing in a suite of series, which runs every temporal model.
    #[serde(default)]
    pub arms: Vec<Arm>,
}

fn default_sizes() -> Vec<usize> {
    SIZES.to_vec()
}

/// How queries are kept apart from what is learnt.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "kind", deny_unknown_fields)]
pub enum Protocol {
    /// For each visit number, learn every other visit of each place and query that one.
    LeaveOneVisitOut,
    /// Learn what is before the manifest's split, query what is after it.
    Split,
    /// Single states over time instead of images; see [`series`](crate::series).
    Series {
        /// What their files look like.
        form: Form,
        /// The share of samples that is left where they are thinned.
        share: f64,
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

const fn one() -> u64 {
    1
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

impl Suite {
    /// The suites that come with this program: name and text.
    pub fn builtin() -> impl Iterator<Item = Result<Self>> {
        BUILTIN.iter().map(|(name, text)| Self::parse(name, text))
    }

    /// The suite called `name`.
    pub fn find(name: &str) -> Result<Self> {
        match BUILTIN.iter().find(|(known, _)| *known == name) {
            Some((name, text)) => Self::parse(name, text),
            None => Err(
                Error::new(ErrorKind::NotFound, format!("there is no suite `{name}`"))
                    .with_help("`chronotope-eval list` shows all"),
            ),
        }
    }

    fn parse(name: &str, text: &str) -> Result<Self> {
        let mut suite: Self = toml::from_str(text).map_err(|cause| {
            Error::new(ErrorKind::Config, cause.to_string()).with_path(format!("{name}.toml"))
        })?;
        name.clone_into(&mut suite.name);
        Ok(suite)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use chronotope::localize::{LocalizerConfig, Method, Preset};

    #[test]
    fn every_suite_that_comes_with_the_program_reads_and_runs_something() {
        for suite in Suite::builtin() {
            let suite = suite.unwrap();
            for arm in &suite.arms {
                assert!(!arm.runs(true).unwrap().is_empty(), "{}", suite.name);
                assert!(!arm.scores.is_empty(), "{}", suite.name);
            }
            assert!(suite.sizes.is_sorted(), "{}", suite.name);
        }
    }

    #[test]
    fn the_arms_of_an_ablation_differ_from_the_default_and_in_name() {
        let suite = Suite::find("ablation").unwrap();
        let mut names = std::collections::BTreeSet::new();
        let mut num_defaults = 0;
        for arm in &suite.arms {
            for run in arm.runs(true).unwrap() {
                num_defaults += usize::from(run.localizer == LocalizerConfig::default());
                for &score in &run.scores {
                    let name = run.variant(arm.preset, score).to_string();
                    assert!(names.insert(name.clone()), "{name} is there twice");
                }
            }
        }
        assert_eq!(num_defaults, 1);
        assert!(names.iter().any(|name| name.contains("likeliest")));
    }

    #[test]
    fn without_a_clock_no_method_needs_the_time() {
        let suite = Suite::find("stromovka-loo").unwrap();
        let runs = suite.arms[0].runs(false).unwrap();
        assert!(runs.iter().all(|run| !run.localizer.method().needs_time()));
        assert!(runs.len() >= 3);
        for (has_clock, method) in [(true, Method::Fremen), (false, Method::Static)] {
            let arms = suite
                .arms
                .iter()
                .filter(|arm| arm.preset == Preset::Default);
            let runs: Vec<Run> = arms.flat_map(|arm| arm.runs(has_clock).unwrap()).collect();
            let is_shipped = |run: &&Run| run.localizer == shipped(has_clock);
            let ours: Vec<&Run> = runs.iter().filter(is_shipped).collect();
            assert_eq!(ours.len(), 1, "clock: {has_clock}");
            assert_eq!(ours[0].localizer.method(), method);
        }
    }
}
