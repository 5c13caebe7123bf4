//! What does a thing look like?
//!
//! A [`Patch`] is a small picture with a coverage per pixel; the `paint_*` functions draw one thing
//! each into a patch, from a random sequence that decides all its details. They are drawn once when
//! the world is made; rendering only copies them.

use super::random::Rng;

/// Grey values with coverage (0 clear, 255 opaque), row by row.
#[derive(Clone, Debug)]
pub(super) struct Patch {
    pub(super) width: i32,
    pub(super) height: i32,
    pub(super) value: Vec<u8>,
    pub(super) cover: Vec<u8>,
}

impl Patch {
    pub(super) fn new(width: i32, height: i32) -> Self {
        let len = (width.max(0) * height.max(0)) as usize;
        Self {
            width,
            height,
            value: vec![0; len],
            cover: vec![0; len],
        }
    }

    fn set(&mut self, x: i32, y: i32, value: i32) {
        if x >= 0 && y >= 0 && x < self.width && y < self.height {
            let at = (y * self.width + x) as usize;
            self.value[at] = value.clamp(0, 255) as u8;
            self.cover[at] = 255;
        }
    }

    /// An opaque rectangle.
    pub(super) fn rect(&mut self, x: i32, y: i32, width: i32, height: i32, value: i32) {
        for row in y.max(0)..(y + height).min(self.height) {
            for column in x.max(0)..(x + width).min(self.width) {
                self.set(column, row, value);
            }
        }
    }

    /// An opaque ellipse with these half axes.
    pub(super) fn ellipse(&mut self, x: i32, y: i32, a: i32, b: i32, value: i32) {
        let (a, b) = (a.max(1), b.max(1));
        for dy in -b..=b {
            for dx in -a..=a {
                if dx * dx * b * b + dy * dy * a * a <= a * a * b * b {
                    self.set(x + dx, y + dy, value);
                }
            }
        }
    }

    /// A round brush drawn from one point to the other.
    pub(super) fn line(&mut self, from: (i32, i32), to: (i32, i32), radius: i32, value: i32) {
        let steps = (to.0 - from.0).abs().max((to.1 - from.1).abs()).max(1);
        for step in 0..=steps {
            let x = from.0 + (to.0 - from.0) * step / steps;
            let y = from.1 + (to.1 - from.1) * step / steps;
            if radius == 0 {
                self.set(x, y, value);
            } else {
                self.ellipse(x, y, radius, radius, value);
            }
        }
    }

    /// The outline of a rectangle.
    fn frame(&mut self, x: i32, y: i32, width: i32, height: i32, thickness: i32, value: i32) {
        self.rect(x, y, width, thickness, value);
        self.rect(x, y + height - thickness, width, thickness, value);
        self.rect(x, y, thickness, height, value);
        self.rect(x + width - thickness, y, thickness, height, value);
    }

    /// Softens values and coverage by (1 2 1)/4 in both directions, so that sampling between the
    /// pixels does not alias.
    fn soften(mut self) -> Self {
        let (width, height) = (self.width as usize, self.height as usize);
        // Values under the clear part take part with the value of their opaque neighbours.
        let weight: Vec<u32> = self.cover.iter().map(|&cover| u32::from(cover)).collect();
        let product: Vec<u32> = self
            .value
            .iter()
            .zip(&weight)
            .map(|(&value, &weight)| u32::from(value) * weight)
            .collect();
        let blur = |source: &[u32], x: usize, y: usize| -> u32 {
            let mut sum = 0;
            for (ky, wy) in [(y.wrapping_sub(1), 1), (y, 2), (y + 1, 1)] {
                for (kx, wx) in [(x.wrapping_sub(1), 1), (x, 2), (x + 1, 1)] {
                    // Beyond the border there is nothing.
                    if kx < width && ky < height {
                        sum += source[ky * width + kx] * wy * wx;
                    }
                }
            }
            sum
        };
        for y in 0..height {
            for x in 0..width {
                let at = y * width + x;
                let cover = blur(&weight, x, y);
                if let Some(value) = (blur(&product, x, y) + cover / 2).checked_div(cover) {
                    self.value[at] = value as u8;
                }
                self.cover[at] = (cover / 16) as u8;
            }
        }
        self
    }
}

/// Brick grey, about the mean of every facade.
pub(super) const BRICK: i32 = 118;

/// A wall of bricks 12 x 6 px in running bond.
pub(super) fn paint_bricks(rng: &mut Rng, width: i32, height: i32) -> Patch {
    let mut patch = Patch::new(width, height);
    patch.rect(0, 0, width, height, BRICK + 12);
    for row in 0..=height / 6 {
        for column in -1..=width / 12 {
            let x = column * 12 + if row % 2 == 0 { 0 } else { 6 };
            let value = BRICK + rng.int(-7, 7);
            patch.rect(x, row * 6, 11, 5, value);
        }
    }
    patch.soften()
}

/// A window frame around panes that `glaze` fills: `glaze(patch, x, y, width, height, pane)`.
fn paint_frame(
    width: i32,
    height: i32,
    frame: i32,
    mut glaze: impl FnMut(&mut Patch, i32, i32, i32, i32, i32),
) -> Patch {
    let mut patch = Patch::new(width, height);
    patch.rect(3, 2, width - 6, height - 6, frame);
    patch.rect(0, height - 6, width, 4, frame + 15);
    patch.rect(1, height - 2, width - 2, 2, 70);
    let (pane_width, pane_height) = ((width - 15) / 2, (height - 20) / 3);
    for pane in 0..6 {
        let x = 6 + (pane % 2) * (pane_width + 3);
        let y = 5 + (pane / 2) * (pane_height + 3);
        glaze(&mut patch, x, y, pane_width, pane_height, pane);
    }
    patch
}

/// A window by day: dark panes with reflections, perhaps curtains.
pub(super) fn paint_window(rng: &mut Rng, width: i32, height: i32) -> Patch {
    let frame = rng.int(175, 225);
    let curtain = rng.int(0, 3);
    paint_frame(width, height, frame, |patch, x, y, w, h, pane| {
        patch.rect(x, y, w, h, 48 + rng.int(-12, 12));
        patch.line((x + 2, y + h - 3), (x + w / 2, y + 1), 0, 95);
        patch.line((x + 5, y + h - 2), (x + w / 2 + 4, y + 1), 0, 85);
        if curtain == 1 && pane < 4 {
            patch.rect(x, y, w, h * 2 / 3, 150);
        } else if curtain == 2 {
            let side = if pane % 2 == 0 { x } else { x + w - 6 };
            patch.rect(side, y, 6, h, 165);
        } else if curtain == 3 && pane > 3 {
            patch.ellipse(x + w / 2, y + h, w / 3, h / 2, 120);
        }
    })
    .soften()
}

/// A window behind drawn blinds.
pub(super) fn paint_blinds(rng: &mut Rng, width: i32, height: i32) -> Patch {
    let frame = rng.int(175, 225);
    paint_frame(width, height, frame, |patch, x, y, w, h, _| {
        patch.rect(x, y, w, h, 168);
        for slat in (1..h).step_by(3) {
            patch.rect(x, y + slat, w, 1, 140);
        }
    })
    .soften()
}

/// A lit window: bright panes with the dark shapes of what stands behind them.
pub(super) fn paint_lit_window(rng: &mut Rng, width: i32, height: i32) -> Patch {
    let mut patch = paint_frame(width, height, 60, |patch, x, y, w, h, _| {
        patch.rect(x, y, w, h, 225 + rng.int(-20, 10));
    });
    for _ in 0..rng.int(5, 7) {
        let (x, y) = (rng.int(9, width - 10), rng.int(10, height - 14));
        let (a, b) = (rng.int(2, 6), rng.int(2, 6));
        let value = rng.int(40, 130);
        if rng.chance(0.5) {
            patch.ellipse(x, y, a, b, value);
        } else {
            patch.rect(x - a, y - b, 2 * a, 2 * b, value);
        }
    }
    patch.soften()
}

/// Closed wooden shutters: slats, with worn or painted spots.
pub(super) fn paint_shutters(rng: &mut Rng, width: i32, height: i32) -> Patch {
    let mut patch = Patch::new(width, height);
    let base = rng.int(85, 165);
    patch.rect(1, 1, width - 2, height - 5, base + 22);
    for half in 0..2 {
        let x = 3 + half * (width / 2 - 1);
        for y in (4..height - 9).step_by(5) {
            patch.rect(x, y, width / 2 - 5, 3, base - 28);
        }
    }
    for _ in 0..rng.int(5, 8) {
        let (x, y) = (rng.int(6, width - 7), rng.int(7, height - 12));
        let value = if rng.chance(0.5) { 225 } else { 30 };
        patch.ellipse(x, y, rng.int(2, 5), rng.int(2, 4), value);
    }
    patch.soften()
}

/// Leaves: clumps of light and dark, denser in the middle.
pub(super) fn paint_foliage(rng: &mut Rng, width: i32, height: i32, tone: i32) -> Patch {
    let mut patch = Patch::new(width, height);
    let (half_width, half_height) = (width / 2, height / 2);
    let clumps = width * height / 55;
    let inside = |x: i32, y: i32| {
        let (dx, dy) = (x - half_width, y - half_height);
        let (a, b) = (half_width - 4, half_height - 4);
        dx * dx * b * b + dy * dy * a * a <= a * a * b * b
    };
    patch.ellipse(
        half_width,
        half_height,
        half_width - 4,
        half_height - 4,
        tone,
    );
    for _ in 0..clumps {
        let (x, y) = (rng.int(3, width - 4), rng.int(3, height - 4));
        if inside(x, y) {
            patch.ellipse(x, y, rng.int(3, 6), rng.int(2, 5), tone + rng.int(-20, 20));
        }
    }
    for _ in 0..clumps / 4 {
        let (x, y) = (rng.int(5, width - 6), rng.int(5, height - 6));
        if inside(x, y) {
            let value = if rng.chance(0.6) { tone + 110 } else { 12 };
            patch.ellipse(x, y, rng.int(2, 5), rng.int(2, 4), value);
        }
    }
    patch.soften()
}

/// A crown without leaves, with snow, rime or nests in its forks.
pub(super) fn paint_bare_crown(rng: &mut Rng, width: i32, height: i32) -> Patch {
    let mut patch = Patch::new(width, height);
    let root = (width / 2, height - 1);
    let mut tips = Vec::new();
    for _ in 0..9 {
        let tip = (rng.int(4, width - 5), rng.int(4, height * 3 / 4));
        let knee = (
            i32::midpoint(root.0, tip.0) + rng.int(-6, 6),
            i32::midpoint(root.1, tip.1) + rng.int(-4, 8),
        );
        patch.line(root, knee, 2, 42);
        patch.line(knee, tip, 1, 48);
        for _ in 0..2 {
            let twig = (tip.0 + rng.int(-12, 12), tip.1 + rng.int(-12, 6));
            patch.line(
                (i32::midpoint(knee.0, tip.0), i32::midpoint(knee.1, tip.1)),
                twig,
                0,
                55,
            );
        }
        tips.push(knee);
        tips.push(tip);
    }
    for (x, y) in tips {
        let (dx, dy) = (rng.int(-3, 3), rng.int(-3, 1));
        patch.ellipse(
            x + dx,
            y + dy,
            rng.int(3, 6),
            rng.int(2, 4),
            rng.int(225, 250),
        );
    }
    patch.soften()
}

/// Climbing plants with blossoms on a trellis.
pub(super) fn paint_ivy(rng: &mut Rng, width: i32, height: i32) -> Patch {
    let mut patch = Patch::new(width, height);
    let tone = rng.int(60, 85);
    for _ in 0..width * height / 30 {
        let (x, y) = (rng.int(2, width - 3), rng.int(2, height - 3));
        patch.ellipse(x, y, rng.int(2, 5), rng.int(2, 4), tone + rng.int(-16, 16));
    }
    for _ in 0..rng.int(10, 13) {
        let (x, y) = (rng.int(5, width - 6), rng.int(5, height - 6));
        let value = if rng.chance(0.7) { 225 } else { 12 };
        patch.ellipse(x, y, rng.int(2, 5), rng.int(2, 5), value);
    }
    patch.soften()
}

/// The wall behind the climbing plants: a trellis with rime and withered blossoms.
pub(super) fn paint_trellis(rng: &mut Rng, width: i32, height: i32) -> Patch {
    let mut patch = Patch::new(width, height);
    for x in (4..width - 3).step_by(11) {
        patch.rect(x, 2, 2, height - 4, 66);
    }
    for y in (4..height - 3).step_by(13) {
        patch.rect(2, y, width - 4, 2, 66);
    }
    for _ in 0..rng.int(8, 12) {
        let (x, y) = (rng.int(5, width - 6), rng.int(5, height - 6));
        patch.ellipse(x, y, rng.int(2, 6), rng.int(2, 4), rng.int(215, 248));
    }
    for _ in 0..4 {
        let (x, y) = (rng.int(5, width - 6), rng.int(5, height - 6));
        patch.ellipse(x, y, rng.int(2, 4), rng.int(2, 5), 38);
    }
    patch.soften()
}

/// A sign or mural: shapes on a panel.
pub(super) fn paint_mural(rng: &mut Rng, width: i32, height: i32) -> Patch {
    let mut patch = Patch::new(width, height);
    let light = rng.chance(0.5);
    let (ground, ink) = if light { (190, 45) } else { (70, 205) };
    patch.rect(1, 2, width - 2, height - 6, ground);
    patch.frame(1, 2, width - 2, height - 6, 2, ink);
    for _ in 0..rng.int(8, 11) {
        let (x, y) = (rng.int(8, width - 9), rng.int(9, height - 13));
        let value = ink + rng.int(-30, 30);
        match rng.int(0, 2) {
            0 => patch.ellipse(x, y, rng.int(2, 6), rng.int(2, 6), value),
            1 => patch.rect(x - 4, y - 2, rng.int(5, 11), rng.int(3, 7), value),
            _ => patch.line(
                (x - 4, y),
                (x + rng.int(-5, 8), y + rng.int(-7, 7)),
                1,
                value,
            ),
        }
    }
    patch.soften()
}

/// Shelves behind glass with goods on them.
pub(super) fn paint_shop(rng: &mut Rng, width: i32, height: i32) -> Patch {
    let mut patch = Patch::new(width, height);
    patch.rect(0, 0, width, height, 190);
    patch.rect(3, 9, width - 6, height - 12, 62);
    patch.rect(0, 0, width, 8, 150);
    for x in (0..width).step_by(10) {
        patch.rect(x, 0, 5, 8, 225);
    }
    let rows = 3;
    let shelf = (height - 14) / rows;
    for row in 0..rows {
        let floor = 10 + (row + 1) * shelf;
        patch.rect(3, floor - 2, width - 6, 2, 120);
        let mut x = 5;
        while x < width - 8 {
            let (w, h) = (rng.int(4, 9), rng.int(4, shelf - 4));
            let value = if rng.chance(0.6) {
                rng.int(165, 240)
            } else {
                rng.int(15, 45)
            };
            if rng.chance(0.4) {
                patch.ellipse(x + w / 2, floor - 2 - h / 2, w / 2, h / 2, value);
            } else {
                patch.rect(x, floor - 2 - h, w, h, value);
            }
            x += w + rng.int(1, 5);
        }
    }
    patch.soften()
}

/// A roller shutter with graffiti.
pub(super) fn paint_roller_shutter(rng: &mut Rng, width: i32, height: i32) -> Patch {
    let mut patch = Patch::new(width, height);
    patch.rect(0, 0, width, height, 140);
    for y in (2..height).step_by(4) {
        patch.rect(1, y, width - 2, 1, 112);
    }
    let ink = if rng.chance(0.5) { 35 } else { 230 };
    let mut pen = (rng.int(6, 14), rng.int(12, height - 12));
    for _ in 0..rng.int(7, 9) {
        let next = (
            (pen.0 + rng.int(-6, 16)).clamp(5, width - 6),
            rng.int(8, height - 9),
        );
        patch.line(pen, next, rng.int(1, 2), ink);
        pen = if next.0 > width - 12 {
            (rng.int(6, 14), rng.int(12, height - 12))
        } else {
            next
        };
    }
    for _ in 0..rng.int(4, 6) {
        let (x, y) = (rng.int(6, width - 7), rng.int(8, height - 9));
        patch.ellipse(x, y, rng.int(2, 4), rng.int(2, 4), 265 - ink);
    }
    patch.soften()
}

/// A closed door: panels, a letter box, a notice, a wreath.
pub(super) fn paint_closed_door(rng: &mut Rng, width: i32, height: i32) -> Patch {
    let mut patch = Patch::new(width, height);
    let wood = rng.int(70, 150);
    patch.rect(2, 0, width - 4, height, 195);
    patch.rect(6, 4, width - 12, height - 4, wood);
    for panel in 0..4 {
        let x = 9 + (panel % 2) * ((width - 15) / 2);
        let y = 8 + (panel / 2) * ((height - 10) / 2);
        patch.frame(x, y, (width - 24) / 2, (height - 18) / 2, 2, wood - 35);
    }
    for _ in 0..rng.int(5, 7) {
        let (x, y) = (rng.int(11, width - 12), rng.int(10, height - 12));
        let value = if wood > 110 { 25 } else { 220 };
        if rng.chance(0.5) {
            patch.ellipse(x, y, rng.int(2, 5), rng.int(2, 5), value);
        } else {
            patch.rect(x - 3, y - 2, rng.int(4, 9), rng.int(3, 7), value);
        }
    }
    patch.soften()
}

/// An open door: a dark hall with furniture and coats.
pub(super) fn paint_open_door(rng: &mut Rng, width: i32, height: i32) -> Patch {
    let mut patch = Patch::new(width, height);
    patch.rect(2, 0, width - 4, height, 195);
    patch.rect(6, 4, width - 12, height - 4, 34);
    patch.rect(6, height - 9, width - 12, 9, 88);
    for _ in 0..rng.int(8, 11) {
        let (x, y) = (rng.int(10, width - 11), rng.int(9, height - 8));
        let value = rng.int(95, 225);
        if rng.chance(0.5) {
            patch.ellipse(x, y, rng.int(2, 5), rng.int(2, 6), value);
        } else {
            patch.rect(x - 3, y - 3, rng.int(4, 9), rng.int(4, 10), value);
        }
    }
    patch.soften()
}

/// A market stall: a striped awning over crates of fruit.
pub(super) fn paint_stall(rng: &mut Rng, width: i32, height: i32) -> Patch {
    let mut patch = Patch::new(width, height);
    let stripe = rng.int(6, 10);
    patch.rect(0, 2, width, 15, 215);
    for x in (0..width).step_by(2 * stripe as usize) {
        patch.rect(x, 2, stripe, 15, rng.int(50, 90));
    }
    patch.rect(2, 17, 3, height - 17, 60);
    patch.rect(width - 5, 17, 3, height - 17, 60);
    patch.rect(5, 22, width - 10, height - 24, 95);
    for _ in 0..rng.int(20, 26) {
        let (x, y) = (rng.int(8, width - 9), rng.int(25, height - 6));
        let value = if rng.chance(0.55) {
            rng.int(185, 240)
        } else {
            rng.int(15, 50)
        };
        let radius = rng.int(2, 4);
        patch.ellipse(x, y, radius, radius, value);
    }
    patch.soften()
}

/// A delivery van seen from the side, with a picture on it.
pub(super) fn paint_van(rng: &mut Rng, width: i32, height: i32) -> Patch {
    let mut patch = Patch::new(width, height);
    let paintwork = if rng.chance(0.5) { 205 } else { 65 };
    let ink = 270 - paintwork;
    patch.rect(1, 8, width - 2, height - 15, paintwork);
    patch.rect(4, 12, 11, 11, 35);
    patch.ellipse(11, height - 7, 6, 6, 20);
    patch.ellipse(width - 12, height - 7, 6, 6, 20);
    patch.ellipse(11, height - 7, 2, 2, 190);
    patch.ellipse(width - 12, height - 7, 2, 2, 190);
    for _ in 0..rng.int(7, 10) {
        let (x, y) = (rng.int(18, width - 6), rng.int(13, height - 18));
        if rng.chance(0.5) {
            patch.ellipse(x, y, rng.int(2, 5), rng.int(2, 5), ink);
        } else {
            patch.rect(x - 3, y - 2, rng.int(4, 9), rng.int(3, 7), ink);
        }
    }
    patch.soften()
}

/// A parasol over chairs and tables.
pub(super) fn paint_cafe(rng: &mut Rng, width: i32, height: i32) -> Patch {
    let mut patch = Patch::new(width, height);
    patch.rect(width / 2 - 1, 12, 3, height - 14, 50);
    patch.ellipse(width / 2, 13, width / 2 - 2, 9, 225);
    patch.rect(0, 15, width, 10, BRICK);
    for x in (6..width - 6).step_by(11) {
        patch.rect(x, 6, 5, 9, 80);
    }
    for _ in 0..rng.int(4, 5) {
        let (x, y) = (rng.int(6, width - 12), rng.int(28, height - 14));
        let value = if rng.chance(0.5) { 220 } else { 30 };
        patch.rect(x, y, rng.int(7, 11), 4, value);
        patch.rect(x, y, 2, 12, value);
        patch.rect(x + 6, y, 2, 12, value);
    }
    for _ in 0..rng.int(6, 8) {
        let (x, y) = (rng.int(6, width - 7), rng.int(26, height - 8));
        let radius = rng.int(2, 4);
        patch.ellipse(x, y, radius, radius, if rng.chance(0.5) { 235 } else { 22 });
    }
    patch.soften()
}

/// Firewood: the ends of stacked logs, with snow or moss here and there.
pub(super) fn paint_firewood(rng: &mut Rng, width: i32, height: i32) -> Patch {
    let mut patch = Patch::new(width, height);
    patch.rect(2, height / 4, width - 4, height * 3 / 4, 46);
    let mut y = height - 5;
    while y > height / 4 {
        let mut x = rng.int(5, 8);
        while x < width - 5 {
            let radius = rng.int(3, 5);
            let value = rng.int(120, 215);
            patch.ellipse(x, y, radius, radius, value);
            patch.ellipse(x, y, 1, 1, value - 50);
            x += 2 * radius + 1;
        }
        y -= 9;
    }
    for _ in 0..rng.int(4, 6) {
        let (x, y) = (rng.int(6, width - 7), rng.int(height / 4, height - 6));
        let value = if rng.chance(0.6) { 240 } else { 25 };
        patch.ellipse(x, y, rng.int(3, 6), rng.int(2, 4), value);
    }
    patch.soften()
}

/// Trodden snow on the ground or on a roof, thinner towards its upper border.
pub(super) fn paint_snow(rng: &mut Rng, width: i32, height: i32) -> Patch {
    let mut patch = Patch::new(width, height);
    for x in 0..width {
        let top = rng.int(1, 3);
        patch.rect(x, top, 1, height - top, 232);
    }
    for _ in 0..width * height / 300 {
        let (x, y) = (rng.int(0, width - 1), rng.int(5, height.max(6)));
        patch.ellipse(x, y, rng.int(2, 7), 1, rng.int(185, 215));
    }
    patch.soften()
}

/// A cloud.
pub(super) fn paint_cloud(rng: &mut Rng, width: i32, height: i32) -> Patch {
    let mut patch = Patch::new(width, height);
    for _ in 0..5 {
        let (a, b) = (width / 5, height / 4);
        let (x, y) = (
            rng.int(a + 1, width - a - 2),
            rng.int(b + 1, height - b - 2),
        );
        patch.ellipse(x, y, a, b, 238);
    }
    patch.soften()
}

/// A bench, with things left on it.
pub(super) fn paint_bench(rng: &mut Rng, width: i32, height: i32) -> Patch {
    let mut patch = Patch::new(width, height);
    let seat = height * 3 / 5;
    for slat in 0..4 {
        patch.rect(3, seat - 18 + slat * 6, width - 6, 3, 62 + 8 * slat);
    }
    patch.rect(2, seat + 6, width - 4, 4, 170);
    patch.rect(5, seat - 20, 3, height - seat + 16, 40);
    patch.rect(width - 8, seat - 20, 3, height - seat + 16, 40);
    for _ in 0..rng.int(2, 4) {
        let (x, y) = (rng.int(9, width - 10), rng.int(seat - 14, height - 6));
        patch.ellipse(x, y, rng.int(2, 4), rng.int(2, 4), rng.int(180, 235));
    }
    patch.soften()
}

/// A lamp post with a lantern on top.
pub(super) fn paint_lamp_post(width: i32, height: i32) -> Patch {
    let mut patch = Patch::new(width, height);
    let middle = width / 2;
    patch.rect(middle - 1, 16, 3, height - 16, 45);
    patch.rect(middle - 4, height - 10, 9, 10, 40);
    patch.rect(middle - 6, 4, 13, 14, 40);
    patch.rect(middle - 4, 6, 9, 10, 205);
    patch.ellipse(middle, 3, 3, 3, 40);
    patch.soften()
}

/// Somebody who walks by.
pub(super) fn paint_passer_by(rng: &mut Rng, width: i32, height: i32) -> Patch {
    let mut patch = Patch::new(width, height);
    let (coat, trousers) = (rng.int(25, 210), rng.int(25, 120));
    let middle = width / 2;
    patch.ellipse(middle, 7, 5, 6, rng.int(120, 190));
    let hip = height * 11 / 20;
    patch.rect(middle - 8, 14, 17, hip - 14, coat);
    patch.ellipse(middle, 16, 9, 5, coat);
    patch.line((middle - 8, 18), (middle - 10, hip), 2, coat - 15);
    patch.line((middle + 8, 18), (middle + 10, hip), 2, coat - 15);
    let stride = rng.int(2, 6);
    patch.line(
        (middle - 3, hip),
        (middle - 3 - stride, height - 4),
        3,
        trousers,
    );
    patch.line(
        (middle + 3, hip),
        (middle + 3 + stride, height - 4),
        3,
        trousers,
    );
    if rng.chance(0.5) {
        let value = if coat > 110 { 30 } else { 220 };
        patch.rect(middle + 4, hip - 8, 8, 10, value);
    }
    patch.soften()
}
