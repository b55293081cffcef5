//! The phases of a run, and how much work each is.

/// The phases of a run, in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub enum Phase {
    /// Unpacking compressed files, reading standard input.
    Unpack,
    /// Telling which points lie on the ground.
    Ground,
    /// Making a raster of heights.
    Gather,
    /// Counting points and finding their box.
    Survey,
    /// Counting points by class and return.
    Count,
    /// Closing coarse cells, or all of them, to know how large the mesh is going to be.
    Rehearse,
    /// Finding places of the surface between sparse points.
    Upsample,
    /// Sorting points into buckets.
    Bucket,
    /// Finding the occupied cells.
    Raster,
    /// Finding the closing radius, and the solid.
    Seal,
    /// Opening again what the closing filled though points line it.
    Reopen,
    /// Extraction, smoothing, fitting, stitching.
    Surface,
    /// Measuring how far the surface is from points, and leaving out what is too far.
    Bridged,
    /// Leaving out triangles.
    Simplify,
    /// Checking the mesh; and, where there is room for both, writing the mesh file.
    Check,
    /// Looking for triangles of the mesh that intersect.
    Intersect,
    /// Measuring distances between a mesh and its reference.
    Compare,
    /// Writing the mesh file, if that is still to do, and giving it its name.
    Write,
    /// Drawing a picture of the mesh.
    Render,
    /// Making a test cloud.
    Generate,
}

impl Phase {
    /// The phase's name and the unit it counts in.
    pub(crate) fn words(self) -> (&'static str, &'static str) {
        match self {
            Phase::Unpack => ("unpack", "bytes"),
            Phase::Survey => ("survey", "points"),
            Phase::Ground => ("ground", "points"),
            Phase::Gather => ("gather", "points"),
            Phase::Count => ("count", "points"),
            Phase::Rehearse => ("rehearse", "slices"),
            Phase::Upsample => ("upsample", "points"),
            Phase::Bucket => ("bucket", "points"),
            Phase::Raster => ("raster", "points"),
            Phase::Seal => ("seal", "slices"),
            Phase::Reopen => ("reopen", "slices"),
            Phase::Surface => ("surface", "faces"),
            Phase::Bridged => ("bridged", "places"),
            Phase::Simplify => ("simplify", "triangles"),
            Phase::Check => ("check", "triangles"),
            Phase::Intersect => ("intersect", "triangles"),
            Phase::Compare => ("compare", "distances"),
            Phase::Write => ("write", "elements"),
            Phase::Render => ("render", "triangles"),
            Phase::Generate => ("generate", "points"),
        }
    }

    /// The phase's name.
    pub fn name(self) -> &'static str {
        self.words().0
    }
}

/// The work that is expected of each phase of a run, in a unit of its own: only the shares count.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Forecast(Vec<(Phase, f64)>);

impl Forecast {
    /// Phases, each with its work. Work that is no positive number counts as none.
    pub fn new(phases: impl IntoIterator<Item = (Phase, f64)>) -> Forecast {
        Forecast(phases.into_iter().map(|(phase, work)| (phase, if work > 0.0 { work } else { 0.0 })).collect())
    }

    /// The part of all work that is done, if the `finished` phases are and `part` of `current` is; `None` if nothing is expected.
    pub(crate) fn fraction(&self, finished: &[Phase], current: Option<(Phase, f64)>) -> Option<f64> {
        let all: f64 = self.0.iter().map(|(_, work)| work).sum();
        let done = |phase: Phase| match current {
            Some((under_way, part)) if under_way == phase => part.clamp(0.0, 1.0),
            _ if finished.contains(&phase) => 1.0,
            _ => 0.0,
        };
        // A phase that nobody foretold does not count.
        (all > 0.0).then(|| (self.0.iter().map(|(phase, work)| done(*phase) * work).sum::<f64>() / all).clamp(0.0, 1.0))
    }
}
