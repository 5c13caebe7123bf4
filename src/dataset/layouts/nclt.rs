//! Which images of these NCLT sessions show a place?
//!
//! A session is a folder `images/YYYY-MM-DD` with raw images `lb3/CamN/<utime>.tiff`, named by
//! their time in µs since 1970, and a ground truth `groundtruth_YYYY-MM-DD.csv` with rows
//! `utime,x,y,z,roll,pitch,yaw` (m and rad; in the folder itself, in `ground_truth` or in
//! `groundtruth`). An image has the pose that is nearest in time, if one is near enough. One pass
//! of a place (consecutive images within the radius, and within 60 degrees of its heading if it has
//! one) gives one entry: the image nearest to the place, the earliest of equals.
//!
//! Source: Carlevaris-Bianco, Ushani and Eustice, "University of Michigan North Campus long-term
//! vision and lidar dataset", IJRR 2016.

use std::path::{Path, PathBuf};

use super::collector::Collector;
use crate::dataset::manifest::{Layout, NcltPlace};
use crate::dataset::paths::{digits, image_rank, list, name_of, relative, stem_of};
use crate::dataset::table::{MAX_TABLE_BYTES, read_text};
use crate::map::PlaceKey;
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::Time;

/// A robot that faces another way than the place's heading by more than this sees something else.
const HEADING_TOLERANCE_DEG: f64 = 60.0;

const GROUND_TRUTH_FOLDERS: [&str; 3] = ["", "ground_truth", "groundtruth"];

/// The folders of sessions in `root`, by date.
pub(super) fn sessions(root: &Path) -> Result<Vec<PathBuf>> {
    let images = root.join("images");
    if !images.is_dir() {
        return Ok(Vec::new());
    }
    Ok(list(&images)?
        .into_iter()
        .filter(|path| path.join("lb3").is_dir() && is_date(&name_of(path)))
        .collect())
}

pub(super) fn read(collector: &mut Collector<'_>, layout: &Layout) -> Result<()> {
    let Layout::Nclt {
        camera,
        radius_m,
        max_pose_gap_s,
        rotation,
        place: places,
        spacing_m,
    } = layout
    else {
        return Ok(());
    };
    let along_route = match spacing_m {
        Some(spacing_m) => places_along_route(collector.root, *spacing_m)?,
        None => Vec::new(),
    };
    let places = || places.iter().chain(&along_route);
    for place in places() {
        let position = [place.x, place.y, place.z];
        collector.poses.insert(place.key.clone(), position);
    }
    for session in sessions(collector.root)? {
        let date = name_of(&session);
        let subject = format!("session {date}");
        let folder = session.join("lb3").join(format!("Cam{camera}"));
        if !folder.is_dir() {
            let message = format!(
                "the folder `{}` does not exist (help: unpack the images of camera {camera} or name another camera)",
                relative(collector.root, &folder)
            );
            collector.problem(subject, message);
            continue;
        }
        let Some(ground_truth) = find_ground_truth(collector.root, &date) else {
            let message = format!(
                "there is no groundtruth_{date}.csv, so its images have no place (help: download the ground truth next to `images`)"
            );
            collector.problem(subject, message);
            continue;
        };
        let poses = read_ground_truth(&ground_truth)?;
        let images = located_images(collector, &folder, &poses, *max_pose_gap_s, &subject)?;
        for place in places() {
            for best in passes(&images, place, *radius_m) {
                let path = relative(collector.root, &best.path);
                collector.add(&path, &place.key, best.time, &path, |image| {
                    // Also where the manifest has other layouts for other folders.
                    image.with_rotation(*rotation)
                });
            }
        }
    }
    Ok(())
}

struct Pose {
    time: Time,
    x: f64,
    y: f64,
    yaw_rad: f64,
}

struct Located {
    path: PathBuf,
    time: Time,
    x: f64,
    y: f64,
    yaw_rad: f64,
}

/// A place every `spacing_m` metres along the earliest session that has a ground truth; where the
/// robot comes back facing another way, there is another place. None without such a session.
fn places_along_route(root: &Path, spacing_m: f64) -> Result<Vec<NcltPlace>> {
    let sessions = sessions(root)?;
    let mut truths =
        (sessions.iter()).filter_map(|session| find_ground_truth(root, &name_of(session)));
    let Some(ground_truth) = truths.next() else {
        return Ok(Vec::new());
    };
    let mut places: Vec<NcltPlace> = Vec::new();
    for pose in read_ground_truth(&ground_truth)? {
        let is_known = places.iter().rev().any(|place| {
            let distance_m = (pose.x - place.x).hypot(pose.y - place.y);
            distance_m < spacing_m && faces(pose.yaw_rad, place.heading_deg)
        });
        if !is_known {
            places.push(NcltPlace {
                key: PlaceKey::new(&format!("r{:04}", places.len()))?,
                x: pose.x,
                y: pose.y,
                z: 0.0,
                heading_deg: Some(pose.yaw_rad.to_degrees()),
            });
        }
    }
    Ok(places)
}

/// The images of one camera with their poses, by time; those without are counted as a problem.
fn located_images(
    collector: &mut Collector<'_>,
    folder: &Path,
    poses: &[Pose],
    max_gap_s: f64,
    subject: &str,
) -> Result<Vec<Located>> {
    let mut images = Vec::new();
    let mut num_without = 0_usize;
    for path in list(folder)? {
        if image_rank(&path).is_none() {
            continue;
        }
        let Some(us) = digits(&stem_of(&path)) else {
            let subject = relative(collector.root, &path);
            collector.problem(
                subject,
                "the name is not a time in µs since 1970, as in 1326030975726043.tiff (help: rename or move it)",
            );
            continue;
        };
        let time = Time::from_us(us);
        match nearest(poses, time).filter(|pose| pose.time.since_s(time).abs() <= max_gap_s) {
            Some(pose) => images.push(Located {
                path,
                time,
                x: pose.x,
                y: pose.y,
                yaw_rad: pose.yaw_rad,
            }),
            None => num_without += 1,
        }
    }
    if num_without > 0 {
        collector.problem(
            subject,
            format!(
                "{num_without} of {} images have no pose within {max_gap_s} s (help: see that the ground truth is complete, or raise max_pose_gap_s)",
                num_without + images.len()
            ),
        );
    }
    images.sort_by_key(|image| image.time);
    Ok(images)
}

/// The best image of each pass of `place`.
fn passes<'a>(images: &'a [Located], place: &NcltPlace, radius_m: f64) -> Vec<&'a Located> {
    let mut found = Vec::new();
    let mut best: Option<(f64, &Located)> = None;
    for image in images {
        let distance_m = (image.x - place.x).hypot(image.y - place.y);
        if distance_m <= radius_m && faces(image.yaw_rad, place.heading_deg) {
            if best.is_none_or(|(least, _)| distance_m < least) {
                best = Some((distance_m, image));
            }
        } else if let Some((_, image)) = best.take() {
            found.push(image);
        }
    }
    found.extend(best.map(|(_, image)| image));
    found
}

fn faces(yaw_rad: f64, heading_deg: Option<f64>) -> bool {
    heading_deg.is_none_or(|heading_deg| {
        let difference = (yaw_rad.to_degrees() - heading_deg).rem_euclid(360.0);
        difference.min(360.0 - difference) <= HEADING_TOLERANCE_DEG
    })
}

/// The pose nearest in time, the earlier of equals; `poses` are sorted by time.
fn nearest(poses: &[Pose], time: Time) -> Option<&Pose> {
    let next = poses.partition_point(|pose| pose.time < time);
    let before = next.checked_sub(1).map(|position| &poses[position]);
    let gap_s = |pose: &Pose| pose.time.since_s(time).abs();
    match (before, poses.get(next)) {
        (Some(before), Some(after)) if gap_s(after) < gap_s(before) => Some(after),
        (Some(before), _) => Some(before),
        (None, after) => after,
    }
}

fn find_ground_truth(root: &Path, date: &str) -> Option<PathBuf> {
    GROUND_TRUTH_FOLDERS
        .iter()
        .map(|folder| root.join(folder).join(format!("groundtruth_{date}.csv")))
        .find(|path| path.is_file())
}

/// Poses by time; rows that are NaN, as the published files have at the start, say nothing.
fn read_ground_truth(path: &Path) -> Result<Vec<Pose>> {
    let text = read_text(path, MAX_TABLE_BYTES)?;
    let mut poses = Vec::new();
    for (position, line) in text.lines().enumerate() {
        let line = line.trim();
        let is_header = position == 0 && line.starts_with(|c: char| c.is_ascii_alphabetic());
        if line.is_empty() || is_header {
            continue;
        }
        let bad = |message: String| {
            Error::new(ErrorKind::Format, message)
                .with_path(path)
                .with_place(format!("line {}", position + 1))
                .with_help(
                    "a row is utime,x,y,z,roll,pitch,yaw in µs, m and rad; download the file again",
                )
        };
        let cells: Vec<_> = line.split(',').map(str::trim).collect();
        let &[utime, x, y, _, _, _, yaw] = cells.as_slice() else {
            return Err(bad(format!("{} numbers instead of 7", cells.len())));
        };
        let number = |cell: &str| {
            cell.parse::<f64>()
                .map_err(|_| bad(format!("`{cell}` is not a number")))
        };
        let us = digits(utime).ok_or_else(|| bad(format!("`{utime}` is not a time in µs")))?;
        let (x, y, yaw_rad) = (number(x)?, number(y)?, number(yaw)?);
        if [x, y, yaw_rad].iter().all(|value| value.is_finite()) {
            poses.push(Pose {
                time: Time::from_us(us),
                x,
                y,
                yaw_rad,
            });
        }
    }
    poses.sort_by_key(|pose| pose.time);
    Ok(poses)
}

fn is_date(name: &str) -> bool {
    name.len() == 10 && name.parse::<jiff::civil::Date>().is_ok()
}
