//! The workload: what a run's memory and disk depend on, and the bytes of what persists from pass to pass.

use crate::grid::coarse;
use crate::grid::partition::sphere_halo;
use crate::grid::partition::{BUCKET_SLICES, Slabs, buckets_round, halo, slab_count};
use crate::grid::rank_bitmap::RankBitmap;
use crate::grid::survey::Wanted;
use crate::grid::{Cell, Grid};
use crate::input::{BLOCK_BYTES, BLOCK_RECORDS, Cloud};
use crate::nearest::bridged;
use crate::points::Precision;
use crate::settings::simplification::Simplification;
use crate::settings::surface::Fit;
use crate::simplify::Extent;
use crate::solid::winding;
use crate::stitch::size::{Made, MeansBytes, Size};
use crate::storage::remote;

/// Bytes for each column while heights are found (extents, heights, tops, flags), and while slabs are made.
const COLUMN: (u64, u64) = (17, 5);

/// What the plan is made from.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Workload {
    /// Number of points.
    pub points: u64,
    /// Precision of the cloud.
    pub precision: Precision,
    /// Bytes of a point's attributes.
    pub attributes: u64,
    /// Cells along x, slices, rows.
    pub cells: Cell,
    /// Steps of smoothing.
    pub smooth: u32,
    /// Slices of a slab.
    slab_slices: u32,
    /// What vertices are moved onto.
    pub fit: Fit,
    /// The size of each slab, as far as is known.
    slabs: Vec<Size>,
    /// Whether a ball falls, which takes more stores of slices.
    falls: bool,
    /// The most points of a bucket, and of those round a plane, if they have been counted.
    counted: Option<PointWorkload>,
    /// Bytes for means of cells, if these have been counted.
    means: Option<MeansBytes>,
    /// The columns of a surface that is seen from one side.
    pub(crate) columns: Option<ColumnWorkload>,
    /// Whether vertices may move, or colours count, as triangles are left out; none if all stay.
    simplified: Option<bool>,
    /// Whether levels of fewer triangles are made of the mesh.
    levels: bool,
    /// Whether distances from points are measured, and triangles left out by them.
    bridging: Option<bool>,
    /// Cells of the grid to a cell of the level that inside and outside are told apart on, along every axis, at the least.
    level: u32,
    /// Bytes that telling them apart was found to take, once cells have been closed; 0 before that.
    field_found: u64,
    /// Whether lines of sight are looked along.
    sighted: bool,
    /// Whether points and mesh lie on disk in any case, since they are to outlast the run.
    outlasting: bool,
    /// Whether bytes go to an object store, or come from one.
    transfers: bool,
    /// The survey's passes.
    surveying: SurveyWorkload,
    /// Looking for places between points that are sparse; none where that is not done.
    upsampled: Option<Upsampling>,
}

/// What the plan must know of looking for places between sparse points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
struct Upsampling {
    /// The points.
    points: u64,
    /// Bytes of closing the cells that were tried.
    closing: u64,
}

/// What the plan must know of the survey.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct SurveyWorkload {
    /// Blocks that the input comes in, as far as is known.
    pub blocks: u64,
    /// Points of a block at the most.
    pub points: u64,
    /// Bytes of a point's coordinates.
    pub coordinates: u64,
    /// What is looked for.
    pub wanted: Wanted,
    /// Bytes that a block takes before it is decoded.
    pub as_read: u64,
}

impl SurveyWorkload {
    /// That of a cloud whose points are not counted yet.
    pub fn of(cloud: &Cloud, wanted: Wanted) -> SurveyWorkload {
        let most = BLOCK_RECORDS as u64;
        let records = || cloud.sources().iter().map(|source| source.records);
        SurveyWorkload {
            blocks: records()
                .map(|records| records.map_or(u64::MAX, |n| n.div_ceil(most).max(1)))
                .fold(0, u64::saturating_add),
            points: records().map(|records| records.map_or(most, |n| n.min(most))).max().unwrap_or(0),
            coordinates: 3 * cloud.precision().bytes() as u64,
            wanted,
            as_read: BLOCK_BYTES as u64,
        }
    }

    /// The same when it is known in how many blocks the points came, and how many the largest had: of text, nobody knows before.
    pub(crate) fn counted(self, cloud: &Cloud, (blocks, points): (u64, u64)) -> SurveyWorkload {
        // Where files differ, they lie in a vector that grows by doubling.
        let is_one = matches!(cloud.sources(), [_]);
        let room = if is_one { points } else { points.next_power_of_two() };
        SurveyWorkload { blocks, points: self.points.min(room), as_read: cloud.bytes_of_block(), ..self }
    }

    /// Bytes with so many blocks in flight, of which as many as there are threads are looked at, whether or not files can be mapped.
    pub(crate) fn bytes(&self, in_flight: u64, threads: u64) -> u64 {
        SurveyWorkload { as_read: BLOCK_BYTES as u64, ..*self }.bytes_as_read(in_flight, threads)
    }

    /// The same with blocks that take as much before they are decoded as was found.
    pub(crate) fn bytes_as_read(&self, in_flight: u64, threads: u64) -> u64 {
        let in_flight = in_flight.min(self.blocks);
        let looking = self.points * self.coordinates + self.wanted.bytes_looking(self.points);
        let found = self.wanted.bytes_found(self.points);
        // All that was found has no more than one block's, as far as that is full.
        let all = self.wanted.bytes_found(self.points.saturating_mul(self.blocks));
        in_flight * (self.as_read + found) + in_flight.min(threads) * looking + all
    }

    /// The most blocks that may be in flight in `room` bytes: one at least, and two for each thread at the most.
    pub(crate) fn blocks_in(&self, room: u64, threads: u64) -> u64 {
        (1..=2 * threads).rev().find(|blocks| self.bytes(*blocks, threads) <= room).unwrap_or(1)
    }
}

/// The most points of a bucket, and of as many in a row as are looked at round a plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct PointWorkload {
    /// The most points of one bucket.
    pub bucket: u64,
    /// The most points of [`buckets_round`] the halo.
    pub window: u64,
}

/// What the plan must know of columns.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ColumnWorkload {
    /// Columns of a slice.
    pub of_slice: u32,
    /// Radius of the disc that bridges holes, in cells.
    pub bridge: u32,
}

impl Workload {
    /// The workload of `points` points on `grid`, with the faces of a surface round the whole box, and a third more for its slopes.
    pub fn new(points: u64, precision: Precision, grid: &Grid, slabs: impl Into<Slabs>) -> Workload {
        Workload::in_cells(points, precision, grid.cells(), slabs)
    }

    /// [`Workload::new`] for a grid of so many cells along x, slices and rows.
    pub fn in_cells(points: u64, precision: Precision, cells: Cell, slabs: impl Into<Slabs>) -> Workload {
        let partition: Slabs = slabs.into();
        let [x, y, z] = cells.map(u64::from);
        let faces = (2 * (x * y + y * z + z * x) * 4 / 3).min(x.saturating_mul(y).saturating_mul(z).saturating_mul(6));
        let slabs = slab_count(partition, cells[1]);
        let share = faces.div_ceil(u64::from(slabs));
        Workload {
            points,
            precision,
            attributes: 0,
            cells,
            smooth: partition.smooth,
            slab_slices: partition.slices,
            fit: Fit::Nearest,
            slabs: vec![Size::even(share, partition); slabs as usize],
            falls: false,
            counted: None,
            means: None,
            columns: None,
            simplified: None,
            levels: false,
            bridging: None,
            level: 1,
            field_found: 0,
            sighted: false,
            outlasting: false,
            transfers: false,
            upsampled: None,
            surveying: SurveyWorkload {
                blocks: 0,
                points: 0,
                coordinates: 0,
                wanted: Wanted::Extent,
                as_read: BLOCK_BYTES as u64,
            },
        }
    }

    /// The same workload with a survey.
    pub fn with_survey(self, surveying: SurveyWorkload) -> Workload {
        Workload { surveying, ..self }
    }

    /// The survey.
    pub(crate) fn surveying(&self) -> SurveyWorkload {
        self.surveying
    }

    /// The same workload with points and mesh in files that outlast the run.
    pub fn with_work_folder(self) -> Workload {
        Workload { outlasting: true, ..self }
    }

    /// The same workload with buffers for what goes to an object store, or comes from one.
    pub fn with_transfers(self) -> Workload {
        Workload { transfers: true, ..self }
    }

    /// Bytes of these buffers.
    pub(crate) fn transfers(&self) -> u64 {
        if self.transfers { remote::BUFFERS } else { 0 }
    }

    /// Whether points and mesh lie in files that outlast the run.
    pub(crate) fn is_outlasting(&self) -> bool {
        self.outlasting
    }

    /// The workload of a surface that is seen from one side.
    pub fn with_columns(self, columns: ColumnWorkload) -> Workload {
        Workload { columns: Some(columns), ..self }
    }

    /// The same workload with other numbers of faces, one for each slab; `falls` says whether a ball falls to close the cells.
    ///
    /// # Panics
    /// If there are not as many numbers as slabs.
    pub fn with_faces(&self, slabs: Vec<u64>, falls: bool) -> Workload {
        assert_eq!(slabs.len(), self.slabs.len(), "a number of faces for each slab");
        let slabs = slabs.into_iter().map(|faces| Size::even(faces, self.partition())).collect();
        Workload { slabs, falls, ..self.clone() }
    }

    /// The same workload without a surface, as far as there are cells only, which carry no attributes.
    pub(crate) fn without_surface(self) -> Workload {
        let slabs = vec![0; self.slabs.len()];
        Workload {
            attributes: 0,
            simplified: None,
            levels: false,
            bridging: None,
            ..self.with_faces(slabs, self.falls)
        }
    }

    /// The same workload for a body that stands on a flat bottom: it is expected to have upright walls at either end of the slices.
    pub fn with_walls_at_ends(self) -> Workload {
        let mut slabs = self.slabs.clone();
        let wall = u64::from(self.cells[0]) * u64::from(self.cells[2]);
        let last = slabs.len() - 1;
        for number in if last == 0 { vec![0, 0] } else { vec![0, last] } {
            let slab = &mut slabs[number];
            (slab.faces, slab.round, slab.layer) = (slab.faces + wall, slab.round + wall, slab.layer + wall);
        }
        Workload { slabs, ..self }
    }

    /// The same workload when the faces of all slices are known; `falls` as in [`Workload::with_faces`].
    ///
    /// # Panics
    /// If there are not as many numbers as slices.
    pub fn with_faces_of_slices(&self, faces: &[u32], falls: bool) -> Workload {
        assert_eq!(faces.len(), self.cells[1] as usize, "a number of faces for each slice");
        let partition = self.partition();
        let slabs = (0..slab_count(partition, self.cells[1])).map(|number| Size::counted(faces, number, partition));
        Workload { slabs: slabs.collect(), falls, ..self.clone() }
    }

    /// The same workload for a mesh of which triangles are left out in the end, as it is asked.
    pub fn with_simplification(self, asked: Option<Simplification>) -> Workload {
        let marked = |asked: Simplification| asked.move_vertices || asked.keep_colours.is_some();
        Workload { simplified: asked.map(marked), ..self }
    }

    /// The same workload for a mesh that one of fewer triangles is made of beside it, for a page.
    pub fn with_page(self) -> Workload {
        Workload { simplified: self.simplified.or(Some(false)), ..self }
    }

    /// The same workload for a mesh that levels of fewer triangles are made of in the end.
    pub fn with_levels(self) -> Workload {
        Workload { levels: true, ..self }
    }

    /// The same workload for a mesh whose vertices' distances from points are `measured`; triangles may be `trimmed` by them.
    pub fn with_bridging(self, measured: bool, trimmed: bool) -> Workload {
        Workload { bridging: (measured || trimmed).then_some(trimmed), ..self }
    }

    /// The same workload when inside and outside are told apart on cells so many times as wide as the grid's, or wider.
    pub fn with_level(self, level: u32) -> Workload {
        Workload { level: level.max(1), ..self }
    }

    /// The same workload when telling inside and outside apart was found to take so many bytes.
    pub fn with_field_found(self, bytes: u64) -> Workload {
        Workload { field_found: bytes, ..self }
    }

    /// Bytes that this was found to take; 0 if it is not known.
    pub(crate) fn field_found(&self) -> u64 {
        self.field_found
    }

    /// The grid's cells taken together as those of that level.
    pub(crate) fn cells_of_level(&self) -> Cell {
        self.cells.map(|cells| cells.div_ceil(self.level))
    }

    /// The same workload for points of which it is known where they were scanned from, or not.
    pub fn with_sights(self, sighted: bool) -> Workload {
        Workload { sighted, ..self }
    }

    /// Whether lines of sight are looked along.
    pub(crate) fn is_sighted(&self) -> bool {
        self.sighted
    }

    /// The same workload with vertices that are moved onto something else than their nearest points.
    pub fn with_fit(self, fit: Fit) -> Workload {
        Workload { fit, ..self }
    }

    /// The same workload when the points of each bucket are known.
    pub fn with_buckets(self, points: &[u64]) -> Workload {
        let most = |buckets: usize| {
            points.windows(buckets.clamp(1, points.len().max(1))).map(|some| some.iter().sum()).max().unwrap_or(0)
        };
        let counted = PointWorkload { bucket: most(1), window: most(buckets_round(halo(self.smooth)) as usize) };
        Workload { counted: Some(counted), ..self }
    }

    /// The same workload when it is known how many bytes means of cells need.
    pub fn with_means(self, means: MeansBytes) -> Workload {
        Workload { means: Some(means), ..self }
    }

    /// The same workload with attributes of so many bytes on every point.
    pub fn with_attributes(self, bytes: usize) -> Workload {
        Workload { attributes: bytes as u64, ..self }
    }

    /// Bytes of a point's coordinates.
    pub fn coordinates(&self) -> u64 {
        3 * self.precision.bytes() as u64
    }

    /// Bytes of a point in a bucket, and of a vertex in the mesh.
    pub fn record(&self) -> u64 {
        self.coordinates() + self.attributes
    }

    /// The same with places looked for between so many points.
    pub fn with_upsampling(self, points: u64) -> Workload {
        Workload { upsampled: Some(Upsampling { points, closing: 0 }), ..self }
    }

    /// The same if closing cells of points and places, to try them, was found to take so many bytes.
    pub(crate) fn with_tries(self, closing: u64) -> Workload {
        Workload { upsampled: self.upsampled.map(|upsampled| Upsampling { closing, ..upsampled }), ..self }
    }

    /// Bytes of looking for places between sparse points: the surface that they are on, and then, beside a second coarse grid, the cells of points and places.
    pub(crate) fn upsampling(&self) -> u64 {
        self.upsampled.map_or(0, |Upsampling { points, closing }| winding::bytes(points).max(coarse::BYTES + closing))
    }

    /// Faces to expect.
    pub fn faces(&self) -> u64 {
        self.slabs.iter().map(|slab| slab.faces).sum()
    }

    /// Triangles to expect: two a face, less what contraction takes.
    pub fn triangles(&self) -> u64 {
        self.faces() * 2
    }

    /// Vertices to expect.
    pub fn vertices(&self) -> u64 {
        self.faces()
    }

    /// The mesh that is simplified, if it is.
    pub fn simplified(&self) -> Option<Extent> {
        let (triangles, vertices, precision) = (self.triangles(), self.vertices(), self.precision);
        self.simplified.map(|marked| Extent { triangles, vertices, precision, marked })
    }

    /// The mesh that levels are made of, if they are.
    pub fn levels(&self) -> Option<Extent> {
        let (triangles, vertices, precision) = (self.triangles(), self.vertices(), Precision::Single);
        self.levels.then_some(Extent { triangles, vertices, precision, marked: false })
    }

    /// What the measuring of distances depends on, if there is any.
    pub(crate) fn bridging(&self) -> Option<bridged::Extent> {
        let (points, vertices, triangles) = (self.points, self.vertices(), self.triangles());
        let (precision, attributes) = (self.precision, self.attributes);
        self.bridging.map(|trimmed| bridged::Extent { points, vertices, triangles, precision, attributes, trimmed })
    }

    /// Bytes of the mesh to expect, in temporary storage.
    pub fn mesh_bytes(&self) -> u64 {
        self.vertices() * self.record() + self.triangles() * 13
    }

    /// Bytes of the points in buckets.
    pub fn bucket_bytes(&self) -> u64 {
        self.points * self.record()
    }

    /// Buckets.
    pub(crate) fn buckets(&self) -> u64 {
        u64::from(self.cells[1].div_ceil(BUCKET_SLICES))
    }

    /// Bytes that slices take as runs while the ball is looked for, to expect: of each row its start in four stores and the run round it; of faces,
    /// a third lie across x, half of them at either end of a run; and all that at half the resolution, a quarter, and so on.
    pub fn slice_bytes(&self) -> u64 {
        let [_, y, z] = self.cells.map(u64::from);
        let sealing = (y * z * 28 + self.faces() * 8) * 4 / 3 + y * 200;
        (if self.falls { sealing * 3 } else { sealing }) + y * self.columns_of_slice() * COLUMN.0
    }

    /// The part of these bytes that remains while slabs are made: occupied and solid cells.
    pub(crate) fn standing_slice_bytes(&self) -> u64 {
        let [_, y, z] = self.cells.map(u64::from);
        y * z * 8 + self.faces() * 6 + y * self.columns_of_slice() * COLUMN.1
    }

    /// Columns of a slice, if there are any.
    pub(crate) fn columns_of_slice(&self) -> u64 {
        self.columns.map_or(0, |columns| u64::from(columns.of_slice))
    }

    /// How slices are dealt out to slabs.
    pub(crate) fn partition(&self) -> Slabs {
        Slabs { smooth: self.smooth, slices: self.slab_slices }
    }

    /// The sizes of slabs, in order.
    pub(crate) fn slabs(&self) -> &[Size] {
        &self.slabs
    }

    /// What the memory of slabs depends on beside their sizes.
    pub(crate) fn made(&self) -> Made {
        Made {
            smooth: self.smooth,
            slab_slices: self.slab_slices,
            fit: self.fit,
            coordinates: self.coordinates(),
            attributes: self.attributes,
            trimmed: self.columns.is_some(),
            columns: self.columns_of_slice() * COLUMN.1,
            cells: self.cells,
        }
    }

    /// Temporary disk to expect when nothing is kept in memory.
    pub fn disk(&self) -> u64 {
        self.bucket_bytes() + self.slice_bytes().max(self.standing_slice_bytes() + self.mesh_bytes())
    }

    /// Bytes that a block of input takes while its points are sorted: as it is read, where files cannot be mapped, and [beside that](Workload::sorting_a_block).
    pub(crate) fn block_job(&self) -> u64 {
        BLOCK_BYTES as u64 + self.sorting_a_block()
    }

    /// Bytes of a block's points, decoded and sorted, with the buckets that they go to.
    pub(crate) fn sorting_a_block(&self) -> u64 {
        let points = match self.surveying.points {
            0 => self.points.min(BLOCK_RECORDS as u64),
            most => self.points.min(most),
        };
        points * (2 * self.record() + 4) + 4 * self.buckets()
    }

    /// Blocks that the input comes in.
    pub(crate) fn blocks(&self) -> u64 {
        match self.surveying.blocks {
            0 | u64::MAX => self.points.div_ceil(BLOCK_RECORDS as u64),
            counted => counted,
        }
    }

    /// Bytes of bits that one slab's job holds while it is fitted: the index of points.
    pub(crate) fn fitting_raster(&self) -> u64 {
        let [x, _, z] = self.cells;
        let slices = u64::from(BUCKET_SLICES * buckets_round(halo(self.smooth)));
        RankBitmap::bytes(slices, self.points_near().window, x, z)
    }

    /// The most faces of a slab.
    pub fn faces_of_widest(&self) -> u64 {
        self.slabs.iter().map(|slab| slab.faces).max().unwrap_or(0)
    }

    /// Points of buckets: as counted, or to expect if points lie where faces do.
    pub(crate) fn points_near(&self) -> PointWorkload {
        self.counted.unwrap_or_else(|| {
            let share = self.faces_of_widest() as f64 / self.faces().max(1) as f64;
            let slices = |buckets: u32| f64::from(buckets * BUCKET_SLICES) / f64::from(self.slab_slices);
            let points = |buckets: u32| ((self.points as f64 * share * slices(buckets)) as u64 + 1).min(self.points);
            PointWorkload { bucket: points(1), window: points(buckets_round(halo(self.smooth))) }
        })
    }

    /// Bytes of the means of cells that fitting holds: as counted, or to expect, as if the widest slab's slices had an occupied cell for every face.
    pub(crate) fn means(&self) -> MeansBytes {
        if !matches!(self.fit, Fit::Sphere | Fit::Facets | Fit::Auto | Fit::AutoPoints) {
            return MeansBytes::default();
        }
        if let Some(means) = self.means {
            return means;
        }
        let window = 2 * u64::from(sphere_halo(self.smooth));
        let in_slice = (self.faces_of_widest() / u64::from(self.slab_slices)).min(self.points / window) + 1;
        let in_slice = vec![u32::try_from(in_slice).unwrap_or(u32::MAX); window as usize];
        MeansBytes::of(&in_slice, self.cells, self.smooth)
    }

    /// The points that must be held at once for all of a plane's to be there: as many for each bucket as the fullest has.
    pub(crate) fn all_held(&self) -> u64 {
        self.points_near().bucket * u64::from(buckets_round(halo(self.smooth)))
    }
}
