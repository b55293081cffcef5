//! What `info` and `plan` find, as JSON, and in words for people. docs/info-and-plan.md has the keys.
//!
//! Lengths and areas are in the input's unit, which the reference system tells, if it is known.

use std::fmt;
use std::path::PathBuf;

use bytesize::ByteSize;

use crate::error::Result;
use crate::error::words;
use crate::error::words::{short, thousands};
use crate::input::Cloud;
use crate::input::tally::{Counts, Tally, class_name};
use crate::points::bounds::Bounds;
use crate::points::crs::Crs;
use crate::points::unit::Measure;
use crate::resources::memory::MemoryPlan;
use crate::run::advice;
use crate::run::finished::input_reports;
use crate::run::prepare::{Looked, Planned, contradiction};
use crate::run::progress::Warning;
use crate::run::report::{GridReport, InputReport};
use crate::run::surveyed::Surveyed;

/// The reference system of a cloud.
#[derive(Debug, Clone, serde::Serialize)]
pub struct SystemReport {
    /// What files say of it.
    #[serde(flatten)]
    pub crs: Crs,
    /// The unit of its horizontal coordinates, as far as it is known.
    pub unit: Option<String>,
    /// How many metres that is, if it is a length.
    pub metres_per_unit: Option<f64>,
    /// Why the coordinates cannot be in it, if they cannot.
    pub contradiction: Option<String>,
    /// The line about it, which names the files that do not tell theirs.
    #[serde(skip)]
    line: String,
}

impl SystemReport {
    fn of(cloud: &Cloud, surveyed: &Surveyed) -> Option<SystemReport> {
        let (crs, line) = (cloud.crs()?.clone(), cloud.crs_line()?);
        let contradiction = contradiction(cloud, surveyed);
        // What the coordinates cannot be in is not their unit.
        let measure = if contradiction.is_none() { crs.measure() } else { None };
        let (unit, metres_per_unit) = match measure {
            Some(Measure::Length(unit)) => (Some(unit.to_string()), Some(unit.in_metres())),
            Some(Measure::Mixed) => (Some("mixed".to_owned()), None),
            Some(Measure::Degrees) => (Some("degrees".to_owned()), None),
            None => (None, None),
        };
        Some(SystemReport { crs, unit, metres_per_unit, contradiction, line })
    }
}

/// What `info` finds.
#[derive(Debug, Clone, serde::Serialize)]
pub struct InfoReport {
    /// The program's version.
    pub version: &'static str,
    /// The files.
    pub inputs: Vec<InputReport>,
    /// Where each file's scans were taken from, as far as the file tells.
    pub scanned_from: Vec<Vec<[f64; 3]>>,
    /// The reference system, if any file tells one.
    pub reference_system: Option<SystemReport>,
    /// Points that count.
    pub points: u64,
    /// Records left out as not finite.
    pub points_not_finite: u64,
    /// Points left out by filters.
    pub points_filtered: u64,
    /// What points carry.
    pub attributes: Vec<String>,
    /// Their box.
    pub bounds: Bounds,
    /// Its sides.
    pub extent: [f64; 3],
    /// About how large an area they cover, seen along z.
    pub area: f64,
    /// Points to a square unit of that area.
    pub points_per_square_unit: Option<f64>,
    /// The side of the square that a point of that area has, on average.
    pub spacing: Option<f64>,
    /// Mean distance between neighbouring samples of the surface; null for a single place.
    pub sampling_distance: Option<f64>,
    /// Standard deviation of points from the surface; null if too few places tell.
    pub noise: Option<f64>,
    /// Points by class and return.
    #[serde(flatten)]
    pub tally: Tally,
    /// The grid that a run would lay.
    pub grid: GridReport,
    /// What may not be what was meant.
    pub warnings: Vec<Warning>,
    /// The attributes with their types.
    #[serde(skip)]
    schema: String,
}

impl InfoReport {
    /// The report of what was found by looking at points.
    pub fn of(looked: &Looked) -> InfoReport {
        let Looked { cloud, surveyed, tally } = looked;
        let survey = &surveyed.survey;
        let reference_system = SystemReport::of(cloud, surveyed);
        let area = surveyed.coarse_grid.area(survey.points);
        // Square degrees are no area.
        let is_area = reference_system.as_ref().and_then(|system| system.unit.as_deref()) != Some("degrees");
        let extent = survey.bounds.extent();
        let density = (is_area && extent[0] > 0.0 && extent[1] > 0.0).then(|| survey.points as f64 / area);
        InfoReport {
            version: env!("CARGO_PKG_VERSION"),
            inputs: input_reports(cloud),
            scanned_from: cloud.stations().collect(),
            reference_system,
            points: survey.points,
            points_not_finite: survey.dropped,
            points_filtered: survey.filtered,
            attributes: cloud.schema().attributes().iter().map(|a| a.name.clone()).collect(),
            bounds: survey.bounds,
            extent,
            area,
            points_per_square_unit: density,
            spacing: density.map(|_| surveyed.coarse_grid.spacing(survey.points)),
            sampling_distance: surveyed.density.and_then(|density| density.distance),
            noise: surveyed.density.and_then(|density| density.noise),
            tally: tally.clone(),
            grid: GridReport::of(&surveyed.grid),
            warnings: advice::of_survey(surveyed),
            schema: if cloud.schema().attributes().is_empty() { "none".to_owned() } else { cloud.schema().to_string() },
        }
    }
}

impl fmt::Display for InfoReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let triple = |values: [f64; 3], word: fn(f64) -> String| values.map(word).join("  ");
        let mut rows: Vec<(&str, String)> = Vec::new();
        for (input, stations) in self.inputs.iter().zip(&self.scanned_from) {
            rows.push(("file", format!("{}, {}", input.path.display(), ByteSize(input.bytes))));
            rows.push(("layout", input.layout.clone()));
            rows.extend(stations.iter().map(|place| ("scanned from", triple(*place, without_noise))));
        }
        let unit = self.reference_system.as_ref().and_then(|system| system.unit.as_deref());
        if let Some(system) = &self.reference_system {
            rows.push(("reference system", system.line.clone()));
            rows.extend(system.contradiction.iter().map(|words| ("contradiction", words.clone())));
            let metres = match system.metres_per_unit {
                Some(metres) if metres != 1.0 => format!(" of {metres} m"),
                _ => String::new(),
            };
            rows.push(("unit", unit.map_or_else(|| "not known".to_owned(), |unit| format!("{unit}{metres}"))));
        }
        let (length, square) = (unit.map_or_else(String::new, |unit| format!(" {unit}")), unit.unwrap_or("unit"));
        rows.extend([
            ("points", thousands(self.points)),
            ("dropped", format!("{} (not finite)", thousands(self.points_not_finite))),
            ("left out", format!("{} (by filters)", thousands(self.points_filtered))),
            ("attributes", self.schema.clone()),
            ("smallest", triple(self.bounds.min, without_noise)),
            ("largest", triple(self.bounds.max, without_noise)),
            ("extent", format!("{}{length}", triple(self.extent, short))),
        ]);
        if let (Some(density), Some(spacing)) = (self.points_per_square_unit, self.spacing) {
            let (density, spacing) = (short(three_digits(density)), short(three_digits(spacing)));
            rows.push((
                "density",
                format!("about {density} points/{square}² seen from above, one every {spacing}{length}"),
            ));
        }
        rows.push((
            "sampling distance",
            self.sampling_distance
                .map_or_else(|| "none: a single place".to_owned(), |distance| format!("{}{length}", short(distance))),
        ));
        rows.extend(self.noise.map(|noise| ("noise", format!("{}{length}", short(three_digits(noise))))));
        let counts = |counts: &Counts, word: &dyn Fn(u8) -> String| {
            counts.iter().map(|(value, points)| format!("{} {}", word(*value), thousands(*points))).collect::<Vec<_>>()
        };
        let class = |class: u8| match class_name(class) {
            Some(name) => format!("{class} ({name})"),
            None => class.to_string(),
        };
        let Tally { classification, return_number, number_of_returns } = &self.tally;
        let classes = counts(classification, &class);
        rows.extend(
            classes.into_iter().enumerate().map(|(i, line)| (if i == 0 { "points by class" } else { "" }, line)),
        );
        for (name, of) in [("points by return", return_number), ("by returns of pulse", number_of_returns)] {
            if !of.is_empty() {
                rows.push((name, counts(of, &|value| format!("{value}:")).join(", ")));
            }
        }
        rows.push(("grid", self.grid.to_string()));
        rows.extend(warnings(&self.warnings));
        table(&rows, f)
    }
}

/// What `plan` finds.
#[derive(Debug, Clone, serde::Serialize)]
pub struct PlanReport {
    /// The program's version.
    pub version: &'static str,
    /// The files.
    pub inputs: Vec<InputReport>,
    /// The reference system, if any file tells one.
    pub reference_system: Option<SystemReport>,
    /// Points that count.
    pub points: u64,
    /// The grid.
    pub grid: GridReport,
    /// Triangles to expect.
    pub triangles: u64,
    /// Tiles to expect, if the mesh is to be tiles.
    pub tiles: Option<u64>,
    /// Worker threads.
    pub threads: usize,
    /// The most memory.
    pub memory_bytes: u64,
    /// Memory granted.
    pub memory_granted_bytes: u64,
    /// The least memory that would do.
    pub memory_least_bytes: u64,
    /// The most temporary disk, with what is unpacked.
    pub temporary_disk_bytes: u64,
    /// Temporary disk free.
    pub temporary_disk_free_bytes: u64,
    /// What of the temporary disk is for unpacked input.
    pub unpacked_bytes: u64,
    /// The folder for temporary files.
    #[serde(serialize_with = "words::told")]
    pub temporary_folder: PathBuf,
    /// The folder where they would go by default, if nothing can be written there.
    #[serde(serialize_with = "words::told_if_any")]
    pub unwritable_folder: Option<PathBuf>,
    /// Whether points are kept in memory.
    pub points_in_memory: bool,
    /// Whether the mesh is.
    pub mesh_in_memory: bool,
    /// What may not be what was meant.
    pub warnings: Vec<Warning>,
    /// The rest of the plan.
    pub shares: MemoryPlan,
}

impl PlanReport {
    /// The report of a plan for so many threads.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the free space cannot be told.
    pub fn of(planned: &Planned, threads: usize) -> Result<PlanReport> {
        let Planned { cloud, surveyed, workspace, unwritable, tiles, memory } = planned;
        let workload = &surveyed.workload;
        let unpacked = cloud.unpacked();
        let unpacked_then = unpacked + cloud.unpacked_later();
        Ok(PlanReport {
            version: env!("CARGO_PKG_VERSION"),
            inputs: input_reports(cloud),
            reference_system: SystemReport::of(cloud, surveyed),
            points: workload.points,
            grid: GridReport::of(&surveyed.grid),
            triangles: workload.triangles(),
            tiles: *tiles,
            threads: memory.threads,
            memory_bytes: memory.predicted,
            memory_granted_bytes: memory.budget,
            memory_least_bytes: MemoryPlan::least(workload, threads),
            // What is unpacked lies there already.
            temporary_disk_bytes: memory.predicted_disk + unpacked_then,
            temporary_disk_free_bytes: workspace.available()? + unpacked,
            unpacked_bytes: unpacked_then,
            temporary_folder: workspace.dir().to_path_buf(),
            unwritable_folder: unwritable.clone(),
            points_in_memory: memory.buckets_quota >= workload.bucket_bytes(),
            mesh_in_memory: memory.mesh_quota >= workload.mesh_bytes(),
            warnings: advice::of_survey(surveyed),
            shares: memory.clone(),
        })
    }
}

impl fmt::Display for PlanReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let place = |in_memory: bool| if in_memory { "in memory" } else { "on disk" }.to_owned();
        let mut rows: Vec<(&str, String)> = Vec::new();
        if let Some(system) = &self.reference_system {
            rows.push(("reference system", system.line.clone()));
            rows.extend(system.unit.iter().map(|unit| ("unit", unit.clone())));
        }
        rows.extend([
            ("points", thousands(self.points)),
            ("grid", self.grid.to_string()),
            ("triangles", format!("about {}", thousands(self.triangles))),
        ]);
        rows.extend(self.tiles.map(|tiles| ("tiles", format!("about {}, and an index", thousands(tiles)))));
        rows.extend([
            ("threads", self.threads.to_string()),
            (
                "memory",
                format!("{} at most, of {} granted", ByteSize(self.memory_bytes), ByteSize(self.memory_granted_bytes)),
            ),
            ("least memory", ByteSize(self.memory_least_bytes.next_multiple_of(1 << 20)).to_string()),
            (
                "temporary disk",
                format!(
                    "{} at most, of {} free",
                    ByteSize(self.temporary_disk_bytes),
                    ByteSize(self.temporary_disk_free_bytes)
                ),
            ),
        ]);
        if self.unpacked_bytes > 0 {
            rows.push(("unpacked input", format!("{}, part of that", ByteSize(self.unpacked_bytes))));
        }
        rows.push(("temporary folder", self.temporary_folder.display().to_string()));
        if let Some(folder) = &self.unwritable_folder {
            let words = format!("nothing can be written to {}: a run needs --output and --temp-dir", folder.display());
            rows.push(("", words));
        }
        let MemoryPlan { bucket_buffer, blocks_in_flight, chunks_in_flight, points_held, .. } = self.shares;
        rows.extend([
            ("points kept", place(self.points_in_memory)),
            ("mesh kept", place(self.mesh_in_memory)),
            ("bucket buffers", format!("{} each", ByteSize(bucket_buffer))),
            ("in flight", format!("{blocks_in_flight} blocks, {chunks_in_flight} chunks of slices")),
            ("fitted at once", format!("{} points of a slab", thousands(points_held as u64))),
        ]);
        rows.extend(warnings(&self.warnings));
        table(&rows, f)
    }
}

/// A coordinate without the last digits of a product with a decimal scale: 43.3, not 43.300000000000004.
fn without_noise(value: f64) -> String {
    const PLACES: f64 = 1e9;
    // A whole number that is exact, and near enough to be the same but for noise.
    let rounded = (value * PLACES).round() / PLACES;
    let same = (value * PLACES).abs() < 2f64.powi(53) && (rounded - value).abs() <= 4.0 * f64::EPSILON * value.abs();
    if same { rounded } else { value }.to_string()
}

/// A value that is an estimate, to three digits.
fn three_digits(value: f64) -> f64 {
    if !(value.is_finite() && value > 0.0) {
        return value;
    }
    let step = 10f64.powi(libm::log10(value).floor() as i32 - 2);
    (value / step).round() * step
}

/// Rows of warnings, the advice below each.
fn warnings(of: &[Warning]) -> impl Iterator<Item = (&'static str, String)> + '_ {
    let rows = |warning: &Warning| [("warning", Some(warning.message.clone())), ("", warning.advice.clone())];
    of.iter().flat_map(rows).filter_map(|(name, words)| Some((name, words?)))
}

/// Rows of names and values.
fn table(rows: &[(&str, String)], f: &mut fmt::Formatter<'_>) -> fmt::Result {
    let width = rows.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
    let lines: Vec<String> = rows.iter().map(|(name, value)| format!("{name:<width$}  {value}")).collect();
    f.write_str(&lines.join("\n"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coordinates_and_estimates_have_the_digits_that_count() {
        for (value, text) in [
            (43.300000000000004, "43.3"),
            (-2.9037629999999996, "-2.903763"),
            (6_832_000.0, "6832000"),
            (1e-12, "0.000000000001"),
            (0.1 + 0.2, "0.3"),
            (f64::from(0.1f32), "0.10000000149011612"),
        ] {
            assert_eq!(without_noise(value), text);
        }
        for (value, rounded) in [(0.31249, 0.312), (921.6, 922.0), (14_400.0, 14_400.0), (0.0, 0.0)] {
            assert!((three_digits(value) - rounded).abs() < 1e-9, "{value}");
        }
    }
}
