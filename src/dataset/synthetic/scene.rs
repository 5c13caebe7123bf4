//! What stands where, and when?
//!
//! Every place is a stretch of one street: a facade of brick in bays and rows, cut into cells. A
//! cell shows at most one of its [`Element`]s at a visit, so that their probabilities add up and
//! nothing hides anything else by plan (passers-by do, at random). Cells of the same kind are
//! filled from the same catalogue of windows and doors at every place: such places look alike.

use super::paint::{self, Patch};
use super::random::{Rng, hash};
use super::rhythm::{Activity, Rhythm, Window};
use crate::feature::Rect;
use fremen::time::Time;

/// How far pictures may reach beyond the image, px; more than any viewpoint moves.
pub(super) const MARGIN: i32 = 16;
/// Width of a bay of the facade, px.
pub(super) const BAY: i32 = 52;
/// Height of a row of the facade, px.
pub(super) const ROW: i32 = 62;
/// Height of pavement and road together, px.
pub(super) const GROUND: i32 = 66;
/// Least height of the sky, px.
const SKY: i32 = 40;

/// What an element is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ElementKind {
    /// A window from the catalogue that all places share.
    Window,
    /// Such a window with its blinds drawn.
    Blinds,
    /// A window lit from inside.
    LitWindow,
    /// Closed shutters.
    Shutters,
    /// The crown of a tree in leaf.
    Foliage,
    /// The crown of a tree without leaves.
    BareCrown,
    /// Climbing plants in leaf.
    Ivy,
    /// The trellis that climbing plants leave bare.
    Trellis,
    /// A mural or a sign.
    Mural,
    /// A shop that is open.
    Shop,
    /// A shop that is closed.
    RollerShutter,
    /// A door that is closed.
    ClosedDoor,
    /// A door that is open.
    OpenDoor,
    /// A market stall.
    Stall,
    /// A bench.
    Bench,
    /// A parked van.
    Van,
    /// Parasol, chairs and tables.
    Cafe,
    /// Stacked firewood.
    Firewood,
    /// Snow on pavement and road, or on the roof.
    Snow,
}

/// One thing that is drawn at some visits and not at others.
#[derive(Clone, Debug)]
pub struct Element {
    id: u32,
    cell: u32,
    kind: ElementKind,
    rect: Rect,
    shared: bool,
    rhythm: Rhythm,
    /// Upper-left pixel of the patch, which may reach beyond the image.
    pub(super) at: (i32, i32),
    pub(super) patch: Patch,
}

impl Element {
    /// Its position in [`World::truth`](super::World::truth).
    pub fn id(&self) -> u32 {
        self.id
    }

    /// The cell it stands in; at a visit at most one element of a cell is drawn.
    pub fn cell(&self) -> u32 {
        self.cell
    }

    /// What it is.
    pub fn kind(&self) -> ElementKind {
        self.kind
    }

    /// Where it is in the reference frame: the image of a visit without viewpoint jitter.
    pub fn rect(&self) -> Rect {
        self.rect
    }

    /// Whether other places may show the very same thing.
    pub fn is_shared(&self) -> bool {
        self.shared
    }

    /// The true p(t): the probability, in `[0, 1]`, that a visit at this time finds it drawn.
    ///
    /// Passers-by may still hide it and darkness may drown it in noise, neither with any rhythm of
    /// the element's own.
    pub fn visibility(&self, time: Time) -> f64 {
        self.rhythm.at(time)
    }

    /// Whether it shines by itself.
    pub(super) fn is_lit(&self) -> bool {
        self.kind == ElementKind::LitWindow
    }
}

/// What every place of a world has in common.
pub(super) struct Street {
    pub(super) seed: u64,
    pub(super) width: i32,
    pub(super) height: i32,
    pub(super) rhythms: bool,
}

impl Street {
    pub(super) fn num_bays(&self) -> i32 {
        self.width / BAY
    }

    pub(super) fn num_rows(&self) -> i32 {
        (self.height - GROUND - SKY) / ROW
    }

    /// Row of the first pixel of pavement.
    pub(super) fn ground_y(&self) -> i32 {
        self.height - GROUND
    }

    /// Row of the first pixel of facade.
    pub(super) fn facade_y(&self) -> i32 {
        self.ground_y() - self.num_rows() * ROW
    }

    /// Column of the first pixel of a bay.
    pub(super) fn bay_x(&self, bay: i32) -> i32 {
        (self.width - self.num_bays() * BAY) / 2 + bay * BAY
    }

    /// The random sequence of a thing that all places share.
    pub(super) fn shared(&self, thing: u64) -> Rng {
        Rng::new(&[self.seed, 0x5a5a, thing])
    }

    /// The random sequence of a thing of one place.
    fn own(&self, place: usize, thing: u64) -> Rng {
        Rng::new(&[self.seed, 0x0e0e, place as u64, thing])
    }
}

/// The elements of one place and what stands behind them.
pub(super) struct Scene {
    /// In order of cells.
    pub(super) elements: Vec<Element>,
    /// Opaque, of the image's size.
    pub(super) background: Patch,
    /// Drawn over everything: lamp posts, with their upper-left pixels.
    pub(super) foreground: Vec<(i32, i32, Patch)>,
}

/// What a cell of the facade is planned for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Plan {
    SharedWindow,
    NightWindow,
    Climbers,
    Mural,
    SharedDoor,
    Shop,
    Door,
    Market,
    Terrace,
    Parking,
}

/// An element and its picture.
type Look = (ElementKind, Patch);

impl Plan {
    /// When the cell is active, what it shows then (drawn from `rng`) and what otherwise (from
    /// `rest`); `None` for plans without a rhythm.
    fn alternation(
        self,
        w: i32,
        h: i32,
        rng: &mut Rng,
        rest: &mut Rng,
    ) -> Option<(Activity, Look, Look)> {
        Some(match self {
            Self::SharedWindow | Self::SharedDoor | Self::Mural => return None,
            Self::NightWindow => (
                daytime(rng),
                (ElementKind::Shutters, paint::paint_shutters(rng, w, h)),
                (ElementKind::LitWindow, paint::paint_lit_window(rest, w, h)),
            ),
            Self::Climbers => (
                summer(rng),
                (ElementKind::Ivy, paint::paint_ivy(rng, w, h)),
                (ElementKind::Trellis, paint::paint_trellis(rest, w, h)),
            ),
            Self::Shop => (
                opening_hours(rng),
                (ElementKind::Shop, paint::paint_shop(rng, w, h)),
                (
                    ElementKind::RollerShutter,
                    paint::paint_roller_shutter(rest, w, h),
                ),
            ),
            Self::Door => (
                opening_hours(rng),
                (ElementKind::OpenDoor, paint::paint_open_door(rng, w, h)),
                (
                    ElementKind::ClosedDoor,
                    paint::paint_closed_door(rest, w, h),
                ),
            ),
            Self::Market => (
                some_weekdays(rng),
                (ElementKind::Stall, paint::paint_stall(rng, w, h)),
                (ElementKind::Bench, paint::paint_bench(rest, w, h)),
            ),
            Self::Terrace => (
                summer(rng),
                (ElementKind::Cafe, paint::paint_cafe(rng, w, h)),
                (ElementKind::Firewood, paint::paint_firewood(rest, w, h)),
            ),
            Self::Parking => (
                daytime(rng),
                (ElementKind::Bench, paint::paint_bench(rng, w, h)),
                (ElementKind::Van, paint::paint_van(rest, w, h)),
            ),
        })
    }
}

/// Cells between the top row and the ground, repeated in this order until all are planned, then
/// shuffled.
const MIDDLE: [Plan; 5] = [
    Plan::NightWindow,
    Plan::Climbers,
    Plan::Mural,
    Plan::NightWindow,
    Plan::Climbers,
];

/// Cells on the ground, likewise.
const GROUND_FLOOR: [Plan; 5] = [
    Plan::Shop,
    Plan::Terrace,
    Plan::Door,
    Plan::Market,
    Plan::Parking,
];

/// Probability that a shared window is of the rarer of the two models.
const RARE: f64 = 0.10;

/// Probability that somebody has drawn the blinds of a shared window, at any time.
const BLINDS: f64 = 0.12;

/// Probability that a mural is not covered by scaffolding, at any time.
const UNCOVERED: f64 = 0.50;

/// Probability that a cell out of its phase looks like that of every other place.
const SHARED_REST: f64 = 0.7;

/// Probability of an element in its phase.
const HIGH: f64 = 0.96;
/// Probability of an element out of its phase, where people may be early or late.
const LOW: f64 = 0.02;

fn summer(rng: &mut Rng) -> Activity {
    Activity {
        year: Some(Window::around(
            0.54 + rng.range(-0.10, 0.10),
            rng.range(0.44, 0.54),
            0.08,
        )),
        ..Activity::default()
    }
}

fn deep_winter() -> Activity {
    Activity {
        year: Some(Window::around(0.04, 0.24, 0.08)),
        ..Activity::default()
    }
}

fn daytime(rng: &mut Rng) -> Activity {
    Activity {
        day: Some(Window::around(
            0.53 + rng.range(-0.08, 0.08),
            rng.range(0.44, 0.54),
            0.06,
        )),
        ..Activity::default()
    }
}

fn opening_hours(rng: &mut Rng) -> Activity {
    Activity {
        weekdays: Some(if rng.chance(0.5) {
            0b011_1111
        } else {
            0b001_1111
        }),
        day: Some(Window::around(
            0.54 + rng.range(-0.06, 0.06),
            rng.range(0.40, 0.48),
            0.05,
        )),
        ..Activity::default()
    }
}

fn some_weekdays(rng: &mut Rng) -> Activity {
    // Three or four days in a row.
    let run = if rng.chance(0.5) { 0b111 } else { 0b1111 };
    let shift = rng.int(0, 6);
    Activity {
        weekdays: Some((((run << shift) | (run << shift >> 7)) & 0x7f) as u8),
        ..Activity::default()
    }
}

/// Collects the elements of one place.
struct Builder<'a> {
    street: &'a Street,
    elements: Vec<Element>,
    cell: u32,
}

impl Builder<'_> {
    /// Adds an element to the current cell.
    fn add(
        &mut self,
        kind: ElementKind,
        at: (i32, i32),
        shared: bool,
        rhythm: Rhythm,
        patch: Patch,
    ) {
        let rhythm = if self.street.rhythms {
            rhythm
        } else {
            Rhythm::constant(rhythm.mean())
        };
        self.elements.push(Element {
            id: self.elements.len() as u32,
            cell: self.cell,
            kind,
            rect: Rect {
                x: at.0.max(0) as u32,
                y: at.1.max(0) as u32,
                width: (patch.width.min(self.street.width - at.0) + at.0.min(0)) as u32,
                height: (patch.height.min(self.street.height - at.1) + at.1.min(0)) as u32,
            },
            at,
            shared,
            rhythm,
            patch,
        });
    }

    /// Fills one cell by plan.
    fn fill(&mut self, plan: Plan, at: (i32, i32), size: (i32, i32), rng: &mut Rng) {
        let (w, h) = size;
        let street = self.street;
        let is_shared = rng.chance(SHARED_REST);
        let mut rest = if is_shared {
            street.shared(100 + plan as u64)
        } else {
            Rng::new(&[rng.bits()])
        };
        if let Some((activity, active, inactive)) = plan.alternation(w, h, rng, &mut rest) {
            self.pair(activity, at, active, inactive, is_shared);
        } else if plan == Plan::SharedWindow {
            let model = if rng.chance(RARE) { 3 } else { 1 };
            let open = paint::paint_window(&mut street.shared(model), w, h);
            let drawn = paint::paint_blinds(&mut street.shared(5), w, h);
            let rhythm = Rhythm::constant(1.0 - BLINDS);
            self.add(ElementKind::Window, at, true, rhythm, open);
            let rhythm = Rhythm::constant(BLINDS);
            self.add(ElementKind::Blinds, at, true, rhythm, drawn);
        } else if plan == Plan::SharedDoor {
            let door = paint::paint_closed_door(&mut street.shared(2), w, h);
            let rhythm = Rhythm::constant(0.97);
            self.add(ElementKind::ClosedDoor, at, true, rhythm, door);
        } else {
            let mural = paint::paint_mural(rng, w, h);
            let rhythm = Rhythm::constant(UNCOVERED);
            self.add(ElementKind::Mural, at, false, rhythm, mural);
        }
        self.cell += 1;
    }

    /// Adds an element that shows while active and its counterpart that shows while not, which all
    /// places may share. Seasons make no exceptions, people do.
    fn pair(
        &mut self,
        activity: Activity,
        at: (i32, i32),
        active: Look,
        inactive: Look,
        is_shared: bool,
    ) {
        let low = if activity.year.is_some() { 0.0 } else { LOW };
        self.add(
            active.0,
            at,
            false,
            Rhythm::with(activity, low, HIGH),
            active.1,
        );
        self.add(
            inactive.0,
            at,
            is_shared,
            Rhythm::without(activity, low, HIGH),
            inactive.1,
        );
    }
}

impl Scene {
    /// The scene of one place.
    pub(super) fn new(street: &Street, place: usize) -> Self {
        let (bays, rows) = (street.num_bays(), street.num_rows());
        let mut rng = street.own(place, 0);
        let mut builder = Builder {
            street,
            elements: Vec::new(),
            cell: 0,
        };
        let mut background = background(street);

        // The outermost bays are mostly outside what detectors see: plain street.
        let mut inner: Vec<i32> = (1..bays - 1).collect();
        rng.shuffle(&mut inner);
        let num_trees = (inner.len() / 4).max(1);
        let mut trees: Vec<i32> = inner.drain(..num_trees).collect();
        trees.sort_unstable();
        inner.sort_unstable();

        for &bay in &trees {
            let (x, y) = (street.bay_x(bay), street.facade_y() + ROW);
            let height = (rows - 2) * ROW + ROW / 2;
            background.line(
                (x + BAY / 2, y + height - 8),
                (x + BAY / 2, street.ground_y() + 6),
                3,
                44,
            );
            let activity = summer(&mut rng);
            let tone = rng.int(78, 104);
            let leaves = paint::paint_foliage(&mut rng, BAY, height, tone);
            let bare = paint::paint_bare_crown(&mut rng, BAY, height);
            builder.pair(
                activity,
                (x, y),
                (ElementKind::Foliage, leaves),
                (ElementKind::BareCrown, bare),
                false,
            );
            builder.cell += 1;
        }

        let planned = |plans: &[Plan], num: usize, rng: &mut Rng| {
            let mut plans: Vec<Plan> = plans.iter().copied().cycle().take(num).collect();
            rng.shuffle(&mut plans);
            plans.into_iter()
        };
        let mut middle = planned(&MIDDLE, inner.len(), &mut rng);
        let mut ground = planned(&GROUND_FLOOR, inner.len(), &mut rng);
        for bay in 0..bays {
            let x = street.bay_x(bay) + 2;
            let is_inner = inner.contains(&bay);
            for row in 0..rows {
                let is_ground = row == rows - 1;
                let y = street.facade_y() + row * ROW + 4;
                let height = if is_ground { ROW - 4 } else { ROW - 8 };
                let plan = match (row, is_inner) {
                    (0, _) => Some(Plan::SharedWindow),
                    (row, _) if row < rows - 2 && !trees.contains(&bay) => Some(Plan::SharedWindow),
                    (_, false) if trees.contains(&bay) => None,
                    (_, true) if is_ground => ground.next(),
                    (_, true) => middle.next(),
                    (_, false) if is_ground => Some(Plan::SharedDoor),
                    (_, false) => Some(Plan::SharedWindow),
                };
                if let Some(plan) = plan {
                    builder.fill(plan, (x, y), (BAY - 4, height), &mut rng);
                }
            }
        }

        let snow = Rhythm::with(deep_winter(), 0.0, 0.9);
        let road = paint::paint_snow(&mut rng, street.width + 2 * MARGIN, GROUND + MARGIN);
        builder.add(
            ElementKind::Snow,
            (-MARGIN, street.ground_y()),
            false,
            snow,
            road,
        );
        builder.cell += 1;
        let roof = paint::paint_snow(&mut rng, street.width + 2 * MARGIN, 12);
        let at = (-MARGIN, street.facade_y() - 14);
        builder.add(ElementKind::Snow, at, false, snow, roof);

        let post = paint::paint_lamp_post(16, 112);
        let foreground = [1, bays / 2, bays - 1]
            .into_iter()
            .map(|bay| {
                let x = street.bay_x(bay) - 8;
                (x, street.ground_y() + 8 - post.height, post.clone())
            })
            .collect();
        Self {
            elements: builder.elements,
            background,
            foreground,
        }
    }

    /// The element that each cell shows at this visit.
    pub(super) fn shown(&self, key: u64, time: Time) -> impl Iterator<Item = &Element> {
        self.elements
            .chunk_by(|a, b| a.cell == b.cell)
            .filter_map(move |cell| {
                let mut draw = super::random::unit(hash(&[key, u64::from(cell[0].cell)]));
                cell.iter().find(|element| {
                    draw -= element.visibility(time);
                    draw < 0.0
                })
            })
    }
}

/// Sky, roof, bricks, pavement and road: the same everywhere.
fn background(street: &Street) -> Patch {
    let mut patch = Patch::new(street.width, street.height);
    let roof = street.facade_y() - 8;
    for y in 0..roof {
        patch.rect(0, y, street.width, 1, 190 + y / 2);
    }
    patch.rect(0, roof, street.width, 8, 72);
    patch.rect(0, roof + 6, street.width, 2, 160);
    let bricks = paint::paint_bricks(
        &mut street.shared(0),
        street.width,
        street.ground_y() - street.facade_y(),
    );
    let from = (street.facade_y() * street.width) as usize;
    patch.value[from..][..bricks.value.len()].copy_from_slice(&bricks.value);
    patch.cover[from..][..bricks.value.len()].fill(255);
    let (pavement, road) = (street.ground_y(), street.ground_y() + 34);
    patch.rect(0, pavement, street.width, 34, 146);
    for x in (0..street.width).step_by(26) {
        patch.line((x, pavement), (x - 12, road), 0, 128);
    }
    patch.rect(0, pavement + 15, street.width, 1, 130);
    patch.rect(0, road - 4, street.width, 4, 182);
    patch.rect(0, road, street.width, street.height - road, 88);
    for x in (10..street.width).step_by(64) {
        patch.rect(x, road + 16, 30, 3, 190);
    }
    patch
}
