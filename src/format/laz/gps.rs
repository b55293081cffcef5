//! GPS times of pointwise LAZ (version 2), as LASzip has them; that of the crate `laz` calls itself for every change of sequence, so that a file of fifty bytes
//! could use up the stack.
//!
//! ```text
//!  four sequences of times; each has its last time, the last difference, and how often that was far off
//!
//!  last difference 0:   0 the same time | 1 a difference | 2 a new sequence | 3 to 5 change by 1 to 3 sequences, and read on
//!  else:                0 a difference of its own | 1 the last one | 2 to 500 so many times the last one | 501 to 510 the same, backwards
//!                       511 the same time | 512 a new sequence | 513 to 515 change by 1 to 3 sequences, and read on
//! ```

use std::io::{Error, ErrorKind, Read, Result};

use byteorder::{ByteOrder, LE};
use laz::decoders::ArithmeticDecoder;
use laz::decompressors::{IntegerDecompressor, IntegerDecompressorBuilder};
use laz::models::{ArithmeticModel, ArithmeticModelBuilder};
use laz::record::FieldDecompressor;

/// The most that a difference is multiplied by, forwards and backwards.
const MOST: (i32, i32) = (500, -10);
/// Symbols after a difference that is not 0.
const SAME: i32 = 511;
const NEW: i32 = 512;
const SYMBOLS: u32 = 516;

/// Times in a row that are far off, after which the difference is taken for the usual one.
const FAR_OFF: u32 = 3;

/// Changes of sequence in a row: no encoder has more than one.
const CHANGES: u32 = 4;

/// A sequence of times.
#[derive(Debug, Clone, Copy, Default)]
struct Sequence {
    /// The bits of the time, as an integer.
    time: i64,
    difference: i32,
    far_off: u32,
}

/// Decompresses GPS times.
pub struct GpsTimes {
    after_none: ArithmeticModel,
    after_some: ArithmeticModel,
    numbers: IntegerDecompressor,
    sequences: [Sequence; 4],
    /// The sequence of the last time, and the one that was begun last.
    last: usize,
    newest: usize,
}

impl Default for GpsTimes {
    fn default() -> GpsTimes {
        GpsTimes {
            after_none: ArithmeticModelBuilder::new(6).build(),
            after_some: ArithmeticModelBuilder::new(SYMBOLS).build(),
            numbers: IntegerDecompressorBuilder::new().bits(32).contexts(9).build_initialized(),
            sequences: [Sequence::default(); 4],
            last: 0,
            newest: 0,
        }
    }
}

impl GpsTimes {
    /// Reads on to the next time.
    fn next<R: Read>(&mut self, decoder: &mut ArithmeticDecoder<R>) -> Result<()> {
        for _ in 0..=CHANGES {
            let difference = self.sequences[self.last].difference;
            if difference == 0 {
                match decoder.decode_symbol(&mut self.after_none)? {
                    0 => {}
                    1 => {
                        let difference = self.numbers.decompress(decoder, 0, 0)?;
                        let Sequence { time, .. } = self.sequences[self.last];
                        let time = time.wrapping_add(i64::from(difference));
                        self.sequences[self.last] = Sequence { time, difference, far_off: 0 };
                    }
                    2 => self.begin(decoder)?,
                    change => {
                        self.last = (self.last + change as usize - 2) & 3;
                        continue;
                    }
                }
            } else {
                match decoder.decode_symbol(&mut self.after_some)? as i32 {
                    SAME => {}
                    NEW => self.begin(decoder)?,
                    change if change > NEW => {
                        self.last = (self.last + (change - NEW) as usize) & 3;
                        continue;
                    }
                    symbol => self.advance(decoder, difference, symbol)?,
                }
            }
            return Ok(());
        }
        Err(Error::new(ErrorKind::InvalidData, "times that change from sequence to sequence"))
    }

    /// Begins a sequence, with a time of its own.
    fn begin<R: Read>(&mut self, decoder: &mut ArithmeticDecoder<R>) -> Result<()> {
        let high = self.numbers.decompress(decoder, (self.sequences[self.last].time >> 32) as i32, 8)?;
        self.newest = (self.newest + 1) & 3;
        self.last = self.newest;
        let time = i64::from(high) << 32 | i64::from(decoder.read_int()?);
        self.sequences[self.last] = Sequence { time, ..Sequence::default() };
        Ok(())
    }

    /// The next time of a sequence: the last `difference` times what the symbol says, and what that is off by.
    fn advance<R: Read>(&mut self, decoder: &mut ArithmeticDecoder<R>, difference: i32, symbol: i32) -> Result<()> {
        let (most, least) = MOST;
        let times = if symbol <= most { symbol } else { most - symbol };
        let (context, far_off) = match times {
            0 => (7, true),
            1 => (1, false),
            2..10 => (2, false),
            _ if times == most => (4, true),
            10.. => (3, false),
            _ if times > least => (5, false),
            _ => (6, true),
        };
        let found = self.numbers.decompress(decoder, times.wrapping_mul(difference), context)?;
        let sequence = &mut self.sequences[self.last];
        sequence.time = sequence.time.wrapping_add(i64::from(found));
        if times == 1 {
            sequence.far_off = 0;
        } else if far_off {
            sequence.far_off += 1;
            if sequence.far_off > FAR_OFF {
                (sequence.difference, sequence.far_off) = (found, 0);
            }
        }
        Ok(())
    }
}

impl<R: Read> FieldDecompressor<R> for GpsTimes {
    fn size_of_field(&self) -> usize {
        8
    }

    fn decompress_first(&mut self, source: &mut R, first: &mut [u8]) -> Result<()> {
        source.read_exact(first)?;
        self.sequences[0].time = LE::read_i64(first);
        Ok(())
    }

    fn decompress_with(&mut self, decoder: &mut ArithmeticDecoder<R>, time: &mut [u8]) -> Result<()> {
        self.next(decoder)?;
        LE::write_i64(time, self.sequences[self.last].time);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use laz::encoders::ArithmeticEncoder;
    use laz::las::v2::{GpsTimeCompressor, LasPoint0Compressor, LasPoint0Decompressor};
    use laz::record::{
        FieldCompressor, RecordCompressor, RecordDecompressor, SequentialPointRecordCompressor,
        SequentialPointRecordDecompressor,
    };
    use proptest::prelude::*;

    use super::*;

    fn decompressed(bytes: &[u8], count: usize) -> Result<Vec<f64>> {
        let mut decompressor = SequentialPointRecordDecompressor::new(bytes);
        decompressor.add_field_decompressor(LasPoint0Decompressor::default());
        decompressor.add_field_decompressor(GpsTimes::default());
        let mut record = [0; 28];
        (0..count).map(|_| decompressor.decompress_next(&mut record).map(|()| LE::read_f64(&record[20..]))).collect()
    }

    proptest! {
        #[test]
        fn what_is_compressed_comes_back(
            steps in prop::collection::vec((0usize..6, -1e-3f64..1e-3, 1i32..700, 1u32..9), 1..60),
        ) {
            let mut times = vec![1000.0f64];
            let (mut usual, mut tracks) = (1e-6, [1000.0, 5e8, -3.0, 0.1]);
            for (kind, value, many, repeated) in steps {
                for i in 0..repeated {
                    let last = *times.last().unwrap();
                    times.push(match kind {
                        0 => last,
                        1 => last + usual,
                        2 => last + f64::from(many - 100) * usual,
                        3 => { usual = value; last + value }
                        4 => { let track = &mut tracks[(i as usize + many as usize) % 4]; *track += usual; *track }
                        _ => value * 1e9,
                    });
                }
            }
            let mut compressor = SequentialPointRecordCompressor::new(Vec::new());
            compressor.add_field_compressor(LasPoint0Compressor::default());
            compressor.add_field_compressor(GpsTimeCompressor::default());
            for time in &times {
                compressor.compress_next(&[&[0; 20][..], &time.to_le_bytes()].concat()).unwrap();
            }
            compressor.done().unwrap();
            prop_assert_eq!(decompressed(&compressor.into_inner(), times.len()).unwrap(), times);
        }
    }

    /// Changes sequences, and nothing else.
    struct Changing(ArithmeticModel, u32);

    impl<W: std::io::Write> FieldCompressor<W> for Changing {
        fn size_of_field(&self) -> usize {
            8
        }
        fn compress_first(&mut self, out: &mut W, first: &[u8]) -> Result<()> {
            out.write_all(first)
        }
        fn compress_with(&mut self, encoder: &mut ArithmeticEncoder<W>, _: &[u8]) -> Result<()> {
            (0..self.1).try_for_each(|_| encoder.encode_symbol(&mut self.0, 3))?;
            encoder.encode_symbol(&mut self.0, 0)
        }
    }

    #[test]
    fn sequences_that_change_without_end_are_an_error() {
        for (changes, right) in [(1, true), (4, true), (5, false), (200_000, false)] {
            let mut compressor = SequentialPointRecordCompressor::new(Vec::new());
            compressor.add_field_compressor(LasPoint0Compressor::default());
            compressor.add_field_compressor(Changing(ArithmeticModel::new(6, true, &[]), changes));
            for _ in 0..2 {
                compressor.compress_next(&[0; 28]).unwrap();
            }
            compressor.done().unwrap();
            assert_eq!(decompressed(&compressor.into_inner(), 2).is_ok(), right);
        }
    }
}
