//! Raw files: records of numbers and nothing else, described by the command line, a side-car, or their statistics.

use std::path::PathBuf;
use std::sync::Arc;

use super::layout::Layout;
use super::records::{FixedRecords, RecordShape};
use super::sidecar::Sidecar;
use crate::error::{Error, Result};
use crate::format::detect_layout;
use crate::format::options::InputOptions;
use crate::format::point_format::{PointFormat, Source};
use crate::storage::mapped::Mapped;

/// Where a raw file's layout comes from.
#[derive(Debug, Clone, PartialEq)]
pub enum Description {
    /// `--layout`.
    Given(Layout),
    /// The file of the same name with `.json` behind it.
    Sidecar(Sidecar),
    /// Nothing says: the content is examined.
    Unknown,
}

impl Description {
    /// What is known about a raw file that goes by `names`. A given layout goes before a side-car, which is then not read.
    ///
    /// # Errors
    /// If there is a side-car and it is malformed.
    pub fn of(names: &[PathBuf], options: &InputOptions) -> Result<Description> {
        if let Some(layout) = &options.layout {
            return Ok(Description::Given(layout.clone()));
        }
        for name in names {
            if let Some(sidecar) = Sidecar::beside(name)? {
                return Ok(Description::Sidecar(sidecar));
            }
        }
        Ok(Description::Unknown)
    }
}

/// Opens `file` as records.
///
/// # Errors
/// [`Error::Malformed`] if its size is not a whole number of records or not the side-car's;
/// [`Error::AmbiguousLayout`] if nothing says how to read it and its content does not either.
pub fn open(file: &Mapped, description: Description, options: &InputOptions) -> Result<(Source, Arc<dyn PointFormat>)> {
    let mut start = options.skip_bytes.unwrap_or(0);
    let mut endian = options.endian.unwrap_or_default();
    let mut transform = None;
    let mut promised = None;
    let mut crs = None;
    let (layout, origin) = match description {
        Description::Given(layout) => (layout, "given"),
        Description::Sidecar(sidecar) => {
            start = options.skip_bytes.unwrap_or(sidecar.skip);
            endian = options.endian.unwrap_or(sidecar.endian);
            transform = sidecar.transform();
            promised = sidecar.count;
            crs = sidecar.crs;
            (sidecar.layout, "from its side-car")
        }
        Description::Unknown => {
            let skipped = start.min(file.len());
            (detect_layout::detect(file, skipped, endian)?, "detected")
        }
    };
    let stride = layout.stride() as u64;
    let content = file.len().checked_sub(start).ok_or_else(|| {
        let expected = format_args!("more than the {start} bytes to skip").to_string();
        Error::malformed(file.path(), "length", expected, format_args!("{} bytes", file.len()))
    })?;
    if content % stride != 0 {
        return Err(Error::malformed(
            file.path(),
            "length",
            format_args!("a multiple of {stride} bytes (layout {layout}) after the first {start}"),
            format_args!("{content} bytes, {} left over", content % stride),
        ));
    }
    let count = content / stride;
    if let Some(promised) = promised.filter(|&promised| promised != count) {
        let expected = format_args!("{promised} records of {stride} bytes, as the side-car says").to_string();
        return Err(Error::malformed(file.path(), "length", expected, format_args!("{count} records")));
    }
    let advice = if origin == "detected" { format!("; pass --layout {layout} to fix") } else { String::new() };
    let source = Source {
        path: file.path().to_path_buf(),
        format: "raw",
        description: format!("raw {layout} {endian} ({origin}{advice})"),
        records: Some(count),
        bytes: file.len(),
        crs,
        remark: None,
    };
    let shape = RecordShape::of(&layout, endian, transform);
    Ok((source, Arc::new(FixedRecords::new(file, start, count, shape))))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::testing::{collect, points_of};
    use super::*;
    use crate::points::scalar::Endian;

    #[test]
    fn a_size_that_is_no_multiple_states_both_numbers() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.bin");
        std::fs::write(&path, vec![0u8; 50]).unwrap();
        let options = InputOptions { layout: Some("xyz".parse().unwrap()), ..InputOptions::default() };
        let error = collect(&path, &options).unwrap_err().to_string();
        assert!(error.contains("multiple of 12 bytes") && error.contains("50 bytes, 2 left over"), "{error}");
        let skipping = InputOptions { skip_bytes: Some(2), ..options.clone() };
        assert_eq!(points_of(&path, &skipping).len(), 4);
        let beyond = InputOptions { skip_bytes: Some(51), ..options };
        assert!(collect(&path, &beyond).unwrap_err().to_string().contains("51 bytes to skip"));
    }

    #[test]
    fn records_with_nan_or_infinity_are_counted_and_left_out() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.bin");
        let values = [1.0f32, 2.0, 3.0, f32::NAN, 0.0, 0.0, 0.0, f32::INFINITY, 0.0, 4.0, 5.0, 6.0];
        std::fs::write(&path, bytemuck::cast_slice(&values)).unwrap();
        let options = InputOptions { layout: Some("xyz".parse().unwrap()), ..InputOptions::default() };
        let (points, dropped) = collect(&path, &options).unwrap();
        assert_eq!((points, dropped), (vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], 2));
    }

    #[test]
    fn a_side_car_scales_skips_and_checks_the_count() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.dat");
        let mut bytes = b"HEAD".to_vec();
        [100i32, 200, 300, -100, 0, 7].iter().for_each(|v| bytes.extend(v.to_be_bytes()));
        std::fs::write(&path, &bytes).unwrap();
        let sidecar = dir.path().join("a.dat.json");
        let text = r#"{"version":1,"fields":[["x","i4"],["y","i4"],["z","i4"]],"endian":"be","skip":4,
            "scale":[0.5,0.5,0.5],"offset":[1000,0,0],"srs":"EPSG:25832","count":2}"#;
        std::fs::write(&sidecar, text).unwrap();
        assert_eq!(points_of(&path, &InputOptions::default()), [[1050.0, 100.0, 150.0], [950.0, 0.0, 3.5]]);
        std::fs::write(&sidecar, text.replace("\"count\":2", "\"count\":3")).unwrap();
        let error = collect(&path, &InputOptions::default()).unwrap_err().to_string();
        assert!(error.contains("3 records of 12 bytes") && error.contains("found 2 records"), "{error}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn what_is_written_is_read(points in prop::collection::vec(any::<[i16; 3]>(), 1..200), big: bool, pad in 0usize..9) {
            let dir = tempfile::tempdir().unwrap();
            let path = dir.path().join("a.raw");
            let mut bytes = Vec::new();
            for [x, y, z] in &points {
                bytes.extend(vec![0x5a; pad]);
                for v in [z, x, y] {
                    bytes.extend(if big { v.to_be_bytes() } else { v.to_le_bytes() });
                }
            }
            std::fs::write(&path, &bytes).unwrap();
            let layout = Some(format!("_:{pad},zxy:i16").parse().unwrap());
            let endian = Some(if big { Endian::Big } else { Endian::Little });
            let read = points_of(&path, &InputOptions { layout, endian, ..InputOptions::default() });
            prop_assert_eq!(read, points.iter().map(|p| p.map(f64::from)).collect::<Vec<_>>());
        }
    }
}
