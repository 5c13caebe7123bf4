//! What do the messages that matter here say?
//!
//! Of each only the fields that are used, in the order of its definition; what follows them is not
//! read. Types are known by their ROS 2 names (`sensor_msgs/msg/Image`).

use std::borrow::Cow;

use chronotope::error::{Error, ErrorKind, Result};
use chronotope::time::Time;
use serde::Serialize;

use crate::cdr::Cursor;

/// Which of the known messages a topic carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum MessageType {
    /// `sensor_msgs/msg/Image`.
    Image,
    /// `sensor_msgs/msg/CompressedImage`.
    CompressedImage,
    /// `sensor_msgs/msg/CameraInfo`.
    CameraInfo,
    /// `sensor_msgs/msg/NavSatFix`.
    NavSatFix,
    /// `nav_msgs/msg/Odometry`.
    Odometry,
    /// `geometry_msgs/msg/PoseStamped` or `PoseWithCovarianceStamped`, which begins alike.
    PoseStamped,
    /// `tf2_msgs/msg/TFMessage`.
    Transforms,
    /// `std_msgs/msg/String`.
    Text,
}

impl MessageType {
    const NAMES: [(&'static str, Self); 9] = [
        ("sensor_msgs/Image", Self::Image),
        ("sensor_msgs/CompressedImage", Self::CompressedImage),
        ("sensor_msgs/CameraInfo", Self::CameraInfo),
        ("sensor_msgs/NavSatFix", Self::NavSatFix),
        ("nav_msgs/Odometry", Self::Odometry),
        ("geometry_msgs/PoseStamped", Self::PoseStamped),
        ("geometry_msgs/PoseWithCovarianceStamped", Self::PoseStamped),
        ("tf2_msgs/TFMessage", Self::Transforms),
        ("std_msgs/String", Self::Text),
    ];

    /// Of a type's name, with or without the `/msg` in it.
    pub fn named(name: &str) -> Option<Self> {
        let short = name.replace("/msg/", "/");
        let found = Self::NAMES.into_iter().find(|(known, _)| *known == short)?;
        Some(found.1)
    }

    /// Whether it carries images.
    pub fn is_image(self) -> bool {
        matches!(self, Self::Image | Self::CompressedImage)
    }

    /// Whether it says where the robot is.
    pub fn is_pose(self) -> bool {
        matches!(
            self,
            Self::NavSatFix | Self::Odometry | Self::PoseStamped | Self::Transforms
        )
    }
}

/// The beginning of most messages.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Header {
    /// When the thing was measured; `None` where the driver left it at zero.
    pub(crate) stamp: Option<Stamp>,
    pub(crate) frame: String,
}

/// A moment as ROS keeps it, to the nanosecond.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Stamp {
    ns: i64,
}

impl Stamp {
    pub(crate) fn from_ns(ns: i64) -> Self {
        Self { ns }
    }

    /// Rounded down to the microsecond.
    pub(crate) fn time(self) -> Time {
        Time::from_us(self.ns.div_euclid(1_000))
    }

    pub(crate) fn as_ns(self) -> i64 {
        self.ns
    }
}

impl std::fmt::Display for Stamp {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (s, ns) = (
            self.ns.div_euclid(1_000_000_000),
            self.ns.rem_euclid(1_000_000_000),
        );
        write!(f, "{s}.{ns:09}")
    }
}

impl Header {
    fn read(cursor: &mut Cursor<'_>) -> Result<Self> {
        let (s, ns) = (cursor.i32()?, cursor.u32()?);
        let stamp = (i64::from(s) * 1_000_000_000).saturating_add(i64::from(ns));
        Ok(Self {
            stamp: (stamp != 0).then(|| Stamp::from_ns(stamp)),
            frame: cursor.text()?,
        })
    }

    /// Of any message that begins with one.
    pub(crate) fn of(message: &[u8]) -> Result<Self> {
        Self::read(&mut Cursor::new(message)?)
    }
}

/// What `sensor_msgs/msg/Image` says of an image.
#[derive(Clone, Debug)]
pub struct RawImage<'a> {
    /// Rows.
    pub height: u32,
    /// Columns.
    pub width: u32,
    /// How its pixels are kept: `mono8`, `bgr8`.
    pub encoding: Cow<'a, str>,
    /// The byte order of what takes more than one.
    pub is_big_endian: bool,
    /// Bytes from one row to the next; 0: as many as a row has.
    pub step: u32,
    /// The pixels.
    pub data: &'a [u8],
}

impl<'a> RawImage<'a> {
    pub(crate) fn read(message: &'a [u8]) -> Result<Self> {
        let cursor = &mut Cursor::new(message)?;
        Header::read(cursor)?;
        Ok(Self {
            height: cursor.u32()?,
            width: cursor.u32()?,
            encoding: cursor.text()?.into(),
            is_big_endian: cursor.u8()? != 0,
            step: cursor.u32()?,
            data: cursor.byte_sequence()?,
        })
    }
}

/// What `sensor_msgs/msg/CompressedImage` says of an image.
#[derive(Clone, Debug)]
pub struct EncodedImage<'a> {
    /// What its driver calls the format; the bytes say it, too.
    pub format: Cow<'a, str>,
    /// A file: JPEG, PNG and what else files of images are.
    pub data: &'a [u8],
}

impl<'a> EncodedImage<'a> {
    pub(crate) fn read(message: &'a [u8]) -> Result<Self> {
        let cursor = &mut Cursor::new(message)?;
        Header::read(cursor)?;
        Ok(Self {
            format: cursor.text()?.into(),
            data: cursor.byte_sequence()?,
        })
    }
}

/// What `sensor_msgs/msg/CameraInfo` says of a camera.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CameraInfo {
    /// Columns of its images.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// How its lens distorts: `plumb_bob`.
    pub distortion_model: String,
    /// The numbers of that model.
    pub distortion: Vec<f64>,
    /// The focal lengths, px; zero where the camera is not calibrated.
    pub focal_px: [f64; 2],
}

impl CameraInfo {
    pub(crate) fn read(message: &[u8]) -> Result<Self> {
        let cursor = &mut Cursor::new(message)?;
        Header::read(cursor)?;
        let (height, width) = (cursor.u32()?, cursor.u32()?);
        let distortion_model = cursor.text()?;
        let len = cursor.sequence_len(8)?;
        let distortion = (0..len).map(|_| cursor.f64()).collect::<Result<_>>()?;
        let mut matrix = [0.0; 9];
        for value in &mut matrix {
            *value = cursor.f64()?;
        }
        Ok(Self {
            width,
            height,
            distortion_model,
            distortion,
            focal_px: [matrix[0], matrix[4]],
        })
    }
}

/// Where something is, and how it is turned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pose {
    /// Metres.
    pub(crate) position: [f64; 3],
    /// A unit quaternion x, y, z, w.
    pub(crate) orientation: [f64; 4],
}

impl Pose {
    fn read(cursor: &mut Cursor<'_>) -> Result<Self> {
        let mut values = [0.0; 7];
        for value in &mut values {
            *value = cursor.f64()?;
        }
        if values.iter().any(|it| !it.is_finite()) {
            return Err(Error::new(
                ErrorKind::Format,
                "the pose has a number that is none",
            ));
        }
        let [x, y, z, qx, qy, qz, qw] = values;
        let norm = (qx * qx + qy * qy + qz * qz + qw * qw).sqrt();
        // Left at zero, it is not turned.
        let orientation = if norm < 1e-6 {
            [0.0, 0.0, 0.0, 1.0]
        } else {
            [qx, qy, qz, qw].map(|it| it / norm)
        };
        Ok(Self {
            position: [x, y, z],
            orientation,
        })
    }

    /// Of a message that is a header and a pose.
    pub(crate) fn stamped(message: &[u8]) -> Result<(Header, Self)> {
        let cursor = &mut Cursor::new(message)?;
        Ok((Header::read(cursor)?, Self::read(cursor)?))
    }

    /// Of `nav_msgs/msg/Odometry`, which names the frame that moves in between.
    pub(crate) fn of_odometry(message: &[u8]) -> Result<(Header, Self)> {
        let cursor = &mut Cursor::new(message)?;
        let header = Header::read(cursor)?;
        cursor.text()?;
        Ok((header, Self::read(cursor)?))
    }
}

/// One of the transforms of `tf2_msgs/msg/TFMessage`: where `child` is in the frame of its header.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Transform {
    pub(crate) header: Header,
    pub(crate) child: String,
    pub(crate) pose: Pose,
}

impl Transform {
    pub(crate) fn read_all(message: &[u8]) -> Result<Vec<Self>> {
        let cursor = &mut Cursor::new(message)?;
        // Two numbers of the stamp, two texts, a pose.
        let len = cursor.sequence_len(72)?;
        (0..len)
            .map(|_| {
                Ok(Self {
                    header: Header::read(cursor)?,
                    child: cursor.text()?,
                    pose: Pose::read(cursor)?,
                })
            })
            .collect()
    }
}

/// `sensor_msgs/msg/NavSatFix`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Fix {
    pub(crate) header: Header,
    /// Whether a position could be found.
    pub(crate) is_fixed: bool,
    /// Degrees.
    pub(crate) latitude: f64,
    pub(crate) longitude: f64,
}

impl Fix {
    pub(crate) fn read(message: &[u8]) -> Result<Self> {
        let cursor = &mut Cursor::new(message)?;
        let header = Header::read(cursor)?;
        let status = cursor.u8()?.cast_signed();
        // The service.
        cursor.u16()?;
        let (latitude, longitude) = (cursor.f64()?, cursor.f64()?);
        let is_finite = latitude.is_finite() && longitude.is_finite();
        Ok(Self {
            header,
            is_fixed: status >= 0 && is_finite,
            latitude,
            longitude,
        })
    }
}

/// `std_msgs/msg/String`.
pub(crate) fn text(message: &[u8]) -> Result<String> {
    Cursor::new(message)?.text()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stamp_is_written_to_the_nanosecond_and_rounded_down() {
        let stamp = Stamp::from_ns(1_700_000_000_123_456_789);
        assert_eq!(stamp.to_string(), "1700000000.123456789");
        assert_eq!(stamp.time(), Time::from_us(1_700_000_000_123_456));
        assert_eq!(Stamp::from_ns(-1).to_string(), "-1.999999999");
    }

    #[test]
    fn made_up_bytes_are_an_error_or_a_message_and_never_a_panic() {
        let mut state = 7_u64;
        let mut random = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 33) as u8
        };
        for round in 0..20_000 {
            let len = usize::from(random());
            let mut bytes: Vec<u8> = (0..len).map(|_| random()).collect();
            // Mostly plain CDR in either order, with short texts.
            for (byte, value) in bytes.iter_mut().zip([0, round as u8 & 1, 0, 0]) {
                *byte = value;
            }
            for at in [13, 14, 15, 17, 18, 19] {
                if let Some(byte) = bytes.get_mut(at).filter(|_| round % 3 == 0) {
                    *byte = 0;
                }
            }
            let _ = (RawImage::read(&bytes), EncodedImage::read(&bytes));
            let _ = (CameraInfo::read(&bytes), Fix::read(&bytes));
            let _ = (Pose::stamped(&bytes), Pose::of_odometry(&bytes));
            let _ = (Transform::read_all(&bytes), text(&bytes));
        }
    }

    #[test]
    fn types_are_known_by_either_name() {
        for name in ["sensor_msgs/msg/Image", "sensor_msgs/Image"] {
            assert_eq!(MessageType::named(name), Some(MessageType::Image));
        }
        assert_eq!(MessageType::named("sensor_msgs/msg/Imu"), None);
    }
}
