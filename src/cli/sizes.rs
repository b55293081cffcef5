//! Numbers as people type them: sizes (`512M`, `2GiB`) and counts (`100M`, `1e6`).

use bytesize::ByteSize;

/// A memory size in bytes: `256MiB`, `512M`, `2G`, `1000000`. `K`, `M`, `G` and `T` alone are powers of 1024, as in other tools' memory options.
pub fn size(text: &str) -> Result<u64, String> {
    let text = text.trim();
    let binary = match text.chars().last() {
        Some(unit @ ('K' | 'M' | 'G' | 'T' | 'k' | 'm' | 'g' | 't')) => {
            format!("{}{}iB", &text[..text.len() - 1], unit.to_ascii_uppercase())
        }
        _ => text.to_owned(),
    };
    match binary.parse::<ByteSize>() {
        Ok(size) if size.0 > 0 => Ok(size.0),
        _ => Err(format!("expected a size such as 512M or 2G, found {text:?}")),
    }
}

/// A count: `5000`, `100k`, `20M`, `1e6`, `1_000_000`; the units are powers of 1000.
pub fn count(text: &str) -> Result<u64, String> {
    let digits = text.trim().replace('_', "");
    let (number, unit) = match digits.chars().last() {
        Some('k' | 'K') => (&digits[..digits.len() - 1], 1e3),
        Some('M' | 'm') => (&digits[..digits.len() - 1], 1e6),
        Some('G' | 'g') => (&digits[..digits.len() - 1], 1e9),
        _ => (digits.as_str(), 1.0),
    };
    match number.parse::<f64>() {
        Ok(value) if (0.0..1e18).contains(&(value * unit)) && (value * unit).fract() == 0.0 => {
            Ok((value * unit) as u64)
        }
        _ => Err(format!("expected a whole number such as 5000, 100k or 20M, found {text:?}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_as_typed() {
        assert_eq!(size("512M"), Ok(512 << 20));
        assert_eq!(size("2g"), Ok(2 << 30));
        assert_eq!(size("256MiB"), Ok(256 << 20));
        assert_eq!(size("1.5G"), Ok(3 << 29));
        assert_eq!(size("1000000"), Ok(1_000_000));
        for bad in ["", "M", "-1G", "many", "0", "12Q", "é"] {
            assert!(size(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn counts_as_typed() {
        assert_eq!(count("100M"), Ok(100_000_000));
        assert_eq!(count("1e6"), Ok(1_000_000));
        assert_eq!(count("1_000"), Ok(1000));
        assert_eq!(count("2.5k"), Ok(2500));
        for bad in ["", "-1", "1.5", "x", "1e30", "é"] {
            assert!(count(bad).is_err(), "{bad}");
        }
    }
}
