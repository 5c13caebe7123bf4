//! How does somebody who waits see that something happens?
//!
//! By `tqdm` where it is installed and wished for, or by any function `progress(done, total)`.

use pyo3::prelude::*;

use crate::failure::Result;
use crate::hints::ProgressLike;

/// A bar, a function, or nothing.
pub(crate) struct Progress {
    bar: Option<Py<PyAny>>,
}

impl Progress {
    pub(crate) fn new(
        py: Python<'_>,
        wish: Option<&ProgressLike<'_>>,
        total: usize,
        what: &str,
    ) -> Result<Self> {
        let Some(wish) = wish else {
            return Ok(Self { bar: None });
        };
        let make = py.import("chronotope._progress")?.getattr("bar")?;
        let bar = make.call1((&wish.0, total, what))?;
        Ok(Self {
            bar: (!bar.is_none()).then(|| bar.unbind()),
        })
    }

    pub(crate) fn advance(&mut self, by: usize) -> Result<()> {
        if let Some(bar) = &self.bar {
            Python::attach(|py| bar.bind(py).call_method1("update", (by,)).map(drop))?;
        }
        Ok(())
    }

    pub(crate) fn close(&mut self) -> Result<()> {
        if let Some(bar) = self.bar.take() {
            Python::attach(|py| bar.bind(py).call_method0("close").map(drop))?;
        }
        Ok(())
    }
}
