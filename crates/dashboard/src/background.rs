//! How does a robot record without waiting for it?
//!
//! A [`Background`] hands traces to a thread of its own, which turns them into a recording. The
//! queue between them is bounded: memory stays bounded, nothing is lost, and a robot that is faster
//! than the recording for long waits for it, as it would without the thread.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use anyhow::{Context, Result, anyhow};
use chronotope::trace::Trace;

use crate::{Destination, Recorder, RecorderConfig};

/// Traces that may wait: some 100 kB each with a picture, 20 kB without.
const QUEUE: usize = 64;

/// A [`Recorder`] on a thread of its own.
pub struct Background {
    queue: SyncSender<Trace<'static>>,
    worker: JoinHandle<Result<u64>>,
}

impl Background {
    /// Starts a recording; fails as [`Recorder::new`] does.
    pub fn new(destination: Destination, cfg: RecorderConfig) -> Result<Self> {
        let recorder = Recorder::new(destination, cfg)?;
        let (queue, waiting) = sync_channel(QUEUE);
        let worker = std::thread::Builder::new()
            .name("chronotope-recorder".into())
            .spawn(move || record_all(recorder, &waiting))
            .context("no thread for the recording")?;
        Ok(Self { queue, worker })
    }

    /// Hands one localisation over; waits only while the queue is full.
    ///
    /// Fails if the recording has failed; [`finish`](Self::finish) then says why.
    pub fn record(&self, trace: Trace<'_>) -> Result<()> {
        self.queue
            .send(trace.into_owned())
            .map_err(|_| anyhow!("the recording has ended early (help: `finish` says why)"))
    }

    /// Waits until everything is written or taken over; returns the number of localisations.
    pub fn finish(self) -> Result<u64> {
        drop(self.queue);
        match self.worker.join() {
            Ok(outcome) => outcome,
            Err(_) => Err(anyhow!("the thread of the recording has panicked")),
        }
    }
}

fn record_all(mut recorder: Recorder, waiting: &Receiver<Trace<'static>>) -> Result<u64> {
    for trace in waiting {
        recorder.record(&trace)?;
    }
    recorder.finish()
}
