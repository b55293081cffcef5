//! What the ground filter goes by.

/// What the filter goes by. Lengths are in the unit of the coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroundOptions {
    /// The side of a cell.
    pub cell: f64,
    /// The largest window's radius, in cells: half the width of the widest building that is told from the ground.
    pub window: u32,
    /// The steepest ground, as rise over run.
    pub slope: f64,
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
            window: 18,
            slope: 0.15,
            pit: 5.0 * metre,
            near: 0.3 * metre,
            scaling: 0.6 * metre,
        }
    }
}
