//! Recordings of any kind, by their first bytes.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| modlens_fuzz::recording_holds(data));
