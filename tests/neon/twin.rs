//! The NEON kernel against its scalar twin, on a processor or an emulator that has it:
//! `scripts/neon.sh`.

use crate::simd::{Kernel, NearestTwo, PackedDescriptors};

/// Row counts around the borders of groups, tiles and blocks.
const NUM_ROWS: [usize; 13] = [0, 1, 2, 15, 16, 17, 31, 63, 130, 513, 1024, 1025, 2100];

/// Steele, Lea and Flood's `SplitMix64`.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    fn below(&mut self, limit: usize) -> usize {
        (self.next() >> 11) as usize % limit
    }

    /// Of four sorts: any bits, few bits, all or no bits of a word, nearly equal rows with many
    /// ties.
    fn rows(&mut self, count: usize, sort: usize) -> Vec<[u64; 4]> {
        let mut word = || match sort {
            0 => self.next(),
            1 => self.next() & self.next() & self.next() & self.next(),
            2 => [0, u64::MAX][self.below(2)],
            _ => self.next() % 3,
        };
        (0..count)
            .map(|_| std::array::from_fn(|_| word()))
            .collect()
    }
}

#[test]
fn the_neon_kernel_gives_the_bits_of_its_scalar_twin() {
    let kernels: Vec<Kernel> = Kernel::available().collect();
    let [scalar, neon] = kernels[..] else {
        panic!("not a machine with NEON: {kernels:?}");
    };
    assert_eq!(neon.name(), "neon");
    let mut random = Random(1);
    for round in 0..400 {
        let sort = round % 4;
        let queries = random.rows(round * 7 % 83, sort);
        let num_rows = NUM_ROWS[random.below(NUM_ROWS.len())];
        let rows = random.rows(num_rows, sort);
        let start = random.below(num_rows + 1);
        let end = start + random.below(num_rows - start + 1);
        let both = |answer: &dyn Fn(Kernel, &mut [NearestTwo]) -> Vec<Vec<NearestTwo>>| {
            [scalar, neon].map(|kernel| {
                let mut found = vec![NearestTwo::EMPTY; queries.len()];
                let parts = answer(kernel, &mut found);
                (found, parts)
            })
        };
        let packed = PackedDescriptors::pack(&rows);
        let [a, b] = both(&|kernel, found| {
            kernel.nearest_two(&queries, &packed, found);
            Vec::new()
        });
        assert_eq!(a, b);
        let [a, b] = both(&|kernel, found| {
            kernel.nearest_two_of_rows(&queries, &packed, start..end, found);
            Vec::new()
        });
        assert_eq!(a, b);
        let [a, b] = both(&|kernel, found| {
            let mut parts = Vec::new();
            let ends = [start, end, num_rows];
            kernel.nearest_two_prefixes(&queries, &rows, &ends, found, |_, state| {
                parts.push(state.to_vec());
            });
            parts
        });
        assert_eq!(a, b);
        let lanes = PackedDescriptors::pack(&queries);
        let [a, b] = both(&|kernel, found| {
            let mut parts = Vec::new();
            let ends = [start, end, num_rows];
            kernel.nearest_two_of_parts(&lanes, &rows, &ends, found, |_, state| {
                parts.push(state.to_vec());
            });
            parts
        });
        assert_eq!(a, b);
        for query in &queries {
            let distances = [scalar, neon].map(|kernel| {
                let mut distances = vec![0; num_rows];
                kernel.distances_into(query, &packed, &mut distances);
                let mut near = Vec::new();
                kernel.rows_within(query, &packed, start..end, 110, |row, bits| {
                    near.push((row, bits));
                });
                (distances, near)
            });
            assert_eq!(distances[0], distances[1]);
        }
        let sums = [scalar, neon].map(|kernel| kernel.sum_of_distances(&queries, &packed));
        assert_eq!(sums[0], sums[1]);
    }
}
