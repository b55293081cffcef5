//! Pictures of meshes larger than memory: no display, no graphics card, the same bytes for every budget and any number of threads.
//!
//! ```text
//!  blocks      every triangle once: boxes, also in the frame of each view; corners of scattered triangles are looked up
//!  colour      what is to be coloured: the ends of the scale
//!  vertices    a smooth normal and a colour for each, on disk if need be
//!   for each view, for each band of it that fits into memory
//!  raster      every triangle that reaches the band: the nearest at each of nine samples a pixel
//!  light       samples are lit, and become pixels
//!   for each view
//!  openness    pixels in hollows become darker
//!  sheet       the view goes to its cell of the picture; in the end the picture becomes a PNG file
//! ```
//!
//! Views are parallel projections, each as large as fits into its cell. Memory holds the picture, one view of 13 bytes a pixel, a band of it of 144 bytes a pixel, and some
//! blocks. The budget decides how high bands are, and nothing of that shows.

mod blocks;
mod colour;
mod contact_sheet;
mod label;
mod legend;
mod occlusion;
pub mod page;
mod raster;
pub(crate) mod scale;
mod shading;
#[cfg(test)]
mod tests;
mod vertices;
mod view;

use bytesize::ByteSize;
use glam::{DVec3, Vec3};

use self::blocks::{BLOCK, Blocks, Bounds, Piece, Sizes, is_finite};
pub use self::colour::ColourBy;
use self::colour::Tint;
pub use self::contact_sheet::{Background, Picture, Size, picture_file};
use self::contact_sheet::{Cell, cells};
pub use self::legend::Legend;
use self::occlusion::Openness;
use self::raster::{
    Band, Bins, FARTHEST, MOST_PAIRS, MOST_TRIANGLES, PLACES, Paint, Placed, SAMPLES, TILE, TILE_BYTES,
};
pub use self::shading::Shading;
use self::shading::{Pixel, Side, encode, linear, pack_normal};
use self::vertices::{RANGE_BYTES, Vertex, Vertices, normal};
use self::view::Frame;
pub use self::view::{Up, View};
use crate::error::{Error, Result};
use crate::mesh::MeshSource;
use crate::resources::workers::{Spares, Workers};
use crate::storage::spool::Workspace;

/// What a picture is to show.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// The size of all of it.
    pub size: Size,
    /// The views, one cell each.
    pub views: Vec<View>,
    /// Which direction is up.
    pub up: Up,
    /// How light falls.
    pub shading: Shading,
    /// What colours tell.
    pub colour_by: ColourBy,
    /// What is behind the mesh.
    pub background: Background,
    /// What stands below each view, if that is large enough: 240 pixels each way.
    pub legend: Legend,
}

impl Default for Options {
    fn default() -> Options {
        Options {
            size: Size { width: 1600, height: 1200 },
            views: vec![View::iso()],
            up: Up::Z,
            shading: Shading::Smooth,
            colour_by: ColourBy::None,
            background: Background::Colour([255; 3]),
            legend: Legend::None,
        }
    }
}

/// Bytes of a job: the least that does, and more than which is of no use.
const JOB: (u64, u64) = (8 << 20, 16 << 20);
/// The part of that which does not depend on the window: triangles twice, and pairs of tiles and triangles.
const JOB_FIXED: u64 = (BLOCK * 24 + MOST_PAIRS * 8 + (1 << 19)) as u64;
/// Bytes for each vertex of a window: its position, where it is in the view, and what is known of it.
const WINDOW_BYTES: u64 = 24 + 12 + 8 + 1;
/// Bytes for each triangle whose corners are on their way to the spool.
const CORNER_BYTES: u64 = 72;

/// Bytes of a pixel of a view: what it is, and how open it lies.
const VIEW_BYTES: usize = size_of::<Pixel>() + 1;

/// The budget as sizes. None of them shows in the picture.
#[derive(Debug, Clone, Copy)]
struct Plan {
    sizes: Sizes,
    /// Vertices of a range.
    range: u32,
    /// Bytes of tiles.
    tiles: u64,
}

impl Plan {
    fn new(budget: u64, options: &Options, threads: usize) -> Result<Plan> {
        let (least, row) = least(options);
        if budget < least {
            let (given, needed) = (ByteSize(budget), ByteSize(least));
            return Err(Error::Budget { given, needed, what: "a picture of this size" });
        }
        let rows = u64::from(options.size.height).div_ceil(TILE as u64);
        let left = budget - least + JOB.0;
        let in_flight = (left / 2 / JOB.0).clamp(1, threads as u64 + 1);
        let share = (left / 2 / in_flight).max(JOB.0);
        let job = share.min(JOB.1);
        let rest = left.saturating_sub(in_flight * job);
        let more_rows = (rest / 4 * 3 / row).min(rows - 1);
        let kept = rest.saturating_sub(more_rows * row);
        // Corners are looked up before there is a view.
        let far = (left - kept).saturating_sub(in_flight * BLOCK as u64 * CORNER_BYTES);
        Ok(Plan {
            sizes: Sizes {
                in_flight: in_flight as usize,
                window: ((job - JOB_FIXED) / WINDOW_BYTES).min(1 << 18) as usize,
                far,
                in_memory: kept / 2,
            },
            range: (share / 2 / RANGE_BYTES).clamp(1 << 12, 1 << 31) as u32,
            tiles: (1 + more_rows) * row,
        })
    }
}

/// The least memory that a picture can be drawn in, in bytes.
pub fn least_memory(options: &Options) -> u64 {
    least(options).0
}

/// The least memory, and that of a row of tiles, as if one view had it all: how cells lie is known only when the mesh was looked at.
fn least(options: &Options) -> (u64, u64) {
    let pixels = options.size.pixels();
    let picture = (pixels * Picture::channels(options.background)) as u64;
    let view = (pixels * VIEW_BYTES) as u64;
    let row = u64::from(options.size.width).div_ceil(TILE as u64) * TILE_BYTES;
    ((picture + view + row + JOB.0).next_multiple_of(1 << 20), row)
}

/// Draws a mesh. Triangles with a corner that is not finite (or beyond 10¹⁰⁰) are left out; a mesh with no other gives an empty picture.
///
/// Memory: `budget` bytes. Temporary storage: 8 bytes a vertex, and if the mesh is in random order 96 a triangle, and 132 more while corners are looked up, as far as the
/// budget does not hold them. `progress` is told how many triangles are done, in thousandths of the whole.
///
/// # Errors
/// [`Error::Budget`]; [`Error::Usage`] if the mesh lacks the attribute asked for, or the picture is too small for its views; those of reading the mesh and of the workspace;
/// [`Error::TooManyElements`] beyond 2³⁶ triangles; [`Error::Interrupted`].
pub fn render(
    mesh: &dyn MeshSource,
    options: &Options,
    budget: u64,
    workers: &Workers,
    workspace: &Workspace,
    progress: &mut dyn FnMut(u64),
) -> Result<Picture> {
    let faces = mesh.face_count();
    if faces > MOST_TRIANGLES {
        return Err(Error::TooManyElements {
            count: faces,
            what: "triangles",
            limit: MOST_TRIANGLES,
            carrier: "a picture",
        });
    }
    // Whether there is room for so many, before the work.
    cells(options.size, &vec![(1.0, 1.0); options.views.len()])?;
    let plan = Plan::new(budget, options, workers.threads())?;
    draw(mesh, options, plan, workers, workspace, progress)
}

fn draw(
    mesh: &dyn MeshSource,
    options: &Options,
    plan: Plan,
    workers: &Workers,
    workspace: &Workspace,
    progress: &mut dyn FnMut(u64),
) -> Result<Picture> {
    let faces = mesh.face_count();
    let frames: Vec<Frame> = options.views.iter().map(|view| view.frame(options.up)).collect();
    let blocks = Blocks::survey(mesh, &frames, plan.sizes, workers, workspace, &mut |done| progress(done / 4))?;
    let colour_by = options.colour_by.of(mesh);
    let tint = Tint::of(mesh, &colour_by, options.up, workers)?;
    let values = tint.ends(mesh.origin()).map(|(low, high)| (low, high, colour_by.to_string()));
    let (shading, sizes) = (options.shading, (plan.sizes, plan.range));
    let told = &mut |done| progress(faces / 4 + done / 4);
    let vertices = Vertices::of(&blocks, &tint, shading, sizes, workers, workspace, told)?;
    let scene = Scene { blocks: &blocks, vertices: &vertices, tint: &tint, shading, workers, plan };

    let extent = |bounds: &Bounds| {
        if bounds.is_empty() { (0.0, 0.0) } else { (bounds.high.x - bounds.low.x, bounds.high.y - bounds.low.y) }
    };
    let cells = cells(options.size, &blocks.in_frames.iter().map(extent).collect::<Vec<_>>())?;
    let mut picture = Picture::new(options.size, options.background);
    for (number, (cell, frame)) in cells.iter().zip(frames).enumerate() {
        let strip = options.legend.rows(cell, &tint);
        let projection = Projection::new(frame, blocks.in_frames[number], cell, strip);
        let views = cells.len() as u64;
        let half = faces / 2;
        let pixels = scene.view(&projection, cell, &mut |share| {
            progress(half + (half as f64 * (number as f64 + share) / views as f64) as u64);
        })?;
        fill(&mut picture, cell, &pixels, options.background, workers)?;
        if cells.len() > 1 {
            label::write(&mut picture, cell, &options.views[number].name);
        }
        options.legend.draw(&mut picture, cell, &tint, projection.pixels(), values.clone());
    }
    progress(faces);
    picture.triangles = blocks.drawable;
    Ok(picture)
}

/// How a view's frame becomes places.
#[derive(Debug, Clone, Copy)]
struct Projection {
    frame: Frame,
    /// What is seen in the middle, at the front.
    centre: DVec3,
    /// Places for a unit to the right, upwards and away from the viewer; the last in depth.
    scale: DVec3,
    /// The middle of the view.
    middle: DVec3,
    /// Pixels for one of depth.
    deep: f32,
}

/// The share of a view's sides that stays free.
const MARGIN: f64 = 0.04;

impl Projection {
    /// The frame's box as large as fits into a cell, above the lowest `strip` of its rows.
    fn new(frame: Frame, bounds: Bounds, cell: &Cell, strip: usize) -> Projection {
        let bounds = if bounds.is_empty() { Bounds { low: DVec3::ZERO, high: DVec3::ZERO } } else { bounds };
        let extent = bounds.high - bounds.low;
        let (width, height) = (cell.width as f64, (cell.height - strip) as f64);
        let free = 2.0 * MARGIN * width.min(height);
        let fit = |room: f64, extent: f64| if extent > 0.0 { room / extent } else { f64::INFINITY };
        let pixels = fit(width - free, extent.x).min(fit(height - free, extent.y));
        // All in one place, or closer together than numbers tell.
        let pixels = if pixels.is_finite() { pixels } else { 0.0 };
        let places = pixels * (SAMPLES as i64 * PLACES) as f64;
        let depth = if extent.z > 0.0 { f64::from(FARTHEST) / extent.z } else { 0.0 };
        let middle = DVec3::new(width, height, 0.0) * (0.5 * (SAMPLES as i64 * PLACES) as f64);
        let centre = bounds.low.midpoint(bounds.high);
        Projection {
            frame,
            centre: DVec3::new(centre.x, centre.y, bounds.high.z),
            scale: DVec3::new(places, -places, -depth),
            middle,
            deep: (extent.z * pixels / f64::from(FARTHEST)) as f32,
        }
    }

    /// Pixels for a unit.
    fn pixels(&self) -> f64 {
        self.scale.x / (SAMPLES as i64 * PLACES) as f64
    }

    #[inline]
    fn place(&self, position: [f64; 3]) -> Placed {
        if !is_finite(position) {
            return Placed::NOWHERE;
        }
        let at = (self.frame.turn(DVec3::from_array(position)) - self.centre) * self.scale + self.middle;
        Placed { x: at.x.round() as i32, y: at.y.round() as i32, depth: (at.z as u32).min(FARTHEST) }
    }

    /// The places that a box reaches from, and to, downwards.
    fn rows(&self, bounds: &Bounds) -> (f64, f64) {
        let corner = |i: usize| {
            let side = |a: usize| if i >> a & 1 == 0 { bounds.low[a] } else { bounds.high[a] };
            let turned = self.frame.turn(DVec3::new(side(0), side(1), side(2)));
            (turned.y - self.centre.y) * self.scale.y + self.middle.y
        };
        (0..8).map(corner).fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), y| (low.min(y), high.max(y)))
    }
}

/// All that views are drawn from.
struct Scene<'a> {
    blocks: &'a Blocks<'a>,
    vertices: &'a Vertices,
    tint: &'a Tint,
    shading: Shading,
    workers: &'a Workers,
    plan: Plan,
}

/// The working memory of a job.
#[derive(Default)]
struct Scratch {
    piece: Piece,
    vertices: Vec<Vertex>,
    placed: Vec<Placed>,
    bins: Bins,
}

impl Scene<'_> {
    /// Draws a view, band by band; `progress` is told the share that is done.
    fn view(&self, projection: &Projection, cell: &Cell, progress: &mut dyn FnMut(f64)) -> Result<Vec<Pixel>> {
        let mut pixels = Vec::with_capacity(cell.width * cell.height);
        let rows = cell.height.div_ceil(TILE);
        let fitting = (self.plan.tiles / (cell.width.div_ceil(TILE) as u64 * TILE_BYTES)).max(1) as usize;
        // Bands of about the same height.
        let bands = rows.div_ceil(fitting);
        let scratch = Spares::<Scratch>::default();
        for number in 0..bands {
            let band = Band::new(cell.width, rows * number / bands..rows * (number + 1) / bands);
            let reach = band.reach();
            let reaches = |block: &usize| {
                let bounds = self.blocks.bounds_of(*block);
                let (low, high) = projection.rows(&bounds);
                // A place more on either side, since places are rounded.
                !bounds.is_empty() && high + 1.0 >= reach.start as f64 && low - 1.0 <= reach.end as f64
            };
            let blocks: Vec<usize> = (0..self.blocks.len()).filter(reaches).collect();
            let draw = |i: usize| scratch.lend(|scratch| self.block(projection, &band, blocks[i], scratch));
            let mut done = 0;
            self.workers.in_order_range(self.plan.sizes.in_flight, blocks.len(), draw, |()| {
                done += 1;
                progress((number as f64 + f64::from(done) / blocks.len() as f64) / bands as f64);
                Ok(())
            })?;
            let rows = band.rows();
            let look = |i: usize| {
                let row = rows.start + i;
                let mut out = vec![Pixel::EMPTY; cell.width * TILE.min(cell.height - row * TILE)];
                band.pixels(row, cell.width, cell.height, |x, y, samples| {
                    out[(y - row * TILE) * cell.width + x] = Pixel::of(samples, projection.deep);
                });
                Ok(out)
            };
            self.workers.in_order_range(self.workers.threads() + 1, rows.len(), look, |row| {
                pixels.extend(row);
                Ok(())
            })?;
        }
        Ok(pixels)
    }

    /// Draws a block's triangles.
    fn block(&self, projection: &Projection, band: &Band, number: usize, scratch: &mut Scratch) -> Result<()> {
        let Scratch { piece, vertices, placed, bins } = scratch;
        self.blocks.read(number, piece)?;
        vertices.clear();
        if self.vertices.are_known() {
            self.vertices.read(self.blocks, number, piece, vertices)?;
        }
        let (table, faces) = (&piece.corners.table, &piece.local);
        placed.clear();
        placed.extend(table.iter().map(|position| projection.place(*position)));
        let first = number as u64 * BLOCK as u64;
        let corners = |i: usize| faces[i].map(|v| placed[v as usize]);
        let extent = (self.blocks.bounds.high - self.blocks.bounds.low).max_element();
        let unit = if extent > 0.0 { 1.0 / extent } else { 1.0 };
        let turn = |v: Vec3| projection.frame.turn(v.as_dvec3()).as_vec3();
        let painter = |i: usize, front: bool| {
            let face = faces[i];
            let own = normal(face.map(|v| table[v as usize]), unit).map(|n| turn(n).normalize_or_zero());
            let own = own.unwrap_or(Vec3::ZERO);
            let known = |v: u32| vertices.get(v as usize).copied().unwrap_or_default();
            let normals = match self.shading {
                Shading::Flat => [own; 3],
                Shading::Smooth => {
                    face.map(|v| known(v).normal().map_or(own, |(mean, smooth)| creased(own, turn(mean), smooth)))
                }
            };
            let tints = face.map(|v| known(v).tint);
            move |weights: [f32; 3]| {
                let [a, b, c] = normals;
                let normal = a * weights[0] + b * weights[1] + c * weights[2];
                // A single triangle that was turned over among others is no back: its vertices know.
                let side = if front || normal.z > 0.0 { Side::Front } else { Side::Back };
                Paint { normal: pack_normal(normal), tone: self.tint.tone(tints, weights, side) }
            }
        };
        band.draw(bins, first, faces.len(), corners, painter);
        Ok(())
    }
}

/// The cosines between which a corner on an edge goes over from its triangle's normal to the vertex's: an edge of a body stays one, where vertices have normals that none of its
/// sides has.
const CREASE: (f32, f32) = (0.75, 0.95);

/// The normal at a corner of a triangle that has the normal `own`, where the vertex has `mean`, and the surface is `smooth`, from 0 to 1.
fn creased(own: Vec3, mean: Vec3, smooth: f32) -> Vec3 {
    let cosine = own.dot(mean);
    // Of a triangle that was turned over its own normal says nothing.
    if cosine <= 0.0 || smooth >= 1.0 {
        return mean;
    }
    let t = ((cosine - CREASE.0) / (CREASE.1 - CREASE.0)).clamp(smooth, 1.0);
    own.lerp(mean, t * t * (3.0 - 2.0 * t))
}

/// Rows of pixels that become part of the picture at once.
const ROWS: usize = 16;

/// Puts a view into its cell.
fn fill(picture: &mut Picture, cell: &Cell, pixels: &[Pixel], background: Background, workers: &Workers) -> Result<()> {
    let openness = Openness::new(cell.width, cell.height);
    let mut open = Vec::with_capacity(pixels.len());
    let look = |row: usize| Ok(openness.of_row(pixels, row));
    workers.in_order_range(2 * workers.threads(), cell.height, look, |row| {
        open.extend(row);
        Ok(())
    })?;
    let channels = picture.channels;
    let look = |part: usize| {
        let rows = part * ROWS..(part * ROWS + ROWS).min(cell.height);
        let mut out = Vec::with_capacity(rows.len() * cell.width * channels);
        for row in rows {
            for column in 0..cell.width {
                let pixel = &pixels[row * cell.width + column];
                let open = openness.mean(pixels, &open, column, row);
                let (light, covered) = pixel.light(open);
                match background {
                    Background::Colour(colour) if covered == 0.0 => out.extend(colour),
                    Background::Colour(colour) => {
                        let light = light + linear(colour) * (1.0 - covered);
                        out.extend(light.to_array().map(encode));
                    }
                    Background::Transparent => {
                        let light = if covered > 0.0 { light / covered } else { light };
                        out.extend(light.to_array().map(encode));
                        out.push((covered * 255.0 + 0.5) as u8);
                    }
                }
            }
        }
        Ok(out)
    };
    let mut row = 0;
    workers.in_order_range(workers.threads() + 1, cell.height.div_ceil(ROWS), look, |bytes| {
        for line in bytes.chunks_exact(cell.width * channels) {
            picture.row(cell, row).copy_from_slice(line);
            row += 1;
        }
        Ok(())
    })
}
