//! Units of length: those that options are typed in, and those that coordinates are in.

use std::fmt;

use crate::error::{Error, Result};

/// A unit of length.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Unit {
    /// A thousandth of a metre.
    Millimetre,
    /// A hundredth of a metre.
    Centimetre,
    /// The metre.
    Metre,
    /// A thousand metres.
    Kilometre,
    /// A twelfth of a foot.
    Inch,
    /// The international foot, 0.3048 metres.
    Foot,
    /// The foot of surveys in the United States, 1200/3937 metres.
    SurveyFoot,
}

/// All units, by the names they are typed by; the first name of a unit is the one that is shown.
const NAMES: [(&str, Unit); 9] = [
    ("mm", Unit::Millimetre),
    ("cm", Unit::Centimetre),
    ("km", Unit::Kilometre),
    ("in", Unit::Inch),
    ("usft", Unit::SurveyFoot),
    ("us-ft", Unit::SurveyFoot),
    ("ftUS", Unit::SurveyFoot),
    ("ft", Unit::Foot),
    // After those that end in it.
    ("m", Unit::Metre),
];

/// Factors in files are rounded, but to more digits than the two kinds of feet differ in.
const ROUNDED: f64 = 1e-8;

impl Unit {
    /// Splits `5cm` or `2.5 m` into what stands before the unit, and the unit, if there is one.
    pub fn split(text: &str) -> (&str, Option<Unit>) {
        let text = text.trim();
        let found = NAMES.iter().find_map(|(name, unit)| Some((text.strip_suffix(name)?.trim_end(), *unit)));
        match found {
            // A unit stands behind a digit: other words may end in its letters.
            Some((number, unit)) if number.ends_with(|c: char| c.is_ascii_digit() || c == '.') => (number, Some(unit)),
            _ => (text, None),
        }
    }

    /// How many metres it has, as a fraction.
    fn metres(self) -> (u64, u64) {
        match self {
            Unit::Millimetre => (1, 1000),
            Unit::Centimetre => (1, 100),
            Unit::Metre => (1, 1),
            Unit::Kilometre => (1000, 1),
            Unit::Inch => (254, 10_000),
            Unit::Foot => (3048, 10_000),
            Unit::SurveyFoot => (1200, 3937),
        }
    }

    /// Its length in metres.
    pub fn in_metres(self) -> f64 {
        let (a, b) = self.metres();
        a as f64 / b as f64
    }

    /// A length in another unit: 5 cm are 5/100 m, the number that 0.05 is, too.
    pub fn convert(self, length: f64, to: Unit) -> f64 {
        let ((a, b), (c, d)) = (self.metres(), to.metres());
        let (up, down) = (a * d, b * c);
        let common = gcd(up, down);
        length * (up / common) as f64 / (down / common) as f64
    }

    /// The unit that has so many metres.
    pub fn of_metres(metres: f64) -> Option<Unit> {
        let same = |unit: &Unit| {
            let (a, b) = unit.metres();
            (metres * b as f64 / a as f64 - 1.0).abs() < ROUNDED
        };
        NAMES.into_iter().map(|(_, unit)| unit).find(same)
    }
}

fn gcd(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { gcd(b, a % b) }
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = NAMES.iter().find(|(_, unit)| unit == self).map_or("", |(name, _)| name);
        f.write_str(name)
    }
}

/// What the coordinates of a reference system are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Measure {
    /// Lengths.
    Length(Unit),
    /// Lengths in one unit on the map, and in another in height.
    Mixed,
    /// Angles: longitude and latitude.
    Degrees,
}

/// The length of a setting, given in a unit, in that of coordinates.
///
/// # Errors
/// [`Error::InvalidSetting`] if the unit of the coordinates is not known, or not one of length.
pub(crate) fn measured(setting: &'static str, length: f64, unit: Unit, measure: Option<Measure>) -> Result<f64> {
    let wrong = |words: &str| Err(Error::setting(setting, format!("`{setting}` {length}{unit}: {words}")));
    match measure {
        Some(Measure::Length(own)) => Ok(unit.convert(length, own)),
        Some(Measure::Degrees) => {
            wrong("the input's coordinates are degrees, which have no length; reproject the input to metres or feet")
        }
        Some(Measure::Mixed) => {
            wrong("the input has one unit on the map and another in height; give a plain number, in the input's units")
        }
        None => wrong(
            "the unit of the input is not known; give a plain number, in the input's units, or name its reference system with `crs`",
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_as_typed() {
        for (text, number, unit) in [
            ("5cm", "5", Some(Unit::Centimetre)),
            (" 2.5 m", "2.5", Some(Unit::Metre)),
            ("1ft", "1", Some(Unit::Foot)),
            ("1 us-ft", "1", Some(Unit::SurveyFoot)),
            ("3usft", "3", Some(Unit::SurveyFoot)),
            ("3ftUS", "3", Some(Unit::SurveyFoot)),
            ("1e-3km", "1e-3", Some(Unit::Kilometre)),
            ("7.mm", "7.", Some(Unit::Millimetre)),
            ("2in", "2", Some(Unit::Inch)),
            ("2.5", "2.5", None),
            ("8c", "8c", None),
            ("m", "m", None),
            ("5 ells cm", "5 ells cm", None),
            ("", "", None),
        ] {
            assert_eq!(Unit::split(text), (number, unit), "{text}");
        }
    }

    #[test]
    fn lengths_become_the_numbers_that_one_would_type() {
        for (length, from, to, expected) in [
            (5.0, Unit::Centimetre, Unit::Metre, 0.05),
            (7.0, Unit::Centimetre, Unit::Metre, 0.07),
            (0.3, Unit::Metre, Unit::Metre, 0.3),
            (1.0, Unit::Foot, Unit::Metre, 0.3048),
            (12.0, Unit::Inch, Unit::Foot, 1.0),
            (3937.0, Unit::SurveyFoot, Unit::Metre, 1200.0),
            (0.3048, Unit::Metre, Unit::Foot, 1.0),
        ] {
            assert_eq!(from.convert(length, to), expected, "{length} {from} in {to}");
        }
        let survey = Unit::Foot.convert(1e6, Unit::SurveyFoot);
        assert!((survey - 999_998.0).abs() < 1e-3, "{survey}");
    }

    #[test]
    fn factors_tell_units() {
        for (metres, unit) in [
            (1.0, Some(Unit::Metre)),
            (0.3048, Some(Unit::Foot)),
            (0.304_800_609_601_219_2, Some(Unit::SurveyFoot)),
            (0.304_800_61, Some(Unit::SurveyFoot)),
            (0.9144, None),
            (f64::NAN, None),
            (0.0, None),
        ] {
            assert_eq!(Unit::of_metres(metres), unit, "{metres}");
        }
    }
}
