//! How does a recording open?
//!
//! A blueprint travels with the recording: two pages, *Where am I?* (what the robot sees and
//! believes now) and *Why?* (what the map remembers, and how that went over time). It is written to
//! its own store with the archetypes of the viewer, because `rerun::blueprint` has no axes and no
//! active page.

use anyhow::{Context, Result};
use rerun::RecordingStream;
use rerun::external::re_log_types::{BlueprintActivationCommand, LogMsg, RecordingId};
use rerun::external::re_sdk_types::blueprint::archetypes::{
    ContainerBlueprint, PanelBlueprint, PlotLegend, ScalarAxis, TensorScalarMapping, TensorViewFit,
    TimePanelBlueprint, ViewBlueprint, ViewContents, ViewportBlueprint, VisibleTimeRanges,
    VisualBounds2D,
};
use rerun::external::re_sdk_types::blueprint::components::{
    ContainerKind, Corner2D, PanelState, PlayState, RootContainer, ViewFit,
};
use rerun::external::re_sdk_types::components::{Colormap, MagnificationFilter, Range1D};
use rerun::external::re_sdk_types::datatypes::{
    Range2D, TimeInt, TimeRange, TimeRangeBoundary, Uuid, VisibleTimeRange,
};
use rerun::{ApplicationId, AsComponents, EncodedImage, RecordingStreamBuilder};

use crate::panels::similarity::SIMILARITY_QUERIES;
use crate::panels::{bars, time_axis};
use crate::{colours, entities};

/// Of the live picture below predicted maps.
const BACKGROUND_OPACITY: f32 = 0.3;

/// Which page is in front when the recording opens.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Page {
    /// The live picture, what was predicted, the posterior and the decision.
    #[default]
    Now,
    /// Histories, rhythms, similarity and latency.
    Why,
}

/// What the layout depends on.
#[derive(Clone, Debug)]
pub(crate) struct Arrangement {
    /// Width and height of pictures, px.
    pub(crate) image_size: (f32, f32),
    /// Places whose predicted maps are shown.
    pub(crate) num_predicted: usize,
    /// Whether each place has a colour of its own, the same in bars and lines.
    pub(crate) has_place_colours: bool,
    /// Features whose histories are shown.
    pub(crate) num_curves: usize,
    /// Stages whose times are shown.
    pub(crate) stages: Vec<String>,
    /// What the frequencies of the spectrum count per; `None` without a spectrum.
    pub(crate) spectrum_per: Option<String>,
    /// The extent of the graph.
    pub(crate) graph: Range2D,
    pub(crate) page: Page,
}

/// A container or a view, with its share of the room.
enum Part {
    Row(Vec<(f32, Part)>),
    Column(Vec<(f32, Part)>),
    Tabs(Vec<(&'static str, Part)>, usize),
    View(View),
}

struct View {
    class: &'static str,
    name: String,
    origin: String,
    /// Entities beside those below the origin.
    with: Vec<&'static str>,
    /// What entities have that say nothing else themselves.
    defaults: Option<Box<dyn AsComponents>>,
    properties: Vec<(&'static str, Box<dyn AsComponents>)>,
}

impl View {
    fn new(class: &'static str, name: impl Into<String>, origin: impl Into<String>) -> Self {
        Self {
            class,
            name: name.into(),
            origin: origin.into(),
            with: Vec::new(),
            defaults: None,
            properties: Vec::new(),
        }
    }

    fn with(mut self, name: &'static str, property: impl AsComponents + 'static) -> Self {
        self.properties.push((name, Box::new(property)));
        self
    }

    /// Lines over the latest queries: of a long session all of them would be one grey.
    fn series(name: impl Into<String>, origin: &str, has_legend: bool) -> Self {
        let latest = VisibleTimeRange {
            timeline: entities::QUERY.into(),
            range: TimeRange {
                start: TimeRangeBoundary::CursorRelative(TimeInt(-(SIMILARITY_QUERIES as i64))),
                end: TimeRangeBoundary::CursorRelative(TimeInt(0)),
            },
        };
        Self::new("TimeSeries", name, origin)
            .with(
                "PlotLegend",
                PlotLegend::new()
                    .with_corner(Corner2D::LeftTop)
                    .with_visible(has_legend),
            )
            .with("VisibleTimeRanges", VisibleTimeRanges::new([latest]))
    }

    fn pixels(name: impl Into<String>, origin: impl Into<String>, size: (f32, f32)) -> Self {
        let range = Range2D {
            x_range: [0.0, f64::from(size.0)].into(),
            y_range: [0.0, f64::from(size.1)].into(),
        };
        Self::new("2D", name, origin).with("VisualBounds2D", VisualBounds2D::new(range))
    }
}

/// A little more than 0 to 100, so that lines at the ends are seen.
fn percent_axis() -> ScalarAxis {
    ScalarAxis::new().with_range(Range1D::new(-5.0, 105.0))
}

fn now(arrangement: &Arrangement) -> Part {
    let live = View::pixels(
        "Live picture: green found as predicted, orange predicted but missing, blue unexpected",
        entities::LIVE,
        arrangement.image_size,
    );
    let ranks = ["Best place", "Second", "Third"];
    let predicted = (0..arrangement.num_predicted).map(|rank| {
        let name = format!(
            "{}: what should be visible now (brighter = likelier, large = found)",
            ranks.get(rank).copied().unwrap_or("Next")
        );
        let mut view = View::pixels(name, entities::predicted(rank), arrangement.image_size);
        // The live picture below, dimmed, so that the points are somewhere.
        view.with.push(entities::LIVE_IMAGE);
        view.defaults = Some(Box::new(
            EncodedImage::update_fields().with_opacity(BACKGROUND_OPACITY),
        ));
        (1.0, Part::View(view))
    });
    let decision = View::new("TextDocument", "Decision", entities::DECISION);
    let graph = View::new("Graph", "Places: brighter = more probable", entities::GRAPH)
        .with("VisualBounds2D", VisualBounds2D::new(arrangement.graph));
    let posterior = View::pixels(
        "Where it may be: posterior, %",
        entities::BARS,
        bars::CANVAS,
    );
    let over_time = View::series(
        if arrangement.has_place_colours {
            "The same over the latest queries (colours as on the left)"
        } else {
            "Posterior over the latest queries, %"
        },
        entities::OVER_TIME,
        !arrangement.has_place_colours,
    )
    .with("ScalarAxis", percent_axis());
    let mut beliefs = vec![(1.0, Part::View(posterior))];
    if !arrangement.has_place_colours {
        let all = View::new(
            "BarChart",
            "All places by number (last: off the map)",
            entities::POSTERIOR,
        );
        beliefs.push((1.0, Part::View(all)));
    }
    beliefs.push((2.0, Part::View(over_time)));
    Part::Column(vec![
        (
            3.0,
            Part::Row(vec![
                (5.0, Part::View(live)),
                (3.0, Part::View(decision)),
                (3.0, Part::View(graph)),
            ]),
        ),
        (2.0, Part::Row(predicted.collect())),
        (1.6, Part::Row(beliefs)),
    ])
}

fn why(arrangement: &Arrangement) -> Part {
    let curves = (0..arrangement.num_curves).map(|index| {
        let view = View::pixels(
            "When is this feature visible? line: p(t); dots: seen (1) or not (0)",
            entities::curve(index),
            time_axis::CANVAS,
        );
        (1.0, Part::View(view))
    });
    let spectrum = View::new(
        "BarChart",
        format!(
            "Rhythms of the first feature, cycles per {}; grey: when visits came",
            arrangement.spectrum_per.as_deref().unwrap_or("year or day")
        ),
        entities::SPECTRUM,
    )
    .with("PlotLegend", PlotLegend::new().with_visible(false));
    let similarity = View::new(
        "Tensor",
        "Similarity, place x latest queries: % of predicted features found",
        entities::SIMILARITY,
    )
    .with(
        "TensorScalarMapping",
        TensorScalarMapping::new()
            .with_colormap(Colormap::Viridis)
            .with_mag_filter(MagnificationFilter::Nearest),
    )
    .with(
        "TensorViewFit",
        TensorViewFit::new().with_scaling(ViewFit::Fill),
    );
    let latency = latency(&arrangement.stages);
    let changes = View::new("TextDocument", "Map", entities::MAP_CHANGES);
    let mut left: Vec<(f32, Part)> = curves.collect();
    if left.is_empty() {
        left.push((
            1.0,
            Part::View(View::new("TextDocument", "Map", entities::MAP_CHANGES)),
        ));
    }
    Part::Row(vec![
        (3.0, Part::Column(left)),
        (
            2.0,
            Part::Column(vec![
                (1.0, Part::View(spectrum)),
                (1.0, Part::View(similarity)),
                (1.0, Part::View(latency)),
                (1.0, Part::View(changes)),
            ]),
        ),
    ])
}

/// Times of the stages; their colours stand in the title, where they hide nothing.
fn latency(stages: &[String]) -> View {
    let named: Option<Vec<String>> = (stages.iter().enumerate())
        .map(|(index, stage)| Some(format!("{stage} {}", colours::series_name(index)?)))
        .collect();
    match named.filter(|named| !named.is_empty()) {
        Some(named) => View::series(
            format!("Latency, ms: {}", named.join(", ")),
            entities::LATENCY,
            false,
        ),
        None => View::series("Latency by stage, ms", entities::LATENCY, true),
    }
}

/// Sends the layout into `recording`; viewers take it for this and later recordings.
pub(crate) fn send(recording: &RecordingStream, arrangement: &Arrangement) -> Result<()> {
    let application = recording
        .store_info()
        .context("the recording is switched off")?
        .application_id()
        .clone();
    let messages = Writer::write(application, arrangement)?;
    let blueprint_id = messages
        .iter()
        .find_map(|message| match message {
            LogMsg::SetStoreInfo(info) => Some(info.info.store_id.clone()),
            _ => None,
        })
        .context("the layout has no identity")?;
    let activation = BlueprintActivationCommand {
        blueprint_id,
        make_active: true,
        make_default: true,
    };
    recording.send_blueprint(messages, activation);
    Ok(())
}

/// Writes parts with ids in order.
struct Writer {
    stream: RecordingStream,
    num_ids: u64,
}

impl Writer {
    fn write(application: ApplicationId, arrangement: &Arrangement) -> Result<Vec<LogMsg>> {
        let (stream, storage) = RecordingStreamBuilder::new(application)
            .recording_id(RecordingId::random())
            .blueprint()
            .memory()?;
        stream.set_time_sequence("blueprint", 0);
        let mut writer = Self { stream, num_ids: 0 };
        let front = match arrangement.page {
            Page::Now => 0,
            Page::Why => 1,
        };
        let pages = vec![
            ("Where am I?", now(arrangement)),
            ("Why?", why(arrangement)),
        ];
        let root = writer.part(Part::Tabs(pages, front))?;
        let viewport = ViewportBlueprint::new()
            .with_root_container(RootContainer(root.id))
            .with_auto_layout(false)
            .with_auto_views(false);
        let stream = &writer.stream;
        stream.log("viewport", &viewport)?;
        for panel in ["blueprint_panel", "selection_panel"] {
            stream.log(
                panel,
                &PanelBlueprint::new().with_state(PanelState::Collapsed),
            )?;
        }
        let time = TimePanelBlueprint::new()
            .with_state(PanelState::Collapsed)
            .with_timeline(entities::QUERY)
            .with_play_state(PlayState::Following);
        stream.log("time_panel", &time)?;
        Ok(storage.take())
    }

    fn next_id(&mut self) -> Uuid {
        self.num_ids += 1;
        Uuid {
            bytes: u128::from(self.num_ids).to_be_bytes(),
        }
    }

    fn part(&mut self, part: Part) -> Result<Placed> {
        match part {
            Part::View(view) => self.view(view),
            Part::Row(parts) => {
                let (shares, placed) = self.parts(parts)?;
                let blueprint = ContainerBlueprint::new(ContainerKind::Horizontal);
                self.container(blueprint.with_col_shares(shares), &placed)
            }
            Part::Column(parts) => {
                let (shares, placed) = self.parts(parts)?;
                let blueprint = ContainerBlueprint::new(ContainerKind::Vertical);
                self.container(blueprint.with_row_shares(shares), &placed)
            }
            Part::Tabs(parts, front) => {
                let mut placed = Vec::new();
                for (name, part) in parts {
                    let page = self.part(part)?;
                    let rename = ContainerBlueprint::update_fields().with_display_name(name);
                    self.stream.log(page.path.as_str(), &rename)?;
                    placed.push(page);
                }
                let mut blueprint = ContainerBlueprint::new(ContainerKind::Tabs);
                if let Some(front) = placed.get(front) {
                    blueprint = blueprint.with_active_tab(front.path.as_str());
                }
                self.container(blueprint, &placed)
            }
        }
    }

    fn parts(&mut self, parts: Vec<(f32, Part)>) -> Result<(Vec<f32>, Vec<Placed>)> {
        let mut shares = Vec::new();
        let mut placed = Vec::new();
        for (share, part) in parts {
            shares.push(share);
            placed.push(self.part(part)?);
        }
        Ok((shares, placed))
    }

    fn container(&mut self, blueprint: ContainerBlueprint, parts: &[Placed]) -> Result<Placed> {
        let id = self.next_id();
        let path = format!("container/{}", hyphenated(id));
        let blueprint = blueprint.with_contents(parts.iter().map(|part| part.path.as_str()));
        self.stream.log(path.as_str(), &blueprint)?;
        Ok(Placed { id, path })
    }

    fn view(&mut self, view: View) -> Result<Placed> {
        let id = self.next_id();
        let path = format!("view/{}", hyphenated(id));
        let within = std::iter::once("+ $origin/**".to_owned())
            .chain(view.with.iter().map(|entity| format!("+ /{entity}")));
        self.stream
            .log(format!("{path}/ViewContents"), &ViewContents::new(within))?;
        let blueprint = ViewBlueprint::new(view.class)
            .with_display_name(view.name)
            .with_space_origin(view.origin);
        self.stream.log(path.as_str(), &blueprint)?;
        if let Some(defaults) = &view.defaults {
            self.stream
                .log(format!("{path}/defaults"), defaults.as_ref())?;
        }
        for (name, property) in &view.properties {
            self.stream
                .log(format!("{path}/{name}"), property.as_ref())?;
        }
        Ok(Placed { id, path })
    }
}

/// A part that was written.
struct Placed {
    id: Uuid,
    path: String,
}

/// `xxxxxxxx-xxxx-xxxx-xxxx-xxxxxxxxxxxx`.
fn hyphenated(id: Uuid) -> String {
    let text = format!("{:032x}", u128::from_be_bytes(id.bytes));
    let cut = [0..8, 8..12, 12..16, 16..20, 20..32];
    cut.map(|part| &text[part]).join("-")
}
