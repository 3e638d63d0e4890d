//! One frame as it is counted, and what it writes.

use modlens_engine::records::{Batch, Exchange, Frame, InnerPauses, Side};
use modlens_protocol::direction::Direction;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::oddity::is_swapped;
use modlens_protocol::Ns;

use super::damage::{self, DamagedPart};
use super::finding_set::FindingSet;
use super::write_key::WriteKey;
use crate::place::Place;

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
    /// The first bytes of what is damaged, noise, or of another layout than that of its function.
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
        let findings = FindingSet::of(row.findings.of(&batch.codes));
        let is_odd = findings.has(Finding::LengthMismatch) || findings.has(Finding::MbapLength);
        let kept = if row.verdict.is_good() && !is_odd { 0 } else { wire.len().min(NOISE_BYTES) };
        Self {
            place: Place { number: row.txn.unwrap_or(0), elapsed: row.elapsed, time: row.start },
            number: row.number,
            verdict: row.verdict,
            direction: row.direction,
            mode: row.mode,
            unit: row.unit,
            findings,
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

    /// Whether it is a request to read, as no answer looks.
    pub(crate) fn is_read_request(&self) -> bool {
        let is_read = self.code.is_some_and(|code| (1..=4).contains(&code)) && self.length == READ_REQUEST_BYTES;
        is_read && self.mode == Mode::Rtu && self.direction == Direction::Request && self.verdict == Verdict::Ok
    }
}

/// The length of a request to read on a serial line (application protocol, 6.1 to 6.4).
pub(crate) const READ_REQUEST_BYTES: u32 = 8;

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
pub(super) const NOISE_BYTES: usize = 64;

#[cfg(test)]
mod tests {
    use super::*;
    use modlens_protocol::functions::{Functions, EXCEPTION_BIT};

    #[test]
    fn writes_are_those_of_the_table() {
        for code in 0..EXCEPTION_BIT {
            assert_eq!(is_write(code), Functions::embedded().writes(code), "function {code}");
        }
    }
}
