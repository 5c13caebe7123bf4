//! What comes from outside gives an answer or an error, whatever its bytes.
//!
//! `fuzz/` runs these functions on bytes that it makes up, the test on those that were once worth
//! keeping.

use std::path::{Path, PathBuf};

use chronotope::dataset::Dataset;
use chronotope::map::{Map, MapMeta, Snapshot, read_file_storage};

/// Takes bytes from anywhere and must come back.
type Target = fn(&[u8]);

/// The files of an exported map, as the first byte of an input of [`exported_folder`] numbers them.
const EXPORTED: [&str; 11] = [
    "map.csv",
    "places.csv",
    "visits.csv",
    "edges.csv",
    "keypoints.npy",
    "descriptors.npy",
    "seen.npy",
    "located_by.npy",
    "appearance_keypoints.npy",
    "appearance_descriptors.npy",
    "attachments/calibration.bin",
];

fn folder() -> tempfile::TempDir {
    tempfile::tempdir_in("/dev/shm")
        .or_else(|_| tempfile::tempdir())
        .expect("temporary folder")
}

fn repository(path: &str) -> PathBuf {
    // The crate of the fuzzer lies one folder below.
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let root = [here, here.parent().unwrap_or(here)];
    let root = root.into_iter().find(|root| root.join("maps").exists());
    root.expect("the repository").join(path)
}

/// A map file, opened and verified.
pub(crate) fn map_file(bytes: &[u8]) {
    let folder = folder();
    let path = folder.path().join("a.map");
    std::fs::write(&path, bytes).expect("writable");
    if let Ok(map) = Map::open_read_only(&path) {
        assert!(map.snapshot().check().is_ok());
        assert!(map.generations().is_ok());
    }
    if let Ok(report) = Map::verify(&path) {
        assert_eq!(report.is_clean(), report.digest.is_some());
    }
}

/// The `index.csv` of a dataset without images.
pub(crate) fn index_csv(bytes: &[u8]) {
    let folder = folder();
    std::fs::write(folder.path().join("index.csv"), bytes).expect("writable");
    if let Ok(dataset) = Dataset::open(folder.path()) {
        for entry in dataset.entries.iter().take(10) {
            assert!(entry.source.load().is_err(), "there is no image");
        }
    }
}

/// One file of an exported map.
pub(crate) fn exported_folder(bytes: &[u8]) {
    let Some((&first, bytes)) = bytes.split_first() else {
        return;
    };
    let folder = folder();
    let golden = Map::open_read_only(repository("maps/golden/format-2.map")).expect("a map");
    let path = folder.path().join("out");
    golden.snapshot().export(&path).expect("new");
    let name = EXPORTED[usize::from(first) % EXPORTED.len()];
    std::fs::write(path.join(name), bytes).expect("writable");
    if let Ok(snapshot) = Snapshot::import(&path) {
        assert!(snapshot.check().is_ok());
        let map = Map::create(folder.path().join("a.map"), snapshot.meta.clone()).expect("new");
        map.commit(&snapshot).expect("sound");
    }
}

/// A map of the reference benchmark.
pub(crate) fn file_storage(bytes: &[u8]) {
    let folder = folder();
    let path = folder.path().join("a.yaml");
    std::fs::write(&path, bytes).expect("writable");
    if let Ok(place) = read_file_storage(&path) {
        assert_eq!(place.times.len(), place.seen.len());
        let num_features = place.features.len();
        assert!(place.seen.iter().all(|row| row.len() == num_features));
    }
}

#[test]
fn inputs_that_were_once_worth_keeping_do_no_harm() {
    let targets: [(&str, Target); 4] = [
        ("map_file", map_file),
        ("index_csv", index_csv),
        ("exported_folder", exported_folder),
        ("file_storage", file_storage),
    ];
    for (name, target) in targets {
        let folder = repository("tests/data/fuzz").join(name);
        let inputs = std::fs::read_dir(&folder).expect("committed");
        let mut num_inputs = 0;
        for input in inputs {
            let path = input.expect("readable").path();
            println!("{}", path.display());
            target(&std::fs::read(path).expect("readable"));
            num_inputs += 1;
        }
        assert!(num_inputs > 0, "{name}");
    }
}

/// Bytes of small inputs changed a little, which finds most of what a short run of a fuzzer does.
#[test]
fn small_changes_of_good_inputs_do_no_harm() {
    let yaml = std::fs::read(repository("tests/data/file_storage/place_0.yaml")).expect("there");
    let index = b"place,time,path\ndoor,2024-01-01T00:00:00Z,a.png\n\"x\",2024-01-02T00:00:00Z,b\n";
    let targets: [(Target, &[u8]); 2] = [(index_csv, index), (file_storage, &yaml)];
    for (target, good) in targets {
        target(good);
        for at in (0..good.len()).step_by(1 + good.len() / 400) {
            for byte in [0, b'\n', b'"', b']', b'-', 0xff, good[at] ^ 1] {
                let mut changed = good.to_vec();
                changed[at] = byte;
                target(&changed);
            }
            target(&good[..at]);
        }
    }
    // An empty map, too, is one.
    let folder = folder();
    let path = folder.path().join("empty.map");
    Map::create(&path, MapMeta::new(1, "star+brief", "default")).expect("new");
    map_file(&std::fs::read(path).expect("there"));
}
