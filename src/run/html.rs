//! The page that a run is reported on: its mesh is drawn and packed before the mesh gets its name, the figures come after.

use std::path::Path;

use bytesize::ByteSize;
use serde_json::{Value, json};

use crate::error::{Error, Result};
use crate::mesh::MeshSource;
use crate::render;
use crate::render::page::{Chart, Document};
use crate::resources::memory::MemoryPlan;
use crate::resources::workers::Workers;
use crate::run::progress::Warning;
use crate::run::report::Report;
use crate::storage::atomic_file::AtomicFile;
use crate::storage::spool::Workspace;

/// A page that is going to be.
pub struct PlannedPage {
    file: AtomicFile,
    options: render::Options,
    sheet: bool,
}

/// A page that lacks its figures.
pub struct ShownPage {
    file: AtomicFile,
    document: Document,
}

impl PlannedPage {
    /// A page on a mesh that is drawn as `options` say; `sheet` tells whether it may have a boundary.
    pub fn new(file: AtomicFile, options: render::Options, sheet: bool) -> PlannedPage {
        PlannedPage { file, options, sheet }
    }

    /// Draws the mesh, to whose places an origin is to be added, and packs it.
    ///
    /// # Errors
    /// [`Error::Budget`] with the budget that leaves room for it; those of [`Document::show`].
    pub fn show(
        self,
        mesh: (&dyn MeshSource, [f64; 3]),
        plan: &MemoryPlan,
        means: (&Workers, &Workspace),
        progress: &mut dyn FnMut(f64),
    ) -> Result<ShownPage> {
        let PlannedPage { file, options, sheet } = self;
        let least = Document::least_memory(mesh.0, &options);
        if plan.working < least {
            let needed = (plan.budget - plan.working + least).next_multiple_of(1 << 20);
            return Err(Error::Budget { given: ByteSize(plan.budget), needed: ByteSize(needed), what: "the page" });
        }
        let mut document = Document { sheet, ..Document::default() };
        document.show(mesh, &options, plan.working, means, progress)?;
        Ok(ShownPage { file, document })
    }
}

impl ShownPage {
    /// Writes what is told of the run, and gives the page its name.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write(self, report: &Report) -> Result<()> {
        let ShownPage { file, mut document } = self;
        let named = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        document.title = match (report.output.path.as_deref(), report.output.tileset.is_some()) {
            (Some(path), true) => path.parent().map(named).unwrap_or_default(),
            (path, _) => path.map(named).unwrap_or_default(),
        };
        document.summary = report.told();
        let told = |Warning { message, advice }: &Warning| match advice {
            Some(advice) => format!("{message}: {advice}"),
            None => message.clone(),
        };
        document.warnings = report.warnings.iter().map(told).collect();
        let vertices = [
            ("at a point", report.vertices.fitted),
            ("at a sharp edge", report.vertices.creased),
            ("on the sphere of points", report.vertices.projected),
            ("pulled towards a point", report.vertices.pulled),
            ("no point within reach", report.vertices.unfitted),
            ("across a hole", report.vertices.bridged),
            ("contracted into others", report.vertices.contracted),
        ];
        document.charts = vec![
            Chart::Bars {
                title: "What became of the vertices".into(),
                unit: "",
                bars: vertices.map(|(name, count)| (name.to_owned(), count as f64)).into(),
            },
            Chart::Bars {
                title: "Seconds in each phase".into(),
                unit: " s",
                bars: report.seconds.iter().map(|(phase, seconds)| (phase.words().0.to_owned(), *seconds)).collect(),
            },
        ];
        document.remark = "A run does not measure how far points lie from the surface: \
                           asra-stream compare MESH CLOUD --html REPORT.html does."
            .to_owned()
            + &document.remark;
        let mut whole = serde_json::to_value(report).map_err(|words| Error::Internal(words.to_string()))?;
        let mut take = |key: &str| whole.get_mut(key).map(Value::take).unwrap_or_default();
        document.figures = vec![
            ("Settings".into(), take("parameters")),
            ("Input".into(), json!({ "files": take("inputs"), "points": take("points"), "ground": take("ground") })),
            (
                "Grid and closing".into(),
                json!({ "grid": take("grid"), "points_to_a_cell": take("points_to_a_cell"), "closing": take("closing") }),
            ),
            (
                "Surface".into(),
                json!({
                    "fit": take("fit"), "vertices": take("vertices"), "trimmed": take("trimmed"), "simplification": take("simplification"),
                }),
            ),
            ("Check".into(), take("check")),
            ("Output".into(), take("output")),
            ("Memory".into(), json!({ "seconds": take("seconds_total"), "memory": take("memory") })),
        ];
        document.write(file)
    }
}
