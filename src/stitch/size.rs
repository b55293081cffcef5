//! The size of a slab, and what memory its mesh and the making of it take.

use std::sync::Arc;

use crate::grid::Cell;
use crate::grid::partition::{Slabs, slices_of, smooth_halo};
use crate::grid::slice::Bits;
use crate::resources::memory::Tally;
use crate::settings::surface::Fit;
use crate::surface::attributes::{Lookup, bytes_of_table};
use crate::surface::contract::{self, Stars};
use crate::surface::extract::Surface;
use crate::surface::fit::Fitted;
use crate::surface::untangle::broad_phase::{BLOCK, BroadPhase};
use crate::surface::untangle::quantized::{PackedBox, QuantizedPoint};
use crate::surface::vertex_state::VertexState;
use crate::surface::{creases, facets, flips, smooth, sphere, untangle};

/// What a slab's memory depends on, in faces; where they are counted, in [`crate::surface::vertices::weights`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
pub struct Size {
    /// Its own.
    pub faces: u64,
    /// Those of all planes that are smoothed with it, its own included.
    pub round: u64,
    /// The most in a layer as thick as those that are searched for pairs of triangles.
    pub layer: u64,
    /// Those of the lowest and of the highest such layer.
    pub ends: [u64; 2],
    /// Those of the slice below `round`.
    pub below: u64,
    /// Those of the slices below and above `round` that creases are seen in.
    pub beside: u64,
}

/// What it depends on beside that.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Made {
    /// Steps of smoothing.
    pub smooth: u32,
    /// Slices of a slab.
    pub slab_slices: u32,
    /// What vertices are moved onto.
    pub fit: Fit,
    /// Bytes of a point's coordinates.
    pub coordinates: u64,
    /// Bytes of a point's attributes.
    pub attributes: u64,
    /// Whether triangles are left out.
    pub trimmed: bool,
    /// Bytes of a slice's columns, if there are any.
    pub columns: u64,
    /// The grid's cells.
    pub cells: Cell,
}

/// Bytes of the means of cells that are held at a time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
pub struct MeansBytes {
    /// By fitting to spheres.
    pub of_spheres: u64,
    /// By fitting facets.
    pub of_facets: u64,
}

impl MeansBytes {
    /// On a grid of `cells` with so many occupied cells `in_slice`.
    pub fn of(in_slice: &[u32], cells: Cell, smooth: u32) -> MeansBytes {
        MeansBytes {
            of_spheres: sphere::bytes(in_slice, cells, smooth),
            of_facets: facets::bytes_of_means(in_slice, cells),
        }
    }
}

impl Made {
    /// Whether creases may be looked for: on what is closed.
    fn may_have_creases(&self) -> bool {
        self.may_be_centred() && self.columns == 0
    }

    /// Whether vertices may go to places other than their points, so that facets pass amid these.
    fn may_be_centred(&self) -> bool {
        matches!(self.fit, Fit::Auto | Fit::Facets)
    }

    /// Whether edges may be flipped.
    fn may_have_flips(&self) -> bool {
        matches!(self.fit, Fit::Auto | Fit::AutoPoints) || self.fit.has_flips()
    }
}

/// What a slab says of the memory that its stages take, and to whom.
#[derive(Debug)]
pub struct Told {
    /// Those who hold memory at the same time.
    pub tally: Arc<Tally>,
    /// What a slab's memory depends on.
    pub of: Made,
    /// The size of each slab, as the plan has it.
    pub sizes: Vec<Size>,
    /// Bytes of the points that are held for fitting.
    pub points: u64,
    /// Bytes of the means of cells.
    pub means: MeansBytes,
}

impl Told {
    /// The size of slab `number` whose surface has so many vertices, its own among them, and so many triangles of its own.
    pub fn size(&self, number: u32, vertices: usize, own: usize, triangles: usize) -> Size {
        let planned = self.sizes[number as usize];
        let beside = planned.looked_at(&self.of) - planned.round;
        let faces = (own.max(triangles / 2) as u64).min(planned.faces);
        Size {
            faces,
            round: (vertices as u64).saturating_sub(beside).clamp(faces, planned.round.max(faces)),
            ..planned
        }
    }
}

/// The bytes of a slab while it is made, stage by stage, all that was made before included.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stages {
    /// Its surface is extracted and smoothed.
    pub extracting: u64,
    /// Its vertices are moved.
    pub fitting: u64,
    /// They are given attributes, which are not found yet.
    pub carrying: u64,
    /// The most that looking these up takes beside that.
    pub looking_up: u64,
    /// Edges are contracted.
    pub contracting: u64,
    /// Vertices go back until no triangles intersect.
    pub retreating: u64,
    /// It is made, and waits for its seams.
    pub made: u64,
}

impl Stages {
    /// The most at a time.
    fn most(self) -> u64 {
        let Stages { extracting, fitting, carrying, looking_up, contracting, retreating, made } = self;
        [extracting, fitting, carrying + looking_up, contracting, retreating, made].into_iter().max().unwrap_or(0)
    }
}

/// Slices below and above those that are smoothed with a slab, in which creases are seen ([`creases::PLANES_BESIDE`]): the plane of vertices above the slab is smoothed with it anyway.
const BESIDE: u32 = 2 * creases::PLANES_BESIDE - 1;

/// Slices that a layer of triangles may lie in, which is two cells thick.
const LAYER: usize = 3;

impl Size {
    /// The size of a slab of so many faces, if they lie evenly in its slices.
    pub fn even(faces: u64, slabs: impl Into<Slabs>) -> Size {
        let Slabs { smooth, slices } = slabs.into();
        let slices = u64::from(slices);
        let layer = (faces * LAYER as u64).div_ceil(slices);
        let beside = 2 * u64::from(smooth_halo(smooth)) + 1;
        Size {
            faces,
            round: faces + (faces * beside).div_ceil(slices),
            layer,
            ends: [layer; 2],
            below: faces.div_ceil(slices),
            beside: (faces * u64::from(BESIDE)).div_ceil(slices),
        }
    }

    /// The size of slab `number`, where the faces of all slices are known.
    pub fn counted(faces: &[u32], number: u32, slabs: impl Into<Slabs>) -> Size {
        let slabs: Slabs = slabs.into();
        let sum = |slices: &[u32]| slices.iter().map(|faces| u64::from(*faces)).sum::<u64>();
        let slices = slices_of(number, slabs, faces.len() as u32);
        let [start, end] = [slices.start, slices.end].map(|slice| slice as usize);
        let beside = smooth_halo(slabs.smooth) as usize;
        let own = &faces[start..end];
        // A fitted vertex may have come from a slice beyond.
        let round = start.saturating_sub(beside)..(end + beside + 1).min(faces.len());
        let lower = round.start;
        let sight = creases::PLANES_BESIDE as usize;
        let below = lower.saturating_sub(sight)..lower;
        let above = round.end..(round.end + sight - 1).min(faces.len());
        let layers = faces[start.saturating_sub(1)..(end + 1).min(faces.len())].windows(LAYER.min(own.len()));
        let (lowest, highest) = (start..end.min(start + LAYER), start.max(end.saturating_sub(LAYER))..end);
        Size {
            faces: sum(own),
            round: sum(&faces[round]),
            layer: layers.map(sum).max().unwrap_or(0),
            ends: [lowest, highest].map(|slices| sum(&faces[slices])),
            below: lower.checked_sub(1).map_or(0, |slice| u64::from(faces[slice])),
            beside: sum(&faces[below]) + sum(&faces[above]),
        }
    }

    /// Vertices of so many faces: no more than where they are counted, and as many on the surface of anything large.
    pub(super) fn vertices(faces: u64) -> u64 {
        faces + 8
    }

    /// The faces of all planes that are looked at: for facets, of one more slice; for creases, of a few.
    fn looked_at(self, of: &Made) -> u64 {
        self.round
            + match (of.may_be_centred(), of.may_have_creases()) {
                (_, true) => self.beside,
                (true, _) => self.below,
                _ => 0,
            }
    }

    /// Bytes of what a slab that is made in another's room holds only when its vertices are fitted; where facets are fitted, it is not held before (`stitch/make.rs`).
    fn bytes_after_fitting(self, of: &Made) -> u64 {
        let (own, triangles) = (Size::vertices(self.faces), self.triangles());
        Stars::bytes(Size::vertices(self.faces + self.ends[1]), triangles)
            + own * size_of::<QuantizedPoint>() as u64
            + triangles / BLOCK as u64 * size_of::<PackedBox>() as u64
            + if of.may_have_flips() { flips::bytes(triangles) } else { 0 }
    }

    /// Triangles likewise, with those that midpoints add.
    pub(super) fn triangles(self) -> u64 {
        2 * Size::vertices(self.faces)
    }

    /// Bytes of the places of its vertices: smoothed, and at rest.
    fn bytes_of_places(self, of: &Made) -> u64 {
        let own = Size::vertices(self.faces);
        // After one step of smoothing, the places of the plane above are in it still.
        let smoothed = if of.smooth > 1 { own } else { Size::vertices(self.looked_at(of)) };
        // On open surfaces, vertices leave where one step puts them for the surface's height.
        let rest = if of.smooth == 1 && of.columns == 0 { 0 } else { smoothed };
        (smoothed + rest) * size_of::<[f64; 3]>() as u64
    }

    /// Bytes of the slab's mesh.
    pub fn bytes(self, of: &Made) -> u64 {
        let (own, triangles) = (Size::vertices(self.faces), self.triangles());
        let of_vertex = of.attributes + size_of::<VertexState>() as u64;
        let of_triangle = (size_of::<[u32; 3]>() + usize::from(of.trimmed)) as u64;
        self.bytes_of_places(of)
            + Fitted::<f64>::bytes(
                if of.may_be_centred() { Size::vertices(self.looked_at(of)) } else { own },
                of.coordinates,
            )
            + if of.may_be_centred() { 2 * own * of.coordinates } else { 0 }
            + if of.may_have_creases() { own * (of.coordinates + size_of::<u32>() as u64) } else { 0 }
            + own * of_vertex
            + triangles * of_triangle
            + self.bytes_after_fitting(of)
    }

    /// The most bytes while it is made, with the `points` that are held for fitting, and with means.
    pub fn bytes_making(self, of: &Made, points: u64, means: MeansBytes) -> u64 {
        self.stages(of, (points, means), true).most()
    }

    /// The bytes of each stage; in the room of another slab, or in room of its own that is not touched before it is needed.
    pub fn stages(self, of: &Made, (points, means): (u64, MeansBytes), in_used_room: bool) -> Stages {
        let made = self.bytes(of);
        let (own, round) = (Size::vertices(self.faces), Size::vertices(self.looked_at(of)));
        let places = own * size_of::<[f64; 3]>() as u64;
        let more = if of.may_have_creases() { BESIDE } else { u32::from(of.may_be_centred()) };
        let planes = u64::from(of.slab_slices + 2 * smooth_halo(of.smooth) + 1 + more);
        let [width, _, rows] = of.cells;
        let slices = 3 * Bits::bytes(width + 2, rows + 2) + (planes + 2) * of.columns;
        // TriangleSet of planes beside the slab, which are dropped with the surface.
        let beside = if of.smooth > 1 { smooth::bytes(round, 1) - places } else { 0 };
        // Where smoothed places and those at rest are both there, the slab's part of them is copied: as much as a step takes.
        let stepping = if of.smooth > 1 { smooth::bytes(round, of.smooth) - places } else { 0 };
        // The triangles beside the slab's own.
        let around = 2 * (self.looked_at(of) - self.round) * size_of::<[u32; 3]>() as u64;
        let extracting = Surface::bytes(round, planes, of.cells) + slices + stepping + around;
        // While facets are fitted, what is held only after that is not there.
        let after = self.bytes_after_fitting(of);
        let centring = around + points.max(means.of_facets + facets::bytes(round, 2 * round, of.may_have_creases()));
        let centring = if in_used_room { centring.saturating_sub(after) } else { centring };
        let moved = match of.fit {
            Fit::Auto => points.max(means.of_spheres).max(centring),
            // Places in cells are for the diagonals.
            Fit::AutoPoints => points.max(means.of_spheres).max(places),
            Fit::Facets => centring,
            Fit::Sphere => means.of_spheres.max(if of.attributes > 0 { points } else { 0 }),
            Fit::Nearest => points.max(places),
            Fit::None if of.attributes > 0 => points,
            Fit::None => 0,
        };
        let second =
            if !of.fit.has_points() && of.attributes > 0 { Fitted::<f64>::bytes(own, of.coordinates) } else { 0 };
        // In the end, when the surface is gone, the slab's part of the smoothed places is copied.
        let copied = if of.smooth > 1 { places } else { 0 };
        let fitting = beside + (Surface::bytes_of_vertices(round) + moved).max(copied) + second;
        let looking_up = if of.attributes > 0 { Lookup::most(own).bytes(own, of.attributes) } else { 0 };
        let contracting = contract::bytes(own);
        let near = BroadPhase::bytes(self.faces, self.layer);
        let triangles = self.triangles();
        let flipping = if of.may_have_flips() { flips::bytes_of_flipping(triangles) } else { 0 };
        let retreating = own * of.coordinates + untangle::bytes(own, near).max(flipping);
        let touched = |bytes: u64| if in_used_room { made } else { bytes };
        let quantized = own * size_of::<QuantizedPoint>() as u64;
        let fitted = made - after;
        let extracted = self.bytes_of_places(of) + triangles * size_of::<[u32; 3]>() as u64;
        Stages {
            extracting: touched(extracted) + extracting,
            fitting: touched(fitted) + fitting,
            carrying: touched(fitted) + second,
            looking_up,
            contracting: touched(made - quantized) + contracting,
            retreating: made + retreating,
            made,
        }
    }

    /// The most bytes at the seam with the slab above, beside the two slabs' meshes.
    pub fn bytes_at_seam(self, above: Size, trimmed: bool) -> u64 {
        let both = Size::vertices(self.faces) + Size::vertices(above.faces);
        let meeting = self.ends[1] + above.ends[0];
        let near = BroadPhase::bytes(meeting, meeting);
        let common = bytes_of_table::<([u64; 3], u32)>(Size::vertices(self.ends[1].min(above.ends[0])));
        let retreating = untangle::bytes(both, near).max(common);
        // Numbers of the vertices, those of the slab before, and which are written.
        let writing = Size::vertices(self.faces) * (2 * size_of::<u32>() + 3 * usize::from(trimmed)) as u64;
        retreating.max(writing)
    }
}
