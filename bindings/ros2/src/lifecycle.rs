//! In which state of a managed node is this one, and who may change it?
//!
//! The state machine of ROS 2's managed nodes: *unconfigured* (no map is open), *inactive* (a map
//! is open, images are left alone), *active* (images are answered), *finalized*. A change begins with
//! a transition that somebody asks for, leads through a state in which the work is done, and ends in
//! one that says how that went. Numbers and labels are those of `lifecycle_msgs`.
//!
//! Source: design.ros2.org, Managed nodes; compared with rclpy's own `LifecycleNode` by
//! `tests/test_node.py`. There is no `~/get_transition_graph`: its answer takes several packets, and
//! such an answer does not reach whoever asked.

use anyhow::Result;
use futures::StreamExt;
use futures::stream::LocalBoxStream;
use ros2_client::request_id::RmwRequestId;
use ros2_client::{Message, Node, ReadResult, Server, ServiceTypeName};
use serde::{Deserialize, Serialize};

use crate::arguments::RosArguments;
use crate::messages::Empty;
use crate::services::create;

/// A state that the node can be in, with its number in `lifecycle_msgs/msg/State`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum State {
    /// No map is open.
    Unconfigured = 1,
    /// A map is open.
    Inactive = 2,
    /// Images are answered.
    Active = 3,
    /// Nothing can be asked of it any more.
    Finalized = 4,
    Configuring = 10,
    CleaningUp = 11,
    ShuttingDown = 12,
    Activating = 13,
    Deactivating = 14,
}

/// All states of managed nodes, in the order of rcl; this one is never in the first or the last.
const LABELS: [(u8, &str); 11] = [
    (0, "unknown"),
    (1, "unconfigured"),
    (2, "inactive"),
    (3, "active"),
    (4, "finalized"),
    (10, "configuring"),
    (11, "cleaningup"),
    (12, "shuttingdown"),
    (13, "activating"),
    (14, "deactivating"),
    (15, "errorprocessing"),
];

impl State {
    pub(crate) fn label(self) -> &'static str {
        let found = LABELS.iter().find(|it| it.0 == self as u8);
        found.map_or("unknown", |it| it.1)
    }

    /// Whether a map is open, and stays so.
    pub(crate) fn has_map(self) -> bool {
        matches!(self, Self::Inactive | Self::Active)
    }

    /// Whether a map is open, is being opened, or may stay open where work fails.
    pub(crate) fn may_have_map(self) -> bool {
        !matches!(
            self,
            Self::Unconfigured | Self::ShuttingDown | Self::Finalized
        )
    }

    /// Of a state in which work is done: the number of the transition that says that it went well
    /// (one more: that it did not), and where both lead.
    fn ends(self) -> Option<(u8, Self, Self)> {
        match self {
            Self::Configuring => Some((10, Self::Inactive, Self::Unconfigured)),
            Self::CleaningUp => Some((20, Self::Unconfigured, Self::Inactive)),
            Self::Activating => Some((30, Self::Active, Self::Inactive)),
            Self::Deactivating => Some((40, Self::Inactive, Self::Active)),
            Self::ShuttingDown => Some((50, Self::Finalized, Self::Finalized)),
            _ => None,
        }
    }

    fn message(self) -> StateMessage {
        StateMessage {
            id: self as u8,
            label: self.label().to_owned(),
        }
    }
}

/// A step from one state to another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Step {
    id: u8,
    label: &'static str,
    pub(crate) from: State,
    pub(crate) to: State,
}

const fn step(id: u8, label: &'static str, from: State, to: State) -> Step {
    Step {
        id,
        label,
        from,
        to,
    }
}

/// What may be asked for, where.
const STEPS: [Step; 7] = [
    step(1, "configure", State::Unconfigured, State::Configuring),
    step(5, "shutdown", State::Unconfigured, State::ShuttingDown),
    step(2, "cleanup", State::Inactive, State::CleaningUp),
    step(3, "activate", State::Inactive, State::Activating),
    step(6, "shutdown", State::Inactive, State::ShuttingDown),
    step(4, "deactivate", State::Active, State::Deactivating),
    step(7, "shutdown", State::Active, State::ShuttingDown),
];

impl Step {
    /// Told to those who listen; `timestamp`: nanoseconds since 1970.
    pub(crate) fn event(self, timestamp: u64) -> TransitionEvent {
        let description = self.description();
        TransitionEvent {
            timestamp,
            transition: description.transition,
            start_state: description.start_state,
            goal_state: description.goal_state,
        }
    }

    fn description(self) -> TransitionDescription {
        TransitionDescription {
            transition: Transition {
                id: self.id,
                label: self.label.to_owned(),
            },
            start_state: self.from.message(),
            goal_state: self.to.message(),
        }
    }
}

/// The node's state.
#[derive(Debug)]
pub(crate) struct Machine {
    state: State,
}

impl Machine {
    pub(crate) fn new(state: State) -> Self {
        Self { state }
    }

    pub(crate) fn state(&self) -> State {
        self.state
    }

    /// What may be asked for now.
    fn steps(&self) -> impl Iterator<Item = Step> + '_ {
        (STEPS.into_iter()).filter(|it| it.from == self.state)
    }

    /// Begins what is asked for: by its label if one is given, else by its number, as rclcpp does.
    ///
    /// Fails, and changes nothing, where there is no such transition.
    pub(crate) fn begin(&mut self, asked: &Transition) -> std::result::Result<Step, String> {
        let is_meant = |it: &Step| match asked.label.as_str() {
            "" => it.id == asked.id,
            label => it.label == label,
        };
        let Some(step) = self.steps().find(is_meant) else {
            let labels: Vec<&str> = self.steps().map(|it| it.label).collect();
            let labels = if labels.is_empty() {
                "nothing".to_owned()
            } else {
                labels.join(" or ")
            };
            let named = match asked.label.as_str() {
                "" => asked.id.to_string(),
                label => format!("`{label}`"),
            };
            return Err(format!(
                "there is no transition {named} from {}: {labels} is possible",
                self.state.label()
            ));
        };
        self.state = step.to;
        Ok(step)
    }

    /// The work is done; `None` in a state without any.
    pub(crate) fn end(&mut self, is_good: bool) -> Option<Step> {
        let from = self.state;
        let (id, good, bad) = from.ends()?;
        let ended = if is_good {
            step(id, "transition_success", from, good)
        } else {
            step(id + 1, "transition_failure", from, bad)
        };
        self.state = ended.to;
        Some(ended)
    }
}

/// `lifecycle_msgs/msg/State`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct StateMessage {
    id: u8,
    label: String,
}

/// `lifecycle_msgs/msg/Transition`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Transition {
    id: u8,
    label: String,
}

/// `lifecycle_msgs/msg/TransitionDescription`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct TransitionDescription {
    transition: Transition,
    start_state: StateMessage,
    goal_state: StateMessage,
}

/// `lifecycle_msgs/msg/TransitionEvent`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct TransitionEvent {
    timestamp: u64,
    transition: Transition,
    start_state: StateMessage,
    goal_state: StateMessage,
}

/// The request of `lifecycle_msgs/srv/ChangeState`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Change {
    transition: Transition,
}

/// Its answer.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Changed {
    success: bool,
}

/// The answer of `lifecycle_msgs/srv/GetState`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct CurrentState {
    current_state: StateMessage,
}

/// The answer of `lifecycle_msgs/srv/GetAvailableStates`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct AvailableStates {
    available_states: Vec<StateMessage>,
}

/// The answer of `lifecycle_msgs/srv/GetAvailableTransitions`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct AvailableTransitions {
    available_transitions: Vec<TransitionDescription>,
}

impl Message for Change {}
impl Message for Changed {}
impl Message for CurrentState {}
impl Message for AvailableStates {}
impl Message for AvailableTransitions {}

/// What is asked of a managed node.
#[derive(Debug)]
pub(crate) enum LifecycleRequest {
    Change(RmwRequestId, Transition),
    State(RmwRequestId),
    States(RmwRequestId),
    Transitions(RmwRequestId),
}

/// The services of managed nodes.
pub(crate) struct LifecycleServices {
    change: Server<Change, Changed>,
    state: Server<Empty, CurrentState>,
    states: Server<Empty, AvailableStates>,
    transitions: Server<Empty, AvailableTransitions>,
}

impl LifecycleServices {
    pub(crate) fn create(node: &mut Node, names: &RosArguments) -> Result<Self> {
        let kind = |name: &str| ServiceTypeName::new("lifecycle_msgs", name);
        Ok(Self {
            change: create(node, names, "~/change_state", &kind("ChangeState"))?,
            state: create(node, names, "~/get_state", &kind("GetState"))?,
            states: create(
                node,
                names,
                "~/get_available_states",
                &kind("GetAvailableStates"),
            )?,
            transitions: create(
                node,
                names,
                "~/get_available_transitions",
                &kind("GetAvailableTransitions"),
            )?,
        })
    }

    pub(crate) fn requests(&self) -> LocalBoxStream<'_, ReadResult<LifecycleRequest>> {
        use LifecycleRequest as Asked;
        futures::stream::select_all([
            (self.change.receive_request_stream())
                .map(|it| it.map(|(id, it)| Asked::Change(id, it.transition)))
                .boxed_local(),
            (self.state.receive_request_stream())
                .map(|it| it.map(|(id, _)| Asked::State(id)))
                .boxed_local(),
            (self.states.receive_request_stream())
                .map(|it| it.map(|(id, _)| Asked::States(id)))
                .boxed_local(),
            (self.transitions.receive_request_stream())
                .map(|it| it.map(|(id, _)| Asked::Transitions(id)))
                .boxed_local(),
        ])
        .boxed_local()
    }

    /// Answers what is only asked about; gives back what shall change.
    ///
    /// Fails if the answer cannot be sent.
    pub(crate) fn answer(
        &self,
        machine: &Machine,
        request: LifecycleRequest,
    ) -> Result<Option<(RmwRequestId, Transition)>> {
        match request {
            LifecycleRequest::Change(id, asked) => return Ok(Some((id, asked))),
            LifecycleRequest::State(id) => {
                let current_state = machine.state().message();
                (self.state).send_response(id, CurrentState { current_state })?;
            }
            LifecycleRequest::States(id) => {
                let available_states = LABELS
                    .iter()
                    .map(|&(id, label)| StateMessage {
                        id,
                        label: label.to_owned(),
                    })
                    .collect();
                (self.states).send_response(id, AvailableStates { available_states })?;
            }
            LifecycleRequest::Transitions(id) => {
                let available_transitions = machine.steps().map(Step::description).collect();
                let answer = AvailableTransitions {
                    available_transitions,
                };
                self.transitions.send_response(id, answer)?;
            }
        }
        Ok(None)
    }

    /// Says whether a change went well.
    ///
    /// Fails if the answer cannot be sent.
    pub(crate) fn changed(&self, id: RmwRequestId, success: bool) -> Result<()> {
        Ok(self.change.send_response(id, Changed { success })?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labelled(label: &str) -> Transition {
        Transition {
            id: 0,
            label: label.to_owned(),
        }
    }

    fn numbered(id: u8) -> Transition {
        Transition {
            id,
            label: String::new(),
        }
    }

    #[test]
    fn a_life_leads_through_all_states_and_ends_once() {
        let mut machine = Machine::new(State::Unconfigured);
        for (asked, number, through, to) in [
            ("configure", 1, State::Configuring, State::Inactive),
            ("activate", 3, State::Activating, State::Active),
            ("deactivate", 4, State::Deactivating, State::Inactive),
            ("cleanup", 2, State::CleaningUp, State::Unconfigured),
            ("shutdown", 5, State::ShuttingDown, State::Finalized),
        ] {
            let from = machine.state();
            let begun = machine.begin(&labelled(asked)).expect("possible");
            assert_eq!(begun, step(number, asked_label(asked), from, through));
            // Nothing else begins meanwhile.
            assert!(machine.begin(&numbered(number)).is_err());
            assert!(machine.state().may_have_map() != (through == State::ShuttingDown));
            let ended = machine.end(true).expect("work was done");
            assert_eq!((ended.from, ended.to, machine.state()), (through, to, to));
            assert_eq!(machine.end(true), None);
        }
        let error = machine.begin(&labelled("configure")).expect_err("over");
        assert!(error.contains("finalized: nothing is possible"), "{error}");
    }

    fn asked_label(label: &str) -> &'static str {
        let found = STEPS.iter().find(|it| it.label == label);
        found.expect("there is one").label
    }

    #[test]
    fn what_fails_leads_back_and_shutting_down_ends_anyway() {
        for (from, asked, to) in [
            (State::Unconfigured, 1, State::Unconfigured),
            (State::Inactive, 2, State::Inactive),
            (State::Inactive, 3, State::Inactive),
            (State::Active, 4, State::Active),
            (State::Active, 7, State::Finalized),
        ] {
            let mut machine = Machine::new(from);
            machine.begin(&numbered(asked)).expect("possible");
            let ended = machine.end(false).expect("work was done");
            assert_eq!((ended.label, machine.state()), ("transition_failure", to));
        }
        let mut machine = Machine::new(State::Active);
        let error = machine.begin(&numbered(1)).expect_err("configured already");
        assert!(
            error.contains("from active: deactivate or shutdown"),
            "{error}"
        );
        // A label counts more than a number, which is zero where nobody has set it.
        let both = Transition {
            id: 4,
            label: "shutdown".into(),
        };
        assert_eq!(machine.begin(&both).map(|it| it.id), Ok(7));
    }
}
