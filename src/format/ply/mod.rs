//! PLY files: the vertices of any of the three encodings, with any properties in any order.
//!
//! Only x, y and z of the element `vertex` are read; elements behind it are not looked at, but there must be room for
//! them, or the file was cut off; those before it are passed over. Vertices without lists have one length each and are read like raw records. The header's counts are checked
//! against the file, never trusted.

mod header;
pub(crate) mod header_text;
mod lists;
pub(crate) mod mesh;
#[cfg(test)]
mod tests;
pub(crate) mod write;

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

use self::header::{Element, Encoding, Header, MAX_HEADER, PropertyKind};
use self::lists::{ListRecords, ListShape};
use super::records::{FixedRecords, RecordShape};
use super::rows::{Item, RowShape, Rows};
use crate::error::{Error, Result};
use crate::format::point_format::{PointFormat, Source};
use crate::points::Precision;
use crate::points::attribute::Attribute;
use crate::points::scalar::{Column, Endian, Scalar};
use crate::storage::mapped::{Content, Mapped};

/// Whether a file that begins like this is a PLY file.
pub fn is_ply(head: &[u8]) -> bool {
    matches!(head, [b'p', b'l', b'y', b'\n' | b'\r' | b' ', ..])
}

/// Opens a PLY file.
///
/// # Errors
/// [`Error::Malformed`] if the header is wrong, has no vertices with x, y and z, or promises more than the file holds.
pub fn open(content: &Content) -> Result<(Source, Arc<dyn PointFormat>)> {
    let (file, path) = (content.open()?, content.name());
    let header = Header::parse(path, &file.bytes(0..file.len().min(MAX_HEADER))?)?;
    let vertex = header.elements.iter().position(|element| element.name == "vertex").ok_or_else(|| {
        Error::malformed(
            path,
            "header",
            "an element named vertex",
            format_args!("{} other elements", header.elements.len()),
        )
    })?;
    let (before, vertices) = (&header.elements[..vertex], &header.elements[vertex]);
    let coordinates = coordinates(path, vertices)?;
    let scalars = coordinates.map(|(_, scalar)| scalar);
    let (format, encoding, remark): (Arc<dyn PointFormat>, String, Option<String>) = match header.encoding {
        Encoding::Ascii => (Arc::new(ascii(&file, &header, before, vertices, coordinates)), "ASCII".to_string(), None),
        Encoding::Binary(endian) => {
            let (format, end) = binary(&file, &header, before, vertices, coordinates, endian)?;
            let behind = &header.elements[vertex + 1..];
            let remark = end.and_then(|end| cut_off(behind, file.len() - end));
            (format, format!("binary {endian}"), remark)
        }
    };
    let precision = match scalars.iter().map(|s| s.precision()).max() {
        Some(Precision::Single) => "single",
        _ => "double",
    };
    let source = Source {
        path: path.to_path_buf(),
        format: "PLY",
        description: format!("PLY {encoding}, {} vertices in {precision} precision", vertices.count),
        records: Some(vertices.count),
        bytes: file.len(),
        crs: None,
        remark,
    };
    Ok((source, format))
}

/// Which properties x, y and z are, and their types.
fn coordinates(path: &Path, vertices: &Element) -> Result<[(usize, Scalar); 3]> {
    let mut found = [(0, Scalar::F32); 3];
    for (place, axis) in found.iter_mut().zip(["x", "y", "z"]) {
        let property = vertices.properties.iter().enumerate().find(|(_, property)| property.name == axis);
        let number = property.and_then(|(index, property)| Some((index, property.kind.number()?)));
        *place = number.ok_or_else(|| {
            let names: Vec<&str> = vertices.properties.iter().map(|p| p.name.as_str()).take(20).collect();
            Error::malformed(path, "header", format_args!("a vertex property {axis}, a number"), names.join(" "))
        })?;
    }
    Ok(found)
}

fn ascii(
    file: &Mapped,
    header: &Header,
    before: &[Element],
    vertices: &Element,
    coordinates: [(usize, Scalar); 3],
) -> Rows {
    let item = |kind| match kind {
        PropertyKind::Number(_) => Item::Number,
        PropertyKind::List { .. } => Item::List,
    };
    Rows {
        len: file.len(),
        start: header.len,
        first_line: header.lines + 1,
        // An element without properties has nothing to put on a line.
        lines_before: before.iter().filter(|e| !e.properties.is_empty()).fold(0, |sum, e| sum.saturating_add(e.count)),
        count: vertices.count,
        attributes: attributes(vertices).map(|(attribute, _)| attribute).collect(),
        shape: Arc::new(RowShape {
            content: file.content().clone(),
            points: "vertices",
            items: vertices.properties.iter().map(|property| item(property.kind)).collect(),
            coordinates: coordinates.map(|(index, _)| index),
            attributes: attributes(vertices).collect(),
            precision: coordinates.iter().map(|(_, scalar)| scalar.precision()).max().unwrap_or(Precision::Double),
        }),
    }
}

fn binary(
    file: &Arc<Mapped>,
    header: &Header,
    before: &[Element],
    vertices: &Element,
    coordinates: [(usize, Scalar); 3],
    endian: Endian,
) -> Result<(Arc<dyn PointFormat>, Option<u64>)> {
    let mut start = header.len;
    for element in before {
        start = lists::skip(file, element, start, endian)?;
    }
    let Some(stride) = vertices.fixed_size() else {
        let shape = ListShape::new(file.path(), vertices, endian);
        let indices = coordinates.map(|(index, _)| index);
        let records = ListRecords::new(file, start, vertices.count, shape, indices, attributes(vertices).collect());
        return Ok((Arc::new(records), None));
    };
    let whole = (file.len() - start) / stride;
    if whole < vertices.count {
        return Err(Error::malformed(
            file.path(),
            format_args!("vertex {whole}"),
            format_args!("{} vertices of {stride} bytes", vertices.count),
            format_args!("the end of the file after {} bytes", file.len()),
        ));
    }
    let offset =
        |index: usize| vertices.properties[..index].iter().filter_map(|p| p.kind.number()).map(Scalar::bytes).sum();
    let coordinates = coordinates.map(|(index, scalar)| Column { offset: offset(index), scalar });
    let attributes = attributes(vertices).map(|(attribute, index)| (attribute, offset(index))).collect();
    let shape = RecordShape { stride: stride as usize, coordinates, endian, transform: None, attributes };
    let end = start + vertices.count * stride;
    Ok((Arc::new(FixedRecords::new(file, start, vertices.count, shape)), Some(end)))
}

/// What to say if `bytes` behind the vertices are too few for the elements that should be there: the points are whole, but the file was cut off.
fn cut_off(behind: &[Element], bytes: u64) -> Option<String> {
    let least = |sum: u64, element: &Element| sum.saturating_add(element.count.saturating_mul(element.least_size()));
    let expected = behind.iter().fold(0, least);
    (bytes < expected).then(|| {
        let rows: Vec<String> = behind.iter().map(|element| format!("{} {}", element.count, element.name)).collect();
        format!(
            "cut off: {} behind the vertices take at least {expected} bytes, the file ends after {bytes} of them; the vertices are all there",
            rows.join(", ")
        )
    })
}

/// The properties that are numbers but no coordinates, with their indices; of those of one name, the first.
fn attributes(vertices: &Element) -> impl Iterator<Item = (Attribute, usize)> {
    let mut seen = BTreeSet::from(["x", "y", "z"].map(str::to_string));
    let numbers =
        vertices.properties.iter().enumerate().filter_map(|(index, p)| Some((index, &p.name, p.kind.number()?)));
    numbers
        .map(|(index, name, scalar)| (Attribute::new(name, scalar), index))
        .filter(move |(attribute, _)| seen.insert(attribute.name.clone()))
}
