//! LAS 1.4 and LAZ files of points with their classes: point format 6, in the order that points are given.

use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::Path;

use byteorder::{ByteOrder, LE};
use laz::{LasZipCompressor, LazVlr, LazVlrBuilder};

use crate::error::{Error, Result};
use crate::points::bounds::Bounds;
use crate::points::crs::Crs;
use crate::storage::atomic_file::AtomicFile;

/// Bytes of a record of point format 6.
pub const RECORD: usize = 30;
/// Bytes of the header.
const HEADER: usize = 375;
/// Points that are compressed together.
const CHUNK: u32 = 50_000;

/// A point as it is written.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ClassifiedPoint {
    /// Its coordinates.
    pub place: [f64; 3],
    /// How strong the echo was.
    pub intensity: u16,
    /// Which of a pulse's returns it is, and of how many: 0 to 15.
    pub returns: [u8; 2],
    /// Its class.
    pub class: u8,
    /// Where the beam was led to, in steps of 0.006 degrees.
    pub scan_angle: i16,
    /// The flight line.
    pub source: u16,
    /// When it was measured.
    pub time: f64,
}

/// How coordinates become whole numbers: (coordinate − offset) / step, rounded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Steps {
    /// The length of a step.
    pub step: f64,
    /// What is taken off first.
    pub offset: [f64; 3],
}

impl Steps {
    /// Steps of 10^−`digits` for points within `bounds`, or larger ones, tenfold each, where these are too many for 32 bits.
    pub fn of(bounds: &Bounds, digits: i32) -> Steps {
        let offset = bounds.min.map(f64::floor);
        let longest = (0..3).map(|a| bounds.max[a] - offset[a]).fold(0.0, f64::max);
        // The nearest numbers to powers of ten, on every machine.
        let step = |digits: i32| format!("1e{}", -digits).parse::<f64>().unwrap_or(f64::MAX);
        let fits = |digits: &i32| longest / step(*digits) < f64::from(i32::MAX);
        let digits = (-300..=digits).rev().find(fits).unwrap_or(-300);
        Steps { step: step(digits), offset }
    }
}

/// A file in the making.
pub struct ClassifiedFile {
    file: AtomicFile,
    out: Out,
    steps: Steps,
    /// What is known of the header only now: points, by return, and their box in steps.
    points: u64,
    by_return: [u64; 15],
    low: [i32; 3],
    high: [i32; 3],
    header: Vec<u8>,
    records: Vec<u8>,
}

enum Out {
    Plain(BufWriter<File>),
    Packed(Box<LasZipCompressor<'static, BufWriter<File>>>),
}

impl std::fmt::Debug for ClassifiedFile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ClassifiedFile").field("file", &self.file).finish_non_exhaustive()
    }
}

/// Whether a name is that of a LAZ file, or of a LAS file; `None` for others.
pub fn is_packed(path: &Path) -> Option<bool> {
    match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("laz") => Some(true),
        Some("las") => Some(false),
        _ => None,
    }
}

impl ClassifiedFile {
    /// Begins to fill a file; LAZ if its name ends in .laz.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn begin(file: AtomicFile, steps: Steps, crs: Option<&Crs>) -> Result<ClassifiedFile> {
        let path = file.path();
        let failed = |error| Error::io(path, "write")(error);
        let vlr = is_packed(path).unwrap_or(false).then(laszip).transpose().map_err(|e| failed(other(e)))?;
        let mut records = crs.map(crs_records).unwrap_or_default();
        if let Some(vlr) = &vlr {
            let mut content = Vec::new();
            vlr.write_to(&mut content).map_err(failed)?;
            records.push(record(LazVlr::USER_ID, LazVlr::RECORD_ID, &content));
        }
        let mut header = vec![0; HEADER];
        header[..4].copy_from_slice(b"LASF");
        // Text tells the reference system; GeoTIFF keys do where there is none.
        let is_text = crs.is_none_or(|crs| crs.wkt.is_some());
        LE::write_u16(&mut header[6..], if is_text { 1 << 4 } else { 0 });
        [header[24], header[25]] = [1, 4];
        header[26..26 + 5].copy_from_slice(b"OTHER");
        header[58..58 + 11].copy_from_slice(b"asra-stream");
        LE::write_u16(&mut header[94..], HEADER as u16);
        LE::write_u32(&mut header[100..], records.len() as u32);
        records.iter().for_each(|record| header.extend_from_slice(record));
        let start = header.len() as u32;
        LE::write_u32(&mut header[96..], start);
        header[104] = 6 | if vlr.is_some() { 0x80 } else { 0 };
        LE::write_u16(&mut header[105..], RECORD as u16);
        for a in 0..3 {
            LE::write_f64(&mut header[131 + 8 * a..], steps.step);
            LE::write_f64(&mut header[155 + 8 * a..], steps.offset[a]);
        }
        let mut plain = BufWriter::with_capacity(1 << 16, file.file().try_clone().map_err(failed)?);
        plain.write_all(&header).map_err(failed)?;
        let out = match vlr {
            None => Out::Plain(plain),
            Some(vlr) => {
                let mut packed = LasZipCompressor::new(plain, vlr).map_err(|e| failed(other(e)))?;
                packed.reserve_offset_to_chunk_table().map_err(failed)?;
                Out::Packed(Box::new(packed))
            }
        };
        let (low, high) = ([i32::MAX; 3], [i32::MIN; 3]);
        Ok(ClassifiedFile { file, out, steps, points: 0, by_return: [0; 15], low, high, header, records: Vec::new() })
    }

    /// Adds points.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn append(&mut self, points: &[ClassifiedPoint]) -> Result<()> {
        self.records.clear();
        for point in points {
            let at = self.records.len();
            self.records.resize(at + RECORD, 0);
            let record = &mut self.records[at..];
            for a in 0..3 {
                let steps = ((point.place[a] - self.steps.offset[a]) / self.steps.step).round() as i32;
                (self.low[a], self.high[a]) = (self.low[a].min(steps), self.high[a].max(steps));
                LE::write_i32(&mut record[4 * a..], steps);
            }
            let returns = point.returns.map(|number| number.min(15));
            LE::write_u16(&mut record[12..], point.intensity);
            record[14] = returns[0] | returns[1] << 4;
            record[16] = point.class;
            LE::write_i16(&mut record[18..], point.scan_angle);
            LE::write_u16(&mut record[20..], point.source);
            LE::write_f64(&mut record[22..], point.time);
            if let Some(count) =
                usize::from(returns[0]).checked_sub(1).and_then(|number| self.by_return.get_mut(number))
            {
                *count += 1;
            }
        }
        self.points += points.len() as u64;
        match &mut self.out {
            Out::Plain(out) => out.write_all(&self.records),
            Out::Packed(out) => out.compress_many(&self.records),
        }
        .map_err(Error::io(self.file.path(), "write"))
    }

    /// The file, once it is whole; it has no name yet.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn filled(mut self) -> Result<AtomicFile> {
        let path = self.file.path().to_path_buf();
        let header = &mut self.header;
        LE::write_u64(&mut header[247..], self.points);
        for (number, count) in self.by_return.iter().enumerate() {
            LE::write_u64(&mut header[255 + 8 * number..], *count);
        }
        if self.points > 0 {
            for a in 0..3 {
                let place = |steps: i32| f64::from(steps) * self.steps.step + self.steps.offset[a];
                LE::write_f64(&mut header[179 + 16 * a..], place(self.high[a]));
                LE::write_f64(&mut header[187 + 16 * a..], place(self.low[a]));
            }
        }
        let finish = || {
            let mut out = match self.out {
                Out::Plain(out) => out,
                Out::Packed(mut out) => {
                    out.done()?;
                    out.into_inner()
                }
            };
            out.flush()?;
            out.seek(SeekFrom::Start(0))?;
            out.write_all(header)?;
            out.flush()
        };
        finish().map_err(Error::io(&path, "write"))?;
        Ok(self.file)
    }
}

fn other(error: laz::LasZipError) -> std::io::Error {
    std::io::Error::other(error)
}

fn laszip() -> std::result::Result<LazVlr, laz::LasZipError> {
    Ok(LazVlrBuilder::default().with_point_format(6, 0)?.with_fixed_chunk_size(CHUNK).build())
}

/// A variable-length record.
fn record(user: &str, number: u16, content: &[u8]) -> Vec<u8> {
    let mut out = vec![0; 54];
    out[2..2 + user.len()].copy_from_slice(user.as_bytes());
    LE::write_u16(&mut out[18..], number);
    LE::write_u16(&mut out[20..], content.len() as u16);
    out.extend_from_slice(content);
    out
}

/// The records that tell a reference system: its text, or GeoTIFF keys with its code.
fn crs_records(crs: &Crs) -> Vec<Vec<u8>> {
    const USER: &str = "LASF_Projection";
    match (&crs.wkt, crs.epsg.and_then(|code| u16::try_from(code).ok())) {
        // A record holds less than 64 KiB.
        (Some(wkt), _) if wkt.len() < 65_000 => vec![record(USER, 2112, format!("{wkt}\0").as_bytes())],
        (_, Some(code)) => {
            let degrees = matches!(crs.measure(), Some(crate::points::unit::Measure::Degrees));
            let (model, key) = if degrees { (2, 2048) } else { (1, 3072) };
            let mut keys = vec![1u16, 1, 0, 2, 1024, 0, 1, model, key, 0, 1, code];
            if let Some(heights) = crs.vertical.and_then(|code| u16::try_from(code).ok()) {
                keys[3] = 3;
                keys.extend([4096, 0, 1, heights]);
            }
            let bytes: Vec<u8> = keys.iter().flat_map(|key| key.to_le_bytes()).collect();
            vec![record(USER, 34735, &bytes)]
        }
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::storage::atomic_file::Overwrite;

    fn point() -> impl Strategy<Value = ClassifiedPoint> {
        let place = (0i32..1_000_000, 0i32..1_000_000, -5000i32..5000);
        (place, any::<u16>(), (0u8..16, 0u8..16), any::<u8>(), any::<i16>(), any::<u16>(), 0.0f64..1e9).prop_map(
            |((x, y, z), intensity, (first, of), class, scan_angle, source, time)| ClassifiedPoint {
                place: [500_000.0 + f64::from(x) / 100.0, 6e6 + f64::from(y) / 100.0, f64::from(z) / 100.0],
                intensity,
                returns: [first, of],
                class,
                scan_angle,
                source,
                time,
            },
        )
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        /// Another implementation reads what was written.
        #[test]
        fn what_is_written_is_read(points in prop::collection::vec(point(), 0..200), packed in any::<bool>()) {
            let dir = tempfile::tempdir().unwrap();
            let path = dir.path().join(if packed { "a.laz" } else { "a.LAS" });
            let bounds = Bounds { min: [500_000.0, 6e6, -50.0], max: [510_000.0, 6.01e6, 50.0] };
            let crs = Crs::given("EPSG:2154").unwrap();
            let file = AtomicFile::create(&path, Overwrite::Refuse).unwrap();
            let mut file = ClassifiedFile::begin(file, Steps::of(&bounds, 2), crs.as_ref()).unwrap();
            points.chunks(64).for_each(|points| file.append(points).unwrap());
            file.filled().unwrap().finish().unwrap();
            let mut reader = las::Reader::from_path(&path).unwrap();
            prop_assert_eq!(reader.header().number_of_points(), points.len() as u64);
            let read: Vec<las::Point> = reader.read_all().unwrap().points().map(|point| point.unwrap()).collect();
            prop_assert_eq!(read.len(), points.len());
            for (read, point) in read.iter().zip(&points) {
                let place = [read.x, read.y, read.z];
                prop_assert!((0..3).all(|a| (place[a] - point.place[a]).abs() < 1e-6), "{:?} {:?}", place, point.place);
                prop_assert_eq!(read.intensity, point.intensity);
                prop_assert_eq!([read.return_number, read.number_of_returns], point.returns);
                // Class 12 is a flag to that reader.
                prop_assert!(point.class == 12 || u8::from(read.classification) == point.class);
                prop_assert_eq!(read.point_source_id, point.source);
                prop_assert_eq!(read.gps_time, Some(point.time));
            }
        }
    }

    #[test]
    fn steps_are_as_fine_as_32_bits_hold() {
        let bounds = |most: f64| Bounds { min: [10.5, 0.0, 0.0], max: [most, 0.0, 0.0] };
        assert_eq!(Steps::of(&bounds(100.0), 2), Steps { step: 0.01, offset: [10.0, 0.0, 0.0] });
        assert_eq!(Steps::of(&bounds(1e8), 2).step, 0.1);
        assert_eq!(Steps::of(&bounds(1e300), 5).step, 1e291);
    }
}
