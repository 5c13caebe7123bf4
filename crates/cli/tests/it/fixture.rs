//! A street of four places, the command as its users run it, and what it said.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::{Arc, OnceLock};

use chronotope::dataset::synthetic::{World, WorldConfig};
use chronotope::map::{Map, Snapshot};
use chronotope::{Period, Time};
use serde_json::Value;
use tempfile::TempDir;

pub(crate) const NUM_PLACES: usize = 4;
pub(crate) const NUM_VISITS: i64 = 6;
/// After the last visit, at an hour and a season that were visited.
pub(crate) const QUERY_TIME: &str = "2023-11-15T12:00:00Z";
/// The images of all places at that time, as [`Fixture::with_map`] writes them.
pub(crate) const QUERIES: &str = "query0.png query1.png query2.png query3.png";

fn world() -> &'static World {
    static WORLD: OnceLock<World> = OnceLock::new();
    WORLD.get_or_init(|| {
        let cfg = WorldConfig::new(11)
            .with_num_places(NUM_PLACES)
            .with_image_size(320, 240);
        World::new(&cfg).expect("a valid configuration")
    })
}

/// A place of the street with a pattern of its own painted on it: the synthetic places look alike
/// on purpose, but here only the command is tested.
pub(crate) fn png(place: usize, time: Time, seed: u64) -> Vec<u8> {
    let street = world().render(place, time, seed);
    let (width, height) = street.size();
    let mut picture = image::GrayImage::from_raw(width, height, street.data().to_vec())
        .expect("width x height bytes");
    let mut state = place as u64 + 1;
    let mut random = |below: u64| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) % below
    };
    for _ in 0..150 {
        let (left, top) = (50 + random(210) as u32, 50 + random(130) as u32);
        let (columns, rows) = (5 + random(9) as u32, 5 + random(9) as u32);
        let level = image::Luma([random(256) as u8]);
        for y in top..top + rows {
            for x in left..left + columns {
                picture.put_pixel(x, y, level);
            }
        }
    }
    encoded(&picture)
}

pub(crate) fn encoded(picture: &image::GrayImage) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut cursor = std::io::Cursor::new(&mut bytes);
    picture
        .write_to(&mut cursor, image::ImageFormat::Png)
        .expect("memory");
    bytes
}

pub(crate) fn query_time() -> Time {
    Time::parse(QUERY_TIME).expect("valid")
}

/// A PNG of one grey level.
pub(crate) fn plain((width, height): (u32, u32), level: u8) -> Vec<u8> {
    encoded(&image::GrayImage::from_pixel(
        width,
        height,
        image::Luma([level]),
    ))
}

/// Place, time, file name and PNG.
type Image = (usize, Time, String, Vec<u8>);

/// Every learnt image.
pub(crate) fn images() -> &'static [Image] {
    static IMAGES: OnceLock<Vec<Image>> = OnceLock::new();
    IMAGES.get_or_init(|| {
        let start = Time::parse("2023-05-15T12:00:00Z").expect("valid");
        (0..NUM_VISITS)
            .flat_map(|visit| (0..NUM_PLACES).map(move |place| (visit, place)))
            .map(|(visit, place)| {
                let time = start.plus_us(visit * 30 * Period::DAY.as_us());
                let name = format!("images/{visit}{place}.png");
                (place, time, name, png(place, time, 0))
            })
            .collect()
    })
}

/// A folder with the dataset `data/` of four places with six visits each.
pub(crate) struct Fixture {
    pub(crate) dir: TempDir,
}

impl Fixture {
    pub(crate) fn new() -> Self {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let fixture = Self { dir };
        fs::create_dir_all(fixture.path("data/images")).expect("writable");
        let mut index = String::from("place,time,path\n");
        for (place, time, name, bytes) in images() {
            writeln!(index, "place-{place:02},{time},{name}").expect("memory");
            fs::write(fixture.path("data").join(name), bytes).expect("writable");
        }
        fixture.write("data/index.csv", index);
        fixture.write(
            "data/edges.csv",
            "from,to,name\nplace-00,place-01,street\nplace-01,place-00,\n",
        );
        fixture.write("data/poses.csv", "place,x,y,z\nplace-02,1.5,-2,0\n");
        fixture
    }

    /// Also with the map `street.map` of it, which keeps all appearances.
    pub(crate) fn with_map() -> Self {
        static MAP: OnceLock<Vec<u8>> = OnceLock::new();
        let fixture = Self::new();
        let bytes = MAP.get_or_init(|| {
            fixture.succeeds("map build --data data --out built.map --keep-appearances all");
            fs::read(fixture.path("built.map")).expect("built")
        });
        fixture.write("street.map", bytes);
        for place in 0..NUM_PLACES {
            fixture.write(format!("query{place}.png"), png(place, query_time(), 9));
        }
        fixture
    }

    pub(crate) fn path(&self, name: impl AsRef<Path>) -> PathBuf {
        self.dir.path().join(name)
    }

    pub(crate) fn write(&self, name: impl AsRef<Path>, bytes: impl AsRef<[u8]>) {
        fs::write(self.path(name), bytes).expect("writable");
    }

    pub(crate) fn index(&self) -> String {
        fs::read_to_string(self.path("data/index.csv")).expect("written")
    }

    /// `chronotope` with these words as its arguments.
    pub(crate) fn command(&self, line: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_chronotope"));
        command
            .current_dir(self.dir.path())
            .args(line.split_whitespace());
        command
    }

    /// Runs it to its end, however that is.
    pub(crate) fn run(&self, line: &str) -> Ran {
        Ran::from(self.command(line).output().expect("the command starts"))
    }

    /// Runs what must end with exit code 0.
    pub(crate) fn succeeds(&self, line: &str) -> Ran {
        let ran = self.run(line);
        assert_eq!(ran.code, 0, "{line}: {ran:?}");
        ran
    }

    /// Runs what must fail with exit code 2 and these words on stderr.
    pub(crate) fn fails(&self, line: &str, words: &[&str]) {
        let ran = self.run(line);
        assert_eq!(ran.code, 2, "{line}: {ran:?}");
        ran.notes(words);
        assert!(!ran.stderr.contains("panicked"), "{line}: {ran:?}");
    }

    /// The digest of a map in the folder, as the command shows it.
    pub(crate) fn digest(&self, map: &str) -> Value {
        self.succeeds(&format!("map inspect {map} --json")).lines()[0]["digest"].clone()
    }

    /// A map in the folder.
    pub(crate) fn open(&self, name: &str) -> Arc<Snapshot> {
        let map = Map::open_read_only(self.path(name)).expect("a map");
        map.snapshot()
    }
}

/// Says that a test did not do what it is there for; `make test` counts these
/// (`CHRONOTOPE_SKIPS` names the file that it reads).
pub(crate) fn skipped(reason: &str) {
    eprintln!("skipped: {reason}");
    if let Some(path) = std::env::var_os("CHRONOTOPE_SKIPS") {
        use std::io::Write as _;
        let file = fs::OpenOptions::new().append(true).create(true).open(path);
        writeln!(file.expect("writable"), "{reason}").expect("writable");
    }
}

/// Whether `strace` is there and may trace; if not, the test counts as skipped.
pub(crate) fn may_trace(fixture: &Fixture, what: &str) -> bool {
    let trial = (Command::new("strace").current_dir(fixture.dir.path()))
        .args(["-f", "-qq", "-o", "/dev/null", "-e", "trace=openat"])
        .args([env!("CARGO_BIN_EXE_chronotope"), "--version"])
        .output();
    let may = trial.is_ok_and(|output| output.status.success());
    if !may {
        skipped(&format!(
            "{what}, because strace is not there or may not trace"
        ));
    }
    may
}

/// How the command ended, and what it said.
#[derive(Debug)]
pub(crate) struct Ran {
    pub(crate) code: i32,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl From<Output> for Ran {
    fn from(output: Output) -> Self {
        Self {
            code: output.status.code().unwrap_or(-1),
            stdout: String::from_utf8(output.stdout).expect("text"),
            stderr: String::from_utf8(output.stderr).expect("text"),
        }
    }
}

impl Ran {
    /// These words are on stdout.
    pub(crate) fn prints(&self, words: &[&str]) {
        for word in words {
            assert!(self.stdout.contains(word), "no `{word}` in {self:?}");
        }
    }

    /// These words are on stderr.
    pub(crate) fn notes(&self, words: &[&str]) {
        for word in words {
            assert!(self.stderr.contains(word), "no `{word}` in {self:?}");
        }
    }

    /// Its lines of JSON.
    pub(crate) fn lines(&self) -> Vec<Value> {
        let parse = |line| serde_json::from_str(line).expect("a line of JSON");
        self.stdout.lines().map(parse).collect()
    }
}
