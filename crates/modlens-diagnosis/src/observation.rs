//! What the contrast needs to know of a transaction and of a frame: a few numbers each, without the bytes.

mod damage;
mod echo;
mod figures;
mod layout;

use modlens_engine::records::{Batch, Exchange, Frame, InnerPauses, Side, Transaction};
use modlens_protocol::direction::Direction;
use modlens_protocol::finding::{Finding, Severity};
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::functions::{Functions, Operation};
use modlens_protocol::oddity::is_swapped;
use modlens_protocol::register_type::Space;
use modlens_protocol::status::Status;
use modlens_protocol::Ns;

pub(crate) use damage::response_part;
pub use damage::{DamagedPart, DAMAGED_PARTS};
pub use figures::Figures;
pub(crate) use figures::{added, of_header as figures_of_header};
pub use layout::LayoutFault;
pub(crate) use layout::{answer_length, data_length, lacks_count};

use crate::contrast::tally::{fingerprint, mix, Place};
use crate::contrast::writes::WriteKey;

/// The findings of a row, one bit each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FindingSet(u64);

impl FindingSet {
    fn of(findings: &[Finding]) -> Self {
        Self(findings.iter().fold(0, |set, finding| set | 1 << (*finding as u64)))
    }

    /// Whether there is none.
    fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Whether one of them is more than worth knowing.
    pub fn has_trouble(self) -> bool {
        !self.is_empty() && Finding::ALL.iter().any(|finding| self.has(*finding) && finding.doc().severity != Severity::Info)
    }

    /// The others.
    #[must_use]
    pub fn without(self, finding: Finding) -> Self {
        Self(self.0 & !(1 << (finding as u64)))
    }

    /// Whether a finding is among them.
    #[inline]
    pub fn has(self, finding: Finding) -> bool {
        self.0 >> (finding as u64) & 1 == 1
    }
}

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

/// What the data of an answer look like, for comparison with other answers to the same request.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Data {
    /// There is an answer with a block of data.
    pub is_present: bool,
    /// All registers are FFFF.
    pub all_ones: bool,
    /// All registers are 0000.
    pub all_zeros: bool,
    /// The first four bytes; none where there are fewer.
    pub opening: Option<[u8; COMPARED_BYTES]>,
    /// The first two registers; the second one is 0 where there is none.
    pub head: [u16; 2],
    /// The first or the last register is FFFF; and 0000. A single register touches FFFF where it is near: -1 is next to 0.
    pub touches: [bool; 2],
    /// How many bytes.
    pub length: u16,
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

/// Which request: unit, function, address and quantity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct RequestKey {
    /// Unit.
    pub unit: u8,
    /// Function code.
    pub function: u8,
    /// Address.
    pub address: u16,
    /// Quantity.
    pub quantity: u16,
}

/// The first number of the registers that a function reads, as manuals count them.
const REFERENCES: [(u8, u16); 3] = [(2, 10_001), (4, 30_001), (3, 40_001)];

impl RequestKey {
    /// Its addresses in words.
    pub(crate) fn block(self) -> String {
        match self.quantity {
            0 | 1 => format!("address {}", self.address),
            quantity => format!("addresses {} to {}", self.address, u32::from(self.address) + u32::from(quantity) - 1),
        }
    }

    /// The address on the wire that manuals mean by its address, if that is one of their numbers.
    pub(crate) fn meant_by_manuals(self) -> Option<u16> {
        let (_, first) = REFERENCES.into_iter().find(|(function, _)| *function == self.function)?;
        (first..first + 9999).contains(&self.address).then(|| self.address - first)
    }

    /// All of it as one number.
    #[inline]
    pub(crate) fn number(self) -> u64 {
        u64::from(u16::from_be_bytes([self.unit, self.function])) << 32 | u64::from(self.address) << 16 | u64::from(self.quantity)
    }

    /// The request with this number.
    pub(crate) fn of_number(number: u64) -> Self {
        let [_, _, unit, function, address @ .., _, _] = number.to_be_bytes();
        Self { unit, function, address: u16::from_be_bytes(address), quantity: number as u16 }
    }

    /// A well-mixed hash.
    #[inline]
    pub(crate) fn hash(self) -> u64 {
        mix(self.number())
    }
}

/// One transaction.
#[derive(Clone, Debug, PartialEq)]
pub struct Observation {
    /// Its number and time.
    pub place: Place,
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
    pub is_altered_echo: bool,
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

impl Data {
    /// Whether all registers are 0000 or FFFF, which many answers are.
    pub fn is_plain(self) -> bool {
        self.all_ones || self.all_zeros
    }
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
            late_response_to: row.late_response_to,
            gap: row.gap,
            is_retry: row.retry_of.is_some(),
            findings,
            request_head: request_head(batch, row),
            is_own_echo: echo::is_echo(batch, row),
            is_altered_echo: echo::is_altered_echo(batch, row),
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

/// Bytes of a request that are kept for comparison, where no answer came.
const HEAD_BYTES: usize = 8;

fn request_head(batch: &Batch, row: &Transaction) -> Vec<u8> {
    let wire = row.request.wire.of(&batch.arena);
    let is_open = matches!(row.status, Status::NoResponse | Status::NotObserved);
    let kept = if is_open { wire.len().min(HEAD_BYTES) } else { 0 };
    wire[..kept].to_vec()
}

fn answer_head(batch: &Batch, row: &Transaction) -> Vec<u8> {
    let wire = row.response.wire.of(&batch.arena);
    let is_odd = matches!(row.status, Status::BadResponse | Status::Unsolicited);
    let kept = if is_odd { wire.len().min(NOISE_BYTES) } else { 0 };
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

/// Answers to different requests are compared by so many bytes.
pub(crate) const COMPARED_BYTES: usize = 4;

/// How far two values of a register are apart. It may be signed, so 65535 is next to 0.
#[inline]
pub(crate) fn apart(one: u16, other: u16) -> u32 {
    let difference = one.wrapping_sub(other);
    difference.min(difference.wrapping_neg()).into()
}

/// Registers that differ by less than this may be the next value of the same series.
pub(crate) const FAR: u32 = 64;

/// What a block of data looks like; `bits` are no registers.
#[inline(always)]
#[allow(clippy::inline_always)] // Most callers need a part of it.
pub(crate) fn data(block: &[u8], bits: bool) -> Data {
    let register = |at: usize| block.get(at..at + 2).map_or(0, |pair| u16::from_be_bytes([pair[0], pair[1]]));
    let opening: Option<[u8; COMPARED_BYTES]> = block.first_chunk().copied();
    let head = match opening {
        _ if bits => [0, 0],
        Some([one, two, three, four]) => [u16::from_be_bytes([one, two]), u16::from_be_bytes([three, four])],
        None => [register(0), 0],
    };
    let last = block.last_chunk().map_or(0, |pair| u16::from_be_bytes(*pair));
    let is_near_ones = block.len() == 2 && !bits && apart(last, 0xFFFF) < FAR;
    let touches = [head[0] == 0xFFFF || last == 0xFFFF || is_near_ones, head[0] == 0 || last == 0];
    // All bytes are looked at only where a register may be one of many alike; a single byte is none, and begins with 0 then.
    let is_all = |byte: u8| !bits && !block.is_empty() && block.iter().all(|other| *other == byte);
    let (all_ones, all_zeros) = match touches {
        [false, false] => (false, false),
        [true, _] | [_, true] => (is_all(0xFF), is_all(0)),
    };
    Data { is_present: true, head, touches, all_ones, all_zeros, opening, length: block.len() as u16 }
}

/// One frame, or one run of noise.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameObservation {
    /// Number of its transaction, or of the one before, and its time.
    pub place: Place,
    /// Number of the frame.
    pub number: u64,
    /// What it is worth.
    pub verdict: Verdict,
    /// Who sent it.
    pub direction: Direction,
    /// Framing.
    pub mode: Mode,
    /// Unit.
    pub unit: Option<u8>,
    /// Its findings.
    pub findings: FindingSet,
    /// Its length.
    pub length: u32,
    /// Function code.
    pub code: Option<u8>,
    /// Number of its transaction.
    pub txn: Option<u64>,
    /// The first bytes of what is damaged or noise.
    pub bytes: Vec<u8>,
    /// Silence before it.
    pub gap: Option<Ns>,
    /// Silences inside it.
    pub pauses: InnerPauses,
    /// Which part of a damaged request is damaged, where no transaction has it.
    pub damage: Option<DamagedPart>,
    /// Line or packet of its first byte, and of its last one.
    pub origins: [u64; 2],
    /// Who sent it, where the recording says so.
    pub side: Option<Side>,
    /// What it writes: of a good request of RTU.
    pub write: Option<WriteKey>,
    /// The bytes of its checksum are swapped, and the frame was taken as it is: that is a habit of its unit.
    pub is_swapped: bool,
}

impl FrameObservation {
    /// Whether it is a request to read, as no answer looks.
    pub(crate) fn is_read_request(&self) -> bool {
        let is_read = self.code.is_some_and(|code| (1..=4).contains(&code)) && self.length == READ_REQUEST;
        is_read && self.mode == Mode::Rtu && self.direction == Direction::Request && self.verdict == Verdict::Ok
    }
}

/// The length of a request to read on a serial line (application protocol, 6.1 to 6.4).
const READ_REQUEST: u32 = 8;

/// Whether a function code is one of the public functions that write registers or coils.
#[inline]
pub(crate) fn is_write(code: u8) -> bool {
    matches!(code, 5 | 6 | 15 | 16 | 22 | 23)
}

/// What a frame writes: of a good request of RTU.
pub(crate) fn written(batch: &Batch, row: &Frame) -> Option<WriteKey> {
    let is_request = row.verdict.is_good() && row.mode == Mode::Rtu && row.direction == Direction::Request;
    if is_request {
        WriteKey::of_rtu(row.wire.of(&batch.arena))
    } else {
        None
    }
}

/// Whether a good answer of RTU has a checksum whose bytes are swapped.
pub(crate) fn is_swapped_answer(batch: &Batch, row: &Frame) -> bool {
    row.verdict == Verdict::Ok
        && row.mode == Mode::Rtu
        && row.direction == Direction::Response
        && is_swapped(row.wire.of(&batch.arena))
}

/// What a compact exchange writes, if it does.
pub(crate) fn write_of_compact(row: &Exchange) -> WriteKey {
    WriteKey { unit: row.unit, function: row.function, address: row.address }
}

/// Bytes of a run of noise that are looked at.
const NOISE_BYTES: usize = 64;

impl FrameObservation {
    /// What a frame of a compact exchange shows: the request, or the answer, in the transaction with this number.
    pub(crate) fn of_compact(txn: u64, number: u64, direction: Direction, row: &Exchange) -> Self {
        Self {
            place: Place { number: txn, elapsed: None, time: None },
            number,
            verdict: Verdict::Ok,
            direction,
            mode: Mode::Rtu,
            unit: Some(row.unit),
            findings: FindingSet::default(),
            length: u32::from(row.lengths[usize::from(direction != Direction::Request)]),
            code: Some(row.function),
            txn: Some(txn),
            bytes: Vec::new(),
            gap: None,
            pauses: InnerPauses::default(),
            damage: None,
            origins: [0; 2],
            side: None,
            write: is_write(row.function).then(|| write_of_compact(row)),
            is_swapped: false,
        }
    }

    /// What a row shows.
    pub fn of(batch: &Batch, row: &Frame) -> Self {
        let wire = row.wire.of(&batch.arena);
        let kept = if row.verdict.is_good() { 0 } else { wire.len().min(NOISE_BYTES) };
        Self {
            place: Place { number: row.txn.unwrap_or(0), elapsed: row.elapsed, time: row.start },
            number: row.number,
            verdict: row.verdict,
            direction: row.direction,
            mode: row.mode,
            unit: row.unit,
            findings: FindingSet::of(row.findings.of(&batch.codes)),
            length: row.wire.length,
            code: row.code,
            txn: row.txn,
            bytes: wire[..kept].to_vec(),
            gap: row.gap,
            pauses: row.pauses,
            damage: damage::damaged_request(row, wire),
            origins: [row.origin, row.last_origin],
            side: row.side,
            write: row.code.filter(|code| is_write(*code)).and_then(|_| written(batch, row)),
            is_swapped: is_swapped_answer(batch, row),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use modlens_protocol::functions::EXCEPTION_BIT;
    use proptest::prelude::*;

    #[test]
    fn writes_are_those_of_the_table() {
        for code in 0..EXCEPTION_BIT {
            assert_eq!(is_write(code), Functions::embedded().writes(code), "function {code}");
        }
    }

    proptest! {
        // As the words of `Data` say it, register by register.
        #[test]
        fn data_are_what_their_registers_say(
            block in prop::collection::vec(prop_oneof![Just(0u8), Just(0xFF), any::<u8>()], 0..9),
            is_long_and_plain in any::<bool>(),
            bits in any::<bool>(),
        ) {
            let plain = block.first().map_or(Vec::new(), |first| vec![*first; block.len()]);
            let block = if is_long_and_plain { plain } else { block };
            let register = |at: usize| block.get(at..at + 2).map_or(0, |pair| u16::from(pair[0]) << 8 | u16::from(pair[1]));
            let (last, head) = (register(block.len().saturating_sub(2)), [register(0), register(2)]);
            let head = if bits { [0, 0] } else { head };
            let is_all = |byte: u8| !bits && !block.is_empty() && block.iter().all(|other| *other == byte);
            let seen = data(&block, bits);
            prop_assert_eq!((seen.all_ones, seen.all_zeros), (is_all(0xFF), is_all(0)));
            prop_assert_eq!(seen.head, head);
            let is_near = block.len() == 2 && !bits && !(0x3F..=0xFFBF).contains(&last);
            prop_assert_eq!(seen.touches, [head[0] == 0xFFFF || last == 0xFFFF || is_near, head[0] == 0 || last == 0]);
            prop_assert_eq!(seen.opening.is_some(), block.len() >= COMPARED_BYTES);
            prop_assert_eq!(usize::from(seen.length), block.len());
        }
    }
}
