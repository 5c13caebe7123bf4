//! How is a steady stream of frames taken in, each of which changes few cells?

use std::collections::BTreeMap;

use fremen::{Error, ErrorKind, Result, Time};

use super::record::{History, Verdict};
use crate::cells::{CellState, Patch};

/// Frames of one fixed view, each given by the cells that changed since the last.
///
/// Every frame is an observation of all tiles of the view, in which the cells that are not named
/// keep their state. It costs as much as it has changes, however large the view. The frames are
/// part of the history once the stream is dropped.
#[derive(Debug)]
pub struct FrameStream<'a> {
    history: &'a mut History,
    observer: u16,
    /// The first observation of which the tiles have not heard.
    first: u32,
    num_frames: u32,
    /// For each tile of the history, its visits before `first`; none where it is not in view.
    visits: Vec<Option<u32>>,
    /// What a frame changes, checked before it is applied.
    found: Vec<(usize, usize, CellState)>,
}

impl History {
    /// Begins a stream of frames with its first one, `view`, which says what is in view: the tiles
    /// of its known cells.
    ///
    /// # Errors
    /// As for [`Self::observe_as`], and [`ErrorKind::Time`] where `time` is not later than all
    /// observations before.
    pub fn frames(
        &mut self,
        observer: &str,
        view: &Patch,
        time: Time,
    ) -> Result<(Verdict, FrameStream<'_>)> {
        self.check_is_latest(time)?;
        let verdict = self.observe_as(observer, view, time)?;
        let first = self.observations.len() as u32;
        let visits = self.tiles.iter().map(|tile| {
            let in_view = tile
                .visits()
                .ranges()
                .last()
                .is_some_and(|(_, end)| end == first);
            in_view.then(|| tile.visits().len())
        });
        let stream = FrameStream {
            observer: self.observations.enlist(observer)?,
            first,
            num_frames: 0,
            visits: visits.collect(),
            found: Vec::new(),
            history: self,
        };
        Ok((verdict, stream))
    }

    fn check_is_latest(&self, time: Time) -> Result<()> {
        match self.observations.last_time() {
            Some(last) if time <= last => Err(Error::new(
                ErrorKind::Time,
                format!("a frame of {time} is not later than the last one, of {last}"),
            )
            .with_help("frames come in the order of time; add older ones as single observations")),
            _ => Ok(()),
        }
    }
}

impl FrameStream<'_> {
    /// Adds a frame: `changes` are indices of cells ([`GridSpec::index`]) with their new states.
    ///
    /// A cell that is named more than once has the last state; one that has its state already does
    /// not change. Ascending indices are the fastest.
    ///
    /// # Errors
    /// [`ErrorKind::Time`] where `time` is not later than the last frame's, [`ErrorKind::Shape`]
    /// where a cell is not in view or the observations are too many. The frame changes nothing
    /// then.
    ///
    /// [`GridSpec::index`]: crate::cells::GridSpec::index
    pub fn push(&mut self, time: Time, changes: &[(u32, CellState)]) -> Result<()> {
        self.history.check_is_latest(time)?;
        if !changes.windows(2).all(|pair| pair[0].0 < pair[1].0) {
            // The last one for each cell.
            let last: BTreeMap<u32, CellState> = changes.iter().copied().collect();
            return self.push(time, &last.into_iter().collect::<Vec<_>>());
        }
        self.found.clear();
        for &(index, state) in changes {
            let found = self.locate(index).ok_or_else(|| {
                Error::new(ErrorKind::Shape, format!("cell {index} is not in view"))
                    .with_help("begin a stream whose first frame has the cell")
            })?;
            self.found.push((found.0, found.1, state));
        }
        self.history.observations.push(time, self.observer)?;
        for &(slot, at, state) in &self.found {
            let tile = &mut self.history.tiles[slot];
            if let Some(before) = self.visits[slot]
                && tile.state(at) != state
            {
                tile.change(before + self.num_frames, at, state);
            }
        }
        self.num_frames += 1;
        Ok(())
    }

    /// Frames after the first.
    pub const fn num_frames(&self) -> u32 {
        self.num_frames
    }

    #[inline]
    fn locate(&self, index: u32) -> Option<(usize, usize)> {
        let tiling = self.history.tiling();
        let [w, h, d] = tiling.spec().dims();
        // 32-bit divisions: they take half as long as those of `GridSpec::cell`.
        let (row, x) = (index / w, index % w);
        let (z, y) = (row / h, row % h);
        let (key, at) = tiling.locate([x, y, z]);
        let slot = self.history.slot(key).filter(|_| z < d)?;
        self.visits.get(slot)?.map(|_| (slot, at))
    }
}

impl Drop for FrameStream<'_> {
    fn drop(&mut self) {
        let end = self.first + self.num_frames;
        for (tile, visits) in self.history.tiles.iter_mut().zip(&self.visits) {
            if visits.is_some() {
                tile.extend(self.first, end);
            }
        }
    }
}
