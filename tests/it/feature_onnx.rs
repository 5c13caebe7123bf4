//! Features of a neural network: one that the tests write themselves.

use std::path::{Path, PathBuf};

use chronotope::dataset::synthetic::{Schedule, World, WorldConfig};
use chronotope::feature::{
    Extractor, ExtractorConfig, Features, GrayImage, Keypoint, ModelDigest, Models, OnnxConfig,
    Rect, mask_from_rects,
};
use chronotope::map::Map;
use chronotope::robot::{Robot, RobotConfig};
use chronotope::training::{Training, TrainingConfig};
use chronotope::{Error, ErrorKind};
use rayon::prelude::*;

use crate::feature::draw;
use crate::tiny_network::{STRIDE, TinyNetwork};

const WIDTH: usize = 448;
const HEIGHT: usize = 384;

/// A network's file in a folder, and how to look at its layer `waves`.
struct Fixture {
    folder: tempfile::TempDir,
    file: PathBuf,
    digest: ModelDigest,
}

impl Fixture {
    fn new(network: TinyNetwork) -> Self {
        let folder = tempfile::tempdir().expect("temporary");
        let (file, bytes) = (folder.path().join("eye.onnx"), network.to_bytes());
        std::fs::write(&file, &bytes).expect("written");
        Self {
            folder,
            file,
            digest: ModelDigest::of(&bytes),
        }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn models(&self) -> Models {
        Models::new().with_file(&self.file)
    }

    fn config(&self) -> OnnxConfig {
        OnnxConfig::new(self.digest, "waves")
            .with_input_size(WIDTH as u32, HEIGHT as u32)
            .with_normalization(vec![0.5; 3], vec![0.25; 3])
    }

    fn extractor(&self, config: OnnxConfig) -> Box<dyn Extractor> {
        let config = ExtractorConfig::Onnx(config);
        config.build_with(&self.models()).expect("a sound network")
    }
}

fn in_order(features: &Features) -> bool {
    let order = |k: &Keypoint| (-k.response, k.y, k.x);
    features.keypoints().is_sorted_by_key(order)
}

#[test]
fn cells_are_sorted_cut_masked_and_described() {
    let fixture = Fixture::new(TinyNetwork::default());
    let extractor = fixture.extractor(fixture.config().with_num_features(90));
    let picture = draw("noise", WIDTH, HEIGHT, 11);
    let features = extractor.extract(&picture, None).expect("extracts");
    assert_eq!(features.len(), 90);
    assert!(in_order(&features));
    // Cells of 8 x 8 px: the first one's centre lies between the pixels 3 and 4.
    for keypoint in features.keypoints() {
        assert_eq!(keypoint.x % STRIDE as f32, 3.5);
        assert_eq!(keypoint.y % STRIDE as f32, 3.5);
        assert_eq!(keypoint.size, STRIDE as f32);
        assert!(keypoint.response.is_finite() && keypoint.response > 0.0);
    }
    let unused = |descriptor: &chronotope::feature::Descriptor| descriptor.0[2..] == [0, 0];
    assert!(features.descriptors().iter().all(unused), "128 of 256 bits");

    let all = fixture.extractor(fixture.config().with_num_features(usize::MAX));
    let all = all.extract(&picture, None).expect("extracts");
    assert_eq!(all.len(), (WIDTH * HEIGHT) / (STRIDE * STRIDE) as usize);
    assert_eq!(&all.keypoints()[..90], features.keypoints());
    let spread = fixture.extractor(fixture.config().with_suppress_cells(3));
    let spread = spread.extract(&picture, None).expect("extracts");
    assert!(spread.len() < all.len() / 4 && in_order(&spread));

    let right_half = Rect {
        x: WIDTH as u32 / 2,
        y: 0,
        width: WIDTH as u32 / 2,
        height: HEIGHT as u32,
    };
    let mask = mask_from_rects(WIDTH, HEIGHT, &[right_half]).expect("inside");
    let left = extractor.extract(&picture, Some(&mask)).expect("extracts");
    assert_eq!(left.len(), 90);
    assert!((left.keypoints().iter()).all(|point| point.x < WIDTH as f32 / 2.0));
    let error = (extractor.extract(&picture, Some(&draw("noise", 64, 64, 1)))).expect_err("size");
    assert_eq!(error.kind(), ErrorKind::Shape);
}

#[test]
fn an_image_too_small_or_of_one_grey_gives_nothing() {
    let fixture = Fixture::new(TinyNetwork::default());
    let extractor = fixture.extractor(fixture.config());
    let mut features = Features::new();
    for (width, height, level) in [(0, 0, 0), (55, 400, 9), (400, 47, 9), (448, 384, 0)] {
        let image = GrayImage::new(width, height, vec![level; width * height]).expect("fits");
        (extractor.extract_into(image.view(), None, &mut features)).expect("sound");
        assert!(features.is_empty(), "{width} x {height}");
    }
    let noise = (0..WIDTH * HEIGHT).map(|i| 100 + (i * i % 7) as u8);
    let noise = GrayImage::new(WIDTH, HEIGHT, noise.collect()).expect("fits");
    assert!(extractor.extract(&noise, None).expect("sound").is_empty());
    let hidden = GrayImage::new(WIDTH, HEIGHT, vec![0; WIDTH * HEIGHT]).expect("fits");
    let picture = draw("noise", WIDTH, HEIGHT, 3);
    let found = extractor.extract(&picture, Some(&hidden)).expect("sound");
    assert!(found.is_empty());
}

#[test]
fn the_same_bits_for_any_number_of_threads_and_from_the_id_alone() {
    let fixture = Fixture::new(TinyNetwork::default());
    let extractor = fixture.extractor(fixture.config().with_model(None));
    assert!(extractor.id().contains(&fixture.digest.to_string()));
    let pictures: Vec<GrayImage> = (1..=8).map(|seed| draw("noise", 320, 240, seed)).collect();
    let one_by_one: Vec<Features> = (pictures.iter())
        .map(|picture| extractor.extract(picture, None).expect("extracts"))
        .collect();
    assert!(one_by_one.iter().all(|features| !features.is_empty()));

    let named = fixture.path(&format!("{}.onnx", fixture.digest));
    std::fs::rename(&fixture.file, named).expect("renamed");
    let again = ExtractorConfig::from_id(&extractor.id()).expect("its own id");
    let models = Models::new().with_folder(fixture.folder.path());
    let again = again.build_with(&models).expect("found by its digest");
    assert_eq!(again.id(), extractor.id());
    let pool = rayon::ThreadPoolBuilder::new().num_threads(4);
    let at_once: Vec<Features> = pool.build().expect("threads").install(|| {
        (pictures.par_iter())
            .map(|picture| again.extract(picture, None).expect("extracts"))
            .collect()
    });
    assert_eq!(at_once, one_by_one);
}

#[test]
fn a_camera_that_moved_by_cells_sees_the_same_bits_moved() {
    let fixture = Fixture::new(TinyNetwork::default());
    let extractor = fixture.extractor(fixture.config().with_num_features(usize::MAX));
    let picture = draw("noise", WIDTH + 64, HEIGHT, 5);
    let window = |x: u32| {
        let rect = Rect {
            x,
            y: 0,
            width: WIDTH as u32,
            height: HEIGHT as u32,
        };
        let image = picture.cropped(rect).expect("inside");
        extractor.extract(&image, None).expect("extracts")
    };
    let (before, after) = (window(0), window(64));
    let (mut num_same, mut num_bits) = (0, 0);
    for (keypoint, bits) in after.keypoints().iter().zip(after.descriptors()) {
        let is_it = |other: &&Keypoint| other.x == keypoint.x + 64.0 && other.y == keypoint.y;
        let inner = (32.0..WIDTH as f32 - 96.0).contains(&keypoint.x);
        let Some(other) = before
            .keypoints()
            .iter()
            .position(|other| is_it(&other))
            .filter(|_| inner)
        else {
            continue;
        };
        num_bits += bits.distance_bits(&before.descriptors()[other]);
        num_same += 1;
    }
    // The image as a whole is another one, by which channels are standardised.
    let mean_bits = f64::from(num_bits) / f64::from(num_same);
    assert!(num_same > 1_000 && mean_bits < 10.0, "{mean_bits} bits");
}

#[test]
fn a_map_of_learned_features_locates_and_knows_its_model() {
    let fixture = Fixture::new(TinyNetwork::default());
    let world = World::new(&WorldConfig::new(7).with_num_places(3)).expect("valid");
    let schedule = Schedule::standard(7, 8, 1);
    let path = fixture.path("street.map");
    let cfg = TrainingConfig::default()
        .with_extractor(Some(ExtractorConfig::Onnx(
            fixture.config().with_model(None),
        )))
        .with_models(fixture.models());
    let dataset = world.dataset("learn", &schedule.learn);
    let mut training = Training::to_build_from(dataset, &path, &cfg).expect("a new map");
    assert!(training.learn(&|| false, &mut |_| {}).expect("learns"));
    training.finish().expect("a map");
    drop(training);

    let robot = |models: Models| Robot::open(&path, RobotConfig::default().with_models(models));
    let mut located = robot(fixture.models()).expect("its model is there");
    let mut num_right = 0;
    // The street's places look alike on purpose, and so rough a network knows only what it has seen.
    let queries = world.dataset("again", &schedule.learn).entries;
    for entry in &queries {
        let image = entry.source.load().expect("rendered");
        let answer = located.see(&image, entry.time).expect("fits");
        let first = answer.ranking[0].node;
        let first = located.localizer().snapshot().node(first).key();
        num_right += usize::from(*first == entry.place);
    }
    assert!(
        num_right * 10 >= queries.len() * 8,
        "{num_right} of {}",
        queries.len()
    );

    // Without its model the map opens, but nothing can be asked of it.
    let map = Map::open(&path).expect("opens");
    assert!(
        map.snapshot()
            .meta()
            .extractor
            .contains(&fixture.digest.to_string())
    );
    let error = robot(Models::new()).expect_err("no model");
    assert_eq!(
        (error.kind(), error.path()),
        (ErrorKind::NotFound, Some(&*path))
    );
    let other = Fixture::new(TinyNetwork {
        gain: 2.0,
        ..TinyNetwork::default()
    });
    let error = robot(other.models()).expect_err("another model");
    assert_eq!(
        (error.kind(), error.path()),
        (ErrorKind::NotFound, Some(&*other.file))
    );
    let told = error.to_string();
    assert!(
        told.contains(&other.digest.to_string()) && told.contains("CHRONOTOPE_MODELS"),
        "{told}"
    );
}

/// What building fails with.
fn refused(file: &Path, config: OnnxConfig) -> Error {
    let models = Models::new().with_file(file);
    let built = ExtractorConfig::Onnx(config).build_with(&models);
    let error = built.err().expect("nothing to extract with");
    assert_eq!(error.path(), Some(file), "{error}");
    error
}

#[test]
fn what_is_no_usable_network_is_named_with_a_remedy() {
    let fixture = Fixture::new(TinyNetwork::default());
    let config = || fixture.config().with_model(None);
    let write = |name: &str, bytes: &[u8]| {
        let path = fixture.path(name);
        std::fs::write(&path, bytes).expect("written");
        path
    };
    let network = |change: fn(&mut TinyNetwork)| {
        let mut network = TinyNetwork::default();
        change(&mut network);
        network.to_bytes()
    };
    let layers = "waves (24 channels, 56 x 48), rectified (24 channels, 56 x 48)";
    for (file, config, kind, said) in [
        (
            write("empty", b""),
            config(),
            ErrorKind::Format,
            "no ONNX model",
        ),
        (
            write("text", b"not a network"),
            config(),
            ErrorKind::Format,
            "no ONNX model",
        ),
        (
            fixture.file.clone(),
            config().with_layer("relu"),
            ErrorKind::Config,
            layers,
        ),
        (
            fixture.file.clone(),
            config().with_layer(""),
            ErrorKind::Config,
            layers,
        ),
        (
            fixture.file.clone(),
            config().with_layer("flat"),
            ErrorKind::Config,
            "no grid of cells",
        ),
        (
            fixture.file.clone(),
            config().with_layer("mean"),
            ErrorKind::Config,
            "only 1 x 1 cells",
        ),
        (
            fixture.file.clone(),
            config().with_normalization(vec![0.5], vec![0.5]),
            ErrorKind::Shape,
            "shape (1, 3, ?, ?), not (1, 1, height, width)",
        ),
        (
            write("two", &network(|it| it.num_inputs = 2)),
            config(),
            ErrorKind::Shape,
            "2 inputs",
        ),
        (
            write("nan", &network(|it| it.gain = f32::NAN)),
            config(),
            ErrorKind::Format,
            "no number",
        ),
        (
            write("large", &network(|it| it.gain = f32::MAX)),
            config(),
            ErrorKind::Format,
            "layer `waves`",
        ),
    ] {
        let error = refused(&file, config);
        assert_eq!(error.kind(), kind, "{error}");
        assert!(error.to_string().contains(said), "{error}");
        assert!(error.help().is_some(), "{error}");
    }
    // The name of a node does as well as that of its output.
    drop(fixture.extractor(config().with_layer("the waves")));
    let error = ExtractorConfig::Onnx(config().with_num_bits(0)).build_with(&fixture.models());
    assert_eq!(error.err().expect("no bits").kind(), ErrorKind::Config);
}

#[test]
fn a_network_of_grey_images_takes_one_channel() {
    let fixture = Fixture::new(TinyNetwork {
        input_channels: 1,
        ..TinyNetwork::default()
    });
    let config = fixture.config().with_normalization(vec![0.5], vec![0.25]);
    let found = fixture
        .extractor(config)
        .extract(&draw("noise", 320, 240, 4), None);
    assert!(!found.expect("extracts").is_empty());
}

#[test]
fn a_damaged_network_is_an_error_or_a_network_and_never_a_panic() {
    let fixture = Fixture::new(TinyNetwork::default());
    let bytes = TinyNetwork::default().to_bytes();
    let small = || (fixture.config().with_model(None)).with_input_size(64, 64);
    let try_it = |bytes: &[u8]| {
        std::fs::write(&fixture.file, bytes).expect("written");
        drop(ExtractorConfig::Onnx(small()).build_with(&fixture.models()));
    };
    for end in (0..400)
        .step_by(9)
        .chain([bytes.len() / 2, bytes.len() - 1])
    {
        try_it(&bytes[..end]);
    }
    // Nodes and names come first, kernels and shapes last.
    let ends = (0..260).chain(bytes.len() - 120..bytes.len());
    for (at, bit) in ends.map(|at| (at, at % 8)) {
        let mut damaged = bytes.clone();
        damaged[at] ^= 1 << bit;
        try_it(&damaged);
    }
}
