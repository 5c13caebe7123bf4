//! The synthetic world keeps its promises: same bytes, true p(t), a control without rhythms.

use std::collections::BTreeSet;

use chronotope::dataset::synthetic::{Element, Schedule, World, WorldConfig};
use chronotope::feature::GrayImage;
use chronotope::{ErrorKind, Time};
use sha2::{Digest, Sha256};

fn at(text: &str) -> Time {
    Time::parse(text).unwrap_or_else(|error| panic!("{error}"))
}

fn world(seed: u64, rhythms: bool) -> World {
    let cfg = WorldConfig::new(seed).with_rhythms(rhythms);
    World::new(&cfg).unwrap_or_else(|error| panic!("{error}"))
}

/// Times that share no rhythm with day, week or year.
fn times() -> impl Iterator<Item = Time> {
    (0..300).map(|k| at("2023-01-01T00:00:00Z").plus_us(k * 211_234_567_891))
}

/// The first 64 bits of the SHA-256 of the pixels.
fn digest(image: &GrayImage) -> String {
    let bytes = Sha256::digest(image.data());
    let start = bytes
        .iter()
        .take(8)
        .fold(0_u64, |sum, &byte| sum << 8 | u64::from(byte));
    format!("{start:016x}")
}

#[test]
fn renders_the_same_bytes_on_every_machine() {
    let world = world(1000, true);
    let control = self::world(1000, false);
    let golden = [
        (&world, 0, "2023-01-18T11:00:00Z", 0, "813042c67872cbf7"),
        (&world, 3, "2023-07-15T23:00:00Z", 0, "ec4d18cb440d89a5"),
        (&world, 7, "2024-10-24T09:00:00Z", 5, "01813347e997f2bd"),
        (&control, 3, "2023-07-15T23:00:00Z", 0, "e919b615058be422"),
    ];
    let expected: Vec<&str> = golden.iter().map(|row| row.4).collect();
    let found: Vec<String> = golden
        .iter()
        .map(|&(world, place, time, visit, _)| digest(&world.render(place, at(time), visit)))
        .collect();
    assert_eq!(found, expected);
}

#[test]
fn visibility_is_a_probability_and_cells_show_one_element_at_most() {
    for rhythms in [true, false] {
        let world = world(1001, rhythms);
        for place in 0..world.places().len() {
            for time in times() {
                for cell in world.truth(place).chunk_by(|a, b| a.cell() == b.cell()) {
                    let sum: f64 = cell.iter().map(|element| element.visibility(time)).sum();
                    assert!(sum <= 1.0 + 1e-12, "{:?}: {sum}", cell[0].kind());
                    for element in cell {
                        let p = element.visibility(time);
                        assert!((0.0..=1.0).contains(&p), "{:?}: {p}", element.kind());
                    }
                }
                let shown = world.shown(place, time, 0);
                let cells: BTreeSet<u32> = shown
                    .iter()
                    .map(|&id| world.truth(place)[id as usize].cell())
                    .collect();
                assert_eq!(cells.len(), shown.len());
            }
        }
    }
}

#[test]
fn elements_are_shown_as_often_as_their_true_probability_says() {
    const NUM_VISITS: u64 = 1500;
    let world = world(1002, true);
    for time in [at("2023-01-11T22:00:00Z"), at("2023-07-23T12:00:00Z")] {
        let mut counts = vec![0_u32; world.truth(2).len()];
        for visit in 0..NUM_VISITS {
            for id in world.shown(2, time, visit) {
                counts[id as usize] += 1;
            }
        }
        for (element, count) in world.truth(2).iter().zip(counts) {
            let frequency = f64::from(count) / NUM_VISITS as f64;
            let p = element.visibility(time);
            // Five standard deviations: never by chance, over a hundred comparisons.
            let margin = 5.0 * (p * (1.0 - p) / NUM_VISITS as f64).sqrt() + 1e-9;
            assert!(
                (frequency - p).abs() <= margin,
                "{:?}: {frequency} is not {p}",
                element.kind()
            );
        }
    }
}

#[test]
fn the_control_has_constant_visibility_with_the_same_long_term_mean() {
    let (world, control) = (world(1003, true), world(1003, false));
    for place in 0..2 {
        let truth = world.truth(place);
        assert_eq!(truth.len(), control.truth(place).len());
        for (element, twin) in truth.iter().zip(control.truth(place)) {
            assert_eq!((element.kind(), element.rect()), (twin.kind(), twin.rect()));
            let constant = twin.visibility(Time::default());
            assert!(times().all(|time| twin.visibility(time) == constant));
            let mean = times().map(|time| element.visibility(time)).sum::<f64>() / 300.0;
            assert!(
                (mean - constant).abs() < 0.05,
                "{:?}: {mean} is not {constant}",
                element.kind()
            );
        }
        // The rhythmic world is one: much of it comes and goes.
        let swings = |element: &&Element| {
            let p = || times().map(|time| element.visibility(time));
            p().fold(0.0, f64::max) - p().fold(1.0, f64::min) > 0.8
        };
        assert!(truth.iter().filter(swings).count() >= 16);
    }
}

/// Grey values of an element's inner part as a visit's camera sees them, on a grid of 2 px.
fn sample(world: &World, element: &Element, time: Time, visit: u64) -> Vec<f64> {
    let image = world.render(0, time, visit);
    let view = world.viewpoint(0, time, visit);
    let centre = |size: usize| (size - 1) as f64 / 2.0;
    let (cx, cy) = (centre(image.width()), centre(image.height()));
    let rect = element.rect();
    let mut values = Vec::new();
    for y in (rect.y + 4..rect.y + rect.height - 4).step_by(2) {
        for x in (rect.x + 4..rect.x + rect.width - 4).step_by(2) {
            let u = (f64::from(x) - cx) * view.scale + cx + view.dx_px;
            let v = (f64::from(y) - cy) * view.scale + cy + view.dy_px;
            values.push(f64::from(image.row(v.round() as usize)[u.round() as usize]));
        }
    }
    values
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let (mean_a, mean_b) = (mean(a), mean(b));
    let product = |x: &[f64], mx: f64, y: &[f64], my: f64| {
        x.iter()
            .zip(y)
            .map(|(x, y)| (x - mx) * (y - my))
            .sum::<f64>()
    };
    product(a, mean_a, b, mean_b)
        / (product(a, mean_a, a, mean_a) * product(b, mean_b, b, mean_b)).sqrt()
}

#[test]
fn what_is_shown_is_what_the_image_has_at_that_position() {
    let world = world(1004, false);
    let time = at("2023-05-01T12:00:00Z");
    let mut num_cells = 0;
    for cell in world.truth(0).chunk_by(|a, b| a.cell() == b.cell()) {
        let [first, second] = cell else { continue };
        // Above the heads of passers-by, and shown often enough to compare.
        if first.rect().y > 214 || first.visibility(time).min(second.visibility(time)) < 0.2 {
            continue;
        }
        let visits = |element: &Element| -> Vec<Vec<f64>> {
            (0..60)
                .filter(|&visit| world.shown(0, time, visit).contains(&element.id()))
                .take(9)
                .map(|visit| sample(&world, element, time, visit))
                .collect()
        };
        let (a, b) = (visits(first), visits(second));
        assert!(a.len() > 4 && b.len() > 4);
        let median = |mut values: Vec<f64>| {
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        };
        let same = median(
            a[1..]
                .iter()
                .map(|other| correlation(&a[0], other))
                .collect(),
        );
        let different = median(b.iter().map(|other| correlation(&a[0], other)).collect());
        assert!(
            same > 0.6 && same > different + 0.3,
            "{:?} / {:?}: {same} and {different}",
            first.kind(),
            second.kind()
        );
        num_cells += 1;
    }
    assert!(num_cells >= 3, "{num_cells} cells compared");
}

#[test]
fn places_visits_seeds_and_times_differ() {
    let world = world(1005, true);
    let noon = at("2023-07-12T12:00:00Z");
    let images = [
        world.render(0, noon, 0),
        world.render(1, noon, 0),
        world.render(0, noon, 1),
        world.render(0, at("2023-01-12T12:00:00Z"), 0),
        self::world(1006, true).render(0, noon, 0),
    ];
    let digests: BTreeSet<String> = images.iter().map(digest).collect();
    assert_eq!(digests.len(), images.len());
}

#[test]
fn nights_are_darker_than_days_unless_the_sun_is_stopped() {
    let mean = |rhythms: bool, time: &str| {
        let image = world(1007, rhythms).render(0, at(time), 0);
        let sum: u64 = image.data().iter().map(|&value| u64::from(value)).sum();
        sum as f64 / image.data().len() as f64
    };
    let (noon, midnight) = ("2023-07-12T12:00:00Z", "2023-07-13T00:00:00Z");
    assert!(mean(true, noon) > mean(true, midnight) + 30.0);
    assert!((mean(false, noon) - mean(false, midnight)).abs() < 30.0);
}

#[test]
fn the_dataset_has_every_place_at_every_time() {
    let world = world(1008, true);
    let schedule = Schedule::standard(1008, 30, 12);
    assert_eq!((schedule.learn.len(), schedule.query.len()), (30, 12));
    assert!(schedule.learn[0] >= at("2023-01-01T00:00:00Z"));
    assert!(schedule.learn[29] < at("2024-01-01T00:00:00Z"));
    assert!(schedule.query[0] >= at("2024-01-01T00:00:00Z"));
    assert!(schedule.query[11] < at("2025-01-01T00:00:00Z"));

    let dataset = world.dataset("synthetic", &schedule.learn);
    assert_eq!(dataset.entries.len(), 8 * 30);
    assert!(dataset.problems.is_empty());
    let ids: BTreeSet<&str> = dataset.entries.iter().map(|entry| &*entry.id).collect();
    assert_eq!(ids.len(), dataset.entries.len());
    assert!(dataset.entries.is_sorted_by_key(|entry| entry.time));
    let entry = &dataset.entries[9];
    let place = world
        .places()
        .iter()
        .position(|key| *key == entry.place)
        .expect("a place of the world");
    let image = entry.source.load().expect("rendered");
    assert_eq!(image, world.render(place, entry.time, 0));
    assert_eq!((image.width(), image.height()), (448, 384));
}

#[test]
fn other_sizes_and_numbers_of_places_work_and_senseless_ones_are_refused() {
    for (width, height, num_places) in [(256, 240, 1), (801, 603, 9), (1280, 1024, 2)] {
        let cfg = WorldConfig::new(1009)
            .with_image_size(width, height)
            .with_num_places(num_places);
        let world = World::new(&cfg).expect("a valid configuration");
        for visit in 0..20 {
            let image = world.render(num_places - 1, at("2023-02-01T08:00:00Z"), visit);
            assert_eq!((image.width(), image.height()), (width, height));
        }
    }
    for cfg in [
        WorldConfig::new(1).with_num_places(0),
        WorldConfig::new(1).with_num_places(1_000_000),
        WorldConfig::new(1).with_image_size(0, 320),
        WorldConfig::new(1).with_image_size(448, 100_000),
    ] {
        let error = World::new(&cfg).expect_err("senseless");
        assert_eq!(error.kind(), ErrorKind::Config);
    }
}
