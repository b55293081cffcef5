//! Words in small letters of eight by eight dots: names of views, and what legends say.

use font8x8::legacy::BASIC_LEGACY;

use super::contact_sheet::{Cell, Picture};

/// Columns of a letter, the gap behind it included, and rows.
const COLUMNS: usize = 8;
pub const ROWS: usize = 8;

/// The colour of letters, and how much of it there is, in 256ths.
const INK: (u8, u32) = (128, 200);

/// Writes a name into the lower left corner of a cell, if there is room.
pub fn write(picture: &mut Picture, cell: &Cell, name: &str) {
    let dot = dot(cell);
    let margin = 4 * dot;
    let height = ROWS * dot;
    if cell.width < width(name, dot) + 2 * margin || cell.height < 4 * height {
        return;
    }
    write_at(picture, cell, [margin, cell.height - margin - height], dot, name);
}

/// The pixels of a letter's dot, in a cell.
pub fn dot(cell: &Cell) -> usize {
    (cell.width.min(cell.height) / 240).max(1)
}

/// Pixels that a text takes, with the gap behind it.
pub fn width(text: &str, dot: usize) -> usize {
    text.chars().count() * COLUMNS * dot
}

/// Writes a text whose upper left corner is at a pixel of a cell, in which there is room for it. Letters beyond ASCII stay blank.
pub fn write_at(picture: &mut Picture, cell: &Cell, [left, top]: [usize; 2], dot: usize, text: &str) {
    for (i, letter) in text.chars().enumerate() {
        let Some(rows) = BASIC_LEGACY.get(letter as usize) else { continue };
        for y in 0..ROWS * dot {
            let channels = picture.channels;
            let line = picture.row(cell, top + y);
            for x in 0..COLUMNS * dot {
                // The lowest bit is the leftmost dot.
                if rows[y / dot] >> (x / dot) & 1 == 1 {
                    let at = (left + i * COLUMNS * dot + x) * channels;
                    let pixel = &mut line[at..at + channels];
                    let ink = |behind: u8, ink: u8| {
                        ((u32::from(behind) * (256 - INK.1) + u32::from(ink) * INK.1) / 256) as u8
                    };
                    pixel[..3].iter_mut().for_each(|c| *c = ink(*c, INK.0));
                    pixel[3..].iter_mut().for_each(|opacity| *opacity = ink(*opacity, 255));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::contact_sheet::{Background, Size};
    use super::super::view::View;
    use super::*;

    #[test]
    fn every_name_can_be_written() {
        for view in ["iso", "front", "back", "left", "right", "top", "bottom", "-12.5:30", "1e2:-0.25"] {
            let name = view.parse::<View>().unwrap().name;
            assert!(
                name.chars().all(|c| BASIC_LEGACY.get(c as usize).is_some_and(|rows| rows.iter().any(|row| *row != 0))),
                "{name}"
            );
        }
    }

    #[test]
    fn letters_stay_in_their_cell() {
        let size = Size { width: 100, height: 60 };
        let mut picture = Picture::new(size, Background::Colour([255; 3]));
        let before = picture.clone();
        write(&mut picture, &Cell { left: 0, top: 0, width: 20, height: 60 }, "bottom");
        assert_eq!(picture, before, "no room");
        let cell = Cell { left: 10, top: 5, width: 80, height: 50 };
        write(&mut picture, &cell, "top");
        let changed = |i: &usize| picture.pixels[3 * i] != before.pixels[3 * i];
        let changed: Vec<usize> = (0..size.pixels()).filter(changed).collect();
        let dots: u32 = "top".chars().flat_map(|c| BASIC_LEGACY[c as usize]).map(u8::count_ones).sum();
        assert_eq!(changed.len(), dots as usize, "dots of three letters");
        assert!(changed.iter().all(|i| (14..90).contains(&(i % 100)) && (43..51).contains(&(i / 100))));
    }
}
