//! Normals, colours and light: what a surface looks like where it is seen.
//!
//! ```text
//!              up
//!     key  \   |   /  fill          The key light comes from the upper left, before the mesh, the fill from the right. A sky above and a ground
//!           \  |  /                 below light what neither reaches. All of them turn with the view: every picture is lit alike.
//!            \ | /
//!   ---------- o ---------- right   (the viewer is in front of the paper)
//! ```
//!
//! Light is added and averaged in linear values; sRGB is what comes in and goes out.

use glam::Vec3;

use super::raster::{Paint, SAMPLES, Sample};

/// Which normals light falls on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Shading {
    /// Those of vertices, so that triangles do not show; but edges do.
    #[default]
    Smooth,
    /// Those of triangles.
    Flat,
}

/// A pixel of a view: the light of its samples, and where the nearest of them is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pixel {
    /// The sum over its samples, of those that see something, in [`FULL`] / SAMPLES²: linear.
    light: [u16; 3],
    /// Samples that see something.
    covered: u16,
    /// How far away the nearest surface is, in pixels; infinite if there is none.
    pub depth: f32,
}

/// Full light, if all samples have it.
const FULL: f32 = 65535.0;

impl Pixel {
    /// Nothing is seen.
    pub const EMPTY: Pixel = Pixel { light: [0; 3], covered: 0, depth: f32::INFINITY };

    /// What the samples of a pixel come to; a depth of 1 is `deep` pixels.
    pub fn of(samples: &[Sample], deep: f32) -> Pixel {
        let mut light = Vec3::ZERO;
        let (mut covered, mut nearest) = (0, u32::MAX);
        for sample in samples {
            if let Some(depth) = sample.depth() {
                light += lit(sample.paint);
                covered += 1;
                nearest = nearest.min(depth);
            }
        }
        if covered == 0 {
            return Pixel::EMPTY;
        }
        let light = (light * (FULL / (SAMPLES * SAMPLES) as f32) + 0.5).to_array().map(|c| c as u16);
        Pixel { light, covered, depth: nearest as f32 * deep }
    }

    /// The light, of which `share` is left, and how much of the pixel is covered.
    pub fn light(&self, share: f32) -> (Vec3, f32) {
        let light = Vec3::from_array(self.light.map(f32::from)) * (share / FULL);
        (light, f32::from(self.covered) / (SAMPLES * SAMPLES) as f32)
    }
}

/// Where the lights are, as unit vectors: right, up, to the viewer.
const KEY: Vec3 = Vec3::new(-0.4837, 0.5805, 0.6547);
const FILL: Vec3 = Vec3::new(0.8018, 0.0, 0.5976);
/// What they give, and the sky above and the ground below.
const KEY_LIGHT: Vec3 = Vec3::new(1.04, 1.0, 0.94);
const FILL_LIGHT: Vec3 = Vec3::new(0.12, 0.13, 0.15);
const SKY_LIGHT: Vec3 = Vec3::new(0.27, 0.30, 0.36);
const GROUND_LIGHT: Vec3 = Vec3::new(0.13, 0.115, 0.10);
/// The brightest highlight.
const GLOSS: f32 = 0.06;
/// What a back is like: another tone, and this share of its own colour.
const BACK: [u8; 3] = [176, 92, 60];
const BACK_KEEPS: f32 = 0.3;

/// The light that comes from a sample.
fn lit(paint: Paint) -> Vec3 {
    let (mut colour, side) = unpack_tone(paint.tone);
    let mut normal = unpack_normal(paint.normal).unwrap_or(Vec3::Z);
    if side == Side::Back {
        colour = linear(BACK).lerp(colour, BACK_KEEPS);
        normal = -normal;
    }
    // A smooth normal may turn away a little where the surface itself does not.
    if normal.z < 0.0 {
        normal.z = 0.0;
        normal = normal.normalize_or(Vec3::Z);
    }
    let sky = 0.5 + 0.5 * normal.y;
    let light = KEY_LIGHT * normal.dot(KEY).max(0.0)
        + FILL_LIGHT * normal.dot(FILL).max(0.0)
        + GROUND_LIGHT.lerp(SKY_LIGHT, sky);
    let half = normal.dot((KEY + Vec3::Z).normalize()).max(0.0);
    let gloss = (0..5).fold(half, |power, _| power * power);
    (colour * light + GLOSS * gloss).clamp(Vec3::ZERO, Vec3::ONE)
}

/// Which side of a surface is seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The outside.
    Front,
    /// The inside, or the lower side of a sheet.
    Back,
}

/// A colour in sRGB, and a side.
pub fn pack_tone([r, g, b]: [u8; 3], side: Side) -> u32 {
    u32::from_le_bytes([r, g, b, (side == Side::Back) as u8])
}

fn unpack_tone(tone: u32) -> (Vec3, Side) {
    let [r, g, b, back] = tone.to_le_bytes();
    (linear([r, g, b]), if back == 0 { Side::Front } else { Side::Back })
}

/// A packed normal that stands for none: no packed vector has it.
pub const NO_NORMAL: u32 = 0x8000_8000;
/// The largest number in a packed normal: even, so that the last bits of both can be used otherwise.
const SNORM: f32 = 32766.0;

/// A direction in 32 bits: folded onto an octahedron, the octahedron onto a square; off by less than 10⁻⁴. [`NO_NORMAL`] if it is none.
pub fn pack_normal(v: Vec3) -> u32 {
    let sum = v.abs().element_sum();
    if sum.is_nan() || sum <= 0.0 || sum.is_infinite() {
        return NO_NORMAL;
    }
    let (mut x, mut y) = (v.x / sum, v.y / sum);
    if v.z < 0.0 {
        let sign = |c: f32| if c < 0.0 { -1.0 } else { 1.0 };
        (x, y) = ((1.0 - y.abs()) * sign(x), (1.0 - x.abs()) * sign(y));
    }
    let [x, y] = [x, y].map(|c| (c * SNORM).round() as i16 as u16);
    u32::from(x) << 16 | u32::from(y)
}

/// The direction again, of length 1.
#[inline]
pub fn unpack_normal(packed: u32) -> Option<Vec3> {
    if packed == NO_NORMAL {
        return None;
    }
    let [x, y] = [packed >> 16, packed & 0xffff].map(|bits| f32::from(bits as u16 as i16) / SNORM);
    let mut v = Vec3::new(x, y, 1.0 - x.abs() - y.abs());
    let below = (-v.z).max(0.0);
    v.x -= below.copysign(x);
    v.y -= below.copysign(y);
    Some(v.normalize())
}

/// The linear values of sRGB's 256, computed once.
static LINEAR: std::sync::LazyLock<[f32; 256]> = std::sync::LazyLock::new(|| {
    std::array::from_fn(|i| {
        let c = i as f64 / 255.0;
        (if c <= 0.04045 { c / 12.92 } else { libm::pow((c + 0.055) / 1.055, 2.4) }) as f32
    })
});

/// A colour's linear values.
#[inline]
pub fn linear(colour: [u8; 3]) -> Vec3 {
    Vec3::from_array(colour.map(|c| LINEAR[usize::from(c)]))
}

/// The sRGB value nearest to a linear one.
pub fn encode(light: f32) -> u8 {
    let c = light.clamp(0.0, 1.0);
    let value = if c <= 0.003_130_8 { c * 12.92 } else { 1.055 * libm::powf(c, 1.0 / 2.4) - 0.055 };
    (value * 255.0 + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_lights_are_unit_vectors_and_colours_come_back() {
        assert!((KEY.length() - 1.0).abs() < 1e-3 && (FILL.length() - 1.0).abs() < 1e-3);
        for c in 0..=255u8 {
            assert_eq!(encode(linear([c; 3]).x), c);
        }
        assert_eq!((encode(-1.0), encode(2.0), encode(f32::NAN)), (0, 255, 0));
    }

    proptest! {
        #[test]
        fn normals_come_back(x in -1f32..1.0, y in -1f32..1.0, z in -1f32..1.0) {
            let v = Vec3::new(x, y, z);
            prop_assume!(v.length() > 1e-3);
            let back = unpack_normal(pack_normal(v)).unwrap();
            prop_assert!((back - v.normalize()).length() < 1e-4);
        }
    }

    #[test]
    fn what_is_no_direction_is_none() {
        for v in [Vec3::ZERO, Vec3::NAN, Vec3::INFINITY] {
            assert_eq!(unpack_normal(pack_normal(v)), None);
        }
        for v in [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z] {
            assert_eq!(unpack_normal(pack_normal(v)), Some(v));
        }
    }

    #[test]
    fn half_covered_is_half_the_light() {
        let paint = Paint { normal: pack_normal(Vec3::Z), tone: pack_tone([200; 3], Side::Front) };
        let whole = lit(paint);
        assert!(whole.cmplt(Vec3::ONE).all() && whole.cmpgt(Vec3::splat(0.3)).all(), "{whole}");
        let back = Paint { normal: pack_normal(Vec3::NEG_Z), tone: pack_tone([200; 3], Side::Back) };
        assert!(lit(back).x > lit(back).z * 1.5, "backs have another tone");
    }
}
