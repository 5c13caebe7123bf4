//! How long do 500 STAR keypoints and their BRIEF bits take, from grey bytes? And other features?

use anyhow::{Result, ensure};
use chronotope::feature::{Extractor, Features, StarBrief, StarBriefConfig};
use chronotope::simd::Kernel;
use rayon::prelude::*;

use super::measurement::{Measurement, time};
use super::rivals::Python;
use super::workload::Workload;

/// What the section is called; the targets look for it.
pub(super) const SECTION: &str = "extraction, 500 features";

/// The same of the extractor that the options name.
const OTHER_SECTION: &str = "extraction by --extractor";

/// Each kernel, and OpenCV where there is a Python with it, on the same grey bytes.
pub(super) fn measure(workload: &Workload, python: Option<&Python>) -> Result<Vec<Measurement>> {
    let Some(first) = workload.images.first() else {
        return Ok(Vec::new());
    };
    let case = format!("{} x {} px", first.width(), first.height());
    let mut rows = Vec::new();
    let mut found: Option<Vec<Features>> = None;
    for kernel in Kernel::available() {
        let extractor = StarBrief::with_kernel(StarBriefConfig::default(), kernel)?;
        let mut features = Features::new();
        let mut all = Vec::new();
        let mut ms = Vec::new();
        let mut best = 0.0;
        for image in &workload.images {
            all.push(extractor.extract(image, None)?);
            let mut outcome = Ok(());
            let of_image = time(5, || {
                outcome = extractor.extract_into(image.view(), None, &mut features);
            });
            outcome?;
            best += of_image.iter().copied().fold(f64::INFINITY, f64::min);
            ms.extend(of_image);
        }
        let expected = found.get_or_insert_with(|| all.clone());
        ensure!(*expected == all, "kernel {kernel} finds other features");
        let best = best / workload.images.len() as f64;
        rows.push(Measurement::new(SECTION, &case, kernel.name(), &ms).best(best));
    }
    if let (Some(python), Some(found)) = (python, &found) {
        let theirs = python.extract(&workload.images)?;
        for (image, (theirs, ours)) in theirs.checksums.iter().zip(found).enumerate() {
            ensure!(
                *theirs == checksum(ours),
                "OpenCV finds other features in image {image}: {theirs:?}, not {:?}",
                checksum(ours)
            );
        }
        let note = format!("version {}, one thread, features equal", theirs.version);
        rows.push(
            Measurement::new(SECTION, &case, "OpenCV", &theirs.ms)
                .best(theirs.ms_best)
                .reference()
                .note(note),
        );
    }
    Ok(rows)
}

/// Any extractor on the same grey bytes, for each image: one image at a time, then two at a time.
pub(super) fn measure_other(
    workload: &Workload,
    extractor: &dyn Extractor,
) -> Result<Vec<Measurement>> {
    let Some(first) = workload.images.first() else {
        return Ok(Vec::new());
    };
    let case = format!("{} x {} px", first.width(), first.height());
    let num_images = workload.images.len() as f64;
    let mut rows = Vec::new();
    for num_threads in [1, 2] {
        let pool = (rayon::ThreadPoolBuilder::new().num_threads(num_threads)).build()?;
        let mut outcome = Ok(());
        let ms = time(5, || {
            outcome = pool.install(|| {
                let images = workload.images.par_iter();
                images.try_for_each(|image| extractor.extract(image, None).map(drop))
            });
        });
        outcome?;
        let ms: Vec<f64> = ms.iter().map(|ms| ms / num_images).collect();
        let subject = format!("{num_threads} at a time");
        rows.push(Measurement::new(OTHER_SECTION, &case, subject, &ms).note(extractor.id()));
    }
    Ok(rows)
}

/// How many features, and the sum of their bytes, each times its place from 1.
fn checksum(features: &Features) -> (u64, u64) {
    let bytes = features.descriptors().iter().flat_map(|one| one.to_bytes());
    let sum = (1..).zip(bytes).map(|(i, byte)| i * u64::from(byte)).sum();
    (features.len() as u64, sum)
}
