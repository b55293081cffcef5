//! What is known of a vertex beside its place, where vertices move or colours count: what its attributes are made of, and its colour.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::gap::Drift;
use crate::mesh::MeshSource;
use crate::points::attribute::Attribute;
use crate::points::scalar::Scalar;

/// What a vertex's attributes are made of. It goes by the number of a vertex of the mesh that was given: the nearer end of the last edge it was placed on.
#[derive(Debug, Clone, Copy, PartialEq, Default, Zeroable, Pod)]
#[repr(C)]
pub(super) struct Blend {
    /// The vertex at the farther end.
    pub(super) other: u32,
    /// What that one counts: from 0 to ½.
    pub(super) share: f32,
    /// The vertex's colour as it is written; zero if there is none.
    pub(super) colour: [f32; 3],
}

impl Blend {
    /// A vertex that has not moved.
    pub(super) fn of(number: u32, colour: [f32; 3]) -> Blend {
        Blend { other: number, share: 0.0, colour }
    }

    pub(super) fn tint(&self) -> DVec3 {
        DVec3::from_array(self.colour.map(f64::from))
    }
}

/// What a triangle carries beside its corners' places.
#[derive(Debug, Clone, Copy, Default, Zeroable, Pod)]
#[repr(C)]
pub(super) struct Marks {
    pub(super) corners: [Blend; 3],
    /// How colours differ from what they were, rounded outwards: the least and the most of each channel.
    pub(super) tint: [[f32; 3]; 2],
}

/// Whether marks are carried: `()` where they are not, so that they take no room.
pub(super) trait Mark: Pod + Default + Send + Sync {
    /// Whether anything is carried.
    const CARRIED: bool;
    fn of(marks: Marks) -> Self;
    fn marks(self) -> Marks;
}

impl Mark for () {
    const CARRIED: bool = false;
    fn of(_: Marks) {}
    fn marks(self) -> Marks {
        Marks::default()
    }
}

impl Mark for Marks {
    const CARRIED: bool = true;
    fn of(marks: Marks) -> Marks {
        marks
    }
    fn marks(self) -> Marks {
        self
    }
}

/// A box of differences in single precision, never less than it is.
pub(super) fn outwards(drift: Drift) -> [[f32; 3]; 2] {
    let down = |x: f64| if f64::from(x as f32) > x { (x as f32).next_down() } else { x as f32 };
    let up = |x: f64| if f64::from(x as f32) < x { (x as f32).next_up() } else { x as f32 };
    [drift.low.to_array().map(down), drift.high.to_array().map(up)]
}

/// The box as it was.
pub(super) fn inwards(bounds: [[f32; 3]; 2]) -> Drift {
    let [low, high] = bounds.map(|ends| DVec3::from_array(ends.map(f64::from)));
    Drift { low, high }
}

/// The attributes that make the colour.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Colours {
    /// Their numbers: red, green, blue.
    pub(super) attributes: [usize; 3],
    /// Whether they are whole numbers.
    pub(super) whole: bool,
    /// How much a step of 255 is.
    pub(super) step: f64,
}

impl Colours {
    /// Those of a mesh; `None` if it has none.
    pub(super) fn of(mesh: &dyn MeshSource) -> Option<Colours> {
        let all = mesh.schema().attributes();
        let number = |name: &str| all.iter().position(|attribute| attribute.name == name);
        let attributes = [number("red")?, number("green")?, number("blue")?];
        let floats = |number: usize| matches!(all[number].scalar, Scalar::F32 | Scalar::F64);
        let whole = !attributes.into_iter().any(floats);
        let step = match all[attributes[0]].scalar {
            Scalar::U16 => 257.0,
            Scalar::F32 | Scalar::F64 => 1.0 / 255.0,
            _ => 1.0,
        };
        Some(Colours { attributes, whole, step })
    }

    /// The colour between two, as it is written.
    pub(super) fn between(self, a: DVec3, b: DVec3, share: f64) -> [f32; 3] {
        let between = a + (b - a) * share;
        let written = if self.whole { between.round() } else { between };
        written.to_array().map(|channel| channel as f32)
    }
}

/// Whether an attribute is a measure, so that one between two makes sense. Whole numbers are names or counts, such as classes and returns, except these.
pub(super) fn is_measure(attribute: &Attribute) -> bool {
    matches!(attribute.scalar, Scalar::F32 | Scalar::F64)
        || ["red", "green", "blue", "nir", "intensity"].contains(&attribute.name.as_str())
}
