//! Made-up pictures for the made-up run: drawn scenes, so that no dataset is needed.

#![allow(
    clippy::unwrap_used,
    reason = "a helper of tests; clippy only knows their functions"
)]

use std::f64::consts::TAU;

use chronotope::feature::GrayImage;
use chronotope::trace::SpectrumSummary;
use chronotope_eval::report::{
    FeatureClass, FeaturePicture, GalleryImage, Mistake, ObservedState, PicturedFeature, Pictures,
    ProbabilityCurve, Raster, RasterRow, TimeAxis,
};

use crate::sample::{PLACES, chance};

const WIDTH: usize = 640;
const HEIGHT: usize = 480;
const YEAR_S: f64 = 31_556_952.0;
const START_S: f64 = 1_293_840_000.0;

/// Sky, a skyline of blocks with windows, and ground; `light` 0..1 shades it.
fn scene(place: usize, light: f64) -> GrayImage {
    let mut data = vec![0; WIDTH * HEIGHT];
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            let block = x / 64;
            let top = 110.0 + 190.0 * chance(&["top", &place.to_string(), &block.to_string()]);
            let window = (x % 32 > 9 && x % 32 < 22) && (y % 40 > 12 && y % 40 < 30);
            let grain = 22.0 * chance(&["grain", &x.to_string(), &y.to_string()]);
            let tone = match y as f64 {
                y if y > 400.0 => 95.0,
                y if y < top => 205.0 - y * 0.15,
                _ if window => 55.0,
                _ => 120.0 + 60.0 * chance(&["wall", &place.to_string(), &block.to_string()]),
            };
            data[y * WIDTH + x] = ((tone + grain) * (0.35 + 0.65 * light)) as u8;
        }
    }
    GrayImage::new(WIDTH, HEIGHT, data).unwrap()
}

fn features() -> Vec<PicturedFeature> {
    (0..230)
        .map(|i| {
            let at = |what: &str| chance(&[what, &i.to_string()]);
            PicturedFeature {
                x: 30.0 + 580.0 * at("x") as f32,
                y: 90.0 + 310.0 * at("y") as f32,
                size: 10.0 + 20.0 * at("size") as f32,
                class: match i {
                    0..34 => FeatureClass::Matched,
                    34..50 => FeatureClass::Missing,
                    _ => FeatureClass::Unexpected,
                },
                probability: 0.55 + 0.44 * at("p") as f32,
            }
        })
        .collect()
}

/// A feature that is visible around the time `peak` of the period.
fn rhythm(title: &str, visits: u32, span_s: f64, period_s: f64, peak: f64) -> ProbabilityCurve {
    let p = |t: f64| 0.5 + 0.47 * (TAU * ((t - START_S) / period_s - peak)).cos();
    let time = |i: u32| START_S + span_s * f64::from(i) / f64::from(visits);
    ProbabilityCurve {
        title: title.into(),
        axis: TimeAxis::UnixSeconds,
        observations: (0..visits)
            .map(|i| ObservedState {
                time: time(i),
                seen: (i > 0).then(|| chance(&[title, &i.to_string()]) < p(time(i))),
            })
            .collect(),
        curve: (0..=300)
            .map(|i| START_S + span_s * f64::from(i) / 300.0)
            .map(|t| (t, p(t)))
            .collect(),
        query_time: Some(START_S + 0.71 * span_s),
        spectrum: SpectrumSummary {
            per: "year".into(),
            frequencies: (1..=24).map(|i| f64::from(i) / 2.0).collect(),
            amplitudes: (1..=24)
                .map(|i| {
                    if i == 2 {
                        0.8
                    } else {
                        0.1 * chance(&[title, &i.to_string()])
                    }
                })
                .collect(),
            window: (1..=24).map(|i| if i == 24 { 1.0 } else { 0.2 }).collect(),
        },
    }
}

/// Features that come and go with the year.
fn raster() -> Raster {
    let times: Vec<f64> = (0..36)
        .map(|i| START_S + YEAR_S * f64::from(i) / 12.0)
        .collect();
    let rows = (0..24)
        .map(|feature: usize| {
            let p: Vec<f64> = (times.iter())
                .map(|t| {
                    0.5 + 0.45 * (TAU * ((t - START_S) / YEAR_S - feature as f64 / 24.0)).cos()
                })
                .collect();
            let seen = (p.iter().enumerate())
                .map(|(i, p)| {
                    (i >= feature / 4).then(|| chance(&[&feature.to_string(), &i.to_string()]) < *p)
                })
                .collect();
            RasterRow { feature, seen, p }
        })
        .collect();
    Raster {
        place: "gate".into(),
        num_features: 312,
        axis: TimeAxis::UnixSeconds,
        times,
        rows,
    }
}

/// Pictures of every kind.
pub(crate) fn sample_pictures() -> Pictures {
    let shown = |place: usize, light: f64, month: &str| GalleryImage {
        image: Some(scene(place, light)),
        caption: format!("{}, {month}", PLACES[place]),
    };
    let mistake = |n: u32, queried: usize, answered: usize| Mistake {
        title: format!(
            "{}/{n:02}.jpg taken for {}, p = 0.8{n}",
            PLACES[queried], PLACES[answered]
        ),
        query: shown(queried, 0.25, "December"),
        truth: shown(queried, 0.9, "June"),
        answered: shown(answered, 0.4, "November"),
    };
    let mut without_image = mistake(7, 2, 0);
    without_image.answered.image = None;
    let mut indexed = rhythm("Corner of a roof, no clock", 12, 11.0, 60.0, 0.0);
    indexed.axis = TimeAxis::VisitIndex;
    for observation in &mut indexed.observations {
        observation.time = ((observation.time - START_S) * 12.0 / 11.0).round() + 1.0;
    }
    indexed.curve = (0..=110)
        .map(|i| (1.0 + f64::from(i) / 10.0, 0.92))
        .collect();
    indexed.query_time = None;
    indexed.spectrum = SpectrumSummary::default();
    Pictures {
        features: vec![FeaturePicture {
            image: scene(1, 0.8),
            title: "gate, 14 October, predicted by fused, order chosen, n = 50".into(),
            note: "Located at gate: it has 97.0 % (an answer needs 95.0 %).".into(),
            features: features(),
        }],
        curves: vec![
            rhythm("Leaves beside the gate", 12, YEAR_S, YEAR_S, 0.5),
            rhythm(
                "Lit window of the tower",
                7 * 48,
                7.0 * 86_400.0,
                86_400.0,
                0.9,
            ),
            rhythm("Shadow of the bridge", 20, 3.0 * YEAR_S, YEAR_S, 0.2),
            indexed,
        ],
        raster: Some(raster()),
        mistakes: vec![mistake(3, 4, 1), mistake(5, 0, 3), without_image],
    }
}
