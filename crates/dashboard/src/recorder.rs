//! How does a localisation become something to look at?
//!
//! A [`Recorder`] takes one [`Trace`] after another and lets every panel log it to a file or a
//! viewer, under the names of [`entities`]. It computes nothing of its own: what is drawn was
//! decided by the library and is in the trace.
//!
//! Memory stays bounded however long a session is: what is kept is the names of the places, the
//! similarity of the latest [`SIMILARITY_QUERIES`](crate::SIMILARITY_QUERIES) queries, and what
//! rerun has not yet written (its batches are flushed at 1 MiB or 200 ms, files have no footer, and
//! a slow viewer makes the recorder wait). A file grows by a few kB for a query and some 10 kB for
//! a picture; [`RecorderConfig::with_image_every`] throttles pictures.

use anyhow::Result;
use chronotope::Time;
use chronotope::localize::Decision;
use chronotope::trace::{MapSummary, Trace};
use rerun::RecordingStream;

use crate::destination::Destination;
use crate::entities;
use crate::layout::{self, Arrangement, Page};
use crate::panels::latency::stage_names;
use crate::panels::lookup::{capture_time, names, posterior};
use crate::panels::over_time::MAX_FOLLOWED;
use crate::panels::predicted::NUM_PREDICTED;
use crate::panels::series::Series;
use crate::panels::similarity::Similarity;
use crate::panels::{
    bars, decision, graph, history, latency, live, map_changes, over_time, predicted, spectrum,
};

/// How localisations are recorded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RecorderConfig {
    image_every: u64,
    page: Page,
}

impl Default for RecorderConfig {
    /// Every picture is drawn.
    fn default() -> Self {
        Self {
            image_every: 1,
            page: Page::Now,
        }
    }
}

impl RecorderConfig {
    /// What is drawn, which is most of the cost, is drawn for at most every `n`-th query; 0: never.
    /// That is the picture with its features, predicted maps, similarity, histories, bars and graph
    /// (the last two wherever the decision changes, if there are no pictures); decision, posterior
    /// and latency are for every query.
    #[must_use]
    pub fn with_image_every(mut self, n: u64) -> Self {
        self.image_every = n;
        self
    }

    /// The page in front when the recording opens.
    #[must_use]
    pub fn with_page(mut self, page: Page) -> Self {
        self.page = page;
        self
    }
}

/// Logs one localisation after another.
pub struct Recorder {
    stream: RecordingStream,
    destination: Destination,
    cfg: RecorderConfig,
    num_queries: u64,
    /// The query whose picture was drawn last.
    drawn: Option<u64>,
    /// The decision that the graph shows.
    decided: Option<Decision>,
    has_pictures: bool,
    is_arranged: bool,
    map: MapSummary,
    /// Where places are drawn in the graph, by node.
    positions: Vec<[f32; 2]>,
    over_time: Series,
    latency: Series,
    similarity: Similarity,
}

impl Recorder {
    /// Starts a recording.
    ///
    /// Fails if the file cannot be written or no viewer listens.
    pub fn new(destination: Destination, cfg: RecorderConfig) -> Result<Self> {
        let stream = destination.open()?;
        Ok(Self::on(stream, destination, cfg))
    }

    fn on(stream: RecordingStream, destination: Destination, cfg: RecorderConfig) -> Self {
        // Two timelines of the recorder's own would only hide those that mean something.
        stream.set_log_tick_enabled(false);
        stream.set_log_time_enabled(false);
        Self {
            stream,
            destination,
            cfg,
            num_queries: 0,
            drawn: None,
            decided: None,
            has_pictures: false,
            is_arranged: false,
            map: MapSummary::default(),
            positions: Vec::new(),
            over_time: Series::new(entities::OVER_TIME),
            latency: Series::new(entities::LATENCY),
            similarity: Similarity::default(),
        }
    }

    /// How many localisations were recorded.
    pub fn num_queries(&self) -> u64 {
        self.num_queries
    }

    /// Records one localisation.
    pub fn record(&mut self, trace: &Trace<'_>) -> Result<()> {
        let query = self.num_queries;
        self.num_queries += 1;
        let time = capture_time(trace);
        self.set_time(query, time);
        if let Some(map) = &trace.map {
            self.change_map(trace, map)?;
        }
        if !self.is_arranged {
            self.arrange(trace)?;
        }
        let posterior = posterior(trace);
        decision::log(&self.stream, trace)?;
        over_time::log(&self.stream, &mut self.over_time, trace, &posterior)?;
        latency::log(&self.stream, &mut self.latency, trace)?;
        self.similarity.remember(trace);
        let is_due = self.is_due(query, trace);
        // Without any picture the decision is the only occasion.
        let is_news =
            self.cfg.image_every == 0 && self.decided != Some(trace.localization.decision);
        if is_due || is_news {
            self.decided = Some(trace.localization.decision);
            graph::log_places(&self.stream, trace, &posterior, &self.positions)?;
            bars::log(&self.stream, trace, &posterior)?;
        }
        if is_due {
            self.drawn = Some(query);
            live::log(&self.stream, trace)?;
            predicted::log(&self.stream, trace)?;
            self.similarity.log(&self.stream)?;
            history::log_now(&self.stream, &self.map.curves, trace, time)?;
        }
        Ok(())
    }

    /// Waits until everything is written or taken over.
    pub fn finish(self) -> Result<u64> {
        self.destination.flush(&self.stream)?;
        Ok(self.num_queries)
    }

    /// Whether this query's picture is drawn. Once pictures come, the others are not drawn without
    /// one.
    fn is_due(&mut self, query: u64, trace: &Trace<'_>) -> bool {
        let every = self.cfg.image_every;
        self.has_pictures |= trace.jpeg.is_some();
        let has_picture = trace.jpeg.is_some() || !self.has_pictures;
        every > 0 && has_picture && self.drawn.is_none_or(|drawn| query - drawn >= every)
    }

    fn set_time(&self, query: u64, time: Option<Time>) {
        self.stream.set_time_sequence(entities::QUERY, query as i64);
        match time {
            Some(time) => self.stream.set_timestamp_nanos_since_epoch(
                entities::CAPTURE_TIME,
                time.as_us().saturating_mul(1000),
            ),
            None => self.stream.disable_timeline(entities::CAPTURE_TIME),
        }
    }

    fn arrange(&mut self, trace: &Trace<'_>) -> Result<()> {
        self.is_arranged = true;
        let arrangement = Arrangement {
            image_size: (trace.image_size.0 as f32, trace.image_size.1 as f32),
            num_predicted: trace.predicted.len().clamp(1, NUM_PREDICTED),
            has_place_colours: trace.places.len() <= MAX_FOLLOWED,
            num_curves: self.map.curves.len(),
            stages: stage_names(trace).into_iter().map(str::to_owned).collect(),
            spectrum_per: (self.map.curves.first()).map(|curve| curve.spectrum.per.clone()),
            graph: graph::extent(&self.positions, &names(trace)),
            page: self.cfg.page,
        };
        layout::send(&self.stream, &arrangement)
    }

    fn change_map(&mut self, trace: &Trace<'_>, map: &MapSummary) -> Result<()> {
        let before = self.is_arranged.then_some(&self.map);
        map_changes::log(&self.stream, trace, before, map)?;
        graph::log_ways(&self.stream, map)?;
        self.positions = graph::positions(map, &names(trace));
        self.map = map.clone();
        for (index, curve) in map.curves.iter().enumerate() {
            history::log(&self.stream, index, curve, trace)?;
        }
        match map.curves.first() {
            Some(curve) => spectrum::log(&self.stream, curve),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::borrow::Cow;
    use std::collections::BTreeMap;
    use std::path::PathBuf;

    use chronotope::dataset::synthetic::{Schedule, World, WorldConfig};
    use chronotope::feature::{Extractor, StarBrief, StarBriefConfig};
    use chronotope::learn::{LearnConfig, Learner, Observation};
    use chronotope::localize::{Localizer, LocalizerConfig, Query};
    use chronotope::map::{MapMeta, NodeId, SessionId, derived_uuid};
    use chronotope::trace::{Shot, Stage, TraceConfig, Tracer};
    use rerun::RecordingStreamBuilder;
    use rerun::log::{Chunk, LogMsg};
    use rerun::sink::MemorySinkStorage;

    use super::*;
    use crate::destination::APPLICATION;
    use crate::{SIMILARITY_QUERIES, SIMILARITY_ROWS};

    const NUM_QUERIES: usize = 6;

    /// Traces of a small street; without times for a map that needs none.
    fn traces(cfg: LocalizerConfig, with_time: bool) -> Vec<Trace<'static>> {
        let world = World::new(
            &WorldConfig::new(1)
                .with_num_places(2)
                .with_image_size(320, 256),
        )
        .unwrap();
        let schedule = Schedule::standard(1, 8, NUM_QUERIES / 2);
        let extractor = StarBrief::new(StarBriefConfig::default()).unwrap();
        let meta = MapMeta::new(derived_uuid("test"), extractor.id(), "default");
        let mut learner = Learner::new(LearnConfig::default(), meta);
        for entry in world.dataset("learn", &schedule.learn).entries {
            let image = entry.source.load().unwrap();
            learner
                .observe(
                    &Observation::new(
                        entry.place,
                        SessionId::derive("one run"),
                        entry.time,
                        &extractor.extract(&image, None).unwrap(),
                        image.size(),
                    )
                    .with_source(entry.id),
                )
                .unwrap();
        }
        let localizer = Localizer::new(learner.snapshot().unwrap(), cfg).unwrap();
        let mut tracer = Tracer::new(TraceConfig::default());
        let queries = world.dataset("query", &schedule.query).entries;
        (queries.into_iter())
            .map(|entry| {
                let picture = entry.source.load().unwrap();
                let live = extractor.extract(&picture, None).unwrap();
                let time = with_time.then_some(entry.time);
                let query = Query::new(&live).at(time);
                let answer = localizer
                    .localize(&mut localizer.scratch(), &query)
                    .unwrap();
                let shot = Shot {
                    name: &entry.id,
                    file: None,
                    recipe: "",
                    picture: &picture,
                    time,
                    time_source: None,
                    truth: Some(&entry.place),
                    live: &live,
                    stages: &[Stage {
                        name: Cow::Borrowed("localize"),
                        ms: 1.0,
                    }],
                };
                let trace = tracer.trace(&localizer, &shot, &answer).unwrap();
                serde_json::from_str(&serde_json::to_string(&trace).unwrap()).unwrap()
            })
            .collect()
    }

    fn in_memory(cfg: RecorderConfig) -> (Recorder, MemorySinkStorage) {
        let (stream, storage) = RecordingStreamBuilder::new(APPLICATION).memory().unwrap();
        let nowhere = Destination::File(PathBuf::new());
        (Recorder::on(stream, nowhere, cfg), storage)
    }

    /// The number of rows of each entity, without those of the layout.
    fn record(traces: &[Trace<'_>], cfg: RecorderConfig) -> BTreeMap<String, usize> {
        let (mut recorder, storage) = in_memory(cfg);
        for trace in traces {
            recorder.record(trace).unwrap();
        }
        assert_eq!(recorder.finish().unwrap(), traces.len() as u64);
        let mut rows = BTreeMap::new();
        for message in storage.take() {
            if let LogMsg::ArrowMsg(_, message) = message {
                let chunk = Chunk::from_arrow_msg(&message).unwrap();
                let entity = chunk.entity_path().to_string();
                *rows
                    .entry(entity.trim_start_matches('/').to_owned())
                    .or_insert(0) += chunk.num_rows();
            }
        }
        rows
    }

    #[test]
    fn every_panel_is_filled() {
        let rows = record(
            &traces(LocalizerConfig::default(), true),
            RecorderConfig::default(),
        );
        let predicted = (0..2).flat_map(|rank| {
            [
                entities::predicted_frame(rank),
                entities::predicted_features(rank),
            ]
        });
        let always = [
            entities::LIVE_IMAGE,
            entities::LIVE_MATCHED,
            entities::LIVE_MISSING,
            entities::LIVE_UNEXPECTED,
            entities::DECISION,
            entities::POSTERIOR,
            entities::SIMILARITY,
        ];
        for entity in always.map(str::to_owned).into_iter().chain(predicted) {
            assert_eq!(rows.get(&entity), Some(&NUM_QUERIES), "{entity}: {rows:?}");
        }
        for entity in [entities::BARS, entities::BAR_NAMES] {
            assert_eq!(rows[entity], NUM_QUERIES, "{entity}");
        }
        for entity in [entities::OVER_TIME, entities::LATENCY] {
            // One more: how the series is drawn.
            assert_eq!(rows.get(entity), Some(&(NUM_QUERIES + 1)), "{entity}");
        }
        assert_eq!(rows[entities::MAP_CHANGES], 1);
        // One more: the ways.
        assert_eq!(rows[entities::GRAPH], NUM_QUERIES + 1);
        for entity in [entities::SPECTRUM_AMPLITUDE, entities::SPECTRUM_WINDOW] {
            assert_eq!(rows[entity], 1);
        }
        for entity in [
            entities::curve_axes(0),
            entities::curve_texts(0),
            entities::curve_p(0),
            entities::curve_seen(0),
        ] {
            assert_eq!(rows[&entity], 1, "{entity}");
        }
        assert_eq!(rows[&entities::curve_now(0)], NUM_QUERIES);
        // The two pages.
        assert!(
            rows.keys().any(|path| path.starts_with("viewport")),
            "{rows:?}"
        );
    }

    #[test]
    fn pictures_are_throttled() {
        let traces = traces(LocalizerConfig::default(), true);
        let pictures = |every: u64| {
            let rows = record(&traces, RecorderConfig::default().with_image_every(every));
            assert_eq!(rows[entities::DECISION], NUM_QUERIES);
            [
                entities::LIVE_IMAGE,
                entities::LIVE_MATCHED,
                entities::SIMILARITY,
            ]
            .map(|entity| rows.get(entity).copied().unwrap_or(0))
        };
        assert_eq!(pictures(1), [NUM_QUERIES; 3]);
        assert_eq!(pictures(4), [2; 3]);
        assert_eq!(pictures(0), [0; 3]);
    }

    #[test]
    fn features_are_drawn_on_their_own_picture_only() {
        let mut traces = traces(LocalizerConfig::default(), true);
        for trace in traces.iter_mut().skip(1) {
            trace.jpeg = None;
        }
        let rows = record(&traces, RecorderConfig::default());
        assert_eq!(
            (rows[entities::LIVE_IMAGE], rows[entities::LIVE_MATCHED]),
            (1, 1)
        );
        traces[0].jpeg = None;
        // Without any picture the features alone are better than nothing.
        let rows = record(&traces, RecorderConfig::default());
        assert_eq!(rows[entities::LIVE_MATCHED], NUM_QUERIES);
    }

    #[test]
    fn a_map_without_times_is_recorded_by_query() {
        let cfg = LocalizerConfig::default().with_method(chronotope::localize::Method::Static);
        let rows = record(&traces(cfg, false), RecorderConfig::default());
        assert_eq!(rows[entities::LIVE_IMAGE], NUM_QUERIES);
        assert_eq!(rows[entities::DECISION], NUM_QUERIES);
    }

    #[test]
    fn numbers_that_point_nowhere_are_left_out() {
        let mut traces = traces(LocalizerConfig::default(), true);
        for (index, trace) in traces.iter_mut().enumerate() {
            let answer = trace.localization.to_mut();
            answer.decision = Decision::At(NodeId(u32::MAX));
            for candidate in &mut answer.ranking {
                candidate.node = NodeId(1000);
                candidate.posterior = f64::NAN;
                candidate.probabilities.truncate(1);
                for found in &mut candidate.matches {
                    found.rank = u32::MAX;
                    found.live = u32::MAX;
                }
            }
            match index {
                0 => trace.places.clear(),
                1 => trace.predicted.clear(),
                2 => trace.live.clear(),
                3 => answer.ranking.clear(),
                _ => trace.curve_probabilities = vec![f64::INFINITY; 100],
            }
            if let Some(map) = &mut trace.map {
                map.places.truncate(1);
                for curve in &mut map.curves {
                    curve.node = NodeId(77);
                    curve.p.clear();
                    curve.seen.truncate(3);
                }
            }
        }
        let rows = record(&traces, RecorderConfig::default());
        assert_eq!(rows[entities::DECISION], NUM_QUERIES);
    }

    #[test]
    fn the_similarity_of_a_long_session_stays_small() {
        let mut trace = traces(LocalizerConfig::default(), true).swap_remove(1);
        let key = trace.places[0].clone();
        trace.places = vec![key; 10 * SIMILARITY_ROWS + 3];
        let (mut recorder, _storage) = in_memory(RecorderConfig::default());
        for _ in 0..2 * SIMILARITY_QUERIES {
            recorder.similarity.remember(&trace);
        }
        assert_eq!(recorder.similarity.num_queries(), SIMILARITY_QUERIES);
        recorder.similarity.log(&recorder.stream).unwrap();
    }
}
