//! The command as its users run it: real processes, files and signals.

use std::fmt::Write as _;
use std::fs;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::OnceLock;
use std::time::Duration;

use chronotope::dataset::synthetic::{World, WorldConfig};
use chronotope::map::{Map, MapMeta};
use chronotope::{Period, Time};
use serde_json::Value;
use tempfile::TempDir;

const NUM_PLACES: usize = 4;
const NUM_VISITS: i64 = 6;
/// After the last visit, at an hour and a season that were visited.
const QUERY_TIME: &str = "2023-11-15T12:00:00Z";

fn world() -> &'static World {
    static WORLD: OnceLock<World> = OnceLock::new();
    WORLD.get_or_init(|| {
        let cfg = WorldConfig::new(11)
            .num_places(NUM_PLACES)
            .image_size(320, 240);
        World::new(&cfg).expect("a valid configuration")
    })
}

/// A place of the street with a pattern of its own painted on it: the synthetic places look alike
/// on purpose, but here only the command is tested.
fn png(place: usize, time: Time, seed: u64) -> Vec<u8> {
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

fn encoded(picture: &image::GrayImage) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut cursor = std::io::Cursor::new(&mut bytes);
    picture
        .write_to(&mut cursor, image::ImageFormat::Png)
        .expect("memory");
    bytes
}

fn query_time() -> Time {
    Time::parse(QUERY_TIME).expect("valid")
}

/// Place, time, file name and PNG.
type Image = (usize, Time, String, Vec<u8>);

/// Every learnt image.
fn images() -> &'static [Image] {
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
struct Fixture {
    dir: TempDir,
}

impl Fixture {
    fn new() -> Self {
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
    fn with_map() -> Self {
        static MAP: OnceLock<Vec<u8>> = OnceLock::new();
        let fixture = Self::new();
        let bytes = MAP.get_or_init(|| {
            let built = fixture.run(&[
                "map",
                "build",
                "--data",
                "data",
                "--out",
                "built.map",
                "--keep-appearances",
                "all",
            ]);
            assert_eq!(built.code, 0, "{built:?}");
            fs::read(fixture.path("built.map")).expect("built")
        });
        fixture.write("street.map", bytes);
        for place in 0..NUM_PLACES {
            fixture.write(format!("query{place}.png"), png(place, query_time(), 9));
        }
        fixture
    }

    fn path(&self, name: impl AsRef<Path>) -> PathBuf {
        self.dir.path().join(name)
    }

    fn write(&self, name: impl AsRef<Path>, bytes: impl AsRef<[u8]>) {
        fs::write(self.path(name), bytes).expect("writable");
    }

    fn index(&self) -> String {
        fs::read_to_string(self.path("data/index.csv")).expect("written")
    }

    fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_chronotope"));
        command
            .current_dir(self.dir.path())
            .env_remove("CHRONOTOPE_KERNEL")
            .args(args);
        command
    }

    fn run(&self, args: &[&str]) -> Ran {
        Ran::from(self.command(args).output().expect("the command starts"))
    }

    /// Runs what must fail with exit code 2 and these words on stderr.
    fn fails(&self, args: &[&str], words: &[&str]) {
        let ran = self.run(args);
        assert_eq!(ran.code, 2, "{args:?}: {ran:?}");
        for word in words {
            assert!(
                ran.stderr.contains(word),
                "{args:?}: no `{word}` in {ran:?}"
            );
        }
        assert!(!ran.stderr.contains("panicked"), "{args:?}: {ran:?}");
    }
}

#[derive(Debug)]
struct Ran {
    code: i32,
    stdout: String,
    stderr: String,
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
    fn lines(&self) -> Vec<Value> {
        let parse = |line| serde_json::from_str(line).expect("a line of JSON");
        self.stdout.lines().map(parse).collect()
    }
}

#[test]
fn a_map_is_built_and_says_what_it_holds() {
    let fixture = Fixture::new();
    let built = fixture.run(&["map", "build", "--data", "data", "--out", "street.map"]);
    assert_eq!((built.code, built.stderr.as_str()), (0, ""), "{built:?}");
    assert!(
        built.stdout.contains("4 places, 24 visits (24 learnt now)"),
        "{built:?}"
    );
    assert!(!fixture.path("street.map.part").exists());

    let shown = fixture.run(&["map", "inspect", "street.map"]);
    assert_eq!(shown.code, 0, "{shown:?}");
    for words in [
        "places       4",
        "320 x 240 px",
        "place-02: 6 visits",
        "at (1.5, -2, 0) m",
    ] {
        assert!(shown.stdout.contains(words), "no `{words}` in {shown:?}");
    }
    let shown = &fixture
        .run(&["map", "inspect", "street.map", "--json"])
        .lines()[0];
    assert_eq!(shown["num_visits"], 24);
    assert_eq!(shown["preset"], "default");
    assert_eq!(shown["edges"][0]["name"], "street");
    assert_eq!(shown["first"], "2023-05-15T12:00:00Z");
    assert!(
        shown["extractor"]
            .as_str()
            .is_some_and(|id| id.starts_with("star-brief:"))
    );

    let verified = fixture.run(&["map", "verify", "street.map", "--json"]);
    assert_eq!(verified.code, 0, "{verified:?}");
    assert_eq!(verified.lines()[0]["clean"], true);
    assert_eq!(verified.lines()[0]["digest"], shown["digest"]);
}

#[test]
fn the_same_images_give_the_same_map() {
    let fixture = Fixture::new();
    for map in ["a.map", "b.map"] {
        let mut command = fixture.command(&["map", "build", "--data", "data", "--out", map]);
        let threads = if map == "a.map" { "1" } else { "3" };
        let built = command.env("RAYON_NUM_THREADS", threads).output();
        assert!(built.expect("the command starts").status.success());
    }
    let digest = |map| fixture.run(&["map", "inspect", map, "--json"]).lines()[0]["digest"].clone();
    assert_eq!(digest("a.map"), digest("b.map"));
}

#[test]
fn images_are_located_at_their_places() {
    let fixture = Fixture::with_map();
    let all = ["query0.png", "query1.png", "query2.png", "query3.png"];
    for method in ["static", "fremen", "experience", "experience-all"] {
        let mut args = vec!["localize", "street.map", "--json", "--method", method];
        args.extend(["--time", QUERY_TIME]);
        args.extend(all);
        let ran = fixture.run(&args);
        assert_eq!(
            (ran.code, ran.stderr.as_str()),
            (0, ""),
            "{method}: {ran:?}"
        );
        for (place, line) in ran.lines().iter().enumerate() {
            assert_eq!(line["image"], format!("query{place}.png"));
            assert_eq!(line["decision"], "at", "{method}: {line}");
            assert_eq!(line["place"], format!("place-{place:02}"), "{method}");
            assert_eq!(line["best"]["place"], line["place"]);
            assert!(line["displacement_px"].is_array());
        }
    }
    let one = fixture.run(&["localize", "street.map", "query2.png", "--time", QUERY_TIME]);
    assert_eq!(one.code, 0, "{one:?}");
    for words in [
        "decision      place-02",
        "(given)",
        "second",
        "reason",
        "displacement  (",
    ] {
        assert!(one.stdout.contains(words), "no `{words}` in {one:?}");
    }
    let several = fixture.run(&[
        "localize",
        "street.map",
        "query2.png",
        "query3.png",
        "--method",
        "static",
    ]);
    assert_eq!(several.code, 0, "{several:?}");
    assert_eq!(several.stdout.lines().count(), 2);
    // More than any place has: everything is matched.
    let n = [
        "localize",
        "street.map",
        "query1.png",
        "--time",
        QUERY_TIME,
        "--n",
        "100000",
    ];
    assert_eq!(fixture.run(&n).code, 0);
}

#[test]
fn images_of_one_way_are_followed_along_the_edges() {
    let fixture = Fixture::with_map();
    let way = [
        "localize",
        "street.map",
        "query0.png",
        "query1.png",
        "query2.png",
        "--time",
        QUERY_TIME,
        "--track",
        "--json",
    ];
    let followed = fixture.run(&way);
    assert_eq!(followed.code, 0, "{followed:?}");
    let places: Vec<Value> = (followed.lines().iter())
        .map(|line| line["place"].clone())
        .collect();
    assert_eq!(places, ["place-00", "place-01", "place-02"]);
    let by_count = [&way[..], &["--score", "count"]].concat();
    fixture.fails(&by_count, &["--track", "likelihood"]);
}

#[test]
fn a_trace_is_complete_in_itself() {
    let fixture = Fixture::with_map();
    let query = [
        "localize",
        "street.map",
        "query1.png",
        "query2.png",
        "--time",
        QUERY_TIME,
    ];
    for method in ["fremen", "experience"] {
        let mut args = query.to_vec();
        args.extend(["--method", method, "--trace", "-"]);
        let ran = fixture.run(&args);
        assert_eq!(ran.code, 0, "{ran:?}");
        assert!(ran.stderr.contains("query1.png  place-01"), "{ran:?}");
        let lines = ran.lines();
        assert_eq!(lines.len(), 2);
        for line in &lines {
            let length = |value: &Value| value.as_array().expect("an array").len();
            let ranking = &line["localization"]["ranking"];
            assert_eq!(length(ranking), NUM_PLACES);
            assert_eq!(length(&line["places"]), NUM_PLACES);
            for (candidate, predicted) in ranking
                .as_array()
                .expect("an array")
                .iter()
                .zip(line["predicted"].as_array().expect("an array"))
            {
                if method == "fremen" {
                    assert_eq!(length(&candidate["predicted"]), length(predicted));
                }
                for found in candidate["matches"].as_array().expect("an array") {
                    assert!(
                        (found["rank"].as_u64().expect("a number") as usize) < length(predicted)
                    );
                    assert!(
                        (found["live"].as_u64().expect("a number") as usize)
                            < length(&line["live"])
                    );
                }
            }
            assert!(length(&line["localization"]["ranking"][0]["matches"]) > 0);
        }
    }
    let mut args = query.to_vec();
    args.extend(["--trace", "trace.jsonl", "--json"]);
    assert_eq!(fixture.run(&args).lines().len(), 2);
    let trace = fs::read_to_string(fixture.path("trace.jsonl")).expect("written");
    assert_eq!(trace.lines().count(), 2);
    args[query.len() + 1] = "-";
    fixture.fails(&args, &["--json", "--trace -"]);
}

#[test]
fn an_image_of_nowhere_is_unknown() {
    let fixture = Fixture::with_map();
    let grey = image::GrayImage::from_pixel(320, 240, image::Luma([90]));
    fixture.write("grey.png", encoded(&grey));
    let ran = fixture.run(&[
        "localize",
        "street.map",
        "grey.png",
        "query0.png",
        "--time",
        QUERY_TIME,
        "--json",
    ]);
    assert_eq!(ran.code, 1, "{ran:?}");
    assert_eq!(ran.lines()[0]["decision"], "unknown");
    assert_eq!(ran.lines()[0]["place"], Value::Null);
    assert_eq!(ran.lines()[1]["decision"], "at");
}

#[test]
fn the_time_comes_from_option_index_exif_or_name() {
    let fixture = Fixture::with_map();
    let source = |args: &[&str]| {
        let mut all = vec!["localize", "street.map", "--json"];
        all.extend(args);
        let ran = fixture.run(&all);
        assert_ne!(ran.code, 2, "{ran:?}");
        let line = &ran.lines()[0];
        (line["time"].clone(), line["time_source"].clone())
    };
    let listed = "data/images/12.png";
    assert_eq!(
        source(&[listed]),
        ("2023-06-14T12:00:00Z".into(), "index".into())
    );
    assert_eq!(
        source(&[listed, "--time", QUERY_TIME]),
        (QUERY_TIME.into(), "option".into())
    );
    assert_eq!(
        source(&["query0.png", "--method", "static"]),
        (Value::Null, Value::Null)
    );

    fixture.write(
        "robot.toml",
        "name = 'robot'\n[time]\nclock = 'real'\nfile_name = 'cam_{unix_s}'\n",
    );
    fs::copy(
        fixture.path("query3.png"),
        fixture.path("cam_1700000000.png"),
    )
    .expect("writable");
    let named = source(&["cam_1700000000.png", "--manifest", "robot.toml"]);
    assert_eq!(named, ("2023-11-14T22:13:20Z".into(), "file-name".into()));
    let dated = with_exif(&png(0, query_time(), 9));
    fixture.write("dated.png", dated);
    assert_eq!(
        source(&["dated.png"]),
        ("2023-11-15T11:00:00Z".into(), "exif".into())
    );

    // Nothing says when: an error with a remedy, never a guess.
    let untimed = ["localize", "street.map", "query0.png"];
    fixture.fails(&untimed, &["query0.png", "when was it taken", "--time"]);
    fixture.fails(
        &[
            "localize",
            "street.map",
            "query0.png",
            "--manifest",
            "robot.toml",
        ],
        &["query0.png", "does not fit the rule of `robot`"],
    );
    fixture.fails(
        &[
            "localize",
            "street.map",
            "query0.png",
            "--manifest",
            "nowhere",
        ],
        &["no supported dataset is called `nowhere`"],
    );
}

/// A PNG with an eXIf chunk that says 2023-11-15 12:00:00 +01:00.
fn with_exif(png: &[u8]) -> Vec<u8> {
    // A little-endian TIFF: IFD0 with a pointer to the EXIF IFD, that with two texts.
    let mut tiff = b"II*\0\x08\0\0\0".to_vec();
    let entry = |tag: u16, kind: u16, count: u32, value: u32| {
        let mut bytes = Vec::new();
        bytes.extend(tag.to_le_bytes());
        bytes.extend(kind.to_le_bytes());
        bytes.extend(count.to_le_bytes());
        bytes.extend(value.to_le_bytes());
        bytes
    };
    tiff.extend(1_u16.to_le_bytes());
    tiff.extend(entry(0x8769, 4, 1, 26));
    tiff.extend(0_u32.to_le_bytes());
    tiff.extend(2_u16.to_le_bytes());
    tiff.extend(entry(0x9003, 2, 20, 56));
    tiff.extend(entry(0x9011, 2, 7, 76));
    tiff.extend(0_u32.to_le_bytes());
    tiff.extend(b"2023:11:15 12:00:00\0+01:00\0");
    let mut encoder = Vec::new();
    let picture = image::load_from_memory(png).expect("a PNG");
    {
        use image::ImageEncoder;
        let mut target = image::codecs::png::PngEncoder::new(&mut encoder);
        target.set_exif_metadata(tiff).expect("PNG holds EXIF");
        target
            .write_image(
                picture.as_bytes(),
                picture.width(),
                picture.height(),
                picture.color().into(),
            )
            .expect("memory");
    }
    encoder
}

#[test]
fn images_of_an_index_are_cut_as_it_says() {
    let fixture = Fixture::with_map();
    // A large picture with two queries side by side.
    let half = |place| image::load_from_memory(&png(place, query_time(), 9)).expect("a PNG");
    let mut wide = image::GrayImage::new(640, 240);
    for (place, x) in [(1, 0), (3, 320)] {
        image::imageops::replace(&mut wide, &half(place).to_luma8(), x, 0);
    }
    fs::create_dir(fixture.path("wide")).expect("writable");
    fixture.write("wide/both.png", encoded(&wide));
    let header = "place,time,path,crop_x,crop_y,crop_w,crop_h\n";
    let row = |place: &str, x: u32| format!("{place},{QUERY_TIME},both.png,{x},0,320,240\n");
    fixture.write(
        "wide/index.csv",
        format!("{header}{}{}", row("left", 0), row("right", 320)),
    );
    let ran = fixture.run(&["localize", "street.map", "wide/both.png", "--json"]);
    assert_eq!(ran.code, 0, "{ran:?}");
    let places: Vec<_> = ran
        .lines()
        .iter()
        .map(|line| line["place"].clone())
        .collect();
    assert_eq!(places, ["place-01", "place-03"]);
    assert_eq!(ran.lines()[1]["truth"], "right");

    // Uncut it has another size than the map's images.
    fixture.write("wide.png", encoded(&wide));
    fixture.fails(
        &["localize", "street.map", "wide.png", "--time", QUERY_TIME],
        &["wide.png", "640 x 240", "320 x 240", "crop or scale"],
    );
    fixture.write("wide/index.csv", format!("{header}{}", row("right", 321)));
    fixture.write("wide/other.png", encoded(&wide));
    let other = format!(
        "{header}{}x,{QUERY_TIME},other.png,,,,\n",
        row("right", 321)
    );
    fixture.write("wide/index.csv", other);
    fixture.fails(
        &["localize", "street.map", "wide/both.png"],
        &["both.png", "index.csv line 2", "crop"],
    );
}

#[test]
fn a_mask_hides_what_is_black() {
    let fixture = Fixture::with_map();
    let mask = |size: (u32, u32), level| {
        encoded(&image::GrayImage::from_pixel(
            size.0,
            size.1,
            image::Luma([level]),
        ))
    };
    fixture.write("white.png", mask((320, 240), 255));
    fixture.write("black.png", mask((320, 240), 0));
    fixture.write("small.png", mask((32, 24), 255));
    let mut args = vec![
        "localize",
        "street.map",
        "query1.png",
        "--time",
        QUERY_TIME,
        "--mask",
        "white.png",
    ];
    assert_eq!(fixture.run(&args).code, 0);
    args[6] = "black.png";
    assert_eq!(fixture.run(&args).code, 1);
    args[6] = "small.png";
    fixture.fails(&args, &["query1.png", "32 x 24", "mask"]);
    args[6] = "none.png";
    fixture.fails(&args, &["none.png"]);
}

#[test]
fn predictions_are_the_most_likely_features() {
    let fixture = Fixture::with_map();
    let ran = fixture.run(&[
        "predict",
        "street.map",
        "--time",
        QUERY_TIME,
        "--n",
        "5",
        "--json",
    ]);
    assert_eq!((ran.code, ran.stderr.as_str()), (0, ""), "{ran:?}");
    assert_eq!(ran.lines().len(), NUM_PLACES);
    for line in ran.lines() {
        let features = line["features"].as_array().expect("an array");
        assert_eq!(features.len(), 5);
        let p: Vec<f64> = features
            .iter()
            .map(|it| it["p"].as_f64().expect("a number"))
            .collect();
        assert!(
            p.iter().all(|p| (0.0..=1.0).contains(p)) && p.is_sorted_by(|a, b| a >= b),
            "{p:?}"
        );
    }
    let all = [
        "predict",
        "street.map",
        "--time",
        QUERY_TIME,
        "--node",
        "place-03",
        "--n",
        "100000",
    ];
    let ran = fixture.run(&all);
    assert_eq!(ran.code, 0, "{ran:?}");
    assert!(
        ran.stdout.starts_with("place-03 at 2023-11-15T12:00:00Z: "),
        "{ran:?}"
    );
    let far = fixture.run(&[
        "predict",
        "street.map",
        "--time",
        "1999-01-01T00:00:00Z",
        "--n",
        "1",
    ]);
    assert_eq!(far.code, 0);
    assert!(
        far.stderr.contains("before the map's first visit"),
        "{far:?}"
    );
    let far = fixture.run(&[
        "predict",
        "street.map",
        "--time",
        "2223-01-01T00:00:00Z",
        "--n",
        "1",
    ]);
    assert_eq!(far.code, 0);
    assert!(far.stderr.contains("after the map's last visit"), "{far:?}");

    let time = ["predict", "street.map", "--time"];
    fixture.fails(
        &[&time[..], &["yesterday"]].concat(),
        &["yesterday", "RFC 3339"],
    );
    fixture.fails(
        &[&time[..], &["2023-11-15T12:00:00"]].concat(),
        &["RFC 3339 with an offset"],
    );
    fixture.fails(
        &[&time[..], &[QUERY_TIME, "--node", "moon"]].concat(),
        &["no place `moon`", "place-00"],
    );
    for n in ["0", "-1", "NaN"] {
        fixture.fails(
            &[&time[..], &[QUERY_TIME, &format!("--n={n}")]].concat(),
            &[n],
        );
    }
}

#[test]
fn a_printed_configuration_reads_back() {
    let fixture = Fixture::new();
    for preset in ["default", "lttl"] {
        let print = [
            "map",
            "build",
            "--print-config",
            "--preset",
            preset,
            "--keep-appearances",
            "none",
        ];
        let printed = fixture.run(&print);
        assert_eq!(printed.code, 0, "{printed:?}");
        assert!(
            printed.stdout.contains("keep-appearances = \"none\""),
            "{printed:?}"
        );
        fixture.write("numbers.toml", &printed.stdout);
        for command in [&["map", "build"][..], &["localize"], &["predict"]] {
            let args = [command, &["--config", "numbers.toml", "--print-config"]].concat();
            let again = fixture.run(&args);
            assert_eq!(again.stdout, printed.stdout, "{command:?}: {again:?}");
        }
    }
    let changed = fixture.run(&[
        "localize",
        "--print-config",
        "--method",
        "static",
        "--n",
        "7",
    ]);
    assert!(
        changed.stdout.contains("method = \"static\""),
        "{changed:?}"
    );
    assert!(changed.stdout.contains("top = 7"), "{changed:?}");

    for (text, words) in [
        (
            "[localize]\nmethods = 'static'",
            &["bad.toml: line 2", "methods"][..],
        ),
        (
            "[learn]\nfeatures-per-visit = -3",
            &["bad.toml: line 2", "-3"],
        ),
        (
            "[localize]\nselection = { threshold = nan }",
            &["bad.toml: line 2", "[0, 1]"],
        ),
        ("nonsense", &["bad.toml: line 1"]),
        ("[learnt]", &["bad.toml: line 1", "learnt"]),
    ] {
        fixture.write("bad.toml", text);
        fixture.fails(
            &["localize", "--print-config", "--config", "bad.toml"],
            words,
        );
    }
    fixture.fails(
        &["localize", "--print-config", "--config", "none.toml"],
        &["none.toml", "--print-config"],
    );
}

#[test]
fn a_configuration_changes_the_answer() {
    let fixture = Fixture::with_map();
    fixture.write(
        "strict.toml",
        "[localize]\nscore = 'inliers'\nmin-score = 100000\n",
    );
    let args = [
        "localize",
        "street.map",
        "query0.png",
        "--time",
        QUERY_TIME,
        "--config",
        "strict.toml",
    ];
    let ran = fixture.run(&args);
    assert_eq!(ran.code, 1, "{ran:?}");
    assert!(
        ran.stdout.contains("below the least score 100000"),
        "{ran:?}"
    );
}

#[test]
fn broken_images_are_errors_that_name_them_and_others_are_answered() {
    let fixture = Fixture::with_map();
    let whole = png(0, query_time(), 9);
    fixture.write("cut.png", &whole[..whole.len() / 2]);
    fixture.write("empty.png", "");
    fixture.write("text.png", "no image");
    for (name, words) in [
        ("cut.png", "truncated"),
        ("empty.png", "the file is empty"),
        ("text.png", "not an image"),
        ("none.png", "No such file"),
        ("data", "folder"),
    ] {
        let ran = fixture.run(&[
            "localize",
            "street.map",
            name,
            "query1.png",
            "--time",
            QUERY_TIME,
        ]);
        assert_eq!(ran.code, 2, "{ran:?}");
        assert!(
            ran.stderr.contains(name) && ran.stderr.contains(words),
            "{words}: {ran:?}"
        );
        assert!(ran.stdout.contains("query1.png  place-01"), "{ran:?}");
    }
}

#[test]
fn what_is_no_map_is_refused() {
    let fixture = Fixture::with_map();
    let bytes = fs::read(fixture.path("street.map")).expect("built");
    fixture.write("cut.map", &bytes[..bytes.len() / 2]);
    fixture.write("text.map", "no map");
    fixture.write("empty.map", "");
    for map in ["cut.map", "text.map", "empty.map", "none.map", "data"] {
        for command in [&["map", "inspect"][..], &["predict", "--time", QUERY_TIME]] {
            fixture.fails(&[command, &[map]].concat(), &[map]);
        }
        fixture.fails(
            &["localize", map, "query0.png", "--time", QUERY_TIME],
            &[map],
        );
    }
    let mut damaged = bytes.clone();
    for byte in damaged
        .iter_mut()
        .skip(bytes.len() / 2)
        .step_by(64)
        .take(64)
    {
        *byte ^= 0x10;
    }
    fixture.write("damaged.map", damaged);
    let verified = fixture.run(&["map", "verify", "damaged.map"]);
    assert_eq!(verified.code, 1, "{verified:?}");
    assert!(
        verified.stdout.contains("damaged.map: damaged"),
        "{verified:?}"
    );

    drop(
        Map::create(
            fixture.path("new.map"),
            MapMeta::new(1, "star-brief", "default"),
        )
        .expect("writable"),
    );
    for command in [&["predict"][..], &["localize", "--method", "static"]] {
        let rest: &[&str] = if command[0] == "predict" {
            &["new.map", "--time", QUERY_TIME]
        } else {
            &["new.map", "query0.png"]
        };
        fixture.fails(
            &[command, rest].concat(),
            &["new.map", "the map has no places"],
        );
    }
}

#[test]
fn problems_of_a_dataset_are_listed_and_the_rest_is_learnt() {
    let fixture = Fixture::new();
    let whole = &images()[0].3;
    fixture.write("data/images/cut.png", &whole[..whole.len() / 2]);
    fixture.write("data/images/empty.png", "");
    let small = image::GrayImage::from_pixel(64, 48, image::Luma([7]));
    fixture.write("data/images/small.png", encoded(&small));
    let rows = [
        ("place-00", "2024-01-01T00:00:00Z", "images/none.png"),
        ("place-00", "2024-01-02T00:00:00Z", "images/empty.png"),
        ("place-00", "2024-01-03T00:00:00Z", "images/cut.png"),
        ("place-00", "2023-05-15T12:00:00Z", "images/01.png"),
        ("place-00", "2024-01-04T00:00:00Z", "images/small.png"),
    ];
    let rows: Vec<_> = rows
        .iter()
        .map(|(place, time, path)| format!("{place},{time},{path}\n"))
        .collect();
    fixture.write("data/index.csv", fixture.index() + &rows.concat());
    let built = fixture.run(&["map", "build", "--data", "data", "--out", "street.map"]);
    assert_eq!(built.code, 0, "{built:?}");
    assert!(built.stdout.contains("4 places, 24 visits"), "{built:?}");
    for words in [
        "none.png` does not exist",
        "empty.png` is empty",
        "cut.png",
        "a second image of `place-00`",
        "64 x 48",
    ] {
        assert!(built.stderr.contains(words), "no `{words}` in {built:?}");
    }
    assert!(built.stderr.contains("5 problems"), "{built:?}");

    let checked = fixture.run(&["dataset", "check", "data"]);
    assert_eq!(checked.code, 1, "{checked:?}");
    assert!(checked.stdout.contains("problems  4"), "{checked:?}");
    let checked = fixture.run(&["dataset", "check", "data", "--json"]);
    assert_eq!(
        checked.lines()[0]["problems"].as_array().map(Vec::len),
        Some(4)
    );

    let clean = Fixture::new();
    let checked = clean.run(&["dataset", "check", "data"]);
    assert_eq!(
        (checked.code, checked.stderr.as_str()),
        (0, ""),
        "{checked:?}"
    );
    assert!(
        checked.stdout.contains("24 listed, 24 readable"),
        "{checked:?}"
    );
}

#[test]
fn an_index_that_cannot_be_trusted_is_refused() {
    let fixture = Fixture::new();
    let good = fixture.index();
    for (index, words) in [
        (
            good.replacen("2023-05-15T12:00:00Z", "yesterday", 1),
            &["index.csv", "line 2", "yesterday"][..],
        ),
        (
            good.replacen("place,time,path", "place,time,path,colour", 1),
            &["index.csv", "colour"],
        ),
        ("place,time,path\n".into(), &["index.csv", "lists no image"]),
    ] {
        fixture.write("data/index.csv", index);
        fixture.fails(
            &["map", "build", "--data", "data", "--out", "street.map"],
            words,
        );
        fixture.fails(&["dataset", "check", "data"], words);
        assert!(!fixture.path("street.map").exists() && !fixture.path("street.map.part").exists());
    }
    fixture.fails(&["dataset", "check", "nowhere"], &["nowhere"]);
    fixture.fails(
        &["map", "build", "--data", "nowhere", "--out", "street.map"],
        &["nowhere"],
    );
    fixture.fails(&["map", "build", "--out", "street.map"], &["--data"]);
}

#[test]
fn a_finished_map_is_never_overwritten() {
    let fixture = Fixture::with_map();
    let before = fs::read(fixture.path("street.map")).expect("built");
    let build = ["map", "build", "--data", "data", "--out", "street.map"];
    fixture.fails(&build, &["street.map", "exists", "never overwritten"]);
    assert_eq!(
        fs::read(fixture.path("street.map")).expect("still there"),
        before
    );
    fixture.fails(
        &[
            "map",
            "build",
            "--data",
            "data",
            "--out",
            "no/such/street.map",
        ],
        &["create the folder first"],
    );
}

/// A build in another process, held at an image that is a pipe until the test writes it.
struct HeldBuild {
    fixture: Fixture,
    process: std::process::Child,
    pipe: fs::File,
    num_visits: usize,
}

impl HeldBuild {
    const PIPE: &str = "data/images/pipe.png";

    /// Starts `build` on many visits and waits until it asks for the one in the middle.
    fn start(build: &[&str]) -> Self {
        let fixture = Fixture::new();
        let mut index = String::from("place,time,path\n");
        let mut num_visits = 1;
        for day in 0..40 {
            for (place, time, name, _) in images() {
                let time = time.plus_us(day * 60_000_000);
                writeln!(index, "place-{place:02},{time},{name}").expect("memory");
                num_visits += 1;
            }
        }
        let (_, time, ..) = images()[images().len() / 2];
        writeln!(index, "place-00,{},images/pipe.png", time.plus_us(1)).expect("memory");
        fixture.write("data/index.csv", index);
        let path = fixture.path(Self::PIPE);
        let made = Command::new("mkfifo").arg(&path).status();
        assert!(made.expect("mkfifo is there").success());
        let process = fixture
            .command(build)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the command starts");
        let (sender, receiver) = std::sync::mpsc::channel();
        // Opening a pipe waits for whoever reads it; on its own thread, so that the test can give
        // up.
        std::thread::spawn(move || sender.send(fs::OpenOptions::new().write(true).open(path)));
        let pipe = receiver
            .recv_timeout(Duration::from_secs(120))
            .expect("the build comes to the pipe")
            .expect("writable");
        Self {
            fixture,
            process,
            pipe,
            num_visits,
        }
    }

    /// Presses Ctrl-C, lets the image through once that has arrived, and waits for the end.
    fn interrupt(mut self) -> (Fixture, usize, Ran) {
        let sent = Command::new("sh")
            .args(["-c", "kill -INT \"$0\"", &self.process.id().to_string()])
            .status();
        assert!(sent.expect("kill is there").success());
        let mut stderr = BufReader::new(self.process.stderr.take().expect("piped"));
        let mut said = String::new();
        while !said.contains("stopping after") {
            let num_read = stderr.read_line(&mut said).expect("text");
            assert!(num_read > 0, "it ended before it saw Ctrl-C: {said}");
        }
        let (.., picture) = &images()[0];
        self.pipe.write_all(picture).expect("it is read");
        drop(self.pipe);
        stderr.read_to_string(&mut said).expect("text");
        let output = self.process.wait_with_output().expect("it ends");
        let mut stopped = Ran::from(output);
        stopped.stderr = said;
        // From now on an image like the others.
        fs::remove_file(self.fixture.path(Self::PIPE)).expect("is there");
        self.fixture.write(Self::PIPE, picture);
        (self.fixture, self.num_visits, stopped)
    }
}

#[test]
fn an_interrupted_build_goes_on_where_it_stopped() {
    let build = [
        "map",
        "build",
        "--data",
        "data",
        "--out",
        "street.map",
        "--commit-every",
        "0",
    ];
    let held = HeldBuild::start(&build);
    let part = held.fixture.path("street.map.part");
    // Another process may read a map that is being built.
    let seen = Map::open_read_only(&part).expect("readable").snapshot();
    assert!(seen.summary().num_visits > 0, "no commit was seen");
    let (fixture, num_visits, stopped) = held.interrupt();
    assert_eq!(stopped.code, 130, "{stopped:?}");
    assert!(
        stopped.stderr.contains("give the same command again"),
        "{stopped:?}"
    );
    assert!(!fixture.path("street.map").exists());
    assert!(fixture.run(&["map", "verify", "street.map.part"]).code == 0);
    let kept = Map::open(&part)
        .expect("intact")
        .snapshot()
        .summary()
        .num_visits;
    assert!((1..num_visits).contains(&kept), "{kept}");

    // With other numbers it would be another map.
    let other = [&build[..], &["--keep-appearances", "none"]].concat();
    fixture.fails(
        &other,
        &["street.map.part", "another dataset or with other numbers"],
    );

    let finished = fixture.run(&build);
    assert_eq!(finished.code, 0, "{finished:?}");
    assert!(
        finished
            .stderr
            .contains(&format!("going on: {kept} of {num_visits} visits")),
        "{finished:?}"
    );
    let learnt = format!("{num_visits} visits ({} learnt now)", num_visits - kept);
    assert!(finished.stdout.contains(&learnt), "{finished:?}");
    assert!(!part.exists());
    assert_eq!(fixture.run(&["map", "verify", "street.map"]).code, 0);
}

#[test]
fn the_reference_preset_commits_once_at_the_end() {
    let fixture = Fixture::new();
    let build = [
        "map",
        "build",
        "--data",
        "data",
        "--out",
        "street.map",
        "--preset",
        "lttl",
    ];
    let built = fixture.run(&build);
    assert_eq!(built.code, 0, "{built:?}");
    assert!(
        built.stdout.contains("24 visits (24 learnt now)"),
        "{built:?}"
    );
    let map = Map::open_read_only(fixture.path("street.map")).expect("built");
    assert_eq!(map.snapshot().meta.preset, "lttl");
    assert_eq!(map.generations().expect("readable").len(), 2);
    // The map says by which numbers it is asked.
    let asked = fixture.run(&["localize", "street.map", "--print-config"]);
    let preset = fixture.run(&["map", "build", "--print-config", "--preset", "lttl"]);
    assert_eq!(asked.stdout, preset.stdout);
    fixture.write("query0.png", png(0, query_time(), 9));
    let located = fixture.run(&[
        "localize",
        "street.map",
        "query0.png",
        "--time",
        QUERY_TIME,
        "--json",
    ]);
    assert_eq!(located.lines()[0]["place"], "place-00", "{located:?}");
}

#[test]
fn an_interrupted_reference_build_leaves_nothing_half_done() {
    let held = HeldBuild::start(&[
        "map",
        "build",
        "--data",
        "data",
        "--out",
        "street.map",
        "--preset",
        "lttl",
    ]);
    let part = held.fixture.path("street.map.part");
    assert!(part.exists());
    let (fixture, _, stopped) = held.interrupt();
    assert_eq!(stopped.code, 130, "{stopped:?}");
    assert!(stopped.stderr.contains("nothing is kept"), "{stopped:?}");
    assert!(!part.exists() && !fixture.path("street.map").exists());
}

#[test]
fn a_disk_that_is_full_is_an_error() {
    let fixture = Fixture::with_map();
    if Path::new("/dev/full").exists() {
        fixture.fails(
            &[
                "localize",
                "street.map",
                "query0.png",
                "--time",
                QUERY_TIME,
                "--trace",
                "/dev/full",
            ],
            &["/dev/full", "No space left"],
        );
    }
    // A small disk takes the right to mount one, in a namespace of our own.
    let script = "mount -t tmpfs -o size=64k none small && exec \"$0\" map build --data data --out small/street.map";
    fs::create_dir(fixture.path("small")).expect("writable");
    let ran = Command::new("unshare")
        .args(["-rm", "sh", "-c", script, env!("CARGO_BIN_EXE_chronotope")])
        .current_dir(fixture.dir.path())
        .output();
    match ran.map(Ran::from) {
        Ok(ran) if !ran.stderr.contains("unshare") && !ran.stderr.contains("mount:") => {
            assert_eq!(ran.code, 2, "{ran:?}");
            assert!(ran.stderr.contains("the disk is full"), "{ran:?}");
        }
        other => eprintln!("not tested with a small disk: no right to mount one ({other:?})"),
    }
}

#[test]
fn a_folder_that_may_not_be_written_is_an_error() {
    let fixture = Fixture::new();
    let folder = fixture.path("locked");
    fs::create_dir(&folder).expect("writable");
    let mut rights = fs::metadata(&folder).expect("there").permissions();
    rights.set_readonly(true);
    fs::set_permissions(&folder, rights).expect("ours");
    if fs::write(folder.join("probe"), "").is_ok() {
        eprintln!("not tested: this user may write everywhere");
        return;
    }
    fixture.fails(
        &[
            "map",
            "build",
            "--data",
            "data",
            "--out",
            "locked/street.map",
        ],
        &["locked/street.map", "may be written"],
    );
}

#[cfg(not(feature = "opencv"))]
#[test]
fn cameras_and_videos_name_the_feature_they_need() {
    let fixture = Fixture::with_map();
    fixture.fails(
        &["localize", "street.map", "--camera", "0"],
        &["camera 0", "--features opencv"],
    );
    fixture.fails(
        &["localize", "street.map", "walk.mp4", "--time", QUERY_TIME],
        &["walk.mp4", "--features opencv"],
    );
}

#[test]
fn a_kernel_that_is_none_is_reported() {
    let fixture = Fixture::new();
    let mut command = fixture.command(&["dataset", "check", "data"]);
    let ran = Ran::from(
        command
            .env("CHRONOTOPE_KERNEL", "abacus")
            .output()
            .expect("it starts"),
    );
    assert_eq!(ran.code, 2, "{ran:?}");
    assert!(
        ran.stderr.contains("CHRONOTOPE_KERNEL") && ran.stderr.contains("abacus"),
        "{ran:?}"
    );
}

#[test]
fn methods_that_need_what_was_not_kept_say_so() {
    let fixture = Fixture::new();
    let build = [
        "map",
        "build",
        "--data",
        "data",
        "--out",
        "bare.map",
        "--keep-appearances",
        "none",
    ];
    assert_eq!(fixture.run(&build).code, 0);
    fixture.fails(
        &[
            "localize",
            "bare.map",
            "data/images/00.png",
            "--method",
            "experience",
        ],
        &["bare.map", "kept no appearances"],
    );
    fixture.fails(
        &[
            "localize",
            "bare.map",
            "data/images/00.png",
            "--method",
            "psychic",
        ],
        &["psychic", "fremen"],
    );
}

#[test]
fn a_map_is_rolled_back_and_pruned() {
    let fixture = Fixture::with_map();
    let numbers = |ran: &Ran| -> Vec<u64> {
        let number = |line: &Value| line["number"].as_u64().expect("a number");
        ran.lines().iter().map(number).collect()
    };
    let logged = fixture.run(&["map", "log", "street.map", "--json"]);
    assert_eq!(logged.code, 0, "{logged:?}");
    let before = numbers(&logged);
    let newest = before.last().copied().expect("some");
    let visits: i64 = (logged.lines().iter())
        .map(|line| line["added_visits"].as_i64().expect("a number"))
        .sum();
    assert_eq!(visits, (NUM_VISITS as usize * NUM_PLACES) as i64);
    let digest = |fixture: &Fixture| {
        fixture
            .run(&["map", "inspect", "street.map", "--json"])
            .lines()[0]["digest"]
            .clone()
    };
    let whole = digest(&fixture);
    let back = fixture.run(&["map", "rollback", "street.map", "--to", "0"]);
    assert_eq!(back.code, 0, "{back:?}");
    assert!(back.stdout.contains("0 places"), "{back:?}");
    assert_ne!(digest(&fixture), whole);
    let shown = fixture.run(&["map", "log", "street.map"]);
    assert!(shown.stdout.contains("back to generation 0"), "{shown:?}");
    assert!(shown.stdout.contains("(rolled back)"), "{shown:?}");
    let to = newest.to_string();
    let forward = fixture.run(&["map", "rollback", "street.map", "--to", &to]);
    assert_eq!(forward.code, 0, "{forward:?}");
    assert_eq!(digest(&fixture), whole);
    let kept = fixture.run(&[
        "map",
        "prune",
        "street.map",
        "--keep-last",
        "1",
        "--dry-run",
    ]);
    assert_eq!(kept.code, 0, "{kept:?}");
    assert!(kept.stdout.contains("may go"), "{kept:?}");
    let pruned = fixture.run(&["map", "prune", "street.map", "--keep-last", "1"]);
    assert_eq!(pruned.code, 0, "{pruned:?}");
    let left = numbers(&fixture.run(&["map", "log", "street.map", "--json"]));
    assert_eq!(left, [0, newest + 2]);
    assert_eq!(digest(&fixture), whole);
    fixture.fails(
        &["map", "rollback", "street.map", "--to", "999"],
        &["street.map", "no generation 999", "map log"],
    );
    fixture.fails(&["map", "prune", "street.map"], &["--keep-last"]);
}

/// The dataset without the images of visits from `visit` on.
fn shorten(fixture: &Fixture, visit: i64) -> String {
    let whole = fixture.index();
    let short: String = (whole.lines())
        .take(1 + visit as usize * NUM_PLACES)
        .flat_map(|line| [line, "\n"])
        .collect();
    fixture.write("data/index.csv", short);
    whole
}

#[test]
fn an_update_ends_where_a_build_of_everything_does() {
    for preset in ["default", "lttl"] {
        let fixture = Fixture::new();
        let build = |out: &str| {
            let args = [
                "map", "build", "--data", "data", "--out", out, "--preset", preset,
            ];
            let built = fixture.run(&args);
            assert_eq!(built.code, 0, "{built:?}");
        };
        let whole_index = shorten(&fixture, 4);
        build("grown.map");
        fixture.write("data/index.csv", whole_index);
        build("whole.map");
        let update = || fixture.run(&["map", "update", "grown.map", "--data", "data"]);
        let updated = update();
        assert_eq!(updated.code, 0, "{updated:?}");
        assert!(updated.stdout.contains("(8 learnt now)"), "{updated:?}");
        assert!(updated.stderr.contains("16 of 24 visits"), "{updated:?}");
        let open = |name| Map::open(fixture.path(name)).expect("a map").snapshot();
        let (grown, whole) = (open("grown.map"), open("whole.map"));
        assert_eq!(grown.nodes, whole.nodes, "{preset}");
        assert_eq!(grown.edges, whole.edges);
        // Nothing is left to learn.
        let again = update();
        assert_eq!(again.code, 0, "{again:?}");
        assert!(again.stdout.contains("(0 learnt now)"), "{again:?}");
        assert_eq!(open("grown.map").generation, grown.generation);
        let back = fixture.run(&["map", "rollback", "grown.map", "--to", "1"]);
        assert_eq!(back.code, 0, "{back:?}");
        assert!(open("grown.map").summary().num_visits <= 16);
        assert!(fixture.run(&["map", "verify", "grown.map"]).code == 0);
    }
}

/// `CHRONOTOPE_TEST_KILLS` makes it longer.
#[test]
fn a_killed_update_loses_nothing_it_acknowledged() {
    let fixture = Fixture::new();
    fixture.write("numbers.toml", "[learn.guard]\njudge = \"never\"\n");
    let build = |out: &str| {
        let args = ["map", "build", "--data", "data", "--out", out];
        let built = fixture.run(&[&args[..], &["--config", "numbers.toml"]].concat());
        assert_eq!(built.code, 0, "{built:?}");
    };
    let mut index = String::from("place,time,path\n");
    // In order of time, so that the first rows are learnt first.
    for (first, day) in (0..NUM_VISITS).flat_map(|first| (0..4).map(move |day| (first, day))) {
        for (place, time, name, _) in &images()[first as usize * NUM_PLACES..][..NUM_PLACES] {
            let time = time.plus_us(day * Period::DAY.as_us());
            writeln!(index, "place-{place:02},{time},{name}").expect("memory");
        }
    }
    fixture.write("data/index.csv", &index);
    build("whole.map");
    let first: Vec<&str> = index.lines().take(1 + 2 * NUM_PLACES).collect();
    fixture.write("data/index.csv", first.join("\n"));
    build("first.map");
    fixture.write("data/index.csv", &index);
    let (path, start) = (fixture.path("grown.map"), fixture.path("first.map"));
    let whole = Map::open(fixture.path("whole.map"))
        .expect("a map")
        .snapshot();
    let update = ["-v", "map", "update", "grown.map", "--data", "data"];
    let update = [
        &update[..],
        &["--commit-every", "0", "--config", "numbers.toml"],
    ]
    .concat();
    let (mut num_visits, mut num_finished, mut num_seen) = (0, 0, 0);
    for round in 0..num_kills(8) {
        if !path.exists() {
            fs::copy(&start, &path).expect("writable");
            num_visits = 0;
        }
        let mut process = fixture
            .command(&update)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the command starts");
        let stderr = process.stderr.take().expect("piped");
        let mut said = (BufReader::new(stderr).lines().map_while(Result::ok)).filter_map(|line| {
            let generation = line.split_once("generation=")?.1;
            generation.split(' ').next()?.parse::<u64>().ok()
        });
        // Some are killed before their first commit, others after up to three.
        let heard = said.by_ref().take(round as usize % 4).last();
        std::thread::sleep(Duration::from_micros(round * 7_919 % 30_000));
        process.kill().expect("ours");
        let acknowledged = said.last().or(heard).unwrap_or_default();
        let is_finished = process.wait().expect("ours").success();
        num_seen += u64::from(acknowledged > 0);
        let found = Map::open(&path).expect("sound").snapshot();
        assert!(
            found.generation >= acknowledged,
            "{acknowledged} was acknowledged"
        );
        let report = Map::verify(&path).expect("a map");
        assert!(report.is_clean(), "{:?}", report.faults);
        let now = found.summary().num_visits;
        assert!(
            now >= num_visits.max(2 * NUM_PLACES),
            "{now} of {num_visits}"
        );
        num_visits = now;
        if is_finished {
            assert_eq!(found.nodes, whole.nodes);
            fs::remove_file(&path).expect("ours");
            num_finished += 1;
        }
    }
    println!(
        "{num_finished} updates were finished, {num_seen} had committed when they were killed"
    );
    if !path.exists() {
        fs::copy(&start, &path).expect("writable");
    }
    let finished = fixture.run(&update[1..]);
    assert_eq!(finished.code, 0, "{finished:?}");
    let grown = Map::open(&path).expect("sound").snapshot();
    assert_eq!(grown.nodes, whole.nodes);
}

#[test]
fn an_update_of_what_is_no_map_or_has_other_images_changes_nothing() {
    let fixture = Fixture::with_map();
    fixture.fails(
        &["map", "update", "missing.map", "--data", "data"],
        &["missing.map", "map build"],
    );
    fixture.fails(&["map", "update", "data", "--data", "data"], &["folder"]);
    // Images of another size are problems, one by one.
    let before = fs::read(fixture.path("street.map")).expect("there");
    fs::create_dir_all(fixture.path("other")).expect("writable");
    let small = encoded(&image::GrayImage::new(64, 48));
    fixture.write("other/a.png", small);
    fixture.write(
        "other/index.csv",
        "place,time,path\nplace-00,2024-01-01T00:00:00Z,a.png\n",
    );
    let ran = fixture.run(&["map", "update", "street.map", "--data", "other"]);
    assert_eq!(ran.code, 0, "{ran:?}");
    assert!(ran.stderr.contains("1 problem"), "{ran:?}");
    assert!(ran.stderr.contains("64 x 48 px"), "{ran:?}");
    assert_eq!(fs::read(fixture.path("street.map")).expect("there"), before);
}

#[test]
fn maps_of_two_halves_merge_into_one() {
    let fixture = Fixture::new();
    let whole_index = fixture.index();
    let (head, visits) = whole_index.split_once('\n').expect("a header");
    let visits: Vec<&str> = visits.lines().collect();
    for (name, rows) in [("early", 0..16), ("late", 8..24)] {
        let index: String = std::iter::once(&head)
            .chain(&visits[rows])
            .flat_map(|line| [*line, "\n"])
            .collect();
        fixture.write("data/index.csv", index);
        let out = format!("{name}.map");
        let built = fixture.run(&["map", "build", "--data", "data", "--out", &out]);
        assert_eq!(built.code, 0, "{built:?}");
    }
    let merged = fixture.run(&["map", "merge", "early.map", "late.map", "--out", "ab.map"]);
    assert_eq!(merged.code, 0, "{merged:?}");
    assert!(
        merged.stdout.contains("24 visits (8 were in more"),
        "{merged:?}"
    );
    let merged = fixture.run(&["map", "merge", "late.map", "early.map", "--out", "ba.map"]);
    assert_eq!(merged.code, 0, "{merged:?}");
    let open = |name| Map::open(fixture.path(name)).expect("a map").snapshot();
    assert_eq!(open("ab.map").digest(), open("ba.map").digest());
    assert!(fixture.run(&["map", "verify", "ab.map"]).code == 0);
    assert!(!fixture.path("ab.map.part").exists());
    let again = ["map", "merge", "early.map", "late.map", "--out", "ab.map"];
    fixture.fails(&again, &["ab.map", "never overwritten"]);
    fixture.fails(
        &[
            "map",
            "merge",
            "early.map",
            "late.map",
            "--out",
            "c.map",
            "--relearn",
        ],
        &["--keep-appearances all"],
    );
}

#[test]
fn a_map_goes_out_as_plain_files_and_comes_back() {
    let fixture = Fixture::with_map();
    let exported = fixture.run(&["map", "export", "street.map", "street"]);
    assert_eq!(exported.code, 0, "{exported:?}");
    let imported = fixture.run(&["map", "import", "street", "--out", "again.map"]);
    assert_eq!(imported.code, 0, "{imported:?}");
    let open = |name| Map::open(fixture.path(name)).expect("a map").snapshot();
    assert_eq!(open("again.map").digest(), open("street.map").digest());
    let to = ["map", "export", "street.map", "street"];
    fixture.fails(&to, &["street", "not empty"]);
    let to = ["map", "import", "street", "--out", "again.map"];
    fixture.fails(&to, &["again.map", "never overwritten"]);
    // Two maps that say the same become the same files.
    for (map, folder) in [("street.map", "a"), ("again.map", "b")] {
        let exported = fixture.run(&["map", "export", map, folder, "--canonical"]);
        assert_eq!(exported.code, 0, "{exported:?}");
    }
    for name in ["visits.csv", "keypoints.npy", "seen.npy"] {
        let read = |folder: &str| fs::read(fixture.path(folder).join(name)).expect("written");
        assert_eq!(read("a"), read("b"), "{name}");
    }
}

#[test]
fn places_of_the_reference_benchmark_become_a_map() {
    let fixture = Fixture::new();
    let yaml = include_str!("../../../../tests/data/file_storage/place_0.yaml");
    fixture.write("place_0.yaml", yaml);
    fixture.write("place_1.yaml", yaml.replace("[ 1, 0, 1", "[ 0, 0, 1"));
    let args = [
        "map",
        "import",
        "place_0.yaml",
        "place_1.yaml",
        "--out",
        "park.map",
    ];
    let imported = fixture.run(&args);
    assert_eq!(imported.code, 0, "{imported:?}");
    assert!(
        imported.stdout.contains("2 places, 8 visits, 6 features"),
        "{imported:?}"
    );
    let predicted = fixture.run(&[
        "predict",
        "park.map",
        "--time",
        "1970-01-01T00:30:00Z",
        "--node",
        "place_1",
    ]);
    assert_eq!(predicted.code, 0, "{predicted:?}");
    fixture.write("odd.yaml", yaml.replace("cols: 32", "cols: 31"));
    let args = ["map", "import", "odd.yaml", "--out", "odd.map"];
    fixture.fails(&args, &["odd.yaml", "line "]);
    assert!(!fixture.path("odd.map").exists());
}

#[test]
fn what_is_located_is_learnt_only_if_that_is_asked_for() {
    let fixture = Fixture::with_map();
    let visits = || {
        let map = Map::open(fixture.path("street.map")).expect("a map");
        map.snapshot().summary().num_visits
    };
    let (before, num_before) = (
        fs::read(fixture.path("street.map")).expect("there"),
        visits(),
    );
    let log = fixture.run(&["map", "log", "street.map", "--json"]);
    let to = log.lines().last().expect("some")["number"].to_string();
    let localize = |more: &[&str]| {
        let images = ["query0.png", "query1.png", "query2.png", "query3.png"];
        let args = [
            &["localize", "street.map", "--time", QUERY_TIME],
            &images[..],
            more,
        ]
        .concat();
        let ran = fixture.run(&args);
        assert_eq!(ran.code, 0, "{ran:?}");
        ran
    };
    localize(&[]);
    assert_eq!(fs::read(fixture.path("street.map")).expect("there"), before);
    let ran = localize(&["--learn"]);
    assert!(ran.stderr.contains("learnt: 4 visits"), "{ran:?}");
    assert_eq!(visits(), num_before + 4);
    // The same images are the same visits.
    let ran = localize(&["--learn"]);
    assert!(ran.stderr.contains("learnt this visit"), "{ran:?}");
    assert!(ran.stderr.contains("learnt: 0 visits"), "{ran:?}");
    assert_eq!(visits(), num_before + 4);
    let back = fixture.run(&["map", "rollback", "street.map", "--to", &to]);
    assert_eq!(back.code, 0, "{back:?}");
    assert_eq!(visits(), num_before);
    assert!(fixture.run(&["map", "verify", "street.map"]).code == 0);
}

#[test]
fn doubtful_visits_are_held_until_they_are_accepted_or_dropped() {
    let fixture = Fixture::with_map();
    let later = query_time().plus_us(Period::DAY.as_us());
    let index = format!(
        "place,time,path\nplace-00,{},black.png\nplace-00,{later},other.png\nplace-01,{later},own.png\n",
        query_time()
    );
    fs::create_dir(fixture.path("odd")).expect("writable");
    fixture.write("odd/index.csv", index);
    let black = image::GrayImage::from_pixel(320, 240, image::Luma([3]));
    fixture.write("odd/black.png", encoded(&black));
    fixture.write("odd/other.png", png(1, later, 7));
    fixture.write("odd/own.png", png(1, later, 7));
    let update = || fixture.run(&["map", "update", "street.map", "--data", "odd"]);
    let updated = update();
    assert_eq!(updated.code, 0, "{updated:?}");
    assert!(updated.stdout.contains("(1 learnt now)"), "{updated:?}");
    for expected in [
        "the image is black",
        "it looks like place `place-01`",
        "2 visits are held",
    ] {
        assert!(updated.stderr.contains(expected), "{expected}: {updated:?}");
    }
    assert!(update().stdout.contains("(0 learnt now)"));

    let held = || {
        fixture
            .run(&["map", "held", "street.map", "--json"])
            .lines()
    };
    let listed = held();
    assert_eq!(listed.len(), 2);
    assert_eq!(listed[0]["doubt"]["kind"], "blind");
    assert_eq!(listed[0]["doubt"]["gray-range"][1], 3);
    assert_eq!(listed[1]["doubt"]["kind"], "disagreement");
    let id = |visit: &Value| visit["visit"].as_str().expect("a text")[..9].to_owned();
    let dropped = fixture.run(&["map", "drop", "street.map", &id(&listed[0])]);
    assert_eq!(dropped.code, 0, "{dropped:?}");
    let accepted = fixture.run(&["map", "accept", "street.map", &id(&listed[1])]);
    assert_eq!(accepted.code, 0, "{accepted:?}");
    assert!(held().is_empty());
    fixture.fails(
        &["map", "accept", "street.map", &id(&listed[1])],
        &["no visit that is held"],
    );
    assert_eq!(fixture.run(&["map", "verify", "street.map"]).code, 0);

    let num_visits = || {
        let map = Map::open_read_only(fixture.path("street.map")).expect("a map");
        map.snapshot().summary().num_visits
    };
    assert_eq!(num_visits(), 26);
    let forgotten = fixture.run(&["map", "forget", "street.map", "--session", "odd"]);
    assert!(
        forgotten.stdout.contains("2 visits forgotten"),
        "{forgotten:?}"
    );
    assert_eq!(num_visits(), 24);
    fixture.fails(
        &["map", "forget", "street.map", "--session", "odd"],
        &["no visits of session"],
    );
    assert_eq!(fixture.run(&["map", "verify", "street.map"]).code, 0);
}

#[test]
fn edges_are_listed_added_and_removed() {
    let fixture = Fixture::with_map();
    let edges = || {
        fixture
            .run(&["map", "edge", "street.map", "list", "--json"])
            .lines()
    };
    assert_eq!(edges().len(), 2);
    let add = [
        "map",
        "edge",
        "street.map",
        "add",
        "place-02",
        "place-03",
        "--name",
        "alley",
    ];
    assert_eq!(fixture.run(&add).code, 0);
    // What is there already changes nothing.
    assert_eq!(fixture.run(&add).code, 0);
    assert_eq!(edges().len(), 3);
    assert_eq!(edges()[2]["name"], "alley");
    let remove = [
        "map",
        "edge",
        "street.map",
        "remove",
        "place-00",
        "place-01",
    ];
    fixture.fails(
        &[&remove[..], &["--name", "lane"]].concat(),
        &["no such edge"],
    );
    assert_eq!(fixture.run(&remove).code, 0);
    assert_eq!(edges().len(), 2);
    fixture.fails(&remove, &["no such edge"]);
    fixture.fails(
        &["map", "edge", "street.map", "add", "place-00", "nowhere"],
        &["`nowhere`"],
    );
    assert_eq!(fixture.run(&["map", "verify", "street.map"]).code, 0);
}

#[test]
fn a_map_is_calibrated_once_and_answers_as_before() {
    let fixture = Fixture::with_map();
    let ask = ["localize", "street.map", "query1.png", "--time", QUERY_TIME];
    let before = fixture.run(&ask);
    let first = fixture.run(&["map", "calibrate", "street.map"]);
    assert_eq!(first.code, 0, "{first:?}");
    assert!(first.stdout.contains("past images"), "{first:?}");
    let again = fixture.run(&["map", "calibrate", "street.map"]);
    assert!(again.stdout.contains("calibrated already"), "{again:?}");
    assert_eq!(fixture.run(&ask).stdout, before.stdout);
    fixture.write(
        "count.toml",
        "[localize]\nscore = \"count\"\ncalibrated = false\n",
    );
    fixture.fails(
        &["map", "calibrate", "street.map", "--config", "count.toml"],
        &["street.map", "calibrated = true"],
    );
}

/// Everything beside the map that is kept to open it faster.
fn query_forms(fixture: &Fixture) -> Vec<PathBuf> {
    let entries = fs::read_dir(fixture.path("")).expect("a folder");
    let mut found: Vec<PathBuf> = (entries.map(|entry| entry.expect("an entry").path()))
        .filter(|path| path.extension().is_some_and(|it| it == "query"))
        .collect();
    found.sort();
    found
}

#[test]
fn a_query_form_changes_no_answer() {
    let fixture = Fixture::with_map();
    let ask = |form: &str, more: &[&str]| {
        let images = ["query0.png", "query1.png", "query2.png", "query3.png"];
        let args = [
            &["localize", "street.map", "--json", "--time", QUERY_TIME][..],
            &["--query-form", form],
            &images[..],
            more,
        ]
        .concat();
        let ran = fixture.run(&args);
        assert_eq!(ran.code, 0, "{ran:?}");
        ran
    };
    // Everything but how long it took.
    let evidence = || -> Vec<Value> {
        let text = fs::read_to_string(fixture.path("trace.jsonl")).expect("written");
        let mut lines: Vec<Value> = (text.lines())
            .map(|line| serde_json::from_str(line).expect("JSON"))
            .collect();
        for line in &mut lines {
            let line = line.as_object_mut().expect("an object");
            assert!(line.remove("duration_ms").is_some() && line.remove("stages").is_some());
        }
        lines
    };
    for (index, more) in [
        &["--method", "fremen", "--track"][..],
        &["--method", "static", "--trace", "trace.jsonl"],
        &["--trace", "trace.jsonl", "--n", "20"],
        &["--method", "experience-all", "--trace", "trace.jsonl"],
    ]
    .into_iter()
    .enumerate()
    {
        let without = ask("never", more).stdout;
        let traced = (index > 0).then(evidence);
        assert_eq!(query_forms(&fixture).len(), index, "{more:?}");
        assert_eq!(ask("always", more).stdout, without, "{more:?}");
        assert_eq!(query_forms(&fixture).len(), index + 1, "{more:?}");
        let again = ask("auto", &[more, &["-v"]].concat());
        assert!(
            again.stderr.contains("opened by the query form"),
            "{again:?}"
        );
        assert_eq!(again.stdout, without, "{more:?}");
        assert_eq!((index > 0).then(evidence), traced, "{more:?}");
    }
}

#[test]
fn a_query_form_that_does_not_fit_is_made_anew_and_one_that_cannot_be_kept_is_none() {
    let fixture = Fixture::with_map();
    let ask = |form: &str| {
        let ran = fixture.run(&[
            "localize",
            "street.map",
            "query1.png",
            "--time",
            QUERY_TIME,
            "--json",
            "--query-form",
            form,
        ]);
        assert_eq!(ran.code, 0, "{ran:?}");
        ran.stdout
    };
    let expected = ask("always");
    let [file] = &query_forms(&fixture)[..] else {
        panic!("one query form");
    };
    let whole = fs::read(file).expect("kept");
    let mut damaged = whole.clone();
    damaged[whole.len() / 2] ^= 4;
    fs::write(file, damaged).expect("writable");
    assert_eq!(ask("always"), expected);
    assert_eq!(fs::read(file).expect("kept"), whole);

    let learn = ["localize", "street.map", "query0.png", "--time", QUERY_TIME];
    let learnt = fixture.run(&[&learn[..], &["--learn"]].concat());
    assert_eq!(learnt.code, 0, "{learnt:?}");
    let newer = ask("never");
    assert_eq!(ask("always"), newer);
    let [newest] = &query_forms(&fixture)[..] else {
        panic!("that of the generation before is gone");
    };
    assert_ne!(newest, file);

    // A folder in its place can be neither read nor replaced; rights would not stop the superuser.
    fs::remove_file(newest).expect("removed");
    fs::create_dir(newest).expect("made");
    assert_eq!(ask("always"), newer);
    assert!(newest.is_dir());
}

/// Rounds of a test that kills processes: `CHRONOTOPE_TEST_KILLS`, or as many as usual.
fn num_kills(usual: u64) -> u64 {
    std::env::var("CHRONOTOPE_TEST_KILLS").map_or(usual, |number| number.parse().expect("a number"))
}
