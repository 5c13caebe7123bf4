//! Datasets: every layout, every bad input with its message, and the real data where it exists.

#![allow(clippy::unwrap_used, reason = "helpers of tests may panic like tests")]

use std::fs;
use std::path::{Path, PathBuf};

use chronotope::Time;
use chronotope::dataset::{Clock, Dataset, FileImage, ImageSource, Manifest, Side};
use chronotope::feature::{Rect, Rotation};
use chronotope::map::PlaceKey;

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

#[test]
fn crops_scales_and_shared_files_have_distinct_ids_and_sizes() {
    let folder = Folder::new();
    folder.image("a.png", 1).image("b.png", 2).write(
        "index.csv",
        "place,time,path,crop_x,crop_y,crop_w,crop_h,scale\n\
         v1,2024-05-01T10:00:00Z,a.png,0,0,20,10,2\n\
         v2,2024-05-01T10:00:00Z,a.png,20,20,20,10,\n\
         v1,2024-05-02T10:00:00Z,b.png,,,,,0.5\n",
    );
    let dataset = Dataset::open(folder.path()).unwrap();
    assert_eq!(problems(&dataset), [""; 0]);
    assert_eq!(ids(&dataset), ["a.png@v1", "a.png@v2", "b.png"]);
    let sizes: Vec<_> = dataset
        .entries
        .iter()
        .map(|entry| entry.source.load().unwrap())
        .map(|image| (image.width(), image.height()))
        .collect();
    assert_eq!(sizes, [(40, 20), (20, 10), (20, 15)]);
    assert_eq!(dataset.entries[0].source.recipe(), "crop 0,0,20,10 scale 2");
}

#[test]
fn edges_and_poses_are_read_and_what_has_no_image_is_listed() {
    let folder = Folder::new();
    folder
        .image("a.png", 1)
        .image("b.png", 2)
        .write(
            "index.csv",
            "place,time,path\nhall,2024-05-01T10:00:00Z,a.png\noffice,2024-05-01T10:01:00Z,b.png\n",
        )
        .write(
            "edges.csv",
            "from,to,name\nhall,office,door 1\noffice,cellar,stairs\n",
        )
        .write("poses.csv", "place,x,y,z\nhall,1.5,-2,0\nattic,0,0,9\n");
    let dataset = Dataset::open(folder.path()).unwrap();
    assert_eq!(dataset.edges.len(), 1);
    assert_eq!(dataset.edges[0].name, "door 1");
    assert_eq!(
        dataset.poses[&PlaceKey::new("hall").unwrap()],
        [1.5, -2.0, 0.0]
    );
    assert_eq!(
        problems(&dataset),
        [
            "edge office -> cellar: there is no image of the place `cellar` (help: correct the name or remove the edge)",
            "pose of `attic`: there is no image of this place (help: correct the name or remove the pose)",
        ]
    );
}

#[test]
fn poses_in_the_index_are_averaged_over_visits() {
    let folder = Folder::new();
    folder.image("a.png", 1).image("b.png", 2).write(
        "index.csv",
        "place,time,path,x,y,z\nhall,2024-05-01T10:00:00Z,a.png,1,2,3\nhall,2024-05-02T10:00:00Z,b.png,2,4,5\n",
    );
    let dataset = Dataset::open(folder.path()).unwrap();
    assert_eq!(
        dataset.poses[&PlaceKey::new("hall").unwrap()],
        [1.5, 3.0, 4.0]
    );
    folder.write("poses.csv", "place,x,y\nhall,1,2\n");
    assert_eq!(
        folder.error(),
        "poses.csv: poses are given twice: here and in the index or manifest (help: remove this file, or the columns x, y and z there)"
    );
}

#[test]
fn what_concerns_one_image_is_listed_and_the_rest_is_kept() {
    let folder = Folder::new();
    folder
        .image("a.png", 1)
        .image("b.png", 2)
        .write("empty.png", "")
        .write(
            "index.csv",
            "place,time,path,crop_x,crop_y,crop_w,crop_h\n\
             hall,2024-05-01T10:00:00Z,a.png,,,,\n\
             hall,2024-05-02T10:00:00Z,gone.png,,,,\n\
             hall,2024-05-03T10:00:00Z,b.png,30,0,20,10\n\
             hall,2024-05-04T10:00:00Z,b.png,-1,0,20,10\n\
             hall,2024-05-05T10:00:00Z,b.png,0,0,0,10\n\
             hall,2024-05-01T12:00:00+02:00,b.png,,,,\n\
             hall,2024-05-06T10:00:00Z,empty.png,,,,\n\
             hall,2024-05-07T10:00:00Z,b.png,0,0,40,30\n",
        );
    let dataset = Dataset::open(folder.path()).unwrap();
    assert_eq!(ids(&dataset), ["a.png", "b.png@hall"]);
    assert_eq!(
        problems(&dataset),
        [
            "index.csv line 3: the file `gone.png` does not exist (help: restore it, correct the path or remove the row)",
            "index.csv line 4: the crop 30,0,20,10 (x,y,w,h) is not inside the image `b.png` of 40 x 30 px (help: correct crop_x, crop_y, crop_w and crop_h)",
            "index.csv line 5: the crop -1,0,20,10 (x,y,w,h) is not inside the image `b.png` (help: correct crop_x, crop_y, crop_w and crop_h)",
            "index.csv line 6: the crop 0,0,0,10 (x,y,w,h) is not inside the image `b.png` of 40 x 30 px (help: correct crop_x, crop_y, crop_w and crop_h)",
            "index.csv line 7: a second image of `hall` at 2024-05-01T10:00:00Z; index.csv line 2 is kept (help: correct the place or the time, or remove one)",
            "index.csv line 8: the file `empty.png` is empty, 0 bytes (help: copy it again or remove its row)",
        ]
    );
}

#[test]
fn what_concerns_the_whole_index_is_an_error_with_line_value_and_remedy() {
    let cases = [
        (
            "place,time,path,colour\nhall,2024-05-01T10:00:00Z,a.png,red\n",
            "index.csv: line 1: unknown column `colour` (help: rename or remove it; the columns are place, time, path and, if wanted, crop_x, crop_y, crop_w, crop_h, scale, x, y, z)",
        ),
        (
            "place,path\nhall,a.png\n",
            "index.csv: line 1: the column `time` is missing (help: the columns are place, time, path and, if wanted, crop_x, crop_y, crop_w, crop_h, scale, x, y, z)",
        ),
        (
            "place,time,path,time\n",
            "index.csv: line 1: the column `time` appears twice (help: remove one of them)",
        ),
        (
            "place,time,path,crop_x,crop_y\n",
            "index.csv: the index lists no image (help: write one row for each image below the header)",
        ),
        (
            "place,time,path,crop_x,crop_y\nhall,2024-05-01T10:00:00Z,a.png,1,1\n",
            "index.csv: line 1: the column `crop_w`, `crop_h` is missing (help: write all of crop_x, crop_y, crop_w, crop_h, or none of them)",
        ),
        (
            "",
            "index.csv: line 1: the file has no header (help: name the columns in the first line: place, time, path and, if wanted, crop_x, crop_y, crop_w, crop_h, scale, x, y, z)",
        ),
        (
            "place,time,path\nhall,2024-05-01T10:00:00Z\n",
            "index.csv: line 2: 2 cells in this row, but the header has 3 columns (help: write every cell, even if empty, and quote a value that contains a comma)",
        ),
        (
            "place,time,path\n,2024-05-01T10:00:00Z,a.png\n",
            "index.csv: line 2, column `place`: the cell is empty (help: write the place or remove the row)",
        ),
        (
            "place,time,path,scale\nhall,2024-05-01T10:00:00Z,a.png,1\nhall,2024-05-02T10:00:00Z,a.png,-2\n",
            "index.csv: line 3, column `scale`: the scale -2 is not positive (help: write the factor by which to resize, or leave the cell empty for 1)",
        ),
        (
            "place,time,path,scale\nhall,2024-05-01T10:00:00Z,a.png,NaN\n",
            "index.csv: line 2, column `scale`: `NaN` is not a finite number",
        ),
        (
            "place,time,path,crop_x,crop_y,crop_w,crop_h\nhall,2024-05-01T10:00:00Z,a.png,1,2,,4\n",
            "index.csv: line 2, column `crop_w`: the crop is incomplete (help: write crop_x, crop_y, crop_w and crop_h, or none of them)",
        ),
        (
            "place,time,path,crop_x,crop_y,crop_w,crop_h\nhall,2024-05-01T10:00:00Z,a.png,1,2,3.5,4\n",
            "index.csv: line 2, column `crop_w`: `3.5` is not a whole number of pixels",
        ),
    ];
    for (index, message) in cases {
        let folder = Folder::new();
        folder.image("a.png", 1).write("index.csv", index);
        assert_eq!(folder.error(), message, "{index}");
    }
}

#[test]
fn a_bad_time_is_an_error_that_names_line_value_and_remedy() {
    for bad in [
        "2024-05-01",
        "2024-13-01T10:00:00Z",
        "yesterday",
        "2024-05-01 10:00",
    ] {
        let folder = Folder::new();
        folder.image("a.png", 1).write(
            "index.csv",
            &format!("{HEADER}hall,2024-05-01T10:00:00Z,a.png\nhall,{bad},a.png\n"),
        );
        let error = folder.error();
        assert!(
            error.starts_with(&format!(
                "index.csv: line 3, column `time`: bad time `{bad}`: "
            )),
            "{error}"
        );
        assert!(
            error.ends_with("(help: write RFC 3339 with an offset, such as 2009-10-15T12:00:00Z)"),
            "{error}"
        );
    }
}

#[test]
fn an_index_of_which_nothing_is_left_is_an_error() {
    let folder = Folder::new();
    folder.write(
        "index.csv",
        &format!("{HEADER}hall,2024-05-01T10:00:00Z,a.png\n"),
    );
    let error = Dataset::open(folder.path()).unwrap_err().to_string();
    assert!(
        error.contains("no image is left: 1 left out, the first because of index.csv line 2: the file `a.png` does not exist"),
        "{error}"
    );
}

#[test]
fn text_that_is_not_utf_8_is_an_error_and_a_byte_order_mark_is_not() {
    let folder = Folder::new();
    folder.image("a.png", 1);
    let mut bytes = b"place,time,path\nh\xe4ll,2024-05-01T10:00:00Z,a.png\n".to_vec();
    fs::write(folder.path().join("index.csv"), &bytes).unwrap();
    assert_eq!(
        folder.error(),
        "index.csv: line 2: the text is not UTF-8 (help: save the file as UTF-8)"
    );
    bytes = format!("\u{feff}{HEADER}hall,2024-05-01T10:00:00Z,a.png\r\n").into_bytes();
    fs::write(folder.path().join("index.csv"), bytes).unwrap();
    assert_eq!(Dataset::open(folder.path()).unwrap().entries.len(), 1);
}

#[test]
fn a_folder_that_is_no_dataset_says_what_to_do() {
    let folder = Folder::new();
    folder.image("x/photo.png", 1);
    let error = folder.error();
    assert!(
        error.ends_with(
            "no dataset: found no index.csv, no MMLL images (0101.png) and no training/place_N (help: write an index.csv with the header place,time,path)"
        ),
        "{error}"
    );
    folder.write("x/index.csv", HEADER);
    assert!(
        folder.error().ends_with("(help: name one dataset: x)"),
        "{}",
        folder.error()
    );
    let error = Dataset::open(&folder.path().join("nowhere"))
        .unwrap_err()
        .to_string();
    assert!(
        error.ends_with("(help: give a folder with an index.csv, or a manifest (*.toml))"),
        "{error}"
    );
    let error = Dataset::open(&folder.path().join("x/photo.png"))
        .unwrap_err()
        .to_string();
    assert!(
        error.ends_with("this is neither a folder nor a manifest (*.toml) (help: give the folder that contains index.csv)"),
        "{error}"
    );
}

#[test]
fn grief_images_are_numbered_by_visit_and_place() {
    let folder = Folder::new();
    for (number, name) in ["0101.ppm", "0102.ppm", "0201.png", "1202.jpg"]
        .iter()
        .enumerate()
    {
        folder.image(&format!("GRIEF/stromovka/images/{name}"), number as u8);
    }
    folder.image("GRIEF/stromovka/images/0201.webp", 9);
    folder.image("GRIEF/stromovka/images/cover.png", 9);
    let manifest = Manifest::find_builtin("stromovka").unwrap();
    // The folder of the set, and the one that contains it.
    for dir in ["GRIEF/stromovka", "GRIEF"] {
        let dataset = Dataset::open_with(&manifest, &folder.path().join(dir)).unwrap();
        assert_eq!(dataset.clock, Clock::Real);
        assert_eq!(
            ids(&dataset),
            [
                "images/0101.ppm",
                "images/0102.ppm",
                "images/0201.png",
                "images/1202.jpg"
            ]
        );
        assert_eq!(dataset.entries[0].place.as_str(), "loc1");
        assert_eq!(dataset.entries[1].place.as_str(), "loc2");
        assert_eq!(dataset.entries[2].time, time("2009-11-15T12:00:00Z"));
        assert_eq!(dataset.entries[3].time, time("2010-09-15T12:00:00Z"));
        assert_eq!(
            problems(&dataset),
            [
                "images/0201.webp: a second image of `loc1` at 2009-11-15T12:00:00Z; images/0201.png is kept (help: correct the place or the time, or remove one)",
                "images/cover.png: the name is not MMLL, visit and place with two digits each (help: rename or move it)",
                "stromovka: there is no image of the place `loc3` (help: complete the data)",
                "stromovka: there is no image of the place `loc4` (help: complete the data)",
                "stromovka: there is no image of the place `loc5` (help: complete the data)",
            ]
        );
    }
    // Without a manifest, numbers are no clock.
    let dataset = Dataset::open(&folder.path().join("GRIEF/stromovka")).unwrap();
    assert_eq!(dataset.clock, Clock::None);
    assert_eq!(dataset.entries.len(), 4);
}

#[test]
fn numbered_folders_are_read_as_witham_wharf_is_laid_out() {
    let folder = Folder::new();
    for place in 0..3 {
        for number in [0, 1, 143, 1007] {
            folder.image(
                &format!("brayford/training/place_{place}/{number:05}.bmp"),
                (place * 7 + number % 5) as u8,
            );
        }
        folder.image(
            &format!("brayford/testing/place_{place}/00006.bmp"),
            100 + place as u8,
        );
    }
    folder
        .image("brayford/training/place_0/7.bmp", 0)
        .image("brayford/training/map/00001.bmp", 0)
        .write("brayford/training/place_0/notes.txt", "not an image");
    let manifest = Manifest::find_builtin("witham_wharf").unwrap();
    let dataset = Dataset::open_with(&manifest, folder.path()).unwrap();
    assert_eq!(dataset.name, "witham_wharf");
    assert_eq!(dataset.clock, Clock::Real);
    assert_eq!(dataset.entries.len(), 15);
    let places: Vec<String> = dataset.places().iter().map(ToString::to_string).collect();
    assert_eq!(places, ["place_0", "place_1", "place_2"]);
    assert_eq!(dataset.entries[0].id, "training/place_0/00000.bmp");
    assert_eq!(dataset.entries[0].time, time("2013-11-11T00:00:00Z"));
    assert_eq!(dataset.entries[3].time, time("2013-11-11T00:10:00Z"));
    assert_eq!(dataset.entries[6].time, time("2013-11-11T23:50:00Z"));
    assert_eq!(dataset.entries[9].time, time("2013-11-17T23:50:00Z"));
    assert_eq!(dataset.entries[12].time, time("2013-11-25T01:00:00Z"));
    assert_eq!(
        problems(&dataset),
        [
            "training/map: the folder is not called place_N (help: rename or move it)",
            "training/place_0/7.bmp: the name is not the number of the image with five digits, as in 00042.bmp (help: rename or move it)",
        ]
    );
    let split = manifest.split.as_ref().unwrap();
    let sides: Vec<_> = dataset
        .entries
        .iter()
        .map(|entry| split.side(entry))
        .collect();
    assert_eq!(
        sides
            .iter()
            .filter(|&&side| side == Some(Side::Learn))
            .count(),
        12
    );
    assert_eq!(
        sides
            .iter()
            .filter(|&&side| side == Some(Side::Query))
            .count(),
        3
    );
}

#[test]
fn months_are_calendar_months_in_the_numbered_layout_too() {
    let folder = Folder::new();
    folder
        .image("training/place_0/00000.bmp", 1)
        .image("training/place_0/00011.bmp", 2);
    let manifest = Manifest::find_builtin("stromovka").unwrap();
    let dataset = Dataset::open_with(&manifest, folder.path()).unwrap();
    let found: Vec<_> = dataset
        .entries
        .iter()
        .map(|entry| (entry.place.as_str(), entry.time))
        .collect();
    assert_eq!(
        found,
        [
            ("loc1", time("2009-10-15T12:00:00Z")),
            ("loc1", time("2010-09-15T12:00:00Z")),
        ]
    );
}

#[test]
fn a_supported_dataset_that_is_not_there_says_where_to_get_it() {
    let folder = Folder::new();
    let manifest = Manifest::find_builtin("michigan").unwrap();
    let error = Dataset::open_with(&manifest, folder.path())
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("the dataset `michigan` is neither here nor in the folder `michigan` here: found no `index.csv` and no images MMLL.{ppm,png,webp,jpg} (help: to get the data: the GRIEF repository"),
        "{error}"
    );
    let error = Dataset::open_with(&manifest, &folder.path().join("x"))
        .unwrap_err()
        .to_string();
    assert!(
        error.ends_with("x: there is no such folder (help: give the folder of the dataset `michigan` or the one that contains it)"),
        "{error}"
    );
}

#[test]
fn ids_are_unique_even_if_a_file_is_called_like_an_id() {
    let folder = Folder::new();
    folder.image("a.png", 1).image("a.png@v1.png", 2).write(
        "index.csv",
        "place,time,path\n\
         v1,2024-05-01T10:00:00Z,a.png\n\
         v1,2024-05-02T10:00:00Z,a.png\n\
         v1.png,2024-05-03T10:00:00Z,a.png\n\
         v2,2024-05-04T10:00:00Z,a.png@v1.png\n",
    );
    assert_eq!(
        ids(&Dataset::open(folder.path()).unwrap()),
        [
            "a.png@v1@2024-05-01T10:00:00Z",
            "a.png@v1@2024-05-02T10:00:00Z",
            "a.png@v1.png",
            "a.png@v1.png+",
        ]
    );
}

/// Two sessions that drive along y = 0, one image a metre a second, facing east.
fn nclt_sessions(folder: &Folder) {
    for (session, start_s) in [
        ("2012-01-08", 1_326_030_975_i64),
        ("2012-06-15", 1_339_760_000),
    ] {
        let mut poses = vec![String::from("0,NaN,NaN,NaN,NaN,NaN,NaN")];
        for second in 0..12_i64 {
            let us = (start_s + second) * 1_000_000;
            // There and back again: 0..5, then 5..0.
            let x = if second < 6 { second } else { 11 - second };
            let yaw = if second < 6 {
                0.0
            } else {
                std::f64::consts::PI
            };
            poses.push(format!("{},{x}.0,0.25,-1.0,0.0,0.0,{yaw}", us + 1_000));
            for camera in [0, 5] {
                let image = format!("nclt/images/{session}/lb3/Cam{camera}/{us}.tiff");
                folder.image(&image, (second * 2 + camera) as u8);
            }
        }
        // An image long after the last pose.
        let late = (start_s + 60) * 1_000_000;
        folder.image(&format!("nclt/images/{session}/lb3/Cam5/{late}.tiff"), 99);
        folder.write(
            &format!("nclt/ground_truth/groundtruth_{session}.csv"),
            &poses.join("\n"),
        );
    }
    folder.write(
        "nclt/dataset.toml",
        r#"
        name = "nclt"
        [time]
        clock = "real"
        [[layout]]
        kind = "nclt"
        camera = 5
        radius_m = 1.5
        [[layout.place]]
        key = "bridge"
        x = 2.0
        y = 0.0
        [[layout.place]]
        key = "arch"
        x = 4.0
        y = 0.0
        heading_deg = -5.0
        "#,
    );
}

#[test]
fn nclt_sessions_give_one_image_for_each_pass_of_a_place() {
    let folder = Folder::new();
    nclt_sessions(&folder);
    let dataset = Dataset::open(&folder.path().join("nclt")).unwrap();
    assert_eq!(dataset.name, "nclt");
    let found: Vec<_> = dataset
        .entries
        .iter()
        .map(|entry| (entry.place.as_str(), entry.id.as_str()))
        .collect();
    assert_eq!(
        found,
        [
            ("bridge", "images/2012-01-08/lb3/Cam5/1326030977000000.tiff"),
            ("arch", "images/2012-01-08/lb3/Cam5/1326030979000000.tiff"),
            ("bridge", "images/2012-01-08/lb3/Cam5/1326030984000000.tiff"),
            ("bridge", "images/2012-06-15/lb3/Cam5/1339760002000000.tiff"),
            ("arch", "images/2012-06-15/lb3/Cam5/1339760004000000.tiff"),
            ("bridge", "images/2012-06-15/lb3/Cam5/1339760009000000.tiff"),
        ]
    );
    assert_eq!(
        dataset.entries[0].time,
        Time::from_us(1_326_030_977_000_000)
    );
    assert_eq!(
        dataset.poses[&PlaceKey::new("bridge").unwrap()],
        [2.0, 0.0, 0.0]
    );
    let image = dataset.entries[0].source.load().unwrap();
    assert_eq!(
        (image.width(), image.height()),
        (30, 40),
        "raw images lie on their side"
    );
    assert_eq!(
        problems(&dataset),
        [
            "session 2012-01-08: 1 of 13 images have no pose within 0.5 s (help: see that the ground truth is complete, or raise max_pose_gap_s)",
            "session 2012-06-15: 1 of 13 images have no pose within 0.5 s (help: see that the ground truth is complete, or raise max_pose_gap_s)",
        ]
    );
}

#[test]
fn nclt_sessions_without_truth_or_with_a_broken_one_are_named() {
    let folder = Folder::new();
    nclt_sessions(&folder);
    let truth = folder.path().join("nclt/ground_truth");
    fs::remove_file(truth.join("groundtruth_2012-01-08.csv")).unwrap();
    let dataset = Dataset::open(&folder.path().join("nclt")).unwrap();
    assert_eq!(dataset.entries.len(), 3);
    assert_eq!(
        problems(&dataset)[0],
        "session 2012-01-08: there is no groundtruth_2012-01-08.csv, so its images have no place (help: download the ground truth next to `images`)"
    );
    folder.write("nclt/ground_truth/groundtruth_2012-01-08.csv", "1,2,3\n");
    let error = Dataset::open(&folder.path().join("nclt"))
        .unwrap_err()
        .to_string();
    assert!(
        error.ends_with("groundtruth_2012-01-08.csv: line 1: 3 numbers instead of 7 (help: a row is utime,x,y,z,roll,pitch,yaw in µs, m and rad; download the file again)"),
        "{error}"
    );
    fs::remove_file(folder.path().join("nclt/dataset.toml")).unwrap();
    let error = Dataset::open(&folder.path().join("nclt"))
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("NCLT sessions need a dataset.toml"),
        "{error}"
    );
}

#[test]
fn built_in_manifests_are_complete_and_read_times_from_names() {
    for manifest in Manifest::builtin() {
        let manifest = manifest.unwrap();
        for text in [
            &manifest.title,
            &manifest.citation,
            &manifest.licence,
            &manifest.obtain,
        ] {
            assert!(!text.is_empty(), "{}", manifest.name);
        }
        assert!(!manifest.known_faults.is_empty(), "{}", manifest.name);
        assert!(Manifest::find_builtin(&manifest.name).is_ok());
    }
    let when = |dataset: &str, file: &str| {
        let manifest = Manifest::find_builtin(dataset).unwrap();
        manifest.time_from_name(file)
    };
    assert_eq!(
        when("planetarium", "images/0305.webp"),
        Some(time("2009-12-15T12:00:00Z"))
    );
    assert_eq!(
        when("lasvegas", "2023-06-13T03_11_46.jpg"),
        Some(time("2023-06-13T03:11:46Z"))
    );
    assert_eq!(
        when("tilde", "images/chamonix/20130502_071500.webp"),
        Some(time("2013-05-02T07:15:00Z"))
    );
    assert_eq!(when("tilde", "holiday.jpg"), None);
    assert_eq!(when("witham_wharf", "00001.bmp"), None);
    let error = Manifest::find_builtin("oxford").unwrap_err().to_string();
    assert_eq!(
        error,
        "no supported dataset is called `oxford` (help: choose one of stromovka, michigan, witham_wharf, lasvegas, tilde, floors, corridor, nclt, or give a folder with an index.csv or a manifest)"
    );
    let tilde = Manifest::find_builtin("tilde").unwrap();
    let zone = |place: &str| tilde.zone_of(&PlaceKey::new(place).unwrap());
    assert_eq!(zone("frankfurt"), Some("Europe/Berlin"));
    assert_eq!(zone("chamonix"), Some("Europe/Paris"));
}

#[test]
fn a_bad_manifest_says_where_and_what_helps() {
    let cases = [
        (
            "name = \"x\"\ncolour = 1\n[time]\nclock = \"real\"\n",
            "x.toml: line 2: unknown field `colour`",
        ),
        ("name = \"x\"\n", "missing field `time`"),
        (
            "name = \"a/b\"\n[time]\nclock = \"real\"\n",
            "name: `a/b` is no name for a dataset",
        ),
        (
            "name = \"x\"\n[time]\nclock = \"rael\"\n",
            "line 3: unknown variant `rael`",
        ),
        (
            "name = \"x\"\n[time]\nclock = \"real\"\norigin = \"2009\"\n",
            "line 4: bad time `2009`",
        ),
        (
            "name = \"x\"\n[time]\nclock = \"real\"\nzone = \"Europe/Prag\"\n",
            "time: `Europe/Prag` is no time zone (help: use an IANA name",
        ),
        (
            "name = \"x\"\n[time]\nclock = \"real\"\nfile_name = \"{visit:2}\"\n",
            "time.file_name: visit numbers need a time rule",
        ),
        (
            "name = \"x\"\n[time]\nclock = \"real\"\n[[layout]]\nkind = \"grief\"\n",
            "layout grief: visit numbers need a time rule",
        ),
        (
            "name = \"x\"\n[time]\nclock = \"real\"\nquantum = { seconds = 0 }\n",
            "time.quantum: the time between two visits is 0",
        ),
        (
            "name = \"x\"\n[time]\nclock = \"real\"\n[checksums]\nindex = \"12\"\n",
            "checksums: `12` is no SHA-256",
        ),
        (
            "name = \"x\"\n[time]\nclock = \"real\"\n[split]\nlearn_folder = \"a\"\n",
            "split: the split has only one side",
        ),
        (
            "name = \"x\"\n[time]\nclock = \"real\"\n[[layout]]\nkind = \"nclt\"\ncamera = 5\nradius_m = nan\nplace = []\n",
            "layout nclt: radius_m is NaN",
        ),
    ];
    for (text, message) in cases {
        let folder = Folder::new();
        folder.write("x.toml", text);
        let error = Manifest::load(&folder.path().join("x.toml"))
            .unwrap_err()
            .to_string();
        assert!(error.contains(message), "{error}");
        assert!(error.contains("x.toml: "), "{error}");
        assert!(error.contains("(help: "), "{error}");
    }
}

#[test]
fn a_manifest_next_to_the_data_names_it_masks_it_and_knows_its_places() {
    let folder = Folder::new();
    folder
        .image("data/a.png", 1)
        .image("data/b.png", 2)
        .write(
            "data/index.csv",
            "place,time,path,crop_x,crop_y,crop_w,crop_h,scale\nhall,2024-05-01T10:00:00Z,a.png,10,10,20,20,2\nhal,2024-05-02T10:00:00Z,b.png,,,,,\n",
        )
        .write(
            "mine.toml",
            "name = \"mine\"\ndata = \"data\"\nplaces = [\"hall\"]\n[time]\nclock = \"none\"\n[[mask]]\nx = 0\ny = 0\nwidth = 40\nheight = 12\n",
        );
    let dataset = Dataset::open(&folder.path().join("mine.toml")).unwrap();
    assert_eq!(
        (dataset.name.as_str(), dataset.clock),
        ("mine", Clock::None)
    );
    assert_eq!(
        problems(&dataset),
        [
            "index.csv line 3: the place `hal` is not in the manifest (help: correct it, or add it to `places`, which has hall)"
        ]
    );
    let mask = dataset.entries[0].source.mask(40, 40).unwrap().unwrap();
    // Rows 10 and 11 of the picture are rows 0 to 3 of the enlarged cut-out.
    assert_eq!(mask.row(3), [0; 40]);
    assert_eq!(mask.row(4), [255; 40]);
}

#[test]
fn a_turn_comes_before_the_crop() {
    let folder = Folder::new();
    folder.image("a.png", 1);
    let load = |image: FileImage| image.load().unwrap();
    let whole = load(FileImage::new(folder.path().join("a.png")));
    let turned = load(
        FileImage::new(folder.path().join("a.png"))
            .with_rotation(Rotation::Clockwise90)
            .with_crop(Some(Rect {
                x: 29,
                y: 0,
                width: 1,
                height: 40,
            })),
    );
    assert_eq!(
        turned.data(),
        whole.row(0),
        "clockwise: the top row becomes the right column"
    );
}

#[test]
fn checking_counts_finds_duplicates_and_lists_what_cannot_be_decoded() {
    let folder = Folder::new();
    folder
        .image("a.png", 1)
        .image("b.png", 1)
        .image("c.png", 3)
        .write("d.png", "this is no image")
        .write(
            "index.csv",
            &format!(
                "{HEADER}hall,2024-05-01T10:00:00Z,a.png\nhall,2024-05-02T10:00:00Z,b.png\n\
                 office,2024-05-01T10:00:00Z,c.png\noffice,2024-05-02T10:00:00Z,d.png\n\
                 office,2024-05-03T10:00:00Z,e.png\n"
            ),
        );
    let bytes = fs::read(folder.path().join("c.png")).unwrap();
    fs::write(folder.path().join("c.png"), &bytes[..bytes.len() / 2]).unwrap();
    let dataset = Dataset::open(folder.path()).unwrap();
    let calls = std::sync::atomic::AtomicUsize::new(0);
    let report = dataset.check(|_, total| {
        assert_eq!(total, 4);
        calls.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
    });
    assert_eq!(calls.into_inner(), 4);
    assert_eq!(
        (report.num_entries, report.num_readable, report.num_distinct),
        (4, 2, 1)
    );
    assert_eq!(report.duplicates, [["a.png", "b.png"]]);
    assert_eq!(report.visits.len(), 2);
    assert_eq!(report.image_sizes.len(), 1);
    assert_eq!(report.dataset_sha256, dataset.sha256());
    let subjects: Vec<_> = report
        .problems
        .iter()
        .map(|problem| problem.subject.as_str())
        .collect();
    assert_eq!(subjects, ["index.csv line 6", "c.png", "d.png"]);
    assert!(!report.is_clean());
    let text = report.to_string();
    assert!(
        text.contains("images    4 listed, 2 readable, 1 distinct"),
        "{text}"
    );
    assert!(text.contains("duplicate a.png = b.png"), "{text}");
    serde_json::to_string(&report).unwrap();
}

#[test]
fn the_digest_is_of_what_the_index_says_and_not_of_where_it_is() {
    let index = format!("{HEADER}hall,2024-05-01T10:00:00Z,a.png\n");
    let digest = |text: &str| {
        let folder = Folder::new();
        folder.image("a.png", 1).write("index.csv", text);
        Dataset::open(folder.path()).unwrap().sha256()
    };
    assert_eq!(digest(&index), digest(&index.replace('\n', "\r\n")));
    assert_ne!(digest(&index), digest(&index.replace("10:00", "10:01")));
    let scaled = "place,time,path,scale\nhall,2024-05-01T10:00:00Z,a.png,2\n";
    assert_ne!(digest(&index), digest(scaled));
}

#[test]
fn files_are_compared_with_the_checksums_of_folder_and_manifest() {
    let folder = Folder::new();
    folder
        .image("a.png", 1)
        .write("index.csv", &format!("{HEADER}hall,2024-05-01T10:00:00Z,a.png\n"))
        .write("SHA256SUMS", &format!("{}  a.png\n{}  gone.png\n", "0".repeat(64), "1".repeat(64)))
        .write(
            "dataset.toml",
            &format!(
                "name = \"mine\"\n[time]\nclock = \"real\"\n[checksums]\nof = \"my copy\"\nindex = \"{0}\"\nfiles = \"{0}\"\n",
                "2".repeat(64)
            ),
        );
    let (manifest, data_dir) = Manifest::locate(folder.path()).unwrap();
    let dataset = Dataset::open_with(&manifest, &data_dir).unwrap();
    let problems = manifest.verify(&dataset, &data_dir, |_, _| {}).unwrap();
    let subjects: Vec<_> = problems
        .iter()
        .map(|problem| problem.subject.as_str())
        .collect();
    assert_eq!(
        subjects,
        ["index.csv", "a.png", "gone.png", "the 1 image files"]
    );
    assert!(
        problems[0]
            .message
            .contains("as in the manifest, of my copy")
    );
    folder.write("SHA256SUMS", "hello\n");
    let error = manifest
        .verify(&dataset, &data_dir, |_, _| {})
        .unwrap_err()
        .to_string();
    assert!(
        error.ends_with("SHA256SUMS: line 1: no checksum and file name here (help: make the file with `sha256sum FILE... > SHA256SUMS`)"),
        "{error}"
    );
}

/// The folder with the real datasets, which only some machines have.
fn real_data() -> Option<PathBuf> {
    let root = std::env::var_os("CHRONOTOPE_DATA").map(PathBuf::from);
    if root.is_none() {
        eprintln!("skipped: CHRONOTOPE_DATA names no folder with the real datasets");
    }
    root
}

#[test]
fn real_data_sets_are_complete() {
    let Some(root) = real_data() else { return };
    for (name, num_entries, num_places, num_distinct, twins) in [
        ("stromovka", 60, 5, 60, Vec::new()),
        (
            "michigan",
            60,
            5,
            58,
            vec![
                vec!["images/1101.webp", "images/1201.webp"],
                vec!["images/1103.webp", "images/1203.webp"],
            ],
        ),
        ("tilde", 80, 2, 80, Vec::new()),
    ] {
        let manifest = Manifest::find_builtin(name).unwrap();
        let dataset = Dataset::open_with(&manifest, &root).unwrap();
        let report = dataset.check(|_, _| {});
        assert_eq!(report.problems, [], "{name}");
        assert_eq!(report.num_readable, num_entries, "{name}");
        assert_eq!(report.places.len(), num_places, "{name}");
        assert_eq!(report.num_distinct, num_distinct, "{name}");
        assert_eq!(report.duplicates, twins, "{name}");
        assert_eq!(
            manifest.verify(&dataset, &root, |_, _| {}).unwrap(),
            [],
            "{name}"
        );
        // Opened as a folder, it is recognised by its index.
        let (found, _) = Manifest::locate(&root.join(name)).unwrap();
        assert_eq!(found, manifest, "{name}");
        // The rule for file names agrees with the index.
        for entry in &dataset.entries {
            assert_eq!(
                manifest.time_from_name(&entry.id),
                Some(entry.time),
                "{}",
                entry.id
            );
        }
    }
}

#[test]
fn real_data_of_las_vegas_is_complete() {
    let Some(root) = real_data() else { return };
    let manifest = Manifest::find_builtin("lasvegas").unwrap();
    let dataset = Dataset::open_with(&manifest, &root).unwrap();
    assert_eq!(problems(&dataset), [""; 0]);
    assert_eq!(dataset.entries.len(), 6 * 774);
    for place in dataset.places() {
        let num = dataset
            .entries
            .iter()
            .filter(|entry| entry.place == place)
            .count();
        assert_eq!(num, 774, "{place}");
    }
    assert_eq!(manifest.verify(&dataset, &root, |_, _| {}).unwrap(), []);
    let split = manifest.split.as_ref().unwrap();
    let count = |side| {
        let of_side = |entry: &&chronotope::dataset::Entry| split.side(entry) == Some(side);
        dataset.entries.iter().filter(of_side).count()
    };
    assert_eq!(count(Side::Learn) + count(Side::Query), 6 * 774);
    for entry in dataset.entries.iter().step_by(199) {
        let image = entry.source.load().unwrap();
        assert_eq!((image.width(), image.height()), (640, 512), "{}", entry.id);
        let file = entry.id.split('@').next().unwrap();
        assert_eq!(manifest.time_from_name(file), Some(entry.time));
    }
    // Another dataset's folder is not taken for this one.
    let error = Dataset::open_with(&manifest, &root.join("tilde"))
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("this is the dataset `tilde`, not `lasvegas`"),
        "{error}"
    );
}

#[test]
fn the_readme_shows_a_manifest_and_an_index_that_can_be_read() {
    let readme =
        fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets/README.md"))
            .unwrap();
    let block = |language: &str| {
        let start = readme.find(&format!("```{language}\n")).unwrap() + language.len() + 4;
        readme[start..].split("```").next().unwrap().to_owned()
    };
    let folder = Folder::new();
    for number in ["0001", "0002", "0107", "0212"] {
        folder.image(&format!("images/{number}.jpg"), 1);
    }
    folder.write("index.csv", &block("csv"));
    let dataset = Dataset::open(folder.path()).unwrap();
    assert_eq!((dataset.entries.len(), dataset.problems.len()), (4, 0));
    let manifest = block("toml").replace("\"...\"                          # of", "\"\" # of");
    let sum = format!("\"{}\" # of", "0".repeat(64));
    folder.write("mine.toml", &manifest.replace("\"\" # of", &sum));
    let manifest = Manifest::load(&folder.path().join("mine.toml")).unwrap();
    assert_eq!(manifest.layout.len(), 4);
}
