//! Does the C interface cost anything?
//!
//! ```text
//! latency LIBRARY MAP ROUNDS SECONDS IMAGE.pgm [SECONDS IMAGE.pgm ...]
//! ```
//!
//! Localises the same images by the library's C functions and by the engine itself, in one process and
//! one thread, in turn: which of the two comes first changes from call to call. The answers have to be
//! the same. What is printed is the median of the ratios of neighbouring calls, so that whatever else
//! the machine does meanwhile weighs on both alike.

use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::path::Path;
use std::time::{Duration, Instant};

use engine::Time;
use engine::feature::{Extractor, ExtractorConfig, Features, GrayImage};
use engine::localize::{
    IndexCache, Localization, Localizer, LocalizerConfig, Preset, Query, Scratch,
};
use header::{Answer, Image};

type Failure = Box<dyn std::error::Error>;

/// What a program sees of the library: the structs of `chronotope.h`.
mod header {
    #[repr(C)]
    pub(super) struct Image {
        pub(super) data: *const u8,
        pub(super) width: usize,
        pub(super) height: usize,
        pub(super) stride: usize,
        pub(super) pixels: u32,
    }

    #[repr(C)]
    #[derive(Clone, Copy, Default)]
    pub(super) struct Answer {
        pub(super) decision: u32,
        pub(super) node: i64,
        pub(super) posterior: f64,
        pub(super) off_map: f64,
        pub(super) score: f64,
        pub(super) num_ranked: usize,
        pub(super) num_tied: usize,
        pub(super) num_features: usize,
        pub(super) num_matches: u32,
        pub(super) num_inliers: u32,
        pub(super) dx_px: f64,
        pub(super) dy_px: f64,
    }
}

type Open = unsafe extern "C" fn(*const c_char, f64, *mut *mut c_void) -> c_int;
type NewScratch = unsafe extern "C" fn(*const c_void, *mut *mut c_void) -> c_int;
type Localize =
    unsafe extern "C" fn(*const c_void, *mut c_void, *const Image, i64, *mut Answer) -> c_int;

unsafe extern "C" {
    fn dlopen(path: *const c_char, flags: c_int) -> *mut c_void;
    fn dlsym(library: *mut c_void, name: *const c_char) -> *mut c_void;
}

/// Load all that it needs at once, so that no call pays for it.
const RTLD_NOW: c_int = 2;

/// The library's functions, and a localizer of its own.
struct Library {
    localize: Localize,
    localizer: *mut c_void,
    scratch: *mut c_void,
}

impl Library {
    fn open(library: &str, map: &CStr) -> Result<Self, Failure> {
        let path = CString::new(library)?;
        // SAFETY: the text ends in a zero; it is a library that the caller has built.
        let handle = unsafe { dlopen(path.as_ptr(), RTLD_NOW) };
        if handle.is_null() {
            return Err(format!("{library} cannot be loaded").into());
        }
        let find = |name: &CStr| {
            // SAFETY: the library is open and stays so; the text ends in a zero.
            let symbol = unsafe { dlsym(handle, name.as_ptr()) };
            let missing = || format!("{library} has no {name:?}");
            if symbol.is_null() {
                Err(missing())
            } else {
                Ok(symbol)
            }
        };
        // SAFETY: these are the types that chronotope.h declares.
        let (open, new_scratch, localize) = unsafe {
            (
                std::mem::transmute::<*mut c_void, Open>(find(c"chronotope_localizer_open")?),
                std::mem::transmute::<*mut c_void, NewScratch>(find(c"chronotope_scratch_new")?),
                std::mem::transmute::<*mut c_void, Localize>(find(c"chronotope_localize")?),
            )
        };
        let (mut localizer, mut scratch) = (std::ptr::null_mut(), std::ptr::null_mut());
        // SAFETY: the text ends in a zero, and both handles can be written.
        let statuses = unsafe {
            let opened = open(map.as_ptr(), -1.0, &raw mut localizer);
            (opened, new_scratch(localizer, &raw mut scratch))
        };
        if statuses != (0, 0) {
            return Err(format!("{map:?} cannot be opened: status {}", statuses.0).into());
        }
        Ok(Self {
            localize,
            localizer,
            scratch,
        })
    }

    fn answer(&mut self, image: &GrayImage, time_us: i64) -> Result<(Answer, Duration), Failure> {
        let shown = Image {
            data: image.data().as_ptr(),
            width: image.width(),
            height: image.height(),
            stride: 0,
            pixels: 0,
        };
        let mut answer = Answer::default();
        let begun = Instant::now();
        // SAFETY: the handles are the library's own and not freed, and the image outlives the call.
        let status = unsafe {
            (self.localize)(
                self.localizer,
                self.scratch,
                &raw const shown,
                time_us,
                &raw mut answer,
            )
        };
        let took = begun.elapsed();
        match status {
            0 => Ok((answer, took)),
            status => Err(format!("chronotope_localize: status {status}").into()),
        }
    }
}

/// The engine without a border.
struct Engine {
    localizer: Localizer,
    extractor: Box<dyn Extractor>,
    scratch: Scratch,
    features: Features,
    answer: Localization,
}

impl Engine {
    fn open(map: &Path) -> Result<Self, Failure> {
        let meta = engine::map::MapMeta::read(map)?;
        let preset: Preset = meta.preset.parse().unwrap_or(Preset::Default);
        let cfg = LocalizerConfig::preset(preset);
        let localizer = Localizer::open_with(map, cfg, IndexCache::default())?;
        Ok(Self {
            extractor: ExtractorConfig::from_id(&meta.extractor)?.build()?,
            scratch: localizer.scratch(),
            localizer,
            features: Features::new(),
            answer: Localization::default(),
        })
    }

    fn answer(&mut self, image: &GrayImage, time_us: i64) -> Result<Duration, Failure> {
        let begun = Instant::now();
        (self.extractor).extract_into(image.view(), None, &mut self.features)?;
        let query = Query::new(&self.features)
            .at(Some(Time::from_us(time_us)))
            .with_image_size(Some(image.size()));
        (self.localizer).localize_into(&mut self.scratch, &query, &mut self.answer)?;
        Ok(begun.elapsed())
    }

    fn is_same(&self, other: &Answer) -> bool {
        let first = self.answer.first();
        let (node, posterior) = first.map_or((-1, 0.0), |it| (i64::from(it.node.0), it.posterior));
        (node, posterior.to_bits()) == (other.node, other.posterior.to_bits())
    }
}

fn read_pgm(path: &str) -> Result<GrayImage, Failure> {
    let bytes = std::fs::read(path)?;
    let mut parts = bytes.splitn(4, |&it| it == b'\n');
    let (Some(b"P5"), Some(size), Some(b"255"), Some(pixels)) =
        (parts.next(), parts.next(), parts.next(), parts.next())
    else {
        return Err(format!("{path} is no PGM file").into());
    };
    let size = std::str::from_utf8(size)?;
    let (width, height) = size.split_once(' ').ok_or("a PGM file has a size")?;
    Ok(GrayImage::new(
        width.parse()?,
        height.parse()?,
        pixels.to_vec(),
    )?)
}

fn median(values: &mut [f64]) -> f64 {
    quantile(values, 0.5)
}

fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * share).round() as usize]
}

#[allow(clippy::print_stdout, reason = "an example is there to be read")]
fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [library, map, rounds, walk @ ..] = &arguments[..] else {
        return Err("usage: latency LIBRARY MAP ROUNDS SECONDS IMAGE.pgm ...".into());
    };
    let num_rounds: usize = rounds.parse()?;
    let mut images = Vec::new();
    for pair in walk.chunks_exact(2) {
        images.push((pair[0].parse::<i64>()? * 1_000_000, read_pgm(&pair[1])?));
    }
    if images.is_empty() || num_rounds == 0 {
        return Err("name at least one image and one round".into());
    }
    let mut c = Library::open(library, &CString::new(map.as_str())?)?;
    let mut rust = Engine::open(Path::new(map))?;
    let (mut of_c, mut of_rust, mut ratios) = (Vec::new(), Vec::new(), Vec::new());
    // One round more, to warm both up.
    for round in 0..=num_rounds {
        for (number, (time_us, image)) in images.iter().enumerate() {
            let (answer, c_took, rust_took);
            if (round + number).is_multiple_of(2) {
                (answer, c_took) = c.answer(image, *time_us)?;
                rust_took = rust.answer(image, *time_us)?;
            } else {
                rust_took = rust.answer(image, *time_us)?;
                (answer, c_took) = c.answer(image, *time_us)?;
            }
            if !rust.is_same(&answer) {
                return Err(format!("image {number}: C and Rust give different answers").into());
            }
            if round > 0 {
                let [c_ms, rust_ms] = [c_took, rust_took].map(|it| it.as_secs_f64() * 1e3);
                of_c.push(c_ms);
                of_rust.push(rust_ms);
                ratios.push(c_ms / rust_ms);
            }
        }
    }
    println!(
        "C {:.3} ms, Rust {:.3} ms (medians of {} calls each); C / Rust {:.4} (median of pairs; half of \
         them from {:.3} to {:.3}); the same answers",
        median(&mut of_c),
        median(&mut of_rust),
        ratios.len(),
        median(&mut ratios),
        quantile(&mut ratios, 0.25),
        quantile(&mut ratios, 0.75),
    );
    Ok(())
}
