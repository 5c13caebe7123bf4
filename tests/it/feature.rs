//! Features against golden results, a literal reading of the definitions, and broken images.

#![allow(clippy::expect_used, reason = "helpers of tests may fail like tests")]

use std::fmt::Write as _;
use std::path::Path;

use chronotope::ErrorKind;
use chronotope::dataset::exif_time;
use chronotope::feature::{
    DecodeLimits, Descriptor, Extractor, Features, GrayImage, GrayView, Keypoint, LoadOptions,
    Rect, Rotation, StarBrief, StarBriefConfig, load_gray, load_mask, mask_from_rects,
};
use chronotope::simd::Kernel;
use proptest::prelude::*;

/// The generator of `scripts/make_golden.py`.
struct Xorshift(u64);

impl Xorshift {
    fn below(&mut self, limit: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 33) as usize % limit
    }
}

/// The pictures of `scripts/make_golden.py`.
pub(crate) fn draw(kind: &str, width: usize, height: usize, seed: u64) -> GrayImage {
    let mut random = Xorshift(seed);
    let mut data = vec![110_u8; width * height];
    for _ in 0..width * height / 150 {
        let (w, h) = (2 + random.below(26), 2 + random.below(26));
        let (x, y) = (random.below(width - w), random.below(height - h));
        let level = random.below(256) as u8;
        for row in data.chunks_exact_mut(width).skip(y).take(h) {
            row[x..x + w].fill(level);
        }
    }
    for (i, pixel) in data.iter_mut().enumerate() {
        let (x, y) = (i % width, i / width);
        *pixel = match kind {
            "noise" => pixel.saturating_add(random.below(12) as u8),
            "smooth" => *pixel / 8 + ((x + 2 * y) / 6 % 200) as u8,
            _ => u8::from(*pixel >= 128) * 255,
        };
    }
    image(width, height, data)
}

fn image(width: usize, height: usize, data: Vec<u8>) -> GrayImage {
    GrayImage::new(width, height, data).expect("sizes fit")
}

fn config(star: &[u16]) -> StarBriefConfig {
    StarBriefConfig::default()
        .with_max_size(star[0] as u8)
        .with_response_threshold(star[1])
        .with_line_threshold_projected(star[2])
        .with_line_threshold_binarized(star[3])
        .with_suppress_nonmax_size(star[4] as u8)
}

/// Keypoints and features as lines of the golden file.
fn lines_of(keypoints: &[Keypoint], features: &Features) -> String {
    let mut lines = String::new();
    for point in keypoints {
        let bits = features
            .keypoints()
            .iter()
            .position(|described| described == point)
            .map_or("-".to_owned(), |id| {
                format!("{:?}", features.descriptors()[id])
            });
        let response = point.response.to_bits();
        let Keypoint { x, y, size, .. } = point;
        writeln!(lines, "{x} {y} {size} {response:08x} {bits}").expect("a string takes it");
    }
    lines
}

#[test]
fn keypoints_sizes_responses_and_bits_are_those_of_opencv() {
    let golden = include_str!("../data/features/star_brief.txt");
    let mut images = 0;
    for section in golden.split("image ").skip(1) {
        let (head, expected) = section.split_once('\n').expect("a line");
        let words: Vec<&str> = head.split(' ').collect();
        let number = |i: usize| words[i].parse::<usize>().expect("a number");
        let picture = draw(words[0], number(1), number(2), number(3) as u64);
        assert_eq!(
            picture.digest().to_string(),
            words[4],
            "another picture: {head}"
        );
        let star: Vec<u16> = (5..10).map(|i| number(i) as u16).collect();
        let extractor = StarBrief::new(config(&star).with_num_features(usize::MAX)).expect("valid");
        let keypoints = extractor.detect(&picture, None).expect("detects");
        let features = extractor.extract(&picture, None).expect("extracts");
        // Descriptors are matched by keypoint: one at a place may be bright and one dark, never
        // equal.
        let found = lines_of(&keypoints, &features);
        for (line, (found, expected)) in found.lines().zip(expected.lines()).enumerate() {
            assert_eq!(found, expected, "{head}: keypoint {line}");
        }
        assert_eq!(found.lines().count(), expected.lines().count(), "{head}");
        images += 1;
    }
    assert_eq!(images, 8);
}

/// STAR as its definition reads, without integral images; slow.
fn literal_star(image: &GrayImage, max_size: usize, reach: usize) -> Vec<(usize, usize, usize)> {
    let (width, height) = (image.width() as i64, image.height() as i64);
    let star = |x: i64, y: i64, radius: i64| -> (i64, i64) {
        let t = radius + radius / 2;
        let (mut sum, mut area) = (0, 0);
        for dy in -t..=t {
            for dx in -t..=t {
                let times = i64::from(dx.abs().max(dy.abs()) <= radius)
                    + i64::from(dx.abs() + dy.abs() <= t);
                sum += times * i64::from(image.row((y + dy) as usize)[(x + dx) as usize]);
                area += times;
            }
        }
        (sum, area)
    };
    let mut sizes = vec![2_i64, 4, 6, 8, 12, 16];
    sizes.truncate(
        sizes
            .iter()
            .position(|&size| size >= max_size as i64)
            .expect("small")
            + 1,
    );
    let largest = sizes[sizes.len() - 1];
    let border = largest + largest / 2;
    let mut field = vec![(0.0_f32, 0_i64); (width * height) as usize];
    for y in border..height - border {
        for x in border..width - border {
            let best = &mut field[(y * width + x) as usize];
            for &size in &sizes {
                let (inner, inner_area) = star(x, y, size / 2);
                let (outer, outer_area) = star(x, y, size);
                let response = inner as f32 * (1.0 / inner_area as f32)
                    - (outer - inner) as f32 * (1.0 / (outer_area - inner_area) as f32);
                if response.abs() > best.0.abs() {
                    *best = (response, size);
                }
            }
        }
    }
    let mut extrema = Vec::new();
    let reach = reach as i64;
    for y in border..height - border {
        for x in border..width - border {
            let (value, size) = field[(y * width + x) as usize];
            let others = (-reach..=reach)
                .flat_map(|dy| (-reach..=reach).map(move |dx| (dx, dy)))
                .filter(|&offset| offset != (0, 0))
                .map(|(dx, dy)| field[((y + dy) * width + x + dx) as usize].0);
            let (mut highest, mut lowest) = (f32::NEG_INFINITY, f32::INFINITY);
            for other in others {
                highest = highest.max(other);
                lowest = lowest.min(other);
            }
            let is_extreme = value > 0.0 && value > highest || value < 0.0 && value < lowest;
            if is_extreme && size >= 4 && size < largest {
                extrema.push((x as usize, y as usize, size as usize));
            }
        }
    }
    extrema
}

/// The mean of a 9x9 box, literally.
fn literal_box(image: &GrayImage, x: i64, y: i64) -> u32 {
    (y - 4..=y + 4)
        .flat_map(|y| (x - 4..=x + 4).map(move |x| (x, y)))
        .map(|(x, y)| u32::from(image.row(y as usize)[x as usize]))
        .sum()
}

fn any_kind() -> impl Strategy<Value = &'static str> {
    prop::sample::select(vec!["noise", "smooth", "binary"])
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn without_line_tests_keypoints_are_the_extrema_of_the_definition(
        kind in any_kind(), width in 40_usize..72, height in 40_usize..72, seed in 1_u64..1000,
        max_size in prop::sample::select(vec![5_u8, 8, 12, 16]),
        window in prop::sample::select(vec![3_u8, 4, 5, 7]),
    ) {
        let picture = draw(kind, width, height, seed);
        // A ratio beyond reach keeps lines, except where the gradient vanishes altogether.
        let extractor = StarBrief::new(
            config(&[u16::from(max_size), 0, 65_535, 65_535, u16::from(window)]),
        ).expect("valid");
        let expected = literal_star(&picture, usize::from(max_size), usize::from(window) / 2);
        let found = extractor.detect(&picture, None).expect("detects");
        prop_assert!(found.len() <= expected.len());
        for point in found {
            let point = (point.x as usize, point.y as usize, point.size as usize);
            prop_assert!(expected.contains(&point), "{point:?} is no extremum");
        }
    }

    #[test]
    fn features_are_sorted_inside_cut_and_the_same_again(
        kind in any_kind(), width in 1_usize..260, height in 1_usize..260, seed in 1_u64..1000,
        num_features in 0_usize..60,
    ) {
        let picture = draw(kind, width.max(30), height.max(30), seed);
        let all = StarBrief::new(StarBriefConfig::default().with_num_features(usize::MAX)).expect("valid");
        let few = StarBrief::new(StarBriefConfig::default().with_num_features(num_features)).expect("valid");
        let mut features = all.extract(&picture, None).expect("extracts");
        let order = |k: &Keypoint| (-k.response, k.y, k.x);
        let is_sorted = features.keypoints().is_sorted_by_key(order);
        prop_assert!(is_sorted);
        for point in features.keypoints() {
            prop_assert!(point.x >= 69.0 && point.x < picture.width() as f32 - 69.0);
            prop_assert!(point.y >= 69.0 && point.y < picture.height() as f32 - 69.0);
            prop_assert!((4.0..46.0).contains(&point.size));
        }
        // Another picture in between must leave nothing behind in reused buffers.
        all.extract(&draw("noise", 200, 170, seed + 1), None).expect("extracts");
        prop_assert_eq!(&all.extract(&picture, None).expect("extracts"), &features);
        features.truncate(num_features);
        prop_assert_eq!(few.extract(&picture, None).expect("extracts"), features);
    }

    #[test]
    fn a_mask_removes_its_pixels_and_nothing_else(
        kind in any_kind(), seed in 1_u64..1000,
        x in 0_u32..150, y in 0_u32..150, side in 1_u32..50,
    ) {
        let picture = draw(kind, 200, 200, seed);
        let hidden = Rect { x, y, width: side, height: side };
        let mask = mask_from_rects(200, 200, &[hidden]).expect("inside");
        let extractor = StarBrief::default();
        let is_hidden = |k: &Keypoint| {
            (x..x + side).contains(&(k.x as u32)) && (y..y + side).contains(&(k.y as u32))
        };
        let mut expected = extractor.detect(&picture, None).expect("detects");
        expected.retain(|point| !is_hidden(point));
        prop_assert_eq!(extractor.detect(&picture, Some(&mask)).expect("detects"), expected);
    }

    #[test]
    fn a_view_into_a_larger_picture_is_seen_as_its_copy(
        kind in any_kind(), seed in 1_u64..1000,
        left in 0_u32..30, top in 0_u32..30, width in 1_u32..170, height in 1_u32..170,
    ) {
        let larger = draw(kind, 200, 200, seed);
        let part = Rect { x: left, y: top, width, height };
        let copy = larger.cropped(part).expect("inside");
        let first = (top * 200 + left) as usize;
        // The last row ends with its last pixel.
        let end = first + (height - 1) as usize * 200 + width as usize;
        let (columns, rows) = (width as usize, height as usize);
        let view = GrayView::new(&larger.data()[first..end], columns, rows, 200).expect("inside");
        prop_assert_eq!(&view.to_image(), &copy);
        prop_assert_eq!(view.size(), copy.size());
        let hidden = Rect { x: width / 2, y: height / 2, width: width - width / 2, height: 1 };
        let mask = mask_from_rects(columns, rows, &[hidden]).expect("inside");
        for mask in [None, Some(&mask)] {
            prop_assert_eq!(view.gray_range(mask), copy.gray_range(mask));
            for kernel in Kernel::available() {
                let config = StarBriefConfig::default().with_max_size(16);
                let extractor = StarBrief::with_kernel(config, kernel).expect("valid");
                let points = extractor.detect(view, mask).expect("detects");
                prop_assert_eq!(points, extractor.detect(&copy, mask).expect("detects"));
                let mut features = Features::new();
                extractor.extract_into(view, mask, &mut features).expect("extracts");
                prop_assert_eq!(features, extractor.extract(&copy, mask).expect("extracts"));
            }
        }
    }

    #[test]
    fn bits_compare_the_boxes_of_the_pairs(seed in 1_u64..1000) {
        let picture = draw("noise", 160, 160, seed);
        let features = StarBrief::default().extract(&picture, None).expect("extracts");
        for (point, descriptor) in features.keypoints().iter().zip(features.descriptors()) {
            let (x, y) = (point.x as i64, point.y as i64);
            let bytes = descriptor.to_bytes();
            // The first and the last pair of the published table.
            let first = literal_box(&picture, x - 1, y - 2) < literal_box(&picture, x - 1, y + 7);
            let last = literal_box(&picture, x + 2, y + 6) < literal_box(&picture, x + 6, y - 6);
            prop_assert_eq!((bytes[0] >> 7 == 1, bytes[31] & 1 == 1), (first, last));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn every_kernel_finds_the_features_of_its_scalar_twin(
        kind in any_kind(),
        width in 50_usize..330,
        height in 50_usize..200,
        max_size in prop_oneof![Just(8), Just(16), Just(45)],
        window in 1_u8..9,
        seed in 1_u64..1000,
    ) {
        let picture = draw(kind, width, height, seed);
        let config = StarBriefConfig::default()
            .with_max_size(max_size)
            .with_suppress_nonmax_size(window);
        let of = |kernel| StarBrief::with_kernel(config.clone(), kernel).expect("valid");
        let twin = of(Kernel::scalar());
        let (points, expected) = (twin.detect(&picture, None), twin.extract(&picture, None));
        let (points, expected) = (points.expect("detects"), expected.expect("extracts"));
        for kernel in Kernel::available() {
            let extractor = of(kernel);
            // Twice, because the second image of a size finds the buffers of the first.
            for _ in 0..2 {
                prop_assert_eq!(&extractor.detect(&picture, None).expect("detects"), &points);
                let mut features = Features::new();
                extractor.extract_into(picture.view(), None, &mut features).expect("extracts");
                prop_assert_eq!(&features, &expected);
            }
            let other = draw(kind, height + 30, width, seed);
            extractor.detect(&other, None).expect("detects");
            prop_assert_eq!(&extractor.detect(&picture, None).expect("detects"), &points);
        }
    }
}

#[test]
fn a_view_has_all_of_its_rows() {
    let bytes = [7; 12];
    for (len, width, height, stride) in [(12, 4, 3, 4), (10, 2, 3, 4), (0, 0, 0, 0), (0, 5, 0, 5)] {
        let view = GrayView::new(&bytes[..len], width, height, stride).expect("enough bytes");
        assert_eq!(view.size(), (width as u32, height as u32));
        assert!((0..height).all(|y| view.row(y).len() == width));
    }
    for (len, width, height, stride) in [
        (11, 4, 3, 4),
        (9, 2, 3, 4),
        (12, 4, 3, 3),
        (12, 1, usize::MAX, usize::MAX),
        (0, 0, usize::MAX, 0),
    ] {
        let error = GrayView::new(&bytes[..len], width, height, stride).expect_err("too few bytes");
        assert_eq!(error.kind(), ErrorKind::Shape, "{error}");
    }
}

#[test]
fn small_empty_and_even_images_have_no_features() {
    let extractor = StarBrief::default();
    for (width, height) in [(0, 0), (1, 1), (5, 900), (138, 900), (900, 138), (139, 139)] {
        let picture = image(width, height, vec![200; width * height]);
        assert!(extractor.extract(&picture, None).expect("sound").is_empty());
    }
    for level in [0, 1, 255] {
        let picture = image(300, 200, vec![level; 60_000]);
        assert!(extractor.extract(&picture, None).expect("sound").is_empty());
    }
    let picture = image(0, 7, Vec::new());
    assert!(extractor.extract(&picture, None).expect("sound").is_empty());
}

#[test]
fn a_mask_of_another_size_is_an_error() {
    let (picture, mask) = (
        image(200, 200, vec![0; 40_000]),
        image(10, 10, vec![0; 100]),
    );
    let error = StarBrief::default()
        .extract(&picture, Some(&mask))
        .expect_err("sizes differ");
    assert_eq!(error.kind(), ErrorKind::Shape);
    assert!(error.to_string().contains("10 x 10"), "{error}");
    let outside = Rect {
        x: 190,
        y: 0,
        width: 11,
        height: 1,
    };
    assert!(mask_from_rects(200, 200, &[outside]).is_err());
}

#[test]
fn threads_that_share_an_extractor_find_the_same() {
    let extractor = StarBrief::default();
    let pictures: Vec<_> = (1..5).map(|seed| draw("noise", 220, 200, seed)).collect();
    let find = |picture: &GrayImage| extractor.extract(picture, None).expect("extracts");
    let alone: Vec<_> = pictures.iter().map(find).collect();
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..4)
            .map(|_| scope.spawn(|| pictures.iter().map(find).collect::<Vec<_>>()))
            .collect();
        for worker in workers {
            assert_eq!(worker.join().expect("no panic"), alone);
        }
    });
}

#[test]
fn scaling_is_that_of_opencv_on_a_known_row() {
    // cv2.resize(np.uint8([[0, 100, 255]]), None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR)
    let row = image(3, 1, vec![0, 100, 255])
        .scaled(2.0)
        .expect("positive");
    assert_eq!((row.width(), row.height()), (6, 2));
    assert_eq!(row.row(0), [0, 25, 75, 139, 216, 255]);
    assert_eq!(row.row(0), row.row(1));
    // A factor of one is the identity, and an even image stays even.
    let picture = draw("noise", 61, 47, 9);
    assert_eq!(picture.scaled(1.0).expect("positive"), picture);
    for scale in [0.1, 0.7, 1.9, 3.3] {
        let even = image(40, 30, vec![77; 1200])
            .scaled(scale)
            .expect("positive");
        assert!(even.data().iter().all(|&pixel| pixel == 77), "{scale}");
    }
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-9, 1e300] {
        let error = picture.scaled(bad).expect_err("no size");
        assert_eq!(error.kind(), ErrorKind::Config, "{bad}");
    }
}

#[test]
fn quarter_turns_add_up() {
    let picture = image(3, 2, vec![1, 2, 3, 4, 5, 6]);
    let turned = picture.clone().rotated(Rotation::Clockwise90);
    assert_eq!((turned.width(), turned.height()), (2, 3));
    assert_eq!(turned.data(), [4, 1, 5, 2, 6, 3]);
    let half = turned.clone().rotated(Rotation::Clockwise90);
    assert_eq!(half, picture.clone().rotated(Rotation::Half));
    assert_eq!(turned.rotated(Rotation::Clockwise270), picture);
}

/// A folder with picture files.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a folder"))
    }

    fn file(&self, name: &str, bytes: &[u8]) -> std::path::PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, bytes).expect("writable");
        path
    }

    fn encoded(&self, name: &str, picture: &image::DynamicImage) -> std::path::PathBuf {
        let path = self.0.path().join(name);
        picture.save(&path).expect("encodes");
        path
    }
}

fn colour_picture(width: u32, height: u32) -> image::RgbImage {
    image::RgbImage::from_fn(width, height, |x, y| {
        image::Rgb([(x * 7 + y) as u8, (x + y * 5) as u8, (x * y) as u8])
    })
}

fn load(path: &Path) -> chronotope::Result<GrayImage> {
    load_gray(path, &LoadOptions::default())
}

#[test]
fn every_lossless_format_and_depth_gives_the_same_grey() {
    let folder = Folder::new();
    let rgb = colour_picture(33, 21);
    let expected: Vec<u8> = rgb
        .pixels()
        .map(|p| {
            let [r, g, b] = p.0.map(f64::from);
            (0.299 * r + 0.587 * g + 0.114 * b).round() as u8
        })
        .collect();
    let picture = image::DynamicImage::from(rgb.clone());
    let mut digests = Vec::new();
    for name in ["a.png", "a.bmp", "a.tiff", "a.ppm", "a.webp"] {
        let gray = load(&folder.encoded(name, &picture)).expect(name);
        assert_eq!((gray.width(), gray.height()), (33, 21));
        let off = gray
            .data()
            .iter()
            .zip(&expected)
            .map(|(a, b)| a.abs_diff(*b))
            .max();
        assert!(off <= Some(1), "{name}: {off:?}");
        digests.push(gray.digest());
    }
    // Alpha is ignored; 16-bit samples count by their high byte.
    let mut transparent = picture.to_rgba8();
    for pixel in transparent.pixels_mut() {
        pixel.0[3] = 0;
    }
    digests.push(
        load(&folder.encoded("alpha.png", &transparent.into()))
            .expect("RGBA")
            .digest(),
    );
    let mut deep = picture.to_rgb16();
    for (deep, &byte) in deep.iter_mut().zip(rgb.as_raw()) {
        *deep = u16::from(byte) << 8 | 0x00FF;
    }
    digests.push(
        load(&folder.encoded("deep.png", &deep.into()))
            .expect("16 bit")
            .digest(),
    );
    assert!(
        digests.windows(2).all(|pair| pair[0] == pair[1]),
        "{digests:?}"
    );
    // Grey files are taken as they are.
    let gray = image::GrayImage::from_raw(33, 21, expected.clone()).expect("fits");
    let loaded = load(&folder.encoded("gray.png", &gray.into())).expect("grey");
    assert_eq!(loaded.data(), expected);
}

#[test]
fn crop_turn_and_scale_follow_each_other() {
    let folder = Folder::new();
    let path = folder.encoded("a.png", &colour_picture(40, 30).into());
    let whole = load(&path).expect("loads");
    let crop = Rect {
        x: 5,
        y: 6,
        width: 12,
        height: 20,
    };
    let options = LoadOptions::default()
        .with_rotation(Rotation::Clockwise90)
        .with_crop(Some(crop))
        .with_scale(1.5);
    let expected = whole
        .rotated(Rotation::Clockwise90)
        .cropped(crop)
        .and_then(|image| image.scaled(1.5))
        .expect("inside");
    assert_eq!(load_gray(&path, &options).expect("inside"), expected);
    assert_eq!((expected.width(), expected.height()), (18, 30));
    for outside in [
        (25, 0, 6, 1),
        (0, 40, 1, 1),
        (0, 0, 0, 5),
        (u32::MAX, 0, 2, 2),
    ] {
        let (x, y, width, height) = outside;
        let options = options.with_crop(Some(Rect {
            x,
            y,
            width,
            height,
        }));
        let error = load_gray(&path, &options).expect_err("outside");
        assert_eq!(error.kind(), ErrorKind::Shape);
        assert!(error.to_string().contains("a.png: crop:"), "{error}");
    }
    let small = DecodeLimits::default().with_max_pixels(2_000);
    let error = load_gray(
        &path,
        &LoadOptions::default().with_limits(small).with_scale(9.0),
    );
    assert_eq!(error.expect_err("too big").kind(), ErrorKind::Format);
}

#[test]
fn a_scaled_mask_hides_whatever_touches_hidden_pixels() {
    let folder = Folder::new();
    let mut mask = image::GrayImage::from_pixel(20, 20, image::Luma([9]));
    mask.put_pixel(10, 10, image::Luma([0]));
    let path = folder.encoded("mask.png", &mask.into());
    let mask = load_mask(&path, &LoadOptions::default().with_scale(2.0)).expect("loads");
    assert!(mask.data().iter().all(|&pixel| pixel == 0 || pixel == 255));
    let hidden: usize = mask
        .data()
        .iter()
        .map(|&pixel| usize::from(pixel == 0))
        .sum();
    assert_eq!((hidden, mask.row(20)[20]), (16, 0));
}

/// The error for `path`, which must name the file and be short enough to read.
fn complaint(path: &Path, kind: ErrorKind) -> String {
    let error = load(path).expect_err("must not load");
    assert_eq!(error.kind(), kind, "{error}");
    assert_eq!(error.path(), Some(path));
    let text = error.to_string();
    assert!(text.contains("help:") && text.len() < 400, "{text}");
    text
}

#[test]
fn files_that_are_no_images_say_so() {
    let folder = Folder::new();
    assert!(
        complaint(&folder.0.path().join("none.png"), ErrorKind::NotFound)
            .contains("check the path")
    );
    assert!(complaint(&folder.file("zero.jpg", b""), ErrorKind::Format).contains("empty"));
    let text = folder.file("text.png", b"place,time,path\n");
    assert!(complaint(&text, ErrorKind::Format).contains("not an image"));
    assert_eq!(
        load(folder.0.path()).expect_err("a folder").kind(),
        ErrorKind::Format
    );
    let float = image::DynamicImage::from(image::Rgb32FImage::new(4, 4));
    let float = folder.encoded("float.tiff", &float);
    assert!(complaint(&float, ErrorKind::Format).contains("floating-point"));
    // A name does not make a format: the content decides.
    let png = std::fs::read(folder.encoded("a.png", &colour_picture(9, 9).into())).expect("reads");
    assert!(load(&folder.file("png.jpg", &png)).is_ok());
}

#[test]
fn truncated_images_of_every_format_are_refused() {
    let folder = Folder::new();
    let picture = image::DynamicImage::from(colour_picture(120, 90));
    for name in ["a.png", "a.bmp", "a.tiff", "a.ppm", "a.webp", "a.jpg"] {
        let bytes = std::fs::read(folder.encoded(name, &picture)).expect("reads");
        assert!(load(&folder.file(&format!("whole_{name}"), &bytes)).is_ok());
        for share in [1, 3, 6, 9] {
            let cut = folder.file(
                &format!("cut_{share}_{name}"),
                &bytes[..bytes.len() * share / 10],
            );
            complaint(&cut, ErrorKind::Format);
        }
    }
}

/// A PNG header of the given size with a valid checksum and nothing else.
fn png_header(width: u32, height: u32) -> Vec<u8> {
    let mut header = b"IHDR".to_vec();
    header.extend(width.to_be_bytes());
    header.extend(height.to_be_bytes());
    header.extend([8, 2, 0, 0, 0]);
    let mut png = b"\x89PNG\r\n\x1a\n\0\0\0\x0d".to_vec();
    png.extend(&header);
    png.extend(crc32fast::hash(&header).to_be_bytes());
    png.extend(b"\0\0\0\x04IDAT\x78\x9c\x03\0");
    png
}

#[test]
fn headers_that_claim_too_much_or_nothing_are_refused_before_decoding() {
    let folder = Folder::new();
    let bomb = folder.file("bomb.png", &png_header(60_000, 60_000));
    assert!(complaint(&bomb, ErrorKind::Format).contains("60000 x 60000"));
    for (width, height) in [(0, 0), (0, 5), (5, 0)] {
        complaint(
            &folder.file("nothing.png", &png_header(width, height)),
            ErrorKind::Format,
        );
    }
    let huge = folder.file("huge.pgm", b"P5\n4000000000 4000000000\n255\n");
    complaint(&huge, ErrorKind::Format);
    let fits = folder.encoded("fits.png", &colour_picture(50, 40).into());
    let limits = |limits| LoadOptions::default().with_limits(limits);
    let exact = limits(DecodeLimits::default().with_max_pixels(2_000));
    assert!(load_gray(&fits, &exact).is_ok());
    let tight = limits(DecodeLimits::default().with_max_pixels(1_999));
    assert!(load_gray(&fits, &tight).is_err());
    let num_bytes = std::fs::metadata(&fits).expect("there").len();
    let exact = limits(DecodeLimits::default().with_max_file_bytes(num_bytes));
    assert!(load_gray(&fits, &exact).is_ok());
    let tight = limits(DecodeLimits::default().with_max_file_bytes(num_bytes - 1));
    let error = load_gray(&fits, &tight).expect_err("a byte too many");
    assert_eq!(error.kind(), ErrorKind::Format);
    assert_eq!(error.path(), Some(fits.as_path()));
}

/// A JPEG whose header has the given EXIF date and offset.
fn jpeg_with_exif(date: &str, offset: Option<&str>) -> Vec<u8> {
    // Little-endian TIFF: IFD0 at 8 with one entry, the EXIF IFD at 26, texts behind it.
    let mut entries = vec![(0x9003_u16, format!("{date}\0"))];
    entries.extend(offset.map(|offset| (0x9011, format!("{offset}\0"))));
    let mut tiff = b"II*\0\x08\0\0\0\x01\0\x69\x87\x04\0\x01\0\0\0\x1a\0\0\0\0\0\0\0".to_vec();
    tiff.extend((entries.len() as u16).to_le_bytes());
    let mut at = 26 + 2 + 12 * entries.len() + 4;
    let mut texts = Vec::new();
    for (tag, text) in &entries {
        tiff.extend(tag.to_le_bytes());
        tiff.extend(2_u16.to_le_bytes());
        tiff.extend((text.len() as u32).to_le_bytes());
        tiff.extend((at as u32).to_le_bytes());
        at += text.len();
        texts.extend(text.bytes());
    }
    tiff.extend([0; 4]);
    tiff.extend(texts);
    let mut plain = std::io::Cursor::new(Vec::new());
    image::DynamicImage::from(colour_picture(16, 16))
        .write_to(&mut plain, image::ImageFormat::Jpeg)
        .expect("encodes");
    let plain = plain.into_inner();
    let mut jpeg = plain[..2].to_vec();
    jpeg.extend([0xFF, 0xE1]);
    jpeg.extend(((8 + tiff.len()) as u16).to_be_bytes());
    jpeg.extend(b"Exif\0\0");
    jpeg.extend(tiff);
    jpeg.extend(&plain[2..]);
    jpeg
}

#[test]
fn exif_times_count_only_with_an_offset() {
    let folder = Folder::new();
    let date = "2023:06:13 05:11:46";
    let read = |path: &Path| {
        exif_time(path, None)
            .expect("reads")
            .map(|it| it.to_string())
    };
    let with = folder.file("with.jpg", &jpeg_with_exif(date, Some("+02:00")));
    assert_eq!(read(&with).as_deref(), Some("2023-06-13T03:11:46Z"));
    let west = folder.file("west.jpg", &jpeg_with_exif(date, Some("-09:30")));
    assert_eq!(read(&west).as_deref(), Some("2023-06-13T14:41:46Z"));
    for without in [
        jpeg_with_exif(date, None),
        jpeg_with_exif("    :  :     :  :  ", Some("+02:00")),
        b"no image".to_vec(),
    ] {
        assert_eq!(read(&folder.file("without.jpg", &without)), None);
    }
    assert!(load(&with).is_ok());
    assert!(exif_time(&folder.0.path().join("none.jpg"), None).is_err());
}

#[test]
fn digests_tell_pictures_and_shapes_apart() {
    let a = image(2, 3, vec![1, 2, 3, 4, 5, 6]);
    let mut b = a.clone();
    assert_eq!(a.digest(), b.digest());
    b.data_mut()[5] = 7;
    assert_ne!(a.digest(), b.digest());
    assert_ne!(a.digest(), image(3, 2, a.data().to_vec()).digest());
}

#[test]
fn descriptors_keep_the_order_of_opencvs_bytes() {
    let bytes: [u8; 32] = std::array::from_fn(|i| i as u8);
    assert_eq!(Descriptor::from_bytes(bytes).to_bytes(), bytes);
}
