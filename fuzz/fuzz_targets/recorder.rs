//! Raw recordings, written and read back.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| modlens_fuzz::recorder_holds(data));
