//! What does a grid of Python keep, in memory or of a file?

use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use chronotope::{Error, ErrorKind};
use fremen_grid::file::Access;
use fremen_grid::lifelong::LifelongGrid;
use fremen_grid::model::{ModelChoice, ModelKind};
use fremen_grid::registration::GuardConfig;
use fremen_grid::{FittedGrid, GridConfig, GridFile, GridSpec, History, Persistence, TemporalGrid};
use pyo3::prelude::*;

use crate::failure::{Failure, Result, detached, detached_with, interruptible, of_kind};

/// A grid that threads share.
pub(crate) struct Shared {
    pub(crate) spec: GridSpec,
    /// Of a grid in a file.
    pub(crate) path: Option<PathBuf>,
    /// Nothing once it is closed.
    state: Mutex<Option<State>>,
}

/// What is kept, and how it predicts.
pub(crate) struct State {
    pub(crate) config: GridConfig,
    file: Option<GridFile>,
    grid: TemporalGrid,
    /// Has the file and the grid in place of these, since a map was judged.
    guarded: Option<Box<LifelongGrid>>,
    /// Whether the file could not be read again after a failure: it is closed then.
    is_lost: bool,
}

/// By which model a caller wishes to predict.
pub(crate) struct Wish<'a> {
    pub(crate) model: &'a str,
    pub(crate) base: &'a str,
    pub(crate) parts: Option<usize>,
    pub(crate) order: usize,
    pub(crate) persistence: f32,
    pub(crate) surprise: bool,
}

impl Wish<'_> {
    pub(crate) fn config(&self) -> Result<GridConfig> {
        let kind: ModelKind =
            (self.model.parse()).map_err(|error: Error| error.with_place("model"))?;
        let persistence = if self.persistence == 0.0 {
            Persistence::None
        } else if self.surprise {
            Persistence::Surprise
        } else {
            Persistence::State
        };
        let choice = ModelChoice {
            kind,
            base: (self.base.parse()).map_err(|error: Error| error.with_place("base"))?,
            num_parts: self.parts,
            order: self.order,
            persistence,
            share: self.persistence,
        };
        Ok(choice.config()?)
    }
}

/// Whoever calls a grid in memory what only files can do.
fn needs_file(what: &str) -> Error {
    Error::new(ErrorKind::Config, format!("a grid in memory has no {what}"))
        .with_help("keep it in a file first: grid = grid.save(\"office.grid\")")
}

impl State {
    fn in_memory(config: GridConfig, grid: TemporalGrid) -> Self {
        Self {
            config,
            file: None,
            grid,
            guarded: None,
            is_lost: false,
        }
    }

    fn of_file(config: GridConfig, file: GridFile) -> Self {
        let grid = TemporalGrid::from_history(file.history().clone(), config.clone());
        Self {
            file: Some(file),
            ..Self::in_memory(config, grid)
        }
    }

    /// What can be asked of it.
    fn fitted(&mut self) -> FittedGrid<'_> {
        match &mut self.guarded {
            Some(grid) => grid.fitted(),
            None => self.grid.fitted(),
        }
    }

    /// What was observed.
    pub(crate) fn history(&self) -> &History {
        match self.file() {
            Some(file) => file.history(),
            None => self.grid.history(),
        }
    }

    pub(crate) fn history_cloned(&self) -> History {
        self.history().clone()
    }

    /// The file to be read, where there is one.
    pub(crate) fn file(&self) -> Option<&GridFile> {
        match &self.guarded {
            Some(grid) => Some(grid.file()),
            None => self.file.as_ref(),
        }
    }

    /// Predicts by another model from now on.
    pub(crate) fn set_config(&mut self, config: GridConfig) {
        match &mut self.guarded {
            Some(grid) => grid.set_config(config.clone()),
            None => self.grid.set_config(config.clone()),
        }
        self.config = config;
    }

    /// The file, where there is one, and the grid in memory, both to be changed alike. The guard is
    /// taken away; what it has judged and not committed is forgotten.
    pub(crate) fn parts(&mut self) -> (Option<&mut GridFile>, &mut TemporalGrid) {
        if let Some(grid) = self.guarded.take() {
            *self = Self::of_file(self.config.clone(), grid.into_file());
        }
        (self.file.as_mut(), &mut self.grid)
    }

    /// Reads of the file what is not in its newest generation.
    pub(crate) fn look_into_file<T>(
        &mut self,
        what: &str,
        look: impl FnOnce(&mut GridFile) -> chronotope::Result<T>,
    ) -> chronotope::Result<T> {
        match self.parts() {
            (Some(file), _) => look(file),
            (None, _) => Err(needs_file(what)),
        }
    }

    /// Changes the file and reads the grid anew.
    pub(crate) fn change_file<T>(
        &mut self,
        what: &str,
        change: impl FnOnce(&mut GridFile) -> chronotope::Result<T>,
    ) -> chronotope::Result<T> {
        let config = self.config.clone();
        let (Some(file), grid) = self.parts() else {
            return Err(needs_file(what));
        };
        let done = change(file)?;
        *grid = TemporalGrid::from_history(file.history().clone(), config);
        Ok(done)
    }

    /// Works with the file's guard, and commits; where that fails nothing has changed.
    pub(crate) fn guarded<T>(
        &mut self,
        work: impl FnOnce(&mut LifelongGrid) -> Result<T>,
    ) -> Result<T> {
        let done = self.guard().and_then(|grid| {
            let done = work(grid)?;
            let path = grid.file().path().to_owned();
            grid.commit().map_err(|error| error.with_path(path))?;
            Ok(done)
        });
        if done.is_err() {
            // What was taken in and not committed is no part of the file.
            self.parts();
        }
        done
    }

    /// The file's guard, which is put before it now if it was not there.
    pub(crate) fn guard(&mut self) -> Result<&mut LifelongGrid> {
        if let Some(file) = self.file.take() {
            let (path, access) = (file.path().to_owned(), access_of(file.is_read_only()));
            let guard = GuardConfig::default();
            match LifelongGrid::of_file(file, &self.config, guard, |_, _| {}) {
                Ok(grid) => {
                    self.guarded = Some(Box::new(grid));
                    // The guard has one of its own.
                    self.grid = TemporalGrid::new(*self.grid.spec(), self.config.clone());
                }
                Err(error) => {
                    self.file = GridFile::open(&path, access).ok();
                    self.is_lost = self.file.is_none();
                    return Err(error.with_path(path).into());
                }
            }
        }
        match &mut self.guarded {
            Some(grid) => Ok(grid),
            None => Err(needs_file("guard").into()),
        }
    }

    /// Reads the file anew, as others have left it.
    fn refresh(&mut self, spec: &GridSpec) -> chronotope::Result<u64> {
        let Some(file) = self.file() else {
            return Err(needs_file("generations"));
        };
        let (path, access) = (file.path().to_owned(), access_of(file.is_read_only()));
        let file = GridFile::open(&path, access)?;
        if file.history().spec() != spec {
            return Err(
                Error::new(ErrorKind::Conflict, "a grid of other cells stands here now")
                    .with_path(path)
                    .with_help("open it again with Grid.open"),
            );
        }
        let generation = file.generation();
        *self = Self::of_file(self.config.clone(), file);
        Ok(generation)
    }
}

const fn access_of(is_read_only: bool) -> Access {
    if is_read_only {
        Access::ReadOnly
    } else {
        Access::ReadWrite
    }
}

impl Shared {
    pub(crate) fn in_memory(history: History, config: GridConfig) -> Arc<Self> {
        let spec = *history.spec();
        let grid = TemporalGrid::from_history(history, config.clone());
        Self::of(spec, None, State::in_memory(config, grid))
    }

    pub(crate) fn of_file(file: GridFile, config: GridConfig) -> Arc<Self> {
        let (spec, path) = (*file.history().spec(), file.path().to_owned());
        Self::of(spec, Some(path), State::of_file(config, file))
    }

    fn of(spec: GridSpec, path: Option<PathBuf>, state: State) -> Arc<Self> {
        Arc::new(Self {
            spec,
            path,
            state: Mutex::new(Some(state)),
        })
    }

    /// Waits for whoever else works with it.
    fn lock(&self) -> MutexGuard<'_, Option<State>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Says so of a grid that was closed.
    fn closed(&self, py: Python<'_>) -> Failure {
        match &self.path {
            Some(path) => {
                let message = format!("the grid {} was closed", path.display());
                of_kind(py, "closed", &message, "open it again with Grid.open")
            }
            None => of_kind(py, "closed", "this grid was closed", "make another Grid"),
        }
    }

    /// Looks at it.
    pub(crate) fn glance<T: Send>(
        &self,
        py: Python<'_>,
        look: impl FnOnce(&State) -> T + Send,
    ) -> Result<T> {
        let seen = detached(py, || Ok(self.lock().as_ref().map(look)))?;
        seen.ok_or_else(|| self.closed(py))
    }

    /// Changes it, one thread after another.
    pub(crate) fn change<T: Send>(
        &self,
        py: Python<'_>,
        change: impl FnOnce(&mut State) -> Result<T> + Send,
    ) -> Result<T> {
        let changed = detached_with(py, || {
            let mut state = self.lock();
            let changed = state.as_mut().map(change).transpose();
            if state.as_ref().is_some_and(|state| state.is_lost) {
                *state = None;
            }
            changed
        })?;
        changed.ok_or_else(|| self.closed(py))
    }

    /// Asks what is fitted, which may take long at first; Ctrl-C is heard.
    pub(crate) fn ask<T: Send + 'static>(
        self: &Arc<Self>,
        py: Python<'_>,
        ask: impl FnOnce(&FittedGrid<'_>) -> chronotope::Result<T> + Send + 'static,
    ) -> Result<T> {
        let this = Arc::clone(self);
        let asked = interruptible(py, move || {
            let mut state = this.lock();
            let asked = state.as_mut().map(|state| ask(&state.fitted()));
            asked.transpose()
        })?;
        asked.ok_or_else(|| self.closed(py))
    }

    /// Reads what other processes have committed.
    pub(crate) fn refresh(&self, py: Python<'_>) -> Result<u64> {
        self.change(py, |state| Ok(state.refresh(&self.spec)?))
    }

    pub(crate) fn close(&self, py: Python<'_>) -> Result<()> {
        detached(py, || {
            *self.lock() = None;
            Ok(())
        })
    }

    pub(crate) fn is_closed(&self, py: Python<'_>) -> Result<bool> {
        detached(py, || Ok(self.lock().is_none()))
    }
}
