//! Surfaces that are seen from one side: columns, their heights, and which are kept.

use std::collections::{BTreeMap, BTreeSet};

use super::Params;
use super::corner::{Corner, Face};
use super::grid::{cell_of, place_in_cell};
use super::solid::Cells;

/// What is asked of such a surface.
#[derive(Debug, Clone, Copy)]
pub struct Open {
    /// Grid axis that points up: 0 or 2.
    pub up: usize,
    /// Whether it points up, not down.
    pub positive: bool,
    /// Radius of the disc that bridges holes.
    pub bridge: i32,
    /// Squared radius of the ball that rolls over the surface.
    pub ball: i32,
    /// Whether it is closed at the bottom.
    pub base: bool,
    /// The highest step whose wall is kept.
    pub jump: Option<i32>,
    /// Steps of smoothing.
    pub smooth: u32,
}

/// A column: its number within its slice, and the slice.
type Place = [i32; 2];

/// All columns.
#[derive(Debug, Clone)]
pub struct Ground {
    open: Open,
    cells: [u32; 3],
    /// Columns with points.
    data: BTreeSet<Place>,
    /// How high the surface lies: of columns with points the mean height in their highest cells, unless a needle was taken off; interpolated of others that are kept, or near one that is.
    level: BTreeMap<Place, f32>,
    /// Columns that are kept.
    kept: BTreeSet<Place>,
    /// Columns whose faces are made.
    live: BTreeSet<Place>,
    /// How many cells of each column are solid.
    solid: BTreeMap<Place, i32>,
}

fn near(a: Place, b: Place, radius: i32) -> bool {
    let (dx, dy) = (a[0] - b[0], a[1] - b[1]);
    dx * dx + dy * dy <= radius * radius
}

impl Ground {
    /// Finds the columns.
    pub fn of(points: &[[f64; 3]], occupied: &Cells, open: Open, params: &Params) -> Ground {
        let cells = occupied.cells;
        let [columns, slices] = [cells[2 - open.up] as i32, cells[1] as i32];
        let all = |beyond: i32| -> Vec<Place> {
            let across = -beyond..columns + beyond;
            across.flat_map(|x| (-beyond..slices + beyond).map(move |y| [x, y])).collect()
        };
        let mut along_up: BTreeMap<Place, BTreeSet<i32>> = BTreeMap::new();
        for cell in occupied.all().into_iter().filter(|cell| occupied.get(*cell)) {
            let along = if open.positive { cell[open.up] } else { cells[open.up] as i32 - 1 - cell[open.up] };
            let place = [cell[2 - open.up], cell[1]];
            along_up.entry(place).or_default().insert(along);
        }
        let steps = open.jump.is_none();
        let with_needles = along_up.clone();
        if steps {
            along_up = without_needles(&along_up);
        }
        let floor: BTreeMap<Place, i32> = along_up.iter().map(|(p, cells)| (*p, *cells.first().unwrap())).collect();
        let top: BTreeMap<Place, i32> = along_up.iter().map(|(p, cells)| (*p, *cells.last().unwrap())).collect();
        let data: BTreeSet<Place> = floor.keys().copied().collect();

        // The points of each cell, as heights within it.
        let mut within: BTreeMap<(Place, i32), Vec<u64>> = BTreeMap::new();
        for point in points {
            let (cell, place) = (cell_of(*point, params), place_in_cell(*point, params)[open.up]);
            let (along, place) = if open.positive {
                (cell[open.up], place)
            } else {
                (cells[open.up] as i32 - 1 - cell[open.up], 1.0 - place)
            };
            let column = [cell[2 - open.up], cell[1]];
            within.entry((column, along)).or_default().push((place * f64::from(1 << 20)) as u64);
        }
        let mean = |column: Place, along: i32| {
            let all = &within[&(column, along)];
            let mean = all.iter().sum::<u64>() / all.len() as u64;
            f64::from(along) + mean as f64 / f64::from(1 << 20)
        };
        let known: BTreeMap<Place, f64> = floor.iter().map(|(p, floor)| (*p, mean(*p, *floor))).collect();
        let is_whole = |p: &Place| with_needles[p].last() == Some(&top[p]);

        let beyond = open.bridge + 2;
        let reached: BTreeSet<Place> =
            all(2 * beyond).into_iter().filter(|p| data.iter().any(|d| near(*p, *d, open.bridge))).collect();
        let offsets: Vec<Place> = (-open.bridge..=open.bridge)
            .flat_map(|x| (-open.bridge..=open.bridge).map(move |y| [x, y]))
            .filter(|d| near(*d, [0, 0], open.bridge))
            .collect();
        let closed = |p: &Place| offsets.iter().all(|d| reached.contains(&[p[0] + d[0], p[1] + d[1]]));
        let closed: BTreeSet<Place> = all(beyond).into_iter().filter(closed).collect();
        let kept = without_pinches(&closed);

        let reach = 7 + 2 * (open.smooth.max(1) as i32 - 1);
        let live: BTreeSet<Place> = all(0).into_iter().filter(|p| kept.iter().any(|k| near(*k, *p, reach))).collect();
        let lattice = Lattice::new(&known, [columns, slices], 2 * (open.bridge + reach + 1), steps);
        let mut level = BTreeMap::new();
        let mut tops = BTreeMap::new();
        for p in all(0) {
            if data.contains(&p) {
                if is_whole(&p) {
                    level.insert(p, mean(p, top[&p]) as f32);
                }
                tops.insert(p, top[&p] + 1);
            } else if live.contains(&p) {
                let h = lattice.between(0, p).expect("there are points near") as f32;
                level.insert(p, h);
                tops.insert(p, (h as i32 + 1).min(cells[open.up] as i32));
            }
        }
        let ball: Vec<(Place, i32)> = (-open.ball..=open.ball)
            .flat_map(|x| (-open.ball..=open.ball).map(move |y| [x, y]))
            .filter(|[x, y]| x * x + y * y <= open.ball)
            .map(|[x, y]| ([x, y], (open.ball - x * x - y * y).isqrt()))
            .collect();
        let over = |p: Place, d: &Place| [p[0] + d[0], p[1] + d[1]];
        let higher = |p: Place| ball.iter().map(|(d, h)| tops.get(&over(p, d)).unwrap_or(&0) + h).max().unwrap();
        let higher: BTreeMap<Place, i32> = all(open.ball).into_iter().map(|p| (p, higher(p))).collect();
        let lower = |p: Place| ball.iter().map(|(d, h)| higher[&over(p, d)] - h).min().unwrap();
        let cut = |p: &Place| !open.base || kept.contains(p);
        let solid: BTreeMap<Place, i32> = all(0).into_iter().map(|p| (p, if cut(&p) { lower(p) } else { 0 })).collect();
        let foot = |p: &Place, jump: i32| {
            let beside: Vec<Place> = (-1..=1).flat_map(|x| (-1..=1).map(move |y| [p[0] + x, p[1] + y])).collect();
            let steep = |q: &Place| !data.contains(p) && (solid[q] - solid[p]).abs() > 4;
            let breaks = |q: &Place| kept.contains(q) && (solid[q] > solid[p] + jump || steep(q));
            solid.contains_key(p) && beside.iter().any(breaks)
        };
        let kept = match open.jump {
            None => kept,
            Some(jump) => without_pinches(&kept.iter().copied().filter(|p| !foot(p, jump)).collect()),
        };
        Ground { open, cells, data, level, kept, live, solid }
    }

    /// The solid cells.
    pub fn solid(&self) -> Cells {
        let mut out = Cells::none(self.cells, 0);
        for (&[x, y], &top) in &self.solid {
            for along in 0..top {
                let mut cell = [0, y, 0];
                cell[2 - self.open.up] = x;
                cell[self.open.up] =
                    if self.open.positive { along } else { self.cells[self.open.up] as i32 - 1 - along };
                out.set(cell);
            }
        }
        out
    }

    /// Whether all faces at a corner are made.
    pub fn makes_all_round(&self, corner: Corner) -> bool {
        let [x, y] = [corner[2 - self.open.up], corner[1]];
        self.open.base || [[x - 1, y - 1], [x, y - 1], [x - 1, y], [x, y]].iter().all(|p| self.live.contains(p))
    }

    /// Whether the triangles of a face are made.
    pub fn makes(&self, face: &Face) -> bool {
        self.is_within(&self.live, face)
    }

    /// Whether they are written.
    pub fn keeps(&self, face: &Face) -> bool {
        self.is_within(&self.kept, face)
    }

    /// Whether a face does not lie on the bottom, and its columns are some of these.
    fn is_within(&self, columns: &BTreeSet<Place>, face: &Face) -> bool {
        if self.open.base {
            return true;
        }
        let bottom = if self.open.positive { 0 } else { self.cells[self.open.up] as i32 };
        if face.axis == self.open.up && face.cell[self.open.up] == bottom {
            return false;
        }
        face.sides().into_iter().all(|cell| columns.contains(&[cell[2 - self.open.up], cell[1]]))
    }

    /// The surface's height, along the grid's axis, at the place `q` of a corner's vertex, and whether all round it is bridged.
    pub fn level(&self, corner: Corner, q: [f64; 3]) -> Option<(f64, bool)> {
        let (x, y) = (corner[2 - self.open.up], corner[1]);
        let columns = [[x - 1, y - 1], [x, y - 1], [x - 1, y], [x, y]];
        let level = |p: Place| self.level.get(&p).map(|level| f64::from(*level));
        let [a, b, c, d] = [level(columns[0])?, level(columns[1])?, level(columns[2])?, level(columns[3])?];
        let bridged = columns.iter().all(|p| !self.data.contains(p));
        let mut sorted = [a, b, c, d];
        sorted.sort_by(f64::total_cmp);
        if !bridged && sorted[3] - sorted[0] > 2.0 {
            return None;
        }
        let u = (q[1] - f64::from(y) + 0.5).clamp(0.0, 1.0);
        let v = (q[2 - self.open.up] - f64::from(x) + 0.5).clamp(0.0, 1.0);
        let (p, r) = (a + v * (b - a), c + v * (d - c));
        let height = p + u * (r - p);
        let turned = |h: f64| if self.open.positive { h } else { f64::from(self.cells[self.open.up]) - h };
        let corner = turned(f64::from(corner[self.open.up]));
        (corner > 0.0 && (height - corner).abs() <= 1.0).then(|| (turned(height), bridged))
    }
}

/// Without the highest cell of each column in which that is more than two cells above all other cells of its own and of the columns up to two away, of which there is one.
fn without_needles(columns: &BTreeMap<Place, BTreeSet<i32>>) -> BTreeMap<Place, BTreeSet<i32>> {
    let mut out = columns.clone();
    for ([x, y], cells) in &mut out {
        let top = *cells.last().unwrap();
        let around = (-2..=2).flat_map(|dx| (-2..=2).map(move |dy| [dx, dy])).filter(|d| *d != [0, 0]);
        let near: Vec<i32> = around.filter_map(|[dx, dy]| columns.get(&[x + dx, y + dy])).flatten().copied().collect();
        let own = cells.iter().filter(|cell| **cell != top);
        if !near.is_empty() && near.iter().chain(own).all(|other| top > other + 2) {
            cells.remove(&top);
        }
    }
    out.retain(|_, cells| !cells.is_empty());
    out
}

/// Without what is in no square of two by two, and with the rest of squares of which two at a diagonal are in.
fn without_pinches(set: &BTreeSet<Place>) -> BTreeSet<Place> {
    let square = |[x, y]: Place| [[x, y], [x + 1, y], [x, y + 1], [x + 1, y + 1]];
    let squares = |set: &BTreeSet<Place>| -> BTreeSet<Place> {
        set.iter().flat_map(|[x, y]| [[*x, *y], [x - 1, *y], [*x, y - 1], [x - 1, y - 1]]).collect()
    };
    let full = squares(set).into_iter().map(square).filter(|square| square.iter().all(|p| set.contains(p)));
    let mut out: BTreeSet<Place> = full.flatten().collect();
    for _ in 0..2 {
        let pinched = |square: &[Place; 4]| {
            let [a, b, c, d] = square.map(|p| out.contains(&p));
            (a && d && !b && !c) || (!a && !d && b && c)
        };
        let more: Vec<Place> = squares(&out).into_iter().map(square).filter(pinched).flatten().collect();
        out.extend(more);
    }
    out
}

/// Whether two heights on a level differ by more than two cells and half of a cell of the level, where there are steps.
fn is_step(steps: bool, level: usize, a: f64, b: f64) -> bool {
    steps && (a - b).abs() > 2.0 + 0.5 * (1 << level) as f64
}

/// Floors on ever coarser lattices.
struct Lattice {
    /// Of each level from 1 on: what is known of its cells.
    levels: Vec<BTreeMap<Place, f64>>,
    /// Whether heights that differ much are parted by steps.
    steps: bool,
}

impl Lattice {
    fn new(known: &BTreeMap<Place, f64>, size: Place, side: i32, steps: bool) -> Lattice {
        let mut levels = vec![known.clone()];
        let top = (side as u32).next_power_of_two().ilog2() as usize;
        for level in 0..top {
            let below: &BTreeMap<Place, f64> = levels.last().unwrap();
            let parents: BTreeSet<Place> = below.keys().map(|p| p.map(|c| c.div_euclid(2))).collect();
            let mean = |[x, y]: Place| {
                let four = [[2 * x, 2 * y], [2 * x + 1, 2 * y], [2 * x, 2 * y + 1], [2 * x + 1, 2 * y + 1]];
                let known: Vec<f64> = four.iter().filter_map(|p| below.get(p)).copied().collect();
                // The largest group within a step of its lowest; of equal ones the lowest.
                let group = |lowest: f64| -> Vec<f64> {
                    let alike = |v: &f64| *v >= lowest && !is_step(steps, level, *v, lowest);
                    known.iter().copied().filter(alike).collect()
                };
                let mut lowest = known.clone();
                lowest.sort_by(f64::total_cmp);
                let most = lowest.iter().map(|v| group(*v).len()).max().unwrap();
                let best = lowest.into_iter().map(group).find(|group| group.len() == most).unwrap();
                best.iter().fold(0.0, |sum, v| sum + v) / most as f64
            };
            levels.push(parents.into_iter().map(|p| (p, mean(p))).collect());
        }
        let mut lattice = Lattice { levels, steps };
        for level in (1..top).rev() {
            let cells = size.map(|n| (n + (1 << level) - 1) >> level);
            for x in 0..cells[0] {
                for y in 0..cells[1] {
                    if !lattice.levels[level].contains_key(&[x, y])
                        && let Some(value) = lattice.between(level, [x, y])
                    {
                        lattice.levels[level].insert([x, y], value);
                    }
                }
            }
        }
        lattice
    }

    /// What the level above says of a place of `level`.
    fn between(&self, level: usize, [x, y]: Place) -> Option<f64> {
        let nearer = |at: i32| if at % 2 == 0 { at / 2 - 1 } else { at / 2 + 1 };
        let (x0, y0, x1, y1) = (x / 2, y / 2, nearer(x), nearer(y));
        let weighed = [([x0, y0], 9.0), ([x1, y0], 3.0), ([x0, y1], 3.0), ([x1, y1], 1.0)];
        let (mut sum, mut weights) = (0.0, 0.0);
        let nearest = weighed.iter().find_map(|(place, _)| self.levels[level + 1].get(place));
        for (place, weight) in weighed {
            if let Some(value) = self.levels[level + 1].get(&place)
                && !is_step(self.steps, level + 1, *value, *nearest.unwrap())
            {
                sum += weight * value;
                weights += weight;
            }
        }
        (weights > 0.0).then(|| sum / weights)
    }
}
