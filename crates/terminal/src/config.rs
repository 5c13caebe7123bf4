//! Which numbers are in effect?
//!
//! A configuration file has the tables `[learn]` ([`LearnConfig`]), `[localize]`
//! ([`LocalizerConfig`]) and `[motion]` ([`MotionConfig`]). A key in them replaces that of the
//! preset; if it is a table itself, it replaces the preset's as a whole. Options of the command
//! come last.

use std::path::Path;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::{Outcome, Output};
use chronotope::error::{Error, ErrorKind, Result};
use chronotope::learn::{BudgetConfig, LearnConfig};
use chronotope::localize::{LocalizerConfig, MotionConfig, Preset};
use chronotope::map::{Map, MapMeta};

/// All places of a map that learns on take at most so many bytes together, unless a configuration
/// says otherwise.
const DEFAULT_BUDGET_BYTES: usize = 256 << 20;

/// Bytes of a configuration, at most.
const MAX_BYTES: u64 = 1 << 20;

/// Everything a file can set.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Config {
    /// What of an image is worth remembering.
    pub learn: LearnConfig,
    /// How an image is localised.
    pub localize: LocalizerConfig,
    /// How the robot moves.
    pub motion: MotionConfig,
}

/// The file by itself: finds every wrong key and value, with its line.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    learn: Option<LearnConfig>,
    localize: Option<LocalizerConfig>,
    motion: Option<MotionConfig>,
}

impl Config {
    /// The numbers of `preset`, changed by `file`.
    ///
    /// Fails if it cannot be read, or with its line if a key or value of it is wrong.
    pub fn read(file: Option<&Path>, preset: Preset) -> Result<Self> {
        let config = Self {
            learn: LearnConfig::preset(preset),
            localize: LocalizerConfig::preset(preset),
            motion: MotionConfig::default(),
        };
        let Some(path) = file else {
            return Ok(config);
        };
        let text = fremen::file::read_text(path, MAX_BYTES)
            .map_err(|error| error.with_help("--print-config shows what such a file says"))?;
        config
            .changed_by(&text)
            .map_err(|error| error.with_path(path))
    }

    /// The numbers of the preset that a map was built with, changed by `file`; fails as
    /// [`read`](Self::read) does.
    pub fn read_for(meta: &MapMeta, file: Option<&Path>) -> Result<Self> {
        Self::read(file, preset_of(meta))
    }

    /// What is learnt of visits of `map`, within a budget: that of the numbers or, if they have none,
    /// 256 MiB for all places together; a map that is larger already does not grow.
    ///
    /// Fails if the map cannot be read.
    pub fn learn_within_budget(&self, map: &Path) -> Result<LearnConfig> {
        if self.learn.budget().is_bounded() {
            return Ok(self.learn.clone());
        }
        let snapshot = Map::open_read_only(map)?.snapshot();
        let num_bytes: usize = snapshot.nodes().iter().map(|node| node.num_bytes()).sum();
        let budget = BudgetConfig::default().with_bytes(num_bytes.max(DEFAULT_BUDGET_BYTES));
        self.learn.clone().with_budget(budget)
    }

    fn changed_by(self, text: &str) -> Result<Self> {
        let file: File = toml::from_str(text).map_err(|cause| config_error(&cause, text))?;
        let tables: toml::Table =
            toml::from_str(text).map_err(|cause| config_error(&cause, text))?;
        Ok(Self {
            learn: match file.learn {
                Some(_) => overlaid(&self.learn, tables.get("learn"))?,
                None => self.learn,
            },
            localize: match file.localize {
                Some(_) => overlaid(&self.localize, tables.get("localize"))?,
                None => self.localize,
            },
            motion: file.motion.unwrap_or(self.motion),
        })
    }

    /// Prints it as a file that [`read`](Self::read) takes.
    pub fn print(&self, out: &mut Output) -> anyhow::Result<Outcome> {
        out.line(self.to_toml()?.trim_end())?;
        Ok(Outcome::Good)
    }

    fn to_toml(&self) -> Result<String> {
        toml::to_string(self)
            .map_err(|cause| Error::new(ErrorKind::Config, format!("cannot be written: {cause}")))
    }
}

/// The preset that a map says it was built with; the preset `default` where this program does not
/// know it.
pub fn preset_of(meta: &MapMeta) -> Preset {
    meta.preset.parse().unwrap_or(Preset::Default)
}

fn overlaid<T: Serialize + DeserializeOwned>(base: &T, keys: Option<&toml::Value>) -> Result<T> {
    let error = |cause: String| Error::new(ErrorKind::Config, cause);
    let mut table = toml::Table::try_from(base).map_err(|cause| error(cause.to_string()))?;
    if let Some(toml::Value::Table(keys)) = keys {
        table.extend(keys.clone());
    }
    toml::Value::Table(table)
        .try_into()
        .map_err(|cause: toml::de::Error| error(cause.message().trim().to_owned()))
}

fn config_error(cause: &toml::de::Error, text: &str) -> Error {
    let error = Error::new(ErrorKind::Config, cause.message().trim())
        .with_help("--print-config shows every key");
    match cause.span() {
        Some(span) => {
            let before = text.as_bytes().iter().take(span.start);
            let line = before.filter(|&&byte| byte == b'\n').count() + 1;
            error.with_place(format!("line {line}"))
        }
        None => error,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use chronotope::localize::Method;

    fn preset(preset: Preset) -> Config {
        Config::read(None, preset).expect("no file")
    }

    #[test]
    fn what_is_printed_reads_back_over_any_preset() {
        for printed in Preset::ALL.map(preset) {
            let text = printed.to_toml().expect("serialises");
            for base in Preset::ALL.map(preset) {
                assert_eq!(base.changed_by(&text).expect("own text"), printed, "{text}");
            }
        }
    }

    #[test]
    fn keys_that_are_left_out_stay_the_presets() {
        let config = preset(Preset::Lttl)
            .changed_by("[localize]\nmethod = 'static'\n")
            .expect("valid");
        let expected = LocalizerConfig::preset(Preset::Lttl).with_method(Method::Static);
        assert_eq!(config.localize, expected);
        assert_eq!(config.learn, LearnConfig::preset(Preset::Lttl));
    }

    #[test]
    fn wrong_keys_and_values_are_named_with_their_line() {
        for (text, line, word) in [
            ("[learn]\nfeatures-per-visit = 0", "line 1", "features-per"),
            ("[learn]\n\nfeatures-per-visits = 9", "line 3", "-visits"),
            ("[locate]\n", "line 1", "locate"),
            ("[motion]\nkidnap = 0.0", "line 1", "kidnap"),
            ("selection = { top = 0 }", "line 2", "0 features"),
            ("selection = { threshold = nan }", "line 2", "[0, 1]"),
            ("min-score = -1", "line 2", "-1"),
            ("[localize", "line 1", ""),
        ] {
            // What stands in no table stands in the one that commands use most.
            let text = if text.starts_with('[') {
                text.to_owned()
            } else {
                format!("[localize]\n{text}")
            };
            let error = preset(Preset::Default)
                .changed_by(&text)
                .expect_err("a wrong text");
            assert_eq!(error.kind(), ErrorKind::Config);
            let shown = error.to_string();
            assert!(
                shown.contains(line) && shown.contains(word),
                "{text}: {shown}"
            );
        }
    }
}
