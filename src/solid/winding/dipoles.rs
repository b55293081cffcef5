//! Which way is out at each point, and how much of the surface it stands for.

use super::sums::{Bins, LANES, Terms, Vector, gradient, lanes, length, pull, winding};
use crate::error::Result;
use crate::resources::workers::Workers;

/// Steps of the search.
const STEPS: usize = 40;

/// Widths below which the kernel is that of a ball, in sampling distances: at the first step and at the last.
const WIDTHS: [f32; 2] = [2.5, 0.3];

/// Bins of a job.
const BINS_OF_JOB: usize = 32;

/// Points in units of the sampling distance, each with a dipole: its direction is the outward normal, its length the area that it stands for.
#[derive(Debug)]
pub struct Dipoles {
    pub bins: Bins,
    pub values: Vec<Vector>,
}

impl Dipoles {
    /// Finds dipoles whose winding number is ½ at every point, and which point down its gradient.
    pub fn find(bins: Bins, workers: &Workers) -> Result<Dipoles> {
        let count = bins.points.len();
        let mut values = vec![[0.0f32; 3]; count];
        for step in 0..STEPS {
            let left = (STEPS - 1 - step) as f32 / (STEPS - 1) as f32;
            let width = WIDTHS[1] + left * (WIDTHS[0] - WIDTHS[1]);
            let missing = at_points(&bins, &values, workers, |at, terms| one(winding(at, terms, width)))?;
            let missing: Vec<Vector> = missing.into_iter().map(|w| [0.5 - w[0], 0.0, 0.0]).collect();
            let way = at_points(&bins, &missing, workers, |at, terms| pull(at, terms, width))?;
            let gained = at_points(&bins, &way, workers, |at, terms| one(winding(at, terms, width)))?;
            let squares = |vectors: &[Vector]| {
                vectors.iter().map(|v| v.iter().map(|c| f64::from(*c) * f64::from(*c)).sum::<f64>()).sum::<f64>()
            };
            let (above, below) = (squares(&way), squares(&gained));
            if below == 0.0 {
                break;
            }
            let far = (above / below) as f32;
            for (value, way) in values.iter_mut().zip(&way) {
                (0..3).for_each(|a| value[a] += far * way[a]);
            }
            let out = at_points(&bins, &values, workers, |at, terms| gradient(at, terms, width))?;
            for (value, out) in values.iter_mut().zip(out) {
                let (size, steep) = (length(*value), length(out));
                if steep > 0.0 {
                    *value = out.map(|c| c / steep * size);
                }
            }
        }
        Ok(Dipoles { bins, values })
    }

    /// The part of the points that have the inside right below them and the outside right above.
    pub fn parting(&self, workers: &Workers) -> Result<f64> {
        const OFF: f32 = 0.7;
        const WIDTH: f32 = 0.6;
        let normals: Vec<Vector> =
            self.values.iter().map(|v| v.map(|c| c / length(*v).max(f32::MIN_POSITIVE))).collect();
        let far = self.bins.far(&self.values);
        let (mut parting, mut terms) = (0usize, Terms::default());
        for bin in 0..self.bins.len() {
            workers.check_cancelled()?;
            self.bins.terms(self.bins.key(bin), &self.values, &far, &mut terms);
            let range = self.bins.range(bin);
            let beside = |side: f32| -> Vec<f32> {
                let off = |i: usize| std::array::from_fn(|a| self.bins.points[i][a] + side * normals[i][a]);
                let places: Vec<Vector> = range.clone().map(off).collect();
                let sums = places.chunks(LANES).flat_map(|some| {
                    let sums = winding(&lanes(some), &terms, WIDTH);
                    sums.into_iter().take(some.len())
                });
                sums.collect()
            };
            let (below, above) = (beside(-OFF), beside(OFF));
            parting += below.iter().zip(&above).filter(|(below, above)| **below > 0.5 && **above < 0.5).count();
        }
        Ok(parting as f64 / self.bins.points.len() as f64)
    }
}

/// One number for each lane, as a vector's first.
fn one(sums: [f32; LANES]) -> [[f32; LANES]; 3] {
    [sums, [0.0; LANES], [0.0; LANES]]
}

/// A sum at every point, in their order.
fn at_points(
    bins: &Bins,
    values: &[Vector],
    workers: &Workers,
    sum: impl Fn(&[[f32; LANES]; 3], &Terms) -> [[f32; LANES]; 3] + Sync,
) -> Result<Vec<Vector>> {
    let far = bins.far(values);
    let mut out = Vec::with_capacity(values.len());
    let of_job = |job: usize| {
        let (mut found, mut terms) = (Vec::new(), Terms::default());
        for bin in job * BINS_OF_JOB..((job + 1) * BINS_OF_JOB).min(bins.len()) {
            bins.terms(bins.key(bin), values, &far, &mut terms);
            for some in bins.points[bins.range(bin)].chunks(LANES) {
                let sums = sum(&lanes(some), &terms);
                found.extend((0..some.len()).map(|lane| sums.map(|axis| axis[lane])));
            }
        }
        Ok(found)
    };
    let jobs = bins.len().div_ceil(BINS_OF_JOB);
    workers.in_order_range(2 * workers.threads(), jobs, of_job, |found: Vec<Vector>| {
        out.extend(found);
        Ok(())
    })?;
    Ok(out)
}
