//! Axes and boxes of the file's coordinates.

/// An axis of the file's coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// The first coordinate.
    X,
    /// The second.
    Y,
    /// The third.
    Z,
}

impl Axis {
    /// All three.
    pub const ALL: [Axis; 3] = [Axis::X, Axis::Y, Axis::Z];

    /// 0, 1 or 2.
    pub fn index(self) -> usize {
        self as usize
    }

    /// `x`, `y` or `z`.
    pub fn letter(self) -> char {
        ['x', 'y', 'z'][self.index()]
    }

    /// The file axis that is grid axis 0, 1, 2 when slicing along `self`: a cyclic permutation, so orientation stays.
    pub fn file_axes(self) -> [usize; 3] {
        let a = self.index();
        [(a + 2) % 3, a, (a + 1) % 3]
    }
}

/// The axis-parallel box of a cloud, in the file's coordinates.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Bounds {
    /// The least coordinates.
    pub min: [f64; 3],
    /// The greatest.
    pub max: [f64; 3],
}

impl Bounds {
    /// The box of nothing: any point extends it.
    pub const EMPTY: Bounds = Bounds { min: [f64::INFINITY; 3], max: [f64::NEG_INFINITY; 3] };

    /// The box of both.
    pub fn union(self, other: Bounds) -> Bounds {
        let mut out = self;
        for a in 0..3 {
            out.min[a] = out.min[a].min(other.min[a]);
            out.max[a] = out.max[a].max(other.max[a]);
        }
        out
    }

    /// The sides' lengths.
    pub fn extent(&self) -> [f64; 3] {
        std::array::from_fn(|a| self.max[a] - self.min[a])
    }

    /// The longest side's length.
    pub fn longest_side(&self) -> f64 {
        (0..3).map(|a| self.max[a] - self.min[a]).fold(0.0, f64::max)
    }

    /// The longest side; the first of equals.
    pub fn longest(&self) -> Axis {
        let e = self.extent();
        let mut best = Axis::X;
        for axis in Axis::ALL {
            if e[axis.index()] > e[best.index()] {
                best = axis;
            }
        }
        best
    }
}
