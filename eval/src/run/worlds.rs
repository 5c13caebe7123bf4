//! How is a synthetic suite run, with rhythms and in its control without them?

use anyhow::Result;
use chronotope::feature::Extractor;
use chronotope::localize::Score;

use super::dataset::DatasetRun;
use super::showcase::{Shown, SuiteRun};
use super::truth::visibility_errors;
use crate::data::{ExtractedDataset, Worlds, prefix, split_at};
use crate::judge::rates::PairedDifference;
use crate::progress::Progress;
use crate::provenance::sha256;
use crate::results::{RowOrder, SuiteResults, Variant};
use crate::suite::Suite;

/// The number of features at which a synthetic suite compares methods in words.
const COMPARED_N: u32 = 30;

/// Runs a suite in its worlds and in the control, where nothing depends on time.
pub(super) fn run_worlds(
    suite: &Suite,
    worlds: &Worlds,
    extractor: &dyn Extractor,
) -> Result<[SuiteRun; 2]> {
    let mut main = run_with(suite, worlds, extractor, true)?;
    let mut control = run_with(suite, worlds, extractor, false)?;
    control.results.suite = format!("{}-control", suite.name);
    for (run, rhythms) in [(&mut main, true), (&mut control, false)] {
        run.results.visibility_errors =
            visibility_errors(worlds.seeds, worlds.learn, worlds.query, rhythms)?;
    }
    let title = "FreMEn against static";
    let of_main = against_static(&main.results, title);
    main.results.notes.extend(of_main);
    main.results.notes.extend(against_static(
        &control.results,
        "The same where nothing depends on time",
    ));
    let of_control = against_static(&control.results, title);
    control.results.notes.extend(of_control);
    Ok([main, control])
}

fn run_with(
    suite: &Suite,
    worlds: &Worlds,
    extractor: &dyn Extractor,
    rhythms: bool,
) -> Result<SuiteRun> {
    let name = if rhythms {
        "synthetic"
    } else {
        "synthetic-control"
    };
    let mut results = SuiteResults::new(&suite.name, name);
    let mut run = DatasetRun::new(suite);
    let mut digest = String::new();
    // The first world, whose images the report shows.
    let mut shown = None;
    let bar = Progress::new(worlds.seeds as usize, name);
    for seed in 1..=worlds.seeds {
        let (dataset, split) = worlds.world(seed, rhythms, name)?;
        digest.push_str(&dataset.sha256());
        let data = ExtractedDataset::new(dataset, extractor, None, &|| {})?;
        let fold = split_at(&data, split);
        run.add(&data, &[fold], Some(&prefix(seed)), &|| {})?;
        shown.get_or_insert(data);
        bar.inc();
    }
    drop(bar);
    let showcase = run.finish(&mut results);
    results.dataset_sha256 = sha256(digest.as_bytes());
    results.split = format!(
        "{} worlds (seeds 1 to {}): {} rounds in 2023 learnt, {} rounds in 2024 queried",
        worlds.seeds, worlds.seeds, worlds.learn, worlds.query
    );
    Ok(SuiteRun {
        results,
        shown: showcase.zip(shown).map(|(showcase, data)| Shown {
            showcase,
            data,
            prefix: Some(prefix(1)),
        }),
    })
}

/// The sentences that compare the default `fremen` with `static` at n = 30, per query, for each
/// score.
fn against_static(results: &SuiteResults, title: &str) -> Vec<String> {
    let Some(default) = results.default_variant() else {
        return Vec::new();
    };
    let said = [Score::Inliers, Score::Count].into_iter().filter_map(|score| {
        let fremen = Variant {
            score: score.name().into(),
            ..default.clone()
        };
        let fixed = Variant {
            method: "static".into(),
            model: "mean".into(),
            order: RowOrder::Fixed(0),
            ..fremen.clone()
        };
        let [fremen, fixed] = [fremen.at(COMPARED_N), fixed.at(COMPARED_N)];
        let paired = PairedDifference::between(&results.queries, &fremen, &fixed)?;
        Some(format!(
            "{title}, n = {COMPARED_N}, score {score}: {:.1} % wrong against {:.1} %, {:.1} points fewer \
             (95 % interval {:.1} to {:.1})",
            paired.first_percent,
            paired.second_percent,
            paired.points.mean,
            paired.points.interval.low,
            paired.points.interval.high
        ))
    });
    said.collect()
}
