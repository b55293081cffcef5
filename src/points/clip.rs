//! Polygons on the map that points are clipped by: from GeoJSON or well-known text.

use std::io::Read;
use std::path::{Path, PathBuf};

use robust::{Coord, orient2d};
use serde_json::Value;

use crate::error::{Error, Result};
use crate::points::bounds::Bounds;
use crate::points::crs::Crs;
use crate::points::unit::Measure;

/// The most corners: whether edges cross takes up to their number squared.
const MOST_CORNERS: usize = 50_000;
/// The longest file.
const LONGEST: u64 = 16 << 20;
/// The deepest that collections lie in collections.
const DEEPEST: usize = 8;

/// Polygons, in the coordinates of the input. A point within any of them, or on its boundary, counts.
#[derive(Debug, Clone, PartialEq)]
pub struct Clip {
    path: PathBuf,
    polygons: Vec<Polygon>,
    /// The EPSG code that the file tells, if it does.
    epsg: Option<u32>,
    bounds: [[f64; 2]; 2],
}

/// Rings: corners, the last one being the first again. What an odd number of rings go round lies inside.
#[derive(Debug, Clone, PartialEq)]
struct Polygon {
    edges: Vec<[[f64; 2]; 2]>,
    bounds: [[f64; 2]; 2],
    /// The edges that reach into each of equal bands of y.
    bands: Vec<Vec<u32>>,
}

type Rings = Vec<Vec<[f64; 2]>>;

impl Clip {
    /// Reads a file: GeoJSON if it begins with a brace, else well-known text (`POLYGON` or `MULTIPOLYGON`, with `SRID=...;` before it if you like).
    ///
    /// # Errors
    /// [`Error::Malformed`] if it is neither, has no polygon, or one whose edges cross; [`Error::Io`].
    pub fn read(path: &Path) -> Result<Clip> {
        let file = std::fs::File::open(path).map_err(Error::io(path, "open"))?;
        let mut text = String::new();
        file.take(LONGEST + 1).read_to_string(&mut text).map_err(Error::io(path, "read"))?;
        if text.len() as u64 > LONGEST {
            return Err(Error::malformed(path, "length", format!("at most {LONGEST} bytes"), "more"));
        }
        Clip::parse(path, &text)
    }

    fn parse(path: &Path, text: &str) -> Result<Clip> {
        let wrong = |(place, expected, found): Wrong| Error::malformed(path, place, expected, found);
        let text = text.trim_start_matches('\u{feff}').trim();
        let mut found: Vec<Rings> = Vec::new();
        let epsg = match text.starts_with('{') {
            true => {
                let value: Value = serde_json::from_str(text)
                    .map_err(|error| wrong((format!("line {}", error.line()), "JSON".into(), error.to_string())))?;
                geojson(&value, "", 0, &mut found).map_err(wrong)?;
                named_epsg(&value)
            }
            false => Words::new(text).geometry(&mut found, 0).map_err(wrong)?,
        };
        let corners: usize = found.iter().flatten().map(Vec::len).sum();
        if corners > MOST_CORNERS {
            return Err(wrong(("corners".into(), format!("at most {MOST_CORNERS}"), corners.to_string())));
        }
        if found.is_empty() {
            return Err(wrong(("content".into(), "a polygon".into(), "none".into())));
        }
        let mut polygons = Vec::with_capacity(found.len());
        for (number, rings) in found.into_iter().enumerate() {
            polygons.push(Polygon::of(&rings).map_err(|(place, expected, found)| {
                wrong((format!("polygon {}, {place}", number + 1), expected, found))
            })?);
        }
        let bounds = polygons.iter().map(|polygon| polygon.bounds).reduce(united).unwrap_or_default();
        Ok(Clip { path: path.to_path_buf(), polygons, epsg, bounds })
    }

    /// Whether a point lies within.
    pub fn holds(&self, x: f64, y: f64) -> bool {
        within(self.bounds, x, y) && self.polygons.iter().any(|polygon| polygon.holds(x, y))
    }

    /// Checks that it can be meant for points of a reference system.
    ///
    /// # Errors
    /// [`Error::Usage`] if it names another one, or has degrees for an input that has none.
    pub(crate) fn check(&self, crs: Option<&Crs>) -> Result<()> {
        let Some(crs) = crs else { return Ok(()) };
        let path = self.path.display();
        if let (Some(own), Some(other)) = (self.epsg, crs.epsg)
            && own != other
        {
            return Err(Error::Usage(format!(
                "{path}: is in EPSG:{own}, and the points are in {crs}; reproject the polygon"
            )));
        }
        let [[west, south], [east, north]] = self.bounds;
        let degrees = west >= -180.0 && east <= 180.0 && south >= -90.0 && north <= 90.0;
        if degrees && matches!(crs.measure(), Some(Measure::Length(_))) {
            return Err(Error::Usage(format!(
                "{path}: goes from {west} {south} to {east} {north}, which are degrees by their looks, and the points are in {crs}; reproject the polygon"
            )));
        }
        Ok(())
    }

    /// That its polygons lie elsewhere than all points, if they do.
    pub(crate) fn elsewhere(&self, points: &Bounds) -> Option<Error> {
        let ([[west, south], [east, north]], [a, b, _], [c, d, _]) = (self.bounds, points.min, points.max);
        let apart = a <= c && (east < a || west > c || north < b || south > d);
        apart.then(|| Error::Malformed {
            path: self.path.clone(),
            place: "polygons".into(),
            expected: format!("some where the points lie, from {a} {b} to {c} {d}"),
            found: format!("them from {west} {south} to {east} {north}"),
        })
    }
}

/// A place, what was expected there, and what was found.
type Wrong = (String, String, String);

fn united(a: [[f64; 2]; 2], b: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
    [[0, 1].map(|i| a[0][i].min(b[0][i])), [0, 1].map(|i| a[1][i].max(b[1][i]))]
}

fn within([low, high]: [[f64; 2]; 2], x: f64, y: f64) -> bool {
    low[0] <= x && x <= high[0] && low[1] <= y && y <= high[1]
}

/// The side of a line from a to b that c lies on: positive to the left, 0 on it; exact.
fn side(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    let [a, b, c] = [a, b, c].map(|[x, y]| Coord { x, y });
    orient2d(a, b, c)
}

impl Polygon {
    fn of(rings: &Rings) -> std::result::Result<Polygon, Wrong> {
        let mut edges = Vec::new();
        for (number, ring) in rings.iter().enumerate() {
            let place = || format!("ring {}", number + 1);
            if ring.len() < 4 {
                return Err((place(), "at least 4 corners, the last as the first".into(), format!("{}", ring.len())));
            }
            if ring.first() != ring.last() {
                return Err((place(), "the last corner as the first".into(), format!("{:?}", ring[ring.len() - 1])));
            }
            edges.extend(ring.windows(2).map(|pair| [pair[0], pair[1]]).filter(|[a, b]| a != b));
        }
        let Some(bounds) = edges.iter().map(|[a, _]| [*a, *a]).reduce(united) else {
            return Err(("rings".into(), "an area".into(), "none".into()));
        };
        let mut polygon = Polygon { edges, bounds, bands: Vec::new() };
        let count = polygon.edges.len().clamp(1, 4096);
        polygon.bands = vec![Vec::new(); count];
        for (number, [a, b]) in polygon.edges.iter().enumerate() {
            let (low, high) = (polygon.band(a[1].min(b[1]), count), polygon.band(a[1].max(b[1]), count));
            polygon.bands[low..=high].iter_mut().for_each(|band| band.push(number as u32));
        }
        match polygon.crossing() {
            None => Ok(polygon),
            Some([x, y]) => Err(("edges".into(), "none that cross".into(), format!("two that cross near {x} {y}"))),
        }
    }

    fn band(&self, y: f64, count: usize) -> usize {
        let [low, high] = self.bounds.map(|corner| corner[1]);
        let part = (y - low) / (high - low);
        // No number if the box is flat.
        ((part * count as f64) as usize).min(count - 1)
    }

    /// The beginning of an edge that crosses another.
    fn crossing(&self) -> Option<[f64; 2]> {
        let mut order: Vec<usize> = (0..self.edges.len()).collect();
        let low = |number: usize, a: usize| self.edges[number][0][a].min(self.edges[number][1][a]);
        let high = |number: usize, a: usize| self.edges[number][0][a].max(self.edges[number][1][a]);
        order.sort_by(|i, j| low(*i, 1).total_cmp(&low(*j, 1)).then(i.cmp(j)));
        for (at, &i) in order.iter().enumerate() {
            let above = order[at + 1..].iter().take_while(|j| low(**j, 1) <= high(i, 1));
            for &j in above.filter(|j| low(**j, 0) <= high(i, 0) && low(i, 0) <= high(**j, 0)) {
                let ([a, b], [c, d]) = (self.edges[i], self.edges[j]);
                let apart = |one: f64, other: f64| one > 0.0 && other < 0.0 || one < 0.0 && other > 0.0;
                if apart(side(a, b, c), side(a, b, d)) && apart(side(c, d, a), side(c, d, b)) {
                    return Some(a);
                }
            }
        }
        None
    }

    fn holds(&self, x: f64, y: f64) -> bool {
        if !within(self.bounds, x, y) {
            return false;
        }
        let mut inside = false;
        for &number in &self.bands[self.band(y, self.bands.len())] {
            let [a, b] = self.edges[number as usize];
            let (low, high) = if a[1] <= b[1] { (a, b) } else { (b, a) };
            if y < low[1] || y > high[1] {
                continue;
            }
            let side = side(low, high, [x, y]);
            if side == 0.0 && x >= a[0].min(b[0]) && x <= a[0].max(b[0]) {
                return true;
            }
            // A ray to the right meets it, its upper end left out.
            if y < high[1] && side > 0.0 {
                inside = !inside;
            }
        }
        inside
    }
}

/// The polygons of a GeoJSON value.
fn geojson(value: &Value, place: &str, depth: usize, out: &mut Vec<Rings>) -> std::result::Result<(), Wrong> {
    if depth > DEEPEST {
        return Err((place.into(), format!("at most {DEEPEST} collections in each other"), "more".into()));
    }
    let each = |name: &str, out: &mut Vec<Rings>| {
        let Some(values) = value.get(name).and_then(Value::as_array) else {
            return Err((format!("{place}/{name}"), "a list".into(), "none".into()));
        };
        values
            .iter()
            .enumerate()
            .try_for_each(|(number, value)| geojson(value, &format!("{place}/{name}/{number}"), depth + 1, out))
    };
    match value.get("type").and_then(Value::as_str) {
        Some("FeatureCollection") => each("features", out),
        Some("GeometryCollection") => each("geometries", out),
        Some("Feature") => {
            geojson(value.get("geometry").unwrap_or(&Value::Null), &format!("{place}/geometry"), depth + 1, out)
        }
        Some("Polygon") => {
            out.push(rings(value.get("coordinates"), &format!("{place}/coordinates"))?);
            Ok(())
        }
        Some("MultiPolygon") => {
            let place = format!("{place}/coordinates");
            for (number, polygon) in list(value.get("coordinates"), &place)?.iter().enumerate() {
                out.push(rings(Some(polygon), &format!("{place}/{number}"))?);
            }
            Ok(())
        }
        Some(other) => Err((format!("{place}/type"), "Polygon or MultiPolygon".into(), format!("{other:.40}"))),
        None => Err((format!("{place}/type"), "Polygon or MultiPolygon".into(), "nothing".into())),
    }
}

fn list<'a>(value: Option<&'a Value>, place: &str) -> std::result::Result<&'a Vec<Value>, Wrong> {
    value.and_then(Value::as_array).ok_or_else(|| (place.to_owned(), "a list".into(), "none".into()))
}

fn rings(value: Option<&Value>, place: &str) -> std::result::Result<Rings, Wrong> {
    let mut out = Vec::new();
    for (number, ring) in list(value, place)?.iter().enumerate() {
        let place = format!("{place}/{number}");
        let mut corners = Vec::new();
        for (number, corner) in list(Some(ring), &place)?.iter().enumerate() {
            let numbers = list(Some(corner), &format!("{place}/{number}"))?;
            let at = |a: usize| numbers.get(a).and_then(Value::as_f64).filter(|c| c.is_finite());
            match (at(0), at(1)) {
                (Some(x), Some(y)) => corners.push([x, y]),
                _ => return Err((format!("{place}/{number}"), "two numbers".into(), format!("{corner:.40}"))),
            }
        }
        out.push(corners);
    }
    Ok(out)
}

/// The code that the member `crs` of older GeoJSON names.
fn named_epsg(value: &Value) -> Option<u32> {
    let name = value.get("crs")?.get("properties")?.get("name")?.as_str()?;
    name.contains("EPSG").then(|| name.rsplit(':').next()?.parse().ok()).flatten()
}

/// Well-known text, word by word.
struct Words<'a> {
    text: &'a str,
    all: usize,
}

impl<'a> Words<'a> {
    fn new(text: &'a str) -> Words<'a> {
        Words { text, all: text.len() }
    }

    fn wrong(&self, expected: &str) -> Wrong {
        let found: String = self.text.chars().take(20).collect();
        let found = if found.is_empty() { "the end".into() } else { format!("{found:?}") };
        (format!("byte {}", self.all - self.text.len()), expected.into(), found)
    }

    /// Takes a mark, if it is next.
    fn mark(&mut self, mark: char) -> bool {
        self.text = self.text.trim_start();
        let rest = self.text.strip_prefix(mark);
        self.text = rest.unwrap_or(self.text);
        rest.is_some()
    }

    fn expect(&mut self, mark: char) -> std::result::Result<(), Wrong> {
        if self.mark(mark) { Ok(()) } else { Err(self.wrong(&format!("{mark:?}"))) }
    }

    fn word(&mut self) -> String {
        self.text = self.text.trim_start();
        let end = self.text.find(|c: char| !c.is_ascii_alphabetic()).unwrap_or(self.text.len());
        let (word, rest) = self.text.split_at(end);
        self.text = rest;
        word.to_ascii_uppercase()
    }

    fn number(&mut self) -> Option<f64> {
        self.text = self.text.trim_start();
        let end =
            self.text.find(|c: char| !(c.is_ascii_alphanumeric() || "+-.".contains(c))).unwrap_or(self.text.len());
        let number = self.text[..end].parse().ok().filter(|number: &f64| number.is_finite())?;
        self.text = &self.text[end..];
        Some(number)
    }

    /// Polygons, and the code that stands before them.
    fn geometry(&mut self, out: &mut Vec<Rings>, depth: usize) -> std::result::Result<Option<u32>, Wrong> {
        let mut epsg = None;
        let mut word = self.word();
        if word == "SRID" && self.mark('=') {
            epsg = self.number().map(|code| code as u32);
            self.expect(';')?;
            word = self.word();
        }
        let many = match word.as_str() {
            "POLYGON" => false,
            "MULTIPOLYGON" => true,
            "GEOMETRYCOLLECTION" if depth < DEEPEST => {
                self.expect('(')?;
                loop {
                    self.geometry(out, depth + 1)?;
                    if !self.mark(',') {
                        self.expect(')')?;
                        return self.ended(depth).map(|()| epsg);
                    }
                }
            }
            _ => {
                return Err(("beginning".into(), "GeoJSON, or POLYGON or MULTIPOLYGON".into(), format!("{word:.40?}")));
            }
        };
        // Z, M or ZM: only the first two numbers of a corner count.
        let before = self.text;
        if !matches!(self.word().as_str(), "Z" | "M" | "ZM") {
            self.text = before;
        }
        if many {
            self.expect('(')?;
        }
        loop {
            let mut polygon = Vec::new();
            self.expect('(')?;
            loop {
                polygon.push(self.ring()?);
                if !self.mark(',') {
                    break;
                }
            }
            self.expect(')')?;
            out.push(polygon);
            if !(many && self.mark(',')) {
                break;
            }
        }
        if many {
            self.expect(')')?;
        }
        self.ended(depth).map(|()| epsg)
    }

    fn ended(&mut self, depth: usize) -> std::result::Result<(), Wrong> {
        self.text = self.text.trim();
        if depth == 0 && !self.text.is_empty() { Err(self.wrong("the end")) } else { Ok(()) }
    }

    fn ring(&mut self) -> std::result::Result<Vec<[f64; 2]>, Wrong> {
        let mut corners = Vec::new();
        self.expect('(')?;
        loop {
            let (Some(x), Some(y)) = (self.number(), self.number()) else { return Err(self.wrong("a number")) };
            corners.push([x, y]);
            while self.number().is_some() {}
            if !self.mark(',') {
                break;
            }
        }
        self.expect(')')?;
        Ok(corners)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn clip(text: &str) -> Result<Clip> {
        Clip::parse(Path::new("p"), text)
    }

    /// A star round a place: corners at growing angles, so its edges do not cross.
    fn star() -> impl Strategy<Value = Vec<[f64; 2]>> {
        (prop::collection::vec(1u32..100, 3..40), -50i32..50, -50i32..50).prop_map(|(reaches, x, y)| {
            let count = reaches.len() as f64;
            let mut ring: Vec<[f64; 2]> = reaches
                .iter()
                .enumerate()
                .map(|(i, reach)| {
                    let angle = i as f64 / count * std::f64::consts::TAU;
                    [f64::from(x) + f64::from(*reach) * angle.cos(), f64::from(y) + f64::from(*reach) * angle.sin()]
                })
                .collect();
            ring.push(ring[0]);
            ring
        })
    }

    fn wkt(rings: &[Vec<[f64; 2]>]) -> String {
        let ring = |ring: &Vec<[f64; 2]>| {
            let corners: Vec<String> = ring.iter().map(|[x, y]| format!("{x} {y} 7")).collect();
            format!("({})", corners.join(", "))
        };
        format!("polygon z ({})", rings.iter().map(ring).collect::<Vec<_>>().join(","))
    }

    proptest! {
        /// A point lies within a star by the sum of the angles that its edges are seen under.
        #[test]
        fn inside_by_winding(ring in star(), points in prop::collection::vec((-160.0f64..160.0, -160.0f64..160.0), 1..40)) {
            let clip = clip(&wkt(std::slice::from_ref(&ring))).unwrap();
            for (x, y) in points {
                let mut turned = 0.0;
                for pair in ring.windows(2) {
                    let [[ax, ay], [bx, by]] = [pair[0], pair[1]].map(|[a, b]| [a - x, b - y]);
                    turned += (ax * by - ay * bx).atan2(ax * bx + ay * by);
                }
                prop_assert_eq!(clip.holds(x, y), turned.abs() > 1.0, "{} {}: {}", x, y, turned);
            }
            for [x, y] in ring {
                prop_assert!(clip.holds(x, y), "corners are within");
            }
        }

        #[test]
        fn nothing_makes_it_panic(text in "\\PC{0,60}", cut in 0usize..200) {
            let _ = clip(&text);
            let whole = r#"{"type":"FeatureCollection","features":[{"type":"Feature","geometry":{"type":"Polygon","coordinates":[[[0,0],[1,0],[1,1],[0,0]]]}}]}"#;
            let _ = clip(&whole[..cut.min(whole.len())]);
            let whole = "SRID=2154;MULTIPOLYGON Z (((0 0 1,4 0 1,4 4 1,0 0 1),(1 1,2 1,2 1.5,1 1)))";
            prop_assert_eq!(clip(&whole[..cut.min(whole.len())]).is_ok(), cut >= whole.len());
        }
    }

    #[test]
    fn geojson_and_text_are_read_alike() {
        let text = clip("MULTIPOLYGON(((0 0,4 0,4 4,0 4,0 0),(1 1,2 1,2 2,1 2,1 1)),((9 9,10 9,10 10,9 9)))").unwrap();
        let json = clip(
            r#"{"type":"FeatureCollection","crs":{"properties":{"name":"urn:ogc:def:crs:EPSG::2154"}},"features":[{"type":"Feature","properties":{},"geometry":
            {"type":"GeometryCollection","geometries":[{"type":"Polygon","coordinates":[[[0,0],[4,0],[4,4],[0,4],[0,0]],[[1,1],[2,1],[2,2],[1,2],[1,1]]]},
            {"type":"MultiPolygon","coordinates":[[[[9,9,1],[10,9,1],[10,10,1],[9,9,1]]]]}]}}]}"#,
        )
        .unwrap();
        assert_eq!(json.polygons, text.polygons);
        assert_eq!((json.epsg, text.epsg), (Some(2154), None));
        let inside = |x, y| text.holds(x, y);
        assert!(inside(0.5, 0.5) && !inside(1.5, 1.5) && inside(1.0, 1.5) && inside(9.5, 9.2) && !inside(5.0, 5.0));
        assert!(inside(0.0, 4.0) && inside(4.0, 2.0) && !inside(-0.1, 4.0) && !inside(4.1, 2.0));
    }

    #[test]
    fn what_is_no_polygon_is_told() {
        for (text, words) in [
            ("", "expected GeoJSON"),
            ("LINESTRING(0 0,1 1)", "LINESTRING"),
            ("POLYGON((0 0,1 0,1 1))", "at least 4 corners"),
            ("POLYGON((0 0,1 0,1 1,0 1))", "the last corner as the first"),
            ("POLYGON((0 0,4 4,4 0,0 4,0 0))", "two that cross"),
            ("POLYGON((0 0,4 0,4 4,0 4,0 0),(3 1,6 1,6 2,3 2,3 1))", "two that cross"),
            ("POLYGON((0 0,1 0,1 x,0 0))", "byte 19"),
            ("POLYGON((0 0,1 0,1 1,0 0)) trailing", "the end"),
            (r#"{"type":"Point","coordinates":[0,0]}"#, "Point"),
            (r#"{"type":"Polygon","coordinates":[[[0,0],[1,0],[1,"a"],[0,0]]]}"#, "/coordinates/0/2"),
            (r#"{"type":"FeatureCollection","features":[]}"#, "a polygon"),
            ("{", "line 1"),
        ] {
            let error = clip(text).unwrap_err().to_string();
            assert!(error.contains(words), "{text}: {error}");
        }
    }

    #[test]
    fn another_system_is_told() {
        let crs = Crs::given("EPSG:2154").unwrap();
        let error = |text: &str| clip(text).unwrap().check(crs.as_ref()).map_err(|error| error.to_string());
        assert!(error("SRID=25832;POLYGON((0 0,1e6 0,1e6 1e6,0 0))").unwrap_err().contains("is in EPSG:25832"));
        assert!(error("POLYGON((3 43,4 43,4 44,3 43))").unwrap_err().contains("degrees by their looks"));
        assert!(error("SRID=2154;POLYGON((700000 6200000,700100 6200000,700100 6200100,700000 6200000))").is_ok());
    }
}
