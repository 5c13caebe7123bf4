//! `chronotope localize`: where images come from, when they were taken, what is answered.

use std::fs;

use crate::fixture::{
    Fixture, NUM_PLACES, QUERIES, QUERY_TIME, encoded, images, plain, png, query_time,
};
use serde_json::Value;

#[test]
fn images_are_located_at_their_places() {
    let fixture = Fixture::with_map();
    for method in ["static", "fremen", "experience", "experience-all"] {
        let ran = fixture.run(&format!(
            "localize street.map --json --method {method} --time {QUERY_TIME} {QUERIES}"
        ));
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
    let one = fixture.succeeds(&format!(
        "localize street.map query2.png --time {QUERY_TIME}"
    ));
    one.prints(&[
        "decision      place-02",
        "(given)",
        "second",
        "reason",
        "displacement  (",
    ]);
    let several = fixture.succeeds("localize street.map query2.png query3.png --method static");
    assert_eq!(several.stdout.lines().count(), 2);
    // More than any place has: everything is matched.
    fixture.succeeds(&format!(
        "localize street.map query1.png --time {QUERY_TIME} --n 100000"
    ));
}

#[test]
fn images_of_one_way_are_followed_along_the_edges() {
    let fixture = Fixture::with_map();
    let way = format!(
        "localize street.map query0.png query1.png query2.png --time {QUERY_TIME} --track --json"
    );
    let followed = fixture.succeeds(&way);
    let places: Vec<Value> = (followed.lines().iter())
        .map(|line| line["place"].clone())
        .collect();
    assert_eq!(places, ["place-00", "place-01", "place-02"]);
    fixture.fails(&format!("{way} --score count"), &["--track", "likelihood"]);
}

#[test]
fn an_image_of_nowhere_is_unknown() {
    let fixture = Fixture::with_map();
    fixture.write("grey.png", plain((320, 240), 90));
    let ran = fixture.run(&format!(
        "localize street.map grey.png query0.png --time {QUERY_TIME} --json"
    ));
    assert_eq!(ran.code, 1, "{ran:?}");
    assert_eq!(ran.lines()[0]["decision"], "unknown");
    assert_eq!(ran.lines()[0]["place"], Value::Null);
    assert_eq!(ran.lines()[1]["decision"], "at");
}

#[test]
fn the_time_comes_from_option_index_exif_or_name() {
    let fixture = Fixture::with_map();
    let source = |rest: &str| {
        let ran = fixture.run(&format!("localize street.map --json {rest}"));
        assert_ne!(ran.code, 2, "{ran:?}");
        let line = &ran.lines()[0];
        (line["time"].clone(), line["time_source"].clone())
    };
    let listed = "data/images/12.png";
    assert_eq!(
        source(listed),
        ("2023-06-14T12:00:00Z".into(), "index".into())
    );
    assert_eq!(
        source(&format!("{listed} --time {QUERY_TIME}")),
        (QUERY_TIME.into(), "option".into())
    );
    assert_eq!(
        source("query0.png --method static"),
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
    let named = source("cam_1700000000.png --manifest robot.toml");
    assert_eq!(named, ("2023-11-14T22:13:20Z".into(), "file-name".into()));
    let dated = with_exif(&png(0, query_time(), 9));
    fixture.write("dated.png", dated);
    assert_eq!(
        source("dated.png"),
        ("2023-11-15T11:00:00Z".into(), "exif".into())
    );

    // Nothing says when: an error with a remedy, never a guess.
    let untimed = "localize street.map query0.png";
    fixture.fails(untimed, &["query0.png", "when was it taken", "--time"]);
    fixture.fails(
        "localize street.map query0.png --manifest robot.toml",
        &["query0.png", "does not fit the rule of `robot`"],
    );
    fixture.fails(
        "localize street.map query0.png --manifest nowhere",
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
    let ran = fixture.succeeds("localize street.map wide/both.png --json");
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
        &format!("localize street.map wide.png --time {QUERY_TIME}"),
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
        "localize street.map wide/both.png",
        &["both.png", "index.csv line 2", "crop"],
    );
}

#[test]
fn a_mask_hides_what_is_black() {
    let fixture = Fixture::with_map();
    fixture.write("white.png", plain((320, 240), 255));
    fixture.write("black.png", plain((320, 240), 0));
    fixture.write("small.png", plain((32, 24), 255));
    let query =
        |mask: &str| format!("localize street.map query1.png --time {QUERY_TIME} --mask {mask}");
    fixture.succeeds(&query("white.png"));
    assert_eq!(fixture.run(&query("black.png")).code, 1);
    let words = ["query1.png", "32 x 24", "mask"];
    fixture.fails(&query("small.png"), &words);
    fixture.fails(&query("none.png"), &["none.png"]);
}

#[test]
fn a_configuration_changes_the_answer() {
    let fixture = Fixture::with_map();
    fixture.write(
        "strict.toml",
        "[localize]\nscore = 'inliers'\nmin-score = 100000\n",
    );
    let ran = fixture.run(&format!(
        "localize street.map query0.png --time {QUERY_TIME} --config strict.toml"
    ));
    assert_eq!(ran.code, 1, "{ran:?}");
    ran.prints(&["below the least score 100000"]);
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
        let ran = fixture.run(&format!(
            "localize street.map {name} query1.png --time {QUERY_TIME}"
        ));
        assert_eq!(ran.code, 2, "{ran:?}");
        ran.notes(&[name, words]);
        ran.prints(&["query1.png  place-01"]);
    }
}

#[cfg(not(feature = "opencv"))]
#[test]
fn cameras_and_videos_name_the_feature_they_need() {
    let fixture = Fixture::with_map();
    fixture.fails(
        "localize street.map --camera 0",
        &["camera 0", "--features opencv"],
    );
    fixture.fails(
        &format!("localize street.map walk.mp4 --time {QUERY_TIME}"),
        &["walk.mp4", "--features opencv"],
    );
}

#[test]
fn methods_that_need_what_was_not_kept_say_so() {
    let fixture = Fixture::new();
    fixture.succeeds("map build --data data --out bare.map --keep-appearances none");
    fixture.fails(
        "localize bare.map data/images/00.png --method experience",
        &["bare.map", "kept no appearances"],
    );
    fixture.fails(
        "localize bare.map data/images/00.png --method psychic",
        &["psychic", "fremen"],
    );
}

#[test]
fn what_is_located_is_learnt_only_if_that_is_asked_for() {
    let fixture = Fixture::with_map();
    let visits = || fixture.open("street.map").summary().num_visits;
    let bytes = || fs::read(fixture.path("street.map")).expect("there");
    let (before, num_before) = (bytes(), visits());
    let log = fixture.run("map log street.map --json");
    let to = log.lines().last().expect("some")["number"].to_string();
    let localize = |more: &str| {
        fixture.succeeds(&format!(
            "localize street.map --time {QUERY_TIME} {QUERIES} {more}"
        ))
    };
    localize("");
    assert_eq!(bytes(), before);
    let ran = localize("--learn");
    ran.notes(&["learnt: 4 visits"]);
    assert_eq!(visits(), num_before + 4);
    // The same images are the same visits.
    let ran = localize("--learn");
    ran.notes(&["learnt this visit", "learnt: 0 visits"]);
    assert_eq!(visits(), num_before + 4);
    fixture.succeeds(&format!("map rollback street.map --to {to}"));
    assert_eq!(visits(), num_before);
    fixture.succeeds("map verify street.map");
}

#[test]
fn a_map_whose_times_only_number_its_visits_needs_no_time() {
    let fixture = Fixture::with_map();
    let mut index = String::from("place,time,path\n");
    for (number, (place, _, name, _)) in images().iter().enumerate() {
        let day = 1 + number / NUM_PLACES;
        let row = format!("place-{place:02},1970-01-{day:02}T00:00:00Z,{name}\n");
        index.push_str(&row);
    }
    fixture.write("data/index.csv", index);
    fixture.succeeds("map build --data data --out numbered.map");
    let ran = fixture.succeeds("localize numbered.map query0.png --json");
    ran.notes(&["only number its visits", "--method static"]);
    let answer = &ran.lines()[0];
    assert_eq!(answer["place"], "place-00");
    assert_eq!(answer["method"], "static");
    // What was asked for is done.
    fixture.fails(
        "localize numbered.map query0.png --method fremen",
        &["when was it taken?"],
    );
}
