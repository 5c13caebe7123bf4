//! What is left of a map if some visits had never been?
//!
//! [`forget_session`] takes the visits of one run out of a map: a robot that was carried about, a
//! camera that was covered, a wrong date. Their rows leave the log, so no model counts them, and
//! features that nothing else has ever seen leave with them; one that was born then and seen later
//! is born at the first visit that is left and says anything of it. The rest stays as it was, in
//! the same order.
//!
//! What is not taken back: sums over all visits (`Reobservation`), and where features of later
//! visits lie that were placed by means of these.
//!
//! O(bytes of the places that change).

use std::sync::Arc;

use crate::map::{Node, Quarantine, SessionId, Snapshot};
use fremen::error::{Error, ErrorKind, Result};

/// The map without the visits of `session`, and how many these were (with those held).
///
/// Places stay, even without visits, so that edges and poses do. Fails with [`ErrorKind::NotFound`]
/// if the map has no such session.
pub fn forget_session(map: &Snapshot, session: SessionId) -> Result<(Snapshot, usize)> {
    let mut forgotten = map.clone();
    let mut held = Quarantine::of(map)?;
    let mut num_forgotten = held.forget(session);
    for node in forgotten.nodes_mut() {
        let kept: Vec<bool> = (node.visits().iter())
            .map(|visit| visit.session != session)
            .collect();
        let num_gone = kept.iter().filter(|&&is_kept| !is_kept).count();
        if num_gone > 0 {
            num_forgotten += num_gone;
            *node = Arc::new(without(node, &kept)?);
        }
    }
    if num_forgotten == 0 {
        return Err(Error::new(
            ErrorKind::NotFound,
            format!("the map has no visits of session {session}"),
        )
        .with_help("`chronotope map inspect --json` lists the sessions"));
    }
    held.attach(&mut forgotten)?;
    Ok((forgotten, num_forgotten))
}

/// The place with only these visits, and the features that they saw.
pub(super) fn without(node: &Node, kept: &[bool]) -> Result<Node> {
    let mut is_seen = vec![false; node.features().len()];
    let visits = (0..node.visits().len()).filter(|&visit| kept[visit]);
    for visit in visits {
        (node.log().seen_row(visit).ones()).for_each(|id| is_seen[id] = true);
    }
    Ok(node.retained(kept, &is_seen)?.0)
}
