//! Exchanges that leave no doubt: a plain request, and what its answer has to be like.

use std::ops::RangeInclusive;

use modlens_protocol::framing::Mode;
use modlens_protocol::functions::{Functions, Plain};

/// Units that may be asked on a serial line without anything to be said of it (serial line specification, 2.2).
const ADDRESSES: RangeInclusive<u8> = 1..=247;

/// Unit, function, address, quantity or value (application protocol, 6.1 to 6.6).
const ASKED: usize = 6;

/// Unit, function and count.
const HEAD: usize = 3;

/// What is asked, a count, and as many bytes (6.11, 6.12).
const WRITTEN: usize = ASKED + 1;

/// What the answer has to be.
#[derive(Clone, Copy, Debug)]
enum Answer {
    /// So many bytes; these bits of the last one were not asked for.
    Block { count: u8, padding: u8 },
    /// The beginning of the request.
    Repeated,
}

/// An exchange as a request announces it. Lengths are those of unit and PDU.
#[derive(Clone, Copy, Debug)]
pub struct Exchange {
    /// Unit.
    pub unit: u8,
    /// Function code.
    pub code: u8,
    /// What is done.
    pub kind: Plain,
    /// First register or bit.
    pub address: u16,
    /// How many of them.
    pub quantity: u16,
    /// Bytes of the request.
    pub asked: usize,
    /// Bytes of the answer.
    pub answered: usize,
    /// Request and answer are the same.
    pub mirrored: bool,
    /// An answer to such a request has this one's length and beginning: the one before, once more, may look like it.
    pub ambiguous: bool,
    answer: Answer,
}

impl Exchange {
    /// Of a request at the head of these bytes, its unit first, that asks for what may be asked for.
    #[inline(always)]
    #[allow(clippy::inline_always)] // What it gives is large, and taken apart at once.
    pub fn of(functions: &Functions, mode: Mode, bytes: &[u8]) -> Option<Self> {
        let request: &[u8; ASKED] = bytes.first_chunk()?;
        let [unit, code, high, low, ..] = *request;
        let asks = functions.asks(code).filter(|_| mode == Mode::Tcp || ADDRESSES.contains(&unit))?;
        let (address, number) = (u16::from_be_bytes([high, low]), u16::from_be_bytes([request[4], request[5]]));
        if !asks.permits(functions, code, number, &request[2..]) {
            return None;
        }
        let (bits, registers) = (usize::from(number.div_ceil(8)), 2 * usize::from(number));
        let (kind, mirrored, asked, answered) = (asks.kind, asks.mirrored, ASKED, ASKED);
        let answer = Answer::Repeated;
        let plain = Self { unit, code, kind, address, quantity: number, asked, answered, mirrored, ambiguous: false, answer };
        let read = |count: usize, padding: u8| {
            // A request that could be its own answer leaves doubt.
            let ambiguous = mode != Mode::Tcp && usize::from(high) + HEAD == ASKED;
            let count = u8::try_from(count).ok().filter(|&count| !ambiguous || count != high)?;
            let answered = HEAD + usize::from(count);
            Some(Self { answered, mirrored: false, ambiguous, answer: Answer::Block { count, padding }, ..plain })
        };
        let written = |count: usize| (bytes.get(ASKED).copied().map(usize::from) == Some(count)).then_some(WRITTEN + count);
        match kind {
            Plain::ReadBits => read(bits, padding(number)),
            Plain::ReadRegisters => read(registers, 0),
            Plain::WriteBits => Some(Self { asked: written(bits)?, ..plain }),
            Plain::WriteRegisters => Some(Self { asked: written(registers)?, ..plain }),
            Plain::WriteOne => Some(Self { quantity: 1, ..plain }),
        }
    }

    /// Whether this is the answer; both have the lengths expected.
    #[inline]
    pub fn is_answered(&self, request: &[u8], response: &[u8]) -> bool {
        match self.answer {
            Answer::Block { count, padding } => {
                response[..HEAD] == [self.unit, self.code, count] && response[self.answered - 1] & padding == 0
            }
            Answer::Repeated => response[..ASKED] == request[..ASKED],
        }
    }

    /// The block that was read.
    pub fn block<'a>(&self, response: &'a [u8]) -> Option<&'a [u8]> {
        matches!(self.answer, Answer::Block { .. }).then(|| &response[HEAD..])
    }
}

/// The bits of the last byte that nobody asked for.
fn padding(quantity: u16) -> u8 {
    match quantity % 8 {
        0 => 0,
        rest => 0xFF << rest,
    }
}
