//! What files of real cameras and folders of real people did to the command, one kind a test.
//!
//! A test is named after the public report of the kind that it stands for.

use std::fmt::Write as _;
use std::fs;

use super::fixture::{Fixture, QUERY_TIME, encoded, images, plain, png, query_time};

/// The picture of a place in another format, or turned.
fn picture(place: usize) -> image::DynamicImage {
    image::load_from_memory(&png(place, query_time(), 9)).expect("a PNG")
}

#[test]
fn labelme_49_an_image_that_no_index_lists_is_not_taken_for_another() {
    let fixture = Fixture::with_map();
    fs::create_dir(fixture.path("new")).expect("writable");
    fixture.write("new/1.png", png(1, query_time(), 9));
    // 11.png is missing; its name holds that of the image.
    let rows = "place,time,path\nplace-00,2023-11-01T12:00:00Z,11.png\n\
                place-02,2023-11-01T12:00:00Z,10.png\n";
    fixture.write("new/index.csv", rows);
    fixture.write("new/10.png", png(2, query_time(), 9));
    let ran = fixture.succeeds(&format!(
        "localize street.map new/1.png --time {QUERY_TIME}"
    ));
    ran.prints(&["place-01", "(given)"]);
    fixture
        .succeeds("localize street.map new/10.png")
        .prints(&["place-02", "(from the index)"]);
}

#[cfg(unix)]
#[test]
fn yolov5_11115_a_linked_image_is_found_in_the_index_above_the_link() {
    use std::os::unix::fs::symlink;
    let fixture = Fixture::with_map();
    for folder in ["set", "store"] {
        fs::create_dir(fixture.path(folder)).expect("writable");
    }
    fixture.write("store/5f3a", png(3, query_time(), 9));
    symlink("../store/5f3a", fixture.path("set/a.png")).expect("links");
    symlink("set", fixture.path("same")).expect("links");
    let index = format!("place,time,path\nplace-03,{QUERY_TIME},a.png\n");
    fixture.write("set/index.csv", index);
    for path in ["set/a.png", "same/a.png", "same/../set/a.png"] {
        let ran = fixture.succeeds(&format!("localize street.map {path}"));
        ran.prints(&["place-03", "(from the index)"]);
    }
}

#[test]
fn clip_retrieval_321_the_index_that_was_named_wins_and_a_foreign_one_is_not_silent() {
    let fixture = Fixture::with_map();
    fs::create_dir_all(fixture.path("album/day")).expect("writable");
    fixture.write("album/day/a.png", png(0, query_time(), 9));
    let index = |time: &str, path: &str| format!("place,time,path\nplace-00,{time},{path}\n");
    fixture.write(
        "album/day/index.csv",
        index("2023-10-01T12:00:00Z", "a.png"),
    );
    fixture.write(
        "album/index.csv",
        index("2023-11-01T12:00:00Z", "day/a.png"),
    );
    let near = fixture.succeeds("localize street.map album/day/a.png");
    near.prints(&["2023-10-01T12:00:00Z"]);
    let named = fixture.succeeds("localize street.map album/day/a.png --manifest album");
    named.prints(&["2023-11-01T12:00:00Z"]);
}

#[test]
fn clip_retrieval_321_a_nearer_index_that_cannot_be_read_is_not_silent() {
    let fixture = Fixture::with_map();
    fs::create_dir_all(fixture.path("run/day")).expect("writable");
    fs::write(fixture.path("run/day/a.png"), png(1, query_time(), 9)).expect("writable");
    let row = format!("place,time,path\nplace-01,{QUERY_TIME},day/a.png\n");
    fixture.write("run/index.csv", row);
    fixture.write("run/day/index.csv", "no index\n");
    let ran = fixture.succeeds("localize street.map run/day/a.png");
    ran.prints(&["from the index"]);
    ran.notes(&["run/day/index.csv", "is not used"]);
}

#[test]
fn rtabmap_1414_what_an_update_doubts_a_build_and_a_check_doubt_too() {
    let fixture = Fixture::new();
    let mut index = fixture.index();
    fixture.write("data/images/black.png", plain((320, 240), 0));
    fixture.write("data/images/late.png", png(0, query_time(), 3));
    let _ = write!(
        index,
        "place-00,2023-11-01T12:00:00Z,images/black.png\n\
         place-00,2099-11-01T12:00:00Z,images/late.png\n\
         place-00,1970-01-01T00:00:00Z,images/late.png\n"
    );
    fixture.write("data/index.csv", index);
    let words = ["nothing to learn", "in the future", "never set", "help:"];
    let checked = fixture.run("dataset check data");
    assert_eq!(checked.code, 1, "{checked:?}");
    checked.prints(&words);
    checked.prints(&["problems  3"]);
    let built = fixture.run("map build --data data --out street.map");
    assert_eq!(built.code, 1, "{built:?}");
    built.notes(&words);
    built.prints(&["24 visits"]);
    // Nothing to see anywhere is no map.
    fs::create_dir(fixture.path("dark")).expect("writable");
    fixture.write("dark/a.png", plain((320, 240), 3));
    fixture.write(
        "dark/index.csv",
        "place,time,path\na,2023-11-01T12:00:00Z,a.png\n",
    );
    let dark = "map build --data dark --out dark.map";
    fixture.fails(
        dark,
        &["dark, or the lens is covered", "no image could be learnt"],
    );
    assert!(!fixture.path("dark.map").exists() && !fixture.path("dark.map.part").exists());
}

#[test]
fn rtabmap_1414_a_query_without_anything_to_see_says_so() {
    let fixture = Fixture::with_map();
    fixture.write("black.png", plain((320, 240), 3));
    let ran = fixture.run(&format!(
        "localize street.map black.png --time {QUERY_TIME}"
    ));
    assert_eq!(ran.code, 1, "{ran:?}");
    ran.notes(&[
        "warning: black.png: 0 features",
        "the lens is covered",
        "help:",
    ]);
}

#[test]
fn colmap_1520_an_upright_first_picture_does_not_decide() {
    let fixture = Fixture::new();
    let upright = encoded(&picture(0).rotate90().to_luma8());
    fixture.write("data/images/up.png", upright);
    let index = fixture.index().replacen(
        "place,time,path\n",
        "place,time,path\nplace-00,2023-05-01T12:00:00Z,images/up.png\n",
        1,
    );
    fixture.write("data/index.csv", index);
    let built = fixture.run("map build --data data --out street.map");
    assert_eq!(built.code, 1, "{built:?}");
    built.notes(&["240 x 320 px", "320 x 240 px", "1 problem"]);
    built.prints(&["24 visits"]);
    let checked = fixture.run("dataset check data");
    assert_eq!(checked.code, 1, "{checked:?}");
}

#[test]
fn colmap_2104_images_are_turned_cut_and_scaled_as_the_options_say() {
    let fixture = Fixture::with_map();
    let time = format!("--time {QUERY_TIME}");
    let turned = encoded(&picture(2).rotate270().to_luma8());
    fixture.write("turned.png", turned);
    fixture.fails(
        &format!("localize street.map turned.png {time}"),
        &["240 x 320 px"],
    );
    let ran = fixture.succeeds(&format!(
        "localize street.map turned.png {time} --rotate 90"
    ));
    ran.prints(&["decision      place-02"]);
    // Another camera of the same shape is scaled, and that is said.
    let filter = image::imageops::FilterType::Triangle;
    let large = picture(2).resize_exact(640, 480, filter);
    fixture.write("large.png", encoded(&large.to_luma8()));
    let ran = fixture.succeeds(&format!("localize street.map large.png {time}"));
    ran.notes(&["640 x 480 px are scaled to 320 x 240 px"]);
    ran.prints(&["decision      place-02"]);
    let mut framed = image::GrayImage::new(360, 260);
    image::imageops::replace(&mut framed, &picture(2).to_luma8(), 20, 10);
    fixture.write("framed.png", encoded(&framed));
    let cut = format!("localize street.map framed.png {time} --crop 20,10,320,240");
    fixture.succeeds(&cut).prints(&["decision      place-02"]);
    fixture.succeeds("map build --data data --out twice.map --scale 2");
    assert_eq!(
        fixture.open("twice.map").meta().image_size,
        Some((640, 480))
    );
    for bad in ["--scale 0", "--rotate 45", "--crop 1,2,3"] {
        fixture.fails(
            &format!("localize street.map framed.png {time} {bad}"),
            &["help"],
        );
    }
}

#[test]
fn autoware_1030_images_too_small_for_features_are_enlarged() {
    let fixture = Fixture::new();
    fs::create_dir(fixture.path("small")).expect("writable");
    let filter = image::imageops::FilterType::Triangle;
    let mut index = "path,place,time\n".to_owned();
    for place in 0..3 {
        let small = picture(place).resize_exact(160, 120, filter);
        fixture.write(format!("small/{place}.png"), encoded(&small.to_luma8()));
        let _ = writeln!(index, "{place}.png,place-{place},2024-05-01T08:00:00Z");
    }
    fixture.write("small/index.csv", &index);
    fixture
        .succeeds("dataset check small")
        .prints(&["problems  0"]);
    fixture
        .succeeds("map build --data small --out small.map")
        .notes(&["3 images of another resolution are scaled to 320 x 240 px"]);
    let time = "--time 2024-05-02T08:00:00Z";
    for place in 0..3 {
        fixture
            .succeeds(&format!("localize small.map small/{place}.png {time}"))
            .prints(&[&format!("decision      place-{place}")]);
    }
    // Who says how large images shall be is believed.
    let built = "map build --data small --out as-they-are.map --scale 0.9";
    fixture.fails(built, &["fewer than 10"]);
}

#[test]
fn rtabmap_612_a_folder_that_was_renamed_is_known() {
    let fixture = Fixture::new();
    fixture.succeeds("map build --data data --out a.map");
    fs::rename(fixture.path("data"), fixture.path("renamed")).expect("renames");
    let again = fixture.succeeds("map update a.map --data renamed");
    again.prints(&["24 visits (0 learnt now)"]);
    fixture.succeeds("map build --data renamed --out b.map");
    let ids = |map: &str| -> Vec<_> {
        let snapshot = fixture.open(map);
        let visits = snapshot.nodes().iter().flat_map(|node| node.visits());
        visits.map(|visit| visit.id).collect()
    };
    assert_eq!(ids("a.map"), ids("b.map"));
    fixture
        .succeeds("map merge a.map b.map --out both.map")
        .prints(&["24 visits"]);
    // Copied one by one under other names: known by what is in them.
    fs::create_dir(fixture.path("copies")).expect("writable");
    let mut index = String::from("place,time,path\n");
    for (place, time, _, bytes) in &images()[..8] {
        let name = format!("{place}-{}.png", time.as_us());
        let _ = writeln!(index, "place-{place:02},{time},{name}");
        fixture.write(format!("copies/{name}"), bytes);
    }
    fixture.write("copies/index.csv", index);
    let again = fixture.succeeds("map update a.map --data copies");
    again.prints(&["24 visits (0 learnt now)"]);
    again.notes(&["8 images were learnt before"]);
    let learnt = fixture.run("localize a.map renamed/images/00.png --learn");
    assert_ne!(learnt.code, 2, "{learnt:?}");
    fixture.succeeds("map inspect a.map").prints(&["24"]);
}

#[test]
fn renpy_2327_one_name_in_two_spellings_is_one_place() {
    let fixture = Fixture::new();
    let index = fixture.index().replace("place-00", "K\u{fc}che");
    let mac = index.replacen("K\u{fc}che", "Ku\u{308}che", 3);
    assert_ne!(mac, index);
    fixture.write("data/index.csv", mac);
    fixture.write("data/edges.csv", "from,to\nplace-01,Ku\u{308}che\n");
    fixture.write("data/poses.csv", "place,x,y\nKu\u{308}che,1,2\n");
    fixture
        .succeeds("map build --data data --out street.map")
        .prints(&["4 places, 24 visits"]);
    let edge = "map edge street.map add place-02 Ku\u{308}che";
    fixture.succeeds(edge);
    fixture.succeeds("predict street.map --time 2023-11-15T12:00:00Z --node Ku\u{308}che");
}

#[test]
fn emhass_589_rhythms_of_people_follow_the_clocks_of_their_zone() {
    // Open from 9 to 17 h by the clocks of Prague, over both changes of a winter.
    let prague = fremen::time::Zone::new("Europe/Prague").expect("known");
    let series = |from: &str, days: i64| {
        let start = fremen::Time::parse(from).expect("valid");
        (0..days * 48).fold(String::new(), |mut text, half_hour| {
            let time = start.plus_us(half_hour * 1_800_000_000);
            let shown = prague
                .wall(time)
                .as_us()
                .div_euclid(1_800_000_000)
                .rem_euclid(48);
            let _ = writeln!(text, "{time},{}", u8::from((18..34).contains(&shown)));
            text
        })
    };
    let fixture = Fixture::new();
    for (from, days, open, shut) in [
        // Into winter: half past eight and half past sixteen are 7:30 and 15:30 UTC.
        (
            "2024-08-01T00:00:00Z",
            111,
            "2024-11-25T15:30:00Z",
            "2024-11-25T07:30:00Z",
        ),
        // And into summer.
        (
            "2025-01-10T00:00:00Z",
            100,
            "2025-05-05T14:30:00Z",
            "2025-05-05T06:30:00Z",
        ),
    ] {
        fixture.write("office.csv", series(from, days));
        let line = format!("spectrum office.csv --predict-at {open} --predict-at {shut} --json");
        let ran = fixture.succeeds(&format!("{line} --zone Europe/Prague"));
        let predicted = &ran.lines()[0]["learnt"][0]["predicted"];
        let p = |i: usize| predicted[i]["p"].as_f64().expect("a probability");
        assert!(p(0) > 0.5 && p(1) < 0.5, "{from}: {predicted}");
        // Without a zone the rhythm is of UTC, and that is said.
        fixture
            .succeeds(&line)
            .notes(&["the clocks of Europe change", "--zone"]);
    }
}

#[test]
fn pandas_17860_a_series_says_its_unit() {
    let fixture = Fixture::new();
    fixture.write(
        "ms.csv",
        "1714521600000,1\n1714522200000,0\n1714522800000,1\n",
    );
    fixture.fails(
        "spectrum ms.csv",
        &["ms.csv", "milliseconds since 1970", "--time-unit ms"],
    );
    fixture
        .succeeds("spectrum ms.csv --time-unit ms")
        .prints(&["from 2024-05-01T00:00:00Z"]);
    fixture.write(
        "events.csv",
        "when\n2024-05-01T00:00:00Z\n2024-05-01T01:00:00Z\n",
    );
    fixture
        .succeeds("spectrum events.csv --events 600")
        .prints(&["7 samples"]);
}

#[test]
fn pandas_17860_times_of_arguments_are_read_as_those_of_files() {
    let fixture = Fixture::with_map();
    fixture
        .succeeds("localize street.map query1.png --zone Europe/Prague --time 2023-11-15T13:00:00")
        .prints(&["2023-11-15T12:00:00Z (given)"]);
    fixture.fails(
        "localize street.map query1.png --time 2023-11-15T13:00:00",
        &["--time", "no offset", "--zone"],
    );
    fixture.write("ms.csv", "1714521600000,1\n1714522200000,0\n");
    let at = "--predict-at 1714521600000";
    fixture
        .succeeds(&format!("spectrum ms.csv --time-unit ms {at}"))
        .prints(&["p(2024-05-01T00:00:00Z)"]);
    fixture.write("zone.csv", "2024-05-01T02:00:00,1\n2024-05-01T03:00:00,0\n");
    fixture
        .succeeds("spectrum zone.csv --zone Europe/Prague --predict-at 2024-05-02T02:00:00")
        .prints(&["p(2024-05-02T00:00:00Z)"]);
    fixture.fails(
        &format!("spectrum zone.csv --zone Europe/Prague {at}"),
        &["--predict-at", "milliseconds", "--time-unit ms"],
    );
}

#[test]
fn a_byte_order_mark_is_no_part_of_a_yaml_file() {
    let fixture = Fixture::new();
    let map = "\u{feff}image: a.pgm\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\n\
               occupied_thresh: 0.65\nfree_thresh: 0.196\n";
    fixture.write("a.yaml", map);
    let cells = [b"P5\n8 8\n255\n".to_vec(), vec![254; 64]].concat();
    fixture.write("a.pgm", cells);
    fixture.succeeds("grid build --map a.yaml --time 2024-05-01T08:00:00Z --out a.grid");
}

#[test]
fn unusable_images_have_a_line_and_a_ranking_can_be_asked_for() {
    let fixture = Fixture::with_map();
    fixture.write("text.png", "no image");
    let line =
        format!("localize street.map text.png query1.png --time {QUERY_TIME} --json --top 3");
    let ran = fixture.run(&line);
    assert_eq!(ran.code, 2, "{ran:?}");
    let lines = ran.lines();
    assert_eq!(lines[0]["decision"], "unusable");
    assert!(
        lines[0]["error"]
            .as_str()
            .is_some_and(|it| it.contains("not an image"))
    );
    assert_eq!(lines[1]["ranking"].as_array().map(Vec::len), Some(3));
    assert_eq!(lines[1]["ranking"][0]["place"], "place-01");
}

/// The index of a robot's years is not read row by row for a few images.
#[test]
fn dbow2_65_only_rows_of_the_images_in_question_are_read_of_an_index() {
    let fixture = Fixture::with_map();
    let image = |number: usize| format!("place-00,2023-11-15T12:00:00Z,query{number}.png\n");
    // Rows that would take a look at a file each, and some that no reader could make sense of.
    let mut index = String::from("place,time,path\n");
    for number in 0..400_000 {
        writeln!(index, "elsewhere,2023-11-15T12:00:00Z,f{number}.jpg").expect("memory");
    }
    index += "nowhere,never,broken.png\n";
    index += &image(0);
    fixture.write("index.csv", index);
    let ran = fixture.succeeds("localize street.map query0.png --json");
    assert_eq!(ran.stderr, "");
    assert_eq!(ran.lines()[0]["time_source"], "index");
    assert_eq!(ran.lines()[0]["truth"], "place-00");
    // By the name of a link to it, too, once all rows can be read.
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(fixture.path("query1.png"), fixture.path("linked.png"))
            .expect("a link");
        let index = "place,time,path\nplace-01,2023-11-15T12:00:00Z,linked.png\n";
        fixture.write("index.csv", index);
        let ran = fixture.succeeds("localize street.map query1.png --json");
        assert_eq!(ran.lines()[0]["truth"], "place-01");
    }
}
