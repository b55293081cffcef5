//! Which bytes of a LAS or LAZ file are needed for the points in a box: of a file that lies apart from the box, its header alone; of a COPC file, the chunks whose cubes meet it.
//!
//! ```text
//!  COPC | header | VLR "copc": cube, place of the root page | VLRs | chunk | chunk | … | table | EVLR "copc": page, page, … |
//!
//!  entry of a page: level, x, y, z of a cube (i32 each) | where its chunk begins (u64) | bytes (i32) | points (i32)
//! ```
//!
//! An entry with −1 points is another page. A chunk is left out only if table and hierarchy tell the same of it, and its cube does not meet the box; what nothing is known of is fetched.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use byteorder::{ByteOrder, LE};

use super::header::Header;
use super::is_las;
use crate::error::Result;
use crate::format::laz::Packed;
use crate::points::bounds::Bounds;
use crate::storage::mapped::{Absent, Content};

/// Bytes that are fetched of any file to look at it.
const HEAD: u64 = 64 << 10;

/// Where the header of a file has its box.
const BOX: usize = 179;

/// The VLR of a COPC file, which comes first: where its content begins, and how long that is.
const COPC: (u64, usize) = (375 + 54, 160);

/// Bytes of an entry of the hierarchy, and the most entries that are looked at.
const ENTRY: usize = 32;
const ENTRIES: usize = 1 << 22;

/// The deepest level of a cube.
const LEVELS: u32 = 31;

/// What is needed of a file.
pub enum Choice {
    /// All of it; its first bytes are there.
    Whole {
        /// So many.
        there: u64,
    },
    /// These stretches, beside those that are there.
    Part {
        /// Whose points are never there.
        absent: Absent,
        /// What is to be fetched yet.
        wanted: Vec<Range<u64>>,
    },
}

/// Looks at a file of which nothing is there yet, and finds what is needed for the points in a box. `fetch` sees to it that a stretch is there.
///
/// # Errors
/// Those of `fetch`. A file that is damaged is one that is needed whole: whoever opens it says what is wrong.
pub fn choose(content: &Content, bounds: &Bounds, fetch: &mut dyn FnMut(Range<u64>) -> Result<()>) -> Result<Choice> {
    let file = content.open()?;
    let there = file.len().min(HEAD);
    fetch(0..there)?;
    let whole = Ok(Choice::Whole { there });
    let head = file.read(0..there)?;
    if !is_las(&head) || head.len() < COPC.0 as usize + COPC.1 || file.len() < 2 * HEAD {
        return whole;
    }
    let Some(Layout { start, records, tail, scale, copc }) = layout(&head, file.len()) else { return whole };
    // Writers round the box, and places in cubes.
    let meets = |of: &Bounds| {
        (0..3).all(|axis| {
            of.min[axis] - scale[axis] <= bounds.max[axis] && of.max[axis] + scale[axis] >= bounds.min[axis]
        })
    };
    let Some(of_file) = box_of(&head) else { return whole };
    let apart = !meets(&of_file);
    let copc = copc.filter(|_| !apart);
    if !apart && copc.is_none() {
        return whole;
    }
    fetch(there.min(records)..records)?;
    // What is behind the points: the table of a LAZ file's chunks, and EVLRs.
    let end = match tail {
        Tail::None => file.len(),
        Tail::At(at) => at,
        Tail::Table => {
            let table = LE::read_u64(&file.read(start..start + 8)?);
            let evlrs = evlrs(&head).unwrap_or(u64::MAX);
            if table <= records || table > file.len() - 8 || evlrs < records {
                return whole;
            }
            table.min(evlrs)
        }
    };
    fetch(end.max(there)..file.len())?;
    let listed = || {
        let header = Header::read(&file).ok()?;
        Some((Packed::open(&file, &header).ok()?, header.count))
    };
    let is_listed =
        || listed().is_some_and(|(packed, count)| packed.each_chunk(&file, count, &mut |_, _, _| ()).is_some());
    if apart && compressed(&head) && !is_listed() {
        return whole;
    }
    if apart {
        return Ok(Choice::Part { absent: Absent::All, wanted: Vec::new() });
    }
    let Some(copc) = copc else { return whole };
    let Some(apart) = hierarchy(&copc, &meets, &mut |range| {
        if range.end > there.max(records) && range.start < end {
            fetch(range.clone())?;
        }
        file.read(range)
    })?
    else {
        return whole;
    };
    let mut absent = Vec::new();
    let Some((packed, count)) = listed() else { return whole };
    let each = packed.each_chunk(&file, count, &mut |at, bytes, points| {
        if apart.get(&at) == Some(&(bytes, points)) {
            absent.push(at..at + bytes);
        }
    });
    let Some(first) = each else { return whole };
    let mut wanted = Vec::new();
    let mut from = first.max(there);
    for chunk in &absent {
        if chunk.start > from {
            wanted.push(from..chunk.start);
        }
        from = from.max(chunk.end);
    }
    if end > from {
        wanted.push(from..end);
    }
    Ok(Choice::Part { absent: Absent::Chunks(absent.iter().map(|chunk| chunk.start).collect()), wanted })
}

/// How a file is laid out, as far as its first bytes tell.
struct Layout {
    start: u64,
    /// Where what comes before the points ends.
    records: u64,
    tail: Tail,
    scale: [f64; 3],
    copc: Option<Cubes>,
}

/// What comes behind the points.
enum Tail {
    None,
    At(u64),
    /// A table of chunks, whose place stands where the points begin.
    Table,
}

/// The cube of a COPC file, where its root page lies, and the file's length.
struct Cubes {
    center: [f64; 3],
    half: f64,
    root: Range<u64>,
    length: u64,
}

fn triple(head: &[u8], at: usize, step: usize) -> [f64; 3] {
    [0, 1, 2].map(|axis| LE::read_f64(&head[at + step * axis..]))
}

fn compressed(head: &[u8]) -> bool {
    head[104] & 0x80 != 0
}

fn evlrs(head: &[u8]) -> Option<u64> {
    (head[25] >= 4 && LE::read_u32(&head[243..]) > 0).then(|| LE::read_u64(&head[235..]))
}

fn layout(head: &[u8], length: u64) -> Option<Layout> {
    let start = u64::from(LE::read_u32(&head[96..]));
    let compressed = compressed(head);
    let (records, tail) = match (compressed, evlrs(head)) {
        (true, _) => (start + 8, Tail::Table),
        (false, None) => (start, Tail::None),
        (false, Some(at)) => (start, Tail::At(at)),
    };
    let scale = triple(head, 131, 8).map(f64::abs);
    let in_file = |at: u64| at >= records && at <= length;
    let tail_is_sound = if let Tail::At(at) = tail { in_file(at) } else { true };
    if records > length - 8 || !tail_is_sound || !scale.iter().all(|step| step.is_finite()) {
        return None;
    }
    let copc = (compressed && LE::read_u16(&head[94..]) == 375).then(|| cubes(head, length)).flatten();
    Some(Layout { start, records, tail, scale, copc })
}

/// The header's box, if it can be one.
fn box_of(head: &[u8]) -> Option<Bounds> {
    let (max, min) = (triple(head, BOX, 16), triple(head, BOX + 8, 16));
    let is_sound = (0..3).all(|axis| min[axis].is_finite() && max[axis].is_finite() && min[axis] <= max[axis]);
    (is_sound && (min != [0.0; 3] || max != [0.0; 3])).then_some(Bounds { min, max })
}

fn cubes(head: &[u8], length: u64) -> Option<Cubes> {
    let vlr = &head[375..];
    if !vlr[2..].starts_with(b"copc\0")
        || LE::read_u16(&vlr[18..]) != 1
        || usize::from(LE::read_u16(&vlr[20..])) != COPC.1
    {
        return None;
    }
    let content = &head[COPC.0 as usize..];
    let (center, half) = (triple(content, 0, 8), LE::read_f64(&content[24..]));
    let root = page(LE::read_u64(&content[40..]), LE::read_u64(&content[48..]), length)?;
    let is_sound = half.is_finite() && half > 0.0 && center.iter().all(|place| place.is_finite());
    is_sound.then_some(Cubes { center, half, root, length })
}

/// A page of the hierarchy, if it can be one.
fn page(at: u64, bytes: u64, length: u64) -> Option<Range<u64>> {
    let end = at.checked_add(bytes)?;
    (bytes > 0 && end <= length && bytes.is_multiple_of(ENTRY as u64) && bytes <= (ENTRIES * ENTRY) as u64)
        .then_some(at..end)
}

/// The chunks whose cubes do not meet a box, by where they begin, with their bytes and points; None if the hierarchy is not as it should be.
fn hierarchy(
    cubes: &Cubes,
    meets: &dyn Fn(&Bounds) -> bool,
    read: &mut dyn FnMut(Range<u64>) -> Result<Vec<u8>>,
) -> Result<Option<BTreeMap<u64, (u64, u64)>>> {
    /// Bytes of a page that are looked at at a time.
    const PIECE: u64 = 1 << 20;
    let (mut apart, mut seen, mut entries) = (BTreeMap::new(), BTreeSet::new(), 0);
    let mut waiting = vec![cubes.root.clone()];
    while let Some(page_at) = waiting.pop() {
        if !seen.insert(page_at.start) {
            return Ok(None);
        }
        for from in page_at.clone().step_by(PIECE as usize) {
            let bytes = read(from..(from + PIECE).min(page_at.end))?;
            entries += bytes.len() / ENTRY;
            if entries > ENTRIES {
                return Ok(None);
            }
            for entry in bytes.chunks_exact(ENTRY) {
                let number = |at: usize| LE::read_i32(&entry[at..]);
                let (at, length, points) = (LE::read_u64(&entry[16..]), number(24), number(28));
                let (Ok(length), level) = (u64::try_from(length), number(0)) else { return Ok(None) };
                match points {
                    -1 => match page(at, length, cubes.length) {
                        Some(next) => waiting.push(next),
                        None => return Ok(None),
                    },
                    0 => {}
                    1.. => {
                        let Some(cube) = cube(cubes, level, [number(4), number(8), number(12)]) else {
                            return Ok(None);
                        };
                        if !meets(&cube) {
                            apart.insert(at, (length, points as u64));
                        }
                    }
                    _ => return Ok(None),
                }
            }
        }
    }
    Ok(Some(apart))
}

/// The cube of a node, a little larger than it is.
fn cube(Cubes { center, half, .. }: &Cubes, level: i32, at: [i32; 3]) -> Option<Bounds> {
    let level = u32::try_from(level).ok().filter(|level| *level <= LEVELS)?;
    let parts = 1u64 << level;
    let side = 2.0 * half / parts as f64;
    if at.iter().any(|place| u64::try_from(*place).map_or(true, |place| place >= parts)) {
        return None;
    }
    let more = side * 1e-6;
    let low = |axis: usize| center[axis] - half + side * f64::from(at[axis]);
    Some(Bounds { min: [0, 1, 2].map(|axis| low(axis) - more), max: [0, 1, 2].map(|axis| low(axis) + side + more) })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn entry(level: i32, at: [i32; 3], chunk: u64, bytes: i32, points: i32) -> Vec<u8> {
        let mut out = Vec::new();
        [level, at[0], at[1], at[2]].iter().for_each(|number| out.extend(number.to_le_bytes()));
        out.extend(chunk.to_le_bytes());
        [bytes, points].iter().for_each(|number| out.extend(number.to_le_bytes()));
        out
    }

    proptest! {
        /// The chunks that are left out are those of cubes which a look at all of them finds apart from the box.
        #[test]
        fn cubes_are_chosen_as_by_a_look_at_all(
            nodes in prop::collection::vec((0..5i32, [0..16i32, 0..16, 0..16], 0..9i32), 1..60),
            low in [0.0..90.0f64, 0.0..90.0, 0.0..90.0],
            side in 0.1..60.0f64,
            paged in 1..20usize,
        ) {
            let bounds = Bounds { min: low, max: low.map(|low| low + side) };
            let meets = |of: &Bounds| (0..3).all(|a| of.min[a] <= bounds.max[a] && of.max[a] >= bounds.min[a]);
            let nodes: Vec<_> = nodes.into_iter().map(|(level, at, points)| (level, at.map(|place| place % (1 << level)), points)).collect();
            // Pages, each but the last with the next one as its last entry.
            let (mut file, mut root) = (vec![0; 1000], 0..0);
            for (number, of_page) in nodes.chunks(paged).enumerate().rev() {
                let mut page = Vec::new();
                for (within, (level, at, points)) in of_page.iter().enumerate() {
                    page.extend(entry(*level, *at, (number * paged + within) as u64, 40, *points));
                }
                if !root.is_empty() {
                    page.extend(entry(0, [0; 3], root.start, (root.end - root.start) as i32, -1));
                }
                root = file.len() as u64..(file.len() + page.len()) as u64;
                file.extend(page);
            }
            let cubes = Cubes { center: [50.0; 3], half: 50.0, root, length: file.len() as u64 };
            let mut read = |range: Range<u64>| Ok(file[range.start as usize..range.end as usize].to_vec());
            let found: Vec<u64> = hierarchy(&cubes, &meets, &mut read).unwrap().unwrap().into_keys().collect();
            let apart = |(_, (level, at, points)): &(usize, &(i32, [i32; 3], i32))| {
                let side = 100.0 / f64::from(1 << level);
                *points > 0 && (0..3).any(|a| f64::from(at[a]) * side > bounds.max[a] + side * 1e-6 || f64::from(at[a] + 1) * side < bounds.min[a] - side * 1e-6)
            };
            let expected: Vec<u64> = nodes.iter().enumerate().filter(apart).map(|(number, _)| number as u64).collect();
            prop_assert_eq!(found, expected);
        }

        /// Whatever a hierarchy holds, looking at it ends.
        #[test]
        fn no_hierarchy_makes_it_panic_or_go_on_for_ever(bytes in prop::collection::vec(any::<u8>(), 64..640), loops: bool) {
            let mut file = bytes;
            file.truncate(file.len() / ENTRY * ENTRY);
            if loops {
                file[..ENTRY].copy_from_slice(&entry(0, [0; 3], 0, 32, -1));
            }
            let length = file.len() as u64;
            let cubes = Cubes { center: [0.0; 3], half: 1.0, root: 0..length, length };
            let mut read = |range: Range<u64>| {
                // Nothing is asked for that is not there.
                Ok(file[range.start as usize..range.end as usize].to_vec())
            };
            let found = hierarchy(&cubes, &|_| false, &mut read).unwrap();
            prop_assert!(!loops || found.is_none());
        }

        /// Nor a file of which this is the beginning.
        #[test]
        fn no_header_makes_it_panic(bytes in prop::collection::vec(any::<u8>(), 600), length in 131_072u64..1 << 40) {
            let mut head = [b"LASF".as_slice(), &bytes].concat();
            head[94..96].copy_from_slice(&375u16.to_le_bytes());
            let _ = (layout(&head, length), box_of(&head));
        }
    }
}
