//! Which numbers does a caller ask for: the configuration of a localiser, threads?

use chronotope::localize::{LocalizerConfig, Method, Preset, Score};
use chronotope::map::MapMeta;
use chronotope::predict::Selection;
use chronotope::{Error, ErrorKind};

use crate::failure::Result;
use crate::hints::ConfigLike;
use crate::python::overlaid;

/// The configuration that a caller asks for.
pub(crate) struct Wanted<'py> {
    pub(crate) method: Option<&'py str>,
    pub(crate) score: Option<&'py str>,
    pub(crate) n: Option<usize>,
    pub(crate) risk: Option<f64>,
    pub(crate) config: Option<ConfigLike<'py>>,
}

impl Wanted<'_> {
    pub(crate) fn over(&self, meta: &MapMeta) -> Result<LocalizerConfig> {
        let base = LocalizerConfig::preset(preset_of(meta));
        let mut cfg = overlaid(base, self.config.as_ref(), "config")?;
        if let Some(method) = self.method {
            cfg = cfg.with_method(method.parse::<Method>()?);
        }
        if let Some(score) = self.score {
            cfg = cfg.with_score(score.parse::<Score>()?);
        }
        if let Some(risk) = self.risk {
            cfg = cfg.with_risk(risk);
        }
        if let Some(n) = self.n {
            cfg = cfg.with_selection(Selection::top(n).map_err(|error| error.with_place("n"))?);
        }
        Ok(cfg)
    }
}

/// The preset that a map says it was built with.
pub(crate) fn preset_of(meta: &MapMeta) -> Preset {
    meta.preset.parse().unwrap_or(Preset::Default)
}

/// A pool of so many threads.
pub(crate) fn pool_of(threads: Option<usize>) -> Result<rayon::ThreadPool> {
    if threads == Some(0) {
        return Err(Error::new(ErrorKind::Config, "0 threads do no work")
            .with_place("threads")
            .with_help("choose from 1, or leave it out for all cores")
            .into());
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads.unwrap_or(0))
        .thread_name(|at| format!("chronotope-{at}"))
        .build();
    Ok(pool.map_err(|cause| Error::new(ErrorKind::Io, cause.to_string()))?)
}
