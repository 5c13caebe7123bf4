//! Which pixels does an image of C have?

use engine::feature::{GrayImage, GrayView};
use engine::{Error, ErrorKind};

use crate::status::Failure;

/// How the bytes of a pixel are meant.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChronotopePixels {
    /// One byte, the brightness.
    Gray8 = 0,
    /// Blue, green, red: as OpenCV keeps them.
    Bgr8 = 1,
    /// Red, green, blue.
    Rgb8 = 2,
}

/// An image that the caller owns. Grey pixels are read where they lie; colours are copied.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct ChronotopeImage {
    /// The first pixel of the first row.
    pub data: *const u8,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Bytes from one row to the next; 0: without padding.
    pub stride: usize,
    /// What a `ChronotopePixels` says of the bytes.
    pub pixels: u32,
}

/// An image whose bytes can be read.
pub(crate) enum Pixels<'a> {
    Borrowed(GrayView<'a>),
    Owned(GrayImage),
}

impl Pixels<'_> {
    pub(crate) fn view(&self) -> GrayView<'_> {
        match self {
            Self::Borrowed(view) => *view,
            Self::Owned(image) => image.view(),
        }
    }
}

impl ChronotopeImage {
    /// Its pixels, which the caller leaves alone meanwhile.
    pub(crate) fn read(&self) -> Result<Pixels<'_>, Failure> {
        let bytes_per_pixel = match self.pixels {
            0 => 1,
            1 | 2 => 3,
            _ => {
                return Err(Failure::Argument(
                    "the kind of pixels is none that is known",
                ));
            }
        };
        if self.data.is_null() {
            return Err(Failure::Argument("the pixels are NULL"));
        }
        let too_large = || {
            let message = format!("an image cannot have {} x {} px", self.width, self.height);
            Failure::from(Error::new(ErrorKind::Shape, message))
        };
        let row = self
            .width
            .checked_mul(bytes_per_pixel)
            .ok_or_else(too_large)?;
        let stride = if self.stride == 0 { row } else { self.stride };
        if stride < row {
            let message = format!("a row of {row} bytes does not fit into a stride of {stride}");
            return Err(Error::new(ErrorKind::Shape, message).into());
        }
        if row == 0 || self.height == 0 {
            return Err(Error::new(ErrorKind::Shape, "the image has no pixels").into());
        }
        let len = stride
            .checked_mul(self.height - 1)
            .and_then(|before| before.checked_add(row))
            .filter(|&len| isize::try_from(len).is_ok())
            .ok_or_else(too_large)?;
        // SAFETY: not null, and the caller says that so many bytes can be read until the call ends.
        let bytes = unsafe { std::slice::from_raw_parts(self.data, len) };
        if bytes_per_pixel == 1 {
            let view = GrayView::new(bytes, self.width, self.height, stride)?;
            return Ok(Pixels::Borrowed(view));
        }
        let packed: Vec<u8> = bytes
            .chunks(stride)
            .flat_map(|line| &line[..row])
            .copied()
            .collect();
        let image = if self.pixels == ChronotopePixels::Bgr8 as u32 {
            GrayImage::from_bgr(self.width, self.height, &packed)
        } else {
            GrayImage::from_rgb(self.width, self.height, &packed)
        };
        Ok(Pixels::Owned(image?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(
        data: &[u8],
        width: usize,
        height: usize,
        stride: usize,
        pixels: u32,
    ) -> ChronotopeImage {
        ChronotopeImage {
            data: data.as_ptr(),
            width,
            height,
            stride,
            pixels,
        }
    }

    fn pixels(image: &ChronotopeImage) -> Option<Vec<u8>> {
        let read = image.read().ok()?;
        Some(read.view().to_image().data().to_vec())
    }

    #[test]
    fn padding_and_colours_are_read_and_impossible_images_refused() {
        let gray = [1, 2, 0, 3, 4];
        assert_eq!(pixels(&image(&gray, 2, 2, 3, 0)), Some(vec![1, 2, 3, 4]));
        let red = [0, 0, 255, 9, 0, 0, 255];
        assert_eq!(pixels(&image(&red, 1, 2, 4, 1)), Some(vec![76, 76]));
        assert_eq!(pixels(&image(&red, 1, 2, 4, 2)), Some(vec![29, 29]));
        for wrong in [
            image(&gray, 3, 1, 2, 0),
            image(&gray, 0, 2, 0, 0),
            image(&gray, usize::MAX, 2, 0, 1),
            image(&gray, 2, usize::MAX, 0, 0),
            image(&gray, 2, 2, 0, 7),
        ] {
            assert_eq!(pixels(&wrong), None, "{wrong:?}");
        }
        let null = ChronotopeImage {
            data: std::ptr::null(),
            ..image(&gray, 2, 2, 0, 0)
        };
        assert_eq!(pixels(&null), None);
    }
}
