//! Gaps between far points: the planes in their middle are left out of the grid.

use std::ops::Range;

/// The least planes that a gap keeps, whatever the cloud: more than any ball that is tried on so few planes with points is wide.
pub const GAP: u32 = 256;
/// The most gaps that are shortened along an axis.
const MOST: usize = 4;
/// A gap is shortened from this part of the longest side on: then a coarse look at the points shows whether there can be one.
pub const SHOWS: u32 = 32;

/// Planes that are left out in the middle of a gap. Planes are *raw* as long as all of them are counted.
///
/// ```text
///   raw   |##|##|  |  |  |  |  |  |  |#|     # planes with points
///              first ^        ^ end
///   grid  |##|##|  |  |  |#|
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
struct Gap {
    /// The raw planes that are left out.
    first: u32,
    end: u32,
    /// Planes left out up to here.
    so_far: u32,
}

impl Gap {
    /// The first plane of the grid behind it.
    fn behind(&self) -> u32 {
        self.end - self.so_far
    }
}

/// What is left out along an axis.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct Gaps {
    cuts: [Gap; MOST],
    count: usize,
}

impl Gaps {
    /// The gaps of an axis, given which of its raw planes have points. `least` and `widest` are planes: those that a gap keeps at the least, and the width up to which it
    /// stays as it is.
    pub fn of(planes: &[bool], least: u32, widest: u32) -> Gaps {
        let with_points: Vec<u32> = (0..planes.len() as u32).filter(|y| planes[*y as usize]).collect();
        let kept = least.max(with_points.len().div_ceil(2) as u32);
        let gaps = with_points.windows(2).map(|pair| (pair[0] + 1, pair[1]));
        let mut gaps: Vec<(u32, u32)> = gaps.filter(|(from, to)| to - from > widest.max(2 * kept)).collect();
        // The widest, of equals the first; the sort is stable.
        gaps.sort_by_key(|(from, to)| std::cmp::Reverse(to - from));
        gaps.truncate(MOST);
        gaps.sort_unstable();
        let mut out = Gaps { count: gaps.len(), ..Gaps::default() };
        let mut so_far = 0;
        for (gap, (from, to)) in out.cuts.iter_mut().zip(gaps) {
            let (first, end) = (from + kept / 2, to - (kept - kept / 2));
            so_far += end - first;
            *gap = Gap { first, end, so_far };
        }
        out
    }

    /// Whether nothing is left out.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    fn all(&self) -> &[Gap] {
        &self.cuts[..self.count]
    }

    /// Number of planes that are left out.
    pub fn left_out(&self) -> u32 {
        self.all().last().map_or(0, |gap| gap.so_far)
    }

    /// A plane's number, given its raw one.
    #[inline]
    pub fn shorten(&self, raw: u32) -> u32 {
        raw - self.all().iter().rev().find(|gap| raw >= gap.end).map_or(0, |gap| gap.so_far)
    }

    /// The planes left out below a place so many planes up the axis.
    #[inline]
    pub fn left_out_below(&self, q: f64) -> u32 {
        let behind = |gap: &&Gap| q >= f64::from(gap.behind());
        self.all().iter().rev().find(behind).map_or(0, |gap| gap.so_far)
    }

    /// The planes round one, of `count` in all, among which none are left out, and how many are left out below them.
    pub fn piece(&self, plane: u32, count: u32) -> (Range<u32>, u32) {
        let below = self.all().iter().rev().find(|gap| plane >= gap.behind());
        let above = self.all().iter().find(|gap| plane < gap.behind());
        let (start, so_far) = below.map_or((0, 0), |gap| (gap.behind(), gap.so_far));
        (start..above.map_or(count, Gap::behind), so_far)
    }

    /// How many planes up the axis a place lies, given how many raw ones. All left-out planes of a gap are at its end.
    #[inline]
    pub fn height(&self, raw: f64) -> f64 {
        match self.all().iter().rev().find(|gap| raw >= f64::from(gap.first)) {
            Some(gap) => raw.max(f64::from(gap.end)) - f64::from(gap.so_far),
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
        let found = Gaps::of(&many, GAP, 94);
        assert_eq!(
            found.all().iter().map(|gap| gap.first).collect::<Vec<_>>(),
            [129, 729, 1329, 1929],
            "the first four of equals"
        );
    }
}
