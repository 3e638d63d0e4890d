//! Stray bytes that a line driver leaves when it is switched on or off.

use crate::weights::MAX_GLITCH_BYTES;

/// Whether a line driver that is switched on or off can leave this byte. The line changes its level at most once, and the
/// low bit comes first, so the byte has zeros in its low bits and ones in the others: `00`, `80`, `C0` ... `FE`, `FF`.
pub fn is_glitch_byte(byte: u8) -> bool {
    byte.leading_ones() + byte.trailing_zeros() >= 8
}

/// Whether these stray bytes are what a line driver leaves when it is switched: at most three, all of one such value.
pub fn is_glitch(strays: &[u8]) -> bool {
    strays.len() <= MAX_GLITCH_BYTES && strays.iter().all(|&byte| is_glitch_byte(byte) && byte == strays[0])
}
