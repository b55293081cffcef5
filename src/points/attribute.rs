//! Attributes: what points carry besides their coordinates.
//!
//! ```text
//!   a file's record   x y z  intensity:u16  red:u8 green:u8 blue:u8  (and others that nobody wants)
//!                                 |            |       |       |
//!                                 v            v       v       v        Carrying: copied, or converted to the cloud's type
//!   a point's record        [ intensity:u16 | red:u8 | green:u8 | blue:u8 ]   Schema: packed, native byte order
//! ```
//!
//! All points of a cloud have records of one schema; what a file does not have is zero. A fitted vertex gets the record of its point, byte for byte.

use std::fmt;
use std::str::FromStr;

use crate::error::{Error, Result};
use crate::points::scalar::{Column, Endian, Reader, Scalar, reader};

/// One attribute.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Attribute {
    /// Its name, the same whatever a file calls it: `intensity`, `red`, `classification`.
    pub name: String,
    /// Its type.
    pub scalar: Scalar,
}

impl Attribute {
    /// An attribute that a file calls `name`.
    pub fn new(name: &str, scalar: Scalar) -> Attribute {
        Attribute { name: canonical(name), scalar }
    }
}

/// The names that attributes go by, and what files call them as well, in lower case and without underscores.
const ALIASES: [(&str, &[&str]); 12] = [
    ("intensity", &["i", "reflectance"]),
    ("red", &["r", "diffusered"]),
    ("green", &["g", "diffusegreen"]),
    ("blue", &["b", "diffuseblue"]),
    ("time", &["t"]),
    ("classification", &["class", "label"]),
    ("return_number", &["returnnumber"]),
    ("number_of_returns", &["numberofreturns", "numreturns"]),
    ("gps_time", &["gpstime"]),
    ("scan_angle", &["scananglerank", "scanangle"]),
    ("point_source_id", &["pointsourceid", "pointsource"]),
    ("user_data", &["userdata"]),
];

/// The name that an attribute goes by, whatever a file calls it: in lower case, without what CloudCompare puts before it.
pub fn canonical(name: &str) -> String {
    let lower: String = name.trim().to_lowercase().split_whitespace().collect::<Vec<_>>().join("_");
    let own = lower.strip_prefix("scalar_").unwrap_or(&lower);
    let bare: String = own.chars().filter(|c| *c != '_').collect();
    let known = ALIASES.iter().find(|(_, others)| others.contains(&bare.as_str()));
    known.map_or_else(|| own.to_string(), |(name, _)| (*name).to_string())
}

/// Names that are no attributes: coordinates; normals, which say nothing that the mesh does not; and marks of points that do not count anyway.
const LEFT_OUT: [&str; 11] =
    ["x", "y", "z", "nx", "ny", "nz", "normal_x", "normal_y", "normal_z", "curvature", "withheld"];

/// The most bytes that a point's attributes may take: buckets are filled in pieces of 12 KiB or more, and a piece holds a point.
pub const MOST_BYTES: usize = 8 << 10;

/// Which attributes are carried to the mesh.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum Wanted {
    /// All that any of the files has, but normals and the marks of withheld points.
    #[default]
    All,
    /// None.
    None,
    /// These; all of them must be there.
    Named(Vec<String>),
}

impl FromStr for Wanted {
    type Err = Error;

    fn from_str(text: &str) -> Result<Wanted> {
        match text {
            "all" => Ok(Wanted::All),
            "none" => Ok(Wanted::None),
            names => Wanted::named(names.split(',')),
        }
    }
}

impl Wanted {
    /// These, by whatever names files call them; `rgb` is for `red`, `green` and `blue`.
    ///
    /// # Errors
    /// [`Error::Usage`] for a name that no attribute has.
    #[doc(hidden)]
    pub fn named<'a>(names: impl IntoIterator<Item = &'a str>) -> Result<Wanted> {
        let mut out: Vec<String> = Vec::new();
        for name in names.into_iter().map(str::trim) {
            let spelt: &[&str] = if name.eq_ignore_ascii_case("rgb") { &["red", "green", "blue"] } else { &[name] };
            for name in spelt.iter().map(|name| canonical(name)) {
                if name.is_empty() || ["x", "y", "z"].contains(&name.as_str()) {
                    return Err(Error::Usage(format!("attributes: {name:?} is no attribute's name")));
                }
                if !out.contains(&name) {
                    out.push(name);
                }
            }
        }
        Ok(Wanted::Named(out))
    }

    /// The wanted ones of the attributes that files have, each once, in a type that holds every file's values.
    ///
    /// # Errors
    /// [`Error::InvalidSetting`] if one that is named is in no file, or if they take more than 8 KiB.
    #[doc(hidden)]
    pub fn of<'a>(&self, files: impl IntoIterator<Item = &'a [Attribute]>) -> Result<Schema> {
        let mut all: Vec<Attribute> = Vec::new();
        for attribute in files.into_iter().flatten() {
            match all.iter_mut().find(|known| known.name == attribute.name) {
                Some(known) => known.scalar = known.scalar.union(attribute.scalar),
                None => all.push(attribute.clone()),
            }
        }
        let attributes = match self {
            Wanted::None => Vec::new(),
            Wanted::All => all.into_iter().filter(|a| !LEFT_OUT.contains(&a.name.as_str())).collect(),
            Wanted::Named(names) => {
                let find =
                    |name: &String| all.iter().find(|a| a.name == *name).cloned().ok_or_else(|| absent(name, &all));
                names.iter().map(find).collect::<Result<_>>()?
            }
        };
        let schema = Schema { attributes };
        if schema.stride() > MOST_BYTES {
            return Err(Error::setting(
                "attributes",
                format!(
                    "`attributes`: the {} attributes of a point take {} bytes, more than {MOST_BYTES}; name those to carry, or none",
                    schema.attributes.len(),
                    schema.stride()
                ),
            ));
        }
        Ok(schema)
    }
}

fn absent(name: &str, all: &[Attribute]) -> Error {
    let names: Vec<&str> = all.iter().map(|a| a.name.as_str()).collect();
    let there = if names.is_empty() { "none".to_string() } else { names.join(", ") };
    Error::setting("attributes", format!("`attributes`: no file has {name}; there are: {there}"))
}

/// The attributes of a cloud's points, in the order in which a point's record holds them.
#[derive(Debug, Clone, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
pub struct Schema {
    attributes: Vec<Attribute>,
}

impl Schema {
    /// A schema of these, in this order.
    pub fn new(attributes: Vec<Attribute>) -> Schema {
        Schema { attributes }
    }

    /// The attributes.
    pub fn attributes(&self) -> &[Attribute] {
        &self.attributes
    }

    /// Bytes of a point's record.
    pub fn stride(&self) -> usize {
        self.attributes.iter().map(|a| a.scalar.bytes()).sum()
    }

    /// Where an attribute lies in a record.
    pub fn column(&self, name: &str) -> Option<Column> {
        self.attributes.iter().position(|a| a.name == name).map(|number| self.column_at(number))
    }

    /// Where the attribute of this number, from 0, lies in a record.
    pub fn column_at(&self, number: usize) -> Column {
        let offset = self.attributes[..number].iter().map(|a| a.scalar.bytes()).sum();
        Column { offset, scalar: self.attributes[number].scalar }
    }

    /// Words for a mesh of this schema whose vertices have no attribute of that name.
    pub fn lacks(&self, name: &str) -> String {
        let there = if self.attributes.is_empty() { "none".to_string() } else { self.to_string() };
        format!("its vertices have no attribute {name}; there are: {there}")
    }

    /// The same with another attribute at the end, if it is not there yet.
    pub fn with(mut self, attribute: &Attribute) -> Schema {
        if self.attributes.iter().all(|a| a.name != attribute.name) {
            self.attributes.push(attribute.clone());
        }
        self
    }
}

impl fmt::Display for Schema {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names: Vec<&str> = self.attributes.iter().map(|a| a.name.as_str()).collect();
        f.write_str(&names.join(", "))
    }
}

/// How the records of a file become those of a schema.
#[derive(Debug, Clone)]
pub struct Carrying {
    steps: Vec<Step>,
    stride: usize,
}

#[derive(Debug, Clone, Copy)]
enum Step {
    /// Bytes as they are.
    Copied { from: usize, bytes: usize },
    /// A number's bytes in reverse.
    Swapped { from: usize, bytes: usize },
    /// A number as another type.
    Converted { from: usize, read: Reader, to: Scalar },
    /// Nothing the file has.
    Zero { bytes: usize },
}

impl Carrying {
    /// From records in which `column` tells where an attribute lies.
    pub fn new(schema: &Schema, endian: Endian, column: impl Fn(&str) -> Option<Column>) -> Carrying {
        let mut steps: Vec<Step> = Vec::new();
        for Attribute { name, scalar } in schema.attributes() {
            let bytes = scalar.bytes();
            let step = match column(name) {
                None => Step::Zero { bytes },
                Some(own) if own.scalar == *scalar && (endian == Endian::NATIVE || bytes == 1) => {
                    Step::Copied { from: own.offset, bytes }
                }
                Some(own) if own.scalar == *scalar => Step::Swapped { from: own.offset, bytes },
                Some(own) => Step::Converted { from: own.offset, read: reader(own.scalar, endian), to: *scalar },
            };
            // Neighbours are copied at once.
            match (steps.last_mut(), step) {
                (Some(Step::Copied { from, bytes: before }), Step::Copied { from: next, bytes })
                    if *from + *before == next =>
                {
                    *before += bytes;
                }
                _ => steps.push(step),
            }
        }
        Carrying { steps, stride: schema.stride() }
    }

    /// From records of another schema, in native byte order.
    pub fn between(own: &Schema, schema: &Schema) -> Carrying {
        Carrying::new(schema, Endian::NATIVE, |name| own.column(name))
    }

    /// Bytes of a record that is made.
    pub fn stride(&self) -> usize {
        self.stride
    }

    /// Appends the record that `record` becomes.
    #[inline]
    pub fn carry(&self, record: &[u8], out: &mut Vec<u8>) {
        for step in &self.steps {
            match *step {
                Step::Copied { from, bytes } => out.extend_from_slice(&record[from..from + bytes]),
                Step::Swapped { from, bytes } => out.extend(record[from..from + bytes].iter().rev()),
                Step::Converted { from, read, to } => to.put(read(&record[from..]), out),
                Step::Zero { bytes } => out.resize(out.len() + bytes, 0),
            }
        }
    }
}

/// How numbers that are read one by one, as from text, become a record of a schema.
#[derive(Debug, Clone)]
pub struct Placing {
    /// For each attribute of the schema: which of the file's numbers it is, and its type.
    places: Vec<(Option<usize>, Scalar)>,
}

impl Placing {
    /// From files whose points have attributes `own`, each with the index of its number.
    pub fn new(schema: &Schema, own: &[(Attribute, usize)]) -> Placing {
        let index = |name: &str| own.iter().find(|(attribute, _)| attribute.name == name).map(|(_, index)| *index);
        Placing { places: schema.attributes().iter().map(|a| (index(&a.name), a.scalar)).collect() }
    }

    /// Whether the number of this index has a place.
    pub fn wants(&self, index: usize) -> bool {
        self.places.iter().any(|(own, _)| *own == Some(index))
    }

    /// The highest index that has a place.
    pub fn last(&self) -> Option<usize> {
        self.places.iter().filter_map(|(own, _)| *own).max()
    }

    /// Bytes of a record.
    pub fn stride(&self) -> usize {
        self.places.iter().map(|(_, scalar)| scalar.bytes()).sum()
    }

    /// Appends the record of a point whose numbers are `values`.
    pub fn place(&self, values: &[f64], out: &mut Vec<u8>) {
        for (index, scalar) in &self.places {
            scalar.put(index.map_or(0.0, |index| values[index]), out);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn attributes(names: &[(&str, Scalar)]) -> Vec<Attribute> {
        names.iter().map(|(name, scalar)| Attribute::new(name, *scalar)).collect()
    }

    #[test]
    fn names_are_the_same_whatever_files_call_them() {
        for (name, expected) in [
            ("Intensity", "intensity"),
            ("scalar_Intensity", "intensity"),
            ("i", "intensity"),
            ("R", "red"),
            ("ReturnNumber", "return_number"),
            ("scalar_GPS Time", "gps_time"),
            ("Classification", "classification"),
            ("my_field", "my_field"),
        ] {
            assert_eq!(canonical(name), expected);
        }
    }

    #[test]
    fn a_point_of_too_many_attributes_is_refused_until_some_are_named() {
        let names: Vec<String> = (0..1025).map(|i| format!("band{i}")).collect();
        let all: Vec<Attribute> = names.iter().map(|name| Attribute::new(name, Scalar::F64)).collect();
        assert_eq!(Wanted::All.of([&all[..1024]]).unwrap().stride(), MOST_BYTES);
        let error = Wanted::All.of([&all[..]]).unwrap_err().to_string();
        assert!(error.contains("the 1025 attributes of a point take 8200 bytes, more than 8192"), "{error}");
        assert_eq!(Wanted::Named(names[..2].to_vec()).of([&all[..]]).unwrap().stride(), 16);
    }

    #[test]
    fn what_is_wanted_is_found_in_a_type_for_all_files() {
        let a = attributes(&[("intensity", Scalar::U8), ("nx", Scalar::F32), ("red", Scalar::U8)]);
        let b = attributes(&[("intensity", Scalar::U16), ("gps_time", Scalar::F64)]);
        let files = || [a.as_slice(), b.as_slice()];
        let all = Wanted::All.of(files()).unwrap();
        assert_eq!(all.to_string(), "intensity, red, gps_time");
        assert_eq!((all.stride(), all.column("red")), (11, Some(Column { offset: 2, scalar: Scalar::U8 })));
        assert_eq!(Wanted::None.of(files()).unwrap(), Schema::default());
        let named: Wanted = "nx, gps_time".parse().unwrap();
        assert_eq!(named.of(files()).unwrap().to_string(), "nx, gps_time");
        let rgb: Wanted = "rgb".parse().unwrap();
        let error = rgb.of(files()).unwrap_err().to_string();
        assert!(error.contains("no file has green") && error.contains("intensity, nx, red, gps_time"), "{error}");
        for bad in ["", "x", "rgb,,i"] {
            assert!(bad.parse::<Wanted>().is_err(), "{bad:?}");
        }
    }

    #[test]
    fn records_are_copied_swapped_converted_and_filled_with_zeros() {
        let own = Schema::new(attributes(&[("a", Scalar::U16), ("b", Scalar::U8), ("c", Scalar::I16)]));
        let wanted = attributes(&[("c", Scalar::F32), ("a", Scalar::U16), ("b", Scalar::U8), ("d", Scalar::U32)]);
        let wanted = Schema::new(wanted);
        for endian in [Endian::Little, Endian::Big] {
            let mut record = Vec::new();
            match endian {
                Endian::Little => record.extend([300u16.to_le_bytes(), [7, 0xfe], [0xff, 0]].concat()),
                Endian::Big => record.extend([300u16.to_be_bytes(), [7, 0xff], [0xfe, 0]].concat()),
            }
            let carrying = Carrying::new(&wanted, endian, |name| own.column(name));
            let mut out = Vec::new();
            carrying.carry(&record, &mut out);
            let mut expected = (-2f32).to_ne_bytes().to_vec();
            expected.extend(300u16.to_ne_bytes());
            expected.extend([7, 0, 0, 0, 0]);
            assert_eq!(out, expected);
            assert_eq!(carrying.stride(), out.len());
        }
    }
}
