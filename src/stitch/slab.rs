//! A slab: its fixed share of the slices, and the mesh made of it alone, before its seams are closed.

use std::ops::Range;

use crate::error::Result;
use crate::grid::occupancy::Sampled;
use crate::grid::partition::{halo, slices_of, smooth_halo};
use crate::mesh::spool::Frame;
use crate::points::Coordinate;
use crate::resources::allocator;
use crate::resources::memory::SlabJobs;
use crate::resources::workers::refill;
use crate::settings::surface::{Fit, SurfaceOptions};
use crate::solid::Solid;
use crate::surface::attributes::attributes;
use crate::surface::contract::{Fans, Groups, NONE, contract, is_gone};
use crate::surface::extract::{Kind, Surface, Triangles};
use crate::surface::fit::{Fitted, Task, fit};
use crate::surface::plane::project;
use crate::surface::smooth::smooth;
use crate::surface::untangle::broad_phase::{BLOCK, Near, Places};
use crate::surface::untangle::quantized::{Extent, Scale, Spot};
use crate::surface::untangle::retreat;
use crate::surface::untangle::submesh::Piece;
use crate::surface::vertex_state::{Fate, SHARES};

/// The mesh of one slab, of points of precision `T`.
///
/// Triangles name vertices by number: `0..own()` are the slab's, `own() + n` is vertex n of the next slab, and from
/// [`BEFORE`] on, `BEFORE + n` is vertex n of the slab before (only where the seam below was closed over it).
#[derive(Debug, Default)]
pub struct SlabMesh<T> {
    /// The slab's slices.
    pub slices: Range<u32>,
    /// Of each vertex: its smoothed position, in file axes.
    pub smoothed: Vec<[f64; 3]>,
    /// Of each vertex: its position after one step of smoothing, to which it may retreat. Empty if that is the smoothed one.
    pub rest: Vec<[f64; 3]>,
    /// Of each vertex: its point.
    pub fitted: Fitted<T>,
    /// Of each vertex: the record of its attributes.
    pub attributes: Vec<u8>,
    /// Of each vertex: what became of it.
    pub fate: Vec<Fate>,
    /// Of each triangle, whether it is written in the end; empty if all are.
    pub kept: Vec<bool>,
    /// Triangles, in order; where contraction took one away, two of its corners are the same.
    pub triangles: Vec<[u32; 3]>,
    /// The triangles at each of the slab's vertices and of the next slab's that it names.
    pub fans: Fans,
    /// Of each of its planes, from the lowest on, the first vertex; then [`SlabMesh::own`].
    pub planes: Vec<u32>,
    /// Of each vertex: its spot, where it is now.
    pub spots: Vec<Spot>,
    /// The boxes of [`BLOCK`] triangles each.
    pub blocks: Vec<Extent>,
    /// Pairs of its own triangles that still intersect.
    pub tangled: u64,
}

/// Where [`SlabMesh`]'s numbers of the slab before begin.
pub const BEFORE: u32 = 1 << 31;

impl<T: Coordinate> SlabMesh<T> {
    /// Number of the slab's own vertices, contracted ones included.
    pub fn own(&self) -> u32 {
        self.fate.len() as u32
    }

    /// The slab's vertices on its lowest plane: `0..seam()`.
    pub fn seam(&self) -> u32 {
        self.planes[1]
    }

    /// The vertices on the lowest `planes` planes.
    pub fn on_lowest(&self, planes: u32) -> Range<u32> {
        0..self.planes[self.planes.len().min(planes as usize + 1) - 1]
    }

    /// The vertices on the highest `planes` planes.
    pub fn on_highest(&self, planes: u32) -> Range<u32> {
        self.planes[self.planes.len().saturating_sub(planes as usize + 1)]..self.own()
    }

    /// Room for a slab of so many faces: what it does not fill is not touched.
    pub fn with_room(faces: usize) -> SlabMesh<T> {
        // A surface has about as many vertices as faces; those of the plane above are there for a while.
        let (vertices, triangles) = (faces + faces / 8, 2 * faces + faces / 16);
        SlabMesh {
            smoothed: Vec::with_capacity(vertices),
            fitted: Fitted { point: Vec::with_capacity(vertices), target: Vec::with_capacity(vertices) },
            fate: Vec::with_capacity(vertices),
            triangles: Vec::with_capacity(triangles),
            fans: Fans::with_room(vertices, triangles),
            spots: Vec::with_capacity(vertices),
            ..SlabMesh::default()
        }
    }

    /// Makes the mesh of slab `number`, as one of so many `jobs`, in the memory of `room`: of a slab that is done with.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn make(
        number: u32,
        solid: &Solid,
        sampled: &Sampled<'_, T>,
        options: SurfaceOptions,
        frame: Frame,
        jobs: SlabJobs,
        room: SlabMesh<T>,
    ) -> Result<SlabMesh<T>> {
        let slices = slices_of(number, options.smooth, solid.cells[1]);
        let last = slices.end == solid.cells[1];
        let more = i64::from(smooth_halo(options.smooth));
        // Where memory is for one slab at a time, the plan does not count what a stage has given back.
        let end_stage = || {
            if jobs.running == 1 {
                allocator::give_back();
            }
        };
        let mut surface = Surface::find(solid, i64::from(slices.start) - more..=i64::from(slices.end) + more)?;
        let q = smooth(&surface, options.smooth, room.smoothed);
        let planes = slices.start..slices.end + u32::from(last);
        let own = surface.on_plane(planes.start).start..surface.on_plane(planes.end - 1).end;

        // The top plane of the last slab lies above its last slice and holds only faces perpendicular to y.
        let Triangles { corners: mut triangles, kept } =
            surface.triangles(planes.clone(), &q, options.diagonals, room.triangles);
        for corner in triangles.as_flattened_mut() {
            *corner -= own.start;
        }
        let named = triangles.as_flattened().iter().copied().max().map_or(0, |v| v + 1).max(own.len() as u32);
        let starts =
            planes.clone().map(|plane| surface.on_plane(plane).start - own.start).chain([own.len() as u32]).collect();
        let grid = sampled.grid;
        let to_world = |mut q: Vec<[f64; 3]>| -> Vec<[f64; 3]> {
            q.truncate(own.end as usize);
            q.drain(..own.start as usize);
            q.into_iter().map(|q| grid.position(q)).collect()
        };
        let rest = if options.smooth == 1 { Vec::new() } else { to_world(smooth(&surface, 1, room.rest)) };
        // What is no longer needed goes before the next large thing comes: the slab's peak is what the plan counts.
        surface.drop_lookups();
        end_stage();
        let mut fate = room.fate;
        refill(&mut fate, own.len(), Fate::Stays);
        let reach = halo(options.smooth);
        let slices_near = planes.start.saturating_sub(reach)..(planes.end + reach).min(solid.cells[1]);
        let nearest = |room| {
            fit(
                sampled,
                &Task { surface: &surface, q: &q, planes: planes.clone(), halo: reach },
                jobs.piece_points,
                room,
            )
        };
        let mut fitted = match options.fit {
            Fit::None => Fitted::none(own.len(), room.fitted),
            Fit::Plane => {
                let mut fitted = Fitted::none(own.len(), room.fitted);
                let places = project(sampled, &surface, &q, planes.clone(), options.smooth)?;
                for ((fate, target), place) in fate.iter_mut().zip(&mut fitted.target).zip(places) {
                    if let Some(place) = place {
                        (*fate, *target) = (Fate::Projected, grid.position(place).map(T::from_f64));
                    }
                }
                fitted
            }
            Fit::Nearest => nearest(room.fitted)?,
        };
        let stride = sampled.buckets.stride();
        // Vertices that are moved elsewhere, or not at all, have the attributes of their nearest points all the same.
        let nearest = if options.fit == Fit::Nearest || stride == 0 { None } else { Some(nearest(Fitted::default())?) };
        if let Some(columns) = surface.columns() {
            for v in 0..own.len() {
                let (vertex, mut q) = (&surface.vertices[own.start as usize + v], q[own.start as usize + v]);
                if let Some(height) = columns.bridge(vertex.corner).filter(|_| matches!(vertex.kind, Kind::Sheet(_))) {
                    q[columns.up().axis] = height;
                    fitted.put(v, grid.position(q).map(T::from_f64));
                    fate[v] = Fate::Bridged;
                }
            }
        }
        drop(surface);
        end_stage();
        let smoothed = to_world(q);
        let attributes = match stride {
            0 => Vec::new(),
            _ => attributes(sampled, slices_near, nearest.as_ref().unwrap_or(&fitted), &smoothed, &triangles)?,
        };
        drop(nearest);
        let fans = Fans::new(&triangles, named as usize, own.len(), room.fans);
        let (spots, mut blocks, tangled) = (room.spots, room.blocks, 0);
        refill(&mut blocks, triangles.len().div_ceil(BLOCK), Extent::EMPTY);
        let mut mesh = SlabMesh {
            slices,
            smoothed,
            rest,
            fitted,
            attributes,
            fate,
            kept,
            triangles,
            fans,
            planes: starts,
            spots,
            blocks,
            tangled,
        };
        if options.fit == Fit::Nearest {
            mesh.contract_inside();
            mesh.choose_fitted();
        }
        end_stage();
        mesh.retreat_inside(frame, &mut Near::new(grid, frame.origin));
        end_stage();
        Ok(mesh)
    }

    /// Phase 1: contracts all vertices but those of the seam below (whose fans are not complete here); those of the seam above belong to
    /// the next slab.
    fn contract_inside(&mut self) {
        let mut group = self.fitted.point.clone();
        if self.slices.start > 0 {
            group[..self.seam() as usize].fill(NONE);
        }
        let SlabMesh { triangles, fans, fitted, smoothed, kept, fate, .. } = self;
        let distance = |v: u32| fitted.distance(v as usize, smoothed[v as usize]);
        let groups = Groups { group: &group, distance, kept };
        contract(triangles, fans, groups, |dead, _| fate[dead as usize] = Fate::Gone);
    }

    /// Of the vertices that have the same point, the nearest takes its place; the others are pulled.
    fn choose_fitted(&mut self) {
        // By point, then by number.
        let lives = |v: &u32| self.fate[*v as usize] != Fate::Gone && self.fitted.point[*v as usize] != NONE;
        let key = |v: u32| u64::from(self.fitted.point[v as usize]) << 32 | u64::from(v);
        let mut on_points: Vec<u64> = (0..self.own()).filter(lives).map(key).collect();
        on_points.sort_unstable();
        for same in on_points.chunk_by(|a, b| a >> 32 == b >> 32) {
            let mut nearest = same[0] as u32;
            for v in same.iter().map(|key| *key as u32) {
                self.fate[v as usize] = Fate::Pulled;
                if self.distance(v) < self.distance(nearest) {
                    nearest = v;
                }
            }
            self.fate[nearest as usize] = Fate::Fitted;
        }
    }

    /// Lets vertices retreat until no two triangles inside the slab intersect: those that touch neither the seam below nor the one above.
    fn retreat_inside(&mut self, frame: Frame, near: &mut Near) {
        let first = if self.slices.start > 0 { self.seam() } else { 0 };
        let scale = near.scale();
        let places: Vec<[T; 3]> = (0..self.own()).map(|v| frame.place(self.position(v)).map(T::from_f64)).collect();
        self.spots.clear();
        self.spots.reserve_exact(places.len());
        self.spots.extend(places.iter().map(|place| scale.spot(place.map(Into::into))));
        let mut inside = Inside { first, places, frame, scale, slab: self };
        let tangled = retreat(&mut inside, near, None);
        self.tangled = tangled;
    }

    /// The squared distance of vertex `v`, where smoothing put it, to its point.
    #[inline]
    pub fn distance(&self, v: u32) -> f64 {
        self.fitted.distance(v as usize, self.smoothed[v as usize])
    }

    /// The final position of vertex `v`, in file axes.
    pub fn position(&self, v: u32) -> [f64; 3] {
        let (smoothed, target) = (self.smoothed[v as usize], self.fitted.target[v as usize].map(Into::into));
        match self.fate[v as usize] {
            Fate::Fitted | Fate::Projected | Fate::Bridged => target,
            Fate::Pulled => std::array::from_fn(|a| smoothed[a] + 0.9 * (target[a] - smoothed[a])),
            Fate::Stays | Fate::Gone => smoothed,
            Fate::Rest => self.rest_of(v),
            Fate::Back(step) => {
                let (rest, share) = (self.rest_of(v), SHARES[usize::from(step)]);
                std::array::from_fn(|a| rest[a] + share * (target[a] - rest[a]))
            }
        }
    }

    fn rest_of(&self, v: u32) -> [f64; 3] {
        *self.rest.get(v as usize).unwrap_or(&self.smoothed[v as usize])
    }

    /// Whether a triangle is written, if it is left.
    #[inline]
    pub fn is_kept(&self, t: u32) -> bool {
        self.kept.get(t as usize).copied().unwrap_or(true)
    }

    /// The triangles that are written: left, and kept.
    pub fn triangles_written(&self) -> impl Iterator<Item = [u32; 3]> + '_ {
        let triangles = (0u32..).zip(&self.triangles);
        triangles.filter(|(t, triangle)| self.is_kept(*t) && !is_gone(**triangle)).map(|(_, triangle)| *triangle)
    }

    /// The triangles that are left.
    pub fn triangles_left(&self) -> impl Iterator<Item = [u32; 3]> + '_ {
        self.triangles.iter().copied().filter(|t| !is_gone(*t))
    }
}

/// A slab by itself: its vertices from `first` on are free to retreat.
struct Inside<'a, T> {
    slab: &'a mut SlabMesh<T>,
    first: u32,
    frame: Frame,
    scale: Scale,
    /// Of each vertex: where it is now, as it is going to be written.
    places: Vec<[T; 3]>,
}

impl<T: Coordinate> Places for Inside<'_, T> {
    fn stretches(&self) -> [Range<u32>; 2] {
        let end = self.slab.triangles.len().next_multiple_of(BLOCK) as u32;
        [0..self.slab.triangles.len() as u32, end..end]
    }

    #[inline]
    fn triangle(&self, t: u32) -> [u32; 3] {
        self.slab.triangles[t as usize]
    }

    #[inline]
    fn is_known(&self, triangle: [u32; 3]) -> bool {
        triangle.iter().all(|v| (self.first..self.slab.own()).contains(v))
    }

    #[inline]
    fn known(&self, t: u32) -> Option<[u32; 3]> {
        let triangle = *self.slab.triangles.get(t as usize)?;
        (!is_gone(triangle) && self.is_known(triangle)).then_some(triangle)
    }

    #[inline]
    fn spot(&self, v: u32) -> Spot {
        self.slab.spots[v as usize]
    }

    fn blocks(&mut self) -> &mut [Extent] {
        &mut self.slab.blocks
    }
}

impl<T: Coordinate> Piece for Inside<'_, T> {
    fn vertices(&self) -> u32 {
        self.slab.own()
    }

    #[inline]
    fn place(&self, v: u32) -> [f64; 3] {
        self.places[v as usize].map(Into::into)
    }

    fn corners(&self, v: u32) -> impl Iterator<Item = u32> {
        self.slab.fans.corners(v)
    }

    #[inline]
    fn also(&self, v: u32) -> u32 {
        self.slab.fans.also.get(v as usize).copied().unwrap_or(NONE)
    }

    fn is_whole(&self, v: u32) -> bool {
        (self.first..self.slab.own()).contains(&v)
    }

    fn is_settled(&self, _: u32) -> bool {
        false
    }

    #[inline]
    fn is_kept(&self, t: u32) -> bool {
        self.slab.is_kept(t)
    }

    fn fate(&self, v: u32) -> Fate {
        self.slab.fate[v as usize]
    }

    fn put(&mut self, v: u32, survivor: u32, also: u32, fate: Fate) {
        let SlabMesh { fans, triangles, .. } = &mut *self.slab;
        for corner in fans.corners(v) {
            triangles.as_flattened_mut()[corner as usize] = survivor;
        }
        fans.also[v as usize] = also;
        self.slab.fate[v as usize] = fate;
        let place = self.frame.place(self.slab.position(v));
        self.places[v as usize] = place.map(T::from_f64);
        self.slab.spots[v as usize] = self.scale.spot(place);
    }
}
