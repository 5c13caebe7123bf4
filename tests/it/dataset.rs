//! Datasets: every layout, every bad input with its message, and the real data where it exists.

use std::fs;
use std::path::{Path, PathBuf};

use chronotope::Time;
use chronotope::dataset::{Clock, Dataset, Manifest};

/// A folder that is filled with files by the test.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self) -> &Path {
        self.0.path()
    }

    fn write(&self, name: &str, text: &str) -> &Self {
        let path = self.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
        self
    }

    /// A grey image of 40 x 30 px whose pixels depend on `seed`.
    fn image(&self, name: &str, seed: u8) -> &Self {
        let path = self.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        image::GrayImage::from_fn(40, 30, |x, y| {
            image::Luma([(x * 5 + y * 3) as u8 ^ seed.wrapping_mul(37)])
        })
        .save(path)
        .unwrap();
        self
    }

    /// The error of opening it, without the folder's own path.
    fn error(&self) -> String {
        let error = Dataset::open(self.path()).unwrap_err().to_string();
        error.replace(&format!("{}/", self.path().display()), "")
    }
}

fn time(text: &str) -> Time {
    Time::parse(text).unwrap()
}

fn ids(dataset: &Dataset) -> Vec<&str> {
    dataset
        .entries
        .iter()
        .map(|entry| entry.id.as_str())
        .collect()
}

fn problems(dataset: &Dataset) -> Vec<String> {
    dataset.problems.iter().map(ToString::to_string).collect()
}

const HEADER: &str = "place,time,path\n";

#[test]
fn an_index_gives_entries_in_order_of_time_then_place() {
    let folder = Folder::new();
    folder
        .image("images/a.png", 1)
        .image("images/b.png", 2)
        .image("images/c.png", 3)
        .write(
            "index.csv",
            "place,time,path\n\
             hall,2024-05-02T10:00:00Z,images/b.png\n\
             office,2024-05-01T12:00:00+02:00,images/c.png\n\
             hall,2024-05-01T10:00:00Z,images/a.png\n",
        );
    let dataset = Dataset::open(folder.path()).unwrap();
    assert_eq!(problems(&dataset), [""; 0]);
    assert_eq!(dataset.clock, Clock::Real);
    assert_eq!(
        ids(&dataset),
        ["images/a.png", "images/c.png", "images/b.png"]
    );
    assert_eq!(dataset.entries[1].time, time("2024-05-01T10:00:00Z"));
    let image = dataset.entries[0].source.load().unwrap();
    assert_eq!((image.width(), image.height()), (40, 30));
}
