//! The header of a PLY file that is written: vertices, and triangles if there are some, in binary.

use std::fmt;

use crate::points::Precision;
use crate::points::scalar::{Endian, Scalar};

/// What follows a header; as text, the header.
#[derive(Debug)]
pub(crate) struct HeaderText<'a> {
    /// The byte order of what follows.
    pub endian: Endian,
    /// A line each.
    pub comments: Vec<String>,
    /// The number of vertices.
    pub vertices: u64,
    /// The precision of their coordinates.
    pub precision: Precision,
    /// What vertices have behind their coordinates.
    pub attributes: Vec<(&'a str, Scalar)>,
    /// The number of triangles; `None` of points.
    pub faces: Option<u64>,
}

impl fmt::Display for HeaderText<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let HeaderText { endian, comments, vertices, precision, attributes, faces } = self;
        let order = match endian {
            Endian::Little => "little",
            Endian::Big => "big",
        };
        writeln!(f, "ply\nformat binary_{order}_endian 1.0")?;
        for comment in comments {
            writeln!(f, "comment {comment}")?;
        }
        writeln!(f, "element vertex {vertices}")?;
        let coordinates = ["x", "y", "z"].map(|axis| (axis, Scalar::of(*precision)));
        for (name, scalar) in coordinates.iter().chain(attributes) {
            writeln!(f, "property {} {name}", type_name(*scalar))?;
        }
        if let Some(faces) = faces {
            writeln!(f, "element face {faces}\nproperty list uchar int vertex_indices")?;
        }
        writeln!(f, "end_header")
    }
}

/// What PLY calls a type. It has none of 64 bits for whole numbers: `double` takes them, and rounds beyond 2⁵³.
fn type_name(scalar: Scalar) -> &'static str {
    match scalar {
        Scalar::I8 => "char",
        Scalar::U8 => "uchar",
        Scalar::I16 => "short",
        Scalar::U16 => "ushort",
        Scalar::I32 => "int",
        Scalar::U32 => "uint",
        Scalar::F32 => "float",
        Scalar::I64 | Scalar::U64 | Scalar::F64 => "double",
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::format::ply::header::{Encoding, Header};

    #[test]
    fn what_is_written_is_read() {
        let mut header = HeaderText {
            endian: Endian::Little,
            comments: vec!["one".into(), "two".into()],
            vertices: 7,
            precision: Precision::Double,
            attributes: vec![("red", Scalar::U8), ("time", Scalar::F64), ("count", Scalar::U64)],
            faces: Some(9),
        };
        let text = header.to_string();
        let read = Header::parse(Path::new("a.ply"), text.as_bytes()).unwrap();
        assert_eq!((read.encoding, read.len), (Encoding::Binary(Endian::Little), text.len() as u64));
        let counts: Vec<(&str, u64)> = read.elements.iter().map(|e| (e.name.as_str(), e.count)).collect();
        assert_eq!(counts, [("vertex", 7), ("face", 9)]);
        assert_eq!(read.elements[0].fixed_size(), Some(24 + 1 + 8 + 8));
        assert!(text.contains("\ncomment one\ncomment two\n"), "{text}");
        (header.faces, header.endian) = (None, Endian::Big);
        let read = Header::parse(Path::new("a.ply"), header.to_string().as_bytes()).unwrap();
        assert_eq!((read.encoding, read.elements.len()), (Encoding::Binary(Endian::Big), 1));
    }
}
