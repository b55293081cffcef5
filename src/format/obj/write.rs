//! OBJ: text, vertices first, triangles numbered from 1.

use std::io::Write;

use crate::error::Result;
use crate::format::write::attributes::{COLOURS, Property, properties, records};
use crate::format::write::job::{Job, Positions};
use crate::mesh::MeshSource;
use crate::points::Precision;

/// Lines of a block.
const BLOCK: usize = 1 << 15;

pub(crate) fn write(job: &mut Job) -> Result<()> {
    let (mesh, origin) = (job.mesh, job.header.origin);
    let absolute = job.positions == Positions::Absolute;
    let comments: String = job.comments().iter().map(|line| format!("# {line}\n")).collect();
    job.put(comments.as_bytes())?;
    let properties = properties(job.mesh, job.header, job.workers)?;
    let colours: Vec<&Property> =
        COLOURS.iter().filter_map(|name| properties.iter().find(|property| property.name == *name)).collect();
    // Behind the coordinates, where most programs read colours of vertices, from 0 to 1.
    let colours = <[&Property; 3]>::try_from(colours).ok();
    job.put_blocks(mesh.vertex_count(), BLOCK, |first, len| {
        let mut vertices = vec![[0.0; 3]; len];
        mesh.read_vertices(first, &mut vertices)?;
        let records = if colours.is_some() { records(mesh, first, len)? } else { Vec::new() };
        let mut lines = Vec::with_capacity(len * 32);
        for (number, [x, y, z]) in vertices.into_iter().enumerate() {
            match mesh.precision() {
                // As `f32` the shortest decimals are shorter, and read back to the same `f32`.
                Precision::Single => write!(lines, "v {} {} {}", x as f32, y as f32, z as f32),
                Precision::Double if origin == [0.0; 3] => write!(lines, "v {x} {y} {z}"),
                Precision::Double if absolute => {
                    write!(lines, "v {} {} {}", x + origin[0], y + origin[1], z + origin[2])
                }
                Precision::Double => {
                    lines.push(b'v');
                    for (c, origin) in [x, y, z].into_iter().zip(origin) {
                        lines.push(b' ');
                        put_difference(c, origin, &mut lines);
                    }
                    Ok(())
                }
            }
            .expect("memory takes all");
            for colour in colours.iter().flatten() {
                let record = &records[number * mesh.schema().stride()..];
                write!(lines, " {}", (colour.value(record) / colour.full()) as f32).expect("memory takes all");
            }
            lines.push(b'\n');
        }
        Ok(lines)
    })?;
    job.put_blocks(mesh.face_count(), BLOCK, |first, len| {
        let mut faces = vec![[0; 3]; len];
        mesh.read_faces(first, &mut faces)?;
        let mut lines = Vec::with_capacity(len * 24);
        for face in faces {
            let [a, b, c] = face.map(|v| u64::from(v) + 1);
            writeln!(lines, "f {a} {b} {c}").expect("memory takes all");
        }
        Ok(lines)
    })
}

/// Writes a coordinate from which an origin was taken off, with the digits that the coordinate itself has: with the origin added, it reads back exactly. More
/// would tell of the subtraction alone.
fn put_difference(c: f64, origin: f64, out: &mut Vec<u8>) {
    let whole = c + origin;
    // Half of this is what the sum is rounded by.
    let step = whole.abs().next_up() - whole.abs();
    let start = out.len();
    let digits = (-libm::log10(step)).ceil();
    if origin == 0.0 || !(0.0..=17.0).contains(&digits) {
        write!(out, "{c}").expect("memory takes all");
        return;
    }
    // A digit more where reading rounds the difference once more, as its own step may be nearly as large.
    for digits in [digits as usize, digits as usize + 1] {
        out.truncate(start);
        put_digits(c, digits, out);
        let read: Option<f64> = std::str::from_utf8(&out[start..]).ok().and_then(|text| text.parse().ok());
        if read.is_some_and(|read| read + origin == whole) {
            return;
        }
    }
    out.truncate(start);
    write!(out, "{c}").expect("memory takes all");
}

/// Writes a number with so many digits behind the point, without noughts at the end.
fn put_digits(c: f64, digits: usize, out: &mut Vec<u8>) {
    let start = out.len();
    write!(out, "{c:.digits$}").expect("memory takes all");
    if digits > 0 {
        let kept = out[start..].iter().rposition(|b| *b != b'0').map_or(0, |last| last + 1);
        out.truncate(start + kept);
        if out.last() == Some(&b'.') {
            out.pop();
        }
    }
    if &out[start..] == b"-0" {
        out.truncate(start);
        out.push(b'0');
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn told(c: f64, origin: f64) -> String {
        let mut out = Vec::new();
        put_difference(c, origin, &mut out);
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn a_difference_has_no_digits_of_its_own() {
        assert_eq!(told(470_615.908 - 470_620.0, 470_620.0), "-4.092");
        assert_eq!(told(470_620.0 - 470_620.0, 470_620.0), "0");
        assert_eq!(told(3_810_320.25 - 3_810_220.0, 3_810_220.0), "100.25");
        assert_eq!(told(-4.0920000000000005, 0.0), "-4.0920000000000005");
    }

    proptest! {
        #[test]
        fn with_the_origin_it_reads_back(at in -1e9f64..1e9, origin in -10_000i32..10_000, near: bool) {
            let origin = f64::from(origin) * 500.0;
            let at = if near { origin + at / 1e6 } else { at };
            let c = at - origin;
            prop_assert_eq!(told(c, origin).parse::<f64>().unwrap() + origin, c + origin);
        }
    }
}
