//! The naive twin: the whole reconstruction in memory, written for obviousness from `docs/algorithm.md` cut_off.
//!
//! It shares no code with the crate. Everything is dense or a map, every definition is applied as it reads, nothing is
//! looked up in a table; a cloud of some hundred points in a dozen slices is what it is for. The streaming
//! implementation must give the same mesh: vertex for vertex, triangle for triangle, bit for bit.
//!
//! Arithmetic that shows in the bits, as the twin does it:
//!
//! * smoothing sums (eᵢ + dᵢ) from 0.0 in the order of the edges, then (d + sum) / (r + 1), or d + f·(sum / r − d); where one sheet turns round
//!   an edge twice, the turn of the solid cell with d_b = 0 is summed first;
//! * q' = corner + d, T = min + w·q', both after smoothing has ended;
//! * points at equal distance: the first by (x, y, z), −0 before 0.

pub mod check;
pub mod clouds;
pub mod contract;
pub mod corner;
pub mod creases;
pub mod diagonals;
pub mod facets;
pub mod fit;
pub mod flips;
pub mod grid;
pub mod ground;
pub mod intersect;
pub mod retreat;
pub mod shell;
pub mod sides;
pub mod solid;
pub mod sphere;
pub mod surface;

pub use grid::{Axis, grid_for};
pub use ground::{Ground, Open};
pub use surface::{Diagonals, Surface};

use solid::Cells;

/// Which components of the solid are kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Keep {
    /// Those of so many cells.
    Cells(u64),
    /// Those of this share of the largest's cells.
    Share(f64),
    /// The largest.
    Largest,
}

/// What vertices are moved onto.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fit {
    /// Spheres where the shell of points is noise, else facets.
    Auto,
    /// The same, but the nearest points instead of facets.
    AutoPoints,
    /// So far from their nearest points that facets pass amid the points.
    Facets,
    /// Their nearest points.
    Nearest,
    /// The spheres of the points round them.
    Sphere,
    /// Nothing.
    None,
}

/// What a reconstruction depends on beside the points.
#[derive(Debug, Clone)]
pub struct Params {
    /// The slicing axis.
    pub axis: Axis,
    /// The axes of a grid that is turned; else they are the file's.
    pub turn: Option<[[f64; 3]; 3]>,
    /// Lower end of the box, in the file's axes, or the turned ones.
    pub min: [f64; 3],
    /// Cell size.
    pub w: f64,
    /// Number of cells along the grid's axes.
    pub cells: [u32; 3],
    /// Along the grid's axes: the planes left out of wide gaps, from the first of each to the one after its last, all planes counted.
    pub folds: [Vec<[u32; 2]>; 3],
    /// Points that make a cell occupied, at least.
    pub min_points: u32,
    /// Which components are kept, if not all.
    pub keep: Option<Keep>,
    /// Closing radius, at least 1, in cells of the pyramid's level `level`.
    pub rho: u32,
    /// Level of the pyramid whose sides the ball of radius `rho` tells apart; 0 is the grid.
    pub level: u32,
    /// Whether the ball falls from there; if not, `level` is 0.
    pub falls: bool,
    /// Smoothing steps.
    pub smooth: u32,
    /// How faces are cut.
    pub diagonals: Diagonals,
    /// What vertices are moved onto.
    pub fit: Fit,
    /// What is asked of a surface that is not closed.
    pub open: Option<ground::Open>,
    /// Slices of a slab, at least 1.
    pub slab_slices: u32,
    /// Taken off every position when it is written.
    pub origin: [f64; 3],
    /// Whether the points are `f32`: then the final vertices are rounded to `f32`.
    pub single: bool,
}

impl Params {
    /// A closed surface on a grid, of points in double precision: radius 1, one step of smoothing, vertices on their nearest points.
    pub fn of_grid((axis, min, w, cells): (Axis, [f64; 3], f64, [u32; 3]), slab_slices: u32) -> Params {
        Params {
            axis,
            min,
            w,
            cells,
            min_points: 1,
            keep: None,
            turn: None,
            folds: Default::default(),
            open: None,
            rho: 1,
            level: 0,
            falls: false,
            smooth: 1,
            diagonals: Diagonals::Delaunay,
            fit: Fit::Nearest,
            slab_slices,
            origin: [0.0; 3],
            single: false,
        }
    }
}

/// The finished mesh as it is written: in the file's axes, less the origin.
#[derive(Debug, Clone, PartialEq)]
pub struct TwinMesh {
    /// Positions.
    pub vertices: Vec<[f64; 3]>,
    /// Triangles, counter-clockwise seen from outside.
    pub faces: Vec<[u32; 3]>,
}

impl TwinMesh {
    /// The positions' bits, for a comparison that tells −0 from 0.
    pub fn bits(&self) -> Vec<[u64; 3]> {
        self.vertices.iter().map(|p| p.map(f64::to_bits)).collect()
    }
}

/// The whole way from points to mesh.
pub fn reconstruct(points: &[[f64; 3]], params: &Params) -> TwinMesh {
    if let Some(open) = params.open {
        let ground = Ground::of(points, &solid::occupied(points, params), open, params);
        let solid = ground.solid();
        let mut surface = surface::surface(&solid, params.smooth, params.diagonals);
        surface.leave_out(|face| !ground.makes(face));
        surface.kept = surface.faces.iter().map(|face| ground.keeps(face)).collect();
        for v in 0..surface.positions.len() {
            surface.cut_off[v] = surface.corners[v].is_some_and(|corner| !ground.makes_all_round(corner));
            if let Some(corner) = surface.corners[v]
                && let Some((height, bridged)) = ground.level(corner, surface.positions[v])
            {
                surface.positions[v][open.up] = height;
                surface.bridged[v] = bridged;
            }
        }
        return finish(&surface, &solid::counted(points, &solid, params), params);
    }
    let solid = solid::solid_cells(points, params);
    let surface = surface::surface(&solid, params.smooth, params.diagonals);
    finish(&surface, &solid::counted(points, &solid, params), params)
}

/// Moves the vertices onto what they are to be moved onto.
fn finish(surface: &Surface, points: &[[f64; 3]], params: &Params) -> TwinMesh {
    let fit = match params.fit {
        Fit::Auto | Fit::AutoPoints => {
            let noisy = shell::shell(points, &surface.solid, params).is_some_and(shell::is_noisy);
            if noisy {
                Fit::Sphere
            } else if params.fit == Fit::Auto {
                Fit::Facets
            } else {
                Fit::Nearest
            }
        }
        given => given,
    };
    fit::finish(surface, points, &Params { fit, ..params.clone() })
}

/// The solid cells: cell (x, y, z) at `x + cells_x · (z + cells_z · y)`.
pub fn solid(points: &[[f64; 3]], params: &Params) -> Vec<bool> {
    solid::solid_cells(points, params).is
}

/// The surface of given solid cells (indexed like [`solid`]), unfitted, in cells along the grid's axes.
pub fn mesh_of_solid(solid: &[bool], cells: [u32; 3], smooth: u32, diagonals: Diagonals) -> Surface {
    let solid = Cells { cells, pad: 0, is: solid.to_vec() };
    surface::surface(&solid, smooth, diagonals)
}
