//! LAS and LAZ.
#![no_main]

libfuzzer_sys::fuzz_target!(|content: &[u8]| asra_stream_fuzz::read(&[("cloud.laz", content)]));
