//! What comes from outside gives an answer or an error, whatever its bytes.
//!
//! `fuzz/` runs these functions on bytes that it makes up, the test on those that were once worth
//! keeping.

use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use chronotope::Time;
use chronotope::dataset::{Dataset, Manifest, exif_time};
use chronotope::feature::image_file::decode_gray;
use chronotope::feature::{DecodeLimits, ExtractorConfig, LoadOptions, load_gray};
use chronotope::learn::{LearnConfig, Learner, Observation};
use chronotope::localize::{
    Localizer, LocalizerConfig, Method, MotionConfig, Preset, Query, Score,
};
use chronotope::map::{Map, Quarantine, SessionId, Snapshot, read_file_storage};
use chronotope::trace::Trace;
use chronotope::visibility::decode;
use fremen::Series;
use fremen::series::Columns;
use serde::de::DeserializeOwned;

/// Takes bytes from anywhere and must come back.
type Target = fn(&[u8]);

/// Every target by its name.
const TARGETS: [(&str, Target); 12] = [
    ("map_file", map_file),
    ("index_csv", index_csv),
    ("manifest", manifest),
    ("image", image),
    ("config", config),
    ("trace", trace),
    ("attachment", attachment),
    ("exported_folder", exported_folder),
    ("file_storage", file_storage),
    ("query_form", query_form),
    ("series", series),
    ("visibility_model", visibility_model),
];

/// What other rooms keep with a map, as the first byte of an input of [`attachment`] numbers them.
const ATTACHMENTS: [&str; 5] = [
    "held",
    "reobservation",
    "calibration",
    "held-00000000000000000000000000000007",
    "held-forgotten",
];

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

/// The map of `maps/golden`, with all it has.
fn golden() -> &'static Snapshot {
    static GOLDEN: OnceLock<Snapshot> = OnceLock::new();
    GOLDEN.get_or_init(|| {
        let map = Map::open_read_only(repository("maps/golden/format-3.map")).expect("a map");
        Snapshot::clone(&map.snapshot())
    })
}

/// Queries `snapshot` with what its own places looked like.
fn query_own_places(snapshot: &Arc<Snapshot>, cfg: &LocalizerConfig) {
    let Ok(localizer) = Localizer::new(Arc::clone(snapshot), cfg.clone()) else {
        return;
    };
    let mut scratch = localizer.scratch();
    for (node, time) in snapshot
        .nodes()
        .iter()
        .zip([1_700_000_000, -5].map(Time::from_s))
    {
        let query = Query::new(node.features())
            .at(time)
            .with_image_size(snapshot.meta().image_size);
        if let Ok(answer) = localizer.localize(&mut scratch, &query) {
            for candidate in &answer.ranking {
                assert!((0.0..=1.0).contains(&candidate.posterior), "{candidate:?}");
            }
        }
    }
}

/// Learns another visit of every place of `snapshot`.
fn learn_on(snapshot: &Snapshot, cfg: &LearnConfig) {
    let Ok(mut learner) = Learner::resume(cfg.clone(), snapshot.clone()) else {
        return;
    };
    for node in snapshot.nodes() {
        let learnt = learner.observe(&Observation::new(
            node.key().clone(),
            SessionId::derive("fuzz"),
            Time::from_s(1_700_000_000),
            node.features(),
            snapshot.meta().image_size.unwrap_or((640, 480)),
        ));
        drop(learnt);
    }
    if let Ok(snapshot) = learner.snapshot() {
        assert!(snapshot.check().is_ok());
    }
}

/// TOML or JSON; what can be read can be written and is the same then.
fn read<T: DeserializeOwned + serde::Serialize>(text: &str, is_json: bool) -> Option<T> {
    if is_json {
        return serde_json::from_str(text).ok();
    }
    let read: T = toml::from_str(text).ok()?;
    let written = toml::to_string(&read).expect("what was read can be written");
    let again: T = toml::from_str(&written).expect("what was written can be read");
    assert_eq!(toml::to_string(&again).expect("as before"), written);
    Some(read)
}

/// A configuration, used on a small map: the first byte says which, and whether it is TOML or JSON.
pub(crate) fn config(bytes: &[u8]) {
    let Some((&first, bytes)) = bytes.split_first() else {
        return;
    };
    let Ok(text) = std::str::from_utf8(bytes) else {
        return;
    };
    let is_json = first & 1 == 1;
    match first / 2 % 4 {
        0 => {
            if let Some(cfg) = read::<LocalizerConfig>(text, is_json) {
                query_own_places(&Arc::new(golden().clone()), &cfg);
            }
        }
        1 => {
            if let Some(cfg) = read::<LearnConfig>(text, is_json) {
                learn_on(golden(), &cfg);
            }
        }
        2 => drop(read::<MotionConfig>(text, is_json)),
        _ => {
            if let Some(cfg) = read::<ExtractorConfig>(text, is_json)
                && let Ok(extractor) = cfg.build()
            {
                let again = ExtractorConfig::from_id(&extractor.id()).expect("its own name");
                assert_eq!(again, cfg);
            }
        }
    }
}

/// Traces, one a line.
pub(crate) fn trace(bytes: &[u8]) {
    for line in bytes.split(|&byte| byte == b'\n') {
        if let Ok(trace) = serde_json::from_slice::<Trace<'static>>(line) {
            let written = serde_json::to_string(&trace).expect("what was read can be written");
            let again: Trace<'static> = serde_json::from_str(&written).expect("ours");
            assert_eq!(serde_json::to_string(&again).expect("as before"), written);
        }
    }
}

/// A value that other rooms keep with a map: the first byte says which.
pub(crate) fn attachment(bytes: &[u8]) {
    let Some((&first, bytes)) = bytes.split_first() else {
        return;
    };
    let name = ATTACHMENTS[usize::from(first) % ATTACHMENTS.len()];
    let mut snapshot = golden().clone();
    for name in golden().attachments().keys() {
        snapshot.detach(name);
    }
    // What no map can keep is refused.
    if snapshot.attach(name, bytes).is_err() {
        return;
    }
    if let Ok(held) = Quarantine::of(&snapshot) {
        let mut again = golden().clone();
        held.attach(&mut again)
            .expect("what was read can be written");
        assert_eq!(Quarantine::of(&again).expect("ours"), held);
        if let Ok(mut learner) = Learner::resume(LearnConfig::default(), snapshot.clone()) {
            for visit in held.visits() {
                let _ = learner.accept(visit.id);
            }
            if let Ok(snapshot) = learner.snapshot() {
                assert!(snapshot.check().is_ok());
            }
        }
    }
    if name == "calibration" {
        query_own_places(
            &Arc::new(snapshot),
            &LocalizerConfig::preset(Preset::Default),
        );
    }
}

/// An encoded picture, decoded within limits that a fuzzer can afford.
pub(crate) fn image(bytes: &[u8]) {
    const MAX_PIXELS: u64 = 1 << 20;
    let folder = folder();
    let path = folder.path().join("a");
    std::fs::write(&path, bytes).expect("writable");
    let limits = DecodeLimits::default().with_max_pixels(MAX_PIXELS);
    if let Ok(image) = load_gray(&path, &LoadOptions::default().with_limits(limits)) {
        let num_pixels = image.width() * image.height();
        assert!(0 < num_pixels && num_pixels as u64 <= MAX_PIXELS);
        // A JPEG that is whole stays so, whatever follows its end.
        if bytes.starts_with(&[0xFF, 0xD8]) {
            let longer = [bytes, b"\xFF\xDA\xFF\xD9 and a film"].concat();
            let again = decode_gray(&longer, &limits).expect("whole");
            assert_eq!(again.digest(), image.digest());
        }
    }
    if let Ok(Some(time)) = exif_time(&path, None) {
        assert!(time.to_string().len() >= 20, "{time}");
    }
}

/// A manifest, over a folder with a few files of every layout.
pub(crate) fn manifest(bytes: &[u8]) {
    let folder = folder();
    let path = folder.path().join("dataset.toml");
    std::fs::write(&path, bytes).expect("writable");
    let Ok(manifest) = Manifest::load(&path) else {
        return;
    };
    for name in [
        "",
        "0001.bmp",
        "2016-06-13_10-00-00.jpg",
        "1339000000.5.tif",
        "99999999999999999999",
    ] {
        let _ = manifest.time_from_name(name);
    }
    let _ = manifest.time.of_visit(i64::MIN);
    let index = "place,time,path\ndoor,2024-01-01T00:00:00Z,a.png\n";
    std::fs::write(folder.path().join("index.csv"), index).expect("writable");
    for place in ["place_0", "door"] {
        let files = folder.path().join(place);
        std::fs::create_dir(&files).expect("new");
        for name in [
            "00000.bmp",
            "00001.bmp",
            "places.txt",
            "displacements.txt",
            "times.txt",
        ] {
            std::fs::write(files.join(name), "0 1\n2 3\n").expect("writable");
        }
    }
    // Only below this folder, whatever it says of where its data are.
    if let Ok(dataset) = Dataset::open_with(&manifest, folder.path()) {
        for entry in dataset.entries.iter().take(10) {
            assert!(entry.source.load().is_err(), "there is no image");
            let _ = manifest.split.as_ref().map(|split| split.side(entry));
        }
    }
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
    let path = folder.path().join("out");
    golden().export(&path).expect("new");
    // Of layout 1: a fuzzer cannot guess a SHA-256.
    std::fs::remove_file(path.join("manifest.csv")).expect("there");
    let file = path.join("map.csv");
    let text = std::fs::read_to_string(&file).expect("there");
    std::fs::write(&file, text.replacen("layout,2", "layout,1", 1)).expect("writable");
    let name = EXPORTED[usize::from(first) % EXPORTED.len()];
    std::fs::write(path.join(name), bytes).expect("writable");
    if let Ok(snapshot) = Snapshot::import(&path) {
        assert!(snapshot.check().is_ok());
        let map = Map::create(folder.path().join("a.map"), snapshot.meta().clone()).expect("new");
        map.commit(&snapshot).expect("sound");
    }
}

/// What query forms are made for, as the first byte of an input of [`query_form`] numbers them; it
/// is not looked at otherwise, since a fuzzer gets behind the head of the file.
fn query_form_cfgs() -> [LocalizerConfig; 4] {
    let default = LocalizerConfig::preset(Preset::Default);
    // Quick to make anew, which is what most inputs lead to.
    let plain = (default.clone().with_score(Score::Inliers)).with_calibrated(false);
    [
        plain.clone(),
        plain.clone().with_method(Method::Freex),
        plain.with_method(Method::Static),
        default,
    ]
}

/// The query form beside a map: whatever it is, the map opens and answers.
pub(crate) fn query_form(bytes: &[u8]) {
    static FORMS: OnceLock<(tempfile::TempDir, Vec<PathBuf>)> = OnceLock::new();
    let (folder, forms) = FORMS.get_or_init(|| {
        let folder = folder();
        let map = folder.path().join("a.map");
        std::fs::copy(repository("maps/golden/format-2.map"), &map).expect("writable");
        let mut known = vec![map.clone()];
        for cfg in query_form_cfgs() {
            Localizer::open(&map, cfg).expect("a map");
            let entries = std::fs::read_dir(folder.path()).expect("readable");
            let mut files = entries.map(|entry| entry.expect("readable").path());
            let form = files.find(|file| !known.contains(file));
            known.push(form.expect("kept"));
        }
        (folder, known.split_off(1))
    });
    let Some(first) = bytes.first() else {
        return;
    };
    let number = usize::from(*first) % forms.len();
    std::fs::write(&forms[number], bytes).expect("writable");
    let cfg = query_form_cfgs()[number].clone();
    let localizer = Localizer::open(folder.path().join("a.map"), cfg).expect("a sound map");
    let mut scratch = localizer.scratch();
    for node in localizer.snapshot().nodes() {
        let query = Query::new(node.features())
            .at(Time::from_s(1_700_000_000))
            .with_image_size(localizer.snapshot().meta().image_size);
        drop(localizer.localize(&mut scratch, &query));
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

/// A series of times and states.
pub(crate) fn series(bytes: &[u8]) {
    let Ok(series) = Series::parse_csv(bytes, Columns::default()) else {
        return;
    };
    assert!(!series.is_empty());
    // Fitting takes time that grows with the samples.
    if series.len() <= 500 {
        let model = series.learn().expect("few samples");
        assert!((0.0..=1.0).contains(&model.p(Time::from_s(0))));
    }
}

/// A fitted model of visibility, as an index cache or a file of a user's own holds it.
pub(crate) fn visibility_model(bytes: &[u8]) {
    let Ok(model) = decode(bytes) else {
        return;
    };
    let mut p = vec![f64::NAN; model.num_features()];
    for time in [i64::MIN, -1, 0, 1_700_000_000_000_000, i64::MAX].map(Time::from_us) {
        model.predict_into(time, &mut p);
        assert!(p.iter().all(|p| (0.0..=1.0).contains(p)), "{p:?}");
    }
    assert!(model.encode().is_some_and(|again| decode(&again).is_ok()));
}

#[test]
fn inputs_that_were_once_worth_keeping_do_no_harm() {
    for (name, target) in TARGETS {
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
    Map::create(
        &path,
        chronotope::map::MapMeta::new(1, "star+brief", "default"),
    )
    .expect("new");
    map_file(&std::fs::read(path).expect("there"));
}
