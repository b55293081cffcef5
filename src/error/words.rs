//! Numbers and paths as messages and reports say them, and settings as the command names them.

use std::path::{Path, PathBuf};

use serde::{Serialize, Serializer};

/// A path in a report: text, in which what is no Unicode is replaced, as in messages.
pub fn told<S: Serializer>(path: &Path, out: S) -> Result<S::Ok, S::Error> {
    path.to_string_lossy().serialize(out)
}

/// A path in a report, if there is one.
pub fn told_if_any<S: Serializer>(path: &Option<PathBuf>, out: S) -> Result<S::Ok, S::Error> {
    path.as_deref().map(Path::to_string_lossy).serialize(out)
}

/// A time: "0.45 s", "12.3 s", "3 min 20 s", "2 h 5 min".
pub fn duration(seconds: f64) -> String {
    let seconds = seconds.max(0.0);
    match seconds.round() as u64 {
        _ if seconds < 9.995 => format!("{seconds:.2} s"),
        _ if seconds < 99.95 => format!("{seconds:.1} s"),
        whole @ ..3600 => format!("{} min {} s", whole / 60, whole % 60),
        whole => format!("{} h {} min", whole / 3600, whole % 3600 / 60),
    }
}

/// A time that is a guess, in whole seconds, or minutes if there are many.
pub fn rough(seconds: f64) -> String {
    match seconds.ceil().max(1.0) as u64 {
        whole @ ..100 => format!("{whole} s"),
        whole @ ..600 => format!("{} min {} s", whole / 60, whole % 60 / 10 * 10),
        whole @ ..3600 => format!("{} min", whole / 60),
        whole => format!("{} h {} min", whole / 3600, whole % 3600 / 60),
    }
}

/// A number with its digits in groups of three: 1,234,567.
pub fn thousands(number: u64) -> String {
    indicatif::HumanCount(number).to_string()
}

/// A length, area or volume with six digits, without trailing zeros.
pub fn short(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let magnitude = libm::log10(value.abs()).floor() as i32;
    if (-4..9).contains(&magnitude) {
        let text = format!("{value:.*}", (5 - magnitude).max(0) as usize);
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
    } else {
        format!("{value:.5e}")
    }
}

/// The settings that messages name, in backticks: `max_memory`, as the library has it, is the command's `--max-memory`.
pub const SETTINGS: [&str; 48] = [
    "attributes",
    "axis",
    "base",
    "batch",
    "bounds",
    "bridged",
    "cell_size",
    "classes",
    "clip",
    "color_by",
    "compress",
    "coordinates",
    "crs",
    "dsm",
    "dtm",
    "endian",
    "facing",
    "heatmap_max",
    "height_offset",
    "k",
    "layout",
    "max_hole",
    "max_memory",
    "max_triangles",
    "min_component",
    "min_points",
    "no_skirts",
    "output",
    "overwrite",
    "raster_size",
    "recursive",
    "seal",
    "seen_from",
    "simplify",
    "size",
    "skip_bytes",
    "slices",
    "smooth",
    "surface",
    "temp_dir",
    "threads",
    "tile",
    "trim",
    "unsound",
    "upsample",
    "window",
    "work",
    "write_classes",
];

/// A message in the command's words: settings that stand in backticks become options.
pub fn as_options(message: &str) -> String {
    let mut out = String::with_capacity(message.len());
    let mut rest = message;
    while let Some((before, after)) = rest.split_once('`') {
        out += before;
        match after.split_once('`').filter(|(word, _)| SETTINGS.contains(word)) {
            Some((word, beyond)) => {
                out += "--";
                out += &word.replace('_', "-");
                rest = beyond;
            }
            None => {
                out.push('`');
                rest = after;
            }
        }
    }
    out + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_become_options_and_nothing_else_does() {
        for (message, command) in [
            ("`seal`: 4 is too much", "--seal: 4 is too much"),
            ("pass `max_memory` 5M or `k` 3", "pass --max-memory 5M or --k 3"),
            ("expected `largest` or `auto`", "expected `largest` or `auto`"),
            ("a`b`seal`", "a`b--seal"),
            ("no word, `seal", "no word, `seal"),
            ("", ""),
        ] {
            assert_eq!(as_options(message), command);
        }
    }

    #[test]
    fn numbers_are_short() {
        for (value, text) in [
            (0.0, "0"),
            (1.0, "1"),
            (0.00026342, "0.00026342"),
            (0.0000123456789, "1.23457e-5"),
            (123456.789, "123457"),
            (-2.5, "-2.5"),
            (1e12, "1.00000e12"),
        ] {
            assert_eq!(short(value), text);
        }
    }

    #[test]
    fn times_have_the_digits_that_count() {
        for (seconds, words) in [
            (0.0, "0.00 s"),
            (9.994, "9.99 s"),
            (9.999, "10.0 s"),
            (99.96, "1 min 40 s"),
            (281.4, "4 min 41 s"),
            (3599.9, "1 h 0 min"),
            (7500.0, "2 h 5 min"),
        ] {
            assert_eq!(duration(seconds), words);
        }
    }
}
