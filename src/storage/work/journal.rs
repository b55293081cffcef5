//! A journal: lines that are appended one by one. A line is whole or it is not there: each begins with the checksum of the rest.
//!
//! ```text
//!  9a1c03ff {"slab":12, ...}
//! ```

use std::io::{self, Write};

use serde_json::Value;

use super::store::NamedFile;

/// The most bytes that are read of a journal; a run writes a line now and then.
const MOST: u64 = 64 << 20;

/// A journal that is open to be appended to.
#[derive(Debug)]
pub struct Journal {
    file: NamedFile,
    end: u64,
}

impl Journal {
    /// An empty one in a new file.
    pub fn new(file: NamedFile) -> Journal {
        Journal { file, end: 0 }
    }

    /// The whole lines of one that is there, and where each ends.
    ///
    /// # Errors
    /// What the system says.
    pub fn lines(file: &NamedFile) -> io::Result<Vec<(Value, u64)>> {
        let mut bytes = vec![0; file.file.length()?.min(MOST) as usize];
        file.file.read_at(&mut bytes, 0)?;
        let (mut lines, mut end) = (Vec::new(), 0);
        for line in bytes.split_inclusive(|byte| *byte == b'\n') {
            let Some(value) = read(line) else { break };
            end += line.len() as u64;
            lines.push((value, end));
        }
        Ok(lines)
    }

    /// One that goes on behind a line that ends at `end`.
    ///
    /// # Errors
    /// What the system says.
    pub fn resumed(file: NamedFile, end: u64) -> io::Result<Journal> {
        file.file.cut(end)?;
        Ok(Journal { file, end })
    }

    /// What writes the next line, wherever that is done; lines have to be written in the order in which this is asked for.
    pub fn line(&mut self, value: &Value) -> impl FnOnce(bool) -> io::Result<()> + Send + 'static + use<> {
        let text = value.to_string();
        let mut line = Vec::with_capacity(text.len() + 10);
        writeln!(line, "{:08x} {text}", crc32fast::hash(text.as_bytes())).expect("memory takes what is written");
        let (file, at) = (self.file.clone(), self.end);
        self.end += line.len() as u64;
        move |durable| {
            file.file.write_at(&line, at)?;
            if durable { file.file.sync() } else { Ok(()) }
        }
    }
}

/// The value of a line that is whole.
fn read(line: &[u8]) -> Option<Value> {
    let line = std::str::from_utf8(line).ok()?.strip_suffix('\n')?;
    let (crc, text) = line.split_once(' ')?;
    let crc = u32::from_str_radix(crc, 16).ok()?;
    (crc32fast::hash(text.as_bytes()) == crc).then(|| serde_json::from_str(text).ok()).flatten()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use serde_json::json;

    use super::*;
    use crate::storage::work::simulated::Simulated;
    use crate::storage::work::store::Store;

    proptest! {
        /// Whatever a file that was torn or changed holds, the lines that are read are the first of those that were written.
        #[test]
        fn what_is_read_is_a_beginning_of_what_was_written(
            values in prop::collection::vec("[a-z ]{0,20}", 0..8),
            cut in 0.0..1.2f64,
            flip in prop::option::of((0.0..1.0f64, 0u8..8)),
        ) {
            let store = Simulated::default();
            let file = NamedFile { file: store.create("data/journal.0").unwrap(), name: "data/journal.0".into() };
            let mut journal = Journal::new(file.clone());
            for (slab, value) in values.iter().enumerate() {
                journal.line(&json!({ "slab": slab, "value": value }))(true).unwrap();
            }
            let length = file.file.length().unwrap();
            let end = ((length as f64 * cut) as u64).min(length);
            file.file.cut(end).unwrap();
            let mut changed = end;
            if let Some((place, bit)) = flip.filter(|_| end > 0) {
                changed = (place * end as f64) as u64;
                let mut byte = [0];
                file.file.read_at(&mut byte, changed).unwrap();
                byte[0] ^= 1 << bit;
                file.file.write_at(&byte, changed).unwrap();
            }
            let lines = Journal::lines(&file).unwrap();
            for (slab, (line, _)) in lines.iter().enumerate() {
                prop_assert_eq!(line, &json!({ "slab": slab, "value": values[slab] }));
            }
            // All that end before the change are read.
            prop_assert!(lines.last().map_or(0, |(_, end)| *end) <= end.max(changed));
            let mut whole = 0;
            for (slab, value) in values.iter().enumerate() {
                whole += 10 + json!({ "slab": slab, "value": value }).to_string().len() as u64;
                prop_assert!(whole > changed || lines.len() > slab);
            }
        }
    }
}
