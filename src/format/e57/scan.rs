//! A scan as the XML of an E57 file describes it: what its records hold, where it was taken, and how records become points of a schema.

use super::xml::Element;
use crate::points::attribute::{Attribute, Schema};
use crate::points::scalar::Scalar;
use crate::points::{Coordinate, Precision};

/// The most fields of a record.
const MOST_FIELDS: usize = 256;

/// How a number is stored, bit by bit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Stored {
    /// 32 bits.
    Single,
    /// 64 bits.
    Double,
    /// As many bits as the difference of the limits needs; what is stored is what lies above `min`. Of scaled integers, scale and offset.
    Integer { min: i64, max: i64, scaled: Option<(f64, f64)> },
}

impl Stored {
    fn of(field: Element<'_>) -> Result<Stored, String> {
        let wrong = |what: &str, text: &str| format!("{what} {text:?} of {}", field.name());
        fn number<T: std::str::FromStr>(field: Element<'_>, name: &str, otherwise: T) -> Result<T, String> {
            let parse = |text: &str| text.trim().parse().map_err(|_| format!("{name} {text:?} of {}", field.name()));
            field.attribute(name).map_or(Ok(otherwise), parse)
        }
        let kind = field.attribute("type").unwrap_or_default();
        match kind {
            "Float" if field.attribute("precision") == Some("single") => Ok(Stored::Single),
            "Float" => Ok(Stored::Double),
            "Integer" | "ScaledInteger" => {
                let (min, max) = (number(field, "minimum", i64::MIN)?, number(field, "maximum", i64::MAX)?);
                if max < min {
                    return Err(format!("maximum {max} below minimum {min} of {}", field.name()));
                }
                let scaled = if kind == "Integer" {
                    None
                } else {
                    let (scale, offset): (f64, f64) = (number(field, "scale", 1.0)?, number(field, "offset", 0.0)?);
                    if !scale.is_finite() || !offset.is_finite() || scale == 0.0 {
                        return Err(format!("scale {scale} and offset {offset} of {}", field.name()));
                    }
                    Some((scale, offset))
                };
                Ok(Stored::Integer { min, max, scaled })
            }
            _ => Err(wrong("type", kind)),
        }
    }

    /// Bits of a number.
    pub fn bits(self) -> usize {
        match self {
            Stored::Single => 32,
            Stored::Double => 64,
            Stored::Integer { min, max, .. } => (64 - max.wrapping_sub(min).leading_zeros()) as usize,
        }
    }

    /// The number that these bits are.
    fn value(self, bits: u64) -> f64 {
        match self {
            Stored::Single => f64::from(f32::from_bits(bits as u32)),
            Stored::Double => f64::from_bits(bits),
            Stored::Integer { min, scaled, .. } => {
                let integer = min.wrapping_add(bits as i64) as f64;
                scaled.map_or(integer, |(scale, offset)| integer * scale + offset)
            }
        }
    }

    /// The type that holds its numbers.
    fn scalar(self) -> Scalar {
        match self {
            Stored::Single => Scalar::F32,
            Stored::Double | Stored::Integer { scaled: Some(_), .. } => Scalar::F64,
            Stored::Integer { min, max, .. } => {
                let all = [
                    (Scalar::U8, 0, 0xff),
                    (Scalar::U16, 0, 0xffff),
                    (Scalar::U32, 0, 0xffff_ffff),
                    (Scalar::U64, 0, i64::MAX),
                    (Scalar::I8, -0x80, 0x7f),
                    (Scalar::I16, -0x8000, 0x7fff),
                    (Scalar::I32, -0x8000_0000, 0x7fff_ffff),
                ];
                let holds = |&&(_, least, most): &&(Scalar, i64, i64)| least <= min && max <= most;
                all.iter().find(holds).map_or(Scalar::I64, |(scalar, ..)| *scalar)
            }
        }
    }

    /// Its limits, where it has any.
    fn limits(self) -> Option<(f64, f64)> {
        match self {
            Stored::Integer { min, max, scaled } => {
                let value = |v: i64| scaled.map_or(v as f64, |(scale, offset)| v as f64 * scale + offset);
                Some((value(min), value(max)))
            }
            _ => None,
        }
    }
}

/// A field of a record.
#[derive(Debug)]
struct Field {
    name: String,
    stored: Stored,
}

/// A scan.
#[derive(Debug)]
pub struct Scan {
    /// Where its records are; a physical position.
    pub at: u64,
    /// Number of records.
    pub records: u64,
    fields: Vec<Field>,
    /// Rotation (rows) and translation, unless they change nothing.
    pose: Option<([[f64; 3]; 3], [f64; 3])>,
    /// The limits of red, green and blue.
    colours: [Option<(f64, f64)>; 3],
    /// Whether it tells where it was taken from.
    pub place: Place,
}

/// Whether a scan tells where it was taken from: that is where its pose puts the origin of its own coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// It does: by a pose that moves or turns it, or else by coordinates or limits that are ranges and angles from the scanner.
    Told,
    /// It has a pose that changes nothing: the first of several scans, or the pose of a program that knew of none.
    Unmoved,
    /// It does not.
    Unknown,
}

const CARTESIAN: [&str; 3] = ["cartesianX", "cartesianY", "cartesianZ"];
const SPHERICAL: [&str; 3] = ["sphericalRange", "sphericalAzimuth", "sphericalElevation"];
const COLOURS: [&str; 3] = ["colorRed", "colorGreen", "colorBlue"];

/// Attributes, the fields that they are made of, and those that say whether they are there.
const ATTRIBUTES: [(&str, &str, Option<&str>); 7] = [
    ("intensity", "intensity", Some("isIntensityInvalid")),
    ("red", "colorRed", Some("isColorInvalid")),
    ("green", "colorGreen", Some("isColorInvalid")),
    ("blue", "colorBlue", Some("isColorInvalid")),
    ("return_number", "returnIndex", None),
    ("number_of_returns", "returnCount", None),
    ("time", "timeStamp", Some("isTimeStampInvalid")),
];

impl Scan {
    /// The scan that an element of `data3D` describes.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn of(element: Element<'_>) -> Result<Scan, String> {
        let points = element.child("points").ok_or("no points")?;
        let whole = |name: &str| {
            let text = points.attribute(name).unwrap_or_default();
            text.trim().parse::<u64>().map_err(|_| format!("{name} {text:?} of points"))
        };
        let prototype = points.child("prototype").ok_or("no prototype of the points")?;
        if points.child("codecs").is_some_and(|codecs| codecs.children().next().is_some()) {
            return Err("codecs, which no version of the format defines".to_string());
        }
        let field = |field: Element<'_>| Ok(Field { name: field.name().to_string(), stored: Stored::of(field)? });
        let fields = prototype.children().take(MOST_FIELDS + 1).map(field).collect::<Result<Vec<_>, String>>()?;
        if fields.len() > MOST_FIELDS {
            return Err(format!("more than {MOST_FIELDS} fields of a point"));
        }
        let limits = |name: &str| {
            let limits = element.child("colorLimits")?;
            let limit = |end: &str| {
                let text = limits.child(&format!("{name}{end}"))?.text();
                if text.is_empty() { Some(0.0) } else { text.parse::<f64>().ok() }
            };
            Some((limit("Minimum")?, limit("Maximum")?))
        };
        let scan = Scan {
            at: whole("fileOffset")?,
            records: whole("recordCount")?,
            pose: element.child("pose").map(pose).transpose()?.filter(|pose| *pose != STAYING),
            colours: COLOURS.map(|name| {
                let own = fields.iter().find(|field| field.name == name).map(|field| field.stored);
                limits(name).or_else(|| own?.limits()).filter(|(min, max)| max > min)
            }),
            fields,
            place: Place::Unknown,
        };
        let all = |names: [&str; 3]| names.into_iter().all(|name| scan.find(name).is_some());
        if !all(CARTESIAN) && !all(SPHERICAL) {
            return Err("points without cartesian or spherical coordinates".to_string());
        }
        let polar = all(SPHERICAL) || element.child("sphericalBounds").is_some();
        let place = match (scan.pose.is_some() || polar, element.child("pose")) {
            (true, _) => Place::Told,
            (false, Some(_)) => Place::Unmoved,
            (false, None) => Place::Unknown,
        };
        Ok(Scan { place, ..scan })
    }

    /// Where it was taken from, if it tells.
    pub fn station(&self) -> Option<[f64; 3]> {
        (self.place != Place::Unknown).then(|| self.pose.map_or([0.0; 3], |(_, by)| by))
    }

    fn find(&self, name: &str) -> Option<usize> {
        self.fields.iter().position(|field| field.name == name)
    }

    /// Its number of fields.
    pub fn fields(&self) -> usize {
        self.fields.len()
    }

    /// Bits of the numbers of a field.
    pub fn bits(&self, field: usize) -> usize {
        self.fields[field].stored.bits()
    }

    /// The narrowest precision that keeps the coordinates.
    pub fn precision(&self) -> Precision {
        let single = |name: &str| self.find(name).is_some_and(|field| self.fields[field].stored == Stored::Single);
        let exact = self.pose.is_none() && CARTESIAN.into_iter().all(single);
        if exact { Precision::Single } else { Precision::Double }
    }

    /// Whether every field is there once.
    pub fn repeated(&self) -> Option<&str> {
        let names = || self.fields.iter().map(|field| field.name.as_str());
        names().enumerate().find(|(i, name)| names().take(*i).any(|other| other == *name)).map(|(_, name)| name)
    }

    /// Its attributes.
    pub fn attributes(&self) -> Vec<Attribute> {
        let of = |&(name, field, _): &(&str, &str, _)| {
            let stored = self.fields[self.find(field)?].stored;
            let scalar = match COLOURS.iter().position(|colour| *colour == field) {
                Some(colour) => self.colour(colour, stored).0,
                None => stored.scalar(),
            };
            Some(Attribute::new(name, scalar))
        };
        ATTRIBUTES.iter().filter_map(of).collect()
    }

    /// The type of a colour, and its limits. Integers from 0 to 255 stay as they are, and others up to 8 bits become that; all else becomes 16 bits.
    fn colour(&self, colour: usize, stored: Stored) -> (Scalar, (f64, f64)) {
        let (min, max) = self.colours[colour].unwrap_or((0.0, 1.0));
        let narrow = matches!(stored, Stored::Integer { scaled: None, .. }) && max - min <= 255.0;
        (if narrow { Scalar::U8 } else { Scalar::U16 }, (min, max))
    }

    /// How its records become points, and attributes of `schema`. In a file whose colours have `wide` types, all colours are spread over these.
    pub fn reading(&self, schema: &Schema, wide: Scalar) -> Reading {
        let mut reading = Reading {
            fields: Vec::new(),
            coordinates: [0; 3],
            spherical: false,
            valid: None,
            pose: self.pose,
            attributes: Vec::new(),
        };
        reading.spherical = CARTESIAN.into_iter().any(|name| self.find(name).is_none());
        let (names, invalid) =
            if reading.spherical { (SPHERICAL, "sphericalInvalidState") } else { (CARTESIAN, "cartesianInvalidState") };
        let mut take = |name: &str| {
            let field = self.find(name)?;
            let stored = self.fields[field].stored;
            let known = reading.fields.iter().position(|(own, _)| *own == field);
            Some(known.unwrap_or_else(|| {
                reading.fields.push((field, stored));
                reading.fields.len() - 1
            }))
        };
        reading.coordinates = names.map(|name| take(name).expect("a scan has one kind of coordinates"));
        reading.valid = take(invalid);
        for attribute in schema.attributes() {
            let known = ATTRIBUTES.iter().find(|(name, ..)| *name == attribute.name);
            let made = known.and_then(|&(_, field, invalid)| {
                let value = take(field)?;
                let valid = invalid.and_then(&mut take);
                let change = match COLOURS.iter().position(|colour| *colour == field) {
                    Some(colour) => {
                        let stored = self.fields[self.find(field)?].stored;
                        let (_, (min, max)) = self.colour(colour, stored);
                        Change::Spread { min, max, most: if wide == Scalar::U8 { 255.0 } else { 65535.0 } }
                    }
                    // Counted from nought.
                    None if field == "returnIndex" => Change::Next,
                    None => Change::None,
                };
                Some(Made { value, valid, change })
            });
            reading.attributes.push((made, attribute.scalar));
        }
        reading
    }
}

/// A pose that changes nothing.
const STAYING: ([[f64; 3]; 3], [f64; 3]) = ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [0.0; 3]);

/// The rotation, as a matrix, and the translation of a pose.
fn pose(pose: Element<'_>) -> Result<([[f64; 3]; 3], [f64; 3]), String> {
    let number = |of: &str, name: &str, otherwise: f64| {
        let Some(part) = pose.child(of) else { return Ok(otherwise) };
        let text = part.child(name).map_or("", Element::text);
        let value = if text.is_empty() { 0.0 } else { text.parse().unwrap_or(f64::NAN) };
        if f64::is_finite(value) { Ok(value) } else { Err(format!("{name} {text:?} of the {of}")) }
    };
    let [w, x, y, z] = [("w", 1.0), ("x", 0.0), ("y", 0.0), ("z", 0.0)].map(|(name, or)| number("rotation", name, or));
    let (w, x, y, z) = (w?, x?, y?, z?);
    let matrix = [
        [w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), w * w + y * y - x * x - z * z, 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w + z * z - x * x - y * y],
    ];
    let [a, b, c] = ["x", "y", "z"].map(|name| number("translation", name, 0.0));
    Ok((matrix, [a?, b?, c?]))
}

/// How the records of a scan become points, and attributes of a schema.
#[derive(Debug)]
pub struct Reading {
    /// The fields that are needed, and how they are stored.
    pub fields: Vec<(usize, Stored)>,
    /// Which of the columns are coordinates: x, y, z, or range, azimuth, elevation.
    coordinates: [usize; 3],
    spherical: bool,
    /// Which of the columns is 0 where there are coordinates.
    valid: Option<usize>,
    pose: Option<([[f64; 3]; 3], [f64; 3])>,
    attributes: Vec<(Option<Made>, Scalar)>,
}

/// What an attribute is made of.
#[derive(Debug)]
struct Made {
    value: usize,
    /// The field that is 0 where there is a value.
    valid: Option<usize>,
    change: Change,
}

#[derive(Debug)]
enum Change {
    None,
    Next,
    /// From its limits to 0 and `most`, to the nearest whole number.
    Spread {
        min: f64,
        max: f64,
        most: f64,
    },
}

impl Reading {
    /// The point of a record, whose bits are `bits`, and its attributes.
    pub fn point<C: Coordinate>(&self, bits: &[u64], attributes: &mut Vec<u8>) -> [C; 3] {
        let value = |field: usize| self.fields[field].1.value(bits[field]);
        let there = |field: Option<usize>| field.is_none_or(|field| value(field) == 0.0);
        for (made, scalar) in &self.attributes {
            let number = match made {
                Some(Made { value: field, valid, change }) if there(*valid) => match *change {
                    Change::None => value(*field),
                    Change::Next => value(*field) + 1.0,
                    Change::Spread { min, max, most } if (min, max) == (0.0, most) => value(*field),
                    Change::Spread { min, max, most } => ((value(*field) - min) / (max - min) * most).round(),
                },
                _ => 0.0,
            };
            scalar.put(number, attributes);
        }
        // What is no point is dropped later, with all that is not finite.
        if !there(self.valid) {
            return [C::from_f64(f64::NAN); 3];
        }
        let mut point = self.coordinates.map(value);
        if self.spherical {
            let [range, azimuth, elevation] = point;
            let flat = range * libm::cos(elevation);
            point = [flat * libm::cos(azimuth), flat * libm::sin(azimuth), range * libm::sin(elevation)];
        }
        if let Some((rows, by)) = &self.pose {
            let turned = |row: &[f64; 3]| row[0] * point[0] + row[1] * point[1] + row[2] * point[2];
            point = [turned(&rows[0]) + by[0], turned(&rows[1]) + by[1], turned(&rows[2]) + by[2]];
        }
        point.map(C::from_f64)
    }
}
