//! The command `chronotope-eval`; see `chronotope-eval --help`.
//!
//! It stands in the library so that crates/dashboard builds it in one go with its tests.
#![allow(clippy::print_stdout)] // reason: tables are this command's output.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use crate::explore;
use crate::grid;
use crate::judge::pooled::{POOLED_SUITES, compare_pooled};
use crate::judge::{compare, exact};
use crate::report::{self, ReportInput};
use crate::results::{SuiteResults, Tolerance, write_atomically, write_json};
use crate::run::replay;
use crate::run::{RunOptions, run};
use crate::series;
use crate::soak::live::{self, LiveOptions};
use crate::soak::visits::{self, SoakOptions};
use crate::speed::{self, SpeedOptions};
use crate::suite::{Protocol, Suite};
use anyhow::{Context, Result, ensure};
use chronotope::Time;
use chronotope::feature::{ExtractorConfig, Models};
use clap::{Parser, Subcommand};
use serde::Serialize;

/// Measures how well Chronotope's methods localise, on real and synthetic images.
#[derive(Parser)]
#[command(
    version,
    after_help = "Examples:
  chronotope-eval list
  chronotope-eval run synthetic --out target/demo
  chronotope-eval run --data my-photos/ --query my-photos-of-june/
  chronotope-eval run stromovka-loo --data ~/datasets --out target/eval
  chronotope-eval compare old/lasvegas.json target/eval/lasvegas.json"
)]
struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Shows the suites.
    List,
    /// Runs a suite: prints its table, writes SUITE.json and report.html.
    Run(RunArgs),
    /// Answers a suite's queries once more by the default, for a trace or a recording; judges
    /// nothing.
    Replay(ReplayArgs),
    /// Compares two runs query by query.
    Compare {
        /// The file SUITE.json of the first run.
        a: PathBuf,
        /// The file SUITE.json of the second run.
        b: PathBuf,
        /// Every field must be the same, but for commit, machine, command and times.
        #[arg(long)]
        exact: bool,
    },
    /// Compares the default with every baseline, pooled over the runs in a folder.
    Pooled {
        /// The folder of stromovka-loo.json, michigan-loo.json, lasvegas.json and synthetic.json.
        dir: PathBuf,
        /// Numbers of features per place.
        #[arg(long, value_delimiter = ',', default_values_t = [30, 50])]
        n: Vec<u32>,
    },
    /// Times temporal models next to plain sums; search, extraction and whole answers next to
    /// OpenCV, `hnsw_rs` and FAISS.
    Speed(SpeedArgs),
    /// Visits one place of the rendered street again and again: size, memory, time and accuracy in
    /// tenths.
    Soak(SoakOptions),
    /// Drives round the rendered street for an hour, learning while it localises, with a camera and
    /// a clock that fail.
    SoakLive(LiveOptions),
}

/// A suite and its data.
#[derive(clap::Args)]
struct SuiteArgs {
    /// The suite (see `list`) or a file of your own (*.toml); left out, the images in DATA are
    /// evaluated, which may be any folder or manifest that `chronotope map build` reads.
    suite: Option<String>,
    /// The dataset's folder, or the folder that holds several datasets.
    #[arg(long, env = "CHRONOTOPE_DATA")]
    data: Option<PathBuf>,
    /// How far from the true place an answer may be to count as right as well: places:K along the
    /// route, edges:K by edges.csv, or metres:R by the poses of the places.
    #[arg(long)]
    tolerance: Option<Tolerance>,
    #[command(flatten)]
    protocol: ProtocolArgs,
}

/// What is learnt and what is queried of a folder of images; by default the split of its manifest,
/// else one visit is left out where places have few, else the latest quarter is queried.
#[derive(clap::Args)]
#[group(multiple = false)]
struct ProtocolArgs {
    /// Without a suite: learn the images before this time, query the others.
    #[arg(long, value_name = "TIME", value_parser = Time::parse)]
    learn_until: Option<Time>,
    /// Without a suite: learn and query what a CSV file says, in rows of path,side with the sides
    /// learn and query.
    #[arg(long, value_name = "FILE")]
    split: Option<PathBuf>,
    /// Without a suite: leave each visit of each place out once and query it.
    #[arg(long)]
    leave_one_out: bool,
    /// Without a suite: learn DATA, query the images of this folder or manifest.
    #[arg(long, value_name = "DIR")]
    query: Option<PathBuf>,
}

impl ProtocolArgs {
    fn protocol(self) -> Option<Protocol> {
        if let Some(learn_until) = self.learn_until {
            return Some(Protocol::Route {
                learn_from: None,
                learn_until,
                query_from: None,
                query_until: None,
            });
        }
        if let Some(file) = self.split {
            return Some(Protocol::Listed { file });
        }
        if let Some(query) = self.query {
            return Some(Protocol::OtherFolder { query });
        }
        self.leave_one_out.then_some(Protocol::LeaveOneVisitOut)
    }
}

impl SuiteArgs {
    /// The suite, and the folder of its data.
    fn suite(self) -> Result<(Suite, Option<PathBuf>)> {
        let protocol = self.protocol.protocol();
        let Some(name) = self.suite else {
            let data = self.data.context(
                "name a suite, or the folder of your own images with --data DIR (help: \
                 `chronotope-eval list` shows the suites)",
            )?;
            let suite =
                Suite::of_folder(&data, protocol.unwrap_or(Protocol::Auto), self.tolerance)?;
            return Ok((suite, Some(data)));
        };
        ensure!(
            protocol.is_none(),
            "suite `{name}` says itself what is learnt and queried (help: leave it out to evaluate \
             the images in DATA)"
        );
        let mut suite = Suite::find(&name)?;
        if self.tolerance.is_some() {
            suite = suite.with_tolerance(self.tolerance)?;
        }
        Ok((suite, self.data))
    }
}

/// What finds the features of the images.
#[derive(clap::Args)]
struct FeatureArgs {
    /// Another extractor than the shipped recipe, with what differs from its defaults; values are
    /// JSON. Suites of images run with its features alone, and `compare` pairs such a run with one
    /// without; `speed` times it as well.
    #[arg(long, value_name = "KIND:NAME=VALUE,...")]
    extractor: Option<ExtractorConfig>,
    /// The network of the kind `onnx` (with the cargo feature `onnx`), an ONNX file.
    #[arg(long, value_name = "FILE", requires = "extractor")]
    model: Option<PathBuf>,
}

impl FeatureArgs {
    fn models(&self) -> Models {
        match &self.model {
            Some(file) => Models::from_env().with_file(file),
            None => Models::from_env(),
        }
    }
}

/// What is run.
#[derive(clap::Args)]
struct RunArgs {
    #[command(flatten)]
    suite: SuiteArgs,
    #[command(flatten)]
    features: FeatureArgs,
    /// Where results are written.
    #[arg(long, default_value = "target/eval")]
    out: PathBuf,
    /// Where extracted features are kept from run to run [default: OUT/cache].
    #[arg(long)]
    cache: Option<PathBuf>,
    /// Show this number of features in detail [default: where the default and the static map differ
    /// most].
    #[arg(long)]
    n: Option<u32>,
    /// Suites of series: the share of samples that thinning keeps [default: the suite's].
    #[arg(long)]
    share: Option<f64>,
    /// Synthetic suites, and simulated ones of grids: the number of worlds [default: the suite's].
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..))]
    worlds: Option<u64>,
    #[command(flatten)]
    replays: Replays,
}

/// What is replayed.
#[derive(clap::Args)]
struct ReplayArgs {
    #[command(flatten)]
    suite: SuiteArgs,
    #[command(flatten)]
    features: FeatureArgs,
    /// Where extracted features are kept from run to run.
    #[arg(long, default_value = "target/eval/cache")]
    cache: PathBuf,
    #[command(flatten)]
    replays: Replays,
}

/// What is timed.
#[derive(clap::Args)]
struct SpeedArgs {
    /// A dataset's folder or manifest [default: a rendered street].
    #[arg(long)]
    data: Option<PathBuf>,
    /// Sizes of the maps that are localised in, places.
    #[arg(
        long,
        value_delimiter = ',',
        default_value = "5,8,10,300,1000,3000,10000"
    )]
    nodes: Vec<usize>,
    /// Sizes of the sets that are searched, descriptors.
    #[arg(
        long,
        value_delimiter = ',',
        default_value = "400,40000,500000,1000000"
    )]
    rows: Vec<usize>,
    /// The largest set that `hnsw_rs` builds a graph of; it takes minutes for 100,000 descriptors.
    #[arg(long, default_value_t = 40_000)]
    max_hnsw_rows: usize,
    /// A Python with OpenCV (contrib) and FAISS; `make speed` makes one.
    #[arg(long)]
    python: Option<PathBuf>,
    #[command(flatten)]
    features: FeatureArgs,
    /// Only temporal models next to the papers' sums written plainly.
    #[arg(long)]
    only_temporal: bool,
    /// Where speed.json, speed.txt and growth.svg are written.
    #[arg(long, default_value = "target/speed")]
    out: PathBuf,
    /// Where the run is kept with the sources as well: speed.json, speed.md and growth.svg.
    #[arg(long)]
    record: Option<PathBuf>,
}

/// What the queries of a suite can be watched again by.
#[derive(clap::Args)]
struct Replays {
    /// Also write the evidence of every query of the default, one JSON object a line, with
    /// pictures.
    #[arg(long, value_name = "OUT.jsonl")]
    trace: Option<PathBuf>,
    /// Also write a recording for the rerun viewer.
    #[cfg(feature = "dashboard")]
    #[arg(long, value_name = "OUT.rrd")]
    rerun: Option<PathBuf>,
}

impl Replays {
    fn is_wanted(&self) -> bool {
        #[cfg(feature = "dashboard")]
        let is_recorded = self.rerun.is_some();
        #[cfg(not(feature = "dashboard"))]
        let is_recorded = false;
        self.trace.is_some() || is_recorded
    }

    /// Says before a long run that nothing could be traced.
    fn check(&self, suite: &Suite) -> Result<()> {
        if self.is_wanted() {
            replay::check(suite)?;
        }
        Ok(())
    }

    fn write(&self, suite: &Suite, options: &RunOptions) -> Result<()> {
        if let Some(path) = &self.trace {
            let num = replay::write(suite, options, path)?;
            eprintln!("wrote {num} localisations to {}", path.display());
        }
        #[cfg(feature = "dashboard")]
        if let Some(path) = &self.rerun {
            let num = replay::record(suite, options, path)?;
            eprintln!("recorded {num} localisations in {}", path.display());
        }
        Ok(())
    }
}

/// Does what the arguments of this process say.
pub fn main() -> ExitCode {
    main_of(Args::parse()).unwrap_or_else(|error| {
        eprintln!("error: {}", chronotope::error::describe(error.as_ref()));
        ExitCode::from(2)
    })
}

fn main_of(args: Args) -> Result<ExitCode> {
    match args.command {
        Command::List => {
            for suite in Suite::builtin() {
                let suite = suite?;
                println!("{:<20} {}", suite.name, suite.title);
            }
        }
        Command::Run(args) => run_command(args)?,
        Command::Replay(args) => replay_command(args)?,
        Command::Compare { a, b, exact: true } => {
            let differences = exact::compare_files(&a, &b)?;
            print!("{differences}");
            if differences.num > 0 {
                return Ok(ExitCode::from(1));
            }
        }
        Command::Compare { a, b, .. } => {
            let [a, b] = [SuiteResults::read(&a)?, SuiteResults::read(&b)?];
            println!("{}", compare::compare(&a, &b)?);
        }
        Command::Pooled { dir, n } => pooled_command(&dir, &n)?,
        Command::Soak(options) => print!("{}", visits::run(&options)?),
        Command::SoakLive(options) => print!("{}", live::run(&options)?),
        Command::Speed(args) => speed_command(args)?,
    }
    Ok(ExitCode::SUCCESS)
}

fn run_command(args: RunArgs) -> Result<()> {
    let (suite, data) = args.suite.suite()?;
    args.replays.check(&suite)?;
    ensure!(
        args.share.is_none() || matches!(suite.protocol, Protocol::Series { .. }),
        "--share is for suites of series; `{}` is none",
        suite.name
    );
    ensure!(
        args.worlds.is_none()
            || matches!(
                suite.protocol,
                Protocol::Synthetic { .. } | Protocol::Grid { .. }
            ),
        "--worlds is for synthetic suites; `{}` is none",
        suite.name
    );
    let options = RunOptions {
        data,
        cache: args.cache.unwrap_or_else(|| args.out.join("cache")),
        out: args.out,
        share: args.share,
        worlds: args.worlds,
        models: args.features.models(),
        extractor: args.features.extractor,
        command: command_line(),
    };
    run_suite(&suite, &options, args.n, &args.replays)
}

fn replay_command(args: ReplayArgs) -> Result<()> {
    ensure!(
        args.replays.is_wanted(),
        "a replay needs somewhere to go (help: --trace OUT.jsonl)"
    );
    let (suite, data) = args.suite.suite()?;
    let options = RunOptions {
        data,
        cache: args.cache,
        models: args.features.models(),
        extractor: args.features.extractor,
        command: command_line(),
        ..RunOptions::default()
    };
    args.replays.write(&suite, &options)
}

fn pooled_command(dir: &Path, all_n: &[u32]) -> Result<()> {
    let mut runs = Vec::new();
    for suite in POOLED_SUITES {
        let path = dir.join(format!("{suite}.json"));
        if path.exists() {
            runs.push(SuiteResults::read(&path)?);
        } else {
            eprintln!("note: {} is missing and left out", path.display());
        }
    }
    println!("{}", compare_pooled(&runs, all_n)?);
    Ok(())
}

fn speed_command(args: SpeedArgs) -> Result<()> {
    let options = SpeedOptions {
        data: args.data,
        nodes: args.nodes,
        rows: args.rows,
        max_hnsw_rows: args.max_hnsw_rows,
        python: args.python,
        models: args.features.models(),
        extractor: args.features.extractor,
        only_temporal: args.only_temporal,
        out: args.out,
        command: command_to_keep(args.record.as_deref()),
        record: args.record,
    };
    let report = speed::run(&options)?;
    print!("{}", speed::render(&report));
    eprintln!(
        "wrote speed.json, speed.txt and growth.svg in {}",
        options.out.display()
    );
    Ok(())
}

/// Runs a suite, prints its tables, writes results and reports.
fn run_suite(suite: &Suite, options: &RunOptions, n: Option<u32>, replays: &Replays) -> Result<()> {
    std::fs::create_dir_all(&options.out)
        .with_context(|| format!("cannot create {}", options.out.display()))?;
    if let Some(results) = series::run(suite, options)? {
        let page = report::render_series(&results);
        return keep(
            options,
            &results.suite,
            &results,
            &series::table(&results),
            &page,
        );
    }
    if let Some(results) = grid::run(suite, options)? {
        let page = report::render_grid(&results);
        return keep(
            options,
            &results.suite,
            &results,
            &grid::table(&results),
            &page,
        );
    }
    if let Some(results) = explore::run(suite, options)? {
        let page = report::render_explore(&results);
        return keep(
            options,
            &results.suite,
            &results,
            &explore::table(&results),
            &page,
        );
    }
    for suite_run in run(suite, options)? {
        let (results, pictures) = report::pictures(suite_run)?;
        println!("{}", report::terminal::render(&results, n));
        let json = options.out.join(format!("{}.json", results.suite));
        results.write(&json)?;
        // A suite's own report has one fixed name; that of its control says so.
        let report = match results.suite.strip_prefix(&format!("{}-", suite.name)) {
            Some(part) => options.out.join(format!("report-{part}.html")),
            None => options.out.join("report.html"),
        };
        let input = ReportInput {
            results: &results,
            pictures: &pictures,
        };
        report::write(&input, &report)?;
        eprintln!("wrote {} and {}", json.display(), report.display());
    }
    replays.write(suite, options)
}

/// Prints the table of a suite without images, and writes its numbers and its report.
fn keep(
    options: &RunOptions,
    suite: &str,
    results: &impl Serialize,
    table: &str,
    page: &str,
) -> Result<()> {
    println!("{table}");
    let json = options.out.join(format!("{suite}.json"));
    write_json(results, &json)?;
    let report = options.out.join("report.html");
    write_atomically(&report, page.as_bytes())?;
    eprintln!("wrote {} and {}", json.display(), report.display());
    Ok(())
}

/// The command as typed; what is kept with the sources names no folders of one machine.
fn command_to_keep(record: Option<&Path>) -> String {
    record.map_or_else(command_line, |_| {
        "make speed DATA=DIR RECORD=DIR".to_owned()
    })
}

/// The command as typed, with the program's name instead of its path.
fn command_line() -> String {
    std::iter::once("chronotope-eval".to_owned())
        .chain(std::env::args().skip(1))
        .collect::<Vec<_>>()
        .join(" ")
}
