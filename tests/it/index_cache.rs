//! Maps opened by way of the index cache beside them: the same answers, whatever became of that
//! file.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use chronotope::Time;
use chronotope::feature::{Descriptor, Features, Keypoint};
use chronotope::localize::{
    IndexCache, Localization, Localizer, LocalizerConfig, Method, PlaceSearch, Query,
};
use chronotope::map::{
    AppearanceUse, Map, MapMeta, Node, NodeId, PlaceKey, SessionId, Snapshot, Stamp, Visit, VisitId,
};
use chronotope::predict::Selection;
use chronotope::visibility::{BitRow, VisibilityConfig};

pub(crate) const NUM_FEATURES: usize = 30;
pub(crate) const NUM_VISITS: usize = 12;
const DAY_S: i64 = 86_400;

/// Steele, Lea and Flood's `SplitMix64`.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    fn features(&mut self, count: usize) -> Features {
        let mut features = Features::new();
        for _ in 0..count {
            let keypoint = Keypoint {
                x: (self.next() % 400) as f32 + 0.25,
                y: (self.next() % 300) as f32,
                size: 10.0,
                response: -1.5,
            };
            let descriptor = Descriptor(std::array::from_fn(|_| self.next()));
            features.push(keypoint, descriptor);
        }
        features
    }
}

/// Places whose features come and go with the months of a year.
pub(crate) fn map(num_places: usize) -> Snapshot {
    let mut random = Random(7);
    let mut snapshot = Snapshot::empty(MapMeta::new(5, "none", "default"));
    (snapshot.attach("a-note", [0, 159, 146, 150])).expect("a name");
    for place in 0..num_places {
        let mut node = Node::new(PlaceKey::new(&format!("p{place:03}")).expect("a key"));
        let all = random.features(NUM_FEATURES);
        let pose = (place % 2 == 0).then_some([place as f64 / 3.0, -1.0, 0.5]);
        node.set_pose(pose).expect("finite");
        for visit in 0..NUM_VISITS {
            let mut seen = BitRow::zeros(NUM_FEATURES);
            for feature in 0..NUM_FEATURES {
                let in_season = (visit + feature) % NUM_VISITS < NUM_VISITS / 2;
                if visit == 0 || in_season != random.next().is_multiple_of(8) {
                    seen.set(feature);
                }
            }
            let hidden = (visit == 3 && place == 1).then(|| {
                let mut hidden = BitRow::zeros(NUM_FEATURES);
                (0..NUM_FEATURES)
                    .filter(|&feature| !seen.get(feature))
                    .for_each(|feature| hidden.set(feature));
                hidden
            });
            let time = Time::from_s(1_700_000_000 + visit as i64 * 30 * DAY_S);
            // Two visits are experiences; the first locates in winter, the second in summer.
            let mut located_by = BitRow::zeros(1 + visit / 6);
            located_by.set(visit / 6);
            let kept = (visit % 3 == 0).then(|| {
                let seen: Vec<u32> = (0..NUM_FEATURES)
                    .filter(|&feature| seen.get(feature))
                    .map(|feature| feature as u32)
                    .collect();
                let mut appearance = random.features(3);
                appearance.append(&all, &seen);
                Arc::new(appearance)
            });
            let visit = Visit {
                id: VisitId((place * NUM_VISITS + visit) as u128),
                session: SessionId::derive("test"),
                time,
                source: format!("{place}/{visit}.png"),
                appearance: kept,
                appearance_use: match visit % 6 {
                    0 => AppearanceUse::Experience,
                    _ => AppearanceUse::Recognised,
                },
            };
            let born = if node.visits().is_empty() {
                all.clone()
            } else {
                Features::new()
            };
            (node.push_visit(visit, &born, seen, hidden, located_by)).expect("fits");
        }
        snapshot.push_node(node).expect("another place");
    }
    snapshot
}

/// A map file of so many places in a folder of its own.
fn stored(num_places: usize) -> (tempfile::TempDir, PathBuf, Map) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("town.chronotope");
    let snapshot = map(num_places);
    let map = Map::create(&path, snapshot.meta().clone()).expect("made");
    map.commit(&snapshot).expect("stored");
    (folder, path, map)
}

pub(crate) fn cfg() -> LocalizerConfig {
    LocalizerConfig::default().with_selection(Selection::top(12).expect("some"))
}

/// Every index cache in the folder of `map`.
fn index_caches(map: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(map.parent().expect("a folder")).expect("listed");
    let mut found: Vec<PathBuf> = entries
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path != map)
        .collect();
    found.sort();
    found
}

/// What a localizer says to views of some places in two seasons.
pub(crate) fn answers(localizer: &Localizer) -> Vec<Localization> {
    let nodes = localizer.snapshot().nodes();
    let mut scratch = localizer.scratch();
    let mut random = Random(99);
    let mut answers = Vec::new();
    for node in nodes.iter().step_by(nodes.len().div_ceil(8)) {
        for season in [0, 6] {
            let mut live = random.features(20);
            live.append(node.features(), &[1, 4, 9, 16, 25, 2, 8, 18]);
            let query = Query::new(&live).at(Time::from_s(1_740_000_000 + season * 30 * DAY_S));
            answers.push(localizer.localize(&mut scratch, &query).expect("fits"));
        }
    }
    answers
}

#[test]
fn a_map_opened_by_its_index_cache_gives_the_same_answers() {
    let large = [Method::Fused, Method::Fremen];
    for (num_places, candidates, methods) in [
        (300, PlaceSearch::Inverted, &large[..]),
        (20, PlaceSearch::Exact, &Method::ALL[..]),
    ] {
        let (_folder, path, map) = stored(num_places);
        for &method in methods {
            let cfg = cfg().with_place_search(candidates).with_method(method);
            let whole = Localizer::new(map.snapshot(), cfg.clone()).expect("fits");
            let expected = answers(&whole);
            let num_before = index_caches(&path).len();
            let cold = Localizer::open(&path, cfg.clone()).expect("opens");
            assert_eq!(answers(&cold), expected);
            assert_eq!(index_caches(&path).len(), num_before + 1);
            let warm = Localizer::open(&path, cfg).expect("opens");
            assert_eq!(answers(&warm), expected, "{candidates:?} {method}");
            // It was read from the index cache: that has no appearances, unless they are matched,
            // and everything else.
            let mut kept = Snapshot::clone(&map.snapshot());
            for (id, node) in (0..).map(NodeId).zip(map.snapshot().nodes()) {
                let mut node = Node::clone(node).into_parts();
                for visit in &mut node.visits {
                    visit.appearance = visit.appearance.take().filter(|_| !method.predicts());
                }
                let node = Node::from_parts(node).expect("in step");
                kept.replace_node(id, node).expect("the same place");
            }
            assert_eq!(**warm.snapshot(), kept);
            assert_eq!(warm.calibration(), whole.calibration());
            let model = |it: &Localizer| format!("{:?}", it.model(NodeId(1)));
            assert_eq!(model(&warm), model(&whole));
        }
    }
}

#[test]
fn the_models_of_the_test_have_rhythms() {
    let localizer = Localizer::new(Arc::new(map(2)), cfg()).expect("fits");
    let model = localizer.model(NodeId(0)).expect("predicts");
    assert!(model.order() > 0, "else nothing of them is put to the test");
}

#[test]
fn a_damaged_index_cache_is_made_anew() {
    damage_and_open(Method::Fremen);
}

#[test]
fn a_damaged_index_cache_with_appearances_is_made_anew() {
    damage_and_open(Method::Freex);
}

fn damage_and_open(method: Method) {
    let (_folder, path, map) = stored(3);
    let cfg = cfg().with_method(method).with_calibrated(false);
    let expected = answers(&Localizer::new(map.snapshot(), cfg.clone()).expect("fits"));
    Localizer::open(&path, cfg.clone()).expect("opens");
    let [file] = &index_caches(&path)[..] else {
        panic!("one index cache");
    };
    let whole = std::fs::read(file).expect("read");
    let check = |damaged: &[u8], what: &str| {
        std::fs::write(file, damaged).expect("written");
        let localizer = Localizer::open(&path, cfg.clone()).expect(what);
        assert_eq!(answers(&localizer), expected, "{what}");
        assert_eq!(std::fs::read(file).expect("read"), whole, "{what}");
    };
    let lengths = (0..80)
        .step_by(7)
        .chain((80..whole.len()).step_by(whole.len() / 40));
    for len in lengths {
        check(&whole[..len], &format!("{len} bytes"));
    }
    let positions = (0..64).chain((64..whole.len()).step_by(whole.len() / 80));
    for at in positions.chain([whole.len() - 1]) {
        let mut damaged = whole.clone();
        damaged[at] ^= 1 << (at % 8);
        check(&damaged, &format!("bit at {at}"));
    }
    let mut longer = whole.clone();
    longer.push(b' ');
    check(&longer, "longer");
}

#[test]
fn an_index_cache_of_another_generation_or_configuration_is_not_used() {
    let (folder, path, map) = stored(4);
    let neighbour = folder.path().join("town.chronotope.notes.query");
    std::fs::write(&neighbour, "mine").expect("written");
    Localizer::open(&path, cfg()).expect("opens");
    let old = index_caches(&path);
    let mut newer = Snapshot::clone(&map.snapshot());
    let time = Time::from_s(1_735_000_000);
    let mut seen = BitRow::zeros(NUM_FEATURES);
    (0..9).for_each(|feature| seen.set(feature));
    let visit = Visit {
        id: VisitId(999),
        session: SessionId::derive("later"),
        time,
        source: String::new(),
        appearance: None,
        appearance_use: AppearanceUse::Recognised,
    };
    let none = BitRow::zeros(2);
    (newer.push_visit(NodeId(2), visit, &Features::new(), seen, None, none)).expect("fits");
    let before = Stamp::read(&path).expect("read");
    map.commit(&newer).expect("stored");
    let after = Stamp::read(&path).expect("read");
    assert_eq!(after, Stamp::of(&map.snapshot()));
    assert_ne!(after, before);

    let expected = answers(&Localizer::new(map.snapshot(), cfg()).expect("fits"));
    for _ in 0..2 {
        let localizer = Localizer::open(&path, cfg()).expect("opens");
        assert_eq!(
            localizer.snapshot().nodes()[2].visits().len(),
            NUM_VISITS + 1
        );
        assert_eq!(answers(&localizer), expected);
    }
    let new = index_caches(&path);
    assert_eq!(new.len(), old.len(), "the old one is gone: {new:?}");
    assert!(new.contains(&neighbour), "nobody else's file is touched");

    let other = cfg().with_selection(Selection::top(5).expect("some"));
    let found = answers(&Localizer::open(&path, other.clone()).expect("opens"));
    let whole = Localizer::new(map.snapshot(), other).expect("fits");
    assert_eq!(found, answers(&whole));
    assert_ne!(found, expected);
    assert_eq!(index_caches(&path).len(), new.len() + 1);
}

#[test]
fn where_no_index_cache_can_be_written_the_map_opens_all_the_same() {
    let (_folder, path, map) = stored(3);
    let expected = answers(&Localizer::new(map.snapshot(), cfg()).expect("fits"));
    Localizer::open(&path, cfg()).expect("opens");
    let files = index_caches(&path);
    // A folder in its place can be neither read nor replaced; permissions would not stop the
    // superuser.
    std::fs::remove_file(&files[0]).expect("removed");
    std::fs::create_dir(&files[0]).expect("made");
    let localizer = Localizer::open(&path, cfg()).expect("opens");
    assert_eq!(answers(&localizer), expected);
    assert_eq!(index_caches(&path), files, "no part is left behind");
    assert!(files[0].is_dir());
}

#[test]
fn every_model_has_an_index_cache() {
    let (_folder, path, map) = stored(3);
    for (at, model) in [
        "kind = 'mean'",
        "kind = 'markov'",
        "kind = 'persistent', of = { kind = 'natural' }",
        "kind = 'histogram', period-s = 86400.0, num-bins = 6",
        "kind = 'logistic', candidates = { base-s = 86400.0, count = 3 }",
    ]
    .iter()
    .enumerate()
    {
        let model =
            VisibilityConfig::from_toml(&format!("model = {{ {model} }}")).expect("a model");
        let cfg = cfg().with_visibility(model);
        let expected = answers(&Localizer::new(map.snapshot(), cfg.clone()).expect("fits"));
        for _ in 0..2 {
            let localizer = Localizer::open(&path, cfg.clone()).expect("opens");
            assert_eq!(answers(&localizer), expected);
            assert_eq!(index_caches(&path).len(), 1 + at);
        }
    }
    let missing = Localizer::open(path.with_extension("none"), cfg()).expect_err("no map");
    assert!(missing.to_string().contains("town.none"), "{missing}");
}

#[test]
fn an_index_cache_is_kept_as_wished() {
    let (_folder, path, map) = stored(3);
    let expected = answers(&Localizer::new(map.snapshot(), cfg()).expect("fits"));
    let open = |form| {
        let localizer = Localizer::open_with(&path, cfg(), form).expect("opens");
        assert_eq!(answers(&localizer), expected, "{form}");
        let visits = localizer.snapshot().nodes()[0].visits();
        // What was read from an index cache has no appearances.
        visits[0].appearance.is_none()
    };
    // This map opens long before it would be worth it.
    for form in [IndexCache::Never, IndexCache::Auto] {
        assert!(!open(form), "{form}");
        assert!(index_caches(&path).is_empty(), "{form}");
    }
    assert!(!open(IndexCache::Always));
    let kept = index_caches(&path);
    assert_eq!(kept.len(), 1);
    assert!(open(IndexCache::Auto) && open(IndexCache::Always));
    assert!(!open(IndexCache::Never), "not even read");
    assert_eq!(index_caches(&path), kept);
    for form in IndexCache::ALL {
        assert_eq!(form.name().parse::<IndexCache>().expect("a name"), form);
    }
}

#[cfg(unix)]
#[test]
fn an_index_cache_has_the_rights_of_its_map_and_is_refused_with_others() {
    use std::os::unix::fs::{MetadataExt, PermissionsExt, chown};
    let (folder, path, map) = stored(3);
    let mode = |path: &Path| std::fs::metadata(path).expect("there").mode() & 0o777;
    let set_mode = |path: &Path, mode| {
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).expect("ours");
    };
    // What was read from an index cache has no appearances.
    let is_read = || {
        let localizer = Localizer::open(&path, cfg()).expect("opens");
        localizer.snapshot().nodes()[0].visits()[0]
            .appearance
            .is_none()
    };
    set_mode(&path, 0o600);
    assert!(!is_read());
    let file = index_caches(&path).remove(0);
    assert_eq!(mode(&file), 0o600, "it tells what the map tells");
    assert!(is_read());
    for more in [0o620, 0o602, 0o644] {
        set_mode(&file, more);
        assert!(!is_read(), "{more:o}: somebody else may write or read it");
        assert_eq!(mode(&file), 0o600, "{more:o}: it is made anew");
        assert!(is_read());
    }
    // Another name of a file of ours, and a link to one.
    let (other, whole) = (
        folder.path().join("other"),
        std::fs::read(&file).expect("read"),
    );
    std::fs::hard_link(&file, &other).expect("linked");
    assert!(!is_read());
    std::fs::write(&other, &whole).expect("written");
    std::fs::remove_file(&file).expect("removed");
    std::os::unix::fs::symlink(&other, &file).expect("linked");
    assert!(!is_read());
    std::fs::remove_file(&file).expect("removed");
    assert!(!is_read() && is_read());
    // Somebody else's, which only the superuser can give away.
    if chown(&file, Some(12_345), None).is_ok() {
        assert!(!is_read());
    }
    drop(map);
}

/// Rhythms are those of the clocks on walls where the map has a zone, but for the preset that is
/// as published, and the cache keeps them.
#[test]
fn the_zone_of_a_map_says_by_whose_clocks_it_is_predicted() {
    let (folder, ..) = stored(1);
    let in_zone = |name: &str, preset: &str, zone: Option<&str>| {
        let mut snapshot = map(1);
        let meta = MapMeta {
            preset: preset.into(),
            zone: zone.map(str::to_owned),
            ..snapshot.meta().clone()
        };
        snapshot.set_meta(meta).expect("can be stored");
        let path = folder.path().join(name);
        Map::create_from(&path, &snapshot).expect("a new file");
        path
    };
    let probabilities = |path: &Path, cache| {
        let localizer = Localizer::open_with(path, cfg(), cache).expect("fits");
        let model = localizer.model(NodeId(0)).expect("is predicted");
        let mut p = vec![0.0; NUM_FEATURES];
        model.predict_into(Time::from_s(1_710_000_000), &mut p);
        p
    };
    let utc = in_zone("utc.map", "default", None);
    let tokyo = in_zone("tokyo.map", "default", Some("Asia/Tokyo"));
    let literal = in_zone("literal.map", "lttl", Some("Asia/Tokyo"));
    let never = |path: &Path| probabilities(path, IndexCache::Never);
    assert_ne!(never(&utc), never(&tokyo), "phases of a day lie elsewhere");
    assert_eq!(never(&utc), never(&literal));
    let fresh = probabilities(&tokyo, IndexCache::Always);
    assert_eq!(fresh, never(&tokyo));
    assert_eq!(
        fresh,
        probabilities(&tokyo, IndexCache::Always),
        "from the cache"
    );

    let nowhere = in_zone("nowhere.map", "default", Some("Europe/Atlantis"));
    let error = Localizer::open_with(&nowhere, cfg(), IndexCache::Never).expect_err("sunk");
    assert!(error.to_string().contains("tzdata"), "{error}");
}
