//! The table of a LAZ file's chunks.

use std::io::{ErrorKind, Read, Result as IoResult};
use std::sync::Arc;

use byteorder::{ByteOrder, LE};
use laz::decoders::ArithmeticDecoder;
use laz::decompressors::{IntegerDecompressor, IntegerDecompressorBuilder};

use super::guard::guarded;
use crate::format::las::window::Window;
use crate::storage::mapped::Mapped;

/// A chunk that is decoded, for messages: its number, where it begins, and the number of its points.
#[derive(Debug, Clone, Copy)]
pub struct Chunk {
    pub number: u64,
    pub at: u64,
    pub points: u64,
}

/// A chunk as the table has it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Entry {
    pub points: u64,
    pub bytes: u64,
}

/// The entries of the table, read as they are asked for.
pub struct Entries {
    decoder: ArithmeticDecoder<Window>,
    numbers: IntegerDecompressor,
    pub left: u32,
    size: Option<u32>,
    /// The entry before: number of points, bytes.
    before: [i32; 2],
}

impl Entries {
    /// Starts at the table at byte `table`, eight bytes before the file's end at least.
    pub fn open(file: &Arc<Mapped>, table: u64, size: Option<u32>) -> IoResult<Entries> {
        let mut head = [0; 8];
        let mut window = Window::new(file, table..file.len());
        window.read_exact(&mut head)?;
        let left = LE::read_u32(&head[4..]);
        let mut decoder = ArithmeticDecoder::new(window);
        if left > 0 {
            let mut first = [0; 4];
            Window::new(file, table + 8..file.len()).read_exact(&mut first)?;
            if first == [0xff; 4] {
                return Err(ErrorKind::InvalidData.into());
            }
            guarded(|| decoder.read_init_bytes())?;
        }
        let numbers = IntegerDecompressorBuilder::new().bits(32).contexts(2).build_initialized();
        Ok(Entries { decoder, numbers, left, size, before: [0; 2] })
    }

    pub fn next(&mut self) -> IoResult<Option<Entry>> {
        if self.left == 0 {
            return Ok(None);
        }
        self.left -= 1;
        let mut number = |context: usize| {
            let before = self.before[context];
            let number = guarded(|| self.numbers.decompress(&mut self.decoder, before, context as u32))?;
            self.before[context] = number;
            u64::try_from(number).map_err(|_| std::io::Error::from(ErrorKind::InvalidData))
        };
        let points = match self.size {
            Some(size) => u64::from(size),
            None => number(0)?,
        };
        Ok(Some(Entry { points, bytes: number(1)? }))
    }
}
