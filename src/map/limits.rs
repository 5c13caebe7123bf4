//! How much may a map hold?

/// Features of one place, at most; experiences, too.
pub(super) const MAX_FEATURES: usize = 1 << 20;
/// Bytes of one text, at most.
pub(crate) const MAX_TEXT_BYTES: usize = 4096;
/// Bytes of the name of an attachment, at most.
pub(super) const MAX_ATTACHMENT_NAME_BYTES: usize = 64;
/// Bytes of an attachment, at most.
pub(super) const MAX_ATTACHMENT_BYTES: usize = 1 << 24;
/// Bytes of a keypoint: four 32-bit floats.
pub(super) const KEYPOINT_BYTES: usize = 16;
/// Bytes of a descriptor.
pub(super) const DESCRIPTOR_BYTES: usize = 32;
