//! Tasks that are planned anew as files of the input have changed: what is to be done again, and what stays.
//!
//! ```text
//!   a file changed    ─► the segments that read it are sorted again, and the cells closed
//!   a piece, a bridge ─► is made again if anything that it has read is not what it was: points of a bucket, cells of a slice, columns
//!   the rest          ─► check and finish, since triangles have other numbers
//! ```
//!
//! Where the grid, the attributes or the kind of surface changes with the input, all is done again.

use std::collections::BTreeSet;
use std::ops::Range;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::{PlannedSegment, Task, TaskPlan, Tasks, phase_of};
use crate::error::Result;
use crate::grid::bucket::Buckets;
use crate::grid::trace::{Digests, digest};
use crate::input::Segment;
use crate::points::Coordinate;
use crate::run::closed_cells::ClosedCells;
use crate::run::surface::{origin, surface_options};
use crate::settings::Settings;
use crate::solid::close::Closed;
use crate::stitch::apart::Apart;
use crate::storage::spool::Extent;
use crate::storage::work::Manifest;

/// What a piece or a bridge was made of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Reads {
    /// Of settings, the grid and all that is not read slice by slice.
    whole: u64,
    /// Of the points of buckets.
    points: Digests,
    /// Of slices of occupied cells, and of solid ones.
    occupied: Digests,
    solid: Digests,
    /// Of slices of columns, if the surface is seen from one side.
    columns: Option<[Digests; 2]>,
    /// Of the slices of membranes, if there are any.
    membranes: Option<Digests>,
    /// Of what is known of the pieces that a bridge joins: the first of these, the last, and the digest.
    joined: Option<(usize, usize, u64)>,
}

/// What is saved of a piece or a bridge beside its vertices, attributes and triangles.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct SavedApart {
    pub apart: Apart,
    /// Of the three files.
    pub extents: [Extent; 3],
    /// What it was made of.
    pub reads: Reads,
}

/// From now on it is told what is read.
pub(super) fn trace<T: Coordinate>(buckets: &mut Buckets<T>, cells: &mut ClosedCells) {
    let Closed { solid, occupancy, membranes, .. } = &mut cells.closed;
    buckets.trace();
    occupancy.store.trace();
    solid.store.trace();
    if let Some(ground) = &mut solid.ground {
        ground.trace();
    }
    if let Some(membranes) = membranes {
        membranes.trace();
    }
}

impl Reads {
    /// What was read since [`trace`], by a bridge from a piece to another, too.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn since<T: Coordinate>(
        whole: u64,
        (buckets, cells): (&Buckets<T>, &ClosedCells),
        joined: Option<(usize, usize)>,
        pieces: &[Apart],
    ) -> Result<Reads> {
        let Closed { solid, occupancy, membranes, .. } = &cells.closed;
        Ok(Reads {
            whole,
            points: buckets.traced(),
            occupied: occupancy.store.traced()?,
            solid: solid.store.traced()?,
            columns: solid.ground.as_ref().map(|ground| ground.traced()).transpose()?,
            membranes: membranes.as_ref().map(|membranes| membranes.traced()).transpose()?,
            joined: joined.map(|(from, to)| (from, to, of_pieces(&pieces[from..=to]))),
        })
    }

    /// Whether all of it is still what it was.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn are_same<T: Coordinate>(
        &self,
        whole: u64,
        (buckets, cells): (&Buckets<T>, &ClosedCells),
        pieces: &[Apart],
    ) -> Result<bool> {
        let Closed { solid, occupancy, membranes, .. } = &cells.closed;
        let columns = both(&self.columns, &solid.ground, |before, now| now.are_same(before))?;
        let membranes = both(&self.membranes, membranes, |before, now| now.are_same(before))?;
        let joined = self
            .joined
            .is_none_or(|(from, to, before)| pieces.get(from..=to).is_some_and(|pieces| of_pieces(pieces) == before));
        Ok(self.whole == whole
            && columns
            && membranes
            && joined
            && buckets.are_same(&self.points)
            && occupancy.store.are_same(&self.occupied)?
            && solid.store.are_same(&self.solid)?)
    }
}

/// Whether there was none and is none, or what was and what is are the same.
fn both<B, N>(before: &Option<B>, now: &Option<N>, are_same: impl FnOnce(&B, &N) -> Result<bool>) -> Result<bool> {
    match (before, now) {
        (Some(before), Some(now)) => are_same(before, now),
        (None, None) => Ok(true),
        _ => Ok(false),
    }
}

fn of_pieces(pieces: &[Apart]) -> u64 {
    digest(&serde_json::to_vec(pieces).expect("what is saved can be written"))
}

impl Tasks {
    /// The digest of all that decides a piece's bytes and is not read slice by slice.
    pub(super) fn whole(&self, settings: &Settings, cells: &ClosedCells) -> u64 {
        let TaskPlan { surveyed, schema, slabs, pieces, .. } = &self.plan;
        let precision = surveyed.workload.precision;
        let origin = origin(precision, &surveyed.survey.bounds);
        let common = cells.closed.solid.ground.as_ref().map(|ground| ground.common());
        let membranes = cells.closed.membranes.as_ref().map(|membranes| membranes.common());
        let of_surface = (surface_options(settings, cells), cells.counted, common, membranes);
        digest(
            format!("{of_surface:?} {:?} {schema:?} {precision:?} {origin:?} {slabs} {pieces:?}", surveyed.grid)
                .as_bytes(),
        )
    }

    /// What an earlier generation has left of a piece or a bridge.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub(super) fn earlier(&self, task: Task) -> Result<Option<(Manifest, SavedApart)>> {
        for generation in (0..self.plan.generation).rev() {
            if let Some(manifest) = self.work.manifest(&phase_of(task, generation))? {
                let saved = SavedApart::deserialize(&manifest.rest).ok();
                return Ok(saved.map(|saved| (manifest, saved)));
            }
        }
        Ok(None)
    }
}

/// The segments of a new generation: those of which no file has changed stay as they are.
pub(super) fn segments(
    before: &[PlannedSegment],
    (old_files, old_states): (&[PathBuf], &[Value]),
    (files, states, blocks): (&[PathBuf], &[Value], &[u64]),
    generation: u32,
) -> Vec<PlannedSegment> {
    let mut parts: Vec<Vec<(usize, Range<u64>)>> = vec![Vec::new(); before.len()];
    let mut changed = vec![false; parts.len()];
    // Where the file before this one ends: a new one goes with it.
    let mut last = 0;
    let mut is_left = vec![true; old_files.len()];
    for (number, file) in files.iter().enumerate() {
        let Some(old) = old_files.iter().position(|old| old == file) else {
            if blocks[number] == 0 {
                continue;
            }
            parts[last].push((number, 0..blocks[number]));
            changed[last] = true;
            continue;
        };
        is_left[old] = false;
        let readers: Vec<(usize, Range<u64>)> = (before.iter().enumerate())
            .filter_map(|(segment, planned)| Some((segment, planned.segment.range_of(old)?)))
            .collect();
        let there = readers.iter().map(|(_, range)| range.end).max().unwrap_or(0);
        let is_same = old_states[old] == states[number] && there == blocks[number];
        for (segment, range) in &readers {
            // In the same proportions as before.
            let scaled = |at: u64| match there {
                _ if is_same => at,
                0 => 0,
                _ => (u128::from(at) * u128::from(blocks[number]) / u128::from(there)) as u64,
            };
            let range = scaled(range.start)..scaled(range.end);
            changed[*segment] |= !is_same;
            if !range.is_empty() {
                parts[*segment].push((number, range));
            }
            last = *segment;
        }
        if readers.is_empty() && blocks[number] > 0 {
            // It had no points.
            parts[last].push((number, 0..blocks[number]));
            changed[last] = true;
        }
    }
    for (old, _) in is_left.iter().enumerate().filter(|(_, left)| **left) {
        for (changed, planned) in changed.iter_mut().zip(before) {
            *changed |= planned.segment.reads(old);
        }
    }
    let renewed = parts.into_iter().zip(changed).zip(before);
    renewed
        .map(|((files, changed), old)| PlannedSegment {
            segment: Segment(files),
            generation: if changed { generation } else { old.generation },
        })
        .collect()
}

/// Files that a message names.
const NAMED: usize = 3;

/// A line about what has changed and what is to be done again.
pub(super) fn told(before: &TaskPlan, plan: &TaskPlan) -> String {
    let state = |of: &TaskPlan, file: &PathBuf| {
        let number = of.files.iter().position(|other| other == file)?;
        Some(of.states[number].clone())
    };
    let mut changes = Vec::new();
    for file in &plan.files {
        match state(before, file) {
            None => changes.push(format!("{} is new", file.display())),
            was if was != state(plan, file) => changes.push(format!("{} has changed", file.display())),
            _ => {}
        }
    }
    changes.extend(
        before.files.iter().filter(|file| !plan.files.contains(file)).map(|file| format!("{} is gone", file.display())),
    );
    if changes.is_empty() {
        changes.push("the files come in another order".to_owned());
    }
    let more = changes.len().saturating_sub(NAMED);
    changes.truncate(NAMED);
    let mut line = changes.join(", ");
    if more > 0 {
        line += &format!(", and {more} more");
    }
    let sorted: Vec<String> = (plan.segments.iter().enumerate())
        .filter(|(_, segment)| segment.generation == plan.generation)
        .map(|(number, _)| Task::Bucket(number).to_string())
        .collect();
    match (before.basis == plan.basis, sorted.len()) {
        (true, 0) => line + ": the cells are closed again, and pieces that see another point are made again",
        (true, _) => format!(
            "{line}: {} and close are to be done again, then pieces that see another point, and the check; the other {} segments stay sorted",
            sorted.join(", "),
            plan.segments.len() - sorted.len()
        ),
        (false, _) => {
            line + ": all is to be done again, as the grid has changed with it; one of a given `cell_size` stays where the box of all points does"
        }
    }
}

/// The phases of earlier generations that nobody needs any more.
pub(super) fn stale(plan: &TaskPlan, done: &BTreeSet<String>) -> BTreeSet<String> {
    let sorted = (0..plan.segments.len()).map(|number| plan.phase_of(Task::Bucket(number)));
    let mut kept: BTreeSet<String> = sorted.chain([TaskPlan::phase(plan.generation)]).collect();
    for number in 0..plan.pieces.len() {
        for task in [Task::Piece(number), Task::Bridge(number)] {
            let newest = (0..=plan.generation).rev().map(|generation| phase_of(task, generation));
            kept.extend(newest.into_iter().find(|phase| done.contains(phase)));
        }
    }
    kept.insert(crate::run::files_to_mesh::OUTPUT.to_owned());
    done.difference(&kept).cloned().collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A file: its name, its state, its blocks.
    type File = (u8, u8, u64);

    proptest! {
        /// Every block of every file is in one segment, and a segment that stays has the same blocks of the same files.
        #[test]
        fn segments_hold_every_block_once_and_stay_where_no_file_has_changed(
            old in proptest::collection::btree_map(0u8..12, (0u8..3, 0u64..9), 1..9),
            new in proptest::collection::btree_map(0u8..12, (0u8..3, 0u64..9), 1..9),
            kept in 0u8..12,
            count in 1usize..5,
        ) {
            let old: Vec<File> = old.into_iter().map(|(name, (state, blocks))| (name, state, blocks)).collect();
            // Some are what they were.
            let same = |name: u8| old.iter().find(|file| file.0 == name && name >= kept).copied();
            let mut new: Vec<File> =
                new.into_iter().map(|(name, (state, blocks))| same(name).unwrap_or((name, 3 + state, blocks))).collect();
            new.extend(old.iter().filter(|file| file.0 >= kept && !new.iter().any(|other| other.0 == file.0)).copied().collect::<Vec<_>>());
            let blocks = |files: &[File]| files.iter().map(|file| file.2).collect::<Vec<_>>();
            let paths = |files: &[File]| files.iter().map(|file| PathBuf::from(file.0.to_string())).collect::<Vec<_>>();
            let states = |files: &[File]| files.iter().map(|file| Value::from(file.1)).collect::<Vec<_>>();
            let before = PlannedSegment::all(&Segment::cut(&blocks(&old), count), 0);
            let after = segments(&before, (&paths(&old), &states(&old)), (&paths(&new), &states(&new), &blocks(&new)), 1);
            prop_assert_eq!(after.len(), before.len());
            for (number, file) in new.iter().enumerate() {
                let mut held: Vec<u64> =
                    after.iter().flat_map(|planned| planned.segment.range_of(number).unwrap_or(0..0)).collect();
                held.sort_unstable();
                prop_assert_eq!(held, (0..file.2).collect::<Vec<u64>>(), "file {}", number);
            }
            let named = |segment: &Segment, files: &[File]| {
                let named = segment.0.iter().map(|(number, range)| (files[*number], range.start, range.end));
                named.collect::<BTreeSet<_>>()
            };
            for (before, after) in before.iter().zip(&after) {
                let is_same = named(&before.segment, &old) == named(&after.segment, &new);
                prop_assert_eq!(after.generation == 0, is_same);
            }
        }
    }
}
