//! `chronotope map place`, `map visit` and `dataset index`.

use std::fs;

use super::fixture::{Fixture, QUERY_TIME, png, query_time};

#[test]
fn places_and_visits_are_corrected_and_can_be_brought_back() {
    let fixture = Fixture::with_map();
    let before = fixture.digest("street.map");
    // A slow build commits more than once.
    let first = fixture.open("street.map").generation();
    fixture
        .succeeds("map place street.map rename place-00 gate")
        .prints(&["4 places"]);
    let query = format!("localize street.map query0.png --time {QUERY_TIME}");
    fixture.succeeds(&query).prints(&["decision      gate"]);
    fixture.fails(
        "map place street.map rename gate place-01",
        &["already", "join"],
    );
    fixture
        .succeeds("map place street.map join gate place-01")
        .prints(&["3 places"]);
    fixture.succeeds("map edge street.map list");
    fixture
        .succeeds("map place street.map remove place-03")
        .prints(&["2 places"]);
    fixture.fails(
        "map place street.map remove place-03",
        &["no place `place-03`"],
    );
    let visits = fixture
        .succeeds("map visit street.map list gate --json")
        .lines();
    assert_eq!(visits.len(), 12);
    let id = visits[0]["visit"].as_str().expect("an identity").to_owned();
    fixture
        .succeeds(&format!("map visit street.map drop {id}"))
        .prints(&["a visit of gate"]);
    fixture.fails(
        &format!("map visit street.map drop {id}"),
        &["no visit begins"],
    );
    fixture.succeeds("map verify street.map");
    fixture.succeeds(&format!("map rollback street.map --to {first}"));
    assert_eq!(fixture.digest("street.map"), before);
}

#[test]
fn indexes_of_other_layouts_can_be_built_from() {
    let fixture = Fixture::new();
    let make = |line: &str, folder: &str| {
        let made = fixture.succeeds(&format!("dataset index {folder} {line}"));
        fixture.write(format!("{folder}/index.csv"), &made.stdout);
        fixture
            .succeeds(&format!("dataset check {folder}"))
            .prints(&["problems  0"]);
        made.stdout
    };
    let image = |name: &str, place: usize| {
        let path = fixture.path(name);
        fs::create_dir_all(path.parent().expect("a folder")).expect("writable");
        fs::write(path, png(place, query_time(), 9)).expect("writable");
    };
    image("rooms/hall/1714640400.png", 0);
    image("rooms/yard/1714640460.png", 1);
    let index = make("--from folders --pattern {unix_s}", "rooms");
    assert!(
        index.contains("hall,2024-05-02T09:00:00Z,hall/1714640400.png"),
        "{index}"
    );

    image("names/3_20240502_090000.png", 0);
    let pattern = "--pattern {place}_{year:4}{month:2}{day:2}_{hour:2}{minute:2}{second:2}";
    let index = make(
        &format!("--from file-names --zone Europe/Prague {pattern}"),
        "names",
    );
    assert!(
        index.contains("3,2024-05-02T07:00:00Z,3_20240502_090000.png"),
        "{index}"
    );

    for (second, place) in [(0, 0), (1, 0), (2, 1)] {
        image(&format!("tum/rgb/{second}.png"), place);
        image(&format!("euroc/mav0/cam0/data/{second}.png"), place);
        let us = (1_714_640_400 + second) * 1_000_000_i64;
        image(&format!("car/mono/{us}.png"), place);
    }
    let poses = "# time x y z qx qy qz qw\n1714640400.1 0 0 0 0 0 0 1\n\
                 1714640401.1 0.4 0 0 0 0 0 1\n1714640402.1 9 0 0 0 0 0 1\n";
    fixture.write("tum/groundtruth.txt", poses);
    let list = "1714640400.0 rgb/0.png\n1714640401.0 rgb/1.png\n1714640402.0 rgb/2.png\n";
    fixture.write("tum/rgb.txt", list);
    let index = make("--from tum", "tum");
    assert!(
        index.contains("p0000,2024-05-02T09:00:01Z,rgb/1.png,0.400,0.000"),
        "{index}"
    );
    assert!(
        index.contains("p0001,2024-05-02T09:00:02Z,rgb/2.png"),
        "{index}"
    );

    let mav = "euroc/mav0/state_groundtruth_estimate0";
    fs::create_dir_all(fixture.path(mav)).expect("writable");
    let poses = "#timestamp,x,y,z\n1714640400000000000,0,0,0\n1714640401000000000,0,0,0\n\
                 1714640402000000000,9,9,0\n";
    fixture.write(format!("{mav}/data.csv"), poses);
    let list = "#timestamp [ns],filename\n1714640400000000000,0.png\n\
                1714640401000000000,1.png\n1714640402000000000,2.png\n";
    fixture.write("euroc/mav0/cam0/data.csv", list);
    let index = make("--from euroc", "euroc");
    assert!(
        index.contains("p0001,2024-05-02T09:00:02Z,mav0/cam0/data/2.png"),
        "{index}"
    );

    fs::create_dir_all(fixture.path("car/gps")).expect("writable");
    let poses = "timestamp,ins_status,northing,easting\n1714640400000000,INS,0,0\n\
                 1714640401000000,INS,0,1\n1714640402000000,INS,0,50\n";
    fixture.write("car/gps/ins.csv", poses);
    let index = make("--from robotcar --radius-m 10", "car");
    assert!(
        index.contains("p0001,2024-05-02T09:00:02Z,mono/1714640402000000.png"),
        "{index}"
    );

    fixture.fails("dataset index rooms --from tum", &["groundtruth.txt"]);
    fixture.fails(
        "dataset index rooms --from file-names",
        &["pattern with {place}"],
    );
}

#[test]
fn orb_slam3_54_layouts_come_as_people_have_unpacked_and_named_them() {
    let fixture = Fixture::new();
    let make = |line: &str| {
        let ran = fixture.run(&format!("dataset index {line}"));
        (ran.code, ran.stdout, ran.stderr)
    };
    let image = |name: &str| {
        let path = fixture.path(name);
        fs::create_dir_all(path.parent().expect("a folder")).expect("writable");
        fs::write(path, png(0, query_time(), 9)).expect("writable");
    };

    // The folder that the archive unpacks to.
    image("mav0/cam0/data/0.png");
    fixture.write(
        "mav0/cam0/data.csv",
        "#timestamp [ns],filename\r\n1714640400000000000,0.png\r\n",
    );
    let truth = "mav0/state_groundtruth_estimate0";
    fs::create_dir_all(fixture.path(truth)).expect("writable");
    fixture.write(
        format!("{truth}/data.csv"),
        "#timestamp,x,y,z\n1714640400000000000,0,0,0\n",
    );
    for (dir, path) in [("mav0", ",cam0/data/0.png"), (".", ",mav0/cam0/data/0.png")] {
        let (_, index, _) = make(&format!("{dir} --from euroc"));
        assert!(index.contains(path), "{index}");
    }

    image("tum/rgb/0.png");
    fixture.write("tum/groundtruth.txt", "1714640400.1\t0\t0\t0\n");
    fixture.write("tum/rgb.txt", "1714640400.0\trgb/0.png\n");
    let (_, index, _) = make("tum --from tum");
    assert!(index.contains(",rgb/0.png,"), "{index}");
    let (code, _, why) = make("mav0 --from tum");
    assert!(
        code == 2 && why.contains("groundtruth.txt") && why.contains("help:"),
        "{why}"
    );

    // Cameras that look to different sides do not make visits of one place.
    image("car/stereo/centre/1714640400000000.png");
    image("car/mono_rear/1714640400000000.png");
    fs::create_dir_all(fixture.path("car/gps")).expect("writable");
    let poses = "timestamp,northing,easting\n1714640400000000,0,0\n";
    fixture.write("car/gps/ins.csv", poses);
    let (code, _, why) = make("car --from robotcar");
    assert!(
        code == 2 && why.contains("mono_rear, stereo/centre"),
        "{why}"
    );
    let (_, index, _) = make("car/stereo/centre --from robotcar");
    assert!(
        index.contains("p0000,2024-05-02T09:00:00Z,1714640400000000.png"),
        "{index}"
    );

    for (name, pattern, row) in [
        (
            "hall_1714640400",
            "{place}_{unix_s}",
            "hall,2024-05-02T09:00:00Z",
        ),
        (
            "cam_a_1714640400",
            "cam_{place}_{unix_s}",
            "a,2024-05-02T09:00:00Z",
        ),
        (
            "007-1714640400250",
            "{place}-{unix_ms}",
            "007,2024-05-02T09:00:00.25Z",
        ),
        (
            "1714640400.250_yard",
            "{unix_s}_{place}",
            "yard,2024-05-02T09:00:00.25Z",
        ),
        (
            "1714640400000000000_1",
            "{unix_ns}_{place}",
            "1,2024-05-02T09:00:00Z",
        ),
    ] {
        image(&format!("{name}/{name}.png"));
        let (code, index, why) = make(&format!("{name} --from file-names --pattern {pattern}"));
        assert_eq!(code, 0, "{why}");
        assert!(index.contains(&format!("{row},{name}.png")), "{index}");
    }

    // One file that cannot be read does not keep the others from being listed.
    fs::create_dir_all(fixture.path("rooms/hall")).expect("writable");
    let photo = fixture.path("rooms/hall/broken.png");
    std::os::unix::fs::symlink("nowhere", photo).expect("writable");
    image("rooms/hall/1714640400.png");
    let (code, index, why) = make("rooms --from folders --pattern {unix_s}");
    assert_eq!(code, 1, "{why}");
    assert!(
        index.contains("hall/1714640400.png") && why.contains("broken.png"),
        "{index}{why}"
    );
}
