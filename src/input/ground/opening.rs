//! Morphological opening of heights with growing windows: the highest surface under which a window of that size fits everywhere.
//!
//! Window r is the cell and r steps from it, by turns to the four neighbours (odd steps) and the eight (even ones): an octagon. Each window is thus made of the one before
//! in one pass over the cells.

/// Lowers the middle of `heights`, rows of `width` cells, to the surfaces under windows 1, 2, … `most`, and shows each to `seen`. The middle is what lies 2 `most` cells from all ends. What is
/// not known is NaN, hinders no window, is no window's middle, and stays so. No surface is higher than that before it.
///
/// ```text
///  .--------------------------.
///  | eroded: all              |
///  |   .------------------.   |
///  |   | dilated          |   |    for window r, only what lies r cells from the middle is dilated
///  |   |    .--------.    |   |
///  |   | r  | middle |    |   |
///  |   |    '--------'    |   |
///  |   '------------------'   |
///  '--------------------------'
/// ```
pub fn open(heights: &[f32], width: usize, most: u32, mut seen: impl FnMut(u32, &[f32])) {
    let ends = 2 * most as usize;
    let mut eroded: Vec<f32> =
        heights.iter().map(|height| if height.is_nan() { f32::INFINITY } else { *height }).collect();
    let (mut rows, mut surface) = (vec![0.0; heights.len()], without_ends(heights, width, ends));
    for window in 1..=most {
        step(&mut eroded, &mut rows, width, window, f32::INFINITY, |a, b| if b < a { b } else { a });
        let margin = window as usize;
        let mut opened = without_ends(&eroded, width, ends - margin);
        // No window has its middle where nothing is known: one that hangs over the end of the data would fit on what lies along it.
        for (opened, _) in
            opened.iter_mut().zip(without_ends(heights, width, ends - margin)).filter(|(_, height)| height.is_nan())
        {
            *opened = f32::NEG_INFINITY;
        }
        let across = width - 2 * (ends - margin);
        let spare = &mut rows[..opened.len()];
        for window in 1..=window {
            step(&mut opened, spare, across, window, f32::NEG_INFINITY, |a, b| if b > a { b } else { a });
        }
        let middle = without_ends(&opened, across, margin);
        // The middles of a larger window's parts need not be known, so it could leave more.
        for (lower, opened) in surface.iter_mut().zip(middle) {
            if opened < *lower {
                *lower = opened;
            }
        }
        seen(window, &surface);
    }
}

/// What lies so many cells from all ends of rows of `width` cells.
fn without_ends(cells: &[f32], width: usize, ends: usize) -> Vec<f32> {
    let rows = cells.chunks_exact(width).skip(ends).take(cells.len() / width - 2 * ends);
    rows.flat_map(|row| row[ends..width - ends].iter().copied()).collect()
}

/// The surface under one window, of heights that are all known.
pub fn opened(heights: &[f32], width: usize, window: u32) -> Vec<f32> {
    let (mut cells, mut rows) = (heights.to_vec(), vec![0.0; heights.len()]);
    for number in 1..=window {
        step(&mut cells, &mut rows, width, number, f32::INFINITY, |a, b| if b < a { b } else { a });
    }
    for number in 1..=window {
        step(&mut cells, &mut rows, width, number, f32::NEG_INFINITY, |a, b| if b > a { b } else { a });
    }
    cells
}

/// The best of each cell's neighbours and its own: of four or eight, as step `number` goes. `worst` stands beyond the ends.
fn step(cells: &mut [f32], spare: &mut [f32], width: usize, number: u32, worst: f32, best: impl Fn(f32, f32) -> f32) {
    let rows = cells.len() / width;
    // Along rows.
    for (line, out) in cells.chunks_exact(width).zip(spare.chunks_exact_mut(width)) {
        for ((out, before), (own, after)) in
            out[1..width - 1].iter_mut().zip(&line[..width - 2]).zip(line[1..width - 1].iter().zip(&line[2..]))
        {
            *out = best(best(*own, *before), *after);
        }
        out[0] = best(line[0], line[1]);
        out[width - 1] = best(line[width - 1], line[width - 2]);
    }
    // Across them: of the row's own cells where there are four neighbours, and of what was found along rows where there are eight.
    let beyond = vec![worst; width];
    let mut above = beyond.clone();
    let all = number.is_multiple_of(2);
    for row in 0..rows {
        let own = row * width..(row + 1) * width;
        let current: Vec<f32> = if all { spare[own.clone()].to_vec() } else { cells[own.clone()].to_vec() };
        let next = (row + 1) * width..(row + 2) * width;
        let below: &[f32] = match row + 1 < rows {
            false => &beyond,
            true if all => &spare[next],
            true => &cells[next],
        };
        let found: Vec<f32> = (0..width).map(|x| best(best(spare[own.start + x], above[x]), below[x])).collect();
        cells[own].copy_from_slice(&found);
        above = current;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The cells of a window, as steps from its middle.
    fn cells_of(window: u32) -> Vec<(i64, i64)> {
        let mut cells = vec![(0, 0)];
        for number in 1..=window {
            let more: Vec<(i64, i64)> = (-1..=1)
                .flat_map(|dy: i64| (-1..=1).map(move |dx: i64| (dy, dx)))
                .filter(|(dy, dx)| number % 2 == 0 || dy * dx == 0)
                .collect();
            cells = cells.iter().flat_map(|(y, x)| more.iter().map(move |(dy, dx)| (y + dy, x + dx))).collect();
            cells.sort_unstable();
            cells.dedup();
        }
        cells
    }

    /// The highest of the lowest of all windows that hold a cell.
    fn opened(heights: &[f32], width: usize, window: u32) -> Vec<f32> {
        let (rows, cells) = ((heights.len() / width) as i64, cells_of(window));
        let at = |y: i64, x: i64| {
            let inside = (0..rows).contains(&y) && (0..width as i64).contains(&x);
            inside.then(|| heights[y as usize * width + x as usize])
        };
        let lowest = |y: i64, x: i64| {
            let of = cells.iter().filter_map(|(dy, dx)| at(y + dy, x + dx)).filter(|height| !height.is_nan());
            of.fold(f32::INFINITY, f32::min)
        };
        (0..heights.len())
            .map(|i| {
                let (y, x) = ((i / width) as i64, (i % width) as i64);
                if heights[i].is_nan() {
                    return f32::NAN;
                }
                let middles = cells.iter().filter(|(dy, dx)| at(y - dy, x - dx).is_some_and(|height| !height.is_nan()));
                middles.map(|(dy, dx)| lowest(y - dy, x - dx)).fold(f32::NEG_INFINITY, f32::max)
            })
            .collect()
    }

    proptest! {
        #[test]
        fn as_its_definition_says_and_never_more_than_a_smaller_window(
            (most, width, heights) in (1u32..6, 1usize..12, 1usize..12).prop_flat_map(|(most, across, rows)| {
                let [width, rows] = [across, rows].map(|side| side + 4 * most as usize);
                let height = prop_oneof![3 => (0u32..50).prop_map(|h| h as f32 / 4.0), 1 => Just(f32::NAN)];
                (Just(most), Just(width), prop::collection::vec(height, width * rows))
            }),
        ) {
            let mut before = without_ends(&heights, width, 2 * most as usize);
            let mut windows = 0;
            open(&heights, width, most, |window, found| {
                windows += 1;
                let lower = without_ends(&opened(&heights, width, window), width, 2 * most as usize);
                let expected: Vec<f32> = lower.iter().zip(&before).map(|(now, before)| if now < before { *now } else { *before }).collect();
                assert_eq!(found.iter().map(|h| h.to_bits()).collect::<Vec<_>>(), expected.iter().map(|h| h.to_bits()).collect::<Vec<_>>());
                before.copy_from_slice(found);
            });
            prop_assert_eq!(windows, most);
        }

        #[test]
        fn one_window_is_as_its_definition_says(
            width in 2usize..24,
            heights in prop::collection::vec((0u32..50).prop_map(|h| h as f32 / 4.0), 60..400),
            window in 1u32..7,
        ) {
            let heights = &heights[..heights.len() / width * width];
            prop_assert_eq!(super::opened(heights, width, window), opened(heights, width, window));
        }
    }

    #[test]
    fn windows_are_octagons() {
        assert_eq!([1, 2, 3].map(|window| cells_of(window).len()), [5, 21, 37]);
    }
}
