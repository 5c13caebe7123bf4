//! How does a robot open a large map in a second?
//!
//! [`Localizer::open`] keeps what [`Localizer::new`] works out in a file beside the map, the *index
//! cache*, and reads that the next time: all places with their features and logs, the fitted
//! models, the calibration, and the words that candidates are found by. What is left is to check it
//! and to lay it out.
//!
//! The index cache is a cache and never the truth. Its name tells which generation of which map,
//! which configuration and which version of this crate it was made of ([`Fingerprint`]); one that
//! does not fit, or that is truncated or damaged, is made anew. Where the folder may not be
//! written, the map opens as slowly as without. Answers are the same, bit for bit.
//!
//! Nobody else can make one: it is read only if its owner is the map's or this process's and
//! nobody may write it who may not write the map; and all of it is under a SHA-256 with the
//! fingerprint as key, which is not in the file and which only those can work out who may read the
//! map. It gets the rights of the map, because it says what the map says.
//!
//! # Format
//! Little-endian. A head of 64 bytes: magic, version (u32), zero (u32), where the contents begin
//! (u64), zero (u64), the seal (32 bytes): SHA-256 of the fingerprint, the 32 bytes before the seal
//! and the SHA-256 of the contents. Then blocks of up to 64 places, each with a SHA-256 of its own
//! so that threads read them side by side, then the contents: JSON of what holds for the whole map
//! and of where each block lies and what its SHA-256 is. For each feature 32 bytes of descriptor, 16 of keypoint, and `8 + 18 l` of a model of
//! order l (the mean: 8); a bit for each of its visits. Kept appearances, 48 bytes a feature, are
//! there only for a method that matches them; which of them it matches at what time is worked out
//! again.
//!
//! A map with a model that is neither [`Fremen`] nor [`Mean`] has no index cache.

use std::fmt;
use std::io::{Seek, Write};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Arc;
use std::time::{Duration, Instant};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::candidates::Finder;
use super::config::{LocalizerConfig, by_name};
use super::evidence::{self, Calibration};
use super::localizer::Localizer;
use super::plan::{Plan, PlannedMap};
use crate::feature::{Descriptor, Features, Keypoint, Rect};
use crate::map::{
    AppearanceUse, Edge, Map, MapMeta, MappedFile, Node, NodeParts, PlaceKey, SessionId, Snapshot,
    SnapshotParts, Stamp, Visit, VisitId,
};
use crate::matching::BinaryWords;
use fremen::error::{Error, ErrorKind, Result};
use fremen::file::{self, OutputFile, OutputKind};
use fremen::time::{Time, Zone};
use fremen::visibility::{self, BitRow, VisibilityModel, Visits};

const MAGIC: [u8; 8] = *b"CHRQUERY";
/// Grows when bytes or what they lead to change their meaning.
const VERSION: u32 = 5;
const HEAD_BYTES: usize = 64;
/// Where in the head the seal begins.
const SEAL_AT: usize = 32;
/// Places that a thread reads at a time.
const PLACES_PER_BLOCK: usize = 64;
/// Blocks that wait in memory to be written.
const BLOCKS_PER_WAVE: usize = 16;
/// A map that takes longer to open has an index cache by [`IndexCache::Auto`]: measured were 0.4 s
/// for 5 places with 60 visits, for which no file should appear, and 8 s (0.4 s by the index cache)
/// for 6 with 4,644.
const SLOW: Duration = Duration::from_secs(1);

/// What has such a name is an index cache, whatever is left in it.
const KIND: OutputKind = OutputKind {
    noun: "an index cache",
    begins: b"",
};

/// Whether an index cache is kept beside a map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum IndexCache {
    /// None is read or written.
    Never,
    /// One that is there is read; one is written where the map took more than a second to open
    /// without.
    #[default]
    Auto,
    /// One that is there is read, else one is written.
    Always,
}

impl IndexCache {
    /// Every choice.
    pub const ALL: [Self; 3] = [Self::Never, Self::Auto, Self::Always];

    /// The name used in commands.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Never => "never",
            Self::Auto => "auto",
            Self::Always => "always",
        }
    }

    /// Whether one is written of a map that took so long to open.
    fn is_worth_writing(self, opening: Duration) -> bool {
        match self {
            Self::Never => false,
            Self::Auto => opening > SLOW,
            Self::Always => true,
        }
    }
}

impl FromStr for IndexCache {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        by_name("choice", name, Self::ALL, Self::name)
    }
}

impl fmt::Display for IndexCache {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// A SHA-256 over what an index cache is made of, the digest of all that the map remembers among
/// it.
type Fingerprint = [u8; 32];

/// What holds for the whole map, and where its places are.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Contents {
    generation: u64,
    uuid: String,
    extractor: String,
    image_size: Option<(u32, u32)>,
    crop: Option<Rect>,
    preset: String,
    zone: Option<String>,
    edges: Vec<Edge>,
    /// Name of each, and its bytes in base64.
    attachments: Vec<(String, String)>,
    calibration: Option<Calibration>,
    /// The centroids of the words that candidates are found by.
    words: Option<Vec<[u64; 4]>>,
    blocks: Vec<Block>,
}

/// What a place is matched by, in the form that is kept.
enum Kept<'a> {
    Model(&'a dyn VisibilityModel),
    Appearances,
}

/// Where some places lie.
#[derive(Clone, Copy, Serialize, Deserialize)]
struct Block {
    start: u64,
    len: u64,
    sha256: [u8; 32],
    num_places: u32,
}

impl Localizer {
    /// Opens the map at `path` for localising only, by way of the index cache that lies beside it,
    /// which is made if it is missing and made anew if it does not fit the map:
    /// [`open_with`](Self::open_with) with [`IndexCache::Always`].
    pub fn open(path: impl AsRef<Path>, cfg: LocalizerConfig) -> Result<Self> {
        Self::open_with(path, cfg, IndexCache::Always)
    }

    /// Opens the map at `path` for localising only, by way of the index cache that lies beside it,
    /// if there is one that fits the map; else one is made, if `cache` says so.
    ///
    /// As [`Localizer::new`] on the snapshot of [`Map::open_read_only`], with the same answers; but
    /// once there is an index cache, the file is not read as a whole, and unless the method matches
    /// kept appearances, what is left of them is that they were kept: its snapshot is for
    /// localising, not for committing, and a calibration that is attached to it
    /// ([`Localizer::to_attachment`]) does not fit the map. Fails as these two do; that an index
    /// cache cannot be written is no failure.
    pub fn open_with(
        path: impl AsRef<Path>,
        cfg: LocalizerConfig,
        cache: IndexCache,
    ) -> Result<Self> {
        cfg.check()?;
        let path = path.as_ref();
        let start = Instant::now();
        if cache != IndexCache::Never {
            let stamp = Stamp::read(path)?;
            let file = index_cache_path(path, stamp, &cfg);
            if let Some(localizer) = read(&file, path, &fingerprint(stamp, &cfg), &cfg) {
                tracing::info!(file = %file.display(), "opened by the query form");
                return Ok(localizer);
            }
        }
        let snapshot = Map::open_read_only(path)?.snapshot();
        let localizer = Self::new(snapshot, cfg).map_err(|error| error.with_path(path))?;
        if cache.is_worth_writing(start.elapsed()) {
            localizer.keep_index_cache(path);
        }
        Ok(localizer)
    }

    /// Writes the index cache of this localizer beside the map at `path`, and removes those of
    /// older generations. What goes wrong costs time the next time and nothing else.
    fn keep_index_cache(&self, path: &Path) {
        // Another process may have committed since the stamp was read.
        let stamp = Stamp::of(self.snapshot());
        let file = index_cache_path(path, stamp, self.cfg());
        let written = OutputFile::replace(&file, KIND, &[]).and_then(|output| {
            let mut output = output.with_rights_of(path);
            if self.write_index_cache(&mut output, &fingerprint(stamp, self.cfg()))? {
                output.finish()?;
            }
            Ok(())
        });
        if let Err(error) = written {
            tracing::info!(file = %file.display(), %error, "no query form kept");
            return;
        }
        remove_older(path, stamp);
    }

    /// Whether it could be written: every model must have a form in bytes.
    fn write_index_cache(&self, file: &mut OutputFile, fingerprint: &Fingerprint) -> Result<bool> {
        let path = file.path().to_owned();
        let io = |cause: std::io::Error| Error::io(&path, cause);
        let kept = (self.map.plans.iter()).map(|plan| match plan.as_ref() {
            Plan::Appearances { .. } => Kept::Appearances,
            Plan::Predicted { model, .. } => Kept::Model(model.as_ref()),
        });
        file.write_all(&[0; HEAD_BYTES]).map_err(io)?;
        let mut end = HEAD_BYTES as u64;
        let places: Vec<_> = self.snapshot().nodes().iter().zip(kept).collect();
        let mut blocks = Vec::new();
        for wave in places.chunks(PLACES_PER_BLOCK * BLOCKS_PER_WAVE) {
            let wave: Option<Vec<(usize, Vec<u8>)>> = (wave.par_chunks(PLACES_PER_BLOCK))
                .map(|places| {
                    let mut bytes = Vec::new();
                    for (node, kept) in places {
                        put_place(&mut bytes, node, kept)?;
                    }
                    Some((places.len(), bytes))
                })
                .collect();
            let Some(wave) = wave else {
                return Ok(false);
            };
            for (num_places, bytes) in wave {
                file.write_all(&bytes).map_err(io)?;
                blocks.push(Block {
                    start: end,
                    len: bytes.len() as u64,
                    sha256: Sha256::digest(&bytes).into(),
                    num_places: num_places as u32,
                });
                end += bytes.len() as u64;
            }
        }
        let contents = serde_json::to_vec(&self.contents(blocks))
            .map_err(|cause| io(std::io::Error::other(cause)))?;
        file.write_all(&contents).map_err(io)?;
        file.rewind().map_err(io)?;
        file.write_all(&head(fingerprint, end, &contents))
            .map_err(io)?;
        Ok(true)
    }

    fn contents(&self, blocks: Vec<Block>) -> Contents {
        let MapMeta {
            uuid,
            extractor,
            image_size,
            crop,
            preset,
            zone,
        } = self.snapshot().meta().clone();
        Contents {
            generation: self.snapshot().generation(),
            uuid: format!("{uuid:032x}"),
            extractor,
            image_size,
            crop,
            preset,
            zone,
            edges: self.snapshot().edges().to_vec(),
            attachments: (self.snapshot().attachments().iter())
                .map(|(name, bytes)| (name.clone(), BASE64.encode(bytes)))
                .collect(),
            calibration: self.calibration.as_deref().cloned(),
            words: if let Finder::Inverted(words) = &self.finder {
                Some(words.centroids().map(|it| it.0).collect())
            } else {
                None
            },
            blocks,
        }
    }
}

/// What an index cache of this generation and configuration is known by.
fn fingerprint(stamp: Stamp, cfg: &LocalizerConfig) -> Fingerprint {
    let mut sha = Sha256::new();
    sha.update(VERSION.to_le_bytes());
    sha.update(evidence::VERSION.to_le_bytes());
    sha.update(env!("CARGO_PKG_VERSION"));
    sha.update(stamp.generation.to_le_bytes());
    sha.update(stamp.digest);
    sha.update(kept_of(cfg));
    sha.finalize().into()
}

/// The configuration without what is made of an answer, which has no part in an index cache.
fn kept_of(cfg: &LocalizerConfig) -> String {
    let cfg = (cfg.clone())
        .with_off_map(0.5)
        .with_risk(0.5)
        .with_min_score(1)
        .with_time_bucket_s(0);
    format!("{cfg:?}")
}

/// `MAP.GENERATION.CONFIGURATION.query`, the two as the first digits of their hashes.
fn index_cache_path(map: &Path, stamp: Stamp, cfg: &LocalizerConfig) -> PathBuf {
    let of_cfg = Sha256::digest(kept_of(cfg)).into();
    let mut name = map.as_os_str().to_owned();
    name.push(format!(
        ".{}.{}.query",
        digits(&stamp.digest),
        digits(&of_cfg)
    ));
    PathBuf::from(name)
}

/// The first 16 digits of a hash.
fn digits(hash: &Fingerprint) -> String {
    let first = u64::from_be_bytes(std::array::from_fn(|at| hash[at]));
    format!("{first:016x}")
}

/// Removes the index caches of other generations of the map, and what is left of some that were
/// never finished; nothing else is named like them.
fn remove_older(map: &Path, stamp: Stamp) {
    let (Some(name), Some(folder)) = (map.file_name().and_then(|it| it.to_str()), map.parent())
    else {
        return;
    };
    let folder = if folder.as_os_str().is_empty() {
        Path::new(".")
    } else {
        folder
    };
    let Ok(entries) = std::fs::read_dir(folder) else {
        return;
    };
    let newest = digits(&stamp.digest);
    for entry in entries.flatten() {
        let other = entry.file_name();
        let generation = (other.to_str())
            .map(|other| match other.strip_suffix(".unfinished") {
                // What a killed process has left.
                Some(rest) => rest.strip_prefix('.').unwrap_or(rest),
                None => other,
            })
            .and_then(|other| other.strip_prefix(name)?.strip_prefix('.'))
            .and_then(|rest| rest.strip_suffix(".query")?.split_once('.'));
        let is_hash =
            |text: &str| text.len() == 16 && text.bytes().all(|byte| byte.is_ascii_hexdigit());
        if let Some((generation, cfg)) = generation
            && is_hash(generation)
            && is_hash(cfg)
            && generation != newest
        {
            // Somebody else may have removed it already.
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

fn head(fingerprint: &Fingerprint, start: u64, contents: &[u8]) -> [u8; HEAD_BYTES] {
    let mut head = [0; HEAD_BYTES];
    head[..8].copy_from_slice(&MAGIC);
    head[8..12].copy_from_slice(&VERSION.to_le_bytes());
    head[16..24].copy_from_slice(&start.to_le_bytes());
    let mut seal = Sha256::new();
    seal.update(fingerprint);
    seal.update(&head[..SEAL_AT]);
    seal.update(Sha256::digest(contents));
    head[SEAL_AT..].copy_from_slice(&seal.finalize());
    head
}

/// The localizer whose index cache of the map at `map` is at `path`; `None` if there is none that
/// fits.
fn read(
    path: &Path,
    map: &Path,
    fingerprint: &Fingerprint,
    cfg: &LocalizerConfig,
) -> Option<Localizer> {
    let found = match file::open_beside(path, map) {
        Ok(found) => found,
        Err(error) if error.kind() == ErrorKind::NotFound => return None,
        Err(error) => {
            tracing::warn!("the query form is not used: {error}");
            return None;
        }
    };
    let localizer = parse(&MappedFile::of(&found).ok()?, fingerprint, cfg);
    if localizer.is_none() {
        tracing::warn!(file = %path.display(), "the query form does not fit or is damaged; it is made anew");
    }
    localizer
}

fn parse(file: &[u8], fingerprint: &Fingerprint, cfg: &LocalizerConfig) -> Option<Localizer> {
    let found: &[u8; HEAD_BYTES] = file.first_chunk()?;
    let start = Reader(&found[16..]).u64()?;
    let contents = file.get(usize::try_from(start).ok()?..)?;
    // A fuzzer, which cannot guess a hash, gets behind it.
    if *found != head(fingerprint, start, contents) && !cfg!(fuzzing) {
        return None;
    }
    let contents: Contents = serde_json::from_slice(contents).ok()?;
    // One after the other, so that no bytes are read twice.
    let mut end = HEAD_BYTES as u64;
    for block in &contents.blocks {
        if block.start != end {
            return None;
        }
        end = end.checked_add(block.len)?;
    }
    let meta = MapMeta {
        uuid: u128::from_str_radix(&contents.uuid, 16).ok()?,
        extractor: contents.extractor,
        image_size: contents.image_size,
        crop: contents.crop,
        preset: contents.preset,
        zone: contents.zone,
    };
    let zone = meta.civil_zone().ok()?;
    let blocks = (contents.blocks.par_iter())
        .map(|block| read_block(file, block, cfg, zone.as_ref()))
        .collect::<Option<Vec<_>>>()?;
    let num_places = blocks.iter().map(Vec::len).sum();
    let (mut nodes, mut plans) = (
        Vec::with_capacity(num_places),
        Vec::with_capacity(num_places),
    );
    for (node, plan) in blocks.into_iter().flatten() {
        nodes.push(Arc::new(node));
        plans.push(Arc::new(plan));
    }
    let snapshot = Snapshot::from_sound_places(SnapshotParts {
        generation: contents.generation,
        meta,
        nodes,
        edges: contents.edges,
        attachments: (contents.attachments.into_iter())
            .map(|(name, text)| Some((name, BASE64.decode(text).ok()?.into())))
            .collect::<Option<_>>()?,
    });
    let snapshot = snapshot.ok()?;
    let calibration = contents.calibration;
    let fits = !plans.is_empty()
        && calibration.is_some() == cfg.calibrated()
        && (calibration.iter()).all(|calibration| calibration.holds_together(&snapshot));
    let words = contents.words.map(|words| {
        let words: Vec<Descriptor> = words.into_iter().map(Descriptor).collect();
        Arc::new(BinaryWords::from_centroids(&words))
    });
    fits.then(|| {
        let finder = words.map_or_else(|| Finder::new(&snapshot, cfg), Finder::Inverted);
        let map = PlannedMap::from_parts(Arc::new(snapshot), cfg.clone(), zone, plans);
        Localizer::from_parts(map, calibration.map(Arc::new), finder)
    })
}

fn read_block(
    file: &[u8],
    block: &Block,
    cfg: &LocalizerConfig,
    zone: Option<&Zone>,
) -> Option<Vec<(Node, Plan)>> {
    let start = usize::try_from(block.start).ok()?;
    let end = start.checked_add(usize::try_from(block.len).ok()?)?;
    let bytes = file.get(start..end)?;
    if Sha256::digest(bytes)[..] != block.sha256 && !cfg!(fuzzing) {
        return None;
    }
    let mut reader = Reader(bytes);
    let places = (0..block.num_places)
        .map(|_| reader.place(cfg, zone))
        .collect::<Option<Vec<_>>>()?;
    reader.0.is_empty().then_some(places)
}

fn put_count(bytes: &mut Vec<u8>, count: usize) {
    bytes.extend_from_slice(&(count as u64).to_le_bytes());
}

fn put_text(bytes: &mut Vec<u8>, text: &str) {
    put_count(bytes, text.len());
    bytes.extend_from_slice(text.as_bytes());
}

fn put_row(bytes: &mut Vec<u8>, row: &BitRow) {
    put_count(bytes, row.len());
    bytes.extend(row.words().iter().flat_map(|word| word.to_le_bytes()));
}

fn put_features(bytes: &mut Vec<u8>, features: &Features) {
    put_count(bytes, features.len());
    for it in features.keypoints() {
        let numbers = [it.x, it.y, it.size, it.response];
        bytes.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
    }
    for descriptor in features.descriptors() {
        bytes.extend_from_slice(&descriptor.to_bytes());
    }
}

/// `None` if the model has no form in bytes.
fn put_place(bytes: &mut Vec<u8>, node: &Node, kept: &Kept<'_>) -> Option<()> {
    put_text(bytes, node.key().as_str());
    bytes.push(u8::from(node.pose().is_some()));
    for metres in node.pose().iter().flatten() {
        bytes.extend_from_slice(&metres.to_le_bytes());
    }
    put_features(bytes, node.features());
    put_count(bytes, node.visits().len());
    for (index, visit) in node.visits().iter().enumerate() {
        bytes.extend_from_slice(&visit.id.0.to_le_bytes());
        bytes.extend_from_slice(&visit.session.0.to_le_bytes());
        bytes.extend_from_slice(&visit.time.as_us().to_le_bytes());
        put_text(bytes, &visit.source);
        bytes.push(u8::from(visit.appearance_use == AppearanceUse::Experience));
        put_row(bytes, node.log().seen_row(index));
        let hidden = node.log().hidden_row(index);
        bytes.push(u8::from(hidden.is_some()));
        if let Some(hidden) = hidden {
            put_row(bytes, hidden);
        }
        put_row(bytes, node.experience_log().seen_row(index));
        let appearance = (visit.appearance.as_ref()).filter(|_| matches!(kept, Kept::Appearances));
        bytes.push(u8::from(appearance.is_some()));
        if let Some(appearance) = appearance {
            put_features(bytes, appearance);
        }
    }
    if let Kept::Model(model) = kept {
        let model = model.encode()?;
        put_count(bytes, model.len());
        bytes.extend(model);
    }
    Some(())
}

/// Bytes from outside; every step says whether they went on so far.
struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let (bytes, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(bytes)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.bytes(N)?.try_into().ok()
    }

    /// `count` records of N bytes each; nothing is set aside before they are known to be there.
    fn records<const N: usize>(&mut self, count: usize) -> Option<&'a [[u8; N]]> {
        Some(self.bytes(count.checked_mul(N)?)?.as_chunks().0)
    }

    fn u8(&mut self) -> Option<u8> {
        self.array().map(u8::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    fn count(&mut self) -> Option<usize> {
        self.u64().and_then(|count| count.try_into().ok())
    }

    fn f64s(&mut self, count: usize) -> Option<Vec<f64>> {
        let records = self.records::<8>(count)?;
        let numbers = records.iter().copied().map(f64::from_le_bytes);
        numbers.map(|it| it.is_finite().then_some(it)).collect()
    }

    fn text(&mut self) -> Option<&'a str> {
        let count = self.count()?;
        std::str::from_utf8(self.bytes(count)?).ok()
    }

    fn row(&mut self) -> Option<BitRow> {
        let len = self.count()?;
        let words = self.records::<8>(len.div_ceil(64))?;
        BitRow::from_words(words.iter().copied().map(u64::from_le_bytes).collect(), len).ok()
    }

    fn features(&mut self) -> Option<Features> {
        let count = self.count()?;
        let keypoints = (self.records::<16>(count)?.iter())
            .map(|record| {
                let number =
                    |at: usize| f32::from_le_bytes(std::array::from_fn(|i| record[4 * at + i]));
                let numbers = [number(0), number(1), number(2), number(3)];
                let [x, y, size, response] = numbers;
                (numbers.iter().all(|it| it.is_finite())).then_some(Keypoint {
                    x,
                    y,
                    size,
                    response,
                })
            })
            .collect::<Option<_>>()?;
        let descriptors = (self.records::<32>(count)?.iter())
            .map(|&record| Descriptor::from_bytes(record))
            .collect();
        Features::from_parts(keypoints, descriptors).ok()
    }

    fn place(&mut self, cfg: &LocalizerConfig, zone: Option<&Zone>) -> Option<(Node, Plan)> {
        let mut parts = Node::new(PlaceKey::new(self.text()?).ok()?).into_parts();
        if self.u8()? != 0 {
            parts.pose = Some(self.f64s(3)?.try_into().ok()?);
        }
        parts.features = self.features()?;
        let num_visits = self.count()?;
        for _ in 0..num_visits {
            self.visit_into(&mut parts)?;
        }
        let node = Node::from_parts(parts).ok()?;
        let plan = if cfg.method().predicts() {
            Plan::Predicted {
                model: self.model(node.features().len())?,
                references: cfg.references(node.log(), Visits::All).ok()?,
            }
        } else {
            Plan::of(&node, cfg, zone).ok()?
        };
        Some((node, plan))
    }

    fn visit_into(&mut self, node: &mut NodeParts) -> Option<()> {
        let id = VisitId(u128::from_le_bytes(self.array()?));
        let session = SessionId(u128::from_le_bytes(self.array()?));
        let time = Time::from_us(i64::from_le_bytes(self.array()?));
        let source = self.text()?.to_owned();
        let appearance_use = match self.u8()? {
            0 => AppearanceUse::Recognised,
            _ => AppearanceUse::Experience,
        };
        let seen = self.row()?;
        let hidden = if self.u8()? == 0 {
            None
        } else {
            Some(self.row()?)
        };
        let located_by = self.row()?;
        let appearance = if self.u8()? == 0 {
            None
        } else {
            Some(Arc::new(self.features()?))
        };
        node.log.push_visit(time, seen, hidden).ok()?;
        (node.experience_log)
            .push_visit(time, located_by, None)
            .ok()?;
        node.visits.push(Visit {
            id,
            session,
            time,
            source,
            appearance,
            appearance_use,
        });
        Some(())
    }

    fn model(&mut self, num_features: usize) -> Option<Box<dyn VisibilityModel>> {
        let count = self.count()?;
        let model = visibility::decode(self.bytes(count)?).ok()?;
        (model.num_features() == num_features).then_some(model)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_index_cache_is_written_where_the_map_opened_slowly() {
        let cases = [(999, [false, false, true]), (1001, [false, true, true])];
        for (ms, expected) in cases {
            let opening = Duration::from_millis(ms);
            let written = IndexCache::ALL.map(|cache| cache.is_worth_writing(opening));
            assert_eq!(written, expected, "{ms} ms");
        }
    }
}
