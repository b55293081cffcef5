//! Test clouds of any size: points of a [`Shape`], written as a stream in bounded memory.
//!
//! Points are made in blocks of [`BLOCK_POINTS`]; block i takes stream i of a ChaCha generator with the given seed.
//! So the file depends on the options alone, whatever the number of threads, and two clouds of different sizes begin
//! alike.

pub mod densify;
mod shape;

use std::path::PathBuf;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use self::shape::gaussian;
use crate::error::{Error, Result};
use crate::format::write::{CloudTarget, Description, FileKind};
use crate::points::Precision;
use crate::resources::workers::Workers;
use crate::storage::atomic_file::Overwrite;

pub use shape::Shape;

/// Points made by one job: 768 KiB of `f32` coordinates.
pub const BLOCK_POINTS: u64 = 1 << 16;

/// What to make.
#[derive(Debug, Clone)]
pub struct Options {
    /// What is sampled.
    pub shape: Shape,
    /// Number of points.
    pub points: u64,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Standard deviation of the noise added to each coordinate, as a fraction of `size`.
    pub noise: f64,
    /// Length of the shape's longest side.
    pub size: f64,
    /// Where its centre lies. Away from the origin coordinates are written as `f64`, else as `f32`: a map position
    /// leaves an `f32` no digits for the shape.
    pub offset: [f64; 3],
    /// The file: `.bin` (raw, with a side-car), `.ply` (binary) or `.xyz` / `.txt` (text).
    pub path: PathBuf,
    /// Whether an existing file may be replaced.
    pub overwrite: Overwrite,
}

impl Options {
    /// `points` points of `shape`, of size 1 round the origin, without noise, seed 0, replacing nothing.
    pub fn new(shape: Shape, points: u64, path: impl Into<PathBuf>) -> Options {
        let path = path.into();
        Options { shape, points, seed: 0, noise: 0.0, size: 1.0, offset: [0.0; 3], path, overwrite: Overwrite::Refuse }
    }

    /// The precision the coordinates are written in.
    pub fn precision(&self) -> Precision {
        if self.offset == [0.0; 3] { Precision::Single } else { Precision::Double }
    }
}

/// What was made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Summary {
    /// Points written.
    pub points: u64,
    /// Bytes of the file, without its side-car.
    pub bytes: u64,
    /// The side-car, for raw files.
    pub sidecar: Option<PathBuf>,
}

/// Writes the cloud. `progress` is told the number of points written so far, after every block.
///
/// The file appears under its name only when it is complete. Memory: two blocks per worker.
///
/// # Errors
/// [`Error::Usage`] for options out of range or an unknown extension, [`Error::OutputExists`], [`Error::Io`], or
/// [`Error::Interrupted`].
pub fn generate(options: &Options, workers: &Workers, progress: &mut dyn FnMut(u64)) -> Result<Summary> {
    check(options)?;
    let comment = format!("{} of size {}, seed {}", options.shape, options.size, options.seed);
    let cloud = Description { comment, points: options.points, precision: options.precision() };
    let mut target = CloudTarget::create(&options.path, cloud, options.overwrite)?;
    let kind = target.kind();
    let blocks = options.points.div_ceil(BLOCK_POINTS) as usize;
    let in_flight = 2 * workers.threads();
    let block = |number: usize| {
        let first = number as u64 * BLOCK_POINTS;
        let count = BLOCK_POINTS.min(options.points - first);
        Ok((count, encode_block(options, kind, number as u64, count)))
    };
    let mut points = 0;
    workers.in_order_range(in_flight, blocks, block, |(count, bytes)| {
        target.append(&bytes)?;
        points += count;
        progress(points);
        Ok(())
    })?;
    let (bytes, sidecar) = target.finish()?;
    Ok(Summary { points, bytes, sidecar })
}

fn check(options: &Options) -> Result<()> {
    if !(options.size.is_finite() && options.size > 0.0) {
        return Err(Error::Usage(format!("size: expected a length above 0, found {}", options.size)));
    }
    if !(options.noise.is_finite() && options.noise >= 0.0) {
        return Err(Error::Usage(format!(
            "noise: expected a fraction of the size, 0 or more, found {}",
            options.noise
        )));
    }
    match options.offset.iter().find(|v| !v.is_finite()) {
        Some(v) => Err(Error::Usage(format!("offset: expected three numbers, found {v}"))),
        None => Ok(()),
    }
}

/// The bytes of one block of points.
fn encode_block(options: &Options, kind: FileKind, number: u64, count: u64) -> Vec<u8> {
    let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
    rng.set_stream(number);
    let mut bytes = Vec::with_capacity(count as usize * 3 * options.precision().bytes());
    for _ in 0..count {
        let mut point = options.shape.point(&mut rng);
        if options.noise > 0.0 {
            point = point.map(|c| c + options.noise * gaussian(&mut rng));
        }
        let place = |axis: usize| point[axis] * options.size + options.offset[axis];
        kind.encode([place(0), place(1), place(2)], options.precision(), &mut bytes);
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::{Carried, Cloud, InputOptions};
    use crate::points::{Batch, Points};

    fn make(options: &Options, threads: usize) -> Result<Summary> {
        generate(options, &Workers::new(threads).unwrap(), &mut |_| {})
    }

    fn read(options: &Options) -> Vec<[f64; 3]> {
        let cloud = Cloud::open(std::slice::from_ref(&options.path), &InputOptions::default()).unwrap();
        let mut blocks = cloud.blocks(Carried::Coordinates);
        let mut batch = Batch::new(cloud.precision());
        let mut all = Vec::new();
        while let Some(block) = blocks.next_block().unwrap() {
            block.decode(&mut batch).unwrap();
            match &batch.points {
                Points::Single(points) => all.extend(points.iter().map(|p| p.map(f64::from))),
                Points::Double(points) => all.extend_from_slice(points),
            }
        }
        all
    }

    #[test]
    fn the_file_depends_on_the_options_alone() {
        let dir = tempfile::tempdir().unwrap();
        let points = 3 * BLOCK_POINTS / 2;
        let content = |name: &str, threads, seed| {
            let options = Options { seed, noise: 0.01, ..Options::new(Shape::Torus, points, dir.path().join(name)) };
            assert_eq!(make(&options, threads).unwrap().bytes, points * 12);
            std::fs::read(&options.path).unwrap()
        };
        let one = content("one.bin", 1, 5);
        assert_eq!(content("many.bin", 4, 5), one);
        assert_ne!(content("other.bin", 1, 6), one);
    }

    #[test]
    fn every_kind_of_file_holds_the_same_points() {
        let dir = tempfile::tempdir().unwrap();
        for offset in [[0.0; 3], [500_000.0, 5_000_000.0, 100.0]] {
            let mut clouds = Vec::new();
            for name in ["a.bin", "a.ply", "a.xyz", "a.txt"] {
                let overwrite = Overwrite::Replace;
                let base = Options::new(Shape::Terrain, 70_000, dir.path().join(name));
                let options = Options { offset, size: 1000.0, overwrite, ..base };
                let summary = make(&options, 2).unwrap();
                assert_eq!(summary.bytes, std::fs::metadata(&options.path).unwrap().len());
                assert_eq!(summary.sidecar.is_some(), name == "a.bin");
                // Text names the shortest decimal that is this `f32`; as `f64` it is another number.
                let exact = |c: f64| if options.precision() == Precision::Single { f64::from(c as f32) } else { c };
                clouds.push(read(&options).into_iter().map(|p| p.map(exact)).collect::<Vec<_>>());
            }
            assert_eq!(clouds[0].len(), 70_000);
            assert!(clouds.iter().all(|cloud| *cloud == clouds[0]));
            let far = clouds[0].iter().map(|p| (p[1] - offset[1]).abs()).fold(0.0, f64::max);
            assert!((490.0..=500.0).contains(&far));
        }
    }

    #[test]
    fn an_existing_file_stays_and_nothing_is_left_behind() {
        let dir = tempfile::tempdir().unwrap();
        let options = Options::new(Shape::Line, 10, dir.path().join("a.bin"));
        std::fs::write(&options.path, "precious").unwrap();
        assert!(matches!(make(&options, 1), Err(Error::OutputExists(_))));
        let workers = Workers::new(1).unwrap();
        workers.cancel_flag().store(true, std::sync::atomic::Ordering::Relaxed);
        let replacing = Options { overwrite: Overwrite::Replace, ..options.clone() };
        assert!(matches!(generate(&replacing, &workers, &mut |_| {}), Err(Error::Interrupted)));
        assert_eq!(std::fs::read(&options.path).unwrap(), b"precious");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
        make(&replacing, 1).unwrap();
        assert_eq!(read(&options).len(), 10);
    }

    #[test]
    fn options_out_of_range_are_refused() {
        let base = Options::new(Shape::Box, 10, "/nonexistent/a.bin");
        assert!(matches!(make(&base, 1), Err(Error::Io { .. })));
        for (options, part) in [
            (Options { noise: f64::NAN, ..base.clone() }, "noise"),
            (Options { size: 0.0, ..base.clone() }, "size"),
            (Options { offset: [0.0, f64::INFINITY, 0.0], ..base.clone() }, "offset"),
            (Options { path: "a.las".into(), ..base.clone() }, ".bin, .ply, .xyz or .txt"),
        ] {
            assert!(make(&options, 1).unwrap_err().to_string().contains(part), "{part}");
        }
    }
}
