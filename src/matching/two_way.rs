//! Has the map this live feature already, by the reference recipe?
//!
//! The recipe of the field's public benchmark compares both ways: the two nearest map features of
//! each live feature, and the two nearest live features of each map feature, and applies the ratio
//! test to each. This is *not* a mutual check: the nearest of the nearest may be another feature.
//! For live feature `i` with nearest map feature `j`:
//!
//! - `forward`: `i` passes the ratio test among the map's features;
//! - `backward`: `j` passes the ratio test among the live features;
//! - seen: forward and backward, and the displacement is in the window;
//! - new: neither forward nor backward. What passes one way only is neither seen nor new.

use serde::{Deserialize, Serialize};

use crate::feature::FeaturesView;
use crate::simd::{Kernel, NearestTwo, PackedDescriptors};
use fremen::error::{Error, Result};

use super::config::{Direction, MatchConfig, Window, passes_ratio, require_ratio};
use super::matcher::Match;

/// The numbers of the two-way comparison; the default is the recipe's own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Fields", into = "Fields")]
pub struct TwoWayConfig(Fields);

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Fields {
    ratio: f64,
    #[serde(default)]
    accept_lone: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    window: Option<Window>,
}

impl TwoWayConfig {
    /// Ratio above 0 and at most 1 (otherwise an [`ErrorKind::Config`](fremen::ErrorKind::Config)
    /// error), whether a feature without a rival passes it, and the window of seen features.
    pub fn new(ratio: f64, accept_lone: bool, window: Option<Window>) -> Result<Self> {
        require_ratio(ratio)?;
        Ok(Self(Fields {
            ratio,
            accept_lone,
            window,
        }))
    }

    /// The bound of nearest / second nearest distance.
    pub fn ratio(&self) -> f64 {
        self.0.ratio
    }

    /// Whether a feature without a rival passes the ratio test.
    pub fn accept_lone(&self) -> bool {
        self.0.accept_lone
    }

    /// The window of seen features.
    pub fn window(&self) -> Option<Window> {
        self.0.window
    }

    fn passes(&self, nearest: &NearestTwo) -> bool {
        passes_ratio(nearest, self.0.ratio, self.0.accept_lone)
    }
}

impl Default for TwoWayConfig {
    /// Ratio 0.7, `|dx| < 400`, `|dy| < 50`.
    fn default() -> Self {
        let lttl = MatchConfig::lttl(Direction::LiveToMap);
        Self(Fields {
            ratio: lttl.ratio().unwrap_or(0.7),
            accept_lone: lttl.accept_lone(),
            window: lttl.window(),
        })
    }
}

impl TryFrom<Fields> for TwoWayConfig {
    type Error = Error;

    fn try_from(fields: Fields) -> Result<Self> {
        Self::new(fields.ratio, fields.accept_lone, fields.window)
    }
}

impl From<TwoWayConfig> for Fields {
    fn from(cfg: TwoWayConfig) -> Self {
        cfg.0
    }
}

/// What the two-way comparison says about one live feature.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Verdict {
    /// The live feature and its nearest map feature; `None` where the map is empty.
    pub nearest: Option<Match>,
    /// Whether the live feature passes the ratio test among the map's features.
    pub forward: bool,
    /// Whether its nearest map feature passes the ratio test among the live features.
    pub backward: bool,
    /// Whether the displacement to the nearest map feature is in the window.
    pub in_window: bool,
}

impl Verdict {
    /// The match, if the map feature counts as seen: both ratios pass, inside the window.
    pub fn seen(&self) -> Option<Match> {
        self.nearest
            .filter(|_| self.forward && self.backward && self.in_window)
    }

    /// Whether the live feature is to become a new map feature: both ratios fail.
    pub fn is_new(&self) -> bool {
        !self.forward && !self.backward
    }
}

/// The two one-way comparisons and their verdicts; also the memory they are computed in.
#[derive(Clone, Debug, Default)]
pub struct TwoWay {
    packed: PackedDescriptors,
    live_to_map: Vec<NearestTwo>,
    map_to_live: Vec<NearestTwo>,
    verdicts: Vec<Verdict>,
}

impl TwoWay {
    /// Memory in which nothing is compared yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Compares both ways, in `2 * map * live` distances; replaces what was compared before.
    pub fn compare(
        &mut self,
        cfg: &TwoWayConfig,
        kernel: Kernel,
        map: FeaturesView<'_>,
        live: FeaturesView<'_>,
    ) {
        self.live_to_map.resize(live.len(), NearestTwo::EMPTY);
        self.packed.repack(map.descriptors);
        kernel.nearest_two(live.descriptors, &self.packed, &mut self.live_to_map);
        self.map_to_live.resize(map.len(), NearestTwo::EMPTY);
        self.packed.repack(live.descriptors);
        kernel.nearest_two(map.descriptors, &self.packed, &mut self.map_to_live);

        let map_to_live = &self.map_to_live;
        let verdicts = self.live_to_map.iter().zip(0..).map(|(nearest, id)| {
            let found = nearest.has_best().then_some(Match {
                map: nearest.best,
                live: id,
                distance_bits: nearest.best_bits,
            });
            Verdict {
                nearest: found,
                forward: cfg.passes(nearest),
                backward: found.is_some_and(|found| cfg.passes(&map_to_live[found.map as usize])),
                in_window: found.is_some_and(|found| {
                    cfg.window().is_none_or(|window| {
                        window.contains(
                            &map.keypoints[found.map as usize],
                            &live.keypoints[found.live as usize],
                        )
                    })
                }),
            }
        });
        self.verdicts.clear();
        self.verdicts.extend(verdicts);
    }

    /// One verdict per live feature, in order of id.
    pub fn verdicts(&self) -> &[Verdict] {
        &self.verdicts
    }

    /// One way: the two nearest map features of each live feature.
    pub fn live_to_map(&self) -> &[NearestTwo] {
        &self.live_to_map
    }

    /// The other way: the two nearest live features of each map feature.
    pub fn map_to_live(&self) -> &[NearestTwo] {
        &self.map_to_live
    }
}
