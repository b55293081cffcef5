//! The tasks that make tiles of the mesh.

use std::ops::Range;

use super::{Task, Tasks};
use crate::error::{Error, Result};
use crate::format::write::tiling::Tiling;
use crate::grid::bucket::Compared;
use crate::grid::context::Context;
use crate::input::Cloud;
use crate::mesh::MeshSource;
use crate::points::Coordinate;
use crate::run::job::Job;
use crate::run::mesh_header::header_of;
use crate::run::phase::Phase;
use crate::run::place::tiling;
use crate::run::progress::Progress;
use crate::run::surface::Reconstructed;
use crate::settings::Settings;
use crate::storage::spool::{Extent, Spool};

impl Tasks {
    /// The shares of triangles that are sorted by tile, and the runs of tiles that are written: as many as there are pieces. None where the mesh is one file, or tasks do not make it.
    pub(super) fn tilings(&self) -> Range<usize> {
        if self.job.tile.is_some() && self.is_whole() { 0..self.plan.pieces.len() } else { 0..0 }
    }

    /// Does a task of the tiles.
    pub(super) fn tile<T: Coordinate>(
        &self,
        task: Task,
        (cloud, job, settings): (&Cloud, &Job, &Settings),
        context: &Context,
        progress: &mut Progress,
    ) -> Result<()> {
        // Whoever finishes compares all of the mesh with its checksums, and has it cut into tiles again where that is damaged.
        let made = self.reconstructed_as::<T>(task, settings, Compared::AsRead, context, progress)?;
        let mesh = if self.is_simplified() { self.mesh::<T>(task, Compared::AsRead, context)? } else { made.mesh };
        let made = Reconstructed { mesh, ..made };
        let tiling: Tiling = tiling(job, &self.files)?.ok_or_else(|| self.unknown(task))?;
        let of = self.tilings().len();
        let means = (&context.workers, &context.workspace);
        progress.begin(Phase::Write, Some(made.mesh.face_count() / of as u64));
        let phase = self.phase(task);
        let told = &mut |triangles| progress.add(triangles);
        let kinds = if let Task::Sort(_) = task { ["triangles", "index"] } else { ["files", "index"] };
        let named =
            [self.work.create(&format!("{}-{phase}", kinds[0]))?, self.work.create(&format!("{}-{phase}", kinds[1]))?];
        let mut out = named.clone().map(|file| context.workspace.spool_in(file, 0));
        let [first, second] = &mut out;
        match task {
            Task::Sort(number) => {
                tiling.sort_apart((&made.mesh, made.origin), (number, of), [first, second], means, told)?;
            }
            Task::Tile(number) => {
                let shares = self.tilings().map(|share| self.two_files(task, Task::Sort(share), context));
                let shares = shares.collect::<Result<Vec<_>>>()?;
                let memory = context.memory.working;
                let attributes = &job.input.attributes;
                let header = header_of(cloud, &self.plan.surveyed, settings, &made, attributes, &context.workers)?;
                let whole = (&made.mesh, &header);
                tiling.write_apart(whole, (&shares, (number, of)), [first, second], memory, means, told)?;
            }
            task => return Err(self.unknown(task)),
        }
        let extents = out.each_mut().map(Spool::extent);
        progress.end();
        self.work.commit(&phase, named.into(), serde_json::to_value(extents).expect("a manifest can be written"))
    }

    /// The two files of a task of the tiles, once they are found to be what was written.
    fn two_files(&self, task: Task, needed: Task, context: &Context) -> Result<[Spool; 2]> {
        let extents: [Extent; 2] = self.shown(task, needed)?;
        let means = (&context.workers, &context.workspace);
        Ok([self.spool_of((needed, 0), &extents[..1], means)?, self.spool_of((needed, 1), &extents[1..], means)?])
    }

    /// The tiles that were written, if tasks write them. Their bytes are compared with their checksums as they are read.
    pub(super) fn written_tiles(&self, task: Task, context: &Context) -> Result<Option<Vec<[Spool; 2]>>> {
        if self.tilings().is_empty() {
            return Ok(None);
        }
        let run = |number: usize| {
            let needed = Task::Tile(number);
            let [files, index]: [Extent; 2] = self.shown(task, needed)?;
            let means = (&context.workers, &context.workspace);
            let index = self.spool_of((needed, 1), &[index], means)?;
            Ok([self.spool_as_long((needed, 0), files, &context.workspace)?, index])
        };
        self.tilings().map(run).collect::<Result<Vec<_>>>().map(Some)
    }

    /// What is to be told of a run of tiles that is not what was written.
    pub(super) fn damaged_run(&self, number: usize) -> Error {
        let phase = self.phase(Task::Tile(number));
        let name = self.work.manifest(&phase).ok().flatten().and_then(|manifest| manifest.files.first().cloned());
        self.work.damaged(&name.unwrap_or_else(|| format!("done/{phase}.json")), "its bytes are not what was written")
    }
}
