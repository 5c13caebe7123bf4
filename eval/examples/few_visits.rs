//! How good are decisions on maps of few visits, and how many images of elsewhere do they accept?
//!
//! ```text
//! cargo run --release -p chronotope-eval --example few_visits -- FOLDER OTHER [K,K,...] [N]
//! ```
//!
//! Each K visits in a row of the places in FOLDER are learnt in turn; all other visits of it, and
//! every image of OTHER, which is nowhere in the map, are queried at N features a place. It prints
//! one line for each K: the share of first choices that are right, how many of those are located
//! and how many wrong ones, and how many of the images from elsewhere. These are the figures of
//! eval/METHODOLOGY.md, "The first visits". With K = the number of visits less one, each visit is
//! left out in turn.
#![allow(clippy::print_stdout)] // reason: an example shows what it finds.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result};
use chronotope::dataset::{Clock, Dataset, Entry};
use chronotope::feature::{Extractor, Features, StarBrief, StarBriefConfig};
use chronotope::learn::{LearnConfig, Learner, Observation};
use chronotope::localize::{Decision, Localizer, LocalizerConfig, Method, Query};
use chronotope::map::{MapMeta, SessionId};
use chronotope::predict::Selection;
use rayon::prelude::*;

struct Image {
    entry: Entry,
    /// How many images of its place were taken before.
    visit: usize,
    features: Features,
    size: (u32, u32),
}

struct Series {
    images: Vec<Image>,
    has_clock: bool,
    num_visits: usize,
}

#[derive(Clone, Copy, Default)]
struct Counts {
    right: usize,
    right_located: usize,
    wrong_located: usize,
    queries: usize,
    foreign_located: usize,
    foreign: usize,
}

fn main() -> Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [folder, other, rest @ ..] = &args[..] else {
        anyhow::bail!("usage: few_visits FOLDER OTHER [K,K,...] [N]");
    };
    let visits = rest.first().map_or("1,2,3,4,6", String::as_str);
    let n = rest
        .get(1)
        .map_or(Ok(50), |n| n.parse())
        .context("N is a number")?;
    let (images, foreign) = (Series::read(folder)?, Series::read(other)?);
    println!("visits  queries  right %  of these located %  wrong located  foreign located %");
    for visits in visits.split(',') {
        let visits: usize = visits.parse().context("K is a number")?;
        let counts = run(&images, &foreign, visits, n)?;
        let percent = |part: usize, of: usize| 100.0 * part as f64 / of.max(1) as f64;
        println!(
            "{visits:6}  {:7}  {:7.1}  {:18.1}  {:13}  {:10.1} of {}",
            counts.queries,
            percent(counts.right, counts.queries),
            percent(counts.right_located, counts.right),
            counts.wrong_located,
            percent(counts.foreign_located, counts.foreign),
            counts.foreign,
        );
    }
    Ok(())
}

impl Series {
    fn read(folder: &str) -> Result<Self> {
        let dataset = Dataset::open(Path::new(folder))?;
        let num_features = LearnConfig::default().features_per_visit();
        let config = StarBriefConfig::default().with_num_features(num_features);
        let extractor = StarBrief::new(config)?;
        let mut images = (dataset.entries.par_iter())
            .map(|entry| {
                let image = entry.source.load()?;
                let features = extractor.extract(&image, None)?;
                let (entry, size) = (entry.clone(), image.size());
                Ok(Image {
                    entry,
                    visit: 0,
                    features,
                    size,
                })
            })
            .collect::<Result<Vec<_>>>()?;
        images.sort_by_key(|image| image.entry.time);
        let mut seen = BTreeMap::new();
        for image in &mut images {
            let count = seen.entry(image.entry.place.clone()).or_insert(0);
            (image.visit, *count) = (*count, *count + 1);
        }
        Ok(Self {
            images,
            has_clock: dataset.clock == Clock::Real,
            num_visits: seen.into_values().max().unwrap_or(0),
        })
    }
}

fn run(images: &Series, foreign: &Series, visits: usize, n: usize) -> Result<Counts> {
    let mut total = Counts::default();
    let leaves_one_out = visits + 1 == images.num_visits;
    let num_starts = if leaves_one_out {
        images.num_visits
    } else {
        (images.num_visits + 1).saturating_sub(visits)
    };
    for start in 0..num_starts {
        let is_learnt = |image: &&Image| {
            if leaves_one_out {
                image.visit != start
            } else {
                (start..start + visits).contains(&image.visit)
            }
        };
        let localizer = learn(images, n, is_learnt)?;
        let queries = images.images.iter().filter(|it| !is_learnt(it));
        for (is_right, is_located) in answers(&localizer, queries.collect())? {
            total.queries += 1;
            total.right += usize::from(is_right);
            total.right_located += usize::from(is_right && is_located);
            total.wrong_located += usize::from(!is_right && is_located);
        }
        for (_, is_located) in answers(&localizer, foreign.images.iter().collect())? {
            total.foreign += 1;
            total.foreign_located += usize::from(is_located);
        }
    }
    Ok(total)
}

fn learn(images: &Series, n: usize, is_learnt: impl Fn(&&Image) -> bool) -> Result<Localizer> {
    let extractor = StarBrief::new(StarBriefConfig::default())?;
    // Coarse times must not make one stay of several visits.
    let learn = LearnConfig::default().with_stay_gap_s(0);
    let mut learner = Learner::new(learn, MapMeta::new(7, extractor.id(), "default"));
    for image in images.images.iter().filter(is_learnt) {
        let (place, time) = (image.entry.place.clone(), image.entry.time);
        let session = SessionId::default();
        let seen = Observation::new(place, session, time, &image.features, image.size);
        learner.observe(&seen.with_source(&image.entry.id))?;
    }
    let mut cfg = LocalizerConfig::default().with_selection(Selection::top(n)?);
    if !images.has_clock {
        cfg = cfg.with_method(Method::Static);
    }
    Ok(Localizer::new(learner.snapshot()?, cfg)?)
}

/// Whether the first choice is the image's place, and whether it is located.
fn answers(localizer: &Localizer, images: Vec<&Image>) -> Result<Vec<(bool, bool)>> {
    let queries: Vec<Query<'_>> = (images.iter())
        .map(|image| Query::new(&image.features).at(image.entry.time))
        .collect();
    let answers = localizer.localize_batch(&queries)?;
    let judged = answers.iter().zip(images).map(|(answer, image)| {
        let first = answer.first().map(|it| localizer.snapshot().node(it.node));
        let is_located = matches!(answer.decision, Decision::At(_) | Decision::Near(_));
        (
            first.is_some_and(|node| *node.key() == image.entry.place),
            is_located,
        )
    });
    Ok(judged.collect())
}
