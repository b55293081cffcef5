//! Finding the record layout of a bare binary file from its numbers.
//!
//! Divisibility of the size decides little: one 16-byte-record file in three is also divisible by 12. What decides is
//! that the number one record further on is of the same kind. For k columns, with v the numbers of the file in order,
//!
//! ```text
//!  D(k) = mean (v[i+k] − v[i])² / (2 · variance of v)
//! ```
//!
//! is 1 for a wrong k of unordered centred points, near 0 for scans and meshes in their usual order, and the
//! within-column variance ratio for points in random order. (The within-column variance alone, without the
//! order, cannot tell a centred scan's columns apart: on real clouds moved to their centroid it is 1.000 for every
//! k.) The smallest k within `MARGIN` of the best is taken, if no k but its own multiples comes within `MARGIN` of it.
//!
//! Where the numbers do not decide, their distances from the mean are asked in the same way: they tell the columns of
//! unordered centred points apart if these differ in extent. What has neither order, place nor extent, such as a sphere
//! round the origin in random order, remains ambiguous.
//!
//! `f32` is tried before `f64`: the lower halves of `f64`s make absurd `f32`s, whereas `f32`s between 0.5 and 8 pair
//! up into harmless `f64`s.

use super::layout::Layout;
use crate::error::{Candidate, Candidates, Error, Result};
use crate::points::scalar::{Endian, Scalar, reader};
use crate::storage::mapped::Mapped;

/// Numbers per record that are considered: from bare coordinates to coordinates, normals, intensity and time.
const COLUMNS: std::ops::RangeInclusive<usize> = 3..=8;

/// The least common multiple of [`COLUMNS`]: windows of whole multiples keep every column in its place.
const COLUMN_PERIOD: u64 = 840;

/// Numbers in a window of the sample.
const WINDOW: u64 = 20 * COLUMN_PERIOD;

/// Windows, spread evenly: about a million numbers. Sweeps of rotating scanners, centred on the sensor, have margins of
/// 0.03 to 0.04 only, and need that many.
const WINDOWS: u64 = 64;

/// The advantage in D that decides. Of 164 files made from real scans and meshes all were told rightly with it, the
/// thinnest by 0.028; of 90 synthetic ones, most in random order, 74 rightly, and the isotropic 16 were refused.
const MARGIN: f64 = 0.02;

/// The part of the numbers that must be of sane size for a type to be considered.
const SANE_PART: f64 = 0.99;

/// Points shown of each candidate.
const PREVIEW: u64 = 3;

/// The layout of the records from byte `start` of `file` on.
///
/// # Errors
/// [`Error::AmbiguousLayout`] if several fit and the numbers do not decide, [`Error::Malformed`] if none fits.
pub fn detect(file: &Mapped, start: u64, endian: Endian) -> Result<Layout> {
    let content = file.len() - start;
    let mut sizes = Vec::new();
    for scalar in [Scalar::F32, Scalar::F64] {
        let number = scalar.bytes() as u64;
        let fitting: Vec<usize> =
            COLUMNS.filter(|&k| content > 0 && content.is_multiple_of(k as u64 * number)).collect();
        sizes.extend(fitting.iter().map(|k| k * scalar.bytes()));
        if fitting.is_empty() {
            continue;
        }
        let sample = Sample::take(file, start, scalar, endian)?;
        if !sample.is_sane(scalar, endian) {
            continue;
        }
        let found = decide(&sample, &fitting).or_else(|| decide(&sample.deviations(), &fitting));
        return match found {
            Some(columns) => Ok(layout(columns, scalar)),
            None => Err(ambiguous(file, start, scalar, endian, &fitting)?),
        };
    }
    let expected =
        "records of 3 to 8 floating-point numbers, or `layout` (and `skip_bytes`, `endian`) to say what it holds";
    let found = match sizes.as_slice() {
        [] => format!("{content} bytes, no multiple of such a record"),
        _ => "numbers of absurd size".to_string(),
    };
    Err(Error::malformed(file.path(), "content", expected, found))
}

fn layout(columns: usize, scalar: Scalar) -> Layout {
    let kind = if scalar == Scalar::F64 { ":f64" } else { "" };
    let text = match columns {
        3 => format!("xyz{kind}"),
        4 => format!("xyzi{kind}"),
        5 => format!("xyzir{kind}"),
        // What the others are is anyone's guess: normals, colours, time.
        _ => format!("xyz{kind},_:{}", (columns - 3) * scalar.bytes()),
    };
    text.parse().expect("a layout of our own making")
}

/// Windows of a file's numbers; the index of a window's first number is a multiple of [`COLUMN_PERIOD`].
struct Sample {
    windows: Vec<Vec<f64>>,
}

impl Sample {
    fn take(file: &Mapped, start: u64, scalar: Scalar, endian: Endian) -> Result<Sample> {
        let number = scalar.bytes() as u64;
        let numbers = (file.len() - start) / number;
        let read = reader(scalar, endian);
        let mut windows = Vec::new();
        let whole = numbers <= WINDOWS * WINDOW;
        for window in 0..WINDOWS {
            let first = if whole { window * WINDOW } else { (numbers - WINDOW) / (WINDOWS - 1) * window };
            let first = first / COLUMN_PERIOD * COLUMN_PERIOD;
            let last = numbers.min(first + WINDOW);
            if first >= last {
                break;
            }
            let bytes = file.read(start + first * number..start + last * number)?;
            windows.push(bytes.chunks_exact(scalar.bytes()).map(read).collect());
        }
        Ok(Sample { windows })
    }

    fn numbers(&self) -> impl Iterator<Item = f64> {
        self.windows.iter().flatten().copied()
    }

    /// Whether the numbers look like numbers of their type rather than other bytes.
    fn is_sane(&self, scalar: Scalar, endian: Endian) -> bool {
        // Organised scans mark missing points by NaN: no evidence for or against, as long as something else is there.
        let known = self.numbers().filter(|v| !v.is_nan()).count();
        let sane = self.numbers().filter(|v| *v == 0.0 || (1e-20..1e9).contains(&v.abs())).count();
        if known == 0 || known * 20 < self.numbers().count() || (sane as f64) < SANE_PART * known as f64 {
            return false;
        }
        // `f64`s with few digits have lower halves of zero, which are sane as `f32`s.
        let lower = usize::from(endian == Endian::Big);
        let halves = || self.windows.iter().flat_map(|w| w.iter().skip(lower).step_by(2));
        let zeros = halves().filter(|v| **v == 0.0).count();
        scalar == Scalar::F64 || (zeros as f64) < SANE_PART * halves().count() as f64
    }

    /// D(k) as the introduction defines it, given the numbers' `variance`; NaN if all are equal.
    fn difference(&self, columns: usize, variance: f64) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for window in &self.windows {
            for (a, b) in window.iter().zip(&window[columns.min(window.len())..]) {
                let square = (b - a) * (b - a);
                if square.is_finite() {
                    sum += square;
                    count += 1.0;
                }
            }
        }
        sum / count / (2.0 * variance)
    }

    /// The distances of the numbers from their mean.
    fn deviations(&self) -> Sample {
        let (mean, _) = self.moments();
        let windows = self.windows.iter().map(|w| w.iter().map(|v| (v - mean).abs()).collect());
        Sample { windows: windows.collect() }
    }

    /// Mean and variance of the finite numbers.
    fn moments(&self) -> (f64, f64) {
        let finite = || self.numbers().filter(|v| v.is_finite());
        let count = finite().count() as f64;
        let mean = finite().sum::<f64>() / count;
        (mean, finite().map(|v| (v - mean) * (v - mean)).sum::<f64>() / count)
    }
}

/// The number of columns, if the numbers decide it.
fn decide(sample: &Sample, fitting: &[usize]) -> Option<usize> {
    if let [only] = fitting {
        return Some(*only);
    }
    // Few numbers decide little: D of n unordered numbers varies by about 1/√n.
    let margin = MARGIN.max(4.0 / (sample.numbers().count() as f64).sqrt());
    let (_, variance) = sample.moments();
    let differences: Vec<(usize, f64)> = fitting.iter().map(|&k| (k, sample.difference(k, variance))).collect();
    let best = differences.iter().map(|(_, d)| *d).fold(f64::INFINITY, f64::min);
    let &(columns, difference) = differences.iter().find(|(_, d)| *d <= best + margin)?;
    let rival = differences.iter().filter(|(k, _)| k % columns != 0).map(|(_, d)| *d).fold(f64::INFINITY, f64::min);
    (rival - difference >= margin).then_some(columns)
}

fn ambiguous(file: &Mapped, start: u64, scalar: Scalar, endian: Endian, fitting: &[usize]) -> Result<Error> {
    let read = reader(scalar, endian);
    let mut candidates = Vec::new();
    for &columns in fitting {
        let layout = layout(columns, scalar);
        let stride = layout.stride() as u64;
        let records = PREVIEW.min((file.len() - start) / stride);
        let bytes = file.read(start..start + records * stride)?;
        let offsets = layout.coordinates().map(|column| column.offset);
        let preview = bytes.chunks_exact(layout.stride()).map(|r| offsets.map(|offset| read(&r[offset..]))).collect();
        candidates.push(Candidate { layout: layout.to_string(), preview });
    }
    Ok(Error::AmbiguousLayout { path: file.path().to_path_buf(), candidates: Candidates(candidates) })
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// A multiple of 840 records fits every number of columns, in every type.
    const RECORDS: usize = 840 * 20;

    fn found(bytes: &[u8]) -> Result<String> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.bin");
        std::fs::write(&path, bytes).unwrap();
        let file = crate::storage::mapped::Content::named(&path).unmapped()?;
        detect(&file, 0, Endian::Little).map(|layout| layout.to_string())
    }

    fn single(records: &[Vec<f64>]) -> Vec<u8> {
        records.iter().flatten().flat_map(|v| (*v as f32).to_le_bytes()).collect()
    }

    fn double(records: &[Vec<f64>]) -> Vec<u8> {
        records.iter().flatten().flat_map(|v| v.to_le_bytes()).collect()
    }

    /// Synthetic clouds: a terrain in strips, a sweep round the sensor, a sphere in rings.
    fn clouds() -> Vec<(&'static str, Vec<[f64; 3]>)> {
        let at = |i: usize| i as f64 / RECORDS as f64;
        let terrain = (0..RECORDS).map(|i| {
            let (x, y) = ((i % 130) as f64 * 0.5, (i / 130) as f64 * 0.5);
            [x, y, 3.0 * (x * 0.1).sin() + 2.0 * (y * 0.07).cos()]
        });
        let sweep = (0..RECORDS).map(|i| {
            let (angle, range) = (at(i) * 700.0, 10.0 + 5.0 * (at(i) * 40.0).sin());
            [range * angle.cos(), range * angle.sin(), (i % 16) as f64 * 0.2 - 1.6]
        });
        let sphere = (0..RECORDS).map(|i| {
            let (z, angle) = (1.0 - 2.0 * at(i), at(i) * 800.0);
            let r = (1.0 - z * z).sqrt();
            [r * angle.cos(), r * angle.sin(), z]
        });
        vec![("terrain", terrain.collect()), ("sweep", sweep.collect()), ("sphere", sphere.collect())]
    }

    #[test]
    fn layouts_of_ordered_clouds_are_found() {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        for (name, cloud) in clouds() {
            let mut with = |extra: usize, scale: f64| -> Vec<Vec<f64>> {
                let more =
                    |p: &[f64; 3]| p.iter().copied().chain((0..extra).map(|_| rng.random::<f64>() * scale)).collect();
                cloud.iter().map(more).collect()
            };
            let (xyz, xyzi, xyzir, normals) = (with(0, 1.0), with(1, 1.0), with(2, 30.0), with(3, 1.0));
            assert_eq!(found(&single(&xyz)).unwrap(), "xyz", "{name}");
            assert_eq!(found(&single(&xyzi)).unwrap(), "xyzi", "{name}");
            assert_eq!(found(&single(&xyzir)).unwrap(), "xyzir", "{name}");
            assert_eq!(found(&single(&normals)).unwrap(), "xyz,_:12", "{name}");
            assert_eq!(found(&double(&xyz)).unwrap(), "xyz:f64", "{name}");
            assert_eq!(found(&double(&xyzi)).unwrap(), "xyzi:f64", "{name}");
        }
    }

    #[test]
    fn a_few_missing_points_do_not_matter() {
        let (_, mut cloud) = clouds().remove(0);
        cloud.iter_mut().step_by(7).for_each(|p| *p = [f64::NAN; 3]);
        let records: Vec<Vec<f64>> = cloud.iter().map(|p| p.to_vec()).collect();
        assert_eq!(found(&single(&records)).unwrap(), "xyz");
    }

    #[test]
    fn whole_numbers_in_double_precision_are_not_taken_for_single() {
        let records: Vec<Vec<f64>> = (0..RECORDS).map(|i| vec![(i % 100) as f64, (i / 100) as f64, 5.0]).collect();
        assert_eq!(found(&double(&records)).unwrap(), "xyz:f64");
    }

    #[test]
    fn extents_tell_unordered_columns_apart() {
        let mut rng = ChaCha8Rng::seed_from_u64(10);
        let mut centred = |extent: f64| (rng.random::<f64>() - 0.5) * extent;
        let flat: Vec<Vec<f64>> = (0..RECORDS).map(|_| vec![centred(1.0), centred(1.0), centred(0.1)]).collect();
        assert_eq!(found(&single(&flat)).unwrap(), "xyz");
        assert_eq!(found(&double(&flat)).unwrap(), "xyz:f64");
    }

    #[test]
    fn isotropic_noise_is_ambiguous_and_shown() {
        let mut rng = ChaCha8Rng::seed_from_u64(8);
        let noise: Vec<Vec<f64>> = (0..RECORDS).map(|_| (0..3).map(|_| rng.random::<f64>() - 0.5).collect()).collect();
        match found(&single(&noise)).unwrap_err() {
            Error::AmbiguousLayout { candidates, .. } => {
                assert_eq!(candidates.0[0].layout, "xyz");
                assert_eq!(candidates.0[0].preview.len(), 3);
                assert!(candidates.0.iter().any(|c| c.layout == "xyzi"));
            }
            other => panic!("{other}"),
        }
    }

    #[test]
    fn what_fits_no_layout_says_so() {
        assert!(found(&[0u8; 13]).unwrap_err().to_string().contains("13 bytes"));
        assert!(found(&[]).is_err());
        let mut rng = ChaCha8Rng::seed_from_u64(9);
        let bytes: Vec<u8> = (0..8400 * 4).map(|_| rng.random()).collect();
        assert!(found(&bytes).unwrap_err().to_string().contains("absurd size"));
    }
}
