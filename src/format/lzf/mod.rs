//! LZF, as compressed PCD files have it: bytes as they are, and copies of what came at most 8 KiB before.
//!
//! ```text
//!   000lllll  bytes …                      l + 1 bytes as they are
//!   lllddddd  dddddddd                     l + 2 bytes, from d + 1 bytes before; l = 1 to 6
//!   111ddddd  llllllll  dddddddd           l + 9 bytes, likewise
//! ```

/// How far back copies reach.
const REACH: usize = 1 << 13;

/// Bytes that are handed on at a time.
const PIECE: usize = 256 << 10;

/// The longest token: a head, and 32 bytes as they are.
pub const LONGEST: usize = 33;

/// Unpacks a stream that comes in pieces, in memory of one piece.
#[derive(Debug, Default)]
pub struct Lzf {
    /// The reach, and behind it what was not yet handed on.
    held: Vec<u8>,
    /// Bytes in front of `held` that were handed on.
    handed: usize,
}

/// A copy of what was never there.
#[derive(Debug, PartialEq, Eq)]
pub struct BeforeStart;

impl Lzf {
    /// Unpacks the token at the beginning of `bytes`: its length, or `None` if it is not all there.
    ///
    /// # Errors
    /// If it is a copy from before the beginning.
    pub fn token(&mut self, bytes: &[u8]) -> Result<Option<usize>, BeforeStart> {
        let (length, distance, used) = match *bytes {
            [head @ 0..=31, ref rest @ ..] => {
                let length = usize::from(head) + 1;
                let Some(literal) = rest.get(..length) else { return Ok(None) };
                self.held.extend_from_slice(literal);
                return Ok(Some(1 + length));
            }
            [head @ 224..=255, length, low, ..] => (usize::from(length) + 9, distance(head, low), 3),
            [head @ 32..=223, low, ..] => (usize::from(head >> 5) + 2, distance(head, low), 2),
            _ => return Ok(None),
        };
        let from = self.held.len().checked_sub(distance).ok_or(BeforeStart)?;
        if length <= distance {
            self.held.extend_from_within(from..from + length);
        } else {
            // Byte by byte: the copy reaches into itself.
            for at in from..from + length {
                self.held.push(self.held[at]);
            }
        }
        Ok(Some(used))
    }

    /// Bytes that wait to be handed on.
    pub fn waiting(&self) -> usize {
        self.held.len() - self.handed
    }

    /// What is to be handed on, once there is a piece of it; or else, if `all` is asked for, whatever there is.
    pub fn hand_on<E>(&mut self, all: bool, to: impl FnOnce(&[u8]) -> Result<(), E>) -> Result<(), E> {
        if self.waiting() >= if all { 1 } else { PIECE } {
            to(&self.held[self.handed..])?;
            let forgotten = self.held.len().saturating_sub(REACH);
            self.held.drain(..forgotten);
            self.handed = self.held.len();
        }
        Ok(())
    }
}

/// How far back a copy begins.
fn distance(head: u8, low: u8) -> usize {
    (usize::from(head & 31) << 8) + usize::from(low) + 1
}

#[cfg(test)]
pub mod tests;
