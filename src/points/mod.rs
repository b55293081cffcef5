//! Points as they come from files: coordinates in the file's own precision, batch by batch.

pub mod attribute;
pub mod bounds;
pub mod clip;
pub mod crs;
pub mod earth;
pub(crate) mod filter;
pub mod scalar;
pub mod seen_from;
pub mod unit;
pub mod vector;
mod wkt;

use bytemuck::Pod;

/// The precision in which a file stores coordinates; the whole cloud takes the wider of its files'.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// Every coordinate is exactly an `f32`.
    Single,
    /// `f64`.
    Double,
}

impl Precision {
    /// Bytes of one coordinate.
    pub fn bytes(self) -> usize {
        match self {
            Precision::Single => 4,
            Precision::Double => 8,
        }
    }
}

/// A coordinate type that points are kept in: `f32` or `f64`. Widening to `f64` is exact.
pub trait Coordinate: Pod + Default + Send + Sync + PartialOrd + Into<f64> + 'static {
    /// The precision this type has.
    const PRECISION: Precision;
    /// The value as this type; exact if it was read in this or a narrower precision.
    fn from_f64(value: f64) -> Self;
    /// The points of this precision.
    ///
    /// # Panics
    /// If they are of the other.
    fn of(points: &Points) -> &[[Self; 3]];
}

/// A point as something to compare: its coordinates' bits, which tell the two zeros apart.
pub fn bits<T: Coordinate>(point: [T; 3]) -> [u64; 3] {
    point.map(|c| c.into().to_bits())
}

impl Coordinate for f32 {
    const PRECISION: Precision = Precision::Single;
    fn from_f64(value: f64) -> Self {
        value as f32
    }
    fn of(points: &Points) -> &[[f32; 3]] {
        let Points::Single(points) = points else { panic!("points of f64 in a cloud of f32") };
        points
    }
}

impl Coordinate for f64 {
    const PRECISION: Precision = Precision::Double;
    fn from_f64(value: f64) -> Self {
        value
    }
    fn of(points: &Points) -> &[[f64; 3]] {
        let Points::Double(points) = points else { panic!("points of f32 in a cloud of f64") };
        points
    }
}

/// Decoded points of one block, all finite, in file order and file axes.
#[derive(Debug, Clone, PartialEq)]
pub enum Points {
    /// From a file of `f32` coordinates.
    Single(Vec<[f32; 3]>),
    /// From a file of `f64`, integer or decimal coordinates.
    Double(Vec<[f64; 3]>),
}

impl Points {
    /// No points, of the given precision.
    pub fn new(precision: Precision) -> Points {
        match precision {
            Precision::Single => Points::Single(Vec::new()),
            Precision::Double => Points::Double(Vec::new()),
        }
    }

    /// Makes room for so many more, and no more than those.
    pub fn reserve_exact(&mut self, count: usize) {
        match self {
            Points::Single(points) => points.reserve_exact(count),
            Points::Double(points) => points.reserve_exact(count),
        }
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        match self {
            Points::Single(points) => points.len(),
            Points::Double(points) => points.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// What decoding a block gave.
#[derive(Debug, Clone, PartialEq)]
pub struct Batch {
    /// The points that count, all finite.
    pub points: Points,
    /// The records of their attributes, one after the other.
    pub attributes: Vec<u8>,
    /// Points left out because a coordinate was NaN or infinite.
    pub dropped: u64,
    /// Points left out because they were not asked for.
    pub filtered: u64,
    /// Where the points were scanned from, if the file tells.
    pub station: Option<[f64; 3]>,
    /// The number of their file, in reading order.
    pub source: usize,
}

impl Batch {
    /// All records of the block.
    pub fn records(&self) -> u64 {
        self.points.len() as u64 + self.dropped + self.filtered
    }

    /// An empty batch, to be filled by decoding.
    pub fn new(precision: Precision) -> Batch {
        Batch {
            points: Points::new(precision),
            attributes: Vec::new(),
            dropped: 0,
            filtered: 0,
            station: None,
            source: 0,
        }
    }
}
