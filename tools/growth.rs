//! What a sphere of 10^6 to 10^12 points would take at k = 4, by the plan's own figures: `cargo run --release --example growth`.
//!
//! Least memory is that of two threads; disk is what there is at a time when nothing is kept in memory.

use asra_stream::internals::grid::partition::{slab_count, slices_of};
use asra_stream::internals::points::Precision;
use asra_stream::internals::resources::memory::MemoryPlan;
use asra_stream::internals::run::workload::Workload;
use asra_stream::internals::stitch::VERTEX_LIMIT;
use bytesize::ByteSize;

const SMOOTH: u32 = 1;

/// The workload of a sphere of `points` points: planes at all slopes pass 1.5 cells for each of their squares on average, and a slice of a sphere has as much
/// of its area as any other.
fn sphere(points: u64) -> Workload {
    let slices = (4.0 * (points as f64).cbrt()).floor() as u32;
    let of_slice = 1.5 * std::f64::consts::PI * f64::from(slices);
    let slab = |number| (slices_of(number, SMOOTH, slices).len() as f64 * of_slice) as u64;
    let workload = Workload::in_cells(points, Precision::Single, [slices; 3], SMOOTH);
    workload.with_faces((0..slab_count(SMOOTH, slices)).map(slab).collect(), false)
}

fn main() {
    println!(
        "| points | slices | triangles | input | least memory | temporary disk, of the input | vertices, of the limit |"
    );
    println!("|--:|--:|--:|--:|--:|--:|--:|");
    for exponent in 6..=12 {
        let workload = sphere(10u64.pow(exponent));
        let (input, least) = (workload.bucket_bytes(), MemoryPlan::least(&workload, 2));
        println!(
            "| 10^{exponent} | {} | {:.2e} | {} | {} | {}, {:.2} | {:.3} |",
            workload.cells[1],
            workload.triangles() as f64,
            ByteSize(input),
            ByteSize(least),
            ByteSize(workload.disk()),
            workload.disk() as f64 / input as f64,
            workload.vertices() as f64 / VERTEX_LIMIT as f64
        );
    }
}
