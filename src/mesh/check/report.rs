//! What the check found, in numbers and in words.

use std::fmt;

use crate::mesh::intersections::Intersections;

/// What a strict check of a mesh found.
///
/// Topology is that of vertex numbers alone: equal positions do not make vertices one. Triangles that repeat a vertex number
/// (*degenerate*) are counted and otherwise left out.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub struct CheckReport {
    /// Vertices of the mesh.
    pub vertices: u64,
    /// Triangles of the mesh.
    pub triangles: u64,
    /// Distinct pairs of vertices joined by a side of a triangle.
    pub edges: u64,
    /// Edges of one triangle.
    pub boundary_edges: u64,
    /// Closed lines of such edges: sets that hang together at vertices.
    pub boundary_loops: u64,
    /// Edges of more than two triangles.
    pub nonmanifold_edges: u64,
    /// Edges whose two triangles run them the same way.
    pub inconsistent_edges: u64,
    /// Vertices whose triangles do not all hang together by edges at the vertex.
    pub nonmanifold_vertices: u64,
    /// Vertices of no triangle.
    pub unreferenced_vertices: u64,
    /// Triangles that repeat a vertex number.
    pub degenerate_triangles: u64,
    /// Triangles with the three vertices of another, beyond the first of each kind.
    pub duplicate_triangles: u64,
    /// Vertices with a coordinate that is NaN or infinite.
    pub nonfinite_vertices: u64,
    /// Referenced vertices − edges + triangles.
    pub euler: i64,
    /// Sets of triangles that hang together by edges.
    pub components: u64,
    /// Sum of the components' genera, if the mesh is a closed, oriented manifold.
    pub genus: Option<u64>,
    /// Surface area.
    pub area: f64,
    /// Signed volume, positive if the triangles run counter-clockwise seen from outside; `None` if the mesh is not closed.
    pub volume: Option<f64>,
    /// Smallest and largest coordinates of referenced, finite vertices; `None` if there are none.
    pub bounds: Option<[[f64; 3]; 2]>,
    /// Every edge belongs to exactly two triangles (and there is one).
    pub closed: bool,
    /// Every edge of two or more triangles is run equally often both ways.
    pub oriented: bool,
    /// No edge has more than two triangles, no vertex more than one fan; a manifold may have a boundary.
    pub manifold: bool,
    /// The triangles that intersect, if they were looked for.
    pub intersections: Option<Intersections>,
}

impl CheckReport {
    /// Whether this is a consistently oriented 2-manifold of sound triangles and finite vertices, which may have a boundary; and there is a triangle.
    pub fn is_oriented_manifold(&self) -> bool {
        let sound = self.degenerate_triangles == 0 && self.duplicate_triangles == 0 && self.nonfinite_vertices == 0;
        self.edges > 0 && self.oriented && self.manifold && sound
    }

    /// Whether it is one without a boundary.
    pub fn is_closed_oriented_manifold(&self) -> bool {
        self.closed && self.is_oriented_manifold()
    }

    /// Whether, as far as it was looked for, nothing is wrong with the mesh: it is an oriented manifold, closed unless it may be `open`, and, if
    /// intersections were looked for, known to be free of them.
    pub fn is_sound(&self, open: bool) -> bool {
        let manifold = self.is_oriented_manifold() && (open || self.closed);
        manifold && self.intersections.as_ref().is_none_or(Intersections::none)
    }
}

impl fmt::Display for CheckReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rows = [
            ("vertices", self.vertices, "unreferenced", self.unreferenced_vertices),
            ("", 0, "not finite", self.nonfinite_vertices),
            ("", 0, "non-manifold", self.nonmanifold_vertices),
            ("edges", self.edges, "boundary", self.boundary_edges),
            ("", 0, "non-manifold", self.nonmanifold_edges),
            ("", 0, "inconsistently oriented", self.inconsistent_edges),
            ("triangles", self.triangles, "degenerate", self.degenerate_triangles),
            ("", 0, "duplicate", self.duplicate_triangles),
        ];
        for (whole, count, part, of_it) in rows {
            if whole.is_empty() {
                writeln!(f, "{:>27}  {part:<24}{of_it}", "")?;
            } else {
                writeln!(f, "{whole:<12}{count:>13}  {part:<24}{of_it}", whole = whole, count = count)?;
            }
        }
        write!(f, "components {}, Euler number {}", self.components, self.euler)?;
        if let Some(genus) = self.genus {
            write!(f, ", genus {genus}")?;
        }
        write!(f, "\narea {}", self.area)?;
        match self.volume {
            Some(volume) => writeln!(f, ", volume {volume}")?,
            None => writeln!(f)?,
        }
        if let Some([low, high]) = self.bounds {
            let [a, b, c] = low;
            let [x, y, z] = high;
            writeln!(f, "box {a} {b} {c} to {x} {y} {z}")?;
        }
        if let Some(Intersections { pairs, triangles, complete, first: Some(first) }) = &self.intersections {
            let ([a, b], [x, y, z]) = (first.triangles, first.at);
            let least = if *complete { "" } else { "at least " };
            writeln!(
                f,
                "intersecting {least}{triangles} triangles in {least}{pairs} pairs, such as {a} and {b} near {x} {y} {z}"
            )?;
        }
        let verdict = |holds, yes, no| if holds { yes } else { no };
        let closed = match (self.closed, self.boundary_loops) {
            (true, _) => "closed".to_owned(),
            (false, 0) => "not closed".to_owned(),
            (false, 1) => "not closed (1 boundary loop)".to_owned(),
            (false, loops) => format!("not closed ({loops} boundary loops)"),
        };
        let oriented = verdict(self.oriented, "consistently oriented", "not consistently oriented");
        let manifold = verdict(self.manifold, "manifold", "not manifold");
        write!(f, "{closed}, {oriented}, {manifold}")?;
        match &self.intersections {
            None => Ok(()),
            Some(found) if found.pairs > 0 => write!(f, ", intersects itself"),
            Some(found) if found.complete => write!(f, ", free of self-intersections"),
            Some(_) => write!(f, ", self-intersections neither found nor ruled out"),
        }
    }
}
