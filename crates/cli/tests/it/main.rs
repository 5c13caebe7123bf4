//! The one integration-test binary.
#![allow(clippy::unwrap_used, clippy::expect_used)] // reason: a test that cannot prepare itself has failed.

mod bounded;
mod build;
mod calibrate;
mod check;
mod config;
mod edge;
mod exchange;
mod explore;
mod failing;
mod fixture;
mod generations;
mod grid;
mod held;
mod inspect;
mod killed;
mod learned;
mod localize;
mod merge;
mod nothing_lost;
mod place;
mod predict;
mod query_form;
mod real_files;
mod spectrum;
mod tables;
#[cfg(feature = "onnx")]
#[path = "../../../../tests/it/tiny_network.rs"]
mod tiny_network;
mod trace;
mod update;
