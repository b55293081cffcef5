//! What the ground filter goes by.

/// What the filter goes by. Lengths are in the unit of the coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroundOptions {
    /// The side of a cell.
    pub cell: f64,
    /// The largest window's radius, in cells: half the width of the widest building that is told from the ground.
    pub window: u32,
    /// Half the width, in cells, of the widest hole that is filled before windows look for objects.
    pub hole: u32,
    /// The steepest ground, as rise over run.
    pub slope: f64,
    /// The highest step that ground can have from one window to the next, whatever the window: a storey.
    pub storey: f64,
    /// A cell lies in a pit if it is so far below all its neighbours: a stray point below the ground.
    pub pit: f64,
    /// How far from the ground's height a point on level ground may lie.
    pub near: f64,
    /// How much farther it may lie where the ground rises by its own length.
    pub scaling: f64,
}

impl GroundOptions {
    /// The usual ones, where a metre has so many units.
    pub fn usual(metre: f64) -> GroundOptions {
        GroundOptions {
            cell: metre,
            window: 40,
            hole: 18,
            slope: 0.15,
            storey: 2.7 * metre,
            pit: 5.0 * metre,
            near: 0.3 * metre,
            scaling: 0.6 * metre,
        }
    }
}
