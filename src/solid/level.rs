//! The level of the pyramid that the sides are told on.
//!
//! Its cells are at least [`COARSE`] sampling distances wide, and no more than [`sign::LONGEST`] along any axis. Where that does not do, other cells are tried:
//!
//! ```text
//!   the outside leaks in between samples ──────────────────► cells of 2, 3, 4 times the side: the first that seals
//!   they are too wide for slots, fins or shells ───────────► finer cells, as far as the samples and FINER_CELLS allow
//! ```

use std::ops::Range;

use crate::error::Result;
use crate::grid::Cell;
use crate::grid::context::Context;
use crate::grid::occupancy::Occupancy;
use crate::solid::parted::{Parted, SEALED};
use crate::solid::sign;
use crate::solid::sign::{Signed, WallCount};

/// The side of the cells that the field is looked for on, in sampling distances, at the least.
pub(crate) const COARSE: f64 = 1.1;

/// The outside leaks through walls if one place in so many is sparse: of fins and of sheets without gaps up to .09 of the places are, of bodies that need coarser cells .16
/// and more.
const SPARSE: u64 = 8;

/// The side of a cell in sampling distances, from how many occupied cells there are for each one twice as large. Of samples at random on a surface that is
/// q = exp(-r²/1.5) of its cells empty by chance, 4 / ((1 + q) (1 + q²)).
pub(crate) fn side_in_samples(filling: f64) -> f64 {
    const TABLE: [(f64, f64); 11] = [
        (1.0, 0.1),
        (1.09, 0.3),
        (1.26, 0.5),
        (1.45, 0.65),
        (1.70, 0.8),
        (2.09, 1.0),
        (2.52, 1.2),
        (2.73, 1.3),
        (3.11, 1.5),
        (3.72, 2.0),
        (4.0, 3.0),
    ];
    let above = TABLE.iter().position(|(f, _)| *f > filling).unwrap_or(TABLE.len() - 1).max(1);
    let ((f0, r0), (f1, r1)) = (TABLE[above - 1], TABLE[above]);
    r0 + (r1 - r0) * ((filling - f0) / (f1 - f0)).clamp(0.0, 1.0)
}

/// The least factor that the sampling allows, where the side of a grid's cell is `side` sampling distances.
pub(super) fn least_sampled(side: f64, cells: Cell) -> u32 {
    let longest = cells.into_iter().max().unwrap_or(1);
    (COARSE / side).ceil().min(f64::from(longest / 8).max(1.0)) as u32
}

/// Cells of the level in pieces without a side: with so many, its walls cut slots or fins to pieces.
const PIECES: usize = 100;

/// If the part of walls that are double is larger by this on finer cells, walls were taken together for one: of edges the part falls.
const MORE_DOUBLES: f64 = 0.02;

/// If this part of the walls is thick, walls were taken together for one. Of bodies whose walls lie three cells apart one in fifty is, of two layers two cells apart one in twenty-five.
const MANY_THICK: f64 = 0.03;

/// The most cells of a finer level, padding included: its field takes about 35 bytes for each.
const FINER_CELLS: u64 = 6_500_000;

/// For a plan, one cell in so many is a wall.
const MOST_WALLS: u64 = 6;

/// The level that was chosen.
#[derive(Debug)]
pub(super) struct Level {
    /// The sides of its cells.
    pub signed: Signed,
    /// How many of the grid's cells are taken together along every axis.
    pub factor: u32,
    /// Whether its cells are too wide for slots, fins or shells, and samples or room are too few for finer ones.
    pub is_too_wide: bool,
}

impl Level {
    /// Finds the level for these cells, and the sides on it. `sampled` is the least factor that their sampling allows; `signed` finds the sides for a factor.
    ///
    /// # Errors
    /// [`crate::Error::Budget`] if finer cells are needed and take more than the budget has; those of `signed`; [`crate::Error::Io`]; [`crate::Error::Interrupted`].
    pub(super) fn find(
        occupancy: &Occupancy,
        sampled: u32,
        signed: &mut dyn FnMut(u32) -> Result<Signed>,
        context: &Context,
    ) -> Result<Level> {
        let cells = occupancy.cells;
        let longest = cells.into_iter().max().unwrap_or(1);
        let first = Level::at(sampled.max(sign::least_factor(cells, sign::LONGEST)), signed)?;
        if first.leaks() {
            let coarser = [2, 3, 4].map(|times| times * first.factor);
            for factor in coarser.into_iter().filter(|factor| longest / factor >= 16) {
                let found = Level::at(factor, signed)?;
                if Parted::of(&found.signed, factor, None).is_sealed() {
                    // What seals may be two walls that are taken for one.
                    if first.is_too_wide || found.is_too_wide {
                        break;
                    }
                    return Ok(found);
                }
            }
        }
        let finest = sampled.max(sign::least_factor(cells, sign::FINER_LONGEST));
        if finest >= first.factor {
            return Ok(first);
        }
        let walls = WallCount::of(occupancy, finest, context)?;
        let is_too_wide =
            first.is_too_wide || first.misses_walls(walls) || 2 * first.signed.doubles >= first.signed.walls;
        let first = Level { is_too_wide, ..first };
        let Some(factor) = finer(cells, finest..first.factor).filter(|_| is_too_wide) else { return Ok(first) };
        let bytes = sign::bytes_of_level(cells, factor, walls.occupied, context.workers.threads());
        let held = first.signed.sides.len() as u64;
        context.memory.require(bytes + held, "telling the walls of narrow slots or shells apart")?;
        let found = Level::at(factor, signed)?;
        if found.leaks() || !found.parts_as_well(&first) {
            return Ok(first);
        }
        Ok(Level { is_too_wide: found.is_too_wide || found.misses_walls(walls), ..found })
    }

    /// A level, judged by itself.
    ///
    /// # Errors
    /// Those of `signed`.
    pub(super) fn at(factor: u32, signed: &mut dyn FnMut(u32) -> Result<Signed>) -> Result<Level> {
        let signed = signed(factor)?;
        let is_too_wide = signed.thick as f64 > MANY_THICK * signed.walls as f64;
        Ok(Level { signed, factor, is_too_wide })
    }

    /// Whether the outside gets in where the sampling is uneven, as the cells are too fine for a part of it. Slots that are filled only fill more on coarser ones, and so
    /// does the air between thin fins, which have the outside on both sides though their samples lie close enough.
    fn leaks(&self) -> bool {
        let signed = &self.signed;
        let many = !signed.open.is_empty() || SEALED * signed.part_outside >= signed.walls;
        let [all, sparse] = signed.where_outside;
        many && SPARSE * sparse >= all
    }

    /// Whether the walls part as well as on another level: few of them part nothing, and few are thick, or no more of them than there. Of two layers of points that do not fit, finer cells
    /// make walls within a body. Where they are still as wide as slots, some slots are a wall and some are not, which is worse than none.
    fn parts_as_well(&self, other: &Level) -> bool {
        let nothing = |level: &Level| part(level.signed.part_nothing, level.signed.walls);
        let thick = |level: &Level| part(level.signed.thick, level.signed.walls);
        let parts = SEALED * self.signed.part_nothing < self.signed.walls || nothing(self) <= nothing(other);
        parts && (thick(self) <= MANY_THICK || thick(self) <= thick(other))
    }

    /// Whether finer cells, whose walls are `finer`, show slots, fins or shells that these cells do not.
    fn misses_walls(&self, finer: WallCount) -> bool {
        let here = part(self.signed.doubles, self.signed.walls);
        self.signed.pieces >= PIECES || part(finer.doubles, finer.walls) > here + MORE_DOUBLES
    }
}

fn part(of: u64, walls: u64) -> f64 {
    of as f64 / walls.max(1) as f64
}

/// The first of these factors whose level is small enough.
fn finer(cells: Cell, mut factors: Range<u32>) -> Option<u32> {
    factors.find(|factor| sign::cells_of_level(cells, *factor) <= FINER_CELLS)
}

/// The most memory that finer cells take, in bytes, for a plan: they are only asked for where there are narrow slots or shells.
pub(crate) fn bytes_of_finer(cells: Cell) -> u64 {
    let [finest, first] = [sign::FINER_LONGEST, sign::LONGEST].map(|longest| sign::least_factor(cells, longest));
    let bytes = |factor: u32| sign::bytes_of_level(cells, factor, sign::cells_of_level(cells, factor) / MOST_WALLS, 1);
    finer(cells, finest..first).map_or(0, bytes)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::test_runner::{RngAlgorithm, TestRng};
    use rand::RngExt;

    use super::*;
    use crate::grid::slice::{Bits, Runs};
    use crate::run::testing::with_context;
    use crate::settings::closing::Sealing;
    use crate::solid::close::{ClosingOptions, How, close};
    use crate::solid::sign::Seen;

    /// All cells count, and the field tells the sides.
    const ASKED: ClosingOptions =
        ClosingOptions { seal: Sealing::Auto, window: None, keep_outliers: true, min_component: None, rough: false };

    /// Cells of points at random on a sphere, of which one half has so many times fewer.
    fn sphere(cells: Cell, points: usize, sparser: f64, numbers: &mut TestRng) -> BTreeSet<Cell> {
        let [middle, radius] = [f64::from(cells[0]) / 2.0, f64::from(cells[0]) / 2.0 - 3.0];
        let mut out = BTreeSet::new();
        for _ in 0..points {
            let way: [f64; 3] = loop {
                let way: [f64; 3] = std::array::from_fn(|_| numbers.random_range(-1.0..1.0));
                let length = way.iter().map(|c| c * c).sum::<f64>().sqrt();
                if (0.1..1.0).contains(&length) {
                    break way.map(|c| c / length);
                }
            };
            if way[0] < 0.0 || numbers.random_range(0.0..1.0) * sparser < 1.0 {
                out.insert(way.map(|c| (middle + radius * c) as u32));
            }
        }
        out
    }

    /// Cells of points at random on boxes within each other, whose half sides are these, turned: cells of 1.37 sampling distances.
    fn boxes(cells: Cell, halves: &[[f64; 3]], turn: Turn, numbers: &mut TestRng) -> BTreeSet<Cell> {
        let mut out = BTreeSet::new();
        for half in halves {
            for a in 0..3 {
                let [b, c] = [(a + 1) % 3, (a + 2) % 3];
                for _ in 0..(2.0 * 1.88 * 4.0 * half[b] * half[c]) as usize {
                    let mut p = half.map(|half| numbers.random_range(-half..half));
                    p[a] = half[a] * f64::from(numbers.random_range(0..2)).mul_add(2.0, -1.0);
                    out.insert(turn.place(p, cells));
                }
            }
        }
        out
    }

    /// Turned about x, then a little about y.
    #[derive(Debug, Clone, Copy)]
    struct Turn([f64; 2]);

    impl Turn {
        fn place(self, [x, y, z]: [f64; 3], cells: Cell) -> Cell {
            let [(s, c), (t, d)] = self.0.map(f64::sin_cos);
            let [y, z] = [c * y - s * z, s * y + c * z];
            let turned = [d * x + t * z, y, d * z - t * x];
            std::array::from_fn(|a| (turned[a] + f64::from(cells[a]) / 2.0) as u32)
        }
    }

    /// What the field says on a level, as docs/algorithm.md has it, section 5.6: whether the outside leaks in, and whether it is sealed.
    fn judged(signed: &Signed) -> [bool; 2] {
        let in_fifty = |number: u64| number * 50 >= signed.walls;
        let sparse = 8 * signed.where_outside[1] >= signed.where_outside[0];
        let leaks = sparse && (!signed.open.is_empty() || in_fifty(signed.part_outside));
        let sealed = signed.open.is_empty() && signed.filled.is_empty() && !in_fifty(signed.part_nothing);
        [leaks, sealed]
    }

    /// The level, as that section has it: its factor, and what its walls part.
    fn named(occupied: &BTreeSet<Cell>, cells: Cell, context: &Context) -> (u32, Parted) {
        let occupancy = Occupancy::of_cells(occupied.iter().copied(), cells, context).unwrap();
        let halves: BTreeSet<Cell> = occupied.iter().map(|cell| cell.map(|c| c / 2)).collect();
        let side = side_in_samples(occupied.len() as f64 / halves.len() as f64);
        let longest = cells.into_iter().max().unwrap();
        let sampled = (1.1 / side).ceil() as u32;
        let factor = sampled.max(longest.div_ceil(128));
        let found = |factor| Signed::find(Seen::of(&occupancy, factor, context).unwrap(), context).unwrap();
        let is_thick = |signed: &Signed| signed.thick as f64 > 0.03 * signed.walls as f64;
        let parted = |signed: Signed, factor, is_too_wide: bool| {
            let too_wide = (is_too_wide || is_thick(&signed)).then_some(factor);
            (factor, Parted { too_wide, ..Parted::of(&signed, factor, None) })
        };
        let first = found(factor);
        let leaks = judged(&first)[0];
        for coarser in
            [2, 3, 4].map(|times| times * factor).into_iter().filter(|factor| leaks && longest / factor >= 16)
        {
            let found = found(coarser);
            if judged(&found)[1] {
                if is_thick(&first) || is_thick(&found) {
                    break;
                }
                return parted(found, coarser, false);
            }
        }
        let finest = sampled.max(longest.div_ceil(256));
        if finest >= factor {
            return parted(first, factor, false);
        }
        let counted = WallCount::of(&occupancy, finest, context).unwrap();
        let misses_walls = |signed: &Signed| {
            let rise = counted.doubles as f64 / counted.walls as f64 - signed.doubles as f64 / signed.walls as f64;
            signed.pieces >= 100 || rise > 0.02
        };
        if !misses_walls(&first) && !is_thick(&first) && first.doubles * 2 < first.walls {
            return parted(first, factor, false);
        }
        let room =
            |factor: &u32| cells.map(|c| u64::from(c.div_ceil(*factor) + 8)).iter().product::<u64>() <= 6_500_000;
        if let Some(finer) = (finest..factor).find(room) {
            let found = found(finer);
            let part = |signed: &Signed, of: u64| of as f64 / signed.walls as f64;
            let nothing = [&found, &first].map(|signed| part(signed, signed.part_nothing));
            let thick = [&found, &first].map(|signed| part(signed, signed.thick));
            let parts = nothing[0] * 50.0 < 1.0 || nothing[0] <= nothing[1];
            let is_thicker = thick[0] > 0.03 && thick[0] > thick[1];
            if !judged(&found)[0] && parts && !is_thicker {
                let is_too_wide = misses_walls(&found);
                return parted(found, finer, is_too_wide);
            }
        }
        parted(first, factor, true)
    }

    #[test]
    #[ignore = "exhaustive"]
    fn the_level_that_is_taken_is_the_one_that_the_rule_names() {
        let mut clouds = Vec::new();
        for seed in 0..8u8 {
            let mut numbers = TestRng::from_seed(RngAlgorithm::ChaCha, &[seed; 32]);
            let sparser = [1.0, 4.0, 9.0, 16.0][usize::from(seed) % 4];
            clouds.push(([96; 3], sphere([96; 3], 60_000, sparser, &mut numbers)));
        }
        for seed in 0..6u8 {
            let mut numbers = TestRng::from_seed(RngAlgorithm::ChaCha, &[seed; 32]);
            let void = [3.0, 4.0, 0.0][usize::from(seed) % 3];
            let (cells, shell, thick) =
                [([150, 70, 70], 6.0, 20.0), ([300, 100, 100], 9.0, 32.0)][usize::from(seed) / 3];
            let long = f64::from(cells[0]) / 2.0 - 10.0;
            let halves = [0.0, shell, shell + void].map(|in_from| [long, thick, thick].map(|half| half - in_from));
            let turn = Turn([numbers.random_range(-0.4..0.4), numbers.random_range(-0.05..0.05)]);
            clouds.push((cells, boxes(cells, &halves[..if void > 0.0 { 3 } else { 1 }], turn, &mut numbers)));
        }
        let mut taken = BTreeSet::new();
        for (number, (cells, occupied)) in clouds.into_iter().enumerate() {
            with_context(cells, |context| {
                let (factor, expected) = named(&occupied, cells, context);
                taken.insert((cells[0], factor));
                let occupancy = Occupancy::of_cells(occupied, cells, context).unwrap();
                let closed = close(occupancy, 1.0, ASKED, context, |_, _| ()).unwrap();
                assert_eq!(closed.how, How::Sign(expected), "cloud {number}");
            });
        }
        let factors = |cells: u32| taken.iter().filter(|(of, _)| *of == cells).count();
        assert!([96, 150, 300].map(factors).iter().all(|count| *count > 1), "always the same level: {taken:?}");
    }

    #[test]
    #[ignore = "exhaustive"]
    fn what_lies_in_a_narrow_void_of_a_long_body_stays_apart_from_it() {
        let cells = [150, 70, 70];
        for seed in 0..8u8 {
            let mut numbers = TestRng::from_seed(RngAlgorithm::ChaCha, &[seed; 32]);
            let void = numbers.random_range(2.8..4.0);
            let shell = numbers.random_range(5.0..8.0);
            let halves = [0.0, shell, shell + void].map(|in_from| [65.0 - in_from, 20.0 - in_from, 20.0 - in_from]);
            let turn = Turn([numbers.random_range(-0.4..0.4), numbers.random_range(-0.05..0.05)]);
            let occupied = boxes(cells, &halves, turn, &mut numbers);
            with_context(cells, |context| {
                let occupancy = Occupancy::of_cells(occupied, cells, context).unwrap();
                let solid = close(occupancy, 1.0, ASKED, context, |_, _| ()).unwrap().solid;
                let (mut bits, mut runs) = (Bits::new(150, 70), Runs::default());
                let mut is_solid = |p: [f64; 3]| {
                    let [x, y, z] = turn.place(p, cells).map(i64::from);
                    solid.store.paint(y, &mut bits, &mut runs).unwrap();
                    bits.get(x, z)
                };
                // Across the shell, the void and the body, away from the void's edges.
                let [mut voids, mut bodies] = [0, 0];
                for step in 0..200 {
                    let [x, y] = [numbers.random_range(-50.0..50.0), numbers.random_range(-8.0..8.0)];
                    let z = if step % 2 == 0 { 20.0 } else { -20.0f64 };
                    let at = |depth: f64| [x, y, z - depth.copysign(z)];
                    voids += usize::from(!is_solid(at(shell + void / 2.0)));
                    bodies += usize::from(is_solid(at(shell / 2.0)) && is_solid(at(shell + void + 3.0)));
                }
                assert!(voids >= 190 && bodies >= 198, "seed {seed}: {voids}, {bodies} of 200");
            });
        }
    }
}
