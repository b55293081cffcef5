//! Words in small letters of five by seven dots: names of views, and what legends say.

use super::contact_sheet::{Cell, Picture};

/// Columns and rows of a letter.
const COLUMNS: usize = 5;
pub const ROWS: usize = 7;

/// The letters there are: rows from the top, the highest of five bits to the left.
const LETTERS: [(char, [u8; ROWS]); 43] = [
    ('a', [0x0e, 0x11, 0x11, 0x1f, 0x11, 0x11, 0x11]),
    ('b', [0x1e, 0x11, 0x11, 0x1e, 0x11, 0x11, 0x1e]),
    ('c', [0x0e, 0x11, 0x10, 0x10, 0x10, 0x11, 0x0e]),
    ('d', [0x1e, 0x11, 0x11, 0x11, 0x11, 0x11, 0x1e]),
    ('e', [0x1f, 0x10, 0x10, 0x1e, 0x10, 0x10, 0x1f]),
    ('f', [0x1f, 0x10, 0x10, 0x1e, 0x10, 0x10, 0x10]),
    ('g', [0x0e, 0x11, 0x10, 0x17, 0x11, 0x11, 0x0f]),
    ('h', [0x11, 0x11, 0x11, 0x1f, 0x11, 0x11, 0x11]),
    ('i', [0x0e, 0x04, 0x04, 0x04, 0x04, 0x04, 0x0e]),
    ('j', [0x07, 0x02, 0x02, 0x02, 0x02, 0x12, 0x0c]),
    ('k', [0x11, 0x12, 0x14, 0x18, 0x14, 0x12, 0x11]),
    ('l', [0x10, 0x10, 0x10, 0x10, 0x10, 0x10, 0x1f]),
    ('m', [0x11, 0x1b, 0x15, 0x15, 0x11, 0x11, 0x11]),
    ('n', [0x11, 0x11, 0x19, 0x15, 0x13, 0x11, 0x11]),
    ('o', [0x0e, 0x11, 0x11, 0x11, 0x11, 0x11, 0x0e]),
    ('p', [0x1e, 0x11, 0x11, 0x1e, 0x10, 0x10, 0x10]),
    ('q', [0x0e, 0x11, 0x11, 0x11, 0x15, 0x12, 0x0d]),
    ('r', [0x1e, 0x11, 0x11, 0x1e, 0x14, 0x12, 0x11]),
    ('s', [0x0f, 0x10, 0x10, 0x0e, 0x01, 0x01, 0x1e]),
    ('t', [0x1f, 0x04, 0x04, 0x04, 0x04, 0x04, 0x04]),
    ('u', [0x11, 0x11, 0x11, 0x11, 0x11, 0x11, 0x0e]),
    ('v', [0x11, 0x11, 0x11, 0x11, 0x11, 0x0a, 0x04]),
    ('w', [0x11, 0x11, 0x11, 0x15, 0x15, 0x1b, 0x11]),
    ('x', [0x11, 0x11, 0x0a, 0x04, 0x0a, 0x11, 0x11]),
    ('y', [0x11, 0x11, 0x0a, 0x04, 0x04, 0x04, 0x04]),
    ('z', [0x1f, 0x01, 0x02, 0x04, 0x08, 0x10, 0x1f]),
    ('0', [0x0e, 0x11, 0x13, 0x15, 0x19, 0x11, 0x0e]),
    ('1', [0x04, 0x0c, 0x04, 0x04, 0x04, 0x04, 0x0e]),
    ('2', [0x0e, 0x11, 0x01, 0x02, 0x04, 0x08, 0x1f]),
    ('3', [0x1f, 0x02, 0x04, 0x02, 0x01, 0x11, 0x0e]),
    ('4', [0x02, 0x06, 0x0a, 0x12, 0x1f, 0x02, 0x02]),
    ('5', [0x1f, 0x10, 0x1e, 0x01, 0x01, 0x11, 0x0e]),
    ('6', [0x06, 0x08, 0x10, 0x1e, 0x11, 0x11, 0x0e]),
    ('7', [0x1f, 0x01, 0x02, 0x04, 0x08, 0x08, 0x08]),
    ('8', [0x0e, 0x11, 0x11, 0x0e, 0x11, 0x11, 0x0e]),
    ('9', [0x0e, 0x11, 0x11, 0x0f, 0x01, 0x02, 0x0c]),
    (':', [0x00, 0x0c, 0x0c, 0x00, 0x0c, 0x0c, 0x00]),
    ('.', [0x00, 0x00, 0x00, 0x00, 0x00, 0x0c, 0x0c]),
    ('-', [0x00, 0x00, 0x00, 0x1f, 0x00, 0x00, 0x00]),
    ('+', [0x00, 0x04, 0x04, 0x1f, 0x04, 0x04, 0x00]),
    ('_', [0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x1f]),
    (',', [0x00, 0x00, 0x00, 0x00, 0x0c, 0x04, 0x08]),
    (' ', [0x00; ROWS]),
];

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
    text.chars().count() * (COLUMNS + 1) * dot
}

/// Writes a text whose upper left corner is at a pixel of a cell, in which there is room for it. Letters that there are not stay blank.
pub fn write_at(picture: &mut Picture, cell: &Cell, [left, top]: [usize; 2], dot: usize, text: &str) {
    for (i, letter) in text.chars().enumerate() {
        let letter = letter.to_ascii_lowercase();
        let Some((_, rows)) = LETTERS.iter().find(|(known, _)| *known == letter) else { continue };
        for y in 0..ROWS * dot {
            let channels = picture.channels;
            let line = picture.row(cell, top + y);
            for x in 0..COLUMNS * dot {
                if rows[y / dot] >> (COLUMNS - 1 - x / dot) & 1 == 1 {
                    let at = (left + i * (COLUMNS + 1) * dot + x) * channels;
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
            assert!(name.chars().all(|c| LETTERS.iter().any(|(known, _)| *known == c)), "{name}");
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
        assert_eq!(changed.len(), 11 + 16 + 15, "dots of three letters");
        assert!(changed.iter().all(|i| (14..90).contains(&(i % 100)) && (44..51).contains(&(i / 100))));
    }
}
