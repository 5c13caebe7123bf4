//! Where was this image taken, for C?

use std::ffi::{CString, c_char};
use std::path::Path;

use engine::Time;
use engine::feature::{Extractor, ExtractorConfig, Features};
use engine::localize::{
    IndexCache, Localization, Localizer, LocalizerConfig, Preset, Query, Scratch,
};

use crate::answer::{ChronotopeAnswer, ChronotopeCandidate};
use crate::image::ChronotopeImage;
use crate::map::{name, names_of};
use crate::status::{
    ChronotopeStatus, Failure, boxed, freed, guarded, shared, text, unique, written,
};

/// A time that nobody knows: methods without rhythms need none.
pub const CHRONOTOPE_NO_TIME: i64 = i64::MIN;

/// A map that answers.
pub struct ChronotopeLocalizer {
    localizer: Localizer,
    extractor: Box<dyn Extractor>,
    names: Vec<CString>,
}

/// What one thread works in: memory, the features of its last image, and its last answer.
#[derive(Debug)]
pub struct ChronotopeScratch {
    scratch: Scratch,
    features: Features,
    size: (u32, u32),
    answer: Localization,
}

/// One feature of an image.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChronotopeFeature {
    /// The column of its middle, px.
    pub x: f32,
    /// The row of its middle, px.
    pub y: f32,
    /// How large it is, px.
    pub size: f32,
    /// How strong it is.
    pub response: f32,
    /// Its 256 bits, 64 at a time.
    pub descriptor: [u64; 4],
}

pub(crate) fn time_of(time_us: i64) -> Option<Time> {
    (time_us != CHRONOTOPE_NO_TIME).then(|| Time::from_us(time_us))
}

/// The numbers of the preset that the map was built with, at a risk of its own if one is given.
pub(crate) fn config(path: &Path, risk: f64) -> Result<LocalizerConfig, Failure> {
    let meta = engine::map::MapMeta::read(path)?;
    let preset: Preset = meta.preset.parse().unwrap_or(Preset::Default);
    let cfg = LocalizerConfig::preset(preset);
    Ok(if risk < 0.0 { cfg } else { cfg.with_risk(risk) })
}

/// Opens a map file for answers. `risk` is how often an answer may name a wrong place, from 0 to 1;
/// negative: the default. Any thread; takes as long as the map is large.
///
/// # Safety
///
/// `path` is a text that ends in a zero, and `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_localizer_open(
    path: *const c_char,
    risk: f64,
    out: *mut *mut ChronotopeLocalizer,
) -> ChronotopeStatus {
    guarded(|| {
        let path = Path::new(text(path)?);
        let localizer = Localizer::open_with(path, config(path, risk)?, IndexCache::default())?;
        let extractor =
            ExtractorConfig::from_id(&localizer.snapshot().meta().extractor)?.build()?;
        let names = names_of(localizer.snapshot());
        boxed(
            out,
            ChronotopeLocalizer {
                localizer,
                extractor,
                names,
            },
        )
    })
}

/// Frees it; NULL is nothing. Not while another thread uses it.
///
/// # Safety
///
/// `localizer` is NULL or comes from `chronotope_localizer_open` and was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_localizer_free(localizer: *mut ChronotopeLocalizer) {
    freed(localizer);
}

/// The name of a place, which lives as long as the localizer. Any number of threads at once.
///
/// # Safety
///
/// `localizer` is NULL or was not freed, and `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_localizer_place_name(
    localizer: *const ChronotopeLocalizer,
    node: usize,
    out: *mut *const c_char,
) -> ChronotopeStatus {
    guarded(|| written(out, name(&shared(localizer)?.names, node)?))
}

/// What one thread works in. Any number of threads at once; it may outlive the localizer, and be
/// used with another.
///
/// # Safety
///
/// `localizer` is NULL or was not freed, and `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_scratch_new(
    localizer: *const ChronotopeLocalizer,
    out: *mut *mut ChronotopeScratch,
) -> ChronotopeStatus {
    guarded(|| {
        let scratch = ChronotopeScratch {
            scratch: shared(localizer)?.localizer.scratch(),
            features: Features::new(),
            size: (0, 0),
            answer: Localization::default(),
        };
        boxed(out, scratch)
    })
}

/// Frees it; NULL is nothing. Not while another thread uses it.
///
/// # Safety
///
/// `scratch` is NULL or comes from `chronotope_scratch_new` and was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_scratch_free(scratch: *mut ChronotopeScratch) {
    freed(scratch);
}

/// Finds the features of an image, and keeps them in the scratch. Any number of threads at once,
/// each with its own scratch.
///
/// # Safety
///
/// The handles are NULL or were not freed, and no other thread uses the scratch meanwhile; the
/// image's bytes can be read as it says.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_extract(
    localizer: *const ChronotopeLocalizer,
    scratch: *mut ChronotopeScratch,
    image: *const ChronotopeImage,
) -> ChronotopeStatus {
    guarded(|| {
        let (localizer, scratch) = (shared(localizer)?, unique(scratch)?);
        let pixels = shared(image)?.read()?;
        extract(localizer, scratch, pixels.view()).map_err(Failure::from)
    })
}

fn extract(
    localizer: &ChronotopeLocalizer,
    scratch: &mut ChronotopeScratch,
    image: engine::feature::GrayView<'_>,
) -> engine::Result<()> {
    scratch.size = image.size();
    (localizer.extractor).extract_into(image, None, &mut scratch.features)
}

/// Says where an image was taken: `chronotope_extract`, then `chronotope_localize_features`.
///
/// `time_us` is when it was taken. An image of another size than the map's is a status of SHAPE. Any
/// number of threads at once, each with its own scratch.
///
/// # Safety
///
/// As for `chronotope_extract`; `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_localize(
    localizer: *const ChronotopeLocalizer,
    scratch: *mut ChronotopeScratch,
    image: *const ChronotopeImage,
    time_us: i64,
    out: *mut ChronotopeAnswer,
) -> ChronotopeStatus {
    guarded(|| {
        let (localizer, scratch) = (shared(localizer)?, unique(scratch)?);
        let pixels = shared(image)?.read()?;
        let image = pixels.view();
        // An image that does not fit may be huge: looking for its features takes memory.
        let nothing = Features::new();
        let query = Query::new(&nothing)
            .at(time_of(time_us))
            .with_image_size(image.size());
        localizer.localizer.check(&query)?;
        extract(localizer, scratch, image)?;
        answer(localizer, scratch, time_us, out)
    })
}

/// Says where the image was taken whose features are in the scratch. Any number of threads at once,
/// each with its own scratch.
///
/// # Safety
///
/// The handles are NULL or were not freed, and no other thread uses the scratch meanwhile; `out` can
/// be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_localize_features(
    localizer: *const ChronotopeLocalizer,
    scratch: *mut ChronotopeScratch,
    time_us: i64,
    out: *mut ChronotopeAnswer,
) -> ChronotopeStatus {
    guarded(|| answer(shared(localizer)?, unique(scratch)?, time_us, out))
}

fn answer(
    localizer: &ChronotopeLocalizer,
    scratch: &mut ChronotopeScratch,
    time_us: i64,
    out: *mut ChronotopeAnswer,
) -> Result<(), Failure> {
    let ChronotopeScratch {
        scratch,
        features,
        size,
        answer,
    } = scratch;
    let size = (*size != (0, 0)).then_some(*size);
    let query = Query::new(features)
        .at(time_of(time_us))
        .with_image_size(size);
    localizer.localizer.localize_into(scratch, &query, answer)?;
    written(out, ChronotopeAnswer::of(answer, features.len()))
}

/// How many features the last image had. One thread at a time for each scratch.
///
/// # Safety
///
/// `scratch` is NULL or was not freed, and `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_scratch_num_features(
    scratch: *const ChronotopeScratch,
    out: *mut usize,
) -> ChronotopeStatus {
    guarded(|| written(out, shared(scratch)?.features.len()))
}

/// One feature of the last image. One thread at a time for each scratch.
///
/// # Safety
///
/// `scratch` is NULL or was not freed, and `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_scratch_feature(
    scratch: *const ChronotopeScratch,
    index: usize,
    out: *mut ChronotopeFeature,
) -> ChronotopeStatus {
    guarded(|| {
        let features = &shared(scratch)?.features;
        let parts = features
            .keypoints()
            .get(index)
            .zip(features.descriptors().get(index));
        let (keypoint, descriptor) = parts.ok_or(Failure::Argument("there is no such feature"))?;
        let feature = ChronotopeFeature {
            x: keypoint.x,
            y: keypoint.y,
            size: keypoint.size,
            response: keypoint.response,
            descriptor: descriptor.0,
        };
        written(out, feature)
    })
}

/// One place of the last answer's ranking, the best at 0. One thread at a time for each scratch.
///
/// # Safety
///
/// `scratch` is NULL or was not freed, and `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_scratch_candidate(
    scratch: *const ChronotopeScratch,
    rank: usize,
    out: *mut ChronotopeCandidate,
) -> ChronotopeStatus {
    guarded(|| {
        let candidate = ChronotopeCandidate::of(&shared(scratch)?.answer, rank);
        written(
            out,
            candidate.ok_or(Failure::Argument("there is no such rank"))?,
        )
    })
}
