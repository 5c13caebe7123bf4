//! No command waits for a pipe, takes more memory than is stated, or outlives SIGTERM.
#![cfg(unix)]

use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::fixture::{Fixture, QUERY_TIME, Ran, encoded};

/// How long a command may take that has nothing to do, on a busy machine.
const PATIENCE: Duration = Duration::from_secs(20);

fn pipe(fixture: &Fixture, name: &str) {
    let made = Command::new("mkfifo").arg(fixture.path(name)).status();
    assert!(made.expect("mkfifo").success());
}

/// Runs a command that must end by itself.
fn ends(fixture: &Fixture, line: &str) -> Ran {
    let mut child = (fixture.command(line).stdin(Stdio::null()))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the command starts");
    let begun = Instant::now();
    while child.try_wait().expect("a child").is_none() {
        if begun.elapsed() > PATIENCE {
            child.kill().expect("a child");
            panic!("{line} waits for ever");
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    Ran::from(child.wait_with_output().expect("a child"))
}

#[test]
fn no_command_waits_for_a_pipe_or_a_device() {
    let fixture = Fixture::with_map();
    pipe(&fixture, "pipe");
    for (name, suffix) in [
        ("pipe.toml", "toml"),
        ("pipe.yaml", "yaml"),
        ("pipe.png", "png"),
    ] {
        pipe(&fixture, name);
        assert!(name.ends_with(suffix));
    }
    for folder in ["index", "manifest"] {
        fs::create_dir(fixture.path(folder)).expect("writable");
    }
    pipe(&fixture, "index/index.csv");
    pipe(&fixture, "manifest/dataset.toml");
    fixture.succeeds("map export street.map out");
    fs::remove_file(fixture.path("out/places.csv")).expect("exported");
    pipe(&fixture, "out/places.csv");
    let at = format!("--time {QUERY_TIME}");
    for line in [
        format!("localize street.map pipe {at}"),
        "localize street.map pipe.png".to_owned(),
        "localize street.map /dev/zero --method static".to_owned(),
        format!("localize street.map query0.png {at} --mask pipe"),
        format!("localize street.map query0.png {at} --config pipe.toml"),
        format!("localize street.map query0.png {at} --manifest pipe.toml"),
        format!("localize pipe query0.png {at}"),
        "map build --data data --out new.map --config pipe.toml".to_owned(),
        "map build --data pipe.toml --out new.map".to_owned(),
        "map build --data index --out new.map".to_owned(),
        "map build --data manifest --out new.map".to_owned(),
        "map update pipe --data data".to_owned(),
        "map import pipe.yaml --out new.map".to_owned(),
        "map import out --out new.map".to_owned(),
        "map merge street.map pipe --out new.map".to_owned(),
        "map inspect pipe".to_owned(),
        "spectrum pipe".to_owned(),
        "dataset check pipe.toml".to_owned(),
        "dataset index pipe --from folders".to_owned(),
    ] {
        let ran = ends(&fixture, &line);
        assert_eq!(ran.code, 2, "{line}: {ran:?}");
        assert!(ran.stderr.contains("error: "), "{line}: {ran:?}");
    }
    // An image that an index lists is left out, and the others are learnt.
    let index = fixture.index() + "place-00,2023-12-15T12:00:00Z,pipe.png\n";
    fixture.write("data/index.csv", index);
    pipe(&fixture, "data/pipe.png");
    for line in [
        "dataset check data",
        "map build --data data --out new.map",
        "map update street.map --data data",
    ] {
        let ran = ends(&fixture, line);
        assert_eq!(ran.code, 1, "{line}: {ran:?}");
        let said = format!("{}{}", ran.stdout, ran.stderr);
        assert!(said.contains("is a pipe or a device"), "{line}: {ran:?}");
    }
    // Edges and poses that cannot be read are not the same as none.
    for name in [
        "data/edges.csv",
        "data/poses.csv",
        "data/SHA256SUMS",
        "data/dataset.toml",
    ] {
        // Two of them are there.
        let _ = fs::remove_file(fixture.path(name));
        pipe(&fixture, name);
        let ran = ends(&fixture, "dataset check data");
        assert_eq!(ran.code, 2, "{name}: {ran:?}");
        ran.notes(&[name, "is a pipe or a device"]);
        fs::remove_file(fixture.path(name)).expect("ours");
    }
}

/// A PNG whose pixels are packed a thousandfold.
fn huge_png(width: u32, height: u32) -> Vec<u8> {
    encoded(&image::GrayImage::new(width, height))
}

/// A PGM with features to look for everywhere.
fn noise(width: u32, height: u32) -> Vec<u8> {
    let mut state = 1_u32;
    let noise = image::GrayImage::from_fn(width, height, |_, _| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        image::Luma([(state >> 24) as u8])
    });
    let mut bytes = std::io::Cursor::new(Vec::new());
    noise
        .write_to(&mut bytes, image::ImageFormat::Pnm)
        .expect("memory");
    bytes.into_inner()
}

/// A chunk of a PNG.
fn chunk(kind: [u8; 4], body: &[u8]) -> Vec<u8> {
    let mut sum = flate2::Crc::new();
    sum.update(&kind);
    sum.update(body);
    let len = (body.len() as u32).to_be_bytes();
    [&len[..], &kind, body, &sum.sum().to_be_bytes()].concat()
}

/// The picture with texts that unpack to 400 MB, and a profile that does.
fn with_packed_texts(png: &[u8]) -> Vec<u8> {
    use std::io::Write as _;
    let mut packed = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
    for _ in 0..100 {
        packed.write_all(&vec![b'a'; 1 << 20]).expect("memory");
    }
    let packed = packed.finish().expect("memory");
    let head = 8 + 12 + 13;
    let mut bytes = png[..head].to_vec();
    bytes.extend(chunk(*b"iCCP", &[b"profile\0\0", &packed[..]].concat()));
    for number in 0..4 {
        let keyword = format!("Comment{number}\0\0");
        bytes.extend(chunk(*b"zTXt", &[keyword.as_bytes(), &packed].concat()));
    }
    bytes.extend(chunk(
        *b"iTXt",
        &[b"XML:com.adobe.xmp\0\x01\0\0\0", &packed[..]].concat(),
    ));
    bytes.extend(&png[head..]);
    bytes
}

/// The command with at most so many bytes of memory of its own, on one thread: libraries that it is
/// linked with, such as those of a camera, are not counted.
fn limited(fixture: &Fixture, line: &str, max_bytes: u64) -> Ran {
    let command = env!("CARGO_BIN_EXE_chronotope");
    let script = format!("ulimit -d {}; exec {command} {line}", max_bytes >> 10);
    let output = (Command::new("sh").args(["-c", &script]))
        .current_dir(fixture.dir.path())
        .env("RAYON_NUM_THREADS", "1")
        // Each arena of the allocator reserves addresses that are never used.
        .env("MALLOC_ARENA_MAX", "1")
        .output();
    Ran::from(output.expect("a shell"))
}

/// What every command keeps to that reads single files of up to 64 MB, and the program itself.
const MAX_BYTES: u64 = 600_000_000;

/// What the program and its libraries bring along.
const PROGRAM_BYTES: u64 = 100_000_000;

#[test]
#[cfg(target_os = "linux")]
fn single_files_take_at_most_600_mb() {
    let fixture = Fixture::with_map();
    fixture.write("wide.png", huge_png(30_000, 2_000));
    fixture.write("large.png", huge_png(6_000, 4_000));
    let plain = fs::read(fixture.path("query0.png")).expect("written");
    fixture.write("texts.png", with_packed_texts(&plain));
    fs::create_dir(fixture.path("huge")).expect("writable");
    for name in ["large.png", "wide.png"] {
        fs::copy(fixture.path(name), fixture.path("huge").join(name)).expect("writable");
    }
    fixture.write(
        "huge/index.csv",
        "place,time,path\na,2024-05-01T00:00:00Z,large.png\nb,2024-05-02T00:00:00Z,wide.png\n\
         c,2024-05-03T00:00:00Z,noise.pgm\n",
    );
    fixture.write("huge/noise.pgm", noise(6_000, 4_000));
    let at = format!("--time {QUERY_TIME}");
    let run = |line: &str| {
        let ran = limited(&fixture, line, MAX_BYTES + PROGRAM_BYTES);
        assert!((0..=2).contains(&ran.code), "{line}: {ran:?}");
        assert!(!ran.stderr.contains("memory allocation"), "{line}: {ran:?}");
        ran
    };
    let ran = run(&format!("localize street.map texts.png {at}"));
    assert_eq!(ran.code, 0, "the texts are nobody's business: {ran:?}");
    // Too large for the decoder, and of another size than the map's images.
    let ran = run(&format!("localize street.map wide.png {at}"));
    assert_eq!(ran.code, 2);
    run(&format!("localize street.map large.png {at}")).notes(&["6000 x 4000", "--scale"]);
    run(&format!(
        "localize street.map query0.png {at} --mask large.png"
    ))
    .notes(&["mask"]);
    // Decoded, and features looked for.
    run(&format!(
        "localize street.map large.png {at} --crop 0,0,320,240"
    ));
    let ran = run("dataset check huge");
    ran.prints(&["6000 x 4000"]);
    // One of them has nothing to see, one is too large.
    let ran = run("map build --data huge --out huge.map");
    assert_eq!(ran.code, 1, "{ran:?}");
    ran.prints(&["1 places"]);
    assert_eq!(run("map update street.map --data huge").code, 1);
}

#[test]
#[cfg(target_os = "linux")]
fn tables_take_at_most_600_mb() {
    let fixture = Fixture::with_map();
    let run = |line: &str| {
        let ran = limited(&fixture, line, MAX_BYTES + PROGRAM_BYTES);
        assert!((0..=2).contains(&ran.code), "{line}: {ran:?}");
        assert!(!ran.stderr.contains("memory allocation"), "{line}: {ran:?}");
        ran
    };
    // 60 MB of rows as short as they can be.
    fixture.write("short.csv", "0,1\n".repeat(15_000_000));
    run("spectrum short.csv").notes(&["more than 4000000 rows"]);
    fs::create_dir(fixture.path("rows")).expect("writable");
    let rows = "place,time,path\n".to_owned() + &"a,1,b\n".repeat(10_000_000);
    fixture.write("rows/index.csv", rows);
    run("dataset check rows").notes(&["more than 500000 rows"]);
    run("map build --data rows --out new.map").notes(&["more than 500000 rows"]);
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
    let zeros = vec![b'0'; 1 << 20];
    for _ in 0..1_000 {
        std::io::Write::write_all(&mut packed, &zeros).expect("memory");
    }
    fixture.write("bomb.csv.gz", packed.finish().expect("memory"));
    run("spectrum bomb.csv.gz").notes(&["bytes of content"]);
    // As configuration and manifest, as large as a file that is no text may seem.
    for name in ["large.toml", "large.yaml"] {
        let file = fs::File::create(fixture.path(name)).expect("writable");
        file.set_len(30 << 30).expect("a sparse file");
    }
    for line in [
        "map build --data data --out new.map --config large.toml",
        "map build --data large.toml --out new.map",
        "map import large.yaml --out new.map",
        "spectrum large.yaml",
        "localize street.map large.yaml --method static",
        "map inspect large.yaml",
    ] {
        assert_eq!(run(line).code, 2, "{line}");
    }
}

fn terminate(id: u32) {
    let sent = Command::new("sh")
        .args(["-c", &format!("kill -TERM {id}")])
        .status();
    assert!(sent.expect("a shell").success());
}

/// Sends SIGTERM once `is_ready`, and says how long the command still ran.
fn terminated(fixture: &Fixture, line: &str, is_ready: impl Fn(&Path) -> bool) -> Duration {
    let mut child = (fixture.command(line).env("RAYON_NUM_THREADS", "1"))
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("the command starts");
    let begun = Instant::now();
    while !is_ready(fixture.dir.path()) {
        assert!(begun.elapsed() < PATIENCE, "{line} does not begin");
        assert!(child.try_wait().expect("a child").is_none(), "{line} ended");
        std::thread::sleep(Duration::from_millis(10));
    }
    std::thread::sleep(Duration::from_millis(300));
    let sent = Instant::now();
    terminate(child.id());
    while child.try_wait().expect("a child").is_none() {
        if sent.elapsed() > PATIENCE {
            child.kill().expect("a child");
            panic!("{line} does not end");
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    sent.elapsed()
}

/// The bound, and what a busy machine adds.
const MOST: Duration = Duration::from_millis(2_000 + 700);

#[test]
fn sigterm_ends_a_command_that_waits_for_the_disk_and_nothing_is_lost() {
    let fixture = Fixture::with_map();
    let index = fixture.index();
    let first: Vec<&str> = index.lines().take(9).collect();
    fixture.write("data/index.csv", first.join("\n"));
    fixture.succeeds("map build --data data --out part.map");
    fixture.write("data/index.csv", &index);
    // A reader that does not let go: the commit waits.
    let reader = rusqlite::Connection::open(fixture.path("part.map")).expect("a map");
    reader
        .execute_batch("BEGIN; SELECT count(*) FROM visit;")
        .expect("sound");
    let took = terminated(
        &fixture,
        "map update part.map --data data --commit-every 0",
        |folder| folder.join("part.map-journal").exists(),
    );
    assert!(took < MOST, "{took:?}");
    reader.execute_batch("ROLLBACK").expect("sound");
    fixture.succeeds("map verify part.map");
    let ran = fixture.run("map update part.map --data data");
    assert!(ran.code < 2, "{ran:?}");
    assert_eq!(fixture.open("part.map").summary().num_visits, 24);
}

#[test]
fn sigterm_ends_a_command_in_the_middle_of_a_large_image() {
    let fixture = Fixture::with_map();
    // One image takes seconds.
    fs::create_dir(fixture.path("large")).expect("writable");
    let mut index = String::from("place,time,path\n");
    fixture.write("large/0.pgm", noise(6_000, 4_000));
    for number in 0..8 {
        writeln!(index, "p{number},2024-05-01T0{number}:00:00Z,{number}.pgm").expect("memory");
        if number > 0 {
            let name = format!("large/{number}.pgm");
            fs::hard_link(fixture.path("large/0.pgm"), fixture.path(name)).expect("writable");
        }
    }
    fixture.write("large/index.csv", index);
    let took = terminated(
        &fixture,
        "map build --data large --out large.map",
        |folder| folder.join("large.map.part").exists(),
    );
    assert!(took < MOST, "{took:?}");
    assert!(!fixture.path("large.map").exists());
}
