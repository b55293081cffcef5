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
//! It hides gaps to tiles of other levels. Its triangles are a second primitive, over the same vertices and their lowered copies.

use rustc_hash::{FxHashMap, FxHashSet};
use serde_json::{Value, json};

use crate::format::glb::write::{
    ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, FLOAT, MOST_SHORT, TRIANGLES, UNSIGNED_INT, UNSIGNED_SHORT, View, Z_UP_TO_Y_UP,
    component,
};

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
    /// The triangles of the skirt.
    pub skirt: Vec<[u32; 3]>,
}

impl Tile {
    /// Smallest and largest coordinates of its vertices.
    pub fn bounds(&self) -> [[f32; 3]; 2] {
        let none = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
        self.places.iter().fold(none, |[low, high], place| {
            [[0, 1, 2].map(|a| low[a].min(place[a])), [0, 1, 2].map(|a| high[a].max(place[a]))]
        })
    }

    /// Hangs a skirt of this depth from the tile's edges; `stride` is the bytes of a record.
    pub fn hang_skirt(&mut self, depth: f32, stride: usize) {
        let sides = |face: &[u32; 3]| [[face[0], face[1]], [face[1], face[2]], [face[2], face[0]]];
        let directed: FxHashSet<[u32; 2]> = self.faces.iter().flat_map(sides).collect();
        // Never visited in the set's order.
        let edges: Vec<[u32; 2]> =
            self.faces.iter().flat_map(sides).filter(|[a, b]| !directed.contains(&[*b, *a])).collect();
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
            self.skirt.extend([[b, a, low_a], [b, low_a, low_b]]);
        }
    }

    /// The tile as a GLB file. `sheet` tells whether it is seen from both sides.
    pub(crate) fn glb(&self, views: &[View], stride: usize, sheet: bool) -> Vec<u8> {
        let vertices = self.places.len();
        let mut binary = Vec::new();
        let (mut accessors, mut buffer_views) = (Vec::new(), Vec::new());
        let mut attributes = json!({});
        let mut put = |bytes: &[u8], stride: Option<u64>, target: u32, mut accessor: Value| {
            let mut view =
                json!({ "buffer": 0, "byteOffset": binary.len(), "byteLength": bytes.len(), "target": target });
            if let Some(stride) = stride {
                view["byteStride"] = json!(stride);
            }
            accessor["bufferView"] = json!(buffer_views.len());
            buffer_views.push(view);
            accessors.push(accessor);
            binary.extend_from_slice(bytes);
            binary.resize(binary.len().next_multiple_of(4), 0);
            accessors.len() - 1
        };
        let floats =
            |values: &[[f32; 3]]| -> Vec<u8> { values.as_flattened().iter().flat_map(|c| c.to_le_bytes()).collect() };
        let [low, high] = self.bounds();
        attributes["POSITION"] = json!(put(
            &floats(&self.places),
            None,
            ARRAY_BUFFER,
            json!({ "componentType": FLOAT, "count": vertices, "type": "VEC3", "min": low, "max": high }),
        ));
        attributes["NORMAL"] = json!(put(
            &floats(&self.normals),
            None,
            ARRAY_BUFFER,
            json!({ "componentType": FLOAT, "count": vertices, "type": "VEC3" }),
        ));
        for view in views {
            let mut bytes = Vec::with_capacity(vertices * view.bytes as usize);
            self.records.chunks_exact(stride).for_each(|record| view.put(record, &mut bytes));
            let mut accessor = json!({ "componentType": component(view.scalar), "count": vertices, "type": view.kind });
            if view.kind == "VEC4" {
                accessor["normalized"] = json!(true);
            }
            attributes[&view.name] = json!(put(&bytes, Some(view.bytes), ARRAY_BUFFER, accessor));
        }
        let short = vertices as u64 <= MOST_SHORT;
        let mut primitives = Vec::new();
        for faces in [&self.faces, &self.skirt].into_iter().filter(|faces| !faces.is_empty()) {
            let numbers = faces.as_flattened().iter();
            let (bytes, kind): (Vec<u8>, u32) = match short {
                true => (numbers.flat_map(|v| (*v as u16).to_le_bytes()).collect(), UNSIGNED_SHORT),
                false => (numbers.flat_map(|v| v.to_le_bytes()).collect(), UNSIGNED_INT),
            };
            let accessor = json!({ "componentType": kind, "count": 3 * faces.len(), "type": "SCALAR" });
            let indices = put(&bytes, None, ELEMENT_ARRAY_BUFFER, accessor);
            primitives.push(json!({ "attributes": attributes, "indices": indices, "material": 0, "mode": TRIANGLES }));
        }
        let scene = json!({
            "asset": { "version": "2.0", "generator": concat!("asra-stream ", env!("CARGO_PKG_VERSION")) },
            "scene": 0,
            "scenes": [{ "nodes": [0] }],
            "nodes": [{ "mesh": 0, "rotation": Z_UP_TO_Y_UP }],
            "meshes": [{ "primitives": primitives }],
            "materials": [{ "pbrMetallicRoughness": { "metallicFactor": 0 }, "doubleSided": sheet }],
            "accessors": accessors,
            "bufferViews": buffer_views,
            "buffers": [{ "byteLength": binary.len() }],
        });
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
            skirt: Vec::new(),
        };
        tile.hang_skirt(2.0, 1);
        assert_eq!((tile.places.len(), tile.skirt.len()), (8, 8));
        assert_eq!(tile.records, [1, 2, 3, 4, 1, 2, 3, 4]);
        assert!(tile.places[4..].iter().all(|place| place[2] == 3.0 || place[2] == 4.0));
        // With the skirt, every edge of the square has a triangle on its other side.
        let sides = |face: &[u32; 3]| [[face[0], face[1]], [face[1], face[2]], [face[2], face[0]]];
        let skirt: Vec<[u32; 2]> = tile.skirt.iter().flat_map(sides).collect();
        for [a, b] in [[0, 1], [1, 2], [2, 3], [3, 0]] {
            assert!(skirt.contains(&[b, a]) && !skirt.contains(&[a, b]));
        }
        assert!(!skirt.contains(&[0, 2]) && !skirt.contains(&[2, 0]));
    }
}
