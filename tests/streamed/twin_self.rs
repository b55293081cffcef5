//! The naive twin is sound by itself: what it makes is a closed, oriented 2-manifold, and counts are as known.

use std::collections::BTreeSet;

use crate::twin::check::{check, six_volumes};
use crate::twin::clouds::{Cloud, cloud, setting};
use crate::twin::fit::{Fitting, finish, slabs};
use crate::twin::solid::solid_cells;
use crate::twin::surface::surface;
use crate::twin::{Axis, Diagonals, Fit, Params, Surface, grid_for, mesh_of_solid, reconstruct};
use proptest::prelude::*;

const DIAGONALS: [Diagonals; 3] = [Diagonals::Delaunay, Diagonals::First, Diagonals::Random];

/// Numbers that look random and are the same in every run.
struct Numbers(u64);

impl Numbers {
    fn below(&mut self, limit: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 33) % limit
    }
}

fn assert_sound(surface: &Surface, context: &str) {
    check(surface.positions.len(), &surface.triangles).unwrap_or_else(|e| panic!("{context}: {e}"));
}

/// Parameters whose world is the grid itself: axis y, cells of size 1 from the origin.
fn unit_params(cells: [u32; 3], slab_slices: u32) -> Params {
    Params::of_grid((Axis::Y, [0.0; 3], 1.0, cells), slab_slices)
}

#[test]
fn every_block_of_eight_cells_is_sound() {
    for mask in 0..256u32 {
        let solid: Vec<bool> = (0..8).map(|bit| mask >> bit & 1 == 1).collect();
        for smooth in 0..=3 {
            for diagonals in DIAGONALS {
                let surface = mesh_of_solid(&solid, [2, 2, 2], smooth, diagonals);
                assert_sound(&surface, &format!("mask {mask} {smooth} {diagonals:?}"));
                if smooth == 0 {
                    // Two cells that touch along an edge have no doubled one in a block this small.
                    let volume = six_volumes(&surface.positions, &surface.triangles);
                    assert_eq!(volume, 6.0 * f64::from(mask.count_ones()), "volume of mask {mask}");
                }
            }
        }
    }
}

#[test]
fn random_solids_are_sound_and_enclose_their_volume() {
    let mut numbers = Numbers(1);
    let mut middles = 0;
    for round in 0..150 {
        let share = 10 + numbers.below(81);
        let solid: Vec<bool> = (0..64).map(|_| numbers.below(100) < share).collect();
        for smooth in 0..=3 {
            let diagonals = DIAGONALS[round % 3];
            let surface = mesh_of_solid(&solid, [4, 4, 4], smooth, diagonals);
            assert_sound(&surface, &format!("round {round} {smooth} {diagonals:?}"));
            if smooth == 0 {
                // A middle takes from its cell the two tetrahedra over the halves of a rectangle each side that it splits: 1/6 · 1/4 each.
                let cut = surface.middle.iter().filter(|&&m| m).count();
                let volume = six_volumes(&surface.positions, &surface.triangles);
                assert_eq!(volume, 6.0 * solid.iter().filter(|&&s| s).count() as f64 - 0.5 * cut as f64);
                middles += cut;
            }
        }
    }
    assert!(middles > 30, "too few doubled edges to mean anything: {middles}");
}

/// Few points in a ragged solid: whole regions share a point, and everything wants to be contracted.
#[test]
fn greedy_contraction_keeps_random_solids_sound() {
    let mut numbers = Numbers(2);
    let mut contracted = 0;
    for round in 0..200 {
        let cells = [3 + round % 2, 3 + round % 6, 3];
        let count = cells.iter().product::<u32>();
        let share = 20 + numbers.below(71);
        let solid: Vec<bool> = (0..count).map(|_| numbers.below(100) < share).collect();
        let point = |numbers: &mut Numbers| cells.map(|c| numbers.below(u64::from(8 * c) + 1) as f64 / 8.0);
        let points: Vec<[f64; 3]> = (0..1 + numbers.below(6)).map(|_| point(&mut numbers)).collect();
        let params = unit_params(cells, 1 + round % 5);
        let surface = mesh_of_solid(&solid, cells, round % 4, DIAGONALS[round as usize % 3]);
        let mesh = finish(&surface, &points, &params);
        check(mesh.vertices.len(), &mesh.faces).unwrap_or_else(|e| panic!("round {round}: {e}"));
        contracted += surface.positions.len() - mesh.vertices.len();
    }
    assert!(contracted > 1000, "only {contracted} contractions");
}

#[test]
fn a_cube_has_its_known_counts() {
    for n in 1..=4u32 {
        let solid = vec![true; (n * n * n) as usize];
        let surface = mesh_of_solid(&solid, [n, n, n], 0, Diagonals::First);
        assert_eq!(surface.positions.len() as u32, 6 * n * n + 2);
        assert_eq!(surface.triangles.len() as u32, 12 * n * n);
    }
}

#[test]
fn one_step_halves_a_single_cell() {
    let surface = mesh_of_solid(&[true], [1, 1, 1], 1, Diagonals::First);
    let expected =
        [0, 1, 2, 3, 4, 5, 6, 7].map(|v: u32| [v & 1, v >> 2, v >> 1 & 1].map(|b| 0.25 + 0.5 * f64::from(b)));
    assert_eq!(surface.positions, expected);
    assert_eq!(surface.planes, [0, 0, 0, 0, 1, 1, 1, 1]);
    // Lower plane first: the face perpendicular to y at the bottom is cut from p00 along x (c), z (b) last.
    assert_eq!(surface.triangles[..2], [[0, 1, 3], [0, 3, 2]]);
    assert_eq!(surface.slices, [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 1]);
}

/// Two pillars of one cell that touch along an edge, between a floor and a ceiling, in all three directions.
#[test]
fn diagonal_pillars_get_a_middle() {
    for axis in 0..3 {
        let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut cells = [2; 3];
        cells[axis] = 3;
        let mut solid = vec![false; 12];
        for y in 0..cells[1] {
            for z in 0..cells[2] {
                for x in 0..cells[0] {
                    let at = [x, y, z];
                    let index = (x + cells[0] * (z + cells[2] * y)) as usize;
                    solid[index] = at[axis] != 1 || at[b] == at[c];
                }
            }
        }
        for diagonals in DIAGONALS {
            let surface = mesh_of_solid(&solid, cells, 1, diagonals);
            assert_sound(&surface, "pillars");
            // 36 corners and one middle; a ring of genus 1.
            assert_eq!(surface.positions.len(), 37);
            assert_eq!(surface.triangles.len(), 74);
            let middles: Vec<usize> = (0..37).filter(|&v| surface.middle[v]).collect();
            assert_eq!(middles.len(), 1);
            assert_eq!(surface.planes[middles[0]], 1);
            let mut centre = [1.0; 3];
            centre[axis] = 1.5;
            // In the pillar that is at d_b = d_c = 0, a quarter of a cell in.
            centre[b] = 0.75;
            centre[c] = 0.75;
            assert_eq!(surface.positions[middles[0]], centre);
            // Its triangles lie on the copy of the pillar with d_b = 0.
            let around: BTreeSet<u32> =
                surface.triangles.iter().filter(|t| t.contains(&(middles[0] as u32))).flatten().copied().collect();
            assert_eq!(around.len(), 5);
            let mean = around.iter().map(|&v| surface.positions[v as usize][b]).sum::<f64>() / 5.0;
            assert!(mean < 1.0, "the middle lies on the pillar at {mean}");
        }
    }
}

#[test]
fn the_grid_permutes_cyclically() {
    let points = [[10.0, 20.0, 30.0], [11.0, 22.0, 34.0]];
    assert_eq!(grid_for(&points, None, 8), (Axis::Z, [10.0, 20.0, 30.0], 0.5, [4, 8, 2]));
    assert_eq!(grid_for(&points, Some(Axis::X), 2), (Axis::X, [10.0, 20.0, 30.0], 0.5, [8, 2, 4]));
    assert_eq!(grid_for(&points, Some(Axis::Y), 4), (Axis::Y, [10.0, 20.0, 30.0], 0.5, [2, 4, 8]));
    assert_eq!(grid_for(&[[1.0, 2.0, 3.0]], None, 8), (Axis::X, [1.0, 2.0, 3.0], 1.0, [1, 1, 1]));
    let square = [[0.0, 0.0, 0.0], [4.0, 4.0, 0.0]];
    assert_eq!(grid_for(&square, None, 4), (Axis::X, [0.0; 3], 1.0, [1, 4, 4]));
    assert_eq!(grid_for(&square, Some(Axis::Z), 4), (Axis::Z, [0.0; 3], 1.0, [4, 1, 4]));
}

/// A point at the middle of a cell is the nearest of its eight vertices, which the link condition keeps at four.
#[test]
fn a_single_point_becomes_a_tetrahedron() {
    let params = unit_params([1, 1, 1], 4);
    let mesh = reconstruct(&[[0.5; 3]], &params);
    assert_eq!((mesh.vertices.len(), mesh.faces.len()), (4, 4));
    assert_eq!(mesh.vertices[0], [0.5; 3]);
    check(4, &mesh.faces).unwrap();
}

#[test]
fn zeros_of_both_signs_do_not_depend_on_the_order_of_points() {
    let params = unit_params([1, 1, 1], 4);
    let one = reconstruct(&[[0.0, 0.0, -0.0], [-0.0, 0.0, 0.0], [1.0, 1.0, 1.0]], &params);
    let other = reconstruct(&[[1.0, 1.0, 1.0], [-0.0, 0.0, 0.0], [0.0, 0.0, -0.0]], &params);
    assert_eq!(one.bits(), other.bits());
}

fn context(cloud: &Cloud, params: &Params) -> String {
    format!("{} {:?} {params:?}", cloud.kind, cloud.points)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    #[ignore = "exhaustive"]
    fn the_order_of_points_does_not_show(cloud in cloud(), setting in setting(), turn in 0usize..100) {
        let params = setting.params(&cloud);
        let mut turned = cloud.points.clone();
        turned.reverse();
        turned.rotate_left(turn % cloud.points.len());
        let (one, other) = (reconstruct(&cloud.points, &params), reconstruct(&turned, &params));
        prop_assert_eq!(one.bits(), other.bits());
        prop_assert_eq!(one.faces, other.faces);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 144, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn every_cloud_gives_a_sound_mesh(cloud in cloud(), setting in setting()) {
        let params = setting.params(&cloud);
        let mesh = reconstruct(&cloud.points, &params);
        prop_assert_eq!(check(mesh.vertices.len(), &mesh.faces), Ok(()), "{}", context(&cloud, &params));
        prop_assert!(mesh.vertices.iter().flatten().all(|x| x.is_finite()));
        if cloud.single {
            prop_assert!(mesh.vertices.iter().flatten().all(|&x| f64::from(x as f32) == x));
        }
    }

    /// Phase 1 needs nothing of a slab's neighbours.
    #[test]
    fn slabs_are_contracted_alone(cloud in cloud(), setting in setting()) {
        let params = setting.params(&cloud);
        let surface = surface(&solid_cells(&cloud.points, &params), params.smooth, params.diagonals);
        let fitting = Fitting::new(&surface, &cloud.points, &params);
        let mut together = fitting.start();
        let mut alone = Vec::new();
        for slab in slabs(&params) {
            together.run(&fitting.inner_vertices(slab));
            let mut contraction = fitting.start_slab(slab);
            contraction.run(&fitting.inner_vertices(slab));
            alone.extend(contraction.triangles());
        }
        prop_assert_eq!(together.triangles(), alone, "{}", context(&cloud, &params));
    }

    #[test]
    fn without_fitting_slabs_do_not_show(cloud in cloud(), setting in setting()) {
        let mut params = setting.params(&cloud);
        params.fit = Fit::None;
        // After more steps or none vertices may retreat, and that goes slab by slab.
        params.smooth = 1;
        let whole = reconstruct(&cloud.points, &Params { slab_slices: 100, ..params.clone() });
        let slabs = reconstruct(&cloud.points, &params);
        prop_assert_eq!(whole.bits(), slabs.bits());
        prop_assert_eq!(whole.faces, slabs.faces);
    }
}
