//! A tile's content: GLB in memory, with normals, attributes and, if wanted, a skirt.
//!
//! A skirt hangs from the edges that only one of the tile's triangles has, straight down:
//!
//! ```text
//!      a ---- b        edge of the tile
//!      |  \   |
//!      a'---- b'       as much lower as the skirt is deep
//! ```
//!
//! It hides what is left of gaps to tiles of other levels, which overlap. Its triangles, and those of the overlap, are a second primitive, over the same vertices and their lowered copies.

use rustc_hash::{FxHashMap, FxHashSet};
use serde_json::{Value, json};

use super::pack::{Lattice, encoded_triangles, encoded_vertices, ordered};
use crate::format::glb::write::{
    ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, FLOAT, MOST_SHORT, TRIANGLES, UNSIGNED_INT, UNSIGNED_SHORT, View, Z_UP_TO_Y_UP,
    component,
};

/// glTF's number for integers of 8 bits with a sign.
const BYTE: u32 = 5120;
/// The extension of encoded streams.
const MESHOPT: &str = "EXT_meshopt_compression";

/// A tile's part of a mesh.
#[derive(Debug, Clone, Default)]
pub struct Tile {
    /// Places of vertices, about the tileset's middle.
    pub places: Vec<[f32; 3]>,
    /// Their normals, of length one.
    pub normals: Vec<[f32; 3]>,
    /// Their attributes: records of the mesh's schema.
    pub records: Vec<u8>,
    /// Triangles of the numbers of these vertices.
    pub faces: Vec<[u32; 3]>,
    /// Triangles beside its own: others near it, and those of the skirt.
    pub overlap: Vec<[u32; 3]>,
}

impl Tile {
    /// Smallest and largest coordinates of its vertices.
    pub fn bounds(&self) -> [[f32; 3]; 2] {
        let none = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
        self.places.iter().fold(none, |[low, high], place| {
            [[0, 1, 2].map(|a| low[a].min(place[a])), [0, 1, 2].map(|a| high[a].max(place[a]))]
        })
    }

    /// Hangs a skirt of this depth from the edges of all triangles; `stride` is the bytes of a record.
    pub fn hang_skirt(&mut self, depth: f32, stride: usize) {
        let sides = |face: &[u32; 3]| [[face[0], face[1]], [face[1], face[2]], [face[2], face[0]]];
        let all = || self.faces.iter().chain(&self.overlap).flat_map(sides);
        let directed: FxHashSet<[u32; 2]> = all().collect();
        // Never visited in the set's order.
        let edges: Vec<[u32; 2]> = all().filter(|[a, b]| !directed.contains(&[*b, *a])).collect();
        let mut lowered = FxHashMap::default();
        for edge in edges {
            let [low_a, low_b] = edge.map(|v| {
                *lowered.entry(v).or_insert_with(|| {
                    let [x, y, z] = self.places[v as usize];
                    self.places.push([x, y, z - depth]);
                    self.normals.push(self.normals[v as usize]);
                    let record = v as usize * stride;
                    self.records.extend_from_within(record..record + stride);
                    self.places.len() as u32 - 1
                })
            });
            let [a, b] = edge;
            self.overlap.extend([[b, a, low_a], [b, low_a, low_b]]);
        }
    }

    /// Puts its vertices on a lattice.
    pub(crate) fn snap(&mut self, lattice: &Lattice) {
        for place in &mut self.places {
            *place = lattice.place(lattice.numbers(*place)).map(|c| c as f32);
        }
    }

    /// Puts triangles and vertices in an order that is encoded in few bytes; `stride` is the bytes of a record.
    pub(crate) fn put_in_order(&mut self, stride: usize) {
        let order = ordered(&mut self.faces, &mut self.overlap, self.places.len());
        let records = &self.records;
        let moved = order.iter().flat_map(|v| &records[*v as usize * stride..(*v as usize + 1) * stride]);
        self.records = moved.copied().collect();
        self.places = order.iter().map(|v| self.places[*v as usize]).collect();
        self.normals = order.iter().map(|v| self.normals[*v as usize]).collect();
    }

    /// The tile as a GLB file. `sheet` tells whether it is seen from both sides. With a lattice, its vertices lie on it.
    pub(crate) fn glb(&self, views: &[View], stride: usize, sheet: bool, packing: &Packing) -> Vec<u8> {
        let vertices = self.places.len();
        let mut parts = Parts { encoded: packing.encoded, ..Parts::default() };
        let mut attributes = json!({});
        let [low, high] = self.bounds();
        let floats =
            |values: &[[f32; 3]]| -> Vec<u8> { values.as_flattened().iter().flat_map(|c| c.to_le_bytes()).collect() };
        let mut nodes = vec![json!({ "mesh": 0, "rotation": Z_UP_TO_Y_UP })];
        let mut extensions: Vec<&str> = Vec::new();
        match &packing.lattice {
            None => {
                attributes["POSITION"] = json!(parts.put_vertices(
                    &floats(&self.places),
                    None,
                    json!({ "componentType": FLOAT, "count": vertices, "type": "VEC3", "min": low, "max": high }),
                ));
                attributes["NORMAL"] = json!(parts.put_vertices(
                    &floats(&self.normals),
                    None,
                    json!({ "componentType": FLOAT, "count": vertices, "type": "VEC3" }),
                ));
            }
            Some(lattice) => {
                extensions.push("KHR_mesh_quantization");
                let corner = lattice.numbers(low);
                let numbers = |place: [f32; 3]| {
                    let numbers = lattice.numbers(place);
                    [0, 1, 2].map(|a| (numbers[a] - corner[a]) as u16)
                };
                let places = self.places.iter().map(|place| numbers(*place));
                // Padded to a multiple of four, as vertex data has to be.
                let bytes: Vec<u8> =
                    places.flat_map(|[x, y, z]| [x, y, z, 0]).flat_map(|number| number.to_le_bytes()).collect();
                let (min, max) = (numbers(low), numbers(high));
                let accessor = json!({ "componentType": UNSIGNED_SHORT, "count": vertices, "type": "VEC3", "min": min, "max": max });
                attributes["POSITION"] = json!(parts.put_vertices(&bytes, Some(8), accessor));
                let eighth = |c: &f32| (c * 127.0).round() as i8;
                let bytes: Vec<u8> = self
                    .normals
                    .iter()
                    .flat_map(|[x, y, z]| [eighth(x), eighth(y), eighth(z), 0])
                    .map(|n| n as u8)
                    .collect();
                let accessor = json!({ "componentType": BYTE, "normalized": true, "count": vertices, "type": "VEC3" });
                attributes["NORMAL"] = json!(parts.put_vertices(&bytes, Some(4), accessor));
                let scale = [lattice.step; 3];
                // The shift stands in the tileset's own axes, where it is a multiple of the lattice's step.
                nodes = vec![
                    json!({ "children": [1], "rotation": Z_UP_TO_Y_UP }),
                    json!({ "mesh": 0, "translation": lattice.place(corner), "scale": scale }),
                ];
            }
        }
        for view in views {
            let mut bytes = Vec::with_capacity(vertices * view.bytes as usize);
            self.records.chunks_exact(stride).for_each(|record| view.put(record, &mut bytes));
            let mut accessor = json!({ "componentType": component(view.scalar), "count": vertices, "type": view.kind });
            if view.kind == "VEC4" {
                accessor["normalized"] = json!(true);
            }
            attributes[&view.name] = json!(parts.put_vertices(&bytes, Some(view.bytes), accessor));
        }
        let mut primitives = Vec::new();
        for faces in [&self.faces, &self.overlap].into_iter().filter(|faces| !faces.is_empty()) {
            let indices = parts.put_triangles(faces, vertices);
            primitives.push(json!({ "attributes": attributes, "indices": indices, "material": 0, "mode": TRIANGLES }));
        }
        let mut buffers = vec![json!({ "byteLength": parts.binary.len() })];
        if packing.encoded {
            extensions.push(MESHOPT);
            buffers.push(json!({ "byteLength": parts.decoded, "extensions": { MESHOPT: { "fallback": true } } }));
        }
        let mut scene = json!({
            "asset": { "version": "2.0", "generator": concat!("asra-stream ", env!("CARGO_PKG_VERSION")) },
            "scene": 0,
            "scenes": [{ "nodes": [0] }],
            "nodes": nodes,
            "meshes": [{ "primitives": primitives }],
            "materials": [{ "pbrMetallicRoughness": { "metallicFactor": 0 }, "doubleSided": sheet }],
            "accessors": parts.accessors,
            "bufferViews": parts.views,
            "buffers": buffers,
        });
        if !extensions.is_empty() {
            scene["extensionsUsed"] = json!(extensions);
            scene["extensionsRequired"] = json!(extensions);
        }
        let binary = parts.binary;
        let mut text = scene.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut out = Vec::with_capacity(28 + text.len() + binary.len());
        out.extend_from_slice(b"glTF");
        for word in [2, (28 + text.len() + binary.len()) as u32, text.len() as u32] {
            out.extend_from_slice(&word.to_le_bytes());
        }
        out.extend_from_slice(b"JSON");
        out.extend_from_slice(&text);
        out.extend_from_slice(&(binary.len() as u32).to_le_bytes());
        out.extend_from_slice(b"BIN\0");
        out.extend_from_slice(&binary);
        out
    }
}

/// How a tile is written.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Packing {
    /// What its vertices lie on, if they are to be numbers of 16 bits.
    pub(crate) lattice: Option<Lattice>,
    /// Whether its data are encoded as meshoptimizer does; they are on a lattice then.
    pub(crate) encoded: bool,
}

/// The parts of a file in the making.
#[derive(Debug, Default)]
struct Parts {
    encoded: bool,
    binary: Vec<u8>,
    /// Bytes of the data that are encoded.
    decoded: usize,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Parts {
    /// Adds data of vertices, with `stride` bytes each if that is to be told, and gives the accessor's number.
    fn put_vertices(&mut self, bytes: &[u8], stride: Option<u64>, accessor: Value) -> usize {
        let encoded = stride.filter(|_| self.encoded);
        let encoded = encoded.map(|stride| (encoded_vertices(bytes, stride as usize), stride, "ATTRIBUTES"));
        self.put(bytes, encoded, stride, ARRAY_BUFFER, accessor)
    }

    /// Adds triangles, and gives the accessor's number.
    fn put_triangles(&mut self, faces: &[[u32; 3]], vertices: usize) -> usize {
        let numbers = faces.as_flattened().iter();
        let (bytes, kind, size): (Vec<u8>, u32, u64) = match vertices as u64 <= MOST_SHORT {
            true => (numbers.flat_map(|v| (*v as u16).to_le_bytes()).collect(), UNSIGNED_SHORT, 2),
            false => (numbers.flat_map(|v| v.to_le_bytes()).collect(), UNSIGNED_INT, 4),
        };
        let encoded = self.encoded.then(|| (encoded_triangles(faces, vertices), size, "TRIANGLES"));
        let accessor = json!({ "componentType": kind, "count": 3 * faces.len(), "type": "SCALAR" });
        self.put(&bytes, encoded, None, ELEMENT_ARRAY_BUFFER, accessor)
    }

    fn put(
        &mut self,
        bytes: &[u8],
        encoded: Option<(Vec<u8>, u64, &str)>,
        stride: Option<u64>,
        target: u32,
        mut accessor: Value,
    ) -> usize {
        let (at, written) = (self.binary.len(), encoded.as_ref().map_or(bytes, |(encoded, ..)| encoded));
        self.binary.extend_from_slice(written);
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let mut view = match &encoded {
            None => json!({ "buffer": 0, "byteOffset": at, "byteLength": bytes.len(), "target": target }),
            Some((encoded, size, mode)) => {
                let count = accessor["count"].as_u64();
                let told = json!({ "buffer": 0, "byteOffset": at, "byteLength": encoded.len(), "byteStride": size, "count": count, "mode": mode });
                let place = self.decoded;
                self.decoded = (self.decoded + bytes.len()).next_multiple_of(4);
                json!({ "buffer": 1, "byteOffset": place, "byteLength": bytes.len(), "target": target, "extensions": { MESHOPT: told } })
            }
        };
        if let Some(stride) = stride {
            view["byteStride"] = json!(stride);
        }
        accessor["bufferView"] = json!(self.views.len());
        self.views.push(view);
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_skirt_hangs_from_every_edge_of_one_triangle_and_from_no_other() {
        let places = vec![[0.0, 0.0, 5.0], [1.0, 0.0, 5.0], [1.0, 1.0, 6.0], [0.0, 1.0, 6.0]];
        let mut tile = Tile {
            normals: vec![[0.0, 0.0, 1.0]; 4],
            records: vec![1, 2, 3, 4],
            faces: vec![[0, 1, 2], [0, 2, 3]],
            places,
            overlap: Vec::new(),
        };
        tile.hang_skirt(2.0, 1);
        assert_eq!((tile.places.len(), tile.overlap.len()), (8, 8));
        assert_eq!(tile.records, [1, 2, 3, 4, 1, 2, 3, 4]);
        assert!(tile.places[4..].iter().all(|place| place[2] == 3.0 || place[2] == 4.0));
        // With the skirt, every edge of the square has a triangle on its other side.
        let sides = |face: &[u32; 3]| [[face[0], face[1]], [face[1], face[2]], [face[2], face[0]]];
        let skirt: Vec<[u32; 2]> = tile.overlap.iter().flat_map(sides).collect();
        for [a, b] in [[0, 1], [1, 2], [2, 3], [3, 0]] {
            assert!(skirt.contains(&[b, a]) && !skirt.contains(&[a, b]));
        }
        assert!(!skirt.contains(&[0, 2]) && !skirt.contains(&[2, 0]));
    }
}
