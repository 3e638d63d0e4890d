//! The framer of a line whose framing is known.

use crate::framer::ascii::AsciiFramer;
use crate::framer::rtu::RtuFramer;
use crate::framer::silence::{SilenceFramer, SilenceRule};
use crate::framer::tcp::TcpFramer;
use crate::framer::{FrameResult, Framer, FramerContext};
use crate::input::Input;
use modlens_protocol::framing::Mode;
use modlens_protocol::line::LineSettings;
use modlens_protocol::Ns;

/// One of the framers, by the framing of the line.
pub enum FixedFramer {
    /// RTU by joint evidence.
    Rtu(Box<RtuFramer>),
    /// RTU by the textbook's rule of silence.
    Silence(SilenceFramer),
    /// ASCII.
    Ascii(AsciiFramer),
    /// MBAP.
    Tcp(TcpFramer),
}

impl FixedFramer {
    /// The framer of this framing on a line with these settings. RTU goes by the rule of silence where there is one, else by
    /// joint evidence.
    pub fn new(mode: Mode, line: Option<&LineSettings>, rule: Option<SilenceRule>) -> Self {
        match (mode, rule) {
            (Mode::Rtu, Some(rule)) => Self::Silence(SilenceFramer::new(rule)),
            (Mode::Rtu, None) => Self::Rtu(Box::new(RtuFramer::new(line))),
            (Mode::Ascii, _) => Self::Ascii(AsciiFramer::default()),
            (Mode::Tcp, _) => Self::Tcp(TcpFramer::default()),
        }
    }

    /// The RTU framer, if the line has one that goes by joint evidence: the fast path takes whole exchanges from it.
    #[inline]
    pub fn rtu_mut(&mut self) -> Option<&mut RtuFramer> {
        match self {
            Self::Rtu(framer) => Some(framer),
            Self::Silence(_) | Self::Ascii(_) | Self::Tcp(_) => None,
        }
    }

    fn get(&self) -> &dyn Framer {
        match self {
            Self::Rtu(framer) => framer.as_ref(),
            Self::Silence(framer) => framer,
            Self::Ascii(framer) => framer,
            Self::Tcp(framer) => framer,
        }
    }
}

impl Framer for FixedFramer {
    #[inline]
    fn next(&mut self, input: &Input, context: &FramerContext<'_>, adu: &mut Vec<u8>) -> Option<FrameResult> {
        match self {
            Self::Rtu(framer) => framer.next(input, context, adu),
            Self::Silence(framer) => framer.next(input, context, adu),
            Self::Ascii(framer) => framer.next(input, context, adu),
            Self::Tcp(framer) => framer.next(input, context, adu),
        }
    }

    fn mode(&self) -> Mode {
        self.get().mode()
    }

    fn skip_to(&mut self, offset: u64) {
        match self {
            Self::Rtu(framer) => framer.skip_to(offset),
            Self::Silence(framer) => framer.skip_to(offset),
            Self::Ascii(framer) => framer.skip_to(offset),
            Self::Tcp(framer) => framer.skip_to(offset),
        }
    }

    fn is_settled_at(&self, offset: u64) -> bool {
        self.get().is_settled_at(offset)
    }

    fn break_ns(&self, line: Option<&LineSettings>) -> Ns {
        self.get().break_ns(line)
    }
}
