//! Wavefront OBJ: the vertices. Faces and all other statements are passed over.
//!
//! Colours behind the coordinates (`v x y z r g b`) are not in the format's description, but in files of MeshLab, ZBrush and many others. They are attributes if all
//! vertices near the beginning have them: whole numbers up to 255, or, as most write them, fractions of 1.

use std::sync::Arc;

use super::lines::{blanks, lines, number};
use super::statements::Statements;
use crate::error::Result;
use crate::format::point_format::{PointFormat, Source};
use crate::points::attribute::Attribute;
use crate::points::scalar::Scalar;
use crate::storage::mapped::Content;

/// Bytes at the beginning in which vertices are looked at for colours.
const SAMPLE: u64 = 64 << 10;

/// Statements that may come before the first vertex.
const BEFORE: [&[u8]; 8] = [b"mtllib", b"o", b"g", b"s", b"usemtl", b"vn", b"vt", b"vp"];

/// Whether text that begins like this is OBJ: a `v` and numbers before anything that is no statement.
pub fn is_obj(head: &[u8]) -> bool {
    for (_, range) in lines(head) {
        let mut words = blanks(&head[range]);
        match words.next() {
            None => {}
            Some(word) if word.starts_with(b"#") || BEFORE.contains(&word) => {}
            // The line may be cut by the end of what is looked at.
            Some(b"v") => return words.next().is_some_and(|word| number(word).is_some()),
            Some(_) => return false,
        }
    }
    false
}

/// Opens an OBJ file.
///
/// # Errors
/// [`Error::Io`](crate::Error::Io).
pub fn open(content: &Content) -> Result<(Source, Arc<dyn PointFormat>)> {
    let file = content.unmapped()?;
    let head = file.read(0..file.len().min(SAMPLE))?;
    let whole = if head.len() as u64 == file.len() { head.len() } else { memchr::memrchr(b'\n', &head).unwrap_or(0) };
    let colours = colours(&head[..whole]);
    let source = Source {
        path: content.name().to_path_buf(),
        format: "OBJ",
        description: format!("OBJ, its vertices{}", if colours.is_some() { " with colours" } else { "" }),
        records: None,
        bytes: file.len(),
        crs: None,
        remark: None,
    };
    let attributes = colours.map(|scalar| ["red", "green", "blue"].map(|name| Attribute::new(name, scalar)).to_vec());
    Ok((source, Arc::new(Statements::new(&file, b"v", attributes.unwrap_or_default()))))
}

/// The type of the vertices' colours, if all have some.
fn colours(text: &[u8]) -> Option<Scalar> {
    let (mut vertices, mut fractions, mut largest) = (0, 0, 0.0f64);
    for (_, range) in lines(text) {
        let mut words = blanks(&text[range]);
        if words.next() != Some(b"v") {
            continue;
        }
        let numbers: Vec<f64> = words.map(number).collect::<Option<_>>()?;
        let [_, _, _, colour @ ..] = numbers.as_slice() else { return None };
        if colour.len() != 3 || !colour.iter().all(|c| (0.0..=255.0).contains(c)) {
            return None;
        }
        vertices += 1;
        fractions += colour.iter().filter(|c| c.fract() != 0.0).count();
        largest = colour.iter().copied().fold(largest, f64::max);
    }
    // Zeros and ones alone are fractions, too.
    let whole = fractions == 0 && largest > 1.0;
    (vertices > 0).then_some(if whole { Scalar::U8 } else { Scalar::F32 })
}

pub(crate) mod mesh;
#[cfg(test)]
mod tests;
pub(crate) mod write;
