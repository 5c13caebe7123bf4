//! Which observations were made, when and by whom?

use fremen::spectrum::MAX_OBSERVATIONS;
use fremen::{Error, ErrorKind, Result, Time};

/// All observations of a grid in the order of their identities: time, then the observer's name.
///
/// One observer observes at most once at one time, so that this pair names an observation.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Observations {
    times_us: Vec<i64>,
    /// Indices of `names`.
    observers: Vec<u16>,
    /// Ascending, so that indices are in the order of names.
    names: Vec<String>,
}

impl Observations {
    pub(crate) fn len(&self) -> usize {
        self.times_us.len()
    }

    pub(crate) fn time(&self, index: usize) -> Time {
        Time::from_us(self.times_us[index])
    }

    pub(crate) fn times_us(&self) -> &[i64] {
        &self.times_us
    }

    pub(crate) fn last_time(&self) -> Option<Time> {
        self.times_us.last().copied().map(Time::from_us)
    }

    pub(crate) fn observer(&self, index: usize) -> &str {
        &self.names[usize::from(self.observers[index])]
    }

    pub(crate) fn observers(&self) -> &[u16] {
        &self.observers
    }

    pub(crate) fn names(&self) -> &[String] {
        &self.names
    }

    /// The index of an observation, or the one that it would get.
    pub(crate) fn find(&self, time: Time, observer: &str) -> std::result::Result<usize, usize> {
        let from = self.times_us.partition_point(|&us| us < time.as_us());
        let same = self.times_us[from..]
            .iter()
            .take_while(|&&us| us == time.as_us());
        let end = from + same.count();
        for index in from..end {
            match self.observer(index).cmp(observer) {
                std::cmp::Ordering::Less => {}
                std::cmp::Ordering::Equal => return Ok(index),
                std::cmp::Ordering::Greater => return Err(index),
            }
        }
        Err(end)
    }

    /// The number of an observer, who may be new.
    pub(crate) fn enlist(&mut self, observer: &str) -> Result<u16> {
        match self
            .names
            .binary_search_by(|name| name.as_str().cmp(observer))
        {
            Ok(at) => Ok(at as u16),
            Err(_) if self.names.len() == usize::from(u16::MAX) => Err(Error::new(
                ErrorKind::Shape,
                "a grid has at most 65535 observers",
            )),
            Err(at) => {
                self.names.insert(at, observer.to_owned());
                for index in &mut self.observers {
                    *index += u16::from(usize::from(*index) >= at);
                }
                Ok(at as u16)
            }
        }
    }

    /// Appends an observation whose identity is above all others'.
    pub(crate) fn push(&mut self, time: Time, observer: u16) -> Result<u32> {
        if self.len() >= MAX_OBSERVATIONS {
            return Err(too_many());
        }
        self.times_us.push(time.as_us());
        self.observers.push(observer);
        Ok(self.len() as u32 - 1)
    }

    /// The union of two, and where the observations of each are in it.
    pub(crate) fn union(&self, other: &Self) -> Result<(Self, Vec<u32>, Vec<u32>)> {
        let mut union = Self::default();
        for name in self.names.iter().chain(&other.names) {
            union.enlist(name)?;
        }
        let own_numbers = numbers_in(&union.names, &self.names);
        let other_numbers = numbers_in(&union.names, &other.names);
        let identity = |from: &Self, numbers: &[u16], at: usize| {
            let us = from.times_us.get(at)?;
            Some((*us, numbers[usize::from(from.observers[at])]))
        };
        let (mut mine, mut others) = (Vec::new(), Vec::new());
        loop {
            let a = identity(self, &own_numbers, mine.len());
            let b = identity(other, &other_numbers, others.len());
            let (takes_mine, takes_other) = match (a, b) {
                (Some(a), Some(b)) => (a <= b, b <= a),
                _ => (a.is_some(), b.is_some()),
            };
            let Some((us, observer)) = (if takes_mine { a } else { b }) else {
                break;
            };
            let at = union.push(Time::from_us(us), observer)?;
            if takes_mine {
                mine.push(at);
            }
            if takes_other {
                others.push(at);
            }
        }
        Ok((union, mine, others))
    }

    /// Without the first `num`, and without observers that have none left.
    pub(crate) fn without_first(&self, num: usize) -> Self {
        let mut kept = Self::default();
        let mut numbers = vec![None; self.names.len()];
        for &observer in &self.observers[num..] {
            numbers[usize::from(observer)] = Some(0);
        }
        for (name, number) in self.names.iter().zip(&mut numbers) {
            if let Some(number) = number {
                *number = kept.names.len() as u16;
                kept.names.push(name.clone());
            }
        }
        kept.times_us = self.times_us[num..].to_vec();
        kept.observers = self.observers[num..]
            .iter()
            .filter_map(|&it| numbers[usize::from(it)])
            .collect();
        kept
    }

    /// Keeps the first `num`; observers that have none left stay.
    pub(crate) fn truncate(&mut self, num: usize) {
        self.times_us.truncate(num);
        self.observers.truncate(num);
    }

    /// As read from a file: `None` where the order of identities is broken.
    pub(crate) fn from_parts(
        times_us: Vec<i64>,
        observers: Vec<u16>,
        names: Vec<String>,
    ) -> Option<Self> {
        let ascending = names.windows(2).all(|pair| pair[0] < pair[1]);
        let named = observers.iter().all(|&it| usize::from(it) < names.len());
        let ordered = (1..times_us.len().min(observers.len()))
            .all(|i| (times_us[i - 1], observers[i - 1]) < (times_us[i], observers[i]));
        let fits = times_us.len() == observers.len() && times_us.len() <= MAX_OBSERVATIONS;
        (ascending && named && ordered && fits).then_some(Self {
            times_us,
            observers,
            names,
        })
    }

    pub(crate) fn heap_bytes(&self) -> usize {
        let names: usize = self.names.iter().map(String::capacity).sum();
        self.times_us.capacity() * 8 + self.observers.capacity() * 2 + names
    }
}

/// The number of each of `names` among `all`, which has them.
fn numbers_in(all: &[String], names: &[String]) -> Vec<u16> {
    let number = |name| all.binary_search(name).unwrap_or_default() as u16;
    names.iter().map(number).collect()
}

fn too_many() -> Error {
    Error::new(
        ErrorKind::Shape,
        format!("a grid has at most {MAX_OBSERVATIONS} observations"),
    )
    .with_help("forget the oldest")
}
