//! What small files of a work folder hold: values with a checksum; and where two of them differ.

use serde::{Deserialize, Serialize};
use serde_json::Value;

/// What a file of manifests or of the job holds: a value, and the checksum of how it is written.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Sealed {
    crc: u32,
    value: Value,
}

impl Sealed {
    pub fn bytes(value: &Value) -> Vec<u8> {
        let crc = crc32fast::hash(value.to_string().as_bytes());
        let sealed = Sealed { crc, value: value.clone() };
        let mut bytes = serde_json::to_vec_pretty(&sealed).expect("a value can be written");
        bytes.push(b'\n');
        bytes
    }

    /// The value, if it is whole.
    pub fn open(bytes: &[u8]) -> Option<Value> {
        let Sealed { crc, value } = serde_json::from_slice(bytes).ok()?;
        (crc32fast::hash(value.to_string().as_bytes()) == crc).then_some(value)
    }
}

/// A place where two values differ.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Difference {
    /// The keys that lead there.
    pub at: String,
    /// What was written down there.
    pub there: String,
    /// What it is now.
    pub here: String,
}

/// The first place where two values differ.
pub(super) fn difference(at: &str, there: &Value, here: &Value) -> Option<Difference> {
    let below = |key: &str| if at.is_empty() { key.to_owned() } else { format!("{at}.{key}") };
    match (there, here) {
        (Value::Object(a), Value::Object(b)) => {
            let mut keys: Vec<&String> = a.keys().chain(b.keys()).collect();
            // Inputs before the grid that is laid on them.
            keys.sort_unstable_by_key(|key| (*key == "grid", *key));
            keys.dedup();
            let value = |of: &serde_json::Map<String, Value>, key: &str| of.get(key).cloned().unwrap_or(Value::Null);
            keys.into_iter().find_map(|key| difference(&below(key), &value(a, key), &value(b, key)))
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            let mut pairs = a.iter().zip(b).enumerate();
            pairs.find_map(|(number, (a, b))| difference(&below(&number.to_string()), a, b))
        }
        (a, b) if a == b => None,
        (a, b) => Some(Difference { at: at.to_owned(), there: a.to_string(), here: b.to_string() }),
    }
}
