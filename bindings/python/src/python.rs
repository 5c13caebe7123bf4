//! How do numbers, times, texts and arrays pass between Rust and Python?
//!
//! Times are read by `chronotope._times`, which knows datetime, numpy, pandas and polars; JSON is
//! read and written by Python's own `json`, so that dictionaries are what Python people expect.

use std::path::PathBuf;

use chronotope::{Error, ErrorKind, Time};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyDict;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::failure::Result;
use crate::hints::{ConfigLike, Json, MaybeMoment, Moment, PathLike, TimeLike};

fn function<'py>(
    py: Python<'py>,
    cell: &'static PyOnceLock<Py<PyAny>>,
    module: &str,
    name: &str,
) -> PyResult<Bound<'py, PyAny>> {
    let found = cell.get_or_try_init(py, || py.import(module)?.getattr(name).map(Bound::unbind))?;
    Ok(found.bind(py).clone())
}

/// The moment that an object of Python means.
pub(crate) fn time_of(object: &Bound<'_, PyAny>) -> Result<Time> {
    static READ: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let read = function(object.py(), &READ, "chronotope._times", "us")?;
    let us: i64 = read.call1((object,))?.extract()?;
    Ok(Time::from_us(us))
}

/// The moments of an array, a list or a column.
pub(crate) fn times_of(object: &Bound<'_, PyAny>) -> Result<Vec<Time>> {
    static READ: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let read = function(object.py(), &READ, "chronotope._times", "us_array")?;
    let times: numpy::PyReadonlyArray1<'_, i64> = read.call1((object,))?.extract()?;
    Ok(times
        .as_array()
        .iter()
        .copied()
        .map(Time::from_us)
        .collect())
}

/// The same of what may be left out.
pub(crate) fn time_if_given(object: Option<TimeLike<'_>>) -> Result<Option<Time>> {
    object.map(|object| time_of(&object.0)).transpose()
}

/// A moment as an aware `datetime`.
pub(crate) fn moment(py: Python<'_>, time: Time) -> Result<Moment<'_>> {
    static WRITE: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let write = function(py, &WRITE, "chronotope._times", "moment")?;
    Ok(Moment(write.call1((time.as_us(),))?))
}

pub(crate) fn maybe_moment(py: Python<'_>, time: Option<Time>) -> Result<MaybeMoment<'_>> {
    Ok(MaybeMoment(match time {
        Some(time) => moment(py, time)?.0,
        None => py.None().into_bound(py),
    }))
}

/// A path: text, or anything that `os.fspath` takes.
pub(crate) fn path_of(object: &PathLike<'_>) -> Result<PathBuf> {
    Ok(object.0.extract::<PathBuf>()?)
}

/// What `json.loads` makes of a text.
pub(crate) fn loads<'py>(py: Python<'py>, text: &str) -> Result<Json<'py>> {
    static LOADS: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let loads = function(py, &LOADS, "json", "loads")?;
    Ok(Json(loads.call1((text,))?))
}

/// A value as one line of JSON.
pub(crate) fn json_line(value: &impl Serialize) -> Result<String> {
    let text = serde_json::to_string(value)
        .map_err(|cause| Error::new(ErrorKind::Config, cause.to_string()))?;
    Ok(text)
}

/// A configuration: that of a preset, with the keys of a dictionary in place of its own.
pub(crate) fn overlaid<T: Serialize + DeserializeOwned>(
    base: T,
    keys: Option<&ConfigLike<'_>>,
    name: &str,
) -> Result<T> {
    static DUMPS: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let Some(keys) = keys else {
        return Ok(base);
    };
    let dumps = function(keys.0.py(), &DUMPS, "json", "dumps")?;
    let strictly = PyDict::new(keys.0.py());
    strictly.set_item("allow_nan", false)?;
    let text = dumps.call((&keys.0,), Some(&strictly)).map_err(|cause| {
        let message = cause.value(keys.0.py()).to_string();
        Error::new(ErrorKind::Config, message).with_place(name)
    })?;
    let text: String = text.extract()?;
    let error = |cause: serde_json::Error| {
        let message = cause.to_string();
        // What the engine refuses says what helps already.
        let is_helped = message.contains("(help: ");
        let error = Error::new(ErrorKind::Config, message).with_place(name);
        if is_helped {
            error
        } else {
            error.with_help("the attribute `config` shows every key with its value")
        }
    };
    let given: serde_json::Value = serde_json::from_str(&text).map_err(error)?;
    let mut value = serde_json::to_value(&base).map_err(error)?;
    match (&mut value, given) {
        (serde_json::Value::Object(all), serde_json::Value::Object(given)) => all.extend(given),
        (_, given) => {
            let message = format!("a configuration is a dictionary, not {given}");
            return Err(Error::new(ErrorKind::Config, message)
                .with_place(name)
                .into());
        }
    }
    Ok(serde_json::from_value(value).map_err(error)?)
}

/// An array (rows, columns), read-only: results do not change.
pub(crate) fn table<T: numpy::Element>(
    py: Python<'_>,
    values: Vec<T>,
    columns: usize,
) -> Result<Bound<'_, PyAny>> {
    let rows = values.len() / columns;
    let array = PyArray1::from_vec(py, values).reshape([rows, columns])?;
    frozen(array.into_any())
}

/// An array (rows,), read-only.
pub(crate) fn column<T: numpy::Element>(
    py: Python<'_>,
    values: Vec<T>,
) -> Result<Bound<'_, PyAny>> {
    frozen(PyArray1::from_vec(py, values).into_any())
}

/// An array of the pixels of a picture.
pub(crate) fn picture<'py>(
    py: Python<'py>,
    image: &chronotope::feature::GrayImage,
) -> Result<Bound<'py, PyAny>> {
    let array: Bound<'py, PyArray2<u8>> =
        PyArray1::from_slice(py, image.data()).reshape([image.height(), image.width()])?;
    Ok(array.into_any())
}

fn frozen(array: Bound<'_, PyAny>) -> Result<Bound<'_, PyAny>> {
    let none = false.into_py_any(array.py())?;
    array.getattr("flags")?.setattr("writeable", none)?;
    Ok(array)
}
