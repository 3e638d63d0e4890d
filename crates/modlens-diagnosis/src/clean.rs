//! Exchanges that went well, with the little that is counted of them.

use modlens_engine::records::{Batch, Exchange, Transaction};
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
pub(crate) struct Clean<'a> {
    /// Number and time.
    pub place: Place,
    /// Which request.
    pub key: RequestKey,
    /// Whether it writes.
    pub writes: bool,
    /// The request's PDU.
    pub request: &'a [u8],
    /// What was read.
    pub data: Data,
    /// From the end of the request to the start of the answer.
    pub response_time: Option<Ns>,
    /// Silence before the request.
    pub gap: Option<Ns>,
    /// Start of the request, and of the answer.
    pub starts: [Option<Ns>; 2],
}

impl<'a> Clean<'a> {
    /// What a row shows; `None` if it is none of these exchanges.
    #[inline]
    pub fn of(batch: &'a Batch, functions: &Functions, row: &Transaction) -> Option<Self> {
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
            key: RequestKey { unit: row.unit, function: row.function, address, quantity },
            writes: shape.writes,
            request,
            data: shape.data(response),
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
    /// Where the data begin in the body of the answer, and whether they are bits.
    block: Option<(u16, bool)>,
}

impl Shape {
    fn of(row: &FunctionRow) -> Self {
        let writes = matches!(row.operation, Operation::Write | Operation::ReadWrite);
        Self { writes, block: row.offsets.response_block.map(|(at, bits)| (at as u16, bits)) }
    }

    /// What an answer reads, of which this is the PDU.
    #[inline(always)]
    #[allow(clippy::inline_always)] // Of the result, each caller needs a part.
    fn data(self, response: &[u8]) -> Data {
        match self.block {
            Some((at, bits)) => data(response.get(1 + usize::from(at)..).unwrap_or(&[]), bits),
            None => Data::default(),
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

    /// What the compact exchange with this index shows, on an RTU line without times, in the transaction with this number; `None`
    /// where it was refused, or where its function code alone does not tell what it is.
    #[inline(always)]
    #[allow(clippy::inline_always)] // The result is large, and would be written and read again for each exchange.
    pub fn clean(&self, index: usize, number: u64) -> Option<Clean<'a>> {
        let exchange = &self.batch.exchanges[index];
        if exchange.exception != 0 {
            return None;
        }
        let shape = (*self.shapes.get(usize::from(exchange.function))?)?;
        let [request, response] = exchange.pdus(&self.batch.arena);
        Some(Clean {
            place: Place { number, elapsed: None, time: None },
            key: key_of(exchange),
            writes: shape.writes,
            request,
            data: shape.data(response),
            response_time: None,
            gap: None,
            starts: [None; 2],
        })
    }

    /// What the compact exchange with this index has read, and at which request.
    pub fn read(&self, index: u32) -> Option<(RequestKey, Data)> {
        let seen = self.clean(index as usize, 0)?;
        (seen.data.length > 0).then_some((seen.key, seen.data))
    }
}

/// The request of a compact exchange.
#[inline]
fn key_of(exchange: &Exchange) -> RequestKey {
    let Exchange { unit, function, address, quantity, .. } = *exchange;
    RequestKey { unit, function, address, quantity }
}
