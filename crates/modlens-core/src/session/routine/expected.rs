//! What the answer to a plain request is like.

use std::ops::RangeInclusive;

use crate::checksum::crc_valid_at;
use crate::framer::Mode;
use crate::functions::{Functions, Plain};
use crate::points::sunspec::may_begin_in;
use crate::stats::Key;

/// Units that may be asked on a serial line without anything to be said of it (serial line specification, 2.2).
const ADDRESSES: RangeInclusive<u8> = 1..=247;

/// Unit, function, address, quantity (application protocol, 6.1 to 6.4).
const ASKED: usize = 6;

/// Unit, function and count.
const HEAD: usize = 3;

/// Bytes before the unit: transaction, protocol and length (messaging on TCP/IP, 3.1.3).
const MBAP: usize = 6;

/// Bytes of the checksum of RTU.
const CHECKSUM: usize = 2;

/// An exchange as a request announces it.
pub(super) struct Expected {
    pub mode: Mode,
    pub unit: u8,
    pub code: u8,
    /// Transaction identifier.
    pub id: Option<u16>,
    /// Bytes of the request on the wire.
    pub asked: usize,
    /// Bytes of the answer on the wire.
    pub answered: usize,
    count: u8,
    /// Bits of the last data byte that were not asked for.
    padding: u8,
    pub key: Key,
}

impl Expected {
    /// Of a request at the head of these bytes that asks for what may be asked for.
    #[inline]
    pub(super) fn of(functions: &Functions, mode: Mode, bytes: &[u8]) -> Option<Self> {
        let tcp = mode == Mode::Tcp;
        let (before, behind) = if tcp { (MBAP, 0) } else { (0, CHECKSUM) };
        let request: &[u8; ASKED] = bytes.get(before..)?.first_chunk()?;
        let [unit, code, high, low, ..] = *request;
        let row = functions.row(code, &request[2..])?;
        let kind = row.plain.filter(|_| tcp || ADDRESSES.contains(&unit))?;
        let (address, quantity) = (u16::from_be_bytes([high, low]), u16::from_be_bytes([request[4], request[5]]));
        let allowed = row.permits[0].iter().all(|permit| permit.violated_by(&request[2..]).is_none());
        let count = if kind == Plain::Bits { quantity.div_ceil(8) } else { quantity.saturating_mul(2) };
        // The old answer once more may look like this request; and the profile of a unit may begin there.
        let ambiguous = !tcp && usize::from(high) + HEAD == ASKED;
        let marked = kind == Plain::Registers && may_begin_in(address, usize::from(quantity));
        let id = tcp.then(|| u16::from_be_bytes([bytes[0], bytes[1]]));
        if !allowed || ambiguous || marked || (tcp && bytes[2..MBAP] != [0, 0, 0, ASKED as u8]) {
            return None;
        }
        let rest = quantity % 8;
        let padding = if kind == Plain::Bits && rest > 0 { 0xFF << rest } else { 0 };
        let (asked, answered) = (before + ASKED + behind, before + HEAD + usize::from(count) + behind);
        let (count, key) = (u8::try_from(count).ok()?, Key::reading(unit, code, address, quantity));
        Some(Self { mode, unit, code, id, asked, answered, count, padding, key })
    }

    /// Whether these bytes begin with a whole answer.
    #[inline]
    pub(super) fn is_answered(&self, bytes: &[u8]) -> bool {
        let length = self.answered;
        let head = [self.unit, self.code, self.count];
        if bytes.len() < length {
            return false;
        }
        let Some(id) = self.id else {
            let last = bytes[length - 1 - CHECKSUM];
            return bytes[..HEAD] == head && self.padding & last == 0 && crc_valid_at(bytes, length);
        };
        let [id, other] = id.to_be_bytes();
        let header = [id, other, 0, 0, 0, (length - MBAP) as u8];
        bytes[..MBAP] == header && bytes[MBAP..MBAP + HEAD] == head && self.padding & bytes[length - 1] == 0
    }

    /// Where the PDU stands in a frame, and what of its length is not PDU.
    pub(super) fn around(&self) -> (usize, usize) {
        match self.mode {
            Mode::Tcp => (MBAP + 1, MBAP + 1),
            _ => (1, 1 + CHECKSUM),
        }
    }
}
