//! The sides of bodies and sheets, turned at random and thinned; and of the same block mirrored, with its axes exchanged.

use proptest::prelude::*;

use super::super::block::Block;
use super::super::{Seen, Side, Signed, outliers};
use super::bodies::{Body, Shape};
use super::{Numbers, dot, level, numbers_of, square_between};
use crate::run::testing::with_context;

impl Signed {
    /// The side of a cell of the level; beyond it, all is outside.
    pub(super) fn side(&self, [x, y, z]: [i64; 3]) -> Side {
        let row = self.row(y, z);
        row.and_then(|row| row.get((x + super::super::PAD as i64) as usize)).copied().unwrap_or(Side::Outside)
    }
}

fn signed(block: Block, mut occupied: Vec<bool>) -> Signed {
    let outliers = outliers::take_out(&block, &mut occupied);
    let walls = numbers_of(&occupied);
    let cells = block.cells;
    with_context(cells, |context| {
        Signed::find(Seen { block, occupied, walls, outliers, emptied: Vec::new(), factor: 1 }, context).unwrap()
    })
}

fn sampled(body: &Body, missing: f64, numbers: &mut Numbers) -> Signed {
    let (block, occupied) = body.sampled(missing, numbers);
    signed(block, occupied)
}

/// Cells farther from the wall than this are asked for their side.
const CLEAR: f64 = 2.5;

/// Cells away from walls and holes, with the side that they are to have.
fn probes(body: &Body) -> impl Iterator<Item = ([usize; 3], Side)> {
    level([body.size as u32; 3]).filter_map(|cell| {
        let height = body.height(cell);
        (height.abs() > CLEAR && body.distance_from_hole(cell) > CLEAR)
            .then_some((cell, if height < 0.0 { Side::Inside } else { Side::Outside }))
    })
}

fn check(body: &Body, missing: f64, numbers: &mut Numbers) -> Result<(), TestCaseError> {
    let signed = sampled(body, missing, numbers);
    let mut seen = [0; 2];
    let mut wrong = Vec::new();
    for (cell, side) in probes(body) {
        let found = signed.side(cell.map(|c| c as i64));
        if found != side {
            wrong.push((cell, found));
        }
        seen[usize::from(side == Side::Inside)] += 1;
    }
    // A body that is thin all over has hardly a cell that lies clear of its wall; too many of these, and proptest gives up.
    prop_assume!(seen.iter().all(|count| *count > 100));
    prop_assert!(wrong.is_empty(), "{} of {seen:?}, {:?}: {body:?}", wrong.len(), wrong[0]);
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn closed_bodies_are_inside(seed in any::<u64>(), longest in 30f64..44.0, missing in 0.0f64..0.15) {
        let mut numbers = Numbers::new(seed);
        let body = Body::closed(&mut numbers, longest);
        check(&body, missing, &mut numbers)?;
    }

    #[test]
    fn bodies_with_a_hole_are_inside(
        seed in any::<u64>(),
        longest in 30f64..44.0,
        missing in 0.0f64..0.15,
        part in 0.05f64..0.25,
    ) {
        let mut numbers = Numbers::new(seed);
        let body = Body::with_hole(&mut numbers, longest, part);
        check(&body, missing, &mut numbers)?;
    }

    #[test]
    fn a_sphere_in_a_sphere_is_a_cavity(
        seed in any::<u64>(),
        outer in 16f64..22.0,
        part in 0.35f64..0.6,
        missing in 0.0f64..0.15,
    ) {
        let mut numbers = Numbers::new(seed);
        let body = Body::new(Shape::Hollow { outer, inner: part * outer }, 2.0 * outer, &mut numbers);
        check(&body, missing, &mut numbers)?;
    }

    #[test]
    fn sheets_have_no_inside(seed in any::<u64>(), longest in 24f64..40.0, missing in 0.0f64..0.15) {
        let mut numbers = Numbers::new(seed);
        let body = Body::sheet(&mut numbers, longest);
        let signed = sampled(&body, missing, &mut numbers);
        for cell in level(signed.block.cells).filter(|cell| body.height(*cell) > 4.0) {
            prop_assert_eq!(signed.side(cell.map(|c| c as i64)), Side::Outside, "{:?} {:?}", cell, body);
        }
    }

    #[test]
    fn sheets_are_found(seed in any::<u64>(), longest in 24f64..40.0, missing in 0.0f64..0.15) {
        let mut numbers = Numbers::new(seed);
        let body = Body::sheet(&mut numbers, longest);
        let signed = sampled(&body, missing, &mut numbers);
        let in_sheets: usize = signed.open.iter().map(|patch| patch.walls as usize).sum();
        prop_assert!(in_sheets as f64 > 0.7 * signed.walls as f64, "{in_sheets} of {} walls: {body:?}", signed.walls);
    }

    /// Of sheets that are sampled everywhere, there are two and more walls to nearly every cell twice as wide. Four sheets together: one may have 60 such cells only, too few to tell a share by.
    #[test]
    #[ignore = "exhaustive"]
    fn sheets_without_gaps_are_not_sparse(seed in any::<u64>(), longest in 24f64..40.0, missing in 0.0f64..0.15) {
        let mut numbers = Numbers::new(seed);
        let (mut all, mut sparse) = (0, 0);
        for _ in 0..4 {
            let body = Body::sheet(&mut numbers, longest);
            let [places, few] = sampled(&body, missing, &mut numbers).where_outside;
            (all, sparse) = (all + places, sparse + few);
        }
        prop_assert!(all > 0 && 10 * sparse < all, "{sparse} of {all}");
    }

    #[test]
    fn closed_bodies_are_no_sheets(seed in any::<u64>(), longest in 30f64..44.0, missing in 0.0f64..0.15) {
        let mut numbers = Numbers::new(seed);
        let body = Body::closed(&mut numbers, longest);
        let signed = sampled(&body, missing, &mut numbers);
        prop_assert_eq!(signed.open.len(), 0, "{:?}", body);
    }

    #[test]
    fn a_mirrored_block_with_its_axes_exchanged_has_the_same_sides(
        seed in any::<u64>(),
        longest in 24f64..36.0,
        missing in 0.0f64..0.15,
        mirrored in any::<[bool; 3]>(),
        order in Just([0usize, 1, 2]).prop_shuffle(),
    ) {
        let mut numbers = Numbers::new(seed);
        let body = Body::any(&mut numbers, longest);
        let (block, occupied) = body.sampled(missing, &mut numbers);
        let last = body.size - 1;
        let moved = |cell: [usize; 3]| order.map(|a| if mirrored[a] { last - cell[a] } else { cell[a] });
        let mut other = vec![false; occupied.len()];
        for cell in level(block.cells) {
            other[block.index(moved(cell))] = occupied[block.index(cell)];
        }
        let walls = numbers_of(&occupied);
        let [this, other] = [occupied, other].map(|occupied| signed(block.clone(), occupied));
        // Normals of walls at corners have ties, which the axes decide: a few cells have free ones on both sides of one normal alone. They move what lies next to the walls, and by a little the
        // membrane in a hole.
        prop_assert!(this.walls.abs_diff(other.walls) <= this.walls / 200, "{} and {} walls", this.walls, other.walls);
        let places: Vec<[i64; 3]> = walls.iter().map(|wall| block.cell(*wall as usize).map(|c| c as i64)).collect();
        let near_wall = |cell: [i64; 3]| places.iter().any(|wall| square_between(*wall, cell) <= 6);
        for cell in level(block.cells).filter(|cell| body.distance_from_hole(*cell) > CLEAR) {
            let sides = [this.side(cell.map(|c| c as i64)), other.side(moved(cell).map(|c| c as i64))];
            let same = sides[0] == sides[1];
            prop_assert!(same || near_wall(cell.map(|c| c as i64)), "{sides:?} at {cell:?} of {body:?}");
        }
    }
}

/// Where points lie on a block with two slots in its top, turned at random, and the middle of the web between them:
///
/// ```text
///    # # # # # #   # # # # #   # # # # # #       two sampling distances wide; cells are a little wider than one
///    #         #   #       #   #         #
///    #         #   #   x   #   #         #       x: inside, though each wall of the web has the other side of a slot right behind it
///    #         # # #       # # #         #
///    #                                   #
///    # # # # # # # # # # # # # # # # # # #
/// ```
fn web(numbers: &mut Numbers, slot: f64, web: f64, side: f64) -> (Block, Vec<bool>, Vec<[usize; 3]>) {
    let (half, bottom) = ([web / 2.0 + slot + 11.0, 15.0, 12.0], -8.0);
    let in_slot = |x: f64| (web / 2.0..web / 2.0 + slot).contains(&x.abs());
    let area: f64 = 8.0 * (half[0] * half[1] + half[1] * half[2] + half[2] * half[0]);
    let mut points: Vec<[f64; 3]> = Vec::new();
    for _ in 0..area as usize {
        // A place on the block's faces; those in the slots' mouths are left out.
        let mut p = half.map(|h| numbers.between(-h, h));
        let mut at = numbers.part() * area / 8.0;
        let axis = (0..3).find(|a| {
            at -= half[(a + 1) % 3] * half[(a + 2) % 3];
            at <= 0.0
        });
        let axis = axis.unwrap_or(2);
        p[axis] = half[axis].copysign(numbers.between(-1.0, 1.0));
        if !(in_slot(p[0]) && p[2] > bottom) {
            points.push(p);
        }
    }
    let (wide, deep) = (2.0 * half[1], half[2] - bottom);
    for edge in [web / 2.0, web / 2.0 + slot].into_iter().flat_map(|x| [x, -x]) {
        points.extend(
            (0..(wide * deep) as usize)
                .map(|_| [edge, numbers.between(-half[1], half[1]), numbers.between(bottom, half[2])]),
        );
    }
    for sign in [1.0, -1.0] {
        let across = |numbers: &mut Numbers| sign * (web / 2.0 + numbers.between(0.0, slot));
        points
            .extend((0..(wide * slot) as usize).map(|_| [across(numbers), numbers.between(-half[1], half[1]), bottom]));
    }
    let inside = (0..200).map(|_| {
        let clear = web / 2.0 - 2.5 * side;
        [numbers.between(-clear, clear), numbers.between(-9.0, 9.0), numbers.between(bottom, half[2] - 4.0 * side)]
    });
    let inside: Vec<[f64; 3]> = inside.collect();
    let axes = Body::new(Shape::Sphere { radius: 1.0 }, 1.0, numbers).axes;
    let reach = dot(half, half).sqrt();
    let placed = |p: [f64; 3]| {
        let turned = [0, 1, 2].map(|a| (0..3).map(|b| axes[b][a] * p[b]).sum::<f64>());
        turned.map(|c| ((c + reach) / side + 0.5) as usize)
    };
    let block = Block::new([(2.0 * reach / side) as u32 + 2; 3]);
    let mut occupied = vec![false; block.size()];
    points.into_iter().for_each(|p| occupied[block.index(placed(p))] = true);
    (block, occupied, inside.into_iter().map(placed).collect())
}

/// Of most such blocks: of these 60 all but 12. If double walls were never light, 31 webs would be outside.
#[test]
fn the_web_between_two_slots_is_inside() {
    let wrong = (0..60).filter(|seed| {
        let mut numbers = Numbers::new(*seed);
        let (slot, wide, side) = (numbers.between(1.8, 2.4), numbers.between(8.0, 11.0), numbers.between(1.2, 1.4));
        let (block, occupied, inside) = web(&mut numbers, slot, wide, side);
        let signed = signed(block, occupied);
        inside.iter().any(|cell| signed.side(cell.map(|c| c as i64)) == Side::Outside)
    });
    let wrong = wrong.count();
    assert!(wrong <= 15, "{wrong} of 60");
}
