//! What does the node listen to, and what does it say?
//!
//! One thread waits for everything at once: images, the clock, requests, answers of the robot's
//! thread. It only passes on, so it is always ready for the next image.

use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv4Addr};
use std::sync::mpsc::Sender;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, anyhow};
use chronotope::error::printable;
use chronotope::map::PlaceKey;
use chronotope::time::Time;
use chronotope_terminal::{interrupt, note};
use futures::StreamExt;
use futures::channel::mpsc::{UnboundedReceiver, unbounded};
use futures::channel::oneshot;
use futures::future::LocalBoxFuture;
use futures::stream::{FuturesUnordered, LocalBoxStream};
use ros2_client::dds::rustdds::{
    DomainParticipantBuilder, DomainParticipantStatusEvent, QosPolicies, StatusEvented,
};
use ros2_client::request_id::RmwRequestId;
use ros2_client::{Context, Log, Node, NodeName, NodeOptions, QosProfile, Subscription};

use crate::arguments::RosArguments;
use crate::clerk::{self, Task};
use crate::diagnostics::{ERROR, Health, Mismatch, OK};
use crate::engine::{Answered, Command, Engine, Mailbox, Pixels, Reply, Report, Shot};
use crate::lifecycle::{LifecycleRequest, LifecycleServices, Machine, State, Transition};
use crate::messages::{Clock, ClosestEdges, Float32, Outcome, Text};
use crate::parameters::{LEARNING, PARAMETERS, Settings};
use crate::planner::PlannerView;
use crate::services::{Asker, ParameterRequest, ParameterServices, Request, Services};
use crate::topics::{Camera, Creator, Ends, Publishers};

/// How often it is looked whether something is due.
const TICK: Duration = Duration::from_millis(50);
const DIAGNOSTICS_PERIOD: Duration = Duration::from_secs(1);
/// The map's file is looked at so often where nobody wants it taken over.
const LOOK_PERIOD: Duration = Duration::from_secs(5);
/// Images that cannot be used are logged so often: each stands in the diagnostics anyway.
const FAILURE_PERIOD: Duration = Duration::from_secs(60);
/// An image of a place that was named has to come within this.
const LESSON_PATIENCE: Duration = Duration::from_secs(5);
/// For so long it is heard how the robot's thread ends; a little later `interrupt` ends the process.
const END_PATIENCE: Duration = Duration::from_millis(1_200);

/// Levels of `rcl_interfaces/msg/Log`.
const LOG_INFO: u8 = 20;
const LOG_WARN: u8 = 30;
const LOG_ERROR: u8 = 40;

/// Whatever comes.
enum Input {
    Pixels(std::result::Result<Pixels, String>),
    Clock(Option<Time>),
    Asked(Asker, Request),
    Parameters(ParameterRequest),
    Lifecycle(LifecycleRequest),
    Status(DomainParticipantStatusEvent),
    Report(Report),
    Misunderstood(String),
    Tick,
}

/// Runs the node until it is interrupted.
///
/// Fails if the map cannot be opened, a name makes no sense or the network cannot be used.
pub(crate) fn run(names: &RosArguments) -> Result<()> {
    let settings = Settings::read(|name| names.parameter(name).cloned());
    let (opened, state) = if settings.is_autostarted {
        (Some(clerk::open(&settings.source)?), State::Active)
    } else {
        (None, State::Unconfigured)
    };
    let context = Context::from_domain_participant(participant()?.build()?)?;
    let node_name = NodeName::new(&names.namespace, &names.node)
        .map_err(|cause| anyhow!("`{}{}`: {cause}", names.namespace, names.node))?;
    let mut node = context.new_node(node_name, options(names))?;
    let log = node.create_publisher(&context.get_rosout_topic(), None)?;
    let services = Services::create(&mut node, names)?;
    let parameters = ParameterServices::create(&mut node, names)?;
    let lifecycle = LifecycleServices::create(&mut node, names)?;
    let mut creator = Creator {
        node: &mut node,
        names,
        ends: Ends::new(),
    };
    let publishers = creator.publishers(log)?;
    let clock: Subscription<Clock> = creator.subscription(
        "/clock",
        ("rosgraph_msgs", "Clock"),
        &QosProfile::subscription_default(),
    )?;
    let camera = creator.camera(settings.is_compressed, settings.is_reliable)?;
    let ends = creator.ends;

    let (reports, heard) = unbounded();
    let mailbox = Mailbox::default();
    let stamp = opened.as_ref().map(|it| it.stamp);
    let (tasks, clerk) = clerk::start(mailbox.clone(), reports.clone(), stamp)?;
    let retire = tasks.clone();
    let engine = Engine::start(
        opened,
        settings.clone(),
        names.resolve("image"),
        mailbox.clone(),
        reports,
        Box::new(move |robot| {
            // Without a clerk the node ends, and the robot commits as it goes.
            let _ = retire.send(Task::Retire(robot));
        }),
    )?;
    let full_name = node.fully_qualified_name();
    let listener = context.domain_participant().status_listener();
    let offered = Offered {
        services: &services,
        parameters: &parameters,
        lifecycle: &lifecycle,
    };
    let inputs = inputs(&camera, &clock, offered, heard, &listener);
    let mut running = Running {
        health: Health::new(full_name.trim_start_matches('/')),
        topic: names.resolve("image"),
        picture_topic: names.resolve("~/debug/image"),
        node: &node,
        offered,
        machine: Machine::new(state),
        publishers: &publishers,
        mailbox,
        tasks,
        ends,
        settings,
        said: None,
        levels: BTreeMap::new(),
        simulated: None,
        due: Due::default(),
        end: None,
        waiting: FuturesUnordered::new(),
    };
    running.begin();
    futures::executor::block_on(running.follow(inputs));
    if engine.join().is_err() {
        return Err(anyhow!("the robot's thread has panicked"));
    }
    // The clerk ends with the last who can give it a task, and may be writing what a robot that was
    // replaced has learnt.
    drop(running);
    if clerk.join().is_err() {
        return Err(anyhow!("the clerk's thread has panicked"));
    }
    Ok(())
}

/// All parameters with their values. Its own services of parameters have descriptions.
fn options(names: &RosArguments) -> NodeOptions {
    let mut options = NodeOptions::new()
        .enable_rosout(false)
        .start_parameter_services(false);
    for declared in PARAMETERS {
        let value = names.parameter(declared.name).cloned();
        let value = value.unwrap_or_else(|| declared.default_value());
        options = options.declare_parameter(declared.name, value);
    }
    options
}

/// On which network and domain, as the environment says.
fn participant() -> Result<DomainParticipantBuilder> {
    let domain = match std::env::var("ROS_DOMAIN_ID") {
        Ok(text) if !text.is_empty() => (text.parse::<u16>().ok())
            .filter(|it| *it <= 232)
            .with_context(|| format!("ROS_DOMAIN_ID is `{text}`, not a number from 0 to 232"))?,
        _ => 0,
    };
    let builder = DomainParticipantBuilder::new(domain);
    let is = |name: &str, value: &str| std::env::var(name).is_ok_and(|it| it == value);
    let is_local =
        is("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST") || is("ROS_LOCALHOST_ONLY", "1");
    Ok(if is_local {
        builder.with_only_networks([IpAddr::V4(Ipv4Addr::LOCALHOST)])
    } else {
        builder
    })
}

/// What can be asked of the node.
#[derive(Clone, Copy)]
struct Offered<'a> {
    services: &'a Services,
    parameters: &'a ParameterServices,
    lifecycle: &'a LifecycleServices,
}

/// Everything that comes, in the order in which it does.
fn inputs<'a>(
    camera: &'a Camera,
    clock: &'a Subscription<Clock>,
    offered: Offered<'a>,
    heard: UnboundedReceiver<Report>,
    listener: &'a ros2_client::dds::rustdds::DomainParticipantStatusListener,
) -> LocalBoxStream<'a, Input> {
    let misunderstood = |cause: ros2_client::ReadError| Input::Misunderstood(cause.to_string());
    let (ticks, ticking) = unbounded();
    std::thread::spawn(move || {
        while ticks.unbounded_send(()).is_ok() {
            std::thread::sleep(TICK);
        }
    });
    futures::stream::select_all([
        camera.images().map(Input::Pixels).boxed_local(),
        (clock.async_stream())
            .map(|it| Input::Clock(it.ok().and_then(|(clock, _)| clock.clock.time())))
            .boxed_local(),
        (offered.services.requests())
            .map(move |it| match it {
                Ok((asker, request)) => Input::Asked(asker, request),
                Err(cause) => misunderstood(cause),
            })
            .boxed_local(),
        (offered.parameters.requests())
            .map(move |it| it.map_or_else(misunderstood, Input::Parameters))
            .boxed_local(),
        (offered.lifecycle.requests())
            .map(move |it| it.map_or_else(misunderstood, Input::Lifecycle))
            .boxed_local(),
        listener
            .as_async_status_stream()
            .map(Input::Status)
            .boxed_local(),
        heard.map(Input::Report).boxed_local(),
        ticking.map(|()| Input::Tick).boxed_local(),
    ])
    .boxed_local()
}

/// When something was done last.
#[derive(Default)]
struct Due {
    diagnostics: Option<Instant>,
    look: Option<Instant>,
    picture: Option<Instant>,
    failure: Option<Instant>,
}

/// Whether a period has passed since `last`, which then begins anew.
fn is_due(last: &mut Option<Instant>, period: Duration) -> bool {
    let now = Instant::now();
    let is_due = last.is_none_or(|last| now.duration_since(last) >= period);
    if is_due {
        *last = Some(now);
    }
    is_due
}

/// Who waits for what another thread does.
#[derive(Clone, Copy)]
enum Waiting {
    Asker(Asker),
    /// For the end of a transition.
    Change(RmwRequestId),
}

type Answering = LocalBoxFuture<'static, (Waiting, std::result::Result<String, String>)>;

/// A node that runs.
struct Running<'a> {
    node: &'a Node,
    offered: Offered<'a>,
    machine: Machine,
    publishers: &'a Publishers,
    mailbox: Mailbox,
    tasks: Sender<Task>,
    ends: Ends,
    settings: Settings,
    health: Health,
    topic: String,
    picture_topic: String,
    /// What planners were told last.
    said: Option<PlannerView>,
    /// The levels and messages that were logged last, by name.
    levels: BTreeMap<String, (u8, String)>,
    /// What the clock of a simulation says.
    simulated: Option<Time>,
    due: Due,
    /// Until when the robot's thread may finish.
    end: Option<Instant>,
    waiting: FuturesUnordered<Answering>,
}

impl Running<'_> {
    fn begin(&mut self) {
        let (name, state) = (self.node.fully_qualified_name(), self.machine.state());
        self.health.state = state;
        let begun = match state {
            State::Active => format!("{name} waits for images on {}", self.topic),
            _ => format!("{name} is {}: it waits for ~/change_state", state.label()),
        };
        self.log(LOG_INFO, &begun);
        self.say(&PlannerView::nowhere());
    }

    async fn follow(&mut self, inputs: LocalBoxStream<'_, Input>) {
        let mut inputs = inputs.fuse();
        loop {
            futures::select! {
                input = inputs.select_next_some() => {
                    if self.take(input) {
                        return;
                    }
                }
                (waiting, done) = self.waiting.select_next_some() => self.answer(waiting, done),
            }
        }
    }

    /// Does what an input asks for; true if that was the end.
    fn take(&mut self, input: Input) -> bool {
        match input {
            Input::Pixels(Ok(pixels)) => self.see(pixels),
            Input::Pixels(Err(cause)) => {
                self.fail(format!(
                    "{}: it carries something else ({cause})",
                    self.topic
                ));
            }
            Input::Clock(time) => {
                self.simulated = time;
                self.health.last_clock = Some(Instant::now());
            }
            Input::Asked(asker, request) => self.serve(asker, request),
            Input::Parameters(request) => {
                if let Err(error) = self.offered.parameters.answer(self.node, request) {
                    self.not_sent(&error);
                }
                // What was set is set, also where nobody heard of it.
                self.configure();
            }
            Input::Lifecycle(request) => {
                match self.offered.lifecycle.answer(&self.machine, request) {
                    Ok(Some((id, asked))) => self.change(id, &asked),
                    Ok(None) => {}
                    Err(error) => self.not_sent(&error),
                }
            }
            Input::Status(event) => self.hear_of(event),
            Input::Report(Report::Ended) => return true,
            Input::Report(report) => self.hear(report),
            Input::Misunderstood(cause) => {
                self.log(LOG_WARN, &format!("a request cannot be read: {cause}"));
            }
            Input::Tick => return self.tick(),
        }
        false
    }

    fn now(&self) -> Time {
        match self.simulated {
            Some(time) if self.settings.uses_sim_time => time,
            _ => Time::now(),
        }
    }

    fn see(&mut self, pixels: Pixels) {
        if self.machine.state() != State::Active {
            return;
        }
        let received = Instant::now();
        self.health
            .count_image(received, pixels.header().stamp.time());
        let simulated = self
            .settings
            .uses_sim_time
            .then_some(self.simulated)
            .flatten();
        self.mailbox.see(Shot {
            pixels,
            received,
            simulated,
        });
    }

    /// An image cannot be used.
    fn fail(&mut self, error: String) {
        if is_due(&mut self.due.failure, FAILURE_PERIOD) {
            self.log(LOG_ERROR, &error);
        }
        self.health.fail(error);
    }

    fn hear(&mut self, report: Report) {
        match report {
            Report::Answered(answered) => self.publish(*answered),
            Report::Failed(error) => self.fail(error.to_string()),
            Report::Warning(text) => self.log(LOG_WARN, &text),
            Report::Info(text) => self.log(LOG_INFO, &text),
            Report::Map(map) => self.health.map = map,
            Report::InFile(generation) => self.health.map.in_file = generation,
            Report::Learning(state) => self.health.learning = state,
            Report::Ended => {}
        }
    }

    fn publish(&mut self, answered: Answered) {
        if self.machine.state() != State::Active {
            // It was asked for before the state changed.
            return;
        }
        self.health.count_answer(&answered, self.now());
        // A camera that was lost while its last image was answered is lost.
        if self.health.silence(Instant::now()) <= self.settings.camera_timeout {
            self.say(&answered.view);
        }
        let text = Text {
            data: answered.json,
        };
        self.sent(
            "~/localization",
            self.publishers.localization.publish(text).is_ok(),
        );
        if let Some(picture) = answered.picture {
            self.sent(
                "~/debug/image",
                self.publishers.picture.publish(picture).is_ok(),
            );
        }
    }

    /// Tells planners what has changed.
    fn say(&mut self, view: &PlannerView) {
        let said = self.said.replace(view.clone());
        let is_new = |differs: fn(&PlannerView, &PlannerView) -> bool| {
            said.as_ref().is_none_or(|said| differs(said, view))
        };
        let text = |name: &str| Text {
            data: name.to_owned(),
        };
        let out = self.publishers;
        let mut is_sent = true;
        if is_new(|a, b| a.current != b.current) {
            is_sent &= out.current.publish(text(&view.current)).is_ok();
        }
        if is_new(|a, b| a.closest != b.closest) {
            is_sent &= out.closest.publish(text(&view.closest)).is_ok();
        }
        // Not a number is like itself here.
        if is_new(|a, b| a.closest_m.to_bits() != b.closest_m.to_bits()) {
            let data = view.closest_m;
            is_sent &= out.closest_m.publish(Float32 { data }).is_ok();
        }
        let bits = |view: &PlannerView| -> Vec<u32> {
            view.edges_m.iter().map(|it| it.to_bits()).collect()
        };
        let is_same = |said: &PlannerView| said.edges == view.edges && bits(said) == bits(view);
        if !said.as_ref().is_some_and(is_same) {
            let edges = ClosestEdges {
                edge_ids: view.edges.clone(),
                distances: view.edges_m.clone(),
            };
            is_sent &= out.edges.publish(edges).is_ok();
        }
        if !is_sent {
            // Everything again with the next answer.
            self.said = None;
        }
        self.sent("current_node and the topics beside it", is_sent);
    }

    fn sent(&self, topic: &str, is_sent: bool) {
        if !is_sent {
            self.log(LOG_WARN, &format!("{topic}: a message could not be sent"));
        }
    }

    /// Tells somebody how it went.
    fn answer(&mut self, waiting: Waiting, done: std::result::Result<String, String>) {
        let sent = match waiting {
            Waiting::Asker(asker) => self.offered.services.answer(asker, Outcome::from(done)),
            Waiting::Change(id) => {
                let success = self.end_change(&done);
                self.offered.lifecycle.changed(id, success)
            }
        };
        if let Err(error) = sent {
            self.not_sent(&error);
        }
    }

    fn not_sent(&self, error: &anyhow::Error) {
        self.log(LOG_WARN, &format!("an answer could not be sent: {error}"));
    }

    fn wait_for(&mut self, waiting: Waiting) -> Reply {
        let (reply, answered) = oneshot::channel();
        self.waiting.push(Box::pin(async move {
            let gone = || Err("the node ends".to_owned());
            (waiting, answered.await.unwrap_or_else(|_| gone()))
        }));
        reply
    }

    /// Begins a change of the node's state, if it is possible.
    fn change(&mut self, id: RmwRequestId, asked: &Transition) {
        let step = match self.machine.begin(asked) {
            Ok(step) => step,
            Err(why) => {
                self.log(LOG_WARN, &why);
                if let Err(error) = self.offered.lifecycle.changed(id, false) {
                    self.not_sent(&error);
                }
                return;
            }
        };
        self.tell_of(step);
        let reply = self.wait_for(Waiting::Change(id));
        if step.from == State::Active {
            self.mailbox.forget_image();
            self.say(&PlannerView::nowhere());
        }
        match step.to {
            State::Configuring => self.give(Task::Open {
                source: self.settings.source.clone(),
                begins: true,
                reply: Some(reply),
            }),
            State::Activating => {
                self.health.begin();
                crate::engine::answer(Some(reply), Ok("images are answered".into()));
            }
            State::Deactivating => self.mailbox.tell(Command::Commit(reply)),
            to => self.mailbox.tell(Command::Close {
                is_last: to == State::ShuttingDown,
                reply,
            }),
        }
    }

    /// What was to be done for a change is done; true if it went well.
    fn end_change(&mut self, done: &std::result::Result<String, String>) -> bool {
        if let Err(why) = done {
            self.log(
                LOG_ERROR,
                &format!("{}: {why}", self.machine.state().label()),
            );
        }
        // What could not be written is written before the map is closed, or that fails.
        let success = done.is_ok() || self.machine.state() == State::Deactivating;
        if let Some(step) = self.machine.end(success) {
            self.tell_of(step);
        }
        success
    }

    fn tell_of(&mut self, step: crate::lifecycle::Step) {
        self.health.state = step.to;
        self.log(
            LOG_INFO,
            &format!("{} -> {}", step.from.label(), step.to.label()),
        );
        let ns = u64::try_from(self.now().as_us()).unwrap_or(0) * 1_000;
        self.sent(
            "~/transition_event",
            self.publishers.transition.publish(step.event(ns)).is_ok(),
        );
    }

    /// Passes a request on to the thread that answers it.
    fn serve(&mut self, asker: Asker, request: Request) {
        let reply = self.wait_for(Waiting::Asker(asker));
        let source = self.settings.source.clone();
        let state = self.machine.state();
        let is_possible = match request {
            Request::PauseLearning(_) => true,
            Request::SetPlace(_) => state == State::Active,
            _ => state.has_map(),
        };
        if !is_possible {
            let why = format!(
                "the node is {}: configure and activate it (ros2 lifecycle set)",
                state.label()
            );
            crate::engine::answer(Some(reply), Err(why));
            return;
        }
        match request {
            Request::Commit => self.mailbox.tell(Command::Commit(reply)),
            Request::PauseLearning(is_paused) => self.pause(is_paused, reply),
            Request::SetPlace(name) => match PlaceKey::written(&name) {
                Ok(place) => self.mailbox.tell(Command::Teach {
                    place,
                    until: Instant::now() + LESSON_PATIENCE,
                    reply,
                }),
                Err(error) => crate::engine::answer(Some(reply), Err(error.to_string())),
            },
            Request::ReloadMap => self.give(Task::Open {
                source,
                begins: false,
                reply: Some(reply),
            }),
            Request::ListVisits => self.give(Task::Held(source.map, reply)),
            Request::AcceptVisits(ids) => self.give(Task::Accept(source, ids, reply)),
            Request::DropVisits(ids) => self.give(Task::Drop(source, ids, reply)),
        }
    }

    fn give(&self, task: Task) {
        // A clerk that is gone drops what it was told, and whoever waits hears of it.
        let _ = self.tasks.send(task);
    }

    fn pause(&mut self, is_paused: bool, reply: Reply) {
        let value = ros2_client::ParameterValue::Boolean(!is_paused);
        let done = self.node.set_parameter(LEARNING, value);
        self.configure();
        let is_on = !is_paused && self.settings.source.learns;
        let words = match (is_paused, is_on) {
            (true, _) => "learning is paused",
            (false, true) => "learning goes on",
            (false, false) => "not paused; nothing is learnt, as learn is false",
        };
        crate::engine::answer(Some(reply), done.map(|()| words.to_owned()));
    }

    /// Applies parameters that have changed.
    fn configure(&mut self) {
        let settings = Settings::read(|name| self.node.get_parameter(name));
        if settings == self.settings {
            return;
        }
        let before = std::mem::replace(&mut self.settings, settings);
        (self.mailbox).tell(Command::Configure(Box::new(self.settings.clone())));
        if before.source != self.settings.source && self.machine.state().may_have_map() {
            self.give(Task::Open {
                source: self.settings.source.clone(),
                begins: false,
                reply: None,
            });
        }
    }

    /// Keeps count of whom the node cannot hear or be heard by.
    fn hear_of(&mut self, event: DomainParticipantStatusEvent) {
        use DomainParticipantStatusEvent as Event;
        let (end, other, why) = match event {
            Event::RemoteWriterQosIncompatible {
                local_reader,
                remote_writer,
                requested_qos,
                offered_qos,
            } => {
                let why = difference(&requested_qos, &offered_qos);
                (
                    local_reader,
                    remote_writer,
                    format!("a publisher offers {why}"),
                )
            }
            Event::RemoteReaderQosIncompatible {
                local_writer,
                remote_reader,
                requested_qos,
                offered_qos,
            } => {
                let why = difference(&requested_qos, &offered_qos);
                (
                    local_writer,
                    remote_reader,
                    format!("a subscriber gets {why}"),
                )
            }
            Event::ReaderLost { guid, .. } | Event::WriterLost { guid, .. } => {
                self.health.mismatches.remove(&format!("{guid:?}"));
                return;
            }
            _ => return,
        };
        if let Some(topic) = self.ends.get(&end) {
            let why = format!("{topic}: no QoS in common: {why}");
            let mismatch = Mismatch {
                is_of_camera: *topic == self.topic,
                why,
            };
            self.health
                .mismatches
                .insert(format!("{other:?}"), mismatch);
        }
    }

    /// Does what is due; true at the end.
    fn tick(&mut self) -> bool {
        let now = Instant::now();
        if let Some(end) = self.end {
            return now > end;
        }
        if interrupt::is_requested() {
            self.end = Some(now + END_PATIENCE);
            self.mailbox.tell(Command::End);
            return false;
        }
        let is_active = self.machine.state() == State::Active;
        if is_active && self.health.silence(now) > self.settings.camera_timeout {
            self.say(&PlannerView::nowhere());
        }
        if let Some(period) = self.settings.debug_period
            && is_active
            && self.node.subscription_count(&self.picture_topic) > 0
            && is_due(&mut self.due.picture, period)
        {
            self.mailbox.want_picture();
        }
        let period = self.settings.watch_map.unwrap_or(LOOK_PERIOD);
        let has_map = self.machine.state().has_map();
        if has_map && !self.settings.source.learns && is_due(&mut self.due.look, period) {
            self.give(Task::Look {
                source: self.settings.source.clone(),
                opens: self.settings.watch_map.is_some(),
            });
        }
        if is_due(&mut self.due.diagnostics, DIAGNOSTICS_PERIOD) {
            self.diagnose();
        }
        false
    }

    /// Publishes the diagnostics, and logs what has changed in them.
    fn diagnose(&mut self) {
        let array = self.health.array(&self.settings, self.now());
        for status in &array.status {
            let said = self.levels.get(&status.name);
            if said.map_or(OK, |it| it.0) != status.level {
                let level = match status.level {
                    OK => LOG_INFO,
                    ERROR => LOG_ERROR,
                    _ => LOG_WARN,
                };
                self.log(level, &format!("{}: {}", status.name, status.message));
            }
            let known = (status.level, status.message.clone());
            self.levels.insert(status.name.clone(), known);
        }
        self.sent(
            "/diagnostics",
            self.publishers.diagnostics.publish(array).is_ok(),
        );
    }

    /// Says something to people: on stderr and on `/rosout`.
    fn log(&self, level: u8, text: &str) {
        note!("{text}");
        let log = Log {
            stamp: ros2_client::builtin_interfaces::Time::now(),
            level,
            name: self
                .node
                .fully_qualified_name()
                .trim_start_matches('/')
                .replace('/', "."),
            msg: printable(text).to_string(),
            file: String::new(),
            function: String::new(),
            line: 0,
        };
        // Whoever listens to it misses a line; it stands on stderr.
        let _ = self.publishers.log.publish(log);
    }
}

/// What one side wants and the other has not.
fn difference(requested: &QosPolicies, offered: &QosPolicies) -> String {
    use ros2_client::dds::rustdds::policy::{Durability as Kept, Reliability as Sent};
    let mut words = Vec::new();
    let is_reliable = |qos: &QosPolicies| matches!(qos.reliability(), Some(Sent::Reliable { .. }));
    if is_reliable(requested) && !is_reliable(offered) {
        words.push("best_effort, but reliable is wanted".to_owned());
    }
    let is_kept = |qos: &QosPolicies| !matches!(qos.durability(), None | Some(Kept::Volatile));
    if is_kept(requested) && !is_kept(offered) {
        words.push("volatile, but transient_local is wanted".to_owned());
    }
    if words.is_empty() {
        words.push("another deadline, liveliness, order or partition than is wanted".to_owned());
    }
    words.join(", and ")
}
