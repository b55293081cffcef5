//! The surface phase in the work folder: the mesh so far, and a journal of the places where stitching can begin again.
//!
//! ```text
//!  vertices    |=====|=======|======|===.          an extent for each line of the journal, and what is not in it yet
//!  attributes  |=====|=======|======|===.
//!  faces       |=====|=======|======|===.
//!  journal     line 0  line 1  line 2               a line: the ends of the extents, their checksums, the checkpoint
//! ```
//!
//! A run that goes on takes the last line up to which all extents have their checksums, cuts what lies behind it, and has slabs made from there on.

use std::time::Instant;

use serde::{Deserialize, Serialize};

use crate::error::Result;
use crate::grid::context::Context;
use crate::mesh::spool::MeshSpool;
use crate::points::attribute::Schema;
use crate::points::{Coordinate, Precision};
use crate::stitch::checkpoint::Checkpoint;
use crate::stitch::{Stitched, Stitcher};
use crate::storage::spool::Extent;
use crate::storage::work::WorkFolder;
use crate::storage::work::journal::Journal;
use crate::storage::work::store::NamedFile;

/// The phase, as the work folder names it.
const PHASE: &str = "surface";

/// A line of the journal.
#[derive(Debug, Serialize, Deserialize)]
struct Line {
    /// What was appended since the line before, to the vertices, the attributes and the faces.
    extents: [Extent; 3],
    checkpoint: Checkpoint,
    /// Whether the mesh is whole.
    whole: bool,
}

/// Where the surface is written to, and where it is told how far it is.
#[derive(Debug)]
pub(super) struct SurfaceLog<'a> {
    work: &'a WorkFolder,
    journal: Journal,
    files: [NamedFile; 3],
    told: Instant,
}

/// What an earlier run has made of the surface.
#[derive(Debug)]
pub(super) struct MadeBefore {
    /// Its vertices and triangles.
    pub mesh: MeshSpool,
    /// Where to go on.
    pub checkpoint: Checkpoint,
    /// Whether there is nothing left to do.
    pub whole: bool,
}

impl<'a> SurfaceLog<'a> {
    /// Begins the phase, or goes on with it.
    ///
    /// # Errors
    /// [`crate::Error::Damaged`], [`crate::Error::Io`].
    pub fn open(
        work: &'a WorkFolder,
        (precision, schema): (Precision, &Schema),
        context: &Context,
    ) -> Result<(SurfaceLog<'a>, MadeBefore)> {
        let there = work.load(PHASE, |manifest| {
            let [vertices, attributes, faces, journal] = manifest.files.as_slice() else {
                return Err(work.damaged(PHASE, "a file is missing"));
            };
            let files = [vertices, attributes, faces];
            let files = [work.open_file(files[0])?, work.open_file(files[1])?, work.open_file(files[2])?];
            Ok((files, work.open_file(journal)?))
        })?;
        let (files, journal, last) = match there {
            Some((files, journal)) => {
                let mut good: Option<(Line, u64)> = None;
                for (line, end) in Journal::lines(&journal).map_err(work.failed("read"))? {
                    let Ok(line) = Line::deserialize(line) else { break };
                    if !is_as_written(work, &files, &line, good.as_ref().map(|(line, _)| line), context)? {
                        break;
                    }
                    good = Some((line, end));
                }
                let end = good.as_ref().map_or(0, |(_, end)| *end);
                let journal = Journal::resumed(journal, end).map_err(work.failed("write"))?;
                (files, journal, good.map(|(line, _)| line))
            }
            None => {
                let [vertices, attributes, faces, journal] = ["vertices", "attributes", "faces", "journal"];
                let files = [work.create(vertices)?, work.create(attributes)?, work.create(faces)?];
                let journal = work.create(journal)?;
                let all = files.iter().chain([&journal]).cloned().collect();
                work.commit(PHASE, all, serde_json::Value::Null)?;
                (files, Journal::new(journal), None)
            }
        };
        let ends = last.as_ref().map_or([0; 3], |line| line.extents.map(|extent| extent.to));
        for (file, end) in files.iter().zip(ends) {
            file.file.cut(end).map_err(work.failed("write"))?;
        }
        let spools = [0, 1, 2].map(|i| context.workspace.spool_in(files[i].clone(), ends[i]));
        let mesh = MeshSpool::in_spools(precision, schema.clone(), spools);
        let whole = last.as_ref().is_some_and(|line| line.whole);
        let checkpoint = last.map_or_else(|| Checkpoint::at(0), |line| line.checkpoint);
        let log = SurfaceLog { work, journal, files, told: Instant::now() };
        Ok((log, MadeBefore { mesh, checkpoint, whole }))
    }

    /// Writes down how far the surface is, if it is time, and stitching can begin again there.
    ///
    /// # Errors
    /// [`crate::Error::Io`], of an earlier line, too.
    pub fn tell<T: Coordinate>(&mut self, stitcher: &mut Stitcher<'_, T>) -> Result<()> {
        // Making the last line durable takes a while: another one would only wait.
        if self.told.elapsed() < self.work.interval() || !self.work.committer().is_idle() {
            return Ok(());
        }
        self.tell_now(stitcher)
    }

    /// The same, whether it is time or not: as the run is being ended.
    ///
    /// # Errors
    /// [`crate::Error::Io`], of an earlier line, too.
    pub fn tell_now<T: Coordinate>(&mut self, stitcher: &mut Stitcher<'_, T>) -> Result<()> {
        let Some(checkpoint) = stitcher.checkpoint() else { return Ok(()) };
        // Whatever ended a write may have left a part of a slab behind.
        if !stitcher.mesh().holds(checkpoint.vertices, checkpoint.faces) {
            return Ok(());
        }
        self.told = Instant::now();
        let extents = stitcher.mesh_mut().extents();
        self.append(&Line { extents, checkpoint, whole: false })
    }

    /// Writes down that the mesh is whole, of so many slabs.
    ///
    /// # Errors
    /// [`crate::Error::Io`], of an earlier line, too.
    pub fn end(mut self, stitched: &mut Stitched, slabs: u32) -> Result<()> {
        let extents = stitched.mesh.extents();
        self.append(&Line { extents, checkpoint: stitched.checkpoint(slabs), whole: true })
    }

    fn append(&mut self, line: &Line) -> Result<()> {
        let write = self.journal.line(&serde_json::to_value(line).expect("a line can be written"));
        let (files, failed) = (self.files.clone(), self.work.failed("write"));
        self.work.committer().give(Box::new(move |durable| {
            let synced = if durable { files.iter().try_for_each(|file| file.file.sync()) } else { Ok(()) };
            synced.and_then(|()| write(durable)).map_err(failed)
        }))
    }
}

/// Whether the extents of a line follow those of the line before, and are what was written.
fn is_as_written(
    work: &WorkFolder,
    files: &[NamedFile; 3],
    line: &Line,
    before: Option<&Line>,
    context: &Context,
) -> Result<bool> {
    for (number, (file, extent)) in files.iter().zip(line.extents).enumerate() {
        let from = before.map_or(0, |before| before.extents[number].to);
        let length = file.file.length().map_err(work.failed("read"))?;
        if extent.from != from || extent.to < from || extent.to > length {
            return Ok(false);
        }
        if !work.is_as_written(file, extent, &context.workers)? {
            return Ok(false);
        }
    }
    Ok(true)
}
