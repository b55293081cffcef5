//! What cannot be read in place is unpacked first: gzip, Zstandard, standard input.
//!
//! ```text
//!   a.ply.gz  --gunzip-->  +---------------------+---------------+------+
//!   b.xyz.zst --unzstd-->  | a.ply               | b.xyz         | …    |   one temporary file without a name, however many
//!   -         ---------->  +---------------------+---------------+------+   inputs there are; each then is a Content
//! ```
//!
//! Once for all passes, on one thread, before anything else is known. No claim of a header is believed: what comes out is counted, and
//! stops before the disk is full. Memory: two pieces, and for Zstandard the window, which the budget bounds.

mod sparse;

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bytesize::ByteSize;
use flate2::bufread::GzDecoder;

use crate::error::{Error, Result};
use crate::resources::workers::Workers;
use crate::storage::mapped::{Content, FAULT_WINDOW, Mapped};
use crate::storage::remote::{self, is_remote};
use crate::storage::spool::{ScratchFile, Workspace};
use crate::system::StandardInput;

/// The argument that stands for standard input.
pub const STANDARD_INPUT: &str = "-";

/// Bytes that are read, unpacked and written at a time.
const PIECE: usize = 256 << 10;

/// The windows of Zstandard that are accepted, as powers of two, whatever the budget: less makes no sense, more does not exist.
const WINDOWS: (u32, u32) = (20, 31);

/// What opening a cloud may use.
pub struct Opening<'a> {
    /// Where what is unpacked goes.
    pub workspace: &'a Workspace,
    /// Bytes of memory.
    pub memory: u64,
    /// Who decompresses LAZ, once for all passes, where there is room for that; if nobody, every pass does it anew.
    pub decompress: Option<&'a Workers>,
    /// Is told how far unpacking is, from time to time, and may stop the work with an error.
    pub watch: &'a mut dyn FnMut(Unpacked) -> Result<()>,
}

/// How far unpacking is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Unpacked {
    /// Bytes that came out.
    pub bytes: u64,
    /// Bytes of packed files that are read.
    pub read: u64,
    /// Bytes of all packed files; `None` if there is standard input among them, whose end nobody knows.
    pub total: Option<u64>,
}

/// Puts contents into a temporary file, which is made when the first comes.
pub struct Unpacking<'a> {
    opening: Opening<'a>,
    file: Option<Arc<ScratchFile>>,
    /// Where the next content begins, and how many bytes there are so far.
    end: u64,
    bytes: u64,
    /// Bytes that would be decompressed if there were somebody to do it.
    later: u64,
    /// Bytes of packed files that are done with, of the one under way, and of all.
    finished: u64,
    reading: u64,
    total: Option<u64>,
    /// Bytes that were fetched from object stores, before the file under way, too.
    fetched: u64,
    fetched_before: u64,
    /// Bytes of the objects that are opened so far.
    objects: u64,
}

impl<'a> Unpacking<'a> {
    /// Nothing is unpacked yet.
    pub fn new(opening: Opening<'a>) -> Unpacking<'a> {
        Unpacking {
            opening,
            file: None,
            end: 0,
            bytes: 0,
            later: 0,
            finished: 0,
            reading: 0,
            total: None,
            fetched: 0,
            fetched_before: 0,
            objects: 0,
        }
    }

    /// Says which files are going to be opened, one after the other, so that it can be told how much of them is unpacked.
    pub fn expect(&mut self, files: &[PathBuf]) {
        let known = files.iter().all(|path| path != Path::new(STANDARD_INPUT));
        self.total = known.then(|| files.iter().map(|path| packed_bytes(path)).sum());
    }

    /// A file is done with.
    pub fn finished(&mut self, path: &Path) {
        self.finished += if self.total.is_some() { packed_bytes(path) } else { 0 };
        self.reading = 0;
        self.fetched_before = self.fetched;
    }

    /// Bytes that were fetched from object stores, and those of the objects that were opened.
    pub fn fetched(&self) -> (u64, u64) {
        (self.fetched, self.objects)
    }

    /// Bytes of temporary disk that are taken.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Bytes of temporary disk that would be taken, too, if somebody decompressed LAZ for all passes.
    pub fn later(&self) -> u64 {
        self.later
    }

    /// Those who decompress so many bytes that could be decompressed in each pass, too; `None` if it is to be left to the passes: there is but one, or it
    /// would take more than a quarter of the free disk, whose rest is for points and mesh.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn for_all_passes(&mut self, bytes: u64) -> Result<Option<&'a Workers>> {
        let room = self.opening.workspace.available()?.saturating_sub(3 * self.bytes + 4 * self.later);
        if bytes > room / 4 {
            return Ok(None);
        }
        if self.opening.decompress.is_none() {
            self.later += bytes;
        }
        Ok(self.opening.decompress)
    }

    /// A new content, empty so far. One is made at a time.
    ///
    /// # Errors
    /// [`Error::Io`] if no temporary file can be created.
    pub fn begin(&mut self) -> Result<Stretch<'_, 'a>> {
        let file = match &self.file {
            Some(file) => Arc::clone(file),
            None => Arc::clone(self.file.insert(Arc::new(self.opening.workspace.scratch_file()?))),
        };
        let start = self.end;
        Ok(Stretch { unpacking: self, file, start })
    }

    /// All of standard input.
    ///
    /// # Errors
    /// Errors of reading it and of [`Stretch::append`].
    pub fn standard_input(&mut self) -> Result<Content> {
        let mut input = StandardInput::new();
        let mut piece = vec![0; PIECE];
        let mut stretch = self.begin()?;
        loop {
            match input.read(&mut piece).map_err(Error::io("standard input", "read"))? {
                None => stretch.watch()?,
                Some(0) => return Ok(stretch.finish(Path::new("standard input"))),
                Some(bytes) => stretch.append(&piece[..bytes])?,
            }
        }
    }
}

/// A content in the making.
pub struct Stretch<'a, 'b> {
    unpacking: &'a mut Unpacking<'b>,
    file: Arc<ScratchFile>,
    start: u64,
}

impl Stretch<'_, '_> {
    /// Adds bytes at its end.
    ///
    /// # Errors
    /// [`Error::Disk`] before the disk is full; [`Error::Io`]; and what whoever watches says.
    pub fn append(&mut self, bytes: &[u8]) -> Result<()> {
        self.file.write_at(bytes, self.unpacking.end)?;
        self.unpacking.end += bytes.len() as u64;
        self.unpacking.bytes += bytes.len() as u64;
        self.watch()
    }

    /// So many bytes of the packed file were read for what is there so far.
    pub fn has_read(&mut self, bytes: u64) {
        self.unpacking.reading = bytes;
    }

    fn watch(&mut self) -> Result<()> {
        let Unpacking { bytes, finished, reading, total, .. } = *self.unpacking;
        let read = finished + reading;
        (self.unpacking.opening.watch)(Unpacked { bytes, read: total.map_or(read, |total| read.min(total)), total })
    }

    /// The content, of the file that messages are to call `name`.
    pub fn finish(self, name: &Path) -> Content {
        let len = self.unpacking.end - self.start;
        // Contents share no pages that are given back at a time.
        self.unpacking.end = self.unpacking.end.next_multiple_of(FAULT_WINDOW as u64);
        Content::unpacked(name, self.file, self.start, len)
    }
}

/// The bytes of a file, if it is packed by its first bytes: gzip, Zstandard or LAZ; or if it is an object that is fetched. A file that cannot be looked at has none here; opening it says why.
fn packed_bytes(path: &Path) -> u64 {
    /// The place of a LAS file's point format, whose highest bit says that points are compressed.
    const POINT_FORMAT: usize = 104;
    let look = || -> std::io::Result<u64> {
        if is_remote(path) {
            return Ok(remote::noted(path).map_or(0, |meta| meta.bytes));
        }
        if !std::fs::metadata(path)?.is_file() {
            return Ok(0);
        }
        let file = std::fs::File::open(path)?;
        let mut head = Vec::with_capacity(POINT_FORMAT + 1);
        (&file).take(POINT_FORMAT as u64 + 1).read_to_end(&mut head)?;
        let laz = head.starts_with(b"LASF") && head.get(POINT_FORMAT).is_some_and(|format| format & 0x80 != 0);
        Ok(if laz || Packing::of(&head).is_some() { file.metadata()?.len() } else { 0 })
    };
    look().unwrap_or(0)
}

/// How a file is compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Packing {
    /// gzip, of one or more members.
    Gzip,
    /// Zstandard, of one or more frames.
    Zstandard,
}

impl Packing {
    /// That of a file that begins like this.
    pub fn of(head: &[u8]) -> Option<Packing> {
        match head {
            [0x1f, 0x8b, 8, ..] => Some(Packing::Gzip),
            [0x28, 0xb5, 0x2f, 0xfd, ..] => Some(Packing::Zstandard),
            // A frame to be skipped may come first.
            [0x50..=0x5f, 0x2a, 0x4d, 0x18, ..] => Some(Packing::Zstandard),
            _ => None,
        }
    }

    /// That of a file of this name, and the name without its extension.
    pub fn named(path: &Path) -> Option<(Packing, PathBuf)> {
        let extension = path.extension()?;
        let known = [("gz", Packing::Gzip), ("zst", Packing::Zstandard), ("zstd", Packing::Zstandard)];
        let (_, packing) = known.into_iter().find(|(word, _)| extension.eq_ignore_ascii_case(word))?;
        Some((packing, path.with_extension("")))
    }

    /// The format's name.
    pub fn name(self) -> &'static str {
        match self {
            Packing::Gzip => "gzip",
            Packing::Zstandard => "Zstandard",
        }
    }

    /// Unpacks a whole file.
    ///
    /// # Errors
    /// [`Error::Malformed`] if the file is damaged or cut, with the place; those of [`Stretch::append`].
    pub fn unpack(self, content: &Content, unpacking: &mut Unpacking) -> Result<Content> {
        let source = BufReader::with_capacity(PIECE, Reading { file: content.unmapped()?, at: 0, failed: None });
        match self {
            Packing::Gzip => spool(Gunzip { member: Some(GzDecoder::new(source)) }, content, unpacking),
            Packing::Zstandard => {
                let window = (unpacking.opening.memory / 2).max(1).ilog2().clamp(WINDOWS.0, WINDOWS.1);
                let start = |e: std::io::Error| Error::io(content.name(), "unpack")(e);
                let mut frames = zstd::stream::read::Decoder::with_buffer(source).map_err(start)?;
                frames.window_log_max(window).map_err(start)?;
                spool(Frames { frames, window }, content, unpacking)
            }
        }
    }
}

/// A decoder of one format.
trait Unpack {
    /// Fills the beginning of `piece`; 0 at the end.
    fn read(&mut self, piece: &mut [u8]) -> std::io::Result<usize>;

    /// What it reads from.
    fn source(&mut self) -> &mut BufReader<Reading>;

    /// What the format expects where an error occurred.
    fn expected(&self, error: &std::io::Error) -> String;
}

fn spool(mut decoder: impl Unpack, content: &Content, unpacking: &mut Unpacking) -> Result<Content> {
    let mut stretch = unpacking.begin()?;
    let mut piece = vec![0; PIECE];
    let read = |decoder: &mut dyn Unpack| {
        let source = decoder.source();
        source.get_ref().at - source.buffer().len() as u64
    };
    loop {
        let mut filled = 0;
        while filled < PIECE {
            match decoder.read(&mut piece[filled..]) {
                Ok(0) => {
                    stretch.has_read(read(&mut decoder));
                    stretch.append(&piece[..filled])?;
                    return Ok(stretch.finish(content.name()));
                }
                Ok(bytes) => filled += bytes,
                Err(e) => {
                    let source = decoder.source();
                    if let Some(failed) = source.get_mut().failed.take() {
                        return Err(failed);
                    }
                    let at = source.get_ref().at - source.buffer().len() as u64;
                    let found = match e.kind() {
                        std::io::ErrorKind::UnexpectedEof => "the end of the file".to_string(),
                        _ => e.to_string(),
                    };
                    let place = format_args!("compressed byte {at}").to_string();
                    return Err(Error::malformed(content.name(), place, decoder.expected(&e), found));
                }
            }
        }
        stretch.has_read(read(&mut decoder));
        stretch.append(&piece)?;
    }
}

/// The members of a gzip file, one behind the other.
struct Gunzip {
    /// `None` only while the next member takes the file over.
    member: Option<GzDecoder<BufReader<Reading>>>,
}

impl Gunzip {
    fn member(&mut self) -> &mut GzDecoder<BufReader<Reading>> {
        self.member.as_mut().expect("a member is put back before anything is done with it")
    }
}

impl Unpack for Gunzip {
    fn read(&mut self, piece: &mut [u8]) -> std::io::Result<usize> {
        loop {
            match self.member().read(piece)? {
                0 => {}
                bytes => return Ok(bytes),
            }
            // Zeros behind the last member fill up blocks of a tape.
            let source = self.member().get_mut();
            loop {
                let zeros = source.fill_buf()?.iter().take_while(|byte| **byte == 0).count();
                source.consume(zeros);
                if zeros == 0 {
                    break;
                }
            }
            if source.fill_buf()?.is_empty() {
                return Ok(0);
            }
            self.member = self.member.take().map(|member| GzDecoder::new(member.into_inner()));
        }
    }

    fn source(&mut self) -> &mut BufReader<Reading> {
        self.member().get_mut()
    }

    fn expected(&self, _: &std::io::Error) -> String {
        "gzip data".to_string()
    }
}

struct Frames {
    frames: zstd::stream::read::Decoder<'static, BufReader<Reading>>,
    /// The largest window accepted, as a power of two.
    window: u32,
}

impl Unpack for Frames {
    fn read(&mut self, piece: &mut [u8]) -> std::io::Result<usize> {
        self.frames.read(piece)
    }

    fn source(&mut self) -> &mut BufReader<Reading> {
        self.frames.get_mut()
    }

    fn expected(&self, error: &std::io::Error) -> String {
        if error.to_string().contains("too much memory") {
            format!("a window of at most {} (half of `max_memory`)", ByteSize(1 << self.window))
        } else {
            "Zstandard data".to_string()
        }
    }
}

/// A file, read from its beginning.
struct Reading {
    file: Mapped,
    at: u64,
    /// Why reading it failed: decoders pass on less.
    failed: Option<Error>,
}

impl Read for Reading {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let end = self.file.len().min(self.at + out.len() as u64);
        let bytes = self.file.read(self.at..end).map_err(|e| {
            self.failed = Some(e);
            std::io::Error::other("the file cannot be read")
        })?;
        out[..bytes.len()].copy_from_slice(&bytes);
        self.at = end;
        Ok(bytes.len())
    }
}

#[cfg(test)]
mod tests;
