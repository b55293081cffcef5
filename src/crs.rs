//! Coordinate reference systems: which place on Earth coordinates mean, as far as files say. Nothing is ever reprojected; a cloud has one system,
//! which is carried to the outputs.
//!
//! ```text
//!  LAS   WKT record (2112), else GeoTIFF keys (34735 to 34737)  --+
//!  E57   coordinateMetadata: WKT, or whatever the writer put     --+--> Crs { wkt, epsg, vertical, name }
//!  raw   the side-car's "srs": "EPSG:25832" or WKT               --+
//! ```

use std::fmt;

/// The longest WKT read; real ones have some thousand bytes.
pub const MAX_WKT: usize = 1 << 18;

/// The longest name kept.
const MAX_NAME: usize = 200;

/// A coordinate reference system, as far as a file tells.
#[derive(Debug, Clone, PartialEq, Eq, Default, serde::Serialize)]
pub struct Crs {
    /// Well-known text, of either version, as the file has it.
    pub wkt: Option<String>,
    /// EPSG code of the system, or of its horizontal part.
    pub epsg: Option<u32>,
    /// EPSG code of the heights.
    pub vertical: Option<u32>,
    /// What it is called.
    pub name: Option<String>,
}

impl Crs {
    /// The system that a text names: `EPSG:25832`, WKT, or anything else, which is then its name. `None` for a text of blanks.
    pub fn parse(text: &str) -> Option<Crs> {
        let text = text.trim_matches(|c: char| c.is_whitespace() || c == '\0');
        if text.is_empty() || text.len() > MAX_WKT {
            return None;
        }
        let code = text.get(..5).filter(|head| head.eq_ignore_ascii_case("EPSG:")).and_then(|_| text[5..].parse().ok());
        if let Some(epsg) = code {
            return Some(Crs { epsg: Some(epsg), ..Crs::default() });
        }
        let keyword: String = text.chars().take_while(|c| c.is_ascii_alphabetic() || *c == '_').collect();
        let opens = text[keyword.len()..].trim_start().starts_with(['[', '(']);
        if keyword.is_empty() || !opens {
            return Some(Crs { name: printable(text), ..Crs::default() });
        }
        let Codes { own, horizontal, vertical } = Codes::of(text);
        let name = text.split('"').nth(1).and_then(printable);
        Some(Crs { wkt: Some(text.to_string()), epsg: horizontal.or(own), vertical, name })
    }

    /// The system that GeoTIFF keys tell: the directory (record 34735) and its text parameters (34737). `None` if they tell none.
    pub fn of_geotiff(directory: &[u16], text: &[u8]) -> Option<Crs> {
        const GEOGRAPHIC: u16 = 2048;
        const PROJECTED: u16 = 3072;
        const VERTICAL: u16 = 4096;
        /// Citations of the projected system, of the geographic one, of the file.
        const CITATIONS: [u16; 3] = [3073, 2049, 1026];
        /// What stands for "none" and "defined by other keys".
        const NO_CODE: [u16; 2] = [0, 32767];

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
        let crs = Crs { wkt: None, epsg, vertical: code(VERTICAL), name };
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

/// A name as it may be printed: one line, without control characters, not too long. `None` if nothing is left.
fn printable(text: &str) -> Option<String> {
    let name: String = text.trim().chars().filter(|c| !c.is_control()).take(MAX_NAME).collect();
    (!name.is_empty()).then_some(name)
}

/// EPSG codes in a WKT.
#[derive(Debug, Default)]
struct Codes {
    /// Of the whole.
    own: Option<u32>,
    /// Of the first part of a compound.
    horizontal: Option<u32>,
    /// Of the heights in a compound.
    vertical: Option<u32>,
}

impl Codes {
    /// Walks along the text and keeps, for every bracket that is open, its keyword and what was found in it: `AUTHORITY["EPSG","2992"]` or `ID["EPSG",2992]`.
    fn of(wkt: &str) -> Codes {
        let mut codes = Codes::default();
        let mut open: Vec<(String, Vec<String>)> = Vec::new();
        let (mut word, mut quoted) = (String::new(), false);
        for c in wkt.chars() {
            match c {
                '"' => quoted = !quoted,
                _ if quoted => word.push(c),
                '[' | '(' => open.push((std::mem::take(&mut word).to_ascii_uppercase(), Vec::new())),
                ',' | ']' | ')' => {
                    let argument = std::mem::take(&mut word);
                    if let Some((_, arguments)) = open.last_mut() {
                        arguments.push(argument);
                    }
                    if c != ','
                        && let Some((keyword, arguments)) = open.pop()
                    {
                        codes.see(&open, &keyword, &arguments);
                    }
                }
                _ if c.is_whitespace() => {}
                _ => word.push(c),
            }
        }
        codes
    }

    fn see(&mut self, within: &[(String, Vec<String>)], keyword: &str, arguments: &[String]) {
        let ([authority, code, ..], "AUTHORITY" | "ID") = (arguments, keyword) else { return };
        let (true, Ok(code)) = (authority.eq_ignore_ascii_case("EPSG"), code.parse::<u32>()) else { return };
        let path: Vec<&str> = within.iter().map(|(keyword, _)| keyword.as_str()).collect();
        match path[..] {
            [_] => self.own = Some(code),
            ["COMPD_CS" | "COMPOUNDCRS", "VERT_CS" | "VERTCRS" | "VERTICALCRS"] => self.vertical = Some(code),
            ["COMPD_CS" | "COMPOUNDCRS", _] => self.horizontal = self.horizontal.or(Some(code)),
            _ => {}
        }
    }
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
    fn geotiff_keys_tell_codes_and_citations() {
        let text = b"My projection|";
        let crs = |keys: &[[u16; 4]]| {
            Crs::of_geotiff(&[&[1, 1, 0, keys.len() as u16], keys.concat().as_slice()].concat(), text)
        };
        let projected = crs(&[[1024, 0, 1, 1], [2048, 0, 1, 4258], [3072, 0, 1, 25832], [4096, 0, 1, 7837]]).unwrap();
        assert_eq!((projected.epsg, projected.vertical), (Some(25832), Some(7837)));
        assert_eq!(crs(&[[2048, 0, 1, 4326]]).unwrap().epsg, Some(4326));
        let own = crs(&[[2048, 0, 1, 4326], [3072, 0, 1, 32767], [3073, 34737, 14, 0]]).unwrap();
        assert_eq!((own.epsg, own.to_string().as_str()), (None, "My projection"));
        assert_eq!(crs(&[[3073, 34737, 14, 60000]]), None);
        assert_eq!(crs(&[]), None);
        assert_eq!(Crs::of_geotiff(&[1, 1], b""), None);
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
        fn no_text_makes_it_panic(text in "\\PC{0,60}", wkt in "[A-Z\\[\\](),\"0-9 ]{0,80}", keys: Vec<u16>, ascii: Vec<u8>) {
            for text in [&text, &wkt, &format!("ID[{wkt}")] {
                drop(Crs::parse(text).map(|crs| crs.to_string()));
            }
            drop(Crs::of_geotiff(&keys, &ascii));
        }
    }
}
