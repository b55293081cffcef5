//! gzip and Zstandard, with points of any format in them.
#![no_main]

libfuzzer_sys::fuzz_target!(|content: &[u8]| asra_stream_fuzz::read(&[("cloud.gz", content)]));
