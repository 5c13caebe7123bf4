//! Features and frames that come through OpenCV.

use std::time::Duration;

use crate::feature::draw;
use chronotope::ErrorKind;
use chronotope::feature::opencv_input::{FrameSource, Moment};
use chronotope::feature::{
    CornerBriefConfig, ExtractorConfig, GrayImage, Keypoint, Rect, mask_from_rects,
};
use opencv::core::{CV_8UC3, Mat, Scalar, Size};
use opencv::prelude::*;
use opencv::videoio::VideoWriter;

fn kinds(config: &CornerBriefConfig) -> [ExtractorConfig; 3] {
    [
        ExtractorConfig::OrbBrief(config.clone()),
        ExtractorConfig::FastBrief(config.clone()),
        ExtractorConfig::AgastBrief(config.clone()),
    ]
}

#[test]
fn corners_are_sorted_cut_masked_and_described() {
    let picture = draw("noise", 320, 240, 11);
    let right_half = Rect {
        x: 160,
        y: 0,
        width: 160,
        height: 240,
    };
    let mask = mask_from_rects(320, 240, &[right_half]).expect("inside");
    for config in kinds(&CornerBriefConfig::default().with_num_features(60)) {
        let extractor = config.build().expect("this build has OpenCV");
        assert_eq!(
            ExtractorConfig::from_id(&extractor.id()).expect("own id"),
            config
        );
        let features = extractor.extract(&picture, None).expect("extracts");
        assert_eq!(features.len(), 60, "{config}");
        let order = |k: &Keypoint| (-k.response, k.y, k.x);
        assert!(features.keypoints().is_sorted_by_key(order), "{config}");
        assert_eq!(
            extractor.extract(&picture, None).expect("extracts"),
            features
        );
        let left = extractor.extract(&picture, Some(&mask)).expect("extracts");
        assert!(!left.is_empty(), "{config}");
        assert!(
            left.keypoints().iter().all(|point| point.x < 160.0),
            "{config}"
        );
        for (width, height) in [(0, 0), (56, 300), (57, 57), (300, 20)] {
            let small = GrayImage::new(width, height, vec![9; width * height]).expect("fits");
            assert!(extractor.extract(&small, None).expect("sound").is_empty());
        }
        assert!(
            extractor
                .extract(
                    &picture,
                    Some(&draw("noise", 320, 240, 11).scaled(0.5).expect("fits"))
                )
                .is_err()
        );
    }
}

#[test]
fn the_same_keypoint_has_the_same_bits_whoever_found_it() {
    let picture = draw("noise", 320, 240, 11);
    let all = CornerBriefConfig::default().with_num_features(10_000);
    let [_, fast, agast] = kinds(&all).map(|config| {
        let extractor = config.build().expect("this build has OpenCV");
        extractor.extract(&picture, None).expect("extracts")
    });
    let mut shared = 0;
    for (a, bits) in fast.keypoints().iter().zip(fast.descriptors()) {
        if let Some(id) = agast
            .keypoints()
            .iter()
            .position(|b| (a.x, a.y) == (b.x, b.y))
        {
            assert_eq!(*bits, agast.descriptors()[id]);
            shared += 1;
        }
    }
    assert!(shared > 20, "{shared} of {}", fast.len());
}

#[test]
fn a_video_gives_its_frames_in_grey_with_their_positions() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("video.avi");
    let code = VideoWriter::fourcc('M', 'J', 'P', 'G').expect("a code");
    let size = Size::new(64, 48);
    let name = path.to_str().expect("UTF-8");
    let mut writer = VideoWriter::new(name, code, 10.0, size, true).expect("writes");
    for level in [0.0, 100.0, 200.0] {
        let frame = Mat::new_size_with_default(size, CV_8UC3, Scalar::all(level)).expect("a frame");
        writer.write(&frame).expect("writes");
    }
    writer.release().expect("closes");
    let source = FrameSource::video(&path).expect("opens");
    let frames: Vec<_> = source.map(|frame| frame.expect("decodes")).collect();
    assert_eq!(frames.len(), 3);
    for (i, frame) in frames.iter().enumerate() {
        assert_eq!((frame.image.width(), frame.image.height()), (64, 48));
        assert!(
            frame
                .image
                .data()
                .iter()
                .all(|&pixel| pixel.abs_diff(100 * i as u8) <= 3)
        );
        assert_eq!(
            frame.moment,
            Moment::SinceStart(Duration::from_millis(100 * i as u64))
        );
    }
}

#[test]
fn what_is_no_camera_and_no_video_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let missing = folder.path().join("none.avi");
    let error = FrameSource::video(&missing).expect_err("missing");
    assert_eq!(
        (error.kind(), error.path()),
        (ErrorKind::NotFound, Some(missing.as_path()))
    );
    let text = folder.path().join("text.avi");
    std::fs::write(&text, "no video").expect("writable");
    let error = FrameSource::video(&text).expect_err("no video");
    assert!(error.to_string().contains("text.avi"), "{error}");
    let error = FrameSource::camera(987).expect_err("no such camera");
    assert!(error.to_string().contains("camera 987"), "{error}");
}
