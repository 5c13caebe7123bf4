//! What stands out in an image, as arrays?

use std::sync::Arc;

use chronotope::feature::{Descriptor, ExtractorConfig, Features, Keypoint, StarBriefConfig};
use chronotope::{Error, ErrorKind};
use numpy::{PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::failure::{Failure, Result, detached};
use crate::hints::{
    Descriptors, DescriptorsLike, MaskLike, PixelsLike, Points, PointsLike, Strengths,
};
use crate::image::{Pixels, mask_of};
use crate::python::{column, table};

/// Keypoints and their descriptors, strongest first.
///
/// Made by ``extract``, or from arrays of another program's features: ``xy`` float (n, 2) in px,
/// x to the right and y down with the centre of the first pixel at (0, 0); ``descriptors`` uint8
/// (n, 32), bit 0 of a descriptor the highest of its first byte, as OpenCV has it. Answers make sense
/// only if the map was learnt with the same extractor.
///
/// Errors: ``ShapeError`` if the arrays do not fit each other or hold NaN.
#[pyclass(frozen, module = "chronotope", name = "Features")]
pub(crate) struct PyFeatures {
    pub(crate) features: Arc<Features>,
    /// Width and height of the image, where known, px.
    pub(crate) image_size: Option<(u32, u32)>,
}

impl PyFeatures {
    pub(crate) fn of(features: Arc<Features>, image_size: Option<(u32, u32)>) -> Self {
        Self {
            features,
            image_size,
        }
    }
}

#[pymethods]
impl PyFeatures {
    #[new]
    #[pyo3(signature = (xy, descriptors, *, size=None, response=None, image_size=None))]
    fn new(
        py: Python<'_>,
        xy: PointsLike<'_>,
        descriptors: DescriptorsLike<'_>,
        size: Option<PointsLike<'_>>,
        response: Option<PointsLike<'_>>,
        image_size: Option<(u32, u32)>,
    ) -> Result<Self> {
        let points = floats(&xy.0, "xy")?;
        let (shape, points) = (points.shape().to_vec(), to_vec(&points));
        if shape.len() != 2 || shape[1] != 2 {
            return Err(misshapen("xy", "(n, 2)", &shape));
        }
        let num = shape[0];
        let numpy = py.import("numpy")?;
        let bytes = numpy.call_method1("ascontiguousarray", (&descriptors.0,))?;
        let Ok(bytes) = bytes.extract::<PyReadonlyArrayDyn<'_, u8>>() else {
            return Err(Error::new(ErrorKind::Shape, "descriptors are uint8")
                .with_help("give the 256 bits as 32 bytes: numpy.packbits(bits, axis=1)")
                .into());
        };
        if bytes.shape() != [num, 32] {
            return Err(misshapen(
                "descriptors",
                &format!("({num}, 32)"),
                bytes.shape(),
            ));
        }
        let optional = |values: Option<PointsLike<'_>>, name: &str, other: f32| {
            let Some(values) = values else {
                return Ok(vec![other; num]);
            };
            let values = floats(&values.0, name)?;
            if values.shape() == [num] {
                return Ok(to_vec(&values));
            }
            Err(misshapen(name, &format!("({num},)"), values.shape()))
        };
        let sizes = optional(size, "size", 0.0)?;
        let responses = optional(response, "response", 0.0)?;
        let bytes = bytes.as_slice().map_err(|cause| {
            Error::new(ErrorKind::Shape, cause.to_string()).with_place("descriptors")
        })?;
        let mut features = Features::new();
        for (row, (point, bytes)) in (points.as_chunks::<2>().0.iter())
            .zip(bytes.as_chunks::<32>().0)
            .enumerate()
        {
            let keypoint = Keypoint {
                x: point[0],
                y: point[1],
                size: sizes[row],
                response: responses[row],
            };
            features.push(keypoint, Descriptor::from_bytes(*bytes));
        }
        Ok(Self::of(Arc::new(features), image_size))
    }

    /// Positions, float32 (n, 2): x and y in px.
    #[getter]
    fn xy<'py>(&self, py: Python<'py>) -> Result<Points<'py>> {
        Ok(Points(xy_of(py, self.features.keypoints())?))
    }

    /// Diameters of the neighbourhoods, float32 (n,), px.
    #[getter]
    fn size<'py>(&self, py: Python<'py>) -> Result<Strengths<'py>> {
        let sizes = self.features.keypoints().iter().map(|it| it.size);
        Ok(Strengths(column(py, sizes.collect())?))
    }

    /// Strengths, float32 (n,), in the detector's unit.
    #[getter]
    fn response<'py>(&self, py: Python<'py>) -> Result<Strengths<'py>> {
        let responses = self.features.keypoints().iter().map(|it| it.response);
        Ok(Strengths(column(py, responses.collect())?))
    }

    /// Descriptors, uint8 (n, 32): 256 bits each, compared by their Hamming distance.
    #[getter]
    fn descriptors<'py>(&self, py: Python<'py>) -> Result<Descriptors<'py>> {
        let bytes = self
            .features
            .descriptors()
            .iter()
            .flat_map(|it| it.to_bytes());
        Ok(Descriptors(table(py, bytes.collect(), 32)?))
    }

    /// Width and height of the image in px, where known.
    #[getter]
    fn image_size(&self) -> Option<(u32, u32)> {
        self.image_size
    }

    fn __len__(&self) -> usize {
        self.features.len()
    }

    fn __repr__(&self) -> String {
        match self.image_size {
            Some((width, height)) => {
                format!(
                    "Features({} of an image of {width} x {height} px)",
                    self.features.len()
                )
            }
            None => format!("Features({})", self.features.len()),
        }
    }

    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        (other.cast::<Self>()).is_ok_and(|other| *other.get().features == *self.features)
    }

    fn __hash__(&self) -> isize {
        self.features.len().cast_signed()
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> Result<Bound<'py, PyAny>> {
        let py = slf.py();
        let this = slf.get();
        let mut bytes = Vec::new();
        for keypoint in this.features.keypoints() {
            for value in [keypoint.x, keypoint.y, keypoint.size, keypoint.response] {
                bytes.extend(value.to_le_bytes());
            }
        }
        let descriptors: Vec<u8> = (this.features.descriptors().iter())
            .flat_map(|it| it.to_bytes())
            .collect();
        let rebuild = py
            .import("chronotope._images")?
            .getattr("features_of_bytes")?;
        let parts = (
            PyBytes::new(py, &bytes),
            PyBytes::new(py, &descriptors),
            this.image_size,
        );
        Ok((rebuild, parts).into_pyobject(py)?.into_any())
    }
}

/// Positions as an array (n, 2).
pub(crate) fn xy_of<'py>(py: Python<'py>, keypoints: &[Keypoint]) -> Result<Bound<'py, PyAny>> {
    table(
        py,
        keypoints.iter().flat_map(|it| [it.x, it.y]).collect(),
        2,
    )
}

/// The features of an image.
///
/// STAR keypoints with 256 bits of BRIEF, bit for bit those of OpenCV: uint8 (height, width) in
/// grey, or (height, width, 3) in RGB, in BGR with ``bgr=True``; a PIL image, or the path of a file.
/// At most ``n`` are kept, strongest first, by default as many as maps of the preset ``"default"`` learn
/// (``Localizer.extract`` takes what its map was learnt with); those under a ``mask`` that is 0 are left
/// out.
///
/// Errors: ``ShapeError`` for other types, shapes and strides, ``FormatError`` for a file that is no
/// image, ``ConfigError`` for ``n = 0``.
///
/// Sources: M. Agrawal, K. Konolige, M. R. Blas: CenSurE, ECCV 2008; M. Calonder et al.: BRIEF, ECCV
/// 2010.
#[pyfunction]
#[pyo3(signature = (image, *, n=600, mask=None, bgr=false))]
pub(crate) fn extract(
    py: Python<'_>,
    image: PixelsLike<'_>,
    n: usize,
    mask: Option<MaskLike<'_>>,
    bgr: bool,
) -> Result<PyFeatures> {
    if n == 0 {
        return Err(Error::new(ErrorKind::Config, "cannot extract 0 features")
            .with_help("choose n from 1; 500 is the default")
            .into());
    }
    let extractor =
        ExtractorConfig::StarBrief(StarBriefConfig::default().with_num_features(n)).build()?;
    let mask = mask.map(|mask| mask_of(&mask.0)).transpose()?;
    let pixels = match image.0.extract::<std::path::PathBuf>() {
        Ok(path) => Pixels::Owned(detached(py, || {
            chronotope::feature::load_gray(&path, &chronotope::feature::LoadOptions::default())
        })?),
        Err(_) => Pixels::of(&image.0, bgr)?,
    };
    let view = pixels.view()?;
    let features = detached(py, || {
        let mut features = Features::new();
        extractor.extract_into(view, mask.as_ref(), &mut features)?;
        Ok(features)
    })?;
    Ok(PyFeatures::of(Arc::new(features), Some(view.size())))
}

/// Where the pixels that would be read begin in memory, for tests: the array's own address if
/// nothing is copied.
#[pyfunction]
#[pyo3(name = "_address_of")]
pub(crate) fn address_of(image: PixelsLike<'_>) -> Result<usize> {
    Pixels::of(&image.0, false)?.address()
}

fn floats<'py>(object: &Bound<'py, PyAny>, name: &str) -> Result<PyReadonlyArrayDyn<'py, f32>> {
    let numpy = object.py().import("numpy")?;
    let array = (numpy.call_method1("ascontiguousarray", (object, "float32")))
        .map_err(|cause| Error::new(ErrorKind::Shape, cause.to_string()).with_place(name))?;
    let array = array
        .extract::<PyReadonlyArrayDyn<'py, f32>>()
        .map_err(|cause| Error::new(ErrorKind::Shape, cause.to_string()).with_place(name))?;
    if array.as_array().iter().all(|value| value.is_finite()) {
        return Ok(array);
    }
    Err(
        Error::new(ErrorKind::Shape, "NaN or infinity is no position")
            .with_place(name)
            .with_help("leave out the features that have none")
            .into(),
    )
}

fn to_vec(array: &PyReadonlyArrayDyn<'_, f32>) -> Vec<f32> {
    array.as_array().iter().copied().collect()
}

fn misshapen(name: &str, expected: &str, shape: &[usize]) -> Failure {
    let message = format!("expected {expected}, not {shape:?}");
    Error::new(ErrorKind::Shape, message)
        .with_place(name)
        .into()
}
