//! The making of a slab: all stages from the solid to a mesh without intersections, before its seams are closed.

use crate::error::Result;
use crate::grid::occupancy::Sampled;
use crate::grid::partition::{Slabs, halo, slices_of, smooth_halo, sphere_halo};
use crate::mesh::spool::Frame;
use crate::points::Coordinate;
use crate::resources::allocator;
use crate::resources::memory::{Claim, SlabJobs};
use crate::resources::workers::refill;
use crate::settings::surface::{Diagonals, Fit, SurfaceOptions};
use crate::solid::Solid;
use crate::solid::membranes::Membranes;
use crate::stitch::inside::Inside;
use crate::stitch::numbers::InSlab;
use crate::stitch::size::{Size, Stages, Told};
use crate::stitch::slab::SlabMesh;
use crate::surface::attributes::{Lookup, attributes};
use crate::surface::contract::{Groups, NONE, Stars, contract, is_closed};
use crate::surface::creases;
use crate::surface::diagonals::{self, Places};
use crate::surface::extract::{Surface, Triangles};
use crate::surface::facets::{Centred, Facets};
use crate::surface::fit::{Fitted, Task, fit};
use crate::surface::flips::Flips;
use crate::surface::smooth::smooth;
use crate::surface::sphere::project;
use crate::surface::untangle::broad_phase::{BLOCK, BroadPhase};
use crate::surface::untangle::quantized::PackedBox;
use crate::surface::untangle::untangle;
use crate::surface::vertex_state::VertexState;
use crate::surface::vertices::Kind;

/// What slabs are made of, and how.
#[derive(Debug)]
pub struct Making<'a, T> {
    /// The solid cells.
    pub solid: &'a Solid,
    /// The membranes that close its holes, if there are any.
    pub membranes: Option<&'a Membranes>,
    /// The points and the cells that count.
    pub sampled: &'a Sampled<'a, T>,
    /// How the surface is made; what vertices are moved onto has been [chosen](Fit::chosen).
    pub options: SurfaceOptions,
    /// How positions are going to be written.
    pub frame: Frame,
    /// How many slabs exist at a time.
    pub jobs: SlabJobs,
    /// Who is told what each stage takes, if anybody is.
    pub told: Option<&'a Told>,
}

impl<T: Coordinate> SlabMesh<T> {
    /// Makes the mesh of slab `number` in the memory of `room`: of a slab that is done with.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn make(number: u32, making: &Making<'_, T>, room: SlabMesh<T>) -> Result<SlabMesh<T>> {
        let Making { solid, membranes, sampled, options, frame, jobs, told } = *making;
        let slices = slices_of(number, Slabs::of(&options), solid.cells[1]);
        let last = slices.end == solid.cells[1];
        let more = i64::from(smooth_halo(options.smooth));
        // To be moved amid the points of all their facets, vertices must know those of the planes next to the slab; and what creases they lie at, a few more.
        let is_centred = options.fit == Fit::Facets;
        // The other ways to cut faces are there to see what diagonals do.
        let chooses_diagonals = options.fit.has_points() && options.diagonals == Diagonals::Delaunay;
        // Open surfaces have none: each tree would be looked at, which takes longer than all else.
        let has_creases = is_centred && solid.ground.is_none();
        let beside = if has_creases { creases::PLANES_BESIDE } else { u32::from(is_centred) };
        // Where memory is for one slab at a time, the plan does not count what a stage has given back; where it is short, little of it.
        let end_stage = || {
            if jobs.gives_back {
                allocator::give_back();
            }
        };
        let mut claim = room.claim;
        let in_used_room = claim.bytes() > 0;
        let claim_of = |size: Size| told.map(|told| size.stages(&told.of, (told.points, told.means), in_used_room));
        let mut stages = told.and_then(|told| claim_of(told.sizes[number as usize]));
        if let Some((told, stages)) = told.zip(stages) {
            if !in_used_room {
                claim = Claim::of(&told.tally);
            }
            claim.set(stages.extracting);
        }
        let [below, above] = [beside, beside.saturating_sub(1)].map(|planes| more + i64::from(planes));
        let mut surface = Surface::find(solid, i64::from(slices.start) - below..=i64::from(slices.end) + above)?;
        let mut q = smooth(&surface, options.smooth, room.smoothed);
        let planes = slices.start..slices.end + u32::from(last);
        let own = surface.on_plane(planes.start).start..surface.on_plane(planes.end - 1).end;
        let near = planes.start.saturating_sub(beside)..(planes.end + beside).min(solid.cells[1] + 1);
        let of_near = surface.on_plane(near.start).start..surface.on_plane(near.end - 1).end;
        // The slab's vertices among those.
        let own_of_near = own.start - of_near.start..own.end - of_near.start;

        // The top plane of the last slab lies above its last slice and holds only faces perpendicular to y.
        let Triangles { corners: mut triangles, kept } =
            surface.triangles(planes.clone(), &q, options.diagonals, room.triangles);
        // Slices whose vertices are all near; where the grid ends there, those in its top plane, too.
        let highest = if near.end > solid.cells[1] { near.end } else { near.end - 1 };
        let [mut below, mut above] = [near.start..planes.start, planes.end..highest.max(planes.end)]
            .map(|planes| surface.triangles(planes, &q, options.diagonals, Vec::new()).corners);
        let mut size = Size::default();
        if let Some(told) = told {
            size = told.size(number, surface.vertices.len(), own.len(), triangles.len());
            stages = claim_of(size);
        }
        let mut begins = |stage: &dyn Fn(&Stages) -> u64| {
            if let Some(stages) = &stages {
                claim.set(stage(stages));
            }
        };
        begins(&|stages| stages.extracting);
        triangles.as_flattened_mut().iter_mut().for_each(|corner| *corner -= own.start);
        for beside in [&mut below, &mut above] {
            beside.as_flattened_mut().iter_mut().for_each(|corner| *corner -= of_near.start);
        }
        let named = triangles.as_flattened().iter().copied().max().map_or(0, |v| v + 1).max(own.len() as u32);
        let starts =
            planes.clone().map(|plane| surface.on_plane(plane).start - own.start).chain([own.len() as u32]).collect();
        let starts_near: Vec<u32> = near
            .clone()
            .map(|plane| surface.on_plane(plane).start)
            .chain([of_near.end])
            .map(|v| v - of_near.start)
            .collect();
        let grid = sampled.grid;
        let to_world = |mut q: Vec<[f64; 3]>| -> Vec<[f64; 3]> {
            if options.smooth > 1 {
                // New memory: a vector that shrinks to no less than half stays where it is, with all its pages.
                return q[own.start as usize..own.end as usize].iter().map(|q| grid.position(*q)).collect();
            }
            q.truncate(own.end as usize);
            q.drain(..own.start as usize);
            q.into_iter().map(|q| grid.position(q)).collect()
        };
        let is_rest = options.smooth == 1 && surface.columns().is_none();
        let rest = if is_rest { Vec::new() } else { to_world(smooth(&surface, 1, room.rest)) };
        // What is no longer needed, or not yet, goes before the next large thing comes: the slab's peak is what the plan counts.
        surface.drop_lookups();
        let after_fitting = (room.stars, room.quantized, room.blocks, room.flips);
        let (room_of_stars, quantized, mut blocks, _) = if is_centred {
            drop(after_fitting);
            Default::default()
        } else {
            after_fitting
        };
        end_stage();
        begins(&|stages| stages.fitting);
        let mut state = room.state;
        refill(&mut state, own.len(), VertexState::Unfitted);
        // Those who go where membranes lie, and where that is, in cells, by number among those near.
        let mut spanned: Vec<(u32, [f64; 3])> = Vec::new();
        let mut bridged = vec![false; if surface.columns().is_some() { of_near.len() } else { 0 }];
        if let Some(columns) = surface.columns() {
            let vertices = &surface.vertices[of_near.start as usize..of_near.end as usize];
            for (v, (vertex, q)) in vertices.iter().zip(&mut q[of_near.start as usize..]).enumerate() {
                if let Some(level) = columns.level(vertex.corner, *q).filter(|_| matches!(vertex.kind, Kind::Sheet(_)))
                {
                    q[columns.up().axis] = level.height;
                    bridged[v] = level.is_bridged;
                }
            }
        }
        let reach = halo(options.smooth);
        let slices_near = planes.start.saturating_sub(reach)..(planes.end + reach).min(solid.cells[1]);
        let nearest = |planes, room| {
            fit(sampled, &Task { surface: &surface, q: &q, planes, halo: reach }, jobs.points_held, room)
        };
        let mut fitted = match options.fit {
            Fit::None => Fitted::none(own.len(), room.fitted),
            Fit::Sphere => {
                let mut fitted = Fitted::none(own.len(), room.fitted);
                let halo = sphere_halo(options.smooth);
                let task = Task { surface: &surface, q: &q, planes: planes.clone(), halo };
                project(sampled, solid, &task, membranes.is_some(), |v, place| {
                    state[v] = VertexState::Projected;
                    fitted.target[v] = grid.position(place).map(T::from_f64);
                })?;
                fitted
            }
            Fit::Facets | Fit::Nearest | Fit::Auto | Fit::AutoPoints => nearest(near.clone(), room.fitted)?,
        };
        let stride = sampled.buckets.stride();
        // Vertices that are moved elsewhere, or not at all, have the attributes of their nearest points all the same.
        let nearest = match options.fit.has_points() || stride == 0 {
            true => None,
            false => Some(nearest(planes.clone(), Fitted::default())?),
        };
        if let Some(membranes) = membranes.filter(|_| options.fit != Fit::None) {
            // Of vertices beside the slab it only matters where they are.
            let planes = if options.fit.has_points() { near.clone() } else { planes.clone() };
            let mut round = membranes.round_planes(solid.cells);
            for plane in planes {
                let of_plane = surface.on_plane(plane);
                let is_free = |v: &u32| match options.fit.has_points() {
                    true => fitted.point[(v - of_near.start) as usize] == NONE,
                    false => state[(v - own.start) as usize] == VertexState::Unfitted,
                };
                let is_of_sheet = |v: &u32| matches!(surface.vertices[*v as usize].kind, Kind::Sheet(_));
                let mut free = of_plane.filter(|v| is_of_sheet(v) && is_free(v)).peekable();
                if free.peek().is_some() {
                    round.slide_to(plane)?;
                    let place = |v: u32| Some((v - of_near.start, round.place(q[v as usize])?));
                    spanned.extend(free.filter_map(place));
                }
            }
        }
        // The slab's vertices alone are fitted to planes.
        let first_fitted = if options.fit.has_points() { 0 } else { own_of_near.start };
        for &(v, place) in &spanned {
            fitted.put((v - first_fitted) as usize, grid.position(place).map(T::from_f64));
            if own_of_near.contains(&v) {
                state[(v - own_of_near.start) as usize] = VertexState::Bridged;
            }
        }
        for v in (0..bridged.len()).filter(|v| bridged[*v]) {
            fitted.put(v, grid.position(q[of_near.start as usize + v]).map(T::from_f64));
            if own_of_near.contains(&(v as u32)) {
                state[v - own_of_near.start as usize] = VertexState::Bridged;
            }
        }
        let mut centred = room.centred;
        centred.clear();
        let mut creased = room.creased;
        creased.clear();
        if is_centred || chooses_diagonals {
            let place = |(v, point): (usize, &u32)| match *point {
                NONE => q[of_near.start as usize + v],
                _ => grid.place_in_cells(fitted.target[v].map(Into::into)),
            };
            let vertices = &surface.vertices[of_near.start as usize..of_near.end as usize];
            let mut places: Vec<[f64; 3]> = fitted.point.iter().enumerate().map(place).collect();
            spanned.iter().for_each(|(v, place)| places[*v as usize] = *place);
            drop(spanned);
            if chooses_diagonals {
                let at = |first| Places { vertices, places: &places, first };
                diagonals::choose(&mut below, at(0));
                diagonals::choose(&mut triangles, at(own_of_near.start));
                diagonals::choose(&mut above, at(0));
            }
            if is_centred {
                let mut facets = Facets {
                    vertices,
                    planes: near,
                    starts: starts_near,
                    places,
                    smoothed: &q[of_near.start as usize..of_near.end as usize],
                    points: &fitted.point,
                    below: &below,
                    triangles: &triangles,
                    above: &above,
                    own: own_of_near.clone(),
                    own_planes: planes.clone(),
                };
                let stars = facets.stars();
                let own = own_of_near.start as usize..own_of_near.end as usize;
                centred.extend(fitted.target[own].iter().map(|target| [*target; 2]));
                let creases = match has_creases {
                    true => facets.creases(&stars, |v, place| {
                        state[v] = VertexState::Creased(0);
                        creased.push((v as u32, grid.position(place).map(T::from_f64)));
                    }),
                    false => Vec::new(),
                };
                facets.centre(&stars, &creases, sampled, solid, |v, Centred { onto, beside }| {
                    centred[v] = [onto, beside].map(|place| grid.position(place).map(T::from_f64));
                })?;
            }
            fitted.keep(own_of_near);
        }
        drop(surface);
        end_stage();
        begins(&|stages| stages.carrying);
        let smoothed = to_world(q);
        let attributes = match stride {
            0 => Vec::new(),
            _ => {
                let fitted = nearest.as_ref().unwrap_or(&fitted);
                let lookup = Lookup::of(fitted, &triangles);
                begins(&|stages| stages.carrying + lookup.bytes(own.len() as u64, stride as u64));
                attributes(sampled, slices_near, fitted, &smoothed, &triangles, lookup)?
            }
        };
        drop(nearest);
        begins(&|stages| stages.contracting);
        let stars = Stars::new(&triangles, named as usize, own.len(), room_of_stars);
        let tangled = 0;
        refill(&mut blocks, triangles.len().div_ceil(BLOCK), PackedBox::EMPTY);
        let mut mesh = SlabMesh {
            slices,
            smoothed,
            rest,
            fitted,
            centred,
            creased,
            attributes,
            state,
            kept,
            triangles,
            stars,
            planes: starts,
            quantized,
            blocks,
            flips: Flips::default(),
            tangled,
            size,
            claim: Claim::default(),
        };
        if options.fit.has_points() {
            mesh.contract_inside();
            mesh.choose_fitted();
        }
        end_stage();
        begins(&|stages| stages.retreating);
        // Flips are held until a slab is written; with vertices on points it holds as little as can be.
        let flips = options.fit.has_flips() && options.diagonals == Diagonals::Delaunay;
        mesh.untangle_inside(frame, &mut BroadPhase::new(grid, frame.origin), flips);
        end_stage();
        begins(&|stages| stages.made);
        mesh.claim = claim;
        Ok(mesh)
    }

    /// Phase 1: contracts all vertices but those of the seam below (whose stars are not complete here); those of the seam above belong to
    /// the next slab.
    fn contract_inside(&mut self) {
        let mut group = self.fitted.point.clone();
        if self.slices.start > 0 {
            group[..self.seam() as usize].fill(NONE);
        }
        let SlabMesh { triangles, stars, fitted, smoothed, kept, state, .. } = self;
        let distance = |v: u32| fitted.distance(v as usize, smoothed[v as usize]);
        debug_assert!((0..).zip(&group).all(|(v, group)| *group == NONE || is_closed(triangles, stars, v)));
        let groups = Groups { group: &group, distance, kept };
        contract(triangles, stars, groups, |dead, _| state[dead as usize] = VertexState::Contracted);
    }

    /// The nearest of the vertices that have the same point takes its place; the others are attracted.
    fn choose_fitted(&mut self) {
        // By point, then by number.
        let lives =
            |v: &u32| self.state[*v as usize] != VertexState::Contracted && self.fitted.point[*v as usize] != NONE;
        let key = |v: u32| u64::from(self.fitted.point[v as usize]) << 32 | u64::from(v);
        let mut on_points: Vec<u64> = Vec::with_capacity(self.own() as usize);
        on_points.extend((0..self.own()).filter(lives).map(key));
        on_points.sort_unstable();
        for same in on_points.chunk_by(|a, b| a >> 32 == b >> 32) {
            let mut nearest = InSlab(same[0] as u32);
            for v in same.iter().map(|key| InSlab(*key as u32)) {
                if self.distance(v) < self.distance(nearest) {
                    nearest = v;
                }
            }
            for v in same.iter().map(|key| InSlab(*key as u32)) {
                self.state[v.at()] = match self.state[v.at()] {
                    _ if v != nearest => VertexState::Attracted,
                    VertexState::Creased(_) => VertexState::Creased(0),
                    _ => VertexState::Fitted,
                };
            }
        }
    }

    /// Lets vertices retreat until no two triangles inside the slab intersect: those that touch neither the seam below nor the one above. Flips their edges before, if asked to.
    fn untangle_inside(&mut self, frame: Frame, near: &mut BroadPhase, flips: bool) {
        let mut inside = Inside::of(self, frame, near.quantizer());
        if flips {
            inside.flip_edges();
        }
        let tangled = untangle(&mut inside, near, None).tangled;
        self.tangled = tangled;
    }
}
