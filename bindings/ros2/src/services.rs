//! Which services does the node offer?
//!
//! Its own, whose answers come from the robot's thread or the clerk's, and those of parameters,
//! which are answered at once, with descriptions.

use anyhow::Result;
use futures::StreamExt;
use futures::stream::LocalBoxStream;
use ros2_client::parameters::raw;
use ros2_client::qos::{History, WhenFull};
use ros2_client::rcl_interfaces::{
    DescribeParametersRequest, DescribeParametersResponse, GetParameterTypesRequest,
    GetParameterTypesResponse, GetParametersRequest, GetParametersResponse, ListParametersRequest,
    ListParametersResponse, ListParametersResult, SetParametersAtomicallyResponse,
    SetParametersRequest, SetParametersResponse,
};
use ros2_client::request_id::RmwRequestId;
use ros2_client::{
    Message, Name, Node, ParameterValue, QosProfile, ReadResult, Server, ServiceMapping,
    ServiceTypeName,
};

use crate::arguments::RosArguments;
use crate::messages::{ChooseVisits, Empty, Flag, Outcome, SetPlace};
use crate::parameters::{Declared, PARAMETERS};

/// What somebody asks for.
#[derive(Debug)]
pub(crate) enum Request {
    Commit,
    ReloadMap,
    ListVisits,
    PauseLearning(bool),
    AcceptVisits(Vec<String>),
    DropVisits(Vec<String>),
    SetPlace(String),
}

/// Who asks, so that the answer finds them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Asker {
    kind: Kind,
    id: RmwRequestId,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Commit,
    ReloadMap,
    ListVisits,
    PauseLearning,
    AcceptVisits,
    DropVisits,
    SetPlace,
}

/// The node's own services.
pub(crate) struct Services {
    commit: Server<Empty, Outcome>,
    reload_map: Server<Empty, Outcome>,
    list_visits: Server<Empty, Outcome>,
    pause_learning: Server<Flag, Outcome>,
    accept_visits: Server<ChooseVisits, Outcome>,
    drop_visits: Server<ChooseVisits, Outcome>,
    set_place: Server<SetPlace, Outcome>,
}

/// Which of the mappings of services to DDS the other nodes speak.
pub(crate) fn mapping() -> ServiceMapping {
    match std::env::var("RMW_IMPLEMENTATION").as_deref() {
        Ok(name) if name.contains("cyclonedds") => ServiceMapping::Cyclone,
        _ => ServiceMapping::Enhanced,
    }
}

/// A service of this node.
///
/// Fails if its name makes no sense or the middleware refuses it.
pub(crate) fn create<Q: Message + Clone + 'static, A: Message + 'static>(
    node: &mut Node,
    names: &RosArguments,
    name: &str,
    kind: &ServiceTypeName,
) -> Result<Server<Q, A>> {
    let qos = QosProfile::publisher_default()
        .reliability_reliable(WhenFull::DEFAULT)
        .history(History::KeepLast { depth: 10 });
    let name = Name::parse(&names.resolve(name))?;
    Ok(node.create_server(mapping(), &name, kind, qos.clone(), qos)?)
}

impl Services {
    pub(crate) fn create(node: &mut Node, names: &RosArguments) -> Result<Self> {
        let trigger = ServiceTypeName::new("std_srvs", "Trigger");
        let choose = ServiceTypeName::new("chronotope_interfaces", "ChooseVisits");
        Ok(Self {
            commit: create(node, names, "~/commit", &trigger)?,
            reload_map: create(node, names, "~/reload_map", &trigger)?,
            list_visits: create(node, names, "~/list_visits", &trigger)?,
            pause_learning: create(
                node,
                names,
                "~/pause_learning",
                &ServiceTypeName::new("std_srvs", "SetBool"),
            )?,
            accept_visits: create(node, names, "~/accept_visits", &choose)?,
            drop_visits: create(node, names, "~/drop_visits", &choose)?,
            set_place: create(
                node,
                names,
                "~/set_place",
                &ServiceTypeName::new("chronotope_interfaces", "SetPlace"),
            )?,
        })
    }

    /// All that is asked for, in the order in which it comes.
    pub(crate) fn requests(&self) -> LocalBoxStream<'_, ReadResult<(Asker, Request)>> {
        futures::stream::select_all([
            asked(&self.commit, Kind::Commit, |_| Request::Commit),
            asked(&self.reload_map, Kind::ReloadMap, |_| Request::ReloadMap),
            asked(&self.list_visits, Kind::ListVisits, |_| Request::ListVisits),
            asked(&self.pause_learning, Kind::PauseLearning, |it| {
                Request::PauseLearning(it.data)
            }),
            asked(&self.accept_visits, Kind::AcceptVisits, |it| {
                Request::AcceptVisits(it.visits)
            }),
            asked(&self.drop_visits, Kind::DropVisits, |it| {
                Request::DropVisits(it.visits)
            }),
            asked(&self.set_place, Kind::SetPlace, |it| {
                Request::SetPlace(it.place)
            }),
        ])
        .boxed_local()
    }

    /// Answers whoever asked.
    ///
    /// Fails if the answer cannot be sent.
    pub(crate) fn answer(&self, asker: Asker, outcome: Outcome) -> Result<()> {
        let sent = match asker.kind {
            Kind::Commit => self.commit.send_response(asker.id, outcome),
            Kind::ReloadMap => self.reload_map.send_response(asker.id, outcome),
            Kind::ListVisits => self.list_visits.send_response(asker.id, outcome),
            Kind::PauseLearning => self.pause_learning.send_response(asker.id, outcome),
            Kind::AcceptVisits => self.accept_visits.send_response(asker.id, outcome),
            Kind::DropVisits => self.drop_visits.send_response(asker.id, outcome),
            Kind::SetPlace => self.set_place.send_response(asker.id, outcome),
        };
        Ok(sent?)
    }
}

fn asked<Q: Message + 'static>(
    server: &Server<Q, Outcome>,
    kind: Kind,
    request: impl Fn(Q) -> Request + 'static,
) -> LocalBoxStream<'_, ReadResult<(Asker, Request)>> {
    let asked = server.receive_request_stream();
    asked
        .map(move |it| it.map(|(id, asked)| (Asker { kind, id }, request(asked))))
        .boxed_local()
}

/// The services of parameters, as every node has them.
pub(crate) struct ParameterServices {
    get: Server<GetParametersRequest, GetParametersResponse>,
    types: Server<GetParameterTypesRequest, GetParameterTypesResponse>,
    list: Server<ListParametersRequest, ListParametersResponse>,
    describe: Server<DescribeParametersRequest, DescribeParametersResponse>,
    set: Server<SetParametersRequest, SetParametersResponse>,
    set_atomically: Server<SetParametersRequest, SetParametersAtomicallyResponse>,
}

/// What is asked of parameters.
pub(crate) enum ParameterRequest {
    Get(RmwRequestId, GetParametersRequest),
    Types(RmwRequestId, GetParameterTypesRequest),
    List(RmwRequestId, ListParametersRequest),
    Describe(RmwRequestId, DescribeParametersRequest),
    Set(RmwRequestId, SetParametersRequest),
    SetAtomically(RmwRequestId, SetParametersRequest),
}

impl ParameterServices {
    pub(crate) fn create(node: &mut Node, names: &RosArguments) -> Result<Self> {
        let kind = |name: &str| ServiceTypeName::new("rcl_interfaces", name);
        Ok(Self {
            get: create(node, names, "~/get_parameters", &kind("GetParameters"))?,
            types: create(
                node,
                names,
                "~/get_parameter_types",
                &kind("GetParameterTypes"),
            )?,
            list: create(node, names, "~/list_parameters", &kind("ListParameters"))?,
            describe: create(
                node,
                names,
                "~/describe_parameters",
                &kind("DescribeParameters"),
            )?,
            set: create(node, names, "~/set_parameters", &kind("SetParameters"))?,
            set_atomically: create(
                node,
                names,
                "~/set_parameters_atomically",
                &kind("SetParametersAtomically"),
            )?,
        })
    }

    pub(crate) fn requests(&self) -> LocalBoxStream<'_, ReadResult<ParameterRequest>> {
        use ParameterRequest as Asked;
        futures::stream::select_all([
            (self.get.receive_request_stream())
                .map(|it| it.map(|(id, it)| Asked::Get(id, it)))
                .boxed_local(),
            (self.types.receive_request_stream())
                .map(|it| it.map(|(id, it)| Asked::Types(id, it)))
                .boxed_local(),
            (self.list.receive_request_stream())
                .map(|it| it.map(|(id, it)| Asked::List(id, it)))
                .boxed_local(),
            (self.describe.receive_request_stream())
                .map(|it| it.map(|(id, it)| Asked::Describe(id, it)))
                .boxed_local(),
            (self.set.receive_request_stream())
                .map(|it| it.map(|(id, it)| Asked::Set(id, it)))
                .boxed_local(),
            (self.set_atomically.receive_request_stream())
                .map(|it| it.map(|(id, it)| Asked::SetAtomically(id, it)))
                .boxed_local(),
        ])
        .boxed_local()
    }

    /// Answers, and sets what is to be set.
    ///
    /// Fails if the answer cannot be sent.
    pub(crate) fn answer(&self, node: &Node, request: ParameterRequest) -> Result<()> {
        match request {
            ParameterRequest::Get(id, it) => {
                let values = it
                    .names
                    .iter()
                    .map(|name| value(node, name).into())
                    .collect();
                self.get
                    .send_response(id, GetParametersResponse { values })?;
            }
            ParameterRequest::Types(id, it) => {
                let kind = |name: &String| value(node, name).to_parameter_type() as u8;
                let values = it.names.iter().map(kind).collect();
                (self.types).send_response(id, GetParameterTypesResponse { values })?;
            }
            ParameterRequest::List(id, it) => {
                let result = ListParametersResult {
                    names: listed(&it.prefixes),
                    prefixes: Vec::new(),
                };
                self.list
                    .send_response(id, ListParametersResponse { result })?;
            }
            ParameterRequest::Describe(id, it) => {
                let known = it.names.iter().filter_map(|name| Declared::find(name));
                let values = known.map(Declared::descriptor).collect();
                (self.describe).send_response(id, DescribeParametersResponse { values })?;
            }
            ParameterRequest::Set(id, it) => {
                let each = it.parameter.into_iter();
                let results = each
                    .map(|it| result(checked(it).and_then(|(name, value)| set(node, name, value))))
                    .collect();
                self.set
                    .send_response(id, SetParametersResponse { results })?;
            }
            ParameterRequest::SetAtomically(id, it) => {
                let all: std::result::Result<Vec<_>, String> =
                    it.parameter.into_iter().map(checked).collect();
                let done = all.and_then(|all| {
                    all.into_iter()
                        .try_for_each(|(name, value)| set(node, name, value))
                });
                let result = result(done);
                (self.set_atomically)
                    .send_response(id, SetParametersAtomicallyResponse { result })?;
            }
        }
        Ok(())
    }
}

fn value(node: &Node, name: &str) -> ParameterValue {
    node.get_parameter(name).unwrap_or(ParameterValue::NotSet)
}

/// Names at or under one of some prefixes; none: all.
fn listed(prefixes: &[String]) -> Vec<String> {
    let is_listed = |name: &str| prefixes.is_empty() || prefixes.iter().any(|it| it == name);
    (PARAMETERS.iter().map(|it| it.name))
        .filter(|name| is_listed(name))
        .map(str::to_owned)
        .collect()
}

/// A value that may be set.
fn checked(given: raw::Parameter) -> std::result::Result<(&'static str, ParameterValue), String> {
    let declared = Declared::find(&given.name)
        .ok_or_else(|| format!("there is no parameter `{}`", given.name))?;
    if declared.is_read_only {
        return Err(format!(
            "`{}` stays what it was at the start: start the node anew",
            declared.name
        ));
    }
    let value = declared.typed(given.value.into());
    declared.check(&value)?;
    Ok((declared.name, value))
}

fn set(node: &Node, name: &str, value: ParameterValue) -> std::result::Result<(), String> {
    node.set_parameter(name, value)
}

fn result(done: std::result::Result<(), String>) -> raw::SetParametersResult {
    raw::SetParametersResult {
        successful: done.is_ok(),
        reason: done.err().unwrap_or_default(),
    }
}
