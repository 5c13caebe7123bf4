//! What is answered to images that follow each other?
//!
//! The queries of a fold are cut into *ways* where the robot paused. What each image said is known
//! by then; along a way it is added up in three manners:
//!
//! - *tracked*: by [`Tracker`], as `chronotope localize --track` does;
//! - *kidnapped*: the same, of a robot that is carried elsewhere after every 25 images;
//! - *sequence*: as in `SeqSLAM` (Milford & Wyeth, ICRA 2012, III): the best straight line through
//!   the latest ten images along the route wins.
//!
//! Deviation: `SeqSLAM` compares shrunk images; here its rows are the scores of the run itself, so
//! that what is compared is the use of the sequence. They are set against those of the whole route:
//! with the published window of ten, places that overlap cancel each other (`corridor` within 2: 45
//! instead of 88 %). Lines may also lead backwards.

use anyhow::Result;
use chronotope::dataset::Dataset;
use chronotope::localize::{Localizer, MotionConfig, Tracker};

use super::answer::{ImageAnswer, RunAnswers, decided, named_posterior};
use crate::data::{Fold, route, ways};
use crate::results::{self, Answer};
use crate::suite::Run;

/// A kidnapped robot sees so many images before it is carried elsewhere.
const UNTIL_KIDNAPPED: usize = 25;

/// So many images are a sequence.
const SEQUENCE: usize = 10;
/// Places an image, of the lines that are tried (`V_min` to `V_max`).
const SPEEDS: [f64; 5] = [0.8, 0.9, 1.0, 1.1, 1.2];

/// Adds the answers along ways to those of each image, for the runs that follow them.
pub(super) fn follow(
    dataset: &Dataset,
    fold: &Fold,
    runs: &[Run],
    localizers: &[Localizer],
    sizes: &[usize],
    answers: &mut [(usize, Vec<RunAnswers>)],
) -> Result<()> {
    if !runs.iter().any(|run| run.follows) {
        return Ok(());
    }
    // Positions in `answers`, whose entries are those of the fold.
    let position = |entry: &usize| answers.iter().position(|(known, _)| known == entry);
    let ways: Vec<Vec<usize>> = (ways(dataset, &fold.query).iter())
        .map(|way| way.iter().filter_map(position).collect())
        .collect();
    let kidnapped = kidnapped(&ways);
    for (index, (run, localizer)) in runs.iter().zip(localizers).enumerate() {
        if !run.follows {
            continue;
        }
        let snapshot = localizer.snapshot();
        let places: Vec<usize> = (route(dataset, &fold.learn).into_iter())
            .filter_map(|place| snapshot.find(place))
            .map(|node| node.0 as usize)
            .collect();
        let mut of_ways = [(); 3].map(|()| vec![Vec::new(); answers.len()]);
        for size in 0..sizes.len() {
            let images: Vec<&ImageAnswer> = (answers.iter())
                .map(|(_, said)| &said[index].images[size])
                .collect();
            let [tracked, carried, matched] = &mut of_ways;
            for way in &ways {
                for (answered, &at) in track(localizer, &images, way)?.into_iter().zip(way) {
                    tracked[at].push(answered);
                }
                for (answered, &at) in match_sequences(localizer, &places, &images, way)
                    .into_iter()
                    .zip(way)
                {
                    matched[at].push(answered);
                }
            }
            let answered = track(localizer, &images, &kidnapped)?;
            for (answered, &at) in answered.into_iter().zip(&kidnapped) {
                carried[at].push(answered);
            }
        }
        for of_way in of_ways {
            for ((_, said), of_image) in answers.iter_mut().zip(of_way) {
                said[index].answers.push(of_image);
            }
        }
        for (_, said) in answers.iter_mut() {
            said[index].images = Vec::new();
        }
    }
    Ok(())
}

/// The images of all ways in the order of a robot that is carried from piece to piece: each piece
/// is followed by one half of all pieces later.
fn kidnapped(ways: &[Vec<usize>]) -> Vec<usize> {
    let pieces: Vec<&[usize]> = (ways.iter())
        .flat_map(|way| way.chunks(UNTIL_KIDNAPPED))
        .collect();
    let (first, second) = pieces.split_at(pieces.len().div_ceil(2));
    (0..first.len())
        .flat_map(|at| [first.get(at), second.get(at)])
        .flatten()
        .flat_map(|piece| piece.iter().copied())
        .collect()
}

/// What is believed after each image of `way`.
fn track(localizer: &Localizer, images: &[&ImageAnswer], way: &[usize]) -> Result<Vec<Answer>> {
    let name = |node: usize| localizer.snapshot().nodes()[node].key().as_str().to_owned();
    let mut tracker = Tracker::new(localizer, MotionConfig::default())?;
    let cfg = localizer.cfg();
    (way.iter())
        .map(|&at| {
            let image = images[at];
            tracker.integrate(cfg, &image.posterior, image.off_map)?;
            let belief = tracker.belief();
            let most = belief.iter().copied().fold(0.0, f64::max);
            let first = belief.iter().position(|&share| share == most);
            Ok(Answer {
                first: first.map(name),
                decision: decided(tracker.decide(cfg.risk()), &name),
                posterior: named_posterior(belief, tracker.off_map(), &name),
                ties: Vec::new(),
            })
        })
        .collect()
}

/// The end of the best line through the latest images, for each image of `way`; `places` are the
/// nodes along the route.
fn match_sequences(
    localizer: &Localizer,
    places: &[usize],
    images: &[&ImageAnswer],
    way: &[usize],
) -> Vec<Answer> {
    let name = |at: usize| {
        localizer.snapshot().nodes()[places[at]]
            .key()
            .as_str()
            .to_owned()
    };
    let contrast: Vec<Vec<f64>> = (way.iter())
        .map(|&at| {
            let along: Vec<f64> = (places.iter())
                .map(|&node| images[at].scores[node])
                .collect();
            contrast_of(&along)
        })
        .collect();
    (0..way.len())
        .map(|now| {
            let sums = (0..places.len()).map(|end| best_line(&contrast[..=now], end));
            let best = (sums.enumerate()).max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
            let first = best.map(|(at, _)| name(at));
            Answer {
                decision: (first.clone()).map_or(results::Decision::Unknown, results::Decision::At),
                first,
                posterior: std::collections::BTreeMap::new(),
                ties: Vec::new(),
            }
        })
        .collect()
}

/// Each value against mean and standard deviation of all.
fn contrast_of(values: &[f64]) -> Vec<f64> {
    let num = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / num;
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    // Where all are alike, none stands out.
    let spread = (squares / num).sqrt().max(1e-9);
    (values.iter())
        .map(|value| (value - mean) / spread)
        .collect()
}

/// The largest mean contrast over lines that end at place `end` with the latest image.
fn best_line(contrast: &[Vec<f64>], end: usize) -> f64 {
    let latest = contrast.iter().rev().take(SEQUENCE);
    let along = |speed: f64| {
        let mut sum = 0.0;
        let mut num = 0.0;
        for (back, values) in latest.clone().enumerate() {
            let at = (end as f64 - speed * back as f64).round();
            if at >= 0.0
                && let Some(value) = values.get(at as usize)
            {
                sum += value;
                num += 1.0;
            }
        }
        // A line that leaves the route has seen less.
        sum / f64::max(num, latest.len() as f64 / 2.0)
    };
    (SPEEDS.iter())
        .flat_map(|&speed| [along(speed), along(-speed)])
        .fold(f64::NEG_INFINITY, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kidnapped_robot_sees_every_image_once_and_never_the_next_piece() {
        let ways = [(0..60).collect::<Vec<_>>(), (60..70).collect()];
        let order = kidnapped(&ways);
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, (0..70).collect::<Vec<_>>());
        assert_eq!(&order[..26], [(0..25).collect(), vec![50]].concat());
        let breaks = order.windows(2).filter(|pair| pair[1] != pair[0] + 1);
        assert_eq!(breaks.count(), 3);
        assert!(kidnapped(&[]).is_empty());
    }

    #[test]
    fn a_line_is_found_that_no_single_image_shows() {
        // The robot walks from place 3 on; each image fits a wrong place better, another each time.
        let contrast: Vec<Vec<f64>> = (0..10)
            .map(|image| {
                let mut scores = vec![0.0; 40];
                scores[3 + image] = 2.0;
                scores[(29 + 17 * image) % 40] = 3.0;
                contrast_of(&scores)
            })
            .collect();
        let end =
            (0..40).max_by(|&a, &b| best_line(&contrast, a).total_cmp(&best_line(&contrast, b)));
        assert_eq!(end, Some(12));
        let backwards: Vec<Vec<f64>> = contrast.into_iter().rev().collect();
        let end =
            (0..40).max_by(|&a, &b| best_line(&backwards, a).total_cmp(&best_line(&backwards, b)));
        assert_eq!(end, Some(3));
    }

    #[test]
    fn where_all_places_are_alike_none_stands_out() {
        assert_eq!(contrast_of(&[2.0; 5]), [0.0; 5]);
        let stands_out = contrast_of(&[0.0, 0.0, 5.0, 0.0, 0.0]);
        assert!(stands_out[2] > 1.9 && stands_out[0] < 0.0, "{stands_out:?}");
    }
}
