//! The pages of an E57 file: 1024 bytes each, the last four of which are a checksum. Positions that count the checksums are *physical*.

use std::sync::Arc;

use crate::error::{Error, Result};
use crate::storage::mapped::Mapped;

/// Bytes of a page, and of what is in it.
const PAGE: u64 = 1024;
const CONTENT: usize = 1020;

/// Pages that are looked at together.
const TOGETHER: u64 = 64;

/// Reads what is in the pages, from some place on.
#[derive(Debug)]
pub struct Pages {
    file: Arc<Mapped>,
    /// The page that is looked at next.
    page: u64,
    /// What was in the pages before it, and how much of that was read.
    content: Vec<u8>,
    read: usize,
}

impl Pages {
    /// Starts at a physical position.
    ///
    /// # Errors
    /// [`Error::Malformed`] if there is none such.
    pub fn at(file: &Arc<Mapped>, physical: u64) -> Result<Pages> {
        let (page, within) = (physical / PAGE, (physical % PAGE) as usize);
        let none = |found: &dyn std::fmt::Display| {
            Err(Error::malformed(file.path(), "E57 pages", format_args!("content at byte {physical}"), found))
        };
        if physical >= file.len() {
            return none(&format_args!("the end of the file after {} bytes", file.len()));
        }
        if within >= CONTENT {
            return none(&"a checksum");
        }
        let mut pages = Pages { file: Arc::clone(file), page, content: Vec::new(), read: 0 };
        pages.more()?;
        pages.read = within;
        Ok(pages)
    }

    /// Replaces the content of `into` by the next `length` bytes.
    ///
    /// # Errors
    /// [`Error::Malformed`] if the file ends before, or a checksum is wrong; [`Error::Io`].
    pub fn read(&mut self, length: usize, into: &mut Vec<u8>) -> Result<()> {
        into.clear();
        while into.len() < length {
            if self.read == self.content.len() {
                self.more()?;
            }
            let end = self.content.len().min(self.read + length - into.len());
            into.extend_from_slice(&self.content[self.read..end]);
            self.read = end;
        }
        Ok(())
    }

    /// Takes in more pages.
    fn more(&mut self) -> Result<()> {
        let whole = self.file.len() / PAGE;
        let end = whole.min(self.page + TOGETHER);
        if self.page >= end {
            let expected = format_args!("a page of {PAGE} bytes").to_string();
            return Err(Error::malformed(
                self.file.path(),
                format_args!("byte {}", self.page * PAGE),
                expected,
                "the file's end",
            ));
        }
        let bytes = self.file.bytes(self.page * PAGE..end * PAGE)?;
        (self.read, self.content) = (0, std::mem::take(&mut self.content));
        self.content.clear();
        for (i, page) in bytes.chunks_exact(PAGE as usize).enumerate() {
            let (content, sum) = page.split_at(CONTENT);
            if checksum(content).to_be_bytes() != *sum {
                let place = format_args!("page at byte {}", (self.page + i as u64) * PAGE).to_string();
                return Err(Error::malformed(
                    self.file.path(),
                    place,
                    "content that has its checksum",
                    "other content",
                ));
            }
            self.content.extend_from_slice(content);
        }
        self.page = end;
        Ok(())
    }
}

/// CRC-32C of eight bytes at a time: a table for each of them.
const TABLES: [[u32; 256]; 8] = {
    let mut tables = [[0; 256]; 8];
    let mut byte = 0;
    while byte < 256 {
        let mut sum = byte as u32;
        let mut bit = 0;
        while bit < 8 {
            sum = sum >> 1 ^ if sum & 1 == 1 { 0x82f6_3b78 } else { 0 };
            bit += 1;
        }
        tables[0][byte] = sum;
        byte += 1;
    }
    let mut table = 1;
    while table < 8 {
        byte = 0;
        while byte < 256 {
            let before = tables[table - 1][byte];
            tables[table][byte] = before >> 8 ^ tables[0][(before & 0xff) as usize];
            byte += 1;
        }
        table += 1;
    }
    tables
};

/// The checksum of a page.
pub fn checksum(bytes: &[u8]) -> u32 {
    let (eights, rest) = bytes.as_chunks::<8>();
    let sum = eights.iter().fold(!0u32, |sum, eight| {
        let mixed = u64::from_le_bytes(*eight) ^ u64::from(sum);
        mixed.to_le_bytes().iter().enumerate().fold(0, |sum, (i, byte)| sum ^ TABLES[7 - i][usize::from(*byte)])
    });
    !rest.iter().fold(sum, |sum, byte| sum >> 8 ^ TABLES[0][((sum ^ u32::from(*byte)) & 0xff) as usize])
}

#[cfg(test)]
mod tests {
    use super::checksum;

    #[test]
    fn the_checksum_is_crc_32c() {
        assert_eq!(checksum(b"123456789"), 0xe306_9283);
        assert_eq!(checksum(&[0; 32]), 0x8a91_36aa);
        assert_eq!(checksum(b""), 0);
    }
}
