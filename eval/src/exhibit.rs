//! What do the answers look like?
//!
//! Pictures for the report, of one localizer (the shipped default where the suite runs it) in the first
//! fold: live images with what was predicted, p(t) of the features that change most, and the worst
//! mistakes of the whole suite beside the places they were mixed up with. Pictures only show what was
//! counted elsewhere.

use std::fmt::Write as _;

use anyhow::Result;
use chronotope::Time;
use chronotope::dataset::{Clock, Dataset, Entry};
use chronotope::feature::GrayImage;
use chronotope::localize::{Localization, Localizer, Query};
use chronotope::map::{Node, NodeId};
use chronotope::predict::Selection;
use chronotope::visibility::{self, VisibilityModel};

use crate::harness::{Fold, live};
use crate::material::Material;
use crate::report::{
    FeatureClass, FeaturePicture, GalleryImage, Mistake, Observation, PicturedFeature, Pictures,
    ProbabilityCurve, TimeAxis,
};
use crate::results::{Answer, RowKey, SuiteResults, Variant};
use crate::table::detail_n;

/// Live images shown.
const NUM_FEATURE_PICTURES: usize = 3;
/// Features whose p(t) is shown.
const NUM_CURVES: usize = 4;
/// Mistakes shown.
const NUM_MISTAKES: usize = 10;
/// Points of a drawn p(t).
const CURVE_POINTS: usize = 400;

/// What pictures are drawn of.
#[derive(Debug)]
pub struct Exhibit {
    /// The run.
    pub variant: Variant,
    /// Its localizer in the first fold.
    pub localizer: Localizer,
    /// The first fold.
    pub fold: Fold,
    /// When each entry was taken, by the arm's clock.
    pub times: Vec<Time>,
    /// The strongest features of an image that are used.
    pub num_live: usize,
}

/// Draws everything; `prefix` is that of the material's query ids.
pub fn pictures(
    results: &SuiteResults,
    material: &Material,
    exhibit: Exhibit,
    prefix: Option<&str>,
) -> Result<Pictures> {
    let Some(n) = detail_n(results) else {
        return Ok(Pictures::default());
    };
    let key = exhibit.variant.at(n);
    let exhibit = Exhibit {
        localizer: exhibit.localizer.with_selection(Selection::Top(n as usize)),
        ..exhibit
    };
    let answered = answered(results, material, &key, prefix);
    Ok(Pictures {
        features: feature_pictures(material, &exhibit, &answered)?,
        curves: curves(material, &exhibit),
        mistakes: mistakes(material, &key, &answered)?,
    })
}

/// Every entry of the material that was asked for, with the answer.
fn answered<'r>(
    results: &'r SuiteResults,
    material: &Material,
    key: &RowKey,
    prefix: Option<&str>,
) -> Vec<(usize, &'r Answer)> {
    let key = key.to_string();
    let ids: std::collections::BTreeMap<String, usize> = (material.dataset.entries.iter())
        .enumerate()
        .map(|(index, entry)| match prefix {
            Some(prefix) => (format!("{prefix}/{}", entry.id), index),
            None => (entry.id.clone(), index),
        })
        .collect();
    (results.queries.iter())
        .filter_map(|query| Some((*ids.get(&query.id)?, query.answers.get(&key)?)))
        .collect()
}

fn localize(material: &Material, exhibit: &Exhibit, entry: usize) -> Result<Localization> {
    let features = live(material, entry, exhibit.num_live);
    let query = Query {
        features: &features,
        time: Some(exhibit.times[entry]),
        image_size: Some(material.extracted[entry].image_size),
    };
    Ok(exhibit
        .localizer
        .localize(&mut exhibit.localizer.scratch(), &query)?)
}

/// The clearest, the median and the least clear of the right answers in the first fold.
fn feature_pictures(
    material: &Material,
    exhibit: &Exhibit,
    answered: &[(usize, &Answer)],
) -> Result<Vec<FeaturePicture>> {
    let mut right = Vec::new();
    for &(entry, answer) in answered {
        let truth = material.dataset.entries[entry].place.as_str();
        if exhibit.fold.query.contains(&entry) && answer.wrong(Some(truth)) == 0.0 {
            let found = localize(material, exhibit, entry)?;
            right.push((
                found.first().map_or(0, |first| first.num_inliers),
                entry,
                found,
            ));
        }
    }
    right.sort_by_key(|&(inliers, entry, _)| (std::cmp::Reverse(inliers), entry));
    let last = right.len().saturating_sub(1);
    let mut shown: Vec<usize> = (0..NUM_FEATURE_PICTURES)
        .map(|i| i * last / (NUM_FEATURE_PICTURES - 1))
        .collect();
    shown.dedup();
    (shown.into_iter().filter_map(|i| right.get(i)))
        .map(|(_, entry, found)| feature_picture(material, exhibit, *entry, found))
        .collect()
}

fn feature_picture(
    material: &Material,
    exhibit: &Exhibit,
    entry: usize,
    found: &Localization,
) -> Result<FeaturePicture> {
    let asked = &material.dataset.entries[entry];
    let live = live(material, entry, exhibit.num_live);
    let mut features = Vec::new();
    let mut title = format!("{}, {}", asked.place, when(&material.dataset, asked));
    if let Some(first) = found.first() {
        let mut is_used = vec![false; live.len()];
        let mut is_found = vec![false; first.predicted.len()];
        for pair in first.matches.iter().filter(|pair| pair.inlier) {
            is_used[pair.live as usize] = true;
            is_found[pair.rank as usize] = true;
            let keypoint = live.keypoints()[pair.live as usize];
            features.push(PicturedFeature {
                x: keypoint.x,
                y: keypoint.y,
                size: keypoint.size,
                class: FeatureClass::Matched,
                probability: first.probabilities[pair.rank as usize] as f32,
            });
        }
        let node = exhibit.localizer.snapshot().node(first.node);
        let shift = first.displacement.median;
        for (rank, &id) in first.predicted.iter().enumerate() {
            if !is_found[rank] {
                let keypoint = node.features.keypoints()[id as usize];
                features.push(PicturedFeature {
                    x: keypoint.x + shift.dx_px as f32,
                    y: keypoint.y + shift.dy_px as f32,
                    size: keypoint.size,
                    class: FeatureClass::Missing,
                    probability: first.probabilities[rank] as f32,
                });
            }
        }
        for (keypoint, is_used) in live.keypoints().iter().zip(is_used) {
            if !is_used {
                features.push(PicturedFeature {
                    x: keypoint.x,
                    y: keypoint.y,
                    size: keypoint.size,
                    class: FeatureClass::Unexpected,
                    probability: 0.0,
                });
            }
        }
        let _ = write!(
            title,
            ": {} of {} predicted features found where they belong ({})",
            first.num_inliers,
            first.predicted.len(),
            found.reason
        );
    }
    Ok(FeaturePicture {
        image: asked.source.load()?,
        title,
        features,
    })
}

/// The features whose predicted visibility swings most among those predicted for some query.
fn curves(material: &Material, exhibit: &Exhibit) -> Vec<ProbabilityCurve> {
    let Some(query_time) = exhibit
        .fold
        .query
        .first()
        .map(|&entry| exhibit.times[entry])
    else {
        return Vec::new();
    };
    let snapshot = exhibit.localizer.snapshot();
    let nodes = (0..snapshot.nodes.len() as u32).map(NodeId);
    let mut swinging: Vec<(f64, NodeId, usize)> = nodes
        .filter_map(|id| {
            let model = exhibit.localizer.model(id)?;
            (0..model.num_features())
                .map(|feature| {
                    let swing = model.components(feature).iter().map(|c| c.amplitude).sum();
                    (swing, id, feature)
                })
                .max_by(|a: &(f64, _, _), b| a.0.total_cmp(&b.0))
        })
        .collect();
    swinging.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    swinging.truncate(NUM_CURVES);
    (swinging.into_iter())
        .filter_map(|(_, id, feature)| {
            let model = exhibit.localizer.model(id)?;
            Some(curve(
                material,
                snapshot.node(id),
                model,
                feature,
                query_time,
            ))
        })
        .collect()
}

fn curve(
    material: &Material,
    node: &Node,
    model: &dyn VisibilityModel,
    feature: usize,
    query_time: Time,
) -> ProbabilityCurve {
    let times = node.log.times();
    let ends = times.iter().chain(std::iter::once(&query_time));
    let start = ends.clone().min().copied().unwrap_or_default();
    let end = ends.max().copied().unwrap_or_default();
    let span_us = end.as_us().saturating_sub(start.as_us());
    let observations = (0..node.log.num_visits())
        .map(|visit| Observation {
            time: times[visit].as_s(),
            seen: match node.log.observation(visit, feature) {
                Some(visibility::Observation::Seen) => Some(true),
                Some(visibility::Observation::NotObservable) => None,
                // Before its birth nobody saw it either.
                Some(visibility::Observation::NotSeen) | None => Some(false),
            },
        })
        .collect();
    let curve = (0..=CURVE_POINTS)
        .map(|i| {
            let us = i128::from(span_us) * i as i128 / CURVE_POINTS as i128;
            let time = start.plus_us(us as i64);
            (time.as_s(), model.predict_one(feature, time))
        })
        .collect();
    let rhythm = model.components(feature);
    let keypoint = node.features.keypoints()[feature];
    ProbabilityCurve {
        title: format!(
            "{}, feature {feature} at ({:.0}, {:.0}): {}",
            node.key,
            keypoint.x,
            keypoint.y,
            match rhythm.first() {
                Some(first) => format!("rhythm of {:.1} days", first.period_s / 86_400.0),
                None => "no rhythm".into(),
            }
        ),
        axis: match material.dataset.clock {
            Clock::Real => TimeAxis::UnixSeconds,
            Clock::None => TimeAxis::VisitIndex,
        },
        observations,
        curve,
        query_time: Some(query_time.as_s()),
    }
}

fn mistakes(
    material: &Material,
    key: &RowKey,
    answered: &[(usize, &Answer)],
) -> Result<Vec<Mistake>> {
    let entries = &material.dataset.entries;
    let mut wrong: Vec<(f64, usize, &Answer)> = (answered.iter())
        .map(|&(entry, answer)| {
            (
                answer.wrong(Some(entries[entry].place.as_str())),
                entry,
                answer,
            )
        })
        .filter(|&(wrong, ..)| wrong > 0.0)
        .collect();
    // Plain mistakes before ties; spread over the suite rather than all from its first visit.
    wrong.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let step = wrong.len().div_ceil(NUM_MISTAKES).max(1);
    (wrong.into_iter().step_by(step))
        .map(|(share, entry, answer)| {
            let asked = &entries[entry];
            let kind = if share < 1.0 { "tied" } else { "wrong" };
            Ok(Mistake {
                title: format!(
                    "{} ({kind}, {} at n = {})",
                    asked.id, key.variant.method, key.n
                ),
                query: GalleryImage {
                    image: Some(asked.source.load()?),
                    caption: format!("asked: {}, {}", asked.place, when(&material.dataset, asked)),
                },
                truth: nearest(
                    &material.dataset,
                    entry,
                    asked.place.as_str(),
                    "the same place",
                )?,
                answered: match &answer.first {
                    Some(place) => nearest(&material.dataset, entry, place, "answered")?,
                    None => GalleryImage {
                        image: None,
                        caption: "no place scored".into(),
                    },
                },
            })
        })
        .collect()
}

/// The other image of `place` that was taken closest in time.
fn nearest(dataset: &Dataset, asked: usize, place: &str, what: &str) -> Result<GalleryImage> {
    let time = dataset.entries[asked].time;
    let closest = (dataset.entries.iter().enumerate())
        .filter(|&(index, entry)| index != asked && entry.place.as_str() == place)
        .min_by_key(|(_, entry)| entry.time.as_us().abs_diff(time.as_us()));
    Ok(match closest {
        Some((_, entry)) => GalleryImage {
            image: Some(load(entry)?),
            caption: format!("{what}: {place}, {}", when(dataset, entry)),
        },
        None => GalleryImage {
            image: None,
            caption: format!("{what}: {place}"),
        },
    })
}

fn load(entry: &Entry) -> Result<GrayImage> {
    Ok(entry.source.load()?)
}

fn when(dataset: &Dataset, entry: &Entry) -> String {
    match dataset.clock {
        Clock::Real => entry.time.to_string(),
        Clock::None => format!("visit {}", &entry.id),
    }
}
