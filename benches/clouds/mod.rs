//! What the benches share: generated clouds, the machine's worker threads, and the command's allocator.

use std::path::{Path, PathBuf};

use asra_stream::internals::resources::workers::Workers;
use asra_stream::internals::run::generate::{Options, Shape, generate};

/// The allocator of the command: what is measured is what its users get.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// The file of `points` points of a tube round a trefoil knot (a closed surface), seed 0, without noise. It is made if it is not there.
pub fn knot(dir: &Path, points: u64, workers: &Workers) -> PathBuf {
    let path = dir.join(format!("knot-{points}.bin"));
    if !path.exists() {
        generate(&Options::new(Shape::Knot, points, &path), workers, &mut |_| ()).expect("room for the cloud");
    }
    path
}

/// The number of points that the environment variable `name` asks for. Digits may be grouped by `_`.
pub fn points_asked(name: &str) -> Option<u64> {
    let value = std::env::var(name).ok()?;
    Some(value.replace('_', "").parse().unwrap_or_else(|_| panic!("{name}={value}: not a number of points")))
}
