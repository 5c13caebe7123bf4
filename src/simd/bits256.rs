//! What must a descriptor be able to say for its distances to be taken?

/// 256 bits as four words; what a descriptor must be able to say for its distances to be taken.
pub trait Bits256: Copy {
    /// The bits; their order does not matter as long as it is always the same.
    fn words(&self) -> [u64; 4];
}

impl Bits256 for [u64; 4] {
    #[inline]
    fn words(&self) -> [u64; 4] {
        *self
    }
}
