//! Points of the surface between the points of a sparse cloud, by the winding number.
//!
//! *Source: the winding number of dipoles at points, with normals found from it: S. Lin, D. Xiao, Z. Shi, B. Wang, Surface Reconstruction from Point Clouds without Normals by Parametrizing
//! the Gauss Formula (2022); S. Lin, Z. Shi, Y. Liu, Fast and Globally Consistent Normal Orientation based on the Winding Number Normal Consistency (2024). Own: bins, the lattice, what is believed.*
//!
//! Where walls and slots are two sampling distances wide, cells that are wide enough to have points fill them. But all points together tell more: there is one way to turn their
//! normals so that the winding number is ½ at each, 1 in the body and 0 around it. The surface where it is ½ is then sampled as densely as need be.
//!
//! Memory: 1 KiB a point, up to six blocks of the lattice, each of 400 bytes, and 4 MiB for the box of blocks.

mod dipoles;
mod lattice;
mod sums;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use self::dipoles::Dipoles;
use self::sums::{Bins, Vector};
use crate::error::Result;
use crate::points::bounds::Bounds;
use crate::resources::workers::Workers;

/// Clouds of more points are not looked at: their sums take seconds.
pub const MOST: usize = 5_000;

/// Of fewer, nobody can tell what they are of.
const LEAST: usize = 50;

/// The part of the points that must have the inside below and the outside above.
const PARTING: f64 = 0.98;

/// How far the Euler number may be from that of the body whose surface is thought a little farther out: else points are too few, or too noisy, to be believed.
const UNSTEADY: i64 = 2;

/// The part of the surface that may lie far from all points, and what is far, in sampling distances: else it is open, or has a hole.
const OPEN: f64 = 0.012;
const FAR: f32 = 1.5;

/// Places of the surface are so far apart, in sampling distances: the first that do are taken.
const SPACED: [f32; 3] = [0.45, 0.36, 0.3];

/// Vectors for each point, but for the lattice: its dipole, what is summed up of it, and places of the surface, in vectors that grow by doubling.
const VECTORS_OF_POINT: u64 = 80;

/// Neighbours that the sampling distance is told by.
const NEIGHBOURS: usize = 6;

/// Bytes of looking at so many points, at most.
pub fn bytes(points: u64) -> u64 {
    lattice::bytes(points) + points * VECTORS_OF_POINT * size_of::<Vector>() as u64
}

/// The surface of a body, as its points tell it.
#[derive(Debug, Clone, PartialEq)]
pub struct Told {
    /// Places on it, more of them each time.
    pub sampled: Vec<Sampled>,
    /// The Euler number of the body.
    pub characteristic: i64,
    /// Whether the body has the same one if its surface is moved a little inwards or outwards.
    pub is_steady: bool,
}

/// Places of a surface.
#[derive(Debug, Clone, PartialEq)]
pub struct Sampled {
    /// The places.
    pub places: Vec<[f64; 3]>,
    /// The point that each is nearest to; of equals the first.
    pub nearest: Vec<usize>,
}

/// Looks for the surface of the body that points were sampled from; none if there is none that could be believed. The points must be in an order that only they decide, each once.
///
/// # Errors
/// [`crate::Error::Interrupted`].
pub fn surface_of(points: &[[f64; 3]], workers: &Workers) -> Result<Option<Told>> {
    if !(LEAST..=MOST).contains(&points.len()) {
        return Ok(None);
    }
    let bounds = points.iter().fold(Bounds::EMPTY, |bounds, p| bounds.union(Bounds { min: *p, max: *p }));
    let middle: [f64; 3] = std::array::from_fn(|a| bounds.min[a] / 2.0 + bounds.max[a] / 2.0);
    let longest = bounds.longest_side();
    let scaled = |unit: f64| -> Vec<Vector> {
        points.iter().map(|p| std::array::from_fn(|a| ((p[a] - middle[a]) / unit) as f32)).collect()
    };
    let unit = longest * f64::from(sampling_distance(&scaled(longest), workers)?);
    // All in one place, or a line.
    if !(unit > longest * 1e-4 && unit.is_finite()) {
        return Ok(None);
    }
    let (bins, order) = Bins::of(&scaled(unit));
    let dipoles = Dipoles::find(bins, workers)?;
    if dipoles.parting(workers)? < PARTING {
        return Ok(None);
    }
    let Some(shown) = lattice::look(&dipoles, &SPACED, workers)? else { return Ok(None) };
    let [fine, coarse, wider, _] = shown.characteristic;
    if fine != coarse || (wider - fine).abs() > UNSTEADY {
        return Ok(None);
    }
    let place = |p: &Vector| std::array::from_fn(|a| middle[a] + unit * f64::from(p[a]));
    let mut sampled = Vec::new();
    for crossings in &shown.crossings {
        let (nearest, far) = nearest(&dipoles.bins, crossings);
        if crossings.is_empty() || far as f64 > OPEN * crossings.len() as f64 {
            return Ok(None);
        }
        let nearest = nearest.into_iter().map(|i| order[i]).collect();
        sampled.push(Sampled { places: crossings.iter().map(place).collect(), nearest });
    }
    Ok(Some(Told {
        sampled,
        characteristic: fine,
        is_steady: shown.characteristic.iter().all(|number| *number == fine),
    }))
}

/// The distance d of points that lie in a plane at random, one to d² of it: as far as the middle one of the sixth neighbours tells.
fn sampling_distance(points: &[Vector], workers: &Workers) -> Result<f32> {
    const OF_JOB: usize = 128;
    let of_job = |job: usize| {
        let of_point = |p: &Vector| {
            let mut least = [f32::INFINITY; NEIGHBOURS + 1];
            for q in points {
                let squared = squared_distance(*p, *q);
                if squared < least[NEIGHBOURS] {
                    let at = least.partition_point(|other| *other <= squared);
                    least.copy_within(at..NEIGHBOURS, at + 1);
                    least[at] = squared;
                }
            }
            least[NEIGHBOURS]
        };
        Ok(points.iter().skip(job * OF_JOB).take(OF_JOB).map(of_point).collect::<Vec<f32>>())
    };
    let mut all = Vec::with_capacity(points.len());
    workers.in_order_range(2 * workers.threads(), points.len().div_ceil(OF_JOB), of_job, |found| {
        all.extend(found);
        Ok(())
    })?;
    all.sort_by(f32::total_cmp);
    Ok((all[all.len() / 2] * std::f32::consts::PI / NEIGHBOURS as f32).sqrt())
}

/// The nearest point to each place, by its number in the bins, and how many places are far from all.
fn nearest(bins: &Bins, places: &[Vector]) -> (Vec<usize>, usize) {
    let mut far = 0;
    let mut near: BTreeMap<[i32; 3], Vec<usize>> = BTreeMap::new();
    let of_place = |place: &Vector| {
        let least = |numbers: &mut dyn Iterator<Item = usize>| {
            numbers.map(|i| (squared_distance(bins.points[i], *place), i)).min_by(|a, b| a.0.total_cmp(&b.0))
        };
        let key = sums::bin_of(*place);
        let beside = near.entry(key).or_insert_with(|| bins.beside(key));
        match least(&mut beside.iter().flat_map(|bin| bins.range(*bin))) {
            Some((squared, i)) if squared <= FAR * FAR => i,
            _ => {
                far += 1;
                least(&mut (0..bins.points.len())).expect("there are points").1
            }
        }
    };
    let nearest = places.iter().map(of_place).collect();
    (nearest, far)
}

fn squared_distance(p: Vector, q: Vector) -> f32 {
    let [x, y, z] = std::array::from_fn(|a| p[a] - q[a]);
    x * x + y * y + z * z
}
