//! A bag gives its images or an error, whatever its bytes.
//!
//! `fuzz/` runs [`bag`] on bytes that it makes up, the test on those that were once worth keeping.
#![allow(
    clippy::expect_used,
    reason = "a folder that cannot be written fails the test"
)]

use std::sync::Arc;

use chronotope::feature::DecodeLimits;
use chronotope::map::PlaceKey;
use chronotope_bags::{Bag, BagOptions, Places, Recording};

/// The names of the files, as the first byte of an input numbers them.
const NAMES: [&str; 5] = [
    "bag.mcap",
    "bag.db3",
    "bag.mcap.zstd",
    "bag.db3.zstd",
    "metadata.yaml",
];
/// Images of more pixels are not decoded: what they cost is known.
const MAX_PIXELS: u64 = 1 << 16;
/// So many images of a bag are loaded.
const NUM_LOADED: usize = 8;

fn folder() -> tempfile::TempDir {
    tempfile::tempdir_in("/dev/shm")
        .or_else(|_| tempfile::tempdir())
        .expect("temporary folder")
}

/// Reads all that there is to read of a bag: the first byte says of which kind, and whether its
/// places come from poses, transforms, a topic or are all one.
pub(crate) fn bag(bytes: &[u8]) {
    let Some((&first, bytes)) = bytes.split_first() else {
        return;
    };
    let folder = folder();
    let (kind, places) = (
        usize::from(first) % NAMES.len(),
        usize::from(first) / NAMES.len(),
    );
    std::fs::write(folder.path().join(NAMES[kind]), bytes).expect("written");
    let path = match NAMES[kind] {
        "metadata.yaml" => folder.path().to_owned(),
        name => folder.path().join(name),
    };
    let Ok(bag) = Bag::open(&path) else {
        return;
    };
    let bag = Arc::new(bag);
    let contents = bag.contents();
    if let Ok(contents) = &contents {
        for (topic, _) in &contents.topics {
            let _ = topic.message_type();
        }
    }
    let places = match places % 4 {
        0 => Places::One(PlaceKey::new("somewhere").expect("a name")),
        1 => Places::Poses(None),
        2 => Places::Transforms {
            fixed: "map".into(),
            child: "base_link".into(),
        },
        _ => Places::Topic("/place".into()),
    };
    let options =
        BagOptions::new(places).with_limits(DecodeLimits::default().with_max_pixels(MAX_PIXELS));
    let Ok(recording) = Recording::read(&bag, &options, None) else {
        return;
    };
    for entry in recording.dataset.entries.iter().take(NUM_LOADED) {
        let size = entry.source.size();
        if let (Ok(image), Ok(Some(size))) = (entry.source.load(), size) {
            assert_eq!(image.size(), size, "{}", entry.id);
        }
    }
}

#[test]
fn inputs_that_were_once_worth_keeping_do_no_harm() {
    let corpus = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/fuzz/bag");
    let mut num_inputs = 0;
    for entry in std::fs::read_dir(corpus).expect("a folder") {
        let bytes = std::fs::read(entry.expect("an input").path()).expect("readable");
        bag(&bytes);
        // Cut off and with a byte changed they are inputs, too.
        for share in 1..24 {
            bag(&bytes[..bytes.len() * share / 24]);
            let mut changed = bytes.clone();
            let at = changed.len() * share / 24;
            changed[at] ^= 0x41;
            bag(&changed);
        }
        num_inputs += 1;
    }
    assert!(num_inputs >= 6, "{num_inputs} inputs");
}
