//! Which images are learnt, and which are queries?
//!
//! Queries and what is learnt are kept apart twice: by the protocol, and by the digest of decoded
//! pixels (an image that equals a query of the fold is taken off the learning side).

use std::collections::{BTreeMap, HashSet};

use anyhow::{Context, Result, bail, ensure};
use chronotope::Time;
use chronotope::dataset::{Dataset, Entry, Side, Split};
use chronotope::map::PlaceKey;

use super::features::ExtractedDataset;
use super::opened::sides_of_file;
use crate::suite::{Protocol, Suite};

/// Images of one place that follow each other within this time show one visit: a robot that stands
/// or passes slowly. Left out alone, such an image would have its twin in the map.
const SAME_VISIT_S: f64 = 60.0;

/// Places with more visits than this are split by time instead of visit by visit.
const MAX_LEFT_OUT: usize = 12;

/// Entries that are learnt and entries that are queried; indices into a dataset.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Fold {
    /// The entries that are learnt, in order of time.
    pub learn: Vec<usize>,
    /// The entries that are queries.
    pub query: Vec<usize>,
    /// What distinguishes it in the ids of its queries, where an image is queried in several folds.
    pub name: Option<String>,
}

impl Fold {
    fn of(learn: Vec<usize>, query: Vec<usize>) -> Self {
        Self {
            learn,
            query,
            name: None,
        }
    }

    /// The id of an entry as a query of this fold.
    pub(crate) fn query_id(&self, entry: &Entry) -> String {
        match &self.name {
            Some(name) => format!("{} ({name})", entry.id),
            None => entry.id.clone(),
        }
    }
}

/// The folds of a suite's protocol before the leak check, and what is done in words; `split` is
/// that of the dataset's manifest.
pub fn folds(
    suite: &Suite,
    dataset: &Dataset,
    split: Option<&Split>,
) -> Result<(Vec<Fold>, String)> {
    let protocol = &suite.protocol;
    let folds = match protocol {
        Protocol::LeaveOneVisitOut => leave_one_visit_out(dataset)?,
        Protocol::FewVisits { num_learn } => few_visits(dataset, *num_learn)?,
        Protocol::Split | Protocol::OtherFolder { .. } => {
            let split = split
                .with_context(|| format!("the manifest of `{}` has no split", dataset.name))?;
            let side = |entry: &Entry| Some(split.side(entry)? == Side::Learn);
            let sides: Vec<_> = dataset.entries.iter().map(side).collect();
            vec![one(dataset, &sides)?]
        }
        Protocol::Listed { file } => {
            let sides = sides_of_file(&suite.resolve(file), dataset)?;
            vec![one(dataset, &sides)?]
        }
        Protocol::Route {
            learn_from,
            learn_until,
            query_from,
            query_until,
        } => {
            let query_from = query_from.unwrap_or(*learn_until);
            ensure!(
                query_from >= *learn_until,
                "queries start at {query_from}, before learning ends at {learn_until}"
            );
            let side = |entry: &Entry| {
                let time = entry.time;
                let is_learnt = learn_from.is_none_or(|from| time >= from) && time < *learn_until;
                let is_query = time >= query_from && query_until.is_none_or(|until| time < until);
                (is_learnt || is_query).then_some(is_learnt)
            };
            let sides: Vec<_> = dataset.entries.iter().map(side).collect();
            vec![one(dataset, &sides)?]
        }
        Protocol::Auto => return fitting(suite, dataset, split),
        Protocol::Synthetic { .. } | Protocol::MultiDataset { .. } => {
            bail!("worlds and parts bring their own folds")
        }
        Protocol::Series { .. } | Protocol::Explore { .. } => {
            bail!("a series is no dataset of images")
        }
        Protocol::Grid { .. } => bail!("a grid is no dataset of images"),
    };
    let words = in_words(protocol, &folds);
    Ok((folds, words))
}

/// By the sides of the entries: learnt, queried or neither.
fn one(dataset: &Dataset, sides: &[Option<bool>]) -> Result<Fold> {
    let of = |wanted: bool| -> Vec<usize> {
        let sides = sides.iter().enumerate();
        sides
            .filter(|(_, side)| **side == Some(wanted))
            .map(|(entry, _)| entry)
            .collect()
    };
    let fold = Fold::of(of(true), of(false));
    if fold.learn.is_empty() || fold.query.is_empty() {
        let empty = if fold.learn.is_empty() {
            "no image is learnt"
        } else {
            "no image is queried"
        };
        let span = match (dataset.entries.first(), dataset.entries.last()) {
            (Some(first), Some(last)) => format!(", which is from {} to {}", first.time, last.time),
            _ => String::new(),
        };
        bail!(
            "the split of `{}`{span} leaves one side empty: {empty}",
            dataset.name
        );
    }
    Ok(fold)
}

fn leave_one_visit_out(dataset: &Dataset) -> Result<Vec<Fold>> {
    let visits = visits_apart(dataset);
    let num_visits = visits.iter().max().map_or(0, |last| last + 1);
    ensure!(
        num_visits >= 2,
        "leaving one visit out takes at least two visits of a place{VISITS_HELP}"
    );
    Ok((0..num_visits)
        .map(|left_out| {
            let all = 0..dataset.entries.len();
            let (query, learn) = all.partition(|&i| visits[i] == left_out);
            Fold::of(learn, query)
        })
        .collect())
}

const VISITS_HELP: &str = ", with more than a minute between them (help: query another run of the \
                           same places with --query DIR)";

fn few_visits(dataset: &Dataset, num_learn: usize) -> Result<Vec<Fold>> {
    let visits = visits_apart(dataset);
    let mut num_visits: BTreeMap<&PlaceKey, usize> = BTreeMap::new();
    for (entry, &visit) in dataset.entries.iter().zip(&visits) {
        let known = num_visits.entry(&entry.place).or_default();
        *known = (*known).max(visit + 1);
    }
    let most = num_visits.values().copied().max().unwrap_or(0);
    ensure!(
        most > num_learn,
        "learning {num_learn} visits and querying others takes more visits of a place{VISITS_HELP}"
    );
    let width = most.to_string().len().max(2);
    Ok((0..most)
        .map(|first| {
            let is_learnt = |&i: &usize| {
                let count = num_visits[&dataset.entries[i].place];
                // Each place goes round by its own visits.
                (visits[i] + count - first % count) % count < num_learn
            };
            let (learn, query) = (0..dataset.entries.len()).partition(is_learnt);
            let last = (first + num_learn - 1) % most + 1;
            let first = first + 1;
            Fold {
                learn,
                query,
                name: Some(match num_learn {
                    1 => format!("visit {first:0width$} learnt"),
                    _ => format!("visits {first:0width$} to {last:0width$} learnt"),
                }),
            }
        })
        .collect())
}

/// What suits the dataset, and why.
fn fitting(suite: &Suite, dataset: &Dataset, split: Option<&Split>) -> Result<(Vec<Fold>, String)> {
    let by = |protocol: Protocol, reason: &str| -> Result<(Vec<Fold>, String)> {
        let suite = Suite {
            protocol,
            ..suite.clone()
        };
        let (folds, words) = folds(&suite, dataset, split)?;
        Ok((folds, format!("{words} ({reason})")))
    };
    if split.is_some() {
        return by(Protocol::Split, "as its manifest says");
    }
    let most = visits_apart(dataset)
        .iter()
        .max()
        .map_or(0, |last| last + 1);
    if most <= MAX_LEFT_OUT {
        let reason = "chosen because places have few visits; a map may know later ones than the \
                      query's";
        return by(Protocol::LeaveOneVisitOut, reason);
    }
    // Between two runs, if there is a pause where about three quarters are learnt.
    let count = dataset.entries.len();
    let gap_s = |at: usize| {
        dataset.entries[at]
            .time
            .since_s(dataset.entries[at - 1].time)
    };
    let from = (7 * count / 10).max(1);
    let mut cut = from;
    for at in from..=(8 * count / 10).min(count - 1) {
        if gap_s(at) > gap_s(cut) {
            cut = at;
        }
    }
    let route = Protocol::Route {
        learn_from: None,
        learn_until: dataset.entries[cut].time,
        query_from: None,
        query_until: None,
    };
    let reason = format!(
        "split at {}, chosen because places have many visits",
        dataset.entries[cut].time
    );
    by(route, &reason)
}

fn in_words(protocol: &Protocol, folds: &[Fold]) -> String {
    let queries: usize = folds.iter().map(|fold| fold.query.len()).sum();
    let learnt: usize = folds.iter().map(|fold| fold.learn.len()).sum();
    match protocol {
        Protocol::LeaveOneVisitOut => format!(
            "each of {} visits left out once: learn the others, {queries} queries in all",
            folds.len()
        ),
        Protocol::FewVisits { num_learn } => format!(
            "{num_learn} of the visits of each place learnt and all others queried, {} times: \
             {queries} queries in all",
            folds.len()
        ),
        Protocol::OtherFolder { query } => format!(
            "{learnt} images learnt, {queries} of {} queried",
            query.display()
        ),
        Protocol::Listed { file } => format!(
            "{learnt} images learnt, {queries} queried, as listed in {}",
            file.display()
        ),
        _ => format!("{learnt} images learnt, {queries} later ones queried"),
    }
}

/// The number of each entry among the visits of its place, where images that follow each other
/// closely are of one visit.
fn visits_apart(dataset: &Dataset) -> Vec<usize> {
    let mut last: BTreeMap<&PlaceKey, (Time, usize)> = BTreeMap::new();
    // Entries are sorted by time.
    (dataset.entries.iter())
        .map(|entry| {
            let visit = match last.get(&entry.place) {
                None => 0,
                Some((time, visit)) => {
                    visit + usize::from(entry.time.since_s(*time) > SAME_VISIT_S)
                }
            };
            last.insert(&entry.place, (entry.time, visit));
            visit
        })
        .collect()
}

/// The number of each entry among the visits of its place, from 0 in order of time.
pub(crate) fn visit_numbers(dataset: &Dataset) -> Vec<usize> {
    let mut times: BTreeMap<_, Vec<Time>> = BTreeMap::new();
    for entry in &dataset.entries {
        times.entry(&entry.place).or_default().push(entry.time);
    }
    for times in times.values_mut() {
        times.sort_unstable();
        times.dedup();
    }
    (dataset.entries.iter())
        .map(|entry| times[&entry.place].partition_point(|&time| time < entry.time))
        .collect()
}

/// Learns what was seen before `split`, queries the rest.
pub(crate) fn split_at(data: &ExtractedDataset, split: Time) -> Fold {
    let (query, learn) =
        (0..data.dataset.entries.len()).partition(|&i| data.dataset.entries[i].time >= split);
    Fold::of(learn, query)
}

/// The fold without learning images that show the same pixels as one of its queries, and their
/// number.
pub(crate) fn without_duplicates(data: &ExtractedDataset, fold: &Fold) -> (Fold, u32) {
    let queried: HashSet<&[u8; 32]> = (fold.query.iter())
        .map(|&i| &data.extracted[i].digest)
        .collect();
    let learn: Vec<usize> = (fold.learn.iter().copied())
        .filter(|&i| !queried.contains(&data.extracted[i].digest))
        .collect();
    let removed = (fold.learn.len() - learn.len()) as u32;
    let fold = Fold {
        learn,
        ..fold.clone()
    };
    (fold, removed)
}

/// Cut-outs of one photograph are alike: the part of an entry's id that names it.
pub(crate) fn photograph(id: &str) -> Option<&str> {
    id.split_once('@').map(|(photograph, _)| photograph)
}
