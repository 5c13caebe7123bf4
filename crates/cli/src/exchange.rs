//! How do other programs read a map, and how are theirs read?

use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::Args;
use fremen::file::OutputFile;

use super::unpacked::unpacked;
use super::way_map_file::WayMap;
use super::way_maps::{ExportFormat, Origin, to_dot, to_geojson, to_tmap2};
use chronotope::error::{Error, ErrorKind};
use chronotope::feature::{ExtractorConfig, StarBriefConfig};
use chronotope::learn::{self, LearnConfig};
use chronotope::localize::Preset;
use chronotope::map::{
    AppearanceUse, FileStorageMap, Map, MapMeta, Node, PlaceKey, SessionId, Snapshot, Visit,
    VisitId, decode_file_storage, derived_uuid, features_digest,
};
use chronotope_terminal::output::contents;
use chronotope_terminal::{Outcome, Output};

/// Write a map as a folder of plain files: CSV tables and arrays that numpy opens.
///
/// `map import` makes the same map of it again, bit for bit. maps/README.md describes the files.
/// With another --format, one file with the places and the ways between them, for planners and for
/// people.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope map export street.map --out street/
  chronotope map export street.map street/ --canonical
  chronotope map export street.map --parquet --out tables/
  chronotope map export street.map --format tmap2 --out street.tmap2.yaml
  chronotope map export street.map --format geojson --origin 50.0755,14.4378 --out street.geojson
  chronotope map export street.map --format dot --out street.dot")]
pub(super) struct ExportArgs {
    /// The map file.
    map: PathBuf,
    /// The folder to write; must not exist yet, or be empty. With another format, the file.
    #[arg(value_name = "DIR", required_unless_present = "out")]
    folder: Option<PathBuf>,
    /// The same, as other commands have it.
    #[arg(long, value_name = "DIR", conflicts_with = "folder")]
    out: Option<PathBuf>,
    /// Two Parquet tables instead, of observations and of features, as a fleet learns from them
    /// (docs/fleet.md).
    #[arg(long, conflicts_with = "format")]
    parquet: bool,
    /// In the order that `map merge` gives, so that maps that say the same become the same files.
    #[arg(long)]
    canonical: bool,
    /// What to write.
    #[arg(long, value_name = "FORMAT", default_value = "folder")]
    format: ExportFormat,
    /// For geojson: what the positions are counted from, in degrees.
    #[arg(long, value_name = "LATITUDE,LONGITUDE", allow_hyphen_values = true)]
    origin: Option<Origin>,
}

/// Make a map of a folder that `map export` has written, or of maps of the FreMEn authors'
/// benchmark.
///
/// Those are YAML files of OpenCV's `FileStorage`, one a place; the name of the file becomes that
/// of the place. Their times are taken for seconds since 1970. They hold no images' own features,
/// so the experience methods cannot be used with such a map.
///
/// With --onto, a topological map of LCAS (`tmap2`): its nodes give their positions to the places of
/// the same names, and its edges become ways between them. Exit code 1 if the map lacks some.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  chronotope map import street/ --out street.map
  chronotope map import --parquet tables/ --out street.map
  chronotope map import place_0.yaml place_1.yaml --out park.map
  chronotope map import site.tmap2.yaml --onto site.map")]
pub(super) struct ImportArgs {
    /// A folder, or YAML files.
    #[arg(required = true, value_name = "DIR|YAML")]
    from: Vec<PathBuf>,
    /// The folder holds the Parquet tables of observations and of features. They say nothing of
    /// images' own features, positions and ways, so the map has none; nor of extractor, size of
    /// images, crop and time zone, so it has those of a new map.
    #[arg(long, conflicts_with = "onto")]
    parquet: bool,
    /// The file to write; one that exists is never overwritten.
    #[arg(long, value_name = "MAP", required_unless_present = "onto")]
    out: Option<PathBuf>,
    /// A map that nodes and edges of a topological map are added to, as one generation.
    #[arg(long, value_name = "MAP", conflicts_with = "out")]
    onto: Option<PathBuf>,
}

pub(super) fn export(args: &ExportArgs, out: &mut Output) -> Result<Outcome> {
    let mut snapshot = Map::open_read_only(&args.map)?.snapshot();
    if args.canonical {
        snapshot = learn::merge(&[&snapshot])?.into();
    }
    let Some(folder) = args.out.as_ref().or(args.folder.as_ref()) else {
        anyhow::bail!("--out is missing");
    };
    if args.parquet {
        export_tables(&snapshot, folder)?;
        return print_summary(out, folder, &snapshot);
    }
    let name = args.map.file_stem().unwrap_or_default().to_string_lossy();
    let text = match (args.format, args.origin) {
        (ExportFormat::Folder, _) => {
            snapshot.export(folder)?;
            return print_summary(out, folder, &snapshot);
        }
        (ExportFormat::Tmap2, _) => to_tmap2(&snapshot, &name),
        (ExportFormat::Geojson, Some(origin)) => to_geojson(&snapshot, origin),
        (ExportFormat::Geojson, None) => anyhow::bail!(
            "GeoJSON is in degrees (help: say what the map's metres are counted from: --origin \
             LATITUDE,LONGITUDE)"
        ),
        (ExportFormat::Dot, _) => Ok(to_dot(&snapshot, &name)),
    };
    let text = text.map_err(|error| error.with_path(&args.map))?;
    let mut file = OutputFile::begin_new(folder)?;
    file.write_all(text.as_bytes())?;
    file.finish()?;
    out.line(format_args!(
        "{}: {} places, {} ways",
        folder.display(),
        snapshot.nodes().len(),
        snapshot.edges().len()
    ))?;
    Ok(Outcome::Good)
}

pub(super) fn import(args: &ImportArgs, out: &mut Output) -> Result<Outcome> {
    if let Some(map) = &args.onto {
        return import_ways(&args.from, map, out);
    }
    let Some(path) = &args.out else {
        anyhow::bail!("--out is missing");
    };
    Map::refuse_existing(path)?;
    let snapshot = match &args.from[..] {
        [folder] if args.parquet => import_tables(folder)?,
        _ if args.parquet => anyhow::bail!("--parquet takes one folder"),
        [folder] if folder.is_dir() => Snapshot::import(folder)?,
        files => import_yaml(files)?,
    };
    Map::create_from(path, &snapshot)?;
    print_summary(out, path, &snapshot)
}

#[cfg(feature = "parquet")]
use super::tables::{export as export_tables, import as import_tables};

#[cfg(not(feature = "parquet"))]
fn export_tables(_: &Snapshot, folder: &Path) -> Result<()> {
    Err(super::without_parquet(folder))
}

#[cfg(not(feature = "parquet"))]
fn import_tables(folder: &Path) -> Result<Snapshot> {
    Err(super::without_parquet(folder))
}

/// Adds what a topological map says of places that the map has.
fn import_ways(from: &[PathBuf], path: &Path, out: &mut Output) -> Result<Outcome> {
    let [file] = from else {
        anyhow::bail!("--onto takes one topological map");
    };
    let ways = WayMap::read(file)?;
    let map = Map::open(path)?;
    let mut unknown = BTreeSet::new();
    let generation = map
        .update(|snapshot| {
            let (changed, missing) = ways.onto(snapshot)?;
            unknown = missing;
            Ok(changed)
        })
        .map_err(|error| error.with_path(path))?;
    for name in &unknown {
        note!("problem: {}: the map has no place `{name}`", file.display());
    }
    let snapshot = map.snapshot();
    let num_posed = snapshot
        .nodes()
        .iter()
        .filter(|it| it.pose().is_some())
        .count();
    out.line(format_args!(
        "{}: {} places, {num_posed} of them with positions, {} edges, generation {generation}",
        path.display(),
        snapshot.nodes().len(),
        snapshot.edges().len()
    ))?;
    Ok(Outcome::of_check(unknown.is_empty()))
}

fn print_summary(out: &mut Output, path: &Path, snapshot: &Snapshot) -> Result<Outcome> {
    let contents = contents(&snapshot.summary(), "");
    out.line(format_args!("{}: {contents}", path.display()))?;
    Ok(Outcome::Good)
}

fn import_yaml(files: &[PathBuf]) -> Result<Snapshot> {
    let num_features = LearnConfig::preset(Preset::Lttl).features_per_visit();
    let extractor = StarBriefConfig::default().with_num_features(num_features);
    let extractor = ExtractorConfig::StarBrief(extractor).build()?;
    let mut nodes = Vec::new();
    for file in files {
        // Of `place_0.yaml.gz` that is `place_0`.
        let unpacked_name = match file.extension() {
            Some(extension) if extension == "gz" => file.with_extension(""),
            _ => file.clone(),
        };
        let name = unpacked_name
            .file_stem()
            .unwrap_or_default()
            .to_string_lossy();
        let key = PlaceKey::written(&name).map_err(|error| error.with_path(file))?;
        let place = decode_file_storage(&unpacked(file)?).map_err(|error| error.with_path(file))?;
        nodes.push(node_of(key, &place).map_err(|error| error.with_path(file))?);
    }
    // The same places give the same map.
    let seed: Vec<String> = (nodes.iter())
        .flat_map(|node| node.visits().iter().map(|visit| visit.id.to_string()))
        .collect();
    let uuid = derived_uuid(&seed.join("\n"));
    let mut snapshot = Snapshot::empty(MapMeta::new(uuid, extractor.id(), Preset::Lttl.name()));
    for node in nodes {
        snapshot.push_node(node)?;
    }
    Ok(snapshot)
}

/// All features are born at the first visit: the recipe of the benchmark looks for each in every
/// image.
fn node_of(key: PlaceKey, place: &FileStorageMap) -> chronotope::Result<Node> {
    let mut node = Node::new(key);
    let session = SessionId::derive("reference benchmark");
    for (number, (&time, seen)) in place.times.iter().zip(&place.seen).enumerate() {
        let features =
            seen.ones()
                .fold(chronotope::feature::Features::new(), |mut features, id| {
                    let (keypoint, descriptor) = (
                        place.features.keypoints()[id],
                        place.features.descriptors()[id],
                    );
                    features.push(keypoint, descriptor);
                    features
                });
        let visit = Visit {
            id: VisitId::derive(session, node.key(), time, &features_digest(&features)),
            session,
            time,
            source: format!("visit {number}"),
            appearance: None,
            appearance_use: AppearanceUse::Recognised,
        };
        if node.visits().iter().any(|known| known.id == visit.id) {
            return Err(Error::new(
                ErrorKind::Format,
                format!("visit {number} is the same as an earlier one, at {time}"),
            )
            .with_help("each visit needs a time of its own"));
        }
        let born = if number == 0 {
            place.features.clone()
        } else {
            chronotope::feature::Features::new()
        };
        let located_by = node.unlocated(visit.appearance_use);
        node.push_visit(visit, &born, seen.clone(), None, located_by)?;
    }
    Ok(node)
}
