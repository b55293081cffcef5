//! Pieces that are made apart, by processes that know nothing of each other, and what becomes of them as one mesh.
//!
//! ```text
//!   slabs     0   1   2   3   4   5   6   7   8
//!   piece 0   0 . 1 . 2 . 3 . 4)                    a piece ends once the seam above its last slab is closed
//!   piece 1              (3 . 4 . 5 . 6 . 7)        begins with a slab that it does not write
//!   piece 2                          (6 . 7 . 8
//!   bridge 0          (2 . 3 . 4 . 5)               from the last clean seam of piece 0 to the first that is clean in piece 1, too
//!
//!   mesh      0   1   2 : 2   3   4 : 5   6 : 7   8       pieces 0, bridge 0, 1, 2
//! ```
//!
//! Where the seam between two pieces is clean in both, they are joined there. Where it is not, a *bridge* goes on from the lower piece, from the highest place where
//! stitching can begin, up to a seam that is clean in its order and in that of the piece it has come to. [`chain`] tells which parts of which pieces and bridges the mesh is of. It
//! is that of one stitcher, whatever the pieces ([`super::pieces`]).

use std::collections::BTreeMap;
use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::checkpoint::{Checkpoint, Mark};
use super::counts::Counts;
use super::pieces::Means;
use super::reach::SeamReport;
use super::within_limit;
use crate::error::Result;
use crate::mesh::MeshSource;
use crate::mesh::spool::MeshSpool;
use crate::points::Coordinate;

/// What is known of a piece or a bridge that was made, beside its vertices and triangles.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Apart {
    /// The first slab that it writes.
    pub first: u32,
    /// The slab behind the last that it writes.
    pub end: u32,
    /// Its clean seams.
    marks: Vec<MarkBits>,
    /// Vertices and triangles of all that it writes.
    pub sizes: [u64; 2],
    /// What became of the vertices, but for the area.
    counts: Counts,
    /// The bits of the area of bridged triangles of each slab.
    areas: Vec<u64>,
    /// Its seams, from the one above the first slab on.
    seams: Vec<SeamReport>,
    /// Of a bridge, the piece that it comes to.
    pub to: Option<usize>,
}

/// [`Mark`] without the area, of which text may not have all bits; areas are added up anew.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct MarkBits {
    slab: u32,
    sizes: [u64; 2],
    counts: Counts,
}

impl MarkBits {
    fn of(Mark { slab, vertices, faces, counts }: Mark) -> MarkBits {
        MarkBits { slab, sizes: [vertices, faces], counts: Counts { bridged_area: 0.0, ..counts } }
    }
}

impl Apart {
    fn mark(&self, slab: u32) -> Option<&MarkBits> {
        self.marks.iter().find(|mark| mark.slab == slab)
    }

    /// The highest slab from which on stitching can go on.
    fn last_mark(&self) -> Option<u32> {
        self.marks.last().map(|mark| mark.slab)
    }
}

/// Makes a piece: a range of all slabs.
///
/// # Errors
/// Those of making slabs and of stitching them; [`crate::Error::Interrupted`].
pub fn piece<T: Coordinate>(range: Range<u32>, slabs: u32, means: &Means<'_, '_, T>) -> Result<(MeshSpool, Apart)> {
    // The slab above the last one closes the seam between them.
    let upto = if range.end == slabs { slabs } else { range.end + 1 };
    made(range.start, upto, slabs, (upto, means), |_| None)
}

/// Makes the bridge from a piece to those above it.
///
/// # Errors
/// The same as [`piece`].
///
/// # Panics
/// If the piece is the last.
pub fn bridge<T: Coordinate>(
    from: usize,
    pieces: &[Apart],
    slabs: u32,
    means: &Means<'_, '_, T>,
) -> Result<(MeshSpool, Apart)> {
    let first = pieces[from].last_mark().unwrap_or(pieces[from].first);
    let end = pieces[from].end;
    let arrived = |slab: u32| {
        // Below the end of the lower piece there is nothing to come to.
        let to = (from + 1..pieces.len()).find(|number| slab < pieces[*number].end || *number + 1 == pieces.len())?;
        (slab >= end && pieces[to].mark(slab).is_some()).then_some(to)
    };
    // Any slab may be the last.
    made(first, slabs, slabs, (2, means), arrived)
}

/// Stitches slabs from `first` on, up to `upto`, or to a clean seam at which `arrived` tells a piece; after so many slabs at the most, it is looked whether there is one.
fn made<T: Coordinate>(
    first: u32,
    upto: u32,
    slabs: u32,
    (looks, means): (u32, &Means<'_, '_, T>),
    arrived: impl Fn(u32) -> Option<usize>,
) -> Result<(MeshSpool, Apart)> {
    let Means { workers, in_flight, stitcher, make, taken, spares, .. } = *means;
    let mut stitcher = stitcher(0, &Checkpoint::at(first));
    let (mut marks, mut to) = (Vec::new(), None);
    let mut next = stitcher.next();
    while next < upto && to.is_none() {
        let now = looks.min(upto - next);
        workers.in_order_range(
            in_flight,
            now as usize,
            |job| make(next + job as u32),
            |slab| {
                if to.is_some() {
                    spares.give(slab);
                    return Ok(());
                }
                let (at, before) = (stitcher.next(), stitcher.mesh().bytes());
                stitcher.add(slab)?.into_iter().for_each(|slab| spares.give(slab));
                if (first..upto).contains(&at) {
                    taken(at, stitcher.mesh().bytes() - before);
                }
                if let Some(mark) = stitcher.mark() {
                    to = arrived(mark.slab);
                    marks.push(MarkBits::of(mark));
                }
                Ok(())
            },
        )?;
        next += now;
    }
    let whole = to.is_none() && upto == slabs;
    let (stitched, areas) = if whole { stitcher.finish_piece()? } else { stitcher.end_here() };
    let sizes = [stitched.mesh.vertex_count(), stitched.mesh.face_count()];
    let apart = Apart {
        first,
        end: first + areas.len() as u32,
        marks,
        sizes,
        counts: Counts { bridged_area: 0.0, ..stitched.counts },
        areas: areas.into_iter().map(f64::to_bits).collect(),
        seams: stitched.seams,
        to,
    };
    Ok((stitched.mesh, apart))
}

/// The pieces that the mesh needs a bridge from, as far as can be told by the seams between pieces alone.
pub fn bridges(pieces: &[Apart]) -> Vec<usize> {
    let is_joined = |pair: &[Apart]| pair[0].mark(pair[0].end).is_some() && pair[1].mark(pair[0].end).is_some();
    // A piece that has no clean seam is never come to; the first is there from the beginning.
    let is_reached = |number: usize| number == 0 || !pieces[number].marks.is_empty();
    (0..pieces.len().saturating_sub(1)).filter(|n| is_reached(*n) && !is_joined(&pieces[*n..*n + 2])).collect()
}

/// A piece or a bridge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Of {
    /// The piece of a number.
    Piece(usize),
    /// The bridge from a piece.
    Bridge(usize),
}

/// A part of the mesh: what a piece or a bridge has of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    /// Which has it.
    pub of: Of,
    /// Of its vertices, and of its triangles, those that are the mesh's.
    pub within: [Range<u64>; 2],
}

/// What the mesh is made of, from the lowest part on.
#[derive(Debug, Clone, PartialEq)]
pub struct Chain {
    /// Its parts.
    pub links: Vec<Link>,
    /// What became of the vertices.
    pub counts: Counts,
    /// How each seam was closed.
    pub seams: Vec<SeamReport>,
}

impl Chain {
    /// Vertices and triangles.
    pub fn sizes(&self) -> [u64; 2] {
        let size = |kind: usize| self.links.iter().map(|link| link.within[kind].end - link.within[kind].start).sum();
        [size(0), size(1)]
    }
}

/// The mesh of pieces and of the bridges that [`bridges`] asks for; None if one of these is missing.
///
/// # Errors
/// [`crate::Error::TooManyElements`] if a mesh file cannot number its vertices.
pub fn chain(pieces: &[Apart], bridges: &BTreeMap<usize, Apart>) -> Result<Option<Chain>> {
    let mut chain = Chain { links: Vec::new(), counts: Counts::default(), seams: Vec::new() };
    let mut area = 0.0;
    // Where the part begins, and with which slab.
    let (mut of, mut from) = (Of::Piece(0), pieces.first().map_or(0, |piece| piece.first));
    loop {
        let apart = match of {
            Of::Piece(number) => &pieces[number],
            Of::Bridge(number) => &bridges[&number],
        };
        // Where it ends, and what comes then.
        let (end, next) = match of {
            Of::Bridge(_) => (apart.end, apart.to.map(Of::Piece)),
            Of::Piece(number) if number + 1 == pieces.len() => (apart.end, None),
            Of::Piece(number) => {
                let joins = |piece: &Apart| piece.mark(apart.end).is_some();
                if joins(apart) && joins(&pieces[number + 1]) {
                    (apart.end, Some(Of::Piece(number + 1)))
                } else if let Some(bridge) = bridges.get(&number) {
                    (bridge.first, Some(Of::Bridge(number)))
                } else {
                    return Ok(None);
                }
            }
        };
        let zero = MarkBits { slab: apart.first, sizes: [0; 2], counts: Counts::default() };
        let all = MarkBits { slab: apart.end, sizes: apart.sizes, counts: apart.counts };
        let at = |slab: u32| if slab == apart.first { Some(&zero) } else { apart.mark(slab) };
        let low = at(from).expect("parts are joined at clean seams");
        // What is written up to the end is there, whether the seam is clean or not.
        let high = if end == apart.end { &all } else { at(end).expect("bridges begin at clean seams") };
        chain.links.push(Link { of, within: [0, 1].map(|kind| low.sizes[kind]..high.sizes[kind]) });
        chain.counts = chain.counts.and(high.counts.without(low.counts));
        let slabs = (from - apart.first) as usize..(end - apart.first) as usize;
        area = apart.areas[slabs.clone()].iter().fold(area, |sum, bits| sum + f64::from_bits(*bits));
        // A seam above each slab, but for the last of all.
        chain.seams.extend_from_slice(&apart.seams[slabs.start..slabs.end.min(apart.seams.len())]);
        match next {
            Some(next) => (of, from) = (next, end),
            None => break,
        }
    }
    within_limit(chain.sizes()[0])?;
    chain.counts.bridged_area = area;
    Ok(Some(chain))
}
