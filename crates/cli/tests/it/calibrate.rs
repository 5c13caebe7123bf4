//! `chronotope map calibrate`.

use crate::fixture::{Fixture, QUERY_TIME};

#[test]
fn a_map_is_calibrated_once_and_answers_as_before() {
    let fixture = Fixture::with_map();
    let query = format!("localize street.map query1.png --time {QUERY_TIME}");
    let before = fixture.run(&query);
    let calibrate = || fixture.succeeds("map calibrate street.map");
    calibrate().prints(&["past images"]);
    calibrate().prints(&["calibrated already"]);
    assert_eq!(fixture.run(&query).stdout, before.stdout);
    fixture.write(
        "count.toml",
        "[localize]\nscore = \"count\"\ncalibrated = false\n",
    );
    fixture.fails(
        "map calibrate street.map --config count.toml",
        &["street.map", "calibrated = true"],
    );
}
