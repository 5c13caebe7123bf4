//! What do the answers look like?
//!
//! Pictures for the report, of one localizer (the shipped default where the suite runs it) in the
//! first fold: live images with what was predicted, p(t) of the features that change most, and the
//! worst mistakes of the whole suite beside the places they were mixed up with. Pictures only show
//! what was counted before.

use super::content::{
    FeatureClass, FeaturePicture, GalleryImage, Mistake, ObservedState, PicturedFeature, Pictures,
    ProbabilityCurve, Raster, RasterRow, TimeAxis,
};
use super::headline::Headline;
use crate::data::ExtractedDataset;
use crate::results::{Answer, RowKey, SuiteResults};
use crate::run::{Showcase, Shown, SuiteRun, live};
use anyhow::Result;
use chronotope::Time;
use chronotope::dataset::{Clock, Dataset, Entry};
use chronotope::feature::{GrayImage, Keypoint};
use chronotope::localize::{Candidate, Decision, Localization, Query};
use chronotope::map::Node;
use chronotope::predict::Selection;
use chronotope::trace::{SpectrumSummary, most_informative};
use chronotope::visibility::{self, VisibilityModel};
use std::fmt::Write as _;

/// Live images shown.
const NUM_FEATURE_PICTURES: usize = 3;

/// Features whose p(t) is shown.
const NUM_CURVES: usize = 4;

/// Features and visits of the raster.
const MAX_RASTER_FEATURES: usize = 48;

const MAX_RASTER_VISITS: usize = 160;

/// So many mistakes are shown.
const NUM_MISTAKES: usize = 10;

/// Points of a drawn p(t).
const CURVE_POINTS: usize = 400;

/// Draws everything that the run has to show.
pub fn pictures(run: SuiteRun) -> Result<(SuiteResults, Pictures)> {
    let SuiteRun { results, shown } = run;
    let (Some(shown), Some(Headline { n, .. })) = (shown, Headline::of(&results)) else {
        return Ok((results, Pictures::default()));
    };
    let Shown {
        showcase,
        data,
        prefix,
    } = shown;
    let key = showcase.variant.at(n);
    let localizer = showcase
        .localizer
        .with_selection(Selection::top(n as usize)?);
    let showcase = Showcase {
        localizer,
        ..showcase
    };
    let answered = answered(&results, &data, &showcase, &key, prefix.as_deref());
    let pictures = Pictures {
        features: feature_pictures(&data, &showcase, &answered)?,
        curves: curves(&data, &showcase),
        raster: raster(&data, &showcase),
        mistakes: mistakes(&data, &key, &answered)?,
    };
    Ok((results, pictures))
}

/// Every entry that was queried, with the answer; those of the first fold alone where an image is
/// queried in several.
fn answered<'r>(
    results: &'r SuiteResults,
    data: &ExtractedDataset,
    showcase: &Showcase,
    key: &RowKey,
    prefix: Option<&str>,
) -> Vec<(usize, &'r Answer)> {
    let key = key.to_string();
    let ids: std::collections::BTreeMap<String, usize> = (data.dataset.entries.iter())
        .enumerate()
        .map(|(index, entry)| {
            let id = showcase.fold.query_id(entry);
            let id = prefix.map_or_else(|| id.clone(), |prefix| format!("{prefix}/{id}"));
            (id, index)
        })
        .collect();
    (results.queries.iter())
        .filter_map(|query| Some((*ids.get(&query.id)?, query.answers.get(&key)?)))
        .collect()
}

fn localize(data: &ExtractedDataset, showcase: &Showcase, entry: usize) -> Result<Localization> {
    let features = live(data, entry, showcase.num_live);
    let query = Query::new(&features)
        .at(showcase.times[entry])
        .with_image_size(data.extracted[entry].image_size);
    Ok(showcase
        .localizer
        .localize(&mut showcase.localizer.scratch(), &query)?)
}

/// The clearest, the median and the least clear of the right answers in the first fold.
fn feature_pictures(
    data: &ExtractedDataset,
    showcase: &Showcase,
    answered: &[(usize, &Answer)],
) -> Result<Vec<FeaturePicture>> {
    let mut right = Vec::new();
    for &(entry, answer) in answered {
        let truth = data.dataset.entries[entry].place.as_str();
        if showcase.fold.query.contains(&entry) && answer.wrong(Some(truth)) == 0.0 {
            let found = localize(data, showcase, entry)?;
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
        .map(|(_, entry, found)| feature_picture(data, showcase, *entry, found))
        .collect()
}

fn feature_picture(
    data: &ExtractedDataset,
    showcase: &Showcase,
    entry: usize,
    found: &Localization,
) -> Result<FeaturePicture> {
    let queried = &data.dataset.entries[entry];
    let live = live(data, entry, showcase.num_live);
    let mut features = Vec::new();
    let mut title = format!("{}, {}", queried.place, when(&data.dataset, queried));
    if let Some(first) = found.first() {
        let expected = expected(showcase, first);
        let mut is_used = vec![false; live.len()];
        let mut is_found = vec![false; expected.len()];
        for pair in first.matches.iter().filter(|pair| pair.inlier) {
            is_used[pair.live as usize] = true;
            is_found[pair.rank as usize] = true;
            let keypoint = live.keypoints()[pair.live as usize];
            features.push(PicturedFeature {
                x: keypoint.x,
                y: keypoint.y,
                size: keypoint.size,
                class: FeatureClass::Matched,
                probability: expected[pair.rank as usize].1 as f32,
            });
        }
        let shift = first.displacement.median;
        for ((keypoint, probability), is_found) in expected.iter().zip(&is_found) {
            if !is_found {
                features.push(PicturedFeature {
                    x: keypoint.x + shift.dx_px as f32,
                    y: keypoint.y + shift.dy_px as f32,
                    size: keypoint.size,
                    class: FeatureClass::Missing,
                    probability: *probability as f32,
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
            ": {} of {} {} features found where they belong",
            first.num_inliers,
            expected.len(),
            if first.appearance.is_some() {
                "remembered"
            } else {
                "predicted"
            }
        );
    }
    Ok(FeaturePicture {
        image: queried.source.load()?,
        title,
        note: format!("{}: {}.", decided(showcase, found), found.reason),
        features,
    })
}

/// What a place was matched by, in the order of its ranks: the features that were predicted, or all
/// of the remembered appearance that fits best, each with how probable it was.
fn expected(showcase: &Showcase, candidate: &Candidate) -> Vec<(Keypoint, f64)> {
    let node = showcase.localizer.snapshot().node(candidate.node);
    let remembered = (candidate.appearance)
        .and_then(|visit| node.visits().get(visit as usize)?.appearance.as_ref());
    if let Some(features) = remembered {
        let size = match showcase.localizer.cfg().selection() {
            Selection::Top(n) => n.get(),
            Selection::Threshold(_) => features.len(),
        };
        return (features.keypoints().iter().take(size))
            .map(|&keypoint| (keypoint, 1.0))
            .collect();
    }
    let keypoints = node.features().keypoints();
    (candidate.predicted.iter().zip(&candidate.probabilities))
        .map(|(&id, &probability)| (keypoints[id as usize], probability))
        .collect()
}

/// The features that change most; see [`most_informative`].
fn curves(data: &ExtractedDataset, showcase: &Showcase) -> Vec<ProbabilityCurve> {
    let Some(query_time) = query_time(showcase) else {
        return Vec::new();
    };
    let snapshot = showcase.localizer.snapshot();
    (most_informative(&showcase.localizer, NUM_CURVES).into_iter())
        .filter_map(|(id, feature)| {
            let model = showcase.localizer.model(id)?;
            Some(curve(
                data,
                showcase,
                snapshot.node(id),
                model,
                feature,
                query_time,
            ))
        })
        .collect()
}

/// When the first query of the fold was taken.
fn query_time(showcase: &Showcase) -> Option<Time> {
    let entry = showcase.fold.query.first()?;
    showcase.times.get(*entry).copied()
}

/// The place of the most informative feature: its features that were seen most often, those that
/// were seen early above.
fn raster(data: &ExtractedDataset, showcase: &Showcase) -> Option<Raster> {
    let (id, _) = most_informative(&showcase.localizer, 1)
        .into_iter()
        .next()?;
    let model = showcase.localizer.model(id)?;
    let node = showcase.localizer.snapshot().node(id);
    let times = node.log().times();
    let along = along(data, showcase);
    // The latest visits, if they are too many.
    let visits = times.len().saturating_sub(MAX_RASTER_VISITS)..times.len();
    let mut rows: Vec<(usize, f64, RasterRow)> = (0..model.num_features())
        .map(|feature| {
            let seen: Vec<Option<bool>> = visits
                .clone()
                .map(|visit| seen(node, visit, feature))
                .collect();
            let seen_at = || (0..seen.len()).filter(|&at| seen[at] == Some(true));
            let num_seen = seen_at().count();
            let centre = seen_at().sum::<usize>() as f64 / num_seen.max(1) as f64;
            let p = visits
                .clone()
                .map(|visit| model.predict_one(feature, times[visit]))
                .collect();
            (num_seen, centre, RasterRow { feature, seen, p })
        })
        .filter(|(num_seen, ..)| *num_seen > 0)
        .collect();
    rows.sort_by(|a, b| b.0.cmp(&a.0).then(a.2.feature.cmp(&b.2.feature)));
    rows.truncate(MAX_RASTER_FEATURES);
    rows.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.2.feature.cmp(&b.2.feature)));
    Some(Raster {
        place: node.key().as_str().to_owned(),
        num_features: model.num_features(),
        axis: axis(data),
        times: times[visits].iter().map(|&time| along(time)).collect(),
        rows: rows.into_iter().map(|(.., row)| row).collect(),
    })
}

/// Whether a feature was seen; before its birth nobody could.
fn seen(node: &Node, visit: usize, feature: usize) -> Option<bool> {
    match node.log().state(visit, feature) {
        Some(visibility::FeatureState::Seen) => Some(true),
        Some(visibility::FeatureState::NotSeen) => Some(false),
        Some(visibility::FeatureState::NotObservable) | None => None,
    }
}

fn axis(data: &ExtractedDataset) -> TimeAxis {
    match data.dataset.clock {
        Clock::Real => TimeAxis::UnixSeconds,
        Clock::None => TimeAxis::VisitIndex,
    }
}

/// Where times lie on [`axis`]: seconds, or the number of the visit, from 1, where the index is no
/// clock.
fn along<'a>(data: &ExtractedDataset, showcase: &'a Showcase) -> impl Fn(Time) -> f64 + use<'a> {
    let is_clock = data.dataset.clock == Clock::Real;
    let mut visits = showcase.times.clone();
    visits.sort_unstable();
    visits.dedup();
    move |time| {
        if is_clock {
            return time.as_s();
        }
        let num_before = visits.partition_point(|&visit| visit < time);
        let share = match (num_before.checked_sub(1), visits.get(num_before)) {
            (Some(before), Some(&after)) if after > time => {
                let before = visits[before];
                time.since_s(before) / after.since_s(before) - 1.0
            }
            _ => 0.0,
        };
        num_before as f64 + 1.0 + share
    }
}

fn curve(
    data: &ExtractedDataset,
    showcase: &Showcase,
    node: &Node,
    model: &dyn VisibilityModel,
    feature: usize,
    query_time: Time,
) -> ProbabilityCurve {
    let along = along(data, showcase);
    let times = node.log().times();
    let ends = times.iter().chain(std::iter::once(&query_time));
    let start = ends.clone().min().copied().unwrap_or_default();
    let end = ends.max().copied().unwrap_or_default();
    let span_us = end.as_us().saturating_sub(start.as_us());
    let history: Vec<Option<bool>> = (0..times.len())
        .map(|visit| seen(node, visit, feature))
        .collect();
    let observations = (times.iter().zip(&history))
        .map(|(time, &seen)| ObservedState {
            time: along(*time),
            seen,
        })
        .collect();
    let spectrum = match data.dataset.clock {
        Clock::Real => SpectrumSummary::of(times, &history),
        Clock::None => SpectrumSummary::default(),
    };
    let curve = (0..=CURVE_POINTS)
        .map(|i| {
            let us = i128::from(span_us) * i as i128 / CURVE_POINTS as i128;
            let time = start.plus_us(us as i64);
            (along(time), model.predict_one(feature, time))
        })
        .collect();
    let rhythm = model.components(feature);
    let keypoint = node.features().keypoints()[feature];
    ProbabilityCurve {
        title: format!(
            "{}, feature {feature} at ({:.0}, {:.0}): {}",
            node.key(),
            keypoint.x,
            keypoint.y,
            match rhythm.first() {
                Some(first) => format!("rhythm of {:.1} days", first.period_s / 86_400.0),
                None => "no rhythm".into(),
            }
        ),
        axis: axis(data),
        observations,
        curve,
        spectrum,
        query_time: Some(along(query_time)),
    }
}

/// The decision as a word.
fn decided(showcase: &Showcase, found: &Localization) -> String {
    match found.decision {
        Decision::At(node) => format!(
            "Located at {}",
            showcase.localizer.snapshot().node(node).key()
        ),
        Decision::Ambiguous => "Ambiguous".into(),
        _ => "Unknown".into(),
    }
}

fn mistakes(
    data: &ExtractedDataset,
    key: &RowKey,
    answered: &[(usize, &Answer)],
) -> Result<Vec<Mistake>> {
    let entries = &data.dataset.entries;
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
    // Plain mistakes before ties, the surest first: what a robot would have believed most.
    let certain = |answer: &Answer| sureness(answer).unwrap_or(0.0);
    wrong.sort_by(|a, b| {
        (b.0.total_cmp(&a.0))
            .then(certain(b.2).total_cmp(&certain(a.2)))
            .then(a.1.cmp(&b.1))
    });
    (wrong.into_iter().take(NUM_MISTAKES))
        .map(|(share, entry, answer)| {
            let queried = &entries[entry];
            let kind = if share < 1.0 { "tied" } else { "wrong" };
            Ok(Mistake {
                title: format!(
                    "{} ({kind}{}, {} at n = {})",
                    queried.id,
                    sureness(answer).map_or_else(String::new, |share| format!(
                        ", {:.1} % sure",
                        100.0 * share
                    )),
                    key.variant.method,
                    key.n
                ),
                query: GalleryImage {
                    image: Some(queried.source.load()?),
                    caption: format!("{}, {}", queried.place, when(&data.dataset, queried)),
                },
                truth: nearest(&data.dataset, entry, queried.place.as_str())?,
                answered: match &answer.first {
                    Some(place) => nearest(&data.dataset, entry, place)?,
                    None => GalleryImage {
                        image: None,
                        caption: "no place scored".into(),
                    },
                },
            })
        })
        .collect()
}

/// The posterior of the first answer, where the score gives one.
fn sureness(answer: &Answer) -> Option<f64> {
    answer.posterior.get(answer.first.as_ref()?).copied()
}

/// The other image of `place` that was taken closest in time.
fn nearest(dataset: &Dataset, queried: usize, place: &str) -> Result<GalleryImage> {
    let time = dataset.entries[queried].time;
    let closest = (dataset.entries.iter().enumerate())
        .filter(|&(index, entry)| index != queried && entry.place.as_str() == place)
        .min_by_key(|(_, entry)| entry.time.as_us().abs_diff(time.as_us()));
    Ok(match closest {
        Some((_, entry)) => GalleryImage {
            image: Some(load(entry)?),
            caption: format!("{place}, {}", when(dataset, entry)),
        },
        None => GalleryImage {
            image: None,
            caption: place.to_owned(),
        },
    })
}

fn load(entry: &Entry) -> Result<GrayImage> {
    Ok(entry.source.load()?)
}

fn when(dataset: &Dataset, entry: &Entry) -> String {
    match dataset.clock {
        // A space between date and time, where a narrow page may break.
        Clock::Real => entry.time.to_string().replace('T', " "),
        Clock::None => format!("visit {}", &entry.id),
    }
}
