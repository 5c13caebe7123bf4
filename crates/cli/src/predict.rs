//! What will the places look like then?

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use serde_json::json;

use super::warnings::warn_of_time;
use chronotope::error::{Error, ErrorKind};
use chronotope::localize::{Localizer, Method, Preset};
use chronotope::map::{Map, NodeId, PlaceKey, Snapshot};
use chronotope::predict::{PredictedMap, Selection};
use chronotope::time::Time;
use chronotope_terminal::arguments::ConfigArgs;
use chronotope_terminal::config::{Config, preset_of};
use chronotope_terminal::{Outcome, Output};

/// Show which features of each place are most likely visible at a time.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope predict street.map --time 2024-05-01T08:30:00Z
  chronotope predict street.map --time 2024-05-01T08:30:00+02:00 --node door --n 10
  chronotope predict street.map --time 2024-05-01T08:30:00Z --json")]
pub(super) struct PredictArgs {
    /// The map file.
    #[arg(required_unless_present = "print_config")]
    map: Option<PathBuf>,
    /// When, in RFC 3339 with an offset.
    #[arg(long, required_unless_present = "print_config")]
    time: Option<Time>,
    /// Only this place.
    #[arg(long, value_name = "PLACE")]
    node: Option<String>,
    /// How many features of each place; all, where it has fewer.
    #[arg(long)]
    n: Option<usize>,
    /// One JSON object for each place.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    config: ConfigArgs,
}

pub(super) fn run(args: &PredictArgs, out: &mut Output) -> Result<Outcome> {
    let map = args.map.as_deref().map(Map::open_read_only).transpose()?;
    let preset = (map.as_ref()).map_or(Preset::Default, |map| preset_of(map.snapshot().meta()));
    let mut config = Config::read(args.config.config.as_deref(), preset)?;
    if let Some(n) = args.n {
        config.localize = config.localize.with_selection(Selection::top(n)?);
    }
    if !config.localize.method().predicts() {
        config.localize = config.localize.with_method(Method::Fremen);
    }
    if args.config.print_config {
        return config.print(out);
    }
    let (Some(map), Some(time)) = (map, args.time) else {
        anyhow::bail!("MAP and --time are missing");
    };
    let snapshot = map.snapshot();
    let localizer = Localizer::new(map.snapshot(), config.localize)
        .map_err(|error| error.with_path(map.path()))?;
    let nodes: Vec<NodeId> = match &args.node {
        Some(key) => vec![find(&snapshot, key).map_err(|error| error.with_path(map.path()))?],
        None => (0..snapshot.nodes().len() as u32).map(NodeId).collect(),
    };
    warn_of_time(&snapshot, time, None);
    let mut predicted = PredictedMap::new();
    for id in nodes {
        let Some(model) = localizer.model(id) else {
            continue;
        };
        predicted.predict(model, time, localizer.cfg().selection());
        let node = snapshot.node(id);
        let sure = localizer
            .cautious_model(id)
            .map_err(|error| error.with_path(map.path()))?;
        // The p that places are recognised by, and the interval of what the visits bear out.
        let features = || {
            (predicted.features().iter())
                .zip(predicted.probabilities())
                .map(|(&id, &p)| {
                    let at = sure.estimate(id as usize, time);
                    let interval = (at.low.min(p), at.high.max(p));
                    (id, node.features().keypoints()[id as usize], p, interval)
                })
        };
        if args.json {
            let features: Vec<_> = features()
                .map(|(id, keypoint, p, (low, high))| {
                    json!({
                        "id": id, "x": keypoint.x, "y": keypoint.y,
                        "p": p, "low": low, "high": high,
                    })
                })
                .collect();
            out.json(&json!({
                "place": node.key(),
                "time": time.to_string(),
                "num_features": node.features().len(),
                "features": features,
            }))?;
            continue;
        }
        out.line(format_args!(
            "{} at {time}: {} of {} features",
            node.key(),
            predicted.len(),
            node.features().len()
        ))?;
        out.line("      id        x        y   p(t)  95 % interval")?;
        for (id, keypoint, p, (low, high)) in features() {
            out.line(format_args!(
                "{id:8} {:8.1} {:8.1}  {p:.3}  {low:.3} to {high:.3}",
                keypoint.x, keypoint.y
            ))?;
        }
    }
    Ok(Outcome::Good)
}

fn find(snapshot: &Snapshot, key: &str) -> chronotope::Result<NodeId> {
    let written = snapshot.find(&PlaceKey::written(key)?);
    written
        .or(snapshot.find(&PlaceKey::new(key)?))
        .ok_or_else(|| {
            let mut known: Vec<_> = (snapshot.nodes().iter())
                .map(|node| node.key().as_str())
                .collect();
            let more = if known.len() > 20 { ", ..." } else { "" };
            known.truncate(20);
            Error::new(ErrorKind::NotFound, format!("the map has no place `{key}`"))
                .with_help(format!("it has {}{more}", known.join(", ")))
        })
}
