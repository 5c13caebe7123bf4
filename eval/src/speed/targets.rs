//! Which of the speeds that this project promises does the run bear out?
//!
//! A target is a ratio of two rows of one run, or a number that matters to a robot's user. A target
//! whose rows are not there (no AVX-512, no FAISS, a smaller map) is not judged.

use super::measurement::{Measurement, SpeedReport, Target};
use super::{end_to_end, extraction, opening, search};

/// What an approximate search must find of the nearest to be compared.
pub(super) const ENOUGH: f64 = 0.99;

/// The rows of a report, by section, case and subject.
struct Rows<'a>(&'a [Measurement]);

impl<'a> Rows<'a> {
    /// The fastest row of a section that is accepted.
    fn fastest(
        &self,
        section: &str,
        accept: impl Fn(&Measurement) -> bool,
    ) -> Option<&'a Measurement> {
        (self.0.iter())
            .filter(|row| row.section == section && accept(row))
            .min_by(|a, b| a.ms_best.total_cmp(&b.ms_best))
    }

    fn searched(&self, num_rows: usize, subject: &str) -> Option<&'a Measurement> {
        let case = format!("500 x {num_rows}");
        self.fastest(search::SECTION, |row| {
            row.case == case && row.subject == subject
        })
    }

    fn of_places(
        &self,
        section: &str,
        num_places: usize,
        subject: &str,
    ) -> Option<&'a Measurement> {
        let case = format!("{num_places} places");
        self.fastest(section, |row| row.case == case && row.subject == subject)
    }
}

/// How many times as fast `fast` is.
fn ratio(slow: Option<&Measurement>, fast: Option<&Measurement>) -> Option<f64> {
    Some(slow?.ms_best / fast?.ms_best)
}

/// Every target, judged by the rows of `report`.
pub(super) fn judge(report: &SpeedReport) -> Vec<Target> {
    let rows = Rows(&report.measurements);
    let mut targets = of_search(&rows);
    targets.push(Target::at_least(
        "STAR + BRIEF against OpenCV's, one thread, times as fast",
        3.0,
        ratio(
            rows.fastest(extraction::SECTION, |row| row.is_reference),
            rows.fastest(extraction::SECTION, |row| !row.is_reference),
        ),
    ));
    targets.extend(of_answers(&rows));
    targets
}

fn of_search(rows: &Rows<'_>) -> Vec<Target> {
    let against = |kernel: &str, rival: &str, num_rows, wanted| {
        let name = format!("{kernel} against {rival}, 500 x {num_rows}, times as fast");
        let found = ratio(
            rows.searched(num_rows, rival),
            rows.searched(num_rows, kernel),
        );
        Target::at_least(name, wanted, found)
    };
    let in_cache = ratio(
        rows.searched(400, "avx512: popcounts alone"),
        rows.searched(400, "avx512"),
    );
    let approximate = |family: &str| {
        rows.fastest(search::SECTION, |row| {
            row.case == "500 x 1000000"
                && row.subject.starts_with(family)
                && row.recall.is_some_and(|recall| recall >= ENOUGH)
        })
    };
    vec![
        against("avx512", search::OPENCV, 400, 20.0),
        against("avx512", search::OPENCV, 40_000, 15.0),
        against("avx2", search::OPENCV, 400, 5.0),
        against("avx2", search::OPENCV, 40_000, 5.0),
        against("avx512", "FAISS flat", 400, 4.0),
        against("avx512", "FAISS flat", 40_000, 4.0),
        against("avx512", "FAISS flat", 1_000_000, 2.5),
        Target::at_least(
            "avx512 in cache (500 x 400), % of its popcount limit",
            70.0,
            in_cache.map(|share| 100.0 * share),
        ),
        Target::at_least(
            "inverted file against FAISS's, 500 x 1000000, nearest >= 99 %, times as fast",
            3.0,
            ratio(approximate("FAISS IVF"), approximate("ours, IVF")),
        ),
    ]
}

fn of_answers(rows: &Rows<'_>) -> Vec<Target> {
    let whole = |num_places, subject| rows.of_places(end_to_end::SECTION, num_places, subject);
    let listed = whole(10_000, end_to_end::LISTED);
    let of_median =
        |slow: Option<&Measurement>, fast: Option<&Measurement>| Some(slow?.ms_p50 / fast?.ms_p50);
    let answer_of_extract = of_median(whole(8, end_to_end::WHOLE), whole(8, end_to_end::EXTRACT));
    let opened = rows.of_places(opening::SECTION, 10_000, opening::BY_QUERY_FORM);
    vec![
        Target::at_most(
            "10,000 places, matching and decision, ms at the median",
            40.0,
            listed.map(|row| row.ms_p50),
        ),
        Target::at_least(
            "10,000 places, the same first place as the exact answer, %",
            99.5,
            listed.and_then(|row| Some(100.0 * row.recall?)),
        ),
        Target::at_least(
            "10,000 places, against the exact answer, times as fast",
            5.0,
            ratio(whole(10_000, end_to_end::WHOLE), listed),
        ),
        Target::at_most(
            "from 1,000 to 10,000 places, times as slow at the median",
            4.0,
            of_median(listed, whole(1_000, end_to_end::LISTED)),
        ),
        Target::at_most(
            "8 places, extraction and answer against extraction alone, times as slow",
            1.1,
            answer_of_extract.map(|share| 1.0 + share),
        ),
        Target::at_most(
            "10,000 places of 500 features, opened by the query form, s",
            1.0,
            opened.map(|row| row.ms_best / 1e3),
        ),
        Target::at_most(
            "query form, bytes a feature",
            100.0,
            opened.and_then(|row| row.bytes_per_feature),
        ),
    ]
}

/// From how many places on a short list is faster than matching all of them, by the straight line
/// between the sizes on both sides, on logarithmic axes; `None` if it never is, or always.
pub(super) fn break_even(report: &SpeedReport) -> Option<f64> {
    let ms = |case: &str, subject: &str| {
        (report.measurements.iter())
            .find(|row| {
                row.section == end_to_end::SECTION && row.case == case && row.subject == subject
            })
            .map(|row| row.ms_best)
    };
    let mut sizes: Vec<(f64, f64)> = (report.measurements.iter())
        .filter(|row| row.section == end_to_end::SECTION && row.subject == end_to_end::LISTED)
        .filter_map(|row| {
            let places: f64 = row.case.split(' ').next()?.parse().ok()?;
            let exact = ms(&row.case, end_to_end::WHOLE)?;
            Some((places.ln(), (exact / row.ms_best).ln()))
        })
        .collect();
    sizes.sort_by(|a, b| a.0.total_cmp(&b.0));
    let crossing = sizes
        .windows(2)
        .find(|pair| pair[0].1 < 0.0 && pair[1].1 >= 0.0)?;
    let [(x0, y0), (x1, y1)] = [crossing[0], crossing[1]];
    Some((x0 - y0 * (x1 - x0) / (y1 - y0)).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(measurements: Vec<Measurement>) -> SpeedReport {
        SpeedReport {
            schema_version: 1,
            commit: String::new(),
            machine: String::new(),
            host: Vec::new(),
            command: String::new(),
            material: String::new(),
            missing: Vec::new(),
            measurements,
            targets: Vec::new(),
        }
    }

    fn row(section: &str, case: &str, subject: &str, ms: f64) -> Measurement {
        Measurement::new(section, case, subject, &[ms])
    }

    #[test]
    fn targets_are_judged_by_their_rows_and_not_without() {
        let none = judge(&report(Vec::new()));
        assert!(none.len() > 12 && none.iter().all(|target| target.is_met().is_none()));
        let at = |ours: f64| {
            judge(&report(vec![
                row(search::SECTION, "500 x 400", "avx512", ours),
                row(search::SECTION, "500 x 400", search::OPENCV, 20.0),
                row(
                    opening::SECTION,
                    "10000 places",
                    opening::BY_QUERY_FORM,
                    1e3 * ours,
                )
                .bytes_per_feature(100.0 * ours),
            ]))
        };
        let met = |targets: &[Target], wanted: bool| {
            let judged: Vec<_> = targets.iter().filter_map(Target::is_met).collect();
            judged.len() == 3 && judged.iter().all(|&it| it == wanted)
        };
        assert!(met(&at(1.0), true), "at least is at least");
        assert!(met(&at(1.01), false));
    }

    #[test]
    fn an_approximate_search_that_misses_too_much_is_not_compared() {
        let of = |recall| {
            let case = "500 x 1000000";
            let targets = judge(&report(vec![
                row(search::SECTION, case, "ours, IVF 9, 4 probes", 1.0).recall(recall),
                row(search::SECTION, case, "FAISS IVF 9, nprobe 4", 9.0).recall(0.995),
            ]));
            targets.iter().find_map(|target| target.found)
        };
        assert_eq!(of(0.99), Some(9.0));
        assert_eq!(of(0.98), None);
    }

    #[test]
    fn lists_break_even_where_they_cross_the_exact_answer() {
        let size = |places: &str, exact, listed| {
            [
                row(end_to_end::SECTION, places, end_to_end::WHOLE, exact),
                row(end_to_end::SECTION, places, end_to_end::LISTED, listed),
            ]
        };
        let rows = [size("100 places", 1.0, 2.0), size("400 places", 4.0, 2.0)];
        let found = break_even(&report(rows.concat())).unwrap();
        assert!((found - 200.0).abs() < 1e-9, "{found}");
        assert_eq!(
            break_even(&report(size("100 places", 1.0, 2.0).to_vec())),
            None
        );
    }
}
