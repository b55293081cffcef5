//! Hashes with seeds, for tables whose keys come from files: nobody can make a file whose places all have one hash, and so a table that is a list.
//!
//! Seeds differ from run to run, and so does the order in which such a table gives its entries. Whoever goes through one must not let that order show; looking keys
//! up does not.

use std::collections::HashMap;
use std::collections::hash_map::RandomState;
use std::hash::{BuildHasher, Hasher};

/// A table whose keys are numbers from files.
pub type SeededMap<K, V> = HashMap<K, V, Seeds>;

/// Two numbers, odd, drawn for every table.
#[derive(Debug, Clone, Copy)]
pub struct Seeds([u64; 2]);

/// A hash in the making.
#[derive(Debug)]
pub struct Mixed {
    seeds: [u64; 2],
    state: u64,
}

impl Seeds {
    /// New ones.
    pub fn new() -> Seeds {
        let drawn = RandomState::new();
        Seeds([0u8, 1].map(|number| drawn.hash_one(number) | 1))
    }
}

impl BuildHasher for Seeds {
    type Hasher = Mixed;

    fn build_hasher(&self) -> Mixed {
        Mixed { seeds: self.0, state: self.0[0] }
    }
}

impl Hasher for Mixed {
    fn write(&mut self, bytes: &[u8]) {
        for piece in bytes.chunks(8) {
            let mut word = [0; 8];
            word[..piece.len()].copy_from_slice(piece);
            self.write_u64(u64::from_le_bytes(word));
        }
    }

    fn write_u64(&mut self, word: u64) {
        // Both halves of the product: every bit of the word, and of the seeds, reaches all others.
        let product = u128::from(self.state ^ word) * u128::from(self.seeds[1]);
        self.state = (product as u64) ^ (product >> 64) as u64 ^ self.seeds[0].rotate_left(23);
    }

    // The length of the key, which is the same for all.
    fn write_usize(&mut self, _: usize) {}

    fn finish(&self) -> u64 {
        self.state
    }
}

impl Default for Seeds {
    fn default() -> Seeds {
        Seeds::new()
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn keys_that_were_chosen_to_share_a_hash_do_not() {
        /// What undoes a step of hashes without seeds: the numbers that they begin with.
        const STARTS: [u64; 2] = [0x243f_6a88_85a3_08d3, 0x1319_8a2e_0370_7344];
        let seeds = Seeds::new();
        for (i, start) in STARTS.into_iter().enumerate() {
            let half = |n: u64| ((0.37 + n as f64).to_bits(), (0.11 * n as f64).to_bits());
            let narrow = |n: u64| [start as u32, (start >> 32) as u32, n as u32];
            let wide = |n: u64| if i == 0 { [start, half(n).0, half(n).1] } else { [half(n).0, start, half(n).1] };
            let of: [Box<dyn Fn(u64) -> u64>; 2] =
                [Box::new(move |n| seeds.hash_one(narrow(n))), Box::new(move |n| seeds.hash_one(wide(n)))];
            for hash in of {
                let hashes: HashSet<u64> = (0..100_000).map(&hash).collect();
                assert_eq!(hashes.len(), 100_000);
                let low: HashSet<u64> = (0..100_000).map(|n| hash(n) & 0xffff).collect();
                assert!(low.len() > 40_000, "{}", low.len());
            }
        }
        assert_ne!(Seeds::new().hash_one(1), seeds.hash_one(1));
    }
}
