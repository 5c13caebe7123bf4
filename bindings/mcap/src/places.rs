//! Which place does an image of a bag show?
//!
//! Nobody labels bags by hand, so places come from what else was recorded: poses, a topic that names
//! the place, or a table of times. From poses, places are founded on the way: a pose belongs to the
//! nearest place within the radius that looks in about the same direction, and founds a new one
//! where there is none; images are labelled once all places are founded. So the same bag gives the same places, and a later bag in the same frame
//! finds the places that a map has already.
//!
//! A founded place is called by its number and, where headings count, by the direction it looks in:
//! `0007@090` is the seventh place, looking along the y axis. Consecutive places are joined by an
//! edge in the direction of travel.

use std::collections::{BTreeSet, HashMap};

use chronotope::error::{Error, ErrorKind, Result};
use chronotope::map::{Edge, PlaceKey, Snapshot};
use chronotope::time::Time;

use crate::track::{Placement, wrapped};

/// Travel is not followed over a longer pause, s.
const MAX_PAUSE_S: f64 = 30.0;

/// When poses belong to one place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vicinity {
    radius_m: f64,
    heading_deg: f64,
}

impl Default for Vicinity {
    /// 2 m, 45 degrees to either side.
    fn default() -> Self {
        Self {
            radius_m: 2.0,
            heading_deg: 45.0,
        }
    }
}

impl Vicinity {
    /// Poses within `radius_m` metres and `heading_deg` degrees of where a place was founded; from
    /// 180 degrees on headings do not count.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Config`] if the radius is not positive or the angle is negative.
    pub fn new(radius_m: f64, heading_deg: f64) -> Result<Self> {
        if !(radius_m.is_finite() && radius_m > 0.0) {
            let message = format!("{radius_m} m is no radius of a place");
            return Err(Error::new(ErrorKind::Config, message).with_help("give a positive number"));
        }
        if heading_deg.is_nan() || heading_deg < 0.0 {
            let message = format!("{heading_deg} degrees are no tolerance of headings");
            return Err(Error::new(ErrorKind::Config, message)
                .with_help("give 0 to 180; 180 lets every direction be one place"));
        }
        Ok(Self {
            radius_m,
            heading_deg,
        })
    }

    fn counts_headings(&self) -> bool {
        self.heading_deg < 180.0
    }
}

/// A place that poses are compared with.
#[derive(Clone, Debug)]
struct Site {
    key: PlaceKey,
    placement: Placement,
}

/// The cell of a grid as fine as the radius.
type Cell = [i64; 3];

/// Founds places on the way.
#[derive(Debug)]
pub(crate) struct Founder {
    vicinity: Vicinity,
    sites: Vec<Site>,
    by_cell: HashMap<Cell, Vec<usize>>,
    next_number: usize,
}

impl Founder {
    /// Beginning with the places of a map that have poses, if there is one.
    pub(crate) fn new(vicinity: Vicinity, known: Option<&Snapshot>) -> Self {
        let mut founder = Self {
            vicinity,
            sites: Vec::new(),
            by_cell: HashMap::new(),
            next_number: 1,
        };
        for node in known.iter().flat_map(|snapshot| snapshot.nodes()) {
            let (number, heading) = parts_of(node.key().as_str());
            if let Some(number) = number {
                founder.next_number = founder.next_number.max(number + 1);
            }
            if let Some(position) = node.pose() {
                founder.add(Site {
                    key: node.key().clone(),
                    placement: Placement { position, heading },
                });
            }
        }
        founder
    }

    /// Founds the places of a way. The place of a pose is known once all are founded: another one,
    /// founded later, may be nearer.
    pub(crate) fn found(&mut self, way: &[Placement]) -> Result<()> {
        for seen in way {
            self.place(seen)?;
        }
        Ok(())
    }

    /// The place of a pose, which is founded where there is none. O(places within the radius).
    pub(crate) fn place(&mut self, seen: &Placement) -> Result<PlaceKey> {
        let [x, y, z] = self.cell(seen.position);
        let mut nearest: Option<(f64, usize)> = None;
        for cell in (0..27).map(|i| [x + i % 3 - 1, y + i / 3 % 3 - 1, z + i / 9 - 1]) {
            for &index in self.by_cell.get(&cell).into_iter().flatten() {
                let distance_m = distance(&self.sites[index].placement.position, &seen.position);
                let is_here = distance_m <= self.vicinity.radius_m && self.faces(index, seen);
                // Of equals the first.
                if is_here && nearest.is_none_or(|best| (distance_m, index) < best) {
                    nearest = Some((distance_m, index));
                }
            }
        }
        if let Some((_, index)) = nearest {
            return Ok(self.sites[index].key.clone());
        }
        let number = self.next_number;
        self.next_number += 1;
        let heading = seen.heading.filter(|_| self.vicinity.counts_headings());
        let name = match heading {
            Some(heading) => {
                let degrees = (heading.to_degrees().round() as i64).rem_euclid(360);
                format!("{number:04}@{degrees:03}")
            }
            None => format!("{number:04}"),
        };
        let key = PlaceKey::new(&name)?;
        // As its name says, so that who reads the map compares with the same.
        let (_, heading) = parts_of(&name);
        self.add(Site {
            key: key.clone(),
            placement: Placement {
                position: seen.position,
                heading,
            },
        });
        Ok(key)
    }

    /// Where the places are.
    pub(crate) fn poses(&self) -> impl Iterator<Item = (PlaceKey, [f64; 3])> + '_ {
        (self.sites.iter()).map(|site| (site.key.clone(), site.placement.position))
    }

    fn faces(&self, index: usize, seen: &Placement) -> bool {
        match (self.sites[index].placement.heading, seen.heading) {
            (Some(a), Some(b)) if self.vicinity.counts_headings() => {
                wrapped(b - a).abs() <= self.vicinity.heading_deg.to_radians()
            }
            _ => true,
        }
    }

    fn add(&mut self, site: Site) {
        let cell = self.cell(site.placement.position);
        let index = self.sites.len();
        self.by_cell.entry(cell).or_default().push(index);
        self.sites.push(site);
    }

    fn cell(&self, position: [f64; 3]) -> Cell {
        // Casts saturate; a step to the neighbours must not overflow.
        position.map(|it| ((it / self.vicinity.radius_m).floor() as i64).clamp(-1 << 60, 1 << 60))
    }
}

fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    let squares = (0..3).map(|i| (a[i] - b[i]).powi(2));
    squares.sum::<f64>().sqrt()
}

/// The number and the heading that the name of a founded place says.
fn parts_of(name: &str) -> (Option<usize>, Option<f64>) {
    let (number, degrees) = match name.split_once('@') {
        Some((number, degrees)) => (number, degrees.parse::<f64>().ok()),
        None => (name, None),
    };
    let heading = degrees.filter(|it| it.is_finite());
    (
        number.parse().ok(),
        heading.map(|it| wrapped(it.to_radians())),
    )
}

/// The ways between the places of images in the order of travel.
pub(crate) fn edges_of<'a>(
    visits: impl Iterator<Item = (Time, Option<&'a PlaceKey>)>,
) -> Vec<Edge> {
    let mut last: Option<(Time, &PlaceKey)> = None;
    let mut ways: BTreeSet<(&PlaceKey, &PlaceKey)> = BTreeSet::new();
    for (time, place) in visits {
        let Some(place) = place else {
            last = None;
            continue;
        };
        if let Some((before, from)) = last
            && from != place
            && time.since_s(before) <= MAX_PAUSE_S
        {
            ways.insert((from, place));
        }
        last = Some((time, place));
    }
    ways.into_iter()
        .map(|(from, to)| Edge {
            from: from.clone(),
            to: to.clone(),
            name: String::new(),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(x: f64, degrees: f64) -> Placement {
        Placement {
            position: [x, 0.0, 0.0],
            heading: Some(wrapped(degrees.to_radians())),
        }
    }

    fn names(founder: &mut Founder, way: &[Placement]) -> Result<Vec<String>> {
        (way.iter())
            .map(|it| Ok(founder.place(it)?.as_str().to_owned()))
            .collect()
    }

    #[test]
    fn a_way_there_and_back_founds_places_of_both_directions_once() -> Result<()> {
        let mut founder = Founder::new(Vicinity::new(1.0, 45.0)?, None);
        let there: Vec<_> = (0..6).map(|i| seen(f64::from(i) * 0.5, 0.0)).collect();
        let back: Vec<_> = (0..6)
            .rev()
            .map(|i| seen(f64::from(i) * 0.5, 180.0))
            .collect();
        founder.found(&there)?;
        founder.found(&back)?;
        let first = names(&mut founder, &there)?;
        // Nearer to the second one, which was founded when its radius was left.
        assert_eq!(first[..2], ["0001@000", "0001@000"]);
        assert_eq!(first[2..], ["0002@000"; 4]);
        let second = names(&mut founder, &back)?;
        assert_eq!([&*second[0], &*second[5]], ["0003@180", "0004@180"]);
        // Again the same, from whichever end.
        assert_eq!(names(&mut founder, &there)?, first);
        assert_eq!(names(&mut founder, &back)?, second);
        assert_eq!(founder.poses().count(), 4);
        Ok(())
    }

    #[test]
    fn without_headings_a_place_is_one_from_all_sides() -> Result<()> {
        let mut founder = Founder::new(Vicinity::new(1.0, 180.0)?, None);
        let way = [seen(0.0, 0.0), seen(0.5, 180.0), seen(-1.5, 90.0)];
        assert_eq!(names(&mut founder, &way)?, ["0001", "0001", "0002"]);
        assert!(Vicinity::new(0.0, 1.0).is_err() && Vicinity::new(1.0, f64::NAN).is_err());
        Ok(())
    }

    #[test]
    fn edges_follow_the_travel_and_stop_at_pauses() {
        let [a, b, c] = ["a", "b", "c"].map(|name| PlaceKey::new(name).expect("a name"));
        let visits = [
            (0, Some(&a)),
            (1, Some(&a)),
            (2, Some(&b)),
            (3, None),
            (4, Some(&c)),
            (5, Some(&b)),
            (99, Some(&a)),
        ];
        let edges = edges_of(
            visits
                .into_iter()
                .map(|(s, place)| (Time::from_s(s), place)),
        );
        let named: Vec<_> = (edges.iter())
            .map(|edge| (edge.from.as_str(), edge.to.as_str()))
            .collect();
        assert_eq!(named, [("a", "b"), ("c", "b")]);
    }
}
