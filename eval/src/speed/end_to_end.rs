//! How long does an answer take in a map of so many places, and which stage takes it?
//!
//! A place is one learnt image, each of its features seen anew, with a year of visits in which
//! features come and go; the first places of a map are of different streets, and a large map has
//! many look-alikes of each. Queries are images that were not learnt, all in one time bucket, whose
//! prediction is a row of its own. The stages are what [`Localizer::localize_into`] does: `match`
//! is called by itself on the features that were predicted, and what is left of the whole is the
//! vote, the log odds, the ranking and the decision. Beside the default stands the plain count of
//! matches, which decides by nothing else.
//!
//! Short lists of candidates are judged by the exact answer to the same query: the share of first
//! places that are the same.

use std::sync::Arc;
use std::time::Instant;

use anyhow::{Result, ensure};
use chronotope::Time;
use chronotope::feature::{Extractor, ExtractorConfig, Features, StarBrief};
use chronotope::localize::{
    Localization, Localizer, LocalizerConfig, PlaceSearch, Preset, Query, Score,
};
use chronotope::map::{
    AppearanceUse, MapMeta, Node, NodeId, PlaceKey, SessionId, Snapshot, SnapshotParts, Visit,
    VisitId,
};
use chronotope::matching::{MatchScratch, Matcher};
use chronotope::predict::Selection;
use chronotope::visibility::BitRow;

use super::measurement::{Measurement, time as repeat};
use super::opening;
use super::workload::{SplitMix, Workload};

/// What the section is called; the plot of growth looks for it.
pub(super) const SECTION: &str = "one answer, 50 features a place, 500 live";

/// Rows that the targets look for.
pub(super) const EXTRACT: &str = "extract";
pub(super) const WHOLE: &str = "whole";
pub(super) const LISTED: &str = "whole, inverted file";
const NEAR: &str = "whole, prior of 100 places";

const NUM_PREDICTED: usize = 50;
const NUM_VISITS: usize = 12;
const MONTH_US: i64 = 30 * 86_400 * 1_000_000;
const HOUR_US: i64 = 3_600 * 1_000_000;
/// Answers that are timed, at least and at most.
const MIN_ANSWERS: usize = 20;
const MAX_ANSWERS: usize = 200;
const ENOUGH_S: f64 = 60.0;
/// Maps up to this size are localised in by the plain count as well.
const MAX_COUNTED: usize = 1_000;
/// Short lists are made in maps of more places than this.
const MAX_UNLISTED: usize = 256;
/// Places of a prior.
const NUM_NEAR: usize = 100;
/// Threads that a batch is answered on.
const NUM_THREADS: usize = 2;
/// Maps from this size on are opened from a file.
const MIN_OPENED: usize = 1_000;

/// Every stage in a map of `num_nodes` places.
pub(super) fn measure(workload: &Workload, num_nodes: usize) -> Result<Vec<Measurement>> {
    ensure!(num_nodes > 0, "a map of 0 places cannot be localised in");
    let case = format!("{num_nodes} places");
    let row = |subject: &str, ms: &[f64]| Measurement::new(SECTION, &case, subject, ms);
    let memory = resident_bytes();
    let snapshot = Arc::new(snapshot(workload, num_nodes)?);
    let num_features: usize = snapshot
        .nodes()
        .iter()
        .map(|node| node.features().len())
        .sum();
    let time = workload.times.iter().max().copied().unwrap_or_default();

    let start = Instant::now();
    let cfg = LocalizerConfig::preset(Preset::Default)
        .with_selection(Selection::top(NUM_PREDICTED)?)
        .with_place_search(PlaceSearch::Exact);
    let localizer = Localizer::new(Arc::clone(&snapshot), cfg.clone())?;
    let fit_ms = start.elapsed().as_secs_f64() * 1e3;
    let predict_ms = predict(&localizer, time)?;
    let exact = Answered::of(&localizer, workload, time)?;
    let batch_ms = batch(&localizer, workload, time, &exact)?;
    let per_feature = resident_bytes()
        .zip(memory)
        .map(|(now, before)| now.saturating_sub(before) as f64 / num_features as f64);
    let memory = per_feature.map_or(String::new(), |bytes| {
        format!(", {bytes:.0} bytes a feature with map, models and forecast")
    });
    let (match_ms, num_pairs) = match_alone(&localizer, workload, time, exact.whole.len())?;
    let decide: Vec<f64> = (exact.whole.iter().zip(&match_ms))
        .map(|(whole, matching)| (whole - matching).max(0.0))
        .collect();
    let right = (exact.first.iter().zip(workload.query_places.iter().cycle()))
        .filter(|(first, place)| first.map(|id| workload.place_of(id.0 as usize)) == Some(**place));
    let share = 100.0 * right.count() as f64 / exact.first.len() as f64;
    let rate = num_pairs as f64 * 1e3 / crate::judge::statistics::p50_p99(&match_ms).0;
    let mut rows = vec![
        row("fit and calibrate, once", &[fit_ms]).note(format!("{num_features} features{memory}")),
        row("predict, once a bucket", &predict_ms).note("10 minutes are a bucket"),
        row(EXTRACT, &extract(workload)?).note("one image, as in its own section"),
        row("match", &match_ms)
            .pairs(num_pairs)
            .note(format!("{rate:.3e} pairs/s")),
        row("vote, weigh, rank, decide", &decide),
        row(WHOLE, &exact.whole).note(format!(
            "{share:.0} % of first places are of the right street"
        )),
        row("whole, batch on two threads", &batch_ms)
            .note("a batch over its images; the same answers, by one thread and by two"),
    ];
    if num_nodes <= MAX_COUNTED {
        let counting = cfg.clone().with_score(Score::Count).with_calibrated(false);
        let counting = Localizer::new(Arc::clone(&snapshot), counting)?;
        let counted = Answered::of(&counting, workload, time)?;
        let p50 = |ms: &[f64]| crate::judge::statistics::p50_p99(ms).0;
        let more = 100.0 * (p50(&exact.whole) / p50(&counted.whole) - 1.0);
        rows.push(row("whole, plain count", &counted.whole).note(format!(
            "the likelihood takes {more:+.0} % more at the median"
        )));
    }
    if num_nodes <= MAX_UNLISTED {
        return Ok(rows);
    }
    let mut localizer = localizer;
    for (kind, name) in [
        (PlaceSearch::Inverted, LISTED),
        (PlaceSearch::Words, "whole, signatures"),
    ] {
        let start = Instant::now();
        localizer = localizer.with_place_search(kind)?;
        localizer.prefetch(time);
        let build_ms = start.elapsed().as_secs_f64() * 1e3;
        let listed = Answered::of(&localizer, workload, time)?;
        let same = (listed.first.iter().zip(&exact.first)).filter(|(ours, exact)| ours == exact);
        let recall = same.count() as f64 / listed.first.len().min(exact.first.len()) as f64;
        let listed_row = row(name, &listed.whole).recall(recall);
        let faster = least(&exact.whole) / listed_row.ms_best;
        rows.push(listed_row.note(format!(
            "first place as the exact answer's, of {}; {faster:.1} times as fast; made in {:.1} s",
            listed.first.len(),
            build_ms / 1e3
        )));
        if kind == PlaceSearch::Inverted {
            let ms = batch(&localizer, workload, time, &listed)?;
            rows.push(row("inverted file, batch on two threads", &ms));
            let near = Answered::near(&localizer, workload, time, &exact.first)?;
            let same = (near.first.iter().zip(&exact.first)).filter(|(ours, exact)| ours == exact);
            let recall = same.count() as f64 / near.first.len().min(exact.first.len()) as f64;
            rows.push(row(NEAR, &near.whole).recall(recall).note(format!(
                "the exact answer's first place and those around it are the prior; {} of {} \
                 images decide for none of them and are searched for everywhere",
                near.num_widened,
                near.first.len()
            )));
        }
    }
    drop(localizer);
    if num_nodes >= MIN_OPENED {
        let cfg = cfg.with_place_search(PlaceSearch::Auto);
        rows.extend(opening::measure(workload, &snapshot, &cfg, time)?);
    }
    Ok(rows)
}

/// Milliseconds an image of answering all queries in one batch, on two threads; what one thread and
/// two answer must be what was answered one by one.
fn batch(
    localizer: &Localizer,
    workload: &Workload,
    time: Time,
    singly: &Answered,
) -> Result<Vec<f64>> {
    let queries: Vec<Query<'_>> = (workload.queries.iter())
        .take(singly.first.len())
        .map(|features| Query::new(features).at(time))
        .collect();
    let pool = |num_threads| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(num_threads)
            .build()
    };
    let mut ms = Vec::new();
    let first = |answers: &[Localization]| -> Vec<Option<NodeId>> {
        (answers.iter())
            .map(|answer| answer.first().map(|first| first.node))
            .collect()
    };
    let two = pool(NUM_THREADS)?;
    let mut answers = Vec::new();
    for _ in 0..3 {
        let start = Instant::now();
        answers = two.install(|| localizer.localize_batch(&queries))?;
        ms.push(start.elapsed().as_secs_f64() * 1e3 / queries.len() as f64);
    }
    let alone = pool(1)?.install(|| localizer.localize_batch(&queries))?;
    ensure!(
        alone == answers && first(&answers) == singly.first[..queries.len()],
        "answers depend on the number of threads"
    );
    Ok(ms)
}

fn least(ms: &[f64]) -> f64 {
    ms.iter().copied().fold(f64::INFINITY, f64::min)
}

/// One answer to each query.
#[derive(Default)]
struct Answered {
    /// Milliseconds that each answer took.
    whole: Vec<f64>,
    first: Vec<Option<NodeId>>,
    /// How many had a prior and more places than those matched.
    num_widened: usize,
}

impl Answered {
    fn of(localizer: &Localizer, workload: &Workload, time: Time) -> Result<Self> {
        Self::with_priors(localizer, workload, time, |_| Vec::new())
    }

    /// With [`NUM_NEAR`] places as prior, around the place that each query is known to be of.
    fn near(
        localizer: &Localizer,
        workload: &Workload,
        time: Time,
        places: &[Option<NodeId>],
    ) -> Result<Self> {
        let num_places = localizer.snapshot().nodes().len();
        Self::with_priors(localizer, workload, time, |query| {
            let place = places[query % places.len()].map_or(0, |node| node.0 as usize);
            let first =
                (place.saturating_sub(NUM_NEAR / 2)).min(num_places.saturating_sub(NUM_NEAR));
            (first..num_places.min(first + NUM_NEAR))
                .map(|node| NodeId(node as u32))
                .collect()
        })
    }

    fn with_priors(
        localizer: &Localizer,
        workload: &Workload,
        time: Time,
        prior_of: impl Fn(usize) -> Vec<NodeId>,
    ) -> Result<Self> {
        let mut answered = Self::default();
        let mut scratch = localizer.scratch();
        let mut out = Localization::default();
        let start = Instant::now();
        let features = workload.queries.iter().cycle();
        let queries = (workload.queries.first().into_iter()).chain(features.take(MAX_ANSWERS));
        for (at, features) in queries.enumerate() {
            if answered.whole.len() > MIN_ANSWERS && start.elapsed().as_secs_f64() > ENOUGH_S {
                break;
            }
            // The first one comes twice.
            let prior = prior_of(at.saturating_sub(1));
            let query = Query::new(features).at(time).with_prior(&prior);
            let start = Instant::now();
            localizer.localize_into(&mut scratch, &query, &mut out)?;
            answered.whole.push(start.elapsed().as_secs_f64() * 1e3);
            answered.first.push(out.first().map(|first| first.node));
            answered.num_widened +=
                usize::from(at > 0 && !prior.is_empty() && out.ranking.len() > NUM_NEAR);
        }
        // The first one warmed up what is reused.
        answered.whole.remove(0);
        answered.first.remove(0);
        Ok(answered)
    }
}

/// Milliseconds of predicting all places on one thread, for buckets that were not predicted before.
fn predict(localizer: &Localizer, time: Time) -> Result<Vec<f64>> {
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let ms = (1..=4).map(|hour| {
        let start = Instant::now();
        alone.install(|| localizer.prefetch(time.plus_us(hour * HOUR_US)));
        start.elapsed().as_secs_f64() * 1e3
    });
    Ok(ms.collect())
}

fn extract(workload: &Workload) -> Result<Vec<f64>> {
    let extractor = StarBrief::default();
    let mut features = Features::new();
    let mut outcome = Ok(());
    let mut images = workload.images.iter().cycle();
    let ms = repeat(workload.images.len(), || {
        if let Some(image) = images.next() {
            outcome = extractor.extract_into(image.view(), None, &mut features);
        }
    });
    outcome?;
    Ok(ms)
}

/// Milliseconds of matching what was predicted with the first queries, and how many pairs that are.
fn match_alone(
    localizer: &Localizer,
    workload: &Workload,
    time: Time,
    num_queries: usize,
) -> Result<(Vec<f64>, usize)> {
    let matcher = Matcher::new(localizer.cfg().matching().clone());
    let (mut map, mut ends) = (Features::new(), Vec::new());
    let nothing = Features::new();
    let query = Query::new(&nothing).at(time);
    let mut found = localizer.localize(&mut localizer.scratch(), &query)?;
    found.ranking.sort_by_key(|candidate| candidate.node);
    for candidate in &found.ranking {
        let node = localizer.snapshot().node(candidate.node);
        map.append(node.features(), &candidate.predicted);
        ends.push(map.len());
    }
    let mut scratch = MatchScratch::default();
    let mut num_pairs = 0;
    let mut ms = Vec::new();
    let queries = workload.queries.iter().cycle();
    for live in (workload.queries.first().into_iter()).chain(queries.take(num_queries)) {
        num_pairs = map.len() * live.len();
        let start = Instant::now();
        let mut num_matches = 0;
        matcher.parts_into(
            &mut scratch,
            map.view(),
            &ends,
            live.view(),
            |_, matches| {
                num_matches += matches.len();
            },
        );
        std::hint::black_box(num_matches);
        ms.push(start.elapsed().as_secs_f64() * 1e3);
    }
    ensure!(ms.len() > 1, "nothing to match");
    ms.remove(0);
    Ok((ms, num_pairs))
}

/// A year of monthly visits to `num_nodes` places, before the first query.
fn snapshot(workload: &Workload, num_nodes: usize) -> Result<Snapshot> {
    let extractor = ExtractorConfig::default().id();
    let meta = MapMeta::new(1, extractor, Preset::Default.name());
    let mut nodes = Vec::with_capacity(num_nodes);
    let first = workload.times.iter().min().copied().unwrap_or_default();
    let mut random = SplitMix(99);
    for place in 0..num_nodes {
        let learnt = &workload.learnt[place % workload.learnt.len()];
        let mut node = Node::new(PlaceKey::new(&format!("place-{place:05}"))?);
        let mut born = Features::new();
        for (keypoint, descriptor) in learnt.keypoints().iter().zip(learnt.descriptors()) {
            born.push(*keypoint, workload.seen_anew(descriptor, &mut random));
        }
        // A feature is seen in half of the year that begins with a month of its own, most of the
        // time.
        let seasons: Vec<usize> = (0..learnt.len())
            .map(|_| random.below(NUM_VISITS))
            .collect();
        for visit in 0..NUM_VISITS {
            let time = Time::from_us(first.as_us() - (NUM_VISITS - visit) as i64 * MONTH_US);
            let mut seen = BitRow::zeros(learnt.len());
            for (feature, season) in seasons.iter().enumerate() {
                let in_season = (visit + NUM_VISITS - season) % NUM_VISITS < NUM_VISITS / 2;
                let chance = if in_season { 80 } else { 20 };
                if visit == 0 || random.below(100) < chance {
                    seen.set(feature);
                }
            }
            let visit = Visit {
                id: VisitId((place * NUM_VISITS + visit) as u128),
                session: SessionId::derive("speed"),
                time,
                source: String::new(),
                appearance: None,
                appearance_use: AppearanceUse::Recognised,
            };
            node.push_visit(visit, &born, seen, None, BitRow::zeros(0))?;
            born.truncate(0);
        }
        nodes.push(Arc::new(node));
    }
    let parts = Snapshot::empty(meta).into_parts();
    Ok(Snapshot::from_parts(SnapshotParts { nodes, ..parts })?)
}

/// Memory of this process, where the system reports it.
fn resident_bytes() -> Option<usize> {
    let statm = std::fs::read_to_string("/proc/self/statm").ok()?;
    let pages: usize = statm.split(' ').nth(1)?.parse().ok()?;
    Some(pages * 4096)
}
