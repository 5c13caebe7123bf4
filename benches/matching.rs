//! How many pairs of descriptors per second does each kernel compare, and what does a vote cost?
//!
//! `cargo bench --bench matching` prints the throughput in elements per second; an element is one
//! pair of 256-bit descriptors. Every timed result is compared with the scalar twin's.

use std::hint::black_box;
use std::time::Duration;

use chronotope::feature::{Descriptor, Features, Keypoint};
use chronotope::matching::{
    Direction, Displacement, MatchConfig, MatchScratch, Matcher, VoteConfig, VoteScratch,
    vote_displacement,
};
use chronotope::simd::{Kernel, NearestTwo, PackedDescriptors};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};

const NUM_QUERIES: usize = 500;

/// The generator of Vigna's `SplitMix64`: the same descriptors in every run.
struct SplitMix(u64);

impl SplitMix {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    fn descriptors(&mut self, count: usize) -> Vec<Descriptor> {
        (0..count)
            .map(|_| Descriptor(std::array::from_fn(|_| self.next())))
            .collect()
    }

    fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }
}

fn checksum(nearest: &[NearestTwo]) -> u64 {
    nearest.iter().fold(0, |sum: u64, n| {
        let words = [
            n.best,
            n.second,
            u32::from(n.best_bits),
            u32::from(n.second_bits),
        ];
        words.into_iter().fold(sum, |sum, word| {
            sum.wrapping_mul(0x0100_0000_01B3) ^ u64::from(word)
        })
    })
}

fn nearest_two(c: &mut Criterion) {
    let mut random = SplitMix(1);
    for num_rows in [50, 400, 40_000] {
        let queries = random.descriptors(NUM_QUERIES);
        let rows = random.descriptors(num_rows);
        let packed = PackedDescriptors::pack(&rows);
        let mut out = vec![NearestTwo::EMPTY; NUM_QUERIES];
        Kernel::scalar().nearest_two(&queries, &packed, &mut out);
        let expected = checksum(&out);

        let mut group = c.benchmark_group(format!("nearest_two/{NUM_QUERIES}x{num_rows}"));
        group.throughput(Throughput::Elements((NUM_QUERIES * num_rows) as u64));
        for kernel in Kernel::available() {
            group.bench_function(BenchmarkId::new("packed", kernel), |b| {
                b.iter(|| {
                    kernel.nearest_two(&queries, black_box(&packed), &mut out);
                    assert_eq!(checksum(&out), expected);
                });
            });
        }
        group.finish();
    }
}

fn prefixes(c: &mut Criterion) {
    const CHECKPOINTS: [usize; 13] = [5, 10, 15, 20, 25, 30, 40, 50, 75, 100, 150, 200, 300];
    let mut random = SplitMix(2);
    let features = |descriptors: Vec<Descriptor>| {
        let mut features = Features::new();
        for descriptor in descriptors {
            let keypoint = Keypoint {
                x: 0.0,
                y: 0.0,
                size: 10.0,
                response: 1.0,
            };
            features.push(keypoint, descriptor);
        }
        features
    };
    let live = features(random.descriptors(NUM_QUERIES));
    let map = features(random.descriptors(300));
    let cfg = MatchConfig::builder()
        .with_direction(Direction::LiveToMap)
        .with_max_bits(256);
    let Ok(cfg) = cfg.build() else {
        panic!("256 bits are a distance");
    };
    let mut scratch = MatchScratch::default();
    let mut group = c.benchmark_group("prefixes_into/500x300/13_checkpoints");
    group.throughput(Throughput::Elements((NUM_QUERIES * map.len()) as u64));
    let mut expected = None;
    for kernel in Kernel::available() {
        let matcher = Matcher::with_kernel(cfg.clone(), kernel);
        group.bench_function(kernel.name(), |b| {
            b.iter(|| {
                let mut last = Vec::new();
                let (map, live) = (black_box(map.view()), live.view());
                matcher.prefixes_into(&mut scratch, map, live, &CHECKPOINTS, |_, matches| {
                    last.clear();
                    last.extend_from_slice(matches);
                });
                assert_eq!(expected.get_or_insert_with(|| last.clone()), &last);
            });
        });
    }
    group.finish();
}

fn matches_and_vote(c: &mut Criterion) {
    let mut random = SplitMix(3);
    let mut map = Features::new();
    let mut live = Features::new();
    for descriptor in random.descriptors(NUM_QUERIES) {
        let (x, y) = (random.unit() * 640.0, random.unit() * 480.0);
        let keypoint = |dx: f64, dy: f64| Keypoint {
            x: (x + dx) as f32,
            y: (y + dy) as f32,
            size: 10.0,
            response: 1.0,
        };
        map.push(keypoint(0.0, 0.0), descriptor);
        live.push(keypoint(100.0, 5.0), descriptor);
    }
    c.bench_function("matches_into/500x500/default", |b| {
        let matcher = Matcher::new(MatchConfig::default());
        let mut scratch = MatchScratch::default();
        let mut matches = Vec::new();
        b.iter(|| {
            matcher.matches_into(&mut scratch, map.view(), live.view(), &mut matches);
            assert_eq!(matches.len(), NUM_QUERIES);
        });
    });
    for num_matches in [20, 100, 300] {
        let mut displacements: Vec<Displacement> = (0..num_matches)
            .map(|_| Displacement {
                dx_px: random.unit() * 800.0 - 400.0,
                dy_px: random.unit() * 100.0 - 50.0,
            })
            .collect();
        let inliers = num_matches / 2;
        for at in &mut displacements[..inliers] {
            *at = Displacement {
                dx_px: 90.0 + at.dx_px / 40.0,
                dy_px: 5.0 + at.dy_px / 10.0,
            };
        }
        c.bench_function(&format!("vote_displacement/{num_matches}"), |b| {
            let cfg = VoteConfig::default();
            let mut scratch = VoteScratch::default();
            b.iter(|| {
                let vote = vote_displacement(&cfg, &mut scratch, black_box(&displacements));
                assert!(vote.num_inliers as usize >= inliers);
            });
        });
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1));
    targets = nearest_two, prefixes, matches_and_vote
}
criterion_main!(benches);
