//! Points that lie in memory, or wherever a program of one's own keeps them: read again in every pass, and never copied as a whole.

use std::ops::Range;

use crate::error::{Error, Result};
use crate::format::point_format::{BLOCK_RECORDS, BlockCutter, Decode, PointFormat};
use crate::points::attribute::{Attribute, Carrying, Schema};
use crate::points::scalar::Scalar;
use crate::points::{Batch, Points, Precision};

/// Points that can be read more than once, in pieces, from several threads at a time.
///
/// A reconstruction reads its points two to four times. Every time they must be the same.
///
/// ```
/// use std::ops::Range;
///
/// use asra_stream::{PointBuffer, PointSource, Precision, Result};
///
/// /// A hundred thousand points on a sphere, computed whenever they are asked for.
/// struct Sphere;
///
/// impl PointSource for Sphere {
///     fn len(&self) -> u64 {
///         100_000
///     }
///
///     fn precision(&self) -> Precision {
///         Precision::Double
///     }
///
///     fn read(&self, range: Range<u64>, out: &mut PointBuffer) -> Result<()> {
///         for i in range {
///             let z = (2.0 * i as f64 + 1.0) / 100_000.0 - 1.0;
///             let (r, angle) = ((1.0 - z * z).sqrt(), 2.399963 * i as f64);
///             out.push([r * angle.cos(), r * angle.sin(), z]);
///         }
///         Ok(())
///     }
/// }
///
/// let mesh = asra_stream::Reconstruction::from_source(&Sphere).run()?;
/// assert_eq!(mesh.report().check.as_ref().unwrap().genus, Some(0));
/// # Ok::<(), asra_stream::Error>(())
/// ```
#[expect(clippy::len_without_is_empty, reason = "a source without points is an error of the run, told there")]
pub trait PointSource: Sync {
    /// The number of points.
    fn len(&self) -> u64;

    /// The precision of the coordinates. In [`Precision::Single`], every coordinate is rounded to an `f32`.
    fn precision(&self) -> Precision;

    /// The attributes of each point: names and types.
    fn attributes(&self) -> Vec<Attribute> {
        Vec::new()
    }

    /// Appends the points of these numbers to `out`, and the attributes of each. At most 65,536 are asked for at a time.
    ///
    /// # Errors
    /// What keeps it from reading, as [`Error::Source`], say. It ends the run.
    fn read(&self, range: Range<u64>, out: &mut PointBuffer) -> Result<()>;
}

/// Where a [`PointSource`] puts its points.
#[derive(Debug)]
pub struct PointBuffer<'a> {
    pub(super) points: &'a mut Points,
    pub(super) records: &'a mut Vec<u8>,
}

impl PointBuffer<'_> {
    /// Appends a point.
    pub fn push(&mut self, point: [f64; 3]) {
        match self.points {
            Points::Single(points) => points.push(point.map(|c| c as f32)),
            Points::Double(points) => points.push(point),
        }
    }

    /// Appends points in single precision.
    pub fn extend_single(&mut self, points: &[[f32; 3]]) {
        match self.points {
            Points::Single(out) => out.extend_from_slice(points),
            Points::Double(out) => out.extend(points.iter().map(|point| point.map(f64::from))),
        }
    }

    /// Appends points in double precision.
    pub fn extend_double(&mut self, points: &[[f64; 3]]) {
        match self.points {
            Points::Single(out) => out.extend(points.iter().map(|point| point.map(|c| c as f32))),
            Points::Double(out) => out.extend_from_slice(points),
        }
    }

    /// Appends one attribute of the next point, in the type that the source's attribute has; what that type cannot hold becomes the nearest value that it can.
    /// The attributes of a point come one after the other, in the order of [`PointSource::attributes`].
    pub fn push_attribute(&mut self, scalar: Scalar, value: f64) {
        scalar.put(value, self.records);
    }

    /// Appends attributes as bytes: of each point its numbers one after the other, in the machine's byte order.
    pub fn extend_attributes(&mut self, records: &[u8]) {
        self.records.extend_from_slice(records);
    }
}

/// The values of one attribute, a number for each point.
#[derive(Debug, Clone, Copy)]
pub enum Values<'a> {
    /// 8-bit signed integers.
    I8(&'a [i8]),
    /// 8-bit unsigned integers.
    U8(&'a [u8]),
    /// 16-bit signed integers.
    I16(&'a [i16]),
    /// 16-bit unsigned integers.
    U16(&'a [u16]),
    /// 32-bit signed integers.
    I32(&'a [i32]),
    /// 32-bit unsigned integers.
    U32(&'a [u32]),
    /// Single precision.
    F32(&'a [f32]),
    /// Double precision.
    F64(&'a [f64]),
}

macro_rules! values_of {
    ($($variant:ident $number:ty),*) => {
        $(impl<'a> From<&'a [$number]> for Values<'a> {
            fn from(values: &'a [$number]) -> Self {
                Values::$variant(values)
            }
        }
        impl<'a> From<&'a Vec<$number>> for Values<'a> {
            fn from(values: &'a Vec<$number>) -> Self {
                Values::$variant(values)
            }
        }
        impl<'a, const N: usize> From<&'a [$number; N]> for Values<'a> {
            fn from(values: &'a [$number; N]) -> Self {
                Values::$variant(values)
            }
        })*
    };
}
values_of!(I8 i8, U8 u8, I16 i16, U16 u16, I32 i32, U32 u32, F32 f32, F64 f64);

impl Values<'_> {
    fn scalar(&self) -> Scalar {
        match self {
            Values::I8(_) => Scalar::I8,
            Values::U8(_) => Scalar::U8,
            Values::I16(_) => Scalar::I16,
            Values::U16(_) => Scalar::U16,
            Values::I32(_) => Scalar::I32,
            Values::U32(_) => Scalar::U32,
            Values::F32(_) => Scalar::F32,
            Values::F64(_) => Scalar::F64,
        }
    }

    fn bytes(&self) -> &[u8] {
        match self {
            Values::I8(values) => bytemuck::cast_slice(values),
            Values::U8(values) => values,
            Values::I16(values) => bytemuck::cast_slice(values),
            Values::U16(values) => bytemuck::cast_slice(values),
            Values::I32(values) => bytemuck::cast_slice(values),
            Values::U32(values) => bytemuck::cast_slice(values),
            Values::F32(values) => bytemuck::cast_slice(values),
            Values::F64(values) => bytemuck::cast_slice(values),
        }
    }
}

/// Points in a slice.
#[derive(Debug, Clone, Copy)]
pub enum PointSlice<'a> {
    /// In single precision.
    Single(&'a [[f32; 3]]),
    /// In double precision.
    Double(&'a [[f64; 3]]),
}

macro_rules! point_slice_of {
    ($($variant:ident $number:ty),*) => {
        $(impl<'a> From<&'a [[$number; 3]]> for PointSlice<'a> {
            fn from(points: &'a [[$number; 3]]) -> Self {
                PointSlice::$variant(points)
            }
        }
        impl<'a> From<&'a Vec<[$number; 3]>> for PointSlice<'a> {
            fn from(points: &'a Vec<[$number; 3]>) -> Self {
                PointSlice::$variant(points)
            }
        }
        impl<'a, const N: usize> From<&'a [[$number; 3]; N]> for PointSlice<'a> {
            fn from(points: &'a [[$number; 3]; N]) -> Self {
                PointSlice::$variant(points)
            }
        })*
    };
}
point_slice_of!(Single f32, Double f64);

impl PointSource for PointSlice<'_> {
    fn len(&self) -> u64 {
        match self {
            PointSlice::Single(points) => points.len() as u64,
            PointSlice::Double(points) => points.len() as u64,
        }
    }

    fn precision(&self) -> Precision {
        match self {
            PointSlice::Single(_) => Precision::Single,
            PointSlice::Double(_) => Precision::Double,
        }
    }

    fn read(&self, range: Range<u64>, out: &mut PointBuffer) -> Result<()> {
        let range = range.start as usize..range.end as usize;
        match self {
            PointSlice::Single(points) => out.extend_single(&points[range]),
            PointSlice::Double(points) => out.extend_double(&points[range]),
        }
        Ok(())
    }
}

/// Points in a slice, and slices of their attributes.
#[derive(Debug, Clone)]
pub(crate) struct Arrays<'a> {
    coordinates: PointSlice<'a>,
    attributes: Vec<(Attribute, Values<'a>)>,
}

impl<'a> Arrays<'a> {
    pub fn new(coordinates: PointSlice<'a>) -> Arrays<'a> {
        Arrays { coordinates, attributes: Vec::new() }
    }

    /// The names of its attributes.
    pub fn names(&self) -> Vec<String> {
        self.attributes.iter().map(|(attribute, _)| attribute.name.clone()).collect()
    }

    /// Adds an attribute.
    ///
    /// # Errors
    /// [`Error::Usage`] if there is not one value for each point, an attribute of this name already, or the name is none, or that of a coordinate.
    pub fn add(&mut self, name: &str, values: Values<'a>) -> Result<()> {
        let attribute = Attribute::new(name, values.scalar());
        let count = (values.bytes().len() / attribute.scalar.bytes()) as u64;
        if count != self.len() {
            let points = self.len();
            return Err(Error::Usage(format!("attribute {name:?}: {count} values for {points} points")));
        }
        may_be_named(name, &attribute, self.attributes.iter().map(|(other, _)| other))?;
        self.attributes.push((attribute, values));
        Ok(())
    }
}

/// Whether an attribute that was given under `name` can be told from others and from the coordinates.
fn may_be_named<'a>(name: &str, attribute: &Attribute, mut others: impl Iterator<Item = &'a Attribute>) -> Result<()> {
    let wrong = match attribute.name.as_str() {
        "" => "is no name",
        "x" | "y" | "z" => "is the name of a coordinate",
        own if others.any(|other| other.name == own) => "is there twice",
        _ => return Ok(()),
    };
    Err(Error::Usage(format!("attribute {name:?}: {wrong}")))
}

impl PointSource for Arrays<'_> {
    fn len(&self) -> u64 {
        self.coordinates.len()
    }

    fn precision(&self) -> Precision {
        self.coordinates.precision()
    }

    fn attributes(&self) -> Vec<Attribute> {
        self.attributes.iter().map(|(attribute, _)| attribute.clone()).collect()
    }

    fn read(&self, range: Range<u64>, out: &mut PointBuffer) -> Result<()> {
        self.coordinates.read(range.clone(), out)?;
        if !self.attributes.is_empty() {
            for i in range.start as usize..range.end as usize {
                for (attribute, values) in &self.attributes {
                    let bytes = attribute.scalar.bytes();
                    out.extend_attributes(&values.bytes()[i * bytes..(i + 1) * bytes]);
                }
            }
        }
        Ok(())
    }
}

/// A source, as the other formats are.
pub(crate) struct SourceFormat<'a> {
    source: &'a dyn PointSource,
    attributes: Vec<Attribute>,
}

impl std::fmt::Debug for SourceFormat<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SourceFormat").field("attributes", &self.attributes).finish_non_exhaustive()
    }
}

impl<'a> SourceFormat<'a> {
    /// The source as a format.
    ///
    /// # Errors
    /// [`Error::Usage`] if two of its attributes have one name, or one has none, or that of a coordinate.
    pub fn new(source: &'a dyn PointSource) -> Result<SourceFormat<'a>> {
        let mut attributes: Vec<Attribute> = Vec::new();
        for given in source.attributes() {
            let attribute = Attribute::new(&given.name, given.scalar);
            may_be_named(&given.name, &attribute, attributes.iter())?;
            attributes.push(attribute);
        }
        Ok(SourceFormat { source, attributes })
    }
}

impl PointFormat for SourceFormat<'_> {
    fn precision(&self) -> Precision {
        self.source.precision()
    }

    fn attributes(&self) -> &[Attribute] {
        &self.attributes
    }

    fn cut(&self, schema: &Schema) -> Result<Box<dyn BlockCutter<'_> + '_>> {
        let own = Schema::new(self.attributes.clone());
        let carrying = (own != *schema).then(|| Carrying::between(&own, schema));
        Ok(Box::new(Cutter { format: self, own: own.stride(), carrying, at: 0, count: self.source.len() }))
    }
}

struct Cutter<'a> {
    format: &'a SourceFormat<'a>,
    /// Bytes of a record of the source's own.
    own: usize,
    /// How it becomes one of the cloud's, if that is not the same.
    carrying: Option<Carrying>,
    at: u64,
    count: u64,
}

impl<'a> BlockCutter<'a> for Cutter<'a> {
    fn next(&mut self) -> Result<Option<Box<dyn Decode + 'a>>> {
        if self.at == self.count {
            return Ok(None);
        }
        let range = self.at..self.count.min(self.at + BLOCK_RECORDS as u64);
        self.at = range.end;
        let (source, own, carrying) = (self.format.source, self.own, self.carrying.clone());
        Ok(Some(Box::new(Piece { source, range, own, carrying })))
    }
}

struct Piece<'a> {
    source: &'a dyn PointSource,
    range: Range<u64>,
    own: usize,
    carrying: Option<Carrying>,
}

impl Decode for Piece<'_> {
    fn decode(&self, batch: &mut Batch) -> Result<()> {
        let mut records = Vec::new();
        let out = match self.carrying {
            None => &mut batch.attributes,
            Some(_) => &mut records,
        };
        self.source.read(self.range.clone(), &mut PointBuffer { points: &mut batch.points, records: out })?;
        let (expected, found) = (self.range.end - self.range.start, batch.points.len() as u64);
        if expected != found || out.len() as u64 != expected * self.own as u64 {
            let (start, end, bytes) = (self.range.start, self.range.end, out.len());
            return Err(Error::Source(
                format!(
                    "points {start} to {end}: expected {expected} points with {} bytes of attributes each, found {found} with {bytes} bytes in all",
                    self.own
                )
                .into(),
            ));
        }
        if let Some(carrying) = &self.carrying
            && carrying.stride() > 0
        {
            if self.own == 0 {
                (0..expected).for_each(|_| carrying.carry(&[], &mut batch.attributes));
            } else {
                records.chunks_exact(self.own).for_each(|record| carrying.carry(record, &mut batch.attributes));
            }
        }
        Ok(())
    }
}
