//! Whose turn it is on the two lines of a bus.
//!
//! The line whose first unframed byte is the oldest, where the clock tells the two apart. Adapters that hold bytes back
//! do so on each line by itself: an answer may be seen before its request. There, what the bytes say decides: an answer
//! comes behind the request that it fits, and a line on which nothing is due waits for the other one's bytes.

use std::cmp::Ordering;

use crate::input::Input;
use crate::session::bus::{voted, BusState};
use modlens_protocol::checksum::{crc_valid, CHECKSUM};
use modlens_protocol::direction::{answers, Asked, Direction, Match};
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::{Extent, Functions, EXCEPTION_BIT};
use modlens_protocol::Ns;

/// Who speaks on which line is looked for in so many bytes of a line, and live for so long, before anything is told.
const SURVEY: usize = 4096;
const SURVEY_NS: Ns = 1_000_000_000;

/// Frames that only one side can send, of both lines, that say who speaks on them.
const VOTES: i32 = 3;

/// Strays before a frame that do not hide it.
const STRAYS: usize = 4;

/// Unit, function code, checksum: bytes of a frame beside its body.
const AROUND: usize = 4;

/// How well the first bytes of a line fit a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Fit {
    /// Another unit or function.
    No,
    /// A whole frame that answers something else of this unit and function.
    Partly,
    /// Unit and function, of a frame that is not there yet, or damaged.
    Header,
    /// A whole answer.
    Fully,
}

fn fits(functions: &Functions, bytes: &[u8], asked: Asked<'_>) -> Fit {
    let Some(&wanted) = asked.pdu.first() else { return Fit::No };
    if let Some((frame, _)) = whole(functions, bytes, Direction::Response) {
        return match answers(functions, asked, frame[0], &frame[1..]) {
            Match::No => Fit::No,
            Match::Partly => Fit::Partly,
            Match::Fully => Fit::Fully,
        };
    }
    let header = |two: &[u8]| two[0] == asked.unit && two[1] & !EXCEPTION_BIT == wanted;
    if bytes.windows(2).take(STRAYS).any(header) {
        Fit::Header
    } else {
        Fit::No
    }
}

/// Unit and PDU of the frame that a line's bytes begin with, and the bytes behind it.
fn whole<'a>(functions: &Functions, bytes: &'a [u8], direction: Direction) -> Option<(&'a [u8], &'a [u8])> {
    let (at, frame) = (0..STRAYS).find_map(|at| Some((at, frame_at(functions, bytes.get(at..)?, direction)?)))?;
    Some((frame, &bytes[at + frame.len() + CHECKSUM..]))
}

/// Unit and PDU of the frame that these bytes begin with, as far as its layout tells its length.
fn frame_at<'a>(functions: &Functions, bytes: &'a [u8], direction: Direction) -> Option<&'a [u8]> {
    let (&code, body) = bytes.get(1..)?.split_first()?;
    let row = functions.row(code & !EXCEPTION_BIT, body)?;
    let length = match (code & EXCEPTION_BIT != 0, direction) {
        (true, Direction::Request) => return None,
        (true, _) => 1,
        (false, direction) => match if direction == Direction::Request { &row.request } else { &row.response }.extent(body) {
            Extent::Exactly(length) => length,
            _ => return None,
        },
    };
    let frame = bytes.get(..length + AROUND).filter(|frame| crc_valid(frame))?;
    Some(&frame[..frame.len() - CHECKSUM])
}

/// Frames that only a master can send, less those that only a unit can, among the first bytes of a line.
fn survey(functions: &Functions, input: &Input) -> i32 {
    let bytes = &input.bytes()[..input.bytes().len().min(SURVEY)];
    let (mut votes, mut at) = (0, 0);
    while at + AROUND < bytes.len() {
        let frame = [Direction::Request, Direction::Response].map(|side| frame_at(functions, &bytes[at..], side));
        let Some(adu) = frame.into_iter().flatten().max_by_key(|frame| frame.len()) else {
            at += 1;
            continue;
        };
        votes = voted(votes, functions, adu);
        at += adu.len() + CHECKSUM;
    }
    votes
}

impl BusState {
    /// Whether it is not known yet who speaks on which of two lines, and more bytes will tell.
    pub(super) fn surveys(&mut self, functions: &Functions, live: bool) -> bool {
        if self.surveyed || self.lines.is_empty() {
            return false;
        }
        let plain = |input: &Input| input.timed && input.first_read().is_some_and(|read| !read.record && read.side.is_none());
        let lines = || self.lines.iter().filter(|(_, line)| !line.input.bytes().is_empty());
        let two = self.lines[0].0 != 0 && self.options.bus.network.is_none() && self.options.mode != Some(Mode::Ascii);
        let over = lines().any(|(_, line)| line.input.ended || line.input.bytes().len() >= SURVEY || !plain(&line.input));
        let until = self.survey_deadline().filter(|_| live);
        let late = until.zip(self.now).is_some_and(|(until, now)| now >= until);
        self.surveyed = !two || over || late;
        if two {
            let votes: Vec<i32> = self.lines.iter().map(|(_, line)| survey(functions, &line.input)).collect();
            let sum: i32 = votes.iter().enumerate().map(|(at, &votes)| if at == 0 { votes } else { -votes }).sum();
            if sum.abs() >= VOTES {
                self.surveyed = true;
                self.lines.iter_mut().zip(votes).for_each(|((_, line), votes)| line.votes = votes);
            }
        }
        !self.surveyed
    }

    fn survey_deadline(&self) -> Option<Ns> {
        let waiting = self.lines.iter().filter(|(id, line)| *id != 0 && !line.input.bytes().is_empty());
        waiting.filter_map(|(_, line)| line.input.byte_time(0)).min().filter(|_| !self.surveyed).map(|first| first + SURVEY_NS)
    }

    /// The line that is asked for its next frame; `None` while the other one's bytes may come before it.
    pub(super) fn turn(&self, functions: &Functions) -> Option<usize> {
        let waiting = (0..self.lines.len()).filter(|&at| !self.lines[at].1.input.bytes().is_empty());
        let first = waiting.clone().min_by_key(|&at| self.first_seen(at))?;
        let Some((requests, responses)) = self.roles() else { return Some(first) };
        if waiting.count() == 1 {
            return Some(first).filter(|_| !self.waits(functions, first, requests));
        }
        let apart = self.first_seen(requests).zip(self.first_seen(responses)).map(|(asked, told)| (asked - told).abs());
        if apart.is_none_or(|apart| apart >= self.uncertain()) {
            return Some(first);
        }
        let told = self.lines[responses].1.input.bytes();
        let of_next = self.answers_next(functions, requests, told);
        let Some(open) = self.pairing.asked() else {
            if of_next >= Fit::Header && self.is_second_answer(functions, told) {
                return self.after_second_answer(functions, requests, responses);
            }
            return Some(if of_next >= Fit::Header { requests } else { first });
        };
        match fits(functions, told, open).cmp(&of_next) {
            // After a time-out it is the retry's.
            _ if of_next != Fit::No && self.given_up(responses) => Some(requests),
            Ordering::Greater => Some(responses),
            Ordering::Less => Some(requests),
            Ordering::Equal => Some(first),
        }
    }

    /// How well a line's first bytes fit the first request of the other one.
    fn answers_next(&self, functions: &Functions, requests: usize, told: &[u8]) -> Fit {
        let bytes = self.lines[requests].1.input.bytes();
        if let Some((frame, _)) = whole(functions, bytes, Direction::Request) {
            return fits(functions, told, Asked { unit: frame[0], pdu: &frame[1..] });
        }
        match bytes {
            &[unit, ref pdu @ ..] if !pdu.is_empty() => fits(functions, told, Asked { unit, pdu: &pdu[..1] }).min(Fit::Header),
            _ => Fit::No,
        }
    }

    /// Whether a line begins with the answer to a retry once more: the late one and its own, or the next request's,
    /// which is the same by chance.
    fn is_second_answer(&self, functions: &Functions, told: &[u8]) -> bool {
        let first = whole(functions, told, Direction::Response);
        first.zip(self.pairing.answer_to_retry()).is_some_and(|((frame, _), (unit, pdu))| frame[0] == unit && frame[1..] == *pdu)
    }

    /// Which line comes first there: the answers', if the next request's own one stands behind. It is waited for.
    fn after_second_answer(&self, functions: &Functions, requests: usize, responses: usize) -> Option<usize> {
        let told = &self.lines[responses].1.input;
        let (_, behind) = whole(functions, told.bytes(), Direction::Response)?;
        if self.answers_next(functions, requests, behind) == Fit::Fully {
            return Some(responses);
        }
        let more = !told.ended && !told.closed && self.is_young(responses);
        (!more).then_some(requests)
    }

    /// Whether the first bytes of a line came so long after the open request that its master has rather given up.
    fn given_up(&self, at: usize) -> bool {
        let waited = self.first_seen(at).zip(self.pairing.asked_at()).map(|(told, asked)| told - asked);
        self.pairing.tempo.judge(waited) > 0.0
    }

    /// When a line need not wait for the other one any more.
    pub(super) fn turn_deadline(&self) -> Option<Ns> {
        if let Some(survey) = self.survey_deadline().filter(|&until| self.now.is_some_and(|now| now < until)) {
            return Some(survey);
        }
        self.roles()?;
        let waiting = self.lines.iter().enumerate().filter(|(_, (_, line))| !line.input.bytes().is_empty());
        let until = waiting.filter_map(|(at, _)| Some(self.first_seen(at)? + self.uncertain())).min();
        until.filter(|&until| self.now.is_some_and(|now| now < until))
    }

    /// The lines of the requests and of the responses, where the order of their reads is not that of the wire.
    fn roles(&self) -> Option<(usize, usize)> {
        let late = self.lines.len() == 2 && self.options.bus.network.is_none();
        if !late || !self.lines.iter().any(|(_, line)| line.input.coarse) {
            return None;
        }
        let rtu = self.lines.iter().all(|(_, line)| line.framer.mode() == Mode::Rtu);
        match self.speaker(0).filter(|_| rtu)? {
            Direction::Request => Some((0, 1)),
            _ => Some((1, 0)),
        }
    }

    /// Whether what stands in front of this line, the only one with bytes, may have come behind what the other one brings.
    fn waits(&self, functions: &Functions, at: usize, requests: usize) -> bool {
        let input = &self.lines[at].1.input;
        let due = match self.pairing.asked() {
            None => at == requests,
            Some(open) => at != requests && fits(functions, input.bytes(), open) != Fit::No && !self.given_up(at),
        };
        let over = input.ended || input.closed;
        !due && !over && self.is_young(at)
    }

    /// Whether bytes of the other line that come now may have been before the first bytes of this one.
    fn is_young(&self, at: usize) -> bool {
        self.now.zip(self.first_seen(at)).is_some_and(|(now, seen)| now - seen < self.uncertain())
    }

    /// Reads within this time may have been on the two lines in any order.
    fn uncertain(&self) -> Ns {
        self.pairing.tempo.skew().max(2 * self.coarsest())
    }

    fn first_seen(&self, at: usize) -> Option<Ns> {
        self.lines[at].1.input.byte_time(0)
    }
}
