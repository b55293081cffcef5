//! From a slice of points to triangles, in ten lines: `cargo run --release --example slice`.

use asra_stream::{Reconstruction, Result};

/// Makes the mesh of a torus, and prints its first triangles.
pub fn main() -> Result<()> {
    let points: Vec<[f32; 3]> = torus(200_000);
    let mesh = Reconstruction::of(&points).run()?;
    let vertices: Vec<[f64; 3]> = mesh.vertices()?;
    for [a, b, c] in mesh.triangles()?.into_iter().take(3) {
        println!("{:?} {:?} {:?}", vertices[a as usize], vertices[b as usize], vertices[c as usize]);
    }
    println!("{} vertices, {} triangles", mesh.vertex_count(), mesh.triangle_count());
    let genus = mesh.report().check.as_ref().and_then(|check| check.genus);
    assert_eq!(genus, Some(1), "a torus has one hole through it");
    Ok(())
}

/// Points spread evenly over a torus, in no order, without normals.
fn torus(count: usize) -> Vec<[f32; 3]> {
    (0..count)
        .map(|i| {
            // Steps of .7549 and .5698 of the circle, of which neither is made of the other: they fill the square of angles evenly.
            let (u, v) = (i as f64 * 4.7430362, i as f64 * 3.5804122);
            let r = 2.0 + 0.7 * v.cos();
            [r * u.cos(), r * u.sin(), 0.7 * v.sin()].map(|c| c as f32)
        })
        .collect()
}
