//! Pass after pass over a mesh that does not fit in memory: each cuts space in another way, so that what lay on a border lies within a part the next time.

use std::cell::Cell;
use std::ops::Range;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::collapse::Limits;
use super::mark::Mark;
use super::part::Gathered;
use super::reading::{self, Reading, Wanted};
use super::soup::{Record, Sample, Soup};
use super::space::Space;
use crate::error::{Error, Result};
use crate::mesh::MeshSource;
use crate::mesh::corners::Corners;
use crate::mesh::measure::is_degenerate;
use crate::points::Coordinate;
use crate::resources::workers::Workers;
use crate::storage::partitions::Partitions;
use crate::storage::spool::Workspace;
use crate::storage::work::WorkFolder;
use crate::storage::work::log::{Log, Reached};

/// Triangles of a part, about: what one thread works on at a time. Fixed, since it shows in the bytes.
const PART: u64 = 1 << 15;
#[cfg(not(test))]
const fn part() -> u64 {
    PART
}

#[cfg(test)]
thread_local! {
    static SMALLER: std::cell::Cell<u64> = const { std::cell::Cell::new(PART) };
}

/// Tests make parts smaller, so that there are several.
#[cfg(test)]
fn part() -> u64 {
    SMALLER.get()
}

/// Does some work with smaller parts.
#[cfg(test)]
pub(super) fn with_parts_of<R>(triangles: u64, work: impl FnOnce() -> R) -> R {
    SMALLER.set(triangles);
    let done = work();
    SMALLER.set(PART);
    done
}

/// The share of the sample on the first side of each plane, pass after pass. If all of the last pass was one part, there is none after it.
pub(super) const SHARES: [f64; 3] = [0.5, 0.38, 0.62];
/// A part may be so much larger than intended: a sample tells its triangles' number, and those of other parts that reach into it come on top.
const UNEVEN: u64 = 2;
/// Parts of a row.
const ROW: usize = if cfg!(test) { 4 } else { 64 };

/// Where a pass has its triangles from.
#[derive(Clone, Copy)]
pub(super) enum Triangles<'a, T, M> {
    /// The mesh as it was given, and what is read of its vertices.
    Mesh(&'a dyn MeshSource, Wanted),
    Soup(&'a Soup<T, M>),
}

/// What all passes work with.
pub(super) struct Passes<'a> {
    pub(super) workers: &'a Workers,
    pub(super) workspace: &'a Workspace,
    pub(super) room: Room,
    /// Where passes are kept, and what the names of their phases begin with.
    pub(super) kept: Option<(&'a WorkFolder, &'a str)>,
    /// Passes that were made.
    pub(super) made: Cell<u64>,
}

/// How far a pass is, as its log says.
#[derive(Debug, Default, Serialize, Deserialize)]
struct RowsLeft {
    /// Rows of parts that were simplified.
    rows: usize,
    /// The bits of how far any place has drifted, and of how much any channel of a colour has changed.
    most: [u64; 2],
    /// The planes, once it is whole.
    space: Option<Space>,
}

/// The budget, shared out. Nothing of it shows in the bytes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Room {
    budget: u64,
    /// What parts under way take together.
    jobs: u64,
    /// What each store keeps in memory.
    pub(super) quota: u64,
    /// Pages of the partitions.
    pages: u64,
}

/// Stores of triangles at a time: those that a pass reads, sorts and writes, and two results of trials.
const STORES: u64 = 5;

impl Room {
    /// The least that simplifying so many triangles needs, in bytes, beside the numbering.
    pub(super) fn least<T: Coordinate, M: Mark>(triangles: u64) -> u64 {
        Room::fixed::<T, M>(triangles) + Room::largest::<T, M>(triangles)
    }

    fn fixed<T: Coordinate, M: Mark>(triangles: u64) -> u64 {
        pages::<T, M>(triangles.div_ceil(PART / 2))
            + reading::bytes::<T, M>(triangles)
            + reading::far_bytes(triangles).saturating_sub(Room::largest::<T, M>(triangles))
            + 3 * Sample::<T>::BYTES.min(triangles * size_of::<[T; 3]>() as u64)
    }

    /// A part, if it is as much larger than intended as one may be.
    fn largest<T: Coordinate, M: Mark>(triangles: u64) -> u64 {
        triangles.min(UNEVEN * PART) * Gathered::bytes::<T, M>()
    }

    pub(super) fn of<T: Coordinate, M: Mark>(triangles: u64, budget: u64, numbering: u64) -> Result<Room> {
        let least = Room::least::<T, M>(triangles) + numbering;
        if budget < least {
            return Err(refused(budget, least));
        }
        let spare = budget - least;
        let quota = (spare / 2 / STORES).min(triangles * size_of::<Record<T, M>>() as u64);
        let pages = pages::<T, M>(triangles.div_ceil(PART / 2)) + spare / 16;
        let jobs = Room::largest::<T, M>(triangles) + spare - STORES * quota - spare / 16;
        Ok(Room { budget, jobs, quota, pages })
    }

    /// What is going to be used of it, at the most.
    pub(super) fn used<T: Coordinate, M: Mark>(&self, triangles: u64, threads: usize) -> u64 {
        let parts = (threads as u64 + 1).min(triangles.div_ceil(PART).max(1));
        let pages = self.pages.min(triangles * size_of::<Record<T, M>>() as u64);
        Room::fixed::<T, M>(triangles)
            + self.jobs.min(parts * Room::largest::<T, M>(triangles))
            + STORES * self.quota
            + pages
    }

    /// How many parts of so many triangles at most can be under way.
    fn in_flight<T: Coordinate, M: Mark>(&self, largest: u64, threads: usize) -> Result<usize> {
        let each = largest * Gathered::bytes::<T, M>();
        if each > self.jobs {
            return Err(refused(self.budget, self.budget + each - self.jobs));
        }
        Ok((self.jobs / each.max(1)).min(threads as u64 + 1) as usize)
    }
}

fn refused(given: u64, needed: u64) -> Error {
    use bytesize::ByteSize;
    let needed = needed.next_multiple_of(1 << 20);
    Error::Budget { given: ByteSize(given), needed: ByteSize(needed), what: "simplifying the mesh" }
}

/// Bytes of the partitions' pages, at the least: of a row's parts as long as pages are, and of rows a quarter.
fn pages<T, M>(parts: u64) -> u64 {
    let page = |records: u64| records * size_of::<Record<T, M>>() as u64 + 64;
    let (fine, coarse) = (parts.min(ROW as u64) * page(256), parts.div_ceil(ROW as u64) * page(128));
    2 * fine.max(coarse)
}

impl Passes<'_> {
    /// Simplifies, pass after pass. `progress` is told the part that is done.
    pub(super) fn simplified<T: Coordinate, M: Mark>(
        &self,
        from: &Triangles<T, M>,
        limits: Limits,
        progress: &mut dyn FnMut(f64),
    ) -> Result<Soup<T, M>> {
        let mut soup: Option<Soup<T, M>> = None;
        let mut before_it: Option<Space> = None;
        for number in 0..SHARES.len() {
            let again = soup.as_ref().map(Triangles::Soup);
            // The first pass has by far the most to do.
            let (before, after) = [(0.0, 0.7), (0.7, 0.9), (0.9, 1.0)][number];
            let told = &mut |part: f64| progress(before + part * (after - before));
            let pass = (number, before_it.as_ref());
            let (left, space) = self.pass(again.as_ref().unwrap_or(from), limits, pass, told)?;
            soup = Some(left);
            if space.parts() == 1 {
                break;
            }
            before_it = Some(space);
        }
        Ok(soup.expect("there is a first pass"))
    }

    /// Partitions for the parts of a row.
    fn row_of<T: Coordinate, M: Mark>(&self, parts: usize) -> Partitions<Record<T, M>> {
        Partitions::new(parts, self.room.pages / 2, self.room.quota, self.workspace)
    }

    /// Partitions for rows of parts.
    pub(super) fn rows_of<T: Coordinate, M: Mark>(&self, rows: usize) -> Partitions<Record<T, M>> {
        Partitions::new(rows, self.room.pages / 2, self.room.quota, self.workspace)
    }

    /// A mesh that is read. Parts take no memory meanwhile.
    pub(super) fn reading<'m>(&'m self, mesh: &'m dyn MeshSource, wanted: Wanted) -> Reading<'m> {
        let memory = self.room.jobs.max(reading::far_bytes(mesh.face_count()));
        Reading { mesh, wanted, workers: self.workers, workspace: self.workspace, memory }
    }

    /// The planes of a pass.
    pub(super) fn space<T: Coordinate, M: Mark>(&self, from: &Triangles<T, M>, share: f64) -> Result<Space> {
        let sample = match from {
            Triangles::Soup(soup) => soup.sample()?,
            Triangles::Mesh(mesh, _) => sample(*mesh)?,
        };
        Ok(Space::of(sample, from.count(), part(), share))
    }

    /// One pass, with its number and the planes of the one before: the triangles that are left, and the planes.
    fn pass<T: Coordinate, M: Mark>(
        &self,
        from: &Triangles<T, M>,
        limits: Limits,
        (number, before_it): (usize, Option<&Space>),
        progress: &mut dyn FnMut(f64),
    ) -> Result<(Soup<T, M>, Space)> {
        self.made.set(self.made.get() + 1);
        let (mut left, mut log, mut before) = match self.kept {
            None => (Soup::new(self.workspace, self.room.quota), None, RowsLeft::default()),
            Some((work, name)) => {
                let phase = format!("{name}-{number}");
                let (log, reached) = Log::open::<RowsLeft>(work, &phase, ["triangles"], self.workers)?;
                let Reached { files: [file], ends: [end], last } = reached;
                let spool = self.workspace.spool_in(file, end);
                let left = match &last {
                    None => Soup::in_spool(spool),
                    Some(rows) => Soup::joined(vec![spool], rows.most.map(f64::from_bits)),
                };
                (left, Some(log), last.unwrap_or_default())
            }
        };
        if let Some(space) = before.space.take() {
            return Ok((left, space));
        }
        let count = from.count();
        let space = self.space(from, SHARES[number])?;
        // Parts in rows, so that records are sorted to few partitions at a time, in large pages: first to rows, then to the parts of a row.
        let rows = rows(&space);
        let mut coarse = self.rows_of(rows);
        let mut only = (rows == 1).then(|| self.row_of(space.parts()));
        let mut done = 0;
        from.visit(self, |records| {
            for record in records {
                match &mut only {
                    Some(only) => meeting(&space, record, |part| only.push(part, record))?,
                    None => meeting_rows(&space, record, |row| coarse.push(row, record))?,
                }
            }
            done += records.len() as u64;
            progress(0.2 * done as f64 / count as f64);
            Ok(())
        })?;

        let mut finished = before.rows * ROW;
        for row in before.rows..rows {
            let fine = match only.take() {
                Some(only) => only,
                None => self.parts_of_row(&space, row, |push| coarse.read(row, push))?,
            };
            self.row((&space, before_it), row, &fine, limits, |records| {
                left.append(&records)?;
                finished += 1;
                progress(0.2 + 0.8 * finished as f64 / space.parts() as f64);
                Ok(())
            })?;
            if let Some(log) = &mut log
                && (log.is_due() || row + 1 == rows)
            {
                let most = [left.reached, left.recoloured].map(f64::to_bits);
                let whole = (row + 1 == rows).then(|| space.clone());
                log.append([left.extent()], &RowsLeft { rows: row + 1, most, space: whole })?;
            }
        }
        Ok((left, space))
    }

    /// The triangles of a row, which `read` hands over, by the row's parts.
    pub(super) fn parts_of_row<T: Coordinate, M: Mark>(
        &self,
        space: &Space,
        row: usize,
        read: impl FnOnce(&mut dyn FnMut(&Record<T, M>) -> Result<()>) -> Result<()>,
    ) -> Result<Partitions<Record<T, M>>> {
        let parts = parts_of(space, row);
        let mut fine = self.row_of(parts.len());
        read(&mut |record| {
            meeting(
                space,
                record,
                |part| {
                    if parts.contains(&part) { fine.push(part - parts.start, record) } else { Ok(()) }
                },
            )
        })?;
        Ok(fine)
    }

    /// Simplifies the parts of a row, whose triangles lie in a partition each; `sink` is given what is left of one after the other. The planes are this pass's, and those of
    /// the one before, if there is one.
    pub(super) fn row<T: Coordinate, M: Mark>(
        &self,
        (space, before_it): (&Space, Option<&Space>),
        row: usize,
        fine: &Partitions<Record<T, M>>,
        limits: Limits,
        sink: impl FnMut(Vec<Record<T, M>>) -> Result<()>,
    ) -> Result<()> {
        let parts = parts_of(space, row);
        let largest = (0..fine.count()).map(|part| fine.records(part)).max().unwrap_or(0);
        let in_flight = self.room.in_flight::<T, M>(largest, self.workers.threads())?;
        let simplify = |number: usize| {
            let mut gathered = Gathered::with_room::<M>(fine.records(number) as usize);
            fine.read(number, |record| {
                gathered.push(record);
                Ok(())
            })?;
            let inside = |place| space.part(place) as usize == parts.start + number;
            Ok(gathered.simplified::<T, M>(limits, inside, before_it))
        };
        self.workers.in_order_range(in_flight, parts.len(), simplify, sink)
    }
}

/// Rows of parts.
pub(super) fn rows(space: &Space) -> usize {
    space.parts().div_ceil(ROW)
}

/// The parts of a row.
fn parts_of(space: &Space, row: usize) -> Range<usize> {
    row * ROW..space.parts().min((row + 1) * ROW)
}

/// Calls `visit` with each row of parts that a triangle's box meets.
pub(super) fn meeting_rows<T: Coordinate, M: Mark>(
    space: &Space,
    record: &Record<T, M>,
    mut visit: impl FnMut(usize) -> Result<()>,
) -> Result<()> {
    // Parts come in their order.
    let mut last = None;
    meeting(space, record, |part| match part / ROW {
        row if last == Some(row) => Ok(()),
        row => {
            last = Some(row);
            visit(row)
        }
    })
}

/// Calls `visit` with each part that a triangle's box meets.
fn meeting<T: Coordinate, M: Mark>(
    space: &Space,
    record: &Record<T, M>,
    mut visit: impl FnMut(usize) -> Result<()>,
) -> Result<()> {
    let places = record.places();
    let low = std::array::from_fn(|a| places[0][a].min(places[1][a]).min(places[2][a]));
    let high = std::array::from_fn(|a| places[0][a].max(places[1][a]).max(places[2][a]));
    let mut visited = Ok(());
    space.meet(low, high, |part| {
        if visited.is_ok() {
            visited = visit(part as usize);
        }
    });
    visited
}

/// How large a mesh and its triangles are, about.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scale {
    /// The diagonal of the box of the sampled places.
    pub(super) diagonal: f64,
    /// The root mean square of an edge.
    pub(super) edge: f64,
}

/// First corners of some triangles of a mesh: a run of them at even distances, so that few vertices have to be read.
fn sample<T: Coordinate>(mesh: &dyn MeshSource) -> Result<Vec<[T; 3]>> {
    let mut places = Vec::new();
    sampled(mesh, |corners| places.push(corners[0].map(T::from_f64)))?;
    Ok(places)
}

/// The scale of a mesh, by the same triangles.
pub(super) fn scale(mesh: &dyn MeshSource) -> Result<Scale> {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (mut squares, mut edges) = (0.0, 0u64);
    sampled(mesh, |corners| {
        let [a, b, c] = corners.map(DVec3::from_array);
        for corner in [a, b, c] {
            low = low.min(corner);
            high = high.max(corner);
        }
        squares += a.distance_squared(b) + b.distance_squared(c) + c.distance_squared(a);
        edges += 3;
    })?;
    let diagonal = if edges > 0 { low.distance(high) } else { 0.0 };
    Ok(Scale { diagonal, edge: libm::sqrt(squares / edges.max(1) as f64) })
}

fn sampled(mesh: &dyn MeshSource, mut visit: impl FnMut([[f64; 3]; 3])) -> Result<()> {
    /// Triangles of a run.
    const RUN: u64 = 64;
    /// Runs at most.
    const RUNS: u64 = 1 << 11;
    let triangles = mesh.face_count();
    let runs = triangles.div_ceil(RUN).min(RUNS);
    let (mut faces, mut corners) = (Vec::new(), Corners::default());
    for run in 0..runs {
        let first = (u128::from(triangles) * u128::from(run) / u128::from(runs)) as u64;
        faces.clear();
        faces.resize(RUN.min(triangles - first) as usize, [0; 3]);
        mesh.read_faces(first, &mut faces)?;
        faces.retain(|face| !is_degenerate(*face));
        // Few enough that far vertices are picked one by one.
        corners.fill(mesh, &mut faces, 1 << 10)?;
        faces.iter().for_each(|face| visit(face.map(|v| corners.table[v as usize])));
    }
    Ok(())
}

impl<T: Coordinate, M: Mark> Triangles<'_, T, M> {
    pub(super) fn count(&self) -> u64 {
        match self {
            Triangles::Mesh(mesh, _) => mesh.face_count(),
            Triangles::Soup(soup) => soup.count(),
        }
    }

    /// Visits all triangles in order. Those that repeat a vertex are left out.
    fn visit(&self, passes: &Passes, visit: impl FnMut(&[Record<T, M>]) -> Result<()>) -> Result<()> {
        match self {
            Triangles::Soup(soup) => soup.each_block(visit),
            Triangles::Mesh(mesh, wanted) => passes.reading(*mesh, *wanted).for_each(0..reading::blocks(*mesh), visit),
        }
    }
}
