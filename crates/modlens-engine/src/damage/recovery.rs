//! Rows for bytes that begin no whole frame: a damaged frame where header or silences say so, noise elsewhere.

use std::collections::VecDeque;

use crate::damage::chain::is_glitch;
use crate::damage::kind::Harm;
use crate::damage::region::{Piece, UnframedRegion};
use crate::framer::rtu::announced_length::{announced, AROUND, LONGEST};
use crate::framer::rtu::search::Told;
use crate::framer::rtu::Rtu;
use crate::framer::{Context, Cut, NOISE_LIMIT};
use crate::input::Input;
use modlens_protocol::direction::Direction;
use modlens_protocol::framing::{CutBy, Verdict};
use modlens_protocol::functions::Extent;

impl Rtu {
    /// The first piece of the bytes up to `to`, which begin no whole frame: a damaged one, or noise.
    pub(crate) fn piece(&mut self, input: &Input, context: &Context<'_>, to: u64, adu: &mut Vec<u8>) -> Cut {
        let offset = input.offset();
        if self.dissected < to {
            self.dissected = to;
            self.pieces = self.dissect(input, context, (to - offset) as usize);
            if !context.ahead {
                self.blame();
            }
            self.pieces.iter().for_each(|(_, piece)| self.search.model.learn_harm(piece.harm));
        }
        let region = (to - offset) as usize;
        let first = self.pieces.front().filter(|(start, _)| *start == offset);
        let Some((_, piece)) = first else {
            let strays = self.pieces.front().map_or(region, |(start, _)| (start - offset) as usize);
            let cut = self.damaged(input, context, strays, adu);
            let glitch = cut.verdict == Verdict::Noise && is_glitch(&input.bytes()[..cut.length]);
            return Cut { harm: glitch.then_some(Harm::Glitch), ..cut };
        };
        let length = piece.end - piece.start;
        let cut_by = if length == region { CutBy::Frame } else { CutBy::Length };
        let cut = Self::show(piece, &input.bytes()[..length], cut_by, adu);
        self.pieces.pop_front();
        cut
    }

    /// A piece as a frame, with its first bytes put back where it is known which ones are missing.
    fn show(piece: &Piece, wire: &[u8], cut_by: CutBy, adu: &mut Vec<u8>) -> Cut {
        let short = piece.is_short || wire.len() < AROUND;
        adu.clear();
        if !piece.is_unidentified {
            adu.extend_from_slice(&piece.head);
            adu.extend_from_slice(if short { wire } else { &wire[piece.wrong_head_bytes..wire.len() - 2] });
        }
        let verdict = if short { Verdict::Incomplete } else { Verdict::BadChecksum };
        Cut { verdict, direction: piece.direction, harm: piece.harm, ..Cut::noise(wire.len(), cut_by) }
    }

    /// A frame with a wrong checksum that the search found by its length, and what happened to it.
    pub(crate) fn spoilt(
        &mut self,
        input: &Input,
        context: &Context<'_>,
        length: usize,
        direction: Direction,
        adu: &mut Vec<u8>,
    ) -> Cut {
        let wire = &input.bytes()[..length];
        let model = &self.search.model;
        let silence = self.silence(input);
        let region = UnframedRegion {
            model,
            context,
            input,
            length,
            next_frame: None,
            follows_damaged_frame: true,
            frame_gap_ns: silence,
            ends_as_announced: true,
        };
        let pieces = region.damaged_frames();
        let found = pieces.iter().find(|piece| piece.start == 0 && (piece.end == length || is_glitch(&wire[piece.end..])));
        if let Some(piece) = found {
            self.search.model.learn_harm(piece.harm);
            if piece.end < length {
                // It is shorter: strays stand in the place of what was lost.
                self.told = Some(Told::Junk(input.offset() + length as u64));
            }
            return Self::show(piece, &wire[..piece.end], CutBy::Length, adu);
        }
        adu.clear();
        adu.extend_from_slice(&wire[..length - 2]);
        Cut { verdict: Verdict::BadChecksum, direction, ..Cut::noise(length, CutBy::Length) }
    }

    fn dissect(&self, input: &Input, context: &Context<'_>, length: usize) -> VecDeque<(u64, Piece)> {
        let next_frame = match self.told {
            Some(Told::Frame { start, end, direction, .. } | Told::Damaged { start, end, direction }) => {
                let from = (start - input.offset()) as usize;
                Some((&input.bytes()[from..from + (end - start) as usize], direction))
            }
            _ => None,
        };
        let model = &self.search.model;
        let region = UnframedRegion {
            model,
            context,
            input,
            length,
            next_frame,
            follows_damaged_frame: self.after_damage,
            frame_gap_ns: self.silence(input),
            ends_as_announced: false,
        };
        region.damaged_frames().into_iter().map(|piece| (input.offset() + piece.start as u64, piece)).collect()
    }

    /// Names the bytes `..region`, which begin no frame: the first piece of them.
    fn damaged(&self, input: &Input, context: &Context<'_>, region: usize, adu: &mut Vec<u8>) -> Cut {
        let edge = input.edge_after(0, region, self.silence(input));
        let burst = edge.unwrap_or(region).min(NOISE_LIMIT);
        let by_edge = match edge {
            Some(end) if input.read(end).is_some_and(|read| read.record) => CutBy::Record,
            None if burst == NOISE_LIMIT => CutBy::Limit,
            None if burst < input.bytes().len() => CutBy::Frame,
            None if input.ended => CutBy::End,
            _ => CutBy::Silence,
        };
        let cut = Self::name(input, context, burst, by_edge);
        adu.clear();
        if cut.verdict != Verdict::Noise {
            let end = if cut.verdict == Verdict::Incomplete { cut.length } else { cut.length - 2 };
            adu.extend_from_slice(&input.bytes()[..end]);
        }
        cut
    }

    fn name(input: &Input, context: &Context<'_>, burst: usize, by_edge: CutBy) -> Cut {
        let bytes = &input.bytes()[..burst];
        let alone = input.offset() == 0 && by_edge == CutBy::End;
        let record = by_edge == CutBy::Record || (input.read(0).is_some_and(|read| read.record) && input.starts_read(0));
        if burst < AROUND || !(alone || record) {
            return Cut::noise(burst, by_edge);
        }
        let damaged = |length, verdict, cut_by, direction| Cut { verdict, direction, ..Cut::noise(length, cut_by) };
        let familiar = context.known_units[bytes[0] as usize] || context.asked.is_some_and(|asked| asked.unit == bytes[0]);
        let mut shorter = None;
        let mut longer = None;
        // Where this unit and function were asked for, it is the answer, not another request.
        let answer = context.asked.is_some_and(|asked| asked.unit == bytes[0] && asked.pdu.first() == Some(&bytes[1]));
        let known = announced(context, bytes);
        for (direction, length) in known.iter().copied().flatten().take(if answer { 1 } else { 2 }) {
            match length {
                Extent::Exactly(length) if length == burst => {
                    return damaged(length, Verdict::BadChecksum, CutBy::Length, direction);
                }
                Extent::Exactly(length) if length < burst => shorter = shorter.or(Some((length, direction))),
                Extent::Exactly(_) | Extent::AtLeast(_) => longer = longer.or(Some(direction)),
                Extent::Open(_) => {}
            }
        }
        let alone = input.offset() == 0 && by_edge == CutBy::End;
        let bounded = alone || input.timed || matches!(by_edge, CutBy::Silence | CutBy::Record);
        match (shorter, longer) {
            (Some((length, direction)), _) if familiar && !bounded => {
                damaged(length, Verdict::BadChecksum, CutBy::Length, direction)
            }
            (_, Some(direction)) if burst <= LONGEST && (bounded || familiar || by_edge == CutBy::End) => {
                damaged(burst, Verdict::Incomplete, by_edge, direction)
            }
            _ if burst <= LONGEST && (bounded || familiar) => damaged(burst, Verdict::BadChecksum, by_edge, Direction::Unknown),
            _ => Cut::noise(burst, by_edge),
        }
    }
}
