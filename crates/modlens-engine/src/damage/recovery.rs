//! Frames for the bytes that no valid frame claims: damaged frames where the evidence is enough, noise for the rest.

use std::collections::VecDeque;

use crate::damage::glitch::is_glitch;
use crate::damage::region::{DamagedFrame, UnframedRegion};
use crate::damage::truncation::TruncationLearner;
use crate::damage::whole_answer::length_of_whole_answer;
use crate::frame_result::{FrameResult, FramerContext, MAX_NOISE_ROW_BYTES};
use crate::input::Input;
use crate::rtu_model::announced_length::{announced_lengths, ENVELOPE_BYTES};
use crate::rtu_model::crc_scan::MAX_CANDIDATE_BYTES;
use crate::rtu_model::damage_kind::DamageKind;
use crate::rtu_model::traffic_model::TrafficModel;
use modlens_protocol::checksum::crc_valid;
use modlens_protocol::direction::Direction;
use modlens_protocol::framing::{DelimitedBy, Verdict};
use modlens_protocol::functions::Extent;
use modlens_protocol::Ns;

/// The state of damage recovery on one line.
#[derive(Default)]
pub struct DamageRecovery {
    /// Damaged frames that were found and not yet emitted, with the stream offsets of their first bytes.
    found: VecDeque<(u64, DamagedFrame)>,
    /// Stream offset up to which the bytes have been analyzed.
    analyzed_to: u64,
    /// Attributes responses without an end.
    pub truncation: TruncationLearner,
}

/// What is known about the place of an unframed region.
pub struct Surroundings<'a, 'c> {
    /// What the session knows, the outstanding request in front of the region among it.
    pub context: &'a FramerContext<'c>,
    /// The input, whose first byte is the first one of the region.
    pub input: &'a Input,
    /// The frame that follows the region.
    pub next_frame: Option<(&'a [u8], Direction)>,
    /// A damaged frame was reported right in front of the region.
    pub follows_damaged_frame: bool,
    /// The shortest pause between two frames.
    pub frame_gap_ns: Ns,
}

impl<'a, 'c> Surroundings<'a, 'c> {
    /// The first `length` bytes of the input as a region.
    fn region(&self, model: &'a TrafficModel, length: usize, ends_as_announced: bool) -> UnframedRegion<'a, 'c> {
        let &Self { context, input, next_frame, follows_damaged_frame, frame_gap_ns } = self;
        UnframedRegion { model, context, input, length, next_frame, follows_damaged_frame, frame_gap_ns, ends_as_announced }
    }
}

impl DamageRecovery {
    /// The first row of the unframed bytes from the first byte of the input to stream offset `to`, exclusive. `adu` is cleared;
    /// it gets unit and PDU of a damaged frame.
    ///
    /// The first call for a `to` analyses all bytes up to there at once (`analyze`). Every call gives one row, and the caller
    /// consumes its bytes: the damaged frame that begins with the first byte, else a row without it (`row_without_frame`).
    pub fn next_frame(&mut self, model: &mut TrafficModel, at: &Surroundings<'_, '_>, to: u64, adu: &mut Vec<u8>) -> FrameResult {
        if self.analyzed_to < to {
            self.analyze(model, at, to);
        }
        let offset = at.input.offset();
        let region_bytes = (to - offset) as usize;
        match self.found.front() {
            Some((start, _)) if *start != offset => row_without_frame(at, (start - offset) as usize, adu),
            None => row_without_frame(at, region_bytes, adu),
            Some((_, frame)) => {
                let length = frame.end - frame.start;
                let delimited_by = if length == region_bytes { DelimitedBy::Frame } else { DelimitedBy::Length };
                let result = emit(frame, &at.input.bytes()[..length], delimited_by, adu);
                self.found.pop_front();
                result
            }
        }
    }

    /// Forgets damaged frames that are not emitted yet: another framer goes on with their bytes.
    pub fn forget_found(&mut self) {
        self.found.clear();
    }

    /// Finds the damaged frames of the input up to stream offset `to`, exclusive, and keeps them in `found`; the line's model
    /// learns what happened to each.
    ///
    /// Live, if no frame after these bytes is known, the last frame found may be a response without its end; `truncation`
    /// attributes it by what the master did after earlier ones.
    fn analyze(&mut self, model: &mut TrafficModel, at: &Surroundings<'_, '_>, to: u64) {
        let offset = at.input.offset();
        self.analyzed_to = to;
        model.learn_flow_control(&at.input.bytes()[..(to - offset) as usize]);
        let frames = at.region(model, (to - offset) as usize, false).damaged_frames();
        self.found = frames.into_iter().map(|frame| (offset + frame.start as u64, frame)).collect();
        if !at.context.may_look_ahead && at.next_frame.is_none() {
            if let Some((_, last)) = self.found.back_mut() {
                self.truncation.attribute(model, last);
            }
        }
        self.found.iter().for_each(|(_, frame)| model.learn_damage(frame.damage));
    }
}

/// The first row of the first `length` bytes of the input, which no damaged frame claims: their first burst (`burst`), nearly
/// always noise, with `Glitch` where a line driver has left it.
fn row_without_frame(at: &Surroundings<'_, '_>, length: usize, adu: &mut Vec<u8>) -> FrameResult {
    let result = burst(at, length, adu);
    let is_glitch = result.verdict == Verdict::Noise && is_glitch(&at.input.bytes()[..result.length]);
    FrameResult { damage: is_glitch.then_some(DamageKind::Glitch), ..result }
}

/// The row of a frame with a wrong CRC that the search found by its announced `length`, from the first byte of the input on,
/// and what happened to it. `adu` gets unit and PDU.
///
/// If the analysis recognises the frame, the row is that of the analysis, and the model learns the damage. If that row has
/// fewer bytes than `length`, the others are stray bytes in the place of what the frame has lost. Else the row has `length`
/// bytes, a bad checksum, the `direction` that the search found, and no explanation.
///
/// `None` if the analysis recognises the beginning of a longer frame: its end was not lost here, but is among the bytes that
/// follow. So it is for a request at the head of a burst that has just the length of the response that is due.
pub fn damaged_hypothesis(
    model: &mut TrafficModel,
    at: &Surroundings<'_, '_>,
    length: usize,
    direction: Direction,
    adu: &mut Vec<u8>,
) -> Option<FrameResult> {
    let wire = &at.input.bytes()[..length];
    let region = at.region(model, length, true);
    if direction == Direction::Request && length_of_whole_answer(&region).is_some_and(|whole| whole > length) {
        return None;
    }
    let frames = region.damaged_frames();
    let is_this = |frame: &&DamagedFrame| frame.start == 0 && (frame.end == length || is_glitch(&wire[frame.end..]));
    if let Some(frame) = frames.iter().find(is_this) {
        if frame.end == length && matches!(frame.damage, Some(DamageKind::LostBytes { at, .. }) if at == length) {
            return None;
        }
        model.learn_damage(frame.damage);
        return Some(emit(frame, &wire[..frame.end], DelimitedBy::Length, adu));
    }
    adu.clear();
    adu.extend_from_slice(&wire[..length - 2]);
    Some(bad_checksum(length, DelimitedBy::Length, direction))
}

/// Emits a damaged frame, with its first bytes restored in `adu` where it is known which ones are missing or wrong.
fn emit(frame: &DamagedFrame, wire: &[u8], delimited_by: DelimitedBy, adu: &mut Vec<u8>) -> FrameResult {
    let is_short = frame.is_short || wire.len() < ENVELOPE_BYTES;
    adu.clear();
    if !frame.is_unidentified {
        adu.extend_from_slice(&frame.head);
        adu.extend_from_slice(if is_short { wire } else { &wire[frame.wrong_head_bytes..wire.len() - 2] });
    }
    if !is_short && crc_valid(wire) {
        adu.clear();
        adu.extend_from_slice(&wire[..wire.len() - 2]);
        return FrameResult { unconfirmed: true, ..unlikely_frame(wire.len(), delimited_by, frame.direction) };
    }
    let verdict = if is_short { Verdict::Incomplete } else { Verdict::BadChecksum };
    FrameResult { verdict, direction: frame.direction, damage: frame.damage, ..FrameResult::noise(wire.len(), delimited_by) }
}

/// Emits the first burst of the first `length` bytes of the input, which hold no recognised frame. A burst ends at the first
/// pause of `frame_gap_ns`, at the start of a record, after `length` bytes or after `MAX_NOISE_ROW_BYTES`. It is noise unless
/// `burst_frame` makes a damaged frame of it, which may be shorter than the burst.
fn burst(at: &Surroundings<'_, '_>, length: usize, adu: &mut Vec<u8>) -> FrameResult {
    let Surroundings { input, context, .. } = *at;
    let edge = input.boundary_after(0, length, at.frame_gap_ns);
    let burst_bytes = edge.unwrap_or(length).min(MAX_NOISE_ROW_BYTES);
    let delimited_by = match edge {
        Some(end) if input.read(end).is_some_and(|read| read.starts_record) => DelimitedBy::Record,
        None if burst_bytes == MAX_NOISE_ROW_BYTES => DelimitedBy::Limit,
        None if burst_bytes < input.bytes().len() => DelimitedBy::Frame,
        None if input.is_ended => DelimitedBy::End,
        _ => DelimitedBy::Silence,
    };
    let result = burst_frame(input, context, burst_bytes, delimited_by).unwrap_or(FrameResult::noise(burst_bytes, delimited_by));
    adu.clear();
    if result.verdict != Verdict::Noise {
        let end = if result.verdict == Verdict::Incomplete { result.length } else { result.length - 2 };
        adu.extend_from_slice(&input.bytes()[..end]);
    }
    result
}

/// The damaged frame that the first `burst_bytes` of the input have to be because somebody has recorded them as one: they are
/// the whole recording, or a record begins or ends with them. `None`, so noise, for all other bursts and for fewer than four
/// bytes.
///
/// Its header says what is wrong, by the lengths that it announces (`announced_frames`):
///
/// - exactly `burst_bytes`: a bad checksum, or a right one after numbers that the search could not believe;
/// - less, where the unit is familiar and nothing shows that a sender stopped at the end of the burst (`is_bounded` is
///   false): the first bytes are a frame of the announced length with a bad checksum, and the caller goes on after it;
/// - else the whole burst is a damaged frame or noise (`whole_burst`).
///
/// Example: a recording of the bytes `11 03 00 6B 00 03` is a request without its CRC, `Incomplete`.
fn burst_frame(input: &Input, context: &FramerContext<'_>, burst_bytes: usize, delimited_by: DelimitedBy) -> Option<FrameResult> {
    let is_entire_input = input.offset() == 0 && delimited_by == DelimitedBy::End;
    let starts_record = input.read(0).is_some_and(|read| read.starts_record) && input.starts_read(0);
    if burst_bytes < ENVELOPE_BYTES || !(is_entire_input || delimited_by == DelimitedBy::Record || starts_record) {
        return None;
    }
    let bytes = &input.bytes()[..burst_bytes];
    // Whether the end of the burst is the end of what was sent, and not only of what was recorded.
    let is_bounded = is_entire_input || input.has_times || matches!(delimited_by, DelimitedBy::Silence | DelimitedBy::Record);
    let unit = bytes[0];
    let is_familiar = context.known_units[usize::from(unit)] || context.outstanding_request.is_some_and(|it| it.unit == unit);
    match announced_frames(context, bytes) {
        Announced { exact: Some(direction), .. } => Some(frame_of_burst(bytes, DelimitedBy::Length, direction)),
        Announced { shorter: Some((length, direction)), .. } if is_familiar && !is_bounded => {
            Some(frame_of_burst(&bytes[..length], DelimitedBy::Length, direction))
        }
        Announced { longer, .. } => whole_burst(bytes, delimited_by, longer, is_bounded, is_familiar),
    }
}

/// A burst whose header announces no frame that is there, as one damaged frame; `None` if it is too long for a frame
/// (more than `MAX_CANDIDATE_BYTES`), or neither its boundaries (`is_bounded`) nor its unit (`is_familiar`) are trusted.
///
/// If its header announces a longer frame (`longer` is the direction of that), it is `Incomplete`, also where the recording
/// ends without boundary and familiar unit; else it has a bad checksum and an unknown direction.
fn whole_burst(
    bytes: &[u8],
    delimited_by: DelimitedBy,
    longer: Option<Direction>,
    is_bounded: bool,
    is_familiar: bool,
) -> Option<FrameResult> {
    let is_trusted = is_bounded || is_familiar;
    let length = bytes.len();
    match longer {
        _ if length > MAX_CANDIDATE_BYTES => None,
        Some(direction) if is_trusted || delimited_by == DelimitedBy::End => {
            Some(FrameResult { verdict: Verdict::Incomplete, direction, ..FrameResult::noise(length, delimited_by) })
        }
        _ => is_trusted.then(|| frame_of_burst(bytes, delimited_by, Direction::Unknown)),
    }
}

/// The row of bytes that are one frame: with a bad checksum, unless it is right.
fn frame_of_burst(bytes: &[u8], delimited_by: DelimitedBy, direction: Direction) -> FrameResult {
    if crc_valid(bytes) {
        unlikely_frame(bytes.len(), delimited_by, direction)
    } else {
        bad_checksum(bytes.len(), delimited_by, direction)
    }
}

/// The row of a frame that the search left to noise, because its numbers are so unlikely; but its checksum is right.
fn unlikely_frame(length: usize, delimited_by: DelimitedBy, direction: Direction) -> FrameResult {
    FrameResult { direction, ..FrameResult::new(Verdict::Ok, length, delimited_by) }
}

/// The row of a frame with a bad checksum.
fn bad_checksum(length: usize, delimited_by: DelimitedBy, direction: Direction) -> FrameResult {
    FrameResult { verdict: Verdict::BadChecksum, direction, ..FrameResult::noise(length, delimited_by) }
}

/// What a header announces, compared with the bytes that are there.
#[derive(Default)]
struct Announced {
    /// The direction in which the frame has exactly these bytes.
    exact: Option<Direction>,
    /// Length and direction of a frame that has fewer.
    shorter: Option<(usize, Direction)>,
    /// The direction in which the frame has more, or at least some number that does not determine its length.
    longer: Option<Direction>,
}

/// What the header of these bytes announces in each direction (`announced_lengths` has the order); of two directions with the
/// same answer the first counts. Only the first direction, the response, is looked at if the outstanding request has this
/// unit and function: then the bytes are its response and not another request.
fn announced_frames(context: &FramerContext<'_>, bytes: &[u8]) -> Announced {
    let is_response =
        context.outstanding_request.is_some_and(|request| request.unit == bytes[0] && request.pdu.first() == Some(&bytes[1]));
    let mut announced = Announced::default();
    for (direction, extent) in announced_lengths(context, bytes).into_iter().flatten().take(if is_response { 1 } else { 2 }) {
        match extent {
            Extent::Exactly(length) if length == bytes.len() => announced.exact = announced.exact.or(Some(direction)),
            Extent::Exactly(length) if length < bytes.len() => {
                announced.shorter = announced.shorter.or(Some((length, direction)));
            }
            Extent::Exactly(_) | Extent::AtLeast(_) => announced.longer = announced.longer.or(Some(direction)),
            Extent::Open(_) => {}
        }
    }
    announced
}
