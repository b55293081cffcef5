//! The surface at rest has no intersecting triangles: what retreat goes back to.

use crate::twin::intersect::pairs;
use crate::twin::{Diagonals, mesh_of_solid};
use asra_stream::internals::mesh::intersect::intersect;

/// Numbers that look random and are the same in every run.
struct Numbers(u64);

impl Numbers {
    fn below(&mut self, limit: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 33) % limit
    }
}

/// The pairs that intersect with any of the diagonals, with positions off by up to `error` cells along each axis.
fn intersections(solid: &[bool], cells: [u32; 3], error: f64, numbers: &mut Numbers) -> usize {
    let mut count = 0;
    for diagonals in [Diagonals::Delaunay, Diagonals::First, Diagonals::Random] {
        let surface = mesh_of_solid(solid, cells, 1, diagonals);
        let mut off = |x: f64| x + error * (numbers.below(2001) as f64 / 1000.0 - 1.0);
        let places: Vec<[f64; 3]> = surface.rest.iter().map(|p| p.map(&mut off)).collect();
        let corners: Vec<[[f64; 3]; 3]> = surface.triangles.iter().map(|t| t.map(|v| places[v as usize])).collect();
        for (i, (&a, &pa)) in surface.triangles.iter().zip(&corners).enumerate() {
            for (&b, &pb) in surface.triangles[..i].iter().zip(&corners) {
                let apart = |m: usize| {
                    pa.iter().all(|p| pb.iter().all(|q| p[m] < q[m]))
                        || pa.iter().all(|p| pb.iter().all(|q| p[m] > q[m]))
                };
                count += usize::from(!(0..3).any(apart) && intersect(a, pa, b, pb));
            }
        }
    }
    count
}

/// The library's predicate and the twin's agree on pairs of triangles that touch and overlap in every way: corners on a small lattice.
#[test]
fn both_predicates_agree_on_lattice_triangles() {
    let mut numbers = Numbers(3);
    let mut met = 0;
    for round in 0..20_000 {
        let size = 2 + round % 3;
        let places: Vec<[f64; 3]> = (0..6).map(|_| [0; 3].map(|_: i32| numbers.below(size) as f64)).collect();
        let (a, b) = match round % 4 {
            0 => ([0, 1, 2], [2, 1, 3]),
            1 => ([0, 1, 2], [3, 0, 4]),
            _ => ([0, 1, 2], [3, 4, 5]),
        };
        let at = |v: u32| places[v as usize];
        let ours = intersect(a, a.map(at), b, b.map(at));
        assert_eq!(ours, !pairs(&[a, b], &at).is_empty(), "{a:?} {b:?} {places:?}");
        met += usize::from(ours);
    }
    assert!((2_000..18_000).contains(&met), "{met} of them intersect: one side is hardly tested");
}

#[test]
fn every_block_of_eight_cells_is_free_at_rest() {
    let mut numbers = Numbers(1);
    for mask in 0..256u32 {
        let solid: Vec<bool> = (0..8).map(|bit| mask >> bit & 1 == 1).collect();
        assert_eq!(intersections(&solid, [2; 3], 0.0, &mut numbers), 0, "mask {mask}");
    }
}

/// Noise of every density: all that can meet at two rectangles near each other does somewhere. The error is what rounding may do to positions.
#[test]
fn random_solids_are_free_at_rest_and_a_hundredth_of_a_cell_off_it() {
    let mut numbers = Numbers(2);
    for round in 0..400 {
        let n = 3 + round % 3;
        let share = 10 + numbers.below(81);
        let solid: Vec<bool> = (0..n * n * n).map(|_| numbers.below(100) < share).collect();
        for error in [0.0, 0.01] {
            let count = intersections(&solid, [n; 3], error, &mut numbers);
            assert_eq!(count, 0, "round {round}, error {error}, {solid:?}");
        }
    }
}
