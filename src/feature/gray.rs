//! Which grey pixels does an image have, its own or a camera's?
//!
//! A [`GrayImage`] owns its pixels. A [`GrayView`] borrows them from whoever has them, in rows that
//! may be followed by padding, so that the frame in a driver's buffer is read where it lies.

use serde::{Deserialize, Serialize};

use fremen::error::{Error, ErrorKind, Result};

/// An axis-aligned rectangle in pixels; `x`, `y` is its upper-left pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Rect {
    /// Leftmost column.
    pub x: u32,
    /// Topmost row.
    pub y: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// An 8-bit grey image, row by row without padding.
#[derive(Clone, PartialEq, Eq)]
pub struct GrayImage {
    width: usize,
    height: usize,
    data: Vec<u8>,
}

impl GrayImage {
    /// Wraps `width * height` bytes; any other length is a [`ErrorKind::Shape`] error, and so are
    /// 2^32 pixels or more a side.
    pub fn new(width: usize, height: usize, data: Vec<u8>) -> Result<Self> {
        if width.checked_mul(height) == Some(data.len()) && has_sides(width, height) {
            Ok(Self {
                width,
                height,
                data,
            })
        } else {
            Err(Error::new(
                ErrorKind::Shape,
                format!(
                    "{} bytes are no grey image of {width} x {height} pixels",
                    data.len()
                ),
            ))
        }
    }

    /// Gives the image another shape of the same number of pixels.
    pub(super) fn reshape(&mut self, width: usize, height: usize, data: Vec<u8>) {
        debug_assert_eq!(width * height, data.len());
        (self.width, self.height, self.data) = (width, height, data);
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Columns and rows, as maps and queries keep them.
    pub fn size(&self) -> (u32, u32) {
        (self.width as u32, self.height as u32)
    }

    /// All pixels, row by row.
    pub fn data(&self) -> &[u8] {
        &self.data
    }

    /// All pixels, row by row, to be changed in place.
    pub fn data_mut(&mut self) -> &mut [u8] {
        &mut self.data
    }

    /// Row `y` from the top.
    ///
    /// # Panics
    /// If `y` is not below [`height`](Self::height).
    pub fn row(&self, y: usize) -> &[u8] {
        &self.data[y * self.width..][..self.width]
    }

    /// All pixels, borrowed.
    pub fn view(&self) -> GrayView<'_> {
        GrayView {
            width: self.width,
            height: self.height,
            stride: self.width,
            data: &self.data,
        }
    }

    /// [`GrayView::gray_range`] of all pixels.
    pub fn gray_range(&self, mask: Option<&Self>) -> Option<(u8, u8)> {
        self.view().gray_range(mask)
    }
}

impl std::fmt::Debug for GrayImage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "GrayImage({} x {})", self.width, self.height)
    }
}

/// What neither mask hides.
pub(crate) fn shown_by_both(
    a: Option<&GrayImage>,
    b: Option<&GrayImage>,
) -> Result<Option<GrayImage>> {
    let (Some(a), Some(b)) = (a, b) else {
        return Ok(a.or(b).cloned());
    };
    if a.size() != b.size() {
        return Err(Error::new(
            ErrorKind::Shape,
            format!(
                "a mask of {} x {} px does not fit an image of {} x {} px",
                b.width(),
                b.height(),
                a.width(),
                a.height()
            ),
        )
        .with_help("make the mask for the image after crop and scale"));
    }
    let pixels = a.data().iter().zip(b.data());
    let pixels = pixels.map(|(&a, &b)| a.min(b)).collect();
    GrayImage::new(a.width(), a.height(), pixels).map(Some)
}

/// An 8-bit grey image that somebody else owns, row by row, each perhaps with padding behind it.
///
/// ```
/// use chronotope::feature::GrayView;
///
/// // A driver's frame of 3 x 2 px whose rows begin every 4 bytes.
/// let frame = [1, 2, 3, 0, 4, 5, 6, 0];
/// let view = GrayView::new(&frame, 3, 2, 4)?;
/// assert_eq!(view.row(1), [4, 5, 6]);
/// # Ok::<(), chronotope::Error>(())
/// ```
#[derive(Clone, Copy)]
pub struct GrayView<'a> {
    width: usize,
    height: usize,
    stride: usize,
    data: &'a [u8],
}

impl<'a> GrayView<'a> {
    /// The first `width` of every `stride` bytes, `height` times; the last row needs no padding.
    ///
    /// Fewer bytes than that, a stride below the width, or 2^32 pixels or more a side are a
    /// [`ErrorKind::Shape`] error.
    pub fn new(data: &'a [u8], width: usize, height: usize, stride: usize) -> Result<Self> {
        let len = match height {
            0 => Some(0),
            _ => stride
                .checked_mul(height - 1)
                .and_then(|before| before.checked_add(width)),
        };
        if stride >= width && has_sides(width, height) && len.is_some_and(|len| len <= data.len()) {
            Ok(Self {
                width,
                height,
                stride,
                data,
            })
        } else {
            Err(Error::new(
                ErrorKind::Shape,
                format!(
                    "{} bytes with a row every {stride} are no grey image of {width} x {height} \
                     pixels",
                    data.len()
                ),
            ))
        }
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Columns and rows, as maps and queries keep them.
    pub fn size(&self) -> (u32, u32) {
        (self.width as u32, self.height as u32)
    }

    /// Row `y` from the top, without its padding.
    ///
    /// # Panics
    /// If `y` is not below [`height`](Self::height).
    pub fn row(&self, y: usize) -> &'a [u8] {
        assert!(y < self.height, "row {y} of {}", self.height);
        &self.data[y * self.stride..][..self.width]
    }

    /// A copy without padding.
    pub fn to_image(&self) -> GrayImage {
        let rows = (0..self.height).flat_map(|y| self.row(y));
        GrayImage {
            width: self.width,
            height: self.height,
            data: rows.copied().collect(),
        }
    }

    /// All pixels without padding, copied only if there is some.
    #[cfg(feature = "opencv")]
    pub(super) fn pixels(&self) -> std::borrow::Cow<'a, [u8]> {
        if self.stride == self.width || self.height < 2 {
            self.data[..self.width * self.height].into()
        } else {
            self.to_image().data.into()
        }
    }

    /// The grey levels that all but the darkest and the brightest hundredth of the pixels lie
    /// between, of those where `mask` is not zero; `None` if there are none, or the mask has
    /// another size.
    ///
    /// O(pixels). Says whether there is anything to see: a few hot pixels do not count.
    pub fn gray_range(&self, mask: Option<&GrayImage>) -> Option<(u8, u8)> {
        if mask.is_some_and(|mask| mask.size() != self.size()) {
            return None;
        }
        let mut counts = [0_usize; 256];
        for y in 0..self.height {
            match mask.map(|mask| mask.row(y)) {
                None => (self.row(y).iter()).for_each(|&level| counts[usize::from(level)] += 1),
                Some(shown) => {
                    for (&level, _) in self.row(y).iter().zip(shown).filter(|it| *it.1 != 0) {
                        counts[usize::from(level)] += 1;
                    }
                }
            }
        }
        let total: usize = counts.iter().sum();
        let level_after = |share: usize| {
            let mut sum = 0;
            counts.iter().position(|&count| {
                sum += count;
                sum > share
            })
        };
        let low = level_after(total / 100)?;
        let high = level_after(total - 1 - total / 100)?;
        Some((low as u8, high as u8))
    }
}

impl std::fmt::Debug for GrayView<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "GrayView({} x {})", self.width, self.height)
    }
}

impl<'a> From<&'a GrayImage> for GrayView<'a> {
    fn from(image: &'a GrayImage) -> Self {
        image.view()
    }
}

/// Whether [`GrayImage::size`] can say the sides.
fn has_sides(width: usize, height: usize) -> bool {
    u32::try_from(width.max(height)).is_ok()
}
