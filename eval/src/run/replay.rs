//! How can a suite be watched again, query by query?
//!
//! Every query of a suite is answered once more, by the shipped default where the suite runs it,
//! and its trace ([`chronotope::trace`]) given away: written as JSON Lines, from which
//! `chronotope-dashboard` renders a recording whenever somebody wants to look, or recorded at once
//! with the cargo feature `dashboard`. Each fold's map is learnt again, without the query's
//! duplicates, exactly as when the suite was judged; of a synthetic suite the first world is shown.
//! Stages are timed one query at a time.
//!
//! Not for numbers: rows and intervals come from the run itself.

use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use chronotope::feature::Extractor;
use chronotope::learn::LearnConfig;
use chronotope::localize::{Localization, Localizer, Method, Preset, Query, Scratch};
use chronotope::map::Snapshot;
use chronotope::trace::{Shot, Stage, Trace, TraceConfig, Tracer};

use super::fold::{learn, times};
use super::options::RunOptions;
use crate::data::{ExtractedDataset, Fold, Images, Worlds, images, split_at, without_duplicates};
use crate::progress::Progress;
use crate::suite::{Arm, Protocol, Run, Suite, shipped};

/// Answers every query of `suite` once more and gives its trace to `record`; returns their number.
pub fn replay(
    suite: &Suite,
    options: &RunOptions,
    record: &mut dyn FnMut(&Trace<'_>) -> Result<()>,
) -> Result<usize> {
    check(suite)?;
    let extractor = options.extractor()?;
    let (data, folds) = if let Protocol::Synthetic {
        num_learn,
        num_query,
        ..
    } = &suite.protocol
    {
        let worlds = Worlds {
            seeds: 1,
            learn: *num_learn,
            query: *num_query,
        };
        let (dataset, split) = worlds.world(1, true, "synthetic")?;
        let data = ExtractedDataset::new(dataset, &*extractor, None, &|| {})?;
        let fold = split_at(&data, split);
        (data, vec![fold])
    } else {
        let Images { data, folds, .. } =
            images(suite, options.data.as_deref(), &options.cache, &*extractor)?;
        (data, folds)
    };
    let (arm, run) = shown(suite, &data)?;
    let mut replay = Replay {
        data: &data,
        arm,
        run,
        extractor,
        tracer: Tracer::new(TraceConfig::default()),
        record,
    };
    let bar = Progress::new(folds.len(), "replay");
    let mut num = 0;
    for fold in &folds {
        num += replay.fold(&without_duplicates(&data, fold).0)?;
        bar.inc();
    }
    drop(bar);
    Ok(num)
}

/// Whether `suite` localises images of its own; fails otherwise.
pub fn check(suite: &Suite) -> Result<()> {
    if matches!(
        suite.protocol,
        Protocol::Series { .. }
            | Protocol::Explore { .. }
            | Protocol::Grid { .. }
            | Protocol::MultiDataset { .. }
    ) {
        bail!(
            "suite `{}` localises no images of its own, so there is nothing to trace (help: trace one \
             of the suites of images; `chronotope-eval list` shows them)",
            suite.name
        );
    }
    Ok(())
}

/// [`replay`] into a file of JSON Lines.
pub fn write(suite: &Suite, options: &RunOptions, path: &Path) -> Result<usize> {
    let failed = || format!("cannot write {}", path.display());
    let mut out = BufWriter::new(File::create(path).with_context(failed)?);
    let num = replay(suite, options, &mut |trace| {
        serde_json::to_writer(&mut out, trace).with_context(failed)?;
        out.write_all(b"\n").with_context(failed)
    })?;
    out.flush().with_context(failed)?;
    Ok(num)
}

/// [`replay`] into a recording for the rerun viewer.
#[cfg(feature = "dashboard")]
pub fn record(suite: &Suite, options: &RunOptions, path: &Path) -> Result<usize> {
    use chronotope_dashboard::{Destination, Recorder, RecorderConfig};

    let destination = Destination::File(path.to_owned());
    let mut recorder = Recorder::new(destination, RecorderConfig::default())?;
    let num = replay(suite, options, &mut |trace| recorder.record(trace))?;
    recorder.finish()?;
    Ok(num)
}

/// The shipped default where the suite runs it, else the first model that knows of time, else the
/// first.
fn shown<'s>(suite: &'s Suite, data: &ExtractedDataset) -> Result<(&'s Arm, Run)> {
    let has_clock = data.dataset.clock == chronotope::dataset::Clock::Real;
    let mut runs: Vec<(&Arm, Run)> = Vec::new();
    for arm in &suite.arms {
        runs.extend(arm.runs(has_clock)?.into_iter().map(|run| (arm, run)));
    }
    let default = shipped(has_clock);
    let is_default =
        |(arm, run): &&(&Arm, Run)| arm.preset == Preset::Default && run.localizer == default;
    let is_fremen = |(_, run): &&(&Arm, Run)| run.localizer.method() == Method::Fremen;
    let best = (runs.iter().find(is_default))
        .or_else(|| runs.iter().find(is_fremen))
        .or_else(|| runs.first());
    let (arm, run) = best.with_context(|| format!("suite `{}` runs nothing", suite.name))?;
    Ok((arm, run.clone()))
}

struct Replay<'a> {
    data: &'a ExtractedDataset,
    arm: &'a Arm,
    run: Run,
    extractor: Box<dyn Extractor>,
    tracer: Tracer,
    record: &'a mut dyn FnMut(&Trace<'_>) -> Result<()>,
}

impl Replay<'_> {
    /// Learns a fold and answers each of its queries; returns their number.
    fn fold(&mut self, fold: &Fold) -> Result<usize> {
        let dataset = &self.data.dataset;
        let times = times(dataset, self.arm)?;
        let mut snapshot = Snapshot::clone(&*learn(self.data, fold, self.arm, &times)?);
        for (key, &pose) in &dataset.poses {
            if let Some(id) = snapshot.find(key) {
                snapshot.set_pose(id, Some(pose))?;
            }
        }
        for edge in &dataset.edges {
            if [&edge.from, &edge.to]
                .iter()
                .all(|key| snapshot.find(key).is_some())
            {
                snapshot.add_edge(edge.clone())?;
            }
        }
        let localizer = Localizer::new(Arc::new(snapshot), self.run.localizer.clone())?;
        let num_live = LearnConfig::preset(self.arm.preset).features_per_visit();
        let mut scratch = Scratch::default();
        let mut answer = Localization::default();
        for &entry in &fold.query {
            let queried = &dataset.entries[entry];
            let start = Instant::now();
            let picture = queried.source.load()?;
            let mask = queried.source.mask(picture.width(), picture.height())?;
            let decode = Stage::since("decode", start);
            let start = Instant::now();
            let mut live = self.extractor.extract(&picture, mask.as_ref())?;
            live.truncate(num_live);
            let extract = Stage::since("extract", start);
            let start = Instant::now();
            let query = Query::new(&live)
                .at(times[entry])
                .with_image_size(picture.size());
            localizer.localize_into(&mut scratch, &query, &mut answer)?;
            let stages = [decode, extract, Stage::since("localize", start)];
            let file = queried.source.path();
            let recipe = queried.source.recipe();
            let shot = Shot {
                name: &queried.id,
                file: file.as_deref(),
                recipe: &recipe,
                picture: &picture,
                time: Some(times[entry]),
                time_source: Some("index"),
                truth: Some(&queried.place),
                live: &live,
                stages: &stages,
            };
            (self.record)(&self.tracer.trace(&localizer, &shot, &answer)?)?;
        }
        Ok(fold.query.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options() -> RunOptions {
        RunOptions {
            out: "target".into(),
            cache: "target".into(),
            ..RunOptions::default()
        }
    }

    #[test]
    fn every_query_is_traced_and_can_be_read_back() {
        let mut suite = Suite::find("synthetic").unwrap();
        suite.protocol = Protocol::Synthetic {
            num_seeds: 5,
            num_learn: 6,
            num_query: 1,
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("synthetic.jsonl");
        let num = write(&suite, &options(), &path).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let traces: Vec<Trace<'_>> = (text.lines())
            .map(|line| serde_json::from_str(line).unwrap())
            .collect();
        assert_eq!(num, 8, "one round past eight places of one world");
        assert_eq!(traces.len(), num);
        for (index, trace) in traces.iter().enumerate() {
            assert_eq!(trace.map.is_some(), index == 0, "one map, described once");
            assert_eq!(trace.method, "fremen");
            assert_eq!(trace.localization.ranking.len(), trace.predicted.len());
            assert_eq!(trace.stages.len(), 3);
            let jpeg = &trace.jpeg.as_ref().unwrap().0;
            let picture = image::load_from_memory(jpeg).unwrap();
            let size = (picture.width() as usize, picture.height() as usize);
            assert_eq!(size, trace.image_size);
        }
        let map = traces[0].map.as_ref().unwrap();
        assert!(map.places.iter().all(|place| place.pose.is_some()));
        assert_eq!(map.edges.len(), 14, "a street there and back");
        let session = map.latest_session.as_ref().unwrap();
        assert_eq!((session.num_visits, session.new_places.len()), (48, 8));
        for curve in &map.curves {
            assert_eq!(curve.visit_times_us.len(), curve.seen.len());
            assert_eq!(curve.times_us.len(), curve.p.len());
            assert!(curve.p.iter().all(|p| (0.0..=1.0).contains(p)));
        }
        assert_eq!(traces[3].curve_probabilities.len(), map.curves.len());
    }

    #[test]
    fn a_suite_without_images_of_its_own_is_refused() {
        let suite = Suite::find("door").unwrap();
        let refused = replay(&suite, &options(), &mut |_| Ok(())).unwrap_err();
        assert!(
            refused.to_string().contains("nothing to trace"),
            "{refused}"
        );
    }
}
