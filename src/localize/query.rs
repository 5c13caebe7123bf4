//! What does the camera see?

use crate::feature::Features;
use fremen::time::Time;

/// A live image, as far as localisation needs it.
#[derive(Clone, Copy, Debug)]
pub struct Query<'a> {
    /// The features of the live image, by the extractor the map was learnt with.
    pub features: &'a Features,
    /// When it was taken; `static`, `experience` and `experience-all` do without.
    pub time: Option<Time>,
    /// Width and height of the image in px, to be compared with the map's.
    pub image_size: Option<(u32, u32)>,
}
