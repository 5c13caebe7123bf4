//! At which features of a place did one visit look, and which did it see?
//!
//! Two bits a feature, in blocks of 64: a robot looks at all features of a place at once, so a visit of
//! 200 features takes four blocks. 24 bytes a block in memory, 9 to 18 as bytes.

use fremen::{Error, ErrorKind, Result};

/// Features in a block.
pub(crate) const BLOCK: u32 = 64;

/// 64 features, from `64 * index` on. What was not observed was not seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Block {
    pub(crate) index: u32,
    pub(crate) observed: u64,
    pub(crate) seen: u64,
}

/// What adding an observation changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Added {
    New,
    Known,
    /// It is known with the other state.
    Contradicts,
}

/// The states of a place's features at one visit.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct States {
    /// Ascending by index.
    blocks: Vec<Block>,
}

impl States {
    /// Nothing observed.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds one observation, and says whether it is new. `near` is where the last one was added: the next
    /// is often in the same block.
    #[inline]
    pub(crate) fn add(&mut self, near: &mut usize, feature: u32, state: bool) -> Added {
        let index = feature / BLOCK;
        let bit = 1_u64 << (feature % BLOCK);
        let at = match self.blocks.get(*near) {
            Some(block) if block.index == index => *near,
            _ => self.block_at(index),
        };
        *near = at;
        let block = &mut self.blocks[at];
        if block.observed & bit == 0 {
            block.observed |= bit;
            block.seen |= if state { bit } else { 0 };
            Added::New
        } else if (block.seen & bit != 0) == state {
            Added::Known
        } else {
            Added::Contradicts
        }
    }

    /// Where the block of this index is, which is made if there is none.
    fn block_at(&mut self, index: u32) -> usize {
        let at = match self.blocks.last() {
            Some(last) if last.index < index => self.blocks.len(),
            None => 0,
            Some(_) => match self
                .blocks
                .binary_search_by_key(&index, |block| block.index)
            {
                Ok(at) => return at,
                Err(at) => at,
            },
        };
        let (observed, seen) = (0, 0);
        self.blocks.insert(
            at,
            Block {
                index,
                observed,
                seen,
            },
        );
        at
    }

    /// Adds what `other` has; the feature of a state that both have and that differs is an error.
    pub(crate) fn merge(&mut self, other: &Self) -> Result<(), u32> {
        for theirs in &other.blocks {
            let at = self.block_at(theirs.index);
            let ours = &mut self.blocks[at];
            let differ = (ours.seen ^ theirs.seen) & ours.observed & theirs.observed;
            if differ != 0 {
                return Err(theirs.index * BLOCK + differ.trailing_zeros());
            }
            ours.observed |= theirs.observed;
            ours.seen |= theirs.seen;
        }
        Ok(())
    }

    pub(crate) fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// Features that were observed.
    pub fn num_observed(&self) -> usize {
        let ones = self
            .blocks
            .iter()
            .map(|it| it.observed.count_ones() as usize);
        ones.sum()
    }

    /// Each feature that was observed, ascending, and whether it was seen.
    pub fn iter(&self) -> impl Iterator<Item = (u32, bool)> + '_ {
        self.blocks.iter().flat_map(|block| {
            let bits = (0..BLOCK).filter(|bit| block.observed >> bit & 1 == 1);
            bits.map(|bit| (block.index * BLOCK + bit, block.seen >> bit & 1 == 1))
        })
    }

    /// As bytes: for each block a LEB128 integer of twice the distance from the block before, plus one if
    /// all 64 features were observed; unless they were, 8 bytes of what was observed; 8 of what was seen.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(10 * self.blocks.len());
        let mut next = 0;
        for block in &self.blocks {
            let is_whole = block.observed == u64::MAX;
            let mut head = u64::from(block.index - next) << 1 | u64::from(is_whole);
            while head >= 0x80 {
                bytes.push(head as u8 | 0x80);
                head >>= 7;
            }
            bytes.push(head as u8);
            if !is_whole {
                bytes.extend(block.observed.to_le_bytes());
            }
            bytes.extend(block.seen.to_le_bytes());
            next = block.index + 1;
        }
        bytes
    }

    /// What [`to_bytes`](Self::to_bytes) wrote; anything else is an error of kind
    /// [`ErrorKind::Format`].
    pub fn from_bytes(mut bytes: &[u8]) -> Result<Self> {
        let mut blocks = Vec::new();
        let mut next = 0_u64;
        while !bytes.is_empty() {
            let (head, rest) = head_of(bytes).ok_or_else(no_states)?;
            bytes = rest;
            let index = next + (head >> 1);
            let observed = if head & 1 == 1 {
                u64::MAX
            } else {
                let observed = word_of(&mut bytes).ok_or_else(no_states)?;
                // All of them are said by the head alone.
                if observed == u64::MAX {
                    return Err(no_states());
                }
                observed
            };
            let seen = word_of(&mut bytes).ok_or_else(no_states)?;
            let is_possible = observed != 0 && seen & !observed == 0;
            let index = u32::try_from(index).ok();
            // Numbers of features are below 2^31.
            let index = index.filter(|it| is_possible && *it < (1 << 31) / BLOCK);
            let index = index.ok_or_else(no_states)?;
            blocks.push(Block {
                index,
                observed,
                seen,
            });
            next = u64::from(index) + 1;
        }
        Ok(Self { blocks })
    }
}

impl FromIterator<(u32, bool)> for States {
    /// Of features below 2^31 and their states; of two states of one feature the first.
    fn from_iter<I: IntoIterator<Item = (u32, bool)>>(states: I) -> Self {
        let (mut all, mut near) = (Self::new(), 0);
        for (feature, state) in states {
            all.add(&mut near, feature, state);
        }
        all
    }
}

fn no_states() -> Error {
    Error::new(ErrorKind::Format, "these bytes are no states of a visit")
        .with_help("take them as `compact` has made them")
}

/// A LEB128 integer in as few bytes as it needs, and what comes after it.
fn head_of(bytes: &[u8]) -> Option<(u64, &[u8])> {
    let mut head = 0;
    for (i, &byte) in bytes.iter().enumerate().take(5) {
        head |= u64::from(byte & 0x7F) << (7 * i);
        if byte < 0x80 {
            let is_shortest = byte != 0 || i == 0;
            return is_shortest.then_some((head, &bytes[i + 1..]));
        }
    }
    None
}

fn word_of(bytes: &mut &[u8]) -> Option<u64> {
    let (word, rest) = bytes.split_first_chunk::<8>()?;
    *bytes = rest;
    Some(u64::from_le_bytes(*word))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(states: &[(u32, bool)]) -> States {
        let (mut all, mut near) = (States::new(), 0);
        for &(feature, state) in states {
            all.add(&mut near, feature, state);
        }
        all
    }

    #[test]
    fn bytes_give_back_the_states() {
        for states in [
            of(&[]),
            of(&[(0, true)]),
            of(&[(700, true), (3, false), ((1 << 31) - 1, true)]),
            of(&(0..64).map(|i| (i, i % 3 == 0)).collect::<Vec<_>>()),
        ] {
            let bytes = states.to_bytes();
            assert_eq!(States::from_bytes(&bytes).expect("own bytes"), states);
            for len in 0..bytes.len() {
                // A cut between two blocks leaves fewer states; elsewhere it is found.
                if let Ok(fewer) = States::from_bytes(&bytes[..len]) {
                    assert!(fewer.num_observed() < states.num_observed());
                }
            }
        }
        assert!(States::from_bytes(&[0xFF; 40]).is_err());
    }

    #[test]
    fn other_bytes_that_would_mean_the_same_are_refused() {
        let bytes = of(&[(0, true)]).to_bytes();
        // The head in two bytes.
        let longer = [&[0x80, 0][..], &bytes[1..]].concat();
        // All features as 8 bytes of ones.
        let spelt_out = [&[0][..], &[0xFF; 8], &[1; 8]].concat();
        for bytes in [longer, spelt_out] {
            let error = States::from_bytes(&bytes).expect_err("not as they are written");
            assert_eq!(error.kind(), ErrorKind::Format);
        }
    }

    #[test]
    fn the_same_again_changes_nothing_and_the_other_state_is_found() {
        let mut states = of(&[(5, true), (70, false)]);
        let before = states.clone();
        assert_eq!(states.add(&mut 9, 5, true), Added::Known);
        assert_eq!(states.add(&mut 0, 70, true), Added::Contradicts);
        assert_eq!(states, before);
        assert_eq!(states.merge(&before), Ok(()));
        assert_eq!(states.merge(&of(&[(1, true), (70, true)])), Err(70));
    }
}
