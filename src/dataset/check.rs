//! Is this dataset complete, readable and free of duplicates?

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;
use serde::Serialize;
use sha2::{Digest, Sha256};

use super::doubt::{look, most_common, problem_of};
use super::manifest::Manifest;
use super::paths::{file_sha256, hex, relative};
use super::table::{MAX_TABLE_BYTES, read_text};
use super::types::{Clock, Dataset, ImageSource, Problem};
use crate::feature::{Extractor, GrayImage, PixelDigest};
use crate::map::PlaceKey;
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::Time;

/// A list of checksums in the format of `sha256sum`, if a dataset has one.
const SUMS_FILE: &str = "SHA256SUMS";

/// What a dataset contains, after every image was decoded.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct CheckReport {
    /// The dataset's name.
    pub name: String,
    /// What its times mean.
    pub clock: Clock,
    /// [`Dataset::sha256`].
    pub dataset_sha256: String,
    /// How many images are listed.
    pub num_entries: usize,
    /// How many of them could be decoded.
    pub num_readable: usize,
    /// How many of those differ in their pixels.
    pub num_distinct: usize,
    /// Each place, by name.
    pub places: BTreeMap<PlaceKey, PlaceSummary>,
    /// How many images there are at each time.
    pub visits: BTreeMap<Time, usize>,
    /// How many images have which size, after turning, cutting and resizing.
    pub image_sizes: Vec<SizeCount>,
    /// Entries with the same pixels, by id: duplicates that must not be on both sides of an
    /// evaluation.
    pub duplicates: Vec<Vec<String>>,
    /// What was left out when the dataset was opened, and what cannot be decoded.
    pub problems: Vec<Problem>,
}

/// The images of one place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct PlaceSummary {
    /// How many visits.
    pub num_visits: usize,
    /// The first one.
    pub first: Time,
    /// The last one.
    pub last: Time,
}

/// How many images have this size.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct SizeCount {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Images.
    pub count: usize,
}

impl CheckReport {
    /// Whether nothing is wrong; duplicates are a property of the data, not a fault of the copy.
    pub fn is_clean(&self) -> bool {
        self.problems.is_empty()
    }

    /// The first and the last time.
    pub fn span(&self) -> Option<(Time, Time)> {
        let (first, _) = self.visits.first_key_value()?;
        let (last, _) = self.visits.last_key_value()?;
        Some((*first, *last))
    }
}

impl fmt::Display for CheckReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "dataset   {}", self.name)?;
        writeln!(
            f,
            "images    {} listed, {} readable, {} distinct",
            self.num_entries, self.num_readable, self.num_distinct
        )?;
        for size in &self.image_sizes {
            writeln!(
                f,
                "          {} of {} x {} px",
                size.count, size.width, size.height
            )?;
        }
        if let Some((first, last)) = self.span() {
            let clock = match self.clock {
                Clock::Real => "",
                Clock::None => " (these times only number the visits)",
            };
            writeln!(
                f,
                "times     {} from {first} to {last}{clock}",
                self.visits.len()
            )?;
        }
        for (position, (place, summary)) in self.places.iter().enumerate() {
            writeln!(
                f,
                "{:9} {place}: {} visits, {} to {}",
                if position == 0 { "places" } else { "" },
                summary.num_visits,
                summary.first,
                summary.last
            )?;
        }
        writeln!(f, "sha256    {} (of the index)", self.dataset_sha256)?;
        for ids in &self.duplicates {
            writeln!(f, "duplicate {}", ids.join(" = "))?;
        }
        for problem in &self.problems {
            writeln!(f, "problem   {problem}")?;
        }
        write!(f, "problems  {}", self.problems.len())
    }
}

impl Dataset {
    /// Decodes every image and counts; see [`CheckReport`].
    ///
    /// `progress(done, total)` is called after every image, from several threads.
    pub fn check(&self, progress: impl Fn(usize, usize) + Sync) -> CheckReport {
        check(self, &CheckOptions::default(), &progress)
    }

    /// [`check`](Self::check) that also doubts what an update of a map would: times that cannot be
    /// right, images of another size than most, images with nothing to see.
    pub fn check_with(
        &self,
        options: &CheckOptions,
        progress: impl Fn(usize, usize) + Sync,
    ) -> CheckReport {
        check(self, options, &progress)
    }
}

impl Manifest {
    /// Compares the files with the manifest's checksums and with a `SHA256SUMS` file in the folder,
    /// where there are any; every difference is a problem.
    pub fn verify(
        &self,
        dataset: &Dataset,
        data_dir: &Path,
        progress: impl Fn(usize, usize) + Sync,
    ) -> Result<Vec<Problem>> {
        verify(self, dataset, &self.find_data(data_dir)?, &progress)
    }
}

/// What is looked for beyond what can be decoded.
#[derive(Default)]
pub struct CheckOptions {
    /// The present: images from after it are doubted, and those from before 2000.
    pub now: Option<Time>,
    /// What looks for features, and how many an image must have.
    pub features: Option<(Box<dyn Extractor>, usize)>,
}

fn check(
    dataset: &Dataset,
    options: &CheckOptions,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> CheckReport {
    // Of an image of another size than most features are not looked for, however large it is.
    let usual = options.now.and_then(|_| {
        (dataset.image_size).or_else(|| most_common(dataset.sizes().iter().flatten()))
    });
    let decoded = decode(dataset, options, usual, progress);
    let mut problems = dataset.problems.clone();
    let mut places: BTreeMap<PlaceKey, PlaceSummary> = BTreeMap::new();
    let mut visits: BTreeMap<Time, usize> = BTreeMap::new();
    let mut sizes: BTreeMap<(usize, usize), usize> = BTreeMap::new();
    let mut identical: BTreeMap<PixelDigest, Vec<String>> = BTreeMap::new();
    let doubts = match options.now {
        Some(now) => {
            let size = |one: &Result<Decoded>| one.as_ref().ok().map(|it| it.size);
            let sizes: Vec<_> = decoded.iter().map(size).collect();
            let usual = usual.or_else(|| most_common(sizes.iter().flatten()));
            dataset.doubts(Some(now), &sizes, usual)
        }
        None => vec![None; decoded.len()],
    };
    for ((entry, decoded), doubt) in dataset.entries.iter().zip(decoded).zip(doubts) {
        let summary = places.entry(entry.place.clone()).or_insert(PlaceSummary {
            num_visits: 0,
            first: entry.time,
            last: entry.time,
        });
        summary.num_visits += 1;
        summary.first = summary.first.min(entry.time);
        summary.last = summary.last.max(entry.time);
        *visits.entry(entry.time).or_default() += 1;
        match decoded {
            Ok(image) => {
                let doubt = doubt.or(image.doubt);
                problems.extend(doubt.map(|message| problem_of(entry, message)));
                let (width, height) = image.size;
                *sizes.entry((width as usize, height as usize)).or_default() += 1;
                identical
                    .entry(image.digest)
                    .or_default()
                    .push(entry.id.clone());
            }
            Err(error) => {
                let problem = Problem::of(&entry.id, error);
                problems.push(match entry.source.path() {
                    Some(path) => problem.with_file(path),
                    None => problem,
                });
            }
        }
    }
    let num_distinct = identical.len();
    let num_readable = identical.values().map(Vec::len).sum();
    let mut duplicates: Vec<_> = identical
        .into_values()
        .filter(|ids| ids.len() > 1)
        .collect();
    duplicates.sort_unstable();
    let total = dataset.entries.len();
    CheckReport {
        name: dataset.name.clone(),
        clock: dataset.clock,
        dataset_sha256: dataset.sha256(),
        num_entries: total,
        num_readable,
        num_distinct,
        places,
        visits,
        image_sizes: sizes
            .into_iter()
            .map(|((width, height), count)| SizeCount {
                width,
                height,
                count,
            })
            .collect(),
        duplicates,
        problems,
    }
}

struct Decoded {
    size: (u32, u32),
    digest: PixelDigest,
    /// Why there is nothing to see.
    doubt: Option<String>,
}

/// Decodes every file once, whatever number of entries is cut out of it.
fn decode(
    dataset: &Dataset,
    options: &CheckOptions,
    usual: Option<(u32, u32)>,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Vec<Result<Decoded>> {
    let mut groups: BTreeMap<PathBuf, Vec<usize>> = BTreeMap::new();
    let mut alone = Vec::new();
    for (position, entry) in dataset.entries.iter().enumerate() {
        match entry.source.path() {
            Some(path) => groups.entry(path).or_default().push(position),
            None => alone.push(vec![position]),
        }
    }
    let groups: Vec<Vec<usize>> = groups.into_values().chain(alone).collect();
    let (done, total) = (AtomicUsize::new(0), dataset.entries.len());
    let look = |source: &dyn ImageSource, image: GrayImage| -> Result<Decoded> {
        let mask = source.mask(image.width(), image.height())?;
        let doubt = match &options.features {
            Some(_) if usual.is_some_and(|usual| usual != image.size()) => None,
            Some((extractor, least)) => look(&image, mask.as_ref(), &**extractor, *least)?,
            None => None,
        };
        Ok(Decoded {
            size: image.size(),
            digest: image.digest(),
            doubt,
        })
    };
    let mut decoded: Vec<(usize, Result<Decoded>)> = groups
        .par_iter()
        .flat_map_iter(|group| {
            let source = |position: &usize| &*dataset.entries[*position].source;
            let file = (group.len() > 1).then(|| source(&group[0]).decode());
            let found: Vec<_> = (group.iter())
                .map(|position| {
                    let source = source(position);
                    let image = match &file {
                        Some(Ok(file)) => source.load_from(file),
                        // Each entry says what is wrong with its file.
                        Some(Err(_)) | None => source.load(),
                    };
                    (*position, image.and_then(|image| look(source, image)))
                })
                .collect();
            let now_done = done.fetch_add(found.len(), Ordering::Relaxed) + found.len();
            progress(now_done, total);
            found
        })
        .collect();
    decoded.sort_by_key(|(position, _)| *position);
    decoded.into_iter().map(|(_, decoded)| decoded).collect()
}

fn verify(
    manifest: &Manifest,
    dataset: &Dataset,
    root: &Path,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Vec<Problem>> {
    let mut problems = Vec::new();
    let of = if manifest.checksums.of.is_empty() {
        String::new()
    } else {
        format!(", of {}", manifest.checksums.of)
    };
    let differs = "(help: copy it again, or ignore this if it is another edition of the data)";
    if let (Some(expected), Some(index)) = (&manifest.checksums.index, manifest.index_file()) {
        let path = root.join(index);
        if path.is_file() {
            let found = file_sha256(&path)?;
            if found != *expected {
                problems.push(Problem::new(
                    index,
                    format!(
                        "its SHA-256 is {found}, not {expected} as in the manifest{of} {differs}"
                    ),
                ));
            }
        }
    }
    let sums = read_sums(&root.join(SUMS_FILE))?;
    if manifest.checksums.files.is_none() && sums.is_empty() {
        return Ok(problems);
    }
    let mut files: BTreeMap<String, PathBuf> = sums
        .keys()
        .map(|path| (path.clone(), root.join(path)))
        .collect();
    let mut images = Vec::new();
    for path in dataset
        .entries
        .iter()
        .filter_map(|entry| entry.source.path())
    {
        let name = relative(root, &path);
        images.push(name.clone());
        files.insert(name, path);
    }
    images.sort_unstable();
    images.dedup();
    let done = AtomicUsize::new(0);
    let total = files.len();
    let digests: BTreeMap<&String, Result<String>> = files
        .par_iter()
        .map(|(name, path)| {
            let digest = file_sha256(path);
            progress(done.fetch_add(1, Ordering::Relaxed) + 1, total);
            (name, digest)
        })
        .collect();
    for (name, expected) in &sums {
        let message = match digests.get(name) {
            Some(Ok(found)) if found == expected => continue,
            Some(Ok(found)) => {
                format!("its SHA-256 is {found}, not {expected} as in {SUMS_FILE} {differs}")
            }
            Some(Err(error)) => format!("it is in {SUMS_FILE}, but cannot be read: {error}"),
            None => continue,
        };
        problems.push(Problem::new(name, message));
    }
    if let Some(expected) = &manifest.checksums.files {
        let mut hasher = Sha256::new();
        for name in &images {
            if let Some(Ok(digest)) = digests.get(name) {
                hasher.update(format!("{digest}  {name}\n").as_bytes());
            }
        }
        let found = hex(&hasher.finalize());
        if found != *expected {
            problems.push(Problem::new(
                format!("the {} image files", images.len()),
                format!(
                    "their SHA-256 is {found}, not {expected} as in the manifest{of} {differs}"
                ),
            ));
        }
    }
    Ok(problems)
}

/// File name to digest; empty if there is no such file.
fn read_sums(path: &Path) -> Result<BTreeMap<String, String>> {
    if !path.exists() {
        return Ok(BTreeMap::new());
    }
    let text = read_text(path, MAX_TABLE_BYTES)?;
    let mut sums = BTreeMap::new();
    for (position, line) in text.lines().enumerate() {
        let parsed = line
            .split_once(char::is_whitespace)
            .map(|(sum, name)| (sum, name.trim_start().trim_start_matches('*')))
            .filter(|(sum, name)| {
                sum.len() == 64
                    && sum.bytes().all(|byte| byte.is_ascii_hexdigit())
                    && !name.is_empty()
            });
        let Some((sum, name)) = parsed else {
            if line.trim().is_empty() {
                continue;
            }
            return Err(
                Error::new(ErrorKind::Format, "no checksum and file name here")
                    .with_path(path)
                    .with_place(format!("line {}", position + 1))
                    .with_help("make the file with `sha256sum FILE... > SHA256SUMS`"),
            );
        };
        let name = name.trim_start_matches("./").to_owned();
        sums.insert(name, sum.to_ascii_lowercase());
    }
    Ok(sums)
}
