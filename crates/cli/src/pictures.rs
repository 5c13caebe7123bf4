//! What is done to a file before it is a query?
//!
//! [`PictureFinder`] says which pictures are in it and when they were taken; here they are decoded,
//! and given the size of the map's images.

use std::path::{Path, PathBuf};

use chronotope::dataset::{FoundPicture, PictureFinder, TimeSource};
use chronotope::error::Result;
use chronotope::feature::GrayImage;
use chronotope::map::PlaceKey;
use chronotope::time::Time;
use chronotope_terminal::reading::{Adjust, ReadingArgs};

/// What helps where nobody says when a picture was taken.
const TIME_HELP: &str = "give --time 2024-05-01T08:30:00Z, or --zone for an EXIF time without an \
                         offset, name the manifest with the rule of its file name by --manifest, or \
                         use --method static";

/// One picture to be located.
pub(super) struct Picture {
    /// How it is called in results.
    pub(super) name: String,
    /// The file it comes from.
    pub(super) file: Option<PathBuf>,
    /// What is done to the file, as `ImageSource::recipe` says it.
    pub(super) recipe: String,
    pub(super) image: GrayImage,
    pub(super) mask: Option<GrayImage>,
    pub(super) time: Option<(Time, TimeSource)>,
    /// The place that the index says it shows.
    pub(super) truth: Option<PlaceKey>,
}

/// Turns paths into pictures.
pub(super) struct Pictures {
    time: Option<Time>,
    needs_time: bool,
    adjust: Adjust,
    finder: PictureFinder,
}

impl Pictures {
    /// `manifest` is the name of a supported dataset, a manifest or a folder; images are scaled to
    /// `size` where they have its shape; `images` are those that will be queried.
    pub(super) fn new(
        images: &[PathBuf],
        time: Option<Time>,
        needs_time: bool,
        manifest: Option<&str>,
        reading: &ReadingArgs,
        size: Option<(u32, u32)>,
    ) -> Result<Self> {
        let finder = PictureFinder::new(reading.read_options())
            .with_names_of(images)
            .with_time_help(TIME_HELP);
        Ok(Self {
            time,
            needs_time,
            adjust: Adjust::new(reading.load_options(), size),
            finder: match manifest {
                Some(name) => finder.with_manifest(name)?,
                None => finder,
            },
        })
    }

    /// The pictures of a file: one, or as many as its index cuts out of it.
    pub(super) fn list(&self, path: &Path) -> Result<Vec<FoundPicture>> {
        self.finder.find(path)
    }

    /// Decodes a picture and finds out when it was taken.
    pub(super) fn load(&mut self, found: FoundPicture) -> Result<Picture> {
        let file = found.source.path();
        let taken = (self.finder).time_of(&found, self.time, self.needs_time)?;
        for warning in taken.warnings {
            note!("warning: {warning}");
        }
        // What cannot be read is said when it is decoded.
        if let Ok(Some(size)) = found.source.size() {
            self.adjust.check(size).map_err(|error| match &file {
                Some(file) => error.with_path(file),
                None => error,
            })?;
        }
        let (image, mask) = found.source.load_masked()?;
        let mut recipe = found.source.recipe();
        let (image, mask) = self.adjust.apply(image, mask, &mut recipe)?;
        Ok(Picture {
            name: found.name,
            recipe,
            file,
            image,
            mask,
            time: taken.time,
            truth: found.truth,
        })
    }
}
