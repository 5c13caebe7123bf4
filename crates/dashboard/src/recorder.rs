//! How does a localisation become something to look at?
//!
//! A [`Recorder`] takes one [`Trace`] after another and logs it to a file or a viewer, under the names
//! of [`entities`]. It computes nothing of its own: what it draws was decided by the library and is in
//! the trace.
//!
//! Memory stays bounded however long a session is: what is kept is the names of the places, the
//! similarity of the latest [`SIMILARITY_QUERIES`] queries, and what rerun has not yet written (its
//! batches are flushed at 1 MiB or 200 ms, files have no footer, and a slow viewer makes the recorder
//! wait). A file grows by a few kB for a query and some 10 kB for a picture;
//! [`RecorderConfig::with_image_every`] throttles pictures.
//!
//! A trace may come from anybody: numbers that point nowhere are left out, never trusted.

use std::collections::{BTreeMap, VecDeque};
use std::io;
use std::net::{TcpStream, ToSocketAddrs};
use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Context, Result, bail};
use chronotope::Time;
use chronotope::localize::{Candidate, Decision};
use chronotope::map::PlaceKey;
use chronotope::trace::{CurveSummary, MapSummary, Trace, TracePoint};
use rerun::external::re_sdk_types::datatypes::Range2D;
use rerun::sink::{FileSink, FileSinkOptions};
use rerun::{
    BarChart, Boxes2D, Clear, Color, EncodedImage, GraphEdges, GraphNodes, LineStrips2D, MediaType,
    Points2D, Radius, RecordingStream, RecordingStreamBuilder, Scalars, SeriesLines, Tensor,
    TensorBuffer, TensorData, TextDocument,
};

use crate::layout::{self, Contents, Page};
use crate::{colours, drawing, entities, graph};

/// The name under which viewers keep the layout.
const APPLICATION: &str = "chronotope";
/// Columns of the similarity matrix.
pub const SIMILARITY_QUERIES: usize = 120;
/// Rows of the similarity matrix; more places share a row, which shows the highest.
pub const SIMILARITY_ROWS: usize = 64;
/// Best places whose predicted maps are drawn.
const NUM_PREDICTED: usize = 3;
/// Maps of more places are followed over time by best place and "elsewhere" only.
const MAX_FOLLOWED: usize = 8;
/// Bars with names, without that of "elsewhere".
const NUM_BARS: usize = MAX_FOLLOWED;
/// Rows of the table of places.
const TABLE_ROWS: usize = 5;
/// How long a viewer may take to take over what was logged last.
const FLUSH_TIMEOUT: Duration = Duration::from_secs(30);
const CONNECT_TIMEOUT: Duration = Duration::from_secs(3);

/// Where a recording goes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Destination {
    /// A file to be opened later; replaced if it exists.
    File(PathBuf),
    /// A viewer that is running, `rerun+http://HOST:PORT/proxy`.
    Viewer(String),
}

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
    /// What is drawn, which is most of the cost, is drawn for at most every `n`-th query; 0: never. That is
    /// the picture with its features, predicted maps, similarity, histories, bars and graph (the last two
    /// wherever the decision changes, if there are no pictures); decision, posterior and latency are for
    /// every query.
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
    /// Series whose names and colours were logged, with these names.
    named: BTreeMap<String, String>,
    /// Percent of predicted features found, by node; the latest query last.
    similarity: VecDeque<Vec<u8>>,
}

impl Recorder {
    /// Starts a recording.
    ///
    /// Fails if the file cannot be written or no viewer listens.
    pub fn new(destination: Destination, cfg: RecorderConfig) -> Result<Self> {
        let builder = RecordingStreamBuilder::new(APPLICATION);
        let stream = match &destination {
            Destination::File(path) => {
                // A footer lists every chunk of the file and is kept in memory until the end: it would
                // grow with the session. Viewers read files without one from the beginning.
                let options = FileSinkOptions {
                    write_footer: false,
                };
                let file = FileSink::with_options(path, options)
                    .with_context(|| format!("cannot write {}", path.display()))?;
                let stream = builder.buffered()?;
                stream.set_sink(Box::new(file));
                stream
            }
            Destination::Viewer(url) => {
                let no_viewer = || {
                    format!(
                        "no viewer listens at {url} (help: start `rerun`, or write a file with --save)"
                    )
                };
                probe(url).with_context(no_viewer)?;
                (builder.connect_grpc_opts(url.as_str())).with_context(no_viewer)?
            }
        };
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
            named: BTreeMap::new(),
            similarity: VecDeque::new(),
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
            self.map_changed(trace, map)?;
        }
        if !self.is_arranged {
            self.arrange(trace)?;
        }
        let posterior = posterior(trace);
        self.belief(trace, &posterior)?;
        self.latency(trace)?;
        self.remember_similarity(trace);
        let is_due = self.is_due(query, trace);
        // Without any picture the decision is the only occasion.
        let is_news =
            self.cfg.image_every == 0 && self.decided != Some(trace.localization.decision);
        if is_due || is_news {
            self.decided = Some(trace.localization.decision);
            self.graph(trace, &posterior)?;
            self.bars(trace, &posterior)?;
        }
        if is_due {
            self.drawn = Some(query);
            self.picture(trace)?;
            self.predicted(trace)?;
            self.log_similarity()?;
            self.now(trace, time)?;
        }
        Ok(())
    }

    /// Waits until everything is written or taken over.
    pub fn finish(self) -> Result<u64> {
        self.stream
            .flush_with_timeout(FLUSH_TIMEOUT)
            .with_context(|| match &self.destination {
                Destination::File(path) => format!("{} is incomplete", path.display()),
                Destination::Viewer(url) => format!("the viewer at {url} did not take everything"),
            })?;
        Ok(self.num_queries)
    }

    /// Whether this query's picture is drawn. Once pictures come, the others are not drawn without one.
    fn is_due(&mut self, query: u64, trace: &Trace<'_>) -> bool {
        let every = self.cfg.image_every;
        self.has_pictures |= trace.jpeg.is_some();
        let has_picture = trace.jpeg.is_some() || !self.has_pictures;
        every > 0 && has_picture && self.drawn.is_none_or(|drawn| query - drawn >= every)
    }

    fn set_time(&self, query: u64, time: Option<Time>) {
        self.stream.set_time_sequence(entities::QUERY, query as i64);
        match time {
            Some(time) => self
                .stream
                .set_timestamp_nanos_since_epoch(entities::CAPTURE_TIME, nanos(time)),
            None => self.stream.disable_timeline(entities::CAPTURE_TIME),
        }
    }

    fn arrange(&mut self, trace: &Trace<'_>) -> Result<()> {
        self.is_arranged = true;
        let contents = Contents {
            image_size: (trace.image_size.0 as f32, trace.image_size.1 as f32),
            num_predicted: trace.predicted.len().clamp(1, NUM_PREDICTED),
            has_place_colours: trace.places.len() <= MAX_FOLLOWED,
            num_curves: self.map.curves.len(),
            stages: stage_names(trace).into_iter().map(str::to_owned).collect(),
            spectrum_per: (self.map.curves.first()).map(|curve| curve.spectrum.per.clone()),
            graph: extent(&self.positions, &names(trace)),
            page: self.cfg.page,
        };
        layout::send(&self.stream, &contents)
    }

    fn map_changed(&mut self, trace: &Trace<'_>, map: &MapSummary) -> Result<()> {
        let text = changes(trace, &self.map, map, self.is_arranged);
        (self.stream).log(entities::MAP_CHANGES, &TextDocument::from_markdown(text))?;
        self.positions = graph::positions(map, &names(trace));
        self.map = map.clone();
        let edges = (map.edges.iter()).map(|edge| (edge.from.as_str(), edge.to.as_str()));
        let edges = GraphEdges::new(edges.collect::<Vec<_>>()).with_directed_edges();
        self.stream.log(entities::GRAPH, &edges)?;
        for (index, curve) in map.curves.iter().enumerate() {
            self.curve(trace, index, curve)?;
        }
        if let Some(curve) = map.curves.first() {
            self.spectrum(curve)?;
        }
        Ok(())
    }

    /// The history of a feature and its p(t) over the years that it spans.
    fn curve(&self, trace: &Trace<'_>, index: usize, curve: &CurveSummary) -> Result<()> {
        let Some(frame) = frame(curve) else {
            return Ok(());
        };
        let colour = colours::series(index);
        self.stream.log(
            entities::curve_axes(index),
            &LineStrips2D::new(frame.axes())
                .with_colors([colours::rgb(colours::FAINT)])
                .with_radii([Radius::new_ui_points(0.5)]),
        )?;
        let title = format!(
            "feature {} of {}, {}",
            curve.feature,
            place(trace, curve.node.0 as usize),
            (curve.period_s).map_or_else(|| "no rhythm".into(), period)
        );
        let (at, texts): (Vec<_>, Vec<String>) = (frame.texts().into_iter())
            .chain([(drawing::Curve::title_at(), title)])
            .unzip();
        self.texts(&entities::curve_texts(index), at, texts)?;
        let line = (curve.times_us.iter().zip(&curve.p))
            .map(|(&us, &p)| (frame.x(us), drawing::Curve::y(p)));
        self.stream.log(
            entities::curve_p(index),
            &LineStrips2D::new([line.collect::<Vec<_>>()])
                .with_colors([colour])
                .with_radii([Radius::new_ui_points(1.5)]),
        )?;
        let observed: Vec<(i64, bool)> = (curve.visit_times_us.iter().zip(&curve.seen))
            .filter_map(|(&us, &seen)| Some((us, seen?)))
            .collect();
        let dots = Points2D::new(
            (observed.iter())
                .map(|&(us, seen)| (frame.x(us), drawing::Curve::y(f64::from(u8::from(seen))))),
        )
        .with_colors(observed.iter().map(|&(_, seen)| {
            colours::rgb(if seen {
                colours::MATCHED
            } else {
                colours::MISSING
            })
        }))
        .with_radii([Radius::new_ui_points(4.0)])
        .with_labels(observed.iter().map(|&(us, seen)| {
            let seen = if seen { "seen" } else { "not seen" };
            format!("{seen} {}", Time::from_us(us))
        }))
        .with_show_labels(false);
        self.stream.log(entities::curve_seen(index), &dots)?;
        Ok(())
    }

    /// Texts that hang from points which are not drawn.
    fn texts(&self, entity: &str, at: Vec<(f32, f32)>, texts: Vec<String>) -> Result<()> {
        let points = Points2D::new(at)
            .with_radii([Radius::new_ui_points(0.0)])
            .with_colors([colours::rgb(colours::TEXT)])
            .with_labels(texts)
            .with_show_labels(true);
        Ok(self.stream.log(entity, &points)?)
    }

    /// When the query was taken, within the histories.
    fn now(&self, trace: &Trace<'_>, time: Option<Time>) -> Result<()> {
        let Some(time) = time else {
            return Ok(());
        };
        let known = self.map.curves.iter().zip(&trace.curve_probabilities);
        for (index, (curve, &p)) in known.enumerate() {
            let Some(frame) = frame(curve) else {
                continue;
            };
            let x = frame.x(time.as_us());
            let line = [(x, drawing::Curve::y(1.0)), (x, drawing::Curve::y(0.0))];
            self.stream.log(
                entities::curve_now(index),
                &LineStrips2D::new([line])
                    .with_colors([colours::rgb(colours::TEXT)])
                    .with_radii([Radius::new_ui_points(1.0)]),
            )?;
            // The text hangs above, where it hides neither the curve nor a date.
            let note = [frame.note_at(time.as_us()), (x, drawing::Curve::y(p))];
            self.stream.log(
                entities::curve_p_now(index),
                &Points2D::new(note)
                    .with_colors([colours::rgb(colours::TEXT)])
                    .with_radii([0.0, 5.0].map(Radius::new_ui_points))
                    .with_labels([format!("now: p = {p:.2}"), String::new()])
                    .with_show_labels(true),
            )?;
        }
        Ok(())
    }

    fn spectrum(&self, curve: &CurveSummary) -> Result<()> {
        let sheet = &curve.spectrum;
        // Side by side: each takes nearly half of the step between two frequencies.
        let step = match sheet.frequencies.as_slice() {
            [first, second, ..] => second - first,
            _ => 1.0,
        };
        let bars = |values: &[f64], colour: Color, side: f64| {
            let at = (sheet.frequencies.iter()).map(|frequency| frequency + 0.22 * side * step);
            BarChart::new(values.to_vec())
                .with_abscissa(at.collect::<Vec<f64>>())
                .with_widths(vec![0.4 * step as f32; values.len()])
                .with_color(colour)
        };
        self.stream.log(
            entities::SPECTRUM_WINDOW,
            &bars(&sheet.window, colours::rgb(colours::QUIET), 1.0),
        )?;
        self.stream.log(
            entities::SPECTRUM_AMPLITUDE,
            &bars(&sheet.amplitudes, colours::series(0), -1.0),
        )?;
        Ok(())
    }

    fn belief(&mut self, trace: &Trace<'_>, posterior: &[f64]) -> Result<()> {
        let answer = &trace.localization;
        let decision = TextDocument::from_markdown(decision(trace));
        self.stream.log(entities::DECISION, &decision)?;
        if trace.places.len() <= MAX_FOLLOWED {
            let mut names = names(trace);
            names.push("elsewhere");
            let shares = posterior.iter().chain([&answer.off_map]);
            let percent: Vec<f64> = shares.map(|share| 100.0 * share).collect();
            return self.lines(entities::OVER_TIME, &names, &percent);
        }
        let best = answer.first().map_or(0.0, |best| 100.0 * best.posterior);
        let values = [best, 100.0 * answer.off_map];
        self.lines(
            entities::OVER_TIME,
            &["the best place", "elsewhere"],
            &values,
        )
    }

    /// The posterior as bars: with names of the best places, by number of all.
    fn bars(&self, trace: &Trace<'_>, posterior: &[f64]) -> Result<()> {
        let elsewhere = trace.localization.off_map;
        let percent: Vec<f64> = (posterior.iter().chain([&elsewhere]))
            .map(|share| 100.0 * share)
            .collect();
        self.stream.log(
            entities::POSTERIOR,
            &BarChart::new(percent).with_color(colours::series(0)),
        )?;
        // A small map keeps its order, so that a bar stays where it was.
        let is_small = posterior.len() <= MAX_FOLLOWED;
        let mut shown: Vec<usize> = (0..posterior.len()).collect();
        if !is_small {
            shown.sort_by(|&a, &b| posterior[b].total_cmp(&posterior[a]).then(a.cmp(&b)));
            shown.truncate(NUM_BARS);
        }
        let mut rows: Vec<(&str, f64, Color)> = (shown.iter())
            .map(|&node| {
                let colour = if is_small {
                    colours::series(node)
                } else {
                    colours::probability(posterior[node])
                };
                (place(trace, node), posterior[node], colour)
            })
            .collect();
        rows.push((
            "elsewhere",
            elsewhere,
            colours::series(if is_small { posterior.len() } else { 1 }),
        ));
        let shares: Vec<f64> = rows.iter().map(|row| row.1).collect();
        let drawn = drawing::bars(&shares);
        self.stream.log(
            entities::BARS,
            &LineStrips2D::new(drawn.iter().map(|bar| bar.line))
                .with_colors(rows.iter().map(|row| row.2))
                .with_radii(drawn.iter().map(|bar| Radius::new_scene_units(bar.radius))),
        )?;
        let at = (drawn.iter()).flat_map(|bar| [bar.name_at, bar.value_at]);
        let texts = (rows.iter())
            .flat_map(|(name, share, _)| [shortened(name), format!("{:.1} %", 100.0 * share)]);
        self.texts(entities::BAR_NAMES, at.collect(), texts.collect())
    }

    /// One more point of several lines of one plot.
    fn lines(&mut self, entity: &'static str, names: &[&str], values: &[f64]) -> Result<()> {
        let key = format!("{entity}: {}", names.join(", "));
        if self.named.get(entity) != Some(&key) {
            self.named.insert(entity.to_owned(), key);
            self.stream.log_static(
                entity,
                &SeriesLines::new()
                    .with_names(names.iter().copied())
                    .with_colors((0..names.len()).map(colours::series))
                    .with_widths(vec![1.5; names.len()]),
            )?;
        }
        Ok(self
            .stream
            .log(entity, &Scalars::new(values.iter().copied()))?)
    }

    fn graph(&self, trace: &Trace<'_>, posterior: &[f64]) -> Result<()> {
        let here = match trace.localization.decision {
            Decision::At(node) => Some(node.0 as usize),
            _ => None,
        };
        let ids = names(trace);
        let labels =
            (trace.places.iter().zip(posterior).enumerate()).map(|(node, (key, share))| {
                let marks = if here == Some(node) { "HERE: " } else { "" };
                format!("{marks}{key} {:.0} %", 100.0 * share)
            });
        let radii = (0..trace.places.len()).map(|node| if here == Some(node) { 14.0 } else { 7.0 });
        let mut nodes = GraphNodes::new(ids)
            .with_labels(labels)
            .with_colors(posterior.iter().map(|&share| colours::probability(share)))
            .with_radii(radii);
        if self.positions.len() == trace.places.len() {
            nodes = nodes.with_positions(self.positions.iter().copied());
        }
        self.stream.log(entities::GRAPH, &nodes)?;
        Ok(())
    }

    fn latency(&mut self, trace: &Trace<'_>) -> Result<()> {
        let stages = trace.stages.iter().map(|stage| stage.ms);
        let values: Vec<f64> = stages.chain([trace.duration_ms]).collect();
        self.lines(entities::LATENCY, &stage_names(trace), &values)
    }

    /// The picture and the three classes of its features.
    fn picture(&self, trace: &Trace<'_>) -> Result<()> {
        match &trace.jpeg {
            Some(jpeg) => self.stream.log(
                entities::LIVE_IMAGE,
                &EncodedImage::new(jpeg.0.clone())
                    .with_media_type(MediaType::JPEG)
                    .with_draw_order(-10.0),
            )?,
            None => self.stream.log(entities::LIVE_IMAGE, &Clear::flat())?,
        }
        let classes = Classes::of(trace);
        let drawn = [
            (
                entities::LIVE_UNEXPECTED,
                classes.unexpected,
                colours::UNEXPECTED,
                1.5,
            ),
            (
                entities::LIVE_MISSING,
                classes.missing,
                colours::MISSING,
                3.0,
            ),
            (
                entities::LIVE_MATCHED,
                classes.matched,
                colours::MATCHED,
                3.5,
            ),
        ];
        for (entity, features, colour, radius) in drawn {
            let points = Points2D::new(features.iter().map(|feature| feature.at))
                .with_colors([colours::rgb(colour)])
                .with_radii([Radius::new_ui_points(radius)])
                .with_labels(features.into_iter().map(|feature| feature.label))
                .with_show_labels(false);
            self.stream.log(entity, &points)?;
        }
        Ok(())
    }

    /// What the best places should look like now.
    fn predicted(&self, trace: &Trace<'_>) -> Result<()> {
        let (width, height) = (trace.image_size.0 as f32, trace.image_size.1 as f32);
        let best = trace.localization.ranking.iter().zip(&trace.predicted);
        for (rank, (candidate, points)) in best.take(NUM_PREDICTED).enumerate() {
            let shift = displacement(candidate);
            let is_found = found(candidate, points.len());
            let likely = |i: usize| candidate.probabilities.get(i).copied();
            let label = |i: usize| {
                let found = if is_found[i] { "found" } else { "missing" };
                match likely(i) {
                    Some(p) => format!("p = {p:.2}, {found}"),
                    None => found.into(),
                }
            };
            let drawn = Points2D::new(points.iter().map(|point| moved(point, shift)))
                .with_colors(
                    (0..points.len()).map(|i| colours::probability(likely(i).unwrap_or(0.5))),
                )
                .with_radii(
                    (0..points.len())
                        .map(|i| Radius::new_ui_points(if is_found[i] { 5.0 } else { 2.5 })),
                )
                .with_labels((0..points.len()).map(label))
                .with_show_labels(false);
            self.stream
                .log(entities::predicted_features(rank), &drawn)?;
            let frame = Boxes2D::from_mins_and_sizes([(0.0, 0.0)], [(width, height)])
                .with_colors([colours::rgb(colours::QUIET)])
                .with_labels([format!(
                    "{}: {} of {} found",
                    place(trace, candidate.node.0 as usize),
                    candidate.num_inliers,
                    points.len()
                )])
                .with_show_labels(true);
            self.stream.log(entities::predicted_frame(rank), &frame)?;
        }
        Ok(())
    }

    fn remember_similarity(&mut self, trace: &Trace<'_>) {
        let mut column = vec![0; trace.places.len()];
        for (rank, candidate) in trace.localization.ranking.iter().enumerate() {
            let predicted = trace.predicted.get(rank).map_or(0, Vec::len);
            let num = predicted.max(candidate.predicted.len()).max(1) as f64;
            if let Some(cell) = column.get_mut(candidate.node.0 as usize) {
                *cell = (100.0 * f64::from(candidate.num_inliers) / num).min(100.0) as u8;
            }
        }
        if self.similarity.len() == SIMILARITY_QUERIES {
            self.similarity.pop_front();
        }
        self.similarity.push_back(column);
    }

    fn log_similarity(&self) -> Result<()> {
        let num_places = self.similarity.back().map_or(0, Vec::len);
        if num_places == 0 {
            return Ok(());
        }
        let share = num_places.div_ceil(SIMILARITY_ROWS);
        let num_rows = num_places.div_ceil(share);
        let num_columns = self.similarity.len();
        let cells: Vec<u8> = (0..num_rows)
            .flat_map(|row| {
                self.similarity.iter().map(move |column| {
                    let places = (row * share)..((row + 1) * share);
                    (places.filter_map(|place| column.get(place)).max()).map_or(0, |&cell| cell)
                })
            })
            .collect();
        let data = TensorData::new(
            vec![num_rows as u64, num_columns as u64],
            TensorBuffer::U8(cells.into()),
        );
        let tensor = Tensor::new(data).with_dim_names(["place", "query"]);
        Ok(self
            .stream
            .log(entities::SIMILARITY, &tensor.with_value_range([0.0, 100.0]))?)
    }
}

/// The share of each place, by node; places that were not ranked have none.
fn posterior(trace: &Trace<'_>) -> Vec<f64> {
    let mut posterior = vec![0.0; trace.places.len()];
    for candidate in &trace.localization.ranking {
        if let Some(share) = posterior.get_mut(candidate.node.0 as usize) {
            *share = candidate.posterior;
        }
    }
    posterior
}

/// Where the history of a feature and its p(t) are drawn.
fn frame(curve: &CurveSummary) -> Option<drawing::Curve> {
    drawing::Curve::around(curve.times_us.iter().chain(&curve.visit_times_us).copied())
}

/// The end of a name that would not fit beside a bar: names of places differ in their ends.
fn shortened(name: &str) -> String {
    const MAX: usize = 14;
    let num = name.chars().count();
    if num <= MAX {
        return name.to_owned();
    }
    std::iter::once('\u{2026}')
        .chain(name.chars().skip(num + 1 - MAX))
        .collect()
}

/// One feature of the live picture, or one that is missing there.
struct Drawn {
    at: (f32, f32),
    label: String,
}

/// The features of a picture by what the first place says of them.
#[derive(Default)]
struct Classes {
    matched: Vec<Drawn>,
    missing: Vec<Drawn>,
    unexpected: Vec<Drawn>,
}

impl Classes {
    fn of(trace: &Trace<'_>) -> Self {
        let mut classes = Self::default();
        let mut is_used = vec![false; trace.live.len()];
        if let Some((first, points)) = trace.localization.first().zip(trace.predicted.first()) {
            let likely = |rank: usize| match first.probabilities.get(rank) {
                Some(p) => format!("p = {p:.2}"),
                None => "remembered".into(),
            };
            for found in first.matches.iter().filter(|found| found.inlier) {
                let live = found.live as usize;
                let (Some(point), Some(is_used)) = (trace.live.get(live), is_used.get_mut(live))
                else {
                    continue;
                };
                *is_used = true;
                classes.matched.push(Drawn {
                    at: (point[0], point[1]),
                    label: format!(
                        "{}, found at {} bits",
                        likely(found.rank as usize),
                        found.distance_bits
                    ),
                });
            }
            let shift = displacement(first);
            let is_found = found(first, points.len());
            for (rank, point) in points
                .iter()
                .enumerate()
                .filter(|(rank, _)| !is_found[*rank])
            {
                classes.missing.push(Drawn {
                    at: moved(point, shift),
                    label: format!("{}, missing", likely(rank)),
                });
            }
        }
        for (point, _) in trace
            .live
            .iter()
            .zip(is_used)
            .filter(|(_, is_used)| !is_used)
        {
            classes.unexpected.push(Drawn {
                at: (point[0], point[1]),
                label: "unexpected".into(),
            });
        }
        classes
    }
}

/// Which predicted features were found where they belong.
fn found(candidate: &Candidate, num: usize) -> Vec<bool> {
    let mut is_found = vec![false; num];
    for found in candidate.matches.iter().filter(|found| found.inlier) {
        if let Some(is_found) = is_found.get_mut(found.rank as usize) {
            *is_found = true;
        }
    }
    is_found
}

/// By how much the picture is moved against the place, px.
fn displacement(candidate: &Candidate) -> (f32, f32) {
    let median = candidate.displacement.median;
    (median.dx_px as f32, median.dy_px as f32)
}

fn moved(point: &TracePoint, shift: (f32, f32)) -> (f32, f32) {
    (point[0] + shift.0, point[1] + shift.1)
}

fn place<'a>(trace: &'a Trace<'_>, node: usize) -> &'a str {
    (trace.places.get(node)).map_or("a place without name", |key| key.as_str())
}

/// When the picture was taken; the time that was predicted for says the same, where both are there.
fn capture_time(trace: &Trace<'_>) -> Option<Time> {
    let written = trace
        .time
        .as_deref()
        .and_then(|text| Time::parse(text).ok());
    written.or(trace.localization.time)
}

fn nanos(time: Time) -> i64 {
    time.as_us().saturating_mul(1000)
}

/// A period for people.
fn period(period_s: f64) -> String {
    let units = [(31_556_952.0, "year"), (86_400.0, "day"), (3_600.0, "hour")];
    let (unit_s, name) = (units.into_iter())
        .find(|(unit_s, _)| period_s >= 0.99 * unit_s)
        .unwrap_or((60.0, "minute"));
    match format!("{:.2}", period_s / unit_s).as_str() {
        "1.00" => format!("rhythm of a {name}").replace("a hour", "an hour"),
        count => {
            let count = count.trim_end_matches('0').trim_end_matches('.');
            format!("rhythm of {count} {name}s")
        }
    }
}

fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    (letters.next().into_iter().flat_map(char::to_uppercase))
        .chain(letters)
        .collect()
}

/// The answer and its reason.
fn decision(trace: &Trace<'_>) -> String {
    use std::fmt::Write as _;

    let answer = &trace.localization;
    let title = match answer.decision {
        Decision::At(node) => format!("At {}", place(trace, node.0 as usize)),
        Decision::Ambiguous => "In the map, but several places fit".into(),
        _ => "Unknown: no place fits well enough".into(),
    };
    let verdict = match (&trace.truth, answer.decision) {
        (None, _) => String::new(),
        (Some(truth), Decision::At(node)) if place(trace, node.0 as usize) == truth.as_str() => {
            format!("**Right**: it is {truth}. ")
        }
        (Some(truth), Decision::At(_)) => format!("**Wrong**: it is {truth}. "),
        (Some(truth), _) => format!("It is {truth}. "),
    };
    let time = trace.time.as_deref().unwrap_or("at an unknown time");
    let reason = capitalised(&answer.reason.to_string());
    let mut text = format!(
        "# {title}\n\n{verdict}{reason}.\n\n{time}\n\n| place | posterior | found | score |\n|---|---|---|---|\n"
    );
    for (rank, candidate) in answer.ranking.iter().take(TABLE_ROWS).enumerate() {
        let predicted = trace.predicted.get(rank).map_or(0, Vec::len);
        let _ = writeln!(
            text,
            "| {} | {:.1} % | {} of {} | {:.1} |",
            place(trace, candidate.node.0 as usize),
            100.0 * candidate.posterior,
            candidate.num_inliers,
            predicted.max(candidate.predicted.len()),
            candidate.score
        );
    }
    let _ = writeln!(
        text,
        "| *elsewhere* | {:.1} % | | |\n\n{}, method {}, score {}",
        100.0 * answer.off_map,
        trace.image,
        trace.method,
        trace.score
    );
    text
}

/// What the map holds, what its latest session brought, and what is new since `before`.
fn changes(trace: &Trace<'_>, before: &MapSummary, map: &MapSummary, has_before: bool) -> String {
    use std::fmt::Write as _;

    let total = |map: &MapSummary| {
        let visits: usize = map.places.iter().map(|place| place.num_visits).sum();
        let features: usize = map.places.iter().map(|place| place.num_features).sum();
        (visits, features)
    };
    let (visits, features) = total(map);
    let mut text = format!(
        "**Map** {}, generation {}: {} places, {} ways, {visits} visits, {features} features\n\n",
        trace.map_uuid.get(..8).unwrap_or(&trace.map_uuid),
        trace.map_generation,
        map.places.len(),
        map.edges.len(),
    );
    if let Some(session) = &map.latest_session {
        let new_places = match session.new_places.as_slice() {
            [] => "no new place".into(),
            places => format!("{} new places", places.len()),
        };
        let _ = write!(
            text,
            "**Latest session**, {} to {}: +{} visits, +{} features, {new_places}\n\n",
            session.first, session.last, session.num_visits, session.num_born
        );
    }
    if has_before {
        let (visits_before, features_before) = total(before);
        let _ = write!(
            text,
            "**Since the map before**: {:+} visits, {:+} features, {:+} places\n\n",
            visits as i64 - visits_before as i64,
            features as i64 - features_before as i64,
            map.places.len() as i64 - before.places.len() as i64
        );
    }
    text
}

/// The names of all places.
fn names<'t>(trace: &'t Trace<'_>) -> Vec<&'t str> {
    trace.places.iter().map(PlaceKey::as_str).collect()
}

/// The stages of a localisation, and their sum.
fn stage_names<'t>(trace: &'t Trace<'_>) -> Vec<&'t str> {
    (trace.stages.iter().map(|stage| stage.name.as_ref()))
        .chain(["total"])
        .collect()
}

/// The part of the plane that holds all positions, with a margin for their names.
fn extent(positions: &[[f32; 2]], names: &[&str]) -> Range2D {
    let widths = names.iter().map(|name| graph::name_width(name));
    let half = 0.5 * f64::from(widths.fold(100.0, f32::max));
    let range = |axis: usize, margin: f64| {
        let values = || {
            positions
                .iter()
                .map(move |position| f64::from(position[axis]))
        };
        let low = values().fold(f64::INFINITY, f64::min);
        let high = values().fold(f64::NEG_INFINITY, f64::max);
        if low > high {
            [-100.0, 100.0]
        } else {
            [low - margin, high + margin]
        }
    };
    Range2D {
        x_range: range(0, half).into(),
        y_range: range(1, 60.0).into(),
    }
}

/// Whether somebody listens where `url` points: rerun itself would wait for a viewer for ever.
fn probe(url: &str) -> Result<()> {
    let rest = url.split_once("://").map_or(url, |(_, rest)| rest);
    let address = rest.split('/').next().unwrap_or(rest);
    let mut failure = io::Error::from(io::ErrorKind::AddrNotAvailable);
    let addresses = address
        .to_socket_addrs()
        .with_context(|| format!("`{address}` is no HOST:PORT"))?;
    for address in addresses {
        match TcpStream::connect_timeout(&address, CONNECT_TIMEOUT) {
            Ok(_) => return Ok(()),
            Err(error) => failure = error,
        }
    }
    bail!(failure)
}

#[cfg(test)]
mod tests {
    use std::borrow::Cow;

    use chronotope::dataset::synthetic::{Schedule, World, WorldConfig};
    use chronotope::feature::{Extractor, StarBrief, StarBriefConfig};
    use chronotope::learn::{LearnConfig, Learner, Observation};
    use chronotope::localize::{Localizer, LocalizerConfig, Query};
    use chronotope::map::{MapMeta, NodeId, SessionId, derived_uuid};
    use chronotope::trace::{Shot, Stage, TraceConfig, Tracer};
    use rerun::log::{Chunk, LogMsg};
    use rerun::sink::MemorySinkStorage;

    use super::*;

    const NUM_QUERIES: usize = 6;

    /// Traces of a small street; without times for a map that needs none.
    fn traces(cfg: LocalizerConfig, with_time: bool) -> Vec<Trace<'static>> {
        let world = World::new(&WorldConfig::new(1).num_places(2).image_size(320, 256)).unwrap();
        let schedule = Schedule::standard(1, 8, NUM_QUERIES / 2);
        let extractor = StarBrief::new(StarBriefConfig::default()).unwrap();
        let meta = MapMeta::new(derived_uuid("test"), extractor.id(), "default");
        let mut learner = Learner::new(LearnConfig::default(), meta);
        for entry in world.dataset("learn", &schedule.learn).entries {
            let image = entry.source.load().unwrap();
            learner
                .observe(&Observation {
                    place: entry.place,
                    session: SessionId::derive("one run"),
                    time: entry.time,
                    features: &extractor.extract(&image, None).unwrap(),
                    image_size: image.size(),
                    mask: None,
                    source: entry.id,
                })
                .unwrap();
        }
        let localizer = Localizer::new(learner.snapshot().unwrap(), cfg).unwrap();
        let mut tracer = Tracer::new(TraceConfig::default());
        let queries = world.dataset("ask", &schedule.query).entries;
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
            recorder.remember_similarity(&trace);
        }
        assert_eq!(recorder.similarity.len(), SIMILARITY_QUERIES);
        recorder.log_similarity().unwrap();
    }

    #[test]
    fn a_missing_viewer_is_named() {
        // Port 9 (discard) is closed on machines of today.
        let url = "rerun+http://127.0.0.1:9/proxy";
        let refused = Recorder::new(Destination::Viewer(url.into()), RecorderConfig::default());
        let error = format!("{:#}", refused.err().expect("refused"));
        assert!(
            error.contains("no viewer listens at") && error.contains("--save"),
            "{error}"
        );
        let refused = Recorder::new(
            Destination::Viewer("nowhere".into()),
            RecorderConfig::default(),
        );
        assert!(format!("{:#}", refused.err().expect("refused")).contains("HOST:PORT"));
    }
}
