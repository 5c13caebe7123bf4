//! Which arguments do several commands take, and how are they read?

use std::path::PathBuf;

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};

use chronotope::feature::Models;

/// A map of which something is shown.
#[derive(Debug, Args)]
pub struct ShownMap {
    /// The map file.
    pub map: PathBuf,
    /// One JSON object.
    #[arg(long)]
    pub json: bool,
}

/// Where numbers come from.
#[derive(Debug, Args)]
pub struct ConfigArgs {
    /// TOML with the tables `[learn]` and `[localize]`; a key that is given replaces the preset's, a
    /// table in it as a whole.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Print the configuration in effect as TOML and do nothing else; it can be given to --config.
    #[arg(long)]
    pub print_config: bool,
}

/// Where the network of learned features is.
#[derive(Clone, Debug, Default, Args)]
pub struct ModelArgs {
    /// The network of learned features, an ONNX file; a map knows its own by the file's digest. Also
    /// looked for as DIGEST.onnx in the folder that the variable `CHRONOTOPE_MODELS` names.
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
}

impl ModelArgs {
    /// The places to look at.
    pub fn models(&self) -> Models {
        match &self.model {
            Some(file) => Models::from_env().with_file(file),
            None => Models::from_env(),
        }
    }
}

/// Reads one of `names`, which are listed where another one is given.
pub fn named<T>(names: impl IntoIterator<Item = &'static str>) -> impl TypedValueParser<Value = T>
where
    T: std::str::FromStr<Err = chronotope::Error> + Clone + Send + Sync + 'static,
{
    PossibleValuesParser::new(names).try_map(|name| name.parse::<T>())
}
