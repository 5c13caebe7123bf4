//! What is the answer, and why?

use std::fmt::Write as _;

use anyhow::Result;
use chronotope::localize::Decision;
use chronotope::trace::Trace;
use rerun::{RecordingStream, TextDocument};

use super::lookup::{OFF_MAP, place};
use crate::entities;

/// Rows of the table of places.
const TABLE_ROWS: usize = 5;

/// The answer with its reason, and the best places.
pub(crate) fn log(stream: &RecordingStream, trace: &Trace<'_>) -> Result<()> {
    let document = TextDocument::from_markdown(text(trace));
    Ok(stream.log(entities::DECISION, &document)?)
}

fn text(trace: &Trace<'_>) -> String {
    let answer = &trace.localization;
    let title = match answer.decision {
        Decision::At(node) => format!("At {}", place(trace, node.0 as usize)),
        Decision::Near(node) => {
            let region = answer.region.iter().filter(|it| **it != node);
            let others: Vec<&str> = region.map(|it| place(trace, it.0 as usize)).collect();
            format!(
                "At {} or near it: {}",
                place(trace, node.0 as usize),
                others.join(", ")
            )
        }
        Decision::Ambiguous => "In the map, but several places fit".into(),
        _ => "Unknown: no place fits well enough".into(),
    };
    let time = trace.time.as_deref().unwrap_or("at an unknown time");
    let reason = capitalised(&answer.reason.to_string());
    let mut text = format!(
        "# {title}\n\n{}{reason}.\n\n{time}\n\n\
         | place | posterior | found | score |\n|---|---|---|---|\n",
        verdict(trace)
    );
    for (rank, candidate) in answer.ranking.iter().take(TABLE_ROWS).enumerate() {
        let predicted = trace.predicted.get(rank).map_or(0, Vec::len);
        let _ = writeln!(
            text,
            "| {} | {:.1} % | {} of {} | {:.1} |",
            place(trace, candidate.node.0 as usize),
            100.0 * candidate.posterior,
            candidate.num_inliers,
            predicted.max(candidate.predicted.len()),
            candidate.score
        );
    }
    let _ = writeln!(
        text,
        "| *{OFF_MAP}* | {:.1} % | | |\n\n{}, method {}, score {}",
        100.0 * answer.off_map,
        trace.image,
        trace.method,
        trace.score
    );
    text
}

/// Whether the answer is right, where that is known.
fn verdict(trace: &Trace<'_>) -> String {
    let Some(truth) = &trace.truth else {
        return String::new();
    };
    match trace.localization.decision {
        Decision::Near(_) => {
            let mut region = trace.localization.region.iter();
            let is_right = region.any(|it| place(trace, it.0 as usize) == truth.as_str());
            format!(
                "**{}**: it is {truth}. ",
                if is_right { "Right" } else { "Wrong" }
            )
        }
        Decision::At(node) if place(trace, node.0 as usize) == truth.as_str() => {
            format!("**Right**: it is {truth}. ")
        }
        Decision::At(_) => format!("**Wrong**: it is {truth}. "),
        _ => format!("It is {truth}. "),
    }
}

fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    (letters.next().into_iter().flat_map(char::to_uppercase))
        .chain(letters)
        .collect()
}
