//! The places that a cloud's points were scanned from, and which point was from where.

use super::{Carried, Cloud};
use crate::error::{Error, Result};
use crate::points::scalar::{Endian, Reader, reader};
use crate::points::seen_from::{SCAN, SeenFrom};
use crate::points::{Batch, Points};

/// The places that a cloud's points were scanned from, and which point was from where.
#[derive(Debug)]
pub struct Places {
    /// Each place once, in a stated order.
    pub places: Vec<[f64; 3]>,
    /// Of what was read of a point, where its scan's number lies and how it is read; and of each source, whether its points have one.
    scan: Option<(Number, Vec<bool>)>,
    from: SeenFrom,
}

#[derive(Debug)]
struct Number {
    offset: usize,
    stride: usize,
    read: Reader,
    name: &'static str,
}

impl Cloud<'_> {
    /// Where the points were scanned from; no places if that is not known.
    pub fn places(&self) -> Places {
        let from = self.seen_from.clone();
        let mut places = match &from {
            SeenFrom::AsTold => self.stations().flatten().collect(),
            SeenFrom::Unknown => Vec::new(),
            SeenFrom::Place(place) => vec![*place],
            SeenFrom::Scans(places) => places.values().copied().collect::<Vec<[f64; 3]>>(),
        };
        places.sort_unstable_by_key(|place| place.map(f64::to_bits));
        places.dedup_by_key(|place| place.map(f64::to_bits));
        let name = SCAN.into_iter().find(|name| self.has_attribute(name));
        let number = name.filter(|_| matches!(from, SeenFrom::Scans(_))).and_then(|name| {
            let schema = self.schema_of(&[name]);
            let column = schema.column(name)?;
            let read = reader(column.scalar, Endian::NATIVE);
            Some(Number { offset: column.offset, stride: schema.stride(), read, name })
        });
        let scan = number.map(|number| {
            let has = self.formats.iter().map(|format| format.attributes().iter().any(|a| a.name == number.name));
            let has = has.collect();
            (number, has)
        });
        Places { places, scan, from }
    }

    /// Whether what is said of where points were scanned from can be used.
    ///
    /// # Errors
    /// [`Error::InvalidSetting`] if scans' places are given and no file has numbers of scans.
    pub(super) fn check_places(&self) -> Result<()> {
        let told = SCAN.iter().any(|name| self.has_attribute(name));
        if matches!(self.seen_from, SeenFrom::Scans(_)) && !told {
            let message =
                "`seen_from`: no file has the attribute scan or point_source_id, by which points know their scan";
            return Err(Error::setting("seen_from", message.into()));
        }
        Ok(())
    }
}

impl Places {
    /// What must be read of points for [`Places::each`].
    pub fn carried(&self) -> Carried {
        match &self.scan {
            Some((Number { name: "scan", .. }, _)) => Carried::Only(&["scan"]),
            Some(_) => Carried::Only(&["point_source_id"]),
            None => Carried::Coordinates,
        }
    }

    /// Tells of each point of a batch whose place is known, with the place's number.
    pub fn each(&self, batch: &Batch, mut tell: impl FnMut([f64; 3], usize)) {
        let numbered = |place: &[f64; 3]| {
            let bits = place.map(f64::to_bits);
            self.places.binary_search_by_key(&bits, |known| known.map(f64::to_bits)).ok()
        };
        let mut of = |place_of: &mut dyn FnMut(usize) -> Option<usize>| match &batch.points {
            Points::Single(points) => points.iter().enumerate().for_each(|(i, p)| {
                if let Some(place) = place_of(i) {
                    tell(p.map(f64::from), place);
                }
            }),
            Points::Double(points) => points.iter().enumerate().for_each(|(i, p)| {
                if let Some(place) = place_of(i) {
                    tell(*p, place);
                }
            }),
        };
        match &self.from {
            SeenFrom::AsTold => {
                if let Some(place) = batch.station.as_ref().and_then(numbered) {
                    of(&mut |_| Some(place));
                }
            }
            SeenFrom::Unknown => {}
            SeenFrom::Place(_) => of(&mut |_| Some(0)),
            SeenFrom::Scans(scans) => {
                let Some((number, has)) = &self.scan else { return };
                if !has[batch.source] {
                    return;
                }
                // Points of a scan mostly follow each other.
                let mut last = (i64::MIN, None);
                of(&mut |i| {
                    let scan = (number.read)(&batch.attributes[i * number.stride + number.offset..]) as i64;
                    if last.0 != scan {
                        last = (scan, scans.get(&scan).and_then(numbered));
                    }
                    last.1
                });
            }
        }
    }
}
