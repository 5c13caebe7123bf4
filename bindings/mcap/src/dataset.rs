//! Which images of which places at which times does a bag hold?
//!
//! [`Recording::read`] gives a [`Dataset`], as a folder gives it: what trains a map from a folder trains the same map from a
//! bag. An image is called by its topic and its stamp (`camera/image/1717000000.250000000`), and is
//! decoded when it is needed.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use chronotope::dataset::{Clock, Dataset, Entry, ImageSource, Problem};
use chronotope::error::{Error, ErrorKind, Result};
use chronotope::feature::{DecodeLimits, GrayImage};
use chronotope::map::{PlaceKey, Snapshot};
use chronotope::time::{Time, Zone};

use crate::bag::{Bag, Message, Position, Topic};
use crate::message::{
    EncodedImage, Fix, Header, MessageType, Pose, RawImage, Stamp, Transform, text,
};
use crate::picture;
use crate::places::{Founder, Vicinity, edges_of};
use crate::table::Table;
use crate::track::{Track, Tree};

/// Where the places of images come from.
#[derive(Clone, Debug, PartialEq)]
pub enum Places {
    /// All images show one place: nobody wants to know.
    One(PlaceKey),
    /// Founded on the way of the poses of a topic; of the only one, if none is named.
    Poses(Option<String>),
    /// Founded on the way of one frame in another, by transforms.
    Transforms {
        /// The frame that does not move.
        fixed: String,
        /// The frame of the robot or of its camera.
        child: String,
    },
    /// A CSV file of times.
    Table(PathBuf),
    /// A topic of texts, each of which holds until the next.
    Topic(String),
}

/// Which of two times of a message counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StampSource {
    /// When the image was taken, as the driver says in the header.
    #[default]
    Header,
    /// When the message was written to the bag.
    Message,
}

/// How a bag is read.
#[derive(Clone, Debug)]
pub struct BagOptions {
    topic: Option<String>,
    places: Places,
    vicinity: Vicinity,
    origin: Option<[f64; 2]>,
    stamp: StampSource,
    every_s: f64,
    zone: Option<Zone>,
    limits: DecodeLimits,
}

impl BagOptions {
    /// The images of the only topic of images, by the stamps of their headers.
    pub fn new(places: Places) -> Self {
        Self {
            topic: None,
            places,
            vicinity: Vicinity::default(),
            origin: None,
            stamp: StampSource::default(),
            every_s: 0.0,
            zone: None,
            limits: DecodeLimits::default(),
        }
    }

    /// The images of this topic.
    #[must_use]
    pub fn with_topic(mut self, topic: Option<String>) -> Self {
        self.topic = topic;
        self
    }

    /// When poses belong to one place.
    #[must_use]
    pub fn with_vicinity(mut self, vicinity: Vicinity) -> Self {
        self.vicinity = vicinity;
        self
    }

    /// Latitude and longitude, in degrees, from which satellite fixes are counted in metres; the
    /// first fix, if not given.
    #[must_use]
    pub fn with_origin(mut self, origin: Option<[f64; 2]>) -> Self {
        self.origin = origin;
        self
    }

    /// Which time of an image counts.
    #[must_use]
    pub fn with_stamp(mut self, stamp: StampSource) -> Self {
        self.stamp = stamp;
        self
    }

    /// Of images that follow sooner than this only the first, s; 0: all.
    #[must_use]
    pub fn with_every_s(mut self, every_s: f64) -> Self {
        self.every_s = every_s;
        self
    }

    /// The zone by whose clocks the places live.
    #[must_use]
    pub fn with_zone(mut self, zone: Option<Zone>) -> Self {
        self.zone = zone;
        self
    }

    /// What is too big to decode.
    #[must_use]
    pub fn with_limits(mut self, limits: DecodeLimits) -> Self {
        self.limits = limits;
        self
    }
}

/// Latitude and longitude, in degrees, of what counts as zero metres.
pub type Origin = [f64; 2];

/// What a bag holds of images.
#[derive(Clone, Debug)]
pub struct Recording {
    /// The images with their places and times.
    pub dataset: Dataset,
    /// When each of the dataset's entries was written to the bag.
    pub logged: Vec<Time>,
    /// Where satellite fixes count from, if they gave the places.
    pub origin: Option<Origin>,
}

impl Recording {
    /// Reads the images of a bag with their places and times.
    ///
    /// `known` is the map that is updated: its places are found again. O(bytes of the bag).
    ///
    /// # Errors
    ///
    /// [`ErrorKind::NotFound`] if there is no such topic, [`ErrorKind::Config`] if several could be meant,
    /// [`ErrorKind::Format`] if there is not one image.
    pub fn read(
        bag: &Arc<Bag>,
        options: &BagOptions,
        known: Option<&Snapshot>,
    ) -> Result<Recording> {
        let found = Found::scan(bag, options)?;
        let (topic, images) = found.images(bag, options)?;
        let mut problems = found.problems.clone();
        let images = thinned(topic, images, options, &mut problems);
        let mut labeller = Labeller::new(bag, &found, options, known)?;
        labeller.look_ahead(&images)?;
        let mut entries = Vec::new();
        let mut labelled = Vec::new();
        let mut unplaced: Vec<&FoundImage> = Vec::new();
        for image in &images {
            let place = labeller.place(image.stamp)?;
            labelled.push((image.stamp.time(), place.clone()));
            match place {
                Some(place) => {
                    let entry = entry(bag, topic, image, place, options);
                    entries.push((entry, image.logged.time()));
                }
                None => unplaced.push(image),
            }
        }
        if let Some(first) = unplaced.first() {
            problems.push(Problem::new(
                id_of(topic, first.stamp),
                format!(
                    "{} images from this one on: {}",
                    unplaced.len(),
                    labeller.why_nowhere()
                ),
            ));
        }
        if entries.is_empty() {
            return Err(
                bag_error(bag, ErrorKind::Format, "no image of the bag has a place")
                    .with_help(labeller.why_nowhere()),
            );
        }
        entries.sort_by(|(a, _), (b, _)| (a.time, &a.place, &a.id).cmp(&(b.time, &b.place, &b.id)));
        let (entries, logged) = entries.into_iter().unzip();
        let (edges, poses, origin) = labeller.layout(&labelled);
        let dataset = Dataset {
            name: bag.name(),
            clock: Clock::Real,
            zone: options.zone.as_ref().map(|zone| zone.name().to_owned()),
            image_size: None,
            entries,
            edges,
            poses,
            problems,
        };
        Ok(Recording {
            dataset,
            logged,
            origin,
        })
    }
}

/// One image, not decoded yet.
#[derive(Clone, Copy, Debug)]
struct FoundImage {
    stamp: Stamp,
    logged: Stamp,
    position: Position,
    kind: MessageType,
    size: Option<(u32, u32)>,
}

/// What the way through a bag brought.
#[derive(Debug, Default)]
struct Found {
    /// All topics that are described, with or without messages.
    topics: BTreeSet<Topic>,
    images: BTreeMap<String, Vec<FoundImage>>,
    /// By topic: how many images had no stamp.
    num_unstamped: BTreeMap<String, usize>,
    tracks: BTreeMap<String, Track>,
    fixes: BTreeMap<String, BTreeMap<Stamp, Fix>>,
    tree: Tree,
    texts: BTreeMap<Stamp, String>,
    problems: Vec<Problem>,
}

impl Found {
    fn scan(bag: &Bag, options: &BagOptions) -> Result<Self> {
        let topics: RefCell<BTreeSet<Topic>> = RefCell::default();
        let mut found = Self::default();
        let is_wanted = |topic: &Topic| {
            topics.borrow_mut().insert(topic.clone());
            is_wanted(topic, options)
        };
        let mut unreadable = Vec::new();
        let problems = bag.scan(&is_wanted, &mut |message| {
            if let Err(error) = found.take(message, options) {
                let subject = format!("{} at {}", message.topic.name, message.logged);
                unreadable.push(Problem::of(subject, error));
            }
            Ok(())
        })?;
        found.problems = problems;
        found.problems.append(&mut unreadable);
        found.topics = topics.into_inner();
        Ok(found)
    }

    fn take(&mut self, message: &Message<'_>, options: &BagOptions) -> Result<()> {
        let topic = &message.topic.name;
        let Some(kind) = message.topic.message_type() else {
            return Ok(());
        };
        let (data, logged) = (message.data, message.logged);
        match kind {
            MessageType::Image | MessageType::CompressedImage => {
                let header = Header::of(data)?;
                let stamp = match options.stamp {
                    StampSource::Header => header.stamp,
                    StampSource::Message => Some(logged),
                };
                let Some(stamp) = stamp else {
                    *self.num_unstamped.entry(topic.clone()).or_default() += 1;
                    return Ok(());
                };
                let image = FoundImage {
                    stamp,
                    logged,
                    position: message.position,
                    kind,
                    // What is no picture is said when it is decoded.
                    size: size_of(kind, data, &options.limits).ok(),
                };
                self.images.entry(topic.clone()).or_default().push(image);
            }
            MessageType::Odometry | MessageType::PoseStamped => {
                let (header, pose) = if kind == MessageType::Odometry {
                    Pose::of_odometry(data)?
                } else {
                    Pose::stamped(data)?
                };
                let track = self.tracks.entry(topic.clone()).or_default();
                track.add(stamp_of(&header, logged, options), &pose);
            }
            MessageType::NavSatFix => {
                let fix = Fix::read(data)?;
                if fix.is_fixed {
                    let stamp = stamp_of(&fix.header, logged, options);
                    self.fixes
                        .entry(topic.clone())
                        .or_default()
                        .insert(stamp, fix);
                }
            }
            MessageType::Transforms => {
                for mut transform in Transform::read_all(data)? {
                    if options.stamp == StampSource::Message {
                        transform.header.stamp = None;
                    }
                    self.tree.add(&transform, logged);
                }
            }
            MessageType::Text => {
                self.texts.insert(logged, text(data)?);
            }
            MessageType::CameraInfo => {}
        }
        Ok(())
    }

    /// The topic that is meant, and its images.
    fn images(&self, bag: &Bag, options: &BagOptions) -> Result<(&str, &[FoundImage])> {
        let of_images: Vec<&Topic> = (self.topics.iter())
            .filter(|topic| topic.message_type().is_some_and(MessageType::is_image))
            .collect();
        let names = |topics: &[&Topic]| {
            let names: Vec<&str> = topics.iter().map(|topic| topic.name.as_str()).collect();
            names.join(", ")
        };
        let topic = match (&options.topic, &of_images[..]) {
            (Some(wanted), _) => of_images
                .iter()
                .find(|topic| topic.name == *wanted)
                .copied(),
            (None, [one]) => Some(*one),
            (None, []) => None,
            (None, several) => {
                let message = format!("{} topics have images", several.len());
                return Err(bag_error(bag, ErrorKind::Config, message)
                    .with_help(format!("choose one with --topic: {}", names(several))));
            }
        };
        let Some(topic) = topic else {
            return Err(self.no_images(bag, options, &names(&of_images)));
        };
        if let Some(images) = self.images.get(&topic.name) {
            return Ok((&topic.name, images));
        }
        let error = bag_error(
            bag,
            ErrorKind::Format,
            format!("the topic `{}` has no image that can be used", topic.name),
        );
        Err(
            match (self.num_unstamped.get(&topic.name), self.problems.first()) {
                (Some(_), _) => error.with_help("its headers have no stamps: give --stamp message"),
                (None, Some(problem)) => error.with_help(format!("the first problem: {problem}")),
                (None, None) => error.with_help("choose another with --topic"),
            },
        )
    }

    fn no_images(&self, bag: &Bag, options: &BagOptions, of_images: &str) -> Error {
        if self.topics.is_empty() {
            return bag.empty(&self.problems);
        }
        let named = (options.topic.as_ref())
            .and_then(|wanted| self.topics.iter().find(|topic| topic.name == *wanted));
        match (named, &options.topic) {
            (Some(topic), _) => {
                let message = format!(
                    "the topic `{}` has messages of type {} in {}, which are no images that can be \
                     read",
                    topic.name, topic.type_name, topic.encoding
                );
                let error = bag_error(bag, ErrorKind::Config, message);
                match of_images {
                    "" => {
                        error.with_help("sensor_msgs/msg/Image and CompressedImage in cdr are read")
                    }
                    topics => error.with_help(format!("topics with images: {topics}")),
                }
            }
            (None, Some(wanted)) => {
                let error = bag_error(
                    bag,
                    ErrorKind::NotFound,
                    format!("there is no topic `{wanted}`"),
                );
                match of_images {
                    "" => error.with_help("no topic of the bag has images"),
                    topics => error.with_help(format!("topics with images: {topics}")),
                }
            }
            (None, None) => bag_error(bag, ErrorKind::Format, "no topic of the bag has images")
                .with_help("sensor_msgs/msg/Image and CompressedImage in cdr are read"),
        }
    }
}

fn is_wanted(topic: &Topic, options: &BagOptions) -> bool {
    let Some(kind) = topic.message_type() else {
        return false;
    };
    let is_named = |name: &Option<String>| name.as_ref().is_none_or(|name| *name == topic.name);
    if kind.is_image() {
        return is_named(&options.topic);
    }
    match &options.places {
        Places::Poses(name) => kind.is_pose() && kind != MessageType::Transforms && is_named(name),
        Places::Transforms { .. } => kind == MessageType::Transforms,
        Places::Topic(name) => kind == MessageType::Text && *name == topic.name,
        Places::One(_) | Places::Table(_) => false,
    }
}

/// The time of a message that only says where the robot is: its own, unless told otherwise.
fn stamp_of(header: &Header, logged: Stamp, options: &BagOptions) -> Stamp {
    match options.stamp {
        StampSource::Header => header.stamp.unwrap_or(logged),
        StampSource::Message => logged,
    }
}

/// The images in the order of time, without those that follow too soon or have the time of another.
fn thinned(
    topic: &str,
    images: &[FoundImage],
    options: &BagOptions,
    problems: &mut Vec<Problem>,
) -> Vec<FoundImage> {
    let mut images = images.to_vec();
    images.sort_by_key(|image| (image.stamp, image.position));
    let mut kept: Vec<FoundImage> = Vec::new();
    let (mut num_twice, mut first_twice) = (0, None);
    for image in images {
        let Some(last) = kept.last() else {
            kept.push(image);
            continue;
        };
        // Two times of the same microsecond are one time.
        if image.stamp.time() == last.stamp.time() {
            num_twice += 1;
            first_twice.get_or_insert(image.stamp);
        } else if image.stamp.time().since_s(last.stamp.time()) >= options.every_s {
            kept.push(image);
        }
    }
    if let Some(first) = first_twice {
        problems.push(Problem::new(
            id_of(topic, first),
            format!(
                "{num_twice} images have the stamp of the one before, from this one on (help: --stamp \
                 message takes the times at which they were recorded)"
            ),
        ));
    }
    kept
}

/// How an image is called.
fn id_of(topic: &str, stamp: Stamp) -> String {
    format!("{}/{stamp}", topic.trim_start_matches('/'))
}

fn bag_error(bag: &Bag, kind: ErrorKind, message: impl Into<String>) -> Error {
    Error::new(kind, message).with_path(bag.path())
}

/// Says which place an image shows.
enum Labeller {
    One(PlaceKey),
    Founder(Box<Founder>, Track, Option<Origin>),
    Table(Table),
    Texts(BTreeMap<Stamp, String>),
}

/// The ways between places, where they are, and where satellite fixes count from.
type LaidOut = (
    Vec<chronotope::map::Edge>,
    BTreeMap<PlaceKey, [f64; 3]>,
    Option<Origin>,
);

impl Labeller {
    fn new(
        bag: &Bag,
        found: &Found,
        options: &BagOptions,
        known: Option<&Snapshot>,
    ) -> Result<Self> {
        let founder = |track: Track, origin| {
            let founder = Founder::new(options.vicinity, known);
            Self::Founder(Box::new(founder), track, origin)
        };
        match &options.places {
            Places::One(key) => Ok(Self::One(key.clone())),
            Places::Table(path) => Ok(Self::Table(Table::read(path)?)),
            Places::Topic(_) if found.texts.is_empty() => Err(bag_error(
                bag,
                ErrorKind::NotFound,
                "the topic that names places has no messages",
            )
            .with_help("messages of type std_msgs/msg/String are read")),
            Places::Topic(_) => Ok(Self::Texts(found.texts.clone())),
            Places::Transforms { fixed, child } => {
                let track = (found.tree.track(fixed, child))
                    .map_err(|error| error.with_path(bag.path()))?;
                Ok(founder(track, None))
            }
            Places::Poses(name) => {
                let named: Vec<&String> = (found.tracks.iter())
                    .filter(|(_, track)| !track.is_empty())
                    .map(|(name, _)| name)
                    .chain(found.fixes.keys())
                    .filter(|topic| name.as_ref().is_none_or(|name| name == *topic))
                    .collect();
                let topic = match named[..] {
                    [topic] => topic,
                    [] => return Err(no_poses(bag, found, name.as_deref())),
                    _ => {
                        let names: Vec<&str> = named.iter().map(|it| it.as_str()).collect();
                        let message = format!("{} topics have poses", names.len());
                        return Err(
                            bag_error(bag, ErrorKind::Config, message).with_help(format!(
                                "choose one with --places poses:TOPIC: {}",
                                names.join(", ")
                            )),
                        );
                    }
                };
                if let Some(track) = found.tracks.get(topic) {
                    return Ok(founder(track.clone(), None));
                }
                let fixes = &found.fixes[topic];
                let first = fixes
                    .values()
                    .next()
                    .map(|fix| [fix.latitude, fix.longitude]);
                let origin = options
                    .origin
                    .or(first)
                    .filter(|_| known.is_none() || options.origin.is_some());
                let Some(origin) = origin else {
                    return Err(bag_error(
                        bag,
                        ErrorKind::Config,
                        "the map's satellite fixes were counted from a point that it does not know",
                    )
                    .with_help("give --origin LATITUDE,LONGITUDE, as `build` has printed it"));
                };
                Ok(founder(Track::of_fixes(fixes, origin), Some(origin)))
            }
        }
    }

    /// Founds all places on the way, before the first image gets one.
    fn look_ahead(&mut self, images: &[FoundImage]) -> Result<()> {
        if let Self::Founder(founder, track, _) = self {
            let way: Vec<_> = (images.iter())
                .filter_map(|image| track.at(image.stamp))
                .collect();
            founder.found(&way)?;
        }
        Ok(())
    }

    fn place(&mut self, stamp: Stamp) -> Result<Option<PlaceKey>> {
        match self {
            Self::One(key) => Ok(Some(key.clone())),
            Self::Founder(founder, track, _) => match track.at(stamp) {
                Some(placement) => founder.place(&placement).map(Some),
                None => Ok(None),
            },
            Self::Table(table) => Ok(table.at(stamp.time()).cloned()),
            Self::Texts(texts) => match texts.range(..=stamp).next_back() {
                Some((_, text)) if !text.trim().is_empty() => PlaceKey::written(text).map(Some),
                _ => Ok(None),
            },
        }
    }

    fn why_nowhere(&self) -> String {
        match self {
            Self::One(_) => String::new(),
            Self::Founder(..) => format!(
                "no pose is within {} s of them (help: are poses and images stamped by the same clock? \
                 --stamp message takes the times of recording)",
                crate::track::MAX_GAP_S
            ),
            Self::Table(_) => "the table of places has no row for their time".into(),
            Self::Texts(_) => "no place was named before them".into(),
        }
    }

    fn layout(self, labelled: &[(Time, Option<PlaceKey>)]) -> LaidOut {
        let visits = (labelled.iter()).map(|(time, place)| (*time, place.as_ref()));
        match self {
            Self::One(_) => (Vec::new(), BTreeMap::new(), None),
            Self::Founder(founder, _, origin) => {
                (edges_of(visits), founder.poses().collect(), origin)
            }
            Self::Table(_) | Self::Texts(_) => (edges_of(visits), BTreeMap::new(), None),
        }
    }
}

fn no_poses(bag: &Bag, found: &Found, name: Option<&str>) -> Error {
    let message = match name {
        Some(name) => format!("the topic `{name}` has no poses"),
        None => "no topic of the bag has poses".into(),
    };
    let with_poses: Vec<&str> = (found.topics.iter())
        .filter(|topic| topic.message_type().is_some_and(MessageType::is_pose))
        .map(|topic| topic.name.as_str())
        .collect();
    let help = if with_poses.is_empty() {
        "Odometry, PoseStamped, PoseWithCovarianceStamped, NavSatFix and transforms are read; without \
         any, label times with --places csv:FILE"
            .to_owned()
    } else {
        format!(
            "topics that say where the robot is: {} (transforms: --places tf:FIXED,CHILD)",
            with_poses.join(", ")
        )
    };
    bag_error(bag, ErrorKind::NotFound, message).with_help(help)
}

fn entry(
    bag: &Arc<Bag>,
    topic: &str,
    image: &FoundImage,
    place: PlaceKey,
    options: &BagOptions,
) -> Entry {
    let id = id_of(topic, image.stamp);
    Entry {
        place,
        time: image.stamp.time(),
        source: Arc::new(BagImage {
            bag: Arc::clone(bag),
            position: image.position,
            kind: image.kind,
            size: image.size,
            limits: options.limits,
            id: id.clone(),
        }),
        id,
    }
}

fn size_of(kind: MessageType, data: &[u8], limits: &DecodeLimits) -> Result<(u32, u32)> {
    match kind {
        MessageType::CompressedImage => {
            picture::encoded_image_size(&EncodedImage::read(data)?, limits)
        }
        _ => picture::raw_size(&RawImage::read(data)?, limits),
    }
}

/// An image in a bag.
struct BagImage {
    bag: Arc<Bag>,
    position: Position,
    kind: MessageType,
    size: Option<(u32, u32)>,
    limits: DecodeLimits,
    id: String,
}

impl ImageSource for BagImage {
    fn load(&self) -> Result<GrayImage> {
        (self.bag)
            .read(self.position, |data| match self.kind {
                MessageType::CompressedImage => {
                    picture::encoded(&EncodedImage::read(data)?, &self.limits)
                }
                _ => picture::raw(&RawImage::read(data)?, &self.limits),
            })
            .map_err(|error| error.with_path(Path::new(&self.id)))
    }

    fn size(&self) -> Result<Option<(u32, u32)>> {
        Ok(self.size)
    }
}
