//! The direction in which points spread least.
//!
//! It is never computed: the adjugate of the covariance has the same axes with the least the largest, and squaring it leaves that alone. Where the points have no
//! flattest direction (a line, a lump), there is something left of the others.

/// A symmetric matrix.
pub type Matrix = [[f64; 3]; 3];

/// Added to the variances: two places of a line or a plane without noise still have a covariance that can be inverted.
const LEAST_VARIANCE: f64 = 1.0 / 1024.0;

/// Squarings of the adjugate: a direction with twice the variance of the flattest keeps 2⁻⁸ of its share.
const SQUARINGS: u32 = 3;

/// The projection onto a covariance's flattest direction, nearly: its trace is 1.
pub fn flattest(covariance: &Matrix) -> Matrix {
    let mut c = *covariance;
    (0..3).for_each(|a| c[a][a] += LEAST_VARIANCE);
    // Entry (i, j): with i, i + 1, i + 2 and j, j + 1, j + 2 in turn, the sign comes by itself.
    let turn = |i: usize| ((i + 1) % 3, (i + 2) % 3);
    let mut m: Matrix = std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let ((i1, i2), (j1, j2)) = (turn(i.min(j)), turn(i.max(j)));
            c[i1][j1] * c[i2][j2] - c[i1][j2] * c[i2][j1]
        })
    });
    m = scaled(&m);
    for _ in 0..SQUARINGS {
        let squared =
            std::array::from_fn(|i| std::array::from_fn(|j| m[i][0] * m[0][j] + m[i][1] * m[1][j] + m[i][2] * m[2][j]));
        m = scaled(&squared);
    }
    m
}

/// The variance along a direction that [`flattest`] gave.
pub fn variance_along(direction: &Matrix, covariance: &Matrix) -> f64 {
    (0..9).map(|i| direction[i / 3][i % 3] * covariance[i / 3][i % 3]).sum()
}

/// The matrix divided by its trace.
fn scaled(m: &Matrix) -> Matrix {
    let trace = m[0][0] + m[1][1] + m[2][2];
    m.map(|row| row.map(|entry| entry / trace))
}
