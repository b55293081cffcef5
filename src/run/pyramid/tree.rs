//! Which tile each triangle of each level belongs to.
//!
//! Space is a quadtree or an octree over the mesh's box, and a triangle belongs to the cell that its middle lies in. A tile is a level and some cells, mostly
//! one. On the way down from the coarsest level, a tile's cells stay as they are where the next level has few enough triangles in them, and are divided
//! where it has more. So all tiles of all levels are of about the same size.
//!
//! A tile has other triangles of its level, too: all that come as near to its cells as the level is from the mesh. Whatever level stands beside it, the two overlap.
//!
//! A coarse triangle's middle may lie in a cell where no finer one has any, and the other way round. A tile must not be without triangles, or those below it: such a
//! cell goes with the nearest that has some.

/// The most triangles of a tile.
pub const MOST: u64 = if cfg!(test) { 1 << 10 } else { 1 << 16 };
/// A part with fewer than this goes with its neighbour.
const FEW: u64 = MOST / 16;

/// Cells of space.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Division {
    /// By x and y.
    Quadtree,
    /// By all three.
    Octree,
}

impl Division {
    /// Axes that it divides.
    fn axes(self) -> u32 {
        match self {
            Division::Quadtree => 2,
            Division::Octree => 3,
        }
    }

    /// How often a cell is halved at the most. Counts of the smallest cells take 8 MiB.
    pub fn depth(self) -> u32 {
        match self {
            Division::Quadtree => 10,
            Division::Octree => 7,
        }
    }

    /// The number of smallest cells.
    pub fn cells(self) -> usize {
        1 << (self.axes() * self.depth())
    }

    /// The smallest cell that a place lies in, of a cube from `low` with this side, along each axis that is divided.
    pub fn smallest(self, place: [f64; 3], low: [f64; 3], side: f64) -> [u32; 3] {
        let most = (1u32 << self.depth()) - 1;
        let along = |axis: usize| (place[axis] - low[axis]) / side * f64::from(most + 1);
        std::array::from_fn(|axis| match axis < self.axes() as usize {
            true => along(axis).floor().clamp(0.0, f64::from(most)) as u32,
            false => 0,
        })
    }

    /// The code of a smallest cell: bits of the axes in turn.
    pub fn code(self, smallest: [u32; 3]) -> u32 {
        let mut code = 0;
        for (axis, along) in (0..self.axes()).zip(smallest) {
            for bit in 0..self.depth() {
                code |= (along >> bit & 1) << (bit * self.axes() + axis);
            }
        }
        code
    }

    /// The first and the last of a cell's smallest cells along each axis.
    fn corners(self, cell: Cell) -> [[u32; 3]; 2] {
        let (first, end) = self.range(cell);
        [first, end - 1].map(|code| {
            let along = |axis: u32| {
                let bit = |bit| (code >> (bit * self.axes() + axis) & 1) << bit;
                (0..self.depth()).map(bit).sum()
            };
            std::array::from_fn(|axis| if axis < self.axes() as usize { along(axis as u32) } else { 0 })
        })
    }

    /// A cell's middle, doubled, in smallest cells.
    fn middle(self, cell: Cell) -> [i64; 3] {
        let [low, high] = self.corners(cell);
        std::array::from_fn(|axis| i64::from(low[axis]) + i64::from(high[axis]))
    }

    /// The codes of a cell's smallest cells: from the first to before the second.
    fn range(self, cell: Cell) -> (u32, u32) {
        let shift = self.axes() * (self.depth() - cell.depth);
        (cell.code << shift, (cell.code + 1) << shift)
    }

    fn parts(self, cell: Cell) -> impl Iterator<Item = Cell> {
        let (depth, axes) = (cell.depth + 1, self.axes());
        (0..1 << axes).map(move |part| Cell { depth, code: cell.code << axes | part })
    }
}

/// A cell of the tree.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cell {
    /// How often the whole was halved.
    depth: u32,
    code: u32,
}

/// How many triangles a level has in each smallest cell where it has some.
#[derive(Debug)]
pub struct Counts {
    codes: Vec<u32>,
    /// Triangles up to there, that cell's included.
    sums: Vec<u64>,
}

impl Counts {
    /// Of the counts of all smallest cells.
    pub fn of(counts: &[u32]) -> Counts {
        let there = || counts.iter().enumerate().filter(|(_, count)| **count > 0);
        let mut out = Counts { codes: Vec::with_capacity(there().count()), sums: Vec::with_capacity(there().count()) };
        let mut sum = 0;
        for (code, count) in there() {
            sum += u64::from(*count);
            out.codes.push(code as u32);
            out.sums.push(sum);
        }
        out
    }

    fn within(&self, (first, end): (u32, u32)) -> u64 {
        let upto = |code| match self.codes.partition_point(|c| *c < code) {
            0 => 0,
            cells => self.sums[cells - 1],
        };
        upto(end) - upto(first)
    }
}

/// A tile.
#[derive(Debug, Clone)]
pub struct Tile {
    /// The level whose triangles it has; 0 is the finest.
    pub level: usize,
    /// The cells they lie in.
    cells: Vec<Cell>,
    /// The numbers of the tiles that take its place.
    pub children: Vec<usize>,
}

/// All tiles.
#[derive(Debug)]
pub struct Tree {
    division: Division,
    /// Those of coarser levels first.
    pub tiles: Vec<Tile>,
    /// How many there are of the coarsest level; they are the first.
    pub tops: usize,
}

impl Tree {
    /// The tiles of levels with so many triangles in their cells, the finest level first.
    pub fn of(division: Division, counts: &[Counts]) -> Tree {
        let divide = Divide { division, counts };
        let whole = vec![Cell { depth: 0, code: 0 }];
        let top = counts.len() - 1;
        let tile = |level: usize| move |cells: Vec<Cell>| Tile { level, cells, children: Vec::new() };
        let mut tiles: Vec<Tile> = divide.divided(whole, top).into_iter().map(tile(top)).collect();
        let tops = tiles.len();
        let mut above = 0..tops;
        for level in (0..top).rev() {
            let first = tiles.len();
            for number in above {
                let below = divide.divided(tiles[number].cells.clone(), level);
                tiles[number].children = (tiles.len()..tiles.len() + below.len()).collect();
                tiles.extend(below.into_iter().map(tile(level)));
            }
            above = first..tiles.len();
        }
        Tree { division, tiles, tops }
    }

    /// How space is divided.
    pub fn division(&self) -> Division {
        self.division
    }

    /// What tells the tile of each of a level's triangles.
    pub fn places(&self, level: usize) -> Places {
        let tiles = self.tiles.iter().enumerate().filter(|(_, tile)| tile.level == level);
        let ranges =
            tiles.flat_map(|(number, tile)| tile.cells.iter().map(move |cell| (self.division.range(*cell), number)));
        let mut ranges: Vec<((u32, u32), usize)> = ranges.collect();
        ranges.sort_unstable();
        Places { division: self.division, ranges }
    }
}

/// The tiles of one level, by the codes of their cells.
#[derive(Debug)]
pub struct Places {
    division: Division,
    ranges: Vec<((u32, u32), usize)>,
}

impl Places {
    /// The tile of triangles in a smallest cell that has some.
    pub fn tile(&self, code: u32) -> usize {
        let at = self.ranges.partition_point(|((first, _), _)| *first <= code);
        let ((_, end), tile) = self.ranges[at.saturating_sub(1)];
        debug_assert!(code < end, "a cell with triangles belongs to a tile");
        tile
    }

    /// Adds the tiles with a cell in a box of smallest cells, from the first to the last along each axis; some more than once.
    pub fn within(&self, [low, high]: [[u32; 3]; 2], tiles: &mut Vec<usize>) {
        // Most boxes lie within one tile: their corners' codes begin alike, as all between them do.
        let [first, last] = [low, high].map(|corner| self.division.code(corner));
        let bits = (u32::BITS - (first ^ last).leading_zeros()).next_multiple_of(self.division.axes());
        let (start, end) = (first >> bits << bits, ((first >> bits) + 1) << bits);
        let at = self.ranges.partition_point(|((from, _), _)| *from <= start);
        if let Some(((_, to), tile)) = at.checked_sub(1).map(|at| self.ranges[at])
            && end <= to
        {
            return tiles.push(tile);
        }
        // Of long triangles through many tiles, whole cells are told at once.
        let mut waiting = vec![Cell { depth: 0, code: 0 }];
        while let Some(cell) = waiting.pop() {
            let [first, last] = self.division.corners(cell);
            if (0..3).any(|axis| last[axis] < low[axis] || high[axis] < first[axis]) {
                continue;
            }
            let (start, end) = self.division.range(cell);
            let from = self.ranges.partition_point(|((_, end), _)| *end <= start);
            let to = self.ranges.partition_point(|((first, _), _)| *first < end);
            let there = &self.ranges[from..to.max(from)];
            let is_inside = (0..3).all(|axis| low[axis] <= first[axis] && last[axis] <= high[axis]);
            match there {
                [] => {}
                [((first, last), tile)] if *first <= start && end <= *last => tiles.push(*tile),
                _ if is_inside => tiles.extend(there.iter().map(|(_, tile)| *tile)),
                _ => waiting.extend(self.division.parts(cell)),
            }
        }
    }
}

struct Divide<'a> {
    division: Division,
    counts: &'a [Counts],
}

impl Divide<'_> {
    fn count(&self, level: usize, cell: Cell) -> u64 {
        self.counts[level].within(self.division.range(cell))
    }

    /// Cells in groups, each of which has few enough triangles of a level if that can be, and some of each finer level.
    fn divided(&self, cells: Vec<Cell>, level: usize) -> Vec<Vec<Cell>> {
        let total = |cells: &[Cell]| cells.iter().map(|cell| self.count(level, *cell)).sum::<u64>();
        let mut done = Vec::new();
        let mut waiting = vec![cells];
        while let Some(mut cells) = waiting.pop() {
            if total(&cells) <= MOST {
                done.push(cells);
                continue;
            }
            let groups = loop {
                let finest = self.division.depth();
                if cells.iter().all(|cell| cell.depth == finest) {
                    break vec![cells];
                }
                let mut parts = Vec::new();
                for cell in cells {
                    match cell.depth < finest {
                        true => parts.extend(self.division.parts(cell)),
                        false => parts.push(cell),
                    }
                }
                parts.retain(|part| (0..=level).any(|level| self.count(level, *part) > 0));
                let groups = self.grouped(&parts, level);
                if groups.len() > 1 {
                    break groups;
                }
                cells = parts;
            };
            match groups.len() {
                1 => done.extend(groups),
                // The first comes next.
                _ => waiting.extend(groups.into_iter().rev()),
            }
        }
        done
    }

    /// A group for each part that can stand alone; the others go with the nearest of these. One group of all if there are none.
    fn grouped(&self, parts: &[Cell], level: usize) -> Vec<Vec<Cell>> {
        let standing = |least: u64| -> Vec<Cell> {
            let stands = |part: &&Cell| {
                self.count(level, **part) >= least && (0..level).all(|level| self.count(level, **part) > 0)
            };
            parts.iter().filter(stands).copied().collect()
        };
        let mut alone = standing(FEW);
        if alone.len() < 2 {
            alone = standing(1);
        }
        if alone.is_empty() {
            return vec![parts.to_vec()];
        }
        let mut groups: Vec<Vec<Cell>> = alone.iter().map(|cell| vec![*cell]).collect();
        for part in parts.iter().filter(|part| !alone.contains(part)) {
            let at = self.division.middle(*part);
            let apart = |cell: &Cell| {
                let middle = self.division.middle(*cell);
                (0..3).map(|a| (middle[a] - at[a]) * (middle[a] - at[a])).sum::<i64>()
            };
            let nearest = (0..alone.len()).min_by_key(|number| (apart(&alone[*number]), *number));
            groups[nearest.expect("there are some")].push(*part);
        }
        groups
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn every_cell_with_triangles_has_one_tile_and_every_tile_has_triangles(
            clusters in prop::collection::vec((0u32..1 << 20, 0u32..12, 1u32..20_000), 1..40),
            gone in prop::collection::vec(0usize..40, 0..20),
            octree: bool,
            at in prop::array::uniform3(0.0f64..1.0),
            size in prop::array::uniform3(0u32..40),
        ) {
            let division = if octree { Division::Octree } else { Division::Quadtree };
            let mut finest = vec![0u32; division.cells()];
            for (at, bits, count) in &clusters {
                for cell in 0..1u32 << bits {
                    finest[((at + cell) as usize) % division.cells()] += count >> (bits / 2);
                }
            }
            // A coarser level has a part of them, elsewhere in places.
            let mut coarse: Vec<u32> = finest.iter().map(|count| count / 4).collect();
            for number in gone {
                let at = clusters[number % clusters.len()].0 as usize % division.cells();
                let moved = std::mem::take(&mut coarse[at]);
                coarse[(at * 7 + 1) % division.cells()] += moved + 1;
            }
            prop_assume!(finest.iter().any(|c| *c > 0) && coarse.iter().any(|c| *c > 0));
            let tree = Tree::of(division, &[Counts::of(&finest), Counts::of(&coarse)]);
            for (level, counts) in [&finest, &coarse].into_iter().enumerate() {
                let places = tree.places(level);
                // No two tiles of a level have a cell in common.
                prop_assert!(places.ranges.windows(2).all(|pair| pair[0].0.1 <= pair[1].0.0));
                let mut held = vec![0u64; tree.tiles.len()];
                for (code, count) in counts.iter().enumerate().filter(|(_, count)| **count > 0) {
                    let number = places.tile(code as u32);
                    let within = |cell: &Cell| {
                        let (first, end) = division.range(*cell);
                        (first..end).contains(&(code as u32))
                    };
                    prop_assert!(tree.tiles[number].cells.iter().any(within));
                    held[number] += u64::from(*count);
                }
                for (number, tile) in tree.tiles.iter().enumerate().filter(|(_, tile)| tile.level == level) {
                    prop_assert!(held[number] > 0);
                    prop_assert_eq!(tile.children.is_empty(), level == 0);
                }
            }
            // The tiles of a box are those of its cells, one by one.
            let most = (1u32 << division.depth()) - 1;
            let low: [u32; 3] = std::array::from_fn(|axis| match axis < division.axes() as usize {
                true => (at[axis] * f64::from(most)) as u32,
                false => 0,
            });
            let high: [u32; 3] = std::array::from_fn(|axis| match axis < division.axes() as usize {
                true => (low[axis] + size[axis]).min(most),
                false => 0,
            });
            let places = tree.places(0);
            let mut found = Vec::new();
            places.within([low, high], &mut found);
            let along = |axis: usize| low[axis]..=high[axis];
            let cells = along(0).flat_map(|x| along(1).flat_map(move |y| along(2).map(move |z| [x, y, z])));
            let mut each: Vec<usize> = cells.filter_map(|cell| {
                let code = division.code(cell);
                assert_eq!(division.corners(Cell { depth: division.depth(), code }), [cell; 2]);
                let at = places.ranges.iter().find(|((first, end), _)| (*first..*end).contains(&code));
                at.map(|(_, tile)| *tile)
            }).collect();
            [&mut found, &mut each].into_iter().for_each(|tiles| { tiles.sort_unstable(); tiles.dedup(); });
            prop_assert_eq!(found, each);
            // Every tile but those on top is below one other.
            let mut above = vec![0; tree.tiles.len()];
            tree.tiles.iter().flat_map(|tile| &tile.children).for_each(|child| above[*child] += 1);
            prop_assert!(above.iter().enumerate().all(|(number, times)| *times == usize::from(number >= tree.tops)));
        }
    }
}
