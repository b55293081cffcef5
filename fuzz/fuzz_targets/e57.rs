//! What is in the pages of an E57 file: each gets its checksum (CRC-32C), without which all would be refused at once.
#![no_main]

use std::sync::LazyLock;

const CONTENT: usize = 1020;

static TABLE: LazyLock<[u32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|byte| (0..8).fold(byte as u32, |sum, _| sum >> 1 ^ if sum & 1 == 1 { 0x82f6_3b78 } else { 0 }))
});

fn checksum(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |sum: u32, byte| sum >> 8 ^ TABLE[usize::from(sum as u8 ^ byte)])
}

libfuzzer_sys::fuzz_target!(|content: &[u8]| {
    let mut file = Vec::new();
    for part in content.chunks(CONTENT) {
        let mut page = part.to_vec();
        page.resize(CONTENT, 0);
        let sum = checksum(&page);
        file.extend(page);
        file.extend(sum.to_be_bytes());
    }
    asra_stream_fuzz::read(&[("cloud.e57", &file)]);
});
