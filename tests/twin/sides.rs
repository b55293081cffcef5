//! Inside and outside told apart by a large ball and carried on as it falls.

use super::solid::{Cells, ball, ball_squared, dilated, exterior, plus};

const FACES: [[i32; 3]; 6] = [[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]];

/// Inside cells and outside cells of the padded box; beyond it all is outside.
struct Sides {
    occupied: Cells,
    inside: Cells,
    outside: Cells,
    squared: i32,
}

/// The solid that is left between the sides when the ball has fallen from radius `rho` on `level` to the grid.
pub fn solid(occupied: &Cells, level: u32, rho: u32) -> Cells {
    let mut levels = vec![occupied.clone()];
    for _ in 0..level {
        levels.push(coarser(&levels[levels.len() - 1]));
    }
    let mut sides = Sides::told_by_the_ball(levels.pop().unwrap(), rho);
    sides.fall(if levels.is_empty() { 2 } else { 4 });
    while let Some(finer) = levels.pop() {
        sides = sides.refined(finer);
        sides.fall(if levels.is_empty() { 2 } else { 4 });
    }
    let mut solid = Cells::none(occupied.cells, 0);
    for cell in solid.all() {
        let reached = ball(1).iter().any(|&d| sides.is_outside(plus(cell, d)));
        if occupied.get(cell) || sides.is_inside(cell) || !reached {
            solid.set(cell);
        }
    }
    without_dents(&solid, occupied)
}

/// With those hollows filled that hardly any point lines: components of cells that are not solid and in no ball of squared radius 16 that is
/// free of solid cells.
fn without_dents(solid: &Cells, occupied: &Cells) -> Cells {
    let ball = ball_squared(16);
    let is_room = |cell: [i32; 3]| !ball.iter().any(|&d| solid.get(plus(cell, d)));
    let mut room = Cells::none(solid.cells, 5);
    for cell in room.all() {
        if is_room(cell) {
            room.set(cell);
        }
    }
    let is_hollow = |cell: [i32; 3]| !solid.get(cell) && !ball.iter().any(|&d| room.get(plus(cell, d)));
    let mut hollow = Cells::none(solid.cells, 0);
    for cell in hollow.all() {
        if is_hollow(cell) {
            hollow.set(cell);
        }
    }
    let mut filled = solid.clone();
    let mut seen = Cells::none(solid.cells, 0);
    for first in hollow.all() {
        if !hollow.get(first) || seen.get(first) {
            continue;
        }
        let component = component(&hollow, first, &mut seen);
        let faces = || component.iter().flat_map(|&cell| FACES.map(|d| plus(cell, d)));
        let sampled = faces().filter(|&c| occupied.get(c)).count();
        let bare = faces().filter(|&c| solid.get(c) && !occupied.get(c)).count();
        if 5 * sampled < 2 * bare {
            component.iter().for_each(|&cell| filled.set(cell));
        }
    }
    filled
}

/// The cells that hang together with `first` by faces; they become seen.
fn component(cells: &Cells, first: [i32; 3], seen: &mut Cells) -> Vec<[i32; 3]> {
    let mut component = vec![first];
    seen.set(first);
    let mut done = 0;
    while done < component.len() {
        for step in FACES {
            let next = plus(component[done], step);
            if cells.get(next) && !seen.get(next) {
                seen.set(next);
                component.push(next);
            }
        }
        done += 1;
    }
    component
}

fn coarser(fine: &Cells) -> Cells {
    let mut coarse = Cells::none(fine.cells.map(|c| c.div_ceil(2)), 0);
    for cell in fine.all() {
        if fine.get(cell) {
            coarse.set(cell.map(|c| c / 2));
        }
    }
    coarse
}

impl Sides {
    fn told_by_the_ball(occupied: Cells, rho: u32) -> Sides {
        let dilated = dilated(&occupied, rho);
        let outside = exterior(&dilated);
        let mut inside = Cells::none(dilated.cells, dilated.pad);
        for cell in dilated.all() {
            if !dilated.get(cell) && !outside.get(cell) {
                inside.set(cell);
            }
        }
        let squared = if rho == 1 { 3 } else { (rho * rho) as i32 };
        Sides { occupied, inside, outside, squared }
    }

    fn is_outside(&self, cell: [i32; 3]) -> bool {
        self.outside.get(cell) || !self.outside.contains(cell)
    }

    fn is_inside(&self, cell: [i32; 3]) -> bool {
        self.inside.get(cell)
    }

    fn fall(&mut self, last: i32) {
        while self.squared > last {
            let next = if self.squared > 4 { (self.squared / 2).max(4) } else { 2 };
            self.step(next);
        }
    }

    fn free(&self, cell: [i32; 3], squared: i32) -> bool {
        !ball_squared(squared).iter().any(|&d| self.occupied.get(plus(cell, d)))
    }

    /// Whether an empty cell lies next to the outside, and whether next to the inside.
    fn next_to(&self, cell: [i32; 3]) -> [bool; 2] {
        if self.occupied.get(cell) {
            return [false; 2];
        }
        let before = ball_squared(self.squared);
        [before.iter().any(|&d| self.is_outside(plus(cell, d))), before.iter().any(|&d| self.is_inside(plus(cell, d)))]
    }

    fn step(&mut self, squared: i32) {
        let (cells, pad) = (self.outside.cells, self.outside.pad);
        let (mut taken_outside, mut taken_inside) = (self.outside.clone(), self.inside.clone());
        let mut open = Cells::none(cells, pad);
        for cell in open.all() {
            if self.is_outside(cell) || self.is_inside(cell) || !self.free(cell, squared) {
                continue;
            }
            match self.next_to(cell) {
                [true, false] => taken_outside.set(cell),
                [false, true] => taken_inside.set(cell),
                _ => open.set(cell),
            }
        }
        let mut walls = [Cells::none(cells, 0), Cells::none(cells, 0)];
        if open.is.contains(&true) {
            for cell in self.occupied.all().into_iter().filter(|&c| self.occupied.get(c)) {
                for neighbour in ball(1) {
                    let next_to = self.next_to(plus(cell, neighbour));
                    for side in 0..2 {
                        if next_to[side] {
                            walls[side].set(cell);
                        }
                    }
                }
            }
        }
        (self.outside, self.inside) = (taken_outside, taken_inside);

        let sight = ball_squared((squared.isqrt() + 1).pow(2));
        let mut seen = Cells::none(cells, pad);
        let mut verdicts = Vec::new();
        for first in open.all() {
            if !open.get(first) || seen.get(first) {
                continue;
            }
            let component = component(&open, first, &mut seen);
            let touches_outside = component.iter().any(|&c| FACES.iter().any(|&d| self.is_outside(plus(c, d))));
            let (mut outside_behind, mut inside_behind, mut inside_near) = (0, 0, 0);
            for &cell in &component {
                let sees = |side: usize| sight.iter().any(|&d| walls[side].get(plus(cell, d)));
                match (sees(0), sees(1)) {
                    (true, false) => outside_behind += 1,
                    (false, true) => inside_behind += 1,
                    (true, true) => inside_near += 1,
                    (false, false) => (),
                }
            }
            inside_near += inside_behind;
            let decisive = |most: usize, least: usize| 4 * most >= component.len() && 4 * least <= most;
            if decisive(outside_behind, inside_behind) || !touches_outside && 4 * inside_near < component.len() {
                verdicts.push((component, true));
            } else if touches_outside
                && (decisive(inside_behind, outside_behind)
                    || 4 * outside_behind < component.len() && 4 * inside_near < component.len())
            {
                verdicts.push((component, false));
            }
        }
        // All at once: no verdict shows in another's evidence.
        for (component, is_inside) in verdicts {
            for cell in component {
                if is_inside { self.inside.set(cell) } else { self.outside.set(cell) }
            }
        }
        self.squared = squared;
    }

    fn refined(&self, finer: Cells) -> Sides {
        let squared = 4 * self.squared;
        let none = Cells::none(finer.cells, squared.isqrt() + 1);
        let mut sides = Sides { occupied: finer, inside: none.clone(), outside: none, squared };
        for cell in sides.outside.all() {
            let parent = cell.map(|c| c.div_euclid(2));
            if !sides.free(cell, 2) {
                continue;
            }
            if self.is_outside(parent) {
                sides.outside.set(cell);
            } else if self.is_inside(parent) {
                sides.inside.set(cell);
            }
        }
        sides
    }
}
