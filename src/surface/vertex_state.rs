//! Fate: what becomes of a vertex between smoothing and the finished mesh.

/// What becomes of a vertex.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fate {
    /// It stays where smoothing put it.
    Stays,
    /// It takes its point's place.
    Fitted,
    /// It moves into the plane of the points round it.
    Projected,
    /// It lies where a hole is bridged, at the height that is interpolated there.
    Bridged,
    /// Another vertex took the point's place; it goes most of the way.
    Pulled,
    /// It was contracted into another.
    Gone,
    /// It has gone back from its point so many steps of the way to rest ([`SHARES`]).
    Back(u8),
    /// It went all the way back to rest, where no triangles intersect.
    Rest,
}

/// The share of the way from rest to its point that a vertex keeps after a step of retreat; after the last it is at rest. With quarters instead of
/// tenths, the mean squared error of a horse's mesh is 0.064 instead of 0.052, for two per cent less time.
pub const SHARES: [f64; 9] = [0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1];

impl Fate {
    /// What becomes of a vertex whose triangles intersect others.
    pub fn after_retreat(self) -> Fate {
        match self {
            Fate::Fitted | Fate::Projected | Fate::Bridged | Fate::Pulled => Fate::Back(0),
            Fate::Back(step) if usize::from(step) + 1 < SHARES.len() => Fate::Back(step + 1),
            Fate::Back(_) | Fate::Stays | Fate::Rest => Fate::Rest,
            Fate::Gone => Fate::Gone,
        }
    }

    /// Whether the vertex may be contracted with others on its point.
    pub fn is_on_point(self) -> bool {
        matches!(self, Fate::Fitted | Fate::Pulled)
    }
}
