//! Profiles in all notations.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| modlens_fuzz::profile_holds(data));
