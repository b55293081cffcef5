//! The tasks that leave triangles out of the mesh.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::{Task, Tasks};
use crate::error::Result;
use crate::grid::bucket::Compared;
use crate::grid::context::Context;
use crate::mesh::MeshSource;
use crate::mesh::spool::MeshSpool;
use crate::points::Coordinate;
use crate::resources::workers::Workers;
use crate::run::phase::Phase;
use crate::run::progress::Progress;
use crate::run::saved_mesh::SavedMesh;
use crate::run::simplification::{Lengths, options};
use crate::simplify::apart::{self, Left, PASSES, Planes};
use crate::simplify::{Figures, Given, Options};
use crate::storage::spool::{Extent, Spool, Workspace};
use crate::storage::work::store::NamedFile;

/// What a task that deals has left: where the triangles of each row lie.
#[derive(Debug, Serialize, Deserialize)]
struct Dealt {
    rows: Vec<Extent>,
}

/// What is saved of a simplified mesh beside its vertices, attributes and triangles.
#[derive(Debug, Serialize, Deserialize)]
struct Numbered {
    figures: Figures,
    mesh: SavedMesh,
}

impl Tasks {
    /// Whether tasks leave triangles out.
    pub(super) fn is_simplified(&self) -> bool {
        self.job.settings.simplify.is_some() && self.is_whole()
    }

    /// The passes that there may be.
    pub(super) fn passes(&self) -> Range<usize> {
        if self.is_simplified() { 0..PASSES } else { 0..0 }
    }

    /// The planes of a pass.
    pub(super) fn planes(&self, task: Task, pass: usize) -> Result<Planes> {
        self.shown(task, Task::Planes(pass))
    }

    /// The tasks that deal a pass's triangles: as many as there are pieces, or as the pass before has left files.
    pub(super) fn deals(&self, task: Task, pass: usize) -> Result<Vec<Task>> {
        let count = match pass {
            0 => self.plan.pieces.len(),
            _ => self.runs(&self.planes(task, pass - 1)?),
        };
        Ok((0..count).map(|number| Task::Deal(pass, number)).collect())
    }

    /// The tasks that simplify a pass's rows.
    pub(super) fn simplifies(&self, pass: usize, planes: &Planes) -> Vec<Task> {
        (0..self.runs(planes)).map(|number| Task::Simplify(pass, number)).collect()
    }

    /// Runs of rows.
    fn runs(&self, planes: &Planes) -> usize {
        planes.rows().min(self.plan.pieces.len())
    }

    /// All tasks of the simplification that are known of.
    pub(super) fn simplifying(&self) -> Result<Vec<Task>> {
        let mut tasks = Vec::new();
        for pass in self.passes() {
            tasks.push(Task::Planes(pass));
            if !self.work.is_done(&self.phase(Task::Planes(pass))) {
                break;
            }
            tasks.extend(self.deals(Task::Finish, pass)?);
            tasks.extend(self.simplifies(pass, &self.planes(Task::Finish, pass)?));
        }
        tasks.push(Task::Number);
        Ok(tasks)
    }

    /// Waits a while for what a task of a pass needs.
    pub(super) fn wait_for_pass(&self, task: Task, pass: usize, workers: &Workers) -> Result<()> {
        if let Some(before) = pass.checked_sub(1) {
            self.wait_for(task, [Task::Planes(before)], workers)?;
            let planes = self.planes(task, before)?;
            if planes.are_last() {
                return Err(self.unknown(task));
            }
            self.wait_for(task, self.simplifies(before, &planes), workers)?;
        }
        if let Task::Planes(_) = task {
            return Ok(());
        }
        self.wait_for(task, [Task::Planes(pass)], workers)?;
        let dealing = self.deals(task, pass)?;
        if let Task::Deal(..) = task {
            return if dealing.contains(&task) { Ok(()) } else { Err(self.unknown(task)) };
        }
        if !self.simplifies(pass, &self.planes(task, pass)?).contains(&task) {
            return Err(self.unknown(task));
        }
        self.wait_for(task, dealing, workers)
    }

    /// Waits a while for the last pass.
    pub(super) fn wait_for_last_pass(&self, task: Task, workers: &Workers) -> Result<()> {
        for pass in self.passes() {
            self.wait_for(task, [Task::Planes(pass)], workers)?;
            let planes = self.planes(task, pass)?;
            self.wait_for(task, self.simplifies(pass, &planes), workers)?;
            if planes.are_last() {
                break;
            }
        }
        Ok(())
    }

    fn options(&self, mesh: &MeshSpool) -> Result<Options> {
        let surveyed = &self.plan.surveyed;
        let longest = surveyed.survey.bounds.longest_side();
        let lengths = Lengths { cell: Some(surveyed.grid.cell_size()), longest };
        let asked = self.job.settings.simplify.as_ref();
        let asked = asked.ok_or_else(|| crate::Error::Internal("tasks of no simplification".into()))?;
        options(asked, lengths, mesh.schema())
    }

    /// Does a task of the simplification.
    pub(super) fn simplify<T: Coordinate>(&self, task: Task, context: &Context, progress: &mut Progress) -> Result<()> {
        // Whoever finishes compares all of the mesh with its checksums, and has it simplified again where that is damaged.
        let mesh = self.stitched::<T>(task, Compared::AsRead, context)?.mesh;
        let options = self.options(&mesh)?;
        let (workers, workspace) = (&context.workers, &context.workspace);
        let budget = context.memory.working;
        let given = Given { mesh: &mesh, options: &options, budget, workers, workspace, kept: None };
        let triangles = mesh.face_count();
        progress.begin(Phase::Simplify, Some(triangles));
        let phase = self.phase(task);
        let file = || self.work.create(&format!("triangles-{phase}"));
        match task {
            Task::Planes(pass) => {
                let planes = apart::planes(given, pass, self.left_before(task, pass, context)?)?;
                let rest = serde_json::to_value(planes).expect("a manifest can be written");
                self.work.commit(&phase, Vec::new(), rest)?;
            }
            Task::Deal(pass, number) => {
                let planes = self.planes(task, pass)?;
                let before = match pass.checked_sub(1) {
                    None => None,
                    Some(before) => Some(self.left(task, Task::Simplify(before, number), context)?),
                };
                let named = file()?;
                let mut out = context.workspace.spool_in(named.clone(), 0);
                let rows = apart::deal(given, &planes, (number, self.plan.pieces.len()), before, &mut out)?;
                let rest = serde_json::to_value(Dealt { rows }).expect("a manifest can be written");
                self.work.commit(&phase, vec![named], rest)?;
            }
            Task::Simplify(pass, number) => {
                let planes = self.planes(task, pass)?;
                let runs = self.runs(&planes);
                let rows = planes.rows() * number / runs..planes.rows() * (number + 1) / runs;
                let dealt = self.deals(task, pass)?.into_iter().map(|deal| self.dealt(task, deal, &rows, context));
                let dealt = dealt.collect::<Result<Vec<_>>>()?;
                let named = file()?;
                let out = context.workspace.spool_in(named.clone(), 0);
                let told = &mut |part: f64| progress.set((part * triangles as f64) as u64);
                let before = pass.checked_sub(1).map(|before| self.planes(task, before)).transpose()?;
                let left = apart::rows(given, (&planes, before.as_ref()), rows, &dealt, out, told)?;
                let rest = serde_json::to_value(left).expect("a manifest can be written");
                self.work.commit(&phase, vec![named], rest)?;
            }
            Task::Number => self.number(given, context)?,
            _ => return Err(self.unknown(task)),
        }
        progress.end();
        Ok(())
    }

    /// What all tasks of the pass before have left; nothing before the first.
    fn left_before(&self, task: Task, pass: usize, context: &Context) -> Result<Vec<(Left, Spool)>> {
        let Some(before) = pass.checked_sub(1) else { return Ok(Vec::new()) };
        let needed = self.simplifies(before, &self.planes(task, before)?);
        needed.into_iter().map(|needed| self.left(task, needed, context)).collect()
    }

    /// What a task has left.
    fn left(&self, task: Task, needed: Task, context: &Context) -> Result<(Left, Spool)> {
        let left: Left = self.shown(task, needed)?;
        let spool = self.spool_of((needed, 0), &[left.extent], (&context.workers, &context.workspace))?;
        Ok((left, spool))
    }

    /// What a task has dealt to some rows.
    fn dealt(&self, task: Task, needed: Task, rows: &Range<usize>, context: &Context) -> Result<(Vec<Extent>, Spool)> {
        let Dealt { rows: extents } = self.shown(task, needed)?;
        let needed_rows = extents.get(rows.clone()).unwrap_or_default();
        let spool = self.spool_of((needed, 0), needed_rows, (&context.workers, &context.workspace))?;
        Ok((extents, spool))
    }

    /// A task's file of that number of which stretches are read, once these are found to be what was written.
    pub(super) fn spool_of(
        &self,
        (needed, number): (Task, usize),
        extents: &[Extent],
        (workers, workspace): (&Workers, &Workspace),
    ) -> Result<Spool> {
        let (name, file) = self.file_of((needed, number))?;
        for extent in extents {
            if !self.work.is_as_written(&file, *extent, workers)? {
                return Err(self.work.damaged(&name, "its bytes are not what was written"));
            }
        }
        let length = extents.iter().map(|extent| extent.to).max().unwrap_or(0);
        Ok(workspace.spool_in(file, length))
    }

    /// The same of a file that is as long as it was; whoever reads its bytes compares them with what was written.
    pub(super) fn spool_as_long(&self, of: (Task, usize), extent: Extent, workspace: &Workspace) -> Result<Spool> {
        let (name, file) = self.file_of(of)?;
        if file.file.length().map_err(self.work.failed("read"))? < extent.to {
            return Err(self.work.damaged(&name, "it is shorter than what was written"));
        }
        Ok(workspace.spool_in(file, extent.to))
    }

    fn file_of(&self, (needed, number): (Task, usize)) -> Result<(String, NamedFile)> {
        let name = self.work.manifest(&self.phase(needed))?.and_then(|manifest| manifest.files.get(number).cloned());
        let name = name.ok_or_else(|| self.missing(Task::Finish, needed))?;
        let file = self.work.open_file(&name)?;
        Ok((name, file))
    }

    /// Numbers what the last pass has left.
    fn number(&self, given: Given<'_>, context: &Context) -> Result<()> {
        let mut last = None;
        for pass in self.passes() {
            let planes = self.planes(Task::Number, pass)?;
            let is_last = planes.are_last();
            last = Some((pass, planes));
            if is_last {
                break;
            }
        }
        let (pass, planes) = last.ok_or_else(|| self.unknown(Task::Number))?;
        let needed = self.simplifies(pass, &planes);
        let left = needed.into_iter().map(|needed| self.left(Task::Number, needed, context)).collect::<Result<_>>()?;
        let phase = self.phase(Task::Number);
        let named = SavedMesh::files(&self.work, &phase)?;
        let out = named.clone().map(|file| context.workspace.spool_in(file, 0));
        let (mut mesh, figures) = apart::numbered(given, pass + 1, left, out)?;
        let rest = serde_json::to_value(Numbered { figures, mesh: SavedMesh::of(&mut mesh) });
        self.work.commit(&phase, named.into(), rest.expect("a manifest can be written"))
    }

    /// The mesh that all passes have left, and how many triangles that is.
    pub(super) fn numbered<T: Coordinate>(
        &self,
        task: Task,
        compared: Compared,
        context: &Context,
    ) -> Result<(MeshSpool, Figures)> {
        let Numbered { figures, mesh } = self.shown(task, Task::Number)?;
        let mesh = self.mesh_in_files::<T>(Task::Number, mesh, compared, context)?;
        Ok((mesh, figures))
    }
}
