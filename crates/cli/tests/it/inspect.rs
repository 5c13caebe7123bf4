//! `chronotope map inspect` and `map verify`, of what is no map too.

use std::fs;

use crate::fixture::{Fixture, QUERY_TIME};
use chronotope::map::{Map, MapMeta};

#[test]
fn what_is_no_map_is_refused() {
    let fixture = Fixture::with_map();
    let bytes = fs::read(fixture.path("street.map")).expect("built");
    fixture.write("cut.map", &bytes[..bytes.len() / 2]);
    fixture.write("text.map", "no map");
    fixture.write("empty.map", "");
    for map in ["cut.map", "text.map", "empty.map", "none.map", "data"] {
        for command in ["map inspect", &format!("predict --time {QUERY_TIME}")] {
            fixture.fails(&format!("{command} {map}"), &[map]);
        }
        fixture.fails(
            &format!("localize {map} query0.png --time {QUERY_TIME}"),
            &[map],
        );
    }
    let mut damaged = bytes.clone();
    let second_half = damaged.iter_mut().skip(bytes.len() / 2);
    for byte in second_half.step_by(64).take(64) {
        *byte ^= 0x10;
    }
    fixture.write("damaged.map", damaged);
    let verified = fixture.run("map verify damaged.map");
    assert_eq!(verified.code, 1, "{verified:?}");
    verified.prints(&["damaged.map: damaged"]);

    let meta = MapMeta::new(1, "star-brief", "default");
    drop(Map::create(fixture.path("new.map"), meta).expect("writable"));
    for command in [
        &format!("predict new.map --time {QUERY_TIME}"),
        "localize --method static new.map query0.png",
    ] {
        fixture.fails(command, &["new.map", "the map has no places"]);
    }
}
