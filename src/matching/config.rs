//! Which pairs count as matches?

use serde::{Deserialize, Serialize};

use crate::feature::Keypoint;
use crate::simd::NearestTwo;
use fremen::error::{Error, ErrorKind, Result};

use super::displacement::Displacement;

/// Which side queries the other for its nearest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Direction {
    /// Every live feature names its nearest map feature.
    LiveToMap,
    /// Every map feature names its nearest live feature.
    MapToLive,
}

/// How far a live keypoint may lie from the map's: `|dx| < max_dx_px` and `|dy| < max_dy_px`, with
/// `(dx, dy) = live - map`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "WindowFields", into = "WindowFields")]
pub struct Window(WindowFields);

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct WindowFields {
    max_dx_px: f64,
    max_dy_px: f64,
}

impl Window {
    /// `|dx| < 400`, `|dy| < 50`: a robot on its path again, as in the reference recipe.
    pub const REFERENCE: Self = Self(WindowFields {
        max_dx_px: 400.0,
        max_dy_px: 50.0,
    });

    /// Both limits are exclusive; one that is not above 0 is an [`ErrorKind::Config`] error.
    pub fn new(max_dx_px: f64, max_dy_px: f64) -> Result<Self> {
        for (name, value) in [("max-dx-px", max_dx_px), ("max-dy-px", max_dy_px)] {
            require(value > 0.0, name, value, "a number of pixels above 0")?;
        }
        Ok(Self(WindowFields {
            max_dx_px,
            max_dy_px,
        }))
    }

    /// The exclusive limit of `|dx|`, px.
    pub fn max_dx_px(&self) -> f64 {
        self.0.max_dx_px
    }

    /// The exclusive limit of `|dy|`, px.
    pub fn max_dy_px(&self) -> f64 {
        self.0.max_dy_px
    }

    /// Whether the displacement from `map` to `live` is inside; never where it is no number.
    #[inline]
    pub fn contains(&self, map: &Keypoint, live: &Keypoint) -> bool {
        self.contains_displacement(Displacement::between(map, live))
    }

    /// Whether `displacement` is inside; never where it is no number.
    #[inline]
    pub fn contains_displacement(&self, displacement: Displacement) -> bool {
        displacement.dx_px.abs() < self.0.max_dx_px && displacement.dy_px.abs() < self.0.max_dy_px
    }
}

impl TryFrom<WindowFields> for Window {
    type Error = Error;

    fn try_from(fields: WindowFields) -> Result<Self> {
        Self::new(fields.max_dx_px, fields.max_dy_px)
    }
}

impl From<Window> for WindowFields {
    fn from(window: Window) -> Self {
        window.0
    }
}

/// The rules of a [`Matcher`](super::Matcher); the module says in which order they apply.
///
/// In a file, keys are in kebab case, and those left out have the value of
/// [`MatchConfig::default`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "MatchConfigBuilder", into = "MatchConfigBuilder")]
pub struct MatchConfig(MatchConfigBuilder);

/// Collects the rules of a [`MatchConfig`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct MatchConfigBuilder {
    direction: Direction,
    max_bits: u16,
    accept_lone: bool,
    mutual: bool,
    unique: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    ratio: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    window: Option<Window>,
}

impl Default for MatchConfigBuilder {
    fn default() -> Self {
        Self {
            direction: Direction::MapToLive,
            max_bits: 40,
            accept_lone: false,
            mutual: false,
            unique: true,
            ratio: None,
            window: None,
        }
    }
}

impl MatchConfigBuilder {
    /// Which side queries the other.
    #[must_use]
    pub fn with_direction(mut self, direction: Direction) -> Self {
        self.direction = direction;
        self
    }

    /// The largest distance of a match, 0 to 256 bits; 256 accepts any.
    #[must_use]
    pub fn with_max_bits(mut self, max_bits: u16) -> Self {
        self.max_bits = max_bits;
        self
    }

    /// Nearest distance < `ratio` x second nearest; above 0, at most 1. `None`: no such test.
    #[must_use]
    pub fn with_ratio(mut self, ratio: Option<f64>) -> Self {
        self.ratio = ratio;
        self
    }

    /// Whether a feature without a rival passes the ratio test. With one feature on the other side
    /// everything would match it, so the default is that it fails.
    #[must_use]
    pub fn with_accept_lone(mut self, accept_lone: bool) -> Self {
        self.accept_lone = accept_lone;
        self
    }

    /// Whether both features must be each other's nearest.
    #[must_use]
    pub fn with_mutual(mut self, mutual: bool) -> Self {
        self.mutual = mutual;
        self
    }

    /// Whether a feature of the other side is used once only.
    #[must_use]
    pub fn with_unique(mut self, unique: bool) -> Self {
        self.unique = unique;
        self
    }

    /// The window that displacements must lie in, or `None`.
    #[must_use]
    pub fn with_window(mut self, window: Option<Window>) -> Self {
        self.window = window;
        self
    }

    /// The rules, if every value is in its range; otherwise an [`ErrorKind::Config`] error.
    pub fn build(self) -> Result<MatchConfig> {
        require(
            self.max_bits <= 256,
            "max-bits",
            f64::from(self.max_bits),
            "0 to 256 bits",
        )?;
        if let Some(ratio) = self.ratio {
            require_ratio(ratio)?;
        }
        Ok(MatchConfig(self))
    }
}

impl TryFrom<MatchConfigBuilder> for MatchConfig {
    type Error = Error;

    fn try_from(builder: MatchConfigBuilder) -> Result<Self> {
        builder.build()
    }
}

impl From<MatchConfig> for MatchConfigBuilder {
    fn from(cfg: MatchConfig) -> Self {
        cfg.0
    }
}

impl Default for MatchConfig {
    /// Preset `default`: each map feature's nearest live feature within 40 bits, each used once.
    fn default() -> Self {
        Self(MatchConfigBuilder::default())
    }
}

impl MatchConfig {
    /// Starts from the preset `default`.
    pub fn builder() -> MatchConfigBuilder {
        MatchConfigBuilder::default()
    }

    /// Preset `lttl`, the recipe of the field's public benchmark: ratio 0.7, `|dx| < 400`,
    /// `|dy| < 50`, any distance, features may be used again. It localises with
    /// [`Direction::LiveToMap`] and learns visibilities with [`Direction::MapToLive`].
    pub fn lttl(direction: Direction) -> Self {
        Self(MatchConfigBuilder {
            direction,
            max_bits: 256,
            accept_lone: false,
            mutual: false,
            unique: false,
            ratio: Some(0.7),
            window: Some(Window::REFERENCE),
        })
    }

    /// These rules as a builder, to change some.
    pub fn to_builder(&self) -> MatchConfigBuilder {
        self.0.clone()
    }

    /// Which side queries the other.
    pub fn direction(&self) -> Direction {
        self.0.direction
    }

    /// The largest distance of a match, bits.
    pub fn max_bits(&self) -> u16 {
        self.0.max_bits
    }

    /// The bound of nearest / second nearest distance.
    pub fn ratio(&self) -> Option<f64> {
        self.0.ratio
    }

    /// Whether a feature without a rival passes the ratio test.
    pub fn accept_lone(&self) -> bool {
        self.0.accept_lone
    }

    /// Whether both features must be each other's nearest.
    pub fn mutual(&self) -> bool {
        self.0.mutual
    }

    /// Whether a feature of the other side is used once only.
    pub fn unique(&self) -> bool {
        self.0.unique
    }

    /// The window that displacements must lie in.
    pub fn window(&self) -> Option<Window> {
        self.0.window
    }

    /// Rules 1 to 3 for one feature: it has a nearest one, near enough, and distinctive.
    #[inline]
    pub(super) fn accepts(&self, nearest: &NearestTwo) -> bool {
        nearest.best_bits <= self.0.max_bits
            && self
                .0
                .ratio
                .is_none_or(|ratio| passes_ratio(nearest, ratio, self.0.accept_lone))
    }
}

/// Whether `nearest` passes Lowe's ratio test: best < `ratio` * second, strictly, in f64.
///
/// Without a nearest feature it fails; with a nearest but no second one the answer is
/// `accept_lone`.
#[inline]
pub fn passes_ratio(nearest: &NearestTwo, ratio: f64, accept_lone: bool) -> bool {
    if nearest.has_second() {
        f64::from(nearest.best_bits) < ratio * f64::from(nearest.second_bits)
    } else {
        nearest.has_best() && accept_lone
    }
}

pub(super) fn require_ratio(ratio: f64) -> Result<()> {
    require(
        ratio > 0.0 && ratio <= 1.0,
        "ratio",
        ratio,
        "a number above 0 and at most 1",
    )
}

pub(super) fn require(valid: bool, name: &str, value: f64, allowed: &str) -> Result<()> {
    if valid {
        Ok(())
    } else {
        Err(
            Error::new(ErrorKind::Config, format!("`{name}` cannot be {value}"))
                .with_help(format!("give {allowed}")),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_out_of_range_are_refused_by_name() {
        for (builder, name) in [
            (MatchConfig::builder().with_max_bits(257), "max-bits"),
            (MatchConfig::builder().with_ratio(Some(0.0)), "ratio"),
            (MatchConfig::builder().with_ratio(Some(f64::NAN)), "ratio"),
            (MatchConfig::builder().with_ratio(Some(1.1)), "ratio"),
        ] {
            let error = builder.build().unwrap_err();
            assert_eq!(error.kind(), ErrorKind::Config);
            assert!(error.to_string().contains(name), "{error}");
        }
        assert!(Window::new(f64::NAN, 1.0).is_err());
        assert!(Window::new(1.0, -1.0).is_err());
    }

    #[test]
    fn presets_survive_a_file_and_bad_files_are_refused() {
        for cfg in [
            MatchConfig::default(),
            MatchConfig::lttl(Direction::LiveToMap),
        ] {
            let text = toml::to_string(&cfg).unwrap();
            assert_eq!(toml::from_str::<MatchConfig>(&text).unwrap(), cfg, "{text}");
        }
        assert!(toml::from_str::<MatchConfig>("ratio = 2.0").is_err());
        assert!(toml::from_str::<MatchConfig>("max-bit = 2").is_err());
        assert!(
            toml::from_str::<MatchConfig>("window = { max-dx-px = 0, max-dy-px = 1 }").is_err()
        );
    }

    #[test]
    fn the_ratio_test_is_strict_and_a_lone_neighbour_needs_leave() {
        let near = |best_bits, second_bits| NearestTwo {
            best: 0,
            second: 1,
            best_bits,
            second_bits,
        };
        assert!(passes_ratio(&near(6, 10), 0.7, false));
        assert!(!passes_ratio(&near(7, 10), 0.7, false));
        assert!(!passes_ratio(&near(0, 0), 0.7, false));
        let lone = NearestTwo {
            best: 0,
            best_bits: 3,
            ..NearestTwo::EMPTY
        };
        assert!(!passes_ratio(&lone, 0.7, false));
        assert!(passes_ratio(&lone, 0.7, true));
        assert!(!passes_ratio(&NearestTwo::EMPTY, 0.7, true));
    }
}
