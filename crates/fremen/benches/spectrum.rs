//! How fast are time models learnt and evaluated, against the same sums written plainly?
//!
//! Every run checks what it computed. `cargo bench --bench spectrum`; the same comparisons are part
//! of `chronotope-eval speed`.

#![allow(missing_docs, reason = "a benchmark has no users")]
#![allow(clippy::print_stdout, reason = "the printed ratios are the result")]

mod temporal;

use anyhow::Result;
use fremen::spectrum::CandidatePeriods;
use fremen::visibility::{VisibilityConfig, Visits, fit};
use fremen::{Period, Time};
use temporal::{Sizes, best, fremen, log, model_bytes, ms_a_run, temporal};

fn a_large_place() -> Result<()> {
    let log = log(100_000, 600, 0.03)?;
    let candidates = CandidatePeriods::harmonic(Period::DAY, 12)?;
    for name in ["mean", "fremen, order 2"] {
        let (learn_ms, model) = ms_a_run(0.1, || match name {
            "mean" => fit(&log, &VisibilityConfig::mean(), Visits::All),
            _ => fremen(&log, &candidates, 2),
        });
        let model = model?;
        let mut p = vec![0.0; log.num_features()];
        let (predict_ms, ()) = ms_a_run(0.1, || model.predict_into(Time::default(), &mut p));
        println!(
            "place of 100,000 features x 600 visits x 12 candidates, {name}: learn {:.1} ms, predict {:.2} ms",
            best(&learn_ms),
            best(&predict_ms)
        );
    }
    println!(
        "bytes a feature: log {} (600 visits, 1 bit each), mean {}, fremen of order 2 {}",
        log.num_visits() / 8,
        model_bytes(0),
        model_bytes(2)
    );
    Ok(())
}

fn main() -> Result<()> {
    for row in temporal(&Sizes::default())? {
        println!(
            "{}: {:.4} ms ({}); {} {:.4} ms ({}); {:.2} times faster, {} results agree",
            row.case,
            best(&row.ours_ms),
            row.ours_note,
            row.twin,
            best(&row.twin_ms),
            row.twin_note,
            best(&row.twin_ms) / best(&row.ours_ms),
            row.num_checked
        );
    }
    a_large_place()
}
