//! What a surface's own colour is: one for all, its vertices' own, or a scale of what vertices have.

use std::fmt;
use std::str::FromStr;

use glam::Vec3;

use super::shading::{Side, pack_tone};
use super::view::Up;
use crate::error::{Error, Result};
use crate::mesh::MeshSource;
use crate::points::attribute::{Wanted, canonical};
use crate::points::scalar::Scalar;
use crate::render::scale::along;
use crate::resources::workers::Workers;

/// What colours tell.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum ColourBy {
    /// The vertices' own colours, if they have any, and else nothing.
    #[default]
    Auto,
    /// Nothing: one colour for all.
    None,
    /// The vertices' own colours.
    Rgb,
    /// How high the surface lies.
    Height,
    /// An attribute of vertices, by its name.
    Attribute(String),
}

impl FromStr for ColourBy {
    type Err = Error;

    fn from_str(text: &str) -> Result<ColourBy> {
        match text.trim().to_ascii_lowercase().as_str() {
            "auto" => Ok(ColourBy::Auto),
            "none" => Ok(ColourBy::None),
            "rgb" => Ok(ColourBy::Rgb),
            "height" => Ok(ColourBy::Height),
            "" => Err(Error::Usage("expected auto, none, rgb, height, or the name of an attribute of vertices".into())),
            _ => Ok(ColourBy::Attribute(canonical(text))),
        }
    }
}

impl fmt::Display for ColourBy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            ColourBy::Auto => "auto",
            ColourBy::None => "none",
            ColourBy::Rgb => "rgb",
            ColourBy::Height => "height",
            ColourBy::Attribute(name) => name,
        })
    }
}

/// The names of the three colours.
const CHANNELS: [&str; 3] = ["red", "green", "blue"];

impl ColourBy {
    /// The attributes that a mesh must have for it.
    pub fn wanted(&self) -> Wanted {
        match self {
            // Which of them there are is not known yet.
            ColourBy::Auto => Wanted::All,
            ColourBy::None | ColourBy::Height => Wanted::None,
            ColourBy::Rgb => Wanted::Named(CHANNELS.map(str::to_string).to_vec()),
            ColourBy::Attribute(name) => Wanted::Named(vec![name.clone()]),
        }
    }

    /// What that is for a mesh, if it was left open.
    pub fn of(&self, mesh: &dyn MeshSource) -> ColourBy {
        let has = |name: &&str| mesh.schema().attributes().iter().any(|attribute| attribute.name == *name);
        match self {
            ColourBy::Auto if CHANNELS.iter().all(has) => ColourBy::Rgb,
            ColourBy::Auto => ColourBy::None,
            known => known.clone(),
        }
    }
}

/// The colour of a surface that has none of its own.
const CLAY: [u8; 3] = [208, 203, 195];
/// The colour where a value is not a number.
const UNKNOWN: [u8; 3] = [150, 150, 150];

/// Colours of growing lightness, from violet over blue and green to yellow: their order is seen without red and green being told apart, and in grey.
const SCALE: [[u8; 3]; 9] = [
    [84, 58, 146],
    [76, 88, 174],
    [58, 116, 186],
    [44, 142, 182],
    [40, 166, 168],
    [70, 188, 144],
    [124, 208, 110],
    [188, 222, 84],
    [250, 234, 92],
];

/// The colour at `t` of the scale, from 0 to 1.
pub fn scale(t: f32) -> [u8; 3] {
    if t.is_nan() {
        return UNKNOWN;
    }
    along(&SCALE, f64::from(t))
}

/// Colours of classes, by their numbers: those of LAS, as far as these have a meaning, in tones that differ in lightness as well.
const CLASSES: [[u8; 3]; 20] = [
    [178, 178, 178], // 0, never classified
    [206, 206, 206], // 1, unclassified
    [190, 140, 92],  // 2, ground
    [188, 214, 130], // 3, low vegetation
    [122, 180, 84],  // 4, medium vegetation
    [50, 124, 66],   // 5, high vegetation
    [214, 94, 40],   // 6, building
    [204, 60, 140],  // 7, low noise
    [160, 150, 210], // 8, key point
    [46, 110, 190],  // 9, water
    [110, 84, 100],  // 10, rail
    [98, 102, 112],  // 11, road
    [226, 200, 226], // 12, overlap
    [240, 206, 60],  // 13, wire
    [228, 168, 32],  // 14, conductor
    [140, 116, 20],  // 15, tower
    [244, 226, 140], // 16, connector
    [120, 196, 214], // 17, bridge
    [170, 40, 100],  // 18, high noise
    [86, 196, 186],  // and others
];

/// A class's colour.
fn class_colour(class: u32) -> [u8; 3] {
    let others = CLASSES.len() as u32 - 1;
    // Beyond the standard's, colours come again, from building on.
    CLASSES[if class <= others { class } else { 2 + class % (others - 2) } as usize]
}

/// How colours are found, for one mesh.
#[derive(Debug, Clone, PartialEq)]
pub enum Tint {
    /// All have this.
    One([u8; 3]),
    /// Colours from three attributes: their numbers in the schema, and the factor that makes 255 of the brightest.
    Own([usize; 3], f64),
    /// Colours from a value, and the values at the ends of the scale.
    Scale(Value, f64, f64),
    /// Colours from an attribute that names a class.
    Classes(usize),
}

/// A number that vertices have.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Value {
    /// How high they lie.
    Height(Up),
    /// An attribute, by its number in the schema.
    Attribute(usize),
}

/// Vertices looked at at once.
const PIECE: usize = 1 << 15;
/// Parts that values are counted in.
const BINS: usize = 1 << 12;
/// How many of a thousand values lie below the scale's lower end, and above its upper: a few that lie far off would take all colours.
const OFF: u64 = 5;

impl Tint {
    /// Looks at the vertices as far as need be: up to twice. 100 KiB for each worker.
    ///
    /// # Errors
    /// [`Error::InvalidSetting`] if the mesh lacks what is asked for; those of reading it; [`Error::Interrupted`].
    pub fn of(mesh: &dyn MeshSource, by: &ColourBy, up: Up, workers: &Workers) -> Result<Tint> {
        let number = |name: &str| {
            let there = mesh.schema().attributes();
            there
                .iter()
                .position(|attribute| attribute.name == name)
                .ok_or_else(|| Error::setting("color_by", format!("`color_by` {by}: {}", mesh.schema().lacks(name))))
        };
        let value = match by {
            ColourBy::Auto => return Tint::of(mesh, &by.of(mesh), up, workers),
            ColourBy::None => return Ok(Tint::One(CLAY)),
            ColourBy::Rgb => {
                let [r, g, b] = CHANNELS.map(number);
                let channels = [r?, g?, b?];
                return Ok(Tint::Own(channels, brightest(mesh, channels, workers)?));
            }
            ColourBy::Attribute(name) if name == "classification" => return Ok(Tint::Classes(number(name)?)),
            ColourBy::Attribute(name) => Value::Attribute(number(name)?),
            ColourBy::Height => Value::Height(up),
        };
        let (low, high) = ends(mesh, value, workers)?;
        Ok(Tint::Scale(value, low, high))
    }

    /// The ends of the scale, if it is one, of a mesh to whose positions `origin` is to be added.
    pub fn ends(&self, origin: [f64; 3]) -> Option<(f64, f64)> {
        match self {
            Tint::Scale(Value::Height(up), low, high) => Some((low + up.height(origin), high + up.height(origin))),
            Tint::Scale(Value::Attribute(_), low, high) => Some((*low, *high)),
            _ => None,
        }
    }

    /// What [`Tint::tone`] wants to know of each of the vertices from `first` on.
    ///
    /// # Errors
    /// Errors of reading the mesh.
    pub fn read(&self, mesh: &dyn MeshSource, first: u64, out: &mut [u32]) -> Result<()> {
        let mut values = vec![0.0; out.len()];
        match *self {
            Tint::One(_) => {}
            Tint::Own(channels, factor) => {
                out.fill(0);
                for (channel, number) in channels.into_iter().enumerate() {
                    mesh.read_attribute(number, first, &mut values)?;
                    for (out, value) in out.iter_mut().zip(&values) {
                        *out |= u32::from((value * factor + 0.5) as u8) << (8 * channel);
                    }
                }
            }
            Tint::Scale(value, low, high) => {
                value.read(mesh, first, &mut values)?;
                for (out, value) in out.iter_mut().zip(values) {
                    let t = match value.is_finite() {
                        true if high > low => (value - low) / (high - low),
                        true => 0.5,
                        false => f64::NAN,
                    };
                    *out = (t as f32).to_bits();
                }
            }
            Tint::Classes(number) => {
                mesh.read_attribute(number, first, &mut values)?;
                out.iter_mut().zip(values).for_each(|(out, value)| *out = value as u32);
            }
        }
        Ok(())
    }

    /// The colour at these weights of a triangle's corners.
    #[inline]
    pub fn tone(&self, corners: [u32; 3], weights: [f32; 3], side: Side) -> u32 {
        let colour = match *self {
            Tint::One(colour) => colour,
            Tint::Own(..) => {
                let channels = |packed: u32| {
                    let [r, g, b, _] = packed.to_le_bytes();
                    Vec3::new(f32::from(r), f32::from(g), f32::from(b))
                };
                let [a, b, c] = corners.map(channels);
                (a * weights[0] + b * weights[1] + c * weights[2] + 0.5).to_array().map(|c| c as u8)
            }
            Tint::Scale(..) => {
                let [a, b, c] = corners.map(f32::from_bits);
                scale(a * weights[0] + b * weights[1] + c * weights[2])
            }
            Tint::Classes(_) => {
                // There is nothing between two classes.
                let [u, v, w] = weights;
                class_colour(
                    corners[if u >= v && u >= w {
                        0
                    } else if v >= w {
                        1
                    } else {
                        2
                    }],
                )
            }
        };
        pack_tone(colour, side)
    }
}

impl Value {
    fn read(self, mesh: &dyn MeshSource, first: u64, out: &mut [f64]) -> Result<()> {
        match self {
            Value::Attribute(number) => mesh.read_attribute(number, first, out),
            Value::Height(up) => {
                let mut positions = vec![[0.0; 3]; out.len()];
                mesh.read_vertices(first, &mut positions)?;
                out.iter_mut().zip(positions).for_each(|(out, position)| *out = up.height(position));
                Ok(())
            }
        }
    }
}

/// Lets workers look at all vertices, a piece at a time.
fn survey<R: Send>(
    mesh: &dyn MeshSource,
    workers: &Workers,
    look: impl Fn(u64, &mut [f64]) -> Result<R> + Sync,
    mut sink: impl FnMut(R),
) -> Result<()> {
    let count = mesh.vertex_count();
    let look = |piece: usize| {
        let first = piece as u64 * PIECE as u64;
        look(first, &mut vec![0.0; (count - first).min(PIECE as u64) as usize])
    };
    workers.in_order_range(workers.threads() + 1, count.div_ceil(PIECE as u64) as usize, look, |found| {
        sink(found);
        Ok(())
    })
}

/// What makes 255 of full light: of 16 bits often only 8 are used, and floats are shares of it.
fn brightest(mesh: &dyn MeshSource, channels: [usize; 3], workers: &Workers) -> Result<f64> {
    let attributes = mesh.schema().attributes();
    if channels.iter().all(|&number| attributes[number].scalar == Scalar::U8) {
        return Ok(1.0);
    }
    let mut most = 0f64;
    let look = |first, values: &mut [f64]| {
        let mut most = 0f64;
        for number in channels {
            mesh.read_attribute(number, first, values)?;
            most = values.iter().copied().fold(most, f64::max);
        }
        Ok(most)
    };
    survey(mesh, workers, look, |found| most = most.max(found))?;
    let float = channels.iter().any(|&number| matches!(attributes[number].scalar, Scalar::F32 | Scalar::F64));
    Ok(if float && most <= 1.0 {
        255.0
    } else if most <= 255.0 {
        1.0
    } else {
        255.0 / 65535.0
    })
}

/// The ends of a value's scale: nearly all vertices lie between them.
fn ends(mesh: &dyn MeshSource, value: Value, workers: &Workers) -> Result<(f64, f64)> {
    let (mut low, mut high, mut count) = (f64::INFINITY, f64::NEG_INFINITY, 0u64);
    let look = |first, values: &mut [f64]| {
        value.read(mesh, first, values)?;
        let finite = || values.iter().copied().filter(|v| v.is_finite());
        Ok((finite().fold(f64::INFINITY, f64::min), finite().fold(f64::NEG_INFINITY, f64::max), finite().count()))
    };
    survey(mesh, workers, look, |found| {
        (low, high, count) = (low.min(found.0), high.max(found.1), count + found.2 as u64);
    })?;
    // Halves, since the difference of two numbers may be more than any number.
    let width = (high / 2.0 - low / 2.0) / BINS as f64;
    if count == 0 {
        return Ok((0.0, 0.0));
    }
    if width <= 0.0 {
        return Ok((low, high));
    }
    let mut bins = vec![0u64; BINS];
    let look = |first, values: &mut [f64]| {
        value.read(mesh, first, values)?;
        let mut bins = vec![0u32; BINS];
        for value in values.iter().filter(|v| v.is_finite()) {
            bins[(((value / 2.0 - low / 2.0) / width) as usize).min(BINS - 1)] += 1;
        }
        Ok(bins)
    };
    survey(mesh, workers, look, |found| {
        bins.iter_mut().zip(found).for_each(|(sum, part)| *sum += u64::from(part));
    })?;
    let off = count * OFF / 1000;
    let beyond = |bins: &mut dyn Iterator<Item = &u64>| {
        let mut passed = 0;
        bins.take_while(|&&in_bin| {
            passed += in_bin;
            passed <= off
        })
        .count() as f64
    };
    let (below, above) = (beyond(&mut bins.iter()), beyond(&mut bins.iter().rev()));
    Ok((low + 2.0 * width * below, high - 2.0 * width * above))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::spool::MeshSpool;
    use crate::points::Precision;
    use crate::points::attribute::{Attribute, Schema};
    use crate::storage::spool::Workspace;

    #[test]
    fn the_scale_grows_lighter() {
        let lightness = |c: [u8; 3]| super::super::shading::linear(c).dot(Vec3::new(0.2126, 0.7152, 0.0722));
        let steps: Vec<f32> = (0..=100).map(|i| lightness(scale(i as f32 / 100.0))).collect();
        assert!(steps.windows(2).all(|pair| pair[0] < pair[1] + 1e-6) && steps[100] > 8.0 * steps[0]);
        assert_eq!((scale(-3.0), scale(7.0), scale(f32::NAN)), (SCALE[0], SCALE[8], UNKNOWN));
    }

    #[test]
    fn classes_have_colours_of_their_own() {
        let distinct: std::collections::BTreeSet<[u8; 3]> = (0..20).map(class_colour).collect();
        assert_eq!(distinct.len(), 20);
        for class in [20, 64, 255, u32::MAX] {
            class_colour(class);
        }
    }

    fn mesh(scalar: Scalar, values: &[f64]) -> (tempfile::TempDir, MeshSpool) {
        let dir = tempfile::tempdir().unwrap();
        let schema = Schema::new(["red", "green", "blue"].map(|name| Attribute::new(name, scalar)).to_vec());
        let workspace = Workspace::new(dir.path()).unwrap();
        let mut mesh = MeshSpool::with_attributes(&workspace, Precision::Double, schema, 1 << 16);
        let mut records = Vec::new();
        for value in values {
            mesh.append_vertices(&[[0.0, *value, 0.0]]).unwrap();
            (0..3).for_each(|_| scalar.put(*value, &mut records));
        }
        mesh.append_attributes(&records).unwrap();
        (dir, mesh)
    }

    #[test]
    fn colours_are_taken_as_they_are_meant() {
        let workers = Workers::new(2).unwrap();
        for (scalar, values, expected) in [
            (Scalar::U8, [0.0, 1.0, 255.0], [0, 1, 255]),
            (Scalar::U16, [0.0, 1.0, 255.0], [0, 1, 255]),
            (Scalar::U16, [0.0, 257.0, 65535.0], [0, 1, 255]),
            (Scalar::F32, [0.0, 0.5, 1.0], [0, 128, 255]),
            (Scalar::F32, [0.0, 100.0, 255.0], [0, 100, 255]),
        ] {
            let (_dir, mesh) = mesh(scalar, &values);
            let tint = Tint::of(&mesh, &ColourBy::Rgb, Up::Z, &workers).unwrap();
            let mut out = [7; 3];
            tint.read(&mesh, 0, &mut out).unwrap();
            assert_eq!(out, expected.map(|v: u32| v | v << 8 | v << 16), "{scalar:?}");
        }
    }

    #[test]
    fn the_ends_of_a_scale_leave_out_what_lies_far_off() {
        let workers = Workers::new(2).unwrap();
        let mut values: Vec<f64> = (0..10_000).map(f64::from).collect();
        values.extend([1e6, -1e6, f64::NAN, f64::INFINITY]);
        let (_dir, spool) = mesh(Scalar::F64, &values);
        let tint = Tint::of(&spool, &ColourBy::Height, "y".parse().unwrap(), &workers).unwrap();
        let Tint::Scale(_, low, high) = tint else { panic!("{tint:?}") };
        assert!((-500.0..500.0).contains(&low) && (9_500.0..10_500.0).contains(&high), "{low} {high}");
        for (values, expected) in [(vec![], (0.0, 0.0)), (vec![f64::NAN], (0.0, 0.0)), (vec![3.0, 3.0], (3.0, 3.0))] {
            let (_dir, mesh) = mesh(Scalar::F64, &values);
            assert_eq!(ends(&mesh, Value::Attribute(1), &workers).unwrap(), expected);
        }
        let (_dir, huge) = mesh(Scalar::F64, &[-1e308, 1e308, 0.0]);
        assert_eq!(ends(&huge, Value::Attribute(0), &workers).unwrap(), (-1e308, 1e308));
    }

    #[test]
    fn what_is_not_there_is_said_with_what_is() {
        let (_dir, mesh) = mesh(Scalar::U8, &[1.0]);
        let error = Tint::of(&mesh, &"Intensity".parse().unwrap(), Up::Z, &Workers::new(1).unwrap()).unwrap_err();
        assert_eq!(
            error.to_string(),
            "`color_by` intensity: its vertices have no attribute intensity; there are: red, green, blue"
        );
    }
}
