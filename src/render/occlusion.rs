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
//! That is what surveyors call the openness of terrain. Surfaces far in front hide more than they shade, and count nothing. The lines of a pixel and its neighbours are turned against
//! each other, sixteen ways in a square of four by four, over which means are taken then, of pixels at about the same depth: so a few looks do for each pixel, and single ones do
//! not show.

use super::shading::Pixel;

/// Lines through a pixel.
const LINES: usize = 4;
/// Pixels along a side of the square in which every pixel has lines of its own.
const SQUARE: usize = 4;
/// How far the look goes, as a share of the shorter side of the view.
const REACH: f32 = 1.0 / 18.0;
/// From one distance looked at to the next.
const GROWTH: f32 = 1.6;
/// Distances looked at.
const STEPS: usize = 7;
/// How much farther in front than the look goes what counts nothing is.
const BEYOND: f32 = 2.0;
/// How much darker what is not open at all is.
const STRENGTH: f32 = 1.25;

/// The places looked at from the pixels of a view.
#[derive(Debug)]
pub struct Openness {
    width: usize,
    height: usize,
    reach: f32,
    /// For each pixel of the square, each line and each step: columns and rows to go, and the inverse of the distance.
    looks: Vec<(i32, i32, f32)>,
}

impl Openness {
    /// For views of this size.
    pub fn new(width: usize, height: usize) -> Openness {
        let reach = (width.min(height) as f32 * REACH).max(2.0);
        let mut looks = Vec::new();
        for pixel in 0..SQUARE * SQUARE {
            // Neighbours are far from each other in the order of lines.
            let turn = (pixel * 7 % 16) as f32 / 16.0;
            let nearer = (pixel * 11 % 16) as f32 / 16.0;
            for line in 0..LINES {
                let (sin, cos) = libm::sincosf(std::f32::consts::PI * (line as f32 + turn) / LINES as f32);
                for step in 0..STEPS {
                    let distance = (reach / libm::powf(GROWTH, (STEPS - 1 - step) as f32 + nearer)).max(1.0);
                    let (x, y) = ((cos * distance).round(), (sin * distance).round());
                    looks.push((x as i32, y as i32, 1.0 / libm::hypotf(x, y)));
                }
            }
        }
        Openness { width, height, reach, looks }
    }

    /// The share of light that reaches each pixel of a row, in 255ths; all of it where nothing is seen.
    pub fn of_row(&self, pixels: &[Pixel], row: usize) -> Vec<u8> {
        (0..self.width).map(|column| (self.of(pixels, column, row) * 255.0 + 0.5) as u8).collect()
    }

    fn of(&self, pixels: &[Pixel], column: usize, row: usize) -> f32 {
        let own = pixels[row * self.width + column].depth;
        if own == f32::INFINITY {
            return 1.0;
        }
        let slope = |x: i32, y: i32, inverse: f32, steepest: f32| {
            let (x, y) = (column as i32 + x, row as i32 + y);
            if x < 0 || y < 0 || x >= self.width as i32 || y >= self.height as i32 {
                return steepest;
            }
            // Nothing is infinitely far away, and below every slope.
            let rise = own - pixels[y as usize * self.width + x as usize].depth;
            let counts = ((BEYOND * self.reach - rise) / ((BEYOND - 1.0) * self.reach)).min(1.0);
            if counts <= 0.0 {
                return steepest;
            }
            // Less than the slope of what is near, the less it counts.
            steepest.max(rise * inverse * counts - (1.0 - counts))
        };
        let sine = |slope: f32| if slope == f32::NEG_INFINITY { -1.0 } else { slope / (1.0 + slope * slope).sqrt() };
        let mut missing = 0.0;
        let pattern = row % SQUARE * SQUARE + column % SQUARE;
        for line in self.looks[pattern * LINES * STEPS..(pattern + 1) * LINES * STEPS].chunks_exact(STEPS) {
            let (mut one, mut other) = (f32::NEG_INFINITY, f32::NEG_INFINITY);
            for &(x, y, inverse) in line {
                one = slope(x, y, inverse, one);
                other = slope(-x, -y, inverse, other);
            }
            missing += (sine(one) + sine(other)).max(0.0);
        }
        (1.0 - STRENGTH * missing / (2 * LINES) as f32).max(0.1)
    }

    /// The mean of `open` over a square round a pixel, as a share.
    pub fn mean(&self, pixels: &[Pixel], open: &[u8], column: usize, row: usize) -> f32 {
        let own = pixels[row * self.width + column].depth;
        let (mut sum, mut count) = (0u32, 0u32);
        let around = |at: usize, length: usize| at.saturating_sub(SQUARE / 2)..(at + SQUARE / 2).min(length);
        for y in around(row, self.height) {
            for x in around(column, self.width) {
                let at = y * self.width + x;
                if (pixels[at].depth - own).abs() <= self.reach / 4.0 {
                    sum += u32::from(open[at]);
                    count += 1;
                }
            }
        }
        sum as f32 / (255 * count.max(1)) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(depth: impl Fn(f32, f32) -> f32) -> f32 {
        let at = |i: usize| {
            let mut pixel = Pixel::EMPTY;
            pixel.depth = depth((i % 200) as f32 - 100.0, (i / 200) as f32 - 100.0);
            pixel
        };
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
        assert!(of(|x, _| if x > 5.0 { 100.0 } else { 500.0 }) > 0.99, "what is far in front");
    }
}
