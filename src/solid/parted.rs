//! What the walls part: whether a body is sealed, and where it is not.

use super::sign::{Patch, Sights, Signed};

/// What the walls part: the occupied cells that have free cells on both sides, on the level that the field was found on.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Parted {
    /// How many there are.
    pub walls: u64,
    /// How many are double ([`Signed::doubles`]).
    pub doubles: u64,
    /// How many have the inside on both sides, or the outside.
    pub part_nothing: u64,
    /// Cells of membranes, where inside and outside meet and no wall is near: what holes are closed with.
    pub membranes: u64,
    /// Patches with the outside on both sides, the largest first.
    pub open: Vec<PartingNothing>,
    /// Patches with the inside on both sides, the largest first.
    pub filled: Vec<PartingNothing>,
    /// Occupied cells left out as outliers.
    pub outliers: u64,
    /// What lines of sight said, if any is known.
    pub sighted: Option<Sighted>,
    /// The side of that level's cells, in cells of the grid, if they are too wide for slots, fins or shells.
    pub too_wide: Option<u32>,
}

/// What lines of sight said.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub struct Sighted {
    /// Places that points were scanned from.
    pub places: usize,
    /// The part of the box's cells that lines of sight go through, so that they are outside.
    pub emptied: f64,
}

/// A patch of walls that part nothing.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PartingNothing {
    /// Number of its walls.
    pub walls: u64,
    /// Its box, in cells of the grid.
    pub cells: [[f64; 3]; 2],
}

/// A body is not sealed if one wall in so many parts nothing.
pub(super) const SEALED: u64 = 50;

impl Parted {
    /// What the walls of a level part whose cells are taken together by `factor`.
    pub(super) fn of(signed: &Signed, factor: u32, sights: Option<&Sights<'_>>) -> Parted {
        let patch = |patch: &Patch| {
            let [low, high] = patch.cells;
            let scale = f64::from(factor);
            PartingNothing {
                walls: patch.walls,
                cells: [low.map(|c| c as f64 * scale), high.map(|c| (c + 1) as f64 * scale)],
            }
        };
        let cells: u64 = signed.block.cells.into_iter().map(u64::from).product();
        let emptied = signed.emptied as f64 / cells as f64;
        let sighted = sights.map(|sights| Sighted { places: sights.places(), emptied });
        Parted {
            walls: signed.walls,
            doubles: signed.doubles,
            part_nothing: signed.part_nothing,
            membranes: signed.membranes,
            open: signed.open.iter().map(patch).collect(),
            filled: signed.filled.iter().map(patch).collect(),
            outliers: 0,
            sighted,
            too_wide: None,
        }
    }

    /// The part of the border between inside and outside that is membranes, on that level.
    pub fn spanned(&self) -> f64 {
        self.membranes as f64 / (self.walls + self.membranes).max(1) as f64
    }

    /// Whether the level's cells tell the surface's walls apart: fewer than half of the walls are double.
    pub fn is_resolved(&self) -> bool {
        2 * self.doubles < self.walls
    }

    /// Whether the mesh encloses the inside: the samples part inside and outside everywhere. No patch of walls has the same side on both of its
    /// sides, and of all walls less than two in a hundred have.
    pub fn is_sealed(&self) -> bool {
        self.open.is_empty() && self.filled.is_empty() && SEALED * self.part_nothing < self.walls
    }
}
