//! The winding number on a lattice round the points: where it is ½ lies the surface, and the lattice's inside tells how many pieces and handles that has.
//!
//! ```text
//!   . . . . . . . .      blocks of 4×4×4 vertices, those near points first; the surface is
//!   . . . + + . . .      followed from block to block where it leaves them. What is left is
//!   . + + # # + . .      inside or outside as a whole, and no sum is formed there.
//!   . + # # # + . .      + crossing: an edge of the lattice with ½ between its ends
//! ```

use std::collections::BTreeSet;

use super::dipoles::Dipoles;
use super::sums::{LANES, Terms, Vector, bin_of, lanes, winding};
use crate::error::Result;
use crate::resources::workers::Workers;

/// The lattice's edge, in sampling distances.
pub const EDGE: f32 = 0.3;

/// Vertices of a block along an axis, and in all.
const ALONG: usize = 4;
const VERTICES: usize = ALONG * ALONG * ALONG;

/// Widths of the kernel, the finer one first.
const WIDTHS: [f32; 2] = [0.4, 0.7];

/// What counts as inside: from this winding number on, with this width.
const INSIDES: [(usize, f32); 4] = [(0, 0.5), (1, 0.5), (1, 0.35), (1, 0.65)];

/// How far from points blocks are looked at in any case.
const ROUND: f32 = 1.0;

/// So many blocks are looked at for each point at most: twice as many as a surface without folds has.
const BLOCKS_OF_POINT: usize = 6;

/// So many blocks the box has at most.
const MOST_BLOCKS: usize = 200_000;

/// Winding numbers so near to ½ may lie beside the surface.
const UNSURE: f32 = 0.2;

/// A block's vertices: the winding number of the finer kernel, and what is inside, a bit each.
#[derive(Debug, Clone)]
struct Block {
    values: [f32; VERTICES],
    inside: [u64; INSIDES.len()],
}

/// What the lattice shows.
#[derive(Debug)]
pub struct Shown {
    /// Where the surface crosses the lattice, one place for each cube of each side that was asked for.
    pub crossings: Vec<Vec<Vector>>,
    /// The Euler number of the inside, by each of [`INSIDES`].
    pub characteristic: [i64; INSIDES.len()],
}

/// Bytes of looking round so many points, at most.
pub fn bytes(points: u64) -> u64 {
    // Vectors and sets that grow have room for twice as much.
    let of_block = size_of::<Block>() + 2 * (size_of::<Box<Block>>() + 2 * size_of::<[i32; 3]>());
    // A number, the bits, whether these are known, and those that are to be gone on from.
    let of_box = size_of::<u32>() + size_of::<u64>() + size_of::<bool>() + 2 * size_of::<u32>();
    points * (BLOCKS_OF_POINT * of_block) as u64 + (MOST_BLOCKS * of_box) as u64
}

/// Blocks in a box, looked at or not.
struct Lattice<'a> {
    dipoles: &'a Dipoles,
    low: [i32; 3],
    size: [usize; 3],
    /// The number of each block that was looked at, plus 1.
    numbers: Vec<u32>,
    #[expect(clippy::vec_box, reason = "the vector grows, and blocks are large")]
    blocks: Vec<Box<Block>>,
}

/// Looks at the winding number round the points; nothing if the surface goes too far from them.
pub fn look(dipoles: &Dipoles, spaced: &[f32], workers: &Workers) -> Result<Option<Shown>> {
    let side = EDGE * ALONG as f32;
    let mut asked = BTreeSet::new();
    for point in &dipoles.bins.points {
        let [low, high] = [-ROUND, ROUND].map(|off| point.map(|c| ((c + off) / side).floor() as i32));
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                asked.extend((low[0]..=high[0]).map(|x| [x, y, z]));
            }
        }
    }
    let (low, high) = asked.iter().fold(([i32::MAX; 3], [i32::MIN; 3]), |(low, high), key| {
        (std::array::from_fn(|a| low[a].min(key[a])), std::array::from_fn(|a| high[a].max(key[a])))
    });
    // The border of the box is outside.
    let low = low.map(|c| c - 2);
    let size: [usize; 3] = std::array::from_fn(|a| (high[a] + 3 - low[a]) as usize);
    let all = size.iter().try_fold(1usize, |all, cells| all.checked_mul(*cells)).filter(|all| *all <= MOST_BLOCKS);
    let Some(all) = all else { return Ok(None) };
    let most = BLOCKS_OF_POINT * dipoles.bins.points.len();
    let mut lattice = Lattice { dipoles, low, size, numbers: vec![0; all], blocks: Vec::new() };
    let mut next: Vec<[i32; 3]> = asked.into_iter().collect();
    while !next.is_empty() {
        if lattice.blocks.len() + next.len() > most {
            return Ok(None);
        }
        lattice.look_at(&next, workers)?;
        let followed: BTreeSet<[i32; 3]> = next.iter().flat_map(|key| lattice.beyond(*key)).collect();
        if followed.iter().any(|key| lattice.is_border(*key)) {
            return Ok(None);
        }
        next = followed.into_iter().collect();
    }
    let characteristic = std::array::from_fn(|which| lattice.characteristic(&lattice.filled(which)));
    let crossings = spaced.iter().map(|side| lattice.crossings(*side)).collect();
    Ok(Some(Shown { crossings, characteristic }))
}

impl Lattice<'_> {
    fn index(&self, key: [i32; 3]) -> usize {
        let [x, y, z] = std::array::from_fn(|a| (key[a] - self.low[a]) as usize);
        (z * self.size[1] + y) * self.size[0] + x
    }

    fn key(&self, index: usize) -> [i32; 3] {
        let at = [index % self.size[0], index / self.size[0] % self.size[1], index / (self.size[0] * self.size[1])];
        std::array::from_fn(|a| self.low[a] + at[a] as i32)
    }

    fn keys(&self) -> impl Iterator<Item = [i32; 3]> {
        (0..self.numbers.len()).map(|index| self.key(index))
    }

    fn is_border(&self, key: [i32; 3]) -> bool {
        (0..3).any(|a| key[a] <= self.low[a] || key[a] >= self.low[a] + self.size[a] as i32 - 1)
    }

    /// The block with a key, if it was looked at.
    fn block(&self, key: [i32; 3]) -> Option<&Block> {
        self.numbers[self.index(key)].checked_sub(1).map(|number| &*self.blocks[number as usize])
    }

    /// Forms the sums at the vertices of blocks.
    fn look_at(&mut self, keys: &[[i32; 3]], workers: &Workers) -> Result<()> {
        const OF_JOB: usize = 32;
        let dipoles = self.dipoles;
        let far = dipoles.bins.far(&dipoles.values);
        let of_job = |job: usize| {
            let (mut found, mut terms) = (Vec::new(), Terms::default());
            for key in keys.iter().skip(job * OF_JOB).take(OF_JOB) {
                let middle = key.map(|k| (k as f32 + 0.5) * EDGE * ALONG as f32);
                dipoles.bins.terms(bin_of(middle), &dipoles.values, &far, &mut terms);
                let mut block = Box::new(Block { values: [0.0; VERTICES], inside: [0; INSIDES.len()] });
                for first in (0..VERTICES).step_by(LANES) {
                    let places: [Vector; LANES] = std::array::from_fn(|lane| place_of(*key, first + lane));
                    let at = lanes(&places);
                    let sums = WIDTHS.map(|width| winding(&at, &terms, width));
                    block.values[first..first + LANES].copy_from_slice(&sums[0]);
                    for (bits, (width, least)) in block.inside.iter_mut().zip(INSIDES) {
                        for (lane, sum) in sums[width].iter().enumerate() {
                            *bits |= u64::from(*sum > least) << (first + lane);
                        }
                    }
                }
                found.push(block);
            }
            Ok(found)
        };
        let mut at = self.blocks.len() as u32;
        let blocks = &mut self.blocks;
        workers.in_order_range(
            2 * workers.threads(),
            keys.len().div_ceil(OF_JOB),
            of_job,
            |found: Vec<Box<Block>>| {
                blocks.extend(found);
                Ok(())
            },
        )?;
        for key in keys {
            at += 1;
            let index = self.index(*key);
            self.numbers[index] = at;
        }
        Ok(())
    }

    /// The blocks beside one into which the surface may go on, and that were not looked at.
    fn beyond(&self, key: [i32; 3]) -> Vec<[i32; 3]> {
        let block = self.block(key).expect("it was looked at");
        let mut found = Vec::new();
        for (there, axis, layer) in beside(key).filter(|(there, ..)| self.block(*there).is_none()) {
            let values = || layer_of(axis, layer).map(|vertex| block.values[vertex]);
            let inside = values().filter(|value| *value > 0.5).count();
            let is_mixed = inside > 0 && inside < ALONG * ALONG;
            if is_mixed || values().any(|value| (value - 0.5).abs() < UNSURE) {
                found.push(there);
            }
        }
        found
    }

    /// The bits of all blocks of the box: what was not looked at is as the layer beside it that was.
    fn filled(&self, which: usize) -> Vec<u64> {
        let mut bits = vec![0; self.numbers.len()];
        let mut known: Vec<bool> = self.numbers.iter().map(|number| *number > 0).collect();
        let mut reached: Vec<u32> = Vec::new();
        let mut reach = |there: [i32; 3], reached: &mut Vec<u32>| {
            let index = self.index(there);
            if !self.is_border(there) && !std::mem::replace(&mut known[index], true) {
                reached.push(index as u32);
            }
        };
        for key in self.keys() {
            let Some(block) = self.block(key) else { continue };
            bits[self.index(key)] = block.inside[which];
            for (there, axis, layer) in beside(key) {
                let first = layer_of(axis, layer).next().expect("a layer has vertices");
                if block.inside[which] >> first & 1 == 1 {
                    reach(there, &mut reached);
                }
            }
        }
        while let Some(index) = reached.pop() {
            bits[index as usize] = u64::MAX;
            for (there, ..) in beside(self.key(index as usize)) {
                reach(there, &mut reached);
            }
        }
        bits
    }

    /// The Euler number of what is inside: vertices − edges + squares − cubes.
    fn characteristic(&self, bits: &[u64]) -> i64 {
        let mut sum = 0;
        for key in self.keys().filter(|key| !self.is_border(*key)) {
            // The block, and those beside it at greater indices.
            let near: [u64; 8] = std::array::from_fn(|i| {
                let offset = [i & 1, i >> 1 & 1, i >> 2];
                bits[self.index(std::array::from_fn(|a| key[a] + offset[a] as i32))]
            });
            if near.iter().all(|bits| *bits == 0) || near.iter().all(|bits| *bits == u64::MAX) {
                continue;
            }
            let is_inside = |at: [usize; 3]| {
                let beyond: usize = (0..3).map(|a| (at[a] / ALONG) << a).sum();
                near[beyond] >> vertex_of(at.map(|c| c % ALONG)) & 1 == 1
            };
            for vertex in 0..VERTICES {
                let at = at_of(vertex);
                let corners: u32 = (0..8u32)
                    .filter(|i| is_inside(std::array::from_fn(|a| at[a] + (*i as usize >> a & 1))))
                    .map(|i| 1 << i)
                    .sum();
                sum +=
                    CUBES.iter().filter(|(needed, _)| corners & needed == *needed).map(|(_, sign)| sign).sum::<i64>();
            }
        }
        sum
    }

    /// Where the surface crosses edges of the lattice: the first place in each cube of this side.
    fn crossings(&self, spaced: f32) -> Vec<Vector> {
        let (mut found, mut taken) = (Vec::new(), BTreeSet::new());
        for key in self.keys() {
            let Some(block) = self.block(key) else { continue };
            for vertex in 0..VERTICES {
                for axis in 0..3 {
                    let mut at = at_of(vertex);
                    at[axis] += 1;
                    let mut there = key;
                    there[axis] += i32::from(at[axis] == ALONG);
                    at[axis] %= ALONG;
                    let Some(other) = self.block(there) else { continue };
                    let (here, beyond) = (block.values[vertex], other.values[vertex_of(at)]);
                    if (here > 0.5) == (beyond > 0.5) {
                        continue;
                    }
                    let mut place = place_of(key, vertex);
                    place[axis] += EDGE * (0.5 - here) / (beyond - here);
                    if taken.insert(place.map(|c| (c / spaced).floor() as i32)) {
                        found.push(place);
                    }
                }
            }
        }
        found
    }
}

/// The corners that a vertex, an edge, a square and a cube have, which begin at corner 0, as bits; and what each counts.
const CUBES: [(u32, i64); 8] =
    [(1, 1), (0b11, -1), (0b101, -1), (0b1_0001, -1), (0b1111, 1), (0b11_0011, 1), (0b101_0101, 1), (0xff, -1)];

fn at_of(vertex: usize) -> [usize; 3] {
    [vertex % ALONG, vertex / ALONG % ALONG, vertex / (ALONG * ALONG)]
}

fn vertex_of([x, y, z]: [usize; 3]) -> usize {
    (z * ALONG + y) * ALONG + x
}

/// The blocks that share a side with one, each with the axis across that side and the layer at it.
fn beside(key: [i32; 3]) -> impl Iterator<Item = ([i32; 3], usize, usize)> {
    (0..3).flat_map(move |axis| {
        [(-1, 0), (1, ALONG - 1)].map(|(step, layer)| {
            let mut there = key;
            there[axis] += step;
            (there, axis, layer)
        })
    })
}

/// The vertices of a layer across an axis.
fn layer_of(axis: usize, layer: usize) -> impl Iterator<Item = usize> {
    (0..VERTICES).filter(move |vertex| at_of(*vertex)[axis] == layer)
}

/// Where a vertex of a block lies.
fn place_of(key: [i32; 3], vertex: usize) -> Vector {
    let at = at_of(vertex);
    std::array::from_fn(|a| (key[a] * ALONG as i32 + at[a] as i32) as f32 * EDGE)
}
