//! How does the history of one 0/1 state become a model, for `chronotope.series`?
//!
//! The estimators in Python keep times and states and name a model by a dictionary; this is what
//! computes. Times are int64 microseconds since 1970, states int8: 1, 0, or -1 where missing.

use chronotope::{Error, ErrorKind, Time};
use fremen::series::Columns;
use fremen::spectrum::CandidatePeriods;
use fremen::visibility::VisibilityConfig;
use fremen::{Series, SeriesModel};
use numpy::PyReadonlyArray1;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::failure::{Result, interruptible};
use crate::hints::{Ids, Microseconds, Numbers, PathLike, Stamps, States, Ternary, Triples};
use crate::python::{column, path_of, table};

/// A model of one state, fitted.
#[pyclass(frozen, module = "chronotope", name = "SeriesModel")]
pub(crate) struct PySeriesModel {
    model: std::sync::Arc<SeriesModel>,
}

pub(crate) fn times_of_us(times: &Microseconds<'_>) -> Result<Vec<Time>> {
    let times: PyReadonlyArray1<'_, i64> = times.0.extract()?;
    Ok(times
        .as_array()
        .iter()
        .map(|&us| Time::from_us(us))
        .collect())
}

fn samples_of(times: &Microseconds<'_>, states: &States<'_>) -> Result<Vec<(Time, Option<bool>)>> {
    let times = times_of_us(times)?;
    let states: PyReadonlyArray1<'_, i8> = states.0.extract()?;
    let states = states.as_array();
    if times.len() != states.len() {
        let message = format!(
            "{} times and {} states are no series",
            times.len(),
            states.len()
        );
        return Err(Error::new(ErrorKind::Shape, message).into());
    }
    let state = |&state: &i8| match state {
        0 => Some(false),
        1 => Some(true),
        _ => None,
    };
    Ok(times.into_iter().zip(states.iter().map(state)).collect())
}

pub(crate) fn series_of(times: &Microseconds<'_>, states: &States<'_>) -> Result<Series> {
    Ok(samples_of(times, states)?.into_iter().collect())
}

fn read_json<T: serde::de::DeserializeOwned>(text: &str) -> Result<T> {
    let read = serde_json::from_str(text);
    Ok(read.map_err(|cause| Error::new(ErrorKind::Config, cause.to_string()))?)
}

#[pymethods]
impl PySeriesModel {
    /// Fits the model that ``config``, the JSON of a visibility model, names.
    #[staticmethod]
    fn fit(
        py: Python<'_>,
        times_us: Microseconds<'_>,
        states: States<'_>,
        config: &str,
    ) -> Result<Self> {
        let cfg: VisibilityConfig = read_json(config)?;
        let series = series_of(&times_us, &states)?;
        let model = interruptible(py, move || series.learn_with(&cfg))?;
        Ok(Self {
            model: model.into(),
        })
    }

    /// The model that ``encode`` wrote.
    ///
    /// Errors: ``ChecksumError``, ``FormatError``.
    #[staticmethod]
    fn decode(bytes: &[u8]) -> Result<Self> {
        let model = SeriesModel::decode(bytes)?;
        Ok(Self {
            model: model.into(),
        })
    }

    /// The model as bytes, from which ``decode`` makes one that predicts the same bits.
    fn encode<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyBytes>> {
        let bytes = self.model.encode().ok_or_else(|| {
            Error::new(ErrorKind::Format, "this kind of model has no form as bytes")
        })?;
        Ok(PyBytes::new(py, &bytes))
    }

    /// p at each time, float64 (n,).
    fn p<'py>(&self, py: Python<'py>, times_us: Microseconds<'py>) -> Result<Numbers<'py>> {
        let (times, model) = (times_of_us(&times_us)?, self.model.clone());
        let p = interruptible(py, move || {
            Ok(times
                .into_iter()
                .map(|time| model.p(time))
                .collect::<Vec<_>>())
        })?;
        Ok(Numbers(column(py, p)?))
    }

    /// p with the lower and the upper end of its 95 % interval, float64 (n, 3).
    fn estimate<'py>(&self, py: Python<'py>, times_us: Microseconds<'py>) -> Result<Triples<'py>> {
        let (times, model) = (times_of_us(&times_us)?, self.model.clone());
        let p = interruptible(py, move || {
            let estimates = times.into_iter().map(|time| model.estimate(time));
            Ok(estimates
                .flat_map(|at| [at.p, at.low, at.high])
                .collect::<Vec<_>>())
        })?;
        Ok(Triples(table(py, p, 3)?))
    }

    /// The share of samples that are 1; None for a model that does not keep it.
    #[getter]
    fn mean(&self) -> Option<f64> {
        self.model.mean()
    }

    /// What the rhythms swing about; None for a model that is not a level and rhythms.
    #[getter]
    fn level(&self) -> Option<f64> {
        self.model.level()
    }

    /// The most rhythms that the model may have.
    #[getter]
    fn order(&self) -> usize {
        self.model.order()
    }

    /// The rhythms, strongest first, float64 (k, 3): period in s, amplitude, phase in rad.
    #[getter]
    fn components<'py>(&self, py: Python<'py>) -> Result<Triples<'py>> {
        let components = self.model.components();
        let rows = components.iter();
        let rows = rows.flat_map(|it| [it.period_s, it.amplitude, it.phase_rad]);
        Ok(Triples(table(py, rows.collect(), 3)?))
    }

    /// Rows of the samples that the model gave a probability below 1 - ``confidence``, uint32.
    ///
    /// Errors: ``ConfigError`` unless ``confidence`` is in [0.5, 1].
    fn anomalies<'py>(
        &self,
        py: Python<'py>,
        times_us: Microseconds<'py>,
        states: States<'py>,
        confidence: f64,
    ) -> Result<Ids<'py>> {
        let samples = samples_of(&times_us, &states)?;
        // The engine checks the confidence.
        self.model.anomalies(&Series::new(), confidence)?;
        let model = self.model.clone();
        let rows = interruptible(py, move || {
            let mut rows = Vec::new();
            for (row, (time, state)) in samples.into_iter().enumerate() {
                let Some(state) = state else { continue };
                let one: Series = std::iter::once((time, state)).collect();
                if !model.anomalies(&one, confidence)?.is_empty() {
                    rows.push(row as u32);
                }
            }
            Ok(rows)
        })?;
        Ok(Ids(column(py, rows)?))
    }
}

/// How strong each candidate period is in the states, float64 (k, 3): period in s, amplitude, and
/// the window, which is the same of the sampling alone.
#[pyfunction]
pub(crate) fn periodogram<'py>(
    py: Python<'py>,
    times_us: Microseconds<'py>,
    states: States<'py>,
    candidates: &str,
) -> Result<Triples<'py>> {
    let candidates: CandidatePeriods = read_json(candidates)?;
    let series = series_of(&times_us, &states)?;
    let lines = interruptible(py, move || series.periodogram(&candidates))?;
    let rows = lines.lines().iter();
    let rows = rows.flat_map(|it| [it.period_s, it.amplitude, it.window]);
    Ok(Triples(table(py, rows.collect(), 3)?))
}

/// The candidate periods of the calendar (year, week, day and their fractions), as JSON.
#[pyfunction]
pub(crate) fn calendar() -> Result<String> {
    crate::python::json_line(&CandidatePeriods::calendar())
}

/// Times and states of a CSV file of rows ``time,state``, as ``chronotope spectrum`` reads it.
///
/// ``content`` are its bytes, where they are known already: of a packed file, unpacked.
///
/// Errors: ``FormatError`` and ``TimeError`` with the line, ``NotFoundError``.
#[pyfunction]
#[pyo3(signature = (path, *, content=None, time_column=None, state_column=None, time_unit=None))]
pub(crate) fn read_csv<'py>(
    py: Python<'py>,
    path: PathLike<'py>,
    content: Option<Vec<u8>>,
    time_column: Option<String>,
    state_column: Option<String>,
    time_unit: Option<&str>,
) -> Result<(Stamps<'py>, Ternary<'py>)> {
    let path = path_of(&path)?;
    let unit = time_unit.map(str::parse).transpose()?;
    let series = interruptible(py, move || {
        let columns = Columns {
            time: time_column.as_deref(),
            state: state_column.as_deref(),
            unit,
            zone: None,
        };
        match content {
            Some(bytes) => {
                Series::parse_csv(&bytes, columns).map_err(|error| error.with_path(&path))
            }
            None => Series::read_csv(&path, columns),
        }
    })?;
    let states = series
        .states()
        .iter()
        .map(|&(time, state)| (time, i8::from(state)));
    let missing = series.missing().iter().map(|&time| (time, -1));
    let mut rows: Vec<(Time, i8)> = states.chain(missing).collect();
    rows.sort_by_key(|row| row.0);
    let times = rows.iter().map(|row| row.0.as_us()).collect();
    let states = rows.iter().map(|row| row.1).collect();
    Ok((Stamps(column(py, times)?), Ternary(column(py, states)?)))
}

/// Microseconds since 1970 of texts in RFC 3339 with an offset.
///
/// Errors: ``TimeError`` with the row.
#[pyfunction]
pub(crate) fn parse_times(py: Python<'_>, texts: Vec<String>) -> Result<Stamps<'_>> {
    let parse = |(row, text): (usize, &String)| {
        let time = Time::parse(text).map_err(|error| error.with_place(format!("row {row}")))?;
        Ok(time.as_us())
    };
    let times = texts
        .iter()
        .enumerate()
        .map(parse)
        .collect::<Result<Vec<_>>>()?;
    Ok(Stamps(column(py, times)?))
}

/// Microseconds since 1970 of a text in RFC 3339 with an offset, or a number with its unit.
///
/// Errors: ``TimeError``, with what helps.
#[pyfunction]
pub(crate) fn parse_time(text: &str) -> Result<i64> {
    Ok(Time::parse(text)?.as_us())
}
