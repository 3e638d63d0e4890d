//! Bytes that a serial driver has taken out as software flow control: XON (11) and XOFF (13).
//!
//! A port with software flow control switched on (`IXON` of termios(3)) never delivers these two values. A frame that has one
//! of them is a byte short, and nothing is ever seen of unit 17. So where neither value stands among the unframed bytes of a
//! line, each is tried at every place of a frame: a CRC that it makes valid is 16 bits of evidence.

use crate::damage::candidates::Candidate;
use crate::damage::crc_correction::inserted_byte;
use crate::damage::region::UnframedRegion;
use crate::rtu_model::announced_length::announced_lengths;
use crate::rtu_model::damage_kind::DamageKind;
use crate::rtu_model::side;
use crate::rtu_model::traffic_model::FLOW_CONTROL_BYTES;
use crate::weights::{CRC_MATCH_BITS, ROUNDING_BITS};
use modlens_protocol::checksum::{crc16, update, update_byte};
use modlens_protocol::direction::Direction;
use modlens_protocol::framing::MAX_RTU_FRAME_BYTES;
use modlens_protocol::functions::{Extent, EXCEPTION_BIT};

/// Leading bytes that determine the length of a frame of every public function: the byte count of function 23 is the last.
const HEADER_BYTES: usize = 11;

/// A byte that a frame lacks: its index in the frame as it was sent, and its value.
#[derive(Clone, Copy)]
struct Missing {
    at: usize,
    value: u8,
}

impl UnframedRegion<'_, '_> {
    /// Adds the frames that may begin at `start` and lack one flow control byte: with it, their header announces their length,
    /// and their CRC is valid. Called only where the line does not deliver flow control bytes.
    pub(crate) fn add_frames_lacking_flow_control_byte(&self, start: usize, candidates: &mut Vec<Candidate>) {
        // Index 1 is left out: 13 is no public function, and the request of 11 (Report Server ID) would be three bytes.
        let places = (0..HEADER_BYTES).filter(|&at| at != 1 && self.is_familiar_without(start, at));
        let missing = places.flat_map(|at| FLOW_CONTROL_BYTES.map(|value| Missing { at, value }));
        let found = missing.filter_map(|missing| self.frame_with_header_byte(start, missing));
        let mut found: Vec<Candidate> = found.chain(self.frame_with_body_byte(start)).collect();
        // What the other candidates at this place have in favour of them, this one has as well; but its CRC is valid.
        let rivals = candidates.iter().filter(|other| other.start == start && !other.is_corrected);
        if let Some(best_score) = rivals.map(|other| other.score).reduce(f32::max) {
            for frame in &mut found {
                frame.score = frame.score.max(best_score + ROUNDING_BITS);
            }
        }
        candidates.append(&mut found);
    }

    /// Whether the bytes at `start` may be the header of a frame of this line that lacks its byte `at`: a known function, and,
    /// unless the unit is what is missing, a known unit.
    fn is_familiar_without(&self, start: usize, at: usize) -> bool {
        let bytes = &self.bytes()[start..];
        let (unit, code) = if at == 0 { (None, bytes.first()) } else { (bytes.first(), bytes.get(1)) };
        let is_known = unit.is_none_or(|&unit| self.context.known_units[usize::from(unit)]);
        is_known && code.is_some_and(|code| self.context.functions.row(code & !EXCEPTION_BIT, &[]).is_some())
    }

    /// The frame at `start` with `missing` inserted into its header, if it is then as long as announced and its CRC is valid.
    fn frame_with_header_byte(&self, start: usize, missing: Missing) -> Option<Candidate> {
        let Missing { at, value } = missing;
        let bytes = &self.bytes()[start..];
        let mut header = bytes[..bytes.len().min(HEADER_BYTES)].to_vec();
        header.insert(at.min(header.len()), value);
        let (direction, length) = self.announced(&header).find(|&(_, length)| {
            let is_there = at < length && length <= bytes.len() + 1;
            is_there && update(update_byte(crc16(&bytes[..at]), value), &bytes[at..length - 1]) == 0
        })?;
        Some(self.flow_control_candidate(start, length - 1, direction, missing))
    }

    /// The frame at `start` that lacks a flow control byte after its header, if one at some place makes its CRC valid.
    fn frame_with_body_byte(&self, start: usize) -> Option<Candidate> {
        let bytes = &self.bytes()[start..];
        if bytes.len() < HEADER_BYTES || !self.is_familiar_without(start, HEADER_BYTES) {
            return None;
        }
        self.announced(bytes).find_map(|(direction, length)| {
            let rest = bytes.get(..length - 1).filter(|rest| rest.len() >= HEADER_BYTES)?;
            let (at, value) = inserted_byte(rest, HEADER_BYTES, &FLOW_CONTROL_BYTES)?;
            Some(self.flow_control_candidate(start, rest.len(), direction, Missing { at, value }))
        })
    }

    /// The directions and lengths that a header announces, where that is one length.
    fn announced(&self, header: &[u8]) -> impl Iterator<Item = (Direction, usize)> {
        let announced = if header.len() < 2 { [None, None] } else { announced_lengths(self.context, header) };
        announced.into_iter().flatten().filter_map(|(direction, extent)| match extent {
            Extent::Exactly(length) if length <= MAX_RTU_FRAME_BYTES => Some((direction, length)),
            _ => None,
        })
    }

    /// The candidate of `length` bytes at `start`, the byte `missing` not counted. Its score is that of a valid CRC, less what
    /// the choice among all places and values costs.
    fn flow_control_candidate(&self, start: usize, length: usize, direction: Direction, missing: Missing) -> Candidate {
        let Missing { at, value } = missing;
        let bytes = &self.bytes()[start..];
        let tried = FLOW_CONTROL_BYTES.len() * (length + 1);
        let end = Some(start + length);
        let (head, header) = if at == 0 { (vec![value], [value, bytes[0]]) } else { (Vec::new(), [bytes[0], bytes[1]]) };
        Candidate {
            start,
            core_end: start + length,
            end,
            score: CRC_MATCH_BITS - (tried as f32).log2() - self.start_cost(start) + self.end_bonus(end),
            direction: side::index_of(direction),
            header,
            head,
            damage: Some(DamageKind::FlowControl { at, value }),
            is_corrected: true,
            ..Candidate::default()
        }
    }
}
