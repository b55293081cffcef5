//! The Earth as an ellipsoid, and the latitudes that projections are made with.

use std::f64::consts::FRAC_PI_2;

/// Steps of Newton's method. Three are enough; a fixed number keeps the bits the same.
const STEPS: usize = 6;

/// An ellipsoid of revolution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ellipsoid {
    /// Half the longest axis, in metres.
    pub a: f64,
    /// The squared eccentricity.
    pub e2: f64,
}

impl Ellipsoid {
    /// By half the longest axis and the flattening.
    pub fn of(a: f64, flattening: f64) -> Ellipsoid {
        Ellipsoid { a, e2: flattening * (2.0 - flattening) }
    }

    /// WGS 84.
    pub fn wgs84() -> Ellipsoid {
        Ellipsoid::of(6_378_137.0, 1.0 / 298.257_223_563)
    }

    /// The eccentricity.
    pub fn e(&self) -> f64 {
        libm::sqrt(self.e2)
    }

    /// The third flattening: the difference of the axes over their sum.
    pub fn n(&self) -> f64 {
        let b = libm::sqrt(1.0 - self.e2);
        (1.0 - b) / (1.0 + b)
    }

    /// The radius of a parallel, in half longest axes.
    pub fn parallel(&self, latitude: f64) -> f64 {
        let (sin, cos) = libm::sincos(latitude);
        cos / libm::sqrt(1.0 - self.e2 * sin * sin)
    }

    /// Metres from the centre of a place with these angles in radians and this height in metres.
    pub fn centred(&self, longitude: f64, latitude: f64, height: f64) -> [f64; 3] {
        let ((sin, cos), (east, north)) = (libm::sincos(latitude), libm::sincos(longitude));
        let across = self.a / libm::sqrt(1.0 - self.e2 * sin * sin);
        let from_axis = (across + height) * cos;
        [from_axis * north, from_axis * east, (across * (1.0 - self.e2) + height) * sin]
    }

    /// Longitude, latitude and height of a place in metres from the centre; some thousand kilometres from it at least.
    pub fn placed(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let from_axis = libm::hypot(x, y);
        let mut latitude = libm::atan2(z, from_axis * (1.0 - self.e2));
        for _ in 0..12 {
            let sin = libm::sin(latitude);
            let across = self.a / libm::sqrt(1.0 - self.e2 * sin * sin);
            latitude = libm::atan2(z + self.e2 * across * sin, from_axis);
        }
        let (sin, cos) = libm::sincos(latitude);
        // Along the normal, which does well at the poles, too.
        let height = from_axis * cos + z * sin - self.a * libm::sqrt(1.0 - self.e2 * sin * sin);
        [libm::atan2(y, x), latitude, height]
    }

    /// The isometric latitude: what a chart by Mercator has upwards.
    pub fn isometric(&self, latitude: f64) -> f64 {
        let (sin, e) = (libm::sin(latitude), self.e());
        libm::atanh(sin) - e * libm::atanh(e * sin)
    }

    /// The latitude of an isometric one.
    pub fn of_isometric(&self, isometric: f64) -> f64 {
        self.of_conformal(libm::sinh(isometric))
    }

    /// The latitude, by the tangent of the conformal one (Karney 2011, section 3).
    pub fn of_conformal(&self, conformal: f64) -> f64 {
        let (e, e2m) = (self.e(), 1.0 - self.e2);
        let mut tan = conformal / e2m;
        if tan.abs() >= 1e8 {
            // So near a pole that the two are the same.
            return libm::atan(conformal * libm::exp(e * libm::atanh(e)));
        }
        for _ in 0..STEPS {
            let secant = libm::hypot(1.0, tan);
            let sigma = libm::sinh(e * libm::atanh(e * tan / secant));
            let found = tan * libm::hypot(1.0, sigma) - sigma * secant;
            let slope = e2m * libm::hypot(1.0, found) * secant / (1.0 + e2m * tan * tan);
            tan += (conformal - found) / slope;
        }
        libm::atan(tan)
    }

    /// What the area between the equator and a parallel is proportional to (Snyder 1987, 3-12).
    pub fn area(&self, latitude: f64) -> f64 {
        let (sin, e) = (libm::sin(latitude), self.e());
        (1.0 - self.e2) * (sin / (1.0 - self.e2 * sin * sin) + self.atanh_over(e, sin))
    }

    fn atanh_over(&self, e: f64, sin: f64) -> f64 {
        if e == 0.0 { sin } else { libm::atanh(e * sin) / e }
    }

    /// The latitude with an area (Snyder 1987, 3-16).
    pub fn of_area(&self, area: f64) -> f64 {
        let most = self.area(FRAC_PI_2);
        if area.abs() >= most {
            return libm::copysign(FRAC_PI_2, area);
        }
        let e = self.e();
        let mut latitude = libm::asin(area / most);
        for _ in 0..2 * STEPS {
            let (sin, cos) = libm::sincos(latitude);
            let square = 1.0 - self.e2 * sin * sin;
            let missing = area / (1.0 - self.e2) - sin / square - self.atanh_over(e, sin);
            let step = square * square / (2.0 * cos) * missing;
            if !step.is_finite() {
                break;
            }
            latitude = (latitude + step).clamp(-FRAC_PI_2, FRAC_PI_2);
        }
        latitude
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn latitudes_are_found_again() {
        for ellipsoid in [Ellipsoid::wgs84(), Ellipsoid::of(6_371_000.0, 0.0)] {
            for degrees in [-89.99_f64, -60.0, -1e-7, 0.0, 12.3, 47.9, 71.0, 89.9] {
                let latitude = degrees.to_radians();
                let isometric = ellipsoid.of_isometric(ellipsoid.isometric(latitude));
                assert!((isometric - latitude).abs() < 1e-12, "{degrees}: {isometric}");
                let area = ellipsoid.of_area(ellipsoid.area(latitude));
                assert!((area - latitude).abs() < 1e-9, "{degrees}: {area}");
                for height in [-400.0, 0.0, 8_848.0] {
                    let [longitude, found, up] = ellipsoid.placed(ellipsoid.centred(2.5, latitude, height));
                    assert!((longitude - 2.5).abs() < 1e-12 && (found - latitude).abs() < 1e-12, "{degrees}");
                    assert!((up - height).abs() < 1e-8, "{degrees}: {up}");
                }
            }
        }
    }
}
