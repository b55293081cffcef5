//! Which points count: all finite ones, unless classes, returns or a box are asked for.
//!
//! Formats decode whatever a block holds; here, in one place for all of them, points and their attributes are sifted.

use std::sync::Arc;

use crate::error::Result;
use crate::points::attribute::{Attribute, Schema};
use crate::points::bounds::Bounds;
use crate::points::clip::Clip;
use crate::points::scalar::{Endian, Reader, reader};
use crate::points::{Batch, Coordinate, Points};

/// Which points of the input count.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Filter {
    /// Classes whose points are left out.
    pub drop_class: Vec<u8>,
    /// The classes whose points count; all if none is given.
    pub keep_class: Vec<u8>,
    /// Which of a pulse's returns count.
    pub returns: Returns,
    /// The box in which points count, its faces included.
    pub bounds: Option<Bounds>,
    /// The polygons on the map within which points count.
    pub clip: Option<Arc<Clip>>,
    /// What becomes of points that are marked as withheld: deleted, but still in the file.
    pub withheld: Withheld,
}

/// Which of a pulse's returns count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Returns {
    /// All.
    #[default]
    All,
    /// The first one.
    First,
    /// The last one.
    Last,
}

/// What becomes of points that are marked as withheld.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Withheld {
    /// They are left out.
    #[default]
    Dropped,
    /// They count like any other.
    Kept,
}

/// Says which points count by what was found out about all of them.
pub trait Verdict: std::fmt::Debug + Send + Sync {
    /// For each of the points, whether it counts.
    ///
    /// # Errors
    /// Errors of reading what was found out.
    fn judge(&self, points: &Points) -> Result<Vec<bool>>;
}

/// Leaves in a batch the points that count by `verdict`, with their attributes, and counts the others as filtered.
///
/// # Errors
/// Those of the verdict.
pub fn judged(batch: &mut Batch, verdict: &dyn Verdict) -> Result<()> {
    fn left<T: Copy>(points: &mut Vec<T>, counts: &[bool]) {
        let mut counts = counts.iter();
        points.retain(|_| counts.next().is_some_and(|counts| *counts));
    }
    let counts = verdict.judge(&batch.points)?;
    let stride = batch.attributes.len() / counts.len().max(1);
    let mut kept = 0;
    for number in counts.iter().enumerate().filter(|(_, counts)| **counts).map(|(number, _)| number) {
        batch.attributes.copy_within(number * stride..(number + 1) * stride, kept * stride);
        kept += 1;
    }
    batch.attributes.truncate(kept * stride);
    batch.filtered += (counts.len() - kept) as u64;
    match &mut batch.points {
        Points::Single(points) => left(points, &counts),
        Points::Double(points) => left(points, &counts),
    }
    Ok(())
}

/// Whether an attribute must be there for the filter to work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Need {
    /// Points would count or not for want of it.
    Must,
    /// Without it, nothing is marked.
    May,
}

impl Filter {
    /// The attributes it looks at.
    fn needs(&self) -> Vec<(&'static str, Need)> {
        let mut needs = Vec::new();
        if !(self.drop_class.is_empty() && self.keep_class.is_empty()) {
            needs.push(("classification", Need::Must));
        }
        if self.returns != Returns::All {
            needs.push(("return_number", Need::Must));
        }
        if self.returns == Returns::Last {
            needs.push(("number_of_returns", Need::Must));
        }
        if self.withheld == Withheld::Dropped {
            needs.push(("withheld", Need::May));
        }
        needs
    }

    /// What it needs of a file that has these attributes.
    ///
    /// # Errors
    /// What is missing.
    #[doc(hidden)]
    pub fn check(&self, there: &[Attribute]) -> std::result::Result<(), &'static str> {
        let has = |name: &str| there.iter().any(|a| a.name == name);
        match self.needs().into_iter().find(|(name, need)| *need == Need::Must && !has(name)) {
            Some((name, _)) => Err(name),
            None => Ok(()),
        }
    }
}

/// How a pass over the input decodes and sifts.
#[derive(Debug)]
pub struct Sieve {
    /// What is decoded of every point: what is kept, then what only the filter looks at.
    pub decoded: Schema,
    /// The bytes of a decoded record that are kept.
    kept: usize,
    tests: Vec<Test>,
    bounds: Option<Bounds>,
    clip: Option<Arc<Clip>>,
}

/// A number of a point's record, and what it must be.
#[derive(Debug)]
struct Test {
    at: usize,
    read: Reader,
    passes: Passes,
}

#[derive(Debug)]
enum Passes {
    OneOf(Vec<u8>),
    NoneOf(Vec<u8>),
    /// Not less than the number there.
    NotLess(usize, Reader),
}

impl Sieve {
    /// Keeps the attributes of `kept`, of points that `filter` lets through; files have attributes `there`.
    pub fn new<'a>(filter: &Filter, kept: Schema, there: impl Iterator<Item = &'a [Attribute]>) -> Sieve {
        let bytes = kept.stride();
        let mut decoded = kept;
        let there: Vec<&Attribute> = there.flatten().collect();
        for (name, _) in filter.needs() {
            if let Some(attribute) = there.iter().find(|a| a.name == name) {
                decoded = decoded.with(attribute);
            }
        }
        let column = |name: &str| decoded.column(name).map(|c| (c.offset, reader(c.scalar, Endian::NATIVE)));
        let mut tests = Vec::new();
        let mut test = |name: &str, passes: Option<Passes>| {
            if let (Some((at, read)), Some(passes)) = (column(name), passes) {
                tests.push(Test { at, read, passes });
            }
        };
        if !filter.drop_class.is_empty() {
            test("classification", Some(Passes::NoneOf(filter.drop_class.clone())));
        }
        if !filter.keep_class.is_empty() {
            test("classification", Some(Passes::OneOf(filter.keep_class.clone())));
        }
        match filter.returns {
            Returns::All => {}
            Returns::First => test("return_number", Some(Passes::OneOf(vec![1]))),
            Returns::Last => {
                test("return_number", column("number_of_returns").map(|(at, read)| Passes::NotLess(at, read)));
            }
        }
        if filter.withheld == Withheld::Dropped {
            test("withheld", Some(Passes::OneOf(vec![0])));
        }
        Sieve { decoded, kept: bytes, tests, bounds: filter.bounds, clip: filter.clip.clone() }
    }

    /// Leaves in a decoded batch what counts, with the attributes that are kept, and counts the rest.
    ///
    /// # Panics
    /// If there is not a decoded record for each point.
    pub fn sift(&self, batch: &mut Batch) {
        let Batch { points, attributes, dropped, filtered, .. } = batch;
        match points {
            Points::Single(points) => self.sift_points(points, attributes, dropped, filtered),
            Points::Double(points) => self.sift_points(points, attributes, dropped, filtered),
        }
    }

    fn sift_points<C: Coordinate>(
        &self,
        points: &mut Vec<[C; 3]>,
        attributes: &mut Vec<u8>,
        dropped: &mut u64,
        filtered: &mut u64,
    ) {
        let stride = self.decoded.stride();
        assert_eq!(attributes.len(), points.len() * stride, "a record for each point");
        if self.tests.is_empty()
            && self.bounds.is_none()
            && self.clip.is_none()
            && self.kept == stride
            && all_finite(points)
        {
            return;
        }
        let mut left = 0;
        for i in 0..points.len() {
            let record = &attributes[i * stride..(i + 1) * stride];
            if !is_finite(&points[i]) {
                *dropped += 1;
            } else if !self.passes(points[i].map(Into::into), record) {
                *filtered += 1;
            } else {
                points[left] = points[i];
                attributes.copy_within(i * stride..i * stride + self.kept, left * self.kept);
                left += 1;
            }
        }
        points.truncate(left);
        attributes.truncate(left * self.kept);
    }

    fn passes(&self, point: [f64; 3], record: &[u8]) -> bool {
        let inside = self.bounds.is_none_or(|b| (0..3).all(|a| b.min[a] <= point[a] && point[a] <= b.max[a]));
        inside
            && self.clip.as_ref().is_none_or(|clip| clip.holds(point[0], point[1]))
            && self.tests.iter().all(|test| {
                let value = (test.read)(&record[test.at..]);
                match &test.passes {
                    Passes::OneOf(values) => values.iter().any(|v| f64::from(*v) == value),
                    Passes::NoneOf(values) => values.iter().all(|v| f64::from(*v) != value),
                    Passes::NotLess(at, read) => value >= read(&record[*at..]),
                }
            })
    }
}

/// Whether all coordinates are finite: a sum without branches says so.
fn all_finite<C: Coordinate>(points: &[[C; 3]]) -> bool {
    // 0 · v is 0 for finite v and NaN for all others, so the sum is 0 exactly if all are finite.
    let add = |sums: [f64; 3], point: &[C; 3]| [0, 1, 2].map(|axis| sums[axis] + 0.0 * point[axis].into());
    points.iter().fold([0.0; 3], add) == [0.0; 3]
}

fn is_finite<C: Coordinate>(point: &[C; 3]) -> bool {
    point.iter().all(|&c| c.into().is_finite())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::points::scalar::Scalar;

    fn las_like() -> Vec<Attribute> {
        ["intensity", "classification", "return_number", "number_of_returns", "withheld"]
            .map(|name| Attribute::new(name, Scalar::U8))
            .to_vec()
    }

    proptest! {
        #[test]
        fn exactly_the_points_that_count_stay_in_order_with_their_attributes(
            points in prop::collection::vec((any::<[u32; 3]>(), prop::array::uniform5(0u8..4)), 0..50),
            drop_class in prop::collection::vec(0u8..4, 0..3),
            keep_class in prop::collection::vec(0u8..4, 0..3),
            (returns, withheld, boxed) in (0usize..3, any::<bool>(), any::<bool>()),
        ) {
            // Half of the exponents are all ones: NaN or infinite.
            let coordinate = |bits: u32| f32::from_bits(if bits & 16 == 0 { bits | 0x7f80_0000 } else { bits });
            let points: Vec<([f32; 3], [u8; 5])> =
                points.into_iter().map(|(p, record)| (p.map(coordinate), record)).collect();
            let filter = Filter {
                drop_class: drop_class.clone(),
                keep_class: keep_class.clone(),
                returns: [Returns::All, Returns::First, Returns::Last][returns],
                bounds: boxed.then_some(Bounds { min: [-1.0; 3], max: [1e9; 3] }),
                clip: None,
                withheld: if withheld { Withheld::Kept } else { Withheld::Dropped },
            };
            let there = las_like();
            let kept = Schema::new(there[..1].to_vec());
            let sieve = Sieve::new(&filter, kept, std::iter::once(there.as_slice()));
            let at = |record: &[u8; 5], name: &str| record[there.iter().position(|a| a.name == name).unwrap()];
            let mut batch = Batch::new(crate::points::Precision::Single);
            for (point, record) in &points {
                let Points::Single(into) = &mut batch.points else { unreachable!() };
                into.push(*point);
                for attribute in sieve.decoded.attributes() {
                    batch.attributes.push(at(record, &attribute.name));
                }
            }
            sieve.sift(&mut batch);
            let finite = |p: &[f32; 3]| p.iter().all(|c| c.is_finite());
            let counts = |(p, r): &&([f32; 3], [u8; 5])| {
                finite(p)
                    && !drop_class.contains(&r[1])
                    && (keep_class.is_empty() || keep_class.contains(&r[1]))
                    && match returns { 0 => true, 1 => r[2] == 1, _ => r[2] >= r[3] }
                    && (withheld || r[4] == 0)
                    && (!boxed || p.iter().all(|c| (-1.0..=1e9).contains(c)))
            };
            let expected: Vec<_> = points.iter().filter(counts).collect();
            let Points::Single(left) = &batch.points else { unreachable!() };
            prop_assert_eq!(left, &expected.iter().map(|(p, _)| *p).collect::<Vec<_>>());
            prop_assert_eq!(&batch.attributes, &expected.iter().map(|(_, r)| r[0]).collect::<Vec<_>>());
            let infinite = points.iter().filter(|(p, _)| !finite(p)).count();
            prop_assert_eq!(batch.dropped, infinite as u64);
            prop_assert_eq!(batch.filtered, (points.len() - infinite - expected.len()) as u64);
        }
    }

    /// Points above a height count.
    #[derive(Debug)]
    struct Above(f32);

    impl Verdict for Above {
        fn judge(&self, points: &Points) -> Result<Vec<bool>> {
            let Points::Single(points) = points else { unreachable!() };
            Ok(points.iter().map(|point| point[2] > self.0).collect())
        }
    }

    proptest! {
        #[test]
        fn a_verdict_leaves_points_with_their_attributes(heights in prop::collection::vec(0u8..9, 0..60), stride in 0usize..4) {
            let mut batch = Batch::new(crate::points::Precision::Single);
            batch.points = Points::Single(heights.iter().map(|height| [1.0, 2.0, f32::from(*height)]).collect());
            batch.attributes = heights.iter().flat_map(|height| vec![*height; stride]).collect();
            judged(&mut batch, &Above(4.0)).unwrap();
            let high: Vec<u8> = heights.iter().copied().filter(|height| *height > 4).collect();
            prop_assert_eq!(batch.attributes, high.iter().flat_map(|height| vec![*height; stride]).collect::<Vec<_>>());
            prop_assert_eq!(batch.points, Points::Single(high.iter().map(|height| [1.0, 2.0, f32::from(*height)]).collect()));
            prop_assert_eq!(batch.filtered, (heights.len() - high.len()) as u64);
        }
    }

    #[test]
    fn a_filter_asks_for_what_it_looks_at() {
        let only = |filter: Filter, names: &[&str]| {
            let there: Vec<Attribute> = names.iter().map(|n| Attribute::new(n, Scalar::U8)).collect();
            filter.check(&there)
        };
        assert_eq!(only(Filter::default(), &[]), Ok(()));
        assert_eq!(only(Filter { drop_class: vec![7], ..Filter::default() }, &["intensity"]), Err("classification"));
        assert_eq!(only(Filter { drop_class: vec![7], ..Filter::default() }, &["classification"]), Ok(()));
        let last = Filter { returns: Returns::Last, ..Filter::default() };
        assert_eq!(only(last, &["return_number"]), Err("number_of_returns"));
    }
}
