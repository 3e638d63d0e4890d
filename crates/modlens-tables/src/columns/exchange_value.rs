//! What columns show of compact exchanges, where that is at a place that is the same for all of a bus and a kind: a writer need
//! not make their rows to find it.

use modlens_engine::records::ExchangeFrame;
use modlens_protocol::functions::{FunctionRow, Operation};

/// The column that shows values of a profile, if one applies to the unit.
pub(super) const PROFILE_COLUMN: &str = "readings";

/// What a column shows of the exchanges of a bus and a kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExchangeValue {
    /// One of their numbers.
    Number(ExchangeNumber),
    /// The number in two bytes of the request's body, at this offset.
    RequestWord(usize),
    /// The list with this number alone.
    ListOfRequestWord(usize),
    /// When the request began.
    Time,
    /// A duration, which may be unknown.
    Duration(ExchangeDuration),
    /// Whether the confidence is low.
    Unconfirmed,
    /// All bytes of a frame.
    Frame(ExchangeFrame),
    /// The registers from this offset of a body on.
    Registers(ExchangeFrame, usize),
    /// The bits from this offset of a body on, as many as the quantity says.
    Bits(ExchangeFrame, usize),
    /// The position in the input, whose number is `ExchangeNumber::Origin`.
    Source,
}

/// A number that compact exchanges hold as a column shows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExchangeNumber {
    /// That of the transaction.
    Txn,
    /// The unit.
    Unit,
    /// Address of the first register or bit that is read.
    Address,
    /// How many are read.
    Quantity,
    /// The confidence.
    Confidence,
    /// The identifier in the MBAP headers.
    MbapId,
    /// The number of the request's frame.
    RequestFrame,
    /// The number of the response's frame.
    ResponseFrame,
    /// Offset, packet or line of the request in the input.
    Origin,
}

impl ExchangeNumber {
    /// How many there are.
    pub const COUNT: usize = Self::Origin as usize + 1;

    /// The number that a column shows, where it has a value; `None` if it shows something else. What is written is left out: a
    /// request to read and write (function 23) has an address and a quantity for either.
    pub fn of_column(key: &str) -> Option<Self> {
        Some(match key {
            "txn" => Self::Txn,
            "unit" => Self::Unit,
            "address" => Self::Address,
            "quantity" => Self::Quantity,
            "confidence" => Self::Confidence,
            "mbap_id" => Self::MbapId,
            "request_frame" => Self::RequestFrame,
            "response_frame" => Self::ResponseFrame,
            _ => return None,
        })
    }
}

/// A duration of a compact exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExchangeDuration {
    /// From the start of the recording to the request.
    Elapsed,
    /// From the end of the request to the response.
    Response,
    /// The silence before the request.
    Gap,
}

impl ExchangeValue {
    /// What a column shows of exchanges of a function with this row, where it has a value; `None` if that has to be read from their
    /// rows.
    pub(super) fn of_column(key: &str, row: &FunctionRow) -> Option<Self> {
        if let Some(number) = ExchangeNumber::of_column(key) {
            return Some(Self::Number(number));
        }
        let (offsets, operation) = (&row.offsets, row.operation);
        let is_write = operation == Operation::Write;
        Some(match key {
            "write_address" => Self::RequestWord(if is_write { offsets.address } else { offsets.write_address }?),
            "write_quantity" => Self::RequestWord(if is_write { offsets.quantity } else { offsets.write_quantity }?),
            "time" => Self::Time,
            "elapsed_us" => Self::Duration(ExchangeDuration::Elapsed),
            "response_time_us" => Self::Duration(ExchangeDuration::Response),
            "gap_us" => Self::Duration(ExchangeDuration::Gap),
            "unconfirmed" => Self::Unconfirmed,
            "request_hex" => Self::Frame(ExchangeFrame::Request),
            "response_hex" => Self::Frame(ExchangeFrame::Response),
            "data" => Self::block(ExchangeFrame::Response, offsets.response_block?, row)?,
            // A coil is 0 or 1, and not as it is in the request.
            "write_data" if offsets.value.is_some() => {
                Self::ListOfRequestWord(offsets.value.filter(|_| row.register_type.as_deref() != Some("coil"))?)
            }
            "write_data" => Self::block(ExchangeFrame::Request, offsets.request_block?, row)?,
            "source" => Self::Source,
            _ => return None,
        })
    }

    /// The registers or bits of a body. Of bits, exchanges hold how many there are where they are either read or written.
    fn block(half: ExchangeFrame, (at, bits): (usize, bool), row: &FunctionRow) -> Option<Self> {
        if !bits {
            return Some(Self::Registers(half, at));
        }
        (row.operation != Operation::ReadWrite && row.offsets.quantity.is_some()).then_some(Self::Bits(half, at))
    }
}
