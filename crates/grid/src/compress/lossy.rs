//! How small is a grid that keeps rhythms alone?
//!
//! For each cell that was seen free and occupied its mean and a few rhythms of three bytes, for all
//! others one state. What such a grid says is p(t) without the last observation.

use fremen::{CandidatePeriods, Error, ErrorKind, Period, Result, Time};

use super::coder::{Bit, Coder, Decoder, Encoder, Lengths, code_bytes};
use crate::cells::{CellState, GridSpec, OccupancyMap};
use crate::model::{CellRecord, Errors, GridConfig, Moment, Term, TileModel, errors};
use crate::temporal::FittedGrid;
use crate::tiles::Tiling;

/// How every such file begins.
const MAGIC: &[u8] = b"CGRL1\n";
/// Steps of a mean and of a rhythm's factors.
const STEPS: f32 = 127.0;

/// A grid that keeps rhythms alone.
#[derive(Clone, Debug)]
pub struct LossyGrid {
    tiling: Tiling,
    base: Period,
    count: usize,
    order: usize,
    /// Ascending by key.
    tiles: Vec<LossyTile>,
}

#[derive(Clone, Debug)]
struct LossyTile {
    key: u32,
    /// Of each cell; of cells that vary it is not used.
    states: Vec<CellState>,
    model: Option<Box<TileModel>>,
}

impl LossyGrid {
    /// The rhythms of a grid, at most `order` of each cell, of `base / 1` to `base / count`: its
    /// own where its model has these periods.
    ///
    /// # Errors
    /// [`ErrorKind::Config`] where the model of the grid is another.
    pub fn new(fitted: &FittedGrid<'_>, base: Period, count: usize, order: usize) -> Result<Self> {
        let wanted = GridConfig::fremen(CandidatePeriods::harmonic(base, count)?, order)?;
        if fitted.config().model() != wanted.model() {
            return Err(Error::new(
                ErrorKind::Config,
                format!("the grid has not learnt {order} rhythms of {base}/1 to /{count}"),
            )
            .with_help("set that configuration first"));
        }
        let history = fitted.history();
        let mut tiles: Vec<LossyTile> = Vec::new();
        for tile in history.sorted_tiles() {
            let model = history
                .slot(tile.key())
                .and_then(|slot| fitted.tile_model(slot));
            let states = (0..64 * tile.num_words())
                .map(|at| {
                    model
                        .and_then(|it| it.constant(at))
                        .unwrap_or(tile.state(at))
                })
                .collect();
            let records = model.map(|model| {
                let mut records = model.records();
                records.iter_mut().for_each(coarsen);
                Box::new(TileModel::new(None, Vec::new(), &records))
            });
            tiles.push(LossyTile {
                key: tile.key(),
                states,
                model: records,
            });
        }
        Ok(Self {
            tiling: *history.tiling(),
            base,
            count,
            order,
            tiles,
        })
    }

    /// Where the cells are.
    pub const fn spec(&self) -> &GridSpec {
        self.tiling.spec()
    }

    /// All that is kept.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut encoder = Encoder::new();
        code_bytes(&mut encoder, &self.header());
        let mut models = Models::new();
        for tile in &self.tiles {
            let records = tile
                .model
                .as_deref()
                .map_or_else(Vec::new, TileModel::records);
            models.code(&mut encoder, self, &tile.states, &records);
        }
        let mut bytes = MAGIC.to_vec();
        bytes.extend(encoder.finish());
        bytes
    }

    /// Reads what [`Self::to_bytes`] gave.
    ///
    /// # Errors
    /// [`ErrorKind::Format`] where the bytes are something else.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        let broken = || Error::new(ErrorKind::Format, "these bytes are no lossy grid");
        let bytes = bytes.strip_prefix(MAGIC).ok_or_else(broken)?;
        let mut decoder = Decoder::new(bytes);
        let header = code_bytes(&mut decoder, &[]);
        let (mut grid, keys) = Self::parse(&header).ok_or_else(broken)?;
        let mut models = Models::new();
        for key in keys {
            let (states, records) = models.code(&mut decoder, &grid, &[], &[]);
            let inside = records
                .iter()
                .all(|it| it.terms.iter().all(|term| usize::from(term.k) < grid.count));
            if decoder.is_spent() || !inside {
                return Err(broken());
            }
            let model =
                (!records.is_empty()).then(|| Box::new(TileModel::new(None, Vec::new(), &records)));
            grid.tiles.push(LossyTile { key, states, model });
        }
        Ok(grid)
    }

    fn header(&self) -> Vec<u8> {
        let spec = self.spec();
        let [w, h, d] = spec.dims();
        let mut text = format!(
            "{} {w} {h} {d} {:?} {:?} {} {} {}",
            u8::from(spec.is_2d()),
            spec.origin_m(),
            spec.resolution_m(),
            self.base.as_us(),
            self.count,
            self.order
        )
        .replace(['[', ']', ','], " ");
        let mut last = 0;
        let steps = self.tiles.iter().map(|tile| {
            let step = tile.key - last;
            last = tile.key;
            step.to_string()
        });
        let steps: Vec<String> = steps.collect();
        text.push(' ');
        text.push_str(&steps.join(" "));
        text.into_bytes()
    }

    fn parse(header: &[u8]) -> Option<(Self, Vec<u32>)> {
        let mut words = std::str::from_utf8(header).ok()?.split_whitespace();
        let mut real = || words.next()?.parse::<f64>().ok();
        let is_2d = real()? == 1.0;
        let mut dims = [0; 3];
        for dim in &mut dims {
            *dim = real()? as u32;
        }
        let origin = [real()?, real()?, real()?];
        let resolution = real()?;
        let spec = if is_2d {
            GridSpec::new_2d([origin[0], origin[1]], resolution, [dims[0], dims[1]])
        } else {
            GridSpec::new_3d(origin, resolution, dims)
        };
        let tiling = Tiling::new(spec.ok()?);
        let base = Period::from_us(real()? as i64).ok()?;
        let (count, order) = (real()? as usize, real()? as usize);
        // The same limits as for learning.
        GridConfig::fremen(CandidatePeriods::harmonic(base, count).ok()?, order).ok()?;
        let (mut keys, mut last) = (Vec::new(), 0_u32);
        for word in words {
            last = last.checked_add(word.parse().ok()?)?;
            let ascends = keys.last().is_none_or(|&before| before < last);
            if last >= tiling.num_tiles() || !ascends {
                return None;
            }
            keys.push(last);
        }
        Some((
            Self {
                tiling,
                base,
                count,
                order,
                tiles: Vec::new(),
            },
            keys,
        ))
    }

    fn config(&self) -> Result<GridConfig> {
        let candidates = CandidatePeriods::harmonic(self.base, self.count)?;
        Ok(GridConfig::fremen(candidates, self.order)?.with_persistence(false))
    }

    /// Writes p(t) of all cells into a map of the same cells.
    ///
    /// # Errors
    /// [`ErrorKind::Shape`] where the map has other cells.
    pub fn predict_into(&self, time: Time, map: &mut OccupancyMap) -> Result<()> {
        if map.spec() != self.spec() {
            return Err(Error::new(
                ErrorKind::Shape,
                "the map has other cells than the grid",
            ));
        }
        let moment = Moment::new(&self.config()?, time);
        let spec = *self.spec();
        map.probabilities_mut().fill(f32::NAN);
        let (mut scratch, mut values) = (Vec::new(), Vec::new());
        for tile in &self.tiles {
            values.clear();
            values.extend(tile.states.iter().map(|state| match state {
                CellState::Free => 0.0,
                CellState::Occupied => 1.0,
                CellState::Unknown => f32::NAN,
            }));
            if let Some(model) = &tile.model {
                model.write(&moment, &mut scratch, &mut values);
            }
            for (at, &value) in values.iter().enumerate() {
                let cell = self.tiling.cell(tile.key, at);
                if spec.contains(cell) {
                    map.probabilities_mut()[spec.index(cell)] = value;
                }
            }
        }
        Ok(())
    }

    /// How well the kept rhythms give back every `stride`-th observation of a grid.
    ///
    /// # Errors
    /// [`ErrorKind::Shape`] where the grid has other tiles.
    pub fn errors(&self, fitted: &FittedGrid<'_>, stride: usize) -> Result<Errors> {
        let history = fitted.history();
        let mut models = vec![None; history.tiles().len()];
        for tile in &self.tiles {
            let slot = history.slot(tile.key).ok_or_else(|| {
                Error::new(
                    ErrorKind::Shape,
                    "the grid has not the tiles of the lossy one",
                )
            })?;
            models[slot].clone_from(&tile.model);
        }
        Ok(errors(history, &self.config()?, &models, stride.max(1)))
    }
}

/// Rounds a cell's numbers to what is kept of them.
fn coarsen(record: &mut CellRecord) {
    let round = |value: f32| (value * STEPS).round().clamp(-STEPS, STEPS) / STEPS;
    record.mean = round(record.mean);
    record.rate = 0.0;
    record.age_s = 0.0;
    record.is_occupied = false;
    for term in &mut record.terms {
        (term.cos, term.sin) = (round(term.cos), round(term.sin));
    }
    record
        .terms
        .retain(|term| term.cos != 0.0 || term.sin != 0.0);
}

/// What is learnt about the numbers of cells on the way.
struct Models {
    /// By the states of the two cells before.
    state: [[Bit; 4]; 16],
    mean: [Bit; 128],
    num_terms: Lengths,
    k: Lengths,
    factor: [[Bit; 256]; 2],
}

impl Models {
    const fn new() -> Self {
        Self {
            state: [[Bit::EVEN; 4]; 16],
            mean: [Bit::EVEN; 128],
            num_terms: Lengths::new(),
            k: Lengths::new(),
            factor: [[Bit::EVEN; 256]; 2],
        }
    }

    /// Codes a tile: the states of cells, 3 for one that varies, then the numbers of those.
    fn code(
        &mut self,
        coder: &mut impl Coder,
        grid: &LossyGrid,
        states: &[CellState],
        records: &[CellRecord],
    ) -> (Vec<CellState>, Vec<CellRecord>) {
        let num_cells = grid.tiling.num_cells();
        let mut given = records.iter().peekable();
        let (mut found_states, mut found) = (Vec::new(), Vec::new());
        let mut codes = vec![0_usize; num_cells];
        let row = grid.tiling.sides()[0] as usize;
        for at in 0..num_cells {
            let record = given.next_if(|it| usize::from(it.at) == at);
            let code = match (record, states.get(at)) {
                (Some(_), _) => 3,
                (None, Some(CellState::Occupied)) => 2,
                (None, Some(CellState::Free)) => 1,
                _ => 0,
            };
            let left = at.checked_sub(1).map_or(0, |it| codes[it]);
            let below = at.checked_sub(row).map_or(0, |it| codes[it]);
            let code = coder.number(code, 2, &mut self.state[4 * left + below]) as usize;
            codes[at] = code;
            found_states.push(match code {
                1 => CellState::Free,
                2 => CellState::Occupied,
                _ => CellState::Unknown,
            });
            if code == 3 {
                let nothing = CellRecord::default();
                let record = record.unwrap_or(&nothing);
                let found_record = self.record(coder, at as u16, record, grid.order);
                found.push(found_record);
            }
        }
        (found_states, found)
    }

    fn record(
        &mut self,
        coder: &mut impl Coder,
        at: u16,
        record: &CellRecord,
        order: usize,
    ) -> CellRecord {
        let mean = coder.number((record.mean * STEPS).round() as u32, 7, &mut self.mean);
        let num_terms = coder.length(record.terms.len() as u32, &mut self.num_terms);
        let mut terms = Vec::new();
        for i in 0..(num_terms as usize).min(order) {
            let term = record.terms.get(i).copied().unwrap_or_default();
            let k = coder.length(term.k.into(), &mut self.k);
            let mut factor = |which: usize, value: f32| {
                let steps = (value * STEPS).round() as i32 + 128;
                let steps = coder.number(steps as u32, 8, &mut self.factor[which]) as i32 - 128;
                steps as f32 / STEPS
            };
            let (cos, sin) = (factor(0, term.cos), factor(1, term.sin));
            terms.push(Term {
                cos,
                sin,
                k: k.min(u16::MAX.into()) as u16,
            });
        }
        CellRecord {
            at,
            mean: mean as f32 / STEPS,
            terms,
            ..CellRecord::default()
        }
    }
}
