//! Which features does a place have, and at which visits were they visible? (the reference recipe)
//!
//! While images come, [`grow`] adds those live features that fail the ratio test both ways. When the
//! log is needed, [`write_log`] looks for every feature of the place in every image of it, one way, so
//! that a feature can be visible before the visit it was first noticed in.

use super::Learnt;
use crate::error::Result;
use crate::feature::Features;
use crate::learn::LearnConfig;
use crate::map::Node;
use crate::matching::{MatchScratch, Matcher, TwoWay};
use crate::simd::Kernel;
use crate::time::Time;
use crate::visibility::{BitRow, HistoryLog};

/// Adds the new features of one image; its bits are provisional until [`write_log`].
pub(super) fn grow(
    cfg: &LearnConfig,
    node: &mut Node,
    time: Time,
    live: &Features,
) -> Result<Learnt> {
    let mut two_way = TwoWay::new();
    two_way.compare(
        cfg.two_way(),
        Kernel::best(),
        node.features.view(),
        live.view(),
    );
    let num_known = node.features.len();
    let mut seen_ids: Vec<u32> = Vec::new();
    for (id, verdict) in two_way.verdicts().iter().enumerate() {
        if let Some(found) = verdict.seen() {
            seen_ids.push(found.map);
        } else if verdict.is_new() {
            node.features
                .push(live.keypoints()[id], live.descriptors()[id]);
        }
    }
    let mut seen = BitRow::zeros(node.features.len());
    for id in seen_ids {
        seen.set(id as usize);
    }
    let num_seen = seen.count_ones();
    for id in num_known..node.features.len() {
        seen.set(id);
    }
    node.log.push_visit(time, seen, None)?;
    Ok(Learnt {
        num_seen,
        num_born: node.features.len() - num_known,
        experience: false,
    })
}

/// Rewrites the log of a place from the images kept of it.
pub(super) fn write_log(cfg: &LearnConfig, node: &mut Node) -> Result<()> {
    let matcher = Matcher::new(cfg.reobserve().clone());
    let mut scratch = MatchScratch::default();
    let mut matches = Vec::new();
    let mut log = HistoryLog::new();
    for visit in &node.visits {
        let mut seen = BitRow::zeros(node.features.len());
        if let Some(live) = &visit.appearance {
            matcher.matches_into(
                &mut scratch,
                node.features.view(),
                live.view(),
                &mut matches,
            );
            for found in &matches {
                seen.set(found.map as usize);
            }
        }
        log.push_visit(visit.time, seen, None)?;
    }
    node.log = log;
    Ok(())
}
