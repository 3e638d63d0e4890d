//! Exchanges that went well, with the little that is counted of them.

use modlens_engine::records::{Batch, Exchange, Transaction};
use modlens_protocol::functions::{FunctionRow, Functions, Operation};
use modlens_protocol::status::Status;
use modlens_protocol::Ns;

use crate::contrast::tally::{fingerprint, Place};
use crate::observation::{data, Data, FindingSet, Observation, Outcome, RequestKey};

/// A plain request and its good answer, no repetition, in time, and without a finding.
///
/// Nearly all exchanges of most recordings are such ones. They are counted in bulk, and what is counted of them is what
/// would be counted of their `observation`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Clean {
    /// Number and time.
    pub place: Place,
    /// Which request.
    pub key: RequestKey,
    /// The hash of that.
    pub hash: u64,
    /// Whether it writes.
    pub writes: bool,
    /// What was written.
    pub written: u64,
    /// What was read.
    pub data: Data,
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
        let shape = functions.row(row.function, body)?;
        let u16_at = |at: usize| Some(u16::from_be_bytes([*body.get(at)?, *body.get(at + 1)?]));
        let address = u16_at(shape.offsets.address?)?;
        let quantity = shape.offsets.quantity.map_or(Some(1), u16_at)?;
        let key = RequestKey { unit: row.unit, function: row.function, address, quantity };
        let hash = key.hash();
        let place = Place { number: row.number, elapsed: row.elapsed, time: row.start };
        let (writes, written, data) = contents(shape, request, response);
        let (response_time, gap, starts) = (row.response_time, row.gap, [row.request.start, row.response.start]);
        Some(Self { place, key, hash, writes, written, data, response_time, gap, starts })
    }

    /// What a compact exchange shows; `None` where it was refused, or the table of functions does not say what it is.
    #[inline]
    pub fn of_compact(batch: &Batch, functions: &Functions, number: u64, row: &Exchange) -> Option<Self> {
        if row.exception != 0 {
            return None;
        }
        let key = RequestKey { unit: row.unit, function: row.function, address: row.address, quantity: row.quantity };
        let hash = key.hash();
        let [request, response] = row.pdus(&batch.arena);
        let (writes, written, data) = contents(functions.row(row.function, &request[1..])?, request, response);
        let place = Place { number, elapsed: None, time: None };
        Some(Self { place, key, hash, writes, written, data, response_time: None, gap: None, starts: [None; 2] })
    }

    /// The same, with all that it is not. By value, so that the exchange need not be in memory where this is not asked for.
    #[cold]
    pub fn observation(self) -> Observation {
        Observation {
            place: self.place,
            unit: self.key.unit,
            function: self.key.function,
            outcome: Outcome::Good,
            exception: None,
            range: Some((self.key.address, self.key.quantity)),
            writes: self.writes,
            written: self.written,
            data: self.data,
            response_time: self.response_time,
            waited: None,
            late: None,
            late_response_to: None,
            gap: self.gap,
            is_retry: false,
            findings: FindingSet::default(),
            request_head: Vec::new(),
            is_own_echo: false,
            is_of_another: false,
            shift: None,
            answered_by: None,
            damage: None,
            request_frame: 0,
            lengths: [0; 2],
            starts: self.starts,
        }
    }
}

/// Whether a request of this shape writes, what it writes, and what its good answer reads.
#[inline]
fn contents(shape: &FunctionRow, request: &[u8], response: &[u8]) -> (bool, u64, Data) {
    let writes = matches!(shape.operation, Operation::Write | Operation::ReadWrite);
    let written = if writes { fingerprint(request) } else { 0 };
    let data = match shape.offsets.response_block {
        Some((at, bits)) => data(response.get(1 + at..).unwrap_or(&[]), bits),
        None => Data::default(),
    };
    (writes, written, data)
}
