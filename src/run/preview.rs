//! The preview: a picture of the mesh that is drawn before both get their names.

use std::path::{Path, PathBuf};

use bytesize::ByteSize;

use crate::error::{Error, Result};
use crate::format::tiles3d::is_named;
use crate::mesh::MeshSource;
use crate::points::attribute::Schema;
use crate::points::bounds::Bounds;
use crate::points::unit::Measure;
use crate::render::{self, ColourBy, Legend, View};
use crate::resources::memory::MemoryPlan;
use crate::resources::workers::Workers;
use crate::settings::Settings;
use crate::settings::open::{Kind, Open};
use crate::storage::atomic_file::AtomicFile;
use crate::storage::spool::Workspace;

/// Memory for a preview, unless less is there: more would let it be drawn at once instead of in a few bands, and take longer to clear.
const PREVIEW_MEMORY: u64 = 128 << 20;

/// Whether a picture of the mesh is drawn.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum Preview {
    /// None is.
    #[default]
    None,
    /// One with the mesh's name and .png.
    Beside,
    /// One of this name.
    At(PathBuf),
}

impl Preview {
    /// Where it goes, beside the mesh `output`.
    pub fn path(&self, output: &Path) -> Option<PathBuf> {
        match self {
            Preview::None => None,
            // A tileset's folder is not there yet.
            Preview::Beside if is_named(output) => output.parent().map(|folder| folder.with_extension("png")),
            Preview::Beside => Some(output.with_extension("png")),
            Preview::At(path) => Some(path.clone()),
        }
    }
}

/// A preview that is going to be drawn.
pub struct PlannedPreview {
    file: AtomicFile,
    options: render::Options,
}

/// A preview that is drawn, but has no name yet.
pub struct DrawnPreview {
    file: AtomicFile,
    picture: render::Picture,
}

impl PlannedPreview {
    /// A preview of what `settings` make of a cloud, whose coordinates are in `measure`.
    pub fn new(
        file: AtomicFile,
        settings: &Settings,
        bounds: &Bounds,
        schema: &Schema,
        measure: Option<Measure>,
    ) -> PlannedPreview {
        let legend = Legend::In(measure);
        PlannedPreview { file, options: render::Options { legend, ..options(settings, bounds, schema) } }
    }

    /// Whether the plan leaves room to draw it.
    ///
    /// # Errors
    /// [`Error::Budget`] with the budget that would.
    pub fn check_memory(&self, plan: &MemoryPlan) -> Result<()> {
        let least = render::least_memory(&self.options);
        if plan.working >= least {
            return Ok(());
        }
        let needed = (plan.budget - plan.working + least).next_multiple_of(1 << 20);
        Err(Error::Budget { given: ByteSize(plan.budget), needed: ByteSize(needed), what: "the preview" })
    }

    /// Draws it, in as much of `memory` bytes as is of use.
    ///
    /// # Errors
    /// Errors of [`render::render`].
    pub fn draw(
        self,
        mesh: &dyn MeshSource,
        memory: u64,
        workers: &Workers,
        workspace: &Workspace,
        progress: &mut dyn FnMut(u64),
    ) -> Result<DrawnPreview> {
        let PlannedPreview { file, options } = self;
        let memory = memory.min(PREVIEW_MEMORY).max(render::least_memory(&options));
        let picture = render::render(mesh, &options, memory, workers, workspace, progress)?;
        Ok(DrawnPreview { file, picture })
    }
}

impl DrawnPreview {
    /// Gives it its name, which is returned.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write(self) -> Result<PathBuf> {
        let path = self.file.path().to_path_buf();
        self.picture.write(self.file)?;
        Ok(path)
    }
}

/// Two views, from where the surface was seen, in colours if it has any.
pub(super) fn options(settings: &Settings, bounds: &Bounds, schema: &Schema) -> render::Options {
    let [iso, behind] = [View::iso(), View::from_angles(125.0, 30.0)];
    let (views, plain) = match &settings.open {
        None => (vec![iso, behind], ColourBy::None),
        Some(Open { kind: Kind::Terrain | Kind::Ground, .. }) => (vec![iso, View::top()], ColourBy::Height),
        Some(Open { kind: Kind::Sheet, facing, .. }) => {
            let seen = View::from_direction(facing.direction(bounds));
            let aside = View::from_angles(seen.azimuth + 40.0, (seen.elevation + 20.0).min(90.0));
            (vec![seen, aside], ColourBy::None)
        }
    };
    let coloured = ["red", "green", "blue"].iter().all(|name| schema.column(name).is_some());
    let colour_by = if coloured { ColourBy::Rgb } else { plain };
    render::Options { size: render::Size { width: 1200, height: 800 }, views, colour_by, ..Default::default() }
}
