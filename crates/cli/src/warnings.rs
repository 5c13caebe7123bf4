//! What should people know that is no answer and no error?
//!
//! Lines on stderr that several commands print alike.

use std::path::Path;

use chronotope::map::{QuarantineReason, Snapshot};
use chronotope::time::{Period, Time};

/// Says that a visit was not learnt, and why.
pub(super) fn print_held(source: &str, doubt: &QuarantineReason, map: &Path) {
    note!(
        "held: {source}: {doubt} (`chronotope map held {}` lists all)",
        map.display()
    );
}

/// Says how many visits wait, and what can be done about them.
pub(super) fn print_num_held(num_held: usize, map: &Path) {
    let (what, map) = match num_held {
        1 => ("1 visit is".to_owned(), map.display()),
        _ => (format!("{num_held} visits are"), map.display()),
    };
    note!(
        "{what} held and not learnt: `chronotope map held {map}` lists them, `chronotope map accept \
         {map} --all` learns them, `chronotope map drop {map} --all` forgets them"
    );
}

/// Says so if `time` lies before the map's visits or far after them; answers are given all the
/// same.
pub(super) fn warn_of_time(snapshot: &Snapshot, time: Time, name: Option<&str>) -> bool {
    let summary = snapshot.summary();
    let (Some(first), Some(last)) = (summary.first, summary.last) else {
        return false;
    };
    let name = name.map_or_else(String::new, |name| format!("{name}: "));
    let far_s = last.since_s(first).max(Period::YEAR.as_s());
    if time < first {
        note!("warning: {name}{time} is before the map's first visit at {first}");
    } else if time.since_s(last) > far_s {
        let years = time.since_s(last) / Period::YEAR.as_s();
        note!(
            "warning: {name}{time} is {years:.1} years after the map's last visit at {last}: its \
             rhythms may have changed"
        );
    } else {
        return false;
    }
    true
}
