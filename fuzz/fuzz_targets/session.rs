//! Bytes with times, in blocks.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| modlens_fuzz::session_holds(data));
