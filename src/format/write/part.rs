//! A part of a mesh as a mesh of its own: some of its triangles and the vertices that they use, in the mesh's order. However large it is, it goes through
//! memory in pieces: a map of bits tells which vertices are used, and counts of them what their numbers become.

use super::attributes;
use crate::error::Result;
use crate::mesh::MeshSource;
use crate::mesh::spool::{FaceRecord, MeshSpool};
use crate::storage::spool::{Spool, Workspace};

/// Triangles, and vertices, at a time.
const BLOCK: usize = 1 << 15;
/// Vertices read at once where numbers have gaps: reading what is between costs less than another read.
const GAP: u32 = 64;

/// Where some triangles of a part lie.
#[derive(Debug, Clone, Copy)]
pub struct Stretch<'a> {
    /// The spool that they lie in.
    pub spool: &'a Spool,
    /// The first one's byte.
    pub at: u64,
    /// How many there are.
    pub count: u64,
}

/// A part.
pub struct Part {
    /// Its mesh.
    pub mesh: MeshSpool,
    /// The least and the greatest coordinates of its vertices.
    pub bounds: [[f64; 3]; 2],
}

/// Makes a mesh of the triangles that lie at `stretches`. Of `memory` bytes, half are for what is used of the vertices, and half for the part; what is
/// beyond that goes to temporary files. What is used takes a fifth of a byte for each vertex of the mesh from the part's first to its last.
///
/// # Errors
/// How many bytes it takes, if what is used does not fit; [`crate::Error::Io`].
pub fn part(
    mesh: &MeshSpool,
    stretches: &[Stretch<'_>],
    memory: u64,
    workspace: &Workspace,
) -> Result<std::result::Result<Part, u64>> {
    let (mut low, mut high) = (u32::MAX, 0);
    each(stretches, |faces| {
        (low, high) = faces.as_flattened().iter().fold((low, high), |(low, high), v| (low.min(*v), high.max(*v)));
        Ok(())
    })?;
    let needed = Used::bytes(low, high);
    if needed > memory / 2 {
        return Ok(Err(2 * needed));
    }
    let mut used = Used::none(low, high);
    each(stretches, |faces| {
        faces.as_flattened().iter().for_each(|v| used.add(*v));
        Ok(())
    })?;
    used.number();
    let mut out = MeshSpool::with_attributes(workspace, mesh.precision(), mesh.schema().clone(), memory / 2);
    let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    let (mut places, mut kept) = (Vec::new(), Vec::new());
    let stride = mesh.schema().stride();
    let mut take = |first: u32, last: u32| {
        let range = || first..=last;
        places.resize((last - first) as usize + 1, [0.0; 3]);
        mesh.read_vertices(u64::from(first), &mut places)?;
        kept.clear();
        kept.extend(range().zip(&places).filter(|(v, _)| used.has(*v)).map(|(_, place)| *place));
        for place in &kept {
            bounds[0] = [0, 1, 2].map(|a| bounds[0][a].min(place[a]));
            bounds[1] = [0, 1, 2].map(|a| bounds[1][a].max(place[a]));
        }
        out.append_vertices(&kept)?;
        if stride > 0 {
            let records = attributes::records(mesh, u64::from(first), places.len())?;
            let of_used = range().zip(records.chunks_exact(stride)).filter(|(v, _)| used.has(*v));
            let records: Vec<u8> = of_used.flat_map(|(_, record)| record).copied().collect();
            out.append_attributes(&records)?;
        }
        Ok(())
    };
    let mut run: Option<[u32; 2]> = None;
    for v in used.all() {
        run = match run {
            Some([first, last]) if v - last <= GAP && ((v - first) as usize) < BLOCK => Some([first, v]),
            Some([first, last]) => {
                take(first, last)?;
                Some([v, v])
            }
            None => Some([v, v]),
        };
    }
    if let Some([first, last]) = run {
        take(first, last)?;
    }
    each(stretches, |faces| {
        let records: Vec<FaceRecord> = faces.iter().map(|face| FaceRecord::new(face.map(|v| used.rank(v)))).collect();
        out.append_faces(&records)
    })?;
    Ok(Ok(Part { mesh: out, bounds }))
}

/// Reads the triangles at `stretches`, a piece at a time.
fn each(stretches: &[Stretch<'_>], mut visit: impl FnMut(&[[u32; 3]]) -> Result<()>) -> Result<()> {
    let mut faces = Vec::new();
    for Stretch { spool, at, count } in stretches {
        let (mut at, mut left) = (*at, *count);
        while left > 0 {
            let now = left.min(BLOCK as u64) as usize;
            faces.resize(now, [0; 3]);
            spool.read_at(at, bytemuck::cast_slice_mut(&mut faces))?;
            visit(&faces)?;
            at += (now * size_of::<[u32; 3]>()) as u64;
            left -= now as u64;
        }
    }
    Ok(())
}

/// Which vertices of a stretch are used, and how many before each.
struct Used {
    low: u32,
    words: Vec<u64>,
    before: Vec<u32>,
}

impl Used {
    fn words(low: u32, high: u32) -> u64 {
        u64::from(high.saturating_sub(low)) / 64 + 1
    }

    fn bytes(low: u32, high: u32) -> u64 {
        Used::words(low, high) * (size_of::<u64>() + size_of::<u32>()) as u64
    }

    /// None of those from `low` to `high`.
    fn none(low: u32, high: u32) -> Used {
        let words = Used::words(low, high) as usize;
        Used { low, words: vec![0; words], before: vec![0; words] }
    }

    fn place(&self, v: u32) -> (usize, u32) {
        let at = v - self.low;
        ((at / 64) as usize, at % 64)
    }

    fn add(&mut self, v: u32) {
        let (word, bit) = self.place(v);
        self.words[word] |= 1 << bit;
    }

    fn has(&self, v: u32) -> bool {
        let (word, bit) = self.place(v);
        self.words[word] >> bit & 1 == 1
    }

    /// Counts, once all are added.
    fn number(&mut self) {
        let mut sum = 0;
        for (before, word) in self.before.iter_mut().zip(&self.words) {
            *before = sum;
            sum += word.count_ones();
        }
    }

    /// How many are used before one.
    fn rank(&self, v: u32) -> u32 {
        let (word, bit) = self.place(v);
        self.before[word] + (self.words[word] & ((1 << bit) - 1)).count_ones()
    }

    /// Those that are used, in order.
    fn all(&self) -> impl Iterator<Item = u32> + '_ {
        self.words.iter().zip((self.low..).step_by(64)).flat_map(|(word, first)| {
            let mut left = *word;
            std::iter::from_fn(move || {
                let bit = (left != 0).then(|| left.trailing_zeros())?;
                left &= left - 1;
                Some(first + bit)
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;
    use crate::points::Precision;

    proptest! {
        #[test]
        fn a_part_has_its_triangles_and_the_vertices_they_use_in_order(
            faces in prop::collection::vec(prop::array::uniform3(0u32..100_000), 1..200),
            cut in 0usize..200,
            memory in (1u64 << 16)..(1 << 20),
        ) {
            let dir = tempfile::tempdir().unwrap();
            let workspace = Workspace::new(dir.path()).unwrap();
            let mut mesh = MeshSpool::new(&workspace, Precision::Double, 0);
            let place = |v: u32| [f64::from(v), 0.5, -f64::from(v)];
            mesh.append_vertices(&(0..100_000).map(place).collect::<Vec<_>>()).unwrap();
            // What another part has lies between the stretches.
            let mut spool = workspace.spool(0);
            let (first, rest) = faces.split_at(cut.min(faces.len()));
            let mut append = |faces: &[[u32; 3]]| (spool.append(bytemuck::cast_slice(faces)).unwrap(), faces.len() as u64);
            let stretches = [append(first), append(&[[7; 3]]), append(rest)];
            let stretches = stretches.map(|(at, count)| Stretch { spool: &spool, at, count });
            let made = part(&mesh, &[stretches[0], stretches[2]], memory, &workspace).unwrap().ok().unwrap();
            let used: BTreeSet<u32> = faces.as_flattened().iter().copied().collect();
            let mut places = vec![[0.0; 3]; made.mesh.vertex_count() as usize];
            made.mesh.read_vertices(0, &mut places).unwrap();
            prop_assert_eq!(&places, &used.iter().map(|v| place(*v)).collect::<Vec<_>>());
            let mut found = vec![[0; 3]; made.mesh.face_count() as usize];
            made.mesh.read_faces(0, &mut found).unwrap();
            let named: Vec<[f64; 3]> = found.iter().map(|face| face.map(|v| places[v as usize][0])).collect();
            prop_assert_eq!(named, faces.iter().map(|face| face.map(f64::from)).collect::<Vec<_>>());
            let (least, most) = (*used.first().unwrap(), *used.last().unwrap());
            prop_assert_eq!(made.bounds, [[f64::from(least), 0.5, -f64::from(most)], [f64::from(most), 0.5, -f64::from(least)]]);
        }
    }

    #[test]
    fn what_does_not_fit_tells_what_it_takes() {
        let dir = tempfile::tempdir().unwrap();
        let workspace = Workspace::new(dir.path()).unwrap();
        let mesh = MeshSpool::new(&workspace, Precision::Single, 0);
        let mut spool = workspace.spool(0);
        let faces = [[0, 1, 6_400_000u32]];
        let at = spool.append(bytemuck::cast_slice(&faces)).unwrap();
        let stretch = Stretch { spool: &spool, at, count: 1 };
        assert_eq!(part(&mesh, &[stretch], 1 << 20, &workspace).unwrap().err(), Some(2 * 100_001 * 12));
    }
}
