//! Which pixels does an image of Python have?
//!
//! A contiguous `uint8` array (height, width) is read where it lies. Colours (height, width, 3) are
//! RGB unless the caller says BGR; they become grey as the colours of files do. Everything else is
//! refused with what helps.

use chronotope::feature::{GrayImage, GrayView, LoadOptions};
use chronotope::{Error, ErrorKind};
use numpy::{
    PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

use crate::failure::Result;

/// The pixels of one image.
pub(crate) enum Pixels<'py> {
    /// Of an array that nobody copies.
    Borrowed(PyReadonlyArrayDyn<'py, u8>),
    Owned(GrayImage),
}

fn shape_error(message: String, help: &str) -> Error {
    Error::new(ErrorKind::Shape, message).with_help(help)
}

impl<'py> Pixels<'py> {
    /// Of an array, a PIL image, or what numpy makes an array of.
    pub(crate) fn of(object: &Bound<'py, PyAny>, is_bgr: bool) -> Result<Self> {
        let array = match object.cast::<PyUntypedArray>() {
            Ok(array) => array.clone(),
            Err(_) => as_array(object)?,
        };
        let shape = array.shape().to_vec();
        let Ok(bytes) = array.cast::<PyArrayDyn<u8>>() else {
            return Err(wrong_type(&array).into());
        };
        let size = shape_text(&shape);
        if shape.contains(&0) {
            return Err(shape_error(
                format!("an image of {size} has no pixels"),
                "was the crop outside of the image?",
            )
            .into());
        }
        match shape[..] {
            [_, _] | [_, _, 3] => {}
            [_, _, 4] => {
                return Err(shape_error(
                    format!("an image of {size} has 4 channels"),
                    "leave out transparency: numpy.ascontiguousarray(image[..., :3])",
                )
                .into());
            }
            [_, _, 1] => {
                return Err(shape_error(
                    format!("an image of {size} has a channel axis of one"),
                    "give the grey image itself: image[..., 0]",
                )
                .into());
            }
            _ => {
                return Err(shape_error(
                    format!("an array of {size} is no image"),
                    "give (height, width) for grey or (height, width, 3) for RGB; of a stack one \
                     image at a time, or all of them to localize_many",
                )
                .into());
            }
        }
        if !array.is_c_contiguous() {
            return Err(shape_error(
                format!("the pixels of this view of {size} do not lie one after another"),
                "give numpy.ascontiguousarray(image)",
            )
            .into());
        }
        let bytes = (bytes.try_readonly()).map_err(|_| {
            Error::new(ErrorKind::Conflict, "somebody is writing to this array")
                .with_help("wait for them, or give a copy")
        })?;
        if shape.len() == 2 {
            return Ok(Self::Borrowed(bytes));
        }
        let samples = contiguous(&bytes)?;
        let image = if is_bgr {
            GrayImage::from_bgr(shape[1], shape[0], samples)
        } else {
            GrayImage::from_rgb(shape[1], shape[0], samples)
        };
        Ok(Self::Owned(image?))
    }

    /// The pixels, to be read.
    pub(crate) fn view(&self) -> Result<GrayView<'_>> {
        Ok(match self {
            Self::Owned(image) => image.view(),
            Self::Borrowed(array) => {
                let (height, width) = (array.shape()[0], array.shape()[1]);
                GrayView::new(contiguous(array)?, width, height, width)?
            }
        })
    }

    /// Where the first pixel lies in memory.
    pub(crate) fn address(&self) -> Result<usize> {
        Ok(self.view()?.row(0).as_ptr() as usize)
    }
}

/// A mask: where it is 0 or false nothing of an image is used.
pub(crate) fn mask_of(object: &Bound<'_, PyAny>) -> Result<GrayImage> {
    if let Ok(path) = object.extract::<std::path::PathBuf>() {
        return Ok(chronotope::feature::load_mask(
            &path,
            &LoadOptions::default(),
        )?);
    }
    let numpy = object.py().import("numpy")?;
    let array = numpy.call_method1("asarray", (object,))?;
    let kind: String = array.getattr("dtype")?.getattr("kind")?.extract()?;
    let bytes = if kind == "b" {
        (array.call_method1("astype", ("uint8",))?).call_method1("__mul__", (255_u8,))?
    } else {
        array
    };
    let bytes = numpy.call_method1("ascontiguousarray", (bytes,))?;
    let pixels = Pixels::of(&bytes, false).map_err(|failure| failure.at("mask"))?;
    Ok(pixels.view()?.to_image())
}

/// What neither mask hides.
pub(crate) fn both(
    own: Option<GrayImage>,
    given: Option<&GrayImage>,
) -> chronotope::Result<Option<GrayImage>> {
    let (Some(own), Some(given)) = (&own, given) else {
        return Ok(own.or(given.cloned()));
    };
    if own.size() != given.size() {
        return Err(
            Error::new(ErrorKind::Shape, "the mask has another size than the image")
                .with_help("make the mask for the image after its index has cut and scaled it"),
        );
    }
    let pixels = own
        .data()
        .iter()
        .zip(given.data())
        .map(|(&a, &b)| a.min(b))
        .collect();
    GrayImage::new(own.width(), own.height(), pixels).map(Some)
}

fn contiguous<'a>(array: &'a PyReadonlyArrayDyn<'_, u8>) -> Result<&'a [u8]> {
    Ok(array.as_slice().map_err(|_| {
        shape_error(
            "the pixels do not lie one after another".into(),
            "give numpy.ascontiguousarray(image)",
        )
    })?)
}

/// What numpy makes of a PIL image, of a tensor, or of whatever else says that it is an array.
fn as_array<'py>(object: &Bound<'py, PyAny>) -> Result<Bound<'py, PyUntypedArray>> {
    let py = object.py();
    let convert = py.import("chronotope._images")?.getattr("as_array")?;
    let array = convert.call1((object,))?;
    Ok(array
        .cast_into::<PyUntypedArray>()
        .map_err(|_| PyTypeError::new_err("an image is an array, a PIL image or a path"))?)
}

fn wrong_type(array: &Bound<'_, PyUntypedArray>) -> Error {
    let dtype = array.dtype();
    let name = dtype
        .str()
        .map_or_else(|_| "?".into(), |name| name.to_string());
    let help = match name.as_str() {
        "bool" => "for a black and white picture, (image * 255).astype(numpy.uint8)",
        "uint16" => "for 16 bits, (image >> 8).astype(numpy.uint8)",
        "object" => "an array of objects holds no pixels: its rows may differ in length",
        "float16" | "float32" | "float64" => {
            "for values from 0 to 1, (numpy.nan_to_num(image) * 255).round().astype(numpy.uint8)"
        }
        _ => "give image.astype(numpy.uint8), if its values are 0 to 255",
    };
    shape_error(
        format!("pixels are uint8, and this array holds {name}"),
        help,
    )
}

fn shape_text(shape: &[usize]) -> String {
    let sides: Vec<String> = shape.iter().map(ToString::to_string).collect();
    format!("({})", sides.join(", "))
}
