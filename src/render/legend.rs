//! The legend of a view, in a strip below it: how long a unit is, and which colours stand for which values.
//!
//! ```text
//!   +--------------------------------------------+
//!   |                 (the view)                 |
//!   |             12.5 [violet .. yellow] 48.1  height, m      the scale of colours, if these tell values
//!   | iso                            |------|  50 m            a length; views are parallel projections, so it holds everywhere
//!   +--------------------------------------------+
//! ```

use super::colour::{Tint, scale};
use super::contact_sheet::{Cell, Picture};
use super::label::{self, ROWS};
use crate::error::words::short;
use crate::points::unit::{Measure, Unit};

/// The least width and height of a cell that has a legend, in pixels.
const LEAST: usize = 240;

/// The largest share of a cell's width that a bar takes.
const LONGEST: f64 = 0.25;

/// The colour of bars, and of the text beside them.
const INK: u8 = 128;

/// What a legend says besides what the view itself tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Legend {
    /// There is none.
    #[default]
    None,
    /// There is one, with the unit of the mesh's coordinates, if that is known.
    In(Option<Measure>),
}

impl Legend {
    fn unit(self) -> &'static str {
        match self {
            Legend::In(Some(Measure::Length(unit))) => match unit {
                Unit::Millimetre => "mm",
                Unit::Centimetre => "cm",
                Unit::Metre => "m",
                Unit::Kilometre => "km",
                Unit::Inch => "in",
                Unit::Foot => "ft",
                Unit::SurveyFoot => "usft",
            },
            Legend::In(Some(Measure::Degrees)) => "deg",
            _ => "",
        }
    }

    /// Rows that it takes at the bottom of a cell.
    pub fn rows(self, cell: &Cell, tint: &Tint) -> usize {
        if self == Legend::None || cell.width.min(cell.height) < LEAST {
            return 0;
        }
        let lines = if matches!(tint, Tint::Scale(..)) { 2 } else { 1 };
        (4 + lines * (ROWS + 4)) * label::dot(cell)
    }

    /// Draws it below a view. `pixels`: those of a unit; `values`: the ends of the scale of colours, in the input's coordinates, and what they are of.
    pub fn draw(
        self,
        picture: &mut Picture,
        cell: &Cell,
        tint: &Tint,
        pixels: f64,
        values: Option<(f64, f64, String)>,
    ) {
        if self.rows(cell, tint) == 0 {
            return;
        }
        let dot = label::dot(cell);
        let (margin, height) = (4 * dot, ROWS * dot);
        // From the lowest line up; each is aligned to the right.
        let top = |line: usize| cell.height - (line + 1) * (height + margin);
        if let Some((length, text)) = round_length(LONGEST * cell.width as f64, pixels) {
            let text = format!("{text} {}", self.unit());
            let (bar, wide) = ((length * pixels).round() as usize, label::width(text.trim_end(), dot));
            if bar + wide + 3 * margin <= cell.width {
                let left = cell.width - margin - wide - margin - bar;
                let middle = top(0) + height / 2 - dot / 2;
                fill(picture, cell, [left, left + bar], [middle, middle + dot], |_| [INK; 3]);
                for end in [left, left + bar - dot.min(bar)] {
                    fill(picture, cell, [end, end + dot], [top(0), top(0) + height], |_| [INK; 3]);
                }
                label::write_at(picture, cell, [left + bar + margin, top(0)], dot, text.trim_end());
            }
        }
        if let Some((low, high, what)) = values {
            let unit = self.unit();
            let what = if unit.is_empty() || what != HEIGHT { what } else { format!("{what}, {unit}") };
            let texts = [rounded(low, high - low), rounded(high, high - low), what];
            let widths = texts.each_ref().map(|text| label::width(text, dot));
            let bar = (LONGEST * cell.width as f64) as usize;
            let whole = widths.iter().sum::<usize>() + bar + 5 * margin;
            if whole <= cell.width {
                let mut left = cell.width - whole + margin;
                label::write_at(picture, cell, [left, top(1)], dot, &texts[0]);
                left += widths[0] + margin;
                fill(picture, cell, [left, left + bar], [top(1), top(1) + height], |x| {
                    scale((x - left) as f32 / (bar - 1).max(1) as f32)
                });
                left += bar + margin;
                label::write_at(picture, cell, [left, top(1)], dot, &texts[1]);
                left += widths[1] + margin;
                label::write_at(picture, cell, [left, top(1)], dot, &texts[2]);
            }
        }
    }
}

/// What a scale of heights is called; its values have the unit of lengths.
pub const HEIGHT: &str = "height";

/// The longest of 1, 2, 5, 10, 20 and so on, and the like below 1, that takes at most so many pixels, as a number and as a text.
fn round_length(most: f64, pixels: f64) -> Option<(f64, String)> {
    let longest = most / pixels;
    if !longest.is_normal() || longest <= 0.0 || pixels <= 0.0 {
        return None;
    }
    let magnitude = libm::log10(longest).floor() as i32;
    let steps = (magnitude - 1..=magnitude + 1).flat_map(|power| [1, 2, 5].map(|digit| (digit, power)));
    let typed = |(digit, power): (i32, i32)| format!("{digit}e{power}").parse::<f64>().unwrap_or(0.0);
    let length = steps.map(typed).rfind(|length| *length <= longest && *length > 0.0)?;
    Some((length, short(length)))
}

/// A number with as many digits as tell the ends of a range of `extent` apart to a hundredth.
fn rounded(value: f64, extent: f64) -> String {
    if !extent.is_normal() || !value.is_finite() {
        return short(value);
    }
    let digits = (2 - libm::log10(extent.abs()).floor() as i32).max(0);
    // Many digits are none that anybody reads.
    if digits > 6 || value.abs() >= 1e9 { short(value) } else { format!("{value:.*}", digits as usize) }
}

/// Fills columns and rows of a cell.
fn fill(picture: &mut Picture, cell: &Cell, columns: [usize; 2], rows: [usize; 2], colour: impl Fn(usize) -> [u8; 3]) {
    let channels = picture.channels;
    for row in rows[0]..rows[1] {
        let line = picture.row(cell, row);
        for x in columns[0]..columns[1] {
            let pixel = &mut line[x * channels..(x + 1) * channels];
            pixel[..3].copy_from_slice(&colour(x));
            pixel[3..].fill(255);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_round_and_fit() {
        for (most, pixels, length) in [
            (100.0, 10.0, Some((10.0, "10"))),
            (99.0, 10.0, Some((5.0, "5"))),
            (100.0, 700.0, Some((0.1, "0.1"))),
            (100.0, 0.0004, Some((200_000.0, "200000"))),
            (100.0, 0.0, None),
            (100.0, f64::NAN, None),
        ] {
            let found = round_length(most, pixels);
            assert_eq!(found.as_ref().map(|(length, text)| (*length, text.as_str())), length, "{most} {pixels}");
        }
    }

    #[test]
    fn numbers_have_the_digits_that_tell_them_apart() {
        assert_eq!([rounded(407.1234, 50.0), rounded(457.1, 50.0)], ["407.1", "457.1"]);
        assert_eq!([rounded(0.0, 0.03), rounded(0.03, 0.03)], ["0.0000", "0.0300"]);
        assert_eq!([rounded(100.0, 65435.0), rounded(65535.0, 65435.0)], ["100", "65535"]);
        assert_eq!(rounded(3.0, 0.0), "3");
        assert_eq!(rounded(f64::NAN, 1.0), "NaN");
    }
}
