//! How are predicted features drawn over an image?
//!
//! Green crosses where they were found, orange ones lying aslant where they were matched elsewhere,
//! red boxes where they are missing: the colours of the answers that go into bags, and shapes that
//! are told apart without them. Above the image stands what was decided, below it how many features
//! are which.

use chronotope::feature::GrayImage;
use chronotope_bags::{Answer, State};

use crate::lettering;
use crate::messages::{Header, Image};

/// Pixels from the middle of a mark to its ends.
const ARM_PX: i64 = 4;
/// A picture has at most so many bytes: what is larger than a socket's usual buffer (208 KiB on
/// Linux) does not come whole to those who listen with best effort.
const MAX_BYTES: usize = 200_000;

type Colour = [u8; 3];

const WHITE: Colour = [255, 255, 255];
const BLACK: Colour = [0, 0, 0];

/// What is said of a state, in which colour.
fn shown(state: State) -> (&'static str, Colour) {
    match state {
        State::Inlier => ("found", [26, 204, 51]),
        State::Outlier => ("elsewhere", [255, 153, 0]),
        State::Missing => ("missing", [255, 64, 64]),
    }
}

/// Pixels in colour.
struct Canvas {
    width: usize,
    height: usize,
    data: Vec<u8>,
}

impl Canvas {
    /// The means of squares of `step_px`, with a black line of text above and below.
    fn of(image: &GrayImage, step_px: usize) -> Self {
        let [width, height] = [image.width(), image.height()].map(|it| it.div_ceil(step_px));
        let mut canvas = Self {
            width,
            height: height + 2 * lettering::LINE_PX,
            data: vec![0; 3 * width * (height + 2 * lettering::LINE_PX)],
        };
        for y in 0..height {
            let rows = y * step_px..((y + 1) * step_px).min(image.height());
            for x in 0..width {
                let columns = x * step_px..((x + 1) * step_px).min(image.width());
                let number = rows.len() * columns.len();
                let sum: usize = (rows.clone())
                    .flat_map(|y| &image.row(y)[columns.clone()])
                    .map(|&it| usize::from(it))
                    .sum();
                let mean = ((sum + number / 2) / number) as u8;
                canvas.set(x as i64, (y + lettering::LINE_PX) as i64, [mean; 3]);
            }
        }
        canvas
    }

    /// Outside of the picture is nothing to be set.
    fn set(&mut self, x: i64, y: i64, colour: Colour) {
        let inside = |at: i64, size: usize| usize::try_from(at).ok().filter(|it| *it < size);
        if let (Some(x), Some(y)) = (inside(x, self.width), inside(y, self.height)) {
            let at = 3 * (y * self.width + x);
            self.data[at..at + 3].copy_from_slice(&colour);
        }
    }

    fn mark(&mut self, [x, y]: [i64; 2], state: State) {
        let (_, colour) = shown(state);
        for step in -ARM_PX..=ARM_PX {
            let places = match state {
                State::Inlier => vec![(x + step, y), (x, y + step)],
                State::Outlier => vec![(x + step, y + step), (x + step, y - step)],
                State::Missing => {
                    let (arm, step) = (ARM_PX / 2, step.clamp(-ARM_PX / 2, ARM_PX / 2));
                    vec![
                        (x + step, y - arm),
                        (x + step, y + arm),
                        (x - arm, y + step),
                        (x + arm, y + step),
                    ]
                }
            };
            for (x, y) in places {
                self.set(x, y, colour);
            }
        }
    }

    /// Writes a text, and gives where it ends.
    fn write(&mut self, text: &str, [x, y]: [usize; 2], colour: Colour) -> usize {
        lettering::write(text, |dx, dy| {
            self.set((x + dx) as i64, (y + dy) as i64, colour);
        });
        x + lettering::width_px(text)
    }
}

/// The image in colour with the features of an answer; smaller where it would be too large.
pub(crate) fn draw(image: &GrayImage, answer: &Answer<'_>, header: Header) -> Image {
    let bytes_of = |step: usize| {
        let height = image.height().div_ceil(step) + 2 * lettering::LINE_PX;
        3 * image.width().div_ceil(step) * height
    };
    let mut step_px = 1;
    while bytes_of(step_px) > MAX_BYTES {
        step_px += 1;
    }
    let mut canvas = Canvas::of(image, step_px);
    // What was found is drawn last, as it says most.
    let states = [State::Missing, State::Outlier, State::Inlier];
    let mut counts = [0_usize; 3];
    for (state, count) in states.into_iter().zip(&mut counts) {
        for ([x, y], _) in answer.predicted().filter(|it| it.1 == state) {
            // The middle of a pixel is where its number says.
            let [x, y] = [x, y].map(|it| ((it + 0.5) / step_px as f64 - 0.5).round() as i64);
            if (0..(canvas.height - 2 * lettering::LINE_PX) as i64).contains(&y) {
                canvas.mark([x, y + lettering::LINE_PX as i64], state);
            }
            *count += 1;
        }
    }
    let below = canvas.height - lettering::LINE_PX;
    for y in (0..lettering::LINE_PX).chain(below..canvas.height) {
        for x in 0..canvas.width {
            canvas.set(x as i64, y as i64, BLACK);
        }
    }
    canvas.write(&answer.headline(), [2, 2], WHITE);
    let mut x = 2;
    for (state, count) in states.into_iter().zip(counts).rev() {
        let (word, colour) = shown(state);
        x = canvas.write(&format!("{count} {word} "), [x, below + 2], colour);
    }
    Image {
        header,
        height: canvas.height as u32,
        width: canvas.width as u32,
        encoding: "rgb8".to_owned(),
        is_bigendian: 0,
        step: 3 * canvas.width as u32,
        data: canvas.data,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pixel(canvas: &Canvas, x: usize, y: usize) -> &[u8] {
        let at = 3 * (y * canvas.width + x);
        &canvas.data[at..at + 3]
    }

    #[test]
    fn a_picture_is_made_smaller_by_means_also_at_its_edges() {
        let gray = GrayImage::new(3, 3, vec![10, 20, 70, 30, 40, 90, 0, 50, 5]).expect("9 pixels");
        let canvas = Canvas::of(&gray, 2);
        assert_eq!(
            (canvas.width, canvas.height),
            (2, 2 + 2 * lettering::LINE_PX)
        );
        let top = lettering::LINE_PX;
        assert_eq!(pixel(&canvas, 0, top), [25; 3]);
        assert_eq!(pixel(&canvas, 1, top), [80; 3]);
        assert_eq!(pixel(&canvas, 0, top + 1), [25; 3]);
        assert_eq!(pixel(&canvas, 1, top + 1), [5; 3]);
        assert_eq!(pixel(&canvas, 0, 0), BLACK);
    }

    #[test]
    fn marks_differ_in_shape_and_colour_and_end_at_the_edge() {
        let gray = GrayImage::new(30, 30, vec![128; 900]).expect("900 pixels");
        let mut shapes = Vec::new();
        for state in [State::Inlier, State::Outlier, State::Missing] {
            let mut canvas = Canvas::of(&gray, 1);
            let middle = [15, 15 + lettering::LINE_PX];
            canvas.mark(middle.map(|it| it as i64), state);
            canvas.mark([0, 0], state);
            canvas.mark([29, 51], state);
            let is_set = |x: usize, y: usize| pixel(&canvas, x, y) == shown(state).1;
            let [x, y] = middle;
            shapes.push([is_set(x + 3, y), is_set(x + 3, y + 3), is_set(x + 2, y + 1)]);
        }
        let [upright, aslant, boxed] = [
            [true, false, false],
            [false, true, false],
            [false, false, true],
        ];
        assert_eq!(shapes, [upright, aslant, boxed]);
    }
}
