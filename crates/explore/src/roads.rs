//! How long does it take from one place to another?

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use fremen::{Error, ErrorKind, Result};

/// The shortest travel times between all places of a topological graph.
#[derive(Clone, Debug, PartialEq)]
pub struct Roads {
    num_places: usize,
    /// Row by row; infinite where there is no way.
    travel_s: Vec<f64>,
}

/// More seconds than this are taken for a mistake: ten days.
const MAX_S: f64 = 864_000.0;

impl Roads {
    /// Of `num_places` places and links that lead both ways, with their travel times in seconds.
    /// Several links may join the same places; places without any are islands.
    ///
    /// Fails for a time that is negative, no number or longer than ten days, and for a link to a
    /// place that is not there. O(links log places) for each place.
    pub fn new(num_places: usize, links: &[(usize, usize, f64)]) -> Result<Self> {
        let mut neighbours = vec![Vec::new(); num_places];
        for &(a, b, travel_s) in links {
            if let Some(missing) = [a, b].into_iter().find(|&place| place >= num_places) {
                return Err(Error::new(
                    ErrorKind::NotFound,
                    format!("a link leads to place {missing} of {num_places}"),
                ));
            }
            if !(0.0..=MAX_S).contains(&travel_s) {
                return Err(
                    Error::new(ErrorKind::Config, format!("a link takes {travel_s} s"))
                        .with_help("travel times are seconds from 0 to ten days"),
                );
            }
            // Whole milliseconds, so that the shortest way does not depend on the order of links.
            let travel_ms = (travel_s * 1e3).round() as u64;
            neighbours[a].push((b, travel_ms));
            neighbours[b].push((a, travel_ms));
        }
        let mut travel_s = Vec::with_capacity(num_places * num_places);
        for from in 0..num_places {
            let ways = shortest(&neighbours, from);
            travel_s.extend(ways.iter().map(|ms| match ms {
                Some(ms) => *ms as f64 / 1e3,
                None => f64::INFINITY,
            }));
        }
        Ok(Self {
            num_places,
            travel_s,
        })
    }

    /// Places that are all at one spot.
    pub fn none(num_places: usize) -> Self {
        Self {
            num_places,
            travel_s: vec![0.0; num_places * num_places],
        }
    }

    /// From a text of lines `node NAME` and `link NAME NAME SECONDS` (blank lines and lines that
    /// begin with `#` say nothing), for the places `names` in this order. Nodes that are no such
    /// place are on the way only.
    ///
    /// Fails with the line that cannot be read, or that has a link to a node that is not named.
    pub fn parse(text: &str, names: &[&str]) -> Result<Self> {
        let mut nodes: Vec<&str> = names.to_vec();
        let mut links = Vec::new();
        for (number, line) in text.lines().enumerate() {
            let words: Vec<&str> = line.split_whitespace().collect();
            let bad = |message: String| {
                Error::new(ErrorKind::Format, message)
                    .with_place(format!("line {}", number + 1))
                    .with_help("lines are `node NAME` or `link NAME NAME SECONDS`")
            };
            match words[..] {
                [] => {}
                [first, ..] if first.starts_with('#') => {}
                ["node", name] => {
                    if !nodes.contains(&name) {
                        nodes.push(name);
                    }
                }
                ["link", a, b, seconds] => {
                    let node = |name: &str| {
                        let found = nodes.iter().position(|node| *node == name);
                        found.ok_or_else(|| bad(format!("there is no node `{name}`")))
                    };
                    let seconds: f64 = (seconds.parse())
                        .map_err(|_| bad(format!("`{seconds}` is no number of seconds")))?;
                    links.push((node(a)?, node(b)?, seconds));
                }
                _ => return Err(bad(format!("`{}` is no node and no link", line.trim()))),
            }
        }
        Self::among(names.len(), nodes.len(), &links)
    }

    /// Of the first `num_places` of `num_nodes` nodes; all others are on the way only.
    ///
    /// Fails as [`new`](Self::new) does, and if there are fewer nodes than places.
    pub fn among(
        num_places: usize,
        num_nodes: usize,
        links: &[(usize, usize, f64)],
    ) -> Result<Self> {
        if num_nodes < num_places {
            let message = format!("{num_places} places among {num_nodes} nodes");
            return Err(Error::new(ErrorKind::Shape, message));
        }
        let all = Self::new(num_nodes, links)?;
        let travel_s = (0..num_places)
            .flat_map(|from| (0..num_places).map(move |to| (from, to)))
            .map(|(from, to)| all.travel_s(from, to).unwrap_or(f64::INFINITY))
            .collect();
        Ok(Self {
            num_places,
            travel_s,
        })
    }

    /// Places.
    pub fn num_places(&self) -> usize {
        self.num_places
    }

    /// Seconds from one place to another; `None` if there is no way.
    ///
    /// # Panics
    /// If there is no such place.
    pub fn travel_s(&self, from: usize, to: usize) -> Option<f64> {
        assert!(from < self.num_places && to < self.num_places, "no place");
        let travel_s = self.travel_s[from * self.num_places + to];
        travel_s.is_finite().then_some(travel_s)
    }
}

/// The shortest ways from a node, in milliseconds (Dijkstra).
fn shortest(neighbours: &[Vec<(usize, u64)>], from: usize) -> Vec<Option<u64>> {
    let mut ways = vec![None; neighbours.len()];
    let mut queue = BinaryHeap::from([Reverse((0, from))]);
    while let Some(Reverse((ms, node))) = queue.pop() {
        if ways[node].is_some() {
            continue;
        }
        ways[node] = Some(ms);
        for &(next, more_ms) in &neighbours[node] {
            if ways[next].is_none() {
                queue.push(Reverse((ms + more_ms, next)));
            }
        }
    }
    ways
}
