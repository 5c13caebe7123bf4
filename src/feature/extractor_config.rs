//! Which extractor, with which parameters?
//!
//! [`ExtractorConfig`] is what configuration files hold, and what an extractor's
//! [`id`](super::Extractor::id) spells: `KIND:NAME=VALUE,...` with every parameter, names
//! ascending, values as JSON. [`ExtractorConfig::from_id`] reads it back, so that a map can make the
//! extractor of its features.

use std::fmt::Write as _;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::{OnnxConfig, StarBriefConfig};
use fremen::error::{Error, ErrorKind, Result};

/// An extractor and its parameters; `kind` names it in files.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum ExtractorConfig {
    /// [`StarBrief`](super::StarBrief): the reference recipe.
    StarBrief(StarBriefConfig),
    /// Corners of ORB's pyramid with our BRIEF; needs the feature `opencv`.
    OrbBrief(CornerBriefConfig),
    /// FAST corners with our BRIEF; needs the feature `opencv`.
    FastBrief(CornerBriefConfig),
    /// AGAST corners with our BRIEF; needs the feature `opencv`.
    AgastBrief(CornerBriefConfig),
    /// Cells of a layer of a neural network; needs the feature `onnx`.
    Onnx(OnnxConfig),
}

impl Default for ExtractorConfig {
    fn default() -> Self {
        Self::StarBrief(StarBriefConfig::default())
    }
}

/// The configuration of the corner detectors that OpenCV provides.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CornerBriefConfig {
    num_features: usize,
    threshold: u8,
}

impl Default for CornerBriefConfig {
    fn default() -> Self {
        Self {
            num_features: 500,
            threshold: 10,
        }
    }
}

impl CornerBriefConfig {
    /// At most this many features of an image, the strongest (500).
    #[must_use]
    pub fn with_num_features(mut self, num_features: usize) -> Self {
        self.num_features = num_features;
        self
    }

    /// By how much the circle around a corner differs from its centre, grey levels (10).
    #[must_use]
    pub fn with_threshold(mut self, levels: u8) -> Self {
        self.threshold = levels;
        self
    }

    #[cfg(feature = "opencv")]
    pub(super) fn num_features(&self) -> usize {
        self.num_features
    }

    #[cfg(feature = "opencv")]
    pub(super) fn threshold(&self) -> u8 {
        self.threshold
    }
}

impl ExtractorConfig {
    /// What [`Extractor::id`](super::Extractor::id) of the built extractor says.
    pub fn id(&self) -> String {
        // Plain structs of numbers always serialise; an empty map could only make ids less
        // specific.
        let Ok(Value::Object(fields)) = serde_json::to_value(self) else {
            return String::new();
        };
        let mut fields: Vec<_> = fields.iter().collect();
        fields.sort_unstable_by_key(|(name, _)| *name);
        let mut id = String::new();
        let mut separator = ':';
        for (name, value) in fields {
            if name == "kind" {
                id.insert_str(0, value.as_str().unwrap_or_default());
            } else {
                let _ = write!(id, "{separator}{name}={value}");
                separator = ',';
            }
        }
        id
    }

    /// Reads what [`id`](Self::id) wrote; parameters that are not named have their defaults.
    pub fn from_id(id: &str) -> Result<Self> {
        let bad = |cause: &str| {
            Error::new(
                ErrorKind::Config,
                format!("`{id}` names no extractor: {cause}"),
            )
            .with_help(
                "write KIND or KIND:NAME=VALUE,..., such as star-brief:num_features=300, with text in \
                 double quotes",
            )
        };
        let (kind, parameters) = id.split_once(':').unwrap_or((id, ""));
        let mut fields = Map::from_iter([("kind".to_owned(), Value::from(kind))]);
        let mut rest = parameters;
        while !rest.is_empty() {
            let without_value = || bad("a parameter has no value");
            let (name, values) = rest.split_once('=').ok_or_else(without_value)?;
            // Where a value ends only JSON says: strings and lists may hold commas.
            let mut value = serde_json::Deserializer::from_str(values).into_iter::<Value>();
            let read = value.next().ok_or_else(without_value)?;
            let read = read.map_err(|cause| bad(&cause.to_string()))?;
            if fields.insert(name.to_owned(), read).is_some() {
                return Err(bad("a parameter is given twice"));
            }
            let behind = &values[value.byte_offset()..];
            rest = match behind.strip_prefix(',') {
                Some(rest) => rest,
                None if behind.is_empty() => "",
                None => return Err(bad("a comma stands between parameters")),
            };
        }
        serde_json::from_value(Value::Object(fields)).map_err(|cause| bad(&cause.to_string()))
    }
}

impl std::fmt::Display for ExtractorConfig {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.id())
    }
}

impl std::str::FromStr for ExtractorConfig {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        Self::from_id(text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_id_spells_every_parameter_and_reads_back() {
        let config = ExtractorConfig::StarBrief(
            StarBriefConfig::default()
                .with_num_features(300)
                .with_max_size(30),
        );
        assert_eq!(
            config.id(),
            "star-brief:line_threshold_binarized=8,line_threshold_projected=10,max_size=30,\
             num_features=300,response_threshold=0,suppress_nonmax_size=5"
        );
        assert_eq!(
            ExtractorConfig::from_id(&config.id()).expect("own id"),
            config
        );
        assert_eq!(config.build().expect("valid").id(), config.id());
        assert_eq!(
            "fast-brief:threshold=20"
                .parse::<ExtractorConfig>()
                .expect("valid"),
            ExtractorConfig::FastBrief(CornerBriefConfig::default().with_threshold(20))
        );
    }

    #[test]
    fn an_id_may_hold_names_and_lists() {
        let digest = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        let config = OnnxConfig::new(digest.parse().expect("a digest"), "block 4, \"add\"=0")
            .with_normalization(vec![0.5], vec![0.25]);
        let config = ExtractorConfig::Onnx(config);
        assert_eq!(
            config.id(),
            format!(
                "onnx:height=320,layer=\"block 4, \\\"add\\\"=0\",mean=[0.5],model=\"{digest}\",\
                 num_bits=128,num_features=600,smooth_cells=3,std=[0.25],suppress_cells=1,width=448"
            )
        );
        assert_eq!(
            ExtractorConfig::from_id(&config.id()).expect("own id"),
            config
        );
        assert_eq!(
            ExtractorConfig::from_id("onnx").expect("a kind"),
            ExtractorConfig::Onnx(OnnxConfig::default())
        );
    }

    #[cfg(not(feature = "onnx"))]
    #[test]
    fn without_the_feature_a_network_is_refused_with_a_remedy() {
        let config = ExtractorConfig::Onnx(OnnxConfig::default());
        let error = config.build().err().expect("this build has none");
        assert_eq!(error.kind(), ErrorKind::Config);
        assert!(error.to_string().contains("--features onnx"), "{error}");
    }

    #[test]
    fn what_is_no_extractor_is_refused_with_a_remedy() {
        for bad in [
            "",
            "sift",
            "star-brief:max_size",
            "star-brief:max_size=x",
            "star-brief:max_size=-1",
            "star-brief:size=45",
            "star-brief:kind=1",
            "star-brief:max_size=45,max_size=45",
            "star-brief:max_size=45 num_features=9",
            "star-brief:max_size=",
            "onnx:layer=relu",
            "onnx:model=\"ba78\"",
        ] {
            let error = ExtractorConfig::from_id(bad).expect_err(bad);
            assert_eq!(error.kind(), ErrorKind::Config);
            assert!(error.to_string().contains("KIND:NAME=VALUE"), "{error}");
        }
        for (px, window) in [(4, 5), (129, 5), (5, 23)] {
            let config = StarBriefConfig::default()
                .with_max_size(px)
                .with_suppress_nonmax_size(window);
            assert!(
                ExtractorConfig::StarBrief(config).build().is_err(),
                "{px} {window}"
            );
        }
    }

    #[test]
    fn configuration_files_name_the_kind() {
        let config: ExtractorConfig =
            toml::from_str("kind = \"star-brief\"\nnum_features = 100").expect("valid");
        assert_eq!(
            config,
            ExtractorConfig::StarBrief(StarBriefConfig::default().with_num_features(100))
        );
        assert!(toml::from_str::<ExtractorConfig>("kind = \"star-brief\"\nfeatures = 1").is_err());
    }
}
