//! The one progress object: what a run says on standard error while it works, and the time of every stage.
//!
//! ```text
//!   terminal     a bar for the whole run, redrawn in place; a line for every finished stage, above it
//!   else         a line for every finished stage, and every ten seconds within one, with the time of day
//!   json         an object a line: docs/progress.md has the keys
//! ```
//!
//! Stages differ in what they count, so the run's progress is weighed: a [`Forecast`] says how much work each stage is likely to be, from the points and the
//! faces known so far, and is made anew as more is known. Nothing here fails: what cannot be written to standard error is dropped.

use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant, SystemTime};

use console::style;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::json;

use crate::error::words::{as_options, duration, rough, thousands};
use crate::input::Unpacked;
use crate::run::forecast::Known;
use crate::run::observer::{Observer, Update};
use crate::run::phase::{Forecast, Phase};

/// How progress is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Show {
    /// A bar, redrawn in place, and a line when a phase ends.
    Bars,
    /// A line when a phase ends, and every ten seconds within it.
    Lines,
    /// A JSON object a line.
    Json,
    /// Nothing.
    Nothing,
}

impl Show {
    /// Bars if standard error is a terminal that can redraw a line, else lines.
    pub fn fitting() -> Show {
        let plain = std::env::var_os("TERM").is_some_and(|term| term == "dumb");
        if std::io::stderr().is_terminal() && !plain { Show::Bars } else { Show::Lines }
    }
}

/// How often a line is written within a phase: rarely, so that the logs of batch jobs stay short.
const BETWEEN_LINES: Duration = Duration::from_secs(10);
/// How often the bar's words, and the objects of JSON, are made anew.
const BETWEEN_BARS: Duration = Duration::from_millis(100);
const BETWEEN_OBJECTS: Duration = Duration::from_millis(500);
/// How long a run must have been under way, and how much of it must be done, for the rest to be estimated from that.
const ENOUGH: (Duration, f64) = (Duration::from_millis(500), 0.01);
/// Parts of the bar.
const PARTS: u64 = 1000;
/// Columns of a terminal that leave room for a bar beside the words.
const WIDE: u16 = 60;

/// Shows what is going on, on standard error, and keeps the time.
pub struct Progress<'a> {
    show: Show,
    observer: Option<&'a dyn Observer>,
    bar: ProgressBar,
    start: Instant,
    forecast: Forecast,
    known: Option<Known>,
    /// The most that was said to be done: it never falls, even if more work is found.
    said: f64,
    current: Option<Current>,
    times: Vec<(Phase, Duration)>,
    output: Option<serde_json::Value>,
}

#[derive(Debug)]
struct Current {
    phase: Phase,
    start: Instant,
    last_told: Instant,
    total: Option<u64>,
    done: u64,
    /// The part of the phase's work that is done, where that is not the same as of what is counted.
    part: Option<f64>,
}

impl<'a> Progress<'a> {
    /// Progress that an observer is told.
    pub fn told(observer: Option<&'a dyn Observer>) -> Progress<'a> {
        let mut progress = Progress::new(Show::Nothing);
        progress.observer = observer;
        progress
    }

    /// Progress shown in the given way.
    pub fn new(show: Show) -> Progress<'a> {
        Progress {
            show,
            observer: None,
            bar: ProgressBar::hidden(),
            start: Instant::now(),
            forecast: Forecast::default(),
            known: None,
            said: 0.0,
            current: None,
            times: Vec::new(),
            output: None,
        }
    }

    /// How it is shown.
    pub fn show(&self) -> Show {
        self.show
    }

    /// Says what work is to be expected of the run, phases that are done included. It replaces what was expected before.
    pub fn expect(&mut self, forecast: Forecast) {
        self.forecast = forecast;
    }

    /// Says what is known of a whole run, from which its work is forecast.
    pub fn expect_run(&mut self, known: Known) {
        self.known = Some(known);
        self.forecast = known.forecast();
    }

    /// Changes what is known of a whole run, if this is one.
    pub fn learn(&mut self, more: impl FnOnce(&mut Known)) {
        if let Some(mut known) = self.known {
            more(&mut known);
            self.expect_run(known);
        }
    }

    /// Says how far unpacking is, whose phase begins with the first call.
    pub fn unpacked(&mut self, far: Unpacked) {
        if self.current.as_ref().is_none_or(|current| current.phase != Phase::Unpack) {
            self.learn(|known| known.packed = far.total.unwrap_or(far.bytes));
            self.begin(Phase::Unpack, far.total);
        }
        self.set(if far.total.is_some() { far.read } else { far.bytes });
    }

    /// Ends the phase under way and begins another, of `total` units if that is known.
    pub fn begin(&mut self, phase: Phase, total: Option<u64>) {
        self.end();
        let now = Instant::now();
        self.current = Some(Current { phase, start: now, last_told: now, total, done: 0, part: None });
        if self.show == Show::Bars {
            self.bar = self.new_bar();
        }
        match self.show {
            Show::Nothing if self.observer.is_none() => {}
            Show::Bars | Show::Json | Show::Nothing => self.tell(),
            Show::Lines => {}
        }
    }

    fn new_bar(&self) -> ProgressBar {
        let known = self.fraction().is_some();
        let wide = console::Term::stderr().size_checked().is_none_or(|(_, columns)| columns >= WIDE);
        let template = match (known, wide) {
            (true, true) => "{percent:>3} % [{bar:24}] {wide_msg}",
            (true, false) => "{percent:>3} % {wide_msg}",
            (false, _) => "{spinner} {wide_msg}",
        };
        let bar = ProgressBar::new(PARTS);
        bar.set_draw_target(ProgressDrawTarget::stderr());
        bar.set_style(ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar
    }

    /// There are so many units in the phase in all, as is known now.
    pub fn set_total(&mut self, total: u64) {
        if let Some(current) = &mut self.current {
            current.total = Some(total);
        }
    }

    /// How many units of the phase are done in all.
    pub fn set(&mut self, done: u64) {
        let before = self.current.as_ref().map_or(0, |current| current.done);
        self.add(done.saturating_sub(before));
    }

    /// More units of the phase are done.
    pub fn add(&mut self, units: u64) {
        let Some(current) = &mut self.current else { return };
        current.done += units;
        let between = match self.show {
            Show::Bars => BETWEEN_BARS,
            Show::Lines => BETWEEN_LINES,
            Show::Json => BETWEEN_OBJECTS,
            Show::Nothing if self.observer.is_none() => return,
            Show::Nothing => BETWEEN_BARS,
        };
        if current.last_told.elapsed() >= between {
            current.last_told = Instant::now();
            self.tell();
        }
    }

    /// More units of the phase are done, with which it has come to this part of its work: units are not equally much work.
    pub fn add_weighed(&mut self, units: u64, part: f64) {
        if let Some(current) = &mut self.current {
            current.part = Some(part);
        }
        self.add(units);
    }

    /// Says how far the run is.
    fn tell(&mut self) {
        let Some(current) = &self.current else { return };
        let (fraction, left) = (self.fraction(), self.seconds_left());
        match self.show {
            Show::Bars => {
                let part = fraction.or_else(|| current.part()).unwrap_or(0.0);
                self.bar.set_position((part * PARTS as f64) as u64);
                // First what must not be cut off.
                let left = left.map_or_else(String::new, |seconds| format!("{} left, ", rough(seconds)));
                self.bar.set_message(format!("{left}{}", current.line()));
            }
            Show::Lines => {
                let run = match (fraction, left) {
                    (Some(fraction), Some(seconds)) => {
                        format!("; {:.0} % of the run, {} left", 100.0 * fraction, rough(seconds))
                    }
                    _ => String::new(),
                };
                self.line(&format!("{}{run}", current.line()));
            }
            Show::Json => self.object(
                "progress",
                json!({
                    "stage": current.phase, "unit": current.phase.words().1, "done": current.done, "total": current.total,
                    "fraction": fraction, "eta_seconds": left,
                }),
            ),
            Show::Nothing => {
                if let Some(observer) = self.observer {
                    observer.progress(&Update {
                        stage: current.phase,
                        unit: current.phase.words().1,
                        done: current.done,
                        total: current.total,
                        fraction,
                        seconds_left: left,
                        ended: false,
                    });
                }
            }
        }
        self.said = fraction.unwrap_or(self.said);
    }

    /// The part of the run's work that is done, as far as it is known what work there is.
    pub fn fraction(&self) -> Option<f64> {
        let finished: Vec<Phase> = self.times.iter().map(|(phase, _)| *phase).collect();
        let current = self.current.as_ref().map(|current| (current.phase, current.part().unwrap_or(0.0)));
        Some(self.forecast.fraction(&finished, current)?.max(self.said))
    }

    /// How long the run is likely to take from now on, in seconds: as long for its work as so far.
    pub fn seconds_left(&self) -> Option<f64> {
        let (fraction, elapsed) = (self.fraction()?, self.start.elapsed());
        (elapsed >= ENOUGH.0 && fraction >= ENOUGH.1).then(|| elapsed.as_secs_f64() * (1.0 - fraction) / fraction)
    }

    /// Ends the phase under way, if any.
    pub fn end(&mut self) {
        let Some(current) = self.current.take() else { return };
        self.bar.finish_and_clear();
        let took = current.start.elapsed();
        match self.times.iter_mut().find(|(phase, _)| *phase == current.phase) {
            Some((_, time)) => *time += took,
            None => self.times.push((current.phase, took)),
        }
        let fraction = self.fraction();
        self.said = fraction.unwrap_or(self.said);
        let (name, unit) = current.phase.words();
        let seconds = took.as_secs_f64();
        match self.show {
            Show::Bars | Show::Lines => {
                let count = if current.done > 0 { format!("{}, ", counted(current.done, unit)) } else { String::new() };
                self.line(&format!("{name:>9}  {count}{}", duration(seconds)));
            }
            Show::Json => self.object(
                "stage",
                json!({ "stage": current.phase, "unit": unit, "done": current.done, "seconds": seconds, "fraction": fraction }),
            ),
            Show::Nothing => {
                if let Some(observer) = self.observer {
                    let Current { phase: stage, done, total, .. } = current;
                    let seconds_left = self.seconds_left();
                    observer.progress(&Update { stage, unit, done, total, fraction, seconds_left, ended: true });
                }
            }
        }
    }

    /// Something to know: how a file was understood, what was written.
    pub fn note(&self, words: &str) {
        if let Some(observer) = self.observer {
            observer.note(words);
        }
        match self.show {
            Show::Json => self.object("note", json!({ "message": as_options(words) })),
            _ => self.line(&as_options(words)),
        }
    }

    /// Something that may be wrong, and what can be done about it.
    pub fn warn(&self, warning: &Warning) {
        match self.show {
            Show::Json => self.object("warning", json!({ "message": warning.message, "advice": warning.advice })),
            _ => self.line(&warning.to_string()),
        }
    }

    /// [`Progress::warn`], even if nothing is to be said but errors: of what is one.
    pub fn warn_always(&self, warning: &Warning) {
        match self.show {
            Show::Nothing => say(&warning.to_string()),
            _ => self.warn(warning),
        }
    }

    /// What has come of it, in lines that need no time of day; nothing in JSON, where [`Progress::finished`] says it.
    pub fn summary(&self, lines: &str) {
        if matches!(self.show, Show::Bars | Show::Lines) {
            self.bar.suspend(|| say(lines));
        }
    }

    /// Takes the bar away, for words of others.
    pub fn clear(&self) {
        self.bar.finish_and_clear();
    }

    /// What the last object of JSON is to have as `output`.
    pub fn summarise(&mut self, output: &impl serde::Serialize) {
        self.output = serde_json::to_value(output).ok();
    }

    /// In JSON, the last object: how it ended, with the exit code, and what else there is to say.
    pub fn finished(&self, mut how: serde_json::Value) {
        if self.show == Show::Json {
            if let (Some(output), Some(how)) = (&self.output, how.as_object_mut()) {
                how.insert("output".into(), output.clone());
            }
            self.object("end", how);
        }
    }

    /// A line above the bar, with the time of day where there is none.
    fn line(&self, words: &str) {
        match self.show {
            Show::Bars => self.bar.suspend(|| say(words)),
            Show::Lines => {
                let now = humantime::format_rfc3339_seconds(SystemTime::now());
                say(&words.lines().map(|line| format!("{now} {line}")).collect::<Vec<_>>().join("\n"));
            }
            Show::Json | Show::Nothing => {}
        }
    }

    /// An object with an event's name, the time, and `content`.
    fn object(&self, event: &str, content: serde_json::Value) {
        say(&object(self.start, event, content));
    }

    /// In JSON, makes the line of the last object, for a failure after which nothing else can be said; `None` where progress is not told in JSON.
    pub fn last_line(&self) -> impl Fn(serde_json::Value) -> Option<String> + Clone + use<> {
        let (show, start) = (self.show, self.start);
        move |how| (show == Show::Json).then(|| object(start, "end", how))
    }

    /// The time each phase took, in order.
    pub fn times(&self) -> &[(Phase, Duration)] {
        &self.times
    }
}

/// Lines to standard error; if that cannot be written, nobody is there to be told.
/// An object of JSON in a line, with the time of day and since `start`.
fn object(start: Instant, event: &str, content: serde_json::Value) -> String {
    let mut object = json!({
        "event": event,
        "time": humantime::format_rfc3339_millis(SystemTime::now()).to_string(),
        "elapsed_seconds": start.elapsed().as_secs_f64(),
    });
    if let (Some(object), serde_json::Value::Object(content)) = (object.as_object_mut(), content) {
        object.extend(content);
    }
    object.to_string()
}

fn say(lines: &str) {
    // In one piece, so that lines of several processes do not mix.
    let _ = std::io::stderr().write_all(format!("{lines}\n").as_bytes());
}

/// Something that may be wrong with a result.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Warning {
    /// What was found.
    pub message: String,
    /// What can be done, if anything.
    pub advice: Option<String>,
}

impl Warning {
    /// A warning with advice.
    pub fn new(message: impl Into<String>, advice: impl Into<String>) -> Warning {
        Warning { message: message.into(), advice: Some(advice.into()) }
    }

    /// A warning without.
    pub fn bare(message: impl Into<String>) -> Warning {
        Warning { message: message.into(), advice: None }
    }
}

impl std::fmt::Display for Warning {
    /// "warning: …", in colour on a terminal that has some, and the advice on lines of its own.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let indented = |text: &str| text.replace('\n', "\n         ");
        write!(f, "{} {}", style("warning:").yellow().bold().for_stderr(), indented(&self.message))?;
        match &self.advice {
            Some(advice) => write!(f, "\n         {}", indented(advice)),
            None => Ok(()),
        }
    }
}

impl Current {
    /// The part of the phase's work that is done.
    fn part(&self) -> Option<f64> {
        self.part.or_else(|| Some(self.done as f64 / self.total.filter(|total| *total > 0)? as f64))
    }

    /// "bucket 12,000,000 of 20,000,000 points, 6,000,000 a second".
    fn line(&self) -> String {
        let (name, unit) = self.phase.words();
        let seconds = self.start.elapsed().as_secs_f64();
        let rate = match (self.done as f64 / seconds.max(1e-9)) as u64 {
            rate if seconds >= 1.0 && rate > 0 && unit == "bytes" => format!(", {} a second", counted(rate, unit)),
            rate if seconds >= 1.0 && rate > 0 => format!(", {} a second", thousands(rate)),
            _ => String::new(),
        };
        match self.total {
            Some(total) if total > 0 => {
                let (done, total) = match unit {
                    "bytes" => (counted(self.done, unit), counted(total, unit)),
                    _ => (thousands(self.done), counted(total, unit)),
                };
                format!("{name} {done} of {total}{rate}")
            }
            _ if self.done > 0 => format!("{name} {}{rate}", counted(self.done, unit)),
            _ => name.to_owned(),
        }
    }
}

impl std::fmt::Debug for Progress<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Progress").field("show", &self.show).field("current", &self.current).finish_non_exhaustive()
    }
}

impl Drop for Progress<'_> {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// A number of something; bytes in the usual larger units.
fn counted(number: u64, unit: &str) -> String {
    match unit {
        "bytes" => bytesize::ByteSize(number).to_string(),
        _ => format!("{} {unit}", thousands(number)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_runs_progress_is_weighed_and_never_falls() {
        let mut progress = Progress::new(Show::Nothing);
        assert_eq!(progress.fraction(), None, "nothing is expected yet");
        progress.expect(Forecast::new([(Phase::Survey, 1.0), (Phase::Surface, 8.0), (Phase::Write, 1.0)]));
        progress.begin(Phase::Survey, Some(10));
        progress.add(5);
        assert_eq!(progress.fraction(), Some(0.05));
        progress.begin(Phase::Surface, Some(100));
        assert_eq!(progress.fraction(), Some(0.1));
        // Half of the faces, three quarters of the work.
        progress.add_weighed(50, 0.75);
        assert!((progress.fraction().unwrap() - 0.7).abs() < 1e-9);
        progress.end();
        assert!((progress.fraction().unwrap() - 0.9).abs() < 1e-9);
        progress.expect(Forecast::new([(Phase::Survey, 1.0), (Phase::Surface, 8.0), (Phase::Write, 91.0)]));
        assert!((progress.fraction().unwrap() - 0.9).abs() < 1e-9, "it does not fall");
        progress.begin(Phase::Write, Some(4));
        progress.add(4);
        assert_eq!(progress.fraction(), Some(1.0));
        progress.add(400);
        assert_eq!(progress.fraction(), Some(1.0), "no more than all");
    }

    #[test]
    fn a_phase_that_is_not_foretold_and_work_that_is_no_number_do_no_harm() {
        let mut progress = Progress::new(Show::Nothing);
        progress.expect(Forecast::new([(Phase::Survey, f64::NAN), (Phase::Bucket, 2.0), (Phase::Seal, -1.0)]));
        progress.begin(Phase::Unpack, None);
        progress.add(7);
        assert_eq!(progress.fraction(), Some(0.0));
        progress.begin(Phase::Bucket, Some(0));
        progress.end();
        assert_eq!(progress.fraction(), Some(1.0));
        assert_eq!(progress.times().len(), 2);
    }
}
