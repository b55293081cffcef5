//! What a system's definition says, in the words of PROJ: `+proj=utm +zone=32 +ellps=GRS80 +units=m`.

use super::ellipsoid::Ellipsoid;

/// A definition's words.
#[derive(Debug, Clone, Copy)]
pub struct Words(pub &'static str);

impl Words {
    /// The word behind a key.
    pub fn word(&self, key: &str) -> Option<&'static str> {
        let words = self.0.split_ascii_whitespace().filter_map(|word| word.strip_prefix('+'));
        words.filter_map(|word| word.split_once('=')).find(|(name, _)| *name == key).map(|(_, word)| word)
    }

    /// The number behind a key.
    pub fn number(&self, key: &str) -> Option<f64> {
        self.word(key)?.parse().ok().filter(|number: &f64| number.is_finite())
    }

    /// Whether a key stands there that has no word.
    pub fn has(&self, key: &str) -> bool {
        self.0.split_ascii_whitespace().any(|word| word.strip_prefix('+') == Some(key))
    }

    /// Metres of the unit of the map; `None` if it is not known.
    pub fn unit(&self) -> Option<f64> {
        self.number("to_meter").or_else(|| metres(self.word("units")?))
    }

    /// Metres of the unit of heights, if the definition has heights.
    pub fn height_unit(&self) -> Option<f64> {
        metres(self.word("vunits")?)
    }

    /// Degrees from Greenwich to the meridian that longitudes are counted from; `None` if it is not known.
    pub fn meridian(&self) -> Option<f64> {
        const MERIDIANS: [(&str, f64); 11] = [
            ("athens", 23.716_337_5),
            ("bern", 7.0 + 26.0 / 60.0 + 22.5 / 3600.0),
            ("bogota", -(74.0 + 4.0 / 60.0 + 51.3 / 3600.0)),
            ("brussels", 4.0 + 22.0 / 60.0 + 4.71 / 3600.0),
            ("ferro", -(17.0 + 40.0 / 60.0)),
            ("jakarta", 106.0 + 48.0 / 60.0 + 27.79 / 3600.0),
            ("lisbon", -(9.0 + 7.0 / 60.0 + 54.862 / 3600.0)),
            ("madrid", -(3.0 + 41.0 / 60.0 + 16.58 / 3600.0)),
            ("oslo", 10.0 + 43.0 / 60.0 + 22.5 / 3600.0),
            ("paris", 2.0 + 20.0 / 60.0 + 14.025 / 3600.0),
            ("rome", 12.0 + 27.0 / 60.0 + 8.4 / 3600.0),
        ];
        let Some(name) = self.word("pm") else { return Some(0.0) };
        let known = MERIDIANS.iter().find(|(known, _)| *known == name);
        known.map(|(_, degrees)| *degrees).or_else(|| self.number("pm"))
    }

    /// Degrees of the meridian in the middle of the map.
    pub fn middle(&self) -> Option<f64> {
        match self.number("zone") {
            Some(zone) if self.word("proj") == Some("utm") => {
                (1.0..=60.0).contains(&zone).then_some(6.0 * zone - 183.0)
            }
            _ => Some(self.number("lon_0").unwrap_or(0.0)),
        }
    }

    /// What the map adds to eastings and northings, in metres.
    pub fn added(&self) -> [f64; 2] {
        match self.word("proj") {
            Some("utm") => [500_000.0, if self.has("south") { 1e7 } else { 0.0 }],
            _ => ["x_0", "y_0"].map(|key| self.number(key).unwrap_or(0.0)),
        }
    }

    /// The ellipsoid; `None` if it is not known.
    pub fn ellipsoid(&self) -> Option<Ellipsoid> {
        if let (Some(a), Some(b)) = (self.number("a"), self.number("b")) {
            return Some(Ellipsoid { a, e2: 1.0 - b / a * (b / a) });
        }
        if let (Some(a), Some(rf)) = (self.number("a"), self.number("rf")) {
            return Some(Ellipsoid::of(a, 1.0 / rf));
        }
        let name = self.word("ellps").or_else(|| Some(datum(self.word("datum")?)?.0))?;
        Some(match name {
            "GRS80" => Ellipsoid::of(6_378_137.0, 1.0 / 298.257_222_101),
            "WGS84" => Ellipsoid::wgs84(),
            "WGS72" => Ellipsoid::of(6_378_135.0, 1.0 / 298.26),
            "WGS66" => Ellipsoid::of(6_378_145.0, 1.0 / 298.25),
            "GRS67" => Ellipsoid::of(6_378_160.0, 1.0 / 298.247_167_427),
            "airy" => Ellipsoid::of(6_377_563.396, 1.0 / 299.324_964_6),
            "aust_SA" => Ellipsoid::of(6_378_160.0, 1.0 / 298.25),
            "bessel" => Ellipsoid::of(6_377_397.155, 1.0 / 299.152_812_8),
            "bess_nam" => Ellipsoid::of(6_377_483.865, 1.0 / 299.152_812_8),
            "clrk66" => {
                let flatter = 6_356_583.8 / 6_378_206.4;
                Ellipsoid { a: 6_378_206.4, e2: 1.0 - flatter * flatter }
            }
            "clrk80" => Ellipsoid::of(6_378_249.145, 1.0 / 293.4663),
            "clrk80ign" => Ellipsoid::of(6_378_249.2, 1.0 / 293.466_021_293_626_9),
            "evrstSS" => Ellipsoid::of(6_377_298.556, 1.0 / 300.8017),
            "helmert" => Ellipsoid::of(6_378_200.0, 1.0 / 298.3),
            "intl" => Ellipsoid::of(6_378_388.0, 1.0 / 297.0),
            "krass" => Ellipsoid::of(6_378_245.0, 1.0 / 298.3),
            "mod_airy" => {
                let flatter = 6_356_034.446 / 6_377_340.189;
                Ellipsoid { a: 6_377_340.189, e2: 1.0 - flatter * flatter }
            }
            _ => return None,
        })
    }

    /// What takes places to WGS 84; `None` if that is not known.
    pub fn shift(&self) -> Option<Shift> {
        if let Some(text) = self.word("towgs84") {
            return Shift::parse(text);
        }
        // Grids are not here; the null grid is for spheres that stand for WGS 84 itself.
        match (self.word("nadgrids"), self.word("datum")) {
            (Some("@null"), _) => Some(Shift::default()),
            (Some(_), _) => None,
            (None, Some(name)) => Shift::of(datum(name)?.1),
            // Systems as ETRS89, NAD83(2011), GDA2020, JGD2011: within two metres of WGS 84.
            (None, None) => matches!(self.word("ellps")?, "GRS80" | "WGS84").then_some(Shift::default()),
        }
    }
}

/// A datum's ellipsoid, and its shift. The one of North America of 1927 has none but by grids.
fn datum(name: &str) -> Option<(&'static str, &'static [f64])> {
    Some(match name {
        "WGS84" => ("WGS84", &[0.0; 3]),
        "NAD83" => ("GRS80", &[0.0; 3]),
        "NAD27" => ("clrk66", &[]),
        "GGRS87" => ("GRS80", &[-199.87, 74.79, 246.62]),
        "potsdam" => ("bessel", &[598.1, 73.7, 418.2, 0.202, 0.045, -2.455, 6.7]),
        "carthage" => ("clrk80ign", &[-263.0, 6.0, 431.0]),
        "hermannskogel" => ("bessel", &[577.326, 90.129, 463.919, 5.137, 1.474, 5.297, 2.4232]),
        "ire65" => ("mod_airy", &[482.530, -130.596, 564.557, -1.042, -0.214, -0.631, 8.15]),
        "nzgd49" => ("intl", &[59.47, -5.04, 187.44, 0.47, -0.1, 1.024, -4.5993]),
        "OSGB36" => ("airy", &[446.448, -125.157, 542.060, 0.1502, 0.2470, 0.8421, -20.4894]),
        _ => return None,
    })
}

/// Metres of PROJ's units.
fn metres(name: &str) -> Option<f64> {
    Some(match name {
        "m" => 1.0,
        "ft" => 0.3048,
        "us-ft" => 1200.0 / 3937.0,
        "link" => 0.201_168,
        _ => return None,
    })
}

/// A shift between datums: metres, turns in radians, and a factor (as position vectors are turned).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shift {
    by: [f64; 3],
    turn: [f64; 3],
    factor: f64,
}

impl Default for Shift {
    fn default() -> Shift {
        Shift { by: [0.0; 3], turn: [0.0; 3], factor: 1.0 }
    }
}

impl Shift {
    /// Of three metres, or of these, three seconds of arc and millionths.
    pub fn of(numbers: &[f64]) -> Option<Shift> {
        let second = std::f64::consts::PI / 180.0 / 3600.0;
        match *numbers {
            [x, y, z] => Some(Shift { by: [x, y, z], ..Shift::default() }),
            [x, y, z, a, b, c, ppm] => {
                Some(Shift { by: [x, y, z], turn: [a, b, c].map(|turn| turn * second), factor: 1.0 + ppm * 1e-6 })
            }
            _ => None,
        }
        .filter(|shift| [shift.by, shift.turn].as_flattened().iter().all(|n| n.is_finite()) && shift.factor.is_finite())
    }

    /// Of numbers with commas between.
    pub fn parse(text: &str) -> Option<Shift> {
        let numbers = text.split(',').map(|number| number.trim().parse().ok()).collect::<Option<Vec<f64>>>()?;
        Shift::of(&numbers)
    }

    /// A place on WGS 84.
    pub fn applied(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let [a, b, c] = self.turn;
        let turned = [x - c * y + b * z, c * x + y - a * z, -b * x + a * y + z];
        std::array::from_fn(|i| self.factor * turned[i] + self.by[i])
    }
}
