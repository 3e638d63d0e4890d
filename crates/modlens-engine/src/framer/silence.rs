//! The textbook rule: a frame ends where the line is silent for t3.5, and nowhere else (serial line specification, 2.5.1.1).
//!
//! It is for exact clocks and for teaching. Adapters that hold bytes back, masters that leave no gap and devices that pause
//! inside a frame all break it; `rtu` goes by evidence instead.

use crate::framer::{FrameResult, Framer, FramerContext, MAX_NOISE_ROW_BYTES};
use crate::input::Input;
use crate::weights::CRC_CONFIDENCE_BITS;
use modlens_protocol::checksum::crc_valid;
use modlens_protocol::direction::{infer_direction, Direction};
use modlens_protocol::framing::{DelimitedBy, Mode, Verdict};
use modlens_protocol::line::LineSettings;
use modlens_protocol::Ns;

/// Unit, function code and CRC.
const MIN_FRAME_BYTES: usize = 4;

/// The two silences of the rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SilenceRule {
    /// The shortest silence between frames.
    pub t35_ns: Ns,
    /// The longest silence inside a frame; a longer one is a finding.
    pub t15_ns: Ns,
}

/// The framer of an RTU line that goes by the rule.
#[derive(Clone, Copy, Debug)]
pub struct SilenceFramer {
    rule: SilenceRule,
}

impl SilenceFramer {
    /// A framer with these silences.
    pub fn new(rule: SilenceRule) -> Self {
        Self { rule }
    }

    /// The length in bytes of the first frame, and the evidence for its end; `None` if it is still open. Without a silence of
    /// t3.5 or a record's start, it ends after `MAX_NOISE_ROW_BYTES`, or with the last byte once the input is closed.
    fn first_end(&self, input: &Input) -> Option<(usize, DelimitedBy)> {
        let available = input.bytes().len().min(MAX_NOISE_ROW_BYTES);
        match input.boundary_after(0, available, self.rule.t35_ns) {
            Some(end) if input.read(end).is_some_and(|read| read.starts_record) => Some((end, DelimitedBy::Record)),
            Some(end) => Some((end, DelimitedBy::Silence)),
            None if available == MAX_NOISE_ROW_BYTES => Some((available, DelimitedBy::Limit)),
            None if input.is_closed => Some((available, if input.is_ended { DelimitedBy::End } else { DelimitedBy::Silence })),
            None => None,
        }
    }
}

/// The row of the first `length` bytes as a frame. `adu`, which is empty, gets unit and PDU.
///
/// The CRC decides: `Ok` or `BadChecksum`; where the recording prints no checksum, all bytes are unit and PDU (`NoChecksum`).
/// Only a good frame has a direction. The confidence is the same for all three, because nothing is weighed.
fn frame(input: &Input, context: &FramerContext<'_>, length: usize, delimited_by: DelimitedBy, adu: &mut Vec<u8>) -> FrameResult {
    let bytes = &input.bytes()[..length];
    let lacks_checksum = input.read(0).is_some_and(|read| read.lacks_checksum);
    adu.extend_from_slice(if lacks_checksum { bytes } else { &bytes[..length - 2] });
    let verdict = match crc_valid(bytes) {
        _ if lacks_checksum => Verdict::NoChecksum,
        true => Verdict::Ok,
        false => Verdict::BadChecksum,
    };
    let direction = if verdict.is_good() { direction(input, context, adu) } else { Direction::Unknown };
    let confidence = CRC_CONFIDENCE_BITS;
    FrameResult { direction, confidence, ..FrameResult::new(verdict, length, delimited_by) }
}

/// Who sent a good frame at the first byte, of which `adu` has unit and PDU.
fn direction(input: &Input, context: &FramerContext<'_>, adu: &[u8]) -> Direction {
    let pause = (context.timeout_log_odds)(input.pause_before(0));
    let declared = context.declared_direction_at(input, 0);
    infer_direction(context.functions, context.outstanding_request, adu[0], &adu[1..], declared, pause)
}

impl Framer for SilenceFramer {
    /// The bytes up to the first silence as a row; `None` if there are none, or if the silence has not come. No frame is
    /// searched for inside, and a damaged one is not explained.
    ///
    /// Noise if they are too few for a frame, or end only at the limit of a row. Else `frame` says what they are.
    fn next(&mut self, input: &Input, context: &FramerContext<'_>, adu: &mut Vec<u8>) -> Option<FrameResult> {
        adu.clear();
        if input.bytes().is_empty() {
            return None;
        }
        let (length, delimited_by) = self.first_end(input)?;
        if length < MIN_FRAME_BYTES || delimited_by == DelimitedBy::Limit {
            return Some(FrameResult::noise(length, delimited_by));
        }
        Some(frame(input, context, length, delimited_by, adu))
    }

    fn mode(&self) -> Mode {
        Mode::Rtu
    }

    fn break_ns(&self, _line: Option<&LineSettings>) -> Ns {
        self.rule.t35_ns
    }
}
