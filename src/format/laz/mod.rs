//! LAZ: points in compressed chunks, which are independent of each other.
//!
//! ```text
//!  pointwise chunk (formats 0 to 5)     layered chunk (formats 6 to 10)
//!  | first record | one stream … |      | first record | number of points | a size for each layer | layer | layer | … |
//!
//!  table of the chunks:  | version | number of chunks | a stream of sizes, before each the number of points if it varies |
//! ```
//!
//! Whatever the table says is checked before it is believed. If it is right, every job gets a chunk; a chunk of more points than a block may have is decoded by
//! several jobs, each of which passes over what is before its part. Chunks far larger than that, and files without a table that is right, are decompressed one
//! after the other while they are cut, and jobs get records.
//!
//! The decompressor (the crate `laz`) takes layers into memory as long as they claim to be, and fails badly at streams that begin with 32 set bits, which no
//! encoder writes. So both are looked at beforehand. What cannot be seen from outside: its GPS times of layered chunks call themselves for every change of
//! sequence, so that a file that was made for it can use up the stack (`system/stack.rs`). For those of pointwise chunks see `gps.rs`.

pub(crate) mod gps;
mod guard;
pub mod pieces;
mod table;

use std::fmt;
use std::io::{Cursor as IoCursor, ErrorKind, Read, Result as IoResult, Seek};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use byteorder::{ByteOrder, LE};
use laz::las::{v1, v2};
use laz::record::{LayeredPointRecordDecompressor, RecordDecompressor, SequentialPointRecordDecompressor};
use laz::{DecompressionSelection, LazItem, LazItemRecordBuilder, LazItemType, LazVlr};

use self::gps::GpsTimes;
use self::guard::guarded;
use self::table::{Chunk, Entries, Entry};
use crate::error::{Error, Result, overflow};
use crate::format::las::fields::{Field, length};
use crate::format::las::header::Header;
use crate::points::attribute::Schema;
use crate::storage::mapped::Mapped;

/// The most extra bytes of a record: the decompressor has models of 10 KiB for each.
const MAX_EXTRA: usize = 256;

/// The most compressed bytes of layers that are held while chunks are decompressed one after the other.
const MAX_LAYERS: u64 = 32 << 20;

/// Bytes of records that are decompressed at a time: few enough for a core's cache.
const PIECE: usize = 16 << 10;

/// How the points of a file are compressed.
#[derive(Debug)]
pub struct Packed {
    path: PathBuf,
    items: Vec<LazItem>,
    record: usize,
    /// The number of layers of a layered chunk.
    layers: Option<usize>,
    chunks: Chunks,
}

/// How the file is cut into chunks.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Chunks {
    /// There is one, from this byte on.
    One { first: u64 },
    /// The table, which lies at `table`, lists them. All have `size` points but the last, unless it varies.
    Listed { first: u64, table: u64, size: Option<u32> },
    /// Each begins where the one before ends.
    Unlisted { first: u64, size: Option<u32> },
}

impl Packed {
    /// Looks at how the points of a file are compressed.
    ///
    /// # Errors
    /// [`Error::Malformed`] if it is not as it should be.
    pub fn open(file: &Arc<Mapped>, header: &Header) -> Result<Arc<Packed>> {
        let wrong = |place: &str, expected: &dyn fmt::Display, found: &dyn fmt::Display| {
            Error::malformed(file.path(), format_args!("LASzip's record, {place}"), expected, found)
        };
        let content = header.laszip.as_deref().ok_or_else(|| wrong("in the VLRs", &"one", &"none"))?;
        let vlr = guarded(|| LazVlr::from_buffer(content).map_err(std::io::Error::other))
            .map_err(|e| wrong("content", &"a description of the compression", &e))?;
        let compressor = LE::read_u16(content);
        let items = vlr.items().clone();

        let extra = header.record - length(header.point_format).unwrap_or_default();
        if extra > MAX_EXTRA {
            return Err(wrong("items", &format_args!("at most {MAX_EXTRA} extra bytes"), &extra));
        }
        let kinds = |items: &[LazItem]| items.iter().map(|item| (item.item_type(), item.size())).collect::<Vec<_>>();
        let expected = LazItemRecordBuilder::default_for_point_format_id(header.point_format, extra as u16)
            .map_err(|e| wrong("items", &"a point format that LAZ has", &e))?;
        if kinds(&items) != kinds(&expected) {
            let place = format!("items of point format {}, {} bytes", header.point_format, header.record);
            let shown = |items: &[LazItem]| format!("{:?}", kinds(items));
            return Err(wrong(&place, &shown(&expected), &shown(&items)));
        }
        let layered = header.point_format >= 6;
        let versions = if layered { 3..=4 } else { 1..=2 };
        if let Some(item) = items.iter().find(|item| !versions.contains(&item.version())) {
            return Err(wrong("version of an item", &format_args!("{versions:?}"), &item.version()));
        }
        let layers = layered.then(|| items.iter().map(|item| layers(item.item_type())).sum());

        let size = Some(vlr.chunk_size()).filter(|_| !vlr.uses_variable_size_chunks());
        let chunks = match (compressor, layered) {
            (1, false) => Chunks::One { first: header.start },
            (2, false) | (3, true) => Self::listed(file, header, size),
            _ => {
                let expected = if layered { "3 (layered chunks)" } else { "1 or 2 (pointwise)" };
                return Err(wrong("kind of compression", &expected, &compressor));
            }
        };
        if let (Chunks::Unlisted { size: None, .. }, false) = (chunks, layered) {
            let expected = "a table of the chunks, without which nothing tells how many points each has";
            return Err(Error::malformed(file.path(), "chunks of varying size", expected, "none that is right"));
        }
        let (path, record) = (file.path().to_path_buf(), header.record);
        Ok(Arc::new(Packed { path, items, record, layers, chunks }))
    }

    /// Finds the table, and whether it is right: all chunks lie between the first and the table, and hold all points.
    fn listed(file: &Arc<Mapped>, header: &Header, size: Option<u32>) -> Chunks {
        let first = header.start + 8;
        let unlisted = Chunks::Unlisted { first: first.min(file.len()), size };
        let place = |at: u64| Some(LE::read_u64(&file.read(at..at + 8).ok()?));
        if file.len() < first + 8 {
            return unlisted;
        }
        // A writer that could not go back left the place at the file's end.
        let stated = place(header.start).filter(|&at| at > header.start && at <= i64::MAX as u64);
        let Some(table) = stated.or_else(|| place(file.len() - 8)) else { return unlisted };
        if table < first || table > file.len() - 8 {
            return unlisted;
        }
        let right = || -> IoResult<bool> {
            let mut entries = Entries::open(file, table, size)?;
            let room = (table - first) / header.record as u64;
            if u64::from(entries.left) > room + 1 {
                return Ok(false);
            }
            let (mut points, mut end) = (0u64, first);
            while points < header.count {
                let Some(Entry { points: more, bytes }) = entries.next()? else { return Ok(false) };
                if more > 0 && bytes < header.record as u64 || end + bytes > table {
                    return Ok(false);
                }
                points += more;
                end += bytes;
            }
            Ok(true)
        };
        if right().unwrap_or(false) { Chunks::Listed { first, table, size } } else { unlisted }
    }

    /// Tells of each chunk that holds some of `count` points where it begins, its bytes and its points; where the first begins, or None if no table lists them.
    pub fn each_chunk(&self, file: &Arc<Mapped>, count: u64, tell: &mut dyn FnMut(u64, u64, u64)) -> Option<u64> {
        let Chunks::Listed { first, table, size } = self.chunks else { return None };
        let mut entries = Entries::open(file, table, size).ok()?;
        let (mut at, mut left) = (first, count);
        while left > 0 {
            let Entry { points, bytes } = entries.next().ok().flatten()?;
            tell(at, bytes, points.min(left));
            (at, left) = (at.checked_add(bytes)?, left - points.min(left));
        }
        Some(first)
    }

    /// What a chunk that begins with `head` says of itself that the decompressor would believe. `at` gives four bytes so far from the chunk's beginning.
    fn check(&self, length: u64, at: impl Fn(u64) -> Result<Option<u32>>) -> Result<std::result::Result<(), String>> {
        const NO_STREAM: Option<u32> = Some(u32::MAX);
        let record = self.record as u64;
        let Some(layers) = self.layers else {
            return Ok(if at(record)? == NO_STREAM { Err("a stream that cannot be".to_string()) } else { Ok(()) });
        };
        let mut begin = record + 4 + 4 * layers as u64;
        for layer in 0..layers as u64 {
            let Some(size) = at(record + 4 + 4 * layer)? else {
                return Ok(Err("its end in the sizes of layers".to_string()));
            };
            let end = begin + u64::from(size);
            if end > length {
                return Ok(Err(format!("layers of {end} bytes and more, in a chunk of {length}")));
            }
            if size >= 4 && at(begin)? == NO_STREAM {
                return Ok(Err("a layer that cannot be".to_string()));
            }
            begin = end;
        }
        if begin > MAX_LAYERS {
            return Ok(Err(format!("layers of {begin} bytes, more than the {MAX_LAYERS} that are supported")));
        }
        Ok(Ok(()))
    }

    /// The decompressor of a pointwise chunk.
    fn pointwise<'a, R: Read + 'a>(&self, input: R) -> SequentialPointRecordDecompressor<'a, R> {
        let mut fields = SequentialPointRecordDecompressor::new(input);
        for item in &self.items {
            match (item.item_type(), item.version()) {
                (LazItemType::Point10, 1) => fields.add_field_decompressor(v1::LasPoint0Decompressor::default()),
                (LazItemType::Point10, _) => fields.add_field_decompressor(v2::LasPoint0Decompressor::default()),
                (LazItemType::GpsTime, 1) => fields.add_field_decompressor(v1::LasGpsTimeDecompressor::default()),
                (LazItemType::GpsTime, _) => fields.add_field_decompressor(GpsTimes::default()),
                (LazItemType::RGB12, 1) => fields.add_field_decompressor(v1::LasRGBDecompressor::default()),
                (LazItemType::RGB12, _) => fields.add_field_decompressor(v2::LasRGBDecompressor::default()),
                (LazItemType::Byte(n), 1) => fields.add_field_decompressor(v1::LasExtraByteDecompressor::new(n.into())),
                (LazItemType::Byte(n), _) => fields.add_field_decompressor(v2::LasExtraByteDecompressor::new(n.into())),
                // There is no other version of it.
                (LazItemType::WavePacket13, _) => {
                    fields.add_field_decompressor(v1::LasWavepacketDecompressor::default())
                }
                (other, _) => unreachable!("{other:?} in a pointwise chunk, whose items were checked"),
            }
        }
        fields
    }

    /// The decompressor of a layered chunk, for the layers that are wanted.
    fn layered<'a, R: Read + Seek + 'a>(
        &self,
        input: R,
        wanted: DecompressionSelection,
    ) -> IoResult<LayeredPointRecordDecompressor<'a, R>> {
        let mut layered = LayeredPointRecordDecompressor::new(input);
        layered.set_fields_from(&self.items).map_err(std::io::Error::other)?;
        layered.set_selection(wanted);
        Ok(layered)
    }

    /// Decompresses the chunk that `input` begins with: `skip` points that are passed over, then `take`, which `sink` gets in pieces.
    fn decompress(
        &self,
        input: &[u8],
        wanted: DecompressionSelection,
        skip: u64,
        take: u64,
        sink: impl FnMut(&[u8]),
    ) -> Stopped {
        match self.layers {
            None => self.points_of(&mut self.pointwise(input), skip, take, sink),
            Some(_) => {
                let layered = self.layered(IoCursor::new(input), wanted);
                self.points_of(&mut layered.map_err(|error| (0, error))?, skip, take, sink)
            }
        }
    }

    fn points_of<R>(
        &self,
        decompressor: &mut impl RecordDecompressor<R>,
        skip: u64,
        take: u64,
        mut sink: impl FnMut(&[u8]),
    ) -> Stopped {
        let at = |done: u64| move |error: std::io::Error| (done, error);
        let mut piece = vec![0; (PIECE / self.record).max(1) * self.record];
        let mut passed = 0;
        self.guarded(|| {
            while passed < skip {
                decompressor.decompress_next(&mut piece[..self.record])?;
                passed += 1;
            }
            Ok(())
        })
        .map_err(at(passed))?;
        let mut done = 0;
        while done < take {
            let records = ((piece.len() / self.record) as u64).min(take - done);
            let piece = &mut piece[..records as usize * self.record];
            let mut here = 0;
            self.guarded(|| {
                for record in piece.chunks_exact_mut(self.record) {
                    decompressor.decompress_next(record)?;
                    here += 1;
                }
                Ok(())
            })
            .map_err(at(skip + done + here))?;
            sink(piece);
            done += records;
        }
        Ok(())
    }

    /// [`guarded`], and an error where the stack is used up.
    fn guarded<R>(&self, work: impl FnOnce() -> IoResult<R>) -> IoResult<R> {
        match self.layers {
            None => guarded(work),
            Some(_) => overflow::told(&self.path, || guarded(work)),
        }
    }

    fn broken(&self, chunk: Chunk, found: impl fmt::Display) -> Error {
        broken(&self.path, chunk, found)
    }
}

/// How decompressing ended: in good order, or after so many points.
type Stopped = std::result::Result<(), (u64, std::io::Error)>;

/// The error for a chunk in which something else was `found`.
fn broken(path: &Path, Chunk { number, at, points }: Chunk, found: impl fmt::Display) -> Error {
    let place = format_args!("chunk {number}, byte {at}").to_string();
    Error::malformed(path, place, format_args!("{points} compressed points"), found)
}

/// What is found where decompressing `chunk` stopped.
fn stopped(path: &Path, chunk: Chunk, (done, error): (u64, std::io::Error)) -> Error {
    match error.kind() {
        ErrorKind::UnexpectedEof => broken(path, chunk, format_args!("its end after {done}")),
        _ => match error.downcast::<Error>() {
            Ok(own) => own,
            Err(error) => broken(path, chunk, format_args!("{error} after {done}")),
        },
    }
}

impl fmt::Display for Packed {
    /// What is to be said of the compression, behind other things.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.chunks {
            Chunks::Listed { .. } => Ok(()),
            Chunks::One { .. } => f.write_str(", in one chunk, which one thread decompresses"),
            Chunks::Unlisted { .. } => {
                f.write_str(", without a table of chunks that is right, so that one thread decompresses them")
            }
        }
    }
}

/// The number of layers that an item of a layered chunk has.
fn layers(item: LazItemType) -> usize {
    match item {
        LazItemType::Point14 => 9,
        LazItemType::RGBNIR14 => 2,
        LazItemType::Byte14(bytes) => usize::from(bytes),
        _ => 1,
    }
}

/// What layers must be decompressed for the attributes of a schema.
pub fn selection(fields: &[Field], schema: &Schema) -> DecompressionSelection {
    let names = fields.iter().map(|field| field.attribute.name.as_str()).filter(|name| schema.column(name).is_some());
    names.fold(DecompressionSelection::base().decompress_z(), |wanted, name| match name {
        "return_number" | "number_of_returns" | "scanner_channel" => wanted,
        "classification" => wanted.decompress_classification(),
        "synthetic" | "key_point" | "withheld" | "overlap" | "scan_direction" | "edge_of_flight_line" => {
            wanted.decompress_flags()
        }
        "intensity" => wanted.decompress_intensity(),
        "scan_angle" => wanted.decompress_scan_angle(),
        "user_data" => wanted.decompress_user_data(),
        "point_source_id" => wanted.decompress_point_source_id(),
        "gps_time" => wanted.decompress_gps_time(),
        "red" | "green" | "blue" => wanted.decompress_rgb(),
        "nir" => wanted.decompress_nir(),
        _ => wanted.decompress_extra_bytes(),
    })
}
