//! How is a model of a place learnt from its log?

use super::config::{HeldOut, ModelConfig, VisibilityConfig};
use super::evidence::Evidence;
use super::natural::Natural;
use super::shared_rhythms::SharedRhythms;
use super::{BitRow, Civil, HistoryLog, VisibilityModel};
use super::{cautious, fremen, histogram, logistic, markov, mean, pergam, persistent};
use crate::error::{Error, ErrorKind, Result};
use crate::spectrum::CandidatePeriods;
use crate::time::Zone;

/// The visits that a model is fitted from.
#[derive(Clone, Copy, Debug)]
pub enum Visits<'a> {
    /// Every visit of the log.
    All,
    /// The visits whose bit is one; one bit a visit.
    Only(&'a BitRow),
}

impl Visits<'_> {
    /// Indices of the visits in order of arrival.
    /// Fails if a mask has not one bit a visit.
    pub fn of(self, log: &HistoryLog) -> Result<Vec<usize>> {
        match self {
            Self::All => Ok((0..log.num_visits()).collect()),
            Self::Only(mask) if mask.len() == log.num_visits() => Ok(mask.ones().collect()),
            Self::Only(mask) => Err(Error::new(
                ErrorKind::Shape,
                format!(
                    "{} bits do not select among {} visits",
                    mask.len(),
                    log.num_visits()
                ),
            )),
        }
    }
}

/// Fits the model that `cfg` names to `visits` of a place's `log`.
///
/// The same, bit for bit, as fitting a log that has no other visits. Fails only if the selection
/// does not have one bit a visit, or has more visits than
/// [`MAX_OBSERVATIONS`](crate::spectrum::MAX_OBSERVATIONS).
pub fn fit(
    log: &HistoryLog,
    cfg: &VisibilityConfig,
    visits: Visits<'_>,
) -> Result<Box<dyn VisibilityModel>> {
    let evidence = Evidence {
        log,
        visits: visits.of(log)?,
        before_birth: cfg.before_birth(),
    };
    fit_model(&evidence, cfg, cfg.model())
}

/// As [`fit`], but any model is believed only as far as its visits reach, and knows how sure it is
/// ([`Cautious`](super::Cautious)); `natural` does so by itself.
pub fn fit_cautious(
    log: &HistoryLog,
    cfg: &VisibilityConfig,
    visits: Visits<'_>,
) -> Result<Box<dyn VisibilityModel>> {
    let model = fit(log, cfg, visits)?;
    if matches!(cfg.model(), ModelConfig::Natural { .. }) {
        return Ok(model);
    }
    let evidence = Evidence {
        log,
        visits: visits.of(log)?,
        before_birth: cfg.before_birth(),
    };
    Ok(Box::new(cautious::fit(&evidence, model)))
}

/// What `fit` learns from a log by the clocks of `zone`, as a model of moments ([`Civil`]); without
/// a zone, what it learns from the log itself.
///
/// ```
/// # fn main() -> fremen::Result<()> {
/// use fremen::time::Zone;
/// use fremen::visibility::{BitRow, HistoryLog, VisibilityConfig, Visits, fit, in_zone};
///
/// let log = HistoryLog::new();
/// let zone = Zone::new("Europe/Prague")?;
/// let cfg = VisibilityConfig::natural();
/// let model = in_zone(Some(&zone), &log, |log| fit(log, &cfg, Visits::All))?;
/// assert_eq!(model.num_features(), 0);
/// # Ok(())
/// # }
/// ```
pub fn in_zone(
    zone: Option<&Zone>,
    log: &HistoryLog,
    fit: impl FnOnce(&HistoryLog) -> Result<Box<dyn VisibilityModel>>,
) -> Result<Box<dyn VisibilityModel>> {
    match zone {
        None => fit(log),
        Some(zone) => {
            let model = fit(&log.by_clock(|time| zone.wall(time)))?;
            Ok(Box::new(Civil::new(model, zone.clone())))
        }
    }
}

fn fit_model(
    evidence: &Evidence<'_>,
    cfg: &VisibilityConfig,
    model: &ModelConfig,
) -> Result<Box<dyn VisibilityModel>> {
    Ok(match model {
        ModelConfig::Mean {} => Box::new(mean::fit(evidence)),
        ModelConfig::Fremen {
            candidates,
            order,
            balance,
        } => Box::new(fremen::fit(
            evidence,
            candidates,
            *order,
            *balance,
            cfg.guards(),
        )?),
        ModelConfig::Natural { ridge } => {
            let natural = Natural {
                ridge: *ridge,
                guards: cfg.guards(),
            };
            let rhythms = natural.fit(evidence)?;
            Box::new(cautious::fit(evidence, Box::new(rhythms)))
        }
        ModelConfig::LeastSquares {
            candidates,
            order,
            harmonics,
            ridge,
        } => {
            let mut shared = shared(cfg, candidates, *order, harmonics.as_deref());
            shared.ridge = *ridge;
            let harmonics = shared.choose(evidence)?;
            Box::new(shared.regress(evidence, &harmonics)?)
        }
        ModelConfig::Logistic {
            candidates,
            order,
            harmonics,
        } => {
            let shared = shared(cfg, candidates, *order, harmonics.as_deref());
            Box::new(logistic::fit(evidence, &shared)?)
        }
        ModelConfig::Histogram {
            period,
            num_bins,
            prior,
        } => Box::new(histogram::fit(evidence, *period, *num_bins, *prior)),
        ModelConfig::Pergam {
            period,
            num_bins,
            order,
        } => Box::new(pergam::fit(evidence, *period, *num_bins, *order)),
        ModelConfig::Markov {} => Box::new(markov::fit(evidence)),
        ModelConfig::Persistent { of } => {
            Box::new(persistent::fit(evidence, fit_model(evidence, cfg, of)?))
        }
    })
}

fn shared<'a>(
    cfg: &VisibilityConfig,
    candidates: &'a CandidatePeriods,
    held_out: HeldOut,
    harmonics: Option<&'a [u16]>,
) -> SharedRhythms<'a> {
    SharedRhythms {
        candidates,
        harmonics,
        held_out,
        ridge: 0.1,
        guards: cfg.guards(),
    }
}
