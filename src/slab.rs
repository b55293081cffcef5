//! A slab: its fixed share of the slices, and the mesh made of it alone, before its seams are closed.

use std::ops::Range;

use rustc_hash::FxHashMap;

use crate::error::Result;
use crate::partition::{halo, slices_of, smooth_halo};
use crate::points::Coordinate;
use crate::stage::contract::{Fans, GONE, Groups, NONE, contract};
use crate::stage::extract::{Diagonals, Surface};
use crate::stage::fit::{Fitted, Task, fit};
use crate::stage::plane::project;
use crate::stage::raster::Sampled;
use crate::stage::smooth::smooth;
use crate::stage::solid::Solid;

/// What is done to the surface of every slab.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct SurfaceOptions {
    /// Steps of smoothing: the first is Eq. 4, each further one smooths without shrinking.
    pub smooth: u32,
    /// Which diagonal cuts a rectangle.
    pub diagonals: Diagonals,
    /// What vertices are moved onto.
    pub fit: Fit,
}

/// What vertices are moved onto.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Fit {
    /// Their nearest input points.
    #[default]
    Nearest,
    /// The planes of the points round them: for noisy points.
    Plane,
    /// Nothing: the smoothed surface stays.
    None,
}

/// The mesh of one slab.
///
/// Triangles name vertices by number: `0..own()` are the slab's, `own() + n` is vertex n of the next slab, and from
/// [`BEFORE`] on, `BEFORE + n` is vertex n of the slab before (only where the seam below was closed over it).
#[derive(Debug)]
pub struct SlabMesh {
    /// The slab's slices.
    pub slices: Range<u32>,
    /// Of each vertex: its smoothed position, in file axes.
    pub smoothed: Vec<[f64; 3]>,
    /// Of each vertex: its point.
    pub fitted: Fitted,
    /// Of each vertex: what became of it.
    pub fate: Vec<Fate>,
    /// Triangles, in order; [`GONE`] where contraction took one away.
    pub triangles: Vec<[u32; 3]>,
    /// The triangles at each of the slab's vertices and of the next slab's that it names.
    pub fans: Fans,
    /// The slab's vertices on its lowest plane: `0..seam`.
    pub seam: u32,
}

/// Where [`SlabMesh`]'s numbers of the slab before begin.
pub const BEFORE: u32 = 1 << 31;

/// What becomes of a vertex.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fate {
    /// It stays where smoothing put it.
    Stays,
    /// It takes its point's place.
    Fitted,
    /// It moves into the plane of the points round it.
    Projected,
    /// Another vertex took the point's place; it goes most of the way.
    Pulled,
    /// It was contracted into another.
    Gone,
}

impl SlabMesh {
    /// Number of the slab's own vertices, contracted ones included.
    pub fn own(&self) -> u32 {
        self.fate.len() as u32
    }

    /// Makes the mesh of slab `number`.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn make<T: Coordinate>(
        number: u32,
        solid: &Solid,
        sampled: &Sampled<'_, T>,
        options: SurfaceOptions,
        piece: usize,
    ) -> Result<SlabMesh> {
        let slices = slices_of(number, options.smooth, solid.cells[1]);
        let last = slices.end == solid.cells[1];
        let more = i64::from(smooth_halo(options.smooth));
        let mut surface = Surface::find(solid, i64::from(slices.start) - more..=i64::from(slices.end) + more)?;
        let mut q = smooth(&surface, options.smooth);
        let planes = slices.start..slices.end + u32::from(last);
        let own = surface.on_plane(planes.start).start..surface.on_plane(planes.end - 1).end;

        // The top plane of the last slab lies above its last slice and holds only faces perpendicular to y.
        let mut triangles = surface.triangles(planes.clone(), &q, options.diagonals);
        for corner in triangles.as_flattened_mut() {
            *corner -= own.start;
        }
        let named = triangles.as_flattened().iter().copied().max().map_or(0, |v| v + 1).max(own.len() as u32);
        let seam = surface.on_plane(slices.start).len() as u32;
        // What is no longer needed goes before the next large thing comes: the slab's peak is what the plan counts.
        surface.drop_lookups();
        let grid = sampled.grid;
        let mut fate = vec![Fate::Stays; own.len()];
        let fitted = match options.fit {
            Fit::None => Fitted::none(own.len()),
            Fit::Plane => {
                let mut fitted = Fitted::none(own.len());
                let places = project(sampled, &surface, &q, planes.clone(), options.smooth, piece)?;
                for ((fate, target), place) in fate.iter_mut().zip(&mut fitted.target).zip(places) {
                    if let Some(place) = place {
                        (*fate, *target) = (Fate::Projected, grid.position(place));
                    }
                }
                fitted
            }
            Fit::Nearest => {
                let task = Task { surface: &surface, q: &q, planes: planes.clone(), halo: halo(options.smooth) };
                fit(sampled, &task, piece)?
            }
        };
        drop(surface);
        q.truncate(own.end as usize);
        q.drain(..own.start as usize);
        let smoothed = q.into_iter().map(|q| grid.position(q)).collect();
        let fans = Fans::new(&triangles, named as usize);
        let mut mesh = SlabMesh { slices, smoothed, fitted, fate, triangles, fans, seam };
        if options.fit == Fit::Nearest {
            mesh.contract_inside();
            mesh.choose_fitted();
        }
        Ok(mesh)
    }

    /// Phase 1: contracts all vertices but those of the seam below (whose fans are not complete here); those of the seam above belong to
    /// the next slab.
    fn contract_inside(&mut self) {
        let mut group = self.fitted.point.clone();
        if self.slices.start > 0 {
            group[..self.seam as usize].fill(NONE);
        }
        let groups = Groups { group: &group, distance: &self.fitted.distance };
        let fate = &mut self.fate;
        contract(&mut self.triangles, &mut self.fans, groups, |dead, _| fate[dead as usize] = Fate::Gone);
    }

    /// Of the vertices that have the same point, the nearest takes its place; the others are pulled.
    fn choose_fitted(&mut self) {
        let mut nearest: FxHashMap<u32, u32> = FxHashMap::default();
        for v in 0..self.own() {
            let point = self.fitted.point[v as usize];
            if self.fate[v as usize] == Fate::Gone || point == NONE {
                continue;
            }
            self.fate[v as usize] = Fate::Pulled;
            let best = nearest.entry(point).or_insert(v);
            if self.fitted.distance[v as usize] < self.fitted.distance[*best as usize] {
                *best = v;
            }
        }
        for v in nearest.into_values() {
            self.fate[v as usize] = Fate::Fitted;
        }
    }

    /// The final position of vertex `v`, in file axes.
    pub fn position(&self, v: u32) -> [f64; 3] {
        let (smoothed, target) = (self.smoothed[v as usize], self.fitted.target[v as usize]);
        match self.fate[v as usize] {
            Fate::Fitted | Fate::Projected => target,
            Fate::Pulled => std::array::from_fn(|a| smoothed[a] + 0.9 * (target[a] - smoothed[a])),
            Fate::Stays | Fate::Gone => smoothed,
        }
    }

    /// The triangles that are left.
    pub fn triangles_left(&self) -> impl Iterator<Item = [u32; 3]> + '_ {
        self.triangles.iter().copied().filter(|t| *t != GONE)
    }
}
