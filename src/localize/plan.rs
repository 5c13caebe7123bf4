//! What is each place matched by?
//!
//! A [`Plan`] is what can be worked out of a place before any image is seen: the model that its
//! features are predicted with, or the visits whose appearances are matched. A [`PlannedMap`] is a
//! snapshot with the plans of all its places and the rules of matching: what every later step
//! reads.

use std::sync::Arc;

use rayon::prelude::*;

use super::config::{LocalizerConfig, Method};
use super::query::Query;
use crate::feature::FeaturesView;
use crate::map::{AppearanceUse, Node, NodeId, Snapshot};
use crate::matching::Matcher;
use crate::predict::{Choice, PredictedMap, ReferenceVisits, Selection};
use fremen::error::{Error, ErrorKind, Result};
use fremen::time::{Time, Zone};
use fremen::visibility::{self, BitRow, VisibilityConfig, VisibilityModel, Visits};

/// Sums in another order differ by less.
const SAME_PROBABILITY: f64 = 1e-9;

/// A map, and what each of its places is matched by.
#[derive(Debug)]
pub(super) struct PlannedMap {
    pub(super) snapshot: Arc<Snapshot>,
    pub(super) cfg: LocalizerConfig,
    pub(super) matcher: Matcher,
    /// Shared with those of other generations of the map, where a place is the same in both.
    pub(super) plans: Vec<Arc<Plan>>,
    /// Of the features of a live image, so many of the strongest take part.
    pub(super) num_live: usize,
    /// By whose clocks places are predicted.
    pub(super) zone: Option<Zone>,
}

/// What one place is matched by.
#[derive(Debug)]
pub(super) enum Plan {
    /// Features of the place, chosen by their visibility at the query's time.
    Predicted {
        model: Box<dyn VisibilityModel>,
        references: ReferenceVisits,
    },
    /// The appearances kept at these visits; with a model, those that are likely at the query's
    /// time.
    Appearances {
        visits: Vec<u32>,
        likely: Option<Likely>,
    },
}

/// When each experience of a place locates it.
#[derive(Debug)]
pub(super) struct Likely {
    model: Box<dyn VisibilityModel>,
    /// How often each does at any time.
    means: Vec<f64>,
}

impl PlannedMap {
    /// Fits the model of every place, on the threads of the caller's rayon pool.
    pub(super) fn new(snapshot: Arc<Snapshot>, cfg: LocalizerConfig) -> Result<Self> {
        cfg.check()?;
        let zone = snapshot.meta().civil_zone()?;
        let plans = (snapshot.nodes().par_iter())
            .map(|node| Plan::of(node, &cfg, zone.as_ref()).map(Arc::new))
            .collect::<Result<_>>()?;
        Self::from_plans(snapshot, cfg, zone, plans)
    }

    /// With plans that are known; fails where there is nothing to match.
    pub(super) fn from_plans(
        snapshot: Arc<Snapshot>,
        cfg: LocalizerConfig,
        zone: Option<Zone>,
        plans: Vec<Arc<Plan>>,
    ) -> Result<Self> {
        if plans.is_empty() {
            return Err(Error::new(ErrorKind::Config, "the map has no places")
                .with_help("build it from at least one image of each place"));
        }
        let remembers = |plan: &Plan| match plan {
            Plan::Predicted { .. } => true,
            Plan::Appearances { visits, .. } => !visits.is_empty(),
        };
        if !plans.iter().any(|plan| remembers(plan)) {
            return Err(Error::new(
                ErrorKind::Config,
                format!(
                    "the map kept no appearances, which method `{}` needs",
                    cfg.method()
                ),
            )
            .with_help("build the map with `keep-appearances = \"all\"`, or use method `fremen`"));
        }
        Ok(Self::from_parts(snapshot, cfg, zone, plans))
    }

    /// With plans of which some are known to match something.
    pub(super) fn from_parts(
        snapshot: Arc<Snapshot>,
        cfg: LocalizerConfig,
        zone: Option<Zone>,
        plans: Vec<Arc<Plan>>,
    ) -> Self {
        let num_visits = snapshot.nodes().iter().map(|node| node.visits().len());
        Self {
            num_live: cfg.num_live(num_visits),
            matcher: Matcher::new(cfg.matching().clone()),
            snapshot,
            cfg,
            plans,
            zone,
        }
    }

    /// The same for a newer snapshot of the map; `is_same` says which of its places have not
    /// changed and keep their plans.
    pub(super) fn with_snapshot(&self, snapshot: Arc<Snapshot>, is_same: &[bool]) -> Result<Self> {
        let zone = snapshot.meta().civil_zone()?;
        let are_clocks_same = zone == self.zone;
        let plans = (snapshot.nodes().par_iter().zip(is_same).enumerate())
            .map(|(index, (node, &is_same))| {
                if is_same && are_clocks_same {
                    Ok(Arc::clone(&self.plans[index]))
                } else {
                    Plan::of(node, &self.cfg, zone.as_ref()).map(Arc::new)
                }
            })
            .collect::<Result<_>>()?;
        Self::from_plans(snapshot, self.cfg.clone(), zone, plans)
    }

    /// The time that is predicted for, if the query fits the map: the middle of its bucket, or the
    /// epoch for methods that do without.
    pub(super) fn check(&self, query: &Query<'_>) -> Result<Time> {
        if let (Some(live), Some(map)) = (query.image_size, self.snapshot.meta().image_size)
            && live != map
        {
            return Err(Error::new(
                ErrorKind::Shape,
                format!(
                    "the image has {} x {} px, but the map was learnt from {} x {} px",
                    live.0, live.1, map.0, map.1
                ),
            )
            .with_help("crop or scale the image as the map's images were"));
        }
        let num_places = self.plans.len();
        if let Some(unknown) = (query.prior.iter()).find(|it| it.0 as usize >= num_places) {
            let message = format!(
                "the prior names node {}, the map has {num_places} places",
                unknown.0
            );
            return Err(Error::new(ErrorKind::NotFound, message)
                .with_help("take nodes of the snapshot that the localizer reads"));
        }
        match query.time {
            Some(time) => Ok(self.middle_of_bucket(time)),
            None if self.cfg.method().needs_time() => Err(Error::new(
                ErrorKind::Time,
                format!("method `{}` needs the time of the image", self.cfg.method()),
            )
            .with_help("give the time, or use method `static`")),
            None => Ok(Time::default()),
        }
    }

    /// The time that is predicted for at `time`.
    pub(super) fn middle_of_bucket(&self, time: Time) -> Time {
        if self.cfg.method().needs_time() {
            self.cfg.middle_of_bucket(time)
        } else {
            Time::default()
        }
    }

    /// Chooses the features of a place that should be visible: more than selected, where it has
    /// few visits.
    pub(super) fn choose(
        &self,
        predicted: &mut PredictedMap,
        model: &dyn VisibilityModel,
        references: &ReferenceVisits,
        time: Time,
        selection: Selection,
    ) {
        let selection = self.cfg.selection_for(selection, references.num_visits());
        match self.cfg.choice() {
            _ if self.cfg.method() == Method::Fused => {
                predicted.predict_fused(model, time, selection, references);
            }
            Choice::Likeliest => predicted.predict(model, time, selection),
            Choice::Covering => predicted.predict_covering(model, time, selection, references),
        }
    }

    /// At most the `size` strongest features of an appearance.
    pub(super) fn appearance(&self, id: NodeId, visit: u32, size: usize) -> FeaturesView<'_> {
        let appearance = &self.snapshot.node(id).visits()[visit as usize].appearance;
        appearance
            .as_ref()
            .map_or(FeaturesView::EMPTY, |features| features.view().prefix(size))
    }

    /// How many features of an appearance the configured selection takes.
    pub(super) fn largest_size(&self) -> usize {
        match self.cfg.selection() {
            Selection::Top(n) => n.get(),
            Selection::Threshold(_) => usize::MAX,
        }
    }
}

impl Plan {
    /// What the configured method matches the place by.
    pub(super) fn of(node: &Node, cfg: &LocalizerConfig, zone: Option<&Zone>) -> Result<Self> {
        let fit = |cfg: &VisibilityConfig, log| {
            visibility::in_zone(zone, log, |log| visibility::fit(log, cfg, Visits::All))
        };
        let kept = |only: Option<AppearanceUse>| {
            (0..)
                .zip(node.visits())
                .filter(|(_, visit)| {
                    visit.appearance.is_some()
                        && only.is_none_or(|only| visit.appearance_use == only)
                })
                .map(|(index, _)| index)
                .collect()
        };
        Ok(match cfg.method() {
            Method::Static | Method::Fremen | Method::Fused => Self::Predicted {
                model: fit(&cfg.model(), node.log())?,
                references: cfg.references(node.log(), Visits::All)?,
            },
            Method::ExperienceAll => Self::Appearances {
                visits: kept(None),
                likely: None,
            },
            Method::Experience => Self::Appearances {
                visits: kept(Some(AppearanceUse::Experience)),
                likely: None,
            },
            Method::Freex => Self::Appearances {
                // Also those whose appearance is lost: the log counts them, and they match nothing.
                visits: (0..)
                    .zip(node.visits())
                    .filter(|(_, visit)| visit.appearance_use == AppearanceUse::Experience)
                    .map(|(index, _)| index)
                    .collect(),
                likely: Some(Likely {
                    model: fit(cfg.visibility(), node.experience_log())?,
                    means: {
                        let model = fit(&VisibilityConfig::mean(), node.experience_log())?;
                        let mut means = vec![0.0; model.num_features()];
                        model.predict_into(Time::default(), &mut means);
                        means
                    },
                }),
            },
        })
    }

    /// The visits whose appearances are matched at `time`: all, or with a model those that are at
    /// least as likely then as at any time. (Without a rhythm that is all of them; T-RO 2017 VII-A
    /// uses about 100 of 170 and does not say by which rule.)
    pub(super) fn visits_into(&self, time: Time, scores: &mut Vec<f64>, out: &mut Vec<u32>) {
        out.clear();
        let Self::Appearances { visits, likely } = self else {
            return;
        };
        let Some(likely) = likely else {
            out.extend_from_slice(visits);
            return;
        };
        scores.clear();
        scores.resize(likely.model.num_features(), 0.0);
        likely.model.score_into(time, scores);
        let judged = visits.iter().zip(scores.iter().zip(&likely.means));
        out.extend(
            judged
                .clone()
                .filter(|(_, (score, mean))| **score >= *mean - SAME_PROBABILITY)
                .map(|(&visit, _)| visit),
        );
        if out.is_empty() {
            // The latest of the most likely: the newest knowledge wins a tie.
            let best = judged.max_by(|a, b| a.1.0.total_cmp(b.1.0));
            out.extend(best.map(|(&visit, _)| visit));
        }
    }

    /// The same learnt from `rest` only, which is every visit but those of `fold`.
    pub(super) fn without(
        &self,
        node: &Node,
        cfg: &LocalizerConfig,
        zone: Option<&Zone>,
        fold: &BitRow,
        rest: &BitRow,
    ) -> Result<Self> {
        Ok(match self {
            Self::Predicted { .. } => Self::Predicted {
                model: visibility::in_zone(zone, node.log(), |log| {
                    visibility::fit(log, &cfg.model(), Visits::Only(rest))
                })?,
                references: cfg.references(node.log(), Visits::Only(rest))?,
            },
            // Which appearances are likely is not learnt again.
            Self::Appearances { visits, .. } => Self::Appearances {
                visits: (visits.iter().copied())
                    .filter(|&visit| !fold.get(visit as usize))
                    .collect(),
                likely: None,
            },
        })
    }
}
