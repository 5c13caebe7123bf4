//! The command `chronotope-dashboard`; see `chronotope-dashboard --help`.

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use chronotope::trace::Trace;
use chronotope_dashboard::{Destination, Page, Recorder, RecorderConfig, TraceReader};
use clap::{ArgGroup, Parser};

/// A viewer on this machine, as `rerun` starts it.
const LOCAL_VIEWER: &str = "rerun+http://127.0.0.1:9876/proxy";

/// Traces that are read ahead of the recording.
const READ_AHEAD: usize = 16;
/// How long a pipe may go on after Ctrl-C, which its writer has received as well and ends by.
const GRACE: Duration = Duration::from_secs(5);
const POLL: Duration = Duration::from_millis(100);

/// Shows what Chronotope believed and why: turns traces into recordings for the rerun viewer.
///
/// The viewer is no part of this program: `pip install rerun-sdk==0.36.3` brings the command
/// `rerun`. Ctrl-C ends the recording as the end of its input does: the file is complete.
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
    let is_pipe = !matches!(args.trace.as_deref(), Some(path) if path != Path::new("-"));
    let mut stop = Stop::new(if is_pipe { GRACE } else { Duration::ZERO })?;
    let traces = read_ahead(input)?;
    let outcome = loop {
        match traces.recv_timeout(POLL) {
            Ok(Ok((line, trace))) => recorder
                .record(&trace)
                .with_context(|| format!("{name}: line {line}"))?,
            Ok(Err(error)) => break Err(error.context(name)),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break Ok(()),
        }
        if stop.is_due() {
            break Ok(());
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

/// Reads on a thread of its own, so that Ctrl-C is noticed while a pipe is silent.
fn read_ahead(input: Box<dyn Read + Send>) -> Result<Receiver<Result<(u64, Trace<'static>)>>> {
    let (sender, traces) = sync_channel(READ_AHEAD);
    std::thread::Builder::new()
        .name("reader".into())
        .spawn(move || {
            let mut reader = TraceReader::new(BufReader::new(input));
            loop {
                let read = reader.next_trace();
                let Some(read) = read
                    .map(|trace| trace.map(|trace| (reader.line_number(), trace)))
                    .transpose()
                else {
                    return;
                };
                let is_bad = read.is_err();
                if sender.send(read).is_err() || is_bad {
                    return;
                }
            }
        })
        .context("no thread to read with")?;
    Ok(traces)
}

/// Whether Ctrl-C requests an end: at once at the second, else once the input has had its time to
/// end.
struct Stop {
    presses: Arc<AtomicU32>,
    grace: Duration,
    since: Option<Instant>,
}

impl Stop {
    fn new(grace: Duration) -> Result<Self> {
        let presses = Arc::new(AtomicU32::new(0));
        let counted = Arc::clone(&presses);
        ctrlc::set_handler(move || {
            counted.fetch_add(1, Ordering::Relaxed);
        })
        .context("Ctrl-C cannot be handled")?;
        Ok(Self {
            presses,
            grace,
            since: None,
        })
    }

    fn is_due(&mut self) -> bool {
        match self.presses.load(Ordering::Relaxed) {
            0 => false,
            1 => self.since.get_or_insert_with(Instant::now).elapsed() >= self.grace,
            _ => true,
        }
    }
}

fn open(trace: Option<&Path>) -> Result<(String, Box<dyn Read + Send>)> {
    match trace {
        Some(path) if path != Path::new("-") => {
            let name = path.display().to_string();
            let file = File::open(path).with_context(|| format!("cannot read {name}"))?;
            Ok((name, Box::new(file)))
        }
        _ => Ok(("stdin".into(), Box::new(io::stdin()))),
    }
}
