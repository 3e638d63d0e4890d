//! Chooses the framer of a line on its first bytes, by the checksums and headers that fit, and again where it finds only noise
//! in what is RTU.
//!
//! The choice is made at fixed numbers of bytes, at a silence or at the end, and changed at a row of noise, so it does not
//! depend on how the input was split into blocks.

use crate::framer::fixed::FixedFramer;
use crate::framer::silence::SilenceRule;
use crate::framer::{FrameResult, Framer, FramerContext};
use crate::input::Input;
use crate::weights::{FIRST_MODE_CHECK_BYTES, LAST_MODE_CHECK_BYTES, MIN_OTHER_MODE_BYTES};
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::functions::Functions;
use modlens_protocol::line::LineSettings;
use modlens_protocol::recognize::{mode_by_appearance, mode_by_valid_frames, valid_rtu_bytes};
use modlens_protocol::Ns;

/// Waits for evidence of a mode, then frames by the framer of that mode.
pub struct AutoFramer {
    line: Option<LineSettings>,
    rule: Option<SilenceRule>,
    /// The number of bytes at which a mode is looked for next.
    next_check_bytes: usize,
    chosen: Option<FixedFramer>,
    /// The framer of records that prove another mode: logs of gateways have RTU on one side and MBAP on the other.
    of_other_mode: Option<FixedFramer>,
    /// The last frame came from `of_other_mode`.
    last_was_other_mode: bool,
}

impl AutoFramer {
    /// A framer for a line with these settings. RTU is framed by the silence rule if there is one, else by evidence.
    pub fn new(line: Option<LineSettings>, rule: Option<SilenceRule>) -> Self {
        Self {
            line,
            rule,
            next_check_bytes: FIRST_MODE_CHECK_BYTES,
            chosen: None,
            of_other_mode: None,
            last_was_other_mode: false,
        }
    }

    /// The framer that the next bytes are for, once it is chosen; `None` while a record proves another mode.
    #[inline]
    pub fn active_mut(&mut self) -> Option<&mut FixedFramer> {
        self.chosen.as_mut().filter(|_| !self.last_was_other_mode)
    }

    /// The mode of the line, if its first bytes, from the first unframed one on, show it already; `None` if more are needed.
    ///
    /// 1. The mode that the first read proves by itself, as a line of a log may.
    /// 2. RTU for a recording that prints no checksums, unless it begins with a colon.
    /// 3. At 8, 16 ... 4096 bytes, the mode in which most of them are in valid frames, as soon as there is a valid frame.
    ///    `next_check_bytes` says which of these numbers is the next; none is tried twice.
    /// 4. At 4096 bytes, or earlier once the input is closed: the same over all of them, else the mode that they look like.
    fn mode_of(&mut self, input: &Input, functions: &Functions) -> Option<Mode> {
        let (bytes, read) = (input.bytes(), input.read(0));
        if let Some(mode) = read.and_then(|read| read.proven_framing) {
            return Some(mode);
        }
        if read.is_some_and(|read| read.lacks_checksum) && bytes.first() != Some(&b':') {
            return Some(Mode::Rtu);
        }
        self.mode_by_bytes(input, functions)
    }

    /// The mode of the line by its first bytes alone: 3 and 4 of `mode_of`.
    fn mode_by_bytes(&mut self, input: &Input, functions: &Functions) -> Option<Mode> {
        let bytes = input.bytes();
        let checked = &bytes[..bytes.len().min(LAST_MODE_CHECK_BYTES)];
        while self.next_check_bytes <= checked.len() {
            if let Some(mode) = mode_by_valid_frames(functions, &bytes[..self.next_check_bytes]) {
                return Some(mode);
            }
            self.next_check_bytes *= 2;
        }
        if !input.is_closed && bytes.len() < LAST_MODE_CHECK_BYTES {
            return None;
        }
        Some(mode_by_valid_frames(functions, checked).unwrap_or_else(|| mode_by_appearance(functions, checked)))
    }

    /// The row of a read that proves another mode than the chosen one. `None` unless it begins with the first unframed byte and
    /// the framer of its mode takes exactly this read as one row; then the chosen framer goes on as with any other bytes.
    ///
    /// That framer is kept in `of_other_mode` for further reads. The chosen one skips the bytes of the row.
    fn next_of_other_mode(&mut self, input: &Input, context: &FramerContext<'_>, adu: &mut Vec<u8>) -> Option<FrameResult> {
        let read = input.read(0)?;
        let other_mode = read.proven_framing.filter(|mode| self.chosen.as_ref().is_some_and(|framer| framer.mode() != *mode))?;
        let length = (read.end - input.offset()) as usize;
        if !input.starts_read(0) {
            return None;
        }
        let framer = match &mut self.of_other_mode {
            Some(framer) if framer.mode() == other_mode => framer,
            unsuited => unsuited.insert(FixedFramer::new(other_mode, self.line.as_ref(), self.rule)),
        };
        framer.skip_to(input.offset());
        let result = framer.next(input, context, adu).filter(|result| result.length == length)?;
        self.last_was_other_mode = true;
        if let Some(framer) = &mut self.chosen {
            framer.skip_to(input.offset() + length as u64);
        }
        Some(result)
    }
}

/// Whether a row of noise is RTU: most of its bytes are in valid frames. What stood in front of it, be it a program's greeting
/// or bytes that look like headers, was then not what the line carries.
fn is_rtu(functions: &Functions, input: &Input, row: &FrameResult) -> bool {
    let bytes = &input.bytes()[..row.length];
    row.verdict == Verdict::Noise && bytes.len() >= MIN_OTHER_MODE_BYTES && 2 * valid_rtu_bytes(functions, bytes) >= bytes.len()
}

impl Framer for AutoFramer {
    fn next(&mut self, input: &Input, context: &FramerContext<'_>, adu: &mut Vec<u8>) -> Option<FrameResult> {
        if self.chosen.is_none() {
            if input.bytes().is_empty() {
                return None;
            }
            let mode = self.mode_of(input, context.functions)?;
            self.chosen = Some(FixedFramer::new(mode, self.line.as_ref(), self.rule));
        }
        if let Some(result) = self.next_of_other_mode(input, context, adu) {
            return Some(result);
        }
        self.last_was_other_mode = false;
        let framer = self.chosen.as_mut()?;
        let result = framer.next(input, context, adu)?;
        if framer.mode() == Mode::Rtu || !is_rtu(context.functions, input, &result) {
            return Some(result);
        }
        let mut rtu = FixedFramer::new(Mode::Rtu, self.line.as_ref(), self.rule);
        rtu.skip_to(input.offset());
        self.chosen.insert(rtu).next(input, context, adu)
    }

    fn is_settled_at(&self, offset: u64) -> bool {
        !self.last_was_other_mode && self.chosen.as_ref().is_some_and(|framer| framer.is_settled_at(offset))
    }

    fn mode(&self) -> Mode {
        let framer = if self.last_was_other_mode { &self.of_other_mode } else { &self.chosen };
        framer.as_ref().map_or(Mode::Rtu, Framer::mode)
    }

    fn break_ns(&self, line: Option<&LineSettings>) -> Ns {
        match &self.chosen {
            Some(framer) => framer.break_ns(line),
            None => FixedFramer::new(Mode::Rtu, line, self.rule).break_ns(line),
        }
    }
}
