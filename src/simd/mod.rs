//! Exact two nearest of 256 bits, and rows of images.
//!
//! One public way leads in: a [`Kernel`] writes the two nearest rows of [`PackedDescriptors`] for
//! each query ([`Kernel::nearest_two`]). What else the rooms above search and sum is their own
//! affair.
//!
//! Exact Hamming search: for a query `q` and train rows `t_0..t_m`, `d_j = popcount(q xor t_j)` in
//! bits, 0 to 256; the answer is the `j` with the smallest `(d_j, j)` and the one with the second
//! smallest. Work is `O(queries * rows)`, memory is the train rows once more, interleaved, or a
//! fixed block of the stack where they come as a slice.
//!
//! A [`Kernel`] is a value that exists only if the CPU can run it, so holding one is the proof that
//! its instructions are safe to execute. [`Kernel::scalar`] is the plain twin of all others.
//!
//! How a kernel works: 16 rows form a group of 512 bytes in which equal words of different rows lie
//! side by side, so that no lane is ever added to its neighbour. The 9-bit distance and the row's
//! number in its block form one 32-bit key `distance << 23 | row`; the unsigned minimum of keys is
//! then the nearest row *with* the tie rule, and best and second best cost one maximum and two
//! minima per 16 rows (with AVX-512 that holds for the first block; of later ones it only looks for
//! what is nearer still). Blocks of 1024 rows stay in the first-level cache while all queries pass
//! over them. The popcount instruction is the one of Muła, Kurz and Lemire, "Faster population
//! counts using AVX2 instructions" (2018) where the CPU has none for vectors.
//!
//! Invariants: every kernel returns the same bits as the scalar twin; ties go to the lowest row;
//! nothing is allocated except in [`PackedDescriptors`].
//!
//! Not for: other lengths than 256 bits, more than two neighbours, approximate search. The NEON
//! kernel was held against its twin under qemu (`scripts/neon.sh`), never timed on a real
//! processor.
#![allow(unsafe_code)] // reason: vector instructions are unsafe to call before the CPU is known to have them.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod bits256;
pub(crate) mod image;
mod kernel;
mod nearest;
#[cfg(target_arch = "aarch64")]
mod neon;
mod packed;
mod scalar;
mod search;
#[cfg(test)]
mod tests;

pub use bits256::Bits256;
pub use kernel::{KERNEL_VARIABLE, Kernel};
pub use nearest::NearestTwo;
pub use packed::PackedDescriptors;
