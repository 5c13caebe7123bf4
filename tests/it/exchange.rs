//! A map leaves as plain files and comes back as it was; others' files are read or refused by line.

use std::fs;
use std::path::{Path, PathBuf};

use chronotope::feature::Descriptor;
use chronotope::map::{Map, Snapshot, read_file_storage};
use chronotope::{ErrorKind, Time};
use proptest::prelude::*;

use crate::merge::map;

fn folder() -> tempfile::TempDir {
    tempfile::tempdir_in("/dev/shm")
        .or_else(|_| tempfile::tempdir())
        .expect("temporary folder")
}

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(name)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn what_is_exported_comes_back_bit_for_bit(map in map()) {
        let folder = folder();
        let path = folder.path().join("out");
        map.export(&path).expect("new");
        let back = Snapshot::import(&path).expect("sound");
        prop_assert_eq!(&back, &map);
        prop_assert_eq!(back.digest(), map.digest());
    }
}

fn golden(folder: &Path) -> (Snapshot, PathBuf) {
    let map = Map::open_read_only(fixture("maps/golden/format-2.map")).expect("a map");
    let snapshot = Snapshot::clone(&map.snapshot());
    let path = folder.join("out");
    snapshot.export(&path).expect("new");
    (snapshot, path)
}

/// Makes the folder one without a manifest, as another program may have written it.
fn without_manifest(folder: &Path) {
    fs::remove_file(folder.join("manifest.csv")).expect("there");
    let file = folder.join("map.csv");
    let text = fs::read_to_string(&file).expect("there");
    fs::write(&file, text.replacen("layout,2", "layout,1", 1)).expect("writable");
}

#[test]
fn the_golden_map_comes_back_with_its_digest_and_a_folder_is_never_overwritten() {
    let folder = folder();
    let (golden, path) = golden(folder.path());
    let back = Snapshot::import(&path).expect("sound");
    assert_eq!(back.digest(), golden.digest());
    assert_eq!(back.nodes(), golden.nodes());
    // Whatever the format, the same content gives the same bytes.
    let again = folder.path().join("again");
    let of_format_3 = Map::open_read_only(fixture("maps/golden/format-3.map")).expect("a map");
    (of_format_3.at(5).expect("kept").export(&again)).expect("new");
    for entry in fs::read_dir(&path).expect("readable") {
        let file = entry.expect("readable").path();
        if file.is_file() {
            let other = again.join(file.file_name().expect("a file"));
            assert_eq!(
                fs::read(&file).ok(),
                fs::read(other).ok(),
                "{}",
                file.display()
            );
        }
    }
    let error = golden.export(&path).expect_err("not empty");
    assert_eq!(error.kind(), ErrorKind::AlreadyExists);
    assert!(error.to_string().contains("not empty"), "{error}");
    let empty = folder.path().join("empty");
    fs::create_dir(&empty).expect("writable");
    golden.export(&empty).expect("an empty folder will do");
    assert!(golden.export(folder.path().join("no/such")).is_err());
    assert!(Snapshot::import(folder.path()).is_err());
}

#[test]
fn what_is_wrong_with_an_exported_folder_is_named() {
    let folder = folder();
    let (_, path) = golden(folder.path());
    without_manifest(&path);
    let edits: [(&str, &str, &str, &str); 17] = [
        ("map.csv", "layout,1", "layout,3", "line 2, column value"),
        ("map.csv", "layout,1", "layout,2", "has no manifest.csv"),
        ("map.csv", "uuid,", "uuid,x", "line 3, column value"),
        (
            "map.csv",
            "extractor,",
            "extractors,",
            "key `extractor` is missing",
        ),
        ("map.csv", "image_width,752", "image_width,-1", "line 5"),
        (
            "places.csv",
            "place,num_visits",
            "name,num_visits",
            "line 1",
        ),
        ("places.csv", "door,3", "door,4", "visits.csv: line 5"),
        ("places.csv", "door,3", "door,2", "places.csv: line 2"),
        ("places.csv", "door,3,", "door,3,9", "keypoints.npy: row 0"),
        ("places.csv", "12.5", "east", "line 4, column x"),
        (
            "visits.csv",
            ",experience,",
            ",lesson,",
            "line 2, column appearance_use",
        ),
        ("visits.csv", "door,", "door,x", "line 2, column visit"),
        ("visits.csv", "lamp post,", "tree ✓,", "line 5"),
        ("visits.csv", "true", "yes", "column has_hidden"),
        ("edges.csv", "corridor\n", "corridor,\n", "line 2"),
        ("edges.csv", "door", "gate", "`gate`"),
        ("edges.csv", "from,to", "origin,to", "line 1"),
    ];
    for (name, from, to, expected) in edits {
        let file = path.join(name);
        let text = fs::read_to_string(&file).expect("there");
        assert!(text.contains(from), "{name} without `{from}`: {text}");
        fs::write(&file, text.replacen(from, to, 1)).expect("writable");
        let error = Snapshot::import(&path).expect_err(expected).to_string();
        assert!(error.contains(expected), "{name}, {to}: {error}");
        assert!(error.contains("out"), "{error}");
        fs::write(&file, text).expect("writable");
    }
    for (name, expected) in [
        ("seen.npy", "seen.npy"),
        ("descriptors.npy", "do not pair"),
        ("appearance_keypoints.npy", "do not pair"),
    ] {
        let file = path.join(name);
        let bytes = fs::read(&file).expect("there");
        fs::write(&file, &bytes[..128]).expect("writable");
        let empty = String::from_utf8_lossy(&bytes[..128]).into_owned();
        assert!(empty.contains("shape"));
        let error = Snapshot::import(&path).expect_err(name).to_string();
        assert!(
            error.contains(name) || error.contains(expected),
            "{name}: {error}"
        );
        fs::remove_file(&file).expect("there");
        let error = Snapshot::import(&path).expect_err(name);
        assert_eq!(error.kind(), ErrorKind::NotFound);
        fs::write(&file, bytes).expect("writable");
    }
    let odd = path.join("attachments/Odd.bin");
    fs::write(&odd, b"x").expect("writable");
    let error = Snapshot::import(&path).expect_err("odd").to_string();
    assert!(error.contains("`Odd`"), "{error}");
    fs::remove_file(&odd).expect("there");
    assert!(Snapshot::import(&path).is_ok());
}

#[test]
fn an_exported_folder_is_refused_if_anything_is_not_as_it_was_written() {
    let folder = folder();
    let (_, path) = golden(folder.path());
    let left: Vec<_> = fs::read_dir(folder.path()).expect("readable").collect();
    assert_eq!(left.len(), 1, "{left:?}");
    for name in ["keypoints.npy", "visits.csv", "attachments/calibration.bin"] {
        let file = path.join(name);
        let whole = fs::read(&file).expect("there");
        let mut flipped = whole.clone();
        let last = flipped.len() - 1;
        flipped[last] ^= 1;
        fs::write(&file, &flipped).expect("writable");
        let error = Snapshot::import(&path).expect_err("flipped");
        assert_eq!(error.kind(), ErrorKind::Checksum, "{error}");
        fs::write(&file, &whole[..last]).expect("writable");
        let error = Snapshot::import(&path).expect_err("cut").to_string();
        assert!(error.contains("manifest.csv says"), "{error}");
        fs::remove_file(&file).expect("there");
        let error = Snapshot::import(&path).expect_err("missing");
        assert_eq!(error.kind(), ErrorKind::NotFound, "{error}");
        fs::write(&file, whole).expect("writable");
    }
    let odd = path.join("attachments/odd.bin");
    fs::write(&odd, "x").expect("writable");
    let error = Snapshot::import(&path)
        .expect_err("one too many")
        .to_string();
    assert!(
        error.contains("odd.bin: this file is not listed"),
        "{error}"
    );
    fs::remove_file(&odd).expect("there");
    Snapshot::import(&path).expect("whole again");
    // An export that was killed before the manifest came.
    fs::remove_file(path.join("manifest.csv")).expect("there");
    let error = Snapshot::import(&path).expect_err("cut off").to_string();
    assert!(error.contains("has no manifest.csv"), "{error}");
}

#[cfg(unix)]
#[test]
fn an_exported_folder_has_no_links() {
    let folder = folder();
    let (_, path) = golden(folder.path());
    without_manifest(&path);
    let link = path.join("attachments/notes.bin");
    std::os::unix::fs::symlink("/etc/passwd", &link).expect("writable");
    let error = Snapshot::import(&path).expect_err("a link").to_string();
    assert!(error.contains("this is a link"), "{error}");
}

#[test]
fn what_a_killed_export_left_is_not_in_the_way() {
    let folder = folder();
    let (golden, path) = golden(folder.path());
    fs::rename(&path, folder.path().join(".again.unfinished")).expect("writable");
    let again = folder.path().join("again");
    golden.export(&again).expect("nothing is there");
    assert_eq!(
        Snapshot::import(&again).expect("whole").digest(),
        golden.digest()
    );
    assert_eq!(fs::read_dir(folder.path()).expect("readable").count(), 1);
}

#[test]
fn no_flipped_bit_of_an_exported_folder_panics_or_gives_an_unsound_map() {
    let folder = folder();
    let (_, path) = golden(folder.path());
    without_manifest(&path);
    let (mut num_refused, mut num_read) = (0, 0);
    for name in [
        "map.csv",
        "places.csv",
        "visits.csv",
        "edges.csv",
        "seen.npy",
        "located_by.npy",
        "keypoints.npy",
        "appearance_descriptors.npy",
    ] {
        let file = path.join(name);
        let whole = fs::read(&file).expect("there");
        for at in (0..whole.len()).step_by(1 + whole.len() / 200) {
            let mut damaged = whole.clone();
            damaged[at] ^= 1 << (at % 8);
            for bytes in [&damaged[..], &whole[..at]] {
                fs::write(&file, bytes).expect("writable");
                match Snapshot::import(&path) {
                    Ok(map) => {
                        assert!(map.check().is_ok(), "{name}, {at}");
                        num_read += 1;
                    }
                    Err(error) => {
                        assert!(error.path().is_some(), "{name}, {at}: {error}");
                        num_refused += 1;
                    }
                }
            }
        }
        fs::write(&file, whole).expect("writable");
    }
    // Of a coordinate every bit is as good as another: such files have no checksums.
    assert!(
        num_refused > num_read && num_read > 0,
        "{num_refused}, {num_read}"
    );
}

#[test]
fn a_place_of_the_reference_benchmark_is_read() {
    let place = read_file_storage(fixture("tests/data/file_storage/place_0.yaml")).expect("sound");
    assert_eq!(place.features.len(), 3);
    let point = place.features.keypoints()[1];
    assert_eq!(
        (point.x, point.y, point.size, point.response),
        (200.0, -0.5, 9.0, -37.5)
    );
    assert_eq!(place.features.keypoints()[2].response, 1e-3);
    let bytes: [u8; 32] = std::array::from_fn(|j| ((34 + 29 * j + 5) % 256) as u8);
    assert_eq!(
        place.features.descriptors()[2],
        Descriptor::from_bytes(bytes)
    );
    assert_eq!(place.times, [0, 600, 1200, 1800].map(Time::from_s));
    let seen: Vec<Vec<usize>> = place.seen.iter().map(|row| row.ones().collect()).collect();
    assert_eq!(seen, [vec![0, 2], vec![2], vec![0, 1, 2], vec![0, 2]]);
}

#[test]
fn what_is_wrong_with_a_file_of_the_reference_benchmark_is_named_by_its_line() {
    let folder = folder();
    let path = folder.path().join("a.yaml");
    let whole = fs::read_to_string(fixture("tests/data/file_storage/place_0.yaml")).expect("there");
    let edits = [
        ("%YAML", "%XML", "line 1: `%YAML` is expected"),
        ("rows: 3", "row: 3", "line 4: `rows:` is expected"),
        ("rows: 3", "rows: three", "line 4: a count is expected"),
        ("rows: 3", "rows: 2", "more than 2 x 7 numbers"),
        ("rows: 3", "rows: 4", "21 numbers, where 4 x 7 are expected"),
        (
            "rows: 3",
            "rows: 99999999999",
            "line 3: a matrix has at most",
        ),
        ("dt: f", "dt: \"7f\"", "line 6: numbers of type"),
        ("[ 1.25", "[ 1.2.5", "line 7: `1.2.5"),
        ("[ 1.25", "1.25", "line 7: `[` is expected"),
        ("200.", ".Nan", "not finite"),
        ("[ 5, 34", "[ 5, 340", "a whole number from 0 to 255"),
        ("[ 5, 34", "[ 5, 3.4", "a whole number from 0 to 255"),
        ("Visibility", "Visibilities", "`Visibility` is missing"),
        ("Times", "Visibility", "there are two matrices `Visibility`"),
        ("[ 1, 0, 1", "[ 1, 2, 1", "a visibility is 0 or 1"),
        (
            "[ 0, 600",
            "[ -5, 600",
            "a whole number from 0 to 4294967295",
        ),
    ];
    for (from, to, expected) in edits {
        assert!(whole.contains(from), "{from}");
        fs::write(&path, whole.replacen(from, to, 1)).expect("writable");
        let error = read_file_storage(&path).expect_err(expected);
        assert_eq!(error.kind(), ErrorKind::Format, "{error}");
        let error = error.to_string();
        assert!(error.contains(expected), "{to}: {error}");
        assert!(
            error.contains("a.yaml") && error.contains("line "),
            "{error}"
        );
    }
    for len in 0..whole.find("Fremen").expect("there") - 10 {
        fs::write(&path, &whole[..len]).expect("writable");
        assert!(read_file_storage(&path).is_err(), "{len}");
    }
}
