//! A mesh as a page holds it: simplified, rounded to 16 bits, packed.
//!
//! ```text
//!   channel 0, 1, 2   places; then a channel for each attribute of vertices: 16 bits a vertex, each less the one before
//!   triangles         24 bits a corner: how far below the next new vertex it is, so mostly small numbers
//! ```
//!
//! Vertices are in the order in which triangles name them first. Of all numbers first come the low bytes, then the higher ones; all of it is deflated. What a
//! channel's numbers stand for is `low + step * number`, and 65,535 for what is not a number.

use std::io::Write;

use flate2::Compression;
use flate2::write::ZlibEncoder;
use rustc_hash::FxHashMap;
use serde_json::{Value, json};

use crate::error::Result;
use crate::mesh::MeshSource;
use crate::points::scalar::Scalar;
use crate::resources::workers::Workers;
use crate::simplify::{Extent, Given, Options, simplify};
use crate::storage::spool::Workspace;

/// The most triangles of a page's mesh.
pub const MOST: u64 = 300_000;
/// Memory for packing so many, in bytes: corners, places, channels, and what is packed.
const PACKING: u64 = 40 << 20;
/// What stands for no number.
const NONE: u16 = u16::MAX;
/// Elements read at once.
const PIECE: u64 = 1 << 15;

/// A mesh in a page.
#[derive(Debug)]
pub struct PageMesh {
    vertices: usize,
    triangles: usize,
    channels: Vec<Channel>,
    /// What the middle of places stands for, in the input's coordinates.
    origin: [f64; 3],
    /// Triangles of the mesh that it was made of.
    whole: u64,
    /// No place of either surface was farther than this from the other, before places were rounded.
    error: f64,
    /// All of it, deflated.
    pub(super) packed: Vec<u8>,
}

/// What numbers stand for.
#[derive(Debug)]
struct Channel {
    name: String,
    low: f64,
    step: f64,
}

/// Reads a run of vertices: the first one's number, how many there are, and which of the page's are among them.
type Read<'a> = dyn FnMut(u64, usize, &[u32]) -> Result<()> + 'a;

/// The memory that making it needs, in bytes.
pub fn least_memory(mesh: &dyn MeshSource) -> u64 {
    Extent::of(mesh, false, false).least_memory().max(PACKING)
}

impl PageMesh {
    /// Simplifies a mesh to [`MOST`] triangles, and packs it. None if it has none, or does not become so light: where it is no manifold, it stays as it is.
    /// Added to places, `origin` gives the input's coordinates. `progress` is told the part that is done. Memory: `budget`, or as much as [`least_memory`] tells.
    ///
    /// # Errors
    /// Those of [`simplify`] and of reading the mesh.
    pub fn of(
        mesh: &dyn MeshSource,
        origin: [f64; 3],
        budget: u64,
        (workers, workspace): (&Workers, &Workspace),
        progress: &mut dyn FnMut(f64),
    ) -> Result<Option<PageMesh>> {
        let whole = mesh.face_count();
        if whole <= MOST {
            return if whole == 0 { Ok(None) } else { packed(mesh, origin, whole, 0.0).map(Some) };
        }
        let options = Options { tolerance: None, most: Some(MOST), borders: None, colours: None, moves: false };
        let given = Given { mesh, options: &options, budget, workers, workspace, kept: None };
        let (fewer, figures) = simplify(given, progress)?;
        if figures.after > MOST + MOST / 4 {
            return Ok(None);
        }
        packed(&fewer, origin, whole, figures.reached).map(Some)
    }

    /// What the viewer is to know of it, but for the mesh itself.
    pub(super) fn source(&self) -> Value {
        let channels: Vec<Value> =
            self.channels.iter().map(|c| json!({ "name": c.name, "low": c.low, "step": c.step })).collect();
        json!({
            "vertices": self.vertices, "triangles": self.triangles, "channels": channels, "origin": self.origin, "whole": self.whole, "error": self.error,
            "rounded": 0.5 * self.channels[..3].iter().map(|c| c.step * c.step).sum::<f64>().sqrt(),
        })
    }

    /// What is told of it.
    pub(super) fn words(&self) -> String {
        use crate::error::words::{short, thousands};
        match self.whole == self.triangles as u64 {
            true => format!("All {} triangles.", thousands(self.whole)),
            false => format!(
                "{} of {} triangles: no place of either surface is farther than {} from the other.",
                thousands(self.triangles as u64),
                thousands(self.whole),
                short(self.error)
            ),
        }
    }
}

fn packed(mesh: &dyn MeshSource, origin: [f64; 3], whole: u64, error: f64) -> Result<PageMesh> {
    let mut faces = Vec::with_capacity(mesh.face_count() as usize);
    let mut piece = Vec::new();
    for first in (0..mesh.face_count()).step_by(PIECE as usize) {
        piece.resize((mesh.face_count() - first).min(PIECE) as usize, [0; 3]);
        mesh.read_faces(first, &mut piece)?;
        faces.extend_from_slice(&piece);
    }
    // Vertices by first use; those that nothing uses are left out.
    let mut numbers: FxHashMap<u32, u32> = FxHashMap::default();
    let (mut used, mut codes) = (Vec::new(), Vec::with_capacity(3 * faces.len()));
    for v in faces.as_flattened() {
        let next = used.len() as u32;
        let number = *numbers.entry(*v).or_insert_with(|| {
            used.push(*v);
            next
        });
        codes.push(next - number);
    }
    let (vertices, triangles) = (used.len(), faces.len());
    drop((faces, numbers));
    let mut by_place: Vec<u32> = (0..vertices as u32).collect();
    by_place.sort_unstable_by_key(|i| used[*i as usize]);

    let mut bytes = Vec::new();
    let mut channels = Vec::new();
    let mut put = |name: &str, values: &[f64], exact: bool| {
        let channel = Channel::of(name, values, exact);
        channel.put(values, &mut bytes);
        channels.push(channel);
    };
    // In ascending order of numbers, so in runs.
    let each = |read: &mut Read| -> Result<()> {
        for run in by_place.chunk_by(|a, b| used[*a as usize] / PIECE as u32 == used[*b as usize] / PIECE as u32) {
            let (first, last) = (used[run[0] as usize], used[run[run.len() - 1] as usize]);
            read(u64::from(first), (last - first) as usize + 1, run)?;
        }
        Ok(())
    };
    let mut places = vec![[0.0; 3]; vertices];
    let mut read = Vec::new();
    each(&mut |first, count, run| {
        read.resize(count, [0.0; 3]);
        mesh.read_vertices(first, &mut read)?;
        run.iter().for_each(|i| places[*i as usize] = read[(u64::from(used[*i as usize]) - first) as usize]);
        Ok(())
    })?;
    let axis = |a: usize| places.iter().map(|place| place[a]).collect::<Vec<f64>>();
    let mut middle = [0.0; 3];
    for (a, name) in ["x", "y", "z"].into_iter().enumerate() {
        let mut values = axis(a);
        let (low, high) = ends(&values);
        middle[a] = low.midpoint(high);
        values.iter_mut().for_each(|value| *value -= middle[a]);
        put(name, &values, false);
    }
    drop(places);
    let mut read = Vec::new();
    for (number, attribute) in mesh.schema().attributes().iter().enumerate() {
        let mut values = vec![0.0; vertices];
        each(&mut |first, count, run| {
            read.resize(count, 0.0);
            mesh.read_attribute(number, first, &mut read)?;
            run.iter().for_each(|i| values[*i as usize] = read[(u64::from(used[*i as usize]) - first) as usize]);
            Ok(())
        })?;
        put(&attribute.name, &values, !matches!(attribute.scalar, Scalar::F32 | Scalar::F64));
    }
    for shift in [0, 8, 16] {
        bytes.extend(codes.iter().map(|code| (code >> shift) as u8));
    }
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::best());
    let deflated = encoder.write_all(&bytes).and_then(|()| encoder.finish());
    let packed = deflated.expect("memory takes what it is given");
    let origin = std::array::from_fn(|a| origin[a] + middle[a]);
    Ok(PageMesh { vertices, triangles, channels, origin, whole, error, packed })
}

/// The least and the greatest number; zeros if there is none.
fn ends(values: &[f64]) -> (f64, f64) {
    let finite = values.iter().copied().filter(|value| value.is_finite());
    let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    if low <= high { (low, high) } else { (0.0, 0.0) }
}

impl Channel {
    /// How numbers are rounded; whole ones are not, if they lie close enough.
    fn of(name: &str, values: &[f64], whole: bool) -> Channel {
        let (low, high) = ends(values);
        let most = f64::from(NONE - 1);
        let step = match high - low {
            0.0 => 1.0,
            range if whole && range <= most => 1.0,
            range => range / most,
        };
        Channel { name: name.to_owned(), low, step }
    }

    fn put(&self, values: &[f64], out: &mut Vec<u8>) {
        let mut before = 0u16;
        let code = |value: &f64| {
            let number = match value.is_finite() {
                true => ((value - self.low) / self.step).round().clamp(0.0, f64::from(NONE - 1)) as u16,
                false => NONE,
            };
            let less = number.wrapping_sub(before) as i16;
            before = number;
            // Small either way.
            (less << 1 ^ less >> 15) as u16
        };
        let codes: Vec<u16> = values.iter().map(code).collect();
        out.extend(codes.iter().map(|code| *code as u8));
        out.extend(codes.iter().map(|code| (code >> 8) as u8));
    }
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use super::*;
    use crate::mesh::spool::{FaceRecord, MeshSpool};
    use crate::points::Precision;

    /// As the viewer's script does it.
    fn unpacked(mesh: &PageMesh) -> (Vec<Vec<f64>>, Vec<[u32; 3]>) {
        let mut bytes = Vec::new();
        flate2::read::ZlibDecoder::new(&*mesh.packed).read_to_end(&mut bytes).unwrap();
        let n = mesh.vertices;
        assert_eq!(bytes.len(), 2 * n * mesh.channels.len() + 9 * mesh.triangles);
        let channel = |(k, channel): (usize, &Channel)| {
            let part = &bytes[2 * n * k..2 * n * (k + 1)];
            let mut before = 0u16;
            (0..n)
                .map(|i| {
                    let code = u16::from(part[i]) | u16::from(part[n + i]) << 8;
                    before = before.wrapping_add((code >> 1) ^ 0u16.wrapping_sub(code & 1));
                    if before == NONE { f64::NAN } else { channel.low + channel.step * f64::from(before) }
                })
                .collect::<Vec<f64>>()
        };
        let channels = mesh.channels.iter().enumerate().map(channel).collect();
        let (part, m) = (&bytes[2 * n * mesh.channels.len()..], 3 * mesh.triangles);
        let mut next = 0;
        let corners: Vec<u32> = (0..m)
            .map(|i| {
                let code = u32::from(part[i]) | u32::from(part[m + i]) << 8 | u32::from(part[2 * m + i]) << 16;
                let number = next - code;
                next += u32::from(code == 0);
                number
            })
            .collect();
        (channels, corners.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect())
    }

    #[test]
    fn what_is_packed_is_the_mesh_but_for_rounding() {
        let workspace = Workspace::unchecked(std::env::temp_dir());
        let mut spool = MeshSpool::new(&workspace, Precision::Double, 1 << 20);
        let places: Vec<[f64; 3]> = (0..500).map(|i| [f64::from(i) * 0.5, f64::from(i * i % 97), 7.0]).collect();
        let faces: Vec<[u32; 3]> =
            (0..400u32).map(|i| [(i * 7) % 499, (i * 7 + 1) % 499, (i * 13 + 2) % 499]).collect();
        spool.append_vertices(&places).unwrap();
        spool.append_faces(&faces.iter().map(|face| FaceRecord::new(*face)).collect::<Vec<_>>()).unwrap();
        let spool = spool.placed([1000.0, 0.0, -5.0]);
        let mesh = packed(&spool, spool.origin(), 400, 0.0).unwrap();
        let (channels, found) = unpacked(&mesh);
        assert_eq!(found.len(), 400);
        for (face, found) in faces.iter().zip(&found) {
            for (v, n) in face.iter().zip(found) {
                for a in 0..3 {
                    let whole = channels[a][*n as usize] + mesh.origin[a] - [1000.0, 0.0, -5.0][a];
                    assert!((whole - places[*v as usize][a]).abs() <= 0.51 * mesh.channels[a].step, "{a}");
                }
            }
        }
        assert!(channels[0].len() <= 499 && mesh.words() == "All 400 triangles.");
    }

    #[test]
    fn whole_numbers_stay_and_what_is_none_is_none() {
        for (values, whole) in
            [(vec![3.0, 200.0, 3.0, 65_000.0], true), (vec![f64::NAN, 1.5, -0.25, f64::INFINITY], false)]
        {
            let channel = Channel::of("a", &values, whole);
            let mut bytes = Vec::new();
            channel.put(&values, &mut bytes);
            let mesh = PageMesh {
                vertices: 4,
                triangles: 0,
                channels: vec![channel],
                origin: [0.0; 3],
                whole: 0,
                error: 0.0,
                packed: {
                    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
                    encoder.write_all(&bytes).unwrap();
                    encoder.finish().unwrap()
                },
            };
            let found = &unpacked(&mesh).0[0];
            for (a, b) in values.iter().zip(found) {
                let same = if whole {
                    a == b
                } else {
                    !a.is_finite() && b.is_nan() || (a - b).abs() <= 0.51 * mesh.channels[0].step
                };
                assert!(same, "{a} {b}");
            }
        }
    }
}
