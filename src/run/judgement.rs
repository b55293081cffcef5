//! What may be wrong with a mesh, by what the report says, and what can be done about that.

use crate::error::words::{short, thousands};
use crate::grid::partition::REACH;
use crate::points::bounds::Bounds;
use crate::run::advice;
use crate::run::progress::Warning;
use crate::run::report::{Closing, PatchReport, Report};
use crate::run::simplification;
use crate::settings::surface::Fit;

/// Points to an occupied cell from which the summary says that cells are too coarse. Even scans have ten at most by default, dense clouds with cells of a chosen size a
/// hundred; of a cloud with one point a thousand times as far away as the others, nearly all points share a cell.
const CROWDED: f64 = 1000.0;

/// The part of the surface that bridges holes from which the summary warns of it, and the mesh is not called sealed.
const MUCH_BRIDGED: f64 = 0.02;

/// Triangles to a point of a closed mesh from which finer cells bring the surface no nearer.
const MANY_TRIANGLES: f64 = 2.0;

/// Pieces of a closed mesh from which the summary warns of them: an object, and some beside it, may be meant.
const MANY_COMPONENTS: u64 = 10;

impl Report {
    /// Judges the run by what the rest of the report says: whether the mesh encloses the inside, what may be wrong with it, and what can be done about that.
    pub fn judge(&mut self) {
        self.closing.bridged = self.bridged_share();
        // What ends somewhere encloses nothing.
        self.closing.ends = self.trimmed.is_some_and(|trimmed| trimmed.triangles > 0);
        self.closing.sealed = !self.closing.ends
            && self.closing.parted
            && self.closing.narrow_handles == 0
            && self.closing.too_wide.is_none()
            && self.closing.steady != Some(false)
            && self.closing.over_holes() < MUCH_BRIDGED;
        self.warnings = self.find_warnings();
    }

    fn find_warnings(&self) -> Vec<Warning> {
        let mut found = Vec::new();
        if self.points.dropped > 0 {
            let dropped = thousands(self.points.dropped);
            found.push(Warning::bare(format!("{dropped} points left out: a coordinate is not a number, or infinite")));
        }
        for (path, remark) in self.inputs.iter().filter_map(|input| Some((&input.path, input.remark.as_ref()?))) {
            found.push(Warning::bare(format!("{}: {remark}", path.display())));
        }
        found.extend(self.foreseen.iter().cloned());
        if self.points_to_a_cell > CROWDED && self.foreseen.is_empty() {
            let crowd = thousands(self.points_to_a_cell as u64);
            found.push(Warning::new(
                format!("{crowd} points to an occupied cell, on average: too coarse to show what they are of"),
                "points far away may stretch the box; --bounds leaves them out, and --cell-size makes cells finer",
            ));
        }
        found.extend(self.noise());
        found.extend(self.too_fine());
        if self.parameters.open.is_none() {
            found.extend(self.closing.warnings(self.grid.cell_size));
        }
        if self.closing.parted && self.closing.steady == Some(false) {
            found.push(Warning::bare(
                "not sealed: the points are too sparse for the shape; if its surface is moved a little inwards or outwards, it has other pieces or handles",
            ));
        }
        if self.closing.over_holes() >= MUCH_BRIDGED {
            let (share, which) = match self.closing.bridged.filter(|share| *share >= self.closing.spanned) {
                Some(share) => (share, format!("it is farther than {REACH} cells from any point")),
                None => (self.closing.spanned, "gaps of more than three sampling distances".to_owned()),
            };
            let advice = match self.parameters.open {
                Some(_) => "--max-hole bounds the holes that are bridged",
                None => "asra-stream compare MESH CLOUD --heatmap FILE shows where",
            };
            found.push(Warning::new(format!("{:.1} % of the surface bridges holes: {which}", 100.0 * share), advice));
        }
        let parts = self.check.as_ref().map_or(0, |check| check.components);
        if parts >= MANY_COMPONENTS && self.parameters.open.is_none() {
            found.push(Warning::new(
                format!("the mesh is in {} pieces", thousands(parts)),
                format!(
                    "--min-component largest keeps one; larger cells (--cell-size {}) may join them",
                    short(2.0 * self.grid.cell_size)
                ),
            ));
        }
        found.extend(self.simplification.as_ref().and_then(simplification::warning));
        if self.vertices.tangled > 0 {
            let tangled = thousands(self.vertices.tangled);
            found.push(Warning::bare(format!("{tangled} pairs of triangles still intersect")));
        }
        found
    }

    /// A shell so thick that nothing tells it from a filled body: vertices lie on points, which is wrong if it is noise.
    fn noise(&self) -> Option<Warning> {
        let shell = self.fit.shell.filter(|shell| self.fit.onto.has_points() && shell.fills_blocks())?;
        Some(Warning::new(
            format!(
                "points fill the space round the surface, {:.2} cells thick or more: the mesh lies on the outermost of them",
                shell.thickness
            ),
            format!("if that is noise, --cell-size {} lays the mesh amid them", short(2.0 * self.grid.cell_size)),
        ))
    }

    /// Cells that were asked for and are so fine that the mesh has more triangles than its points can carry.
    fn too_fine(&self) -> Option<Warning> {
        let asked = &self.parameters;
        if asked.k.is_none() && asked.slices.is_none() && asked.cell_size.is_none() || asked.open.is_some() {
            return None;
        }
        let made = self.simplification.as_ref().map(|figures| figures.before);
        let made = made.or(self.check.as_ref().map(|check| check.triangles))?;
        let to_a_point = made as f64 / self.points.count as f64;
        (to_a_point > MANY_TRIANGLES).then(|| {
            Warning::new(
                format!("cells are finer than points can carry: {to_a_point:.1} triangles to a point"),
                advice::CARRIED,
            )
        })
    }

    /// The part of the surface that bridges holes, if the mesh was checked and its vertices are fitted to points.
    fn bridged_share(&self) -> Option<f64> {
        let check = self.check.as_ref().filter(|check| check.area > 0.0)?;
        (self.parameters.surface.fit != Fit::None).then(|| self.vertices.bridged_area / check.area)
    }
}

/// What is wrong where slots, voids or walls are too narrow for cells of this side.
fn narrow_slots(side: f64) -> Warning {
    Warning::new(
        format!(
            "not sealed: some slots, voids or walls are hardly wider than {}, the side of the cells that tell inside from outside; they may be filled or missing",
            short(side)
        ),
        "--bounds, for a part of the cloud, makes these cells finer, as far as the samples allow",
    )
}

impl Closing {
    /// The part of the surface that bridges holes: the larger of what the mesh shows, and of what the level shows that tells inside and outside apart. Where samples lie many cells apart,
    /// hardly any place of a hole is far from all of them in the mesh's measure.
    pub(super) fn over_holes(&self) -> f64 {
        self.bridged.unwrap_or(0.0).max(self.spanned)
    }

    /// The part of the samples that part nothing, in words.
    pub(super) fn same_sides(&self) -> String {
        format!("{:.1} % of the samples have the same side on both sides", 100.0 * self.part_nothing)
    }

    /// What is wrong with the inside, if the mesh does not enclose one; `cell_size` is that of the grid.
    fn warnings(&self, cell_size: f64) -> Option<Warning> {
        if self.radius.is_some() {
            return None;
        }
        let sides = |bounds: &Bounds| {
            let side = |a: usize| format!("{} to {}", short(bounds.min[a]), short(bounds.max[a]));
            format!("x {}, y {}, z {}", side(0), side(1), side(2))
        };
        if self.parted {
            let Some(widest) = &self.narrow_handle else { return self.too_wide.map(narrow_slots) };
            let (handles, place) = match (self.narrow_handles, self.narrow_reopened) {
                (1, false) => ("a handle of the mesh is".to_owned(), "in"),
                (many, false) => (format!("{} handles of the mesh are", thousands(many)), "the widest in"),
                (1, true) => ("a handle was".to_owned(), "its slot was filled and opened anew: in"),
                (many, true) => (
                    format!("{} handles were", thousands(many)),
                    "their slots were filled and opened anew, the widest in",
                ),
            };
            return Some(Warning::new(
                format!(
                    "not sealed: {handles} two cells wide or less, too narrow for the samples to vouch for; {place} {}",
                    sides(widest)
                ),
                format!(
                    "--cell-size {} leaves out what samples do not tell; finer cells show it, if there are samples enough",
                    short(1.5 * cell_size)
                ),
            ));
        }
        let whole = |patches: &[PatchReport]| 100.0 * patches.iter().map(|patch| patch.share).sum::<f64>();
        let place = |patch: &PatchReport| sides(&patch.bounds);
        let mut found = vec![format!("not sealed: {}", self.same_sides())];
        let mut advice = Vec::new();
        if let Some(largest) = self.open.first() {
            found.push(format!(
                "{:.1} % lie on open surfaces, which are kept as slabs a cell thick; the largest in {}",
                whole(&self.open),
                place(largest)
            ));
            advice.push(
                "--surface terrain (seen from above) or --surface sheet --facing FROM makes a surface of them"
                    .to_owned(),
            );
        }
        if let Some(largest) = self.filled.first() {
            found.push(format!(
                "{:.1} % line slots or folds that are filled; the largest in {}",
                whole(&self.filled),
                place(largest)
            ));
            advice.push(format!("--cell-size {} shows them, if there are samples enough", short(cell_size / 2.0)));
        }
        Some(Warning { message: found.join("\n"), advice: (!advice.is_empty()).then(|| advice.join("\n")) })
    }
}
