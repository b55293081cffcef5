//! The mesh that is left: its vertices in the order that they had, its triangles in that of their first vertices.

use super::passes::Passes;
use super::soup::{Record, Soup};
use crate::error::Result;
use crate::mesh::MeshSource;
use crate::mesh::spool::{FaceRecord, MeshSpool};
use crate::points::Coordinate;
use crate::storage::partitions::Partitions;

/// Vertices read at a time.
const BLOCK: usize = 1 << 13;
/// Triangles that are sorted at a time, about.
const SORTED: u64 = 1 << 16;

/// Which vertices are left, and how many are left before each. A bit and half a bit a vertex.
struct Left {
    words: Vec<u64>,
    /// Those left before every word.
    before: Vec<u32>,
}

impl Left {
    fn of(vertices: u64) -> Left {
        let words = vertices.div_ceil(64) as usize;
        Left { words: vec![0; words], before: vec![0; words] }
    }

    fn mark(&mut self, vertex: u32) {
        self.words[vertex as usize / 64] |= 1 << (vertex % 64);
    }

    fn count(&mut self) -> u64 {
        let mut count = 0;
        for (before, word) in self.before.iter_mut().zip(&self.words) {
            *before = count as u32;
            count += u64::from(word.count_ones());
        }
        count
    }

    fn has(&self, vertex: u64) -> bool {
        self.words[(vertex / 64) as usize] >> (vertex % 64) & 1 == 1
    }

    fn number(&self, vertex: u32) -> u32 {
        let (word, bit) = (vertex as usize / 64, vertex % 64);
        self.before[word] + (self.words[word] & ((1 << bit) - 1)).count_ones()
    }
}

/// Bytes that the numbering takes.
pub(super) fn bytes(vertices: u64) -> u64 {
    vertices.div_ceil(64) * 12 + (2 * SORTED) * 24 + (1 << 20)
}

/// Numbers what is left of `mesh` anew.
pub(super) fn numbered<T: Coordinate>(mesh: &dyn MeshSource, soup: &Soup<T>, passes: &Passes) -> Result<MeshSpool> {
    let mut left = Left::of(mesh.vertex_count());
    each(soup, |record| {
        let vertices = record.vertices;
        vertices.into_iter().for_each(|v| left.mark(v));
        Ok(())
    })?;
    let vertices = left.count();

    let quota = passes.room.quota;
    let whole = MeshSpool::with_attributes(passes.workspace, T::PRECISION, mesh.schema().clone(), quota);
    let mut whole = whole.placed(mesh.origin());
    let attributes = mesh.schema().attributes();
    let (mut places, mut kept, mut records) = (Vec::new(), Vec::new(), Vec::new());
    let mut values = vec![Vec::new(); attributes.len()];
    for first in (0..mesh.vertex_count()).step_by(BLOCK) {
        let len = (mesh.vertex_count() - first).min(BLOCK as u64);
        if (first..first + len).all(|v| !left.has(v)) {
            continue;
        }
        places.resize(len as usize, [0.0; 3]);
        mesh.read_vertices(first, &mut places)?;
        for (number, values) in values.iter_mut().enumerate() {
            values.resize(len as usize, 0.0);
            mesh.read_attribute(number, first, values)?;
        }
        kept.clear();
        records.clear();
        for at in (0..len as usize).filter(|at| left.has(first + *at as u64)) {
            kept.push(places[at]);
            attributes
                .iter()
                .zip(&values)
                .for_each(|(attribute, values)| attribute.scalar.put(values[at], &mut records));
        }
        whole.append_vertices(&kept)?;
        whole.append_attributes(&records)?;
    }

    // By ranges of first vertices; there are twice as many triangles as vertices.
    let ranges = soup.count().div_ceil(SORTED).max(1);
    let range = vertices.div_ceil(ranges).max(1);
    let mut partitions = Partitions::<[u32; 3]>::new(ranges as usize, 1 << 18, quota, passes.workspace);
    each(soup, |record| {
        let vertices = record.vertices;
        let [a, b, c] = vertices.map(|v| left.number(v));
        let least = a.min(b).min(c);
        let turned = if least == a {
            [a, b, c]
        } else if least == b {
            [b, c, a]
        } else {
            [c, a, b]
        };
        partitions.push((u64::from(least) / range) as usize, &turned)
    })?;
    let mut triangles: Vec<[u32; 3]> = Vec::new();
    for part in 0..partitions.count() {
        triangles.clear();
        partitions.read(part, |triangle| {
            triangles.push(*triangle);
            Ok(())
        })?;
        triangles.sort_unstable();
        for block in triangles.chunks(BLOCK) {
            let records: Vec<FaceRecord> = block.iter().map(|triangle| FaceRecord::new(*triangle)).collect();
            whole.append_faces(&records)?;
        }
    }
    Ok(whole)
}

fn each<T: Coordinate>(soup: &Soup<T>, mut visit: impl FnMut(&Record<T>) -> Result<()>) -> Result<()> {
    soup.each_block(|records| records.iter().try_for_each(&mut visit))
}
