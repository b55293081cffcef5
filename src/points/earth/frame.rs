//! East, north and up of a place on Earth.

use super::ellipsoid::Ellipsoid;

/// A place on Earth, as people name it.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Site {
    /// Degrees east of Greenwich.
    pub longitude: f64,
    /// Degrees north of the equator.
    pub latitude: f64,
    /// Metres above the ellipsoid of WGS 84.
    pub height: f64,
}

impl std::fmt::Display for Site {
    /// "48.749993 N 9.000001 E, 250.120 m above the ellipsoid".
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let side = |degrees: f64, sides: [char; 2]| if degrees < 0.0 { sides[1] } else { sides[0] };
        let (north, east) = (side(self.latitude, ['N', 'S']), side(self.longitude, ['E', 'W']));
        let (latitude, longitude) = (self.latitude.abs(), self.longitude.abs());
        write!(f, "{latitude:.6} {north} {longitude:.6} {east}, {:.3} m above the ellipsoid", self.height)
    }
}

/// East, north and up of a place on Earth; up is away from the ellipsoid of WGS 84.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    origin: [f64; 3],
    axes: [[f64; 3]; 3],
    /// Where it stands.
    pub site: Site,
}

impl Frame {
    /// About a place in metres from the Earth's centre.
    pub fn about(origin: [f64; 3]) -> Frame {
        let [longitude, latitude, height] = Ellipsoid::wgs84().placed(origin);
        let ((sin, cos), (east, north)) = (libm::sincos(latitude), libm::sincos(longitude));
        let axes = [[-east, north, 0.0], [-sin * north, -sin * east, cos], [cos * north, cos * east, sin]];
        let site = Site { longitude: longitude.to_degrees(), latitude: latitude.to_degrees(), height };
        Frame { origin, axes, site }
    }

    /// East, north and up of a place, in metres.
    pub fn local(&self, place: [f64; 3]) -> [f64; 3] {
        let [x, y, z]: [f64; 3] = std::array::from_fn(|a| place[a] - self.origin[a]);
        self.axes.map(|[a, b, c]| a * x + b * y + c * z)
    }

    /// What takes east, north and up back to metres from the Earth's centre, column by column.
    pub fn transform(&self) -> [f64; 16] {
        let [e, n, u] = self.axes;
        let [x, y, z] = self.origin;
        [e[0], e[1], e[2], 0.0, n[0], n[1], n[2], 0.0, u[0], u[1], u[2], 0.0, x, y, z, 1.0]
    }
}
