//! Tally: how many points there are of each class and each return, for `info`.

use std::collections::BTreeMap;

use crate::error::Result;
use crate::input::{Carried, Cloud};
use crate::points::Batch;
use crate::points::scalar::{Endian, reader};
use crate::resources::workers::Workers;

/// The attributes that are counted by value.
pub const COUNTED: [&str; 3] = ["classification", "return_number", "number_of_returns"];

/// Points by value of an attribute: whole numbers up to 255.
pub type Counts = BTreeMap<u8, u64>;

/// Points by class and return, of those that count. Empty where no file tells.
#[derive(Debug, Clone, PartialEq, Eq, Default, serde::Serialize)]
pub struct Tally {
    /// By class.
    pub classification: Counts,
    /// By the number of the return.
    pub return_number: Counts,
    /// By how many returns the pulse had.
    pub number_of_returns: Counts,
}

impl Tally {
    /// Whether there is anything to count.
    pub fn is_of_use(cloud: &Cloud) -> bool {
        COUNTED.iter().any(|name| cloud.has_attribute(name))
    }

    /// Counts, in one pass. `progress` is told the records of each block. Memory: a table of 256 numbers for each attribute and block in flight.
    ///
    /// # Errors
    /// Errors of reading the input; [`crate::Error::Interrupted`].
    pub fn of(cloud: &Cloud, workers: &Workers, mut progress: impl FnMut(u64)) -> Result<Tally> {
        let schema = cloud.schema_of(&COUNTED);
        let columns = COUNTED
            .map(|name| schema.column(name).map(|column| (column.offset, reader(column.scalar, Endian::NATIVE))));
        let stride = schema.stride();
        let count = |batch: &Batch| {
            let mut found = [[0u64; 256]; COUNTED.len()];
            for record in batch.attributes.chunks_exact(stride.max(1)) {
                for (found, column) in found.iter_mut().zip(&columns) {
                    let Some((at, read)) = column else { continue };
                    let value = read(&record[*at..]);
                    if (0.0..256.0).contains(&value) {
                        found[value as usize] += 1;
                    }
                }
            }
            Ok((found, batch.records()))
        };
        let mut total = [[0u64; 256]; COUNTED.len()];
        cloud.for_each_batch(workers, 2 * workers.threads(), Carried::Only(&COUNTED), count, |(found, records)| {
            for (total, found) in total.iter_mut().zip(&found) {
                total.iter_mut().zip(found).for_each(|(total, found)| *total += found);
            }
            progress(records);
            Ok(())
        })?;
        let [classification, return_number, number_of_returns] = [0, 1, 2].map(|i| {
            let values = total[i].iter().enumerate().filter(|(_, count)| **count > 0);
            // What no file tells is read as zero.
            columns[i].map_or_else(Counts::new, |_| values.map(|(value, count)| (value as u8, *count)).collect())
        });
        Ok(Tally { classification, return_number, number_of_returns })
    }
}

/// What the LAS specification calls a class.
pub fn class_name(class: u8) -> Option<&'static str> {
    Some(match class {
        0 => "never classified",
        1 => "unclassified",
        2 => "ground",
        3 => "low vegetation",
        4 => "medium vegetation",
        5 => "high vegetation",
        6 => "building",
        7 => "low noise",
        9 => "water",
        10 => "rail",
        11 => "road surface",
        13 => "wire guard",
        14 => "wire conductor",
        15 => "transmission tower",
        16 => "wire connector",
        17 => "bridge deck",
        18 => "high noise",
        19 => "overhead structure",
        20 => "ignored ground",
        21 => "snow",
        22 => "temporal exclusion",
        _ => return None,
    })
}
