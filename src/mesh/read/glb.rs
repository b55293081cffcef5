//! GLB: the triangles of all meshes of a glTF 2.0 file with one binary chunk.
//!
//! Meshes keep their own coordinates, each once: the transformations of the scene's nodes are not applied. But if there is one node with a mesh, on its own, that
//! is only moved, this is the origin, as in the program's own files.

use serde::Deserialize;

use super::Input;
use super::convert::Converter;
use crate::error::{Error, Result};
use crate::mesh::spool::MeshSpool;
use crate::points::Precision;
use crate::spool::Workspace;

/// The most bytes of JSON: a scene of hundreds of thousands of nodes.
const LONGEST_JSON: u64 = 1 << 26;
/// Elements read at once.
const PIECE: u64 = 1 << 12;
const TRIANGLES: u32 = 4;

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Scene {
    #[serde(default)]
    accessors: Vec<Accessor>,
    #[serde(default)]
    buffer_views: Vec<View>,
    #[serde(default)]
    meshes: Vec<Mesh>,
    #[serde(default)]
    nodes: Vec<Node>,
    #[serde(default)]
    extensions_required: Vec<String>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Accessor {
    buffer_view: Option<usize>,
    #[serde(default)]
    byte_offset: u64,
    component_type: u32,
    count: u64,
    #[serde(rename = "type")]
    shape: String,
    sparse: Option<serde::de::IgnoredAny>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct View {
    buffer: usize,
    #[serde(default)]
    byte_offset: u64,
    byte_length: u64,
    byte_stride: Option<u64>,
}

#[derive(Deserialize)]
struct Node {
    mesh: Option<usize>,
    translation: Option<[f64; 3]>,
    rotation: Option<serde::de::IgnoredAny>,
    scale: Option<serde::de::IgnoredAny>,
    matrix: Option<serde::de::IgnoredAny>,
}

impl Scene {
    /// Where its only node puts its mesh.
    fn origin(&self) -> [f64; 3] {
        match &self.nodes[..] {
            [Node { mesh: Some(_), translation: Some(origin), rotation: None, scale: None, matrix: None }] => *origin,
            _ => [0.0; 3],
        }
    }
}

#[derive(Deserialize)]
struct Mesh {
    primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
struct Primitive {
    attributes: Attributes,
    indices: Option<usize>,
    mode: Option<u32>,
}

#[derive(Deserialize)]
struct Attributes {
    #[serde(rename = "POSITION")]
    position: Option<usize>,
}

/// An accessor's elements in the file.
struct Elements {
    at: u64,
    stride: u64,
    bytes: usize,
    count: u64,
}

pub(super) fn read(input: &Input, workspace: &Workspace, in_memory: u64) -> Result<MeshSpool> {
    let (json, binary) = chunks(input)?;
    let mut text = vec![0; json.end as usize - json.start as usize];
    input.read_at(json.start, &mut text)?;
    let scene: Scene = serde_json::from_slice(&text)
        .map_err(|error| Error::malformed(input.path, "the JSON chunk", "a glTF 2.0 scene", error))?;
    if scene.extensions_required.iter().any(|name| name.contains("compression")) {
        return Err(Error::ForeignFormat {
            path: input.path.to_path_buf(),
            format: "a compressed GLB",
            advice: "save it without mesh compression",
        });
    }
    let mut mesh = Converter::new(input.path, workspace, Precision::Single, in_memory);
    for primitive in scene.meshes.iter().flat_map(|mesh| &mesh.primitives) {
        if primitive.mode.is_some_and(|mode| mode != TRIANGLES) {
            let found = format!("mode {}", primitive.mode.unwrap_or_default());
            return Err(Error::malformed(input.path, "a primitive", format!("triangles (mode {TRIANGLES})"), found));
        }
        let Some(position) = primitive.attributes.position else { continue };
        let positions = elements(input, &scene, &binary, position, "VEC3", &[5126])?;
        let before = mesh.vertex_count();
        each(input, &positions, |bytes| {
            let coordinate =
                |i: usize| f64::from(f32::from_le_bytes([bytes[i], bytes[i + 1], bytes[i + 2], bytes[i + 3]]));
            mesh.vertex([coordinate(0), coordinate(4), coordinate(8)])
        })?;
        let mut corners = Vec::with_capacity(3);
        let mut corner = |number: u64| {
            if number >= positions.count {
                let expected =
                    format!("vertex numbers below {}, the number of the primitive's positions", positions.count);
                return Err(Error::malformed(input.path, "indices", expected, number));
            }
            corners.push(Ok(before + number));
            if corners.len() == 3 { mesh.polygon(corners.drain(..)) } else { Ok(()) }
        };
        let count = match primitive.indices {
            None => {
                (0..positions.count).try_for_each(&mut corner)?;
                positions.count
            }
            Some(indices) => {
                let indices = elements(input, &scene, &binary, indices, "SCALAR", &[5121, 5123, 5125])?;
                each(input, &indices, |bytes| {
                    corner(bytes.iter().rev().fold(0, |number, byte| number << 8 | u64::from(*byte)))
                })?;
                indices.count
            }
        };
        if !count.is_multiple_of(3) {
            return Err(Error::malformed(input.path, "a primitive", "three corners for each triangle", count));
        }
    }
    Ok(mesh.finish()?.placed(scene.origin()))
}

/// Where the JSON and the binary chunk lie.
fn chunks(input: &Input) -> Result<(std::ops::Range<u64>, std::ops::Range<u64>)> {
    let word = |at: u64| {
        let mut bytes = [0; 4];
        if at + 4 > input.length {
            return Err(Error::malformed(input.path, format!("byte {at}"), "four bytes more", "the end of the file"));
        }
        input.read_at(at, &mut bytes)?;
        Ok(bytes)
    };
    let [version, length] = [u32::from_le_bytes(word(4)?), u32::from_le_bytes(word(8)?)];
    if word(0)? != *b"glTF" || version != 2 {
        return Err(Error::malformed(input.path, "the header", "\"glTF\", version 2", format!("version {version}")));
    }
    if u64::from(length) != input.length {
        let expected = format!("a length of {} bytes, which the file has", input.length);
        return Err(Error::malformed(input.path, "the header", expected, length));
    }
    let chunk = |at: u64, kind: &[u8; 4], most: u64| {
        let (length, found) = (u64::from(u32::from_le_bytes(word(at)?)), word(at + 4)?);
        if found != *kind || length > most.min(input.length - at - 8) {
            let expected = format!("a chunk {:?} within the file", String::from_utf8_lossy(kind));
            let found = format!("{:?} of {length} bytes", String::from_utf8_lossy(&found));
            return Err(Error::malformed(input.path, format!("byte {at}"), expected, found));
        }
        Ok(at + 8..at + 8 + length)
    };
    let json = chunk(12, b"JSON", LONGEST_JSON)?;
    let binary = if json.end < input.length { chunk(json.end, b"BIN\0", u64::MAX)? } else { json.end..json.end };
    Ok((json, binary))
}

/// An accessor of the given shape and component types, all of it within the binary chunk.
fn elements(
    input: &Input,
    scene: &Scene,
    binary: &std::ops::Range<u64>,
    accessor: usize,
    shape: &str,
    types: &[u32],
) -> Result<Elements> {
    let malformed = |expected: &str, found: &dyn std::fmt::Display| {
        Err(Error::malformed(input.path, format!("accessor {accessor}"), expected, found))
    };
    let Some(found) = scene.accessors.get(accessor) else { return malformed("an accessor", &"none") };
    if found.shape != shape || !types.contains(&found.component_type) {
        let expected = format!("{shape} of component type {types:?}");
        return malformed(&expected, &format!("{} of {}", found.shape, found.component_type));
    }
    let view = found.buffer_view.and_then(|view| scene.buffer_views.get(view));
    let Some(view) = view.filter(|view| view.buffer == 0 && found.sparse.is_none()) else {
        return malformed("a view of the file's own buffer, not sparse", &"something else");
    };
    let component = match found.component_type {
        5121 => 1,
        5123 => 2,
        _ => 4,
    };
    let bytes = if shape == "VEC3" { 3 * component } else { component };
    let stride = view.byte_stride.unwrap_or(bytes);
    let length = match found.count {
        0 => Some(0),
        count => (count - 1).checked_mul(stride).and_then(|length| length.checked_add(bytes)),
    };
    let end = length.and_then(|length| length.checked_add(found.byte_offset));
    let view_end = view.byte_offset.checked_add(view.byte_length);
    let fits = end.is_some_and(|end| end <= view.byte_length)
        && view_end.is_some_and(|end| end <= binary.end - binary.start)
        && (bytes..=252.max(bytes)).contains(&stride);
    if !fits {
        let expected = format!("elements within the binary chunk of {} bytes", binary.end - binary.start);
        return malformed(&expected, &format!("{} at a stride of {stride}", found.count));
    }
    let at = binary.start + view.byte_offset + found.byte_offset;
    Ok(Elements { at, stride, bytes: bytes as usize, count: found.count })
}

/// Visits the bytes of each element.
fn each(input: &Input, elements: &Elements, mut visit: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
    let mut piece = Vec::new();
    for first in (0..elements.count).step_by(PIECE as usize) {
        let len = PIECE.min(elements.count - first);
        piece.resize(((len - 1) * elements.stride) as usize + elements.bytes, 0);
        input.read_at(elements.at + first * elements.stride, &mut piece)?;
        for element in piece.chunks(elements.stride as usize) {
            visit(&element[..elements.bytes])?;
        }
    }
    Ok(())
}
