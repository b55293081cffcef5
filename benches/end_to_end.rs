//! A whole run, from the file of points to the checked mesh file, on knots: what the command does, without its start.
//!
//! ```text
//! cargo bench --bench end_to_end                                   all, about a minute and a half
//! cargo bench --bench end_to_end -- threads                        one group: points, buckets, threads
//! ASRA_BENCH_POINTS=100_000_000 cargo bench --bench end_to_end     and one large cloud more, in group `points`
//! ```
//!
//! * `points`: clouds of growing size, in memory, on all processors. Points per second should hardly fall with the size.
//! * `buckets`: the largest of these with its points in memory, and with a budget that sends points and mesh to disk: the
//!   price of working out of core, as long as the system's cache holds what was written.
//! * `threads`: one and two, in memory.
//!
//! Throughput is in points of the input. The input files are in the system's cache.

mod clouds;

use std::path::Path;
use std::time::Duration;

use asra_stream::internals::resources::machine;
use asra_stream::internals::resources::workers::Workers;
use asra_stream::internals::run::progress::{Progress, Show};
use asra_stream::internals::run::report::Report;
use asra_stream::internals::run::{Job, Resources, run};
use asra_stream::internals::storage::atomic_file::Overwrite;
use criterion::{BenchmarkId, Criterion, SamplingMode, Throughput};

const SIZES: [u64; 3] = [36_000, 500_000, 2_000_000];

/// Runs over a cloud, on some threads.
struct Bench<'a> {
    dir: &'a Path,
    points: u64,
    threads: usize,
    /// Whether the budget is so small that the points go to disk.
    on_disk: bool,
}

impl Bench<'_> {
    /// The plan keeps the points in memory if they fill no more than half of the budget, less the process's own share.
    fn budget(&self) -> u64 {
        if self.on_disk { 2 * 12 * self.points } else { (1 << 30) + 400 * self.points }
    }

    fn add(&self, criterion: &mut Criterion, group: &str, id: BenchmarkId) {
        let workers = Workers::new(self.threads).expect("threads");
        let job = Job {
            output: Some(self.dir.join("knot.ply")),
            overwrite: Overwrite::Replace,
            resources: Resources {
                max_memory: Some(self.budget()),
                threads: Some(self.threads),
                temp_dir: Some(self.dir.to_path_buf()),
                ..Resources::default()
            },
            ..Job::new([clouds::knot(self.dir, self.points, &workers)])
        };
        let run = || -> Report {
            let report = run(&job, &workers, &mut Progress::new(Show::Nothing)).expect("a mesh");
            assert_eq!(report.memory.peak_disk > 0, self.on_disk);
            report
        };
        let mut group = criterion.benchmark_group(group);
        group.sample_size(10).sampling_mode(SamplingMode::Flat).throughput(Throughput::Elements(self.points));
        group.warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(3));
        group.bench_function(id, |b| {
            b.iter(run);
        });
        group.finish();
    }
}

fn main() {
    let dir = tempfile::tempdir().expect("a folder for temporary files");
    let dir = dir.path();
    let mut criterion = Criterion::default().configure_from_args();
    let threads = machine::processors();
    for points in SIZES.into_iter().chain(clouds::points_asked("ASRA_BENCH_POINTS")) {
        let bench = Bench { dir, points, threads, on_disk: false };
        bench.add(&mut criterion, "points", BenchmarkId::from_parameter(points));
    }
    let points = SIZES[SIZES.len() - 1];
    for (name, on_disk) in [("memory", false), ("disk", true)] {
        let bench = Bench { dir, points, threads, on_disk };
        bench.add(&mut criterion, "buckets", BenchmarkId::new(name, points));
    }
    let points = SIZES[1];
    for threads in [1, 2] {
        let bench = Bench { dir, points, threads, on_disk: false };
        bench.add(&mut criterion, "threads", BenchmarkId::new(threads.to_string(), points));
    }
    criterion.final_summary();
}
