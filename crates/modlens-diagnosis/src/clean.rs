//! Exchanges that went well, with the little that is counted of them.

use modlens_engine::records::{Batch, Exchange, Span, Transaction};
use modlens_protocol::checksum::CRC_BYTES;
use modlens_protocol::functions::{FunctionRow, Functions, Operation};
use modlens_protocol::status::Status;
use modlens_protocol::Ns;

use crate::contrast::tally::Place;
use crate::observation::{data, Data, RequestKey};

/// Function codes of requests.
const FUNCTIONS: usize = 128;

/// A plain request and its good answer, no repetition, in time, and without a finding.
///
/// Nearly all exchanges of most recordings are such ones. They are counted in bulk, and what is counted of them is what
/// would be counted of their `Observation`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Clean {
    /// Number and time.
    pub place: Place,
    /// Index of its bus, or of its connection.
    pub bus: u32,
    /// Which request.
    pub key: RequestKey,
    /// Whether it writes.
    pub writes: bool,
    /// The request's PDU, in the arena of the batch.
    pub request: Span,
    /// What was read.
    pub data: Data,
    /// The registers that were read, in the arena of the batch, where the request has a time.
    pub registers: Span,
    /// From the end of the request to the start of the answer.
    pub response_time: Option<Ns>,
    /// Silence before the request.
    pub gap: Option<Ns>,
    /// Start of the request, and of the answer.
    pub starts: [Option<Ns>; 2],
}

impl Clean {
    /// What a row shows; `None` if it is none of these exchanges.
    #[inline]
    pub fn of(batch: &Batch, functions: &Functions, row: &Transaction) -> Option<Self> {
        let is_plain = row.status == Status::Ok
            && row.findings.length == 0
            && row.request.pdu.length > 0
            && row.retry_of.is_none()
            && row.late_response_to.is_none()
            && row.late_response.is_none()
            && row.waited.is_none()
            && row.exception.is_none();
        if !is_plain {
            return None;
        }
        let (request, response) = (row.request.pdu.of(&batch.arena), row.response.pdu.of(&batch.arena));
        let body = &request[1..];
        let row_of_function = functions.row(row.function, body)?;
        let u16_at = |at: usize| Some(u16::from_be_bytes([*body.get(at)?, *body.get(at + 1)?]));
        let address = u16_at(row_of_function.offsets.address?)?;
        let quantity = row_of_function.offsets.quantity.map_or(Some(1), u16_at)?;
        let shape = Shape::of(row_of_function);
        Some(Self {
            place: Place { number: row.number, elapsed: row.elapsed, time: row.start },
            bus: row.bus,
            key: RequestKey { unit: row.unit, function: row.function, address, quantity },
            writes: shape.writes,
            request: row.request.pdu,
            data: shape.data(response.get(shape.block as usize..)),
            registers: shape.registers(row),
            response_time: row.response_time,
            gap: row.gap,
            starts: [row.request.start, row.response.start],
        })
    }
}

/// What of a function's row is needed for an exchange that went well.
#[derive(Clone, Copy, Debug)]
struct Shape {
    /// Whether it writes.
    writes: bool,
    /// Whether it reads, and whether that are bits.
    reads: bool,
    reads_bits: bool,
    /// Where the data begin in the PDU of the answer.
    block: u32,
}

impl Shape {
    fn of(row: &FunctionRow) -> Self {
        let writes = matches!(row.operation, Operation::Write | Operation::ReadWrite);
        let (at, reads_bits) = row.offsets.response_block.unwrap_or_default();
        Self { writes, reads: row.offsets.response_block.is_some(), reads_bits, block: at as u32 + 1 }
    }

    /// The registers that an answer reads, if its request has a time.
    #[inline]
    fn registers(self, row: &Transaction) -> Span {
        let Span { start, length } = row.response.pdu;
        if !self.reads || self.reads_bits || row.request.start.is_none() || length < self.block {
            return Span::default();
        }
        Span { start: start + self.block, length: length - self.block }
    }

    /// What an answer reads that ends with this block.
    #[inline(always)]
    #[allow(clippy::inline_always)] // Of the result, each caller needs a part.
    fn data(self, block: Option<&[u8]>) -> Data {
        if self.reads {
            data(block.unwrap_or(&[]), self.reads_bits)
        } else {
            Data::default()
        }
    }
}

/// Reads the exchanges of a batch.
pub(crate) struct Exchanges<'a> {
    /// The batch.
    pub batch: &'a Batch,
    /// Its table of functions.
    pub functions: &'a Functions,
    /// By function code; `None` where it takes the body to know.
    shapes: [Option<Shape>; FUNCTIONS],
}

impl<'a> Exchanges<'a> {
    /// Those of a batch.
    pub fn of(batch: &'a Batch) -> Self {
        let functions = batch.functions.as_deref().unwrap_or_else(|| Functions::embedded());
        let mut shapes = [None; FUNCTIONS];
        if !batch.exchanges.is_empty() {
            for (code, shape) in (0u8..).zip(&mut shapes) {
                *shape = functions.row(code, &[]).filter(|_| functions.leading_bytes(code) == 0).map(Shape::of);
            }
        }
        Self { batch, functions, shapes }
    }

    /// What a compact exchange without times shows, in the transaction with this number; `None` where it was refused, or where
    /// its function code alone does not tell what it is.
    #[inline(always)]
    #[allow(clippy::inline_always)] // The result is large, and would be written and read again for each exchange.
    pub fn clean(&self, exchange: &Exchange, number: u64) -> Option<Clean> {
        if exchange.exception != 0 {
            return None;
        }
        let shape = self.shapes[usize::from(exchange.function) % FUNCTIONS]?;
        let Exchange { start, lengths, unit, function, address, quantity, .. } = *exchange;
        let [request, response] = lengths.map(u32::from);
        // Both are frames of an RTU line, with a unit in front and a checksum at the end; the block is the end of its frame.
        let pdu = Span { start: start + 1, length: request - 1 - CRC_BYTES as u32 };
        let (from, end) = (start + request + 1 + shape.block, start + request + response - CRC_BYTES as u32);
        let data = shape.data(self.batch.arena.get(from as usize..end as usize));
        Some(Clean {
            place: Place { number, elapsed: None, time: None },
            bus: 0,
            key: RequestKey { unit, function, address, quantity },
            writes: shape.writes,
            request: pdu,
            data,
            registers: Span::default(),
            response_time: None,
            gap: None,
            starts: [None; 2],
        })
    }
}
