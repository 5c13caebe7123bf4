//! Which features does a place have, and at which visits were they visible? (the reference recipe)
//!
//! While images come, [`find`] adds those live features that fail the ratio test both ways. When
//! the log is needed, [`write_log`] looks for every feature of the place in every image of it, one
//! way, so that a feature can be visible before the visit it was first noticed in.

use super::config::LearnConfig;
use super::visit::Found;
use crate::feature::{Features, FeaturesView};
use crate::map::Node;
use crate::matching::{MatchScratch, Matcher, TwoWay};
use crate::simd::Kernel;
use fremen::error::Result;
use fremen::visibility::{BitRow, HistoryLog};

/// What is new in one image; its bits are provisional until [`write_log`].
pub(super) fn find(cfg: &LearnConfig, known: FeaturesView<'_>, live: &Features) -> Found {
    let mut two_way = TwoWay::new();
    two_way.compare(cfg.two_way(), Kernel::best(), known, live.view());
    let mut born = Features::new();
    let mut seen_ids = Vec::new();
    for (id, verdict) in two_way.verdicts().iter().enumerate() {
        if let Some(found) = verdict.seen() {
            seen_ids.push(found.map as usize);
        } else if verdict.is_new() {
            born.push(live.keypoints()[id], live.descriptors()[id]);
        }
    }
    let mut seen = BitRow::zeros(known.len() + born.len());
    for id in seen_ids.into_iter().chain(known.len()..seen.len()) {
        seen.set(id);
    }
    Found {
        born,
        seen,
        hidden: None,
        displacement: None,
        distances: Vec::new(),
    }
}

/// Rewrites the log of a place from the images kept of it.
pub(super) fn write_log(cfg: &LearnConfig, node: &mut Node) -> Result<()> {
    let matcher = Matcher::new(cfg.reobserve().clone());
    let mut scratch = MatchScratch::default();
    let mut matches = Vec::new();
    let mut log = HistoryLog::new();
    for visit in node.visits() {
        let mut seen = BitRow::zeros(node.features().len());
        if let Some(live) = &visit.appearance {
            matcher.matches_into(
                &mut scratch,
                node.features().view(),
                live.view(),
                &mut matches,
            );
            for found in &matches {
                seen.set(found.map as usize);
            }
        }
        log.push_visit(visit.time, seen, None)?;
    }
    node.set_log(log)
}
