//! Which images are learnt, and which are queries?
//!
//! Queries and what is learnt are kept apart twice: by the protocol, and by the digest of decoded
//! pixels (an image that equals a query of the fold is taken off the learning side).

use std::collections::{BTreeMap, HashSet};

use anyhow::{Context, Result, bail, ensure};
use chronotope::Time;
use chronotope::dataset::{Dataset, Manifest, Side};

use super::features::ExtractedDataset;
use crate::suite::Protocol;

/// Entries that are learnt and entries that are queried; indices into a dataset.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Fold {
    /// The entries that are learnt, in order of time.
    pub learn: Vec<usize>,
    /// The entries that are queries.
    pub query: Vec<usize>,
}

/// The folds of a protocol, before the leak check.
pub fn folds(
    protocol: &Protocol,
    dataset: &Dataset,
    manifest: Option<&Manifest>,
) -> Result<Vec<Fold>> {
    let all = 0..dataset.entries.len();
    match protocol {
        Protocol::LeaveOneVisitOut => {
            let visits = visit_numbers(dataset);
            let num_visits = visits.iter().max().map_or(0, |last| last + 1);
            ensure!(
                num_visits >= 2,
                "leaving one visit out takes at least two visits of a place"
            );
            Ok((0..num_visits)
                .map(|left_out| {
                    let (query, learn) = all.clone().partition(|&i| visits[i] == left_out);
                    Fold { learn, query }
                })
                .collect())
        }
        Protocol::Split => {
            let split = manifest
                .and_then(|manifest| manifest.split.as_ref())
                .with_context(|| format!("the manifest of `{}` has no split", dataset.name))?;
            let of = |side| {
                all.clone()
                    .filter(|&i| split.side(&dataset.entries[i]) == Some(side))
                    .collect::<Vec<_>>()
            };
            let fold = Fold {
                learn: of(Side::Learn),
                query: of(Side::Query),
            };
            ensure!(
                !fold.learn.is_empty() && !fold.query.is_empty(),
                "the split of `{}` leaves one side empty",
                dataset.name
            );
            Ok(vec![fold])
        }
        Protocol::Synthetic { .. } | Protocol::MultiDataset { .. } => {
            bail!("worlds and parts bring their own folds")
        }
        Protocol::Series { .. } => bail!("a series is no dataset of images"),
    }
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
    Fold { learn, query }
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
    let query = fold.query.clone();
    (Fold { learn, query }, removed)
}

/// Cut-outs of one photograph are alike: the part of an entry's id that names it.
pub(crate) fn photograph(id: &str) -> Option<&str> {
    id.split_once('@').map(|(photograph, _)| photograph)
}
