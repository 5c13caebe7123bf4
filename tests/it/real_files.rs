//! What files of real cameras, phones and programs did wrong, one kind a test.
//!
//! A test is named after the public report of the kind that it stands for.

use std::path::PathBuf;

use chronotope::Time;
use chronotope::dataset::{
    Dataset, FileIdentity, ImageSource, Lookup, Manifest, ReadOptions, exif_time,
};
use chronotope::feature::image_file::decode_gray;
use chronotope::feature::{DecodeLimits, GrayImage};
use fremen::time::Zone;

fn decode(bytes: &[u8]) -> chronotope::Result<GrayImage> {
    decode_gray(bytes, &DecodeLimits::default())
}

/// Why a picture is refused.
fn refusal(bytes: &[u8]) -> String {
    let text = decode(bytes)
        .expect_err("must not be taken for whole")
        .to_string();
    assert!(text.contains("help:"), "{text}");
    text
}

/// A picture with something to code in every block.
fn noise(width: u32, height: u32) -> image::DynamicImage {
    let mut state = 7_u32;
    image::RgbImage::from_fn(width, height, |x, y| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let level = (x * 3 + y * 5 + (state >> 27)) as u8;
        image::Rgb([level, level / 2 + 40, 255 - level])
    })
    .into()
}

fn encoded(format: image::ImageFormat) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    noise(150, 90)
        .write_to(&mut bytes, format)
        .expect("encodes");
    bytes.into_inner()
}

fn jpeg() -> Vec<u8> {
    encoded(image::ImageFormat::Jpeg)
}

/// A progressive JPEG of 40 x 24 px.
const PROGRESSIVE: &[u8] = include_bytes!("../data/pictures/progressive.jpg");

/// Where the coded data begin and end.
fn scan(jpeg: &[u8]) -> std::ops::Range<usize> {
    let start = jpeg
        .windows(2)
        .position(|pair| pair == [0xFF, 0xDA])
        .expect("a scan");
    start + 2 + usize::from(jpeg[start + 3])..jpeg.len() - 2
}

#[test]
fn libjxl_3502_what_follows_a_whole_picture_does_not_count() {
    for whole in [jpeg(), PROGRESSIVE.to_vec()] {
        let picture = decode(&whole).expect("whole");
        let film: Vec<u8> = (0..5_000_u32).map(|i| ((i * i) >> 3) as u8).collect();
        for trailer in [
            &[0; 700][..],
            b"\xFF\xDA and so on",
            b"\xFF\xD8\xFF\xE0",
            &whole[..whole.len() / 2],
            &film,
        ] {
            let with = [&whole, trailer].concat();
            assert!(decode(&with).expect("whole") == picture);
        }
    }
    for format in [image::ImageFormat::Png, image::ImageFormat::WebP] {
        let whole = encoded(format);
        let with = [&whole[..], b"and a word"].concat();
        assert!(decode(&with).expect("whole") == decode(&whole).expect("whole"));
    }
}

#[test]
fn opencv_17862_a_picture_that_is_damaged_inside_is_refused() {
    for whole in [jpeg(), PROGRESSIVE.to_vec()] {
        let scan = scan(&whole);
        let middle = scan.start + scan.len() / 2;
        let end = [0xFF, 0xD9];
        // Cut, and an end marker written behind it.
        refusal(&[&whole[..middle], &end].concat());
        // Bytes of the middle are lost.
        refusal(&[&whole[..middle - 40], &whole[middle + 40..]].concat());
        // The second half was never written.
        let mut zeros = whole.clone();
        zeros[middle..scan.end].fill(0);
        refusal(&zeros);
        // No end, and no more than a header.
        assert!(refusal(&whole[..middle]).contains("truncated"));
        refusal(&whole[..scan.start]);
    }
}

#[test]
fn opencv_9477_some_padding_before_the_end_is_no_damage() {
    let whole = jpeg();
    let end = whole.len() - 2;
    let padded = [&whole[..end], &[0; 6], &whole[end..]].concat();
    assert!(decode(&padded).expect("whole") == decode(&whole).expect("whole"));
    let filled = [&whole[..end], &[0xFF; 9], &whole[end..]].concat();
    assert!(decode(&filled).is_ok());
}

#[test]
fn opencv_6468_a_tail_that_was_never_written_is_refused_in_every_packed_format() {
    use image::ImageFormat::{Png, WebP};
    for format in [Png, WebP] {
        let mut whole = encoded(format);
        let half = whole.len() / 2;
        whole[half..].fill(0);
        refusal(&whole);
    }
    // One wrong bit of a PNG.
    let mut png = encoded(Png);
    let middle = png.len() / 2;
    png[middle] ^= 16;
    assert!(refusal(&png).contains("damaged"));
}

#[test]
fn zune_image_136_a_frame_without_huffman_tables_means_the_usual_ones() {
    let whole = jpeg();
    let mut frame = Vec::new();
    let mut at = 2;
    frame.extend(&whole[..2]);
    while whole[at + 1] != 0xDA {
        let len = usize::from(whole[at + 2]) << 8 | usize::from(whole[at + 3]);
        if whole[at + 1] != 0xC4 {
            frame.extend(&whole[at..at + 2 + len]);
        }
        at += 2 + len;
    }
    frame.extend(&whole[at..]);
    assert!(frame.len() + 400 < whole.len());
    assert!(decode(&frame).expect("whole") == decode(&whole).expect("whole"));
}

#[test]
fn jpeg_decoder_76_kinds_that_are_not_read_are_named_with_the_remedy() {
    let whole = jpeg();
    let frame = whole
        .windows(2)
        .position(|pair| pair == [0xFF, 0xC0])
        .expect("a frame");
    for (at, byte, words) in [
        (frame + 4, 12, "12 bits"),
        (frame + 1, 0xC3, "lossless"),
        (frame + 1, 0xF7, "JPEG-LS"),
        (frame + 1, 0xC9, "arithmetic"),
        (frame + 1, 0xC5, "hierarchical"),
    ] {
        let mut other = whole.clone();
        other[at] = byte;
        let text = refusal(&other);
        assert!(text.contains(words) && text.contains("convert"), "{text}");
    }
}

#[test]
fn scancode_toolkit_4158_a_pointer_of_git_lfs_is_named() {
    let pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n";
    assert!(refusal(pointer).contains("git lfs pull"));
}

/// A directory of a little-endian TIFF: entries of (tag, kind, count, value), without the pointer to
/// the next one.
fn directory(entries: &[(u16, u16, u32, u32)]) -> Vec<u8> {
    let mut bytes = (entries.len() as u16).to_le_bytes().to_vec();
    for (tag, kind, count, value) in entries {
        bytes.extend(tag.to_le_bytes());
        bytes.extend(kind.to_le_bytes());
        bytes.extend(count.to_le_bytes());
        bytes.extend(value.to_le_bytes());
    }
    bytes
}

/// A JPEG with an EXIF block: the main directory at 8, others and texts at the places given.
fn with_exif(parts: &[(usize, Vec<u8>)]) -> (tempfile::TempDir, PathBuf) {
    let len = parts
        .iter()
        .map(|(at, bytes)| at + bytes.len())
        .max()
        .unwrap_or(8);
    let mut tiff = vec![0; len];
    tiff[..8].copy_from_slice(b"II*\0\x08\0\0\0");
    for (at, bytes) in parts {
        tiff[*at..at + bytes.len()].copy_from_slice(bytes);
    }
    let whole = jpeg();
    let mut bytes = whole[..2].to_vec();
    bytes.extend([0xFF, 0xE1]);
    bytes.extend(((tiff.len() + 8) as u16).to_be_bytes());
    bytes.extend(b"Exif\0\0");
    bytes.extend(tiff);
    bytes.extend(&whole[2..]);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.jpg");
    std::fs::write(&path, bytes).expect("writable");
    (folder, path)
}

fn exif_of(parts: &[(usize, Vec<u8>)], zone: Option<&Zone>) -> Option<String> {
    let (_folder, path) = with_exif(parts);
    exif_time(&path, zone)
        .expect("readable")
        .map(|time| time.to_string())
}

const POINTER: (u16, u16, u32, u32) = (0x8769, 4, 1, 100);
const DATE: (u16, u16, u32, u32) = (0x9003, 2, 20, 200);
const OFFSET: (u16, u16, u32, u32) = (0x9011, 2, 7, 220);

fn texts(date: &str) -> (usize, Vec<u8>) {
    (200, format!("{date}\0+02:00\0").into_bytes())
}

#[test]
fn exif_rs_31_directories_that_are_not_to_the_letter_are_read_all_the_same() {
    let nine = Some("2024-05-02T09:00:00Z".to_owned());
    let date = texts("2024:05:02 11:00:00");
    let main = (8, directory(&[POINTER]));
    let camera = (100, directory(&[DATE, OFFSET]));
    assert_eq!(
        exif_of(&[main.clone(), camera.clone(), date.clone()], None),
        nine
    );
    // A thumbnail that lies outside, an entry that points nowhere, one of an unknown kind.
    let mut odd = main.clone();
    odd.1.extend(u32::to_le_bytes(60_000));
    let more = (
        100,
        directory(&[(0x927C, 7, 90_000, 70_000), (1, 99, 4, 4), DATE, OFFSET]),
    );
    assert_eq!(exif_of(&[odd, more, date.clone()], None), nine);
    // The directory ends where the block ends, and claims more entries than there are.
    let mut last = directory(&[DATE, OFFSET]);
    last[0] = 9;
    let at_the_end = (260, last);
    let main_to_end = (8, directory(&[(0x8769, 4, 1, 260)]));
    assert_eq!(
        exif_of(&[main_to_end, at_the_end, date.clone()], None),
        nine
    );
    // All tags in the main directory.
    assert_eq!(
        exif_of(&[(8, directory(&[DATE, OFFSET])), date], None),
        nine
    );
}

#[test]
fn photini_47_a_date_that_is_none_is_passed_over() {
    let digitised = (0x9004, 2, 20, 300);
    let its_offset = (0x9012, 2, 7, 220);
    let main = (8, directory(&[POINTER]));
    let camera = (100, directory(&[DATE, OFFSET, digitised, its_offset]));
    let good = (300, b"2024:05:02 11:00:05\0".to_vec());
    for bad in [
        "0000:00:00 00:00:00",
        "2024:05:02 24:24:27",
        "2024:02:30 10:00:00",
    ] {
        let parts = [main.clone(), camera.clone(), texts(bad), good.clone()];
        assert_eq!(
            exif_of(&parts, None).as_deref(),
            Some("2024-05-02T09:00:05Z"),
            "{bad}"
        );
        assert_eq!(
            exif_of(&[main.clone(), camera.clone(), texts(bad)], None),
            None,
            "{bad}"
        );
    }
}

#[test]
fn immich_1095_the_satellites_or_a_zone_say_what_a_date_leaves_out() {
    let main = (8, directory(&[POINTER, (0x8825, 4, 1, 140)]));
    let camera = (100, directory(&[DATE]));
    let gps = (140, directory(&[(29, 2, 11, 300), (7, 5, 3, 320)]));
    let date = texts("2024:05:02 11:00:00");
    let day = (300, b"2024:05:02\0".to_vec());
    let parts = [9_u32, 1, 0, 1, 0, 1].map(u32::to_le_bytes).concat();
    let all = [
        main.clone(),
        camera.clone(),
        gps,
        date.clone(),
        day,
        (320, parts),
    ];
    let nine = Some("2024-05-02T09:00:00Z".to_owned());
    assert_eq!(exif_of(&all, None), nine);
    let alone = [(8, directory(&[POINTER])), camera, date];
    assert_eq!(exif_of(&alone, None), None);
    let prague = Zone::new("Europe/Prague").expect("known");
    assert_eq!(exif_of(&alone, Some(&prague)), nine);
}

#[test]
fn geotag_15_hours_of_twelve_are_told_apart() {
    let parts = |date: &str| {
        [
            (8, directory(&[POINTER])),
            (100, directory(&[(0x9003, 2, 23, 300), OFFSET])),
            texts("2024:05:02 11:00:00"),
            (300, format!("{date}\0").into_bytes()),
        ]
    };
    for (date, time) in [
        ("2024:05:02 11:00:00 AM", "2024-05-02T09:00:00Z"),
        ("2024:05:02 11:00:00 PM", "2024-05-02T21:00:00Z"),
        ("2024:05:02 12:00:00 am", "2024-05-01T22:00:00Z"),
        ("2024:05:02 12:00:00 pm", "2024-05-02T10:00:00Z"),
    ] {
        assert_eq!(exif_of(&parts(date), None).as_deref(), Some(time), "{date}");
    }
}

#[test]
fn exifr_136_the_date_of_a_big_tiff_is_read() {
    for is_big_endian in [false, true] {
        let n16 = |n: u16| bytes_16(is_big_endian, n);
        let n64 = |n: u64| bytes_64(is_big_endian, n);
        let entry = |tag: u16, kind: u16, count: u64, value: u64| {
            [&n16(tag)[..], &n16(kind), &n64(count), &n64(value)].concat()
        };
        let mut bytes = if is_big_endian {
            b"MM".to_vec()
        } else {
            b"II".to_vec()
        };
        bytes.extend([n16(43), n16(8), n16(0)].concat());
        bytes.extend(n64(16));
        bytes.extend(n64(2));
        bytes.extend(entry(0x0132, 2, 20, 100));
        bytes.extend(entry(0x8769, 18, 1, 64));
        // The camera's directory: an offset that fits into its entry.
        bytes.resize(64, 0);
        bytes.extend(n64(1));
        bytes.extend(entry(0x9010, 2, 7, 0));
        bytes[84..92].copy_from_slice(b"+02:00\0\0");
        bytes.resize(100, 0);
        bytes.extend(b"2024:05:02 11:00:00\0");
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.tif");
        std::fs::write(&path, bytes).expect("writable");
        let time = exif_time(&path, None).expect("readable");
        assert_eq!(
            time.map(|it| it.to_string()).as_deref(),
            Some("2024-05-02T09:00:00Z")
        );
    }
}

/// A folder with an index of these rows and an image for each name.
fn dataset_of(header: &str, rows: &[&str], images: &[&str]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for name in images {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("writable");
        noise(40, 30).save(path).expect("encodes");
    }
    let index = format!("{header}\n{}\n", rows.join("\n"));
    std::fs::write(folder.path().join("index.csv"), index).expect("writable");
    folder
}

#[test]
fn labelme_49_an_entry_is_found_by_its_file_and_not_by_a_part_of_its_name() {
    let rows = [
        "a,2024-05-02T09:00:00Z,10.png",
        "b,2024-05-02T09:00:00Z,11.png",
    ];
    let folder = dataset_of("place,time,path", &rows, &["10.png", "1.png", "sub/10.png"]);
    let lookup = Lookup::new(&Dataset::open(folder.path()).expect("a dataset"));
    let file = |name: &str| FileIdentity::of(&folder.path().join(name));
    assert_eq!(lookup.entries(&file("10.png")), [0]);
    assert_eq!(lookup.entries(&file("sub/../10.png")), [0]);
    for other in ["1.png", "sub/10.png", "0.png"] {
        assert!(lookup.entries(&file(other)).is_empty(), "{other}");
        assert_eq!(lookup.problem(&file(other)), None, "{other}");
    }
    assert_eq!(
        lookup.problem(&file("11.png")),
        Some(0),
        "it does not exist"
    );
}

#[test]
fn dcase_2023_baseline_1_a_name_keeps_the_blanks_at_its_ends() {
    let rows = [
        "a,2024-05-02T09:00:00Z,\" lead.png\"",
        "b, 2024-05-02T09:00:00Z , plain.png ",
        "c,2024-05-02T09:00:00Z,sub/ lead.png",
    ];
    let images = [" lead.png", "plain.png", "sub/ lead.png"];
    let folder = dataset_of("place, time ,path", &rows, &images);
    let dataset = Dataset::open(folder.path()).expect("a dataset");
    assert!(dataset.problems.is_empty(), "{:?}", dataset.problems);
    let ids: Vec<&str> = dataset.entries.iter().map(|it| it.id.as_str()).collect();
    assert_eq!(ids, images);
    let named = images.map(|name| name.rsplit('/').next().unwrap_or(name).to_owned());
    let options = ReadOptions {
        only: Some(std::sync::Arc::new(named.into())),
        ..ReadOptions::default()
    };
    let (manifest, data) = Manifest::locate(folder.path()).expect("a dataset");
    let same = Dataset::read(&manifest, &data, &options).expect("a dataset");
    assert_eq!(same.entries.len(), 3);
}

#[cfg(unix)]
#[test]
fn yolov5_11115_links_and_linked_folders_lead_to_the_same_entry() {
    use std::os::unix::fs::symlink;
    let folder = dataset_of("place,time,path", &["a,2024-05-02T09:00:00Z,a.png"], &[]);
    let path = |name: &str| folder.path().join(name);
    std::fs::create_dir(path("kept")).expect("writable");
    noise(40, 30).save(path("kept/5f3a.png")).expect("encodes");
    symlink("kept/5f3a.png", path("a.png")).expect("links");
    symlink(folder.path(), path("again")).expect("links");
    let lookup = Lookup::new(&Dataset::open(folder.path()).expect("a dataset"));
    for name in [
        "a.png",
        "again/a.png",
        "kept/5f3a.png",
        "again/again/kept/5f3a.png",
    ] {
        assert_eq!(
            lookup.entries(&FileIdentity::of(&path(name))),
            [0],
            "{name}"
        );
    }
}

#[test]
fn colmap_1520_the_size_of_most_images_counts_or_that_of_the_manifest() {
    let rows = [
        "a,2024-05-01T09:00:00Z,0.png",
        "a,2024-05-02T09:00:00Z,1.png",
        "a,2024-05-03T09:00:00Z,2.png",
    ];
    let folder = dataset_of("place,time,path", &rows, &["1.png", "2.png"]);
    noise(30, 40)
        .save(folder.path().join("0.png"))
        .expect("encodes");
    let mut dataset = Dataset::open(folder.path()).expect("a dataset");
    assert_eq!(dataset.set_aside(None, None), (Some((40, 30)), 0));
    assert_eq!(dataset.entries.len(), 2);
    let message = &dataset.problems[0].message;
    assert!(
        message.contains("30 x 40 px") && message.contains("40 x 30 px"),
        "{message}"
    );

    let manifest = "name = 'a'\nimage_size = [30, 40]\n[time]\nclock = 'real'\n";
    std::fs::write(folder.path().join("dataset.toml"), manifest).expect("writable");
    let mut dataset = Dataset::open(folder.path()).expect("a dataset");
    assert_eq!(dataset.set_aside(None, None), (Some((30, 40)), 0));
    assert_eq!(dataset.entries.len(), 1);
}

#[test]
fn colmap_1520_an_image_of_the_same_shape_is_scaled_to_the_size_of_most() {
    let rows = [
        "a,2024-05-01T09:00:00Z,0.png",
        "a,2024-05-02T09:00:00Z,1.png",
        "a,2024-05-03T09:00:00Z,2.png",
    ];
    let folder = dataset_of("place,time,path", &rows, &["1.png", "2.png"]);
    noise(80, 60)
        .save(folder.path().join("0.png"))
        .expect("encodes");
    let mut dataset = Dataset::open(folder.path()).expect("a dataset");
    assert_eq!(dataset.set_aside(None, None), (Some((40, 30)), 1));
    assert_eq!(dataset.problems, []);
    for entry in &dataset.entries {
        let image = entry.source.load().expect("an image");
        assert_eq!(image.size(), (40, 30), "{}", entry.id);
    }
    let report = Dataset::open(folder.path())
        .expect("a dataset")
        .check(|_, _| {});
    assert!(report.is_clean(), "{report}");
}

/// A number as a file of this byte order has it.
fn bytes_16(is_big_endian: bool, n: u16) -> [u8; 2] {
    if is_big_endian {
        n.to_be_bytes()
    } else {
        n.to_le_bytes()
    }
}

/// The same of eight bytes.
fn bytes_64(is_big_endian: bool, n: u64) -> [u8; 8] {
    if is_big_endian {
        n.to_be_bytes()
    } else {
        n.to_le_bytes()
    }
}

/// A grey picture of 4 x 2 px, whose offsets have eight bytes.
fn big_tiff(is_big_endian: bool) -> Vec<u8> {
    let n16 = |n: u16| bytes_16(is_big_endian, n);
    let n64 = |n: u64| bytes_64(is_big_endian, n);
    let mut bytes = if is_big_endian {
        b"MM".to_vec()
    } else {
        b"II".to_vec()
    };
    bytes.extend([n16(43), n16(8), n16(0)].concat());
    bytes.extend(n64(16));
    let entries: [(u16, u16); 9] = [
        (256, 4),
        (257, 2),
        (258, 8),
        (259, 1),
        (262, 1),
        (273, 16 + 8 + 9 * 20 + 8),
        (277, 1),
        (278, 2),
        (279, 8),
    ];
    bytes.extend(n64(entries.len() as u64));
    for (tag, value) in entries {
        // A short stands at the beginning of its field.
        bytes.extend([n16(tag), n16(3)].concat());
        bytes.extend(n64(1));
        bytes.extend([n16(value), n16(0), n16(0), n16(0)].concat());
    }
    bytes.extend(n64(0));
    bytes.extend([1, 2, 3, 4, 250, 251, 252, 253]);
    bytes
}

#[test]
fn pillow_4513_a_big_tiff_is_read() {
    for is_big_endian in [false, true] {
        let image = decode(&big_tiff(is_big_endian)).expect("a picture");
        assert_eq!(image.size(), (4, 2));
        assert_eq!(image.data(), [1, 2, 3, 4, 250, 251, 252, 253]);
    }
}

#[test]
fn rosbag2_1276_clocks_that_were_never_set_or_run_ahead_are_set_aside() {
    let now = Time::parse("2026-01-01T00:00:00Z").expect("valid");
    let rows = [
        "a,1970-01-01T00:00:09Z,a.png",
        "a,2024-05-02T09:00:00Z,a.png",
        "a,2024-05-03T09:00:00Z,a.png",
        "a,2099-05-03T09:00:00Z,a.png",
    ];
    let folder = dataset_of("place,time,path", &rows, &["a.png"]);
    let mut dataset = Dataset::open(folder.path()).expect("a dataset");
    dataset.set_aside(Some(now), None);
    assert_eq!(dataset.entries.len(), 2);
    let messages: Vec<_> = dataset
        .problems
        .iter()
        .map(|it| it.message.as_str())
        .collect();
    assert!(
        messages[0].contains("never set") && messages[1].contains("future"),
        "{messages:?}"
    );
    // Times that begin at 0 count in their own way.
    let folder = dataset_of("place,time,path", &rows[..1], &["a.png"]);
    let mut dataset = Dataset::open(folder.path()).expect("a dataset");
    dataset.set_aside(Some(now), None);
    assert_eq!(dataset.entries.len(), 1);
}

#[test]
fn pandas_10987_times_of_an_index_have_a_unit() {
    for (header, cell) in [
        ("place,time,path", "2024-05-02T09:00:00Z"),
        ("place,time,path", "1714640400s"),
        ("place,time_s,path", "1714640400"),
        ("place,time_ms,path", "1714640400000"),
        ("place,time_ns,path", "1714640400000000000"),
        ("\n\nplace,time_ns,path", "1714640400000000000"),
        ("place;time_ms;path", "1714640400000"),
        ("\"place\"\ttime\tpath", "2024-05-02T09:00:00Z"),
    ] {
        let cells = format!("a,{cell},a.png");
        let row = match header {
            _ if header.contains(';') => cells.replace(',', ";"),
            _ if header.contains('\t') => cells.replace(',', "\t"),
            _ => cells,
        };
        let folder = dataset_of(header, &[&row], &["a.png"]);
        let dataset = Dataset::open(folder.path()).expect(cell);
        assert_eq!(
            dataset.entries[0].time.to_string(),
            "2024-05-02T09:00:00Z",
            "{cell}"
        );
    }
    for (header, cell, words) in [
        (
            "place,time,path",
            "1714640400000",
            "milliseconds since 1970",
        ),
        ("place,when,path", "1714640400000", "unknown column `when`"),
        ("place,path", "x", "`time` is missing"),
        (
            "place,time_s,path",
            "2024-05-02T09:00:00Z",
            "seconds since 1970",
        ),
    ] {
        let row = if header == "place,path" {
            "a,a.png".into()
        } else {
            format!("a,{cell},a.png")
        };
        let folder = dataset_of(header, &[&row], &["a.png"]);
        let error = Dataset::open(folder.path()).expect_err(cell).to_string();
        assert!(error.contains(words), "{error}");
    }
}

#[test]
fn dencode_9_numbers_in_the_wrong_column_of_times_are_a_problem() {
    let rows = ["a,1714640400,a.png", "a,1714726800,b.png"];
    let images = ["a.png", "b.png"];
    let folder = dataset_of("place,time_ms,path", &rows, &images);
    let dataset = Dataset::open(folder.path()).expect("a dataset");
    assert_eq!(dataset.entries.len(), 2);
    let problem = dataset.problems[0].to_string();
    for words in ["milliseconds", "look like seconds", "time_s"] {
        assert!(problem.contains(words), "{problem}");
    }
    // A clock that began with the robot, a while ago.
    let rows = ["a,600000,a.png", "a,1714726800,b.png"];
    let folder = dataset_of("place,time_ms,path", &rows, &images);
    let dataset = Dataset::open(folder.path()).expect("a dataset");
    assert_eq!(dataset.problems, []);
}

#[test]
fn autoware_1030_any_image_of_a_dataset_is_read_as_its_layout_says() {
    let text = "name = 'raw'\n[time]\nclock = 'real'\n[[layout]]\nkind = 'nclt'\ncamera = 5\n\
                radius_m = 1.0\n[[layout.place]]\nkey = 'a'\nx = 0.0\ny = 0.0\n";
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("raw.toml");
    std::fs::write(&path, text).expect("writable");
    let image = folder.path().join("1326030976326043.png");
    noise(40, 30).save(&image).expect("encodes");
    let manifest = Manifest::load(&path).expect("a manifest");
    let turned = manifest.picture(&image, None).load().expect("an image");
    assert_eq!(turned.size(), (30, 40));
    let time = manifest
        .time_from_name("1326030976326043.png")
        .expect("by its layout");
    assert_eq!(time, Time::from_us(1_326_030_976_326_043));
}
