//! A LAZ file in pieces: whole chunks and parts of them, for jobs to decompress, or records that were decompressed on the way.

use std::sync::Arc;

use byteorder::{ByteOrder, LE};
use laz::DecompressionSelection;
use laz::record::RecordDecompressor;

use super::table::{Chunk, Entries, Entry};
use super::{Chunks, Packed, stopped};
use crate::error::{Error, Result};
use crate::format::las::fields::Decoding;
use crate::format::las::window::Window;
use crate::format::point_format::{BLOCK_RECORDS, BlockCutter, Decode, Uncounted, records_of_a_block};
use crate::format::unpack::Unpacking;
use crate::points::Batch;
use crate::resources::workers::{Spares, Workers};
use crate::storage::mapped::{Bytes, Content, Mapped};

/// The most compressed bytes that a job is given.
const MAX_CHUNK: u64 = 8 << 20;

/// The most jobs for a chunk: half of what they decode they pass over.
const MAX_PARTS: u64 = 4;

/// One pass over the records of a LAZ file.
pub struct Cutter {
    file: Arc<Mapped>,
    packed: Arc<Packed>,
    wanted: DecompressionSelection,
    entries: Option<Entries>,
    /// The number of the next chunk, where it begins, and how many points are left from there on.
    number: u64,
    at: u64,
    left: u64,
    state: State,
}

enum State {
    /// The next chunk is to be looked at.
    Between,
    /// A chunk of `bytes` bytes, of which `given` points are given out to jobs.
    Parted { chunk: Chunk, bytes: u64, given: u64 },
    /// A chunk is decompressed here.
    Running(Running),
    /// A chunk of so many points is not there.
    Absent(u64),
}

impl Cutter {
    /// Starts at the first chunk; `count` points are to be read.
    pub fn new(file: Arc<Mapped>, packed: Arc<Packed>, count: u64, wanted: DecompressionSelection) -> Result<Cutter> {
        let (at, entries) = match packed.chunks {
            Chunks::One { first } | Chunks::Unlisted { first, .. } => (first, None),
            Chunks::Listed { first, table, size } => {
                let entries =
                    Entries::open(&file, table, size).map_err(Error::io(&packed.path, "read the chunks of"))?;
                (first, Some(entries))
            }
        };
        Ok(Cutter { file, packed, wanted, entries, number: 0, at, left: count, state: State::Between })
    }

    /// Looks at the next chunk.
    fn look(&mut self) -> Result<State> {
        let listed = match &mut self.entries {
            None => None,
            Some(entries) => {
                let changed =
                    || Error::malformed(&self.packed.path, "table of chunks", "as in the first look", "another");
                Some(entries.next().ok().flatten().ok_or_else(changed)?)
            }
        };
        let chunk = |points: u64| Chunk { number: self.number, at: self.at, points: points.min(self.left) };
        let (chunk, end) = match (self.packed.chunks, listed) {
            (_, Some(Entry { points, bytes })) => (chunk(points), self.at + bytes),
            (Chunks::Unlisted { size: Some(size), .. }, _) => (chunk(u64::from(size)), self.file.len()),
            (Chunks::Unlisted { size: None, .. }, _) => {
                let stated = self.at + self.packed.record as u64;
                if self.file.len().saturating_sub(stated) < 4 {
                    return Err(self.packed.broken(chunk(self.left), "the file's end"));
                }
                let points = LE::read_u32(&self.file.read(stated..stated + 4)?);
                if points == 0 {
                    return Err(self.packed.broken(chunk(self.left), "an empty chunk"));
                }
                (chunk(u64::from(points)), self.file.len())
            }
            _ => (chunk(self.left), self.file.len()),
        };
        self.number += 1;
        self.left -= chunk.points;
        if listed.is_some() && self.file.content().absent().is_some_and(|absent| absent.has(chunk.at)) {
            self.at = end;
            return Ok(State::Absent(chunk.points));
        }
        let bytes = end - self.at;
        if listed.is_some() && chunk.points == 0 {
            self.at = end;
            return Ok(State::Between);
        }
        if listed.is_some() && bytes <= MAX_CHUNK && chunk.points <= MAX_PARTS * BLOCK_RECORDS as u64 {
            self.at = end;
            return Ok(State::Parted { chunk, bytes, given: 0 });
        }
        let Cutter { file, packed, .. } = self;
        let word = |from: u64| {
            let (from, to) = (chunk.at + from, chunk.at + from + 4);
            if to > end { Ok(None) } else { file.read(from..to).map(|word| Some(LE::read_u32(&word))) }
        };
        packed.check(bytes, word)?.map_err(|found| packed.broken(chunk, found))?;
        let window = Window::new(file, chunk.at..end);
        Running::start(packed, window, self.wanted, chunk, listed.map(|_| end)).map(State::Running)
    }
}

impl Cutter {
    /// The next records, to be decompressed on any thread; `None` at the end.
    fn next_piece(&mut self) -> Result<Option<Piece>> {
        loop {
            match &mut self.state {
                State::Between if self.left == 0 => return Ok(None),
                State::Between => self.state = self.look()?,
                State::Parted { chunk, given, .. } if *given == chunk.points => self.state = State::Between,
                State::Parted { chunk, bytes, given } => {
                    let (skip, take) = (*given, (chunk.points - *given).min(BLOCK_RECORDS as u64));
                    *given += take;
                    let bytes = self.file.bytes(chunk.at..chunk.at + *bytes)?;
                    let packed = Arc::clone(&self.packed);
                    let part = Part { bytes, packed, wanted: self.wanted, chunk: *chunk, skip, take };
                    return Ok(Some(Piece::Packed(part)));
                }
                State::Absent(points) => {
                    let points = *points;
                    self.state = State::Between;
                    return Ok(Some(Piece::Absent(points)));
                }
                State::Running(running) if running.done == running.chunk.points => {
                    self.at = running.end();
                    self.state = State::Between;
                }
                State::Running(running) => {
                    return Ok(Some(Piece::Records(running.next(&self.packed)?)));
                }
            }
        }
    }
}

/// A chunk that is decompressed as its records are asked for.
struct Running {
    decompressor: Box<dyn RecordDecompressor<Window> + Send>,
    chunk: Chunk,
    done: u64,
    /// Where the chunk ends, if that is known beforehand.
    end: Option<u64>,
}

impl Running {
    fn start(
        packed: &Packed,
        window: Window,
        wanted: DecompressionSelection,
        chunk: Chunk,
        end: Option<u64>,
    ) -> Result<Running> {
        let decompressor: Box<dyn RecordDecompressor<Window> + Send> = match packed.layers {
            None => Box::new(packed.pointwise(window)),
            Some(_) => Box::new(packed.layered(window, wanted).map_err(|e| packed.broken(chunk, e))?),
        };
        Ok(Running { decompressor, chunk, done: 0, end })
    }

    /// The next records, at least one.
    fn next(&mut self, packed: &Packed) -> Result<Vec<u8>> {
        let records = records_of_a_block(packed.record).min(self.chunk.points - self.done);
        let mut bytes = vec![0; records as usize * packed.record];
        packed
            .guarded(|| {
                for record in bytes.chunks_exact_mut(packed.record) {
                    self.decompressor.decompress_next(record)?;
                    self.done += 1;
                }
                Ok(())
            })
            .map_err(|error| stopped(&packed.path, self.chunk, (self.done, error)))?;
        Ok(bytes)
    }

    /// Where the next chunk begins, when all points of this one are decompressed.
    fn end(&self) -> u64 {
        self.end.unwrap_or_else(|| self.decompressor.get().position())
    }
}

/// Some of a file's records.
enum Piece {
    /// Decompressed already.
    Records(Vec<u8>),
    /// To be decompressed.
    Packed(Part),
    /// So many that are not there, as their points do not count.
    Absent(u64),
}

impl Piece {
    /// Hands on the records, whole ones, in one or more calls.
    fn records(&self, sink: impl FnMut(&[u8])) -> Result<()> {
        let mut sink = sink;
        match self {
            Piece::Records(records) => {
                sink(records);
                Ok(())
            }
            Piece::Packed(part) => part.records(sink),
            Piece::Absent(_) => Ok(()),
        }
    }
}

/// A chunk, or a part of one.
struct Part {
    bytes: Bytes,
    packed: Arc<Packed>,
    wanted: DecompressionSelection,
    chunk: Chunk,
    skip: u64,
    take: u64,
}

impl Part {
    fn records(&self, sink: impl FnMut(&[u8])) -> Result<()> {
        let bytes = &*self.bytes;
        let word = |at: u64| Ok(bytes.get(at as usize..at as usize + 4).map(LE::read_u32));
        self.packed.check(bytes.len() as u64, word)?.map_err(|found| self.packed.broken(self.chunk, found))?;
        self.packed
            .decompress(bytes, self.wanted, self.skip, self.take, sink)
            .map_err(|stop| stopped(&self.packed.path, self.chunk, stop))
    }
}

/// The blocks of one pass over a LAZ file, decompressed as they are decoded.
pub struct Blocks {
    pub cutter: Cutter,
    pub decoding: Arc<Decoding>,
}

impl<'a> BlockCutter<'a> for Blocks {
    fn next(&mut self) -> Result<Option<Box<dyn Decode + 'a>>> {
        let Some(piece) = self.cutter.next_piece()? else { return Ok(None) };
        if let Piece::Absent(points) = piece {
            return Ok(Some(Box::new(Uncounted(points))));
        }
        Ok(Some(Box::new(Block { piece, decoding: Arc::clone(&self.decoding) })))
    }
}

struct Block {
    piece: Piece,
    decoding: Arc<Decoding>,
}

impl Decode for Block {
    fn decode(&self, batch: &mut Batch) -> Result<()> {
        self.piece.records(|records| self.decoding.decode(records, batch))
    }
}

/// Decompresses all records for all passes, by chunks side by side.
///
/// # Errors
/// [`Error::Malformed`] if they are not as they should be; those of [`Unpacking`].
pub fn unpack(mut cutter: Cutter, workers: &Workers, unpacking: &mut Unpacking) -> Result<Content> {
    let (bytes, packed) = (cutter.left.saturating_mul(cutter.packed.record as u64).max(1), cutter.file.len());
    let mut done = 0;
    let path = cutter.packed.path.clone();
    let mut stretch = unpacking.begin()?;
    let spares = Spares::<Vec<u8>>::default();
    workers.in_order(
        workers.threads() + 1,
        || cutter.next_piece(),
        |piece| {
            let mut records = spares.take().unwrap_or_default();
            records.clear();
            piece.records(|more| records.extend_from_slice(more))?;
            Ok(records)
        },
        |records| {
            done += records.len() as u64;
            stretch.has_read((packed as f64 * (done as f64 / bytes as f64)) as u64);
            stretch.append(&records)?;
            spares.give(records);
            Ok(())
        },
    )?;
    Ok(stretch.finish(&path))
}
