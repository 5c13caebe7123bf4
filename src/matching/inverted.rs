//! Which rows of a large set are nearest, without a distance to each of them?
//!
//! An [`InvertedFile`] puts every row into the list of its nearest centroid and searches the lists
//! of the `probes` centroids that are nearest to the query. With `m` rows in `c` lists a query
//! costs `c + m * probes / c` distances instead of `m`; `c` near `4 sqrt(m)` is a good start.
//! Centroids are the majority, bit by bit, of the rows of their list, found by a few rounds of
//! Lloyd's algorithm on a sample (k-means for Hamming distance; Sivic and Zisserman's inverted
//! file, ICCV 2003, over binary words).
//!
//! Queries are not answered one after the other: all that probe one list go over it together, so
//! that a list is read once and the kernels' several queries a pass are used.
//!
//! [`NearestNeighbours`] is what both this and the [`ExactSearch`] answer; the exact one is the
//! oracle, and the inverted file equals it where `probes` is the number of lists.
//!
//! Invariants: the answer depends on rows, configuration and query alone, not on the kernel or the
//! other queries; ties go to the lowest row; nothing is allocated once a [`SearchScratch`] has seen
//! the largest input. Memory: 36 bytes a row, and 7 empty rows a list on average.
//!
//! Not for: sets under some ten thousand rows, where the exact search is as fast, and rows that
//! come and go: it is built once.

use crate::feature::Descriptor;
use crate::simd::{Kernel, NearestTwo, PackedDescriptors};
use fremen::error::{Error, ErrorKind, Result};

/// Rows that a list begins at a multiple of, so that no two lists share a group of a kernel.
const ALIGNMENT: usize = 16;
/// Rows that a centroid is learnt from.
const SAMPLES_PER_LIST: usize = 32;
/// Rounds of Lloyd's algorithm.
const ROUNDS: usize = 6;

/// Finds the two nearest rows of a fixed set for each of many queries.
pub trait NearestNeighbours: Send + Sync {
    /// Writes the two nearest rows found for `queries[i]` to `out[i]`.
    ///
    /// # Panics
    /// If `out` has another length than `queries`.
    fn nearest_two_into(
        &self,
        scratch: &mut SearchScratch,
        queries: &[Descriptor],
        out: &mut [NearestTwo],
    );

    /// How many rows there are.
    fn num_rows(&self) -> usize;
}

/// Memory that a search works in; owned by the caller and used again and again.
#[derive(Clone, Debug, Default)]
pub struct SearchScratch {
    distances: Vec<u16>,
    /// (list, query), by list and then by query.
    visits: Vec<(u32, u32)>,
    queries: Vec<Descriptor>,
    found: Vec<NearestTwo>,
}

/// Compares a query with every row.
#[derive(Clone, Debug)]
pub struct ExactSearch {
    rows: PackedDescriptors,
    kernel: Kernel,
}

impl ExactSearch {
    /// Over `rows`, with the fastest kernel of this CPU.
    pub fn new(rows: &[Descriptor]) -> Self {
        Self {
            rows: PackedDescriptors::pack(rows),
            kernel: Kernel::best(),
        }
    }
}

impl NearestNeighbours for ExactSearch {
    fn nearest_two_into(
        &self,
        _: &mut SearchScratch,
        queries: &[Descriptor],
        out: &mut [NearestTwo],
    ) {
        self.kernel.nearest_two(queries, &self.rows, out);
    }

    fn num_rows(&self) -> usize {
        self.rows.len()
    }
}

/// Centroids of descriptors: a descriptor's *word* is its nearest one.
#[derive(Clone, Debug)]
pub struct BinaryWords {
    centroids: PackedDescriptors,
    kernel: Kernel,
}

impl BinaryWords {
    /// At most `num_words`, learnt from `rows`; none if there are no rows.
    pub fn learn(rows: &[Descriptor], num_words: usize) -> Self {
        Self::with_kernel(rows, num_words, Kernel::best())
    }

    fn with_kernel(rows: &[Descriptor], num_words: usize, kernel: Kernel) -> Self {
        Self {
            centroids: PackedDescriptors::pack(&learn_centroids(rows, num_words, kernel)),
            kernel,
        }
    }

    /// Of these centroids, as [`centroids`](Self::centroids) gave them.
    pub fn from_centroids(centroids: &[Descriptor]) -> Self {
        Self {
            centroids: PackedDescriptors::pack(centroids),
            kernel: Kernel::best(),
        }
    }

    /// All of them, in order.
    pub fn centroids(&self) -> impl Iterator<Item = Descriptor> + '_ {
        (0..self.len()).map(|word| Descriptor(self.centroids.row(word)))
    }

    /// How many words there are.
    pub fn len(&self) -> usize {
        self.centroids.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.centroids.is_empty()
    }

    /// Appends the word of each of `rows`, ties by the lowest word, to `out`.
    pub fn words_into(&self, scratch: &mut SearchScratch, rows: &[Descriptor], out: &mut Vec<u32>) {
        let found = &mut scratch.found;
        found.resize(rows.len(), NearestTwo::EMPTY);
        (self.kernel).nearest_two(rows, &self.centroids, found);
        out.extend(found.iter().map(|found| found.best));
    }
}

/// Compares a query with the rows in the lists of its nearest centroids.
#[derive(Clone, Debug)]
pub struct InvertedFile {
    words: BinaryWords,
    /// All rows, list by list, each list from a multiple of [`ALIGNMENT`] on.
    rows: PackedDescriptors,
    /// The number of each row of `rows`; [`NearestTwo::NONE`] of those that fill a list up.
    ids: Vec<u32>,
    /// First row and number of rows of each list.
    lists: Vec<(usize, usize)>,
    num_rows: usize,
    probes: usize,
    kernel: Kernel,
}

fn positive(name: &str, count: usize) -> Result<usize> {
    if count == 0 {
        return Err(Error::new(
            ErrorKind::Config,
            format!("an inverted file cannot have 0 {name}"),
        )
        .with_help("begin with 4 sqrt(rows) lists and 32 probes"));
    }
    Ok(count)
}

impl InvertedFile {
    /// Over `rows` in at most `num_lists` lists, of which `probes` are searched.
    ///
    /// Either count at 0 is an [`ErrorKind::Config`] error; more lists than rows are as many as
    /// rows.
    pub fn new(rows: &[Descriptor], num_lists: usize, probes: usize) -> Result<Self> {
        Self::with_kernel(rows, num_lists, probes, Kernel::best())
    }

    /// With a given kernel; the answers are the same for all.
    pub fn with_kernel(
        rows: &[Descriptor],
        num_lists: usize,
        probes: usize,
        kernel: Kernel,
    ) -> Result<Self> {
        for (name, value) in [("lists", num_lists), ("probes", probes)] {
            positive(name, value)?;
        }
        let words = BinaryWords::with_kernel(rows, num_lists, kernel);
        let mut lists_of = Vec::with_capacity(rows.len());
        words.words_into(&mut SearchScratch::default(), rows, &mut lists_of);
        Ok(Self::of_words(rows, words, &lists_of, probes))
    }

    /// Over `rows` whose words are known: `lists_of` are those that
    /// [`words_into`](BinaryWords::words_into) says. Takes `O(rows)` time.
    ///
    /// # Panics
    /// If `lists_of` has another length than `rows` or names a word that is not there.
    pub fn of_words(
        rows: &[Descriptor],
        words: BinaryWords,
        lists_of: &[u32],
        probes: usize,
    ) -> Self {
        assert_eq!(rows.len(), lists_of.len(), "one word per row");
        let mut lists = vec![(0, 0); words.len()];
        for &list in lists_of {
            lists[list as usize].1 += 1;
        }
        let mut end = 0_usize;
        for (start, len) in &mut lists {
            *start = end;
            end = (end + *len).next_multiple_of(ALIGNMENT);
        }
        let mut next: Vec<usize> = lists.iter().map(|&(start, _)| start).collect();
        let mut ids = vec![NearestTwo::NONE; end];
        let mut sorted = vec![Descriptor::default(); end];
        for ((id, row), &list) in (0..).zip(rows).zip(lists_of) {
            let at = &mut next[list as usize];
            (ids[*at], sorted[*at]) = (id, *row);
            *at += 1;
        }
        Self {
            kernel: words.kernel,
            words,
            rows: PackedDescriptors::pack(&sorted),
            ids,
            lists,
            num_rows: rows.len(),
            probes: probes.max(1),
        }
    }

    /// The same with another number of lists searched; 0 is an [`ErrorKind::Config`] error.
    pub fn with_probes(mut self, probes: usize) -> Result<Self> {
        self.probes = positive("probes", probes)?;
        Ok(self)
    }

    /// How many lists there are.
    pub fn num_lists(&self) -> usize {
        self.lists.len()
    }

    /// Calls `found(query, row, bits)` for every row within `max_bits` of some query, among the
    /// lists searched for it; a row that is near to several queries is named several times. By
    /// list, query and row.
    pub fn rows_within(
        &self,
        scratch: &mut SearchScratch,
        queries: &[Descriptor],
        max_bits: u16,
        mut found: impl FnMut(u32, u32, u16),
    ) {
        self.visits_into(scratch, queries);
        for &(list, query) in &scratch.visits {
            let (start, len) = self.lists[list as usize];
            (self.kernel).rows_within(
                &queries[query as usize],
                &self.rows,
                start..start + len,
                max_bits,
                |row, bits| found(query, self.ids[row as usize], bits),
            );
        }
    }

    /// Which lists are searched for which query, by list and then by query.
    fn visits_into(&self, scratch: &mut SearchScratch, queries: &[Descriptor]) {
        let SearchScratch {
            distances, visits, ..
        } = scratch;
        let centroids = &self.words.centroids;
        distances.resize(centroids.len(), 0);
        visits.clear();
        for (id, query) in (0..).zip(queries) {
            self.kernel.distances_into(query, centroids, distances);
            self.choose_lists(id, distances, visits);
        }
        visits.sort_unstable();
    }

    /// Appends (list, `query`) of the lists to search: those whose centroids are nearest, ties by
    /// list.
    fn choose_lists(&self, query: u32, distances: &[u16], visits: &mut Vec<(u32, u32)>) {
        let mut counts = [0_usize; 257];
        for &bits in distances {
            counts[usize::from(bits)] += 1;
        }
        let mut below = 0;
        let mut last_bits = 256;
        for (bits, count) in counts.iter().enumerate() {
            if below + count >= self.probes {
                last_bits = bits;
                break;
            }
            below += count;
        }
        let mut left_at_last = self.probes.saturating_sub(below);
        for (list, &bits) in (0..).zip(distances) {
            let bits = usize::from(bits);
            let is_last = bits == last_bits && left_at_last > 0;
            if bits < last_bits || is_last {
                left_at_last -= usize::from(is_last);
                visits.push((list, query));
            }
        }
    }
}

impl NearestNeighbours for InvertedFile {
    fn nearest_two_into(
        &self,
        scratch: &mut SearchScratch,
        queries: &[Descriptor],
        out: &mut [NearestTwo],
    ) {
        assert_eq!(queries.len(), out.len(), "one answer per query");
        out.fill(NearestTwo::EMPTY);
        self.visits_into(scratch, queries);
        let SearchScratch {
            visits,
            queries: of_list,
            found,
            ..
        } = scratch;
        for visits in visits.chunk_by(|a, b| a.0 == b.0) {
            let (start, len) = self.lists[visits[0].0 as usize];
            of_list.clear();
            of_list.extend(visits.iter().map(|&(_, query)| queries[query as usize]));
            found.resize(of_list.len(), NearestTwo::EMPTY);
            self.kernel
                .nearest_two_of_rows(of_list, &self.rows, start..start + len, found);
            for (&(_, query), found) in visits.iter().zip(&*found) {
                let state = &mut out[query as usize];
                for (row, bits) in [
                    (found.best, found.best_bits),
                    (found.second, found.second_bits),
                ] {
                    if let Some(&id) = self.ids.get(row as usize) {
                        integrate(state, id, bits);
                    }
                }
            }
        }
    }

    fn num_rows(&self) -> usize {
        self.num_rows
    }
}

/// Takes row `id` at `bits` into the two smallest of (bits, id).
fn integrate(state: &mut NearestTwo, id: u32, bits: u16) {
    if (bits, id) < (state.best_bits, state.best) {
        (state.second, state.second_bits) = (state.best, state.best_bits);
        (state.best, state.best_bits) = (id, bits);
    } else if (bits, id) < (state.second_bits, state.second) {
        (state.second, state.second_bits) = (id, bits);
    }
}

/// At most `num_lists` centroids of `rows`, the same for every kernel.
fn learn_centroids(rows: &[Descriptor], num_lists: usize, kernel: Kernel) -> Vec<Descriptor> {
    let num_lists = num_lists.min(rows.len());
    let num_samples = (num_lists * SAMPLES_PER_LIST).min(rows.len());
    let spread = |count: usize| {
        let len = rows.len() as u128;
        (0..count).map(move |i| rows[(i as u128 * len / count.max(1) as u128) as usize])
    };
    let samples: Vec<Descriptor> = spread(num_samples).collect();
    let mut centroids: Vec<Descriptor> = spread(num_lists).collect();
    let mut packed = PackedDescriptors::new();
    let mut nearest = vec![NearestTwo::EMPTY; num_samples];
    let mut members = vec![0_u32; num_lists];
    let mut ones = vec![[0_u32; 256]; num_lists];
    for _ in 0..ROUNDS {
        packed.repack(&centroids);
        kernel.nearest_two(&samples, &packed, &mut nearest);
        members.fill(0);
        ones.fill([0; 256]);
        for (sample, found) in samples.iter().zip(&nearest) {
            let list = found.best as usize;
            members[list] += 1;
            for (word, counts) in sample.0.iter().zip(ones[list].as_chunks_mut::<64>().0) {
                for (bit, count) in counts.iter_mut().enumerate() {
                    *count += (word >> bit & 1) as u32;
                }
            }
        }
        // A list that nothing fell into keeps its centroid.
        for ((centroid, &members), ones) in centroids.iter_mut().zip(&members).zip(&ones) {
            if members > 0 {
                for (word, counts) in centroid.0.iter_mut().zip(ones.as_chunks::<64>().0) {
                    let majority =
                        |(bit, &count): (usize, &u32)| u64::from(2 * count > members) << bit;
                    *word = counts.iter().enumerate().map(majority).sum();
                }
            }
        }
    }
    centroids
}
