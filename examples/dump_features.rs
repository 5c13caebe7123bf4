//! Writes the grey bytes and all features of images to stdout, for `scripts/parity.py` and
//! `scripts/make_golden.py` to compare with OpenCV's.
//!
//! One job a line on stdin: `{"path": "...", "options": LoadOptions, "config": StarBriefConfig}`,
//! the last two optional. For each job, in order, little-endian:
//!
//! ```text
//! ok:    u32 0, u32 width, u32 height, width * height grey bytes,
//!        u32 keypoints, per keypoint f32 x, y, size, response        (before the cut, sorted),
//!        u32 features, per feature the index as u32 and 32 bytes     (describable ones)
//! error: u32 1, u32 length, message
//! ```

use std::io::{self, BufRead, Write};
use std::path::PathBuf;

use anyhow::Result;
use chronotope::feature::{
    Extractor, GrayImage, LoadOptions, StarBrief, StarBriefConfig, load_gray,
};

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Job {
    path: PathBuf,
    #[serde(default)]
    options: LoadOptions,
    #[serde(default)]
    config: StarBriefConfig,
}

/// The file decoded last: consecutive jobs often cut several crops out of one image.
type Decoded = Option<(PathBuf, GrayImage)>;

fn main() -> Result<()> {
    let mut out = io::BufWriter::with_capacity(1 << 20, io::stdout().lock());
    let mut decoded = None;
    for line in io::stdin().lock().lines() {
        match run(&serde_json::from_str(&line?)?, &mut decoded) {
            Ok(record) => out.write_all(&record)?,
            Err(error) => {
                let message = error.to_string();
                out.write_all(&1_u32.to_le_bytes())?;
                out.write_all(&(message.len() as u32).to_le_bytes())?;
                out.write_all(message.as_bytes())?;
            }
        }
        out.flush()?;
    }
    Ok(())
}

fn run(job: &Job, decoded: &mut Decoded) -> Result<Vec<u8>> {
    let whole = match decoded {
        Some((path, image)) if *path == job.path => image.clone(),
        _ => {
            let limits = LoadOptions::default().with_limits(job.options.limits());
            let image = load_gray(&job.path, &limits)?;
            decoded.insert((job.path.clone(), image)).1.clone()
        }
    };
    let image = job.options.apply(whole)?;
    let extractor = StarBrief::new(job.config.clone().with_num_features(usize::MAX))?;
    let keypoints = extractor.detect(&image, None)?;
    let features = extractor.extract(&image, None)?;

    let mut record = Vec::with_capacity(image.data().len() + 64 * keypoints.len());
    let number = |record: &mut Vec<u8>, n: usize| record.extend((n as u32).to_le_bytes());
    number(&mut record, 0);
    number(&mut record, image.width());
    number(&mut record, image.height());
    record.extend(image.data());
    number(&mut record, keypoints.len());
    for keypoint in &keypoints {
        for value in [keypoint.x, keypoint.y, keypoint.size, keypoint.response] {
            record.extend(value.to_le_bytes());
        }
    }
    number(&mut record, features.len());
    let mut index = 0;
    for (keypoint, descriptor) in features.keypoints().iter().zip(features.descriptors()) {
        while keypoints.get(index).is_some_and(|other| other != keypoint) {
            index += 1;
        }
        number(&mut record, index);
        record.extend(descriptor.to_bytes());
    }
    Ok(record)
}
