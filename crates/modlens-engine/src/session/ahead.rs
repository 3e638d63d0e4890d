//! Frames of the two lines of a bus without a clock: each line is framed ahead, then their order is found.

use std::collections::VecDeque;

use crate::framer::{Context, Cut};
use crate::input::Input;
use crate::pairing::align::{order, Heard, WINDOW};
use crate::session::bus::{voted, LineState};
use modlens_protocol::direction::{readings, Direction};
use modlens_protocol::framing::Verdict;
use modlens_protocol::functions::Functions;

/// Where one line says nothing for so many bytes of the other, it says nothing at all.
const MOST_BYTES: usize = 16 << 20;

/// What is known of a line beyond the frames that were told.
pub(super) struct Ahead {
    cuts: VecDeque<Cut>,
    heard: VecDeque<Heard>,
    /// The bytes from the first frame on that was not told; the line's own input begins behind all of these frames.
    pub(super) input: Input,
}

impl Ahead {
    pub(super) fn new(input: Input) -> Self {
        Self { cuts: VecDeque::new(), heard: VecDeque::new(), input }
    }
}

impl LineState {
    /// The bytes from the first frame on that was not told.
    pub(super) fn untold(&self) -> &Input {
        self.ahead.as_ref().map_or(&self.input, |ahead| &ahead.input)
    }

    /// A frame was told.
    pub(super) fn consume(&mut self, length: usize) {
        match &mut self.ahead {
            Some(ahead) => ahead.input.consume(length),
            None => self.input.consume(length),
        }
    }

    /// Finds one more frame in what has come, unless a window is full; says whether there was one.
    pub(super) fn look_ahead(&mut self, context: &Context<'_>) -> bool {
        let Self { ahead: Some(ahead), input, framer, votes, .. } = self else { return false };
        if ahead.heard.len() >= WINDOW || input.bytes().is_empty() {
            return false;
        }
        let mut adu = Vec::new();
        let Some(cut) = framer.next(input, context, &mut adu) else { return false };
        input.consume(cut.length);
        let adu = if cut.verdict == Verdict::Noise { Vec::new() } else { adu };
        let good = cut.verdict.good();
        if good {
            *votes = voted(*votes, context.functions, &adu);
        }
        ahead.heard.push_back(Heard { direction: cut.direction, good, adu });
        ahead.cuts.push_back(cut);
        true
    }

    /// Now that it is known who speaks here, frames that either side may send are this side's.
    pub(super) fn all_said_by(&mut self, functions: &Functions, speaker: Direction) {
        let Some(ahead) = &mut self.ahead else { return };
        for (cut, heard) in ahead.cuts.iter_mut().zip(&mut ahead.heard) {
            if heard.adu.len() > 1 && cut.direction != speaker && readings(functions, &heard.adu[1..]) == (true, true) {
                (cut.direction, heard.direction) = (speaker, speaker);
            }
        }
    }

    /// The next frame of this line.
    pub(super) fn next_heard(&mut self, adu: &mut Vec<u8>) -> Option<Cut> {
        let ahead = self.ahead.as_mut()?;
        *adu = ahead.heard.pop_front()?.adu;
        ahead.cuts.pop_front()
    }

    fn filled(&self) -> bool {
        let window = self.ahead.as_ref().is_some_and(|ahead| ahead.heard.len() >= WINDOW);
        window || (self.input.ended && self.input.bytes().is_empty())
    }
}

/// Which lines the next frames are of; nothing while more of one line has to be known.
pub(super) fn next_lines(functions: &Functions, lines: &mut [(u8, LineState)]) -> Vec<usize> {
    let waiting = lines.iter().any(|(_, line)| line.input.bytes().len() > MOST_BYTES);
    let over = lines.iter().all(|(_, line)| line.input.ended && line.input.bytes().is_empty());
    if !waiting && (lines.len() < 2 && !over || !lines.iter().all(|(_, line)| line.filled())) {
        return Vec::new();
    }
    let all = waiting || lines.iter().any(|(_, line)| line.ahead.as_ref().is_some_and(|ahead| ahead.heard.len() < WINDOW));
    let mut heard = lines.iter_mut().map(|(_, line)| line.ahead.as_mut().map(|ahead| &*ahead.heard.make_contiguous()));
    let (one, other) = (heard.next().flatten().unwrap_or(&[]), heard.next().flatten().unwrap_or(&[]));
    order(functions, [one, other], all)
}
