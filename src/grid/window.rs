//! The sliding window: a fixed number of consecutive slices, moving up.
//!
//! ```text
//!   y ^   first + len   (on disk)           slide_to(first + 1) fills the slot that the lowest slice leaves
//!     |   first + len-1 [ in the window ]
//!     |   ...
//!     |   first         [ in the window ]
//!     |   first - 1     (retired)
//! ```

use crate::error::Result;

/// `len` consecutive slices, addressed by slice number; slots are reused, never reallocated.
#[derive(Debug)]
pub struct Window<T> {
    slots: Vec<T>,
    first: i64,
    filled: bool,
}

impl<T> Window<T> {
    /// A window of `len` slots made by `slot`; it holds nothing until the first [`Window::slide_to`].
    pub fn new(len: usize, slot: impl FnMut() -> T) -> Window<T> {
        let mut slots = Vec::new();
        slots.resize_with(len, slot);
        Window { slots, first: 0, filled: false }
    }

    /// Moves the window up so that its lowest slice is `first`, filling each slice that enters with `fill`.
    ///
    /// # Errors
    /// The first error of `fill`; the window must not be used after it.
    ///
    /// # Panics
    /// If the window would move down.
    pub fn slide_to(&mut self, first: i64, mut fill: impl FnMut(i64, &mut T) -> Result<()>) -> Result<()> {
        let len = self.slots.len() as i64;
        let entering = if self.filled {
            assert!(first >= self.first, "a window moves up only");
            (self.first + len).max(first)
        } else {
            first
        };
        for y in entering..first + len {
            let slot = y.rem_euclid(len) as usize;
            fill(y, &mut self.slots[slot])?;
        }
        (self.first, self.filled) = (first, true);
        Ok(())
    }

    /// Forgets what it holds: the next [`Window::slide_to`] may begin anywhere, and fills all of it.
    pub fn restart(&mut self) {
        self.filled = false;
    }

    /// Slice `y`.
    ///
    /// # Panics
    /// If it is not in the window.
    #[inline]
    pub fn get(&self, y: i64) -> &T {
        let len = self.slots.len() as i64;
        assert!(self.filled && y >= self.first && y < self.first + len, "slice outside the window");
        &self.slots[y.rem_euclid(len) as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_slice_is_filled_once_and_found_again() {
        let mut window = Window::new(3, || 0);
        let mut filled = Vec::new();
        for first in [-2, -1, 0, 3, 9] {
            window
                .slide_to(first, |y, slot| {
                    filled.push(y);
                    *slot = y;
                    Ok(())
                })
                .unwrap();
            for y in first..first + 3 {
                assert_eq!(*window.get(y), y);
            }
        }
        assert_eq!(filled, [-2, -1, 0, 1, 2, 3, 4, 5, 9, 10, 11]);
    }
}
