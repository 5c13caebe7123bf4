//! What can pictures show of a run, beside its numbers?

use chronotope::Time;
use chronotope::localize::{Localizer, Method};

use crate::data::{ExtractedDataset, Fold};
use crate::results::{SuiteResults, Variant};

/// One localizer with the first fold that it answered.
#[derive(Debug)]
pub struct Showcase {
    /// The variant that the localizer runs.
    pub variant: Variant,
    /// Its localizer in the first fold.
    pub localizer: Localizer,
    /// The first fold.
    pub fold: Fold,
    /// When each entry was taken, by the arm's clock.
    pub times: Vec<Time>,
    /// The strongest features of an image that are used.
    pub num_live: usize,
}

impl Showcase {
    /// Whether another localizer has more to show: the shipped default, else a method that knows of
    /// time.
    pub(crate) fn is_less_than(&self, other: &Localizer, is_default: bool) -> bool {
        is_default
            || (other.cfg().method() == Method::Fremen
                && self.localizer.cfg().method() == Method::Static)
    }
}

/// A suite that was run.
#[derive(Debug)]
pub struct SuiteRun {
    /// The numbers of the run.
    pub results: SuiteResults,
    /// What pictures can show of it, with the images that they are of.
    pub shown: Option<Shown>,
}

/// A showcase and its images.
#[derive(Debug)]
pub struct Shown {
    /// The localizer with its fold.
    pub showcase: Showcase,
    /// The images of its fold.
    pub data: ExtractedDataset,
    /// What the ids of their queries begin with, where one dataset of several is shown.
    pub prefix: Option<String>,
}
