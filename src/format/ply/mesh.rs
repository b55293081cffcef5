//! PLY: in place if it is binary, little-endian and all triangles, converted otherwise.

use std::fs::File;
use std::io::{BufReader, ErrorKind, Read};
use std::path::PathBuf;

use crate::error::{Error, Result};
use crate::format::lines::quoted;
use crate::format::ply::header::{CORNERS, Element, Encoding, Header, MAX_HEADER, Property, PropertyKind};
use crate::format::ply::is_ply;
use crate::format::read::convert::Converter;
use crate::format::read::input::{Input, chosen};
use crate::format::read::text::{FromStart, Lines};
use crate::mesh::{MeshSource, check_vertex_count};
use crate::points::Precision;
use crate::points::attribute::{Attribute, Schema, Wanted, canonical};
use crate::points::scalar::{Endian, Scalar, reader};
use crate::storage::spool::Workspace;
use crate::system::FileAt;

/// Bytes read at once.
const PIECE: usize = 1 << 16;
/// The coordinates' names.
const AXES: [&str; 3] = ["x", "y", "z"];
/// The elements of a mesh, each of which must be there once.
const NEEDED: [(&str, &str); 2] =
    [("vertex", "one element vertex"), ("face", "one element face (is this a point cloud?)")];

pub(crate) fn open(
    input: Input,
    workspace: &Workspace,
    in_memory: u64,
    wanted: &Wanted,
) -> Result<Box<dyn MeshSource>> {
    let header = header_of(&input)?;
    for (needed, what) in NEEDED {
        if header.elements.iter().filter(|element| element.name == needed).count() != 1 {
            return Err(Error::malformed(input.path, "the header", what, "none, or several"));
        }
    }
    let there = attributes(find(&header, "vertex")).map(|(name, _, scalar)| Attribute::new(name, scalar));
    let schema = Schema::new(there.collect());
    let chosen = chosen(input.path, wanted, &schema)?;
    let layout = Layout::of(&input, &header)?;
    if let Some(layout) = layout
        && layout.is_all_triangles(&input)?
    {
        let (path, origin) = (input.path.to_path_buf(), header.origin);
        return Ok(Box::new(InPlace { path, file: input.file, layout, origin, schema }));
    }
    Ok(Box::new(convert(&input, &header, workspace, in_memory, chosen)?))
}

/// Whether there are faces.
pub(crate) fn has_faces(input: &Input) -> Result<bool> {
    Ok(header_of(input)?.elements.iter().any(|element| element.name == "face" && element.count > 0))
}

/// Reads the header, whatever elements it tells of.
fn header_of(input: &Input) -> Result<Header> {
    let mut head = vec![0; input.length.min(MAX_HEADER) as usize];
    input.read_at(0, &mut head)?;
    if !is_ply(&head) {
        return Err(Error::malformed(input.path, "header line 1", "\"ply\"", quoted(&head)));
    }
    Header::parse(input.path, &head)
}

/// Where vertices and triangles lie in a file whose elements all have a fixed length.
struct Layout {
    vertices: u64,
    vertex_at: u64,
    vertex_stride: usize,
    /// Offset and type of x, y and z in a vertex.
    axes: [(usize, Scalar); 3],
    /// Offset and type of each attribute in a vertex.
    attributes: Vec<(usize, Scalar)>,
    faces: u64,
    face_at: u64,
    face_stride: usize,
    /// Offset of the list in a face: one byte of 3, then three vertex numbers of four bytes.
    list_at: usize,
}

impl Layout {
    /// The layout on the supposition that all faces are triangles; `None` if the file cannot be read in place.
    fn of(input: &Input, header: &Header) -> Result<Option<Layout>> {
        let (vertex, face) = (find(header, "vertex"), find(header, "face"));
        check_vertex_count(vertex.count)?;
        let axes = axes(input, vertex)?;
        let attributes = attributes(vertex).map(|(_, offset, kind)| (offset, kind)).collect();
        let list = corners(input, face)?;
        let (mut face_stride, mut list_at) = (0, 0);
        for (i, property) in face.properties.iter().enumerate() {
            if i == list {
                list_at = face_stride;
            }
            face_stride += match property.kind {
                PropertyKind::Number(scalar) => scalar.bytes(),
                PropertyKind::List { count: Scalar::U8 | Scalar::I8, item: Scalar::I32 | Scalar::U32 } if i == list => {
                    13
                }
                PropertyKind::List { .. } => return Ok(None),
            };
        }
        if header.encoding != Encoding::Binary(Endian::Little) {
            return Ok(None);
        }
        let (mut vertex_at, mut face_at, mut vertex_stride) = (0, 0, 0);
        let mut at = header.len;
        for element in &header.elements {
            let stride = if element.name == "face" { Some(face_stride as u64) } else { element.fixed_size() };
            let Some(stride) = stride else { return Ok(None) };
            match element.name.as_str() {
                "vertex" => (vertex_at, vertex_stride) = (at, stride as usize),
                "face" => face_at = at,
                _ => {}
            }
            let end = element.count.checked_mul(stride).and_then(|bytes| bytes.checked_add(at));
            match end {
                Some(end) if end <= input.length => at = end,
                // Too short for triangles may be long enough for lists that are shorter.
                _ if element.name == "face" => return Ok(None),
                _ => {
                    let place = format!("element {}", element.name);
                    let expected = format!("{} of {stride} bytes from byte {at}", element.count);
                    let found = format!("the end of the file at byte {}", input.length);
                    return Err(Error::malformed(input.path, place, expected, found));
                }
            }
        }
        let (vertices, faces) = (vertex.count, face.count);
        Ok(Some(Layout { vertices, vertex_at, vertex_stride, axes, attributes, faces, face_at, face_stride, list_at }))
    }

    /// Whether every face has three corners.
    fn is_all_triangles(&self, input: &Input) -> Result<bool> {
        let mut done = 0;
        let mut piece = vec![0; (16 * PIECE / self.face_stride).max(1) * self.face_stride];
        while done < self.faces {
            let len = ((self.faces - done) as usize).min(piece.len() / self.face_stride);
            let records = &mut piece[..len * self.face_stride];
            input.read_at(self.face_at + done * self.face_stride as u64, records)?;
            if records.chunks_exact(self.face_stride).any(|record| record[self.list_at] != 3) {
                return Ok(false);
            }
            done += len as u64;
        }
        Ok(true)
    }
}

fn find<'a>(header: &'a Header, name: &str) -> &'a Element {
    header.elements.iter().find(|element| element.name == name).expect("the header was read with it")
}

/// Offset and type of x, y and z; offsets are right if the vertex has no lists.
fn axes(input: &Input, vertex: &Element) -> Result<[(usize, Scalar); 3]> {
    let mut axes = [None; 3];
    let mut at = 0;
    for property in &vertex.properties {
        if let Some(scalar) = property.kind.number() {
            if let Some(axis) = AXES.iter().position(|axis| *axis == property.name) {
                axes[axis] = Some((at, scalar));
            }
            at += scalar.bytes();
        }
    }
    match axes {
        [Some(x), Some(y), Some(z)] => Ok([x, y, z]),
        _ => Err(Error::malformed(input.path, "element vertex", "properties x, y and z", "not all of them")),
    }
}

/// The narrowest precision that keeps coordinates of these types.
fn precision(axes: [Scalar; 3]) -> Precision {
    let narrow = |scalar: &Scalar| *scalar == Scalar::F32 || scalar.bytes() < 4;
    if axes.iter().all(narrow) { Precision::Single } else { Precision::Double }
}

/// What vertices have besides coordinates: name, offset and type; offsets are right if the vertex has no lists.
fn attributes(vertex: &Element) -> impl Iterator<Item = (&str, usize, Scalar)> {
    let mut at = 0;
    vertex.properties.iter().filter_map(move |Property { name, kind }| {
        let scalar = kind.number()?;
        at += scalar.bytes();
        (!AXES.contains(&name.as_str())).then_some((name.as_str(), at - scalar.bytes(), scalar))
    })
}

/// The face's property that lists its corners.
fn corners(input: &Input, face: &Element) -> Result<usize> {
    let lists_corners =
        |Property { name, kind }: &Property| kind.number().is_none() && CORNERS.contains(&name.as_str());
    face.properties
        .iter()
        .position(lists_corners)
        .ok_or_else(|| Error::malformed(input.path, "element face", "a list vertex_indices or vertex_index", "none"))
}

/// A mesh whose elements stay where they are.
struct InPlace {
    path: PathBuf,
    file: File,
    layout: Layout,
    origin: [f64; 3],
    schema: Schema,
}

impl InPlace {
    /// Calls `visit` with the number and the bytes of each of `count` records of `stride` bytes from byte `at`.
    fn records(
        &self,
        at: u64,
        stride: usize,
        count: usize,
        mut visit: impl FnMut(usize, &[u8]) -> Result<()>,
    ) -> Result<()> {
        let in_piece = (PIECE / stride).max(1);
        let mut piece = vec![0; in_piece.min(count) * stride];
        for first in (0..count).step_by(in_piece) {
            let piece = &mut piece[..in_piece.min(count - first) * stride];
            let from = at + (first * stride) as u64;
            self.file.read_exact_at(piece, from).map_err(Error::io(&self.path, "read"))?;
            for (i, record) in piece.chunks_exact(stride).enumerate() {
                visit(first + i, record)?;
            }
        }
        Ok(())
    }
}

impl MeshSource for InPlace {
    fn vertex_count(&self) -> u64 {
        self.layout.vertices
    }

    fn face_count(&self) -> u64 {
        self.layout.faces
    }

    fn origin(&self) -> [f64; 3] {
        self.origin
    }

    fn precision(&self) -> Precision {
        precision(self.layout.axes.map(|(_, scalar)| scalar))
    }

    fn read_vertices(&self, first: u64, out: &mut [[f64; 3]]) -> Result<()> {
        let Layout { vertex_at, vertex_stride: stride, axes, .. } = self.layout;
        let axes = axes.map(|(at, scalar)| (at, reader(scalar, Endian::Little)));
        self.records(vertex_at + first * stride as u64, stride, out.len(), |i, record| {
            out[i] = axes.map(|(at, value)| value(&record[at..]));
            Ok(())
        })
    }

    fn schema(&self) -> &Schema {
        &self.schema
    }

    fn read_attribute(&self, number: usize, first: u64, out: &mut [f64]) -> Result<()> {
        let Layout { vertex_at, vertex_stride: stride, .. } = self.layout;
        let (at, scalar) = self.layout.attributes[number];
        let value = reader(scalar, Endian::Little);
        self.records(vertex_at + first * stride as u64, stride, out.len(), |i, record| {
            out[i] = value(&record[at..]);
            Ok(())
        })
    }

    fn read_faces(&self, first: u64, out: &mut [[u32; 3]]) -> Result<()> {
        let Layout { vertices, face_at, face_stride: stride, list_at, .. } = self.layout;
        self.records(face_at + first * stride as u64, stride, out.len(), |i, record| {
            let number = |k: usize| {
                let at = list_at + 1 + 4 * k;
                u32::from_le_bytes([record[at], record[at + 1], record[at + 2], record[at + 3]])
            };
            let face = [number(0), number(1), number(2)];
            if let Some(beyond) = face.iter().find(|v| u64::from(**v) >= vertices) {
                let place = format!("face {}", first + i as u64);
                let expected = format!("vertex numbers below {vertices}, the number of vertices");
                return Err(Error::malformed(&self.path, place, expected, *beyond as i32));
            }
            out[i] = face;
            Ok(())
        })
    }
}

/// Reads a file of any encoding, polygons and lists from front to back.
fn convert(
    input: &Input,
    header: &Header,
    workspace: &Workspace,
    in_memory: u64,
    schema: Schema,
) -> Result<crate::mesh::spool::MeshSpool> {
    let vertex = find(header, "vertex");
    // Of each property, which of the schema's attributes it is.
    let place = |Property { name, kind }: &Property| {
        kind.number().filter(|_| !AXES.contains(&name.as_str()))?;
        let name = canonical(name);
        schema.attributes().iter().position(|attribute| attribute.name == name)
    };
    let places: Vec<Option<usize>> = vertex.properties.iter().map(place).collect();
    let mut attributes = vec![0.0; schema.attributes().len()];
    let axes = axes(input, vertex)?.map(|(_, scalar)| scalar);
    let corners = corners(input, find(header, "face"))?;
    let mut mesh = Converter::new(input.path, workspace, precision(axes), schema, in_memory);
    let lines = Lines::behind(input, header.len, header.lines);
    let mut values = match header.encoding {
        Encoding::Ascii => Values::Text { lines, at: 0 },
        Encoding::Binary(endian) => Values::Binary { reader: lines.into_rest(), endian, input },
    };
    for element in &header.elements {
        // Elements without properties take no room, however many they are said to be.
        let count = if element.properties.is_empty() { 0 } else { element.count };
        for _ in 0..count {
            let mut position = [0.0; 3];
            for (i, property) in element.properties.iter().enumerate() {
                match property.kind {
                    PropertyKind::Number(scalar) => {
                        let value = values.next(scalar)?;
                        if let Some(axis) = AXES.iter().position(|axis| *axis == property.name) {
                            position[axis] = value;
                        } else if element.name == "vertex"
                            && let Some(place) = places[i]
                        {
                            attributes[place] = value;
                        }
                    }
                    PropertyKind::List { count, item } => {
                        let count = values.count(count)?;
                        if element.name == "face" && i == corners {
                            mesh.polygon((0..count).map(|_| values.count(item)))?;
                        } else {
                            (0..count).try_for_each(|_| values.next(item).map(drop))?;
                        }
                    }
                }
            }
            if element.name == "vertex" {
                mesh.vertex(position)?;
                mesh.attributes(&attributes)?;
            }
        }
    }
    Ok(mesh.finish()?.placed(header.origin))
}

/// The values of a file, one after the other.
enum Values<'a> {
    Text { lines: Lines<'a>, at: usize },
    Binary { reader: BufReader<FromStart<'a>>, endian: Endian, input: &'a Input<'a> },
}

impl Values<'_> {
    fn next(&mut self, scalar: Scalar) -> Result<f64> {
        match self {
            Values::Text { lines, at } => loop {
                let rest = &lines.line()[*at..];
                let word = rest.trim_start();
                if word.is_empty() {
                    if !lines.advance()? {
                        return Err(lines.malformed("a number", "the end of the file"));
                    }
                    *at = 0;
                    continue;
                }
                let start = *at + rest.len() - word.len();
                let len = word.find(char::is_whitespace).unwrap_or(word.len());
                *at = start + len;
                return lines.number(Some(&word[..len]), "a number");
            },
            Values::Binary { reader: bytes_left, endian, input } => {
                let mut bytes = [0; 8];
                let bytes = &mut bytes[..scalar.bytes()];
                bytes_left.read_exact(bytes).map_err(|refused| match refused.kind() {
                    ErrorKind::UnexpectedEof => {
                        let place = format!("byte {}", input.length);
                        Error::malformed(
                            input.path,
                            place,
                            "more elements, as the header promises",
                            "the end of the file",
                        )
                    }
                    _ => Error::io(input.path, "read")(refused),
                })?;
                Ok(reader(scalar, *endian)(bytes))
            }
        }
    }

    /// The next value as a number of things, or the number of a thing.
    fn count(&mut self, scalar: Scalar) -> Result<u64> {
        let value = self.next(scalar)?;
        if value >= 0.0 && value <= f64::from(u32::MAX) && value.fract() == 0.0 {
            return Ok(value as u64);
        }
        let expected = "a whole number that is not negative";
        Err(match self {
            Values::Text { lines, .. } => lines.malformed(expected, value),
            Values::Binary { input, .. } => Error::malformed(input.path, "a list of a face", expected, value),
        })
    }
}
