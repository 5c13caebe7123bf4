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
