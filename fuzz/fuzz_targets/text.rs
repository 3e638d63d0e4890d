//! Recordings in text.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| modlens_fuzz::text_holds(data));
