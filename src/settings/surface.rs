//! Options of the surface: smoothing, diagonals, fitting.

/// Options of the surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct SurfaceOptions {
    /// Steps of smoothing: the first is Eq. 4, each further one smooths without shrinking.
    pub smooth: u32,
    /// Which diagonal cuts a rectangle.
    pub diagonals: Diagonals,
    /// What vertices are moved onto.
    pub fit: Fit,
    /// Slices of a slab, if they are not as many as smoothing asks for: with fewer, seams may reach each other, as tests want them to.
    #[doc(hidden)]
    #[serde(skip)]
    pub slab_slices: Option<u32>,
}

/// What vertices are moved onto.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub enum Fit {
    /// Spheres where points are noisy, else facets; where cells are given by k or by a number of slices, nearest points instead of facets.
    #[default]
    Auto,
    /// What [`Fit::Auto`] is with the paper's cells.
    #[doc(hidden)]
    #[cfg_attr(feature = "cli", value(skip))]
    AutoPoints,
    /// Places near their nearest input points, so that facets pass amid all points; on closed surfaces, beside sharp edges, places on these.
    Facets,
    /// Their nearest input points.
    Nearest,
    /// The spheres of the points round them, which may be as flat as planes: for noisy points.
    #[cfg_attr(feature = "cli", value(alias = "plane"))]
    #[serde(alias = "plane")]
    Sphere,
    /// Nothing: the smoothed surface stays.
    None,
}

impl Fit {
    /// What it comes to with points that are noisy or not.
    pub fn chosen(self, noisy: bool) -> Fit {
        match self {
            Fit::Auto | Fit::AutoPoints if noisy => Fit::Sphere,
            Fit::Auto => Fit::Facets,
            Fit::AutoPoints => Fit::Nearest,
            given => given,
        }
    }

    /// Whether edges are flipped where vertices have been moved.
    pub(crate) fn has_flips(self) -> bool {
        matches!(self, Fit::Facets | Fit::Sphere)
    }

    /// Whether each vertex has a point of its own, so that vertices on one point are contracted.
    pub fn has_points(self) -> bool {
        matches!(self, Fit::Facets | Fit::Nearest)
    }
}

/// Which of a rectangle's diagonals makes its two triangles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub enum Diagonals {
    /// The one that makes the larger smallest angle: chosen again where vertices have their points. Where facets or spheres are fitted, edges are flipped, too.
    #[default]
    Delaunay,
    /// Either, by a hash of the face's place (the paper's control).
    Random,
    /// The one from the face's lowest corner.
    First,
}
