//! Area and signed volume, summed so that neither threads nor memory nor large coordinates show.
//!
//! Triangles are summed in groups of [`GROUP`], each relative to a corner of its own, and the groups in their order. A
//! group's volume relative to o becomes one relative to O by (o − O)·S/3, where S is the group's vector area; so no term is
//! larger than the mesh, wherever on Earth it lies.

use glam::DVec3;

use super::MeshSource;
use crate::error::Result;

/// Triangles that are summed together. Fixed, since it decides how the sums round.
pub const GROUP: usize = 1 << 16;
/// Vertices read at once where a table is picked from scattered numbers: 1.5 MiB of positions.
const PIECE: usize = 1 << 16;
/// The bytes of that.
pub(crate) const PIECE_BYTES: u64 = PIECE as u64 * size_of::<[f64; 3]>() as u64;
/// Unwanted vertices that are read along rather than skipped by a new read.
const GAP: u32 = 1 << 12;

/// What some triangles need of their vertices, positions mostly: a table, and the triangles renumbered to it.
#[derive(Debug, Default)]
pub struct Corners<T = [f64; 3]> {
    /// Positions, in ascending order of their vertices.
    pub table: Vec<T>,
    keys: Vec<u64>,
    numbers: Vec<u32>,
    piece: Vec<T>,
}

/// Smallest and largest vertex number of some triangles; `None` if there are none.
pub fn span(faces: &[[u32; 3]]) -> Option<(u32, u32)> {
    if faces.is_empty() {
        return None;
    }
    Some(faces.as_flattened().iter().fold((u32::MAX, 0), |(low, high), &v| (low.min(v), high.max(v))))
}

impl Corners {
    /// Fills the table with the positions of the triangles' corners and makes `faces` index it.
    ///
    /// If the numbers span no more than `window` vertices, all of these are read, otherwise only those that are
    /// used, in pieces. Memory: 36 bytes per vertex of the window, or up to 110 bytes per triangle and 3 MB.
    ///
    /// # Errors
    /// The same as [`MeshSource::read_vertices`].
    pub fn fill(&mut self, mesh: &dyn MeshSource, faces: &mut [[u32; 3]], window: usize) -> Result<()> {
        self.fill_from(&|first, out| mesh.read_vertices(first, out), faces, window)
    }
}

/// Fills its second argument with what vertices have, from the one with the first on.
type ReadVertices<'a, T> = dyn Fn(u64, &mut [T]) -> Result<()> + 'a;

impl<T: Copy + Default> Corners<T> {
    /// The same as [`Corners::fill`], of whatever `read` tells of vertices.
    ///
    /// # Errors
    /// Errors of `read`.
    pub fn fill_from(&mut self, read: &ReadVertices<T>, faces: &mut [[u32; 3]], window: usize) -> Result<()> {
        let Some((low, high)) = span(faces) else {
            self.table.clear();
            return Ok(());
        };
        let width = (high - low) as usize + 1;
        if width <= window {
            fresh(&mut self.table, width);
            read(u64::from(low), &mut self.table)?;
            faces.as_flattened_mut().iter_mut().for_each(|v| *v -= low);
            return Ok(());
        }
        self.renumber(faces);
        self.pick(read)
    }

    /// Replaces each vertex number by its rank among the distinct ones, which are left in `numbers`.
    fn renumber(&mut self, faces: &mut [[u32; 3]]) {
        let corners = faces.as_flattened_mut();
        assert!(u32::try_from(corners.len()).is_ok(), "too many triangles at once");
        self.keys.clear();
        self.keys.extend(corners.iter().enumerate().map(|(i, &v)| u64::from(v) << 32 | i as u64));
        self.keys.sort_unstable();
        self.numbers.clear();
        for &key in &self.keys {
            let v = (key >> 32) as u32;
            if self.numbers.last() != Some(&v) {
                self.numbers.push(v);
            }
            corners[(key & 0xffff_ffff) as usize] = self.numbers.len() as u32 - 1;
        }
    }

    /// Reads what is wanted of `numbers`, in ascending order and as few pieces as reasonable.
    fn pick(&mut self, read: &ReadVertices<T>) -> Result<()> {
        self.table.clear();
        let mut rest = &self.numbers[..];
        while let Some(&first) = rest.first() {
            let near = |pair: &[u32]| pair[1] - pair[0] <= GAP && ((pair[1] - first) as usize) < PIECE;
            let run = 1 + rest.windows(2).take_while(|pair| near(pair)).count();
            fresh(&mut self.piece, (rest[run - 1] - first) as usize + 1);
            read(u64::from(first), &mut self.piece)?;
            self.table.extend(rest[..run].iter().map(|v| self.piece[(v - first) as usize]));
            rest = &rest[run..];
        }
        Ok(())
    }
}

/// Makes `list` hold `len` default values, with no more room than that if it must grow: what grows by itself takes up to twice as much.
pub(crate) fn fresh<T: Copy + Default>(list: &mut Vec<T>, len: usize) {
    list.clear();
    list.reserve_exact(len);
    list.resize(len, T::default());
}

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
    use crate::mesh::spool::{FaceRecord, MeshSpool};
    use crate::points::Precision;
    use crate::storage::spool::Workspace;

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

    #[test]
    fn scattered_corners_are_picked_alike() {
        let dir = tempfile::tempdir().unwrap();
        let mut mesh = MeshSpool::new(&Workspace::new(dir.path()).unwrap(), Precision::Double, 0);
        let vertices: Vec<[f64; 3]> = (0..100_000).map(|i| [f64::from(i), 0.5, -f64::from(i)]).collect();
        mesh.append_vertices(&vertices).unwrap();
        mesh.append_faces(&[FaceRecord::new([0, 0, 0])]).unwrap();
        let faces: Vec<[u32; 3]> = (0..5000u32).map(|i| [i * 19 % 77, 99_999 - i, i * i % 100_000]).collect();
        let mut corners = Corners::default();
        for window in [0, 1000, 100_000] {
            let mut local = faces.clone();
            corners.fill(&mesh, &mut local, window).unwrap();
            for (face, local) in faces.iter().zip(&local) {
                assert_eq!(face.map(|v| vertices[v as usize]), local.map(|v| corners.table[v as usize]));
            }
        }
    }
}
