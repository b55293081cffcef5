//! Numbers as messages say them.

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

#[cfg(test)]
mod tests {
    use super::*;

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
