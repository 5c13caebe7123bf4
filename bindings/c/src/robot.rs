//! How does a robot in C keep knowing where it is?

use std::ffi::{CString, c_char};
use std::path::Path;

use engine::learn::LearnConfig;
use engine::localize::{MotionConfig, Preset};
use engine::map::MapMeta;
use engine::robot::{Frame, Robot, RobotConfig};

use crate::answer::{ChronotopeAnswer, ChronotopeCandidate};
use crate::image::ChronotopeImage;
use crate::localizer::{config, time_of};
use crate::map::{name, names_of};
use crate::status::{
    ChronotopeStatus, Failure, boxed, freed, guarded, shared, text, unique, written,
};

/// The loop of a robot: it localises image after image and, if wanted, learns from them.
#[derive(Debug)]
pub struct ChronotopeRobot {
    robot: Robot,
    /// With the generation that they are of.
    names: (u64, Vec<CString>),
}

/// What a robot does beside answering.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct ChronotopeRobotConfig {
    /// How often an answer may name a wrong place, from 0 to 1; negative: the default.
    pub risk: f64,
    /// Whether what was believed before moves along the map's edges and counts too.
    pub tracks: bool,
    /// Whether located images are learnt, on a second thread, and committed to the map file.
    pub learns: bool,
}

/// What a robot has done so far.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct ChronotopeTotals {
    /// Images that were answered.
    pub num_images: usize,
    /// Images that were located at a place.
    pub num_located: usize,
    /// Visits that were learnt.
    pub num_learnt: usize,
    /// Visits that were quarantined.
    pub num_quarantined: usize,
    /// Located images that could not be learnt, or found the learner busy.
    pub num_not_learnt: usize,
}

/// The defaults: no tracking, no learning. Any thread.
#[unsafe(no_mangle)]
pub extern "C" fn chronotope_robot_config_default() -> ChronotopeRobotConfig {
    ChronotopeRobotConfig {
        risk: -1.0,
        tracks: false,
        learns: false,
    }
}

/// Opens a map file for a robot. Any thread.
///
/// # Safety
///
/// `path` is a text that ends in a zero, `cfg` is NULL (the defaults) or can be read, and `out` can
/// be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_robot_open(
    path: *const c_char,
    cfg: *const ChronotopeRobotConfig,
    out: *mut *mut ChronotopeRobot,
) -> ChronotopeStatus {
    guarded(|| {
        let path = Path::new(text(path)?);
        // SAFETY: it is null or, so the caller says, can be read.
        let given = unsafe { cfg.as_ref() };
        let given = given
            .copied()
            .unwrap_or_else(|| chronotope_robot_config_default());
        let mut cfg = RobotConfig::default().with_localize(config(path, given.risk)?);
        if given.tracks {
            cfg = cfg.with_tracking(MotionConfig::default());
        }
        if given.learns {
            let preset = MapMeta::read(path)?
                .preset
                .parse()
                .unwrap_or(Preset::Default);
            cfg = cfg.with_learning(LearnConfig::preset(preset));
        }
        let robot = Robot::open(path, cfg)?;
        let snapshot = robot.localizer().snapshot();
        let names = (snapshot.generation(), names_of(snapshot));
        boxed(out, ChronotopeRobot { robot, names })
    })
}

/// Frees a robot; what it has learnt is committed, but nobody hears whether that worked:
/// `chronotope_robot_commit` says so. NULL is nothing. Not while another thread uses it.
///
/// # Safety
///
/// `robot` is NULL or comes from `chronotope_robot_open` and was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_robot_free(robot: *mut ChronotopeRobot) {
    freed(robot);
}

/// Says where an image was taken at `time_us`, and learns it if that is wanted and it was located.
/// One thread at a time for each robot.
///
/// # Safety
///
/// `robot` is NULL or was not freed; the image's bytes can be read as it says, and `out` can be
/// written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_robot_see(
    robot: *mut ChronotopeRobot,
    image: *const ChronotopeImage,
    time_us: i64,
    out: *mut ChronotopeAnswer,
) -> ChronotopeStatus {
    guarded(|| {
        let robot = unique(robot)?;
        let pixels = shared(image)?.read()?;
        let mut frame = Frame::new(pixels.view());
        if let Some(time) = time_of(time_us) {
            frame = frame.at(time);
        }
        robot.robot.see_frame(&frame)?;
        let snapshot = robot.robot.localizer().snapshot();
        if robot.names.0 != snapshot.generation() {
            robot.names = (snapshot.generation(), names_of(snapshot));
        }
        let num_features = robot.robot.features().len();
        written(
            out,
            ChronotopeAnswer::of(robot.robot.answer(), num_features),
        )
    })
}

/// The name of a place, which lives until the next image is seen. One thread at a time for each
/// robot.
///
/// # Safety
///
/// `robot` is NULL or was not freed, and `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_robot_place_name(
    robot: *const ChronotopeRobot,
    node: usize,
    out: *mut *const c_char,
) -> ChronotopeStatus {
    guarded(|| written(out, name(&shared(robot)?.names.1, node)?))
}

/// One place of the last answer's ranking, the best at 0. One thread at a time for each robot.
///
/// # Safety
///
/// `robot` is NULL or was not freed, and `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_robot_candidate(
    robot: *const ChronotopeRobot,
    rank: usize,
    out: *mut ChronotopeCandidate,
) -> ChronotopeStatus {
    guarded(|| {
        let candidate = ChronotopeCandidate::of(shared(robot)?.robot.answer(), rank);
        written(
            out,
            candidate.ok_or(Failure::Argument("there is no such rank"))?,
        )
    })
}

/// Waits until everything that was located has been learnt and is in the map file; gives what was
/// done so far. One thread at a time for each robot.
///
/// # Safety
///
/// `robot` is NULL or was not freed; `totals` is NULL or can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_robot_commit(
    robot: *mut ChronotopeRobot,
    totals: *mut ChronotopeTotals,
) -> ChronotopeStatus {
    guarded(|| {
        let robot = unique(robot)?;
        robot.robot.commit()?;
        if totals.is_null() {
            return Ok(());
        }
        let found = robot.robot.totals();
        written(
            totals,
            ChronotopeTotals {
                num_images: found.num_images,
                num_located: found.num_located,
                num_learnt: found.num_learnt,
                num_quarantined: found.num_quarantined,
                num_not_learnt: found.num_not_learnt + found.num_missed,
            },
        )
    })
}
