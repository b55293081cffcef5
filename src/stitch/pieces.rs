//! Pieces: runs of slabs that are stitched side by side, each by itself, and joined at clean seams.
//!
//! ```text
//!   slabs   0   1   2   3   4   5   6   7   8
//!   piece 1                [ 3 ) 4 . 5 . 6 . 7 . 8      begins in the middle: slab 3 is added first, and not written
//!   piece 0 0 . 1 . 2 . 3 . 4 . 5                       goes on past its end until a seam is clean in its order, and in the other's: between 4 and 5, if
//!                             ^                         that between 3 and 4 was not
//! ```
//!
//! What the piece above made below the seam at which it is joined is cut off. A clean seam comes out on both sides as it does where stitching begins there, so the mesh, its figures and the
//! reports of seams are those of one stitcher, whatever the pieces. If no seam is clean in both orders, the piece below goes on to the end: then it is the whole mesh. A piece gives up
//! if none of its first seams is clean but that below it, as much of what it would make may be for nothing: the one below goes on through its slabs.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::time::Duration;

use super::checkpoint::{Checkpoint, Mark};
use super::counts::Counts;
use super::reach::SeamReport;
use super::slab::SlabMesh;
use super::{Stitched, Stitcher, within_limit};
use crate::error::defect;
use crate::error::{Error, Result};
use crate::mesh::MeshSource;
use crate::mesh::spool::MeshSpool;
use crate::points::Coordinate;
use crate::resources::workers::{Spares, Workers};

/// How long a piece waits for the one above before the wish to stop is looked at again.
const LOOK: Duration = Duration::from_millis(50);

const NO_PANIC: &str = "nothing panics while it is held";

/// What pieces are made with.
pub struct Means<'m, 'a, T> {
    /// The pool that makes the slabs of all pieces.
    pub workers: &'m Workers,
    /// Slabs of a piece that exist at a time between their making and their seam.
    pub in_flight: usize,
    /// A piece gives up if of so many seams above the one that it begins with none is clean.
    pub tries: u32,
    /// A stitcher that begins at a checkpoint, for piece `.0`.
    pub stitcher: &'m (dyn Fn(usize, &Checkpoint) -> Stitcher<'a, T> + Sync),
    /// Makes a slab.
    pub make: &'m (dyn Fn(u32) -> Result<SlabMesh<T>> + Sync),
    /// Told of each slab once when a stitcher has taken it, and of the bytes that its mesh has grown by.
    pub taken: &'m (dyn Fn(u32, u64) + Sync),
    /// Where `make` takes room from: slabs that are no longer needed.
    pub spares: &'m Spares<SlabMesh<T>>,
}

/// How a piece ended.
#[derive(Debug, Clone, Copy, PartialEq)]
enum End {
    /// Joined to a piece above at the seam below a slab.
    Joined { slab: u32, with: usize },
    /// After the last slab.
    Whole,
    /// As none of its first seams is clean but that below it.
    GivenUp,
    /// With an error.
    Failed,
}

/// What a piece tells those below it.
#[derive(Debug, Default)]
struct Told {
    /// Its clean seams, from where it began.
    marks: Vec<Mark>,
    /// The seams below all slabs before this one have been closed.
    closed: u32,
    /// A piece below is joined to it.
    is_joined: bool,
    end: Option<End>,
}

/// What a piece made.
struct Made {
    /// The slab that it began with.
    first: u32,
    mesh: MeshSpool,
    counts: Counts,
    areas: Vec<f64>,
    seams: Vec<SeamReport>,
    /// The piece that it was joined to, and what is written of that below the seam.
    joined: Option<(usize, Mark)>,
}

/// The copies of slabs that several pieces begin or end with: each is made once.
struct Copies<T>(Mutex<BTreeMap<u32, Copied<T>>>);

/// How many are going to take it still, and the copy, if it was made.
type Copied<T> = (usize, Option<SlabMesh<T>>);

/// All pieces of a mesh.
struct Pieces<'m, 'a, T> {
    means: &'m Means<'m, 'a, T>,
    ranges: &'m [Range<u32>],
    told: Vec<(Mutex<Told>, Condvar)>,
    copies: Copies<T>,
    /// The slabs that a stitcher has taken.
    taken: Vec<AtomicBool>,
}

/// Stitches ranges of slabs that follow each other, from slab 0 on, side by side; the first on the calling thread.
///
/// # Errors
/// That of the lowest piece that has one: those of making slabs and of [`Stitcher::add`]; [`Error::Interrupted`]; [`Error::Internal`] for a panic.
///
/// # Panics
/// If there is no range, or one but the first is empty.
pub fn stitch<T: Coordinate>(ranges: &[Range<u32>], means: &Means<'_, '_, T>) -> Result<Stitched> {
    assert!(!ranges.is_empty() && ranges[1..].iter().all(|range| !range.is_empty()), "each piece has a slab");
    let told = ranges.iter().map(|_| Default::default()).collect();
    let taken = (0..slabs_of(ranges)).map(|_| AtomicBool::new(false)).collect();
    let pieces = Pieces { means, ranges, told, copies: Copies::of(ranges), taken };
    let mut made: Vec<Result<Option<Made>>> = ranges.iter().map(|_| Ok(None)).collect();
    let (first, others) = made.split_first_mut().expect("there is a range");
    std::thread::scope(|scope| {
        let mut left = Vec::new();
        for (number, made) in (1..).zip(others) {
            // If the system refuses a thread, what was for it is still here.
            let run = Arc::new(Mutex::new(Some(made)));
            let (own, pieces) = (Arc::clone(&run), &pieces);
            let work = move || {
                let made = own.lock().expect(NO_PANIC).take();
                made.into_iter().for_each(|made| *made = pieces.made(number));
            };
            let thread = std::thread::Builder::new().name(format!("asra-piece-{number}"));
            if thread.spawn_scoped(scope, work).is_err() {
                left.extend(run.lock().expect(NO_PANIC).take().map(|made| (number, made)));
            }
        }
        // From the highest on: each waits for those above it only.
        left.into_iter().rev().for_each(|(number, made)| *made = pieces.made(number));
        *first = pieces.made(0);
    });
    let made: Result<Vec<Option<Made>>> = made.into_iter().collect();
    joined(made?)
}

/// The pieces as one.
fn joined(mut pieces: Vec<Option<Made>>) -> Result<Stitched> {
    let twice = || Error::Internal("a piece that is not there".into());
    let Made { mut mesh, mut counts, mut areas, mut seams, joined, .. } = pieces[0].take().ok_or_else(twice)?;
    let mut next = joined;
    while let Some((number, mark)) = next {
        let above = pieces[number].take().ok_or_else(twice)?;
        // It has an area of each slab from the first on, and a seam of each but the first.
        let cut = (mark.slab - above.first) as usize;
        mesh.join(above.mesh.cut(mark.vertices, mark.faces));
        counts = counts.and(above.counts.without(mark.counts));
        areas.extend_from_slice(&above.areas[cut..]);
        seams.extend_from_slice(&above.seams[cut..]);
        next = above.joined;
    }
    within_limit(mesh.vertex_count())?;
    // In the order of slabs, as one stitcher adds them.
    counts.bridged_area = areas.into_iter().fold(0.0, |sum, area| sum + area);
    Ok(Stitched { mesh, counts, seams })
}

impl<T: Coordinate> Pieces<'_, '_, T> {
    /// Makes a piece. None if it gave up, or one above it failed.
    fn made(&self, number: usize) -> Result<Option<Made>> {
        let made = defect::caught(|| self.run(number));
        let end = match &made {
            Ok(Some(Made { joined: Some((with, mark)), .. })) => End::Joined { slab: mark.slab, with: *with },
            Ok(Some(Made { joined: None, .. })) => End::Whole,
            Ok(None) | Err(_) => End::Failed,
        };
        // One that has given up has said so.
        self.tell(number, |told| _ = told.end.get_or_insert(end));
        made
    }

    fn run(&self, number: usize) -> Result<Option<Made>> {
        let Means { in_flight, tries, stitcher, .. } = *self.means;
        let (start, slabs) = (self.ranges[number].start, slabs_of(self.ranges));
        let mut stitcher = stitcher(number, &Checkpoint::at(start));
        let (mut above, mut mark) = (number + 1, None);
        if number > 0 {
            let upto = start.saturating_add(1).saturating_add(tries).min(self.upto(above));
            mark = self.pass(number, upto, in_flight, &mut stitcher)?;
            if self.gives_up(number, tries) {
                return Ok(None);
            }
        }
        loop {
            let upto = self.upto(above);
            if stitcher.next() < upto {
                mark = self.pass(number, upto, in_flight, &mut stitcher)?;
            }
            while above < self.ranges.len() && !self.has_given_up(above) {
                if let Some(own) = mark {
                    match self.mark_above(&mut above, own.slab)? {
                        Above::Clean(mark) => {
                            let joined = Some((above, mark));
                            return Ok(Some(self.ended(start, stitcher.end_here(), joined)));
                        }
                        Above::Dirty => {}
                        Above::Failed => return Ok(None),
                    }
                }
                let next = stitcher.next();
                if next == slabs {
                    break;
                }
                // One at a time: it may well be the last.
                mark = self.pass(number, next + 1, in_flight.min(2), &mut stitcher)?;
            }
            if stitcher.next() == slabs {
                return Ok(Some(self.ended(start, stitcher.finish_piece()?, None)));
            }
            above += 1;
        }
    }

    /// The first slab that a piece does not pass over before it looks for a seam at which it can be joined to one above.
    fn upto(&self, above: usize) -> u32 {
        // The slab above the last one closes the seam between them.
        self.ranges.get(above).map_or(slabs_of(self.ranges), |range| range.start + 1)
    }

    /// Has a piece take all slabs up to one. Gives what the last seam is, if it is clean.
    fn pass(&self, number: usize, upto: u32, in_flight: usize, stitcher: &mut Stitcher<'_, T>) -> Result<Option<Mark>> {
        let Means { workers, taken, spares, .. } = *self.means;
        let first = stitcher.next();
        let mut mark = None;
        let take = |slab: SlabMesh<T>| {
            let (at, before) = (stitcher.next(), stitcher.mesh().bytes());
            stitcher.add(slab)?.into_iter().for_each(|slab| spares.give(slab));
            mark = stitcher.mark();
            self.tell(number, |told| {
                told.marks.extend(mark);
                told.closed = at + 1;
            });
            if !self.taken[at as usize].swap(true, Ordering::Relaxed) {
                taken(at, stitcher.mesh().bytes() - before);
            }
            Ok(())
        };
        workers.in_order_range(in_flight, (upto - first) as usize, |job| self.slab(first + job as u32), take)?;
        Ok(mark)
    }

    /// Whether a piece gives up: of so many seams above where it begins, none is clean, and no piece was joined to it.
    fn gives_up(&self, number: usize, tries: u32) -> bool {
        let (told, changed) = &self.told[number];
        let (mut told, start) = (told.lock().expect(NO_PANIC), self.ranges[number].start);
        let is_in_vain =
            told.closed.saturating_sub(start + 1) >= tries && told.marks.iter().all(|mark| mark.slab <= start);
        if is_in_vain && !told.is_joined && told.end.is_none() {
            told.end = Some(End::GivenUp);
            changed.notify_all();
        }
        told.end == Some(End::GivenUp)
    }

    fn has_given_up(&self, number: usize) -> bool {
        self.told[number].0.lock().expect(NO_PANIC).end == Some(End::GivenUp)
    }

    fn ended(&self, first: u32, (stitched, areas): (Stitched, Vec<f64>), joined: Option<(usize, Mark)>) -> Made {
        let Stitched { mesh, counts, seams } = stitched;
        Made { first, mesh, counts, areas, seams, joined }
    }

    /// A slab of the pass over a piece: made, or a copy of what another piece made.
    fn slab(&self, number: u32) -> Result<SlabMesh<T>> {
        if let Some(slab) = self.copies.take(number) {
            // It takes the place of one that would have been made in spare room.
            drop(self.means.spares.take());
            return Ok(slab);
        }
        let slab = (self.means.make)(number)?;
        self.copies.keep(number, &slab);
        Ok(slab)
    }

    fn tell(&self, number: usize, tell: impl FnOnce(&mut Told)) {
        let (told, changed) = &self.told[number];
        tell(&mut told.lock().expect(NO_PANIC));
        changed.notify_all();
    }

    /// What the piece above says of the seam below a slab, waiting until it knows. Where that piece ends before, the one it was joined to takes its place.
    fn mark_above(&self, above: &mut usize, slab: u32) -> Result<Above> {
        loop {
            let (told, changed) = &self.told[*above];
            let mut told: MutexGuard<'_, Told> = told.lock().expect(NO_PANIC);
            loop {
                match told.end {
                    Some(End::Failed) => return Ok(Above::Failed),
                    Some(End::GivenUp) => return Ok(Above::Dirty),
                    Some(End::Joined { slab: end, with }) if slab >= end => {
                        *above = with;
                        break;
                    }
                    _ => {}
                }
                if slab < told.closed || told.end == Some(End::Whole) {
                    let mark = told.marks.iter().find(|mark| mark.slab == slab).copied();
                    told.is_joined |= mark.is_some();
                    return Ok(mark.map_or(Above::Dirty, Above::Clean));
                }
                self.means.workers.check_cancelled()?;
                told = changed.wait_timeout(told, LOOK).expect(NO_PANIC).0;
            }
        }
    }
}

/// The number of slabs that ranges have.
fn slabs_of(ranges: &[Range<u32>]) -> u32 {
    ranges.last().map_or(0, |range| range.end)
}

/// What a piece says of a seam.
enum Above {
    Clean(Mark),
    Dirty,
    Failed,
}

impl<T: Coordinate> Copies<T> {
    /// Of the slabs that each piece passes over: its own, the one before and the one after.
    fn of(ranges: &[Range<u32>]) -> Copies<T> {
        let slabs = slabs_of(ranges);
        let mut users: BTreeMap<u32, Copied<T>> = BTreeMap::new();
        for boundary in ranges[1..].iter().map(|range| range.start) {
            for number in [boundary - 1, boundary] {
                let uses =
                    |range: &&Range<u32>| (range.start.saturating_sub(1)..(range.end + 1).min(slabs)).contains(&number);
                users.entry(number).or_insert_with(|| (ranges.iter().filter(uses).count(), None));
            }
        }
        Copies(Mutex::new(users))
    }

    /// A copy of a slab, if one was made; whoever takes one is one user less. A piece that goes on past its end may take what another would have.
    fn take(&self, number: u32) -> Option<SlabMesh<T>> {
        let mut copies = self.0.lock().expect(NO_PANIC);
        let (users, copy) = copies.get_mut(&number)?;
        *users = users.checked_sub(1)?;
        if *users == 0 { copy.take() } else { copy.clone() }
    }

    /// Keeps a copy of a slab as long as somebody is going to take it.
    fn keep(&self, number: u32, slab: &SlabMesh<T>) {
        let mut copies = self.0.lock().expect(NO_PANIC);
        if let Some((1.., copy)) = copies.get_mut(&number) {
            *copy = Some(slab.clone());
        }
    }
}
