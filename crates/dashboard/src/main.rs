//! The command `chronotope-dashboard`; see `chronotope-dashboard --help`.

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result};
use chronotope_dashboard::{Destination, Page, Recorder, RecorderConfig, TraceReader};
use clap::{ArgGroup, Parser};

/// A viewer on this machine, as `rerun` starts it.
const LOCAL_VIEWER: &str = "rerun+http://127.0.0.1:9876/proxy";

/// Shows what Chronotope believed and why: turns traces into recordings for the rerun viewer.
///
/// The viewer is no part of this program: `pip install rerun-sdk==0.36.3` brings the command `rerun`.
#[derive(Debug, Parser)]
#[command(
    version,
    group = ArgGroup::new("destination").required(true),
    after_help = "\
Examples:
  chronotope localize street.map photos/*.jpg --trace - | chronotope-dashboard --save street.rrd
  rerun street.rrd
  chronotope localize street.map --camera 0 --trace - | chronotope-dashboard --connect
  chronotope-dashboard evidence.jsonl --save evidence.rrd --image-every 10"
)]
struct Args {
    /// The trace, JSON Lines; stdin if it is left out or `-`.
    trace: Option<PathBuf>,
    /// Write a recording.
    #[arg(long, value_name = "OUT.rrd", group = "destination")]
    save: Option<PathBuf>,
    /// Send everything to a viewer that is running.
    #[arg(
        long,
        value_name = "URL",
        group = "destination",
        num_args = 0..=1,
        default_missing_value = LOCAL_VIEWER
    )]
    connect: Option<String>,
    /// Draw at most every Nth picture, with its features; 0: none.
    #[arg(long, value_name = "N", default_value_t = 1)]
    image_every: u64,
    /// Open on the page of histories and rhythms.
    #[arg(long)]
    why: bool,
}

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(num_queries) => {
            eprintln!("recorded {num_queries} localisations");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(2)
        }
    }
}

fn run(args: &Args) -> Result<u64> {
    let (name, input) = open(args.trace.as_deref())?;
    let destination = match (&args.save, &args.connect) {
        (Some(path), _) => Destination::File(path.clone()),
        (None, url) => Destination::Viewer(url.as_deref().unwrap_or(LOCAL_VIEWER).to_owned()),
    };
    let page = if args.why { Page::Why } else { Page::Now };
    let cfg = RecorderConfig::default()
        .with_image_every(args.image_every)
        .with_page(page);
    let mut recorder = Recorder::new(destination, cfg)?;
    let mut reader = TraceReader::new(BufReader::new(input));
    let outcome = loop {
        match reader.next_trace() {
            Ok(Some(trace)) => recorder
                .record(&trace)
                .with_context(|| format!("{name}: line {}", reader.line_number()))?,
            Ok(None) => break Ok(()),
            Err(error) => break Err(error.context(name)),
        }
    };
    // What came before a bad line is kept.
    let num_queries = recorder.finish()?;
    outcome?;
    if num_queries == 0 {
        eprintln!("warning: the trace is empty");
    }
    Ok(num_queries)
}

fn open(trace: Option<&Path>) -> Result<(String, Box<dyn Read>)> {
    match trace {
        Some(path) if path != Path::new("-") => {
            let name = path.display().to_string();
            let file = File::open(path).with_context(|| format!("cannot read {name}"))?;
            Ok((name, Box::new(file)))
        }
        _ => Ok(("stdin".into(), Box::new(io::stdin().lock()))),
    }
}
