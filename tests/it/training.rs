//! Training: does it matter where a dataset's images come from?

#![allow(clippy::unwrap_used, reason = "helpers of tests may panic like tests")]

use std::fmt::Write as _;
use std::fs;

use chronotope::Time;
use chronotope::dataset::synthetic::{World, WorldConfig};
use chronotope::map::Map;
use chronotope::training::{Training, TrainingConfig};

#[test]
fn images_in_memory_give_the_places_of_the_same_images_in_a_folder() {
    let folder = tempfile::tempdir().unwrap();
    let world = World::new(&WorldConfig::new(3).with_num_places(2)).unwrap();
    let times = [0, 9, 17].map(|hour| Time::from_s(1_700_000_000 + hour * 3_600));
    let mut dataset = world.dataset("street", &times);
    // The folder has no poses.csv.
    dataset.poses.clear();

    let street = folder.path().join("street");
    let mut index = String::from("path,place,time\n");
    for entry in &dataset.entries {
        let path = street.join(&entry.id);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        let image = entry.source.load().unwrap();
        let head = format!("P5\n{} {}\n255\n", image.width(), image.height());
        fs::write(path, [head.as_bytes(), image.data()].concat()).unwrap();
        writeln!(index, "{},{},{}", entry.id, entry.place, entry.time).unwrap();
    }
    fs::write(street.join("index.csv"), index).unwrap();

    let cfg = TrainingConfig::default();
    let train = |mut training: Training| {
        assert!(training.learn(&|| false, &mut |_| {}).unwrap());
        let snapshot = training.finish().unwrap();
        (snapshot, training.report().num_learnt)
    };
    let (of_folder, _) =
        train(Training::to_build(&street, &folder.path().join("a.map"), &cfg).unwrap());
    let out = folder.path().join("b.map");
    let (in_memory, num_learnt) =
        train(Training::to_build_from(dataset.clone(), &out, &cfg).unwrap());
    assert_eq!(num_learnt, dataset.entries.len());
    assert_eq!(in_memory.nodes(), of_folder.nodes());

    let map = Map::open(&out).unwrap();
    let (again, num_learnt) = train(Training::to_update_from(map, dataset, &cfg).unwrap());
    assert_eq!(num_learnt, 0);
    assert_eq!(again.nodes(), in_memory.nodes());
}
