//! What speaks for each place, pair by pair of features that resemble each other?

use crate::matching::VoteConfig;

/// Memory that votes are counted in.
#[derive(Clone, Debug, Default)]
pub(super) struct Tally {
    /// The nearest live feature to each row; [`Nearest::NONE`] between searches.
    pub(super) nearest: Vec<Nearest>,
    /// Rows that have one.
    pub(super) rows: Vec<u32>,
    /// What speaks for each place.
    pub(super) votes: Vec<(f32, u32)>,
    /// Where the shifts of each place end.
    pub(super) ends: Vec<u32>,
    pub(super) shifts: Vec<Shift>,
    pub(super) plane: Plane,
}

/// A live feature and its distance in bits; the nearer is the less.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Nearest {
    pub(super) bits: u16,
    pub(super) live: u32,
}

impl Nearest {
    pub(super) const NONE: Self = Self {
        bits: u16::MAX,
        live: u32::MAX,
    };
}

/// A pair, as the cell of the plane of displacements that it falls into and what it is worth there.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Shift {
    cell: u16,
    worth: f32,
}

/// Columns and rows of the plane of displacements. It is a torus: what lies a whole turn apart is
/// taken for the same, which adds noise and loses nothing.
const COLUMNS: u16 = 128;
const ROWS: u16 = 64;

/// Displacements in cells of half a window, so that two by two of them are one.
#[derive(Clone, Debug, Default)]
pub(super) struct Plane {
    /// What each cell is worth; all 0 between places.
    worth: Vec<f32>,
}

/// How displacements become cells.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cells {
    per_px: [f32; 2],
}

impl Cells {
    pub(super) fn of(window: &VoteConfig) -> Self {
        let per_px = |px: f64| 2.0 / px.max(1.0) as f32;
        Self {
            per_px: [per_px(window.width_px()), per_px(window.height_px())],
        }
    }

    /// The pair that is displaced by (`dx`, `dy`) px.
    pub(super) fn shift(self, dx: f32, dy: f32, worth: f32) -> Shift {
        let [x, y] = self.per_px;
        let column = (dx * x).floor() as i32 as u16 % COLUMNS;
        let row = (dy * y).floor() as i32 as u16 % ROWS;
        Shift {
            cell: row * COLUMNS + column,
            worth,
        }
    }
}

impl Plane {
    /// The most that the shifts in one window of two by two cells are worth; at least 0, as nothing
    /// is.
    pub(super) fn most(&mut self, shifts: &[Shift]) -> f32 {
        let Self { worth } = self;
        worth.resize(usize::from(COLUMNS) * usize::from(ROWS), 0.0);
        for shift in shifts {
            worth[usize::from(shift.cell)] += shift.worth;
        }
        let mut most = 0.0_f32;
        for shift in shifts {
            let (row, column) = (shift.cell / COLUMNS, shift.cell % COLUMNS);
            let rows = [row, (row + 1) % ROWS].map(|row| usize::from(row * COLUMNS));
            let [left, middle, right] = [column + COLUMNS - 1, column, column + 1].map(|column| {
                let column = usize::from(column % COLUMNS);
                worth[rows[0] + column] + worth[rows[1] + column]
            });
            // Any other window of two by two with this cell is one of another cell's two.
            most = most.max(left.max(right) + middle);
        }
        for shift in shifts {
            worth[usize::from(shift.cell)] = 0.0;
        }
        most
    }
}

/// Leaves the `count` places that most speaks for, ties by the lowest place.
pub(super) fn keep_best(votes: &mut Vec<(f32, u32)>, count: usize) {
    if count < votes.len() {
        votes.select_nth_unstable_by(count, |a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        votes.truncate(count);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_window_that_is_worth_most_counts_wherever_it_is() {
        let cells = Cells::of(&VoteConfig::default());
        let mut plane = Plane::default();
        let mut most = |pairs: &[(f32, f32, f32)]| {
            let shifts: Vec<Shift> = (pairs.iter())
                .map(|&(dx, dy, worth)| cells.shift(dx, dy, worth))
                .collect();
            plane.most(&shifts)
        };
        assert_eq!(most(&[]), 0.0);
        assert_eq!(most(&[(-5.0, 5.0, 2.0)]), 2.0);
        assert_eq!(most(&[(-5.0, 5.0, -2.0)]), 0.0, "nothing is better");
        // Half a window apart they agree, whichever cells that cuts; 300 px away they do not.
        for (x, y) in [(0.0, 0.0), (-13.0, 7.0), (219.0, -191.0)] {
            for (dx, dy) in [(15.0, 8.0), (-15.0, 8.0), (15.0, -8.0), (-15.0, -8.0)] {
                let pairs = [
                    (x, y, 1.0),
                    (x + dx, y + dy, 2.0),
                    (x + 300.0, y, 2.5),
                    (x, y + 100.0, 2.5),
                ];
                assert_eq!(most(&pairs), 3.0, "at {x}, {y} with {dx}, {dy}");
            }
        }
    }
}
