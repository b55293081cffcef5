//! Wavefront OBJ: `v x y z`, or `v x y z r g b`, `f a b c …`, and the origin that the program's own comments tell; every other statement is passed over.

use crate::error::{Error, Result};
use crate::format::read::convert::Converter;
use crate::format::read::input::{Input, chosen, colours};
use crate::format::read::text::{Lines, shortened};
use crate::mesh::spool::MeshSpool;
use crate::mesh::told_origin;
use crate::points::Precision;
use crate::points::attribute::{Attribute, Schema, Wanted};
use crate::points::scalar::Scalar;
use crate::storage::spool::Workspace;

pub(crate) fn read(input: &Input, workspace: &Workspace, in_memory: u64, wanted: &Wanted) -> Result<MeshSpool> {
    let there = if is_coloured(input)? { colours(Scalar::F64) } else { Schema::default() };
    let schema = chosen(input.path, wanted, &there)?;
    // Which of the numbers behind the coordinates each attribute is.
    let place = |a: &Attribute| there.attributes().iter().position(|b| a == b).expect("they were chosen among these");
    let places: Vec<usize> = schema.attributes().iter().map(place).collect();
    let mut lines = Lines::new(input);
    let mut mesh = Converter::new(input.path, workspace, Precision::Double, schema, in_memory);
    let mut origin = [0.0; 3];
    while lines.advance()? {
        let mut words = lines.line().split_ascii_whitespace();
        match words.next() {
            Some("v") => {
                let mut coordinate = || lines.number(words.next(), "three coordinates");
                mesh.vertex([coordinate()?, coordinate()?, coordinate()?])?;
                if !places.is_empty() {
                    let mut colour = || lines.number(words.next(), "three colours behind the coordinates");
                    let colour: [f64; 3] = [colour()?, colour()?, colour()?];
                    mesh.attributes(&places.iter().map(|place| colour[*place]).collect::<Vec<_>>())?;
                }
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
pub(crate) fn has_faces(input: &Input) -> Result<bool> {
    let mut lines = Lines::new(input);
    while lines.advance()? {
        if lines.line().split_ascii_whitespace().next() == Some("f") {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Whether the first vertex has numbers behind its coordinates.
fn is_coloured(input: &Input) -> Result<bool> {
    let mut lines = Lines::new(input);
    let mut coloured = false;
    while lines.advance()? {
        let words = lines.line().split_ascii_whitespace();
        if words.clone().next() == Some("v") {
            coloured = words.count() >= 7;
            break;
        }
    }
    Ok(coloured)
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
