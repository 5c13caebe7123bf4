//! What is kept of the cells of one tile?

use super::log::{CellLog, Change};
use crate::cells::CellState;

/// The observations of the grid at which a tile was observed, as ascending half-open ranges.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Visits {
    /// Start, end, start, end, ...
    bounds: Vec<u32>,
    len: u32,
}

impl Visits {
    /// Appends observations `start..end`, all later than those before.
    pub(crate) fn extend(&mut self, start: u32, end: u32) {
        if start == end {
            return;
        }
        self.len += end - start;
        match self.bounds.last_mut() {
            Some(last) if *last == start => *last = end,
            _ => {
                self.bounds.reserve_exact(2);
                self.bounds.extend([start, end]);
            }
        }
    }

    /// How many there are.
    pub(crate) const fn len(&self) -> u32 {
        self.len
    }

    /// Start, end, start, end, ...
    pub(crate) fn bounds(&self) -> &[u32] {
        &self.bounds
    }

    pub(crate) fn ranges(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        self.bounds.chunks_exact(2).map(|pair| (pair[0], pair[1]))
    }

    /// The observations, ascending.
    pub(crate) fn observations(&self) -> impl Iterator<Item = u32> + '_ {
        self.ranges().flat_map(|(start, end)| start..end)
    }

    /// The observation of a visit, which must be one of them.
    pub(crate) fn observation(&self, visit: u32) -> u32 {
        let mut left = visit;
        for (start, end) in self.ranges() {
            if left < end - start {
                return start + left;
            }
            left -= end - start;
        }
        0
    }

    /// The same observations under new, ascending numbers.
    pub(crate) fn renumbered(&self, numbers: &[u32]) -> Self {
        let mut renumbered = Self::default();
        for observation in self.observations() {
            let number = numbers[observation as usize];
            renumbered.extend(number, number + 1);
        }
        renumbered
    }

    /// As read from a file; none where ranges are not ascending, empty or beyond `limit`.
    pub(crate) fn from_bounds(bounds: Vec<u32>, limit: u32) -> Option<Self> {
        let ascending = bounds.windows(2).all(|pair| pair[0] < pair[1]);
        let inside = bounds.last().is_none_or(|&last| last <= limit);
        if !bounds.len().is_multiple_of(2) || !ascending || !inside {
            return None;
        }
        let len = bounds.chunks_exact(2).map(|pair| pair[1] - pair[0]).sum();
        Some(Self { bounds, len })
    }

    pub(crate) fn heap_bytes(&self) -> usize {
        self.bounds.capacity() * 4
    }
}

/// Words of 64 cells: which are known, which occupied.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Plane {
    pub(crate) known: u64,
    pub(crate) occupied: u64,
}

impl Plane {
    pub(crate) const fn state(self, bit: u32) -> CellState {
        if self.known >> bit & 1 == 0 {
            CellState::Unknown
        } else if self.occupied >> bit & 1 == 1 {
            CellState::Occupied
        } else {
            CellState::Free
        }
    }

    pub(crate) fn set(&mut self, bit: u32, state: CellState) {
        let mask = 1 << bit;
        self.known &= !mask;
        self.occupied &= !mask;
        match state {
            CellState::Free => self.known |= mask,
            CellState::Occupied => {
                self.known |= mask;
                self.occupied |= mask;
            }
            CellState::Unknown => {}
        }
    }
}

/// One word of cells of a tile.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Word {
    /// The states at the last visit.
    now: Plane,
    /// Which cells have a log.
    logged: u64,
}

/// The states of the cells of one tile at each of its visits.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Tile {
    key: u32,
    visits: Visits,
    words: Box<[Word]>,
    /// Of the cells that ever changed, in the order of cells.
    logs: Vec<CellLog>,
}

impl Tile {
    /// A tile that was not visited yet.
    pub(crate) fn new(key: u32, num_cells: usize) -> Self {
        Self {
            key,
            visits: Visits::default(),
            words: vec![Word::default(); num_cells / 64].into(),
            logs: Vec::new(),
        }
    }

    pub(crate) const fn key(&self) -> u32 {
        self.key
    }

    pub(crate) const fn visits(&self) -> &Visits {
        &self.visits
    }

    pub(crate) fn num_words(&self) -> usize {
        self.words.len()
    }

    /// The states at the last visit of cells `64 word..64 (word + 1)`.
    #[inline]
    pub(crate) fn plane(&self, word: usize) -> Plane {
        self.words[word].now
    }

    /// The state of a cell at the last visit.
    pub(crate) fn state(&self, at: usize) -> CellState {
        self.words[at / 64].now.state(at as u32 % 64)
    }

    /// The log of a cell; none if it never changed.
    pub(crate) fn log(&self, at: usize) -> Option<&CellLog> {
        let is_logged = self.words[at / 64].logged >> (at % 64) & 1 == 1;
        is_logged.then(|| &self.logs[self.rank(at)])
    }

    /// The cells that ever changed with their logs, ascending.
    pub(crate) fn logs(&self) -> impl Iterator<Item = (usize, &CellLog)> {
        let cells = self
            .words
            .iter()
            .enumerate()
            .flat_map(|(word, it)| bits(it.logged).map(move |bit| word * 64 + bit as usize));
        cells.zip(&self.logs)
    }

    /// Which of cells `64 word..64 (word + 1)` have a log.
    pub(crate) fn logged(&self, word: usize) -> u64 {
        self.words[word].logged
    }

    pub(crate) const fn num_logs(&self) -> usize {
        self.logs.len()
    }

    /// How many logged cells come before one.
    #[inline]
    fn rank(&self, at: usize) -> usize {
        let (word, bit) = (at / 64, at % 64);
        let before: u32 = self.words[..word]
            .iter()
            .map(|it| it.logged.count_ones())
            .sum();
        let within = self.words[word].logged & ((1 << bit) - 1);
        (before + within.count_ones()) as usize
    }

    /// Adds a visit with the states `plane_of(word)`, and counts what changed.
    pub(crate) fn visit(&mut self, observation: u32, planes: &[Plane]) -> Counts {
        let visit = self.visits.len();
        self.visits.extend(observation, observation + 1);
        let mut counts = Counts::default();
        for (word, &plane) in planes.iter().enumerate() {
            let before = self.words[word].now;
            counts.add(before, plane);
            if visit == 0 {
                self.words[word].now = plane;
                continue;
            }
            let changed = (before.known ^ plane.known) | (before.occupied ^ plane.occupied);
            if changed == 0 {
                continue;
            }
            let first = self.begin_logs(word, changed);
            let logged = self.words[word].logged;
            for bit in bits(changed) {
                let before_it = (logged & ((1 << bit) - 1)).count_ones() as usize;
                self.logs[first + before_it].push(visit, before.state(bit), plane.state(bit));
            }
            self.words[word].now = plane;
        }
        counts
    }

    /// Gives those of `cells` a log that have none; where the logs of the word begin.
    ///
    /// All at once: one by one, each would move all logs behind it.
    fn begin_logs(&mut self, word: usize, cells: u64) -> usize {
        let first = self.rank(word * 64);
        let Word { now, logged } = self.words[word];
        if cells & !logged == 0 {
            return first;
        }
        let num = logged.count_ones() as usize;
        let mut known = self
            .logs
            .drain(first..first + num)
            .collect::<Vec<_>>()
            .into_iter();
        let all: Vec<CellLog> = bits(logged | cells)
            .map(|bit| {
                let log = (logged >> bit & 1 == 1).then(|| known.next()).flatten();
                log.unwrap_or_else(|| CellLog::new(now.state(bit)))
            })
            .collect();
        self.logs.splice(first..first, all);
        self.words[word].logged |= cells;
        first
    }

    /// The cell has another state from a visit on, which is not visit 0.
    #[inline]
    pub(crate) fn change(&mut self, visit: u32, at: usize, to: CellState) {
        let (word, bit) = (at / 64, at as u32 % 64);
        let from = self.words[word].now.state(bit);
        let rank = self.rank(at);
        if self.words[word].logged >> bit & 1 == 0 {
            self.words[word].logged |= 1 << bit;
            self.logs.insert(rank, CellLog::new(from));
        }
        self.logs[rank].push(visit, from, to);
        self.words[word].now.set(bit, to);
    }

    /// Adds visits at observations `start..end` at which nothing changes but what [`Self::change`]
    /// said of them.
    pub(crate) fn extend(&mut self, start: u32, end: u32) {
        self.visits.extend(start, end);
    }

    /// Adds the visits of another tile, whose observations follow `num_known` earlier ones.
    pub(crate) fn append(&mut self, later: &Self, num_known: u32) {
        let before = self.visits.len();
        for (start, end) in later.visits.ranges() {
            self.visits.extend(num_known + start, num_known + end);
        }
        if before == 0 {
            let visits = std::mem::take(&mut self.visits);
            *self = later.clone().with_visits(visits);
            return;
        }
        for (word, first) in later.planes_at(0).into_iter().enumerate() {
            let now = self.words[word].now;
            for bit in bits((now.known ^ first.known) | (now.occupied ^ first.occupied)) {
                self.change(before, word * 64 + bit as usize, first.state(bit));
            }
        }
        for (at, log) in later.logs() {
            for change in log.changes() {
                self.change(before + change.visit, at, change.state);
            }
        }
    }

    /// The states at a visit.
    pub(crate) fn planes_at(&self, visit: u32) -> Vec<Plane> {
        let mut planes: Vec<_> = self.words.iter().map(|it| it.now).collect();
        for (at, log) in self.logs() {
            let last = log.changes().take_while(|it| it.visit <= visit).last();
            let state = last.map_or(log.first(), |it| it.state);
            planes[at / 64].set(at as u32 % 64, state);
        }
        planes
    }

    /// A tile with given visits, in which each cell has the state `first` gives, then changes as
    /// `changes` gives; what is said to change to what it is already is no change.
    pub(crate) fn build<I: Iterator<Item = Change>>(
        key: u32,
        num_cells: usize,
        visits: Visits,
        cell: impl Fn(usize) -> (CellState, I),
    ) -> Self {
        let mut tile = Self::new(key, num_cells);
        tile.visits = visits;
        for at in 0..num_cells {
            let (first, changes) = cell(at);
            tile.words[at / 64].now.set(at as u32 % 64, first);
            for change in changes {
                if change.state != tile.state(at) {
                    tile.change(change.visit, at, change.state);
                }
            }
        }
        tile.shrink();
        tile
    }

    /// The same tile with other numbers of its observations.
    pub(crate) fn with_visits(mut self, visits: Visits) -> Self {
        self.visits = visits;
        self
    }

    /// Sets what a file says of a cell: its state at visit 0, by the words of the known and the
    /// occupied cells, and its log; none where that is broken.
    pub(crate) fn restore(
        &mut self,
        at: usize,
        [known, occupied]: [u64; 2],
        bytes: &[u8],
    ) -> Option<()> {
        let bit = at as u32 % 64;
        let first = Plane { known, occupied }.state(bit);
        let mut now = first;
        if !bytes.is_empty() {
            let log = CellLog::from_bytes(first, bytes, self.visits.len())?;
            now = log.changes().last()?.state;
            self.words[at / 64].logged |= 1 << bit;
            let rank = self.rank(at);
            self.logs.insert(rank, log);
        }
        self.words[at / 64].now.set(bit, now);
        Some(())
    }

    pub(crate) fn shrink(&mut self) {
        self.logs.shrink_to_fit();
        self.logs.iter_mut().for_each(CellLog::shrink);
    }

    /// Bytes of what every cell needs, and of logs.
    pub(crate) fn num_bytes(&self) -> (usize, usize) {
        let words = std::mem::size_of_val(&*self.words);
        let logs: usize = self.logs.iter().map(CellLog::heap_bytes).sum();
        (
            size_of::<Self>() + words + self.visits.heap_bytes(),
            self.logs.capacity() * size_of::<CellLog>() + logs,
        )
    }
}

/// What an observation did to cells.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Counts {
    pub(crate) known: usize,
    pub(crate) changed: usize,
    pub(crate) revealed: usize,
    pub(crate) hidden: usize,
}

impl Counts {
    pub(crate) fn add(&mut self, before: Plane, after: Plane) {
        let both = before.known & after.known;
        self.known += after.known.count_ones() as usize;
        self.changed += (both & (before.occupied ^ after.occupied)).count_ones() as usize;
        self.revealed += (after.known & !before.known).count_ones() as usize;
        self.hidden += (before.known & !after.known).count_ones() as usize;
    }

    pub(crate) fn plus(self, other: Self) -> Self {
        Self {
            known: self.known + other.known,
            changed: self.changed + other.changed,
            revealed: self.revealed + other.revealed,
            hidden: self.hidden + other.hidden,
        }
    }
}

/// The numbers of the bits that are set, ascending.
pub(crate) fn bits(mut word: u64) -> impl Iterator<Item = u32> {
    std::iter::from_fn(move || {
        (word != 0).then(|| {
            let bit = word.trailing_zeros();
            word &= word - 1;
            bit
        })
    })
}
