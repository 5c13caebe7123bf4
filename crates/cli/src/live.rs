//! How do frames of a camera or a video become pictures?
//!
//! Without the cargo feature `opencv` there are none, and the error says so.

use std::path::Path;

use super::pictures::Picture;
use chronotope::error::Result;
use chronotope::time::Time;

/// File name extensions that are taken for videos.
const VIDEO_EXTENSIONS: [&str; 8] = ["avi", "m4v", "mkv", "mov", "mp4", "mpeg", "mpg", "webm"];

/// Pictures as they come.
pub(super) type Frames = Box<dyn Iterator<Item = Result<Picture>>>;

/// Whether a file's name says that it is a video.
pub(super) fn is_video(path: &Path) -> bool {
    let extension = path.extension().and_then(|extension| extension.to_str());
    extension.is_some_and(|extension| {
        (VIDEO_EXTENSIONS.iter()).any(|video| extension.eq_ignore_ascii_case(video))
    })
}

/// Camera number `index`; its frames have the time of the clock. Never ends.
#[cfg(feature = "opencv")]
pub(super) fn camera(index: u32) -> Result<Frames> {
    let source = chronotope::feature::opencv_input::FrameSource::camera(index)?;
    Ok(pictures(source, format!("camera {index}"), None, None))
}

/// The frames of a video that begins at `start`.
#[cfg(feature = "opencv")]
pub(super) fn video(path: &Path, start: Option<Time>) -> Result<Frames> {
    let source = chronotope::feature::opencv_input::FrameSource::video(path)?;
    let name = path.display().to_string();
    Ok(pictures(source, name, Some(path.to_owned()), start))
}

#[cfg(feature = "opencv")]
fn pictures(
    source: chronotope::feature::opencv_input::FrameSource,
    name: String,
    file: Option<std::path::PathBuf>,
    start: Option<Time>,
) -> Frames {
    use std::time::SystemTime;

    use chronotope::dataset::TimeSource;
    use chronotope::feature::opencv_input::Moment;

    Box::new(source.enumerate().map(move |(number, frame)| {
        let frame = frame?;
        let us =
            |duration: std::time::Duration| i64::try_from(duration.as_micros()).unwrap_or(i64::MAX);
        let time = match frame.moment {
            Moment::Clock(now) => {
                let since_epoch = now.duration_since(SystemTime::UNIX_EPOCH);
                let time = Time::from_us(us(since_epoch.unwrap_or_default()));
                Some((time, TimeSource::Clock))
            }
            Moment::SinceStart(position) => {
                start.map(|start| (start.plus_us(us(position)), TimeSource::Option))
            }
        };
        Ok(Picture {
            name: format!("{name} frame {number}"),
            file: file.clone(),
            recipe: format!("frame {number}"),
            image: frame.image,
            mask: None,
            time,
            truth: None,
        })
    }))
}

/// Says which feature is missing.
#[cfg(not(feature = "opencv"))]
pub(super) fn camera(index: u32) -> Result<Frames> {
    Err(no_opencv(&format!("camera {index}")))
}

/// Says which feature is missing.
#[cfg(not(feature = "opencv"))]
pub(super) fn video(path: &Path, _: Option<Time>) -> Result<Frames> {
    Err(no_opencv(&path.display().to_string()))
}

#[cfg(not(feature = "opencv"))]
fn no_opencv(what: &str) -> chronotope::Error {
    chronotope::Error::new(
        chronotope::ErrorKind::Config,
        "cameras and videos need OpenCV, which this build has not",
    )
    .with_place(what)
    .with_help("install libopencv-dev, clang and libclang-dev, then build with `--features opencv`")
}
