//! STL, binary and text: triangles that share no vertices until their corners are welded by exact position.

use crate::error::{Error, Result};
use crate::format::read::input::Input;
use crate::format::read::text::Lines;
use crate::format::read::weld::Welder;
use crate::mesh::spool::MeshSpool;
use crate::mesh::told_origin;
use crate::storage::spool::Workspace;

const HEADER: u64 = 84;
const RECORD: u64 = 50;
/// Records read at once.
const PIECE: u64 = 1 << 13;

pub(crate) fn read(input: &Input, workspace: &Workspace, in_memory: u64) -> Result<MeshSpool> {
    // A binary file may begin with "solid" too; only its length tells for certain.
    let mut head = [0; HEADER as usize];
    let known = input.length.min(HEADER) as usize;
    input.read_at(0, &mut head[..known])?;
    let promised = u64::from(u32::from_le_bytes([head[80], head[81], head[82], head[83]]));
    let binary = input.length >= HEADER && input.length == HEADER + promised * RECORD;
    if !binary && !head.trim_ascii_start().starts_with(b"solid") {
        let expected = if input.length < HEADER {
            format!("a header of {HEADER} bytes, or text that begins with \"solid\"")
        } else {
            format!("{} bytes for its {promised} triangles", HEADER + promised * RECORD)
        };
        return Err(Error::malformed(input.path, "the whole file", expected, format!("{} bytes", input.length)));
    }
    // In text even the tersest corner takes 13 bytes ("vertex 0 0 0").
    let most_corners = if binary { 3 * promised } else { input.length / 13 };
    let mut welder = Welder::new(workspace, most_corners, in_memory);
    if binary { read_binary(input, promised, &mut welder) } else { read_text(input, &mut welder) }?;
    let told = std::str::from_utf8(&head[..80]).ok().filter(|_| binary).and_then(told_origin);
    Ok(welder.finish()?.placed(told.unwrap_or_default()))
}

fn read_binary(input: &Input, triangles: u64, welder: &mut Welder) -> Result<()> {
    let mut piece = vec![0; (PIECE.min(triangles) * RECORD) as usize];
    let mut done = 0;
    while done < triangles {
        let len = (triangles - done).min(PIECE);
        let piece = &mut piece[..(len * RECORD) as usize];
        input.read_at(HEADER + done * RECORD, piece)?;
        for record in piece.chunks_exact(RECORD as usize) {
            for corner in record[12..48].chunks_exact(12) {
                let coordinate =
                    |i: usize| f32::from_le_bytes([corner[i], corner[i + 1], corner[i + 2], corner[i + 3]]);
                welder.corner([coordinate(0), coordinate(4), coordinate(8)])?;
            }
        }
        done += len;
    }
    Ok(())
}

fn read_text(input: &Input, welder: &mut Welder) -> Result<()> {
    let mut lines = Lines::new(input);
    let (mut corners, mut ended) = (0u64, false);
    while lines.advance()? {
        let mut words = lines.line().split_ascii_whitespace();
        match words.next() {
            Some("vertex") => {
                let mut coordinate = || lines.number(words.next(), "three coordinates");
                welder.corner([coordinate()?, coordinate()?, coordinate()?])?;
                corners += 1;
            }
            Some("endfacet") if corners != 3 => return Err(lines.malformed("3 corners before endfacet", corners)),
            Some("endfacet") => corners = 0,
            Some("facet" | "endsolid") if corners != 0 => {
                return Err(lines.malformed("endfacet", shortened_line(&lines)));
            }
            // A file may hold several solids one after the other.
            Some("solid") => ended = false,
            Some("endsolid") => ended = true,
            Some("facet" | "outer" | "endloop") | None => {}
            Some(_) => return Err(lines.malformed("a statement of STL", shortened_line(&lines))),
        }
    }
    if ended { Ok(()) } else { Err(lines.malformed("endsolid", "the end of the file")) }
}

fn shortened_line(lines: &Lines) -> String {
    format!("{:?}", crate::format::read::text::shortened(lines.line()))
}
