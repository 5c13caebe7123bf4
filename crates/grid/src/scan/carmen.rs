//! Which scans does a CARMEN log hold?
//!
//! A line is a message: its name, its numbers, then `TIME HOST TIME`. `FLASER n r_1 ... r_n x y th
//! ox oy oth t host t` is a scan of n beams over 180 degrees with the (corrected) pose of the laser
//! and the pose of the robot's odometry. All other messages are counted and left out.

use std::f64::consts::{FRAC_PI_2, PI};
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use flate2::read::MultiGzDecoder;
use fremen::{Error, ErrorKind, Result, Time};

use crate::pose::Pose2;
use crate::scan::laser::LaserScan;

/// The most bytes of text that one log may have, packed or not.
const MAX_BYTES: u64 = 4 << 30;
/// The longest line.
const MAX_LINE_BYTES: u64 = 1 << 20;
/// The most beams of a scan.
const MAX_BEAMS: usize = 10_000;
/// From here on, a SICK laser's number is a code (81.83 m: out of range, 81.90 m: dazzled, ...) and
/// says nothing of free space.
const FIRST_CODE_M: f32 = 81.0;
/// What follows the ranges: two poses, a time, a host, a time.
const NUM_TRAILING: usize = 9;

/// One scan of a log.
#[derive(Clone, Debug, PartialEq)]
pub struct CarmenScan {
    /// When, on the log's own clock (which often begins at 0).
    pub time: Time,
    /// Where the laser was; in a corrected log as good as truth.
    pub pose: Pose2,
    /// Where the robot believed to be by its wheels.
    pub odometry: Pose2,
    /// The ranges, -90 degrees first.
    pub scan: LaserScan,
}

/// The scans of a log in the order of its lines.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CarmenLog {
    /// The scans of the front laser.
    pub scans: Vec<CarmenScan>,
    /// Lines with other messages.
    pub num_other_lines: usize,
    /// Scans whose time is not later than that of the one before.
    pub num_out_of_order: usize,
}

/// Reads a CARMEN log, which may be packed by gzip.
///
/// # Errors
/// [`ErrorKind::Format`] with the file and the line where a scan is cut or has what is no number,
/// where a pose is not finite, and where the file is too large; what the system says otherwise.
pub fn read_carmen(path: impl AsRef<Path>) -> Result<CarmenLog> {
    let path = path.as_ref();
    let mut file = BufReader::new(fremen::file::open(path)?);
    let begin = file.fill_buf().map_err(|cause| Error::io(path, cause))?;
    let log = if begin.starts_with(&[0x1f, 0x8b]) {
        parse_carmen(BufReader::new(MultiGzDecoder::new(file)))
    } else {
        parse_carmen(file)
    };
    log.map_err(|error| error.with_path(path))
}

/// Reads the text of a CARMEN log.
///
/// # Errors
/// As [`read_carmen`], without the file's name.
pub fn parse_carmen(reader: impl BufRead) -> Result<CarmenLog> {
    let mut reader = reader.take(MAX_BYTES);
    let mut log = CarmenLog::default();
    let mut line = Vec::new();
    for number in 1_u64.. {
        let at = |error: Error| error.with_place(format!("line {number}"));
        line.clear();
        let mut limited = (&mut reader).take(MAX_LINE_BYTES + 1);
        let read = limited.read_until(b'\n', &mut line);
        let length = read.map_err(|cause| at(unreadable(&cause)))? as u64;
        if length == 0 {
            break;
        }
        if length > MAX_LINE_BYTES {
            let message = format!("the line has more than {MAX_LINE_BYTES} bytes");
            return Err(at(Error::new(ErrorKind::Format, message)));
        }
        let is_whole = line.last() == Some(&b'\n');
        let text = str::from_utf8(&line).map_err(|_| {
            let message = "this is no text in UTF-8";
            at(Error::new(ErrorKind::Format, message).with_help("is it a CARMEN log?"))
        })?;
        read_line(text, is_whole, &mut log).map_err(at)?;
    }
    if reader.limit() == 0 {
        let message = format!("the log has more than {MAX_BYTES} bytes");
        return Err(Error::new(ErrorKind::Format, message).with_help("split it"));
    }
    Ok(log)
}

/// A file that cannot be read or unpacked.
fn unreadable(cause: &std::io::Error) -> Error {
    let kind = match cause.kind() {
        std::io::ErrorKind::InvalidData
        | std::io::ErrorKind::InvalidInput
        | std::io::ErrorKind::UnexpectedEof => ErrorKind::Format,
        _ => ErrorKind::Io,
    };
    Error::new(kind, format!("the log ends or is damaged here: {cause}"))
        .with_help("unpack it again, or cut it after the last whole line")
}

fn read_line(text: &str, is_whole: bool, log: &mut CarmenLog) -> Result<()> {
    let mut words = text.split_ascii_whitespace();
    match words.next() {
        Some("FLASER") => {
            let scan = read_scan(words)?;
            let last = log.scans.last();
            log.num_out_of_order += usize::from(last.is_some_and(|last| scan.time <= last.time));
            log.scans.push(scan);
        }
        // The name itself may be what is cut.
        Some(name) if !is_whole && "FLASER".starts_with(name) => {
            return Err(cut("the name of its message"));
        }
        _ => log.num_other_lines += 1,
    }
    Ok(())
}

fn read_scan<'t>(mut words: impl Iterator<Item = &'t str>) -> Result<CarmenScan> {
    let count = words.next().ok_or_else(|| cut("its number of ranges"))?;
    let num_beams = (count.parse().ok())
        .filter(|count| (1..=MAX_BEAMS).contains(count))
        .ok_or_else(|| {
            let message = format!("`{count}` is no number of beams up to {MAX_BEAMS}");
            Error::new(ErrorKind::Format, message)
        })?;
    let mut ranges_m = Vec::with_capacity(num_beams);
    for index in 0..num_beams {
        let word = (words.next()).ok_or_else(|| cut(&format!("range {index} of {num_beams}")))?;
        let range: f32 = number(word)?;
        let is_code = range.is_finite() && range >= FIRST_CODE_M;
        ranges_m.push(if is_code { f32::NAN } else { range });
    }
    let trailing: Vec<&str> = words.take(NUM_TRAILING + 1).collect();
    if trailing.len() < NUM_TRAILING {
        return Err(cut("its poses and times"));
    }
    if trailing.len() > NUM_TRAILING {
        let message = format!("more than {num_beams} ranges and {NUM_TRAILING} words follow");
        return Err(Error::new(ErrorKind::Format, message).with_help("is the line's count right?"));
    }
    let mut poses = [0.0_f64; 6];
    for (pose, word) in poses.iter_mut().zip(&trailing) {
        *pose = number(word)?;
        if !pose.is_finite() {
            let message = format!("a pose with {word} is none");
            return Err(Error::new(ErrorKind::Format, message)
                .with_help("leave out the scans whose pose is not known"));
        }
    }
    // The logger's clock; the first one may be that of another machine.
    let time = Time::from_us(seconds_to_us(number(trailing[8])?)?);
    // With 181 or 361 beams the last one looks to +90 degrees, with 180 or 360 one step less.
    let num_steps = if num_beams % 2 == 1 && num_beams > 1 {
        num_beams - 1
    } else {
        num_beams
    };
    let step_rad = PI / num_steps as f64;
    let scan = LaserScan::new(-FRAC_PI_2, step_rad, f64::from(FIRST_CODE_M), ranges_m)?;
    let [x, y, heading, ox, oy, odometry_heading] = poses;
    Ok(CarmenScan {
        time,
        pose: Pose2::new(x, y, heading),
        odometry: Pose2::new(ox, oy, odometry_heading),
        scan,
    })
}

fn seconds_to_us(seconds: f64) -> Result<i64> {
    let us = (seconds * 1e6).round();
    // `i64::MAX as f64` rounds up, so `<` keeps the cast exact.
    if us.is_finite() && us.abs() < i64::MAX as f64 {
        return Ok(us as i64);
    }
    Err(Error::new(
        ErrorKind::Time,
        format!("{seconds} s is no time"),
    ))
}

fn number<T: std::str::FromStr>(word: &str) -> Result<T> {
    word.parse().map_err(|_| {
        let shown: String = word.chars().take(40).collect();
        Error::new(ErrorKind::Format, format!("`{shown}` is no number"))
    })
}

fn cut(before: &str) -> Error {
    Error::new(
        ErrorKind::Format,
        format!("the line is cut before {before}"),
    )
    .with_help("remove the line, or fetch the log again")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    const LINE: &str = "FLASER 4 1.5 inf nan 81.91 1 2 0.5 3 4 -0.5 7.25 host 7.5\n";

    fn parse(text: &str) -> Result<CarmenLog> {
        parse_carmen(Cursor::new(text.as_bytes()))
    }

    #[test]
    fn scans_are_read_and_other_messages_counted() -> Result<()> {
        let log = parse(&format!(
            "# a comment\nODOM 0 0 0 0 0 0 1 h 1\n{LINE}{LINE}"
        ))?;
        assert_eq!((log.scans.len(), log.num_other_lines), (2, 2));
        assert_eq!(log.num_out_of_order, 1);
        let scan = &log.scans[0];
        assert_eq!(scan.pose, Pose2::new(1.0, 2.0, 0.5));
        assert_eq!(scan.odometry, Pose2::new(3.0, 4.0, -0.5));
        assert_eq!(scan.time, Time::from_us(7_500_000));
        let ranges = scan.scan.ranges_m();
        assert_eq!(ranges[0], 1.5);
        // A code is not free space, a range of infinity is.
        assert!(ranges[1].is_infinite() && ranges[2].is_nan() && ranges[3].is_nan());
        assert!((scan.scan.angle_rad(2)).abs() < 1e-12);
        Ok(())
    }

    #[test]
    fn a_line_that_is_cut_anywhere_is_named() {
        // The host and the time after it may be cut without a trace only inside of the last word.
        let last_word = LINE.len() - "7.5\n".len();
        for end in 1..last_word {
            let text = format!("{LINE}{}", &LINE[..end]);
            let error = parse(&text).expect_err(&LINE[..end]);
            assert_eq!(error.place(), Some("line 2"), "{}", &LINE[..end]);
            assert_eq!(error.kind(), ErrorKind::Format);
            // Also in the middle of a log.
            let text = format!("{}\n{LINE}", &LINE[..end]);
            if end >= "FLASER".len() {
                assert_eq!(parse(&text).expect_err("cut").place(), Some("line 1"));
            }
        }
    }

    #[test]
    fn what_is_no_number_or_no_pose_is_an_error() {
        for (from, to) in [
            ("1.5", "x"),
            ("FLASER 4", "FLASER 3"),
            ("FLASER 4", "FLASER 5"),
            ("FLASER 4", "FLASER 99999999999"),
            ("FLASER 4", "FLASER -1"),
            ("0.5 3", "nan 3"),
            ("0.5 3", "inf 3"),
            ("7.5\n", "1e300\n"),
        ] {
            let text = LINE.replacen(from, to, 1);
            assert_eq!(
                parse(&text).expect_err(&text).place(),
                Some("line 1"),
                "{text}"
            );
        }
        let endless = "9".repeat(MAX_LINE_BYTES as usize + 2);
        assert!(parse(&endless).is_err());
        assert!(parse_carmen(Cursor::new([0xff, 0xfe, b'\n'])).is_err());
    }
}
