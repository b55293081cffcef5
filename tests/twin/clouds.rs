//! Clouds and settings for property tests: the shapes that go wrong, small enough for the twin.

use proptest::prelude::*;

use super::grid::{Axis, grid_for};
use super::{Diagonals, Params};

/// A cloud of at least one point.
#[derive(Debug, Clone)]
pub struct Cloud {
    /// What kind of cloud.
    pub kind: &'static str,
    /// The points, file axes.
    pub points: Vec<[f64; 3]>,
    /// Whether every coordinate is exactly an `f32`.
    pub single: bool,
}

impl Cloud {
    fn single(kind: &'static str, points: Vec<[f32; 3]>) -> Cloud {
        Cloud { kind, points: points.into_iter().map(|p| p.map(f64::from)).collect(), single: true }
    }

    fn double(kind: &'static str, points: Vec<[f64; 3]>) -> Cloud {
        Cloud { kind, points, single: false }
    }
}

/// Everything a reconstruction is told beside the points.
#[derive(Debug, Clone)]
pub struct Setting {
    /// `None` for the longest side.
    pub axis: Option<Axis>,
    /// Slices along it.
    pub slices: u32,
    /// Closing radius.
    pub rho: u32,
    /// Smoothing steps.
    pub smooth: u32,
    /// How faces are cut.
    pub diagonals: Diagonals,
    /// Slices of a slab.
    pub slab_slices: u32,
}

impl Setting {
    /// The parameters for a cloud, fitted. An axis that would need a huge raster gives way to the longest side.
    pub fn params(&self, cloud: &Cloud) -> Params {
        const MOST_CELLS: f64 = 4000.0;
        let mut grid = grid_for(&cloud.points, self.axis, self.slices);
        if grid.3.iter().map(|&c| f64::from(c)).product::<f64>() > MOST_CELLS {
            grid = grid_for(&cloud.points, None, self.slices);
        }
        Params {
            rho: self.rho,
            smooth: self.smooth,
            diagonals: self.diagonals,
            single: cloud.single,
            ..Params::of_grid(grid, self.slab_slices)
        }
    }
}

/// Settings that a twin can follow in a fraction of a second.
pub fn setting() -> impl Strategy<Value = Setting> {
    let axis = prop_oneof![Just(None), Just(Some(Axis::X)), Just(Some(Axis::Y)), Just(Some(Axis::Z))];
    let diagonals = prop_oneof![Just(Diagonals::Delaunay), Just(Diagonals::First), Just(Diagonals::Random)];
    (axis, 1u32..=12, 1u32..=3, 0u32..=3, diagonals, 2u32..=16).prop_map(
        |(axis, slices, rho, smooth, diagonals, slab_slices)| Setting {
            axis,
            slices,
            rho,
            smooth,
            diagonals,
            slab_slices,
        },
    )
}

/// Any of the clouds below.
pub fn cloud() -> impl Strategy<Value = Cloud> {
    prop_oneof![
        single_point(),
        duplicates(),
        line(),
        collinear(),
        plane(),
        tilted_plane(),
        clusters(),
        noise(),
        sphere(),
        lattice(),
        signed_zeros(),
        survey(),
        speck(),
        outliers(),
    ]
}

fn unit() -> impl Strategy<Value = [f32; 3]> {
    [-1.0f32..1.0, -1.0f32..1.0, -1.0f32..1.0]
}

/// One point, anywhere.
pub fn single_point() -> impl Strategy<Value = Cloud> {
    [-1e6f32..1e6, -1.0f32..1.0, -1e-6f32..1e-6].prop_map(|p| Cloud::single("single point", vec![p]))
}

/// A few places, each several times.
pub fn duplicates() -> impl Strategy<Value = Cloud> {
    prop::collection::vec((unit(), 1usize..5), 1..8).prop_map(|places| {
        let copies = places.iter().flat_map(|&(p, n)| std::iter::repeat_n(p, n));
        Cloud::single("duplicates", copies.collect())
    })
}

fn on_line(from: [f32; 3], to: [f32; 3], along: &[f32]) -> Vec<[f32; 3]> {
    along.iter().map(|&t| [0, 1, 2].map(|a| from[a] + (to[a] - from[a]) * t)).collect()
}

/// Points on a line in space, as nearly as `f32` can say.
pub fn line() -> impl Strategy<Value = Cloud> {
    (unit(), unit(), prop::collection::vec(0.0f32..=1.0, 2..60))
        .prop_map(|(from, to, along)| Cloud::single("line", on_line(from, to, &along)))
}

/// Points exactly on a line along an axis.
pub fn collinear() -> impl Strategy<Value = Cloud> {
    (unit(), 0usize..3, prop::collection::vec(-10i16..=10, 1..40)).prop_map(|(at, axis, along)| {
        let point = |&t: &i16| {
            let mut p = at;
            p[axis] = f32::from(t);
            p
        };
        Cloud::single("collinear", along.iter().map(point).collect())
    })
}

/// Points exactly on a plane perpendicular to an axis.
pub fn plane() -> impl Strategy<Value = Cloud> {
    (0usize..3, prop::collection::vec(unit(), 1..80)).prop_map(|(axis, mut points)| {
        let at = points[0][axis];
        for p in &mut points {
            p[axis] = at;
        }
        Cloud::single("plane", points)
    })
}

/// Points near a plane that lies askew.
pub fn tilted_plane() -> impl Strategy<Value = Cloud> {
    (unit(), prop::collection::vec(unit(), 3..80)).prop_map(|(normal, mut points)| {
        for p in &mut points {
            p[2] = normal[0] * p[0] + normal[1] * p[1] + normal[2] * 0.01 * p[2];
        }
        Cloud::single("tilted plane", points)
    })
}

/// Tight clusters far apart.
pub fn clusters() -> impl Strategy<Value = Cloud> {
    prop::collection::vec((unit(), prop::collection::vec(unit(), 1..12)), 1..6).prop_map(|clusters| {
        let around = |(centre, points): &([f32; 3], Vec<[f32; 3]>)| {
            let centre = *centre;
            points.iter().map(move |p| [0, 1, 2].map(|a| centre[a] * 10.0 + p[a] * 0.3)).collect::<Vec<_>>()
        };
        Cloud::single("clusters", clusters.iter().flat_map(around).collect())
    })
}

/// Points anywhere in a box.
pub fn noise() -> impl Strategy<Value = Cloud> {
    (prop::collection::vec(unit(), 1..80), [0.01f32..1.0, 0.01f32..1.0, 0.01f32..1.0]).prop_map(|(points, size)| {
        Cloud::single("noise", points.iter().map(|p| [0, 1, 2].map(|a| p[a] * size[a])).collect())
    })
}

/// Points on a sphere, in full double precision.
pub fn sphere() -> impl Strategy<Value = Cloud> {
    (prop::collection::vec((-1.0f64..1.0, 0.0f64..std::f64::consts::TAU), 8..150), 0.1f64..100.0).prop_map(
        |(places, radius)| {
            let point = |&(height, turn): &(f64, f64)| {
                let s = (1.0 - height * height).sqrt();
                [radius * s * turn.cos(), radius * s * turn.sin(), radius * height]
            };
            Cloud::double("sphere", places.iter().map(point).collect())
        },
    )
}

/// Points with small whole coordinates: cell borders and equal distances everywhere.
pub fn lattice() -> impl Strategy<Value = Cloud> {
    prop::collection::vec([-4i8..=4, -4i8..=4, -4i8..=4], 1..60)
        .prop_map(|points| Cloud::single("lattice", points.iter().map(|p| p.map(f32::from)).collect()))
}

/// Zeros of both signs, alone and in a crowd of ones.
pub fn signed_zeros() -> impl Strategy<Value = Cloud> {
    let coordinate = || prop_oneof![Just(0.0f32), Just(-0.0f32), Just(1.0f32), Just(-1.0f32)];
    prop::collection::vec([coordinate(), coordinate(), coordinate()], 1..30)
        .prop_map(|points| Cloud::single("signed zeros", points))
}

/// Projected coordinates in millimetres, millions of metres from the origin.
pub fn survey() -> impl Strategy<Value = Cloud> {
    prop::collection::vec([0i32..20_000, 0i32..15_000, 0i32..3_000], 1..80).prop_map(|points| {
        let metres = |p: &[i32; 3]| {
            let [east, north, height] = p.map(|mm| f64::from(mm) / 1000.0);
            [4.5e6 + east, 5.3e6 + north, 412.0 + height]
        };
        Cloud::double("survey", points.iter().map(metres).collect())
    })
}

/// Points so close together that `f64` can barely tell them apart.
pub fn speck() -> impl Strategy<Value = Cloud> {
    prop::collection::vec([0u8..8, 0u8..8, 0u8..8], 1..40).prop_map(|points| {
        let ulps = |p: &[u8; 3]| p.map(|n| 1.0 + f64::from(n) * f64::EPSILON);
        Cloud::double("speck", points.iter().map(ulps).collect())
    })
}

/// A crowd in one cell, and two points far away on either side.
pub fn outliers() -> impl Strategy<Value = Cloud> {
    (prop::collection::vec(unit(), 1..40), unit(), unit()).prop_map(|(mut points, one, other)| {
        for p in &mut points {
            *p = p.map(|x| x * 1e-3);
        }
        points.push(one.map(|x| x + 100.0));
        points.push(other.map(|x| x - 100.0));
        Cloud::single("outliers", points)
    })
}
