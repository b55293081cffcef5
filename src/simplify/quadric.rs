//! Sums of squared distances from planes (Garland & Heckbert 1997) that pass through one place.

use glam::{DMat3, DVec3};

/// Σ (n·d)² / |n| over vectors n, as a function of d, the way from the place that the planes have in common: a symmetric 3 × 3 matrix.
///
/// With n across a triangle and as long as its area, this is the squared distance from its plane times its area. Sums are formed in the order of the
/// calls, so that the same calls give the same bits.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Quadric {
    /// Σ n nᵀ / |n|: xx, xy, xz, yy, yz, zz.
    square: [f64; 6],
    /// Σ |n|.
    weight: f64,
}

impl Quadric {
    /// Adds the plane across `normal`, weighed by its length; nothing if that is 0.
    pub(super) fn add(&mut self, normal: DVec3) {
        let length = normal.length();
        if length > 0.0 {
            let DVec3 { x, y, z } = normal;
            let (p, q, r) = (x / length, y / length, z / length);
            let [xx, xy, xz, yy, yz, zz] = &mut self.square;
            *xx += p * x;
            *xy += p * y;
            *xz += p * z;
            *yy += q * y;
            *yz += q * z;
            *zz += r * z;
            self.weight += length;
        }
    }

    /// The sum at a place, and `even` times its weight for every squared unit of the way.
    pub(super) fn at(&self, way: DVec3, even: f64) -> f64 {
        let DVec3 { x, y, z } = way;
        let [xx, xy, xz, yy, yz, zz] = self.square;
        let squares = x * (xx * x + 2.0 * (xy * y + xz * z)) + y * (yy * y + 2.0 * yz * z) + zz * z * z;
        squares.max(0.0) + even * self.weight * (x * x + y * y + z * z)
    }

    /// The matrix.
    pub(super) fn matrix(&self) -> DMat3 {
        let [xx, xy, xz, yy, yz, zz] = self.square;
        DMat3::from_cols(DVec3::new(xx, xy, xz), DVec3::new(xy, yy, yz), DVec3::new(xz, yz, zz))
    }

    /// Σ |n|.
    pub(super) fn weight(&self) -> f64 {
        self.weight
    }
}
