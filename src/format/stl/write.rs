//! Binary STL: 80 bytes of header, the number of triangles, then 50 bytes for each.
//!
//! ```text
//!  offset  size  type    meaning
//!       0    12  f32×3   normal, of length 1, or 0 for a triangle without area
//!      12    36  f32×9   corners, counter-clockwise seen from outside
//!      48     2  u16     0
//! ```

use glam::DVec3;

use crate::error::{Error, Result};
use crate::format::write::job::Job;
use crate::mesh::MeshSource;
use crate::mesh::corners::Corners;

const HEADER: usize = 80;
const RECORD: usize = 50;
/// Triangles of a block.
const BLOCK: usize = 1 << 16;
/// Vertices that are read along if a block's numbers span no more: 6 MiB of positions.
const WINDOW: usize = 1 << 18;

pub(crate) fn write(job: &mut Job) -> Result<()> {
    let mesh = job.mesh;
    let count = mesh.face_count();
    let Ok(triangles) = u32::try_from(count) else {
        let limit = u32::MAX.into();
        return Err(Error::TooManyElements { count, what: "triangles", limit, carrier: "an STL file" });
    };
    // Must not begin with "solid", which marks the text form.
    let mut header = String::from("binary STL");
    if job.header.origin != [0.0; 3] {
        let [x, y, z] = job.header.origin;
        header = format!("origin {x} {y} {z}");
    }
    let mut header = header.into_bytes();
    header.resize(HEADER, b' ');
    job.put(&header)?;
    job.put(&triangles.to_le_bytes())?;
    job.put_blocks(count, BLOCK, |first, len| {
        let mut faces = vec![[0; 3]; len];
        mesh.read_faces(first, &mut faces)?;
        let mut corners = Corners::default();
        corners.fill(mesh, &mut faces, WINDOW)?;
        let mut bytes = Vec::with_capacity(len * RECORD);
        for face in faces {
            let [a, b, c] = face.map(|v| DVec3::from_array(corners.table[v as usize]));
            let normal = (b - a).cross(c - a).normalize_or_zero();
            for number in [normal, a, b, c].iter().flat_map(|p| p.to_array()) {
                bytes.extend_from_slice(&(number as f32).to_le_bytes());
            }
            bytes.extend_from_slice(&[0; 2]);
        }
        Ok(bytes)
    })
}
