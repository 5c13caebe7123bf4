//! Which images are learnt and which are queried, and what features do they have?

mod features;
mod folds;
mod images;
mod nearness;
mod opened;
mod worlds;

pub(crate) use features::extractor;
pub use features::{Extracted, ExtractedDataset};
pub use folds::{Fold, folds};
pub(crate) use folds::{photograph, split_at, visit_numbers, without_duplicates};
pub(crate) use images::{Images, extracted, images};
pub(crate) use nearness::{Nearness, route, ways};
pub(crate) use worlds::{Worlds, prefix};
