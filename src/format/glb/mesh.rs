//! GLB: the triangles of all meshes of a glTF 2.0 file with one binary chunk.
//!
//! Meshes keep their own coordinates, each once: the transformations of the scene's nodes are not applied. But if there is one node with a mesh, on its own, that
//! is only moved, or moved and turned so that y is up, this is the origin, as in the program's own files. Colours, which are in linear light, become sRGB.

use std::collections::BTreeMap;

use serde::Deserialize;

use crate::error::{Error, Result};
use crate::format::glb::write::Z_UP_TO_Y_UP;
use crate::format::read::convert::Converter;
use crate::format::read::input::{Input, chosen, colours};
use crate::mesh::spool::MeshSpool;
use crate::points::Precision;
use crate::points::attribute::{Attribute, Schema, Wanted, canonical};
use crate::points::crs::Crs;
use crate::points::scalar::{Endian, Scalar, reader};
use crate::storage::spool::Workspace;

/// The most bytes of JSON: a scene of hundreds of thousands of meshes.
const LONGEST_JSON: u64 = 1 << 26;
/// JSON that is read whatever the budget is.
const SHORT_JSON: u64 = 1 << 20;
/// What JSON takes when it is read, by its length, at the most.
const JSON_IN_MEMORY: u64 = 36;
/// The longest JSON that is read for what it tells of a reference system.
const LONGEST_TOLD: u64 = 1 << 20;
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
    #[serde(default, deserialize_with = "only")]
    nodes: Option<Node>,
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

/// The node of a scene that has one. Of others, nothing is kept, however many there are.
fn only<'de, D: serde::Deserializer<'de>>(deserializer: D) -> std::result::Result<Option<Node>, D::Error> {
    struct Only;
    impl<'de> serde::de::Visitor<'de> for Only {
        type Value = Option<Node>;

        fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
            f.write_str("a list of nodes")
        }

        fn visit_seq<A: serde::de::SeqAccess<'de>>(self, mut list: A) -> std::result::Result<Option<Node>, A::Error> {
            let first = list.next_element::<Node>()?;
            let mut others = false;
            while list.next_element::<serde::de::IgnoredAny>()?.is_some() {
                others = true;
            }
            Ok(first.filter(|_| !others))
        }
    }
    deserializer.deserialize_seq(Only)
}

#[derive(Deserialize)]
struct Node {
    mesh: Option<usize>,
    translation: Option<[f64; 3]>,
    rotation: Option<[f64; 4]>,
    scale: Option<serde::de::IgnoredAny>,
    matrix: Option<serde::de::IgnoredAny>,
}

impl Scene {
    /// Where its only node puts its mesh.
    fn origin(&self) -> [f64; 3] {
        match &self.nodes {
            Some(Node { mesh: Some(_), translation: Some(origin), rotation: None, scale: None, matrix: None }) => {
                *origin
            }
            // Turned so that y is up: back to where z is.
            Some(Node {
                mesh: Some(_),
                translation: Some([x, y, z]),
                rotation: Some(turn),
                scale: None,
                matrix: None,
            }) if turn.iter().zip(Z_UP_TO_Y_UP).all(|(a, b)| (a - b).abs() < 1e-6) => [*x, 0.0 - *z, *y],
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
    /// The numbers of accessors, by what they hold.
    attributes: BTreeMap<String, usize>,
    indices: Option<usize>,
    mode: Option<u32>,
}

/// An accessor's elements in the file.
struct Elements {
    at: u64,
    stride: u64,
    bytes: usize,
    count: u64,
}

/// The reference system that the node of a scene tells, as this program writes it.
pub(crate) fn told_crs(input: &Input) -> Option<Crs> {
    let (json, _) = chunks(input).ok()?;
    if json.end - json.start > LONGEST_TOLD {
        return None;
    }
    let mut text = vec![0; (json.end - json.start) as usize];
    input.read_at(json.start, &mut text).ok()?;
    let scene: serde_json::Value = serde_json::from_slice(&text).ok()?;
    let extras = &scene["nodes"][0]["extras"];
    let code = extras["epsg"].as_u64().and_then(|code| u32::try_from(code).ok());
    let told = extras["wkt"].as_str().and_then(Crs::parse).filter(|crs| crs.wkt.is_some());
    told.or_else(|| code.map(|epsg| Crs { epsg: Some(epsg), ..Crs::default() }))
        .or_else(|| Crs::parse(extras["crs"].as_str()?))
}

pub(crate) fn read(input: &Input, workspace: &Workspace, in_memory: u64, wanted: &Wanted) -> Result<MeshSpool> {
    let (json, binary) = chunks(input)?;
    let room = (in_memory / JSON_IN_MEMORY).max(SHORT_JSON);
    if json.end - json.start > room {
        let expected = format!("JSON of at most {room} bytes, for which there is room in the budget (`max_memory`)");
        return Err(Error::malformed(input.path, "the JSON chunk", expected, json.end - json.start));
    }
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
    let schema = chosen(input.path, wanted, &attributes(&scene))?;
    let mut mesh = Converter::new(input.path, workspace, Precision::Single, schema.clone(), in_memory);
    for primitive in scene.meshes.iter().flat_map(|mesh| &mesh.primitives) {
        if primitive.mode.is_some_and(|mode| mode != TRIANGLES) {
            let found = format!("mode {}", primitive.mode.unwrap_or_default());
            return Err(Error::malformed(input.path, "a primitive", format!("triangles (mode {TRIANGLES})"), found));
        }
        let Some(&position) = primitive.attributes.get("POSITION") else { continue };
        let positions = elements(input, &scene, &binary, position, "VEC3", &[5126])?;
        let before = mesh.vertex_count();
        each(input, &positions, |bytes| {
            let coordinate =
                |i: usize| f64::from(f32::from_le_bytes([bytes[i], bytes[i + 1], bytes[i + 2], bytes[i + 3]]));
            mesh.vertex([coordinate(0), coordinate(4), coordinate(8)])
        })?;
        read_attributes(input, &scene, &binary, primitive, &schema, positions.count, &mut mesh)?;
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

/// What the name of an attribute of the program's own begins with; there are others, such as `NORMAL`, that are nothing to us.
const OWN: &str = "_";
const COLOUR: &str = "COLOR_0";

/// The attributes that any of the primitives has: colours in 16 bits, others as `f64`.
fn attributes(scene: &Scene) -> Schema {
    let primitives = || scene.meshes.iter().flat_map(|mesh| &mesh.primitives);
    let mut schema = Schema::default();
    if primitives().any(|primitive| primitive.attributes.contains_key(COLOUR)) {
        schema = colours(Scalar::U16);
    }
    let names = primitives().flat_map(|primitive| primitive.attributes.keys());
    names
        .filter_map(|name| name.strip_prefix(OWN))
        .fold(schema, |schema, name| schema.with(&Attribute::new(name, Scalar::F64)))
}

/// Reads the attributes of a primitive's vertices, a piece at a time; what it does not have is zero.
fn read_attributes(
    input: &Input,
    scene: &Scene,
    binary: &std::ops::Range<u64>,
    primitive: &Primitive,
    schema: &Schema,
    count: u64,
    mesh: &mut Converter,
) -> Result<()> {
    // For each attribute of the schema: its elements, which of their numbers it is, and what makes it what the schema says.
    let mut columns = Vec::new();
    for attribute in schema.attributes() {
        let channel = ["red", "green", "blue"].iter().position(|name| *name == attribute.name);
        let own = |name: &&String| name.strip_prefix(OWN).is_some_and(|own| canonical(own) == attribute.name);
        let (name, number) = match channel.filter(|_| attribute.scalar == Scalar::U16) {
            Some(channel) => (Some(COLOUR), channel),
            None => (primitive.attributes.keys().find(own).map(String::as_str), 0),
        };
        let Some(&accessor) = name.and_then(|name| primitive.attributes.get(name)) else {
            columns.push(None);
            continue;
        };
        let (kind, shape) = match scene.accessors.get(accessor) {
            Some(found) => (found.component_type, found.shape.as_str()),
            None => (0, ""),
        };
        let shape = if name == Some(COLOUR) && shape == "VEC3" {
            "VEC3"
        } else if name == Some(COLOUR) {
            "VEC4"
        } else {
            "SCALAR"
        };
        let kinds: &[u32] =
            if name == Some(COLOUR) { &[5121, 5123, 5126] } else { &[5120, 5121, 5122, 5123, 5125, 5126] };
        let found = elements(input, scene, binary, accessor, shape, kinds)?;
        if found.count != count {
            let expected = format!("as many as positions, {count}");
            return Err(Error::malformed(input.path, format!("accessor {accessor}"), expected, found.count));
        }
        let (scalar, factor) = match kind {
            5120 => (Scalar::I8, 1.0),
            5121 => (Scalar::U8, 257.0),
            5122 => (Scalar::I16, 1.0),
            5123 => (Scalar::U16, 1.0),
            5125 => (Scalar::U32, 1.0),
            _ => (Scalar::F32, 65535.0),
        };
        let factor = if name == Some(COLOUR) { factor } else { 1.0 };
        columns.push(Some((
            found,
            number * scalar.bytes(),
            reader(scalar, Endian::Little),
            factor,
            name == Some(COLOUR),
        )));
    }
    if columns.is_empty() {
        return Ok(());
    }
    let mut values = vec![0.0; columns.len()];
    for first in (0..count).step_by(PIECE as usize) {
        let len = PIECE.min(count - first);
        let mut pieces = Vec::with_capacity(columns.len());
        for (elements, ..) in columns.iter().flatten() {
            let mut piece = vec![0; ((len - 1) * elements.stride) as usize + elements.bytes];
            input.read_at(elements.at + first * elements.stride, &mut piece)?;
            pieces.push(piece);
        }
        for i in 0..len as usize {
            let mut pieces = pieces.iter();
            for (value, column) in values.iter_mut().zip(&columns) {
                if let (Some((elements, offset, read, factor, colour)), Some(piece)) =
                    (column, column.as_ref().and_then(|_| pieces.next()))
                {
                    *value = read(&piece[i * elements.stride as usize + offset..]) * factor;
                    if *colour {
                        *value = encoded(*value / 65535.0);
                    }
                }
            }
            mesh.attributes(&values)?;
        }
    }
    Ok(())
}

/// The 16 bits of sRGB for linear light from 0 to 1.
fn encoded(light: f64) -> f64 {
    let light = light.clamp(0.0, 1.0);
    let colour = if light <= 0.003_130_8 { light * 12.92 } else { 1.055 * libm::pow(light, 1.0 / 2.4) - 0.055 };
    (colour * 65535.0).round()
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
        5120 | 5121 => 1,
        5122 | 5123 => 2,
        _ => 4,
    };
    let bytes = match shape {
        "VEC3" => 3 * component,
        "VEC4" => 4 * component,
        _ => component,
    };
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
