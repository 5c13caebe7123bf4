//! What does `SUITE.json` of a suite of grids hold?

use fremen_grid::experiment::Gallery;
use serde::Serialize;
use std::collections::BTreeMap;

use crate::judge::statistics::{Estimate, Sample, wilson};
use crate::suite::Suite;

/// The version of the file.
const SCHEMA_VERSION: u32 = 1;

/// A number, with its 95 % interval where it has one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Cell {
    /// The measured value.
    pub value: f64,
    /// Lower end of the interval.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub low: Option<f64>,
    /// Upper end of the interval.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub high: Option<f64>,
}

impl Cell {
    /// A number that is what it is.
    pub const fn exact(value: f64) -> Self {
        Self {
            value,
            low: None,
            high: None,
        }
    }

    /// With an interval.
    pub const fn between(value: f64, low: f64, high: f64) -> Self {
        Self {
            value,
            low: Some(low),
            high: Some(high),
        }
    }

    /// A share of `num` independent cases, in %, with Wilson's interval.
    pub fn share(count: usize, num: usize) -> Self {
        let interval = wilson(count as f64, num).scaled(100.0);
        let value = 100.0 * count as f64 / num.max(1) as f64;
        Self::between(value, interval.low, interval.high)
    }

    /// A ratio in % of counts that come from worlds: whole worlds are drawn again.
    pub fn ratio_of_worlds(worlds: impl IntoIterator<Item = (u64, u64)>) -> Self {
        let blocks = worlds
            .into_iter()
            .map(|(part, all)| (part as f64, all as f64));
        let Estimate { mean, interval } = Sample::of_blocks(blocks).estimate();
        Self::between(100.0 * mean, 100.0 * interval.low, 100.0 * interval.high)
    }
}

/// A column of a table.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Column {
    /// Its name in the rows.
    pub key: String,
    /// Its heading.
    pub heading: String,
    /// How many digits are shown behind the point.
    pub decimals: usize,
}

/// One row: a model, a map, a range.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Its name.
    pub name: String,
    /// What this project ships.
    pub is_default: bool,
    /// By the keys of the columns.
    pub values: BTreeMap<String, Cell>,
}

/// One table.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GridTable {
    /// Its name in links.
    pub id: String,
    /// Its question.
    pub title: String,
    /// What the rows are.
    pub of: String,
    /// In the order in which they are shown.
    pub columns: Vec<Column>,
    /// Every row.
    pub rows: Vec<Row>,
}

impl GridTable {
    /// An empty table; columns by key, heading and decimals.
    pub(super) fn new(id: &str, title: &str, of: &str, columns: &[(&str, &str, usize)]) -> Self {
        let columns = columns.iter().map(|&(key, heading, decimals)| Column {
            key: key.to_owned(),
            heading: heading.to_owned(),
            decimals,
        });
        Self {
            id: id.to_owned(),
            title: title.to_owned(),
            of: of.to_owned(),
            columns: columns.collect(),
            rows: Vec::new(),
        }
    }

    /// Adds a row with values in the order of the columns.
    pub(super) fn push(&mut self, name: &str, is_default: bool, values: &[Option<Cell>]) {
        let keys = self.columns.iter().map(|column| column.key.clone());
        let known = keys.zip(values);
        self.rows.push(Row {
            name: name.to_owned(),
            is_default,
            values: known.filter_map(|(key, it)| Some((key, (*it)?))).collect(),
        });
    }

    /// A value of a row.
    pub fn value(&self, row: &str, key: &str) -> Option<Cell> {
        let row = self.rows.iter().find(|it| it.name == row)?;
        row.values.get(key).copied()
    }
}

/// What is wanted, and what was measured.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Target {
    /// What is wanted, in words with the number.
    pub wanted: String,
    /// What was measured, in words.
    pub measured: String,
    /// Whether that is enough.
    pub is_met: bool,
}

/// A line over something.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// Its name.
    pub name: String,
    /// Points, ascending in x.
    pub points: Vec<(f64, f64)>,
}

/// Curves with common axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    /// Its question.
    pub title: String,
    /// What lies along x, and what along y.
    pub axes: [String; 2],
    /// The lines.
    pub curves: Vec<Curve>,
}

/// A picture of a map.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// What it shows.
    pub title: String,
    /// The bytes of a PNG.
    pub png: Vec<u8>,
}

/// The file `SUITE.json` of a suite of grids, and what its report draws.
#[derive(Clone, Debug, Serialize)]
pub struct GridResults {
    /// The version of the file format, 1.
    pub schema_version: u32,
    /// The suite's name.
    pub suite: String,
    /// The question of the suite.
    pub title: String,
    /// The revision that was measured.
    pub commit: String,
    /// What it ran on.
    pub machine: String,
    /// The line that produces the file again.
    pub command: String,
    /// What was measured on what, in words.
    pub setup: Vec<String>,
    /// Anything else that the reader should know.
    pub notes: Vec<String>,
    /// Every table.
    pub tables: Vec<GridTable>,
    /// What was wanted and what became of it.
    pub targets: Vec<Target>,
    /// Lines of the report.
    #[serde(skip)]
    pub plots: Vec<Plot>,
    /// Pictures of the report, in groups with a heading and a hint.
    #[serde(skip)]
    pub pictures: Vec<(String, String, Vec<Picture>)>,
}

impl GridResults {
    pub(super) fn new(suite: &Suite) -> Self {
        Self {
            schema_version: SCHEMA_VERSION,
            suite: suite.name.clone(),
            title: suite.title.clone(),
            commit: String::new(),
            machine: String::new(),
            command: String::new(),
            setup: Vec::new(),
            notes: Vec::new(),
            tables: Vec::new(),
            targets: Vec::new(),
            plots: Vec::new(),
            pictures: Vec::new(),
        }
    }

    /// The table of this name.
    pub fn table(&self, id: &str) -> Option<&GridTable> {
        self.tables.iter().find(|table| table.id == id)
    }

    pub(super) fn target(&mut self, is_met: bool, wanted: &str, measured: String) {
        self.targets.push(Target {
            wanted: wanted.to_owned(),
            measured,
            is_met,
        });
    }

    /// Hours of a day beside the truth, and below them the rhythms of the cells.
    pub(super) fn gallery(&mut self, title: &str, hint: &str, colours: &str, gallery: Gallery) {
        let picture = |(title, png): (String, Vec<u8>)| Picture { title, png };
        self.pictures.push((
            title.to_owned(),
            hint.to_owned(),
            gallery.hours.into_iter().flatten().map(picture).collect(),
        ));
        self.pictures.push((
            "Which rhythm has which cell?".into(),
            colours.to_owned(),
            vec![picture(gallery.rhythms)],
        ));
    }
}

/// What was measured on what, and how to measure it again.
pub(crate) fn facts(results: &GridResults) -> Vec<(&'static str, String)> {
    let mut facts: Vec<(&str, String)> = Vec::new();
    facts.extend(results.setup.iter().map(|it| ("Setup", it.clone())));
    facts.extend([
        (
            "Intervals",
            "95 %; shares of independent cases by Wilson, all others by drawing whole worlds again"
                .to_owned(),
        ),
        ("Commit", results.commit.clone()),
        ("Machine", results.machine.clone()),
        ("Command", results.command.clone()),
    ]);
    facts.extend(results.notes.iter().map(|note| ("Note", note.clone())));
    facts
}
