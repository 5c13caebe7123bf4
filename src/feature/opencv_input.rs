//! What does the camera see now, or the next frame of this video?
//!
//! Frames come through OpenCV's video input (V4L2, `GStreamer`, `FFmpeg`: whatever the system's
//! library has) and are made grey by the same integer weights as image files. A frame of a camera
//! has the clock's time at which it was taken from the driver; a frame of a video has its position from the start, because most video
//! files know no more.
//!
//! Not for: image files, and robots that already have the frame in memory ([`GrayView`](super::GrayView)).

use std::path::Path;
use std::time::{Duration, SystemTime};

use opencv::core::Mat;
use opencv::prelude::*;
use opencv::videoio::{self, VideoCapture};

use super::GrayImage;
use super::luma::gray_from_bgr;
use fremen::error::{Error, ErrorKind, Result};

/// When a frame was taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Moment {
    /// By the clock of this computer, when the camera's driver handed the frame over.
    Clock(SystemTime),
    /// Position in the video.
    SinceStart(Duration),
}

/// One picture of a camera or video.
#[derive(Clone, Debug)]
pub struct Frame {
    /// The grey bytes.
    pub image: GrayImage,
    /// When it was taken.
    pub moment: Moment,
}

/// A camera or video as an iterator of frames; a video ends, a camera does not.
pub struct FrameSource {
    capture: VideoCapture,
    name: String,
    is_camera: bool,
    pixels: Mat,
}

impl FrameSource {
    /// Camera number `index`, as the system counts them from 0.
    pub fn camera(index: u32) -> Result<Self> {
        let name = format!("camera {index}");
        let number = i32::try_from(index).unwrap_or(i32::MAX);
        let capture = VideoCapture::new(number, videoio::CAP_ANY)
            .map_err(|cause| opencv_error(&cause).with_place(name.clone()))?;
        Self::opened(
            capture,
            name,
            true,
            "is it plugged in, and free? try another number",
        )
    }

    /// A video file.
    pub fn video(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        // OpenCV reports a missing and an unreadable file alike.
        fremen::file::open(path)?;
        let name = path.display().to_string();
        let capture = VideoCapture::from_file(&name, videoio::CAP_ANY)
            .map_err(|cause| opencv_error(&cause).with_path(path))?;
        Self::opened(
            capture,
            name,
            false,
            "is it a video, and its codec installed?",
        )
    }

    fn opened(capture: VideoCapture, name: String, is_camera: bool, help: &str) -> Result<Self> {
        match capture.is_opened() {
            Ok(true) => Ok(Self {
                capture,
                name,
                is_camera,
                pixels: Mat::default(),
            }),
            Ok(false) => Err(Error::new(ErrorKind::Io, "cannot be opened")
                .with_place(name)
                .with_help(help)),
            Err(cause) => Err(opencv_error(&cause).with_place(name)),
        }
    }

    fn read(&mut self) -> Result<Option<Frame>> {
        let is_read = self
            .capture
            .read(&mut self.pixels)
            .map_err(|cause| opencv_error(&cause))?;
        let taken = SystemTime::now();
        if !is_read && self.is_camera {
            return Err(Error::new(ErrorKind::Io, "the camera gives no frames")
                .with_help("is it plugged in, and used by nobody else?"));
        }
        if !is_read {
            return Ok(None);
        }
        let moment = if self.is_camera {
            Moment::Clock(taken)
        } else {
            // After reading, this is the position of the frame just read.
            let position_ms = self
                .capture
                .get(videoio::CAP_PROP_POS_MSEC)
                .map_err(|cause| opencv_error(&cause))?;
            let position = Duration::try_from_secs_f64(position_ms / 1000.0);
            Moment::SinceStart(position.unwrap_or_default())
        };
        let image = to_gray(&self.pixels)?;
        Ok(Some(Frame { image, moment }))
    }
}

impl Iterator for FrameSource {
    type Item = Result<Frame>;

    fn next(&mut self) -> Option<Self::Item> {
        let name = self.name.clone();
        self.read()
            .map_err(|error| error.with_place(name))
            .transpose()
    }
}

impl std::fmt::Debug for FrameSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "FrameSource({})", self.name)
    }
}

/// Grey bytes of an 8-bit grey or BGR matrix.
fn to_gray(pixels: &Mat) -> Result<GrayImage> {
    let (width, height) = (pixels.cols().max(0) as usize, pixels.rows().max(0) as usize);
    let bytes = pixels.data_bytes().map_err(|cause| opencv_error(&cause))?;
    let data = match pixels.typ() {
        opencv::core::CV_8UC1 => bytes.to_vec(),
        opencv::core::CV_8UC3 => gray_from_bgr(bytes),
        other => {
            return Err(Error::new(
                ErrorKind::Format,
                format!("frames of OpenCV type {other} are not supported"),
            )
            .with_help("set the camera to 8-bit colour or grey"));
        }
    };
    GrayImage::new(width, height, data)
}

fn opencv_error(cause: &opencv::Error) -> Error {
    Error::new(ErrorKind::Format, format!("OpenCV: {}", cause.message))
}
