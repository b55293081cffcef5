//! Counts: what became of the vertices.

use crate::surface::vertex_state::VertexState;

/// What became of the vertices.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Counts {
    /// Vertices that are input points, bit for bit; or near them, where facets pass amid the points.
    pub fitted: u64,
    /// Vertices moved onto sharp edges and corners near their points.
    pub creased: u64,
    /// Vertices moved onto the sphere of the points round them.
    pub projected: u64,
    /// Vertices pulled towards a point that another vertex took.
    pub pulled: u64,
    /// Vertices that stay where smoothing put them: no point within reach, or not to be fitted.
    pub unfitted: u64,
    /// Vertices where a hole is bridged: at the height interpolated there, or on a membrane.
    pub bridged: u64,
    /// Vertices contracted into others.
    pub contracted: u64,
    /// Vertices that went back towards rest because triangles there would intersect.
    pub retreated: u64,
    /// Pairs of triangles that intersect still: none, unless cells are too small for the precision of coordinates, or a chain of
    /// retreats would have to reach through a whole slab.
    pub tangled: u64,
    /// Area of the triangles that bridge a hole: all three vertices stay where smoothing put them, for want of a point within reach, or lie at an
    /// interpolated height.
    pub bridged_area: f64,
}

impl Counts {
    /// What is counted in both; of the area it is the sum, rounded.
    pub(super) fn and(self, other: Counts) -> Counts {
        self.with(other, |a, b| a + b, |a, b| a + b)
    }

    /// What is counted here but not there, where all that is counted there is counted here.
    pub(super) fn without(self, other: Counts) -> Counts {
        self.with(other, |a, b| a - b, |a, b| a - b)
    }

    fn with(self, other: Counts, of: impl Fn(u64, u64) -> u64, of_area: impl Fn(f64, f64) -> f64) -> Counts {
        Counts {
            fitted: of(self.fitted, other.fitted),
            creased: of(self.creased, other.creased),
            projected: of(self.projected, other.projected),
            pulled: of(self.pulled, other.pulled),
            unfitted: of(self.unfitted, other.unfitted),
            bridged: of(self.bridged, other.bridged),
            contracted: of(self.contracted, other.contracted),
            retreated: of(self.retreated, other.retreated),
            tangled: of(self.tangled, other.tangled),
            bridged_area: of_area(self.bridged_area, other.bridged_area),
        }
    }

    /// Counts a vertex that is written, or that was contracted.
    pub(super) fn count(&mut self, state: VertexState) {
        let count = match state {
            VertexState::Contracted => &mut self.contracted,
            VertexState::Fitted => &mut self.fitted,
            VertexState::Creased(_) => &mut self.creased,
            VertexState::Projected => &mut self.projected,
            VertexState::Bridged => &mut self.bridged,
            VertexState::Attracted => &mut self.pulled,
            VertexState::Unfitted => &mut self.unfitted,
            VertexState::Backtracked(_) | VertexState::AtRest => &mut self.retreated,
        };
        *count += 1;
    }
}
