//! How open a pixel lies: less light reaches what lies in a hollow. Told by the depths round it alone.
//!
//! ```text
//!                       .          for each of some lines through the pixel: the steepest slope upwards (to the viewer) on either side,
//!      \ s1      s2 _ '            as a sine. On a plane, however it lies, they cancel; on a ridge they sum to less than zero, in a hollow
//!  #    \      . '     ###         to more: that is what is missing of the half circle above the pixel.
//!  ##    \ . '       ######
//!  ########o###############
//! ```
//!
//! That is what surveyors call the openness of terrain. Surfaces far in front, which hide more than they shade, count less.

use super::light::Pixel;

/// Lines through a pixel, as unit vectors over half a turn.
const LINES: usize = 8;
/// How far the look goes, as a share of the shorter side of the view.
const REACH: f32 = 1.0 / 20.0;
/// The distances looked at, as shares of the reach: dense where it matters.
const STEPS: [f32; 7] = [0.03, 0.08, 0.16, 0.28, 0.45, 0.68, 1.0];
/// How much darker what is not open at all is.
const STRENGTH: f32 = 1.15;

/// The places looked at from a pixel.
#[derive(Debug)]
pub struct Openness {
    width: usize,
    height: usize,
    reach: f32,
    /// Of each line, of each step: columns and rows to go, and the distance's inverse.
    looks: Vec<(i32, i32, f32)>,
    steps: usize,
}

impl Openness {
    /// For views of this size.
    pub fn new(width: usize, height: usize) -> Openness {
        let reach = (width.min(height) as f32 * REACH).max(2.0);
        let mut looks: Vec<(i32, i32, f32)> = Vec::new();
        let mut distances: Vec<f32> = STEPS.iter().map(|step| (step * reach).max(1.0).round()).collect();
        distances.dedup();
        for line in 0..LINES {
            let (sin, cos) = (std::f32::consts::PI * line as f32 / LINES as f32).sin_cos();
            looks.extend(distances.iter().map(|distance| {
                let (x, y) = ((cos * distance).round(), (sin * distance).round());
                (x as i32, y as i32, 1.0 / x.hypot(y))
            }));
        }
        Openness { width, height, reach, looks, steps: distances.len() }
    }

    /// The share of light that reaches a pixel which sees something.
    pub fn of(&self, pixels: &[Pixel], column: usize, row: usize) -> f32 {
        let own = pixels[row * self.width + column].depth;
        let slope = |x: i32, y: i32, inverse: f32, steepest: f32| {
            let (x, y) = (column as i32 + x, row as i32 + y);
            if x < 0 || y < 0 || x >= self.width as i32 || y >= self.height as i32 {
                return steepest;
            }
            // Nothing is infinitely far away, and below every slope.
            let mut rise = own - pixels[y as usize * self.width + x as usize].depth;
            if rise > self.reach {
                rise = self.reach * self.reach / rise;
            }
            steepest.max(rise * inverse)
        };
        let sine = |slope: f32| if slope == f32::NEG_INFINITY { -1.0 } else { slope / (1.0 + slope * slope).sqrt() };
        let mut missing = 0.0;
        for line in self.looks.chunks_exact(self.steps) {
            let (mut one, mut other) = (f32::NEG_INFINITY, f32::NEG_INFINITY);
            for &(x, y, inverse) in line {
                one = slope(x, y, inverse, one);
                other = slope(-x, -y, inverse, other);
            }
            missing += (sine(one) + sine(other)).max(0.0);
        }
        (1.0 - STRENGTH * missing / (2 * LINES) as f32).max(0.15)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(depth: impl Fn(f32, f32) -> f32) -> f32 {
        let at = |i: usize| Pixel { depth: depth((i % 200) as f32 - 100.0, (i / 200) as f32 - 100.0), ..Pixel::EMPTY };
        let pixels: Vec<Pixel> = (0..200 * 200).map(at).collect();
        Openness::new(200, 200).of(&pixels, 100, 100)
    }

    #[test]
    fn planes_and_ridges_are_open_and_hollows_are_not() {
        assert_eq!(of(|_, _| 5.0), 1.0);
        assert!(of(|x, y| 500.0 + 3.0 * x - 0.5 * y) > 0.999, "a plane that lies askew");
        assert_eq!(of(|x, y| 500.0 + x.abs() + y.abs()), 1.0);
        assert_eq!(of(|x, _| if x > 0.0 { f32::INFINITY } else { 9.0 }), 1.0, "a rim");
        let gutter = of(|x, _| 500.0 - x.abs());
        let pit = of(|x, y| 500.0 - 2.0 * x.hypot(y));
        assert!(pit < gutter && gutter < 0.8, "{pit} {gutter}");
    }
}
