//! Coordinate reference systems: which place on Earth coordinates mean, as far as files say. A cloud has one system,
//! which is carried to the outputs; nothing is reprojected but the vertices of tilesets (`earth`).
//!
//! ```text
//!  LAS   WKT record (2112), else GeoTIFF keys (34735 to 34737)  --+
//!  E57   coordinateMetadata: WKT, or whatever the writer put     --+--> Crs { wkt, epsg, vertical, name }
//!  raw   the side-car's "srs": "EPSG:25832" or WKT               --+
//! ```

use std::fmt;
use std::io::Read;
use std::path::Path;

use crate::error::{Error, Result};
use crate::points::unit::{Measure, Unit};
use crate::points::wkt::Codes;

/// The longest WKT read; real ones have some thousand bytes.
pub const MAX_WKT: usize = 1 << 18;

/// The longest name kept.
const MAX_NAME: usize = 200;

/// A coordinate reference system, as far as a file tells.
#[derive(Debug, Clone, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub struct Crs {
    /// Well-known text, of either version, as the file has it.
    pub wkt: Option<String>,
    /// EPSG code of the system, or of its horizontal part.
    pub epsg: Option<u32>,
    /// EPSG code of the heights.
    pub vertical: Option<u32>,
    /// What it is called.
    pub name: Option<String>,
    /// The unit of its lengths, where GeoTIFF keys tell it; else text and codes do.
    #[serde(skip)]
    pub unit: Option<KeyedUnit>,
    /// The unit of its heights, where GeoTIFF keys tell it.
    #[serde(skip)]
    pub height_unit: Option<KeyedUnit>,
}

/// A unit as GeoTIFF keys tell it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum KeyedUnit {
    /// One that is known here.
    Known(Unit),
    /// Another: what the system's code would say does not hold.
    Other,
}

impl KeyedUnit {
    /// The unit by its EPSG code.
    fn of_code(code: u16) -> KeyedUnit {
        match code {
            1025 => KeyedUnit::Known(Unit::Millimetre),
            1033 => KeyedUnit::Known(Unit::Centimetre),
            9001 => KeyedUnit::Known(Unit::Metre),
            9002 => KeyedUnit::Known(Unit::Foot),
            9003 => KeyedUnit::Known(Unit::SurveyFoot),
            9036 => KeyedUnit::Known(Unit::Kilometre),
            _ => KeyedUnit::Other,
        }
    }

    fn known(self) -> Option<Unit> {
        match self {
            KeyedUnit::Known(unit) => Some(unit),
            KeyedUnit::Other => None,
        }
    }
}

impl Crs {
    /// The system that a text names: `EPSG:25832`, `EPSG:25832+7837` with one of heights, WKT, or anything else, which is then its name. `None` for a text of blanks.
    pub fn parse(text: &str) -> Option<Crs> {
        let text = text.trim_matches(|c: char| c.is_whitespace() || c == '\0');
        if text.is_empty() || text.len() > MAX_WKT {
            return None;
        }
        if let Some(codes) = text.get(..5).filter(|head| head.eq_ignore_ascii_case("EPSG:")).map(|_| &text[5..]) {
            let (map, heights) = codes.split_once('+').map_or((codes, None), |(map, heights)| (map, Some(heights)));
            if let (Ok(epsg), Ok(vertical)) = (map.parse(), heights.map(str::parse).transpose()) {
                return Some(Crs { epsg: Some(epsg), vertical, ..Crs::default() });
            }
        }
        let keyword: String = text.chars().take_while(|c| c.is_ascii_alphabetic() || *c == '_').collect();
        let opens = text[keyword.len()..].trim_start().starts_with(['[', '(']);
        if keyword.is_empty() || !opens {
            return Some(Crs { name: printable(text), ..Crs::default() });
        }
        let Codes { own, horizontal, vertical, .. } = Codes::of(text);
        let name = text.split('"').nth(1).and_then(printable);
        Some(Crs { wkt: Some(text.to_string()), epsg: horizontal.or(own), vertical, name, ..Crs::default() })
    }

    /// The system that GeoTIFF keys tell: the directory (record 34735), its numbers (34736) and its text parameters (34737). `None` if they tell none.
    #[doc(hidden)]
    pub fn of_geotiff(directory: &[u16], numbers: &[f64], text: &[u8]) -> Option<Crs> {
        const GEOGRAPHIC: u16 = 2048;
        const PROJECTED: u16 = 3072;
        const VERTICAL: u16 = 4096;
        const LINEAR_UNITS: u16 = 3076;
        /// Metres of a unit that has no code.
        const LINEAR_UNIT_SIZE: u16 = 3077;
        const VERTICAL_UNITS: u16 = 4099;
        /// Citations of the projected system, of the geographic one, of the file.
        const CITATIONS: [u16; 3] = [3073, 2049, 1026];
        const USER_DEFINED: u16 = 32767;
        /// What stands for "none" and "defined by other keys".
        const NO_CODE: [u16; 2] = [0, USER_DEFINED];

        let keys = || directory.get(4..).unwrap_or_default().chunks_exact(4);
        let key = |id: u16| keys().find(|key| key[0] == id);
        let code =
            |id: u16| key(id).filter(|key| key[1] == 0 && !NO_CODE.contains(&key[3])).map(|key| u32::from(key[3]));
        // A projection that has no code is no geographic system either.
        let epsg = if key(PROJECTED).is_some_and(|key| key[3] != 0) { code(PROJECTED) } else { code(GEOGRAPHIC) };
        let cited = |id: u16| {
            let [_, 34737, count, start] = *key(id)? else { return None };
            let start = usize::from(start);
            let words = text.get(start..(start + usize::from(count)).min(text.len()))?;
            printable(String::from_utf8_lossy(words).trim_matches(|c: char| c == '|' || c == '\0' || c.is_whitespace()))
        };
        let name = CITATIONS.into_iter().find_map(cited);
        let size = || {
            let [_, 34736, 1, at] = *key(LINEAR_UNIT_SIZE)? else { return None };
            Unit::of_metres(*numbers.get(usize::from(at))?)
        };
        // Heights have no key for the size of a unit of their own: it is not known.
        let unit = |id: u16, size: &dyn Fn() -> Option<Unit>| match *key(id)? {
            [_, 0, _, 0] => None,
            [_, 0, _, USER_DEFINED] => Some(size().map_or(KeyedUnit::Other, KeyedUnit::Known)),
            [_, 0, _, code] => Some(KeyedUnit::of_code(code)),
            _ => None,
        };
        let (unit, height_unit) = (unit(LINEAR_UNITS, &size), unit(VERTICAL_UNITS, &|| None));
        let crs = Crs { wkt: None, epsg, vertical: code(VERTICAL), name, unit, height_unit };
        (crs.epsg.is_some() || crs.name.is_some()).then_some(crs)
    }

    /// Whether both are the same system: by code, else by text, else by name. Heights count if both tell theirs.
    pub fn same_as(&self, other: &Crs) -> bool {
        let heights = self.vertical.is_none() || other.vertical.is_none() || self.vertical == other.vertical;
        let bare = |text: &str| text.split_whitespace().collect::<String>();
        heights
            && match ((self.epsg, other.epsg), (&self.wkt, &other.wkt), (&self.name, &other.name)) {
                ((Some(a), Some(b)), ..) => a == b,
                (_, (Some(a), Some(b)), _) => bare(a) == bare(b),
                (.., (Some(a), Some(b))) => a == b,
                _ => false,
            }
    }
}

/// What the numbers of a reference system are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Axes {
    /// Longitude and latitude.
    Degrees,
    /// Metres from the Earth's centre.
    Geocentric,
    /// Lengths on a map.
    Map,
}

impl Crs {
    /// What the system expects, if coordinates from `low` to `high` cannot be in it. Lengths on a map may be anything.
    #[doc(hidden)]
    pub fn contradicted_by(&self, low: [f64; 3], high: [f64; 3]) -> Option<&'static str> {
        /// From the deepest sea to beyond the highest mountain, in metres from the Earth's centre, with room.
        const SURFACE: [f64; 2] = [6.3e6, 6.5e6];
        let largest = |a: usize| low[a].abs().max(high[a].abs());
        match self.axes()? {
            // In any order, and in gradians, too.
            Axes::Degrees if largest(0) > 400.0 || largest(1) > 400.0 => Some("degrees of longitude and latitude"),
            Axes::Geocentric => {
                let near: [f64; 3] = std::array::from_fn(|a| 0f64.clamp(low[a].min(high[a]), high[a].max(low[a])));
                let far: [f64; 3] = std::array::from_fn(largest);
                let length = |p: [f64; 3]| p.iter().map(|c| c * c).sum::<f64>().sqrt();
                let outside = length(far) < SURFACE[0] || length(near) > SURFACE[1];
                outside.then_some("metres from the centre of the Earth, some 6,370,000 away")
            }
            _ => None,
        }
    }

    /// What its coordinates are; `None` if neither its text nor its code tells.
    #[doc(hidden)]
    pub fn measure(&self) -> Option<Measure> {
        // Of systems by code, the definition tells, in the words of PROJ.
        let defined = self.epsg.and_then(|code| crs_definitions::from_code(u16::try_from(code).ok()?));
        let word = |key: &str| {
            let words = defined.map_or("", |definition| definition.proj4).split_ascii_whitespace();
            words.filter_map(|word| word.strip_prefix('+')?.split_once('=')).find(|(name, _)| *name == key)
        };
        let told = self.told();
        let angles = word("proj").is_some_and(|(_, name)| name == "longlat") && told.unit.is_none();
        if self.axes() == Some(Axes::Degrees) || angles {
            return Some(Measure::Degrees);
        }
        let named = || match word("units")?.1 {
            "m" => Some(Unit::Metre),
            "ft" => Some(Unit::Foot),
            "us-ft" => Some(Unit::SurveyFoot),
            _ => None,
        };
        let factor = || Unit::of_metres(word("to_meter")?.1.parse().ok()?);
        let unit = match (told.unit, self.unit) {
            (Some(metres), _) => Unit::of_metres(metres),
            (None, Some(unit)) => unit.known(),
            (None, None) => named().or_else(factor),
        }?;
        let heights = told.height_unit.map(Unit::of_metres).or(self.height_unit.map(KeyedUnit::known));
        Some(if heights.is_none_or(|heights| heights == Some(unit)) { Measure::Length(unit) } else { Measure::Mixed })
    }

    /// Metres of the unit of lengths on the map: as text or keys tell it, else as the code's definition does.
    pub(super) fn map_unit(&self, defined: Option<f64>) -> Option<f64> {
        match (self.told().unit, self.unit) {
            (Some(metres), _) => rounded(metres),
            (None, Some(unit)) => unit.known().map(Unit::in_metres),
            (None, None) => defined,
        }
    }

    /// Metres of the unit of heights: as text, keys or their own code tell it, else as `otherwise`.
    pub(super) fn unit_of_heights(&self, otherwise: Option<f64>) -> Option<f64> {
        /// Heights whose unit their code tells: above the geoids of 1929 and 1988 of North America, and above those of 1996 and 2008 of the whole Earth.
        const KNOWN: [(u32, Unit); 7] = [
            (5702, Unit::SurveyFoot),
            (6360, Unit::SurveyFoot),
            (8228, Unit::Foot),
            (5703, Unit::Metre),
            (7968, Unit::Metre),
            (5773, Unit::Metre),
            (3855, Unit::Metre),
        ];
        let known = || KNOWN.iter().find(|(code, _)| self.vertical == Some(*code)).map(|(_, unit)| unit.in_metres());
        match (self.told().height_unit, self.height_unit) {
            (Some(metres), _) => rounded(metres),
            (None, Some(unit)) => unit.known().map(Unit::in_metres),
            (None, None) => known().or(otherwise),
        }
    }

    /// The numbers of the text's shift to WGS 84.
    pub(super) fn shift(&self) -> Option<Vec<f64>> {
        self.told().shift
    }

    /// Whether the text says that the system is a site's own, which no place on Earth is known for.
    #[doc(hidden)]
    pub fn is_local(&self) -> bool {
        let keyword =
            |word: &str| self.wkt.as_deref().is_some_and(|wkt| wkt.trim_start().to_ascii_uppercase().starts_with(word));
        ["LOCAL_CS", "ENGCRS", "ENGINEERINGCRS"].into_iter().any(keyword)
    }

    fn told(&self) -> Codes {
        self.wkt.as_deref().map(Codes::of).unwrap_or_default()
    }

    fn axes(&self) -> Option<Axes> {
        let Some(wkt) = &self.wkt else {
            // The usual ones.
            return match self.epsg? {
                4326 | 4979 | 4258 | 4937 | 4269 | 6319 | 6318 | 7844 | 7843 => Some(Axes::Degrees),
                4978 | 4936 | 6317 | 7842 | 7789 | 9988 => Some(Axes::Geocentric),
                _ => None,
            };
        };
        // Of a compound system, the first part's: wherever a keyword stands that tells.
        let upper = wkt.to_ascii_uppercase();
        let found = [
            "PROJCS",
            "PROJCRS",
            "PROJECTEDCRS",
            "GEOCCS",
            "GEODCRS",
            "GEODETICCRS",
            "GEOGCS",
            "GEOGCRS",
            "GEOGRAPHICCRS",
            "LOCAL_CS",
            "ENGCRS",
        ]
        .into_iter()
        .filter_map(|keyword| {
            let at = upper.match_indices(keyword).map(|(at, _)| at).find(|at| {
                let before = upper[..*at].chars().next_back();
                let after = upper[at + keyword.len()..].trim_start().chars().next();
                !before.is_some_and(|c| c.is_ascii_alphanumeric() || c == '_' || c == '"')
                    && matches!(after, Some('[' | '('))
            })?;
            Some((at, keyword))
        })
        .min();
        match found?.1 {
            "GEOCCS" => Some(Axes::Geocentric),
            "GEODCRS" | "GEODETICCRS" if upper.contains("CS[CARTESIAN") => Some(Axes::Geocentric),
            "GEODCRS" | "GEODETICCRS" | "GEOGCS" | "GEOGCRS" | "GEOGRAPHICCRS" => Some(Axes::Degrees),
            "LOCAL_CS" | "ENGCRS" => None,
            _ => Some(Axes::Map),
        }
    }

    /// What `--crs` is told: `none`; an EPSG code; WKT, or a file that holds it.
    ///
    /// # Errors
    /// [`Error::InvalidSetting`] if it is none of these.
    pub fn given(text: &str) -> Result<Option<Crs>> {
        if text.eq_ignore_ascii_case("none") {
            return Ok(None);
        }
        let crs = match Crs::parse(text).filter(|crs| crs.epsg.is_some() || crs.wkt.is_some()) {
            Some(crs) => Some(crs),
            None => {
                let path = Path::new(text);
                let file = path.is_file().then(|| text_of(path).map_err(Error::io(path, "read"))).transpose()?;
                file.and_then(|text| Crs::parse(&text)).filter(|crs| crs.epsg.is_some() || crs.wkt.is_some())
            }
        };
        let expected = "expected EPSG: and a code, WKT, the name of a file that holds WKT, or none";
        crs.map(Some).ok_or_else(|| Error::setting("crs", format!("`crs` {text}: {expected}")))
    }
}

impl fmt::Display for Crs {
    /// "EPSG:25832 (ETRS89 / UTM zone 32N)".
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.epsg, &self.name) {
            (Some(code), Some(name)) => write!(f, "EPSG:{code} ({name})")?,
            (Some(code), None) => write!(f, "EPSG:{code}")?,
            (None, Some(name)) => f.write_str(name)?,
            (None, None) => f.write_str("a system without a name")?,
        }
        match self.vertical {
            Some(code) => write!(f, ", heights EPSG:{code}"),
            None => Ok(()),
        }
    }
}

/// A unit's metres without what a text rounded off; `None` if it has no length.
fn rounded(metres: f64) -> Option<f64> {
    let known = Unit::of_metres(metres).map(Unit::in_metres);
    known.or_else(|| (metres.is_finite() && metres > 0.0).then_some(metres))
}

/// The text of a file; nothing of one that is too long for a reference system.
fn text_of(path: &Path) -> std::io::Result<String> {
    /// Real ones have some thousands of letters.
    const LONGEST: u64 = 1 << 20;
    let mut text = String::new();
    std::fs::File::open(path)?.take(LONGEST + 1).read_to_string(&mut text)?;
    if text.len() as u64 > LONGEST {
        text.clear();
    }
    Ok(text)
}

/// A name as it may be printed: one line, without control characters, not too long. `None` if nothing is left.
fn printable(text: &str) -> Option<String> {
    let name: String = text.trim().chars().filter(|c| !c.is_control()).take(MAX_NAME).collect();
    (!name.is_empty()).then_some(name)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const COMPOUND: &str = r#"COMPD_CS["NAD83 / UTM zone 10N + NAVD88",PROJCS["NAD83 / UTM zone 10N",GEOGCS["NAD83",DATUM["North",SPHEROID["GRS 1980",
        6378137,298.257222101,AUTHORITY["EPSG","7019"]],AUTHORITY["EPSG","6269"]],AUTHORITY["EPSG","4269"]],UNIT["metre",1],AUTHORITY["EPSG","26910"]],
        VERT_CS["NAVD88",VERT_DATUM["x",2005,AUTHORITY["EPSG","5103"]],AUTHORITY["EPSG","5703"]]]"#;

    #[test]
    fn codes_and_names_are_found_in_texts() {
        for (text, epsg, vertical, printed) in [
            ("EPSG:25832", Some(25832), None, "EPSG:25832"),
            ("epsg:2992\0", Some(2992), None, "EPSG:2992"),
            ("EPSG:2992+6360", Some(2992), Some(6360), "EPSG:2992, heights EPSG:6360"),
            ("EPSG:2992+", None, None, "EPSG:2992+"),
            (COMPOUND, Some(26910), Some(5703), "EPSG:26910 (NAD83 / UTM zone 10N + NAVD88), heights EPSG:5703"),
            (r#"PROJCRS["A, b]", ID["EPSG", 3857]]"#, Some(3857), None, "EPSG:3857 (A, b])"),
            (r#"LOCAL_CS["site"]"#, None, None, "site"),
            ("my own system", None, None, "my own system"),
            ("EPSG:x", None, None, "EPSG:x"),
        ] {
            let crs = Crs::parse(text).unwrap();
            assert_eq!((crs.epsg, crs.vertical, crs.to_string().as_str()), (epsg, vertical, printed), "{text}");
        }
        assert_eq!(Crs::parse(" \0"), None);
    }

    #[test]
    fn coordinates_that_cannot_be_in_a_system_are_told() {
        let utm = ([515_000.0, 5_420_000.0, 100.0], [516_000.0, 5_421_000.0, 200.0]);
        let degrees = ([8.1, 48.9, 100.0], [8.2, 49.0, 200.0]);
        let geocentric = ([4_146_000.0, 613_000.0, 4_791_000.0], [4_147_000.0, 614_000.0, 4_792_000.0]);
        let geoccs = r#"GEOCCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],UNIT["metre",1]]"#;
        let geodcrs =
            r#"GEODCRS["WGS 84",DATUM["W",ELLIPSOID["W",6378137,298.2]],CS[Cartesian,3],LENGTHUNIT["metre",1]]"#;
        let geogcs = r#"COMPD_CS["PROJCS",GEOGCS["WGS 84",DATUM["W",SPHEROID["W",6378137,298.2]]],VERT_CS["h"]]"#;
        for (text, right, wrong) in [
            (geoccs, vec![geocentric], vec![utm, degrees]),
            (geodcrs, vec![geocentric], vec![utm, degrees]),
            ("EPSG:4978", vec![geocentric], vec![utm, degrees]),
            (geogcs, vec![degrees], vec![utm, geocentric]),
            ("EPSG:4326", vec![degrees], vec![utm, geocentric]),
            (COMPOUND, vec![utm, degrees, geocentric], vec![]),
            ("EPSG:25832", vec![utm, degrees], vec![]),
            ("my own system", vec![utm, degrees, geocentric], vec![]),
        ] {
            let crs = Crs::parse(text).unwrap();
            for (low, high) in right {
                assert_eq!(crs.contradicted_by(low, high), None, "{text} {low:?}");
            }
            for (low, high) in wrong {
                assert!(crs.contradicted_by(low, high).is_some(), "{text} {low:?}");
            }
        }
    }

    #[test]
    fn units_are_told_by_texts_and_codes() {
        let feet = COMPOUND.replace(r#"UNIT["metre",1],"#, r#"UNIT["US survey foot",0.3048006096012192],"#);
        let both = feet.replace(r#"AUTHORITY["EPSG","5103"]]"#, r#"AUTHORITY["EPSG","5103"]],UNIT["metre",1]"#);
        let newer = r#"PROJCRS["x",BASEGEOGCRS["y",DATUM["d",ELLIPSOID["e",6378137,298.2,LENGTHUNIT["metre",1]]]],CONVERSION["c",METHOD["m"],
            PARAMETER["False easting",1640416.67,LENGTHUNIT["metre",1]]],CS[Cartesian,2],AXIS["x",east,LENGTHUNIT["foot",0.3048]]]"#;
        for (text, expected) in [
            (COMPOUND, Some(Measure::Length(Unit::Metre))),
            (feet.as_str(), Some(Measure::Length(Unit::SurveyFoot))),
            (both.as_str(), Some(Measure::Mixed)),
            (newer, Some(Measure::Length(Unit::Foot))),
            ("EPSG:25832", Some(Measure::Length(Unit::Metre))),
            ("EPSG:2992", Some(Measure::Length(Unit::Foot))),
            ("EPSG:2229", Some(Measure::Length(Unit::SurveyFoot))),
            ("EPSG:4978", Some(Measure::Length(Unit::Metre))),
            ("EPSG:4326", Some(Measure::Degrees)),
            ("EPSG:4314", Some(Measure::Degrees)),
            (
                r#"GEOGCS["WGS 84",DATUM["W",SPHEROID["W",6378137,298.2]],UNIT["degree",0.0174532925199433]]"#,
                Some(Measure::Degrees),
            ),
            (r#"LOCAL_CS["site",UNIT["metre",1]]"#, Some(Measure::Length(Unit::Metre))),
            (r#"LOCAL_CS["site",UNIT["ell",0.6858]]"#, None),
            (r#"LOCAL_CS["site"]"#, None),
            ("EPSG:60000", None),
            ("EPSG:999999", None),
            ("my own system", None),
        ] {
            assert_eq!(Crs::parse(text).unwrap().measure(), expected, "{text}");
        }
        let keys = [1, 1, 0, 2, 3072, 0, 1, 32767, 3076, 0, 1, 9003];
        let own = Crs { name: Some("own".into()), ..Crs::of_geotiff(&keys, &[], b"").unwrap_or_default() };
        assert_eq!(own.unit, None, "keys without a code or a name tell no system");
        let keys = [1, 1, 0, 2, 3072, 0, 1, 25832, 3076, 0, 1, 9003];
        let crs = Crs::of_geotiff(&keys, &[], b"").unwrap();
        assert_eq!(crs.measure(), Some(Measure::Length(Unit::SurveyFoot)));
    }

    #[test]
    fn units_of_geotiff_keys_are_told_by_codes_and_by_sizes() {
        const OWN: u16 = 32767;
        let foot = Some(Measure::Length(Unit::Foot));
        let numbers = [7.0, 0.3048, 0.9144, f64::NAN];
        for (keys, expected) in [
            (&[[3076, 0, 1, 9002]][..], foot),
            (&[[3076, 0, 1, 9036]], Some(Measure::Length(Unit::Kilometre))),
            (&[[3076, 0, 1, OWN], [3077, 34736, 1, 1]], foot),
            // A yard, no number, none there, none told, text: not what the system's code says, but nothing that is known.
            (&[[3076, 0, 1, OWN], [3077, 34736, 1, 2]], None),
            (&[[3076, 0, 1, OWN], [3077, 34736, 1, 3]], None),
            (&[[3076, 0, 1, OWN], [3077, 34736, 1, 4]], None),
            (&[[3076, 0, 1, OWN]], None),
            (&[[3076, 0, 1, OWN], [3077, 34737, 1, 1]], None),
            (&[[3076, 0, 1, 9005]], None),
            // The size is of a unit without a code.
            (&[[3076, 0, 1, 9002], [3077, 34736, 1, 2]], foot),
            (&[[3076, 0, 1, 0]], Some(Measure::Length(Unit::Metre))),
            (&[[3076, 0, 1, 9002], [4099, 0, 1, 9002]], foot),
            (&[[3076, 0, 1, 9002], [4099, 0, 1, 9001]], Some(Measure::Mixed)),
            (&[[3076, 0, 1, OWN], [3077, 34736, 1, 1], [4099, 0, 1, 9003]], Some(Measure::Mixed)),
            (&[[4099, 0, 1, 9001]], Some(Measure::Length(Unit::Metre))),
            (&[[4099, 0, 1, 9002]], Some(Measure::Mixed)),
            (&[[4099, 0, 1, OWN]], Some(Measure::Mixed)),
            (&[], Some(Measure::Length(Unit::Metre))),
        ] {
            let all = [&[[1, 1, 0, 1 + keys.len() as u16], [3072, 0, 1, 25832]], keys].concat();
            let crs = Crs::of_geotiff(&all.concat(), &numbers, b"").unwrap();
            assert_eq!(crs.measure(), expected, "{keys:?}");
        }
    }

    #[test]
    fn a_system_is_given_by_code_text_file_or_not_at_all() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("site.prj");
        std::fs::write(&path, COMPOUND).unwrap();
        assert_eq!(Crs::given("none").unwrap(), None);
        assert_eq!(Crs::given("EPSG:25832").unwrap().unwrap().epsg, Some(25832));
        assert_eq!(Crs::given(COMPOUND).unwrap().unwrap().epsg, Some(26910));
        assert_eq!(Crs::given(path.to_str().unwrap()).unwrap().unwrap().vertical, Some(5703));
        std::fs::write(&path, [COMPOUND.as_bytes(), &vec![b' '; 1 << 20]].concat()).unwrap();
        assert!(Crs::given(path.to_str().unwrap()).is_err(), "no more is read than a system can have");
        assert!(Crs::given("somewhere").unwrap_err().to_string().contains("`crs` somewhere: expected EPSG"));
    }

    #[test]
    fn geotiff_keys_tell_codes_and_citations() {
        let text = b"My projection|";
        let crs = |keys: &[[u16; 4]]| {
            Crs::of_geotiff(&[&[1, 1, 0, keys.len() as u16], keys.concat().as_slice()].concat(), &[], text)
        };
        let projected = crs(&[[1024, 0, 1, 1], [2048, 0, 1, 4258], [3072, 0, 1, 25832], [4096, 0, 1, 7837]]).unwrap();
        assert_eq!((projected.epsg, projected.vertical), (Some(25832), Some(7837)));
        assert_eq!(crs(&[[2048, 0, 1, 4326]]).unwrap().epsg, Some(4326));
        let own = crs(&[[2048, 0, 1, 4326], [3072, 0, 1, 32767], [3073, 34737, 14, 0]]).unwrap();
        assert_eq!((own.epsg, own.to_string().as_str()), (None, "My projection"));
        assert_eq!(crs(&[[3073, 34737, 14, 60000]]), None);
        assert_eq!(crs(&[]), None);
        assert_eq!(Crs::of_geotiff(&[1, 1], &[], b""), None);
    }

    #[test]
    fn systems_are_the_same_by_code_text_or_name() {
        let crs = |text: &str| Crs::parse(text).unwrap();
        assert!(crs("EPSG:26910").same_as(&crs(COMPOUND)));
        assert!(crs(COMPOUND).same_as(&crs(&COMPOUND.replace('\n', " "))));
        assert!(!crs("EPSG:26911").same_as(&crs(COMPOUND)));
        assert!(!crs(COMPOUND).same_as(&crs(&COMPOUND.replace("5703", "5704"))));
        assert!(crs("LOCAL_CS[\"a\"]").same_as(&crs("LOCAL_CS[ \"a\" ]")));
        assert!(!crs("LOCAL_CS[\"a\"]").same_as(&crs("EPSG:1")));
        assert!(crs("site").same_as(&crs("site")) && !crs("site").same_as(&crs("other")));
    }

    proptest! {
        #[test]
        fn no_text_makes_it_panic(text in "\\PC{0,60}", wkt in "[A-Z\\[\\](),\"0-9 ]{0,80}", keys: Vec<u16>, numbers: Vec<f64>, ascii: Vec<u8>) {
            for text in [&text, &wkt, &format!("ID[{wkt}")] {
                drop(Crs::parse(text).map(|crs| (crs.to_string(), crs.measure())));
            }
            let _ = Crs::of_geotiff(&keys, &numbers, &ascii).map(|crs| crs.measure());
        }
    }
}
