//! The one progress object: bars on a terminal, sparse lines in a log, or nothing; and the time of every phase.

use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// The phases of a run, in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Phase {
    /// Unpacking compressed files, reading standard input.
    Unpack,
    /// Counting points and finding their box.
    Survey,
    /// Sorting points into buckets.
    Bucket,
    /// Finding the occupied cells.
    Raster,
    /// Finding the closing radius, and the solid.
    Seal,
    /// Extraction, smoothing, fitting, stitching.
    Surface,
    /// Checking the mesh; and, where there is room for both, writing the mesh file.
    Check,
    /// Looking for triangles of the mesh that intersect.
    Intersect,
    /// Measuring distances between a mesh and its reference.
    Compare,
    /// Writing the mesh file, if that is still to do, and giving it its name.
    Write,
    /// Drawing a picture of the mesh.
    Render,
    /// Making a test cloud.
    Generate,
}

impl Phase {
    /// The phase's name and the unit it counts in.
    fn words(self) -> (&'static str, &'static str) {
        match self {
            Phase::Unpack => ("unpack", "bytes"),
            Phase::Survey => ("survey", "points"),
            Phase::Bucket => ("bucket", "points"),
            Phase::Raster => ("raster", "slices"),
            Phase::Seal => ("seal", "slices"),
            Phase::Surface => ("surface", "slices"),
            Phase::Check => ("check", "triangles"),
            Phase::Intersect => ("intersect", "triangles"),
            Phase::Compare => ("compare", "distances"),
            Phase::Write => ("write", "elements"),
            Phase::Render => ("render", "triangles"),
            Phase::Generate => ("generate", "points"),
        }
    }

    /// The phase's name.
    pub fn name(self) -> &'static str {
        self.words().0
    }
}

/// How progress is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Show {
    /// Bars, redrawn in place.
    Bars,
    /// A line when a phase ends, and every ten seconds within it.
    Lines,
    /// Nothing.
    Nothing,
}

impl Show {
    /// Bars if standard error is a terminal, else lines.
    pub fn fitting() -> Show {
        if std::io::stderr().is_terminal() { Show::Bars } else { Show::Lines }
    }
}

/// How often a line is written within a phase: rarely, so that the logs of batch jobs stay short.
const BETWEEN_LINES: Duration = Duration::from_secs(10);

/// Shows what is going on, on standard error, and keeps the time.
#[derive(Debug)]
pub struct Progress {
    show: Show,
    bar: ProgressBar,
    current: Option<Current>,
    times: Vec<(Phase, Duration)>,
}

#[derive(Debug)]
struct Current {
    phase: Phase,
    start: Instant,
    last_line: Instant,
    total: Option<u64>,
    done: u64,
}

impl Progress {
    /// Progress shown in the given way.
    pub fn new(show: Show) -> Progress {
        Progress { show, bar: ProgressBar::hidden(), current: None, times: Vec::new() }
    }

    /// Ends the phase under way and begins another, of `total` units if that is known.
    pub fn begin(&mut self, phase: Phase, total: Option<u64>) {
        self.end();
        let now = Instant::now();
        self.current = Some(Current { phase, start: now, last_line: now, total, done: 0 });
        if self.show == Show::Bars {
            let (name, unit) = phase.words();
            let template = if total.is_some() {
                format!("{name:>8} [{{wide_bar}}] {{percent:>3}} %  {{rate}} {unit}/s  {{eta}} left")
            } else {
                format!("{name:>8} {{spinner}} {{human_pos}} {unit}  {{rate}} {unit}/s")
            };
            let style = ProgressStyle::with_template(&template).unwrap_or_else(|_| ProgressStyle::default_bar());
            let bar = total.map_or_else(ProgressBar::new_spinner, ProgressBar::new);
            bar.set_draw_target(ProgressDrawTarget::stderr());
            bar.set_style(style.with_key("rate", |state: &indicatif::ProgressState, out: &mut dyn std::fmt::Write| {
                let _ = write!(out, "{}", thousands(state.per_sec() as u64));
            }));
            self.bar = bar;
        }
    }

    /// So many units of the phase are done in all.
    pub fn set(&mut self, done: u64) {
        let before = self.current.as_ref().map_or(0, |current| current.done);
        self.add(done.saturating_sub(before));
    }

    /// More units of the phase are done.
    pub fn add(&mut self, units: u64) {
        let Some(current) = &mut self.current else { return };
        current.done += units;
        match self.show {
            Show::Bars => self.bar.inc(units),
            Show::Lines if current.last_line.elapsed() >= BETWEEN_LINES => {
                current.last_line = Instant::now();
                let line = current.line();
                self.note(&line);
            }
            Show::Lines | Show::Nothing => {}
        }
    }

    /// Ends the phase under way, if any.
    pub fn end(&mut self) {
        if let Some(current) = self.current.take() {
            self.bar.finish_and_clear();
            if self.show == Show::Lines && current.start.elapsed() >= BETWEEN_LINES {
                self.note(&current.line());
            }
            match self.times.iter_mut().find(|(phase, _)| *phase == current.phase) {
                Some((_, time)) => *time += current.start.elapsed(),
                None => self.times.push((current.phase, current.start.elapsed())),
            }
        }
    }

    /// A line for the reader, above the bar.
    pub fn note(&self, line: &str) {
        if self.show != Show::Nothing {
            self.bar.suspend(|| drop(writeln!(std::io::stderr(), "{line}")));
        }
    }

    /// The time each phase took, in order.
    pub fn times(&self) -> &[(Phase, Duration)] {
        &self.times
    }
}

impl Current {
    /// "  bucket: 12,000,000 of 20,000,000 points, 60 %, 6,000,000 points/s, 1 s left".
    fn line(&self) -> String {
        let (name, unit) = self.phase.words();
        let seconds = self.start.elapsed().as_secs_f64().max(1e-9);
        let rate = self.done as f64 / seconds;
        let rate_words = format!("{} {unit}/s", thousands(rate as u64));
        match self.total {
            Some(total) if total > 0 => format!(
                "{name:>8}: {} of {} {unit}, {} %, {rate_words}, {:.0} s left",
                thousands(self.done),
                thousands(total),
                self.done * 100 / total,
                total.saturating_sub(self.done) as f64 / rate.max(1e-9)
            ),
            _ => format!("{name:>8}: {} {unit}, {rate_words}", thousands(self.done)),
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// A number with its digits in groups of three: 1,234,567.
pub fn thousands(number: u64) -> String {
    indicatif::HumanCount(number).to_string()
}
