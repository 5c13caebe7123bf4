//! Through which topics does the node hear and speak, and with which quality of service?

use std::collections::BTreeMap;

use anyhow::Result;
use futures::StreamExt;
use futures::stream::LocalBoxStream;
use ros2_client::dds::rustdds::GUID;
use ros2_client::qos::{Durability, History, WhenFull};
use ros2_client::{Log, MessageTypeName, Name, Node, Publisher, QosProfile, Subscription};
use serde::Serialize;

use crate::arguments::RosArguments;
use crate::engine::Pixels;
use crate::lifecycle::TransitionEvent;
use crate::messages::{ClosestEdges, CompressedImage, DiagnosticArray, Float32, Image, Text};

/// Everything that the node publishes.
pub(crate) struct Publishers {
    pub(crate) current: Publisher<Text>,
    pub(crate) closest: Publisher<Text>,
    pub(crate) closest_m: Publisher<Float32>,
    pub(crate) edges: Publisher<ClosestEdges>,
    pub(crate) localization: Publisher<Text>,
    pub(crate) picture: Publisher<Image>,
    pub(crate) diagnostics: Publisher<DiagnosticArray>,
    pub(crate) transition: Publisher<TransitionEvent>,
    pub(crate) log: Publisher<Log>,
}

/// The last value for those who come later, as LCAS `topological_navigation` publishes.
fn latched() -> QosProfile {
    QosProfile::publisher_default()
        .reliability_reliable(WhenFull::Fail)
        .durability(Durability::TransientLocal)
        .history(History::KeepLast { depth: 1 })
}

/// A few values for those who are there.
fn lively(depth: usize) -> QosProfile {
    QosProfile::publisher_default()
        .reliability_reliable(WhenFull::Fail)
        .history(History::KeepLast { depth })
}

/// That of sensors, or a reliable one.
fn of_images(is_reliable: bool) -> QosProfile {
    let qos = QosProfile::subscription_default().history(History::KeepLast { depth: 5 });
    if is_reliable {
        qos.reliability_reliable(WhenFull::DEFAULT)
    } else {
        qos
    }
}

/// The names of topics by what identifies their ends here.
pub(crate) type Ends = BTreeMap<GUID, String>;

/// Creates the ends of topics.
pub(crate) struct Creator<'a> {
    pub(crate) node: &'a mut Node,
    pub(crate) names: &'a RosArguments,
    pub(crate) ends: Ends,
}

impl Creator<'_> {
    fn publisher<M: Serialize>(
        &mut self,
        name: &str,
        kind: (&str, &str),
        qos: &QosProfile,
    ) -> Result<Publisher<M>> {
        let full = self.names.resolve(name);
        let kind = MessageTypeName::new(kind.0, kind.1);
        let topic = self.node.create_topic(&Name::parse(&full)?, kind, qos)?;
        let publisher = self.node.create_publisher(&topic, Some(qos.clone()))?;
        self.ends.insert(publisher.guid(), full);
        Ok(publisher)
    }

    pub(crate) fn subscription<M: 'static>(
        &mut self,
        name: &str,
        kind: (&str, &str),
        qos: &QosProfile,
    ) -> Result<Subscription<M>> {
        let full = self.names.resolve(name);
        let kind = MessageTypeName::new(kind.0, kind.1);
        let topic = self.node.create_topic(&Name::parse(&full)?, kind, qos)?;
        let subscription = self.node.create_subscription(&topic, Some(qos.clone()))?;
        self.ends.insert(subscription.guid(), full);
        Ok(subscription)
    }

    pub(crate) fn camera(&mut self, is_compressed: bool, is_reliable: bool) -> Result<Camera> {
        let qos = of_images(is_reliable);
        Ok(if is_compressed {
            let kind = ("sensor_msgs", "CompressedImage");
            Camera::Encoded(self.subscription("image", kind, &qos)?)
        } else {
            Camera::Raw(self.subscription("image", ("sensor_msgs", "Image"), &qos)?)
        })
    }

    pub(crate) fn publishers(&mut self, log: Publisher<Log>) -> Result<Publishers> {
        let (text, latched) = (("std_msgs", "String"), latched());
        Ok(Publishers {
            current: self.publisher("current_node", text, &latched)?,
            closest: self.publisher("closest_node", text, &latched)?,
            closest_m: self.publisher(
                "closest_node_distance",
                ("std_msgs", "Float32"),
                &latched,
            )?,
            edges: self.publisher(
                "closest_edges",
                ("topological_navigation_msgs", "ClosestEdges"),
                &latched,
            )?,
            localization: self.publisher("~/localization", text, &lively(10))?,
            picture: self.publisher("~/debug/image", ("sensor_msgs", "Image"), &lively(1))?,
            diagnostics: self.publisher(
                "/diagnostics",
                ("diagnostic_msgs", "DiagnosticArray"),
                &lively(10),
            )?,
            transition: self.publisher(
                "~/transition_event",
                ("lifecycle_msgs", "TransitionEvent"),
                &lively(10),
            )?,
            log,
        })
    }
}

/// Where images come from.
pub(crate) enum Camera {
    Raw(Subscription<Image>),
    Encoded(Subscription<CompressedImage>),
}

impl Camera {
    /// Its images, or why something that came is none.
    pub(crate) fn images(&self) -> LocalBoxStream<'_, std::result::Result<Pixels, String>> {
        fn pixels<M>(
            taken: ros2_client::ReadResult<(M, ros2_client::MessageInfo)>,
            of: impl Fn(M) -> Pixels,
        ) -> std::result::Result<Pixels, String> {
            let taken = taken.map(|(message, _)| of(message));
            taken.map_err(|cause| cause.to_string())
        }
        match self {
            Self::Raw(it) => it
                .async_stream()
                .map(|it| pixels(it, Pixels::Raw))
                .boxed_local(),
            Self::Encoded(it) => it
                .async_stream()
                .map(|it| pixels(it, Pixels::Encoded))
                .boxed_local(),
        }
    }
}
