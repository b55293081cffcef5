//! How far a run is, and how to end it: an `Observer` behind a "cancel" button. `cargo run --release --example progress`.

use std::sync::atomic::{AtomicBool, Ordering};

use asra_stream::{Error, Observer, Reconstruction, Result, Update};

/// Shows stages as they end, and cancels once a share of the run is done.
struct Bar {
    cancel_at: f64,
    cancelled: AtomicBool,
}

impl Observer for Bar {
    // Called from the run's own threads, at most some ten times a second.
    fn progress(&self, update: &Update) {
        if update.ended {
            println!("{:<8} {} {}", update.stage.name(), update.done, update.unit);
        }
        if update.fraction.is_some_and(|fraction| fraction >= self.cancel_at) {
            self.cancelled.store(true, Ordering::Relaxed);
        }
    }

    fn note(&self, message: &str) {
        println!("note: {message}");
    }

    fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }
}

/// Runs once to the end, and is cancelled once.
pub fn main() -> Result<()> {
    let points = points(300_000);

    let patient = Bar { cancel_at: f64::INFINITY, cancelled: AtomicBool::new(false) };
    let mesh = Reconstruction::of(&points).observer(&patient).run()?;
    println!("done: {} triangles", mesh.triangle_count());

    // Nothing is left behind of a run that was cancelled.
    let impatient = Bar { cancel_at: 0.0, cancelled: AtomicBool::new(true) };
    match Reconstruction::of(&points).observer(&impatient).run() {
        Err(Error::Interrupted) => println!("cancelled"),
        other => panic!("expected to be cancelled, found {:?}", other.map(|mesh| mesh.triangle_count())),
    }
    Ok(())
}

/// Points spread evenly over the unit sphere.
fn points(count: usize) -> Vec<[f32; 3]> {
    (0..count)
        .map(|i| {
            let z = (2.0 * i as f64 + 1.0) / count as f64 - 1.0;
            let (r, angle) = ((1.0 - z * z).sqrt(), 2.3999632297 * i as f64);
            [r * angle.cos(), r * angle.sin(), z].map(|c| c as f32)
        })
        .collect()
}
