//! How long does one image take, from grey bytes to 500 features?
//!
//! Every benchmark asserts what it found, so that a fast wrong answer is no answer.

use std::hint::black_box;

use chronotope::feature::{Extractor, GrayImage, StarBrief, StarBriefConfig};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};

/// A reproducible picture with structure of every size: overlapping rectangles and fine noise.
fn picture(width: usize, height: usize) -> GrayImage {
    let mut state = 0x2545_F491_4F6C_DD1D_u64;
    let mut next = |below: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 33) as usize % below
    };
    let mut data = vec![110_u8; width * height];
    for _ in 0..width * height / 150 {
        let (w, h) = (2 + next(26), 2 + next(26));
        let (x, y, level) = (next(width - w), next(height - h), next(256) as u8);
        for row in data.chunks_exact_mut(width).skip(y).take(h) {
            row[x..x + w].fill(level);
        }
    }
    for pixel in &mut data {
        *pixel = pixel.saturating_add(next(12) as u8);
    }
    GrayImage::new(width, height, data).unwrap_or_else(|error| panic!("{error}"))
}

fn extract(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("star_brief");
    for (width, height) in [(640, 480), (640, 512), (1024, 384)] {
        let image = picture(width, height);
        group.throughput(Throughput::Elements((width * height) as u64));
        let extractor =
            StarBrief::new(StarBriefConfig::default()).unwrap_or_else(|error| panic!("{error}"));
        group.bench_function(format!("extract 500 of {width}x{height}"), |bencher| {
            bencher.iter(|| {
                let features = extractor.extract(black_box(&image), None);
                assert_eq!(features.map_or(0, |features| features.len()), 500);
            });
        });
        let found = extractor
            .detect(&image, None)
            .map_or(0, |keypoints| keypoints.len());
        assert!(found > 500);
        group.bench_function(format!("detect in {width}x{height}"), |bencher| {
            bencher.iter(|| {
                let keypoints = extractor.detect(black_box(&image), None);
                assert_eq!(keypoints.map_or(0, |keypoints| keypoints.len()), found);
            });
        });
    }
    group.finish();
}

criterion_group!(benches, extract);
criterion_main!(benches);
