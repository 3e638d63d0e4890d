//! Decodes the marks with which a POSIX terminal driver reports line errors within the received bytes.
//!
//! With `INPCK` and `PARMRK` set, the driver delivers a byte with a parity or framing error as `FF 00 x`, a break as
//! `FF 00 00`, and a valid `FF` as `FF FF` (termios(3)). The decoder restores the received bytes and reports the positions
//! of the marked ones. A mark means that the receiver doubts a byte, but the byte was on the line: drivers of USB adapters
//! mark whole packets.

/// The byte that begins a mark.
const ESCAPE: u8 = 0xFF;

/// What the last bytes were the beginning of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum State {
    #[default]
    Plain,
    Escaped,
    Marked,
}

/// Decodes the marks of one line; a mark may be split between two reads.
///
/// ```
/// use modlens_readers::parmrk::ParmrkDecoder;
/// let (mut bytes, mut errors) = (Vec::new(), Vec::new());
/// let mut decoder = ParmrkDecoder::default();
/// decoder.push(&[0x01, 0xFF, 0xFF, 0xFF, 0x00], &mut bytes, &mut errors);
/// decoder.push(&[0x42, 0x07], &mut bytes, &mut errors);
/// assert_eq!((bytes, errors), (vec![0x01, 0xFF, 0x42, 0x07], vec![2]));
/// ```
#[derive(Clone, Debug, Default)]
pub struct ParmrkDecoder {
    state: State,
}

impl ParmrkDecoder {
    /// Appends the bytes of a read to `bytes`, and the positions in `bytes` of marked ones to `error_positions`.
    ///
    /// A sequence that no driver writes is kept as it is, so that no byte is ever lost.
    pub fn push(&mut self, raw: &[u8], bytes: &mut Vec<u8>, error_positions: &mut Vec<u32>) {
        for &byte in raw {
            self.state = match (self.state, byte) {
                (State::Plain, ESCAPE) => State::Escaped,
                (State::Escaped, 0) => State::Marked,
                (State::Marked, _) => {
                    error_positions.push(bytes.len() as u32);
                    bytes.push(byte);
                    State::Plain
                }
                (State::Escaped, other) => {
                    bytes.push(ESCAPE);
                    if other != ESCAPE {
                        bytes.push(other);
                    }
                    State::Plain
                }
                (State::Plain, _) => {
                    bytes.push(byte);
                    State::Plain
                }
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The sequence that a driver delivers (termios(3), PARMRK).
    fn marked(sent: &[(u8, bool)]) -> Vec<u8> {
        let escape = |&(byte, error): &(u8, bool)| match (byte, error) {
            (byte, true) => vec![0xFF, 0, byte],
            (0xFF, false) => vec![0xFF, 0xFF],
            (byte, false) => vec![byte],
        };
        sent.iter().flat_map(escape).collect()
    }

    proptest! {
        #[test]
        fn every_byte_and_every_mark_comes_back(sent: Vec<(u8, bool)>, cut in 1usize..9) {
            let (mut bytes, mut error_positions) = (Vec::new(), Vec::new());
            let mut decoder = ParmrkDecoder::default();
            for read in marked(&sent).chunks(cut) {
                decoder.push(read, &mut bytes, &mut error_positions);
            }
            prop_assert_eq!(&bytes, &sent.iter().map(|(byte, _)| *byte).collect::<Vec<_>>());
            let places: Vec<u32> = (0u32..).zip(&sent).filter(|(_, (_, error))| *error).map(|(at, _)| at).collect();
            prop_assert_eq!(error_positions, places);
        }
    }

    #[test]
    fn a_sequence_that_no_driver_writes_is_kept() {
        let (mut bytes, mut error_positions) = (Vec::new(), Vec::new());
        ParmrkDecoder::default().push(&[0xFF, 0x01, 0x02], &mut bytes, &mut error_positions);
        assert_eq!((bytes, error_positions), (vec![0xFF, 0x01, 0x02], vec![]));
    }
}
