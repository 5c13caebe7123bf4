//! What does a layer of a neural network see in this image?
//!
//! A convolutional network turns an image into a grid of *cells*, each with a number for each of
//! the layer's *channels*. The cells that stand out become keypoints, and their channels become 256
//! bits, so that features of a network go wherever those of [`StarBrief`](super::StarBrief) go: the
//! same map, the same visibility over time, the same matching and the same posterior.
//!
//! ```text
//! image -> scaled, normalised -> network up to the layer -> mean of neighbouring cells
//!       -> each channel standardised over the cells of the image -> strength of a cell
//!       -> the strongest cells -> signs of random projections of their channels: the bits
//! ```
//!
//! What the network was trained for matters little: the middle layers of a classifier of
//! photographs see parts of things that stay when light, leaves and weather change. Source of the
//! idea: Suenderhauf et al., *On the performance of `ConvNet` features for place recognition*, IROS
//! 2015; of the bits: Charikar, *Similarity estimation techniques from rounding algorithms*, STOC
//! 2002.
//!
//! Anybody's network in an ONNX file will do; none comes with this crate. Its digest is part of the
//! extractor's id, and so of a map; [`Models`] says where the file is. Running one needs the cargo
//! feature `onnx`; configurations are read and written without it.
//!
//! *Determinism*: on one machine the same build gives the same bits for any number of threads. The
//! arithmetic of the network is chosen for the processor, so that another machine may round a
//! projection that is next to zero to the other side: single bits may differ there.
//!
//! Not for: images that turn, or networks with several inputs, with a memory or with weights in
//! other files.

#[cfg(feature = "onnx")]
mod cells;
mod config;
#[cfg(feature = "onnx")]
mod extractor;
#[cfg(feature = "onnx")]
mod input;
mod models;
#[cfg(feature = "onnx")]
mod network;
#[cfg(feature = "onnx")]
mod projection;

pub use config::OnnxConfig;
#[cfg(feature = "onnx")]
pub use extractor::OnnxExtractor;
pub use models::{Model, ModelDigest, Models};
