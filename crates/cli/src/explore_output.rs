//! How is a plan shown: for people, for programs, for calendars?

use anyhow::Result;
use fremen::Time;
use serde_json::json;

use chronotope_terminal::Output;

/// One visit, in the words of whoever planned it.
pub(super) struct PlannedVisit {
    pub(super) start: Time,
    pub(super) end: Time,
    pub(super) place: String,
    pub(super) info_bits: f64,
    pub(super) reason: String,
}

/// The form of a plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Form {
    Table,
    Json,
    Csv,
    Ics,
}

pub(super) fn show(
    visits: &[PlannedVisit],
    form: Form,
    stamp: Time,
    out: &mut Output,
) -> Result<()> {
    match form {
        Form::Table => table(visits, out),
        Form::Json => visits.iter().try_for_each(|visit| {
            out.json(&json!({
                "start": visit.start.to_string(),
                "end": visit.end.to_string(),
                "place": visit.place,
                "info_bits": visit.info_bits,
                "reason": visit.reason,
            }))
        }),
        Form::Csv => csv(visits, out),
        Form::Ics => ics(visits, stamp, out),
    }
}

fn table(visits: &[PlannedVisit], out: &mut Output) -> Result<()> {
    let width = visits.iter().map(|visit| visit.place.chars().count()).max();
    let width = width.unwrap_or_default().clamp(5, 40);
    out.line(format_args!(
        "{:20}  {:20}  {:width$}  {:>6}  why",
        "start", "end", "place", "bits"
    ))?;
    for visit in visits {
        out.line(format_args!(
            "{:20}  {:20}  {:width$}  {:6.2}  {}",
            visit.start.to_string(),
            visit.end.to_string(),
            visit.place,
            visit.info_bits,
            visit.reason
        ))?;
    }
    Ok(())
}

fn csv(visits: &[PlannedVisit], out: &mut Output) -> Result<()> {
    out.line("start,end,place,info_bits,reason")?;
    for visit in visits {
        out.line(format_args!(
            "{},{},{},{:.4},{}",
            visit.start,
            visit.end,
            quoted(&visit.place),
            visit.info_bits,
            quoted(&visit.reason)
        ))?;
    }
    Ok(())
}

/// A cell of a CSV file.
fn quoted(text: &str) -> String {
    if text.contains(['"', ',', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

/// `iCalendar` (RFC 5545).
fn ics(visits: &[PlannedVisit], stamp: Time, out: &mut Output) -> Result<()> {
    let mut line = |text: String| {
        // No line is longer than 75 bytes; what is left goes on after a space. Lines end in CR LF.
        let mut rest = text.as_str();
        let mut begin = "";
        while begin.len() + rest.len() > 75 {
            let mut cut = 75 - begin.len();
            while !rest.is_char_boundary(cut) {
                cut -= 1;
            }
            out.raw_line(&format!("{begin}{}", &rest[..cut]))?;
            rest = &rest[cut..];
            begin = " ";
        }
        out.raw_line(&format!("{begin}{rest}"))
    };
    line("BEGIN:VCALENDAR".into())?;
    line("VERSION:2.0".into())?;
    line("PRODID:-//Chronotope//explore//EN".into())?;
    for visit in visits {
        line("BEGIN:VEVENT".into())?;
        let start = compact(visit.start);
        line(format!("UID:{start}-{}@chronotope", escaped(&visit.place)))?;
        line(format!("DTSTAMP:{}", compact(stamp)))?;
        line(format!("DTSTART:{start}"))?;
        line(format!("DTEND:{}", compact(visit.end)))?;
        line(format!("SUMMARY:Look at {}", escaped(&visit.place)))?;
        line(format!(
            "DESCRIPTION:{:.2} bits: {}",
            visit.info_bits,
            escaped(&visit.reason)
        ))?;
        line("END:VEVENT".into())?;
    }
    line("END:VCALENDAR".into())
}

/// `20240501T083000Z`: parts of a second are cut.
fn compact(time: Time) -> String {
    let text = time.to_string();
    let whole = text
        .trim_end_matches('Z')
        .split('.')
        .next()
        .unwrap_or_default();
    let digits: String = whole
        .chars()
        .filter(|c| c.is_ascii_digit() || *c == 'T')
        .collect();
    digits + "Z"
}

/// Text of a calendar; control characters are left out.
fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars().filter(|c| !c.is_control()) {
        if matches!(c, '\\' | ';' | ',') {
            escaped.push('\\');
        }
        escaped.push(c);
    }
    escaped
}
