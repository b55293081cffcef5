//! Gaps between far points: the planes in their middle are left out of the grid.

/// The least planes that a gap keeps, whatever the cloud: more than any ball that is tried on so few planes with points is wide.
pub const GAP: u32 = 256;
/// The most gaps that are shortened along an axis.
const FOLDS: usize = 4;
/// A gap is shortened from this part of the longest side on: then a coarse look at the points shows whether there can be one.
pub const SHOWS: u32 = 32;

/// Planes that are left out in the middle of a gap. Planes are *raw* as long as all of them are counted.
///
/// ```text
///   raw   |##|##|  |  |  |  |  |  |  |#|     # planes with points
///              first ^        ^ end
///   grid  |##|##|  |  |  |#|
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Fold {
    /// The raw planes that are left out.
    first: u32,
    end: u32,
    /// Planes left out up to here.
    so_far: u32,
}

impl Fold {
    /// The first plane of the grid behind it.
    fn behind(&self) -> u32 {
        self.end - self.so_far
    }
}

/// What is left out along an axis.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Folds {
    folds: [Fold; FOLDS],
    count: usize,
}

impl Folds {
    /// The folds of an axis, given which of its raw planes have points. `least` and `widest` are planes: those that a gap keeps at the least, and the width up to which it
    /// stays as it is.
    pub fn of(planes: &[bool], least: u32, widest: u32) -> Folds {
        let with_points: Vec<u32> = (0..planes.len() as u32).filter(|y| planes[*y as usize]).collect();
        let kept = least.max(with_points.len().div_ceil(2) as u32);
        let gaps = with_points.windows(2).map(|pair| (pair[0] + 1, pair[1]));
        let mut gaps: Vec<(u32, u32)> = gaps.filter(|(from, to)| to - from > widest.max(2 * kept)).collect();
        // The widest, of equals the first; the sort is stable.
        gaps.sort_by_key(|(from, to)| std::cmp::Reverse(to - from));
        gaps.truncate(FOLDS);
        gaps.sort_unstable();
        let mut out = Folds { count: gaps.len(), ..Folds::default() };
        let mut so_far = 0;
        for (fold, (from, to)) in out.folds.iter_mut().zip(gaps) {
            let (first, end) = (from + kept / 2, to - (kept - kept / 2));
            so_far += end - first;
            *fold = Fold { first, end, so_far };
        }
        out
    }

    /// Whether nothing is left out.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    fn all(&self) -> &[Fold] {
        &self.folds[..self.count]
    }

    /// Number of planes that are left out.
    pub fn left_out(&self) -> u32 {
        self.all().last().map_or(0, |fold| fold.so_far)
    }

    /// A plane's number, given its raw one.
    #[inline]
    pub fn fold(&self, raw: u32) -> u32 {
        raw - self.all().iter().rev().find(|fold| raw >= fold.end).map_or(0, |fold| fold.so_far)
    }

    /// The planes left out below a place so many planes up the axis.
    #[inline]
    pub fn left_out_below(&self, q: f64) -> u32 {
        let behind = |fold: &&Fold| q >= f64::from(fold.behind());
        self.all().iter().rev().find(behind).map_or(0, |fold| fold.so_far)
    }

    /// How many planes up the axis a place lies, given how many raw ones. All of a fold is at its end.
    #[inline]
    pub fn height(&self, raw: f64) -> f64 {
        match self.all().iter().rev().find(|fold| raw >= f64::from(fold.first)) {
            Some(fold) => raw.max(f64::from(fold.end)) - f64::from(fold.so_far),
            None => raw,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_equal_gaps_the_first_four_are_shortened() {
        let five = &[0, 1, 2, 3, 4, 5].map(|i| i * 600);
        let mut many = vec![false; 3001];
        five.iter().for_each(|y| many[*y] = true);
        let folds = Folds::of(&many, GAP, 94);
        assert_eq!(
            folds.all().iter().map(|fold| fold.first).collect::<Vec<_>>(),
            [129, 729, 1329, 1929],
            "the first four of equals"
        );
    }
}
