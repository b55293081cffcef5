//! Attributes as mesh files have them: a property for each, in a type the format has.
//!
//! Colours of 16 bits are looked at first, all of them: LAS files store colours of 8 bits in 16, as they are or times 256 or 257. Where that is so, the
//! 8 bits are written, from which the stored values follow; where it is not, all 16.

use crate::error::Result;
use crate::mesh::spool::MeshSpool;
use crate::mesh::{MeshHeader, MeshSource};
use crate::points::scalar::{Column, Endian, Reader, Scalar, reader};
use crate::resources::workers::Workers;

/// Vertices looked at, or written, at once.
pub const BLOCK: usize = 1 << 15;

/// What is written of an attribute.
#[derive(Debug, Clone)]
pub struct Property {
    /// The attribute's name.
    pub name: String,
    /// Where it lies in a vertex's record.
    pub from: Column,
    /// The type it is written in.
    pub scalar: Scalar,
    /// Whether it is the higher eight bits of sixteen.
    high: bool,
    read: Reader,
}

impl Property {
    /// The value to write.
    #[inline]
    pub fn value(&self, record: &[u8]) -> f64 {
        let value = (self.read)(&record[self.from.offset..]);
        if self.high { (value / 256.0).floor() } else { value }
    }

    /// The value that is full light, if it is a colour.
    pub fn full(&self) -> f64 {
        match self.scalar {
            Scalar::U8 => 255.0,
            Scalar::U16 => 65535.0,
            _ => 1.0,
        }
    }
}

/// The colours, if there are all three.
pub const COLOURS: [&str; 3] = ["red", "green", "blue"];

/// The properties of a mesh's vertices, in the order of its schema.
pub fn properties(mesh: &MeshSpool, header: &MeshHeader, workers: &Workers) -> Result<Vec<Property>> {
    let schema = mesh.schema();
    let depth = colour_depth(mesh, workers)?;
    let property = |name: &str, scalar: Scalar| {
        let from = schema.column(name).expect("an attribute of the schema is in it");
        let colour = COLOURS.contains(&name) && scalar == Scalar::U16;
        let (scalar, high) = match depth {
            Depth::Low if colour => (Scalar::U8, false),
            Depth::High if colour => (Scalar::U8, true),
            _ => (scalar, false),
        };
        Property { name: name.to_string(), from, scalar, high, read: reader(from.scalar, Endian::NATIVE) }
    };
    let written = schema.attributes().iter().filter(|a| !header.constant.contains(&a.name));
    Ok(written.map(|a| property(&a.name, a.scalar)).collect())
}

/// The attributes that all vertices of a mesh have with the same bits, and their values. A colour that changes in one of its three numbers changes.
///
/// # Errors
/// Errors of reading the mesh; [`crate::Error::Interrupted`].
pub fn constant(mesh: &MeshSpool, workers: &Workers) -> Result<Vec<(String, f64)>> {
    let (schema, vertices) = (mesh.schema(), mesh.vertex_count());
    let stride = schema.stride();
    if stride == 0 || vertices == 0 {
        return Ok(Vec::new());
    }
    let first = records(mesh, 0, 1)?;
    let columns: Vec<_> = schema.attributes().iter().filter_map(|a| schema.column(&a.name)).collect();
    let differs = |record: &[u8], column: &Column| {
        let bytes = column.offset..column.offset + column.scalar.bytes();
        record[bytes.clone()] != first[bytes]
    };
    let mut changes = vec![false; columns.len()];
    let look = |number: usize| {
        let records = records(mesh, number as u64 * BLOCK as u64, BLOCK)?;
        let changes = |column: &Column| records.chunks_exact(stride).any(|record| differs(record, column));
        Ok(columns.iter().map(changes).collect::<Vec<bool>>())
    };
    let blocks = vertices.div_ceil(BLOCK as u64) as usize;
    workers.in_order_range(workers.threads() + 1, blocks, look, |part| {
        changes.iter_mut().zip(part).for_each(|(all, part)| *all |= part);
        Ok(())
    })?;
    let names: Vec<&str> = schema.attributes().iter().map(|a| a.name.as_str()).collect();
    let is_colour = |name: &&str| COLOURS.contains(name);
    let coloured = names.iter().zip(&changes).any(|(name, changes)| is_colour(name) && *changes);
    let kept = names
        .iter()
        .zip(&columns)
        .zip(&changes)
        .filter(|((name, _), changes)| !(**changes || coloured && is_colour(name)));
    Ok(kept
        .map(|((name, column), _)| (name.to_string(), reader(column.scalar, Endian::NATIVE)(&first[column.offset..])))
        .collect())
}

/// Where in 16 bits a colour lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Depth {
    /// In the lower eight.
    Low,
    /// In the higher eight, and the lower eight follow from them.
    High,
    /// In all.
    All,
}

/// What all colours of 16 bits have in common.
fn colour_depth(mesh: &MeshSpool, workers: &Workers) -> Result<Depth> {
    let schema = mesh.schema();
    let columns: Vec<Column> =
        COLOURS.iter().filter_map(|name| schema.column(name)).filter(|c| c.scalar == Scalar::U16).collect();
    if columns.is_empty() {
        return Ok(Depth::All);
    }
    let (mut low, mut times_256, mut times_257) = (true, true, true);
    let blocks = mesh.vertex_count().div_ceil(BLOCK as u64) as usize;
    let look = |number: usize| {
        let records = records(mesh, number as u64 * BLOCK as u64, BLOCK)?;
        let (mut low, mut times_256, mut times_257) = (true, true, true);
        for record in records.chunks_exact(schema.stride()) {
            for column in &columns {
                let value = u16::from_ne_bytes([record[column.offset], record[column.offset + 1]]);
                low &= value < 256;
                times_256 &= value.is_multiple_of(256);
                times_257 &= value.is_multiple_of(257);
            }
        }
        Ok((low, times_256, times_257))
    };
    workers.in_order_range(workers.threads() + 1, blocks, look, |part| {
        low &= part.0;
        times_256 &= part.1;
        times_257 &= part.2;
        Ok(())
    })?;
    Ok(if low {
        Depth::Low
    } else if times_256 || times_257 {
        Depth::High
    } else {
        Depth::All
    })
}

/// The records of up to `count` vertices from `first` on.
pub fn records(mesh: &MeshSpool, first: u64, count: usize) -> Result<Vec<u8>> {
    let stride = mesh.schema().stride();
    let count = (mesh.vertex_count() - first).min(count as u64) as usize;
    let mut records = vec![0; count * stride];
    mesh.read_records(first, &mut records)?;
    Ok(records)
}
