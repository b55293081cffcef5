//! The mesh that is left: its vertices in the order that they had, its triangles in that of their first vertices.

use super::blend::{self, Blended};
use super::mark::{Blend, Colours, Mark};
use super::passes::Passes;
use super::soup::{Record, Soup};
use crate::error::Result;
use crate::mesh::MeshSource;
use crate::mesh::spool::{FaceRecord, MeshSpool};
use crate::points::Coordinate;
use crate::storage::partitions::Partitions;
use crate::storage::spool::Spool;

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
pub(super) fn bytes<T: Coordinate, M: Mark>(vertices: u64) -> u64 {
    let sorting = 2 * SORTED * size_of::<Corner<T>>() as u64 + (1 << 22);
    let placing = if M::CARRIED { sorting.max(blend::bytes()) } else { 0 };
    vertices.div_ceil(64) * 12 + (2 * SORTED) * 24 + (1 << 20) + placing
}

/// Where the vertices that are left lie.
#[derive(Debug, Clone, Copy)]
pub(super) enum Placed {
    /// Where they did.
    AsBefore,
    /// Where the triangles say, with attributes between those of two vertices, and these colours.
    Anew(Option<Colours>),
}

/// A corner of a triangle: its vertex, by the number it gets, where that lies and what it is made of. 36 bytes in single precision, 48 in double.
#[derive(Debug, Clone, Copy, bytemuck::Zeroable, bytemuck::Pod)]
#[repr(C, packed)]
struct Corner<T> {
    number: u32,
    vertex: u32,
    place: [T; 3],
    blend: Blend,
}

/// Numbers what is left of `mesh` anew. Its vertices, attributes and triangles go to the spools `out`, which are empty, or to new ones.
pub(super) fn numbered<T: Coordinate, M: Mark>(
    mesh: &dyn MeshSource,
    soup: &Soup<T, M>,
    placed: Placed,
    passes: &Passes,
    out: Option<[Spool; 3]>,
) -> Result<MeshSpool> {
    let mut left = Left::of(mesh.vertex_count());
    each(soup, |record| {
        let vertices = record.vertices;
        vertices.into_iter().for_each(|v| left.mark(v));
        Ok(())
    })?;
    let vertices = left.count();

    let quota = passes.room.quota;
    let schema = mesh.schema().clone();
    let whole = match out {
        Some(out) => MeshSpool::in_spools(T::PRECISION, schema, out),
        None => MeshSpool::with_attributes(passes.workspace, T::PRECISION, schema, quota),
    };
    let mut whole = whole.placed(mesh.origin());
    match placed {
        Placed::AsBefore => copy_vertices(mesh, &left, &mut whole)?,
        Placed::Anew(colours) => place_vertices(mesh, soup, (&left, vertices), colours, &mut whole, passes)?,
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

/// Copies the vertices that are left.
fn copy_vertices(mesh: &dyn MeshSource, left: &Left, whole: &mut MeshSpool) -> Result<()> {
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
    Ok(())
}

/// Places the vertices that are left where the triangles say.
fn place_vertices<T: Coordinate, M: Mark>(
    mesh: &dyn MeshSource,
    soup: &Soup<T, M>,
    (left, vertices): (&Left, u64),
    colours: Option<Colours>,
    whole: &mut MeshSpool,
    passes: &Passes,
) -> Result<()> {
    // There are about six corners to a vertex.
    let ranges = vertices.div_ceil(SORTED / 6).max(1);
    let range = vertices.div_ceil(ranges).max(1);
    let mut partitions = Partitions::<Corner<T>>::new(ranges as usize, 1 << 18, passes.room.quota, passes.workspace);
    each(soup, |record| {
        let (vertices, corners, marks) = (record.vertices, record.corners, record.marks());
        (0..3).try_for_each(|k| {
            let (vertex, place, blend) = (vertices[k], corners[k], marks.corners[k]);
            let number = left.number(vertex);
            partitions.push((u64::from(number) / range) as usize, &Corner { number, vertex, place, blend })
        })
    })?;
    let has_attributes = !mesh.schema().attributes().is_empty();
    let mut blended = passes.workspace.spool(passes.room.quota);
    let mut corners: Vec<Corner<T>> = Vec::new();
    for part in 0..partitions.count() {
        corners.clear();
        partitions.read(part, |corner| {
            // Vertices come once, not once for every triangle.
            corners.push(*corner);
            if corners.len() as u64 >= SORTED + range {
                once_each(&mut corners);
            }
            Ok(())
        })?;
        once_each(&mut corners);
        for block in corners.chunks(BLOCK) {
            let places: Vec<[f64; 3]> = block.iter().map(|corner| { corner.place }.map(Into::into)).collect();
            whole.append_vertices(&places)?;
            if has_attributes {
                let of = |corner: &Corner<T>| Blended { near: corner.vertex, blend: corner.blend };
                blended.append(bytemuck::cast_slice(&block.iter().map(of).collect::<Vec<Blended>>()))?;
            }
        }
    }
    drop((partitions, corners));
    if has_attributes {
        let means = (passes.workers, passes.workspace);
        blend::append_attributes(mesh, &blended, colours, whole, passes.room.quota, means)?;
    }
    Ok(())
}

/// Sorts corners, and leaves one of each vertex.
fn once_each<T: Coordinate>(corners: &mut Vec<Corner<T>>) {
    corners.sort_unstable_by_key(|corner| corner.number);
    corners.dedup_by_key(|corner| corner.number);
}

fn each<T: Coordinate, M: Mark>(soup: &Soup<T, M>, mut visit: impl FnMut(&Record<T, M>) -> Result<()>) -> Result<()> {
    soup.each_block(|records| records.iter().try_for_each(&mut visit))
}
