//! How is a bag read, in the words of the command?

use std::path::PathBuf;
use std::str::FromStr;

use clap::{Args, ValueEnum};

use chronotope::error::{Error, ErrorKind, Result};
use chronotope_bags::{BagOptions, Origin, Places, StampSource, Vicinity};
use chronotope_terminal::reading::ReadingArgs;

/// Which images of a bag, and at which times.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Reading bags")]
pub(crate) struct ImageArgs {
    /// The topic of the images, `sensor_msgs/msg/Image` or `CompressedImage` (of the only one,
    /// if not given).
    #[arg(long, value_name = "TOPIC")]
    topic: Option<String>,
    /// Which time of an image counts: that of its header, or that at which it was recorded.
    #[arg(long, value_name = "WHICH", default_value = "header")]
    stamp: Stamp,
    /// Of images that follow sooner than this only the first, in seconds; 0: all.
    #[arg(long = "every", value_name = "SECONDS", default_value_t = 0.0, value_parser = seconds)]
    every_s: f64,
    #[command(flatten)]
    pub(crate) reading: ReadingArgs,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Stamp {
    Header,
    Message,
}

impl ImageArgs {
    pub(crate) fn options(&self, places: Places) -> BagOptions {
        BagOptions::new(places)
            .with_topic(self.topic.clone())
            .with_stamp(match self.stamp {
                Stamp::Header => StampSource::Header,
                Stamp::Message => StampSource::Message,
            })
            .with_every_s(self.every_s)
            .with_zone(self.reading.zone.clone())
            .with_limits(self.reading.limits())
    }
}

/// Where the places of images come from.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Places")]
pub(crate) struct PlaceArgs {
    /// Where places come from: `poses` or `poses:TOPIC` (`Odometry`, `PoseStamped`,
    /// `PoseWithCovarianceStamped`, `NavSatFix`), `tf:FIXED,CHILD` (transforms), `csv:FILE` (columns
    /// begin, end, place), `topic:TOPIC` (`std_msgs/msg/String`; each holds until the next).
    #[arg(long, value_name = "FROM")]
    places: Option<PlacesFrom>,
    /// Poses this near to where a place was founded belong to it, in metres.
    #[arg(long = "radius", value_name = "METRES", default_value_t = 2.0)]
    radius_m: f64,
    /// If they look in about its direction, in degrees to either side; 180: in any.
    #[arg(long = "heading", value_name = "DEGREES", default_value_t = 45.0)]
    heading_deg: f64,
    /// Where satellite fixes are counted from (the first one, if not given).
    #[arg(long, value_name = "LATITUDE,LONGITUDE", value_parser = origin, allow_hyphen_values = true)]
    origin: Option<Degrees>,
}

/// Latitude and longitude.
#[derive(Clone, Copy, Debug)]
struct Degrees(Origin);

impl PlaceArgs {
    pub(crate) fn options(&self, images: &ImageArgs) -> Result<BagOptions> {
        let vicinity = Vicinity::new(self.radius_m, self.heading_deg)?;
        let places = self.places.as_ref().ok_or_else(|| {
            Error::new(ErrorKind::Config, "--places is missing")
                .with_help("say where places come from, such as --places poses:/odom")
        })?;
        let options = images.options(places.0.clone());
        Ok(options
            .with_vicinity(vicinity)
            .with_origin(self.origin.map(|it| it.0)))
    }
}

#[derive(Clone, Debug)]
struct PlacesFrom(Places);

impl FromStr for PlacesFrom {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let wrong = || {
            Error::new(
                ErrorKind::Config,
                format!("places cannot come from `{text}`"),
            )
            .with_help("write poses, poses:TOPIC, tf:FIXED,CHILD, csv:FILE or topic:TOPIC")
        };
        let (kind, name) = match text.split_once(':') {
            Some((_, "")) => return Err(wrong()),
            Some((kind, name)) => (kind, Some(name)),
            None => (text, None),
        };
        Ok(Self(match (kind, name) {
            ("poses", name) => Places::Poses(name.map(str::to_owned)),
            ("tf", Some(frames)) => {
                let (fixed, child) = frames.split_once(',').ok_or_else(wrong)?;
                Places::Transforms {
                    fixed: fixed.trim().to_owned(),
                    child: child.trim().to_owned(),
                }
            }
            ("csv", Some(file)) => Places::Table(PathBuf::from(file)),
            ("topic", Some(topic)) => Places::Topic(topic.to_owned()),
            _ => return Err(wrong()),
        }))
    }
}

fn seconds(text: &str) -> Result<f64> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds.is_finite() && seconds >= 0.0 => Ok(seconds),
        _ => Err(Error::new(
            ErrorKind::Config,
            format!("`{text}` is no time between images"),
        )
        .with_help("write seconds, such as 0.5")),
    }
}

fn origin(text: &str) -> Result<Degrees> {
    let wrong = || {
        Error::new(
            ErrorKind::Config,
            format!("`{text}` is no point on the Earth"),
        )
        .with_help("write latitude and longitude in degrees, such as 50.0755,14.4378")
    };
    let (latitude, longitude) = text.split_once(',').ok_or_else(wrong)?;
    let degrees = |text: &str, most: f64| {
        let value: f64 = text.trim().parse().map_err(|_| wrong())?;
        if value.abs() <= most {
            Ok(value)
        } else {
            Err(wrong())
        }
    };
    Ok(Degrees([
        degrees(latitude, 90.0)?,
        degrees(longitude, 180.0)?,
    ]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sources_of_places_are_read_and_others_refused() {
        let read = |text: &str| text.parse::<PlacesFrom>().map(|it| it.0).ok();
        assert_eq!(read("poses"), Some(Places::Poses(None)));
        assert_eq!(
            read("poses:/odom"),
            Some(Places::Poses(Some("/odom".into())))
        );
        assert_eq!(read("topic:/place"), Some(Places::Topic("/place".into())));
        assert_eq!(read("csv:a:b.csv"), Some(Places::Table("a:b.csv".into())));
        for wrong in ["", "odom", "tf:map", "csv", "topic:", "poses:"] {
            assert_eq!(read(wrong), None, "{wrong}");
        }
        assert!(origin("50.1,14.4").is_ok() && origin("-33.8,151").is_ok());
        assert!(seconds("0.5").is_ok() && seconds("-1").is_err() && seconds("nan").is_err());
        assert!(origin("91,0").is_err() && origin("50").is_err() && origin("nan,0").is_err());
    }
}
