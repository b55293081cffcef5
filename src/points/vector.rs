//! Sums, differences and products of vectors, in one order of operations everywhere: results are the same to the bit.

/// The difference of two places.
#[inline]
pub fn minus(p: [f64; 3], q: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|a| p[a] - q[a])
}

/// The sum of two vectors.
#[inline]
pub fn plus(p: [f64; 3], q: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|a| p[a] + q[a])
}

/// `s` times a vector.
#[inline]
pub fn times(s: f64, p: [f64; 3]) -> [f64; 3] {
    p.map(|c| s * c)
}

/// The cross product.
#[inline]
pub fn cross(p: [f64; 3], q: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|a| {
        let (b, c) = ((a + 1) % 3, (a + 2) % 3);
        p[b] * q[c] - p[c] * q[b]
    })
}

/// The dot product.
#[inline]
pub fn dot(p: [f64; 3], q: [f64; 3]) -> f64 {
    p[0] * q[0] + p[1] * q[1] + p[2] * q[2]
}
