//! How far a mesh lies from a reference, and the reference from the mesh, for meshes and clouds of any size in bounded memory.
//!
//! ```text
//!  survey     the box of the reference; a sample of both sides' places
//!  points     mesh's centroids (of a cloud, vertices, too)  -> nearest point of the reference
//!  surface    mesh's centroids, vertices                    -> nearest place on the reference's triangles, first one along the normal
//!  back       reference's points, centroids                 -> nearest place on the mesh's triangles
//! ```
//!
//! Distances are exact, by brute force made fast: targets lie in blocks on disk, and queries go from block to block until none nearer can hold anything
//! ([`crate::nearest`]). All is computed in `f64`, in the input's own coordinates less
//! the lowest corner of the reference's box. Sums are exact, and so is the quantile (`figures`): neither threads nor memory nor the order of points and triangles show.
//!
//! What has a coordinate that is not finite, or beyond 1e75, is left out. A triangle without area has places, but no normal.

mod figures;
mod heatmap;
mod job;
mod report;
mod source;
#[cfg(test)]
mod tests;

use std::path::Path;

use bytemuck::Pod;

use self::figures::{Figures, Spread};
use self::heatmap::Heat;
use self::job::{AlongNormals, Found};
use self::report::is_inside_out;
use self::source::{LeftOut, Source, Survey, triangles};
use crate::error::words::short;
use crate::error::{Error, Result};
use crate::format;
use crate::input::{Cloud, Opening, STANDARD_INPUT, Unpacked, expand};
use crate::mesh::MeshSource;
use crate::mesh::check::{CheckReport, check};
use crate::nearest::blocks::Blocks;
use crate::nearest::room::Room;
use crate::nearest::search::{Facing, Nearest, search};
use crate::nearest::shape::{Point, Spot, Target, Triangle, is_usable};
use crate::resources::workers::Workers;
use crate::run::forecast::{self, Comparing};
use crate::run::phase::Phase;
use crate::run::progress::Progress;
use crate::storage::steady::Steady;

pub use self::heatmap::{HeatMap, Reach};
pub use self::job::{Job, Kind};
pub use self::report::{Comparison, Distances};

/// Compares. Memory: about the budget, but no less than some 8 MB for each worker, and 2 KB for every million triangles.
///
/// # Errors
/// Errors of reading either side; [`Error::Malformed`] if the mesh has no triangles, or either side no finite places; [`Error::NoPoints`];
/// [`Error::Usage`] if the reference is a single place; [`Error::Io`]; [`Error::Interrupted`].
pub fn compare(job: &Job, workers: &Workers, progress: &mut Progress) -> Result<Comparison> {
    let steady = Steady::of([&job.mesh, &job.reference]);
    steady.settle(compared(job, &steady, workers, progress))
}

fn compared(job: &Job, steady: &Steady, workers: &Workers, progress: &mut Progress) -> Result<Comparison> {
    let budget = job.resources.budget();
    let workspace = job.resources.workspace(&job.mesh)?.stopped_with(workers);
    let mesh = format::read::open(&job.mesh, &workspace, budget / 8)?;
    if mesh.face_count() == 0 {
        return Err(Error::malformed(&job.mesh, "the mesh", "triangles", "none"));
    }
    let as_mesh = match job.kind {
        Some(kind) => kind == Kind::Mesh,
        None => job.reference != Path::new(STANDARD_INPUT) && format::read::has_triangles(&job.reference)?,
    };
    let mut work = Comparing {
        triangles: [mesh.face_count(), 0],
        places: [mesh.vertex_count(), 0],
        surface: as_mesh,
        coloured: job.heatmap.is_some(),
        ..Comparing::default()
    };
    let reference = if as_mesh {
        Source::Mesh(format::read::open(&job.reference, &workspace, budget / 8)?)
    } else {
        // Whether the file is packed is known as soon as it is opened.
        let bytes = forecast::bytes(&job.reference);
        work.places[1] = forecast::points(bytes, bytes);
        progress.expect(Comparing { packed: bytes, ..work }.forecast());
        let mut watch = |unpacked: Unpacked| {
            work.packed = bytes;
            progress.unpacked(unpacked);
            workers.check_cancelled()
        };
        let opening =
            Opening { workspace: &workspace, memory: budget / 8, decompress: Some(workers), watch: &mut watch };
        let files = expand(std::slice::from_ref(&job.reference))?;
        Source::Cloud(Box::new(Cloud::open_in(&files, &job.input, opening)?))
    };
    match &reference {
        Source::Mesh(mesh) => (work.triangles[1], work.places[1]) = (mesh.face_count(), mesh.vertex_count()),
        Source::Cloud(cloud) => work.places[1] = forecast::records(cloud),
    }
    progress.expect(work.forecast());
    match &reference {
        Source::Mesh(mesh) => (work.triangles[1], work.places[1]) = (mesh.face_count(), mesh.vertex_count()),
        Source::Cloud(cloud) => work.places[1] = forecast::records(cloud),
    }
    progress.expect(work.forecast());

    let room = Room::new(budget / 4 * 3, workers, &workspace);
    // Before the work: it proves that the file can be written.
    let map = job.heatmap.as_ref().map(|map| in_reference_units(map, &reference)).transpose()?;
    let mut heat = map.map(|map| Heat::create(&map, &*mesh, &room)).transpose()?;

    progress.begin(Phase::Check, Some(work.triangles.iter().sum()));
    let checked = check(&*mesh, budget / 2, workers, &workspace, &mut |done| progress.set(done))?;
    let before = mesh.face_count();
    let reference_checked = match reference.mesh() {
        Some(mesh) => Some(check(mesh, budget / 2, workers, &workspace, &mut |done| progress.set(before + done))?),
        None => None,
    };

    let inside_out = |report: &CheckReport| is_inside_out(report.volume);
    let over = reference_checked.as_ref().is_some_and(inside_out) != inside_out(&checked);
    let sides = Sides { mesh: Source::Mesh(mesh), reference, over, room };
    let found = sides.run(job, work, heat.as_mut(), progress)?;
    let comparison = Comparison::new(job, &checked, reference_checked.as_ref(), &found);
    // Before anything gets a name.
    steady.settle(Ok(()))?;
    if let Some((heat, map)) = heat.zip(job.heatmap.as_ref()) {
        progress.begin(Phase::Write, None);
        let max = heat.write(sides.mesh(), &sides.room, &found.mesh_vertices, comparison.longest_side)?;
        if map.told {
            progress.note(&format!("{}: distances coloured from 0 to {}", map.path.display(), short(max)));
        }
    }
    progress.end();
    Ok(comparison)
}

/// A heat map whose largest distance is in the unit of the reference's coordinates.
fn in_reference_units(map: &HeatMap, reference: &Source) -> Result<HeatMap> {
    let max = match (map.max, map.unit, reference) {
        (Some(Reach::Length(length)), Some(unit), Source::Cloud(cloud)) => {
            Some(Reach::Length(cloud.length("heatmap_max", length, unit)?))
        }
        (Some(Reach::Length(length)), Some(unit), Source::Mesh(_)) => {
            return Err(Error::setting(
                "heatmap_max",
                format!(
                    "`heatmap_max` {length}{unit}: the unit of a mesh is not known; give a plain number, in its units"
                ),
            ));
        }
        (max, ..) => max,
    };
    Ok(HeatMap { max, unit: None, ..map.clone() })
}

/// Both sides, opened.
struct Sides<'a> {
    mesh: Source,
    reference: Source,
    /// Whether one of the two is inside out.
    over: bool,
    room: Room<'a>,
}

impl Sides<'_> {
    fn mesh(&self) -> &dyn MeshSource {
        self.mesh.mesh().expect("the first side is a mesh")
    }

    fn run(&self, job: &Job, mut work: Comparing, heat: Option<&mut Heat>, progress: &mut Progress) -> Result<Found> {
        progress.begin(Phase::Survey, None);
        let (expected, mut seen) = (work.places.iter().sum::<u64>().max(1) as f64, 0);
        let mut told = |done: u64| {
            seen += done;
            progress.add_weighed(done, seen as f64 / expected);
        };
        let reference = self.reference.survey(&self.room, &mut told)?;
        if reference.places == 0 {
            return Err(match &self.reference {
                Source::Mesh(_) => Error::malformed(&job.reference, "the mesh", "finite vertices", "none"),
                Source::Cloud(_) => {
                    let LeftOut { dropped, filtered } = reference.left_out;
                    Error::NoPoints { dropped, filtered }
                }
            });
        }
        if reference.bounds.extent() == [0.0; 3] {
            let path = job.reference.display();
            return Err(Error::Usage(format!("{path}: a reference of a single place has no size to measure by")));
        }
        let mesh = self.mesh.survey(&self.room, &mut told)?;

        work.places = [mesh.places, reference.places];
        progress.expect(work.forecast());
        progress.begin(Phase::Compare, Some(work.distances()));
        let pass = Pass { room: &self.room, corner: reference.bounds.min, told: Told { progress, waiting: 0 } };
        self.measure(job, reference, mesh, pass, heat)
    }

    fn measure(
        &self,
        job: &Job,
        reference: Survey,
        mesh: Survey,
        mut pass: Pass,
        heat: Option<&mut Heat>,
    ) -> Result<Found> {
        let no_triangles = |path: &Path| Error::malformed(path, "the mesh", "triangles with finite corners", "none");

        let mut points = pass.spots(&self.reference, &reference)?;
        let nearest_point = pass.centroids(&mut points, self.mesh())?.ok_or_else(|| no_triangles(&job.mesh))?;
        let (mesh_centroids, mesh_vertices, facing) = match self.reference.mesh() {
            None => {
                let vertices = pass.places(&mut points, &self.mesh, heat)?;
                drop(points);
                (nearest_point, vertices, None)
            }
            Some(surface) => {
                drop(points);
                let mut surface = pass.surface(surface, &reference)?;
                if surface.count() == 0 {
                    return Err(no_triangles(&job.reference));
                }
                let facing = pass.facing(&mut surface, self.mesh(), self.over)?;
                (facing.distances, pass.places(&mut surface, &self.mesh, heat)?, Some(facing))
            }
        };

        let mut surface = pass.surface(self.mesh(), &mesh)?;
        let reference_points = pass.places(&mut surface, &self.reference, None)?.expect("the survey found places");
        let reference_centroids = match self.reference.mesh() {
            Some(mesh) => pass.centroids(&mut surface, mesh)?,
            None => None,
        };
        let mesh_vertices = mesh_vertices.expect("triangles have corners");
        Ok(Found {
            reference,
            nearest_point,
            mesh_centroids,
            mesh_vertices,
            reference_points,
            reference_centroids,
            facing,
        })
    }
}

/// Passes over queries on their way.
struct Pass<'a, 'p> {
    room: &'a Room<'a>,
    corner: Point,
    told: Told<'a, 'p>,
}

/// Counts queries, and tells of many at a time.
struct Told<'a, 'p> {
    progress: &'a mut Progress<'p>,
    waiting: u64,
}

impl Told<'_, '_> {
    fn one(&mut self) {
        self.waiting += 1;
        if self.waiting == 1 << 12 {
            self.progress.add(self.waiting);
            self.waiting = 0;
        }
    }
}

impl Pass<'_, '_> {
    fn sample(&self, survey: &Survey) -> Vec<Point> {
        let from_corner = |p: &Point| std::array::from_fn(|a| p[a] - self.corner[a]);
        survey.sample.iter().map(from_corner).collect()
    }

    /// Blocks of a side's places.
    fn spots(&self, side: &Source, survey: &Survey) -> Result<Blocks<Spot>> {
        Blocks::new(self.room, self.sample(survey), survey.places, |put| {
            let spots = |_, places: &[Point], out: &mut Vec<Spot>| {
                out.extend(places.iter().filter(|p| is_usable(**p)).map(|p| Spot(*p)));
            };
            side.places(self.corner, self.room, spots, put).map(drop)
        })
    }

    /// Blocks of a mesh's triangles.
    fn surface(&self, mesh: &dyn MeshSource, survey: &Survey) -> Result<Blocks<Triangle>> {
        Blocks::new(self.room, self.sample(survey), mesh.face_count(), |put| {
            triangles(mesh, self.corner, self.room, |piece, out| out.extend_from_slice(piece), put)
        })
    }

    /// Distances of a side's places.
    fn places<T: Target + Pod>(
        &mut self,
        blocks: &mut Blocks<T>,
        side: &Source,
        mut heat: Option<&mut Heat>,
    ) -> Result<Option<Figures>> {
        let (room, corner) = (self.room, self.corner);
        let mut spread = Spread::new(room);
        let feed = |home: &(dyn Fn(Point) -> usize + Sync), put: &mut dyn FnMut(&[Nearest]) -> Result<()>| {
            let queries = |first: u64, places: &[Point], out: &mut Vec<Nearest>| {
                let usable = (first..).zip(places).filter(|(_, p)| is_usable(**p));
                out.extend(usable.map(|(number, p)| Nearest::new(number, *p, home(*p))));
            };
            side.places(corner, room, queries, put).map(drop)
        };
        search(blocks, room, feed, |query| {
            self.told.one();
            if let Some(heat) = &mut heat {
                heat.add(query.number, query.distance2)?;
            }
            spread.add_square(query.distance2)
        })?;
        spread.figures()
    }

    /// Distances of a mesh's centroids.
    fn centroids<T: Target + Pod>(&mut self, blocks: &mut Blocks<T>, mesh: &dyn MeshSource) -> Result<Option<Figures>> {
        let (room, corner) = (self.room, self.corner);
        let mut spread = Spread::new(room);
        let feed = |home: &(dyn Fn(Point) -> usize + Sync), put: &mut dyn FnMut(&[Nearest]) -> Result<()>| {
            let centroids = |piece: &[Triangle], out: &mut Vec<Nearest>| {
                let places = piece.iter().map(Triangle::centroid);
                out.extend(places.map(|p| Nearest::new(0, p, home(p))));
            };
            triangles(mesh, corner, room, centroids, put)
        };
        search(blocks, room, feed, |query| {
            self.told.one();
            spread.add_square(query.distance2)
        })?;
        spread.figures()
    }

    /// Distances and more of a mesh's centroids from a surface. The normals are turned `over` if one of the two is inside out.
    fn facing(&mut self, blocks: &mut Blocks<Triangle>, mesh: &dyn MeshSource, over: bool) -> Result<AlongNormals> {
        let (room, corner) = (self.room, self.corner);
        let [mut distances, mut along, mut turned] = [(); 3].map(|()| Spread::new(room));
        let mut missed = 0;
        let feed = |home: &(dyn Fn(Point) -> usize + Sync), put: &mut dyn FnMut(&[Facing]) -> Result<()>| {
            let queries = |piece: &[Triangle], out: &mut Vec<Facing>| {
                out.extend(piece.iter().map(|triangle| Facing::new(triangle, over, home(triangle.centroid()))));
            };
            triangles(mesh, corner, room, queries, put)
        };
        search(blocks, room, feed, |query| {
            self.told.one();
            distances.add_square(query.distance2)?;
            if query.turned.is_finite() {
                turned.add(query.turned)?;
            }
            if query.along.is_finite() {
                return along.add(query.along);
            }
            missed += 1;
            Ok(())
        })?;
        let distances = distances.figures()?.expect("a mesh that was measured before has triangles");
        Ok(AlongNormals { distances, along: along.figures()?, missed, turned: turned.figures()? })
    }
}
