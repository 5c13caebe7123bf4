//! What do the messages that come and go look like?
//!
//! The fields of ROS 2's definitions, in their order; the middleware's CDR does the rest. Of an
//! image only the pixels are copied, once.

use chronotope::time::Time;
use ros2_client::Message;
use serde::{Deserialize, Serialize};

macro_rules! messages {
    ($($name:ident),*) => { $(impl Message for $name {})* };
}
messages!(Empty, Flag, Outcome, SetPlace, ChooseVisits);

/// `builtin_interfaces/msg/Time`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Stamp {
    pub(crate) sec: i32,
    pub(crate) nanosec: u32,
}

impl Stamp {
    /// Rounded down to the microsecond; `None` where nobody has set it.
    pub(crate) fn time(self) -> Option<Time> {
        let us = i64::from(self.sec) * 1_000_000 + i64::from(self.nanosec) / 1_000;
        (self != Self::default()).then(|| Time::from_us(us))
    }
}

impl From<Time> for Stamp {
    fn from(time: Time) -> Self {
        let (s, us) = (
            time.as_us().div_euclid(1_000_000),
            time.as_us().rem_euclid(1_000_000),
        );
        Self {
            sec: i32::try_from(s).unwrap_or(if s < 0 { i32::MIN } else { i32::MAX }),
            nanosec: us as u32 * 1_000,
        }
    }
}

/// `std_msgs/msg/Header`.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Header {
    pub(crate) stamp: Stamp,
    pub(crate) frame_id: String,
}

/// `sensor_msgs/msg/Image`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Image {
    pub(crate) header: Header,
    pub(crate) height: u32,
    pub(crate) width: u32,
    pub(crate) encoding: String,
    pub(crate) is_bigendian: u8,
    pub(crate) step: u32,
    #[serde(with = "serde_bytes")]
    pub(crate) data: Vec<u8>,
}

/// `sensor_msgs/msg/CompressedImage`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct CompressedImage {
    pub(crate) header: Header,
    pub(crate) format: String,
    #[serde(with = "serde_bytes")]
    pub(crate) data: Vec<u8>,
}

/// `rosgraph_msgs/msg/Clock`.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct Clock {
    pub(crate) clock: Stamp,
}

/// `std_msgs/msg/String`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Text {
    pub(crate) data: String,
}

/// `std_msgs/msg/Float32`.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct Float32 {
    pub(crate) data: f32,
}

/// `topological_navigation_msgs/msg/ClosestEdges`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct ClosestEdges {
    pub(crate) edge_ids: Vec<String>,
    pub(crate) distances: Vec<f32>,
}

/// `diagnostic_msgs/msg/DiagnosticArray`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct DiagnosticArray {
    pub(crate) header: Header,
    pub(crate) status: Vec<DiagnosticStatus>,
}

/// `diagnostic_msgs/msg/DiagnosticStatus`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct DiagnosticStatus {
    pub(crate) level: u8,
    pub(crate) name: String,
    pub(crate) message: String,
    pub(crate) hardware_id: String,
    pub(crate) values: Vec<KeyValue>,
}

/// `diagnostic_msgs/msg/KeyValue`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct KeyValue {
    pub(crate) key: String,
    pub(crate) value: String,
}

/// The request of `std_srvs/srv/Trigger`: a message without fields has one byte on the wire.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Empty {
    pub(crate) structure_needs_at_least_one_member: u8,
}

/// The request of `std_srvs/srv/SetBool`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Flag {
    pub(crate) data: bool,
}

/// The request of `chronotope_interfaces/srv/SetPlace`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct SetPlace {
    pub(crate) place: String,
}

/// The request of `chronotope_interfaces/srv/ChooseVisits`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct ChooseVisits {
    pub(crate) visits: Vec<String>,
}

/// The answer of all these services.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Outcome {
    pub(crate) success: bool,
    pub(crate) message: String,
}

impl From<Result<String, String>> for Outcome {
    fn from(result: Result<String, String>) -> Self {
        let success = result.is_ok();
        let (Ok(message) | Err(message)) = result;
        Self { success, message }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_are_times_and_zero_is_none() {
        assert_eq!(Stamp::default().time(), None);
        let stamp = Stamp {
            sec: 1_714_552_200,
            nanosec: 250_000_999,
        };
        let time = stamp.time().expect("it is set");
        assert_eq!(time.as_us(), 1_714_552_200_250_000);
        assert_eq!(Stamp::from(time).nanosec, 250_000_000);
        assert_eq!(Stamp::from(Time::from_us(-1)).sec, -1);
    }
}
