//! The framer of one line of a session: of the framing that is given, or of the one that is detected.

use crate::confidence;
use crate::framer::auto::AutoFramer;
use crate::framer::fixed::FixedFramer;
use crate::framer::rtu::RtuFramer;
use crate::framer::silence::SilenceRule;
use crate::framer::{FrameResult, Framer, FramerContext};
use crate::input::Input;
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::line::LineSettings;
use modlens_protocol::Ns;

/// The framer of one line.
pub enum LineFramer {
    /// The framing is known.
    Fixed(FixedFramer),
    /// The framing is detected on the first bytes.
    Detected(AutoFramer),
}

impl LineFramer {
    /// A framer for a line with these settings. Its framing is detected where `mode` is `None`.
    pub fn new(mode: Option<Mode>, line: Option<LineSettings>, rule: Option<SilenceRule>) -> Self {
        match mode {
            Some(mode) => Self::Fixed(FixedFramer::new(mode, line.as_ref(), rule)),
            None => Self::Detected(AutoFramer::new(line, rule)),
        }
    }

    /// The RTU framer, if the next bytes are for one that goes by joint evidence: the fast path takes whole exchanges from it.
    #[inline]
    pub fn rtu_mut(&mut self) -> Option<&mut RtuFramer> {
        match self {
            Self::Fixed(framer) => framer.rtu_mut(),
            Self::Detected(framer) => framer.active_mut()?.rtu_mut(),
        }
    }

    fn get(&self) -> &dyn Framer {
        match self {
            Self::Fixed(framer) => framer,
            Self::Detected(framer) => framer,
        }
    }
}

impl Framer for LineFramer {
    #[inline]
    fn next(&mut self, input: &Input, context: &FramerContext<'_>, adu: &mut Vec<u8>) -> Option<FrameResult> {
        let mut result = match self {
            Self::Fixed(framer) => framer.next(input, context, adu),
            Self::Detected(framer) => framer.next(input, context, adu),
        }?;
        if result.verdict != Verdict::Ok {
            result.confidence = confidence::of_verdict(result.verdict);
        }
        Some(result)
    }

    fn mode(&self) -> Mode {
        self.get().mode()
    }

    fn skip_to(&mut self, offset: u64) {
        match self {
            Self::Fixed(framer) => framer.skip_to(offset),
            Self::Detected(framer) => framer.skip_to(offset),
        }
    }

    fn is_settled_at(&self, offset: u64) -> bool {
        self.get().is_settled_at(offset)
    }

    fn break_ns(&self, line: Option<&LineSettings>) -> Ns {
        self.get().break_ns(line)
    }
}
