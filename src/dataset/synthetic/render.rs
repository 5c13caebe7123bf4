//! What does the camera see at a visit?
//!
//! Background, elements, passers-by and lamp posts are copied into a canvas with a margin around
//! the reference frame; light and shadow change its grey values; the canvas is then sampled from a
//! slightly moved viewpoint and noise is added. Everything is integer arithmetic but a few numbers
//! per visit, which need only exactly rounded operations: the same bytes on every machine.

use super::paint::{self, Patch};
use super::random::{Rng, hash};
use super::rhythm::{smoothstep, wave};
use super::scene::{MARGIN, Scene, Street};
use fremen::time::{Period, Time};

/// Where the camera of a visit stands relative to the reference frame.
///
/// A point of the reference frame is seen at `(x - cx) * scale + cx + dx_px`, and likewise in y,
/// where (cx, cy) is the image's centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    /// Shift to the right, px.
    pub dx_px: f64,
    /// Shift down, px.
    pub dy_px: f64,
    /// Magnification.
    pub scale: f64,
}

/// Light of one visit.
struct Light {
    /// Grey values in the open and in the shadow.
    open: [u8; 256],
    shadow: [u8; 256],
    /// Column of the shadow's edge at the top row, and its step per row, in 1/256 px; to the left
    /// of it is shadow.
    edge_q8: i64,
    slope_q8: i64,
    /// Standard deviation of the sensor's noise in 1/16 grey values.
    noise_q4: i32,
}

impl Light {
    fn new(street: &Street, time: Time, rng: &mut Rng) -> Self {
        let sunny = rng.chance(0.5);
        let (clock, season) = if street.rhythms {
            (time.phase(Period::DAY), time.phase(Period::YEAR))
        } else {
            // The weather changes, the sun does not.
            (rng.range(0.35, 0.65), 0.25)
        };
        let height = -wave(clock) - 0.35 * wave(season);
        let daylight = smoothstep((height + 0.25) / 0.6);
        let exposure = rng.range(0.9, 1.08) * if sunny { 1.0 } else { 0.9 };
        let gain = (0.40 + 0.60 * daylight) * exposure;
        // Overcast light and night flatten the contrast a little.
        let lift = if sunny { 0.0 } else { 10.0 } * daylight;
        let table = |gain: f64| {
            let mut table = [0; 256];
            for (value, out) in table.iter_mut().enumerate() {
                *out = (value as f64 * gain + lift).clamp(0.0, 255.0) as u8;
            }
            table
        };
        let with_shadow = sunny && daylight > 0.5;
        // The shadow of the houses across the street crosses the facade during the day.
        let progress = (clock - 0.25) * 2.0;
        let edge = f64::from(street.width) * (1.3 - 1.6 * progress);
        let slope = 1.2 * (progress - 0.5);
        Self {
            open: table(gain),
            shadow: table(if with_shadow { gain * 0.64 } else { gain }),
            edge_q8: (edge * 256.0) as i64,
            slope_q8: (slope * 256.0) as i64,
            noise_q4: (16.0 * (2.0 + 2.2 * (1.0 - daylight))) as i32,
        }
    }
}

/// A grey image with a margin around the reference frame.
struct Canvas {
    width: i32,
    height: i32,
    data: Vec<u8>,
}

impl Canvas {
    /// The background, its border continued into the margin.
    fn new(background: &Patch) -> Self {
        let (width, height) = (
            background.width + 2 * MARGIN,
            background.height + 2 * MARGIN,
        );
        let margin = MARGIN as usize;
        let mut data = Vec::with_capacity((width * height) as usize);
        for y in 0..height {
            let row = (y - MARGIN).clamp(0, background.height - 1) * background.width;
            let row = &background.value[row as usize..][..background.width as usize];
            data.extend(std::iter::repeat_n(row[0], margin));
            data.extend_from_slice(row);
            data.extend(std::iter::repeat_n(row[row.len() - 1], margin));
        }
        Self {
            width,
            height,
            data,
        }
    }

    /// Copies a patch to this position of the reference frame, through this table of grey values.
    fn draw(&mut self, patch: &Patch, x: i32, y: i32, table: Option<&[u8; 256]>) {
        let (x, y) = (x + MARGIN, y + MARGIN);
        let from = (-x).clamp(0, patch.width);
        let to = (self.width - x).clamp(from, patch.width);
        for row in (-y).clamp(0, patch.height)..(self.height - y).clamp(0, patch.height) {
            let source = (row * patch.width + from) as usize..(row * patch.width + to) as usize;
            let target = ((y + row) * self.width + x + from) as usize;
            let target = &mut self.data[target..][..source.len()];
            for ((out, &value), &cover) in target
                .iter_mut()
                .zip(&patch.value[source.clone()])
                .zip(&patch.cover[source])
            {
                let value = table.map_or(value, |table| table[usize::from(value)]);
                let cover = u32::from(cover);
                let sum = u32::from(*out) * (255 - cover) + u32::from(value) * cover;
                *out = ((sum + 127) / 255) as u8;
            }
        }
    }

    /// Changes all grey values; shadows fall only below the sky.
    fn illuminate(&mut self, light: &Light, facade_y: i32) {
        for (y, row) in self.data.chunks_exact_mut(self.width as usize).enumerate() {
            let edge = (light.edge_q8 + light.slope_q8 * y as i64) >> 8;
            let edge = if (y as i32) < facade_y + MARGIN {
                0
            } else {
                edge.clamp(0, i64::from(self.width)) as usize
            };
            let (shadow, open) = row.split_at_mut(edge);
            for value in shadow {
                *value = light.shadow[usize::from(*value)];
            }
            for value in open {
                *value = light.open[usize::from(*value)];
            }
        }
    }

    /// Samples the canvas from a viewpoint, bilinearly, and adds noise.
    fn expose(
        &self,
        width: usize,
        height: usize,
        view: Viewpoint,
        noise_q4: i32,
        rng: &mut Rng,
    ) -> Vec<u8> {
        let step = (65_536.0 / view.scale) as i64;
        let start = |size: usize, shift: f64| {
            let centre = (size - 1) as f64 / 2.0;
            let first = centre + f64::from(MARGIN) - (centre + shift) / view.scale;
            (first * 65_536.0) as i64
        };
        let (x0, y0) = (start(width, view.dx_px), start(height, view.dy_px));
        let stride = self.width as usize;
        let mut columns = Vec::with_capacity(width);
        for x in 0..width {
            let at = x0 + step * x as i64;
            columns.push(((at >> 16) as u32, ((at >> 8) & 255) as u32));
        }
        let mut out = Vec::with_capacity(width * height);
        let mut bits = 0;
        for y in 0..height {
            let at = y0 + step * y as i64;
            let fraction = ((at >> 8) & 255) as u32;
            let upper = &self.data[(at >> 16) as usize * stride..][..2 * stride];
            let (upper, lower) = upper.split_at(stride);
            for (x, &(column, part)) in columns.iter().enumerate() {
                let column = column as usize;
                let mix = |row: &[u8]| {
                    u32::from(row[column]) * (256 - part) + u32::from(row[column + 1]) * part
                };
                let value = mix(upper) * (256 - fraction) + mix(lower) * fraction;
                bits = if x % 2 == 0 { rng.bits() } else { bits >> 32 };
                // Four bytes sum up to a nearly normal number of standard deviation 147.8.
                let low = (bits & 0x00ff_00ff) + ((bits >> 8) & 0x00ff_00ff);
                let sum = ((low & 0xffff) + ((low >> 16) & 0xffff)) as i32 - 510;
                let noise = sum * noise_q4 * 28;
                let value = (value as i32 + noise + 32_768) >> 16;
                out.push(value.clamp(0, 255) as u8);
            }
        }
        out
    }
}

/// Everything random about a visit but which elements it shows.
struct Visit {
    view: Viewpoint,
    rng: Rng,
}

impl Visit {
    fn new(key: u64) -> Self {
        let mut rng = Rng::new(&[key, 1]);
        let view = Viewpoint {
            dx_px: rng.range(-4.0, 4.0),
            dy_px: rng.range(-2.5, 2.5),
            scale: rng.range(0.985, 1.015),
        };
        Self { view, rng }
    }
}

/// The name of all random draws of a visit.
pub(super) fn visit_key(street: &Street, place: usize, time: Time, visit_seed: u64) -> u64 {
    hash(&[street.seed, place as u64, time.as_us() as u64, visit_seed])
}

/// The viewpoint of a visit.
pub(super) fn viewpoint(key: u64) -> Viewpoint {
    Visit::new(key).view
}

/// The image of a visit, row by row.
pub(super) fn render(street: &Street, scene: &Scene, key: u64, time: Time) -> Vec<u8> {
    let Visit { view, mut rng } = Visit::new(key);
    let light = Light::new(street, time, &mut rng);
    let mut canvas = Canvas::new(&scene.background);
    for _ in 0..rng.int(0, 3) {
        let cloud = paint::paint_cloud(&mut rng, 70, 22);
        let x = rng.int(-60, street.width);
        canvas.draw(&cloud, x, rng.int(-8, street.facade_y() - 44), None);
    }
    for element in scene.shown(key, time).filter(|element| !element.is_lit()) {
        canvas.draw(&element.patch, element.at.0, element.at.1, None);
    }
    canvas.illuminate(&light, street.facade_y());
    for element in scene.shown(key, time).filter(|element| element.is_lit()) {
        canvas.draw(&element.patch, element.at.0, element.at.1, None);
    }
    for (x, y, patch) in &scene.foreground {
        canvas.draw(patch, *x, *y, Some(&light.open));
    }
    let passers_by = rng.int(0, 3);
    for _ in 0..passers_by {
        let height = rng.int(78, 100);
        let patch = paint::paint_passer_by(&mut rng, 34, height);
        let x = rng.int(0, street.width - 34);
        let y = street.ground_y() + rng.int(4, 26) - height;
        canvas.draw(&patch, x, y, Some(&light.open));
    }
    canvas.expose(
        street.width as usize,
        street.height as usize,
        view,
        light.noise_q4,
        &mut rng,
    )
}
