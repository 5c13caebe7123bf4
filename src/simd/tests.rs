//! Does every kernel of this CPU give the bits of plain oracles?

use proptest::prelude::*;

use super::{Kernel, NearestTwo, PackedDescriptors};

type Row = [u64; 4];

/// Rows with few different distances, so that ties are common, beside arbitrary ones.
fn row() -> impl Strategy<Value = Row> {
    prop_oneof![
        any::<Row>(),
        [0..3_u64, 0..3_u64, 0..2_u64, 0..2_u64],
        Just([0; 4]),
        Just([u64::MAX; 4]),
    ]
}

fn rows(max_len: usize) -> impl Strategy<Value = Vec<Row>> {
    prop::collection::vec(row(), 0..=max_len)
}

fn distance_bits(a: &Row, b: &Row) -> u32 {
    a.iter().zip(b).map(|(a, b)| (a ^ b).count_ones()).sum()
}

/// The two nearest by sorting all rows by (distance, row).
fn nearest_two_oracle(query: &Row, train: &[Row]) -> NearestTwo {
    let mut rows: Vec<(u32, u32)> = train
        .iter()
        .zip(0..)
        .map(|(row, id)| (distance_bits(query, row), id))
        .collect();
    rows.sort_unstable();
    let mut nearest = NearestTwo::EMPTY;
    if let Some(&(bits, id)) = rows.first() {
        (nearest.best, nearest.best_bits) = (id, bits as u16);
    }
    if let Some(&(bits, id)) = rows.get(1) {
        (nearest.second, nearest.second_bits) = (id, bits as u16);
    }
    nearest
}

fn nearest_two_of_all(queries: &[Row], train: &[Row]) -> Vec<NearestTwo> {
    queries
        .iter()
        .map(|query| nearest_two_oracle(query, train))
        .collect()
}

proptest! {
    #[test]
    fn every_kernel_finds_what_sorting_finds(
        queries in rows(70),
        train in rows(100),
    ) {
        let expected = nearest_two_of_all(&queries, &train);
        let packed = PackedDescriptors::pack(&train);
        for kernel in Kernel::available() {
            let mut out = vec![NearestTwo::EMPTY; queries.len()];
            kernel.nearest_two(&queries, &packed, &mut out);
            prop_assert_eq!(&out, &expected, "{}", kernel);
        }
    }

    #[test]
    fn rows_within_are_those_that_are_near(
        query in row(),
        train in rows(70),
        first in 0_usize..70,
        len in 0_usize..70,
        max_bits in 0_u16..=256,
    ) {
        let packed = PackedDescriptors::pack(&train);
        let rows = first.min(train.len())..(first + len).min(train.len());
        let expected: Vec<(u32, u16)> = rows
            .clone()
            .map(|row| (row as u32, distance_bits(&query, &train[row]) as u16))
            .filter(|&(_, bits)| bits <= max_bits)
            .collect();
        for kernel in Kernel::available() {
            let mut found = Vec::new();
            kernel.rows_within(&query, &packed, rows.clone(), max_bits, |row, bits| {
                found.push((row, bits));
            });
            prop_assert_eq!(&found, &expected, "{}", kernel);
        }
    }

    #[test]
    fn every_kernel_measures_every_distance(query in row(), train in rows(70)) {
        let expected: Vec<_> = train.iter().map(|row| distance_bits(&query, row) as u16).collect();
        let packed = PackedDescriptors::pack(&train);
        for kernel in Kernel::available() {
            let mut out = vec![0; train.len()];
            kernel.distances_into(&query, &packed, &mut out);
            prop_assert_eq!(&out, &expected, "{}", kernel);
        }
    }

    #[test]
    fn parts_are_searched_as_if_each_were_all(
        queries in rows(40),
        parts in prop::collection::vec(rows(40), 0..8),
        large in 0_usize..300,
    ) {
        let mut parts = parts;
        if let Some(first) = parts.first_mut() {
            // More rows than wait on the stack at once.
            let rows: Vec<Row> = (0..large as u64).map(|i| [i, i / 7, 0, 1]).collect();
            first.extend(rows);
        }
        let rows = parts.concat();
        let ends: Vec<usize> = parts.iter().scan(0, |end, part| {
            *end += part.len();
            Some(*end)
        }).collect();
        let packed = PackedDescriptors::pack(&queries);
        for kernel in Kernel::available() {
            let mut state = vec![NearestTwo::EMPTY; queries.len()];
            let mut num_parts = 0;
            kernel.nearest_two_of_parts(&packed, &rows, &ends, &mut state, |part, state| {
                assert_eq!(part, num_parts);
                assert_eq!(state, nearest_two_of_all(&queries, &parts[part]), "{kernel}");
                num_parts += 1;
            });
            prop_assert_eq!(num_parts, parts.len());
        }
    }

    #[test]
    fn rows_out_of_many_are_searched_as_if_they_were_all(
        queries in rows(9),
        train in rows(90),
        first in 0_usize..90,
        len in 0_usize..60,
    ) {
        let rows = first.min(train.len())..(first + len).min(train.len());
        let moved = |id: u32| if id == NearestTwo::NONE { id } else { id + rows.start as u32 };
        let mut expected = nearest_two_of_all(&queries, &train[rows.clone()]);
        for found in &mut expected {
            (found.best, found.second) = (moved(found.best), moved(found.second));
        }
        let packed = PackedDescriptors::pack(&train);
        for kernel in Kernel::available() {
            let mut out = vec![NearestTwo::EMPTY; queries.len()];
            kernel.nearest_two_of_rows(&queries, &packed, rows.clone(), &mut out);
            prop_assert_eq!(&out, &expected, "{}", kernel);
        }
    }

    #[test]
    fn every_kernel_sums_every_distance(queries in rows(11), train in rows(90)) {
        let expected: u64 = queries
            .iter()
            .flat_map(|query| train.iter().map(|row| u64::from(distance_bits(query, row))))
            .sum();
        let packed = PackedDescriptors::pack(&train);
        for kernel in Kernel::available() {
            prop_assert_eq!(kernel.sum_of_distances(&queries, &packed), expected, "{}", kernel);
        }
    }

    #[test]
    fn prefixes_in_one_pass_equal_separate_searches(
        queries in rows(6),
        train in rows(90),
        mut checkpoints in prop::collection::vec(0..100_usize, 0..8),
    ) {
        checkpoints.sort_unstable();
        let expected: Vec<_> = checkpoints
            .iter()
            .map(|&count| nearest_two_of_all(&queries, &train[..count.min(train.len())]))
            .collect();
        for kernel in Kernel::available() {
            let mut state = vec![NearestTwo::EMPTY; queries.len()];
            let mut seen = Vec::new();
            kernel.nearest_two_prefixes(&queries, &train, &checkpoints, &mut state, |c, now| {
                assert_eq!(c, seen.len());
                seen.push(now.to_vec());
            });
            prop_assert_eq!(&seen, &expected, "{}", kernel);
        }
    }
}

#[test]
fn kernels_agree_across_block_borders() {
    // Larger than the blocks of slices (512) and of packed rows (1024); equal rows on both sides of
    // a border, so that a tie spans it.
    let mut train: Vec<Row> = (0..2100_u64)
        .map(|row| {
            let word = |w: u64| (row * 4 + w + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
            [word(0), word(1), word(2), word(3)]
        })
        .collect();
    for (first, second) in [(511, 512), (1023, 1024), (100, 2099)] {
        train[second] = train[first];
    }
    let queries: Vec<_> = [511, 1023, 100, 2098, 0]
        .map(|row: usize| train[row])
        .into_iter()
        .chain((0..70_u64).map(|q| [q, !q, q << 7, q << 50]))
        .collect();
    let expected = nearest_two_of_all(&queries, &train);
    assert_eq!((expected[0].best, expected[0].second), (511, 512));
    every_kernel_says(&expected, &queries, &train);
}

fn every_kernel_says(expected: &[NearestTwo], queries: &[Row], train: &[Row]) {
    let packed = PackedDescriptors::pack(train);
    for kernel in Kernel::available() {
        let mut out = vec![NearestTwo::EMPTY; queries.len()];
        kernel.nearest_two(queries, &packed, &mut out);
        assert_eq!(out, expected, "{kernel}");
    }
}

#[test]
fn kernels_agree_where_rows_come_nearer_and_nearer() {
    // More rows at the greatest distance than a block has, then three at each distance down to 0:
    // every group has rows that are nearer than all before, and ties.
    let queries: Vec<_> = (0..8_u64)
        .map(|q| [q, q << 20, !q, q.wrapping_mul(0x9E37_79B9_7F4A_7C15)])
        .collect();
    let at_distance = |query: &Row, bits: usize| {
        let mut row = *query;
        for bit in 0..bits {
            row[bit / 64] ^= 1 << (bit % 64);
        }
        row
    };
    let distances =
        std::iter::repeat_n(256, 1030).chain((0..=256).rev().flat_map(|bits| [bits; 3]));
    let train: Vec<_> = distances
        .map(|bits| at_distance(&queries[0], bits))
        .collect();
    let expected = nearest_two_of_all(&queries, &train);
    let last = train.len() as u32 - 3;
    assert_eq!((expected[0].best, expected[0].second), (last, last + 1));
    every_kernel_says(&expected, &queries, &train);
}

#[test]
fn no_row_and_one_row_have_defined_answers() {
    for kernel in Kernel::available() {
        let mut out = [NearestTwo::default(); 1];
        kernel.nearest_two(&[[1, 0, 0, 0]], &PackedDescriptors::new(), &mut out);
        assert_eq!(out[0], NearestTwo::EMPTY);
        let one = PackedDescriptors::pack(&[[u64::MAX; 4]]);
        kernel.nearest_two(&[[1, 0, 0, 0]], &one, &mut out);
        assert_eq!((out[0].best, out[0].best_bits), (0, 255));
        assert!(!out[0].has_second());
        assert_eq!(out[0].second_bits, NearestTwo::NO_DISTANCE_BITS);
    }
}

#[test]
fn the_greatest_distance_fits_its_key() {
    for kernel in Kernel::available() {
        let mut out = [NearestTwo::default(); 3];
        let rows = PackedDescriptors::pack(&[[u64::MAX; 4]; 40]);
        kernel.nearest_two(&[[0; 4]; 3], &rows, &mut out);
        for nearest in out {
            assert_eq!((nearest.best, nearest.best_bits), (0, 256), "{kernel}");
            assert_eq!((nearest.second, nearest.second_bits), (1, 256), "{kernel}");
        }
    }
}
