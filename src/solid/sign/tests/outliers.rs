//! Strays are dropped, and surfaces are not.

use proptest::prelude::*;

use super::super::block::Block;
use super::super::outliers::take_out;
use super::bodies::Body;
use super::{Numbers, marked, numbers_of, places, square_between};

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn strays_go_and_surfaces_stay(
        seed in any::<u64>(),
        size in 24f64..40.0,
        missing in 0.0f64..0.15,
        strays in 0usize..60,
    ) {
        let mut numbers = Numbers::new(seed);
        let body = Body::any(&mut numbers, size);
        let (block, surface) = body.sampled(missing, &mut numbers);
        let mut occupied = surface.clone();
        let places = places(&block);
        let cells = numbers_of(&surface);
        let mut put: Vec<usize> = Vec::new();
        for _ in 0..strays {
            let cell = block.index(block.cells.map(|c| numbers.below(c as usize)));
            // Apart from the surface, and from the other strays.
            let apart = |other: usize| square_between(places[cell], places[other]) > 3 * 3 * 3;
            if cells.iter().all(|&other| apart(other as usize)) && put.iter().all(|&other| apart(other)) {
                occupied[cell] = true;
                put.push(cell);
            }
        }
        put.sort_unstable();
        let taken = take_out(&block, &mut occupied);
        let kept: Vec<usize> = put.iter().copied().filter(|&cell| occupied[cell]).collect();
        prop_assert_eq!(kept, Vec::<usize>::new(), "strays are left: {:?}", body);
        let lost = taken.len() - put.len();
        // Of a sheet, a cell at its corner may stand alone once others there are missing.
        let most = if body.is_sheet() { cells.len() / 200 } else { 0 };
        prop_assert!(lost <= most, "{lost} of {} cells of the surface are gone: {body:?}", cells.len());
    }

    #[test]
    fn what_is_taken_out_is_what_is_gone(seed in any::<u64>(), share in 0.0f64..0.3) {
        let mut numbers = Numbers::new(seed);
        let block = Block::new([12; 3]);
        let before = marked(&block, |_| numbers.part() < share);
        let mut after = before.clone();
        let taken = take_out(&block, &mut after);
        let gone: Vec<u32> = (0..before.len() as u32).filter(|&i| before[i as usize] && !after[i as usize]).collect();
        prop_assert_eq!(taken, gone);
        prop_assert!(after.iter().zip(&before).all(|(after, before)| !after | before));
        prop_assert_eq!(after.contains(&true), before.contains(&true), "something is left of what is there");
    }
}
