//! Wavefront OBJ: `v x y z` and `f a b c …`, and the origin that the program's own comments tell; every other statement is passed over.

use super::Input;
use super::convert::Converter;
use super::text::{Lines, shortened};
use crate::error::{Error, Result};
use crate::mesh::spool::MeshSpool;
use crate::mesh::told_origin;
use crate::points::Precision;
use crate::spool::Workspace;

pub(super) fn read(input: &Input, workspace: &Workspace, in_memory: u64) -> Result<MeshSpool> {
    let mut lines = Lines::new(input);
    let mut mesh = Converter::new(input.path, workspace, Precision::Double, in_memory);
    let mut origin = [0.0; 3];
    while lines.advance()? {
        let mut words = lines.line().split_ascii_whitespace();
        match words.next() {
            Some("v") => {
                let mut coordinate = || lines.number(words.next(), "three coordinates");
                mesh.vertex([coordinate()?, coordinate()?, coordinate()?])?;
            }
            Some("f") => {
                let so_far = mesh.vertex_count();
                mesh.polygon(words.map(|word| corner(&lines, word, so_far)))?;
            }
            // Only before the first vertex: what comes later may be about anything.
            Some("#") if mesh.vertex_count() == 0 => {
                origin = lines.line().strip_prefix('#').and_then(told_origin).unwrap_or(origin);
            }
            _ => {}
        }
    }
    if mesh.vertex_count() == 0 {
        return Err(Error::malformed(input.path, "the whole file", "lines that begin with v", "none"));
    }
    Ok(mesh.finish()?.placed(origin))
}

/// Whether there are faces.
pub(super) fn has_faces(input: &Input) -> Result<bool> {
    let mut lines = Lines::new(input);
    while lines.advance()? {
        if lines.line().split_ascii_whitespace().next() == Some("f") {
            return Ok(true);
        }
    }
    Ok(false)
}

/// The vertex of a corner such as `7`, `7/2/5` or `-1`: from 1, or backwards from the last.
fn corner(lines: &Lines, word: &str, so_far: u64) -> Result<u64> {
    let expected = "a vertex number, from 1, or from -1 backwards";
    let number: i64 = lines.number(word.split('/').next(), expected)?;
    let vertex = match number {
        1.. => Some(number as u64 - 1),
        0 => None,
        _ => so_far.checked_sub(number.unsigned_abs()),
    };
    vertex.ok_or_else(|| lines.malformed(expected, shortened(word)))
}
