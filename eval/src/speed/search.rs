//! How long do 500 descriptors take to find their two nearest of so many rows?

use std::time::Instant;

use anyhow::{Context, Result, ensure};
use chronotope::feature::Descriptor;
use chronotope::matching::{InvertedFile, NearestNeighbours, SearchScratch};
use chronotope::simd::{Kernel, NearestTwo, PackedDescriptors};
use hnsw_rs::prelude::{Distance, Hnsw};

use super::measurement::{Measurement, SpeedOptions, SpeedReport, time};
use super::rivals::{Indexes, Python};
use super::workload::Workload;

/// What the section is called.
pub(super) const SECTION: &str = "two nearest of 256 bits";
/// The row of OpenCV.
pub(super) const OPENCV: &str = "OpenCV BFMatcher";
const NUM_QUERIES: usize = 500;
/// Connections of a point and candidates while building, of `hnsw_rs`.
const CONNECTIONS: usize = 16;
const CANDIDATES: usize = 200;
/// Lists of an inverted file that are searched, one row of the table each.
const PROBES: [usize; 6] = [4, 16, 32, 64, 128, 256];
/// Rows from which on approximate searches are worth a look.
const MIN_APPROXIMATE: usize = 10_000;

/// Every kernel and rival on `num_rows` rows.
pub(super) fn measure(
    workload: &Workload,
    num_rows: usize,
    options: &SpeedOptions,
    python: Option<&Python>,
    report: &mut SpeedReport,
) -> Result<()> {
    let queries = workload.query_descriptors(NUM_QUERIES);
    let rows = workload.grown(num_rows, 7);
    let packed = PackedDescriptors::pack(&rows);
    let case = format!("{NUM_QUERIES} x {num_rows}");
    let row = |subject: &str, ms: &[f64]| {
        Measurement::new(SECTION, &case, subject, ms).pairs(NUM_QUERIES * num_rows)
    };

    let mut exact = vec![NearestTwo::EMPTY; NUM_QUERIES];
    Kernel::best().nearest_two(&queries, &packed, &mut exact);
    let mut found = exact.clone();
    for kernel in Kernel::available() {
        let ms = time(5, || {
            kernel.nearest_two(&queries, &packed, &mut found);
        });
        ensure!(found == exact, "kernel {kernel} finds other neighbours");
        report.measurements.push(row(kernel.name(), &ms));
    }
    let limits = Kernel::available().map(|kernel| {
        let mut total = 0;
        let ms = time(5, || total = kernel.sum_of_distances(&queries, &packed));
        (kernel, ms, total)
    });
    let mut first_total = None;
    for (kernel, ms, total) in limits {
        ensure!(
            *first_total.get_or_insert(total) == total,
            "kernel {kernel} sums other distances"
        );
        let subject = format!("{kernel}: popcounts alone");
        report
            .measurements
            .push(row(&subject, &ms).note("no answer: the limit to aim at"));
    }

    if num_rows >= MIN_APPROXIMATE {
        inverted(&queries, &rows, &exact, &row, report)?;
    }
    opencv(&queries, &rows, &exact, &row, report, python.is_some())?;
    if let Some(python) = python {
        faiss(python, &queries, &rows, &exact, &row, report)?;
    }
    if (MIN_APPROXIMATE..=options.max_hnsw_rows).contains(&num_rows) {
        hnsw(&queries, &rows, &exact, &row, report);
    } else if num_rows > options.max_hnsw_rows.max(MIN_APPROXIMATE) {
        report.missing.push(format!(
            "hnsw_rs at {num_rows} rows: building takes minutes; --max-hnsw-rows {num_rows} measures it"
        ));
    }
    Ok(())
}

/// Share of queries of which the nearest distance is that of the exact answer.
fn recall(found: impl Iterator<Item = u16>, exact: &[NearestTwo]) -> f64 {
    let right = found
        .zip(exact)
        .filter(|(bits, exact)| *bits == exact.best_bits);
    right.count() as f64 / exact.len() as f64
}

/// A search that may miss: how often it does not, and how long its index took.
fn approximate(row: Measurement, recall: f64, build_s: f64) -> Measurement {
    row.recall(recall).note(format!("built in {build_s:.1} s"))
}

/// Our inverted file, lists searched by lists searched.
fn inverted(
    queries: &[Descriptor],
    rows: &[Descriptor],
    exact: &[NearestTwo],
    row: &impl Fn(&str, &[f64]) -> Measurement,
    report: &mut SpeedReport,
) -> Result<()> {
    let num_lists = num_lists(rows.len());
    let start = Instant::now();
    let mut file = InvertedFile::new(rows, num_lists, 1)?;
    let build_s = start.elapsed().as_secs_f64();
    let mut scratch = SearchScratch::default();
    let mut found = vec![NearestTwo::EMPTY; queries.len()];
    for probes in PROBES {
        file = file.with_probes(probes)?;
        let ms = time(5, || {
            file.nearest_two_into(&mut scratch, queries, &mut found);
        });
        let nearest = found.iter().map(|found| found.best_bits);
        let ours = row(&format!("ours, IVF {num_lists}, {probes} probes"), &ms);
        (report.measurements).push(approximate(ours, recall(nearest, exact), build_s));
    }
    Ok(())
}

/// The bits of two descriptors that differ, for `hnsw_rs`.
struct Bits;

impl Distance<u64> for Bits {
    fn eval(&self, a: &[u64], b: &[u64]) -> f32 {
        let bits: u32 = a.iter().zip(b).map(|(a, b)| (a ^ b).count_ones()).sum();
        bits as f32
    }
}

fn hnsw(
    queries: &[Descriptor],
    rows: &[Descriptor],
    exact: &[NearestTwo],
    row: &impl Fn(&str, &[f64]) -> Measurement,
    report: &mut SpeedReport,
) {
    let start = Instant::now();
    let graph: Hnsw<'_, u64, Bits> = Hnsw::new(CONNECTIONS, rows.len(), 16, CANDIDATES, Bits);
    for (id, descriptor) in rows.iter().enumerate() {
        graph.insert((&descriptor.0, id));
    }
    let build_s = start.elapsed().as_secs_f64();
    for ef in [16, 64, 128] {
        let mut found = Vec::new();
        let ms = time(3, || {
            found = queries
                .iter()
                .map(|query| graph.search(&query.0, 2, ef))
                .collect();
        });
        let nearest = found.iter().map(|found| {
            found
                .first()
                .map_or(u16::MAX, |nearest| nearest.distance as u16)
        });
        let theirs = row(&format!("hnsw_rs, ef {ef}"), &ms);
        (report.measurements).push(approximate(theirs, recall(nearest, exact), build_s));
    }
}

fn faiss(
    python: &Python,
    queries: &[Descriptor],
    rows: &[Descriptor],
    exact: &[NearestTwo],
    row: &impl Fn(&str, &[f64]) -> Measurement,
    report: &mut SpeedReport,
) -> Result<()> {
    let num_lists = (rows.len() >= MIN_APPROXIMATE).then(|| num_lists(rows.len()));
    let indexes = Indexes {
        num_lists,
        probes: &PROBES,
        graph: (MIN_APPROXIMATE..=100_000).contains(&rows.len()),
        opencv: !cfg!(feature = "opencv"),
    };
    let search = python
        .search(queries, rows, exact, indexes)
        .context("FAISS")?;
    for answer in &search.answers {
        if answer.name == OPENCV {
            ensure!(answer.is_equal, "OpenCV finds other distances");
            let note = "its core `batchDistance` through Python, one thread, distances equal";
            let theirs = row(OPENCV, &answer.ms).reference().note(note);
            report.measurements.push(theirs);
            continue;
        }
        let mut measurement = row(&format!("FAISS {}", answer.name), &answer.ms);
        if answer.name == "flat" {
            ensure!(answer.is_equal, "FAISS's flat index finds other distances");
            measurement = measurement.note(format!("version {}, distances equal", search.version));
        } else {
            measurement = approximate(measurement, answer.recall, answer.build_s);
        }
        report.measurements.push(measurement);
    }
    Ok(())
}

/// Lists of an inverted file over so many rows: the power of two nearest to four times the root.
fn num_lists(num_rows: usize) -> usize {
    1 << (4.0 * (num_rows as f64).sqrt()).log2().round() as u32
}

#[cfg(feature = "opencv")]
fn opencv(
    queries: &[Descriptor],
    rows: &[Descriptor],
    exact: &[NearestTwo],
    row: &impl Fn(&str, &[f64]) -> Measurement,
    report: &mut SpeedReport,
    _: bool,
) -> Result<()> {
    use opencv::core::{self, DMatch, Mat, Vector};
    use opencv::features2d::BFMatcher;
    use opencv::prelude::*;

    /// `BFMatcher` asserts at 262,144 rows of one matrix.
    const MAX_ROWS: usize = 200_000;

    let mat = |descriptors: &[Descriptor]| -> Result<Mat> {
        let bytes: Vec<u8> = descriptors.iter().flat_map(|one| one.to_bytes()).collect();
        Ok(Mat::from_slice(&bytes)?
            .reshape(1, descriptors.len() as i32)?
            .try_clone()?)
    };
    core::set_num_threads(1)?;
    let mut matcher = BFMatcher::new(core::NORM_HAMMING, false)?;
    let mut train = Vector::<Mat>::new();
    for rows in rows.chunks(MAX_ROWS) {
        train.push(mat(rows)?);
    }
    matcher.add(&train)?;
    let queries = mat(queries)?;
    let mut found = Vector::<Vector<DMatch>>::new();
    let mut outcome = Ok(());
    let ms = time(3, || {
        outcome = matcher.knn_match(&queries, &mut found, 2, &core::no_array(), false);
    });
    outcome?;
    for (found, exact) in found.iter().zip(exact) {
        let bits: Vec<u16> = found.iter().map(|one| one.distance as u16).collect();
        ensure!(
            bits == [exact.best_bits, exact.second_bits],
            "OpenCV's BFMatcher finds distances {bits:?}, not {exact:?}"
        );
    }
    report.measurements.push(
        row(OPENCV, &ms)
            .reference()
            .note("one thread, distances equal"),
    );
    Ok(())
}

#[cfg(not(feature = "opencv"))]
#[allow(clippy::unnecessary_wraps)] // reason: with the feature it can fail.
fn opencv(
    _: &[Descriptor],
    _: &[Descriptor],
    _: &[NearestTwo],
    _: &impl Fn(&str, &[f64]) -> Measurement,
    report: &mut SpeedReport,
    by_python: bool,
) -> Result<()> {
    let missing = "OpenCV's BFMatcher: built without `--features opencv`".to_owned();
    if !by_python && !report.missing.contains(&missing) {
        report.missing.push(missing);
    }
    Ok(())
}
