//! The naive twin of reading the mesh that is given: each triangle's corners are looked up by themselves.

use super::super::mark::{Blend, Colours, Mark, Marks};
use super::super::reading::{Reading, Wanted, blocks, far_bytes};
use super::super::soup::Record;
use super::*;
use crate::mesh::measure::is_degenerate;

/// A mesh whose triangles name vertices anywhere, some of them twice.
fn scattered(vertices: u32, triangles: usize, seed: u64) -> Mesh {
    let number = |i: usize| ((random(seed, i as u64) + 1.0) / 2.0 * f64::from(vertices)) as u32;
    let byte = |i: u32, channel: u64| (random(seed ^ (channel << 40), u64::from(i)) * 128.0 + 128.0) as u8;
    Mesh {
        vertices: (0..vertices).map(|i| [f64::from(i), 0.25 * f64::from(i), -1.0]).collect(),
        classes: (0..vertices).map(|i| byte(i, 4)).collect(),
        colours: (0..vertices).map(|i| [1, 2, 3].map(|channel| byte(i, channel))).collect(),
        triangles: (0..triangles).map(|t| [3 * t, 3 * t + 1, 3 * t + t % 3].map(number)).collect(),
    }
}

fn is_read_as_it_is<M: Mark>(mesh: &Mesh, coloured: bool, memory: u64) {
    let dir = tempfile::tempdir().unwrap();
    let (workspace, workers) = (Workspace::new(dir.path()).unwrap(), Workers::new(2).unwrap());
    let spool = mesh.spool(Precision::Double, &workspace);
    let colours = coloured.then(|| Colours::of(&spool).unwrap());
    let wanted = Wanted { classes: Some(0), colours };
    let reading = Reading { mesh: &spool, wanted, workers: &workers, workspace: &workspace, memory };
    let mut read: Vec<Record<f64, M>> = Vec::new();
    reading
        .for_each(0..blocks(&spool), |records| {
            read.extend_from_slice(records);
            Ok(())
        })
        .unwrap();
    let record = |t: &[u32; 3]| {
        let of = |v: u32| v as usize;
        let colour = |v: u32| if coloured { mesh.colours[of(v)].map(f32::from) } else { [0.0; 3] };
        let marks = Marks { corners: t.map(|v| Blend::of(v, colour(v))), ..Marks::default() };
        let classes = t.map(|v| u16::from(mesh.classes[of(v)]));
        Record::<f64, M>::new(*t, classes, t.map(|v| mesh.vertices[of(v)]), Drift::NONE, marks)
    };
    let expected: Vec<Record<f64, M>> = mesh.triangles.iter().filter(|t| !is_degenerate(**t)).map(record).collect();
    assert_eq!(bytemuck::cast_slice::<_, u8>(&read), bytemuck::cast_slice::<_, u8>(&expected));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    /// Near and far, in one go or in two sorts.
    #[test]
    fn triangles_come_with_what_their_corners_have(
        vertices in 1u32..30_000,
        triangles in 0usize..12_000,
        coloured: bool,
        much: bool,
        seed: u64,
    ) {
        let mesh = scattered(vertices, triangles, seed);
        let memory = if much { 64 << 20 } else { far_bytes(triangles as u64) };
        is_read_as_it_is::<Marks>(&mesh, coloured, memory);
        is_read_as_it_is::<()>(&mesh, false, memory);
    }
}
