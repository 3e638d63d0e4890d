//! What the contrast needs to know of a transaction and of a frame: a few numbers each, without the bytes.

mod damage;
mod data;
mod echo;
mod figures;
mod finding_set;
mod frame;
mod layout;
mod request_key;
mod write_key;

use modlens_engine::records::{Batch, Transaction};
use modlens_protocol::checksum::CRC_BYTES;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::{Functions, Operation};
use modlens_protocol::mbap::PREFIX_BYTES;
use modlens_protocol::oddity::Altered;
use modlens_protocol::register_type::Space;
use modlens_protocol::status::Status;
use modlens_protocol::Ns;

pub(crate) use damage::response_part;
pub use damage::{DamagedPart, DAMAGED_PARTS};
pub use data::Data;
pub(crate) use data::{apart, data, COMPARED_BYTES, FAR};
pub use figures::Figures;
pub(crate) use figures::{added, of_header as figures_of_header};
pub use finding_set::FindingSet;
pub use frame::FrameObservation;
pub(crate) use frame::{is_swapped_answer, is_write, write_of_compact, written, READ_REQUEST_BYTES};
pub use layout::LayoutFault;
pub(crate) use layout::{answer_length, data_length, lacks_count};
pub use request_key::RequestKey;
pub use write_key::WriteKey;

use crate::contrast::tally::fingerprint;
use crate::place::Place;

/// How a request fared, from the view of its master.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// A valid answer, in time.
    Good,
    /// Refused with an exception.
    Refused,
    /// No answer.
    Silent,
    /// An answer came, but damaged.
    Garbled,
    /// The request itself was damaged.
    BadRequest,
    /// An answer without a request, or too late for it.
    Unasked,
    /// The recording does not show the answer, and no clock shows that the master has waited for it.
    NotSeen,
    /// Nothing can be said: a broadcast.
    Unknown,
}

impl Outcome {
    /// Whether the master did not get what it asked for, other than by a refusal.
    #[inline]
    pub fn is_failure(self) -> bool {
        matches!(self, Self::Silent | Self::Garbled | Self::BadRequest)
    }

    /// Whether it shows how the line works: neither an answer alone nor something unknown.
    #[inline]
    pub fn counts(self) -> bool {
        !matches!(self, Self::Unasked | Self::NotSeen | Self::Unknown)
    }
}

/// How the values of an answer go on with what was read before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shift {
    /// They continue the series of an earlier request.
    ToEarlier {
        /// So many requests before their own: 1 to `MOST_LAG`.
        lag: usize,
        /// By chance once in 2 to the power of this.
        bits: u32,
    },
    /// They continue neither the series of the request before nor their own.
    Elsewhere,
}

/// An answer one step late belongs to the request before, and each further silence adds a step.
pub const MOST_LAG: usize = 3;

/// One transaction.
#[derive(Clone, Debug, PartialEq)]
pub struct Observation {
    /// Its number and time.
    pub place: Place,
    /// Index of its bus, or of its connection.
    pub bus: u32,
    /// Unit asked, or, of an answer alone, answering.
    pub unit: u8,
    /// Function code without the exception bit.
    pub function: u8,
    /// How it fared.
    pub outcome: Outcome,
    /// Exception code of a refusal.
    pub exception: Option<u8>,
    /// Address and quantity that it reads, or writes.
    pub range: Option<(u16, u16)>,
    /// Where the request would begin that cuts no value of the profile in two, as it does: the address before or after its own.
    pub aligned_at: Option<u16>,
    /// Whether it writes.
    pub writes: bool,
    /// What was written.
    pub written: u64,
    /// What was read.
    pub data: Data,
    /// The registers that were read, as bytes, where the request has a time.
    pub registers: Vec<u8>,
    /// From the end of the request to the start of the answer.
    pub response_time: Option<Ns>,
    /// How long the master waited for nothing.
    pub waited: Option<Ns>,
    /// How long after the request its answer came, where that was too late.
    pub late: Option<Ns>,
    /// So long after an earlier request, which had no answer, this one came that fits it.
    pub belated: Option<Ns>,
    /// The damaged answer begins as that to this earlier request, which had no answer, and came so long after it.
    pub intruder: Option<(RequestKey, Ns)>,
    /// It is the late answer to this transaction.
    pub late_response_to: Option<u64>,
    /// Silence before the request.
    pub gap: Option<Ns>,
    /// It repeats an earlier request.
    pub is_retry: bool,
    /// Its findings.
    pub findings: FindingSet,
    /// The first bytes of the request's frame.
    pub request_head: Vec<u8>,
    /// What came as the answer is the request itself, whole or cut.
    pub is_own_echo: bool,
    /// The same with some of its bits changed.
    pub altered_echo: Option<Altered>,
    /// The answer stops before its end, and is right as far as it goes.
    pub is_cut: bool,
    /// One bit of the answer would make its checksum right, and no frame of the function.
    pub has_chance_bit: bool,
    /// A right checksum or header, and a layout that is not that of the function.
    pub layout: Option<LayoutFault>,
    /// What a wrong length field or byte count says, and what is there.
    pub figures: Option<Figures>,
    /// The checksum of a damaged frame, and the right one.
    pub checksum: Option<Figures>,
    /// The data are those that another request was answered with a moment ago.
    pub is_of_another: bool,
    /// Of an answer of another length than asked for: what the unit was asked before, the last one first.
    pub asked_before: [Option<RequestKey>; MOST_LAG],
    /// Shortly after a silence: whether the values continue the series of an earlier request, not their own.
    pub shift: Option<Shift>,
    /// The unit that answered, where it is another one.
    pub answered_by: Option<u8>,
    /// Which part of the damaged frame is damaged.
    pub damage: Option<DamagedPart>,
    /// The first bytes of an answer that is damaged, or that nobody asked for.
    pub answer_head: Vec<u8>,
    /// The MBAP transaction identifier.
    pub id: Option<u16>,
    /// The answer to the request before came after this request.
    pub is_step_behind: bool,
    /// Number of the frame of its request; 0 without one.
    pub request_frame: u64,
    /// Number of the frame of its answer; 0 without one.
    pub response_frame: u64,
    /// Bytes of the request and of the answer.
    pub lengths: [u32; 2],
    /// Start of the request, and of the answer.
    pub starts: [Option<Ns>; 2],
}

impl Observation {
    /// The request, if it has an address.
    pub fn key(&self) -> Option<RequestKey> {
        let (address, quantity) = self.range?;
        Some(RequestKey { unit: self.unit, function: self.function, address, quantity })
    }

    /// Whether it reads from unit 0, which is for writing to all units (serial line, 2.1).
    pub fn is_read_of_all(&self) -> bool {
        self.unit == 0 && self.findings.has(Finding::BroadcastRead)
    }

    /// What a row shows.
    pub fn of(batch: &Batch, functions: &Functions, row: &Transaction) -> Self {
        let request = row.request.pdu.of(&batch.arena);
        let response = row.response.pdu.of(&batch.arena);
        let body = if request.is_empty() { response } else { request }.get(1..).unwrap_or(&[]);
        let shape = functions.row(row.function, body);
        let operation = shape.map_or(Operation::Other, |shape| shape.operation);
        let is_intact = !request.is_empty() && row.status != Status::BadRequest;
        let u16_at = |at: usize| Some(u16::from_be_bytes([*body.get(at)?, *body.get(at + 1)?]));
        let range = shape.filter(|_| is_intact).and_then(|shape| {
            let address = u16_at(shape.offsets.address?)?;
            Some((address, shape.offsets.quantity.map_or(Some(1), u16_at)?))
        });
        let writes = matches!(operation, Operation::Write | Operation::ReadWrite);
        let findings = FindingSet::of(row.findings.of(&batch.codes));
        let block = shape.and_then(|shape| shape.offsets.response_block).filter(|_| row.status == Status::Ok);
        let block = block.map(|(at, bits)| (response.get(1 + at..).unwrap_or(&[]), bits));
        let registers = block.filter(|(_, bits)| !bits && row.request.start.is_some()).map_or(&[][..], |(block, _)| block);
        let data = block.map_or(Data::default(), |(block, bits)| data(block, bits));
        Self {
            place: Place { number: row.number, elapsed: row.elapsed, time: row.start },
            bus: row.bus,
            unit: row.unit,
            function: row.function,
            outcome: outcome(row.status),
            exception: row.exception,
            range,
            aligned_at: range.filter(|_| row.status == Status::Exception).and_then(|range| aligned_at(row, range)),
            writes,
            written: if writes && is_intact { fingerprint(request) } else { 0 },
            data,
            registers: registers.to_vec(),
            response_time: row.response_time.or_else(|| time_of_damaged(row)),
            waited: row.waited,
            late: row.late_response,
            belated: None,
            intruder: None,
            late_response_to: row.late_response_to,
            gap: row.gap,
            is_retry: row.retry_of.is_some(),
            findings,
            request_head: request_head(batch, row),
            is_own_echo: echo::is_echo(batch, row),
            altered_echo: echo::altered_echo(batch, row),
            is_cut: row.status == Status::BadResponse && findings.has(Finding::Incomplete),
            has_chance_bit: damage::has_chance_bit(batch, row),
            layout: if findings.is_empty() { None } else { layout::layout_fault(batch, row, |finding| findings.has(finding)) },
            figures: figures::of(batch, row, |finding| findings.has(finding)),
            checksum: figures::checksum(batch, row),
            is_of_another: false,
            asked_before: [None; MOST_LAG],
            shift: None,
            answered_by: findings
                .has(Finding::WrongUnit)
                .then(|| answering_unit(row.mode, row.response.wire.of(&batch.arena)))
                .flatten(),
            damage: damage::damaged_part(batch, row),
            answer_head: answer_head(batch, row),
            id: row.mbap_id,
            is_step_behind: false,
            request_frame: row.request.frame,
            response_frame: row.response.frame,
            lengths: [row.request.wire.length, row.response.wire.length],
            starts: [row.request.start, row.response.start],
        }
    }
}

/// The one address next to that of a request from which on it would hold values of the profile whole, where it cuts some.
fn aligned_at(row: &Transaction, (address, quantity): (u16, u16)) -> Option<u16> {
    let space = match row.function {
        3 => Space::Holding,
        4 => Space::Input,
        _ => return None,
    };
    let plan = &row.points.as_ref()?.plan;
    let points = || plan.multi_register_points().iter().filter(|point| point.space == space);
    let holds_whole = |first: u16| {
        let (first, end) = (u32::from(first), u32::from(first) + u32::from(quantity));
        let range = |from: u16, width: u16| (u32::from(from), u32::from(from) + u32::from(width));
        let touched = || points().map(|point| range(point.address, point.width)).filter(|(from, to)| *from < end && first < *to);
        touched().next().is_some() && touched().all(|(from, to)| first <= from && to <= end)
    };
    let next = [address.checked_sub(1), address.checked_add(1)].into_iter().flatten().filter(|first| holds_whole(*first));
    let next: Vec<u16> = next.collect();
    // A request that begins after the last value touches none.
    let is_cut = !holds_whole(address) && points().any(|point| point.address.abs_diff(address) <= point.width);
    match next.as_slice() {
        [one] if is_cut => Some(*one),
        _ => None,
    }
}

/// From the end of a request to the start of a damaged answer, where the times allow it.
fn time_of_damaged(row: &Transaction) -> Option<Ns> {
    let time = row.response.start.filter(|_| row.status == Status::BadResponse)? - row.request.end?;
    (time > 0).then_some(time)
}

fn outcome(status: Status) -> Outcome {
    match status {
        Status::Ok => Outcome::Good,
        Status::Exception => Outcome::Refused,
        Status::NoResponse => Outcome::Silent,
        Status::BadResponse => Outcome::Garbled,
        Status::BadRequest => Outcome::BadRequest,
        Status::Unsolicited => Outcome::Unasked,
        Status::NotObserved => Outcome::NotSeen,
        Status::Broadcast => Outcome::Unknown,
    }
}

/// Bytes of a request that are kept for comparison, where no valid answer came: a read or a write of one value in RTU.
const HEAD_BYTES: usize = 8;

/// The same over Modbus/TCP: with the header, and without a checksum.
const HEAD_BYTES_TCP: usize = HEAD_BYTES + PREFIX_BYTES - CRC_BYTES;

fn request_head(batch: &Batch, row: &Transaction) -> Vec<u8> {
    let wire = row.request.wire.of(&batch.arena);
    let is_open = matches!(row.status, Status::NoResponse | Status::NotObserved | Status::BadResponse);
    let most = if row.mbap_id.is_some() { HEAD_BYTES_TCP } else { HEAD_BYTES };
    let kept = if is_open { wire.len().min(most) } else { 0 };
    wire[..kept].to_vec()
}

fn answer_head(batch: &Batch, row: &Transaction) -> Vec<u8> {
    let wire = row.response.wire.of(&batch.arena);
    let is_odd = matches!(row.status, Status::BadResponse | Status::Unsolicited);
    let kept = if is_odd { wire.len().min(frame::NOISE_BYTES) } else { 0 };
    wire[..kept].to_vec()
}

/// The unit in an answer of this framing.
fn answering_unit(mode: Mode, wire: &[u8]) -> Option<u8> {
    match mode {
        Mode::Rtu => wire.first().copied(),
        Mode::Tcp => wire.get(6).copied(),
        Mode::Ascii => None,
    }
}
