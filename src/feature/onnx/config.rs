//! Which layer of which network, and how do its cells become features?

use serde::{Deserialize, Serialize};

use super::ModelDigest;
use fremen::error::{Error, ErrorKind, Result};

/// The sides of the network's input, px: as small as a few cells, as large as there is any use for.
const SIDES_PX: std::ops::RangeInclusive<u32> = 32..=2048;
/// The largest window of cells.
const MAX_WINDOW: u8 = 15;

/// The configuration of features of a neural network.
///
/// Model and layer have no default that could be meant: a model that is left out is the one file
/// that is given, and an error lists the layers where none is named.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OnnxConfig {
    #[serde(skip_serializing_if = "Option::is_none")]
    model: Option<ModelDigest>,
    layer: String,
    width: u32,
    height: u32,
    mean: Vec<f64>,
    std: Vec<f64>,
    smooth_cells: u8,
    suppress_cells: u8,
    num_bits: u16,
    num_features: usize,
}

impl Default for OnnxConfig {
    fn default() -> Self {
        Self {
            model: None,
            layer: String::new(),
            width: 448,
            height: 320,
            mean: vec![0.485, 0.456, 0.406],
            std: vec![0.229, 0.224, 0.225],
            smooth_cells: 3,
            suppress_cells: 1,
            num_bits: 128,
            num_features: 600,
        }
    }
}

impl OnnxConfig {
    /// The output called `layer` of the network with this digest.
    pub fn new(model: ModelDigest, layer: impl Into<String>) -> Self {
        Self {
            model: Some(model),
            layer: layer.into(),
            ..Self::default()
        }
    }

    /// The network's file; left out, the one file that [`Models`](super::Models) name.
    #[must_use]
    pub fn with_model(mut self, model: Option<ModelDigest>) -> Self {
        self.model = model;
        self
    }

    /// The name of an output of a node that has the shape (1, channels, rows, columns).
    #[must_use]
    pub fn with_layer(mut self, layer: impl Into<String>) -> Self {
        self.layer = layer.into();
        self
    }

    /// Every image is scaled to this size, px, whatever its shape (448 x 320).
    #[must_use]
    pub fn with_input_size(mut self, width: u32, height: u32) -> Self {
        (self.width, self.height) = (width, height);
        self
    }

    /// What is subtracted from the grey level of each channel, where white is 1, and by what the
    /// rest is divided (that of `ImageNet`). One number for each channel of the input, which is 3
    /// times the same grey or 1.
    #[must_use]
    pub fn with_normalization(mut self, mean: Vec<f64>, std: Vec<f64>) -> Self {
        (self.mean, self.std) = (mean, std);
        self
    }

    /// Side of the window of cells whose mean a cell becomes; odd, 1 for none (3).
    #[must_use]
    pub fn with_smooth_cells(mut self, side: u8) -> Self {
        self.smooth_cells = side;
        self
    }

    /// Side of the window of cells in which a keypoint is the strongest; odd, 1 for all (1).
    #[must_use]
    pub fn with_suppress_cells(mut self, side: u8) -> Self {
        self.suppress_cells = side;
        self
    }

    /// How many of a descriptor's 256 bits are used (128). The others are 0, so that distances
    /// shrink with this number: it says how alike two features are that match, because the limit
    /// of a match is a number of bits.
    #[must_use]
    pub fn with_num_bits(mut self, num_bits: u16) -> Self {
        self.num_bits = num_bits;
        self
    }

    /// At most this many features of an image, the strongest (600).
    #[must_use]
    pub fn with_num_features(mut self, num_features: usize) -> Self {
        self.num_features = num_features;
        self
    }

    /// The network's file, where one is named.
    pub fn model(&self) -> Option<ModelDigest> {
        self.model
    }

    /// The name of the layer.
    pub fn layer(&self) -> &str {
        &self.layer
    }

    /// Width and height of the network's input, px.
    pub fn input_size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Whether every value is in its range; otherwise an [`ErrorKind::Config`] error.
    pub fn check(&self) -> Result<()> {
        let bad = |what: &str, help: &str| {
            let error = Error::new(ErrorKind::Config, format!("{what} cannot be used"));
            Err(error.with_help(help))
        };
        for (name, side) in [("width", self.width), ("height", self.height)] {
            if !SIDES_PX.contains(&side) {
                return bad(&format!("{name}={side}"), "give 32 to 2048 px");
            }
        }
        let windows = [
            ("smooth_cells", self.smooth_cells),
            ("suppress_cells", self.suppress_cells),
        ];
        for (name, side) in windows {
            if side % 2 == 0 || side > MAX_WINDOW {
                return bad(&format!("{name}={side}"), "give an odd number from 1 to 15");
            }
        }
        if !(1..=256).contains(&self.num_bits) {
            return bad(&format!("num_bits={}", self.num_bits), "give 1 to 256 bits");
        }
        let help = "give one number for each channel of the input, which are 3 (or 1 of a network \
                    of grey images)";
        if !matches!(self.mean.len(), 1 | 3) || self.mean.len() != self.std.len() {
            let what = format!("{} mean and {} std", self.mean.len(), self.std.len());
            return bad(&what, help);
        }
        let is_sound = |mean: f64, std: f64| mean.abs() <= 1e6 && (1e-6..=1e6).contains(&std);
        let mut pairs = self.mean.iter().zip(&self.std);
        match pairs.find(|&(&mean, &std)| !is_sound(mean, std)) {
            Some((mean, std)) => bad(
                &format!("mean {mean} with std {std}"),
                "grey levels go from 0 to 1; std is above 0",
            ),
            None => Ok(()),
        }
    }
}

#[cfg(feature = "onnx")]
impl OnnxConfig {
    /// Mean and standard deviation of each channel.
    pub(super) fn normalization(&self) -> impl ExactSizeIterator<Item = (f64, f64)> {
        self.mean.iter().copied().zip(self.std.iter().copied())
    }

    pub(super) fn smooth_cells(&self) -> usize {
        usize::from(self.smooth_cells)
    }

    pub(super) fn suppress_cells(&self) -> usize {
        usize::from(self.suppress_cells)
    }

    pub(super) fn num_bits(&self) -> usize {
        usize::from(self.num_bits)
    }

    pub(super) fn num_features(&self) -> usize {
        self.num_features
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_out_of_range_are_refused_with_a_remedy() {
        let cfg = || OnnxConfig::new(ModelDigest::of(b"model"), "layer");
        assert!(cfg().check().is_ok());
        assert!(
            cfg()
                .with_normalization(vec![0.5], vec![0.5])
                .check()
                .is_ok()
        );
        for bad in [
            cfg().with_input_size(31, 320),
            cfg().with_input_size(448, 2049),
            cfg().with_smooth_cells(2),
            cfg().with_smooth_cells(0),
            cfg().with_suppress_cells(17),
            cfg().with_num_bits(0),
            cfg().with_num_bits(257),
            cfg().with_normalization(vec![], vec![]),
            cfg().with_normalization(vec![0.5; 3], vec![0.5; 2]),
            cfg().with_normalization(vec![0.5; 2], vec![0.5; 2]),
            cfg().with_normalization(vec![f64::NAN], vec![0.5]),
            cfg().with_normalization(vec![0.5], vec![0.0]),
        ] {
            let error = bad.check().expect_err("out of range");
            assert_eq!(error.kind(), ErrorKind::Config);
            assert!(error.help().is_some(), "{error}");
        }
    }
}
