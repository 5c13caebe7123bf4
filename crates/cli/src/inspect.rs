//! What is in this map file, and is it intact?

use anyhow::Result;
use clap::Args;
use serde_json::json;

use chronotope::map::{AppearanceUse, Map, Node};
use chronotope::time::Time;
use chronotope_terminal::arguments::ShownMap;
use chronotope_terminal::output::hex;
use chronotope_terminal::{Outcome, Output};

/// Show what a map holds.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope map inspect street.map
  chronotope map inspect street.map --json | jq .places[].key")]
pub(super) struct InspectArgs {
    #[command(flatten)]
    shown: ShownMap,
}

/// Check every byte of a map file; nothing is changed.
///
/// Exit code 1 if the file is damaged, 2 if it is no map or cannot be read.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope map verify street.map
  chronotope map verify street.map --json")]
pub(super) struct VerifyArgs {
    #[command(flatten)]
    shown: ShownMap,
}

pub(super) fn inspect(args: &InspectArgs, out: &mut Output) -> Result<Outcome> {
    let args = &args.shown;
    let map = Map::open_read_only(&args.map)?;
    let snapshot = map.snapshot();
    let summary = snapshot.summary();
    let meta = snapshot.meta();
    let digest = hex(&snapshot.digest());
    let num_bytes = std::fs::metadata(&args.map).map_or(0, |file| file.len());
    let text = |time: Option<Time>| time.map(|time| time.to_string());
    if args.json {
        let places: Vec<_> = snapshot
            .nodes()
            .iter()
            .map(|node| place_json(node))
            .collect();
        out.json(&json!({
            "map": args.map,
            "num_bytes": num_bytes,
            "uuid": format!("{:032x}", meta.uuid),
            "generation": summary.generation,
            "digest": digest,
            "preset": meta.preset,
            "extractor": meta.extractor,
            "image_size": meta.image_size,
            "crop": meta.crop,
            "zone": meta.zone,
            "num_places": summary.num_places,
            "num_visits": summary.num_visits,
            "num_sessions": summary.num_sessions,
            "num_features": summary.num_features,
            "num_appearances": summary.num_appearances,
            "num_experiences": summary.num_experiences,
            "first": text(summary.first),
            "last": text(summary.last),
            "places": places,
            "edges": snapshot.edges(),
        }))?;
        return Ok(Outcome::Good);
    }
    out.line(format_args!("map          {}", args.map.display()))?;
    out.line(format_args!("bytes        {num_bytes}"))?;
    out.line(format_args!("uuid         {:032x}", meta.uuid))?;
    out.line(format_args!("generation   {}", summary.generation))?;
    out.line(format_args!("digest       {digest}"))?;
    out.line(format_args!("preset       {}", meta.preset))?;
    out.line(format_args!("extractor    {}", meta.extractor))?;
    if let Some((width, height)) = meta.image_size {
        out.line(format_args!("image size   {width} x {height} px"))?;
    }
    if let Some(crop) = meta.crop {
        out.line(format_args!(
            "crop         {} x {} px at ({}, {})",
            crop.width, crop.height, crop.x, crop.y
        ))?;
    }
    if let Some(zone) = &meta.zone {
        out.line(format_args!("zone         {zone}"))?;
    }
    if let (Some(first), Some(last)) = (summary.first, summary.last) {
        out.line(format_args!("times        {first} to {last}"))?;
    }
    out.line(format_args!(
        "visits       {} in {} {}",
        summary.num_visits,
        summary.num_sessions,
        if summary.num_sessions == 1 {
            "session"
        } else {
            "sessions"
        }
    ))?;
    out.line(format_args!("features     {}", summary.num_features))?;
    out.line(format_args!(
        "appearances  {} kept, {} of them experiences",
        summary.num_appearances, summary.num_experiences
    ))?;
    out.line(format_args!("edges        {}", summary.num_edges))?;
    out.line(format_args!("places       {}", summary.num_places))?;
    for node in snapshot.nodes() {
        let pose = node
            .pose()
            .map_or(String::new(), |[x, y, z]| format!(", at ({x}, {y}, {z}) m"));
        out.line(format_args!(
            "  {}: {} visits, {} features{pose}",
            node.key(),
            node.visits().len(),
            node.features().len()
        ))?;
    }
    Ok(Outcome::Good)
}

fn place_json(node: &Node) -> serde_json::Value {
    let (first, last) = node.time_span().unzip();
    let experiences = (node.visits().iter())
        .filter(|visit| visit.appearance_use == AppearanceUse::Experience)
        .count();
    json!({
        "key": node.key(),
        "num_visits": node.visits().len(),
        "num_features": node.features().len(),
        "num_experiences": experiences,
        "first": first.map(|time| time.to_string()),
        "last": last.map(|time| time.to_string()),
        "pose": node.pose(),
    })
}

pub(super) fn verify(args: &VerifyArgs, out: &mut Output) -> Result<Outcome> {
    let args = &args.shown;
    let report = Map::verify(&args.map)?;
    let digest = report.digest.map(|digest| hex(&digest));
    if args.json {
        let faults: Vec<_> = report.faults.iter().map(ToString::to_string).collect();
        out.json(&json!({
            "map": args.map,
            "clean": report.is_clean(),
            "generation": report.generation,
            "digest": digest,
            "num_places": report.num_places,
            "num_visits": report.num_visits,
            "num_features": report.num_features,
            "faults": faults,
        }))?;
    } else if report.is_clean() {
        out.line(format_args!(
            "{}: intact, generation {}, {} places, {} visits, {} features, digest {}",
            args.map.display(),
            report.generation.unwrap_or_default(),
            report.num_places,
            report.num_visits,
            report.num_features,
            digest.unwrap_or_default()
        ))?;
    } else {
        for fault in &report.faults {
            out.line(format_args!("{}: {fault}", args.map.display()))?;
        }
        out.line(format_args!(
            "{}: damaged, {} faults (help: restore a copy, or build it again)",
            args.map.display(),
            report.faults.len()
        ))?;
    }
    Ok(Outcome::of_check(report.is_clean()))
}
