//! What a finished phase leaves, as sections of one file, each with its checksum: written in an order, read in the same.

use bytemuck::{AnyBitPattern, NoUninit};
use serde::{Deserialize, Serialize};

use super::WorkFolder;
use super::store::NamedFile;
use crate::error::Result;
use crate::storage::spool::Spool;

/// Bytes that are copied at a time.
const PIECE: usize = 1 << 20;

/// A section's length and checksum.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Section {
    /// Bytes.
    pub bytes: u64,
    /// CRC-32.
    pub crc: u32,
}

/// Writes sections.
#[derive(Debug)]
pub struct SectionWriter<'a> {
    work: &'a WorkFolder,
    file: NamedFile,
    at: u64,
    sections: Vec<Section>,
}

impl<'a> SectionWriter<'a> {
    /// Into a new file of a phase.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn new(work: &'a WorkFolder, phase: &str) -> Result<SectionWriter<'a>> {
        Ok(SectionWriter { work, file: work.create(phase)?, at: 0, sections: Vec::new() })
    }

    /// Writes what a spool holds.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn spool(&mut self, spool: &Spool) -> Result<()> {
        let mut piece = vec![0; PIECE.min(spool.len() as usize)];
        let (mut hasher, mut from) = (crc32fast::Hasher::new(), 0);
        while from < spool.len() {
            piece.truncate((spool.len() - from).min(PIECE as u64) as usize);
            spool.read_at(from, &mut piece)?;
            hasher.update(&piece);
            self.write(&piece)?;
            from += piece.len() as u64;
        }
        self.sections.push(Section { bytes: spool.len(), crc: hasher.finalize() });
        Ok(())
    }

    /// Writes values.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn values<T: NoUninit>(&mut self, values: &[T]) -> Result<()> {
        let bytes: &[u8] = bytemuck::cast_slice(values);
        self.write(bytes)?;
        self.sections.push(Section { bytes: bytes.len() as u64, crc: crc32fast::hash(bytes) });
        Ok(())
    }

    fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.file.file.write_at(bytes, self.at).map_err(self.work.failed("write"))?;
        self.at += bytes.len() as u64;
        Ok(())
    }

    /// The file, and what is in it.
    pub fn finish(self) -> (NamedFile, Vec<Section>) {
        (self.file, self.sections)
    }
}

/// Reads them.
#[derive(Debug)]
pub struct SectionReader<'a> {
    work: &'a WorkFolder,
    file: NamedFile,
    length: u64,
    at: u64,
    sections: std::vec::IntoIter<Section>,
}

impl<'a> SectionReader<'a> {
    /// Of a file that has these.
    ///
    /// # Errors
    /// [`crate::Error::Damaged`] if there is no such file; [`crate::Error::Io`].
    pub fn new(work: &'a WorkFolder, name: &str, sections: Vec<Section>) -> Result<SectionReader<'a>> {
        let file = work.open_file(name)?;
        let length = file.file.length().map_err(work.failed("read"))?;
        Ok(SectionReader { work, file, length, at: 0, sections: sections.into_iter() })
    }

    /// Appends the next section to a spool.
    ///
    /// # Errors
    /// [`crate::Error::Damaged`], [`crate::Error::Io`].
    pub fn spool(&mut self, spool: &mut Spool) -> Result<()> {
        let Section { bytes, crc } = self.next()?;
        let mut piece = vec![0; PIECE.min(bytes as usize)];
        let (mut hasher, mut left) = (crc32fast::Hasher::new(), bytes);
        while left > 0 {
            piece.truncate(left.min(PIECE as u64) as usize);
            self.read(&mut piece)?;
            hasher.update(&piece);
            spool.append(&piece)?;
            left -= piece.len() as u64;
        }
        self.compare(hasher.finalize(), crc)
    }

    /// The values of the next section.
    ///
    /// # Errors
    /// [`crate::Error::Damaged`], [`crate::Error::Io`].
    pub fn values<T: NoUninit + AnyBitPattern>(&mut self) -> Result<Vec<T>> {
        let Section { bytes, crc } = self.next()?;
        if bytes % size_of::<T>() as u64 != 0 {
            return Err(self.damaged("a section has no whole number of values"));
        }
        let mut values = vec![T::zeroed(); bytes as usize / size_of::<T>()];
        self.read(bytemuck::cast_slice_mut(&mut values))?;
        self.compare(crc32fast::hash(bytemuck::cast_slice(&values)), crc)?;
        Ok(values)
    }

    /// The next section, which the file is long enough for.
    fn next(&mut self) -> Result<Section> {
        match self.sections.next() {
            Some(section) if section.bytes <= self.length - self.at => Ok(section),
            Some(section) => {
                let found = format!(
                    "{} bytes at byte {} were expected, {} are left",
                    section.bytes,
                    self.at,
                    self.length - self.at
                );
                Err(self.damaged(found))
            }
            None => Err(self.damaged("a section is missing")),
        }
    }

    fn read(&mut self, out: &mut [u8]) -> Result<()> {
        self.file.file.read_at(out, self.at).map_err(self.work.failed("read"))?;
        self.at += out.len() as u64;
        Ok(())
    }

    fn compare(&self, found: u32, expected: u32) -> Result<()> {
        if found == expected {
            return Ok(());
        }
        Err(self.damaged(format!("before byte {}: expected checksum {expected:08x}, found {found:08x}", self.at)))
    }

    /// What is said of a file whose sections make no sense.
    pub fn damaged(&self, found: impl Into<String>) -> crate::Error {
        self.work.damaged(&self.file.name, found)
    }
}
