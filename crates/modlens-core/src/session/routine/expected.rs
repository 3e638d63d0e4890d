//! What the answer to a plain request is like.

use std::ops::RangeInclusive;

use crate::framer::Mode;
use crate::functions::{Functions, Plain};
use crate::points::sunspec::may_begin_in;
use crate::stats::Key;

/// Units that may be asked on a serial line without anything to be said of it (serial line specification, 2.2).
const ADDRESSES: RangeInclusive<u8> = 1..=247;

/// Unit, function, address, quantity or value (application protocol, 6.1 to 6.6).
const ASKED: usize = 6;

/// Unit, function and count.
const HEAD: usize = 3;

/// What is asked, a count, and as many bytes (6.11, 6.12).
const WRITTEN: usize = ASKED + 1;

/// What the answer has to be.
enum Answer {
    /// So many bytes; these bits of the last one were not asked for.
    Block { count: u8, padding: u8 },
    /// The beginning of the request.
    Repeated,
}

/// An exchange as a request announces it. Lengths are those of unit and PDU.
pub(super) struct Expected {
    pub unit: u8,
    pub code: u8,
    pub asked: usize,
    pub answered: usize,
    /// Request and answer are the same.
    pub mirrored: bool,
    /// The answer is a block of registers or bits that was read.
    pub reads: bool,
    pub key: Key,
    answer: Answer,
}

impl Expected {
    /// Of a request at the head of these bytes, its unit first, that asks for what may be asked for.
    #[inline]
    pub(super) fn of(functions: &Functions, mode: Mode, bytes: &[u8]) -> Option<Self> {
        let request: &[u8; ASKED] = bytes.first_chunk()?;
        let [unit, code, high, low, ..] = *request;
        let row = functions.row(code, &request[2..])?;
        let kind = row.plain.filter(|_| mode == Mode::Tcp || ADDRESSES.contains(&unit))?;
        let (address, number) = (u16::from_be_bytes([high, low]), u16::from_be_bytes([request[4], request[5]]));
        if !row.permits[0].iter().all(|permit| permit.violated_by(&request[2..]).is_none()) {
            return None;
        }
        let (bits, registers) = (usize::from(number.div_ceil(8)), 2 * usize::from(number));
        let read = |count| Self::read(mode, *request, count, Key::plain(unit, code, address, number));
        let write = |asked, quantity| Self {
            unit,
            code,
            asked,
            answered: ASKED,
            mirrored: row.mirrored,
            reads: false,
            key: Key::plain(unit, code, address, quantity),
            answer: Answer::Repeated,
        };
        let written = |count: usize| (bytes.get(ASKED).copied().map(usize::from) == Some(count)).then_some(WRITTEN + count);
        match kind {
            Plain::ReadBits => read(bits).map(|read| read.padded(number)),
            // The profile of a unit may begin there.
            Plain::ReadRegisters if may_begin_in(address, usize::from(number)) => None,
            Plain::ReadRegisters => read(registers),
            Plain::WriteBits => Some(write(written(bits)?, number)),
            Plain::WriteRegisters => Some(write(written(registers)?, number)),
            Plain::WriteOne => Some(write(ASKED, 1)),
        }
    }

    fn read(mode: Mode, [unit, code, high, ..]: [u8; ASKED], count: usize, key: Key) -> Option<Self> {
        // The old answer once more may look like this request.
        if mode != Mode::Tcp && usize::from(high) + HEAD == ASKED {
            return None;
        }
        let count = u8::try_from(count).ok()?;
        let answer = Answer::Block { count, padding: 0 };
        Some(Self { unit, code, asked: ASKED, answered: HEAD + usize::from(count), mirrored: false, reads: true, key, answer })
    }

    /// The same, where so many bits are asked for.
    fn padded(self, quantity: u16) -> Self {
        let rest = quantity % 8;
        match self.answer {
            Answer::Block { count, .. } if rest > 0 => Self { answer: Answer::Block { count, padding: 0xFF << rest }, ..self },
            _ => self,
        }
    }

    /// Whether this is the answer; both have the lengths expected.
    #[inline]
    pub(super) fn is_answered(&self, request: &[u8], response: &[u8]) -> bool {
        match self.answer {
            Answer::Block { count, padding } => {
                response[..HEAD] == [self.unit, self.code, count] && response[self.answered - 1] & padding == 0
            }
            Answer::Repeated => response[..ASKED] == request[..ASKED],
        }
    }

    /// The block that was read.
    pub(super) fn block<'a>(&self, response: &'a [u8]) -> Option<&'a [u8]> {
        self.reads.then(|| &response[HEAD..])
    }
}
