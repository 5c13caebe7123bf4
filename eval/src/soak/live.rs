//! Does a robot that learns while it localises keep its pace for an hour?
//!
//! [`run`] drives round the rendered street for as long as it is told to. A *camera* hands over an
//! image at every tick; a [`Robot`] localises it, learns what was located on its second thread,
//! commits every few seconds, within a budget and behind the guard, and goes on with the newer map.
//! Between them is a short queue; what finds it full is left out and counted, as a camera's driver
//! does.
//!
//! Time in the street runs faster than the clock on the wall, so that an hour shows a whole day.
//! Three things go wrong on the way: no image comes for a while, then black ones come (a covered
//! camera); the stamps of the images jump back a day; they jump ahead three years. Each twelfth of
//! the run gets a row of what came, what was answered, what was learnt, how long an image took, and
//! what process, map and file hold.
//!
//! Times are of the machine it runs on.

use std::fmt::Write as _;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, bail};
use chronotope::Time;
use chronotope::dataset::synthetic::World;
use chronotope::feature::GrayImage;
use chronotope::robot::{Event, Robot, RobotConfig};

use super::street::{Street, StreetOptions, memory_bytes, quantile};

/// Rows of the table.
const NUM_PARTS: usize = 12;
/// Images that wait for the robot.
const QUEUE_LEN: usize = 4;
/// The robot stays at a place for so many images.
const STAY_IMAGES: usize = 100;
/// What was learnt is committed this often.
const COMMIT_EVERY: Duration = Duration::from_secs(5);
/// How long each trouble lasts, as a share of the run.
const TROUBLE_SHARE: f64 = 1.0 / 60.0;
const DAY_US: i64 = 86_400_000_000;

/// What to do.
#[derive(Clone, Debug, clap::Args)]
pub struct LiveOptions {
    /// How long, in minutes.
    #[arg(long, default_value_t = 60.0)]
    pub minutes: f64,
    /// Images a second.
    #[arg(long, default_value_t = 10.0)]
    pub rate: f64,
    /// Seconds that pass in the street in one second.
    #[arg(long, default_value_t = 24.0)]
    pub clock_rate: f64,
    /// The street that is driven.
    #[command(flatten)]
    pub street: StreetOptions,
}

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Trouble {
    NoImages,
    Black,
    ClockBack,
    ClockAhead,
}

/// When each trouble begins, as a share of the run.
const TROUBLES: [(f64, Trouble); 4] = [
    (0.26, Trouble::NoImages),
    (0.28, Trouble::Black),
    (0.51, Trouble::ClockBack),
    (0.76, Trouble::ClockAhead),
];

impl Trouble {
    /// The trouble at this share of the run.
    fn at(share: f64) -> Option<Self> {
        let is_now = |&&(start, _): &&(f64, Self)| (start..start + TROUBLE_SHARE).contains(&share);
        TROUBLES.iter().find(is_now).map(|&(_, trouble)| trouble)
    }

    /// What the camera says the time is.
    fn stamp(trouble: Option<Self>, now: Time) -> Time {
        match trouble {
            Some(Self::ClockBack) => now.plus_us(-DAY_US),
            Some(Self::ClockAhead) => now.plus_us(3 * 365 * DAY_US),
            _ => now,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::NoImages => "no images",
            Self::Black => "black images",
            Self::ClockBack => "clock a day back",
            Self::ClockAhead => "clock 3 years ahead",
        }
    }
}

/// An image as it comes from the camera.
struct Frame {
    part: usize,
    place: usize,
    trouble: Option<Trouble>,
    /// What the robot's own clock says, and the stamp of the image.
    now: Time,
    stamp: Time,
    image: GrayImage,
    taken: Instant,
}

/// What happened in one part of the run.
#[derive(Clone, Debug, Default)]
struct Part {
    num_images: usize,
    /// Images that found the robot busy.
    num_missed: usize,
    num_right: usize,
    num_wrong: usize,
    num_undecided: usize,
    num_learnt: usize,
    num_held: usize,
    /// Located images that found the learner busy.
    num_unlearnt: usize,
    /// From the image to the answer, us.
    answer_us: Vec<f64>,
    /// From the end of an answer on, what `observe` took, us.
    observe_us: Vec<f64>,
    memory_bytes: u64,
    map_bytes: usize,
    file_bytes: u64,
}

struct Drive<'a> {
    options: &'a LiveOptions,
    world: World,
    image_size: (u32, u32),
    parts: Mutex<Vec<Part>>,
    /// The same for the time of each trouble.
    troubles: Mutex<Vec<Part>>,
}

/// Runs it and gives the table.
pub fn run(options: &LiveOptions) -> Result<String> {
    let is_positive = |number: f64| number.is_finite() && number > 0.0;
    if !(is_positive(options.minutes)
        && is_positive(options.rate)
        && is_positive(options.clock_rate))
    {
        bail!("--minutes, --rate and --clock-rate must be above 0");
    }
    let (street, _) = Street::known(&options.street, "soak-live")?;
    let Street {
        world,
        learner,
        image_size,
    } = street;
    let cfg = RobotConfig::default()
        .with_learning(learner.learner().cfg().clone())
        .with_commit_interval(COMMIT_EVERY);
    let robot = Robot::open(learner.into_map().path(), cfg)?;
    let drive = Drive {
        options,
        world,
        image_size,
        parts: Mutex::new(vec![Part::default(); NUM_PARTS]),
        troubles: Mutex::new(vec![Part::default(); TROUBLES.len()]),
    };
    let (to_robot, frames) = sync_channel(QUEUE_LEN);
    let drive = &drive;
    std::thread::scope(|threads| {
        let camera = threads.spawn(move || drive.camera(&to_robot));
        let robot = threads.spawn(move || drive.robot(robot, &frames));
        // The first to fail ends the other by its closed queue.
        for end in [robot.join(), camera.join()] {
            end.map_err(|_| anyhow!("a part of the robot panicked"))??;
        }
        Ok::<(), anyhow::Error>(())
    })?;
    let table = drive.table()?;
    let path = options.street.out.join("soak-live.txt");
    std::fs::write(&path, &table).with_context(|| format!("cannot write {}", path.display()))?;
    Ok(table)
}

impl Drive<'_> {
    fn part(&self, part: usize, change: impl FnOnce(&mut Part)) {
        let mut parts = self.parts.lock().unwrap_or_else(PoisonError::into_inner);
        change(&mut parts[part]);
    }

    fn num_ticks(&self) -> usize {
        (self.options.minutes * 60.0 * self.options.rate).ceil() as usize
    }

    /// Hands over an image at every tick.
    fn camera(&self, to_robot: &SyncSender<Frame>) -> Result<()> {
        // Where the year before is over.
        let start = Time::parse("2024-01-01T00:00:00Z")?;
        let begun = Instant::now();
        let num_ticks = self.num_ticks();
        for tick in 0..num_ticks {
            let at_s = tick as f64 / self.options.rate;
            let due = begun + Duration::from_secs_f64(at_s);
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
            let part = tick * NUM_PARTS / num_ticks;
            let now = start.plus_us((at_s * self.options.clock_rate * 1e6) as i64);
            let place = tick / STAY_IMAGES % self.options.street.num_places;
            let trouble = Trouble::at(tick as f64 / num_ticks as f64);
            let image = match trouble {
                Some(Trouble::NoImages) => continue,
                Some(Trouble::Black) => {
                    let (width, height) = self.image_size;
                    let (width, height) = (width as usize, height as usize);
                    GrayImage::new(width, height, vec![3; width * height])?
                }
                _ => self.world.render(place, now, 1 + tick as u64),
            };
            let frame = Frame {
                part,
                place,
                trouble,
                now,
                stamp: Trouble::stamp(trouble, now),
                image,
                taken: Instant::now(),
            };
            match to_robot.try_send(frame) {
                Ok(()) => {}
                Err(TrySendError::Full(_)) => self.part(part, |it| it.num_missed += 1),
                Err(TrySendError::Disconnected(_)) => bail!("the robot has stopped"),
            }
        }
        Ok(())
    }

    /// Answers every image and learns from those that are located.
    fn robot(&self, mut robot: Robot, frames: &Receiver<Frame>) -> Result<()> {
        let mut part = 0;
        for frame in frames {
            let seen = chronotope::robot::Frame::new(&frame.image)
                .at(frame.stamp)
                .with_now(frame.now);
            robot.see_frame(&seen)?;
            let answer_us = frame.taken.elapsed().as_secs_f64() * 1e6;
            let found = robot.place();
            let truth = &self.world.places()[frame.place];
            // A covered camera is nowhere.
            let is_right = found == Some(truth) && frame.trouble != Some(Trouble::Black);
            let is_wrong = found.is_some() && !is_right;
            let count = |part: &mut Part| {
                part.num_images += 1;
                part.num_right += usize::from(is_right);
                part.num_wrong += usize::from(is_wrong);
                part.num_undecided += usize::from(found.is_none());
                part.answer_us.push(answer_us);
            };
            self.part(frame.part, count);
            if let Some(index) = (TROUBLES.iter()).position(|it| Some(it.1) == frame.trouble) {
                let mut troubles = (self.troubles.lock()).unwrap_or_else(PoisonError::into_inner);
                count(&mut troubles[index]);
            }
            self.count_events(&mut robot, frame.part)?;
            if frame.part != part {
                self.measure(part, &robot)?;
                part = frame.part;
                eprintln!("{part} of {NUM_PARTS} parts");
            }
        }
        robot.commit()?;
        self.count_events(&mut robot, part)?;
        self.measure(part, &robot)
    }

    /// Counts what was learnt meanwhile.
    fn count_events(&self, robot: &mut Robot, part: usize) -> Result<()> {
        for event in robot.events() {
            match event {
                Event::Learnt { learnt, took, .. } => self.part(part, |part| {
                    part.num_learnt += usize::from(learnt.doubt.is_none());
                    part.num_held += usize::from(learnt.doubt.is_some());
                    part.observe_us.push(took.as_secs_f64() * 1e6);
                }),
                Event::Missed { .. } => self.part(part, |part| part.num_unlearnt += 1),
                Event::NotLearnt { error, .. } | Event::NotCommitted { error, .. } => {
                    return Err(error.into());
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// What is in memory and in the file at the end of a part.
    fn measure(&self, part: usize, robot: &Robot) -> Result<()> {
        let map_bytes = robot.localizer().snapshot().summary().num_bytes;
        let file_bytes = std::fs::metadata(robot.path())?.len();
        self.part(part, |it| {
            it.memory_bytes = memory_bytes().unwrap_or_default();
            it.map_bytes = map_bytes;
            it.file_bytes = file_bytes;
        });
        Ok(())
    }

    fn table(&self) -> Result<String> {
        let options = self.options;
        let mut table = format!(
            "{:.1} minutes at {} images/s round {} places (seed {}), {} s of the street a second, at most {} features and \
             {} visits a place\n\
             {:>6} {:>6} {:>6} {:>15} {:>6} {:>5} {:>5} | {:>7} {:>7} {:>7} | {:>7} {:>7} | {:>6} {:>7} {:>8}  {}\n",
            options.minutes,
            options.rate,
            options.street.num_places,
            options.street.seed,
            options.clock_rate,
            options.street.features_per_place,
            options.street.visits_per_place,
            "minute",
            "images",
            "missed",
            "right/wrong/none",
            "learnt",
            "held",
            "left",
            "p50 ms",
            "p99 ms",
            "max ms",
            "obs p50",
            "obs p99",
            "RSS MB",
            "map kB",
            "file kB",
            "trouble",
        );
        let parts = self.parts.lock().unwrap_or_else(PoisonError::into_inner);
        for (index, part) in parts.iter().enumerate() {
            let share = |index: usize| index as f64 / NUM_PARTS as f64;
            let mut answer_us = part.answer_us.clone();
            let mut observe_us = part.observe_us.clone();
            let answer = |it: &mut Vec<f64>, at| quantile(it, at) / 1e3;
            let troubles = (TROUBLES.iter())
                .filter(|it| (share(index)..share(index + 1)).contains(&it.0))
                .map(|it| it.1.name());
            writeln!(
                table,
                "{:>6.1} {:>6} {:>6} {:>15} {:>6} {:>5} {:>5} | {:>7.2} {:>7.2} {:>7.2} | {:>7.2} {:>7.2} | {:>6.1} {:>7} \
                 {:>8}  {}",
                options.minutes * share(index + 1),
                part.num_images,
                part.num_missed,
                format!(
                    "{}/{}/{}",
                    part.num_right, part.num_wrong, part.num_undecided
                ),
                part.num_learnt,
                part.num_held,
                part.num_unlearnt,
                answer(&mut answer_us, 0.5),
                answer(&mut answer_us, 0.99),
                answer(&mut answer_us, 1.0),
                answer(&mut observe_us, 0.5),
                answer(&mut observe_us, 0.99),
                part.memory_bytes as f64 / 1e6,
                part.map_bytes / 1000,
                part.file_bytes / 1000,
                troubles.collect::<Vec<_>>().join(", "),
            )?;
        }
        let troubles = (self.troubles.lock()).unwrap_or_else(PoisonError::into_inner);
        for ((_, trouble), seen) in TROUBLES.iter().zip(troubles.iter()) {
            writeln!(
                table,
                "{}: {} images, {} right, {} wrong",
                trouble.name(),
                seen.num_images,
                seen.num_right,
                seen.num_wrong
            )?;
        }
        Ok(table)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use chronotope::map::Map;

    #[test]
    fn every_trouble_comes_once_and_goes() {
        let mut met = Vec::new();
        for tick in 0..10_000 {
            let trouble = Trouble::at(f64::from(tick) / 1e4);
            if met.last() != Some(&trouble) {
                met.push(trouble);
            }
        }
        let named: Vec<_> = met.iter().flatten().copied().collect();
        assert_eq!(named, TROUBLES.map(|it| it.1));
        assert_eq!(met.first(), Some(&None));
        assert_eq!(met.last(), Some(&None));
    }

    #[test]
    fn a_short_drive_answers_learns_and_holds_what_is_wrong() {
        let folder = tempfile::tempdir().expect("temporary");
        let options = LiveOptions {
            minutes: 0.2,
            rate: 10.0,
            clock_rate: 24.0,
            street: StreetOptions {
                seed: 1,
                num_places: 2,
                features_per_place: 1_500,
                visits_per_place: 200,
                out: folder.path().to_owned(),
            },
        };
        let table = run(&options).expect("it drives");
        assert_eq!(
            table.lines().count(),
            2 + NUM_PARTS + TROUBLES.len(),
            "{table}"
        );
        let map = Map::open_read_only(folder.path().join("soak-live.map")).expect("kept");
        let num_visits = map.snapshot().summary().num_visits;
        assert!(num_visits > 2 * 40, "{num_visits}\n{table}");
    }
}
