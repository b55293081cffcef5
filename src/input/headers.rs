//! What the headers of a cloud's files told: enough for whoever reads none of the files again, or few of them.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::{Cloud, InputOptions, Opening, Source};
use crate::error::{Error, Result};
use crate::format::point_format::{BlockCutter, PointFormat};
use crate::points::Precision;
use crate::points::attribute::{Attribute, Schema};
use crate::points::crs::{Crs, KeyedUnit};

/// The headers of all files of a cloud, in reading order.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Headers(Vec<Header>);

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Header {
    format: String,
    description: String,
    records: Option<u64>,
    bytes: u64,
    crs: Option<Crs>,
    /// The system's units as keys told them, of which [`Crs`] as text says nothing.
    units: [Option<KeyedUnit>; 2],
    remark: Option<String>,
    precision: Precision,
    attributes: Vec<Attribute>,
    /// The bits of places.
    stations: Vec<[u64; 3]>,
}

/// The names of formats that files may have.
const FORMATS: [&str; 11] = ["raw", "PLY", "LAS", "LAZ", "E57", "PCD", "NPY", "STL", "OBJ", "text", "memory"];

impl Header {
    fn of(source: &Source, format: &dyn PointFormat) -> Header {
        let Source { path: _, format: name, description, records, bytes, crs, remark } = source.clone();
        let units = crs.as_ref().map_or([None; 2], |crs| [crs.unit, crs.height_unit]);
        let stations = format.stations().into_iter().map(|place| place.map(f64::to_bits)).collect();
        let (precision, attributes) = (format.precision(), format.attributes().to_vec());
        Header {
            format: name.to_owned(),
            description,
            records,
            bytes,
            crs,
            units,
            remark,
            precision,
            attributes,
            stations,
        }
    }

    /// The file at `path`, as it was understood.
    fn source(&self, path: &Path) -> Source {
        let Header { description, records, bytes, crs, units: [unit, height_unit], remark, .. } = self.clone();
        Source {
            path: path.to_path_buf(),
            format: FORMATS.into_iter().find(|name| *name == self.format).unwrap_or("unknown"),
            description,
            records,
            bytes,
            crs: crs.map(|crs| Crs { unit, height_unit, ..crs }),
            remark,
        }
    }
}

/// A file whose header is known, and which nobody reads.
#[derive(Debug)]
struct Unread {
    path: PathBuf,
    header: Header,
}

impl PointFormat for Unread {
    fn precision(&self) -> Precision {
        self.header.precision
    }

    fn attributes(&self) -> &[Attribute] {
        &self.header.attributes
    }

    fn stations(&self) -> Vec<[f64; 3]> {
        self.header.stations.iter().map(|place| place.map(f64::from_bits)).collect()
    }

    fn cut(&self, _: &Schema) -> Result<Box<dyn BlockCutter<'_> + '_>> {
        Err(Error::Internal(format!("{} is read, and was not opened", self.path.display())))
    }
}

impl Cloud<'_> {
    /// What its files' headers told.
    pub(crate) fn headers(&self) -> Headers {
        let files = self.sources.iter().zip(&self.formats);
        Headers(files.map(|(source, format)| Header::of(source, &**format)).collect())
    }
}

impl Cloud<'static> {
    /// The cloud of files whose headers are known; those whose numbers `is_read` are opened, as [`Cloud::open_in`] does it, and no other may be read.
    ///
    /// # Errors
    /// Those of [`Cloud::open_in`].
    pub(crate) fn of_headers(
        files: &[PathBuf],
        headers: &Headers,
        is_read: impl Fn(usize) -> bool,
        options: &InputOptions,
        opening: Opening,
    ) -> Result<Cloud<'static>> {
        if files.len() != headers.0.len() {
            return Err(Error::Internal(format!("{} files with {} headers", files.len(), headers.0.len())));
        }
        Cloud::opened(files, options, opening, |number| {
            let header = headers.0.get(number).filter(|_| !is_read(number))?;
            let path = files[number].clone();
            let format: Arc<dyn PointFormat> = Arc::new(Unread { path, header: header.clone() });
            Some((header.source(&files[number]), format))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::storage::spool::Workspace;

    #[test]
    fn a_cloud_of_headers_tells_what_the_opened_one_does_and_reads_what_it_may() {
        let dir = tempfile::tempdir().unwrap();
        let files = ["a.xyz", "b.xyz", "c.bin"].map(|name| dir.path().join(name)).to_vec();
        std::fs::write(&files[0], "1 2 3\n").unwrap();
        std::fs::write(&files[1], "4.5 5 6\n7 8 9\n").unwrap();
        std::fs::write(&files[2], bytemuck::cast_slice(&[0.1f32, 2.0, 3.0])).unwrap();
        let (options, workspace) = (InputOptions::default(), Workspace::unchecked(dir.path().to_path_buf()));
        macro_rules! opening {
            () => {
                Opening { workspace: &workspace, memory: 1 << 20, decompress: None, watch: &mut |_| Ok(()) }
            };
        }
        let whole = Cloud::open_in(&files, &options, opening!()).unwrap();
        let headers = serde_json::from_value(serde_json::to_value(whole.headers()).unwrap()).unwrap();
        assert_eq!(whole.headers(), headers);
        // Whoever may not read a file does not need it.
        std::fs::remove_file(&files[0]).unwrap();
        let some = Cloud::of_headers(&files, &headers, |number| number == 1, &options, opening!()).unwrap();
        assert_eq!(some.sources(), whole.sources());
        assert_eq!((some.precision(), some.schema()), (whole.precision(), whole.schema()));
        assert_eq!(some.headers(), headers);
        let mut blocks = some.blocks(crate::input::Carried::Coordinates);
        assert!(matches!(blocks.next_block(), Err(Error::Internal(_))), "the first is not open");
        let segment = crate::input::Segment(vec![(1, 0..u64::MAX)]);
        let mut blocks = some.blocks(crate::input::Carried::Coordinates).within(Some(&segment));
        assert!(blocks.next_block().unwrap().is_some() && blocks.next_block().unwrap().is_none());
    }
}
