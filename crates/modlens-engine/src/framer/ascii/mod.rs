//! ASCII: colon, hex characters, LRC, CR LF (serial line specification, 2.5.2).

mod autopsy;

use memchr::{memchr, memchr3_iter};

use crate::framer::harm::Harm;
use crate::framer::{Context, Cut, Framer, NOISE_LIMIT};
use crate::input::Input;
use modlens_protocol::checksum::lrc;
use modlens_protocol::direction::judge;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::{CutBy, Mode, Verdict};
use modlens_protocol::hex::{pair, solid};
use modlens_protocol::line::Line;
use modlens_protocol::Ns;

/// Longest frame in characters (2.5.2.2).
pub const LIMIT: usize = 513;

/// Longest pause between two characters (2.5.2.1).
const CHARACTER_TIMEOUT: Ns = 1_000_000_000;

/// What a right frame is worth: eight bits of LRC, colon and line end.
pub const AGREES: u8 = 32;

/// The framer of an ASCII line.
#[derive(Debug)]
pub struct Ascii {
    /// What may stand in place of the line feed: sub-function 3 of diagnostics changes it (6.8).
    delimiter: u8,
}

impl Default for Ascii {
    fn default() -> Self {
        Self { delimiter: b'\n' }
    }
}

/// How the characters behind a colon end.
struct End {
    /// Behind the last character of the frame.
    at: usize,
    /// Behind the last hex character.
    text: usize,
    cut_by: CutBy,
    finding: Option<Finding>,
}

impl Ascii {
    fn end(&self, input: &Input) -> Option<End> {
        let bytes = input.bytes();
        let edge = input.edge_after(0, bytes.len().min(LIMIT), CHARACTER_TIMEOUT);
        let there = &bytes[..edge.unwrap_or(bytes.len()).min(LIMIT)];
        let end = |at, text, cut_by, finding| Some(End { at, text, cut_by, finding });
        if let Some(i) = memchr3_iter(b':', b'\n', b'\r', there).find(|&at| at > 0) {
            match there[i] {
                b':' => return end(i, i, CutBy::Restart, None),
                b'\n' => return end(i + 1, i, CutBy::Delimiter, Some(Finding::BareLineFeed)),
                _ => match there.get(i + 1) {
                    Some(&next) if next == b'\n' || next == self.delimiter => return end(i + 2, i, CutBy::Delimiter, None),
                    Some(_) => return end(i + 1, i, CutBy::Delimiter, None),
                    None if there.len() < bytes.len() || input.closed => return end(i + 1, i, CutBy::Delimiter, None),
                    None => return None,
                },
            }
        }
        let length = there.len();
        if length == LIMIT {
            return end(length, length, CutBy::Limit, None);
        }
        match edge {
            Some(_) => end(length, length, if input.hard_edge(length) { CutBy::Record } else { CutBy::Silence }, None),
            None if input.ended => end(length, length, CutBy::End, None),
            None if input.closed => end(length, length, CutBy::Silence, None),
            None => None,
        }
    }

    /// What begins with no colon: noise, or a frame that lacks its colon.
    fn noise(input: &Input, context: &Context<'_>, adu: &mut Vec<u8>) -> Option<Cut> {
        let bytes = input.bytes();
        let there = &bytes[..bytes.len().min(NOISE_LIMIT)];
        match autopsy::headless(there, input.closed, context.known_units) {
            Some(found) if found.start > 0 => return Some(Cut::noise(found.start, CutBy::Restart)),
            Some(found) => {
                let whole = decode_hex(&there[found.text..found.text_end], adu) && found.whole;
                adu.truncate(adu.len() - usize::from(whole));
                let direction = autopsy::direction(context, adu);
                let cut = Cut::noise(found.end, CutBy::Delimiter);
                return Some(Cut { verdict: Verdict::Incomplete, direction, harm: found.harm, ..cut });
            }
            None => {}
        }
        if let Some(edge) = input.edge_after(0, there.len(), CHARACTER_TIMEOUT) {
            let colon = memchr(b':', &there[..edge]);
            return Some(colon.map_or(Cut::noise(edge, CutBy::Silence), |at| Cut::noise(at, CutBy::Restart)));
        }
        match memchr(b':', there) {
            Some(at) => Some(Cut::noise(at, CutBy::Restart)),
            None if there.len() == NOISE_LIMIT => Some(Cut::noise(NOISE_LIMIT, CutBy::Limit)),
            None if input.closed => Some(Cut::noise(there.len(), if input.ended { CutBy::End } else { CutBy::Silence })),
            None => None,
        }
    }

    fn frame(&mut self, input: &Input, context: &Context<'_>, end: &End, adu: &mut Vec<u8>) -> Cut {
        let text = &input.bytes()[1..end.text];
        let hex = decode_hex(text, adu);
        let mut cut = Cut { verdict: Verdict::Incomplete, ..Cut::noise(end.at, end.cut_by) };
        cut.finding = end.finding;
        let no_checksum = input.read(0).is_some_and(|read| read.no_checksum);
        if !no_checksum && end.cut_by != CutBy::Delimiter && !(hex && adu.len() > 2 && lrc(adu) == 0) {
            cut.direction = autopsy::direction(context, adu);
            // A sender that stops does so anywhere; who loses the line end loses half a byte before it.
            let half = text.len() % 2 == 1 && text.iter().all(u8::is_ascii_hexdigit);
            cut.harm = (half && autopsy::lacks(context, adu) == Some(1)).then_some(Harm::Lost { at: text.len() + 1, count: 3 });
            return cut;
        }
        if let Some(harm) = autopsy::lost(text).filter(|_| !no_checksum) {
            let direction = autopsy::direction(context, adu);
            return Cut { direction, harm: Some(harm), ..cut };
        }
        cut.verdict = match hex {
            true if no_checksum => Verdict::NoChecksum,
            true if adu.len() > 2 && lrc(adu) == 0 => Verdict::Ok,
            _ => Verdict::BadChecksum,
        };
        if cut.verdict == Verdict::BadChecksum && hex && autopsy::lacks(context, adu) == Some(1) {
            let direction = autopsy::direction(context, adu);
            let harm = Some(Harm::Lost { at: text.len() + 1, count: 2 });
            return Cut { verdict: Verdict::Incomplete, direction, harm, ..cut };
        }
        if !no_checksum {
            adu.pop();
        }
        if cut.verdict.good() && adu.len() >= 2 {
            if text.iter().any(u8::is_ascii_lowercase) {
                cut.finding = cut.finding.or(Some(Finding::LowerCaseHex));
            }
            let pause = (context.pause)(input.pause_before(0));
            cut.direction = judge(context.functions, context.asked, adu[0], &adu[1..], context.said_at(input, 0), pause);
            cut.confidence = AGREES;
            if let [_, 8, 0, 3, delimiter, ..] = adu[..] {
                self.delimiter = delimiter;
            }
        } else {
            cut.direction = autopsy::direction(context, adu);
        }
        cut
    }
}

/// The bytes of hex characters; false if there is anything else, or half a byte. What could be read stays in `out`.
fn decode_hex(text: &[u8], out: &mut Vec<u8>) -> bool {
    out.clear();
    if !solid(text, out) {
        out.extend((0..text.len() / 2).map_while(|at| pair(text, 2 * at)));
        return false;
    }
    text.len().is_multiple_of(2)
}

impl Framer for Ascii {
    fn next(&mut self, input: &Input, context: &Context<'_>, adu: &mut Vec<u8>) -> Option<Cut> {
        adu.clear();
        match input.bytes().first()? {
            b':' => {
                let end = self.end(input)?;
                Some(self.frame(input, context, &end, adu))
            }
            _ => Self::noise(input, context, adu),
        }
    }

    fn mode(&self) -> Mode {
        Mode::Ascii
    }

    fn settled(&self, _offset: u64) -> bool {
        true
    }

    fn break_ns(&self, _line: Option<&Line>) -> Ns {
        CHARACTER_TIMEOUT
    }
}
