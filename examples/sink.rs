//! A mesh handed on piece by piece, without a copy of the whole: a `MeshSink` that sums up area and volume. `cargo run --release --example sink`.

use asra_stream::{Mesh, MeshSink, Reconstruction, Result};

/// Keeps positions in single precision, and forgets triangles once they are counted.
#[derive(Default)]
struct Measure {
    positions: Vec<[f32; 3]>,
    area: f64,
    volume: f64,
}

impl MeshSink for Measure {
    fn begin(&mut self, mesh: &Mesh) -> Result<()> {
        self.positions.reserve_exact(mesh.vertex_count());
        Ok(())
    }

    fn vertices(&mut self, positions: &[[f64; 3]]) -> Result<()> {
        self.positions.extend(positions.iter().map(|p| p.map(|c| c as f32)));
        Ok(())
    }

    fn triangles(&mut self, triangles: &[[u32; 3]]) -> Result<()> {
        for triangle in triangles {
            let [a, b, c] = triangle.map(|v| self.positions[v as usize].map(f64::from));
            let (ab, ac) = (minus(b, a), minus(c, a));
            let normal = [ab[1] * ac[2] - ab[2] * ac[1], ab[2] * ac[0] - ab[0] * ac[2], ab[0] * ac[1] - ab[1] * ac[0]];
            self.area += dot(normal, normal).sqrt() / 2.0;
            self.volume += dot(a, normal) / 6.0;
        }
        Ok(())
    }
}

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Measures a ball without holding its triangles.
pub fn main() -> Result<()> {
    let mut measure = Measure::default();
    let report = Reconstruction::of(&ball(100_000)).run_into(&mut measure)?;
    println!("{} triangles, area {:.3}, volume {:.3}", report.output.triangles, measure.area, measure.volume);
    // Those of the unit ball are 4π and 4π/3. Triangles lie a little inside.
    assert!((12.2..12.6).contains(&measure.area) && (4.1..4.2).contains(&measure.volume));
    Ok(())
}

/// Points spread evenly over the unit sphere.
fn ball(count: usize) -> Vec<[f64; 3]> {
    (0..count)
        .map(|i| {
            let z = (2.0 * i as f64 + 1.0) / count as f64 - 1.0;
            let (r, angle) = ((1.0 - z * z).sqrt(), 2.3999632297 * i as f64);
            [r * angle.cos(), r * angle.sin(), z]
        })
        .collect()
}
