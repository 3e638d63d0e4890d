//! Habits of units: what the responses of one have in common that the specification does not know. From some responses on, they
//! are taken for what they evidently are.

use std::collections::BTreeMap;

use crate::findings::line::Habit;
use crate::framer::FrameResult;
use crate::rtu_model::announced_length::ENVELOPE_BYTES;
use crate::rtu_model::damage_kind::DamageKind;
use modlens_protocol::checksum::{crc16, CRC_BYTES};
use modlens_protocol::direction::Direction;
use modlens_protocol::framing::Verdict;

/// Responses alike before they are a habit of their unit: from then on they are taken for what they evidently are.
pub(crate) const MIN_HABIT_RESPONSES: u64 = 5;

/// A habit is reported of a unit if at least one in so many of its responses shows it.
pub(crate) const RESPONSES_PER_HABIT: u64 = 4;

/// The habits of units, counted over their responses.
#[derive(Debug, Default)]
pub(crate) struct UnitHabits(BTreeMap<(u8, Habit), u64>);

impl UnitHabits {
    /// How often each habit was seen, by unit; the counts restart.
    pub(crate) fn take(&mut self) -> BTreeMap<(u8, Habit), u64> {
        std::mem::take(&mut self.0)
    }

    /// Counts what a row that is no good frame shows of its unit. `last_response`: the unit of the response in front of it, if
    /// no request is open; `responses_of`: how many responses of a unit were counted. If that is a habit of the unit by now,
    /// the row as what it evidently is: a good frame, or bytes that are no reason for a finding.
    pub(crate) fn recognise(
        &mut self,
        framed: &FrameResult,
        wire: &[u8],
        last_response: Option<u8>,
        responses_of: impl Fn(u8) -> u64,
    ) -> Option<FrameResult> {
        let (unit, habit) = habit_of(framed, wire, last_response)?;
        let count = self.0.entry((unit, habit)).or_default();
        *count += 1;
        if *count <= MIN_HABIT_RESPONSES || *count * RESPONSES_PER_HABIT < responses_of(unit) {
            return None;
        }
        let verdict = match habit {
            Habit::SwappedChecksum => Verdict::Ok,
            Habit::NoChecksum => Verdict::NoChecksum,
            Habit::Padding(..) => Verdict::Noise,
        };
        Some(FrameResult { verdict, damage: None, ..*framed })
    }
}

/// The habit that a row would show, and the unit whose it would be.
fn habit_of(framed: &FrameResult, wire: &[u8], last_response: Option<u8>) -> Option<(u8, Habit)> {
    match (framed.verdict, framed.damage) {
        (Verdict::Noise, Some(DamageKind::Glitch)) if wire.iter().all(|&byte| byte == wire[0] && matches!(byte, 0 | 0xFF)) => {
            last_response.map(|unit| (unit, Habit::Padding(wire[0], wire.len() as u8)))
        }
        (Verdict::BadChecksum, _) if framed.direction == Direction::Response && wire.len() > ENVELOPE_BYTES => {
            let (content, sent) = wire.split_at(wire.len() - CRC_BYTES);
            let crc = crc16(content).to_be_bytes();
            (crc == sent && crc[0] != crc[1]).then_some((wire[0], Habit::SwappedChecksum))
        }
        (Verdict::Incomplete, Some(DamageKind::LostBytes { at, count: CRC_BYTES })) if at == wire.len() => {
            response_without_end(framed, wire)
        }
        (Verdict::Incomplete, Some(DamageKind::Truncated { count: CRC_BYTES })) => response_without_end(framed, wire),
        _ => None,
    }
}

/// A response of a unit that lacks its last two bytes.
fn response_without_end(framed: &FrameResult, wire: &[u8]) -> Option<(u8, Habit)> {
    (framed.direction == Direction::Response && wire.len() > CRC_BYTES).then(|| (wire[0], Habit::NoChecksum))
}
