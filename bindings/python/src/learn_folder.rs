//! How does a folder of images become a map, or more of a map, while Ctrl-C is heard?
//!
//! By the engine's own training, as the command does it, so that the same folder gives the same
//! digest.

use std::sync::atomic::{AtomicBool, Ordering};

use chronotope::dataset::Clock;
use chronotope::training::{Step, Training, TrainingReport};

use pyo3::prelude::*;

use crate::failure::{Failure, Result, check_interrupt, detached_with};
use crate::hints::ProgressLike;
use crate::progress::Progress;

/// Learns a folder and finishes the map, with a bar if it is wished for.
///
/// After Ctrl-C what was learnt is committed, and the same call goes on.
pub(crate) fn run(
    py: Python<'_>,
    training: &mut Training,
    progress: Option<&ProgressLike<'_>>,
) -> Result<TrainingReport> {
    warn(training);
    let mut bar = Progress::new(py, progress, training.num_images(), "learning")?;
    let done = detached_with(py, || learn(training, &mut bar));
    for problem in &training.report().problems {
        tracing::warn!("left out: {problem}");
    }
    done?;
    bar.close()?;
    Ok(training.report().clone())
}

/// Says of a folder what whoever learns it should know.
fn warn(training: &Training) {
    if training.clock() == Clock::None {
        tracing::warn!(
            "the times of `{}` only number its visits: localise with method=\"static\" or an \
             experience method",
            training.dataset_name()
        );
    }
    if let (Some((width, height)), num_scaled @ 1..) = training.scaled() {
        tracing::warn!(
            "{num_scaled} images of another resolution are scaled to {width} x {height} px"
        );
    }
}

fn learn(training: &mut Training, bar: &mut Progress) -> Result<()> {
    let is_stopped = AtomicBool::new(false);
    let mut failure: Option<Failure> = None;
    let mut num_shown = 0;
    let mut show = |num_done: usize| -> Result<()> {
        bar.advance(num_done - num_shown)?;
        num_shown = num_done;
        check_interrupt()
    };
    let done = training.learn(&|| is_stopped.load(Ordering::Relaxed), &mut |step| {
        let shown = match step {
            Step::Resumed { num_known } => show(num_known),
            Step::Done { num_done } => show(num_done),
            Step::Held { entry, learnt } => {
                if let Some(doubt) = &learnt.doubt {
                    tracing::warn!("held: {}: {doubt}", entry.id);
                }
                Ok(())
            }
            Step::Committed { generation } => {
                tracing::info!(generation, "committed");
                Ok(())
            }
            _ => Ok(()),
        };
        if let Err(cause) = shown {
            is_stopped.store(true, Ordering::Relaxed);
            failure.get_or_insert(cause);
        }
    });
    if let Some(failure) = failure {
        done?;
        training.stop()?;
        return Err(failure);
    }
    done?;
    training.finish()?;
    Ok(())
}
