//! From a map back to longitude and latitude.
//!
//! All of it is the same to the last bit on every machine: functions are those of `libm` in Rust, not the system's. It is written here for that reason alone;
//! tests compare every system that is known with another implementation.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

use super::definition::Words;
use super::ellipsoid::Ellipsoid;

/// A projection about its meridian, in half longest axes of the ellipsoid.
#[derive(Debug, Clone, Copy)]
pub enum Projection {
    /// Transverse Mercator, by Krüger's series to the sixth order (Karney 2011): better than a micrometre in 3000 km from the meridian.
    TransverseMercator {
        /// The scale times the radius of the sphere with the meridian's length.
        radius: f64,
        /// The rectified latitude of the origin.
        origin: f64,
        /// The series' factors.
        beta: [f64; 6],
    },
    /// Lambert's conformal cone.
    Cone {
        /// The sine of the cone's angle.
        n: f64,
        /// The radius of the equator on the map.
        radius: f64,
        /// The radius of the origin's parallel on the map.
        origin: f64,
    },
    /// Albers' cone, which keeps areas.
    AreaCone {
        /// The sine of the cone's angle.
        n: f64,
        /// Snyder's C.
        c: f64,
        /// The radius of the origin's parallel on the map.
        origin: f64,
    },
    /// Mercator.
    Mercator {
        /// The equator's scale.
        scale: f64,
    },
    /// From a pole: stereographic.
    Polar {
        /// Whether about the south pole.
        south: bool,
        /// Distances on the map for those of half a polar distance's tangent.
        scale: f64,
    },
    /// By a sphere: stereographic.
    Oblique(Gauss),
    /// By a sphere: the Swiss cylinder.
    Swiss(Gauss),
    /// By a sphere: Křovák's cone.
    Krovak(Gauss),
    /// Lambert's plane that keeps areas.
    AreaPlane {
        /// Sine and cosine of the origin's authalic latitude.
        origin: (f64, f64),
        /// The authalic sphere's radius.
        radius: f64,
        /// Snyder's D.
        d: f64,
    },
}

/// The sphere on which the ellipsoid is laid conformally about a parallel.
#[derive(Debug, Clone, Copy)]
pub struct Gauss {
    /// Angles about the axis on the sphere for those on the ellipsoid.
    c: f64,
    /// Added to isometric latitudes.
    k: f64,
    /// Sine and cosine of the origin's latitude on the sphere.
    origin: (f64, f64),
    /// The sphere's radius times the scale.
    radius: f64,
}

impl Gauss {
    fn of(ellipsoid: &Ellipsoid, latitude: f64, scale: f64) -> Gauss {
        let (sin, cos) = libm::sincos(latitude);
        let e2 = ellipsoid.e2;
        let c = libm::sqrt(1.0 + e2 * cos * cos * cos * cos / (1.0 - e2));
        let chi = sin / c;
        let k = libm::atanh(chi) - c * ellipsoid.isometric(latitude);
        let radius = scale * libm::sqrt(1.0 - e2) / (1.0 - e2 * sin * sin);
        Gauss { c, k, origin: (chi, libm::sqrt(1.0 - chi * chi)), radius }
    }

    /// Longitude and latitude, by the longitude and the sine of the latitude on the sphere.
    fn back(&self, ellipsoid: &Ellipsoid, longitude: f64, sin: f64) -> [f64; 2] {
        [longitude / self.c, ellipsoid.of_isometric((libm::atanh(sin.clamp(-1.0, 1.0)) - self.k) / self.c)]
    }
}

/// A polynomial in n without a constant term, from its first power on.
fn series(n: f64, factors: &[f64]) -> f64 {
    factors.iter().rev().fold(0.0, |sum, factor| (sum + factor) * n)
}

/// Krüger's factors from geographic to rectified latitudes, and back, with the radius of the rectifying sphere in half longest axes.
fn krueger(n: f64) -> ([f64; 6], [f64; 6], f64) {
    let power = |first: i32| (1..first).fold(1.0, |power, _| power * n);
    let of = |rows: [&[f64]; 6]| {
        let mut out = [0.0; 6];
        for (j, row) in rows.iter().enumerate() {
            out[j] = power(j as i32 + 1) * series(n, row);
        }
        out
    };
    let alpha = of([
        &[1.0 / 2.0, -2.0 / 3.0, 5.0 / 16.0, 41.0 / 180.0, -127.0 / 288.0, 7891.0 / 37800.0],
        &[13.0 / 48.0, -3.0 / 5.0, 557.0 / 1440.0, 281.0 / 630.0, -1983433.0 / 1935360.0],
        &[61.0 / 240.0, -103.0 / 140.0, 15061.0 / 26880.0, 167603.0 / 181440.0],
        &[49561.0 / 161280.0, -179.0 / 168.0, 6601661.0 / 7257600.0],
        &[34729.0 / 80640.0, -3418889.0 / 1995840.0],
        &[212378941.0 / 319334400.0],
    ]);
    let beta = of([
        &[1.0 / 2.0, -2.0 / 3.0, 37.0 / 96.0, -1.0 / 360.0, -81.0 / 512.0, 96199.0 / 604800.0],
        &[1.0 / 48.0, 1.0 / 15.0, -437.0 / 1440.0, 46.0 / 105.0, -1118711.0 / 3870720.0],
        &[17.0 / 480.0, -37.0 / 840.0, -209.0 / 4480.0, 5569.0 / 90720.0],
        &[4397.0 / 161280.0, -11.0 / 504.0, -830251.0 / 7257600.0],
        &[4583.0 / 161280.0, -108847.0 / 3991680.0],
        &[20648693.0 / 638668800.0],
    ]);
    let n2 = n * n;
    (alpha, beta, (1.0 + n2 / 4.0 + n2 * n2 / 64.0 + n2 * n2 * n2 / 256.0) / (1.0 + n))
}

impl Projection {
    /// The projection of a definition; `None` if it is not known here. Latitudes are within the quarter turns.
    pub fn of(words: &Words, ellipsoid: &Ellipsoid) -> Option<Projection> {
        let angle = |key: &str| words.number(key).map(f64::to_radians);
        let latitude = angle("lat_0").unwrap_or(0.0);
        let scale = words.number("k").or(words.number("k_0")).unwrap_or(1.0);
        let is_pole = (latitude.abs() - FRAC_PI_2).abs() < 1e-9;
        Some(match words.word("proj")? {
            "utm" => Projection::transverse(ellipsoid, 0.0, 0.9996),
            "tmerc" => Projection::transverse(ellipsoid, latitude, scale),
            "lcc" => {
                let first = angle("lat_1")?;
                Projection::cone(ellipsoid, latitude, [first, angle("lat_2").unwrap_or(first)], scale)
            }
            "aea" => Projection::area_cone(ellipsoid, latitude, [angle("lat_1")?, angle("lat_2")?]),
            "merc" => {
                let scale = angle("lat_ts").map_or(scale, |latitude| ellipsoid.parallel(latitude));
                Projection::Mercator { scale }
            }
            "stere" if is_pole => Projection::polar(ellipsoid, latitude < 0.0, angle("lat_ts"), scale),
            "sterea" => Projection::Oblique(Gauss::of(ellipsoid, latitude, scale)),
            "somerc" => Projection::Swiss(Gauss::of(ellipsoid, latitude, scale)),
            "krovak" => Projection::Krovak(Gauss::of(ellipsoid, latitude, scale)),
            "laea" if !is_pole => Projection::area_plane(ellipsoid, latitude),
            _ => return None,
        })
    }

    fn transverse(ellipsoid: &Ellipsoid, latitude: f64, scale: f64) -> Projection {
        let (alpha, beta, radius) = krueger(ellipsoid.n());
        let conformal = libm::atan(libm::sinh(ellipsoid.isometric(latitude)));
        let sum: f64 = (0..6).map(|j| alpha[j] * libm::sin(2.0 * (j + 1) as f64 * conformal)).sum();
        Projection::TransverseMercator { radius: scale * radius, origin: conformal + sum, beta }
    }

    fn cone(ellipsoid: &Ellipsoid, latitude: f64, [first, second]: [f64; 2], scale: f64) -> Projection {
        let (m, psi) = (|l| ellipsoid.parallel(l), |l| ellipsoid.isometric(l));
        let n = if (first - second).abs() < 1e-10 {
            libm::sin(first)
        } else {
            (libm::log(m(first)) - libm::log(m(second))) / (psi(second) - psi(first))
        };
        let radius = scale * m(first) * libm::exp(n * psi(first)) / n;
        // The pole that the cone is about is its tip.
        let tip = (latitude - libm::copysign(FRAC_PI_2, n)).abs() < 1e-9;
        let origin = if tip { 0.0 } else { radius * libm::exp(-n * psi(latitude)) };
        Projection::Cone { n, radius, origin }
    }

    fn area_cone(ellipsoid: &Ellipsoid, latitude: f64, [first, second]: [f64; 2]) -> Projection {
        let (m, q) = (|l| ellipsoid.parallel(l), |l| ellipsoid.area(l));
        let n = if (first - second).abs() < 1e-10 {
            libm::sin(first)
        } else {
            (m(first) * m(first) - m(second) * m(second)) / (q(second) - q(first))
        };
        let c = m(first) * m(first) + n * q(first);
        Projection::AreaCone { n, c, origin: libm::sqrt(c - n * q(latitude)) / n }
    }

    fn polar(ellipsoid: &Ellipsoid, south: bool, exact: Option<f64>, scale: f64) -> Projection {
        let e = ellipsoid.e();
        let scale = match exact.map(f64::abs).filter(|latitude| (latitude - FRAC_PI_2).abs() > 1e-9) {
            Some(latitude) => ellipsoid.parallel(latitude) * libm::exp(ellipsoid.isometric(latitude)),
            None => 2.0 * scale * libm::exp(-e * libm::atanh(e)) / libm::sqrt(1.0 - ellipsoid.e2),
        };
        Projection::Polar { south, scale }
    }

    fn area_plane(ellipsoid: &Ellipsoid, latitude: f64) -> Projection {
        let most = ellipsoid.area(FRAC_PI_2);
        let sin = ellipsoid.area(latitude) / most;
        let (cos, radius) = (libm::sqrt(1.0 - sin * sin), libm::sqrt(most / 2.0));
        Projection::AreaPlane { origin: (sin, cos), radius, d: ellipsoid.parallel(latitude) / (radius * cos) }
    }

    /// The longitude from the projection's meridian, and the latitude, of a place on the map in half longest axes; `None` where the map has no such place.
    pub fn back(&self, ellipsoid: &Ellipsoid, x: f64, y: f64) -> Option<[f64; 2]> {
        let [longitude, latitude] = match *self {
            Projection::TransverseMercator { radius, origin, beta } => {
                let (mut xi, mut eta) = (y / radius + origin, x / radius);
                // Where the series ends to be of use.
                if eta.abs() > 1.0 || xi.abs() > PI {
                    return None;
                }
                let (north, east) = (xi, eta);
                for (j, factor) in beta.iter().enumerate() {
                    let times = 2.0 * (j + 1) as f64;
                    let (sin, cos) = libm::sincos(times * north);
                    xi -= factor * sin * libm::cosh(times * east);
                    eta -= factor * cos * libm::sinh(times * east);
                }
                let ((sin, cos), sinh) = (libm::sincos(xi), libm::sinh(eta));
                [libm::atan2(sinh, cos), ellipsoid.of_conformal(sin / libm::hypot(sinh, cos))]
            }
            Projection::Cone { n, radius, origin } => {
                let (rho, theta) = on_cone(n, x, origin - y);
                [theta / n, ellipsoid.of_isometric(-libm::log(rho / radius) / n)]
            }
            Projection::AreaCone { n, c, origin } => {
                let (rho, theta) = on_cone(n, x, origin - y);
                [theta / n, ellipsoid.of_area((c - rho * n * rho * n) / n)]
            }
            Projection::Mercator { scale } => [x / scale, ellipsoid.of_isometric(y / scale)],
            Projection::Polar { south, scale } => {
                let sign = if south { -1.0 } else { 1.0 };
                let isometric = -libm::log(libm::hypot(x, y) / scale);
                [libm::atan2(x, -sign * y), sign * ellipsoid.of_isometric(isometric)]
            }
            Projection::Oblique(sphere) => {
                let (sin_origin, cos_origin) = sphere.origin;
                let rho = libm::hypot(x, y);
                let (sin, cos) = libm::sincos(2.0 * libm::atan2(rho, 2.0 * sphere.radius));
                let up = if rho > 0.0 { y * sin / rho } else { 0.0 };
                let along = if rho > 0.0 { x * sin / rho } else { 0.0 };
                let longitude = libm::atan2(along, cos_origin * cos - sin_origin * up);
                sphere.back(ellipsoid, longitude, cos * sin_origin + up * cos_origin)
            }
            Projection::Swiss(sphere) => {
                let (sin_origin, cos_origin) = sphere.origin;
                let (sin, cos) = {
                    let up = libm::sinh(y / sphere.radius);
                    (up / libm::hypot(1.0, up), 1.0 / libm::hypot(1.0, up))
                };
                let (east, north) = libm::sincos(x / sphere.radius);
                let longitude = libm::atan2(cos * east, cos_origin * cos * north - sin_origin * sin);
                sphere.back(ellipsoid, longitude, cos_origin * sin + sin_origin * cos * north)
            }
            Projection::Krovak(sphere) => {
                /// The latitude of the cone's pole, and the parallel about it that the cone touches: the system's own numbers, in radians.
                const POLE: f64 = 1.042_168_563_804_74;
                const TOUCHED: f64 = 1.370_083_462_815_55;
                let (n, cos_touched) = libm::sincos(TOUCHED);
                let origin = sphere.radius * cos_touched / n;
                let (rho, theta) = (libm::hypot(x, y), libm::atan2(-x, -y) / n);
                let isometric = libm::log(libm::tan(TOUCHED / 2.0 + FRAC_PI_4)) + libm::log(origin / rho) / n;
                let up = libm::sinh(isometric);
                let (sin, cos) = (up / libm::hypot(1.0, up), 1.0 / libm::hypot(1.0, up));
                let ((sin_pole, cos_pole), (east, north)) = (libm::sincos(FRAC_PI_2 - POLE), libm::sincos(theta));
                let latitude = cos_pole * sin - sin_pole * cos * north;
                let longitude = libm::atan2(cos * east, cos_pole * cos * north + sin_pole * sin);
                sphere.back(ellipsoid, -longitude, latitude)
            }
            Projection::AreaPlane { origin: (sin_origin, cos_origin), radius, d } => {
                let (x, y) = (x / d, y * d);
                let rho = libm::hypot(x, y);
                let half = rho / (2.0 * radius);
                if half > 1.0 {
                    return None;
                }
                let (sin, cos) = libm::sincos(2.0 * libm::asin(half));
                let up = if rho > 0.0 { y * sin / rho } else { 0.0 };
                let along = if rho > 0.0 { x * sin / rho } else { 0.0 };
                let longitude = libm::atan2(along, cos_origin * cos - sin_origin * up);
                let area = ellipsoid.area(FRAC_PI_2) * (cos * sin_origin + up * cos_origin);
                [longitude, ellipsoid.of_area(area)]
            }
        };
        // Some are not numbers.
        let is_there = longitude.abs() <= 2.0 * PI && latitude.abs() <= FRAC_PI_2;
        is_there.then_some([longitude, latitude])
    }
}

/// The distance of a place from a cone's tip, and its angle.
fn on_cone(n: f64, x: f64, down: f64) -> (f64, f64) {
    let sign = libm::copysign(1.0, n);
    (sign * libm::hypot(x, down), libm::atan2(sign * x, sign * down))
}
