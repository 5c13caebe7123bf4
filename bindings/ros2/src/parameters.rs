//! Which parameters does the node have, what do they mean, and which values make sense?
//!
//! All of them are declared with a description. Those that are not read-only are changed while the
//! node runs: those of the camera at once, those of the map by opening it anew beside the running
//! one and changing over between two images.

use std::path::PathBuf;
use std::time::Duration;

use chronotope::feature::Rotation;
use ros2_client::ParameterValue;
use ros2_client::parameters::raw;

/// One parameter.
#[derive(Debug)]
pub(crate) struct Declared {
    pub(crate) name: &'static str,
    pub(crate) default: Default,
    /// Whether it stays what it was at the start.
    pub(crate) is_read_only: bool,
    pub(crate) description: &'static str,
    pub(crate) constraint: Constraint,
}

/// What a parameter is if nobody says otherwise, and so its type.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Default {
    Bool(bool),
    Integer(i64),
    Double(f64),
    Text(&'static str),
}

/// Which values make sense.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Constraint {
    None,
    /// Finite, between two numbers.
    Range(f64, f64),
    OneOf(&'static [&'static str]),
    /// A whole number of these.
    Whole(&'static [i64]),
}

const RAW: &str = "raw";
const COMPRESSED: &str = "compressed";
const BEST_EFFORT: &str = "best_effort";
const RELIABLE: &str = "reliable";
/// The parameter that pauses learning, which a service sets, too.
pub(crate) const LEARNING: &str = "learning";
pub(crate) const USE_SIM_TIME: &str = "use_sim_time";

macro_rules! parameters {
    ($($name:literal: $kind:ident($default:expr), $access:ident, $constraint:expr, $text:literal;)*) => {
        &[$(Declared {
            name: $name,
            default: Default::$kind($default),
            is_read_only: matches!(stringify!($access).as_bytes(), b"fixed"),
            description: $text,
            constraint: $constraint,
        }),*]
    };
}

use Constraint::{None as Any, OneOf, Range, Whole};

/// All parameters, by name.
pub(crate) const PARAMETERS: &[Declared] = parameters! {
    "autostart": Bool(true), fixed, Any,
        "Whether the node opens its map and answers images at once; else it waits, unconfigured, for ~/change_state.";
    "camera_timeout_s": Double(2.0), changeable, Range(0.05, 3_600.0),
        "After so many seconds without an image the camera counts as lost and current_node is none.";
    "config": Text(""), fixed, Any,
        "A TOML file with the tables [learn], [localize] and [motion], as `chronotope --config` has it.";
    "debug_rate_hz": Double(1.0), changeable, Range(0.0, 100.0),
        "At most so many images a second on ~/debug/image, and only if somebody looks; 0: none.";
    "late_s": Double(1.0), changeable, Range(0.0, 3_600.0),
        "An image whose stamp is older than this when it comes counts as late; so does a delay in answering.";
    "learn": Bool(false), fixed, Any,
        "Whether what is located is learnt as a visit of its place and committed to the map's file.";
    "learning": Bool(true), changeable, Any,
        "False pauses learning; what was learnt before stays. Without `learn` nothing is learnt anyway.";
    "map": Text(""), changeable, Any,
        "The map's file. Another one is opened beside it and taken over between two images.";
    "mask": Text(""), fixed, Any,
        "A picture of the size that is matched; where it is black, nothing of an image is used.";
    "max_rate_hz": Double(0.0), changeable, Range(0.0, 1_000.0),
        "At most so many images a second are answered; 0: as many as can be.";
    "reliability": Text(BEST_EFFORT), fixed, OneOf(&[BEST_EFFORT, RELIABLE]),
        "Of the subscription to images: best_effort, as sensors have it, or reliable.";
    "risk": Double(-1.0), changeable, Range(-1.0, 1.0),
        "How often an answer may name a wrong place, from 0 to 1; negative: as the configuration says.";
    "rotate": Integer(0), changeable, Whole(&[0, 90, 180, 270]),
        "Turns every image clockwise, in degrees.";
    "track": Bool(false), changeable, Any,
        "What was believed before moves along the map's edges and counts, too.";
    "transport": Text(RAW), fixed, OneOf(&[RAW, COMPRESSED]),
        "What the topic `image` carries: sensor_msgs/msg/Image (raw) or CompressedImage (compressed).";
    "use_sim_time": Bool(false), changeable, Any,
        "Whether the robot's clock is the topic /clock: a simulation, or a bag that is played.";
    "watch_map_s": Double(5.0), changeable, Range(0.0, 86_400.0),
        "So often it is looked for a newer generation in the map's file, in seconds; 0: never. A node that learns commits to the file itself and does not look.";
};

impl Declared {
    pub(crate) fn find(name: &str) -> Option<&'static Self> {
        PARAMETERS.iter().find(|it| it.name == name)
    }

    pub(crate) fn default_value(&self) -> ParameterValue {
        match self.default {
            Default::Bool(value) => ParameterValue::Boolean(value),
            Default::Integer(value) => ParameterValue::Integer(value),
            Default::Double(value) => ParameterValue::Double(value),
            Default::Text(value) => ParameterValue::String(value.to_owned()),
        }
    }

    /// The value in the parameter's type: a whole number is a number, too.
    pub(crate) fn typed(&self, value: ParameterValue) -> ParameterValue {
        match (self.default, value) {
            (Default::Double(_), ParameterValue::Integer(value)) => {
                ParameterValue::Double(value as f64)
            }
            (_, value) => value,
        }
    }

    /// Why a value makes no sense.
    pub(crate) fn check(&self, value: &ParameterValue) -> std::result::Result<(), String> {
        let expected = self.default_value().to_parameter_type();
        let found = value.to_parameter_type();
        if found != expected {
            return Err(format!(
                "`{}` is of the type {expected:?}, not {found:?}",
                self.name
            ));
        }
        let refused = |allowed: String| Err(format!("`{}` has to be {allowed}", self.name));
        match (self.constraint, value) {
            (Range(least, most), ParameterValue::Double(value))
                if !(least..=most).contains(value) =>
            {
                refused(format!("from {least} to {most}, not {value}"))
            }
            (OneOf(words), ParameterValue::String(word)) if !words.contains(&word.as_str()) => {
                refused(format!("{}, not `{word}`", words.join(" or ")))
            }
            (Whole(numbers), ParameterValue::Integer(number)) if !numbers.contains(number) => {
                let numbers: Vec<String> = numbers.iter().map(ToString::to_string).collect();
                refused(format!("{}, not {number}", numbers.join(", ")))
            }
            _ => Ok(()),
        }
    }

    /// As `ros2 param describe` shows it.
    pub(crate) fn descriptor(&self) -> raw::ParameterDescriptor {
        let (constraint, floats) = match self.constraint {
            Range(from_value, to_value) => {
                let step = 0.0;
                let range = raw::FloatingPointRange {
                    from_value,
                    to_value,
                    step,
                };
                (String::new(), vec![range])
            }
            OneOf(words) => (format!("one of {}", words.join(", ")), Vec::new()),
            Whole(numbers) => (format!("one of {numbers:?}"), Vec::new()),
            Any => (String::new(), Vec::new()),
        };
        raw::ParameterDescriptor {
            name: self.name.to_owned(),
            r#type: self.default_value().to_parameter_type() as u8,
            description: self.description.to_owned(),
            additional_constraints: constraint,
            read_only: self.is_read_only,
            dynamic_typing: false,
            floating_point_range: floats,
            integer_range: Vec::new(),
        }
    }
}

/// What all parameters say.
#[derive(Clone, Debug, PartialEq)]
#[allow(clippy::struct_excessive_bools)] // reason: a parameter each.
pub(crate) struct Settings {
    pub(crate) source: MapSource,
    /// Whether nobody has to configure and activate the node.
    pub(crate) is_autostarted: bool,
    pub(crate) rotate: i64,
    pub(crate) is_compressed: bool,
    pub(crate) is_reliable: bool,
    pub(crate) is_learning: bool,
    pub(crate) uses_sim_time: bool,
    pub(crate) max_rate_hz: f64,
    /// Of pictures on `~/debug/image`; `None`: there are none.
    pub(crate) debug_period: Option<Duration>,
    pub(crate) camera_timeout: Duration,
    pub(crate) late_s: f64,
    /// `None`: never.
    pub(crate) watch_map: Option<Duration>,
}

/// What a robot is opened from: where this changes, it is opened anew.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct MapSource {
    /// Empty where none is named yet.
    pub(crate) map: PathBuf,
    pub(crate) config: Option<PathBuf>,
    pub(crate) mask: Option<PathBuf>,
    pub(crate) risk: Option<f64>,
    pub(crate) tracks: bool,
    pub(crate) learns: bool,
}

impl Settings {
    /// Of values that were checked.
    pub(crate) fn read(get: impl Fn(&str) -> Option<ParameterValue>) -> Self {
        let value =
            |name: &str| get(name).or_else(|| Declared::find(name).map(Declared::default_value));
        let text = |name: &str| match value(name) {
            Some(ParameterValue::String(text)) => text,
            _ => String::new(),
        };
        let flag = |name: &str| matches!(value(name), Some(ParameterValue::Boolean(true)));
        let number = |name: &str| match value(name) {
            Some(ParameterValue::Double(number)) => number,
            _ => 0.0,
        };
        let path = |name: &str| {
            Some(text(name))
                .filter(|it| !it.is_empty())
                .map(PathBuf::from)
        };
        let rotate = match value("rotate") {
            Some(ParameterValue::Integer(degrees)) => degrees,
            _ => 0,
        };
        Self {
            source: MapSource {
                map: text("map").into(),
                config: path("config"),
                mask: path("mask"),
                risk: Some(number("risk")).filter(|it| *it >= 0.0),
                tracks: flag("track"),
                learns: flag("learn"),
            },
            is_autostarted: flag("autostart"),
            rotate,
            is_compressed: text("transport") == COMPRESSED,
            is_reliable: text("reliability") == RELIABLE,
            is_learning: flag(LEARNING),
            uses_sim_time: flag(USE_SIM_TIME),
            max_rate_hz: number("max_rate_hz"),
            // A rate of next to nothing has a period that no duration is long enough for.
            debug_period: Some(number("debug_rate_hz"))
                .filter(|it| *it > 0.0)
                .map(|it| Duration::try_from_secs_f64(1.0 / it).unwrap_or(Duration::MAX)),
            camera_timeout: Duration::from_secs_f64(number("camera_timeout_s")),
            late_s: number("late_s"),
            watch_map: Some(number("watch_map_s"))
                .filter(|it| *it > 0.0)
                .map(Duration::from_secs_f64),
        }
    }

    pub(crate) fn rotation(&self) -> Rotation {
        match self.rotate {
            90 => Rotation::Clockwise90,
            180 => Rotation::Half,
            270 => Rotation::Clockwise270,
            _ => Rotation::None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_make_sense_and_are_described() {
        for pair in PARAMETERS.windows(2) {
            assert!(
                pair[0].name < pair[1].name,
                "{} is out of order",
                pair[1].name
            );
        }
        for it in PARAMETERS {
            assert_eq!(it.check(&it.default_value()), Ok(()), "{}", it.name);
            assert!(it.descriptor().description.ends_with('.'), "{}", it.name);
        }
        assert!(Declared::find("learn").is_some_and(|it| it.is_read_only));
        assert!(Declared::find("map").is_some_and(|it| !it.is_read_only));
        let settings = Settings::read(|_| None);
        assert!(settings.is_autostarted && !settings.source.learns);
    }

    #[test]
    fn rates_that_are_allowed_have_periods() {
        for (rate_hz, period) in [
            (0.0, None),
            (4.0, Some(Duration::from_millis(250))),
            (f64::MIN_POSITIVE, Some(Duration::MAX)),
        ] {
            let value = ParameterValue::Double(rate_hz);
            let it = Declared::find("debug_rate_hz").expect("declared");
            assert_eq!(it.check(&value), Ok(()));
            let settings = Settings::read(|name| (name == it.name).then(|| value.clone()));
            assert_eq!(settings.debug_period, period);
        }
    }

    #[test]
    fn what_makes_no_sense_is_refused_with_what_does() {
        let check = |name: &str, value: ParameterValue| {
            let it = Declared::find(name).expect("declared");
            it.check(&it.typed(value)).err().unwrap_or_default()
        };
        assert_eq!(check("risk", ParameterValue::Integer(1)), "");
        assert!(check("risk", ParameterValue::Double(2.0)).contains("from -1 to 1"));
        assert!(check("risk", ParameterValue::Double(f64::NAN)).contains("from -1 to 1"));
        assert!(check("rotate", ParameterValue::Integer(45)).contains("0, 90, 180, 270"));
        let word = ParameterValue::String("packed".into());
        assert!(check("transport", word).contains("raw or compressed"));
        assert!(check("learning", ParameterValue::Integer(1)).contains("Bool"));
    }
}
