//! RTU by announced length and checksum, in both directions, with the pending request as context.
//!
//! A frame begins where an announced length ends in a right checksum. Bytes that begin no frame are collected until
//! the next frame, silence or record, and then named: a damaged frame where header or silences say so, noise elsewhere.

use crate::checksum::{crc_valid, step, INIT};
use crate::direction::{answers, judge, Direction, Match};
use crate::framer::{Context, Cut, CutBy, Framer, Mode, Verdict, NOISE_LIMIT, RTU_LIMIT};
use crate::functions::{Extent, Layout, EXCEPTION_BIT};
use crate::input::Input;
use crate::line::Line;
use crate::Ns;

/// Without line settings or with reads of several bytes, shorter pauses say nothing.
const COARSE_SILENCE: Ns = 5_000_000;

/// The longest pause that may stand inside a frame: USB adapters and schedulers hold bytes back that long.
const BREAK: Ns = 100_000_000;

/// Some masters announce more than the 256 bytes of the specification; a byte count cannot say more than this.
const LONGEST: usize = 272;

/// Unit, function code and checksum: bytes of a frame beside its body.
const AROUND: usize = 4;

/// The framer of an RTU line.
#[derive(Debug, Default)]
pub struct Rtu {
    /// So many bytes from the first on are known to begin no frame.
    skip: usize,
    /// Whether the first byte follows a frame, a silence or nothing.
    after_frame: bool,
    /// Shortest pause between frames.
    silence: Ns,
}

enum Attempt {
    Found(Cut),
    Wait,
    No,
}

impl Rtu {
    /// A framer for a line with these settings.
    pub fn new(line: Option<&Line>) -> Self {
        Self { skip: 0, after_frame: true, silence: line.map_or(COARSE_SILENCE, Line::t35_ns) }
    }

    fn silence(&self, input: &Input) -> Ns {
        if input.coarse {
            self.silence.max(COARSE_SILENCE)
        } else {
            self.silence
        }
    }

    /// Whether a frame that only its checksum vouches for may begin here.
    fn edge(&self, input: &Input, at: usize) -> bool {
        (at == 0 && self.after_frame)
            || input.hard_edge(at)
            || input.pause_before(at).is_some_and(|pause| pause >= self.silence(input))
    }

    fn attempt(&self, input: &Input, context: &Context<'_>, at: usize) -> Attempt {
        let silence = input.break_ns;
        let bytes = input.bytes();
        let limit = input.edge_after(at, bytes.len().min(at + LONGEST), silence);
        let closed = limit.is_some() || input.closed;
        let there = &bytes[at..limit.unwrap_or(bytes.len())];
        if there.len() < AROUND {
            return if closed { Attempt::No } else { Attempt::Wait };
        }
        let mut lengths = Lengths::of(context, there);
        lengths.sort();
        let mut wait = lengths.unsure;
        for &length in &lengths.exact[..lengths.count] {
            if length > there.len() {
                wait = true;
            } else if crc_valid(&there[..length]) && plausible(context, &there[..length]) {
                return Attempt::Found(accept(input, context, at, length, CutBy::Length));
            }
        }
        if lengths.open && self.edge(input, at) {
            match self.open_end(input, context, at, there, closed) {
                Attempt::No => {}
                other => return other,
            }
        }
        if wait && !closed {
            return Attempt::Wait;
        }
        // Between two silences a right checksum makes a frame, whatever the layout says.
        if !self.edge(input, at) {
            return Attempt::No;
        }
        match self.burst_end(input, at, there.len(), closed) {
            // A frame whose last byte was 00 keeps a right checksum without it: then the layout tells.
            Some(length) if lengths.cut_short(length) => Attempt::No,
            Some(length) if length <= RTU_LIMIT && crc_valid(&there[..length]) => {
                Attempt::Found(accept(input, context, at, length, CutBy::Silence))
            }
            None if !closed && there.len() < RTU_LIMIT => Attempt::Wait,
            _ => Attempt::No,
        }
    }

    /// The length of the burst that starts at `at`, if its end is known.
    fn burst_end(&self, input: &Input, at: usize, there: usize, closed: bool) -> Option<usize> {
        let edge = input.edge_after(at, at + there, self.silence(input)).map(|edge| edge - at);
        edge.or(closed.then_some(there))
    }

    /// The end of a frame whose layout fixes no length: a right checksum where silence, a record's end or the next
    /// frame follows. Chance alone gives one in 65 536 places a right checksum, so the checksum is not enough.
    fn open_end(&self, input: &Input, context: &Context<'_>, at: usize, there: &[u8], closed: bool) -> Attempt {
        let mut state = INIT;
        let asked = context.asked.filter(|asked| asked.unit == there[0] && asked.pdu.first() == Some(&there[1]));
        for (i, &byte) in there.iter().enumerate().take(RTU_LIMIT) {
            state = step(state, byte);
            let length = i + 1;
            if state != 0 || length < AROUND {
                continue;
            }
            let end = at + length;
            let silence = input.pause_before(end).is_some_and(|pause| pause >= self.silence(input));
            let cut_by = if silence || (closed && length == there.len()) {
                Some(CutBy::Silence)
            } else if asked.is_some_and(|asked| asked.pdu.len() + 3 == length) {
                Some(CutBy::Checksum)
            } else {
                match follows(context, &input.bytes()[end..]) {
                    Some(true) => Some(CutBy::Checksum),
                    Some(false) => None,
                    None if closed => None,
                    None => return Attempt::Wait,
                }
            };
            if let Some(cut_by) = cut_by {
                return Attempt::Found(accept(input, context, at, length, cut_by));
            }
        }
        if closed || there.len() >= RTU_LIMIT {
            Attempt::No
        } else {
            Attempt::Wait
        }
    }

    /// Names the bytes `..region`, which begin no frame: the first piece of them.
    fn damaged(&mut self, input: &Input, context: &Context<'_>, region: usize, adu: &mut Vec<u8>) -> Cut {
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
        self.skip -= cut.length;
        self.after_frame = cut.length == burst && by_edge != CutBy::Limit;
        cut
    }

    fn name(input: &Input, context: &Context<'_>, burst: usize, by_edge: CutBy) -> Cut {
        let bytes = &input.bytes()[..burst];
        if burst < AROUND {
            return Cut::noise(burst, by_edge);
        }
        let damaged = |length, verdict, cut_by, direction| Cut { verdict, direction, ..Cut::noise(length, cut_by) };
        let familiar = context.known_units[bytes[0] as usize] || context.asked.is_some_and(|asked| asked.unit == bytes[0]);
        let mut shorter = None;
        let mut longer = None;
        let known = announced(context, bytes);
        for (direction, length) in known.iter().copied().flatten() {
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

    /// A record of a recording that prints no checksums is one frame.
    fn without_checksum(&mut self, input: &Input, context: &Context<'_>, adu: &mut Vec<u8>) -> Option<Cut> {
        let read = input.read(0).filter(|read| read.no_checksum)?;
        let length = (read.end - input.offset()) as usize;
        let bytes = &input.bytes()[..length];
        adu.clear();
        adu.extend_from_slice(bytes);
        self.skip = self.skip.saturating_sub(length);
        if length < 2 {
            return Some(Cut::noise(length, CutBy::Record));
        }
        let pause = (context.pause)(input.pause_before(0));
        let direction = judge(context.functions, context.asked, bytes[0], &bytes[1..], context.said_at(input, 0), pause);
        Some(Cut { verdict: Verdict::NoChecksum, direction, ..Cut::noise(length, CutBy::Record) })
    }
}

impl Framer for Rtu {
    fn next(&mut self, input: &Input, context: &Context<'_>, adu: &mut Vec<u8>) -> Option<Cut> {
        if let Some(cut) = self.without_checksum(input, context, adu) {
            return Some(cut);
        }
        loop {
            let attempt = if self.skip < input.bytes().len() { self.attempt(input, context, self.skip) } else { Attempt::Wait };
            match attempt {
                Attempt::Found(cut) if self.skip == 0 => {
                    adu.clear();
                    adu.extend_from_slice(&input.bytes()[..cut.length - 2]);
                    self.after_frame = true;
                    return Some(cut);
                }
                Attempt::Found(_) => return Some(self.damaged(input, context, self.skip, adu)),
                Attempt::No => self.skip += 1,
                Attempt::Wait => {
                    let over = input.closed && self.skip == input.bytes().len();
                    let piece = self.skip >= NOISE_LIMIT
                        || input.edge_after(0, self.skip + 1, self.silence(input)).is_some_and(|e| e <= self.skip);
                    return (self.skip > 0 && (over || piece)).then(|| self.damaged(input, context, self.skip, adu));
                }
            }
        }
    }

    fn mode(&self) -> Mode {
        Mode::Rtu
    }

    fn break_ns(&self, line: Option<&Line>) -> Ns {
        line.map_or(BREAK, |line| BREAK.max(10 * line.char_ns()))
    }
}

/// Frame lengths that the header announces, in either direction.
struct Lengths {
    exact: [usize; 2],
    count: usize,
    /// A length that more bytes will tell.
    unsure: bool,
    /// A layout that fixes no length, or none known.
    open: bool,
}

impl Lengths {
    fn of(context: &Context<'_>, frame: &[u8]) -> Self {
        let mut lengths = Self { exact: [0; 2], count: 0, unsure: false, open: false };
        for (_, extent) in announced(context, frame).iter().copied().flatten() {
            match extent {
                Extent::Exactly(length) if length <= LONGEST => {
                    lengths.exact[lengths.count] = length;
                    lengths.count += 1;
                }
                Extent::Exactly(_) => {}
                Extent::AtLeast(length) => lengths.unsure |= length <= LONGEST,
                Extent::Open(_) => lengths.open = true,
            }
        }
        lengths
    }

    /// Whether a frame of an announced length lost its last byte here.
    fn cut_short(&self, length: usize) -> bool {
        self.exact[..self.count].contains(&(length + 1))
    }

    fn sort(&mut self) {
        if self.count == 2 && self.exact[0] > self.exact[1] {
            self.exact.swap(0, 1);
        }
    }
}

/// The whole-frame lengths that a header announces, the likelier direction first.
fn announced(context: &Context<'_>, frame: &[u8]) -> [Option<(Direction, Extent)>; 2] {
    let (code, body) = (frame[1], &frame[2..]);
    if code & EXCEPTION_BIT != 0 {
        let function = code & !EXCEPTION_BIT;
        return if function == 0 { [None, None] } else { [Some((Direction::Response, Extent::Exactly(5))), None] };
    }
    let around = |layout: &Layout| match layout.extent(body) {
        Extent::Exactly(length) => Extent::Exactly(length + AROUND),
        Extent::AtLeast(length) => Extent::AtLeast(length + AROUND),
        Extent::Open(length) => Extent::Open(length + AROUND),
    };
    let Some(row) = context.functions.row(code, body) else {
        // No code 0 in the specification: a run of zeros is no frame.
        return if code == 0 { [None, None] } else { [Some((Direction::Unknown, Extent::Open(AROUND))), None] };
    };
    let request = Some((Direction::Request, around(&row.request)));
    let response = (row.response != Layout::Silent).then(|| (Direction::Response, around(&row.response)));
    if context.asked.is_some_and(|asked| asked.unit == frame[0] && asked.pdu.first() == Some(&code)) {
        [response, request]
    } else {
        [request, response]
    }
}

/// Whether a right checksum is enough here. `FF FF 00 00 00` has one: start value and zeros alone make it.
fn plausible(context: &Context<'_>, frame: &[u8]) -> bool {
    if frame[1] & EXCEPTION_BIT == 0 || frame[2] != 0 {
        return true;
    }
    context.asked.is_some_and(|asked| answers(context.functions, asked, frame[0], &frame[1..frame.len() - 2]) == Match::Fully)
}

/// Whether a frame begins with these bytes; `None` if more are needed to tell.
fn follows(context: &Context<'_>, bytes: &[u8]) -> Option<bool> {
    if bytes.len() < AROUND {
        return None;
    }
    let lengths = Lengths::of(context, bytes);
    let mut wait = lengths.unsure;
    for &length in &lengths.exact[..lengths.count] {
        if length > bytes.len() {
            wait = true;
        } else if crc_valid(&bytes[..length]) && plausible(context, &bytes[..length]) {
            return Some(true);
        }
    }
    if lengths.open {
        let mut state = INIT;
        for (i, &byte) in bytes.iter().enumerate().take(RTU_LIMIT) {
            state = step(state, byte);
            if state == 0 && i >= AROUND - 1 {
                return Some(true);
            }
        }
        wait |= bytes.len() < RTU_LIMIT;
    }
    if wait {
        None
    } else {
        Some(false)
    }
}

fn accept(input: &Input, context: &Context<'_>, at: usize, length: usize, cut_by: CutBy) -> Cut {
    let frame = &input.bytes()[at..at + length];
    let (unit, pdu) = (frame[0], &frame[1..length - 2]);
    let pause = (context.pause)(input.pause_before(at));
    let direction = judge(context.functions, context.asked, unit, pdu, context.said_at(input, at), pause);
    let matched = context.asked.map_or(Match::No, |asked| answers(context.functions, asked, unit, pdu));
    // Sixteen bits of checksum, some more where the unit is familiar, nearly certain as the answer to the request.
    let confidence = match (matched, context.known_units[unit as usize]) {
        (Match::Fully, _) => 60,
        (Match::Partly, _) => 40,
        (Match::No, true) => 32,
        (Match::No, false) => 24,
    };
    Cut { length, verdict: Verdict::Ok, cut_by, direction, confidence, mbap_id: None, finding: None }
}
