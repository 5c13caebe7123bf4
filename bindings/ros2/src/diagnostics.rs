//! Is everything well with the camera, the clock, the map, what is learnt and who listens?
//!
//! One `diagnostic_msgs/msg/DiagnosticArray` a second. Each line says what is wrong and what helps;
//! what has changed since is also logged.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use chronotope::time::Time;

use crate::engine::{Answered, InFile, LearningState, MapState};
use crate::lifecycle::State;
use crate::messages::{DiagnosticArray, DiagnosticStatus, Header, KeyValue, Stamp};
use crate::parameters::Settings;

/// The levels of `DiagnosticStatus`.
pub(crate) const OK: u8 = 0;
pub(crate) const WARN: u8 = 1;
pub(crate) const ERROR: u8 = 2;

/// Images whose brightest pixels are darker than this show the night without lamps, or a lid.
const DARK: u8 = 24;
/// Images whose grey levels lie within so many show a wall, fog or a lid.
const FLAT: u8 = 12;
/// Stamps may wander from the machine's steady clock by so much between two images, s.
const MAX_WANDER_S: f64 = 2.0;
/// A jump of the clock is told for so long.
const JUMP_SHOWN: Duration = Duration::from_secs(10);
/// A simulation whose clock says nothing for so long stands still, or has ended.
const CLOCK_TIMEOUT: Duration = Duration::from_secs(5);

/// Somebody who cannot be understood, or cannot understand.
#[derive(Clone, Debug)]
pub(crate) struct Mismatch {
    /// Whether that is why no image comes.
    pub(crate) is_of_camera: bool,
    pub(crate) why: String,
}

/// What is known of the last seconds.
pub(crate) struct Health {
    name: String,
    begun: Instant,
    last_image: Option<Instant>,
    last_stamp: Option<(Instant, Time)>,
    jump: Option<(Instant, f64)>,
    /// Why the last image could not be used.
    failure: Option<String>,
    last: Option<LastAnswer>,
    num_images: u64,
    num_answers: u64,
    num_dropped: u64,
    /// By what identifies the other side.
    pub(crate) mismatches: BTreeMap<String, Mismatch>,
    pub(crate) map: MapState,
    pub(crate) learning: LearningState,
    /// When the clock of a simulation was heard last.
    pub(crate) last_clock: Option<Instant>,
    pub(crate) state: State,
}

struct LastAnswer {
    num_features: usize,
    gray_range: Option<(u8, u8)>,
    latency: Duration,
    /// Seconds from the stamp to when the image came.
    age_s: f64,
}

impl Health {
    pub(crate) fn new(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            begun: Instant::now(),
            last_image: None,
            last_stamp: None,
            jump: None,
            failure: None,
            last: None,
            num_images: 0,
            num_answers: 0,
            num_dropped: 0,
            mismatches: BTreeMap::new(),
            map: MapState::default(),
            learning: LearningState::default(),
            last_clock: None,
            state: State::Active,
        }
    }

    /// Images are answered from now on.
    pub(crate) fn begin(&mut self) {
        self.begun = Instant::now();
        (self.last_image, self.last_stamp, self.last) = (None, None, None);
        self.failure = None;
    }

    /// An image came, with this stamp, if it has one.
    pub(crate) fn count_image(&mut self, received: Instant, stamp: Option<Time>) {
        self.num_images += 1;
        self.last_image = Some(received);
        let Some(stamp) = stamp else {
            return;
        };
        if let Some((before, last)) = self.last_stamp {
            let passed_s = received.duration_since(before).as_secs_f64();
            let wander_s = stamp.since_s(last) - passed_s;
            if wander_s.abs() > MAX_WANDER_S + passed_s {
                self.jump = Some((received, wander_s));
            }
        }
        self.last_stamp = Some((received, stamp));
    }

    pub(crate) fn count_answer(&mut self, answered: &Answered, now: Time) {
        self.num_answers += 1;
        self.num_dropped = answered.num_dropped;
        self.failure = None;
        self.last = Some(LastAnswer {
            num_features: answered.num_features,
            gray_range: answered.gray_range,
            latency: answered.latency,
            age_s: now.since_s(answered.time) - answered.latency.as_secs_f64(),
        });
    }

    pub(crate) fn fail(&mut self, error: String) {
        self.failure = Some(error);
    }

    /// For how long no image has come.
    pub(crate) fn silence(&self, now: Instant) -> Duration {
        now.duration_since(self.last_image.unwrap_or(self.begun))
    }

    pub(crate) fn array(&self, settings: &Settings, time: Time) -> DiagnosticArray {
        let now = Instant::now();
        DiagnosticArray {
            header: Header {
                stamp: Stamp::from(time),
                frame_id: String::new(),
            },
            status: vec![
                self.status("camera", self.camera(settings, now), self.camera_values()),
                self.status("clock", self.clock(settings, now), Vec::new()),
                self.status("map", self.map_state(), self.map_values()),
                self.status(
                    "learning",
                    self.learning_state(settings),
                    self.learning_values(),
                ),
                self.status("topics", self.topics(), Vec::new()),
            ],
        }
    }

    fn status(
        &self,
        what: &str,
        (level, message): (u8, String),
        values: Vec<(&str, String)>,
    ) -> DiagnosticStatus {
        DiagnosticStatus {
            level,
            name: format!("{}: {what}", self.name),
            message,
            hardware_id: String::new(),
            values: values
                .into_iter()
                .map(|(key, value)| KeyValue {
                    key: key.to_owned(),
                    value,
                })
                .collect(),
        }
    }

    fn camera(&self, settings: &Settings, now: Instant) -> (u8, String) {
        if self.state != State::Active {
            let message = format!("the node is {}: images are left alone", self.state.label());
            return (OK, message);
        }
        let silence = self.silence(now);
        if let Some(whys) = self.mismatched(true) {
            return (ERROR, whys);
        }
        if silence > settings.camera_timeout {
            let message = match self.last_image {
                Some(_) => format!("lost: no image for {:.1} s", silence.as_secs_f64()),
                None => "no image yet: is the topic right, and what it carries (transport)?".into(),
            };
            return (ERROR, message);
        }
        if let Some(failure) = &self.failure {
            return (ERROR, format!("images cannot be used: {failure}"));
        }
        let Some(last) = &self.last else {
            return (OK, "no answer yet".into());
        };
        if let Some((darkest, brightest)) = last.gray_range {
            if brightest < DARK {
                return (WARN, format!("dark: no brighter than {brightest} of 255"));
            }
            if brightest - darkest < FLAT {
                let message = format!("covered: all pixels between {darkest} and {brightest}");
                return (WARN, message);
            }
        }
        if last.num_features < self.map.min_features {
            let message = format!("covered or blurred: {} features", last.num_features);
            return (WARN, message);
        }
        if last.age_s > settings.late_s {
            let message = format!("late: images are {:.1} s old when they come", last.age_s);
            return (WARN, message);
        }
        let latency_s = last.latency.as_secs_f64();
        if latency_s > settings.late_s {
            return (WARN, format!("late: an answer took {latency_s:.1} s"));
        }
        (OK, "images come".into())
    }

    /// Why others than the camera cannot be heard, or cannot hear.
    fn topics(&self) -> (u8, String) {
        match self.mismatched(false) {
            Some(whys) => (WARN, whys),
            None => (OK, "everybody can be understood".into()),
        }
    }

    /// Why nobody is understood on the camera's topic, or on the others.
    fn mismatched(&self, is_of_camera: bool) -> Option<String> {
        let of_it = (self.mismatches.values()).filter(|it| it.is_of_camera == is_of_camera);
        let whys: Vec<&str> = of_it.map(|it| it.why.as_str()).collect();
        (!whys.is_empty()).then(|| whys.join("; "))
    }

    fn camera_values(&self) -> Vec<(&'static str, String)> {
        let mut values = vec![
            ("images", self.num_images.to_string()),
            ("answered", self.num_answers.to_string()),
            ("dropped", self.num_dropped.to_string()),
        ];
        if let Some(last) = &self.last {
            values.push(("features", last.num_features.to_string()));
            values.push((
                "latency_ms",
                format!("{:.1}", last.latency.as_secs_f64() * 1e3),
            ));
        }
        values
    }

    fn clock(&self, settings: &Settings, now: Instant) -> (u8, String) {
        if settings.uses_sim_time {
            let Some(last) = self.last_clock else {
                let message = "use_sim_time is set, but nobody publishes /clock";
                return (ERROR, message.into());
            };
            let silence = now.saturating_duration_since(last);
            if silence > CLOCK_TIMEOUT {
                let message = format!(
                    "stands still: nothing on /clock for {:.0} s (is the simulation paused?)",
                    silence.as_secs_f64()
                );
                return (WARN, message);
            }
        }
        match self.jump {
            Some((at, by_s)) if now.duration_since(at) < JUMP_SHOWN => {
                let message = format!("jumped by {by_s:.1} s from one image to the next");
                (WARN, message)
            }
            _ => (OK, "steady".into()),
        }
    }

    fn map_state(&self) -> (u8, String) {
        let map = &self.map;
        if map.path.is_empty() {
            return (
                OK,
                format!("the node is {}: no map is open", self.state.label()),
            );
        }
        let outdated = |in_file: &str| {
            let message = format!("outdated: {in_file} (call ~/reload_map)");
            (WARN, message)
        };
        match &map.in_file {
            InFile::Same => (OK, format!("generation {}", map.generation)),
            InFile::Other(newer) if *newer > map.generation => {
                outdated(&format!("the file is at generation {newer}"))
            }
            InFile::Other(other) => outdated(&format!(
                "another map took the file's place, at generation {other}"
            )),
            InFile::Nothing(why) => (
                WARN,
                format!(
                    "goes on with generation {}, but the file cannot be read: {why}",
                    map.generation
                ),
            ),
        }
    }

    fn map_values(&self) -> Vec<(&'static str, String)> {
        vec![
            ("file", self.map.path.clone()),
            ("generation", self.map.generation.to_string()),
            ("places", self.map.num_places.to_string()),
            ("quarantined", self.map.num_held.to_string()),
        ]
    }

    fn learning_state(&self, settings: &Settings) -> (u8, String) {
        let state = &self.learning;
        if let Some(failure) = &state.failure {
            return (ERROR, format!("nothing is written: {failure}"));
        }
        let mode = match (state.is_on, settings.source.learns) {
            (true, _) => "on",
            (false, true) => "paused",
            (false, false) => "off",
        };
        match self.map.num_held {
            0 => (OK, mode.into()),
            num_held => (
                WARN,
                format!(
                    "{mode}; {num_held} visits are quarantined (~/list_visits, ~/accept_visits, \
                     ~/drop_visits)"
                ),
            ),
        }
    }

    fn learning_values(&self) -> Vec<(&'static str, String)> {
        let state = &self.learning;
        vec![
            ("learnt", state.num_learnt.to_string()),
            ("quarantined", state.num_held.to_string()),
            ("missed", state.num_missed.to_string()),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ros2_client::ParameterValue;

    fn settings() -> Settings {
        let map = |name: &str| (name == "map").then(|| ParameterValue::String("a.map".into()));
        Settings::read(map)
    }

    #[test]
    fn a_camera_that_says_nothing_is_lost_and_a_jump_is_told() {
        let mut health = Health::new("node");
        let begun = Instant::now();
        let late = begun + Duration::from_secs(5);
        assert!(health.camera(&settings(), late).1.contains("no image yet"));
        let time = Time::from_us(1_714_552_200_000_000);
        health.count_image(begun, Some(time));
        health.count_image(
            begun + Duration::from_millis(100),
            Some(time.plus_us(100_000)),
        );
        assert_eq!(health.clock(&settings(), begun).0, OK);
        assert!(health.camera(&settings(), late).1.contains("lost"));
        health.count_image(late, Some(time.plus_us(3_600_000_000)));
        let (level, message) = health.clock(&settings(), late);
        assert!(
            level == WARN && message.contains("jumped by 35"),
            "{message}"
        );
        // A camera that was off for a while has not jumped.
        let on = late + Duration::from_secs(60);
        health.count_image(on, Some(time.plus_us(3_660_000_000)));
        assert_eq!(health.clock(&settings(), on).0, OK);
    }

    #[test]
    fn a_node_that_is_not_active_misses_nothing() {
        let mut health = Health::new("node");
        health.state = State::Unconfigured;
        let late = Instant::now() + Duration::from_secs(50);
        let (level, message) = health.camera(&settings(), late);
        assert!(level == OK && message.contains("unconfigured"), "{message}");
        let (level, message) = health.map_state();
        assert!(
            level == OK && message.contains("no map is open"),
            "{message}"
        );
        health.state = State::Active;
        assert_eq!(health.camera(&settings(), late).0, ERROR);
        health.begin();
        assert_eq!(health.camera(&settings(), Instant::now()).0, OK);
    }

    #[test]
    fn whoever_cannot_be_understood_is_named() {
        let mut health = Health::new("node");
        let levels = |health: &Health| -> Vec<u8> {
            let array = health.array(&settings(), Time::now());
            array.status.iter().map(|it| it.level).collect()
        };
        let mismatch = |is_of_camera, why: &str| Mismatch {
            is_of_camera,
            why: why.into(),
        };
        let of_log = mismatch(false, "/rosout: a subscriber gets volatile");
        health.mismatches.insert("b".into(), of_log);
        assert_eq!(levels(&health), [OK, OK, OK, OK, WARN]);
        let of_camera = mismatch(true, "the camera offers best_effort");
        health.mismatches.insert("a".into(), of_camera);
        assert_eq!(levels(&health), [ERROR, OK, OK, OK, WARN]);
        let (_, message) = health.camera(&settings(), Instant::now());
        assert_eq!(message, "the camera offers best_effort");
    }

    #[test]
    fn a_clock_that_stops_is_noticed_where_it_counts() {
        let mut health = Health::new("node");
        let mut settings = settings();
        let begun = Instant::now();
        let later = begun + Duration::from_secs(9);
        health.last_clock = Some(begun);
        assert_eq!(health.clock(&settings, later).0, OK);
        settings.uses_sim_time = true;
        assert_eq!(health.clock(&settings, begun).0, OK);
        let (level, message) = health.clock(&settings, later);
        assert!(level == WARN && message.contains("9 s"), "{message}");
    }

    #[test]
    fn a_map_that_took_the_place_of_another_is_outdated_whatever_its_number() {
        let mut health = Health::new("node");
        health.map.path = "a.map".into();
        health.map.generation = 7;
        for (in_file, level, says) in [
            (InFile::Same, OK, "generation 7"),
            (InFile::Other(8), WARN, "is at generation 8"),
            (InFile::Other(7), WARN, "another map"),
            (InFile::Other(1), WARN, "another map"),
            (InFile::Nothing("gone".into()), WARN, "gone"),
        ] {
            health.map.in_file = in_file;
            let found = health.map_state();
            assert!(found.0 == level && found.1.contains(says), "{found:?}");
        }
    }
}
