//! What a comparison found: as JSON, and in words.

use std::fmt;
use std::path::PathBuf;

use super::figures::{Figures, Histogram};
use super::job::{Found, Job, Kind};
use crate::error::words::{short, thousands, told};
use crate::mesh::check::CheckReport;

/// The findings of [`super::compare`]. All per cents are of the reference's box.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Comparison {
    /// The mesh.
    pub mesh: MeshSide,
    /// What it was compared with.
    pub reference: ReferenceSide,
    /// The longest side of the reference's box, in units.
    pub longest_side: f64,
    /// The diagonal of the reference's box, in units.
    pub diagonal: f64,
    /// Mean squared errors at the centroids of the mesh's triangles.
    pub mse: Mse,
    /// The difference of the ratios of area and volume, in per cent of the reference's (Eq. 6); `None` if either side has no area or volume.
    pub avr: Option<f64>,
    /// From the mesh to the nearest place of the reference: of its triangles, or else of its points.
    pub mesh_to_reference: MeshToReference,
    /// From the reference to the nearest place on the mesh's triangles.
    pub reference_to_mesh: ReferenceToMesh,
    /// Between the normals of the mesh's triangles and of the reference's triangle nearest to their centroids; `None` for a cloud. A closed mesh that is inside
    /// out (its volume is negative) counts as if it were not.
    pub normal_deviation: Option<Angles>,
}

/// The mesh.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct MeshSide {
    /// The file.
    #[serde(serialize_with = "told")]
    pub path: PathBuf,
    /// Vertices.
    pub vertices: u64,
    /// Triangles.
    pub triangles: u64,
    /// Surface area.
    pub area: f64,
    /// Signed volume; `None` if the mesh is not closed.
    pub volume: Option<f64>,
    /// Whether every edge belongs to exactly two triangles.
    pub closed: bool,
}

/// The reference.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct ReferenceSide {
    /// The file.
    #[serde(serialize_with = "told")]
    pub path: PathBuf,
    /// What it was taken for.
    pub kind: Kind,
    /// Points, or vertices, that are finite.
    pub points: u64,
    /// Triangles.
    pub triangles: u64,
    /// As of [`MeshSide`], if it is a mesh.
    pub area: Option<f64>,
    /// As of [`MeshSide`], if it is a mesh.
    pub volume: Option<f64>,
    /// As of [`MeshSide`], if it is a mesh.
    pub closed: Option<bool>,
}

/// Mean squared errors (Eq. 5): 100 · mean(d²), d in per cent of the longest side of the reference's box.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Mse {
    /// d is the distance to the nearest point (or vertex) of the reference.
    pub nearest_point: f64,
    /// d is the distance to the nearest place on the reference's triangles; for a cloud the same as `nearest_point`.
    pub nearest: f64,
    /// d is the distance along the triangle's normal, either way, to the first triangle met; `None` for a cloud, or if none is met.
    pub along_normal: Option<f64>,
    /// Triangles left out of `along_normal`: nothing is met, or they have no normal.
    pub along_normal_missed: u64,
}

/// From the mesh to the reference.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct MeshToReference {
    /// From the centroids of its triangles.
    pub centroids: Distances,
    /// From its vertices.
    pub vertices: Distances,
}

/// From the reference to the mesh.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct ReferenceToMesh {
    /// From its points, or vertices.
    pub points: Distances,
    /// From the centroids of its triangles.
    pub centroids: Option<Distances>,
}

/// Some distances.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Distances {
    /// How many they are.
    pub count: u64,
    /// Their mean.
    pub mean: Length,
    /// The root of the mean of their squares.
    pub rms: Length,
    /// The least one that 95 % of them do not exceed.
    pub p95: Length,
    /// The largest.
    pub max: Length,
    /// How often they occur, in the files' units.
    #[serde(skip)]
    pub histogram: Histogram,
}

/// A distance, in three measures.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Length {
    /// In the files' units.
    pub units: f64,
    /// In per cent of the longest side of the reference's box.
    pub percent_of_longest: f64,
    /// In per cent of its diagonal.
    pub percent_of_diagonal: f64,
}

/// Some angles, in degrees.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Angles {
    /// Their mean.
    pub mean: f64,
    /// The root of the mean of their squares.
    pub rms: f64,
    /// The least one that 95 % of them do not exceed.
    pub p95: f64,
    /// The largest.
    pub max: f64,
}

impl Comparison {
    /// The findings in all their measures.
    pub(super) fn new(job: &Job, mesh: &CheckReport, surface: Option<&CheckReport>, found: &Found) -> Comparison {
        let extent = found.reference.bounds.extent();
        let longest_side = extent.into_iter().fold(0.0, f64::max);
        // Of sides by the longest: their squares may be beyond what numbers hold.
        let diagonal = longest_side * extent.iter().map(|side| (side / longest_side).powi(2)).sum::<f64>().sqrt();
        let length = |units: f64| Length {
            units,
            percent_of_longest: 100.0 * units / longest_side,
            percent_of_diagonal: 100.0 * units / diagonal,
        };
        let distances = |figures: &Figures| Distances {
            count: figures.count,
            mean: length(figures.mean),
            rms: length(figures.rms),
            p95: length(figures.p95),
            max: length(figures.max),
            histogram: figures.histogram,
        };
        let angles = |&Figures { mean, rms, p95, max, .. }: &Figures| Angles { mean, rms, p95, max };
        let mse = |figures: &Figures| 100.0 * length(figures.rms).percent_of_longest.powi(2);
        let facing = found.facing.as_ref();
        Comparison {
            mesh: MeshSide {
                path: job.mesh.clone(),
                vertices: mesh.vertices,
                triangles: mesh.triangles,
                area: mesh.area,
                volume: mesh.volume,
                closed: mesh.closed,
            },
            reference: ReferenceSide {
                path: job.reference.clone(),
                kind: if surface.is_some() { Kind::Mesh } else { Kind::Cloud },
                points: found.reference.places,
                triangles: surface.map_or(0, |surface| surface.triangles),
                area: surface.map(|surface| surface.area),
                volume: surface.and_then(|surface| surface.volume),
                closed: surface.map(|surface| surface.closed),
            },
            longest_side,
            diagonal,
            mse: Mse {
                nearest_point: mse(&found.nearest_point),
                nearest: mse(&found.mesh_centroids),
                along_normal: facing.and_then(|facing| facing.along.as_ref()).map(mse),
                along_normal_missed: facing.map_or(0, |facing| facing.missed),
            },
            avr: surface.and_then(|surface| avr([mesh.area, mesh.volume?], [surface.area, surface.volume?])),
            mesh_to_reference: MeshToReference {
                centroids: distances(&found.mesh_centroids),
                vertices: distances(&found.mesh_vertices),
            },
            reference_to_mesh: ReferenceToMesh {
                points: distances(&found.reference_points),
                centroids: found.reference_centroids.as_ref().map(distances),
            },
            normal_deviation: facing.and_then(|facing| facing.turned.as_ref()).map(angles),
        }
    }
}

/// Whether the normals of a mesh point inwards.
pub(super) fn is_inside_out(volume: Option<f64>) -> bool {
    volume.is_some_and(|volume| volume < 0.0)
}

/// Eq. 6, of areas and volumes. A mesh inside out has a negative volume, which is no error here.
fn avr([area, volume]: [f64; 2], [reference_area, reference_volume]: [f64; 2]) -> Option<f64> {
    let (ratio, expected) = (area / volume.abs(), reference_area / reference_volume.abs());
    let avr = 100.0 * ((ratio - expected) / expected).abs();
    avr.is_finite().then_some(avr)
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let closed = |closed: bool| if closed { "closed" } else { "not closed" };
        let measures = |area: f64, volume: Option<f64>| {
            let inside_out = if is_inside_out(volume) { " (inside out)" } else { "" };
            let volume = volume.map_or_else(String::new, |volume| format!(", volume {}{inside_out}", short(volume)));
            format!("area {}{volume}", short(area))
        };
        let MeshSide { path, vertices, triangles, area, volume, closed: is_closed } = &self.mesh;
        writeln!(f, "mesh       {}", path.display())?;
        writeln!(
            f,
            "           {} vertices, {} triangles; {}",
            thousands(*vertices),
            thousands(*triangles),
            closed(*is_closed)
        )?;
        writeln!(f, "           {}", measures(*area, *volume))?;
        let ReferenceSide { path, points, triangles, area, volume, closed: is_closed, .. } = &self.reference;
        writeln!(f, "reference  {}", path.display())?;
        match (area, is_closed) {
            (Some(area), Some(is_closed)) => {
                writeln!(
                    f,
                    "           taken as a mesh: {} vertices, {} triangles; {}",
                    thousands(*points),
                    thousands(*triangles),
                    closed(*is_closed)
                )?;
                writeln!(f, "           {}", measures(*area, *volume))?;
            }
            _ => writeln!(f, "           taken as a cloud: {} points", thousands(*points))?,
        }
        let (longest, diagonal) = (short(self.longest_side), short(self.diagonal));
        writeln!(f, "           longest side {longest}, diagonal {diagonal}; per cents are of the longest side\n")?;

        let on = if self.reference.kind == Kind::Mesh { "the reference's triangles" } else { "the reference's points" };
        let vertices = if self.reference.kind == Kind::Mesh { "vertices" } else { "points" };
        writeln!(
            f,
            "{:<36}{:>12}{:>14}{:>14}{:>14}{:>14}",
            "distance to the nearest place on", "count", "mean", "rms", "95 %", "max"
        )?;
        let mut row = |title: &str, from: &str, distances: &Distances| -> fmt::Result {
            if !title.is_empty() {
                writeln!(f, "{title}")?;
            }
            let of = |measure: fn(&Length) -> String| {
                let Distances { mean, rms, p95, max, .. } = distances;
                [mean, rms, p95, max].map(|length| format!("{:>14}", measure(length))).concat()
            };
            writeln!(
                f,
                "  {:<34}{:>12}{}",
                format!("from the {from}"),
                thousands(distances.count),
                of(|l| short(l.units))
            )?;
            writeln!(f, "{:>48}{}", "%", of(|l| short(l.percent_of_longest)))
        };
        row(&format!(" {on}"), "mesh's centroids", &self.mesh_to_reference.centroids)?;
        row("", "mesh's vertices", &self.mesh_to_reference.vertices)?;
        row(" the mesh's triangles", &format!("reference's {vertices}"), &self.reference_to_mesh.points)?;
        if let Some(centroids) = &self.reference_to_mesh.centroids {
            row("", "reference's centroids", centroids)?;
        }
        if let Some(Angles { mean, rms, p95, max }) = self.normal_deviation {
            let columns = [mean, rms, p95, max].map(|angle| format!("{:>14}", short(angle))).concat();
            writeln!(f, "{:<48}{columns}", "angle between normals, in degrees")?;
        }

        let Mse { nearest_point, nearest, along_normal, along_normal_missed } = &self.mse;
        writeln!(
            f,
            "\nMSE (Eq. 5), 100 times the mean of d squared, d in per cent of the longest side, from the mesh's centroids"
        )?;
        writeln!(f, "  {:<34}{:>12}", format!("to the nearest of the {vertices}"), short(*nearest_point))?;
        if self.reference.kind == Kind::Mesh {
            writeln!(f, "  {:<34}{:>12}", "to the nearest place", short(*nearest))?;
            let along = along_normal.map_or_else(|| "none".to_owned(), short);
            write!(f, "  {:<34}{along:>12}", "along the normals")?;
            match along_normal_missed {
                0 => writeln!(f)?,
                missed => writeln!(f, "  ({} meet nothing)", thousands(*missed))?,
            }
        }
        match self.avr {
            Some(avr) => write!(f, "AVR (Eq. 6), area by volume{:>21} %", short(avr)),
            None => write!(
                f,
                "AVR (Eq. 6): none, as it takes an area and a volume of both, and only closed meshes have a volume"
            ),
        }
    }
}
