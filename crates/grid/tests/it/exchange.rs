//! Maps of `map_server` come back cell by cell, and what is none is refused.

use std::fs;
use std::path::Path;

use fremen_grid::exchange::{
    MapMode, MapServerMap, read_map, read_octomap, read_points, write_map, write_octomap,
    write_points,
};
use fremen_grid::{ErrorKind, GridSpec, OccupancyMap, Thresholds};
use proptest::prelude::*;

const MODES: [MapMode; 3] = [MapMode::Trinary, MapMode::Scale, MapMode::Raw];

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a folder")
}

fn describe(image: &str, mode: &str, free: f64, occupied: f64) -> String {
    format!(
        "image: {image}\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\nmode: {mode}\n\
         occupied_thresh: {occupied}\nfree_thresh: {free}\n"
    )
}

fn values(folder: &Path, yaml: &str) -> Vec<i8> {
    let path = folder.join("m.yaml");
    fs::write(&path, yaml).unwrap();
    MapServerMap::read(&path).unwrap().values().to_vec()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn every_value_comes_back(
        (w, h, values) in (1_u32..30, 1_u32..30).prop_flat_map(|(w, h)| {
            (Just(w), Just(h), prop::collection::vec(-1_i8..=100, (w * h) as usize))
        }),
        origin in prop::array::uniform2(-1e3..1e3_f64),
        resolution in 0.01..1.0_f64,
    ) {
        let folder = folder();
        let spec = GridSpec::new_2d(origin, resolution, [w, h]).unwrap();
        for mode in MODES {
            let path = folder.path().join(format!("{}.yaml", mode.name()));
            let written = match mode {
                // Nothing between free and occupied.
                MapMode::Trinary => values.iter().map(|it| [-1, 0, 100][(it + 1) as usize % 3]).collect(),
                _ => values.clone(),
            };
            let map = MapServerMap::new(spec, written).unwrap();
            map.write(&path, mode).unwrap();
            let read = MapServerMap::read(&path).unwrap();
            prop_assert_eq!(&read, &map);
            prop_assert_eq!(MapServerMap::from_map(&read.to_map()).unwrap(), map);
        }
    }
}

/// The values in a file: a row of the map in each line, the lowest first, as in an `OccupancyGrid`.
fn golden(folder: &Path, name: &str) -> Vec<i8> {
    let text = fs::read_to_string(folder.join(name).with_extension("csv")).unwrap();
    let cells = text.lines().flat_map(|line| line.split(','));
    cells.map(|cell| cell.parse().unwrap()).collect()
}

/// The values beside these files were computed from `nav2_map_server`'s rules (`map_io.cpp`,
/// `loadMapFromFile`) by a program that shares nothing with this crate.
#[test]
fn golden_files_have_the_values_of_nav2_in_every_cell() {
    let files = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden");
    for name in [
        "trinary",
        "trinary-negated",
        "trinary-default-thresholds",
        "trinary-with-opacity",
        "scale",
        "scale-every-shade",
        "raw",
        "raw-every-shade",
    ] {
        let map = MapServerMap::read(files.join(name).with_extension("yaml")).unwrap();
        assert_eq!(map.values(), golden(&files, name), "{name}");
        assert_eq!(map.spec().origin_m(), [-1.5, 2.25, 0.0], "{name}");
        assert_eq!(map.spec().resolution_m(), 0.05, "{name}");
    }
}

/// What is read of a golden file and written in its mode is read as the same again, and where
/// nothing is scaled it is the same picture, byte by byte.
#[test]
fn golden_files_come_back_in_their_mode() {
    let files = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden");
    let folder = folder();
    for mode in MODES {
        let from = files.join(mode.name()).with_extension("yaml");
        let map = MapServerMap::read(&from).unwrap();
        let to = folder.path().join(mode.name()).with_extension("yaml");
        map.write(&to, mode).unwrap();
        assert_eq!(MapServerMap::read(&to).unwrap(), map, "{}", mode.name());
        let bytes = |path: &Path| fs::read(path.with_extension("pgm")).unwrap();
        if mode != MapMode::Scale {
            assert_eq!(bytes(&to), bytes(&from), "{}", mode.name());
        }
    }
}

/// What `nav2_map_server` gives for these shades, by its source's rules.
#[test]
fn shades_mean_what_map_server_says() {
    let folder = folder();
    let shades = [0, 1, 89, 90, 100, 101, 204, 205, 206, 254, 255];
    let mut pgm = b"P5 # shades\n11 1\n255\n".to_vec();
    pgm.extend(shades);
    fs::write(folder.path().join("m.pgm"), pgm).unwrap();
    let read =
        |mode, free, occupied| values(folder.path(), &describe("m.pgm", mode, free, occupied));
    assert_eq!(
        read("trinary", 0.196, 0.65),
        [100, 100, 100, -1, -1, -1, -1, -1, 0, 0, 0]
    );
    // The usual threshold takes the unknown 205 for free.
    assert_eq!(
        read("trinary", 0.25, 0.65),
        [100, 100, 100, -1, -1, -1, 0, 0, 0, 0, 0]
    );
    assert_eq!(
        read("scale", 0.196, 0.65),
        [100, 100, 100, 99, 91, 90, 1, 0, 0, 0, 0]
    );
    assert_eq!(
        read("raw", 0.196, 0.65),
        [0, 1, 89, 90, 100, -1, -1, -1, -1, -1, -1]
    );
    let negated = describe("m.pgm", "trinary", 0.196, 0.65).replace("negate: 0", "negate: 1");
    assert_eq!(
        values(folder.path(), &negated),
        [0, 0, -1, -1, -1, -1, 100, 100, 100, 100, 100]
    );
}

#[test]
fn the_first_row_of_a_picture_is_the_highest() {
    let folder = folder();
    fs::write(
        folder.path().join("m.pgm"),
        "P2\n2 3\n255\n0 254\n254 254\n205 254\n",
    )
    .unwrap();
    let found = values(folder.path(), &describe("m.pgm", "trinary", 0.196, 0.65));
    assert_eq!(found, [-1, 0, 0, 0, 100, 0]);
}

#[test]
fn a_picture_that_is_none_is_refused_with_its_name() {
    let folder = folder();
    let yaml = folder.path().join("m.yaml");
    let png = |color, bytes: &[u8]| {
        use image::ImageEncoder;
        let mut out = Vec::new();
        let encoder = image::codecs::png::PngEncoder::new(&mut out);
        encoder.write_image(bytes, 2, 1, color).unwrap();
        out
    };
    let grey_in_colours = png(image::ExtendedColorType::Rgb8, &[9, 9, 9, 254, 254, 254]);
    let coloured = png(image::ExtendedColorType::Rgb8, &[9, 9, 9, 254, 0, 254]);
    let deep = png(image::ExtendedColorType::L16, &[0, 9, 200, 9]);
    let mut cut = grey_in_colours.clone();
    cut.truncate(50);
    for (bytes, expected) in [
        (
            &b"P5\n2 2\n255\nabc"[..],
            "the file ends after 3 of 2 x 2 pixels",
        ),
        (b"P5\n2 2\n65535\nabcdabcd", "16 bits a pixel"),
        (b"P5\n2", "the file ends before the height"),
        (b"P5\n0 2\n255\n", "a picture of 0 x 2 pixels"),
        (
            b"P5\n99999999 99999999\n255\n",
            "a picture of 99999999 x 99999999",
        ),
        (b"P5\n1 1\n7\n\x09", "a pixel of 9 where 7 is the largest"),
        (b"P2\n2 1\n255\n3", "the file ends before all pixels"),
        (b"P6\n1 1\n255\nabc", "the picture is coloured"),
        (b"GIF89a", "neither a PGM nor a PNG"),
        (b"", "neither a PGM nor a PNG"),
        (&coloured, "the picture is coloured"),
        (&deep, "16 bits a pixel"),
        (&cut, "cannot be decoded"),
    ] {
        fs::write(folder.path().join("m.pic"), bytes).unwrap();
        fs::write(&yaml, describe("m.pic", "trinary", 0.196, 0.65)).unwrap();
        let error = MapServerMap::read(&yaml).expect_err(expected);
        assert_eq!(error.kind(), ErrorKind::Format, "{error}");
        let text = error.to_string();
        assert!(
            text.contains(expected) && text.contains("m.pic"),
            "{text} for {expected}"
        );
    }
    fs::write(folder.path().join("m.pic"), grey_in_colours).unwrap();
    let read = MapServerMap::read(&yaml).unwrap();
    assert_eq!(read.values(), [100, 0]);
    fs::remove_file(folder.path().join("m.pic")).unwrap();
    assert_eq!(
        MapServerMap::read(&yaml).unwrap_err().kind(),
        ErrorKind::NotFound
    );
}

#[test]
fn a_map_never_replaces_what_is_no_map() {
    let folder = folder();
    let spec = GridSpec::new_2d([0.0; 2], 0.1, [2, 1]).unwrap();
    let map = MapServerMap::from_map(&OccupancyMap::new_unknown(spec)).unwrap();
    let path = folder.path().join("m.yaml");
    map.write(&path, MapMode::Trinary).unwrap();
    map.write(&path, MapMode::Trinary).unwrap();
    fs::write(folder.path().join("m.pgm"), "notes").unwrap();
    let error = map.write(&path, MapMode::Raw).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::AlreadyExists, "{error}");
    assert!(
        map.write(folder.path().join("m.pgm"), MapMode::Raw)
            .is_err()
    );
    let solid = GridSpec::new_3d([0.0; 3], 0.1, [2, 1, 1]).unwrap();
    assert!(MapServerMap::from_map(&OccupancyMap::new_unknown(solid)).is_err());
    assert!(MapServerMap::new(spec, vec![0, 101]).is_err());
}

#[test]
fn trees_that_octomap_itself_has_written_are_read_and_written_again_byte_by_byte() {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden");
    let map = read_octomap(golden.join("octomap.bt")).unwrap();
    assert_eq!(map.spec().resolution_m(), 0.25);
    // What OctoMap 1.9.7 says of each known voxel.
    let voxels = read_points(golden.join("octomap.csv")).unwrap();
    assert_eq!(voxels.len(), 816);
    for voxel in &voxels {
        let cell = map.spec().cell_at(voxel.at_m).unwrap();
        assert_eq!(map.get(map.spec().index(cell)), Some(voxel.p), "{voxel:?}");
    }
    let known = map.probabilities().iter().filter(|p| !p.is_nan()).count();
    assert_eq!(known, voxels.len());
    let dir = folder();
    let path = dir.path().join("again.bt");
    write_octomap(&map, Thresholds::default(), &path, &[]).unwrap();
    assert_eq!(
        fs::read(&path).unwrap(),
        fs::read(golden.join("octomap.bt")).unwrap()
    );
}

#[test]
fn a_tree_does_not_replace_another_file() {
    let dir = folder();
    let path = dir.path().join("notes.bt");
    fs::write(&path, "mine").unwrap();
    let spec = GridSpec::new_3d([0.0; 3], 0.5, [2, 2, 2]).unwrap();
    let map = OccupancyMap::new_unknown(spec);
    assert!(write_octomap(&map, Thresholds::default(), &path, &[]).is_err());
    assert!(write_points(&map, 0.5, &path, &[]).is_err());
    assert_eq!(fs::read(&path).unwrap(), b"mine");
    assert!(read_octomap(&path).is_err());
    assert!(read_points(&path).is_err());
}

#[test]
fn a_map_is_read_and_written_by_its_name() {
    let folder = folder();
    let spec = GridSpec::new_3d([0.0; 3], 0.5, [2, 2, 2]).unwrap();
    let mut solid = OccupancyMap::new_unknown(spec);
    solid.set(0, Some(1.0));
    solid.set(7, Some(0.0));
    let flat = MapServerMap::new(
        GridSpec::new_2d([0.0; 2], 0.5, [2, 1]).unwrap(),
        vec![0, 100],
    )
    .unwrap()
    .to_map();
    let path = |name: &str| folder.path().join(name);
    write_map(&flat, path("flat.yaml"), MapMode::Trinary, &[]).unwrap();
    assert_eq!(read_map(path("flat.yaml"), None).unwrap(), flat);
    write_map(&solid, path("solid.BT"), MapMode::Trinary, &[]).unwrap();
    assert_eq!(read_map(path("solid.BT"), None).unwrap().get(0), Some(1.0));
    write_map(&solid, path("solid.ply"), MapMode::Trinary, &[]).unwrap();
    assert_eq!(
        read_map(path("solid.ply"), Some(0.5)).unwrap().get(0),
        Some(1.0)
    );
    let error = read_map(path("solid.ply"), None).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Config);
    assert!(error.path().is_some());
    let error = write_map(&solid, path("solid.yaml"), MapMode::Trinary, &[]).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Shape);
    assert!(!path("solid.yaml").exists());
}
