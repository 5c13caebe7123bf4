//! How are image files read: turned, cut, scaled, in which zone, how large?

use clap::Args;

use chronotope::dataset::{ReadOptions, scale_between};
use chronotope::error::{Error, ErrorKind, Result};
use chronotope::feature::{DecodeLimits, GrayImage, LoadOptions, Rect, Rotation};
use chronotope::time::Zone;

use crate::note;

/// What is done to every image, after what its dataset says of it.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Reading images")]
pub struct ReadingArgs {
    /// Turn every image clockwise: 90, 180 or 270 degrees.
    #[arg(long, value_name = "DEGREES", value_parser = rotation)]
    rotate: Option<Rotation>,
    /// Then cut this rectangle out of it, in pixels of the turned image.
    #[arg(long, value_name = "X,Y,WIDTH,HEIGHT", value_parser = rect)]
    crop: Option<Rect>,
    /// Then scale it by this factor.
    #[arg(long, value_name = "FACTOR", value_parser = scale)]
    scale: Option<f64>,
    /// The zone of times without an offset (EXIF, index, names), such as Europe/Prague.
    #[arg(long, value_name = "ZONE")]
    pub zone: Option<Zone>,
    /// Images of more pixels than this are refused before they are decoded [default: 25000000].
    #[arg(long, value_name = "PIXELS")]
    max_pixels: Option<u64>,
}

impl ReadingArgs {
    /// What is done to an image.
    pub fn load_options(&self) -> LoadOptions {
        LoadOptions::default()
            .with_rotation(self.rotate.unwrap_or(Rotation::None))
            .with_crop(self.crop)
            .with_scale(self.scale.unwrap_or(1.0))
            .with_limits(self.limits())
    }

    /// How a dataset is read.
    pub fn read_options(&self) -> ReadOptions {
        ReadOptions {
            zone: self.zone.clone(),
            limits: self.limits(),
            ..ReadOptions::default()
        }
    }

    /// What is too big to decode.
    pub fn limits(&self) -> DecodeLimits {
        let limits = DecodeLimits::default();
        match self.max_pixels {
            Some(pixels) => limits.with_max_pixels(pixels),
            None => limits,
        }
    }
}

/// What is done to every image before it is a query.
#[derive(Clone, Debug)]
pub struct Adjust {
    options: LoadOptions,
    /// The size of the map's images.
    size: Option<(u32, u32)>,
    is_told: bool,
}

impl Adjust {
    /// What the options say, then to `size`, that of the map's images.
    pub fn new(options: LoadOptions, size: Option<(u32, u32)>) -> Self {
        Self {
            options,
            size,
            is_told: false,
        }
    }

    /// Whether an image of this size, by the head of its file, can become one of the map's size.
    ///
    /// So a picture that does not fit is not decoded, however large it is.
    pub fn check(&self, found: (u32, u32)) -> Result<()> {
        let from = self.options.size_of(found);
        match self.size {
            Some(to) if from != to && scale_between(from, to).is_none() => Err(Error::new(
                ErrorKind::Shape,
                format!(
                    "the image has {} x {} px, but the map was learnt from {} x {} px",
                    from.0, from.1, to.0, to.1
                ),
            )
            .with_help("turn, crop or scale it (--rotate, --crop, --scale) to that shape")),
            _ => Ok(()),
        }
    }

    /// Turns, cuts and scales as the options say, then to the size of the map's images, if the
    /// image has their shape; adds to the recipe what was done.
    pub fn apply(
        &mut self,
        image: GrayImage,
        mask: Option<GrayImage>,
        recipe: &mut String,
    ) -> Result<(GrayImage, Option<GrayImage>)> {
        let (image, mask) = step(&self.options, image, mask, recipe)?;
        let (from, Some(to)) = (image.size(), self.size) else {
            return Ok((image, mask));
        };
        match scale_between(from, to) {
            Some(scale) if from != to => {
                if !self.is_told {
                    self.is_told = true;
                    note!(
                        "note: images of {} x {} px are scaled to {} x {} px, as the map's are",
                        from.0,
                        from.1,
                        to.0,
                        to.1
                    );
                }
                step(
                    &LoadOptions::default().with_scale(scale),
                    image,
                    mask,
                    recipe,
                )
            }
            _ => Ok((image, mask)),
        }
    }
}

impl Adjust {
    /// Where a point of the changed image was in the image of `found` columns and rows, px.
    pub fn point_before(&self, point: [f64; 2], found: (u32, u32)) -> [f64; 2] {
        let between = self.options.size_of(found);
        let scale = self.size.and_then(|size| scale_between(between, size));
        let last = LoadOptions::default().with_scale(scale.unwrap_or(1.0));
        (self.options).point_before(last.point_before(point, between), found)
    }
}

fn step(
    options: &LoadOptions,
    image: GrayImage,
    mask: Option<GrayImage>,
    recipe: &mut String,
) -> Result<(GrayImage, Option<GrayImage>)> {
    if options.changes_nothing() {
        return Ok((image, mask));
    }
    if !recipe.is_empty() {
        recipe.push_str(", then ");
    }
    recipe.push_str(&options.to_string());
    let mask = mask.map(|mask| options.apply_to_mask(mask)).transpose()?;
    Ok((options.apply(image)?, mask))
}

fn rotation(text: &str) -> Result<Rotation> {
    match text {
        "0" => Ok(Rotation::None),
        "90" => Ok(Rotation::Clockwise90),
        "180" => Ok(Rotation::Half),
        "270" => Ok(Rotation::Clockwise270),
        _ => Err(bad(
            format!("an image cannot be turned by `{text}` degrees"),
            "by 90, 180 or 270",
        )),
    }
}

fn rect(text: &str) -> Result<Rect> {
    let parts: Option<Vec<u32>> = text
        .split(',')
        .map(|part| part.trim().parse().ok())
        .collect();
    match parts.as_deref() {
        Some(&[x, y, width, height]) if width > 0 && height > 0 => Ok(Rect {
            x,
            y,
            width,
            height,
        }),
        _ => Err(bad(
            format!("`{text}` is no rectangle"),
            "write X,Y,WIDTH,HEIGHT in pixels",
        )),
    }
}

fn scale(text: &str) -> Result<f64> {
    match text.parse::<f64>() {
        Ok(scale) if scale.is_finite() && scale > 0.0 => Ok(scale),
        _ => Err(bad(
            format!("`{text}` is no factor"),
            "write a positive number, such as 0.5",
        )),
    }
}

fn bad(message: String, help: &str) -> Error {
    Error::new(ErrorKind::Config, message).with_help(help)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_done_to_an_image_is_refused() {
        assert!(rect("0,0,64,48").is_ok() && rect("0,0,64").is_err() && rect("0,0,0,4").is_err());
        assert!(scale("0.5").is_ok() && scale("-1").is_err() && scale("nan").is_err());
        assert!(rotation("90").is_ok() && rotation("45").is_err());
    }
}
