//! How long does one answer take, and is it that of the sweep?
//!
//! The plain [`Localizer::localize_into`] is timed, alone on its core, and must give the same
//! scores as the sweep: a run in which it does not is an error, not a result.

use std::time::Instant;

use anyhow::{Result, ensure};
use chronotope::localize::{Localization, Localizer, Query, Scratch, Sweep};
use chronotope::predict::Selection;

/// Milliseconds of answering each of `queries`, for each n of `sizes`; gives the localizer back.
pub(crate) fn time(
    mut localizer: Localizer,
    queries: &[Query<'_>],
    sizes: &[usize],
) -> Result<(Localizer, Vec<Vec<f64>>)> {
    let mut scratch = Scratch::default();
    let mut sweep = Sweep::new(sizes)?;
    let mut out = Localization::default();
    let mut all_ms = vec![Vec::new(); sizes.len()];
    for query in queries {
        sweep.restart();
        localizer.sweep(&mut scratch, query, &mut sweep)?;
        for (size, (&n, of_size)) in sizes.iter().zip(&mut all_ms).enumerate() {
            localizer = localizer.with_selection(Selection::top(n)?);
            let start = Instant::now();
            localizer.localize_into(&mut scratch, query, &mut out)?;
            of_size.push(start.elapsed().as_secs_f64() * 1e3);
            let method = localizer.cfg().method();
            let score = localizer.cfg().score();
            for candidate in &out.ranking {
                let swept = sweep.scores(candidate.node, size).by(score);
                ensure!(
                    candidate.score == swept,
                    "{method} scores {} for node {} at n = {n}, but {swept} in the sweep",
                    candidate.score,
                    candidate.node.0
                );
            }
            ensure!(
                out.pairs_compared == sweep.pairs_compared()[size],
                "{method} compares {} pairs at n = {n}, but {} in the sweep",
                out.pairs_compared,
                sweep.pairs_compared()[size]
            );
        }
    }
    Ok((localizer, all_ms))
}
