//! When will a binary state be true, for C?

use engine::Time;
use fremen::{Series, SeriesModel};

use crate::status::{ChronotopeStatus, Failure, boxed, freed, guarded, shared, unique, written};

/// One state over time: a door that is open or not.
#[derive(Debug)]
pub struct ChronotopeSeries(Series);

/// What was learnt of a series.
#[derive(Debug)]
pub struct ChronotopeSeriesModel(SeriesModel);

/// An empty series. Any thread.
///
/// # Safety
///
/// `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_series_new(
    out: *mut *mut ChronotopeSeries,
) -> ChronotopeStatus {
    guarded(|| boxed(out, ChronotopeSeries(Series::new())))
}

/// Frees it; NULL is nothing. Not while another thread uses it.
///
/// # Safety
///
/// `series` is NULL or comes from `chronotope_series_new` and was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_series_free(series: *mut ChronotopeSeries) {
    freed(series);
}

/// Adds what was seen at a time: 1 true, 0 false, -1 nobody could see. Times come in any order. One
/// thread at a time for each series.
///
/// # Safety
///
/// `series` is NULL or was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_series_add(
    series: *mut ChronotopeSeries,
    time_us: i64,
    state: i32,
) -> ChronotopeStatus {
    guarded(|| {
        let state = match state {
            1 => Some(true),
            0 => Some(false),
            -1 => None,
            _ => return Err(Failure::Argument("a state is 1, 0 or -1")),
        };
        unique(series)?.0.push(Time::from_us(time_us), state);
        Ok(())
    })
}

/// Learns the rhythms of a series. One thread at a time for each series.
///
/// # Safety
///
/// `series` is NULL or was not freed, and `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_series_learn(
    series: *const ChronotopeSeries,
    out: *mut *mut ChronotopeSeriesModel,
) -> ChronotopeStatus {
    guarded(|| boxed(out, ChronotopeSeriesModel(shared(series)?.0.learn()?)))
}

/// Frees it; NULL is nothing. Not while another thread uses it.
///
/// # Safety
///
/// `model` is NULL or comes from `chronotope_series_learn` and was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_series_model_free(model: *mut ChronotopeSeriesModel) {
    freed(model);
}

/// The probability that the state is true at a time. Any number of threads at once.
///
/// # Safety
///
/// `model` is NULL or was not freed, and `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_series_model_p(
    model: *const ChronotopeSeriesModel,
    time_us: i64,
    out: *mut f64,
) -> ChronotopeStatus {
    guarded(|| written(out, shared(model)?.0.p(Time::from_us(time_us))))
}

/// How many rhythms were found. Any number of threads at once.
///
/// # Safety
///
/// `model` is NULL or was not freed, and `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_series_model_order(
    model: *const ChronotopeSeriesModel,
    out: *mut usize,
) -> ChronotopeStatus {
    guarded(|| written(out, shared(model)?.0.order()))
}
