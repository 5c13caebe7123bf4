//! Which place is the true one of a query, and which others are near enough to count as right?
//!
//! Worked out for each fold, because only places that it learnt can be answered.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Result, bail};
use chronotope::dataset::Dataset;
use chronotope::map::PlaceKey;

use crate::results::Tolerance;

/// The places of one fold and the distances between them.
pub(crate) struct Nearness<'a> {
    dataset: &'a Dataset,
    tolerance: Option<Tolerance>,
    learnt: BTreeSet<&'a PlaceKey>,
    /// The places along the route, and where each of them is in this list.
    route: Vec<&'a PlaceKey>,
    position: BTreeMap<&'a PlaceKey, usize>,
    neighbours: BTreeMap<&'a PlaceKey, BTreeSet<&'a PlaceKey>>,
}

impl<'a> Nearness<'a> {
    /// Of the places that the entries `learn` show; fails where the dataset has nothing to measure
    /// the tolerance by.
    pub(crate) fn new(
        dataset: &'a Dataset,
        learn: &[usize],
        tolerance: Option<Tolerance>,
    ) -> Result<Self> {
        let learnt: BTreeSet<_> = (learn.iter())
            .map(|&entry| &dataset.entries[entry].place)
            .collect();
        let route = match tolerance {
            Some(Tolerance::Places(_)) => route(dataset, learn),
            _ => Vec::new(),
        };
        let position = route.iter().enumerate().map(|(i, place)| (*place, i));
        let position = position.collect();
        let mut neighbours: BTreeMap<_, BTreeSet<_>> = BTreeMap::new();
        match tolerance {
            Some(Tolerance::Edges(_)) if dataset.edges.is_empty() => bail!(
                "`{}` has no edges to measure the tolerance by (help: write edges.csv with \
                 from,to, or give --tolerance places:K)",
                dataset.name
            ),
            Some(Tolerance::Edges(_)) => {
                for edge in &dataset.edges {
                    neighbours.entry(&edge.from).or_default().insert(&edge.to);
                    neighbours.entry(&edge.to).or_default().insert(&edge.from);
                }
            }
            Some(Tolerance::Metres(_)) if dataset.poses.is_empty() => bail!(
                "`{}` has no poses to measure the tolerance by (help: write x and y into its \
                 index.csv, or poses.csv with place,x,y, or give --tolerance places:K)",
                dataset.name
            ),
            _ => {}
        }
        Ok(Self {
            dataset,
            tolerance,
            learnt,
            route,
            position,
            neighbours,
        })
    }

    /// The place that is right for an image of `place`: itself, where it was learnt. A place that
    /// was not, but has a pose, may have the nearest learnt one within a tolerance in metres.
    pub(crate) fn truth(&self, place: &'a PlaceKey) -> Option<&'a PlaceKey> {
        if self.learnt.contains(place) {
            return Some(place);
        }
        let Some(Tolerance::Metres(limit)) = self.tolerance else {
            return None;
        };
        let within = self.by_distance(place, limit);
        (within.into_iter())
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(_, place)| place)
    }

    /// The other learnt places within the tolerance of an image of `place`, sorted.
    pub(crate) fn near(&self, place: &'a PlaceKey) -> Vec<String> {
        let truth = self.truth(place);
        let mut near: Vec<&PlaceKey> = match self.tolerance {
            None => Vec::new(),
            Some(Tolerance::Places(most)) => match self.position.get(place) {
                Some(&at) => {
                    let most = most as usize;
                    let end = (at + most + 1).min(self.route.len());
                    self.route[at.saturating_sub(most)..end].to_vec()
                }
                None => Vec::new(),
            },
            Some(Tolerance::Edges(most)) => self.by_edges(place, most),
            Some(Tolerance::Metres(limit)) => {
                let within = self.by_distance(place, limit);
                within.into_iter().map(|(_, place)| place).collect()
            }
        };
        near.retain(|it| Some(*it) != truth && self.learnt.contains(*it));
        near.sort_unstable();
        near.into_iter().map(|it| it.as_str().to_owned()).collect()
    }

    fn by_edges(&self, place: &'a PlaceKey, most: u32) -> Vec<&'a PlaceKey> {
        let mut reached = BTreeSet::from([place]);
        let mut last = vec![place];
        for _ in 0..most {
            let next = last.iter().filter_map(|place| self.neighbours.get(*place));
            last = (next.flatten().copied())
                .filter(|place| reached.insert(*place))
                .collect();
        }
        reached.into_iter().collect()
    }

    /// The learnt places at most `limit` metres from `place`, with their distances.
    fn by_distance(&self, place: &PlaceKey, limit: f64) -> Vec<(f64, &'a PlaceKey)> {
        let poses = &self.dataset.poses;
        let Some(from) = poses.get(place) else {
            return Vec::new();
        };
        (self.learnt.iter())
            .filter_map(|&other| {
                let to = poses.get(other)?;
                let squares = from.iter().zip(to).map(|(a, b)| (a - b).powi(2));
                let distance = squares.sum::<f64>().sqrt();
                (distance <= limit).then_some((distance, other))
            })
            .collect()
    }
}

/// The learnt places in the order of the route.
///
/// A run lasts until a place comes again that is not the last one, or until a pause of more than
/// ten times what is usual between two images. The run that saw most places
/// gives the order (in it the order of time, and of names where times are equal); a place that it
/// missed comes after the place before it in a run that saw it.
pub(crate) fn route<'a>(dataset: &'a Dataset, learn: &[usize]) -> Vec<&'a PlaceKey> {
    // Entries are sorted by time, then by name of the place.
    let mut learn = learn.to_vec();
    learn.sort_unstable();
    let most_s = longest_step_s(dataset, &learn);
    let mut runs: Vec<Vec<&PlaceKey>> = vec![Vec::new()];
    let mut seen = BTreeSet::new();
    for (i, &entry) in learn.iter().enumerate() {
        let place = &dataset.entries[entry].place;
        if i > 0 && gap_s(dataset, &learn[i - 1..=i]) > most_s {
            seen.clear();
            runs.push(Vec::new());
        }
        let run = runs.last_mut().filter(|run| run.last() != Some(&place));
        let Some(run) = run else { continue };
        if seen.insert(place) {
            run.push(place);
        } else {
            seen = BTreeSet::from([place]);
            runs.push(vec![place]);
        }
    }
    // The first of equally long ones.
    runs.sort_by_key(|run| std::cmp::Reverse(run.len()));
    let mut route: Vec<&PlaceKey> = Vec::new();
    for run in runs {
        let mut next = 0;
        for (i, place) in run.iter().enumerate() {
            if let Some(at) = route.iter().position(|known| known == place) {
                next = at + 1;
            } else {
                // Before anything known of this run, the place stands before what comes next.
                if i == 0 || !route.contains(&run[i - 1]) {
                    let mut later = run[i + 1..].iter();
                    let known = later.find_map(|it| route.iter().position(|known| known == it));
                    next = known.unwrap_or(route.len());
                }
                route.insert(next, place);
                next += 1;
            }
        }
    }
    route
}

/// `entries`, in order of time, cut where the robot paused.
pub(crate) fn ways(dataset: &Dataset, entries: &[usize]) -> Vec<Vec<usize>> {
    let mut entries = entries.to_vec();
    entries.sort_unstable();
    let most_s = longest_step_s(dataset, &entries);
    let is_step = |from: &usize, to: &usize| gap_s(dataset, &[*from, *to]) <= most_s;
    entries.chunk_by(is_step).map(<[usize]>::to_vec).collect()
}

/// A longer time between two of `entries` is a pause: ten times what is usual.
fn longest_step_s(dataset: &Dataset, entries: &[usize]) -> f64 {
    let gaps = entries.windows(2).map(|pair| gap_s(dataset, pair));
    let mut gaps_s: Vec<f64> = gaps.filter(|gap_s| *gap_s > 0.0).collect();
    gaps_s.sort_unstable_by(f64::total_cmp);
    (gaps_s.get(gaps_s.len() / 2)).map_or(f64::INFINITY, |usual_s| 10.0 * usual_s)
}

fn gap_s(dataset: &Dataset, pair: &[usize]) -> f64 {
    let time = |entry: usize| dataset.entries[entry].time;
    time(pair[1]).since_s(time(pair[0]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use chronotope::Time;
    use chronotope::dataset::{Clock, Entry, FileImage};
    use chronotope::map::Edge;
    use std::sync::Arc;

    fn key(name: &str) -> PlaceKey {
        PlaceKey::new(name).unwrap()
    }

    /// Entries `(place, second)`.
    fn dataset(visits: &[(&str, i64)]) -> Dataset {
        let mut entries: Vec<Entry> = (visits.iter())
            .map(|&(place, second)| Entry {
                place: key(place),
                time: Time::from_s(second),
                id: format!("{place}@{second}"),
                source: Arc::new(FileImage::new("none.png")),
            })
            .collect();
        entries.sort_by(|a, b| (a.time, &a.place).cmp(&(b.time, &b.place)));
        Dataset {
            name: "walk".into(),
            clock: Clock::Real,
            zone: None,
            entries,
            edges: Vec::new(),
            poses: BTreeMap::new(),
            problems: Vec::new(),
            image_size: None,
        }
    }

    fn all(dataset: &Dataset) -> Vec<usize> {
        (0..dataset.entries.len()).collect()
    }

    fn names(places: &[&PlaceKey]) -> Vec<String> {
        places.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn the_route_is_the_order_of_the_fullest_run_with_what_it_missed_in_between() {
        // The first run misses c, stands at b for two images; the second misses z and a.
        let data = dataset(&[
            ("z", 0),
            ("b", 1),
            ("b", 2),
            ("a", 3),
            ("d", 4),
            ("b", 100),
            ("c", 101),
            ("d", 103),
        ]);
        assert_eq!(names(&route(&data, &all(&data))), ["z", "b", "c", "a", "d"]);
        let same_time = dataset(&[("b", 0), ("a", 0), ("c", 0), ("a", 9), ("b", 9), ("c", 9)]);
        let by_name = route(&same_time, &all(&same_time));
        assert_eq!(names(&by_name), ["a", "b", "c"]);
        let before = dataset(&[("b", 0), ("c", 1), ("d", 2), ("a", 99), ("b", 100)]);
        let before = route(&before, &all(&before));
        assert_eq!(names(&before), ["a", "b", "c", "d"]);
    }

    #[test]
    fn a_way_ends_at_a_pause() {
        let data = dataset(&[
            ("a", 0),
            ("b", 1),
            ("c", 2),
            ("c", 3),
            ("a", 100),
            ("b", 102),
        ]);
        assert_eq!(ways(&data, &all(&data)), [vec![0, 1, 2, 3], vec![4, 5]]);
        assert_eq!(ways(&data, &[5, 0, 1, 2]), [vec![0, 1, 2], vec![5]]);
        assert_eq!(ways(&data, &[2]), [[2]]);
        assert!(ways(&data, &[]).is_empty());
    }

    #[test]
    fn places_edges_and_metres_measure_what_is_near() {
        let mut data = dataset(&[("a", 0), ("b", 1), ("c", 2), ("d", 3), ("e", 4)]);
        let near = |data: &Dataset, tolerance: &str, place: &str| {
            let tolerance = Some(tolerance.parse().unwrap());
            let learn = all(data);
            let nearness = Nearness::new(data, &learn, tolerance).unwrap();
            let key = key(place);
            let place = data.entries.iter().find(|entry| entry.place == key);
            nearness.near(&place.unwrap().place)
        };
        assert_eq!(near(&data, "places:1", "a"), ["b"]);
        assert_eq!(near(&data, "places:2", "c"), ["a", "b", "d", "e"]);
        assert!(near(&data, "places:0", "c").is_empty());
        let error = |data: &Dataset, tolerance: &str| {
            let tolerance = Some(tolerance.parse().unwrap());
            let failed = Nearness::new(data, &all(data), tolerance).err().unwrap();
            failed.to_string()
        };
        assert!(error(&data, "edges:1").contains("edges.csv"));
        assert!(error(&data, "metres:1").contains("poses.csv"));
        for (from, to) in [("a", "e"), ("e", "b")] {
            data.edges.push(Edge {
                from: key(from),
                to: key(to),
                name: String::new(),
            });
        }
        assert_eq!(near(&data, "edges:1", "e"), ["a", "b"]);
        assert_eq!(near(&data, "edges:2", "b"), ["a", "e"]);
        for (i, place) in ["a", "b", "c", "d"].into_iter().enumerate() {
            data.poses.insert(key(place), [i as f64, 0.0, 0.0]);
        }
        assert_eq!(near(&data, "metres:1", "b"), ["a", "c"]);
        assert!(near(&data, "metres:9", "e").is_empty(), "it has no pose");
    }

    #[test]
    fn a_place_that_was_not_learnt_has_a_truth_only_by_its_pose() {
        let mut data = dataset(&[("a", 0), ("b", 1), ("q", 9)]);
        let places = [("a", 0.0), ("b", 10.0), ("q", 8.0)];
        for (place, x) in places {
            data.poses.insert(key(place), [x, 0.0, 0.0]);
        }
        let truth = |tolerance: &str| {
            let nearness = Nearness::new(&data, &[0, 1], Some(tolerance.parse().unwrap())).unwrap();
            let place = &data.entries[2].place;
            let truth = nearness.truth(place).map(ToString::to_string);
            (truth, nearness.near(place))
        };
        assert_eq!(truth("places:1"), (None, Vec::new()));
        assert_eq!(truth("metres:1"), (None, Vec::new()));
        assert_eq!(truth("metres:3"), (Some("b".into()), Vec::new()));
        assert_eq!(truth("metres:8"), (Some("b".into()), vec!["a".to_owned()]));
    }
}
