//! Points that a program computes, or keeps in its own way: a `PointSource` with an attribute. `cargo run --release --example source`.

use std::ops::Range;

use asra_stream::{Attribute, PointBuffer, PointSource, Precision, Reconstruction, Result, Scalar};

/// A scan of a wavy floor. It is never in memory as a whole.
struct Waves {
    side: u64,
}

impl Waves {
    fn point(&self, number: u64) -> [f64; 3] {
        let (x, y) = ((number % self.side) as f64, (number / self.side) as f64);
        [x * 0.01, y * 0.01, 0.2 * (x * 0.03).sin() * (y * 0.02).cos()]
    }
}

impl PointSource for Waves {
    fn len(&self) -> u64 {
        self.side * self.side
    }

    fn precision(&self) -> Precision {
        Precision::Double
    }

    fn attributes(&self) -> Vec<Attribute> {
        vec![Attribute::new("intensity", Scalar::U16)]
    }

    // Called from several threads, and two to four times for every point: the same points each time.
    fn read(&self, range: Range<u64>, out: &mut PointBuffer) -> Result<()> {
        for number in range {
            let point = self.point(number);
            out.push(point);
            out.push_attribute(Scalar::U16, 1000.0 * (point[2] + 0.2));
        }
        Ok(())
    }
}

/// Makes terrain of points that are computed, and looks at its attribute.
pub fn main() -> Result<()> {
    let waves = Waves { side: 400 };
    let mesh = Reconstruction::from_source(&waves).terrain().cell_size(0.02).run()?;
    let intensity = mesh.attribute("intensity")?;
    let (low, high) = intensity.iter().fold((f64::MAX, f64::MIN), |(low, high), i| (low.min(*i), high.max(*i)));
    println!("{} triangles, intensity {low} to {high}", mesh.triangle_count());
    assert!(low < 50.0 && high > 350.0, "vertices have their points' intensity");
    Ok(())
}
