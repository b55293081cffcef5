//! Attributes of vertices that moved: between those of two vertices of the mesh that was given, which may lie anywhere in it.
//!
//! ```text
//!  vertices that are left, in order: near, far, share, colour      one record each (Blended)
//!            | corners of a triangle [near, near, far] to look up   (mesh::corners)
//!            v
//!  one column for each attribute --> records of all attributes, vertex by vertex
//! ```

use bytemuck::{Pod, Zeroable};

use super::mark::{Blend, Colours, is_measure};
use super::reading::{BLOCK, WINDOW};
use crate::error::Result;
use crate::mesh::MeshSource;
use crate::mesh::corners::{LOOKED_AT_BYTES, Lookup, Order, least_memory};
use crate::mesh::spool::MeshSpool;
use crate::points::Precision;
use crate::points::attribute::{Attribute, Schema};
use crate::points::scalar::Scalar;
use crate::resources::workers::Workers;
use crate::storage::spool::{Spool, Workspace};

/// Bytes for blocks whose vertices lie far apart.
const FAR: u64 = 2 << 20;

/// Bytes that it takes, beside what spools keep: what is looked up of a block, and its records.
pub(super) fn bytes() -> u64 {
    let of_block = BLOCK * (2 * size_of::<Blended>() + 4 * size_of::<f64>()) + WINDOW * size_of::<f64>();
    least_memory::<f64>(BLOCK as u64, 1).max(FAR) + of_block as u64 + BLOCK as u64 * LOOKED_AT_BYTES
}

/// What a vertex that is left is made of.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Blended {
    /// The vertex at the nearer end of the last edge that it was placed on.
    pub(super) near: u32,
    /// The rest.
    pub(super) blend: Blend,
}

/// The vertices that are left, as triangles of the mesh that was given: twice the nearer vertex, and the farther one.
struct Ends<'a> {
    mesh: &'a dyn MeshSource,
    blended: &'a Spool,
}

impl Ends<'_> {
    fn read(&self, first: u64, out: &mut [Blended]) -> Result<()> {
        self.blended.read_at(first * size_of::<Blended>() as u64, bytemuck::cast_slice_mut(out))
    }
}

impl MeshSource for Ends<'_> {
    fn vertex_count(&self) -> u64 {
        self.mesh.vertex_count()
    }

    fn face_count(&self) -> u64 {
        self.blended.len() / size_of::<Blended>() as u64
    }

    fn origin(&self) -> [f64; 3] {
        self.mesh.origin()
    }

    fn precision(&self) -> Precision {
        self.mesh.precision()
    }

    fn read_vertices(&self, first: u64, out: &mut [[f64; 3]]) -> Result<()> {
        self.mesh.read_vertices(first, out)
    }

    fn read_faces(&self, first: u64, out: &mut [[u32; 3]]) -> Result<()> {
        let mut blended = vec![Blended::zeroed(); out.len()];
        self.read(first, &mut blended)?;
        out.iter_mut().zip(blended).for_each(|(face, Blended { near, blend })| *face = [near, near, blend.other]);
        Ok(())
    }

    fn schema(&self) -> &Schema {
        self.mesh.schema()
    }

    fn read_attribute(&self, number: usize, first: u64, out: &mut [f64]) -> Result<()> {
        self.mesh.read_attribute(number, first, out)
    }
}

/// Appends the attributes of vertices that are `blended` of two of `mesh` each, with these colours if vertices have any of their own. Spools keep `quota` bytes in memory.
pub(super) fn append_attributes(
    mesh: &dyn MeshSource,
    blended: &Spool,
    colours: Option<Colours>,
    whole: &mut MeshSpool,
    quota: u64,
    means: (&Workers, &Workspace),
) -> Result<()> {
    let ends = Ends { mesh, blended };
    let attributes = mesh.schema().attributes();
    let quota = quota / attributes.len().max(1) as u64;
    let columns = attributes.iter().enumerate().map(|(number, attribute)| {
        let channel = colours.and_then(|colours| colours.attributes.iter().position(|a| *a == number));
        column(&ends, (number, attribute), channel, quota, means)
    });
    let columns = columns.collect::<Result<Vec<Spool>>>()?;
    let (mut values, mut records) = (vec![Vec::new(); columns.len()], Vec::new());
    for first in (0..ends.face_count()).step_by(BLOCK) {
        let len = (ends.face_count() - first).min(BLOCK as u64) as usize;
        for ((values, column), attribute) in values.iter_mut().zip(&columns).zip(attributes) {
            let bytes = attribute.scalar.bytes();
            values.resize(len * bytes, 0u8);
            column.read_at(first * bytes as u64, values)?;
        }
        records.clear();
        for at in 0..len {
            for (values, attribute) in values.iter().zip(attributes) {
                let bytes = attribute.scalar.bytes();
                records.extend_from_slice(&values[at * bytes..][..bytes]);
            }
        }
        whole.append_attributes(&records)?;
    }
    Ok(())
}

/// An attribute of all vertices, one after another: their colour if it is a channel of that, else between those of two vertices if it is a measure.
fn column(
    ends: &Ends<'_>,
    (number, attribute): (usize, &Attribute),
    channel: Option<usize>,
    quota: u64,
    (workers, workspace): (&Workers, &Workspace),
) -> Result<Spool> {
    let mut column = workspace.spool(quota);
    let blended = |block: u64, len: usize| {
        let mut blended = vec![Blended::zeroed(); len];
        ends.read(block * BLOCK as u64, &mut blended).map(|()| blended)
    };
    let put = |values: &mut dyn Iterator<Item = f64>| {
        let mut bytes = Vec::new();
        values.for_each(|value| attribute.scalar.put(value, &mut bytes));
        bytes
    };
    let blocks = ends.face_count().div_ceil(BLOCK as u64);
    if let Some(channel) = channel {
        for block in 0..blocks {
            let len = (ends.face_count() - block * BLOCK as u64).min(BLOCK as u64) as usize;
            let bytes = put(&mut blended(block, len)?.iter().map(|vertex| vertex.blend.colour[channel].into()));
            column.append(&bytes)?;
        }
        return Ok(column);
    }
    let floats = matches!(attribute.scalar, Scalar::F32 | Scalar::F64);
    let between = |([near, _, far], vertex): ([f64; 3], &Blended)| {
        let share = f64::from(vertex.blend.share);
        match is_measure(attribute) && share > 0.0 {
            false => near,
            true if floats => near + (far - near) * share,
            true => (near + (far - near) * share).round(),
        }
    };
    let lookup = Lookup { mesh: ends, workers, workspace, block: BLOCK, window: WINDOW, in_flight: 1, memory: FAR };
    let read = |first: u64, out: &mut [f64]| ends.read_attribute(number, first, out);
    lookup.for_each(
        0..blocks,
        Order::Triangles,
        &read,
        |block| Ok(put(&mut block.corners().zip(&blended(block.number, block.vertices.len())?).map(between))),
        |bytes| column.append(&bytes).map(drop),
    )?;
    Ok(column)
}

#[cfg(test)]
mod tests {
    use proptest::test_runner::{RngAlgorithm, TestRng};
    use rand::RngExt;

    use super::*;
    use crate::mesh::spool::FaceRecord;

    /// Whether both ends are near, so that windows are read, or far, so that they are picked, or joined on disk as they are too many for memory.
    #[test]
    fn attributes_are_between_those_of_both_ends_wherever_they_lie() {
        const VERTICES: u32 = 300_000;
        let mut numbers = TestRng::from_seed(RngAlgorithm::ChaCha, &[3; 32]);
        let of = |name: &str, scalar| Attribute::new(name, scalar);
        let names = ["red", "green", "blue"].map(|name| of(name, Scalar::U8));
        let rest = [of("height", Scalar::F64), of("intensity", Scalar::U16), of("classification", Scalar::U8)];
        let schema = Schema::new([&names[..], &rest[..]].concat());
        let dir = tempfile::tempdir().unwrap();
        let (workers, workspace) = (Workers::new(2).unwrap(), Workspace::new(dir.path()).unwrap());
        let mut mesh = MeshSpool::with_attributes(&workspace, Precision::Single, schema.clone(), 0);
        let values = |v: u32| [v % 251, v % 13, v % 7, v, v % 60_000, v % 31].map(f64::from);
        let record = |values: [f64; 6]| {
            let mut bytes = Vec::new();
            schema.attributes().iter().zip(values).for_each(|(of, value)| of.scalar.put(value, &mut bytes));
            bytes
        };
        mesh.append_vertices(&vec![[0.0; 3]; VERTICES as usize]).unwrap();
        mesh.append_attributes(&(0..VERTICES).flat_map(|v| record(values(v))).collect::<Vec<u8>>()).unwrap();
        mesh.append_faces(&[FaceRecord::new([0, 1, 2])]).unwrap();
        for (count, far) in [(20_000, 100), (2_000, VERTICES), (30_000, VERTICES)] {
            let made: Vec<Blended> = (0..count)
                .map(|i| {
                    let near = if far == VERTICES { numbers.random_range(0..VERTICES) } else { 3 * i };
                    let other = (near + numbers.random_range(0..far)) % VERTICES;
                    let share = if i % 3 == 0 { 0.0 } else { numbers.random_range(0.0..0.5f32) };
                    Blended { near, blend: Blend { other, share, colour: [(i % 200) as f32, 5.0, 9.0] } }
                })
                .collect();
            for colours in [None, Colours::of(&mesh)] {
                let expected = made.iter().flat_map(|Blended { near, blend }| {
                    let (a, b, share) = (values(*near), values(blend.other), f64::from(blend.share));
                    let mut mean: [f64; 6] = std::array::from_fn(|i| a[i] + (b[i] - a[i]) * share);
                    [0, 1, 2, 4].into_iter().for_each(|i| mean[i] = mean[i].round());
                    mean[5] = a[5];
                    if colours.is_some() {
                        (0..3).for_each(|i| mean[i] = blend.colour[i].into());
                    }
                    record(mean)
                });
                let expected: Vec<u8> = expected.collect();
                let mut blended = workspace.spool(0);
                blended.append(bytemuck::cast_slice(&made)).unwrap();
                let mut whole = MeshSpool::with_attributes(&workspace, Precision::Single, schema.clone(), 0);
                append_attributes(&mesh, &blended, colours, &mut whole, 1 << 16, (&workers, &workspace)).unwrap();
                whole.append_vertices(&vec![[0.0; 3]; count as usize]).unwrap();
                let mut found = vec![0; expected.len()];
                whole.read_records(0, &mut found).unwrap();
                assert!(found == expected, "{count} vertices, {far} apart, colours {colours:?}");
            }
        }
    }
}
