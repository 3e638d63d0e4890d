//! Chooses the framer of a line on its first bytes, by the checksums and headers that fit, and again where it finds only noise
//! in what is of another mode. Line settings, times of single bytes and marks of a receiver rule Modbus/TCP out.
//!
//! The choice is made at fixed numbers of bytes, at a silence or at the end, and changed at a row of noise, so it does not
//! depend on how the input was split into blocks.

use crate::framer::fixed::FixedFramer;
use crate::framer::silence::SilenceRule;
use crate::framer::{FrameResult, Framer, FramerContext};
use crate::input::Input;
use crate::weights::{FIRST_MODE_CHECK_BYTES, LAST_MODE_CHECK_BYTES, MIN_OTHER_MODE_BYTES};
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::line::LineSettings;
use modlens_protocol::recognize::{
    mode_by_appearance, mode_by_valid_frames, serial_mode_by_appearance, serial_mode_by_valid_frames, valid_bytes,
};
use modlens_protocol::Ns;

/// Waits for evidence of a mode, then frames by the framer of that mode.
pub struct AutoFramer {
    line: Option<LineSettings>,
    rule: Option<SilenceRule>,
    /// The number of bytes at which a mode is looked for next.
    next_check_bytes: usize,
    chosen: Option<FixedFramer>,
    /// The framer before the mode was changed, with what it has learned.
    earlier: Option<FixedFramer>,
    /// The stream offset at which the mode was changed last. The row at this offset cannot change the mode again.
    changed_at: Option<u64>,
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
            earlier: None,
            changed_at: None,
            of_other_mode: None,
            last_was_other_mode: false,
        }
    }

    /// A framer for a side of a TCP connection that is taken for MBAP because the other side is.
    pub fn of_connection() -> Self {
        Self { chosen: Some(FixedFramer::new(Mode::Tcp, None, None)), ..Self::new(None, None) }
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
    ///
    /// What only a serial line can give (`is_serial`) is never Modbus/TCP by 3 and 4.
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
        let is_serial = self.is_serial(input);
        let by_valid_frames = if is_serial { serial_mode_by_valid_frames } else { mode_by_valid_frames };
        let checked = &bytes[..bytes.len().min(LAST_MODE_CHECK_BYTES)];
        while self.next_check_bytes <= checked.len() {
            if let Some(mode) = by_valid_frames(functions, &bytes[..self.next_check_bytes]) {
                return Some(mode);
            }
            self.next_check_bytes *= 2;
        }
        if !input.is_closed && bytes.len() < LAST_MODE_CHECK_BYTES {
            return None;
        }
        let by_appearance =
            || if is_serial { serial_mode_by_appearance(checked) } else { mode_by_appearance(functions, checked) };
        Some(by_valid_frames(functions, checked).unwrap_or_else(by_appearance))
    }

    /// Whether only a serial line can have given these bytes: line settings are known, single bytes have times, or the receiver
    /// has marked line errors.
    fn is_serial(&self, input: &Input) -> bool {
        self.line.is_some() || input.has_byte_times || input.has_marks()
    }

    /// Returns the mode, other than `chosen`, that a row of the framer of mode `chosen` shows: at least half of its bytes are in
    /// valid frames of that mode. The bytes before the row, such as a program's greeting or bytes that look like headers, were
    /// then not what the line carries now.
    ///
    /// `None` for a good row and for a short one. A damaged frame is checked like noise: the framer may have taken bytes of
    /// another mode for a frame that was due.
    fn other_mode(&self, functions: &Functions, input: &Input, row: &FrameResult, chosen: Mode) -> Option<Mode> {
        let bytes = &input.bytes()[..row.length];
        if row.verdict.is_good() || bytes.len() < MIN_OTHER_MODE_BYTES {
            return None;
        }
        let is_possible = |mode: Mode| mode != chosen && (mode != Mode::Tcp || !self.is_serial(input));
        let modes = [Mode::Rtu, Mode::Ascii, Mode::Tcp].into_iter().filter(|&mode| is_possible(mode));
        modes.into_iter().find(|&mode| 2 * valid_bytes(functions, mode, bytes) >= bytes.len())
    }

    /// Changes the mode from the first unframed byte on. The framer so far is kept: it goes on with what it has learned if the
    /// line changes back.
    fn change_mode(&mut self, mode: Mode, offset: u64) {
        let earlier = self.earlier.take().filter(|framer| framer.mode() == mode);
        let mut framer = earlier.unwrap_or_else(|| FixedFramer::new(mode, self.line.as_ref(), self.rule));
        framer.skip_to(offset);
        self.earlier = self.chosen.replace(framer);
        self.changed_at = Some(offset);
    }

    /// Returns the next row of the chosen framer. `None` if the framer needs more bytes, and also if `break_ns` of the input is
    /// not yet that of the framer: the caller then sets it and calls again.
    fn next_of_chosen(&mut self, input: &Input, context: &FramerContext<'_>, adu: &mut Vec<u8>) -> Option<FrameResult> {
        let framer = self.chosen.as_mut()?;
        (framer.break_ns(self.line.as_ref()) == input.break_ns).then(|| framer.next(input, context, adu))?
    }

    /// Returns the row of a read that proves another mode than the chosen one. The framer of that mode is kept in `of_other_mode`
    /// for further reads, and the chosen framer skips the bytes of the row.
    ///
    /// `None` unless the read begins with the first unframed byte and the framer of its mode takes exactly this read as one row.
    /// In case of `None`, the chosen framer frames the read like any other bytes.
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

impl Framer for AutoFramer {
    /// The next frame, by the framer of the mode that was detected; `adu` gets its unit and PDU. `None` if more bytes are needed:
    /// to detect the mode, or for the frame.
    ///
    /// A read that proves another mode is returned as a frame of that, and the mode detected stays (`next_of_other_mode`). If
    /// what the framer gives is not good, and at least half of its bytes are in valid frames of another mode (`other_mode`), the
    /// line has changed: the result is dropped, and the same bytes are framed again in the new mode.
    fn next(&mut self, input: &Input, context: &FramerContext<'_>, adu: &mut Vec<u8>) -> Option<FrameResult> {
        if self.chosen.is_none() {
            if input.bytes().is_empty() {
                return None;
            }
            let mode = self.mode_of(input, context.functions)?;
            let mut framer = FixedFramer::new(mode, self.line.as_ref(), self.rule);
            framer.skip_to(input.offset());
            self.chosen = Some(framer);
        }
        if let Some(result) = self.next_of_other_mode(input, context, adu) {
            return Some(result);
        }
        self.last_was_other_mode = false;
        let result = self.next_of_chosen(input, context, adu)?;
        if self.changed_at == Some(input.offset()) {
            return Some(result);
        }
        let mode = self.chosen.as_ref()?.mode();
        let Some(other) = self.other_mode(context.functions, input, &result, mode) else { return Some(result) };
        self.change_mode(other, input.offset());
        self.next_of_chosen(input, context, adu)
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
