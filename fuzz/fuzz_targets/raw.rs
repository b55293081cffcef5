//! A side-car, two zeros, and the raw file it describes.
#![no_main]

libfuzzer_sys::fuzz_target!(|both: &[u8]| {
    let end = both.windows(2).position(|two| two == [0, 0]).unwrap_or(both.len());
    let content = both.get(end + 2..).unwrap_or_default();
    asra_stream_fuzz::read(&[("cloud.bin", content), ("cloud.bin.json", &both[..end])]);
});
