//! Line errors as a POSIX terminal driver tells them in the bytes themselves.
//!
//! With `INPCK` and `PARMRK` set, the driver writes a byte that it received with a parity or framing error as `FF 00 x`,
//! a break as `FF 00 00`, and a good `FF` as `FF FF` (termios(3)). Here the bytes are taken out again, each of them, and
//! the places of the marked ones are told beside them. A mark says that the receiver doubts a byte, never that it was
//! not on the line: drivers of USB adapters mark whole packets.

const ESCAPE: u8 = 0xFF;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum State {
    #[default]
    Plain,
    Escaped,
    Marked,
}

/// Takes escapes apart, wherever reads cut them.
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
    /// Appends the bytes of a read to `bytes`, and the places of marked ones in `bytes` to `errors`.
    ///
    /// What no driver writes behind an escape is taken as it stands: nothing is deleted.
    pub fn push(&mut self, raw: &[u8], bytes: &mut Vec<u8>, errors: &mut Vec<u32>) {
        for &byte in raw {
            self.state = match (self.state, byte) {
                (State::Plain, ESCAPE) => State::Escaped,
                (State::Escaped, 0) => State::Marked,
                (State::Marked, _) => {
                    errors.push(bytes.len() as u32);
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

    /// What a driver writes (termios(3), PARMRK).
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
            let (mut bytes, mut errors) = (Vec::new(), Vec::new());
            let mut decoder = ParmrkDecoder::default();
            for read in marked(&sent).chunks(cut) {
                decoder.push(read, &mut bytes, &mut errors);
            }
            prop_assert_eq!(&bytes, &sent.iter().map(|(byte, _)| *byte).collect::<Vec<_>>());
            let places: Vec<u32> = (0u32..).zip(&sent).filter(|(_, (_, error))| *error).map(|(at, _)| at).collect();
            prop_assert_eq!(errors, places);
        }
    }

    #[test]
    fn what_no_driver_writes_is_kept() {
        let (mut bytes, mut errors) = (Vec::new(), Vec::new());
        ParmrkDecoder::default().push(&[0xFF, 0x01, 0x02], &mut bytes, &mut errors);
        assert_eq!((bytes, errors), (vec![0xFF, 0x01, 0x02], vec![]));
    }
}
