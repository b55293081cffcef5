//! A simplification that several processes make together, task by task, each in files of its own. What is left is what [`super::simplify`] leaves.
//!
//! ```text
//!   pass 0    mesh  ─► planes ─► dealt/0 ─┬► left/0 ─┬► pass 1 ─► … ─► numbered anew
//!                                dealt/1 ─┤  left/1 ─┤
//!                                …       ─┘  …      ─┘
//! ```
//!
//! A pass first finds the planes that cut space. Each share of the triangles is then dealt to the rows of parts that these lie in, and each run of rows is simplified by itself.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::mark::{Mark, Marks};
use super::passes::{self, SHARES, Triangles, meeting_rows};
use super::reading::blocks;
use super::soup::{BLOCK, Record, Soup, each_block};
use super::space::Space;
use super::{Figures, Given, limits};
use crate::error::Result;
use crate::mesh::spool::MeshSpool;
use crate::points::{Coordinate, Precision};
use crate::storage::partitions::Partitions;
use crate::storage::spool::{self, Spool};

/// The most passes that a simplification makes.
pub const PASSES: usize = SHARES.len();

/// The planes of a pass.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub struct Planes {
    space: Space,
    pass: usize,
}

impl Planes {
    /// Rows of parts, each of which is simplified in one go.
    pub fn rows(&self) -> usize {
        passes::rows(&self.space)
    }

    /// Whether no pass comes after this one.
    pub fn are_last(&self) -> bool {
        self.pass + 1 == PASSES || self.space.parts() == 1
    }
}

/// Triangles that a task has left in a file.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Left {
    /// Where they lie in it.
    pub extent: spool::Extent,
    /// The bits of how far any place has drifted, and of how much any channel of a colour has changed.
    most: [u64; 2],
}

fn joined<T: Coordinate, M: Mark>(left: Vec<(Left, Spool)>) -> Soup<T, M> {
    let most = |which: usize| left.iter().map(|(left, _)| f64::from_bits(left.most[which])).fold(0.0, f64::max);
    let most = [most(0), most(1)];
    Soup::joined(left.into_iter().map(|(_, spool)| spool).collect(), most)
}

/// What a pass is made of: the mesh itself, or what the pass before has left.
fn triangles<'a, T: Coordinate, M: Mark>(
    given: &Given<'a>,
    before: Option<&'a Soup<T, M>>,
) -> Result<Triangles<'a, T, M>> {
    match before {
        Some(soup) => Ok(Triangles::Soup(soup)),
        None => Ok(Triangles::Mesh(given.mesh, given.wanted::<M>()?)),
    }
}

/// Finds the planes of a pass, the first of which begins with the mesh, others with what all tasks of the pass before have left.
///
/// # Errors
/// Those of [`super::simplify`].
pub fn planes(given: Given<'_>, pass: usize, before: Vec<(Left, Spool)>) -> Result<Planes> {
    typed!(given.extent(), planes_as(given, pass, before))
}

fn planes_as<T: Coordinate, M: Mark>(given: Given<'_>, pass: usize, before: Vec<(Left, Spool)>) -> Result<Planes> {
    let soup = (pass > 0).then(|| joined::<T, M>(before));
    let from = triangles(&given, soup.as_ref())?;
    Ok(Planes { space: given.passes::<T, M>()?.space(&from, SHARES[pass])?, pass })
}

/// Deals a share of a pass's triangles to rows of parts: number `share.0` of `share.1` equal ones of the mesh in the first pass, and what one task of the pass before has left in
/// others. `out` is empty. Tells where those of each row lie in it.
///
/// # Errors
/// Those of [`super::simplify`].
pub fn deal(
    given: Given<'_>,
    planes: &Planes,
    share: (usize, usize),
    before: Option<(Left, Spool)>,
    out: &mut Spool,
) -> Result<Vec<spool::Extent>> {
    typed!(given.extent(), deal_as(given, planes, share, before, out))
}

/// What is called with triangles, some at a time.
type Visit<'v, T, M> = &'v mut dyn FnMut(&[Record<T, M>]) -> Result<()>;

fn deal_as<T: Coordinate, M: Mark>(
    given: Given<'_>,
    planes: &Planes,
    (number, of): (usize, usize),
    before: Option<(Left, Spool)>,
    out: &mut Spool,
) -> Result<Vec<spool::Extent>> {
    let passes = given.passes::<T, M>()?;
    let soup = before.map(|left| joined::<T, M>(vec![left]));
    let each = |visit: Visit<'_, T, M>| match &soup {
        Some(soup) => soup.each_block(visit),
        None => {
            let blocks = blocks(given.mesh);
            let end = |number: usize| (u128::from(blocks) * number as u128 / of as u128) as u64;
            passes.reading(given.mesh, given.wanted::<M>()?).for_each(end(number)..end(number + 1), visit)
        }
    };
    let rows = planes.rows();
    if rows == 1 {
        each(&mut |records| out.append(bytemuck::cast_slice(records)).map(drop))?;
        return Ok(vec![out.extent()]);
    }
    let mut dealt = passes.rows_of::<T, M>(rows);
    each(&mut |records| {
        records.iter().try_for_each(|record| meeting_rows(&planes.space, record, |row| dealt.push(row, record)))
    })?;
    (0..rows)
        .map(|row| {
            let mut block = Vec::with_capacity(BLOCK);
            dealt.read(row, |record| {
                block.push(*record);
                if block.len() < BLOCK {
                    return Ok(());
                }
                let put = out.append(bytemuck::cast_slice(&block)).map(drop);
                block.clear();
                put
            })?;
            out.append(bytemuck::cast_slice(&block))?;
            Ok(out.extent())
        })
        .collect()
}

/// Simplifies some rows of a pass, with its planes and those of the one before, if there is one: of each share that was dealt, in order, `dealt` has where the triangles of each row lie, and the file. `out` is empty, and gets what is left.
///
/// # Errors
/// Those of [`super::simplify`].
pub fn rows(
    given: Given<'_>,
    planes: (&Planes, Option<&Planes>),
    rows: Range<usize>,
    dealt: &[(Vec<spool::Extent>, Spool)],
    out: Spool,
    progress: &mut dyn FnMut(f64),
) -> Result<Left> {
    typed!(given.extent(), rows_as(given, planes, rows, dealt, out, progress))
}

fn rows_as<T: Coordinate, M: Mark>(
    given: Given<'_>,
    (planes, before_it): (&Planes, Option<&Planes>),
    rows: Range<usize>,
    dealt: &[(Vec<spool::Extent>, Spool)],
    out: Spool,
    progress: &mut dyn FnMut(f64),
) -> Result<Left> {
    let passes = given.passes::<T, M>()?;
    let limits = limits(given.options, given.colours::<M>());
    let mut left = Soup::<T, M>::in_spool(out);
    let (first, count) = (rows.start, rows.len());
    for row in rows {
        // In the order in which one process has them: partitions are read from the last record on, and rows, where there are several, are partitions, too.
        let read = |push: &mut dyn FnMut(&Record<T, M>) -> Result<()>| {
            let mut read = |(extents, spool): &(Vec<spool::Extent>, Spool)| {
                let spool::Extent { from, to, .. } = extents[row];
                each_block::<T, M>(spool, from..to, |records| records.iter().try_for_each(&mut *push))
            };
            match planes.rows() {
                1 => dealt.iter().try_for_each(&mut read),
                _ => dealt.iter().rev().try_for_each(&mut read),
            }
        };
        let fine: Partitions<Record<T, M>> = passes.parts_of_row(&planes.space, row, read)?;
        let space = (&planes.space, before_it.map(|planes| &planes.space));
        passes.row(space, row, &fine, limits, |records| left.append(&records))?;
        progress((row + 1 - first) as f64 / count as f64);
    }
    Ok(Left { extent: left.extent(), most: [left.reached, left.recoloured].map(f64::to_bits) })
}

/// The mesh of what the last pass has left, in spools of vertices, attributes and triangles, which are empty.
///
/// # Errors
/// Those of [`super::simplify`].
pub fn numbered(
    given: Given<'_>,
    passes: usize,
    left: Vec<(Left, Spool)>,
    out: [Spool; 3],
) -> Result<(MeshSpool, Figures)> {
    typed!(given.extent(), numbered_as(given, passes, left, out))
}

fn numbered_as<T: Coordinate, M: Mark>(
    given: Given<'_>,
    passes: usize,
    left: Vec<(Left, Spool)>,
    out: [Spool; 3],
) -> Result<(MeshSpool, Figures)> {
    let of = given.passes::<T, M>()?;
    of.made.set(passes as u64);
    super::finished(given.mesh, given.options, &joined::<T, M>(left), given.colours::<M>(), &of, Some(out))
}
