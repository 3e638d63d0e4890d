//! All tables of rows, as text.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| modlens_fuzz::tables_hold(data));
