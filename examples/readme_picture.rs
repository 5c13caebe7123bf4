//! Draws the picture of the README: one place of the rendered street at four times of a year that
//! was never learnt, with the features that were predicted for each time. Green circles were found
//! again, orange crosses were not.
//!
//! `cargo run --release --example readme_picture -- docs/one-place-four-times.jpg [SEED] [PLACE]`

use std::error::Error;
use std::fs::File;

use chronotope::dataset::synthetic::{Schedule, World, WorldConfig};
use chronotope::feature::{Extractor, GrayImage, StarBrief, StarBriefConfig};
use chronotope::learn::{LearnConfig, Learner, Observation};
use chronotope::localize::{Localizer, LocalizerConfig, Query};
use chronotope::map::{MapMeta, NodeId, SessionId, derived_uuid};
use chronotope::{Time, feature::Keypoint};
use image::codecs::jpeg::JpegEncoder;
use image::{Rgb, RgbImage};

const TIMES: [&str; 4] = [
    "2024-01-17T11:00:00Z",
    "2024-05-07T17:30:00Z",
    "2024-07-13T13:00:00Z",
    "2024-11-20T20:00:00Z",
];
const FOUND: Rgb<u8> = Rgb([60, 220, 90]);
const MISSING: Rgb<u8> = Rgb([255, 140, 40]);
const GAP_PX: u32 = 4;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().ok_or("name a file for the picture")?;
    let seed = arguments.next().map_or(Ok(1), |seed| seed.parse())?;
    let place: usize = arguments.next().map_or(Ok(2), |place| place.parse())?;

    let world = World::new(&WorldConfig::new(seed))?;
    let extractor = StarBrief::new(StarBriefConfig::default())?;
    let meta = MapMeta::new(derived_uuid("picture"), extractor.id(), "default");
    let mut learner = Learner::new(LearnConfig::default(), meta);
    let schedule = Schedule::standard(seed, 28, 0);
    for entry in world.dataset("2023", &schedule.learn).entries {
        let image = entry.source.load()?;
        let features = extractor.extract(&image, None)?;
        learner.observe(
            &Observation::new(
                entry.place,
                SessionId::derive(&entry.time.to_string()),
                entry.time,
                &features,
                image.size(),
            )
            .with_source(entry.id),
        )?;
    }
    let localizer = Localizer::new(learner.snapshot()?, LocalizerConfig::default())?;
    let truth = (localizer.snapshot().find(&world.places()[place])).ok_or("no such place")?;

    let first = world.render(place, Time::parse(TIMES[0])?, 0);
    let (width, height) = first.size();
    let mut picture = RgbImage::from_pixel(
        2 * width + GAP_PX,
        2 * height + GAP_PX,
        Rgb([255, 255, 255]),
    );
    for (panel, text) in (0..).zip(TIMES) {
        let time = Time::parse(text)?;
        let image = world.render(place, time, 0);
        let corner = (panel % 2 * (width + GAP_PX), panel / 2 * (height + GAP_PX));
        draw_image(&mut picture, corner, &image);
        draw_evidence(
            &mut picture,
            corner,
            &localizer,
            &extractor,
            &image,
            time,
            truth,
        )?;
    }
    let file = File::create(&path)?;
    picture.write_with_encoder(JpegEncoder::new_with_quality(file, 80))?;
    Ok(())
}

fn draw_image(picture: &mut RgbImage, corner: (u32, u32), image: &GrayImage) {
    for y in 0..image.height() {
        for (x, &gray) in image.row(y).iter().enumerate() {
            let pixel = Rgb([gray; 3]);
            picture.put_pixel(corner.0 + x as u32, corner.1 + y as u32, pixel);
        }
    }
}

fn draw_evidence(
    picture: &mut RgbImage,
    corner: (u32, u32),
    localizer: &Localizer,
    extractor: &StarBrief,
    image: &GrayImage,
    time: Time,
    truth: NodeId,
) -> Result<(), Box<dyn Error>> {
    let features = extractor.extract(image, None)?;
    let query = Query::new(&features).at(time);
    let answer = localizer.localize(&mut localizer.scratch(), &query)?;
    let candidate = (answer.ranking.iter())
        .find(|candidate| candidate.node == truth)
        .ok_or("every place is ranked")?;
    let place = localizer.snapshot().node(truth);
    let shift = candidate.displacement.mean;
    for (rank, &id) in candidate.predicted.iter().enumerate() {
        let found = (candidate.matches.iter()).find(|m| m.rank as usize == rank && m.inlier);
        let (x, y) = if let Some(found) = found {
            let Keypoint { x, y, .. } = features.keypoints()[found.live as usize];
            (x, y)
        } else {
            let Keypoint { x, y, .. } = place.features().keypoints()[id as usize];
            (x + shift.dx_px as f32, y + shift.dy_px as f32)
        };
        let (width, height) = (image.width() as i32, image.height() as i32);
        for dy in -7_i32..=7 {
            for dx in -7_i32..=7 {
                let ring = (25..=46).contains(&(dx * dx + dy * dy));
                let cross = (dx.abs() - dy.abs()).abs() <= 1 && dx.abs() <= 5;
                let (px, py) = (x.round() as i32 + dx, y.round() as i32 + dy);
                let inside = (0..width).contains(&px) && (0..height).contains(&py);
                if inside && (if found.is_some() { ring } else { cross }) {
                    let color = if found.is_some() { FOUND } else { MISSING };
                    picture.put_pixel(corner.0 + px as u32, corner.1 + py as u32, color);
                }
            }
        }
    }
    Ok(())
}
