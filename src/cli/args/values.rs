//! Values as typed: lengths with units, ways to close holes, boxes.

use super::shared::InUnit;
use crate::points::bounds::Bounds;
use crate::settings::closing::Sealing;
use crate::settings::{Fineness, Resolution};

/// A length above 0.
pub(super) fn side(text: &str) -> std::result::Result<InUnit<f64>, String> {
    InUnit::parse(text, positive, |_| true)
}

/// A height, which may be below 0.
pub(super) fn height(text: &str) -> std::result::Result<InUnit<f64>, String> {
    let number = |text: &str| text.parse().map_err(|_| format!("expected a height such as 120 or -3m, found {text:?}"));
    InUnit::parse(text, number, |_| true)
}

/// The side of a cell, or `auto`.
pub(super) fn cell_size(text: &str) -> std::result::Result<InUnit<Fineness>, String> {
    InUnit::parse(text, fineness, |value| *value != Fineness::Sampling)
}

/// A way to close holes, as typed.
pub(super) fn sealing(text: &str) -> std::result::Result<InUnit<Sealing>, String> {
    InUnit::parse(text, unmeasured_sealing, |value| matches!(value, Sealing::Length(_)))
}

fn unmeasured_sealing(text: &str) -> std::result::Result<Sealing, String> {
    let expected = || format!("expected auto, off, a length, or a number of cells such as 8c, found {text:?}");
    match (text, text.strip_suffix('c')) {
        ("auto", _) => Ok(Sealing::Auto),
        ("off", _) => Ok(Sealing::Off),
        (_, Some(cells)) => match cells.parse() {
            Ok(cells @ 1..) => Ok(Sealing::Cells(cells)),
            _ => Err(expected()),
        },
        _ => match text.parse() {
            Ok(length) if f64::is_finite(length) && length > 0.0 => Ok(Sealing::Length(length)),
            _ => Err(expected()),
        },
    }
}

/// A number above 0.
pub(super) fn positive(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number > 0.0 && number.is_finite() => Ok(number),
        _ => Err(format!("expected a number above 0, found {text:?}")),
    }
}

fn fineness(text: &str) -> std::result::Result<Fineness, String> {
    if text == "auto" {
        return Ok(Fineness::Sampling);
    }
    positive(text)
        .map(|side| Fineness::Given(Resolution::Cell(side)))
        .map_err(|_| format!("expected a length above 0, or `auto`, found {text:?}"))
}

/// A box, with heights or without.
pub(super) fn bounds(text: &str) -> std::result::Result<Bounds, String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|word| word.trim().parse().ok()).collect();
    let bounds = match numbers.as_deref() {
        Some(&[x, y, to_x, to_y]) => Bounds { min: [x, y, f64::NEG_INFINITY], max: [to_x, to_y, f64::INFINITY] },
        Some(&[x, y, z, to_x, to_y, to_z]) => Bounds { min: [x, y, z], max: [to_x, to_y, to_z] },
        _ => return Err(format!("expected four or six numbers such as 0,0,100,100, found {text:?}")),
    };
    // Not a number is no less than anything.
    match (0..3).all(|a| bounds.min[a] <= bounds.max[a]) {
        true => Ok(bounds),
        false => Err(format!("expected the least coordinates, then the greatest, found {text:?}")),
    }
}

/// X, Y and Z.
pub(super) fn triple(text: &str) -> std::result::Result<[f64; 3], String> {
    let numbers: Vec<f64> = text.split(',').filter_map(|word| word.trim().parse().ok()).collect();
    match numbers.try_into() {
        Ok(numbers) if text.split(',').count() == 3 => Ok(numbers),
        _ => Err(format!("expected three numbers such as 1,2.5,-3, found {text:?}")),
    }
}
