//! Tiles in fewer bytes: places on a lattice (`KHR_mesh_quantization`), and streams as meshoptimizer encodes them (`EXT_meshopt_compression`).
//!
//! All tiles of a level are on one lattice, whose step is a power of two and whose numbers single precision holds exactly. So a vertex that two tiles share is
//! the same place in both, to the last bit, though each tile counts steps from a corner of its own.

use meshopt_rs::index::IndexEncodingVersion;
use meshopt_rs::index::buffer::{encode_index_buffer, encode_index_buffer_bound};
use meshopt_rs::vertex::VertexEncodingVersion;
use meshopt_rs::vertex::buffer::{encode_vertex_buffer, encode_vertex_buffer_bound};
use meshopt_rs::vertex::cache::optimize_vertex_cache_fifo;

/// Steps along the longest side of a tile: as many as 16 bits count, but for some that roundings and skirts may need.
const STEPS: f64 = 65_528.0;
/// Bits of a number in single precision, but for the first, which is a place's sign here.
const DIGITS: i32 = 23;
/// The vertices that are thought of as read already when triangles are put in order.
const NEAR: u32 = 16;

/// A lattice of places.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lattice {
    /// From one place to the next along each axis: a power of two.
    pub step: f64,
}

impl Lattice {
    /// The finest on which a side of `longest` fits in 16 bits and places up to `farthest` in single precision, but no finer than `finer`.
    pub fn of(longest: f64, farthest: f64, finer: Option<Lattice>) -> Lattice {
        let above = |least: f64| {
            let (_, exponent) = libm::frexp(least.max(f64::from(f32::MIN_POSITIVE)));
            exponent
        };
        let exponent = above(longest / STEPS).max(above(farthest) - DIGITS);
        let step = libm::ldexp(1.0, exponent);
        Lattice { step: finer.map_or(step, |finer| step.max(finer.step)) }
    }

    /// No place is moved farther than this.
    pub fn off(&self) -> f64 {
        // Half a step along each axis, rounded up.
        self.step * 0.866_025_403_784_438_7
    }

    /// The numbers of a place.
    pub fn numbers(&self, place: [f32; 3]) -> [i64; 3] {
        place.map(|c| (f64::from(c) / self.step).round() as i64)
    }

    /// The place with these numbers.
    pub fn place(&self, numbers: [i64; 3]) -> [f64; 3] {
        numbers.map(|n| n as f64 * self.step)
    }
}

/// Triangles in an order in which one shares vertices with those before it, and the order of vertices as they come, those of `overlap` alone last. The numbers of `overlap` follow.
pub(crate) fn ordered(faces: &mut Vec<[u32; 3]>, overlap: &mut [[u32; 3]], vertices: usize) -> Vec<u32> {
    let mut found = vec![[0u32; 3]; faces.len()];
    optimize_vertex_cache_fifo(bytemuck::cast_slice_mut(&mut found), faces.as_flattened(), vertices, NEAR);
    *faces = found;
    let mut order = Vec::with_capacity(vertices);
    let mut numbers = vec![u32::MAX; vertices];
    for v in faces.as_flattened_mut().iter_mut().chain(overlap.as_flattened_mut()) {
        let number = &mut numbers[*v as usize];
        if *number == u32::MAX {
            *number = order.len() as u32;
            order.push(*v);
        }
        *v = *number;
    }
    order
}

/// Vertex data of `stride` bytes, 4 or 8, encoded.
pub(crate) fn encoded_vertices(bytes: &[u8], stride: usize) -> Vec<u8> {
    match stride {
        4 => encoded::<4>(bytes),
        8 => encoded::<8>(bytes),
        _ => unreachable!("data of a vertex has 4 or 8 bytes"),
    }
}

fn encoded<const N: usize>(bytes: &[u8]) -> Vec<u8> {
    let (vertices, _) = bytes.as_chunks::<N>();
    let mut out = vec![0; encode_vertex_buffer_bound(vertices.len(), N)];
    let length = encode_vertex_buffer(&mut out, vertices, VertexEncodingVersion::V0);
    out.truncate(length.expect("there is as much room as it says to need"));
    out
}

/// Triangles, encoded. Each may come back from another corner on.
pub(crate) fn encoded_triangles(faces: &[[u32; 3]], vertices: usize) -> Vec<u8> {
    let mut out = vec![0; encode_index_buffer_bound(3 * faces.len(), vertices)];
    let length = encode_index_buffer(&mut out, faces.as_flattened(), IndexEncodingVersion::V1);
    out.truncate(length.expect("there is as much room as it says to need"));
    out
}

#[cfg(test)]
mod tests {
    use meshopt_rs::index::buffer::decode_index_buffer;
    use meshopt_rs::vertex::buffer::decode_vertex_buffer;
    use proptest::prelude::*;

    use super::*;

    fn turned(mut face: [u32; 3]) -> [u32; 3] {
        let least = (0..3).min_by_key(|i| face[*i]).unwrap();
        face.rotate_left(least);
        face
    }

    #[test]
    fn a_lattice_is_as_fine_as_numbers_allow() {
        for (longest, farthest) in [(100.0, 50.0), (128.0, 5e6), (1e-3, 1e-3), (0.0, 0.0), (65_528.0, 65_528.0)] {
            let lattice = Lattice::of(longest, farthest, None);
            assert!(longest / lattice.step <= STEPS && farthest / lattice.step <= f64::from(1 << DIGITS));
            let finer = lattice.step / 2.0;
            assert!(
                longest < 1e-9 || longest / finer >= STEPS || farthest / finer >= f64::from(1 << DIGITS),
                "{longest}"
            );
            assert_eq!(Lattice::of(longest, farthest, Some(Lattice { step: 1e9 })).step, 1e9);
        }
    }

    proptest! {
        #[test]
        fn places_move_by_no_more_than_told_and_are_exact_in_single_precision(place in prop::array::uniform3(-5e4f32..5e4), longest in 1e-3f64..1e4) {
            let lattice = Lattice::of(longest, 5e4, None);
            let found = lattice.place(lattice.numbers(place));
            let off = (0..3).map(|a| (found[a] - f64::from(place[a])).powi(2)).sum::<f64>().sqrt();
            prop_assert!(off <= lattice.off());
            prop_assert!(found.iter().all(|c| f64::from(*c as f32) == *c));
        }

        #[test]
        fn streams_come_back_as_they_were(
            bytes in prop::collection::vec(any::<u8>(), 0..4000),
            mut faces in prop::collection::vec(prop::array::uniform3(0u32..300), 1..700),
        ) {
            // Tiles have none that repeat a vertex.
            faces.retain(|[a, b, c]| a != b && b != c && c != a);
            let vertices = bytes.len() / 8;
            let mut back = vec![[0u8; 8]; vertices];
            decode_vertex_buffer(&mut back, &encoded_vertices(&bytes[..8 * vertices], 8)).unwrap();
            prop_assert_eq!(back.as_flattened(), &bytes[..8 * vertices]);
            let vertices = bytes.len() / 4;
            let mut back = vec![[0u8; 4]; vertices];
            decode_vertex_buffer(&mut back, &encoded_vertices(&bytes[..4 * vertices], 4)).unwrap();
            prop_assert_eq!(back.as_flattened(), &bytes[..4 * vertices]);
            let mut back = vec![0u32; 3 * faces.len()];
            decode_index_buffer(&mut back, &encoded_triangles(&faces, 300)).unwrap();
            let back: Vec<[u32; 3]> = back.chunks_exact(3).map(|t| turned([t[0], t[1], t[2]])).collect();
            prop_assert_eq!(back, faces.into_iter().map(turned).collect::<Vec<_>>());
        }

        #[test]
        fn an_order_keeps_every_triangle_and_vertex(mut faces in prop::collection::vec(prop::array::uniform3(0u32..90), 1..300)) {
            faces.retain(|[a, b, c]| a != b && b != c && c != a);
            let mut used: Vec<u32> = faces.iter().flatten().copied().collect();
            used.sort_unstable();
            used.dedup();
            let number = |v: u32| used.partition_point(|u| *u < v) as u32;
            let (faces, overlap) = faces.split_at(faces.len() / 2);
            let (mut faces, mut overlap): (Vec<_>, Vec<_>) = (faces.iter().map(|f| f.map(number)).collect(), overlap.iter().map(|f| f.map(number)).collect());
            let before: (Vec<[u32; 3]>, Vec<[u32; 3]>) = (faces.clone(), overlap.clone());
            let order = ordered(&mut faces, &mut overlap, used.len());
            let sorted = |faces: &[[u32; 3]]| {
                let mut faces: Vec<[u32; 3]> = faces.iter().map(|f| turned(*f)).collect();
                faces.sort_unstable();
                faces
            };
            let back = |faces: &[[u32; 3]]| faces.iter().map(|f| f.map(|v| order[v as usize])).collect::<Vec<_>>();
            prop_assert_eq!(sorted(&back(&faces)), sorted(&before.0));
            prop_assert_eq!(back(&overlap), before.1);
            prop_assert_eq!(order.len(), used.len());
        }
    }
}
