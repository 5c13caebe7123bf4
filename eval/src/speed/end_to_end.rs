//! How long does an answer take in a map of so many places, and which stage takes it?
//!
//! A place is one learnt image, each of its features seen anew, with a year of visits in which features
//! come and go. Queries are images that were not learnt. The stages are what
//! [`Localizer::localize_into`] does, called one by one; what is left of the whole is the vote, the
//! ranking and the decision. The extractor's time is in its own section.

use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use chronotope::Time;
use chronotope::feature::{ExtractorConfig, Features};
use chronotope::localize::{Localization, Localizer, LocalizerConfig, Preset, Query};
use chronotope::map::{
    AppearanceUse, MapMeta, Node, NodeId, PlaceKey, SessionId, Snapshot, Visit, VisitId,
};
use chronotope::matching::{MatchScratch, Matcher};
use chronotope::predict::{PredictedMap, Selection};
use chronotope::visibility::BitRow;

use super::material::SplitMix;
use super::{Material, Measurement};

/// What the section is called; the plot of growth looks for it.
pub(super) const SECTION: &str = "one answer, 50 features a place, 500 live";

const NUM_PREDICTED: usize = 50;
const NUM_VISITS: usize = 12;
const MONTH_US: i64 = 30 * 86_400 * 1_000_000;
/// Answers that are timed, at least; more for small maps.
const MIN_ANSWERS: usize = 5;
const MAX_ANSWERS: usize = 100;
const ENOUGH_S: f64 = 5.0;

/// Every stage in a map of `num_nodes` places.
pub(super) fn measure(material: &Material, num_nodes: usize) -> Result<Vec<Measurement>> {
    ensure!(num_nodes > 0, "a map of 0 places cannot be localised in");
    let case = format!("{num_nodes} places");
    let memory = resident_bytes();
    let snapshot = Arc::new(snapshot(material, num_nodes)?);
    let num_features: usize = snapshot.nodes.iter().map(|node| node.features.len()).sum();

    let start = Instant::now();
    let selection = Selection::top(NUM_PREDICTED)?;
    let cfg = LocalizerConfig::preset(Preset::Default).with_selection(selection);
    let localizer = Localizer::new(Arc::clone(&snapshot), cfg)?;
    let fit_ms = start.elapsed().as_secs_f64() * 1e3;

    let mut answers = Answers::default();
    let mut scratch = localizer.scratch();
    let mut out = Localization::default();
    let mut stages = Stages::new(&localizer);
    let mut num_pairs = 0;
    let start = Instant::now();
    let queries = material.queries.iter().zip(&material.times).enumerate();
    for (index, (features, &time)) in queries.cycle().take(MAX_ANSWERS) {
        if answers.whole.len() >= MIN_ANSWERS && start.elapsed().as_secs_f64() > ENOUGH_S {
            break;
        }
        let query = Query {
            features,
            time: Some(time),
            image_size: None,
        };
        let first_of = |out: &Localization| out.first().map(|first| first.node);
        if answers.whole.is_empty() {
            // Warms up what is reused.
            localizer.localize_into(&mut scratch, &query, &mut out)?;
            stages.run(&localizer, features, time)?;
        }
        let start = Instant::now();
        localizer.localize_into(&mut scratch, &query, &mut out)?;
        let whole = start.elapsed().as_secs_f64() * 1e3;
        let (predict, matching) = stages.run(&localizer, features, time)?;
        num_pairs = out.pairs_compared as usize;
        let place = first_of(&out).map(|first| material.place_of(first.0 as usize));
        answers.right += usize::from(place == Some(material.query_places[index]));
        answers.whole.push(whole);
        answers.predict.push(predict);
        answers.matching.push(matching);
        answers.decide.push((whole - predict - matching).max(0.0));
    }

    let row = |subject: &str, ms: &[f64]| Measurement::new(SECTION, &case, subject, ms);
    let right = answers.right as f64 / answers.whole.len() as f64;
    let per_feature = resident_bytes()
        .zip(memory)
        .map(|(now, before)| now.saturating_sub(before) as f64 / num_features as f64);
    let memory = per_feature.map_or(String::new(), |bytes| {
        format!(", {bytes:.0} bytes a feature with models and scratch")
    });
    Ok(vec![
        row("fit all models, once", &[fit_ms]).note(format!("{num_features} features{memory}")),
        row("predict", &answers.predict),
        row("match", &answers.matching).pairs(num_pairs),
        row("vote, rank, decide", &answers.decide),
        row("whole", &answers.whole).note(format!(
            "{:.0} % of first places show the right one, {:.3e} pairs/s",
            100.0 * right,
            num_pairs as f64 * 1e3 / crate::metrics::p50_p99(&answers.whole).0
        )),
    ])
}

/// Milliseconds of each stage, one entry an answer.
#[derive(Default)]
struct Answers {
    whole: Vec<f64>,
    predict: Vec<f64>,
    matching: Vec<f64>,
    decide: Vec<f64>,
    right: usize,
}

/// What the stages work in when they are called one by one.
struct Stages {
    matcher: Matcher,
    predicted: PredictedMap,
    ranked: Vec<Features>,
    scratch: MatchScratch,
    matches: Vec<chronotope::matching::Match>,
}

impl Stages {
    fn new(localizer: &Localizer) -> Self {
        Self {
            matcher: Matcher::new(localizer.cfg().matching().clone()),
            predicted: PredictedMap::new(),
            ranked: vec![Features::new(); localizer.snapshot().nodes.len()],
            scratch: MatchScratch::default(),
            matches: Vec::new(),
        }
    }

    /// Milliseconds of prediction and of matching.
    fn run(&mut self, localizer: &Localizer, live: &Features, time: Time) -> Result<(f64, f64)> {
        let start = Instant::now();
        for (id, ranked) in (0..).map(NodeId).zip(&mut self.ranked) {
            let model = localizer.model(id).context("the method predicts no map")?;
            self.predicted
                .predict(model, time, localizer.cfg().selection());
            let features = &localizer.snapshot().node(id).features;
            ranked.gather(features, self.predicted.features());
        }
        let predict_ms = start.elapsed().as_secs_f64() * 1e3;
        let start = Instant::now();
        for ranked in &self.ranked {
            self.matcher.matches_into(
                &mut self.scratch,
                ranked.view(),
                live.view(),
                &mut self.matches,
            );
        }
        Ok((predict_ms, start.elapsed().as_secs_f64() * 1e3))
    }
}

/// A year of monthly visits to `num_nodes` places, before the first query.
fn snapshot(material: &Material, num_nodes: usize) -> Result<Snapshot> {
    let extractor = ExtractorConfig::default().id();
    let mut snapshot = Snapshot::empty(MapMeta::new(1, extractor, Preset::Default.name()));
    let first = material.times.iter().min().copied().unwrap_or_default();
    let mut random = SplitMix(99);
    for place in 0..num_nodes {
        let learnt = &material.learnt[place % material.learnt.len()];
        let mut node = Node::new(PlaceKey::new(&format!("place-{place:05}"))?);
        for (keypoint, descriptor) in learnt.keypoints().iter().zip(learnt.descriptors()) {
            let descriptor = material.seen_anew(descriptor, &mut random);
            node.features.push(*keypoint, descriptor);
        }
        // A feature is seen in half of the year that begins with a month of its own, most of the time.
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
            node.log.push_visit(time, seen, None)?;
            node.visits.push(Visit {
                id: VisitId((place * NUM_VISITS + visit) as u128),
                session: SessionId::derive("speed"),
                time,
                source: String::new(),
                appearance: None,
                appearance_use: AppearanceUse::Recognised,
            });
        }
        snapshot.nodes.push(Arc::new(node));
    }
    Ok(snapshot)
}

/// Memory of this process, where the system tells.
fn resident_bytes() -> Option<usize> {
    let statm = std::fs::read_to_string("/proc/self/statm").ok()?;
    let pages: usize = statm.split(' ').nth(1)?.parse().ok()?;
    Some(pages * 4096)
}
