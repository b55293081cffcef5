//! The side-car of a raw file: `huge.bin.json` describes `huge.bin`.
//!
//! ```json
//! {"version": 1, "fields": [["x", "f4"], ["y", "f4"], ["z", "f4"], ["_", "V4"]], "endian": "le", "skip": 0,
//!  "scale": [0.01, 0.01, 0.01], "offset": [0, 0, 0], "srs": "EPSG:25832", "count": 1000}
//! ```
//!
//! `fields` are pairs of name and numpy type (`f4 f8 i1 … u8`, `V4` or the name `_` for bytes to skip), so numpy's
//! `dtype.descr` can be stored as it is; a `<` or `>` before a type must agree with `endian`. Everything else may be
//! missing. `srs` names the coordinate reference system, as `EPSG:` and a code or as WKT. Unknown keys are refused: a misspelt `scale` would move the
//! cloud without a word.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::layout::{Field, Layout};
use super::records::Transform;
use crate::error::{Error, Result};
use crate::points::crs::Crs;
use crate::points::scalar::{Endian, Scalar};

/// The longest side-car read; a real one has some hundred bytes.
const MAX_BYTES: u64 = 1 << 16;

/// What a side-car says, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Sidecar {
    /// The record.
    pub layout: Layout,
    /// Byte order of the numbers.
    pub endian: Endian,
    /// Bytes before the first record.
    pub skip: u64,
    /// Number of records, if stated.
    pub count: Option<u64>,
    /// The coordinate reference system, if stated.
    pub crs: Option<Crs>,
    scale: Option<[f64; 3]>,
    offset: Option<[f64; 3]>,
}

/// The file as it is written.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    #[serde(default = "current_version")]
    version: u32,
    fields: Vec<(String, String)>,
    endian: Option<String>,
    #[serde(default)]
    skip: u64,
    scale: Option<[f64; 3]>,
    offset: Option<[f64; 3]>,
    srs: Option<String>,
    count: Option<u64>,
}

fn current_version() -> u32 {
    1
}

impl Sidecar {
    /// The name of the side-car of `path`.
    pub fn path_for(path: &Path) -> PathBuf {
        let mut name = path.as_os_str().to_owned();
        name.push(".json");
        PathBuf::from(name)
    }

    /// The side-car of the raw file `path`, if there is one.
    ///
    /// # Errors
    /// [`Error::Malformed`] if it is not as described above.
    pub fn beside(path: &Path) -> Result<Option<Sidecar>> {
        let path = Sidecar::path_for(path);
        // Asked first: opening a pipe would wait for a writer.
        if std::fs::metadata(&path).is_ok_and(|there| !there.is_file()) {
            return Err(Error::io(&path, "read")(std::io::Error::new(
                std::io::ErrorKind::InvalidInput,
                "it is not a regular file",
            )));
        }
        let file = match File::open(&path) {
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            opened => opened.map_err(Error::io(&path, "open"))?,
        };
        let mut text = Vec::new();
        file.take(MAX_BYTES + 1).read_to_end(&mut text).map_err(Error::io(&path, "read"))?;
        if text.len() as u64 > MAX_BYTES {
            return Err(Error::malformed(&path, "length", format_args!("at most {MAX_BYTES} bytes"), "more"));
        }
        let document: Document = serde_json::from_slice(&text).map_err(|e| {
            let place = format!("line {}", e.line());
            Error::malformed(&path, place, "the description of a raw file, or `layout` to do without", e)
        })?;
        Sidecar::checked(document)
            .map(Some)
            .map_err(|(expected, found)| Error::malformed(&path, "side-car", expected, found))
    }

    /// Scale and offset, where there are any.
    pub fn transform(&self) -> Option<Transform> {
        (self.scale.is_some() || self.offset.is_some())
            .then(|| Transform { scale: self.scale.unwrap_or([1.0; 3]), offset: self.offset.unwrap_or([0.0; 3]) })
    }

    /// The text of a side-car for records of x, y and z in little-endian `scalar`s.
    pub fn describing(scalar: Scalar, count: u64) -> String {
        let kind = if scalar == Scalar::F64 { "f8" } else { "f4" };
        let fields = ["x", "y", "z"].map(|axis| (axis.to_string(), kind.to_string())).to_vec();
        let endian = Some("le".to_string());
        let document =
            Document { version: 1, fields, endian, skip: 0, scale: None, offset: None, srs: None, count: Some(count) };
        let mut value = serde_json::to_value(document).expect("strings and numbers are JSON");
        if let Some(map) = value.as_object_mut() {
            map.retain(|_, value| !value.is_null());
        }
        value.to_string()
    }

    fn checked(document: Document) -> std::result::Result<Sidecar, (String, String)> {
        if document.version != 1 {
            return Err(("version 1".to_string(), document.version.to_string()));
        }
        let mut endian = match document.endian.as_deref() {
            None => None,
            Some(text) => Some(text.parse().map_err(|_| ("endian \"le\" or \"be\"".to_string(), format!("{text:?}")))?),
        };
        let mut fields = Vec::new();
        for (name, kind) in document.fields {
            fields.push(field(name, &kind, &mut endian)?);
        }
        let layout = Layout::new(fields).map_err(|e| ("fields that make a record".to_string(), e.to_string()))?;
        for (key, values) in [("scale", document.scale), ("offset", document.offset)] {
            if let Some(bad) = values.iter().flatten().find(|v| !v.is_finite() || (key == "scale" && **v == 0.0)) {
                return Err((format!("usable numbers as {key}"), bad.to_string()));
            }
        }
        let Document { skip, count, scale, offset, srs, .. } = document;
        let crs = srs.as_deref().and_then(Crs::parse);
        Ok(Sidecar { layout, endian: endian.unwrap_or_default(), skip, count, crs, scale, offset })
    }
}

/// One field from its name and numpy type; a byte order in the type settles `endian`, or must agree with it.
fn field(name: String, kind: &str, endian: &mut Option<Endian>) -> std::result::Result<Field, (String, String)> {
    let stated = match kind.as_bytes().first() {
        Some(b'<') => Some(Endian::Little),
        Some(b'>') => Some(Endian::Big),
        _ => None,
    };
    if stated.is_some_and(|stated| stated != *endian.get_or_insert(stated)) {
        return Err(("one byte order for all fields".to_string(), format!("{name} as {kind:?}")));
    }
    let bare = kind.trim_start_matches(['<', '>', '|', '=']);
    if let Some(bytes) = bare.strip_prefix('V').and_then(|count| count.parse().ok()) {
        return Ok(Field::Skipped(bytes));
    }
    let scalar = Scalar::of_numpy(bare)
        .ok_or_else(|| ("a numpy type such as f4, f8, i4, u2".to_string(), format!("{name} as {kind:?}")))?;
    Ok(if name == "_" { Field::Skipped(scalar.bytes()) } else { Field::Number { name, scalar } })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Sidecar> {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("a.bin.json"), text).unwrap();
        Sidecar::beside(&dir.path().join("a.bin")).map(Option::unwrap)
    }

    const FULL: &str = r#"{"version":1,"fields":[["x","f4"],["y","f4"],["z","f4"],["_","u2"],["pad","V6"]],"endian":"be",
        "skip":16,"scale":[1,1,0.5],"offset":[1,2,3],"srs":"EPSG:25832","count":7}"#;

    #[test]
    fn every_key_is_understood() {
        let sidecar = read(FULL).unwrap();
        assert_eq!(sidecar.layout.to_string(), "xyz,_:2,_:6");
        assert_eq!((sidecar.endian, sidecar.skip, sidecar.count), (Endian::Big, 16, Some(7)));
        assert_eq!(sidecar.crs, Crs::parse("EPSG:25832"));
        assert_eq!(sidecar.transform(), Some(Transform { scale: [1.0, 1.0, 0.5], offset: [1.0, 2.0, 3.0] }));
    }

    #[test]
    fn numpy_descriptions_carry_the_byte_order() {
        let sidecar = read(r#"{"fields":[["x",">f8"],["y",">f8"],["z",">f8"],["ring","|u1"]]}"#).unwrap();
        assert_eq!((sidecar.endian, sidecar.layout.stride(), sidecar.transform()), (Endian::Big, 25, None));
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (text, part) in [
            (r#"{"fields":[["x","f4"],["y","f4"]]}"#, "one field z"),
            (r#"{"fields":[["x","<f4"],["y",">f4"],["z","<f4"]]}"#, "one byte order"),
            (r#"{"fields":[["x","f2"],["y","f4"],["z","f4"]]}"#, "x as \"f2\""),
            (r#"{"version":2,"fields":[]}"#, "version 1"),
            (r#"{"fields":[["x","f4"],["y","f4"],["z","f4"]],"scales":[1,1,1]}"#, "scales"),
            (r#"{"fields":[["x","f4"],["y","f4"],["z","f4"]],"scale":[1,0,1]}"#, "usable numbers as scale"),
            (r#"{"fields":[["x","f4"],["y","f4"],["z","f4"]],"endian":"middle"}"#, "middle"),
            ("[1]", "`layout` to do without"),
        ] {
            let error = read(text).unwrap_err().to_string();
            assert!(error.contains(part), "{text}: {error}");
        }
        assert!(read(&" ".repeat(MAX_BYTES as usize + 1)).unwrap_err().to_string().contains("at most 65536 bytes"));
    }

    #[test]
    fn no_prefix_of_a_side_car_is_a_side_car() {
        for end in 0..FULL.len() {
            assert!(read(&FULL[..end]).is_err(), "prefix of {end} bytes");
        }
    }

    #[test]
    fn what_is_described_is_read() {
        let sidecar = read(&Sidecar::describing(Scalar::F64, 9)).unwrap();
        assert_eq!((sidecar.layout.to_string().as_str(), sidecar.count), ("xyz:f64", Some(9)));
    }
}
