//! Where coordinates lie on Earth: from a reference system to metres from the Earth's centre, and to a frame on its surface.
//!
//! ```text
//!  coordinates ─► metres ─► longitude, latitude, height ─► metres from the centre ─► those of WGS 84 ─► east, north, up of a place
//!         units   projection             system's ellipsoid                  shift
//! ```
//!
//! Every place goes this way by itself, in double precision: one transform for all would be wrong, since the Earth falls away by 8 m over 10 km. Heights are
//! taken as heights above the ellipsoid, plus an offset; no geoid is known here. Results have the same bits on every machine.

mod definition;
mod ellipsoid;
mod frame;
mod projection;
#[cfg(test)]
mod tests;

use self::definition::{Shift, Words};
use self::ellipsoid::Ellipsoid;
pub use self::frame::{Frame, Site};
use self::projection::Projection;
use super::crs::Crs;
use crate::error::{Error, Result};

/// A reference system's way to the Earth.
#[derive(Debug, Clone)]
pub struct Earth {
    kind: Kind,
    ellipsoid: Ellipsoid,
    shift: Shift,
    /// Metres of a unit on the map, and of one of heights.
    units: [f64; 2],
    /// Added to heights, in metres.
    offset: f64,
    /// What the system is called in messages.
    name: String,
}

/// What coordinates are.
#[derive(Debug, Clone, Copy)]
enum Kind {
    /// Metres from the Earth's centre.
    Centred,
    /// Longitude and latitude in degrees.
    Degrees,
    /// Lengths on a map.
    Map {
        projection: Projection,
        /// The projection may be of a sphere where the system's ellipsoid is none.
        ellipsoid: Ellipsoid,
        /// Radians from Greenwich to the map's middle.
        meridian: f64,
        /// What the map adds to eastings and northings, in metres.
        added: [f64; 2],
        /// Whether coordinates go to the west and the south.
        turned: bool,
    },
}

impl Earth {
    /// The way from `crs`; `offset` metres are added to heights, such as the geoid's height above the ellipsoid.
    ///
    /// # Errors
    /// [`Error::InvalidSetting`] if the system has no EPSG code that is known, or its projection, its units or its shift to WGS 84 are not.
    pub fn of(crs: &Crs, offset: f64) -> Result<Earth> {
        let refused = |why: &str| {
            let way = "reproject the points to a system that is, as EPSG:25832, or name the right one with `crs`; `crs` none makes a tileset in the mesh's own coordinates";
            Error::setting("crs", format!("`crs` {crs}: {why}; {way}"))
        };
        if !offset.is_finite() {
            return Err(Error::setting("height_offset", format!("`height_offset` {offset}: expected metres")));
        }
        let code = crs.epsg.and_then(|code| u16::try_from(code).ok());
        let Some(definition) = code.and_then(crs_definitions::from_code) else {
            return Err(refused("it has no EPSG code that is known here, so its place on Earth is not known"));
        };
        let words = Words(definition.proj4);
        let shift = crs.shift().and_then(|numbers| Shift::of(&numbers)).or_else(|| words.shift());
        let Some(shift) = shift else {
            let why = "its shift to WGS 84 is not known here (WKT with TOWGS84 tells it)";
            return Err(refused(why));
        };
        let (Some(own), Some(meridian)) = (words.ellipsoid(), words.meridian()) else {
            return Err(refused("its ellipsoid or its meridian is not known here"));
        };
        let ellipsoid = if words.word("nadgrids") == Some("@null") { Ellipsoid::wgs84() } else { own };
        let on_map = crs.map_unit(words.unit());
        let kind = match words.word("proj") {
            Some("geocent") => Kind::Centred,
            Some("longlat") if meridian == 0.0 => Kind::Degrees,
            Some("longlat") => return Err(refused("its angles are not counted from Greenwich")),
            _ => {
                let (Some(projection), Some(middle)) = (Projection::of(&words, &own), words.middle()) else {
                    return Err(refused("its projection is not known here"));
                };
                let turned = match words.word("axis") {
                    None => false,
                    Some("wsu") => true,
                    Some(_) => return Err(refused("its axes are not known here")),
                };
                let meridian = (middle + meridian).to_radians();
                Kind::Map { projection, ellipsoid: own, meridian, added: words.added(), turned }
            }
        };
        let on_map = match kind {
            Kind::Degrees => Some(1.0),
            _ => on_map,
        };
        let heights = match kind {
            Kind::Degrees => crs.unit_of_heights(words.height_unit().or(Some(1.0))),
            _ => crs.unit_of_heights(words.height_unit().or(on_map)),
        };
        let (Some(on_map), Some(heights)) = (on_map, heights) else {
            return Err(refused("its units are not known here"));
        };
        Ok(Earth { kind, ellipsoid, shift, units: [on_map, heights], offset, name: crs.to_string() })
    }

    /// Metres from the Earth's centre.
    ///
    /// # Errors
    /// [`Error::Usage`] for a place that the system does not have.
    pub fn centred(&self, place: [f64; 3]) -> Result<[f64; 3]> {
        let refused = || {
            let (name, [x, y, z]) = (&self.name, place);
            Error::Usage(format!(
                "{x} {y} {z}: is no place of the reference system {name}; name the right one with `crs`"
            ))
        };
        let [x, y, z] = place;
        let [map, heights] = self.units;
        let height = z * heights + self.offset;
        let [longitude, latitude] = match &self.kind {
            Kind::Centred => {
                let place = [x * map, y * map, z * map];
                let [longitude, latitude, height] = self.ellipsoid.placed(place);
                let raised = match self.offset == 0.0 {
                    true => place,
                    false => self.ellipsoid.centred(longitude, latitude, height + self.offset),
                };
                return Ok(self.shift.applied(raised));
            }
            Kind::Degrees if x.abs() <= 360.0 && y.abs() <= 90.0 => [x.to_radians(), y.to_radians()],
            Kind::Degrees => return Err(refused()),
            Kind::Map { projection, ellipsoid, meridian, added, turned } => {
                let sign = if *turned { -1.0 } else { 1.0 };
                let [east, north] =
                    [(sign * x * map - added[0]) / ellipsoid.a, (sign * y * map - added[1]) / ellipsoid.a];
                let [longitude, latitude] = projection.back(ellipsoid, east, north).ok_or_else(refused)?;
                [longitude + meridian, latitude]
            }
        };
        let centred = self.shift.applied(self.ellipsoid.centred(longitude, latitude, height));
        if centred.iter().all(|c| c.is_finite()) { Ok(centred) } else { Err(refused()) }
    }
}
