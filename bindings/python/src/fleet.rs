//! How do the observations of many robots become sums, on the workers of a cluster?
//!
//! What `chronotope.spark` calls on each worker, on columns as arrays: `compact` makes a few bytes of the
//! observations of a visit, `sum_visits` counts each visit once and sums, `merge_sums` adds sums. Nothing
//! here knows Spark. Codes are numbers into a list of distinct values, as Arrow's dictionaries are.

use std::collections::BTreeMap;
use std::path::PathBuf;

use chronotope::learn;
use chronotope::map::Map;
use chronotope::{Error, ErrorKind, Time};
use chronotope_fleet::{FleetLog, PlaceLog, States, model_of};
use fremen::spectrum::{CandidatePeriods, SpectralSums};
use fremen::visibility::{VisibilityModel, decode};
use numpy::{PyReadonlyArray1, PyReadonlyArrayDyn};
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::{PyBytes, PyList};

use crate::failure::{Result, detached, interruptible};
use crate::hints::{
    ByteStrings, Codes, Ids, Microseconds, Numbers, PathLike, Stamps, States as StatesLike,
};
use crate::python::{column, path_of};

/// Bytes that Python holds, and whatever thread may read.
type Blobs = Vec<PyBackedBytes>;

fn error(message: impl Into<String>, place: impl Into<String>) -> Error {
    Error::new(ErrorKind::Format, message).with_place(place)
}

/// The error with where the bytes lie that it is about, of which it may name one.
fn found_in(place: &str, cause: &Error) -> Error {
    let place = match cause.place() {
        Some(inner) => format!("{place}, {inner}"),
        None => place.to_owned(),
    };
    let error = Error::new(cause.kind(), cause.message()).with_place(place);
    match cause.help() {
        Some(help) => error.with_help(help),
        None => error.with_help("learn the models again"),
    }
}

fn codes_of(codes: &Codes<'_>, num: usize, name: &str) -> Result<Vec<usize>> {
    let codes: PyReadonlyArray1<'_, i32> = codes.0.extract()?;
    let codes = codes.as_array();
    let is_known = |&code: &i32| usize::try_from(code).is_ok_and(|it| it < num);
    if let Some(row) = codes.iter().position(|code| !is_known(code)) {
        let message = format!("{} is no number of one of {num} values", codes[row]);
        return Err(error(message, format!("column `{name}`, row {row}")).into());
    }
    Ok(codes.iter().map(|&code| code as usize).collect())
}

/// Numbers of features, which are 0 or more.
fn features_of(features: &Codes<'_>) -> Result<Vec<u32>> {
    let features: PyReadonlyArray1<'_, i32> = features.0.extract()?;
    let features = features.as_array();
    if let Some(row) = features.iter().position(|feature| *feature < 0) {
        let message = format!("{} is negative", features[row]);
        let negative = error(message, format!("column `feature`, row {row}"));
        return Err(negative.with_help("count from 0").into());
    }
    Ok(features
        .iter()
        .map(|feature| feature.cast_unsigned())
        .collect())
}

fn times_of(times: &Microseconds<'_>) -> Result<Vec<Time>> {
    let times: PyReadonlyArray1<'_, i64> = times.0.extract()?;
    let times = times.as_array();
    Ok(times.iter().map(|&us| Time::from_us(us)).collect())
}

fn identity(bytes: &[u8], row: usize) -> Result<u128> {
    let bytes: [u8; 16] = bytes.try_into().map_err(|_| {
        let message = format!("an identity has 16 bytes, not {}", bytes.len());
        error(message, format!("column `visit`, row {row}"))
            .with_help("write the 128 bits, not their digits")
    })?;
    Ok(u128::from_be_bytes(bytes))
}

fn same_length(lengths: &[usize]) -> Result<()> {
    if lengths.iter().all(|len| *len == lengths[0]) {
        return Ok(());
    }
    let message = format!("columns of {lengths:?} rows are no table");
    Err(Error::new(ErrorKind::Shape, message).into())
}

fn read_candidates(text: &str) -> Result<CandidatePeriods> {
    let read = serde_json::from_str(text);
    Ok(read.map_err(|cause| Error::new(ErrorKind::Config, cause.to_string()))?)
}

fn contradiction(it: chronotope_fleet::Contradiction) -> Error {
    let column = if it.feature.is_some() {
        "state"
    } else {
        "time"
    };
    Error::from(it).with_place(format!("column `{column}`"))
}

/// For each visit of a place: the code of the place, its identity, its time and its states as bytes.
type Compacted<'py> = (Ids<'py>, ByteStrings<'py>, Stamps<'py>, ByteStrings<'py>);

/// The observations of some rows, visit by visit.
///
/// ``places`` are names and ``visits`` identities of 16 bytes, with a code for each row; ``features`` int32,
/// ``states`` int8. Errors: ``FormatError`` with column and row, also for rows that contradict each other.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // reason: a column each.
pub(crate) fn compact<'py>(
    py: Python<'py>,
    place_codes: Codes<'py>,
    places: Vec<String>,
    visit_codes: Codes<'py>,
    visits: Blobs,
    times_us: Microseconds<'py>,
    features: Codes<'py>,
    states: StatesLike<'py>,
) -> Result<Compacted<'py>> {
    let place_codes = codes_of(&place_codes, places.len(), "place")?;
    let visit_codes = codes_of(&visit_codes, visits.len(), "visit")?;
    if let Some(empty) = places.iter().position(String::is_empty) {
        let row = place_codes.iter().position(|&code| code == empty);
        let place = format!("column `place`, row {}", row.unwrap_or_default());
        let empty = error("it is empty", place);
        return Err(empty.with_help("every place has a name").into());
    }
    let times = times_of(&times_us)?;
    let features = features_of(&features)?;
    let states: PyReadonlyArrayDyn<'_, i8> = states.0.extract()?;
    let states: Vec<bool> = states.as_array().iter().map(|&it| it == 1).collect();
    same_length(&[
        place_codes.len(),
        visit_codes.len(),
        times.len(),
        features.len(),
        states.len(),
    ])?;
    let ids = (visits.iter().enumerate())
        .map(|(code, bytes)| {
            let row = visit_codes.iter().position(|&it| it == code);
            identity(bytes, row.unwrap_or_default())
        })
        .collect::<Result<Vec<_>>>()?;
    let log = detached(py, || {
        let mut log = FleetLog::new();
        let key = |row: usize| (place_codes[row], visit_codes[row], times[row]);
        let mut start = 0;
        while start < times.len() {
            let (place, visit, time) = key(start);
            let more = (start + 1..times.len()).take_while(|&row| key(row) == (place, visit, time));
            let end = start + 1 + more.count();
            let rows = features[start..end].iter().zip(&states[start..end]);
            let rows = rows.map(|(&feature, &state)| (feature, state));
            log.add_all(&places[place], ids[visit], time, rows)
                .map_err(contradiction)?;
            start = end;
        }
        Ok(log)
    })?;
    let code_of: BTreeMap<&str, u32> = (places.iter().zip(0..))
        .map(|(name, code)| (&**name, code))
        .collect();
    let (mut codes, mut when) = (Vec::new(), Vec::new());
    let (visits, blobs) = (PyList::empty(py), PyList::empty(py));
    for place in log.places() {
        for visit in place.visits() {
            codes.push(code_of[place.key()]);
            when.push(visit.time.as_us());
            visits.append(PyBytes::new(py, &visit.id.to_be_bytes()))?;
            blobs.append(PyBytes::new(py, &visit.states.to_bytes()))?;
        }
    }
    Ok((
        Ids(column(py, codes)?),
        ByteStrings(visits.into_any()),
        Stamps(column(py, when)?),
        ByteStrings(blobs.into_any()),
    ))
}

fn place_log(place: &str, visits: &Blobs, times: &[Time], states: &Blobs) -> Result<PlaceLog> {
    same_length(&[visits.len(), times.len(), states.len()])?;
    let mut log = PlaceLog::new(place);
    for (row, ((id, &time), states)) in visits.iter().zip(times).zip(states).enumerate() {
        let states = States::from_bytes(states)
            .map_err(|error| error.with_place(format!("column `states`, row {row}")))?;
        log.add_visit(identity(id, row)?, time, &states)
            .map_err(contradiction)?;
    }
    Ok(log)
}

/// The sums of the features of one place over some visits, each counted once, however often it is there:
/// features uint32, and for each the bytes of its sums.
///
/// Errors: ``FormatError`` for visits that contradict each other, ``ShapeError`` for more observations than
/// a sum holds.
#[pyfunction]
pub(crate) fn sum_visits<'py>(
    py: Python<'py>,
    place: &str,
    visits: Blobs,
    times_us: Microseconds<'py>,
    states: Blobs,
    candidates: &str,
) -> Result<(Ids<'py>, ByteStrings<'py>)> {
    let candidates = read_candidates(candidates)?;
    let log = place_log(place, &visits, &times_of(&times_us)?, &states)?;
    let sums = interruptible(py, move || log.sums(&candidates))?;
    let features = sums.iter().map(|it| it.feature).collect();
    let bytes = sums.iter().map(|it| PyBytes::new(py, &it.sums.to_bytes()));
    let bytes = ByteStrings(PyList::new(py, bytes)?.into_any());
    Ok((Ids(column(py, features)?), bytes))
}

/// What is known of each feature: uint32, observations, ones, mean, sums and model as bytes, and the rhythms as
/// lists of period in s, amplitude and phase in rad.
type Merged<'py> = (
    Ids<'py>,
    Ids<'py>,
    Ids<'py>,
    Numbers<'py>,
    ByteStrings<'py>,
    ByteStrings<'py>,
    [Vec<Vec<f64>>; 3],
);

/// The sums of equal features added, and the models of at most ``order`` rhythms.
///
/// Errors: ``ShapeError`` for more observations than a sum holds, ``ConfigError`` for sums of other periods,
/// ``FormatError`` and ``ChecksumError`` for bytes that are no sums.
#[pyfunction]
pub(crate) fn merge_sums<'py>(
    py: Python<'py>,
    place: &str,
    features: Codes<'py>,
    sums: Blobs,
    order: usize,
) -> Result<Merged<'py>> {
    let features = features_of(&features)?;
    same_length(&[features.len(), sums.len()])?;
    let merged = detached(py, || {
        let mut merged = BTreeMap::<u32, SpectralSums>::new();
        for (&feature, bytes) in features.iter().zip(&sums) {
            let place = || format!("place `{}`, feature {feature}", place.escape_debug());
            let sums =
                SpectralSums::from_bytes(bytes).map_err(|error| found_in(&place(), &error))?;
            match merged.get_mut(&feature) {
                None => drop(merged.insert(feature, sums)),
                Some(known) => known.merge(&sums).map_err(|error| {
                    error.with_place(place()).with_help(
                        "learn from a part of the history, with the same periods everywhere",
                    )
                })?,
            }
        }
        Ok(merged)
    })?;
    let (sums, models) = (PyList::empty(py), PyList::empty(py));
    let mut rhythms = [Vec::new(), Vec::new(), Vec::new()];
    for it in merged.values() {
        sums.append(PyBytes::new(py, &it.to_bytes()))?;
        models.append(PyBytes::new(py, &model_of(it, order)))?;
        let components: Vec<_> = it.rhythms(order).components().collect();
        rhythms[0].push(components.iter().map(|it| it.period_s).collect());
        rhythms[1].push(components.iter().map(|it| it.amplitude).collect());
        rhythms[2].push(components.iter().map(|it| it.phase_rad).collect());
    }
    let ids = |number: fn(&SpectralSums) -> usize| {
        let numbers = merged.values().map(|it| number(it) as u32);
        column(py, numbers.collect())
    };
    Ok((
        Ids(column(py, merged.keys().copied().collect())?),
        Ids(ids(SpectralSums::num_observed)?),
        Ids(ids(SpectralSums::num_seen)?),
        Numbers(column(
            py,
            merged.values().map(SpectralSums::mean).collect(),
        )?),
        ByteStrings(sums.into_any()),
        ByteStrings(models.into_any()),
        rhythms,
    ))
}

fn models_of(models: &Blobs) -> Result<Vec<Box<dyn VisibilityModel>>> {
    let decode = |(row, bytes): (usize, &PyBackedBytes)| {
        let place = format!("column `model`, row {row}");
        let model = decode(bytes).map_err(|error| found_in(&place, &error))?;
        if model.num_features() == 1 {
            return Ok(model);
        }
        let message = format!(
            "this is a model of {} states, not of one",
            model.num_features()
        );
        Err(error(message, place))
    };
    let models: chronotope::Result<_> = models.iter().enumerate().map(decode).collect();
    Ok(models?)
}

/// p of each model at each time, float64 (models x times,), model by model.
#[pyfunction]
pub(crate) fn predict_models<'py>(
    py: Python<'py>,
    models: Blobs,
    times_us: Microseconds<'py>,
) -> Result<Numbers<'py>> {
    let times = times_of(&times_us)?;
    let models = models_of(&models)?;
    let p = interruptible(py, move || {
        let p = models.iter().flat_map(|model| {
            let times = times.iter();
            times.map(|&time| model.predict_one(0, time))
        });
        Ok(p.collect())
    })?;
    Ok(Numbers(column(py, p)?))
}

/// How well the models of a place's features have predicted visits, each counted once: observations that there
/// is a model of, the sum of squared errors, the sum of -ln p of what was observed (p at least 1e-6), and
/// observations without a model.
///
/// Summed in order of the visits' identities, and of features within each: the same for any order of rows.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // reason: a column each.
pub(crate) fn evaluate_visits<'py>(
    py: Python<'py>,
    place: &str,
    visits: Blobs,
    times_us: Microseconds<'py>,
    states: Blobs,
    features: Codes<'py>,
    models: Blobs,
) -> Result<(u64, f64, f64, u64)> {
    let log = place_log(place, &visits, &times_of(&times_us)?, &states)?;
    let features = features_of(&features)?;
    let models = models_of(&models)?;
    same_length(&[features.len(), models.len()])?;
    interruptible(py, move || {
        let known: BTreeMap<u32, _> = features.into_iter().zip(&models).collect();
        let mut visits: Vec<_> = log.visits().iter().collect();
        visits.sort_by_key(|visit| visit.id);
        let (mut num, mut squares, mut nats, mut num_unknown) = (0, 0.0, 0.0, 0);
        for visit in visits {
            for (feature, state) in visit.states.iter() {
                let Some(model) = known.get(&feature) else {
                    num_unknown += 1;
                    continue;
                };
                let p = model.predict_one(0, visit.time);
                let of_state = if state { p } else { 1.0 - p };
                num += 1;
                squares += (1.0 - of_state) * (1.0 - of_state);
                nats -= of_state.max(1e-6).ln();
            }
        }
        Ok((num, squares, nats, num_unknown))
    })
}

/// Writes the map that these files are parts of, and gives the number of its places: parts of one map by their
/// UUID, then the union of these maps.
///
/// Errors: ``AlreadyExistsError`` if ``path`` exists, ``ConfigError`` for maps of other extractors.
#[pyfunction]
pub(crate) fn join_maps(py: Python<'_>, parts: Vec<PathBuf>, path: PathLike<'_>) -> Result<usize> {
    let path = path_of(&path)?;
    detached(py, || {
        Map::refuse_existing(&path)?;
        let parts = (parts.iter())
            .map(|part| Ok(Map::open_read_only(part)?.snapshot()))
            .collect::<chronotope::Result<Vec<_>>>()?;
        let joined = learn::join(&parts.iter().map(|it| &**it).collect::<Vec<_>>())?;
        Map::create_from(&path, &joined)?;
        Ok(joined.nodes().len())
    })
}
