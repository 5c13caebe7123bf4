//! What does `SUITE.json` hold, and how is it written and read?
//!
//! One file holds one run of one suite: a header that says what was measured and how to measure it
//! again, one [`Row`] per combination of preset, method, model, score, order and n, and one
//! [`Query`] per image with the [`Answer`] of every row, so that two runs can be compared query by
//! query. All rates are percentages; `wrong` and `correct` are numbers of queries in which a tie
//! for the first rank is split (k tied places, the true one among them: 1/k correct).
//!
//! Invariants, checked when writing and reading ([`SuiteResults::validate`]): the schema version is
//! known; keys of rows and ids of queries are unique; every number is finite; `correct + wrong =
//! queries`; where a row's answers are stored, their count, `wrong` and `tied` agree with the row.
//!
//! The same results give the same bytes: fields keep their order, answers are sorted by key.
//! Unknown fields are ignored when reading, so that a later version may add some.

mod answer;
mod json;
mod judgement;
mod key;
mod rows;
mod suite_results;
mod tolerance;
mod validate;

pub use answer::{Answer, Decision, DecisionOutcome, OFF_MAP, Query};
pub(crate) use json::write_atomically;
pub use json::write_json;
pub use judgement::{
    Against, AtRisk, Bin, Calibration, Decisions, InMap, Judgement, Measured, Mixed, OutOfMap,
    Outcome, PrecisionRecall, Retrieval,
};
pub use key::{RowKey, RowOrder, Variant};
pub use rows::{LeakCheck, Reobservation, Row, StageLatency, VisibilityError, Within};
pub use suite_results::{SCHEMA_VERSION, SuiteResults};
pub use tolerance::Tolerance;
