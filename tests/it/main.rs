//! The one integration-test binary.
#![allow(clippy::unwrap_used, clippy::expect_used)] // reason: a test that cannot prepare itself has failed.

mod architecture;
mod circles;
mod dataset;
mod exchange;
#[cfg(unix)]
mod faulty_disk;
mod feature;
#[cfg(feature = "onnx")]
mod feature_onnx;
#[cfg(feature = "opencv")]
mod feature_opencv;
mod files;
mod guard;
mod index_cache;
mod large_map;
mod life;
mod localize;
mod map;
mod matching;
mod merge;
mod newer;
mod parts;
mod real_files;
mod robot;
mod source_text;
mod synthetic;
#[cfg(feature = "onnx")]
mod tiny_network;
mod tracking;
mod training;
mod untrusted;
