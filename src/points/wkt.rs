//! What is read out of a WKT beside its text: codes, units and the shift of its datum.

/// EPSG codes in a WKT.
#[derive(Debug, Default)]
pub(super) struct Codes {
    /// The code of the whole system.
    pub own: Option<u32>,
    /// The code of the first part of a compound system.
    pub horizontal: Option<u32>,
    /// The code of a compound system's heights.
    pub vertical: Option<u32>,
    /// Metres of the unit of lengths on the map.
    pub unit: Option<f64>,
    /// Metres of the unit of heights in a compound.
    pub height_unit: Option<f64>,
    /// The numbers of `TOWGS84`.
    pub shift: Option<Vec<f64>>,
}

impl Codes {
    /// Walks along the text and keeps, for every bracket that is open, its keyword and what was found in it: `AUTHORITY["EPSG","2992"]` or `ID["EPSG",2992]`.
    pub fn of(wkt: &str) -> Codes {
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
        if let ([_, factor, ..], "UNIT" | "LENGTHUNIT") = (arguments, keyword) {
            self.see_unit(within, factor);
        }
        if keyword == "TOWGS84" {
            self.shift = arguments.iter().map(|number| number.parse().ok()).collect();
        }
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

    /// Keeps the unit of a system, which stands in it, or in an axis of it; not those of its datum or its projection's parameters.
    fn see_unit(&mut self, within: &[(String, Vec<String>)], factor: &str) {
        const MAPS: [&str; 7] = ["PROJCS", "PROJCRS", "PROJECTEDCRS", "GEOCCS", "GEODCRS", "GEODETICCRS", "LOCAL_CS"];
        const HEIGHTS: [&str; 3] = ["VERT_CS", "VERTCRS", "VERTICALCRS"];
        let Ok(metres) = factor.parse::<f64>() else { return };
        let mut path = within.iter().map(|(keyword, _)| keyword.as_str()).rev();
        let system = match path.next() {
            Some("AXIS") => path.next(),
            last => last,
        };
        match system {
            Some(system) if MAPS.contains(&system) => self.unit = self.unit.or(Some(metres)),
            Some(system) if HEIGHTS.contains(&system) => self.height_unit = self.height_unit.or(Some(metres)),
            _ => {}
        }
    }
}
