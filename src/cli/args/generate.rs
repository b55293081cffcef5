//! Arguments of `generate`.

use std::path::PathBuf;

use clap::Args;

use super::shared::TalkArguments;
use super::values::triple;
use crate::cli::sizes;
use crate::run::Resources;
use crate::run::generate::Shape;

/// Arguments of `generate`.
#[derive(Debug, Args)]
pub struct GenerateArguments {
    /// What is sampled
    #[arg(value_enum)]
    pub shape: Shape,
    /// Number of points, such as 5000, 100k or 20M
    #[arg(value_parser = sizes::count)]
    pub points: u64,
    /// The file: .bin (with a side-car), .ply or .xyz
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Seed of the random numbers
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Standard deviation of the noise on each coordinate, as a fraction of the size
    #[arg(long, default_value_t = 0.0)]
    pub noise: f64,
    /// Length of the longest side
    #[arg(long, default_value_t = 1.0)]
    pub size: f64,
    /// Where the centre lies; away from zero, coordinates are written as f64
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, default_value = "0,0,0", allow_hyphen_values = true)]
    pub offset: [f64; 3],
    /// Replace the file if it exists
    #[arg(long)]
    pub overwrite: bool,
    /// How much is said.
    #[command(flatten)]
    pub talk: TalkArguments,
    /// Worker threads [default: one for each processor]
    #[arg(short = 'j', long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub threads: Option<u16>,
}

impl GenerateArguments {
    /// What may be used.
    pub fn resources(&self) -> Resources {
        Resources { threads: self.threads.map(usize::from), ..Resources::default() }
    }
}
