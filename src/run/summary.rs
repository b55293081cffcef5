//! The summary of a report, for people.

use std::fmt;

use bytesize::ByteSize;

use crate::error::words::{duration, short, thousands};
use crate::format::write::Format;
use crate::grid::partition::REACH;
use crate::run::bridging::Trimmed;
use crate::run::progress::Warning;
use crate::run::report::{Closing, FitReport, GridReport, OutputReport, Report};
use crate::settings::open::Kind;
use crate::settings::surface::Fit;
use crate::simplify::Figures;
use crate::solid::component::Components;
use crate::solid::parted::Sighted;
use crate::stitch::counts::Counts;

impl Report {
    /// The summary for people: the output, the mesh, what may be wrong; and in `detail`, all that came before.
    pub fn summary(&self, detail: bool) -> String {
        let mut lines = self.output_lines();
        lines.extend(self.mesh_lines());
        lines.extend(self.warnings.iter().map(Warning::to_string));
        if detail {
            lines.extend(self.detail_lines());
        }
        lines.join("\n")
    }

    /// What came before and what came of it, without what may be wrong.
    pub(super) fn told(&self) -> String {
        [self.output_lines(), self.mesh_lines(), self.detail_lines()].concat().join("\n")
    }

    fn output_lines(&self) -> Vec<String> {
        let OutputReport { path, bytes, tiles, origin, preview, .. } = &self.output;
        let index = if self.output.tileset.is_some() { "" } else { " and an index" };
        let files = tiles.map_or_else(String::new, |tiles| format!(", {} tiles{index}", thousands(tiles)));
        let (size, time) = (ByteSize(*bytes), duration(self.seconds_total));
        let mut lines = vec![match path {
            Some(path) => format!("output   {}{files}, {size}, in {time}", path.display()),
            None => format!("output   in memory, in {time}"),
        }];
        // On Earth, the place is told instead.
        let on_earth = self.output.tileset.as_ref().is_some_and(|tileset| tileset.site.is_some());
        if *origin != [0.0; 3] && !on_earth {
            let [x, y, z] = origin;
            let how = match path.as_deref().map(Format::from_path) {
                _ if self.output.tileset.is_some() => "the tileset's transform adds it",
                Some(Ok(Format::Stl | Format::Glb)) => {
                    "32 bits would not hold them; .ply and .obj with --coordinates input do"
                }
                _ => "--coordinates input leaves them as they are",
            };
            lines.push(format!("         origin {x} {y} {z} taken off the coordinates: {how}"));
        }
        lines.extend(self.output.tileset.iter().flat_map(|tileset| tileset.lines()));
        lines.extend(preview.iter().map(|preview| format!("preview  {}", preview.display())));
        lines
    }

    fn mesh_lines(&self) -> Vec<String> {
        let OutputReport { vertices, triangles, .. } = self.output;
        let size = format!("mesh     {} vertices, {} triangles", thousands(vertices), thousands(triangles));
        let Some(check) = &self.check else { return vec![format!("{size}; not checked")] };
        let genus = check.genus.map_or_else(String::new, |genus| format!(", genus {genus}"));
        let parts = if check.components == 1 { "component" } else { "components" };
        let loops = if check.boundary_loops == 1 { "loop" } else { "loops" };
        let boundary = thousands(check.boundary_loops);
        let closed =
            if check.closed { "closed".to_owned() } else { format!("open on purpose, {boundary} boundary {loops}") };
        let volume = check.volume.map_or_else(String::new, |volume| format!(", volume {}", short(volume)));
        let mut lines = vec![
            format!("{size}; {closed}, oriented, manifold; {} {parts}{genus}", thousands(check.components)),
            format!("         area {}{volume}", short(check.area)),
        ];
        if let FitReport { onto: Fit::Sphere, shell: Some(shell) } = self.fit {
            lines.push(format!(
                "         noisy points, {:.2} cells thick: the mesh lies amid them; --fit nearest puts it on points",
                shell.thickness
            ));
        }
        lines
    }

    fn detail_lines(&self) -> Vec<String> {
        let mut points = format!("points   {}", thousands(self.points.count));
        for (count, why) in [
            (self.points.dropped, "dropped: not finite"),
            (
                self.points.filtered,
                if self.ground.is_some() { "no ground, or left out by filters" } else { "left out by filters" },
            ),
        ] {
            if count > 0 {
                points += &format!(" ({} {why})", thousands(count));
            }
        }
        if self.points.added > 0 {
            points += &format!("; {} places of the surface added between them", thousands(self.points.added));
        }
        let mut lines = vec![points, format!("grid     {}", self.grid)];
        match (&self.parameters.open, self.closing.columns) {
            (Some(open), Some(columns)) => {
                let kind = match open.kind {
                    Kind::Sheet => "sheet",
                    Kind::Terrain => "terrain",
                    Kind::Ground => "ground",
                };
                let (data, bridged) = (thousands(columns.data), thousands(columns.bridged));
                let facing = open.facing;
                lines.push(format!(
                    "surface  {kind}, seen from {facing}: {data} columns with points, {bridged} bridged"
                ));
            }
            _ => lines.push(format!("closing  {}", self.closing.verdict())),
        }
        lines.extend(self.closing.sighted.map(|sighted| sighted.to_string()));
        lines.extend(self.closing.left_out().map(|left_out| format!("left out {left_out}")));
        let Counts { retreated, bridged_area, .. } = self.vertices;
        if let Some(share) = self.closing.bridged.filter(|share| *share > 0.0) {
            lines.push(format!(
                "bridged  area {} ({:.2} % of the surface): farther than {REACH} cells from any point",
                short(bridged_area),
                100.0 * share
            ));
        }
        if let Some(Trimmed { distance, triangles }) = self.trimmed {
            let (triangles, distance) = (thousands(triangles), short(distance));
            lines.push(format!("trimmed  {triangles} triangles farther than {distance} from any point"));
        }
        if retreated > 0 {
            lines.push(format!(
                "kept off {} vertices kept off their points, so that no triangles intersect",
                thousands(retreated)
            ));
        }
        if let Some(Figures { before, reached, .. }) = self.simplification {
            let (before, reached) = (thousands(before), short(reached));
            lines.push(format!(
                "fewer    of {before} triangles; no place of either surface is farther than {reached} from the other"
            ));
        }
        let stages = self
            .seconds
            .iter()
            .map(|(phase, time)| format!("{} {:.0} %", phase.name(), 100.0 * time / self.seconds_total.max(1e-9)));
        lines.push(format!("time     {}: {}", duration(self.seconds_total), stages.collect::<Vec<_>>().join(", ")));
        let used = self.memory.peak_resident.map_or_else(|| "?".into(), |bytes| ByteSize(bytes).to_string());
        let (budget, disk) = (ByteSize(self.memory.plan.budget), ByteSize(self.memory.peak_disk));
        lines.push(format!("memory   {used} at most, of {budget} granted; {disk} of temporary disk"));
        lines
    }
}

impl fmt::Display for Report {
    /// The summary without details.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.summary(false))
    }
}

impl Closing {
    /// A line about what was left out, if anything was to be.
    pub fn left_out(&self) -> Option<String> {
        let sparse = |cells: u64| format!("{} cells of too few points", thousands(cells));
        let dropped = |Components { found, dropped, dropped_cells, .. }: Components| {
            let (dropped, found, cells) = (thousands(dropped), thousands(found), thousands(dropped_cells));
            format!("{dropped} of {found} components, {cells} cells in all")
        };
        let parts: Vec<String> =
            (self.sparse_cells > 0)
                .then(|| sparse(self.sparse_cells))
                .into_iter()
                .chain((self.outlier_cells > 0).then(|| {
                    format!("{} cells of outliers (--keep-outliers keeps them)", thousands(self.outlier_cells))
                }))
                .chain(self.components.filter(|components| components.dropped > 0).map(dropped))
                .collect();
        (!parts.is_empty()).then(|| parts.join("; "))
    }

    /// A line about the inside.
    pub fn verdict(&self) -> String {
        match self.radius {
            Some(radius) => format!("radius {radius} {}, as asked", if radius == 1 { "cell" } else { "cells" }),
            None if self.ends && self.parted => "open where triangles far from points were left out".to_owned(),
            None if self.sealed => "sealed: the mesh encloses the inside".to_owned(),
            None if self.parted && self.narrow_reopened => {
                format!("closed, where slots were opened anew for narrow handles: {}", thousands(self.narrow_handles))
            }
            None if self.parted && self.narrow_handles > 0 => {
                format!("closed, with handles that may not be the object's: {}", thousands(self.narrow_handles))
            }
            None if self.parted && self.too_wide.is_some() => {
                "closed, with slots, voids or walls that may be too narrow to be seen".to_owned()
            }
            None if self.parted => {
                format!("closed over holes: {:.1} % of the surface bridges them", 100.0 * self.over_holes())
            }
            None => format!("not sealed: {}", self.same_sides()),
        }
    }
}

impl fmt::Display for Sighted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (places, share) = (thousands(self.places as u64), 100.0 * self.emptied);
        let noun = if self.places == 1 { "place" } else { "places" };
        write!(
            f,
            "seen     from {places} {noun}: lines of sight pass through {share:.0} % of the box (--seen-from none leaves them out)"
        )
    }
}

impl fmt::Display for GridReport {
    /// "132 x 134 x 104 cells of 0.00117, 134 slices along y".
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let GridReport { axis, slices, raster: [a, b, c], cell_size, unfolded } = self;
        write!(f, "{a} x {b} x {c} cells of {}, {slices} slices along {axis}", short(*cell_size))?;
        match unfolded {
            Some([a, b, c]) => write!(f, "; the gaps up to far points are left out, of {a} x {b} x {c} with them"),
            None => Ok(()),
        }
    }
}
