//! Which statements of a program have printed the last frames, so that what another one repeats is known.

use crate::chunk::Side;
use crate::text::entries::EntryAssembler;

/// A statement: the shape of its lines, or the dialect that has read them; `None` for bytes of which neither is known.
type Voice = Option<u64>;

/// The statements that printed the last frames.
#[derive(Debug, Default)]
pub(super) struct Voices {
    pub last: Voice,
    before: Voice,
    /// The last frame of the text repeated the last one that was read.
    pub repeats: bool,
}

impl Voices {
    /// Notes which statement has printed the bytes that were read.
    pub fn note(&mut self, voice: Voice) {
        *self = Self { last: voice, before: self.last, repeats: false };
    }

    /// Whether a statement repeats the frame that another one printed last, or after such a one the frame before.
    pub fn repeats(&self, voice: Voice, bytes: &[u8], side: Option<Side>, assembler: &EntryAssembler) -> bool {
        let is_other = self.before.is_some() && self.before != voice;
        assembler.is_copy(bytes, side) || (self.repeats && is_other && assembler.is_earlier_copy(bytes))
    }
}
