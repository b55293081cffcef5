//! Area and signed volume, summed so that neither threads nor memory nor large coordinates show.
//!
//! Triangles are summed in groups of [`GROUP`], each relative to a corner of its own, and the groups in their order. A
//! group's volume relative to o becomes one relative to O by (o − O)·S/3, where S is the group's vector area; so no term is
//! larger than the mesh, wherever on Earth it lies.

use glam::DVec3;

/// Triangles that are summed together. Fixed, since it decides how the sums round.
pub const GROUP: usize = 1 << 16;

/// Whether a triangle repeats a vertex number.
pub fn is_degenerate([a, b, c]: [u32; 3]) -> bool {
    a == b || b == c || c == a
}

/// Area, vector area and volume of some triangles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sums {
    /// Sum of the triangles' areas.
    pub area: f64,
    /// Sum of the triangles' areas times their unit normals; zero if they are closed.
    vector_area: DVec3,
    /// What the volume is relative to.
    origin: DVec3,
    volume: f64,
}

impl Sums {
    /// No triangles.
    pub const NONE: Sums = Sums { area: 0.0, vector_area: DVec3::ZERO, origin: DVec3::ZERO, volume: 0.0 };

    /// Sums triangles that index `table`. Degenerate ones and those with a corner that is not finite count nothing.
    pub fn of(faces: &[[u32; 3]], table: &[[f64; 3]]) -> Sums {
        let position = |v: u32| DVec3::from_array(table[v as usize]);
        let mut sums = Sums::NONE;
        let corners = faces.iter().map(|f| position(f[0]));
        sums.origin = corners.into_iter().find(|p| p.is_finite()).unwrap_or(DVec3::ZERO);
        for &face in faces {
            let [a, b, c] = face.map(|v| position(v) - sums.origin);
            let twice = (b - a).cross(c - a);
            // One test for all nine numbers: anything times a difference that is not finite is not finite.
            if !twice.is_finite() || is_degenerate(face) {
                continue;
            }
            sums.area += twice.length();
            sums.vector_area += twice;
            sums.volume += a.dot(twice);
        }
        sums.area /= 2.0;
        sums.vector_area /= 2.0;
        sums.volume /= 6.0;
        sums
    }

    /// All its numbers, and from them.
    pub(crate) fn numbers(self) -> [f64; 8] {
        let ([a, b, c], [x, y, z]) = (self.vector_area.to_array(), self.origin.to_array());
        [self.area, a, b, c, x, y, z, self.volume]
    }

    /// [`Sums::numbers`], taken back.
    pub(crate) fn of_numbers([area, a, b, c, x, y, z, volume]: [f64; 8]) -> Sums {
        Sums { area, vector_area: DVec3::new(a, b, c), origin: DVec3::new(x, y, z), volume }
    }

    /// The volume relative to `origin`: of a closed mesh the same for every origin.
    pub fn volume_about(&self, origin: DVec3) -> f64 {
        self.volume + (self.origin - origin).dot(self.vector_area) / 3.0
    }

    /// Both together; the order of additions matters for the last bits.
    pub fn plus(self, other: Sums) -> Sums {
        // The empty sum has no place of its own.
        let origin = if self == Sums::NONE { other.origin } else { self.origin };
        Sums {
            area: self.area + other.area,
            vector_area: self.vector_area + other.vector_area,
            origin,
            volume: self.volume_about(origin) + other.volume_about(origin),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The corner of a cube of side 3: volume 4.5.
    const FACES: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];

    fn positions(at: f64) -> [[f64; 3]; 4] {
        [[0.0; 3], [3.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 3.0]].map(|p| p.map(|c| c + at))
    }

    #[test]
    fn a_tetrahedron_measures_the_same_everywhere() {
        for at in [0.0, -5.0, 4_500_000.0] {
            let whole = Sums::of(&FACES, &positions(at));
            assert_eq!(whole.volume_about(DVec3::splat(at)), 4.5);
            assert_eq!(whole.area, 13.5 + 4.5 * 3f64.sqrt());
            let halves = Sums::of(&FACES[..2], &positions(at)).plus(Sums::of(&FACES[2..], &positions(at)));
            assert!((halves.volume_about(DVec3::splat(at + 1.0)) - 4.5).abs() < 1e-12);
        }
    }

    #[test]
    fn what_is_not_finite_counts_nothing() {
        let mut table = positions(0.0);
        table[0][1] = f64::NAN;
        assert!((Sums::of(&FACES, &table).area - 4.5 * 3f64.sqrt()).abs() < 1e-12);
    }
}
