//! The surface at rest has no intersecting triangles: what retreat goes back to.

mod twin;

use asra_stream::mesh::intersect::intersect;
use twin::{Diagonals, mesh_of_solid};

/// Numbers that look random and are the same in every run.
struct Numbers(u64);

impl Numbers {
    fn below(&mut self, limit: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 33) % limit
    }
}

/// The pairs that intersect, by the library's predicate; with positions off by up to `error` cells along each axis.
fn intersections(solid: &[bool], cells: [u32; 3], error: f64, numbers: &mut Numbers) -> usize {
    let mut count = 0;
    for diagonals in [Diagonals::Delaunay, Diagonals::First, Diagonals::Random] {
        let surface = mesh_of_solid(solid, cells, 1, diagonals);
        let mut off = |x: f64| x + error * (numbers.below(2001) as f64 / 1000.0 - 1.0);
        let places: Vec<[f64; 3]> = surface.rest.iter().map(|p| p.map(&mut off)).collect();
        for (i, &a) in surface.triangles.iter().enumerate() {
            for &b in &surface.triangles[..i] {
                let (pa, pb) = (a.map(|v| places[v as usize]), b.map(|v| places[v as usize]));
                let ends = |p: [[f64; 3]; 3], m: usize| {
                    (p.map(|q| q[m]).into_iter().fold(9e9, f64::min), p.map(|q| q[m]).into_iter().fold(-9e9, f64::max))
                };
                let apart = |m: usize| ends(pa, m).1 < ends(pb, m).0 || ends(pb, m).1 < ends(pa, m).0;
                let meet = !(0..3).any(apart) && intersect(a, pa, b, pb);
                count += usize::from(meet);
            }
        }
    }
    count
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
