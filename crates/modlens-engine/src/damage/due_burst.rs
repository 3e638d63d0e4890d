//! Frames that only their place gives away: a burst of bytes where a frame is due, too damaged to be recognised by its bytes.
//!
//! Between a request and another one stood a response, in front of a response a request, and in front of a timeout a request
//! that nobody could read. A few bytes at such a place that begin with the unit that is due, or more in a row than line noise
//! has, are that frame.

use std::ops::Range;

use crate::damage::expected_frame::{request_of, response_length};
use crate::damage::glitch::{is_glitch, is_glitch_byte};
use crate::damage::region::{DamagedFrame, UnframedRegion};
use crate::rtu_model::announced_length::ENVELOPE_BYTES;
use crate::rtu_model::damage_kind::DamageKind;
use crate::rtu_model::prefix_index::MAX_LOST_BYTES;
use crate::weights::{
    self, BURST_BYTE_BITS, BURST_LENGTH_BITS, BURST_STRAY_BITS, DUE_BURST_BITS, DUE_FUNCTION_BITS, DUE_UNIT_BITS, MAX_BURST_BITS,
    MAX_BURST_NOISE_BYTES, MAX_BURST_OVERHANG_BYTES, MAX_BURST_REGION_BYTES, MAX_BURST_STRAY_BYTES, MAX_BURST_TIMEOUT_BITS,
    MAX_BURST_TIME_BITS, MAX_GLITCH_BYTES, MIN_DAMAGED_FRAME_BITS, ONE_SIDED_BURST_BITS, UNPROVEN_REQUEST_BITS,
    UNPROVEN_RESPONSE_BITS,
};
use modlens_protocol::direction::{Direction, RequestRef};
use modlens_protocol::functions::EXCEPTION_BIT;

/// Bytes of a region that belong to no recognised frame, with what is around them.
struct Gap<'a> {
    /// Indices in the region.
    range: Range<usize>,
    /// The request in front of it that has no response yet.
    outstanding: Option<RequestRef<'a>>,
    /// The frame after it.
    next: Option<(&'a [u8], Direction)>,
}

/// A frame that is due in a gap.
struct DueFrame {
    direction: Direction,
    /// Its unit and function code, where they are known.
    header: Option<[u8; 2]>,
    /// Its length in bytes, where it is known.
    length: Option<usize>,
    /// Bits for it being there at all.
    score: f32,
}

impl UnframedRegion<'_, '_> {
    /// Adds the frames that must be between those that were found, in front of them or after them: the burst that is worth
    /// most, if it is worth `MIN_DAMAGED_FRAME_BITS`.
    pub(crate) fn add_due_bursts(&self, frames: &mut Vec<DamagedFrame>) {
        // What a line driver has left holds no burst.
        if frames.is_empty() && is_glitch(self.bytes()) {
            return;
        }
        let is_modbus = self.context.known_units.iter().any(|&is_known| is_known);
        if !is_modbus || self.length > MAX_BURST_REGION_BYTES || self.is_entire_input() {
            return;
        }
        let found: Vec<DamagedFrame> = self.gaps(frames).filter_map(|gap| self.due_burst(&gap)).collect();
        if !found.is_empty() {
            frames.extend(found);
            frames.sort_by_key(|frame| frame.start);
        }
    }

    /// The bytes between the recognised frames of the region, in front of them and after them.
    fn gaps<'a>(&'a self, frames: &'a [DamagedFrame]) -> impl Iterator<Item = Gap<'a>> + 'a {
        (0..=frames.len()).map(move |at| {
            let before = at.checked_sub(1).map(|before| &frames[before]);
            let behind = frames.get(at);
            let start = before.map_or(0, |frame| frame.end);
            let end = behind.map_or(self.length, |frame| frame.start);
            let outstanding = match before {
                None if self.follows_damaged_frame => None,
                None => self.context.outstanding_request,
                Some(frame) => self.request_in(frame),
            };
            let next = match behind {
                Some(frame) => Some((&self.bytes()[frame.start..frame.end], frame.direction)),
                None => self.next_frame,
            };
            Gap { range: start..end.max(start), outstanding, next: next.filter(|(frame, _)| frame.len() >= 2) }
        })
    }

    /// The damaged frame as a request, if it is one and begins with unit and function.
    fn request_in(&self, frame: &DamagedFrame) -> Option<RequestRef<'_>> {
        let bytes = &self.bytes()[frame.start..frame.end];
        let is_request = frame.direction == Direction::Request && !frame.is_unidentified && frame.head.is_empty();
        (is_request && bytes.len() > 4).then(|| RequestRef { unit: bytes[0], pdu: &bytes[1..bytes.len() - 2] })
    }

    /// The frame that must be in a gap, if some bytes there are worth enough: the best ones, of equal ones the first.
    fn due_burst(&self, gap: &Gap<'_>) -> Option<DamagedFrame> {
        // Most gaps hold nothing but what a line driver has left.
        if gap.range.is_empty() || self.bursts(gap).next().is_none() || self.may_be_collision(gap) {
            return None;
        }
        let mut best: Option<(f32, DamagedFrame)> = None;
        for due in self.due_frames(gap).into_iter().flatten() {
            for (strays, burst) in self.bursts(gap) {
                let score = due.score + self.score_of_burst(gap, &due, strays, &burst);
                if score >= MIN_DAMAGED_FRAME_BITS && best.as_ref().is_none_or(|(other, _)| score > *other) {
                    best = Some((score, self.frame_of_burst(gap, &due, burst)));
                }
            }
        }
        best.map(|(_, frame)| frame)
    }

    /// Whether the bytes of a gap follow a damaged frame without a pause: they may be those of a second transmitter, which does
    /// not stop where the frame ends, and to a request that it has destroyed there is no response.
    fn may_be_collision(&self, gap: &Gap<'_>) -> bool {
        let start = gap.range.start;
        let glitch = self.without_glitches(gap.range.clone()).start;
        let follows_pause = [start, glitch].into_iter().any(|at| self.has_pause(at));
        (start > 0 || self.follows_damaged_frame) && !follows_pause
    }

    /// Whether there is a pause before this byte that may be between two frames.
    fn has_pause(&self, at: usize) -> bool {
        self.input.pause_before(at).is_some_and(|pause| pause >= self.frame_gap_ns)
    }

    /// What may be due in the gap: a response, and a request; on a line that one side has to itself, any frame of that side.
    fn due_frames(&self, gap: &Gap<'_>) -> [Option<DueFrame>; 2] {
        match self.context.line_direction {
            None if gap.range.start == 0 && self.follows_damaged_frame => [due_frame_behind_damage(gap), None],
            None => [self.due_response(gap), self.due_request(gap)],
            Some(direction) => {
                let response = self.due_response(gap).filter(|due| due.direction == direction);
                [response, Some(DueFrame { direction, header: None, length: None, score: ONE_SIDED_BURST_BITS })]
            }
        }
    }

    /// The response to the outstanding request, if the frame after the gap is not that. In front of a retry, and where no frame
    /// is known after the gap, the unit may as well have been silent.
    fn due_response(&self, gap: &Gap<'_>) -> Option<DueFrame> {
        let request = gap.outstanding.filter(|request| self.context.paired_units[usize::from(request.unit)])?;
        let is_request = |(frame, direction): (&[u8], Direction)| {
            direction == Direction::Request && (frame[0], frame.get(1..frame.len() - 2)) != (request.unit, Some(request.pdu))
        };
        let is_one_sided = self.context.line_direction.is_some();
        if !is_one_sided && gap.next.is_some_and(|(frame, direction)| direction == Direction::Response && answers(request, frame))
        {
            return None;
        }
        let score = if gap.next.is_some_and(is_request) { DUE_BURST_BITS } else { UNPROVEN_RESPONSE_BITS };
        let header = [request.unit, *request.pdu.first()?];
        Some(DueFrame { direction: Direction::Response, header: Some(header), length: response_length(self, request), score })
    }

    /// A request: in front of a response nearly for certain, in front of another request or a silence only if that is a timeout.
    fn due_request(&self, gap: &Gap<'_>) -> Option<DueFrame> {
        let direction = Direction::Request;
        let is_paired = |unit: u8| self.context.paired_units[usize::from(unit)];
        match gap.next {
            Some((frame, Direction::Response)) if gap.outstanding.is_some_and(|request| answers(request, frame)) => None,
            Some((frame, Direction::Response)) => is_paired(frame[0]).then(|| DueFrame {
                direction,
                header: Some([frame[0], frame[1] & !EXCEPTION_BIT]),
                length: request_of(self, frame).length,
                score: DUE_BURST_BITS,
            }),
            Some((frame, _)) if is_paired(frame[0]) => {
                let header = Some([frame[0], frame[1]]);
                Some(DueFrame { direction, header, length: Some(frame.len()), score: UNPROVEN_REQUEST_BITS })
            }
            _ => Some(DueFrame { direction, header: None, length: None, score: UNPROVEN_REQUEST_BITS }),
        }
    }

    /// The bytes of a gap that may be the frame, up to the next pause and without what a line driver leaves at either end, and
    /// how many stray bytes are in front of them after the last pause: none or a few.
    fn bursts<'a>(&'a self, gap: &'a Gap<'_>) -> impl Iterator<Item = (usize, Range<usize>)> + 'a {
        let Range { start, end } = gap.range;
        (start..end).filter(move |&at| at == start || self.has_pause(at)).flat_map(move |at| {
            let to = (at + 1..end).find(|&at| self.has_pause(at)).unwrap_or(end);
            let burst = self.without_glitches(at..to);
            (0..burst.len().min(MAX_BURST_STRAY_BYTES + 1)).map(move |strays| (strays, burst.start + strays..burst.end))
        })
    }

    /// The range without the equal glitch bytes at its beginning and its end.
    fn without_glitches(&self, burst: Range<usize>) -> Range<usize> {
        let bytes = &self.bytes()[burst.clone()];
        let run = |bytes: &mut dyn Iterator<Item = &u8>| {
            let first = bytes.next().copied().filter(|&byte| is_glitch_byte(byte));
            first.map_or(0, |first| 1 + bytes.take(MAX_GLITCH_BYTES - 1).take_while(|&&byte| byte == first).count())
        };
        let (front, back) = (run(&mut bytes.iter()), run(&mut bytes.iter().rev()));
        if front + back >= bytes.len() {
            return burst.start..burst.start;
        }
        burst.start + front..burst.end - back
    }

    /// Bits for a burst after so many stray bytes being the frame that is due rather than noise: by the number of its bytes, by
    /// unit and function where they agree, by a length that fits, and by the time at which it came. `f32::MIN` if it cannot be.
    fn score_of_burst(&self, gap: &Gap<'_>, due: &DueFrame, strays: usize, burst: &Range<usize>) -> f32 {
        let bytes = &self.bytes()[burst.clone()];
        let header = self.header_of_burst(due, bytes);
        let is_noisy = gap.range.len() - bytes.len() > MAX_BURST_NOISE_BYTES;
        // Without times, noise and frame are one burst, and only the header shows where the frame begins.
        let has_no_start = header == 0.0 && !self.input.has_times && !self.has_few_strays();
        if bytes.len() > due.length.unwrap_or(0) + MAX_BURST_OVERHANG_BYTES
            || is_noisy
            || has_no_start
            || (strays > 0 && header < DUE_FUNCTION_BITS)
        {
            return f32::MIN;
        }
        let fits = due.length.is_some_and(|length| (length.saturating_sub(MAX_LOST_BYTES)..=length).contains(&bytes.len()));
        let length = if fits && bytes.len() > 1 { BURST_LENGTH_BITS } else { 0.0 };
        let time = self.time_of_burst(gap, due, burst);
        self.size_of_burst(bytes) + header + length + time - BURST_STRAY_BITS * strays as f32
    }

    /// Bits for the number of bytes: noise seldom comes in a row. Bytes that repeat the one before them count for nothing.
    fn size_of_burst(&self, bytes: &[u8]) -> f32 {
        let bits: f32 = bytes.windows(2).filter(|pair| pair[0] != pair[1]).map(|pair| self.model.bits(pair[1])).sum();
        (bits / weights::OTHER_BYTE_BITS * BURST_BYTE_BITS).min(MAX_BURST_BITS)
    }

    /// Bits for unit and function at the beginning of a burst, as far as they are right: those that are due, or any of the line.
    fn header_of_burst(&self, due: &DueFrame, bytes: &[u8]) -> f32 {
        let (has_unit, has_function) = self.begins_with_header(due, bytes);
        let units = if due.header.is_some() { 1 } else { self.context.known_units.iter().filter(|&&is_known| is_known).count() };
        let unit_bits = (DUE_UNIT_BITS - (units.max(1) as f32).log2()).max(0.0);
        let unit_bits = if due.header.is_none() { unit_bits.min(DUE_FUNCTION_BITS - 1.0) } else { unit_bits };
        (if has_unit { unit_bits } else { 0.0 }) + if has_function { DUE_FUNCTION_BITS } else { 0.0 }
    }

    /// Whether a burst begins with the unit, and has the function after it, that are due; where nothing is known of them, with a
    /// unit of the line, and a function of the line after it.
    fn begins_with_header(&self, due: &DueFrame, bytes: &[u8]) -> (bool, bool) {
        let code = bytes.get(1).map(|code| code & !EXCEPTION_BIT);
        if let Some([unit, function]) = due.header {
            return (bytes[0] == unit, code == Some(function));
        }
        // A zero is a broadcast too seldom to be one by its value.
        let has_unit = bytes[0] != 0 && self.context.known_units[usize::from(bytes[0])];
        (has_unit, has_unit && code.is_some_and(|code| self.model.has_unit_and_function(bytes[0], code)))
    }

    /// Bits for the time at which a burst came: a response comes as soon as others do, and after a request that nobody could
    /// read comes a timeout. 0 where the order of lines is inferred.
    ///
    /// A burst that may be a response is judged by the silence in front of it, from the byte before the gap on; the fewer
    /// bits, the longer that is. One that must be a request is judged by the silence after it, up to the first byte of the
    /// request that follows the region, if one does: `f32::MIN`, so never, unless it looks like a timeout. Where nothing is
    /// known to follow, a live line counts as silent.
    fn time_of_burst(&self, gap: &Gap<'_>, due: &DueFrame, burst: &Range<usize>) -> f32 {
        let odds = |silence| (self.context.timeout_log_odds)(silence);
        if self.context.line_direction.is_some() {
            return 0.0;
        }
        if due.direction != Direction::Request {
            let silence = self.input.silence_since(self.input.offset() + gap.range.start as u64, burst.start);
            return (-odds(silence)).clamp(-MAX_BURST_TIME_BITS, MAX_BURST_TIME_BITS);
        }
        match gap.next {
            Some((_, Direction::Request)) if gap.range.end == self.length => {
                // Index `length` is the first byte after the region: that of the next request.
                let silence = self.input.silence_since(self.input.offset() + burst.end as u64, self.length);
                let odds = odds(silence);
                if odds > 0.0 {
                    odds.min(MAX_BURST_TIMEOUT_BITS)
                } else {
                    f32::MIN
                }
            }
            // Live, a region is closed by a silence, unless a record or an announced length closes it; that is seldom, and
            // not known here.
            None if !self.input.is_ended && self.input.has_times => MAX_BURST_TIME_BITS,
            Some((_, Direction::Response)) => 0.0,
            _ => f32::MIN,
        }
    }

    /// The frame that a burst is: up to its expected end if that is known, and up to the end of the burst else.
    fn frame_of_burst(&self, gap: &Gap<'_>, due: &DueFrame, burst: Range<usize>) -> DamagedFrame {
        let end = due.length.map_or(burst.end, |length| burst.end.min(burst.start + length));
        let is_short = due.length.is_some_and(|length| end - burst.start < length) || end - burst.start < ENVELOPE_BYTES;
        // Only where no request is known to be outstanding, unit and function are needed: they put the two lines in order.
        let bytes = &self.bytes()[burst.clone()];
        let is_identified = self.is_framed_independently() && self.begins_with_header(due, bytes) == (true, true);
        DamagedFrame {
            start: burst.start,
            end,
            direction: due.direction,
            head: Vec::new(),
            is_short,
            damage: self.loss_in_burst(gap, due, &burst),
            is_unidentified: !is_identified,
            wrong_head_bytes: 0,
        }
    }

    /// The bytes that a burst has lost, where it is a few bytes shorter than the frame that is due, whether bytes like those of a
    /// line driver at its ends belong to it or not, and its receiver has understood it: a response follows the request, or
    /// another request the response.
    fn loss_in_burst(&self, gap: &Gap<'_>, due: &DueFrame, burst: &Range<usize>) -> Option<DamageKind> {
        let is_understood = gap.next.is_some() && due.score == DUE_BURST_BITS;
        let from = (gap.range.start..=burst.start).rev().find(|&at| at == gap.range.start || self.has_pause(at))?;
        let to = (burst.end..gap.range.end).find(|&at| self.has_pause(at)).unwrap_or(gap.range.end);
        let missing = |length: usize| due.length?.checked_sub(length).filter(|count| (1..=MAX_LOST_BYTES).contains(count));
        let count = missing(burst.len()).filter(|_| is_understood && missing(to - from).is_some())?;
        (burst.len() > count).then_some(DamageKind::LostBytes { at: 0, count })
    }
}

/// A frame after a damaged one that the search has found, and in front of a request: probably the response to it, but that
/// may have been a response itself.
fn due_frame_behind_damage(gap: &Gap<'_>) -> Option<DueFrame> {
    let is_request = gap.next.is_some_and(|(_, direction)| direction == Direction::Request);
    let direction = Direction::Unknown;
    is_request.then_some(DueFrame { direction, header: None, length: None, score: UNPROVEN_RESPONSE_BITS })
}

/// Whether a response has the unit and the function of this request.
fn answers(request: RequestRef<'_>, response: &[u8]) -> bool {
    request.unit == response[0] && request.pdu.first() == Some(&(response[1] & !EXCEPTION_BIT))
}
