//! What do OpenCV's extraction and FAISS take, when Python calls them?
//!
//! `scripts/speed_rivals.py` reads a job from a folder and answers in JSON; the script is part of
//! this program, so that the two always fit.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};
use chronotope::feature::{Descriptor, GrayImage};
use chronotope::simd::NearestTwo;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

const SCRIPT: &str = include_str!("../../../scripts/speed_rivals.py");

/// A Python that can import `cv2` and `faiss`.
#[derive(Debug)]
pub struct Python {
    executable: PathBuf,
}

/// OpenCV's times and what it found in each image.
#[derive(Debug, Deserialize)]
pub struct Extraction {
    /// The version of OpenCV.
    pub version: String,
    /// Of all images.
    pub ms: Vec<f64>,
    /// Mean over the images of the fastest detection and the fastest description.
    pub ms_best: f64,
    /// Number of features and weighted sum of their bytes.
    pub checksums: Vec<(u64, u64)>,
}

/// FAISS's times and answers.
#[derive(Debug, Deserialize)]
pub struct Search {
    /// The version of FAISS.
    pub version: String,
    /// One for each index and setting.
    pub answers: Vec<Answer>,
}

/// What one index of FAISS did.
#[derive(Debug, Deserialize)]
pub struct Answer {
    /// The index and its setting.
    pub name: String,
    /// Of all queries together, one entry a repetition.
    pub ms: Vec<f64>,
    /// Share of queries whose nearest was found.
    pub recall: f64,
    /// Whether both nearest distances of every query are the exact ones.
    pub is_equal: bool,
    /// What building took.
    pub build_s: f64,
}

/// Which indexes are built beside the flat one.
#[derive(Clone, Copy, Debug)]
pub struct Indexes<'a> {
    /// Lists of the inverted file; none where it is `None`.
    pub num_lists: Option<usize>,
    /// Lists that are searched, one row each.
    pub probes: &'a [usize],
    /// Whether the graph is built.
    pub graph: bool,
    /// Whether OpenCV searches as well, because this program is built without it.
    pub opencv: bool,
}

#[derive(Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
enum Job<'a> {
    Extract {
        width: usize,
        height: usize,
        num_features: usize,
    },
    Search {
        approximate: bool,
        num_lists: usize,
        probes: &'a [usize],
        graph: bool,
        opencv: bool,
    },
}

impl Python {
    /// If it has both modules.
    pub fn new(executable: &Path) -> Result<Self> {
        let output = Command::new(executable)
            .args(["-c", "import cv2, faiss, numpy; cv2.xfeatures2d"])
            .output()
            .with_context(|| format!("cannot run {}", executable.display()))?;
        ensure!(
            output.status.success(),
            "{} lacks cv2 with contrib or faiss: install opencv-contrib-python-headless and faiss-cpu, or use \
             scripts/speed.sh",
            executable.display()
        );
        Ok(Self {
            executable: executable.to_owned(),
        })
    }

    /// OpenCV's STAR and BRIEF on images of one size.
    pub fn extract(&self, images: &[GrayImage]) -> Result<Extraction> {
        let (width, height) = images
            .first()
            .map_or((0, 0), |image| (image.width(), image.height()));
        let pixels: Vec<u8> = images.iter().flat_map(GrayImage::data).copied().collect();
        let job = Job::Extract {
            width,
            height,
            num_features: 500,
        };
        self.run(&job, &[("images.bin", pixels)])
    }

    /// FAISS's binary indexes; `nearest` is the exact answer that theirs is compared with.
    pub fn search(
        &self,
        queries: &[Descriptor],
        rows: &[Descriptor],
        nearest: &[NearestTwo],
        indexes: Indexes<'_>,
    ) -> Result<Search> {
        let bytes = |all: &[Descriptor]| all.iter().flat_map(|one| one.to_bytes()).collect();
        let nearest = nearest
            .iter()
            .flat_map(|found| [found.best_bits, found.second_bits])
            .flat_map(u16::to_ne_bytes)
            .collect();
        let job = Job::Search {
            approximate: indexes.num_lists.is_some(),
            num_lists: indexes.num_lists.unwrap_or(0),
            probes: indexes.probes,
            graph: indexes.graph,
            opencv: indexes.opencv,
        };
        let files = [
            ("queries.bin", bytes(queries)),
            ("rows.bin", bytes(rows)),
            ("nearest.bin", nearest),
        ];
        self.run(&job, &files)
    }

    fn run<T: DeserializeOwned>(&self, job: &Job<'_>, files: &[(&str, Vec<u8>)]) -> Result<T> {
        let folder = tempfile::tempdir().context("no temporary folder")?;
        let write = |name: &str, bytes: &[u8]| {
            std::fs::write(folder.path().join(name), bytes)
                .with_context(|| format!("cannot write {name} to {}", folder.path().display()))
        };
        write("rivals.py", SCRIPT.as_bytes())?;
        write("job.json", &serde_json::to_vec(job)?)?;
        for (name, bytes) in files {
            write(name, bytes)?;
        }
        let output = Command::new(&self.executable)
            .arg(folder.path().join("rivals.py"))
            .arg(folder.path())
            .output()
            .with_context(|| format!("cannot run {}", self.executable.display()))?;
        ensure!(
            output.status.success(),
            "speed_rivals.py failed: {}",
            String::from_utf8_lossy(&output.stderr).trim()
        );
        serde_json::from_slice(&output.stdout).context("speed_rivals.py answered no JSON")
    }
}
