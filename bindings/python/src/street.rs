//! What does the rendered street look like, for examples and tests without data?

use chronotope::dataset::synthetic::{Schedule, World, WorldConfig};
use chronotope::map::PlaceKey;
use chronotope::{Error, ErrorKind};
use pyo3::prelude::*;

use crate::failure::{Result, detached};
use crate::hints::{Moment, Picture, TimeLike};
use crate::python::{moment, picture, time_of};

/// A street that is drawn: places with lamps, shutters, blossom, cars and shadows that follow year,
/// week and day, the same on every machine.
///
/// ``rhythms=False`` makes the control, in which nothing depends on time. ``image_size`` is width and
/// height, 256 x 240 to 1280 x 1024 px.
///
/// Errors: ``ConfigError`` for sizes and numbers of places out of range.
#[pyclass(frozen, module = "chronotope", name = "Street")]
pub(crate) struct PyStreet {
    world: World,
    seed: u64,
}

#[pymethods]
impl PyStreet {
    #[new]
    #[pyo3(signature = (seed=1, *, num_places=4, rhythms=true, image_size=(448, 384)))]
    fn new(
        seed: u64,
        num_places: usize,
        rhythms: bool,
        image_size: (usize, usize),
    ) -> Result<Self> {
        let (width, height) = image_size;
        let cfg = WorldConfig::new(seed)
            .with_num_places(num_places)
            .with_rhythms(rhythms)
            .with_image_size(width, height);
        Ok(Self {
            world: World::new(&cfg)?,
            seed,
        })
    }

    /// The names of the places, in order along the street.
    #[getter]
    fn places(&self) -> Vec<&str> {
        self.world.places().iter().map(PlaceKey::as_str).collect()
    }

    /// The image of one visit, uint8 (height, width); another ``visit`` is another one at that time.
    ///
    /// Errors: ``NotFoundError``, ``TimeError``.
    #[pyo3(signature = (place, time, *, visit=0))]
    fn render<'py>(
        &self,
        py: Python<'py>,
        place: &str,
        time: TimeLike<'py>,
        visit: u64,
    ) -> Result<Picture<'py>> {
        let time = time_of(&time.0)?;
        let at = self
            .world
            .places()
            .iter()
            .position(|key| key.as_str() == place);
        let at = at.ok_or_else(|| {
            Error::new(
                ErrorKind::NotFound,
                format!("the street has no place `{place}`"),
            )
            .with_help(format!("it has {}", self.places().join(", ")))
        })?;
        let image = detached(py, || Ok(self.world.render(at, time, visit)))?;
        Ok(Picture(picture(py, &image)?))
    }

    /// When somebody walks along the street: rounds in 2023 to learn from, and in 2024 to localise.
    #[pyo3(signature = (num_learn=12, num_query=6))]
    fn schedule<'py>(
        &self,
        py: Python<'py>,
        num_learn: usize,
        num_query: usize,
    ) -> Result<(Vec<Moment<'py>>, Vec<Moment<'py>>)> {
        let schedule = Schedule::standard(self.seed, num_learn, num_query);
        let moments = |times: &[chronotope::Time]| {
            times
                .iter()
                .map(|&time| moment(py, time))
                .collect::<Result<Vec<_>>>()
        };
        Ok((moments(&schedule.learn)?, moments(&schedule.query)?))
    }

    fn __repr__(&self) -> String {
        format!(
            "<Street {}: {} places>",
            self.seed,
            self.world.places().len()
        )
    }
}
