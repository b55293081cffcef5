//! Time and memory of the mesh check and of the search for intersections: a torus of about 11 million triangles, row by
//! row as a reconstruction writes them, and with vertices and triangles in random order.
//!
//! `cargo bench --bench mesh_check [-- ROWS COLUMNS]`; 2000 x 2750 quadrilaterals by default. Memory is the rise of the
//! process's peak during the check; the mesh itself lies on disk.

use std::time::Instant;

use asra_stream::internals::mesh::check::{check, intersections};
use asra_stream::internals::mesh::spool::{FaceRecord, MeshSpool};
use asra_stream::internals::points::Precision;
use asra_stream::internals::resources::workers::Workers;
use asra_stream::internals::storage::spool::Workspace;
use rand::SeedableRng;
use rand::seq::SliceRandom;

fn main() {
    let sizes: Vec<u32> = std::env::args().skip(1).filter_map(|a| a.parse().ok()).collect();
    let (m, n) = if let [m, n] = sizes[..] { (m, n) } else { (2000, 2750) };
    let dir = tempfile::tempdir().expect("a folder for temporary files");
    let workspace = Workspace::new(dir.path()).expect("a folder for temporary files");
    for (name, shuffled) in [("row by row", false), ("random order", true)] {
        let mesh = torus(m, n, shuffled, &workspace);
        for megabytes in [64, 1024] {
            for threads in [1, 2] {
                let workers = Workers::new(threads).expect("threads");
                let before = reset_peak();
                let start = Instant::now();
                let report = check(&mesh, megabytes << 20, &workers, &workspace, &mut |_| ()).expect("a sound mesh");
                let seconds = start.elapsed().as_secs_f64();
                assert!(report.is_closed_oriented_manifold() && report.genus == Some(1), "{report}");
                println!(
                    "{name:<13} {:>9} triangles, {threads} threads, budget {megabytes:>4} MiB: {seconds:6.2} s, {:5.1} M triangles/s, peak {:4} MiB",
                    report.triangles,
                    report.triangles as f64 / seconds / 1e6,
                    (peak() - before) >> 10
                );

                let before = reset_peak();
                let start = Instant::now();
                let found =
                    intersections(&mesh, megabytes << 20, &workers, &workspace, &mut |_| ()).expect("a sound mesh");
                let seconds = start.elapsed().as_secs_f64();
                assert!(found.none(), "{found:?}");
                println!(
                    "{:<13} {:>9} triangles, {threads} threads, budget {megabytes:>4} MiB: {seconds:6.2} s, {:5.2} us a triangle, peak {:4} MiB",
                    "intersections",
                    report.triangles,
                    seconds * 1e6 / report.triangles as f64,
                    (peak() - before) >> 10
                );
            }
        }
    }
}

fn torus(m: u32, n: u32, shuffled: bool, workspace: &Workspace) -> MeshSpool {
    let mut vertices: Vec<u32> = (0..m * n).collect();
    let mut faces = Vec::new();
    let mut mesh = MeshSpool::new(workspace, Precision::Single, 0);
    if shuffled {
        vertices.shuffle(&mut rand_chacha::ChaCha8Rng::seed_from_u64(1));
    }
    let angle = |i: u32, of: u32| f64::from(i) / f64::from(of) * std::f64::consts::TAU;
    let mut positions = vec![[0.0; 3]; vertices.len()];
    for i in 0..m {
        for j in 0..n {
            let at = |i: u32, j: u32| vertices[(i % m * n + j % n) as usize];
            let ((s, c), (t, d)) = (angle(i, m).sin_cos(), angle(j, n).sin_cos());
            positions[at(i, j) as usize] = [(3.0 + d) * c, (3.0 + d) * s, t];
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            faces.extend([FaceRecord::new([a, b, c]), FaceRecord::new([a, c, d])]);
        }
    }
    if shuffled {
        faces.shuffle(&mut rand_chacha::ChaCha8Rng::seed_from_u64(2));
    }
    mesh.append_vertices(&positions).expect("room on disk");
    mesh.append_faces(&faces).expect("room on disk");
    mesh
}

/// Makes the kernel forget the peak so far, where it can; returns the memory in use, in KiB.
fn reset_peak() -> u64 {
    let _ = std::fs::write("/proc/self/clear_refs", "5");
    status("VmRSS")
}

fn peak() -> u64 {
    status("VmHWM")
}

fn status(key: &str) -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with(key));
    line.and_then(|l| l.split_whitespace().nth(1)).and_then(|n| n.parse().ok()).unwrap_or(0)
}
