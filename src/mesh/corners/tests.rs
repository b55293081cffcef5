//! The naive twin: every corner is looked up by itself.

use std::sync::atomic::{AtomicU64, Ordering};

use proptest::prelude::*;

use super::*;
use crate::points::Precision;
use crate::points::attribute::Schema;

/// Triangles, and the number of vertices, of which nothing is read.
#[derive(Debug)]
struct Named {
    vertices: u64,
    faces: Vec<[u32; 3]>,
    schema: Schema,
}

impl Named {
    fn new(vertices: u64, faces: Vec<[u32; 3]>) -> Named {
        Named { vertices, faces, schema: Schema::default() }
    }
}

impl MeshSource for Named {
    fn vertex_count(&self) -> u64 {
        self.vertices
    }
    fn face_count(&self) -> u64 {
        self.faces.len() as u64
    }
    fn origin(&self) -> [f64; 3] {
        [0.0; 3]
    }
    fn precision(&self) -> Precision {
        Precision::Double
    }
    fn read_vertices(&self, _: u64, _: &mut [[f64; 3]]) -> Result<()> {
        unreachable!("tests read something else of vertices")
    }
    fn read_faces(&self, first: u64, out: &mut [[u32; 3]]) -> Result<()> {
        out.copy_from_slice(&self.faces[first as usize..][..out.len()]);
        Ok(())
    }
    fn schema(&self) -> &Schema {
        &self.schema
    }
    fn read_attribute(&self, _: usize, _: u64, _: &mut [f64]) -> Result<()> {
        unreachable!("tests read something else of vertices")
    }
}

/// What a vertex has, if vertices have two numbers.
fn value(vertex: u64) -> [u32; 2] {
    [vertex as u32, (vertex as u32).wrapping_mul(0x9e37_79b9)]
}

/// What a look-up hands over: of each block its number, whether it is near, its triangles as the mesh has them, and what their corners have.
type Found = Vec<(u64, bool, Vec<[u32; 3]>, Vec<[[u32; 2]; 3]>)>;

/// What is found in an order with means, and how many vertices are read.
fn found(mesh: &Named, order: Order, (block, window, memory): (usize, usize, u64), threads: usize) -> (Found, u64) {
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    let workers = Workers::new(threads).unwrap();
    let lookup =
        Lookup { mesh, workers: &workers, workspace: &workspace, block, window, in_flight: threads + 1, memory };
    let count = AtomicU64::new(0);
    let read = |first: u64, out: &mut [[u32; 2]]| {
        assert!(first + out.len() as u64 <= mesh.vertices);
        count.fetch_add(out.len() as u64, Ordering::Relaxed);
        (first..).zip(out).for_each(|(vertex, out)| *out = value(vertex));
        Ok(())
    };
    let work = |block: &Block<'_, [u32; 2]>| {
        assert_eq!(Some(block.span), span(block.vertices));
        assert_eq!(block.is_near, ((block.span.1 - block.span.0) as usize) < window);
        for (face, local) in block.vertices.iter().zip(block.local) {
            for (a, b) in [(0, 1), (1, 2), (2, 0)] {
                assert_eq!(face[a] == face[b], local[a] == local[b], "{face:?} {local:?}");
            }
        }
        Ok((block.number, block.is_near, block.vertices.to_vec(), block.corners().collect()))
    };
    let mut out = Vec::new();
    let blocks = 0..mesh.face_count().div_ceil(block as u64);
    lookup
        .for_each(blocks, order, &read, work, |found| {
            out.push(found);
            Ok(())
        })
        .unwrap();
    (out, count.into_inner())
}

/// The same, one corner after another.
fn expected(mesh: &Named, order: Order, (block, window): (usize, usize)) -> Found {
    let look = |(number, faces): (usize, &[[u32; 3]])| {
        let (low, high) = span(faces).unwrap();
        let corners = faces.iter().map(|face| face.map(|v| value(u64::from(v)))).collect();
        (number as u64, ((high - low) as usize) < window, faces.to_vec(), corners)
    };
    let mut all: Found = mesh.faces.chunks(block).enumerate().map(look).collect();
    if order == Order::NearFirst {
        all.sort_by_key(|(_, is_near, ..)| !is_near);
    }
    all
}

/// Triangles that name vertices near each other, with some far ones among them, or all over the mesh.
fn mesh() -> impl Strategy<Value = Named> {
    (1u32..3000, 0usize..600, 0u32..=100, any::<u64>()).prop_map(|(vertices, count, share, seed)| {
        let mut state = seed;
        let mut random = |below: u32| {
            state = state.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(0x1405_7b7e_f767_814f);
            ((state >> 33) % u64::from(below)) as u32
        };
        let mut face = |i: usize| {
            let at = (i as u64 * u64::from(vertices) / count as u64) as u32;
            let reach = if random(100) < share { vertices } else { 4 };
            std::array::from_fn(|_| (at + random(reach)) % vertices)
        };
        let faces = (0..count).map(&mut face).collect();
        Named::new(u64::from(vertices), faces)
    })
}

proptest! {
    #[test]
    fn blocks_have_the_corners_of_a_naive_look(
        mesh in mesh(),
        block in 1usize..80,
        window in prop_oneof![Just(0usize), 1usize..100, Just(5000)],
        memory in prop_oneof![Just(0u64), 1u64..30_000, Just(1 << 30)],
        threads in 1usize..4,
    ) {
        for order in [Order::Triangles, Order::NearFirst] {
            let (found, _) = found(&mesh, order, (block, window, memory), threads);
            prop_assert_eq!(found, expected(&mesh, order, (block, window)));
        }
    }
}

#[test]
fn no_vertex_is_read_more_than_once_for_far_blocks() {
    let vertices = 400_000u32;
    // All over the mesh; and all near each other, but for triangles of two blocks, one of which closes a circle.
    let scattered: Vec<_> = (0..50_000u32).map(|i| [i * 8, 399_999 - i * 7, (i * 7919) % vertices]).collect();
    let mut circle: Vec<_> = (0..200_000u32).map(|i| [2 * i, 2 * i + 1, (2 * i + 2) % vertices]).collect();
    circle[100_000] = [5, 200_000, 399_000];
    let jobs = 2 * 1000 * LOOKED_AT_BYTES;
    // All over the first quarter of the vertices.
    let low: Vec<_> = (0..50_000u32).map(|i| [i * 2, 99_999 - i, (i * 7919) % 100_000]).collect();
    // Two sorts; all vertices at once; picked corners, which are few; and two sorts that need not read all vertices.
    for (faces, memory, most) in [
        (scattered.clone(), 0, u64::from(vertices)),
        (scattered.clone(), jobs + 1_000_000, u64::from(vertices)),
        (scattered, 1 << 26, u64::from(vertices)),
        (circle.clone(), 0, 3 * u64::from(vertices)),
        (circle, 1 << 26, u64::from(vertices) + 60_000),
        (low, 0, 101_000),
    ] {
        let mesh = Named::new(u64::from(vertices), faces);
        let (found, read) = found(&mesh, Order::NearFirst, (1000, 3000, memory), 1);
        assert!(found == expected(&mesh, Order::NearFirst, (1000, 3000)), "{memory}");
        assert!(read <= most, "{read} vertices are read with {memory} bytes");
    }
}

#[test]
fn vertices_that_are_not_there_are_told() {
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    let workers = Workers::new(1).unwrap();
    for (window, number) in [(100, 5), (1, 9)] {
        let mesh = Named::new(5, vec![[0, 1, 2], [0, number, 1]]);
        let lookup =
            Lookup { mesh: &mesh, workers: &workers, workspace: &workspace, block: 1, window, in_flight: 1, memory: 0 };
        let read = |_: u64, _: &mut [f64]| Ok(());
        let told = lookup.for_each(0..2, Order::Triangles, &read, |_| Ok(()), Ok).unwrap_err();
        assert!(told.to_string().contains(&format!("triangle 1 names vertices [0, {number}, 1] of 5")), "{told}");
    }
}

#[test]
fn an_error_in_a_far_block_comes_in_its_turn() {
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    let workers = Workers::new(2).unwrap();
    let mesh = Named::new(100, (0..60).map(|i| if i % 7 == 3 { [0, 50, 99] } else { [i, i + 1, i + 2] }).collect());
    let lookup =
        Lookup { mesh: &mesh, workers: &workers, workspace: &workspace, block: 1, window: 10, in_flight: 3, memory: 0 };
    let read = |first: u64, out: &mut [f64]| {
        (first..).zip(out).for_each(|(vertex, out)| *out = vertex as f64);
        Ok(())
    };
    let mut seen = Vec::new();
    let work = |block: &Block<'_, f64>| {
        if block.number == 17 { Err(Error::Usage("block 17".into())) } else { Ok(block.number) }
    };
    let told = lookup.for_each(0..60, Order::Triangles, &read, work, |number| {
        seen.push(number);
        Ok(())
    });
    assert_eq!(told.unwrap_err().to_string(), "block 17");
    assert_eq!(seen, (0..17).collect::<Vec<_>>());
}
