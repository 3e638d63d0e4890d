//! Fragments of frames in front of the damaged frames of a region and after them, which only their place gives away.

use crate::damage::expected_frame::response_length;
use crate::damage::glitch::is_glitch_byte;
use crate::damage::region::{DamagedFrame, UnframedRegion};
use crate::rtu_model::announced_length::ENVELOPE_BYTES;
use crate::rtu_model::damage_kind::DamageKind;
use crate::weights::{COARSE_FRAME_GAP_NS, MAX_GLITCH_BYTES};
use modlens_protocol::checksum::correctable_bit;
use modlens_protocol::direction::{Direction, RequestRef};
use modlens_protocol::framing::MAX_RTU_FRAME_BYTES;
use modlens_protocol::functions::{Extent, EXCEPTION_BIT};
use modlens_protocol::Ns;

/// A frame that must have stood at the beginning of a region.
#[derive(Clone, Copy)]
struct DueFrame<'a> {
    /// Who sent it.
    direction: Direction,
    /// The request that it answers, if it is known to be a response.
    answered_request: Option<RequestRef<'a>>,
}

impl UnframedRegion<'_, '_> {
    /// Whether a pause separates the bytes after a frame from it, and those bytes have no pause among themselves.
    pub(crate) fn is_one_burst_behind(&self, frame: &DamagedFrame) -> bool {
        let (start, end) = (frame.end, self.length);
        start < end && self.has_frame_gap(start) && !(start + 1..end).any(|at| self.has_frame_gap(at))
    }

    /// The fragment after a frame that lost its end, between two pauses: the end of a frame that lost its beginning.
    pub(crate) fn trailing_fragment(&self, frames: &[DamagedFrame]) -> Option<DamagedFrame> {
        let last = frames.last().filter(|last| matches!(last.damage, Some(DamageKind::LostBytes { .. })))?;
        let (_, next_direction) = self.next_frame?;
        let (start, end) = (last.end, self.length);
        let is_plausible = end - start > self.model.max_stray_bytes() && end - start <= MAX_RTU_FRAME_BYTES;
        if !self.is_one_burst_behind(last) || !is_plausible {
            return None;
        }
        // Requests and responses alternate.
        let direction = if next_direction == Direction::Request { Direction::Response } else { Direction::Request };
        let damage = Some(DamageKind::LostBytes { at: 0, count: 0 });
        Some(unidentified(start, end, direction, damage))
    }

    /// The fragment of a frame that must have stood in the first `end` bytes of the region, in front of its first damaged
    /// frame; `is_alone`: there is none, so that `end` is the region's length.
    ///
    /// `None` if no frame is due here (`due_in_front`), if the bytes are more than a frame has, or if there is a damaged frame
    /// right in front of the region or, except at the start of a recording, inside it. Else they are the beginning of a
    /// response (`fragment_without_end`), or the end of a frame (`fragment_without_head`).
    ///
    /// A recording begins in the middle of a frame more often than not, so that less evidence is enough there.
    pub(crate) fn leading_fragment(&self, end: usize, is_alone: bool) -> Option<DamagedFrame> {
        let starts_recording = self.input.offset() == 0 && self.next_frame.is_some();
        let due = self.due_in_front(end, starts_recording)?;
        if !(is_alone || starts_recording) || self.follows_damaged_frame || end > MAX_RTU_FRAME_BYTES {
            return None;
        }
        self.fragment_without_end(end, due).or_else(|| self.fragment_without_head(end, due, starts_recording))
    }

    /// The first one or two bytes of the response to the request that is due to be answered, if the first `end` bytes are
    /// that (`begins_response`), are the whole region, and stray bytes are rare on the line. `Truncated` if that request
    /// follows the region again, else without explanation.
    fn fragment_without_end(&self, end: usize, due: DueFrame<'_>) -> Option<DamagedFrame> {
        let bytes = &self.bytes()[..end];
        let is_beginning =
            |&request: &RequestRef<'_>| end == self.length && self.has_few_strays() && begins_response(bytes, request);
        let request = due.answered_request.filter(is_beginning)?;
        let damage = self.is_followed_by(Some(request)).then_some(DamageKind::Truncated { count: 0 });
        Some(DamagedFrame { is_unidentified: bytes.len() < 2, ..unidentified(0, end, due.direction, damage) })
    }

    /// The end of the frame that is due, without the stray bytes in front of it (`strays_in_front`). `None` if no more bytes
    /// are left than stray bytes account for (at the start of a recording: fewer than two), or more than the expected
    /// response has.
    ///
    /// If the response lacks no more bytes than are there and its request is not repeated, those were lost in front. On a
    /// line of one side, except at the start of a recording, bytes of unknown length that cannot be a header have lost an
    /// unknown number in front. Else nothing is said of the damage.
    fn fragment_without_head(&self, end: usize, due: DueFrame<'_>, starts_recording: bool) -> Option<DamagedFrame> {
        let strays = self.strays_in_front(end, starts_recording);
        let min_length = if starts_recording { 2 } else { self.model.max_stray_bytes() + 1 };
        let length = end - strays;
        if length < min_length {
            return None;
        }
        let expected_length = due.answered_request.and_then(|request| response_length(self, request));
        let is_repeated = self.is_followed_by(due.answered_request);
        let is_one_sided = self.context.line_direction.is_some() && !starts_recording;
        let lost_count = match expected_length {
            Some(expected) if expected < length => return None,
            Some(expected) => Some(expected - length).filter(|&lost| lost > 0 && lost <= length && !is_repeated),
            // The frames of this side begin with a unit and a function of the line, unless those two were lost.
            None => (is_one_sided && self.lacks_header(&self.bytes()[strays..end])).then_some(0),
        };
        let damage = lost_count.map(|count| DamageKind::LostBytes { at: 0, count });
        Some(unidentified(strays, end, due.direction, damage))
    }

    /// How many of the first `end` bytes are stray bytes of a line driver: at most `MAX_GLITCH_BYTES`. None at the start of a
    /// recording and on a quiet line of one side, where bytes such as 00 and FF at the beginning are data.
    fn strays_in_front(&self, end: usize, starts_recording: bool) -> usize {
        if starts_recording || (self.context.line_direction.is_some() && self.has_few_strays()) {
            return 0;
        }
        self.bytes()[..end].iter().take(MAX_GLITCH_BYTES).take_while(|&&byte| is_glitch_byte(byte)).count()
    }

    /// The frame that must have stood in the first `end` bytes; `None` if none is due.
    ///
    /// On a line that one side has to itself, a frame of that side is due if the bytes cannot be stray ones
    /// (`is_lone_fragment`). On any other line, and at the start of a recording, requests and responses alternate: a response
    /// to the outstanding request in front of a request, and a request in front of a response that answers none. Else a frame
    /// of unknown direction is due at the start of a recording only.
    fn due_in_front(&self, end: usize, starts_recording: bool) -> Option<DueFrame<'_>> {
        let due = |direction, answered_request| Some(DueFrame { direction, answered_request });
        let line_direction = self.context.line_direction;
        if line_direction.is_some() && self.is_lone_fragment(end) {
            return due(line_direction.unwrap_or(Direction::Unknown), None);
        }
        if line_direction.is_some() && !starts_recording {
            return None;
        }
        match (self.next_frame.map(|(_, direction)| direction), self.context.outstanding_request) {
            (Some(Direction::Request), Some(request)) => due(Direction::Response, Some(request)),
            (Some(Direction::Response), None) => due(Direction::Request, None),
            _ if starts_recording => due(Direction::Unknown, None),
            _ => None,
        }
    }

    /// Whether the first `end` bytes must be part of a frame: they came without a pause, and stray bytes are rare here.
    fn is_lone_fragment(&self, end: usize) -> bool {
        let pauses_are_known = self.input.has_times || self.is_framed_independently();
        let is_frame_part = self.has_few_strays() && self.model.max_stray_bytes() < end;
        pauses_are_known && is_frame_part && !(1..end).any(|at| self.has_frame_gap(at))
    }

    /// Whether a frame has lost an unknown number of bytes, because the bytes after it are neither stray bytes nor part of
    /// a recognised frame, on a line where bytes go missing. Where another transmitter may have collided with the frame
    /// instead, the bytes after it may be that transmitter's, which does not stop where the frame ends.
    pub(crate) fn lost_bytes_behind(&self, frame: &DamagedFrame) -> bool {
        let behind = self.length - frame.end;
        let is_correctable = correctable_bit(&self.bytes()[frame.start..frame.end]).is_some();
        let loses_bytes = self.is_framed_independently() || (self.model.loses_bytes() && !self.ends_as_announced);
        let is_unexplained = frame.damage.is_none() && !is_correctable;
        loses_bytes && self.has_few_strays() && is_unexplained && behind > self.model.max_stray_bytes()
    }

    /// Whether the line is silent after the stray bytes that begin at index `strays`, as it is after those of a line
    /// driver. A second transmitter would keep sending. What follows a pause or begins a record is no stray byte, though
    /// it may have the same value.
    pub(crate) fn is_silent_behind_strays(&self, strays: usize) -> bool {
        let bytes = self.input.bytes();
        let is_same = |&&byte: &&u8| byte == bytes[strays];
        let end = strays + bytes[strays..].iter().take(MAX_GLITCH_BYTES).take_while(is_same).count();
        let next_burst = || self.input.boundary_after(strays, bytes.len(), self.frame_gap_ns).unwrap_or(bytes.len());
        let limit = if self.ends_as_announced { next_burst() } else { self.length };
        if end >= limit {
            return true;
        }
        if self.input.has_times {
            self.input.pause_before(end).is_some_and(|pause| pause >= self.frame_gap_ns)
        } else {
            self.model.has_unit(bytes[end])
        }
    }

    /// Whether these bytes begin in the middle of a frame: their first byte is no unit of this line, and their number is
    /// not the one that their first bytes would announce as a header.
    fn lacks_header(&self, bytes: &[u8]) -> bool {
        let &[unit, code, ref body @ ..] = bytes else { return true };
        let row = self.context.functions.row(code & !EXCEPTION_BIT, body);
        let extents = row.map(|row| [&row.request, &row.response].map(|layout| layout.extent(body)));
        let is_announced = extents.into_iter().flatten().any(|extent| match extent {
            Extent::Exactly(length) => {
                (length + ENVELOPE_BYTES..=length + ENVELOPE_BYTES + MAX_GLITCH_BYTES).contains(&bytes.len())
            }
            _ => false,
        });
        // If both directions have a fixed length and it is not that of these bytes, they are no header.
        let is_fixed = extents.is_some_and(|extents| extents.iter().all(|extent| matches!(extent, Extent::Exactly(_))));
        let has_header = self.model.has_unit(unit) && !(self.is_framed_independently() && is_fixed);
        !has_header && !is_announced
    }

    /// Whether the bytes after a frame that lost some are its own last ones: the pause before them is as long as the
    /// transmission of the missing bytes.
    pub(crate) fn resumes_after_loss(&self, frame: &DamagedFrame) -> bool {
        let (Some(DamageKind::LostBytes { count, .. }), Some(char_ns)) = (frame.damage, self.input.char_ns) else { return false };
        let Some(missing) = count.checked_sub(self.length - frame.end).filter(|&missing| missing > 0) else { return false };
        let expected_ns = missing as Ns * char_ns;
        let tolerance_ns = if self.input.has_multibyte_reads { COARSE_FRAME_GAP_NS / 2 } else { 2 * char_ns };
        let pause = self.input.pause_before(frame.end);
        pause.is_some_and(|pause| (pause - expected_ns).abs() <= tolerance_ns.max(expected_ns / 8))
    }
}

/// A fragment of a frame whose unit and function are unknown.
fn unidentified(start: usize, end: usize, direction: Direction, damage: Option<DamageKind>) -> DamagedFrame {
    let head = Vec::new();
    DamagedFrame { start, end, direction, head, is_short: true, damage, is_unidentified: true, wrong_head_bytes: 0 }
}

/// Whether these one or two bytes are the first ones of the response and no stray bytes. That one byte is the unit of the
/// request happens by chance once in 256 times, which is good enough on a line with few stray bytes.
fn begins_response(bytes: &[u8], request: RequestRef<'_>) -> bool {
    let has_function = || bytes.get(1).is_none_or(|code| request.pdu.first() == Some(&(code & !EXCEPTION_BIT)));
    bytes.len() <= 2 && !is_glitch_byte(bytes[0]) && bytes[0] == request.unit && has_function()
}
