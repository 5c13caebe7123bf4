//! Which numbers does a caller ask for: the configuration of a localiser, threads?

use chronotope::localize::{LocalizerConfig, Method, Preset, Score};
use chronotope::map::{MapMeta, Snapshot};
use chronotope::predict::Selection;
use chronotope::{Error, ErrorKind, Time};

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

/// The same configuration with the method `static`, if `snapshot` has times that are no clock's and
/// nobody has asked for a method: what the command does, too.
pub(crate) fn without_clock(
    wanted: &Wanted<'_>,
    cfg: &LocalizerConfig,
    snapshot: &Snapshot,
) -> Option<LocalizerConfig> {
    /// Before this no camera's clock was right: 2000-01-01.
    const FIRST_TIME: Time = Time::from_s(946_684_800);
    let is_preset = cfg.method() == LocalizerConfig::preset(preset_of(snapshot.meta())).method();
    let last = snapshot.summary().last;
    let only_counts = last.is_some_and(|last| last < FIRST_TIME);
    (is_preset && wanted.method.is_none() && only_counts).then(|| {
        tracing::warn!(
            "the times of this map only number its visits: localised by method=\"static\""
        );
        cfg.clone().with_method(Method::Static)
    })
}

/// The preset that a map says it was built with.
pub(crate) fn preset_of(meta: &MapMeta) -> Preset {
    meta.preset.parse().unwrap_or(Preset::Default)
}

/// A number of threads that do work, or none for all cores.
pub(crate) fn checked_threads(threads: Option<usize>) -> Result<Option<usize>> {
    if threads == Some(0) {
        return Err(Error::new(ErrorKind::Config, "0 threads do no work")
            .with_place("threads")
            .with_help("choose from 1, or leave it out for all cores")
            .into());
    }
    Ok(threads)
}

/// A pool of so many threads.
pub(crate) fn pool_of(threads: Option<usize>) -> Result<rayon::ThreadPool> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(checked_threads(threads)?.unwrap_or(0))
        .thread_name(|at| format!("chronotope-{at}"))
        .build();
    Ok(pool.map_err(|cause| Error::new(ErrorKind::Io, cause.to_string()))?)
}
