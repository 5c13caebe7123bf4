//! `chronotope map export` and `map import`.

use std::fs;

use crate::fixture::Fixture;

#[test]
fn a_map_goes_out_as_plain_files_and_comes_back() {
    let fixture = Fixture::with_map();
    let export = "map export street.map --out street";
    let import = "map import street --out again.map";
    fixture.succeeds(export);
    fixture.succeeds(import);
    let digest = |name| fixture.open(name).digest();
    assert_eq!(digest("again.map"), digest("street.map"));
    fixture.fails(export, &["street", "not empty"]);
    fixture.fails(import, &["again.map", "never overwritten"]);
    // Two maps that say the same become the same files.
    for (map, folder) in [("street.map", "a"), ("again.map", "b")] {
        fixture.succeeds(&format!("map export {map} {folder} --canonical"));
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
    let imported = fixture.succeeds("map import place_0.yaml place_1.yaml --out park.map");
    imported.prints(&["2 places, 8 visits, 6 features"]);
    fixture.succeeds("predict park.map --time 1970-01-01T00:30:00Z --node place_1");
    fixture.write("odd.yaml", yaml.replace("cols: 32", "cols: 31"));
    fixture.fails("map import odd.yaml --out odd.map", &["odd.yaml", "line "]);
    assert!(!fixture.path("odd.map").exists());
}
