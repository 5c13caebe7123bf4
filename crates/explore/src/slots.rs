//! Into which slots is the time divided that is planned?

use fremen::{Error, ErrorKind, Period, Result, Time};

/// Equal slots of time, one after the other; each is for one visit at most.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Slots {
    start: Time,
    length: Period,
    count: usize,
}

impl Slots {
    /// More slots than this are refused: a year of quarters of an hour.
    pub const MAX_COUNT: usize = 40_000;

    /// `count` slots of `length` from `start` on.
    ///
    /// Fails without slots, with more than [`MAX_COUNT`](Self::MAX_COUNT), and where they reach
    /// beyond the end of time.
    pub fn new(start: Time, length: Period, count: usize) -> Result<Self> {
        let config = |message: String| Err(Error::new(ErrorKind::Config, message));
        if count == 0 || count > Self::MAX_COUNT {
            return config(format!(
                "a plan has 1 to {} slots, not {count}",
                Self::MAX_COUNT
            ));
        }
        let end = i128::from(start.as_us()) + i128::from(length.as_us()) * count as i128;
        if i64::try_from(end).is_err() {
            return config(format!("{count} slots of {length} reach beyond all times"));
        }
        Ok(Self {
            start,
            length,
            count,
        })
    }

    /// As [`new`](Self::new), the length in seconds: finite, and at least a microsecond.
    pub fn of_s(start: Time, length_s: f64, count: usize) -> Result<Self> {
        let length = Period::from_s(length_s).map_err(|_| {
            Error::new(
                ErrorKind::Config,
                format!("a slot must be longer than 0 s, not {length_s} s"),
            )
            .with_help("600 s is usual")
        })?;
        Self::new(start, length, count)
    }

    /// When the first begins.
    pub fn start(&self) -> Time {
        self.start
    }

    /// When the last ends.
    pub fn end(&self) -> Time {
        self.begin(self.count)
    }

    /// How long each is.
    pub fn length(&self) -> Period {
        self.length
    }

    /// How many there are: at least 1.
    #[expect(clippy::len_without_is_empty, reason = "there is always one")]
    pub fn len(&self) -> usize {
        self.count
    }

    /// When slot `slot` begins.
    pub fn begin(&self, slot: usize) -> Time {
        self.start.plus_us(self.length.as_us() * slot as i64)
    }

    /// The moment in the middle of slot `slot`.
    pub fn middle(&self, slot: usize) -> Time {
        self.begin(slot).plus_us(self.length.as_us() / 2)
    }

    /// The slot that `time` falls into; `None` before the first and after the last.
    pub fn slot_of(&self, time: Time) -> Option<usize> {
        let passed = i128::from(time.as_us()) - i128::from(self.start.as_us());
        let slot = usize::try_from(passed.div_euclid(self.length.as_us().into())).ok()?;
        (slot < self.count).then_some(slot)
    }

    /// Slots that may be spent on visits within `share`: rounded down.
    pub fn budget(&self, share: f64) -> usize {
        ((share * self.count as f64 + 1e-9) as usize).min(self.count)
    }
}
