//! What the doctor says.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| modlens_fuzz::diagnosis_holds(data));
