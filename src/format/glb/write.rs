//! GLB: glTF 2.0 in one file, little-endian.
//!
//! ```text
//!  12 bytes   "glTF", version 2, length of the file
//!   8 bytes   length of the JSON chunk, "JSON"
//!             JSON, padded with spaces to a multiple of 4
//!   8 bytes   length of the binary chunk, "BIN\0"
//!             positions, f32×3 each; colours, u8×4 or u16×4 each; other attributes, one after the other, 4 bytes each; vertex
//!             numbers, u16×3 or u32×3 each, padded to a multiple of 4
//! ```
//!
//! Coordinates stand as in the input, less the origin; the scene's only node turns them so that y is up, as glTF has it, and moves them. Far origins stand there
//! alone, so that positions stay small. Colours are converted to linear light, in 16 bits, as glTF has them. The material is no metal, and a sheet's has two sides.
//! Vertex numbers are `u16` where they fit. Attributes of no more than 16 bits keep their type, with padding; others become
//! `f32`, since glTF has no wider type for a vertex's attribute.
//!
//! Lengths are 32 bits wide, which limits the file to 4 GiB. A mesh without triangles becomes an empty scene, since glTF
//! has no empty accessors.

use serde_json::{Value, json};

use crate::error::{Error, Result};
use crate::format::write::attributes::{COLOURS, Property, properties, records};
use crate::format::write::job::Job;
use crate::mesh::{MeshHeader, MeshSource};
use crate::points::scalar::Scalar;

/// Elements of a block.
const BLOCK: usize = 1 << 16;
/// Bytes of a vertex, and of a triangle.
const ELEMENT: u64 = 12;
pub(crate) const FLOAT: u32 = 5126;
pub(crate) const UNSIGNED_INT: u32 = 5125;
pub(crate) const UNSIGNED_SHORT: u32 = 5123;
/// The most vertices that are numbered in 16 bits: the last number has a meaning of its own.
pub(crate) const MOST_SHORT: u64 = 65_535;
pub(crate) const ARRAY_BUFFER: u32 = 34962;
pub(crate) const ELEMENT_ARRAY_BUFFER: u32 = 34963;
pub(crate) const TRIANGLES: u32 = 4;
/// A quarter turn about x: glTF has y up, maps have z.
pub const Z_UP_TO_Y_UP: [f64; 4] = [-std::f64::consts::FRAC_1_SQRT_2, 0.0, 0.0, std::f64::consts::FRAC_1_SQRT_2];

pub(crate) fn write(job: &mut Job) -> Result<()> {
    let mesh = job.mesh;
    let (mut vertices, mut faces) = (mesh.vertex_count(), mesh.face_count());
    if vertices == 0 || faces == 0 {
        (vertices, faces) = (0, 0);
    }
    let bounds = if faces > 0 { bounds(job)? } else { [[0.0; 3]; 2] };
    let views = if faces > 0 { views(&properties(mesh, job.header, job.workers)?) } else { Vec::new() };
    let mut json = scene(job.header, vertices, faces, bounds, &views).to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');

    let (number, short) = (number_bytes(vertices), vertices <= MOST_SHORT);
    let indices = (3 * number * faces).next_multiple_of(4);
    let binary = views.iter().map(|view| view.bytes * vertices).sum::<u64>() + ELEMENT * vertices + indices;
    let overhead = 12 + 8 + json.len() as u64 + 8;
    let Ok(length) = u32::try_from(overhead + binary) else {
        let limit = (u64::from(u32::MAX) - overhead).saturating_sub(ELEMENT * vertices) / (3 * number);
        return Err(Error::TooManyElements { count: faces, what: "triangles", limit, carrier: "a GLB file of 4 GiB" });
    };
    // An empty scene has no binary chunk.
    let length = if faces > 0 { length } else { length - 8 };
    job.put(b"glTF")?;
    job.put(&2u32.to_le_bytes())?;
    job.put(&length.to_le_bytes())?;
    job.put(&(json.len() as u32).to_le_bytes())?;
    job.put(b"JSON")?;
    job.put(&json)?;
    if faces == 0 {
        return Ok(());
    }
    job.put(&(binary as u32).to_le_bytes())?;
    job.put(b"BIN\0")?;
    job.put_blocks(vertices, BLOCK, |first, len| {
        let mut positions = vec![[0.0; 3]; len];
        mesh.read_vertices(first, &mut positions)?;
        Ok(positions.as_flattened().iter().flat_map(|c| (*c as f32).to_le_bytes()).collect())
    })?;
    for view in &views {
        job.put_blocks(vertices, BLOCK, |first, len| {
            let records = records(mesh, first, len)?;
            let mut out = Vec::with_capacity(len * view.bytes as usize);
            records.chunks_exact(mesh.schema().stride()).for_each(|record| view.put(record, &mut out));
            Ok(out)
        })?;
    }
    job.put_blocks(faces, BLOCK, |first, len| {
        let mut numbers = vec![[0; 3]; len];
        mesh.read_faces(first, &mut numbers)?;
        let numbers = numbers.as_flattened().iter();
        Ok(match short {
            true => numbers.flat_map(|v| (*v as u16).to_le_bytes()).collect(),
            false => numbers.flat_map(|v| v.to_le_bytes()).collect(),
        })
    })?;
    let padding = indices - 3 * number * faces;
    job.put(&[0; 3][..padding as usize])
}

/// Bytes of a vertex number.
fn number_bytes(vertices: u64) -> u64 {
    if vertices <= MOST_SHORT { 2 } else { 4 }
}

/// The 16 bits of linear light for a stored colour, which is in sRGB, from 0 to 1.
fn linear(colour: f64) -> f64 {
    let light = if colour <= 0.04045 { colour / 12.92 } else { libm::pow((colour + 0.055) / 1.055, 2.4) };
    (light * 65535.0).round()
}

/// Smallest and largest coordinates of all vertices, as they will be written: glTF asks for them in the JSON.
fn bounds(job: &Job) -> Result<[[f32; 3]; 2]> {
    let mesh = job.mesh;
    let [mut low, mut high] = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
    let blocks = mesh.vertex_count().div_ceil(BLOCK as u64) as usize;
    let look = |number: usize| {
        let first = number as u64 * BLOCK as u64;
        let mut positions = vec![[0.0; 3]; (mesh.vertex_count() - first).min(BLOCK as u64) as usize];
        mesh.read_vertices(first, &mut positions)?;
        let mut bounds = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
        for position in positions {
            widen(&mut bounds, position.map(|c| c as f32));
        }
        Ok(bounds)
    };
    job.workers.in_order_range(job.workers.threads() + 1, blocks, look, |[l, h]| {
        let mut bounds = [low, high];
        widen(&mut bounds, l);
        widen(&mut bounds, h);
        [low, high] = bounds;
        Ok(())
    })?;
    Ok([low, high])
}

fn widen([low, high]: &mut [[f32; 3]; 2], position: [f32; 3]) {
    for axis in 0..3 {
        low[axis] = low[axis].min(position[axis]);
        high[axis] = high[axis].max(position[axis]);
    }
}

/// One attribute of glTF.
#[derive(Debug)]
pub(crate) struct View {
    pub(crate) name: String,
    /// The numbers of it.
    properties: Vec<Property>,
    pub(crate) scalar: Scalar,
    /// `VEC4`, a colour, or `SCALAR`.
    pub(crate) kind: &'static str,
    /// From one vertex to the next: a multiple of four.
    pub(crate) bytes: u64,
}

impl View {
    /// Appends what a vertex has, of its record.
    pub(crate) fn put(&self, record: &[u8], out: &mut Vec<u8>) {
        let start = out.len();
        for property in &self.properties {
            let value = property.value(record);
            let value = if self.kind == "VEC4" { linear(value / property.full()) } else { value };
            self.scalar.put(value, out);
        }
        // Behind a colour: that it hides all.
        out.resize(start + self.bytes as usize, if self.kind == "VEC4" { 0xff } else { 0 });
    }
}

/// What glTF makes of properties.
pub(crate) fn views(properties: &[Property]) -> Vec<View> {
    let find = |name: &&str| properties.iter().find(|property| property.name == *name).cloned();
    let colours: Vec<Property> = COLOURS.iter().filter_map(find).collect();
    let light = |p: &Property| p.scalar == colours[0].scalar && matches!(p.scalar, Scalar::U8 | Scalar::U16);
    let coloured = colours.len() == 3 && colours.iter().all(light);
    let mut views = Vec::new();
    if coloured {
        // In eight bits, linear light would not tell dark colours apart.
        let scalar = Scalar::U16;
        let (name, bytes) = ("COLOR_0".to_string(), 4 * scalar.bytes() as u64);
        views.push(View { name, properties: colours, scalar, kind: "VEC4", bytes });
    }
    for property in properties {
        if coloured && COLOURS.contains(&property.name.as_str()) {
            continue;
        }
        let name = format!("_{}", property.name.to_uppercase());
        let narrow = matches!(property.scalar, Scalar::I8 | Scalar::U8 | Scalar::I16 | Scalar::U16);
        let scalar = if narrow { property.scalar } else { Scalar::F32 };
        views.push(View { name, properties: vec![property.clone()], scalar, kind: "SCALAR", bytes: 4 });
    }
    views
}

/// glTF's number for a type.
pub(crate) fn component(scalar: Scalar) -> u32 {
    match scalar {
        Scalar::I8 => 5120,
        Scalar::U8 => 5121,
        Scalar::I16 => 5122,
        Scalar::U16 => 5123,
        _ => FLOAT,
    }
}

fn scene(header: &MeshHeader, vertices: u64, faces: u64, [low, high]: [[f32; 3]; 2], views: &[View]) -> Value {
    let mut asset = json!({
        "version": "2.0",
        "generator": concat!("asra-stream ", env!("CARGO_PKG_VERSION")),
        "extras": { "origin": header.origin, "comments": header.comments },
    });
    if header.comments.is_empty() {
        asset["extras"] = json!({ "origin": header.origin });
    }
    if faces == 0 {
        return json!({ "asset": asset, "scene": 0, "scenes": [{}] });
    }
    let mut attributes = json!({ "POSITION": 0 });
    let mut accessors = vec![
        json!({ "bufferView": 0, "componentType": FLOAT, "count": vertices, "type": "VEC3", "min": low, "max": high }),
    ];
    let mut at = ELEMENT * vertices;
    let mut buffer_views = vec![json!({ "buffer": 0, "byteOffset": 0, "byteLength": at, "target": ARRAY_BUFFER })];
    for View { name, scalar, kind, bytes, .. } in views {
        attributes[name] = json!(accessors.len());
        let mut accessor = json!({ "bufferView": buffer_views.len(), "componentType": component(*scalar), "count": vertices, "type": kind });
        if *kind == "VEC4" {
            accessor["normalized"] = json!(true);
        }
        accessors.push(accessor);
        let (length, target) = (bytes * vertices, ARRAY_BUFFER);
        buffer_views.push(
            json!({ "buffer": 0, "byteOffset": at, "byteLength": length, "byteStride": bytes, "target": target }),
        );
        at += length;
    }
    let [x, y, z] = header.origin;
    let mut node = json!({ "mesh": 0, "rotation": Z_UP_TO_Y_UP, "translation": [x, z, 0.0 - y] });
    if let Some(crs) = &header.crs {
        node["extras"] = json!({ "crs": crs.to_string(), "wkt": crs.wkt, "epsg": crs.epsg });
    }
    let (indices, length, target) = (accessors.len(), 3 * number_bytes(vertices) * faces, ELEMENT_ARRAY_BUFFER);
    let kind = if vertices <= MOST_SHORT { UNSIGNED_SHORT } else { UNSIGNED_INT };
    accessors
        .push(json!({ "bufferView": buffer_views.len(), "componentType": kind, "count": 3 * faces, "type": "SCALAR" }));
    buffer_views.push(json!({ "buffer": 0, "byteOffset": at, "byteLength": length, "target": target }));
    json!({
        "asset": asset,
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [node],
        "meshes": [{ "primitives": [{ "attributes": attributes, "indices": indices, "material": 0, "mode": TRIANGLES }] }],
        "materials": [{ "pbrMetallicRoughness": { "metallicFactor": 0 }, "doubleSided": header.sheet }],
        "accessors": accessors,
        "bufferViews": buffer_views,
        "buffers": [{ "byteLength": at + length.next_multiple_of(4) }],
    })
}
