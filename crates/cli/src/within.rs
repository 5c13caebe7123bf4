//! How near to the first place must the others be that an answer leaves open?

use std::str::FromStr;

use chronotope::localize::Localizer;
use chronotope::map::NodeId;

/// A distance between places.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Within {
    /// So many edges; where the map has none, so many steps of the way that it was learnt on.
    Edges(usize),
    /// So many metres between the poses of places.
    Metres(f64),
}

impl FromStr for Within {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("`{text}` is no distance: write edges:1 or metres:2.5");
        let (kind, number) = text.split_once(':').ok_or_else(wrong)?;
        match kind {
            "edges" => number.parse().map(Self::Edges).map_err(|_| wrong()),
            "metres" => match number.parse() {
                Ok(metres) if (0.0..f64::INFINITY).contains(&metres) => Ok(Self::Metres(metres)),
                _ => Err(wrong()),
            },
            _ => Err(wrong()),
        }
    }
}

impl Within {
    /// Whether every place of `region` is so near the first one; a place without a pose is not.
    pub(crate) fn holds(self, localizer: &Localizer, region: &[NodeId]) -> bool {
        let Some((&first, others)) = region.split_first() else {
            return false;
        };
        let pose = |node: NodeId| localizer.snapshot().node(node).pose();
        others.iter().all(|&other| match self {
            Self::Edges(most) => localizer.steps_between(first, other, most).is_some(),
            Self::Metres(most) => (pose(first).zip(pose(other)))
                .is_some_and(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]) <= most),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_read_and_nonsense_is_named() {
        assert_eq!("edges:2".parse(), Ok(Within::Edges(2)));
        assert_eq!("metres:1.5".parse(), Ok(Within::Metres(1.5)));
        for text in [
            "edges",
            "edges:-1",
            "metres:nan",
            "metres:-1",
            "miles:1",
            "",
        ] {
            let error = text.parse::<Within>().expect_err("nonsense");
            assert!(error.contains("edges:1"), "{error}");
        }
    }
}
