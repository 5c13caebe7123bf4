//! How is a suite run, from a name to finished files?

use crate::exhibit::pictures;
use crate::harness::{Fold, Tallies, folds};
use crate::judge::judge_all;
use crate::judge::rates::PairedDifference;
use crate::material::Material;
use crate::progress::progress;
use crate::provenance::{commit, machine, sha256};
use crate::report::Pictures;
use crate::results::{SuiteResults, Variant};
use crate::several::Parts;
use crate::suite::{Protocol, Suite};
use crate::truth::visibility_errors;
use anyhow::{Context, Result};
use chronotope::Time;
use chronotope::dataset::synthetic::{Schedule, World, WorldConfig};
use chronotope::dataset::{Dataset, Manifest};
use chronotope::feature::{StarBrief, StarBriefConfig};
use chronotope::localize::Score;
use std::path::PathBuf;

/// The number of features at which a synthetic suite compares methods in words.
const COMPARED_N: u32 = 30;

/// Where a run reads and writes.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// The folder that holds the dataset, or the folders of several.
    pub data: Option<PathBuf>,
    /// Where results go; created if missing.
    pub out: PathBuf,
    /// Where extracted features are kept from run to run.
    pub cache: PathBuf,
    /// Of a series' suite: the share of samples that thinning keeps, in place of the suite's.
    pub share: Option<f64>,
    /// The command line, for the report.
    pub command: String,
}

/// Runs a suite and gives its results with pictures for the report; a synthetic suite also those of its control world.
pub fn run(suite: &Suite, options: &RunOptions) -> Result<Vec<(SuiteResults, Pictures)>> {
    let mut all = match &suite.protocol {
        Protocol::Synthetic {
            num_seeds,
            num_learn,
            num_query,
        } => {
            let plan = Worlds {
                seeds: *num_seeds,
                learn: *num_learn,
                query: *num_query,
            };
            let (mut main, main_pictures) = plan.run(suite, true)?;
            let (mut control, control_pictures) = plan.run(suite, false)?;
            control.suite = format!("{}-control", suite.name);
            for (results, rhythms) in [(&mut main, true), (&mut control, false)] {
                results.visibility_errors =
                    visibility_errors(*num_seeds, *num_learn, *num_query, rhythms)?;
            }
            main.notes
                .extend(against_static(&main, "FreMEn against static"));
            main.notes.extend(against_static(
                &control,
                "The same where nothing depends on time",
            ));
            control
                .notes
                .extend(against_static(&control, "FreMEn against static"));
            vec![(main, main_pictures), (control, control_pictures)]
        }
        Protocol::Several {
            suites,
            leave_place_out,
            num_seeds,
        } => {
            let parts = Parts {
                suites,
                leave_place_out: *leave_place_out,
                num_seeds: *num_seeds,
            };
            vec![(parts.run(suite, options)?, Pictures::default())]
        }
        _ => vec![run_images(suite, options)?],
    };
    let parts: &[String] = match &suite.protocol {
        Protocol::Several { suites, .. } => suites,
        _ => &[],
    };
    for (results, _) in &mut all {
        results.judgement = judge_all(results, parts);
        results.commit = commit();
        results.machine = machine();
        results.command.clone_from(&options.command);
    }
    Ok(all)
}

/// The images of a suite with their features, and its folds.
pub(crate) fn images(suite: &Suite, options: &RunOptions) -> Result<(Material, Vec<Fold>)> {
    let manifest = Manifest::find_builtin(&suite.dataset)?;
    let data = options.data.as_deref().with_context(|| {
        format!(
            "suite `{}` needs images: name the folder of `{}` with --data DIR or the variable \
             CHRONOTOPE_DATA",
            suite.name, suite.dataset
        )
    })?;
    let dataset = Dataset::open_with(&manifest, data)?;
    let bar = progress(dataset.entries.len(), "features");
    let material = Material::new(dataset, &extractor()?, Some(&options.cache), &|| bar.inc(1))?;
    bar.finish_and_clear();
    let folds = folds(&suite.protocol, &material.dataset, Some(&manifest))?;
    Ok((material, folds))
}

fn run_images(suite: &Suite, options: &RunOptions) -> Result<(SuiteResults, Pictures)> {
    let (material, folds) = images(suite, options)?;
    let mut results = SuiteResults::new(&suite.name, &material.dataset.name);
    results.dataset_sha256 = material.dataset.sha256();
    results.split = describe(&suite.protocol, &folds);
    let mut tallies = Tallies::new(suite);
    let bar = progress(folds.len() * suite.arms.len(), "folds");
    tallies.add(&material, &folds, None, &|| bar.inc(1))?;
    bar.finish_and_clear();
    let exhibit = tallies.take_exhibit();
    tallies.finish(&mut results);
    results
        .notes
        .extend(material.dataset.problems.iter().map(ToString::to_string));
    let pictures = match exhibit {
        Some(exhibit) => pictures(&results, &material, exhibit, None)?,
        None => Pictures::default(),
    };
    Ok((results, pictures))
}

/// The worlds of a synthetic suite: seeds `1..=seeds`, rounds to learn and to ask about.
pub(crate) struct Worlds {
    pub(crate) seeds: u64,
    pub(crate) learn: usize,
    pub(crate) query: usize,
}

impl Worlds {
    /// The images of one world, and when the first one is asked for.
    pub(crate) fn world(&self, seed: u64, rhythms: bool, name: &str) -> Result<(Dataset, Time)> {
        let world = World::new(&WorldConfig::new(seed).rhythms(rhythms))?;
        let schedule = Schedule::standard(seed, self.learn, self.query);
        let all: Vec<_> = [&schedule.learn[..], &schedule.query[..]].concat();
        let split = schedule.query.first().copied().unwrap_or_default();
        Ok((world.dataset(name, &all), split))
    }

    fn run(&self, suite: &Suite, rhythms: bool) -> Result<(SuiteResults, Pictures)> {
        let name = if rhythms {
            "synthetic"
        } else {
            "synthetic-control"
        };
        let mut results = SuiteResults::new(&suite.name, name);
        let extractor = extractor()?;
        let mut tallies = Tallies::new(suite);
        let mut digest = String::new();
        // The first world, whose images the report shows.
        let mut shown = None;
        let bar = progress(self.seeds as usize, name);
        for seed in 1..=self.seeds {
            let (dataset, split) = self.world(seed, rhythms, name)?;
            digest.push_str(&dataset.sha256());
            let material = Material::new(dataset, &extractor, None, &|| {})?;
            let fold = split_at(&material, split);
            tallies.add(&material, &[fold], Some(&prefix(seed)), &|| {})?;
            shown.get_or_insert(material);
            bar.inc(1);
        }
        bar.finish_and_clear();
        let exhibit = tallies.take_exhibit();
        tallies.finish(&mut results);
        results.dataset_sha256 = sha256(digest.as_bytes());
        results.split = format!(
            "{} worlds (seeds 1 to {}): {} rounds in 2023 learnt, {} rounds in 2024 asked for",
            self.seeds, self.seeds, self.learn, self.query
        );
        let pictures = match (exhibit, &shown) {
            (Some(exhibit), Some(material)) => {
                pictures(&results, material, exhibit, Some(&prefix(1)))?
            }
            _ => Pictures::default(),
        };
        Ok((results, pictures))
    }
}

/// Learns what was seen before `split`, asks for the rest.
pub(crate) fn split_at(material: &Material, split: Time) -> Fold {
    let (query, learn) = (0..material.dataset.entries.len())
        .partition(|&i| material.dataset.entries[i].time >= split);
    Fold { learn, query }
}

/// What the ids of a world's queries begin with.
pub(crate) fn prefix(seed: u64) -> String {
    format!("seed {seed:02}")
}

/// The sentences that compare the default `fremen` with `static` at n = 30, per query, for each score.
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
            order: crate::results::Order::Fixed(0),
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

fn describe(protocol: &Protocol, folds: &[Fold]) -> String {
    let queries: usize = folds.iter().map(|fold| fold.query.len()).sum();
    match protocol {
        Protocol::LeaveOneVisitOut => format!(
            "each of {} visits left out once: learn the others, {queries} queries in all",
            folds.len()
        ),
        _ => format!(
            "{} images learnt, {queries} later ones asked for",
            folds.iter().map(|fold| fold.learn.len()).sum::<usize>()
        ),
    }
}

pub(crate) fn extractor() -> Result<StarBrief> {
    Ok(StarBrief::new(StarBriefConfig::default())?)
}
