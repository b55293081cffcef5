//! What some triangles need of their vertices, read into one table.
//!
//! ```text
//!   triangles  [7 9 8] [9 7 12]  --->  [0 2 1] [2 0 3]     numbers count in the table
//!   vertices    7  8  9  12      --->   0  1  2  3         a window of neighbours is read whole; scattered ones are picked
//! ```

use crate::error::Result;
use crate::mesh::MeshSource;

/// Vertices read at once where a table is picked from scattered numbers: 1.5 MiB of positions.
pub(super) const PIECE: usize = 1 << 16;
/// Unwanted vertices that are read along rather than skipped by a new read.
const GAP: u32 = 1 << 9;

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
pub(crate) type ReadVertices<'a, T> = dyn Fn(u64, &mut [T]) -> Result<()> + Sync + 'a;

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::spool::{FaceRecord, MeshSpool};
    use crate::points::Precision;
    use crate::storage::spool::Workspace;

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
