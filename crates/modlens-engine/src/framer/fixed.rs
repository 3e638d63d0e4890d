//! The framer of a line whose framing is known.

use crate::framer::ascii::Ascii;
use crate::framer::rtu::Rtu;
use crate::framer::silence::{Rule, Silence};
use crate::framer::tcp::Tcp;
use crate::framer::{Context, Cut, Framer};
use crate::input::Input;
use modlens_protocol::framing::Mode;
use modlens_protocol::line::LineSettings;
use modlens_protocol::Ns;

/// One of the framers, by the framing of the line.
pub enum FixedFramer {
    /// RTU by joint evidence.
    Rtu(Box<Rtu>),
    /// RTU by the textbook's rule of silence.
    Silence(Silence),
    /// ASCII.
    Ascii(Ascii),
    /// MBAP.
    Tcp(Tcp),
}

impl FixedFramer {
    /// The framer of this framing on a line with these settings. RTU goes by the rule of silence where there is one, else by
    /// joint evidence.
    pub fn new(mode: Mode, line: Option<&LineSettings>, rule: Option<Rule>) -> Self {
        match (mode, rule) {
            (Mode::Rtu, Some(rule)) => Self::Silence(Silence::new(rule)),
            (Mode::Rtu, None) => Self::Rtu(Box::new(Rtu::new(line))),
            (Mode::Ascii, _) => Self::Ascii(Ascii::default()),
            (Mode::Tcp, _) => Self::Tcp(Tcp::default()),
        }
    }

    /// The RTU framer, if the line has one that goes by joint evidence: the fast path takes whole exchanges from it.
    #[inline]
    pub fn rtu_mut(&mut self) -> Option<&mut Rtu> {
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
    fn next(&mut self, input: &Input, context: &Context<'_>, adu: &mut Vec<u8>) -> Option<Cut> {
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

    fn jump(&mut self, offset: u64) {
        match self {
            Self::Rtu(framer) => framer.jump(offset),
            Self::Silence(framer) => framer.jump(offset),
            Self::Ascii(framer) => framer.jump(offset),
            Self::Tcp(framer) => framer.jump(offset),
        }
    }

    fn settled(&self, offset: u64) -> bool {
        self.get().settled(offset)
    }

    fn break_ns(&self, line: Option<&LineSettings>) -> Ns {
        self.get().break_ns(line)
    }
}
