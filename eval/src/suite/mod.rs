//! What is measured on what?
//!
//! A suite is a TOML file, one of those in `eval/suites/` (embedded here) or anybody's own: a
//! dataset, a protocol that keeps queries apart from what is learnt, the numbers of features n, and
//! *arms*: a preset with the methods, models and scores to run it with. Suites hold no results and
//! no thresholds. [`Suite::of_folder`] makes one for a folder of images.

mod arm;
mod protocol;

use std::path::{Path, PathBuf};

use chronotope::{Error, ErrorKind, Result};
use serde::Deserialize;

use crate::results::Tolerance;
pub use arm::{Arm, Model, Ranking, Run, shipped};
pub use protocol::{Form, GridExperiment, Protocol, World};

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
    (
        "stromovka-one",
        include_str!("../../suites/stromovka-one.toml"),
    ),
    (
        "michigan-one",
        include_str!("../../suites/michigan-one.toml"),
    ),
    ("lasvegas", include_str!("../../suites/lasvegas.toml")),
    ("floors", include_str!("../../suites/floors.toml")),
    ("floors-one", include_str!("../../suites/floors-one.toml")),
    ("corridor", include_str!("../../suites/corridor.toml")),
    ("witham", include_str!("../../suites/witham.toml")),
    ("nclt", include_str!("../../suites/nclt.toml")),
    ("tilde", include_str!("../../suites/tilde.toml")),
    ("door", include_str!("../../suites/door.toml")),
    ("door2016", include_str!("../../suites/door2016.toml")),
    ("aruba", include_str!("../../suites/aruba.toml")),
    ("edges", include_str!("../../suites/edges.toml")),
    ("grid-office", include_str!("../../suites/grid-office.toml")),
    ("grid-patrol", include_str!("../../suites/grid-patrol.toml")),
    ("grid-boxes", include_str!("../../suites/grid-boxes.toml")),
    (
        "grid-presence",
        include_str!("../../suites/grid-presence.toml"),
    ),
    ("grid-carmen", include_str!("../../suites/grid-carmen.toml")),
    ("synthetic", include_str!("../../suites/synthetic.toml")),
    ("foreign", include_str!("../../suites/foreign.toml")),
    ("ablation", include_str!("../../suites/ablation.toml")),
    (
        "explore-aruba",
        include_str!("../../suites/explore-aruba.toml"),
    ),
    (
        "explore-witham",
        include_str!("../../suites/explore-witham.toml"),
    ),
    (
        "explore-lasvegas",
        include_str!("../../suites/explore-lasvegas.toml"),
    ),
    (
        "explore-aruba-travel",
        include_str!("../../suites/explore-aruba-travel.toml"),
    ),
];

/// What is run on somebody's own images: the default beside all baselines.
const OWN_ARMS: &str = include_str!("../../suites/own-arms.toml");

/// Where the dataset of a suite is.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Home {
    /// In the folder that the user names: the dataset of a supported name, or its own folder there.
    #[default]
    Data,
    /// As above, or beside the suite's own file, which is in this folder.
    SuiteFile(PathBuf),
    /// The very folder or manifest that the user names.
    Own,
}

/// One suite: what is measured on what.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Suite {
    /// Its name in commands and files.
    #[serde(skip)]
    pub name: String,
    /// Its question, in one line.
    pub title: String,
    /// The name of a manifest in `datasets/`, or of a folder of images, or a manifest's path; or
    /// `synthetic`.
    pub dataset: String,
    /// Where that is.
    #[serde(skip)]
    pub home: Home,
    /// How far from the true place an answer may be to count as right within.
    pub tolerance: Option<Tolerance>,
    /// How queries are kept apart from what is learnt.
    pub protocol: Protocol,
    /// Numbers of features a place, ascending.
    #[serde(default = "default_sizes")]
    pub sizes: Vec<usize>,
    /// Whether only re-observation is judged, because distinguishing the places is too easy.
    #[serde(default)]
    pub visibility_only: bool,
    /// Whether errors are also given for each day of the queries, in notes.
    #[serde(default)]
    pub by_day: bool,
    /// What is run: the default beside all baselines where left out, but nothing in a suite of
    /// series, which runs every temporal model, or of grids.
    #[serde(default)]
    pub arms: Vec<Arm>,
}

fn default_sizes() -> Vec<usize> {
    SIZES.to_vec()
}

impl Suite {
    /// The suites that come with this program: name and text.
    pub fn builtin() -> impl Iterator<Item = Result<Self>> {
        BUILTIN.iter().map(|(name, text)| Self::parse(name, text))
    }

    /// The suite called `name`, or that of the file `name` if it ends in `.toml`.
    pub fn find(name: &str) -> Result<Self> {
        let path = Path::new(name);
        if path
            .extension()
            .is_some_and(|extension| extension == "toml")
        {
            return Self::load(path);
        }
        match BUILTIN.iter().find(|(known, _)| *known == name) {
            Some((name, text)) => Self::parse(name, text),
            None => Err(
                Error::new(ErrorKind::NotFound, format!("there is no suite `{name}`")).with_help(
                    "`chronotope-eval list` shows all; a suite of your own is a file *.toml; your \
                     own images need no suite: `chronotope-eval run --data FOLDER`",
                ),
            ),
        }
    }

    /// The suite in a file; it is called like the file.
    pub fn load(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|cause| Error::io(path, cause))?;
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        let mut suite = Self::parse(&name, &text).map_err(|error| error.with_path(path))?;
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        suite.home = Home::SuiteFile(folder);
        Ok(suite)
    }

    /// The default beside all baselines on the images of one folder or manifest, which the run's
    /// options name.
    pub fn of_folder(
        data: &Path,
        protocol: Protocol,
        tolerance: Option<Tolerance>,
    ) -> Result<Self> {
        let absolute = std::path::absolute(data).map_err(|cause| Error::io(data, cause))?;
        let named = if data.is_dir() {
            absolute.file_name()
        } else {
            absolute.file_stem()
        };
        let name = named.map_or("images".into(), |name| name.to_string_lossy());
        Ok(Self {
            name: name.clone().into_owned(),
            title: format!("The images in {}", data.display()),
            dataset: name.into_owned(),
            home: Home::Own,
            tolerance,
            protocol,
            sizes: default_sizes(),
            visibility_only: false,
            by_day: false,
            arms: own_arms()?,
        })
    }

    /// With another tolerance; fails for a suite that is not of the places of one dataset.
    pub fn with_tolerance(mut self, tolerance: Option<Tolerance>) -> Result<Self> {
        let has_no_places = matches!(
            self.protocol,
            Protocol::Series { .. }
                | Protocol::Explore { .. }
                | Protocol::Grid { .. }
                | Protocol::Synthetic { .. }
                | Protocol::MultiDataset { .. }
        );
        if tolerance.is_some() && has_no_places {
            return Err(Error::new(
                ErrorKind::Config,
                "a tolerance is for the places of one dataset",
            )
            .with_path(format!("{}.toml", self.name))
            .with_help("leave the tolerance out"));
        }
        self.tolerance = tolerance;
        Ok(self)
    }

    /// A path in the suite's file, from where the program runs.
    pub fn resolve(&self, path: &Path) -> PathBuf {
        match &self.home {
            Home::SuiteFile(folder) => folder.join(path),
            Home::Data | Home::Own => path.to_owned(),
        }
    }

    fn parse(name: &str, text: &str) -> Result<Self> {
        let bad = |message: String| {
            Error::new(ErrorKind::Config, message).with_path(format!("{name}.toml"))
        };
        let mut suite: Self = toml::from_str(text).map_err(|cause| bad(cause.to_string()))?;
        name.clone_into(&mut suite.name);
        let has_no_images = matches!(
            suite.protocol,
            Protocol::Series { .. } | Protocol::Explore { .. } | Protocol::Grid { .. }
        );
        if suite.arms.is_empty() && !has_no_images {
            suite.arms = own_arms()?;
        }
        let tolerance = suite.tolerance;
        let suite = suite.with_tolerance(tolerance)?;
        if suite.sizes.is_empty() || suite.sizes.contains(&0) || !suite.sizes.is_sorted() {
            return Err(bad("`sizes` must be ascending numbers from 1".into()));
        }
        if matches!(suite.protocol, Protocol::FewVisits { num_learn: 0 }) {
            return Err(bad("`num-learn` must be at least 1".into()));
        }
        Ok(suite)
    }
}

fn own_arms() -> Result<Vec<Arm>> {
    #[derive(Deserialize)]
    struct Arms {
        arms: Vec<Arm>,
    }
    let arms: Arms = toml::from_str(OWN_ARMS).map_err(|cause| {
        Error::new(ErrorKind::Config, cause.to_string()).with_path("own-arms.toml")
    })?;
    Ok(arms.arms)
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
    fn a_suite_of_ones_own_needs_only_a_title_a_dataset_and_a_protocol() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("walk.toml");
        let write = |text: &str| {
            std::fs::write(&path, text).unwrap();
            Suite::find(path.to_str().unwrap())
        };
        let head = "title = 'mine'\ndataset = 'photos'\n";
        let suite = write(&format!(
            "{head}tolerance = 'edges:2'\nprotocol = {{ kind = 'route', \
             learn-until = '2024-05-01T00:00:00Z' }}"
        ))
        .unwrap();
        assert_eq!(
            (suite.name.as_str(), suite.sizes.len()),
            ("walk", SIZES.len())
        );
        assert_eq!(suite.tolerance, Some(Tolerance::Edges(2)));
        assert_eq!(suite.resolve(Path::new("a.csv")), dir.path().join("a.csv"));
        let methods = suite.arms[0].runs(true).unwrap().len();
        assert!(methods >= 6, "{methods} runs");
        let says = |text: &str| write(&format!("{head}{text}")).unwrap_err().to_string();
        for (text, message) in [
            (
                "protocol = { kind = 'route', learn-until = 'May' }",
                "bad time `May`",
            ),
            (
                "protocol = { kind = 'few-visits', num-learn = 0 }",
                "at least 1",
            ),
            (
                "protocol = { kind = 'auto' }\nsizes = [50, 10]",
                "ascending",
            ),
            (
                "tolerance = 'near'\nprotocol = { kind = 'auto' }",
                "no tolerance",
            ),
            (
                "colour = 1\nprotocol = { kind = 'auto' }",
                "unknown field `colour`",
            ),
            (
                "tolerance = 'places:1'\nprotocol = { kind = 'series', form = 'door', share = 1.0 }",
                "one dataset",
            ),
        ] {
            let error = says(text);
            assert!(
                error.contains(message) && error.contains("walk.toml"),
                "{error}"
            );
        }
        let error = Suite::find("walk").unwrap_err().to_string();
        assert!(error.contains("--data FOLDER"), "{error}");
    }

    #[test]
    fn the_arms_of_an_ablation_differ_from_the_default_and_in_name() {
        let suite = Suite::find("ablation").unwrap();
        let mut names = std::collections::BTreeSet::new();
        let mut num_defaults = 0;
        for arm in &suite.arms {
            for run in arm.runs(true).unwrap() {
                num_defaults += usize::from(run.localizer == LocalizerConfig::default());
                for ranking in run.rankings() {
                    let name = run.variant(arm.preset, ranking).to_string();
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
