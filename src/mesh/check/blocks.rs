//! Face blocks and vertex ranges: which triangles must be read to see all that touch some vertices.

use std::ops::Range;

use crate::error::Result;
use crate::mesh::MeshSource;
use crate::mesh::corners::{fresh, span};
use crate::mesh::measure::is_degenerate;

/// The triangles of a mesh in blocks of equal length, each with its smallest and largest vertex number: 8 bytes a block.
pub(super) struct Blocks {
    len: usize,
    spans: Vec<(u32, u32)>,
}

impl Blocks {
    /// No blocks yet; all but the last will hold `len` triangles.
    pub fn new(len: usize) -> Blocks {
        Blocks { len, spans: Vec::new() }
    }

    /// The spans of the blocks of `faces`, which begin with one of the mesh's blocks.
    pub fn spans(&self, faces: &[[u32; 3]]) -> Vec<(u32, u32)> {
        faces.chunks(self.len).filter_map(span).collect()
    }

    /// The spans of all blocks.
    pub fn all(&self) -> &[(u32, u32)] {
        &self.spans
    }

    /// Puts blocks where they belong, from the `first` on.
    pub fn put(&mut self, first: usize, spans: &[(u32, u32)]) {
        let end = first + spans.len();
        self.spans.resize(end.max(self.spans.len()), (0, 0));
        self.spans[first..end].copy_from_slice(spans);
    }

    /// How many blocks must be read in total if each range of `range` vertices reads all that touch it.
    pub fn reads(&self, range: u32) -> u64 {
        self.spans.iter().map(|(low, high)| u64::from(high / range - low / range) + 1).sum()
    }

    /// The number of blocks.
    pub fn count(&self) -> u64 {
        self.spans.len() as u64
    }

    /// Visits every triangle that may touch `vertices`, in order, with its number; degenerate ones are left out.
    ///
    /// # Errors
    /// The same as [`MeshSource::read_faces`].
    pub fn scan(
        &self,
        mesh: &dyn MeshSource,
        vertices: &Range<u32>,
        buffer: &mut Vec<[u32; 3]>,
        mut visit: impl FnMut(u64, [u32; 3]),
    ) -> Result<()> {
        for (block, &(low, high)) in self.spans.iter().enumerate() {
            if low >= vertices.end || high < vertices.start {
                continue;
            }
            let first = block as u64 * self.len as u64;
            fresh(buffer, (mesh.face_count() - first).min(self.len as u64) as usize);
            mesh.read_faces(first, buffer)?;
            for (number, &face) in (first..).zip(buffer.iter()) {
                if !is_degenerate(face) {
                    visit(number, face);
                }
            }
        }
        Ok(())
    }
}

/// Records of triangles, grouped by a vertex of a range: a counting sort in two scans.
#[derive(Default)]
pub(super) struct Stars<T> {
    /// While counting, entry i is the number of records of vertex i; after the second scan, the end of its records.
    ends: Vec<usize>,
    records: Vec<T>,
    faces: Vec<[u32; 3]>,
}

impl<T> Stars<T> {
    /// Bytes for a range of so many vertices with so many records, read in blocks of so many triangles.
    pub fn bytes(vertices: u64, records: u64, block: u64) -> u64 {
        vertices * size_of::<usize>() as u64 + records * size_of::<T>() as u64 + block * size_of::<[u32; 3]>() as u64
    }
}

impl<T: Copy + Default> Stars<T> {
    /// Calls `visit` with each vertex of the range that has records, in order, and its records, in triangle order.
    ///
    /// `records` gives a triangle's three records, each with the vertex it belongs to. At most `most` are held at a time
    /// (or those of one vertex, if they are more); where the range has more it is scanned in several parts.
    ///
    /// # Errors
    /// The same as [`MeshSource::read_faces`].
    pub fn visit(
        &mut self,
        mesh: &dyn MeshSource,
        blocks: &Blocks,
        range: Range<u32>,
        most: usize,
        records: impl Fn(u64, [u32; 3]) -> [(u32, T); 3],
        mut visit: impl FnMut(u32, &mut [T]),
    ) -> Result<()> {
        let mut start = range.start;
        while start < range.end {
            let counts = &mut self.ends;
            fresh(counts, (range.end - start) as usize);
            blocks.scan(mesh, &(start..range.end), &mut self.faces, |number, face| {
                for (v, _) in records(number, face) {
                    if let Some(count) = counts.get_mut(v.wrapping_sub(start) as usize) {
                        *count += 1;
                    }
                }
            })?;

            // Counts become starts, as far as the records fit.
            let mut total = 0;
            let mut fitting = 0;
            for count in counts.iter_mut() {
                if total + *count > most && fitting > 0 {
                    break;
                }
                let start = total;
                total += *count;
                *count = start;
                fitting += 1;
            }
            counts.truncate(fitting);
            let end = start + fitting as u32;

            fresh(&mut self.records, total);
            blocks.scan(mesh, &(start..end), &mut self.faces, |number, face| {
                for (v, record) in records(number, face) {
                    if let Some(at) = counts.get_mut(v.wrapping_sub(start) as usize) {
                        self.records[*at] = record;
                        *at += 1;
                    }
                }
            })?;

            let mut from = 0;
            for (v, &to) in (start..end).zip(&self.ends) {
                if from < to {
                    visit(v, &mut self.records[from..to]);
                }
                from = to;
            }
            start = end;
        }
        Ok(())
    }
}
