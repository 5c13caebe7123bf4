//! Which features does each image of a dataset have?
//!
//! Extraction is the same for every method, fold and n, so it is done once per image, in parallel,
//! and kept in a cache file whose name is a digest of the dataset's index, the sizes and times of
//! its image files and the extractor. The digest of each image's decoded pixels is kept too, for
//! the leak check.

use chronotope::dataset::{Dataset, Entry, Problem};
use chronotope::feature::{
    Descriptor, Extractor, ExtractorConfig, Features, Keypoint, StarBriefConfig,
};
use chronotope::learn::LearnConfig;
use chronotope::localize::Preset;
use chronotope::{Error, ErrorKind, Result};
use rayon::prelude::*;
use sha2::{Digest, Sha256};
use std::fs;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::provenance::hex;

/// What is known of one image.
#[derive(Clone, Debug, PartialEq)]
pub struct Extracted {
    /// Its features, strongest first.
    pub features: Features,
    /// Width and height, px.
    pub image_size: (u32, u32),
    /// SHA-256 of its decoded pixels.
    pub digest: [u8; 32],
}

/// A dataset with the features of its images.
#[derive(Debug)]
pub struct ExtractedDataset {
    /// The dataset, without the images that could not be read.
    pub dataset: Dataset,
    /// One for each entry.
    pub extracted: Vec<Extracted>,
    /// The identity of the extractor.
    pub extractor: String,
    /// Milliseconds of decoding (or rendering) and extraction of some images; empty from the cache.
    pub extraction_ms: Vec<f64>,
}

impl ExtractedDataset {
    /// Extracts the features of every image, or reads them from `cache_dir`; images that cannot be
    /// read move from `entries` to `problems`.
    ///
    /// `progress` is called after each image, from several threads.
    pub fn new(
        mut dataset: Dataset,
        extractor: &dyn Extractor,
        cache_dir: Option<&Path>,
        progress: &(impl Fn() + Sync),
    ) -> Result<Self> {
        let cache = cache_dir.map(|dir| dir.join(cache_name(&dataset, extractor)));
        if let Some(extracted) = cache.as_deref().and_then(|path| read(path, &dataset)) {
            return Ok(Self {
                dataset,
                extracted,
                extractor: extractor.id(),
                extraction_ms: Vec::new(),
            });
        }
        let results: Vec<(Result<Extracted>, f64)> = dataset
            .entries
            .par_iter()
            .map(|entry| {
                let start = Instant::now();
                let extracted = extract(entry, extractor);
                progress();
                (extracted, start.elapsed().as_secs_f64() * 1e3)
            })
            .collect();
        let mut extracted = Vec::with_capacity(results.len());
        let mut extraction_ms = Vec::with_capacity(results.len());
        let mut entries = Vec::with_capacity(results.len());
        for (entry, (result, ms)) in std::mem::take(&mut dataset.entries)
            .into_iter()
            .zip(results)
        {
            match result {
                Ok(image) => {
                    entries.push(entry);
                    extracted.push(image);
                    extraction_ms.push(ms);
                }
                Err(error) => (dataset.problems).push(Problem::new(entry.id, error.to_string())),
            }
        }
        dataset.entries = entries;
        if dataset.problems.is_empty()
            && let Some(path) = &cache
        {
            write(path, &extracted)?;
        }
        Ok(Self {
            dataset,
            extracted,
            extractor: extractor.id(),
            extraction_ms,
        })
    }
}

fn extract(entry: &Entry, extractor: &dyn Extractor) -> Result<Extracted> {
    let image = entry.source.load()?;
    let mask = entry.source.mask(image.width(), image.height())?;
    Ok(Extracted {
        features: extractor.extract(&image, mask.as_ref())?,
        image_size: image.size(),
        digest: image.digest().0,
    })
}

fn cache_name(dataset: &Dataset, extractor: &dyn Extractor) -> PathBuf {
    let mut hasher = Sha256::new();
    hasher.update(FORMAT);
    hasher.update(extractor.id());
    hasher.update(dataset.sha256());
    for entry in &dataset.entries {
        let state = entry.source.path().and_then(|path| fs::metadata(path).ok());
        let len = state.as_ref().map_or(0, fs::Metadata::len);
        let modified = state.and_then(|state| state.modified().ok());
        hasher.update(format!("{len} {modified:?}\n"));
    }
    let hex = hex(&hasher.finalize()[..8]);
    PathBuf::from(format!("{}-{hex}.features", dataset.name))
}

const FORMAT: &[u8; 16] = b"chronotope feat1";

/// Written whole under another name and renamed, so that a reader never finds a part.
fn write(path: &Path, extracted: &[Extracted]) -> Result<()> {
    let as_error = |error: std::io::Error| Error::io(path, error);
    if let Some(dir) = path.parent() {
        fs::create_dir_all(dir).map_err(as_error)?;
    }
    let part = path.with_extension(format!("part{}", std::process::id()));
    let written = (|| {
        let mut file = BufWriter::new(fs::File::create(&part)?);
        file.write_all(FORMAT)?;
        for image in extracted {
            let (width, height) = image.image_size;
            file.write_all(&image.digest)?;
            for number in [width, height, image.features.len() as u32] {
                file.write_all(&number.to_le_bytes())?;
            }
            for keypoint in image.features.keypoints() {
                for value in [keypoint.x, keypoint.y, keypoint.size, keypoint.response] {
                    file.write_all(&value.to_le_bytes())?;
                }
            }
            for descriptor in image.features.descriptors() {
                file.write_all(&descriptor.to_bytes())?;
            }
        }
        file.flush()?;
        fs::rename(&part, path)
    })();
    written.map_err(|error| {
        // The first error is the one to report.
        let _ = fs::remove_file(&part);
        as_error(error)
    })
}

/// `None` if there is no such file or it is damaged: extraction then writes it again.
fn read(path: &Path, dataset: &Dataset) -> Option<Vec<Extracted>> {
    let mut file = BufReader::new(fs::File::open(path).ok()?);
    let mut next = [0; 16];
    file.read_exact(&mut next).ok()?;
    if next != *FORMAT {
        return None;
    }
    (dataset.entries.iter())
        .map(|_| read_one(&mut file).ok())
        .collect()
}

fn read_one(file: &mut impl Read) -> Result<Extracted> {
    let as_error = |error: std::io::Error| Error::new(ErrorKind::Format, error.to_string());
    let mut digest = [0; 32];
    file.read_exact(&mut digest).map_err(as_error)?;
    let mut number = || -> Result<u32> {
        let mut bytes = [0; 4];
        file.read_exact(&mut bytes).map_err(as_error)?;
        Ok(u32::from_le_bytes(bytes))
    };
    let image_size = (number()?, number()?);
    let count = number()?;
    let keypoints = (0..count)
        .map(|_| {
            Ok(Keypoint {
                x: f32::from_bits(number()?),
                y: f32::from_bits(number()?),
                size: f32::from_bits(number()?),
                response: f32::from_bits(number()?),
            })
        })
        .collect::<Result<_>>()?;
    let descriptors = (0..count)
        .map(|_| {
            let mut bytes = [0; 32];
            file.read_exact(&mut bytes).map_err(as_error)?;
            Ok(Descriptor::from_bytes(bytes))
        })
        .collect::<Result<_>>()?;
    Ok(Extracted {
        features: Features::from_parts(keypoints, descriptors)?,
        image_size,
        digest,
    })
}

/// The extractor of every suite that is told no other: as many features as the preset that learns
/// from most of them.
pub(crate) fn extractor() -> ExtractorConfig {
    let of = |preset: &Preset| LearnConfig::preset(*preset).features_per_visit();
    let most = Preset::ALL.iter().map(of).max().unwrap_or_default();
    ExtractorConfig::StarBrief(StarBriefConfig::default().with_num_features(most))
}
