//! Triangles of a mesh that intersect, exactly, for meshes of any size in bounded memory.
//!
//! ```text
//!  sample      boxes of triangles, evenly over their numbers -> cells with about as many triangles each (cells)
//!  distribute  every triangle, with its corners, to each cell that its box touches (partitions, on disk if need be)
//!  search      cell by cell, in parallel: cut on in memory, then each triangle with each (pairs)
//!              a cell that is too full is sampled and distributed in its turn
//! ```
//!
//! Cells and limits depend on the mesh alone, and cells are counted in their order: so the findings are the same for every
//! budget and any number of threads, even where a limit ends the search. Where none does, they do not depend on the order
//! of triangles either, but for their numbers.

mod cells;
mod found;
mod pairs;
#[cfg(test)]
mod tests;

use std::cell::RefCell;
use std::sync::Mutex;

use self::cells::{Cell, Cuboid, Tree};
pub use self::found::Intersection;
use self::found::{Found, Limits, Record};
use self::pairs::Pairs;
use crate::error::Result;
use crate::mesh::check::job::{Check, Plan};
use crate::mesh::corners::{Block, Lookup, Order};
use crate::mesh::intersect::FARTHEST;
use crate::mesh::measure::is_degenerate;
use crate::mesh::{MeshSource, check_vertex_count};
use crate::resources::workers::{Spares, Workers};
use crate::storage::partitions::Partitions;
use crate::storage::spool::Workspace;

/// Distributions within each other at most: each makes cells smaller by up to [`CELLS`] times, so that more would not help.
const DEEPEST: u32 = 4;
/// Bytes for a triangle's record on its way to the partitions.
const RECORD_BYTES: u64 = 100;

/// The triangles that intersect, as [`crate::mesh::intersect`] defines it.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Intersections {
    /// Pairs of triangles that intersect; at least so many, if the search is not complete.
    pub pairs: u64,
    /// Triangles that intersect another; at least so many, if the search is not complete.
    pub triangles: u64,
    /// Whether all pairs were looked at. The search ends after 1,000,000 pairs, or when far more boxes of triangles overlap
    /// than in any sensible mesh.
    pub complete: bool,
    /// The pair with the lowest numbers.
    pub first: Option<Intersection>,
}

impl Intersections {
    /// Whether the mesh is known to be free of self-intersections.
    pub fn none(&self) -> bool {
        self.pairs == 0 && self.complete
    }
}

/// Finds the triangles that intersect.
///
/// Left out are triangles that repeat a vertex number, and those with a corner that is not finite or has a coordinate
/// beyond [`FARTHEST`]. The mesh must name no vertex that it does not have; [`crate::mesh::check::check`] tells.
///
/// Memory: about `budget` bytes, but no less than some 10 MB for each worker and as much once more; beyond that 16 bytes for
/// each pair found. Temporary storage: 92 bytes a triangle, up to twice that for meshes of long triangles, and as much for
/// cells that are distributed again; 132 bytes a triangle more if the mesh is in random order and the budget does not hold its
/// vertices. `progress` is told the number of triangles done, up to the number of triangles; distribution and search count half each.
///
/// # Errors
/// What reading the mesh or the work directory gives; [`crate::Error::TooManyElements`] if 32 bits cannot number the
/// vertices; [`crate::Error::Interrupted`].
pub fn intersections(
    mesh: &dyn MeshSource,
    budget: u64,
    workers: &Workers,
    workspace: &Workspace,
    progress: &mut dyn FnMut(u64),
) -> Result<Intersections> {
    check_vertex_count(mesh.vertex_count())?;
    let plan = Plan::for_budget(budget, workers.threads());
    let check = Check { mesh, plan, workers, workspace };
    Search { check: &check, budget, limits: Limits::of(mesh.face_count()) }.run(progress)
}

struct Search<'a> {
    check: &'a Check<'a>,
    budget: u64,
    limits: Limits,
}

impl Search<'_> {
    fn run(&self, progress: &mut dyn FnMut(u64)) -> Result<Intersections> {
        let triangles = self.check.mesh.face_count();
        let tree = if triangles <= self.limits.held {
            Tree::uncut(Cell::SPACE)
        } else {
            Tree::new(Cell::SPACE, self.sample()?, self.limits.cells_for(triangles))
        };
        let mut partitions = self.partitions(tree.cells().len(), 0);
        self.distribute(&tree, &mut partitions, &mut |done| progress(done / 2))?;
        let mut found = Found { complete: true, ..Found::default() };
        self.search(&tree, partitions, 0, &mut found, &mut |done| progress(triangles / 2 + done / 2))?;
        progress(triangles);

        let Found { pairs, mut involved, first, complete, .. } = found;
        involved.sort_unstable();
        involved.dedup();
        Ok(Intersections { pairs: pairs.min(self.limits.pairs), triangles: involved.len() as u64, complete, first })
    }

    /// Partitions for so many cells; those within other cells share what these have left over.
    fn partitions(&self, cells: usize, depth: u32) -> Partitions<Record> {
        let share = self.budget >> depth;
        Partitions::new(cells, share / 8, share / 8, self.check.workspace)
    }

    /// The boxes of triangles at even distances.
    fn sample(&self) -> Result<Vec<Cuboid>> {
        let mesh = self.check.mesh;
        let (triangles, size) = (mesh.face_count(), self.limits.sample.min(mesh.face_count()));
        let mut sample = Vec::with_capacity(size as usize);
        for i in 0..size {
            let mut face = [[0; 3]];
            mesh.read_faces((u128::from(i) * u128::from(triangles) / u128::from(size)) as u64, &mut face)?;
            let mut corners = [[0.0; 3]; 3];
            for (vertex, corner) in face[0].iter().zip(&mut corners) {
                mesh.read_vertices(u64::from(*vertex), std::slice::from_mut(corner))?;
            }
            if is_sound(face[0], &corners) {
                sample.push(Cuboid::around(corners));
            }
        }
        Ok(sample)
    }

    /// Some triangles of a partition, chosen by their numbers: the order in which they lie there depends on means.
    fn sample_pile(&self, partitions: &Partitions<Record>, partition: usize) -> Result<Vec<Record>> {
        // Multiples of the golden ratio's fraction of 2^64 are spread evenly; folded and multiplied once more, they are even
        // for rows of numbers, too.
        const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;
        let spread = |number: u64| number.wrapping_mul(GOLDEN);
        let share = self.limits.sample as f64 / partitions.records(partition) as f64;
        let below = (share * u64::MAX as f64) as u64;
        let mut sample = Vec::new();
        partitions.read(partition, |record| {
            let first = spread(record.number);
            if spread(first ^ first >> 32) <= below {
                sample.push(*record);
            }
            Ok(())
        })?;
        Ok(sample)
    }

    /// Puts every sound triangle on the partitions of its cells.
    fn distribute(
        &self,
        tree: &Tree,
        partitions: &mut Partitions<Record>,
        progress: &mut dyn FnMut(u64),
    ) -> Result<()> {
        let Check { mesh, ref plan, workers, workspace } = *self.check;
        let block = plan.block as u64;
        let records = plan.in_flight as u64 * block * RECORD_BYTES;
        let lookup = Lookup {
            mesh,
            workers,
            workspace,
            block: plan.block,
            window: plan.window,
            in_flight: plan.in_flight,
            memory: (self.budget / 2).saturating_sub(records),
        };
        let blocks = 0..mesh.face_count().div_ceil(block);
        let read = |first: u64, positions: &mut [[f64; 3]]| mesh.read_vertices(first, positions);
        // Handed to and fro: what one thread takes and another gives back would wait for the first.
        let spares = Spares::<Vec<(Option<u32>, Record)>>::default();
        let look = |found: &Block<'_, [f64; 3]>| {
            let mut records = spares.take().unwrap_or_default();
            put_records(tree, block, found, &mut records);
            Ok(records)
        };
        let mut done = 0;
        lookup.for_each(blocks, Order::NearFirst, &read, look, |records| {
            done += block;
            progress(done.min(mesh.face_count()));
            records.iter().try_for_each(|(cell, record)| match cell {
                Some(cell) => partitions.push(*cell as usize, record),
                None => push_to_all(partitions, tree, record),
            })?;
            spares.give(records);
            Ok(())
        })
    }

    /// Searches the cells' partitions: those that fit in memory first, the others by distributing them in their turn.
    fn search(
        &self,
        tree: &Tree,
        partitions: Partitions<Record>,
        depth: u32,
        found: &mut Found,
        progress: &mut dyn FnMut(u64),
    ) -> Result<()> {
        let Check { plan, workers, mesh, .. } = self.check;
        let (held, full): (Vec<usize>, Vec<usize>) =
            (0..tree.cells().len()).partition(|&partition| partitions.records(partition) <= self.limits.held);
        let pool = Mutex::new(Vec::<Pairs>::new());
        let look = |partition: usize| {
            let mut pairs = pool.lock().expect("no job panics while it takes memory").pop().unwrap_or_default();
            pairs.records.clear();
            partitions.read(partition, |record| {
                pairs.records.push(*record);
                Ok(())
            })?;
            let found = pairs.find(tree.cells()[partition], &self.limits);
            pool.lock().expect("no job panics while it returns memory").push(pairs);
            Ok(found)
        };
        let so_far = RefCell::new((found, 0u128));
        let mut waiting = held.iter();
        let next = || Ok(waiting.next().copied().filter(|_| !so_far.borrow().0.enough(&self.limits)));
        workers.in_order(plan.in_flight, next, look, |of_cell| {
            let (found, done) = &mut *so_far.borrow_mut();
            // Cells that were under way when the search ended do not count: their number depends on the threads.
            if !found.enough(&self.limits) {
                found.add(of_cell);
                *done += 1;
                progress((u128::from(mesh.face_count()) * *done / tree.cells().len() as u128) as u64);
            }
            Ok(())
        })?;
        let (found, done) = so_far.into_inner();
        drop(pool);

        found.complete &= done == held.len() as u128;
        for partition in full {
            if depth == DEEPEST || found.enough(&self.limits) {
                found.complete = false;
                continue;
            }
            workers.check_cancelled()?;
            let sample = self.sample_pile(&partitions, partition)?;
            let boxes = sample.iter().map(|record| Cuboid::around(record.corners)).collect();
            let parts = Tree::new(tree.cells()[partition], boxes, self.limits.cells_for(partitions.records(partition)));
            if parts.cells().len() == 1 {
                // So many boxes on one another that their pairs are beyond every limit: a look at some has to do.
                let mut pairs = Pairs::default();
                pairs.records = sample;
                found.add(pairs.find(tree.cells()[partition], &self.limits));
                found.complete = false;
                continue;
            }
            let mut within = self.partitions(parts.cells().len(), depth + 1);
            partitions.read(partition, |record| push_to_all(&mut within, &parts, record))?;
            self.search(&parts, within, depth + 1, found, &mut |_| ())?;
        }
        Ok(())
    }
}

/// Makes `records` those of a block's triangles, each with its cell if that is only one. Others are copied to their cells as they are put there: a huge triangle may be in all of
/// them.
fn put_records(tree: &Tree, block: u64, found: &Block<'_, [f64; 3]>, records: &mut Vec<(Option<u32>, Record)>) {
    records.clear();
    records.reserve_exact(found.vertices.len());
    for ((&vertices, corners), number) in found.vertices.iter().zip(found.corners()).zip(found.number * block..) {
        if is_sound(vertices, &corners) {
            records.push((tree.only(&Cuboid::around(corners)), Record { corners, vertices, number }));
        }
    }
}

/// Puts a record on the partitions of all cells that its triangle's box touches.
fn push_to_all(partitions: &mut Partitions<Record>, tree: &Tree, record: &Record) -> Result<()> {
    let mut result = Ok(());
    tree.visit(&Cuboid::around(record.corners), &mut |cell| {
        if result.is_ok() {
            result = partitions.push(cell as usize, record);
        }
    });
    result
}

/// Whether the search looks at a triangle.
fn is_sound(vertices: [u32; 3], corners: &[[f64; 3]; 3]) -> bool {
    // Not what compares false: NaN is left out, too.
    !is_degenerate(vertices) && corners.as_flattened().iter().all(|c| c.abs() <= FARTHEST)
}
