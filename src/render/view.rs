//! Where a picture is taken from.
//!
//! ```text
//!      Z = up                      azimuth: of the viewer, from X towards Y, in degrees
//!      |   Y = back, 90:0          elevation: above the horizon
//!      |  /
//!      | /                         up   z: X Y Z =  x  y  z      -z:  x -y -z
//!      o------ X = right, 0:0           y:          x -z  y      -y:  x  z -y
//!     /                                 x:          y  z  x      -x:  y -z -x
//!    front, 270:0
//! ```
//!
//! The picture's right, its up and the direction to the viewer are a right-handed frame. Seen from the top, X is to the right and Y up: north is where
//! maps have it.

use std::fmt;
use std::str::FromStr;

use glam::DVec3;

use crate::error::{Error, Result};

/// The direction that is up, in the mesh's coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Up {
    axis: usize,
    down: bool,
}

impl Up {
    /// The third coordinate grows upwards.
    pub const Z: Up = Up { axis: 2, down: false };

    /// How high a position lies.
    pub fn height(self, position: [f64; 3]) -> f64 {
        if self.down { -position[self.axis] } else { position[self.axis] }
    }

    /// X, Y and Z of the drawing above in the mesh's coordinates.
    fn upright(self) -> [DVec3; 3] {
        let [x, y, z] = match self.axis {
            0 => [DVec3::Y, DVec3::Z, DVec3::X],
            1 => [DVec3::X, DVec3::NEG_Z, DVec3::Y],
            _ => [DVec3::X, DVec3::Y, DVec3::Z],
        };
        if self.down { [x, -y, -z] } else { [x, y, z] }
    }
}

impl FromStr for Up {
    type Err = Error;

    fn from_str(text: &str) -> Result<Up> {
        let (down, axis) = match text.strip_prefix('-') {
            Some(axis) => (true, axis),
            None => (false, text.strip_prefix('+').unwrap_or(text)),
        };
        match ["x", "y", "z"].iter().position(|name| axis.eq_ignore_ascii_case(name)) {
            Some(axis) => Ok(Up { axis, down }),
            None => Err(Error::Usage(format!("expected x, y, z, -x, -y or -z, found {text:?}"))),
        }
    }
}

impl fmt::Display for Up {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.down { "-" } else { "" })?;
        f.write_str(["x", "y", "z"][self.axis])
    }
}

/// Where the viewer is, infinitely far away: views are parallel projections.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// What it is called, in lower case.
    pub name: String,
    /// From X towards Y, in degrees.
    pub azimuth: f64,
    /// Above the horizon, in degrees, from −90 to 90.
    pub elevation: f64,
}

/// The views that have names.
const NAMED: [(&str, f64, f64); 7] = [
    ("iso", 305.0, 30.0),
    ("front", 270.0, 0.0),
    ("back", 90.0, 0.0),
    ("left", 180.0, 0.0),
    ("right", 0.0, 0.0),
    ("top", 270.0, 90.0),
    ("bottom", 270.0, -90.0),
];

impl View {
    /// A view from an azimuth and an elevation, named after them.
    pub fn from_angles(azimuth: f64, elevation: f64) -> View {
        View { name: format!("{azimuth}:{elevation}"), azimuth, elevation }
    }

    /// The view from the front, the right and above.
    pub fn iso() -> View {
        View::named(NAMED[0])
    }

    /// The view from above.
    pub fn top() -> View {
        View::named(NAMED[5])
    }

    fn named((name, azimuth, elevation): (&str, f64, f64)) -> View {
        View { name: name.to_string(), azimuth, elevation }
    }

    /// The view from a direction, where z is up, in whole degrees.
    pub fn from_direction([x, y, z]: [f64; 3]) -> View {
        let azimuth = libm::atan2(y, x).to_degrees().round().rem_euclid(360.0);
        View::from_angles(azimuth, libm::atan2(z, libm::hypot(x, y)).to_degrees().round())
    }

    /// Its frame, in the mesh's coordinates.
    pub fn frame(&self, up: Up) -> Frame {
        let [x, y, z] = up.upright();
        let ((sin_a, cos_a), (sin_e, cos_e)) = (sin_cos(self.azimuth), sin_cos(self.elevation));
        let out = x * cos_a + y * sin_a;
        let toward = out * cos_e + z * sin_e;
        Frame { right: y * cos_a - x * sin_a, up: z * cos_e - out * sin_e, toward }
    }
}

impl FromStr for View {
    type Err = Error;

    fn from_str(text: &str) -> Result<View> {
        let text = text.trim().to_ascii_lowercase();
        if let Some(named) = NAMED.iter().find(|(name, ..)| *name == text) {
            return Ok(View::named(*named));
        }
        let angles = text.split_once(':').and_then(|(a, e)| Some((a.parse::<f64>().ok()?, e.parse::<f64>().ok()?)));
        match angles {
            Some((azimuth, elevation)) if azimuth.abs() <= 360.0 && elevation.abs() <= 90.0 => {
                Ok(View::from_angles(azimuth, elevation))
            }
            _ => {
                let names = NAMED.map(|(name, ..)| name).join(", ");
                Err(Error::Usage(format!(
                    "expected {names}, or AZIMUTH:ELEVATION in degrees such as 30:20 (up to 360 and 90), found {text:?}"
                )))
            }
        }
    }
}

/// Sine and cosine of an angle in degrees; those of right angles are exact.
fn sin_cos(degrees: f64) -> (f64, f64) {
    match degrees.rem_euclid(360.0) {
        0.0 => (0.0, 1.0),
        90.0 => (1.0, 0.0),
        180.0 => (0.0, -1.0),
        270.0 => (-1.0, 0.0),
        degrees => libm::sincos(degrees.to_radians()),
    }
}

/// A view's axes: to the right and upwards in the picture, and to the viewer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// To the right.
    pub right: DVec3,
    /// Upwards.
    pub up: DVec3,
    /// Out of the picture.
    pub toward: DVec3,
}

impl Frame {
    /// A vector's components along the three.
    #[inline]
    pub fn turn(&self, v: DVec3) -> DVec3 {
        DVec3::new(self.right.dot(v), self.up.dot(v), self.toward.dot(v))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_are_where_their_names_say() {
        let frame = |view: &str, up: &str| view.parse::<View>().unwrap().frame(up.parse().unwrap());
        let top = frame("top", "z");
        assert_eq!((top.right, top.up, top.toward), (DVec3::X, DVec3::Y, DVec3::Z));
        let front = frame("front", "z");
        assert_eq!((front.right, front.up, front.toward), (DVec3::X, DVec3::Z, DVec3::NEG_Y));
        // Where y is up, models face z.
        let front = frame("front", "y");
        assert_eq!((front.right, front.up, front.toward), (DVec3::X, DVec3::Y, DVec3::Z));
        assert_eq!(frame("right", "x").toward, DVec3::Y);
        assert_eq!(frame("90:0", "-z").toward, DVec3::NEG_Y);
        for up in ["x", "y", "z", "-x", "-y", "-z", "+Z"] {
            for view in ["iso", "front", "back", "left", "right", "top", "bottom", "17:-80", "-300.5:12"] {
                let Frame { right, up, toward } = frame(view, up);
                assert!((right.cross(up) - toward).length() < 1e-12 && (toward.length() - 1.0).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn directions_have_views() {
        assert_eq!(View::from_direction([0.0, -2.0, 0.0]).name, "270:0");
        assert_eq!(View::from_direction([0.0, 0.0, -1.0]).elevation, -90.0);
        assert_eq!(View::from_direction([1.0, 1.0, 2f64.sqrt()]).name, "45:45");
        assert_eq!(View::top().name, "top");
    }

    #[test]
    fn what_is_no_view_is_refused() {
        for bad in ["", "above", "30", "1:2:3", "nan:0", "0:91", "361:0", "inf:inf"] {
            assert!(bad.parse::<View>().is_err(), "{bad:?}");
        }
        for bad in ["", "w", "--z", "xy"] {
            assert!(bad.parse::<Up>().is_err(), "{bad:?}");
        }
    }
}
