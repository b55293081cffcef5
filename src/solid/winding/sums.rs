//! Sums over all dipoles, or all numbers, at points: the near ones one by one, those that are far as one for each bin.
//!
//! ```text
//!   +---+---+---+---+---+---+---+     bins of 3 sampling distances
//!   | o | o | o | o | o | o | o |     o  far: its points count as one, at their mean, weighted by how much they are
//!   +---+---+---+---+---+---+---+     .  near: point by point
//!   | o | . | . | . | . | . | o |     x  whose sum is formed
//!   +---+---+---+---+---+---+---+
//!   | o | . | . | x | . | . | o |
//!   +---+---+---+---+---+---+---+
//! ```
//!
//! Sums are formed in the order of bins, and of points in a bin, in `f32`: the number of threads decides no bit.

use multiversion::multiversion;

/// A place or a vector.
pub type Vector = [f32; 3];

/// The side of a bin.
pub const BIN: f32 = 3.0;

/// Bins up to so many away along each axis are near.
const NEAR: i32 = 2;

/// Sums that are formed side by side.
pub const LANES: usize = 8;

/// Points sorted into bins.
#[derive(Debug)]
pub struct Bins {
    /// The points, bin by bin.
    pub points: Vec<Vector>,
    /// Where each bin begins, and the end of the last.
    starts: Vec<usize>,
    /// Which bin it is along each axis.
    keys: Vec<[i32; 3]>,
}

/// What stands for each bin where it is far.
#[derive(Debug)]
pub struct Far {
    places: Vec<Vector>,
    values: Vec<Vector>,
}

/// What a sum is formed over: places, and a vector at each.
#[derive(Debug, Default)]
pub struct Terms {
    places: Vec<Vector>,
    values: Vec<Vector>,
}

/// The bin that a place lies in.
pub fn bin_of(place: Vector) -> [i32; 3] {
    place.map(|c| (c / BIN).floor() as i32)
}

impl Bins {
    /// Sorts points; also says which each one was.
    pub fn of(points: &[Vector]) -> (Bins, Vec<usize>) {
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.sort_by_key(|i| (bin_of(points[*i]), *i));
        let sorted: Vec<Vector> = order.iter().map(|i| points[*i]).collect();
        let (mut starts, mut keys) = (Vec::new(), Vec::new());
        for (i, point) in sorted.iter().enumerate() {
            let key = bin_of(*point);
            if keys.last() != Some(&key) {
                keys.push(key);
                starts.push(i);
            }
        }
        starts.push(sorted.len());
        (Bins { points: sorted, starts, keys }, order)
    }

    /// Number of bins.
    pub fn len(&self) -> usize {
        self.keys.len()
    }

    /// The numbers of a bin's points.
    pub fn range(&self, bin: usize) -> std::ops::Range<usize> {
        self.starts[bin]..self.starts[bin + 1]
    }

    /// The key of a bin.
    pub fn key(&self, bin: usize) -> [i32; 3] {
        self.keys[bin]
    }

    /// The bins that touch the one with this key, and itself.
    pub fn beside(&self, key: [i32; 3]) -> Vec<usize> {
        let touches = |bin: &usize| (0..3).all(|a| (self.keys[*bin][a] - key[a]).abs() <= 1);
        (0..self.len()).filter(touches).collect()
    }

    /// What stands for each bin, with a value at each point.
    pub fn far(&self, values: &[Vector]) -> Far {
        let of_bin = |bin: usize| {
            let (mut place, mut value, mut weight) = ([0.0f32; 3], [0.0f32; 3], 0.0f32);
            let range = self.range(bin);
            let many = range.len() as f32;
            for i in range.clone() {
                let size = length(values[i]);
                weight += size;
                for a in 0..3 {
                    place[a] += size * self.points[i][a];
                    value[a] += values[i][a];
                }
            }
            if weight > 0.0 {
                return (place.map(|c| c / weight), value);
            }
            let mut mean = [0.0f32; 3];
            range.for_each(|i| (0..3).for_each(|a| mean[a] += self.points[i][a] / many));
            (mean, value)
        };
        let (places, values) = (0..self.len()).map(of_bin).unzip();
        Far { places, values }
    }

    /// The terms of sums at places that lie in the bin with this key, or little beside it.
    pub fn terms(&self, key: [i32; 3], values: &[Vector], far: &Far, out: &mut Terms) {
        out.places.clear();
        out.values.clear();
        for bin in 0..self.len() {
            if is_near(self.keys[bin], key) {
                out.places.extend_from_slice(&self.points[self.range(bin)]);
                out.values.extend_from_slice(&values[self.range(bin)]);
            } else {
                out.places.push(far.places[bin]);
                out.values.push(far.values[bin]);
            }
        }
    }
}

fn is_near(a: [i32; 3], b: [i32; 3]) -> bool {
    (0..3).all(|axis| (a[axis] - b[axis]).abs() <= NEAR)
}

/// The length of a vector.
pub fn length(v: Vector) -> f32 {
    (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt()
}

/// Places beside each other, for sums side by side; what is missing at the end repeats the last.
pub fn lanes(places: &[Vector]) -> [[f32; LANES]; 3] {
    std::array::from_fn(|a| std::array::from_fn(|lane| places[lane.min(places.len() - 1)][a]))
}

/// 1/4π.
const FACTOR: f32 = 0.079_577_47;

/// The winding numbers at places: Σ v·e / (4π max(|e|, width)³), e from the place to the term.
#[multiversion(targets("x86_64+avx+avx2"))]
pub fn winding(at: &[[f32; LANES]; 3], terms: &Terms, width: f32) -> [f32; LANES] {
    let least = width * width;
    let mut sum = [0.0f32; LANES];
    for (p, v) in terms.places.iter().zip(&terms.values) {
        for lane in 0..LANES {
            let (x, y, z) = (p[0] - at[0][lane], p[1] - at[1][lane], p[2] - at[2][lane]);
            let squared = x * x + y * y + z * z;
            let squared = if squared > least { squared } else { least };
            sum[lane] += (v[0] * x + v[1] * y + v[2] * z) / (squared * squared.sqrt());
        }
    }
    for value in &mut sum {
        *value *= FACTOR;
    }
    sum
}

/// What a change of the winding number there asks of a dipole at places: Σ f·e / (4π max(|e|, width)³), e from the term to the place, f its first number.
#[multiversion(targets("x86_64+avx+avx2"))]
pub fn pull(at: &[[f32; LANES]; 3], terms: &Terms, width: f32) -> [[f32; LANES]; 3] {
    let least = width * width;
    let mut sum = [[0.0f32; LANES]; 3];
    for (p, v) in terms.places.iter().zip(&terms.values) {
        for lane in 0..LANES {
            let (x, y, z) = (at[0][lane] - p[0], at[1][lane] - p[1], at[2][lane] - p[2]);
            let squared = x * x + y * y + z * z;
            let squared = if squared > least { squared } else { least };
            let k = v[0] / (squared * squared.sqrt());
            sum[0][lane] += k * x;
            sum[1][lane] += k * y;
            sum[2][lane] += k * z;
        }
    }
    for axis in &mut sum {
        for value in axis {
            *value *= FACTOR;
        }
    }
    sum
}

/// The gradient of the winding number, turned outwards, but for a factor: Σ v/r³ − 3 (v·e) e/r⁵, with r = max(|e|, width) and the second term where |e| is more.
#[multiversion(targets("x86_64+avx+avx2"))]
pub fn gradient(at: &[[f32; LANES]; 3], terms: &Terms, width: f32) -> [[f32; LANES]; 3] {
    let least = width * width;
    let mut sum = [[0.0f32; LANES]; 3];
    for (p, v) in terms.places.iter().zip(&terms.values) {
        for lane in 0..LANES {
            let (x, y, z) = (p[0] - at[0][lane], p[1] - at[1][lane], p[2] - at[2][lane]);
            let squared = x * x + y * y + z * z;
            let (r, far) = if squared > least { (squared, 3.0) } else { (least, 0.0) };
            let k = 1.0 / (r * r.sqrt());
            let m = far * (v[0] * x + v[1] * y + v[2] * z) * k / r;
            sum[0][lane] += v[0] * k - m * x;
            sum[1][lane] += v[1] * k - m * y;
            sum[2][lane] += v[2] * k - m * z;
        }
    }
    sum
}
